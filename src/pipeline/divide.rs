//! Divides a run into steps for several processes or machines that share a folder.
//!
//! [`run_plan`] begins the run, [`run_part`] processes a part of the sequences, [`run_emotion`] computes the statistics of one emotion. The
//! last step is [`super::run`] itself, which uses all existing results.

use std::{collections::BTreeMap, path::Path, sync::atomic::AtomicBool};

use super::{
    AnalysisError, AnalyzedModel, Event, Failure, RunError, RunJson, SequenceFailure, Workbench,
    analysis::{by_emotion, labelled, strata_of},
    folder::{RUN_JSON, new_record, open},
    ledger::Ledger,
    looks::looks_in,
    parts::{EmotionPart, part_name},
    work::{Collected, Planned, Worked, collect, plan_all, process_all, sequence_files},
};
use crate::{
    dataset::{Dataset, SequenceEntry},
    output,
    statistics::{EMOTIONS, group_models_unchecked},
};

/// Work in a dataset, for dividing a run among machines.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Plan {
    /// Number of usable sequences.
    pub sequences: usize,
    /// Emotions in the order of the tables, with their number of sequences.
    pub emotions: Vec<(String, usize)>,
    /// Rows or folders that are not valid sequences; the last step reports them as failures.
    #[serde(skip)]
    pub failures: Vec<String>,
}

/// Opens the dataset, registers the output folder for this run, and returns the work to do.
///
/// # Errors
/// As `run`, before any sequence is processed.
pub fn run_plan(dataset: &Path, out: &Path, bench: &Workbench, force: bool) -> Result<Plan, RunError> {
    let (opened, name, earlier) = open(dataset, out, bench, force, (&AtomicBool::new(false), &|_| ()))?;
    let first = opened.failures.iter().map(Planned::damaged).min_by(|a, b| a.id.cmp(&b.id));
    if opened.sequences.is_empty()
        && let Some(Planned { source: Err(SequenceFailure { stage, reason, .. }), .. }) = first
    {
        return Err(RunError::NothingLeft { sequences: opened.failures.len(), stage, reason });
    }
    if earlier.as_ref().is_none_or(|earlier| !earlier.complete) {
        let skipped = opened.skipped.iter().map(|s| (s.id.to_string(), s.reason.clone())).collect();
        let (outputs, kept) = earlier.map(|e| (e.outputs, e.kept)).unwrap_or_default();
        let record = RunJson { outputs, kept, ..new_record(name, skipped, bench) };
        output::write_json_durably(&out.join(RUN_JSON), &record)?;
    }
    let mut emotions: BTreeMap<(usize, &str), usize> = BTreeMap::new();
    for entry in &opened.sequences {
        let rank = EMOTIONS.iter().position(|&e| e == entry.emotion).unwrap_or(EMOTIONS.len());
        *emotions.entry((rank, &entry.emotion)).or_default() += 1;
    }
    let emotions = emotions.into_iter().map(|((_, emotion), count)| (emotion.to_owned(), count)).collect();
    let failures = opened.failures.iter().map(|failure| failure.error.to_string()).collect();
    Ok(Plan { sequences: opened.sequences.len(), emotions, failures })
}

/// Tracks and normalizes part `part` (from 1) of `of` equal parts of the sequences, sorted by id. The folder must have been begun by
/// [`run_plan`] or `run`. The last step of a divided run is `run` itself, which uses all existing results.
///
/// # Errors
/// As `run`; failed sequences are in the result.
pub fn run_part(
    dataset: &Path,
    out: &Path,
    bench: &Workbench,
    (part, of): (usize, usize),
    stop: &AtomicBool,
    event: impl Fn(Event) + Sync,
) -> Result<Vec<Failure>, RunError> {
    let (opened, _, earlier) = open_begun(dataset, out, bench)?;
    let ledger = Ledger::open(out, Some(&earlier), false)?;
    let count = opened.sequences.len();
    let of = of.max(1);
    let bounds = |k: usize| (k as u128 * count as u128 / of as u128) as usize;
    let chosen: Vec<&SequenceEntry> =
        opened.sequences[bounds(part.saturating_sub(1).min(of))..bounds(part.min(of))].iter().collect();
    let looks = looks_in(out, false)?;
    Ok(work(&chosen, &earlier, &Worked { out, ledger: &ledger, bench, overlay: None, looks: &looks, stop }, &event)?.1)
}

/// Tracks and normalizes the remaining sequences of one emotion, and computes its statistics for the run to use.
///
/// # Errors
/// As `run`; [`RunError::NoSuchEmotion`]; failed sequences are in the result.
pub fn run_emotion(
    dataset: &Path,
    out: &Path,
    bench: &Workbench,
    emotion: &str,
    stop: &AtomicBool,
    event: impl Fn(Event) + Sync,
) -> Result<Vec<Failure>, RunError> {
    let (opened, _, earlier) = open_begun(dataset, out, bench)?;
    let ledger = Ledger::open(out, Some(&earlier), false)?;
    let chosen: Vec<&SequenceEntry> = opened.sequences.iter().filter(|entry| entry.emotion == emotion).collect();
    if chosen.is_empty() {
        return Err(RunError::NoSuchEmotion { emotion: emotion.to_owned() });
    }
    let looks = looks_in(out, false)?;
    let worked = Worked { out, ledger: &ledger, bench, overlay: None, looks: &looks, stop };
    let (models, failures) = work(&chosen, &earlier, &worked, &event)?;
    event(Event::Analyzing);
    let grouped = labelled(models);
    // A column that is empty in this emotion may have values in others; the last step checks it.
    let groups = group_models_unchecked(&grouped, &bench.options.by).map_err(AnalysisError::from)?;
    let strata = strata_of(&grouped, &bench.options.strata);
    let strata = strata.as_ref();
    for (emotion, groups) in by_emotion(groups) {
        ledger.claim(&[part_name(&emotion)])?;
        let hash = EmotionPart::compute(&emotion, &groups, bench, strata)?.write(out, &emotion, &groups, bench, strata)?;
        ledger.wrote([(&part_name(&emotion), &hash.to_hex().to_string())])?;
    }
    Ok(failures)
}

/// As [`open`] for a folder in which the run was begun.
fn open_begun(dataset: &Path, out: &Path, bench: &Workbench) -> Result<(Dataset, String, RunJson), RunError> {
    let (opened, name, earlier) = open(dataset, out, bench, false, (&AtomicBool::new(false), &|_| ()))?;
    let earlier = earlier.ok_or_else(|| RunError::NotBegun { path: out.to_owned() })?;
    Ok((opened, name, earlier))
}

/// Tracks and normalizes sequences. Returns models and failures in the order of the sequences.
fn work(
    chosen: &[&SequenceEntry],
    earlier: &RunJson,
    worked: &Worked<'_>,
    event: &(impl Fn(Event) + Sync),
) -> Result<(Vec<AnalyzedModel>, Vec<Failure>), RunError> {
    event(Event::Started { sequences: chosen.len() });
    let &Worked { out, ledger, bench, stop, .. } = worked;
    ledger.claim(&chosen.iter().flat_map(|entry| sequence_files(&entry.id)).collect::<Vec<_>>())?;
    let planned = plan_all(chosen, out, Some(earlier), bench, stop);
    let results = process_all(&planned, worked, event)?;
    output::sync_written()?;
    let mut record = new_record(String::new(), Vec::new(), bench);
    let Collected { models, failures, .. } = collect(planned, results, out, &mut record)?;
    Ok((models, failures))
}
