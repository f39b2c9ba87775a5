//! The nodes of Candide-3 that the warp uses: the edges of the face's openings and the nodes that drive the skin.

use nalgebra::{Point2, Unit, Vector2};

use crate::{units::NodeId, wireframe::LID_MARGINS};

/// An opening of the face, over which the skin is not stretched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Opening {
    /// Between the lips.
    Mouth,
    /// Between the lids of the subject's left eye.
    LeftEye,
    /// Between the lids of the subject's right eye.
    RightEye,
}

/// The nodes around an opening and those of the iris behind it.
#[derive(Clone, Copy, Debug)]
pub struct OpeningNodes {
    /// Which opening.
    pub opening: Opening,
    /// Upper edge, both corners included.
    pub upper: [u16; 5],
    /// Lower edge, with the same corners and direction.
    pub lower: [u16; 5],
    /// Nodes of the iris; empty for the mouth.
    pub iris: &'static [u16],
}

/// The three openings. Edges run from the outer to the inner corner (the mouth: from the subject's left to the right).
pub const OPENINGS: [OpeningNodes; 3] = [
    OpeningNodes { opening: Opening::Mouth, upper: [88, 81, 87, 82, 89], lower: [88, 83, 40, 84, 89], iris: &[] },
    OpeningNodes { opening: Opening::LeftEye, upper: LID_MARGINS[0][0], lower: LID_MARGINS[0][1], iris: &[67, 71, 72, 68] },
    OpeningNodes { opening: Opening::RightEye, upper: LID_MARGINS[1][0], lower: LID_MARGINS[1][1], iris: &[69, 73, 74, 70] },
];

/// Nodes that do not drive the skin: the irises, and the lid creases, which lie so near the lid margins that small errors would fold the lid.
/// The nine nodes in no triangle and those of the [`FOREHEAD`] do not drive it either.
const PASSIVE: [u16; 29] =
    [67, 68, 69, 70, 71, 72, 73, 74, 95, 96, 101, 102, 103, 104, 109, 110, 19, 24, 52, 57, 4, 35, 36, 37, 38, 39, 41, 42, 43];
/// Nodes of the forehead between the brows and the top of the head, which do not drive the skin. No feature marks them, and a fit places
/// them as low as the brows: they would hold the skin, and rising brows would press it into a rim. Without them it slides up, less at
/// greater heights. Node 3, between the brows, moves with them and still drives.
const FOREHEAD: [u16; 5] = [1, 2, 13, 34, 46];

/// Nodes above and below the lips that move when the reference opens the mouth, and their fractions of that motion.
const ABOVE: [(u16, f64); 8] = [(7, 1.0), (33, 1.0), (66, 1.0), (79, 0.7), (80, 0.7), (81, 0.7), (82, 0.7), (87, 1.0)];
const BELOW: [(u16, f64); 10] =
    [(8, 1.0), (85, 0.7), (86, 0.7), (83, 0.7), (84, 0.7), (40, 1.0), (9, 0.9), (10, 0.6), (32, 0.5), (65, 0.5)];
/// Upper and lower nodes of the lids, for both eyes.
const UPPER_LIDS: [u16; 6] = [97, 21, 105, 98, 54, 106];
const LOWER_LIDS: [u16; 6] = [99, 22, 107, 100, 55, 108];

/// Distance of the lips in the reference, in eye distances.
const MOUTH_GAP: f64 = 0.06;
/// Distance of the lids in the reference, in eye distances.
const LID_GAP: f64 = 0.10;
/// Lips nearer than this, in eye distances, count as closed: a fit cannot resolve less.
pub const CLOSED_GAP: f64 = 0.06;

/// The nodes of a brow: the inner one (on the lower edge of the hair), the upper and the lower edge of its middle, and the outer one,
/// where both edges meet.
pub const BROWS: [[u16; 4]; 2] = [[17, 16, 18, 15], [50, 49, 51, 48]];
/// Least and greatest thickness of a brow, relative to its neutral one: hair moves but does not stretch.
const BROW_THICKNESS: (f64, f64) = (0.88, 1.12);

/// The skin between a brow and an upper lid.
#[derive(Clone, Copy, Debug)]
pub struct LidSkin {
    /// Nodes of the lid margin below, from inner to outer.
    pub lid: [u16; 3],
    /// Corners of the eye.
    pub corners: [u16; 2],
    /// Inner and outer node of the lower edge of the brow.
    pub brow: [u16; 2],
    /// The brow's outer end.
    pub tail: u16,
    /// Points on the brow above the lid's nodes, as fractions of the way from the brow's inner to its outer node.
    pub shares: [f64; 3],
}

/// The lid skin of both eyes.
pub const LID_SKIN: [LidSkin; 2] = [
    LidSkin { lid: [105, 21, 97], corners: [20, 23], brow: [17, 18], tail: 15, shares: [0.40, 0.60, 0.80] },
    LidSkin { lid: [106, 54, 98], corners: [53, 56], brow: [50, 51], tail: 48, shares: [0.40, 0.60, 0.80] },
];
/// The skin above an eye; `None` for the mouth.
pub fn lid_skin_of(opening: Opening) -> Option<&'static LidSkin> {
    match opening {
        Opening::Mouth => None,
        Opening::LeftEye => LID_SKIN.first(),
        Opening::RightEye => LID_SKIN.last(),
    }
}

/// Rows of vertices in the lid skin: height as a fraction of the way from lid to brow, and the weights of the lid's and of the brow's motion. The
/// rest is the weight of the eye's corners. The brow slides over the skin right below it, which stretches and folds; lashes and
/// crease, further down, keep their shape. Evenly growing weights fit the shapes of a head model better (0.003 of SSIM on animated
/// photographs), but pull lashes and the lid's shadow up when brows rise.
pub const LID_SKIN_HEIGHTS: [(f64, f64, f64); 3] = [(0.30, 0.28, 0.10), (0.50, 0.12, 0.32), (0.78, 0.0, 0.73)];

/// Number of nodes that a face must have: Candide-3's.
pub const NODE_COUNT: usize = 113;

/// Size and direction of a face in its image.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Distance between the centres of the eyes, px.
    pub eye_distance: f64,
    /// Unit vector from forehead to chin.
    pub down: Unit<Vector2<f64>>,
}

impl Frame {
    /// The frame of a face; `None` when the eyes coincide.
    pub fn of(nodes: &[Point2<f64>]) -> Option<Self> {
        let middle = |k: usize| {
            let corners = [OPENINGS[k].upper[0], OPENINGS[k].upper[4]];
            nalgebra::center(&nodes[usize::from(corners[0])], &nodes[usize::from(corners[1])])
        };
        let across = middle(1) - middle(2);
        let eye_distance = across.norm();
        if !(eye_distance > 1e-6 && eye_distance.is_finite()) {
            return None;
        }
        // The subject's left is on the right of the image: turning `across` clockwise on the screen points to the chin.
        Some(Self { eye_distance, down: Unit::new_normalize(Vector2::new(-across.y, across.x)) })
    }

    /// Unit vector to the subject's left.
    pub fn across(&self) -> Vector2<f64> {
        Vector2::new(self.down.y, -self.down.x)
    }

    /// Coordinates (across, down) of points along the face's axes, sorted by the first.
    pub fn line(&self, points: impl Iterator<Item = Vector2<f64>>) -> Vec<(f64, f64)> {
        let across = self.across();
        let mut line: Vec<(f64, f64)> = points.map(|p| (p.dot(&across), p.dot(&self.down))).collect();
        line.sort_by(|a, b| a.0.total_cmp(&b.0));
        line
    }

    /// Coordinate along the face's vertical, downwards.
    pub fn height(&self, point: &Point2<f64>) -> f64 {
        point.coords.dot(&self.down)
    }
}

/// Whether a node drives the skin.
pub fn drives(node: NodeId) -> bool {
    node.index() < NODE_COUNT && !PASSIVE.contains(&node.0) && !FOREHEAD.contains(&node.0)
}

/// The neutral nodes on the texture, and whether the mouth is closed. Nearly closed lips are placed exactly on each other.
pub fn source(nodes: &[Point2<f64>], frame: &Frame) -> (Vec<Point2<f64>>, bool) {
    let mut nodes = nodes.to_vec();
    let OpeningNodes { upper, lower, .. } = OPENINGS[0];
    let pairs = || (1..4).map(|k| (usize::from(upper[k]), usize::from(lower[k])));
    // The middle pair is the most reliable: the outer ones are seldom marked, and full lips push them apart in a fit.
    let is_near = |(a, b): (usize, usize), gap: f64| frame.height(&nodes[b]) - frame.height(&nodes[a]) < gap * frame.eye_distance;
    let middle = (usize::from(upper[2]), usize::from(lower[2]));
    let closed = pairs().all(|pair| is_near(pair, CLOSED_GAP)) || is_near(middle, CLOSED_GAP / 4.0);
    if closed {
        for (a, b) in pairs() {
            let middle = nalgebra::center(&nodes[a], &nodes[b]);
            (nodes[a], nodes[b]) = (middle, middle);
        }
    }
    for eye in &OPENINGS[1..] {
        for k in 1..4 {
            keep_apart(&mut nodes, eye.upper[k], eye.lower[k], frame, 0.0);
        }
    }
    (nodes, closed)
}

/// The reference: the source with mouth and eyes opened, so that each opening has room between its edges.
pub fn reference(source: &[Point2<f64>], frame: &Frame) -> Vec<Point2<f64>> {
    let mut nodes = source.to_vec();
    let OpeningNodes { upper, lower, .. } = OPENINGS[0];
    let gap = (1..4)
        .map(|k| frame.height(&nodes[usize::from(lower[k])]) - frame.height(&nodes[usize::from(upper[k])]))
        .fold(f64::INFINITY, f64::min);
    let missing = MOUTH_GAP * frame.eye_distance - gap;
    if missing > 0.0 {
        let half = frame.down.into_inner() * (missing / 2.0);
        ABOVE.iter().for_each(|&(n, share)| nodes[usize::from(n)] -= half * share);
        BELOW.iter().for_each(|&(n, share)| nodes[usize::from(n)] += half * share);
    }
    for (&a, &b) in UPPER_LIDS.iter().zip(&LOWER_LIDS) {
        keep_apart(&mut nodes, a, b, frame, LID_GAP * frame.eye_distance);
    }
    nodes
}

/// Moves two nodes apart along the vertical until the lower one is `gap` px below the upper one.
pub fn keep_apart(nodes: &mut [Point2<f64>], upper: u16, lower: u16, frame: &Frame, gap: f64) {
    let (a, b) = (usize::from(upper), usize::from(lower));
    let missing = gap - (frame.height(&nodes[b]) - frame.height(&nodes[a]));
    if missing > 0.0 {
        let half = frame.down.into_inner() * (missing / 2.0);
        nodes[a] -= half;
        nodes[b] += half;
    }
}

/// Limits the change of the brows' thickness against `neutral`: the lower edge gives way, because the upper one is MPEG-4's feature point.
pub fn keep_brows(nodes: &mut [Point2<f64>], neutral: &[Point2<f64>], frame: &Frame) {
    for [_, upper, lower, _] in BROWS.map(|brow| brow.map(usize::from)) {
        let thickness = |nodes: &[Point2<f64>]| frame.height(&nodes[lower]) - frame.height(&nodes[upper]);
        let (was, is) = (thickness(neutral), thickness(nodes));
        if was > 0.0 {
            nodes[lower] += frame.down.into_inner() * (is.clamp(BROW_THICKNESS.0 * was, BROW_THICKNESS.1 * was) - is);
        }
    }
}

/// A smooth curve through points (Catmull-Rom), with `counts` steps per segment. The points are among the samples.
pub fn curve(points: &[Point2<f64>], counts: &[usize]) -> Vec<Point2<f64>> {
    let Some(&first) = points.first() else { return Vec::new() };
    let mut samples = vec![first];
    for (k, &count) in counts.iter().enumerate().take(points.len() - 1) {
        let (b, c) = (points[k], points[k + 1]);
        // Beyond the ends the curve continues straight.
        let a = if k == 0 { b - (c - b) } else { points[k - 1] };
        let d = points.get(k + 2).copied().unwrap_or(c + (c - b));
        for i in 1..count {
            let t = i as f64 / count as f64;
            let value = |a: f64, b: f64, c: f64, d: f64| {
                b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
            };
            samples.push(Point2::new(value(a.x, b.x, c.x, d.x), value(a.y, b.y, c.y, d.y)));
        }
        samples.push(c);
    }
    samples
}
