//! Creates correspondences for a fit from the landmarks of a neutral frame.

use std::str::FromStr;

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::LandmarksError;
use crate::{
    correspondence::Correspondence,
    units::NodeId,
    wireframe::{LandmarkConfidence, LandmarkRow, Tables},
};

/// Eleven nodes that are easy to mark by hand: outer and inner eye corners (left 20, 23, right 53, 56), mouth corners (left 31, right 64),
/// chin (10), outer and inner ends of the brows (left 15, 17, right 48, 50).
///
/// They were chosen by the error of the resulting motion; `candide/README.md` has the figures. Without brow marks, the brow nodes lie on
/// the forehead or the lid and follow still skin. The tops of the brows (16, 49) add nothing to their ends.
pub const DEFAULT_LANDMARK_NODES: [NodeId; 11] = [
    NodeId(20),
    NodeId(23),
    NodeId(53),
    NodeId(56),
    NodeId(31),
    NodeId(64),
    NodeId(10),
    NodeId(15),
    NodeId(17),
    NodeId(48),
    NodeId(50),
];

/// Selects the landmarks that become correspondences. Interpolated ones (confidence low, or between two nodes) never do.
///
/// ```
/// use grimace::{dataset::LandmarkSelection, units::NodeId};
///
/// assert_eq!("high".parse(), Ok(LandmarkSelection::High));
/// assert_eq!(LandmarkSelection::default(), LandmarkSelection::Auto);
/// let corners_of_the_mouth = LandmarkSelection::Nodes(vec![NodeId(31), NodeId(64)]);
/// assert_ne!(corners_of_the_mouth, LandmarkSelection::Default);
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LandmarkSelection {
    /// All of high and medium confidence, each weighted by its expected error. Without landmarks, marks are found in the picture.
    #[default]
    Auto,
    /// Those of [`DEFAULT_LANDMARK_NODES`].
    Default,
    /// Those of the given nodes, in the order given.
    Nodes(Vec<NodeId>),
    /// All that are the same anatomical point as a node.
    High,
    /// Those of `High`, and all on the same contour as a node.
    HighAndMedium,
}

impl FromStr for LandmarkSelection {
    type Err = String;

    /// `auto`, `default`, `high`, `all` (high and medium), or node numbers separated by commas.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "auto" => Ok(Self::Auto),
            "default" => Ok(Self::Default),
            "high" => Ok(Self::High),
            "all" => Ok(Self::HighAndMedium),
            list => {
                let node = |word: &str| word.trim().parse().map(NodeId);
                let nodes: Result<Vec<NodeId>, _> = list.split(',').map(node).collect();
                nodes
                    .map(Self::Nodes)
                    .map_err(|_| format!("`{text}` is neither auto, default, high, all nor a list of nodes such as 20,23,53"))
            }
        }
    }
}

/// Median error of a landmark as a mark of its node, in eye distances. For each part of the face: for the same anatomical point, and for
/// the same contour, where the position along it is approximate.
const EXPECTED_ERRORS: [(&str, f64, f64); 6] = [
    ("eye", 0.02, 0.03),
    ("nose", 0.025, 0.035),
    ("brow", 0.03, 0.04),
    ("outer_lip", 0.025, 0.03),
    ("inner_lip", 0.025, 0.03),
    ("jaw", 0.05, 0.07),
];

/// Landmarks of the right and of the left eye. Their centroids represent the pupils.
const EYES: [std::ops::Range<usize>; 2] = [36..42, 42..48];

/// Distance between the centroids of the eyes, px; `None` where landmarks are missing or coincide.
fn eye_distance(points: &[Point2<f64>]) -> Option<f64> {
    let middle = |eye: &std::ops::Range<usize>| {
        let corners = points.get(eye.clone())?;
        Some(corners.iter().map(|p| p.coords).sum::<nalgebra::Vector2<f64>>() / corners.len() as f64)
    };
    let distance = (middle(&EYES[0])? - middle(&EYES[1])?).norm();
    (distance.is_finite() && distance > 0.0).then_some(distance)
}

/// Expected error of a landmark, px. `eye_distance` in px.
fn expected_error(row: &LandmarkRow, eye_distance: f64) -> Option<f64> {
    let (_, same_point, same_contour) = EXPECTED_ERRORS.iter().find(|(part, ..)| *part == row.part)?;
    let share = if row.confidence == LandmarkConfidence::High { same_point } else { same_contour };
    Some(share * eye_distance)
}

/// Creates correspondences from the landmarks of one frame, by [`Tables::landmarks`], each with its expected error. `points` are in the
/// order of the scheme.
///
/// ```
/// use grimace::{dataset::{LandmarkSelection, correspondences_from_landmarks}, units::NodeId, wireframe::Tables};
/// use nalgebra::Point2;
///
/// let points: Vec<Point2<f64>> = (0..68).map(|k| Point2::new(f64::from(k), 0.0)).collect();
/// let mouth = LandmarkSelection::Nodes(vec![NodeId(31), NodeId(64)]);
/// let marks = correspondences_from_landmarks(&points, &Tables::candide3(), &mouth)?;
/// // Landmarks 54 and 48 are the left and the right corner of the mouth.
/// assert_eq!([marks[0].position.x, marks[1].position.x], [54.0, 48.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`LandmarksError::NoLandmark`] when a requested node has no landmark in `points`.
pub fn correspondences_from_landmarks(
    points: &[Point2<f64>],
    tables: &Tables,
    selection: &LandmarkSelection,
) -> Result<Vec<Correspondence>, LandmarksError> {
    let eye_distance = eye_distance(points);
    let marks: Vec<(NodeId, LandmarkConfidence, Correspondence)> = tables
        .landmarks
        .iter()
        .filter_map(|row| match row.nodes[..] {
            [(node, _)] => {
                let position = *points.get(usize::from(row.landmark))?;
                let expected_error = eye_distance.and_then(|es| expected_error(row, es));
                Some((node, row.confidence, Correspondence { expected_error, ..Correspondence::mark(node, position) }))
            }
            _ => None,
        })
        .filter(|&(_, confidence, _)| confidence != LandmarkConfidence::Low)
        .collect();
    let of_nodes = |nodes: &[NodeId]| {
        let one = |&node: &NodeId| match marks.iter().find(|mark| mark.0 == node) {
            Some(&(_, _, mark)) => Ok(mark),
            None => Err(LandmarksError::NoLandmark { node, nodes: marks.iter().map(|mark| mark.0).collect() }),
        };
        nodes.iter().map(one).collect()
    };
    let at_least = |least| marks.iter().filter(|mark| mark.1 >= least).map(|mark| mark.2).collect();
    match selection {
        LandmarkSelection::Default => of_nodes(&DEFAULT_LANDMARK_NODES),
        LandmarkSelection::Nodes(nodes) => of_nodes(nodes),
        LandmarkSelection::High => Ok(at_least(LandmarkConfidence::High)),
        LandmarkSelection::Auto | LandmarkSelection::HighAndMedium => Ok(at_least(LandmarkConfidence::Medium)),
    }
}
