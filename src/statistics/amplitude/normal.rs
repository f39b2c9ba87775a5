//! Student's t and normal distributions, from `statrs`.

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// The t that a share of the distribution with `freedom` degrees of freedom, greater than 0, lies under.
pub(crate) fn t_quantile(share: f64, freedom: f64) -> Option<f64> {
    StudentsT::new(0.0, 1.0, freedom).ok().map(|t| t.inverse_cdf(share)).filter(|t| t.is_finite())
}

/// The chance of a larger t.
pub(crate) fn t_above(t: f64, freedom: f64) -> Option<f64> {
    StudentsT::new(0.0, 1.0, freedom).ok().map(|distribution| distribution.sf(t)).filter(|p| p.is_finite())
}

/// The z that a share of the normal distribution lies under.
pub(super) fn normal_quantile(share: f64) -> Option<f64> {
    Normal::new(0.0, 1.0).ok().map(|z| z.inverse_cdf(share)).filter(|z| z.is_finite())
}
