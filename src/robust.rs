//! Robust statistics that tracking and the statistics share.

/// Ratio of the standard deviation of a normal distribution to its median absolute deviation.
pub const MAD_TO_SIGMA: f64 = 1.4826;

/// Returns the median of the values, or `None` if there are none. For an even number it is the mean of the two middle values. Reorders
/// `values`.
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
