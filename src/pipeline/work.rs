//! The sequences of a run: planned, worked on in parallel, collected in order.

use std::{
    collections::BTreeMap,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
};

use rayon::prelude::*;

use super::{
    AnalyzedModel, Event, Failure, RunError, RunJson, SequenceFailure, SequenceRecord, SequenceSource, Stage, Workbench,
    files::file_blake3,
    landmarks::LandmarkSource,
    model_file::write_model,
    overlay_pictures,
    sequence::{normalized, overlay_path, track_or_reuse},
    track_one,
};
use crate::{
    dataset::{CorrespondenceSource, SequenceEntry},
    output,
    overlay::png_bytes,
    statistics::SequenceModel,
    track::TrackQuality,
    units::SequenceId,
};

/// A sequence on its way through the run.
pub(super) struct Planned<'a> {
    pub id: SequenceId,
    pub emotion: String,
    /// What the manifest says; `None` for a row that is damaged.
    pub entry: Option<&'a SequenceEntry>,
    /// What drives it and the hash of its inputs, or why it cannot be worked on.
    pub source: Result<(Source, String), SequenceFailure>,
}

/// What drives a sequence.
pub(super) enum Source {
    Images(SequenceSource),
    Landmarks(LandmarkSource),
}

impl Planned<'_> {
    /// Further columns of the manifest.
    pub fn metadata(&self) -> BTreeMap<String, String> {
        self.entry.map(|e| e.metadata.clone()).unwrap_or_default()
    }
}

/// One processed sequence.
pub(super) struct Done {
    model: AnalyzedModel,
    reused: bool,
}

/// Finds what drives the sequences, in parallel.
pub(super) fn plan_all<'a>(chosen: &[&'a SequenceEntry], bench: &Workbench, stop: &AtomicBool) -> Vec<Planned<'a>> {
    let one = |entry: &&'a SequenceEntry| {
        let interrupted = || SequenceFailure { stage: Stage::Dataset, reason: "interrupted".to_owned(), fatal: true };
        let source = if stop.load(Ordering::Relaxed) { Err(interrupted()) } else { plan(entry, bench) };
        Planned { id: entry.id.clone(), emotion: entry.emotion.clone(), entry: Some(entry), source }
    };
    chosen.par_iter().map(one).collect()
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
    pub tracked: usize,
    pub reused: usize,
    /// BLAKE3 of the files written for sequences.
    pub outputs: BTreeMap<String, String>,
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
