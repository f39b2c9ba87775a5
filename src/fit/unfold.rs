//! Turns back triangles that a fit turned over.
//!
//! Marks that are a few pixels off can turn a triangle between them. Correct marks can turn a triangle with an unmarked node: a lid's
//! margin and its crease are only 3 px apart. First, unmarked nodes move until their triangles have the orientation of the frontal view; no
//! mark moves. Each triangle that is still turned then gets struts along its sides, in addition to the springs. They hold its own shape
//! with the turned axis made small instead (singular values signed, then bounded). The springs are solved again, newly turned triangles are
//! added, and the struts of a turned triangle get stiffer in each round. Marks give way only by their own force: soft ones first, hard ones
//! never.

use nalgebra::{Matrix2, Point2, Vector2};

use super::{DrivenNode, SpringError, Springs, spring::Strut};
use crate::{units::NodeId, wireframe::Wireframe};

/// Smallest area of a triangle in the frontal view, model units squared, that is turned back. Slivers at lids and closed lips may turn over
/// without harm.
const LEAST_AREA: f64 = 5e-4;
/// Bounds of a held triangle's stretch relative to its shape at rest.
const STRETCH: (f64, f64) = (0.15, 4.0);
/// Share of its area at rest below which a triangle counts as turned.
const LEAST_SHARE: f64 = 0.01;
/// Stiffness of the first struts, over that of a spring.
const STIFFNESS: f64 = 2.0;
/// Factor by which a triangle's stiffness grows in each round in which it is still turned.
const GROWTH: f64 = 1.5;
/// Largest height, over the eye distance, at which a triangle between three marks may be turned. Beside the nose one in five real faces has
/// a turned triangle (`(111, 33, 26)` and its mirror image, by points set by hand), and marks of different origin make slivers.
const SLIVER: f64 = 0.06;
/// Largest number of rounds.
const ROUNDS: usize = 40;
/// Share of its area at rest to which unmarked nodes enlarge a triangle, and the number of sweeps.
const GIVEN_SHARE: f64 = 0.08;
const SWEEPS: usize = 200;

/// Positions of all nodes, and number of triangles that are still turned.
pub(super) struct Unfolded {
    pub nodes: Vec<Point2<f64>>,
    pub turned: usize,
}

/// Turns triangles back. `nodes` are the springs' equilibrium from `rest` under `targets`, y down. Returns `None` when no triangle is
/// turned.
pub(super) fn unfold(
    springs: &Springs,
    wireframe: &Wireframe,
    rest: &[Point2<f64>],
    targets: &[DrivenNode],
    nodes: &[Point2<f64>],
    frontal: &Frontal,
    eye_distance: f64,
) -> Result<Option<Unfolded>, SpringError> {
    let mut free = vec![true; nodes.len()];
    targets.iter().for_each(|target| free[target.node.index()] = false);
    let wrong = |nodes: &[Point2<f64>]| -> Vec<usize> {
        let as_marked = |t: &usize| {
            let triangle = wireframe.triangles()[*t];
            triangle.iter().all(|n| !free[n.index()]) && height(nodes, triangle) < SLIVER * eye_distance
        };
        frontal.turned(wireframe, nodes).into_iter().filter(|t| !as_marked(t)).collect()
    };
    let mut turned = wrong(nodes);
    if turned.is_empty() {
        return Ok(None);
    }
    let mut nodes = nodes.to_vec();
    frontal.settle(wireframe, &free, &mut nodes);
    turned = wrong(&nodes);
    let mut best = (turned.len(), nodes.clone());
    // Stiffness of the struts of every triangle; 0 for one that was never turned.
    let mut stiffness = vec![0.0; wireframe.triangles().len()];
    for _ in 0..ROUNDS {
        if turned.is_empty() {
            break;
        }
        turned.iter().for_each(|&t| stiffness[t] = (stiffness[t] * GROWTH).max(STIFFNESS));
        let mut struts = Vec::new();
        for (t, triangle) in wireframe.triangles().iter().enumerate().filter(|(t, _)| stiffness[*t] > 0.0) {
            let shape = frontal.ideal(rest, t, *triangle);
            let now = [1, 2].map(|k| nodes[triangle[k].index()] - nodes[triangle[0].index()]);
            let Some([u, v]) = held_shape(shape, now) else { continue };
            let stiffness = stiffness[t];
            struts.push(Strut { from: triangle[0], to: triangle[1], offset: u, stiffness });
            struts.push(Strut { from: triangle[0], to: triangle[2], offset: v, stiffness });
            struts.push(Strut { from: triangle[1], to: triangle[2], offset: v - u, stiffness });
        }
        nodes = springs.deform_with(wireframe, rest, targets, &struts)?;
        frontal.settle(wireframe, &free, &mut nodes);
        turned = wrong(&nodes);
        if turned.len() < best.0 {
            best = (turned.len(), nodes.clone());
        }
    }
    let (turned, mut nodes) = best;
    wireframe.place_followers(&mut nodes);
    Ok(Some(Unfolded { nodes, turned }))
}

/// Returns the sides of an unturned triangle near `now`: its deformation from `shape` with bounded stretches. `None` for a shape without
/// area.
fn held_shape(shape: [Vector2<f64>; 2], now: [Vector2<f64>; 2]) -> Option<[Vector2<f64>; 2]> {
    let from = Matrix2::from_columns(&shape);
    let deformation = Matrix2::from_columns(&now) * from.try_inverse()?;
    let svd = deformation.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    // The first singular value is the larger one; in a turned triangle the smaller one is negative.
    let sign = if (u.determinant() * v_t.determinant()) < 0.0 { -1.0 } else { 1.0 };
    let (large, small) = (svd.singular_values[0], svd.singular_values[1] * sign);
    let stretches = Vector2::new(large.clamp(STRETCH.0, STRETCH.1), small.clamp(STRETCH.0, STRETCH.1));
    let flipped = Matrix2::from_diagonal(&Vector2::new(1.0, sign));
    let held = u * Matrix2::from_diagonal(&stretches) * flipped * v_t * from;
    held.iter().all(|x| x.is_finite()).then(|| [held.column(0).into_owned(), held.column(1).into_owned()])
}

/// The frontal wireframe and its placement in the image.
pub(super) struct Frontal {
    /// Signed areas of the triangles in face space.
    areas: Vec<f64>,
    /// Positions in the image, y down.
    placed: Vec<Point2<f64>>,
}

impl Frontal {
    pub(super) fn new(wireframe: &Wireframe, frontal: &[Point2<f64>], placed: Vec<Point2<f64>>) -> Self {
        Self { areas: wireframe.triangles().iter().map(|t| area(frontal, *t)).collect(), placed }
    }

    /// Returns the indices of the triangles whose orientation differs from the frontal view, without slivers.
    pub(super) fn turned(&self, wireframe: &Wireframe, nodes: &[Point2<f64>]) -> Vec<usize> {
        let is_turned = |(t, triangle): &(usize, &[NodeId; 3])| {
            // y is down in the image, so an unturned triangle changes its sign.
            self.areas[*t].abs() > LEAST_AREA
                && -area(nodes, **triangle) * self.areas[*t].signum() < LEAST_SHARE * area(&self.placed, **triangle).abs()
        };
        wireframe.triangles().iter().enumerate().filter(is_turned).map(|(t, _)| t).collect()
    }

    /// Moves free nodes until the triangles around them are unturned, each as little as its triangle needs (projections onto the
    /// constraints one by one, as in Gauss-Seidel). Triangles without free nodes stay as they are.
    fn settle(&self, wireframe: &Wireframe, free: &[bool], nodes: &mut [Point2<f64>]) {
        for _ in 0..SWEEPS {
            let turned = self.turned(wireframe, nodes);
            let mut moved = false;
            for t in turned {
                let triangle = wireframe.triangles()[t];
                let upright = -self.areas[t].signum();
                let missing = GIVEN_SHARE * area(&self.placed, triangle).abs() - upright * area(nodes, triangle);
                // The area grows fastest along the normal of the opposite side.
                let slopes: [Vector2<f64>; 3] = std::array::from_fn(|k| {
                    let side = nodes[triangle[(k + 2) % 3].index()] - nodes[triangle[(k + 1) % 3].index()];
                    if free[triangle[k].index()] { Vector2::new(-side.y, side.x) * (upright / 2.0) } else { Vector2::zeros() }
                });
                let steepness: f64 = slopes.iter().map(Vector2::norm_squared).sum();
                if missing > 0.0 && steepness > 1e-9 {
                    for (node, slope) in triangle.iter().zip(slopes) {
                        nodes[node.index()] += slope * (missing / steepness);
                    }
                    moved = true;
                }
            }
            if !moved {
                return;
            }
        }
    }

    /// Returns two sides of a triangle's ideal shape: that at rest, or that of the frontal wireframe if it is already turned at rest.
    fn ideal(&self, rest: &[Point2<f64>], t: usize, triangle: [NodeId; 3]) -> [Vector2<f64>; 2] {
        let upright = -area(rest, triangle) * self.areas[t].signum() > STRETCH.0 * area(&self.placed, triangle).abs();
        let points = if upright { rest } else { &self.placed };
        [1, 2].map(|k| points[triangle[k].index()] - points[triangle[0].index()])
    }
}

/// Returns the smallest height of a triangle.
fn height(points: &[Point2<f64>], triangle: [NodeId; 3]) -> f64 {
    let side = |k: usize| (points[triangle[(k + 1) % 3].index()] - points[triangle[k].index()]).norm();
    2.0 * area(points, triangle).abs() / side(0).max(side(1)).max(side(2)).max(1e-12)
}

fn area(points: &[Point2<f64>], [a, b, c]: [NodeId; 3]) -> f64 {
    (points[b.index()] - points[a.index()]).perp(&(points[c.index()] - points[a.index()])) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Candide-3 with 110 px between the eyes, y down.
    fn placed(wireframe: &Wireframe) -> Vec<Point2<f64>> {
        let scale = 110.0 / 0.613;
        wireframe.vertices().iter().map(|v| Point2::new(200.0 + v.x * scale, 180.0 - v.y * scale)).collect()
    }

    #[test]
    fn a_node_without_a_mark_gives_way_and_the_marks_do_not() {
        let wireframe = Wireframe::candide3();
        let placed = placed(&wireframe);
        let frontal = Frontal::new(&wireframe, &wireframe.frontal(), placed.clone());
        assert!(frontal.turned(&wireframe, &placed).is_empty());
        // The margin of the left lid, which is marked, moves up to 5 px above its crease (95), which is not marked.
        let mut nodes = placed.clone();
        nodes[97].y -= 5.0;
        nodes[21].y -= 2.0;
        assert!(!frontal.turned(&wireframe, &nodes).is_empty());
        let marked = [20, 21, 23, 97, 105, 15, 16, 17];
        let free: Vec<bool> = (0..nodes.len()).map(|n| !marked.contains(&n)).collect();
        let before = nodes.clone();
        frontal.settle(&wireframe, &free, &mut nodes);
        assert!(frontal.turned(&wireframe, &nodes).is_empty());
        assert!(marked.iter().all(|&n| nodes[n] == before[n]));
        let farthest = nodes.iter().zip(&before).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!((1.0..8.0).contains(&farthest), "{farthest}");
    }
}
