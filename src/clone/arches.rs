//! Shapes lips and lids as arches and keeps the corners of the mouth at the ends of the lips. This corrects artefacts that a median over
//! people or a tracker leaves in the nodes.

use nalgebra::{Point2, Rotation2, Vector2};

use super::target::Target;
use crate::{interpolation::smooth_step, warp::OPENINGS};

/// Largest opening of a lip beside its middle, relative to the middle.
const LIP_ROUND: f64 = 0.97;
/// Exponent of the least round shape: 1 is a parabola, 0.5 an ellipse.
const LIP_FULLNESS: f64 = 0.7;
/// Least and greatest motion of a lid beside its middle, relative to the middle's. `LID_ABOUT`: tolerance, relative to that motion, plus a
/// fraction of the eye distance.
const LID_SHARES: (f64, f64) = (0.45, 1.0);
const LID_ABOUT: (f64, f64) = (0.20, 0.006);
/// Distances of the lips, in eye distances, at which the lower lip begins to lose its bow and has lost it.
const PARTED: (f64, f64) = (0.06, 0.20);
/// The same for the bow of the upper lip.
const STRETCHED: (f64, f64) = (0.03, 0.10);
/// Ends of the opening between the lips, and the corners of the mouth beyond them.
const CORNERS: [(usize, usize); 2] = [(88, 31), (89, 64)];
/// Largest turn of the piece between them, radians, and (`CORNER_LENGTHS`) its least and greatest length relative to neutral.
const CORNER_TURN: f64 = 0.55;
const CORNER_LENGTHS: (f64, f64) = (0.6, 1.15);

impl Target {
    /// Shapes lips, lids and corners of the requested nodes like those of a face.
    pub(super) fn shape_openings(&self, nodes: &mut [Point2<f64>]) {
        self.keep_corners(nodes);
        let down = self.warp().down();
        // The bow of the lip flattens as the lips part.
        let flat = smooth_step(PARTED.0, PARTED.1, self.parted(nodes));
        let inner = [88, 89];
        self.round_lip(nodes, (40, [83, 84], inner), down, flat, Some(LIP_ROUND));
        self.round_lip(nodes, (87, [81, 82], inner), -down, 0.0, Some(LIP_ROUND));
        // The outer edge of the lower lip is at least as round as its inner one; otherwise it would be pointed, and the lip thin beside it. Below
        // a smile it may stay as flat as its corners leave it.
        self.round_lip(nodes, (8, [85, 86], [31, 64]), down, 0.0, None);
        self.stretch_upper_lip(nodes);
        self.arch_lids(nodes);
    }

    /// Moves the ends of the opening with the corners of the mouth: the lips form one short piece there that hardly turns or stretches. If a
    /// tracker loses one of these points, the piece would become a hook.
    fn keep_corners(&self, nodes: &mut [Point2<f64>]) {
        let neutral = self.fitted.model.nodes();
        for (inner, outer) in CORNERS {
            let (was, is) = (neutral[outer] - neutral[inner], nodes[outer] - nodes[inner]);
            if was.norm() > 0.0 {
                let turn = was.perp(&is).atan2(was.dot(&is)).clamp(-CORNER_TURN, CORNER_TURN);
                let length = (is.norm() / was.norm()).clamp(CORNER_LENGTHS.0, CORNER_LENGTHS.1);
                nodes[inner] = nodes[outer] - Rotation2::new(turn) * was * length;
            }
        }
    }

    /// Makes a lip open round. Relative to the corners, the points beside its middle move away from the other lip at least as far as on an arch
    /// through the middle (between a parabola and an ellipse), and at most by `most` times the middle's motion (`None`: no limit). Notches and peaks
    /// come from a median over people, from a tracker on parting lips, or from a source whose nodes lie farther from the middle than the
    /// target's. A fraction `flat` of the closed lip's bow is removed. The change is minimal in the sense of least squares.
    fn round_lip(
        &self,
        nodes: &mut [Point2<f64>],
        (middle_node, beside_nodes, [first, last]): (usize, [usize; 2], [usize; 2]),
        outwards: Vector2<f64>,
        flat: f64,
        most: Option<f64>,
    ) {
        let neutral = self.fitted.model.nodes();
        let line = nalgebra::center(&neutral[first], &neutral[last]);
        let moved = |n: usize| (nodes[n] - neutral[n]).dot(&outwards) + flat * (neutral[n] - line).dot(&outwards);
        let corners = f64::midpoint(moved(first), moved(last));
        let beside = f64::midpoint(moved(beside_nodes[0]), moved(beside_nodes[1])) - corners;
        let middle = moved(middle_node) - corners;
        // Their position between the middle (0) and the corners (1).
        let width = (neutral[first] - neutral[last]).norm();
        let place =
            if width > 0.0 { ((neutral[beside_nodes[0]] - neutral[beside_nodes[1]]).norm() / width).min(1.0) } else { 0.5 };
        let least = (1.0 - place * place).powf(LIP_FULLNESS).min(LIP_ROUND);
        let share = if middle > 0.0 && beside < least * middle {
            least
        } else if let Some(most) = most.filter(|most| beside > 0.0 && beside > most * middle) {
            most
        } else {
            return;
        };
        let round = (middle + 2.0 * share * beside) / (1.0 + 2.0 * share * share);
        nodes[middle_node] += outwards * (round - middle);
        for n in beside_nodes {
            nodes[n] += outwards * (share * round - beside);
        }
    }

    /// Distance of the middles of the lips, in eye distances.
    fn parted(&self, nodes: &[Point2<f64>]) -> f64 {
        (nodes[40] - nodes[87]).dot(&self.warp().down()) / self.warp().eye_distance()
    }

    /// Removes the bow of the upper lip's inner edge as the lips part: a lip that is drawn over teeth is straight.
    fn stretch_upper_lip(&self, nodes: &mut [Point2<f64>]) {
        let down = self.warp().down();
        let neutral = self.fitted.model.nodes();
        let bow = (neutral[87] - nalgebra::center(&neutral[81], &neutral[82])).dot(&down).max(0.0);
        let taken = bow * smooth_step(STRETCHED.0, STRETCHED.1, self.parted(nodes));
        nodes[87] -= down * (taken * 2.0 / 3.0);
        for n in [81, 82] {
            nodes[n] += down * (taken / 3.0);
        }
    }

    /// Makes lids rise and fall as arches. Beyond the motion of the corners, the points beside the middle follow its motion in proportion to the
    /// opening of the eye there on the photograph, within a tolerance. A median over people, or a tracker between lashes, leaves a peak or a dent
    /// above the iris. The middle, MPEG-4's feature point, stays where it was requested.
    fn arch_lids(&self, nodes: &mut [Point2<f64>]) {
        let down = self.warp().down();
        let neutral = self.fitted.model.nodes();
        for eye in &OPENINGS[1..] {
            let (upper, lower) = (eye.upper.map(usize::from), eye.lower.map(usize::from));
            let [outer, .., inner] = upper;
            let chord = neutral[inner] - neutral[outer];
            let open = [1, 2, 3].map(|k: usize| (neutral[lower[k]] - neutral[upper[k]]).dot(&down));
            if !(open[1] > 0.0) {
                continue;
            }
            for [_, outside, middle, inside, _] in [upper, lower] {
                let moved = |node: usize| (nodes[node] - neutral[node]).dot(&down);
                let [outside_way, way, inside_way] = [outside, middle, inside].map(|node| {
                    let along = ((neutral[node] - neutral[outer]).dot(&chord) / chord.norm_squared().max(1e-12)).clamp(0.0, 1.0);
                    moved(node) - moved(outer) * (1.0 - along) - moved(inner) * along
                });
                let about = LID_ABOUT.0 * way.abs() + LID_ABOUT.1 * self.warp().eye_distance();
                for (node, own, open_there) in [(outside, outside_way, open[0]), (inside, inside_way, open[2])] {
                    let arch = (open_there / open[1]).clamp(LID_SHARES.0, LID_SHARES.1) * way;
                    nodes[node] += down * (own.clamp(arch - about, arch + about) - own);
                }
            }
        }
    }
}
