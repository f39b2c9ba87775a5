//! Searches folders for sequences.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use super::super::{
    DatasetError,
    frames::{is_picture, is_video, visible},
    unread::is_unread,
};

/// Most levels of folders that are searched.
const MOST_LEVELS: usize = 8;

/// Record files that a run and a clone leave in their results folder.
const RECORDS: [&str; 2] = ["run.json", "clone.json"];

/// Record files that commands leave beside their output: lines `HASH  NAME`. Files with other names are other people's checksums.
const FILES_RECORDS: [&str; 6] = ["overlays.b3", "frames.b3", "analyze.b3", "features.b3", "figures.b3", "synthesize.b3"];

/// Name endings of pictures that this program writes: wireframes on frames and skins of representatives. They may have been copied without
/// a record.
const OWN_PICTURES: [&str; 2] = ["_overlay.png", "_skin.png"];

/// Content of a folder and those below it.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// Folders of two images or more, and videos.
    pub sequences: Vec<PathBuf>,
    /// Folders that are empty or have a single picture.
    pub left_out: Vec<PathBuf>,
    /// Files in unsupported formats.
    pub unread: Vec<PathBuf>,
    /// Folders with results of this program: those of a run or a clone, and those with pictures or videos of this program only.
    pub results: Vec<PathBuf>,
    /// Files that a record lists as written by this program.
    own: BTreeSet<PathBuf>,
}

impl Found {
    /// Searches a folder.
    pub fn in_folder(root: &Path) -> Result<Self, DatasetError> {
        let mut found = Self::default();
        found.look_into(root, &mut Vec::new())?;
        for paths in [&mut found.sequences, &mut found.left_out, &mut found.unread, &mut found.results] {
            paths.sort();
        }
        Ok(found)
    }

    /// Whether this program wrote a file.
    pub fn is_own(&self, path: &Path) -> bool {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        self.own.contains(path) || OWN_PICTURES.iter().any(|end| name.ends_with(end))
    }

    /// `above` are the parent folders with links resolved.
    fn look_into(&mut self, folder: &Path, above: &mut Vec<PathBuf>) -> Result<(), DatasetError> {
        let failed = |reason| DatasetError::Io { path: folder.to_owned(), reason };
        let resolved = folder.canonicalize().map_err(failed)?;
        if above.contains(&resolved) || above.first().is_some_and(|root| root.starts_with(&resolved)) {
            // A link back to a parent folder.
            return Ok(());
        }
        let entries = visible(folder).map_err(failed)?;
        let paths: Vec<PathBuf> = entries.iter().map(std::fs::DirEntry::path).collect();
        if !above.is_empty() && paths.iter().any(|path| path.is_file() && RECORDS.iter().any(|record| path.ends_with(record))) {
            self.results.push(folder.to_owned());
            return Ok(());
        }
        self.own.extend(paths.iter().flat_map(|path| recorded(folder, path)));
        let is_own = |path: &&PathBuf| self.is_own(path);
        let (own, files): (Vec<&PathBuf>, Vec<&PathBuf>) = paths.iter().filter(|path| path.is_file()).partition(is_own);
        let has_own = own.iter().any(|path| is_picture(path) || is_video(path));
        let videos: Vec<PathBuf> = files.iter().filter(|path| is_video(path)).map(|&path| path.clone()).collect();
        match files.iter().filter(|path| is_picture(path)).count() {
            0 if has_own && videos.is_empty() => self.results.push(folder.to_owned()),
            0 if !paths.is_empty() => {}
            0 | 1 => self.left_out.push(folder.to_owned()),
            _ => self.sequences.push(folder.to_owned()),
        }
        self.sequences.extend(videos);
        self.unread.extend(files.into_iter().filter(|path| is_unread(path)).cloned());
        if above.len() < MOST_LEVELS {
            above.push(resolved);
            paths.iter().filter(|path| path.is_dir()).try_for_each(|path| self.look_into(path, above))?;
            above.pop();
        }
        Ok(())
    }
}

/// The files listed in `path`, if it is a record of a command's output in a folder.
fn recorded(folder: &Path, path: &Path) -> Vec<PathBuf> {
    if !FILES_RECORDS.iter().any(|record| path.ends_with(record)) {
        return Vec::new();
    }
    let text = crate::input::read(path).unwrap_or_default();
    let names = String::from_utf8_lossy(&text);
    names.lines().filter_map(|line| line.split_once("  ")).map(|(_, name)| folder.join(name)).collect()
}
