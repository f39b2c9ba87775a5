//! Detects upper lids, the lip line and a parted lower lip on the photograph and moves the nodes to them.
//!
//! A fit knows the edge of an upper lid to a few percent of the eye distance. A cut above the lashes leaves them on the eyeball when the lid
//! rises; a cut below them takes white along. The edge is therefore detected as the line from corner to corner with dark lashes above and
//! the white of the eye below. It moves as a whole, by an arch over the corners that may lean to one side: two parameters per eye, which a lash or a
//! highlight affects little.

use nalgebra::{Point2, Vector2};

use super::{
    Texture,
    layout::{self, Frame, OPENINGS, OpeningNodes},
    lip_line::place_lip_line,
    mouth::whiteness,
    parted::{part_lips, place_lower_lip},
};

/// Search range of the middle of a lid, up and down, and of its lean, in eye distances.
const REACH: (f64, f64) = (0.048, 0.032);
/// Step of both, over the eye distance.
const STEP: f64 = 0.004;
/// Deviation of both that costs [`PRIOR`], over the eye distance.
const EXPECTED: f64 = 0.024;
/// Cost of such a deviation, as a fraction of the brightness of the white.
const PRIOR: f64 = 0.02;
/// Band above the edge with lashes, and band below it without, in eye distances.
const LASHES: (f64, f64) = (0.004, 0.026);
const BELOW: (f64, f64) = (0.004, 0.028);
/// Limits of the contribution of one position, relative to the brightness of the white: a highlight in a pupil counts no more than white
/// beside lashes.
const SAY: (f64, f64) = (-0.15, 0.40);
/// Range between the corners that is used, as fractions of the way.
const SEEN: (f64, f64) = (0.12, 0.88);
/// Largest fraction of the opening by which a lid may move down.
const MOST_SHUT: f64 = 0.3;

/// Fraction of the way by which the inner corners of the mouth are moved from Candide-3's position towards the outer ones. Lips part up to
/// their end, and any rest of their line would extend beyond the opening as a dark spur.
const CORNERS: f64 = 0.6;

/// Returns the nodes with upper lids, the line of closed lips and a parted lower lip moved to where the picture shows them, and with the inner
/// corners of the mouth moved near the outer ones. Nodes for which `is_set` returns true were placed by a person and stay.
pub fn placed_edges(nodes: &[Point2<f64>], photograph: &Texture, is_set: impl Fn(u16) -> bool) -> Vec<Point2<f64>> {
    let mut placed = nodes.to_vec();
    for (inner, outer) in [(88, 31), (89, 64)] {
        if !is_set(inner) {
            let way = placed[outer] - placed[usize::from(inner)];
            placed[usize::from(inner)] += way * CORNERS;
        }
    }
    let Some(frame) = Frame::of(nodes) else { return placed };
    part_lips(&mut placed, photograph, &is_set, &frame);
    place_lip_line(&mut placed, photograph, &is_set, &frame);
    place_lower_lip(&mut placed, photograph, &is_set, &frame);
    for eye in &OPENINGS[1..] {
        if eye.upper[1..4].iter().any(|&n| is_set(n)) {
            continue;
        }
        if let Some(shift) = shift(eye, nodes, photograph, &frame) {
            for &n in &eye.upper[1..4] {
                let n = usize::from(n);
                placed[n] += frame.down.into_inner() * shift.at(place(eye, nodes, &nodes[n]));
            }
        }
    }
    placed
}

/// Downward shift of a lid.
#[derive(Clone, Copy, Default)]
struct Shift {
    middle: f64,
    lean: f64,
}

impl Shift {
    /// Shift at a fraction of the way between the corners.
    fn at(self, along: f64) -> f64 {
        (4.0 * along * (1.0 - along)).max(0.0) * (self.middle + self.lean * (2.0 * along - 1.0))
    }
}

/// Fraction of the way from the outer to the inner corner.
fn place(eye: &OpeningNodes, nodes: &[Point2<f64>], point: &Point2<f64>) -> f64 {
    let (outer, inner) = (nodes[usize::from(eye.upper[0])], nodes[usize::from(eye.upper[4])]);
    let chord = inner - outer;
    (point - outer).dot(&chord) / chord.norm_squared().max(1e-12)
}

/// Number of steps of a profile above and below a lid.
const STEPS: i32 = 24;

/// The whiteness above and below a point of a lid.
struct Profile {
    along: f64,
    /// Cumulative sums of the whiteness from the top down, one per step.
    sums: Vec<f64>,
}

impl Profile {
    fn new(photograph: &Texture, at: Point2<f64>, along: f64, step: Vector2<f64>) -> Self {
        let mut sum = 0.0;
        let mut sums = vec![0.0];
        for k in -STEPS..=STEPS {
            sum += f64::from(whiteness(photograph.sample(at + step * f64::from(k))));
            sums.push(sum);
        }
        Self { along, sums }
    }

    /// Mean between two distances below the lid, in steps.
    fn mean(&self, from: f64, to: f64) -> f64 {
        let sum = |distance: f64| {
            let place = (distance + f64::from(STEPS) + 0.5).clamp(0.0, (self.sums.len() - 1) as f64);
            let k = (place as usize).min(self.sums.len() - 2);
            self.sums[k] + (self.sums[k + 1] - self.sums[k]) * (place - k as f64)
        };
        (sum(to) - sum(from)) / (to - from)
    }
}

/// Detected shift of the lid, px; `None` if no other position is better.
fn shift(eye: &OpeningNodes, nodes: &[Point2<f64>], photograph: &Texture, frame: &Frame) -> Option<Shift> {
    let unit = frame.eye_distance;
    let upper = eye.upper.map(|n| nodes[usize::from(n)]);
    let down = frame.down.into_inner();
    let open = frame.height(&nodes[usize::from(eye.lower[2])]) - frame.height(&nodes[usize::from(eye.upper[2])]);
    let profiles: Vec<Profile> = layout::curve(&upper, &[6; 4])
        .into_iter()
        .map(|at| (at, place(eye, nodes, &at)))
        .filter(|(_, along)| (SEEN.0..SEEN.1).contains(along))
        .map(|(at, along)| Profile::new(photograph, at, along, down * (STEP * unit)))
        .collect();
    if profiles.len() < 6 || !(open > 0.0) {
        return None;
    }
    let mut whites: Vec<f64> = profiles.iter().map(|p| p.mean(3.0, 9.0)).collect();
    whites.sort_by(f64::total_cmp);
    let white = whites[whites.len() * 9 / 10].max(30.0);
    let steps = |lengths: (f64, f64)| (lengths.0 / STEP, lengths.1 / STEP);
    let (lashes, below) = (steps(LASHES), steps(BELOW));
    let score = |shift: Shift| {
        let one = |profile: &Profile| {
            let edge = shift.at(profile.along);
            let rise = profile.mean(edge + below.0, edge + below.1) - profile.mean(edge - lashes.1, edge - lashes.0);
            (rise / white).clamp(SAY.0, SAY.1)
        };
        let cost = (shift.middle.powi(2) + shift.lean.powi(2)) / (EXPECTED / STEP).powi(2);
        profiles.iter().map(one).sum::<f64>() / profiles.len() as f64 - PRIOR * cost
    };
    let count = |reach: f64| (reach / STEP).round() as i32;
    let mut best = (score(Shift::default()), Shift::default());
    for middle in -count(REACH.0)..=count(REACH.0) {
        for lean in -count(REACH.1)..=count(REACH.1) {
            let tried = Shift { middle: f64::from(middle), lean: f64::from(lean) };
            let found = score(tried);
            if found > best.0 && tried.middle * STEP * unit <= MOST_SHUT * open {
                best = (found, tried);
            }
        }
    }
    let px = STEP * unit;
    let found = Shift { middle: best.1.middle * px, lean: best.1.lean * px };
    (found.middle != 0.0 || found.lean != 0.0).then_some(found)
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::{geometry::polygon::inside, warp::test_face::nodes};

    /// Skin, whites between the lids, and three pixels of lashes along the upper ones.
    fn drawn(nodes: &[Point2<f64>]) -> Texture {
        let edges: Vec<[Vec<Point2<f64>>; 2]> = OPENINGS[1..]
            .iter()
            .map(|eye| {
                let curve = |list: [u16; 5]| layout::curve(&list.map(|n| nodes[usize::from(n)]), &[8; 4]);
                let upper = curve(eye.upper);
                let outline = upper.iter().copied().chain(curve(eye.lower).into_iter().rev()).collect();
                [upper, outline]
            })
            .collect();
        Texture::new(&RgbImage::from_fn(300, 380, |x, y| {
            let at = Point2::new(f64::from(x), f64::from(y));
            let lashes = |upper: &[Point2<f64>]| crate::geometry::polygon::distance_to_line(upper, &at) < 3.0;
            if edges.iter().any(|[_, outline]| inside(outline, &at)) {
                Rgb([225, 220, 215])
            } else if edges.iter().any(|[upper, _]| lashes(upper)) {
                Rgb([60, 45, 40])
            } else {
                Rgb([205, 160, 140])
            }
        }))
    }

    #[test]
    fn lids_that_a_fit_put_too_high_or_too_low_go_to_the_lashes() {
        let truth = nodes();
        let picture = drawn(&truth);
        for off in [-4.0, -2.5, 2.5] {
            let mut wrong = truth.clone();
            for eye in &OPENINGS[1..] {
                for (n, share) in eye.upper[1..4].iter().zip([0.75, 1.0, 0.75]) {
                    wrong[usize::from(*n)].y += off * share;
                }
            }
            let placed = placed_edges(&wrong, &picture, |_| false);
            for eye in &OPENINGS[1..] {
                let error = |nodes: &[Point2<f64>]| {
                    eye.upper[1..4].iter().map(|&n| (nodes[usize::from(n)] - truth[usize::from(n)]).norm()).sum::<f64>() / 3.0
                };
                assert!(error(&placed) < 1.2 && error(&wrong) > 1.9, "{off}: {} of {}", error(&placed), error(&wrong));
            }
            let set = placed_edges(&wrong, &picture, |n| n == 21);
            assert!(set[21] == wrong[21] && set[97] == wrong[97] && set[54] != wrong[54]);
        }
    }

    #[test]
    fn a_picture_without_lids_moves_nothing() {
        let plain = Texture::new(&RgbImage::from_pixel(300, 380, Rgb([205, 160, 140])));
        assert_eq!(placed_edges(&nodes(), &plain, |n| n == 88 || n == 89), nodes());
        let placed = placed_edges(&nodes(), &plain, |_| false);
        assert!((placed[88] - nodes()[31]).norm() < 0.71 * (nodes()[88] - nodes()[31]).norm());
    }
}
