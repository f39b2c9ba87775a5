//! Normalized models in one Parquet file: one row per sequence, one column per coordinate.
//!
//! | column | type | content |
//! | --- | --- | --- |
//! | `subject`, `sequence`, `emotion` | text | as in the manifest, emotions in lower case |
//! | `id` | text | `SUBJECT_SEQUENCE`, as in every table; written, ignored when read |
//! | further columns of the manifest | text | as in the manifest; empty where missing; a null counts as empty |
//! | columns of other programs | numbers, booleans | as in a manifest (`34`, `0.5`, `true`); NaN and null are empty; read, not written |
//! | `x_M_K`, `y_M_K` | double | node K in frame M (from 0), face units |
//!
//! The file's metadata give the unit, the program and the version of this schema. Numbers are written in full precision and without
//! compression. Rows are sorted by sequence id, [`GROUP_ROWS`] rows per row group. One column of a million models can be read without the
//! other columns. Files rewritten by other programs may have columns in another order, nullable types or Snappy compression.

mod lengths;
mod number;
mod read;
mod shared_file;
mod write;

use std::path::PathBuf;

pub use read::{ColumnarClass, ColumnarModels};
pub use write::{ColumnarRow, ColumnarWriter};

/// Rows per row group; the writer holds this many models in memory.
pub const GROUP_ROWS: usize = 8192;

/// Columns that identify a row and its emotion.
const NAMES: [&str; 3] = ["subject", "sequence", "emotion"];

/// Name of the column `SUBJECT_SEQUENCE`.
const ID: &str = "id";

/// Version of the schema.
const SCHEMA_VERSION: &str = "1";

/// Error when a columnar file cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ColumnarError {
    /// The file cannot be opened or created.
    #[error("{}: {reason}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Cause.
        reason: std::io::Error,
    },
    /// The file is not Parquet, is truncated, or has an unsupported form.
    #[error("{}: this is not a readable Parquet file of models: {reason}", path.display())]
    Parquet {
        /// The file.
        path: PathBuf,
        /// Cause.
        reason: String,
    },
    /// A required column is missing or has another type.
    #[error("{}: has no column `{column}` of type {expected}; models have subject, sequence, emotion, and x_M_K, y_M_K for frames M and nodes K from 0", path.display())]
    Column {
        /// The file.
        path: PathBuf,
        /// Name of the column.
        column: String,
        /// Expected type.
        expected: &'static str,
    },
    /// A value is missing.
    #[error("{}: row {row} has no value in `{column}`", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// Row number, from 1.
        row: usize,
        /// The column.
        column: String,
    },
    /// The file has no rows.
    #[error("{}: no models", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A sequence has two rows.
    #[error("{}: sequence {id} appears twice; keep one row", path.display())]
    Duplicate {
        /// The file.
        path: PathBuf,
        /// Subject and sequence.
        id: String,
    },
    /// A row whose number of coordinates differs from that of the file.
    #[error("{id}: {found} coordinates where the file has {expected}")]
    Shape {
        /// Subject and sequence.
        id: String,
        /// Number of coordinates in the row.
        found: usize,
        /// Number of coordinates in the file.
        expected: usize,
    },
    /// A row does not form a model.
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

/// Returns the column name of a coordinate.
fn coordinate(axis: usize, frame: usize, node: usize) -> String {
    format!("{}_{frame}_{node}", ["x", "y"][axis])
}

#[cfg(test)]
mod tests;
