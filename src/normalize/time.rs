//! Time: resamples every model to the same number of frames.

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use crate::{
    model::{DynamicExpressionModel, FrameExpressionModel, ModelError},
    units::Unit,
};

/// How a frame between two frames is computed.
///
/// ```
/// use grimace::normalize::Resample;
///
/// assert_eq!(Resample::default(), Resample::Nearest);
/// assert_eq!(serde_json::from_str::<Resample>("\"linear\"")?, Resample::Linear);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Resample {
    /// The nearest frame (the later one of two equally near).
    #[default]
    Nearest,
    /// Linear interpolation between the previous and the next frame.
    Linear,
}

/// Returns `count` frames at uniform distances in time from the first to the last frame, both included. Input frames count as equally
/// spaced.
///
/// A sequence with fewer frames than `count` repeats frames under [`Resample::Nearest`].
///
/// # Errors
/// [`ModelError::TooFewFrames`] when `count` is less than 2.
pub fn resample<U: Unit>(
    model: &DynamicExpressionModel<U>,
    count: usize,
    mode: Resample,
) -> Result<DynamicExpressionModel<U>, ModelError> {
    let numbers: Vec<u32> = (0..model.frame_count() as u32).collect();
    resample_at(model, &numbers, count, mode)
}

/// As [`resample`], for numbered frames: the frame number is the time, so that missing frames do not distort it.
///
/// Numbers must ascend, or descend when the neutral frame is the later one. If they do neither, frames count as equally spaced.
///
/// # Errors
/// [`ModelError::TooFewFrames`] when `count` is less than 2.
pub fn resample_at<U: Unit>(
    model: &DynamicExpressionModel<U>,
    numbers: &[u32],
    count: usize,
    mode: Resample,
) -> Result<DynamicExpressionModel<U>, ModelError> {
    if count < 2 {
        return Err(ModelError::TooFewFrames { found: count });
    }
    let frames = model.frames();
    let since = |number: &u32| u64::from(number.abs_diff(numbers[0]));
    let mut times: Vec<u64> = if numbers.len() == frames.len() { numbers.iter().map(since).collect() } else { Vec::new() };
    if !(times.len() == frames.len() && times.windows(2).all(|pair| pair[0] < pair[1])) {
        times = (0..frames.len() as u64).collect();
    }
    // Times are multiplied by this, so that the requested times are whole numbers.
    let parts = count as u64 - 1;
    let last = times[times.len() - 1];
    let frame = |m: u64| {
        let wanted = m * last;
        let before = times.partition_point(|time| time * parts <= wanted) - 1;
        let after = (before + 1).min(frames.len() - 1);
        let [earlier, later] = [before, after].map(|k| times[k] * parts);
        match mode {
            Resample::Nearest => frames[if later.abs_diff(wanted) <= wanted.abs_diff(earlier) { after } else { before }].clone(),
            Resample::Linear => {
                let share = (wanted - earlier) as f64 / (later - earlier).max(1) as f64;
                let between = |(p, q): (&Point2<f64>, &Point2<f64>)| p + (q - p) * share;
                FrameExpressionModel::new(frames[before].nodes().iter().zip(frames[after].nodes()).map(between).collect())
            }
        }
    };
    DynamicExpressionModel::new((0..=parts).map(frame).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Px;

    fn ramp(frames: usize) -> DynamicExpressionModel<Px> {
        let frame = |m| FrameExpressionModel::new(vec![Point2::new(f64::from(m), 0.0)]);
        DynamicExpressionModel::new((0..frames as u32).map(frame).collect()).unwrap()
    }

    fn xs(model: &DynamicExpressionModel<Px>) -> Vec<f64> {
        model.frames().iter().map(|f| f.nodes()[0].x).collect()
    }

    #[test]
    fn nearest_frames_are_uniform_and_include_both_ends() {
        assert_eq!(xs(&resample(&ramp(9), 5, Resample::Nearest).unwrap()), [0.0, 2.0, 4.0, 6.0, 8.0]);
        // 12 frames: 0, 2.75, 5.5, 8.25, 11 -> 0, 3, 6 (half up), 8, 11.
        assert_eq!(xs(&resample(&ramp(12), 5, Resample::Nearest).unwrap()), [0.0, 3.0, 6.0, 8.0, 11.0]);
        // 2 frames: 0, 0.25, 0.5, 0.75, 1.
        assert_eq!(xs(&resample(&ramp(2), 5, Resample::Nearest).unwrap()), [0.0, 0.0, 1.0, 1.0, 1.0]);
    }

    #[test]
    fn frames_that_are_missing_are_no_jump() {
        // 24 frames without 14 to 23, by their numbers: 1, 6.75, 12.5, 18.25, 24 -> 1, 7, 13, 13, 24.
        let numbers: Vec<u32> = (1..=13).chain([24]).collect();
        let frame = |n: &u32| FrameExpressionModel::new(vec![Point2::new(f64::from(*n), 0.0)]);
        let model = DynamicExpressionModel::<Px>::new(numbers.iter().map(frame).collect()).unwrap();
        let at = |numbers: &[u32], mode| xs(&resample_at(&model, numbers, 5, mode).unwrap());
        assert_eq!(at(&numbers, Resample::Nearest), [1.0, 7.0, 13.0, 13.0, 24.0]);
        assert_eq!(at(&numbers, Resample::Linear), [1.0, 6.75, 12.5, 18.25, 24.0]);
        // The apex is earlier than the neutral frame: 30 to 7.
        let back: Vec<u32> = numbers.iter().map(|n| 31 - n).collect();
        assert_eq!(at(&back, Resample::Nearest), [1.0, 7.0, 13.0, 13.0, 24.0]);
        // Numbers in no order give no times.
        let odd: Vec<u32> = numbers.iter().map(|n| n % 5).collect();
        assert_eq!(at(&odd, Resample::Nearest), xs(&resample(&model, 5, Resample::Nearest).unwrap()));
    }

    #[test]
    fn linear_frames_lie_on_the_line() {
        assert_eq!(xs(&resample(&ramp(12), 5, Resample::Linear).unwrap()), [0.0, 2.75, 5.5, 8.25, 11.0]);
        assert_eq!(xs(&resample(&ramp(2), 5, Resample::Linear).unwrap()), [0.0, 0.25, 0.5, 0.75, 1.0]);
    }

    #[test]
    fn five_of_five_change_nothing() {
        for mode in [Resample::Nearest, Resample::Linear] {
            assert_eq!(resample(&ramp(5), 5, mode).unwrap(), ramp(5));
        }
    }
}
