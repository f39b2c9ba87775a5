//! Similarity of two pictures of a face: SSIM and PSNR of the grey levels inside a region.
//!
//! SSIM follows Wang, Bovik, Sheikh and Simoncelli (IEEE Trans. Image Processing 13, 2004): Gaussian window of 11 x 11 pixels with sigma
//! 1.5, K1 = 0.01, K2 = 0.03, range 255. The mean covers the pixels of the region only.

use grimace::internal::geometry::polygon::inside;
use image::{GrayImage, RgbImage};
use nalgebra::Point2;

/// Half the side of the window, px.
const RADIUS: i64 = 5;
/// Standard deviation of the window, px.
const SIGMA: f64 = 1.5;
/// C1 = (K1 L)^2, and C2 = (K2 L)^2 below.
const C1: f64 = 6.5025;
const C2: f64 = 58.5225;

/// Similarity of two pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likeness {
    /// Structural similarity, 1 for equal pictures.
    pub ssim: f64,
    /// Peak signal-to-noise ratio, dB; infinite for equal pictures.
    pub psnr_db: f64,
}

/// Compares two pictures of equal size inside a polygon. Returns `None` when the polygon contains no pixel.
pub fn likeness(a: &RgbImage, b: &RgbImage, region: &[Point2<f64>]) -> Option<Likeness> {
    let (a, b) = (image::imageops::grayscale(a), image::imageops::grayscale(b));
    if a.dimensions() != b.dimensions() || region.len() < 3 {
        return None;
    }
    let kernel: Vec<f64> = (-RADIUS..=RADIUS).map(|d| (-(d as f64).powi(2) / (2.0 * SIGMA * SIGMA)).exp()).collect();
    let (mut ssim, mut square, mut count) = (0.0, 0.0, 0.0);
    for y in 0..a.height() {
        for x in 0..a.width() {
            if !inside(region, &Point2::new(f64::from(x), f64::from(y))) {
                continue;
            }
            ssim += ssim_at(&a, &b, x, y, &kernel);
            square += (f64::from(a.get_pixel(x, y).0[0]) - f64::from(b.get_pixel(x, y).0[0])).powi(2);
            count += 1.0;
        }
    }
    (count > 0.0).then(|| Likeness { ssim: ssim / count, psnr_db: 10.0 * (255.0 * 255.0 / (square / count)).log10() })
}

fn ssim_at(a: &GrayImage, b: &GrayImage, x: u32, y: u32, kernel: &[f64]) -> f64 {
    let (width, height) = (i64::from(a.width()), i64::from(a.height()));
    let mut sums = [0.0; 6];
    for (dy, ky) in (-RADIUS..=RADIUS).zip(kernel) {
        let row = (i64::from(y) + dy).clamp(0, height - 1) as u32;
        for (dx, kx) in (-RADIUS..=RADIUS).zip(kernel) {
            let column = (i64::from(x) + dx).clamp(0, width - 1) as u32;
            let (p, q) = (f64::from(a.get_pixel(column, row).0[0]), f64::from(b.get_pixel(column, row).0[0]));
            let w = kx * ky;
            for (sum, value) in sums.iter_mut().zip([1.0, p, q, p * p, q * q, p * q]) {
                *sum += w * value;
            }
        }
    }
    let [n, p, q, pp, qq, pq] = sums;
    let (mp, mq) = (p / n, q / n);
    let (vp, vq, cov) = (pp / n - mp * mp, qq / n - mq * mq, pq / n - mp * mq);
    (2.0 * mp * mq + C1) * (2.0 * cov + C2) / ((mp * mp + mq * mq + C1) * (vp + vq + C2))
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    fn square(side: f64) -> Vec<Point2<f64>> {
        [(-0.5, -0.5), (side, -0.5), (side, side), (-0.5, side)].map(|(x, y)| Point2::new(x, y)).to_vec()
    }

    #[test]
    fn equal_pictures_are_alike_and_a_shift_in_brightness_has_its_known_psnr() {
        let a = RgbImage::from_fn(20, 20, |x, y| Rgb([(x * 9 + y * 3) as u8; 3]));
        let same = likeness(&a, &a, &square(19.5)).unwrap();
        assert!((same.ssim - 1.0).abs() < 1e-12 && same.psnr_db.is_infinite());
        let brighter = RgbImage::from_fn(20, 20, |x, y| Rgb([(x * 9 + y * 3 + 10) as u8; 3]));
        // An error of 10 everywhere gives 10 log10(65025 / 100) = 28.13 dB.
        assert!((likeness(&a, &brighter, &square(19.5)).unwrap().psnr_db - 28.13).abs() < 0.01);
    }

    #[test]
    fn flat_pictures_follow_the_formula() {
        // Without variance SSIM is (2 m n + C1) / (m^2 + n^2 + C1): 100 and 120 give 24006.5 / 24406.5 = 0.98361.
        let flat = |v: u8| RgbImage::from_pixel(16, 16, Rgb([v; 3]));
        let found = likeness(&flat(100), &flat(120), &square(15.5)).unwrap();
        assert!((found.ssim - 0.98361).abs() < 1e-5);
        assert!(likeness(&flat(1), &flat(2), &[]).is_none());
    }
}
