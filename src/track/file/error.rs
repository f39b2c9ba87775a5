//! Errors of track files.

use std::path::PathBuf;

use super::{super::in_picture::NotInPicture, TRACK_SCHEMA};
use crate::{input::InputError, plausible::Implausible, positions::PositionsError};

/// A track file that does not read.
///
/// ```
/// use grimace::track::{TrackFileError, read_track};
///
/// let error = read_track("no-such-track.csv".as_ref()).unwrap_err();
/// assert!(matches!(error, TrackFileError::Io { .. }) && error.to_string().starts_with("cannot read no-such-track.csv"));
/// ```
#[derive(Debug, thiserror::Error)]
pub enum TrackFileError {
    /// The file cannot be opened.
    #[error("cannot read {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A table cannot be read.
    #[error(transparent)]
    Table(#[from] InputError),
    /// The positions do not form a track.
    #[error(transparent)]
    Positions(#[from] PositionsError),
    /// An invalid state of a node.
    #[error("{}, line {line}: {reason}", path.display())]
    State {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What stands there, and what states there are.
        reason: String,
    },
    /// The file is a representative, not a track.
    #[error("{}: this is a representative, not a track; tracks are in the folder tracks of a run", path.display())]
    Representative {
        /// The table.
        path: PathBuf,
    },
    /// The file is a normalized model, not a track.
    #[error(
        "{}: this is a normalized model in face units, not a track; tracks are in the folder tracks of a run",
        path.display()
    )]
    Normalized {
        /// The table.
        path: PathBuf,
    },
    /// A `.csv` that is incomplete according to the `.json` beside it.
    #[error("{}: {reason}: the file is truncated or was changed; track the sequence again", path.display())]
    Cut {
        /// The file.
        path: PathBuf,
        /// What is missing.
        reason: String,
    },
    /// The nodes form a face whose y points up.
    #[error("{}: {}", path.display(), NotInPicture::YUpwards)]
    YUpwards {
        /// The file.
        path: PathBuf,
    },
    /// The nodes form a face whose left and right are exchanged.
    #[error("{}: {}", path.display(), NotInPicture::Mirrored)]
    Mirrored {
        /// The file.
        path: PathBuf,
    },
    /// A node lies nowhere near its face.
    #[error("{}: {source}", path.display())]
    Implausible {
        /// The file.
        path: PathBuf,
        /// Which, and where.
        source: Implausible,
    },
    /// The `.json` has a newer layout.
    #[error("{}: schema version {found}; this program reads {TRACK_SCHEMA}; it comes from a newer version of grimace; use that version", path.display())]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: u64,
    },
    /// The times in the `.json` do not match the track.
    #[error("{}: {reason}; correct the file, or track the sequence again", path.display())]
    Times {
        /// The file.
        path: PathBuf,
        /// What is wrong, with the value.
        reason: String,
    },
    /// The `.json` cannot be read.
    #[error("{}: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Why, with the line.
        source: serde_json::Error,
    },
}
