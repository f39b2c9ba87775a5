//! `grimace evaluate locate`.

use std::{collections::BTreeMap, path::PathBuf};

use grimace::internal::{cli::Outcome, input::CsvFile};
use grimace_lab::evaluate::{evaluate_locate, locate_calibration, locate_failures, locate_table};
use serde_json::json;

use super::{CommonArgs, bar, locator, people_named};

/// How right found points are, on photographs with hand-set points.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace learn locator FACES -o others.bin --leave-out L022,L045
  grimace evaluate locate FACES -o located --model others.bin --only L022,L045 --people people.csv --by gender
  grimace evaluate locate FACES -o small --model others.bin --only L022,L045 --eyes 24

FACES is a folder as for `grimace learn locator`. The model that ships was learned from the London Set: judge on its people only with a model \
that was learned without them. Errors are in percent of the eye distance.")]
pub struct Args {
    /// Folder of photographs and points
    faces: PathBuf,
    /// A model of `grimace learn locator`, instead of the one that ships
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// People to judge on, separated by commas; all if not given
    #[arg(long, value_delimiter = ',', value_name = "PERSON")]
    only: Vec<String>,
    /// Table of the people: person, and columns to group by
    #[arg(long, requires = "by", value_name = "CSV")]
    people: Option<PathBuf>,
    /// Column of that table to group by
    #[arg(long, requires = "people", value_name = "COLUMN")]
    by: Option<String>,
    /// Judge on the photographs made so small, or large, that the pupils are so far apart, px
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
    folder.print("Expected and real median error, by fifths of the points", &calibration);
    if !args.common.quiet {
        println!("{} faces: {missed} missed, {gross} grossly wrong, {doubtful} not trusted", faces.len());
    }
    let results = json!({ "faces": faces.len(), "missed": missed, "grossly_wrong": gross, "not_trusted": doubtful });
    folder.finish("locate", None, args.common.seed, json!({ "only": args.only, "by": args.by, "eyes": args.eyes }), results)?;
    Ok(Outcome::Done)
}
