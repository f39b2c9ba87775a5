//! `grimace evaluate placement`.

use std::{collections::BTreeSet, path::PathBuf};

use grimace::internal::{
    cli::Outcome,
    fit::read_neutral_faces,
    locate::{Locator, Model, learn::read_faces},
};
use grimace_lab::evaluate::{
    Cell, FOUND, SET_ALONE, SET_AND_READ, Table, placement_knots, placement_samples, placement_table, unmarked_table,
};
use serde_json::json;

use super::{CommonArgs, check_named};

/// Parts of the calibration.
const BINS: usize = 16;

/// Expected errors of fitted nodes against true errors.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace learn locator FACES -o others.bin --leave-out L022,L045
  grimace evaluate placement FACES -o placed --model others.bin --only L022,L045

FACES is a folder as for `grimace learn locator`, with landmarks68.csv beside delineation189.csv. Every person is fitted with priors that were \
learned without them, from many kinds of marks. Found marks are evaluated only for the people of --only, whom the model must not have seen.

knots.csv is the calibration that these people give for hand-set marks. The expected errors in the rows `others` come from five-fold \
cross-validation over people. The command lists marks that the fit refuses; the exit status is then 3.")]
pub struct Args {
    /// Folder of photographs and their points
    faces: PathBuf,
    /// Model file of `grimace learn locator`, trained without the people of --only
    #[arg(long, requires = "only", value_name = "FILE")]
    model: Option<PathBuf>,
    /// People whose marks are found in the pictures, separated by commas
    #[arg(long, requires = "model", value_delimiter = ',', value_name = "PERSON")]
    only: Vec<String>,
    #[command(flatten)]
    common: CommonArgs,
}

/// Measures.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut folder = args.common.start()?;
    let faces = read_faces(&args.faces, &BTreeSet::new())?.faces;
    let landmarks = read_neutral_faces(&args.faces.join("landmarks68.csv"), "neutral")?.faces;
    check_named(&faces, &args.faces, &args.only)?;
    let only: BTreeSet<String> = args.only.iter().cloned().collect();
    let locator = args.model.as_ref().map(|path| Model::read(path).map(|(model, _)| Locator::new(model))).transpose()?;
    let placed = placement_samples(&faces, &landmarks, locator.as_ref().map(|l| (l, &only)), args.common.seed)?;
    let (samples, refused, read) = (placed.samples, placed.refused, placed.read);
    let table = placement_table(&samples);
    folder.table("expected_errors.csv", &table)?;
    folder.print("Expected and true median error, by quintile of the nodes, percent of the eye distance", &table);
    if !read.is_empty() {
        let table = unmarked_table(&samples);
        folder.table("unmarked.csv", &table)?;
        let nodes_read = read.iter().filter(|r| **r).count();
        folder.print(&format!("All nodes, percent of the eye distance; read in {nodes_read} of {} fits", read.len()), &table);
    }
    let mut knots = Table::new(["log_spread", "log_error"]);
    knots.rows = placement_knots(samples.iter().filter(|s| ![FOUND, SET_ALONE, SET_AND_READ].contains(&s.marks)), BINS)
        .into_iter()
        .map(|(s, e)| vec![Cell::Number(s, 3), Cell::Number(e, 3)])
        .collect();
    folder.table("knots.csv", &knots)?;
    folder.finish(
        "placement",
        None,
        args.common.seed,
        json!({ "only": args.only }),
        json!({ "nodes": samples.len(), "refused": refused.len() }),
    )?;
    refused.iter().for_each(|marks| eprintln!("refused: {marks}"));
    Ok(if refused.is_empty() { Outcome::Done } else { Outcome::SomeFailed })
}
