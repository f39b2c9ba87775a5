//! Writes the files of an analysis: representatives, FAP files, tables and the report.

use std::{collections::BTreeMap, path::Path};

use serde::Serialize;

use super::{
    Analysis, AnalysisError, AnalyzedClass, Failure, MADE_BY, NONE_LEVEL, SCHEMA_VERSION, Workbench,
    amplitudes::write_amplitudes,
    analysis::{lengths_of, too_short},
    covariates::{COVARIATE_TABLES, CovariateResult, covariate_models, write_covariates},
    groups::{GROUP_TABLES, write_groups},
    method::method_in_words,
    model_file::write_model,
    recognition::write_recognition,
    sequence_table::write_sequences,
    showcase,
    units::units_json,
    variation::{EmotionVariation, model_names, shown_bands, write_variations},
};
use crate::{
    clone::{NoSkin, SKIN_SUFFIX},
    fap::{self, ConvertError, FapCatalog, FapMotion, FapNumber, ValueFormat},
    output::{self, OutputError, beside_ours, nine_digits, write_records},
    report::{ApexFap, GroupsData, ReportData, VariationData, failed_id, mean_course_svg, render_html},
    statistics::{self, MedianSums, Representative, Weighting, dispersion::Dispersions},
    track::TrackQuality,
    units::{FaceUnit, SequenceId},
};

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
    dispersions: Dispersions,
    subjects: usize,
    weighting: Weighting,
    trim: statistics::TrimLevel,
    distances: BTreeMap<String, Option<f64>>,
    node_dispersion: &'a [f64],
    /// Values that were clamped to the standard's ranges in the FAP file.
    clamped: Vec<ClampedValue>,
    /// Number of people whose skin is averaged in the picture beside it.
    #[serde(skip_serializing_if = "Option::is_none")]
    skin_people: Option<usize>,
    /// The reason why there is no such picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    no_skin: Option<String>,
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

/// Callback with the name of a file, relative to the results folder, and its BLAKE3, called after the file is written.
pub(super) type Wrote<'a> = dyn FnMut(&str, blake3::Hash) -> Result<(), OutputError> + 'a;

/// Writes `representatives/`, `fap/`, the tables, `units.json` and `report.html`. Calls `wrote` with the path of every file, relative to
/// `out`, and its BLAKE3 after writing it.
///
/// # Errors
/// `AnalysisError` when a file cannot be written, and the errors of `wrote`.
pub fn write_analysis(
    analysis: &Analysis,
    out: &Path,
    title: &str,
    bench: &Workbench,
    mut wrote: impl FnMut(&str, String) -> Result<(), OutputError>,
) -> Result<(), AnalysisError> {
    let mut wrote = |name: &str, hash: blake3::Hash| wrote(name, hash.to_hex().to_string());
    for class in &analysis.classes {
        let [csv, json, fap, picture, skin_file] = class_files(&class.stem);
        wrote(&csv, write_model(&out.join(&csv), &class.representative.model)?)?;
        let value = representative_json(class, bench);
        wrote(&json, output::write_hashed(&out.join(&json), |writer| output::json_into(writer, &value))?)?;
        let profile = bench.options.fap.profile;
        let written = class.fap.for_profile(profile).map_err(ConvertError::from)?;
        wrote(&fap, fap::write_fap_as(&out.join(&fap), &written, profile, ValueFormat::Integer)?)?;
        if let Some(svg) = mean_course_svg(&class.representative, &analysis.courses) {
            wrote(&picture, output::write_hashed(&out.join(&picture), |writer| writer.write_all(svg.as_bytes()))?)?;
        }
        if let Ok(skin) = &class.skin {
            wrote(&skin_file, output::write_hashed(&out.join(&skin_file), |writer| skin.write(writer))?)?;
        }
    }
    let Analysis { sequences, tracks, courses, amplitudes, .. } = analysis;
    wrote("sequences.csv", write_sequences(&out.join("sequences.csv"), sequences, tracks, courses, amplitudes)?)?;
    wrote("statistics.csv", write_statistics(&out.join("statistics.csv"), analysis, bench)?)?;
    wrote("trimming.csv", write_trimming(&out.join("trimming.csv"), analysis, bench)?)?;
    wrote("failures.csv", write_failures(&out.join("failures.csv"), &analysis.failures)?)?;
    wrote("verdicts.csv", write_verdicts(&out.join("verdicts.csv"), &analysis.tracks)?)?;
    let html = report_html(analysis, title, bench)?;
    wrote("report.html", output::write_hashed(&out.join("report.html"), |writer| writer.write_all(html.as_bytes()))?)?;
    if let Some(comparisons) = &analysis.comparisons {
        write_groups(out, &analysis.classes, comparisons, bench, &mut wrote)?;
    }
    write_amplitudes(out, &analysis.amplitudes, bench, &mut wrote)?;
    if !bench.options.covariates.is_empty() {
        write_covariates(out, &analysis.covariates, bench, &mut wrote)?;
    }
    write_variations(out, &analysis.variations, bench, &mut wrote)?;
    if let Some(recognition) = &analysis.recognition {
        wrote("recognition.csv", write_recognition(&out.join("recognition.csv"), recognition, NONE_LEVEL)?)?;
    }
    let units = output::write_hashed(&out.join("units.json"), |writer| output::json_into(writer, &units_json()))?;
    wrote("units.json", units)?;
    Ok(())
}

/// Files that [`write_analysis`] writes for every analysis.
pub const ANALYSIS_TABLES: [&str; 11] = [
    "sequences.csv",
    "statistics.csv",
    "trimming.csv",
    "failures.csv",
    "verdicts.csv",
    "report.html",
    "amplitudes.csv",
    "units.json",
    "variation.csv",
    "variation_scores.csv",
    "bands.csv",
];

/// Names of the files that [`write_analysis`] will write. The caller checks first that they are free.
pub fn analysis_files(analysis: &Analysis, bench: &Workbench) -> Vec<String> {
    let of_class = |class: &AnalyzedClass| {
        let files = class_files(&class.stem);
        // The skin is the last file.
        let count = files.len() - usize::from(class.skin.is_err());
        files.into_iter().take(count)
    };
    let of_emotion = |v: &EmotionVariation| v.outcome.is_ok().then(|| model_names(&v.stem)).into_iter().flatten();
    let of_groups = analysis.comparisons.iter().flat_map(|_| GROUP_TABLES);
    let of_amplitudes = (!bench.options.by.is_empty()).then_some("amplitude_comparisons.csv");
    let of_labels = analysis.recognition.is_some().then_some("recognition.csv");
    let of_numbers = COVARIATE_TABLES.into_iter().filter(|_| !bench.options.covariates.is_empty());
    let tables =
        ANALYSIS_TABLES.into_iter().chain(of_groups).chain(of_amplitudes).chain(of_numbers).chain(of_labels).map(str::to_owned);
    let along = analysis.covariates.iter().filter(|c| c.outcome.is_ok()).flat_map(covariate_models);
    let of_classes = analysis.classes.iter().flat_map(of_class);
    of_classes.chain(along).chain(analysis.variations.iter().flat_map(of_emotion)).chain(tables).collect()
}

/// Names of a class's files that [`write_analysis`] writes besides the tables of [`table_names`].
pub(super) fn class_files(stem: &str) -> [String; 5] {
    let (model, about) = (format!("representatives/{stem}.csv"), format!("representatives/{stem}.json"));
    let skin = format!("representatives/{stem}{SKIN_SUFFIX}");
    [model, about, format!("fap/{stem}.fap"), format!("features/{stem}.svg"), skin]
}

/// Names of all possible tables and of the report.
pub(super) fn table_names() -> impl Iterator<Item = &'static str> {
    ANALYSIS_TABLES.into_iter().chain(GROUP_TABLES).chain(COVARIATE_TABLES).chain([
        "models.parquet",
        "amplitude_comparisons.csv",
        "recognition.csv",
    ])
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
        dispersions: r.dispersions,
        subjects: class.subjects,
        weighting: bench.options.statistics.weighting,
        trim: bench.options.statistics.trim,
        distances: r.sequences.iter().zip(&r.distances).map(|(id, d)| (id.to_string(), *d)).collect(),
        node_dispersion: &r.node_dispersion,
        clamped: class
            .clamped
            .iter()
            .map(|c| ClampedValue { fap: c.fap.get(), key_frame: c.frame, measured: c.value, written: c.limit })
            .collect(),
        skin_people: class.skin.as_ref().ok().map(|skin| skin.people),
        // `analyze` has no pictures, so the reason would be meaningless.
        no_skin: class.skin.as_ref().err().filter(|why| **why != NoSkin::NotCollected).map(ToString::to_string),
    }
}

/// Writes a CSV file whose last columns are those grouped by.
fn write_table(
    path: &Path,
    header: &[&str],
    by: &[String],
    rows: impl IntoIterator<Item = Vec<String>>,
) -> Result<blake3::Hash, OutputError> {
    let grouped = beside_ours(by, |name| header.contains(&name));
    write_records(path, header.iter().map(|&name| name.to_owned()).chain(grouped), rows)
}

/// Values of the columns grouped by; empty for a class of all people.
fn group_values(class: &AnalyzedClass, by: &[String]) -> impl Iterator<Item = String> {
    by.iter().map(|column| class.representative.label.group.get(column).cloned().unwrap_or_default())
}

fn write_statistics(path: &Path, analysis: &Analysis, bench: &Workbench) -> Result<blake3::Hash, OutputError> {
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
        "subjects",
        "dispersion_literal",
        "dispersion_literal_untrimmed",
        "dispersion_field",
        "dispersion_field_untrimmed",
        "weighting",
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
            class.subjects.to_string(),
            optional(r.dispersions.literal),
            optional(r.dispersions.literal_untrimmed),
            optional(r.dispersions.field),
            optional(r.dispersions.field_untrimmed),
            match bench.options.statistics.weighting {
                Weighting::Person => "person",
                Weighting::Sequence => "sequence",
            }
            .to_owned(),
        ];
        row.extend(group_values(class, by));
        row
    });
    write_table(path, &header, by, rows)
}

fn write_trimming(path: &Path, analysis: &Analysis, bench: &Workbench) -> Result<blake3::Hash, OutputError> {
    let by = &bench.options.by;
    let rows = analysis.classes.iter().flat_map(|class| {
        class.representative.trimming.iter().map(|row| {
            let mut fields = vec![
                class.representative.label.emotion.clone(),
                row.field.to_string(),
                row.id.to_string(),
                nine_digits(row.distance),
                row.dropped.to_string(),
                row.id.to_string(),
                row.id.subject.clone(),
            ];
            fields.extend(group_values(class, by));
            fields
        })
    });
    write_table(path, &["emotion", "frame", "sequence", "distance", "dropped", "id", "subject"], by, rows)
}

/// Writes `failures.csv`, with its header even if there are no failures.
///
/// # Errors
/// [`OutputError`].
pub(super) fn write_failures(path: &Path, failures: &[Failure]) -> Result<blake3::Hash, OutputError> {
    let rows = failures.iter().map(|f| {
        let id = failed_id(&f.subject, &f.sequence).map(|id| id.to_string()).unwrap_or_default();
        vec![f.subject.clone(), f.sequence.clone(), f.stage.to_string(), f.reason.clone(), id]
    });
    write_table(path, &["subject", "sequence", "stage", "reason", "id"], &[], rows)
}

/// Writes `verdicts.csv`: one row per tracked sequence.
fn write_verdicts(path: &Path, tracks: &[TrackQuality]) -> Result<blake3::Hash, OutputError> {
    let rows = tracks.iter().map(|t| {
        let s = &t.summary;
        let expected = s.expected_error_px;
        let percent = |px: Option<f64>| s.percent_of_eyes(px?);
        let number = |value: Option<f64>| value.map(nine_digits).unwrap_or_default();
        let SequenceId { subject, sequence } = t.id.clone();
        let verdict = s.verdict.name().to_owned();
        vec![
            subject,
            sequence,
            t.emotion.clone(),
            verdict,
            number(expected),
            number(percent(expected)),
            s.reasons.join("; "),
            t.id.to_string(),
            number(s.placement_error_px),
            number(percent(s.placement_error_px)),
            t.look.map(|look| look.name().to_owned()).unwrap_or_default(),
            t.content.clone(),
        ]
    });
    let header = [
        "subject",
        "sequence",
        "emotion",
        "verdict",
        "expected_error_px",
        "expected_error_percent_es",
        "reasons",
        "id",
        "placement_error_px",
        "placement_error_percent_es",
        "look",
        "content",
    ];
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
                is_angle: row.motion.is_some_and(FapMotion::is_angle),
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
        courses: &analysis.courses,
        failures: &analysis.failures,
        same: &analysis.same,
        too_short: too_short(lengths_of(&analysis.tracks), bench.options.normalize.resample),
        wireframe: &bench.wireframe,
        tables: &bench.tables,
        fapus: bench.normalizer()?.canonical().fapus,
        apex_faps: analysis.classes.iter().map(apex).collect(),
        player: showcase::player(&analysis.classes, bench)?,
        face: showcase::face_name(bench),
        stems: analysis.classes.iter().map(|c| c.stem.clone()).collect(),
        files: analysis_files(analysis, bench),
        tracked_here: analysis.tracked_here,
        variations: analysis.classes.iter().map(|class| variation_data(analysis, class)).collect(),
        covariates: analysis.covariates.iter().map(CovariateResult::shown).collect(),
        compare: bench.options.groups.compare,
        strata: &bench.options.strata,
        groups: analysis.comparisons.as_ref().map(|comparisons| GroupsData {
            comparisons,
            amplitudes: &analysis.amplitudes.comparisons,
            options: &bench.options.groups,
            classes: analysis.classes.iter().map(|c| (c.subjects, c.interval)).collect(),
        }),
    })?;
    Ok(html)
}

/// Report data on the variation among the people of a whole emotion.
fn variation_data<'a>(analysis: &'a Analysis, class: &AnalyzedClass) -> Option<VariationData<'a>> {
    let label = &class.representative.label;
    let of = analysis.variations.iter().find(|v| label.group.is_empty() && v.emotion == label.emotion)?;
    Some(VariationData { variation: of.outcome.as_ref().ok(), bands: shown_bands(of) })
}

/// The options as shown in the report; those of fit and tracker only if the sequences were tracked in this run.
fn option_rows(bench: &Workbench, tracked_here: bool) -> Vec<(String, String)> {
    let o = &bench.options;
    let word = |value: serde_json::Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let json = |value: serde_json::Result<serde_json::Value>| value.map(word).unwrap_or_default();
    let tracking = [
        ("Method", method_in_words(o)),
        ("Shape prior", json(serde_json::to_value(&o.fit.prior))),
        ("Spring force on marks (over stiffness)", o.fit.force.to_string()),
        ("Forces on tracked nodes", json(serde_json::to_value(o.track.forces))),
        (
            "Lip probes, rigid eyes, even light, lids read, lips read, lost faces located, deformed after every step",
            format!(
                "{}, {}, {}, {}, {}, {}, {}",
                o.track.lip_probes,
                o.track.rigid_eyes,
                o.track.even_light,
                o.track.read_lids,
                o.track.read_lips,
                o.track.locate_lost,
                o.track.deform
            ),
        ),
        ("KLT window (over eye distance)", o.track.window.to_string()),
        ("KLT pyramid levels", o.track.levels.to_string()),
        ("Forward-backward limit (over eye distance)", o.track.forward_backward.to_string()),
        ("Extreme displacement (robust standard deviations)", o.track.extreme.to_string()),
        ("Spring force on tracked nodes (over stiffness)", o.track.force.to_string()),
        ("Weight of the mismatch relative to gradients", o.track.mismatch.to_string()),
        ("Gain of the alignment with the neutral frame", o.track.align.gain.to_string()),
        ("Stiffness between inner and outer corners of the mouth", o.track.align.corners.to_string()),
        ("Landmarks used as marks", json(serde_json::to_value(&o.marks))),
        ("Marks checked against the face found in the picture", (!o.unchecked_marks).to_string()),
        ("Nodes without a mark found in the picture", o.fit.read_unmarked.to_string()),
        ("Landmarks preferred to images", o.landmarks.prefer.to_string()),
        ("Smallest confidence of landmarks", o.landmarks.least_confidence.to_string()),
    ];
    let tests = [
        ("Permutations per test", o.groups.compare.permutations.to_string()),
        ("Most people of a group in a test", o.groups.compare.people.to_string()),
        ("Draws for the interval of a dispersion", o.groups.bootstrap.to_string()),
        ("Significance level after correction for all tests", o.groups.compare.significance.to_string()),
        ("Equivalence margin of amplitudes (times the median)", o.groups.amplitude.equivalence.to_string()),
        ("Power for the number of people needed", o.groups.amplitude.power.to_string()),
        ("Seed", o.groups.compare.seed.to_string()),
    ];
    let analysis = [
        ("Program", MADE_BY.to_owned()),
        ("Head motion removed", json(serde_json::to_value(o.normalize.pose))),
        ("Resampling to 5 frames", json(serde_json::to_value(o.normalize.resample))),
        ("Size normalization", json(serde_json::to_value(o.normalize.size))),
        ("IRISD0 measured from", json(serde_json::to_value(o.normalize.irisd))),
        ("Trimming alpha", o.statistics.alpha.to_string()),
        ("Trimmed", format!("at {} level", json(serde_json::to_value(o.statistics.trim)))),
        ("Generalized median", json(serde_json::to_value(o.statistics.median))),
        ("Equal weight for every", json(serde_json::to_value(o.statistics.weighting))),
        ("FAP frames between key frames", o.fap.between.to_string()),
        ("FAP frame rate (Hz)", o.fap.fps.to_string()),
        ("Labels exchanged within", if o.strata.is_empty() { "all people".to_owned() } else { o.strata.join(", ") }),
        ("Covariates", if o.covariates.is_empty() { "none".to_owned() } else { o.covariates.join(", ") }),
        ("Grouped by", if o.by.is_empty() { "emotion".to_owned() } else { format!("emotion, {}", o.by.join(", ")) }),
    ];
    let rows = tracking
        .into_iter()
        .filter(|_| tracked_here)
        .chain(analysis)
        .chain(tests.into_iter().filter(|_| !o.by.is_empty() || !o.covariates.is_empty()));
    rows.map(|(label, value)| (label.to_owned(), value)).collect()
}
