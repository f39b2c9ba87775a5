//! Errors of datasets.

use std::{io, path::PathBuf};

use super::{
    FramesError, LandmarksError, MarksFileError,
    frames::{IMAGE_EXTENSIONS, VIDEO_EXTENSIONS},
};
use crate::{
    input::InputError,
    output::{count, listed},
    text::excerpt,
    units::SequenceId,
};

/// Errors of a dataset or one of its sequences.
///
/// ```
/// use grimace::dataset::{Dataset, DatasetError};
///
/// let error = Dataset::open("no-such-folder".as_ref()).unwrap_err();
/// assert!(matches!(error, DatasetError::NotFound { path } if path.ends_with("no-such-folder")));
/// ```
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// No such file or folder.
    #[error("{}: there is no such dataset; give a folder with manifest.csv, or the manifest", path.display())]
    NotFound {
        /// The given path.
        path: PathBuf,
    },
    /// A video or a picture instead of a dataset.
    #[error(
        "{0}: this is a {kind}, not a dataset; `run` needs a folder with manifest.csv, or the manifest (`grimace init FOLDER` writes one for \
         a folder of videos or pictures); for this file alone, use `grimace {command} {0}`", path.display()
    )]
    NotDataset {
        /// The file.
        path: PathBuf,
        /// What it is.
        kind: &'static str,
        /// Command that takes it.
        command: &'static str,
    },
    /// A recording that was not divided into sequences.
    #[error("{}: {reason}", path.display())]
    Recording {
        /// The recording.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// Folders of frames without information about the emotions that they show.
    #[error(
        "{0}: the emotions are unknown; run `grimace init {0}`, which writes manifest.csv into this folder, and fill in one line per \
         sequence, such as\nsubject,sequence,emotion\n{subject},{sequence},happiness", root.display()
    )]
    NoManifest {
        /// The folder.
        root: PathBuf,
        /// First subject found.
        subject: String,
        /// Its first sequence with frames.
        sequence: String,
    },
    /// A manifest whose name has capital letters.
    #[error("{}: the manifest is called {found}; rename it to manifest.csv, or name the file instead of the folder", root.display())]
    ManifestName {
        /// The folder.
        root: PathBuf,
        /// Name of the file.
        found: String,
    },
    /// Nothing that looks like sequences.
    #[error(
        "{0}: no sequences found; expected manifest.csv with the columns `subject,sequence,emotion` (`grimace init {0}` writes it for \
         folders of images and videos), or Cohn-Kanade's folders cohn-kanade-images/SUBJECT/SEQUENCE and Emotion/SUBJECT/SEQUENCE",
        root.display()
    )]
    NothingFound {
        /// The folder.
        root: PathBuf,
    },
    /// One folder with pictures of several people and nothing else.
    #[error("{}: no sequences found: {}", root.display(), found.join("; "))]
    PicturesOfPeople {
        /// The folder.
        root: PathBuf,
        /// Kinds of content in the same folder.
        found: Vec<String>,
    },
    /// All files have unsupported formats.
    #[error(
        "{}: no sequences found, but {} in unsupported formats: {}; convert them to a supported format (pictures: {}; videos: {})",
        root.display(), count(files.len(), "file", "files"), listed(files, 6), IMAGE_EXTENSIONS.join(" "), VIDEO_EXTENSIONS.join(" ")
    )]
    NothingReadable {
        /// The folder.
        root: PathBuf,
        /// The files, relative to it.
        files: Vec<String>,
    },
    /// The folder has no sequences but results of grimace.
    #[error(
        "{}: no sequences found, only results of grimace, in {}; give the folder with the recordings",
        root.display(), listed(results, 6)
    )]
    OnlyResults {
        /// The folder.
        root: PathBuf,
        /// The folders with results, relative to it.
        results: Vec<String>,
    },
    /// Images in Cohn-Kanade's layout without the folder of labels.
    #[error("{}: there is no folder Emotion beside it; put CK+'s emotion labels there, or let `grimace init` write manifest.csv and fill in the emotions", images.display())]
    NoEmotionFolder {
        /// Folder of the subjects' images.
        images: PathBuf,
    },
    /// A table of people that lists nobody of the dataset.
    #[error(
        "{}: none of its subjects is in the dataset, whose first subject is `{subject}`{}", path.display(),
        if *only_zeros { "; without leading zeros some are: spreadsheets remove these from numbers, so store the column as text" } else { "" }
    )]
    NobodyKnown {
        /// The table.
        path: PathBuf,
        /// The first subject of the dataset.
        subject: String,
        /// Whether some subjects differ in leading zeros only.
        only_zeros: bool,
    },
    /// A person who appears twice in a table of people, with different fields.
    #[error("{}, line {line}: `{subject}` appears twice, with different values; keep one row", path.display())]
    Contradiction {
        /// The table.
        path: PathBuf,
        /// Line of the second, from 1.
        line: usize,
        /// The subject.
        subject: String,
    },
    /// A column of the manifest that is probably a misspelt known column, but would count as a column to group by.
    #[error("{}: the column `{found}` is unknown; if it is the column `{meant}`, rename it to that, otherwise give it a less similar \
         name", path.display())]
    MisspeltColumn {
        /// The manifest.
        path: PathBuf,
        /// The column.
        found: String,
        /// The similar known column.
        meant: String,
    },
    /// A folder that cannot be listed or a file that cannot be read.
    #[error("{}: cannot be read: {reason}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        #[source]
        reason: io::Error,
    },
    /// A manifest without rows.
    #[error("{}: the manifest lists no sequence", path.display())]
    EmptyManifest {
        /// The manifest.
        path: PathBuf,
    },
    /// A table cannot be read.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A row of the manifest that does not describe a sequence.
    #[error("{}, line {line}: {problem}", path.display())]
    Row {
        /// The manifest.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        problem: RowError,
    },
    /// A folder whose name cannot be an id.
    #[error("{}: {problem}", path.display())]
    FolderName {
        /// The folder.
        path: PathBuf,
        /// What is wrong.
        problem: RowError,
    },
    /// More than one emotion file for a sequence.
    #[error("{}: {found} files *_emotion.txt; one was expected", folder.display())]
    SeveralEmotions {
        /// Folder of the sequence's label.
        folder: PathBuf,
        /// Files found.
        found: usize,
    },
    /// An emotion file without a valid code.
    #[error("{}: found `{found}`; an emotion code was expected: {}", path.display(), super::cohn_kanade::CODES_IN_WORDS)]
    EmotionCode {
        /// The file.
        path: PathBuf,
        /// Its content, shortened.
        found: String,
    },
    /// Frames that cannot be listed.
    #[error(transparent)]
    Frames(#[from] FramesError),
    /// Landmarks cannot be read.
    #[error(transparent)]
    Landmarks(#[from] LandmarksError),
    /// Correspondences cannot be read.
    #[error(transparent)]
    #[doc(hidden)]
    Correspondences(#[from] MarksFileError),
    /// The sequence has neither correspondences nor landmarks.
    #[error(
        "{id}: no correspondences and no landmarks; mark 5 to 8 points of the neutral frame in {} with the columns `node,x,y`, or \
         name such a file in the manifest's column `correspondences`, or 68-point landmarks in its column `landmarks`",
        default.display()
    )]
    NoCorrespondences {
        /// The sequence.
        id: SequenceId,
        /// Default path of a correspondence file.
        default: PathBuf,
    },
    /// The manifest names a correspondence file that does not exist, or a folder.
    #[error("{id}: the correspondence file {} {}", path.display(), if path.is_dir() { "is a folder" } else { "is not there" })]
    CorrespondencesMissing {
        /// The sequence.
        id: SequenceId,
        /// The file.
        path: PathBuf,
    },
}

/// Errors in a row of a manifest.
///
/// ```
/// use grimace::dataset::{Dataset, DatasetError, RowError};
///
/// let folder = tempfile::tempdir()?;
/// std::fs::write(folder.path().join("manifest.csv"), "subject,sequence,emotion,frames\nP1,1,?,a\nP2,1,joy,b\n")?;
/// let dataset = Dataset::open(folder.path())?;
/// assert!(matches!(dataset.failures[0].error, DatasetError::Row { line: 2, problem: RowError::EmotionOpen, .. }));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RowError {
    /// The emotion is not filled in yet.
    #[error("the emotion is `?`; fill in the emotion of the sequence, or remove the row")]
    EmotionOpen,
    /// The emotion is a word that stands for a missing value.
    #[error("the emotion is `{value}`, a word for a missing value; fill in the emotion of the sequence, or remove the row")]
    EmotionMissing {
        /// The word.
        value: String,
    },
    /// A required field is empty.
    #[error("{column} is empty")]
    Empty {
        /// Column.
        column: &'static str,
    },
    /// A text that cannot be part of a file name.
    #[error("{column} is `{value}`, {reason}; choose another value, because results are named after it")]
    NotAFileName {
        /// Column.
        column: &'static str,
        /// The text.
        value: String,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// Two rows have the same subject and sequence.
    #[error("subject `{}`, sequence `{}` is already in line {first_line}; keep one row, or rename one", id.subject, id.sequence)]
    Duplicate {
        /// The sequence.
        id: SequenceId,
        /// Line of the first row, from 1.
        first_line: usize,
    },
    /// Two sequences whose files would have the same name.
    #[error("the results of this sequence and of the one in line {first_line} would both be named `{id}`; rename one")]
    SameFileName {
        /// The sequence.
        id: SequenceId,
        /// Line of the first row, from 1.
        first_line: usize,
    },
    /// Two sequences whose files have the same name on some file systems.
    #[error(
        "results named `{id}` and `{other}` would be the same file on systems that ignore case or normalize letters, such as macOS and \
         Windows; rename one"
    )]
    SimilarFileName {
        /// The sequence.
        id: SequenceId,
        /// The earlier sequence.
        other: Box<SequenceId>,
    },
    /// A frame range of a single frame.
    #[error("first_frame is {first} and last_frame is {last}; neutral and apex frame must differ")]
    FrameRange {
        /// Neutral frame.
        first: u32,
        /// Apex frame.
        last: u32,
    },
}

/// Largest length of a text as part of a file name, bytes.
const MAX_NAME_BYTES: usize = 100;

/// Checks that a text can be part of a file name on any system. `column` is named in the error.
///
/// # Errors
/// [`RowError`] with the reason.
pub fn check_file_name(column: &'static str, value: &str) -> Result<(), RowError> {
    let reason = match value {
        "" => return Err(RowError::Empty { column }),
        "." | ".." => "which is the name of a folder",
        _ if value.contains(['/', '\\']) => "with a path separator in it",
        _ if value.contains(char::is_control) => "with a control character in it",
        _ if value.len() > MAX_NAME_BYTES => "which is longer than 100 bytes",
        _ => return Ok(()),
    };
    Err(RowError::NotAFileName { column, value: excerpt(value), reason })
}

/// Key of a name on file systems that ignore case or normalize letters: equal keys mean the same file.
pub(crate) fn name_key(name: &str) -> String {
    use unicode_normalization::UnicodeNormalization;
    // Upper case first: it unifies letters that lower case distinguishes, such as the two small sigmas and sharp s.
    name.nfd().collect::<String>().to_uppercase().to_lowercase().nfc().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_a_file_system_takes_for_one_another_have_one_key() {
        for (a, b) in [("A_1", "a_1"), ("caf\u{e9}_1", "cafe\u{301}_1"), ("CAFE\u{301}", "caf\u{e9}"), ("stra\u{df}e", "STRASSE")]
        {
            assert_eq!(name_key(a), name_key(b), "{a} {b}");
        }
        for (a, b) in [("A_1", "A_2"), ("cafe", "caf\u{e9}")] {
            assert_ne!(name_key(a), name_key(b), "{a} {b}");
        }
    }
}
