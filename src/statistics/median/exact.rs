//! The exact generalized median [KP, eq. (7)] with a proof of optimality.
//!
//! The sum of distances of eq. (7) is a sum over slots (displacement field m, node k) of planar distances to the slot's vectors, and
//! each vector of the answer occurs in one slot only. The minimum is therefore reached slot by slot: (N' - 1) N independent
//! geometric medians (Fermat-Weber points) in the plane, each a convex problem that damped Newton steps solve in a few passes
//! over the points.
//!
//! The proof is a lower bound from the dual problem: for any vectors |`u_i`| <= 1 with sum `w_i` `u_i` = 0,
//! `f(z) = sum w_i |z - p_i| >= sum w_i u_i . (z - p_i) = sum w_i u_i . (x - p_i)` for every z, whatever the fixed x. At the minimum
//! `u_i` = (x - `p_i`) / |x - `p_i`| meets the conditions and the bound is f itself; near it the `u_i` are corrected to meet them.

use nalgebra::Vector2;
use rayon::prelude::*;

use super::{
    super::{distance::length, sum::CompensatedSum},
    Ending, Median, PointSet, Slots,
    points::Evaluation,
};

/// Largest relative rounding error of the certificate: of each `u_i`, of the sum of the corrected ones times the distance to the
/// farthest possible minimum (at most 2 f / W from x), and of the compensated sums. Together below 40 halves of an epsilon; taken
/// three times as large.
const CERTIFICATE_ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Smallest determinant of a Hessian, relative to the square of its trace, that a Newton step is taken with.
const LEAST_RELATIVE_DETERMINANT: f64 = 1e-14;

/// Halvings of a Newton step before the Weiszfeld step is tried, and of that before the search has stalled.
const MAX_HALVINGS: usize = 30;

/// Relative change of the sum that is rounding: where a step changes the sum by less, the gradient tells whether it is better.
const SUM_ROUNDING: f64 = 1e-12;

/// When the exact median is exact enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExactOptions {
    /// Relative gap between the sum of distances and its lower bound that counts as converged, at least 1e-13 (rounding takes
    /// 1.5e-14).
    pub gap_tolerance: f64,
    /// Steps per slot after which the search gives up.
    pub max_iterations: usize,
}

impl Default for ExactOptions {
    fn default() -> Self {
        Self { gap_tolerance: 1e-12, max_iterations: 200 }
    }
}

/// A point that minimizes the sum of distances to a set, and how far it can be from the minimum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometricMedian {
    /// The median.
    pub point: Vector2<f64>,
    /// Sum of distances from it to the set, in the points' unit.
    pub sum: f64,
    /// A number that no point's sum of distances is below, rounding included.
    pub lower_bound: f64,
    /// Steps taken.
    pub iterations: usize,
    /// How the search ended.
    pub ending: Ending,
}

/// The geometric median of planar points, with its certificate.
///
/// Starts at the componentwise median; takes Newton steps, halved until they lead down, or the Weiszfeld step where the Hessian
/// is singular; tests the nearest point of the set for optimality, with its multiplicity, where the sum has a kink. Linear in the
/// number of points per step. Where the minimum is not unique (an even number of points on a line) the answer is in its middle
/// along the line: the componentwise median.
pub fn geometric_median(points: &PointSet, options: &ExactOptions) -> GeometricMedian {
    let mean = points.mean();
    let mut x = points.componentwise_median();
    let mut here = points.evaluate(x);
    let mut tested = None;
    let mut iterations = 0;
    let mut stalled = false;
    // A quarter: the certificate's own rounding comes on top.
    while !here.is_optimal_vertex() && relative_residual_gap(points, &here, x, mean) > options.gap_tolerance / 4.0 {
        if iterations == options.max_iterations {
            break;
        }
        if here.nearest != tested {
            tested = here.nearest;
            if let Some(vertex) = tested.map(|i| points.points()[i]) {
                let there = points.evaluate(vertex);
                if there.is_optimal_vertex() || there.sum < here.sum {
                    (x, here) = (vertex, there);
                    iterations += 1;
                    continue;
                }
            }
        }
        let Some((next, there)) = descend(points, x, &here) else {
            stalled = true;
            break;
        };
        (x, here) = (next, there);
        iterations += 1;
    }
    let (sum, lower_bound) = certificate(points, x);
    let ending = if sum - lower_bound <= options.gap_tolerance * sum {
        Ending::Converged
    } else if stalled {
        Ending::Stalled
    } else {
        Ending::IterationLimit
    };
    GeometricMedian { point: x, sum, lower_bound, iterations, ending }
}

/// The exact generalized median of every slot, in parallel over slots.
pub fn exact_median(slots: &Slots, options: &ExactOptions) -> Median {
    let medians: Vec<GeometricMedian> =
        (0..slots.len()).into_par_iter().map(|slot| geometric_median(&slots.points(slot), options)).collect();
    Median {
        vectors: medians.iter().map(|m| m.point).collect(),
        sums: medians.iter().map(|m| m.sum).collect(),
        lower_bounds: medians.iter().map(|m| m.lower_bound).collect(),
        iterations: medians.iter().map(|m| m.iterations).sum(),
        ending: medians.iter().map(|m| m.ending).max().unwrap_or(Ending::Converged),
    }
}

/// A point with a smaller sum than `x`, or with an equal one and at most half the gradient; `None` if no step finds one.
///
/// The sum alone would stop too early: it is flat to 1e-16 where the gradient, and with it the lower bound, is only good to 1e-8.
fn descend(points: &PointSet, x: Vector2<f64>, here: &Evaluation) -> Option<(Vector2<f64>, Evaluation)> {
    let weiszfeld = here.weiszfeld_step();
    let determinant = here.hessian.determinant();
    let regular = determinant > LEAST_RELATIVE_DETERMINANT * here.inverse_distances * here.inverse_distances;
    let newton = if here.weight_here == 0.0 && regular { here.hessian.try_inverse().map(|h| -(h * here.gradient)) } else { None };
    let is_better = |there: &Evaluation| {
        let flatter = there.weight_here == 0.0 && there.gradient.norm() <= 0.5 * here.gradient.norm();
        there.sum < here.sum || (flatter && there.sum <= here.sum * (1.0 + SUM_ROUNDING))
    };
    for mut step in newton.into_iter().chain([weiszfeld]) {
        for _ in 0..=MAX_HALVINGS {
            let there = points.evaluate(x + step);
            if is_better(&there) {
                return Some((x + step, there));
            }
            step *= 0.5;
        }
    }
    None
}

/// Relative gap between f(x) and the bound from the `u_i` corrected by the same vector each; cheap, since all sums are there.
fn relative_residual_gap(points: &PointSet, here: &Evaluation, x: Vector2<f64>, mean: Vector2<f64>) -> f64 {
    if here.sum <= 0.0 {
        return 0.0;
    }
    let bound = spread_residual(here.sum, here.gradient, points.total_weight(), mean - x);
    (here.sum - bound) / here.sum
}

/// The bound `base = -sum w u . y` (y = p - x) made valid for a residual `sum w u = residual`: every `u_i` becomes
/// (`u_i` - residual / W) / (1 + |residual| / W), which sums to 0 and is no longer than 1.
fn spread_residual(base: f64, residual: Vector2<f64>, total_weight: f64, mean_from_x: Vector2<f64>) -> f64 {
    (base + residual.dot(&mean_from_x)) / (1.0 + residual.norm() / total_weight)
}

/// f(x) and a lower bound of f anywhere, both in compensated sums.
///
/// Two corrections of the `u_i` are tried and the better bound taken: the residual spread over all points, and the residual taken up
/// by the point nearest to x and its duplicates, whose u may be anything in the unit disc at hardly any cost. The second is exact
/// where x is a point of the set.
fn certificate(points: &PointSet, x: Vector2<f64>) -> (f64, f64) {
    let nearest = points.points().iter().copied().min_by(|a, b| (a - x).norm_squared().total_cmp(&(b - x).norm_squared()));
    let nearest = nearest.unwrap_or(x);
    let (mut sum, mut sum_rest) = (CompensatedSum::default(), CompensatedSum::default());
    let (mut all_x, mut all_y) = (CompensatedSum::default(), CompensatedSum::default());
    let (mut rest_x, mut rest_y) = (CompensatedSum::default(), CompensatedSum::default());
    let (mut mean_x, mut mean_y) = (CompensatedSum::default(), CompensatedSum::default());
    let mut weight_nearest = CompensatedSum::default();
    for (i, p) in points.points().iter().enumerate() {
        let w = points.weight(i);
        let (dx, dy) = (x.x - p.x, x.y - p.y);
        let r = length(dx, dy);
        let (ux, uy) = if r > 0.0 { (dx / r, dy / r) } else { (0.0, 0.0) };
        sum.add(w * r);
        mean_x.add(-w * dx);
        mean_y.add(-w * dy);
        all_x.add(w * ux);
        all_y.add(w * uy);
        if *p == nearest {
            weight_nearest.add(w);
        } else {
            sum_rest.add(w * r);
            rest_x.add(w * ux);
            rest_y.add(w * uy);
        }
    }
    let (sum, total_weight) = (sum.value(), points.total_weight());
    let mean_from_x = Vector2::new(mean_x.value(), mean_y.value()) / total_weight;
    let spread = spread_residual(sum, Vector2::new(all_x.value(), all_y.value()), total_weight, mean_from_x);

    let rest = Vector2::new(rest_x.value(), rest_y.value());
    let weight_nearest = weight_nearest.value();
    let taken_up = -rest / rest.norm().max(weight_nearest);
    let base = sum_rest.value() - weight_nearest * taken_up.dot(&(nearest - x));
    let absorbed = spread_residual(base, rest + taken_up * weight_nearest, total_weight, mean_from_x);

    let bound = spread.max(absorbed) - CERTIFICATE_ROUNDING * sum;
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
        assert_eq!(median.ending, Ending::Converged, "{median:?}");
        assert!(median.lower_bound <= median.sum && median.sum - median.lower_bound <= 1e-12 * median.sum, "{median:?}");
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
        // Odd: the middle point (2, 4). Even: the middle of the two middle ones. Sums along (1, 2): sqrt 5 times |t - 2| summed.
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
        // A corner of just under 120 degrees: the median is near it, not at it. Half the opening is 60 degrees less 1e-6.
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
        assert_eq!(stopped.ending, Ending::IterationLimit);
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
            prop_assert_eq!(m.ending, Ending::Converged);
            prop_assert!(m.lower_bound <= m.sum);
            prop_assert!(m.iterations < 60, "{} iterations", m.iterations);
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
            // Nine points have a unique median unless they are on a line, where an odd number has one too; its place is as good as
            // the square root of the sum's precision where the sum is flattest.
            approx::assert_relative_eq!(b.sum, a.sum, max_relative = 1e-12, epsilon = 1e-11);
            approx::assert_relative_eq!(a.point + shift, b.point, epsilon = 1e-4);
        }
    }
}
