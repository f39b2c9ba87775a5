//! Tolerant reader of ASCII FAP files.
//!
//! It accepts what known tools write and reports deviations from the strict subset. It rejects everything else, with line and
//! rule.

use std::{
    io,
    path::{Path, PathBuf},
};

use super::{
    catalog::FapNumber,
    finding::{Finding, Severity},
    parser::{ParsedFap, ParsedHeader, is_flag, is_mask_for_greta, parse_fap},
    sequence::FapSequence,
};

/// Content of a FAP file, with warnings.
///
/// ```
/// use grimace::fap::read_fap;
///
/// let file = read_fap("fixtures/golden/fap/happiness.fap".as_ref())?;
/// assert_eq!((file.sequence.name.as_str(), file.findings.len()), ("happiness", 0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FapFile {
    /// The content.
    pub sequence: FapSequence,
    /// Tolerated deviations from the strict subset, by line.
    pub findings: Vec<Finding>,
}

/// Error for a FAP file that could not be read.
///
/// ```
/// use grimace::fap::{FapReadError, read_fap};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("cut.fap");
/// std::fs::write(&path, "2.1 smile 25 1\n0 0 1\n")?;
/// let error = read_fap(&path).unwrap_err();
/// assert!(matches!(error, FapReadError::Invalid { first, .. } if first.line == 2));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum FapReadError {
    /// The file cannot be opened or read.
    #[error("cannot read {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The content is not a FAP file as any known tool writes it.
    #[error("{}:{}: {first}{}", path.display(), first.line, more(*errors))]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The first error.
        first: Finding,
        /// Number of errors.
        errors: usize,
    },
}

fn more(errors: usize) -> String {
    if errors > 1 { format!(" (and {} more; `grimace fap check` lists them)", errors - 1) } else { String::new() }
}

/// Whether the masks of a file are written for Greta: each has a blank after its last flag.
pub fn is_for_greta(bytes: &[u8]) -> bool {
    let text = String::from_utf8_lossy(bytes);
    let flags = |line: &&str| line.split_whitespace().count() == FapNumber::COUNT && line.split_whitespace().all(is_flag);
    let mut masks = text.lines().filter(flags).peekable();
    masks.peek().is_some() && masks.all(is_mask_for_greta)
}

impl ParsedFap {
    /// Returns the sequence and its warnings.
    ///
    /// # Errors
    /// The findings, if one of them is an error.
    pub fn into_file(self) -> Result<FapFile, Vec<Finding>> {
        match self.header {
            Some(header) if self.findings.iter().all(|f| f.severity < Severity::Error) => {
                let ParsedHeader { version, name, fps, .. } = header;
                let frames = self.frames.into_iter().map(|(_, frame)| frame).collect();
                Ok(FapFile { sequence: FapSequence { version, name, fps, frames }, findings: self.findings })
            }
            _ => Err(self.findings),
        }
    }
}

/// Reads a FAP file tolerantly.
///
/// ```
/// use grimace::fap::read_fap;
///
/// let sequence = read_fap("fixtures/golden/fap/happiness.fap".as_ref())?.sequence;
/// assert_eq!((sequence.fps, sequence.frames.len(), sequence.seconds()), (25.0, 25, 1.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`FapReadError`] when the file cannot be read, or has content that no known tool writes.
pub fn read_fap(path: &Path) -> Result<FapFile, FapReadError> {
    let bytes = crate::input::read_or_stdin(path).map_err(|source| FapReadError::Io { path: path.to_owned(), source })?;
    read_fap_bytes(path, &bytes)
}

/// Same as [`read_fap`] for the bytes of a file; `path` is its name in errors.
///
/// # Errors
/// [`FapReadError::Invalid`].
pub fn read_fap_bytes(path: &Path, bytes: &[u8]) -> Result<FapFile, FapReadError> {
    parse_fap(bytes).into_file().map_err(|findings| {
        let mut errors = findings.into_iter().filter(|f| f.severity == Severity::Error);
        let first = errors.next().unwrap_or_else(|| unreachable!("a file without header has an error"));
        FapReadError::Invalid { path: path.to_owned(), first, errors: 1 + errors.count() }
    })
}

#[cfg(test)]
#[path = "reader_tests.rs"]
mod tests;
