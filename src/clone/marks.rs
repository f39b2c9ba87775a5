//! Marks of a target: correspondences, or 68 landmarks of one picture.

use std::path::Path;

use nalgebra::Point2;

use super::CloneError;
use crate::{
    dataset::{LandmarkSelection, correspondences_from_landmarks},
    fit::{Correspondence, read_correspondences},
    input::CsvFile,
    wireframe::Face,
};

/// Landmarks of the scheme.
const LANDMARKS: usize = 68;

/// Reads the marks of a picture: `node,x,y[,kind]`, or the 68 landmarks as `point,x,y` with points 0 to 67, of which `selection` takes
/// those that are nodes.
///
/// # Errors
/// [`CloneError`] for a file that is neither or does not read.
pub fn read_marks(path: &Path, selection: &LandmarkSelection, face: &Face) -> Result<Vec<Correspondence>, CloneError> {
    let file = CsvFile::open(path)?;
    if file.column("node").is_some() || file.column("point").is_none() {
        return Ok(read_correspondences(path, &face.tables, face.wireframe.node_count())?);
    }
    let [point, x, y] = file.require(["point", "x", "y"])?;
    let mut points = vec![None; LANDMARKS];
    for row in file.rows() {
        let row = row?;
        let number = row.whole_number(point)? as usize;
        let slot = points.get_mut(number).ok_or_else(|| row.field_error(point, "a landmark from 0 to 67"))?;
        *slot = Some(Point2::new(row.number(x)?, row.number(y)?));
    }
    let found = points.iter().flatten().count();
    let points: Option<Vec<Point2<f64>>> = points.into_iter().collect();
    let points = points.ok_or_else(|| CloneError::Landmarks { path: path.to_owned(), found })?;
    Ok(correspondences_from_landmarks(&points, &face.tables, selection)?)
}
