//! Points of a face in the locator, and the placement of a canonical face in an image.

/// A point: x right, y down.
pub type Point = [f32; 2];

/// The points of one face in the order of [`super::points()`].
pub type Shape = Vec<Point>;

/// A similarity from the canonical frame (middle of the pupils at (0, 0), pupils 1 apart) to pixels: `p -> [[a, -b], [b, a]] p + (x, y)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Scale times the cosine of the rotation.
    pub a: f32,
    /// Scale times the sine of the rotation, from the x axis towards the y axis.
    pub b: f32,
    /// x of the middle of the pupils.
    pub x: f32,
    /// y of the middle of the pupils.
    pub y: f32,
}

impl Placement {
    /// Creates a placement with pupils `scale` px apart around a middle, rotated by `angle` radians.
    pub fn new(middle: Point, scale: f32, angle: f32) -> Self {
        Self { a: scale * angle.cos(), b: scale * angle.sin(), x: middle[0], y: middle[1] }
    }

    /// Returns the least-squares similarity from `from` to `to`, which have the same number of points.
    pub fn fit(from: &[Point], to: &[Point]) -> Self {
        let count = from.len().max(1) as f32;
        let mean = |points: &[Point]| {
            let sum = points.iter().fold([0.0_f32; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
            [sum[0] / count, sum[1] / count]
        };
        let (mf, mt) = (mean(from), mean(to));
        let (mut dot, mut cross, mut square) = (0.0_f32, 0.0_f32, 0.0_f32);
        for (f, t) in from.iter().zip(to) {
            let (f, t) = ([f[0] - mf[0], f[1] - mf[1]], [t[0] - mt[0], t[1] - mt[1]]);
            dot += f[0] * t[0] + f[1] * t[1];
            cross += f[0] * t[1] - f[1] * t[0];
            square += f[0] * f[0] + f[1] * f[1];
        }
        let square = square.max(f32::MIN_POSITIVE);
        let (a, b) = (dot / square, cross / square);
        Self { a, b, x: mt[0] - (a * mf[0] - b * mf[1]), y: mt[1] - (b * mf[0] + a * mf[1]) }
    }

    /// Returns pixels per eye distance.
    pub fn scale(self) -> f32 {
        self.a.hypot(self.b)
    }

    /// Maps canonical coordinates to pixels.
    pub fn apply(self, p: Point) -> Point {
        [self.a * p[0] - self.b * p[1] + self.x, self.b * p[0] + self.a * p[1] + self.y]
    }

    /// Maps pixels to canonical coordinates.
    pub fn invert(self, p: Point) -> Point {
        let (x, y, square) = (p[0] - self.x, p[1] - self.y, (self.a * self.a + self.b * self.b).max(f32::MIN_POSITIVE));
        [(self.a * x + self.b * y) / square, (self.a * y - self.b * x) / square]
    }
}

/// Returns the step of a position that moves as known points near it: a mean of their steps. `known`: positions and steps; the weight of a
/// point falls to an eighth at the distance `near`.
pub fn step_near(p: Point, known: &[(Point, Point)], near: f32) -> Point {
    let mut sums = [0.0; 3];
    for &(at, step) in known {
        let weight = (distance(p, at) / near.max(f32::MIN_POSITIVE) + 1.0).powi(-3);
        sums = [sums[0] + weight * step[0], sums[1] + weight * step[1], sums[2] + weight];
    }
    [sums[0], sums[1]].map(|sum| sum / sums[2].max(f32::MIN_POSITIVE))
}

/// Returns the point at a share of the way from one point to another.
pub fn between(p: Point, q: Point, share: f32) -> Point {
    [p[0] + (q[0] - p[0]) * share, p[1] + (q[1] - p[1]) * share]
}

/// Returns the distance between two points.
pub fn distance(p: Point, q: Point) -> f32 {
    (p[0] - q[0]).hypot(p[1] - q[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_position_moves_as_the_points_near_it() {
        let known = [([0.0, 0.0], [1.0, 0.0]), ([10.0, 0.0], [0.0, 1.0])];
        // At a point its weight is 1; the other one, five times the distance away at which a weight is an eighth, has 1 / 6^3.
        let [x, y] = step_near([0.0, 0.0], &known, 2.0);
        approx::assert_relative_eq!(x, 216.0 / 217.0, epsilon = 1e-5);
        approx::assert_relative_eq!(y, 1.0 / 217.0, epsilon = 1e-5);
        assert_eq!(step_near([5.0, 3.0], &known, 2.0), [0.5, 0.5]);
        assert_eq!(step_near([5.0, 3.0], &[], 2.0), [0.0, 0.0]);
    }

    #[test]
    fn a_quarter_turn_is_found_and_undone() {
        // (1, 0) -> (5, 7), (0, 1) -> (3, 5), (0, 0) -> (5, 5): twice the size, x turned onto y.
        let placement = Placement::fit(&[[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]], &[[5.0, 7.0], [3.0, 5.0], [5.0, 5.0]]);
        approx::assert_relative_eq!(placement.a, 0.0, epsilon = 1e-6);
        approx::assert_relative_eq!(placement.b, 2.0, epsilon = 1e-6);
        approx::assert_relative_eq!(placement.scale(), 2.0, epsilon = 1e-6);
        let back = placement.invert(placement.apply([0.3, -0.4]));
        approx::assert_relative_eq!(back[0], 0.3, epsilon = 1e-6);
        approx::assert_relative_eq!(back[1], -0.4, epsilon = 1e-6);
    }
}
