//! Faces found, and the wireframe fitted.

use std::path::PathBuf;

use grimace::internal::{
    correspondence::{Correspondence, MarkKind, validate_correspondences},
    locate::{LocateOptions, Locator},
    track::eye_distance_px,
};
use numpy::IntoPyArray;
use pyo3::{
    prelude::*,
    types::{PyDict, PyList},
};

use crate::{
    arrays::{MarkTuple, Marks, Picture, known_or_nan, marks_or_found, points_array},
    bench::bench,
    errors::{FitError, LocateError, to},
    long::run_long,
};

/// The faces of a picture, the largest first.
#[pyfunction]
pub fn locate<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    most_faces: usize,
    least_eye_distance: Option<f64>,
    every_size: bool,
) -> PyResult<Bound<'py, PyList>> {
    let picture = Picture::of(image)?;
    let options = LocateOptions { most_faces, least_eye_distance, every_size };
    let faces = run_long(py, None, false, move |_| {
        let (frame, colour) = picture.portrait()?;
        let mut faces = Locator::shipped().map_err(to::<LocateError>)?.locate(frame.image(), &options);
        faces.iter_mut().for_each(|face| _ = face.look_for_teeth(&colour));
        Ok(faces)
    })?;
    let out = PyList::empty(py);
    for face in &faces {
        let row = PyDict::new(py);
        let points: Vec<_> = face.points.iter().map(|p| p.position).collect();
        row.set_item("nodes", face.points.iter().map(|p| i64::from(p.node.0)).collect::<Vec<_>>().into_pyarray(py))?;
        row.set_item("points", points_array(py, &points)?)?;
        row.set_item("expected_errors", face.points.iter().map(|p| p.expected_error).collect::<Vec<_>>().into_pyarray(py))?;
        row.set_item("eye_distance", face.eye_distance)?;
        row.set_item("score", face.score)?;
        row.set_item("expected_error", face.expected_error())?;
        row.set_item("trusted", face.trusted())?;
        row.set_item("covered", face.covered.iter().map(|part| part.name()).collect::<Vec<_>>())?;
        out.append(row)?;
    }
    Ok(out)
}

pub fn mark_tuples(marks: &[Correspondence]) -> Vec<MarkTuple> {
    let tuple = |m: &Correspondence| (m.node.to_string(), m.position.x, m.position.y, m.kind == MarkKind::Hard, m.expected_error);
    marks.iter().map(tuple).collect()
}

/// The marks of a file.
#[pyfunction]
pub fn read_marks(path: PathBuf) -> PyResult<Vec<MarkTuple>> {
    let bench = bench(&crate::bench::default_options("default")?)?;
    Ok(mark_tuples(&Marks::File(path).read(&bench)?))
}

/// One fit.
#[pyfunction]
pub fn fit<'py>(py: Python<'py>, image: &Bound<'py, PyAny>, marks: Option<Marks>, options: &str) -> PyResult<Bound<'py, PyDict>> {
    let picture = Picture::of(image)?;
    let bench = bench(options)?;
    let used = std::sync::Arc::clone(&bench);
    let (fitted, size) = run_long(py, None, false, move |_| {
        let (frame, colour) = picture.portrait()?;
        let marks = marks_or_found(marks.as_ref(), (&frame, Some(&colour)), &used)?.0.marks;
        let size = frame.size();
        validate_correspondences(&marks, size.width, size.height).map_err(to::<FitError>)?;
        Ok((used.fit(&marks).map_err(to::<FitError>)?, size))
    })?;
    let nodes = fitted.model.nodes();
    let out = PyDict::new(py);
    out.set_item("nodes", points_array(py, nodes)?)?;
    out.set_item("marks", mark_tuples(&fitted.correspondences))?;
    out.set_item("residuals", fitted.residuals.clone().into_pyarray(py))?;
    out.set_item("expected_errors", known_or_nan(py, fitted.correspondences.iter().map(|m| m.expected_error)))?;
    out.set_item("warnings", fitted.warnings.iter().map(ToString::to_string).collect::<Vec<_>>())?;
    out.set_item("size", (size.width, size.height))?;
    out.set_item("eye_distance", eye_distance_px(&bench.tables, nodes))?;
    out.set_item("roll", -fitted.image_from_face.angle.to_degrees())?;
    Ok(out)
}
