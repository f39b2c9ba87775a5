//! Pyramidal KLT [Bouguet]. The pyramid of a frame is built once and used as next, then as previous image, forward and back.
//!
//! The arithmetic is that of OpenCV's `calcOpticalFlowPyrLK`, the field's reference: positions in single precision, 14 bits for the weights
//! of the bilinear interpolation, 5 fractional bits for grey values, 16 bits for Scharr derivatives, and the same rules for stopping and
//! for lost points. Derivatives are computed only within the windows.

mod pyramid;
mod reference;
mod smooth;

use nalgebra::{Matrix2, Point2};
use serde::{Deserialize, Serialize};

use self::pyramid::{Level, Pyramid};
use super::{Found, Patch, PointTracker, Probe, Slot, TrackError};
use crate::{sequence::Frame, simd::widest};

pub use reference::OpenCvKlt;
pub(crate) use smooth::smoothed;

/// Implementation of pyramidal KLT.
///
/// ```
/// use grimace::track::{KltKind, TrackOptions};
///
/// assert_eq!(TrackOptions::default().klt, KltKind::Grimace);
/// assert!(KltKind::Grimace.tracker(4, 31).is_ok());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum KltKind {
    /// The implementation of grimace, [`Klt`].
    #[default]
    Grimace,
    /// OpenCV's implementation, in the program `grimace-opencv`.
    OpenCv,
}

impl KltKind {
    /// Creates a tracker of this kind; see [`Klt::new`].
    ///
    /// # Errors
    /// [`TrackError::Program`] when `grimace-opencv` is needed and does not start.
    pub fn tracker(self, levels: u32, max_window_px: u32) -> Result<Box<dyn PointTracker>, TrackError> {
        Ok(match self {
            Self::Grimace => Box::new(Klt::new(levels, max_window_px)),
            Self::OpenCv => Box::new(OpenCvKlt::new(levels, max_window_px)?),
        })
    }
}

/// Largest number of iterations, and step (px) below which the search at one pyramid level ends.
const MAX_ITERATIONS: u32 = 30;
const STEP_PX: f32 = 0.01;

/// Two steps that cancel each other to within this distance, px, end the search half way between them.
const SWING_PX: f32 = 0.01;

/// Grey levels per px for one unit of the Scharr derivatives.
const SCHARR: f64 = 1.0 / 32.0;

/// Smallest normalized eigenvalue of a window's gradient matrix.
const MIN_EIGENVALUE: f32 = 1e-4;

/// Bits of the interpolation weights, and fractional bits of grey values.
const WEIGHT_BITS: u32 = 14;
const GREY_BITS: u32 = 5;

/// Keeps sums of products of derivatives small; cancels out.
const SCALE: f32 = 1.0 / (1 << 20) as f32;

/// Number of lanes of sums, so that they vectorize and give the same result on every machine. Windows are padded to a multiple of it.
const LANES: usize = 8;

/// Values on a part of an image, row by row without a gap, so that one loop covers all of it. Offset by one, an index gives the right
/// neighbour; offset by one row, the neighbour below.
type Values = Vec<f32>;

/// Adding and subtracting it rounds a number below 2^22 to the nearest integer, ties to even.
const ROUND: f32 = 12_582_912.0;

/// The pyramidal KLT tracker. A single search agrees with OpenCV's to some millionths of a pixel.
///
/// In the example a square's upper left corner moves from (30, 30) to (32, 30) and is found there.
/// ```
/// use grimace::{sequence::Frame, track::{Found, Klt, PointTracker, Probe, Slot}};
/// use nalgebra::Point2;
///
/// # let square = |left: u32| {
/// #     let is_in = |x: u32, y: u32| (left..left + 20).contains(&x) && (30..50).contains(&y);
/// #     image::GrayImage::from_fn(80, 80, |x, y| image::Luma([if is_in(x, y) { 200 } else { 50 }]))
/// # };
/// let mut klt = Klt::new(3, 15);
/// klt.advance(&Frame::new(1, square(30)))?;
/// klt.advance(&Frame::new(2, square(32)))?;
/// let corner = Point2::new(30.0, 30.0);
/// let found = klt.find(Slot::Previous, Slot::Current, 15, 3, &[Probe { position: corner, guess: corner }])?;
/// assert!(matches!(found[0], Found::At { position, .. } if (position - Point2::new(32.0, 30.0)).norm() < 0.1));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Klt {
    levels: usize,
    max_window: i32,
    /// Ring of three pyramids: the neutral, the previous and the current frame.
    ring: [Pyramid; 3],
    neutral: usize,
    previous: usize,
    current: Option<usize>,
    window: Window,
}

/// Values on a window, and buffers to compute them. Rows have one value more than the window, for the interpolation between pixels;
/// derivatives are zero there and after the last row, so that the padding has no effect.
#[derive(Debug, Default)]
struct Window {
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

/// Buffers for derivatives: pixel rows, smoothed sums and differences over three rows, and the derivatives.
#[derive(Debug, Default)]
struct Scharr {
    pixels: Values,
    smooth: Values,
    slope: Values,
    dx: Values,
    dy: Values,
}

impl Klt {
    /// Creates a tracker with `levels` pyramid levels (1: the image itself only), for windows up to `max_window_px`.
    #[must_use]
    pub fn new(levels: u32, max_window_px: u32) -> Self {
        Self {
            levels: levels.clamp(1, 8) as usize,
            max_window: max_window_px.clamp(3, 255) as i32,
            ring: std::array::from_fn(|_| Pyramid::default()),
            neutral: 0,
            previous: 0,
            current: None,
            window: Window::default(),
        }
    }

    fn pyramid(&self, slot: Slot) -> &Pyramid {
        &self.ring[match slot {
            Slot::Neutral => self.neutral,
            Slot::Previous => self.previous,
            Slot::Current => self.current.unwrap_or(0),
        }]
    }

    fn image(&self, slot: Slot) -> Result<&Level, TrackError> {
        let reason = || TrackError::PointTracker { reason: "it was given no frame".to_owned() };
        self.pyramid(slot).levels().first().ok_or_else(reason)
    }
}

impl PointTracker for Klt {
    fn advance(&mut self, frame: &Frame) -> Result<(), TrackError> {
        let free = match self.current {
            None => 0,
            Some(current) => {
                self.previous = current;
                (0..3).find(|k| *k != self.neutral && *k != current).unwrap_or(0)
            }
        };
        let image = frame.image();
        self.ring[free].build(image.as_raw(), image.dimensions(), self.levels, self.max_window);
        self.current = Some(free);
        Ok(())
    }

    fn gradients(&self, slot: Slot, window_px: u32, points: &[Point2<f64>]) -> Result<Vec<Matrix2<f64>>, TrackError> {
        let image = self.image(slot)?;
        let half = (window_px / 2).min(self.max_window as u32 / 2) as i32;
        let mut scharr = Scharr::default();
        Ok(widest(
            #[inline(always)]
            || {
                // No `map`: the standard library's code would be compiled for vectors of four.
                let mut matrices = Vec::with_capacity(points.len());
                for point in points {
                    matrices.push(scharr.mean_products(image, point, half));
                }
                matrices
            },
        ))
    }

    fn patch(&self, slot: Slot, points: &[Point2<f64>], margin: f64, smoothing: f64) -> Result<Option<Patch>, TrackError> {
        let image = self.image(slot)?;
        let range = |axis: usize, size: i32| {
            let values = points.iter().map(|p| p[axis]);
            let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            let bound = |v: f64| v.clamp(0.0, f64::from(size)) as i32;
            (bound((low - margin).floor()), bound((high + margin).ceil() + 1.0))
        };
        let ((left, right), (top, bottom)) = (range(0, image.width), range(1, image.height));
        if left >= right || top >= bottom {
            return Ok(None);
        }
        let (width, height) = ((right - left) as usize, (bottom - top) as usize);
        let mut values = vec![0.0; width * height];
        for (y, values) in (top..bottom).zip(values.chunks_exact_mut(width)) {
            values.iter_mut().zip(image.row(left, y, width)).for_each(|(value, pixel)| *value = f32::from(*pixel));
        }
        let values = smoothed(values, width, smoothing);
        Ok(Some(Patch { left: left as u32, top: top as u32, width, height, values }))
    }

    fn find(&mut self, from: Slot, to: Slot, window_px: u32, levels: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError> {
        let mut window = std::mem::take(&mut self.window);
        let side = window_px.clamp(3, self.max_window as u32) as usize;
        window.resize(side);
        let (from, to) = (self.pyramid(from).levels(), self.pyramid(to).levels());
        let count = from.len().min(to.len()).min(levels.max(1) as usize);
        let found = widest(
            #[inline(always)]
            || {
                // No `map`: the standard library's code would be compiled for vectors of four.
                let mut found = Vec::with_capacity(probes.len());
                for probe in probes {
                    found.push(window.follow(&from[..count], &to[..count], probe));
                }
                found
            },
        );
        self.window = window;
        Ok(found)
    }
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

/// Splits a list into chunks of [`LANES`], without the remainder.
#[inline(always)]
fn lanes(list: &[f32]) -> &[[f32; LANES]] {
    list.as_chunks().0
}

#[inline(always)]
fn lanes_mut(list: &mut [f32]) -> &mut [[f32; LANES]] {
    list.as_chunks_mut().0
}

/// The sum of [`LANES`] sums.
#[inline(always)]
fn total([a, b, c, d, e, f, g, h]: [f32; LANES]) -> f32 {
    ((a + e) + (b + f)) + ((c + g) + (d + h))
}

/// The sum of products of two lists.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0_f32; LANES];
    for (a, b) in lanes(a).iter().zip(lanes(b)) {
        for k in 0..LANES {
            sums[k] += a[k] * b[k];
        }
    }
    total(sums)
}

impl Scharr {
    /// Computes Scharr derivatives (32 per grey level per px) at `side` x `side` pixels from (`x`, `y`), in rows of `side` + 2 values; zero
    /// outside the image.
    #[inline(always)]
    fn fill(&mut self, image: &Level, (x, y): (i32, i32), side: usize) {
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
    fn mean_products(&mut self, image: &Level, point: &Point2<f64>, half: i32) -> Matrix2<f64> {
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
    fn resize(&mut self, side: usize) {
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
    fn follow(&mut self, from: &[Level], to: &[Level], probe: &Probe) -> Found {
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

#[cfg(test)]
mod tests {
    use image::{GrayImage, Luma};

    use super::*;

    /// A smooth pattern at a position.
    fn frame(number: u32, shift: (f64, f64)) -> Frame {
        let image = GrayImage::from_fn(160, 120, |x, y| {
            let (x, y) = (f64::from(x) - shift.0, f64::from(y) - shift.1);
            Luma([(120.0 + 50.0 * (0.31 * x).sin() * (0.27 * y).cos() + 40.0 * (0.11 * x + 0.19 * y).sin()).round() as u8])
        });
        Frame::new(number, image)
    }

    fn probe(p: Point2<f64>) -> Probe {
        Probe { position: p, guess: p }
    }

    #[test]
    fn a_moved_pattern_is_found_where_it_went() {
        let mut tracker = Klt::new(4, 15);
        tracker.advance(&frame(1, (0.0, 0.0))).unwrap();
        tracker.advance(&frame(2, (3.25, -1.5))).unwrap();
        let starts: Vec<_> = (0..30).map(|k| Point2::new(40.0 + 2.7 * f64::from(k), 80.0 - 1.3 * f64::from(k))).collect();
        let probes: Vec<_> = starts.iter().map(|p| probe(*p)).collect();
        for (start, found) in starts.iter().zip(tracker.find(Slot::Previous, Slot::Current, 15, 4, &probes).unwrap()) {
            let Found::At { position, difference } = found else { panic!("{start} is lost") };
            // Grey levels are integers: an error of half a level over gradients of about ten levels per px.
            assert!((position - start - nalgebra::Vector2::new(3.25, -1.5)).norm() < 0.04, "{start} to {position}");
            // Linear interpolation deviates from the waves by up to an eighth of their curvature, 5 grey levels per px squared.
            assert!(difference < 0.7, "{difference}");
        }
        // A point is found at its own position in its own frame.
        for (start, found) in starts.iter().zip(tracker.find(Slot::Current, Slot::Current, 15, 4, &probes).unwrap()) {
            assert_eq!(found, Found::At { position: start.map(|v| f64::from(v as f32)), difference: 0.0 });
        }
    }

    #[test]
    fn gradients_of_a_ramp_are_its_slope() {
        let mut tracker = Klt::new(1, 9);
        tracker.advance(&Frame::new(1, GrayImage::from_fn(60, 50, |x, y| Luma([(2 * x + y) as u8])))).unwrap();
        let matrix = tracker.gradients(Slot::Neutral, 9, &[Point2::new(30.2, 25.4)]).unwrap()[0];
        assert_eq!(matrix, Matrix2::new(4.0, 2.0, 2.0, 1.0));
    }

    #[test]
    fn points_that_cannot_be_found_are_lost() {
        let mut tracker = Klt::new(4, 9);
        assert!(tracker.patch(Slot::Neutral, &[], 1.0, 0.0).is_err(), "no frame was read yet");
        tracker.advance(&Frame::new(1, GrayImage::from_pixel(80, 60, Luma([90])))).unwrap();
        let far = Point2::new(500.0, 20.0);
        let nowhere = Point2::new(f64::NAN, 0.0);
        let probes = [Point2::new(40.0, 30.0), far, nowhere].map(probe);
        assert_eq!(tracker.find(Slot::Current, Slot::Current, 9, 4, &probes).unwrap(), [Found::Lost; 3]);
    }
}
