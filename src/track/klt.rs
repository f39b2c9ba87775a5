//! Pyramidal KLT [Bouguet]. The pyramid of a frame is built once and used as next, then as previous image, forward and back.
//!
//! The arithmetic is that of OpenCV's `calcOpticalFlowPyrLK`, the field's reference: positions in single precision, 14 bits for the weights
//! of the bilinear interpolation, 5 fractional bits for grey values, 16 bits for Scharr derivatives, and the same rules for stopping and
//! for lost points. Derivatives are computed only within the windows.

mod lanes;
mod pyramid;
mod reference;
mod scharr;
mod smooth;
mod window;

use nalgebra::{Matrix2, Point2};
use serde::{Deserialize, Serialize};

use self::{
    pyramid::{Level, Pyramid},
    scharr::Scharr,
    window::Window,
};
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
