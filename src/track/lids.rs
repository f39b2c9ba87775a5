//! Corrects the positions of closing lids. This is not part of KP.
//!
//! A blink takes a tenth of a second: the upper lid covers the eye within two or three frames, and its window changes from iris and lashes
//! to skin. KLT loses it or finds it half way, and the alignment, which compares with the open eye of the neutral frame, keeps it there.
//! But the neutral frame predicts what the eye looks like with its lid further down: the skin above moves down with the lashes at its edge,
//! and everything below the edge stays. So each eye is compared with synthetic pictures of itself, closed by different amounts. If one of
//! them matches better than the one at the tracked position, the lid is put there.
//!
//! The picture of an eye whose upper lid is down by a share s of its opening, and whose lower lid is up by a share t, at a point v below
//! the line between its corners (u along that line, both over the eye's width; U, L: upper and lower lid of the neutral frame N, all
//! functions of u):
//!
//! ```text
//! f = L - t (L - U), e = min(U + s (L - U), f)   the edges
//! N(u, v + t (L - U))                            v > f: the lower lid and what is below it
//! N(u, v)                                        f > v > e: the eyeball; where a lid that rises uncovers it, as right below U
//! N(u, U - (e - v))                              e - v < b: lashes and the skin among them move along
//! N(u, U - b - (e - v - b) r)                    above them skin unfolds, r = (h - b) / (h - b + e - U)
//! ```
//!
//! A lid that opens further, or narrows, moves too little for its picture, and its middle may stay behind: its window holds more iris than lid.
//! But a lid is an arch between two corners that stay: its middle goes at least as far as its quarters on the mean. A middle that stays behind
//! them is taken along. (Quarters that stay behind their middle are left: taken along, they made AU 5 worse on rendered faces.)
//!
//! Pictures are compared by their normalized correlation c, which does not depend on lighting. The criterion is the share of the
//! unexplained part at the tracked position, 1 - c, that the best picture explains.

use image::GrayImage;
use nalgebra::{Point2, Vector2};

use super::{NodeState, TrackedNode};
use crate::{interpolation::smooth_step, sequence::Frame, units::NodeId, wireframe::LID_MARGINS};

/// Number of sample points along and across an eye, and positions of the first and the last: shares of the eye's width, from the outer
/// corner to the inner one, and below the line between them.
const COLUMNS: usize = 20;
const ROWS: usize = 26;
const ALONG: (f64, f64) = (0.06, 0.94);
const BELOW: (f64, f64) = (-0.45, 0.32);
/// b, the height of the lashes, and h, the height above which skin does not move, over the eye's width.
const LASHES: f64 = 0.10;
const HEIGHT: f64 = 0.42;
/// Shares of the opening by which upper lids are down, and lower ones up, in the pictures.
const DOWN: Shares = Shares { count: 13, least: -0.2, most: 1.0 };
const UP: Shares = Shares { count: 4, least: 0.0, most: 0.45 };
/// Depth below its edge, over the eye's width, from which a rising lid's uncovered area is filled with the eyeball's appearance.
const UNCOVERED: f64 = 0.03;
/// Errors of the tracked eye corners that are tried, over the eye's width.
const OFF: [f64; 3] = [-0.03, 0.0, 0.03];
/// Advantage of the best picture over that at the tracked position: as a difference of correlations, and (`EXPLAINED`) as a share of the
/// latter's unexplained part. From the first value the lids begin to move there; at the second they are put there.
const ADVANTAGE: (f64, f64) = (0.02, 0.05);
const EXPLAINED: (f64, f64) = (0.12, 0.28);
/// Correlation with all pictures below which an eye counts as covered or turned away.
const UNLIKE: f64 = 0.45;
/// Smallest opening of the neutral eye, over its width and in px, and smallest width in px. On narrower eyes closing lids cannot be seen.
const LEAST_OPENING: (f64, f64) = (0.12, 3.0);
const LEAST_WIDTH: f64 = 12.0;
/// Smallest share of the opening that remains between lids that meet.
const MEETING: f64 = 0.02;
/// Standard deviation of an eye's grey levels below which it has no usable texture.
const FLAT: f64 = 2.0;

/// Shares of the opening, evenly spaced.
#[derive(Clone, Copy, Debug)]
struct Shares {
    count: usize,
    least: f64,
    most: f64,
}

impl Shares {
    /// Returns the share at an index, also between two indices.
    fn at(self, place: f64) -> f64 {
        self.least + (self.most - self.least) * place / (self.count - 1) as f64
    }

    /// Returns the index below a share, and the fraction of the way to the next index. Shares beyond the ends are clamped.
    fn place(self, share: f64) -> (usize, f64) {
        let at = ((share - self.least) / (self.most - self.least)).clamp(0.0, 1.0) * (self.count - 1) as f64;
        let k = (at as usize).min(self.count - 2);
        (k, at - k as f64)
    }
}

/// Both eyes in the neutral frame.
#[derive(Clone, Debug)]
pub struct Lids(Vec<Eye>);

/// One eye.
#[derive(Clone, Debug)]
struct Eye {
    /// Indices of the nodes of the upper and the lower lid, from the outer to the inner corner.
    upper: [usize; 5],
    lower: [usize; 5],
    /// 1 if "down" is to the right of the direction from the outer to the inner corner (image with y down), -1 if to the left.
    side: f64,
    /// Heights of the neutral lids at the nodes between the corners, below the line between these, over the eye's width.
    rest: [[f64; 3]; 2],
    /// Pictures of the eye, closed further and further, each of mean 0 and norm 1.
    pictures: Vec<Vec<f32>>,
}

/// Position of an eye in a frame.
#[derive(Clone, Copy, Debug)]
struct Place {
    outer: Point2<f64>,
    along: Vector2<f64>,
    down: Vector2<f64>,
}

impl Place {
    fn new(outer: Point2<f64>, inner: Point2<f64>, side: f64) -> Self {
        let along = inner - outer;
        Self { outer, along, down: Vector2::new(-along.y, along.x) * side }
    }

    fn at(&self, u: f64, v: f64) -> Point2<f64> {
        self.outer + self.along * u + self.down * v
    }

    /// Returns the share of the way from corner to corner, and the height below it, over the eye's width.
    fn of(&self, point: &Point2<f64>) -> [f64; 2] {
        let off = point - self.outer;
        [off.dot(&self.along), off.dot(&self.down)].map(|v| v / self.along.norm_squared())
    }
}

impl Lids {
    /// Creates the eyes of the neutral frame, whose nodes are at `nodes`. Leaves out eyes that are shut, tiny, or without texture.
    pub fn new(frame: &Frame, nodes: &[Point2<f64>]) -> Self {
        Self(LID_MARGINS.iter().filter_map(|margins| Eye::new(frame.image(), nodes, *margins)).collect())
    }

    /// Stops correcting the eye of a node that was set by hand.
    pub fn release(&mut self, node: NodeId) {
        self.0.retain(|eye| !eye.upper.iter().chain(&eye.lower).any(|&k| k == node.index()));
    }

    /// Puts the lids of a tracked frame where the eyes look as if they were.
    pub fn place(&self, frame: &Frame, nodes: &mut [TrackedNode]) {
        for eye in &self.0 {
            eye.place(frame.image(), nodes);
            eye.take_along(nodes);
        }
    }
}

impl Eye {
    fn new(image: &GrayImage, nodes: &[Point2<f64>], margins: [[u16; 5]; 2]) -> Option<Self> {
        let [upper, lower] = margins.map(|chain| chain.map(usize::from));
        let at = |k: usize| nodes.get(k).copied();
        let [outer, above, inner, below] = [at(upper[0])?, at(upper[2])?, at(upper[4])?, at(lower[2])?];
        let side = if (inner - outer).perp(&(below - above)) < 0.0 { -1.0 } else { 1.0 };
        let place = Place::new(outer, inner, side);
        let width = place.along.norm();
        let chain = |ids: [usize; 5]| ids.iter().map(|&k| Some(place.of(&at(k)?))).collect::<Option<Vec<_>>>();
        let (chain_above, chain_below) = (chain(upper)?, chain(lower)?);
        let inside = |chain: &[[f64; 2]]| [1, 2, 3].map(|k: usize| chain[k][1]);
        let rest = [inside(&chain_above), inside(&chain_below)];
        let opening = (rest[1][1] - rest[0][1]) * width;
        let enough = width >= LEAST_WIDTH && opening >= LEAST_OPENING.1 && opening >= LEAST_OPENING.0 * width;
        if !enough || !opening.is_finite() {
            return None;
        }
        // The lids' heights are the same in every row of every picture.
        let heights = columns().map(|u| [&chain_above, &chain_below].map(|chain| height_at(chain, u))).collect::<Vec<_>>();
        let picture = |k: usize| {
            let [down, up] = [DOWN.at((k % DOWN.count) as f64), UP.at((k / DOWN.count) as f64)];
            let levels = samples(|column, u, v| {
                let [lid, lower] = heights[column];
                let opening = (lower - lid).max(0.0);
                let (gone, raised) = (opening * down.min(1.0 - up), opening * up);
                let above = lid + gone - v;
                let source = if v > lower - raised {
                    v + raised
                } else if above <= 0.0 {
                    if gone < 0.0 { v.max(lid + UNCOVERED) } else { v }
                } else if above < LASHES {
                    lid - above
                } else {
                    lid - LASHES - (above - LASHES) * (HEIGHT - LASHES) / (HEIGHT - LASHES + gone)
                };
                level(image, place.at(u, source))
            });
            normalized(levels)
        };
        Some(Self { upper, lower, side, rest, pictures: (0..DOWN.count * UP.count).map(picture).collect::<Option<_>>()? })
    }

    /// Returns the shares of the neutral opening by which the upper lid is down and the lower one up.
    fn shut(&self, place: &Place, nodes: &[TrackedNode]) -> Option<[f64; 2]> {
        let mut sums = [0.0; 2];
        for k in 0..3 {
            let opening = self.opening(k);
            for ((sum, lid), sign) in sums.iter_mut().zip([(self.upper, 0), (self.lower, 1)]).zip([1.0, -1.0]) {
                *sum += sign * (place.of(&nodes.get(lid.0[k + 1])?.position)[1] - self.rest[lid.1][k]) / opening / 3.0;
            }
        }
        sums.iter().all(|sum| sum.is_finite()).then_some(sums)
    }

    /// Returns the neutral opening at one of the three nodes between the corners, over the eye's width.
    fn opening(&self, k: usize) -> f64 {
        (self.rest[1][k] - self.rest[0][k]).max(1e-3)
    }

    /// Returns where the corners of the eye are.
    fn seat(&self, nodes: &[TrackedNode]) -> Option<Place> {
        let [outer, inner] = [0, 4].map(|k: usize| nodes.get(self.upper[k]));
        Some(Place::new(outer?.position, inner?.position, self.side))
    }

    fn place(&self, image: &GrayImage, nodes: &mut [TrackedNode]) {
        let Some(place) = self.seat(nodes) else { return };
        let Some(tracked) = self.shut(&place, nodes) else { return };
        let Some(([down, up], share)) = self.look(image, &place, tracked) else { return };
        let down = down.min(1.0 - MEETING - up);
        for k in 0..3 {
            let opening = self.opening(k);
            let there =
                [(self.upper[k + 1], self.rest[0][k] + down * opening), (self.lower[k + 1], self.rest[1][k] - up * opening)];
            for (node, there) in there {
                let Some(node) = nodes.get_mut(node) else { continue };
                node.position += place.down * (share * (there - place.of(&node.position)[1]));
                if share >= 0.5 {
                    // The lid was found by the look of its eye, not by its own window.
                    (node.state, node.residual, node.evidence, node.skin) = (NodeState::Tracked, None, None, None);
                }
            }
        }
    }

    /// Takes along the middle of either lid if it stays behind the quarters.
    fn take_along(&self, nodes: &mut [TrackedNode]) {
        let Some(place) = self.seat(nodes) else { return };
        for (lid, rest) in [self.upper, self.lower].into_iter().zip(self.rest) {
            let gone = |k: usize| Some(place.of(&nodes.get(lid[k + 1])?.position)[1] - rest[k]);
            let [Some(outer), Some(middle), Some(inner)] = [0, 1, 2].map(gone) else { return };
            let off = least_middle([outer, middle, inner]) - middle;
            if off.is_finite() {
                nodes[lid[2]].position += place.down * off;
            }
        }
    }

    /// Returns how far the eye looks closed from above and below, in shares of its opening, and how far the lids go there, as a share.
    /// `None` where they stay as tracked.
    fn look(&self, image: &GrayImage, place: &Place, tracked: [f64; 2]) -> Option<([f64; 2], f64)> {
        let go = |values: &[f64]| {
            let (best, value) = greatest(values);
            let tracked = between(values, tracked);
            let explained = (value - tracked) / (1.0 - tracked).max(1e-6);
            let share = smooth_step(ADVANTAGE.0, ADVANTAGE.1, value - tracked) * smooth_step(EXPLAINED.0, EXPLAINED.1, explained);
            (best, value, share)
        };
        let mut most = self.correlations(image, place, [0.0; 2])?;
        // The tracker is right in most frames; then one comparison is enough.
        if go(&most).2 <= 0.0 {
            return None;
        }
        for off in OFF.into_iter().flat_map(|v| OFF.map(|u| [u, v])).filter(|off| *off != [0.0; 2]) {
            if let Some(found) = self.correlations(image, place, off) {
                most.iter_mut().zip(found).for_each(|(most, found)| *most = most.max(found));
            }
        }
        let (best, value, share) = go(&most);
        (value >= UNLIKE && share > 0.0).then(|| (peak(&most, best), share))
    }

    /// Returns the correlations of the eye, shifted by a small offset, with its pictures.
    fn correlations(&self, image: &GrayImage, place: &Place, [off_u, off_v]: [f64; 2]) -> Option<Vec<f64>> {
        let seen = normalized(samples(|_, u, v| level(image, place.at(u + off_u, v + off_v))))?;
        Some(self.pictures.iter().map(|picture| f64::from(dot(picture, &seen))).collect())
    }
}

/// Returns how far the middle of a lid goes when it does not stay behind the quarters: as far as these on the mean.
fn least_middle([outer, middle, inner]: [f64; 3]) -> f64 {
    // One quarter alone proves nothing.
    if outer * inner <= 0.0 {
        return middle;
    }
    let least = f64::midpoint(outer.abs(), inner.abs()).min(2.0 * outer.abs().min(inner.abs())) * outer.signum();
    let way = middle / least;
    if way >= 1.0 {
        return middle;
    }
    // A middle that clearly goes the other way did not stay behind.
    middle + (least - middle) * (1.0 + way.min(0.0)).max(0.0)
}

/// Returns the position of sample `k` of `count`, evenly spaced.
fn spread((from, to): (f64, f64), k: usize, count: usize) -> f64 {
    from + (to - from) * k as f64 / (count - 1) as f64
}

/// Returns the columns of sample points, as shares of the eye's width.
fn columns() -> impl Iterator<Item = f64> {
    (0..COLUMNS).map(|column| spread(ALONG, column, COLUMNS))
}

/// Evaluates a function of the sample point and its column index at all sample points, row by row.
fn samples(value: impl Fn(usize, f64, f64) -> f32) -> Vec<f32> {
    let value = &value;
    let row = |row: usize| columns().enumerate().map(move |(column, u)| value(column, u, spread(BELOW, row, ROWS)));
    (0..ROWS).flat_map(row).collect()
}

/// Returns the height of a lid, whose nodes ascend along the eye, at a position along it.
fn height_at(chain: &[[f64; 2]], u: f64) -> f64 {
    let pair = chain.windows(2).find(|pair| u <= pair[1][0]).or(chain.windows(2).last());
    let Some([from, to]) = pair.map(|pair| [pair[0], pair[1]]) else { return 0.0 };
    from[1] + (to[1] - from[1]) * ((u - from[0]) / (to[0] - from[0]).max(1e-9)).clamp(0.0, 1.0)
}

/// Returns the interpolated grey level; beyond the border, that of the border.
fn level(image: &GrayImage, at: Point2<f64>) -> f32 {
    let (width, height) = image.dimensions();
    if width == 0 || height == 0 {
        return 0.0;
    }
    let cell = |at: f64, size: u32| {
        let at = if at.is_finite() { at.clamp(0.0, f64::from(size - 1)) } else { 0.0 };
        let first = (at as u32).min(size.saturating_sub(2));
        (first, (first + 1).min(size - 1), (at - f64::from(first)) as f32)
    };
    let ((x, right, s), (y, low, t)) = (cell(at.x, width), cell(at.y, height));
    let pixel = |x: u32, y: u32| f32::from(image.get_pixel(x, y).0[0]);
    let row = |y: u32| pixel(x, y) + (pixel(right, y) - pixel(x, y)) * s;
    row(y) + (row(low) - row(y)) * t
}

/// Normalizes levels to mean 0 and norm 1; `None` where they hardly differ.
fn normalized(mut levels: Vec<f32>) -> Option<Vec<f32>> {
    let count = levels.len() as f32;
    let mean = levels.iter().sum::<f32>() / count;
    levels.iter_mut().for_each(|level| *level -= mean);
    let norm = dot(&levels, &levels).sqrt();
    if f64::from(norm / count.sqrt()) < FLAT {
        return None;
    }
    levels.iter_mut().for_each(|level| *level /= norm);
    Some(levels)
}

/// Returns the sum of products, in lanes that are always added in the same order.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0_f32; 8];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a.iter().zip(b) {
        for k in 0..8 {
            lanes[k] += a[k] * b[k];
        }
    }
    lanes.iter_mut().zip(a_rest.iter().zip(b_rest)).for_each(|(sum, (a, b))| *sum += a * b);
    lanes.iter().sum()
}

/// Returns index and value of the greatest correlation, the first of equals.
fn greatest(values: &[f64]) -> (usize, f64) {
    values.iter().copied().enumerate().fold((0, f64::NEG_INFINITY), |best, (k, v)| if v > best.1 { (k, v) } else { best })
}

/// Returns the correlation with a picture between the available ones.
fn between(values: &[f64], [down, up]: [f64; 2]) -> f64 {
    let ((k, s), (row, t)) = (DOWN.place(down), UP.place(up));
    let value = |row: usize, k: usize| values.get(row * DOWN.count + k).copied().unwrap_or(0.0);
    let along = |row: usize| value(row, k) + (value(row, k + 1) - value(row, k)) * s;
    along(row) + (along(row + 1) - along(row)) * t
}

/// Returns the shares of the opening at which the correlations peak, from parabolas through the neighbours of the greatest.
fn peak(values: &[f64], best: usize) -> [f64; 2] {
    let along = |k: usize, step: usize, shares: Shares| {
        let beside = |k: Option<usize>| k.and_then(|k| values.get(k)).copied();
        let before = beside(if k > 0 { best.checked_sub(step) } else { None });
        let after = beside((k + 1 < shares.count).then_some(best + step));
        let off = match (before, after) {
            (Some(before), Some(after)) => {
                let bend = before - 2.0 * values[best] + after;
                if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 }
            }
            _ => 0.0,
        };
        shares.at(k as f64 + off)
    };
    [along(best % DOWN.count, 1, DOWN), along(best / DOWN.count, DOWN.count, UP)]
}

#[cfg(test)]
mod tests {
    use image::Luma;

    use super::*;

    /// Width of the eye, and the heights of its lids in the middle, px.
    const WIDTH: f64 = 60.0;
    const LIDS: (f64, f64) = (-14.0, 6.0);

    /// Height of a lid below the line between the corners at a share of that line: a parabola.
    fn arc(middle: f64, u: f64) -> f64 {
        4.0 * middle * u * (1.0 - u)
    }

    /// Draws an eye with a dark iris `gaze` px from the middle, under a lid that is down by a share `shut`: grained skin that darkens
    /// downwards, lashes on the upper lid's edge, the white of the eye.
    fn eye(number: u32, shut: f64, gaze: f64) -> Frame {
        let level = |x: u32, y: u32| {
            let (x, y) = (f64::from(x) - 40.0, f64::from(y) - 60.0);
            let u = x / WIDTH;
            let grain = 6.0 * (x * 0.7).sin() * (y * 0.45).cos();
            let (upper, lower) = (arc(LIDS.0 + shut * (LIDS.1 - LIDS.0), u), arc(LIDS.1, u));
            if !(0.0..=1.0).contains(&u) || y > lower || y < upper - 3.0 {
                150.0 - 0.4 * y + grain
            } else if y < upper {
                40.0
            } else if (x - WIDTH / 2.0 - gaze).hypot(y + 5.0) < 10.0 {
                60.0
            } else {
                215.0
            }
        };
        Frame::new(number, GrayImage::from_fn(140, 110, |x, y| Luma([level(x, y).round() as u8])))
    }

    /// The nodes of Candide-3 with the subject's left eye at the position of [`eye`], in a mirrored image: the outer corner is on the left.
    fn nodes(shut: f64) -> Vec<TrackedNode> {
        let mut nodes = vec![TrackedNode::new(Point2::origin(), NodeState::Fitted, None); 113];
        let [upper, lower] = LID_MARGINS[0];
        for (chain, middle) in [(upper, LIDS.0 + shut * (LIDS.1 - LIDS.0)), (lower, LIDS.1)] {
            for (k, node) in chain.into_iter().enumerate() {
                let u = k as f64 / 4.0;
                nodes[usize::from(node)].position = Point2::new(40.0 + u * WIDTH, 60.0 + arc(middle, u));
            }
        }
        nodes
    }

    fn lids() -> Lids {
        let positions: Vec<_> = nodes(0.0).iter().map(|n| n.position).collect();
        Lids::new(&eye(1, 0.0, 0.0), &positions)
    }

    /// Share of the opening that is left between the middles of the lids.
    fn opening(nodes: &[TrackedNode]) -> f64 {
        (nodes[22].position.y - nodes[21].position.y) / (LIDS.1 - LIDS.0)
    }

    #[test]
    fn a_lid_that_the_tracker_lost_closes() {
        for shut in [0.5, 0.8, 1.0] {
            // The tracker lost the lid after a fifth of its way.
            let mut found = nodes(0.2);
            found[21].state = NodeState::Recovered(super::super::LossReason::Klt);
            lids().place(&eye(2, shut, 0.0), &mut found);
            let left = opening(&found);
            assert!(
                (left - (1.0 - shut).max(MEETING)).abs() < 0.12,
                "{left} of the opening remains where {shut} should be closed"
            );
            assert_eq!(found[21].state, NodeState::Tracked);
            // Corners do not move, and neither do nodes that are not on a lid.
            assert!(found[20] == nodes(0.0)[20] && found[23] == nodes(0.0)[23] && found[30] == nodes(0.0)[30]);
        }
    }

    #[test]
    fn well_tracked_lids_are_unchanged() {
        for (shut, gaze) in [(0.0, 0.0), (0.0, 8.0), (0.0, -12.0), (0.3, 0.0), (0.6, 3.0)] {
            let mut found = nodes(shut);
            lids().place(&eye(2, shut, gaze), &mut found);
            let moved = (opening(&found) - opening(&nodes(shut))).abs();
            assert!(moved < 0.06, "shut by {shut}, gaze {gaze}: {moved}");
        }
    }

    #[test]
    fn a_lid_that_stayed_down_comes_up_with_the_eye_open() {
        let mut found = nodes(0.5);
        lids().place(&eye(2, 0.0, 0.0), &mut found);
        assert!((opening(&found) - 1.0).abs() < 0.08, "{}", opening(&found));
    }

    #[test]
    fn a_middle_that_stays_behind_its_lid_is_taken_along() {
        for sign in [1.0, -1.0] {
            let least = |gone: [f64; 3]| sign * least_middle(gone.map(|v| sign * v));
            approx::assert_relative_eq!(least([0.2, 0.0, 0.3]), 0.25);
            approx::assert_relative_eq!(least([0.2, 0.1, 0.2]), 0.2);
            // Half against the quarters' way, half of it is made good; fully against it, none.
            approx::assert_relative_eq!(least([0.2, -0.1, 0.2]), 0.05);
            for alone in [[0.2, -0.2, 0.2], [0.1, -0.3, 0.1], [0.2, 0.3, 0.2], [0.0; 3], [0.2, 0.0, 0.0], [0.3, -0.1, -0.2]] {
                approx::assert_relative_eq!(least(alone), alone[1]);
            }
        }
        let mut found = nodes(-0.2);
        found[21].position = nodes(0.0)[21].position;
        lids().0.iter().for_each(|eye| eye.take_along(&mut found));
        assert!((opening(&found) - 1.15).abs() < 0.01, "{}", opening(&found));
    }

    #[test]
    fn light_does_not_count() {
        let darker = eye(2, 1.0, 0.0);
        let image = GrayImage::from_fn(140, 110, |x, y| Luma([darker.image().get_pixel(x, y).0[0] / 2 + 20]));
        let mut found = nodes(0.2);
        lids().place(&Frame::new(2, image), &mut found);
        assert!(opening(&found) < 0.12, "{}", opening(&found));
    }

    #[test]
    fn shut_tiny_and_flat_eyes_and_odd_nodes_are_left_alone() {
        let frame = eye(1, 0.0, 0.0);
        let positions = |scale: f64, shut: f64| nodes(shut).iter().map(|n| n.position * scale).collect::<Vec<_>>();
        assert!(Lids::new(&frame, &positions(1.0, 0.9)).0.is_empty(), "shut");
        assert!(Lids::new(&frame, &positions(0.15, 0.0)).0.is_empty(), "9 px wide");
        assert!(Lids::new(&frame, &positions(1.0, 0.0)[..50]).0.is_empty(), "too few nodes");
        let flat = Frame::new(1, GrayImage::from_pixel(140, 110, Luma([90])));
        assert!(Lids::new(&flat, &positions(1.0, 0.0)).0.is_empty(), "flat");
        let mut odd = nodes(0.2);
        odd[20].position.x = f64::NAN;
        lids().place(&eye(2, 1.0, 0.0), &mut odd);
        assert_eq!(odd[21], nodes(0.2)[21]);
        // Nothing but skin where the eye should be.
        let mut covered = nodes(0.2);
        lids().place(&flat, &mut covered);
        assert_eq!(covered, nodes(0.2));
    }

    #[test]
    fn an_eye_with_a_node_set_by_hand_is_left_alone() {
        let mut lids = lids();
        lids.release(NodeId(53));
        assert_eq!(lids.0.len(), 1);
        lids.release(NodeId(22));
        assert!(lids.0.is_empty());
    }
}
