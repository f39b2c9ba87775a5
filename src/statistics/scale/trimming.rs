//! Certified trimming: finds the models with the largest `d_tf` [KP, eq. (6)] without computing all pairs.
//!
//! `d_tf` of model i is, up to constants, the sum over nodes of `F_k(x) = sum_j |x - p_j|` at the model's own vector. The length of a
//! planar vector is bounded by multiples of the sum of its projections on A directions, evenly spaced over half a turn:
//!
//! ```text
//! |v| x cot x  <=  pi / (2 A) sum_a |v . u_a|  <=  |v| x / sin x,    x = pi / (2 A)
//! ```
//!
//! On a line, the sum of distances from a point to all points follows from the number and the sum of the points on either side. It is
//! exact after sorting. Counting the points in bins is cheaper and gives narrow bounds. A directions therefore bound every `F_k`, and
//! with it every `d_tf`, within a relative pi^2 / (8 A^2), in about A N'' instead of N''^2 steps.
//!
//! A model is certainly dropped if its lower bound is above the upper bounds of enough others. It is certainly kept if its upper bound is
//! below enough lower bounds. The few undecided models are bounded with more directions and finally computed exactly. Models at the
//! border whose exact sums differ only by rounding are reported; their order is that of the sequence ids.

use std::ops::AddAssign;

use nalgebra::Vector2;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{SlotSource, SourceError, nodes_at_once};
use crate::{simd::widest, units::SequenceId};

/// Number of directions in each round. The second round is run only if it is cheaper than computing the undecided models exactly.
const DIRECTIONS: [usize; 2] = [48, 128];

/// Approximate number of models that can be computed exactly in the time that one direction takes for all models.
const MODELS_PER_DIRECTION: usize = 5;

/// Result of the trimming of a class.
#[derive(Clone, Debug, PartialEq)]
pub struct CertifiedTrimming {
    /// Indices of the kept models by field, ascending.
    pub kept: Vec<Vec<usize>>,
    /// `d_tf` by field and model, with a relative error of at most [`CertifiedTrimming::relative_bound`]; exact where the bounds did not
    /// decide.
    pub distances: Vec<Vec<f64>>,
    /// Largest relative error of `distances`.
    pub relative_bound: f64,
    /// Number of (field, model) pairs computed exactly.
    pub exact: usize,
    /// Indices of the models at the border whose order rounding does not determine.
    pub undecided: Vec<usize>,
}

/// Certainty of the trimming of a class.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Certificate {
    /// Largest relative error of `d_tf`, in parts per million, rounded up.
    pub distance_error_ppm: u64,
    /// Number of (field, model) pairs decided by bounds.
    pub decided_by_bounds: usize,
    /// Number of (field, model) pairs computed exactly.
    pub decided_exactly: usize,
    /// Sequences at the border that differ only by rounding. Of these the larger ids were dropped.
    pub undecided: Vec<SequenceId>,
}

impl CertifiedTrimming {
    pub(super) fn certificate(&self, ids: &[SequenceId]) -> Certificate {
        Certificate {
            distance_error_ppm: (self.relative_bound * 1e6).ceil() as u64,
            decided_by_bounds: self.kept.len() * ids.len() - self.exact,
            decided_exactly: self.exact,
            undecided: self.undecided.iter().map(|&i| ids[i].clone()).collect(),
        }
    }
}

/// Returns the factors between a length and the mean of its projections, (x cot x, x / sin x), widened by the rounding error.
fn factors(directions: usize, models: usize) -> (f64, f64) {
    let x = std::f64::consts::FRAC_PI_2 / directions as f64;
    // Prefix sums of N'' terms have an error of at most N'' epsilons of the sum of magnitudes, which is at most twice the sum itself.
    let rounding = 8.0 * models as f64 * f64::EPSILON;
    (x / x.tan() * (1.0 - rounding), x / x.sin() * (1.0 + rounding))
}

/// Lower and upper bound of a sum of projected distances.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Bounds {
    lower: f64,
    upper: f64,
}

impl AddAssign for Bounds {
    fn add_assign(&mut self, other: Self) {
        self.lower += other.lower;
        self.upper += other.upper;
    }
}

/// A segment of a line. The sum of distances from a position `s` in it to all points outside it is `slope * s + offset`. Of its own
/// points only number and sum are known.
#[derive(Clone, Copy, Debug, Default)]
struct Bin {
    count: f64,
    sum: f64,
    slope: f64,
    offset: f64,
}

/// Number of bins of a line per direction. Both the error of the bins and that of the directions fall with the square of their number, so
/// the bins' error stays a small part.
const BINS_PER_DIRECTION: usize = 32;

/// Largest error of the bins, relative to the sum and to the error of the directions. Above it the line is sorted instead, for example if
/// a few distant points leave the others in too few bins.
const MOST_SLACK: f64 = 0.25;

/// A line on which points are projected, with reusable buffers.
#[derive(Default)]
struct Line {
    values: Vec<f64>,
    /// Index of the bin of every value.
    places: Vec<i32>,
    bins: Vec<Bin>,
    sorted: Vec<f64>,
    prefix: Vec<f64>,
}

impl Line {
    /// Adds to `sums` the bounds of the sums of distances from the values with the indices `wanted` to all values. `slack` is the largest
    /// allowed error, as a share of the sum.
    fn add(&mut self, bin_count: usize, slack: f64, wanted: &[usize], sums: &mut [Bounds]) {
        let n = self.values.len() as f64;
        let (lowest, highest) =
            self.values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (v.min(low), v.max(high)));
        let width = (highest - lowest) / bin_count as f64;
        let per_width = 1.0 / width;
        if !(per_width.is_finite() && width.is_finite()) {
            return self.add_sorted(wanted, sums);
        }
        self.places.clear();
        self.places.resize(self.values.len(), 0);
        let last = bin_count as i32 - 1;
        let (values, places) = (&self.values[..], &mut self.places[..]);
        widest(
            #[inline(always)]
            || {
                for (place, v) in places.iter_mut().zip(values) {
                    *place = (((v - lowest) * per_width) as i32).min(last);
                }
            },
        );
        self.bins.clear();
        self.bins.resize(bin_count, Bin::default());
        for (&v, &place) in self.values.iter().zip(&self.places) {
            let bin = &mut self.bins[place as usize];
            bin.count += 1.0;
            bin.sum += v;
        }
        let total: f64 = self.bins.iter().map(|bin| bin.sum).sum();
        let (mut count, mut sum) = (0.0, 0.0);
        // Smallest of the sums at the bin edges.
        let mut smallest = f64::INFINITY;
        let mut most_open: f64 = 0.0;
        // A value can lie outside its bin by rounding.
        let extent = width * (1.0 + 1e-9);
        for (b, bin) in self.bins.iter_mut().enumerate() {
            let above = n - count - bin.count;
            bin.slope = count - above;
            bin.offset = (total - sum - bin.sum) - sum;
            let edge = lowest + width * b as f64;
            smallest = smallest.min((count - (n - count)) * edge + (total - sum) - sum);
            most_open = most_open.max((bin.count - 1.0) * extent);
            count += bin.count;
            sum += bin.sum;
        }
        // Within a bin the function may be lower than at its edges, but by no more than the slopes there allow.
        if most_open > slack * (smallest - 2.0 * (most_open + extent)) {
            return self.add_sorted(wanted, sums);
        }
        for (to, &i) in sums.iter_mut().zip(wanted) {
            let s = self.values[i];
            let bin = &self.bins[self.places[i] as usize];
            // The sum of distances within the bin is at least the distance of the sums, and no distance is longer than the bin.
            let outside = bin.slope * s + bin.offset;
            *to += Bounds { lower: outside + (s * bin.count - bin.sum).abs(), upper: outside + (bin.count - 1.0) * extent };
        }
    }

    /// Adds the exact sums, by sorting.
    fn add_sorted(&mut self, wanted: &[usize], sums: &mut [Bounds]) {
        let n = self.values.len() as f64;
        self.sorted.clone_from(&self.values);
        self.sorted.sort_unstable_by(f64::total_cmp);
        self.prefix.clear();
        self.prefix.push(0.0);
        let mut sum = 0.0;
        for value in &self.sorted {
            sum += value;
            self.prefix.push(sum);
        }
        for (to, &i) in sums.iter_mut().zip(wanted) {
            let s = self.values[i];
            let below = self.sorted.partition_point(|value| *value < s);
            let exact = s * (2.0 * below as f64 - n) + sum - 2.0 * self.prefix[below];
            *to += Bounds { lower: exact, upper: exact };
        }
    }
}

/// Returns bounds of the sums, over all models, of the projected distances from the `wanted` models on `directions` directions, times
/// pi / (2 A).
fn projected_sums(points: &[Vector2<f64>], directions: usize, wanted: &[usize]) -> Vec<Bounds> {
    let step = std::f64::consts::PI / directions as f64;
    let mean = points.iter().sum::<Vector2<f64>>() / points.len() as f64;
    let (least, most) = factors(directions, points.len());
    let slack = MOST_SLACK * (most - least);
    let mut sums = vec![Bounds::default(); wanted.len()];
    let mut line = Line { values: vec![0.0; points.len()], ..Line::default() };
    for a in 0..directions {
        // Half a step off the axes, since many vectors may lie along the axes.
        let (sin, cos) = ((a as f64 + 0.5) * step).sin_cos();
        widest(
            #[inline(always)]
            || {
                for (value, p) in line.values.iter_mut().zip(points) {
                    *value = (p.x - mean.x) * cos + (p.y - mean.y) * sin;
                }
            },
        );
        line.add(BINS_PER_DIRECTION * directions, slack, wanted, &mut sums);
    }
    for sum in &mut sums {
        sum.lower *= step / 2.0;
        sum.upper *= step / 2.0;
    }
    sums
}

/// Number of partial sums computed in parallel.
const LANES: usize = 8;

/// Returns the sum of distances from a point to all points.
#[inline(always)]
fn exact_sum(x: &[f64], y: &[f64], px: f64, py: f64) -> f64 {
    let mut lanes = [0.0; LANES];
    let (xs, ys) = (x.chunks_exact(LANES), y.chunks_exact(LANES));
    let mut rest = 0.0;
    for (x, y) in xs.remainder().iter().zip(ys.remainder()) {
        rest += ((x - px).powi(2) + (y - py).powi(2)).sqrt();
    }
    for (cx, cy) in xs.zip(ys) {
        for lane in 0..LANES {
            let (dx, dy) = (cx[lane] - px, cy[lane] - py);
            lanes[lane] += (dx * dx + dy * dy).sqrt();
        }
    }
    lanes.iter().sum::<f64>() + rest
}

/// Bounds and decisions of one field.
struct Field {
    lower: Vec<f64>,
    upper: Vec<f64>,
    /// Models not decided by the bounds.
    open: Vec<usize>,
    /// Models certainly dropped.
    dropped: Vec<usize>,
}

impl Field {
    /// Classifies the models by their bounds as dropped, kept or open.
    fn decide(&mut self, drop_count: usize) {
        let n = self.lower.len();
        let threshold = |values: &[f64], rank: usize| {
            let mut values = values.to_vec();
            let (_, &mut value, _) = values.select_nth_unstable_by(n - 1 - rank, f64::total_cmp);
            value
        };
        // The (h + 1)-th largest upper bound. If a lower bound is above it, at most h upper bounds, including its own, reach it.
        let sure_above = threshold(&self.upper, drop_count);
        // The h-th largest lower bound. If an upper bound is below it, h other models are certainly larger.
        let sure_below = threshold(&self.lower, drop_count - 1);
        (self.open, self.dropped) = (Vec::new(), Vec::new());
        for i in 0..n {
            if self.lower[i] > sure_above {
                self.dropped.push(i);
            } else if self.upper[i] >= sure_below {
                self.open.push(i);
            }
        }
    }
}

/// Drops from every field the `drop_count` models with the largest `d_tf`. `drop_count` is at least 1 and less than the number of models.
///
/// # Errors
/// `SourceError`.
pub fn trim_certified<S: SlotSource + ?Sized>(
    source: &S,
    drop_count: usize,
    memory: u64,
) -> Result<CertifiedTrimming, SourceError> {
    let (n, field_count, node_count) = (source.model_count(), source.field_count(), source.node_count());
    // Factor from sums over models and nodes to d_tf.
    let scale = 1.0 / (node_count as f64 * (n - 1).max(1) as f64);
    let all: Vec<usize> = (0..n).collect();
    let mut fields: Vec<Field> = (0..field_count)
        .map(|_| Field { lower: vec![0.0; n], upper: vec![f64::INFINITY; n], open: all.clone(), dropped: Vec::new() })
        .collect();
    let mut distances = vec![vec![0.0; n]; field_count];
    let mut relative_bound: f64 = 0.0;
    for (turn, &directions) in DIRECTIONS.iter().enumerate() {
        let open = fields.iter().map(|f| f.open.len()).max().unwrap_or(0);
        if turn > 0 && open <= MODELS_PER_DIRECTION * directions {
            break;
        }
        let sums = sum_over_nodes(source, memory, |points, m| projected_sums(points, directions, &fields[m].open))?;
        let (least, most) = factors(directions, n);
        for ((field, sums), distances) in fields.iter_mut().zip(sums).zip(&mut distances) {
            for (&i, sum) in field.open.iter().zip(sums) {
                // All bounds hold, so the tighter ones are kept.
                let (lower, upper) = (sum.lower / most, sum.upper / least);
                field.lower[i] = field.lower[i].max(lower);
                field.upper[i] = field.upper[i].min(upper);
                distances[i] = f64::midpoint(lower, upper) * scale;
                relative_bound = relative_bound.max((upper - lower) / 2.0 / lower);
            }
            field.decide(drop_count);
        }
    }
    let exact = sum_over_nodes(source, memory, |points, m| {
        let (x, y): (Vec<f64>, Vec<f64>) = points.iter().map(|p| (p.x, p.y)).unzip();
        let mut sums = vec![0.0; fields[m].open.len()];
        widest(
            #[inline(always)]
            || {
                for (sum, &i) in sums.iter_mut().zip(&fields[m].open) {
                    *sum = exact_sum(&x, &y, x[i], y[i]);
                }
            },
        );
        sums
    })?;
    let mut undecided = Vec::new();
    let mut kept = Vec::with_capacity(field_count);
    let mut exactly = 0;
    for ((field, sums), distances) in fields.iter_mut().zip(exact).zip(&mut distances) {
        exactly += field.open.len();
        let mut order: Vec<(f64, usize)> = sums.into_iter().zip(field.open.iter().copied()).collect();
        order.iter().for_each(|&(sum, i)| distances[i] = sum * scale);
        // Farthest first; of equally far models the later one first.
        order.sort_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
        let missing = drop_count - field.dropped.len();
        // Rounding error of sums of N'' N terms in eight partial sums.
        let rounding = 2.0 * (n + node_count) as f64 * f64::EPSILON;
        if missing > 0 && missing < order.len() {
            let (last, first) = (order[missing - 1].0, order[missing].0);
            if last != first && last - first <= rounding * last {
                let near = |&&(sum, _): &&(f64, usize)| (sum - last).abs() <= rounding * last;
                undecided.extend(order.iter().filter(near).map(|&(_, i)| i));
            }
        }
        let mut is_dropped = vec![false; n];
        let chosen = order.iter().take(missing).map(|&(_, i)| i);
        chosen.chain(field.dropped.iter().copied()).for_each(|i| is_dropped[i] = true);
        kept.push((0..n).filter(|&i| !is_dropped[i]).collect());
    }
    undecided.sort_unstable();
    undecided.dedup();
    Ok(CertifiedTrimming { kept, distances, relative_bound, exact: exactly, undecided })
}

/// Returns, by field, the sums over the nodes of the values that `of_slot` computes from a slot's points and its field index. Nodes are
/// added in order.
fn sum_over_nodes<S: SlotSource + ?Sized, T: AddAssign + Send>(
    source: &S,
    memory: u64,
    of_slot: impl Fn(&[Vector2<f64>], usize) -> Vec<T> + Sync,
) -> Result<Vec<Vec<T>>, SourceError> {
    let (nodes, fields) = (source.node_count(), source.field_count());
    let mut sums: Vec<Vec<T>> = (0..fields).map(|_| Vec::new()).collect();
    let mut start = 0;
    while start < nodes {
        let end = nodes.min(start + nodes_at_once(source, memory));
        let read: Vec<_> = (start..end).map(|k| source.node(k)).collect::<Result<_, _>>()?;
        let slots: Vec<(usize, &Vec<Vector2<f64>>)> = read.iter().flat_map(|node| node.iter().enumerate()).collect();
        let parts: Vec<Vec<T>> = slots.par_iter().map(|&(m, points)| of_slot(points, m)).collect();
        for ((m, _), part) in slots.iter().zip(parts) {
            let sums = &mut sums[*m];
            if sums.is_empty() {
                *sums = part;
            } else {
                sums.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
            }
        }
        start = end;
    }
    Ok(sums)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projections_bound_a_length_from_both_sides() {
        // A distance of 5 between two points, in any direction.
        for directions in [2, 8, 32, 128] {
            let (least, most) = factors(directions, 2);
            let mut tightest: (f64, f64) = (0.0, f64::INFINITY);
            for k in 0..200 {
                let angle = f64::from(k) * 0.0314;
                let points = [Vector2::new(7.0, -3.0), Vector2::new(7.0 + 5.0 * angle.cos(), -3.0 + 5.0 * angle.sin())];
                let sums = projected_sums(&points, directions, &[0, 1]);
                assert!(
                    sums[0].lower / most <= 5.0 * (1.0 + 1e-14) && 5.0 <= sums[0].upper / least * (1.0 + 1e-14),
                    "{directions} {k} {sums:?}"
                );
                tightest = (tightest.0.max(sums[0].lower / most), tightest.1.min(sums[0].upper / least));
            }
            // The bounds are reached, so no tighter ones hold for every direction.
            assert!(tightest.0 > 5.0 * (1.0 - 1e-3) && tightest.1 < 5.0 * (1.0 + 1e-3), "{directions} {tightest:?}");
        }
    }

    #[test]
    fn a_line_is_summed_as_by_hand() {
        // Sums for 0, 1, 2, 9: 12, 10, 10, 24 (as in the test of plain trimming), times the bounds of the projection.
        let points = [0.0, 1.0, 2.0, 9.0].map(|x| Vector2::new(x, 0.0));
        let sums = projected_sums(&points, 128, &[0, 1, 2, 3]);
        for (sum, expected) in sums.iter().zip([12.0, 10.0, 10.0, 24.0]) {
            // With one point per bin the bounds are equal.
            approx::assert_relative_eq!(sum.lower, sum.upper, max_relative = 1e-14);
            approx::assert_relative_eq!(sum.lower, expected, max_relative = 1e-4);
        }
        let (x, y): (Vec<f64>, Vec<f64>) = (points.iter().map(|p| p.x).collect(), vec![0.0; 4]);
        assert_eq!(exact_sum(&x, &y, 9.0, 0.0), 24.0);
    }

    /// Sums of distances on a line from every value, by bins or by sorting, and the same sums from all pairs.
    fn line_sums(values: Vec<f64>, bins: usize, slack: f64) -> (Vec<Bounds>, Vec<f64>) {
        let pairs = values.iter().map(|s| values.iter().map(|v| (s - v).abs()).sum()).collect();
        let wanted: Vec<usize> = (0..values.len()).collect();
        let mut sums = vec![Bounds::default(); values.len()];
        Line { values, ..Line::default() }.add(bins, slack, &wanted, &mut sums);
        (sums, pairs)
    }

    #[test]
    fn bins_bound_the_sums_of_all_pairs() {
        let spread = |k: usize| (k as f64 * 0.618).fract();
        let bell: Vec<f64> = (0..500).map(|k| spread(k) + spread(3 * k + 1) + spread(7 * k + 2) - 1.5).collect();
        // All values equal but one; one distant value; all equal: these are sorted.
        let lonely = (0..100).map(|k| f64::from(u8::from(k == 7))).collect();
        let far = (0..300).map(|k| if k == 5 { -1e9 } else { spread(k) }).collect();
        for (name, values, is_sorted) in
            [("bell", bell, false), ("lonely", lonely, true), ("far", far, true), ("equal", vec![0.25; 9], true)]
        {
            let (sums, pairs) = line_sums(values, 256, 1e-3);
            let width = |sum: &Bounds| (sum.upper - sum.lower) / sum.lower;
            assert_eq!(sums.iter().all(|sum| sum.upper == sum.lower), is_sorted, "{name}");
            for (sum, pair) in sums.iter().zip(pairs) {
                let rounding = 1e-12 * pair.max(1e-300);
                assert!(sum.lower <= pair + rounding && pair <= sum.upper + rounding, "{name}: {sum:?} {pair}");
                assert!(sum.lower == sum.upper || width(sum) < 1e-3, "{name}: {sum:?}");
            }
        }
    }
}
