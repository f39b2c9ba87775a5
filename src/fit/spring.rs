//! Spring deformation of a wireframe [KP, section 2].
//!
//! Every wireframe edge is a spring of stiffness k that resists a *difference of displacement* between its ends, so that at rest the
//! wireframe keeps its shape. A force pulls every driven node to its target, proportional to the distance (gain f). With the displacements
//! u of the live nodes from rest, the equilibrium is the linear system
//!
//! ```text
//! (k L + F) u = F d        L: graph Laplacian of the springs, F: diag(f of the driven nodes, 0 elsewhere), d: target - rest
//! ```
//!
//! It is symmetric and positive definite if every connected part has a driven node, and is solved once, by Cholesky. The gain f may be a
//! matrix, so that a node is driven more strongly in the direction in which its target is more accurate; only then are x and y coupled. KP
//! do not specify how springs act along and across themselves. This membrane is the linear choice: it has one equilibrium for any target
//! and never folds under small forces.

use std::sync::Arc;

use nalgebra::{Matrix2, Point2, Vector2};

use super::skyline::{Layout, Skyline};
use crate::{simd::widest, units::NodeId, wireframe::Wireframe};

/// How strongly a node is driven.
///
/// ```
/// use grimace::{fit::{DrivenNode, Pull, Springs}, units::NodeId, wireframe::Wireframe};
/// use nalgebra::Vector2;
///
/// let wireframe = Wireframe::candide3();
/// let rest = wireframe.frontal();
/// let corner = |pull| DrivenNode { node: NodeId(31), position: rest[31] + Vector2::new(0.1, 0.1), pull };
/// let way = |pull| -> Result<f64, grimace::fit::SpringError> {
///     // The inner corners of the eyes stay where they are.
///     let hold = [23, 56].map(|k| DrivenNode { node: NodeId(k), position: rest[usize::from(k)], pull: Pull::Hard });
///     let moved = Springs::new(&wireframe).deform(&wireframe, &rest, &[hold[0], hold[1], corner(pull)])?;
///     Ok((moved[31] - rest[31]).norm() / 0.1_f64.hypot(0.1))
/// };
/// // The harder the pull, the more of the way is gone.
/// assert!(way(Pull::Force(0.1))? < way(Pull::Force(20.0))?);
/// assert!((way(Pull::Hard)? - 1.0).abs() < 1e-5);
/// # Ok::<(), grimace::fit::SpringError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pull {
    /// By a force of this gain (per unit of distance, in units of the springs' stiffness), > 0.
    Force(f64),
    /// By a force of this gain matrix, symmetric and positive definite: stronger in directions in which the target is more accurate.
    Matrix(Matrix2<f64>),
    /// Exactly to its target.
    Hard,
}

impl Pull {
    fn gain(self) -> Matrix2<f64> {
        match self {
            Self::Force(gain) => Matrix2::identity() * gain,
            Self::Matrix(gain) => gain,
            Self::Hard => Matrix2::identity() * HARD_GAIN,
        }
    }
}

/// A driven node with its target.
///
/// ```
/// use grimace::{fit::{DrivenNode, Pull, Springs}, units::NodeId, wireframe::Wireframe};
///
/// let wireframe = Wireframe::candide3();
/// let rest = wireframe.frontal();
/// let at_rest = DrivenNode { node: NodeId(10), position: rest[10], pull: Pull::Force(20.0) };
/// let moved = Springs::new(&wireframe).deform(&wireframe, &rest, &[at_rest])?;
/// assert!(moved.iter().zip(&rest).all(|(a, b)| (a - b).norm() < 1e-9));
/// # Ok::<(), grimace::fit::SpringError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrivenNode {
    /// The node.
    pub node: NodeId,
    /// Target position, in the unit of the rest positions.
    pub position: Point2<f64>,
    /// Kind and gain of the force.
    pub pull: Pull,
}

/// A desired offset between two nodes, in addition to the springs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Strut {
    /// Start node.
    pub from: NodeId,
    /// End node.
    pub to: NodeId,
    /// Desired position of the end minus that of the start.
    pub offset: Vector2<f64>,
    /// Stiffness over that of a spring, > 0.
    pub stiffness: f64,
}

/// Reason why a deformation has no unique solution.
///
/// ```
/// use grimace::{fit::{SpringError, Springs}, wireframe::Wireframe};
///
/// let wireframe = Wireframe::candide3();
/// let error = Springs::new(&wireframe).deform(&wireframe, &wireframe.frontal(), &[]).unwrap_err();
/// assert_eq!(error, SpringError::NoTarget);
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpringError {
    /// There are no targets.
    #[error("no node drives the deformation")]
    NoTarget,
    /// A target at a node that does not exist or is in no triangle.
    #[error("node {node} is in no triangle; it cannot drive the springs")]
    NotLive {
        /// The node.
        node: NodeId,
    },
    /// A target, a gain or a rest position is not a finite number.
    #[error("the target of node {node} is not a finite position with a positive gain")]
    NotFinite {
        /// The node.
        node: NodeId,
    },
    /// The system could not be factored.
    #[error("the spring system is singular: a position is not finite")]
    Singular,
    /// Positions or a wireframe with another number of nodes than the springs.
    #[error(
        "the {what} has {found} nodes, but the springs have {expected}; give the wireframe of the springs and a position for each node"
    )]
    NodeCount {
        /// The wireframe, or the rest.
        what: &'static str,
        /// Its number of nodes.
        found: usize,
        /// Nodes of the springs.
        expected: usize,
    },
}

/// Gain that replaces an exact position; it leaves less than 1e-6 of the distance.
const HARD_GAIN: f64 = 1e8;

/// Tie of every node to its rest position, relative to the stiffness. It only matters for a part of the wireframe without driven nodes.
const REST_GAIN: f64 = 1e-9;

/// Springs of a wireframe.
///
/// ```
/// use grimace::{fit::{SpringError, Springs}, wireframe::Wireframe};
///
/// let wireframe = Wireframe::candide3();
/// let springs = Springs::new(&wireframe);
/// // Nothing drives the wireframe: there is no equilibrium to speak of.
/// assert_eq!(springs.deform(&wireframe, &wireframe.frontal(), &[]), Err(SpringError::NoTarget));
/// ```
#[derive(Clone, Debug)]
pub struct Springs {
    /// Index of every node among the live ones.
    place: Vec<Option<usize>>,
    live: Vec<NodeId>,
    /// Ends of the springs, as indices among the live nodes.
    edges: Vec<[usize; 2]>,
    /// k L over the live nodes, k = 1 for every spring.
    laplacian: Skyline,
}

impl Springs {
    /// Creates one spring of stiffness 1 for every edge.
    pub fn new(wireframe: &Wireframe) -> Self {
        let live = wireframe.live_nodes().to_vec();
        let mut place = vec![None; wireframe.node_count()];
        live.iter().enumerate().for_each(|(i, n)| place[n.index()] = Some(i));
        let ends = |(a, b): &(NodeId, NodeId)| Some([place[a.index()]?, place[b.index()]?]);
        let edges: Vec<[usize; 2]> = wireframe.edges().iter().filter_map(ends).collect();
        let layout = Arc::new(Layout::new(live.len(), edges.iter().map(|edge| edge.to_vec())));
        let laplacian = laplacian(&layout, &edges);
        Self { place, live, edges, laplacian }
    }

    /// Returns the springs' matrix k L over the live nodes in order, k = 1, in another layout, which must couple the ends of every spring.
    pub(crate) fn laplacian(&self, layout: &Arc<Layout>) -> Skyline {
        laplacian(layout, &self.edges)
    }

    /// Returns the equilibrium of the wireframe at `rest` (all N nodes) under the targets; nodes in no triangle take their leaders' mean.
    ///
    /// A node may have several targets; their forces add up.
    ///
    /// # Errors
    /// [`SpringError`].
    pub fn deform(
        &self,
        wireframe: &Wireframe,
        rest: &[Point2<f64>],
        targets: &[DrivenNode],
    ) -> Result<Vec<Point2<f64>>, SpringError> {
        self.deform_with(wireframe, rest, targets, &[])
    }

    /// Same as [`Self::deform`], with additional struts; struts at nodes in no triangle are skipped.
    pub(super) fn deform_with(
        &self,
        wireframe: &Wireframe,
        rest: &[Point2<f64>],
        targets: &[DrivenNode],
        struts: &[Strut],
    ) -> Result<Vec<Point2<f64>>, SpringError> {
        for (what, found) in [("wireframe", wireframe.node_count()), ("rest", rest.len())] {
            if found != self.place.len() {
                return Err(SpringError::NodeCount { what, found, expected: self.place.len() });
            }
        }
        if targets.is_empty() {
            return Err(SpringError::NoTarget);
        }
        let place = |node: NodeId| self.place.get(node.index()).copied().flatten();
        let struts: Vec<_> = struts.iter().filter_map(|strut| Some((strut, place(strut.from)?, place(strut.to)?))).collect();
        let mut system = if struts.is_empty() {
            self.laplacian.clone()
        } else {
            let coupled = self.edges.iter().copied().chain(struts.iter().map(|(_, i, j)| [*i, *j]));
            self.laplacian(&Arc::new(Layout::new(self.live.len(), coupled.map(|pair| pair.to_vec()))))
        };
        let mut displacement = vec![Vector2::zeros(); self.live.len()];
        for i in 0..self.live.len() {
            system.add_diagonal(i, &(Matrix2::identity() * REST_GAIN));
        }
        for target in targets {
            let node = target.node;
            let i = place(node).ok_or(SpringError::NotLive { node })?;
            let gain = target.pull.gain();
            let force = gain * (target.position - rest[node.index()]);
            let positive = gain[(0, 0)] > 0.0 && gain.determinant() > 0.0 && gain.iter().all(|g| g.is_finite());
            if !(positive && force.x.is_finite() && force.y.is_finite()) {
                return Err(SpringError::NotFinite { node });
            }
            system.add_diagonal(i, &gain);
            displacement[i] += force;
        }
        for (strut, i, j) in struts.into_iter().filter(|(_, i, j)| i != j) {
            let force = (strut.offset - (rest[strut.to.index()] - rest[strut.from.index()])) * strut.stiffness;
            system.add_spring([i, j], strut.stiffness);
            displacement[i] -= force;
            displacement[j] += force;
        }
        let is_definite = widest(
            #[inline(always)]
            || system.factor(),
        );
        if !is_definite {
            return Err(SpringError::Singular);
        }
        system.solve(&mut displacement);
        let mut nodes = rest.to_vec();
        for (node, moved) in self.live.iter().zip(&displacement) {
            nodes[node.index()] += moved;
        }
        for target in targets.iter().filter(|t| t.pull == Pull::Hard) {
            nodes[target.node.index()] = target.position;
        }
        wireframe.place_followers(&mut nodes);
        Ok(nodes)
    }
}

fn laplacian(layout: &Arc<Layout>, edges: &[[usize; 2]]) -> Skyline {
    let mut laplacian = Skyline::new(layout);
    edges.iter().for_each(|edge| laplacian.add_spring(*edge, 1.0));
    laplacian
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use nalgebra::Point3;
    use proptest::prelude::*;

    use super::*;

    /// Nodes 0, 1, 2 in one triangle.
    fn triangle() -> Wireframe {
        let vertices = vec![Point3::new(0.0, 0.0, 0.0), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0)];
        Wireframe::new(vertices, vec![[NodeId(0), NodeId(1), NodeId(2)]], vec![], vec![]).unwrap()
    }

    fn target(node: u16, x: f64, y: f64, pull: Pull) -> DrivenNode {
        DrivenNode { node: NodeId(node), position: Point2::new(x, y), pull }
    }

    #[test]
    fn positions_and_wireframes_of_other_nodes_are_refused() {
        let (w, targets) = (triangle(), [target(0, 0.0, 0.0, Pull::Hard)]);
        let (springs, rest) = (Springs::new(&w), w.frontal());
        let of = |what, found| Err(SpringError::NodeCount { what, found, expected: 3 });
        assert_eq!(springs.deform(&w, &rest[..2], &targets), of("rest", 2));
        assert_eq!(springs.deform(&w, &[], &targets), of("rest", 0));
        assert_eq!(springs.deform(&Wireframe::candide3(), &rest, &targets), of("wireframe", 113));
    }

    #[test]
    fn hard_ends_put_the_free_node_in_the_middle() {
        // Node 0 is fixed, node 1 is moved by (0.6, 0): the free node 2 has equal springs to both and moves by their mean.
        let (w, rest) = (triangle(), triangle().frontal());
        let moved =
            Springs::new(&w).deform(&w, &rest, &[target(0, 0.0, 0.0, Pull::Hard), target(1, 1.6, 0.0, Pull::Hard)]).unwrap();
        assert_relative_eq!(moved[2], Point2::new(0.3, 1.0), epsilon = 1e-6);
        assert_eq!(moved[1], Point2::new(1.6, 0.0));
    }

    #[test]
    fn force_balances_the_springs() {
        // Node 0 hard at rest, node 1 pulled by gain 1 to (2, 0) from (1, 0); node 2 free.
        // u2 = u1 / 2; force on 1: (1 - u1) = 1 (u1 - 0) + 1 (u1 - u2) = 1.5 u1, so u1 = 0.4.
        let (w, rest) = (triangle(), triangle().frontal());
        let targets = [target(0, 0.0, 0.0, Pull::Hard), target(1, 2.0, 0.0, Pull::Force(1.0))];
        let moved = Springs::new(&w).deform(&w, &rest, &targets).unwrap();
        assert_relative_eq!(moved[1].x, 1.4, epsilon = 1e-6);
        assert_relative_eq!(moved[2].x, 0.2, epsilon = 1e-6);
    }

    #[test]
    fn a_matrix_pulls_along_one_direction_only() {
        // Node 1 is pulled towards (2, 1) from (1, 0), but only x is known: y stays nearly where node 0 holds it.
        let (w, rest) = (triangle(), triangle().frontal());
        let known_x = Pull::Matrix(Matrix2::new(1.0, 0.0, 0.0, 1e-9));
        let targets = [target(0, 0.0, 0.0, Pull::Hard), target(1, 2.0, 1.0, known_x)];
        let moved = Springs::new(&w).deform(&w, &rest, &targets).unwrap();
        assert_relative_eq!(moved[1], Point2::new(1.4, 0.0), epsilon = 1e-6);
    }

    #[test]
    fn bad_targets_are_refused() {
        let w = Wireframe::candide3();
        let (springs, rest) = (Springs::new(&w), w.frontal());
        assert_eq!(springs.deform(&w, &rest, &[]), Err(SpringError::NoTarget));
        let dead = springs.deform(&w, &rest, &[target(4, 0.0, 0.0, Pull::Hard)]);
        assert_eq!(dead, Err(SpringError::NotLive { node: NodeId(4) }));
        let nan = springs.deform(&w, &rest, &[target(5, f64::NAN, 0.0, Pull::Hard)]);
        assert_eq!(nan, Err(SpringError::NotFinite { node: NodeId(5) }));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn a_common_shift_moves_the_wireframe_rigidly(dx in -5.0..5.0f64, dy in -5.0..5.0f64, gain in 0.1..100.0f64) {
            let w = Wireframe::candide3();
            let rest = w.frontal();
            let shift = Vector2::new(dx, dy);
            let targets: Vec<_> = [20, 31, 53, 64, 10]
                .map(|n| DrivenNode { node: NodeId(n), position: rest[n as usize] + shift, pull: Pull::Force(gain) })
                .into();
            let moved = Springs::new(&w).deform(&w, &rest, &targets).unwrap();
            for (a, b) in rest.iter().zip(&moved) {
                prop_assert!((b - a - shift).norm() < 1e-6);
            }
        }

        #[test]
        fn small_forces_flip_no_triangle(seed in prop::collection::vec(-0.01..0.01f64, 14)) {
            let w = Wireframe::candide3();
            let rest = w.frontal();
            let targets: Vec<_> = [20usize, 31, 53, 64, 10, 16, 49].iter().enumerate()
                .map(|(i, &n)| DrivenNode {
                    node: NodeId(n as u16),
                    position: rest[n] + Vector2::new(seed[2 * i], seed[2 * i + 1]),
                    pull: Pull::Force(20.0),
                })
                .collect();
            let moved = Springs::new(&w).deform(&w, &rest, &targets).unwrap();
            let area = |p: &[Point2<f64>], t: &[NodeId; 3]| (p[t[1].index()] - p[t[0].index()]).perp(&(p[t[2].index()] - p[t[0].index()]));
            // Slivers of the closed mouth and the lids have almost no area in the frontal view and are skipped.
            for t in w.triangles().iter().filter(|t| area(&rest, t).abs() > 2e-3) {
                prop_assert!(area(&rest, t) * area(&moved, t) > 0.0);
            }
        }
    }
}
