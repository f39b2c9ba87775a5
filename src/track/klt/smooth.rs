//! Gaussian smoothing of grey values.

use crate::simd::widest;

/// Smooths an image, row by row, by a Gaussian of standard deviation `sigma` px, cut off at 4 `sigma`. The image is mirrored at the
/// borders, whose pixels do not repeat. A `sigma` of 0 changes nothing.
pub fn smoothed(values: Vec<f32>, width: usize, sigma: f64) -> Vec<f32> {
    if sigma <= 0.0 || width == 0 {
        return values;
    }
    widest(
        #[inline(always)]
        || smooth(values, width, sigma),
    )
}

#[inline(always)]
fn smooth(mut values: Vec<f32>, width: usize, sigma: f64) -> Vec<f32> {
    let kernel = half_kernel(sigma);
    let (reach, height) = (kernel.len() - 1, values.len() / width);
    let mut padded = vec![0.0; width + 2 * reach];
    for row in values.chunks_exact_mut(width) {
        padded[reach..reach + width].copy_from_slice(row);
        for k in 1..=reach {
            padded[reach - k] = row[mirrored(-(k as isize), width)];
            padded[reach + width - 1 + k] = row[mirrored((width - 1 + k) as isize, width)];
        }
        row.iter_mut().zip(&padded[reach..]).for_each(|(out, centre)| *out = kernel[0] * centre);
        for (k, weight) in kernel.iter().enumerate().skip(1) {
            let sides = padded[reach - k..].iter().zip(&padded[reach + k..]);
            row.iter_mut().zip(sides).for_each(|(out, (a, b))| *out += weight * (a + b));
        }
    }
    let mut out = values.clone();
    for (y, row) in out.chunks_exact_mut(width).enumerate() {
        row.iter_mut().for_each(|out| *out *= kernel[0]);
        for (k, weight) in kernel.iter().enumerate().skip(1) {
            let [above, below] = [y as isize - k as isize, (y + k) as isize].map(|y| mirrored(y, height) * width);
            let sides = values[above..above + width].iter().zip(&values[below..below + width]);
            row.iter_mut().zip(sides).for_each(|(out, (a, b))| *out += weight * (a + b));
        }
    }
    out
}

/// Returns the middle of the kernel and the weights to one side.
fn half_kernel(sigma: f64) -> Vec<f32> {
    let reach = (((sigma * 8.0 + 1.0).round() as usize) | 1) / 2;
    let weights: Vec<f64> = (0..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let sum = 2.0 * weights.iter().sum::<f64>() - weights[0];
    weights.iter().map(|w| (w / sum) as f32).collect()
}

fn mirrored(at: isize, size: usize) -> usize {
    let last = size as isize - 1;
    if last == 0 {
        return 0;
    }
    let at = at.rem_euclid(2 * last);
    at.min(2 * last - at) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_becomes_the_kernel_and_nothing_is_lost() {
        let mut point = vec![0.0; 15 * 15];
        point[7 * 15 + 7] = 100.0;
        let out = smoothed(point.clone(), 15, 0.5);
        // exp(-2) = 0.13534 and exp(-8) = 0.00034 beside the 1 in the middle: 1 / 1.27134 = 0.78657, squared 0.61869.
        assert!((out[7 * 15 + 7] - 61.869).abs() < 0.01, "{}", out[7 * 15 + 7]);
        assert!((out[7 * 15 + 8] / out[7 * 15 + 7] - 0.1353).abs() < 1e-4);
        assert!((out.iter().sum::<f32>() - 100.0).abs() < 1e-3);
        assert_eq!(smoothed(point.clone(), 15, 0.0), point);
        assert_eq!(smoothed(vec![5.0], 1, 2.0).len(), 1);
    }
}
