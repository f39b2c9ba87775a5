//! Simulated recordings with ground truth: a person rests, shows several expressions, speaks, blinks and moves the head.
//!
//! A recording may begin in the middle of an expression. Between expressions the person rests and often speaks, with three to five
//! syllables per second that open and round the mouth. Eyes blink every few seconds, independent of the rest of the face, and the head
//! continually moves from one seeded pose to another.

use std::{
    borrow::Borrow,
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
};

use nalgebra::{Point2, Point3, Vector3};
use rand::{RngExt, seq::SliceRandom};
use rayon::prelude::*;
use serde::Serialize;

use super::{
    DatasetSummary, Emotion, SimulateError, SimulateOptions, SimulatedFrame, Subject,
    blink::close_lids,
    camera::develop,
    expression::{apex_offsets, fap_offsets},
    files::{begin, finish_recordings, write_picture},
    motion::{HeadPose, px_per_unit, smooth_step},
    random::{Purpose, generator},
    render::{Film, render},
    subject::place_followers,
};
use grimace::internal::{
    fap::{FapFrame, FapNumber},
    output::{FolderRecord, csv_into},
    wireframe::Wireframe,
};

/// Code of the random streams of recordings, in addition to the codes of emotions.
const CODE: u8 = 15;
/// Share of an expression's strength that remains at the end of its hold.
const HELD: f64 = 0.9;
/// Share of recordings that begin in the middle of an expression.
const BEGINS_MOVING: f64 = 0.4;
/// Share of rests in which the person speaks.
const SPEAKS: f64 = 0.5;
/// Shortest and longest duration, in frames at 25 frames per second, of: rest, rest after speech, speech, rise, hold, fall, syllable,
/// interval between blinks, interval between poses.
const REST: (f64, f64) = (22.0, 50.0);
const PAUSE: (f64, f64) = (14.0, 28.0);
const SPEECH: (f64, f64) = (35.0, 75.0);
const RISE: (f64, f64) = (9.0, 18.0);
const HOLD: (f64, f64) = (5.0, 16.0);
const FALL: (f64, f64) = (10.0, 22.0);
const SYLLABLE: (f64, f64) = (5.0, 8.0);
const BLINKS: (f64, f64) = (45.0, 130.0);
const POSES: (f64, f64) = (25.0, 70.0);
/// Time from open to closed lids, in frames at 25 frames per second.
const LID: f64 = 2.5;
/// Largest opening of the jaw in speech, and (`WIDTH`) largest change of the mouth's width to either side, in FAP values.
const JAW: f64 = 330.0;
const WIDTH: f64 = 70.0;
/// Frame rate of the durations above.
const FPS: f64 = 25.0;

/// An expression of a recording; times in frames from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueExpression {
    /// The emotion shown.
    pub emotion: Emotion,
    /// Last frame without the expression; below 0 when the recording begins with it.
    pub onset: f64,
    /// Frame of the greatest strength.
    pub apex: f64,
    /// Last frame of the hold.
    release: f64,
    /// First frame without the expression.
    pub offset: f64,
    /// Strength at the apex, relative to the person's own.
    strength: f64,
}

impl TrueExpression {
    fn intensity(&self, t: f64) -> f64 {
        let share = if t <= self.onset || t >= self.offset {
            0.0
        } else if t <= self.apex {
            smooth_step((t - self.onset) / (self.apex - self.onset))
        } else if t <= self.release {
            1.0 + (HELD - 1.0) * (t - self.apex) / (self.release - self.apex)
        } else {
            HELD * (1.0 - smooth_step((t - self.release) / (self.offset - self.release)))
        };
        share * self.strength
    }
}

/// A syllable: time of the widest opening, half its duration, opening, and width of the mouth (-1 to 1).
#[derive(Clone, Copy, Debug)]
struct Syllable {
    middle: f64,
    half: f64,
    open: f64,
    wide: f64,
}

/// The events of a recording.
#[derive(Clone, Debug)]
struct Script {
    frames: usize,
    expressions: Vec<TrueExpression>,
    rests: Vec<(f64, f64)>,
    syllables: Vec<Syllable>,
    blinks: Vec<f64>,
    /// Time, with roll, yaw, pitch, shift and scale.
    poses: Vec<(f64, [f64; 6])>,
}

impl Script {
    fn new(options: &SimulateOptions, subject: u32) -> Self {
        let mut random = generator(options.seed, Purpose::Recording, subject, CODE, 0);
        let rate = options.fps / FPS;
        let mut emotions = options.emotions.clone();
        emotions.shuffle(&mut random);
        let mut within = |(low, high): (f64, f64)| random.random_range(low..=high);
        let mut t = 0.0;
        let (mut expressions, mut rests, mut syllables) = (Vec::new(), Vec::new(), Vec::new());
        for (k, &emotion) in emotions.iter().enumerate() {
            if k == 0 && within((0.0, 1.0)) < BEGINS_MOVING {
                t = -rate * within((2.0, 6.0));
            } else {
                let start = t;
                t += rate * within(REST);
                if within((0.0, 1.0)) < SPEAKS {
                    rests.push((start, t));
                    let end = t + rate * within(SPEECH);
                    while t < end {
                        let length = rate * within(SYLLABLE);
                        let (open, wide) = (within((0.25, 1.0)), within((-1.0, 1.0)));
                        syllables.push(Syllable { middle: t + length / 2.0, half: length / 2.0, open, wide });
                        t += length;
                    }
                    let pause = t;
                    t += rate * within(PAUSE);
                    rests.push((pause, t));
                } else {
                    rests.push((start, t));
                }
            }
            let onset = t;
            // Apexes are at whole frames, so that a frame shows them.
            let apex = (onset + rate * within(RISE)).round().max(1.0);
            let release = apex + rate * within(HOLD);
            let offset = release + rate * within(FALL);
            expressions.push(TrueExpression { emotion, onset, apex, release, offset, strength: within((0.75, 1.05)) });
            t = offset;
        }
        rests.push((t, t + rate * within(REST)));
        let frames = rests.last().map_or(2.0, |r| r.1).ceil().max(2.0) as usize;
        let mut blinks = Vec::new();
        let mut at = rate * within(BLINKS);
        while at < frames as f64 {
            blinks.push(at);
            at += rate * within(BLINKS);
        }
        let angles = [options.roll_degrees, options.yaw_degrees, options.pitch_degrees].map(f64::to_radians);
        let limits = [angles[0], angles[1], angles[2], options.shift_px, options.shift_px, options.scale_change];
        let mut poses = Vec::new();
        let mut at = 0.0;
        loop {
            let mut pose: [f64; 6] = std::array::from_fn(|k| limits[k] * within((-1.0, 1.0)));
            pose[5] += 1.0;
            poses.push((at, pose));
            if at > frames as f64 {
                break;
            }
            at += rate * within(POSES);
        }
        Self { frames, expressions, rests, syllables, blinks, poses }
    }

    fn pose(&self, t: f64) -> [f64; 6] {
        let after = self.poses.iter().position(|(at, _)| *at > t).unwrap_or(self.poses.len() - 1).max(1);
        let ((from, a), (to, b)) = (&self.poses[after - 1], &self.poses[after]);
        let share = smooth_step(((t - from) / (to - from)).clamp(0.0, 1.0));
        std::array::from_fn(|k| a[k] + (b[k] - a[k]) * share)
    }

    /// Returns the opening of the mouth in speech, 0 to 1, and its width, -1 to 1.
    fn speech(&self, t: f64) -> (f64, f64) {
        let of = |s: &Syllable| {
            let share = smooth_step((1.0 - (t - s.middle).abs() / s.half).max(0.0));
            (s.open * share, s.wide * share)
        };
        self.syllables.iter().map(of).fold((0.0, 0.0), |(open, wide), (o, w)| (open + o, wide + w))
    }

    fn closure(&self, t: f64, rate: f64) -> f64 {
        self.blinks.iter().map(|b| smooth_step((1.0 - (t - b).abs() / (LID * rate)).max(0.0))).fold(0.0, f64::max)
    }
}

/// A simulated recording of a person.
#[derive(Clone, Debug)]
pub struct SimulatedRecording<S: Borrow<Subject>> {
    subject: S,
    options: SimulateOptions,
    wireframe: Wireframe,
    script: Script,
    /// The person's apex offsets for every expression of the script.
    apexes: Vec<Vec<Vector3<f64>>>,
}

impl<S: Borrow<Subject>> SimulatedRecording<S> {
    /// Makes the recording of a subject that was made with the same options. It shows each emotion of the options once, in seeded order.
    /// The script determines the number of frames; that of the options is ignored.
    ///
    /// # Errors
    /// [`SimulateError`] when the options are out of range.
    pub fn new(subject: S, options: &SimulateOptions) -> Result<Self, SimulateError> {
        options.check()?;
        let wireframe = Wireframe::candide3();
        let who: &Subject = subject.borrow();
        let script = Script::new(options, who.index());
        let apex =
            |e: &TrueExpression| apex_offsets(&wireframe, who.fapus(), e.emotion, who.strength(), options.seed, who.index());
        let apexes = script.expressions.iter().map(apex).collect();
        let options = SimulateOptions { frames: script.frames, ..options.clone() };
        Ok(Self { subject, options, wireframe, script, apexes })
    }

    /// Returns the number of frames.
    pub fn frame_count(&self) -> usize {
        self.script.frames
    }

    /// Returns the expressions, in order of time.
    pub fn expressions(&self) -> &[TrueExpression] {
        &self.script.expressions
    }

    /// Returns the first and last frame of each rest, without expression or speech. Blinks and head motion occur in rests.
    pub fn rests(&self) -> Vec<(usize, usize)> {
        let whole = |&(from, to): &(f64, f64)| {
            let (first, last) = (from.max(0.0).ceil() as usize, to.floor().max(0.0) as usize);
            (first, last.min(self.script.frames - 1))
        };
        self.script.rests.iter().map(whole).filter(|(first, last)| last > first).collect()
    }

    fn offsets(&self, t: f64) -> Vec<Vector3<f64>> {
        let who = self.subject.borrow();
        let (open, wide) = self.script.speech(t);
        let mut offsets = fap_offsets(&self.wireframe, who.fapus(), &speech_faps(open, wide));
        for (expression, apex) in self.script.expressions.iter().zip(&self.apexes) {
            let share = expression.intensity(t);
            if share > 0.0 {
                offsets.iter_mut().zip(apex).for_each(|(offset, full)| *offset += full * share);
            }
        }
        close_lids(who.neutral(), &mut offsets, self.script.closure(t, self.options.fps / FPS));
        offsets
    }

    fn pose(&self, t: f64) -> HeadPose {
        let middle = Point2::new(f64::from(self.options.width - 1) / 2.0, f64::from(self.options.height - 1) / 2.0);
        HeadPose::new(self.script.pose(t), middle, px_per_unit(&self.options))
    }

    /// Returns the picture and nodes of a frame, `frame` in `0..frame_count()`.
    pub fn frame(&self, frame: usize) -> SimulatedFrame {
        let t = frame as f64;
        see(self.subject.borrow(), &self.wireframe, &self.offsets(t), &self.pose(t), &self.options, frame)
    }
}

/// Returns the picture and nodes of a person whose nodes differ from neutral by `offsets`.
pub(super) fn see(
    who: &Subject,
    wireframe: &Wireframe,
    offsets: &[Vector3<f64>],
    pose: &HeadPose,
    options: &SimulateOptions,
    frame: usize,
) -> SimulatedFrame {
    let size = (options.width, options.height);
    let mut film = Film::new(size);
    film.expose(&render(who, &who.texture.folded(offsets), offsets, pose, size));
    let image = develop(film.exposure(who.appearance().background), options, who.index(), CODE, frame);
    let mut nodes: Vec<Point3<f64>> = who.neutral().iter().zip(offsets).map(|(n, d)| n + d).collect();
    place_followers(wireframe, &mut nodes);
    SimulatedFrame { image, nodes: nodes.iter().map(|n| pose.project(n)).collect() }
}

/// Returns the FAPs of a speaking mouth.
fn speech_faps(open: f64, wide: f64) -> FapFrame {
    let mut frame = FapFrame::default();
    // The jaw opens; the lower lip follows it, its sides less; the corners move out or in.
    let values = [
        (3, JAW * open),
        (5, -JAW * open),
        (10, -0.7 * JAW * open),
        (11, -0.7 * JAW * open),
        (6, WIDTH * wide),
        (7, WIDTH * wide),
    ];
    for (number, value) in values {
        if let Ok(fap) = FapNumber::try_from(number) {
            frame.set_value(fap, Some(value));
        }
    }
    frame
}

#[derive(Serialize)]
struct ExpressionRow {
    subject: String,
    sequence: &'static str,
    emotion: &'static str,
    onset_frame: i64,
    apex_frame: i64,
    offset_frame: i64,
}

#[derive(Serialize)]
struct RestRow {
    subject: String,
    sequence: &'static str,
    first_frame: usize,
    last_frame: usize,
}

/// Name of each subject's recording.
pub(super) const RECORDING_NAME: &str = "R1";

/// Writes a recording of every subject: `manifest.csv` with the column `segment`, the frames, and the truth in `truth/expressions.csv` and
/// `truth/rests.csv`, with frames counted from 1.
///
/// # Errors
/// As [`super::simulate_dataset`].
pub fn simulate_recordings(
    options: &SimulateOptions,
    out: &Path,
    force: bool,
    progress: impl Fn(usize, usize) + Sync,
) -> Result<DatasetSummary, SimulateError> {
    options.check()?;
    let record = begin(out, force)?;
    let subjects: Vec<Subject> =
        (0..options.subjects).into_par_iter().map(|index| Subject::new(options, index)).collect::<Result<_, _>>()?;
    let recordings: Vec<SimulatedRecording<&Subject>> =
        subjects.iter().map(|subject| SimulatedRecording::new(subject, options)).collect::<Result<_, _>>()?;
    let total = recordings.iter().map(SimulatedRecording::frame_count).sum();
    let done = AtomicUsize::new(0);
    let tick = || progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
    recordings.par_iter().try_for_each(|recording| write_frames(recording, options, &record, &tick))?;
    let (mut expressions, mut rests) = (Vec::new(), Vec::new());
    for recording in &recordings {
        let subject = recording.subject.id();
        expressions.extend(recording.expressions().iter().map(|e| ExpressionRow {
            subject: subject.clone(),
            sequence: RECORDING_NAME,
            emotion: e.emotion.label(),
            onset_frame: e.onset.floor() as i64 + 1,
            apex_frame: e.apex as i64 + 1,
            offset_frame: e.offset.ceil() as i64 + 1,
        }));
        rests.extend(recording.rests().into_iter().map(|(first, last)| RestRow {
            subject: subject.clone(),
            sequence: RECORDING_NAME,
            first_frame: first + 1,
            last_frame: last + 1,
        }));
    }
    record.write("truth/expressions.csv", |writer| csv_into(writer, expressions))?;
    record.write("truth/rests.csv", |writer| csv_into(writer, rests))?;
    let ids: Vec<String> = subjects.iter().map(Subject::id).collect();
    finish_recordings(record, out, options, &ids)?;
    Ok(DatasetSummary { sequences: recordings.len(), frames: total })
}

fn write_frames(
    recording: &SimulatedRecording<&Subject>,
    options: &SimulateOptions,
    record: &FolderRecord,
    tick: &(impl Fn() + Sync),
) -> Result<(), SimulateError> {
    let subject = recording.subject.id();
    (0..recording.frame_count()).into_par_iter().try_for_each(|frame| {
        let stem = format!("{subject}/{RECORDING_NAME}/{subject}_{RECORDING_NAME}_{:08}", frame + 1);
        write_picture(record, &stem, &recording.frame(frame).image, options.format)?;
        tick();
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options() -> SimulateOptions {
        SimulateOptions { subjects: 1, width: 160, height: 120, yaw_degrees: 10.0, ..SimulateOptions::default() }
    }

    #[test]
    fn every_emotion_is_shown_once_and_rests_lie_between() {
        let subject = Subject::new(&options(), 0).unwrap();
        let recording = SimulatedRecording::new(&subject, &options()).unwrap();
        let expressions = recording.expressions();
        assert_eq!(expressions.len(), 6);
        let mut shown: Vec<&str> = expressions.iter().map(|e| e.emotion.label()).collect();
        shown.sort_unstable();
        assert_eq!(shown, ["anger", "disgust", "fear", "happiness", "sadness", "surprise"]);
        for pair in expressions.windows(2) {
            let is_between = |&(first, last): &(usize, usize)| first as f64 >= pair[0].offset && last as f64 <= pair[1].onset;
            assert!(recording.rests().iter().any(is_between), "{pair:?} {:?}", recording.rests());
        }
        // At rest only the lids move.
        let (first, last) = recording.rests()[1];
        let moved = |t: usize| recording.offsets(t as f64)[31].norm();
        assert!((first..=last).all(|t| moved(t) < 1e-12));
        let apex = recording.expressions()[0].apex as usize;
        let size = |t: usize| recording.offsets(t as f64).iter().map(nalgebra::Vector3::norm).sum::<f64>();
        assert!(size(apex) > size(apex + 3) && size(apex) > 0.2, "{} {}", size(apex), size(apex + 3));
        assert_eq!(recording.frame(apex), SimulatedRecording::new(&subject, &options()).unwrap().frame(apex));
    }

    #[test]
    fn recordings_of_different_people_differ_and_some_begin_moving() {
        let scripts: Vec<Script> = (0..20).map(|subject| Script::new(&options(), subject)).collect();
        let moving = scripts.iter().filter(|s| s.expressions[0].onset < 0.0).count();
        assert!((2..=15).contains(&moving), "{moving}");
        assert!(scripts.iter().any(|s| !s.syllables.is_empty()) && scripts.iter().all(|s| s.frames > 200));
        assert!(scripts.iter().all(|s| s.blinks.iter().all(|b| *b < s.frames as f64)));
    }
}
