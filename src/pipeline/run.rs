//! `run`: every stage over a dataset, parallel over sequences, resumable.
//!
//! A run into a folder that holds an earlier run of the same dataset with the same options brings it up to date: a sequence whose
//! inputs are unchanged, by content, is not tracked again, and when nothing at all changed nothing is written. One bad sequence costs
//! that sequence. Results are collected in the order of the sequences, so that the number of threads changes no byte.

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
};

use rayon::prelude::*;

use super::{
    Analysis, AnalyzedModel, Failure, MADE_BY, RunJson, SCHEMA_VERSION, SequenceFailure, SequenceRecord, SequenceSource, Stage,
    Workbench,
    analysis::{AnalysisError, analyze_with, write_failures},
    files::{file_blake3, run_units},
    landmarks::LandmarkSource,
    parts::PARTS_FOLDER,
    sequence::{normalized, overlay_path, track_or_reuse},
};
use crate::{
    dataset::{CorrespondenceSource, Dataset, MANIFEST_NAME, SequenceEntry},
    output::{self, OutputError},
    overlay::png_bytes,
    pipeline::{overlay_pictures, track_one, write_analysis, write_columnar, write_model},
    statistics::{SequenceModel, check_columns},
    track::TrackQuality,
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
    /// A file can not be written.
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

/// A sequence on its way through the run.
pub(super) struct Planned<'a> {
    id: SequenceId,
    emotion: String,
    entry: Option<&'a SequenceEntry>,
    source: Result<(Source, String), SequenceFailure>,
}

/// What drives a sequence.
enum Source {
    Images(SequenceSource),
    Landmarks(LandmarkSource),
}

impl Planned<'_> {
    /// Further columns of the manifest.
    fn metadata(&self) -> BTreeMap<String, String> {
        self.entry.map(|e| e.metadata.clone()).unwrap_or_default()
    }
}

/// One processed sequence.
pub(super) struct Done {
    model: AnalyzedModel,
    reused: bool,
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
        source: Err(SequenceFailure { stage: Stage::Dataset, reason: failure.error.to_string(), fatal: false }),
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

/// Opens the dataset and makes sure that the output may be written to.
pub(super) fn open(
    dataset: &Path,
    out: &Path,
    bench: &Workbench,
    force: bool,
) -> Result<(Dataset, String, Option<RunJson>), RunError> {
    let opened = Dataset::open(dataset)?;
    // Found out now and not after hours of tracking.
    check_columns(&bench.options.by, opened.sequences.iter().map(|s| &s.metadata)).map_err(AnalysisError::from)?;
    let name = dataset_name(dataset);
    let earlier = check_output(out, &name, bench, force)?;
    if opened.sequences.is_empty() && opened.failures.is_empty() {
        return Err(RunError::Empty { path: dataset.to_owned() });
    }
    Ok((opened, name, earlier))
}

pub(super) fn plan_all<'a>(chosen: &[&'a SequenceEntry], bench: &Workbench, stop: &AtomicBool) -> Vec<Planned<'a>> {
    let one = |entry: &&'a SequenceEntry| {
        let interrupted = || SequenceFailure { stage: Stage::Dataset, reason: "interrupted".to_owned(), fatal: true };
        let source = if stop.load(Ordering::Relaxed) { Err(interrupted()) } else { plan(entry, bench) };
        Planned { id: entry.id.clone(), emotion: entry.emotion.clone(), entry: Some(entry), source }
    };
    chosen.par_iter().map(one).collect()
}

/// The record of a run that has just begun.
pub(super) fn new_record(dataset: String, skipped: Vec<(String, String)>, bench: &Workbench) -> RunJson {
    RunJson {
        schema_version: SCHEMA_VERSION,
        made_by: MADE_BY.to_owned(),
        dataset,
        units: run_units(),
        options: bench.options.clone(),
        wireframe_blake3: bench.wireframe_blake3.clone(),
        complete: false,
        sequences: Vec::new(),
        skipped,
        outputs: BTreeMap::new(),
        representatives: Vec::new(),
        warnings: Vec::new(),
    }
}

/// Works on all planned sequences in parallel.
pub(super) fn process_all(
    planned: &[Planned<'_>],
    out: &Path,
    bench: &Workbench,
    overlay: Option<&Path>,
    stop: &AtomicBool,
    event: &(impl Fn(Event) + Sync),
) -> Result<Vec<Result<Done, SequenceFailure>>, RunError> {
    // Set by the first failure that is not a sequence's own fault, such as a full disk: the others need not try.
    let abort = AtomicBool::new(false);
    let halt = || stop.load(Ordering::Relaxed) || abort.load(Ordering::Relaxed);
    let one = |item: &Planned<'_>| {
        let result = process(item, out, bench, overlay, &halt, event);
        if !halt() {
            let reused = result.as_ref().is_ok_and(|done| done.reused);
            let failure = result.as_ref().err().map(|f| f.reason.clone());
            event(Event::Finished { id: item.id.clone(), reused, failure });
        }
        if result.as_ref().is_err_and(|f| f.fatal) {
            abort.store(true, Ordering::Relaxed);
        }
        result
    };
    let results = planned.par_iter().map(one).collect();
    if stop.load(Ordering::Relaxed) { Err(RunError::Interrupted) } else { Ok(results) }
}

/// What the sequences gave, in order.
#[derive(Default)]
pub(super) struct Collected {
    pub models: Vec<AnalyzedModel>,
    pub failures: Vec<Failure>,
    tracked: usize,
    reused: usize,
    /// BLAKE3 of the files written for sequences.
    outputs: BTreeMap<String, String>,
}

/// Sorts the results of the sequences into models and failures and enters them in the record.
pub(super) fn collect(
    planned: Vec<Planned<'_>>,
    results: Vec<Result<Done, SequenceFailure>>,
    out: &Path,
    record: &mut RunJson,
) -> Result<Collected, RunError> {
    let is_cause = |r: &&Result<Done, SequenceFailure>| r.as_ref().is_err_and(|f| f.fatal && f.stage == Stage::Write);
    if let Some(at) = results.iter().position(|r| is_cause(&r))
        && let (Some(item), Some(Err(failure))) = (planned.get(at), results.get(at))
    {
        return Err(RunError::Write { id: item.id.clone(), reason: failure.reason.clone() });
    }
    let mut all = Collected::default();
    for (item, result) in planned.into_iter().zip(results) {
        let inputs_blake3 = item.source.as_ref().map(|(_, hash)| hash.clone()).unwrap_or_default();
        let failure = match result {
            Ok(done) => {
                *(if done.reused { &mut all.reused } else { &mut all.tracked }) += 1;
                let id = &item.id;
                for file in [format!("tracks/{id}.csv"), format!("tracks/{id}.json"), format!("models/{id}.csv")] {
                    if let Some(hash) = file_blake3(&out.join(&file)) {
                        all.outputs.insert(file, hash);
                    }
                }
                all.models.push(done.model);
                None
            }
            Err(failure) if failure.fatal => return Err(RunError::Write { id: item.id, reason: failure.reason }),
            Err(SequenceFailure { stage, reason, .. }) => {
                let SequenceId { subject, sequence } = item.id.clone();
                all.failures.push(Failure { subject, sequence, stage, reason: reason.clone() });
                Some((stage, reason))
            }
        };
        let metadata = item.metadata();
        record.sequences.push(SequenceRecord { id: item.id, emotion: item.emotion, metadata, inputs_blake3, failure });
    }
    Ok(all)
}

/// Folders of results, and the endings of the files in them.
const RESULT_FOLDERS: [(&str, &[&str]); 4] =
    [("tracks", &[".csv", ".json"]), ("models", &[".csv"]), ("representatives", &[".csv", ".json"]), ("fap", &[".fap"])];

/// Name of the provenance file.
pub(super) const RUN_JSON: &str = "run.json";

/// Removes files of earlier runs, whole or interrupted, that this one does not make.
fn remove_stale(out: &Path, outputs: &BTreeMap<String, String>) {
    for (folder, endings) in RESULT_FOLDERS {
        let Ok(entries) = fs::read_dir(out.join(folder)) else { continue };
        for entry in entries.flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let ours = endings.iter().any(|ending| name.ends_with(ending));
            if ours && !outputs.contains_key(&format!("{folder}/{name}")) {
                // Gone already, or not to be removed: either way nothing more can be done.
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

/// Source and inputs' hash of a sequence.
fn plan(entry: &SequenceEntry, bench: &Workbench) -> Result<(Source, String), SequenceFailure> {
    if let Some(path) = entry.driving_landmarks(bench.options.landmarks.prefer).map_err(SequenceFailure::at(Stage::Dataset))? {
        return LandmarkSource::new(entry, path, bench).map(|(source, hash)| (Source::Landmarks(source), hash));
    }
    let frames = entry.frames().map_err(SequenceFailure::at(Stage::Dataset))?;
    let marks_from = match entry.correspondence_source().map_err(SequenceFailure::at(Stage::Dataset))? {
        CorrespondenceSource::Landmarks(_) => "landmarks",
        CorrespondenceSource::File(_) | CorrespondenceSource::None => "file",
    };
    let count = bench.wireframe.node_count();
    let marks = entry
        .correspondences(frames.neutral_number(), &bench.tables, count, &bench.options.marks)
        .map_err(SequenceFailure::at(Stage::Dataset))?;
    let source = SequenceSource {
        id: entry.id.clone(),
        emotion: entry.emotion.clone(),
        metadata: entry.metadata.clone(),
        frames,
        marks,
        marks_from: marks_from.to_owned(),
        fps: entry.fps,
    };
    let hash = source.inputs_blake3(bench)?;
    Ok((Source::Images(source), hash))
}

fn process(
    item: &Planned<'_>,
    out: &Path,
    bench: &Workbench,
    overlay: Option<&Path>,
    halt: &(impl Fn() -> bool + Sync),
    event: &(impl Fn(Event) + Sync),
) -> Result<Done, SequenceFailure> {
    let (source, hash) = item.source.as_ref().map_err(Clone::clone)?;
    if halt() {
        return Err(SequenceFailure { stage: Stage::Track, reason: "interrupted".to_owned(), fatal: true });
    }
    let id = &item.id;
    let csv_path = out.join("tracks").join(format!("{id}.csv"));
    let tick = |_| {
        event(Event::Frame);
        !halt()
    };
    let labels = match source {
        Source::Images(source) => source.labels(),
        Source::Landmarks(source) => source.labels(),
    };
    let make = || match source {
        Source::Images(source) => track_one(source, bench, tick).map(|(track, info)| (track.frames, info)),
        Source::Landmarks(source) => source.track(bench),
    };
    let (frames, summary, reused) =
        track_or_reuse(&labels, hash, &csv_path, make).map_err(|failure| name_marks(failure, item.entry))?;
    if let (Some(folder), Source::Images(source)) = (overlay, source) {
        let last = frames.len() - 1;
        overlay_pictures(
            source,
            &frames,
            bench,
            |index| index == 0 || index == last,
            |number, picture| {
                let bytes = png_bytes(&picture).map_err(SequenceFailure::at(Stage::Write))?;
                output::write_bytes(&overlay_path(folder, &source.id, number), &bytes).map_err(SequenceFailure::at(Stage::Write))
            },
        )?;
    }
    let model = normalized(&frames, bench)?;
    let model_path = out.join("models").join(format!("{id}.csv"));
    write_model(&model_path, &model).map_err(SequenceFailure::at(Stage::Write))?;
    let quality = TrackQuality { id: id.clone(), emotion: item.emotion.clone(), summary };
    let model = SequenceModel { id: id.clone(), model };
    let metadata = item.metadata();
    Ok(Done { model: AnalyzedModel { model, emotion: item.emotion.clone(), metadata, quality: Some(quality) }, reused })
}

/// Puts the file that the marks came from in front of a failure of the fit.
fn name_marks(failure: SequenceFailure, entry: Option<&SequenceEntry>) -> SequenceFailure {
    match entry.map(SequenceEntry::correspondence_source) {
        Some(Ok(CorrespondenceSource::File(path) | CorrespondenceSource::Landmarks(path))) if failure.stage == Stage::Fit => {
            SequenceFailure { reason: format!("{}: {}", path.display(), failure.reason), ..failure }
        }
        _ => failure,
    }
}

/// The name under which a dataset is recorded: its folder's, and its manifest's where that has another name than usual.
fn dataset_name(path: &Path) -> String {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let name = |path: &Path| path.file_name().map_or_else(|| "dataset".to_owned(), |n| n.to_string_lossy().into_owned());
    if !full.is_file() {
        return name(&full);
    }
    let folder = full.parent().map_or_else(|| "dataset".to_owned(), name);
    if name(&full) == MANIFEST_NAME { folder } else { format!("{folder}/{}", name(&full)) }
}

/// Makes sure that `out` may be written to; the earlier run found there, if any.
fn check_output(out: &Path, dataset: &str, bench: &Workbench, force: bool) -> Result<Option<RunJson>, RunError> {
    let error = |source: io::Error| OutputError { path: out.to_owned(), source };
    let mut entries = match fs::read_dir(out) {
        Ok(entries) => entries,
        Err(e) if e.kind() == io::ErrorKind::NotFound => {
            fs::create_dir_all(out).map_err(error)?;
            return Ok(None);
        }
        Err(e) => return Err(error(e).into()),
    };
    let earlier: Option<RunJson> = fs::read(out.join(RUN_JSON)).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
    let Some(earlier) = earlier else {
        let empty = entries.next().is_none();
        return if empty || force { Ok(None) } else { Err(RunError::ForeignFolder { path: out.to_owned() }) };
    };
    let what = if earlier.dataset != dataset {
        Some(format!("another dataset, `{}`", earlier.dataset))
    } else if earlier.options != bench.options {
        Some(format!("other options ({})", differing_options(&earlier, bench)))
    } else if earlier.wireframe_blake3 != bench.wireframe_blake3 {
        Some("another wireframe".to_owned())
    } else if earlier.made_by != MADE_BY {
        Some(format!("another version, {}", earlier.made_by))
    } else {
        None
    };
    match what {
        Some(what) if !force => Err(RunError::OtherRun { path: out.to_owned(), what }),
        Some(_) => Ok(Some(RunJson { complete: false, ..earlier })),
        None => Ok(Some(earlier)),
    }
}

/// Names of the option groups in which two runs differ.
fn differing_options(earlier: &RunJson, bench: &Workbench) -> String {
    let value = |options| serde_json::to_value(options).unwrap_or_default();
    let (a, b) = (value(&earlier.options), value(&bench.options));
    let empty = serde_json::Map::new();
    let (a, b) = (a.as_object().unwrap_or(&empty).clone(), b.as_object().unwrap_or(&empty).clone());
    let differing = b.iter().filter(|(key, value)| a.get(*key) != Some(value));
    differing
        .map(|(key, value)| format!("{key}: {} there, {value} now", a.get(key).unwrap_or(&serde_json::Value::Null)))
        .collect::<Vec<_>>()
        .join("; ")
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
