//! Feature files: CSV with one row per frame, and JSON with the units.

use std::{collections::BTreeMap, path::Path};

use super::{ACTION_UNITS, ColumnsBeside, FrameFeatures, in_time, openface};
use crate::{
    fap::{FapCatalog, FapNumber},
    output::{self, OutputError, nine_digits, write_records},
    sequence::Clock,
};

/// Returns the units of the columns.
pub fn features_units() -> BTreeMap<String, String> {
    [
        ("frame", "number of the frame"),
        ("timestamp", "s from the first row; empty where the frame rate is not known"),
        ("confidence", "share of the nodes that were seen, 0 to 1"),
        ("success", "1, or 0 where `reason` says why the row is not to be used"),
        (
            "pose_yaw, pose_pitch, pose_roll",
            "degrees; positive: to the subject's left, down, towards the subject's right shoulder",
        ),
        ("pose_x, pose_y", "px, middle of the head"),
        ("eye_distance", "px; of the mean head at the size of this one, as if it looked into the camera: not how far this person's eyes are apart"),
        ("eye_opening_*", "over the opening in the neutral frame"),
        ("mouth_opening", "distance of the inner lips over MNS0"),
        ("iris_*", "offset from neutral over IRISD0 of the iris boxes, x to the subject's left, y up; empty where irises were not tracked"),
        ("AU.._r, AU.._c, AU.._e", "intensity 0 to 5, presence 0 or 1, expected error of the intensity (half are further off)"),
        ("AU.._left, AU.._right", "intensity 0 to 5 of the subject's left and right side; AU.._r is their mean"),
        ("FAP.._NAME", "FAP units of the standard, 19 to 22 in openings of the own lids / 1024; 48 to 50 in 1e-5 rad"),
    ]
    .into_iter()
    .map(|(k, v)| (k.to_owned(), v.to_owned()))
    .collect()
}

/// Returns the column name of an action unit: its intensity (`r`, and `left` or `right`), presence (`c`) or expected error (`e`).
pub fn unit_column(number: u8, suffix: &str) -> String {
    format!("AU{number:02}_{suffix}")
}

/// Returns the column name of a FAP.
pub fn fap_column(fap: FapNumber) -> String {
    format!("FAP{:02}_{}", fap.get(), FapCatalog::mpeg4().row(fap).name)
}

/// Formats a measured value with four decimals, more than its accuracy.
pub fn measured(value: f64) -> String {
    nine_digits((value * 1e4).round() / 1e4)
}

/// Returns header and rows of a feature file, frames by ascending number.
pub fn features_csv(features: &[FrameFeatures], clock: &Clock) -> (Vec<String>, Vec<Vec<String>>) {
    let fixed = [
        "frame",
        "timestamp",
        "confidence",
        "success",
        "reason",
        "pose_yaw",
        "pose_pitch",
        "pose_roll",
        "pose_x",
        "pose_y",
        "eye_distance",
        "eye_opening_left",
        "eye_opening_right",
        "mouth_opening",
        "iris_left_x",
        "iris_left_y",
        "iris_right_x",
        "iris_right_y",
    ];
    let mut header: Vec<String> = fixed.into_iter().map(str::to_owned).collect();
    let units = features.first().map(|f| f.action_units.as_slice()).unwrap_or_default();
    for suffix in ["r", "c", "e"] {
        header.extend(units.iter().map(|unit| unit_column(unit.number, suffix)));
    }
    let sided = || units.iter().filter(|unit| unit.sides.is_some());
    header.extend(sided().flat_map(|unit| ["left", "right"].map(|side| unit_column(unit.number, side))));
    let faps: Vec<_> = features.first().map(|f| f.faps.iter().map(|(fap, _)| *fap).collect()).unwrap_or_default();
    header.extend(faps.iter().map(|&fap| fap_column(fap)));
    let features = in_time(features);
    let first = features.first().map_or(0, |f| f.frame);
    let rows = features.iter().map(|f| {
        let number = measured;
        let mut row = vec![
            f.frame.to_string(),
            clock.seconds(f.frame.saturating_sub(first)).map(number).unwrap_or_default(),
            number(f.confidence),
            u8::from(f.reason.is_none()).to_string(),
            f.reason.clone().unwrap_or_default(),
        ];
        row.extend(f.pose.map(number));
        row.extend([f.position.x, f.position.y, f.eye_distance, f.eye_opening[0], f.eye_opening[1], f.mouth_opening].map(number));
        match f.iris {
            Some([left, right]) => row.extend([left.x, left.y, right.x, right.y].map(number)),
            None => row.extend([const { String::new() }; 4]),
        }
        row.extend(f.action_units.iter().map(|unit| number(unit.value)));
        row.extend(f.action_units.iter().map(|unit| u8::from(unit.is_present()).to_string()));
        row.extend(f.action_units.iter().map(|unit| number(unit.expected_error)));
        row.extend(f.action_units.iter().filter_map(|unit| unit.sides).flatten().map(number));
        row.extend(f.faps.iter().map(|(_, value)| number(*value)));
        row
    });
    let rows = rows.collect();
    (header, rows)
}

/// BLAKE3 hashes of the two feature files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FeatureHashes {
    /// Hash of the table.
    pub csv: blake3::Hash,
    /// Hash of the JSON with the units.
    pub json: blake3::Hash,
}

/// Naming scheme of the columns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColumnNames {
    /// All measurements, in degrees and face units: [`features_units`].
    #[default]
    Grimace,
    /// Columns that readers of `OpenFace`'s files expect: landmarks, pose in radians, action units.
    OpenFace,
}

impl ColumnNames {
    /// Whether files in this scheme have a column for an action unit.
    pub fn has(self, unit: u8) -> bool {
        self == Self::Grimace || openface::UNITS.contains(&unit)
    }
}

/// Writes `STEM.csv`, with the columns of `beside` after its own, and `STEM.json` with the units.
///
/// # Errors
/// [`OutputError`] when a file cannot be written.
pub fn write_features(
    path: &Path,
    features: &[FrameFeatures],
    clock: &Clock,
    names: ColumnNames,
    beside: Option<&ColumnsBeside>,
) -> Result<FeatureHashes, OutputError> {
    let ((mut header, mut rows), mut units) = match names {
        ColumnNames::Grimace => (features_csv(features, clock), features_units()),
        ColumnNames::OpenFace => {
            (openface::table(features, clock), openface::ABOUT.iter().map(|&(k, v)| (k.to_owned(), v.to_owned())).collect())
        }
    };
    if let Some(beside) = beside {
        header.extend_from_slice(&beside.header);
        rows.iter_mut().zip(&beside.rows).for_each(|(row, beside)| row.extend_from_slice(beside));
        units.insert("mediapipe_*".to_owned(), "score of MediaPipe's blendshape, 0 to 1".to_owned());
    }
    let csv = write_records(path, header, rows)?;
    let units_of_faces: BTreeMap<String, &str> = ACTION_UNITS.iter().map(|u| (format!("AU{:02}", u.number), u.name)).collect();
    let about =
        serde_json::json!({ "schema_version": 1, "made_by": output::MADE_BY, "units": units, "action_units": units_of_faces });
    let json = output::write_hashed(&path.with_extension("json"), |writer| output::json_into(writer, &about))?;
    Ok(FeatureHashes { csv, json })
}
