//! The search for one window of a frame in another.

use nalgebra::Point2;

use super::{
    super::{Found, Probe},
    lanes::{LANES, Values, dot, lanes, lanes_mut, total},
    pyramid::Level,
    scharr::Scharr,
};

/// Largest number of iterations, and step (px) below which the search at one pyramid level ends.
const MAX_ITERATIONS: u32 = 30;
const STEP_PX: f32 = 0.01;

/// Two steps that cancel each other to within this distance, px, end the search half way between them.
const SWING_PX: f32 = 0.01;

/// Smallest normalized eigenvalue of a window's gradient matrix.
const MIN_EIGENVALUE: f32 = 1e-4;

/// Bits of the interpolation weights, and fractional bits of grey values.
const WEIGHT_BITS: u32 = 14;
const GREY_BITS: u32 = 5;

/// Keeps sums of products of derivatives small; cancels out.
const SCALE: f32 = 1.0 / (1 << 20) as f32;

/// Adding and subtracting it rounds a number below 2^22 to the nearest integer, ties to even.
const ROUND: f32 = 12_582_912.0;

/// Values on a window, and buffers to compute them. Rows have one value more than the window, for the interpolation between pixels;
/// derivatives are zero there and after the last row, so that the padding has no effect.
#[derive(Debug, Default)]
pub struct Window {
    side: usize,
    /// Grey values of the first frame.
    grey: Values,
    dx: Values,
    dy: Values,
    /// 1 in the window, 0 beyond it.
    inside: Values,
    /// Pixels of the second frame, and the upper left position they were read at.
    pixels: Values,
    read_at: Option<(i32, i32)>,
    scharr: Scharr,
}

/// The pixel at or before a position, and the weights of it and its three neighbours to the right and below.
struct Corner {
    x: i32,
    y: i32,
    weights: [i32; 4],
}

impl Corner {
    /// Returns `None` for a window that lies entirely outside the image.
    #[inline(always)]
    fn at(x: f32, y: f32, side: usize, level: &Level) -> Option<Self> {
        let (left, top) = (x.floor(), y.floor());
        let side = side as f32;
        if !(left >= -side && left < level.width as f32 && top >= -side && top < level.height as f32) {
            return None;
        }
        let (a, b) = (x - left, y - top);
        let one = (1 << WEIGHT_BITS) as f32;
        let weight = |share: f32| (share * one).round_ties_even() as i32;
        let (w00, w01, w10) = (weight((1.0 - a) * (1.0 - b)), weight(a * (1.0 - b)), weight((1.0 - a) * b));
        Some(Self { x: left as i32, y: top as i32, weights: [w00, w01, w10, (1 << WEIGHT_BITS) - w00 - w01 - w10] })
    }

    /// Returns interpolated grey values, times 32 and rounded (halves up), [`LANES`] at a time. `pixels`: values in rows of `row` pixels.
    ///
    /// All intermediate values are integers below 2^24, so single precision is exact.
    #[inline(always)]
    fn between<'a>(&self, pixels: &'a [f32], row: usize) -> impl Iterator<Item = [f32; LANES]> + use<'a> {
        let [w00, w01, w10, w11] = self.weights.map(|w| w as f32);
        let above = lanes(pixels).iter().zip(lanes(&pixels[1..]));
        let below = lanes(&pixels[row..]).iter().zip(lanes(&pixels[row + 1..]));
        above.zip(below).map(
            #[inline(always)]
            move |((a, b), (c, d))| {
                let mut out = [0.0; LANES];
                for k in 0..LANES {
                    let sum = a[k] * w00 + b[k] * w01 + c[k] * w10 + d[k] * w11;
                    // Above 2^23 single precision has no fractional bits: adding and subtracting it rounds.
                    out[k] = (sum * (1.0 / 512.0) + (0.5 - 511.0 / 1024.0) + 8_388_608.0) - 8_388_608.0;
                }
                out
            },
        )
    }
}

/// Interpolates between two rows with `weights` (upper two, lower two), each value with its right neighbour, and rounds.
#[inline(always)]
fn mix_rows(upper: &[f32], lower: &[f32], weights: [f32; 4], out: &mut [f32]) {
    let [w00, w01, w10, w11] = weights;
    // The last whole block overlaps the previous one, so that no remainder is left.
    let blocks = if out.len() < LANES { 0 } else { out.len().div_ceil(LANES) };
    for block in 0..blocks {
        let begin = (block * LANES).min(out.len() - LANES);
        let (upper, lower) = (&upper[begin..=begin + LANES], &lower[begin..=begin + LANES]);
        let out = &mut out[begin..begin + LANES];
        for k in 0..LANES {
            let sum = upper[k] * w00 + upper[k + 1] * w01 + lower[k] * w10 + lower[k + 1] * w11;
            out[k] = (sum + ROUND) - ROUND;
        }
    }
    if blocks == 0 {
        for (k, out) in out.iter_mut().enumerate() {
            let sum = upper[k] * w00 + upper[k + 1] * w01 + lower[k] * w10 + lower[k + 1] * w11;
            *out = (sum + ROUND) - ROUND;
        }
    }
}

impl Window {
    pub fn resize(&mut self, side: usize) {
        if side == self.side {
            return;
        }
        self.side = side;
        let area = (side * (side + 1)).next_multiple_of(LANES);
        for list in [&mut self.grey, &mut self.dx, &mut self.dy, &mut self.inside] {
            list.clear();
            list.resize(area, 0.0);
        }
        for row in self.inside.chunks_exact_mut(side + 1).take(side) {
            row[..side].fill(1.0);
        }
    }

    /// Takes grey values and derivatives of the first frame at a position.
    #[inline(always)]
    fn fill(&mut self, level: &Level, corner: &Corner) {
        let Self { side, grey, dx, dy, pixels, read_at, scharr, .. } = self;
        let row = *side + 1;
        *read_at = None;
        level.read(corner.x, corner.y, row, grey.len() + row + 1, pixels);
        lanes_mut(grey).iter_mut().zip(corner.between(pixels, row)).for_each(|(out, grey)| *out = grey);
        // One more value per row and one more row, for the interpolation; two more pixels around these, for the derivatives.
        scharr.fill(level, (corner.x, corner.y), row);
        let [w00, w01, w10, w11] = corner.weights.map(|w| w as f32 / (1 << WEIGHT_BITS) as f32);
        let wide = row + 2;
        for (raw, out) in [(&scharr.dx, dx), (&scharr.dy, dy)] {
            let rows = raw.chunks_exact(wide).zip(raw[wide..].chunks_exact(wide));
            for (out, (upper, lower)) in out.chunks_exact_mut(row).zip(rows).take(*side) {
                mix_rows(upper, lower, [w00, w01, w10, w11], &mut out[..*side]);
            }
        }
    }

    /// Reads the second frame's pixels at a position unless they are already there: most steps of a search are shorter than a pixel.
    /// [`Window::fill`] resets them for another level.
    #[inline(always)]
    fn read(&mut self, level: &Level, corner: &Corner) {
        let at = Some((corner.x, corner.y));
        if self.read_at != at {
            let row = self.side + 1;
            level.read(corner.x, corner.y, row, self.grey.len() + row + 1, &mut self.pixels);
            self.read_at = at;
        }
    }

    /// Returns sums of products of each derivative with the grey difference between the second frame at a position and the first frame.
    #[inline(always)]
    fn mismatch(&mut self, level: &Level, corner: &Corner) -> (f32, f32) {
        self.read(level, corner);
        let Self { side, grey, dx, dy, pixels, .. } = self;
        let row = *side + 1;
        let (mut along_x, mut along_y) = ([0.0_f32; LANES], [0.0_f32; LANES]);
        let first = lanes(grey).iter().zip(lanes(dx).iter().zip(lanes(dy)));
        for ((grey, (dx, dy)), now) in first.zip(corner.between(pixels, row)) {
            for k in 0..LANES {
                let difference = now[k] - grey[k];
                along_x[k] += dx[k] * difference;
                along_y[k] += dy[k] * difference;
            }
        }
        (total(along_x), total(along_y))
    }

    /// Returns the mean absolute grey difference between the second frame at a position and the first frame, grey levels.
    #[inline(always)]
    fn difference(&mut self, level: &Level, corner: &Corner) -> f64 {
        self.read(level, corner);
        let Self { side, grey, inside, pixels, .. } = self;
        let row = *side + 1;
        let mut sum = 0.0;
        for ((grey, inside), now) in lanes(grey).iter().zip(lanes(inside)).zip(corner.between(pixels, row)) {
            let mut sums = [0.0_f32; LANES];
            for k in 0..LANES {
                sums[k] = (now[k] - grey[k]).abs() * inside[k];
            }
            sum += f64::from(total(sums));
        }
        sum / f64::from(1 << GREY_BITS) / (*side * *side) as f64
    }

    /// Finds one point again, from the smallest level to the frame itself.
    #[inline(always)]
    pub fn follow(&mut self, from: &[Level], to: &[Level], probe: &Probe) -> Found {
        let half = (self.side - 1) as f32 * 0.5;
        let single = |p: &Point2<f64>| (p.x as f32, p.y as f32);
        let (start, mut next) = (single(&probe.position), single(&probe.guess));
        if ![start.0, start.1, next.0, next.1].into_iter().all(f32::is_finite) {
            return Found::Lost;
        }
        let scale = |level: usize| 1.0 / (1_u32 << level) as f32;
        let top = scale(from.len().saturating_sub(1));
        next = (next.0 * top, next.1 * top);
        for (k, (first, second)) in from.iter().zip(to).enumerate().rev() {
            if k + 1 < from.len() {
                next = (next.0 * 2.0, next.1 * 2.0);
            }
            let (x, y) = (start.0 * scale(k) - half, start.1 * scale(k) - half);
            // A failure at a coarser level may be corrected at the next one.
            if !self.search(first, second, (x, y), &mut next) && k == 0 {
                return Found::Lost;
            }
        }
        let Some(corner) = to.first().and_then(|level| Corner::at(next.0 - half, next.1 - half, self.side, level)) else {
            return Found::Lost;
        };
        let difference = self.difference(&to[0], &corner);
        Found::At { position: Point2::new(f64::from(next.0), f64::from(next.1)), difference }
    }

    /// Searches at one level, starting at `next` and updating it. Returns `false` when the window has no texture or leaves the image.
    #[inline(always)]
    fn search(&mut self, first: &Level, second: &Level, (x, y): (f32, f32), next: &mut (f32, f32)) -> bool {
        let side = self.side;
        let half = (side - 1) as f32 * 0.5;
        let Some(corner) = Corner::at(x, y, side, first) else { return false };
        self.fill(first, &corner);
        let (dx, dy) = (&self.dx, &self.dy);
        let (xx, xy, yy) = (dot(dx, dx) * SCALE, dot(dx, dy) * SCALE, dot(dy, dy) * SCALE);
        let determinant = xx * yy - xy * xy;
        let spread = ((xx - yy) * (xx - yy) + 4.0 * xy * xy).sqrt();
        let eigenvalue = (yy + xx - spread) / (2 * side * side) as f32;
        if eigenvalue < MIN_EIGENVALUE || determinant < f32::EPSILON {
            return false;
        }
        let inverse = 1.0 / determinant;
        let (mut x, mut y) = (next.0 - half, next.1 - half);
        let mut last = (0.0, 0.0);
        for iteration in 0..MAX_ITERATIONS {
            let Some(corner) = Corner::at(x, y, side, second) else { return false };
            let (b1, b2) = self.mismatch(second, &corner);
            let (b1, b2) = (b1 * SCALE, b2 * SCALE);
            let step = ((xy * b2 - yy * b1) * inverse, (xy * b1 - xx * b2) * inverse);
            (x, y) = (x + step.0, y + step.1);
            *next = (x + half, y + half);
            if step.0 * step.0 + step.1 * step.1 <= STEP_PX * STEP_PX {
                break;
            }
            if iteration > 0 && (step.0 + last.0).abs() < SWING_PX && (step.1 + last.1).abs() < SWING_PX {
                *next = (next.0 - step.0 * 0.5, next.1 - step.1 * 0.5);
                break;
            }
            last = step;
        }
        true
    }
}
