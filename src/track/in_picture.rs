//! Detects tracks of mirrored pictures, tracks with y upward, and nodes that lie nowhere near their face.

use std::sync::LazyLock;

use nalgebra::{Point2, Vector2};

use super::TrackedFrame;
use crate::{
    geometry::Similarity,
    plausible::{FaceSize, Implausible},
    robust::median,
    wireframe::Wireframe,
};

/// A neutral face in pixels that is mirrored: x to the right, y down were expected, left and right the subject's own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotInPicture {
    /// y points up.
    #[error(
        "its nodes form a face mirrored at a horizontal line: y must be counted downwards from the top of the image; if it was counted \
         from the bottom, write the image's height - 1 - y"
    )]
    YUpwards,
    /// Left and right are exchanged.
    #[error(
        "its nodes form a mirrored face: left and right are swapped; they mean the subject's own sides (the subject's left is on the \
         right of the image); if the pictures were mirrored, write the image's width - 1 - x"
    )]
    Mirrored,
}

/// Largest mean distance of a mirrored face's nodes from Candide-3's, over their mean distance from the centre. Faces have 0.03 to 0.2,
/// turned ones more.
const MOST_UNLIKE: f64 = 0.35;
/// Distance of the mirrored face as a share of that of the face itself, below which a face counts as mirrored.
const NEARER: f64 = 0.5;

/// Checks that a neutral face with Candide-3's nodes, in px, is not mirrored, whatever its rotation in the picture. Faces with another
/// number of nodes are not checked.
///
/// # Errors
/// [`NotInPicture`].
pub fn check_in_picture(neutral: &[Point2<f64>]) -> Result<(), NotInPicture> {
    static CANDIDE: LazyLock<Vec<Point2<f64>>> =
        LazyLock::new(|| Wireframe::candide3().vertices().iter().map(|v| Point2::new(v.x, v.y)).collect());
    let upwards = &*CANDIDE;
    if neutral.len() != upwards.len() {
        return Ok(());
    }
    let downwards: Vec<Point2<f64>> = upwards.iter().map(|p| Point2::new(p.x, -p.y)).collect();
    // Dissimilarity of the nodes to a face, and the face's rotation.
    let unlike = |face: &[Point2<f64>]| {
        let view = Similarity::fit(face, neutral, None).ok()?;
        let middle = face.iter().map(|p| p.coords).sum::<Vector2<f64>>() / face.len() as f64;
        let spread: f64 = face.iter().map(|p| (p.coords - middle).norm_squared()).sum();
        let off: f64 = face.iter().zip(neutral).map(|(p, q)| (view.apply(p) - q).norm_squared()).sum();
        Some(((off / spread).sqrt() / view.scale, view.angle))
    };
    let (Some((face, _)), Some((mirrored, angle))) = (unlike(&downwards), unlike(upwards)) else { return Ok(()) };
    if !(mirrored < MOST_UNLIKE && mirrored < NEARER * face) {
        return Ok(());
    }
    Err(if angle.cos() > 0.0 { NotInPicture::YUpwards } else { NotInPicture::Mirrored })
}

/// Checks that all nodes of a frame lie near each other. Faces may cross the picture: frames are not compared.
///
/// # Errors
/// [`Implausible`] for the first node beyond [`crate::plausible::MAX_OFFSET`].
pub(super) fn check_near_face(frames: &[TrackedFrame]) -> Result<(), Implausible> {
    frames.iter().try_for_each(|frame| {
        let places: Vec<Point2<f64>> = frame.nodes.iter().map(|node| node.position).collect();
        match spread(&places) {
            Some(eye_separation) => FaceSize { eye_separation, unit: "px" }.check_frame(frame.number, &places),
            None => Ok(()),
        }
    })
}

/// Median distance of nodes from their median along each axis, px, whatever a few of them do: 0.7 to 1.0 eye separations. `None` if half of
/// them coincide.
fn spread(places: &[Point2<f64>]) -> Option<f64> {
    let along = |axis: usize| median(&mut places.iter().map(|p| p[axis]).collect::<Vec<_>>());
    let middle = Point2::new(along(0)?, along(1)?);
    median(&mut places.iter().map(|p| (p - middle).norm()).collect::<Vec<_>>()).filter(|spread| *spread > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirrored_face_in_pixels_is_distinguished_from_a_rotated_one() {
        let track = crate::positions::PositionTable::open("fixtures/simulated/truth/S001_005.csv".as_ref()).unwrap();
        let model = track.model::<crate::units::Px>().unwrap();
        let neutral = model.neutral().nodes();
        let changed = |change: &dyn Fn(f64, f64) -> (f64, f64)| {
            let points: Vec<_> = neutral.iter().map(|p| Point2::from(<[f64; 2]>::from(change(p.x, p.y)))).collect();
            check_in_picture(&points)
        };
        // Unchanged, on its side, upside down, narrow.
        for way in [|x, y| (x, y), |x: f64, y: f64| (-y, x), |x: f64, y: f64| (-x, -y), |x: f64, y: f64| (0.6 * x, y)] {
            assert_eq!(changed(&way), Ok(()));
        }
        assert_eq!(changed(&|x, y| (x, 299.0 - y)), Err(NotInPicture::YUpwards));
        assert_eq!(changed(&|x, y| (399.0 - x, y)), Err(NotInPicture::Mirrored));
        // With y upwards, for a head that rolls by 17 degrees.
        assert_eq!(changed(&|x, y| (0.957 * x + 0.292 * y, 0.292 * x - 0.957 * y)), Err(NotInPicture::YUpwards));
        assert_eq!(changed(&|_, _| (0.0, 0.0)), Ok(()));
        assert_eq!(check_in_picture(&neutral[..5]), Ok(()));
    }

    #[test]
    fn a_node_nowhere_near_its_face_is_named_in_any_frame() {
        let truth = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/simulated/truth/S001_005.csv");
        let frames = crate::track::read_track(&truth).unwrap();
        assert_eq!(check_near_face(&frames), Ok(()));
        for (frame, node) in [(0, 20), (2, 53), (3, 7)] {
            let mut bad = frames.clone();
            bad[frame].nodes[node].position.y = 1e30;
            let said = check_near_face(&bad).unwrap_err();
            assert_eq!((said.frame, said.point), (frames[frame].number, format!("node {node}")));
        }
        // Corners of the eyes that coincide, and a face that comes nearer.
        let mut odd = frames.clone();
        odd[2].nodes[20].position = odd[2].nodes[53].position;
        odd[3].nodes.iter_mut().for_each(|node| node.position *= 20.0);
        assert_eq!(check_near_face(&odd), Ok(()));
        // A face that crosses a wide picture.
        let mut crossing = frames.clone();
        crossing[3].nodes.iter_mut().for_each(|node| node.position.x += 1e5);
        assert_eq!(check_near_face(&crossing), Ok(()));
    }
}
