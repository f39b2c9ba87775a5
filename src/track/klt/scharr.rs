//! Scharr derivatives of a part of an image.

use nalgebra::{Matrix2, Point2};

use super::{
    lanes::{LANES, Values, lanes, lanes_mut},
    pyramid::Level,
};

/// Grey levels per px for one unit of the Scharr derivatives.
const SCHARR: f64 = 1.0 / 32.0;

/// Buffers for derivatives: pixel rows, smoothed sums and differences over three rows, and the derivatives.
#[derive(Debug, Default)]
pub struct Scharr {
    pixels: Values,
    smooth: Values,
    slope: Values,
    /// Derivatives along x, as [`Scharr::fill`] leaves them.
    pub dx: Values,
    /// Derivatives along y.
    pub dy: Values,
}

impl Scharr {
    /// Computes Scharr derivatives (32 per grey level per px) at `side` x `side` pixels from (`x`, `y`), in rows of `side` + 2 values; zero
    /// outside the image.
    #[inline(always)]
    pub fn fill(&mut self, image: &Level, (x, y): (i32, i32), side: usize) {
        let Self { pixels, smooth, slope, dx, dy } = self;
        let row = side + 2;
        // As many values as are read of each list, in whole lanes.
        let derived = (side * row).next_multiple_of(LANES);
        let summed = (derived + 2).next_multiple_of(LANES);
        image.read(x - 1, y - 1, row, summed + 2 * row, pixels);
        for list in [&mut *smooth, &mut *slope] {
            list.resize(summed, 0.0);
        }
        for list in [&mut *dx, &mut *dy] {
            list.resize(derived, 0.0);
        }
        let near = lanes(pixels).iter().zip(lanes(&pixels[row..])).zip(lanes(&pixels[2 * row..]));
        for ((smooth, slope), ((a, b), c)) in lanes_mut(smooth).iter_mut().zip(lanes_mut(slope)).zip(near) {
            for k in 0..LANES {
                smooth[k] = (a[k] + c[k]) * 3.0 + b[k] * 10.0;
                slope[k] = c[k] - a[k];
            }
        }
        for (out, (a, c)) in lanes_mut(dx).iter_mut().zip(lanes(smooth).iter().zip(lanes(&smooth[2..]))) {
            for k in 0..LANES {
                out[k] = c[k] - a[k];
            }
        }
        let near = lanes(slope).iter().zip(lanes(&slope[1..])).zip(lanes(&slope[2..]));
        for (out, ((a, b), c)) in lanes_mut(dy).iter_mut().zip(near) {
            for k in 0..LANES {
                out[k] = (a[k] + c[k]) * 3.0 + b[k] * 10.0;
            }
        }
        let last = side as i32 - 1;
        if x < 0 || y < 0 || x + last >= image.width || y + last >= image.height {
            self.leave_out(image, (x, y), row);
        }
    }

    /// Sets derivatives outside the image to zero.
    #[cold]
    fn leave_out(&mut self, image: &Level, (x, y): (i32, i32), row: usize) {
        let rows = self.dx.chunks_mut(row).zip(self.dy.chunks_mut(row));
        for (y, (dx, dy)) in (y..).zip(rows) {
            for (x, (dx, dy)) in (x..).zip(dx.iter_mut().zip(dy)) {
                if !(0..image.width).contains(&x) || !(0..image.height).contains(&y) {
                    (*dx, *dy) = (0.0, 0.0);
                }
            }
        }
    }

    /// Returns mean products of derivatives, squared grey levels per px, in the window of 2 `half` + 1 px around a point.
    #[inline(always)]
    pub fn mean_products(&mut self, image: &Level, point: &Point2<f64>, half: i32) -> Matrix2<f64> {
        let side = 2 * half as usize + 1;
        let centre = |at: f64, size: i32| at.round().clamp(-1.0 - f64::from(half), f64::from(size + half)) as i32;
        let (x, y) = (centre(point.x, image.width), centre(point.y, image.height));
        // Outside the image derivatives are zero and do not count.
        self.fill(image, (x - half, y - half), side);
        let inside = |at: i32, size: i32| f64::from(((at + half + 1).min(size) - (at - half).max(0)).max(0));
        let count = inside(x, image.width) * inside(y, image.height);
        let sums = self.products(side).map(|sum| sum * (SCHARR * SCHARR));
        Matrix2::new(sums[0], sums[1], sums[1], sums[2]) / count.max(1.0)
    }

    /// Returns sums of products of the derivatives: x with x, x with y, y with y. They are integers, so the sums are exact in any order.
    #[inline(always)]
    fn products(&self, side: usize) -> [f64; 3] {
        const HALF: usize = LANES / 2;
        let mut sums = [[0.0; HALF]; 3];
        for (dx, dy) in self.dx.chunks_exact(side + 2).zip(self.dy.chunks_exact(side + 2)).take(side) {
            let ((dx, dx_rest), (dy, dy_rest)) = (dx[..side].as_chunks::<HALF>(), dy[..side].as_chunks::<HALF>());
            for (dx, dy) in dx.iter().zip(dy) {
                let (dx, dy) = (dx.map(f64::from), dy.map(f64::from));
                for k in 0..HALF {
                    sums[0][k] += dx[k] * dx[k];
                    sums[1][k] += dx[k] * dy[k];
                    sums[2][k] += dy[k] * dy[k];
                }
            }
            for (dx, dy) in dx_rest.iter().zip(dy_rest) {
                let (dx, dy) = (f64::from(*dx), f64::from(*dy));
                sums[0][0] += dx * dx;
                sums[1][0] += dx * dy;
                sums[2][0] += dy * dy;
            }
        }
        sums.map(|lanes| lanes.iter().sum())
    }
}
