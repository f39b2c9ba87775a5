//! Files in progress: written under a temporary name, hashed, then renamed.

use std::{
    fs, io,
    io::Write,
    path::{Path, PathBuf},
};

use super::{OutputError, sweep, sync};

/// The regular file that a path denotes, existing or not: the path itself, or the target of a link.
///
/// # Errors
/// [`OutputError`] for anything else (a folder, a device, a pipe, a socket) or a broken link: none of these is ever replaced.
pub fn target_of(path: &Path) -> Result<PathBuf, OutputError> {
    let refuse = |what: &str| OutputError { path: path.to_owned(), source: io::Error::new(io::ErrorKind::InvalidInput, what) };
    let found = match fs::symlink_metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(path.to_owned()),
        found => found.map_err(OutputError::at(path))?,
    };
    if !found.is_symlink() {
        return special(found.file_type()).map_or_else(|| Ok(path.to_owned()), |what| Err(refuse(what)));
    }
    // Checked before resolving the link: the target of /dev/stdout may have no path.
    let behind = match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return Err(refuse("it is a link to a file that does not exist; remove the link or create the file"));
        }
        behind => behind.map_err(OutputError::at(path))?,
    };
    match special(behind.file_type()) {
        Some(what) => Err(refuse(what)),
        None => fs::canonicalize(path).map_err(OutputError::at(path)),
    }
}

/// Description of a file that is not regular, with advice.
fn special(kind: fs::FileType) -> Option<&'static str> {
    if kind.is_file() {
        return None;
    }
    if kind.is_dir() {
        return Some("it is a folder; give the name of a file");
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if kind.is_fifo() {
            return Some("it is a pipe, but results are written to regular files only; give the name of a file");
        }
        if kind.is_socket() {
            return Some("it is a socket, but results are written to regular files only; give the name of a file");
        }
    }
    Some("it is a device, but results are written to regular files only; give the name of a file")
}

/// The folder of a file, `.` for a bare name.
pub(super) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A file under a temporary name in its target folder. It hashes what is written, and is deleted when dropped.
#[derive(Debug)]
pub struct PendingFile {
    path: PathBuf,
    target: PathBuf,
    file: tempfile::NamedTempFile,
    hasher: blake3::Hasher,
}

impl PendingFile {
    /// Creates the temporary file for `path`. Missing parent folders are created.
    ///
    /// # Errors
    /// [`OutputError`] when a folder or the file cannot be created, or as [`target_of`].
    pub fn create(path: &Path) -> Result<Self, OutputError> {
        let error = OutputError::at(path);
        let target = target_of(path)?;
        let folder = folder_of(&target);
        sync::create_folders(folder).map_err(|source| OutputError { path: path.to_owned(), source })?;
        sweep::once(folder);
        let prefix = sweep::prefix();
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(sweep::SUFFIX);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // Less what the user's mask takes away.
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        let file = builder.tempfile_in(folder).map_err(error)?;
        sweep::lock(file.as_file());
        Ok(Self { path: path.to_owned(), target, file, hasher: blake3::Hasher::new() })
    }

    /// Renames the complete file to its path and returns the BLAKE3 of its bytes. It is on disk after [`super::sync_written`].
    ///
    /// # Errors
    /// [`OutputError`] when it cannot be renamed.
    pub fn persist(self) -> Result<blake3::Hash, OutputError> {
        let Self { path, target, file, hasher } = self;
        file.persist(&target).map_err(|e| OutputError { path, source: e.error })?;
        sync::note(&target);
        Ok(hasher.finalize())
    }

    /// As [`PendingFile::persist`]; file and name are on disk when it returns.
    ///
    /// # Errors
    /// [`OutputError`] when it cannot be synced or renamed.
    pub fn persist_durably(self) -> Result<blake3::Hash, OutputError> {
        let Self { path, target, file, hasher } = self;
        file.as_file().sync_all().map_err(OutputError::at(&path))?;
        file.persist(&target).map_err(|e| OutputError { path: path.clone(), source: e.error })?;
        sync::folder(folder_of(&target)).map_err(OutputError::at(&path))?;
        Ok(hasher.finalize())
    }
}

impl Write for PendingFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.hasher.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// A temporary folder beside a file's path, for encoders that need a file name of their own.
#[derive(Debug)]
pub struct PendingFolder {
    path: PathBuf,
    target: PathBuf,
    folder: tempfile::TempDir,
}

impl PendingFolder {
    /// Creates the folder for the file `path`. Missing parent folders are created.
    ///
    /// # Errors
    /// As [`PendingFile::create`].
    pub fn create(path: &Path) -> Result<Self, OutputError> {
        let target = target_of(path)?;
        let parent = folder_of(&target);
        sync::create_folders(parent).map_err(OutputError::at(path))?;
        sweep::once(parent);
        let prefix = sweep::prefix();
        let folder = tempfile::Builder::new().prefix(&prefix).suffix(sweep::SUFFIX).tempdir_in(parent);
        let folder = folder.map_err(OutputError::at(path))?;
        Ok(Self { path: path.to_owned(), target, folder })
    }

    /// Path for the encoder.
    #[must_use]
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Renames the file `name` in the folder to the target path.
    ///
    /// # Errors
    /// [`OutputError`] when it cannot be renamed.
    pub fn persist(self, name: &str) -> Result<(), OutputError> {
        fs::rename(self.file(name), &self.target).map_err(OutputError::at(&self.path))?;
        sync::note(&self.target);
        Ok(())
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::{FileTypeExt, symlink};

    use super::*;
    use crate::output::{write_bytes, write_hashed};

    #[test]
    fn what_was_written_is_hashed_without_reading_it_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let hash = write_hashed(&path, |w| w.write_all(b"abc").and_then(|()| w.write_all(b"def"))).unwrap();
        assert_eq!(hash, blake3::hash(b"abcdef"));
        assert_eq!(fs::read(&path).unwrap(), b"abcdef");
    }

    #[test]
    fn a_link_stays_a_link_and_its_file_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let (behind, link) = (folder.path().join("deep/behind.csv"), folder.path().join("link.csv"));
        write_bytes(&behind, b"old").unwrap();
        symlink(&behind, &link).unwrap();
        write_bytes(&link, b"new").unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&behind).unwrap(), b"new");
    }

    #[test]
    fn pipes_folders_sockets_and_dead_links_are_refused_and_stay() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let message = |name: &str| write_bytes(&at(name), b"x").unwrap_err().to_string();
        rustix::fs::mknodat(rustix::fs::CWD, at("pipe"), rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
        assert!(message("pipe").contains("it is a pipe"), "{}", message("pipe"));
        assert!(fs::symlink_metadata(at("pipe")).unwrap().file_type().is_fifo());
        let _listener = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        assert!(message("socket").contains("it is a socket"));
        symlink(at("nothing"), at("dead")).unwrap();
        assert!(message("dead").contains("link to a file that does not exist"));
        let (_reader, writer) = std::io::pipe().unwrap();
        let fd = std::os::fd::AsRawFd::as_raw_fd(&writer);
        symlink(format!("/proc/self/fd/{fd}"), at("stdout")).unwrap();
        if Path::new("/proc/self/fd").exists() {
            assert!(
                message("stdout").contains("it is a pipe, but results are written to regular files only"),
                "{}",
                message("stdout")
            );
        }
        symlink("/dev/null", at("null")).unwrap();
        assert!(message("null").contains("it is a device"));
        fs::create_dir(at("folder")).unwrap();
        assert!(message("folder").contains("it is a folder"));
        assert!(fs::read_dir(folder.path()).unwrap().all(|e| !e.unwrap().file_name().to_string_lossy().contains(".tmp")));
    }
}
