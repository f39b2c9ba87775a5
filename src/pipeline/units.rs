//! `units.json`: the units of all table columns, in machine-readable form.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{MADE_BY, SCHEMA_VERSION};

/// The file's content.
#[derive(Serialize)]
pub(super) struct UnitsJson {
    schema_version: u32,
    made_by: &'static str,
    /// Definitions of the unit names.
    units: BTreeMap<&'static str, &'static str>,
    /// Unit by column, by file. Columns with text, counts, or manifest values are not listed.
    files: BTreeMap<&'static str, BTreeMap<&'static str, &'static str>>,
}

const FACE_UNIT: &str = "face unit";
const PX: &str = "px";
const PERCENT: &str = "percent of ES0";
const RATIO: &str = "ratio";
const PROBABILITY: &str = "probability";
const MEDIANS: &str = "times the median";
const SCORES: &str = "standard deviations of people";
const CURVES: &str = "face unit, or the FAP's unit";
const DEGREES: &str = "degrees";
const INTENSITY: &str = "intensity";
const FAPS: &str = "FAP's unit";
const OF_COLUMN: &str = "as in the column";
const SLOPES: &str = "times the median, by 1 of the column";
const FRAME: &str = "frame from 0";

/// Unit names.
const UNITS: [(&str, &str); 17] = [
    (DEGREES, "positive: to the subject's left, down, towards the subject's right shoulder"),
    (INTENSITY, "of an action unit, 0 to 5"),
    (FAPS, "FAPU / 1024, 19 to 22 in openings of the own lids / 1024; angles 1e-5 rad"),
    (OF_COLUMN, "the unit of the manifest's column that `covariate` names"),
    (SLOPES, "change of the amplitude where the number that `covariate` names is larger by 1"),
    (SCORES, "along the component, 0 for the mean"),
    (
        CURVES,
        "of a node (curve `node`): offset from neutral, in face units; of a FAP (curve `fap`): FAPU / 1024, angles 1e-5 rad",
    ),
    (
        FACE_UNIT,
        "ES0 / 1024 of the canonical neutral face, ES0 being the distance of the eyes' centres; x to the subject's left, y up",
    ),
    (PX, "pixels of the image, from the centre of its top-left pixel, x right, y down"),
    (RATIO, "a number without unit, 1 for 100 %"),
    (PROBABILITY, "from 0 to 1"),
    (FRAME, "frame of the normalized model, or the displacement field from that frame to the next"),
    ("frame number", "as in the names of the images, or as the video counts, from 1"),
    ("percent of ES0", "100 times a length in px over the distance of the eyes' centres in px"),
    ("standard deviations", "of people within the groups, or of the differences of pairs"),
    ("variances", "squared distance in standard deviations of people within a label, over all directions"),
    (MEDIANS, "1 for a motion as strong as the median motion"),
];

/// Columns with units, by file.
const FILES: &[(&str, &[(&str, &str)])] = &[
    ("tracks/*.csv", &[("frame", "frame number"), ("x", PX), ("y", PX), ("residual", PX), ("expected_error", PX)]),
    ("models/*.csv", &[("frame", FRAME), ("x", FACE_UNIT), ("y", FACE_UNIT)]),
    ("representatives/*.csv", &[("frame", FRAME), ("x", FACE_UNIT), ("y", FACE_UNIT)]),
    ("models.parquet", &[("x_M_K", FACE_UNIT), ("y_M_K", FACE_UNIT)]),
    (
        "statistics.csv",
        &[
            ("dispersion", FACE_UNIT),
            ("dispersion_untrimmed", FACE_UNIT),
            ("dispersion_literal", FACE_UNIT),
            ("dispersion_literal_untrimmed", FACE_UNIT),
            ("dispersion_field", FACE_UNIT),
            ("dispersion_field_untrimmed", FACE_UNIT),
            ("sum_of_distances", FACE_UNIT),
            ("sum_of_distances_exact", FACE_UNIT),
            ("lower_bound", FACE_UNIT),
            ("gap", RATIO),
            ("certificate_gap", RATIO),
        ],
    ),
    ("trimming.csv", &[("frame", FRAME), ("distance", FACE_UNIT)]),
    (
        "verdicts.csv",
        &[
            ("expected_error_px", PX),
            ("expected_error_percent_es", PERCENT),
            ("placement_error_px", PX),
            ("placement_error_percent_es", PERCENT),
        ],
    ),
    ("intervals.csv", &[("dispersion", FACE_UNIT), ("low", FACE_UNIT), ("high", FACE_UNIT), ("level", PROBABILITY)]),
    (
        "comparisons.csv",
        &[
            ("energy", FACE_UNIT),
            ("effect", RATIO),
            ("effect_by_chance", RATIO),
            ("p", PROBABILITY),
            ("p_holm", PROBABILITY),
            ("least_p", PROBABILITY),
            ("least_p_holm", PROBABILITY),
            ("p_max_node", PROBABILITY),
            ("p_either", PROBABILITY),
            ("p_either_holm", PROBABILITY),
        ],
    ),
    ("comparison_nodes.csv", &[("energy", FACE_UNIT), ("p", PROBABILITY)]),
    ("amplitudes.csv", &[("amplitude", MEDIANS)]),
    ("variation/*.csv", &[("frame", FRAME), ("x", FACE_UNIT), ("y", FACE_UNIT)]),
    ("variation.csv", &[("share", RATIO), ("cumulative_share", RATIO), ("sd", FACE_UNIT)]),
    ("variation_scores.csv", &[("score", SCORES)]),
    (
        "bands.csv",
        &[
            ("frame", FRAME),
            ("representative", CURVES),
            ("mean", CURVES),
            ("q05", CURVES),
            ("q25", CURVES),
            ("q50", CURVES),
            ("q75", CURVES),
            ("q95", CURVES),
        ],
    ),
    (
        "sequences.csv",
        &[
            ("expected_error_percent_es", PERCENT),
            ("placement_error_percent_es", PERCENT),
            ("amplitude_face", MEDIANS),
            ("amplitude_brows", MEDIANS),
            ("amplitude_eyes", MEDIANS),
            ("amplitude_mouth", MEDIANS),
            ("pose_yaw", DEGREES),
            ("pose_pitch", DEGREES),
            ("pose_roll", DEGREES),
            ("AU.._r", INTENSITY),
            ("FAP.._NAME", FAPS),
        ],
    ),
    ("covariates/*.csv", &[("frame", FRAME), ("x", FACE_UNIT), ("y", FACE_UNIT)]),
    (
        "covariates.csv",
        &[
            ("mean", OF_COLUMN),
            ("sd", OF_COLUMN),
            ("low", OF_COLUMN),
            ("high", OF_COLUMN),
            ("share", RATIO),
            ("share_by_chance", RATIO),
            ("f", RATIO),
            ("p", PROBABILITY),
            ("p_holm", PROBABILITY),
            ("p_max_node", PROBABILITY),
            ("p_either", PROBABILITY),
            ("p_either_holm", PROBABILITY),
            ("least_p_either_holm", PROBABILITY),
        ],
    ),
    ("covariate_nodes.csv", &[("share", RATIO), ("p", PROBABILITY)]),
    (
        "covariate_amplitudes.csv",
        &[
            ("slope", SLOPES),
            ("low", SLOPES),
            ("high", SLOPES),
            ("correlation", RATIO),
            ("p", PROBABILITY),
            ("p_t", PROBABILITY),
            ("p_holm", PROBABILITY),
        ],
    ),
    (
        "amplitude_comparisons.csv",
        &[
            ("mean_a", MEDIANS),
            ("mean_b", MEDIANS),
            ("sd_a", MEDIANS),
            ("sd_b", MEDIANS),
            ("difference", MEDIANS),
            ("low", MEDIANS),
            ("high", MEDIANS),
            ("effect", "standard deviations"),
            ("p", PROBABILITY),
            ("p_t", PROBABILITY),
            ("p_holm", PROBABILITY),
            ("p_equivalence", PROBABILITY),
            ("p_equivalence_holm", PROBABILITY),
        ],
    ),
    (
        "group_tests.csv",
        &[
            ("location_f", RATIO),
            ("location_share", RATIO),
            ("location_p", PROBABILITY),
            ("location_p_holm", PROBABILITY),
            ("scatters", FACE_UNIT),
            ("scatter_f", RATIO),
            ("scatter_p", PROBABILITY),
            ("scatter_p_holm", PROBABILITY),
        ],
    ),
    (
        "recognition.csv",
        &[("probability", PROBABILITY), ("p_LABEL", PROBABILITY), ("distance", "variances"), ("typicality", PROBABILITY)],
    ),
];

/// Units of all tables that `run` and `analyze` write.
pub(super) fn units_json() -> UnitsJson {
    let columns = |(file, columns): &(&'static str, &[(&'static str, &'static str)])| (*file, columns.iter().copied().collect());
    UnitsJson {
        schema_version: SCHEMA_VERSION,
        made_by: MADE_BY,
        units: UNITS.into_iter().collect(),
        files: FILES.iter().map(columns).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_unit_is_explained() {
        let explained: Vec<&str> = UNITS.iter().map(|(unit, _)| *unit).collect();
        for (file, columns) in FILES {
            for (column, unit) in *columns {
                assert!(explained.contains(unit), "{file}: {column}: {unit}");
            }
        }
    }
}
