//! Textures with sub-pixel sampling, and the drawing of sampled pixels.

use image::{GrayImage, RgbImage};
use nalgebra::{Point2, Vector2};

use super::raster::Span;
use crate::{sequence::colour_of, simd::widest};

/// An image prepared for sub-pixel sampling: Catmull-Rom bicubic, exact at pixel centres and sharp at edges. Beyond the border, the
/// border's pixels continue.
#[derive(Clone, Debug)]
pub struct Texture {
    width: u32,
    height: u32,
    /// Four bytes per pixel, with a border of [`BORDER`] pixels.
    pixels: Vec<[u8; 4]>,
    stride: usize,
}

/// Pixels that the kernel reaches beyond the image.
const BORDER: usize = 2;

impl Texture {
    /// Creates the texture of a colour image.
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

    /// Creates the texture of a grey image, with three equal channels.
    pub fn from_gray(image: &GrayImage) -> Self {
        Self::new(&colour_of(image))
    }

    /// Width and height, px.
    pub fn dimensions(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Copies the image into one of the same size.
    pub(super) fn copy_to(&self, image: &mut RgbImage) {
        let width = self.width as usize;
        for (y, row) in image.as_flat_samples_mut().samples.chunks_exact_mut(3 * width.max(1)).enumerate() {
            let start = (y + BORDER) * self.stride + BORDER;
            for (to, from) in row.chunks_exact_mut(3).zip(&self.pixels[start..start + width]) {
                to.copy_from_slice(&from[..3]);
            }
        }
    }

    /// Returns the texture with some pixels multiplied by factors. Each line gives a row, a first column and an index into `factors` per pixel;
    /// each channel has its own factors.
    pub(crate) fn times<'a>(&self, lines: impl Iterator<Item = (usize, usize, &'a [u8])>, factors: &[[f32; 256]; 3]) -> Self {
        let mut texture = self.clone();
        for (row, column, numbers) in lines {
            let start = (row + BORDER) * self.stride + BORDER + column;
            let pixels = &mut texture.pixels[start..start + numbers.len()];
            widest(
                #[inline(always)]
                || {
                    for (pixel, number) in pixels.iter_mut().zip(numbers) {
                        for (channel, factors) in pixel.iter_mut().zip(factors) {
                            *channel = byte(f32::from(*channel) * factors[usize::from(*number)]);
                        }
                    }
                },
            );
        }
        texture.renew_border();
        texture
    }

    /// Fills the border with the image's edge pixels.
    fn renew_border(&mut self) {
        let (width, height, stride) = (self.width as usize, self.height as usize, self.stride);
        if width == 0 || height == 0 {
            return;
        }
        for row in self.pixels.chunks_exact_mut(stride) {
            let (first, last) = (row[BORDER], row[BORDER + width - 1]);
            row[..BORDER].fill(first);
            row[BORDER + width..].fill(last);
        }
        for k in 0..BORDER {
            self.pixels.copy_within(BORDER * stride..(BORDER + 1) * stride, k * stride);
            self.pixels.copy_within((BORDER + height - 1) * stride..(BORDER + height) * stride, (BORDER + height + k) * stride);
        }
    }

    /// Samples the colour at a position (px, the centre of the top-left pixel is (0, 0)). Levels of 0 to 255 per channel are not clamped: the
    /// kernel may overshoot at edges.
    pub fn sample(&self, at: Point2<f64>) -> [f32; 3] {
        let [red, green, blue, _] = widest(
            #[inline(always)]
            || {
                let (columns, rows, across, down) = self.kernels([at.x], [at.y]);
                self.weighted(columns[0], rows[0], across.map(|w| w[0]), down.map(|w| w[0]))
            },
        );
        [red, green, blue]
    }

    /// [`Texture::sample`] at many positions, with a meaningless fourth channel.
    pub(super) fn sample_all(&self, (x, y): (&[f64], &[f64]), colours: &mut [[f32; 4]]) {
        widest(
            #[inline(always)]
            || {
                let ((x, x_rest), (y, y_rest)) = (x.as_chunks::<LANES>(), y.as_chunks::<LANES>());
                let (eights, rest) = colours.as_chunks_mut::<LANES>();
                for ((x, y), colours) in x.iter().zip(y).zip(eights) {
                    let (columns, rows, across, down) = self.kernels(*x, *y);
                    for k in 0..LANES {
                        colours[k] = self.weighted(columns[k], rows[k], across.map(|w| w[k]), down.map(|w| w[k]));
                    }
                }
                for ((x, y), colour) in x_rest.iter().zip(y_rest).zip(rest) {
                    let (columns, rows, across, down) = self.kernels([*x], [*y]);
                    *colour = self.weighted(columns[0], rows[0], across.map(|w| w[0]), down.map(|w| w[0]));
                }
            },
        );
    }

    /// First column and row of the 4 x 4 pixels around each position, and their weights across and down.
    #[inline(always)]
    #[allow(clippy::type_complexity)]
    fn kernels<const N: usize>(&self, x: [f64; N], y: [f64; N]) -> ([u32; N], [u32; N], [[f32; N]; 4], [[f32; N]; 4]) {
        let (columns, across) = kernel(x, self.width, self.stride);
        let (rows, down) = kernel(y, self.height, self.height as usize + 2 * BORDER);
        (columns, rows, across, down)
    }

    /// Weighted sum of the 4 x 4 pixels from a column and a row on.
    #[inline(always)]
    fn weighted(&self, column: u32, row: u32, across: [f32; 4], down: [f32; 4]) -> [f32; 4] {
        let start = row as usize * self.stride + column as usize;
        let mut sum = [0.0_f32; 4];
        let Some(pixels) = self.pixels.get(start..start + 3 * self.stride + 4) else { return sum };
        let shares: [f32; 16] = std::array::from_fn(|k| across[k / 4]);
        for (k, &down) in down.iter().enumerate() {
            let line = &pixels[k * self.stride..k * self.stride + 4];
            let (line, _) = line.as_flattened().as_chunks::<16>();
            let mut parts = [0.0_f32; 16];
            for k in 0..16 {
                parts[k] = shares[k] * f32::from(line[0][k]);
            }
            for c in 0..4 {
                sum[c] += down * (parts[c] + parts[4 + c] + parts[8 + c] + parts[12 + c]);
            }
        }
        sum
    }
}

/// Positions that are sampled at once.
const LANES: usize = 8;

/// For positions along one axis of `size` pixels (`count` with the border): index of the first of the four surrounding pixels, counted with
/// the border, and their weights.
#[inline(always)]
fn kernel<const N: usize>(at: [f64; N], size: u32, count: usize) -> ([u32; N], [[f32; N]; 4]) {
    let (size, last) = (f64::from(size), count.saturating_sub(4) as u32);
    let (mut first, mut weights) = ([0; N], [[0.0; N]; 4]);
    for k in 0..N {
        let place = at[k].max(-1.0).min(size);
        let whole = floor(place);
        let four = catmull_rom((place - whole) as f32);
        for w in 0..4 {
            weights[w][k] = four[w];
        }
        // The kernel's first pixel is one before the floor; with the border that is one after it.
        let column = whole + (BORDER as f64 - 1.0) + WHOLE;
        first[k] = (column.to_bits() as u32).min(last);
    }
    (first, weights)
}

/// A batch of pixels of an image whose colours are then sampled together.
pub(super) struct Pixels<'a> {
    texture: &'a Texture,
    width: u32,
    /// Indices of the pixels in the image, and positions on the texture.
    to: Vec<usize>,
    x: Vec<f64>,
    y: Vec<f64>,
    count: usize,
    colours: Vec<[f32; 4]>,
    bytes: Vec<[u8; 4]>,
}

impl<'a> Pixels<'a> {
    /// Largest number of pixels in a batch.
    const MOST: usize = 512;

    /// Creates an empty batch for an image of this width, with colours from a texture.
    pub fn new(texture: &'a Texture, width: u32) -> Self {
        let most = Self::MOST;
        let (x, y) = (vec![0.0; most], vec![0.0; most]);
        Self { texture, width, to: vec![0; most], x, y, count: 0, colours: vec![[0.0; 4]; most], bytes: vec![[0; 4]; most] }
    }

    /// Adds the pixels of one row of a triangle. When the batch is full, it calls `draw`, which must draw and empty it.
    pub fn add(&mut self, span: Span, mut draw: impl FnMut(&mut Self)) {
        let Span { y, from, to, start, step } = span;
        let row = y as usize * self.width as usize;
        let mut x = from;
        while x < to {
            if self.count == Self::MOST {
                draw(self);
            }
            let room = ((to - x) as usize).min(Self::MOST - self.count);
            let places = self.count..self.count + room;
            let (pixels, xs, ys) = (&mut self.to[places.clone()], &mut self.x[places.clone()], &mut self.y[places]);
            let first = f64::from(x - from);
            for k in 0..room {
                let off = first + f64::from(k as i32);
                pixels[k] = row + x as usize + k;
                xs[k] = start.x + step.x * off;
                ys[k] = start.y + step.y * off;
            }
            self.count += room;
            x += room as u32;
        }
    }

    /// Draws the pixels in the order of adding. `change` gets the index of a box, and the position and colour of each pixel within it.
    pub fn draw(&mut self, image: &mut RgbImage, boxes: &[Bounds], change: impl Fn(usize, Point2<f64>, [f32; 3]) -> [f32; 3]) {
        let count = std::mem::take(&mut self.count);
        let (x, y) = (&self.x[..count], &self.y[..count]);
        let (colours, bytes) = (&mut self.colours[..count], &mut self.bytes[..count]);
        self.texture.sample_all((x, y), colours);
        // Pixels of one batch are near each other, so most boxes hold none of them.
        let around = (span(x), span(y));
        let near: Vec<(usize, &Bounds)> = boxes.iter().enumerate().filter(|(_, b)| b.meets(around)).collect();
        if !near.is_empty() {
            for ((x, y), colour) in x.iter().zip(y).zip(&mut *colours) {
                let at = Point2::new(*x, *y);
                for &(number, _) in near.iter().filter(|(_, b)| b.holds(&at)) {
                    let [red, green, blue, _] = *colour;
                    colour[..3].copy_from_slice(&change(number, at, [red, green, blue]));
                }
            }
        }
        widest(
            #[inline(always)]
            || {
                for (to, from) in bytes.as_flattened_mut().iter_mut().zip(colours.as_flattened()) {
                    *to = byte(*from);
                }
            },
        );
        let pixels = image.as_flat_samples_mut().samples.as_chunks_mut::<3>().0;
        for (to, [red, green, blue, _]) in self.to.iter().zip(bytes) {
            pixels[*to] = [*red, *green, *blue];
        }
    }
}

/// A box of positions on a texture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds([Point2<f64>; 2]);

impl Bounds {
    /// The box around points, with a margin of one pixel for rounding; `None` for no points.
    pub fn around(points: impl IntoIterator<Item = Point2<f64>>) -> Option<Self> {
        let mut points = points.into_iter();
        let first = points.next()?;
        let (low, high) = points.fold((first, first), |(low, high), p| (low.inf(&p), high.sup(&p)));
        let margin = Vector2::repeat(1.0);
        Some(Self([low - margin, high + margin]))
    }

    #[inline(always)]
    fn holds(&self, p: &Point2<f64>) -> bool {
        let [low, high] = &self.0;
        p.x >= low.x && p.x <= high.x && p.y >= low.y && p.y <= high.y
    }

    /// Whether the box may hold positions within these ranges of x and y.
    fn meets(&self, (x, y): ((f64, f64), (f64, f64))) -> bool {
        let [low, high] = &self.0;
        low.x <= x.1 && high.x >= x.0 && low.y <= y.1 && high.y >= y.0
    }
}

/// Smallest and largest of some numbers.
fn span(values: &[f64]) -> (f64, f64) {
    let wider = |(low, high): (f64, f64), &v: &f64| (if v < low { v } else { low }, if v > high { v } else { high });
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), wider)
}

/// Adding this constant rounds a number to an integer; for a non-negative one, the low bits of the sum are the integer. Unlike conversions to
/// integers, this vectorizes.
pub(super) const WHOLE: f64 = 6_755_399_441_055_744.0;
const WHOLE_F32: f32 = 8_388_608.0;

/// Floor of a value that fits into 32 bits; on older processors `f64::floor` is a function call.
#[inline(always)]
fn floor(value: f64) -> f64 {
    let near = (value + WHOLE) - WHOLE;
    if near > value { near - 1.0 } else { near }
}

/// Catmull-Rom weights of the four pixels around a position at `t` (0 to 1) after the second one.
#[inline(always)]
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (-t3 + 2.0 * t2 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (-3.0 * t3 + 4.0 * t2 + t), 0.5 * (t3 - t2)]
}

/// Blends a colour over a pixel with opacity `share` (0 to 1).
pub fn lay(pixel: &mut image::Rgb<u8>, colour: [f32; 3], share: f32) {
    for (level, over) in pixel.0.iter_mut().zip(colour) {
        let under = f32::from(*level);
        *level = byte(under + (over - under) * share);
    }
}

/// Rounds a channel to a byte.
#[inline(always)]
pub fn byte(value: f32) -> u8 {
    // Floor of half a level more equals rounding for non-negative values. Rounding is a function call on older processors, and a
    // conversion does not vectorize.
    let level = (value + 0.5).clamp(0.0, 255.0);
    let near = (level + WHOLE_F32) - WHOLE_F32;
    let whole = if near > level { near - 1.0 } else { near };
    (whole + WHOLE_F32).to_bits() as u8
}

/// Renders an image of a given size through a dense map. `source` returns the position on the texture for each pixel of the result; `None` leaves
/// it black. A map known in closed form gives exact ground truth.
pub fn resample(texture: &Texture, size: (u32, u32), source: impl Fn(Point2<f64>) -> Option<Point2<f64>>) -> RgbImage {
    let mut image = RgbImage::new(size.0, size.1);
    let mut pixels = Pixels::new(texture, size.0);
    let same = |_, _, colour| colour;
    for y in 0..size.1 {
        for x in 0..size.0 {
            if let Some(start) = source(Point2::new(f64::from(x), f64::from(y))) {
                let one = Span { y, from: x, to: x + 1, start, step: Vector2::zeros() };
                pixels.add(one, |pixels| pixels.draw(&mut image, &[], same));
            }
        }
    }
    pixels.draw(&mut image, &[], same);
    image
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
    fn a_texture_times_factors_is_that_of_the_image_times_them() {
        let mut image = RgbImage::from_fn(9, 7, |x, y| image::Rgb([25 * x as u8, 30 * y as u8, 90]));
        let factors = [100.0, 128.0, 150.0].map(|one| -> [f32; 256] { std::array::from_fn(|k| k as f32 / one) });
        // One line in the middle, and one to the corner.
        let lines = [(3, 2, vec![64, 128, 200]), (6, 5, vec![10, 128, 90, 255])];
        let found = Texture::new(&image).times(lines.iter().map(|(y, x, n)| (*y, *x, &n[..])), &factors);
        for (y, x, numbers) in &lines {
            for (k, number) in numbers.iter().enumerate() {
                let pixel = image.get_pixel_mut((x + k) as u32, *y as u32);
                let times = |c: usize| byte(f32::from(pixel.0[c]) * factors[c][usize::from(*number)]);
                pixel.0 = std::array::from_fn(times);
            }
        }
        let colours = |texture: &Texture| texture.pixels.iter().map(|p| [p[0], p[1], p[2]]).collect::<Vec<_>>();
        assert_eq!(colours(&found), colours(&Texture::new(&image)));
    }

    #[test]
    fn many_places_are_sampled_as_one_is() {
        let image = RgbImage::from_fn(30, 20, |x, y| image::Rgb([(x * 41 + y * 97) as u8, (x * y) as u8, 7 * x as u8]));
        let texture = Texture::new(&image);
        let x: Vec<f64> = (0..203).map(|k| f64::from(k) * 0.171 - 2.3).collect();
        let y: Vec<f64> = (0..203).map(|k| f64::from(k * k % 203) * 0.121 - 2.1).collect();
        let mut colours = vec![[0.0; 4]; 203];
        texture.sample_all((&x, &y), &mut colours);
        for ((x, y), colour) in x.iter().zip(&y).zip(&colours) {
            assert_eq!(texture.sample(Point2::new(*x, *y)), colour[..3], "{x} {y}");
        }
    }

    #[test]
    fn the_largest_whole_number_not_above() {
        for value in [-1.0, -0.999, -1e-17, -0.0, 0.0, 1e-17, 0.499_999, 0.5, 0.999_999, 1.0, 1.5, 2.5, 65_535.0, 65_534.999_9] {
            assert_eq!(floor(value), value.floor(), "{value}");
        }
    }

    #[test]
    fn a_byte_is_the_nearest_level() {
        for k in -400..1400_i16 {
            for value in [f32::from(k) * 0.25, (f32::from(k) * 0.25).next_down(), (f32::from(k) * 0.25).next_up()] {
                assert_eq!(byte(value), (value + 0.5).clamp(0.0, 255.0) as u8, "{value}");
            }
        }
        assert_eq!((byte(f32::NAN), byte(f32::INFINITY), byte(f32::NEG_INFINITY)), (0, 255, 0));
    }

    #[test]
    fn an_image_of_one_pixel_can_be_sampled() {
        let texture = Texture::new(&RgbImage::from_pixel(1, 1, image::Rgb([9, 8, 7])));
        assert_eq!(texture.sample(Point2::new(0.3, -2.0)).map(byte), [9, 8, 7]);
    }
}
