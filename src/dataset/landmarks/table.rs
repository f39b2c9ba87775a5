//! Reads tables: a row per frame and face, columns by name.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use nalgebra::Point2;

use super::{Form, LANDMARK_COUNT, LandmarkTrack, LandmarksError, form_of, mediapipe};
use crate::{
    input::{CsvFile, CsvRow, InputError, InputErrorKind},
    text::{excerpt, is_missing_word},
};

/// Opens a table separated by commas or semicolons.
fn open(path: &Path) -> Result<CsvFile, InputError> {
    CsvFile::open(path)?.or_semicolons(&["frame", "x0", "y0", "x_0", "y_0"])
}

/// Whether a file is a table of landmarks: it has a column `frame` and columns of the first point.
pub(super) fn is_landmarks(path: &Path) -> bool {
    form_of(path) == Form::Table && open(path).is_ok_and(|csv| !points(&csv).is_empty())
}

/// Columns of x and y of the consecutive points 0, 1, ...: `x0,y0` or, in `OpenFace`, `x_0,y_0`.
fn points(csv: &CsvFile) -> Vec<(usize, usize)> {
    let place: BTreeMap<&str, usize> = csv.header().iter().enumerate().map(|(k, name)| (name.as_str(), k)).collect();
    let columns = |separator: &str| {
        let at = |axis: &str, k: usize| place.get(format!("{axis}{separator}{k}").as_str()).copied();
        (0..csv.header().len()).map_while(|k| Some((at("x", k)?, at("y", k)?))).collect::<Vec<_>>()
    };
    let own = columns("");
    if own.is_empty() { columns("_") } else { own }
}

/// Columns other than points.
struct Columns {
    points: Vec<(usize, usize)>,
    confidence: Option<usize>,
    success: Option<usize>,
    face: Option<usize>,
    timestamp: Option<usize>,
    /// Width and height of the picture, px.
    size: Option<(usize, usize)>,
}

/// A parsed row.
struct Row {
    frame: u32,
    face: String,
    /// Seconds.
    time: Option<f64>,
    /// `None` for a face that was lost.
    points: Option<Vec<Point2<f64>>>,
}

/// Reads a table into `track`. Of several faces it reads the requested one, else the one found in most frames, or the largest of several
/// such.
pub(super) fn read(path: &Path, face: Option<&str>, track: &mut LandmarkTrack) -> Result<(), LandmarksError> {
    let rows = read_rows(path, track.least_confidence)?;
    let mut faces: BTreeMap<String, Vec<Row>> = BTreeMap::new();
    let all_rows = rows.len();
    let unnumbered = all_rows > 1 && rows.iter().all(|row| row.frame == 0);
    rows.into_iter().for_each(|row| faces.entry(row.face.clone()).or_default().push(row));
    if unnumbered && faces.len() < all_rows {
        // OpenFace's FaceLandmarkImg writes 0 for every picture; rows are numbered in their order.
        faces.values_mut().for_each(|rows| (1..).zip(rows).for_each(|(number, row)| row.frame = number));
    }
    let ids: Vec<String> = faces.keys().cloned().collect();
    let all: BTreeSet<u32> = faces.values().flatten().map(|row| row.frame).collect();
    let is_named = face.is_some_and(|face| !face.trim().is_empty());
    let rows = match face.map(str::trim).filter(|face| !face.is_empty()) {
        Some(face) => faces.remove(face).ok_or_else(|| LandmarksError::NoSuchFace {
            path: path.to_owned(),
            face: face.to_owned(),
            found: ids,
        })?,
        None => longest(faces),
    };
    let own: BTreeSet<u32> = rows.iter().map(|row| row.frame).collect();
    take(rows, path, track)?;
    if !is_named {
        // Programs give a face that they lose and find again a new id: in frames with other faces only, it is lost.
        track.lost.extend(all.difference(&own));
        track.lost.sort_unstable();
    }
    Ok(())
}

/// Reads the rows of a table in the order of the file.
fn read_rows(path: &Path, least_confidence: f64) -> Result<Vec<Row>, LandmarksError> {
    let csv = open(path)?;
    let [frame] = csv.require(["frame"])?;
    let points = points(&csv);
    if points.len() != LANDMARK_COUNT && !mediapipe::COUNTS.contains(&points.len()) {
        return Err(LandmarksError::Count { path: path.to_owned(), found: points.len() });
    }
    let [confidence, success, face_id, timestamp] =
        ["confidence", "success", "face_id", "timestamp"].map(|name| csv.column_of_any_case(name));
    let any_case = |start: &str, name: &str| csv.column_of_any_case(&format!("{start}{name}"));
    let size = ["", "image_"].iter().find_map(|start| Some((any_case(start, "width")?, any_case(start, "height")?)));
    let columns = Columns { points, confidence, success, face: face_id, timestamp, size };
    let mut rows = Vec::new();
    for row in csv.rows() {
        // With semicolons as separators, commas do not separate fields.
        let as_it_is = csv.separator() == b';';
        let row = row.map_err(|error| if as_it_is { error.into() } else { explained(error, "") })?;
        rows.push(read_row(&row, frame, &columns, least_confidence, path)?);
    }
    Ok(rows)
}

/// Rows of the face found in most frames, or of the largest of several such, or of the first.
fn longest(faces: BTreeMap<String, Vec<Row>>) -> Vec<Row> {
    let worth = |rows: &[Row]| {
        let found = rows.iter().filter_map(|row| row.points.as_deref());
        (found.clone().count(), found.map(extent).fold(0.0, f64::max))
    };
    let mut best: Option<((usize, f64), Vec<Row>)> = None;
    for rows in faces.into_values() {
        let worth = worth(&rows);
        if best.as_ref().is_none_or(|(known, _)| worth.0 > known.0 || worth.0 == known.0 && worth.1 > known.1) {
            best = Some((worth, rows));
        }
    }
    best.map(|(_, rows)| rows).unwrap_or_default()
}

/// Diagonal of the smallest box around points.
fn extent(points: &[Point2<f64>]) -> f64 {
    let Some(&first) = points.first() else { return 0.0 };
    let (low, high) = points.iter().fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
    (high - low).norm()
}

/// Adds the rows of one face.
fn take(rows: Vec<Row>, path: &Path, track: &mut LandmarkTrack) -> Result<(), LandmarksError> {
    for Row { frame, points, time, .. } in rows {
        if track.frames.contains_key(&frame) || track.lost.contains(&frame) {
            return Err(LandmarksError::DuplicateFrame { path: path.to_owned(), frame });
        }
        track.times.extend(time.map(|time| (frame, time)));
        match points {
            Some(points) => {
                track.frames.insert(frame, points);
            }
            None => track.lost.push(frame),
        }
    }
    track.lost.sort_unstable();
    Ok(())
}

fn read_row(row: &CsvRow<'_>, frame: usize, columns: &Columns, least: f64, path: &Path) -> Result<Row, LandmarksError> {
    let number = |column: usize| row.number(column).map_err(|error| explained(error, row.get(column)));
    let face = columns.face.map(|k| row.get(k).to_owned()).unwrap_or_default();
    let frame = row.whole_number(frame)?;
    let time = columns.timestamp.filter(|&k| !is_missing(row.get(k))).map(number).transpose()?;
    if is_lost(row, columns, least)? {
        return Ok(Row { frame, face, time, points: None });
    }
    let mut points = Vec::with_capacity(columns.points.len());
    for &(x, y) in &columns.points {
        points.push(Point2::new(number(x)?, number(y)?));
    }
    if mediapipe::is_normalized(&points) {
        let (width, height) =
            columns.size.ok_or_else(|| LandmarksError::Normalized { path: path.to_owned(), line: row.line() })?;
        mediapipe::in_pixels(&mut points, number(width)?, number(height)?);
    }
    if points.len() != LANDMARK_COUNT {
        points = mediapipe::landmarks(&points);
    }
    Ok(Row { frame, face, time, points: Some(points) })
}

/// Whether a row states that the face was not found.
fn is_lost(row: &CsvRow<'_>, columns: &Columns, least: f64) -> Result<bool, LandmarksError> {
    let given = |column: Option<usize>| column.filter(|&k| !is_missing(row.get(k)));
    let number = |k: usize| row.number(k).map_err(|error| explained(error, row.get(k)));
    if let Some(k) = given(columns.success) {
        // Also in the spelling of pandas.
        let failed = match row.get(k).trim().to_lowercase().as_str() {
            "true" => false,
            "false" => true,
            _ => number(k)? <= 0.0,
        };
        if failed {
            return Ok(true);
        }
    }
    if let Some(k) = given(columns.confidence)
        && number(k)? < least
    {
        return Ok(true);
    }
    Ok(columns.points.iter().any(|&(x, y)| is_missing(row.get(x)) || is_missing(row.get(y))))
}

fn is_missing(field: &str) -> bool {
    field.is_empty() || is_missing_word(field)
}

/// An error of the table that mentions decimal commas if they are the cause.
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
