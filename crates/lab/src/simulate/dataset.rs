//! Writes a dataset of rendered subjects to disk.

use std::{
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
};

use rayon::prelude::*;

use grimace::internal::output::FolderRecord;

use super::{
    Cohort, Emotion, Sex, SimulateError, SimulateOptions, SimulatedSequence, Subject,
    files::{ManifestRow, Performance, begin, finish, write_sequence},
};

/// Size of a written dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DatasetSummary {
    /// Number of sequences.
    pub sequences: usize,
    /// Number of frames in all sequences.
    pub frames: usize,
}

/// Writes a dataset of rendered subjects.
///
/// It consists of `manifest.csv`, the frames, correspondences, the true position of every node, and `simulate.json`. In the layout of
/// Cohn-Kanade, images, emotion labels and exact landmarks in three folders replace manifest and correspondences.
///
/// Sequences are made in parallel; the files do not depend on the number of threads. `progress` is called from any thread with the number
/// of finished frames and of all frames.
///
/// With `force`, files that an earlier simulation recorded (`simulate.b3`) and that this one does not write are removed; other files stay.
///
/// # Errors
/// [`SimulateError`] for options out of range, a folder that is not empty (unless `force`), or a file that cannot be written.
pub fn simulate_dataset(
    options: &SimulateOptions,
    out: &Path,
    force: bool,
    progress: impl Fn(usize, usize) + Sync,
) -> Result<DatasetSummary, SimulateError> {
    options.check()?;
    let record = begin(out, force)?;
    let total = options.subjects as usize * options.emotions.len() * options.frames;
    let done = AtomicUsize::new(0);
    let tick = || progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
    let rows: Vec<Vec<ManifestRow>> = (0..options.subjects)
        .into_par_iter()
        .map(|index| {
            let subject = Subject::new(options, index)?;
            options.emotions.par_iter().map(|&emotion| perform(&subject, emotion, options, &record, &tick)).collect()
        })
        .collect::<Result<_, SimulateError>>()?;
    let sequences = rows.iter().map(Vec::len).sum();
    finish(record, out, options, &serde_json::Map::new(), &["sex", "cohort"], rows.into_iter().flatten())?;
    Ok(DatasetSummary { sequences, frames: total })
}

fn perform(
    subject: &Subject,
    emotion: Emotion,
    options: &SimulateOptions,
    record: &FolderRecord,
    tick: &(impl Fn() + Sync),
) -> Result<ManifestRow, SimulateError> {
    let sequence = SimulatedSequence::new(subject, emotion, options)?;
    let performance = Performance {
        subject: subject.id(),
        sequence: format!("{:03}", emotion.code()),
        emotion: emotion.label().to_owned(),
        stream: (subject.index(), emotion.code()),
        frame: |k| Ok(sequence.frame(k)),
    };
    let sex = match subject.sex() {
        Sex::Female => "f",
        Sex::Male => "m",
    };
    let cohort = match subject.cohort() {
        Cohort::A => "A",
        Cohort::B => "B",
    };
    Ok(write_sequence(&performance, options, record, tick)?.with([sex, cohort].map(str::to_owned)))
}
