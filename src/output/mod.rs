//! Writes files that are either complete or absent: under a temporary name in the same folder, then renamed.
//!
//! All output of the program passes through this module. Content is hashed while it is written and need not be read back. There are two
//! levels of durability. A user's manual work is on disk before success is reported ([`write_durable`]). Reproducible results are synced
//! together at the end of a command ([`sync_written`]). Only regular files are replaced.

mod pending;
mod record;
mod sweep;
mod sync;

use std::{
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

use serde::Serialize;

use crate::formula::FormulaGuard;

pub use pending::{PendingFile, PendingFolder, target_of};
pub(crate) use record::is_inside;
pub use record::{FolderRecord, claim_folder};
pub(crate) use sweep::once as sweep_once;
pub(crate) use sync::create_folders;
pub use sync::{remove_durably, sync_written};

/// Program and version, as recorded in written files.
pub const MADE_BY: &str = concat!("grimace ", env!("CARGO_PKG_VERSION"));

/// A file or folder that could not be written.
///
/// ```
/// use grimace::{errors::OutputError, fap::{FapFrame, FapSequence, FapWriteError, write_fap}};
///
/// // A folder is where the file should be.
/// let folder = tempfile::tempdir()?;
/// let (name, version) = ("smile".to_owned(), "2.1".to_owned());
/// let faps = FapSequence { version, name, fps: 25.0, frames: vec![FapFrame::default()] };
/// let FapWriteError::Output(OutputError { path, .. }) = write_fap(folder.path(), &faps).unwrap_err() else { panic!() };
/// assert_eq!(path, folder.path());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}", path.display())]
pub struct OutputError {
    /// The file or folder.
    pub path: PathBuf,
    /// Why.
    pub source: io::Error,
}

impl OutputError {
    /// Adds a path to an I/O error.
    pub fn at(path: &Path) -> impl FnOnce(io::Error) -> Self + '_ {
        move |source| Self { path: path.to_owned(), source }
    }
}

/// Writes a file through `fill`. The file appears under its name only when `fill` and the disk succeeded.
///
/// Missing parent folders are created. If the path is a link, its target is replaced.
///
/// # Errors
/// [`OutputError`] when a folder or the file cannot be written (no space, no permission), or when the path is not a regular file.
pub fn write_atomic(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), OutputError> {
    write_hashed(path, fill).map(|_| ())
}

/// As [`write_atomic`]. Returns the BLAKE3 of the content, computed during writing.
///
/// # Errors
/// As [`write_atomic`].
pub fn write_hashed(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<blake3::Hash, OutputError> {
    fill_pending(path, fill)?.persist()
}

/// As [`write_atomic`] for manual work, which no program can reproduce: file and folder are on disk before it returns.
///
/// # Errors
/// As [`write_atomic`].
pub fn write_durable(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<blake3::Hash, OutputError> {
    fill_pending(path, fill)?.persist_durably()
}

/// Checks that a file can be written, by creating its temporary file. Commands that work for long before they write check first.
///
/// # Errors
/// [`OutputError`] when a folder or the file cannot be created.
pub fn check_writable(path: &Path) -> Result<(), OutputError> {
    PendingFile::create(path).map(drop)
}

fn fill_pending(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<PendingFile, OutputError> {
    let mut writer = BufWriter::new(PendingFile::create(path)?);
    fill(&mut writer).map_err(OutputError::at(path))?;
    writer.into_inner().map_err(|e| OutputError::at(path)(e.into_error()))
}

/// As [`write_atomic`] for bytes in memory.
///
/// # Errors
/// As [`write_atomic`].
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    write_atomic(path, |writer| writer.write_all(bytes))
}

/// Writes a value as indented JSON with a final newline.
///
/// # Errors
/// As [`write_atomic`].
pub fn write_json<T: Serialize + ?Sized>(path: &Path, value: &T) -> Result<(), OutputError> {
    write_atomic(path, |writer| json_into(writer, value))
}

/// As [`write_json`], durably; see [`write_durable`].
///
/// # Errors
/// As [`write_atomic`].
pub fn write_json_durably<T: Serialize + ?Sized>(path: &Path, value: &T) -> Result<(), OutputError> {
    write_durable(path, |writer| json_into(writer, value)).map(|_| ())
}

/// Writes a value in the format of [`write_json`].
///
/// # Errors
/// [`io::Error`] of `writer`.
pub fn json_into<T: Serialize + ?Sized>(mut writer: &mut dyn Write, value: &T) -> io::Result<()> {
    serde_json::to_writer_pretty(&mut writer, value).map_err(io::Error::from)?;
    writer.write_all(b"\n")
}

/// Returns a CSV writer that prevents spreadsheets from executing fields as formulas: see the module `formula`. All CSV files with texts
/// use it.
pub fn csv_writer<W: Write>(writer: W) -> csv::Writer<impl Write> {
    csv::Writer::from_writer(FormulaGuard::new(writer))
}

/// Writes rows as CSV. The header has the field names of the row type.
///
/// # Errors
/// As [`write_atomic`].
pub fn write_csv<T: Serialize>(path: &Path, rows: impl IntoIterator<Item = T>) -> Result<(), OutputError> {
    write_atomic(path, |writer| csv_into(writer, rows))
}

/// Writes rows in the format of `write_csv`.
///
/// # Errors
/// [`io::Error`] of `writer`.
pub fn csv_into<T: Serialize>(writer: &mut dyn Write, rows: impl IntoIterator<Item = T>) -> io::Result<()> {
    let mut csv = csv_writer(writer);
    for row in rows {
        csv.serialize(row).map_err(io::Error::from)?;
    }
    csv.flush()
}

/// Writes rows of text as CSV under a given header. Returns the BLAKE3 of the file.
///
/// # Errors
/// As [`write_atomic`].
pub fn write_records<H: AsRef<[u8]>>(
    path: &Path,
    header: impl IntoIterator<Item = H>,
    rows: impl IntoIterator<Item = Vec<String>>,
) -> Result<blake3::Hash, OutputError> {
    write_hashed(path, |writer| {
        let mut csv = csv_writer(writer);
        csv.write_record(header).map_err(io::Error::from)?;
        for row in rows {
            csv.write_record(&row).map_err(io::Error::from)?;
        }
        csv.flush()
    })
}

/// Names for the user's columns in a table with columns of this program. A name that collides gets the prefix `by_`, repeatedly until it is
/// unique.
pub fn beside_ours<N: AsRef<str>>(theirs: &[N], is_ours: impl Fn(&str) -> bool) -> Vec<String> {
    let is_theirs = |name: &str| theirs.iter().any(|other| other.as_ref() == name);
    let named = |name: &N| {
        let mut free = name.as_ref().to_owned();
        while is_ours(&free) || (free != name.as_ref() && is_theirs(&free)) {
            free.insert_str(0, "by_");
        }
        free
    };
    theirs.iter().map(named).collect()
}

/// `1 sequence`, `2 sequences`.
pub fn count(n: usize, singular: &str, plural: &str) -> String {
    format!("{n} {}", if n == 1 { singular } else { plural })
}

/// `25 frames per second`, `1 frame per second`.
pub fn per_second(fps: f64) -> String {
    format!("{} {} per second", nine_digits(fps), if fps.total_cmp(&1.0).is_eq() { "frame" } else { "frames" })
}

/// A number with 9 significant digits as its shortest text (`0.1`, `12.3456789`, `-0` becomes `0`).
pub fn nine_digits(value: f64) -> String {
    let text = format!("{value:.8e}");
    let rounded: f64 = text.parse().unwrap_or(value);
    if rounded == 0.0 { "0".to_owned() } else { format!("{rounded}") }
}

/// The first items of a list, and the number of the others.
pub fn listed(items: &[String], most: usize) -> String {
    let shown = items.iter().take(most).cloned().collect::<Vec<_>>().join("; ");
    if items.len() > most { format!("{shown}; and {} more", items.len() - most) } else { shown }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn no_table_has_a_column_twice() {
        let is_ours = |name: &str| ["id", "by_why"].contains(&name);
        let named = beside_ours(&["id", "by_id", "age", "why", "by_why"], is_ours);
        assert_eq!(named, ["by_by_id", "by_id", "age", "why", "by_by_why"]);
    }

    #[test]
    fn a_failed_write_leaves_nothing_and_keeps_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/a.csv");
        write_bytes(&path, b"old").unwrap();
        let result = write_atomic(&path, |w| {
            w.write_all(b"half")?;
            Err(io::Error::other("disk full"))
        });
        assert!(result.unwrap_err().to_string().contains("disk full"));
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
    }

    #[test]
    fn nine_significant_digits() {
        assert_eq!(nine_digits(123.456789012), "123.456789");
        assert_eq!(nine_digits(0.1), "0.1");
        assert_eq!(nine_digits(-0.0), "0");
        assert_eq!(nine_digits(1e-12), "0.000000000001");
        assert_eq!(nine_digits(100.0), "100");
    }
}
