//! Reads datasets: sequences with an emotion, their frames, correspondences and landmarks.
//!
//! A dataset is a folder with `manifest.csv`, or a folder in the layout of Cohn-Kanade. Opening it reads only the manifest or the emotion
//! labels. Frames, correspondences and landmarks are looked up when a sequence is processed, so that opening is fast and a broken sequence
//! fails alone. This module decodes no pictures.

mod cohn_kanade;
mod entry;
mod error;
mod frames;
mod init;
mod landmarks;
mod listed;
mod manifest;
mod marks;
mod numbering;
mod spelling;
mod unread;

use std::path::{Path, PathBuf};

use crate::{text::message, units::SequenceId};

pub use cohn_kanade::emotion_code;
pub(crate) use entry::FACE_COLUMN;
pub(crate) use entry::not_shown_said;
pub use entry::{CorrespondenceSource, PUBLISH_COLUMN, SEGMENT_COLUMN, SequenceEntry, is_publish_column, may_publish};
pub(crate) use error::name_key;
pub use error::{DatasetError, RowError, check_file_name};
pub use frames::{
    FrameFile, FrameSource, FramesError, IMAGE_EXTENSIONS, VIDEO_EXTENSIONS, has_picture_name, is_picture, list_frames,
    list_frames_among, list_readable, list_recording,
};
pub(crate) use frames::{has_frames, is_video, visible};
pub use init::{Kept, UNKNOWN_EMOTION, manifest_path, propose_manifest, unlisted_said};
pub use landmarks::{
    DEFAULT_LANDMARK_NODES, LANDMARK_COUNT, LEAST_CONFIDENCE, LandmarkFrame, LandmarkSelection, LandmarkSequence, LandmarkTrack,
    LandmarksError, correspondences_from_landmarks, landmark_files, read_face, read_landmarks,
};
pub(crate) use listed::PICTURE_SEPARATOR;
pub(crate) use manifest::{CORRESPONDENCES_NAME, has_columns, is_manifest};
pub use manifest::{FRAME_RATES, MANIFEST_COLUMNS};
pub use marks::{MarksFileError, read_marks};
pub use unread::unread_beside;

/// Name of the manifest in a dataset's folder.
pub const MANIFEST_NAME: &str = "manifest.csv";

/// The sequences of a dataset.
///
/// ```
/// use grimace::dataset::Dataset;
///
/// let dataset = Dataset::open("fixtures/simulated".as_ref())?;
/// assert_eq!((dataset.sequences.len(), dataset.failures.len()), (24, 0));
/// assert_eq!(dataset.sequences.iter().filter(|entry| entry.emotion == "happiness").count(), 4);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Default)]
pub struct Dataset {
    /// Base folder of relative paths: the manifest's, or the one with the subjects' folders.
    pub root: PathBuf,
    /// Usable sequences, sorted by id.
    pub sequences: Vec<SequenceEntry>,
    /// Rows or folders that are not valid sequences, in order of appearance.
    pub failures: Vec<FailedEntry>,
    /// Sequences left out on purpose, sorted by id.
    pub skipped: Vec<SkippedEntry>,
}

/// Whether sequences must have emotions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Labels {
    /// Required.
    Needed,
    /// Optional: a missing or unknown emotion is empty.
    IfAny,
}

/// A row or folder that is not a valid sequence.
///
/// An invalid row does not affect the others.
/// ```
/// use grimace::dataset::{Dataset, FailedEntry};
///
/// let folder = tempfile::tempdir()?;
/// std::fs::write(folder.path().join("manifest.csv"), "subject,sequence,emotion,frames\nP1,1,joy,a\nP2,1,,b\n")?;
/// let dataset = Dataset::open(folder.path())?;
/// let FailedEntry { subject, error, .. } = &dataset.failures[0];
/// assert_eq!((dataset.sequences.len(), subject.as_str()), (1, "P2"));
/// assert!(error.to_string().ends_with("manifest.csv, line 3: emotion is empty"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct FailedEntry {
    /// Subject, if it could be read, else empty.
    pub subject: String,
    /// Sequence, if it could be read, else empty.
    pub sequence: String,
    /// The error.
    pub error: DatasetError,
}

impl FailedEntry {
    /// The reason, as in messages and tables.
    pub(crate) fn reason(&self) -> String {
        message(&self.error.to_string()).into_owned()
    }
}

/// A sequence left out on purpose.
///
/// Cohn-Kanade has sequences without a label, which are not failures.
/// ```
/// use grimace::dataset::Dataset;
///
/// # let folder = tempfile::tempdir()?;
/// # let frames = folder.path().join("cohn-kanade-images/S005/001");
/// # std::fs::create_dir_all(&frames)?;
/// # std::fs::create_dir_all(folder.path().join("Emotion/S005/001"))?;
/// # for name in ["S005_001_00000001.png", "S005_001_00000002.png"] {
/// #     std::fs::write(frames.join(name), "")?;
/// # }
/// // `folder` has two frames of S005 in sequence 001, and no emotion for it.
/// assert_eq!(Dataset::open(folder.path())?.skipped[0].id.to_string(), "S005_001");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkippedEntry {
    /// The sequence.
    pub id: SequenceId,
    /// The reason, such as a missing emotion label.
    pub reason: String,
}

impl Dataset {
    /// Opens a dataset: a folder with `manifest.csv`, a manifest file, or a folder in the layout of Cohn-Kanade or CK+.
    ///
    /// # Errors
    /// [`DatasetError`] when there is no such dataset or its manifest as a whole cannot be read. Errors of single sequences are in
    /// [`Dataset::failures`].
    pub fn open(path: &Path) -> Result<Self, DatasetError> {
        Self::open_as(path, Labels::Needed)
    }

    /// As [`Dataset::open`] for sequences with optional emotions: missing ones are empty, and no sequence is skipped.
    pub(crate) fn open_unlabelled(path: &Path) -> Result<Self, DatasetError> {
        Self::open_as(path, Labels::IfAny)
    }

    fn open_as(path: &Path, labels: Labels) -> Result<Self, DatasetError> {
        if path.is_file() {
            let not_dataset = |kind, command| Err(DatasetError::NotDataset { path: path.to_owned(), kind, command });
            return if frames::is_video(path) {
                not_dataset("video", "segment")
            } else if frames::has_picture_name(path) {
                not_dataset("picture", "locate")
            } else {
                manifest::open(path, labels)
            };
        }
        if !path.is_dir() {
            return Err(DatasetError::NotFound { path: path.to_owned() });
        }
        let manifest = path.join(MANIFEST_NAME);
        if manifest.exists() {
            return manifest::open(&manifest, labels);
        }
        if let Some(found) = manifest_of_other_case(path) {
            return Err(DatasetError::ManifestName { root: path.to_owned(), found });
        }
        match cohn_kanade::open(path, labels)? {
            Some(dataset) => Ok(dataset),
            None => Err(no_manifest(path)),
        }
    }
}

/// Name of a file that is the manifest but for capital letters, such as `Manifest.csv`.
fn manifest_of_other_case(root: &Path) -> Option<String> {
    let mut names = frames::visible(root).ok()?.into_iter().map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.find(|name| name.eq_ignore_ascii_case(MANIFEST_NAME))
}

/// Most folders searched for an example of a sequence.
const MAX_FOLDERS_LOOKED_INTO: usize = 1000;

/// The error for a folder without a manifest, with an example line made from its content.
fn no_manifest(root: &Path) -> DatasetError {
    let mut looked_into = 0;
    for subject in frames::sub_folders(root).unwrap_or_default() {
        for sequence in frames::sub_folders(&root.join(&subject)).unwrap_or_default() {
            if frames::has_frames(&root.join(&subject).join(&sequence)) {
                return DatasetError::NoManifest { root: root.to_owned(), subject, sequence };
            }
            looked_into += 1;
            if looked_into >= MAX_FOLDERS_LOOKED_INTO {
                return DatasetError::NothingFound { root: root.to_owned() };
            }
        }
    }
    DatasetError::NothingFound { root: root.to_owned() }
}

/// Creates a temporary folder with empty files; its name says neither an emotion nor a number.
#[cfg(test)]
fn folder_with(files: &[impl AsRef<str>]) -> tempfile::TempDir {
    let folder = tempfile::Builder::new().prefix("pictures").suffix("_x").tempdir().unwrap();
    for file in files {
        let path = folder.path().join(file.as_ref());
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, "").unwrap();
    }
    folder
}

#[cfg(test)]
#[allow(clippy::format_collect)]
mod tests;
