//! From normalized models to representatives, statistics, FAP files and the report; shared by `run` and `analyze`.

use std::{
    collections::{BTreeMap, BTreeSet},
    io,
    path::{Path, PathBuf},
};

use rayon::prelude::*;
use serde::Serialize;

use super::{
    Comparisons, Failure, MADE_BY, ReportFace, SCHEMA_VERSION, Workbench,
    classes::{class, unique_stem, warnings},
    files::file_blake3,
    groups::write_groups,
    parts::EmotionPart,
    showcase::films,
};
use crate::{
    clone::CloneError,
    fap::{self, Clamped, ConvertError, FapCatalog, FapNumber, FapSequence, FapWriteError, Motion},
    model::{DynamicExpressionModel, FrameExpressionModel, ModelError},
    output::{self, OutputError, nine_digits, write_atomic},
    report::{ApexFap, GroupsData, ReportData, render_html},
    statistics::{
        self, ClassLabel, GroupError, LabelledModel, MedianSums, Representative, SequenceModel, StatisticsError,
        bootstrap::DispersionInterval, group_models,
    },
    track::{TrackQuality, Verdict},
    units::{FaceUnit, SequenceId},
    wireframe::FapusError,
};

/// A normalized model with everything that the statistics group by.
#[derive(Clone, Debug)]
pub struct AnalyzedModel {
    /// The model and its sequence.
    pub model: SequenceModel,
    /// Emotion label.
    pub emotion: String,
    /// Further columns of the manifest.
    pub metadata: BTreeMap<String, String>,
    /// How well it was tracked, where known.
    pub quality: Option<TrackQuality>,
}

/// Why no statistics came out.
#[derive(Debug, thiserror::Error)]
pub enum AnalysisError {
    /// Statistics of a class.
    #[error(transparent)]
    Statistics(#[from] StatisticsError),
    /// The canonical neutral has no FAPUs.
    #[error(transparent)]
    Fapus(#[from] FapusError),
    /// A model is not one.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A FAP file can not be written.
    #[error(transparent)]
    Fap(#[from] FapWriteError),
    /// A file can not be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The report does not render.
    #[error("the report does not render: {0}")]
    Report(#[from] minijinja::Error),
    /// A column to group by that no sequence has.
    #[error(transparent)]
    Group(#[from] GroupError),
    /// The representatives can not be shown on the report's face.
    #[error("the face of the report: {0}")]
    Face(#[from] CloneError),
    /// A representative has no FAPs.
    #[error(transparent)]
    Convert(#[from] ConvertError),
    /// A columnar file of models.
    #[error(transparent)]
    Columnar(#[from] crate::columnar::ColumnarError),
    /// Groups of models that do not fit into memory.
    #[error(
        "the models take about {needed} MB, more than the {allowed} MB of --memory, in which groups can not be compared; allow more, or leave --by out"
    )]
    GroupsNeedMemory {
        /// Megabytes of all models.
        needed: u64,
        /// Megabytes allowed.
        allowed: u64,
    },
}

/// One representative, with its FAPs.
#[derive(Clone, Debug)]
pub struct AnalyzedClass {
    /// The representative.
    pub representative: Representative,
    /// Stem of its files: the emotion, followed by `_COLUMN-VALUE` for every column grouped by.
    pub stem: String,
    /// Its FAPs, key frames and the frames between them.
    pub fap: FapSequence,
    /// Values that the standard's ranges clamped.
    pub clamped: Vec<Clamped>,
    /// People behind it.
    pub subjects: usize,
    /// Bootstrap interval of its dispersion; only where there are groups, and people enough.
    pub interval: Option<DispersionInterval>,
}

/// Everything that statistics make of a set of models.
#[derive(Clone, Debug)]
pub struct Analysis {
    /// Classes by emotion, then by group.
    pub classes: Vec<AnalyzedClass>,
    /// Tests between groups; `None` when nothing was grouped.
    pub comparisons: Option<Comparisons>,
    /// How well each sequence was tracked, by id.
    pub tracks: Vec<TrackQuality>,
    /// What failed before.
    pub failures: Vec<Failure>,
    /// Warnings that a person should read.
    pub warnings: Vec<String>,
    /// Whether the sequences were tracked with the options at hand, so that the report may state them.
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
/// [`AnalysisError`] when a column to group by does not exist or the options are out of range.
pub fn analyze(models: Vec<AnalyzedModel>, failures: Vec<Failure>, bench: &Workbench) -> Result<Analysis, AnalysisError> {
    analyze_with(models, failures, bench, None)
}

/// [`analyze`], with the parts of emotions that were computed before into the output folder `parts_of`, where they fit.
pub(super) fn analyze_with(
    models: Vec<AnalyzedModel>,
    failures: Vec<Failure>,
    bench: &Workbench,
    parts_of: Option<&Path>,
) -> Result<Analysis, AnalysisError> {
    let options = &bench.options;
    let mut tracks: Vec<TrackQuality> = models.iter().filter_map(|m| m.quality.clone()).collect();
    tracks.sort_by(|a, b| a.id.cmp(&b.id));
    let grouped = labelled(models);
    let emotions = by_emotion(group_models(&grouped, &options.by)?);
    let part = |(emotion, groups): &(String, Vec<(ClassLabel, Vec<&SequenceModel>)>)| {
        let known = parts_of.and_then(|out| EmotionPart::read(out, emotion, groups, bench));
        known.map_or_else(|| EmotionPart::compute(emotion, groups, bench), Ok)
    };
    let parts = emotions.par_iter().map(part).collect::<Result<Vec<_>, AnalysisError>>()?;
    let fapus = bench.normalizer()?.canonical().fapus;
    let mut stems = BTreeSet::new();
    let (mut classes, mut comparisons) = (Vec::new(), Vec::new());
    for part in parts {
        for c in part.classes {
            let stem = unique_stem(&c.representative.label, &mut stems);
            classes.push(class(c.representative, stem, c.subjects, c.interval, &fapus, bench)?);
        }
        comparisons.push(part.comparisons);
    }
    let mut warnings: Vec<String> = look_again(&tracks).into_iter().chain(warnings(&classes)).collect();
    let comparisons = (!options.by.is_empty()).then(|| Comparisons::together(comparisons));
    warnings.extend(comparisons.iter().flat_map(Comparisons::warnings));
    Ok(Analysis { classes, comparisons, tracks, failures, warnings, tracked_here: false })
}

/// Sequences named in the warning to look at some again.
const NAMED_SEQUENCES: usize = 6;

/// The warning to look at sequences again, if there are such.
fn look_again(tracks: &[TrackQuality]) -> Option<String> {
    let ids: Vec<String> = tracks.iter().filter(|t| t.summary.verdict == Verdict::LookAgain).map(|t| t.id.to_string()).collect();
    let more = ids.len().checked_sub(NAMED_SEQUENCES + 1).map(|more| format!(" and {} more", more + 1)).unwrap_or_default();
    let named = ids.iter().take(NAMED_SEQUENCES).cloned().collect::<Vec<_>>().join(", ");
    let (count, all) = (ids.len(), tracks.len());
    (count > 0)
        .then(|| format!("{count} of {all} sequences should be looked at again, the reasons are in verdicts.csv: {named}{more}"))
}

/// Models as the groups want them.
pub(super) fn labelled(models: Vec<AnalyzedModel>) -> Vec<LabelledModel> {
    models.into_iter().map(|m| LabelledModel { model: m.model, emotion: m.emotion, metadata: m.metadata }).collect()
}

/// Classes by emotion.
pub(super) type EmotionGroups<'a> = Vec<(String, Vec<(ClassLabel, Vec<&'a SequenceModel>)>)>;

/// Classes, which are sorted by emotion, by emotion.
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

/// Writes a normalized model or a representative: `frame,node,x,y`, face units, frames from 0.
///
/// # Errors
/// [`OutputError`].
pub fn write_model(path: &Path, model: &DynamicExpressionModel<FaceUnit>) -> Result<(), OutputError> {
    write_atomic(path, |out| {
        writeln!(out, "frame,node,x,y")?;
        for (m, frame) in model.frames().iter().enumerate() {
            for (k, point) in frame.nodes().iter().enumerate() {
                writeln!(out, "{m},{k},{},{}", nine_digits(point.x), nine_digits(point.y))?;
            }
        }
        Ok(())
    })
}

/// A model file that does not read.
#[derive(Debug, thiserror::Error)]
pub enum ModelFileError {
    /// It does not read as a table of `frame,node,x,y`.
    #[error(transparent)]
    Table(#[from] crate::track::TrackFileError),
    /// Its frames do not make a model.
    #[error("{}: {source}", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// Why.
        source: ModelError,
    },
}

/// Reads a normalized model or a representative.
///
/// # Errors
/// [`ModelFileError`] with the line.
pub fn read_model(path: &Path) -> Result<DynamicExpressionModel<FaceUnit>, ModelFileError> {
    let frames = crate::track::read_track(path)?;
    let frame = |f: crate::track::TrackedFrame| FrameExpressionModel::new(f.nodes.iter().map(|n| n.position).collect());
    let model = DynamicExpressionModel::new(frames.into_iter().map(frame).collect());
    model.map_err(|source| ModelFileError::Model { path: path.to_owned(), source })
}

/// The JSON beside a representative.
#[derive(Serialize)]
struct RepresentativeJson<'a> {
    schema_version: u32,
    made_by: &'a str,
    unit: &'a str,
    emotion: &'a str,
    group: &'a BTreeMap<String, String>,
    /// N''.
    sequences: Vec<String>,
    alpha: f64,
    median: statistics::MedianKind,
    #[serde(skip_serializing_if = "Option::is_none")]
    trimming_certificate: Option<&'a statistics::scale::Certificate>,
    trimmed: Vec<Trimmed>,
    sums: MedianSums,
    dispersion: Option<f64>,
    dispersion_untrimmed: Option<f64>,
    distances: BTreeMap<String, Option<f64>>,
    node_dispersion: &'a [f64],
    /// Values that the standard's ranges changed in the FAP file.
    clamped: Vec<ClampedValue>,
}

#[derive(Serialize)]
struct ClampedValue {
    fap: u8,
    key_frame: usize,
    measured: f64,
    written: i32,
}

#[derive(Serialize)]
struct Trimmed {
    frame: usize,
    sequence: String,
    distance: f64,
}

/// Writes `representatives/`, `fap/`, `statistics.csv`, `trimming.csv`, `failures.csv`, `verdicts.csv` and `report.html`; returns the BLAKE3 of every
/// file by its path relative to `out`.
///
/// # Errors
/// [`AnalysisError`] when a file can not be written.
pub fn write_analysis(
    analysis: &Analysis,
    out: &Path,
    title: &str,
    bench: &Workbench,
) -> Result<BTreeMap<String, String>, AnalysisError> {
    let mut files = Vec::new();
    for class in &analysis.classes {
        let (csv, json, fap) = (
            format!("representatives/{}.csv", class.stem),
            format!("representatives/{}.json", class.stem),
            format!("fap/{}.fap", class.stem),
        );
        write_model(&out.join(&csv), &class.representative.model)?;
        output::write_json(&out.join(&json), &representative_json(class, bench))?;
        fap::write_fap(&out.join(&fap), &class.fap)?;
        files.extend([csv, json, fap]);
    }
    write_statistics(&out.join("statistics.csv"), analysis, bench)?;
    write_trimming(&out.join("trimming.csv"), analysis, bench)?;
    write_failures(&out.join("failures.csv"), &analysis.failures)?;
    write_verdicts(&out.join("verdicts.csv"), &analysis.tracks)?;
    let html = report_html(analysis, title, bench)?;
    output::write_bytes(&out.join("report.html"), html.as_bytes())?;
    if let Some(comparisons) = &analysis.comparisons {
        files.extend(write_groups(out, &analysis.classes, comparisons, &bench.wireframe, &bench.options.by)?);
    }
    files.extend(["statistics.csv", "trimming.csv", "failures.csv", "verdicts.csv", "report.html"].map(str::to_owned));
    Ok(files.into_iter().filter_map(|file| file_blake3(&out.join(&file)).map(|hash| (file, hash))).collect())
}

fn representative_json<'a>(class: &'a AnalyzedClass, bench: &Workbench) -> RepresentativeJson<'a> {
    let r = &class.representative;
    let dropped = r.trimming.iter().filter(|row| row.dropped);
    RepresentativeJson {
        schema_version: SCHEMA_VERSION,
        made_by: MADE_BY,
        unit: <FaceUnit as crate::units::Unit>::NAME,
        emotion: &r.label.emotion,
        group: &r.label.group,
        sequences: r.sequences.iter().map(SequenceId::to_string).collect(),
        alpha: bench.options.statistics.alpha,
        median: r.median,
        trimming_certificate: r.certificate.as_ref(),
        trimmed: dropped.map(|row| Trimmed { frame: row.field, sequence: row.id.to_string(), distance: row.distance }).collect(),
        sums: r.sums,
        dispersion: r.dispersion,
        dispersion_untrimmed: r.dispersion_untrimmed,
        distances: r.sequences.iter().zip(&r.distances).map(|(id, d)| (id.to_string(), *d)).collect(),
        node_dispersion: &r.node_dispersion,
        clamped: class
            .clamped
            .iter()
            .map(|c| ClampedValue { fap: c.fap.get(), key_frame: c.frame, measured: c.value, written: c.limit })
            .collect(),
    }
}

/// A CSV whose header ends with the columns grouped by.
fn write_table(
    path: &Path,
    header: &[&str],
    by: &[String],
    rows: impl IntoIterator<Item = Vec<String>>,
) -> Result<(), OutputError> {
    write_atomic(path, |out| {
        let mut csv = csv::Writer::from_writer(out);
        // A column grouped by keeps its name unless the table has one of that name already.
        let grouped = by.iter().map(|name| if header.contains(&name.as_str()) { format!("by_{name}") } else { name.clone() });
        let names: Vec<String> = header.iter().map(|&name| name.to_owned()).chain(grouped).collect();
        csv.write_record(&names).map_err(io::Error::from)?;
        for row in rows {
            csv.write_record(&row).map_err(io::Error::from)?;
        }
        csv.flush()
    })
}

/// Values of the columns grouped by; empty for a class over all people.
fn group_values(class: &AnalyzedClass, by: &[String]) -> impl Iterator<Item = String> {
    by.iter().map(|column| class.representative.label.group.get(column).cloned().unwrap_or_default())
}

fn write_statistics(path: &Path, analysis: &Analysis, bench: &Workbench) -> Result<(), OutputError> {
    let header = [
        "emotion",
        "sequences",
        "dispersion",
        "dispersion_untrimmed",
        "sum_of_distances",
        "gap",
        "sum_of_distances_exact",
        "lower_bound",
        "certificate_gap",
    ];
    let by = &bench.options.by;
    let optional = |value: Option<f64>| value.map(nine_digits).unwrap_or_default();
    let rows = analysis.classes.iter().map(|class| {
        let r = &class.representative;
        let mut row = vec![
            r.label.emotion.clone(),
            r.sequences.len().to_string(),
            optional(r.dispersion),
            optional(r.dispersion_untrimmed),
            nine_digits(r.sums.greedy),
            nine_digits(r.sums.greedy_gap),
            nine_digits(r.sums.exact),
            nine_digits(r.sums.lower_bound),
            nine_digits(r.sums.certificate_gap),
        ];
        row.extend(group_values(class, by));
        row
    });
    write_table(path, &header, by, rows)
}

fn write_trimming(path: &Path, analysis: &Analysis, bench: &Workbench) -> Result<(), OutputError> {
    let by = &bench.options.by;
    let rows = analysis.classes.iter().flat_map(|class| {
        class.representative.trimming.iter().map(|row| {
            let mut fields = vec![
                class.representative.label.emotion.clone(),
                row.field.to_string(),
                row.id.to_string(),
                nine_digits(row.distance),
                row.dropped.to_string(),
            ];
            fields.extend(group_values(class, by));
            fields
        })
    });
    write_table(path, &["emotion", "frame", "sequence", "distance", "dropped"], by, rows)
}

/// Writes `failures.csv`; the header stands there even without failures.
///
/// # Errors
/// [`OutputError`].
pub(super) fn write_failures(path: &Path, failures: &[Failure]) -> Result<(), OutputError> {
    let rows = failures.iter().map(|f| vec![f.subject.clone(), f.sequence.clone(), f.stage.to_string(), f.reason.clone()]);
    write_table(path, &["subject", "sequence", "stage", "reason"], &[], rows)
}

/// Writes `verdicts.csv`: a row for every tracked sequence.
fn write_verdicts(path: &Path, tracks: &[TrackQuality]) -> Result<(), OutputError> {
    let rows = tracks.iter().map(|t| {
        let s = &t.summary;
        let expected = s.expected_error_px;
        let percent = expected.filter(|_| s.eye_distance_px > 0.0).map(|px| 100.0 * px / s.eye_distance_px);
        let number = |value: Option<f64>| value.map(nine_digits).unwrap_or_default();
        let SequenceId { subject, sequence } = t.id.clone();
        let verdict = s.verdict.name().to_owned();
        vec![subject, sequence, t.emotion.clone(), verdict, number(expected), number(percent), s.reasons.join("; ")]
    });
    let header = ["subject", "sequence", "emotion", "verdict", "expected_error_px", "expected_error_percent_es", "reasons"];
    write_table(path, &header, &[], rows)
}

fn report_html(analysis: &Analysis, title: &str, bench: &Workbench) -> Result<String, AnalysisError> {
    let representatives: Vec<Representative> = analysis.classes.iter().map(|c| c.representative.clone()).collect();
    let catalog = FapCatalog::mpeg4();
    let apex = |class: &AnalyzedClass| {
        let frame = class.fap.frames.last();
        let value = |fap: FapNumber| {
            let row = catalog.row(fap);
            Some(ApexFap {
                number: fap.get(),
                name: row.name.clone(),
                unit: row.unit_name(),
                is_angle: row.motion.is_some_and(Motion::is_angle),
                value: frame?.value(fap)?.round() as i32,
            })
        };
        class.fap.set_faps().into_iter().filter_map(value).collect::<Vec<_>>()
    };
    let html = render_html(&ReportData {
        title: title.to_owned(),
        options: option_rows(bench, analysis.tracked_here),
        representatives: &representatives,
        tracks: &analysis.tracks,
        failures: &analysis.failures,
        wireframe: &bench.wireframe,
        tables: &bench.tables,
        fapus: bench.normalizer()?.canonical().fapus,
        apex_faps: analysis.classes.iter().map(apex).collect(),
        films: films(&representatives, bench)?,
        face: match &bench.options.report_face {
            ReportFace::Simulated => "a simulated person".to_owned(),
            ReportFace::Photograph { image, .. } => image.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        },
        groups: analysis.comparisons.as_ref().map(|comparisons| GroupsData {
            comparisons,
            options: &bench.options.groups,
            classes: analysis.classes.iter().map(|c| (c.subjects, c.interval)).collect(),
        }),
    })?;
    Ok(html)
}

/// The options as a reader of the report wants them; those of fit and tracker only when the sequences were tracked with them.
fn option_rows(bench: &Workbench, tracked_here: bool) -> Vec<(String, String)> {
    let o = &bench.options;
    let word = |value: serde_json::Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let json = |value: serde_json::Result<serde_json::Value>| value.map(word).unwrap_or_default();
    let tracking = [
        ("Shape prior", json(serde_json::to_value(&o.fit.prior))),
        ("Spring force on marks (over stiffness)", o.fit.force.to_string()),
        ("KLT window (over eye distance)", o.track.window.to_string()),
        ("KLT pyramid levels", o.track.levels.to_string()),
        ("Forward-backward limit (over eye distance)", o.track.forward_backward.to_string()),
        ("Extreme displacement (robust standard deviations)", o.track.extreme.to_string()),
        ("Spring force on tracked nodes (over stiffness)", o.track.force.to_string()),
        ("Weight of the mismatch against gradients", o.track.mismatch.to_string()),
    ];
    let analysis = [
        ("Resampling to 5 frames", json(serde_json::to_value(o.normalize.resample))),
        ("Size normalization", json(serde_json::to_value(o.normalize.size))),
        ("Trimming alpha", o.statistics.alpha.to_string()),
        ("Generalized median", json(serde_json::to_value(o.statistics.median))),
        ("FAP frames between key frames", o.fap.between.to_string()),
        ("FAP frame rate (Hz)", o.fap.fps.to_string()),
        ("Grouped by", if o.by.is_empty() { "emotion".to_owned() } else { format!("emotion, {}", o.by.join(", ")) }),
    ];
    let rows = tracking.into_iter().filter(|_| tracked_here).chain(analysis);
    rows.map(|(label, value)| (label.to_owned(), value)).collect()
}
