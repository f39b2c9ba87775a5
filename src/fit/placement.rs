//! Expected error of a fitted node's position on the face.
//!
//! The priors give the posterior standard deviation of a node's position given the marks: that of coefficients, similarity and the residual
//! of the modes, over the competing priors (`ShapePrior::explain_by_errors`). The distance by which the springs move the node from
//! its predicted position is added. The root of the sum of squares over the eye distance, the *spread*, is calibrated on people outside the
//! training data of priors and locator (`grimace evaluate placement`): for marks set by hand
//!
//! ```text
//! expected error = ES exp(c(ln spread))        c: piecewise linear, non-decreasing
//! ```
//!
//! For marks with an expected error it is the spread itself. The errors of such marks are correlated, so many of them carry less
//! information than the priors assume, which treat each error as independent.

/// Calibration for marks set by hand: logarithms of the spread and of the median error, both over the eye distance.
const SET: [(f64, f64); 8] = [
    (-3.98, -4.36),
    (-3.69, -4.12),
    (-3.49, -3.86),
    (-3.24, -3.50),
    (-2.99, -3.22),
    (-2.71, -2.96),
    (-2.28, -2.47),
    (-1.93, -2.08),
];

/// Largest expected error over the eye distance.
const MOST: f64 = 0.5;

/// Returns the expected error of a node over the eye distance, from its spread and the share of marks with an expected error.
pub fn calibrated(spread: f64, found_share: f64) -> f64 {
    let score = spread.max(f64::MIN_POSITIVE).ln();
    let set = between(&SET, score);
    (set + found_share * (score - set)).exp().min(MOST)
}

/// Evaluates the piecewise linear function through the knots, with slope 1 beyond the outermost.
pub fn between(knots: &[(f64, f64)], at: f64) -> f64 {
    let (Some(first), Some(last)) = (knots.first(), knots.last()) else { return at };
    if at <= first.0 {
        return first.1 + at - first.0;
    }
    let pair = knots.windows(2).find(|pair| at <= pair[1].0);
    pair.map_or(last.1 + at - last.0, |k| k[0].1 + (k[1].1 - k[0].1) * (at - k[0].0) / (k[1].0 - k[0].0))
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    #[test]
    fn knots_are_met_and_joined_and_go_on_in_proportion() {
        let knots = [(-4.0, -5.0), (-2.0, -2.0)];
        for (at, expected) in [(-4.0, -5.0), (-3.0, -3.5), (-2.0, -2.0), (-5.0, -6.0), (-1.0, -1.0)] {
            assert_relative_eq!(between(&knots, at), expected, epsilon = 1e-12);
        }
    }

    #[test]
    fn more_spread_is_never_less_error_whoever_set_the_marks() {
        for found_share in [0.0, 0.5, 1.0] {
            let errors: Vec<f64> = (1..400).map(|k| calibrated(f64::from(k) / 1000.0, found_share)).collect();
            assert!(errors.windows(2).all(|e| e[0] <= e[1]), "{found_share}");
            assert!(errors.iter().all(|e| *e > 0.0 && *e <= MOST));
        }
        assert_relative_eq!(calibrated(0.02, 1.0), 0.02, epsilon = 1e-12);
        assert_relative_eq!(calibrated(9.0, 0.0), MOST);
    }
}
