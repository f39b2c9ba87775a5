//! Files that are either whole or not there: written to a temporary name in the same folder, then renamed.

use std::{
    fs,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

use serde::Serialize;

use crate::formula::FormulaGuard;

/// Program and version, as written into every file that says where it came from.
pub const MADE_BY: &str = concat!("grimace ", env!("CARGO_PKG_VERSION"));

/// A file or folder that could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}", path.display())]
pub struct OutputError {
    /// The file or folder.
    pub path: PathBuf,
    /// Why.
    pub source: io::Error,
}

impl OutputError {
    /// Puts a path to an I/O error.
    pub fn at(path: &Path) -> impl FnOnce(io::Error) -> Self + '_ {
        move |source| Self { path: path.to_owned(), source }
    }
}

/// Writes a file through `fill`; the file appears under its name only when `fill` and the disk succeeded.
///
/// Missing parent folders are made.
///
/// # Errors
/// [`OutputError`] when a folder or the file cannot be written (no space, no permission).
pub fn write_atomic(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), OutputError> {
    let error = |source| OutputError { path: path.to_owned(), source };
    let mut writer = BufWriter::new(temporary_beside(path)?);
    fill(&mut writer).map_err(error)?;
    let file = writer.into_inner().map_err(|e| error(e.into_error()))?;
    file.persist(path).map_err(|e| error(e.error))?;
    Ok(())
}

/// A temporary file in the folder of `path`, which is made if it is not there.
fn temporary_beside(path: &Path) -> Result<tempfile::NamedTempFile, OutputError> {
    let error = |source| OutputError { path: path.to_owned(), source };
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    fs::create_dir_all(folder).map_err(error)?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(".grimace-").suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o644));
    }
    builder.tempfile_in(folder).map_err(error)
}

/// A file under a temporary name, for writers that need a file of their own.
#[derive(Debug)]
pub struct PendingFile {
    path: PathBuf,
    file: tempfile::NamedTempFile,
}

impl PendingFile {
    /// A file that will be at `path`. Missing parent folders are made.
    ///
    /// # Errors
    /// [`OutputError`] when a folder or the file cannot be made.
    pub fn create(path: &Path) -> Result<Self, OutputError> {
        Ok(Self { path: path.to_owned(), file: temporary_beside(path)? })
    }

    /// A handle to write to.
    ///
    /// # Errors
    /// [`OutputError`] when the system gives no further handle.
    pub fn handle(&self) -> Result<fs::File, OutputError> {
        self.file.as_file().try_clone().map_err(OutputError::at(&self.path))
    }

    /// Puts the whole file in its place.
    ///
    /// # Errors
    /// [`OutputError`] when it cannot be renamed.
    pub fn persist(self) -> Result<(), OutputError> {
        let Self { path, file } = self;
        file.persist(&path).map(|_| ()).map_err(|e| OutputError { path, source: e.error })
    }
}

/// [`write_atomic`] for bytes at hand.
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
    write_atomic(path, |writer| {
        serde_json::to_writer_pretty(&mut *writer, value).map_err(io::Error::from)?;
        writer.write_all(b"\n")
    })
}

/// A writer of CSV whose fields no spreadsheet takes for formulas: see [`crate::formula`]. All CSV files with texts in them are written
/// through it.
pub fn csv_writer<W: Write>(writer: W) -> csv::Writer<impl Write> {
    csv::Writer::from_writer(FormulaGuard::new(writer))
}

/// Writes rows as CSV, the header taken from the row type's field names.
///
/// # Errors
/// As [`write_atomic`].
pub fn write_csv<T: Serialize>(path: &Path, rows: impl IntoIterator<Item = T>) -> Result<(), OutputError> {
    write_atomic(path, |writer| {
        let mut csv = csv_writer(writer);
        for row in rows {
            csv.serialize(row).map_err(io::Error::from)?;
        }
        csv.flush()
    })
}

/// Writes rows of text as CSV under a header, where the columns are not those of a type.
///
/// # Errors
/// As [`write_atomic`].
pub fn write_records<H: AsRef<[u8]>>(
    path: &Path,
    header: impl IntoIterator<Item = H>,
    rows: impl IntoIterator<Item = Vec<String>>,
) -> Result<(), OutputError> {
    write_atomic(path, |writer| {
        let mut csv = csv_writer(writer);
        csv.write_record(header).map_err(io::Error::from)?;
        for row in rows {
            csv.write_record(&row).map_err(io::Error::from)?;
        }
        csv.flush()
    })
}

/// `1 sequence`, `2 sequences`.
pub fn count(n: usize, singular: &str, plural: &str) -> String {
    format!("{n} {}", if n == 1 { singular } else { plural })
}

/// A number with 9 significant digits, the shortest text that has them (`0.1`, `12.3456789`, `-0` becomes `0`).
pub fn nine_digits(value: f64) -> String {
    let text = format!("{value:.8e}");
    let rounded: f64 = text.parse().unwrap_or(value);
    if rounded == 0.0 { "0".to_owned() } else { format!("{rounded}") }
}

/// The first of a list, and how many more.
pub(crate) fn listed(items: &[String], most: usize) -> String {
    let shown = items.iter().take(most).cloned().collect::<Vec<_>>().join("; ");
    if items.len() > most { format!("{shown}; and {} more", items.len() - most) } else { shown }
}

#[cfg(test)]
mod tests {
    use super::*;

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
