//! Segments whole recordings into sequences from neutral to apex.
//!
//! A recording is read as a stream, several times. The first pass finds cuts and faces (`survey`). Every stretch with a face is tracked
//! from its most typical face to both ends (`follow`) and measured (`measure`). [`crate::segment`] finds rests and expressions. The last
//! pass makes pictures and films. Memory is about a kilobyte per frame.

mod expand;
mod files;
mod film;
mod follow;
mod kept;
mod likeness;
mod measure;
mod persons;
mod rests;
mod survey;

use std::{
    collections::{BTreeMap, VecDeque},
    path::PathBuf,
};

use serde::{Deserialize, Serialize};

use self::{
    follow::{CompactFrame, Followed, Start, follow},
    measure::{Measured, Neutral, Shown, marks_in, measure},
    rests::share_rests,
    survey::{Covered, Look, SHORTEST, SHORTEST_TRACKED, Stretch, Survey, too_short},
};
use super::{FoundMarksError, Workbench, found::fitting_marks};
use crate::{
    dataset::FrameSource,
    features::frame_steps,
    fit::Correspondence,
    input::RecordError,
    locate::FacePart,
    output::OutputError,
    pose::{HeadPose, PoseError},
    segment::{Phase, RecordedFrame, SegmentError, SegmentOptions, Segmentation, segment, strength},
    sequence::{Clock, FilmError, ImageSize, SequenceError},
    track::TrackError,
};

pub(super) use expand::{SEGMENTS_FOLDER, expand, failed, is_recording, recording_of, take_doubles, too_few_frames};
pub use files::{
    ManifestColumns, RecordingFiles, RecordingOutputs, SegmentRow, reuse_recording, write_recording, write_segments,
};
pub use film::write_recording_film;
pub use kept::{EarlierSegments, GivenForAll, KeptRows, UNLABELLED, keep_edited};

/// Stage of the work on a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordingStep {
    /// Counting frames, finding cuts and faces.
    Looking,
    /// Tracking nodes.
    Tracking,
    /// Measuring pose and action units.
    Measuring,
    /// Making pictures or a film.
    Drawing,
}

/// Progress callback with the step, the number of frames done since the last call, and the number of all frames if known. Returning `false`
/// stops.
pub type Tick<'a> = &'a (dyn Fn(RecordingStep, usize, Option<usize>) -> bool + Sync);

/// A recording to be segmented.
#[derive(Clone, Debug)]
pub struct Recording {
    /// Stem of its sequences' names: STEM-01, STEM-02, ...
    pub stem: String,
    /// All its frames.
    pub frames: FrameSource,
    /// Frames per second, if given; else the video's rate, or 25 if it states none.
    pub fps: Option<f64>,
    /// Number of a neutral frame and the marks set on it by hand.
    pub marks: Option<(u32, Vec<Correspondence>)>,
}

/// A sequence from neutral to apex found in a recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Segment {
    /// STEM-01 ...
    pub name: String,
    /// Number of the neutral frame: at rest before the expression, or after it if there is no rest before.
    pub neutral_frame: u32,
    /// Number of the frame in which it leaves the rest.
    pub onset_frame: u32,
    /// Number of the frame in which it is strongest.
    pub apex_frame: u32,
    /// Number of the frame in which it is back at rest.
    pub offset_frame: u32,
    /// Confidence that it is an expression from rest to apex, 0 to 1.
    pub confidence: f64,
    /// Marks of the neutral frame.
    #[serde(skip)]
    pub marks: Vec<Correspondence>,
}

/// Measurements of one frame of a recording.
#[derive(Clone, Debug)]
pub struct RecordingFrame {
    /// Pose, action units, openings.
    pub measured: RecordedFrame,
    /// Number of its stretch, from 1.
    pub stretch: usize,
    /// Phase of the frame.
    pub phase: Phase,
    /// Activity of the face.
    pub activity: f64,
    pose: Option<HeadPose>,
    nodes: CompactFrame,
    shown: Shown,
}

/// A recording segmented into sequences.
#[derive(Clone, Debug)]
pub struct SegmentedRecording {
    /// Its stem.
    pub stem: String,
    /// Frames per second.
    pub fps: f64,
    /// Times of its frames.
    pub clock: Clock,
    /// Size of its frames.
    pub size: ImageSize,
    /// Frames in all.
    pub frame_count: usize,
    /// Distance of each frame from the first in frames, by its number.
    steps: BTreeMap<u32, u32>,
    /// Frames with a tracked face, ascending.
    pub frames: Vec<RecordingFrame>,
    /// The sequences in order of time.
    pub segments: Vec<Segment>,
    /// Notes to the user: cuts, lost faces, expressions without a rest.
    pub notes: Vec<String>,
    /// BLAKE3 of the names and bytes of its files.
    pub content_blake3: String,
}

impl SegmentedRecording {
    /// Seconds from the first frame to the frame with a number; `None` if unknown.
    pub(super) fn seconds(&self, number: u32) -> Option<f64> {
        self.clock.seconds(*self.steps.get(&number)?)
    }

    /// Numbers of all its frames, ascending.
    fn numbers(&self) -> impl Iterator<Item = u32> {
        self.steps.keys().copied()
    }
}

/// Why a recording cannot be segmented.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// A frame cannot be read.
    #[error(transparent)]
    Sequence(#[from] SequenceError),
    /// A picture of a folder cannot be decoded.
    #[error("{source}; remove this picture, and the recording lacks one frame")]
    Picture {
        /// The picture and what is wrong with it.
        source: SequenceError,
    },
    /// There are no frames.
    #[error("the recording has no frames")]
    NoFrames,
    /// The locator failed.
    #[error(transparent)]
    Locate(#[from] FoundMarksError),
    /// Marks that do not allow a fit.
    #[error("frame {frame}: {reason}")]
    Marks {
        /// Frame number.
        frame: u32,
        /// Why.
        reason: String,
    },
    /// The neutral frame named is not in a stretch with a face.
    #[error("the marks are for frame {frame}, which is not in the recording; it has frames {first} to {last}")]
    NoSuchFrame {
        /// Frame number.
        frame: u32,
        /// First frame number.
        first: u32,
        /// Last frame number.
        last: u32,
    },
    /// The tracker failed.
    #[error(transparent)]
    Track(#[from] TrackError),
    /// The pose of the head cannot be computed.
    #[error(transparent)]
    Pose(#[from] PoseError),
    /// The features cannot be computed.
    #[error("{reason}")]
    Features {
        /// Why.
        reason: String,
    },
    /// The row of the manifest is invalid.
    #[error("{reason}")]
    Row {
        /// What is wrong.
        reason: String,
    },
    /// No stretch could be used.
    #[error("found no sequence: {}", reasons.join("; "))]
    Nothing {
        /// Reasons, one sentence each.
        reasons: Vec<String>,
    },
    /// The existing record was written by a newer version.
    #[error("{}: {source}, or give another name for the table of `segment`, or another `-o` of `run`", path.display())]
    Newer {
        /// The record.
        path: PathBuf,
        /// Its version.
        source: RecordError,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A film cannot be written.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// The caller asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// Largest activity at which the fitted frame serves as the neutral one.
const AT_REST: f64 = 0.5;

/// Finds the rests and expressions of a recording.
///
/// # Errors
/// [`RecordingError`] when it cannot be read, or when no stretch is usable. Problems of single stretches are in the notes.
pub fn segment_recording(
    recording: &Recording,
    bench: &Workbench,
    options: &SegmentOptions,
    tick: Tick<'_>,
) -> Result<SegmentedRecording, RecordingError> {
    let survey = Survey::new(recording, tick).map_err(|error| match (error, &recording.frames) {
        (RecordingError::Sequence(source @ SequenceError::Decode { .. }), FrameSource::Images(_)) => {
            RecordingError::Picture { source }
        }
        (error, _) => error,
    })?;
    let (stretches, turns) = survey.stretches();
    let mut later = Vec::new();
    if let Some((frame, _)) = &recording.marks
        && survey.numbers.binary_search(frame).is_err()
    {
        let (first, last) = (survey.numbers.first().copied(), survey.numbers.last().copied());
        return Err(RecordingError::NoSuchFrame {
            frame: *frame,
            first: first.unwrap_or_default(),
            last: last.unwrap_or_default(),
        });
    }
    if stretches.is_empty() {
        later.push("no face was found".to_owned());
    }
    let mut tracked = tracked_stretches(recording, &survey, stretches, bench, tick, &mut later)?;
    tracked.sort_by_key(|followed| followed.first);
    let places: Vec<(usize, usize)> = tracked.iter().map(|f| (f.first, f.first + f.frames.len().saturating_sub(1))).collect();
    let mut notes: Vec<String> = survey.notes.iter().cloned().chain(survey.several(recording.marks.is_some())).collect();
    notes.extend(turns.into_iter().map(|turn| survey.turn_message(turn, &places)).chain(later));
    let live = bench.wireframe.live_nodes();
    let is_covered = |covered: &&Covered| !tracked.iter().any(|followed| followed.sees_through(covered, live));
    notes.extend(survey.covered().iter().filter(is_covered).map(|covered| survey.covered_message(covered)));
    let mut result = SegmentedRecording {
        stem: recording.stem.clone(),
        fps: survey.fps,
        clock: survey.clock.clone(),
        size: survey.size,
        frame_count: survey.numbers.len(),
        steps: survey.numbers.iter().copied().zip(frame_steps(&survey.numbers)).collect(),
        frames: Vec::new(),
        segments: Vec::new(),
        notes: Vec::new(),
        content_blake3: survey.content.to_hex().to_string(),
    };
    let (mut entries, mut short) = (Vec::new(), Vec::new());
    for (k, followed) in tracked.into_iter().enumerate() {
        if (followed.frames.len() as f64) < SHORTEST * survey.fps {
            short.push((k + 1, followed));
            continue;
        }
        match Entry::new((k + 1, followed), &survey, bench, (options, tick))? {
            Ok(entry) => entries.push(entry),
            Err(note) => notes.push(note),
        }
    }
    notes.extend(share_rests((&mut entries, short), &survey, bench, (options, tick))?);
    entries.sort_by_key(|entry| entry.followed.first);
    entries.into_iter().for_each(|entry| entry.join(&mut result, &mut notes));
    if result.frames.is_empty() {
        return Err(RecordingError::Nothing { reasons: notes });
    }
    if result.segments.is_empty() {
        notes.push("no expression was found".to_owned());
    }
    result.notes = notes;
    Ok(result)
}

/// Tracks all stretches, and the remaining parts of those in which the face was lost.
fn tracked_stretches(
    recording: &Recording,
    survey: &Survey,
    stretches: Vec<Stretch>,
    bench: &Workbench,
    tick: Tick<'_>,
    notes: &mut Vec<String>,
) -> Result<Vec<Followed>, RecordingError> {
    let number = |place: usize| survey.numbers.get(place).copied().unwrap_or_default();
    let mut waiting = VecDeque::from(stretches);
    let mut tracked = Vec::new();
    while let Some(stretch) = waiting.pop_front() {
        if !tick(RecordingStep::Tracking, 0, Some(survey.numbers.len())) {
            return Err(RecordingError::Interrupted);
        }
        let named = format!("frames {} to {}", number(stretch.first), number(stretch.last));
        if ((stretch.last - stretch.first + 1) as f64) < SHORTEST_TRACKED * survey.fps {
            notes.push(too_short(&named, stretch.last - stretch.first + 1, survey.fps));
            continue;
        }
        let given = recording.marks.as_ref().and_then(|(frame, marks)| {
            let place = survey.numbers.binary_search(frame).ok()?;
            (stretch.first..=stretch.last).contains(&place).then(|| (place, marks.clone()))
        });
        let is_given = given.is_some();
        let found = || {
            let Look { place, face, .. } = survey.usual_face(stretch, bench)?;
            Some((*place, fitting_marks(face.as_ref()?, survey.size, bench)))
        };
        let Some((place, marks)) = given.or_else(found) else {
            notes.push(format!("{named}: found no trusted face; mark a neutral frame with `grimace annotate`"));
            continue;
        };
        match follow(&recording.frames, survey, stretch, &Start { place, marks: &marks }, bench, tick) {
            Ok(followed) => {
                for (left, why) in &followed.left {
                    notes.push(why.clone());
                    waiting.push_back(*left);
                }
                tracked.push(followed);
            }
            Err(RecordingError::Marks { frame, reason }) if !is_given => {
                notes.push(format!("{named}: cannot fit the points found in frame {frame}: {reason}"));
            }
            Err(error) => return Err(error),
        }
    }
    Ok(tracked)
}

/// A stretch that was tracked and measured.
struct Entry {
    /// Its number, from 1.
    stretch: usize,
    followed: Followed,
    measured: Measured,
    segmentation: Result<Segmentation, SegmentError>,
    /// Index of the frame that it is measured against.
    neutral: usize,
}

impl Entry {
    /// Measures a stretch against its rest; a note if it shows no head.
    fn new(
        (stretch, followed): (usize, Followed),
        survey: &Survey,
        bench: &Workbench,
        (options, tick): (&SegmentOptions, Tick<'_>),
    ) -> Result<Result<Self, String>, RecordingError> {
        let mut neutral = followed.fitted;
        let mut measured = match measure_seen(&followed, &Neutral::own(&followed, neutral), survey, bench, tick) {
            Ok(measured) => measured,
            Err(RecordingError::Pose(error)) => return Ok(Err(format!("{}: {error}", named(&followed)))),
            Err(error) => return Err(error),
        };
        let mut segmentation = segment(&measured.frames, survey.fps, options);
        // Intensities are relative to the rest, once it is known.
        let rest = segmentation.as_ref().ok().filter(|s| s.activity[neutral] > AT_REST).map(|s| s.rest);
        if let Some(rest) = rest {
            match measure_seen(&followed, &Neutral::own(&followed, rest), survey, bench, tick) {
                Ok(again) => {
                    measured = again;
                    segmentation = segment(&measured.frames, survey.fps, options);
                    neutral = rest;
                }
                Err(RecordingError::Pose(_)) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(Ok(Self { stretch, followed, measured, segmentation, neutral }))
    }

    /// Adds the frames and sequences to the result.
    fn join(self, result: &mut SegmentedRecording, notes: &mut Vec<String>) {
        let Self { stretch, followed, measured, segmentation, .. } = self;
        let (phases, activity) = match &segmentation {
            Ok(found) => (found.phases.clone(), found.activity.clone()),
            Err(error) => {
                let text = error.to_string();
                notes.push(match error {
                    SegmentError::TooFew { .. } => format!("{}: {text}", named(&followed)),
                    SegmentError::NoRest { .. } | SegmentError::Option { .. } => text,
                });
                (vec![Phase::Other; measured.frames.len()], measured.frames.iter().map(strength).collect())
            }
        };
        if let Ok(found) = &segmentation {
            let number = |k: usize| followed.frames[k].number;
            let skipped = |&k: &usize| format!("frame {}: skipped an expression without a rest next to it", number(k));
            notes.extend(found.without_rest.iter().map(skipped));
            for e in &found.expressions {
                let name = format!("{}-{:02}", result.stem, result.segments.len() + 1);
                result.segments.push(Segment {
                    name,
                    neutral_frame: number(e.neutral),
                    onset_frame: number(e.onset),
                    apex_frame: number(e.apex),
                    offset_frame: number(e.offset),
                    confidence: e.confidence,
                    marks: marks_in(&followed, e.neutral),
                });
            }
        }
        let all = measured.frames.into_iter().zip(measured.poses).zip(followed.frames).zip(measured.shown);
        for ((((measured, pose), nodes), shown), (phase, activity)) in all.zip(phases.into_iter().zip(activity)) {
            result.frames.push(RecordingFrame { measured, stretch, phase, activity, pose, nodes, shown });
        }
    }
}

/// The frames of a stretch in words.
fn named(followed: &Followed) -> String {
    let number = |k: Option<&CompactFrame>| k.map_or(0, |frame| frame.number);
    format!("frames {} to {}", number(followed.frames.first()), number(followed.frames.last()))
}

/// Measures a stretch relative to a neutral frame. Frames in which something covers parts of the face are unusable: the
/// tracker follows what covers them.
fn measure_seen(
    followed: &Followed,
    neutral: &Neutral,
    survey: &Survey,
    bench: &Workbench,
    tick: Tick<'_>,
) -> Result<Measured, RecordingError> {
    let mut measured = measure(followed, neutral, survey, bench, tick)?;
    let live = bench.wireframe.live_nodes();
    for covered in survey.covered().into_iter().filter(|covered| !followed.sees_through(covered, live)) {
        let reason = FacePart::said_covered(&covered.parts).unwrap_or_default();
        for (k, frame) in measured.frames.iter_mut().enumerate() {
            if (covered.first..=covered.last).contains(&(followed.first + k)) {
                frame.reason.get_or_insert_with(|| reason.clone());
            }
        }
    }
    Ok(measured)
}

/// Folder of the files of a table of segments: beside the table, with its name.
pub fn segments_folder(table: &std::path::Path) -> PathBuf {
    table.with_extension("")
}
