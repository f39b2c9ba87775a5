//! Shapes with `ARKit` names: their coefficients, the six expressions mixed from them, and CSV files of the 52 coefficients.

use std::{io, path::Path};

use serde::Deserialize;

use super::{Composition, RegionScheme};
use crate::{
    features::COEFFICIENTS,
    output::{OutputError, nine_digits, write_atomic},
};

/// Index of the coefficient that a shape represents; `None` for other names.
///
/// The name is compared without regard to case. `_L` and `_R` or `.L` and `.R` are read as sides; a side is ignored where `ARKit`
/// has none (`browInnerUp_L`).
pub fn coefficient(shape: &str) -> Option<usize> {
    let find = |name: &str| COEFFICIENTS.iter().position(|c| c.eq_ignore_ascii_case(name));
    let sided = ["_L", "_R", ".L", ".R"].iter().zip(["Left", "Right", "Left", "Right"]);
    find(shape).or_else(|| {
        sided
            .filter_map(|(end, side)| shape.strip_suffix(end).map(|s| (s, side)))
            .find_map(|(s, side)| find(&format!("{s}{side}")).or_else(|| find(s)))
    })
}

/// Side of a shape by its name: -1 right, 1 left, 0 neither.
pub fn side(shape: &str) -> f64 {
    let ends = |list: [&str; 3]| list.iter().any(|end| shape.ends_with(end));
    // jawLeft and mouthLeft move the whole mouth sideways.
    let whole = ["jawLeft", "jawRight", "mouthLeft", "mouthRight"].iter().any(|n| n.eq_ignore_ascii_case(shape));
    match (whole, ends(["_L", ".L", "Left"]), ends(["_R", ".R", "Right"])) {
        (false, true, _) => 1.0,
        (false, _, true) => -1.0,
        _ => 0.0,
    }
}

/// How far shapes of the embedded head close the lids in their middle, relative to `eyeBlink`. The first two shapes have no
/// `ARKit` name because no eyeball turns with them.
const LID_SHARES: [(&str, f64); 3] = [("lidsDown", 0.664), ("lidsUp", -0.213), ("eyeWide", -0.350)];

/// How far a shape closes an eye, relative to `eyeBlink`; `None` for shapes that are not in the table.
pub(super) fn lid_share(shape: &str) -> Option<f64> {
    let whole = ["_L", ".L", "Left", "_R", ".R", "Right"].iter().find_map(|end| shape.strip_suffix(end)).unwrap_or(shape);
    LID_SHARES.iter().find(|(name, _)| *name == whole).map(|(_, share)| *share)
}

/// How far a shape without an `ARKit` name closes an eye, relative to `eyeBlink`: the lids of the embedded head and shapes of
/// other banks with the same names.
fn lids_alone(shape: &str) -> Option<f64> {
    lid_share(shape).filter(|_| coefficient(shape).is_none())
}

/// Returns the six dominant expressions as weights of shapes with `ARKit` names; `None` when no emotion finds a shape.
///
/// The weights come from `arkit_expressions.csv`, which follows the action units that FACS names for the emotions.
pub fn dominant_expressions(shapes: &[String]) -> Option<Vec<(String, Vec<f64>)>> {
    #[derive(Deserialize)]
    struct Row {
        emotion: String,
        shape: String,
        weight: f64,
    }
    let mut reader = csv::Reader::from_reader(include_str!("arkit_expressions.csv").as_bytes());
    let mut expressions: Vec<(String, Vec<f64>)> = Vec::new();
    for row in reader.deserialize::<Row>().flatten() {
        if expressions.last().is_none_or(|(name, _)| *name != row.emotion) {
            expressions.push((row.emotion.clone(), vec![0.0; shapes.len()]));
        }
        let wanted = coefficient(&row.shape);
        if let Some((_, weights)) = expressions.last_mut() {
            let found = shapes.iter().zip(weights).filter(|(shape, _)| wanted.is_some() && coefficient(shape) == wanted);
            found.for_each(|(_, weight)| *weight = row.weight);
        }
    }
    expressions.iter().all(|(_, weights)| weights.iter().any(|&w| w != 0.0)).then_some(expressions)
}

/// Converts weights of members in each region to the 52 coefficients; `None` when no shape has an `ARKit` name.
///
/// `names` are the members. For a mixed bank, `composition` gives the shapes that the members are made of; without it, members
/// are shapes. The rules are:
///
/// - A coefficient with a side takes the weights of the regions of that side.
/// - Brows, eyes, nose and cheek squint take the weights of the upper regions, all other coefficients those of the lower ones.
/// - Several regions, and several shapes of one coefficient, are averaged.
/// - Lid shapes of the embedded head without an `ARKit` name count as `eyeBlink` and `eyeWide`. Two such shapes can nearly
///   cancel; the remainder closes the eye.
///
/// Values can lie outside the range of the coefficients, 0 to 1; `limit` clamps them.
pub fn coefficients(
    names: &[String],
    composition: Option<&Composition>,
    scheme: RegionScheme,
    weights: &[Vec<f64>],
) -> Option<[f64; 52]> {
    let shapes = composition.map_or(names, |c| &c.shapes[..]);
    let mut sums = [(0.0, 0.0); 52];
    // How far shapes without an `ARKit` name close the lids of the left and of the right eye.
    let mut lids = [0.0; 2];
    for (shape, name) in shapes.iter().enumerate() {
        let mean_where = |seen: &str, side: f64| {
            let regions = scheme.names().iter().zip(weights).filter(|(region, _)| is_seen_in(seen, side, region));
            let mut found = (0.0, 0.0);
            for (_, weights) in regions {
                found.0 += match composition {
                    None => weights.get(shape).copied().unwrap_or(0.0),
                    Some(c) => {
                        weights.iter().zip(&c.weights).map(|(w, row)| w * row.get(shape).copied().unwrap_or(0.0)).sum::<f64>()
                    }
                };
                found.1 += 1.0;
            }
            (found.1 > 0.0).then(|| found.0 / found.1)
        };
        let side = side(name);
        if let Some(place) = coefficient(name) {
            if let Some(mean) = mean_where(COEFFICIENTS[place], side) {
                sums[place].0 += mean;
                sums[place].1 += 1.0;
            }
        } else if let Some(share) = lids_alone(name) {
            for (lid, of) in lids.iter_mut().zip([1.0, -1.0]).filter(|(_, of)| side == 0.0 || side == *of) {
                *lid += share * mean_where(BLINKS[0], of).unwrap_or(0.0);
            }
        }
    }
    let any = sums.iter().any(|s| s.1 > 0.0);
    let mut values = sums.map(|(sum, count)| if count > 0.0 { sum / count } else { 0.0 });
    for (shut, (blink, wide)) in lids.into_iter().zip(BLINKS.into_iter().zip(WIDES)) {
        count_lids(&mut values, shut, (blink, wide));
    }
    any.then_some(values)
}

/// Coefficients that close the left and the right eye, and that open them wide.
const BLINKS: [&str; 2] = ["eyeBlinkLeft", "eyeBlinkRight"];
const WIDES: [&str; 2] = ["eyeWideLeft", "eyeWideRight"];

/// Adds `shut` to the coefficients of an eye: how far unnamed shapes close it, relative to `eyeBlink`, or open it if negative. It
/// first reduces the opposite coefficient, then increases the other.
fn count_lids(values: &mut [f64; 52], shut: f64, (blink, wide): (&str, &str)) {
    let (Some(blink), Some(wide), Some(opened)) = (coefficient(blink), coefficient(wide), lid_share(wide).map(f64::abs)) else {
        return;
    };
    let (add, takes, unit) = if shut < 0.0 { (wide, blink, 1.0) } else { (blink, wide, opened) };
    let taken = shut.abs().min((values[takes] * unit).max(0.0));
    values[takes] -= taken / unit;
    values[add] += (shut.abs() - taken) / if shut < 0.0 { opened } else { 1.0 };
}

/// Whether a coefficient takes the weights of a region.
fn is_seen_in(coefficient: &str, side: f64, region: &str) -> bool {
    let upper = ["brow", "eye", "nose", "cheekSquint"].iter().any(|start| coefficient.starts_with(start));
    let height = if upper { !region.starts_with("lower") } else { !region.starts_with("upper") };
    let other_side = if side > 0.0 { "right" } else { "left" };
    height && (side == 0.0 || !region.ends_with(other_side))
}

/// A coefficient that was limited to its range.
#[derive(Clone, Debug, PartialEq)]
pub struct Limited {
    /// Name of the coefficient.
    pub coefficient: &'static str,
    /// Number of frames in which it was limited.
    pub frames: usize,
    /// The value farthest outside the range.
    pub farthest: f64,
}

/// The group of coefficients that balance each other: brows that rise and sink, lids of one eye that open and shut.
fn balanced(coefficient: &str) -> Option<usize> {
    if coefficient.starts_with("brow") {
        return Some(0);
    }
    let is_lid = ["eyeBlink", "eyeWide", "eyeSquint"].iter().any(|start| coefficient.starts_with(start));
    is_lid.then(|| if coefficient.ends_with("Left") { 1 } else { 2 })
}

/// Number of such groups.
const GROUPS: usize = 3;

/// Limits coefficients to their range, 0 to 1, and returns those that were outside. Of a group that balances each other, all are reduced
/// alike in a frame in which one is too large: clamped alone, brows that are raised strongly and lowered a little would be lowered too much.
pub fn limit(frames: &mut [[f64; 52]]) -> Vec<Limited> {
    /// Excess due to rounding, which is not reported.
    const TOLERANCE: f64 = 1e-9;
    let outside = |value: f64| (value - value.clamp(0.0, 1.0)).abs();
    let limited = COEFFICIENTS.iter().enumerate().filter_map(|(k, coefficient)| {
        let there = frames.iter().map(|f| f[k]).filter(|&v| outside(v) > TOLERANCE);
        let farthest = there.clone().fold(0.0, |a, b| if outside(b) > outside(a) { b } else { a });
        let frames = there.count();
        (frames > 0).then_some(Limited { coefficient, frames, farthest })
    });
    let limited = limited.collect();
    let mut groups: [Vec<usize>; GROUPS] = Default::default();
    for (k, name) in COEFFICIENTS.iter().enumerate() {
        if let Some(group) = balanced(name) {
            groups[group].push(k);
        }
    }
    for frame in frames.iter_mut() {
        for group in &groups {
            let most = group.iter().map(|&k| frame[k]).fold(1.0, f64::max);
            group.iter().for_each(|&k| frame[k] /= most);
        }
    }
    frames.iter_mut().flatten().for_each(|value| *value = value.clamp(0.0, 1.0));
    limited
}

/// Shapes that no coefficient represents; files of coefficients therefore lack them.
pub fn unnamed<'a>(names: &'a [String], composition: Option<&'a Composition>) -> Vec<&'a str> {
    let shapes = composition.map_or(names, |c| &c.shapes[..]);
    shapes.iter().map(String::as_str).filter(|shape| coefficient(shape).is_none() && lids_alone(shape).is_none()).collect()
}

/// Columns that Live Link Face writes after the coefficients: rotations of head and eyes. A bank does not have them, so they are
/// 0.
const LIVE_LINK_ROTATIONS: [&str; 9] = [
    "HeadYaw",
    "HeadPitch",
    "HeadRoll",
    "LeftEyeYaw",
    "LeftEyePitch",
    "LeftEyeRoll",
    "RightEyeYaw",
    "RightEyePitch",
    "RightEyeRoll",
];

/// Formats the time of a frame as `HH:MM:SS:FF.sss`: hours, minutes, seconds, the frame within the second at the integer rate
/// nearest to `fps`, and thousandths of a frame, always 0. Frames more than a second apart start at the nearest second.
fn timecode(frame: usize, fps: f64) -> String {
    let rate = (fps.round() as usize).max(1);
    let (seconds, within) = if fps < 1.0 { ((frame as f64 / fps).round() as usize, 0) } else { (frame / rate, frame % rate) };
    format!("{:02}:{:02}:{:02}:{within:02}.000", seconds / 3600, seconds / 60 % 60, seconds % 60)
}

/// Formats a coefficient. A value below the smallest meaningful weight is a rounding residue and is written as 0.
fn written(value: f64) -> String {
    const LEAST: f64 = 1e-9;
    nine_digits(if value.abs() < LEAST { 0.0 } else { value })
}

/// Writes the coefficients in the format of Live Link Face: `Timecode,BlendShapeCount` (61), the 52 coefficients with a capital
/// first letter, and nine angles.
///
/// # Errors
/// [`OutputError`].
pub fn write_live_link(path: &Path, fps: f64, frames: &[[f64; 52]]) -> Result<(), OutputError> {
    let capital = |name: &str| name[..1].to_uppercase() + &name[1..];
    write_atomic(path, |writer| {
        let mut csv = crate::output::csv_writer(writer);
        let start = ["Timecode".to_owned(), "BlendShapeCount".to_owned()];
        let names = COEFFICIENTS.iter().map(|name| capital(name)).chain(LIVE_LINK_ROTATIONS.map(str::to_owned));
        csv.write_record(start.into_iter().chain(names)).map_err(io::Error::from)?;
        for (frame, values) in frames.iter().enumerate() {
            let start = [timecode(frame, fps), (COEFFICIENTS.len() + LIVE_LINK_ROTATIONS.len()).to_string()];
            let rest = LIVE_LINK_ROTATIONS.map(|_| "0".to_owned());
            let row = start.into_iter().chain(values.iter().map(|&v| written(v))).chain(rest);
            csv.write_record(row).map_err(io::Error::from)?;
        }
        csv.flush()
    })
}

/// Writes `frame,time_s` and the 52 coefficients.
///
/// # Errors
/// [`OutputError`].
pub fn write_arkit(path: &Path, fps: f64, frames: &[[f64; 52]]) -> Result<(), OutputError> {
    write_atomic(path, |writer| {
        let mut csv = crate::output::csv_writer(writer);
        csv.write_record(["frame", "time_s"].iter().chain(&COEFFICIENTS)).map_err(io::Error::from)?;
        for (frame, values) in frames.iter().enumerate() {
            let start = [frame.to_string(), nine_digits(frame as f64 / fps)];
            csv.write_record(start.into_iter().chain(values.iter().map(|&v| written(v)))).map_err(io::Error::from)?;
        }
        csv.flush()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|&n| n.to_owned()).collect()
    }

    #[test]
    fn names_of_the_ict_model_and_of_blender_are_known() {
        let at = |name| coefficient(name).map(|k| COEFFICIENTS[k]);
        assert_eq!(at("browDown_L"), Some("browDownLeft"));
        assert_eq!(at("eyeBlink.R"), Some("eyeBlinkRight"));
        assert_eq!(at("browInnerUp_R"), Some("browInnerUp"));
        assert_eq!(at("JawOpen"), Some("jawOpen"));
        assert_eq!(at("mouthLeft"), Some("mouthLeft"));
        assert_eq!(at("smile"), None);
        assert_eq!((side("eyeBlink_L"), side("noseSneerRight"), side("mouthLeft"), side("jawOpen")), (1.0, -1.0, 0.0, 0.0));
    }

    #[test]
    fn clamped_and_unnamed_values_are_reported() {
        let mut frames = [[0.0; 52]; 3];
        (frames[0][17], frames[1][17], frames[2][0]) = (1.5, 1.25, -0.5);
        let limited = |coefficient, frames, farthest| Limited { coefficient, frames, farthest };
        assert_eq!(limit(&mut frames), [limited("eyeBlinkLeft", 1, -0.5), limited("jawOpen", 2, 1.5)]);
        assert_eq!((frames[0][17], frames[1][17], frames[2][0]), (1.0, 1.0, 0.0));
        assert_eq!(unnamed(&names(&["jawOpen", "smirk"]), None), ["smirk"]);
        // Brows keep their balance, and so do the lids of each eye.
        let at = |name: &str| coefficient(name).unwrap();
        let mut frame = [[0.0; 52]];
        for (name, value) in
            [("browOuterUpLeft", 2.0), ("browDownRight", 0.5), ("eyeWideLeft", 1.25), ("eyeWideRight", 0.8), ("jawOpen", 3.0)]
        {
            frame[0][at(name)] = value;
        }
        assert_eq!(limit(&mut frame).len(), 3);
        let kept = ["browOuterUpLeft", "browDownRight", "eyeWideLeft", "eyeWideRight", "jawOpen"].map(|name| frame[0][at(name)]);
        assert_eq!(kept, [1.0, 0.25, 1.0, 0.8, 1.0]);
    }

    #[test]
    fn lids_without_a_name_shut_and_open_the_eyes() {
        let shapes = names(&["eyeBlink_L", "eyeWide_L", "lidsDown_L", "lidsUp_L", "lidsDown_R", "eyeBlink_R"]);
        let of = |weights: [f64; 6]| {
            let values = coefficients(&shapes, None, RegionScheme::Whole, &[weights.to_vec()]).unwrap();
            ["eyeBlinkLeft", "eyeWideLeft", "eyeBlinkRight", "eyeWideRight"].map(|name| values[coefficient(name).unwrap()])
        };
        let near = |weights: [f64; 6], expected: [f64; 4]| {
            let found = of(weights);
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}, not {expected:?}");
        };
        // Two shapes that nearly cancel: 0.2 + 2 * 0.664 - 2 * 0.213; the other eye by half.
        near([0.2, 0.0, 2.0, 2.0, 0.5, 0.0], [1.102, 0.0, 0.332, 0.0]);
        // Sinking lids first make a wide-open eye less wide; the remainder closes it: 0.664 - 0.35.
        near([0.0, 1.0, 0.5, 0.0, 0.0, 0.0], [0.0, 1.0 - 0.332 / 0.35, 0.0, 0.0]);
        near([0.0, 1.0, 1.0, 0.0, 0.0, 0.0], [0.314, 0.0, 0.0, 0.0]);
        // The opposite direction: 0.213 - 0.1 remains to open it.
        near([0.1, 0.0, 0.0, 1.0, 0.0, 0.3], [0.0, 0.113 / 0.35, 0.3, 0.0]);
        assert!(unnamed(&shapes, None).is_empty());
        // When lids are solved by region, the upper regions count.
        let quarters: Vec<Vec<f64>> = RegionScheme::Quarters
            .names()
            .iter()
            .map(|region| vec![0.0, 0.0, if region.starts_with("lower") { 9.0 } else { 0.5 }, 0.0, 0.0, 0.0])
            .collect();
        let values = coefficients(&shapes, None, RegionScheme::Quarters, &quarters).unwrap();
        assert!((values[coefficient("eyeBlinkLeft").unwrap()] - 0.332).abs() < 1e-9);
    }

    #[test]
    fn live_link_has_its_names_and_timecodes() {
        assert_eq!(timecode(0, 60.0), "00:00:00:00.000");
        // Frame 215 999 at 60 per second: the last of the first hour; then 30000/1001, which counts 30 frames in a second.
        assert_eq!((timecode(215_999, 60.0), timecode(31, 29.97)), ("00:59:59:59.000".to_owned(), "00:00:01:01.000".to_owned()));
        // A frame every two and a half seconds.
        assert_eq!([1, 2].map(|frame| timecode(frame, 0.4)), ["00:00:03:00.000", "00:00:05:00.000"]);
        assert_eq!([3e-35, -0.0, 2e-9, 0.25].map(written), ["0", "0", "0.000000002", "0.25"]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("l.csv");
        write_live_link(&path, 25.0, &[[0.5; 52]]).unwrap();
        let text = std::fs::read_to_string(path).unwrap();
        let lines: Vec<Vec<&str>> = text.lines().map(|l| l.split(',').collect()).collect();
        assert_eq!((lines.len(), lines[0].len(), lines[1].len()), (2, 63, 63));
        assert_eq!(lines[0][..4], ["Timecode", "BlendShapeCount", "EyeBlinkLeft", "EyeLookDownLeft"]);
        assert_eq!(
            (lines[0][53], lines[0][54], lines[1][1], lines[1][53], lines[1][54]),
            ("TongueOut", "HeadYaw", "61", "0.5", "0")
        );
    }

    #[test]
    fn every_shape_of_the_table_is_a_coefficient() {
        let all = names(&COEFFICIENTS);
        let expressions = dominant_expressions(&all).unwrap();
        let labels: Vec<&str> = expressions.iter().map(|e| e.0.as_str()).collect();
        assert_eq!(labels, ["anger", "disgust", "fear", "happiness", "sadness", "surprise"]);
        let rows = include_str!("arkit_expressions.csv").lines().count() - 1;
        let weights = expressions.iter().flat_map(|e| &e.1).filter(|w| **w != 0.0).count();
        assert_eq!(rows, weights);
        assert!(dominant_expressions(&names(&["a", "b"])).is_none());
    }

    #[test]
    fn sides_come_from_their_regions_and_compositions_are_multiplied_out() {
        let shapes = names(&["mouthSmile_L", "mouthSmile_R", "jawOpen", "other"]);
        let at = |name: &str| coefficient(name).unwrap();
        let weights = [vec![0.1, 0.2, 0.4, 9.0], vec![0.5, 0.6, 0.8, 9.0]]; // right, left
        let values = coefficients(&shapes, None, RegionScheme::Halves, &weights).unwrap();
        assert_eq!((values[at("mouthSmileLeft")], values[at("mouthSmileRight")]), (0.5, 0.2));
        assert!((values[at("jawOpen")] - 0.6).abs() < 1e-12);
        // One member of half a smile and a full jaw, with weight 0.5; a second of 4 jaws, with weight 1.
        let composition = Composition { shapes, weights: vec![vec![0.5, 0.5, 1.0, 0.0], vec![0.0, 0.0, 4.0, 0.0]] };
        let members = names(&["a", "b"]);
        let values = coefficients(&members, Some(&composition), RegionScheme::Whole, &[vec![0.5, 1.0]]).unwrap();
        assert_eq!((values[at("mouthSmileLeft")], values[at("jawOpen")], values[at("tongueOut")]), (0.25, 4.5, 0.0));
        assert!(coefficients(&members, None, RegionScheme::Whole, &[vec![0.5, 1.0]]).is_none());
    }
}
