//! Pyramidal KLT [Bouguet] by OpenCV. Pyramids are built once per frame and serve as next, then as previous image.

use std::rc::Rc;

use nalgebra::{Matrix2, Point2};
use opencv::{
    core::{BORDER_REFLECT_101, CV_32F, Mat, Point2f, Rect, Size, TermCriteria, TermCriteria_Type, Vec2s, Vector},
    imgproc::gaussian_blur,
    prelude::*,
    video::{OPTFLOW_USE_INITIAL_FLOW, build_optical_flow_pyramid, calc_optical_flow_pyr_lk},
};

use super::{Found, Patch, PointTracker, Probe, Slot, TrackError};
use crate::{native, sequence::Frame};

/// Iterations and step (px) at which the search at one pyramid level ends: OpenCV's defaults.
const MAX_ITERATIONS: i32 = 30;
const STEP_PX: f64 = 0.01;

/// Grey levels per px of one step of OpenCV's Scharr derivatives.
const SCHARR: f64 = 1.0 / 32.0;

/// Smallest normalized eigenvalue of a window's gradient matrix: OpenCV's default.
const MIN_EIGENVALUE: f64 = 1e-4;

impl From<opencv::Error> for TrackError {
    fn from(error: opencv::Error) -> Self {
        Self::PointTracker { reason: format!("OpenCV: {error}") }
    }
}

/// The tracker of OpenCV.
#[derive(Debug)]
pub struct Klt {
    levels: i32,
    max_window: i32,
    // Shared, not cloned: a cloned `Mat` loses the border that its pyramid was padded with.
    neutral: Rc<Vector<Mat>>,
    previous: Rc<Vector<Mat>>,
    current: Rc<Vector<Mat>>,
}

impl Klt {
    /// A tracker with `levels` pyramid levels (1: the image itself only), padded for windows up to `max_window_px`.
    pub fn new(levels: u32, max_window_px: u32) -> Self {
        native::configure();
        let (levels, max_window) = (levels.clamp(1, 8) as i32, (max_window_px as i32).clamp(3, 255));
        Self { levels, max_window, neutral: Rc::default(), previous: Rc::default(), current: Rc::default() }
    }

    fn pyramid(&self, frame: &Frame) -> Result<Vector<Mat>, TrackError> {
        let mut pyramid = Vector::<Mat>::new();
        let window = Size::new(self.max_window, self.max_window);
        let (reflect, constant) = (opencv::core::BORDER_REFLECT_101, opencv::core::BORDER_CONSTANT);
        let image = frame.image();
        let mat = Mat::new_rows_cols_with_data(image.height() as i32, image.width() as i32, image.as_raw())?;
        // The pyramid copies: the frame may go.
        build_optical_flow_pyramid(&mat, &mut pyramid, window, self.levels - 1, true, reflect, constant, false)?;
        Ok(pyramid)
    }

    fn slot(&self, slot: Slot) -> &Vector<Mat> {
        match slot {
            Slot::Neutral => &self.neutral,
            Slot::Previous => &self.previous,
            Slot::Current => &self.current,
        }
    }
}

impl PointTracker for Klt {
    fn advance(&mut self, frame: &Frame) -> Result<(), TrackError> {
        let pyramid = Rc::new(self.pyramid(frame)?);
        if self.neutral.is_empty() {
            self.neutral = Rc::clone(&pyramid);
        }
        self.previous = std::mem::replace(&mut self.current, pyramid);
        Ok(())
    }

    fn gradients(&self, slot: Slot, window_px: u32, points: &[Point2<f64>]) -> Result<Vec<Matrix2<f64>>, TrackError> {
        // A pyramid with derivatives holds image and derivatives of every level in turn.
        let derivatives = self.slot(slot).get(1)?;
        let half = (window_px / 2) as i32;
        let range = |centre: f64, size: i32| {
            let centre = centre.round().clamp(-1e6, 1e6) as i32;
            (centre - half).clamp(0, size)..(centre + half + 1).clamp(0, size)
        };
        let matrix = |point: &Point2<f64>| -> Result<Matrix2<f64>, TrackError> {
            let (mut xx, mut xy, mut yy, mut count) = (0.0, 0.0, 0.0, 0u32);
            let columns = range(point.x, derivatives.cols());
            for y in range(point.y, derivatives.rows()) {
                let row = derivatives.at_row::<Vec2s>(y)?;
                for pixel in &row[columns.start as usize..columns.end as usize] {
                    let (dx, dy) = (f64::from(pixel[0]) * SCHARR, f64::from(pixel[1]) * SCHARR);
                    xx += dx * dx;
                    xy += dx * dy;
                    yy += dy * dy;
                    count += 1;
                }
            }
            Ok(Matrix2::new(xx, xy, xy, yy) / f64::from(count.max(1)))
        };
        points.iter().map(matrix).collect()
    }

    fn patch(&self, slot: Slot, points: &[Point2<f64>], margin: f64, smoothing: f64) -> Result<Option<Patch>, TrackError> {
        let image = self.slot(slot).get(0)?;
        let range = |axis: usize, size: i32| {
            let values = points.iter().map(|p| p[axis]);
            let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            let bound = |v: f64| v.clamp(0.0, f64::from(size)) as i32;
            (bound((low - margin).floor()), bound((high + margin).ceil() + 1.0))
        };
        let ((left, right), (top, bottom)) = (range(0, image.cols()), range(1, image.rows()));
        if left >= right || top >= bottom {
            return Ok(None);
        }
        let part = image.roi(Rect::new(left, top, right - left, bottom - top))?;
        let (mut grey, mut smooth) = (Mat::default(), Mat::default());
        part.convert_to(&mut grey, CV_32F, 1.0, 0.0)?;
        if smoothing > 0.0 {
            gaussian_blur(&grey, &mut smooth, Size::default(), smoothing, smoothing, BORDER_REFLECT_101)?;
        } else {
            smooth = grey;
        }
        let (width, height) = ((right - left) as usize, (bottom - top) as usize);
        Ok(Some(Patch { left: left as u32, top: top as u32, width, height, values: smooth.data_typed::<f32>()?.to_vec() }))
    }

    fn find(&mut self, from: Slot, to: Slot, window_px: u32, levels: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError> {
        if probes.is_empty() {
            return Ok(Vec::new());
        }
        let single = |p: &Point2<f64>| Point2f::new(p.x as f32, p.y as f32);
        let points: Vector<Point2f> = probes.iter().map(|p| single(&p.position)).collect();
        let mut found: Vector<Point2f> = probes.iter().map(|p| single(&p.guess)).collect();
        let (mut status, mut error) = (Vector::<u8>::new(), Vector::<f32>::new());
        let window = (window_px as i32).clamp(3, self.max_window);
        let kind = TermCriteria_Type::COUNT as i32 + TermCriteria_Type::EPS as i32;
        let criteria = TermCriteria { typ: kind, max_count: MAX_ITERATIONS, epsilon: STEP_PX };
        calc_optical_flow_pyr_lk(
            self.slot(from),
            self.slot(to),
            &points,
            &mut found,
            &mut status,
            &mut error,
            Size::new(window, window),
            (levels as i32).clamp(1, self.levels) - 1,
            criteria,
            OPTFLOW_USE_INITIAL_FLOW,
            MIN_EIGENVALUE,
        )?;
        let answers = found.iter().zip(status.iter()).zip(error.iter());
        Ok(answers
            .map(|((point, status), error)| {
                if status == 1 && point.x.is_finite() && point.y.is_finite() {
                    Found::At { position: Point2::new(f64::from(point.x), f64::from(point.y)), difference: f64::from(error) }
                } else {
                    Found::Lost
                }
            })
            .collect())
    }
}
