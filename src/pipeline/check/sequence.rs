//! Checks one sequence with the functions that prepare it for a run.

use std::path::Path;

use super::super::{
    SequenceFailure, SequenceSource, Stage, Workbench,
    found::covered_said,
    landmarks::LandmarkSource,
    measured::normalized,
    neutral::NeutralFit,
    recording::{failed, is_recording, recording_of, too_few_frames},
    sequence::FOUND,
    work::{Driven, Planned, Source, name_marks, plan},
};
use crate::{
    dataset::{CorrespondenceSource, FailedEntry, FrameSource, LandmarkSelection, SequenceEntry, unread_beside},
    sequence::{ImageSize, SequenceError, SequenceReader, read_first_frame},
    track::{
        Ends, TrackSummary, TrackedFrame, Verdict, covered_at_apex_said, missing_said, mouth_back_said, neutral_nodes,
        read_corrections, summarize, two_pictures_said,
    },
    units::SequenceId,
};

/// Properties of a sequence before tracking.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckedSequence {
    /// Subject and sequence.
    pub id: SequenceId,
    /// Emotion label; empty for a damaged row.
    pub emotion: String,
    /// What drives it: `images`, `video`, `landmarks`, or `recording` for an unsegmented recording; empty if unknown.
    pub source: &'static str,
    /// Frames from neutral to apex; for a video, the number in its header. `None` if unknown.
    pub frames: Option<usize>,
    /// Size of the neutral frame, px.
    pub size: Option<ImageSize>,
    /// Source of the marks: `file`, `landmarks`, `found`, or `none`; empty for a damaged row, and for a recording whose marks are yet to be
    /// found.
    pub marks: &'static str,
    /// Number of marks.
    pub marked: Option<usize>,
    /// Eye distance of the fitted neutral face, px.
    pub eye_distance: Option<f64>,
    /// Median expected error of found marks divided by the eye distance.
    pub face_error: Option<f64>,
    /// Median over the live nodes of their expected error on the neutral face, px.
    pub placement_error: Option<f64>,
    /// Stage and reason of the failure, if it would fail.
    pub failure: Option<(Stage, String)>,
    /// Whether the failure is not the sequence's fault and would end a run.
    pub ends_run: bool,
    /// Reasons to review it, one sentence each, as in the verdicts of a run.
    pub reasons: Vec<String>,
    /// Other messages of a run about it, one sentence each.
    pub notes: Vec<String>,
    /// Identifies the grey values of its neutral and apex frames; `None` for anything but images.
    pub pictures: Option<String>,
}

/// Source of a row that is a whole recording.
const RECORDING: &str = "recording";
/// Source of a sequence that landmarks drive.
const LANDMARKS: &str = "landmarks";

impl CheckedSequence {
    /// Verdict: it would fail, needs a review, or is good.
    pub fn verdict(&self) -> &'static str {
        match (&self.failure, self.reasons.is_empty()) {
            (Some(_), _) => "fails",
            (None, false) => Verdict::LookAgain.name(),
            (None, true) => Verdict::Good.name(),
        }
    }

    /// Whether it is a whole recording, which a run cuts into any number of sequences.
    pub fn is_recording(&self) -> bool {
        self.source == RECORDING
    }

    pub(super) fn of(entry: &SequenceEntry, bench: &Workbench, results: Option<&Path>) -> Self {
        let may_find = bench.options.marks == LandmarkSelection::Auto;
        let marks = match entry.correspondence_source() {
            // Only named files count; other places are not searched.
            _ if is_recording(entry) => entry.correspondences_path.as_ref().map_or("", |_| "file"),
            Ok(CorrespondenceSource::File(_)) => "file",
            Ok(CorrespondenceSource::Landmarks(_)) => "landmarks",
            Ok(CorrespondenceSource::None) if may_find => FOUND,
            Ok(CorrespondenceSource::None) | Err(_) => "none",
        };
        let mut checked = Self { emotion: entry.emotion.clone(), marks, ..Self::named(entry.id.clone()) };
        if let Err(SequenceFailure { stage, reason, fatal }) = checked.prepare(entry, bench, results) {
            (checked.failure, checked.ends_run) = (Some((stage, reason)), fatal);
            // Fields that are known despite the failure.
            if let (Ok(frames), "") = (entry.frames(), checked.source) {
                checked.list(&frames, None);
                checked.size = read_first_frame(&frames).ok().filter(|_| stage == Stage::Fit).map(|frame| frame.size());
            }
        }
        checked
    }

    fn named(id: SequenceId) -> Self {
        Self {
            id,
            emotion: String::new(),
            source: "",
            frames: None,
            size: None,
            marks: "",
            marked: None,
            eye_distance: None,
            face_error: None,
            placement_error: None,
            failure: None,
            ends_run: false,
            reasons: Vec::new(),
            notes: Vec::new(),
            pictures: None,
        }
    }

    pub(super) fn damaged(row: &FailedEntry) -> Self {
        let row = Planned::damaged(row);
        Self { failure: row.source.err().map(|failure| (failure.stage, failure.reason)), ..Self::named(row.id) }
    }

    /// Sets the fields that follow from the frame list. `stated` is the number of frames in a video's header.
    fn list(&mut self, frames: &FrameSource, stated: Option<usize>) {
        (self.source, self.frames) = match frames {
            FrameSource::Images(files) => ("images", Some(files.len())),
            &FrameSource::Video { first, last, .. } => {
                let first = first.unwrap_or(1) as usize;
                let last = last.map(|last| last as usize).or(stated);
                ("video", last.map(|last| first.abs_diff(last) + 1))
            }
        };
    }

    /// Performs all steps of a run that precede tracking.
    fn prepare(&mut self, entry: &SequenceEntry, bench: &Workbench, results: Option<&Path>) -> Result<(), SequenceFailure> {
        if is_recording(entry) {
            return self.prepare_recording(entry, bench);
        }
        if entry.driving_landmarks(bench.options.landmarks.prefer).is_ok_and(|path| path.is_some()) {
            self.source = LANDMARKS;
        }
        let Driven { source, remark, found_error, .. } = plan(entry, false, bench)?;
        if let Some(out) = results {
            read_corrections(&out.join(format!("tracks/{}.csv", entry.id))).map_err(SequenceFailure::at(Stage::Dataset))?;
        }
        let (summary, notes) = match &source {
            Source::Images(source) => self.prepare_images(source, bench),
            Source::Landmarks(source) => self.follow_landmarks(source, bench),
        }
        .map_err(|failure| name_marks(failure, Some(entry)))?;
        self.face_error = found_error;
        self.eye_distance = Some(summary.eye_distance_px).filter(|px| *px > 0.0);
        self.placement_error = summary.placement_error_px;
        self.reasons.extend(summary.reasons);
        let is_new = |note: &String| !self.reasons.iter().any(|reason| note.contains(reason.as_str()));
        self.notes = remark.into_iter().chain(notes).filter(is_new).collect();
        Ok(())
    }

    /// Checks the row, first frame and length of a whole recording.
    fn prepare_recording(&mut self, entry: &SequenceEntry, bench: &Workbench) -> Result<(), SequenceFailure> {
        self.source = RECORDING;
        let fails =
            |reason: String| SequenceFailure { stage: Stage::Dataset, reason: failed(entry, reason).reason(), fatal: false };
        let failed = |error: SequenceError| fails(error.to_string());
        let recording = recording_of(entry, bench).map_err(|error| fails(error.to_string()))?;
        self.marked = recording.marks.as_ref().map(|(_, marks)| marks.len());
        let mut reader = SequenceReader::open(&recording.frames).map_err(failed)?;
        self.frames = reader.stated_frames();
        let first = reader.next().unwrap_or(Err(SequenceError::TooFewFrames { found: 0 })).map_err(failed)?;
        self.size = Some(first.size());
        if let Some(error) = self.frames.and_then(|frames| too_few_frames(&recording, frames, reader.fps())) {
            let said = error.to_string();
            match &recording.frames {
                FrameSource::Images(_) => return Err(fails(said)),
                FrameSource::Video { .. } => self.reasons.push(format!("{said} (as its header states)")),
            }
        }
        Ok(())
    }

    /// Decodes the neutral frame, fits the wireframe, and decodes the apex of an image sequence. Returns the track's reasons for review,
    /// and further notes.
    fn prepare_images(
        &mut self,
        source: &SequenceSource,
        bench: &Workbench,
    ) -> Result<(TrackSummary, Vec<String>), SequenceFailure> {
        let failed = SequenceFailure::at(Stage::Track);
        self.list(&source.frames, None);
        self.marked = Some(source.marks.len());
        let opened = match &source.frames {
            // Reading a video backwards would decode everything up to its last frame.
            FrameSource::Video { path, first, last: Some(last) } if first.is_some_and(|first| first > *last) => {
                SequenceReader::open(&FrameSource::Video { path: path.clone(), first: *first, last: None })
            }
            frames => SequenceReader::open(frames),
        };
        let mut reader = opened.map_err(&failed)?;
        let stated = reader.stated_frames();
        self.list(&source.frames, stated);
        self.reasons.extend(stated.and_then(|stated| beyond_said(&source.frames, stated)));
        let first = reader.next().unwrap_or(Err(SequenceError::TooFewFrames { found: 0 })).map_err(&failed)?;
        self.size = Some(first.size());
        let NeutralFit { fitted, beside } = source.fit_neutral(&first, bench)?;
        let neutral = TrackedFrame { number: first.number(), nodes: neutral_nodes(&bench.wireframe, &fitted) };
        let mut summary = summarize(&[neutral], &bench.wireframe, &bench.tables)
            .with_marks_beside(beside)
            .with_covered(covered_said(&source.covered));
        let mut hidden = None;
        if let FrameSource::Images(files) = &source.frames {
            let ends = [files.first(), files.last()].into_iter().flatten().cloned().collect();
            let ends = SequenceReader::open_part(&FrameSource::Images(ends), &source.frames).map_err(&failed)?;
            let ends = ends.collect::<Result<Vec<_>, _>>().map_err(&failed)?;
            let mut hash = blake3::Hasher::new();
            ends.iter().for_each(|frame| _ = hash.update(frame.image().as_raw()));
            self.pictures = Some(hash.finalize().to_hex().to_string());
            summary.reasons.extend(missing_said(files.iter().map(|file| file.number)));
            if let Some(last) = ends.last().filter(|_| bench.options.track.locates()) {
                let nodes = fitted.model.nodes();
                let ends = Ends::look((first.image(), nodes), (last.image(), nodes));
                summary = summary.with_mouth_back(mouth_back_said(ends.mouth_moved, first.number(), last.number()));
                // Quick brows look covered, too; a run tells them apart by the nodes that it loses on the way.
                let said = covered_at_apex_said(&ends.covered, last.number());
                hidden =
                    said.map(|said| format!("{said} (by the first and the last frame alone; a run sees the frames between)"));
            }
        }
        let two = match &source.frames {
            FrameSource::Images(files) => match &files[..] {
                [neutral, apex] => Some(two_pictures_said(neutral.number, apex.number, "may lie")),
                _ => None,
            },
            FrameSource::Video { .. } => None,
        };
        Ok((summary, two.into_iter().chain(unread_beside(&source.frames)).chain(hidden).collect()))
    }

    /// Drives the wireframe by landmarks as a run does. Returns the track's reasons for review, and further notes.
    fn follow_landmarks(
        &mut self,
        source: &LandmarkSource,
        bench: &Workbench,
    ) -> Result<(TrackSummary, Vec<String>), SequenceFailure> {
        self.marks = source.marks_from;
        let (frames, info) = source.track(bench).1?;
        (self.frames, self.marked) = (Some(frames.len()), Some(info.marks.len()));
        let normalized = normalized(&frames, &info.mark_places(), info.times.as_deref(), bench)?;
        let mut summary = info.summary.clone();
        normalized.judge(&mut summary, &frames, bench);
        Ok((summary, info.notes))
    }
}

/// Message for a requested frame that lies beyond the length in the video's header.
fn beyond_said(frames: &FrameSource, stated: usize) -> Option<String> {
    let &FrameSource::Video { first, last, .. } = frames else { return None };
    let (column, frame) = [("last_frame", last), ("first_frame", first)]
        .into_iter()
        .find(|(_, frame)| frame.is_some_and(|f| f as usize > stated))?;
    Some(format!("`{column}` is {}, but the header of the video states {stated} frames", frame?))
}
