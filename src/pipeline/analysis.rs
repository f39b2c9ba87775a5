//! Computes representatives, statistics and FAPs from normalized models, for `run` and `analyze`.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use rayon::prelude::*;

use super::{
    AmplitudeResults, Failure, RecognitionResults, Workbench,
    classes::{class, spelling_warnings, unique_stem, warnings},
    covariates::{CovariateResult, covariate_warnings, covariates},
    looks::looked_said,
    parts::EmotionPart,
    recognition::{left_out_said, recognize_left_out},
    same::{mixed_marks_said, same_said},
    sequence_table::SequenceRow,
    variation::{EmotionVariation, variations},
};
use crate::{
    clone::{CloneError, NoSkin, Skin},
    fap::{Clamped, ConvertError, FapSequence, FapWriteError},
    features::Course,
    model::ModelError,
    normalize::{FRAMES_PER_MODEL, Resample},
    output::{OutputError, count, listed},
    statistics::{
        ClassLabel, GroupError, LabelledModel, Representative, SequenceLabels, SequenceModel, StatisticsError,
        bootstrap::DispersionInterval,
        check_columns, check_numbers, column_notes,
        compare::{Comparisons, Strata},
        group_models, is_missing, spell_as_groups, spelling_key,
    },
    track::TrackQuality,
    units::SequenceId,
    wireframe::FapusError,
};

/// A normalized model with the columns that the statistics group by.
#[derive(Clone, Debug)]
pub struct AnalyzedModel {
    /// The model and its sequence.
    pub model: SequenceModel,
    /// Emotion label.
    pub emotion: String,
    /// Further columns of the manifest.
    pub metadata: BTreeMap<String, String>,
    /// Tracking quality, if known.
    pub quality: Option<TrackQuality>,
    /// Pose and action units over time, if known.
    pub course: Option<Course>,
    /// Identifies its pictures; `None` if it has none or if they are unknown.
    pub pictures: Option<String>,
    /// Where the marks of its neutral frame come from, as in the `.json` of its track; `None` if unknown.
    pub marks_from: Option<String>,
}

impl AnalyzedModel {
    /// Whether a person has left it out of the statistics.
    pub fn is_left_out(&self) -> bool {
        self.quality.as_ref().is_some_and(TrackQuality::is_left_out)
    }
}

/// Errors of the analysis.
#[derive(Debug, thiserror::Error)]
pub enum AnalysisError {
    /// The statistics of a class failed.
    #[error(transparent)]
    Statistics(#[from] StatisticsError),
    /// The FAPUs of the canonical neutral cannot be measured.
    #[error(transparent)]
    Fapus(#[from] FapusError),
    /// A model is invalid.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A FAP file cannot be written.
    #[error(transparent)]
    Fap(#[from] FapWriteError),
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The report cannot be rendered.
    #[error("cannot render the report: {0}")]
    Report(#[from] minijinja::Error),
    /// Grouping by the requested columns is not possible.
    #[error(transparent)]
    Group(#[from] GroupError),
    /// The representatives cannot be shown on the report's face.
    #[error("the portrait of the report: {0}")]
    Face(#[from] CloneError),
    /// The FAPs of a representative cannot be computed.
    #[error(transparent)]
    Convert(#[from] ConvertError),
    /// A columnar file of models.
    #[cfg(feature = "columnar")]
    #[error(transparent)]
    Columnar(#[from] crate::columnar::ColumnarError),
    /// All tracked sequences were left out.
    #[error(
        "all {sequences} tracked sequences are left out in {}, so there are no statistics; take some rows out of it",
        crate::track::LOOKED_AT
    )]
    AllLeftOut {
        /// The sequences that were left out.
        sequences: usize,
    },
    /// Grouping would need more models than fit into memory.
    #[error(
        "the models need about {needed} MB, more than the {allowed} MB of --memory, so groups cannot be compared and numeric columns \
         cannot be tested; raise --memory, or leave --by and --covariate out"
    )]
    GroupsNeedMemory {
        /// Megabytes of all models.
        needed: u64,
        /// Megabytes allowed.
        allowed: u64,
    },
}

/// One representative with its FAPs.
#[derive(Clone, Debug)]
pub struct AnalyzedClass {
    /// The representative.
    pub representative: Representative,
    /// Stem of its files: the emotion, followed by `_COLUMN-VALUE` for every column grouped by.
    pub stem: String,
    /// Its FAPs: key frames and interpolated frames.
    pub fap: FapSequence,
    /// Values clamped to the standard's ranges.
    pub clamped: Vec<Clamped>,
    /// Number of people in the class.
    pub subjects: usize,
    /// Bootstrap interval of its dispersion; `None` without groups or with too few people.
    pub interval: Option<DispersionInterval>,
    /// Mean change of the skin by the expression, or why it is unknown; it covers no people until a run reads the pictures.
    pub skin: Result<Skin, NoSkin>,
}

/// Results of the analysis of a set of models.
#[derive(Clone, Debug)]
pub struct Analysis {
    /// Classes by emotion, then by group.
    pub classes: Vec<AnalyzedClass>,
    /// Tests between groups; `None` without groups.
    pub comparisons: Option<Comparisons>,
    /// Measurements of every sequence at its apex; empty where models are read node by node.
    pub sequences: Vec<SequenceRow>,
    /// Tracking quality of each sequence, by id.
    pub tracks: Vec<TrackQuality>,
    /// Pose and action units over time, for sequences that have them.
    pub courses: BTreeMap<SequenceId, Course>,
    /// Failures of earlier stages.
    pub failures: Vec<Failure>,
    /// Warnings to the user.
    pub warnings: Vec<String>,
    /// Notes on sequences that are copies of others; they are among the warnings too.
    pub same: Vec<String>,
    /// Amplitudes of all sequences; empty where models are read node by node.
    pub amplitudes: AmplitudeResults,
    /// Associations of emotions with the people's numbers; empty without `--covariate`.
    pub covariates: Vec<CovariateResult>,
    /// Variation among the people of each emotion; empty where models are read node by node.
    pub variations: Vec<EmotionVariation>,
    /// Recognition of every sequence with its person left out; `None` where it is not possible.
    pub recognition: Option<RecognitionResults>,
    /// Whether the sequences were tracked with the present options, so that the report may state them.
    pub tracked_here: bool,
}

impl Analysis {
    /// Stem and number of sequences of every class.
    pub fn counts(&self) -> Vec<(String, usize)> {
        self.classes.iter().map(|c| (c.stem.clone(), c.representative.sequences.len())).collect()
    }
}

/// Computes the representative of every class of the models.
///
/// # Errors
/// `AnalysisError` when a column to group by does not exist or the options are out of range.
pub fn analyze(models: Vec<AnalyzedModel>, failures: Vec<Failure>, bench: &Workbench) -> Result<Analysis, AnalysisError> {
    analyze_with(models, failures, bench, None)
}

/// As [`analyze`], reusing matching parts of emotions from the output folder `parts_of`.
pub(super) fn analyze_with(
    models: Vec<AnalyzedModel>,
    failures: Vec<Failure>,
    bench: &Workbench,
    parts_of: Option<&Path>,
) -> Result<Analysis, AnalysisError> {
    let options = &bench.options;
    let mut tracks: Vec<TrackQuality> = models.iter().filter_map(|m| m.quality.clone()).collect();
    tracks.sort_by(|a, b| a.id.cmp(&b.id));
    let sequences = models.len();
    let models: Vec<AnalyzedModel> = models.into_iter().filter(|m| !m.is_left_out()).collect();
    if models.is_empty() && sequences > 0 {
        return Err(AnalysisError::AllLeftOut { sequences });
    }
    let same: Vec<String> = same_said(&models).into_iter().chain(mixed_marks_said(&models)).collect();
    let courses = models.iter().filter_map(|m| Some((m.model.id.clone(), m.course.clone()?))).collect();
    let fapus = bench.normalizer()?.canonical().fapus;
    let mut sequences: Vec<SequenceRow> = models.par_iter().map(|model| SequenceRow::of(model, &fapus)).collect();
    let grouped = labelled(models);
    let labels: Vec<SequenceLabels<'_>> = grouped.iter().map(LabelledModel::labels).collect();
    let spelled = spelling_warnings(&labels, &options.by);
    let about_columns = column_notes(&labels, &options.by, &options.strata, &options.covariates);
    check_columns(&options.strata, grouped.iter().map(|m| &m.metadata))?;
    check_numbers(&options.covariates, &grouped.iter().map(|m| &m.metadata))?;
    let strata = strata_of(&grouped, &options.strata);
    let strata = strata.as_ref();
    let emotions = by_emotion(group_models(&grouped, &options.by)?);
    let part = |(emotion, groups): &(String, Vec<(ClassLabel, Vec<&SequenceModel>)>)| {
        let known = parts_of.and_then(|out| EmotionPart::read(out, emotion, groups, bench, strata));
        known.map_or_else(|| EmotionPart::compute(emotion, groups, bench, strata), Ok)
    };
    let parts = emotions.par_iter().map(part).collect::<Result<Vec<_>, AnalysisError>>()?;
    let mut stems = BTreeSet::new();
    let (mut classes, mut comparisons) = (Vec::new(), Vec::new());
    for part in parts {
        for c in part.classes {
            let stem = unique_stem(&c.representative.label, &mut stems);
            classes.push(class(c.representative, stem, c.subjects, c.interval, &fapus, bench)?);
        }
        comparisons.push(part.comparisons);
    }
    let mut warnings: Vec<String> =
        marks_beside(&tracks).into_iter().chain(look_again(&tracks)).chain(warnings(&classes, &options.statistics)).collect();
    warnings.extend(looked_said(&tracks));
    warnings.extend(too_short(lengths_of(&tracks), options.normalize.resample));
    let comparisons = (!options.by.is_empty()).then(|| Comparisons::together(comparisons));
    warnings.extend(comparisons.iter().flat_map(|c| c.warnings(options.groups.compare.significance)));
    warnings.extend(same.iter().cloned());
    warnings.extend(spelled);
    warnings.extend(about_columns);
    let mut amplitudes = AmplitudeResults::new(&emotions, &grouped, strata, bench);
    warnings.extend(amplitudes.warnings());
    let covariates = covariates(&emotions, &grouped, &classes, &amplitudes, strata, bench);
    warnings.extend(covariate_warnings(&covariates, bench));
    let recognition = recognize_left_out(&grouped, bench);
    // Recognition needs at least two emotions; with one, no note about it is useful.
    let several = emotions.len() > 1;
    warnings.extend(recognition.as_ref().err().filter(|_| several).map(|why| format!("no recognition.csv: {why}")));
    warnings.extend(recognition.as_ref().ok().and_then(|results| left_out_said(&results.left_out)));
    let variations = variations(&emotions, &classes, &fapus, bench);
    let findings = amplitudes.findings(options.groups.compare.significance, &options.groups.amplitude);
    if !findings.is_empty() {
        warnings.push(format!("by amplitude: {}", listed(&findings, 6)));
    }
    // Tables of sequences name groups as all other tables do.
    let rows = sequences.iter_mut().map(|row| &mut row.metadata);
    let rows = rows.chain(amplitudes.sequences.iter_mut().map(|row| &mut row.metadata));
    spell_as_groups(&options.by, grouped.iter().map(|m| &m.metadata), rows);
    Ok(Analysis {
        classes,
        comparisons,
        sequences,
        tracks,
        courses,
        failures,
        warnings,
        same,
        tracked_here: false,
        amplitudes,
        covariates,
        variations,
        recognition: recognition.ok(),
    })
}

/// The strata of all people, if columns are given.
pub(super) fn strata_of(models: &[LabelledModel], columns: &[String]) -> Option<Strata> {
    let values = |m: &LabelledModel| {
        columns
            .iter()
            .map(|c| m.metadata.get(c).filter(|v| !is_missing(v)).map_or_else(String::new, |v| spelling_key(v)))
            .collect()
    };
    (!columns.is_empty()).then(|| Strata::new(columns, models.iter().map(|m| (m.model.id.subject.as_str(), values(m)))))
}

/// Most sequences that the review warning names.
const NAMED_SEQUENCES: usize = 6;

/// Most sequences whose misplaced marks the warning describes.
const NAMED_BESIDE: usize = 3;

/// Warning about marks that miss the face in the picture, if there are any.
fn marks_beside(tracks: &[TrackQuality]) -> Option<String> {
    let found: Vec<&TrackQuality> = tracks.iter().filter(|t| !t.summary.beside.is_empty() && t.is_to_look_at()).collect();
    let said = found.iter().take(NAMED_BESIDE).map(|t| format!("{}: {}", t.id, t.summary.beside.join("; ")));
    let said = said.collect::<Vec<_>>().join("; ");
    let more = found.len().checked_sub(NAMED_BESIDE + 1).map(|more| format!("; and {} more", more + 1)).unwrap_or_default();
    let (count, all) = (found.len(), tracks.len());
    (count > 0).then(|| format!("the marks of {count} of {all} sequences do not fit the face found in the picture: {said}{more}"))
}

/// Warning with the sequences to review, if there are any.
fn look_again(tracks: &[TrackQuality]) -> Option<String> {
    let ids: Vec<String> = tracks.iter().filter(|t| t.is_to_look_at()).map(|t| t.id.to_string()).collect();
    let more = ids.len().checked_sub(NAMED_SEQUENCES + 1).map(|more| format!(" and {} more", more + 1)).unwrap_or_default();
    let named = ids.iter().take(NAMED_SEQUENCES).cloned().collect::<Vec<_>>().join(", ");
    let (count, all) = (ids.len(), tracks.len());
    (count > 0).then(|| format!("{count} of {all} sequences need a look; verdicts.csv has the reasons: {named}{more}"))
}

/// Number of frames of each track.
pub(super) fn lengths_of(tracks: &[TrackQuality]) -> impl Iterator<Item = (&SequenceId, usize)> {
    tracks.iter().map(|t| (&t.id, t.summary.frames))
}

/// Note about sequences with fewer frames than a model has, for which the nearest frame is used.
pub(super) fn too_short<'a>(lengths: impl Iterator<Item = (&'a SequenceId, usize)>, resample: Resample) -> Option<String> {
    let ids: Vec<String> = lengths.filter(|(_, frames)| *frames < FRAMES_PER_MODEL).map(|(id, _)| id.to_string()).collect();
    let (short, named) = (count(ids.len(), "sequence has", "sequences have"), listed(&ids, NAMED_SEQUENCES));
    (resample == Resample::Nearest && !ids.is_empty()).then(|| {
        format!(
            "{short} fewer than {FRAMES_PER_MODEL} frames, so some of the {FRAMES_PER_MODEL} frames of the model repeat (each takes the \
             nearest frame); --resample linear interpolates instead: {named}"
        )
    })
}

/// Converts models for grouping, without those that a person left out.
pub(super) fn labelled(models: Vec<AnalyzedModel>) -> Vec<LabelledModel> {
    let counted = models.into_iter().filter(|m| !m.is_left_out());
    counted.map(|m| LabelledModel { model: m.model, emotion: m.emotion, metadata: m.metadata }).collect()
}

/// Classes by emotion.
pub(super) type EmotionGroups<'a> = Vec<(String, Vec<(ClassLabel, Vec<&'a SequenceModel>)>)>;

/// Collects classes, which are sorted by emotion, by emotion.
pub(super) fn by_emotion(classes: Vec<(ClassLabel, Vec<&SequenceModel>)>) -> EmotionGroups<'_> {
    let mut emotions: EmotionGroups<'_> = Vec::new();
    for class in classes {
        match emotions.last_mut().filter(|(emotion, _)| *emotion == class.0.emotion) {
            Some((_, classes)) => classes.push(class),
            None => emotions.push((class.0.emotion.clone(), vec![class])),
        }
    }
    emotions
}
