//! `grimace evaluate segment`.

use std::{path::PathBuf, sync::atomic::Ordering};

use grimace::internal::{
    cli::{Outcome, shared::stop_flag},
    dataset::{Dataset, list_frames},
    pipeline::{PipelineOptions, Recording, RecordingError, Workbench, segment_recording},
    segment::SegmentOptions,
};
use grimace_lab::evaluate::{Cell, SegmentTrial, Table, judge_recording, read_recording_truth, segment_table};
use rayon::prelude::*;
use serde_json::json;

use super::{CommonArgs, bar};

/// Detection of expressions and rests in whole recordings.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace simulate -o recordings --recordings --subjects 10 --yaw 12 --pitch 8 --seed 7
  grimace evaluate segment recordings -o segments

DATASET comes from `grimace simulate --recordings`. An expression counts as found if a proposed apex lies in it. A proposal counts as wrong if \
its apex lies in no expression. A rest of 10 or more frames counts as found if half of its frames are found.")]
pub struct Args {
    /// Dataset of recordings with their ground truth
    dataset: PathBuf,
    #[command(flatten)]
    common: CommonArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut folder = args.common.start()?;
    let dataset = Dataset::open(&args.dataset)?;
    let truth = read_recording_truth(&dataset.root)?;
    let bench = Workbench::new(None, PipelineOptions::default())?;
    let options = SegmentOptions::default();
    let stop = stop_flag()?;
    let recordings: Vec<_> = dataset.sequences.iter().filter_map(|entry| Some((entry, truth.get(&entry.id)?))).collect();
    anyhow::ensure!(
        !recordings.is_empty(),
        "{}: no recording has ground truth; make recordings with `grimace simulate --recordings`",
        args.dataset.display()
    );
    let bar = bar(args.common.quiet, "recordings", recordings.len());
    let one = |(entry, truth): &(&grimace::internal::dataset::SequenceEntry, &grimace_lab::evaluate::RecordingTruth)| {
        let recording = Recording {
            stem: entry.id.sequence.clone(),
            frames: list_frames(&entry.frames_path, None, None)?,
            fps: entry.fps,
            marks: None,
        };
        let found = segment_recording(&recording, &bench, &options, &|_, _, _| !stop.load(Ordering::Relaxed));
        bar.inc(1);
        match found {
            Err(RecordingError::Interrupted) => anyhow::bail!("interrupted"),
            Ok(found) => Ok(judge_recording(&entry.id, truth, Ok(&found))),
            Err(error) => Ok(judge_recording(&entry.id, truth, Err(error.to_string()))),
        }
    };
    let trials: Vec<SegmentTrial> = recordings.par_iter().map(one).collect::<anyhow::Result<_>>()?;
    bar.finish_and_clear();
    let table = segment_table(&trials);
    folder.table("segments.csv", &table)?;
    folder.table("recordings.csv", &trials_table(&trials))?;
    folder.print("Expressions and rests of recordings", &table);
    let failed: Vec<&SegmentTrial> = trials.iter().filter(|t| t.failure.is_some()).collect();
    if !args.common.quiet {
        failed.iter().for_each(|t| println!("{}: {}", t.id, t.failure.as_deref().unwrap_or_default()));
    }
    let results = json!({ "recordings": trials.len(), "failed": failed.len() });
    folder.finish("segment", Some(&args.dataset), args.common.seed, json!({ "segment": options }), results)?;
    Ok(Outcome::Done)
}

/// One row per true expression.
fn trials_table(trials: &[SegmentTrial]) -> Table {
    let mut table =
        Table::new(["subject", "sequence", "emotion", "apex_off", "proposed", "wrong", "rests", "rests_found", "failure"]);
    for t in trials {
        for (emotion, off) in &t.apexes {
            table.rows.push(vec![
                Cell::text(&t.id.subject),
                Cell::text(&t.id.sequence),
                Cell::text(emotion),
                Cell::maybe(off.map(|d| d as f64), 0),
                Cell::Count(t.proposed),
                Cell::Count(t.wrong),
                Cell::Count(t.rests),
                Cell::Count(t.rests_found),
                Cell::text(t.failure.clone().unwrap_or_default()),
            ]);
        }
    }
    table
}
