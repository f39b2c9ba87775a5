//! Looking for sequences in folders.

use std::path::{Path, PathBuf};

use super::super::{
    DatasetError,
    frames::{is_picture, is_video, visible},
    unread::is_unread,
};

/// Folders within folders that are looked into.
const MOST_LEVELS: usize = 8;

/// Names of the records that a run and a clone leave in the folder of their results.
const RECORDS: [&str; 2] = ["run.json", "clone.json"];

/// What a folder and those below it hold.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// Folders of two images or more, and videos.
    pub sequences: Vec<PathBuf>,
    /// Folders with nothing or a single picture in them.
    pub left_out: Vec<PathBuf>,
    /// Files of formats that are not read.
    pub unread: Vec<PathBuf>,
    /// Folders with the results of a run or a clone.
    pub results: Vec<PathBuf>,
}

impl Found {
    /// All that is in a folder.
    pub fn in_folder(root: &Path) -> Result<Self, DatasetError> {
        let mut found = Self::default();
        found.look_into(root, &mut Vec::new())?;
        for paths in [&mut found.sequences, &mut found.left_out, &mut found.unread, &mut found.results] {
            paths.sort();
        }
        Ok(found)
    }

    /// `above` are the folders on the way here, without links.
    fn look_into(&mut self, folder: &Path, above: &mut Vec<PathBuf>) -> Result<(), DatasetError> {
        let failed = |reason| DatasetError::Io { path: folder.to_owned(), reason };
        let resolved = folder.canonicalize().map_err(failed)?;
        if above.contains(&resolved) || above.first().is_some_and(|root| root.starts_with(&resolved)) {
            // A link back to where it came from, or to what the dataset lies in.
            return Ok(());
        }
        let entries = visible(folder).map_err(failed)?;
        let paths: Vec<PathBuf> = entries.iter().map(std::fs::DirEntry::path).collect();
        if !above.is_empty() && paths.iter().any(|path| path.is_file() && RECORDS.iter().any(|record| path.ends_with(record))) {
            self.results.push(folder.to_owned());
            return Ok(());
        }
        match paths.iter().filter(|path| is_picture(path)).count() {
            0 if !paths.is_empty() => {}
            0 | 1 => self.left_out.push(folder.to_owned()),
            _ => self.sequences.push(folder.to_owned()),
        }
        let files = || paths.iter().filter(|path| path.is_file());
        self.sequences.extend(files().filter(|path| is_video(path)).cloned());
        self.unread.extend(files().filter(|path| is_unread(path)).cloned());
        if above.len() < MOST_LEVELS {
            above.push(resolved);
            paths.iter().filter(|path| path.is_dir()).try_for_each(|path| self.look_into(path, above))?;
            above.pop();
        }
        Ok(())
    }
}
