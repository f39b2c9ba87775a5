//! Generalized medians of sets of displacement fields [KP, section 4.4 and eq. (7)].
//!
//! A *slot* is one displacement vector of the median: node k of field m. Its points are the vectors at this node of the models kept in
//! field m. The sum of distances of eq. (7) is, up to the factor 1 / ((N' - 1) N), the sum over slots of the distances from the slot's
//! vector to its points.

mod exact;
mod greedy;
mod points;

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::{distance::DisplacementFields, sum::CompensatedSum};

pub use exact::{ExactOptions, GeometricMedian, exact_median, geometric_median};
pub use greedy::{GreedyOptions, greedy_median};
pub use points::PointSet;

/// How a search for a median ended.
///
/// ```
/// use grimace::statistics::SearchEnding;
///
/// // Of several searches the worst counts.
/// let slots = [SearchEnding::Converged, SearchEnding::Stalled];
/// assert_eq!(slots.iter().max(), Some(&SearchEnding::Stalled));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SearchEnding {
    /// Converged within the tolerance.
    #[default]
    Converged,
    /// No step in double precision lowers the sum further, although the tolerance is not reached.
    Stalled,
    /// The largest number of iterations was reached.
    IterationLimit,
}

/// A generalized median: one displacement vector per slot, and its sums of distances.
#[derive(Clone, Debug, PartialEq)]
pub struct Median {
    /// The vectors in slot order: field 0 of all live nodes, then field 1, and so on.
    pub vectors: Vec<Vector2<f64>>,
    /// Sum of distances from each vector to its slot's points.
    pub sums: Vec<f64>,
    /// Proven lower bound of each sum; 0 if the search gives none.
    pub lower_bounds: Vec<f64>,
    /// Number of steps or replacements over all slots.
    pub iterations: usize,
    /// How the search ended: the worst ending of any slot.
    pub ending: SearchEnding,
}

impl Median {
    /// Takes the other median's vector in every slot where its sum is smaller (for an exact median, by rounding only).
    pub fn improve_with(&mut self, other: &Median) {
        for slot in 0..self.sums.len().min(other.sums.len()) {
            if other.sums[slot] < self.sums[slot] {
                self.sums[slot] = other.sums[slot];
                self.vectors[slot] = other.vectors[slot];
                self.lower_bounds[slot] = self.lower_bounds[slot].min(other.sums[slot]);
            }
        }
    }
}

/// The points of all slots, copied slot by slot.
#[derive(Clone, Debug)]
pub struct Slots {
    node_count: usize,
    /// Points by field: node 0's points, then node 1's, and so on, each as many as the field has members.
    fields: Vec<Vec<Vector2<f64>>>,
    /// Weights of the members by field, or `None` if all are equal.
    weights: Option<Vec<Vec<f64>>>,
}

impl Slots {
    /// Collects the slots of `models`. `members[m]` are the indices of the models that count in field m; `weights` are by model.
    ///
    /// # Panics
    /// If a field has no member, a member is not in `models`, shapes differ, or a vector is not finite (programmer's errors).
    pub fn new(models: &[DisplacementFields], members: &[Vec<usize>], weights: Option<&[f64]>) -> Self {
        let node_count = models[0].node_count();
        let gather = |(m, members): (usize, &Vec<usize>)| {
            assert!(!members.is_empty(), "field {m} has no member");
            (0..node_count).flat_map(|k| members.iter().map(move |&i| models[i].vector(m, k))).collect::<Vec<_>>()
        };
        let fields: Vec<_> = members.iter().enumerate().map(gather).collect();
        assert!(fields.iter().flatten().all(|v| PointSet::new(std::slice::from_ref(v)).is_ok()), "a vector is not finite");
        let of_members = |weights: &[f64]| members.iter().map(|members| members.iter().map(|&i| weights[i]).collect()).collect();
        Self { node_count, fields, weights: weights.map(of_members) }
    }

    /// Returns the number of slots, (N' - 1) N.
    pub fn len(&self) -> usize {
        self.fields.len() * self.node_count
    }

    /// Returns the points of one slot.
    ///
    /// # Panics
    /// If there is no such slot (a programmer's error).
    pub fn points(&self, slot: usize) -> PointSet<'_> {
        let field = &self.fields[slot / self.node_count];
        let count = field.len() / self.node_count;
        let k = slot % self.node_count;
        let weights = self.weights.as_ref().map(|weights| weights[slot / self.node_count].as_slice());
        PointSet::known(&field[k * count..(k + 1) * count], weights)
    }

    /// Returns the sum of distances [KP, eq. (7)] from the sums of the slots: their sum divided by (N' - 1) N, in the models' unit.
    pub fn total(&self, sums: &[f64]) -> f64 {
        CompensatedSum::of(sums.iter().copied()) / self.len() as f64
    }
}
