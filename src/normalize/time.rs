//! Time: the same number of frames for every model.

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use crate::{
    model::{DynamicExpressionModel, FrameExpressionModel, ModelError},
    units::Unit,
};

/// How a frame between two frames is made.
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
    /// Linear interpolation between the two frames around it.
    Linear,
}

/// `count` frames at uniform distances from the first to the last, both included.
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
    if count < 2 {
        return Err(ModelError::TooFewFrames { found: count });
    }
    let last = model.frame_count() - 1;
    let frames = (0..count).map(|m| match mode {
        // round(m * last / (count - 1)) in whole numbers, half up.
        Resample::Nearest => model.frames()[(2 * m * last + count - 1) / (2 * (count - 1))].clone(),
        Resample::Linear => {
            let (whole, rest) = (m * last / (count - 1), m * last % (count - 1));
            let share = rest as f64 / (count - 1) as f64;
            let (a, b) = (&model.frames()[whole], &model.frames()[(whole + 1).min(last)]);
            let between = |(p, q): (&Point2<f64>, &Point2<f64>)| p + (q - p) * share;
            FrameExpressionModel::new(a.nodes().iter().zip(b.nodes()).map(between).collect())
        }
    });
    DynamicExpressionModel::new(frames.collect())
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
