//! Sums that are the same on every machine and still use its vector units.

use crate::simd::widest;

const LANES: usize = 16;

/// Returns the scalar product of two vectors of the same length.
pub fn dot(a: &[f32], b: &[f32]) -> f32 {
    widest(
        #[inline(always)]
        || product(a, b),
    )
}

/// [`dot`] for code that already runs within [`widest`].
#[inline(always)]
pub fn product(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0_f32; LANES];
    let (wide_a, wide_b) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f32 = wide_a.remainder().iter().zip(wide_b.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in wide_a.zip(wide_b) {
        for k in 0..LANES {
            sums[k] += x[k] * y[k];
        }
    }
    sums.iter().sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    #[test]
    fn sums_of_any_length() {
        // 1 + 4 + ... + n^2 = n (n + 1) (2 n + 1) / 6.
        for n in [0_u16, 3, 16, 37] {
            let values: Vec<f32> = (1..=n).map(f32::from).collect();
            let n = f32::from(n);
            approx::assert_relative_eq!(super::dot(&values, &values), n * (n + 1.0) * (2.0 * n + 1.0) / 6.0);
        }
    }
}
