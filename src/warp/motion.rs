//! Positions of vertices in a frame: skin follows the nodes, lips and lids do not cross, the eyeball follows its corners and the gaze.

use nalgebra::{Point2, Vector2};

use super::{
    Warp,
    layout::{self, OPENINGS, OpeningNodes},
    seam,
};
use crate::{geometry::Similarity, interpolation::smooth_step};

/// Largest gaze motion that is shown, as a shift of the iris in eye distances.
const MAX_GAZE: f64 = 0.12;
/// Distance of the edges of an opening, in eye distances, up to which it counts as shut.
const SHUT: f64 = 1e-4;
/// Largest remaining opening beside the middle of a lid, as a fraction of its neutral value, relative to that in the middle.
const BESIDE_MIDDLE: f64 = 1.35;
/// Distances of the lips, in eye distances, at which the edges of the upper and the lower one begin to lose the bow in which they meet, and
/// have lost it: an upper lip is stretched over the teeth.
const PARTED: [(f64, f64); 2] = [(0.03, 0.10), (0.06, 0.20)];

/// Touching lips at the corners of a slightly open mouth: distance up to which they touch, in eye distances; fraction of the mouth's width from
/// either end; and the upper lip's part of the motion.
const CLING: f64 = 0.12;
const CLING_WITHIN: f64 = 0.42;
const CLING_UPPER: f64 = 0.4;
/// Distances of the lips, in eye distances, at which this has begun fully, begins to end, and has ended.
const CLINGING: (f64, f64, f64) = (0.04, 0.10, 0.22);

impl Warp {
    /// Vertices of a frame with the driving nodes at `wanted`, and everything else moved by `around`.
    pub(super) fn vertices_of(&self, wanted: &[Point2<f64>], around: &Similarity) -> Vec<Point2<f64>> {
        let mut moved = self.carried(&self.source, &self.nodes, wanted, around);
        let parted = (self.frame.height(&wanted[40]) - self.frame.height(&wanted[87])) / self.frame.eye_distance;
        let down = around.apply_vector(&self.frame.down);
        for (bows, (from, to)) in self.bows.iter().zip(PARTED) {
            let taken = smooth_step(from, to, parted);
            bows.iter().filter(|_| taken > 0.0).for_each(|&(v, bow)| moved[v] -= down * (bow * taken));
        }
        self.cling(&mut moved, wanted, parted, &down);
        self.meet(&mut moved, wanted);
        moved
    }

    /// Draws the lips together towards the corners of a mouth that a dropping lower lip opens a little: soft lips touch there and separate in a line
    /// instead of a wedge. They do not where the upper lip is raised or the mouth gapes, because they are stretched.
    fn cling(&self, moved: &mut [Point2<f64>], wanted: &[Point2<f64>], parted: f64, down: &Vector2<f64>) {
        let clinging = smooth_step(0.0, CLINGING.0, parted) * (1.0 - smooth_step(CLINGING.1, CLINGING.2, parted));
        if !(self.closed && clinging > 0.0) {
            return;
        }
        let fell = |n: usize| self.frame.height(&wanted[n]) - self.frame.height(&self.nodes[n]);
        let (low, high) = seam::TURNED_AWAY;
        let reach = CLING * clinging * smooth_step(low, high, (fell(40) - fell(6)) / (parted * self.frame.eye_distance));
        let mouth = &self.mesh.openings[0];
        let edges = mouth.upper.iter().zip(&mouth.lower);
        let [first, .., last] = mouth.upper[..] else { return };
        let (start, way) = (self.source[first as usize], self.source[last as usize] - self.source[first as usize]);
        for (&a, &b) in edges.filter(|(a, b)| reach > 0.0 && a != b) {
            let along = (self.source[a as usize] - start).dot(&way) / way.norm_squared().max(1e-12);
            let touching = reach * self.frame.eye_distance * (1.0 - smooth_step(0.0, CLING_WITHIN, along.min(1.0 - along)));
            let gap = (moved[b as usize] - moved[a as usize]).dot(down);
            if gap > 0.0 && touching > 0.0 {
                let closer = gap + touching - gap.hypot(touching);
                moved[a as usize] += down * (CLING_UPPER * closer);
                moved[b as usize] -= down * ((1.0 - CLING_UPPER) * closer);
            }
        }
    }

    /// The bows of the edges of the upper and the lower lip on the texture; empty if it shows an open mouth.
    pub(super) fn lip_bows(&self) -> [Vec<(usize, f64)>; 2] {
        let mouth = &self.mesh.openings[0];
        let height = |v: u32| self.frame.height(&self.source[v as usize]);
        [&mouth.upper, &mouth.lower].map(|edge| {
            let tied = self.mesh.tied.iter().filter(|(v, _)| self.closed && edge.contains(v));
            tied.map(|(v, shares)| {
                let arch: f64 = shares.iter().map(|&(d, share)| share * height(self.mesh.drivers[d].1)).sum();
                (*v as usize, height(*v) - arch)
            })
            .collect()
        })
    }

    /// Vertices when the driving nodes move from `base` to `wanted`, and everything else by `around`.
    pub(super) fn solve(
        &self,
        vertices: &[Point2<f64>],
        base: &[Point2<f64>],
        wanted: &[Point2<f64>],
        around: &Similarity,
    ) -> Vec<Point2<f64>> {
        let mut moved = self.carried(vertices, base, wanted, around);
        self.meet(&mut moved, wanted);
        moved
    }

    /// [`Warp::solve`] without keeping lips and lids from crossing.
    fn carried(
        &self,
        vertices: &[Point2<f64>],
        base: &[Point2<f64>],
        wanted: &[Point2<f64>],
        around: &Similarity,
    ) -> Vec<Point2<f64>> {
        let offsets: Vec<Vector2<f64>> =
            self.mesh.drivers.iter().map(|&(n, _)| wanted[n.index()] - around.apply(&base[n.index()])).collect();
        let still = *around == Similarity::identity();
        let displaced = self.weights.displaced(&offsets);
        vertices.iter().zip(displaced).map(|(p, offset)| if still { p + offset } else { around.apply(p) + offset }).collect()
    }

    /// Makes lips and lids meet where they would cross, and places the vertices between them.
    fn meet(&self, moved: &mut [Point2<f64>], wanted: &[Point2<f64>]) {
        for (nodes, opening) in OPENINGS.iter().zip(&self.mesh.openings) {
            // Edges that would cross meet, and so do those between two shut nodes.
            let gap = |k: usize| {
                self.frame.height(&wanted[usize::from(nodes.lower[k])]) - self.frame.height(&wanted[usize::from(nodes.upper[k])])
            };
            let shut: [bool; 5] = std::array::from_fn(|k| gap(k) <= SHUT * self.frame.eye_distance);
            for (k, (&a, &b)) in opening.upper.iter().zip(&opening.lower).enumerate() {
                let (a, b) = (a as usize, b as usize);
                let next = opening.stops.iter().position(|&stop| stop >= k).unwrap_or(4);
                let between_shut = shut[next] && (opening.stops[next] == k || shut[next.saturating_sub(1)]);
                if a != b && (between_shut || self.frame.height(&moved[b]) < self.frame.height(&moved[a])) {
                    let middle = nalgebra::center(&moved[a], &moved[b]);
                    (moved[a], moved[b]) = (middle, middle);
                }
            }
            for &(k, share, v) in &opening.eyeball {
                let (from, to) = (moved[opening.upper[k] as usize], moved[opening.lower[k] as usize]);
                moved[v as usize] = from + (to - from) * share;
            }
        }
    }

    /// Makes an eye shut from corner to corner: beside the middle of a lid hardly more of the opening remains than in the middle, whatever was
    /// requested. FAP files move the middle alone.
    pub(super) fn close_lids(&self, nodes: &mut [Point2<f64>]) {
        for eye in &OPENINGS[1..] {
            let gap = |points: &[Point2<f64>], k: usize| {
                self.frame.height(&points[usize::from(eye.lower[k])]) - self.frame.height(&points[usize::from(eye.upper[k])])
            };
            let whole: [f64; 5] = std::array::from_fn(|k| gap(&self.nodes, k));
            if whole[2] <= SHUT * self.frame.eye_distance {
                continue;
            }
            let most = BESIDE_MIDDLE * gap(nodes, 2).max(0.0) / whole[2];
            for k in [1, 3] {
                let excess = gap(nodes, k) - most * whole[k];
                if most < 1.0 && whole[k] > 0.0 && excess > 0.0 {
                    nodes[usize::from(eye.upper[k])] += self.frame.down.into_inner() * excess;
                }
            }
        }
    }

    /// Keeps lips and lids from crossing.
    pub(super) fn separate(&self, nodes: &mut [Point2<f64>]) {
        for OpeningNodes { upper, lower, .. } in &OPENINGS {
            for k in 1..4 {
                layout::keep_apart(nodes, upper[k], lower[k], &self.frame, 0.0);
            }
        }
    }
}

/// Motion of an eyeball: with the corners of the eye, plus the gaze.
pub fn eye_motion(
    nodes: &OpeningNodes,
    base: &[Point2<f64>],
    wanted: &[Point2<f64>],
    eye_distance: f64,
) -> (Similarity, Vector2<f64>) {
    let corners = |points: &[Point2<f64>]| [points[usize::from(nodes.upper[0])], points[usize::from(nodes.upper[4])]];
    let middle = |points: &[Point2<f64>]| {
        let sum: Vector2<f64> = nodes.iris.iter().map(|&n| points[usize::from(n)].coords).sum();
        Point2::from(sum / nodes.iris.len().max(1) as f64)
    };
    let eye = Similarity::fit(&corners(base), &corners(wanted), None).unwrap_or_else(|_| Similarity::identity());
    let gaze = middle(wanted) - eye.apply(&middle(base));
    let limit = MAX_GAZE * eye_distance;
    (eye, if gaze.norm() > limit { gaze * (limit / gaze.norm()) } else { gaze })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::warp::test_face::{EYES, nodes};

    /// Distances of the lips, px, from one corner of the opening to the other, when some nodes move down.
    fn gaps(moved: &[(usize, f64)]) -> Vec<f64> {
        let nodes = nodes();
        let warp = Warp::new(&nodes).unwrap();
        let mut open = nodes.clone();
        moved.iter().for_each(|&(n, by)| open[n].y += by * EYES);
        let frame = warp.deform(&open).unwrap();
        let mouth = &warp.mesh.openings[0];
        mouth.upper.iter().zip(&mouth.lower).map(|(&a, &b)| frame.vertices[b as usize].y - frame.vertices[a as usize].y).collect()
    }

    /// Gap an eighth of the way from the corner, relative to the middle's.
    fn beside_corner(gaps: &[f64]) -> f64 {
        gaps[gaps.len() / 8] / gaps[gaps.len() / 2]
    }

    #[test]
    fn lips_that_part_a_little_lie_on_each_other_towards_the_corners() {
        let lower = |by: f64| [40, 83, 84, 8, 85, 86, 9, 10].map(|n| (n, by));
        let (little, wide) = (gaps(&lower(0.08)), gaps(&lower(0.30)));
        // The middle opens as far as requested; towards the corners the gap is narrower than in a gaping mouth: by hand, an eighth of
        // the way along 6.6 + 10.4 - hypot(6.6, 10.4) = 4.7 px of 6.6, which leaves 0.29 of its share.
        assert!((little[little.len() / 2] - 0.08 * EYES).abs() < 0.01 * EYES, "{little:?}");
        assert!(
            (beside_corner(&little) / beside_corner(&wide) - 0.29).abs() < 0.03,
            "{} {}",
            beside_corner(&little),
            beside_corner(&wide)
        );
        assert!(little.iter().all(|gap| *gap >= 0.0));
        // An upper lip that is raised leaves the corners open.
        let raised = gaps(&[87, 81, 82, 7, 33, 66].map(|n| (n, -0.08)));
        assert!(beside_corner(&raised) > 1.3 * beside_corner(&little), "{} {}", beside_corner(&raised), beside_corner(&little));
    }
}
