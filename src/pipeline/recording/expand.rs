//! Replaces manifest rows of whole recordings by the sequences found in them.

use std::{
    collections::{BTreeMap, btree_map::Entry},
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
};

use super::{
    Recording, RecordingError, RecordingFiles, RecordingOutputs, RecordingStep, Segment, reuse_recording, segment_recording,
    survey::{SHORTEST, USUAL_FPS, too_short},
    write_recording,
};
use crate::{
    dataset::{Dataset, DatasetError, FailedEntry, FrameSource, SEGMENT_COLUMN, SequenceEntry, name_key},
    output::OutputError,
    pipeline::{Event, RunError, Workbench},
    segment::SegmentOptions,
    units::SequenceId,
};

/// Folder of the sequences found in recordings, inside the folder of a run.
pub(in super::super) const SEGMENTS_FOLDER: &str = "segments";

/// Whether a row is a recording to be segmented.
pub(in super::super) fn is_recording(entry: &SequenceEntry) -> bool {
    entry.metadata.get(SEGMENT_COLUMN).is_some_and(|value| value.trim().eq_ignore_ascii_case("auto"))
}

/// Replaces every recording of a dataset by its sequences. Earlier results are reused if nothing changed.
pub(in super::super) fn expand(
    dataset: &mut Dataset,
    out: &Path,
    bench: &Workbench,
    (stop, event): (&AtomicBool, &(dyn Fn(Event) + Sync)),
) -> Result<(), RunError> {
    let (recordings, mut sequences): (Vec<_>, Vec<_>) =
        std::mem::take(&mut dataset.sequences).into_iter().partition(is_recording);
    for entry in recordings {
        event(Event::Segmenting { id: entry.id.clone() });
        let folder = out.join(SEGMENTS_FOLDER).join(&entry.id.subject);
        match segmented(&entry, &folder, bench, stop).and_then(with_segments) {
            Ok(files) => sequences.extend(files.segments.iter().map(|segment| sequence(&entry, segment, &folder))),
            Err(RecordingError::Interrupted) => return Err(RunError::Interrupted),
            Err(RecordingError::Output(error)) => return Err(OutputError::into(error)),
            Err(error) => dataset.failures.push(failed(&entry, error.to_string())),
        }
    }
    let doubles = take_doubles(&mut sequences, |double, first| {
        format!("this sequence would be named {}, but {} exists already; rename one of them", double.id, first.id)
    });
    dataset.failures.extend(doubles);
    sequences.sort_by(|a, b| a.id.cmp(&b.id));
    dataset.sequences = sequences;
    Ok(())
}

/// Failure of a recording without sequences.
pub(in super::super) fn failed(entry: &SequenceEntry, reason: String) -> FailedEntry {
    let SequenceId { subject, sequence } = entry.id.clone();
    FailedEntry { subject, sequence, error: DatasetError::Recording { path: entry.frames_path.clone(), reason } }
}

/// Removes sequences whose file names equal those of an earlier one. This happens when a row has the name of a recording's part, or when
/// datasets share names. `reason` makes the message from the double and the sequence that stays.
pub(in super::super) fn take_doubles(
    sequences: &mut Vec<SequenceEntry>,
    reason: impl Fn(&SequenceEntry, &SequenceEntry) -> String,
) -> Vec<FailedEntry> {
    let mut known: BTreeMap<String, SequenceEntry> = BTreeMap::new();
    let mut doubles = Vec::new();
    sequences.retain(|entry| match known.entry(name_key(&entry.id.to_string())) {
        Entry::Vacant(place) => {
            place.insert(entry.clone());
            true
        }
        Entry::Occupied(first) => {
            doubles.push(failed(entry, reason(entry, first.get())));
            false
        }
    });
    doubles
}

/// Returns an error for a recording without sequences, with its notes as the reason.
fn with_segments(files: RecordingFiles) -> Result<RecordingFiles, RecordingError> {
    if files.segments.is_empty() { Err(RecordingError::Nothing { reasons: files.notes }) } else { Ok(files) }
}

/// The recording of a row.
///
/// # Errors
/// [`RecordingError::Row`].
pub(in super::super) fn recording_of(entry: &SequenceEntry, bench: &Workbench) -> Result<Recording, RecordingError> {
    let frames = entry.recording().map_err(|e| RecordingError::Row { reason: e.to_string() })?;
    if entry.last_frame.is_some() || (entry.first_frame.is_some() && entry.correspondences_path.is_none()) {
        let reason =
            "a whole recording (segment is auto) cannot have first_frame and last_frame: leave them empty, or leave segment \
             empty to define one sequence; if the recording has marks, first_frame is the frame of the marks"
                .to_owned();
        return Err(RecordingError::Row { reason });
    }
    let marks = match (&entry.correspondences_path, entry.first_frame) {
        (None, _) => None,
        (Some(path), Some(frame)) => {
            let read = crate::correspondence::read_correspondences(path, &bench.tables, bench.wireframe.node_count());
            Some((frame, read.map_err(|e| RecordingError::Row { reason: e.to_string() })?))
        }
        (Some(_), None) => {
            let reason = "the recording has marks, but first_frame is empty; set it to the frame of the marks".to_owned();
            return Err(RecordingError::Row { reason });
        }
    };
    Ok(Recording { stem: entry.id.sequence.clone(), frames, fps: entry.fps, marks })
}

/// Message that a recording has too few frames for segmentation. `stated` is the frame rate in a video's header, frames per second.
pub(in super::super) fn too_few_frames(recording: &Recording, frames: usize, stated: Option<f64>) -> Option<RecordingError> {
    let fps = recording.fps.or(stated).unwrap_or(USUAL_FPS);
    let named = match &recording.frames {
        FrameSource::Images(files) => match (files.first(), files.last()) {
            (Some(first), Some(last)) if files.len() > 1 => format!("frames {} to {}", first.number, last.number),
            _ => "the only frame".to_owned(),
        },
        FrameSource::Video { .. } => "the video".to_owned(),
    };
    let is_short = frames < 2 || (frames as f64) < SHORTEST * fps;
    is_short.then(|| RecordingError::Nothing { reasons: vec![too_short(&named, frames, fps)] })
}

fn segmented(
    entry: &SequenceEntry,
    folder: &Path,
    bench: &Workbench,
    stop: &AtomicBool,
) -> Result<RecordingFiles, RecordingError> {
    let recording = recording_of(entry, bench)?;
    let options = SegmentOptions::default();
    let outputs = RecordingOutputs { pictures: bench.options.shows(&entry.metadata), openface: false };
    if let Some(files) = reuse_recording(folder, &recording, &options, bench, outputs)? {
        return Ok(files);
    }
    let tick = |_: RecordingStep, _: usize, _: Option<usize>| !stop.load(Ordering::Relaxed);
    let found = segment_recording(&recording, bench, &options, &tick)?;
    write_recording(folder, (&recording, &found), &options, bench, outputs, &tick)
}

/// The manifest entry of a sequence found in a recording.
fn sequence(entry: &SequenceEntry, segment: &Segment, folder: &Path) -> SequenceEntry {
    let marks = folder.join(format!("{}.csv", segment.name));
    SequenceEntry {
        id: SequenceId { subject: entry.id.subject.clone(), sequence: segment.name.clone() },
        first_frame: Some(segment.neutral_frame),
        last_frame: Some(segment.apex_frame),
        correspondences_path: Some(marks),
        ..entry.clone()
    }
}
