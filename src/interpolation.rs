//! Interpolation in time between key frames, shared by everything that moves: FAP files, clones, synthesized surfaces, the player.
//!
//! Each coordinate follows a monotone cubic: F. N. Fritsch, R. E. Carlson, *Monotone piecewise cubic interpolation*, SIAM J.
//! Numer. Anal. 17, 1980. Between two keys a value stays within their range: nothing overshoots, a closing eye does not open first, and a
//! limit that holds at the keys holds between them. Scaling a motion scales its course, so a FAP file and the clone of one
//! representative agree in every frame. `player/assets/motion.js` implements the same: change both together.

/// Default number of frames between two key frames of a representative: 5 make 25 frames of its 5.
pub const FRAMES_BETWEEN: usize = 5;

/// Frames per second if neither motion nor user sets them.
pub const FPS: u32 = 25;

/// Largest number of evenly spaced frames that an uneven motion is resampled to.
pub(crate) const MOST_EVEN: u32 = 100_000;

/// Error message for a motion with too many frames after resampling.
pub(crate) fn too_many_between(frames: f64, most: u32) -> String {
    format!(
        "after interpolation of missing frames and uneven times it would have {frames} frames, more than {most}: number the frames \
         consecutively if none is missing, or use a part of the motion without distant frames"
    )
}

/// Evenly spaced frames that replace uneven ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Even {
    /// Index of the last frame; at least 1.
    pub last: usize,
    /// Frames per second.
    pub fps: f64,
}

impl Even {
    /// Evenly spaced frames over `seconds` (more than 0). The rate is `fps`, adjusted so that the last frame falls on the end.
    ///
    /// # Errors
    /// The number of frames if it exceeds [`MOST_EVEN`].
    pub fn over(seconds: f64, fps: f64) -> Result<Self, f64> {
        let last = (fps * seconds).round().max(1.0);
        if !(last < f64::from(MOST_EVEN)) {
            return Err(last + 1.0);
        }
        // A rate that fits within rounding is kept.
        let fps = if (fps * seconds - last).abs() < 1e-6 { fps } else { last / seconds };
        Ok(Self { last: last as usize, fps })
    }
}

/// A point in time between key frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Moment {
    /// Index of the key at or before it.
    pub key: usize,
    /// Fraction of the way to the next key, 0 to 1 (1 excluded).
    pub share: f64,
}

impl Moment {
    /// Tolerance, in key steps, within which a moment counts as being at a key.
    const ROUNDING: f64 = 1e-9;

    /// Moment of frame `k` of `last` + 1 evenly spaced frames over `steps` + 1 keys; computed exactly in integers.
    ///
    /// # Panics
    /// If `last` is 0 (a programmer's error).
    pub fn of_frame(k: usize, last: usize, steps: usize) -> Self {
        Self { key: k * steps / last, share: (k * steps % last) as f64 / last as f64 }
    }

    /// Moment at a fractional index among `last` + 1 keys, clamped to them. Within rounding of a key it is that key.
    pub fn at_place(place: f64, last: usize) -> Self {
        let (place, nearest) = (place.clamp(0.0, last as f64), place.clamp(0.0, last as f64).round());
        if (place - nearest).abs() < Self::ROUNDING {
            return Self { key: nearest as usize, share: 0.0 };
        }
        Self { key: place as usize, share: place.fract() }
    }

    /// Moment at a time among the times of the keys (ascending, at least two), clamped to them. Within rounding of a key it is that key.
    ///
    /// # Panics
    /// If there are less than two keys (a programmer's error).
    pub fn at_time(times: &[f64], time: f64) -> Self {
        let next = times.partition_point(|t| *t <= time).clamp(1, times.len() - 1);
        let (from, to) = (times[next - 1], times[next]);
        match ((time - from) / (to - from)).clamp(0.0, 1.0) {
            share if share < Self::ROUNDING => Self { key: next - 1, share: 0.0 },
            share if share > 1.0 - Self::ROUNDING => Self { key: next, share: 0.0 },
            share => Self { key: next - 1, share },
        }
    }
}

/// Slopes at the keys, in value per key step, for which the cubic is monotone between keys.
///
/// A missing key has slope 0 and ends the curve on either side.
pub(crate) fn slopes(keys: &[Option<f64>]) -> Vec<f64> {
    let secants: Vec<Option<f64>> = keys.windows(2).map(|pair| Some(pair[1]? - pair[0]?)).collect();
    let secant = |i: Option<usize>| i.and_then(|i| secants.get(i).copied().flatten());
    let mut slopes: Vec<f64> = (0..keys.len())
        .map(|k| match (secant(k.checked_sub(1)), secant(Some(k))) {
            (Some(before), Some(after)) if before * after <= 0.0 => 0.0,
            (Some(before), Some(after)) => f64::midpoint(before, after),
            (Some(only), None) | (None, Some(only)) => only,
            (None, None) => 0.0,
        })
        .collect();
    for (i, secant) in secants.iter().enumerate() {
        let Some(delta) = *secant else { continue };
        if delta == 0.0 {
            slopes[i] = 0.0;
            slopes[i + 1] = 0.0;
            continue;
        }
        // Slopes over the secant must stay within the circle of radius 3.
        let (alpha, beta) = (slopes[i] / delta, slopes[i + 1] / delta);
        let length = alpha.hypot(beta);
        if length > 3.0 {
            slopes[i] = 3.0 * alpha / length * delta;
            slopes[i + 1] = 3.0 * beta / length * delta;
        }
    }
    slopes
}

/// Weights of the start value, the start slope, the end value and the end slope in a cubic Hermite curve at `u`, 0 to 1.
pub(crate) fn hermite(u: f64) -> [f64; 4] {
    let v = 1.0 - u;
    [(1.0 + 2.0 * u) * v * v, u * v * v, u * u * (3.0 - 2.0 * u), -u * u * v]
}

/// Cubic Hermite curve at `u` (0 to 1) between two values with their slopes.
pub(crate) fn cubic((from, to): (f64, f64), (slope_from, slope_to): (f64, f64), u: f64) -> f64 {
    let shares = hermite(u);
    let value = from * shares[0] + slope_from * shares[1] + to * shares[2] + slope_to * shares[3];
    value.clamp(from.min(to), from.max(to)) // against rounding errors only
}

/// A value over time, given by keys.
#[derive(Clone, Debug)]
pub(crate) struct Curve {
    keys: Vec<Option<f64>>,
    slopes: Vec<f64>,
}

impl Curve {
    /// Creates the curve through keys; a missing key ends it on either side.
    pub fn through(keys: Vec<Option<f64>>) -> Self {
        Self { slopes: slopes(&keys), keys }
    }

    /// Value at a moment at a key, or between two keys that are both set; `None` elsewhere.
    pub fn at(&self, moment: Moment) -> Option<f64> {
        let Moment { key, share } = moment;
        let from = self.keys.get(key).copied().flatten()?;
        if share == 0.0 {
            return Some(from);
        }
        let to = self.keys.get(key + 1).copied().flatten()?;
        Some(cubic((from, to), (self.slopes[key], self.slopes[key + 1]), share))
    }
}

/// 0 below `from`, 1 above `to`, smooth between.
pub(crate) fn smooth_step(from: f64, to: f64, value: f64) -> f64 {
    let t = ((value - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    fn curve(keys: &[f64]) -> Curve {
        Curve::through(keys.iter().copied().map(Some).collect())
    }

    fn at(curve: &Curve, key: usize, share: f64) -> Option<f64> {
        curve.at(Moment { key, share })
    }

    #[test]
    fn even_frames_meet_the_last_one_and_are_not_too_many() {
        assert_eq!(Even::over(0.4, 25.0), Ok(Even { last: 10, fps: 25.0 }));
        assert_eq!(Even::over(0.41, 25.0), Ok(Even { last: 10, fps: 10.0 / 0.41 }));
        assert_eq!(Even::over(1e-3, 25.0), Ok(Even { last: 1, fps: 1e3 }));
        assert_eq!(Even::over(99_999.0, 1.0).map(|even| even.last), Ok(99_999));
        assert_eq!(Even::over(1e5, 1.0), Err(100_001.0));
        assert!(Even::over(f64::NAN, 25.0).is_ok_and(|even| even.last == 1) && Even::over(f64::INFINITY, 25.0).is_err());
    }

    #[test]
    fn a_curve_by_hand() {
        // Keys 0, 8, 8: secants 8, 0. Slopes: the first key has 8, the others 0 (flat after). Half-way of the first step:
        // (0 + 8)/2 + (8 - 0)/8 = 5; the second step is flat.
        let flat = curve(&[0.0, 8.0, 8.0]);
        assert_eq!([at(&flat, 0, 0.0), at(&flat, 0, 0.5), at(&flat, 1, 0.5), at(&flat, 2, 0.0)], [0.0, 5.0, 8.0, 8.0].map(Some));
        // Past the last key there is nothing.
        assert_eq!([at(&flat, 2, 0.5), at(&flat, 3, 0.0)], [None, None]);
    }

    #[test]
    fn a_scaled_motion_has_the_scaled_course() {
        let (one, scaled) = (curve(&[0.0, 1.0, 21.0, 20.0]), curve(&[0.0, -2.0, -42.0, -40.0]));
        for key in 0..3 {
            assert_relative_eq!(at(&one, key, 0.3).unwrap() * -2.0, at(&scaled, key, 0.3).unwrap(), epsilon = 1e-12);
        }
    }

    #[test]
    fn steep_slopes_are_cut_to_the_circle() {
        // Keys 0, 1, 21: secants 1, 20; slopes 1, 10.5, 20. First step: (alpha, beta) = (1, 10.5), cut to length 3.
        let slopes = slopes(&[Some(0.0), Some(1.0), Some(21.0)]);
        assert_relative_eq!(slopes[0].hypot(slopes[1]), 3.0, epsilon = 1e-12);
        assert_relative_eq!(slopes[1] / slopes[0], 10.5, epsilon = 1e-12);
        assert_eq!(slopes[2], 20.0);
    }

    #[test]
    fn times_lie_between_those_of_the_keys() {
        let at = |time: f64| Moment::at_time(&[0.0, 0.1, 0.5], time);
        assert_eq!(at(0.05), Moment { key: 0, share: 0.5 });
        assert_relative_eq!(at(0.2).share, 0.25, epsilon = 1e-12);
        // At a key (also at 0.30000000000000004 / 3) it is that key; outside, the nearest one.
        assert_eq!([at(-1.0), at((0.1 + 0.2) / 3.0), at(0.5), at(2.0)].map(|m| m.key), [0, 1, 2, 2]);
        assert!([at(-1.0), at((0.1 + 0.2) / 3.0), at(0.5), at(2.0)].iter().all(|m| m.share == 0.0));
    }

    #[test]
    fn frames_lie_exactly_on_their_keys() {
        // 9 frames over 5 keys: every second is a key.
        assert_eq!(Moment::of_frame(4, 8, 4), Moment { key: 2, share: 0.0 });
        assert_eq!(Moment::of_frame(5, 8, 4), Moment { key: 2, share: 0.5 });
        assert_eq!(Moment::of_frame(8, 8, 4), Moment { key: 4, share: 0.0 });
    }
}
