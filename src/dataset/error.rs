//! What can be wrong with a dataset.

use std::{io, path::PathBuf};

use super::{FramesError, LandmarksError};
use crate::{correspondence::CorrespondenceError, input::InputError, text::excerpt, units::SequenceId};

/// What is wrong with a dataset or one of its sequences.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// No such file or folder.
    #[error("{}: there is no such dataset; give a folder with manifest.csv, or the manifest", path.display())]
    NotFound {
        /// What was asked for.
        path: PathBuf,
    },
    /// Folders of frames, but nothing that says which emotions they show.
    #[error(
        "{}: the emotions are not known; write manifest.csv into this folder with a line for every sequence, such as\n\
         subject,sequence,emotion\n{subject},{sequence},happiness", root.display()
    )]
    NoManifest {
        /// The folder.
        root: PathBuf,
        /// First subject found.
        subject: String,
        /// First sequence of it with frames.
        sequence: String,
    },
    /// Nothing that looks like sequences.
    #[error(
        "{}: no sequences found; expected manifest.csv with the columns `subject,sequence,emotion`, or Cohn-Kanade's folders \
         cohn-kanade-images/SUBJECT/SEQUENCE and Emotion/SUBJECT/SEQUENCE", root.display()
    )]
    NothingFound {
        /// The folder.
        root: PathBuf,
    },
    /// Images in Cohn-Kanade's layout without the folder of labels.
    #[error("{}: there is no folder Emotion beside it; put CK+'s emotion labels there, or write manifest.csv", images.display())]
    NoEmotionFolder {
        /// Folder of the subjects' images.
        images: PathBuf,
    },
    /// A manifest's column that would pass for something to group by, and is hardly meant so.
    #[error("{}: the column `{found}` is not known; if it is `{meant}`, name it so, else name it less alike", path.display())]
    MisspeltColumn {
        /// The manifest.
        path: PathBuf,
        /// The column.
        found: String,
        /// The known column that it is nearly.
        meant: String,
    },
    /// A folder that cannot be listed or a file that cannot be read.
    #[error("{}: cannot be read: {reason}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        reason: io::Error,
    },
    /// A manifest without a row.
    #[error("{}: the manifest lists no sequence", path.display())]
    EmptyManifest {
        /// The manifest.
        path: PathBuf,
    },
    /// A table that does not read.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A manifest row that is no sequence.
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
    /// An emotion file with something else than a code.
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
    /// Landmarks that do not read.
    #[error(transparent)]
    Landmarks(#[from] LandmarksError),
    /// Correspondences that do not read.
    #[error(transparent)]
    Correspondences(#[from] CorrespondenceError),
    /// Neither correspondences nor landmarks.
    #[error(
        "{id}: no correspondences and no landmarks; mark 5 to 8 points of the neutral frame in {} with the columns `node,x,y`, or \
         name such a file in the manifest's column `correspondences`, or 68-point landmarks in its column `landmarks`",
        default.display()
    )]
    NoCorrespondences {
        /// The sequence.
        id: SequenceId,
        /// Where a correspondence file is looked for.
        default: PathBuf,
    },
    /// A correspondence file named in the manifest that is not there.
    #[error("{id}: the correspondence file {} is not there", path.display())]
    CorrespondencesMissing {
        /// The sequence.
        id: SequenceId,
        /// The file.
        path: PathBuf,
    },
}

/// What is wrong with a row of a manifest.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RowError {
    /// A required field without content.
    #[error("{column} is empty")]
    Empty {
        /// Column.
        column: &'static str,
    },
    /// A text that cannot be part of a file name.
    #[error("{column} is `{value}`, {reason}; results are named after it")]
    NotAFileName {
        /// Column.
        column: &'static str,
        /// The text.
        value: String,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// The same subject and sequence twice.
    #[error("subject `{}`, sequence `{}` stands in line {first_line} already", id.subject, id.sequence)]
    Duplicate {
        /// The sequence.
        id: SequenceId,
        /// Line of the first row, from 1.
        first_line: usize,
    },
    /// Two sequences whose files would have the same name.
    #[error("results of this sequence and of that in line {first_line} would both be named `{id}`; rename one")]
    SameFileName {
        /// The sequence.
        id: SequenceId,
        /// Line of the first row, from 1.
        first_line: usize,
    },
    /// A frame range that is empty or a single frame.
    #[error("first_frame is {first} and last_frame is {last}; the apex must come after the neutral frame")]
    FrameRange {
        /// Neutral frame.
        first: u32,
        /// Apex frame.
        last: u32,
    },
}

/// Longest text taken as part of a file name, bytes.
const MAX_NAME_BYTES: usize = 100;

/// Checks that a text can be part of a file name on any system.
pub(super) fn check_file_name(column: &'static str, value: &str) -> Result<(), RowError> {
    let reason = match value {
        "" => return Err(RowError::Empty { column }),
        "." | ".." => "which is a folder of its own",
        _ if value.contains(['/', '\\']) => "with a path separator in it",
        _ if value.contains(char::is_control) => "with a control character in it",
        _ if value.len() > MAX_NAME_BYTES => "which is longer than 100 bytes",
        _ => return Ok(()),
    };
    Err(RowError::NotAFileName { column, value: excerpt(value), reason })
}
