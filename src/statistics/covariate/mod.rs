//! Tests whether an expression changes with a number known for each person, such as their age.
//!
//! **The whole face.** The pseudo-F of a regression on distances (`McArdle` & Anderson 2001; Legendre & Anderson 1999) with KP's distance
//! d [KP, eq. (5)], the counterpart of [`super::compare::omnibus`] for groups. G are the squared distances -d²/2, centred by rows and
//! columns, and z are the people's numbers, centred and of length 1:
//!
//! ```text
//! explained = z' G z,    share = explained / tr G,    F = explained (n - 2) / (tr G - explained)
//! ```
//!
//! **Single nodes.** For every node, the share of the variance between people, over all frames, that straight lines over the number
//! explain. The p values compare it with the largest share of any node (Westfall & Young's single step), as for groups.
//!
//! **Amplitudes.** The least-squares line of the people's amplitudes over the number, with Student's confidence interval of its slope.
//!
//! **Null distribution.** People exchange their numbers, each with all their sequences, within [`Strata`] if there are any. If there are
//! no more arrangements than the requested permutations, all are tried. Otherwise that many are drawn, and p = (1 + number at least as
//! large) / (1 + number drawn). Strata affect only p: shares, slopes and intervals are those of all people together. With many people the
//! test uses a random draw ([`CompareOptions::people`]); lines are fitted to all people.
//!
//! A person with several numbers (sessions at two ages) counts with the mean of those of the tested emotion's sequences. Only linear relations are detected: an effect that is
//! largest in the middle is not. A number can also stand for another one that it is correlated with.

mod slope;

use std::{borrow::Cow, collections::BTreeMap};

use nalgebra::{DVector, Vector2};
use rayon::prelude::*;

use super::{
    SequenceModel, Strata,
    compare::{CompareOptions, Exchange, StrataError, by_subject, distance_matrix, draw, holm, is_of_whole},
    distance::DisplacementFields,
    variation::{Band, moved, offsets_of},
};
use crate::{
    model::{DynamicExpressionModel, ModelError},
    output::nine_digits,
    units::{FaceUnit, NodeId},
    wireframe::Wireframe,
};

pub use slope::{AmplitudeSlope, adjust_slopes, amplitude_slope};

/// Smallest number of people. With four, the smallest p of the whole or a node is 2 / 24.
pub const LEAST_PEOPLE: usize = 5;

/// Relative difference of two numbers that counts as rounding error.
const ROUNDING: f64 = 1e-10;

/// Purposes of the random numbers: draws of people, and permutations.
const DRAW: u64 = 128;
const PERMUTATIONS: u64 = 129;

/// The number of each person, by subject.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Numbers {
    of: BTreeMap<String, f64>,
}

impl Numbers {
    /// Makes numbers from the values of a column. There is one row per sequence: subject and value, or `None` for a value that is not a
    /// number.
    ///
    /// A person's values are averaged over the rows. People without any number are left out.
    pub fn new<'a>(rows: impl IntoIterator<Item = (&'a str, Option<f64>)>) -> Self {
        let mut values: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        for (subject, value) in rows {
            values.entry(subject).or_default().extend(value.filter(|v| v.is_finite()));
        }
        let mean = |mut v: Vec<f64>| {
            v.sort_by(f64::total_cmp);
            match (v.first(), v.last()) {
                // Their mean may be rounded.
                (Some(&least), Some(most)) if least == *most => least,
                _ => v.iter().sum::<f64>() / v.len() as f64,
            }
        };
        let known = values.into_iter().filter(|(_, v)| !v.is_empty()).map(|(subject, v)| (subject.to_owned(), mean(v)));
        let of = known.filter(|(_, number)| number.is_finite()).collect();
        Self { of }
    }

    /// Returns these numbers, and those of `others` for people who have none here.
    #[must_use]
    pub fn or(mut self, others: &Self) -> Self {
        for (subject, &number) in &others.of {
            self.of.entry(subject.clone()).or_insert(number);
        }
        self
    }

    /// Returns the number of a person.
    pub fn get(&self, subject: &str) -> Option<f64> {
        self.of.get(subject).copied()
    }
}

/// Relation between an expression and a number.
#[derive(Clone, Debug, PartialEq)]
pub struct Covariate {
    /// Number of people with a number.
    pub people: usize,
    /// Number of people used by the test.
    pub used: usize,
    /// Mean of all their numbers.
    pub mean: f64,
    /// Standard deviation of their numbers.
    pub deviation: f64,
    /// Share of the squared distances between people that the number explains. It can be below 0 or above 1 only if the distances are not
    /// Euclidean.
    pub share: f64,
    /// Pseudo-F; `None` if the number explains everything.
    pub f: Option<f64>,
    /// Mean of [`Covariate::share`] over all exchanges of the numbers: 1 / (n - 1) for n people. With strata, over the permutations.
    pub share_by_chance: f64,
    /// Probability of an F at least as large if the number has no effect.
    pub p: f64,
    /// [`Covariate::p`] with Holm's correction over all tests of the analysis; 1 until [`adjust_covariates`] is called.
    pub p_adjusted: f64,
    /// Share of the variance between people that the number explains, by live node, 0 to 1.
    pub node_share: Vec<f64>,
    /// Probability of such a share at any node, by live node.
    pub node_p: Vec<f64>,
    /// p value for the whole or any node: twice the smaller of [`Covariate::p`] and the smallest [`Covariate::node_p`], at most 1.
    pub p_either: f64,
    /// [`Covariate::p_either`] with Holm's correction over all tests of the analysis; 1 until [`adjust_covariates`] is called.
    pub p_either_adjusted: f64,
    /// Smallest possible p.
    pub least_p: f64,
    /// Smallest possible [`Covariate::p_either_adjusted`]. If it is above the significance level, no data could show a relation.
    pub least_either_adjusted: f64,
    /// Number of permutations.
    pub permutations: usize,
    /// Whether these are all possible permutations.
    pub exhaustive: bool,
    /// Numbers for which [`Covariate::models`] are computed: the 5th and 95th percentiles, or the minimum and the maximum if these are
    /// equal.
    pub shown: [f64; 2],
    /// The expression at these numbers, on the least-squares line of every node and frame.
    pub models: [DynamicExpressionModel<FaceUnit>; 2],
}

/// Why a number was not tested.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoCovariate {
    /// Too few people.
    #[error("only {people} of the people {} a number; at least {LEAST_PEOPLE} are needed", if *people == 1 { "has" } else { "have" })]
    TooFewPeople {
        /// Number of people with a number.
        people: usize,
    },
    /// All people have the same number.
    #[error("all {people} people have the same number, {}", nine_digits(*.number))]
    Same {
        /// Number of people with a number.
        people: usize,
        /// The number.
        number: f64,
    },
    /// All people of the random draw have the same number.
    #[error("all {used} people drawn from {people} have the same number; draw more with --test-people")]
    SameDrawn {
        /// Number of people drawn.
        used: usize,
        /// Number of people with a number.
        people: usize,
    },
    /// All people move in the same way.
    #[error("all people move in the same way; a test needs people who differ")]
    Alike,
    /// People cannot be permuted within strata.
    #[error(transparent)]
    Strata(StrataError),
    /// All people of a stratum have the same number.
    #[error("within the strata of `{columns}` all people have the same number: its effect cannot be separated from the strata")]
    Coincide {
        /// The columns.
        columns: String,
    },
    /// Positions that are not finite.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl From<StrataError> for NoCovariate {
    fn from(error: StrataError) -> Self {
        match error {
            StrataError::Coincide { columns } => Self::Coincide { columns },
            other => Self::Strata(other),
        }
    }
}

impl Covariate {
    /// Returns the smallest p of a node.
    pub fn least_node_p(&self) -> f64 {
        self.node_p.iter().copied().fold(1.0, f64::min)
    }

    /// Returns whether a change is one of the whole face ([`is_of_whole`]).
    pub fn is_of_whole(&self, significance: f64) -> bool {
        is_of_whole([self.p, self.p_adjusted], self.least_node_p(), significance)
    }
}

/// Tests whether an expression changes with a number.
///
/// The models are of one emotion and one shape (as [`super::representative`] checks), in any order. `stream` gives this test its own
/// random numbers.
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
    let known: Vec<f64> = all.iter().map(|person| person.0).collect();
    let Centred { mean, deviation, .. } = Centred::new(&known)?;
    let places = draw(all.len(), options, stream, DRAW);
    let numbers: Vec<f64> = places.iter().map(|&i| all[i].0).collect();
    let same = |_| NoCovariate::SameDrawn { used: places.len(), people: all.len() };
    let z = Centred::new(&numbers).map_err(same)?.z;
    let subjects: Vec<&str> = places.iter().map(|&i| all[i].1).collect();
    let (exchange, by_label) = exchange(&numbers, &z, &subjects, strata)?;

    let fields = |&i: &usize| all[i].2.iter().map(|m| DisplacementFields::of_model(&m.model, live)).collect::<Vec<_>>();
    let centred = gower(&distance_matrix(&places.par_iter().map(fields).collect::<Vec<_>>()));
    let total: f64 = (0..centred.len()).map(|i| centred[i][i]).sum();
    if !(total > 0.0) {
        return Err(NoCovariate::Alike);
    }
    let courses: Vec<DVector<f64>> = places.par_iter().map(|&i| course_of(&all[i].2, live)).collect();
    let nodes = NodeCourses::new(courses.iter(), live.len());
    let explained = quadratic(&centred, &z);
    let node_share = nodes.shares(&z);
    let tried = exchange.permute(options, (stream, PERMUTATIONS), |labels| {
        let z: Vec<f64> = labels.iter().map(|&label| by_label[label]).collect();
        (quadratic(&centred, &z), nodes.shares(&z).into_iter().fold(0.0, f64::max))
    });
    let share_by_chance = if strata.is_some() {
        tried.outcomes.iter().map(|(explained, _)| explained / total).sum::<f64>() / tried.outcomes.len() as f64
    } else {
        1.0 / (places.len() - 1) as f64
    };
    let slack = ROUNDING * total;
    let node_p: Vec<f64> = node_share.iter().map(|&share| tried.p(|(_, largest)| *largest >= share - ROUNDING)).collect();
    let p = tried.p(|(other, _)| *other >= explained - slack);
    let least_node = node_p.iter().copied().fold(1.0, f64::min);

    let shown = shown(&known);
    let everybody = all.iter().enumerate().map(|(i, person)| {
        // Courses of drawn people are already computed.
        let drawn = places.binary_search(&i).ok().map(|k| Cow::Borrowed(&courses[k]));
        (person.0 - mean, drawn.unwrap_or_else(|| Cow::Owned(course_of(&person.2, live))))
    });
    let (middle, slope) = line(everybody, deviation);
    let at = |number: f64| -> Result<_, ModelError> {
        let course = &middle + &slope * (number - mean);
        let frames = course.as_slice().chunks_exact(2 * live.len());
        let offsets: Vec<Vec<Vector2<f64>>> =
            frames.map(|frame| frame.chunks_exact(2).map(|v| Vector2::new(v[0], v[1])).collect()).collect();
        moved(all[0].2[0].model.neutral(), &offsets, wireframe)
    };
    let left = total - explained;
    Ok(Covariate {
        people: all.len(),
        used: places.len(),
        mean,
        deviation,
        share: explained / total,
        f: (left > slack).then(|| explained * (places.len() - 2) as f64 / left),
        share_by_chance,
        p,
        p_adjusted: 1.0,
        p_either: (2.0 * p.min(least_node)).min(1.0),
        p_either_adjusted: 1.0,
        least_p: tried.least_p(),
        least_either_adjusted: 1.0,
        node_share,
        node_p,
        permutations: tried.outcomes.len(),
        exhaustive: tried.exhaustive,
        models: [at(shown[0])?, at(shown[1])?],
        shown,
    })
}

/// Returns the mean course of a person's sequences: neutral offsets by frame, by node, x and y.
fn course_of(models: &[&SequenceModel], live: &[NodeId]) -> DVector<f64> {
    let courses = models.iter().map(|m| offsets_of(m, live));
    courses.fold(DVector::zeros(0), |mean, course| {
        let share = 1.0 / models.len() as f64;
        if mean.is_empty() { course * share } else { mean + course * share }
    })
}

/// Fits least-squares lines to the people's courses over their numbers minus the mean. Returns the mean course and the change per unit.
fn line<'a>(people: impl Iterator<Item = (f64, Cow<'a, DVector<f64>>)>, deviation: f64) -> (DVector<f64>, DVector<f64>) {
    let (mut count, mut middle, mut slope) = (0.0, DVector::zeros(0), DVector::zeros(0));
    for (offset, course) in people {
        if middle.is_empty() {
            (middle, slope) = (DVector::zeros(course.len()), DVector::zeros(course.len()));
        }
        count += 1.0;
        middle += &*course;
        slope.axpy(offset / deviation, &course, 1.0);
    }
    let steps: f64 = count - 1.0;
    (middle / count, slope / (steps * deviation))
}

/// Returns the 5th and 95th percentiles of the numbers, or the minimum and the maximum if these are equal.
fn shown(numbers: &[f64]) -> [f64; 2] {
    let weighted: Vec<(f64, f64)> = numbers.iter().map(|&v| (v, 1.0)).collect();
    let ends = Band::of(&weighted).map_or([0.0; 2], |band| [band.quantiles[0], band.quantiles[4]]);
    let all = || numbers.iter().copied();
    if ends[0] < ends[1] { ends } else { [all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max)] }
}

/// Returns the exchange of numbers between people, and the centred number of every label.
fn exchange(numbers: &[f64], z: &[f64], subjects: &[&str], strata: Option<&Strata>) -> Result<(Exchange, Vec<f64>), StrataError> {
    let mut different = numbers.to_vec();
    different.sort_by(f64::total_cmp);
    different.dedup();
    let labels: Vec<usize> = numbers.iter().map(|v| different.partition_point(|other| other < v)).collect();
    let mut by_label = vec![0.0; different.len()];
    labels.iter().zip(z).for_each(|(&label, &z)| by_label[label] = z);
    Ok((Exchange::new(labels, subjects, strata)?, by_label))
}

/// Numbers centred and scaled to length 1, with their mean and standard deviation.
struct Centred {
    z: Vec<f64>,
    mean: f64,
    deviation: f64,
}

impl Centred {
    fn new(numbers: &[f64]) -> Result<Self, NoCovariate> {
        let people = numbers.len();
        if people < LEAST_PEOPLE {
            return Err(NoCovariate::TooFewPeople { people });
        }
        // Divided by the largest magnitude, so that no square overflows.
        let largest = numbers.iter().map(|v| v.abs()).fold(0.0, f64::max);
        let scaled = || numbers.iter().map(|&v| if largest > 0.0 { v / largest } else { 0.0 });
        let mean = scaled().sum::<f64>() / people as f64;
        let length = scaled().map(|v| (v - mean).powi(2)).sum::<f64>().sqrt();
        if !(length > ROUNDING) {
            return Err(NoCovariate::Same { people, number: mean * largest });
        }
        let z = scaled().map(|v| (v - mean) / length).collect();
        Ok(Self { z, mean: mean * largest, deviation: length * largest / ((people - 1) as f64).sqrt() })
    }
}

/// Returns minus half the squared distances, centred by rows and columns.
fn gower(distances: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let n = distances.len() as f64;
    let of_row: Vec<f64> = distances.iter().map(|row| row.iter().map(|d| -0.5 * d * d).sum::<f64>() / n).collect();
    let all = of_row.iter().sum::<f64>() / n;
    let row =
        |(i, row): (usize, &Vec<f64>)| row.iter().enumerate().map(|(j, d)| -0.5 * d * d - of_row[i] - of_row[j] + all).collect();
    distances.iter().enumerate().map(row).collect()
}

/// Returns z' G z for a symmetric matrix G.
fn quadratic(matrix: &[Vec<f64>], z: &[f64]) -> f64 {
    matrix.iter().zip(z).map(|(row, zi)| zi * row.iter().zip(z).map(|(g, zj)| g * zj).sum::<f64>()).sum()
}

/// The courses of all people, centred over people.
struct NodeCourses {
    /// Course by person: by frame, by node, x and y.
    courses: Vec<DVector<f64>>,
    /// Sum of squares of every node over people and frames.
    squares: Vec<f64>,
}

impl NodeCourses {
    fn new<'a>(courses: impl Iterator<Item = &'a DVector<f64>> + Clone, nodes: usize) -> Self {
        let count = courses.clone().count() as f64;
        let sum =
            courses.clone().fold(DVector::zeros(0), |sum, course| if sum.is_empty() { course.clone() } else { sum + course });
        let courses: Vec<DVector<f64>> = courses.map(|course| course - &sum / count).collect();
        let mut squares = vec![0.0; nodes];
        courses.iter().for_each(|course| add_squares(course, &mut squares));
        Self { courses, squares }
    }

    /// Returns, by node, the share of the sum of squares that z explains.
    fn shares(&self, z: &[f64]) -> Vec<f64> {
        let mut along = DVector::zeros(self.courses.first().map_or(0, DVector::len));
        self.courses.iter().zip(z).for_each(|(course, z)| along.axpy(*z, course, 1.0));
        let mut explained = vec![0.0; self.squares.len()];
        add_squares(&along, &mut explained);
        // Nodes that move equally in all people get 0.
        let least = self.squares.iter().copied().fold(0.0, f64::max) * 1e-12;
        explained.iter().zip(&self.squares).map(|(e, all)| if *all > least { e / all } else { 0.0 }).collect()
    }
}

/// Adds the squares of a course to the sums of its nodes.
fn add_squares(course: &DVector<f64>, nodes: &mut [f64]) {
    for (k, pair) in course.as_slice().chunks_exact(2).enumerate() {
        nodes[k % nodes.len()] += pair[0] * pair[0] + pair[1] * pair[1];
    }
}

/// Corrects the p values for the number of tests.
pub fn adjust_covariates(tests: &mut [&mut Covariate]) {
    let adjusted = holm(&tests.iter().map(|t| t.p_either).collect::<Vec<_>>());
    let least = holm(&tests.iter().map(|t| (2.0 * t.least_p).min(1.0)).collect::<Vec<_>>());
    let whole = holm(&tests.iter().map(|t| t.p).collect::<Vec<_>>());
    for ((test, whole), (p, least)) in tests.iter_mut().zip(whole).zip(adjusted.into_iter().zip(least)) {
        (test.p_adjusted, test.p_either_adjusted, test.least_either_adjusted) = (whole, p, least);
    }
}

/// Returns the node with the largest explained share, and its p value.
pub fn clearest_node(test: &Covariate, live: &[NodeId]) -> Option<(NodeId, f64)> {
    let nodes = live.iter().zip(test.node_share.iter().zip(&test.node_p));
    nodes.reduce(|most, node| if node.1.0 > most.1.0 { node } else { most }).map(|(&node, (_, &p))| (node, p))
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;
    use crate::{model::FrameExpressionModel, units::SequenceId};

    /// A person whose nodes all move by (x, 0).
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
    fn numbers_of_an_emotion_come_before_those_of_others() {
        let ratings = Numbers::new([("a", Some(3.0)), ("a", Some(6.0)), ("a", Some(3.0)), ("b", None)]);
        let all = Numbers::new([("a", Some(90.0)), ("b", Some(7.0)), ("c", Some(8.0))]);
        let both = ratings.or(&all);
        assert_eq!(["a", "b", "c", "d"].map(|who| both.get(who)), [Some(4.0), Some(7.0), Some(8.0), None]);
    }

    #[test]
    fn on_a_line_it_is_simple_regression() {
        // Products 200, squares 10 and 5000: r² = 0.8, F = 0.8 · 3 / 0.2. Of 120 orders, this and its reverse have an r² as large.
        let found = of(&FIVE, None).unwrap();
        assert_relative_eq!(found.share, 0.8, max_relative = 1e-9);
        assert_relative_eq!(found.f.unwrap(), 12.0, max_relative = 1e-9);
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
        // e has two sequences, at 100 on average, and two numbers, 5 on average; f has no number.
        let mut people = FIVE.to_vec();
        people[4] = ("e", 4.0, 90.0);
        people.extend([("e", 6.0, 110.0), ("f", f64::NAN, 500.0)]);
        let (found, five) = (of(&people, None).unwrap(), of(&FIVE, None).unwrap());
        assert_eq!((found.people, found.shown), (5, [1.0, 5.0]));
        assert!(found.node_share.iter().zip(&five.node_share).all(|(a, b)| (a - b).abs() < 1e-9));
        // d of two people is the mean over their sequences. For e it equals that of the mean, since all others are lower.
        assert_relative_eq!(found.f.unwrap(), five.f.unwrap(), max_relative = 1e-9);
    }

    #[test]
    fn numbers_are_exchanged_within_strata_only() {
        let sites =
            |of: [&str; 5]| Strata::new(&["site".to_owned()], FIVE.iter().zip(of).map(|(p, site)| (p.0, vec![site.to_owned()])));
        // Two pairs and one single person: four arrangements, none with a larger share than the observed one.
        let found = of(&FIVE, Some(&sites(["x", "x", "y", "y", "z"]))).unwrap();
        assert_eq!((found.permutations, found.p), (4, 0.25));
        // Products 200, 190, 190 and 180, squares 10 and 5000: shares 0.8, 0.722, 0.722 and 0.648.
        assert_relative_eq!(found.share_by_chance, (0.8 + 0.722 + 0.722 + 0.648) / 4.0, max_relative = 1e-9);
        assert_eq!(of(&FIVE, None).unwrap().share_by_chance, 0.25);
        let why = of(&FIVE, Some(&sites(["a", "b", "c", "d", "e"]))).unwrap_err();
        assert_eq!(
            why.to_string(),
            "within the strata of `site` all people have the same number: its effect cannot be separated from the strata"
        );
    }

    #[test]
    fn impossible_tests_give_the_reason() {
        let why = |people: &[(&str, f64, f64)]| of(people, None).unwrap_err().to_string();
        assert_eq!(why(&FIVE[..4]), "only 4 of the people have a number; at least 5 are needed");
        assert_eq!(why(&FIVE.map(|(who, _, x)| (who, 30.0, x))), "all 5 people have the same number, 30");
        assert_eq!(
            why(&FIVE.map(|(who, number, _)| (who, number, 7.0))),
            "all people move in the same way; a test needs people who differ"
        );
    }

    #[test]
    fn rare_and_huge_numbers_and_random_draws_of_people() {
        // All but one of 24 people have 0, so both quantiles are 0; minimum and maximum are shown instead.
        let names: Vec<String> = (0..24).map(|k| format!("p{k:02}")).collect();
        let rare: Vec<(&str, f64, f64)> =
            names.iter().enumerate().map(|(k, who)| (who.as_str(), f64::from(u8::from(k == 3)), k as f64 * k as f64)).collect();
        assert_eq!(of(&rare, None).unwrap().shown, [0.0, 1.0]);
        let huge = of(&FIVE.map(|(who, number, x)| (who, number * 1e300, x)), None).unwrap();
        assert_relative_eq!(huge.f.unwrap(), 12.0, max_relative = 1e-9);
        // Lines also use the people that a draw of five leaves out.
        let models: Vec<SequenceModel> = rare.iter().map(|&(who, _, x)| moving((who, x))).collect();
        let numbers = Numbers::new(rare.iter().enumerate().map(|(k, &(who, ..))| (who, Some(k as f64))));
        let options = CompareOptions { permutations: 99, people: 5, ..CompareOptions::default() };
        let models: Vec<&SequenceModel> = models.iter().collect();
        let drawn = covariate(&models, &numbers, &Wireframe::candide3(), &options, None, 0).unwrap();
        assert_eq!((drawn.people, drawn.used, drawn.mean, drawn.least_p), (24, 5, 11.5, 0.01));
        // All people lie on a line: no residual is left.
        let line = of(&FIVE.map(|(who, number, _)| (who, number, 10.0 * number)), None).unwrap();
        assert!(line.f.is_none() && (line.share - 1.0).abs() < 1e-9);
        let mut tests = [line];
        adjust_covariates(&mut tests.iter_mut().collect::<Vec<_>>());
        assert_relative_eq!(tests[0].least_either_adjusted, 2.0 / 120.0, max_relative = 1e-9);
    }

    #[test]
    fn squares_of_distances_are_parted_as_those_of_coordinates() {
        // Five people in the plane: the squared distances explained by z are the squared length of the sum of z times the positions.
        let places = [(0.0, 1.0), (2.0, -1.0), (3.0, 4.0), (-1.0, 2.0), (0.5, 0.0)].map(|(x, y)| Vector2::<f64>::new(x, y));
        let distances: Vec<Vec<f64>> = places.iter().map(|a| places.iter().map(|b| (a - b).norm()).collect()).collect();
        let z = Centred::new(&[1.0, 2.0, 4.0, 9.0, 3.0]).unwrap().z;
        let along: Vector2<f64> = places.iter().zip(&z).map(|(p, z)| p * *z).sum();
        assert_relative_eq!(quadratic(&gower(&distances), &z), along.norm_squared(), max_relative = 1e-9);
    }
}
