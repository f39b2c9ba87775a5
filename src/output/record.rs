//! Records what a command wrote into a folder, so that a later one removes nothing else there.
//!
//! The record is a text file for `b3sum --check`: a line `HASH  NAME` for each file, with the BLAKE3 hash in hexadecimal and the name
//! relative to the folder. A line is added with each file, so that a killed program leaves no file unrecorded. At the end the lines are
//! sorted. The writer holds a lock on the record, if the file system supports locks, so that two concurrent commands cannot mix their
//! results.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    io::{self, Write},
    path::{Component, Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use super::{OutputError, write_atomic, write_hashed};
use crate::input::file_blake3;

/// The files that earlier commands and this one wrote into a folder.
#[derive(Debug)]
pub struct FolderRecord {
    folder: PathBuf,
    path: PathBuf,
    force: bool,
    /// Names from earlier commands, each with its recorded hashes.
    earlier: BTreeMap<String, BTreeSet<String>>,
    now: Mutex<Now>,
}

#[derive(Debug, Default)]
struct Now {
    journal: Option<fs::File>,
    written: BTreeMap<String, String>,
}

impl Now {
    /// Opens the record for appending, locked.
    fn journal(&mut self, path: &Path) -> io::Result<&mut fs::File> {
        let journal = if let Some(file) = self.journal.take() { file } else { locked(path)? };
        Ok(self.journal.insert(journal))
    }
}

/// Opens a file for appending with an exclusive lock.
fn locked(path: &Path) -> io::Result<fs::File> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    exclusive(fs::File::options().create(true).append(true).open(path)?)
}

/// Locks a file or folder.
fn exclusive(file: fs::File) -> io::Result<fs::File> {
    match file.try_lock() {
        Err(fs::TryLockError::WouldBlock) => {
            let reason = "another command is writing into this folder; wait for it, or choose another folder";
            Err(io::Error::new(io::ErrorKind::ResourceBusy, reason))
        }
        // The file system has no locks.
        Err(fs::TryLockError::Error(_)) | Ok(()) => Ok(file),
    }
}

/// Claims a folder, which is created if necessary, until the result is dropped. Nothing is written into it. Where folders cannot be locked,
/// nothing is claimed.
///
/// # Errors
/// [`OutputError`] when the folder cannot be created; of the kind [`io::ErrorKind::ResourceBusy`] while another command has claimed it.
pub fn claim_folder(folder: &Path) -> Result<Option<fs::File>, OutputError> {
    fs::create_dir_all(folder).map_err(OutputError::at(folder))?;
    let Ok(opened) = fs::File::open(folder) else { return Ok(None) };
    exclusive(opened).map(Some).map_err(OutputError::at(folder))
}

impl FolderRecord {
    /// Opens or starts the record `name` of a folder. With `force`, files that no earlier command wrote are overwritten, too.
    ///
    /// # Errors
    /// [`OutputError`] when an existing record cannot be read.
    pub fn open(folder: &Path, name: &str, force: bool) -> Result<Self, OutputError> {
        let path = folder.join(name);
        let bytes = match crate::input::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
            Err(error) => return Err(OutputError::at(&path)(error)),
        };
        let mut earlier: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        // A line truncated by a power failure matches no file.
        for (hash, name) in String::from_utf8_lossy(&bytes).lines().filter_map(|line| line.split_once("  ")) {
            if is_inside(name) {
                earlier.entry(name.to_owned()).or_default().insert(hash.to_owned());
            }
        }
        Ok(Self { folder: folder.to_owned(), path, force, earlier, now: Mutex::default() })
    }

    /// Starts writing into the folder, exclusively until this record is closed.
    ///
    /// # Errors
    /// [`OutputError`] when the record cannot be written; of the kind [`io::ErrorKind::ResourceBusy`] while another command writes into the
    /// folder.
    pub fn begin(&self) -> Result<(), OutputError> {
        let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        now.journal(&self.path).map(|_| ()).map_err(OutputError::at(&self.path))
    }

    /// Writes the file `name` in the folder with [`write_atomic`], and records it.
    ///
    /// # Errors
    /// [`OutputError`] when it cannot be written; of the kind [`io::ErrorKind::AlreadyExists`] when the file exists and no earlier command
    /// wrote it; as [`FolderRecord::begin`].
    pub fn write(&self, name: &str, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), OutputError> {
        self.check_free(name)?;
        self.begin()?;
        let path = self.folder.join(name);
        let hash = write_hashed(&path, fill)?.to_hex().to_string();
        self.wrote(name, hash)
    }

    /// Returns an error if the file `name` exists and no earlier command wrote it, unless forced.
    ///
    /// # Errors
    /// [`OutputError`] of the kind [`io::ErrorKind::AlreadyExists`].
    pub fn check_free(&self, name: &str) -> Result<(), OutputError> {
        let path = self.folder.join(name);
        if !self.force && !self.earlier.contains_key(name) && fs::symlink_metadata(&path).is_ok() {
            let reason = "it exists, but grimace did not write it; give --force to overwrite it";
            return Err(OutputError::at(&path)(io::Error::new(io::ErrorKind::AlreadyExists, reason)));
        }
        Ok(())
    }

    /// Records the file `name` that other code has just written into the folder.
    ///
    /// # Errors
    /// [`OutputError`] when it cannot be read or recorded.
    pub fn enter_written(&self, name: &str) -> Result<(), OutputError> {
        let path = self.folder.join(name);
        let unread = || OutputError::at(&path)(io::Error::new(io::ErrorKind::NotFound, "it cannot be read back"));
        let hash = file_blake3(&path).ok_or_else(unread)?;
        self.wrote(name, hash)
    }

    /// Records the file `name`, written with this hash.
    ///
    /// # Errors
    /// [`OutputError`] when the record cannot be written.
    pub fn wrote(&self, name: &str, hash: String) -> Result<(), OutputError> {
        self.enter(name, hash).map_err(OutputError::at(&self.path))
    }

    /// Whether an earlier command or this one recorded the file `name`.
    pub fn knows(&self, name: &str) -> bool {
        self.earlier.contains_key(name) || self.now.lock().unwrap_or_else(PoisonError::into_inner).written.contains_key(name)
    }

    fn enter(&self, name: &str, hash: String) -> io::Result<()> {
        let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        now.journal(&self.path)?.write_all(format!("{hash}  {name}\n").as_bytes())?;
        now.written.insert(name.to_owned(), hash);
        Ok(())
    }

    /// Whether an earlier command wrote the file `name` and it is unchanged.
    pub fn is_unchanged(&self, name: &str) -> bool {
        let hash = || file_blake3(&self.folder.join(name));
        self.earlier.get(name).is_some_and(|hashes| hash().is_some_and(|hash| hashes.contains(&hash)))
    }

    /// Whether earlier commands wrote files and all of them are unchanged.
    pub fn is_whole(&self) -> bool {
        !self.earlier.is_empty() && self.earlier.keys().all(|name| self.is_unchanged(name))
    }

    /// Removes unchanged files that earlier commands wrote and this one did not, and folders that become empty. Returns the names of
    /// changed files, which are kept and remain in the record.
    ///
    /// # Errors
    /// [`OutputError`] when a file cannot be removed.
    pub fn remove_stale(&self) -> Result<Vec<String>, OutputError> {
        let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        let mut kept = Vec::new();
        for (name, hashes) in &self.earlier {
            let path = self.folder.join(name);
            if now.written.contains_key(name) || fs::symlink_metadata(&path).is_err() {
                continue;
            }
            if self.is_unchanged(name) {
                fs::remove_file(&path).map_err(OutputError::at(&path))?;
                self.remove_empty_folders_of(name);
            } else {
                now.written.extend(hashes.iter().next_back().map(|hash| (name.clone(), hash.clone())));
                kept.push(name.clone());
            }
        }
        Ok(kept)
    }

    /// Removes the parent folders of a file that are empty, except the record's own folder.
    fn remove_empty_folders_of(&self, name: &str) {
        let folders = Path::new(name).ancestors().skip(1).filter(|folder| !folder.as_os_str().is_empty());
        // A folder that is not empty is not removed.
        let _ = folders.map(|folder| fs::remove_dir(self.folder.join(folder))).find(Result::is_err);
    }

    /// Keeps the files of earlier commands whose names match, as if this one had written them.
    pub(crate) fn keep(&self, fits: impl Fn(&str) -> bool) {
        let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        for (name, hashes) in self.earlier.iter().filter(|(name, _)| fits(name)) {
            if let Some(hash) = hashes.iter().next_back() {
                now.written.entry(name.clone()).or_insert_with(|| hash.clone());
            }
        }
    }

    /// Rewrites the record with sorted lines.
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn close(self) -> Result<(), OutputError> {
        let Now { written, journal } = self.now.into_inner().unwrap_or_else(PoisonError::into_inner);
        write_atomic(&self.path, |out| written.iter().try_for_each(|(name, hash)| writeln!(out, "{hash}  {name}")))?;
        drop(journal);
        Ok(())
    }
}

/// Whether a name stays inside its folder, even in a manipulated record.
pub(crate) fn is_inside(name: &str) -> bool {
    !name.is_empty() && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAME: &str = "frames.b3";

    fn write(folder: &Path, names: &[&str], force: bool) -> Result<Vec<String>, OutputError> {
        let record = FolderRecord::open(folder, NAME, force)?;
        for name in names {
            record.write(name, |out| out.write_all(name.as_bytes()))?;
        }
        let kept = record.remove_stale()?;
        record.close()?;
        Ok(kept)
    }

    #[test]
    fn two_do_not_write_into_one_folder_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let open = || FolderRecord::open(folder.path(), NAME, true).unwrap();
        let fill = |name: &'static str| move |out: &mut dyn Write| out.write_all(name.as_bytes());
        let (first, second) = (open(), open());
        first.write("a", fill("a")).unwrap();
        let error = second.write("b", fill("b")).unwrap_err();
        assert!(error.to_string().contains("another command is writing into this folder"), "{error}");
        assert!(!folder.path().join("b").exists());
        first.close().unwrap();
        open().write("b", fill("b")).unwrap();
    }

    #[test]
    fn only_recorded_and_unchanged_files_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        assert!(write(folder.path(), &["f/1.png", "f/2.png", "f/3.png"], false).unwrap().is_empty());
        let is_whole = || FolderRecord::open(folder.path(), NAME, false).unwrap().is_whole();
        assert!(is_whole());
        fs::write(at("f/2.png"), "edited").unwrap();
        assert!(!is_whole());
        fs::write(at("f/mine.png"), "mine").unwrap();
        let record = fs::read_to_string(at(NAME)).unwrap();
        fs::write(at(NAME), format!("{record}{}  ../outside\ncut off", blake3::hash(b"x").to_hex())).unwrap();
        fs::write(folder.path().parent().unwrap().join("outside"), "x").unwrap();
        assert_eq!(write(folder.path(), &["f/1.png"], false).unwrap(), ["f/2.png"]);
        assert!(folder.path().parent().unwrap().join("outside").exists());
        fs::remove_file(folder.path().parent().unwrap().join("outside")).unwrap();
        assert!(at("f/1.png").exists() && at("f/2.png").exists() && at("f/mine.png").exists() && !at("f/3.png").exists());
        // Kept files remain in the record and are reported again.
        assert_eq!(write(folder.path(), &["f/1.png"], false).unwrap(), ["f/2.png"]);
    }

    #[test]
    fn a_killed_writer_leaves_nothing_unrecorded() {
        let folder = tempfile::tempdir().unwrap();
        let record = FolderRecord::open(folder.path(), NAME, false).unwrap();
        record.write("1.png", |out| out.write_all(b"1")).unwrap();
        drop(record);
        assert!(write(folder.path(), &["2.png"], false).unwrap().is_empty());
        assert!(!folder.path().join("1.png").exists());
    }

    #[test]
    fn a_stranger_s_file_is_written_over_with_force_only() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("1.png"), "mine").unwrap();
        let error = write(folder.path(), &["1.png"], false).unwrap_err();
        assert_eq!(error.source.kind(), io::ErrorKind::AlreadyExists);
        assert!(error.to_string().contains("1.png") && error.to_string().contains("--force"), "{error}");
        assert_eq!(fs::read(folder.path().join("1.png")).unwrap(), b"mine");
        write(folder.path(), &["1.png"], true).unwrap();
        assert_eq!(fs::read(folder.path().join("1.png")).unwrap(), b"1.png");
    }
}
