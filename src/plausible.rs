//! The upper bound on facial motion: larger motion is refused wherever motion is read.
//!
//! A coordinate of 1e30 would pass through statistics, springs and meshes like any other number and end in meaningless pictures.
//! Therefore models, tracks, FAP files, feature point motions and columnar files are checked here before anything is computed from them.

use nalgebra::{Point2, Vector2};

/// Largest distance, in eye separations (ES0), of a point from its position in the neutral frame, and of a neutral point from the middle
/// of its face. A face is about four eye separations high; expressions move points by a quarter of one.
pub const MAX_OFFSET: f64 = 10.0;

/// Error for motion that no face makes.
///
/// ```
/// use grimace::{clone::{CloneError, SourceMotion}, errors::Implausible, wireframe::Face};
///
/// // A corner of the mouth moves by a million face units; the eyes are 1024 apart.
/// let golden = std::fs::read_to_string("fixtures/golden/representatives/happiness.csv")?;
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("far.csv");
/// let far = |row: &str| if row.starts_with("4,31,") { "4,31,1000000,0\n".to_owned() } else { format!("{row}\n") };
/// std::fs::write(&path, golden.lines().map(far).collect::<String>())?;
/// let error = SourceMotion::read(&path, &Face::candide3()).unwrap_err();
/// assert!(matches!(error, CloneError::Implausible { source: Implausible { frame: 4, .. }, .. }), "{error}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "frame {frame}: {point} is ({x:.3e}, {y:.3e}) {unit} away from {from}, further than {MAX_OFFSET} eye separations ({limit:.4e}); this \
     cannot be a face: correct the value or leave the frame out"
)]
pub struct Implausible {
    /// Frame number in the file.
    pub frame: u32,
    /// `node 31` or `feature point 8.3`.
    pub point: String,
    /// Offset along x.
    pub x: f64,
    /// Offset along y.
    pub y: f64,
    /// Unit of the offsets and the limit.
    pub unit: &'static str,
    /// Largest offset allowed.
    pub limit: f64,
    /// Point from which the offset is measured.
    pub from: &'static str,
}

/// Size of a face with its unit.
#[derive(Clone, Copy, Debug)]
pub struct FaceSize {
    /// Eye separation ES0.
    pub eye_separation: f64,
    /// Its unit, as messages print it.
    pub unit: &'static str,
}

impl FaceSize {
    /// Size of the canonical face.
    pub const CANONICAL: Self = Self { eye_separation: crate::units::FaceUnit::PER_ES, unit: "face units" };

    /// Returns the largest allowed offset, in the face's unit.
    pub fn limit(self) -> f64 {
        MAX_OFFSET * self.eye_separation
    }

    /// Checks the offsets from neutral of all nodes of frame number `frame`.
    ///
    /// # Errors
    /// [`Implausible`] for the first node beyond [`MAX_OFFSET`].
    pub fn check_offsets<'a>(self, frame: u32, offsets: impl IntoIterator<Item = &'a Vector2<f64>>) -> Result<(), Implausible> {
        let from = "its place in the neutral frame";
        offsets.into_iter().enumerate().try_for_each(|(k, v)| self.check(frame, || format!("node {k}"), *v, from))
    }

    /// Checks the offset of one point.
    ///
    /// # Errors
    /// [`Implausible`] for an offset beyond [`MAX_OFFSET`] or NaN.
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

    /// Checks the distances of a neutral face's nodes from their median along each axis.
    ///
    /// # Errors
    /// [`Implausible`] for the first node beyond [`MAX_OFFSET`].
    pub fn check_neutral(self, frame: u32, neutral: &[Point2<f64>]) -> Result<(), Implausible> {
        self.check_about_middle(frame, neutral, "the middle of the neutral face")
    }

    /// Same as [`FaceSize::check_neutral`], for any frame.
    ///
    /// # Errors
    /// As there.
    pub fn check_frame(self, frame: u32, nodes: &[Point2<f64>]) -> Result<(), Implausible> {
        self.check_about_middle(frame, nodes, "the middle of the face")
    }

    fn check_about_middle(self, frame: u32, nodes: &[Point2<f64>], from: &'static str) -> Result<(), Implausible> {
        let middle = |axis: usize| {
            let mut values: Vec<f64> = nodes.iter().map(|p| p[axis]).collect();
            let half = values.len() / 2;
            if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(half, f64::total_cmp).1 }
        };
        let middle = Point2::new(middle(0), middle(1));
        nodes.iter().enumerate().try_for_each(|(k, p)| self.check(frame, || format!("node {k}"), p - middle, from))
    }

    /// Checks a model: its neutral frame and the offsets of all other frames. Frames are counted from 0.
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
        assert!(error.to_string().starts_with(
            "frame 7: node 1 is (1.000e30, 0.000e0) px away from its place in the neutral frame, further than 10 eye \
                     separations (2.0000e1)"
        ));
        assert!(size.check_offsets(7, &offsets(f64::NAN)).is_err() && size.check_offsets(7, &offsets(20.1)).is_err());
        let face = |x: f64| [0.0, 1.0, 2.0, x].map(|x| Point2::new(x, 5.0));
        assert_eq!(size.check_neutral(0, &face(22.0)), Ok(()));
        assert_eq!(size.check_neutral(0, &face(1e9)).unwrap_err().point, "node 3");
        assert_eq!(size.check_neutral(0, &[]), Ok(()));
    }
}
