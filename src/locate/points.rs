//! The points that the locator knows: which nodes they are, which is which in a mirror, and of which hand-set points they are made.

use std::sync::LazyLock;

use crate::units::NodeId;

/// One point.
#[derive(Clone, Debug, PartialEq)]
pub struct LocatorPoint {
    /// The node that it is; none for a point that only helps.
    pub node: Option<NodeId>,
    /// Which point it is in a mirror.
    pub mirror: usize,
    /// Indices of the 189 points of the Face Research Lab London Set, with the share of each.
    pub sources: Vec<(usize, f64)>,
    /// Part of the face that errors are summed up for.
    pub group: String,
    /// What it is.
    pub description: String,
}

/// Place of the left and the right pupil among the points; the distance between the two is the eye distance.
pub const PUPILS: [usize; 2] = [0, 1];

const TABLE: &str = include_str!("../../candide/locator_points.csv");

/// All points of `candide/locator_points.csv`, in its order.
pub fn points() -> &'static [LocatorPoint] {
    static POINTS: LazyLock<Vec<LocatorPoint>> = LazyLock::new(|| TABLE.lines().skip(1).filter_map(point).collect());
    &POINTS
}

/// A row of the table; rows that do not read are caught by the tests.
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
        assert_eq!(nodes.len(), points().iter().filter(|p| p.node.is_some()).count(), "a node stands once");
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
