//! What a run leaves behind beside its results: provenance and failures.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{PipelineOptions, Stage};
use crate::units::SequenceId;

/// Version of the schema of `run.json` and of the representatives' JSON.
pub const SCHEMA_VERSION: u32 = 1;

/// How one sequence went, in `run.json`.
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
    /// Stage and reason, when it failed.
    pub failure: Option<(Stage, String)>,
    /// BLAKE3 of the corrections by hand in its track.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corrections_blake3: Option<String>,
}

/// `run.json`: what was made from what, and with which options.
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
    /// Name of the method that the options are: `default`, `kp`, or `changed`.
    #[serde(default)]
    pub method: String,
    /// Options of every stage.
    pub options: PipelineOptions,
    /// BLAKE3 of the `.wfm` file in use; `None` for the embedded Candide-3.
    pub wireframe_blake3: Option<String>,
    /// Whether the run came to its end.
    pub complete: bool,
    /// Every sequence of the dataset, by id.
    pub sequences: Vec<SequenceRecord>,
    /// Sequences left out on purpose, with the reason.
    pub skipped: Vec<(String, String)>,
    /// Stem of every representative and the number of sequences behind it.
    pub representatives: Vec<(String, usize)>,
    /// Warnings that a person should read.
    pub warnings: Vec<String>,
    /// BLAKE3 of every file written, by path relative to the output folder with `/` between folders.
    pub outputs: BTreeMap<String, String>,
    /// Files of earlier runs that were changed since, and so were kept, with the BLAKE3 they once had.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub kept: BTreeMap<String, String>,
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
