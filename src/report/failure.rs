//! What failed, and in which stage.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A stage of the main job, as named in `failures.csv`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Reading what the user gave: manifest row, marks, landmarks, list of frames.
    Dataset,
    /// Fitting the wireframe to the neutral frame.
    Fit,
    /// Decoding and tracking the frames.
    Track,
    /// Normalizing the track.
    Normalize,
    /// Statistics over the models.
    Statistics,
    /// Writing results.
    Write,
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Dataset => "dataset",
            Self::Fit => "fit",
            Self::Track => "track",
            Self::Normalize => "normalize",
            Self::Statistics => "statistics",
            Self::Write => "write",
        })
    }
}

/// A sequence that failed: a row of `failures.csv`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    /// Subject.
    pub subject: String,
    /// Sequence.
    pub sequence: String,
    /// Stage that failed.
    pub stage: Stage,
    /// The error in full.
    pub reason: String,
}
