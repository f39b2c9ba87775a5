//! Pictures, marks and models between NumPy and the library.

use std::path::PathBuf;

use grimace::internal::{
    correspondence::{Correspondence, MarkKind},
    dataset::{LandmarkSelection, read_marks},
    model::{DynamicExpressionModel, FrameExpressionModel},
    pipeline::{FoundMarks, Workbench, found_marks_and_remark},
    sequence::{Frame, Portrait, grey_of, read_frame},
    track::{Track, track_model},
    units::Unit,
    wireframe::parse_node_or_feature_point,
};
use image::{GrayImage, RgbImage};
use nalgebra::Point2;
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray3, PyReadonlyArrayDyn, PyUntypedArrayMethods,
};
use pyo3::{prelude::*, types::PyString};

use crate::errors::{FitError, InputError, LocateError, to};

/// A picture as Python gives it: the path of a file, or an array of bytes, rows x columns (grey) or rows x columns x 3 (RGB).
pub enum Picture {
    Path(PathBuf),
    Grey(GrayImage),
    Colour(RgbImage),
}

impl Picture {
    pub fn of(object: &Bound<'_, PyAny>) -> PyResult<Self> {
        if object.is_instance_of::<PyString>() || object.hasattr("__fspath__")? {
            return Ok(Self::Path(object.extract()?));
        }
        let array: PyReadonlyArrayDyn<'_, u8> = object.extract().map_err(|_| {
            to::<InputError>("a picture is a path, or an array of uint8: rows x columns (grey) or rows x columns x 3 (RGB)")
        })?;
        let shape = array.shape().to_vec();
        // One copy, whatever the array's strides: Python may change the array while the worker reads it.
        let values: Vec<u8> = array.as_array().iter().copied().collect();
        let side = |n: usize| u32::try_from(n).ok().filter(|&n| n > 0);
        let made = match shape[..] {
            [rows, columns] => side(columns).zip(side(rows)).and_then(|(w, h)| GrayImage::from_raw(w, h, values)).map(Self::Grey),
            [rows, columns, 3] => {
                side(columns).zip(side(rows)).and_then(|(w, h)| RgbImage::from_raw(w, h, values)).map(Self::Colour)
            }
            _ => None,
        };
        made.ok_or_else(|| {
            let shape: Vec<String> = shape.iter().map(ToString::to_string).collect();
            to::<InputError>(format!(
                "an array of shape ({}) is no picture; rows x columns (grey) or rows x columns x 3 (RGB) is",
                shape.join(", ")
            ))
        })
    }

    pub fn frame(self, number: u32) -> PyResult<Frame> {
        match self {
            Self::Path(path) => read_frame(&path).map(|f| Frame::new(number, f.into_image())).map_err(to::<InputError>),
            Self::Grey(image) => Ok(Frame::new(number, image)),
            Self::Colour(image) => Ok(Frame::new(number, grey_of(&image))),
        }
    }

    /// A photograph, as the commands read one: in the grey in which its face is read, and in colour.
    pub fn portrait(self) -> PyResult<(Frame, RgbImage)> {
        let (grey, colour) = match self {
            Self::Path(path) => Portrait::read(&path).map(|read| (read.grey, read.picture)).map_err(to::<InputError>)?,
            Self::Grey(image) => {
                let colour = RgbImage::from_fn(image.width(), image.height(), |x, y| image::Rgb([image.get_pixel(x, y).0[0]; 3]));
                (image, colour)
            }
            Self::Colour(image) => (grey_of(&image), image),
        };
        Ok((Frame::new(0, grey), colour))
    }
}

/// A mark as Python gives it: node or feature point, x, y, whether hard, expected error.
pub type MarkTuple = (String, f64, f64, bool, Option<f64>);

/// Marks as Python gives them.
#[derive(FromPyObject)]
pub enum Marks {
    List(Vec<MarkTuple>),
    File(PathBuf),
}

impl Marks {
    pub fn read(&self, bench: &Workbench) -> PyResult<Vec<Correspondence>> {
        match self {
            Self::File(path) => {
                let (tables, nodes) = (&bench.tables, bench.wireframe.node_count());
                read_marks(path, &LandmarkSelection::HighAndMedium, tables, nodes).map_err(to::<InputError>)
            }
            Self::List(list) => list
                .iter()
                .map(|(node, x, y, hard, expected_error)| {
                    let node =
                        parse_node_or_feature_point(node, &bench.tables, bench.wireframe.node_count()).map_err(to::<FitError>)?;
                    let kind = if *hard { MarkKind::Hard } else { MarkKind::Mark };
                    Ok(Correspondence { node, position: Point2::new(*x, *y), kind, expected_error: *expected_error })
                })
                .collect(),
        }
    }
}

/// The marks given, or those found in the frame, in colour where it is given; and where they come from.
pub fn marks_or_found(
    marks: Option<&Marks>,
    (frame, colour): (&Frame, Option<&RgbImage>),
    bench: &Workbench,
) -> PyResult<(FoundMarks, &'static str)> {
    match marks {
        Some(marks) => Ok((FoundMarks { marks: marks.read(bench)?, ..FoundMarks::default() }, "command line")),
        None => Ok((found_marks_and_remark(frame, colour, bench).map_err(to::<LocateError>)?, "found")),
    }
}

/// A model from an array, frames x nodes x 2.
pub fn model_of<U: Unit>(array: &PyReadonlyArray3<'_, f64>) -> PyResult<DynamicExpressionModel<U>> {
    let array = array.as_array();
    if array.shape()[2] != 2 {
        let message = format!("an array of shape {:?} is no model: frames x nodes x 2 is", array.shape());
        return Err(to::<InputError>(message));
    }
    let frame = |m: usize| {
        FrameExpressionModel::new((0..array.shape()[1]).map(|k| Point2::new(array[[m, k, 0]], array[[m, k, 1]])).collect())
    };
    DynamicExpressionModel::new((0..array.shape()[0]).map(frame).collect()).map_err(to::<InputError>)
}

/// A model as an array, frames x nodes x 2.
pub fn model_array<'py, U: Unit>(py: Python<'py>, model: &DynamicExpressionModel<U>) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let values: Vec<f64> = model.frames().iter().flat_map(|f| f.nodes()).flat_map(|p| [p.x, p.y]).collect();
    values.into_pyarray(py).reshape([model.frame_count(), model.node_count(), 2])
}

/// Points as an array, points x 2.
pub fn points_array<'py>(py: Python<'py>, points: &[Point2<f64>]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let values: Vec<f64> = points.iter().flat_map(|p| [p.x, p.y]).collect();
    values.into_pyarray(py).reshape([points.len(), 2])
}

/// Numbers, those that are not known NaN.
pub fn known_or_nan<'py>(py: Python<'py>, values: impl Iterator<Item = Option<f64>>) -> Bound<'py, PyArray1<f64>> {
    values.map(|v| v.unwrap_or(f64::NAN)).collect::<Vec<_>>().into_pyarray(py)
}

/// The positions of a track, frames x nodes x 2, px.
pub fn positions_of<'py>(py: Python<'py>, track: &Track) -> PyResult<Bound<'py, PyArray3<f64>>> {
    model_array(py, &track_model(&track.frames).map_err(to::<InputError>)?)
}
