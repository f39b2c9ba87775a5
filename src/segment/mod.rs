//! Finds rests and expressions in the features of a recording.
//!
//! A person who is filmed for minutes smiles, rests, speaks, blinks and looks around. Every *expression* is found: an onset from rest to an
//! apex, and an offset. The signal consists of the intensities of action units ([`crate::features`]), which do not depend on head pose:
//!
//! 1. The **rest** is the face to which the person returns most often: the frame with the highest kernel density of intensities around it.
//!    Intensities are measured from there.
//! 2. Each intensity is opened in time (erosion, then dilation, over [`SegmentOptions::shortest`]). This removes blinks and syllables,
//!    which rise and fall within that time, and keeps expressions.
//! 3. The Euclidean norm of the opened intensities tells where expressions are: stretches above [`SegmentOptions::low`] that reach
//!    [`SegmentOptions::high`]. A stretch that falls below half of its peak in between is split.
//! 4. The **activity** of a frame is the Euclidean norm of the intensities before opening, without the eyes. The **apex** is the first
//!    frame with (nearly) the largest activity. **Onset** and **offset** are where the activity leaves its level around the expression and
//!    returns to it.
//! 5. The **neutral** frame is the calmest frame of the rest just before the onset. If there is none (the recording begins with the
//!    expression, or another one precedes it without a rest), it is taken from the rest after the offset.

mod rest;
mod signal;

use serde::{Deserialize, Serialize};

use crate::features::{ACTION_UNITS, FrameFeatures, LIPS_PART};

pub use rest::densest;

/// Weight of an action unit in the activity. Blinks and parted lips have none; other units cover the latter. Widened eyes and a raised chin
/// have half, because head rotation resembles them.
fn weight(number: u8) -> f64 {
    match number {
        45 | LIPS_PART => 0.0,
        5 | 17 => 0.5,
        _ => 1.0,
    }
}

/// Action units of the eyes, which are ignored in locating an apex, since people blink in the middle of a smile.
const EYES: [u8; 3] = [5, 6, 7];

/// Data of one recorded frame for segmentation.
///
/// ```
/// use grimace::segment::RecordedFrame;
///
/// // Action unit 12 is the ninth of the list.
/// let mut units = [0.0; 21];
/// units[8] = 4.0;
/// let smiling = RecordedFrame { number: 1, reason: None, confidence: 1.0, pose: [0.0; 3], units, eyes: [1.0; 2], mouth: 0.0 };
/// assert!(smiling.reason.is_none() && smiling.units[8] == 4.0);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedFrame {
    /// Frame number.
    pub number: u32,
    /// Why it is unusable; `None` for a good frame.
    pub reason: Option<String>,
    /// Share of visible nodes, 0 to 1.
    pub confidence: f32,
    /// Yaw, pitch, roll, degrees.
    pub pose: [f32; 3],
    /// Intensities in the order of [`ACTION_UNITS`], 0 to 5.
    pub units: [f32; ACTION_UNITS.len()],
    /// Opening of the left and of the right eye divided by that of the neutral frame.
    pub eyes: [f32; 2],
    /// Distance of the inner lips divided by MNS0.
    pub mouth: f32,
}

impl From<&FrameFeatures> for RecordedFrame {
    fn from(row: &FrameFeatures) -> Self {
        let unit = |k: usize| row.action_units.get(k).map_or(0.0, |unit| unit.value as f32);
        Self {
            number: row.frame,
            reason: row.reason.clone(),
            confidence: row.confidence as f32,
            pose: row.pose.map(|angle| angle as f32),
            units: std::array::from_fn(unit),
            eyes: row.eye_opening.map(|opening| opening as f32),
            mouth: row.mouth_opening as f32,
        }
    }
}

/// Thresholds that separate expressions from rests. Activities are on the scale of action units, 0 to 5.
///
/// ```
/// # let frame = |t: u16| {
/// #     let mut units = [0.0; 21];
/// #     units[8] = (4.0 - f32::from(t.abs_diff(55)) * 4.0 / if t < 55 { 15.0 } else { 20.0 }).max(0.0);
/// #     let (number, eyes, pose) = (u32::from(t) + 1, [1.0; 2], [0.0; 3]);
/// #     grimace::segment::RecordedFrame { number, reason: None, confidence: 1.0, pose, units, eyes, mouth: 0.0 }
/// # };
/// # let recording: Vec<_> = (0..100).map(frame).collect();
/// use grimace::segment::{SegmentOptions, segment};
///
/// // Somebody smiles in the middle of `recording`, most in its frame 56.
/// // Only an activity above the smile's would count.
/// let options = SegmentOptions { high: 20.0, ..SegmentOptions::default() };
/// assert!(segment(&recording, 25.0, &options)?.expressions.is_empty());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SegmentOptions {
    /// Shortest expression, seconds; shorter ones are blinks or speech.
    pub shortest: f64,
    /// Norm of the opened intensities that an expression must reach.
    pub high: f64,
    /// Norm of the opened intensities at which an expression begins and ends.
    pub low: f64,
    /// Largest activity of a frame at rest.
    pub rest: f64,
}

impl Default for SegmentOptions {
    fn default() -> Self {
        Self { shortest: 0.36, high: 1.7, low: 1.0, rest: 1.4 }
    }
}

/// Phase of a frame.
///
/// ```
/// # let frame = |t: u16| {
/// #     let mut units = [0.0; 21];
/// #     units[8] = (4.0 - f32::from(t.abs_diff(55)) * 4.0 / if t < 55 { 15.0 } else { 20.0 }).max(0.0);
/// #     let (number, eyes, pose) = (u32::from(t) + 1, [1.0; 2], [0.0; 3]);
/// #     grimace::segment::RecordedFrame { number, reason: None, confidence: 1.0, pose, units, eyes, mouth: 0.0 }
/// # };
/// # let recording: Vec<_> = (0..100).map(frame).collect();
/// use grimace::segment::{Phase, segment};
///
/// // Somebody smiles in the middle of `recording`, most in its frame 56.
/// let found = segment(&recording, 25.0, &Default::default())?;
/// assert_eq!([10, 48, 55, 70].map(|k: usize| found.phases[k]), [Phase::Rest, Phase::Onset, Phase::Apex, Phase::Offset]);
/// assert_eq!(Phase::Rest.name(), "rest");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// At rest.
    Rest,
    /// Between rest and apex.
    Onset,
    /// At an apex.
    Apex,
    /// Between apex and rest.
    Offset,
    /// None of these: speech, a blink, or an unusable frame.
    Other,
}

impl Phase {
    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rest => "rest",
            Self::Onset => "onset",
            Self::Apex => "apex",
            Self::Offset => "offset",
            Self::Other => "other",
        }
    }
}

/// An expression. Frames are given as indices in the list of frames.
///
/// ```
/// # let frame = |t: u16| {
/// #     let mut units = [0.0; 21];
/// #     units[8] = (4.0 - f32::from(t.abs_diff(55)) * 4.0 / if t < 55 { 15.0 } else { 20.0 }).max(0.0);
/// #     let (number, eyes, pose) = (u32::from(t) + 1, [1.0; 2], [0.0; 3]);
/// #     grimace::segment::RecordedFrame { number, reason: None, confidence: 1.0, pose, units, eyes, mouth: 0.0 }
/// # };
/// # let recording: Vec<_> = (0..100).map(frame).collect();
/// use grimace::segment::{Expression, segment};
///
/// // Somebody smiles in the middle of `recording`, most in its frame 56.
/// let found = segment(&recording, 25.0, &Default::default())?;
/// let Expression { neutral, onset, apex, offset, .. } = found.expressions[0];
/// assert!(neutral <= onset && onset < apex && apex < offset);
/// assert!(apex.abs_diff(55) <= 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expression {
    /// Index of the neutral frame: at rest before the expression, or after it if there is no rest before.
    pub neutral: usize,
    /// Index of the frame in which it leaves the rest.
    pub onset: usize,
    /// Index of the frame in which it is strongest.
    pub apex: usize,
    /// Index of the frame in which it is back at rest.
    pub offset: usize,
    /// Activity at the apex.
    pub strength: f64,
    /// Confidence that it is an expression from rest to apex, 0 to 1.
    pub confidence: f64,
}

/// Rests and expressions in a list of frames.
///
/// ```
/// # let frame = |t: u16| {
/// #     let mut units = [0.0; 21];
/// #     units[8] = (4.0 - f32::from(t.abs_diff(55)) * 4.0 / if t < 55 { 15.0 } else { 20.0 }).max(0.0);
/// #     let (number, eyes, pose) = (u32::from(t) + 1, [1.0; 2], [0.0; 3]);
/// #     grimace::segment::RecordedFrame { number, reason: None, confidence: 1.0, pose, units, eyes, mouth: 0.0 }
/// # };
/// # let recording: Vec<_> = (0..100).map(frame).collect();
/// use grimace::segment::segment;
///
/// // Somebody smiles in the middle of `recording`, most in its frame 56.
/// let found = segment(&recording, 25.0, &Default::default())?;
/// assert_eq!((found.phases.len(), found.expressions.len(), found.without_rest.len()), (100, 1, 0));
/// assert!(found.activity[55] > found.activity[found.rest]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Segmentation {
    /// Index of the frame with the highest density, which defines the rest.
    pub rest: usize,
    /// Activity of every frame.
    pub activity: Vec<f64>,
    /// Phase of every frame.
    pub phases: Vec<Phase>,
    /// Expressions in order of time.
    pub expressions: Vec<Expression>,
    /// Indices of apexes without an adjacent rest.
    pub without_rest: Vec<usize>,
}

/// Why frames cannot be segmented.
///
/// ```
/// use grimace::segment::{SegmentError, segment};
///
/// assert_eq!(segment(&[], 25.0, &Default::default()), Err(SegmentError::TooFew { found: 0, frames: 0 }));
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SegmentError {
    /// The recording has no rest.
    #[error(
        "found no neutral rest: the face keeps no expression for {seconds:.1} s between frames {first} and {last}; name a neutral \
         frame and mark it, or cut the recording where the person rests"
    )]
    NoRest {
        /// Minimum duration of a rest in seconds.
        seconds: f64,
        /// First frame number.
        first: u32,
        /// Last frame number.
        last: u32,
    },
    /// Too few frames for a rest.
    #[error("only {found} of {frames} frames are usable, too few for a rest and an expression")]
    TooFew {
        /// Usable frames.
        found: usize,
        /// Frames.
        frames: usize,
    },
    /// A frame rate or option out of range.
    #[error("{name} is {value}; it must be {allowed}")]
    Option {
        /// The frame rate, or the field of the options.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
}

/// Minimum total time at rest, seconds.
const LEAST_REST: f64 = 0.4;
/// Minimum duration of the frames to be segmented, seconds.
const SHORTEST_PIECE: f64 = 1.0;
/// Share of the rise from the lowest activity near an apex to the apex at which an expression begins and ends.
const EDGE: f64 = 0.1;
/// Seconds on either side of an apex in which the lowest activity is searched.
const NEAR: f64 = 2.0;
/// Share of the largest activity that frames must have to count as apex. The apex is the first of those that lead up to the maximum,
/// because held expressions fade slowly.
const AT_APEX: f64 = 0.985;
/// Largest change of activity of a face at rest, and the seconds on either side over which it is measured.
const STILL: (f64, f64) = (0.4, 0.12);
/// Share of [`SegmentOptions::rest`] by which the rest after an expression must be calmer than the rest before to be used instead.
const CALMER: f64 = 0.5;
/// Share of a run's peak below which the activity must fall to split it into several expressions.
const VALLEY: f64 = 0.5;
/// Eye opening, relative to its median, from which the eyes count as open.
const OPEN: f32 = 0.88;
/// Share of the activity at the apex from which a frame counts as apex.
const NEAR_APEX: f64 = 0.95;
/// Seconds before an onset, or after an offset, in which the calmest frame becomes the neutral frame.
const MOMENT: f64 = 0.6;
/// Largest ratio of the total variation of the activity to its height. An expression rises once and falls once; above this ratio it is
/// speech.
const MOST_WAY: f64 = 4.5;

/// Finds rests and expressions in consecutive frames.
///
/// ```
/// use grimace::segment::{RecordedFrame, segment};
///
/// // A smile in a recording of four seconds: action unit 12, the ninth of the list, goes up and down again.
/// let frame = |t: u16| {
///     let mut units = [0.0; 21];
///     units[8] = (4.0 - f32::from(t.abs_diff(55)) / 4.0).max(0.0);
///     let (number, pose, eyes) = (u32::from(t) + 1, [0.0; 3], [1.0; 2]);
///     RecordedFrame { number, reason: None, confidence: 1.0, pose, units, eyes, mouth: 0.0 }
/// };
/// let recording: Vec<RecordedFrame> = (0..100).map(frame).collect();
/// let found = segment(&recording, 25.0, &Default::default())?;
/// assert!(found.expressions.len() == 1 && found.expressions[0].apex.abs_diff(55) <= 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`SegmentError`] when there is no rest, too few frames are usable, or the frame rate or an option is out of range.
pub fn segment(frames: &[RecordedFrame], fps: f64, options: &SegmentOptions) -> Result<Segmentation, SegmentError> {
    segment_with(frames, fps, options, |vectors, may_rest| rest::rest(vectors, may_rest))
}

/// Strength of the expression of a frame: the norm of the intensities of the units that count here, those of the eyes left out.
pub(crate) fn strength(frame: &RecordedFrame) -> f64 {
    let counts = |number: u8| !EYES.contains(&number);
    let squares = ACTION_UNITS.iter().zip(frame.units).filter(|(unit, _)| counts(unit.number));
    squares.map(|(unit, value)| (f64::from(value) * weight(unit.number)).powi(2)).sum::<f64>().sqrt()
}

/// Finds the rests and expressions of frames that were measured against the rest of another part of the recording: frames at rest have low
/// intensities here, however often the person returns to them.
///
/// # Errors
/// As [`segment`].
pub(crate) fn segment_at_known_rest(
    frames: &[RecordedFrame],
    fps: f64,
    options: &SegmentOptions,
) -> Result<Segmentation, SegmentError> {
    segment_with(frames, fps, options, |vectors, may_rest| rest::known(vectors, may_rest, options.rest as f32))
}

fn segment_with(
    frames: &[RecordedFrame],
    fps: f64,
    options: &SegmentOptions,
    find_rest: impl FnOnce(&[Vec<f32>], &dyn Fn(usize) -> bool) -> Option<(usize, Vec<usize>)>,
) -> Result<Segmentation, SegmentError> {
    let SegmentOptions { shortest, high, low, rest } = *options;
    if !(fps.is_finite() && fps > 0.0) {
        return Err(SegmentError::Option { name: "the frame rate", value: fps, allowed: "a finite number above 0" });
    }
    let all = [("`shortest`", shortest), ("`high`", high), ("`low`", low), ("`rest`", rest)];
    if let Some((name, value)) = all.into_iter().find(|(_, value)| !(*value >= 0.0)) {
        return Err(SegmentError::Option { name, value, allowed: "at least 0" });
    }
    let usable = frames.iter().filter(|f| f.reason.is_none()).count();
    if (usable as f64) < SHORTEST_PIECE * fps {
        return Err(SegmentError::TooFew { found: usable, frames: frames.len() });
    }
    let counted: Vec<usize> = (0..ACTION_UNITS.len()).filter(|&k| weight(ACTION_UNITS[k].number) > 0.0).collect();
    let weighted = |&k: &usize| {
        let weight = weight(ACTION_UNITS[k].number);
        signal::smooth(&signal::held(frames, k), fps).into_iter().map(|value| value * weight).collect()
    };
    let channels: Vec<Vec<f64>> = counted.iter().map(weighted).collect();
    let vectors: Vec<Vec<f32>> = (0..frames.len()).map(|t| channels.iter().map(|channel| channel[t] as f32).collect()).collect();
    let eyes = open_eyes(frames);
    let may_rest = |t: usize| frames[t].reason.is_none() && eyes[t];
    let no_rest = || SegmentError::NoRest {
        seconds: LEAST_REST,
        first: frames.first().map_or(0, |f| f.number),
        last: frames.last().map_or(0, |f| f.number),
    };
    let (rest, near) = find_rest(&vectors, &may_rest).ok_or_else(no_rest)?;
    if (near.len() as f64) < LEAST_REST * fps {
        return Err(no_rest());
    }
    let above: Vec<Vec<f64>> = channels
        .iter()
        .map(|channel| {
            let at_rest = near.iter().map(|&t| channel[t]).sum::<f64>() / near.len() as f64;
            channel.iter().map(|value| (value - at_rest).max(0.0)).collect()
        })
        .collect();
    let width = ((options.shortest * fps).round() as usize).max(1);
    let opened: Vec<Vec<f64>> = above.iter().map(|channel| signal::opened(channel, width)).collect();
    let lasting = signal::norm(&opened, |_| true);
    let is_eye = |place: usize| counted.get(place).is_some_and(|&k| EYES.contains(&ACTION_UNITS[k].number));
    let activity = signal::norm(&above, |place| !is_eye(place));
    let runs = split_runs(&signal::runs(&lasting, options.low), &lasting, options.high);
    let (change, around) = (STILL.0, ((STILL.1 * fps).round() as usize).max(1));
    let is_still = |t: usize| {
        let (before, after) = (t.saturating_sub(around), (t + around).min(frames.len() - 1));
        (activity[after] - activity[before]).abs() <= change
    };
    let is_rest: Vec<bool> = (0..frames.len()).map(|t| may_rest(t) && activity[t] <= options.rest && is_still(t)).collect();
    let found = Found { activity: &activity, lasting: &lasting, is_rest: &is_rest, options, frames, fps };
    let mut expressions = Vec::new();
    let mut without_rest = Vec::new();
    for (k, run) in runs.iter().enumerate() {
        let free = (
            k.checked_sub(1).and_then(|k| runs.get(k)).map_or(0, |before| *before.end() + 1),
            runs.get(k + 1).map_or(frames.len(), |after| *after.start()),
        );
        match found.expression(run, free) {
            Ok(Some(expression)) => expressions.push(expression),
            Ok(None) => {}
            Err(apex) => without_rest.push(apex),
        }
    }
    let phases = phases(&expressions, &is_rest, &activity);
    Ok(Segmentation { rest, activity, phases, expressions, without_rest })
}

/// Tells for every frame whether the eyes are open.
fn open_eyes(frames: &[RecordedFrame]) -> Vec<bool> {
    let mut openings: Vec<f64> =
        frames.iter().filter(|f| f.reason.is_none()).map(|f| f64::from(f.eyes[0].min(f.eyes[1]))).collect();
    let usual = crate::robust::median(&mut openings).unwrap_or(1.0) as f32;
    frames.iter().map(|f| f.eyes[0].min(f.eyes[1]) >= OPEN * usual).collect()
}

type Run = std::ops::RangeInclusive<usize>;

/// Returns the runs that reach `high`, split where they fall below half of their peak.
fn split_runs(runs: &[Run], lasting: &[f64], high: f64) -> Vec<Run> {
    let peak = |run: &Run| lasting[run.clone()].iter().copied().fold(0.0, f64::max);
    let mut out = Vec::new();
    for run in runs.iter().filter(|run| peak(run) >= high) {
        let limit = VALLEY * peak(run);
        let parts: Vec<Run> = signal::runs(&lasting[run.clone()], limit)
            .into_iter()
            .map(|part| run.start() + part.start()..=run.start() + part.end())
            .filter(|part| peak(part) >= high)
            .collect();
        if parts.len() < 2 {
            out.push(run.clone());
            continue;
        }
        // The split is at the lowest value between two parts.
        let mut start = *run.start();
        for pair in parts.windows(2) {
            let between = *pair[0].end()..=*pair[1].start();
            let lowest = between.min_by(|&a, &b| lasting[a].total_cmp(&lasting[b])).unwrap_or(*pair[0].end());
            out.push(start..=lowest);
            start = lowest + 1;
        }
        out.push(start..=*run.end());
    }
    out
}

/// Data from which expressions are determined.
struct Found<'a> {
    activity: &'a [f64],
    lasting: &'a [f64],
    is_rest: &'a [bool],
    options: &'a SegmentOptions,
    frames: &'a [RecordedFrame],
    fps: f64,
}

impl Found<'_> {
    /// The expression of a run; `None` for speech. `free` is the range between the adjacent runs.
    ///
    /// # Errors
    /// The index of the apex, if there is no rest.
    fn expression(&self, run: &Run, free: (usize, usize)) -> Result<Option<Expression>, usize> {
        let at = |t: usize| self.activity[t];
        let peak = run.clone().max_by(|&a, &b| at(a).total_cmp(&at(b)).then(b.cmp(&a))).unwrap_or(*run.start());
        let strength = at(peak);
        let apex = (*run.start()..=peak).rev().take_while(|&t| at(t) >= AT_APEX * strength).last().unwrap_or(peak);
        let near = self.frames_in(NEAR);
        let edge = |range: std::ops::Range<usize>| {
            let least = range.map(at).fold(strength, f64::min);
            least + EDGE * (strength - least)
        };
        let rising = edge(free.0.max(apex.saturating_sub(near))..apex);
        let falling = edge(peak..free.1.min(peak + near));
        let onset = (free.0..apex).rev().find(|&t| at(t) <= rising).unwrap_or(free.0.min(apex));
        let offset = (peak..free.1).find(|&t| at(t) <= falling).unwrap_or(free.1.saturating_sub(1).max(peak));
        let way: f64 = self.activity[onset..=offset].windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
        if way > MOST_WAY * strength {
            return Ok(None);
        }
        let neutral = self.neutral(onset, apex, offset, free).ok_or(apex)?;
        let span = neutral.min(apex)..=neutral.max(apex);
        let usable = span.clone().filter(|&t| self.frames[t].reason.is_none()).count() as f64 / span.count() as f64;
        let lasting = self.lasting[run.clone()].iter().copied().fold(0.0, f64::max) / self.options.high;
        let clear = 1.0 - 0.5 * (at(neutral) / self.options.rest).min(1.0);
        let confidence = (1.0 - (-0.7 * lasting * lasting).exp()) * clear * usable;
        Ok(Some(Expression { neutral, onset, apex, offset, strength, confidence }))
    }

    fn frames_in(&self, seconds: f64) -> usize {
        ((seconds * self.fps).round() as usize).max(1)
    }

    /// The calmest frame of the rest just before an onset or just after an offset; `None` without a rest. A weak expression at the edge of
    /// its range may itself look like rest: the apex is never the neutral frame.
    fn neutral(&self, onset: usize, apex: usize, offset: usize, free: (usize, usize)) -> Option<usize> {
        let moment = self.frames_in(MOMENT);
        let calmest = |rest: &mut dyn Iterator<Item = usize>| rest.min_by(|&a, &b| self.activity[a].total_cmp(&self.activity[b]));
        let rests = |t: usize| self.is_rest[t] && t != apex;
        let last = (free.0..=onset).rev().find(|&t| rests(t));
        let before = last.and_then(|last| {
            let first = free.0.max(onset.saturating_sub(moment)).min(last);
            calmest(&mut (first..=last).rev().take_while(|&t| rests(t)))
        });
        let first = (offset..free.1).find(|&t| rests(t));
        let after = first.and_then(|first| {
            let end = free.1.min(offset + moment).max(first + 1);
            calmest(&mut (first..end).take_while(|&t| rests(t)))
        });
        match (before, after) {
            (Some(before), Some(after)) => {
                let is_calmer = self.activity[after] + CALMER * self.options.rest < self.activity[before];
                Some(if is_calmer { after } else { before })
            }
            (before, after) => before.or(after),
        }
    }
}

fn phases(expressions: &[Expression], is_rest: &[bool], activity: &[f64]) -> Vec<Phase> {
    let mut phases: Vec<Phase> = is_rest.iter().map(|&rest| if rest { Phase::Rest } else { Phase::Other }).collect();
    for e in expressions {
        phases[e.onset + 1..=e.apex].fill(Phase::Onset);
        phases[e.apex..e.offset.max(e.apex)].fill(Phase::Offset);
        let near = |t: &usize| activity[*t] >= NEAR_APEX * e.strength;
        let first = (e.onset..=e.apex).rev().take_while(near).last().unwrap_or(e.apex);
        let last = (e.apex..=e.offset).take_while(near).last().unwrap_or(e.apex);
        phases[first..=last].fill(Phase::Apex);
    }
    phases
}

#[cfg(test)]
mod tests;
