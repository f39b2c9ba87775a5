//! `run`: all stages over a dataset, parallel over sequences, resumable.
//!
//! A run into the folder of an earlier run of the same dataset with the same options updates it. A sequence whose inputs have unchanged
//! content is not tracked again; if nothing changed at all, nothing is written. A sequence that fails does not stop the others. Results are
//! collected in the order of the sequences, so that the number of threads does not change the output.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
};

use rayon::prelude::*;

use super::{
    Analysis, Failure, RunJson, SequenceRecord, Stage, Workbench,
    analysis::{AnalysisError, analyze_with},
    corrected::unused_corrections,
    covariates::COVARIATE_TABLES,
    file_blake3 as hash_of,
    folder::{RUN_JSON, TRACKS_KEPT, new_record, open},
    ledger::{Ledger, remove_journal},
    looks::{fill_in_new, looks_in, unused_looks},
    overlays::{AmongFrames, OverlayFolder, overlays_of},
    parts::PARTS_FOLDER,
    skins::{collect_skins, picture_sources},
    variation::model_names,
    work::{Collected, Planned, Worked, collect, corrections_hash, plan_all, process_all, sequence_files},
    write::{ANALYSIS_TABLES, analysis_files, class_files, table_names, write_failures},
};
use crate::{
    dataset::SequenceEntry,
    output::{self, OutputError, claim_folder, count},
    pipeline::write_analysis,
    units::SequenceId,
};

/// Progress of a run.
///
/// ```
/// # use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
/// # let folder = tempfile::tempdir()?;
/// # let (dataset, out) = (folder.path().join("manifest.csv"), folder.path().join("out"));
/// # let row = |subject: &str| -> std::io::Result<String> {
/// #     let frames = std::path::absolute(format!("fixtures/simulated/{subject}/005"))?.display().to_string();
/// #     Ok(format!("{subject},5,happiness,{frames},{frames}/correspondences.csv,3\n"))
/// # };
/// # let header = "subject,sequence,emotion,frames,correspondences,last_frame";
/// # std::fs::write(&dataset, format!("{header}\n{}{}", row("S001")?, row("S002")?))?;
/// # let options = grimace::pipeline::PipelineOptions { no_faces: true, ..Default::default() };
/// # let bench = grimace::pipeline::Workbench::new(None, options)?;
/// use grimace::pipeline::{Event, run};
///
/// // `dataset` has two sequences of happiness, three frames each.
/// // `event` is called from many threads.
/// let frames = AtomicUsize::new(0);
/// let count = |event| {
///     frames.fetch_add(usize::from(matches!(event, Event::Frame)), Ordering::Relaxed);
/// };
/// run(&dataset, &out, &bench, None, false, &AtomicBool::new(false), count)?;
/// assert_eq!(frames.load(Ordering::Relaxed), 6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub enum Event {
    /// The dataset was read.
    Started {
        /// Sequences to process.
        sequences: usize,
    },
    /// A recording is being cut into sequences, before any is tracked.
    Segmenting {
        /// The row of the manifest.
        id: SequenceId,
    },
    /// A frame was tracked.
    Frame,
    /// A sequence is done.
    Finished {
        /// Its id.
        id: SequenceId,
        /// Whether its frames were read from an unchanged track instead of tracked.
        reused: bool,
        /// Reason of its failure, if it failed.
        failure: Option<String>,
    },
    /// All sequences are done; statistics and files follow.
    Analyzing,
}

/// Result of a run.
///
/// ```
/// # use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
/// # let folder = tempfile::tempdir()?;
/// # let (dataset, out) = (folder.path().join("manifest.csv"), folder.path().join("out"));
/// # let row = |subject: &str| -> std::io::Result<String> {
/// #     let frames = std::path::absolute(format!("fixtures/simulated/{subject}/005"))?.display().to_string();
/// #     Ok(format!("{subject},5,happiness,{frames},{frames}/correspondences.csv,3\n"))
/// # };
/// # let header = "subject,sequence,emotion,frames,correspondences,last_frame";
/// # std::fs::write(&dataset, format!("{header}\n{}{}", row("S001")?, row("S002")?))?;
/// # let options = grimace::pipeline::PipelineOptions { no_faces: true, ..Default::default() };
/// # let bench = grimace::pipeline::Workbench::new(None, options)?;
/// use grimace::pipeline::run;
///
/// // `dataset` has two sequences of happiness, three frames each.
/// let go = || run(&dataset, &out, &bench, None, false, &AtomicBool::new(false), |_| ());
/// let first = go()?;
/// assert_eq!((first.sequences, first.tracked, first.failures.len()), (2, 2, 0));
/// // What is unchanged is not done again.
/// assert!(go()?.unchanged);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunSummary {
    /// Sequences in the dataset.
    pub sequences: usize,
    /// Tracked in this run.
    pub tracked: usize,
    /// Unchanged since an earlier run.
    pub reused: usize,
    /// Failed sequences, as in `failures.csv`.
    pub failures: Vec<Failure>,
    /// Sequences left out on purpose, with the reason.
    pub skipped: Vec<(String, String)>,
    /// Label and number of sequences of every representative.
    pub representatives: Vec<(String, usize)>,
    /// Warnings to the user.
    pub warnings: Vec<String>,
    /// Sequences that a person should look at and nobody has looked at yet.
    pub to_look_at: usize,
    /// Whether nothing had changed, so that nothing was written.
    pub unchanged: bool,
}

/// Why a run ended without results.
///
/// ```
/// use std::sync::atomic::AtomicBool;
///
/// use grimace::pipeline::{RunError, Workbench, run};
///
/// let out = tempfile::tempdir()?;
/// std::fs::write(out.path().join("thesis.tex"), "")?;
/// let bench = Workbench::new(None, Default::default())?;
/// let error = run("fixtures/simulated".as_ref(), out.path(), &bench, None, false, &AtomicBool::new(false), |_| ()).unwrap_err();
/// assert!(matches!(error, RunError::ForeignFolder { .. }));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The dataset cannot be opened.
    #[error(transparent)]
    Dataset(#[from] crate::dataset::DatasetError),
    /// The output folder has other files.
    #[error("{} is not empty and is not the output folder of a run; choose another folder, or give --force to write into it", path.display())]
    ForeignFolder {
        /// The folder.
        path: PathBuf,
    },
    /// The output folder holds a run of another dataset or with other options.
    #[error("{} holds a run with {what}; choose another folder, or give --force to replace its results ({tracks})", path.display())]
    OtherRun {
        /// The folder.
        path: PathBuf,
        /// What differs.
        what: String,
        /// What becomes of its tracks then.
        tracks: &'static str,
    },
    /// The record of earlier runs cannot be read.
    #[error(
        "{}: damaged ({source}); it lists the files that runs wrote into this folder: restore it, choose another folder, or give --force \
         to write into this one",
        path.display()
    )]
    DamagedRecord {
        /// The record.
        path: PathBuf,
        /// Why.
        source: serde_json::Error,
    },
    /// The record of earlier runs was written by a newer version.
    #[error(
        "{}: schema version {found}; this program reads {}: it comes from a newer version of grimace; use that version, choose another \
         folder, or give --force to write into this one", path.display(), super::SCHEMA_VERSION
    )]
    NewerRecord {
        /// The record.
        path: PathBuf,
        /// Its version.
        found: u64,
    },
    /// The file with the looks of a person at the tracks.
    #[error(transparent)]
    #[doc(hidden)]
    Looks(#[from] crate::track::LooksError),
    /// A folder for overlay pictures that holds frames.
    #[error(transparent)]
    #[doc(hidden)]
    OverlayAmongFrames(#[from] AmongFrames),
    /// A file that no run wrote is in the place of a result.
    #[error(
        "{}{more}: a result has this name, but no run wrote this file, or it was changed since. If another command is writing \
         into this folder now, wait for it; otherwise move the file away, choose another folder, or give --force to replace it",
        path.display()
    )]
    Foreign {
        /// The first such file.
        path: PathBuf,
        /// Text about the number of others.
        more: String,
    },
    /// Results are no longer there.
    #[error(
        "{}: {} removed while the run was writing into this folder; run the same command again to make what is missing",
        path.display(), count(*gone, "result was", "results were")
    )]
    #[doc(hidden)]
    Vanished {
        /// The first of them.
        path: PathBuf,
        /// How many.
        gone: usize,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The results of a sequence cannot be written.
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
        #[doc(hidden)]
        stage: Stage,
        /// Why.
        reason: String,
    },
    /// A part of a run is requested in a folder without a run.
    #[error("{}: no run was started in this folder; start one with `grimace run DATASET -o OUT --plan`", path.display())]
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
    #[doc(hidden)]
    Analysis(#[from] AnalysisError),
    /// The caller asked to stop.
    #[error("interrupted; finished sequences are kept; run the same command again to continue")]
    Interrupted,
}

/// Runs all stages over a dataset and writes the results into the folder `out`.
///
/// `event` is called from many threads. `stop` ends the run at the next frame and leaves complete files only.
///
/// ```
/// use std::sync::atomic::AtomicBool;
///
/// use grimace::pipeline::{PipelineOptions, Workbench, run};
///
/// let folder = tempfile::tempdir()?;
/// let (dataset, out) = (folder.path().join("manifest.csv"), folder.path().join("out"));
/// let row = |subject: &str| -> std::io::Result<String> {
///     let frames = std::path::absolute(format!("fixtures/simulated/{subject}/005"))?.display().to_string();
///     Ok(format!("{subject},5,happiness,{frames},{frames}/correspondences.csv,3\n"))
/// };
/// let header = "subject,sequence,emotion,frames,correspondences,last_frame";
/// std::fs::write(&dataset, format!("{header}\n{}{}", row("S001")?, row("S002")?))?;
/// let options = PipelineOptions { no_faces: true, ..Default::default() };
/// let bench = Workbench::new(None, options)?;
///
/// // `dataset` has two sequences of happiness, three frames each.
/// let summary = run(&dataset, &out, &bench, None, false, &AtomicBool::new(false), |_| ())?;
/// assert_eq!(summary.representatives, [("happiness".to_owned(), 2)]);
/// assert!(out.join("report.html").exists() && out.join("fap/happiness.fap").exists());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`RunError`]. Sequences that fail are not errors but rows of [`RunSummary::failures`].
pub fn run(
    dataset: &Path,
    out: &Path,
    bench: &Workbench,
    overlay: Option<&Path>,
    force: bool,
    stop: &AtomicBool,
    event: impl Fn(Event) + Sync,
) -> Result<RunSummary, RunError> {
    // Another run would replace files that this one counts on. A folder that is not there is created once the dataset is open.
    let claimed = if out.is_dir() { claim_folder(out)? } else { None };
    let (opened, name, earlier) = open(dataset, out, bench, force, (stop, &event))?;
    let _claimed = if claimed.is_some() { claimed } else { claim_folder(out)? };
    let mut looks = looks_in(out, true)?;
    let sequences = opened.sequences.len() + opened.failures.len();
    event(Event::Started { sequences });
    if let Some(folder) = overlay {
        let places = opened.sequences.iter().flat_map(|s| s.places().into_iter().map(|place| (&s.id, place)));
        OverlayFolder::check_apart(folder, places)?;
    }

    let chosen: Vec<&SequenceEntry> = opened.sequences.iter().collect();
    let mut planned = plan_all(&chosen, out, earlier.as_ref(), bench, stop);
    planned.extend(opened.failures.iter().map(Planned::damaged));
    planned.sort_by(|a, b| a.id.cmp(&b.id));

    if stop.load(Ordering::Relaxed) {
        return Err(RunError::Interrupted);
    }
    if let Some(earlier) = &earlier
        && !force
        && !earlier.sequences.is_empty()
        && !earlier.sequences.iter().any(|s| planned.iter().any(|p| p.id == s.id))
    {
        let what = format!("another dataset of the same name, `{name}`, that has no sequence in common with this one");
        return Err(RunError::OtherRun { path: out.to_owned(), what, tracks: TRACKS_KEPT });
    }
    let skipped: Vec<(String, String)> = opened.skipped.iter().map(|s| (s.id.to_string(), s.reason.clone())).collect();
    if let Some(earlier) = &earlier
        && overlay.is_none()
        && earlier.looks_blake3 == looks.blake3()
        && is_unchanged(earlier, &planned, &skipped, out)
    {
        // A run that was killed after writing its record leaves the journal.
        remove_journal(out);
        return Ok(summary_of(earlier));
    }
    let mut record = new_record(name, skipped, bench);
    (record.outputs, record.kept) = earlier.as_ref().map(|e| (e.outputs.clone(), e.kept.clone())).unwrap_or_default();
    let ledger = Ledger::open(out, earlier.as_ref(), force)?;
    let emotions: BTreeSet<&str> = opened.sequences.iter().map(|s| s.emotion.as_str()).collect();
    let names = opened.sequences.iter().flat_map(|s| sequence_files(&s.id)).chain(table_names().map(str::to_owned));
    let mut said = ledger.claim(
        &names.chain(emotions.iter().flat_map(|e| class_files(e).into_iter().chain(model_names(e)))).collect::<Vec<_>>(),
    )?;
    output::write_json_durably(&out.join(RUN_JSON), &record)?;

    let pictures = overlay.map(|folder| OverlayFolder::open(folder, force)).transpose()?;
    let worked = Worked { out, ledger: &ledger, bench, overlay: pictures.as_ref(), looks: &looks, stop };
    let results = process_all(&planned, &worked, &event)?;
    if let Some(pictures) = pictures {
        said.extend(pictures.close(|id| planned.iter().any(|p| p.id.to_string() == id))?);
    }
    said.extend(hidden_left(&planned, bench, overlay, out));
    let ids = planned.iter().map(|p| p.id.to_string()).collect();
    said.extend(unused_corrections(out, &ids).into_iter().chain(unused_looks(&looks, &ids)));
    event(Event::Analyzing);

    let pictures = picture_sources(&planned, bench);
    let Collected { models, failures, tracked, reused, mut outputs, notes } = collect(planned, results, out, &mut record)?;
    said.extend(notes);
    if models.is_empty() {
        write_failures(&out.join("failures.csv"), &failures)?;
        let first = failures.first();
        return Err(RunError::NothingLeft {
            sequences,
            stage: first.map_or(Stage::Dataset, |f| f.stage),
            reason: first.map(|f| f.reason.clone()).unwrap_or_default(),
        });
    }

    #[cfg(feature = "columnar")]
    if bench.options.columnar {
        let hash = super::write_columnar(&out.join("models.parquet"), &models).map_err(AnalysisError::from)?;
        outputs.insert("models.parquet".to_owned(), hash.to_hex().to_string());
    }
    let mut analysis = Analysis { tracked_here: true, ..analyze_with(models, failures, bench, Some(out))? };
    fill_in_new(out, &mut looks, &analysis.tracks)?;
    let flat = collect_skins(&mut analysis, &pictures, out, stop);
    analysis.warnings.extend(flat);
    if stop.load(Ordering::Relaxed) {
        return Err(RunError::Interrupted);
    }
    // Conflicts with claims were reported at the start.
    let claimed = ledger.claim(&analysis_files(&analysis, bench))?;
    said.extend(claimed.into_iter().filter(|one| !said.contains(one)).collect::<Vec<_>>());
    let mut written = BTreeMap::new();
    write_analysis(&analysis, out, &record.dataset, bench, |name, hash| {
        written.insert(name.to_owned(), hash);
        Ok(())
    })?;
    ledger.wrote(&written)?;
    outputs.extend(written);
    // All results must be on disk before the record names them.
    output::sync_written()?;
    check_there(&outputs, out)?;
    let (kept, changed) = ledger.remove_stale(&outputs);
    said.extend(changed);
    (record.outputs, record.kept) = (outputs, kept);
    record.representatives = analysis.counts();
    record.warnings = analysis.warnings.iter().cloned().chain(said).collect();
    record.to_look_at = analysis.tracks.iter().filter(|t| t.is_to_look_at()).count();
    record.looks_blake3 = looks.blake3();
    record.complete = true;
    output::write_json_durably(&out.join(RUN_JSON), &record)?;
    ledger.close();
    // The results now contain the separately computed parts. The folder is removed if it is empty.
    let _ = fs::remove_dir(out.join(PARTS_FOLDER));
    Ok(RunSummary { tracked, reused, unchanged: false, ..summary_of(&record) })
}

/// Checks that nobody removed the folder, or files in it, while they were written.
fn check_there(outputs: &BTreeMap<String, String>, out: &Path) -> Result<(), RunError> {
    let gone: Vec<&String> = outputs.keys().filter(|name| fs::symlink_metadata(out.join(name)).is_err()).collect();
    gone.first().map_or(Ok(()), |first| Err(RunError::Vanished { path: out.join(first), gone: gone.len() }))
}

/// Notes about overlay pictures of people who may not be shown, from earlier runs: this run has already removed its own.
fn hidden_left(planned: &[Planned<'_>], bench: &Workbench, overlay: Option<&Path>, out: &Path) -> Vec<String> {
    let hidden = planned.iter().filter(|p| !bench.options.shows(&p.metadata())).map(|p| p.id.to_string()).collect();
    let folders: BTreeSet<PathBuf> = [overlay.map(Path::to_owned), Some(out.join("overlays"))].into_iter().flatten().collect();
    let note = |folder: PathBuf| {
        let left = overlays_of(&folder, &hidden);
        let (pictures, folder) = (count(left, "picture", "pictures"), folder.display());
        (left > 0).then(|| {
            format!(
                "{folder}: {pictures} of people who may not be shown, from an earlier run; remove them if nobody may see them"
            )
        })
    };
    folders.into_iter().filter_map(note).collect()
}

/// Whether an earlier run had the same sequences, and all its files are unchanged.
fn is_unchanged(earlier: &RunJson, planned: &[Planned<'_>], skipped: &[(String, String)], out: &Path) -> bool {
    let same_sequence = |(record, item): (&SequenceRecord, &Planned<'_>)| {
        record.id == item.id
            && record.emotion == item.emotion
            && record.metadata == item.metadata()
            && record.corrections_blake3 == corrections_hash(out, &item.id)
            && match &item.source {
                Ok(driven) => driven.inputs_blake3().as_ref() == Some(&record.inputs_blake3),
                Err(failure) => record.failure.as_ref() == Some(&(failure.stage, failure.reason.clone())),
            }
    };
    // An earlier version may not have written all present tables.
    let numbers = COVARIATE_TABLES.iter().filter(|_| !earlier.options.covariates.is_empty());
    earlier.complete
        && ANALYSIS_TABLES.iter().chain(numbers).all(|table| earlier.outputs.contains_key(*table))
        && earlier.skipped == skipped
        && earlier.sequences.len() == planned.len()
        && earlier.sequences.iter().zip(planned).all(same_sequence)
        && earlier.outputs.par_iter().all(|(file, hash)| hash_of(&out.join(file)).as_ref() == Some(hash))
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
        to_look_at: record.to_look_at,
        unchanged: true,
    }
}
