//! Ensures that written files are on disk.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use super::{OutputError, pending::folder_of};

/// Largest number of files that are synced one by one; above it, the whole file system is synced if the system supports that.
const FEW: usize = 256;

/// Renamed files that may not be on disk yet.
struct Written {
    files: BTreeSet<PathBuf>,
    folders: BTreeSet<PathBuf>,
}

static WRITTEN: Mutex<Written> = Mutex::new(Written { files: BTreeSet::new(), folders: BTreeSet::new() });

/// Registers a file for [`sync_written`].
pub(super) fn note(file: &Path) {
    let mut written = WRITTEN.lock().unwrap_or_else(PoisonError::into_inner);
    // For many files, their folders suffice, which avoids storing a million names.
    if cfg!(not(target_os = "linux")) || written.files.len() <= FEW {
        written.files.insert(file.to_owned());
    }
    let folder = folder_of(file);
    if !written.folders.contains(folder) {
        written.folders.insert(folder.to_owned());
    }
}

/// Syncs all results written so far, files and folders. It is called at the end of a command, before it reports success.
///
/// # Errors
/// [`OutputError`] with the file when the disk fails.
pub fn sync_written() -> Result<(), OutputError> {
    let written = {
        let mut noted = WRITTEN.lock().unwrap_or_else(PoisonError::into_inner);
        Written { files: std::mem::take(&mut noted.files), folders: std::mem::take(&mut noted.folders) }
    };
    #[cfg(target_os = "linux")]
    if written.files.len() > FEW {
        for path in &written.folders {
            // A removed folder needs no syncing. The first call for a file system syncs everything on it.
            match fs::File::open(path) {
                Ok(opened) => rustix::fs::syncfs(&opened).map_err(|e| OutputError::at(path)(e.into()))?,
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(OutputError::at(path)(error)),
            }
        }
        return Ok(());
    }
    for path in &written.files {
        sync(path).map_err(OutputError::at(path))?;
    }
    for path in &written.folders {
        folder(path).map_err(OutputError::at(path))?;
    }
    Ok(())
}

/// Syncs a file. A file that was removed or replaced needs no syncing.
fn sync(path: &Path) -> io::Result<()> {
    match fs::symlink_metadata(path) {
        Ok(found) if found.is_file() => {}
        _ => return Ok(()),
    }
    match fs::File::open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        opened => opened?.sync_all(),
    }
}

/// Syncs the names in a folder, if the system supports that.
pub(super) fn folder(path: &Path) -> io::Result<()> {
    #[cfg(unix)]
    match fs::File::open(path) {
        Ok(opened) => match opened.sync_all() {
            // Some network file systems cannot sync folders: they store names on the server immediately.
            Err(error) if error.kind() == io::ErrorKind::InvalidInput => {}
            synced => synced?,
        },
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        Err(error) => return Err(error),
    }
    #[cfg(not(unix))]
    let _ = path;
    Ok(())
}

/// Creates a folder and its parents; new ones are synced in their parent folders.
pub(crate) fn create_folders(path: &Path) -> io::Result<()> {
    if path.is_dir() {
        return Ok(());
    }
    let mut missing = path;
    let mut new = vec![path];
    while let Some(parent) = missing.parent().filter(|p| !p.as_os_str().is_empty() && !p.is_dir()) {
        new.push(parent);
        missing = parent;
    }
    if let Some(link) = path.ancestors().find(|p| p.is_symlink() && !p.exists()) {
        let named = if link == path { "it".to_owned() } else { link.display().to_string() };
        let reason = format!("{named} is a link to a folder that does not exist; remove the link or create the folder");
        return Err(io::Error::new(io::ErrorKind::NotFound, reason));
    }
    fs::create_dir_all(path)?;
    new.into_iter().try_for_each(|created| folder(folder_of(created)))
}

/// Removes a file durably; a missing file is not an error.
///
/// # Errors
/// [`OutputError`] when it cannot be removed.
pub fn remove_durably(path: &Path) -> Result<(), OutputError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        removed => removed.map_err(OutputError::at(path))?,
    }
    folder(folder_of(path)).map_err(OutputError::at(path))
}
