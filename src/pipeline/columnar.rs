//! Models in one columnar file, written beside the CSV files and read as input of the statistics.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use super::{
    AmplitudeResults, Analysis, AnalysisError, AnalyzedModel, Workbench,
    classes::{class, unique_stem, warnings},
};
use crate::{
    columnar::{ColumnarError, ColumnarModels, ColumnarRow, ColumnarWriter},
    statistics::{ClassLabel, EMOTIONS, SequenceModel, scale::representative_of_many},
};

/// Writes models, sorted by id, with all metadata columns that occur. Returns the BLAKE3 of the file.
///
/// # Errors
/// [`ColumnarError`] when the file cannot be written.
pub fn write_columnar(path: &Path, models: &[AnalyzedModel]) -> Result<blake3::Hash, ColumnarError> {
    let models: Vec<&AnalyzedModel> = models.iter().filter(|m| !m.is_left_out()).collect();
    let columns: BTreeSet<&String> = models.iter().flat_map(|m| m.metadata.keys()).collect();
    let columns: Vec<String> = columns.into_iter().cloned().collect();
    let (frames, nodes) = models.first().map_or((2, 1), |m| (m.model.model.frame_count(), m.model.model.node_count()));
    let mut sorted = models;
    sorted.sort_by(|a, b| a.model.id.cmp(&b.model.id));
    let mut writer = ColumnarWriter::create(path, &columns, frames, nodes)?;
    for m in sorted {
        let metadata = columns.iter().map(|column| m.metadata.get(column).cloned().unwrap_or_default()).collect();
        writer.push(ColumnarRow::new(m.model.id.clone(), m.emotion.clone(), metadata, &m.model.model))?;
    }
    writer.finish()
}

/// Loads all models of a file into memory.
///
/// # Errors
/// [`ColumnarError`].
pub fn load_columnar(file: &ColumnarModels) -> Result<Vec<AnalyzedModel>, ColumnarError> {
    let models = file.models()?.into_iter().enumerate();
    let analyzed = models.map(|(row, model)| AnalyzedModel {
        model: SequenceModel { id: file.ids[row].clone(), model },
        emotion: file.emotions[row].clone(),
        metadata: file.metadata.iter().map(|(name, values)| (name.clone(), values[row].clone())).collect(),
        quality: None,
        course: None,
        pictures: None,
        marks_from: None,
    });
    Ok(analyzed.collect())
}

/// Computes the representative of every emotion of a file, reading node by node in about `memory` bytes.
///
/// # Errors
/// [`AnalysisError`]; [`AnalysisError::GroupsNeedMemory`] when groups or covariates are requested.
pub fn analyze_columnar(file: &ColumnarModels, bench: &Workbench, memory: u64) -> Result<Analysis, AnalysisError> {
    const MEGABYTE: u64 = 1_000_000;
    if !bench.options.by.is_empty() || !bench.options.covariates.is_empty() {
        return Err(AnalysisError::GroupsNeedMemory { needed: file.memory() / MEGABYTE, allowed: memory / MEGABYTE });
    }
    let normalizer = bench.normalizer()?;
    let fapus = normalizer.canonical().fapus;
    let mut emotions: BTreeMap<(usize, &str), Vec<usize>> = BTreeMap::new();
    for (row, emotion) in file.emotions.iter().enumerate() {
        let rank = EMOTIONS.iter().position(|e| e == emotion).unwrap_or(EMOTIONS.len());
        emotions.entry((rank, emotion)).or_default().push(row);
    }
    let mut stems = BTreeSet::new();
    let mut classes = Vec::new();
    for ((_, emotion), rows) in emotions {
        let label = ClassLabel { emotion: emotion.to_owned(), group: BTreeMap::new() };
        let stem = unique_stem(&label, &mut stems);
        let subjects = rows.iter().map(|&row| file.ids[row].subject.as_str()).collect::<BTreeSet<_>>().len();
        let models = file.class(rows, bench.wireframe.live_nodes());
        let (ids, neutral) = (models.ids(), models.neutral()?);
        let statistics = &bench.options.statistics;
        let representative = representative_of_many(label, ids, neutral, &models, &bench.wireframe, statistics, memory)?;
        classes.push(class(representative, stem, subjects, None, &fapus, bench)?);
    }
    let warnings = warnings(&classes, &bench.options.statistics);
    Ok(Analysis {
        classes,
        comparisons: None,
        sequences: Vec::new(),
        tracks: Vec::new(),
        courses: BTreeMap::new(),
        failures: Vec::new(),
        warnings,
        same: Vec::new(),
        tracked_here: false,
        amplitudes: AmplitudeResults::default(),
        covariates: Vec::new(),
        variations: Vec::new(),
        recognition: None,
    })
}
