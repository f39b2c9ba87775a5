//! Whether an expression changes with a number that is known of the people, such as their age.
//!
//! **The whole.** The pseudo-F of a regression on distances (`McArdle` & Anderson 2001; Legendre & Anderson 1999) over KP's own distance d
//! [KP, eq. (5)], as [`super::compare::omnibus`] has it for groups: with G the squared distances -d²/2, centred by rows and columns, and z
//! the people's numbers, centred and of length 1,
//!
//! ```text
//! explained = z' G z,    share = explained / tr G,    F = explained (n - 2) / (tr G - explained)
//! ```
//!
//! **Where.** At every node the share of the people's variance, over all frames, that straight lines over the number explain. The chance of
//! the largest of them over all nodes corrects for their number (Westfall & Young's single step), as between groups.
//!
//! **Amplitudes.** The least-squares line of the people's amplitudes over the number, with Student's interval of its slope.
//!
//! **Null distribution.** People exchange their numbers, each with all their sequences, within [`Strata`] where there are any; all ways are
//! tried where there are no more than the permutations asked for, else so many are drawn, and p = (1 + those at least as large) / (1 + drawn).
//!
//! Somebody of whom several numbers are known (sessions at two ages) counts with their mean. What is found is a straight line: what is largest
//! in the middle is not seen, and a number that goes along with another one may stand for it.

use std::collections::BTreeMap;

use nalgebra::{DVector, Vector2};
use rand::RngExt;
use rayon::prelude::*;

use super::{
    SequenceModel, Strata,
    amplitude::{PersonValue, t_above, t_quantile},
    compare::{Arrangements, CompareOptions, by_subject, distance_matrix, draw, generator, holm},
    distance::DisplacementFields,
    variation::{Band, moved, offsets_of},
};
use crate::{
    model::{DynamicExpressionModel, ModelError},
    units::{FaceUnit, NodeId},
    wireframe::Wireframe,
};

/// Fewest people: a line through three has one degree of freedom left, of which nothing can be said.
pub const LEAST_PEOPLE: usize = 4;

/// Relative difference of two numbers that is rounding.
const ROUNDING: f64 = 1e-10;

/// Purposes of the random numbers: draws of people, permutations of the whole and of amplitudes.
const DRAW: u64 = 128;
const PERMUTATIONS: u64 = 129;
const AMPLITUDES: u64 = 130;

/// Numbers of people by subject.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Numbers {
    of: BTreeMap<String, f64>,
}

impl Numbers {
    /// Numbers by the values of a column: a row per sequence of subject and value. A person's values are averaged, each different one once;
    /// people with a value that is no number have none.
    pub fn new<'a>(rows: impl IntoIterator<Item = (&'a str, Option<f64>)>) -> Self {
        let mut values: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        for (subject, value) in rows {
            let known = values.entry(subject).or_default();
            known.extend(value.filter(|v| v.is_finite() && !known.contains(v)));
        }
        let mean = |mut v: Vec<f64>| {
            v.sort_by(f64::total_cmp);
            v.iter().sum::<f64>() / v.len() as f64
        };
        let of = values.into_iter().filter(|(_, v)| !v.is_empty()).map(|(subject, v)| (subject.to_owned(), mean(v))).collect();
        Self { of }
    }

    /// The number of a person.
    pub fn get(&self, subject: &str) -> Option<f64> {
        self.of.get(subject).copied()
    }
}

/// How an expression goes with a number.
#[derive(Clone, Debug, PartialEq)]
pub struct Covariate {
    /// People of the test.
    pub people: usize,
    /// Mean and standard deviation of their numbers.
    pub mean: f64,
    /// Standard deviation of their numbers.
    pub deviation: f64,
    /// Share of the squared distances between people that goes with the number; below 0 only where distances are those of no space.
    pub share: f64,
    /// Pseudo-F.
    pub f: f64,
    /// Chance of an F at least as large if the number meant nothing.
    pub p: f64,
    /// By live node the share of the people's variance there that goes with the number, 0 to 1.
    pub node_share: Vec<f64>,
    /// By live node the chance of such a share at any node.
    pub node_p: Vec<f64>,
    /// Twice the smaller of [`Covariate::p`] and the least of [`Covariate::node_p`], at most 1: that the whole or one node goes with the number.
    pub p_either: f64,
    /// [`Covariate::p_either`] after Holm over all that is tested in the analysis; 1 until [`adjust_covariates`] was called.
    pub p_either_adjusted: f64,
    /// Permutations.
    pub permutations: usize,
    /// Whether these are all there are.
    pub exhaustive: bool,
    /// Numbers under which 5 and 95 % of the people lie, for which [`Covariate::models`] are.
    pub shown: [f64; 2],
    /// The expression at these numbers: on the line of least squares at every node and frame.
    pub models: [DynamicExpressionModel<FaceUnit>; 2],
}

/// Why a number was not tested.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoCovariate {
    /// Too few people.
    #[error("{people} of the people {} a number; {LEAST_PEOPLE} or more are needed", if *people == 1 { "has" } else { "have" })]
    TooFewPeople {
        /// People with a number.
        people: usize,
    },
    /// Everybody has the same number.
    #[error("all {people} people have the same number, {number}")]
    Same {
        /// People with a number.
        people: usize,
        /// The number.
        number: f64,
    },
    /// Everybody moves alike.
    #[error("all people move alike; a test needs people who differ")]
    Alike,
    /// People cannot be permuted within strata.
    #[error(transparent)]
    Strata(#[from] super::StrataError),
    /// Nobody's numbers differ within a stratum.
    #[error("within the strata of `{columns}` all people have the same number: nothing can be told apart from the strata")]
    Coincide {
        /// The columns.
        columns: String,
    },
    /// Positions that are not finite.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Tests whether an expression goes with a number.
///
/// Models are of one emotion and one shape (as [`super::representative`] checks), in any order. `stream` tells the random numbers of this test
/// from those of others.
///
/// # Errors
/// [`NoCovariate`].
pub fn covariate(
    models: &[&SequenceModel],
    numbers: &Numbers,
    wireframe: &Wireframe,
    options: &CompareOptions,
    strata: Option<&Strata>,
    stream: u32,
) -> Result<Covariate, NoCovariate> {
    let live = wireframe.live_nodes();
    let all: Vec<(f64, &str, Vec<&SequenceModel>)> =
        by_subject(models).into_iter().filter_map(|(subject, models)| Some((numbers.get(subject)?, subject, models))).collect();
    check(all.iter().map(|person| person.0))?;
    let drawn: Vec<_> = draw(all.len(), options, stream, DRAW).into_iter().map(|i| &all[i]).collect();
    let values: Vec<f64> = drawn.iter().map(|person| person.0).collect();
    let (z, mean, deviation) = check(values.iter().copied())?;
    let subjects: Vec<&str> = drawn.iter().map(|person| person.1).collect();
    let exchange = Exchange::new(&values, &subjects, strata)?;

    let of_person = |models: &Vec<&SequenceModel>| {
        let fields: Vec<_> = models.iter().map(|m| DisplacementFields::of_model(&m.model, live)).collect();
        let mut course = DVector::zeros(offsets_of(models[0], live).len());
        models.iter().for_each(|m| course.axpy(1.0 / models.len() as f64, &offsets_of(m, live), 1.0));
        (fields, course)
    };
    let (fields, courses): (Vec<_>, Vec<_>) = drawn.par_iter().map(|person| of_person(&person.2)).unzip();
    let centred = gower(&distance_matrix(&fields));
    let total: f64 = (0..centred.len()).map(|i| centred[i][i]).sum();
    let nodes = NodeCourses::new(&courses, live.len());
    if !(total > 0.0) {
        return Err(NoCovariate::Alike);
    }
    let explained = quadratic(&centred, &z);
    let node_share = nodes.shares(&z);
    let largest = |shares: &[f64]| shares.iter().copied().fold(0.0, f64::max);
    let tried = exchange.permute(&z, options, (stream, PERMUTATIONS), |z| (quadratic(&centred, z), largest(&nodes.shares(z))));
    let slack = ROUNDING * total;
    let node_p = node_share.iter().map(|&share| tried.p(|(_, largest)| *largest >= share - ROUNDING)).collect::<Vec<f64>>();
    let p = tried.p(|(other, _)| *other >= explained - slack);
    let least_node = node_p.iter().copied().fold(1.0, f64::min);

    // Lines through what people do, each person once.
    let mut middle = DVector::zeros(courses[0].len());
    courses.iter().for_each(|course| middle.axpy(1.0 / courses.len() as f64, course, 1.0));
    let mut slope = DVector::zeros(courses[0].len());
    let spread = deviation * ((values.len() - 1) as f64).sqrt();
    courses.iter().zip(&z).for_each(|(course, z)| slope.axpy(z / spread, course, 1.0));
    let shown = shown(&values);
    let neutral = drawn[0].2[0].model.neutral();
    let at = |value: f64| -> Result<_, ModelError> {
        let course = &middle + &slope * (value - mean);
        let frames = course.as_slice().chunks_exact(2 * live.len());
        let offsets: Vec<Vec<Vector2<f64>>> =
            frames.map(|frame| frame.chunks_exact(2).map(|v| Vector2::new(v[0], v[1])).collect()).collect();
        moved(neutral, &offsets, wireframe)
    };
    Ok(Covariate {
        people: values.len(),
        mean,
        deviation,
        share: explained / total,
        f: explained * (values.len() - 2) as f64 / (total - explained),
        p,
        p_either: (2.0 * p.min(least_node)).min(1.0),
        p_either_adjusted: 1.0,
        node_share,
        node_p,
        permutations: tried.outcomes.len(),
        exhaustive: tried.exhaustive,
        models: [at(shown[0])?, at(shown[1])?],
        shown,
    })
}

/// Numbers under which 5 and 95 % of the people lie.
fn shown(values: &[f64]) -> [f64; 2] {
    let weighted: Vec<(f64, f64)> = values.iter().map(|&v| (v, 1.0)).collect();
    Band::of(&weighted).map_or([0.0; 2], |band| [band.quantiles[0], band.quantiles[4]])
}

/// Numbers centred and of length 1, their mean and their standard deviation.
fn check(values: impl Iterator<Item = f64> + Clone) -> Result<(Vec<f64>, f64, f64), NoCovariate> {
    let people = values.clone().count();
    if people < LEAST_PEOPLE {
        return Err(NoCovariate::TooFewPeople { people });
    }
    let mean = values.clone().sum::<f64>() / people as f64;
    let length = values.clone().map(|v| (v - mean).powi(2)).sum::<f64>().sqrt();
    let largest = values.clone().map(f64::abs).fold(0.0, f64::max);
    if !(length > ROUNDING * largest) || !length.is_finite() {
        return Err(NoCovariate::Same { people, number: mean });
    }
    Ok((values.map(|v| (v - mean) / length).collect(), mean, length / ((people - 1) as f64).sqrt()))
}

/// Minus half the squared distances, centred by rows and columns.
fn gower(distances: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let n = distances.len() as f64;
    let of_row: Vec<f64> = distances.iter().map(|row| row.iter().map(|d| -0.5 * d * d).sum::<f64>() / n).collect();
    let all = of_row.iter().sum::<f64>() / n;
    let row =
        |(i, row): (usize, &Vec<f64>)| row.iter().enumerate().map(|(j, d)| -0.5 * d * d - of_row[i] - of_row[j] + all).collect();
    distances.iter().enumerate().map(row).collect()
}

/// z' G z of a symmetric matrix.
fn quadratic(matrix: &[Vec<f64>], z: &[f64]) -> f64 {
    matrix.iter().zip(z).map(|(row, zi)| zi * row.iter().zip(z).map(|(g, zj)| g * zj).sum::<f64>()).sum()
}

/// Everybody's courses, centred over people.
struct NodeCourses {
    /// By person: by frame, by node, x and y.
    courses: Vec<DVector<f64>>,
    /// Sum of squares of every node over people and frames.
    squares: Vec<f64>,
}

impl NodeCourses {
    fn new(courses: &[DVector<f64>], nodes: usize) -> Self {
        let mut mean = DVector::zeros(courses[0].len());
        courses.iter().for_each(|course| mean.axpy(1.0 / courses.len() as f64, course, 1.0));
        let courses: Vec<DVector<f64>> = courses.iter().map(|course| course - &mean).collect();
        let mut squares = vec![0.0; nodes];
        courses.iter().for_each(|course| add_squares(course, &mut squares));
        Self { courses, squares }
    }

    /// By node the share of the sum of squares that goes with z.
    fn shares(&self, z: &[f64]) -> Vec<f64> {
        let mut along = DVector::zeros(self.courses[0].len());
        self.courses.iter().zip(z).for_each(|(course, z)| along.axpy(*z, course, 1.0));
        let mut explained = vec![0.0; self.squares.len()];
        add_squares(&along, &mut explained);
        // Where nobody moves differently, nothing is explained.
        let least = self.squares.iter().copied().fold(0.0, f64::max) * 1e-12;
        explained.iter().zip(&self.squares).map(|(e, all)| if *all > least { e / all } else { 0.0 }).collect()
    }
}

/// Adds the squares of a course to those of its nodes.
fn add_squares(course: &DVector<f64>, nodes: &mut [f64]) {
    for (k, pair) in course.as_slice().chunks_exact(2).enumerate() {
        nodes[k % nodes.len()] += pair[0] * pair[0] + pair[1] * pair[1];
    }
}

/// Who may exchange numbers with whom.
struct Exchange {
    blocks: Vec<Vec<usize>>,
    /// By person the place of their number among the different ones.
    labels: Vec<usize>,
}

impl Exchange {
    fn new(values: &[f64], subjects: &[&str], strata: Option<&Strata>) -> Result<Self, NoCovariate> {
        let mut different = values.to_vec();
        different.sort_by(f64::total_cmp);
        different.dedup();
        let labels: Vec<usize> = values.iter().map(|v| different.partition_point(|other| other < v)).collect();
        let Some(strata) = strata else { return Ok(Self { blocks: vec![(0..values.len()).collect()], labels }) };
        let mut blocks: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        let of = strata.of(subjects)?;
        of.into_iter().enumerate().for_each(|(place, stratum)| blocks.entry(stratum).or_default().push(place));
        let blocks: Vec<Vec<usize>> = blocks.into_values().collect();
        if blocks.iter().all(|places| places.iter().all(|&p| labels[p] == labels[places[0]])) {
            return Err(NoCovariate::Coincide { columns: strata.columns().to_owned() });
        }
        Ok(Self { blocks, labels })
    }

    /// What `of` says of every permutation of z.
    fn permute<T: Send>(
        &self,
        z: &[f64],
        options: &CompareOptions,
        (stream, purpose): (u32, u64),
        of: impl Fn(&[f64]) -> T + Sync,
    ) -> Tried<T> {
        let wanted = options.permutations.max(1);
        if let Some(all) = Arrangements::new(&self.labels, self.blocks.iter().map(Vec::as_slice), wanted) {
            let mut by_label = vec![0.0; self.labels.iter().max().map_or(0, |most| most + 1)];
            self.labels.iter().zip(z).for_each(|(&label, &z)| by_label[label] = z);
            let arranged = |k: usize| all.nth(k).into_iter().map(|label| by_label[label]).collect::<Vec<f64>>();
            let outcomes = (0..all.count()).into_par_iter().map(|k| of(&arranged(k))).collect();
            return Tried { outcomes, exhaustive: true };
        }
        let drawn = |unit: usize| {
            let mut random = generator(options.seed, stream, purpose, unit as u64);
            let mut shuffled = z.to_vec();
            for places in &self.blocks {
                for k in (1..places.len()).rev() {
                    shuffled.swap(places[k], places[random.random_range(0..=k)]);
                }
            }
            of(&shuffled)
        };
        Tried { outcomes: (0..wanted).into_par_iter().map(drawn).collect(), exhaustive: false }
    }
}

/// What permutations gave.
struct Tried<T> {
    outcomes: Vec<T>,
    exhaustive: bool,
}

impl<T> Tried<T> {
    /// The chance of what is at least as large; among all ways is the observed one, to those drawn it is added.
    fn p(&self, is_as_large: impl Fn(&T) -> bool) -> f64 {
        let extra = usize::from(!self.exhaustive);
        let count = self.outcomes.iter().filter(|outcome| is_as_large(outcome)).count();
        (extra + count) as f64 / (extra + self.outcomes.len()) as f64
    }
}

/// How amplitudes go with a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AmplitudeSlope {
    /// People.
    pub people: usize,
    /// Change of the amplitude, in times the median, by 1 of the number.
    pub slope: f64,
    /// Student's 95 % interval of the slope.
    pub interval: [f64; 2],
    /// Pearson's correlation.
    pub correlation: f64,
    /// Chance of a correlation at least as far from 0, by permutation.
    pub p: f64,
    /// The same by Student's t.
    pub p_t: f64,
    /// [`AmplitudeSlope::p`] after Holm over all slopes of the analysis; 1 until [`adjust_slopes`] was called.
    pub p_adjusted: f64,
}

/// The line of people's amplitudes over their numbers.
///
/// # Errors
/// [`NoCovariate`].
pub fn amplitude_slope(
    people: &[PersonValue],
    numbers: &Numbers,
    options: &CompareOptions,
    strata: Option<&Strata>,
    stream: u32,
) -> Result<AmplitudeSlope, NoCovariate> {
    let known: Vec<(&str, f64, f64)> =
        people.iter().filter_map(|p| Some((p.subject.as_str(), numbers.get(&p.subject)?, p.value))).collect();
    let values: Vec<f64> = known.iter().map(|k| k.1).collect();
    let (z, _, deviation) = check(values.iter().copied())?;
    let subjects: Vec<&str> = known.iter().map(|k| k.0).collect();
    let exchange = Exchange::new(&values, &subjects, strata)?;
    let n = known.len() as f64;
    let mean = known.iter().map(|k| k.2).sum::<f64>() / n;
    let length = known.iter().map(|k| (k.2 - mean).powi(2)).sum::<f64>().sqrt();
    if !(length > ROUNDING * known.iter().map(|k| k.2.abs()).fold(0.0, f64::max)) {
        return Err(NoCovariate::Alike);
    }
    let y: Vec<f64> = known.iter().map(|k| (k.2 - mean) / length).collect();
    let correlation = |z: &[f64]| z.iter().zip(&y).map(|(a, b)| a * b).sum::<f64>();
    let r = correlation(&z).clamp(-1.0, 1.0);
    let tried = exchange.permute(&z, options, (stream, AMPLITUDES), |z| correlation(z).abs());
    // In units of the amplitude by those of the number.
    let scale = length / (deviation * (n - 1.0).sqrt());
    let freedom = n - 2.0;
    let error = ((1.0 - r * r).max(0.0) / freedom).sqrt();
    let half = t_quantile(0.975, freedom).unwrap_or(f64::INFINITY) * error * scale;
    let p_t = if error > 0.0 { t_above((r / error).abs(), freedom).map_or(1.0, |p| 2.0 * p) } else { 0.0 };
    Ok(AmplitudeSlope {
        people: known.len(),
        slope: r * scale,
        interval: [r * scale - half, r * scale + half],
        correlation: r,
        p: tried.p(|other| *other >= r.abs() - ROUNDING),
        p_t,
        p_adjusted: 1.0,
    })
}

/// Corrects for the number of all that was tested.
pub fn adjust_covariates(tests: &mut [&mut Covariate]) {
    let adjusted = holm(&tests.iter().map(|t| t.p_either).collect::<Vec<_>>());
    tests.iter_mut().zip(adjusted).for_each(|(test, p)| test.p_either_adjusted = p);
}

/// Corrects for the number of all slopes.
pub fn adjust_slopes(slopes: &mut [&mut AmplitudeSlope]) {
    let adjusted = holm(&slopes.iter().map(|t| t.p).collect::<Vec<_>>());
    slopes.iter_mut().zip(adjusted).for_each(|(slope, p)| slope.p_adjusted = p);
}

/// Node with the least chance, and that, of a test.
pub fn clearest_node(test: &Covariate, live: &[NodeId]) -> Option<(NodeId, f64)> {
    let order = |a: &(NodeId, f64, f64), b: &(NodeId, f64, f64)| b.2.total_cmp(&a.2);
    let mut nodes: Vec<_> = live.iter().zip(test.node_p.iter().zip(&test.node_share)).map(|(&n, (&p, &s))| (n, p, s)).collect();
    nodes.sort_by(order);
    nodes.first().map(|&(node, p, _)| (node, p))
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;
    use crate::{model::FrameExpressionModel, units::SequenceId};

    /// Somebody whose nodes all move by (x, 0).
    fn moving((subject, x): (&str, f64)) -> SequenceModel {
        let neutral = Wireframe::candide3().frontal();
        let frame =
            |share: f64| FrameExpressionModel::new(neutral.iter().map(|p| p + Vector2::new(x * share, 0.0)).collect::<Vec<_>>());
        let id = SequenceId { subject: subject.to_owned(), sequence: format!("{x}") };
        SequenceModel { id, model: DynamicExpressionModel::new(vec![frame(0.0), frame(0.5), frame(1.0)]).unwrap() }
    }

    fn of(people: &[(&str, f64, f64)], strata: Option<&Strata>) -> Result<Covariate, NoCovariate> {
        let models: Vec<SequenceModel> = people.iter().map(|&(who, _, x)| moving((who, x))).collect();
        let numbers = Numbers::new(people.iter().map(|&(who, number, _)| (who, Some(number).filter(|n| n.is_finite()))));
        let options = CompareOptions { permutations: 999, ..CompareOptions::default() };
        covariate(&models.iter().collect::<Vec<_>>(), &numbers, &Wireframe::candide3(), &options, strata, 0)
    }

    const FIVE: [(&str, f64, f64); 5] =
        [("a", 1.0, 10.0), ("b", 2.0, 20.0), ("c", 3.0, 30.0), ("d", 4.0, 40.0), ("e", 5.0, 100.0)];

    #[test]
    fn on_a_line_it_is_simple_regression() {
        // Products 200, squares 10 and 5000: r² = 0.8, F = 0.8 · 3 / 0.2. Of 120 orders this and its reverse have such an r².
        let found = of(&FIVE, None).unwrap();
        assert_relative_eq!(found.share, 0.8, max_relative = 1e-9);
        assert_relative_eq!(found.f, 12.0, max_relative = 1e-9);
        assert!(found.exhaustive && found.permutations == 120);
        assert_relative_eq!(found.p, 2.0 / 120.0, max_relative = 1e-9);
        // At every node the same.
        assert!(found.node_share.iter().all(|share| (share - 0.8).abs() < 1e-9));
        assert!(found.node_p.iter().all(|p| (p - 2.0 / 120.0).abs() < 1e-9));
        assert_relative_eq!(found.p_either, 4.0 / 120.0, max_relative = 1e-9);
        // The line 40 + 20 (number - 3) at its ends.
        assert_eq!(found.shown, [1.0, 5.0]);
        let node = Wireframe::candide3().live_nodes()[0].index();
        let at = |k: usize, m: usize| found.models[k].neutral_offsets(m)[node].x;
        assert!((at(0, 2) - 0.0).abs() < 1e-9 && (at(1, 2) - 80.0).abs() < 1e-9 && (at(1, 1) - 40.0).abs() < 1e-9);
    }

    #[test]
    fn a_person_counts_once_and_one_without_a_number_not_at_all() {
        // e twice, at 100 on the mean, with two numbers that are 5 on the mean; f without a number.
        let mut people = FIVE.to_vec();
        people[4] = ("e", 4.0, 90.0);
        people.extend([("e", 6.0, 110.0), ("f", f64::NAN, 500.0)]);
        let (found, five) = (of(&people, None).unwrap(), of(&FIVE, None).unwrap());
        assert_eq!((found.people, found.shown), (5, [1.0, 5.0]));
        assert!(found.node_share.iter().zip(&five.node_share).all(|(a, b)| (a - b).abs() < 1e-9));
        // d of two people is the mean over their sequences, which for e is that of the mean: everybody else is farther down.
        assert_relative_eq!(found.f, five.f, max_relative = 1e-9);
    }

    #[test]
    fn numbers_are_exchanged_within_strata_only() {
        let sites =
            |of: [&str; 5]| Strata::new(&["site".to_owned()], FIVE.iter().zip(of).map(|(p, site)| (p.0, vec![site.to_owned()])));
        // Two pairs and one alone: four ways, of which none has more than the observed one.
        let found = of(&FIVE, Some(&sites(["x", "x", "y", "y", "z"]))).unwrap();
        assert_eq!((found.permutations, found.p), (4, 0.25));
        let why = of(&FIVE, Some(&sites(["a", "b", "c", "d", "e"]))).unwrap_err();
        assert_eq!(
            why.to_string(),
            "within the strata of `site` all people have the same number: nothing can be told apart from the strata"
        );
    }

    #[test]
    fn what_cannot_be_tested_says_why() {
        let why = |people: &[(&str, f64, f64)]| of(people, None).unwrap_err().to_string();
        assert_eq!(why(&FIVE[..3]), "3 of the people have a number; 4 or more are needed");
        assert_eq!(why(&FIVE.map(|(who, _, x)| (who, 30.0, x))), "all 5 people have the same number, 30");
        assert_eq!(
            why(&FIVE.map(|(who, number, _)| (who, number, 7.0))),
            "all people move alike; a test needs people who differ"
        );
    }

    #[test]
    fn squares_of_distances_are_parted_as_those_of_coordinates() {
        // Four people in the plane: what goes with z of the squared distances is the squared length of the sum of z times their places.
        let places = [(0.0, 1.0), (2.0, -1.0), (3.0, 4.0), (-1.0, 2.0)].map(|(x, y)| Vector2::<f64>::new(x, y));
        let distances: Vec<Vec<f64>> = places.iter().map(|a| places.iter().map(|b| (a - b).norm()).collect()).collect();
        let (z, _, _) = check([1.0, 2.0, 4.0, 9.0].into_iter()).unwrap();
        let along: Vector2<f64> = places.iter().zip(&z).map(|(p, z)| p * *z).sum();
        assert_relative_eq!(quadratic(&gower(&distances), &z), along.norm_squared(), max_relative = 1e-9);
    }

    #[test]
    fn amplitudes_have_the_line_of_least_squares() {
        let people = FIVE.map(|(who, _, value)| PersonValue { subject: who.to_owned(), value });
        let numbers = Numbers::new(FIVE.iter().map(|p| (p.0, Some(p.1))));
        let found = amplitude_slope(&people, &numbers, &CompareOptions::default(), None, 0).unwrap();
        assert_relative_eq!(found.slope, 20.0, max_relative = 1e-9);
        assert_relative_eq!(found.correlation, 0.8f64.sqrt(), max_relative = 1e-9);
        // Student's t of 3 degrees of freedom: 3.182446, times the root of 0.2 / 3 times that of 5000 / 10.
        assert_relative_eq!(found.interval[1] - 20.0, 18.373_863, max_relative = 1e-6);
        assert_relative_eq!(found.p, 2.0 / 120.0, max_relative = 1e-9);
        // t = r / sqrt((1 - r²) / 3) = 3.4641, two-sided.
        assert_relative_eq!(found.p_t, 0.040_519, max_relative = 1e-4);
    }
}
