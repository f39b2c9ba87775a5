//! Tests whether two groups of people make an expression differently: a permutation test on the energy distance.
//!
//! **Statistic.** With KP's distance d [KP, eq. (5)], the energy distance of two groups A and B (Székely & Rizzo 2004) is
//!
//! ```text
//! E = 2 mean d(a, b) - mean d(a, a') - mean d(b, b'),    a, a' in A, b, b' in B, a != a', b != b'
//! ```
//!
//! in face units. It measures how much farther apart people of different groups are than people of the same group. It needs no mean,
//! variance or normal distribution, only d. The distance between the two representatives would detect shifts only. A difference of means
//! would not match the rest of the method: KP's median, trimming and dispersion are based on d.
//!
//! The distance d is the mean over nodes k of a distance `d_k`. E is therefore the mean over nodes of the nodes' own energy distances
//! `E_k`, which show *where* the groups differ. E detects differences in the distribution of single displacement vectors, but no
//! difference that is only in the dependence between nodes.
//!
//! **Null distribution.** People, not sequences, are exchangeable: the labels of people are permuted, each with all their sequences. The
//! distance of two people is the mean over their sequences. If there are no more splits (within strata, if any) than the requested
//! permutations, all splits are tried. Otherwise that many are drawn, and p = (1 + number at least as large) / (1 + number drawn), which
//! never rejects too often.
//!
//! **Designs.** With [`Strata`] people exchange labels within their stratum only. People who are in both groups cannot be tested here: E
//! hardly detects a change that is small compared with the differences between people. Their amplitudes are compared in pairs
//! ([`super::amplitude`]).
//!
//! **Decision.** Two groups differ if E as a whole is significant, or the most conspicuous node. [`Tested::p_either`] is the p value of
//! either, corrected for the two ways.
//!
//! **Multiple tests.** Over all pairs compared in one analysis: Holm's step-down procedure (`holm`). Over the nodes of one pair: the
//! distribution of the largest standardized `E_k` (Westfall & Young's single step), so that the probability of naming any node wrongly is
//! that stated for the pair as a whole.
//!
//! **Effect size.** H = E / (2 mean d(a, b)), from 0 for equal groups to 1 for separate groups. It is reported with the H that
//! permutations reach by chance.

mod arrangements;
mod exchange;
mod groups;
mod holm;
mod omnibus;
mod pairs;
mod permutation;
mod strata;

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::{
    SequenceModel,
    comparable::{NotComparable, comparable_fields},
    distance::DisplacementFields,
};
use crate::units::NodeId;

pub(crate) use arrangements::Arrangements;
pub(super) use exchange::Exchange;
pub use groups::{Comparisons, GroupOptions, MAX_COMPARED_GROUPS, group_values};
pub(crate) use groups::{compare_groups, is_known, stream_of};
pub use holm::holm;
pub use omnibus::{Omnibus, OmnibusComparison, adjust_omnibus, omnibus};
use pairs::PairDistances;
pub(super) use pairs::distance_matrix;
pub(super) use permutation::draw;
use permutation::{Design, Permuted, permute};
pub use strata::{Strata, StrataError};

/// Options of the comparison of groups.
///
/// ```
/// use grimace::statistics::CompareOptions;
///
/// let options = CompareOptions { permutations: 999, ..CompareOptions::default() };
/// assert_eq!((options.people, options.significance), (200, 0.05));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CompareOptions {
    /// Number of permutations per test.
    pub permutations: usize,
    /// Largest number of people per group in a test. From larger groups this many are drawn.
    pub people: usize,
    /// Accepted probability of a false rejection, over all tests.
    pub significance: f64,
    /// Seed of permutations and draws.
    pub seed: u64,
}

impl Default for CompareOptions {
    fn default() -> Self {
        Self { permutations: 9999, people: 200, significance: 0.05, seed: 1 }
    }
}

impl CompareOptions {
    /// Checks that the options make a test.
    fn check(&self) -> Result<(), NotTested> {
        let Self { permutations, people, significance, .. } = *self;
        if !(significance > 0.0 && significance < 1.0) {
            return Err(NotTested::Significance { significance });
        }
        if permutations == 0 || people < LEAST_PEOPLE {
            return Err(NotTested::Options { permutations, people });
        }
        Ok(())
    }
}

/// Smallest number of people per group of a test.
pub const LEAST_PEOPLE: usize = 2;

/// Why two groups were not compared.
///
/// ```
/// # use grimace::{model, normalize, units, wireframe};
/// # let face = wireframe::Face::candide3();
/// # let neutral = normalize::Canonical::new(&face.wireframe, &face.tables)?.neutral;
/// # let smile = |subject: &str, up: f64| {
/// #     let frame = |m: usize| {
/// #         let mut nodes = neutral.nodes().to_vec();
/// #         [31, 64].map(|corner| nodes[corner].y += up * m as f64);
/// #         model::FrameExpressionModel::new(nodes)
/// #     };
/// #     let id = units::SequenceId { subject: subject.to_owned(), sequence: "smile".to_owned() };
/// #     let model = model::DynamicExpressionModel::new((0..5).map(frame).collect()).expect("five frames");
/// #     grimace::statistics::SequenceModel { id, model }
/// # };
/// use grimace::statistics::{NotTested, compare};
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let (a, b) = (smile("P1", 10.0), smile("P2", 20.0));
/// let outcome = compare(&[&a], &[&b], face.wireframe.live_nodes(), &Default::default(), None, 0);
/// assert_eq!(outcome.unwrap_err(), NotTested::TooFewPeople { people: 1 });
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
pub enum NotTested {
    /// A group of one person, whose scatter is unknown.
    #[error("a group of {people} is too small for a test")]
    TooFewPeople {
        /// Number of people in the smaller group.
        people: usize,
    },
    /// People who are in both groups, so that labels cannot be exchanged.
    #[error("{}{} in both groups; a test needs different people", .subjects.join(", "), if *.count > .subjects.len() { format!(" and {} more are", .count - .subjects.len()) } else if *.count == 1 { " is".to_owned() } else { " are".to_owned() })]
    SharedPeople {
        /// Some of the shared people.
        subjects: Vec<String>,
        /// Number of shared people.
        count: usize,
    },
    /// People cannot be permuted within strata.
    #[error(transparent)]
    Strata(#[from] StrataError),
    /// Models that cannot be compared: no live nodes, a node that a model lacks, differing shapes, or an impossible motion.
    #[error(transparent)]
    Models(#[from] NotComparable),
    /// A level of significance that is no probability.
    #[error("the significance is {significance}; it must be above 0 and below 1 (0.05 is usual)")]
    Significance {
        /// The given level.
        significance: f64,
    },
    /// Too few permutations or people for any test.
    #[error(
        "{permutations} permutations of at most {people} people per group are no test; use at least 1 permutation and {LEAST_PEOPLE} people"
    )]
    Options {
        /// Number of permutations.
        permutations: usize,
        /// Largest number of people per group.
        people: usize,
    },
}

/// Largest number of shared people that are named.
const NAMED_PEOPLE: usize = 3;

/// Result of a test.
///
/// ```
/// # use grimace::{model, normalize, units, wireframe};
/// # let face = wireframe::Face::candide3();
/// # let neutral = normalize::Canonical::new(&face.wireframe, &face.tables)?.neutral;
/// # let smile = |subject: &str, up: f64| {
/// #     let frame = |m: usize| {
/// #         let mut nodes = neutral.nodes().to_vec();
/// #         [31, 64].map(|corner| nodes[corner].y += up * m as f64);
/// #         model::FrameExpressionModel::new(nodes)
/// #     };
/// #     let id = units::SequenceId { subject: subject.to_owned(), sequence: "smile".to_owned() };
/// #     let model = model::DynamicExpressionModel::new((0..5).map(frame).collect()).expect("five frames");
/// #     grimace::statistics::SequenceModel { id, model }
/// # };
/// use grimace::statistics::{Tested, compare};
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let people: Vec<_> = (0..8).map(|k| smile(&format!("P{k}"), 10.0 + f64::from(k))).collect();
/// let (odd, even): (Vec<_>, Vec<_>) = people.iter().enumerate().partition(|(k, _)| k % 2 == 1);
/// let [odd, even] = [odd, even].map(|half| half.into_iter().map(|(_, model)| model).collect::<Vec<_>>());
/// let tested: Tested = compare(&odd, &even, face.wireframe.live_nodes(), &Default::default(), None, 0)?;
/// // 8 people make 70 splits, all of which are tried; such halves are nothing special among them.
/// assert!(tested.exhaustive && tested.permutations == 70 && tested.p > 0.05);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tested {
    /// Number of people used from A and from B.
    pub people_used: [usize; 2],
    /// E, face units. It is below 0 if the groups are more alike than by chance.
    pub energy: f64,
    /// Effect size H.
    pub effect: f64,
    /// 95th percentile of H by chance.
    pub effect_by_chance: f64,
    /// Probability of an E at least as large if the groups do not differ.
    pub p: f64,
    /// [`Tested::p`] with Holm's correction over all pairs of the analysis; 1 until [`adjust`] is called.
    pub p_adjusted: f64,
    /// Smallest p possible for groups of this size.
    pub least_p: f64,
    /// [`Tested::least_p`] with Holm's correction over all pairs of the analysis, each at its own smallest p; 1 until [`adjust`] is
    /// called. If it is above the significance level, no data could show a difference for this pair.
    pub least_p_adjusted: f64,
    /// Number of splits tried.
    pub permutations: usize,
    /// Whether these are all possible splits.
    pub exhaustive: bool,
    /// `E_k` of every live node, face units.
    pub node_energy: Vec<f64>,
    /// p value of every live node, corrected for the number of nodes.
    pub node_p: Vec<f64>,
    /// Probability that E is as large, or one node as conspicuous, if the groups do not differ: twice the smaller of [`Tested::p`] and
    /// the smallest [`Tested::node_p`], at most 1.
    pub p_either: f64,
    /// [`Tested::p_either`] with Holm's correction over all pairs of the analysis; 1 until [`adjust`] is called.
    pub p_either_adjusted: f64,
}

/// Returns whether what a test shows is of the whole face: its p, corrected, is significant, or it is no larger than that of the clearest
/// node, as it is. Otherwise it rests on single nodes. The first argument is the p of the whole face, before and after correction.
pub fn is_of_whole([p, p_adjusted]: [f64; 2], least_node_p: f64, significance: f64) -> bool {
    p_adjusted <= significance || p <= least_node_p
}

impl Tested {
    /// Returns the smallest possible [`Tested::p_either_adjusted`]: twice [`Tested::least_p_adjusted`], at most 1.
    pub fn least_either_adjusted(&self) -> f64 {
        (2.0 * self.least_p_adjusted).min(1.0)
    }

    /// Returns the smallest p of a node.
    pub fn least_node_p(&self) -> f64 {
        self.node_p.iter().copied().fold(1.0, f64::min)
    }

    /// Returns whether a difference is one of the whole face (`is_of_whole`).
    pub fn is_of_whole(&self, significance: f64) -> bool {
        is_of_whole([self.p, self.p_adjusted], self.least_node_p(), significance)
    }

    /// Returns the node with the smallest p; of equal ones the one with the largest energy distance.
    pub fn clearest_node(&self, live: &[NodeId]) -> Option<NodeId> {
        let nodes = live.iter().zip(self.node_p.iter().zip(&self.node_energy));
        let clearer = |a: (f64, f64), b: (f64, f64)| a.0 < b.0 || (a.0 == b.0 && a.1 > b.1);
        nodes
            .map(|(&node, (&p, &energy))| (node, (p, energy)))
            .reduce(|a, b| if clearer(b.1, a.1) { b } else { a })
            .map(|(node, _)| node)
    }
}

/// Comparison of two groups of one emotion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// Emotion.
    pub emotion: String,
    /// The groups, as column and value.
    pub groups: [BTreeMap<String, String>; 2],
    /// Number of people in each group.
    pub people: [usize; 2],
    /// Number of sequences in each group.
    pub sequences: [usize; 2],
    /// The test, or the reason why there is none.
    pub outcome: Result<Tested, NotTested>,
}

/// Models of one group, by subject.
pub(super) type People<'a> = BTreeMap<&'a str, Vec<&'a SequenceModel>>;

pub(super) fn by_subject<'a>(models: &[&'a SequenceModel]) -> People<'a> {
    let mut people = People::new();
    for &model in models {
        people.entry(model.id.subject.as_str()).or_default().push(model);
    }
    people.values_mut().for_each(|models| models.sort_by(|a, b| a.id.cmp(&b.id)));
    people
}

/// Returns the displacement fields of the sequences of people.
///
/// # Errors
/// [`NotComparable`] for the models of all people together.
fn fields_of_people(people: &[Vec<&SequenceModel>], live: &[NodeId]) -> Result<Vec<Vec<DisplacementFields>>, NotComparable> {
    let mut fields = comparable_fields(&people.concat(), live, None)?.into_iter();
    Ok(people.iter().map(|models| fields.by_ref().take(models.len()).collect()).collect())
}

/// Compares two groups of models of one emotion.
///
/// The models are normalized and of one shape (as [`super::representative`] checks), in any order. Distances are over the `live` nodes.
/// `stream` is the number of the comparison, so that each has its own random numbers.
///
/// ```
/// # use grimace::{model, normalize, units, wireframe};
/// # let face = wireframe::Face::candide3();
/// # let neutral = normalize::Canonical::new(&face.wireframe, &face.tables)?.neutral;
/// # let smile = |subject: &str, up: f64| {
/// #     let frame = |m: usize| {
/// #         let mut nodes = neutral.nodes().to_vec();
/// #         [31, 64].map(|corner| nodes[corner].y += up * m as f64);
/// #         model::FrameExpressionModel::new(nodes)
/// #     };
/// #     let id = units::SequenceId { subject: subject.to_owned(), sequence: "smile".to_owned() };
/// #     let model = model::DynamicExpressionModel::new((0..5).map(frame).collect()).expect("five frames");
/// #     grimace::statistics::SequenceModel { id, model }
/// # };
/// use grimace::statistics::compare;
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let weak: Vec<_> = (0..6).map(|k| smile(&format!("A{k}"), 10.0 + f64::from(k))).collect();
/// let strong: Vec<_> = (0..6).map(|k| smile(&format!("B{k}"), 40.0 + f64::from(k))).collect();
/// let (a, b): (Vec<_>, Vec<_>) = (weak.iter().collect(), strong.iter().collect());
/// let tested = compare(&a, &b, face.wireframe.live_nodes(), &Default::default(), None, 0)?;
/// // Of the 924 ways to part twelve people in halves, no other but the mirrored one parts them so well.
/// assert!(tested.exhaustive && tested.p < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`NotTested`] for a group of one person, people in both groups, strata that allow no test, options out of range, no live nodes
/// or ones that a model lacks, models of differing shapes, and displacements of 20 eye distances or more.
pub fn compare<'a>(
    a: &[&'a SequenceModel],
    b: &[&'a SequenceModel],
    live: &[NodeId],
    options: &CompareOptions,
    strata: Option<&Strata>,
    stream: u32,
) -> Result<Tested, NotTested> {
    options.check()?;
    let (a, b) = (by_subject(a), by_subject(b));
    let shared: BTreeSet<&str> = a.keys().filter(|subject| b.contains_key(*subject)).copied().collect();
    if !shared.is_empty() {
        let subjects = shared.iter().take(NAMED_PEOPLE).map(|&s| s.to_owned()).collect();
        return Err(NotTested::SharedPeople { subjects, count: shared.len() });
    }
    let people = a.len().min(b.len());
    if people < LEAST_PEOPLE {
        return Err(NotTested::TooFewPeople { people });
    }
    let chosen = [permutation::draw(a.len(), options, stream, 0), permutation::draw(b.len(), options, stream, 1)];
    let of = |people: &People<'a>, chosen: &[usize]| -> Vec<Vec<&'a SequenceModel>> {
        let all: Vec<&Vec<&SequenceModel>> = people.values().collect();
        chosen.iter().map(|&i| all[i].clone()).collect()
    };
    let people = fields_of_people(&[of(&a, &chosen[0]), of(&b, &chosen[1])].concat(), live)?;
    let design = match strata {
        None => Design::Free,
        Some(strata) => {
            let names = |people: &People<'_>, chosen: &[usize]| {
                let all: Vec<String> = people.keys().map(|s| (*s).to_owned()).collect();
                chosen.iter().map(|&i| all[i].clone()).collect::<Vec<_>>()
            };
            let subjects = [names(&a, &chosen[0]), names(&b, &chosen[1])].concat();
            Design::Strata(strata.blocks(&subjects.iter().map(String::as_str).collect::<Vec<_>>(), chosen[0].len())?)
        }
    };
    Ok(test_design(&people, chosen[0].len(), options, &design, stream))
}

/// Tests people given by the displacement fields of their sequences. The first `first` people are group A.
///
/// # Panics
/// If a group has fewer than 2 people or a person has no sequence (a programmer's error).
pub fn test(people: &[Vec<DisplacementFields>], first: usize, options: &CompareOptions, stream: u32) -> Tested {
    test_design(people, first, options, &Design::Free, stream)
}

/// As [`test`], with labels exchanged according to `design`.
fn test_design(
    people: &[Vec<DisplacementFields>],
    first: usize,
    options: &CompareOptions,
    design: &Design,
    stream: u32,
) -> Tested {
    let sizes = [first, people.len() - first];
    assert!(sizes.iter().all(|&n| n >= LEAST_PEOPLE) && people.iter().all(|p| !p.is_empty()), "groups of two or more");
    let distances = PairDistances::new(people);
    let observed: Vec<usize> = (0..first).collect();
    let energy = distances.energy(&observed);
    let total = mean(&energy.nodes);
    let Permuted { at_least, effects, least_p, node_p, permutations, exhaustive } =
        permute(&distances, first, &energy, options, design, stream);
    let p = if exhaustive { at_least as f64 / permutations as f64 } else { (1 + at_least) as f64 / (1 + permutations) as f64 };
    let least_node_p = node_p.iter().copied().fold(1.0, f64::min);
    Tested {
        p_either: (2.0 * p.min(least_node_p)).min(1.0),
        p_either_adjusted: 1.0,
        people_used: sizes,
        energy: total,
        effect: energy.effect(),
        effect_by_chance: upper_quantile(effects),
        p,
        p_adjusted: 1.0,
        least_p,
        least_p_adjusted: 1.0,
        permutations,
        exhaustive,
        node_energy: energy.nodes,
        node_p,
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Returns the 95th percentile.
fn upper_quantile(mut values: Vec<f64>) -> f64 {
    const SHARE: f64 = 0.95;
    values.sort_by(f64::total_cmp);
    let at = ((values.len() as f64 * SHARE).ceil() as usize).clamp(1, values.len().max(1)) - 1;
    values.get(at).copied().unwrap_or(0.0)
}

/// Corrects the p values of all tests for their number.
pub fn adjust(comparisons: &mut [Comparison]) {
    let tested = comparisons.iter_mut().filter_map(|c| c.outcome.as_mut().ok());
    let mut tested: Vec<&mut Tested> = tested.collect();
    let adjusted = holm(&tested.iter().map(|t| t.p).collect::<Vec<_>>());
    let either = holm(&tested.iter().map(|t| t.p_either).collect::<Vec<_>>());
    tested.iter_mut().zip(either).for_each(|(t, p)| t.p_either_adjusted = p);
    let least = holm(&tested.iter().map(|t| t.least_p).collect::<Vec<_>>());
    tested.iter_mut().zip(adjusted).for_each(|(t, p)| t.p_adjusted = p);
    tested.iter_mut().zip(least).for_each(|(t, p)| t.least_p_adjusted = p);
}

#[cfg(test)]
mod tests;
