//! Normalized models in one Parquet file: a row per sequence, a column per coordinate.
//!
//! | column | type | content |
//! | --- | --- | --- |
//! | `subject`, `sequence`, `emotion` | text | as in the manifest, emotions in lower case |
//! | `id` | text | `SUBJECT_SEQUENCE`, the same name as in every table; written, and not needed when read |
//! | further columns of the manifest | text | as in the manifest; empty where missing; a null counts as empty |
//! | further columns of other programs | whole numbers, fractions, yes and no | as a manifest would have them (`34`, `0.5`, `true`); NaN and null are empty; read, never written |
//! | `x_M_K`, `y_M_K` | double | node K in frame M (from 0), face units |
//!
//! The file's own metadata say the unit, the program and the version of this schema. All digits, no compression, rows sorted by
//! sequence id, [`GROUP_ROWS`] rows a group: a column of a million models is read without reading the others. Files that other
//! programs wrote over this one may have columns in another order, nullable types or Snappy compression.

mod lengths;
mod number;
mod read;
mod shared_file;
mod write;

use std::path::PathBuf;

pub use read::{ColumnarClass, ColumnarModels};
pub use write::{ColumnarRow, ColumnarWriter};

/// Rows of a row group: the memory of the writer is this many models.
pub const GROUP_ROWS: usize = 8192;

/// Columns that name a row.
const NAMES: [&str; 3] = ["subject", "sequence", "emotion"];

/// The column of `SUBJECT_SEQUENCE`.
const ID: &str = "id";

/// Version of the columns.
const SCHEMA_VERSION: &str = "1";

/// A columnar file that cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ColumnarError {
    /// The file cannot be opened or made.
    #[error("{}: {reason}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: std::io::Error,
    },
    /// Not Parquet, cut short, or of a kind that is not read.
    #[error("{}: this is not a readable Parquet file of models: {reason}", path.display())]
    Parquet {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// A column that must be there.
    #[error("{}: has no column `{column}` of type {expected}; models have subject, sequence, emotion, and x_M_K, y_M_K for frames M and nodes K from 0", path.display())]
    Column {
        /// The file.
        path: PathBuf,
        /// Its name.
        column: String,
        /// Its type.
        expected: &'static str,
    },
    /// A value that is missing.
    #[error("{}: row {row} has no value in `{column}`", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// Row, from 1.
        row: usize,
        /// The column.
        column: String,
    },
    /// No row.
    #[error("{}: no models", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A sequence in two rows.
    #[error("{}: sequence {id} appears twice; keep one row", path.display())]
    Duplicate {
        /// The file.
        path: PathBuf,
        /// Subject and sequence.
        id: String,
    },
    /// A row with another number of coordinates than the file's.
    #[error("{id}: {found} coordinates where the file has {expected}")]
    Shape {
        /// Subject and sequence.
        id: String,
        /// Coordinates of the row.
        found: usize,
        /// Coordinates of the file.
        expected: usize,
    },
    /// Rows that do not make models.
    #[error("{}: {id}: {reason}", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// Subject and sequence.
        id: String,
        /// What is wrong.
        reason: String,
    },
}

/// Name of the column of a coordinate.
fn coordinate(axis: usize, frame: usize, node: usize) -> String {
    format!("{}_{frame}_{node}", ["x", "y"][axis])
}

#[cfg(test)]
mod tests;
