//! Time and memory of the statistics against the number of models, on synthetic models in a columnar file.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    time::Instant,
};

use rayon::prelude::*;

use super::{Cell, SyntheticPeople, Table};
use grimace::internal::{
    columnar::{ColumnarError, ColumnarModels, ColumnarRow, ColumnarWriter},
    normalize::FRAMES_PER_MODEL,
    statistics::{
        ClassLabel, MedianKind, StatisticsError, StatisticsOptions,
        scale::{SlotSource, representative_of_many},
    },
    units::SequenceId,
    wireframe::FapusError,
};

/// Options of the measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct ScaleOptions {
    /// Numbers of models, ascending.
    pub models: Vec<usize>,
    /// Largest number of models for which trimming is measured.
    pub trim_up_to: usize,
    /// Share of models to trim.
    pub alpha: f64,
    /// Memory limit of the statistics, bytes.
    pub memory: u64,
    /// Seed of the models.
    pub seed: u64,
}

/// One measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct ScaleRow {
    /// Number of models N''.
    pub models: usize,
    /// Share trimmed; 0 without trimming.
    pub alpha: f64,
    /// Wall time of reading, trimming, both medians and dispersions, seconds.
    pub seconds: f64,
    /// Processor time of all threads for the same work, seconds; `None` when the system does not report it.
    pub cpu_seconds: Option<f64>,
    /// Largest resident memory during this work, MB; `None` when the system does not report it.
    pub peak_mb: Option<f64>,
    /// Numbers of (field, model) pairs whose trimming was computed exactly, and whose trimming rounding leaves open; `None` without
    /// trimming.
    pub exact_and_open: Option<(usize, usize)>,
    /// Relative gap between the sum of distances of the median and its proven lower bound.
    pub certificate_gap: f64,
    /// Dispersion, face units.
    pub dispersion: f64,
    /// Size of the file, MB.
    pub file_mb: f64,
    /// Time to make and write the models, seconds.
    pub write_seconds: f64,
}

/// Why the measurement failed.
#[derive(Debug, thiserror::Error)]
pub enum ScaleError {
    /// The FAPUs of Candide-3 cannot be measured.
    #[error(transparent)]
    Fapus(#[from] FapusError),
    /// The file of models cannot be read or written.
    #[error(transparent)]
    Columnar(#[from] ColumnarError),
    /// The statistics failed.
    #[error(transparent)]
    Statistics(#[from] StatisticsError),
}

/// Number of models made at once.
const CHUNK: usize = 4096;

/// Writes synthetic models of one emotion to a columnar file.
///
/// # Errors
/// [`ScaleError`] when the file cannot be written.
pub fn write_synthetic_models(path: &Path, count: usize, seed: u64) -> Result<(), ScaleError> {
    let people = SyntheticPeople::new(seed)?;
    let mut writer = ColumnarWriter::create(path, &[], FRAMES_PER_MODEL, people.wireframe().node_count())?;
    let mut start = 0;
    while start < count {
        let end = count.min(start + CHUNK);
        let row = |i: usize| ColumnarRow {
            id: SequenceId { subject: format!("p{i:08}"), sequence: "1".to_owned() },
            emotion: "happiness".to_owned(),
            metadata: Vec::new(),
            coordinates: people.frames(i as u64, 1.0).iter().flatten().flat_map(|p| [p.x, p.y]).collect(),
        };
        for row in (start..end).into_par_iter().map(row).collect::<Vec<_>>() {
            writer.push(row)?;
        }
        start = end;
    }
    writer.finish()?;
    Ok(())
}

/// Measures the statistics for every number of models. A temporary file in `folder` holds the models.
///
/// # Errors
/// [`ScaleError`] when the file cannot be written or read, or the statistics fail.
pub fn evaluate_scale(
    options: &ScaleOptions,
    folder: &Path,
    mut tick: impl FnMut(&ScaleRow),
) -> Result<Vec<ScaleRow>, ScaleError> {
    let people = SyntheticPeople::new(options.seed)?;
    let live = people.wireframe().live_nodes();
    let path: PathBuf = folder.join("models.parquet");
    let mut rows = Vec::new();
    for &models in &options.models {
        let started = Instant::now();
        write_synthetic_models(&path, models, options.seed)?;
        let write_seconds = started.elapsed().as_secs_f64();
        let file_mb = std::fs::metadata(&path).map_or(0.0, |m| m.len() as f64 / 1e6);
        for alpha in [options.alpha, 0.0] {
            if alpha > 0.0 && models > options.trim_up_to {
                continue;
            }
            reset_peak();
            let (started, cpu) = (Instant::now(), cpu_seconds());
            let file = ColumnarModels::open(&path)?;
            let class = file.class((0..file.row_count()).collect(), live);
            let (ids, neutral) = (class.ids(), class.neutral()?);
            let label = ClassLabel { emotion: "happiness".to_owned(), group: BTreeMap::new() };
            let statistics = StatisticsOptions { alpha, median: MedianKind::Exact, ..StatisticsOptions::default() };
            let source: &ColumnarClassRef<'_> = &class;
            let r = representative_of_many(label, ids, neutral, source, people.wireframe(), &statistics, options.memory)?;
            let row = ScaleRow {
                models,
                alpha,
                seconds: started.elapsed().as_secs_f64(),
                cpu_seconds: cpu.and_then(|before| Some(cpu_seconds()? - before)),
                peak_mb: peak_mb(),
                exact_and_open: r.certificate.as_ref().map(|c| (c.decided_exactly, c.undecided.len())),
                certificate_gap: r.sums.certificate_gap,
                dispersion: r.dispersion.unwrap_or(0.0),
                file_mb,
                write_seconds,
            };
            debug_assert_eq!(source.model_count(), models);
            tick(&row);
            rows.push(row);
        }
        // A failure to remove the temporary file is ignored.
        let _ = std::fs::remove_file(&path);
    }
    Ok(rows)
}

type ColumnarClassRef<'a> = grimace::internal::columnar::ColumnarClass<'a>;

/// Resets the measurement of the largest resident memory, if the system supports it.
fn reset_peak() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// Returns the largest resident memory since the start or the last [`reset_peak`], MB.
fn peak_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.split_whitespace().next()?.parse::<f64>().ok().map(|kb| kb * 1024.0 / 1e6)
}

/// Returns the processor time of this process so far, seconds.
fn cpu_seconds() -> Option<f64> {
    // Linux counts in hundredths of a second in this file.
    const TICKS: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name may contain spaces; user and system time are the 12th and 13th fields after it.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |place: usize| fields.get(place)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) / TICKS)
}

/// Returns the exponent of the growth of the time without trimming, between the smallest and the largest number of models.
pub fn growth_exponent(rows: &[ScaleRow]) -> Option<f64> {
    let untrimmed: Vec<&ScaleRow> = rows.iter().filter(|row| row.alpha == 0.0).collect();
    let (first, last) = (untrimmed.first()?, untrimmed.last()?);
    // Processor time, if known, does not depend on other programs on the machine.
    let time = |row: &ScaleRow| row.cpu_seconds.filter(|t| *t > 0.0).unwrap_or(row.seconds);
    (last.models > first.models).then(|| (time(last) / time(first)).ln() / (last.models as f64 / first.models as f64).ln())
}

/// Returns a row for each measurement.
pub fn scale_table(rows: &[ScaleRow]) -> Table {
    let mut table = Table::new([
        "models",
        "alpha",
        "seconds",
        "cpu_seconds",
        "peak_mb",
        "decided_exactly",
        "undecided",
        "certificate_gap",
        "dispersion",
        "file_mb",
        "write_seconds",
    ]);
    for row in rows {
        let count = |n: Option<usize>| n.map_or(Cell::Empty, Cell::Count);
        table.rows.push(vec![
            Cell::Count(row.models),
            Cell::Number(row.alpha, 2),
            Cell::Number(row.seconds, 2),
            Cell::maybe(row.cpu_seconds, 2),
            Cell::maybe(row.peak_mb, 0),
            count(row.exact_and_open.map(|(exact, _)| exact)),
            count(row.exact_and_open.map(|(_, open)| open)),
            Cell::Number(row.certificate_gap, 14),
            Cell::Number(row.dispersion, 4),
            Cell::Number(row.file_mb, 0),
            Cell::Number(row.write_seconds, 1),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_numbers_are_measured_and_the_file_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let options = ScaleOptions { models: vec![50, 100], trim_up_to: 50, alpha: 0.1, memory: 1 << 24, seed: 1 };
        let rows = evaluate_scale(&options, folder.path(), |_| {}).unwrap();
        assert_eq!(rows.iter().map(|r| (r.models, r.alpha)).collect::<Vec<_>>(), [(50, 0.1), (50, 0.0), (100, 0.0)]);
        // Trimming lowers the dispersion, and every median is proven.
        assert!(rows[0].dispersion < rows[1].dispersion && rows.iter().all(|r| r.certificate_gap < 1e-10));
        assert!(growth_exponent(&rows).is_some());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
