//! Tables: a row per frame, columns by name.

use std::{collections::BTreeMap, path::Path};

use nalgebra::Point2;

use super::{Form, LANDMARK_COUNT, LandmarkTrack, LandmarksError, form_of};
use crate::{
    input::{CsvFile, CsvRow, InputError, InputErrorKind},
    text::excerpt,
};

/// Whether a file is a table of landmarks: it has a column `frame` and the first point's.
pub(super) fn is_landmarks(path: &Path) -> bool {
    form_of(path) == Form::Table && CsvFile::open(path).is_ok_and(|csv| !points(&csv).is_empty())
}

/// Columns of x and y of the points 0, 1, ... as far as they go: `x0,y0` or, as `OpenFace` names them, `x_0,y_0`.
fn points(csv: &CsvFile) -> Vec<(usize, usize)> {
    let place: BTreeMap<&str, usize> = csv.header().iter().enumerate().map(|(k, name)| (name.as_str(), k)).collect();
    let columns = |separator: &str| {
        let at = |axis: &str, k: usize| place.get(format!("{axis}{separator}{k}").as_str()).copied();
        (0..csv.header().len()).map_while(|k| Some((at("x", k)?, at("y", k)?))).collect::<Vec<_>>()
    };
    let own = columns("");
    if own.is_empty() { columns("_") } else { own }
}

/// Reads a table into `track`.
pub(super) fn read(path: &Path, track: &mut LandmarkTrack) -> Result<(), LandmarksError> {
    let csv = CsvFile::open(path)?;
    let [frame_column] = csv.require(["frame"])?;
    let columns = points(&csv);
    if columns.len() != LANDMARK_COUNT {
        return Err(LandmarksError::Count { path: path.to_owned(), found: columns.len() });
    }
    let [confidence, success, face] = ["confidence", "success", "face_id"].map(|name| csv.column(name));
    let mut faces: BTreeMap<u32, Vec<String>> = BTreeMap::new();
    for row in csv.rows() {
        let row = row.map_err(|error| explained(error, ""))?;
        let frame = row.whole_number(frame_column)?;
        if let Some(face) = face {
            let seen = faces.entry(frame).or_default();
            seen.push(row.get(face).to_owned());
            seen.dedup();
            if seen.len() > 1 {
                return Err(LandmarksError::SeveralFaces { path: path.to_owned(), frame, faces: seen.len() });
            }
        }
        if track.frames.contains_key(&frame) || track.lost.contains(&frame) {
            return Err(LandmarksError::DuplicateFrame { path: path.to_owned(), frame });
        }
        if is_lost(&row, confidence, success, &columns, track.least_confidence)? {
            track.lost.push(frame);
            continue;
        }
        let number = |column: usize| row.number(column).map_err(|error| explained(error, row.get(column)));
        let mut points = Vec::with_capacity(LANDMARK_COUNT);
        for &(x, y) in &columns {
            points.push(Point2::new(number(x)?, number(y)?));
        }
        track.frames.insert(frame, points);
    }
    track.lost.sort_unstable();
    Ok(())
}

/// Whether a row says that the face was not found.
fn is_lost(
    row: &CsvRow<'_>,
    confidence: Option<usize>,
    success: Option<usize>,
    columns: &[(usize, usize)],
    least: f64,
) -> Result<bool, LandmarksError> {
    let given = |column: Option<usize>| column.filter(|&k| !row.get(k).is_empty());
    let number = |k: usize| row.number(k).map_err(|error| explained(error, row.get(k)));
    if let Some(k) = given(success)
        && number(k)? <= 0.0
    {
        return Ok(true);
    }
    if let Some(k) = given(confidence)
        && number(k)? < least
    {
        return Ok(true);
    }
    Ok(columns.iter().all(|&(x, y)| row.get(x).is_empty() && row.get(y).is_empty()))
}

/// An error of the table, with decimal commas named where they are the cause.
fn explained(error: InputError, field: &str) -> LandmarksError {
    let has_comma = field.contains(',') && field.replace(',', ".").parse::<f64>().is_ok();
    match (error.line, &error.kind) {
        (Some(line), InputErrorKind::Field { .. }) if has_comma => {
            LandmarksError::DecimalComma { path: error.path, line, found: excerpt(field) }
        }
        (Some(line), &InputErrorKind::FieldCount { expected, found }) if found > expected => {
            LandmarksError::ExtraFields { path: error.path, line, found, expected }
        }
        _ => LandmarksError::Input(error),
    }
}
