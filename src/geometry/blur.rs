//! Gaussian smoothing of grids.

/// Smooths a row-major grid with a Gaussian. `sigma` is its standard deviation across and down, in cells. Border values are continued
/// outside the grid.
pub fn gaussian(values: &[f32], width: usize, height: usize, sigma: (f64, f64)) -> Vec<f32> {
    let kernel = |sigma: f64| -> (i64, Vec<f32>, f32) {
        let radius = (3.0 * sigma).ceil().max(1.0) as i64;
        let kernel: Vec<f32> = (-radius..=radius).map(|d| (-(d as f64).powi(2) / (2.0 * sigma * sigma)).exp() as f32).collect();
        let sum = kernel.iter().sum();
        (radius, kernel, sum)
    };
    let (w, h) = (width as i64, height as i64);
    let (radius, weights, sum) = kernel(sigma.0);
    let mut across = vec![0.0; values.len()];
    let mut padded = vec![0.0_f32; width + 2 * radius as usize];
    for (row, to) in values.chunks_exact(width.max(1)).zip(across.chunks_exact_mut(width.max(1))) {
        padded.iter_mut().zip(-radius..).for_each(|(value, x)| *value = row[x.clamp(0, w - 1) as usize]);
        for (k, weight) in weights.iter().enumerate() {
            add(to, &padded[k..], *weight);
        }
        to.iter_mut().for_each(|to| *to /= sum);
    }
    let (radius, weights, sum) = kernel(sigma.1);
    let mut down = vec![0.0; values.len()];
    for (k, d) in weights.iter().zip(-radius..) {
        for y in 0..h {
            let from = ((y + d).clamp(0, h - 1) * w) as usize;
            let to = (y * w) as usize;
            add(&mut down[to..][..width], &across[from..][..width], k / sum);
        }
    }
    down
}

/// Adds `weight` times the values, as many as there are sums. A plain loop is fast even where nothing is optimized, as in unit tests.
fn add(sums: &mut [f32], values: &[f32], weight: f32) {
    let values = &values[..sums.len()];
    let mut k = 0;
    while k < sums.len() {
        sums[k] += weight * values[k];
        k += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoothing_keeps_what_is_even_and_the_sum_of_what_is_not() {
        assert!(gaussian(&[7.0; 35], 7, 5, (1.3, 1.3)).iter().all(|v| (v - 7.0).abs() < 1e-4));
        let mut spot = vec![0.0; 21 * 21];
        spot[10 * 21 + 10] = 100.0;
        let smoothed = gaussian(&spot, 21, 21, (1.5, 1.5));
        assert!((smoothed.iter().sum::<f32>() - 100.0).abs() < 1e-2);
        // The peak of a Gaussian of sigma 1.5 is 100 / (2 pi 2.25) = 7.07.
        assert!((smoothed[10 * 21 + 10] - 7.07).abs() < 0.1);
        // Of one that is twice as wide across as down, 100 / (2 pi 1.5 3) = 3.54; 3 cells to the side 0.607 of it.
        let wide = gaussian(&spot, 21, 21, (3.0, 1.5));
        assert!((wide[10 * 21 + 10] - 3.54).abs() < 0.05 && (wide[10 * 21 + 13] / wide[10 * 21 + 10] - 0.607).abs() < 0.005);
    }
}
