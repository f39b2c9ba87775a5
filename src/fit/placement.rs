//! How far a fitted node is expected to sit from its place on the face.
//!
//! The priors say how far the marks leave a node's place open: the deviation of the posterior, of coefficients, similarity and what the
//! modes do not hold, over the priors that compete ([`super::ShapePrior::explain_by_errors`]). To it comes how far the springs put the
//! node from where it was expected. The root of the sum of squares over the eye distance, the *spread*, is calibrated on people whom
//! priors and locator had not seen (`grimace evaluate placement`): for marks set by hand
//!
//! ```text
//! expected error = ES exp(c(ln spread))        c: piecewise linear, non-decreasing
//! ```
//!
//! and for marks that tell their errors the spread itself: they err together, so that many of them do not say as much as the priors, to
//! which each error is a matter of its own, take from them.

/// Marks set by hand: logarithms of the spread and of the median error, both over the eye distance.
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

/// The expected error of a node over the eye distance, from its spread and the share of the marks that tell their errors.
pub fn calibrated(spread: f64, told: f64) -> f64 {
    let score = spread.max(f64::MIN_POSITIVE).ln();
    let set = between(&SET, score);
    (set + told * (score - set)).exp().min(MOST)
}

/// The piecewise linear function through the knots, of slope 1 beyond the outermost.
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
        for told in [0.0, 0.5, 1.0] {
            let errors: Vec<f64> = (1..400).map(|k| calibrated(f64::from(k) / 1000.0, told)).collect();
            assert!(errors.windows(2).all(|e| e[0] <= e[1]), "{told}");
            assert!(errors.iter().all(|e| *e > 0.0 && *e <= MOST));
        }
        assert_relative_eq!(calibrated(0.02, 1.0), 0.02, epsilon = 1e-12);
        assert_relative_eq!(calibrated(9.0, 0.0), MOST);
    }
}
