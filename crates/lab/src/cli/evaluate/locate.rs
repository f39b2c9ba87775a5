//! `grimace evaluate locate`.

use std::{collections::BTreeMap, path::PathBuf};

use grimace::internal::{cli::Outcome, input::CsvFile};
use grimace_lab::evaluate::{evaluate_locate, locate_calibration, locate_failures, locate_table};
use serde_json::json;

use super::{CommonArgs, bar, locator, people_named};

/// Error of found points, on photographs with hand-set points.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace learn locator FACES -o others.bin --leave-out L022,L045
  grimace evaluate locate FACES -o located --model others.bin --only L022,L045 --people people.csv --by gender
  grimace evaluate locate FACES -o small --model others.bin --only L022,L045 --eyes 24

FACES is a folder as for `grimace learn locator`. The built-in model was trained on the London Set: to evaluate on its people, give \
a model that was trained without them. Errors are in percent of the eye distance.")]
pub struct Args {
    /// Folder of photographs and their points
    faces: PathBuf,
    /// Model file of `grimace learn locator`, to use instead of the built-in model
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// People to evaluate, separated by commas; by default all
    #[arg(long, value_delimiter = ',', value_name = "PERSON")]
    only: Vec<String>,
    /// Table of people, a CSV file with a column person and columns to group by
    #[arg(long, requires = "by", value_name = "CSV")]
    people: Option<PathBuf>,
    /// Column of --people to group by
    #[arg(long, requires = "people", value_name = "COLUMN")]
    by: Option<String>,
    /// Scale the photographs to this distance between the pupils, in px
    #[arg(long, value_parser = clap::value_parser!(u16).range(10..=1000), value_name = "PX")]
    eyes: Option<u16>,
    #[command(flatten)]
    common: CommonArgs,
}

/// Measures.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut folder = args.common.start()?;
    let locator = locator(args.model.as_deref())?;
    let mut faces = people_named(&args.faces, &args.only)?;
    if let Some(eyes) = args.eyes {
        faces.iter_mut().for_each(|face| *face = face.resized(f64::from(eyes)));
    }
    let mut groups = BTreeMap::new();
    if let (Some(path), Some(by)) = (&args.people, &args.by) {
        let csv = CsvFile::open(path)?;
        let [person, column] = csv.require(["person", by.as_str()])?;
        for row in csv.rows() {
            let row = row?;
            groups.insert(row.get(person).to_owned(), row.get(column).to_owned());
        }
    }
    let bar = bar(args.common.quiet, "faces", faces.len());
    let people = evaluate_locate(&faces, &locator, || bar.inc(1));
    bar.finish_and_clear();
    let (errors, calibration) = (locate_table(&people, &groups), locate_calibration(&people));
    let [missed, gross, doubtful] = locate_failures(&people);
    folder.table("errors.csv", &errors)?;
    folder.table("expected_errors.csv", &calibration)?;
    folder.print("Error of found points, percent of the eye distance", &errors);
    folder.print("Expected and true median error, by quintile of the points", &calibration);
    if !args.common.quiet {
        println!("{} faces: {missed} missed, {gross} grossly wrong, {doubtful} not trusted", faces.len());
    }
    let results = json!({ "faces": faces.len(), "missed": missed, "grossly_wrong": gross, "not_trusted": doubtful });
    folder.finish("locate", None, args.common.seed, json!({ "only": args.only, "by": args.by, "eyes": args.eyes }), results)?;
    Ok(Outcome::Done)
}
