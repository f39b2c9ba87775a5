//! Detects the line where closed lips meet on the photograph and moves the nodes to it.
//!
//! A fit knows the corners of a mouth to two or three percent of the eye distance. If the cut lies beside the real line, each lip takes a piece of
//! the other along, and the lips part at a false corner. The line is the darkest one from corner to corner, with lighter lips above and below.
//! It has three parameters, the vertical shifts of both ends and of the middle relative to them, so shadows and highlights affect it little.

use nalgebra::Point2;

use super::{
    Texture,
    layout::{CLOSED_GAP, Frame},
    mouth::luma,
};

/// Corners of the mouth: the inner and the outer node.
const CORNERS: [[usize; 2]; 2] = [[88, 31], [89, 64]];
/// Nodes of the upper and the lower inner edge of the lips between the corners, and of their outer edges.
const PAIRS: [[usize; 4]; 3] = [[81, 83, 33, 85], [87, 40, 7, 8], [82, 84, 66, 86]];
/// Number of positions along the line, and (`STEP`) step across it in eye distances.
const PLACES: usize = 25;
const STEP: f64 = 0.004;
/// Search range of the ends and of any point of the line, of the middle relative to the ends (`BEND`), and step of both (`TRIED`), in eye
/// distances.
const REACH: f64 = 0.060;
const BEND: f64 = 0.024;
const TRIED: f64 = 0.006;
/// Expected error of the line at its ends and in its middle, in eye distances. Such a shift costs [`PRIOR`], a fraction of the skin's
/// brightness. On 30 faces with lines displaced by this much, the result is within 0.003 of the undisturbed one.
const EXPECTED: (f64, f64) = (0.026, 0.012);
const PRIOR: f64 = 0.007;
/// Half the height of the dark line, and the distances at which the lips above and below it are sampled, in eye distances.
const DARK: f64 = 0.006;
const LIPS: (f64, f64) = (0.012, 0.036);
/// Limits of the contribution of one position, relative to the brightness of the skin.
const SAY: (f64, f64) = (-0.10, 0.35);
/// Largest fraction of a lip's height by which the line may move into it.
const INTO_LIP: f64 = 0.6;

/// Downward shift of the line in eye distances: at the corner on the subject's left, at the other one, and in the middle relative to both.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Shift {
    ends: [f64; 2],
    middle: f64,
}

impl Shift {
    /// Shift at a fraction of the way from the corner on the subject's left to the other one.
    fn at(self, along: f64) -> f64 {
        let [from, to] = self.ends;
        from + (to - from) * along + self.middle * (1.0 - (2.0 * along - 1.0).powi(2))
    }

    fn cost(self) -> f64 {
        let [from, to] = self.ends;
        PRIOR * ((from.powi(2) + to.powi(2)) / EXPECTED.0.powi(2) + (self.middle / EXPECTED.1).powi(2))
    }
}

/// Moves the line where closed lips meet to where the photograph shows it. It stays if `is_set` returns true for a corner or a node between
/// them (set by a person), because a line bent between fixed ends would fold the skin at the corners.
pub fn place_lip_line(nodes: &mut [Point2<f64>], photograph: &Texture, is_set: impl Fn(u16) -> bool, frame: &Frame) {
    let unit = frame.eye_distance;
    let height = |n: usize| frame.height(&nodes[n]);
    let is_open = PAIRS.iter().any(|&[upper, lower, ..]| height(lower) - height(upper) >= CLOSED_GAP * unit);
    let mut line_nodes = PAIRS.iter().flat_map(|pair| &pair[..2]).chain(CORNERS.as_flattened());
    if is_open || line_nodes.any(|&n| is_set(n as u16)) {
        return;
    }
    let [left, right] = CORNERS.map(|corner| nodes[corner[0]]);
    let chord = right - left;
    let along = |p: &Point2<f64>| (p - left).dot(&chord) / chord.norm_squared().max(1e-12);
    let knots: Vec<(f64, Point2<f64>)> = std::iter::once((0.0, left))
        .chain(PAIRS.iter().map(|&[upper, lower, ..]| nalgebra::center(&nodes[upper], &nodes[lower])).map(|p| (along(&p), p)))
        .chain([(1.0, right)])
        .collect();
    if !knots.windows(2).all(|pair| pair[0].0 < pair[1].0) {
        return;
    }
    // Range of the line, up and down, at each pair of nodes.
    let room: Vec<(f64, [f64; 2])> = PAIRS
        .iter()
        .zip(&knots[1..])
        .map(|(&[.., above, below], (at, line))| {
            let line = frame.height(line);
            (*at, [(height(above) - line) / unit * INTO_LIP, (height(below) - line) / unit * INTO_LIP])
        })
        .collect();
    let table = Table::new(&knots, photograph, frame);
    let Some(shift) = best(&table, &room) else { return };
    let down = frame.down.into_inner() * unit;
    for ([inner, outer], end) in CORNERS.into_iter().zip(shift.ends) {
        nodes[inner] += down * end;
        nodes[outer] += down * end;
    }
    for (pair, (at, _)) in PAIRS.iter().zip(&knots[1..]) {
        pair[..2].iter().for_each(|&n| nodes[n] += down * shift.at(*at));
    }
}

/// Depth of the valley of brightness at each position of the line, for each shift.
struct Table {
    /// For each position: its fraction of the way, and a value for each step from [`REACH`] above to [`REACH`] below.
    places: Vec<(f64, Vec<f64>)>,
}

impl Table {
    fn new(knots: &[(f64, Point2<f64>)], photograph: &Texture, frame: &Frame) -> Self {
        let steps = |length: f64| (length / STEP).round() as i32;
        let (reach, margin) = (steps(REACH), steps(REACH + LIPS.1) + 1);
        let down = frame.down.into_inner() * (STEP * frame.eye_distance);
        let profiles: Vec<(f64, Vec<f64>)> = (0..PLACES)
            .map(|k| {
                let share = (k as f64 + 0.5) / PLACES as f64;
                let at = on_line(knots, share);
                let level = |step: i32| f64::from(luma(photograph.sample(at + down * f64::from(step))));
                (share, (-margin..=margin).map(level).collect())
            })
            .collect();
        let mut levels: Vec<f64> = profiles.iter().flat_map(|(_, profile)| profile).copied().collect();
        levels.sort_by(f64::total_cmp);
        let skin = levels.get(levels.len() / 2).copied().unwrap_or(0.0).max(20.0);
        let valley = |profile: &[f64], step: i32| {
            // Mean level between two distances from the line, both included.
            let mean = |from: i32, to: i32| {
                let range = (margin + step + from) as usize..=(margin + step + to) as usize;
                let values = &profile[range];
                values.iter().sum::<f64>() / values.len() as f64
            };
            let (near, far) = (steps(LIPS.0), steps(LIPS.1));
            let dark = mean(-steps(DARK), steps(DARK));
            ((f64::midpoint(mean(-far, -near), mean(near, far)) - dark) / skin).clamp(SAY.0, SAY.1)
        };
        let rows = |(share, profile): (f64, Vec<f64>)| (share, (-reach..=reach).map(|step| valley(&profile, step)).collect());
        Self { places: profiles.into_iter().map(rows).collect() }
    }

    /// Mean over the positions minus the cost of the shift; `None` outside the search range.
    fn score(&self, shift: Shift) -> Option<f64> {
        let mut sum = 0.0;
        for (share, values) in &self.places {
            let at = (shift.at(*share) + REACH) / STEP;
            let last = values.len() - 1;
            if !(-1e-9..=last as f64 + 1e-9).contains(&at) {
                return None;
            }
            let k = (at.max(0.0) as usize).min(last - 1);
            sum += values[k] + (values[k + 1] - values[k]) * (at - k as f64);
        }
        Some(sum / self.places.len() as f64 - shift.cost())
    }
}

/// A point of the line through knots, at a fraction of the way between its ends.
fn on_line(knots: &[(f64, Point2<f64>)], share: f64) -> Point2<f64> {
    let piece = knots.windows(2).find(|pair| share <= pair[1].0).unwrap_or(&knots[knots.len() - 2..]);
    let ((from, a), (to, b)) = (piece[0], piece[1]);
    a + (b - a) * ((share - from) / (to - from))
}

/// The best shift that keeps the line between the outer edges of the lips; `None` if no shift is better than none.
fn best(table: &Table, room: &[(f64, [f64; 2])]) -> Option<Shift> {
    let count = |reach: f64| (reach / TRIED).round() as i32;
    let range = |reach: f64| -count(reach)..=count(reach);
    let mut best = (table.score(Shift::default())?, Shift::default());
    for from in range(REACH) {
        for to in range(REACH) {
            for middle in range(BEND) {
                let [from, to, middle] = [from, to, middle].map(|steps| f64::from(steps) * TRIED);
                let tried = Shift { ends: [from, to], middle };
                let fits = |&(at, [above, below]): &(f64, [f64; 2])| (above..=below).contains(&tried.at(at));
                if !room.iter().all(fits) {
                    continue;
                }
                if let Some(score) = table.score(tried).filter(|score| *score > best.0) {
                    best = (score, tried);
                }
            }
        }
    }
    (best.1 != Shift::default()).then_some(best.1)
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::{geometry::polygon::distance_to_line, warp::test_face::nodes};

    /// Skin with lips that meet in a dark line through the nodes.
    fn drawn(nodes: &[Point2<f64>]) -> Texture {
        let line: Vec<Point2<f64>> = [31, 88, 81, 87, 82, 89, 64].map(|n: usize| nodes[n]).to_vec();
        Texture::new(&RgbImage::from_fn(300, 380, |x, y| {
            let off = distance_to_line(&line, &Point2::new(f64::from(x), f64::from(y)));
            if off < 1.2 {
                Rgb([70, 30, 30])
            } else if off < 7.0 {
                Rgb([170, 90, 90])
            } else {
                Rgb([205, 160, 140])
            }
        }))
    }

    fn closed() -> (Vec<Point2<f64>>, Frame) {
        let given = nodes();
        let frame = Frame::of(&given).unwrap();
        (super::super::layout::source(&given, &frame).0, frame)
    }

    #[test]
    fn a_line_beside_the_mouth_goes_to_where_the_lips_meet() {
        let (truth, frame) = closed();
        let picture = drawn(&truth);
        let line = [88, 81, 87, 82, 89, 31, 64];
        for (left, right) in [(4.0, 0.0), (-3.0, 3.0), (-4.0, -2.5)] {
            let mut wrong = truth.clone();
            for n in [88, 31, 89, 64, 81, 83, 87, 40, 82, 84] {
                let share = ((truth[88].x - truth[n].x) / (truth[88].x - truth[89].x)).clamp(0.0, 1.0);
                wrong[n].y += left + (right - left) * share;
            }
            let error = |nodes: &[Point2<f64>]| line.iter().map(|&n| (nodes[n].y - truth[n].y).abs()).sum::<f64>() / 7.0;
            let mut placed = wrong.clone();
            place_lip_line(&mut placed, &picture, |_| false, &frame);
            assert!(error(&wrong) > 1.5 && error(&placed) < 0.8, "{left} {right}: {} of {}", error(&placed), error(&wrong));
            assert!((0..placed.len()).all(|n| line.contains(&n) || [83, 40, 84].contains(&n) || placed[n] == wrong[n]));
            // Nothing moves if a person placed a corner or the middle.
            for placed in [31, 89, 40] {
                let mut set = wrong.clone();
                place_lip_line(&mut set, &picture, |n| n == placed, &frame);
                assert_eq!(set, wrong);
            }
        }
    }

    #[test]
    fn nothing_moves_without_a_line_and_in_an_open_mouth() {
        let (truth, frame) = closed();
        let plain = Texture::new(&RgbImage::from_pixel(300, 380, Rgb([205, 160, 140])));
        let mut placed = truth.clone();
        place_lip_line(&mut placed, &plain, |_| false, &frame);
        assert_eq!(placed, truth);
        let mut open = truth.clone();
        for n in [40, 83, 84] {
            open[n].y += 0.08 * frame.eye_distance;
        }
        let mut placed = open.clone();
        place_lip_line(&mut placed, &drawn(&truth), |_| false, &frame);
        assert_eq!(placed, open);
    }

    #[test]
    fn a_shift_is_what_its_three_numbers_say() {
        let shift = Shift { ends: [0.02, -0.01], middle: 0.03 };
        for (along, expected) in [(0.0, 0.02), (1.0, -0.01), (0.5, 0.035)] {
            assert!((shift.at(along) - expected).abs() < 1e-12);
        }
        // One deviation at one end costs as much as one in the middle.
        let one = |shift: Shift| (shift.cost() - PRIOR).abs() < 1e-12;
        assert!(one(Shift { ends: [EXPECTED.0, 0.0], middle: 0.0 }) && one(Shift { ends: [0.0; 2], middle: EXPECTED.1 }));
    }
}
