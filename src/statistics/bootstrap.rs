//! How sure a dispersion is: a bootstrap over people (Efron & Tibshirani 1993).
//!
//! A replicate draws as many people as there are, with replacement, each with all their sequences; trims, takes the median and the
//! dispersion [KP, eq. (6) to (8)] anew. A class's dispersion is smaller than that of the population it was drawn from: the median lies
//! among the very people it is measured on. A replicate's is smaller than the class's for the same reason and by about as much, so
//! the interval is the basic one, `2 s - q` for the percentiles q of the replicates around the class's s (Davison & Hinkley 1997,
//! section 5.2); that of the percentiles themselves would be off by twice the difference. For more than [`MAX_RETRIMMED`] models the
//! replicates keep trimming and median of all models and draw the distances only: both are then settled to a share of the
//! scatter that is far below the dispersion's own error.

use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    Representative, SequenceModel,
    dispersion::median,
    distance::{DisplacementFields, length},
    trimming::trimmed_count,
};
use crate::units::NodeId;

/// Models up to which every replicate trims and takes its median anew.
pub const MAX_RETRIMMED: usize = 400;

/// People below which no interval is given: with fewer, the few values a replicate can take are no distribution.
pub const LEAST_PEOPLE: usize = 5;

/// Most steps of a replicate's medians, from the median of all.
const MEDIAN_STEPS: usize = 12;

/// Slope, over the weight, at which a replicate's median is good enough: its sum is then within about the square of it.
const FLAT: f64 = 1e-5;

/// An interval for the dispersion of a class.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DispersionInterval {
    /// Lower end, face units.
    pub low: f64,
    /// Upper end, face units.
    pub high: f64,
    /// Confidence, such as 0.95.
    pub level: f64,
    /// Replicates.
    pub replicates: usize,
    /// Whether the replicates trimmed and took their medians anew.
    pub retrimmed: bool,
}

/// The bootstrap interval, for a population, of the dispersion after trimming that a class of it has; `None` for fewer than [`LEAST_PEOPLE`] people or no replicates.
///
/// `models` are those that `representative` was made of, in any order; `stream` numbers the class, so that each has its own random
/// numbers.
pub fn dispersion_interval(
    representative: &Representative,
    models: &[&SequenceModel],
    live: &[NodeId],
    alpha: f64,
    replicates: usize,
    seed: u64,
    stream: u32,
) -> Option<DispersionInterval> {
    const LEVEL: f64 = 0.95;
    let mut models = models.to_vec();
    models.sort_by(|a, b| a.id.cmp(&b.id));
    // Places of the models of each person; the models are sorted by person.
    let mut people: Vec<Vec<usize>> = Vec::new();
    for (i, model) in models.iter().enumerate() {
        match people.last_mut().filter(|places| models[places[0]].id.subject == model.id.subject) {
            Some(places) => places.push(i),
            None => people.push(vec![i]),
        }
    }
    if people.len() < LEAST_PEOPLE || replicates == 0 {
        return None;
    }
    let retrimmed = models.len() <= MAX_RETRIMMED;
    let sample = retrimmed.then(|| Sample::new(&models, representative, live, alpha));
    let replicate = |number: usize| {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream((1 << 63) | (u64::from(stream) << 32) | number as u64);
        let mut copies = vec![0usize; models.len()];
        for _ in 0..people.len() {
            let drawn = random.random_range(0..people.len());
            people[drawn].iter().for_each(|&i| copies[i] += 1);
        }
        if let Some(sample) = &sample {
            return sample.dispersion(&copies);
        }
        let drawn = representative.distances.iter().zip(&copies);
        let mut distances: Vec<f64> =
            drawn.flat_map(|(distance, &n)| distance.iter().flat_map(move |&d| std::iter::repeat_n(d, n))).collect();
        median(&mut distances).unwrap_or(0.0)
    };
    let mut values: Vec<f64> = (0..replicates).into_par_iter().map(replicate).collect();
    values.sort_by(f64::total_cmp);
    let tail = (1.0 - LEVEL) / 2.0;
    let twice = 2.0 * representative.dispersion?;
    Some(DispersionInterval {
        low: (twice - quantile(&values, 1.0 - tail)).max(0.0),
        high: twice - quantile(&values, tail),
        level: LEVEL,
        replicates,
        retrimmed,
    })
}

/// Linear between the two values around the share, of sorted values, at least one.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let at = share * (sorted.len() - 1) as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    low + (high - low) * at.fract()
}

/// What every replicate of a class needs.
struct Sample {
    models: Vec<DisplacementFields>,
    /// `d_f` of all pairs by field, n x n.
    pairs: Vec<Vec<f64>>,
    /// The medians of all models, from which those of a replicate start, in slot order.
    start: Vec<Vector2<f64>>,
    alpha: f64,
}

impl Sample {
    fn new(models: &[&SequenceModel], representative: &Representative, live: &[NodeId], alpha: f64) -> Self {
        let models: Vec<_> = models.iter().map(|m| DisplacementFields::of_model(&m.model, live)).collect();
        let center = DisplacementFields::of_model(&representative.model, live);
        let n = models.len();
        let of_field = |m: usize| {
            let row = |i: usize| (0..n).map(|j| models[i].frame_distance(&models[j], m)).collect::<Vec<_>>();
            (0..n).into_par_iter().flat_map_iter(row).collect()
        };
        let (fields, nodes) = (center.field_count(), center.node_count());
        let pairs = (0..fields).map(of_field).collect();
        let start = (0..fields).flat_map(|m| (0..nodes).map(|k| center.vector(m, k)).collect::<Vec<_>>()).collect();
        Self { models, pairs, start, alpha }
    }

    /// Dispersion of the models, each as often as `copies` says.
    fn dispersion(&self, copies: &[usize]) -> f64 {
        let (fields, nodes) = (self.pairs.len(), self.models[0].node_count());
        let count: usize = copies.iter().sum();
        let drawn: Vec<usize> = (0..copies.len()).filter(|&i| copies[i] > 0).collect();
        let dropped = trimmed_count(self.alpha, count);
        // Of each model's copies the first `kept[m][i]` are kept in field m.
        let kept: Vec<Vec<usize>> = (0..fields).map(|m| self.kept(m, copies, &drawn, dropped)).collect();
        let mut sums = vec![0.0; drawn.len() * fields];
        for m in 0..fields {
            let members: Vec<usize> = drawn.iter().copied().filter(|&i| kept[m][i] > 0).collect();
            for k in 0..nodes {
                let points: Vec<(Vector2<f64>, f64)> =
                    members.iter().map(|&i| (self.models[i].vector(m, k), kept[m][i] as f64)).collect();
                let center = refined_median(&points, self.start[m * nodes + k]);
                for (place, &i) in drawn.iter().enumerate() {
                    let v = self.models[i].vector(m, k);
                    sums[place * fields + m] += length(v.x - center.x, v.y - center.y);
                }
            }
        }
        let mut distances = Vec::with_capacity(count);
        for (place, &i) in drawn.iter().enumerate() {
            for copy in 0..copies[i] {
                let in_fields = (0..fields).filter(|&m| copy < kept[m][i]);
                let (sum, number) =
                    in_fields.fold((0.0, 0), |(sum, n), m| (sum + sums[place * fields + m] / nodes as f64, n + 1));
                if number > 0 {
                    distances.push(sum / f64::from(number));
                }
            }
        }
        median(&mut distances).unwrap_or(0.0)
    }

    /// How many copies of every model field m keeps.
    fn kept(&self, m: usize, copies: &[usize], drawn: &[usize], dropped: usize) -> Vec<usize> {
        let n = copies.len();
        let sum = |i: usize| -> f64 { drawn.iter().map(|&j| copies[j] as f64 * self.pairs[m][i * n + j]).sum() };
        let mut order: Vec<(f64, usize)> = drawn.iter().map(|&i| (sum(i), i)).collect();
        // The farthest first, of equally far ones the later.
        order.sort_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
        let mut kept = copies.to_vec();
        let mut left = dropped;
        for (_, i) in order {
            let gone = left.min(kept[i]);
            kept[i] -= gone;
            left -= gone;
        }
        kept
    }
}

/// Distance under which x is at a point, face units: less than what files keep.
const AT_POINT: f64 = 1e-7;

/// The sum of distances from x to weighted points, and where to go from there.
struct Place {
    x: Vector2<f64>,
    sum: f64,
    /// No direction leads down by more than [`FLAT`].
    flat: bool,
    /// Where a lower sum is likely, best first: the Newton step, the nearest point, the Weiszfeld step (which never leads up).
    next: [Option<Vector2<f64>>; 3],
}

impl Place {
    fn new(points: &[(Vector2<f64>, f64)], x: Vector2<f64>) -> Self {
        let (mut sum, mut g, mut here, mut inverse, mut weight) = (0.0, Vector2::zeros(), 0.0, 0.0, 0.0);
        let (mut hxx, mut hxy, mut hyy) = (0.0, 0.0, 0.0);
        let mut nearest = (f64::INFINITY, None);
        for &(p, w) in points {
            weight += w;
            let d = x - p;
            let r = length(d.x, d.y);
            if r <= AT_POINT {
                here += w;
                sum += w * r;
                continue;
            }
            if r < nearest.0 {
                nearest = (r, Some(p));
            }
            let (u, per_length) = (d / r, w / r);
            sum += w * r;
            g += u * w;
            inverse += per_length;
            hxx += per_length * u.y * u.y;
            hxy -= per_length * u.x * u.y;
            hyy += per_length * u.x * u.x;
        }
        let slope = g.norm();
        let determinant = hxx * hyy - hxy * hxy;
        let regular = here == 0.0 && determinant > 1e-9 * inverse * inverse;
        let newton = || x - Vector2::new(hyy * g.x - hxy * g.y, hxx * g.y - hxy * g.x) / determinant;
        let weiszfeld = || x - g * ((1.0 - here / slope) / inverse);
        Self {
            x,
            sum,
            flat: slope <= here + FLAT * weight,
            next: [regular.then(newton), nearest.1, (inverse > 0.0 && slope > here).then(weiszfeld)],
        }
    }
}

/// The geometric median of weighted points after a few steps from a start that is near it.
fn refined_median(points: &[(Vector2<f64>, f64)], start: Vector2<f64>) -> Vector2<f64> {
    let mut place = Place::new(points, start);
    for _ in 0..MEDIAN_STEPS {
        let lower = |next: Option<Vector2<f64>>| next.map(|x| Place::new(points, x)).filter(|there| there.sum < place.sum);
        let next = if place.flat { None } else { place.next.into_iter().find_map(lower) };
        match next {
            Some(there) => place = there,
            None => break,
        }
    }
    place.x
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::statistics::median::{ExactOptions, PointSet, geometric_median};

    #[test]
    fn a_few_steps_from_nearby_find_the_median() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut gauss = || -> f64 { StandardNormal.sample(&mut random) };
        for _ in 0..50 {
            let points: Vec<Vector2<f64>> = (0..41).map(|_| Vector2::new(gauss(), 3.0 * gauss())).collect();
            let weights: Vec<f64> = (0..41).map(|_| gauss().abs().ceil()).collect();
            let exact = geometric_median(&PointSet::weighted(&points, &weights).unwrap(), &ExactOptions::default());
            let near = geometric_median(&PointSet::new(&points).unwrap(), &ExactOptions::default()).point;
            let weighted: Vec<_> = points.iter().copied().zip(weights).collect();
            let found = refined_median(&weighted, near);
            let sum = |x: Vector2<f64>| weighted.iter().map(|(p, w)| w * (x - p).norm()).sum::<f64>();
            assert!(sum(found) <= exact.sum * (1.0 + 1e-5), "{} {}", sum(found), exact.sum);
        }
    }

    #[test]
    fn quantiles_lie_between_values() {
        // Of 0, 10, 20, 30, 40 the share 0.1 is at place 0.4.
        assert_eq!(quantile(&[0.0, 10.0, 20.0, 30.0, 40.0], 0.1), 4.0);
        assert_eq!(quantile(&[7.0], 0.975), 7.0);
    }
}
