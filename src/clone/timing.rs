//! Timing of a clone: which moment of the source each frame shows.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::{CloneError, SourceKind, SourceMotion};
use crate::{
    geometry::Similarity,
    interpolation::{self, Even, FPS, MOST_EVEN, cubic, slopes, smooth_step},
    wireframe::Wireframe,
};

/// Largest number of frames of a clone.
pub const MAX_FRAMES: usize = 20_000;
/// Seconds from neutral to apex of a representative, which has no timing of its own.
pub const MODEL_SECONDS: f64 = 1.0;

/// Time course of the motion.
///
/// ```
/// use grimace::clone::{Ease, Timing};
///
/// let timing = Timing { ease: Ease::InOut, ..Timing::default() };
/// assert_eq!(serde_json::to_value(timing)?["ease"], "in-out");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ease {
    /// As in the source.
    #[default]
    Linear,
    /// Starts slowly.
    In,
    /// Ends slowly.
    Out,
    /// Starts and ends slowly.
    InOut,
    /// Like a face: a quick onset, the upper face a little before the lower one, then an apex that is held and settles.
    Natural,
}

/// The natural course: fraction of the time that the onset takes, fraction of the motion within it, and delay of the lower face against the
/// upper one as a fraction of the time.
const ONSET: f64 = 0.62;
const BROUGHT: f64 = 0.95;
const BEHIND: f64 = 0.07;

impl Ease {
    /// Returns the fraction of the motion after a fraction of the time, both 0 to 1.
    fn apply(self, t: f64) -> f64 {
        match self {
            Self::Linear => t,
            Self::In => t * t,
            Self::Out => t * (2.0 - t),
            Self::InOut => t * t * (3.0 - 2.0 * t),
            Self::Natural => {
                // The minimum-jerk course (Flash and Hogan, J. Neurosci. 1985), then a slow course through the rest.
                let s = (t / ONSET).clamp(0.0, 1.0);
                BROUGHT * s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s) + (1.0 - BROUGHT) * t * t * (3.0 - 2.0 * t)
            }
        }
    }
}

/// Frame rate, duration and time course of a clone.
///
/// ```
/// use grimace::clone::{CloneOptions, Timing};
///
/// // Two seconds with 10 frames each: 21 frames, with the last.
/// let timing = Timing { fps: Some(10.0), duration: Some(2.0), ..Timing::default() };
/// let options = CloneOptions { timing, ..CloneOptions::default() };
/// assert!(!options.timing.back);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Frames per second; `None` for the source's.
    pub fps: Option<f64>,
    /// Seconds from the first to the last frame of the source; `None` for the source's.
    pub duration: Option<f64>,
    /// Time course.
    pub ease: Ease,
    /// Whether to return to the first frame after the last one, so that the film repeats without a jump.
    pub back: bool,
}

/// The source at one point in time.
#[derive(Clone, Debug)]
pub struct Moment {
    /// Offsets from neutral, as in [`SourceMotion::offsets`].
    pub offsets: Vec<Vector2<f64>>,
    /// Head motion.
    pub head: Similarity,
    /// Yaw, pitch and roll of the head relative to the source's first frame, degrees, if known.
    pub turn: Option<[f64; 3]>,
    /// Index of the source frame nearest in time.
    pub nearest: usize,
}

impl Timing {
    /// Returns the frames per second and the moments of all frames, including the first and the last frame of the source.
    ///
    /// # Errors
    /// [`CloneError::TooManyFrames`]; [`CloneError::TooFewFrames`] if duration and rate contradict each other;
    /// [`CloneError::Number`] for a duration or rate that is no number above 0; [`CloneError`] for a source whose parts do not
    /// fit together.
    pub(crate) fn moments(&self, source: &SourceMotion) -> Result<(f64, Vec<Moment>), CloneError> {
        source.check_parts()?;
        for (what, value) in
            [("the frame rate of the clone", self.fps), ("the duration of the clone, in seconds,", self.duration)]
        {
            if let Some(value) = value.filter(|value| !(value.is_finite() && *value > 0.0)) {
                return Err(CloneError::Number { what, value, allowed: "a finite number above 0" });
            }
        }
        let fps = self.fps.or(source.fps).unwrap_or(f64::from(FPS));
        let seconds = self.duration.unwrap_or(source.seconds());
        let steps = (seconds * fps).round();
        if steps < 1.0 && (self.fps.is_some() || self.duration.is_some()) {
            return Err(CloneError::TooFewFrames { seconds, fps });
        }
        let count = steps.max(1.0) + 1.0;
        if !(count <= MAX_FRAMES as f64) {
            return Err(CloneError::TooManyFrames { frames: count, most: MAX_FRAMES });
        }
        let last = count as usize - 1;
        let mut times: Vec<f64> = (0..=last).map(|k| k as f64 / last as f64).collect();
        if self.back {
            let forth = times.clone();
            times.extend(forth[1..forth.len() - 1].iter().rev());
        }
        let course = source.course();
        let place = |time: f64| source.place(self.ease.apply(time));
        let low = if self.ease == Ease::Natural { lowness(source.offsets[0].len()) } else { Vec::new() };
        let moment = |time: f64| {
            let mut moment = course.at(place(time));
            for (node, &low) in low.iter().enumerate().filter(|(_, low)| **low > 0.0) {
                // No delay at times 0 and 1: all nodes start and arrive together.
                let behind = BEHIND * low * (4.0 * time * (1.0 - time));
                moment.offsets[node] = course.offset(node, place(time - behind));
            }
            moment
        };
        Ok((fps, times.into_iter().map(moment).collect()))
    }
}

/// Position of each node between the eyes (0 there and above) and the mouth (1 there and below). Empty for a wireframe other than Candide-3.
fn lowness(count: usize) -> Vec<f64> {
    let wireframe = Wireframe::candide3();
    let height = |n: usize| wireframe.vertices()[n].y;
    let (eyes, mouth) = (f64::midpoint(height(23), height(56)), f64::midpoint(height(31), height(64)));
    if wireframe.vertices().len() != count {
        return Vec::new();
    }
    (0..count).map(|n| smooth_step(0.0, 1.0, (eyes - height(n)) / (eyes - mouth))).collect()
}

impl SourceMotion {
    /// The default time course: natural for a representative, whose five frames have no timing; linear for tracks and FAP files.
    pub fn ease(&self) -> Ease {
        match self.kind {
            SourceKind::Model => Ease::Natural,
            _ => Ease::Linear,
        }
    }

    /// Seconds from the first to the last frame; 1 for a representative, which has no timing of its own.
    pub fn seconds(&self) -> f64 {
        match self.kind {
            SourceKind::Model => MODEL_SECONDS,
            _ => match self.times.as_ref().and_then(|times| times.last()) {
                Some(&last) => last,
                None => self.frame_count().saturating_sub(1) as f64 / self.fps.unwrap_or(f64::from(FPS)),
            },
        }
    }

    /// Returns the motion resampled to evenly spaced frames at its own rate.
    ///
    /// # Errors
    /// [`CloneError::TooManyBetween`] if this would take too many frames between its own; [`CloneError`] for parts that do not
    /// fit together.
    pub fn evenly(&self) -> Result<Self, CloneError> {
        self.check_parts()?;
        let Some(Even { last, fps }) = self.even()? else { return Ok(self.clone()) };
        let course = self.course();
        let moments: Vec<Moment> = (0..=last).map(|k| course.at(self.place(k as f64 / last as f64))).collect();
        Ok(Self {
            head: moments.iter().map(|moment| moment.head).collect(),
            turns: moments.iter().filter_map(|moment| moment.turn).collect(),
            frames: moments.iter().filter_map(|moment| self.frames.get(moment.nearest).cloned()).collect(),
            offsets: moments.into_iter().map(|moment| moment.offsets).collect(),
            fps: Some(fps),
            times: None,
            ..self.clone()
        })
    }

    /// Number of frames of [`SourceMotion::evenly`].
    ///
    /// # Errors
    /// As [`SourceMotion::evenly`].
    pub(crate) fn even_frame_count(&self) -> Result<usize, CloneError> {
        Ok(self.even()?.map_or(self.frame_count(), |even| even.last + 1))
    }

    /// The evenly spaced frames that replace its own; `None` if these are already evenly spaced.
    fn even(&self) -> Result<Option<Even>, CloneError> {
        let Some(&end) = self.times.as_ref().and_then(|times| times.last()) else { return Ok(None) };
        let even = Even::over(end, self.fps.unwrap_or(f64::from(FPS)));
        even.map(Some).map_err(|frames| CloneError::TooManyBetween { name: self.name.clone(), frames, most: MOST_EVEN })
    }

    /// Fractional frame index after a fraction of the motion's time.
    fn place(&self, share: f64) -> f64 {
        let last = self.frame_count().saturating_sub(1) as f64;
        let Some((times, end)) = self.times.as_ref().and_then(|times| Some((times, times.last()?))) else { return share * last };
        let moment = interpolation::Moment::at_time(times, share.clamp(0.0, 1.0) * end);
        moment.key as f64 + moment.share
    }

    /// The motion as a function of time. Nodes that a frame lacks are left out.
    pub(crate) fn course(&self) -> Course<'_> {
        let count = self.offsets.iter().map(Vec::len).min().unwrap_or(0);
        let mut slopes_of = vec![vec![Vector2::zeros(); count]; self.frame_count()];
        for node in 0..count {
            for axis in 0..2 {
                let keys: Vec<Option<f64>> = self.offsets.iter().map(|frame| Some(frame[node][axis])).collect();
                for (frame, slope) in slopes_of.iter_mut().zip(slopes(&keys)) {
                    frame[node][axis] = slope;
                }
            }
        }
        Course { motion: self, slopes: slopes_of }
    }

    /// The motion at a fractional frame index. For many of them use `course`.
    #[doc(hidden)]
    pub fn at(&self, place: f64) -> Moment {
        self.course().at(place)
    }
}

/// A motion as a function of time: a monotone cubic for each coordinate.
#[derive(Clone, Debug)]
pub struct Course<'m> {
    motion: &'m SourceMotion,
    /// Slopes of the offsets at each frame.
    slopes: Vec<Vec<Vector2<f64>>>,
}

impl Course<'_> {
    /// The offset of one node at a fractional frame index.
    fn offset(&self, node: usize, place: f64) -> Vector2<f64> {
        let last = self.motion.frame_count() - 1;
        let place = place.clamp(0.0, last as f64);
        let i = (place.floor() as usize).min(last.saturating_sub(1));
        let (t, next) = (place - i as f64, (i + 1).min(last));
        let axis = |axis: usize| {
            let pair = |frames: &[Vec<Vector2<f64>>]| (frames[i][node][axis], frames[next][node][axis]);
            cubic(pair(&self.motion.offsets), pair(&self.slopes), t)
        };
        Vector2::new(axis(0), axis(1))
    }

    /// The motion at a fractional frame index, from 0; an index outside the motion gives its first or last frame. A motion
    /// without frames has no offsets; a head that is not there is at rest.
    pub fn at(&self, place: f64) -> Moment {
        let motion = self.motion;
        let Some(last) = motion.frame_count().checked_sub(1) else {
            return Moment { offsets: Vec::new(), head: Similarity::identity(), turn: None, nearest: 0 };
        };
        let head_of = |frame: usize| motion.head.get(frame).copied().unwrap_or_else(Similarity::identity);
        let place = place.clamp(0.0, last as f64);
        let nearest = place.round() as usize;
        let i = (place.floor() as usize).min(last.saturating_sub(1));
        let t = place - i as f64;
        if (place - nearest as f64).abs() < 1e-9 || last == 0 {
            let turn = motion.turns.get(nearest).copied();
            return Moment { offsets: motion.offsets[nearest].clone(), head: head_of(nearest), turn, nearest };
        }
        let offsets = (0..self.slopes[i].len()).map(|n| self.offset(n, place)).collect();
        let (p, q) = (head_of(i), head_of(i + 1));
        let mix = |p: f64, q: f64| p + (q - p) * t;
        let head = Similarity {
            scale: mix(p.scale, q.scale),
            angle: mix(p.angle, q.angle),
            translation: p.translation.lerp(&q.translation, t),
        };
        let turn = motion.turns.get(i).zip(motion.turns.get(i + 1));
        let turn = turn.map(|(from, to)| std::array::from_fn(|k| mix(from[k], to[k])));
        Moment { offsets, head, turn, nearest }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wireframe::Face;

    fn happiness() -> SourceMotion {
        SourceMotion::read("fixtures/golden/representatives/happiness.csv".as_ref(), &Face::candide3()).unwrap()
    }

    #[test]
    fn every_course_starts_at_nothing_ends_at_all_and_never_turns_back() {
        for ease in [Ease::Linear, Ease::In, Ease::Out, Ease::InOut, Ease::Natural] {
            assert!(ease.apply(0.0).abs() < 1e-12 && (ease.apply(1.0) - 1.0).abs() < 1e-12, "{ease:?}");
            let course: Vec<f64> = (0..=100).map(|k| ease.apply(f64::from(k) / 100.0)).collect();
            assert!(course.windows(2).all(|w| w[0] <= w[1]), "{ease:?}");
        }
        // By hand: half of the onset contributes half of its motion, plus s(0.31) of the rest.
        let rest = 0.05 * 0.31 * 0.31 * (3.0 - 0.62);
        assert!((Ease::Natural.apply(0.31) - (0.475 + rest)).abs() < 1e-12);
    }

    #[test]
    fn frames_that_are_not_evenly_apart_keep_their_times() {
        let motion = SourceMotion { kind: SourceKind::Track, times: Some(vec![0.0, 0.1, 0.2, 0.3, 1.0]), ..happiness() };
        assert_eq!(motion.seconds(), 1.0);
        assert!((motion.place(0.05) - 0.5).abs() < 1e-12 && (motion.place(0.65) - 3.5).abs() < 1e-12 && motion.place(1.0) == 4.0);
        let timing = Timing { fps: Some(10.0), ..Timing::default() };
        let (_, moments) = timing.moments(&motion).unwrap();
        // A tenth of a second each: the first four frames are the motion's own, and the last comes one second after the first.
        assert_eq!(moments.len(), 11);
        assert!((moments[2].offsets[31] - motion.offsets[2][31]).norm() < 1e-6);
        assert!((moments[10].offsets[31] - motion.offsets[4][31]).norm() < 1e-9);
    }

    #[test]
    fn sources_with_uneven_parts_and_rates_that_are_none_are_refused() {
        let why = |change: fn(&mut SourceMotion)| {
            let mut motion = happiness();
            change(&mut motion);
            let error = Timing::default().moments(&motion).unwrap_err();
            assert_eq!(motion.evenly().unwrap_err().to_string(), error.to_string());
            error.to_string()
        };
        assert_eq!(why(|m| m.offsets.clear()), "happiness: the file has no frames");
        assert!(
            why(|m| m.offsets[2].truncate(7)).starts_with("the source happiness has 7 offsets in a frame, but 113 are needed")
        );
        assert!(why(|m| m.head.truncate(4)).starts_with("the source happiness has 4 heads, but 5 are needed"));
        assert!(why(|m| m.times = Some(vec![0.0, 1.0])).starts_with("the source happiness has 2 times, but 5 are needed"));
        assert!(why(|m| m.times = Some(vec![f64::NAN; 5])).starts_with("a time of the source is NaN; it must be"));
        assert!(why(|m| m.fps = Some(0.0)).starts_with("the frame rate of the source is 0; it must be"));
        assert!(why(|m| m.fapus.mw = 0.0).starts_with("a length of the source's neutral face is 0; it must be"));
        assert!(why(|m| m.offsets[3][31].x = 1e300).contains("node 31"));
        let of = |fps, duration| Timing { fps, duration, ..Timing::default() }.moments(&happiness()).unwrap_err().to_string();
        for bad in [f64::NAN, f64::INFINITY, 0.0, -1.0] {
            assert!(of(Some(bad), None).starts_with(&format!("the frame rate of the clone is {bad}; it must be")));
            assert!(of(None, Some(bad)).starts_with(&format!("the duration of the clone, in seconds, is {bad}; it must be")));
        }
    }

    #[test]
    fn too_many_frames_between_are_refused_by_name() {
        let of = |last: f64| SourceMotion {
            kind: SourceKind::Track,
            times: Some(vec![0.0, 0.1, 0.2, 0.3, last]),
            fps: Some(10.0),
            ..happiness()
        };
        let even = of(1.0).evenly().unwrap();
        assert_eq!((of(1.0).even_frame_count().unwrap(), even.frame_count(), even.fps, even.times), (11, 11, Some(10.0), None));
        let said = of(20_240_201.0).evenly().unwrap_err().to_string();
        assert!(
            said.starts_with("happiness: after interpolation of missing frames") && said.contains("202402011 frames"),
            "{said}"
        );
    }

    #[test]
    fn a_length_in_which_there_is_no_second_frame_is_refused() {
        let motion = happiness();
        let of = |fps: f64, duration: f64| {
            Timing { fps: Some(fps), duration: Some(duration), ..Timing::default() }
                .moments(&motion)
                .map(|(_, moments)| moments.len())
        };
        // Two seconds at 0.3 frames per second are 0.6 frames, about one; at 0.2 the film would last five seconds instead of two.
        assert_eq!(of(0.3, 2.0).unwrap(), 2);
        assert!(matches!(of(0.2, 2.0), Err(CloneError::TooFewFrames { seconds: 2.0, fps: 0.2 })));
        assert!(matches!(Timing { fps: Some(0.4), ..Timing::default() }.moments(&motion), Err(CloneError::TooFewFrames { .. })));
    }

    #[test]
    fn a_natural_course_holds_and_its_lower_face_follows() {
        let motion = happiness();
        let timing = Timing { ease: Ease::Natural, ..Timing::default() };
        let (_, moments) = timing.moments(&motion).unwrap();
        let last = moments.len() - 1;
        let share = |frame: usize, node: usize| moments[frame].offsets[node].norm() / motion.offsets[4][node].norm();
        assert!((share(last, 31) - 1.0).abs() < 1e-9 && moments[0].offsets[31].norm() < 1e-12);
        // Held from two thirds of the time on.
        assert!(share(last * 3 / 4, 31) > 0.9);
        // The corner of the mouth against the outer brow, halfway up.
        let course = motion.course();
        let place = 4.0 * Ease::Natural.apply(8.0 / last as f64);
        assert!((moments[8].offsets[15] - course.at(place).offsets[15]).norm() < 1e-9);
        assert!(moments[8].offsets[31].norm() < course.at(place).offsets[31].norm());
        let looped = Timing { back: true, ..timing }.moments(&motion).unwrap().1;
        assert_eq!(looped.len(), 2 * last);
        assert!((looped[last + 3].offsets[31] - looped[last - 3].offsets[31]).norm() < 1e-12);
    }
}
