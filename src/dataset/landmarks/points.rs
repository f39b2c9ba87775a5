//! Reads files of one frame: iBUG's `.pts`, and CK+'s lines of two numbers.

use std::path::Path;

use nalgebra::Point2;

use super::{Form, LANDMARK_COUNT, LandmarksError, form_of, has_extension};
use crate::text::excerpt;

/// Number of the first row and column in a `.pts` file (its authors use MATLAB).
const PTS_FIRST_PIXEL: f64 = 1.0;

/// Reads the points of a file, in the form of its content; a file named `.pts` as that, so that the error names what it lacks.
pub(in super::super) fn read(path: &Path) -> Result<Vec<Point2<f64>>, LandmarksError> {
    let bytes = crate::input::read(path).map_err(|reason| LandmarksError::Io { path: path.to_owned(), reason })?;
    let text = String::from_utf8_lossy(&bytes);
    let text = text.trim_start_matches('\u{FEFF}');
    let form = if has_extension(path, &["pts"]) { Form::Pts } else { form_of(path) };
    // The numbers as they stand in the file, and the number that its first pixel has.
    let (written, first_pixel) = match form {
        Form::Pts => (read_pts(path, text)?, PTS_FIRST_PIXEL),
        Form::Text | Form::Table | Form::Other => (read_text(path, text)?, 0.0),
    };
    if written.len() != LANDMARK_COUNT {
        return Err(LandmarksError::Count { path: path.to_owned(), found: written.len() });
    }
    if super::mediapipe::is_normalized(&written) {
        return Err(LandmarksError::NormalizedFile { path: path.to_owned() });
    }
    Ok(written.iter().map(|p| p - nalgebra::Vector2::repeat(first_pixel)).collect())
}

/// A line `x y` for each point.
fn read_text(path: &Path, text: &str) -> Result<Vec<Point2<f64>>, LandmarksError> {
    numbered_lines(text).map(|(line, content)| point(path, line, content)).collect()
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
        points.push(point(path, line, content)?);
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
