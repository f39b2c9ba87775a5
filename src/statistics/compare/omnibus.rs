//! Tests all groups of an emotion at once, for differences in location and in scatter.
//!
//! **Location.** The pseudo-F of a permutational analysis of variance (Anderson 2001) on the distances d of people: squared distances
//! between groups relative to those within groups. It detects shifts.
//!
//! **Scatter.** The F of an analysis of variance of the people's distances to the centroid of their own group (Anderson 2006), computed
//! from d alone. It detects that one group is more alike than another. (The energy test between pairs detects both.)
//!
//! In both tests the labels of people are permuted, within strata if requested, and everything is recomputed for the new groups,
//! including the centroids. The observed distances to the centroids must not be permuted themselves: every person pulls the centroid of a
//! small group towards themselves, so that such a test rejects too often.
//!
//! Squared distances are computed once. Those to a centroid follow from them: with D of all pairs of a group of n people, the square for
//! person i is `mean_j D_ij - mean_jk D_jk / 2`. A permutation costs one sum over the pairs within its groups.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{
    CompareOptions, Exchange, NotTested, SequenceModel, Strata, by_subject, holm::holm, pairs::distance_matrix, permutation::draw,
};
use crate::units::NodeId;

/// Results of the tests over all groups of an emotion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Omnibus {
    /// Number of people used from each group.
    pub people: Vec<usize>,
    /// Pseudo-F of the location.
    pub location_f: f64,
    /// Share of the squared distances that is between the groups.
    pub location_share: f64,
    /// Probability of a location F at least as large if the groups do not differ.
    pub location_p: f64,
    /// [`Omnibus::location_p`] with Holm's correction over all location and scatter tests of the analysis.
    pub location_p_adjusted: f64,
    /// Mean distance of each group's people to their group's centroid, face units.
    pub scatters: Vec<f64>,
    /// F of the scatter.
    pub scatter_f: f64,
    /// Probability of a scatter F at least as large if the groups do not differ.
    pub scatter_p: f64,
    /// [`Omnibus::scatter_p`] with Holm's correction.
    pub scatter_p_adjusted: f64,
    /// Number of permutations.
    pub permutations: usize,
    /// Whether these are all possible permutations.
    #[serde(default)]
    pub exhaustive: bool,
}

/// Comparison of all groups of one emotion at once.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OmnibusComparison {
    /// Emotion.
    pub emotion: String,
    /// The compared groups.
    pub groups: Vec<BTreeMap<String, String>>,
    /// Groups of fewer than [`super::LEAST_PEOPLE`], which are left out if there are enough others.
    #[serde(default)]
    pub left_out: Vec<BTreeMap<String, String>>,
    /// The tests, or the reason why there are none.
    pub outcome: Result<Omnibus, String>,
}

/// Purposes of the random numbers: draws (one purpose per group) and permutations.
const DRAWS: u64 = 64;
const PERMUTATIONS: u64 = 63;

/// Relative difference of two F values that counts as rounding error.
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
    options.check().map_err(|why| why.to_string())?;
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
            people.push(all[i].1.clone());
        }
    }
    let exchange = Exchange::new(labels, &subjects, strata).map_err(|why| why.to_string())?;
    let people = super::fields_of_people(&people, live).map_err(|why| why.to_string())?;
    test(&distance_matrix(&people), &exchange, options, stream)
}

/// Runs the tests on a matrix of distances.
fn test(distances: &[Vec<f64>], exchange: &Exchange, options: &CompareOptions, stream: u32) -> Result<Omnibus, String> {
    let labels = &exchange.labels;
    let sizes = sizes(labels);
    let observed = Split::new(distances, labels, &sizes);
    let total = total(distances);
    if !(total > 0.0) || observed.within <= ROUNDING * total {
        return Err("all people of a group move in the same way; a test needs people who differ".to_owned());
    }
    let location_f = observed.location_f(total);
    let scatter_f = analysis_of_variance(&observed.to_centroid, labels, &sizes);
    let tried = exchange.permute(options, (stream, PERMUTATIONS), |shuffled| {
        let split = Split::new(distances, shuffled, &sizes);
        let at_least = |f: f64, observed: f64| f >= observed - ROUNDING * observed.abs();
        // Without any scatter within the groups, F is infinite.
        let scatter = scatter_f.is_some_and(|observed| {
            analysis_of_variance(&split.to_centroid, shuffled, &sizes).is_none_or(|f| at_least(f, observed))
        });
        (at_least(split.location_f(total), location_f), scatter)
    });
    let of_group = |g: usize| observed.to_centroid.iter().zip(labels).filter(move |(_, label)| **label == g).map(|(z, _)| z);
    let scatters = (0..sizes.len()).map(|g| of_group(g).sum::<f64>() / sizes[g] as f64);
    Ok(Omnibus {
        scatters: scatters.collect(),
        location_f,
        location_share: 1.0 - observed.within / total,
        location_p: tried.p(|o| o.0),
        location_p_adjusted: 1.0,
        scatter_f: scatter_f.unwrap_or(0.0),
        scatter_p: if scatter_f.is_some() { tried.p(|o| o.1) } else { 1.0 },
        scatter_p_adjusted: 1.0,
        permutations: tried.outcomes.len(),
        exhaustive: tried.exhaustive,
        people: sizes,
    })
}

fn sizes(labels: &[usize]) -> Vec<usize> {
    let mut sizes = vec![0; labels.iter().max().map_or(0, |most| most + 1)];
    labels.iter().for_each(|&label| sizes[label] += 1);
    sizes
}

/// Returns the sum of squares over all people: the sum of their squared distances divided by their number.
fn total(distances: &[Vec<f64>]) -> f64 {
    let pairs = distances.iter().enumerate().flat_map(|(i, row)| &row[i + 1..]);
    pairs.fold(0.0, |sum, d| sum + d * d) / distances.len() as f64
}

/// Results for one split of people into groups.
struct Split {
    groups: usize,
    /// Sum of squares within the groups.
    within: f64,
    /// Distance of every person to the centroid of their group.
    to_centroid: Vec<f64>,
}

impl Split {
    fn new(distances: &[Vec<f64>], labels: &[usize], sizes: &[usize]) -> Self {
        let mut members: Vec<Vec<usize>> = sizes.iter().map(|&n| Vec::with_capacity(n)).collect();
        labels.iter().enumerate().for_each(|(i, &g)| members[g].push(i));
        let (mut within, mut to_centroid) = (0.0, vec![0.0; labels.len()]);
        for members in &members {
            let n = members.len() as f64;
            let mut pairs = 0.0;
            for (k, &i) in members.iter().enumerate() {
                for &j in &members[k + 1..] {
                    let square = distances[i][j] * distances[i][j];
                    pairs += square;
                    to_centroid[i] += square;
                    to_centroid[j] += square;
                }
            }
            within += pairs / n;
            // Distances that no Euclidean space has can make this negative; it is then 0.
            members.iter().for_each(|&i| to_centroid[i] = (to_centroid[i] / n - pairs / (n * n)).max(0.0).sqrt());
        }
        Self { groups: sizes.len(), within, to_centroid }
    }

    /// Returns the pseudo-F, given the sum of squares over all people.
    fn location_f(&self, total: f64) -> f64 {
        let freedom = self.to_centroid.len() - self.groups;
        ((total - self.within) / (self.groups - 1) as f64) / (self.within / freedom as f64)
    }
}

/// Returns the F of a one-way analysis of variance, or `None` if no group has scatter.
fn analysis_of_variance(values: &[f64], labels: &[usize], sizes: &[usize]) -> Option<f64> {
    let all = values.iter().sum::<f64>() / values.len() as f64;
    let mut means = vec![0.0; sizes.len()];
    values.iter().zip(labels).for_each(|(v, &g)| means[g] += v / sizes[g] as f64);
    let between: f64 = means.iter().zip(sizes).map(|(m, &n)| n as f64 * (m - all).powi(2)).sum();
    let within: f64 = values.iter().zip(labels).map(|(v, &g)| (v - means[g]).powi(2)).sum();
    let total = between + within;
    (within > ROUNDING * total).then(|| (between / (sizes.len() - 1) as f64) / (within / (values.len() - sizes.len()) as f64))
}

/// Corrects the p values of all comparisons for their number, location and scatter together.
pub fn adjust_omnibus(comparisons: &mut [OmnibusComparison]) {
    let mut tests: Vec<&mut Omnibus> = comparisons.iter_mut().filter_map(|c| c.outcome.as_mut().ok()).collect();
    let p: Vec<f64> = tests.iter().flat_map(|t| [t.location_p, t.scatter_p]).collect();
    for (test, adjusted) in tests.iter_mut().zip(holm(&p).chunks_exact(2)) {
        (test.location_p_adjusted, test.scatter_p_adjusted) = (adjusted[0], adjusted[1]);
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::{super::permutation::generator, *};

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

    fn everybody(labels: &[usize]) -> Exchange {
        Exchange::new(labels.to_vec(), &[], None).unwrap()
    }

    #[test]
    fn location_and_scatter_agree_with_scikit_bio_and_numpy() {
        let labels: Vec<usize> = (0..15).map(|i| i / 5).collect();
        let options = CompareOptions { permutations: 9999, ..CompareOptions::default() };
        let found = test(&distances(), &everybody(&labels), &options, 0).unwrap();
        approx::assert_relative_eq!(found.location_f, SCIKIT_BIO[0], max_relative = 1e-6);
        approx::assert_relative_eq!(found.scatter_f, SCIKIT_BIO[1], max_relative = 1e-6);
        // 9,999 permutations each: within four standard errors of both.
        for (p, expected) in [(found.location_p, SCIKIT_BIO[2]), (found.scatter_p, SCIKIT_BIO[3])] {
            assert!((p - expected).abs() < 4.0 * (2.0 * expected / 9999.0).sqrt() + 2e-4, "{p} {expected}");
        }
        assert_eq!(found, test(&distances(), &everybody(&labels), &options, 0).unwrap());
    }

    #[test]
    fn centroids_follow_the_labels_and_all_labels_are_tried_where_they_are_few() {
        // Five against five: 252 arrangements; scripts/check_statistics.py computes all of them from coordinates.
        let labels: Vec<usize> = (0..10).map(|i| i / 5).collect();
        let ten: Vec<Vec<f64>> = distances()[..10].iter().map(|row| row[..10].to_vec()).collect();
        let options = CompareOptions::default();
        let found = test(&ten, &everybody(&labels), &options, 0).unwrap();
        assert!(found.exhaustive && found.permutations == 252);
        approx::assert_relative_eq!(found.location_p, NUMPY_EXACT[0], max_relative = 1e-6);
        approx::assert_relative_eq!(found.scatter_p, NUMPY_EXACT[1], max_relative = 1e-6);
        // 3 of 5 and 2 of 5 within two strata: 100 arrangements.
        let blocks = [vec![0, 1, 2, 5, 6], vec![3, 4, 7, 8, 9]];
        let strata = Exchange { labels, blocks: blocks.into() };
        let within = test(&ten, &strata, &options, 0).unwrap();
        assert!(within.exhaustive && within.permutations == 100);
        assert!(!test(&ten, &strata, &CompareOptions { permutations: 99, ..options }, 0).unwrap().exhaustive);
    }

    #[test]
    fn the_test_of_the_scatter_rejects_no_more_often_than_it_says() {
        // 3 and 12 people from one distribution with heavy tails. A test on fixed distances to centroids rejects 12 % at a level of 5 %.
        let labels: Vec<usize> = (0..15).map(|i| usize::from(i >= 3)).collect();
        let options = CompareOptions { permutations: 99, ..CompareOptions::default() };
        let mut random = generator(7, 0, 0, 0);
        let mut draw = || (0..8).map(|_| (random.random::<f64>() - 0.5) / (random.random::<f64>() + 0.1)).collect::<Vec<f64>>();
        let rejected = (0..400).filter(|_| {
            let points: Vec<Vec<f64>> = (0..15).map(|_| draw()).collect();
            let d = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt();
            let distances: Vec<Vec<f64>> = points.iter().map(|a| points.iter().map(|b| d(a, b)).collect()).collect();
            test(&distances, &everybody(&labels), &options, 0).unwrap().scatter_p <= 0.05
        });
        // 20 are expected, with a standard deviation of 4.4.
        let rejected = rejected.count();
        assert!((7..=33).contains(&rejected), "{rejected}");
    }

    #[test]
    fn identical_people_are_an_error_with_the_reason() {
        let same = vec![vec![0.0; 4]; 4];
        let why = test(&same, &everybody(&[0, 0, 1, 1]), &CompareOptions::default(), 0).unwrap_err();
        assert!(why.starts_with("all people of a group move in the same way"));
    }

    // From scripts/check_statistics.py: exact p of location and scatter; F of location and scatter and their p.
    const NUMPY_EXACT: [f64; 2] = [0.00793650794, 0.0952380952];
    const SCIKIT_BIO: [f64; 4] = [7.6077193, 10.0998815, 3e-5, 0.0088];
}
