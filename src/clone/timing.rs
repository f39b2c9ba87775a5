//! Time: which moment of the source each frame of the clone shows.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::{CloneError, SourceKind, SourceMotion};
use crate::{
    geometry::Similarity,
    interpolation::{FPS, cubic, slopes},
};

/// Most frames of a clone.
pub const MAX_FRAMES: usize = 20_000;
/// Seconds from neutral to apex of a representative, which has no time of its own.
pub const MODEL_SECONDS: f64 = 1.0;

/// How the motion starts and ends.
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
    /// As the source has it.
    #[default]
    Linear,
    /// Starts slowly.
    In,
    /// Ends slowly.
    Out,
    /// Both.
    InOut,
}

impl Ease {
    /// Share of the motion after a share of the time, both 0 to 1.
    fn apply(self, t: f64) -> f64 {
        match self {
            Self::Linear => t,
            Self::In => t * t,
            Self::Out => t * (2.0 - t),
            Self::InOut => t * t * (3.0 - 2.0 * t),
        }
    }
}

/// Frame rate, length and course of a clone.
///
/// ```
/// use grimace::{clone::{SourceMotion, Timing}, wireframe::Face};
///
/// let motion = SourceMotion::read("fixtures/golden/representatives/happiness.csv".as_ref(), &Face::candide3())?;
/// let timing = Timing { fps: Some(10.0), duration: Some(2.0), ..Timing::default() };
/// let (fps, moments) = timing.moments(&motion)?;
/// assert_eq!((fps, moments.len()), (10.0, 21));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Frames per second; the source's if `None`.
    pub fps: Option<f64>,
    /// Seconds from the first to the last frame of the source; the source's if `None`.
    pub duration: Option<f64>,
    /// Course.
    pub ease: Ease,
    /// Back to the neutral face after the last frame, so that the film can be repeated without a jump.
    pub back: bool,
}

/// The source at one point of time.
///
/// ```
/// use grimace::{clone::{Moment, SourceMotion}, wireframe::Face};
///
/// let motion = SourceMotion::read("fixtures/golden/representatives/happiness.csv".as_ref(), &Face::candide3())?;
/// let Moment { offsets, nearest, .. } = motion.at(3.2);
/// assert_eq!((offsets.len(), nearest), (113, 3));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Moment {
    /// Neutral offsets, as in [`SourceMotion::offsets`].
    pub offsets: Vec<Vector2<f64>>,
    /// Motion of the head.
    pub head: Similarity,
    /// The source's frame nearest in time.
    pub nearest: usize,
}

impl Timing {
    /// Frames per second and the moments of all frames, the first and the last frame of the source included.
    ///
    /// # Errors
    /// [`CloneError::TooManyFrames`].
    pub fn moments(&self, source: &SourceMotion) -> Result<(f64, Vec<Moment>), CloneError> {
        let steps = (source.frame_count() - 1) as f64;
        let fps = self.fps.or(source.fps).unwrap_or(f64::from(FPS));
        let count = (self.duration.unwrap_or(source.seconds()) * fps).round().max(1.0) + 1.0;
        if !(count <= MAX_FRAMES as f64) {
            return Err(CloneError::TooManyFrames { frames: count, most: MAX_FRAMES });
        }
        let last = count as usize - 1;
        let mut places: Vec<f64> = (0..=last).map(|k| self.ease.apply(k as f64 / last as f64) * steps).collect();
        if self.back {
            let forth = places.clone();
            places.extend(forth[1..forth.len() - 1].iter().rev());
        }
        let course = source.course();
        Ok((fps, places.into_iter().map(|place| course.at(place)).collect()))
    }
}

impl SourceMotion {
    /// Seconds from the first to the last frame: its own, or 1 for a representative, which has no time of its own.
    pub fn seconds(&self) -> f64 {
        match self.kind {
            SourceKind::Model => MODEL_SECONDS,
            _ => (self.frame_count() - 1) as f64 / self.fps.unwrap_or(f64::from(FPS)),
        }
    }

    /// The motion at all times.
    pub fn course(&self) -> Course<'_> {
        let count = self.offsets.first().map_or(0, Vec::len);
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

    /// The motion at a place between frames; for many of them, [`SourceMotion::course`].
    pub fn at(&self, place: f64) -> Moment {
        self.course().at(place)
    }
}

/// A motion at all times: every coordinate on a monotone cubic.
///
/// ```
/// use grimace::{clone::SourceMotion, wireframe::Face};
///
/// let motion = SourceMotion::read("fixtures/golden/representatives/happiness.csv".as_ref(), &Face::candide3())?;
/// let course = motion.course();
/// // On a frame the course has the frame's own offsets, between frames it goes from one to the next.
/// assert!((course.at(4.0).offsets[31] - motion.offsets[4][31]).norm() < 1e-9);
/// assert!(course.at(3.5).offsets[31].y < course.at(4.0).offsets[31].y);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Course<'m> {
    motion: &'m SourceMotion,
    /// Slopes of the offsets at every frame.
    slopes: Vec<Vec<Vector2<f64>>>,
}

impl Course<'_> {
    /// The motion at a place between frames, from 0; places outside are those of the first and of the last frame.
    pub fn at(&self, place: f64) -> Moment {
        let Self { motion, slopes } = self;
        let last = motion.frame_count() - 1;
        let place = place.clamp(0.0, last as f64);
        let nearest = place.round() as usize;
        let i = (place.floor() as usize).min(last.saturating_sub(1));
        let t = place - i as f64;
        if (place - nearest as f64).abs() < 1e-9 || last == 0 {
            return Moment { offsets: motion.offsets[nearest].clone(), head: motion.head[nearest], nearest };
        }
        let between = |node: usize, axis: usize| {
            let pair = |frames: &[Vec<Vector2<f64>>]| (frames[i][node][axis], frames[i + 1][node][axis]);
            cubic(pair(&motion.offsets), pair(slopes), t)
        };
        let offsets = (0..motion.offsets[i].len()).map(|n| Vector2::new(between(n, 0), between(n, 1))).collect();
        let (p, q) = (motion.head[i], motion.head[i + 1]);
        let mix = |p: f64, q: f64| p + (q - p) * t;
        let head = Similarity {
            scale: mix(p.scale, q.scale),
            angle: mix(p.angle, q.angle),
            translation: p.translation.lerp(&q.translation, t),
        };
        Moment { offsets, head, nearest }
    }
}
