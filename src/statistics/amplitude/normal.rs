//! Quantiles and probabilities of Student's t and the normal distribution, from `statrs`.

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// Returns the quantile of Student's t distribution with `freedom` > 0 degrees of freedom below which `share` of it lies.
pub(crate) fn t_quantile(share: f64, freedom: f64) -> Option<f64> {
    StudentsT::new(0.0, 1.0, freedom).ok().map(|t| t.inverse_cdf(share)).filter(|t| t.is_finite())
}

/// Returns the probability of a larger t.
pub(crate) fn t_above(t: f64, freedom: f64) -> Option<f64> {
    StudentsT::new(0.0, 1.0, freedom).ok().map(|distribution| distribution.sf(t)).filter(|p| p.is_finite())
}

/// Returns the quantile z of the standard normal distribution below which `share` of it lies.
pub(super) fn normal_quantile(share: f64) -> Option<f64> {
    Normal::new(0.0, 1.0).ok().map(|z| z.inverse_cdf(share)).filter(|z| z.is_finite())
}
