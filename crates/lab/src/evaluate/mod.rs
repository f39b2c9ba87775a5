//! Experiments that measure the accuracy of fit and tracker against ground truth.
//!
//! [`evaluate_fit`] measures the node error of the fit by number and choice of marks, and [`suggest_marks`] searches for the best nodes to
//! mark. [`evaluate_tracking`] repeats the paper's tracking experiment [KP, Fig. 3] on simulated and real sequences. [`fit_confidence`]
//! learns the tracker's expected errors. Every error is a distance in the image, in pixels and in percent of the eye distance ES0 (the
//! distance between the pupils).
//!
//! Results are [`Table`]s, written as CSV and as Markdown, and [`LineChart`]s, written as SVG. They depend on options, seed and data alone,
//! not on the number of threads.

mod action_unit_images;
mod action_units;
mod beside;
mod calibration;
mod clone;
mod clone_cross;
mod clone_quality;
mod clone_sheets;
mod confidence;
mod confidence_samples;
mod figure;
mod figures;
mod fit;
mod groups;
mod heads;
mod image_marks;
mod locate;
mod marks;
mod people;
mod placement;
mod pose;
mod pose_images;
mod recognition;
mod records;
mod scale;
mod segment;
mod synthesis;
mod synthetic;
mod table;
mod tracking;
mod truth;
mod variant;

use std::path::PathBuf;

use crate::simulate::SimulateError;
use grimace::internal::{
    clone::CloneError,
    dataset::{DatasetError, LandmarksError},
    fit::FitError,
    input::InputError,
    output::OutputError,
    sequence::SequenceError,
    synthesis::SynthesisError,
};

pub use action_unit_images::evaluate_action_units_in_images;
pub use action_units::{ActionUnitOptions, ActionUnitTrial, action_unit_table, evaluate_action_units, judged_mean};
pub use beside::{BesidePerson, BesideTrial, beside_table, beside_trials, evaluate_beside, evaluate_beside_in};
pub use calibration::{Calibration, CalibrationClass, evaluate_discriminants};
pub use clone::{SelfRow, SelfVariant, evaluate_self_cloning, self_rows_table, self_table};
pub use clone_cross::{CrossRow, Transfer, cross_table, evaluate_cross_cloning};
pub use clone_quality::{Likeness, likeness};
pub use clone_sheets::{SheetSource, TargetSheet, clone_grades_table, draw_clone_sheet};
pub use confidence::{
    CalibrationPart, ExpectedError, QUINTILES, calibration, calibration_chart, calibration_rows, calibration_table,
    expected_of_records, expected_of_samples, fit_confidence, verdict_table,
};
pub use confidence_samples::{
    ConfidenceCondition, ConfidenceOptions, ConfidenceSample, PhotographedPerson, SampledSequence, confidence_samples,
};
pub use figure::{LineChart, Series};
pub use figures::{
    KpFigures, PUBLISHED_DISPERSIONS, Plate, PlateContent, ScalingRow, ZlFigures, scaling_rows, scaling_table, zl_plates,
};
pub use fit::{FitArea, FitMethod, FitRow, FitStudy, chart_of_choices, chart_of_methods, evaluate_fit, fit_table};
pub use groups::{GroupStudy, GroupStudyError, GroupStudyOptions, GroupTrial, IntervalTrial, evaluate_groups, wilson};
pub use locate::{GROSS, LocatedPerson, evaluate_locate, locate_calibration, locate_failures, locate_table};
pub use marks::{MarkChoice, SUGGESTED_COUNT, standard_choices, suggest_marks, suggested_table};
pub use people::{
    MarkNoise, Person, Population, TruthNode, is_landmark_file, people_of_dataset, people_of_landmark_file, simulated_people,
};
pub use placement::{
    FOUND, PlacementSample, Placements, SET_ALONE, SET_AND_READ, placement_knots, placement_samples, placement_table,
    unmarked_table,
};
pub use pose::{
    LANDMARK_SEQUENCES, PoseStudyOptions, PoseTrial, TurnCase, evaluate_pose, motion_lost, pose_table, pose_trials_table,
};
pub use pose_images::{IMAGE_SEQUENCES, evaluate_pose_images};
pub use recognition::{
    LabelledSequence, Recognition, RecognitionError, RecognitionSummary, RecognizedSequence, evaluate_recognition,
};
pub use records::{
    Part, RecordedError, Records, curve_table, frames_worse, last_table, markdown_last, sequence_table, tracking_chart,
};
pub use scale::{ScaleError, ScaleOptions, ScaleRow, evaluate_scale, growth_exponent, scale_table, write_synthetic_models};
pub use segment::{RecordingTruth, SegmentTrial, judge_recording, read_recording_truth, segment_table};
pub use synthesis::{
    CrossoverRow, REPEATS, Seams, SolverRow, SynthesisStudy, SynthesisTarget, TimeRow, crossover_table, error_chart,
    evaluate_crossovers, evaluate_solvers, history_chart, solver_table, time_solvers, time_table,
};
pub use synthetic::{Spread, SyntheticPeople};
pub use table::{Cell, Table};
pub use tracking::{
    Failed, Start, TrackingCase, TrackingOptions, TrackingResult, dataset_cases, evaluate_tracking, hard_simulation,
    simulated_cases, truth_case,
};
pub use variant::{PLAIN_LEVELS, PLAIN_WINDOW_PX, TrackerVariant, VariantKind, standard_variants};

pub use truth::TruthError;

/// Why an experiment failed.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// A simulation option is out of range.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// No prior can be learned: too few faces, or unsuitable ones.
    #[error(transparent)]
    Learn(#[from] grimace::internal::fit::LearnError),
    /// A face that cannot be cloned.
    #[error(transparent)]
    Clone(#[from] CloneError),
    /// A fit failed that must not fail.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The dataset cannot be opened.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// Landmarks cannot be read or used.
    #[error(transparent)]
    Landmarks(#[from] LandmarksError),
    /// A CSV file cannot be read.
    #[error(transparent)]
    Input(#[from] InputError),
    /// Exact positions cannot be read.
    #[error(transparent)]
    Truth(#[from] TruthError),
    /// Frames cannot be read.
    #[error(transparent)]
    Sequence(#[from] SequenceError),
    /// A file that cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// No sequence of a dataset has landmarks to compare with.
    #[error("{}: no sequence has 68-point landmarks to compare with; name them in the manifest's column `landmarks`", path.display())]
    NoTruth {
        /// The dataset.
        path: PathBuf,
    },
    /// The manifest lacks the column to group by.
    #[error("{id} has no column `{column}` to group by; choose from {}", found.join(", "))]
    NoColumn {
        /// The first sequence without it.
        id: String,
        /// The column asked for.
        column: String,
        /// Columns there are.
        found: Vec<String>,
    },
    /// A tracker variant that cannot be understood.
    #[error("variant `{text}`: {reason}")]
    Variant {
        /// As given.
        text: String,
        /// What is wrong and what was expected.
        reason: String,
    },
    /// Too few nodes to choose marks from.
    #[error("{found} nodes can be marked on every person; at least {needed} are needed to choose {needed} marks")]
    TooFewCandidates {
        /// Candidates.
        found: usize,
        /// Marks wanted.
        needed: usize,
    },
    /// A curve that cannot be drawn.
    #[error("the figure `{title}` cannot be drawn: {reason}")]
    Figure {
        /// Its title.
        title: String,
        /// Why.
        reason: String,
    },
    /// A bank or options from which nothing can be synthesized.
    #[error(transparent)]
    Synthesis(#[from] SynthesisError),
    /// A sequence of a study failed; none may fail.
    #[error("a sequence of the study failed at {reason}")]
    Sequences {
        /// Stage and reason.
        reason: String,
    },
    /// The caller asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// Mean, median and 95th percentile of a set of errors, in the unit of the errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorSummary {
    /// Number of errors.
    pub count: usize,
    /// Arithmetic mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
}

impl ErrorSummary {
    /// Summarizes errors. Returns `None` when there are none, or when one is not finite.
    pub fn of(errors: &[f64]) -> Option<Self> {
        if errors.is_empty() || errors.iter().any(|e| !e.is_finite()) {
            return None;
        }
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let mut sorted = errors.to_vec();
        sorted.sort_by(f64::total_cmp);
        Some(Self { count: errors.len(), mean, median: percentile(&sorted, 0.5)?, p95: percentile(&sorted, 0.95)? })
    }
}

/// Returns the value below which `share` (0 to 1) of the sorted values lie, or `None` when there are no values.
///
/// The result is interpolated linearly at the index `share (n - 1)` of n values, counted from 0 (type 7 of Hyndman and Fan 1996).
pub fn percentile(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let place = share.clamp(0.0, 1.0) * last as f64;
    let below = (place.floor() as usize).min(last);
    let above = (below + 1).min(last);
    Some(sorted[below] + (sorted[above] - sorted[below]) * (place - below as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_lie_between_neighbours() {
        // The indices in 1, 2, 4, 10 are 0.5 x 3 = 1.5 and 0.95 x 3 = 2.85.
        let sorted = [1.0, 2.0, 4.0, 10.0];
        assert_eq!(percentile(&sorted, 0.5), Some(3.0));
        assert!((percentile(&sorted, 0.95).unwrap() - (4.0 + 0.85 * 6.0)).abs() < 1e-12);
        assert_eq!(percentile(&sorted, 0.0), Some(1.0));
        assert_eq!(percentile(&sorted, 1.0), Some(10.0));
        assert_eq!(percentile(&[7.0], 0.95), Some(7.0));
        assert_eq!(percentile(&[], 0.5), None);
    }

    #[test]
    fn summaries_do_not_depend_on_order_and_refuse_nan() {
        // (10 + 1 + 4 + 2) / 4 = 4.25.
        let summary = ErrorSummary::of(&[10.0, 1.0, 4.0, 2.0]).unwrap();
        assert_eq!((summary.count, summary.mean, summary.median), (4, 4.25, 3.0));
        assert_eq!(ErrorSummary::of(&[]), None);
        assert_eq!(ErrorSummary::of(&[1.0, f64::NAN]), None);
    }
}
