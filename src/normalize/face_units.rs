//! Recognizes positions that are not in face units.

use nalgebra::Point2;

use super::Canonical;
use crate::wireframe::Face;

/// Smallest accepted correlation of a neutral face's coordinates with Candide-3's, along x and along y. Normalized models have 0.99 for
/// any person and head rotation; below the limit, the nodes are not Candide-3's.
const LEAST_LIKENESS: f64 = 0.7;
/// Largest accepted ratio of a neutral face's width or height to Candide-3's, in either direction. Normalized models stay within 1.25.
const MOST_STRETCH: f64 = 2.0;

/// Error for a neutral face that is not in face units: x to the right of the picture, y up, the eyes 1024 apart.
///
/// ```
/// use grimace::{normalize::NotFaceUnits, pipeline::{ModelFileError, read_model}};
///
/// // A representative whose y points down.
/// let golden = std::fs::read_to_string("fixtures/golden/representatives/happiness.csv")?;
/// let turn = |row: &str| match row.rsplit_once(',') {
///     Some((start, y)) if y != "y" => format!("{start},{}\n", -y.parse::<f64>().unwrap()),
///     _ => format!("{row}\n"),
/// };
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("model.csv");
/// std::fs::write(&path, golden.lines().map(turn).collect::<String>())?;
/// let error = read_model(&path).unwrap_err();
/// assert!(matches!(error, ModelFileError::NotFaceUnits { source: NotFaceUnits::UpsideDown, .. }), "{error}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NotFaceUnits {
    /// The y axis points down.
    #[error(
        "its neutral face is upside down: in face units y points up; negate y. If these are pixels, keep the columns state and residual, \
         which identify a track, or normalize the track with `grimace analyze`"
    )]
    UpsideDown,
    /// The x axis points to the other side.
    #[error("its neutral face is mirrored: in face units x points to the right of the picture, the subject's left; negate x")]
    Mirrored,
    /// Both axes are reversed.
    #[error(
        "its neutral face is turned by 180 degrees: in face units x points to the right of the picture and y up; negate both"
    )]
    Turned,
    /// The positions have another unit.
    #[error(
        "its neutral face is {width:.3} times as wide and {height:.3} times as high as one in face units, which has 1024 of them between the \
         pupils: check whether it is in pixels or metres; normalize the track with `grimace analyze`, or scale x and y of all frames by \
         the same factor"
    )]
    Scale {
        /// Width relative to Candide-3 in face units.
        width: f64,
        /// Height relative to Candide-3 in face units.
        height: f64,
    },
    /// The nodes are not arranged as in a face.
    #[error(
        "its first frame is not a neutral face: the nodes do not match Candide-3 (correlation {x:.2} along x, {y:.2} along y; at least \
         {LEAST_LIKENESS} was expected); check that the nodes are in the order of Candide-3 and that the head is upright"
    )]
    Unlike {
        /// Correlation of the nodes' x with Candide-3's, -1 to 1.
        x: f64,
        /// Correlation of the nodes' y with Candide-3's, -1 to 1.
        y: f64,
    },
}

/// Checks that a neutral face in face units is upright, not mirrored and of about Candide-3's size.
///
/// The limits are wide: they detect mistakes in a file, not unusual faces. Faces whose number of nodes is not Candide-3's are not
/// checked.
///
/// # Errors
/// [`NotFaceUnits`].
pub fn check_face_units(neutral: &[Point2<f64>]) -> Result<(), NotFaceUnits> {
    let face = Face::candide3();
    let Ok(canonical) = Canonical::new(&face.wireframe, &face.tables) else { return Ok(()) };
    let expected = canonical.neutral.nodes();
    if neutral.len() != expected.len() {
        return Ok(());
    }
    // Size relative to the expected one (slope of the regression), and correlation.
    let along = |axis: usize| {
        let mean = |points: &[Point2<f64>]| points.iter().map(|p| p[axis]).sum::<f64>() / points.len() as f64;
        let (found_mean, expected_mean) = (mean(neutral), mean(expected));
        let pairs = neutral.iter().zip(expected).map(|(p, q)| (p[axis] - found_mean, q[axis] - expected_mean));
        let (product, found, wanted) = pairs.fold((0.0, 0.0, 0.0), |(ab, aa, bb), (a, b)| (ab + a * b, aa + a * a, bb + b * b));
        let size: f64 = product / wanted;
        (size, if found > 0.0 { product / (found * wanted).sqrt() } else { 0.0 })
    };
    let ((width, x), (height, y)) = (along(0), along(1));
    if !(x.abs() >= LEAST_LIKENESS && y.abs() >= LEAST_LIKENESS) {
        return Err(NotFaceUnits::Unlike { x, y });
    }
    match (x < 0.0, y < 0.0) {
        (true, true) => return Err(NotFaceUnits::Turned),
        (true, false) => return Err(NotFaceUnits::Mirrored),
        (false, true) => return Err(NotFaceUnits::UpsideDown),
        (false, false) => {}
    }
    let sizes = 1.0 / MOST_STRETCH..=MOST_STRETCH;
    if sizes.contains(&width) && sizes.contains(&height) { Ok(()) } else { Err(NotFaceUnits::Scale { width, height }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_that_are_not_in_face_units_are_reported() {
        let happiness = crate::positions::PositionTable::open("fixtures/golden/representatives/happiness.csv".as_ref()).unwrap();
        let model = happiness.model::<crate::units::FaceUnit>().unwrap();
        let neutral = model.neutral().nodes();
        let changed = |change: &dyn Fn(f64, f64) -> (f64, f64)| {
            let points: Vec<_> = neutral.iter().map(|p| Point2::from(<[f64; 2]>::from(change(p.x, p.y)))).collect();
            check_face_units(&points)
        };
        // Unusual faces: narrow, long, shifted, slightly rotated in the plane.
        assert_eq!(changed(&|x, y| (x, y)), Ok(()));
        assert_eq!(changed(&|x, y| (0.7 * x + 900.0, 1.4 * y - 3e3)), Ok(()));
        assert_eq!(changed(&|x, y| (0.94 * x - 0.34 * y, 0.34 * x + 0.94 * y)), Ok(()));
        assert_eq!(changed(&|x, y| (x, -y)), Err(NotFaceUnits::UpsideDown));
        assert_eq!(changed(&|x, y| (-x, y)), Err(NotFaceUnits::Mirrored));
        assert_eq!(changed(&|x, y| (-x, -y)), Err(NotFaceUnits::Turned));
        // Pixels of a face with eyes 100 apart, y down.
        assert_eq!(changed(&|x, y| (x / 10.0 + 300.0, 200.0 - y / 10.0)), Err(NotFaceUnits::UpsideDown));
        assert!(
            matches!(changed(&|x, y| (x / 10.0, y / 10.0)), Err(NotFaceUnits::Scale { width, .. }) if (width - 0.1).abs() < 0.01)
        );
        assert!(matches!(changed(&|x, y| (y, x)), Err(NotFaceUnits::Unlike { .. })));
        assert!(matches!(changed(&|_, _| (0.0, 0.0)), Err(NotFaceUnits::Unlike { .. })));
        assert_eq!(check_face_units(&neutral[..5]), Ok(()));
    }
}
