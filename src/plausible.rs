//! The one bound on motion: what moves further than a face is large is no expression, and is refused wherever motion is read.
//!
//! A coordinate of 1e30 is a number like any other to statistics, springs and meshes, and ends in pictures of nothing. Models, tracks,
//! FAP files, feature point motions and columnar files all pass through here before anything is computed from them.

use nalgebra::{Point2, Vector2};

/// Farthest that a point of a face may be from its place in the neutral frame, and a neutral point from the middle of its face, in eye
/// separations (ES0). A face is about four of them high; expressions move points by a quarter of one.
pub const MAX_OFFSET: f64 = 10.0;

/// Motion that no face makes.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "frame {frame}: {point} is off by ({x:.3e}, {y:.3e}) {unit}, further than {MAX_OFFSET} eye separations ({limit:.4e}) from {from}; \
     that is no face: correct the value or leave the frame out"
)]
pub struct Implausible {
    /// The frame, as the file numbers it.
    pub frame: u32,
    /// `node 31` or `feature point 8.3`.
    pub point: String,
    /// Offset along x.
    pub x: f64,
    /// Offset along y.
    pub y: f64,
    /// Unit of offsets and limit.
    pub unit: &'static str,
    /// Largest offset.
    pub limit: f64,
    /// What the offset is measured from.
    pub from: &'static str,
}

/// The size of a face, and in what unit.
#[derive(Clone, Copy, Debug)]
pub struct FaceSize {
    /// Eye separation ES0.
    pub eye_separation: f64,
    /// Its unit, as messages say it.
    pub unit: &'static str,
}

impl FaceSize {
    /// The canonical face's.
    pub const CANONICAL: Self = Self { eye_separation: crate::normalize::CANONICAL_ES, unit: "face units" };

    /// The largest offset, in the face's unit.
    pub fn limit(self) -> f64 {
        MAX_OFFSET * self.eye_separation
    }

    /// Checks offsets from neutral, node by node, of the frame numbered `frame`.
    ///
    /// # Errors
    /// [`Implausible`] for the first node beyond [`MAX_OFFSET`].
    pub fn check_offsets<'a>(self, frame: u32, offsets: impl IntoIterator<Item = &'a Vector2<f64>>) -> Result<(), Implausible> {
        let from = "where the neutral frame has it";
        offsets.into_iter().enumerate().try_for_each(|(k, v)| self.check(frame, || format!("node {k}"), *v, from))
    }

    /// Checks the offset of one point.
    ///
    /// # Errors
    /// [`Implausible`] beyond [`MAX_OFFSET`], and for what is no number.
    pub fn check(
        self,
        frame: u32,
        point: impl Fn() -> String,
        offset: Vector2<f64>,
        from: &'static str,
    ) -> Result<(), Implausible> {
        let limit = self.limit();
        if offset.norm() <= limit {
            return Ok(());
        }
        Err(Implausible { frame, point: point(), x: offset.x, y: offset.y, unit: self.unit, limit, from })
    }

    /// Checks the positions of a neutral face, against their median along each axis.
    ///
    /// # Errors
    /// [`Implausible`] for the first node beyond [`MAX_OFFSET`].
    pub fn check_neutral(self, frame: u32, neutral: &[Point2<f64>]) -> Result<(), Implausible> {
        let middle = |axis: usize| {
            let mut values: Vec<f64> = neutral.iter().map(|p| p[axis]).collect();
            let half = values.len() / 2;
            if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(half, f64::total_cmp).1 }
        };
        let middle = Point2::new(middle(0), middle(1));
        let from = "the middle of the neutral face";
        neutral.iter().enumerate().try_for_each(|(k, p)| self.check(frame, || format!("node {k}"), p - middle, from))
    }

    /// Checks a model: its neutral frame, and all frames' offsets. Frames are counted from 0.
    ///
    /// # Errors
    /// [`Implausible`] for the first node beyond [`MAX_OFFSET`].
    pub fn check_model<U: crate::units::Unit>(self, model: &crate::model::DynamicExpressionModel<U>) -> Result<(), Implausible> {
        self.check_neutral(0, model.neutral().nodes())?;
        (1..model.frame_count()).try_for_each(|m| self.check_offsets(m as u32, &model.neutral_offsets(m)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ten_eye_separations_are_the_bound() {
        let size = FaceSize { eye_separation: 2.0, unit: "px" };
        let offsets = |x: f64| vec![Vector2::zeros(), Vector2::new(x, 0.0)];
        assert_eq!(size.check_offsets(7, &offsets(20.0)), Ok(()));
        let error = size.check_offsets(7, &offsets(1e30)).unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("frame 7: node 1 is off by (1.000e30, 0.000e0) px, further than 10 eye separations (2.0000e1)")
        );
        assert!(size.check_offsets(7, &offsets(f64::NAN)).is_err() && size.check_offsets(7, &offsets(20.1)).is_err());
        let face = |x: f64| [0.0, 1.0, 2.0, x].map(|x| Point2::new(x, 5.0));
        assert_eq!(size.check_neutral(0, &face(22.0)), Ok(()));
        assert_eq!(size.check_neutral(0, &face(1e9)).unwrap_err().point, "node 3");
        assert_eq!(size.check_neutral(0, &[]), Ok(()));
    }
}
