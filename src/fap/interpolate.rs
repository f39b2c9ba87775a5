//! Interpolates between frames of FAPs, on the curves of [`crate::interpolation`].
//!
//! A FAP is interpolated only if both neighbours set it. FAPs 1 and 2 are codes: they keep the fields of the previous frame.

use super::{
    catalog::FapNumber,
    sequence::{FapFrame, FapSequence},
};
use crate::interpolation::{Curve, Moment};

/// Largest number of frames that interpolation may make: four hours at 25 frames per second, 400 MB.
pub const MAX_FRAMES: usize = 360_000;

/// Error for frames that cannot be interpolated.
///
/// ```
/// use grimace::fap::{InterpolateError, read_fap};
///
/// let sequence = read_fap("fixtures/golden/fap/happiness.fap".as_ref())?.sequence;
/// assert_eq!(sequence.retimed(0.0), Err(InterpolateError::FrameRate { from: 25.0, to: 0.0 }));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InterpolateError {
    /// The result would have too many frames.
    #[error(
        "the result would have {frames} frames, more than {MAX_FRAMES}: choose fewer frames in between or a lower frame rate"
    )]
    TooManyFrames {
        /// Requested number of frames.
        frames: f64,
    },
    /// A frame rate that is not positive.
    #[error("cannot change the frame rate from {from} to {to} frames per second: both must be positive")]
    FrameRate {
        /// Frame rate of the sequence.
        from: f64,
        /// Requested frame rate.
        to: f64,
    },
}

/// Largest factor by which frames are multiplied to reach an integer frame rate.
const MOST_FOR_ONE: u8 = 4;
/// Relative difference up to which an integer frame rate counts as equal.
const SAME_RATE: f64 = 0.002;
/// Largest frame rate that is written unchanged, frames per second.
const MOST_FPS: f64 = 1000.0;

/// A frame rate and the integer rate at which it is written ([`FapSequence::at_whole_rate`]), frames per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WholeRate {
    /// The rate of the frames, adjusted to be an exact fraction of `written` if it is close to one.
    pub taken: f64,
    /// The integer frame rate.
    pub written: f64,
}

/// Returns the integer frame rate at which frames with the rate `fps` are written.
pub fn whole_rate(fps: f64) -> WholeRate {
    let whole = |times: f64| {
        let written = (times * fps).round();
        let near = (1.0..=MOST_FPS).contains(&written) && (times * fps - written).abs() <= SAME_RATE * written;
        near.then_some(WholeRate { taken: written / times, written })
    };
    let next = || WholeRate { taken: fps, written: fps.ceil().clamp(1.0, MOST_FPS) };
    (1..=MOST_FOR_ONE).find_map(|times| whole(f64::from(times))).unwrap_or_else(next)
}

impl FapSequence {
    /// Treats the frames as key frames and inserts `between` frames between consecutive ones, at equal steps.
    ///
    /// Key frame k becomes frame k (`between` + 1), unchanged. The frame rate stays the same. Values are not rounded.
    ///
    /// # Errors
    /// [`InterpolateError::TooManyFrames`].
    pub fn with_frames_between(&self, between: usize) -> Result<Self, InterpolateError> {
        if between == 0 {
            return Ok(self.clone());
        }
        let steps = self.frames.len().saturating_sub(1);
        let count = steps as f64 * (between as f64 + 1.0) + 1.0;
        self.resampled(count, |k| Moment::of_frame(k, (count as usize - 1).max(1), steps))
    }

    /// Returns the same motion at another frame rate, with the same timing.
    ///
    /// A frame lasts 1 / `fps` seconds, and the duration is kept as far as whole frames allow. The number of frames is multiplied
    /// by the ratio of the rates and rounded; several frames give at least two. Frame k shows the motion k / `fps` seconds after
    /// the first frame. The last frame is always the last original frame, even if its time has not come yet, so that the motion
    /// ends in the same pose. If it would come a whole frame too early, one more frame is added. Values are not rounded.
    ///
    /// # Errors
    /// [`InterpolateError`] for too many frames or a rate that is not positive.
    pub fn retimed(&self, fps: f64) -> Result<Self, InterpolateError> {
        let positive = |rate: f64| rate > 0.0 && rate.is_finite();
        if !positive(fps) || !positive(self.fps) {
            return Err(InterpolateError::FrameRate { from: self.fps, to: fps });
        }
        if fps.total_cmp(&self.fps).is_eq() {
            return Ok(self.clone());
        }
        let last = self.frames.len().saturating_sub(1);
        let ratio = fps / self.fps;
        let count = (self.frames.len() as f64 * ratio).round().max(2.0);
        // A last frame that is a whole frame too early would be a visible jump.
        let early = last as f64 * ratio - (count - 1.0);
        let count = if early > 1.0 - SAME_RATE { count + 1.0 } else { count };
        let moment =
            |k: usize| Moment::at_place(if k + 1 < count as usize { k as f64 * self.fps / fps } else { last as f64 }, last);
        Ok(Self { fps, ..self.resampled(count, moment)? })
    }

    /// Returns the same motion at an integer frame rate, which files of the strict subset must have.
    ///
    /// The rate is the nearest integer if it is close enough (30 for 29.97). Otherwise it is two, three or four times the
    /// sequence's own rate if one of these is an integer, so that every frame is kept (25 for 12.5); otherwise the next higher
    /// integer. Values are not rounded. If that would give too many frames, the frames stay as they are, and the motion is
    /// faster.
    pub(crate) fn at_whole_rate(self) -> Self {
        let WholeRate { taken, written } = whole_rate(self.fps);
        let own = Self { fps: taken, ..self };
        own.retimed(written).unwrap_or(Self { fps: written, ..own })
    }

    /// Returns this number of frames, each interpolated at its moment. A single frame stays single.
    fn resampled(&self, frame_count: f64, moment: impl Fn(usize) -> Moment) -> Result<Self, InterpolateError> {
        let from = &self.frames;
        if from.len() < 2 {
            return Ok(self.clone());
        }
        if frame_count > MAX_FRAMES as f64 {
            return Err(InterpolateError::TooManyFrames { frames: frame_count });
        }
        let mut frames = vec![FapFrame::default(); frame_count as usize];
        for (k, frame) in frames.iter_mut().enumerate() {
            for fap in [FapNumber::VISEME, FapNumber::EXPRESSION] {
                frame.set_fields(fap, from[moment(k).key].fields(fap).map(<[i32]>::to_vec));
            }
        }
        for fap in FapNumber::low_level() {
            let curve = Curve::through(from.iter().map(|frame| frame.value(fap)).collect());
            for (k, frame) in frames.iter_mut().enumerate() {
                frame.set_value(fap, curve.at(moment(k)));
            }
        }
        Ok(Self { frames, ..self.clone() })
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    use super::*;

    fn fap(number: u8) -> FapNumber {
        FapNumber::try_from(number).unwrap()
    }

    #[test]
    fn frame_rates_that_are_not_whole_keep_the_time() {
        let rates = |fps: f64| (whole_rate(fps).taken, whole_rate(fps).written);
        assert_eq!(rates(25.0), (25.0, 25.0));
        assert_eq!(rates(29.97), (30.0, 30.0));
        assert_eq!(rates(12.5), (12.5, 25.0));
        assert_eq!(rates(0.5), (0.5, 1.0));
        assert_eq!(rates(1.5), (1.5, 3.0));
        assert_eq!(rates(12.3), (12.3, 13.0));
        assert_eq!(rates(0.1), (0.1, 1.0));
        assert_eq!(rates(2000.0), (2000.0, 1000.0));
        let half = FapSequence { fps: 12.5, ..sequence(&[Some(0.0), Some(10.0), Some(40.0)]) }.at_whole_rate();
        assert_eq!((half.fps, half.frames.len()), (25.0, 6));
        let value = |k: usize| half.frames[k].value(fap(3)).unwrap();
        assert_eq!([value(0), value(2), value(4), value(5)], [0.0, 10.0, 40.0, 40.0]);
        // Twenty seconds stay twenty seconds: ten seconds that move, and ten that hold.
        let slow = FapSequence { fps: 0.1, ..sequence(&[Some(0.0), Some(10.0)]) }.at_whole_rate();
        assert_eq!((slow.fps, slow.frames.len()), (1.0, 20));
    }

    fn sequence(values: &[Option<f64>]) -> FapSequence {
        let frame = |value: &Option<f64>| {
            let mut frame = FapFrame::default();
            frame.set_value(fap(3), *value);
            frame
        };
        let frames = values.iter().map(frame).collect();
        FapSequence { version: "2.1".into(), name: "x".into(), fps: 25.0, frames }
    }

    fn values(sequence: &FapSequence) -> Vec<Option<f64>> {
        sequence.frames.iter().map(|frame| frame.value(fap(3))).collect()
    }

    fn between(keys: &[f64], between: usize) -> Vec<f64> {
        let keys: Vec<_> = keys.iter().copied().map(Some).collect();
        values(&sequence(&keys).with_frames_between(between).unwrap()).into_iter().map(Option::unwrap).collect()
    }

    #[test]
    fn a_line_stays_a_line() {
        // Equal secants: all slopes equal them, and the cubic is a straight line.
        for (k, value) in between(&[0.0, 6.0, 12.0], 5).into_iter().enumerate() {
            assert_relative_eq!(value, k as f64, epsilon = 1e-12);
        }
    }

    #[test]
    fn half_way_values_by_hand() {
        // Keys 0, 8, 8: secants 8, 0. Slopes: 8 at the first key, 0 at the others (flat after). Halfway through the first step:
        // (0 + 8)/2 + (8 - 0)/8 = 5; the second step is flat.
        assert_eq!(between(&[0.0, 8.0, 8.0], 1), [0.0, 5.0, 8.0, 8.0, 8.0]);
        // A peak: keys 0, 4, 0. The slope at the peak is 0, at the ends 4 and -4: 2 + 4/8 = 2.5 on either side.
        assert_eq!(between(&[0.0, 4.0, 0.0], 1), [0.0, 2.5, 4.0, 2.5, 0.0]);
    }

    #[test]
    fn a_fap_is_interpolated_only_where_both_neighbours_set_it() {
        let holes = sequence(&[Some(0.0), Some(2.0), None, Some(4.0)]);
        let expected = [Some(0.0), Some(1.0), Some(2.0), None, None, None, Some(4.0)];
        assert_eq!(values(&holes.with_frames_between(1).unwrap()), expected);
    }

    #[test]
    fn codes_are_held() {
        let mut coded = sequence(&[Some(0.0), Some(2.0)]);
        coded.frames[0].set_fields(fap(2), Some(vec![1, 63, 0, 0, 0, 0]));
        let frames = coded.with_frames_between(1).unwrap().frames;
        let held: Vec<bool> = frames.iter().map(|frame| frame.is_set(fap(2))).collect();
        assert_eq!(held, [true, true, false]);
    }

    #[test]
    fn retiming_keeps_length_and_moments() {
        // A ramp of 1 per frame, 10 frames at 25 per second: 0.4 s.
        let ramp = sequence(&(0..10).map(|k| Some(f64::from(k))).collect::<Vec<_>>());
        let at = |fps: f64| values(&ramp.retimed(fps).unwrap()).into_iter().map(Option::unwrap).collect::<Vec<_>>();
        // 20 frames of half the duration; the last one holds.
        let fast = at(50.0);
        assert_eq!((fast.len(), ramp.retimed(50.0).unwrap().fps), (20, 50.0));
        assert!(fast[..19].iter().enumerate().all(|(k, value)| *value == k as f64 / 2.0) && fast[19] == 9.0, "{fast:?}");
        // 4 frames, each 2.5 of the old ones long, of which the last is the last old one; and likewise 3 frames of 1 / 7.5 s.
        for (found, expected) in [(at(10.0), vec![0.0, 2.5, 5.0, 9.0]), (at(7.5), vec![0.0, 10.0 / 3.0, 9.0])] {
            assert_eq!(found.len(), expected.len());
            found.iter().zip(&expected).for_each(|(value, expected)| assert_relative_eq!(value, expected, epsilon = 1e-9));
        }
        // With 4 frames, 11 frames would end a whole frame too early: there are 5.
        let longer = sequence(&(0..11).map(|k| Some(f64::from(k))).collect::<Vec<_>>()).retimed(10.0).unwrap();
        assert_eq!(values(&longer), [0.0, 2.5, 5.0, 7.5, 10.0].map(Some));
        // Moments at 30 per second are 5/6 of a frame apart.
        assert_relative_eq!(at(30.0)[7], 7.0 * 5.0 / 6.0, epsilon = 1e-9);
        // A rate far too low keeps both ends, one frame stays one frame, and the same rate changes nothing.
        assert_eq!(at(1.0), [0.0, 9.0]);
        assert_eq!(values(&sequence(&[Some(3.0)]).retimed(50.0).unwrap()), [Some(3.0)]);
        assert_eq!(ramp.retimed(25.0).unwrap(), ramp);
    }

    #[test]
    fn absurd_sizes_are_refused() {
        let two = sequence(&[Some(0.0), Some(1.0)]);
        assert!(matches!(two.with_frames_between(usize::MAX), Err(InterpolateError::TooManyFrames { .. })));
        assert!(matches!(two.retimed(1e300), Err(InterpolateError::TooManyFrames { .. })));
        assert!(matches!(two.retimed(0.0), Err(InterpolateError::FrameRate { .. })));
        assert!(matches!(two.retimed(f64::NAN), Err(InterpolateError::FrameRate { .. })));
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn keys_are_hit_and_every_step_is_monotone(
            keys in prop::collection::vec(-4000.0..4000.0_f64, 2..8),
            count in 1_usize..8,
        ) {
            let values = between(&keys, count);
            for (k, pair) in keys.windows(2).enumerate() {
                let step = &values[k * (count + 1)..=(k + 1) * (count + 1)];
                prop_assert_eq!(step[0], pair[0]);
                prop_assert_eq!(step[count + 1], pair[1]);
                let sign = if pair[1] >= pair[0] { 1.0 } else { -1.0 };
                // 1e-9: rounding errors of values up to 4000.
                let monotone = step.windows(2).all(|w| sign * (w[1] - w[0]) >= -1e-9);
                prop_assert!(monotone, "{:?}", step);
            }
        }
    }
}
