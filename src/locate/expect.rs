//! Expected errors of located points, from properties of their reading.

use super::{
    model::ErrorModel,
    mouth::ESTIMATES,
    picture::View,
    points,
    shape::{Shape, distance},
};

/// Result of one reading of a face.
#[derive(Clone, Debug)]
pub struct Reading {
    /// The points, pixels of the picture.
    pub shape: Shape,
    /// The verifier's score.
    pub score: f32,
    /// Length of each point's last step, eye distances.
    pub last_step: Vec<f32>,
    /// Distance from each point's own prediction to the combined one in the last stage, eye distances.
    pub dissent: Vec<f32>,
    /// Visibility value of each point by itself; empty if the model has no cover stage.
    pub seen: Vec<f32>,
    /// Estimates of the motion of the mouth; 0 if the model has no stage for moved mouths.
    pub mouth: [f32; ESTIMATES],
}

impl Reading {
    /// Returns a reading of a mirrored view in terms of the picture, or the reverse.
    pub fn turned(&self, view: View<'_>) -> Self {
        let turned = |values: &[f32]| points().iter().filter_map(|p| values.get(p.mirror).copied()).collect::<Vec<f32>>();
        Self {
            shape: view.turn_shape(&self.shape),
            last_step: turned(&self.last_step),
            dissent: turned(&self.dissent),
            seen: turned(&self.seen),
            ..*self
        }
    }
}

/// Smallest length that the features distinguish, eye distances.
const FLOOR: f32 = 0.003;

/// Number of features of [`signs`].
pub const SIGNS: usize = 6;

/// Returns the features of a point in two readings of a face. They are logarithms of the distance between the readings (at the point, and
/// over all points), of the last step, of the point's deviation from the combined prediction, and of the eye distance in px; and the
/// verifier's score.
pub fn signs(point: usize, apart: &[f32], readings: [&Reading; 2], eye_distance: f32) -> [f32; SIGNS] {
    let log = |value: f32| (value + FLOOR).ln();
    let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len().max(1) as f32;
    let both = |pick: fn(&Reading) -> &Vec<f32>| {
        let value = |r: &Reading| pick(r).get(point).copied().unwrap_or(0.0);
        0.5 * (value(readings[0]) + value(readings[1]))
    };
    [
        log(apart.get(point).copied().unwrap_or(0.0)),
        log(mean(apart)),
        log(both(|r| &r.last_step)),
        log(both(|r| &r.dissent)),
        eye_distance.clamp(15.0, 150.0).ln(),
        0.5 * (readings[0].score + readings[1].score),
    ]
}

/// Largest expected error, over the eye distance.
const MOST: f32 = 0.5;

impl ErrorModel {
    /// Returns the logarithm of the error before calibration.
    pub fn sum(&self, point: usize, signs: &[f32; SIGNS]) -> f32 {
        let slopes: f32 = self.slopes.iter().zip(signs).map(|(a, b)| a * b).sum();
        self.intercepts.get(point).copied().unwrap_or(0.0) + slopes
    }

    /// Returns the expected error over the eye distance: half of such points are closer, half further away.
    pub fn expect(&self, point: usize, signs: &[f32; SIGNS]) -> f32 {
        let sum = self.sum(point, signs);
        // A face with a very low score has larger errors than any face of the calibration.
        let strange = (self.low_score - signs[SIGNS - 1]).max(0.0);
        (self.calibrated(sum) + 1.5 * strange).exp().min(MOST)
    }

    /// Returns the expected errors of all points of two readings, over the eye distance, each computed separately; `eye_distance` in px.
    pub fn expect_all(&self, readings: [&Reading; 2], eye_distance: f32) -> Vec<f32> {
        let pairs = readings[0].shape.iter().zip(&readings[1].shape);
        let apart: Vec<f32> = pairs.map(|(&p, &q)| distance(p, q) / eye_distance).collect();
        (0..apart.len()).map(|k| self.expect(k, &signs(k, &apart, readings, eye_distance))).collect()
    }

    fn calibrated(&self, sum: f32) -> f32 {
        let (Some(first), Some(last)) = (self.knots.first(), self.knots.last()) else { return sum };
        if sum <= first[0] {
            return first[1] + (sum - first[0]);
        }
        for pair in self.knots.windows(2) {
            if sum <= pair[1][0] {
                let share = (sum - pair[0][0]) / (pair[1][0] - pair[0][0]).max(1e-6);
                return pair[0][1] + share * (pair[1][1] - pair[0][1]);
            }
        }
        last[1] + (sum - last[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn calibration_is_piecewise_linear_and_strangeness_adds() {
        let model = ErrorModel {
            intercepts: vec![0.0],
            slopes: vec![1.0; SIGNS],
            knots: vec![[-4.0, -4.5], [-2.0, -2.5]],
            low_score: 1.0,
        };
        let signs = [-1.0, -1.0, -1.0, -1.0, 0.0, 1.0];
        approx::assert_relative_eq!(model.sum(0, &signs), -3.0);
        approx::assert_relative_eq!(model.expect(0, &signs), (-3.5_f32).exp(), epsilon = 1e-6);
        let strange = [-1.0, -1.0, -1.0, -1.0, 1.0, 0.0];
        approx::assert_relative_eq!(model.expect(0, &strange), (-2.0_f32).exp(), epsilon = 1e-6);
    }
}
