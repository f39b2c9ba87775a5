//! Errors of CSV files.

use std::{fmt, io, path::PathBuf};

use crate::text::excerpt;

/// Errors of CSV files.
#[derive(Debug, thiserror::Error)]
pub enum InputErrorKind {
    /// The file cannot be read.
    #[error("cannot be read: {0}")]
    Io(#[from] io::Error),
    /// The file has no header line.
    #[error("is empty; a header line was expected")]
    Empty,
    /// The file is not a text table.
    #[error("is a {what}; a table in CSV was expected")]
    NotText {
        /// Kind of file by its first bytes.
        what: &'static str,
    },
    /// Bytes that are not UTF-8.
    #[error("byte {byte} of the line is not UTF-8; {}", encoding_hint(*windows_1252))]
    NotUtf8 {
        /// Position in the line, from 1.
        byte: usize,
        /// Whether all such bytes of the file could be letters of Windows-1252, of which Latin-1 is a part.
        windows_1252: bool,
    },
    /// A quoted field without its closing quotation mark.
    #[error("a quotation mark is not closed")]
    UnclosedQuote,
    /// Required columns are missing.
    #[error(
        "has no column {}; found {}{}{}",
        quoted(missing),
        quoted(found),
        separator_hint(found),
        spelling_hint(missing, found)
    )]
    MissingColumns {
        /// Names not found.
        missing: Vec<String>,
        /// Names in the header.
        found: Vec<String>,
    },
    /// A column name appears twice in the header.
    #[error("has the column `{name}` twice")]
    DuplicateColumn {
        /// The name.
        name: String,
    },
    /// The number of fields of a row differs from that of the header.
    #[error("the row has {found} fields, but the header has {expected}")]
    FieldCount {
        /// Columns of the header.
        expected: usize,
        /// Fields of the row.
        found: usize,
    },
    /// A field has an invalid value.
    #[error("{column} is `{found}`; {expected} was expected")]
    Field {
        /// Column name.
        column: String,
        /// The field, shortened and printable.
        found: String,
        /// The expected content.
        expected: &'static str,
    },
}

/// A CSV file, or one of its rows, that does not read. The message says what is wrong with it.
///
/// ```
/// use grimace::{dataset::{LandmarksError, read_landmarks}, errors::InputError};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("landmarks.csv");
/// let header: String = (0..68).map(|k| format!(",x{k},y{k}")).collect();
/// std::fs::write(&path, format!("frame{header}\none{}\n", ",1".repeat(136)))?;
/// let LandmarksError::Input(error) = read_landmarks(&path).unwrap_err() else { panic!() };
/// assert_eq!((error.path.as_path(), error.line), (path.as_path(), Some(2)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
#[error("{}{}: {kind}", path.display(), LineSuffix(*line))]
pub struct InputError {
    /// The file.
    pub path: PathBuf,
    /// Line, from 1; `None` for an error of the whole file.
    pub line: Option<usize>,
    /// The error.
    #[doc(hidden)]
    #[source]
    pub kind: InputErrorKind,
}

struct LineSuffix(Option<usize>);

impl fmt::Display for LineSuffix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.map_or(Ok(()), |line| write!(f, ", line {line}"))
    }
}

fn encoding_hint(windows_1252: bool) -> &'static str {
    if windows_1252 {
        "the file looks like Windows-1252 (Latin-1): save it as UTF-8 text, or convert it (iconv -f WINDOWS-1252 -t UTF-8 OLD.csv > \
         NEW.csv) and check the names"
    } else {
        "save the file as UTF-8 text"
    }
}

/// Most columns that a message names.
const MOST_NAMES: usize = 20;

fn quoted(names: &[String]) -> String {
    if names.is_empty() {
        return "none".to_owned();
    }
    let shown = names.iter().take(MOST_NAMES).map(|n| format!("`{}`", excerpt(n))).collect::<Vec<_>>().join(", ");
    if names.len() > MOST_NAMES { format!("{shown} and {} more", names.len() - MOST_NAMES) } else { shown }
}

/// Largest number of letters by which a name may differ from a missing one to be suggested.
const MISSPELT: usize = 2;

/// Suggests which existing column is a misspelling of a missing one.
fn spelling_hint(missing: &[String], found: &[String]) -> String {
    let near = |wanted: &String| {
        let distance = |name: &&String| strsim::damerau_levenshtein(&name.to_lowercase(), &wanted.to_lowercase());
        let long = wanted.chars().count() > 2 * MISSPELT;
        let best = found.iter().filter(|name| long && !missing.contains(name)).min_by_key(distance);
        best.filter(|name| distance(name) <= MISSPELT).map(|name| format!("; is `{}` meant for `{wanted}`?", excerpt(name)))
    };
    missing.iter().find_map(near).unwrap_or_default()
}

fn separator_hint(found: &[String]) -> &'static str {
    match found {
        [only] if only.contains([';', '\t']) => " (columns are separated by commas; save it as CSV UTF-8, separated by commas)",
        _ => "",
    }
}
