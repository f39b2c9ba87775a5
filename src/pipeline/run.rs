//! `run`: every stage over a dataset, parallel over sequences, resumable.
//!
//! A run into a folder that holds an earlier run of the same dataset with the same options brings it up to date: a sequence whose
//! inputs are unchanged, by content, is not tracked again, and when nothing at all changed nothing is written. One bad sequence costs
//! that sequence. Results are collected in the order of the sequences, so that the number of threads changes no byte.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
};

use rayon::prelude::*;

use super::{
    Analysis, Failure, RunJson, SequenceFailure, SequenceRecord, Stage, Workbench,
    analysis::{AnalysisError, analyze_with},
    files::file_blake3,
    folder::{RUN_JSON, new_record, open, remove_stale},
    parts::PARTS_FOLDER,
    work::{Collected, Planned, collect, plan_all, process_all},
    write::write_failures,
};
use crate::{
    dataset::SequenceEntry,
    output::{self, OutputError},
    pipeline::{write_analysis, write_columnar},
    text::message,
    units::SequenceId,
};

/// What happens during a run, for a progress bar.
#[derive(Clone, Debug)]
pub enum Event {
    /// The dataset was read.
    Started {
        /// Sequences to process.
        sequences: usize,
    },
    /// A frame was tracked.
    Frame,
    /// A sequence is done.
    Finished {
        /// Which.
        id: SequenceId,
        /// Frames that were read from an unchanged track instead of tracked.
        reused: bool,
        /// Why it failed, if it did.
        failure: Option<String>,
    },
    /// All sequences are done; statistics and files follow.
    Analyzing,
}

/// What a run did.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunSummary {
    /// Sequences in the dataset.
    pub sequences: usize,
    /// Tracked in this run.
    pub tracked: usize,
    /// Unchanged since an earlier run.
    pub reused: usize,
    /// Failed, as in `failures.csv`.
    pub failures: Vec<Failure>,
    /// Left out on purpose, with the reason.
    pub skipped: Vec<(String, String)>,
    /// Labels and number of sequences of the representatives.
    pub representatives: Vec<(String, usize)>,
    /// Warnings that a person should read.
    pub warnings: Vec<String>,
    /// Nothing had changed: nothing was written.
    pub unchanged: bool,
}

/// Why a run ended without results.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The dataset does not open.
    #[error(transparent)]
    Dataset(#[from] crate::dataset::DatasetError),
    /// The output folder holds something else.
    #[error("{} is not empty and holds no run of grimace; choose another folder, or --force to write into it", path.display())]
    ForeignFolder {
        /// The folder.
        path: PathBuf,
    },
    /// The output folder holds a run of another dataset or with other options.
    #[error("{} holds a run with {what}; choose another folder, or --force to replace its results (unchanged tracks are kept)", path.display())]
    OtherRun {
        /// The folder.
        path: PathBuf,
        /// What differs.
        what: String,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Writing in the middle of a sequence failed.
    #[error("{id}: {reason}")]
    Write {
        /// The sequence.
        id: SequenceId,
        /// Why.
        reason: String,
    },
    /// No sequence could be used.
    #[error("none of the {sequences} sequences could be processed; the first failed at {stage}: {reason}")]
    NothingLeft {
        /// Sequences of the dataset.
        sequences: usize,
        /// Stage at which the first failed.
        stage: Stage,
        /// Why.
        reason: String,
    },
    /// A part of a run in a folder in which none was begun.
    #[error("{}: no run was begun here; `grimace run DATASET -o OUT --plan` begins one", path.display())]
    NotBegun {
        /// The folder.
        path: PathBuf,
    },
    /// An emotion that no sequence shows.
    #[error("no sequence shows the emotion `{emotion}`")]
    NoSuchEmotion {
        /// The emotion.
        emotion: String,
    },
    /// The dataset has no sequences.
    #[error("{} has no sequences", path.display())]
    Empty {
        /// The dataset.
        path: PathBuf,
    },
    /// Statistics failed.
    #[error(transparent)]
    Analysis(#[from] AnalysisError),
    /// The caller asked to stop.
    #[error("interrupted; what is done is kept, run the same command again to go on")]
    Interrupted,
}

/// Runs every stage over a dataset into the folder `out`.
///
/// `event` is called from many threads. `stop` ends the run at the next frame, leaving whole files only.
///
/// # Errors
/// [`RunError`]; single sequences that fail are not errors but rows of [`RunSummary::failures`].
pub fn run(
    dataset: &Path,
    out: &Path,
    bench: &Workbench,
    overlay: Option<&Path>,
    force: bool,
    stop: &AtomicBool,
    event: impl Fn(Event) + Sync,
) -> Result<RunSummary, RunError> {
    let (opened, name, earlier) = open(dataset, out, bench, force)?;
    let sequences = opened.sequences.len() + opened.failures.len();
    event(Event::Started { sequences });

    let chosen: Vec<&SequenceEntry> = opened.sequences.iter().collect();
    let mut planned = plan_all(&chosen, bench, stop);
    planned.extend(opened.failures.iter().map(|failure| Planned {
        id: SequenceId { subject: failure.subject.clone(), sequence: failure.sequence.clone() },
        emotion: String::new(),
        entry: None,
        source: Err(SequenceFailure {
            stage: Stage::Dataset,
            reason: message(&failure.error.to_string()).into_owned(),
            fatal: false,
        }),
    }));
    planned.sort_by(|a, b| a.id.cmp(&b.id));

    if stop.load(Ordering::Relaxed) {
        return Err(RunError::Interrupted);
    }
    if let Some(earlier) = &earlier
        && !force
        && !earlier.sequences.is_empty()
        && !earlier.sequences.iter().any(|s| planned.iter().any(|p| p.id == s.id))
    {
        let what = format!("another dataset of the same name, `{name}`: none of its sequences is in this one");
        return Err(RunError::OtherRun { path: out.to_owned(), what });
    }
    let skipped: Vec<(String, String)> = opened.skipped.iter().map(|s| (s.id.to_string(), s.reason.clone())).collect();
    if let Some(earlier) = &earlier
        && overlay.is_none()
        && is_unchanged(earlier, &planned, &skipped, out)
    {
        return Ok(summary_of(earlier));
    }
    let mut record = new_record(name, skipped, bench);
    record.outputs = earlier.as_ref().map(|e| e.outputs.clone()).unwrap_or_default();
    output::write_json(&out.join(RUN_JSON), &record)?;

    let results = process_all(&planned, out, bench, overlay, stop, &event)?;
    event(Event::Analyzing);

    let Collected { models, failures, tracked, reused, mut outputs } = collect(planned, results, out, &mut record)?;
    if models.is_empty() {
        write_failures(&out.join("failures.csv"), &failures)?;
        let first = failures.first();
        return Err(RunError::NothingLeft {
            sequences,
            stage: first.map_or(Stage::Dataset, |f| f.stage),
            reason: first.map(|f| f.reason.clone()).unwrap_or_default(),
        });
    }

    if bench.options.columnar {
        write_columnar(&out.join("models.parquet"), &models).map_err(AnalysisError::from)?;
        if let Some(hash) = file_blake3(&out.join("models.parquet")) {
            outputs.insert("models.parquet".to_owned(), hash);
        }
    }
    let analysis = Analysis { tracked_here: true, ..analyze_with(models, failures, bench, Some(out))? };
    outputs.extend(write_analysis(&analysis, out, &record.dataset, bench)?);
    remove_stale(out, &outputs);
    record.outputs = outputs;
    record.representatives = analysis.counts();
    record.warnings.clone_from(&analysis.warnings);
    record.complete = true;
    output::write_json(&out.join(RUN_JSON), &record)?;
    // Whatever was computed apart is part of the results now; left behind it does no harm.
    let _ = fs::remove_dir_all(out.join(PARTS_FOLDER));
    Ok(RunSummary { tracked, reused, unchanged: false, ..summary_of(&record) })
}

/// Whether an earlier run was made of the very same sequences and all its files are still as it wrote them.
fn is_unchanged(earlier: &RunJson, planned: &[Planned<'_>], skipped: &[(String, String)], out: &Path) -> bool {
    let same_sequence = |(record, item): (&SequenceRecord, &Planned<'_>)| {
        record.id == item.id
            && record.emotion == item.emotion
            && record.metadata == item.metadata()
            && match &item.source {
                Ok((_, hash)) => record.inputs_blake3 == *hash,
                Err(failure) => record.failure.as_ref() == Some(&(failure.stage, failure.reason.clone())),
            }
    };
    earlier.complete
        && earlier.skipped == skipped
        && earlier.sequences.len() == planned.len()
        && earlier.sequences.iter().zip(planned).all(same_sequence)
        && earlier.outputs.par_iter().all(|(file, hash)| file_blake3(&out.join(file)).as_ref() == Some(hash))
}

fn summary_of(record: &RunJson) -> RunSummary {
    let failures = record.sequences.iter().filter_map(|s| {
        let (stage, reason) = s.failure.clone()?;
        Some(Failure { subject: s.id.subject.clone(), sequence: s.id.sequence.clone(), stage, reason })
    });
    let failures: Vec<_> = failures.collect();
    RunSummary {
        sequences: record.sequences.len(),
        tracked: 0,
        reused: record.sequences.len() - failures.len(),
        failures,
        skipped: record.skipped.clone(),
        representatives: record.representatives.clone(),
        warnings: record.warnings.clone(),
        unchanged: true,
    }
}
