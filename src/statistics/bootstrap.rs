//! Confidence interval of a class's dispersion, by subsampling people (Politis & Romano 1994).
//!
//! A class's dispersion s is smaller than that of its population, because the median is computed from the same people that are measured.
//! Taking every person's distance to the median of the *others* gives s', which is too large by about as much, because that median has an
//! error of its own. The interval is therefore centred at the mean of s and s'.
//!
//! Its half width is 1.96 standard deviations of the dispersions of m of the n people, drawn without replacement, times
//! `sqrt(m / (n - m))`. This estimates the standard deviation of s between classes. Trimming and median are computed anew in each draw. m
//! is half of the people, at most [`MOST_DRAWN`].
//!
//! The usual bootstrap, with replacement, is not used. Its draws contain copies of the same people, and a median is closer to copies than
//! to other people. If trimming and median are recomputed, its standard deviation is several times too large for 10 people; if they are
//! held fixed, it is too small. `evaluate groups --intervals` counts how often the intervals contain the true value.
//!
//! For more than [`MAX_EXACT`] models, the median without a person is approximated by one Newton step from the median of all.

use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    Representative, SequenceModel, StatisticsOptions,
    dispersion::median_of,
    distance::{DisplacementFields, length},
    trimming::{sums_of_distances, trim_outliers},
    weights::{Weighting, sequence_weights},
};
use crate::{output::count, units::NodeId};

/// Largest number of models for which the median without a person is searched for; above it, one Newton step is taken.
const MAX_EXACT: usize = 400;

/// Smallest number of people for an interval. With fewer, the median of a replicate can take only a few values.
pub const LEAST_PEOPLE: usize = 8;

/// Largest number of people in a draw. Larger draws need many more pairwise distances and hardly change the dispersions.
pub const MOST_DRAWN: usize = 100;

/// Largest number of steps of a replicate's median search, which starts at the median of all.
const MEDIAN_STEPS: usize = 12;

/// Slope, relative to the weight, at which a replicate's median search stops. The relative error of the sum is then about its square.
const FLAT: f64 = 1e-5;

/// Confidence level of the intervals.
const LEVEL: f64 = 0.95;

/// Number of standard deviations on either side of the mean that contain the share [`LEVEL`] of a normal distribution.
const QUANTILE: f64 = 1.959_963_985;

/// Returns the reason why a class has no interval, or `None` if it has enough people and draws.
pub fn no_interval(people: usize, replicates: usize) -> Option<String> {
    match (people, replicates) {
        (..LEAST_PEOPLE, _) => {
            Some(format!("{} too few for an interval; {LEAST_PEOPLE} are needed", count(people, "person is", "people are")))
        }
        (_, 0) => Some("no draws were asked for".to_owned()),
        (_, 1) => Some("1 draw is too few for an interval; 2 are needed".to_owned()),
        _ => None,
    }
}

/// Confidence interval of a class's dispersion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DispersionInterval {
    /// Lower end, face units.
    pub low: f64,
    /// Upper end, face units.
    pub high: f64,
    /// Confidence level, such as 0.95.
    pub level: f64,
    /// Number of replicates.
    pub replicates: usize,
}

/// The dispersions from which the intervals of a class are computed.
#[derive(Clone, Debug, PartialEq)]
pub struct DispersionReplicates {
    /// The class's dispersion after trimming, face units.
    pub dispersion: f64,
    /// The same, with each person's distance taken to the median of the others, face units.
    pub left_out: f64,
    /// Dispersions of the draws, ascending, face units.
    pub values: Vec<f64>,
    /// Number of people.
    pub people: usize,
    /// Number of people per draw.
    pub drawn: usize,
}

impl DispersionReplicates {
    /// Returns the interval centred at the mean of both dispersions.
    pub fn interval(&self) -> DispersionInterval {
        self.around(f64::midpoint(self.dispersion, self.left_out))
    }

    /// Returns the interval centred at the leave-one-out dispersion, for comparison.
    pub fn around_left_out(&self) -> DispersionInterval {
        self.around(self.left_out)
    }

    /// Returns the interval centred at the class's own dispersion, for comparison.
    pub fn around_own(&self) -> DispersionInterval {
        self.around(self.dispersion)
    }

    fn around(&self, center: f64) -> DispersionInterval {
        let (n, m) = (self.people as f64, self.drawn as f64);
        let half = QUANTILE * deviation(&self.values) * (m / (n - m)).sqrt();
        let replicates = self.values.len();
        DispersionInterval { low: (center - half).max(0.0), high: center + half, level: LEVEL, replicates }
    }
}

/// Standard deviation of one or more values.
fn deviation(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() - 1).max(1) as f64).sqrt()
}

/// Returns the 95 % confidence interval of a class's dispersion after trimming.
///
/// Returns `None` for fewer than [`LEAST_PEOPLE`] people or fewer than two replicates; [`no_interval`] gives the reason in words.
///
/// `models` are those that `representative` was computed from with `options`, in any order. `stream` is the number of the class, so that
/// each class has its own random numbers.
pub fn dispersion_interval(
    representative: &Representative,
    models: &[&SequenceModel],
    live: &[NodeId],
    options: &StatisticsOptions,
    replicates: usize,
    (seed, stream): (u64, u32),
) -> Option<DispersionInterval> {
    dispersion_replicates(representative, models, live, options, replicates, (seed, stream)).map(|r| r.interval())
}

/// Returns the dispersions from which `dispersion_interval` is computed, or `None` under its conditions.
pub fn dispersion_replicates(
    representative: &Representative,
    models: &[&SequenceModel],
    live: &[NodeId],
    options: &StatisticsOptions,
    replicates: usize,
    (seed, stream): (u64, u32),
) -> Option<DispersionReplicates> {
    let mut models = models.to_vec();
    models.sort_by(|a, b| a.id.cmp(&b.id));
    // Indices of the models of each person; the models are sorted by person.
    let mut people: Vec<Vec<usize>> = Vec::new();
    for (i, model) in models.iter().enumerate() {
        match people.last_mut().filter(|places| models[places[0]].id.subject == model.id.subject) {
            Some(places) => places.push(i),
            None => people.push(vec![i]),
        }
    }
    if people.len() < LEAST_PEOPLE || replicates < 2 {
        return None;
    }
    let weighting = if representative.weighted { Weighting::Person } else { Weighting::Sequence };
    let weights = sequence_weights(models.iter().map(|m| &m.id), weighting);
    let sample = Sample::new(&models, representative, live, weights);
    let kept = kept_fields(representative, &models, sample.fields);
    let others = sample.left_out(&people, &kept, models.len() <= MAX_EXACT);
    let drawn = (people.len() / 2).min(MOST_DRAWN);
    let replicate = |number: usize| {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream((1 << 63) | (u64::from(stream) << 32) | number as u64);
        let mut order: Vec<usize> = (0..people.len()).collect();
        let mut chosen = Vec::new();
        for place in 0..drawn {
            let other = random.random_range(place..order.len());
            order.swap(place, other);
            chosen.extend_from_slice(&people[order[place]]);
        }
        chosen.sort_unstable();
        sample.dispersion_of(&chosen, options)
    };
    let mut values: Vec<f64> = (0..replicates).into_par_iter().filter_map(replicate).collect();
    values.sort_by(f64::total_cmp);
    let left_out = median_of(others, sample.weights.as_deref())?;
    Some(DispersionReplicates { dispersion: representative.dispersion?, left_out, values, people: people.len(), drawn })
}

/// Returns, by field and model (sorted by id), whether the representative kept it.
fn kept_fields(representative: &Representative, models: &[&SequenceModel], fields: usize) -> Vec<Vec<bool>> {
    let mut kept = vec![vec![true; models.len()]; fields];
    for row in representative.trimming.iter().filter(|row| row.dropped) {
        if let Ok(i) = models.binary_search_by(|m| m.id.cmp(&row.id)) {
            kept[row.field][i] = false;
        }
    }
    kept
}

/// The models of a class, with their medians and weights.
struct Sample {
    models: Vec<DisplacementFields>,
    fields: usize,
    nodes: usize,
    /// Medians of all models, in slot order.
    start: Vec<Vector2<f64>>,
    /// Weights of the models, or `None` if all are equal.
    weights: Option<Vec<f64>>,
}

impl Sample {
    fn new(models: &[&SequenceModel], representative: &Representative, live: &[NodeId], weights: Option<Vec<f64>>) -> Self {
        let models: Vec<_> = models.iter().map(|m| DisplacementFields::of_model(&m.model, live)).collect();
        let center = DisplacementFields::of_model(&representative.model, live);
        let (fields, nodes) = (center.field_count(), center.node_count());
        let start = (0..fields).flat_map(|m| (0..nodes).map(|k| center.vector(m, k)).collect::<Vec<_>>()).collect();
        Self { models, fields, nodes, start, weights }
    }

    fn weight(&self, model: usize) -> f64 {
        self.weights.as_ref().map_or(1.0, |weights| weights[model])
    }

    /// Returns the dispersion after trimming of the models with the indices `chosen`, ascending.
    fn dispersion_of(&self, chosen: &[usize], options: &StatisticsOptions) -> Option<f64> {
        let members = vec![chosen.to_vec(); self.fields];
        let weights: Option<Vec<f64>> = self.weights.as_ref().map(|weights| chosen.iter().map(|&i| weights[i]).collect());
        let sums = sums_of_distances(&self.models, &members, self.weights.as_deref());
        let trimming = trim_outliers(&sums, weights.as_deref(), options.alpha, options.trim);
        let (mut totals, mut counts) = (vec![0.0; chosen.len()], vec![0usize; chosen.len()]);
        let mut points = Vec::new();
        for (m, kept) in trimming.kept.iter().enumerate() {
            for k in 0..self.nodes {
                points.clear();
                points.extend(kept.iter().map(|&j| (self.models[chosen[j]].vector(m, k), self.weight(chosen[j]))));
                let center = refined_median(&points, self.start[m * self.nodes + k]);
                for (&j, (v, _)) in kept.iter().zip(&points) {
                    totals[j] += length(v.x - center.x, v.y - center.y);
                }
            }
            kept.iter().for_each(|&j| counts[j] += 1);
        }
        let of_model = |(total, count): (&f64, &usize)| (*count > 0).then(|| total / (count * self.nodes) as f64);
        median_of(totals.iter().zip(&counts).map(of_model), weights.as_deref())
    }

    /// Returns every model's distance to the median of the other people, over its kept fields, or `None` if no field is kept.
    fn left_out(&self, people: &[Vec<usize>], kept: &[Vec<bool>], exact: bool) -> Vec<Option<f64>> {
        let (fields, nodes, n) = (self.fields, self.nodes, self.models.len());
        let of_slot = |slot: usize| -> Vec<f64> {
            let (m, k) = (slot / nodes, slot % nodes);
            let members: Vec<usize> = (0..n).filter(|&i| kept[m][i]).collect();
            let points: Vec<(Vector2<f64>, f64)> =
                members.iter().map(|&i| (self.models[i].vector(m, k), self.weight(i))).collect();
            let all = Place::new(&points, self.start[slot]);
            let mut distances = vec![0.0; n];
            let mut others = points.clone();
            for person in people {
                let own = |i: usize| person.contains(&i);
                let center = if exact {
                    others.clear();
                    others.extend(members.iter().zip(&points).filter(|(i, _)| !own(**i)).map(|(_, point)| *point));
                    refined_median(&others, self.start[slot])
                } else {
                    all.without(person.iter().filter(|&&i| kept[m][i]).map(|&i| (self.models[i].vector(m, k), self.weight(i))))
                };
                for &i in person {
                    let v = self.models[i].vector(m, k);
                    distances[i] = length(v.x - center.x, v.y - center.y);
                }
            }
            distances
        };
        let mut sums = vec![vec![0.0; n]; fields];
        let slots: Vec<Vec<f64>> = (0..fields * nodes).into_par_iter().map(of_slot).collect();
        for (slot, distances) in slots.iter().enumerate() {
            sums[slot / nodes].iter_mut().zip(distances).for_each(|(sum, d)| *sum += d);
        }
        let of_model = |i: usize| {
            let in_fields = (0..fields).filter(|&m| kept[m][i]);
            let (sum, count) = in_fields.fold((0.0, 0usize), |(sum, count), m| (sum + sums[m][i], count + 1));
            (count > 0).then(|| sum / (count * nodes) as f64)
        };
        (0..n).map(of_model).collect()
    }
}

/// Distance below which x coincides with a point, face units. Less than the precision of files.
const AT_POINT: f64 = 1e-7;

/// The sum of distances from x to weighted points, with its derivatives and candidates for the next x.
struct Place {
    x: Vector2<f64>,
    sum: f64,
    /// Whether no direction leads down by more than [`FLAT`].
    flat: bool,
    /// Derivatives at x: the gradient, and xx, xy and yy of the Hessian.
    gradient: Vector2<f64>,
    hessian: [f64; 3],
    /// Points that probably have a lower sum, best first: Newton step, nearest point, Weiszfeld step (which never increases the sum).
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
            gradient: g,
            hessian: [hxx, hxy, hyy],
            next: [regular.then(newton), nearest.1, (inverse > 0.0 && slope > here).then(weiszfeld)],
        }
    }
}

impl Place {
    /// Returns the approximate median of the points without those in `removed`: one Newton step from x.
    fn without(&self, removed: impl Iterator<Item = (Vector2<f64>, f64)>) -> Vector2<f64> {
        let (mut g, [mut hxx, mut hxy, mut hyy]) = (self.gradient, self.hessian);
        for (p, w) in removed {
            let d = self.x - p;
            let r = length(d.x, d.y);
            if r <= AT_POINT {
                continue;
            }
            let (u, per_length) = (d / r, w / r);
            g -= u * w;
            hxx -= per_length * u.y * u.y;
            hxy += per_length * u.x * u.y;
            hyy -= per_length * u.x * u.x;
        }
        let determinant = hxx * hyy - hxy * hxy;
        if determinant > 1e-9 * (hxx + hyy).powi(2) {
            self.x - Vector2::new(hyy * g.x - hxy * g.y, hxx * g.y - hxy * g.x) / determinant
        } else {
            self.x
        }
    }
}

/// Returns the geometric median of weighted points, after a few steps from `start`, which must be near it.
fn refined_median(points: &[(Vector2<f64>, f64)], start: Vector2<f64>) -> Vector2<f64> {
    if points.is_empty() {
        return start;
    }
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
    fn one_step_finds_the_median_without_one_of_many() {
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let mut gauss = || -> f64 { StandardNormal.sample(&mut random) };
        let points: Vec<(Vector2<f64>, f64)> = (0..801).map(|_| (Vector2::new(gauss(), 2.0 * gauss()), 1.0)).collect();
        let near = refined_median(&points, Vector2::zeros());
        let all = Place::new(&points, near);
        for i in 0..20 {
            let others: Vec<_> = points.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, p)| *p).collect();
            let exact = refined_median(&others, near);
            // One of 801 moves the median by about 0.002; the step misses by far less.
            assert!((all.without(std::iter::once(points[i])) - exact).norm() < 2e-4);
        }
    }

    #[test]
    fn an_interval_is_around_the_middle_of_both_dispersions() {
        // Deviation of 1, 2, 3 is 1: 4.5 plus and minus 1.96 times sqrt(4 / 6).
        let r = DispersionReplicates { dispersion: 4.0, left_out: 5.0, values: vec![1.0, 2.0, 3.0], people: 10, drawn: 4 };
        let half = 1.959_964 * (4.0f64 / 6.0).sqrt();
        approx::assert_relative_eq!(r.interval().low, 4.5 - half, max_relative = 1e-6);
        approx::assert_relative_eq!(r.interval().high, 4.5 + half, max_relative = 1e-6);
        approx::assert_relative_eq!(r.around_left_out().high, 5.0 + half, max_relative = 1e-6);
        assert!(no_interval(7, 100).unwrap().starts_with("7 people are too few") && no_interval(8, 2).is_none());
        assert_eq!([0, 1].map(|n| no_interval(8, n).is_some()), [true; 2]);
    }
}
