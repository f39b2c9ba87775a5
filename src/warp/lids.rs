//! Upper lids, put where the photograph shows them, and the corners between the lips.
//!
//! A fit knows the edge of an upper lid to a few percent of the eye distance. Skin that is cut a little above the lashes leaves them on the
//! eyeball when the lid rises; cut below them, it takes white along. So the edge is looked for in the picture, as the line from corner to
//! corner along which dark lashes lie above and the white of the eye below. It moves as a whole, an arch over the corners that may lean
//! to one side: two numbers for an eye, which a lash or a highlight does not sway.

use nalgebra::{Point2, Vector2};

use super::{
    Texture,
    layout::{self, Frame, OPENINGS, OpeningNodes},
    lip_line::place_lip_line,
    mouth::whiteness,
    parted::place_lower_lip,
};

/// How far up and down the middle of a lid is looked for, and how far it may lean, over the eye distance.
const REACH: (f64, f64) = (0.048, 0.032);
/// Step of both, over the eye distance.
const STEP: f64 = 0.004;
/// Deviation of both that costs [`PRIOR`], over the eye distance.
const EXPECTED: f64 = 0.024;
/// Share of the brightness of the white that a deviation costs.
const PRIOR: f64 = 0.02;
/// Band above the edge where lashes are, and below where they are not, over the eye distance.
const LASHES: (f64, f64) = (0.004, 0.026);
const BELOW: (f64, f64) = (0.004, 0.028);
/// Limits of a place's say, over the brightness of the white: a highlight in a pupil counts no more than white beside lashes.
const SAY: (f64, f64) = (-0.15, 0.40);
/// Share of the way between the corners that is looked at.
const SEEN: (f64, f64) = (0.12, 0.88);
/// Most of the opening that a lid may go down.
const MOST_SHUT: f64 = 0.3;

/// How far from where Candide-3 has them the inner corners of the mouth lie towards the outer ones: lips part to their end. What is left of the
/// line in which they meet goes on beyond the opening, as a dark spur.
const CORNERS: f64 = 0.6;

/// The nodes with the upper lids, the line in which closed lips meet and a parted lower lip where the picture shows them, and lips that end near
/// their corners; a node of
/// which `is_set` says that a person placed it stays.
pub fn placed_edges(nodes: &[Point2<f64>], photograph: &Texture, is_set: impl Fn(u16) -> bool) -> Vec<Point2<f64>> {
    let mut placed = nodes.to_vec();
    for (inner, outer) in [(88, 31), (89, 64)] {
        if !is_set(inner) {
            let way = placed[outer] - placed[usize::from(inner)];
            placed[usize::from(inner)] += way * CORNERS;
        }
    }
    let Some(frame) = Frame::of(nodes) else { return placed };
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

/// How far a lid is moved down, px.
#[derive(Clone, Copy, Default)]
struct Shift {
    middle: f64,
    lean: f64,
}

impl Shift {
    /// At a share of the way between the corners.
    fn at(self, along: f64) -> f64 {
        (4.0 * along * (1.0 - along)).max(0.0) * (self.middle + self.lean * (2.0 * along - 1.0))
    }
}

/// Share of the way from the outer to the inner corner.
fn place(eye: &OpeningNodes, nodes: &[Point2<f64>], point: &Point2<f64>) -> f64 {
    let (outer, inner) = (nodes[usize::from(eye.upper[0])], nodes[usize::from(eye.upper[4])]);
    let chord = inner - outer;
    (point - outer).dot(&chord) / chord.norm_squared().max(1e-12)
}

/// Steps of a profile to either side of a lid.
const STEPS: i32 = 24;

/// The brightness above and below a place of a lid.
struct Profile {
    along: f64,
    /// Sums of the whiteness from the top down, a value a step.
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

/// Where the lid is in the picture; `None` where nothing speaks for another place than it has.
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
