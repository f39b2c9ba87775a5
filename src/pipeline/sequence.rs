//! Processes one sequence: from its frames to its track and normalized model.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use super::{
    MADE_BY, Stage, Workbench,
    corrected::{apply, saved_or_carried_over},
    found::covered_said,
    inputs::{Inputs, Timed},
    neutral::NeutralFit,
};
use crate::{
    companion::CompanionError,
    dataset::{FrameSource, unread_beside},
    fit::{Correspondence, MarkKind, validate_correspondences},
    locate::FacePart,
    output,
    sequence::{Clock, Frame, SequenceError, SequenceReader, content_blake3},
    text::message,
    track::{
        Corrections, TRACK_SCHEMA, Track, TrackError, TrackFileError, TrackHashes, TrackInfo, TrackOptions, TrackedFrame,
        covered_at_apex_said, mouth_back_said, neutral_first, parse_track, parse_track_info, summarize, track_csv,
        track_sequence, track_units, write_hashed_track,
    },
    units::SequenceId,
};

/// Value of `marks_from` for marks that were found in the picture.
pub(super) const FOUND: &str = "found";
/// The same for landmarks.
pub(super) const LANDMARKS: &str = "landmarks";

/// Why a sequence cannot be processed, and the stage.
#[derive(Clone, Debug)]
pub struct SequenceFailure {
    /// The stage.
    pub stage: Stage,
    /// Full error message.
    pub reason: String,
    /// Whether the cause is not the sequence: interrupted run, full disk, or a read failure of the machine.
    pub fatal: bool,
}

/// Start of the reason for failures of the machine.
const MACHINE: &str = "the computer failed, not the sequence";
/// Reason of sequences that were being processed when the run was asked to stop.
const INTERRUPTED: &str = "interrupted";

/// Whether a read error is caused by the machine and not by the file: too many open files, no memory, a failing disk or server.
fn is_machines_fault(error: &(dyn std::error::Error + 'static)) -> bool {
    use std::io::{Error, ErrorKind};
    // Error numbers of Linux and the BSDs: EIO 5, ENFILE 23, EMFILE 24. Other errors have an `ErrorKind`.
    let of = |e: &Error| {
        matches!(e.kind(), ErrorKind::OutOfMemory | ErrorKind::StaleNetworkFileHandle | ErrorKind::TimedOut)
            || (cfg!(unix) && matches!(e.raw_os_error(), Some(5 | 23 | 24)))
    };
    error.downcast_ref::<Error>().is_some_and(of)
}

/// Whether a part of the program is missing. Its message says how to install it.
fn is_incomplete(error: &(dyn std::error::Error + 'static)) -> bool {
    let unusable = |e: &CompanionError| {
        matches!(e, CompanionError::NotInstalled | CompanionError::CannotStart(_) | CompanionError::OtherVersion { .. })
    };
    error.downcast_ref::<CompanionError>().is_some_and(unusable)
}

impl SequenceFailure {
    /// Converts an error with its causes into a failure of a stage.
    pub fn at<E: std::error::Error + 'static>(stage: Stage) -> impl Fn(E) -> Self {
        move |error| {
            let mut reason = error.to_string();
            let (mut machine, mut incomplete) = (is_machines_fault(&error), is_incomplete(&error));
            let mut cause = error.source();
            while let Some(inner) = cause {
                machine |= is_machines_fault(inner);
                incomplete |= is_incomplete(inner);
                // Errors of this crate already contain the text of their cause.
                let text = inner.to_string();
                if !reason.contains(&text) {
                    reason = format!("{reason}: {text}");
                }
                cause = inner.source();
            }
            let mut reason = message(&reason).into_owned();
            if machine {
                reason = format!("{MACHINE}: {reason}; run again, or remove the sequence from the dataset");
            }
            Self { stage, reason, fatal: machine || incomplete || stage == Stage::Write }
        }
    }

    /// Failure because the run was asked to stop.
    pub(super) fn interrupted(stage: Stage) -> Self {
        Self { stage, reason: INTERRUPTED.to_owned(), fatal: true }
    }

    /// Whether this failure is the reason why the run ends, rather than its consequence.
    pub(super) fn ends_run(&self) -> bool {
        self.fatal && self.reason != INTERRUPTED
    }

    /// Failure because a file changed after processing of its sequence began.
    pub(super) fn changed(path: &Path) -> Self {
        let reason = format!("{}: the file changed while it was read; run again when it is complete", path.display());
        Self { stage: Stage::Dataset, reason, fatal: false }
    }
}

/// The inputs of one track.
#[derive(Clone, Debug)]
pub struct SequenceSource {
    /// Subject and sequence.
    pub id: SequenceId,
    /// Emotion label.
    pub emotion: String,
    /// Further columns of the manifest.
    pub metadata: BTreeMap<String, String>,
    /// The frames.
    pub frames: FrameSource,
    /// Marks on the neutral frame.
    pub marks: Vec<Correspondence>,
    /// Source of the marks: `file`, `landmarks`, `command line`, `found`.
    pub marks_from: String,
    /// Covered parts of a face whose marks were found.
    pub covered: Vec<FacePart>,
    /// Frames per second, if given. Frames of a video have their own times.
    pub fps: Option<f64>,
}

impl SequenceSource {
    /// Labels of the track.
    pub(super) fn labels(&self) -> Labels<'_> {
        Labels { emotion: &self.emotion, metadata: &self.metadata, marks_from: &self.marks_from, fps: self.fps }
    }

    /// Hash of everything the track depends on: program version, options, wireframe, marks, and name and content of every frame. Emotion
    /// and further columns are excluded, so that a new label does not cause new tracking.
    ///
    /// # Errors
    /// [`SequenceFailure`] when a frame cannot be read.
    pub(super) fn inputs(&self, bench: &Workbench) -> Result<Inputs, SequenceFailure> {
        let content = content_blake3(&self.frames).map_err(SequenceFailure::at(Stage::Dataset))?;
        Ok(self.inputs_with(content, bench))
    }

    /// Fits the wireframe to the marks in the neutral frame, and compares given marks with the face in it.
    ///
    /// # Errors
    /// [`SequenceFailure`] of [`Stage::Fit`].
    pub(super) fn fit_neutral(&self, first: &Frame, bench: &Workbench) -> Result<NeutralFit, SequenceFailure> {
        let size = first.size();
        validate_correspondences(&self.marks, size.width, size.height).map_err(SequenceFailure::at(Stage::Fit))?;
        let fit = if self.marks_from == FOUND {
            bench.fit(&self.marks).map(|fitted| NeutralFit { fitted, beside: Vec::new() })
        } else {
            bench.fit_in(first.image(), &self.marks)
        };
        fit.map_err(SequenceFailure::at(Stage::Fit))
    }

    /// BLAKE3 of the inputs including the given frame rate. `content` is the hash of the names and bytes of the frames.
    pub(super) fn inputs_blake3(&self, content: blake3::Hash, bench: &Workbench) -> String {
        self.inputs_with(content, bench).with_rate(self.fps)
    }

    /// Reads the frames' own times again from a video. `inputs` identifies the frames.
    ///
    /// # Errors
    /// [`SequenceFailure`] when the frames cannot be read, have changed, or `goes_on` returns false.
    pub(super) fn own_clock(
        &self,
        inputs: &Inputs,
        bench: &Workbench,
        goes_on: impl Fn() -> bool,
    ) -> Result<Clock, SequenceFailure> {
        let FrameSource::Video { path, .. } = &self.frames else { return Ok(Clock::default()) };
        let mut reader = SequenceReader::open(&self.frames).map_err(SequenceFailure::at(Stage::Track))?;
        for frame in reader.by_ref() {
            frame.map_err(SequenceFailure::at(Stage::Track))?;
            if !goes_on() {
                return Err(SequenceFailure::interrupted(Stage::Track));
            }
        }
        let clock = reader.clock();
        let content = reader.into_content_blake3().map_err(SequenceFailure::at(Stage::Track))?;
        if self.inputs_with(content, bench) == *inputs { Ok(clock) } else { Err(SequenceFailure::changed(path)) }
    }

    /// As [`SequenceSource::inputs`], for frames whose names and bytes have the hash `content`.
    fn inputs_with(&self, content: blake3::Hash, bench: &Workbench) -> Inputs {
        let mut hasher = blake3::Hasher::new();
        let mut part = |bytes: &[u8]| {
            hasher.update(&(bytes.len() as u64).to_le_bytes());
            hasher.update(bytes);
        };
        part(MADE_BY.as_bytes());
        let options = &bench.options;
        // The pose option also affects the fit, which allows for a turned head in the neutral frame.
        let depends = (TRACK_SCHEMA, &options.fit, &options.track, options.normalize.pose, &bench.wireframe_blake3);
        let options = serde_json::to_vec(&depends);
        part(&options.unwrap_or_default());
        part(self.id.to_string().as_bytes());
        for mark in &self.marks {
            part(&mark.node.0.to_le_bytes());
            part(&[u8::from(mark.kind == MarkKind::Hard)]);
            part(&mark.position.x.to_le_bytes());
            part(&mark.position.y.to_le_bytes());
            part(&mark.expected_error.unwrap_or_default().to_le_bytes());
        }
        if let FrameSource::Video { first, last, .. } = &self.frames {
            part(format!("{first:?} {last:?}").as_bytes());
        }
        // Of listed pictures, the numbers and the folders are not in the content.
        if let (FrameSource::Images(files), true) = (&self.frames, self.frames.is_numbered_apart()) {
            for (file, name) in files.iter().zip(self.frames.names()) {
                part(&file.number.to_le_bytes());
                part(name.as_bytes());
            }
        }
        if bench.options.unchecked_marks {
            part(b"unchecked marks");
        }
        part(content.as_bytes());
        Inputs::new(hasher.finalize())
    }
}

pub(super) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Fits and tracks one sequence. The hash of its inputs is computed from the bytes that were decoded.
///
/// # Errors
/// [`SequenceFailure`] with the stage.
pub fn track_one(
    source: &SequenceSource,
    bench: &Workbench,
    tick: impl FnMut(u32) -> bool,
) -> Result<(Track, TrackInfo), SequenceFailure> {
    let (inputs_blake3, tracked) = track_recorded(source, bench, tick);
    let (track, mut info) = tracked?;
    info.inputs_blake3 = inputs_blake3.map_err(SequenceFailure::at(Stage::Track))?;
    Ok((track, info))
}

/// As [`track_one`]. Also returns the hash of the inputs for a sequence that fails.
pub(super) fn track_recorded(
    source: &SequenceSource,
    bench: &Workbench,
    tick: impl FnMut(u32) -> bool,
) -> (Result<String, SequenceError>, Result<(Track, TrackInfo), SequenceFailure>) {
    let mut reader = match SequenceReader::open(&source.frames) {
        Ok(reader) => reader,
        Err(error) => {
            let inputs = content_blake3(&source.frames).map(|content| source.inputs_blake3(content, bench));
            return (inputs, Err(SequenceFailure::at(Stage::Track)(error)));
        }
    };
    let mut tracked = track_frames(source, bench, &mut reader, tick);
    if let Ok((_, info)) = &mut tracked {
        // Own times are known only after reading; a given rate has precedence.
        let clock = source.fps.map_or_else(|| reader.clock(), |fps| Clock::even(Some(fps)));
        (info.fps, info.times) = (clock.fps, clock.times);
        info.notes.extend(reader.remark().into_iter().chain(unread_beside(&source.frames)));
    }
    let content = reader.into_content_blake3();
    if let (Ok((_, info)), Ok(content)) = (&mut tracked, &content) {
        info.frames_blake3 = Some(content.to_hex().to_string());
    }
    (content.map(|content| source.inputs_blake3(content, bench)), tracked)
}

/// As [`track_one`] for frames in memory, in order, the neutral one first. `source` names no files. The hash of the inputs is computed from
/// the pixels.
///
/// # Errors
/// [`SequenceFailure`] with the stage.
pub fn track_pictures(
    source: &SequenceSource,
    frames: Vec<Frame>,
    bench: &Workbench,
    tick: impl FnMut(u32) -> bool,
) -> Result<(Track, TrackInfo), SequenceFailure> {
    let mut hasher = blake3::Hasher::new();
    for frame in &frames {
        hasher.update(format!("{} {}\n", frame.number(), frame.size()).as_bytes());
        hasher.update(frame.image().as_raw());
    }
    let content = hasher.finalize();
    let expected = frames.first().map(Frame::size);
    let mut frames = frames.into_iter().map(|frame| match expected {
        Some(expected) if frame.size() != expected => {
            let (number, found) = (frame.number(), frame.size());
            Err(SequenceError::Size { path: PathBuf::from("pictures"), number, found, expected })
        }
        _ => Ok(frame),
    });
    let (track, mut info) = track_frames(source, bench, &mut frames, tick)?;
    info.inputs_blake3 = source.inputs_blake3(content, bench);
    Ok((track, info))
}

fn track_frames(
    source: &SequenceSource,
    bench: &Workbench,
    frames: &mut impl Iterator<Item = Result<Frame, SequenceError>>,
    tick: impl FnMut(u32) -> bool,
) -> Result<(Track, TrackInfo), SequenceFailure> {
    let first = frames.next().unwrap_or(Err(SequenceError::TooFewFrames { found: 0 }));
    let first = first.map_err(SequenceFailure::at(Stage::Track))?;
    let NeutralFit { fitted, beside } = source.fit_neutral(&first, bench)?;
    let frames = std::iter::once(Ok(first)).chain(frames);
    let track = track_sequence(&bench.wireframe, &bench.plan, &fitted, frames, &bench.options.track, tick).map_err(|error| {
        let (is_interrupted, is_lost) = (matches!(error, TrackError::Interrupted), error.is_face_lost());
        let SequenceFailure { stage, mut reason, fatal } = SequenceFailure::at(Stage::Track)(error);
        if is_lost && !beside.is_empty() {
            reason = format!("{reason}: {}", beside.join("; "));
        }
        SequenceFailure { stage, reason, fatal: fatal || is_interrupted }
    })?;
    let ends = track.frames.first().zip(track.frames.last());
    let back = ends.and_then(|(first, last)| mouth_back_said(track.mouth_moved, first.number, last.number));
    let hidden = ends.and_then(|(_, last)| covered_at_apex_said(&track.covered_at_apex, last.number));
    let info = TrackInfo {
        schema_version: TRACK_SCHEMA,
        made_by: MADE_BY.to_owned(),
        units: track_units(),
        id: source.id.clone(),
        emotion: source.emotion.clone(),
        metadata: source.metadata.clone(),
        source: source.frames.names(),
        image_size: track.size,
        fps: source.fps,
        times: None,
        notes: Vec::new(),
        marks_from: source.marks_from.clone(),
        marks: source.marks.iter().map(|m| (m.node.0, m.position.x, m.position.y, m.kind == MarkKind::Hard)).collect(),
        read: fitted.read.iter().map(|m| m.node).collect(),
        fit: bench.options.fit.clone(),
        track: bench.options.track,
        summary: summarize(&track.frames, &bench.wireframe, &bench.tables)
            .with_marks_beside(beside)
            .with_covered(covered_said(&source.covered))
            .with_mouth_back(back)
            .with_covered_at_apex(hidden),
        inputs_blake3: String::new(),
        frames_blake3: None,
        csv_blake3: String::new(),
        corrections: None,
        neutral_frame: None,
        apex_frame: None,
    };
    Ok((track, info))
}

/// Labels of a track. Changing them does not require new tracking.
pub(super) struct Labels<'a> {
    pub emotion: &'a str,
    pub metadata: &'a BTreeMap<String, String>,
    pub marks_from: &'a str,
    pub fps: Option<f64>,
}

/// A track for the next steps of a run.
pub(super) struct RunTrack {
    pub frames: Vec<TrackedFrame>,
    pub info: TrackInfo,
    /// Whether an unchanged track was reused.
    pub reused: bool,
    pub hashes: TrackHashes,
}

/// Returns the track of a sequence: reads an unchanged one, or creates it with `make` and writes it. `correct` applies manual corrections.
/// `own_clock` returns the frames' own times, for a track whose given rate was removed.
pub(super) fn track_or_reuse(
    labels: &Labels<'_>,
    inputs: Option<&Inputs>,
    csv_path: &Path,
    bench: &Workbench,
    make: impl FnOnce() -> Result<(Vec<TrackedFrame>, TrackInfo), SequenceFailure>,
    correct: impl FnOnce(&[TrackedFrame], &Corrections, &str) -> Result<Vec<TrackedFrame>, SequenceFailure>,
    own_clock: impl FnOnce(&Inputs) -> Result<Clock, SequenceFailure>,
) -> Result<RunTrack, SequenceFailure> {
    let json = crate::input::read(&csv_path.with_extension("json")).unwrap_or_default();
    let earlier = match parse_track_info(csv_path, &json) {
        Ok(info) => Some(info),
        // A file of a later version must not be overwritten.
        Err(newer @ TrackFileError::Newer { .. }) => return Err(SequenceFailure::at(Stage::Dataset)(newer)),
        Err(_) => None,
    };
    let saved = saved_or_carried_over(csv_path, earlier.as_ref())?;
    let wanted = saved.as_ref().map(|s| &s.blake3);
    if let (Some(info), Some(inputs)) = (earlier.clone(), inputs)
        && let Some(timed) = inputs.timing_of(&info)
        && info.corrections.as_ref().map(|c| &c.blake3) == wanted
        && let Ok(csv) = crate::input::read(csv_path)
        && blake3::hash(&csv).to_hex().as_str() == info.csv_blake3
        && let Ok(frames) = parse_track(csv_path, &csv)
    {
        let frames = neutral_first(frames, info.neutral_frame);
        let json = blake3::hash(&json).to_hex().to_string();
        let hashes = TrackHashes { csv: info.csv_blake3.clone(), json };
        // A given rate has precedence.
        let clock = match (labels.fps, timed) {
            (Some(fps), _) => Clock::even(Some(fps)),
            (None, Timed::ByThemselves) => info.clock(),
            (None, Timed::ByRate) => own_clock(inputs)?,
        };
        let track = RunTrack { frames, info, reused: true, hashes };
        return relabel(labels, (clock, inputs.with_rate(labels.fps)), track, csv_path, &bench.options.track);
    }
    let (mut frames, mut info) = make()?;
    if let Some(saved) = &saved {
        let inputs = info.inputs_blake3.clone();
        apply(saved, earlier.as_ref(), &mut frames, &mut info, bench, |frames, fit| correct(frames, fit, &inputs))?;
    }
    let hashes = write_hashed_track(csv_path, &frames, &mut info).map_err(SequenceFailure::at(Stage::Write))?;
    // Uses the values in the file, so that a resumed run gives identical bytes.
    let frames = parse_track(csv_path, &track_csv(&frames)).map_err(SequenceFailure::at(Stage::Write))?;
    let frames = neutral_first(frames, info.neutral_frame);
    Ok(RunTrack { frames, info, reused: false, hashes })
}

/// Updates the labels and times beside an unchanged track, and the tracker options, few of which affect landmarks.
fn relabel(
    labels: &Labels<'_>,
    (clock, inputs_blake3): (Clock, String),
    mut track: RunTrack,
    csv_path: &Path,
    options: &TrackOptions,
) -> Result<RunTrack, SequenceFailure> {
    let info = &track.info;
    let labelled = TrackInfo {
        emotion: labels.emotion.to_owned(),
        metadata: labels.metadata.clone(),
        marks_from: labels.marks_from.to_owned(),
        fps: clock.fps,
        times: clock.times,
        inputs_blake3,
        track: *options,
        ..info.clone()
    };
    if labelled != *info {
        let written = output::write_hashed(&csv_path.with_extension("json"), |out| output::json_into(out, &labelled));
        track.hashes.json = written.map_err(SequenceFailure::at(Stage::Write))?.to_hex().to_string();
        track.info = labelled;
    }
    Ok(track)
}

#[cfg(test)]
mod tests {
    use std::{io::Error, path::Path};

    use super::*;
    use crate::{
        dataset::Dataset,
        pipeline::PipelineOptions,
        sequence::{DecodeError, read_first_frame},
    };

    #[test]
    fn a_later_frame_that_the_disk_does_not_give_is_the_machines_fault() {
        let dataset = Dataset::open(&Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/simulated")).unwrap();
        let bench = Workbench::new(None, PipelineOptions::default()).unwrap();
        let entry = &dataset.sequences[0];
        let frames = entry.frames().unwrap();
        let marks =
            entry.correspondences(frames.neutral_number(), &bench.tables, bench.wireframe.node_count(), &bench.options.marks);
        let first = read_first_frame(&frames).unwrap();
        let source = SequenceSource {
            id: entry.id.clone(),
            emotion: entry.emotion.clone(),
            metadata: BTreeMap::new(),
            frames,
            marks: marks.unwrap(),
            marks_from: "file".to_owned(),
            covered: Vec::new(),
            fps: None,
        };
        let track = |code: i32| {
            let unread = SequenceError::Decode { path: "a.png".into(), source: DecodeError::Io(Error::from_raw_os_error(code)) };
            track_frames(&source, &bench, &mut [Ok(first.clone()), Err(unread)].into_iter(), |_| true).unwrap_err()
        };
        // EIO is the machine's fault; ENOENT, a missing file, is the sequence's.
        assert!(track(5).fatal && track(5).reason.starts_with(MACHINE));
        assert!(!track(2).fatal);
    }
}
