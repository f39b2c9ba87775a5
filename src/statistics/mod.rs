//! Statistics of the normalized dynamic models of one expression [KP, section 4.2 to 4.4].
//!
//! [`group_models`] splits labelled models into classes. [`representative`] processes one class with [`distance`] (eq. 2 to 5),
//! [`trimming`] (eq. 6), [`median`] (eq. 7) and [`dispersion`] (eq. 8).
//!
//! Symbols as in \[KP\]: N live nodes, N' frames per model, N'' models. All lengths are in face units. Results depend neither on the
//! order of the models nor on the number of threads.

pub mod amplitude;
pub mod bootstrap;
mod columns;
mod comparable;
pub mod compare;
pub mod covariate;
pub mod dispersion;
pub mod distance;
mod groups;
pub mod median;
pub mod recognize;
mod representative;
pub mod scale;
mod spelling;
mod sum;
pub mod trimming;
mod values;
pub mod variation;
mod weights;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::{
    model::DynamicExpressionModel,
    units::{FaceUnit, NodeId, SequenceId},
};
pub use comparable::NotComparable;
pub use compare::GroupOptions;
pub use dispersion::Dispersions;
use median::SearchEnding;

pub(crate) use amplitude::{t_above, t_quantile};
pub use columns::{column_notes, without_stratum_said};
use compare::Strata;
pub use groups::{
    EMOTIONS, GroupError, LabelledModel, check_columns, check_groups, check_numbers, group_models, group_models_unchecked,
    group_sequences, spell_as_groups,
};
pub use representative::{NEUTRAL_TOLERANCE, check_models, representative};
pub(crate) use spelling::person_key;
pub use spelling::{abbreviations, common_spellings, likely_emotion, near_twins, spelling_key, synonyms};
pub use trimming::TrimLevel;
pub use values::{SequenceLabels, UNKNOWN_GROUP, is_missing, measures_said, number_of};
pub use weights::Weighting;
pub(crate) use weights::sequence_weights;

/// A normalized model and the sequence it was made from.
///
/// ```
/// use grimace::{pipeline::read_model, statistics::SequenceModel, units::SequenceId};
///
/// let id = SequenceId { subject: "P1".to_owned(), sequence: "smile".to_owned() };
/// let model = read_model("fixtures/golden/representatives/happiness.csv".as_ref())?;
/// let smile = SequenceModel { id, model };
/// assert_eq!((smile.id.to_string().as_str(), smile.model.frame_count()), ("P1_smile", 5));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct SequenceModel {
    /// Identity of the sequence.
    pub id: SequenceId,
    /// Its normalized dynamic model: N' frames over all nodes, face units.
    pub model: DynamicExpressionModel<FaceUnit>,
}

/// The class that a representative summarizes: an emotion, or an emotion within a group of people.
///
/// ```
/// use std::collections::BTreeMap;
///
/// use grimace::statistics::ClassLabel;
///
/// let all = ClassLabel { emotion: "happiness".to_owned(), group: BTreeMap::new() };
/// let women = ClassLabel { group: BTreeMap::from([("sex".to_owned(), "f".to_owned())]), ..all.clone() };
/// assert!(all < women);
/// ```
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ClassLabel {
    /// Emotion label.
    pub emotion: String,
    /// Value of each `--by` column, by column name; empty when not grouped.
    pub group: BTreeMap<String, String>,
}

/// Which generalized median becomes the representative.
///
/// ```
/// use grimace::statistics::{MedianKind, StatisticsOptions};
///
/// let options = StatisticsOptions { median: MedianKind::Exact, ..StatisticsOptions::default() };
/// assert_ne!(options.median, MedianKind::default());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MedianKind {
    /// Greedy search of [KP, section 4.4].
    #[default]
    Greedy,
    /// Exact optimum.
    Exact,
}

/// Options of the statistics.
///
/// ```
/// use grimace::statistics::StatisticsOptions;
///
/// let without_trimming = StatisticsOptions { alpha: 0.0, ..StatisticsOptions::default() };
/// assert_eq!((without_trimming.alpha, StatisticsOptions::DEFAULT_ALPHA), (0.0, 0.1));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, serde::Deserialize)]
pub struct StatisticsOptions {
    /// Share of models trimmed per displacement field, 0 <= alpha < 0.5.
    pub alpha: f64,
    /// Which median becomes the representative.
    pub median: MedianKind,
    /// Whether people or sequences have equal weight.
    #[serde(default)]
    pub weighting: Weighting,
    /// Whether single displacement fields or whole models are trimmed.
    #[serde(default)]
    pub trim: TrimLevel,
}

impl StatisticsOptions {
    /// Default of [`StatisticsOptions::alpha`]: a tenth of the models. \[KP\] give no number.
    pub const DEFAULT_ALPHA: f64 = 0.1;
}

impl Default for StatisticsOptions {
    fn default() -> Self {
        Self {
            alpha: Self::DEFAULT_ALPHA,
            median: MedianKind::Greedy,
            weighting: Weighting::default(),
            trim: TrimLevel::default(),
        }
    }
}

/// One row of the trimming trace: distance of one model's displacement field from the other models' [KP, eq. 6].
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
/// # let label = grimace::statistics::ClassLabel { emotion: "smile".to_owned(), group: Default::default() };
/// use grimace::statistics::{StatisticsOptions, representative};
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let models = [smile("P1", 10.0), smile("P2", 12.0), smile("P3", 14.0), smile("P4", 500.0)];
/// let options = StatisticsOptions { alpha: 0.25, ..StatisticsOptions::default() };
/// let trimmed = representative(label, &models, &face.wireframe, &options)?;
/// // A quarter of each of the four displacement fields is dropped: that of P4.
/// let dropped: Vec<&str> = trimmed.trimming.iter().filter(|row| row.dropped).map(|row| row.id.subject.as_str()).collect();
/// assert_eq!(dropped, ["P4"; 4]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrimmingRow {
    /// Displacement field m, from 0: the motion from frame m to m + 1.
    pub field: usize,
    /// The model's sequence.
    pub id: SequenceId,
    /// `d_tf`, face units.
    pub distance: f64,
    /// Whether the field was dropped.
    pub dropped: bool,
}

/// Sums of distances of the generalized medians, with bounds on their error.
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
/// # let label = grimace::statistics::ClassLabel { emotion: "smile".to_owned(), group: Default::default() };
/// use grimace::statistics::representative;
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// // The median of the smiles of 10, 20 and 30 is that of 20, and both searches find it.
/// let models = [smile("P1", 10.0), smile("P2", 20.0), smile("P3", 30.0)];
/// let sums = representative(label, &models, &face.wireframe, &Default::default())?.sums;
/// assert_eq!((sums.greedy, sums.greedy_gap), (sums.exact, 0.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MedianSums {
    /// Sum of distances [KP, eq. 7] of the greedy median, face units.
    pub greedy: f64,
    /// Sum of distances of the exact median, face units.
    pub exact: f64,
    /// Proven lower bound on the sum of distances of any model, face units.
    pub lower_bound: f64,
    /// (greedy - exact) / exact; 0 when both are 0.
    pub greedy_gap: f64,
    /// (exact - lower bound) / exact; 0 when both are 0.
    pub certificate_gap: f64,
}

/// Steps and endings of the searches for the medians after trimming.
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
/// # let label = grimace::statistics::ClassLabel { emotion: "smile".to_owned(), group: Default::default() };
/// use grimace::statistics::representative;
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let models = [smile("P1", 10.0), smile("P2", 20.0), smile("P3", 30.0)];
/// let search = representative(label, &models, &face.wireframe, &Default::default())?.search;
/// assert_eq!(search.greedy_ending, search.exact_ending);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MedianSearch {
    /// Number of displacement vectors that the greedy search replaced.
    pub greedy_replacements: usize,
    /// How the greedy search ended.
    pub greedy_ending: SearchEnding,
    /// Number of steps of the exact search, summed over all slots.
    pub exact_steps: usize,
    /// How the exact search ended: the worst ending of any slot.
    pub exact_ending: SearchEnding,
}

/// A representative dynamic expression with its dispersion.
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
/// # let label = grimace::statistics::ClassLabel { emotion: "smile".to_owned(), group: Default::default() };
/// use grimace::statistics::representative;
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let models = [smile("P1", 10.0), smile("P2", 20.0), smile("P3", 30.0)];
/// let smile = representative(label, &models, &face.wireframe, &Default::default())?;
/// // The corners of the mouth rise by 20 from frame to frame, 80 in all.
/// assert!((smile.model.neutral_offsets(4)[31].y - 80.0).abs() < 1e-6);
/// assert_eq!((smile.sequences.len(), smile.trimming.len()), (3, 4 * 3));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Representative {
    /// The emotion, and group if any.
    pub label: ClassLabel,
    /// The generalized median: N' frames over all nodes, starting from the canonical neutral.
    #[serde(with = "crate::model::as_points")]
    pub model: DynamicExpressionModel<FaceUnit>,
    /// The N'' sequences it was computed from, sorted.
    pub sequences: Vec<SequenceId>,
    /// The trimming trace: (N' - 1) x N'' rows, by field, then by sequence.
    pub trimming: Vec<TrimmingRow>,
    /// Certainty of the trimming when it was decided from bounds, that is for more than 2048 models. The distances of the trace then have
    /// the error given there.
    #[doc(hidden)]
    pub certificate: Option<scale::Certificate>,
    /// Kind of the median: the requested one, or the exact one for more than 2048 models.
    pub median: MedianKind,
    /// Sums of distances and gaps, after trimming.
    pub sums: MedianSums,
    /// How the searches for the medians ended.
    pub search: MedianSearch,
    /// Dispersion [KP, eq. 8] after trimming, face units; `None` for a single model.
    pub dispersion: Option<f64>,
    /// Dispersion before trimming, around the median of all models; `None` for a single model.
    pub dispersion_untrimmed: Option<f64>,
    /// Other forms of the dispersion, comparable before and after trimming.
    pub dispersions: Dispersions,
    /// Whether the models are weighted: people have different numbers of sequences, and each person counts as one.
    pub weighted: bool,
    /// Distance of every model (in the order of `sequences`) to the representative over the fields that were kept; `None` if all its
    /// fields were trimmed.
    pub distances: Vec<Option<f64>>,
    /// Distance of every model to the median of all models before trimming.
    pub distances_untrimmed: Vec<f64>,
    /// Dispersion per node, face units, in node order (0 for nodes that are not live): the median over models of the mean over kept
    /// fields of `d_v` to the representative.
    pub node_dispersion: Vec<f64>,
}

/// Why the statistics cannot be computed.
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
/// # let label = grimace::statistics::ClassLabel { emotion: "smile".to_owned(), group: Default::default() };
/// use grimace::statistics::{StatisticsError, StatisticsOptions, representative};
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let options = StatisticsOptions { alpha: 0.5, ..StatisticsOptions::default() };
/// let error = representative(label, &[smile("P1", 10.0)], &face.wireframe, &options).unwrap_err();
/// assert!(matches!(error, StatisticsError::AlphaOutOfRange { alpha: 0.5 }));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum StatisticsError {
    /// There are no models.
    #[error("there is no model of `{emotion}` to compute a median from")]
    Empty {
        /// Emotion of the class.
        emotion: String,
    },
    /// alpha outside [0, 0.5).
    #[error("alpha is {alpha}; it must be at least 0 and less than 0.5 (0.1 trims a tenth of the models)")]
    AlphaOutOfRange {
        /// Value of alpha.
        alpha: f64,
    },
    /// Too many models for trimming whole models.
    #[error(
        "trimming whole models supports at most {limit} sequences, but there are {found}; trim at frame level, or do not trim (alpha 0)"
    )]
    ModelTrimmingOfMany {
        /// Number of models.
        found: usize,
        /// Largest number of models allowed.
        limit: usize,
    },
    /// A sequence has two models.
    #[error("there are two models of sequence {id}; remove or rename one")]
    DuplicateSequence {
        /// The sequence.
        id: SequenceId,
    },
    /// Models with different numbers of frames or nodes.
    #[error("{id}: it has {found} {what}, but the others have {expected}; normalize all sequences with the same options")]
    Shape {
        /// Sequence of the differing model.
        id: SequenceId,
        /// `frames` or `nodes`. For nodes, the expected count is that of the other models and of the wireframe.
        what: &'static str,
        /// Its number of frames or nodes.
        found: usize,
        /// Number of frames or nodes of the others.
        expected: usize,
    },
    /// A neutral frame that differs from the canonical one of normalized models.
    #[error(
        "{id}: node {node} of the neutral frame is {distance} face units from its place in the other models, more than rounding explains \
         ({tolerance}); normalize all sequences with the same wireframe and options"
    )]
    Neutral {
        /// Sequence of the differing model.
        id: SequenceId,
        /// Live node with the largest distance.
        node: NodeId,
        /// Distance in face units.
        distance: f64,
        /// Largest distance allowed.
        tolerance: f64,
    },
    /// Models that cannot be compared, such as one with a displacement that is impossible for a face.
    #[error(transparent)]
    Models(#[from] NotComparable),
    /// Displacement vectors that cannot be read.
    #[error("{}: {reason}", path.display())]
    Source {
        /// The file.
        path: std::path::PathBuf,
        /// Description of the error.
        reason: String,
    },
    /// The result is not a valid model.
    #[error(transparent)]
    Model(#[from] crate::model::ModelError),
}

#[doc(hidden)]
impl From<scale::SourceError> for StatisticsError {
    fn from(scale::SourceError { path, reason }: scale::SourceError) -> Self {
        Self::Source { path, reason }
    }
}
