//! The locator's points: their nodes, their mirror images, and the hand-set points that they are computed from.

use std::sync::LazyLock;

use nalgebra::Point2;

use super::shape::{Point, distance};
use crate::units::NodeId;

/// One point.
#[derive(Clone, Debug, PartialEq)]
pub struct LocatorPoint {
    /// Node of the point; `None` for an auxiliary point.
    pub node: Option<NodeId>,
    /// Index of its mirror image.
    pub mirror: usize,
    /// Indices in the 189 points of the Face Research Lab London Set, each with its weight.
    pub sources: Vec<(usize, f64)>,
    /// Part of the face under which its errors are summarized.
    pub group: String,
    /// Description of the point.
    pub description: String,
}

/// Indices of the left and the right pupil; the distance between the two is the eye distance.
pub const PUPILS: [usize; 2] = [0, 1];

/// Returns the indices in [`points()`] of the points of some parts of the face.
pub fn points_of(groups: &[&str]) -> Vec<usize> {
    (0..points().len()).filter(|&k| groups.contains(&points()[k].group.as_str())).collect()
}

/// Returns the distance between the pupils of a shape, at least a tiny positive number.
pub fn pupils_apart(shape: &[Point]) -> f32 {
    distance(shape[PUPILS[0]], shape[PUPILS[1]]).max(f32::MIN_POSITIVE)
}

/// Number of edges of the lips on a line across the mouth.
pub const EDGES: usize = 4;

/// Nodes of the lip edges on three lines across the mouth: upper lip's upper and lower edge, lower lip's upper and lower edge. Lines: the
/// subject's left half, the middle, the right half.
pub const LIP_LINES: [[NodeId; EDGES]; 3] = [
    [NodeId(79), NodeId(81), NodeId(83), NodeId(85)],
    [NodeId(7), NodeId(87), NodeId(40), NodeId(8)],
    [NodeId(80), NodeId(82), NodeId(84), NodeId(86)],
];

/// Returns the indices in [`points()`] of the points of [`LIP_LINES`].
pub fn lip_lines() -> [[usize; EDGES]; LIP_LINES.len()] {
    LIP_LINES.map(|line| line.map(|node| points().iter().position(|p| p.node == Some(node)).unwrap_or_default()))
}

const TABLE: &str = include_str!("../../candide/locator_points.csv");

/// Returns all points of `candide/locator_points.csv`, in its order.
pub fn points() -> &'static [LocatorPoint] {
    static POINTS: LazyLock<Vec<LocatorPoint>> = LazyLock::new(|| TABLE.lines().skip(1).filter_map(point).collect());
    &POINTS
}

/// Returns the nodes that the locator knows, with their positions among those of the wireframe.
pub fn known_nodes(nodes: &[Point2<f64>]) -> Vec<(NodeId, Point2<f64>)> {
    points().iter().filter_map(|point| Some((point.node?, *nodes.get(point.node?.index())?))).collect()
}

/// Parses a row of the table; a test checks that all rows are valid.
fn point(line: &str) -> Option<LocatorPoint> {
    let [_, node, mirror, sources, weights, group, description] = line.splitn(7, ',').collect::<Vec<_>>()[..] else {
        return None;
    };
    let indices = sources.split(' ').map(|s| s.parse().ok());
    let shares = weights.split(' ').map(|s| s.parse().ok());
    Some(LocatorPoint {
        node: if node.is_empty() { None } else { Some(NodeId(node.parse().ok()?)) },
        mirror: mirror.parse().ok()?,
        sources: indices.zip(shares).map(|(i, s)| Some((i?, s?))).collect::<Option<_>>()?,
        group: group.to_owned(),
        description: description.to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::wireframe::Tables;

    #[test]
    fn every_row_reads_and_mirrors_itself_twice() {
        assert_eq!(points().len(), TABLE.lines().count() - 1);
        for (k, point) in points().iter().enumerate() {
            assert_eq!(points()[point.mirror].mirror, k);
            assert!((point.sources.iter().map(|s| s.1).sum::<f64>() - 1.0).abs() < 1e-9, "{}", point.description);
        }
        let nodes: BTreeSet<_> = points().iter().filter_map(|p| p.node).collect();
        assert_eq!(nodes.len(), points().iter().filter(|p| p.node.is_some()).count(), "a node appears once");
    }

    #[test]
    fn the_nodes_are_what_the_tables_say() {
        let tables = Tables::candide3();
        let node = |fp: &str| tables.feature_point_nodes(fp.parse().unwrap()).unwrap()[0];
        let named = |text: &str| points().iter().find(|p| p.description == text).unwrap().node.unwrap();
        for (fp, text) in [
            ("3.7", "left eye: outer corner"),
            ("3.8", "right eye: inner corner"),
            ("8.3", "left mouth corner"),
            ("2.1", "lowest point of the chin"),
            ("4.4", "right brow: highest point"),
            ("9.15", "base of the nose between the nostrils"),
        ] {
            assert_eq!(named(text), node(fp), "{text}");
        }
    }
}
