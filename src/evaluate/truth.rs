//! Which landmark stands for which node, and how large a face with landmarks is.

use nalgebra::{Point2, Vector2};

use crate::{
    dataset::LANDMARK_COUNT,
    units::NodeId,
    wireframe::{LandmarkConfidence, Tables},
};

/// First landmark that is not on the contour: the inner face is 17 to 67.
pub const FIRST_INNER_LANDMARK: u8 = 17;

/// Landmarks around the right and the left eye; their mean stands for the pupil.
const EYES: [std::ops::Range<usize>; 2] = [36..42, 42..48];

/// A node and the landmark that stands for it alone, confidence high or medium.
#[derive(Clone, Debug, PartialEq)]
pub struct ComparedNode {
    /// The node.
    pub node: NodeId,
    /// Its landmark.
    pub landmark: usize,
    /// Part of the face, as in the table of landmarks.
    pub part: String,
    /// Whether it belongs to the inner face.
    pub inner: bool,
}

/// The nodes that can be compared with landmarks, in the order of the landmarks.
pub fn compared_nodes(tables: &Tables) -> Vec<ComparedNode> {
    let rows = tables.landmarks.iter().filter(|row| row.confidence >= LandmarkConfidence::Medium);
    rows.filter_map(|row| match row.nodes[..] {
        [(node, _)] => Some(ComparedNode {
            node,
            landmark: usize::from(row.landmark),
            part: row.part.clone(),
            inner: row.landmark >= FIRST_INNER_LANDMARK,
        }),
        _ => None,
    })
    .collect()
}

/// Eye distance ES0 of a face with 68 landmarks, px: between the means of the landmarks around each eye. `None` when it is not
/// positive, or when there are not 68 landmarks.
pub fn landmark_eye_distance(points: &[Point2<f64>]) -> Option<f64> {
    if points.len() != LANDMARK_COUNT {
        return None;
    }
    let [right, left] = EYES.map(|eye| {
        let count = eye.len() as f64;
        points[eye].iter().map(|p| p.coords).sum::<Vector2<f64>>() / count
    });
    Some((left - right).norm()).filter(|d| d.is_finite() && *d > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fifty_two_landmarks_stand_for_one_node() {
        // 68 landmarks, 15 of low confidence, and the nasion (27) between two nodes.
        let compared = compared_nodes(&Tables::candide3());
        assert_eq!(compared.len(), 52);
        // Of the 51 inner ones the four between brow nodes 18, 20, 23, 25, then 27, 29, 56 and 58 are out.
        assert_eq!(compared.iter().filter(|c| c.inner).count(), 43);
        let nodes: std::collections::BTreeSet<_> = compared.iter().map(|c| c.node).collect();
        assert_eq!(nodes.len(), 52, "no node twice");
    }

    #[test]
    fn the_eye_distance_is_between_the_middles_of_the_eyes() {
        let mut points = vec![Point2::new(0.0, 0.0); LANDMARK_COUNT];
        for k in 36..42 {
            points[k] = Point2::new(10.0 + (k - 36) as f64, 5.0); // mean 12.5
        }
        for k in 42..48 {
            points[k] = Point2::new(15.5, 9.0);
        }
        // From (12.5, 5) to (15.5, 9): 5.
        assert_eq!(landmark_eye_distance(&points), Some(5.0));
        assert_eq!(landmark_eye_distance(&points[..67]), None);
        assert_eq!(landmark_eye_distance(&[Point2::origin(); LANDMARK_COUNT]), None);
    }
}
