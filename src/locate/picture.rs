//! A grey picture at full, half, quarter ... size, which can be sampled at any position and scale.

use image::GrayImage;

use super::{
    points,
    shape::{Placement, Point, Shape},
};

/// Levels are halved until a side is shorter than this.
const SMALLEST_SIDE: usize = 24;

/// Number of positions that are read at once.
const LANES: usize = 8;

/// Added to an integer below 2^23, the low bits of the sum are that integer.
const ROUND: f32 = 8_388_608.0;

/// Interpolates between the corners of a pixel's square, the upper ones first; `right`, `down`: fractions of the way.
#[inline(always)]
fn between(corners: [f32; 4], [right, down]: [f32; 2]) -> f32 {
    let upper = corners[0] * (1.0 - right) + corners[1] * right;
    let lower = corners[2] * (1.0 - right) + corners[3] * right;
    upper * (1.0 - down) + lower * down
}

#[derive(Clone, Debug)]
struct Level {
    width: usize,
    height: usize,
    pixels: Vec<f32>,
}

impl Level {
    fn half(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut pixels = Vec::with_capacity(width * height);
        for y in 0..height {
            let upper = &self.pixels[2 * y * self.width..][..self.width];
            let lower = &self.pixels[(2 * y + 1) * self.width..][..self.width];
            let pairs = upper.chunks_exact(2).zip(lower.chunks_exact(2));
            pixels.extend(pairs.map(|(u, l)| 0.25 * (u[0] + u[1] + l[0] + l[1])));
        }
        Self { width, height, pixels }
    }

    #[inline(always)]
    fn sample(&self, x: f32, y: f32) -> f32 {
        let (x, y) = (x.clamp(0.0, (self.width - 1) as f32), y.clamp(0.0, (self.height - 1) as f32));
        let (left, top) = ((x as usize).min(self.width.saturating_sub(2)), (y as usize).min(self.height.saturating_sub(2)));
        let (fx, fy) = (x - left as f32, y - top as f32);
        let (right, bottom) = ((left + 1).min(self.width - 1), (top + 1).min(self.height - 1));
        let pixel = |row: usize, column: usize| self.pixels[row * self.width + column];
        between([pixel(top, left), pixel(top, right), pixel(bottom, left), pixel(bottom, right)], [fx, fy])
    }

    /// Appends [`Level::sample`] at `count` positions from `start` on, `step` apart; several at a time, with the same sums in the same
    /// order.
    #[inline(always)]
    fn sample_row(&self, start: Point, step: Point, count: usize, out: &mut Vec<f32>) {
        // Via 32-bit integers, so that the conversion vectorizes.
        let place = |column: usize, axis: usize| start[axis] + step[axis] * column as i32 as f32;
        let whole = if self.width < 2 || self.height < 2 { 0 } else { count - count % LANES };
        let last = [(self.width - 1) as f32, (self.height - 1) as f32];
        for base in (0..whole).step_by(LANES) {
            let (mut at, mut shares) = ([[0_u32; LANES]; 2], [[0.0_f32; LANES]; 2]);
            for axis in 0..2 {
                for k in 0..LANES {
                    let value = place(base + k, axis).clamp(0.0, last[axis]);
                    let pixel = value.floor().min(last[axis] - 1.0);
                    at[axis][k] = (pixel + ROUND).to_bits() & 0x7F_FFFF;
                    shares[axis][k] = value - pixel;
                }
            }
            let mut corners = [[0.0_f32; LANES]; 4];
            for k in 0..LANES {
                let upper = at[1][k] as usize * self.width + at[0][k] as usize;
                let Some(square) = self.pixels.get(upper..).and_then(|rest| rest.get(..self.width + 2)) else { continue };
                let (Some(u), Some(l)) = (square.first_chunk::<2>(), square.last_chunk::<2>()) else { continue };
                (corners[0][k], corners[1][k], corners[2][k], corners[3][k]) = (u[0], u[1], l[0], l[1]);
            }
            let mut values = [0.0_f32; LANES];
            for k in 0..LANES {
                // [`between`] written out, because the call would not vectorize.
                let (right, down) = (shares[0][k], shares[1][k]);
                let upper = corners[0][k] * (1.0 - right) + corners[1][k] * right;
                let lower = corners[2][k] * (1.0 - right) + corners[3][k] * right;
                values[k] = upper * (1.0 - down) + lower * down;
            }
            out.extend_from_slice(&values);
        }
        out.extend((whole..count).map(|column| self.sample(place(column, 0), place(column, 1))));
    }
}

/// A picture with its halved levels.
#[derive(Clone, Debug)]
pub struct Picture {
    levels: Vec<Level>,
}

impl Picture {
    /// Returns `None` for a picture without pixels.
    pub fn new(image: &GrayImage) -> Option<Self> {
        let (width, height) = (image.width() as usize, image.height() as usize);
        if width == 0 || height == 0 {
            return None;
        }
        let first = Level { width, height, pixels: image.as_raw().iter().map(|&v| f32::from(v)).collect() };
        let mut levels = vec![first];
        while let Some(last) = levels.last().filter(|l| l.width.min(l.height) >= 2 * SMALLEST_SIDE) {
            levels.push(last.half());
        }
        Some(Self { levels })
    }

    /// Returns the number of columns.
    pub fn width(&self) -> usize {
        self.levels[0].width
    }

    /// Returns the number of rows.
    pub fn height(&self) -> usize {
        self.levels[0].height
    }

    /// Returns a view of the picture, mirrored or not.
    pub fn view(&self, mirrored: bool) -> View<'_> {
        View { picture: self, mirrored }
    }
}

/// A picture, mirrored or not: mirrored, column x becomes column width - 1 - x.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    picture: &'a Picture,
    mirrored: bool,
}

impl View<'_> {
    /// Converts a point of the picture to this view, and back.
    pub fn turn(self, p: Point) -> Point {
        if self.mirrored { [(self.picture.width() - 1) as f32 - p[0], p[1]] } else { p }
    }

    /// Converts the points of a face of the picture to this view, and back: mirroring exchanges left and right points.
    pub fn turn_shape(self, shape: &[Point]) -> Shape {
        if self.mirrored { points().iter().map(|p| self.turn(shape[p.mirror])).collect() } else { shape.to_vec() }
    }

    /// Returns the grey value at a position, smoothed for a picture in which one pixel covers `scale` pixels of this one.
    pub fn sample(self, at: Point, scale: f32) -> f32 {
        let halvings = scale.max(f32::MIN_POSITIVE).log2().round().max(0.0) as usize;
        let k = halvings.min(self.picture.levels.len() - 1);
        let (size, [x, y]) = ((1_usize << k) as f32, self.turn(at));
        self.picture.levels[k].sample((x + 0.5) / size - 0.5, (y + 0.5) / size - 0.5)
    }

    /// Returns `width` x `height` grey values (0 to 255), row by row. `to_view` maps columns and rows of the grid to pixels of this view.
    /// Beyond its border the picture continues with its border pixels.
    #[inline(always)]
    pub fn warp(self, to_view: Placement, width: usize, height: usize) -> Vec<f32> {
        let halvings = to_view.scale().max(f32::MIN_POSITIVE).log2().round().max(0.0) as usize;
        let k = halvings.min(self.picture.levels.len() - 1);
        let level = &self.picture.levels[k];
        let size = (1_usize << k) as f32;
        // The centre of a pixel of a halved level lies between the centres of its two pixels.
        let to_level = |value: f32| (value + 0.5) / size - 0.5;
        let (start, step) = if self.mirrored {
            ((self.picture.width() - 1) as f32 - to_view.x, [-to_view.a, to_view.b])
        } else {
            (to_view.x, [to_view.a, -to_view.b])
        };
        let mut values = Vec::with_capacity(width * height);
        for row in 0..height {
            let (x0, y0) = (start + step[1] * row as f32, to_view.y + to_view.a * row as f32);
            let (x0, y0) = (to_level(x0), to_level(y0));
            level.sample_row([x0, y0], [step[0] / size, to_view.b / size], width, &mut values);
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Picture {
        Picture::new(&GrayImage::from_fn(64, 64, |x, y| image::Luma([(x + 2 * y) as u8]))).unwrap()
    }

    #[test]
    fn a_ramp_is_read_at_any_size_and_in_the_mirror() {
        // Grey is x + 2 y: at (10 + 2 c, 20 + 2 r) it is 50 + 2 c + 4 r; in the mirror x is 63 - x.
        for mirrored in [false, true] {
            let middle = ramp().view(mirrored).turn([10.0, 20.0]);
            let placement = Placement { a: 2.0, b: 0.0, x: middle[0], y: middle[1] };
            let values = ramp().view(mirrored).warp(placement, 3, 2);
            let sign = if mirrored { -1.0 } else { 1.0 };
            for (k, value) in values.iter().enumerate() {
                let (c, r) = ((k % 3) as f32, (k / 3) as f32);
                approx::assert_relative_eq!(*value, 50.0 + sign * 2.0 * c + 4.0 * r, epsilon = 1e-3);
            }
        }
    }

    #[test]
    fn a_row_is_what_its_places_are() {
        let noise = GrayImage::from_fn(37, 29, |x, y| image::Luma([(x * 73 + y * 151 + x * y * 7) as u8]));
        for picture in [Picture::new(&noise), Picture::new(&GrayImage::from_pixel(1, 9, image::Luma([7])))] {
            let level = &picture.unwrap().levels[0];
            // Inside, across every border, along one, and outside.
            for (start, step) in
                [([3.3, 4.4], [0.71, 0.39]), ([-9.0, 40.0], [2.3, -1.7]), ([36.0, 28.0], [0.0, 0.0]), ([f32::NAN; 2], [1.0; 2])]
            {
                let mut row = Vec::new();
                level.sample_row(start, step, 29, &mut row);
                let at = |c: usize| [0, 1].map(|axis: usize| start[axis] + step[axis] * c as f32);
                let single: Vec<f32> = (0..29).map(|c| level.sample(at(c)[0], at(c)[1])).collect();
                assert!(
                    row.iter().zip(&single).all(|(a, b)| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())),
                    "{start:?}"
                );
                assert_eq!(row.len(), 29);
            }
        }
    }

    #[test]
    fn pictures_of_any_size_do_not_panic() {
        assert!(Picture::new(&GrayImage::new(0, 5)).is_none());
        let one = Picture::new(&GrayImage::from_pixel(1, 1, image::Luma([7]))).unwrap();
        let placement = Placement { a: 9.0, b: 3.0, x: -20.0, y: 4.0 };
        assert!(one.view(false).warp(placement, 4, 4).iter().all(|&v| (v - 7.0).abs() < 1e-6));
    }
}
