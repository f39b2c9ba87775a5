//! Motion of the neutral frame's skin with the nodes: a smooth surface through them, cut open at lids and lips.
//!
//! A quadratic on every triangle (Bézier form) interpolates displacements from the nodes to the skin. Its corner values are the nodes'
//! displacements. The value of an edge's middle control point is the mean of the edge's ends plus the bend between them estimated from
//! their gradients. A gradient is the least-squares plane over a node's ring. All of it is linear in the nodes, so it is computed once, on
//! the neutral frame. Linear triangles have errors of up to a pixel in their middles when a face bends.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix2, Point2, Vector2};

/// Share of the estimated bend that is applied.
const BEND: f64 = 0.85;

/// Returns twice the signed area of a triangle.
pub fn doubled_area([a, b, c]: [Point2<f64>; 3]) -> f64 {
    (b - a).perp(&(c - a))
}

/// Control values on one triangle as linear functions of nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Quadratic {
    /// Nodes that the control values depend on, corners first, and their weights in the six control values: 0 to 2 are the corners; 3 to 5
    /// the edges from corner 0 to 1, 1 to 2, 2 to 0.
    weights: Vec<(usize, [f64; 6])>,
}

/// For each of the six control values, the weights of four nodes.
pub type Shares = [[f64; 4]; 6];

impl Quadratic {
    fn new(corners: [usize; 3], positions: &[Point2<f64>], gradients: &[NodeGradient]) -> Self {
        let mut out = Self { weights: corners.iter().map(|node| (*node, [0.0; 6])).collect() };
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let edge = positions[b] - positions[a];
            out.add(k, a, 1.0);
            out.add(3 + k, a, 0.5);
            out.add(3 + k, b, 0.5);
            // Both gradients or none: one alone would bend a straight edge.
            if gradients[a].is_empty() || gradients[b].is_empty() {
                continue;
            }
            for (node, sign) in [(a, 1.0), (b, -1.0)] {
                for (other, gradient) in &gradients[node] {
                    out.add(3 + k, *other, sign * BEND * gradient.dot(&edge) / 4.0);
                }
            }
        }
        out
    }

    fn add(&mut self, value: usize, node: usize, weight: f64) {
        let place = self.weights.iter().position(|(n, _)| *n == node).unwrap_or_else(|| {
            self.weights.push((node, [0.0; 6]));
            self.weights.len() - 1
        });
        self.weights[place].1[value] += weight;
    }

    /// Returns the nodes that the control values depend on, each with its weight in all six.
    pub fn nodes(&self) -> impl Iterator<Item = (usize, &[f64; 6])> {
        self.weights.iter().map(|(node, weights)| (*node, weights))
    }

    /// Returns the weights of the nodes in groups of four, padded with 0.
    pub fn shares(&self) -> Vec<Shares> {
        let of = |four: &[(usize, [f64; 6])]| {
            std::array::from_fn(|control| std::array::from_fn(|k| four.get(k).map_or(0.0, |(_, weights)| weights[control])))
        };
        self.weights.chunks(4).map(of).collect()
    }

    /// Returns the six control values of a function on the nodes.
    pub fn values(&self, function: impl Fn(usize) -> Vector2<f64>) -> [Vector2<f64>; 6] {
        let mut out = [Vector2::zeros(); 6];
        for (node, weights) in self.nodes() {
            let value = function(node);
            out.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * *weight);
        }
        out
    }

    /// Returns the weights of the control values at barycentric coordinates.
    pub fn weights([u, v, w]: [f64; 3]) -> [f32; 6] {
        [u * u, v * v, w * w, 2.0 * u * v, 2.0 * v * w, 2.0 * w * u].map(|weight| weight as f32)
    }
}

/// Weights of nodes in the gradient at a node.
type NodeGradient = Vec<(usize, Vector2<f64>)>;

/// Creates one quadratic for every triangle. Nodes with fewer than three neighbours have no gradient.
pub fn quadratics(positions: &[Point2<f64>], triangles: &[[usize; 3]]) -> Vec<Quadratic> {
    let mut rings = vec![BTreeSet::new(); positions.len()];
    for &[a, b, c] in triangles {
        for (node, others) in [(a, [b, c]), (b, [c, a]), (c, [a, b])] {
            rings[node].extend(others);
        }
    }
    let gradient = |(node, ring): (usize, &BTreeSet<usize>)| -> NodeGradient {
        // Neighbours are weighted by the inverse square of their distance; coinciding nodes are skipped.
        let spoke = |&other: &usize| (other, positions[other] - positions[node]);
        let spokes: Vec<_> = ring.iter().map(spoke).filter(|(_, d)| d.norm_squared() > 1e-9).collect();
        let normal: Matrix2<f64> = spokes.iter().map(|(_, d)| d * d.transpose() / d.norm_squared()).sum();
        let Some(inverse) = normal.try_inverse().filter(|_| spokes.len() >= 3) else { return Vec::new() };
        let mut out: Vec<_> = spokes.iter().map(|(other, d)| (*other, inverse * d / d.norm_squared())).collect();
        out.push((node, -out.iter().map(|(_, g)| g).sum::<Vector2<f64>>()));
        out
    };
    let gradients: Vec<_> = rings.iter().enumerate().map(gradient).collect();
    triangles.iter().map(|&corners| Quadratic::new(corners, positions, &gradients)).collect()
}

/// Returns the border of the triangles: edges that belong to one triangle only.
pub fn border(triangles: &[[usize; 3]]) -> Vec<(usize, usize)> {
    let mut uses: BTreeMap<(usize, usize), u32> = BTreeMap::new();
    for t in triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            *uses.entry((a.min(b), a.max(b))).or_insert(0) += 1;
        }
    }
    uses.into_iter().filter(|(_, n)| *n == 1).map(|(edge, _)| edge).collect()
}

/// Returns the nodes of openings: all parts of the border except the tallest, which is the outline of the face.
pub fn openings(positions: &[Point2<f64>], border: &[(usize, usize)]) -> BTreeSet<usize> {
    let mut part: BTreeMap<usize, usize> = border.iter().flat_map(|&(a, b)| [(a, a), (b, b)]).collect();
    // Each round propagates the smallest index one edge further; a part has no more edges than the border.
    for _ in border {
        for &(a, b) in border {
            let smallest = part[&a].min(part[&b]);
            part.extend([(a, smallest), (b, smallest)]);
        }
    }
    let height = |name: usize| {
        let ys = part.iter().filter(|(_, p)| **p == name).map(|(node, _)| positions[*node].y);
        let (low, high) = ys.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), y| (l.min(y), h.max(y)));
        high - low
    };
    let names: BTreeSet<usize> = part.values().copied().collect();
    let outline = names.into_iter().max_by(|a, b| height(*a).total_cmp(&height(*b)));
    part.iter().filter(|(_, p)| Some(**p) != outline).map(|(node, _)| *node).collect()
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    /// A 3 x 3 grid of nodes, numbered row by row, its four cells cut along the diagonal.
    fn grid() -> (Vec<Point2<f64>>, Vec<[usize; 3]>) {
        let points = (0..9).map(|k| Point2::new(f64::from(k % 3), f64::from(k / 3))).collect();
        let cell = |k: usize| [[k, k + 1, k + 4], [k, k + 4, k + 3]];
        (points, [0, 1, 3, 4].into_iter().flat_map(cell).collect())
    }

    #[test]
    fn a_linear_motion_is_carried_exactly() {
        let (points, triangles) = grid();
        let motion = |p: Point2<f64>| Vector2::new(0.5 * p.x - 0.25 * p.y + 3.0, p.y - 2.0);
        for (quadratic, triangle) in quadratics(&points, &triangles).iter().zip(&triangles) {
            let control = quadratic.values(|n| motion(points[n]));
            let bary = [0.2, 0.5, 0.3];
            let at: Vector2<f64> = triangle.iter().zip(bary).map(|(n, b)| points[*n].coords * b).sum();
            let weights = Quadratic::weights(bary);
            let moved: Vector2<f64> = control.iter().zip(weights).map(|(c, w)| c * f64::from(w)).sum();
            assert_relative_eq!(moved, motion(at.into()), epsilon = 1e-6);
        }
    }

    #[test]
    fn corners_keep_the_values_of_their_nodes() {
        let (points, triangles) = grid();
        let value = |n: usize| Vector2::new((n * n) as f64, -(n as f64));
        for (quadratic, triangle) in quadratics(&points, &triangles).iter().zip(&triangles) {
            let control = quadratic.values(value);
            for k in 0..3 {
                assert_eq!(control[k], value(triangle[k]));
            }
        }
    }

    #[test]
    fn border_and_openings() {
        // The grid without its two triangles around the middle of the right cell column: 8 outer edges stay single.
        let (points, triangles) = grid();
        let outline = border(&triangles);
        assert_eq!(outline.len(), 8);
        assert!(openings(&points, &outline).is_empty());
        // A tall square of triangles around a small open square.
        let square = |s: f64| [(-s, -s), (s, -s), (s, s), (-s, s)].map(|(x, y)| Point2::new(x, y));
        let points: Vec<_> = square(3.0).into_iter().chain(square(1.0)).collect();
        let side = |k: usize| [[k, (k + 1) % 4, 4 + k], [(k + 1) % 4, 4 + (k + 1) % 4, 4 + k]];
        let frame: Vec<_> = (0..4).flat_map(side).collect();
        let edges = border(&frame);
        assert_eq!(edges.len(), 8);
        assert_eq!(openings(&points, &edges), BTreeSet::from([4, 5, 6, 7]));
    }
}
