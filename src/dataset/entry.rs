//! One sequence of a dataset.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use super::{
    DatasetError, FrameSource, FramesError, LEAST_CONFIDENCE, LandmarkSelection, LandmarkTrack, LandmarksError,
    correspondences_from_landmarks,
    frames::{frames_of_place, has_frames, readable_of_place},
    landmark_files,
    landmarks::has_landmark_extension,
    list_recording,
    listed::frames_of_list,
    read_face, read_marks,
};
use crate::{
    correspondence::Correspondence,
    output::{count, listed},
    units::SequenceId,
    wireframe::Tables,
};

/// A sequence: its subject, its name, its emotion, and the paths of its files. The methods look the files up.
///
/// ```
/// use grimace::dataset::Dataset;
///
/// let dataset = Dataset::open("fixtures/simulated".as_ref())?;
/// let smile = dataset.sequences.iter().find(|entry| entry.id.to_string() == "S001_005").expect("S001_005");
/// assert_eq!((smile.emotion.as_str(), smile.fps, smile.column("cohort")), ("happiness", Some(25.0), Some("A")));
/// assert_eq!(smile.frames()?.files().len(), 10);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceEntry {
    /// Subject and sequence.
    pub id: SequenceId,
    /// Emotion label, lower case.
    pub emotion: String,
    /// Folder of images, or video file; the first of [`SequenceEntry::pictures`] if these are listed.
    pub frames_path: PathBuf,
    /// Pictures listed one by one, numbered from 1; empty for a folder or a video.
    pub pictures: Vec<PathBuf>,
    /// Number of the neutral frame; the first if `None`.
    pub first_frame: Option<u32>,
    /// Number of the apex frame; the last if `None`.
    pub last_frame: Option<u32>,
    /// Correspondence file named by the manifest; it must exist.
    pub correspondences_path: Option<PathBuf>,
    /// Correspondence file that is used if none is named and this one exists.
    pub default_correspondences_path: PathBuf,
    /// Paths that are searched for landmarks, in this order; empty for a sequence without landmarks.
    pub landmarks_paths: Vec<PathBuf>,
    /// Frames per second, positive.
    pub fps: Option<f64>,
    /// Further columns of the manifest by name.
    pub metadata: BTreeMap<String, String>,
}

/// Manifest column that states whether people agreed to be shown.
pub const PUBLISH_COLUMN: &str = "publish";

/// Manifest column whose value `auto` marks a whole recording, in which sequences are to be found.
pub const SEGMENT_COLUMN: &str = "segment";

/// Whether a column is [`PUBLISH_COLUMN`], in any case.
pub fn is_publish_column(name: &str) -> bool {
    name.trim().eq_ignore_ascii_case(PUBLISH_COLUMN)
}

/// Values of [`PUBLISH_COLUMN`] that allow and that forbid to show pictures, in any case.
const PUBLISH_WORDS: [[&str; 3]; 2] = [["yes", "true", "1"], ["no", "false", "0"]];

/// Returns a note on how many sequences are not shown because of [`PUBLISH_COLUMN`], and on unknown words there; `None` if all are shown.
pub fn not_shown_said<'a>(sequences: impl Iterator<Item = (&'a str, &'a BTreeMap<String, String>)>) -> Option<String> {
    let (mut people, mut words, mut hidden) = (BTreeSet::new(), BTreeSet::new(), 0);
    for (subject, metadata) in sequences.filter(|(_, metadata)| !may_publish(metadata)) {
        people.insert(subject);
        hidden += 1;
        let field = metadata.iter().find(|(name, _)| is_publish_column(name)).map_or("", |(_, value)| value.trim());
        words.extend((!PUBLISH_WORDS[1].iter().any(|no| field.eq_ignore_ascii_case(no))).then_some(field));
    }
    let unknown = if words.is_empty() {
        String::new()
    } else {
        let words: Vec<String> = words.iter().map(|word| format!("`{word}`")).collect();
        format!("; other words than yes and no count as no: {}", listed(&words, 3))
    };
    (!people.is_empty()).then(|| {
        let (hidden, people) = (count(hidden, "sequence", "sequences"), count(people.len(), "person", "people"));
        format!("not shown in reports and pictures, by the column `{PUBLISH_COLUMN}`: {hidden} of {people}{unknown}")
    })
}

/// Whether pictures of a sequence with these further columns may be shown to others. It is used for measurements in any case. Without the
/// column, or with an empty field, pictures may be shown. Any value but `yes` (or `true`, `1`) forbids it, including a misspelled `no`.
pub fn may_publish(metadata: &BTreeMap<String, String>) -> bool {
    let field = metadata.iter().find(|(name, _)| is_publish_column(name)).map_or("", |(_, value)| value.trim());
    field.is_empty() || PUBLISH_WORDS[0].iter().any(|yes| field.eq_ignore_ascii_case(yes))
}

/// Source of a sequence's correspondences.
///
/// ```
/// use grimace::dataset::{CorrespondenceSource, Dataset};
///
/// let dataset = Dataset::open("fixtures/simulated".as_ref())?;
/// let source = dataset.sequences[0].correspondence_source()?;
/// assert!(matches!(source, CorrespondenceSource::File(path) if path.ends_with("S001/001/correspondences.csv")));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CorrespondenceSource {
    /// A file `node,x,y`.
    File(PathBuf),
    /// Landmarks of the neutral frame.
    Landmarks(PathBuf),
    /// No source.
    None,
}

/// Manifest column that selects one face of a landmark table.
pub(crate) const FACE_COLUMN: &str = "face_id";

impl SequenceEntry {
    /// Lists the frames from the neutral to the apex frame.
    ///
    /// # Errors
    /// As [`super::list_frames`].
    pub fn frames(&self) -> Result<FrameSource, FramesError> {
        if self.pictures.is_empty() {
            return Ok(frames_of_place(&self.frames_path, self.first_frame, self.last_frame)?.0);
        }
        frames_of_list(&self.pictures, self.first_frame, self.last_frame)
    }

    /// Lists all readable frames, also those before the neutral and after the apex frame.
    ///
    /// # Errors
    /// As [`super::list_readable`].
    pub(crate) fn readable_frames(&self) -> Result<FrameSource, FramesError> {
        if self.pictures.is_empty() { readable_of_place(&self.frames_path) } else { frames_of_list(&self.pictures, None, None) }
    }

    /// Lists the frames of a whole recording.
    ///
    /// # Errors
    /// As [`list_recording`].
    pub(crate) fn recording(&self) -> Result<FrameSource, FramesError> {
        if self.pictures.is_empty() { list_recording(&self.frames_path) } else { frames_of_list(&self.pictures, None, None) }
    }

    /// Folders with the frames, or the video file.
    pub(crate) fn places(&self) -> Vec<&Path> {
        if self.pictures.is_empty() {
            return vec![&self.frames_path];
        }
        let folders = self.pictures.iter().filter_map(|path| path.parent());
        folders.map(|folder| if folder.as_os_str().is_empty() { Path::new(".") } else { folder }).collect()
    }

    /// File for the marks of the neutral frame, existing or not: the one named in the manifest, else the default.
    pub fn marks_path(&self) -> &Path {
        self.correspondences_path.as_ref().unwrap_or(&self.default_correspondences_path)
    }

    /// Returns the source of correspondences: the named file, else the default file if it exists, else landmarks.
    ///
    /// # Errors
    /// [`DatasetError::CorrespondencesMissing`] or [`LandmarksError::NotFound`] for a named file that does not exist.
    pub fn correspondence_source(&self) -> Result<CorrespondenceSource, DatasetError> {
        if let Some(path) = &self.correspondences_path {
            if !path.is_file() {
                return Err(DatasetError::CorrespondencesMissing { id: self.id.clone(), path: path.clone() });
            }
            return Ok(CorrespondenceSource::File(path.clone()));
        }
        if self.default_correspondences_path.is_file() {
            return Ok(CorrespondenceSource::File(self.default_correspondences_path.clone()));
        }
        Ok(self.landmarks_path()?.map_or(CorrespondenceSource::None, |path| CorrespondenceSource::Landmarks(path.to_owned())))
    }

    /// Reads the correspondences of the neutral frame, whose number is [`FrameSource::neutral_number`].
    ///
    /// # Errors
    /// [`DatasetError`] when there are none, or the file or the landmarks cannot be read. Whether they are sufficient for a fit is checked
    /// by [`crate::correspondence::validate_correspondences`].
    pub fn correspondences(
        &self,
        neutral_number: u32,
        tables: &Tables,
        node_count: usize,
        selection: &LandmarkSelection,
    ) -> Result<Vec<Correspondence>, DatasetError> {
        match self.correspondence_source()? {
            CorrespondenceSource::File(path) => Ok(read_marks(&path, selection, tables, node_count)?),
            CorrespondenceSource::Landmarks(path) => {
                let track = read_face(&path, LEAST_CONFIDENCE, self.face_id())?;
                Ok(correspondences_from_landmarks(track.frame(neutral_number)?, tables, selection)?)
            }
            CorrespondenceSource::None => {
                let default = self.default_correspondences_path.clone();
                Err(DatasetError::NoCorrespondences { id: self.id.clone(), default })
            }
        }
    }

    /// Selected face of a landmark table: the manifest's column `face_id`.
    pub fn face_id(&self) -> Option<&str> {
        self.metadata.get(FACE_COLUMN).map(String::as_str)
    }

    /// File or folder of the landmarks; `None` for a sequence without landmarks.
    ///
    /// # Errors
    /// [`LandmarksError::NotFound`] when the manifest names a file that does not exist.
    pub fn landmarks_path(&self) -> Result<Option<&Path>, LandmarksError> {
        match self.landmarks_paths.iter().find(|path| path.exists()) {
            Some(path) => Ok(Some(path)),
            None if self.landmarks_paths.is_empty() => Ok(None),
            None => Err(LandmarksError::NotFound { paths: self.landmarks_paths.clone() }),
        }
    }

    /// Path of frames that the manifest names and that do not exist. Default paths are not checked.
    pub fn missing_frames(&self) -> Option<&Path> {
        let by_name = self.default_correspondences_path.parent();
        Some(self.frames_path.as_path()).filter(|path| Some(*path) != by_name && !path.exists())
    }

    /// Returns the landmarks that drive the sequence, if it is given as landmarks instead of images; `None` for images.
    ///
    /// These are the file or folder in the column `frames` or, if that does not exist or has no images, the one in `landmarks`. With
    /// `prefer`, landmarks drive the sequence even if there are images.
    ///
    /// # Errors
    /// [`LandmarksError`] for a named landmark file that does not exist, or a folder with several sets of landmarks.
    pub fn driving_landmarks(&self, prefer: bool) -> Result<Option<PathBuf>, LandmarksError> {
        let path = &self.frames_path;
        let named = || Ok(self.landmarks_path()?.map(Path::to_owned));
        if path.is_dir() {
            if has_frames(path) && !prefer {
                return Ok(None);
            }
            if !self.landmarks_paths.is_empty() {
                return named();
            }
            return Ok((!landmark_files(path)?.is_empty()).then(|| path.clone()));
        }
        if path.is_file() {
            if has_landmark_extension(path) {
                return Ok(Some(path.clone()));
            }
            return if prefer { named() } else { Ok(None) };
        }
        named()
    }

    /// Reads the landmarks; `None` for a sequence without landmarks.
    ///
    /// # Errors
    /// As [`SequenceEntry::landmarks_path`] and [`super::read_landmarks`].
    pub fn landmarks(&self) -> Result<Option<LandmarkTrack>, LandmarksError> {
        self.landmarks_path()?.map(|path| read_face(path, LEAST_CONFIDENCE, self.face_id())).transpose()
    }

    /// Labels: its id, its emotion, and the further columns of the manifest.
    pub(crate) fn labels(&self) -> (&SequenceId, &str, &BTreeMap<String, String>) {
        (&self.id, &self.emotion, &self.metadata)
    }

    /// Value of a manifest column to group by: `subject`, `sequence`, `emotion` or metadata; `None` for any other.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&str> {
        match name {
            "subject" => Some(&self.id.subject),
            "sequence" => Some(&self.id.sequence),
            "emotion" => Some(&self.emotion),
            _ => self.metadata.get(name).map(String::as_str),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_yes_and_nothing_let_a_face_be_shown() {
        let with = |value: &str| BTreeMap::from([("Publish".to_owned(), value.to_owned())]);
        assert!(may_publish(&BTreeMap::new()));
        for (value, shown) in
            [("", true), (" Yes ", true), ("1", true), ("no", false), ("No", false), ("n", false), ("nope", false)]
        {
            assert_eq!(may_publish(&with(value)), shown, "{value:?}");
        }
    }

    #[test]
    fn sequences_that_are_not_shown_are_counted_and_unknown_words_named() {
        let with = |value: &str| BTreeMap::from([("publish".to_owned(), value.to_owned())]);
        let said = |values: &[&str]| {
            let all: Vec<BTreeMap<String, String>> = values.iter().map(|value| with(value)).collect();
            not_shown_said(["a", "b", "b", "c"].into_iter().zip(&all))
        };
        assert_eq!(said(&["yes", "", "TRUE", "1"]), None);
        let expected = "not shown in reports and pictures, by the column `publish`: 3 sequences of 2 people";
        assert_eq!(said(&["no", "0", "No", "yes"]).unwrap(), expected);
        assert!(said(&["ja", "", "", ""]).unwrap().ends_with("1 person; other words than yes and no count as no: `ja`"));
    }
}
