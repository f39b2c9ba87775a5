//! The sum of distances to a set of planar points, and its derivatives.

use nalgebra::{Matrix2, Vector2};

use super::super::{distance::length, sum::CompensatedSum};

/// Relative error allowed in the bounds by which [`PointSet::best_member`] skips members. Rounding stays below it for fewer than 10^7
/// points.
const BOUND_ERROR: f64 = 1e-9;

/// Radii of clusters, relative to the mean distance, that [`PointSet::cluster_steps`] steps out of.
const CLUSTER_RADII: [f64; 3] = [1e-12, 1e-8, 1e-4];

/// Why points and weights do not make a set with a median.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PointSetError {
    /// There are no points.
    #[error("a median needs at least one point")]
    Empty,
    /// The number of weights differs from the number of points.
    #[error("{found} weights for {expected} points")]
    WeightCount {
        /// Number of weights.
        found: usize,
        /// Number of points.
        expected: usize,
    },
    /// A weight that is not a positive number.
    #[error("weight {index} is {weight}; weights must be finite and greater than 0")]
    Weight {
        /// Index in the list, from 0.
        index: usize,
        /// The weight.
        weight: f64,
    },
    /// A coordinate that is NaN, infinite, or too large to be squared.
    #[error("point {index} is ({x}, {y}); coordinates must be finite and below {limit:e}")]
    Coordinate {
        /// Index in the list, from 0.
        index: usize,
        /// x.
        x: f64,
        /// y.
        y: f64,
        /// Limit of the magnitude.
        limit: f64,
    },
}

/// Coordinates of this magnitude or larger are refused, so that their squares and the sums of these stay finite.
const COORDINATE_LIMIT: f64 = 1e100;

/// The points of one slot, at least one, optionally with weights (weight 2 counts a point twice).
#[derive(Clone, Copy, Debug)]
pub struct PointSet<'a> {
    points: &'a [Vector2<f64>],
    weights: Option<&'a [f64]>,
    total_weight: f64,
}

/// The sum of distances f(x) = sum w |x - p| and its derivatives at x. The derivatives are over the points that are not at x.
#[derive(Clone, Copy, Debug)]
pub(super) struct Evaluation {
    /// f(x).
    pub sum: f64,
    /// sum w (x - p) / |x - p|.
    pub gradient: Vector2<f64>,
    /// sum w / |x - p|: the trace of the Hessian.
    pub inverse_distances: f64,
    /// sum w / |x - p| (I - u u^T), u the unit vector from p to x.
    pub hessian: Matrix2<f64>,
    /// Weight of the points at x.
    pub weight_here: f64,
    /// Index of the nearest point that is not at x, if any.
    pub nearest: Option<usize>,
    /// Distance of the nearest point; infinite if there is none.
    pub nearest_distance: f64,
}

impl Evaluation {
    /// Returns whether x is a point of the set and the median: no direction leads down [Vardi & Zhang 2000].
    pub(super) fn is_optimal_vertex(&self) -> bool {
        self.weight_here > 0.0 && self.gradient.norm() <= self.weight_here
    }

    /// Returns the steepest descent of the sum at x: the length of its shortest subgradient.
    pub(super) fn slope(&self) -> f64 {
        (self.gradient.norm() - self.weight_here).max(0.0)
    }

    /// Returns the Weiszfeld step from x in the form of Vardi & Zhang (2000), which also leaves points of the set. It is zero where x is
    /// optimal.
    pub(super) fn weiszfeld_step(&self) -> Vector2<f64> {
        let slope = self.gradient.norm();
        if slope <= self.weight_here || self.inverse_distances <= 0.0 {
            return Vector2::zeros();
        }
        self.gradient * (-(1.0 - self.weight_here / slope) / self.inverse_distances)
    }
}

impl<'a> PointSet<'a> {
    /// Makes a set of points of weight 1.
    ///
    /// # Errors
    /// [`PointSetError`] for an empty set, or coordinates that are not finite or at least 1e100.
    pub fn new(points: &'a [Vector2<f64>]) -> Result<Self, PointSetError> {
        Self::checked(points, None)
    }

    /// Makes a set of points with a weight each.
    ///
    /// # Errors
    /// [`PointSetError`] as for [`PointSet::new`], and for weights that are not one per point, finite and positive.
    #[cfg(test)]
    pub fn weighted(points: &'a [Vector2<f64>], weights: &'a [f64]) -> Result<Self, PointSetError> {
        Self::checked(points, Some(weights))
    }

    /// Makes a set without checks. The caller guarantees at least one point, finite coordinates, and one finite positive weight per
    /// point.
    pub(in super::super) fn known(points: &'a [Vector2<f64>], weights: Option<&'a [f64]>) -> Self {
        let total_weight = weights.map_or(points.len() as f64, |weights| CompensatedSum::of(weights.iter().copied()));
        Self { points, weights, total_weight }
    }

    /// Returns a set of other points with the same weights, one per point.
    pub(super) fn with_points<'b>(&self, points: &'b [Vector2<f64>]) -> PointSet<'b>
    where
        'a: 'b,
    {
        PointSet { points, weights: self.weights, total_weight: self.total_weight }
    }

    fn checked(points: &'a [Vector2<f64>], weights: Option<&'a [f64]>) -> Result<Self, PointSetError> {
        if points.is_empty() {
            return Err(PointSetError::Empty);
        }
        let outside = |c: f64| !(c.abs() < COORDINATE_LIMIT);
        if let Some(index) = points.iter().position(|p| outside(p.x) || outside(p.y)) {
            return Err(PointSetError::Coordinate { index, x: points[index].x, y: points[index].y, limit: COORDINATE_LIMIT });
        }
        let mut total_weight = points.len() as f64;
        if let Some(weights) = weights {
            if weights.len() != points.len() {
                return Err(PointSetError::WeightCount { found: weights.len(), expected: points.len() });
            }
            if let Some(index) = weights.iter().position(|w| !(w.is_finite() && *w > 0.0)) {
                return Err(PointSetError::Weight { index, weight: weights[index] });
            }
            total_weight = CompensatedSum::of(weights.iter().copied());
        }
        Ok(Self { points, weights, total_weight })
    }

    /// Returns the points.
    pub fn points(&self) -> &'a [Vector2<f64>] {
        self.points
    }

    /// Returns the sum of the weights, or the number of points if there are no weights.
    pub fn total_weight(&self) -> f64 {
        self.total_weight
    }

    #[inline]
    pub(super) fn weight(&self, index: usize) -> f64 {
        self.weights.map_or(1.0, |weights| weights[index])
    }

    /// Returns the sum of distances from `x` to the points, in their unit.
    pub fn sum_of_distances(&self, x: Vector2<f64>) -> f64 {
        CompensatedSum::of(self.points.iter().enumerate().map(|(i, p)| self.weight(i) * length(x.x - p.x, x.y - p.y)))
    }

    /// Computes the sum of distances and its derivatives at `x`, in one pass over the points.
    pub(super) fn evaluate(&self, x: Vector2<f64>) -> Evaluation {
        self.evaluate_around(x, 0.0)
    }

    /// As [`PointSet::evaluate`], but points within `radius` count as at `x`, so that they do not enter the derivatives.
    fn evaluate_around(&self, x: Vector2<f64>, radius: f64) -> Evaluation {
        let (mut sum, mut gx, mut gy) = (0.0, 0.0, 0.0);
        let (mut hxx, mut hxy, mut hyy, mut weight_here) = (0.0, 0.0, 0.0, 0.0);
        let (mut nearest, mut nearest_distance) = (None, f64::INFINITY);
        for (i, p) in self.points.iter().enumerate() {
            let w = self.weight(i);
            let (dx, dy) = (x.x - p.x, x.y - p.y);
            let r = length(dx, dy);
            if r <= radius {
                sum += w * r;
                weight_here += w;
                continue;
            }
            if r < nearest_distance {
                (nearest, nearest_distance) = (Some(i), r);
            }
            let (ux, uy) = (dx / r, dy / r);
            let per_length = w / r;
            sum += w * r;
            gx += w * ux;
            gy += w * uy;
            hxx += per_length * uy * uy;
            hxy -= per_length * ux * uy;
            hyy += per_length * ux * ux;
        }
        Evaluation {
            sum,
            gradient: Vector2::new(gx, gy),
            inverse_distances: hxx + hyy,
            hessian: Matrix2::new(hxx, hxy, hxy, hyy),
            weight_here,
            nearest,
            nearest_distance,
        }
    }

    /// Returns Weiszfeld steps from `x` that treat the points within a small radius as points at `x`: one for each of [`CLUSTER_RADII`]
    /// that contains a point.
    ///
    /// Vectors that should be equal differ by rounding. Within such a cluster the ordinary Weiszfeld step is only as long as the cluster
    /// is wide, even far from the minimum. These steps treat the cluster as one point of its weight and leave it.
    pub(super) fn cluster_steps(&self, x: Vector2<f64>, here: &Evaluation) -> impl Iterator<Item = Vector2<f64>> {
        let mean_distance = here.sum / self.total_weight;
        let radii = CLUSTER_RADII.into_iter().map(move |radius| radius * mean_distance);
        let nearest_distance = here.nearest_distance;
        radii
            .filter(move |&radius| nearest_distance <= radius)
            .map(move |radius| self.evaluate_around(x, radius).weiszfeld_step())
    }

    /// Returns the weighted mean of the points.
    pub(super) fn mean(&self) -> Vector2<f64> {
        let of = |axis: usize| CompensatedSum::of(self.points.iter().enumerate().map(|(i, p)| self.weight(i) * p[axis]));
        Vector2::new(of(0), of(1)) / self.total_weight
    }

    /// Returns the median of each coordinate. Where half the weight is on either side, it is the mean of the lower and the upper one.
    ///
    /// For points on one line it is on that line and already the geometric median.
    pub(super) fn componentwise_median(&self) -> Vector2<f64> {
        Vector2::new(self.coordinate_median(0), self.coordinate_median(1))
    }

    fn coordinate_median(&self, axis: usize) -> f64 {
        if self.weights.is_none() {
            let mut values: Vec<f64> = self.points.iter().map(|p| p[axis]).collect();
            return super::super::dispersion::median(&mut values).unwrap_or(0.0);
        }
        let mut order: Vec<usize> = (0..self.points.len()).collect();
        order.sort_by(|&a, &b| self.points[a][axis].total_cmp(&self.points[b][axis]));
        let half = self.total_weight / 2.0;
        let mut below = 0.0;
        for (place, &i) in order.iter().enumerate() {
            below += self.weight(i);
            let value = self.points[i][axis];
            if below > half || place + 1 == order.len() {
                return value;
            }
            if below == half {
                return f64::midpoint(value, self.points[order[place + 1]][axis]);
            }
        }
        0.0
    }

    /// Returns the index of the point with the smallest sum of distances to all points (the first of several), and that sum.
    ///
    /// The result equals that of trying every point, with far fewer sums. The sum is convex, so each sum computed bounds all others from
    /// below by its tangent plane. Members whose bound is above the best sum are skipped (Kelley's cutting planes on a finite set).
    pub fn best_member(&self) -> (usize, f64) {
        let start = self.componentwise_median();
        let mut bounds = vec![0.0; self.points.len()];
        let distance = |i: usize| (self.points[i] - start).norm_squared();
        let mut next = (0..self.points.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
        let mut best: Option<(usize, f64)> = None;
        while let Some(member) = next {
            let evaluation = self.evaluate(self.points[member]);
            let sum = evaluation.sum;
            if best.is_none_or(|(i, least)| sum < least || (sum == least && member < i)) {
                best = Some((member, sum));
            }
            let limit = best.map_or(sum, |(_, least)| least);
            let mut lowest = limit;
            next = None;
            bounds[member] = f64::INFINITY;
            for (i, bound) in bounds.iter_mut().enumerate() {
                let step = self.points[i] - self.points[member];
                let error = BOUND_ERROR * (sum + self.total_weight * (step.x.abs() + step.y.abs()));
                *bound = bound.max(sum + evaluation.gradient.dot(&step) - error);
                if *bound <= lowest {
                    // Of equal bounds the first is taken: `<=` on entry only, `<` afterwards.
                    if next.is_none() || *bound < lowest {
                        (next, lowest) = (Some(i), *bound);
                    }
                }
            }
        }
        best.unwrap_or((0, 0.0))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::{super::super::distance::tests::vectors, *};

    fn points(list: &[(f64, f64)]) -> Vec<Vector2<f64>> {
        list.iter().map(|&(x, y)| Vector2::new(x, y)).collect()
    }

    #[test]
    fn derivatives_at_a_point_between_three() {
        // x = (0, 0); p = (3, 4), (0, -2), (0, 0). Sum 5 + 2; gradient -(0.6, 0.8) + (0, 1) = (-0.6, 0.2).
        // Hessian: 1/5 [0.64 -0.48; -0.48 0.36] + 1/2 [1 0; 0 0].
        let p = points(&[(3.0, 4.0), (0.0, -2.0), (0.0, 0.0)]);
        let e = PointSet::new(&p).unwrap().evaluate(Vector2::zeros());
        assert_eq!((e.sum, e.weight_here, e.nearest), (7.0, 1.0, Some(1)));
        approx::assert_relative_eq!(e.gradient, Vector2::new(-0.6, 0.2), epsilon = 1e-15);
        approx::assert_relative_eq!(e.hessian, Matrix2::new(0.628, -0.096, -0.096, 0.072), epsilon = 1e-15);
        approx::assert_relative_eq!(e.inverse_distances, 0.7, epsilon = 1e-15);
        assert!(e.is_optimal_vertex());
        assert_eq!(e.weiszfeld_step(), Vector2::zeros());
    }

    #[test]
    fn weiszfeld_steps_are_means_weighted_by_inverse_distance() {
        // From (0, 0) among (1, 0), (2, 0) and (-4, 0): (1/1 + 2/2 - 4/4) / (1 + 1/2 + 1/4) = 1 / 1.75.
        let p = points(&[(1.0, 0.0), (2.0, 0.0), (-4.0, 0.0)]);
        let step = PointSet::new(&p).unwrap().evaluate(Vector2::zeros()).weiszfeld_step();
        approx::assert_relative_eq!(step, Vector2::new(1.0 / 1.75, 0.0), epsilon = 1e-15);
    }

    #[test]
    fn a_weight_of_two_is_the_point_twice() {
        let (once, twice) =
            (points(&[(0.0, 0.0), (6.0, 1.0), (2.0, 5.0)]), points(&[(0.0, 0.0), (6.0, 1.0), (6.0, 1.0), (2.0, 5.0)]));
        let (w, c) = (PointSet::weighted(&once, &[1.0, 2.0, 1.0]).unwrap(), PointSet::new(&twice).unwrap());
        let x = Vector2::new(1.0, 1.0);
        assert_eq!((w.total_weight(), w.sum_of_distances(x)), (4.0, c.sum_of_distances(x)));
        // x: 0 2 6 6 -> (2 + 6) / 2; y: 0 1 1 5 -> 1.
        assert_eq!((w.componentwise_median(), c.componentwise_median()), (Vector2::new(4.0, 1.0), Vector2::new(4.0, 1.0)));
        assert_eq!(w.mean(), c.mean());
        assert_eq!(w.best_member(), (1, c.best_member().1));
    }

    #[test]
    fn bad_sets_are_refused_with_their_values() {
        let p = points(&[(0.0, 0.0), (f64::NAN, 1.0)]);
        assert_eq!(PointSet::new(&[]).unwrap_err(), PointSetError::Empty);
        assert!(matches!(PointSet::new(&p).unwrap_err(), PointSetError::Coordinate { index: 1, .. }));
        assert_eq!(PointSet::weighted(&p[..1], &[]).unwrap_err(), PointSetError::WeightCount { found: 0, expected: 1 });
        for bad in [0.0, -1.0, f64::INFINITY, f64::NAN] {
            assert!(matches!(PointSet::weighted(&p[..1], &[bad]).unwrap_err(), PointSetError::Weight { index: 0, .. }), "{bad}");
        }
    }

    proptest! {
        #[test]
        fn the_best_member_is_the_one_that_trying_all_finds(points in (1..60usize).prop_flat_map(vectors)) {
            let set = PointSet::new(&points).unwrap();
            let sums: Vec<f64> = points.iter().map(|&p| set.evaluate(p).sum).collect();
            let least = sums.iter().copied().fold(f64::INFINITY, f64::min);
            prop_assert_eq!(set.best_member(), (sums.iter().position(|&s| s == least).unwrap(), least));
        }
    }
}
