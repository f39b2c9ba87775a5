//! What errors to expect of a reading, from how it went.

use super::{
    model::ErrorModel,
    shape::{Shape, distance},
};

/// What one reading of a face gave.
#[derive(Clone, Debug)]
pub struct Reading {
    /// The points, pixels of the picture.
    pub shape: Shape,
    /// The verifier's score.
    pub score: f32,
    /// Length of each point's last step, eye distances.
    pub last_step: Vec<f32>,
    /// How far each point by itself would have gone elsewhere in the last stage, eye distances.
    pub dissent: Vec<f32>,
    /// What each point says of whether it is to be seen; empty where that was not learned.
    pub seen: Vec<f32>,
}

/// Least length that signs tell apart, eye distances.
const FLOOR: f32 = 0.003;

/// Numbers of [`signs`].
pub const SIGNS: usize = 6;

/// How a point of two readings of a face went: logarithms of how far the two are apart, at the point and over all points, of the last
/// step, of the dissent from the shape at the point, and of the eye distance in pixels; and the verifier's score.
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

/// Largest share of the eye distance that is ever expected.
const MOST: f32 = 0.5;

impl ErrorModel {
    /// Logarithm of the error before calibration.
    pub fn sum(&self, point: usize, signs: &[f32; SIGNS]) -> f32 {
        let slopes: f32 = self.slopes.iter().zip(signs).map(|(a, b)| a * b).sum();
        self.intercepts.get(point).copied().unwrap_or(0.0) + slopes
    }

    /// The error to expect, over the eye distance: half of such points are further off, half less.
    pub fn expect(&self, point: usize, signs: &[f32; SIGNS]) -> f32 {
        let sum = self.sum(point, signs);
        // What hardly looks like a face is read with larger errors than any face here had.
        let strange = (self.low_score - signs[SIGNS - 1]).max(0.0);
        (self.calibrated(sum) + 1.5 * strange).exp().min(MOST)
    }

    /// The errors to expect of all points of two readings, over the eye distance, each looked at by itself; `eye_distance` in px.
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
