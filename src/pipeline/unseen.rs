//! Sequences that are to be recognized: tracks that are there, and pictures that are tracked first, in memory.

use std::{
    collections::{BTreeMap, BTreeSet},
    io,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
};

use rayon::prelude::*;

use super::{
    AnalyzedModel, Event, Failure, RunError, SequenceFailure, Stage, Workbench, id_of,
    measured::normalized,
    recording::expand,
    track_files,
    work::{Planned, name_marks, plan},
};
use crate::{
    dataset::{
        CORRESPONDENCES_NAME, Dataset, DatasetError, MANIFEST_NAME, SequenceEntry, has_frames, has_picture_name, is_manifest,
        is_video,
    },
    statistics::SequenceModel,
    track::{TrackQuality, neutral_first, parse_track, track_csv},
    units::SequenceId,
};

/// What a person wants to have recognized, by the paths that were given.
#[derive(Debug, Default)]
pub struct Unseen {
    /// Tracks.
    pub tracks: Vec<PathBuf>,
    /// Sequences to be tracked first, in the order given, and what of the datasets is none.
    pub pictures: Dataset,
}

/// Why nothing can be recognized in what was given.
#[derive(Debug, thiserror::Error)]
pub enum UnseenError {
    /// One picture.
    #[error(
        "{}: a single picture shows no motion, and an expression is recognized by how the face moves from neutral to it: two frames are \
         needed; give the folder of the frames, neutral first, or a video", path.display()
    )]
    SinglePicture {
        /// The picture.
        path: PathBuf,
    },
    /// A folder of none of the kinds.
    #[error("{}: neither tracks (.csv), nor the frames of a sequence, nor a dataset: {source}", path.display())]
    Neither {
        /// The folder.
        path: PathBuf,
        /// Why it is no dataset.
        source: Box<DatasetError>,
    },
    /// A dataset that does not read.
    #[error(transparent)]
    Dataset(Box<DatasetError>),
    /// A file that is not there, or a folder that cannot be listed.
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl Unseen {
    /// What is at the paths: tracks or folders of them, datasets, folders of the frames of one sequence, videos.
    ///
    /// # Errors
    /// [`UnseenError`].
    pub fn of(paths: &[PathBuf]) -> Result<Self, UnseenError> {
        let mut all = Self::default();
        let mut tracks = Vec::new();
        for path in paths {
            let is_file = path.is_file();
            if is_file && has_picture_name(path) {
                return Err(UnseenError::SinglePicture { path: path.clone() });
            } else if (is_file && is_video(path)) || (path.is_dir() && !path.join(MANIFEST_NAME).exists() && has_frames(path)) {
                all.pictures.sequences.push(entry_of(path));
            } else if path.join(MANIFEST_NAME).exists() || (is_file && is_manifest(path)) {
                all.add(Dataset::open_unlabelled(path).map_err(|error| UnseenError::Dataset(Box::new(error)))?);
            } else if is_file || !track_files(std::slice::from_ref(path))?.is_empty() {
                tracks.push(path.clone());
            } else {
                let neither = |source| UnseenError::Neither { path: path.clone(), source: Box::new(source) };
                all.add(Dataset::open_unlabelled(path).map_err(neither)?);
            }
        }
        all.tracks = track_files(&tracks)?;
        Ok(all)
    }

    fn add(&mut self, dataset: Dataset) {
        self.pictures.sequences.extend(dataset.sequences);
        self.pictures.failures.extend(dataset.failures);
        self.pictures.skipped.extend(dataset.skipped);
    }
}

/// A folder of frames, or a video, as a sequence of its own: `S005_001` and `S005/001` are sequence 001 of S005.
fn entry_of(path: &Path) -> SequenceEntry {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let name = if full.is_dir() { full.file_name() } else { full.file_stem() };
    let name = name.unwrap_or_default().to_string_lossy().into_owned();
    let above = full.parent().and_then(Path::file_name).map(|above| above.to_string_lossy().into_owned());
    let id = match above {
        Some(subject) if !name.contains('_') => SequenceId { subject, sequence: name },
        // What is no ending stays in the name of a folder.
        _ => id_of(Path::new(&format!("{name}.csv"))),
    };
    SequenceEntry {
        id,
        emotion: String::new(),
        frames_path: path.to_owned(),
        first_frame: None,
        last_frame: None,
        correspondences_path: None,
        default_correspondences_path: path.join(CORRESPONDENCES_NAME),
        landmarks_paths: Vec::new(),
        fps: None,
        metadata: BTreeMap::new(),
    }
}

/// What became of sequences that were tracked.
#[derive(Debug, Default)]
pub struct TrackedUnseen {
    /// Normalized, with how well they were tracked, in the order given.
    pub models: Vec<AnalyzedModel>,
    /// What failed.
    pub failures: Vec<Failure>,
    /// What a person should know, a line each.
    pub notes: Vec<String>,
}

/// Tracks and normalizes sequences as a run does, and keeps nothing of them but their models. Whole recordings are cut first; what is found in
/// them goes into the folder `scratch`. `event` is called from many threads; that a sequence failed is in the answer alone.
///
/// # Errors
/// [`RunError::Interrupted`] where `stop` says so, and what is the machine's fault.
pub fn track_unseen(
    mut pictures: Dataset,
    scratch: &Path,
    bench: &Workbench,
    stop: &AtomicBool,
    event: impl Fn(Event) + Sync,
) -> Result<TrackedUnseen, RunError> {
    expand(&mut pictures, scratch, bench, (stop, &event))?;
    event(Event::Started { sequences: pictures.sequences.len() });
    let mut known = BTreeSet::new();
    let twice: Vec<bool> = pictures.sequences.iter().map(|entry| !known.insert(entry.id.to_string())).collect();
    let one = |(entry, twice): (&SequenceEntry, &bool)| {
        let tracked = if *twice {
            let reason = format!("{}: a sequence of {} was read already", entry.frames_path.display(), entry.id);
            Err(SequenceFailure { stage: Stage::Dataset, reason, fatal: false })
        } else {
            track(entry, bench, stop, &event)
        };
        event(Event::Finished { id: entry.id.clone(), reused: false, failure: None });
        tracked
    };
    let tracked: Vec<_> = pictures.sequences.par_iter().zip(&twice).map(one).collect();
    if stop.load(Ordering::Relaxed) {
        return Err(RunError::Interrupted);
    }
    let mut all = TrackedUnseen::default();
    let failed = |id: SequenceId, SequenceFailure { stage, reason, fatal }: SequenceFailure| {
        let SequenceId { subject, sequence } = id.clone();
        if fatal { Err(RunError::Write { id, reason }) } else { Ok(Failure { subject, sequence, stage, reason }) }
    };
    for (entry, tracked) in pictures.sequences.iter().zip(tracked) {
        match tracked {
            Ok((model, notes)) => {
                all.models.push(model);
                all.notes.extend(notes.into_iter().map(|said| format!("{}: {said}", entry.id)));
            }
            Err(failure) => all.failures.push(failed(entry.id.clone(), failure)?),
        }
    }
    for row in pictures.failures.iter().map(Planned::damaged) {
        let Planned { id, source: Err(failure), .. } = row else { continue };
        all.failures.push(failed(id, failure)?);
    }
    all.notes.extend(pictures.skipped.iter().map(|skipped| format!("{} is left out: {}", skipped.id, skipped.reason)));
    Ok(all)
}

/// One sequence, and what a person should know of it.
fn track(
    entry: &SequenceEntry,
    bench: &Workbench,
    stop: &AtomicBool,
    event: &(impl Fn(Event) + Sync),
) -> Result<(AnalyzedModel, Vec<String>), SequenceFailure> {
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
    // What is used is what a file would hold: a track of the same frames is recognized as the same.
    let neutral = frames.first().map(|frame| frame.number);
    let frames = parse_track(&entry.frames_path, &track_csv(&frames)).map_err(SequenceFailure::at(Stage::Track))?;
    let frames = neutral_first(frames, neutral);
    let normalized = normalized(&frames, &info.mark_places(), info.times.as_deref(), bench)?;
    let mut summary = info.summary.clone();
    normalized.judge(&mut summary, &frames, bench);
    let quality = TrackQuality::new(entry.id.clone(), entry.emotion.clone(), summary, &frames, &bench.wireframe);
    let model = AnalyzedModel {
        model: SequenceModel { id: entry.id.clone(), model: normalized.model },
        emotion: entry.emotion.clone(),
        metadata: entry.metadata.clone(),
        quality: Some(quality),
        course: None,
    };
    Ok((model, driven.remark.into_iter().chain(info.notes).collect()))
}
