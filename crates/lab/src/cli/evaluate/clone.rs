//! `grimace evaluate clone`.

use std::{path::PathBuf, sync::atomic::Ordering};

use grimace::internal::{
    clone::CloneOptions,
    pipeline::{PipelineOptions, Workbench},
};
use grimace_lab::{
    evaluate::{Cell, Table, Transfer, cross_table, evaluate_cross_cloning, evaluate_self_cloning, self_rows_table, self_table},
    simulate::{Emotion, SimulateOptions},
};
use serde_json::json;

use super::{CommonArgs, bar, clone_sheets};
use grimace::internal::cli::{
    Outcome,
    shared::{FitArgs, TrackArgs, WhichMarksArgs, stop_flag},
};

/// Accuracy of clones: sequences cloned onto their own neutral frame, and simulated people onto each other.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace evaluate clone faces -o self-cloning --by kind
  grimace evaluate clone -o cross-cloning --subjects 24
  grimace evaluate clone --sheets anna.jpg ben.jpg --sources results/representatives/*.csv -o sheets
  grimace evaluate clone --grades sheets/grades.csv -o graded

With a DATASET (68-point landmarks for the neutral and the last frame), every sequence is tracked and cloned onto its own neutral frame. The \
last frame is compared with the real one inside the convex hull of the landmarks: SSIM, the share of the way from the neutral copy to 1, \
PSNR, and the error of the motion of the nodes.

Without a DATASET, simulated people are cloned onto each other. The apex is compared with the target performing the same expression, for every \
kind of scaling.

--sheets draws clones for grading by eye: one picture per photograph with its clones in random order, a table to fill in, and the key to \
it. --grades summarizes the filled-in table.")]
pub struct Args {
    /// Dataset with 68-point landmarks, for self-cloning; by default simulated people are cloned onto each other
    dataset: Option<PathBuf>,
    /// Column of the manifest to group by
    #[arg(long, value_name = "COLUMN", requires = "dataset")]
    by: Option<String>,
    /// Number of simulated subjects; each is cloned onto the next three
    #[arg(long, default_value_t = 24, value_name = "N", conflicts_with = "dataset", value_parser = clap::value_parser!(u32).range(2..=10_000))]
    subjects: u32,
    /// Draw contact sheets of clones on these neutral photographs, in which the marks are found
    #[arg(long, num_args = 1.., value_name = "IMAGE", requires = "sources", conflicts_with_all = ["dataset", "subjects", "grades"])]
    sheets: Vec<PathBuf>,
    /// Motions to clone on the sheets: representatives, tracks, FAP files
    #[arg(long, num_args = 1.., value_name = "FILE", requires = "sheets")]
    pub(super) sources: Vec<PathBuf>,
    /// Filled-in table of grades to summarize, with its key.csv beside it
    #[arg(long, value_name = "GRADES.csv", conflicts_with_all = ["dataset", "subjects"])]
    grades: Option<PathBuf>,
    #[command(flatten)]
    pub(super) marks: WhichMarksArgs,
    #[command(flatten)]
    fit: FitArgs,
    #[command(flatten)]
    track: TrackArgs,
    #[command(flatten)]
    pub(super) common: CommonArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut folder = args.common.start()?;
    let options = PipelineOptions { fit: args.fit.options(), track: args.track.options(), ..PipelineOptions::default() };
    let bench = Workbench::new(None, options)?;
    if let Some(grades) = &args.grades {
        return clone_sheets::grade(args, grades, folder);
    }
    if !args.sheets.is_empty() {
        return clone_sheets::draw(args, &args.sheets, folder, &bench);
    }
    let shown = json!({ "fit": bench.options.fit, "track": bench.options.track, "marks": args.marks.marks });
    let Some(dataset) = &args.dataset else {
        let simulation = SimulateOptions {
            subjects: args.subjects,
            emotions: Emotion::BASIC.to_vec(),
            seed: args.common.seed,
            ..SimulateOptions::default()
        };
        let rows = evaluate_cross_cloning(&simulation, &bench)?;
        let table = cross_table(&rows);
        folder.table("cross_cloning.csv", &table)?;
        folder.print("Cross-cloning at the apex: mean distance of the nodes from the truth", &table);
        let mut pairs = Table::new(["truth", "emotion", "source", "target", "scaling", "mean_percent_es"]);
        for row in &rows {
            let (source, target) = row.pair;
            pairs.rows.push(vec![
                Cell::text(row.scope.name()),
                Cell::text(row.emotion.label()),
                Cell::text(format!("S{:03}", source + 1)),
                Cell::text(format!("S{:03}", target + 1)),
                Cell::text(row.transfer.name()),
                Cell::Number(row.error, 3),
            ]);
        }
        folder.table("cross_cloning_pairs.csv", &pairs)?;
        let names: Vec<&str> = Transfer::ALL.iter().map(|t| t.name()).collect();
        let results = json!({ "pairs": rows.len() / Transfer::ALL.len(), "scalings": names });
        folder.finish(
            "cross-cloning",
            None,
            args.common.seed,
            json!({ "simulation": simulation, "clone": CloneOptions::default() }),
            results,
        )?;
        return Ok(Outcome::Done);
    };
    let stop = stop_flag()?;
    let total = grimace::internal::dataset::Dataset::open(dataset)?.sequences.len();
    let bar = bar(args.common.quiet, "self-cloning", total);
    let progress = || {
        bar.inc(1);
        !stop.load(Ordering::Relaxed)
    };
    let clone_options = CloneOptions::default();
    let evaluated = evaluate_self_cloning(dataset, args.by.as_deref(), &args.marks.marks, &clone_options, &bench, progress);
    bar.finish_and_clear();
    let (rows, failures) = evaluated?;
    let table = self_table(&rows);
    folder.table("self_cloning.csv", &table)?;
    folder.table("self_cloning_sequences.csv", &self_rows_table(&rows))?;
    folder.print("Self-cloning: the clone's last frame beside the real one, inside the face", &table);
    let mut failed = Table::new(["sequence", "reason"]);
    for failure in &failures {
        failed.rows.push(vec![Cell::text(&failure.id), Cell::text(&failure.reason)]);
        eprintln!("{}: {}", failure.id, failure.reason);
    }
    folder.table("failures.csv", &failed)?;
    let results = json!({ "rows": rows.len(), "failures": failures.len() });
    folder.finish("self-cloning", Some(dataset), args.common.seed, json!({ "bench": shown, "clone": clone_options }), results)?;
    Ok(match (rows.is_empty(), failures.is_empty()) {
        (_, true) => Outcome::Done,
        (true, _) => Outcome::Failed,
        _ => Outcome::SomeFailed,
    })
}
