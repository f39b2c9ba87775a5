//! Smooths a motion that would fold the skin until it does not.

use std::sync::LazyLock;

use nalgebra::{Point2, Vector2};

use super::{NODE_COUNT, Warp, mesh::Mesh};
use crate::{fit::mirror_nodes, geometry::Similarity, units::NodeId, wireframe::Wireframe};

/// A skin triangle counts as folded when its area falls below this fraction of its area in the reference, and below half of its area on
/// the photograph.
const LEAST_AREA: f64 = 0.02;
/// Height over its longest side, in eye distances, below which a triangle is too thin for a fold to show: a tenth of a pixel.
const LEAST_HEIGHT: f64 = 0.001;
/// Largest number of smoothing rounds for a folded frame.
const UNFOLD_ROUNDS: usize = 120;
/// Largest number of further rounds that weaken the whole motion, and the factor of each.
const WEAKEN_ROUNDS: usize = 30;
const WEAKEN: f64 = 0.75;
/// Fraction of the way to its neighbours' mean motion that a node at a fold moves per round.
const UNFOLD_STEP: f64 = 0.1;

impl Warp {
    /// Vertices for the wanted nodes, and the number of rounds until no skin was folded; `wanted` is updated to the possible positions.
    pub(super) fn unfolded(&self, wanted: &mut [Point2<f64>], background: &Similarity) -> (Vec<Point2<f64>>, usize) {
        let mut rounds = 0;
        let mut vertices = self.vertices_of(wanted, background);
        while rounds < UNFOLD_ROUNDS + WEAKEN_ROUNDS {
            let folded: Vec<usize> = self.folded(&vertices).collect();
            if folded.is_empty() {
                break;
            }
            if rounds < UNFOLD_ROUNDS {
                self.smooth(wanted, &folded, background);
            } else {
                // Smoothing does not suffice: the whole motion is weakened until the skin can follow.
                for (node, start) in wanted.iter_mut().zip(&self.nodes) {
                    let start = background.apply(start);
                    *node = start + (*node - start) * WEAKEN;
                }
            }
            self.separate(wanted);
            vertices = self.vertices_of(wanted, background);
            rounds += 1;
        }
        (vertices, rounds)
    }

    /// Indices of skin triangles that are turned over or nearly so.
    pub(super) fn folded<'a>(&'a self, vertices: &'a [Point2<f64>]) -> impl Iterator<Item = usize> + 'a {
        let area = |points: &[Point2<f64>], t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| points[v as usize]);
            (b - a).perp(&(c - a))
        };
        let skin = self.mesh.skin.iter().enumerate().filter(|(k, _)| !self.is_flat[*k]);
        skin.filter_map(move |(k, t)| {
            let least = least_area(area(&self.mesh.vertices, t), area(&self.source, t));
            (area(vertices, t) < least).then_some(k)
        })
    }

    /// Pulls the nodes with large weights in folded triangles towards the mean motion of their neighbours.
    fn smooth(&self, wanted: &mut [Point2<f64>], folded: &[usize], around: &Similarity) {
        let mut at_fold = vec![false; self.mesh.drivers.len()];
        for &k in folded {
            for v in self.mesh.skin[k] {
                for (flag, w) in at_fold.iter_mut().zip(self.weights.of(v as usize)) {
                    *flag |= w.abs() > 0.2;
                }
            }
        }
        // Both sides of the face are treated alike, so that a smile does not become crooked.
        for d in 0..at_fold.len() {
            at_fold[self.partners[d]] |= at_fold[d];
        }
        let node = |d: usize| self.mesh.drivers[d].0.index();
        let offsets: Vec<Vector2<f64>> =
            (0..at_fold.len()).map(|d| wanted[node(d)] - around.apply(&self.nodes[node(d)])).collect();
        for d in (0..at_fold.len()).filter(|&d| at_fold[d]) {
            let near = &self.neighbours[d];
            let mean = near.iter().map(|&o| offsets[o]).sum::<Vector2<f64>>() / near.len().max(1) as f64;
            wanted[node(d)] += (mean - offsets[d]) * UNFOLD_STEP;
        }
    }
}

/// Whether a triangle is so thin that a fold of it cannot be seen: vertices of the outermost ring can lie in one line, and rounding gives the
/// area of their triangle either sign.
pub fn is_sliver([a, b, c]: [Point2<f64>; 3], eye_distance: f64) -> bool {
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    (b - a).perp(&(c - a)).abs() < LEAST_HEIGHT * eye_distance * longest
}

/// Least area of a triangle from its areas in the reference and on the photograph; a smaller one is folded.
pub fn least_area(in_reference: f64, on_photograph: f64) -> f64 {
    (LEAST_AREA * in_reference).min(0.5 * on_photograph)
}

/// Index of the driving node on the other side of the face, for each driving node; its own index on the midline.
pub fn partners(mesh: &Mesh) -> Vec<usize> {
    static MIRROR: LazyLock<Vec<usize>> =
        LazyLock::new(|| mirror_nodes(&Wireframe::candide3()).unwrap_or_else(|_| (0..NODE_COUNT).collect()));
    let place = |node: usize| mesh.drivers.iter().position(|(n, _)| n.index() == node);
    (0..mesh.drivers.len()).map(|d| place(MIRROR[mesh.drivers[d].0.index()]).unwrap_or(d)).collect()
}

/// Indices of the six nearest driving nodes of each, in the reference.
pub fn neighbours(mesh: &Mesh, reference: &[Point2<f64>]) -> Vec<Vec<usize>> {
    const COUNT: usize = 6;
    let at = |node: NodeId| reference[node.index()];
    (0..mesh.drivers.len())
        .map(|d| {
            let mut others: Vec<usize> = (0..mesh.drivers.len()).filter(|&o| o != d).collect();
            let distance = |o: usize| (at(mesh.drivers[o].0) - at(mesh.drivers[d].0)).norm();
            others.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)));
            others.truncate(COUNT);
            others
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_in_one_line_are_a_sliver_and_the_smallest_triangles_of_a_mesh_are_not() {
        let triangle = |x: f64, y: f64| [Point2::new(0.0, 0.0), Point2::new(10.0, 0.0), Point2::new(x, y)];
        for height in [0.0, 1e-12, -1e-12, 0.09] {
            assert!(is_sliver(triangle(4.0, height), 100.0), "{height}");
        }
        // Where it is long and thin, the height counts, not the area.
        assert!(is_sliver([Point2::new(0.0, 0.0), Point2::new(1000.0, 0.0), Point2::new(500.0, 0.09)], 100.0));
        assert!(!is_sliver(triangle(4.0, 0.11), 100.0) && !is_sliver(triangle(4.0, -3.0), 100.0));
    }
}
