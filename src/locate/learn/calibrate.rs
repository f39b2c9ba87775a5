//! Learns expected errors from readings of people outside the training data of the stages that read them.

use nalgebra::{DMatrix, DVector};

use crate::modules::locate::{
    expect::Reading,
    expect::{SIGNS, signs},
    model::ErrorModel,
    points,
};

/// A face with two readings and the true positions.
#[derive(Clone, Debug)]
pub struct JudgedReading {
    /// Readings of the picture and of its mirror image.
    pub readings: [Reading; 2],
    /// Distance between the two readings at each point, eye distances.
    pub apart: Vec<f32>,
    /// Eye distance of the readings, px.
    pub eye_distance: f32,
    /// Error of each point of the mean of both readings, over the true eye distance.
    pub errors: Vec<f32>,
}

/// Smallest error that is distinguished, over the eye distance.
const FLOOR: f32 = 0.001;

/// Number of knots of the calibration.
const KNOTS: usize = 9;

/// Returns the upper median; 0 for no values.
pub fn median(values: &mut [f32]) -> f32 {
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Learns the model. Slopes are fitted by least squares of logarithms, common to all points; the intercept of each point and then the
/// calibration by medians, so that the expected error is a median.
pub fn learn_errors(judged: &[JudgedReading]) -> ErrorModel {
    let count = points().len();
    let row = |reading: &JudgedReading, k: usize| {
        signs(k, &reading.apart, [&reading.readings[0], &reading.readings[1]], reading.eye_distance)
    };
    let log = |error: f32| (error + FLOOR).ln();
    // The means of each point are removed, then one regression is fitted to all points.
    let mut gram = DMatrix::<f64>::identity(SIGNS, SIGNS);
    let mut right = DVector::<f64>::zeros(SIGNS);
    let share = 1.0 / judged.len().max(1) as f64;
    for k in 0..count {
        let rows: Vec<([f32; SIGNS], f32)> = judged.iter().map(|r| (row(r, k), log(r.errors[k]))).collect();
        let mean: [f64; SIGNS] = std::array::from_fn(|s| rows.iter().map(|r| f64::from(r.0[s])).sum::<f64>() * share);
        let mean_error = rows.iter().map(|r| f64::from(r.1)).sum::<f64>() * share;
        for (numbers, error) in &rows {
            let centred = DVector::from_fn(SIGNS, |s, _| f64::from(numbers[s]) - mean[s]);
            gram += &centred * centred.transpose();
            right += &centred * (f64::from(*error) - mean_error);
        }
    }
    let slopes = gram.cholesky().map_or_else(|| DVector::zeros(SIGNS), |c| c.solve(&right));
    let mut model = ErrorModel { slopes: slopes.iter().map(|&s| s as f32).collect(), ..ErrorModel::default() };
    model.intercepts = vec![0.0; count];
    for k in 0..count {
        let mut left: Vec<f32> = judged.iter().map(|r| log(r.errors[k]) - model.sum(k, &row(r, k))).collect();
        model.intercepts[k] = median(&mut left);
    }
    let mut pairs: Vec<(f32, f32)> = judged
        .iter()
        .flat_map(|r| (0..count).map(|k| (model.sum(k, &row(r, k)), r.errors[k].max(FLOOR).ln())).collect::<Vec<_>>())
        .collect();
    pairs.sort_by(|p, q| p.0.total_cmp(&q.0));
    let size = pairs.len().div_ceil(KNOTS).max(1);
    for part in pairs.chunks(size) {
        let mut sums: Vec<f32> = part.iter().map(|p| p.0).collect();
        let mut errors: Vec<f32> = part.iter().map(|p| p.1).collect();
        let knot = [median(&mut sums), median(&mut errors)];
        // The expected error does not decrease with the sum.
        let floor = model.knots.last().map_or(f32::MIN, |k| k[1]);
        model.knots.push([knot[0], knot[1].max(floor)]);
    }
    let mut scores: Vec<f32> = judged.iter().map(|r| 0.5 * (r.readings[0].score + r.readings[1].score)).collect();
    scores.sort_by(f32::total_cmp);
    model.low_score = scores.get(scores.len() / 100).copied().unwrap_or(0.0);
    model
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_that_follow_a_sign_are_expected() {
        // Errors alternate between half and twice the distance of the two readings: their median is that distance times 1 (geometric).
        let count = points().len();
        let judged: Vec<JudgedReading> = (0..80)
            .map(|i| {
                let apart = 0.01 * 1.05_f32.powi(i % 40);
                let reading = Reading {
                    shape: vec![[0.0; 2]; count],
                    score: 1.0,
                    last_step: vec![0.01; count],
                    dissent: vec![0.01; count],
                    seen: Vec::new(),
                    mouth: [0.0; 2],
                };
                let errors =
                    (0..count).map(|k| if (k + i as usize / 40).is_multiple_of(2) { 0.5 } else { 2.0 } * apart).collect();
                JudgedReading { readings: [reading.clone(), reading], apart: vec![apart; count], eye_distance: 50.0, errors }
            })
            .collect();
        let model = learn_errors(&judged);
        for reading in &judged {
            let expected = model.expect(3, &signs(3, &reading.apart, [&reading.readings[0], &reading.readings[1]], 50.0));
            let share = expected / reading.apart[3];
            assert!((0.45..2.2).contains(&share), "{share}");
        }
        let over = judged
            .iter()
            .flat_map(|r| (0..count).map(move |k| (r, k)))
            .filter(|(r, k)| r.errors[*k] > model.expect(*k, &signs(*k, &r.apart, [&r.readings[0], &r.readings[1]], 50.0)));
        let share = over.count() as f64 / (judged.len() * count) as f64;
        assert!((0.3..0.7).contains(&share), "{share}");
    }
}
