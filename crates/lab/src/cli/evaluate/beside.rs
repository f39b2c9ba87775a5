//! `grimace evaluate beside`.

use std::path::{Path, PathBuf};

use grimace::internal::{
    cli::Outcome,
    dataset::Dataset,
    fit::{NeutralFace, read_neutral_faces},
    locate::learn::TrainingFace,
    sequence::read_frame,
};
use grimace_lab::evaluate::{BesidePerson, beside_table, beside_trials, evaluate_beside, evaluate_beside_in};
use serde_json::json;

use super::{CommonArgs, bar, locator, people_named};

/// Detection of marks that do not fit the face: detection rate and false alarms.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace learn locator FACES -o others.bin --leave-out L022,L045
  grimace evaluate beside FACES -o beside --model others.bin --only L022,L045

FACES is a folder as for `grimace learn locator`, with landmarks68.csv and smiling/PERSON.jpg beside it. The built-in model was trained on the \
London Set: to evaluate on its people, give a model that was trained without them.")]
pub struct Args {
    /// Folder of photographs and their points, or a dataset
    faces: PathBuf,
    /// FACES is a dataset with landmarks; evaluate the first and the last frame of every sequence
    #[arg(long)]
    sequences: bool,
    /// Model file of `grimace learn locator`, to use instead of the built-in model
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// People to evaluate, separated by commas; by default all
    #[arg(long, value_delimiter = ',', value_name = "PERSON")]
    only: Vec<String>,
    #[command(flatten)]
    common: CommonArgs,
}

/// Measures.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut folder = args.common.start()?;
    let locator = locator(args.model.as_deref())?;
    let trials = if args.sequences {
        let mut dataset = Dataset::open(&args.faces)?;
        dataset.sequences.retain(|entry| args.only.is_empty() || args.only.contains(&entry.id.subject));
        let bar = bar(args.common.quiet, "sequences", dataset.sequences.len());
        let trials = evaluate_beside_in(&dataset, &locator, || bar.inc(1))?;
        bar.finish_and_clear();
        trials
    } else {
        let people = people(&args.faces, &args.only)?;
        let bar = bar(args.common.quiet, "people", people.len());
        let trials = evaluate_beside(&people, &locator, args.common.seed, || bar.inc(1));
        bar.finish_and_clear();
        trials
    };
    let table = beside_table(&trials);
    folder.table("noticed.csv", &table)?;
    folder.print("Marks that are reported", &table);
    folder.table("trials.csv", &beside_trials(&trials))?;
    let options = json!({ "only": args.only, "sequences": args.sequences });
    folder.finish("beside", None, args.common.seed, options, json!({ "sets": trials.len() }))?;
    Ok(Outcome::Done)
}

/// The people of a folder: all, or the named ones.
fn people(folder: &Path, only: &[String]) -> anyhow::Result<Vec<BesidePerson>> {
    let landmarks = |state: &str| anyhow::Ok(read_neutral_faces(&folder.join("landmarks68.csv"), state)?.faces);
    let (neutral, smiling) = (landmarks("neutral")?, landmarks("smiling")?);
    let of = |all: &[NeutralFace], name: &str| all.iter().find(|f| f.name == name).map(|f| f.points.clone());
    let person = |face: TrainingFace| {
        let smile = of(&smiling, &face.person).map(|points| {
            let picture = read_frame(&folder.join("smiling").join(format!("{}.jpg", face.person)))?;
            anyhow::Ok((picture.image().clone(), points))
        });
        Ok(BesidePerson { landmarks: of(&neutral, &face.person), smile: smile.transpose()?, neutral: face })
    };
    people_named(folder, only)?.into_iter().map(person).collect()
}
