//! All groups of an emotion at once: does their location differ, and does their scatter?
//!
//! **Location.** The pseudo-F of a permutational analysis of variance (Anderson 2001) on the distances d of people: the squared distances
//! between groups over those within. **Scatter.** The F of an analysis of variance of the people's distances to the centroid of their
//! own group (Anderson 2006), computed from d alone. The first answers to a shift, the second to one group being more alike than
//! another; the energy test between pairs answers to both. In both, labels of people are permuted, within strata where asked for.

use std::collections::BTreeMap;

use rand::RngExt;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    CompareOptions, NotTested, SequenceModel, Strata, by_subject,
    holm::holm,
    pairs::PairDistances,
    permutation::{draw, generator},
};
use crate::{statistics::distance::DisplacementFields, units::NodeId};

/// Outcome of the tests over all groups of an emotion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Omnibus {
    /// People used of each group.
    pub people: Vec<usize>,
    /// Pseudo-F of the location.
    pub location_f: f64,
    /// Share of the squared distances that lies between the groups.
    pub location_share: f64,
    /// Chance of a location F at least as large without a difference.
    pub location_p: f64,
    /// [`Omnibus::location_p`] after Holm over all tests of this kind in the analysis, scatter included.
    pub location_p_adjusted: f64,
    /// Mean distance of each group's people to their group's centroid, face units.
    pub scatters: Vec<f64>,
    /// F of the scatter.
    pub scatter_f: f64,
    /// Chance of a scatter F at least as large without a difference.
    pub scatter_p: f64,
    /// [`Omnibus::scatter_p`] after Holm.
    pub scatter_p_adjusted: f64,
    /// Permutations.
    pub permutations: usize,
}

/// All groups of one emotion, compared at once.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OmnibusComparison {
    /// Emotion.
    pub emotion: String,
    /// The groups.
    pub groups: Vec<BTreeMap<String, String>>,
    /// The tests, or why there are none.
    pub outcome: Result<Omnibus, String>,
}

/// Purposes of the random numbers of draws, one a group, and of the permutations.
const DRAWS: u64 = 64;
const PERMUTATIONS: u64 = 63;

/// Relative difference of two F that is rounding.
const ROUNDING: f64 = 1e-10;

/// Tests location and scatter of two or more groups.
///
/// # Errors
/// The reason why there is no test, in words.
pub fn omnibus(
    groups: &[Vec<&SequenceModel>],
    live: &[NodeId],
    options: &CompareOptions,
    strata: Option<&Strata>,
    stream: u32,
) -> Result<Omnibus, String> {
    if groups.len() < 2 {
        return Err(format!("{} group; two or more can be compared", groups.len()));
    }
    let by_group: Vec<_> = groups.iter().map(|models| by_subject(models)).collect();
    if let Some(alone) = by_group.iter().find(|people| people.len() < super::LEAST_PEOPLE) {
        return Err(NotTested::TooFewPeople { people: alone.len() }.to_string());
    }
    let (mut people, mut labels, mut subjects) = (Vec::new(), Vec::new(), Vec::<&str>::new());
    for (g, of_group) in by_group.iter().enumerate() {
        let all: Vec<(&&str, &Vec<&SequenceModel>)> = of_group.iter().collect();
        for i in draw(all.len(), options, stream, DRAWS + g as u64) {
            if subjects.contains(all[i].0) {
                return Err(NotTested::SharedPeople { subjects: vec![(*all[i].0).to_owned()], count: 1 }.to_string());
            }
            subjects.push(all[i].0);
            labels.push(g);
            people.push(all[i].1.iter().map(|m| DisplacementFields::of_model(&m.model, live)).collect::<Vec<_>>());
        }
    }
    let blocks = match strata {
        None => vec![(0..labels.len()).collect::<Vec<_>>()],
        Some(strata) => {
            let mut blocks: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
            let of = strata.of(&subjects).map_err(|why| why.to_string())?;
            of.into_iter().enumerate().for_each(|(place, stratum)| blocks.entry(stratum).or_default().push(place));
            let blocks: Vec<Vec<usize>> = blocks.into_values().collect();
            if blocks.iter().all(|places| places.iter().all(|&p| labels[p] == labels[places[0]])) {
                return Err(super::StrataError::Coincide { columns: strata.columns().to_owned() }.to_string());
            }
            blocks
        }
    };
    test(&PairDistances::new(&people).matrix(), &labels, &blocks, options, stream)
}

/// The tests for a matrix of distances; people exchange labels within blocks.
fn test(
    distances: &[Vec<f64>],
    labels: &[usize],
    blocks: &[Vec<usize>],
    options: &CompareOptions,
    stream: u32,
) -> Result<Omnibus, String> {
    let sizes = sizes(labels);
    let location = Location::new(distances, labels, &sizes);
    let own = distances_to_centroid(distances, labels, &sizes);
    let scatter_f = analysis_of_variance(&own, labels, &sizes);
    if !(location.total > 0.0) || location.within <= ROUNDING * location.total {
        return Err("all people of a group are alike; a test needs people who differ".to_owned());
    }
    let location_f = location.f(labels.len(), sizes.len());
    let permuted = |unit: usize| {
        let mut random = generator(options.seed, stream, PERMUTATIONS, unit as u64);
        let mut shuffled = labels.to_vec();
        for places in blocks {
            for k in (1..places.len()).rev() {
                shuffled.swap(places[k], places[random.random_range(0..=k)]);
            }
        }
        let f = Location::new(distances, &shuffled, &sizes).f(labels.len(), sizes.len());
        let at_least = |f: f64, observed: f64| f >= observed - ROUNDING * observed.abs();
        let scatter = scatter_f
            .is_some_and(|observed| analysis_of_variance(&own, &shuffled, &sizes).is_some_and(|f| at_least(f, observed)));
        (at_least(f, location_f), scatter)
    };
    let outcomes: Vec<(bool, bool)> = (0..options.permutations).into_par_iter().map(permuted).collect();
    let p = |count: usize| (1 + count) as f64 / (1 + outcomes.len()) as f64;
    let scatters = (0..sizes.len())
        .map(|g| own.iter().zip(labels).filter(|(_, label)| **label == g).map(|(z, _)| z).sum::<f64>() / sizes[g] as f64);
    Ok(Omnibus {
        scatters: scatters.collect(),
        location_f,
        location_share: 1.0 - location.within / location.total,
        location_p: p(outcomes.iter().filter(|o| o.0).count()),
        location_p_adjusted: 1.0,
        scatter_f: scatter_f.unwrap_or(0.0),
        scatter_p: if scatter_f.is_some() { p(outcomes.iter().filter(|o| o.1).count()) } else { 1.0 },
        scatter_p_adjusted: 1.0,
        permutations: outcomes.len(),
        people: sizes,
    })
}

fn sizes(labels: &[usize]) -> Vec<usize> {
    let mut sizes = vec![0; labels.iter().max().map_or(0, |most| most + 1)];
    labels.iter().for_each(|&label| sizes[label] += 1);
    sizes
}

/// Sums of squared distances over all people and within groups.
struct Location {
    total: f64,
    within: f64,
}

impl Location {
    fn new(distances: &[Vec<f64>], labels: &[usize], sizes: &[usize]) -> Self {
        let (mut total, mut within) = (0.0, vec![0.0; sizes.len()]);
        for (i, row) in distances.iter().enumerate() {
            for (j, d) in row.iter().enumerate().skip(i + 1) {
                total += d * d;
                if labels[i] == labels[j] {
                    within[labels[i]] += d * d;
                }
            }
        }
        let within = within.iter().zip(sizes).map(|(sum, &n)| sum / n as f64).sum();
        Self { total: total / distances.len() as f64, within }
    }

    fn f(&self, people: usize, groups: usize) -> f64 {
        ((self.total - self.within) / (groups - 1) as f64) / (self.within / (people - groups) as f64)
    }
}

/// Distance of everybody to the centroid of their group, from distances between people.
fn distances_to_centroid(distances: &[Vec<f64>], labels: &[usize], sizes: &[usize]) -> Vec<f64> {
    let squares = |i: usize, g: usize| -> f64 {
        distances[i].iter().zip(labels).filter(|(_, label)| **label == g).map(|(d, _)| d * d).sum()
    };
    let to_own: Vec<f64> = (0..labels.len()).map(|i| squares(i, labels[i])).collect();
    let mut sums = vec![0.0; sizes.len()];
    to_own.iter().zip(labels).for_each(|(sum, &g)| sums[g] += sum);
    let distance = |(i, &g): (usize, &usize)| {
        let n = sizes[g] as f64;
        // Sums over all ordered pairs are twice those over pairs. Distances that no space has may make this negative: 0 then.
        (to_own[i] / n - sums[g] / (2.0 * n * n)).max(0.0).sqrt()
    };
    labels.iter().enumerate().map(distance).collect()
}

/// F of a one-way analysis of variance; `None` where no group scatters.
fn analysis_of_variance(values: &[f64], labels: &[usize], sizes: &[usize]) -> Option<f64> {
    let all = values.iter().sum::<f64>() / values.len() as f64;
    let mut means = vec![0.0; sizes.len()];
    values.iter().zip(labels).for_each(|(v, &g)| means[g] += v / sizes[g] as f64);
    let between: f64 = means.iter().zip(sizes).map(|(m, &n)| n as f64 * (m - all).powi(2)).sum();
    let within: f64 = values.iter().zip(labels).map(|(v, &g)| (v - means[g]).powi(2)).sum();
    let total = between + within;
    (within > ROUNDING * total).then(|| (between / (sizes.len() - 1) as f64) / (within / (values.len() - sizes.len()) as f64))
}

/// Corrects the p of all comparisons for their number, location and scatter together.
pub fn adjust_omnibus(comparisons: &mut [OmnibusComparison]) {
    let mut tests: Vec<&mut Omnibus> = comparisons.iter_mut().filter_map(|c| c.outcome.as_mut().ok()).collect();
    let p: Vec<f64> = tests.iter().flat_map(|t| [t.location_p, t.scatter_p]).collect();
    for (test, adjusted) in tests.iter_mut().zip(holm(&p).chunks_exact(2)) {
        (test.location_p_adjusted, test.scatter_p_adjusted) = (adjusted[0], adjusted[1]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three groups of people on a plane, from `scripts/check_statistics.py`.
    const POINTS: [(f64, f64); 15] = [
        (0.1, 0.4),
        (1.2, -0.3),
        (-0.7, 0.8),
        (0.5, -1.1),
        (-0.2, 0.3),
        (2.1, 1.9),
        (3.0, 0.2),
        (1.1, 3.3),
        (4.2, 2.8),
        (2.5, -0.9),
        (0.3, 2.2),
        (0.9, 2.6),
        (0.6, 1.8),
        (1.0, 2.1),
        (0.4, 2.5),
    ];

    fn distances() -> Vec<Vec<f64>> {
        let d = |a: (f64, f64), b: (f64, f64)| (a.0 - b.0).hypot(a.1 - b.1);
        POINTS.iter().map(|&a| POINTS.iter().map(|&b| d(a, b)).collect()).collect()
    }

    #[test]
    fn location_and_scatter_agree_with_scikit_bio_and_scipy() {
        let labels: Vec<usize> = (0..15).map(|i| i / 5).collect();
        let options = CompareOptions { permutations: 9999, ..CompareOptions::default() };
        let found = test(&distances(), &labels, &[(0..15).collect()], &options, 0).unwrap();
        approx::assert_relative_eq!(found.location_f, SCIKIT_BIO[0], max_relative = 1e-6);
        approx::assert_relative_eq!(found.scatter_f, SCIKIT_BIO[1], max_relative = 1e-6);
        // Of 9,999 permutations each: within four standard errors of both.
        for (p, expected) in [(found.location_p, SCIKIT_BIO[2]), (found.scatter_p, SCIKIT_BIO[3])] {
            assert!((p - expected).abs() < 4.0 * (2.0 * expected / 9999.0).sqrt() + 2e-4, "{p} {expected}");
        }
        assert_eq!(found, test(&distances(), &labels, &[(0..15).collect()], &options, 0).unwrap());
    }

    #[test]
    fn people_who_are_all_alike_say_so() {
        let same = vec![vec![0.0; 4]; 4];
        let why = test(&same, &[0, 0, 1, 1], &[vec![0, 1, 2, 3]], &CompareOptions::default(), 0).unwrap_err();
        assert!(why.starts_with("all people of a group are alike"));
    }

    // F of location and scatter and their p, from scripts/check_statistics.py
    const SCIKIT_BIO: [f64; 4] = [7.6077193, 10.0998815, 3e-5, 0.0056];
}
