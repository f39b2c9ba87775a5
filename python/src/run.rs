//! The main job.

use std::{
    path::PathBuf,
    sync::atomic::{AtomicUsize, Ordering},
};

use grimace::internal::pipeline::{self, Event, RunError as LibraryError, RunSummary};
use pyo3::{exceptions::PyKeyboardInterrupt, prelude::*, types::PyDict};

use crate::{
    bench::bench,
    errors::{RunError, to},
    long::run_long,
};

/// Runs every stage over a dataset. `progress` is told sequences.
#[pyfunction]
pub fn run<'py>(
    py: Python<'py>,
    dataset: PathBuf,
    out: PathBuf,
    overlay: Option<PathBuf>,
    force: bool,
    options: &str,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let bench = bench(options)?;
    let summary: RunSummary = run_long(py, progress, true, move |caller| {
        let (done, total) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let event = |event: Event| match event {
            Event::Started { sequences } => {
                total.store(sequences, Ordering::SeqCst);
                caller.progress(0, Some(sequences));
            }
            Event::Finished { .. } => {
                let done = done.fetch_add(1, Ordering::SeqCst) + 1;
                caller.progress(done, Some(total.load(Ordering::SeqCst)));
            }
            Event::Segmenting { .. } | Event::Frame | Event::Analyzing => {}
        };
        pipeline::run(&dataset, &out, &bench, overlay.as_deref(), force, caller.stop(), event).map_err(|error| match error {
            LibraryError::Interrupted => PyKeyboardInterrupt::new_err(error.to_string()),
            error => to::<RunError>(error),
        })
    })?;
    let failures: Vec<_> =
        summary.failures.iter().map(|f| (f.subject.clone(), f.sequence.clone(), f.stage.to_string(), f.reason.clone())).collect();
    let result = PyDict::new(py);
    result.set_item("sequences", summary.sequences)?;
    result.set_item("tracked", summary.tracked)?;
    result.set_item("reused", summary.reused)?;
    result.set_item("failures", failures)?;
    result.set_item("skipped", summary.skipped)?;
    result.set_item("representatives", summary.representatives)?;
    result.set_item("warnings", summary.warnings)?;
    result.set_item("unchanged", summary.unchanged)?;
    Ok(result)
}
