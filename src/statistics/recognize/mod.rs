//! Recognizes the expression of a sequence, with calibrated probabilities and the answer "none of these".
//!
//! The data of a sequence are its displacement vectors [KP, eq. (2)], all fields and live nodes. Discriminants with a shrunk covariance
//! (`lda`) give the distances to the labels.
//!
//! **Probabilities** are calibrated by two numbers that maximize the likelihood of the labels of left-out people: the temperature t of
//! `exp(-distance / (2 t))`, and the share of lapses, which are sequences that show any label. Without lapses, one outlier among few
//! people would reduce every probability to chance level.
//!
//! **Typicality** of a sequence is the share of left-out sequences that are at least as far from their nearest label. Below a given
//! level, the sequence is none of the labels. With n left-out sequences, the smallest share is 1 / (n + 1). For a sequence farther away
//! than all of them, typicality is the probability that one more is as far, by Student's t on the logarithms of their distances.
//! Sequences of one person are not independent, so its degrees of freedom are counted in people.
//!
//! **Small motion.** A face that does not move lies between all labels, and is no farther from the nearest than people who show it
//! strongly. A sequence that moves less than all known ones is therefore at most as typical as the probability that any of as many people
//! moves so little.

mod lda;

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::{
    EMOTIONS, SequenceModel,
    comparable::{NotComparable, comparable_fields},
    distance::DisplacementFields,
    t_above,
};
use crate::units::NodeId;

use lda::{Discriminants, NoScatter};

/// Largest number of folds of people left out together, for up to [`FEW_SEQUENCES`] sequences and for more.
const MOST_FOLDS: [usize; 2] = [50, 10];

/// Number of sequences up to which a fold is cheap.
const FEW_SEQUENCES: usize = 500;

/// Recognized expression of a sequence.
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
/// # let people: Vec<_> = (1..=4).flat_map(|k| [(k, 1.0), (k, -1.0)]).collect();
/// # let models: Vec<_> = people.iter().map(|(k, sign)| smile(&format!("P{k}"), sign * (20.0 + f64::from(*k)))).collect();
/// # let labels = ["smile", "frown"].iter().cycle();
/// # let labelled: Vec<_> = models.iter().zip(labels).map(|(model, label)| (model, *label)).collect();
/// # let recognizer = grimace::statistics::Recognizer::new(&labelled, face.wireframe.live_nodes(), || ())?;
/// use grimace::statistics::Recognized;
///
/// // `recognizer` knows smiles and frowns of four people.
/// let Recognized { label, probability, probabilities, .. } = recognizer.recognize(&smile("P9", -22.5))?;
/// assert_eq!((label.as_str(), probabilities.len()), ("frown", 2));
/// assert!(probability > 0.5 && (probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Recognized {
    /// The most probable label.
    pub label: String,
    /// Probability of that label.
    pub probability: f64,
    /// Probabilities by label, in the order of [`Recognizer::labels`]; 0 for a label that no other person shows.
    pub probabilities: Vec<f64>,
    /// Squared distance to the most probable label's mean, in within-label standard deviations.
    pub distance: f64,
    /// Share of left-out sequences that are at least as far from their nearest label. Beyond all of them, it is the probability of such a
    /// distance from their scatter. If the sequence moves less than all of them, it is at most the probability that any of as many people
    /// moves as little.
    pub typicality: f64,
}

impl Recognized {
    /// Returns whether the sequence is none of the labels: its typicality is below `level`.
    pub fn is_none(&self, level: f64) -> bool {
        self.typicality < level
    }
}

/// Why nothing can be recognized.
///
/// ```
/// # use grimace::{model, normalize, units, wireframe};
/// let face = grimace::wireframe::Face::candide3();
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
/// use grimace::statistics::{RecognizeError, Recognizer};
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let only = smile("P1", 10.0);
/// let error = Recognizer::new(&[(&only, "smile")], face.wireframe.live_nodes(), || ()).unwrap_err();
/// assert_eq!(error, RecognizeError::TooFewLabels { found: 1 });
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RecognizeError {
    /// Too few labels to distinguish.
    #[error("found {found} label{}; recognition needs sequences of at least two labels", if *found == 1 { "" } else { "s" })]
    TooFewLabels {
        /// Number of labels.
        found: usize,
    },
    /// Too few people for leaving one out.
    #[error("found {found} {}; recognition needs at least three people, because it is tested on held-out people", if *found == 1 { "person" } else { "people" })]
    TooFewPeople {
        /// Number of people.
        found: usize,
    },
    /// A label that only one person shows.
    #[error(
        "only one person shows `{label}`; every label needs at least two people, because recognition is tested on held-out people"
    )]
    OnePerson {
        /// The label.
        label: String,
    },
    /// Models with another number of displacement vectors.
    #[error(
        "{id}: it has {found} displacement vectors, but the others have {expected}; normalize all sequences with the same options"
    )]
    Shape {
        /// The sequence.
        id: String,
        /// Number of its vectors.
        found: usize,
        /// Number of vectors of the others.
        expected: usize,
    },
    /// Models that cannot be compared: no live nodes, a node that a model lacks, or an impossible motion.
    #[error(transparent)]
    Models(NotComparable),
    /// Sequences of the same label do not differ.
    #[error("all sequences of each label are equal, or each label has only one; labels cannot be distinguished from chance")]
    NoScatter,
}

/// Keeps the sequences whose labels at least two people show, and returns the other labels separately. When the only person of such a
/// label is left out, no one shows it. If fewer than two labels would remain, all sequences are kept. `of` returns person and label of a
/// sequence.
pub fn shown_by_several<T>(models: Vec<T>, of: impl Fn(&T) -> (&str, &str)) -> (Vec<T>, Vec<String>) {
    let mut people: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for item in &models {
        let (subject, label) = of(item);
        people.entry(label.to_owned()).or_default().insert(subject.to_owned());
    }
    let alone: Vec<String> = people.iter().filter(|(_, people)| people.len() < 2).map(|(label, _)| label.clone()).collect();
    if people.len() < alone.len() + 2 {
        return (models, Vec::new());
    }
    (models.into_iter().filter(|item| !alone.iter().any(|label| label == of(item).1)).collect(), alone)
}

/// Returns the labels that can be learned from sequences, given as person and label. The order is that of [`EMOTIONS`], then
/// alphabetical.
///
/// # Errors
/// [`RecognizeError`] for fewer than two labels or three people, and for a label that only one person shows.
pub(crate) fn labels_to_learn<'a>(shown: impl Iterator<Item = (&'a str, &'a str)>) -> Result<Vec<String>, RecognizeError> {
    let rank = |label: &str| EMOTIONS.iter().position(|&e| e == label).unwrap_or(EMOTIONS.len());
    let mut labels: BTreeMap<(usize, &str), BTreeSet<&str>> = BTreeMap::new();
    let mut people = BTreeSet::new();
    for (subject, label) in shown {
        labels.entry((rank(label), label)).or_default().insert(subject);
        people.insert(subject);
    }
    if labels.len() < 2 {
        return Err(RecognizeError::TooFewLabels { found: labels.len() });
    }
    if people.len() < 3 {
        return Err(RecognizeError::TooFewPeople { found: people.len() });
    }
    match labels.iter().find(|(_, people)| people.len() < 2) {
        Some(((_, label), _)) => Err(RecognizeError::OnePerson { label: (*label).to_owned() }),
        None => Ok(labels.into_keys().map(|(_, label)| label.to_owned()).collect()),
    }
}

/// A recognizer trained on labelled sequences.
///
/// ```
/// use grimace::{model, normalize, units, wireframe};
/// let face = grimace::wireframe::Face::candide3();
/// let neutral = normalize::Canonical::new(&face.wireframe, &face.tables)?.neutral;
/// let smile = |subject: &str, up: f64| {
///     let frame = |m: usize| {
///         let mut nodes = neutral.nodes().to_vec();
///         [31, 64].map(|corner| nodes[corner].y += up * m as f64);
///         model::FrameExpressionModel::new(nodes)
///     };
///     let id = units::SequenceId { subject: subject.to_owned(), sequence: "smile".to_owned() };
///     let model = model::DynamicExpressionModel::new((0..5).map(frame).collect()).expect("five frames");
///     grimace::statistics::SequenceModel { id, model }
/// };
/// use grimace::statistics::Recognizer;
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let people: Vec<_> = (1..=4).flat_map(|k| [(k, 1.0), (k, -1.0)]).collect();
/// let models: Vec<_> = people.iter().map(|(k, sign)| smile(&format!("P{k}"), sign * (20.0 + f64::from(*k)))).collect();
/// let labelled: Vec<_> = models.iter().zip(["smile", "frown"].iter().cycle()).map(|(model, label)| (model, *label)).collect();
/// let recognizer = Recognizer::new(&labelled, face.wireframe.live_nodes(), || ())?;
/// assert_eq!(recognizer.recognize(&smile("P9", 22.5))?.label, "smile");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Recognizer {
    /// Labels in the order of the project's emotions, then alphabetical.
    pub labels: Vec<String>,
    /// Nodes used.
    live: Vec<NodeId>,
    discriminants: Discriminants,
    size: usize,
    calibration: Calibration,
    usual: Usual,
    /// Recognition results of the training sequences when their people are left out, in the given order.
    pub left_out: Vec<Recognized>,
}

/// Distances of a left-out sequence.
#[derive(Clone)]
struct LeftOut {
    subject: usize,
    label: usize,
    distances: Vec<Option<f64>>,
    /// Length of all its displacement vectors taken as one vector.
    amount: f64,
}

impl LeftOut {
    fn nearest(&self) -> f64 {
        self.distances.iter().flatten().copied().fold(f64::INFINITY, f64::min)
    }
}

#[doc(hidden)]
impl From<NoScatter> for RecognizeError {
    fn from(NoScatter: NoScatter) -> Self {
        Self::NoScatter
    }
}

impl From<NotComparable> for RecognizeError {
    fn from(why: NotComparable) -> Self {
        match why {
            NotComparable::Shape { id, found, expected } => Self::Shape { id: id.to_string(), found, expected },
            why => Self::Models(why),
        }
    }
}

fn vector(fields: &DisplacementFields) -> DVector<f64> {
    let slots = (0..fields.field_count()).flat_map(|m| (0..fields.node_count()).map(move |k| (m, k)));
    DVector::from_vec(slots.flat_map(|(m, k)| [fields.vector(m, k).x, fields.vector(m, k).y]).collect())
}

fn rows(data: &[DVector<f64>], chosen: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(chosen.len(), data[0].len(), |i, j| data[chosen[i]][j])
}

impl Recognizer {
    /// Trains a recognizer on models with one label each. `tick` is called, from many threads, for every fold of people left out.
    ///
    /// # Errors
    /// [`RecognizeError`] for fewer than two labels or three people, a label that only one person shows, sequences without
    /// scatter or of differing shapes, no live nodes or ones that a model lacks, and displacements of 20 eye distances or more.
    pub fn new(models: &[(&SequenceModel, &str)], live: &[NodeId], tick: impl Fn() + Sync) -> Result<Self, RecognizeError> {
        let labels = labels_to_learn(models.iter().map(|(m, label)| (m.id.subject.as_str(), *label)))?;
        let people: BTreeSet<&str> = models.iter().map(|(m, _)| m.id.subject.as_str()).collect();
        let place: BTreeMap<&str, usize> = people.into_iter().enumerate().map(|(k, s)| (s, k)).collect();
        let fields = comparable_fields(&models.iter().map(|(m, _)| *m).collect::<Vec<_>>(), live, None)?;
        let data: Vec<DVector<f64>> = fields.iter().map(vector).collect();
        let size = data.first().map_or(0, DVector::len);
        let label_of: Vec<usize> = models.iter().map(|(_, label)| labels.iter().position(|l| l == label).unwrap_or(0)).collect();
        let subject_of: Vec<usize> = models.iter().map(|(m, _)| place[m.id.subject.as_str()]).collect();
        let folds = place.len().min(MOST_FOLDS[usize::from(data.len() > FEW_SEQUENCES)]);
        let fold_of = folds_of_people(&subject_of, &label_of, labels.len(), folds);
        let fold = |f: usize| -> Result<Vec<(usize, LeftOut)>, RecognizeError> {
            let (own, others): (Vec<usize>, Vec<usize>) = (0..data.len()).partition(|&i| fold_of[subject_of[i]] == f);
            let of_others: Vec<usize> = others.iter().map(|&i| label_of[i]).collect();
            let discriminants = Discriminants::new(&rows(&data, &others), &of_others, labels.len())?;
            tick();
            let left_out = |i: usize| {
                let distances = discriminants.distances(&data[i]);
                (i, LeftOut { subject: subject_of[i], label: label_of[i], distances, amount: data[i].norm() })
            };
            Ok(own.into_iter().map(left_out).collect())
        };
        let mut all = (0..folds).into_par_iter().map(fold).collect::<Result<Vec<_>, _>>()?.concat();
        all.sort_by_key(|(i, _)| *i);
        let all: Vec<LeftOut> = all.into_iter().map(|(_, left_out)| left_out).collect();
        // Calibration and typical distances of a left-out sequence are computed without its own fold.
        let of_fold: Vec<(Calibration, Usual)> = (0..folds)
            .into_par_iter()
            .map(|f| {
                let others: Vec<&LeftOut> = all.iter().filter(|l| fold_of[l.subject] != f).collect();
                (Calibration::new(&others), Usual::new(&others))
            })
            .collect();
        let left_out = all.iter().map(|l| {
            let (calibration, usual) = &of_fold[fold_of[l.subject]];
            recognized(&labels, (&l.distances, l.amount), *calibration, usual)
        });
        let left_out = left_out.collect();
        let everybody: Vec<&LeftOut> = all.iter().collect();
        let chosen: Vec<usize> = (0..data.len()).collect();
        Ok(Self {
            discriminants: Discriminants::new(&rows(&data, &chosen), &label_of, labels.len())?,
            calibration: Calibration::new(&everybody),
            usual: Usual::new(&everybody),
            labels,
            live: live.to_vec(),
            size,
            left_out,
        })
    }

    /// Returns whether there are so few sequences that no counted share is below `level`. Lower typicalities then come only from the
    /// scatter of the distances.
    pub fn is_beyond_counting(&self, level: f64) -> bool {
        level > 0.0 && level * (1 + self.usual.distances.len()) as f64 <= 1.0
    }

    /// Recognizes a sequence of a person outside the training data.
    ///
    /// # Errors
    /// [`RecognizeError::Shape`] for another number of displacement vectors, and [`RecognizeError::Models`] for a model that
    /// lacks a live node or has displacements of 20 eye distances or more.
    pub fn recognize(&self, model: &SequenceModel) -> Result<Recognized, RecognizeError> {
        let fields = comparable_fields(&[model], &self.live, Some(self.size / 2))?;
        let data = fields.first().map_or_else(|| DVector::zeros(self.size), vector);
        let distances = self.discriminants.distances(&data);
        Ok(recognized(&self.labels, (&distances, data.norm()), self.calibration, &self.usual))
    }
}

/// Assigns a fold to every person, in turn. If all people who show a label are in one fold, one of them is moved to the next fold,
/// because otherwise no one would show the label when the fold is left out.
fn folds_of_people(subject_of: &[usize], label_of: &[usize], labels: usize, folds: usize) -> Vec<usize> {
    let people = subject_of.iter().max().map_or(0, |most| most + 1);
    let mut fold_of: Vec<usize> = (0..people).map(|person| person % folds).collect();
    let mut showers = vec![BTreeSet::new(); labels];
    for (&person, &label) in subject_of.iter().zip(label_of) {
        showers[label].insert(person);
    }
    // A move can bring another label's people together. Moves are few; as many rounds as labels resolve all.
    for _ in 0..=labels {
        for people in &showers {
            let mut of_them = people.iter().map(|&person| fold_of[person]);
            let first = of_them.next();
            if people.len() > 1
                && of_them.all(|fold| Some(fold) == first)
                && let Some(&last) = people.last()
            {
                fold_of[last] = (fold_of[last] + 1) % folds;
            }
        }
    }
    fold_of
}

/// Distances of left-out sequences to their nearest labels, and the sizes of their motion.
#[derive(Clone, Debug)]
struct Usual {
    /// Squared distances, ascending.
    distances: Vec<f64>,
    /// Lengths of their displacement vectors, each sequence taken as one vector.
    amounts: Vec<f64>,
    /// Number of people who made these sequences.
    people: usize,
}

impl Usual {
    fn new(of: &[&LeftOut]) -> Self {
        let mut distances: Vec<f64> = of.iter().map(|l| l.nearest()).collect();
        distances.sort_by(f64::total_cmp);
        let people = of.iter().map(|l| l.subject).collect::<BTreeSet<_>>().len();
        Self { distances, amounts: of.iter().map(|l| l.amount).collect(), people }
    }

    /// Returns the typicality of a sequence with this distance from its nearest label and this size of motion.
    fn typicality(&self, distance: f64, amount: f64) -> f64 {
        let farther = self.distances.len() - self.distances.partition_point(|&d| d < distance);
        let share = (1 + farther) as f64 / (1 + self.distances.len()) as f64;
        let beyond = if farther == 0 { self.chance_above(&self.distances, distance) } else { None };
        // The probability of a smaller value equals that of a larger one after taking reciprocals.
        let is_least = self.amounts.iter().all(|&known| known > amount);
        let turned = || self.amounts.iter().map(|known| known.recip()).collect::<Vec<_>>();
        let below = is_least.then(|| self.chance_above(&turned(), amount.max(f64::MIN_POSITIVE).recip())).flatten();
        // Corrected for the number of people, since one of them always moves least.
        let below = below.map(|chance| chance * (1 + self.people) as f64);
        [beyond, below].into_iter().flatten().fold(share, f64::min)
    }

    /// Returns the probability that one more person has a value as large, for log-normally distributed values. Returns `None` if these do
    /// not scatter or are of one person.
    fn chance_above(&self, values: &[f64], value: f64) -> Option<f64> {
        let logarithms: Vec<f64> = values.iter().filter(|&&v| v > 0.0).map(|v| v.ln()).collect();
        let (n, people) = (logarithms.len() as f64, self.people as f64);
        if n < 2.0 || people < 2.0 {
            return None;
        }
        let mean = logarithms.iter().sum::<f64>() / n;
        let variance = logarithms.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / (n - 1.0);
        // Both the next value and the mean are uncertain.
        let t = (value.ln() - mean) / (variance * (1.0 + 1.0 / people)).sqrt();
        t_above(t, people - 1.0)
    }
}

/// Converts distances to probabilities.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Calibration {
    /// Temperature t of `exp(-distance / (2 t))`: a difference of 2 t in squared distance is one unit of log-odds.
    temperature: f64,
    /// Share of sequences that show any label, independent of the distances.
    lapses: f64,
}

impl Calibration {
    /// Returns the probabilities of the labels at the given distances.
    fn probabilities(self, distances: &[Option<f64>]) -> Vec<f64> {
        let least = distances.iter().flatten().copied().fold(f64::INFINITY, f64::min);
        let known = distances.iter().flatten().count().max(1) as f64;
        let weight = |d: &Option<f64>| d.map_or(0.0, |d| (-(d - least) / (2.0 * self.temperature)).exp());
        let weights: Vec<f64> = distances.iter().map(weight).collect();
        let sum: f64 = weights.iter().sum();
        let of =
            |(w, d): (f64, &Option<f64>)| if d.is_some() { (1.0 - self.lapses) * w / sum + self.lapses / known } else { 0.0 };
        weights.into_iter().zip(distances).map(of).collect()
    }

    /// Returns the negative log-likelihood of the labels of left-out sequences.
    fn loss(self, of: &[&LeftOut]) -> f64 {
        let of_one = |l: &&LeftOut| l.distances[l.label].map(|_| -self.probabilities(&l.distances)[l.label].ln());
        of.iter().filter_map(of_one).sum()
    }

    /// Finds the calibration that maximizes the likelihood of the labels of left-out sequences.
    ///
    /// For each share of lapses, the logarithm of the temperature is found by a coarse search and a golden section, from 0.1 (certainty)
    /// to 10,000 (little better than chance).
    fn new(of: &[&LeftOut]) -> Self {
        const GOLDEN: f64 = 0.618_033_988_749_895;
        const COARSE: usize = 16;
        const FINE: usize = 12;
        const SHARES: i32 = 8;
        let (low, high) = (0.1f64.ln(), 1e4f64.ln());
        let step = (high - low) / COARSE as f64;
        // Never 0: half a lapse among one sequence more than there are.
        let least = 0.5 / (of.len() + 1) as f64;
        let best = |lapses: f64| {
            let at = |logarithm: f64| Self { temperature: logarithm.exp(), lapses };
            let coarse = (0..=COARSE).map(|k| low + step * k as f64);
            let start = coarse.min_by(|a, b| at(*a).loss(of).total_cmp(&at(*b).loss(of))).unwrap_or(low);
            let (mut a, mut b) = ((start - step).max(low), (start + step).min(high));
            for _ in 0..FINE {
                let (left, right) = (b - GOLDEN * (b - a), a + GOLDEN * (b - a));
                if at(left).loss(of) <= at(right).loss(of) { b = right } else { a = left }
            }
            at(f64::midpoint(a, b))
        };
        let shares = (0..SHARES).map(|k| least * (0.3 / least).max(1.0).powf(f64::from(k) / f64::from(SHARES - 1)));
        let all = shares.map(|share| best(share.min(0.5)));
        all.min_by(|a, b| a.loss(of).total_cmp(&b.loss(of))).unwrap_or(Self { temperature: 1.0, lapses: least })
    }
}

fn recognized(
    labels: &[String],
    (distances, amount): (&[Option<f64>], f64),
    calibration: Calibration,
    usual: &Usual,
) -> Recognized {
    let probabilities = calibration.probabilities(distances);
    // Of two equally near labels the first.
    let at = (0..distances.len())
        .filter(|&k| distances[k].is_some())
        .min_by(|&a, &b| distances[a].unwrap_or(f64::INFINITY).total_cmp(&distances[b].unwrap_or(f64::INFINITY)));
    let at = at.unwrap_or(0);
    let distance = distances[at].unwrap_or(0.0);
    Recognized {
        label: labels[at].clone(),
        probability: probabilities[at],
        distance,
        typicality: usual.typicality(distance, amount),
        probabilities,
    }
}

#[cfg(test)]
mod tests;
