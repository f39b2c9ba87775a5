//! A layer of pixels between lids or lips, with a soft border.

use image::RgbImage;
use nalgebra::{Point2, Vector2};
use tiny_skia::{FillRule, Mask, PathBuilder, Transform};

use super::{mouth::luma, raster, sample};
use crate::geometry::blur::gaussian;

/// Blur of the drawn content itself, px (sigma): its pixels are interpolated samples and anti-aliased outlines.
const DRAWN: f64 = 0.4;
/// Additional blur of colours against brightness, px (sigma).
const COLOURS: f64 = 1.2;

/// Pixels to be laid over a frame within an outline.
pub struct Layer {
    /// First column in the frame.
    pub left: u32,
    /// First row in the frame.
    pub top: u32,
    /// Columns.
    pub width: u32,
    height: u32,
    /// Colour, and whether it is set.
    pub pixels: Vec<([f32; 3], bool)>,
    coverage: Mask,
}

impl Layer {
    /// Creates a layer over the bounding box of an outline, clipped to the frame, with a margin for blurring by `softness` px; `None` if it lies
    /// outside the frame.
    pub fn new(outline: &[Point2<f64>], size: (u32, u32), softness: f64) -> Option<Self> {
        let margin = 2.0 + 3.0 * softness;
        let (mut low, mut high) = (outline.first().copied()?, outline.first().copied()?);
        for p in outline {
            low = low.inf(p);
            high = high.sup(p);
        }
        let clip = |value: f64, size: u32| value.clamp(0.0, f64::from(size)) as u32;
        let (left, top) = (clip(low.x - margin, size.0), clip(low.y - margin, size.1));
        let (right, bottom) = (clip(high.x + margin + 1.0, size.0), clip(high.y + margin + 1.0, size.1));
        let (width, height) = (right.checked_sub(left)?, bottom.checked_sub(top)?);
        let mut coverage = Mask::new(width, height)?;
        let mut path = PathBuilder::new();
        for (k, p) in outline.iter().enumerate() {
            // Pixel centres have integer coordinates in image space and half-integers here.
            let (x, y) = ((p.x + 0.5 - f64::from(left)) as f32, (p.y + 0.5 - f64::from(top)) as f32);
            if k == 0 { path.move_to(x, y) } else { path.line_to(x, y) }
        }
        path.close();
        coverage.fill_path(&path.finish()?, FillRule::EvenOdd, true, Transform::identity());
        let pixels = vec![([0.0; 3], false); width as usize * height as usize];
        Some(Self { left, top, width, height, pixels, coverage })
    }

    /// Fills a triangle of the layer. Values are interpolated between the corners; `colour` converts them, and the previous colour, to the new one.
    pub fn fill(&mut self, to: [Point2<f64>; 3], values: [Point2<f64>; 3], colour: impl Fn(Point2<f64>, [f32; 3]) -> [f32; 3]) {
        let origin = Vector2::new(f64::from(self.left), f64::from(self.top));
        let (width, pixels) = (self.width, &mut self.pixels);
        raster::fill(to.map(|p| p - origin), values, (width, self.height), |x, y, at| {
            let pixel = &mut pixels[(y * width + x) as usize];
            *pixel = (colour(at, pixel.0), true);
        });
    }

    /// Sets the colour of every pixel that the outline touches.
    pub fn paint(&mut self, colour: impl Fn(Point2<f64>) -> [f32; 3]) {
        for (k, pixel) in self.pixels.iter_mut().enumerate() {
            if self.coverage.data()[k] > 0 {
                let (x, y) = (k as u32 % self.width, k as u32 / self.width);
                *pixel = (colour(Point2::new(f64::from(self.left + x), f64::from(self.top + y))), true);
            }
        }
    }

    /// Gives pixels that the outline touches, but that no triangle has set, the mean colour of their neighbours.
    pub fn spread(&mut self) {
        let before = self.pixels.clone();
        let (width, height) = (i64::from(self.width), i64::from(self.height));
        for (k, pixel) in self.pixels.iter_mut().enumerate() {
            if pixel.1 || self.coverage.data()[k] == 0 {
                continue;
            }
            let (x, y) = (k as i64 % width, k as i64 / width);
            let (mut sum, mut count) = ([0.0_f32; 3], 0.0_f32);
            for (dx, dy) in [(0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)] {
                let (x, y) = (x + dx, y + dy);
                if (0..width).contains(&x) && (0..height).contains(&y) {
                    let (colour, true) = before[(y * width + x) as usize] else { continue };
                    (0..3).for_each(|c| sum[c] += colour[c]);
                    count += 1.0;
                }
            }
            if count > 0.0 {
                *pixel = (sum.map(|s| s / count), true);
            }
        }
    }

    /// Copies the pixels that are set to the frame, without blending, and empties the layer.
    pub fn lay_under(&mut self, frame: &mut RgbImage) {
        for (k, (colour, is_set)) in self.pixels.iter_mut().enumerate() {
            if std::mem::take(is_set) {
                let (x, y) = (k as u32 % self.width, k as u32 / self.width);
                frame.put_pixel(self.left + x, self.top + y, image::Rgb(colour.map(sample::byte)));
            }
        }
    }

    /// Blurs the border to the photograph's `sigma`, px. The colours at the border are extended beyond it.
    pub fn soften_border(&mut self, sigma: f64) {
        let sigma = missing(sigma);
        if sigma <= 0.0 {
            return;
        }
        self.soften_coverage(sigma);
        for _ in 0..(3.0 * sigma).ceil() as usize {
            self.spread();
        }
    }

    /// Blurs the border and the content. Colours blur more than brightness, also with the surrounding frame, as in all pictures stored with
    /// chroma subsampling.
    pub fn soften(&mut self, sigma: f64, frame: &RgbImage) {
        let sigma = missing(sigma);
        if sigma <= 0.0 {
            return;
        }
        self.soften_coverage(sigma);
        let weight = self.smooth(self.pixels.iter().map(|pixel| f32::from(u8::from(pixel.1))), sigma);
        let bright = self.smooth(self.pixels.iter().map(|pixel| if pixel.1 { luma(pixel.0) } else { 0.0 }), sigma);
        let around = |k: usize| {
            let (x, y) = (self.left + k as u32 % self.width, self.top + k as u32 / self.width);
            if self.pixels[k].1 { self.pixels[k].0 } else { frame.get_pixel(x, y).0.map(f32::from) }
        };
        let colours: Vec<[f32; 3]> = (0..self.pixels.len()).map(around).collect();
        let plane = |c: usize| self.smooth(colours.iter().map(|&colour| colour[c] - luma(colour)), sigma.hypot(COLOURS));
        let planes = [plane(0), plane(1), plane(2)];
        for (k, (colour, is_set)) in self.pixels.iter_mut().enumerate() {
            if weight[k] > 1e-3 {
                (*colour, *is_set) = (std::array::from_fn(|c| bright[k] / weight[k] + planes[c][k]), true);
            }
        }
    }

    fn smooth(&self, values: impl Iterator<Item = f32>, sigma: f64) -> Vec<f32> {
        gaussian(&values.collect::<Vec<f32>>(), self.width as usize, self.height as usize, (sigma, sigma))
    }

    fn soften_coverage(&mut self, sigma: f64) {
        let coverage = self.smooth(self.coverage.data().iter().map(|&level| f32::from(level)), sigma);
        self.coverage.data_mut().iter_mut().zip(&coverage).for_each(|(level, soft)| *level = sample::byte(*soft));
    }

    /// Blends the layer over the frame, weighted by the outline's coverage of each pixel.
    pub fn lay_on(&self, frame: &mut RgbImage) {
        for y in 0..self.height {
            for x in 0..self.width {
                let k = (y * self.width + x) as usize;
                let (colour, true) = self.pixels[k] else { continue };
                let share = f32::from(self.coverage.data()[k]) / 255.0;
                if share > 0.0 {
                    sample::lay(frame.get_pixel_mut(self.left + x, self.top + y), colour, share);
                }
            }
        }
    }
}

/// Sigma of the Gaussian that brings drawn content to a total blur of `sigma`, px.
fn missing(sigma: f64) -> f64 {
    (sigma * sigma - DRAWN * DRAWN).max(0.0).sqrt()
}
