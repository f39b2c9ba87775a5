//! The order statistic that tracking and statistics share.

/// Standard deviation of a normal distribution over its median absolute deviation.
pub const MAD_TO_SIGMA: f64 = 1.4826;

/// Median of the values, which it reorders; of an even number the mean of the two middle ones; `None` of none.
pub fn median(values: &mut [f64]) -> Option<f64> {
    let half = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    let even = values.len().is_multiple_of(2);
    let (below, &mut upper, _) = values.select_nth_unstable_by(half, f64::total_cmp);
    let lower = below.iter().copied().max_by(f64::total_cmp).filter(|_| even);
    Some(lower.map_or(upper, |lower| f64::midpoint(lower, upper)))
}
