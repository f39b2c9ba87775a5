//! Detects the irises of a photograph as circles.
//!
//! An iris is the circle across whose left and right arcs the brightness rises most (Daugman's integro-differential operator, *High
//! confidence visual recognition of persons*, PAMI 1993, over the arcs that no lid covers). The size of a human iris relative to the eye
//! distance hardly varies, and both irises of a person have one size. Searching both eyes together makes the result robust
//! to lashes and to a shadow in one corner.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Point2, Vector2};

use super::{eyeball::Eyeball, mouth::luma};

/// Radius of an iris, in eye distances: expected value (11.7 of 63 mm), and the deviation that costs one unit.
const RADIUS: (f64, f64) = (0.092, 0.009);
/// Range of tested radii, in eye distances, and their number.
const RADII: (f64, f64) = (0.074, 0.116);
const SIZES: usize = 12;
/// Search range of the centre around the iris nodes, in eye distances: across and along the face's vertical.
const REACH: (f64, f64) = (0.09, 0.06);
/// Steps of the search, in eye distances: the first one, and the one around the best result.
const STEPS: (f64, f64) = (0.012, 0.004);
/// Score (fraction of the brightness of the white) that one unit of each prior costs.
const PRIOR: f64 = 0.03;
/// Deviation of the centre from the iris nodes that costs one unit, in eye distances.
const CENTRE: f64 = 0.05;
/// Least rise of brightness across the outline for a valid circle, relative to the white.
const LEAST_RISE: f64 = 0.05;
/// Half the angle of the arcs to the left and right, radians.
const ARC: f64 = 0.8;
/// Number of positions on each arc.
const PLACES: usize = 11;

/// An iris, px.
#[derive(Clone, Copy, Debug)]
pub struct Circle {
    pub centre: Point2<f64>,
    pub radius: f64,
    score: f64,
}

/// The search for the iris of one eye.
pub struct Search<'a> {
    eye: &'a Eyeball,
    levels: Vec<f32>,
    /// Brightness of the white.
    white: f64,
    across: Vector2<f64>,
    down: Vector2<f64>,
}

/// Detects the irises of two eyes; both get one size if both are found.
pub fn both(eyes: &[Option<Search<'_>>; 2]) -> [Option<Circle>; 2] {
    let found: [Vec<Option<Circle>>; 2] = [0, 1].map(|k: usize| match &eyes[k] {
        Some(eye) => (0..SIZES).map(|size| eye.best(size)).collect(),
        None => vec![None; SIZES],
    });
    let score = |circle: &Option<Circle>| circle.as_ref().map_or(f64::NEG_INFINITY, |c| c.score);
    let own = [0, 1].map(|k: usize| found[k].iter().max_by(|a, b| score(a).total_cmp(&score(b))).copied().flatten());
    // A best result at the smallest radius is only the part of an iris that narrow lids show.
    let rises = |k: usize| match (&eyes[k], own[k].filter(|c| found[k][0].is_none_or(|least| c.score > least.score))) {
        (Some(eye), Some(circle)) => eye.rise(circle.centre, circle.radius).is_some_and(|rise| rise >= LEAST_RISE),
        _ => false,
    };
    match (rises(0), rises(1)) {
        (true, true) => {
            let joint = |size: &usize| score(&found[0][*size]) + score(&found[1][*size]);
            let size = (0..SIZES).max_by(|a, b| joint(a).total_cmp(&joint(b))).unwrap_or_default();
            [0, 1].map(|k: usize| found[k][size].or(own[k]))
        }
        (left, right) => [own[0].filter(|_| left), own[1].filter(|_| right)],
    }
}

impl<'a> Search<'a> {
    /// Prepares the search around the iris nodes; `None` if too little of the eye is visible.
    pub fn new(eye: &'a Eyeball, photograph: &[[f32; 3]], down: Vector2<f64>) -> Option<Self> {
        let levels: Vec<f32> = photograph.iter().map(|&c| luma(c)).collect();
        let mut shown: Vec<f32> = levels.iter().zip(&eye.depth).filter(|(_, d)| **d > 0.0).map(|(l, _)| *l).collect();
        if shown.len() < 12 {
            return None;
        }
        shown.sort_by(f32::total_cmp);
        let white = f64::from(shown[shown.len() * 9 / 10].max(8.0));
        Some(Self { eye, levels, white, across: Vector2::new(down.y, -down.x), down })
    }

    /// Mean rise of brightness across a circle, relative to the white; `None` if lids cover too much of it.
    fn rise(&self, centre: Point2<f64>, radius: f64) -> Option<f64> {
        let unit = self.eye.eye_distance;
        let step = (0.018 * unit).max(0.8);
        let level = |p: Point2<f64>| Some(f64::from(self.eye.sampled(&self.levels, p, |l| [*l, 0.0, 0.0])?[0]));
        let (mut sum, mut count) = (0.0, 0.0);
        for side in [0.0, 2.0] {
            for k in 0..PLACES {
                let angle = ARC * (2.0 * k as f64 / (PLACES - 1) as f64 - 1.0) + FRAC_PI_2 * side;
                let direction = self.across * angle.cos() + self.down * angle.sin();
                let [within, beyond] = [radius - step, radius + step].map(|r| centre + direction * r);
                if self.eye.depth_at(within) > 0.008 * unit
                    && self.eye.depth_at(beyond) > 0.008 * unit
                    && let (Some(a), Some(b)) = (level(within), level(beyond))
                {
                    (sum, count) = (sum + (b - a) / self.white, count + 1.0);
                }
            }
        }
        // At least 35 % of the positions on both arcs; one side may be hidden by the corner.
        (count >= PLACES as f64 * 0.7).then(|| sum / count)
    }

    fn circle(&self, centre: Point2<f64>, radius: f64) -> Option<Circle> {
        let unit = self.eye.eye_distance;
        let off = (centre - self.eye.centre).norm() / (CENTRE * unit);
        let size = (radius / unit - RADIUS.0) / RADIUS.1;
        let score = self.rise(centre, radius)? - PRIOR * (off * off + size * size);
        Some(Circle { centre, radius, score })
    }

    /// The best circle of a size.
    fn best(&self, size: usize) -> Option<Circle> {
        let unit = self.eye.eye_distance;
        let radius = (RADII.0 + size as f64 * (RADII.1 - RADII.0) / (SIZES - 1) as f64) * unit;
        let around = |middle: Point2<f64>, counts: (i32, i32), step: f64, mut best: Option<Circle>| {
            for i in -counts.0..=counts.0 {
                for j in -counts.1..=counts.1 {
                    let centre = middle + (self.across * f64::from(i) + self.down * f64::from(j)) * (step * unit);
                    if let Some(found) = self.circle(centre, radius)
                        && best.is_none_or(|b| found.score > b.score)
                    {
                        best = Some(found);
                    }
                }
            }
            best
        };
        let count = |reach: f64| (reach / STEPS.0).ceil() as i32;
        let first = around(self.eye.centre, (count(REACH.0), count(REACH.1)), STEPS.0, None)?;
        around(first.centre, (3, 3), STEPS.1, Some(first))
    }
}
