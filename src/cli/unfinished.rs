//! Marks folders in which a command was interrupted, so that the next one may write into them.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use grimace::output::{OutputError, write_bytes};

/// Name of the file that is in a folder while a command writes into it.
pub const NAME: &str = "unfinished.txt";

/// Mark of a folder in which a command began to write and has not finished.
pub struct Unfinished {
    path: PathBuf,
}

impl Unfinished {
    /// The mark of a folder, whether it exists or not.
    pub fn in_folder(folder: &Path) -> Self {
        Self { path: folder.join(NAME) }
    }

    /// Whether a command began in the folder and did not finish.
    pub fn is_there(&self) -> bool {
        self.path.is_file()
    }

    /// Sets the mark.
    pub fn begin(&self) -> Result<(), OutputError> {
        write_bytes(
            &self.path,
            b"grimace synthesize is running or was interrupted; if you run it again, it rewrites this folder.\n",
        )
    }

    /// Removes the mark.
    pub fn end(&self) -> Result<(), OutputError> {
        match fs::remove_file(&self.path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(OutputError::at(&self.path)(error)),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_marked_until_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let mark = Unfinished::in_folder(folder.path());
        assert!(!mark.is_there());
        mark.begin().unwrap();
        assert!(Unfinished::in_folder(folder.path()).is_there());
        mark.end().unwrap();
        mark.end().unwrap();
        assert!(!mark.is_there());
    }
}
