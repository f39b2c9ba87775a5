//! Representatives and tests between groups.

use std::collections::BTreeMap;

use grimace::internal::{
    statistics::{
        self, ClassLabel, SequenceModel,
        compare::{CompareOptions, Comparison, adjust},
    },
    units::SequenceId,
};
use numpy::{IntoPyArray, PyReadonlyArray3};
use pyo3::{prelude::*, types::PyDict};

use crate::{
    arrays::{known_or_nan, model_array, model_of},
    bench::bench,
    errors::{GrimaceError, StatisticsError, to},
    long::run_long,
};

/// A model as Python gives it: subject, sequence, frames x nodes x 2.
type Model<'py> = (String, String, PyReadonlyArray3<'py, f64>);

fn sequence_models(models: Vec<Model<'_>>) -> PyResult<Vec<SequenceModel>> {
    let one = |(subject, sequence, array): Model<'_>| {
        Ok(SequenceModel { id: SequenceId { subject, sequence }, model: model_of(&array)? })
    };
    models.into_iter().map(one).collect()
}

/// The representative of models.
#[pyfunction]
pub fn representative<'py>(
    py: Python<'py>,
    models: Vec<Model<'py>>,
    emotion: String,
    options: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let bench = bench(options)?;
    let models = sequence_models(models)?;
    let found = run_long(py, None, false, move |_| {
        let label = ClassLabel { emotion, group: BTreeMap::new() };
        statistics::representative(label, &models, &bench.wireframe, &bench.options.statistics).map_err(to::<StatisticsError>)
    })?;
    let json = |value: serde_json::Result<String>| value.map_err(to::<GrimaceError>);
    let ids = |ids: &[SequenceId]| ids.iter().map(|id| (id.subject.clone(), id.sequence.clone())).collect::<Vec<_>>();
    let trimming: Vec<_> =
        found.trimming.iter().map(|r| (r.field, r.id.subject.clone(), r.id.sequence.clone(), r.distance, r.dropped)).collect();
    let out = PyDict::new(py);
    out.set_item("model", model_array(py, &found.model)?)?;
    out.set_item("sequences", ids(&found.sequences))?;
    out.set_item("distances", known_or_nan(py, found.distances.iter().copied()))?;
    out.set_item("dispersion", found.dispersion)?;
    out.set_item("dispersion_untrimmed", found.dispersion_untrimmed)?;
    out.set_item("node_dispersion", found.node_dispersion.into_pyarray(py))?;
    out.set_item("trimming", trimming)?;
    out.set_item("sums", json(serde_json::to_string(&found.sums))?)?;
    out.set_item("search", json(serde_json::to_string(&found.search))?)?;
    out.set_item("weighted", found.weighted)?;
    Ok(out)
}

/// All pairs of groups, compared and corrected for their number; JSON.
#[pyfunction]
pub fn compare(
    py: Python<'_>,
    groups: Vec<(String, Vec<Model<'_>>)>,
    emotion: String,
    settings: (usize, usize, u64, f64),
    options: &str,
) -> PyResult<String> {
    let bench = bench(options)?;
    let groups = groups
        .into_iter()
        .map(|(name, models)| Ok((name, sequence_models(models)?)))
        .collect::<PyResult<Vec<(String, Vec<SequenceModel>)>>>()?;
    let (permutations, people, seed, significance) = settings;
    let options = CompareOptions { permutations, people, significance, seed };
    let compared = run_long(py, None, false, move |_| {
        // Models that cannot be compared give the same errors as for a representative.
        let all: Vec<&SequenceModel> = groups.iter().flat_map(|(_, models)| models).collect();
        let label = ClassLabel { emotion: emotion.clone(), group: BTreeMap::new() };
        statistics::check_models(&label, &all, &bench.wireframe).map_err(to::<StatisticsError>)?;
        let live = bench.wireframe.live_nodes();
        let mut pairs = Vec::new();
        for (i, (a, of_a)) in groups.iter().enumerate() {
            for (b, of_b) in &groups[i + 1..] {
                let (of_a, of_b): (Vec<_>, Vec<_>) = (of_a.iter().collect(), of_b.iter().collect());
                let stream = u32::try_from(pairs.len()).unwrap_or(u32::MAX);
                let outcome = statistics::compare::compare(&of_a, &of_b, live, &options, None, stream);
                let named = |value: &String| BTreeMap::from([("group".to_owned(), value.clone())]);
                let people = |models: &[&SequenceModel]| {
                    models.iter().map(|m| m.id.subject.as_str()).collect::<std::collections::BTreeSet<_>>().len()
                };
                pairs.push(Comparison {
                    emotion: emotion.clone(),
                    groups: [named(a), named(b)],
                    people: [people(&of_a), people(&of_b)],
                    sequences: [of_a.len(), of_b.len()],
                    outcome,
                });
            }
        }
        adjust(&mut pairs);
        Ok(pairs)
    })?;
    let told = compared.iter().map(|pair| {
        let mut told = serde_json::to_value(pair)?;
        told["reason"] = pair.outcome.as_ref().err().map(ToString::to_string).into();
        Ok(told)
    });
    let told: serde_json::Result<Vec<serde_json::Value>> = told.collect();
    told.and_then(|told| serde_json::to_string(&told)).map_err(to::<GrimaceError>)
}
