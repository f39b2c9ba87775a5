//! Correspondences for a fit from the landmarks of a neutral frame.

use std::str::FromStr;

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::LandmarksError;
use crate::{
    correspondence::Correspondence,
    units::NodeId,
    wireframe::{LandmarkConfidence, Tables},
};

/// Nodes fitted from landmarks by default: outer and inner eye corners (left 20, 23, right 53, 56), mouth corners (left 31,
/// right 64), chin (10).
pub const DEFAULT_LANDMARK_NODES: [NodeId; 7] =
    [NodeId(20), NodeId(23), NodeId(53), NodeId(56), NodeId(31), NodeId(64), NodeId(10)];

/// Which landmarks become correspondences. Interpolated ones (confidence low, or between two nodes) never do.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LandmarkSelection {
    /// Those of [`DEFAULT_LANDMARK_NODES`].
    #[default]
    Default,
    /// Those of the given nodes, in the order given.
    Nodes(Vec<NodeId>),
    /// All that are the same anatomical point as a node.
    High,
    /// These and all on the same contour.
    HighAndMedium,
}

impl FromStr for LandmarkSelection {
    type Err = String;

    /// `default`, `high`, `all` (high and medium), or node numbers separated by commas.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "default" => Ok(Self::Default),
            "high" => Ok(Self::High),
            "all" => Ok(Self::HighAndMedium),
            list => {
                let node = |word: &str| word.trim().parse().map(NodeId);
                let nodes: Result<Vec<NodeId>, _> = list.split(',').map(node).collect();
                nodes
                    .map(Self::Nodes)
                    .map_err(|_| format!("`{text}` is neither default, high, all nor a list of nodes such as 20,23,53"))
            }
        }
    }
}

/// Correspondences from the landmarks of one frame, through [`Tables::landmarks`]; `points` in the order of the scheme.
///
/// # Errors
/// [`LandmarksError::NoLandmark`] when a node was asked for that no landmark in `points` marks.
pub fn correspondences_from_landmarks(
    points: &[Point2<f64>],
    tables: &Tables,
    selection: &LandmarkSelection,
) -> Result<Vec<Correspondence>, LandmarksError> {
    let marks: Vec<(NodeId, LandmarkConfidence, Point2<f64>)> = tables
        .landmarks
        .iter()
        .filter_map(|row| match row.nodes[..] {
            [(node, _)] => Some((node, row.confidence, *points.get(usize::from(row.landmark))?)),
            _ => None,
        })
        .filter(|&(_, confidence, _)| confidence != LandmarkConfidence::Low)
        .collect();
    let of_nodes = |nodes: &[NodeId]| {
        let one = |&node: &NodeId| match marks.iter().find(|mark| mark.0 == node) {
            Some(&(_, _, position)) => Ok(Correspondence::mark(node, position)),
            None => Err(LandmarksError::NoLandmark { node, nodes: marks.iter().map(|mark| mark.0).collect() }),
        };
        nodes.iter().map(one).collect()
    };
    let at_least = |least| marks.iter().filter(|mark| mark.1 >= least).map(|mark| Correspondence::mark(mark.0, mark.2)).collect();
    match selection {
        LandmarkSelection::Default => of_nodes(&DEFAULT_LANDMARK_NODES),
        LandmarkSelection::Nodes(nodes) => of_nodes(nodes),
        LandmarkSelection::High => Ok(at_least(LandmarkConfidence::High)),
        LandmarkSelection::HighAndMedium => Ok(at_least(LandmarkConfidence::Medium)),
    }
}
