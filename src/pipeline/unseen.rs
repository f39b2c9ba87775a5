//! Sequences to recognize: existing tracks, and pictures that are first tracked in memory.

use std::{
    collections::{BTreeMap, BTreeSet},
    io,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
};

use rayon::prelude::*;

use super::{
    AnalyzedModel, Event, Failure, RunError, SequenceFailure, Stage, UNLABELLED, Workbench, id_of,
    measured::normalized,
    recording::{expand, take_doubles},
    track_files, tracks_folder,
    work::{Planned, name_marks, plan},
};
use crate::{
    dataset::{
        CORRESPONDENCES_NAME, Dataset, DatasetError, MANIFEST_NAME, SequenceEntry, has_columns, has_frames, has_picture_name,
        is_manifest, is_video,
    },
    statistics::SequenceModel,
    track::{neutral_first, parse_track, track_csv},
    units::SequenceId,
};

/// Inputs to recognize, collected from the given paths.
#[derive(Debug, Default)]
pub struct Unseen {
    /// Tracks.
    pub tracks: Vec<PathBuf>,
    /// Sequences to track first, and the failures of their datasets.
    pub pictures: Dataset,
}

/// Why the given paths contain nothing to recognize.
#[derive(Debug, thiserror::Error)]
pub enum UnseenError {
    /// The input is a single picture.
    #[error(
        "{}: recognition needs the motion from a neutral frame to the expression, so a single picture is not enough; give the folder of \
         the frames, neutral first, or a video", path.display()
    )]
    SinglePicture {
        /// The picture.
        path: PathBuf,
    },
    /// A folder of an unknown kind.
    #[error("{}: this is neither a track (.csv), nor the frames of a sequence, nor a dataset: {source}", path.display())]
    Neither {
        /// The folder.
        path: PathBuf,
        /// Why it is not a dataset.
        source: Box<DatasetError>,
    },
    /// A dataset cannot be read.
    #[error(transparent)]
    Dataset(Box<DatasetError>),
    /// A file does not exist, or a folder cannot be listed.
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl Unseen {
    /// Collects the inputs at the paths, without duplicates: tracks or folders of them, datasets, folders with the frames of one sequence,
    /// videos. From a results folder inside a dataset it takes the tracks, with their manual corrections.
    ///
    /// # Errors
    /// [`UnseenError`].
    pub fn of(paths: &[PathBuf]) -> Result<Self, UnseenError> {
        let mut all = Self::default();
        let (mut tracks, mut met) = (Vec::new(), BTreeSet::new());
        for path in paths {
            if !met.insert(path.canonicalize().unwrap_or_else(|_| path.clone())) {
                continue;
            }
            let (is_file, is_folder) = (path.is_file(), path.is_dir());
            if is_file && has_picture_name(path) {
                return Err(UnseenError::SinglePicture { path: path.clone() });
            } else if is_folder && tracks_folder(path) != *path && has_tracks(path)? {
                tracks.push(path.clone());
            } else if path.join(MANIFEST_NAME).exists() || (is_file && is_manifest(path)) {
                all.add(Dataset::open_unlabelled(path).map_err(|error| UnseenError::Dataset(Box::new(error)))?);
            } else if (is_file && is_video(path)) || (is_folder && has_frames(path)) {
                all.pictures.sequences.push(entry_of(path));
            } else if !is_folder || has_tracks(path)? {
                tracks.push(path.clone());
            } else {
                let neither = |source| UnseenError::Neither { path: path.clone(), source: Box::new(source) };
                all.add(Dataset::open_unlabelled(path).map_err(neither)?);
            }
        }
        all.tracks = track_files(&tracks)?;
        // Checked before recordings are segmented: their results are stored by name.
        let said = |double: &SequenceEntry, first: &SequenceEntry| {
            format!("{} is given twice, also in {}; rename one of them", double.id, first.frames_path.display())
        };
        all.pictures.failures.extend(take_doubles(&mut all.pictures.sequences, said));
        Ok(all)
    }

    fn add(&mut self, dataset: Dataset) {
        self.pictures.sequences.extend(dataset.sequences.into_iter().map(|mut entry| {
            // The label that `segment` writes without a given emotion.
            if entry.emotion == UNLABELLED {
                entry.emotion.clear();
            }
            entry
        }));
        self.pictures.failures.extend(dataset.failures);
    }
}

/// Whether a folder, or its subfolder `tracks`, contains a track.
fn has_tracks(folder: &Path) -> io::Result<bool> {
    Ok(track_files(&[folder.to_owned()])?.iter().any(|path| has_columns(path, &["frame", "node"])))
}

/// The manifest entry of a folder of frames, or of a video.
///
/// `S005_001`, `S005/001` and `S005/001.mp4` are sequence 001 of S005. `anna.mp4` belongs to Anna, since videos of several people may be in
/// one folder.
fn entry_of(path: &Path) -> SequenceEntry {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let is_folder = full.is_dir();
    let name = if is_folder { full.file_name() } else { full.file_stem() };
    let name = name.unwrap_or_default().to_string_lossy().into_owned();
    let is_part = if is_folder { !name.contains('_') } else { name.chars().all(|c| c.is_ascii_digit()) };
    let above = full.parent().and_then(Path::file_name).map(|above| above.to_string_lossy().into_owned());
    let id = match above {
        Some(subject) if is_part => SequenceId { subject, sequence: name },
        // The name of a folder keeps a dot that is not an extension.
        _ => id_of(Path::new(&format!("{name}.csv"))),
    };
    SequenceEntry {
        id,
        emotion: String::new(),
        frames_path: path.to_owned(),
        pictures: Vec::new(),
        first_frame: None,
        last_frame: None,
        correspondences_path: None,
        default_correspondences_path: path.join(CORRESPONDENCES_NAME),
        landmarks_paths: Vec::new(),
        fps: None,
        metadata: BTreeMap::new(),
    }
}

/// Result of tracking.
#[derive(Debug, Default)]
pub struct TrackedUnseen {
    /// Normalized models, by id.
    pub models: Vec<AnalyzedModel>,
    /// Failures, including those of the machine; the other sequences are still recognized.
    pub failures: Vec<Failure>,
    /// Reasons to review a track, one text per track.
    pub reasons: Vec<(SequenceId, String)>,
    /// Notes to the user.
    pub notes: Vec<(SequenceId, String)>,
}

/// Tracks and normalizes sequences as a run does, and keeps only their models. Whole recordings are segmented first, with results in the
/// folder `scratch`. `event` is called from many threads. Failed sequences are listed only in the result.
///
/// # Errors
/// [`RunError::Interrupted`] when `stop` is set, and [`RunError::Output`] when `scratch` is not writable.
pub fn track_unseen(
    mut pictures: Dataset,
    scratch: &Path,
    bench: &Workbench,
    stop: &AtomicBool,
    event: impl Fn(Event) + Sync,
) -> Result<TrackedUnseen, RunError> {
    expand(&mut pictures, scratch, bench, (stop, &event))?;
    event(Event::Started { sequences: pictures.sequences.len() });
    let one = |entry: &SequenceEntry| {
        let tracked = track(entry, bench, stop, &event);
        event(Event::Finished { id: entry.id.clone(), reused: false, failure: None });
        tracked
    };
    let tracked: Vec<_> = pictures.sequences.par_iter().map(one).collect();
    if stop.load(Ordering::Relaxed) {
        return Err(RunError::Interrupted);
    }
    let mut all = TrackedUnseen::default();
    for (SequenceEntry { id, .. }, tracked) in pictures.sequences.into_iter().zip(tracked) {
        match tracked {
            Ok(Tracked { model, reasons, notes }) => {
                all.models.push(model);
                all.reasons.extend((!reasons.is_empty()).then(|| (id.clone(), reasons.join("; "))));
                all.notes.extend(notes.into_iter().map(|said| (id.clone(), said)));
            }
            Err(failure) => all.failures.push(failed(id, failure)),
        }
    }
    for row in pictures.failures.iter().map(Planned::damaged) {
        let Planned { id, source: Err(failure), .. } = row else { continue };
        all.failures.push(failed(id, failure));
    }
    Ok(all)
}

fn failed(SequenceId { subject, sequence }: SequenceId, SequenceFailure { stage, reason, .. }: SequenceFailure) -> Failure {
    Failure { subject, sequence, stage, reason }
}

/// Results kept for one sequence.
struct Tracked {
    model: AnalyzedModel,
    /// Reasons to review the track.
    reasons: Vec<String>,
    /// Notes to the user.
    notes: Vec<String>,
}

/// One sequence.
fn track(
    entry: &SequenceEntry,
    bench: &Workbench,
    stop: &AtomicBool,
    event: &(impl Fn(Event) + Sync),
) -> Result<Tracked, SequenceFailure> {
    let goes_on = || !stop.load(Ordering::Relaxed);
    if !goes_on() {
        return Err(SequenceFailure::interrupted(Stage::Track));
    }
    let driven = plan(entry, false, bench)?;
    let tick = |_| {
        event(Event::Frame);
        goes_on()
    };
    let (frames, info) = driven.track(&mut None, bench, tick).map_err(|failure| name_marks(failure, Some(entry)))?;
    // Uses the values that a file would have, so that tracks of the same frames give the same recognition.
    let neutral = frames.first().map(|frame| frame.number);
    let frames = parse_track(&entry.frames_path, &track_csv(&frames)).map_err(SequenceFailure::at(Stage::Track))?;
    let frames = neutral_first(frames, neutral);
    let normalized = normalized(&frames, &info.mark_places(), info.times.as_deref(), bench)?;
    let mut summary = info.summary.clone();
    normalized.judge(&mut summary, &frames, bench);
    let model = AnalyzedModel {
        model: SequenceModel { id: entry.id.clone(), model: normalized.model },
        emotion: entry.emotion.clone(),
        metadata: entry.metadata.clone(),
        quality: None,
        course: None,
        pictures: None,
        marks_from: None,
    };
    Ok(Tracked { model, reasons: summary.reasons, notes: driven.remark.into_iter().chain(info.notes).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(folder: &Path, names: &[&str], content: &str) {
        for name in names {
            let path = folder.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, content).unwrap();
        }
    }

    /// Names of tracks, ids of sequences, and failures collected from paths in a folder.
    fn found(folder: &Path, paths: &[&str]) -> (Vec<String>, Vec<String>, Vec<String>) {
        let all = Unseen::of(&paths.iter().map(|path| folder.join(path)).collect::<Vec<_>>()).unwrap();
        let name = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().into_owned();
        let ids = all.pictures.sequences.iter().map(|entry| entry.id.to_string());
        (
            all.tracks.iter().map(name).collect(),
            ids.collect(),
            all.pictures.failures.iter().map(crate::dataset::FailedEntry::reason).collect(),
        )
    }

    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|&name| name.to_owned()).collect()
    }

    #[test]
    fn inputs_are_recognized_by_their_content() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        // A results folder inside a dataset's folder, together with a picture and tables.
        write(at, &["R/tracks/S1_1.csv", "loose/S2_1.csv"], "frame,node,x,y\n");
        write(at, &["R/manifest.csv", "ck/people.csv", "list.csv"], "subject,sequence\nS1,1\n");
        write(at, &["R/logo.png", "S3/5/1.png", "S3/5/2.png", "anna.mp4", "S4/001.mp4", "S5_2.avi"], "");
        let none: Vec<String> = Vec::new();
        assert_eq!(found(at, &["R", "loose"]), (names(&["S1_1.csv", "S2_1.csv"]), none.clone(), none.clone()));
        let sequences = names(&["S3_5", "anna_1", "S4_001", "S5_2", "S1_1"]);
        assert_eq!(
            found(at, &["S3/5", "anna.mp4", "S4/001.mp4", "S5_2.avi", "list.csv"]),
            (none.clone(), sequences, none.clone())
        );
        // Cohn-Kanade layout: once without labels, once with labels for one of two sequences.
        let images = ["ck/cohn-kanade-images/S6/1/a_1.png", "ck/cohn-kanade-images/S6/2/a_1.png"];
        write(at, &images, "");
        assert_eq!(found(at, &["ck"]), (none.clone(), names(&["S6_1", "S6_2"]), none.clone()));
        write(at, &["ck/Emotion/S6/1/a_emotion.txt"], "3.0");
        let emotions = Unseen::of(&[at.join("ck")]).unwrap().pictures.sequences.into_iter().map(|entry| entry.emotion);
        assert_eq!(emotions.collect::<Vec<_>>(), ["disgust", ""]);
        assert!(matches!(Dataset::open(&at.join("ck")), Ok(dataset) if dataset.skipped.len() == 1));
        // A table of other content is neither.
        write(at, &["other/people.csv"], "subject,age\n");
        assert!(matches!(Unseen::of(&[at.join("other")]), Err(UnseenError::Neither { .. })));
    }

    #[test]
    fn equal_inputs_count_once_and_an_equal_name_of_another_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        // Recordings are stored by name, so doubles are found before segmentation.
        let rows = "subject,sequence,emotion,frames,segment\nS1,talk,unlabelled,talk,auto\n";
        write(at, &["a/manifest.csv", "b/manifest.csv"], rows);
        let (_, ids, failed) = found(at, &["a", "a/../a", "b"]);
        assert_eq!((ids, failed.len()), (names(&["S1_talk"]), 1));
        let said = format!("S1_talk is given twice, also in {}; rename one of them", at.join("a/talk").display());
        assert!(failed[0].ends_with(&said), "{failed:?}");
        // The placeholder that `segment` writes without an emotion is not a label.
        assert_eq!(Unseen::of(&[at.join("a")]).unwrap().pictures.sequences[0].emotion, "");
    }
}
