//! Opens all files given by users.
//!
//! An input is a regular file of limited size, because a pipe or a device could block or never end. For piped data, the path [`STDIN`]
//! denotes standard input. Only videos, banks and columnar models, which are read in parts, may have any length.

use std::{
    fs::{self, File, FileType},
    io::{self, Read, Seek, SeekFrom},
    path::Path,
};

/// The path that denotes standard input.
pub const STDIN: &str = "-";

/// Largest file that is read as a whole, bytes: a gibibyte, ten times the landmarks of an hour of video.
pub const MAX_BYTES: u64 = 1 << 30;

/// Whether a path denotes standard input.
#[must_use]
pub fn is_stdin(path: &Path) -> bool {
    path.as_os_str() == STDIN
}

/// Opens a regular file of any length.
///
/// # Errors
/// [`io::Error`] when it cannot be opened or is a folder, a pipe, a socket or a device.
pub fn open_file(path: &Path) -> io::Result<File> {
    // Checked before opening: opening a pipe waits for a writer.
    check_regular(fs::metadata(path)?.file_type())?;
    let file = File::open(path)?;
    check_regular(file.metadata()?.file_type())?;
    Ok(file)
}

/// Reads a regular file of at most `MAX_BYTES`.
///
/// # Errors
/// As `open_file`, and when the file is larger.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let file = open_file(path)?;
    let length = file.metadata()?.len();
    bounded(file, length)
}

/// BLAKE3 of a file, in hexadecimal; `None` when it cannot be read, as for embedded files.
pub fn file_blake3(path: &Path) -> Option<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(open_file(path).ok()?).ok()?;
    Some(hasher.finalize().to_hex().to_string())
}

/// As [`read`]; the path [`STDIN`] reads standard input.
///
/// # Errors
/// As [`read`].
pub fn read_or_stdin(path: &Path) -> io::Result<Vec<u8>> {
    if is_stdin(path) { bounded(io::stdin().lock(), 0) } else { read(path) }
}

/// As [`open_file`]; for the path [`STDIN`] it opens a temporary copy of standard input, which needs as much disk space as the input.
///
/// # Errors
/// As [`open_file`], and when the copy cannot be written.
pub fn open_or_stdin(path: &Path) -> io::Result<File> {
    if !is_stdin(path) {
        return open_file(path);
    }
    let mut copy = tempfile::tempfile()?;
    io::copy(&mut io::stdin().lock(), &mut copy)?;
    copy.seek(SeekFrom::Start(0))?;
    Ok(copy)
}

fn bounded(reader: impl Read, length: u64) -> io::Result<Vec<u8>> {
    let too_large = |length: String| {
        let reason = format!("it has {length} bytes, more than the limit of {MAX_BYTES}");
        io::Error::new(io::ErrorKind::FileTooLarge, reason)
    };
    if length > MAX_BYTES {
        return Err(too_large(length.to_string()));
    }
    let mut bytes = Vec::with_capacity(usize::try_from(length).unwrap_or(0));
    // The stated length may be 0 for a non-empty file, and the file may grow.
    reader.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(too_large(format!("more than {MAX_BYTES}")));
    }
    Ok(bytes)
}

fn check_regular(found: FileType) -> io::Result<()> {
    if found.is_file() {
        return Ok(());
    }
    let what = if found.is_dir() { "a folder" } else { special(found) };
    Err(io::Error::new(io::ErrorKind::InvalidInput, format!("it is {what}; a regular file was expected")))
}

#[cfg(unix)]
fn special(found: FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    match () {
        () if found.is_fifo() => "a named pipe",
        () if found.is_socket() => "a socket",
        () if found.is_char_device() || found.is_block_device() => "a device",
        () => "no regular file",
    }
}

#[cfg(not(unix))]
fn special(_: FileType) -> &'static str {
    "no regular file"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_of_bounded_size_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        fs::write(&path, b"text").unwrap();
        assert_eq!(read(&path).unwrap(), b"text");
        assert_eq!(read(folder.path()).unwrap_err().to_string(), "it is a folder; a regular file was expected");
        assert_eq!(read(&folder.path().join("none")).unwrap_err().kind(), io::ErrorKind::NotFound);
        // A sparse file needs no disk space.
        File::create(&path).unwrap().set_len(MAX_BYTES + 1).unwrap();
        assert_eq!(read(&path).unwrap_err().to_string(), "it has 1073741825 bytes, more than the limit of 1073741824");
        assert!(open_file(&path).is_ok(), "a file that is read in parts may be long");
    }

    #[cfg(unix)]
    #[test]
    fn devices_pipes_and_sockets_are_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let socket = folder.path().join("socket");
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        assert_eq!(read(&socket).unwrap_err().to_string(), "it is a socket; a regular file was expected");
        assert_eq!(read(Path::new("/dev/zero")).unwrap_err().to_string(), "it is a device; a regular file was expected");
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if made.is_ok_and(|status| status.success()) {
            assert_eq!(read(&pipe).unwrap_err().to_string(), "it is a named pipe; a regular file was expected");
        }
    }
}
