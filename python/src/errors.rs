//! Exceptions: one for each stage, all of them `GrimaceError`, with the library's own sentences.

use std::fmt::Display;

use grimace::internal::{pipeline::SequenceFailure, report::Stage};
use pyo3::{PyTypeInfo, create_exception, exceptions::PyException, prelude::*};

create_exception!(grimace, GrimaceError, PyException, "Something that grimace cannot do, with the reason.");
create_exception!(grimace, InputError, GrimaceError, "A file, picture or array that does not read.");
create_exception!(grimace, LocateError, GrimaceError, "No face was found, or none that is trusted.");
create_exception!(grimace, FitError, GrimaceError, "The wireframe cannot be fitted to the marks.");
create_exception!(grimace, TrackError, GrimaceError, "A sequence cannot be tracked.");
create_exception!(grimace, NormalizeError, GrimaceError, "A track cannot be normalized.");
create_exception!(grimace, StatisticsError, GrimaceError, "Models have no representative, or groups cannot be compared.");
create_exception!(grimace, FapError, GrimaceError, "A FAP file does not read, or cannot be written.");
create_exception!(grimace, CloneError, GrimaceError, "An expression cannot be put on a face.");
create_exception!(grimace, SynthesisError, GrimaceError, "A motion cannot be synthesized.");
create_exception!(grimace, RunError, GrimaceError, "A run ended without results.");

/// Adds the exceptions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("GrimaceError", py.get_type::<GrimaceError>())?;
    module.add("InputError", py.get_type::<InputError>())?;
    module.add("LocateError", py.get_type::<LocateError>())?;
    module.add("FitError", py.get_type::<FitError>())?;
    module.add("TrackError", py.get_type::<TrackError>())?;
    module.add("NormalizeError", py.get_type::<NormalizeError>())?;
    module.add("StatisticsError", py.get_type::<StatisticsError>())?;
    module.add("FapError", py.get_type::<FapError>())?;
    module.add("CloneError", py.get_type::<CloneError>())?;
    module.add("SynthesisError", py.get_type::<SynthesisError>())?;
    module.add("RunError", py.get_type::<RunError>())
}

/// A library's error as an exception of the kind `E`.
pub fn to<E: PyTypeInfo>(error: impl Display) -> PyErr {
    PyErr::new::<E, _>(error.to_string())
}

/// The exception of the stage at which a sequence failed.
pub fn of_stage(failure: &SequenceFailure) -> PyErr {
    let reason = &failure.reason;
    match failure.stage {
        Stage::Dataset => to::<InputError>(reason),
        Stage::Fit => to::<FitError>(reason),
        Stage::Track => to::<TrackError>(reason),
        Stage::Normalize => to::<NormalizeError>(reason),
        _ => to::<GrimaceError>(reason),
    }
}
