//! Options and the wireframe.

use std::sync::{Arc, Mutex, PoisonError};

use grimace::internal::{
    normalize::Canonical,
    pipeline::{Method, PipelineOptions, Workbench},
    wireframe::Face,
};
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::{exceptions::PyValueError, prelude::*, types::PyDict};

use crate::{
    arrays::points_array,
    errors::{GrimaceError, to},
};

/// The workbench that was used last, and its options: calls in a loop share it.
static LAST: Mutex<Option<(String, Arc<Workbench>)>> = Mutex::new(None);

/// The workbench with options as [`default_options`] gives them.
pub fn bench(options: &str) -> PyResult<Arc<Workbench>> {
    let last = || LAST.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((known, bench)) = &*last()
        && known == options
    {
        return Ok(Arc::clone(bench));
    }
    let parsed: PipelineOptions =
        serde_json::from_str(options).map_err(|e| PyValueError::new_err(format!("options: {}", without_place(&e))))?;
    let bench = Arc::new(Workbench::new(None, parsed).map_err(to::<GrimaceError>)?);
    *last() = Some((options.to_owned(), Arc::clone(&bench)));
    Ok(bench)
}

/// What is wrong with an option, without the place in a text that the caller never saw.
pub fn without_place(error: &serde_json::Error) -> String {
    let text = error.to_string();
    text.rsplit_once(" at line ").map_or(text.clone(), |(said, _)| said.to_owned())
}

/// The options of every stage with a method, as JSON.
#[pyfunction]
pub fn default_options(method: &str) -> PyResult<String> {
    let method: Method = serde_json::from_value(method.into())
        .map_err(|_| PyValueError::new_err(format!("the method `{method}` is not known; `default` and `kp` are")))?;
    let options = PipelineOptions {
        fit: method.fit(),
        track: method.track(),
        normalize: method.normalize(),
        statistics: method.statistics(),
        ..PipelineOptions::default()
    };
    serde_json::to_string(&options).map_err(to::<GrimaceError>)
}

/// Candide-3: neutral nodes, triangles, edges, live nodes.
#[pyfunction]
pub fn candide3(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let face = Face::candide3();
    let neutral = Canonical::new(&face.wireframe, &face.tables).map_err(to::<GrimaceError>)?.neutral;
    let triangles: Vec<i64> = face.wireframe.triangles().iter().flatten().map(|n| i64::from(n.0)).collect();
    let edges: Vec<i64> = face.wireframe.edges().iter().flat_map(|(a, b)| [i64::from(a.0), i64::from(b.0)]).collect();
    let live: Vec<i64> = face.wireframe.live_nodes().iter().map(|n| i64::from(n.0)).collect();
    let out = PyDict::new(py);
    out.set_item("neutral", points_array(py, neutral.nodes())?)?;
    let (triangle_count, edge_count) = (triangles.len() / 3, edges.len() / 2);
    out.set_item("triangles", triangles.into_pyarray(py).reshape([triangle_count, 3])?)?;
    out.set_item("edges", edges.into_pyarray(py).reshape([edge_count, 2])?)?;
    out.set_item("live", live.into_pyarray(py))?;
    Ok(out)
}
