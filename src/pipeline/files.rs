//! Records of a run besides its results: provenance and failures.

use std::{
    collections::BTreeMap,
    io,
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::{PipelineOptions, Stage};
use crate::{
    input::{RecordError, read_record},
    units::SequenceId,
};

/// Name of a run's record in its folder.
pub(super) const RUN_JSON: &str = "run.json";

/// Version of the schema of `run.json` and of the representatives' JSON.
pub const SCHEMA_VERSION: u32 = 1;

/// Record of one sequence in `run.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SequenceRecord {
    /// Subject and sequence.
    #[serde(flatten)]
    pub id: SequenceId,
    /// Emotion label.
    pub emotion: String,
    /// Further columns of the manifest.
    pub metadata: BTreeMap<String, String>,
    /// BLAKE3 of everything the track depends on; empty when it could not be computed.
    pub inputs_blake3: String,
    /// Stage and reason, if it failed.
    pub failure: Option<(Stage, String)>,
    /// BLAKE3 of the manual corrections in its track.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corrections_blake3: Option<String>,
}

/// `run.json`: the inputs, options and outputs of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunJson {
    /// [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// [`crate::output::MADE_BY`].
    pub made_by: String,
    /// Name of the dataset's folder.
    pub dataset: String,
    /// Units of lengths in the files, by folder or file.
    pub units: BTreeMap<String, String>,
    /// Name of the method that the options correspond to: `default`, `kp`, or `changed`.
    #[serde(default)]
    pub method: String,
    /// Options of every stage.
    pub options: PipelineOptions,
    /// BLAKE3 of the `.wfm` file in use; `None` for the embedded Candide-3.
    pub wireframe_blake3: Option<String>,
    /// Whether the run was completed.
    pub complete: bool,
    /// Every sequence of the dataset, by id.
    pub sequences: Vec<SequenceRecord>,
    /// Sequences left out on purpose, with the reason.
    pub skipped: Vec<(String, String)>,
    /// Stem of every representative and its number of sequences.
    pub representatives: Vec<(String, usize)>,
    /// Warnings to the user.
    pub warnings: Vec<String>,
    /// Sequences that a person should look at.
    #[serde(default)]
    pub to_look_at: usize,
    /// BLAKE3 of the looks that the results take into account.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub looks_blake3: Option<String>,
    /// BLAKE3 of every file written, by path relative to the output folder with `/` between folders.
    pub outputs: BTreeMap<String, String>,
    /// Files of earlier runs that were kept because they were changed since, with their original BLAKE3.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub kept: BTreeMap<String, String>,
}

/// Why a `run.json` cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum RunJsonError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is damaged or of another kind.
    #[error("{}: damaged ({source}); it lists the files that runs wrote into this folder: restore it, or run again with --force", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Why.
        source: serde_json::Error,
    },
    /// The file has a newer layout.
    #[error("{}: schema version {found}; this program reads {SCHEMA_VERSION}; it comes from a newer version of grimace; use that version", path.display())]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: u64,
    },
}

/// Reads the fields of `T` from the `run.json` of an output folder; `None` if there is no such file.
///
/// # Errors
/// [`RunJsonError`].
pub fn read_run_json<T: DeserializeOwned>(out: &Path) -> Result<Option<T>, RunJsonError> {
    let path = out.join(RUN_JSON);
    let bytes = match crate::input::read(&path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(RunJsonError::Io { path, source }),
    };
    read_record(&bytes, SCHEMA_VERSION).map(Some).map_err(|error| match error {
        RecordError::Newer { found, .. } => RunJsonError::Newer { path, found },
        RecordError::Json(source) => RunJsonError::Damaged { path, source },
    })
}

/// The units of a run's files.
pub fn run_units() -> BTreeMap<String, String> {
    [
        ("tracks", "px"),
        ("models", "face unit: ES0/1024 of the canonical neutral, y up"),
        ("representatives", "face unit: ES0/1024 of the canonical neutral, y up"),
        ("statistics.csv", "face unit"),
        ("trimming.csv", "face unit"),
        ("fap", "FAPU/1024; angles 1e-5 rad"),
    ]
    .into_iter()
    .map(|(k, v)| (k.to_owned(), v.to_owned()))
    .collect()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn damaged_and_newer_records_say_what_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let read = |text: &[u8]| {
            fs::write(folder.path().join(RUN_JSON), text).unwrap();
            read_run_json::<BTreeMap<String, serde_json::Value>>(folder.path()).map_err(|e| e.to_string())
        };
        for text in ["", "{\"dataset\": \"fa", "\u{feff}{}"] {
            let said = read(text.as_bytes()).unwrap_err();
            assert!(said.contains("run.json: damaged (") && said.contains("restore it"), "{said}");
        }
        let said = read(b"{\"schema_version\": 9}").unwrap_err();
        assert!(said.contains("run.json: schema version 9; this program reads 1"), "{said}");
        assert!(read(b"{\"schema_version\": 1}").is_ok_and(|run| run.is_some()));
        fs::remove_file(folder.path().join(RUN_JSON)).unwrap();
        assert!(read_run_json::<RunJson>(folder.path()).unwrap().is_none());
    }
}
