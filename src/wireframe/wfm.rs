//! Reader of Candide `.wfm` files.

use std::path::{Path, PathBuf};

use super::{Wireframe, WireframeError};

/// What is wrong in a `.wfm` file.
#[derive(Debug, thiserror::Error)]
pub enum WfmErrorKind {
    /// The file can not be read.
    #[error("cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// The parts read do not make a wireframe.
    #[error(transparent)]
    Wireframe(#[from] WireframeError),
}

/// A `.wfm` file that does not read.
#[derive(Debug, thiserror::Error)]
#[error("{}: {kind}", path.display())]
pub struct WfmError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong.
    pub kind: WfmErrorKind,
}

/// Reads a `.wfm` file.
///
/// # Errors
/// [`WfmError`] with the line.
pub fn read_wfm(path: &Path) -> Result<Wireframe, WfmError> {
    let _ = std::fs::read(path).map_err(|e| WfmError { path: path.to_owned(), kind: e.into() })?;
    unimplemented!()
}
