//! Statistics of normalized dynamic models of one expression [KP, section 4.2 to 4.4].
//!
//! Letters as in [KP]: N live nodes, N' frames per model, N'' models. All lengths are face units.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::{
    model::DynamicExpressionModel,
    units::{FaceUnit, NodeId, SequenceId},
};

/// A normalized model and the sequence it was made from.
#[derive(Clone, Debug)]
pub struct SequenceModel {
    /// The sequence.
    pub id: SequenceId,
    /// Its normalized dynamic model: N' frames over all nodes, face units.
    pub model: DynamicExpressionModel<FaceUnit>,
}

/// What the representative is taken of: an emotion, or an emotion within a group of people.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
pub struct ClassLabel {
    /// Emotion label.
    pub emotion: String,
    /// Column and value of every `--by` column, in the order given; empty when not grouped.
    pub group: BTreeMap<String, String>,
}

/// Which generalized median becomes the representative.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MedianKind {
    /// The greedy search of [KP, section 4.4].
    #[default]
    Greedy,
    /// The exact optimum.
    Exact,
}

/// Options of the statistics.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, serde::Deserialize)]
pub struct StatisticsOptions {
    /// Share of models trimmed per displacement field, 0 <= alpha < 0.5.
    pub alpha: f64,
    /// Which median is the representative.
    pub median: MedianKind,
}

/// One line of the trimming trace: how far one model's displacement field is from the others' [KP, eq. 6].
#[derive(Clone, Debug, PartialEq)]
pub struct TrimmingRow {
    /// Displacement field m, from 0: the motion from frame m to m + 1.
    pub field: usize,
    /// The model's sequence.
    pub id: SequenceId,
    /// d_tf, face units.
    pub distance: f64,
    /// Whether the field was dropped.
    pub dropped: bool,
}

/// A generalized median as a sum of distances, and how sure we are of it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MedianSums {
    /// Sum of distances [KP, eq. 7] of the greedy answer, face units.
    pub greedy: f64,
    /// Sum of distances of the exact answer.
    pub exact: f64,
    /// Proven lower bound of the sum of distances of any model.
    pub lower_bound: f64,
    /// (greedy - exact) / exact; 0 when both are 0.
    pub greedy_gap: f64,
    /// (exact - lower bound) / exact; 0 when both are 0.
    pub certificate_gap: f64,
}

/// A representative dynamic expression with its dispersion.
#[derive(Clone, Debug)]
pub struct Representative {
    /// What it represents.
    pub label: ClassLabel,
    /// The generalized median, from the canonical neutral, N' frames over all nodes.
    pub model: DynamicExpressionModel<FaceUnit>,
    /// Sequences it was computed from (N''), sorted.
    pub sequences: Vec<SequenceId>,
    /// The trimming trace: (N' - 1) x N'' rows, by field, then by sequence.
    pub trimming: Vec<TrimmingRow>,
    /// Sums of distances and gaps, after trimming.
    pub sums: MedianSums,
    /// Dispersion [KP, eq. 8] after trimming, face units; `None` for a single model.
    pub dispersion: Option<f64>,
    /// Dispersion before trimming, around the median of all models; `None` for a single model.
    pub dispersion_untrimmed: Option<f64>,
    /// Distance of every model (in the order of `sequences`) to the representative over the fields it was kept in; `None` when
    /// it was trimmed from every field.
    pub distances: Vec<Option<f64>>,
    /// Distance of every model to the median of all models, before trimming.
    pub distances_untrimmed: Vec<f64>,
    /// Per-node dispersion, in node order (0 for nodes that are not live): the median over models of the mean over kept fields of
    /// d_v to the representative, face units.
    pub node_dispersion: Vec<f64>,
}

/// Why statistics can not be computed.
#[derive(Debug, thiserror::Error)]
pub enum StatisticsError {
    /// No model.
    #[error("no model of `{emotion}` to take a median of")]
    Empty {
        /// The class.
        emotion: String,
    },
    /// alpha outside [0, 0.5).
    #[error("alpha is {alpha}; it must be at least 0 and less than 0.5 (0.1 trims a tenth of the models)")]
    AlphaOutOfRange {
        /// The value.
        alpha: f64,
    },
    /// Models of different shape.
    #[error("{id}: {found} {what} where the others have {expected}")]
    Shape {
        /// The odd one.
        id: SequenceId,
        /// `frames` or `nodes`.
        what: &'static str,
        /// Its count.
        found: usize,
        /// The others'.
        expected: usize,
    },
    /// The result is not a model.
    #[error(transparent)]
    Model(#[from] crate::model::ModelError),
}

/// Computes the representative of one class.
///
/// # Errors
/// [`StatisticsError`].
pub fn representative(
    label: ClassLabel,
    models: &[SequenceModel],
    live: &[NodeId],
    options: &StatisticsOptions,
) -> Result<Representative, StatisticsError> {
    let _ = (label, models, live, options);
    unimplemented!()
}
