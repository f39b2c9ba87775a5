//! Textures that are read between their pixels.

use image::{GrayImage, RgbImage};
use nalgebra::Point2;

use crate::sequence::colour_of;

/// An image prepared for sub-pixel sampling: Catmull-Rom bicubic, which is exact on pixel centres and keeps edges crisp. Beyond the
/// border the border's pixels go on.
#[derive(Clone, Debug)]
pub struct Texture {
    width: u32,
    height: u32,
    /// Four bytes a pixel, with a border of [`BORDER`] pixels.
    pixels: Vec<[u8; 4]>,
    stride: usize,
}

/// Pixels that the kernel reaches beyond the image.
const BORDER: usize = 2;

impl Texture {
    /// The texture of a colour image.
    pub fn new(image: &RgbImage) -> Self {
        let (width, height) = image.dimensions();
        let stride = width as usize + 2 * BORDER;
        let mut pixels = vec![[0; 4]; stride * (height as usize + 2 * BORDER)];
        let raw = image.as_raw();
        for (y, row) in pixels.chunks_exact_mut(stride).enumerate() {
            let from = y.saturating_sub(BORDER).min(height.saturating_sub(1) as usize) * width as usize * 3;
            for (x, pixel) in row.iter_mut().enumerate() {
                let at = from + x.saturating_sub(BORDER).min(width.saturating_sub(1) as usize) * 3;
                if let Some(&[r, g, b]) = raw.get(at..at + 3) {
                    *pixel = [r, g, b, 255];
                }
            }
        }
        Self { width, height, pixels, stride }
    }

    /// The texture of a grey image: three equal channels.
    pub fn from_gray(image: &GrayImage) -> Self {
        Self::new(&colour_of(image))
    }

    /// Width and height, px.
    pub fn dimensions(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// The image itself, into one of the same size.
    pub(super) fn copy_to(&self, image: &mut RgbImage) {
        let width = self.width as usize;
        for (y, row) in image.as_flat_samples_mut().samples.chunks_exact_mut(3 * width.max(1)).enumerate() {
            let start = (y + BORDER) * self.stride + BORDER;
            for (to, from) in row.chunks_exact_mut(3).zip(&self.pixels[start..start + width]) {
                to.copy_from_slice(&from[..3]);
            }
        }
    }

    /// Colour at a position (px, the centre of the top-left pixel is (0, 0)), 0 to 255 per channel, not clamped: the kernel may
    /// overshoot at edges.
    pub fn sample(&self, at: Point2<f64>) -> [f32; 3] {
        let x = (at.x.max(-1.0)).min(f64::from(self.width));
        let y = (at.y.max(-1.0)).min(f64::from(self.height));
        let (x0, y0) = (floor(x), floor(y));
        let (wx, wy) = (catmull_rom((x - x0) as f32), catmull_rom((y - y0) as f32));
        // The kernel's first pixel is one before the floor; with the border that is one after it.
        let column = ((x0 as isize + BORDER as isize - 1).max(0) as usize).min(self.stride.saturating_sub(4));
        let rows = self.height as usize + 2 * BORDER;
        let row = ((y0 as isize + BORDER as isize - 1).max(0) as usize).min(rows.saturating_sub(4));
        let mut sum = [0.0_f32; 4];
        for (k, &wy) in wy.iter().enumerate() {
            let start = (row + k) * self.stride + column;
            let Some(line) = self.pixels.get(start..start + 4) else { continue };
            let mut part = [0.0_f32; 4];
            for (pixel, &wx) in line.iter().zip(&wx) {
                for c in 0..4 {
                    part[c] += wx * f32::from(pixel[c]);
                }
            }
            for c in 0..4 {
                sum[c] += wy * part[c];
            }
        }
        [sum[0], sum[1], sum[2]]
    }
}

/// The largest whole number not above one that 32 bits hold; `f64::floor` is a call for older processors.
fn floor(value: f64) -> f64 {
    let whole = f64::from(value as i32);
    if whole > value { whole - 1.0 } else { whole }
}

/// Weights of the four pixels around a place, `t` in 0..1 past the second.
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (-t3 + 2.0 * t2 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (-3.0 * t3 + 4.0 * t2 + t), 0.5 * (t3 - t2)]
}

/// A channel as a byte.
pub fn byte(value: f32) -> u8 {
    // Of what is not negative the same as rounding, which is a call for older processors.
    (value + 0.5).clamp(0.0, 255.0) as u8
}

/// Renders an image of a given size through any dense map: `source` says for every pixel of the result where in the texture it comes
/// from (`None` leaves it black). A map known in closed form gives exact ground truth.
pub fn resample(texture: &Texture, size: (u32, u32), source: impl Fn(Point2<f64>) -> Option<Point2<f64>>) -> RgbImage {
    RgbImage::from_fn(size.0, size.1, |x, y| {
        let from = source(Point2::new(f64::from(x), f64::from(y)));
        image::Rgb(from.map_or([0; 3], |from| texture.sample(from).map(byte)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampling_is_exact_on_pixels_and_on_ramps_and_goes_on_beyond_the_border() {
        let image = RgbImage::from_fn(8, 6, |x, y| image::Rgb([20 * x as u8, 30 * y as u8, 7]));
        let texture = Texture::new(&image);
        assert_eq!(resample(&texture, (8, 6), Some), image);
        // A cubic through a straight ramp is the ramp: 20 * 3.25 = 65, 30 * 2.5 = 75.
        let [r, g, b] = texture.sample(Point2::new(3.25, 2.5));
        assert!((r - 65.0).abs() < 1e-3 && (g - 75.0).abs() < 1e-3 && (b - 7.0).abs() < 1e-3);
        assert_eq!(texture.sample(Point2::new(-50.0, 900.0)).map(byte), [0, 150, 7]);
        assert_eq!(texture.sample(Point2::new(1e12, -1e12)).map(byte), [140, 0, 7]);
    }

    #[test]
    fn the_largest_whole_number_not_above() {
        for value in [-1.0, -0.999, -1e-17, -0.0, 0.0, 0.999_999, 1.0, 1.5, 65_535.0, 65_534.999_9] {
            assert_eq!(floor(value), value.floor(), "{value}");
        }
    }

    #[test]
    fn an_image_of_one_pixel_can_be_sampled() {
        let texture = Texture::new(&RgbImage::from_pixel(1, 1, image::Rgb([9, 8, 7])));
        assert_eq!(texture.sample(Point2::new(0.3, -2.0)).map(byte), [9, 8, 7]);
    }
}
