//! Reads JSON records with a layout version.

use std::path::Path;

use serde::{Deserialize, de::DeserializeOwned};

/// Why a record cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The record was written by a newer version in another layout.
    #[error("schema version {found}; this program reads {reads}; it comes from a newer version of grimace; use that version")]
    Newer {
        /// Its version.
        found: u64,
        /// The newest supported version.
        reads: u32,
    },
    /// The record is not valid JSON of its kind.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
}

/// Reads a record whose layout has the version `reads` or an older one. A record without a version counts as old.
///
/// # Errors
/// [`RecordError`].
pub fn read_record<T: DeserializeOwned>(bytes: &[u8], reads: u32) -> Result<T, RecordError> {
    #[derive(Deserialize)]
    struct Version {
        schema_version: Option<serde_json::Number>,
    }
    // The version is read first, because another version may have another layout.
    let version = serde_json::from_slice::<Version>(bytes).ok().and_then(|v| v.schema_version);
    match version.and_then(|number| number.as_u64()) {
        Some(found) if found > u64::from(reads) => Err(RecordError::Newer { found, reads }),
        _ => Ok(serde_json::from_slice(bytes)?),
    }
}

/// Reads the record in a file, if there is a valid one. A damaged record means that the work was not completed, and counts as absent.
///
/// # Errors
/// Only [`RecordError::Newer`].
pub fn record_at<T: DeserializeOwned>(path: &Path, reads: u32) -> Result<Option<T>, RecordError> {
    let Ok(bytes) = super::read(path) else { return Ok(None) };
    match read_record(&bytes, reads) {
        Err(newer @ RecordError::Newer { .. }) => Err(newer),
        read => Ok(read.ok()),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn newer_versions_are_refused_whatever_they_hold() {
        let read = |text: &str| read_record::<BTreeMap<String, u32>>(text.as_bytes(), 2).map_err(|e| e.to_string());
        assert_eq!(read("{\"schema_version\": 2, \"a\": 1}").unwrap()["a"], 1);
        assert!(read("{\"a\": 1}").is_ok());
        assert!(read("{\"schema_version\": 3, \"a\": []}").unwrap_err().starts_with("schema version 3; this program reads 2"));
        assert!(read("{\"schema_version\": 2, \"a\"").unwrap_err().starts_with("EOF"));
    }
}
