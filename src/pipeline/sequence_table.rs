//! `sequences.csv`: one row per normalized sequence with its measurements at the apex, for statistics in other programs.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use super::{AmplitudeResults, AnalyzedModel};
use crate::{
    fap::{FapCatalog, FapNumber, measure_faps},
    features::{ACTION_UNITS, Course, fap_column, measured, unit_column},
    output::{OutputError, beside_ours, nine_digits, write_records},
    statistics::amplitude::AmplitudeRegion,
    track::TrackQuality,
    units::SequenceId,
    wireframe::Fapus,
};

/// Measurements of one sequence at its apex.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceRow {
    /// The sequence.
    pub id: SequenceId,
    /// Its emotion.
    pub emotion: String,
    /// Further columns of the manifest.
    pub metadata: BTreeMap<String, String>,
    /// FAPs of the normalized model, neither limited nor rounded, in the units of the standard; empty for a wireframe without Candide-3's
    /// nodes.
    pub faps: BTreeMap<FapNumber, f64>,
}

impl SequenceRow {
    /// Returns the row of a model.
    pub(super) fn of(model: &AnalyzedModel, fapus: &Fapus) -> Self {
        let frames = measure_faps(&model.model.model, fapus, FapCatalog::mpeg4()).unwrap_or_default();
        let value = |number: FapNumber| Some((number, frames.last()?.value(number)?));
        Self {
            id: model.model.id.clone(),
            emotion: model.emotion.clone(),
            metadata: model.metadata.clone(),
            faps: FapCatalog::mpeg4().rows().iter().filter_map(|row| value(row.number)).collect(),
        }
    }
}

/// Columns before the manifest's, and those after it except action units and FAPs.
const BEFORE: [&str; 3] = ["subject", "sequence", "emotion"];
const AFTER: [&str; 12] = [
    "id",
    "verdict",
    "frames",
    "expected_error_percent_es",
    "placement_error_percent_es",
    "amplitude_face",
    "amplitude_brows",
    "amplitude_eyes",
    "amplitude_mouth",
    "pose_yaw",
    "pose_pitch",
    "pose_roll",
];

/// Writes `sequences.csv`, sorted by subject and sequence.
pub(super) fn write_sequences(
    path: &Path,
    rows: &[SequenceRow],
    tracks: &[TrackQuality],
    courses: &BTreeMap<SequenceId, Course>,
    amplitudes: &AmplitudeResults,
) -> Result<blake3::Hash, OutputError> {
    let tracks: BTreeMap<&SequenceId, &TrackQuality> = tracks.iter().map(|t| (&t.id, t)).collect();
    let amplitudes: BTreeMap<(&str, &SequenceId), [Option<f64>; 4]> =
        amplitudes.sequences.iter().map(|s| ((s.emotion.as_str(), &s.id), s.values)).collect();
    let columns: BTreeSet<&String> = rows.iter().flat_map(|row| row.metadata.keys()).collect();
    let columns: Vec<&String> = columns.into_iter().collect();
    let faps: BTreeSet<FapNumber> = rows.iter().flat_map(|row| row.faps.keys().copied()).collect();
    let units = ACTION_UNITS.map(|unit| unit_column(unit.number, "r"));
    let named_faps: Vec<String> = faps.iter().map(|&fap| fap_column(fap)).collect();
    let ours: Vec<&str> = BEFORE.into_iter().chain(AFTER).chain(units.iter().chain(&named_faps).map(String::as_str)).collect();
    let named = beside_ours(&columns, |name| ours.contains(&name));
    let header: Vec<String> = BEFORE
        .map(str::to_owned)
        .into_iter()
        .chain(named)
        .chain(AFTER.map(str::to_owned))
        .chain(units.iter().cloned())
        .chain(named_faps.iter().cloned())
        .collect();
    let mut rows: Vec<&SequenceRow> = rows.iter().collect();
    rows.sort_by(|a, b| (&a.id, &a.emotion).cmp(&(&b.id, &b.emotion)));
    let number = |value: Option<f64>| value.map(nine_digits).unwrap_or_default();
    let measured = |value: Option<f64>| value.map(measured).unwrap_or_default();
    let cells = rows.into_iter().map(|row| {
        let summary = tracks.get(&row.id).map(|track| &track.summary);
        let percent = |px: Option<f64>| summary.and_then(|s| s.percent_of_eyes(px?));
        let course = courses.get(&row.id);
        let mut cells = vec![row.id.subject.clone(), row.id.sequence.clone(), row.emotion.clone()];
        cells.extend(columns.iter().map(|column| row.metadata.get(*column).cloned().unwrap_or_default()));
        cells.push(row.id.to_string());
        cells.push(summary.map(|s| s.verdict.name().to_owned()).unwrap_or_default());
        cells.push(summary.map(|s| s.frames.to_string()).unwrap_or_default());
        cells.extend(
            [summary.and_then(|s| s.expected_error_px), summary.and_then(|s| s.placement_error_px)].map(percent).map(measured),
        );
        cells.extend(
            amplitudes.get(&(row.emotion.as_str(), &row.id)).copied().unwrap_or([None; AmplitudeRegion::ALL.len()]).map(number),
        );
        let pose = course.and_then(|course| course.pose.last());
        cells.extend((0..3).map(|k| measured(pose.map(|pose| f64::from(pose[k])))));
        let intensities = course.and_then(|course| course.units.last());
        cells.extend((0..ACTION_UNITS.len()).map(|k| measured(intensities.map(|units| f64::from(units[k])))));
        cells.extend(faps.iter().map(|fap| measured(row.faps.get(fap).copied())));
        cells
    });
    write_records(path, header, cells)
}
