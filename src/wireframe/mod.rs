//! The Candide wireframe: nodes, triangles, springs, motion units, and the tables that relate its nodes to MPEG-4.

mod expression;
mod face;
mod fapu;
mod marks;
mod tables;
mod wfm;

use std::{collections::BTreeSet, sync::LazyLock};

use nalgebra::{Point2, Point3, Vector3};

use crate::units::NodeId;

pub(crate) use expression::LIP_TWINS;
pub use expression::{Emotion, ExpressionUnit, expressions, find_unit, keep_lips_apart, settle_offsets};
pub use face::Face;
pub(crate) use fapu::LID_LIMIT;
pub use fapu::{Axis, Fapu, FapuDefinition, Fapus, FapusError, LidUnits};
pub use marks::{MarkableNode, SuggestedMark, markable_nodes, suggested_marks};
pub(crate) use marks::{embedded_rows, mark_deviation};
pub use tables::{FeaturePointRow, LandmarkConfidence, LandmarkRow, Region, Tables, parse_node_or_feature_point};
pub use wfm::{WfmError, WfmErrorKind, read_wfm, write_wfm};

/// Nodes along the upper and lower lid, from the outer to the inner corner, for the subject's left and right eye. Both lids of an
/// eye start and end at its corners.
pub const LID_MARGINS: [[[u16; 5]; 2]; 2] =
    [[[20, 97, 21, 105, 23], [20, 99, 22, 107, 23]], [[53, 98, 54, 106, 56], [53, 100, 55, 108, 56]]];

/// Kind of a wireframe's motion unit.
///
/// ```
/// use grimace::wireframe::{UnitKind, Wireframe};
///
/// let wireframe = Wireframe::candide3();
/// let faps = wireframe.action_units().iter().filter(|unit| matches!(unit.kind, UnitKind::Fap { .. })).count();
/// assert_eq!((faps, wireframe.action_units().len()), (54, 65));
/// assert!(wireframe.shape_units().iter().all(|unit| unit.kind == UnitKind::Shape));
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum UnitKind {
    /// A Candide action unit vector, with its number in the list of Rydfalk (AUV).
    Action {
        /// AUV number.
        number: u16,
    },
    /// An MPEG-4 FAP: displacement per FAPU length.
    Fap {
        /// FAP number, 3 to 68.
        number: u16,
        /// The FAPU, if the file names it.
        fapu: Option<Fapu>,
    },
    /// A shape unit: a way in which faces differ from each other.
    Shape,
    /// An animation unit whose name indicates none of these kinds.
    Other,
}

/// A set of node offsets that are applied together, multiplied by a parameter.
///
/// ```
/// use grimace::{units::NodeId, wireframe::{Face, MotionUnit, UnitKind, Wireframe}};
/// use nalgebra::Vector3;
///
/// let Face { wireframe, .. } = Face::candide3();
/// let chin_down = MotionUnit { name: "chin".to_owned(), kind: UnitKind::Other, offsets: vec![(NodeId(10), -Vector3::y())] };
/// let own = Wireframe::new(wireframe.vertices().to_vec(), wireframe.triangles().to_vec(), vec![chin_down], vec![])?;
/// assert_eq!(own.action_units()[0].name, "chin");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct MotionUnit {
    /// Name in the file.
    pub name: String,
    /// Kind of the unit.
    pub kind: UnitKind,
    /// Offsets at parameter value 1, in model units of face space. A node may be listed twice; its offsets add up.
    pub offsets: Vec<(NodeId, Vector3<f64>)>,
}

/// A node in no triangle, and the live nodes whose mean position it takes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Follower {
    /// The node that no triangle uses.
    pub node: NodeId,
    /// The nearest live nodes in the neutral wireframe (several if equally near).
    pub leaders: Vec<NodeId>,
}

/// A wireframe: the neutral geometry in face space and its topology.
///
/// ```
/// use grimace::{units::NodeId, wireframe::Wireframe};
/// use nalgebra::Point3;
///
/// // A triangle, and a fourth node that follows the nearest of its corners.
/// let vertices = vec![Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0), Point3::new(2.0, 0.0, 0.0)];
/// let wireframe = Wireframe::new(vertices, vec![[NodeId(0), NodeId(1), NodeId(2)]], vec![], vec![])?;
/// assert_eq!((wireframe.edges().len(), wireframe.live_nodes().len()), (3, 3));
/// assert_eq!(wireframe.followers()[0].leaders, [NodeId(1)]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Wireframe {
    vertices: Vec<Point3<f64>>,
    triangles: Vec<[NodeId; 3]>,
    edges: Vec<(NodeId, NodeId)>,
    live: Vec<NodeId>,
    followers: Vec<Follower>,
    action_units: Vec<MotionUnit>,
    shape_units: Vec<MotionUnit>,
}

/// Error for vertices and triangles that do not form a wireframe.
///
/// ```
/// use grimace::{units::NodeId, wireframe::Wireframe};
/// use nalgebra::Point3;
///
/// let error = Wireframe::new(vec![Point3::origin()], vec![[NodeId(0), NodeId(0), NodeId(7)]], vec![], vec![]).unwrap_err();
/// assert_eq!(error.to_string(), "triangle 0 refers to node 7, but there are 1 nodes (0 to 0)");
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WireframeError {
    /// There are no triangles and therefore no springs.
    #[error("the wireframe has no triangles")]
    NoTriangles,
    /// More nodes than a [`NodeId`] can number.
    #[error("the wireframe has {found} nodes; at most 65535 are supported")]
    TooManyNodes {
        /// Number of nodes given.
        found: usize,
    },
    /// An index that exceeds the number of vertices.
    #[error("{place} refers to node {node}, but there are {count} nodes (0 to {})", count.saturating_sub(1))]
    NoSuchNode {
        /// The triangle or unit that refers to it.
        place: String,
        /// The index.
        node: NodeId,
        /// Number of nodes.
        count: usize,
    },
    /// A coordinate that is NaN or infinite.
    #[error("node {node} has a coordinate that is not a finite number")]
    NotFinite {
        /// The node.
        node: NodeId,
    },
    /// An offset of a unit that is NaN or infinite.
    #[error("unit `{unit}` moves node {node} by an offset that is not a finite number")]
    OffsetNotFinite {
        /// Name of the unit.
        unit: String,
        /// The node.
        node: NodeId,
    },
}

impl Wireframe {
    /// Creates a wireframe from its parts; edges, live nodes and followers are derived.
    ///
    /// # Errors
    /// [`WireframeError`] when an index is out of range, a coordinate is not finite, or there are no triangles.
    pub fn new(
        vertices: Vec<Point3<f64>>,
        triangles: Vec<[NodeId; 3]>,
        action_units: Vec<MotionUnit>,
        shape_units: Vec<MotionUnit>,
    ) -> Result<Self, WireframeError> {
        let count = vertices.len();
        if count > usize::from(u16::MAX) {
            return Err(WireframeError::TooManyNodes { found: count });
        }
        if triangles.is_empty() {
            return Err(WireframeError::NoTriangles);
        }
        if let Some(k) = vertices.iter().position(|v| !v.coords.iter().all(|c| c.is_finite())) {
            return Err(WireframeError::NotFinite { node: NodeId(k as u16) });
        }
        for (index, triangle) in triangles.iter().enumerate() {
            if let Some(&node) = triangle.iter().find(|n| n.index() >= count) {
                return Err(WireframeError::NoSuchNode { place: format!("triangle {index}"), node, count });
            }
        }
        for unit in action_units.iter().chain(&shape_units) {
            if let Some(&(node, _)) = unit.offsets.iter().find(|(n, _)| n.index() >= count) {
                return Err(WireframeError::NoSuchNode { place: format!("unit `{}`", unit.name), node, count });
            }
            if let Some(&(node, _)) = unit.offsets.iter().find(|(_, offset)| !offset.iter().all(|c| c.is_finite())) {
                return Err(WireframeError::OffsetNotFinite { unit: unit.name.clone(), node });
            }
        }
        let mut edges = BTreeSet::new();
        let mut live = BTreeSet::new();
        for &[a, b, c] in &triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                edges.insert((from.min(to), from.max(to)));
            }
            live.extend([a, b, c]);
        }
        let live: Vec<NodeId> = live.into_iter().collect();
        let followers = followers(&vertices, &live);
        Ok(Self {
            vertices,
            triangles,
            edges: edges.into_iter().filter(|(a, b)| a != b).collect(),
            live,
            followers,
            action_units,
            shape_units,
        })
    }

    /// Returns Candide-3 v3.1.6, from the tables in `candide/` (J. Ahlberg, LiTH-ISY-R-2326).
    ///
    /// The tables are parsed once per process.
    pub fn candide3() -> Self {
        static CANDIDE: LazyLock<Wireframe> = LazyLock::new(tables::candide3);
        CANDIDE.clone()
    }

    /// Neutral positions in face space, model units.
    pub fn vertices(&self) -> &[Point3<f64>] {
        &self.vertices
    }

    /// Number of nodes N, live or not.
    pub fn node_count(&self) -> usize {
        self.vertices.len()
    }

    /// Triangles as node triples; counter-clockwise seen from outside if the source has this order.
    pub fn triangles(&self) -> &[[NodeId; 3]] {
        &self.triangles
    }

    /// The springs: every triangle edge once, `(smaller, larger)`, sorted.
    pub fn edges(&self) -> &[(NodeId, NodeId)] {
        &self.edges
    }

    /// Nodes in at least one triangle, ascending (104 of Candide-3's 113).
    pub fn live_nodes(&self) -> &[NodeId] {
        &self.live
    }

    /// Nodes in no triangle, with the live nodes that they follow.
    #[doc(hidden)]
    pub fn followers(&self) -> &[Follower] {
        &self.followers
    }

    /// Animation units in file order: action unit vectors and FAPs.
    pub fn action_units(&self) -> &[MotionUnit] {
        &self.action_units
    }

    /// Shape units in file order.
    pub fn shape_units(&self) -> &[MotionUnit] {
        &self.shape_units
    }

    /// Frontal view of the neutral wireframe in face space (x to the subject's left, y up), model units.
    pub fn frontal(&self) -> Vec<Point2<f64>> {
        self.vertices.iter().map(nalgebra::OPoint::xy).collect()
    }

    /// Moves every follower to the mean position of its leaders. A follower that `nodes` lack, or that lacks a leader there, is
    /// left out.
    pub fn place_followers(&self, nodes: &mut [Point2<f64>]) {
        for Follower { node, leaders } in &self.followers {
            let sum: Option<nalgebra::Vector2<f64>> = leaders.iter().map(|n| Some(nodes.get(n.index())?.coords)).sum();
            if let (Some(place), Some(sum)) = (nodes.get_mut(node.index()), sum) {
                *place = Point2::from(sum / leaders.len() as f64);
            }
        }
    }
}

/// Distance in model units below which two nodes count as equally near.
const SAME_DISTANCE: f64 = 1e-9;

fn followers(vertices: &[Point3<f64>], live: &[NodeId]) -> Vec<Follower> {
    let mut is_live = vec![false; vertices.len()];
    live.iter().for_each(|n| is_live[n.index()] = true);
    let dead = (0..vertices.len()).filter(|&k| !is_live[k]);
    dead.map(|k| {
        let distance = |n: &NodeId| (vertices[n.index()] - vertices[k]).norm();
        let nearest = live.iter().map(distance).fold(f64::INFINITY, f64::min);
        let leaders = live.iter().copied().filter(|n| distance(n) <= nearest + SAME_DISTANCE).collect();
        Follower { node: NodeId(k as u16), leaders }
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn candide3_has_the_published_counts() {
        let w = Wireframe::candide3();
        assert_eq!((w.node_count(), w.triangles().len()), (113, 184));
        assert_eq!((w.action_units().len(), w.shape_units().len()), (65, 14));
        assert_eq!(w.live_nodes().len(), 104);
        // 264 interior and 24 boundary edges (report LiTH-ISY-R-2326).
        assert_eq!(w.edges().len(), 288);
    }

    #[test]
    fn followers_without_a_place_or_leader_stay() {
        let w = Wireframe::candide3();
        let mut nodes: Vec<Point2<f64>> = w.frontal();
        w.place_followers(&mut nodes);
        // Node 4 follows nodes 77 and 78, which are not there; node 35 follows node 2.
        let mut cut: Vec<Point2<f64>> = w.frontal()[..36].to_vec();
        cut[4] = Point2::new(9.0, 9.0);
        w.place_followers(&mut cut);
        assert_eq!((cut[4], cut[35]), (Point2::new(9.0, 9.0), nodes[35]));
        w.place_followers(&mut []);
    }

    #[test]
    fn a_unit_that_moves_a_node_by_no_number_is_refused() {
        let w = Wireframe::candide3();
        let offsets = vec![(NodeId(5), nalgebra::Vector3::new(0.0, f64::NAN, 0.0))];
        let unit = MotionUnit { name: "jaw".to_owned(), kind: UnitKind::Action { number: 3 }, offsets };
        let error = Wireframe::new(w.vertices().to_vec(), w.triangles().to_vec(), vec![], vec![unit]).unwrap_err();
        assert_eq!(error, WireframeError::OffsetNotFinite { unit: "jaw".to_owned(), node: NodeId(5) });
    }

    #[test]
    fn the_nine_nodes_in_no_triangle_follow_their_twins() {
        let w = Wireframe::candide3();
        let ids = |list: &[u16]| list.iter().map(|&n| NodeId(n)).collect::<Vec<_>>();
        let expected: [(u16, &[u16]); 9] = [
            (4, &[77, 78]),
            (35, &[2]),
            (36, &[3]),
            (37, &[77, 78]),
            (38, &[5]),
            (39, &[6]),
            (41, &[8]),
            (42, &[9]),
            (43, &[10]),
        ];
        let expected: Vec<_> = expected.iter().map(|&(n, l)| Follower { node: NodeId(n), leaders: ids(l) }).collect();
        assert_eq!(w.followers(), expected);
    }

    #[test]
    fn indices_out_of_range_are_named() {
        let vertices = vec![Point3::origin(); 3];
        let error = Wireframe::new(vertices, vec![[NodeId(0), NodeId(1), NodeId(7)]], vec![], vec![]).unwrap_err();
        assert_eq!(error.to_string(), "triangle 0 refers to node 7, but there are 3 nodes (0 to 2)");
    }
}
