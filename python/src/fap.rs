//! FAP files.

use std::path::PathBuf;

use grimace::internal::fap::{
    FapCatalog, FapFrame, FapNumber, FapSequence, Profile, ValueFormat, check_fap, name_token, read_fap, write_fap_as,
};
use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::{exceptions::PyValueError, prelude::*, types::PyDict};

use crate::{
    arrays::model_of,
    bench::{bench, default_options},
    errors::{FapError, GrimaceError, InputError, to},
};

/// Columns of an array of FAP values: FAP n is column n - 1.
const COLUMNS: usize = FapNumber::COUNT;

/// Fields of FAPs 1 and 2 of a frame: frame, FAP, integers.
type Fields = Vec<(usize, u8, Vec<i32>)>;

fn values_array<'py>(py: Python<'py>, sequence: &FapSequence) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let values: Vec<f64> =
        sequence.frames.iter().flat_map(|frame| FapNumber::all().map(|fap| frame.value(fap).unwrap_or(f64::NAN))).collect();
    values.into_pyarray(py).reshape([sequence.frames.len(), COLUMNS])
}

fn as_dict<'py>(py: Python<'py>, sequence: &FapSequence) -> PyResult<Bound<'py, PyDict>> {
    let fields: Fields = (0..)
        .zip(&sequence.frames)
        .flat_map(|(k, frame)| {
            let of = move |fap: FapNumber| frame.fields(fap).map(|f| (k, fap.get(), f.to_vec()));
            [FapNumber::VISEME, FapNumber::EXPRESSION].into_iter().filter_map(of)
        })
        .collect();
    let out = PyDict::new(py);
    out.set_item("name", &sequence.name)?;
    out.set_item("version", &sequence.version)?;
    out.set_item("fps", sequence.fps)?;
    out.set_item("values", values_array(py, sequence)?)?;
    out.set_item("fields", fields)?;
    Ok(out)
}

/// A FAP file.
#[pyfunction]
pub fn fap_read(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    as_dict(py, &read_fap(&path).map_err(to::<FapError>)?.sequence)
}

/// The sequence of an array of values, frames x 68, NaN where a FAP is masked out.
pub fn sequence_of(name: &str, fps: f64, values: &PyReadonlyArray2<'_, f64>, fields: Fields) -> PyResult<FapSequence> {
    let values = values.as_array();
    if values.shape()[1] != COLUMNS {
        return Err(to::<FapError>(format!("an array of shape {:?} holds no FAPs; frames x {COLUMNS} does", values.shape())));
    }
    let mut frames: Vec<FapFrame> = values
        .rows()
        .into_iter()
        .map(|row| {
            let mut frame = FapFrame::default();
            for (fap, &value) in FapNumber::all().zip(row) {
                frame.set_value(fap, (!value.is_nan()).then_some(value));
            }
            frame
        })
        .collect();
    for (frame, fap, integers) in fields {
        let fap = FapNumber::try_from(fap).map_err(to::<FapError>)?;
        if let Some(frame) = frames.get_mut(frame) {
            frame.set_fields(fap, Some(integers));
        }
    }
    Ok(FapSequence { version: "2.1".to_owned(), name: name_token(name), fps, frames })
}

/// Writes a FAP file; values are rounded unless floats are asked for.
#[pyfunction]
pub fn fap_write(
    path: PathBuf,
    header: (String, f64),
    values: PyReadonlyArray2<'_, f64>,
    fields: Fields,
    profile: &str,
    floats: bool,
) -> PyResult<()> {
    let profile: Profile = profile.parse().map_err(PyValueError::new_err::<String>)?;
    let mut sequence = sequence_of(&header.0, header.1, &values, fields)?;
    profile.prepare(&mut sequence);
    if !floats {
        sequence.round();
    }
    let format = if floats { ValueFormat::Float } else { ValueFormat::Integer };
    write_fap_as(&path, &sequence, profile, format).map_err(to::<FapError>)?;
    Ok(())
}

/// What is found in a file: JSON, as of `grimace fap check --json`.
#[pyfunction]
pub fn fap_check(path: PathBuf) -> PyResult<String> {
    let bytes = grimace::internal::input::read(&path).map_err(|e| to::<InputError>(format!("{}: {e}", path.display())))?;
    serde_json::to_string(&check_fap(&bytes)).map_err(to::<GrimaceError>)
}

/// FAP, frame and limit of a value that was limited.
type Limited = (u8, usize, i32);

/// The FAPs of a normalized model, as of the file that `run` writes; and FAP, frame and limit of values that were limited.
#[pyfunction]
pub fn fap_from_model<'py>(
    py: Python<'py>,
    model: PyReadonlyArray3<'py, f64>,
    name: &str,
    fps: u32,
    between: usize,
) -> PyResult<(Bound<'py, PyDict>, Vec<Limited>)> {
    let bench = bench(&default_options("default")?)?;
    let fapus = bench.normalizer().map_err(to::<FapError>)?.canonical().fapus;
    let model = model_of(&model)?;
    let (sequence, limited) =
        FapSequence::from_model(&model, &fapus, FapCatalog::mpeg4(), name, fps, between).map_err(to::<FapError>)?;
    let limited = limited.iter().map(|c| (c.fap.get(), c.frame, c.limit)).collect();
    Ok((as_dict(py, &sequence)?, limited))
}
