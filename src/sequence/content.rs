//! Hash of a sequence's content: the names of its files and their bytes.

use std::{fs, io, io::Read, path::Path, time::SystemTime};

use super::{DecodeError, SequenceError};
use crate::{dataset::FrameSource, input};

/// Hashes the names and bytes of a sequence's files in order.
#[derive(Debug, Default)]
pub(super) struct ContentHasher(blake3::Hasher);

impl ContentHasher {
    /// Reads a file and hashes its name and the returned bytes.
    pub(super) fn read(&mut self, path: &Path) -> io::Result<Vec<u8>> {
        let bytes = input::read(path)?;
        self.begin(path, bytes.len() as u64);
        self.0.update(&bytes);
        Ok(bytes)
    }

    /// Hashes a file of any length in pieces.
    fn read_through(&mut self, path: &Path) -> io::Result<()> {
        let mut file = input::open_file(path)?;
        let length = file.metadata()?.len();
        self.begin(path, length);
        let mut read = 0;
        let mut piece = vec![0; 1 << 16];
        loop {
            match file.read(&mut piece)? {
                0 => break,
                count => {
                    self.0.update(&piece[..count]);
                    read += count as u64;
                }
            }
        }
        if read == length {
            Ok(())
        } else {
            Err(io::Error::new(io::ErrorKind::InvalidData, "the file was changed while it was read"))
        }
    }

    fn begin(&mut self, path: &Path, length: u64) {
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        self.0.update(&(name.len() as u64).to_le_bytes());
        self.0.update(name.as_bytes());
        self.0.update(&length.to_le_bytes());
    }

    pub(super) fn finish(&self) -> blake3::Hash {
        self.0.finalize()
    }
}

/// BLAKE3 of the names and bytes of a sequence's files. Nothing is decoded.
///
/// # Errors
/// [`SequenceError`] when a file cannot be read.
pub fn content_blake3(source: &FrameSource) -> Result<blake3::Hash, SequenceError> {
    let mut hasher = ContentHasher::default();
    for path in source.files() {
        hasher.read_through(path).map_err(|e| SequenceError::Decode { path: path.to_owned(), source: DecodeError::Io(e) })?;
    }
    Ok(hasher.finish())
}

/// State of a file from its folder entry. It differs after every write, and for another file in its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Stamp {
    length: u64,
    modified: Option<SystemTime>,
    /// Device, inode number, and time of the last change of any kind.
    #[cfg(unix)]
    change: (u64, u64, i64, i64),
}

impl Stamp {
    pub(super) fn of(path: &Path) -> io::Result<Self> {
        let found = fs::metadata(path)?;
        Ok(Self {
            length: found.len(),
            modified: found.modified().ok(),
            #[cfg(unix)]
            change: {
                use std::os::unix::fs::MetadataExt;
                (found.dev(), found.ino(), found.ctime(), found.ctime_nsec())
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use image::{GrayImage, Luma};

    use super::*;
    use crate::{dataset::FrameFile, sequence::SequenceReader};

    fn frames(folder: &Path, count: u32) -> FrameSource {
        let file = |number: u32| {
            let path = folder.join(format!("f_{number}.png"));
            GrayImage::from_pixel(4, 4, Luma([number as u8])).save(&path).unwrap();
            FrameFile { number, path }
        };
        FrameSource::Images((1..=count).map(file).collect())
    }

    fn second(source: &FrameSource) -> PathBuf {
        source.files()[1].to_owned()
    }

    #[test]
    fn the_reader_hashes_what_it_decoded() {
        let folder = tempfile::tempdir().unwrap();
        let source = frames(folder.path(), 3);
        let planned = content_blake3(&source).unwrap();
        let mut reader = SequenceReader::open(&source).unwrap();
        assert!(reader.by_ref().all(|frame| frame.is_ok()));
        assert_eq!(reader.into_content_blake3().unwrap(), planned);
        // Without decoding a frame: the same files.
        assert_eq!(SequenceReader::open(&source).unwrap().into_content_blake3().unwrap(), planned);
    }

    #[test]
    fn a_frame_that_changes_between_planning_and_reading_shows() {
        let folder = tempfile::tempdir().unwrap();
        let source = frames(folder.path(), 3);
        let planned = content_blake3(&source).unwrap();
        let mut reader = SequenceReader::open(&source).unwrap();
        reader.next().unwrap().unwrap();
        let before = fs::read(second(&source)).unwrap();
        GrayImage::from_pixel(4, 4, Luma([200])).save(second(&source)).unwrap();
        assert_eq!(reader.next().unwrap().unwrap().image().get_pixel(0, 0).0, [200]);
        // After restoring, the file equals the planned one, but the decoded one did not.
        fs::write(second(&source), before).unwrap();
        reader.next().unwrap().unwrap();
        assert_ne!(reader.into_content_blake3().unwrap(), planned);
        assert_eq!(content_blake3(&source).unwrap(), planned);
    }

    #[test]
    fn a_stamp_changes_with_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, "one").unwrap();
        let before = Stamp::of(&path).unwrap();
        assert_eq!(Stamp::of(&path).unwrap(), before);
        fs::write(folder.path().join("b"), "two").unwrap();
        fs::rename(folder.path().join("b"), &path).unwrap();
        assert_ne!(Stamp::of(&path).unwrap(), before);
    }
}
