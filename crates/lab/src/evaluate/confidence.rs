//! The tracker's expected errors: fits the model to samples (`confidence_samples`) and compares expected with true errors.

use grimace::internal::{
    track::{Confidence, NodeFeatures, Verdict, expect_errors, summarize},
    wireframe::{Tables, Wireframe},
};
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::{Cell, ConfidenceSample, ErrorSummary, LineChart, Records, SampledSequence, Series, Table, percentile};

/// Lower limit of the true error before its logarithm is taken, relative to the eye distance: 0.01 px at 100 px.
const ERROR_FLOOR: f64 = 1e-4;
/// Iterations of reweighted least squares.
const ROUNDS: usize = 40;
/// Residuals of the logarithm below this limit get equal weight.
const RESIDUAL_FLOOR: f64 = 0.02;
/// Ridge penalty on the weights, per sample.
const RIDGE: f64 = 1e-4;
/// Number of bins of the calibration.
const BINS: usize = 24;
/// Number of parts in a calibration table.
pub const QUINTILES: usize = 5;

/// Learns weights and calibration from samples. Returns `None` when there are fewer samples than ten times the number of model terms.
#[must_use]
pub fn fit_confidence(sequences: &[SampledSequence]) -> Option<Confidence> {
    let samples: Vec<&ConfidenceSample> = sequences.iter().flat_map(|s| &s.samples).collect();
    let size = NodeFeatures::names().len();
    if samples.len() < 10 * size {
        return None;
    }
    let rows: Vec<(Vec<f64>, f64)> = samples.iter().map(|s| (s.features.terms(), s.error.max(ERROR_FLOOR).ln())).collect();
    let weights = median_regression(&rows, size)?;
    let scored: Vec<(f64, f64)> = rows.iter().map(|(terms, log)| (Confidence::score(&weights, terms), *log)).collect();
    Confidence::new(weights, calibrate(scored, BINS))
}

/// Returns the weights of a least absolute deviations regression, computed by reweighted least squares.
fn median_regression(rows: &[(Vec<f64>, f64)], size: usize) -> Option<Vec<f64>> {
    let mut weights: Option<Vec<f64>> = None;
    for _ in 0..ROUNDS {
        let mut matrix = DMatrix::<f64>::zeros(size, size);
        let mut right = DVector::<f64>::zeros(size);
        for (terms, log) in rows {
            let residual = weights.as_ref().map_or(1.0, |w| log - Confidence::score(w, terms));
            let importance = 1.0 / residual.abs().max(RESIDUAL_FLOOR);
            for (i, a) in terms.iter().enumerate() {
                for (j, b) in terms[..=i].iter().enumerate() {
                    matrix[(i, j)] += importance * a * b;
                }
                right[i] += importance * a * log;
            }
        }
        for i in 0..size {
            matrix[(i, i)] += RIDGE * rows.len() as f64;
            for j in 0..i {
                matrix[(j, i)] = matrix[(i, j)];
            }
        }
        weights = Some(matrix.cholesky()?.solve(&right).iter().copied().collect());
    }
    weights
}

/// Returns the knots of the calibration from pairs of score and logarithm of the true error. The knots are medians of bins of equal size;
/// neighbouring bins are pooled until the medians do not decrease.
pub(super) fn calibrate(mut scored: Vec<(f64, f64)>, bins: usize) -> Vec<(f64, f64)> {
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    let middle = |part: &[(f64, f64)], pick: fn(&(f64, f64)) -> f64| {
        let mut values: Vec<f64> = part.iter().map(pick).collect();
        values.sort_by(f64::total_cmp);
        percentile(&values, 0.5).unwrap_or(0.0)
    };
    // Score, logarithm of the error, and number of bins in a pool.
    let mut pools: Vec<(f64, f64, f64)> = Vec::new();
    for bin in parts(&scored, bins) {
        let mut pool = (middle(bin, |s| s.0), middle(bin, |s| s.1), 1.0);
        while let Some(&(score, log, count)) = pools.last().filter(|last| last.1 >= pool.1 || last.0 >= pool.0) {
            let total = count + pool.2;
            let mean = |a: f64, b: f64| (a * count + b * pool.2) / total;
            pool = (mean(score, pool.0), mean(log, pool.1), total);
            pools.pop();
        }
        pools.push(pool);
    }
    pools.into_iter().map(|(score, log, _)| (score, log)).collect()
}

/// Splits a slice into `count` parts of nearly equal size and omits empty parts.
fn parts<T>(all: &[T], count: usize) -> impl Iterator<Item = &[T]> {
    (0..count).map(move |k| &all[k * all.len() / count..(k + 1) * all.len() / count]).filter(|part| !part.is_empty())
}

/// An expected error with the true error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExpectedError {
    /// Expected error, percent of the eye distance.
    pub expected: f64,
    /// True error, percent of the eye distance.
    pub truth: f64,
    /// Size of one percent of the eye distance, px.
    pub px: f64,
}

/// A part (such as one fifth) of the samples, ordered by expected error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CalibrationPart {
    /// Number of samples: one for each node and frame.
    pub count: usize,
    /// Median expected error, percent of the eye distance.
    pub expected: f64,
    /// Median true error, percent of the eye distance.
    pub truth: f64,
    /// 95th percentile of the true error, percent of the eye distance.
    pub truth_p95: f64,
    /// Median expected error, px.
    pub expected_px: f64,
    /// Median true error, px.
    pub truth_px: f64,
}

impl CalibrationPart {
    /// Returns the ratio of expected to true median error.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        self.expected / self.truth
    }
}

/// Splits expected and true errors into `count` parts of equal size, ordered by ascending expected error.
#[must_use]
pub fn calibration(mut errors: Vec<ExpectedError>, count: usize) -> Vec<CalibrationPart> {
    errors.sort_by(|a, b| a.expected.total_cmp(&b.expected));
    let summary =
        |part: &[ExpectedError], pick: fn(&ExpectedError) -> f64| ErrorSummary::of(&part.iter().map(pick).collect::<Vec<_>>());
    let part = |part: &[ExpectedError]| {
        let truth = summary(part, |e| e.truth)?;
        Some(CalibrationPart {
            count: part.len(),
            expected: summary(part, |e| e.expected)?.median,
            truth: truth.median,
            truth_p95: truth.p95,
            expected_px: summary(part, |e| e.expected * e.px)?.median,
            truth_px: summary(part, |e| e.truth * e.px)?.median,
        })
    };
    parts(&errors, count).filter_map(part).collect()
}

/// Returns expected and true errors of sampled sequences.
#[must_use]
pub fn expected_of_samples<'a>(
    sequences: impl IntoIterator<Item = &'a SampledSequence>,
    confidence: &Confidence,
) -> Vec<ExpectedError> {
    let of = |s: &'a SampledSequence| {
        let px = s.eye_distance / 100.0;
        s.samples.iter().map(move |sample| ExpectedError {
            expected: 100.0 * confidence.expected(&sample.features),
            truth: 100.0 * sample.error,
            px,
        })
    };
    sequences.into_iter().flat_map(of).collect()
}

/// Returns expected and true errors of one variant and group of a tracking experiment, without the neutral frame.
#[must_use]
pub fn expected_of_records(records: &Records, variant: usize, group: usize) -> Vec<ExpectedError> {
    let wanted = records.errors.iter().filter(|e| e.variant == variant && e.group == group && e.frame > 1 && e.percent > 0.0);
    let pair = |e: &super::RecordedError| {
        let px = e.px / e.percent;
        Some(ExpectedError { expected: e.expected_px? / px, truth: e.percent, px })
    };
    wanted.filter_map(pair).collect()
}

/// Returns the rows of a calibration table.
pub fn calibration_rows(name: &str, parts: &[CalibrationPart]) -> Vec<Vec<Cell>> {
    let row = |(k, p): (usize, &CalibrationPart)| {
        vec![
            Cell::text(name),
            Cell::Count(k + 1),
            Cell::Count(p.count),
            Cell::Number(p.expected, 3),
            Cell::Number(p.truth, 3),
            Cell::Number(p.ratio(), 2),
            Cell::Number(p.truth_p95, 2),
            Cell::Number(p.expected_px, 3),
            Cell::Number(p.truth_px, 3),
        ]
    };
    parts.iter().enumerate().map(row).collect()
}

/// Returns an empty table for [`calibration_rows`].
#[must_use]
pub fn calibration_table() -> Table {
    Table::new([
        "sequences",
        "quintile",
        "nodes",
        "expected_percent_es",
        "true_percent_es",
        "ratio",
        "true_p95_percent_es",
        "expected_px",
        "true_px",
    ])
}

/// Returns a chart of expected and true median errors by twentieth of the nodes, in order of ascending expected error.
#[must_use]
pub fn calibration_chart(title: &str, errors: Vec<ExpectedError>) -> LineChart {
    const TWENTIETHS: usize = 20;
    let parts = calibration(errors, TWENTIETHS);
    let points = |pick: fn(&CalibrationPart) -> f64| (1..).map(f64::from).zip(parts.iter().map(pick)).collect();
    LineChart {
        title: title.to_owned(),
        x_label: "twentieth of the nodes, from the least to the most expected error".to_owned(),
        y_label: "median error, % of the eye distance".to_owned(),
        series: vec![
            Series { name: "expected".to_owned(), points: points(|p| p.expected) },
            Series { name: "true".to_owned(), points: points(|p| p.truth) },
        ],
    }
}

/// Returns a table with the number of sequences for each verdict and their true mean error at the last frame.
#[must_use]
pub fn verdict_table(sequences: &[SampledSequence], confidence: &Confidence, wireframe: &Wireframe, tables: &Tables) -> Table {
    let judged: Vec<(&SampledSequence, Verdict)> = sequences
        .iter()
        .map(|s| {
            let mut frames = s.frames.clone();
            expect_errors(&mut frames, wireframe, tables, confidence);
            (s, summarize(&frames, wireframe, tables).verdict)
        })
        .collect();
    let mut names: Vec<&str> = judged.iter().map(|(s, _)| s.condition.as_str()).collect();
    names.dedup();
    let mut table =
        Table::new(["sequences", "verdict", "count", "true_mean_percent_es", "true_median_percent_es", "true_max_percent_es"]);
    for name in names {
        for verdict in [Verdict::Good, Verdict::LookAgain] {
            let of = judged.iter().filter(|(s, v)| s.condition == name && *v == verdict);
            let mut errors: Vec<f64> = of.map(|(s, _)| 100.0 * s.last_error).collect();
            errors.sort_by(f64::total_cmp);
            let summary = ErrorSummary::of(&errors);
            table.rows.push(vec![
                Cell::text(name),
                Cell::text(verdict.name()),
                Cell::Count(errors.len()),
                Cell::maybe(summary.map(|s| s.mean), 2),
                Cell::maybe(summary.map(|s| s.median), 2),
                Cell::maybe(errors.last().copied(), 2),
            ]);
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn median_regression_ignores_outliers() {
        // y = 2 x + 1, and one row in five is an outlier.
        let rows: Vec<(Vec<f64>, f64)> = (0..200)
            .map(|k| {
                let x = f64::from(k) / 100.0;
                (vec![1.0, x], 2.0 * x + 1.0 + if k % 5 == 0 { 40.0 } else { 0.0 })
            })
            .collect();
        let weights = median_regression(&rows, 2).unwrap();
        assert!((weights[0] - 1.0).abs() < 0.05 && (weights[1] - 2.0).abs() < 0.05, "{weights:?}");
    }

    #[test]
    fn calibrations_do_not_decrease() {
        let scored: Vec<(f64, f64)> = (0..480).map(|k| (f64::from(k), if k < 240 { 5.0 } else { f64::from(k % 7) })).collect();
        let knots = calibrate(scored, BINS);
        assert!(knots.windows(2).all(|k| k[0].0 < k[1].0 && k[0].1 < k[1].1), "{knots:?}");
    }

    #[test]
    fn parts_compare_medians() {
        // Ten nodes with expected errors of 1 to 10 and true errors twice as large: fifths of two; the first has medians 1.5 and 3.0.
        let errors = (1..=10).rev().map(|k| ExpectedError { expected: f64::from(k), truth: 2.0 * f64::from(k), px: 0.5 });
        let parts = calibration(errors.collect(), QUINTILES);
        assert_eq!(parts.len(), 5);
        assert_eq!((parts[0].count, parts[0].expected, parts[0].truth, parts[0].ratio()), (2, 1.5, 3.0, 0.5));
        assert_eq!((parts[4].expected_px, parts[4].truth_px), (4.75, 9.5));
        assert!(calibration(Vec::new(), QUINTILES).is_empty());
    }
}
