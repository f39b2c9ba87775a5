//! The exact generalized median [KP, eq. (7)] with a proof of optimality.
//!
//! The sum of distances of eq. (7) is a sum over slots (displacement field m, node k) of planar distances to the slot's vectors. Each
//! vector of the median occurs in one slot only, so each slot is minimized on its own. This gives (N' - 1) N independent geometric
//! medians (Fermat-Weber points) in the plane. Each is a convex problem that damped Newton steps solve in a few passes over the points.
//!
//! The proof is a lower bound from the dual problem. For any vectors `|u_i| <= 1` with `sum w_i u_i = 0`,
//! `f(z) = sum w_i |z - p_i| >= sum w_i u_i . (z - p_i) = sum w_i u_i . (x - p_i)` for every z and any fixed x. At the minimum,
//! `u_i = (x - p_i) / |x - p_i|` satisfies the conditions and the bound is f itself. Near the minimum the `u_i` are corrected to satisfy
//! them.

// Formulae are plain text here.
#![allow(clippy::doc_markdown)]

use nalgebra::Vector2;
use rayon::prelude::*;

use super::{
    super::{distance::length, sum::CompensatedSum},
    Median, PointSet, SearchEnding, Slots,
    points::Evaluation,
};

/// Bound on the relative rounding error of the certificate.
///
/// It covers the differences from the origin, each `u_i`, the sum of the corrected `u_i` times the distance to the farthest possible
/// minimum (at most 2 f / W from x), and the compensated sums. Together these are below 50 halves of an epsilon; the value is more than
/// twice that.
const CERTIFICATE_ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Smallest determinant of a Hessian, relative to the square of its trace, for which a Newton step is taken.
const LEAST_RELATIVE_DETERMINANT: f64 = 1e-14;

/// Number of iterations between direction and length in [`newton_step_from_vertex`].
const VERTEX_TURNS: usize = 4;

/// Largest number of halvings of a step. After that the Weiszfeld step replaces the Newton step, or the search has stalled.
const MAX_HALVINGS: usize = 30;

/// Radii of clusters around x, relative to the mean distance, to which the certificate tries to assign the residual.
const CERTIFICATE_RADII: [f64; 7] = [1e-14, 1e-13, 1e-12, 1e-10, 1e-8, 1e-5, 1e-2];

/// Smallest relative decrease of the slope by a full step when the sums differ only by rounding; in proportion for shorter steps.
const LEAST_DECREASE: f64 = 0.01;

/// Distance to the nearest point, relative to the mean distance, below which x may be in a cluster narrower than its rounding. Then only
/// the certificate can tell whether x is good.
const CROWDED: f64 = 1e-8;

/// Relative change of the sum that counts as rounding; below it the gradient decides whether a step is better.
///
/// It is multiplied by the square root of the number of points, the typical error of plain sums of so many positive terms.
const SUM_ROUNDING: f64 = 8.0 * f64::EPSILON;

/// Stopping conditions of the exact median.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExactOptions {
    /// Relative gap between the sum of distances and its lower bound at which the search has converged, at least 1e-13 (rounding takes
    /// 1.5e-14).
    pub gap_tolerance: f64,
    /// Largest number of steps per slot.
    pub max_iterations: usize,
}

impl Default for ExactOptions {
    fn default() -> Self {
        Self { gap_tolerance: 1e-11, max_iterations: 200 }
    }
}

/// A point that minimizes the sum of distances to a set, with a bound on its error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometricMedian {
    /// The median.
    pub point: Vector2<f64>,
    /// Sum of distances from it to the set, in the points' unit.
    pub sum: f64,
    /// Lower bound on the sum of distances of any point, rounding included.
    pub lower_bound: f64,
    /// Number of steps.
    pub iterations: usize,
    /// How the search ended.
    pub ending: SearchEnding,
}

/// Returns the geometric median of planar points, with its certificate.
///
/// The search starts at the componentwise median. It takes Newton steps, halved until they lead down, or the Weiszfeld step where the
/// Hessian is singular. It tests the nearest point of the set, where the sum has a kink, for optimality with its multiplicity. The time
/// per step is linear in the number of points. If the minimum is not unique (an even number of points on a line), the result is the
/// componentwise median, the middle of the minima along the line.
///
/// The search works on differences from the componentwise median, so that it also resolves points that differ only in their last digits.
/// If it does not converge, it is repeated once on differences from the point nearest to the result, because directions close to that
/// point need more digits. Sum and bound are those of the result before it is rounded to absolute coordinates, which adds at most the
/// weight times the rounding.
pub fn geometric_median(points: &PointSet, options: &ExactOptions) -> GeometricMedian {
    let origin = points.componentwise_median();
    let first = median_from(points, origin, Vector2::zeros(), options);
    let to_answer = |p: &Vector2<f64>| (p - first.point).norm_squared();
    let nearest = points.points().iter().copied().min_by(|a, b| to_answer(a).total_cmp(&to_answer(b)));
    match nearest.filter(|_| first.ending != SearchEnding::Converged) {
        Some(nearest) => {
            let again = median_from(points, nearest, first.point - nearest, options);
            let iterations = first.iterations + again.iterations;
            let best = if again.lower_bound / again.sum > first.lower_bound / first.sum { again } else { first };
            GeometricMedian { iterations, ..best }
        }
        None => first,
    }
}

/// Searches for the geometric median from a start. `start` is a difference from `origin`.
fn median_from(points: &PointSet, origin: Vector2<f64>, start: Vector2<f64>, options: &ExactOptions) -> GeometricMedian {
    let differences: Vec<Vector2<f64>> = points.points().iter().map(|p| p - origin).collect();
    let centered = centered_median(&points.with_points(&differences), start, options);
    GeometricMedian { point: origin + centered.point, ..centered }
}

fn centered_median(points: &PointSet, start: Vector2<f64>, options: &ExactOptions) -> GeometricMedian {
    let mean = points.mean();
    let mut x = start;
    let mut here = points.evaluate(x);
    let mut tested = None;
    let mut iterations = 0;
    let is_done = |x: Vector2<f64>, here: &Evaluation| {
        let within_tolerance = |(sum, bound): (f64, f64)| sum - bound <= options.gap_tolerance * sum;
        here.is_optimal_vertex()
            // A quarter, because the certificate's own rounding is added.
            || relative_residual_gap(points, here, x, mean) <= options.gap_tolerance / 4.0
            || (here.nearest_distance <= CROWDED * here.sum / points.total_weight()
                && within_tolerance(certificate(points, x, options.gap_tolerance)))
    };
    let mut stalled = false;
    while !stalled && iterations < options.max_iterations && !is_done(x, &here) {
        iterations += 1;
        if here.nearest != tested {
            tested = here.nearest;
            if let Some(vertex) = tested.map(|i| points.points()[i]) {
                let there = points.evaluate(vertex);
                if there.is_optimal_vertex() || is_better(points, &here, &there, 1.0) {
                    (x, here) = (vertex, there);
                    continue;
                }
            }
        }
        match descend(points, x, &here) {
            Some(next) => (x, here) = next,
            None => stalled = true,
        }
    }
    let (sum, lower_bound) = certificate(points, x, options.gap_tolerance);
    let ending = if sum - lower_bound <= options.gap_tolerance * sum {
        SearchEnding::Converged
    } else if stalled {
        SearchEnding::Stalled
    } else {
        SearchEnding::IterationLimit
    };
    GeometricMedian { point: x, sum, lower_bound, iterations, ending }
}

/// Returns the exact generalized median of every slot. Slots are processed in parallel.
pub fn exact_median(slots: &Slots, options: &ExactOptions) -> Median {
    let medians: Vec<GeometricMedian> =
        (0..slots.len()).into_par_iter().map(|slot| geometric_median(&slots.points(slot), options)).collect();
    Median {
        vectors: medians.iter().map(|m| m.point).collect(),
        sums: medians.iter().map(|m| m.sum).collect(),
        lower_bounds: medians.iter().map(|m| m.lower_bound).collect(),
        iterations: medians.iter().map(|m| m.iterations).sum(),
        ending: medians.iter().map(|m| m.ending).max().unwrap_or(SearchEnding::Converged),
    }
}

/// Returns whether a step from `here` to `there`, of length `share` times the full step, is an improvement.
///
/// The sum decides, or the slope where the sums differ only by rounding. The sum alone would stop too early: it is flat to 1e-16 where
/// the slope, and with it the lower bound, is accurate only to 1e-8.
fn is_better(points: &PointSet, here: &Evaluation, there: &Evaluation, share: f64) -> bool {
    let rounding = sum_rounding(points, here);
    let flatter = there.slope() <= here.slope() * (1.0 - LEAST_DECREASE * share);
    there.sum < here.sum - rounding || (flatter && there.sum <= here.sum + rounding)
}

/// Returns the difference below which two sums of distances near `here` count as equal.
fn sum_rounding(points: &PointSet, here: &Evaluation) -> f64 {
    SUM_ROUNDING * (points.points().len() as f64).sqrt() * here.sum
}

/// Returns the Newton step where the sum is smooth, or `None` if the Hessian is singular.
fn newton_step(here: &Evaluation) -> Option<Vector2<f64>> {
    let regular = here.hessian.determinant() > LEAST_RELATIVE_DETERMINANT * here.inverse_distances.powi(2);
    here.hessian.try_inverse().filter(|_| regular).map(|inverse| -(inverse * here.gradient))
}

/// Returns the minimum of the local model `w |s| + g . s + s . H s / 2` at a point of weight w in the set; g and H are of the other
/// points.
///
/// In a direction d the model is smallest at length t = (-g . d - w) / (d . H d). The minimum s = t d points along -(g + H s). A few
/// iterations between the two are enough, since s is short wherever it matters.
fn newton_step_from_vertex(here: &Evaluation) -> Option<Vector2<f64>> {
    let mut step = Vector2::zeros();
    for _ in 0..VERTEX_TURNS {
        let direction = -(here.gradient + here.hessian * step).try_normalize(0.0)?;
        let curvature = direction.dot(&(here.hessian * direction));
        let length = (-here.gradient.dot(&direction) - here.weight_here) / curvature;
        if !(length > 0.0 && length.is_finite()) {
            return None;
        }
        step = direction * length;
    }
    Some(step)
}

/// Returns a better point than `x`, or `None` if no step finds one.
///
/// Next to a cluster of points it also tries the steps out of the cluster, and takes them if they lead lower.
fn descend(points: &PointSet, x: Vector2<f64>, here: &Evaluation) -> Option<(Vector2<f64>, Evaluation)> {
    let newton = if here.weight_here > 0.0 { newton_step_from_vertex(here) } else { newton_step(here) };
    let search = |step: Vector2<f64>| {
        let mut shares = std::iter::successors(Some(1.0), |share| Some(share * 0.5)).take(1 + MAX_HALVINGS);
        shares.find_map(|share| {
            let next = x + step * share;
            Some((next, points.evaluate(next))).filter(|(_, there)| is_better(points, here, there, share))
        })
    };
    let mut best = newton.and_then(search).or_else(|| search(here.weiszfeld_step()));
    for next in points.cluster_steps(x, here).filter_map(search) {
        if best.as_ref().is_none_or(|(_, best)| next.1.sum < best.sum - sum_rounding(points, here)) {
            best = Some(next);
        }
    }
    best
}

/// Returns the relative gap between f(x) and the bound with the residual spread over all points. It is cheap because all sums are known.
fn relative_residual_gap(points: &PointSet, here: &Evaluation, x: Vector2<f64>, mean: Vector2<f64>) -> f64 {
    if here.sum <= 0.0 {
        return 0.0;
    }
    let all = Sums {
        weight: points.total_weight(),
        distance: here.sum,
        unit: here.gradient,
        offset: (mean - x) * points.total_weight(),
    };
    (here.sum - all.bound(&Sums::default())) / here.sum
}

/// Sums over a subset S of the points, relative to x: of w, of w r, of w u and of w (p - x).
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    weight: f64,
    distance: f64,
    unit: Vector2<f64>,
    offset: Vector2<f64>,
}

impl Sums {
    /// Computes compensated sums over the points within `radius` of `x`, and over the rest.
    ///
    /// For points at x, u is any vector in the unit disc; the one with the smallest residual is taken.
    fn split(points: &PointSet, x: Vector2<f64>, radius: f64) -> (Self, Self) {
        let mut sums = [[CompensatedSum::default(); 6]; 2];
        let mut weight_here = CompensatedSum::default();
        for (i, p) in points.points().iter().enumerate() {
            let w = points.weight(i);
            let (dx, dy) = (x.x - p.x, x.y - p.y);
            let r = length(dx, dy);
            let (ux, uy) = if r > 0.0 { (dx / r, dy / r) } else { (0.0, 0.0) };
            if r == 0.0 {
                weight_here.add(w);
            }
            let part = &mut sums[usize::from(r > radius)];
            for (sum, term) in part.iter_mut().zip([w, w * r, w * ux, w * uy, -w * dx, -w * dy]) {
                sum.add(term);
            }
        }
        let [mut within, rest] = sums.map(|part| {
            let [weight, distance, ux, uy, x, y] = part.map(CompensatedSum::value);
            Self { weight, distance, unit: Vector2::new(ux, uy), offset: Vector2::new(x, y) }
        });
        let weight_here = weight_here.value();
        if weight_here > 0.0 {
            let residual = within.unit + rest.unit;
            within.unit -= residual * (weight_here / residual.norm().max(weight_here));
        }
        (within, rest)
    }

    /// Returns a lower bound of f from the u_i of both parts. The u_i of this part are corrected to cancel the residual of all.
    ///
    /// Let c = -(sum of the rest's w u) / W and d = -(residual) / W. Both u_i + d and c cancel the residual, and so does
    /// `(1 - t) (u_i + d) + t c`; t = |d| / (1 + |d| - |c|) makes that no longer than 1. If |c| > 1, this part is too light to balance
    /// the rest. All its u_i then become c / |c|, and the remaining residual e is spread over all points: each u becomes
    /// `(u - e / W) / (1 + |e| / W)`, where W is now the weight of all.
    fn bound(&self, rest: &Self) -> f64 {
        let c = -rest.unit / self.weight;
        if c.norm() <= 1.0 {
            let d = -(rest.unit + self.unit) / self.weight;
            let t = if d.norm() > 0.0 { d.norm() / (1.0 + d.norm() - c.norm()) } else { 0.0 };
            return rest.distance + (1.0 - t) * (self.distance - d.dot(&self.offset)) - t * c.dot(&self.offset);
        }
        let c = c.normalize();
        let missing = (rest.unit + c * self.weight) / (rest.weight + self.weight);
        (rest.distance - c.dot(&self.offset) + missing.dot(&(rest.offset + self.offset))) / (1.0 + missing.norm())
    }
}

/// Returns f(x) and a lower bound of f anywhere.
///
/// The residual is first assigned to all points. If the gap is too large, it is assigned to points near x, whose u can change at almost
/// no cost: the nearest and its duplicates, then those within each of [`CERTIFICATE_RADII`]. At a point of the set this proves a vertex
/// optimum. In a cluster narrower than the rounding of x it is the only possible proof. The largest bound is returned.
fn certificate(points: &PointSet, x: Vector2<f64>, gap_tolerance: f64) -> (f64, f64) {
    let (all, none) = Sums::split(points, x, f64::INFINITY);
    let sum = all.distance;
    let rounding = CERTIFICATE_ROUNDING * sum;
    let mut bound = all.bound(&none) - rounding;
    let distances = points.points().iter().map(|p| length(x.x - p.x, x.y - p.y));
    let nearest = distances.fold(f64::INFINITY, f64::min);
    let mean_distance = sum / points.total_weight();
    for radius in [0.0].into_iter().chain(CERTIFICATE_RADII).map(|radius| nearest.max(radius * mean_distance)) {
        if sum - bound <= gap_tolerance * sum {
            break;
        }
        let (near, rest) = Sums::split(points, x, radius);
        bound = bound.max(near.bound(&rest) - rounding);
    }
    (sum, bound.clamp(0.0, sum))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::{super::super::distance::tests::vectors, *};

    fn points(list: &[(f64, f64)]) -> Vec<Vector2<f64>> {
        list.iter().map(|&(x, y)| Vector2::new(x, y)).collect()
    }

    fn median(list: &[(f64, f64)]) -> GeometricMedian {
        let median = geometric_median(&PointSet::new(&points(list)).unwrap(), &ExactOptions::default());
        assert_eq!(median.ending, SearchEnding::Converged, "{median:?}");
        assert!(median.lower_bound <= median.sum && median.sum - median.lower_bound <= 1e-11 * median.sum, "{median:?}");
        median
    }

    #[test]
    fn one_point_and_equal_points_are_their_own_median() {
        for list in [&[(3.0, -4.0)][..], &[(3.0, -4.0); 7][..], &[(0.0, 0.0); 2][..]] {
            let m = median(list);
            assert_eq!((m.point, m.sum, m.lower_bound, m.iterations), (Vector2::new(list[0].0, list[0].1), 0.0, 0.0, 0));
        }
    }

    #[test]
    fn two_points_have_their_midpoint() {
        // Any point between them is a median; the sum is their distance 5.
        let m = median(&[(0.0, 0.0), (3.0, 4.0)]);
        assert_eq!(m.point, Vector2::new(1.5, 2.0));
        approx::assert_relative_eq!(m.sum, 5.0, max_relative = 1e-15);
    }

    #[test]
    fn points_on_a_line_have_the_median_on_the_line() {
        // Odd: the middle point (2, 4). Even: the middle of the two middle points. Sums along (1, 2): sum of sqrt 5 times |t - 2|.
        let odd = median(&[(0.0, 0.0), (10.0, 20.0), (2.0, 4.0), (1.0, 2.0), (3.0, 6.0)]);
        assert_eq!(odd.point, Vector2::new(2.0, 4.0));
        approx::assert_relative_eq!(odd.sum, 5f64.sqrt() * (2.0 + 8.0 + 0.0 + 1.0 + 1.0), max_relative = 1e-15);
        assert_eq!(median(&[(0.0, 7.0), (1.0, 7.0), (5.0, 7.0), (100.0, 7.0)]).point, Vector2::new(3.0, 7.0));
    }

    #[test]
    fn the_fermat_point_of_an_equilateral_triangle_is_its_centre() {
        let h = 3f64.sqrt();
        let m = median(&[(-1.0, 0.0), (1.0, 0.0), (0.0, h)]);
        // Centre at a third of the height; three distances of 2 / sqrt 3.
        approx::assert_relative_eq!(m.point, Vector2::new(0.0, h / 3.0), epsilon = 1e-12);
        approx::assert_relative_eq!(m.sum, 2.0 * h, max_relative = 1e-14);
    }

    #[test]
    fn a_triangle_with_an_angle_of_120_degrees_or_more_has_the_median_at_that_corner() {
        let m = median(&[(-5.0, -1.0), (0.0, 0.0), (6.0, -1.0)]);
        assert_eq!(m.point, Vector2::zeros());
        approx::assert_relative_eq!(m.sum, 26f64.sqrt() + 37f64.sqrt(), max_relative = 1e-15);
    }

    #[test]
    fn a_square_has_its_centre_and_a_point_at_half_the_weight_wins() {
        let square = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)];
        approx::assert_relative_eq!(median(&square).point, Vector2::new(1.0, 1.0), epsilon = 1e-12);
        // (9, 9) four times against four corners: the pull of the corners is at most 4, the multiplicity.
        let mut heavy = square.to_vec();
        heavy.extend([(9.0, 9.0); 4]);
        assert_eq!(median(&heavy).point, Vector2::new(9.0, 9.0));
    }

    #[test]
    fn a_median_close_to_a_point_of_the_set_is_found() {
        // A corner of just under 120 degrees: the median is near it, not at it. Half the angle is 60 degrees minus 1e-6.
        let (s, c) = (60f64.to_radians() - 1e-6).sin_cos();
        let m = median(&[(-s, c), (0.0, 0.0), (s, c)]);
        assert!(m.point.y > 0.0 && m.point.y < 1e-4 && m.point.x.abs() < 1e-12, "{m:?}");
    }

    #[test]
    fn clusters_far_apart_and_far_from_the_origin_keep_the_certificate() {
        for (shift, spread) in [(0.0, 1e-9), (1e6, 1e-3), (-1e3, 1e3)] {
            let cluster = |cx: f64, n: usize| {
                (0..n).map(move |i| {
                    let angle = i as f64 * 2.4;
                    (shift + cx + spread * i as f64 * angle.cos(), shift - spread * i as f64 * angle.sin())
                })
            };
            median(&cluster(0.0, 5).chain(cluster(100.0, 4)).chain(cluster(-7.0, 3)).collect::<Vec<_>>());
        }
    }

    #[test]
    fn weights_count_as_multiplicity() {
        let list = points(&[(0.0, 0.0), (4.0, 1.0), (1.0, 5.0), (-3.0, 2.0)]);
        let weights = [3.0, 1.0, 2.0, 2.0];
        let repeated: Vec<_> = list.iter().zip(weights).flat_map(|(p, w)| vec![*p; w as usize]).collect();
        let options = ExactOptions::default();
        let weighted = geometric_median(&PointSet::weighted(&list, &weights).unwrap(), &options);
        let repeated = geometric_median(&PointSet::new(&repeated).unwrap(), &options);
        approx::assert_relative_eq!(weighted.point, repeated.point, epsilon = 1e-9);
        approx::assert_relative_eq!(weighted.sum, repeated.sum, max_relative = 1e-13);
    }

    #[test]
    fn an_exhausted_search_says_so_and_its_bound_still_holds() {
        let list = points(&[(0.0, 0.0), (4.0, 1.0), (1.0, 5.0), (-3.0, 2.0), (-2.0, 2.5)]);
        let set = PointSet::new(&list).unwrap();
        let stopped = geometric_median(&set, &ExactOptions { max_iterations: 0, ..ExactOptions::default() });
        let best = geometric_median(&set, &ExactOptions::default());
        assert_eq!(stopped.ending, SearchEnding::IterationLimit);
        assert!(
            0.0 < stopped.lower_bound && stopped.lower_bound <= best.lower_bound && best.sum < stopped.sum,
            "{stopped:?} {best:?}"
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn every_median_is_certified(points in (1..40usize).prop_flat_map(vectors)) {
            let m = geometric_median(&PointSet::new(&points).unwrap(), &ExactOptions::default());
            prop_assert_eq!(m.ending, SearchEnding::Converged, "{:?}", m);
            prop_assert!(m.lower_bound <= m.sum);
        }

        #[test]
        fn no_point_beats_the_lower_bound(points in (1..12usize).prop_flat_map(vectors), dx in -1.0..1.0f64, dy in -1.0..1.0f64, scale in -9..3i32) {
            let set = PointSet::new(&points).unwrap();
            let m = geometric_median(&set, &ExactOptions::default());
            let near = m.point + Vector2::new(dx, dy) * 10f64.powi(scale);
            prop_assert!(set.sum_of_distances(near) >= m.lower_bound);
            for &p in &points {
                prop_assert!(set.sum_of_distances(p) >= m.lower_bound);
            }
        }

        #[test]
        fn translating_the_points_translates_the_median(points in vectors(9), dx in -100.0..100.0f64, dy in -100.0..100.0f64) {
            let shift = Vector2::new(dx, dy);
            let moved: Vec<_> = points.iter().map(|p| p + shift).collect();
            let options = ExactOptions::default();
            let (a, b) = (geometric_median(&PointSet::new(&points).unwrap(), &options), geometric_median(&PointSet::new(&moved).unwrap(), &options));
            // Nine points have a unique median unless they are on a line, where an odd number has one too. Its position is accurate to
            // the square root of the sum's precision where the sum is flattest.
            approx::assert_relative_eq!(b.sum, a.sum, max_relative = options.gap_tolerance, epsilon = 1e-11);
            approx::assert_relative_eq!(a.point + shift, b.point, epsilon = 1e-4);
        }
    }
}
