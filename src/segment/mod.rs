//! Rests and expressions in the features of a recording.
//!
//! A person who is filmed for minutes smiles, rests, speaks, blinks and looks about. What is looked for is every *expression*: an
//! onset from rest to an apex, and an offset. The signal is made of the intensities of action units ([`crate::features`]), which
//! know nothing of turns of the head:
//!
//! 1. The **rest** is the intensities that the person comes back to most: the frame in whose neighbourhood most frames lie (a
//!    kernel density). Intensities count from there.
//! 2. Each intensity is opened in time (erosion, then dilation, over [`SegmentOptions::shortest`]): blinks and the syllables of
//!    speech, which go up and down within that time, disappear, expressions stay.
//! 3. The **activity** of a frame is the Euclidean norm of what is left. A stretch above [`SegmentOptions::low`] that reaches
//!    [`SegmentOptions::high`] is an expression, one that sinks below half of its peak in between is several.
//! 4. The **apex** is the first frame with (nearly) the largest activity before opening, eyes left out; **onset** and **offset** are where
//!    that activity leaves and reaches what it is around the expression. The **neutral** frame is the calmest frame of the rest just before
//!    the onset, or, where the recording begins with the expression or follows on another one without a rest, of that behind the offset.

mod rest;
mod signal;

use serde::{Deserialize, Serialize};

use crate::features::{ACTION_UNITS, FrameFeatures, LIPS_PART};

pub use rest::densest;

/// Weight of an intensity in the activity. Blinks do not count, nor lips that part, which other units say, too; eyes that widen and a chin
/// that rises count half, for turns of the head look like them.
fn weight(number: u8) -> f64 {
    match number {
        45 | LIPS_PART => 0.0,
        5 | 17 => 0.5,
        _ => 1.0,
    }
}

/// Action units of the eyes, which do not say where an apex is: people blink in the middle of a smile.
const EYES: [u8; 3] = [5, 6, 7];

/// What a recording's frame is segmented by.
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
    /// Why it cannot be used; `None` for a good frame.
    pub reason: Option<String>,
    /// Share of the nodes that were seen, 0 to 1.
    pub confidence: f32,
    /// Yaw, pitch, roll, degrees.
    pub pose: [f32; 3],
    /// Intensities in the order of [`ACTION_UNITS`], 0 to 5.
    pub units: [f32; ACTION_UNITS.len()],
    /// Opening of the left and of the right eye over that of the neutral frame.
    pub eyes: [f32; 2],
    /// Distance of the inner lips over MNS0.
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

/// How expressions are told from rests. Activities are on the scale of action units, 0 to 5.
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
    /// Shortest expression, seconds; what goes up and down within it is a blink or speech.
    pub shortest: f64,
    /// Activity that an expression reaches.
    pub high: f64,
    /// Activity at which it begins and ends.
    pub low: f64,
    /// Activity up to which a frame is at rest.
    pub rest: f64,
}

impl Default for SegmentOptions {
    fn default() -> Self {
        Self { shortest: 0.36, high: 1.9, low: 1.0, rest: 1.4 }
    }
}

/// What a frame belongs to.
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
    /// On the way to an apex.
    Onset,
    /// At an apex.
    Apex,
    /// On the way back.
    Offset,
    /// None of these: speech, a blink, or a frame that cannot be used.
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

/// An expression; all but the confidence are places in the list of frames.
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
    /// A frame at rest before it, or after it where there is none before.
    pub neutral: usize,
    /// Where it leaves the rest.
    pub onset: usize,
    /// Where it is strongest.
    pub apex: usize,
    /// Where it is back at rest.
    pub offset: usize,
    /// Activity at the apex.
    pub strength: f64,
    /// How sure it is that this is an expression from rest to apex, 0 to 1.
    pub confidence: f64,
}

/// The rests and expressions of a list of frames.
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
    /// Place of the frame that is most at rest.
    pub rest: usize,
    /// Activity of every frame.
    pub activity: Vec<f64>,
    /// Phase of every frame.
    pub phases: Vec<Phase>,
    /// The expressions, in time.
    pub expressions: Vec<Expression>,
    /// Places of apexes that have no rest beside them.
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
    /// Nothing but motion.
    #[error(
        "found no neutral rest: the face keeps no expression for {seconds:.1} s between frames {first} and {last}; name a neutral \
         frame and mark it, or cut the recording where the person rests"
    )]
    NoRest {
        /// Seconds that a rest lasts at least.
        seconds: f64,
        /// First frame number.
        first: u32,
        /// Last frame number.
        last: u32,
    },
    /// Too few frames to speak of a rest.
    #[error("only {found} of {frames} frames are usable, too few for a rest and an expression")]
    TooFew {
        /// Frames that can be used.
        found: usize,
        /// Frames.
        frames: usize,
    },
}

/// Time that the person is at rest at least, seconds in all.
const LEAST_REST: f64 = 0.4;
/// Seconds at least from the start to the end of what is segmented.
const SHORTEST_PIECE: f64 = 1.0;
/// Share of the way from the least activity near an apex to that at the apex at which it begins and ends.
const EDGE: f64 = 0.1;
/// Seconds to either side of an apex in which the least activity is looked for.
const NEAR: f64 = 2.0;
/// The apex is the first frame of those before the largest activity that have this share of it: expressions that are held fade slowly.
const AT_APEX: f64 = 0.985;
/// Most change of the activity of a face at rest, over these seconds to either side.
const STILL: (f64, f64) = (0.4, 0.12);
/// A rest behind an expression is taken for the one before it where it is calmer by more than this share of what is a rest.
const CALMER: f64 = 0.5;
/// Share of the strength of the stronger of two expressions below which the activity falls between them.
const VALLEY: f64 = 0.5;
/// Opening of the eyes, over that at rest, from which they count as open.
const OPEN: f32 = 0.88;
/// Share of the activity at the apex from which a frame counts as apex.
const NEAR_APEX: f64 = 0.95;
/// Seconds before an onset, or behind an offset, among which the neutral frame is the calmest.
const MOMENT: f64 = 0.6;
/// An expression goes up once and down once. Way that the activity goes over its height, above which it is speech.
const MOST_WAY: f64 = 4.5;

/// Finds rests and expressions in frames that follow each other.
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
/// [`SegmentError`] when there is no rest.
pub fn segment(frames: &[RecordedFrame], fps: f64, options: &SegmentOptions) -> Result<Segmentation, SegmentError> {
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
    let (rest, near) = rest::rest(&vectors, may_rest).ok_or_else(no_rest)?;
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

/// Whether the eyes are open in every frame.
fn open_eyes(frames: &[RecordedFrame]) -> Vec<bool> {
    let mut openings: Vec<f64> =
        frames.iter().filter(|f| f.reason.is_none()).map(|f| f64::from(f.eyes[0].min(f.eyes[1]))).collect();
    let usual = crate::robust::median(&mut openings).unwrap_or(1.0) as f32;
    frames.iter().map(|f| f.eyes[0].min(f.eyes[1]) >= OPEN * usual).collect()
}

type Run = std::ops::RangeInclusive<usize>;

/// Runs that reach `high`; those that sink below half of their peak in between are several.
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
        // The lowest place between two parts parts them.
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

/// What expressions are made of.
struct Found<'a> {
    activity: &'a [f64],
    lasting: &'a [f64],
    is_rest: &'a [bool],
    options: &'a SegmentOptions,
    frames: &'a [RecordedFrame],
    fps: f64,
}

impl Found<'_> {
    /// The expression of a run; `free` is what lies between the runs around it. `None` for speech, the apex where there is no rest.
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
        let neutral = self.neutral(onset, offset, free).ok_or(apex)?;
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

    /// The calmest frame of the moment of rest before an onset, or of the one behind an offset; `None` without a rest.
    fn neutral(&self, onset: usize, offset: usize, free: (usize, usize)) -> Option<usize> {
        let moment = self.frames_in(MOMENT);
        let calmest = |rest: &mut dyn Iterator<Item = usize>| rest.min_by(|&a, &b| self.activity[a].total_cmp(&self.activity[b]));
        let last = (free.0..=onset).rev().find(|&t| self.is_rest[t]);
        let before = last.and_then(|last| {
            let first = free.0.max(onset.saturating_sub(moment)).min(last);
            calmest(&mut (first..=last).rev().take_while(|&t| self.is_rest[t]))
        });
        let first = (offset..free.1).find(|&t| self.is_rest[t]);
        let after = first.and_then(|first| {
            let end = free.1.min(offset + moment).max(first + 1);
            calmest(&mut (first..end).take_while(|&t| self.is_rest[t]))
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
