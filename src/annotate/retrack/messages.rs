//! What the page and the desk of tracks tell each other.

use serde::{Deserialize, Serialize};

use super::super::messages::{Mark, hundredth};
use crate::track::{Look, TrackedFrame};

/// A track in the list.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub struct Listed {
    pub id: String,
    pub emotion: String,
    /// Share of nodes that were not lost, 0 to 1.
    pub tracked_share: f64,
    pub frames: usize,
    /// Number of hand-set nodes after the neutral frame.
    pub corrected: usize,
    /// Whether there are reasons to look at it.
    pub doubtful: bool,
    /// What a person found when looking at it.
    pub look: Option<Look>,
}

/// The list of tracks, sorted by descending share of lost nodes.
#[derive(Serialize)]
pub struct List {
    pub sequences: Vec<Listed>,
    pub failures: Vec<String>,
}

/// One frame of a track.
#[derive(Serialize)]
pub struct FrameNodes {
    pub number: u32,
    pub nodes: Vec<[f64; 2]>,
    pub states: Vec<&'static str>,
    pub residuals: Vec<Option<f64>>,
}

/// One track with all its frames.
#[derive(Serialize)]
pub struct Opened {
    pub id: String,
    pub emotion: String,
    pub width: u32,
    pub height: u32,
    pub frames: Vec<FrameNodes>,
    pub version: String,
    pub file: String,
    /// Source of the points of its neutral frame, as in the track's file.
    #[serde(rename = "marksFrom")]
    pub marks_from: String,
    /// Reasons to look at it.
    pub reasons: Vec<String>,
    pub look: Option<Look>,
}

/// All corrections of one frame.
#[derive(Deserialize)]
pub struct Correct {
    #[serde(default)]
    pub version: String,
    pub frame: u32,
    pub corrections: Vec<Mark>,
}

/// The frame from which to track again.
#[derive(Deserialize)]
pub struct Retrack {
    pub version: String,
    pub frame: u32,
}

/// What a person found when looking at a track; without a look, an earlier one is taken back.
#[derive(Deserialize)]
pub struct SetLook {
    pub version: String,
    pub look: Option<Look>,
}

/// A look that was saved.
#[derive(Serialize)]
pub struct Looked {
    pub look: Option<Look>,
}

/// A corrected frame.
#[derive(Serialize)]
pub struct Corrected {
    pub version: String,
    pub frame: FrameNodes,
}

pub fn frame_nodes(frame: &TrackedFrame) -> FrameNodes {
    FrameNodes {
        number: frame.number,
        nodes: frame.nodes.iter().map(|n| [hundredth(n.position.x), hundredth(n.position.y)]).collect(),
        states: frame.nodes.iter().map(|n| n.state.name()).collect(),
        residuals: frame.nodes.iter().map(|n| n.residual.map(hundredth)).collect(),
    }
}
