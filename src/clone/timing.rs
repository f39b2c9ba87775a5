//! Time: which moment of the source each frame of the clone shows.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::{CloneError, SourceKind, SourceMotion};
use crate::geometry::Similarity;

/// Most frames of a clone.
pub const MAX_FRAMES: usize = 20_000;
/// Frames per second where neither source nor user says.
pub const DEFAULT_FPS: f64 = 25.0;
/// Seconds from neutral to apex of a representative, which has no time of its own.
pub const MODEL_SECONDS: f64 = 1.0;

/// How the motion starts and ends.
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
        let fps = self.fps.or(source.fps).unwrap_or(DEFAULT_FPS);
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
        Ok((fps, places.into_iter().map(|place| source.at(place)).collect()))
    }
}

impl SourceMotion {
    /// Seconds from the first to the last frame: its own, or 1 for a representative, which has no time of its own.
    pub fn seconds(&self) -> f64 {
        match self.kind {
            SourceKind::Model => MODEL_SECONDS,
            _ => (self.frame_count() - 1) as f64 / self.fps.unwrap_or(DEFAULT_FPS),
        }
    }

    /// The motion at a place between frames: a cubic through the frames that does not overshoot (Fritsch and Carlson) for every
    /// coordinate.
    pub fn at(&self, place: f64) -> Moment {
        let last = self.frame_count() - 1;
        let place = place.clamp(0.0, last as f64);
        let nearest = place.round() as usize;
        let i = (place.floor() as usize).min(last.saturating_sub(1));
        let t = place - i as f64;
        if (place - nearest as f64).abs() < 1e-9 || last == 0 {
            return Moment { offsets: self.offsets[nearest].clone(), head: self.head[nearest], nearest };
        }
        let frame = |k: isize| &self.offsets[k.clamp(0, last as isize) as usize];
        let k = i as isize;
        let (a, b, c, d) = (frame(k - 1), frame(k), frame(k + 1), frame(k + 2));
        let offsets = (0..b.len())
            .map(|n| Vector2::new(cubic([a[n].x, b[n].x, c[n].x, d[n].x], t), cubic([a[n].y, b[n].y, c[n].y, d[n].y], t)))
            .collect();
        let (p, q) = (self.head[i], self.head[i + 1]);
        let mix = |p: f64, q: f64| p + (q - p) * t;
        let head = Similarity {
            scale: mix(p.scale, q.scale),
            angle: mix(p.angle, q.angle),
            translation: p.translation.lerp(&q.translation, t),
        };
        Moment { offsets, head, nearest }
    }
}

/// Monotone cubic between the second and the third of four values.
fn cubic([a, b, c, d]: [f64; 4], t: f64) -> f64 {
    let slope = |before: f64, after: f64| {
        if before * after <= 0.0 { 0.0 } else { 2.0 * before * after / (before + after) }
    };
    let (m, n) = (slope(b - a, c - b), slope(c - b, d - c));
    let (t2, t3) = (t * t, t * t * t);
    b * (2.0 * t3 - 3.0 * t2 + 1.0) + m * (t3 - 2.0 * t2 + t) + c * (3.0 * t2 - 2.0 * t3) + n * (t3 - t2)
}
