//! Draws the eyeballs through the opening between the lids.

use grimace::internal::wireframe::LID_MARGINS;
use nalgebra::{Point2, Point3, Vector2, Vector3};

use super::{motion::HeadPose, noise, render::Samples, subject::Subject};

/// Corners of the iris boxes: the subject's left eye, then the right.
const IRIS_BOXES: [[usize; 4]; 2] = [[67, 68, 71, 72], [69, 70, 73, 74]];
/// Radius of the iris relative to half the height of its box, and (`PUPIL_SHARE`) of the pupil relative to the iris.
const IRIS_RADIUS: f64 = 1.34;
const PUPIL_SHARE: f64 = 0.36;

/// Draws both eyes into the openings of the lids.
pub fn draw_eyes(samples: &mut Samples, subject: &Subject, offsets: &[Vector3<f64>], pose: &HeadPose) {
    for (margins, iris) in LID_MARGINS.iter().zip(IRIS_BOXES) {
        let place = |n: usize| pose.project(&(subject.neutral()[n] + offsets[n]));
        let [upper, lower] = margins.map(|chain| chain.map(|n| place(usize::from(n))));
        let opening = Opening::new(upper, lower);
        let centre: Point3<f64> = Point3::from(iris.iter().map(|&n| subject.neutral()[n].coords).sum::<Vector3<f64>>() / 4.0);
        let half_height = (subject.neutral()[iris[0]].y - subject.neutral()[iris[1]].y) / 2.0;
        let Some(plane_from_image) = pose.image_from_plane().try_inverse() else { continue };
        let eyeball = Eyeball {
            iris: subject.appearance().iris,
            radius: half_height * IRIS_RADIUS,
            inner: plane_from_image * (upper[4] - pose.project(&centre)),
            outer: plane_from_image * (upper[0] - pose.project(&centre)),
            seed: subject.appearance().noise,
        };
        let middle = pose.project(&centre);
        let unit = (upper[4] - upper[0]).norm() / (eyeball.inner - eyeball.outer).norm();
        let mut all = upper.to_vec();
        all.extend(lower);
        let (columns, rows) = samples.window(&all, 3.0);
        for y in rows {
            for x in columns.clone() {
                let at = Samples::to_image(x, y);
                let Some((below_upper, above_lower)) = opening.depth(at) else { continue };
                // The edge along each lid is half a sample soft.
                let coverage = (below_upper * 2.0 + 0.5).clamp(0.0, 1.0) * (above_lower * 2.0 + 0.5).clamp(0.0, 1.0);
                if coverage > 0.0 {
                    let colour = eyeball.colour(plane_from_image * (at - middle), below_upper / unit, above_lower / unit);
                    samples.lay(x, y, coverage, colour.map(|c| c * 255.0));
                }
            }
        }
    }
}

/// The opening between two lids, bounded by curves through the margin nodes in coordinates along the line between the corners.
struct Opening {
    origin: Point2<f64>,
    along: Vector2<f64>,
    up: Vector2<f64>,
    upper: Spline,
    lower: Spline,
}

impl Opening {
    fn new(upper: [Point2<f64>; 5], lower: [Point2<f64>; 5]) -> Self {
        let along = (upper[4] - upper[0]).normalize();
        // The perpendicular that points up in the picture.
        let up = if along.x > 0.0 { Vector2::new(along.y, -along.x) } else { Vector2::new(-along.y, along.x) };
        let local = |p: Point2<f64>| Vector2::new((p - upper[0]).dot(&along), (p - upper[0]).dot(&up));
        Self { origin: upper[0], along, up, upper: Spline::new(upper.map(local)), lower: Spline::new(lower.map(local)) }
    }

    /// Returns the distances below the upper lid and above the lower lid, px, perpendicular to the line between the corners; `None` beside
    /// the eye.
    fn depth(&self, p: Point2<f64>) -> Option<(f64, f64)> {
        let d = p - self.origin;
        let (x, y) = (d.dot(&self.along), d.dot(&self.up));
        Some((self.upper.at(x)? - y, y - self.lower.at(x)?))
    }
}

/// A cubic curve y(x) through five points with ascending x.
struct Spline {
    points: [Vector2<f64>; 5],
    slopes: [f64; 5],
}

impl Spline {
    fn new(points: [Vector2<f64>; 5]) -> Self {
        let step = |k: usize| (points[k + 1].y - points[k].y) / (points[k + 1].x - points[k].x).max(1e-9);
        let mut slopes = [0.0; 5];
        for k in 1..4 {
            let (before, after) = (points[k].x - points[k - 1].x, points[k + 1].x - points[k].x);
            slopes[k] = (step(k - 1) * after + step(k) * before) / (before + after).max(1e-9);
        }
        // The slope at a corner continues the bend of the curve, so it is steeper than the chord.
        slopes[0] = 2.0 * step(0) - slopes[1];
        slopes[4] = 2.0 * step(3) - slopes[3];
        Self { points, slopes }
    }

    fn at(&self, x: f64) -> Option<f64> {
        let k = (0..4).find(|&k| x >= self.points[k].x && x <= self.points[k + 1].x)?;
        let (p, q) = (self.points[k], self.points[k + 1]);
        let width = q.x - p.x;
        if width <= 0.0 {
            return Some(p.y);
        }
        let t = (x - p.x) / width;
        let (t2, t3) = (t * t, t * t * t);
        Some(
            p.y * (2.0 * t3 - 3.0 * t2 + 1.0)
                + self.slopes[k] * width * (t3 - 2.0 * t2 + t)
                + q.y * (3.0 * t2 - 2.0 * t3)
                + self.slopes[k + 1] * width * (t3 - t2),
        )
    }
}

/// An eyeball; lengths in model units, with the origin at the middle of the iris.
struct Eyeball {
    iris: [f32; 3],
    radius: f64,
    inner: Vector2<f64>,
    outer: Vector2<f64>,
    seed: u32,
}

impl Eyeball {
    fn colour(&self, p: Vector2<f64>, below_upper: f64, above_lower: f64) -> [f32; 3] {
        let r = p.norm();
        let (px, py) = (p.x as f32, p.y as f32);
        let half = (self.inner - self.outer).norm() / 2.0;
        // The white of the eye: darker towards the corners, reddish at the inner corner, with a few veins.
        let round = (1.0 - 0.42 * (r / half).powi(2)).max(0.45) as f32;
        let vein = noise::fractal(px * 60.0, py * 140.0, 3, self.seed ^ 0x61).max(0.0) * 0.10;
        let pink = (-((p - self.inner).norm() / 0.028).powi(2)).exp() as f32;
        let mut colour = [0.86 * round, (0.815 - 0.6 * vein) * round, (0.785 - 0.6 * vein) * round];
        let flesh = [0.80, 0.52, 0.48];
        for (c, f) in colour.iter_mut().zip(flesh) {
            *c += (f * round.max(0.7) - *c) * 0.75 * pink;
        }
        // The iris: fibres, a dark soft rim and a bright lower half.
        let edge = ((self.radius - r) / 0.007 + 0.5).clamp(0.0, 1.0) as f32;
        if edge > 0.0 {
            let share = (r / self.radius) as f32;
            let angle = py.atan2(px);
            let fibre = noise::fractal(angle * 7.0, share * 2.5, 3, self.seed ^ 0x62) * 0.30;
            let rim = 1.0 - 0.62 * (-((share - 1.0) / 0.17).powi(2)).exp();
            let ring = 0.18 * (-((share - 0.48) / 0.10).powi(2)).exp();
            let lower_light = 1.0 + 0.35 * (-(p.y / self.radius) as f32) + 0.1 * (px / self.radius as f32);
            let iris = self.iris.map(|c| (c * (1.05 + fibre + ring) * rim * lower_light + 0.02).clamp(0.0, 1.0));
            let pupil = ((self.radius * PUPIL_SHARE - r) / 0.005 + 0.5).clamp(0.0, 1.0) as f32;
            for n in 0..3 {
                let inside = iris[n] + (0.03 - iris[n]) * pupil;
                colour[n] += (inside - colour[n]) * edge;
            }
        }
        // The upper lid and its lashes cast a shadow, the lower lid a faint one; tears shine at its edge.
        let shadow =
            1.0 - 0.55 * (-(below_upper.max(0.0) / 0.020)).exp() as f32 - 0.14 * (-(above_lower.max(0.0) / 0.010)).exp() as f32;
        colour = colour.map(|c| c * shadow);
        let glint = |x: f64, y: f64, size: f64, strength: f64| {
            strength * (-((p.x - x * self.radius).powi(2) + (p.y - y * self.radius).powi(2)) / (size * self.radius).powi(2)).exp()
        };
        let light = (glint(-0.30, 0.36, 0.17, 0.95) + glint(0.36, -0.42, 0.16, 0.22)) as f32;
        colour.map(|c| c + (1.0 - c) * light.min(1.0))
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    #[test]
    fn lid_curves_pass_through_their_nodes_and_arch_beyond_the_chords() {
        let points = [(0.0, 0.0), (1.0, 0.6), (2.0, 0.8), (3.0, 0.6), (4.0, 0.0)].map(|(x, y)| Vector2::new(x, y));
        let curve = Spline::new(points);
        for p in points {
            assert_relative_eq!(curve.at(p.x).unwrap(), p.y, epsilon = 1e-12);
        }
        assert!(curve.at(0.5).unwrap() > 0.3 && curve.at(1.5).unwrap() > 0.7);
        assert_eq!(curve.at(-0.1), None);
    }
}
