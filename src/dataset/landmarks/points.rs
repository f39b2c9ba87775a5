//! Reads files of one frame: iBUG's `.pts`, and CK+'s lines of two numbers.

use std::path::Path;

use nalgebra::Point2;

use super::{Form, LANDMARK_COUNT, LandmarksError, form_of};
use crate::text::excerpt;

/// Number of the first row and column in a `.pts` file (its authors use MATLAB).
const PTS_FIRST_PIXEL: f64 = 1.0;

/// Reads the points of a file, in the form of its content.
pub(in super::super) fn read(path: &Path) -> Result<Vec<Point2<f64>>, LandmarksError> {
    let bytes = crate::input::read(path).map_err(|reason| LandmarksError::Io { path: path.to_owned(), reason })?;
    let text = String::from_utf8_lossy(&bytes);
    let text = text.trim_start_matches('\u{FEFF}');
    let has_pts_name = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("pts"));
    let points = match form_of(path) {
        Form::Pts => read_pts(path, text)?,
        _ if has_pts_name => read_pts(path, text)?,
        _ => numbered_lines(text).map(|(line, content)| point(path, line, content)).collect::<Result<_, _>>()?,
    };
    let from_zero: Vec<Point2<f64>> = match form_of(path) {
        Form::Pts => points.iter().map(|p| p + nalgebra::Vector2::repeat(PTS_FIRST_PIXEL)).collect(),
        _ => points.clone(),
    };
    if points.len() == LANDMARK_COUNT && super::mediapipe::is_normalized(&from_zero) {
        Err(LandmarksError::NormalizedFile { path: path.to_owned() })
    } else if points.len() == LANDMARK_COUNT {
        Ok(points)
    } else {
        Err(LandmarksError::Count { path: path.to_owned(), found: points.len() })
    }
}

/// Non-blank lines, trimmed, with their numbers from 1.
fn numbered_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    (1..).zip(text.lines().map(str::trim)).filter(|(_, content)| !content.is_empty())
}

/// Parses two finite numbers separated by white space.
fn point(path: &Path, line: usize, content: &str) -> Result<Point2<f64>, LandmarksError> {
    let fields = |text: &str| -> Vec<Option<f64>> {
        text.split_whitespace().map(|f| f.parse().ok().filter(|v: &f64| v.is_finite())).collect()
    };
    match fields(content)[..] {
        [Some(x), Some(y)] => Ok(Point2::new(x, y)),
        _ if matches!(fields(&content.replace(',', "."))[..], [Some(_), Some(_)]) => {
            Err(LandmarksError::DecimalComma { path: path.to_owned(), line, found: excerpt(content) })
        }
        _ => Err(LandmarksError::Line { path: path.to_owned(), line, found: excerpt(content) }),
    }
}

/// `version: 1`, `n_points: 68`, `{`, points, `}`; further lines are ignored.
fn read_pts(path: &Path, text: &str) -> Result<Vec<Point2<f64>>, LandmarksError> {
    let error =
        |line: usize, found: &str, expected| LandmarksError::Pts { path: path.to_owned(), line, found: excerpt(found), expected };
    let mut declared = None;
    let mut lines = numbered_lines(text);
    loop {
        let Some((line, content)) = lines.next() else { return Err(error(text.lines().count(), "", "`{`")) };
        match content.split_once(':').map(|(key, value)| (key.trim(), value.trim())) {
            Some(("n_points", count)) => {
                declared = Some(count.parse::<usize>().map_err(|_| error(line, content, "a number of points"))?);
            }
            Some(_) => {}
            None if content == "{" => break,
            None => return Err(error(line, content, "`{`")),
        }
    }
    let mut points = Vec::new();
    let mut closed = false;
    for (line, content) in lines {
        if content == "}" {
            closed = true;
            break;
        }
        points.push(point(path, line, content)? - nalgebra::Vector2::repeat(PTS_FIRST_PIXEL));
    }
    if !closed {
        return Err(error(text.lines().count(), text.lines().last().unwrap_or_default().trim(), "`}` after the last point"));
    }
    match declared.filter(|&declared| declared != points.len()) {
        Some(declared) => Err(error(
            numbered_lines(text).find(|(_, content)| content.starts_with("n_points")).map_or(1, |(line, _)| line),
            &format!("n_points: {declared}"),
            if declared == LANDMARK_COUNT { "the number of points that follow" } else { "n_points: 68" },
        )),
        None => Ok(points),
    }
}
