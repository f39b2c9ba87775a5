//! Messages between server and page about the sequences of a dataset.

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::{ProposalSource, ProposedMarks};
use crate::{
    fit::{Correspondence, MarkKind},
    units::NodeId,
};

/// A mark in a message.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mark {
    /// The node.
    pub node: NodeId,
    /// Px.
    pub x: f64,
    /// Px, down.
    pub y: f64,
    /// Mark or hard position.
    #[serde(default)]
    pub kind: MarkKind,
    /// Expected error of a mark that was not set by hand, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected_error: Option<f64>,
}

impl From<&Correspondence> for Mark {
    fn from(c: &Correspondence) -> Self {
        Self { node: c.node, x: c.position.x, y: c.position.y, kind: c.kind, expected_error: c.expected_error }
    }
}

impl From<&Mark> for Correspondence {
    fn from(m: &Mark) -> Self {
        Self { node: m.node, position: Point2::new(m.x, m.y), kind: m.kind, expected_error: m.expected_error }
    }
}

/// A sequence in the list.
#[derive(Serialize)]
pub struct Listed {
    pub id: String,
    pub emotion: String,
    /// Number of marks in its file.
    pub marks: usize,
    /// Confidence of a proposed sequence, 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub confidence: Option<f64>,
}

/// The list of sequences.
#[derive(Serialize)]
pub struct List {
    pub sequences: Vec<Listed>,
    /// Number of sequences with fewer than [`ENOUGH_MARKS`] marks.
    pub left: usize,
    /// Number of sequences in the dataset, on the page or not.
    pub total: usize,
    pub failures: Vec<String>,
}

/// One sequence with all data for the page.
#[derive(Serialize)]
pub struct Opened {
    pub id: String,
    pub emotion: String,
    /// Frame numbers of the whole sequence.
    pub frames: Vec<u32>,
    pub neutral: u32,
    pub apex: u32,
    pub width: u32,
    pub height: u32,
    pub marks: Vec<Mark>,
    pub version: String,
    /// Path of the marks, as named in the manifest.
    pub file: String,
    /// Why the marks cannot be read.
    pub problem: Option<String>,
}

/// Marks to save.
#[derive(Deserialize)]
pub struct SaveMarks {
    pub version: String,
    pub marks: Vec<Mark>,
}

/// Frames to save.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct SaveFrames {
    pub version: String,
    pub neutral: u32,
    pub apex: u32,
    /// Whether a manifest may be created for a dataset without one.
    #[serde(default)]
    pub create_manifest: bool,
}

/// Result of a save.
#[derive(Serialize)]
pub struct Saved {
    pub version: String,
    pub left: usize,
}

/// Marks to fit, with the size of their image.
#[derive(Deserialize)]
pub struct ToFit {
    pub marks: Vec<Mark>,
    pub width: u32,
    pub height: u32,
    /// Frame of the marks.
    pub frame: Option<MarkedFrame>,
}

/// A frame of a sequence.
#[derive(Deserialize)]
pub struct MarkedFrame {
    pub sequence: String,
    pub number: u32,
}

/// A fit, or the reason why there is none.
#[derive(Serialize)]
#[serde(rename_all = "camelCase", untagged)]
pub enum Fit {
    /// All nodes.
    Fitted {
        /// Positions in node order, px.
        nodes: Vec<[f64; 2]>,
        /// Distance of every mark from its node, px, in the order of the marks.
        residuals: Vec<f64>,
        /// ES0, px.
        #[serde(rename = "eyeDistance")]
        eye_distance: f64,
    },
    /// A problem with the marks.
    Problem {
        /// In a sentence.
        problem: String,
        /// The mark that is most likely wrong.
        node: Option<NodeId>,
    },
}

/// Proposed marks.
#[derive(Serialize)]
pub struct Proposed {
    pub source: Option<ProposalSource>,
    pub marks: Vec<Mark>,
    /// Why there are none, with advice.
    pub note: Option<String>,
}

impl Proposed {
    /// Marks that were found.
    pub fn of(found: &ProposedMarks) -> Self {
        Self { source: Some(found.source), marks: found.marks.iter().map(Mark::from).collect(), note: None }
    }
}

/// Rounds px to two decimals, the resolution of a screen.
pub fn hundredth(value: f64) -> f64 {
    (value * 100.0).round() / 100.0
}
