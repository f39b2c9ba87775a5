//! Applies manual corrections to the tracks of a run, after every new tracking.

use std::{collections::BTreeSet, path::Path};

use super::{SequenceFailure, SequenceSource, Stage, Workbench};
use crate::{
    fit::Springs,
    output::listed,
    sequence::{ImageSize, SequenceReader},
    track::{
        CORRECTIONS_FOLDER, Confidence, Corrections, SavedCorrections, TrackCorrections, TrackError, TrackInfo, TrackedFrame,
        correct_nodes, corrections_in_track, expect_errors, far_corrections, fitting_corrections, read_corrections,
        read_track_info, resume_with, summarize, window_px, write_corrections,
    },
};

/// Most files that a note names.
const MOST_NAMED: usize = 6;

/// Returns the corrections saved for a track. Corrections that an older version stored only in the track are first saved in their own file,
/// before the track is replaced.
pub(super) fn saved_or_carried_over(
    csv_path: &Path,
    earlier: Option<&TrackInfo>,
) -> Result<Option<SavedCorrections>, SequenceFailure> {
    if let Some(saved) = read_corrections(csv_path).map_err(SequenceFailure::at(Stage::Dataset))? {
        return Ok(Some(saved));
    }
    let found = corrections_in_track(csv_path, earlier);
    found.map(|c| write_corrections(csv_path, &c)).transpose().map_err(SequenceFailure::at(Stage::Write))
}

/// Applies saved corrections to a newly made track. `track` tracks again from the first of them.
pub(super) fn apply(
    saved: &SavedCorrections,
    earlier: Option<&TrackInfo>,
    frames: &mut Vec<TrackedFrame>,
    info: &mut TrackInfo,
    bench: &Workbench,
    track: impl FnOnce(&[TrackedFrame], &Corrections) -> Result<Vec<TrackedFrame>, SequenceFailure>,
) -> Result<(), SequenceFailure> {
    let set_on = earlier.map_or(info.image_size, |e| e.corrections.as_ref().map_or(e.image_size, |c| c.image_size));
    let (fit, not_applied) = fitting_corrections(&saved.corrections, set_on, info.image_size, frames, &bench.wireframe);
    let far = far_corrections(&fit, frames, &bench.wireframe, &bench.tables);
    if !fit.is_empty() {
        *frames = track(frames, &fit)?;
        expect_errors(frames, &bench.wireframe, &bench.tables, Confidence::shipped());
        info.summary = summarize(frames, &bench.wireframe, &bench.tables).told_by_the_pictures_of(&info.summary);
    }
    info.corrections =
        Some(TrackCorrections { blake3: saved.blake3.clone(), image_size: known(set_on, info.image_size), not_applied, far });
    Ok(())
}

/// Messages about the corrections of a track with the file name `path`: a line for each that does not apply, and one for those far from the
/// face.
pub fn corrections_said(corrections: &TrackCorrections, path: &str) -> Vec<String> {
    let misfits = corrections
        .not_applied
        .iter()
        .map(|what| format!("{path} no longer fits the track and is kept, but not applied: {what}"));
    let far = (!corrections.far.is_empty()).then(|| {
        format!(
            "{path} is applied, but these corrections lie far from the expected place; check them: {}",
            listed(&corrections.far, MOST_NAMED)
        )
    });
    misfits.chain(far).collect()
}

/// Applies the corrections saved for the track file `csv_path` (see [`corrections_path`](crate::track::corrections_path)), if any, to its
/// newly tracked `frames`. Enters in `info` which were applied and which were not.
///
/// # Errors
/// [`SequenceFailure`] when the corrections cannot be read, or the frames changed since they were tracked.
pub fn correct_track(
    source: &SequenceSource,
    csv_path: &Path,
    frames: &mut Vec<TrackedFrame>,
    info: &mut TrackInfo,
    bench: &Workbench,
) -> Result<(), SequenceFailure> {
    let earlier = read_track_info(csv_path).ok().flatten();
    let Some(saved) = saved_or_carried_over(csv_path, earlier.as_ref())? else { return Ok(()) };
    let inputs = info.inputs_blake3.clone();
    apply(&saved, earlier.as_ref(), frames, info, bench, |frames, fit| source.track_corrected(frames, fit, &inputs, bench))
}

/// Message that corrections in the folder of a run belong to none of its sequences `ids`, for example because of a mistyped file name.
pub(super) fn unused_corrections(out: &Path, ids: &BTreeSet<String>) -> Option<String> {
    let entries = std::fs::read_dir(out.join(CORRECTIONS_FOLDER)).ok()?;
    let names = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    let is_unused = |name: &String| name.strip_suffix(".csv").is_some_and(|stem| !stem.starts_with('.') && !ids.contains(stem));
    let mut unused: Vec<String> = names.filter(is_unused).collect();
    unused.sort();
    let (they, their) = if unused.len() == 1 { ("is", "its") } else { ("are", "their") };
    (!unused.is_empty()).then(|| {
        format!(
            "{} in {CORRECTIONS_FOLDER}/ {they} not applied, because {their} names are not the SUBJECT_SEQUENCE.csv of a sequence of this run",
            listed(&unused, MOST_NAMED)
        )
    })
}

fn known(size: ImageSize, otherwise: ImageSize) -> ImageSize {
    if size.width > 0 && size.height > 0 { size } else { otherwise }
}

impl SequenceSource {
    /// Tracks again from the frame before the first correction, with all corrections. `inputs_blake3` identifies the frames.
    pub(super) fn track_corrected(
        &self,
        frames: &[TrackedFrame],
        corrections: &Corrections,
        inputs_blake3: &str,
        bench: &Workbench,
    ) -> Result<Vec<TrackedFrame>, SequenceFailure> {
        let failed = |reason: String| SequenceFailure { stage: Stage::Track, reason, fatal: false };
        let place = frames.iter().position(|f| corrections.contains_key(&f.number)).unwrap_or(frames.len()).max(1);
        let Some(start) = frames.get(place - 1) else { return Err(failed("the track is empty".to_owned())) };
        let options = &bench.options.track;
        let neutral: Vec<_> = frames[0].nodes.iter().map(|n| n.position).collect();
        let window = window_px(&bench.tables, &neutral, options);
        let mut tracker = options.klt.tracker(options.levels, window).map_err(SequenceFailure::at(Stage::Track))?;
        let mut reader = SequenceReader::open(&self.frames).map_err(SequenceFailure::at(Stage::Track))?;
        let (wireframe, plan) = (&bench.wireframe, bench.plan());
        let behind = resume_with(&mut tracker, wireframe, plan, frames, start.number, corrections, reader.by_ref(), options)
            .map_err(SequenceFailure::at(Stage::Track))?;
        let content = reader.into_content_blake3().map_err(SequenceFailure::at(Stage::Track))?;
        if self.inputs_blake3(content, bench) != inputs_blake3 {
            return Err(failed("its frames changed while they were tracked; run again when they are complete".to_owned()));
        }
        Ok(frames[..place].iter().cloned().chain(behind).collect())
    }
}

/// Corrects the frames of a landmark track one by one, since each frame is independent.
pub(super) fn correct_frames(
    frames: &[TrackedFrame],
    corrections: &Corrections,
    bench: &Workbench,
) -> Result<Vec<TrackedFrame>, SequenceFailure> {
    let springs = Springs::new(&bench.wireframe);
    let one = |frame: &TrackedFrame| -> Result<TrackedFrame, TrackError> {
        let Some(hard) = corrections.get(&frame.number) else { return Ok(frame.clone()) };
        let nodes = correct_nodes(&bench.wireframe, &springs, &frame.nodes, hard)?;
        Ok(TrackedFrame { number: frame.number, nodes })
    };
    frames.iter().map(one).collect::<Result<_, _>>().map_err(SequenceFailure::at(Stage::Track))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corrections_without_a_sequence_are_reported() {
        let folder = tempfile::tempdir().unwrap();
        let ids = BTreeSet::from(["P1_2".to_owned()]);
        assert_eq!(unused_corrections(folder.path(), &ids), None);
        std::fs::create_dir(folder.path().join(CORRECTIONS_FOLDER)).unwrap();
        let write = |name: &str| std::fs::write(folder.path().join(CORRECTIONS_FOLDER).join(name), "").unwrap();
        ["P1_2.csv", ".P9_2.csv", "notes.txt"].into_iter().for_each(write);
        assert_eq!(unused_corrections(folder.path(), &ids), None);
        ["P1.csv", "P1_02.csv"].into_iter().for_each(write);
        let said = unused_corrections(folder.path(), &ids).unwrap();
        assert!(said.starts_with("P1.csv; P1_02.csv in corrections/ are not applied"), "{said}");
    }
}
