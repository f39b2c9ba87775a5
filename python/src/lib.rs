//! The native half of the Python package `grimace`: conversions between NumPy and the library, and nothing else.
//!
//! Functions take and give arrays, numbers and JSON texts; the Python half gives them names, defaults, types and documentation. Every call
//! that takes long runs in a thread of its own with the interpreter's lock released (`long`).
#![allow(missing_docs, clippy::pedantic)]

mod arrays;
mod bench;
mod errors;
mod faces;
mod fap;
mod long;
mod making;
mod run;
mod statistics;
mod tracks;

use pyo3::prelude::*;

/// The module `grimace._grimace`.
#[pymodule]
fn _grimace(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    errors::register(module)?;
    module.add_class::<tracks::Track>()?;
    module.add_function(wrap_pyfunction!(bench::default_options, module)?)?;
    module.add_function(wrap_pyfunction!(bench::candide3, module)?)?;
    module.add_function(wrap_pyfunction!(faces::locate, module)?)?;
    module.add_function(wrap_pyfunction!(faces::read_marks, module)?)?;
    module.add_function(wrap_pyfunction!(faces::fit, module)?)?;
    module.add_function(wrap_pyfunction!(tracks::track, module)?)?;
    module.add_function(wrap_pyfunction!(tracks::normalize, module)?)?;
    module.add_function(wrap_pyfunction!(tracks::normalize_positions, module)?)?;
    module.add_function(wrap_pyfunction!(tracks::read_model, module)?)?;
    module.add_function(wrap_pyfunction!(tracks::write_model, module)?)?;
    module.add_function(wrap_pyfunction!(statistics::representative, module)?)?;
    module.add_function(wrap_pyfunction!(statistics::compare, module)?)?;
    module.add_function(wrap_pyfunction!(fap::fap_read, module)?)?;
    module.add_function(wrap_pyfunction!(fap::fap_write, module)?)?;
    module.add_function(wrap_pyfunction!(fap::fap_check, module)?)?;
    module.add_function(wrap_pyfunction!(fap::fap_from_model, module)?)?;
    module.add_function(wrap_pyfunction!(making::clone, module)?)?;
    module.add_function(wrap_pyfunction!(making::synthesize, module)?)?;
    module.add_function(wrap_pyfunction!(run::run, module)?)?;
    Ok(())
}
