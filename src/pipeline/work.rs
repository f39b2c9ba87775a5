//! Plans the sequences of a run, processes them in parallel, and collects the results in order.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
};

use rayon::prelude::*;

use super::{
    AnalyzedModel, Event, Failure, RunError, RunJson, SequenceFailure, SequenceRecord, SequenceSource, Stage, Workbench,
    corrected::{correct_frames, corrections_said},
    file_blake3,
    found::{FoundMarks, found_marks_and_remark},
    inputs::Inputs,
    landmarks::LandmarkSource,
    ledger::Ledger,
    measured::{measure, measured_files, normalized, write_measured},
    model_file::write_model,
    overlays::{OverlayFolder, overlay_pictures},
    same::pictures_of,
    sequence::{FOUND, LANDMARKS, Labels, RunTrack, track_or_reuse, track_recorded},
    showcase::{thumbnails, thumbnails_beside},
};
use crate::{
    dataset::{CorrespondenceSource, FailedEntry, FrameSource, LandmarkSelection, SequenceEntry},
    features::Course,
    overlay::png_bytes,
    sequence::read_first_frame,
    statistics::SequenceModel,
    track::{Corrections, Looks, TrackInfo, TrackQuality, TrackedFrame, content_of, corrections_path},
    units::SequenceId,
};

/// A planned sequence of a run.
pub(super) struct Planned<'a> {
    pub id: SequenceId,
    pub emotion: String,
    /// Its manifest entry; `None` for a damaged row.
    pub entry: Option<&'a SequenceEntry>,
    /// Its source, or the reason why it cannot be processed.
    pub source: Result<Driven, SequenceFailure>,
}

/// Source of a sequence, with information about it.
pub(super) struct Driven {
    pub source: Source,
    /// Hash of the track's inputs. It is computed in advance only if an existing track may have the same inputs; otherwise during decoding.
    inputs: Option<Inputs>,
    /// Note to the user about marks that were found.
    pub remark: Option<String>,
    /// Median expected error of found marks, in eye distances.
    pub found_error: Option<f64>,
}

impl Driven {
    /// Labels of the track.
    fn labels(&self) -> Labels<'_> {
        match &self.source {
            Source::Images(source) => source.labels(),
            Source::Landmarks(source) => source.labels(),
        }
    }

    /// Tracks it, and sets `inputs` to the hash of the data that were read.
    pub fn track(
        &self,
        inputs: &mut Option<String>,
        bench: &Workbench,
        tick: impl FnMut(u32) -> bool,
    ) -> Result<(Vec<TrackedFrame>, TrackInfo), SequenceFailure> {
        match &self.source {
            Source::Images(source) => {
                let (read, tracked) = track_recorded(source, bench, tick);
                *inputs = read.as_ref().ok().cloned();
                let (track, mut info) = tracked?;
                info.inputs_blake3 = read.map_err(SequenceFailure::at(Stage::Track))?;
                Ok((track.frames, info))
            }
            Source::Landmarks(source) => {
                let (read, tracked) = source.track(bench);
                *inputs = read;
                tracked
            }
        }
    }

    /// BLAKE3 of its inputs with the given frame rate, if they were read.
    pub fn inputs_blake3(&self) -> Option<String> {
        self.inputs.map(|inputs| inputs.with_rate(self.labels().fps))
    }
}

/// Settings for processing sequences.
pub(super) struct Worked<'a> {
    pub out: &'a Path,
    pub ledger: &'a Ledger,
    pub bench: &'a Workbench,
    pub overlay: Option<&'a OverlayFolder>,
    pub looks: &'a Looks,
    pub stop: &'a AtomicBool,
}

/// Names of the files of a sequence.
pub(super) fn sequence_files(id: &SequenceId) -> Vec<String> {
    let [csv, json, model] = track_and_model(id);
    [csv, json, model].into_iter().chain(measured_files(id)).collect()
}

fn track_and_model(id: &SequenceId) -> [String; 3] {
    [format!("tracks/{id}.csv"), format!("tracks/{id}.json"), format!("models/{id}.csv")]
}

/// What drives a sequence.
pub(super) enum Source {
    Images(SequenceSource),
    Landmarks(LandmarkSource),
}

impl Planned<'_> {
    /// The plan for a damaged row of the manifest.
    pub fn damaged(row: &FailedEntry) -> Self {
        Self {
            id: SequenceId { subject: row.subject.clone(), sequence: row.sequence.clone() },
            emotion: String::new(),
            entry: None,
            source: Err(SequenceFailure { stage: Stage::Dataset, reason: row.reason(), fatal: false }),
        }
    }

    /// Further columns of the manifest.
    pub fn metadata(&self) -> BTreeMap<String, String> {
        self.entry.map(|e| e.metadata.clone()).unwrap_or_default()
    }

    /// Its images, if images drive it.
    pub fn images(&self) -> Option<&SequenceSource> {
        match &self.source {
            Ok(Driven { source: Source::Images(source), .. }) => Some(source),
            _ => None,
        }
    }
}

/// One processed sequence.
pub(super) struct Done {
    model: AnalyzedModel,
    reused: bool,
    outputs: BTreeMap<String, String>,
    corrections_blake3: Option<String>,
    /// Notes to the user.
    notes: Vec<String>,
}

/// Result of a sequence, and the hash of its inputs; empty if unknown.
pub(super) struct Processed {
    inputs_blake3: String,
    result: Result<Done, SequenceFailure>,
}

/// Determines the sources of all sequences in parallel.
pub(super) fn plan_all<'a>(
    chosen: &[&'a SequenceEntry],
    out: &Path,
    earlier: Option<&RunJson>,
    bench: &Workbench,
    stop: &AtomicBool,
) -> Vec<Planned<'a>> {
    let failed = earlier.iter().flat_map(|e| &e.sequences).filter(|s| s.failure.is_some()).map(|s| &s.id);
    let failed: BTreeSet<&SequenceId> = failed.collect();
    let may_be_done = |id: &SequenceId| failed.contains(id) || out.join(format!("tracks/{id}.json")).exists();
    let one = |entry: &&'a SequenceEntry| {
        let source = if stop.load(Ordering::Relaxed) {
            Err(SequenceFailure::interrupted(Stage::Dataset))
        } else {
            plan(entry, may_be_done(&entry.id), bench)
        };
        Planned { id: entry.id.clone(), emotion: entry.emotion.clone(), entry: Some(entry), source }
    };
    chosen.par_iter().map(one).collect()
}

/// Processes all planned sequences in parallel.
pub(super) fn process_all(
    planned: &[Planned<'_>],
    worked: &Worked<'_>,
    event: &(impl Fn(Event) + Sync),
) -> Result<Vec<Processed>, RunError> {
    let stop = worked.stop;
    // Set by the first failure that is not a sequence's fault, such as a full disk, to stop the others.
    let abort = AtomicBool::new(false);
    let halt = || stop.load(Ordering::Relaxed) || abort.load(Ordering::Relaxed);
    let one = |item: &Planned<'_>| {
        let mut inputs = item.source.as_ref().ok().and_then(Driven::inputs_blake3);
        let result = process(item, worked, &mut inputs, &halt, event);
        if !halt() {
            let reused = result.as_ref().is_ok_and(|done| done.reused);
            let failure = result.as_ref().err().map(|f| f.reason.clone());
            event(Event::Finished { id: item.id.clone(), reused, failure });
        }
        if result.as_ref().is_err_and(|f| f.fatal) {
            abort.store(true, Ordering::Relaxed);
        }
        Processed { inputs_blake3: inputs.unwrap_or_default(), result }
    };
    let results = planned.par_iter().map(one).collect();
    if stop.load(Ordering::Relaxed) { Err(RunError::Interrupted) } else { Ok(results) }
}

/// Results of all sequences, in order.
#[derive(Default)]
pub(super) struct Collected {
    pub models: Vec<AnalyzedModel>,
    pub failures: Vec<Failure>,
    pub tracked: usize,
    pub reused: usize,
    /// BLAKE3 of the sequences' files, by name.
    pub outputs: BTreeMap<String, String>,
    /// Notes to the user.
    pub notes: Vec<String>,
}

/// BLAKE3 of a sequence's manual corrections, if any.
pub(super) fn corrections_hash(out: &Path, id: &SequenceId) -> Option<String> {
    file_blake3(&corrections_path(&out.join(format!("tracks/{id}.csv"))))
}

/// Sorts the results into models and failures, and enters them in the record.
pub(super) fn collect(
    planned: Vec<Planned<'_>>,
    results: Vec<Processed>,
    out: &Path,
    record: &mut RunJson,
) -> Result<Collected, RunError> {
    if let Some(at) = results.iter().position(|p| p.result.as_ref().is_err_and(SequenceFailure::ends_run))
        && let (Some(item), Some(Err(failure))) = (planned.get(at), results.get(at).map(|p| &p.result))
    {
        return Err(RunError::Write { id: item.id.clone(), reason: failure.reason.clone() });
    }
    let mut all = Collected::default();
    for (item, Processed { inputs_blake3, result }) in planned.into_iter().zip(results) {
        let (failure, corrections_blake3) = match result {
            Ok(done) => {
                *(if done.reused { &mut all.reused } else { &mut all.tracked }) += 1;
                all.outputs.extend(done.outputs);
                all.notes.extend(done.notes);
                all.models.push(done.model);
                (None, done.corrections_blake3)
            }
            Err(failure) if failure.fatal => return Err(RunError::Write { id: item.id, reason: failure.reason }),
            Err(SequenceFailure { stage, reason, .. }) => {
                let SequenceId { subject, sequence } = item.id.clone();
                all.failures.push(Failure { subject, sequence, stage, reason: reason.clone() });
                // Unreadable corrections may be repaired without any other change, so their hash is recorded, too.
                (Some((stage, reason)), corrections_hash(out, &item.id))
            }
        };
        let metadata = item.metadata();
        let (id, emotion) = (item.id, item.emotion);
        record.sequences.push(SequenceRecord { id, emotion, metadata, inputs_blake3, failure, corrections_blake3 });
    }
    Ok(all)
}

/// Determines the source of a sequence, with the hash of its inputs if `hashed`.
pub(super) fn plan(entry: &SequenceEntry, hashed: bool, bench: &Workbench) -> Result<Driven, SequenceFailure> {
    if let Some(path) = entry.driving_landmarks(bench.options.landmarks.prefer).map_err(SequenceFailure::at(Stage::Dataset))? {
        let source = LandmarkSource::new(entry, path, bench)?;
        let inputs = hashed.then(|| source.inputs(bench)).transpose()?;
        let missing = entry.missing_frames();
        let remark =
            missing.map(|frames| format!("the frames {} do not exist; the sequence uses its landmarks only", frames.display()));
        return Ok(Driven { source: Source::Landmarks(source), inputs, remark, found_error: None });
    }
    let frames = entry.frames().map_err(SequenceFailure::at(Stage::Dataset))?;
    let (FoundMarks { marks, remark, covered, expected_error: found_error }, marks_from) = marks_of(entry, &frames, bench)?;
    let source = SequenceSource {
        id: entry.id.clone(),
        emotion: entry.emotion.clone(),
        metadata: entry.metadata.clone(),
        frames,
        marks,
        marks_from: marks_from.to_owned(),
        covered,
        fps: entry.fps,
    };
    // Unreadable frames fail during decoding, in the first run as in later ones.
    let inputs = hashed.then(|| source.inputs(bench)).and_then(Result::ok);
    Ok(Driven { source: Source::Images(source), inputs, remark, found_error })
}

/// Returns the marks of a sequence (its own, from landmarks, or found in its neutral frame) and the notes on them.
fn marks_of(
    entry: &SequenceEntry,
    frames: &FrameSource,
    bench: &Workbench,
) -> Result<(FoundMarks, &'static str), SequenceFailure> {
    let marks_from = match entry.correspondence_source().map_err(SequenceFailure::at(Stage::Dataset))? {
        CorrespondenceSource::None if bench.options.marks == LandmarkSelection::Auto => {
            let frame = read_first_frame(frames).map_err(SequenceFailure::at(Stage::Track))?;
            let named = |failure: SequenceFailure| match frames.files().first() {
                Some(file) => SequenceFailure { reason: format!("{}: {}", file.display(), failure.reason), ..failure },
                None => failure,
            };
            let found = found_marks_and_remark(&frame, None, bench);
            let found = found.map_err(|error| named(SequenceFailure::at(Stage::Fit)(error)))?;
            return Ok((found, FOUND));
        }
        CorrespondenceSource::Landmarks(_) => LANDMARKS,
        CorrespondenceSource::File(_) | CorrespondenceSource::None => "file",
    };
    let count = bench.wireframe.node_count();
    let marks = entry
        .correspondences(frames.neutral_number(), &bench.tables, count, &bench.options.marks)
        .map_err(SequenceFailure::at(Stage::Dataset))?;
    Ok((FoundMarks { marks, ..FoundMarks::default() }, marks_from))
}

/// Processes one sequence, and sets `inputs` to the hash of the data that were read.
fn process(
    item: &Planned<'_>,
    worked: &Worked<'_>,
    inputs: &mut Option<String>,
    halt: &(impl Fn() -> bool + Sync),
    event: &(impl Fn(Event) + Sync),
) -> Result<Done, SequenceFailure> {
    let &Worked { out, ledger, bench, overlay, looks, .. } = worked;
    let driven = item.source.as_ref().map_err(Clone::clone)?;
    let Driven { source, inputs: known, remark, .. } = driven;
    if halt() {
        return Err(SequenceFailure::interrupted(Stage::Track));
    }
    let id = &item.id;
    let [csv_name, json_name, model_name] = track_and_model(id);
    let tick = |_| {
        event(Event::Frame);
        !halt()
    };
    let make = || driven.track(inputs, bench, tick);
    let correct = |frames: &[TrackedFrame], corrections: &Corrections, inputs: &str| match source {
        Source::Images(source) => source.track_corrected(frames, corrections, inputs, bench),
        Source::Landmarks(_) => correct_frames(frames, corrections, bench),
    };
    let own_clock = |inputs: &Inputs| match source {
        Source::Images(source) => source.own_clock(inputs, bench, || !halt()),
        Source::Landmarks(source) => source.own_clock(inputs, bench),
    };
    let RunTrack { frames, info, reused, hashes } =
        track_or_reuse(&driven.labels(), known.as_ref(), &out.join(&csv_name), bench, make, correct, own_clock)
            .map_err(|failure| name_marks(failure, item.entry))?;
    let normalized = normalized(&frames, &info.mark_places(), info.times.as_deref(), bench)?;
    if let (Some(folder), Source::Images(source)) = (overlay, source)
        && bench.options.shows(&source.metadata)
    {
        let last = frames.len() - 1;
        overlay_pictures(
            source,
            (&frames, normalized.fit.as_ref().map_or(&[], |fit| &fit.poses)),
            bench,
            |index| index == 0 || index == last,
            |number, picture| {
                let bytes = png_bytes(&picture).map_err(SequenceFailure::at(Stage::Write))?;
                folder.write(&source.id, number, &bytes).map_err(SequenceFailure::at(Stage::Write))
            },
        )?;
    }
    let mut summary = info.summary.clone();
    normalized.judge(&mut summary, &frames, bench);
    let content = content_of(Some(&info), &hashes.csv);
    let mut outputs = BTreeMap::from([(csv_name, hashes.csv), (json_name, hashes.json)]);
    let clock = info.clock_of_numbers(frames.iter().map(|frame| frame.number));
    let features = measure(&normalized, &frames, &clock, bench)?;
    if let Some(features) = &features {
        outputs.extend(write_measured(features, &info, out, bench)?);
    }
    let model = normalized.model;
    let model_hash = write_model(&out.join(&model_name), &model).map_err(SequenceFailure::at(Stage::Write))?;
    outputs.insert(model_name, model_hash.to_hex().to_string());
    ledger.wrote(&outputs).map_err(SequenceFailure::at(Stage::Write))?;
    let mut quality = TrackQuality::new(id.clone(), item.emotion.clone(), summary, &frames, &bench.wireframe);
    quality.look = looks.of(id, &content);
    quality.content = content;
    quality.pictures = match source {
        Source::Images(source) if bench.options.shows(&source.metadata) => thumbnails(&source.frames, &frames, bench)?,
        Source::Images(_) => None,
        Source::Landmarks(source) => source.shown_images(bench).and_then(|images| thumbnails_beside(&images, &frames, bench)),
    };
    let model = SequenceModel { id: id.clone(), model };
    let course = features.as_deref().and_then(Course::of);
    let model = AnalyzedModel {
        model,
        emotion: item.emotion.clone(),
        metadata: item.metadata(),
        quality: Some(quality),
        course,
        pictures: pictures_of(&info),
        marks_from: Some(info.marks_from.clone()),
    };
    let path = format!("corrections/{id}.csv");
    let of_corrections = info.corrections.iter().flat_map(|c| corrections_said(c, &path));
    let notes = remark.iter().chain(&info.notes).map(|said| format!("{id}: {said}")).chain(of_corrections).collect();
    Ok(Done { model, reused, outputs, corrections_blake3: info.corrections.map(|c| c.blake3), notes })
}

/// Prepends the file of the marks to a failure of the fit.
pub(super) fn name_marks(failure: SequenceFailure, entry: Option<&SequenceEntry>) -> SequenceFailure {
    match entry.map(SequenceEntry::correspondence_source) {
        Some(Ok(CorrespondenceSource::File(path) | CorrespondenceSource::Landmarks(path))) if failure.stage == Stage::Fit => {
            SequenceFailure { reason: format!("{}: {}", path.display(), failure.reason), ..failure }
        }
        _ => failure,
    }
}
