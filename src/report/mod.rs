//! The report: one self-contained HTML file.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::{
    statistics::Representative,
    units::{NodeId, SequenceId},
    wireframe::{Fapus, Tables, Wireframe},
};

/// How well one sequence was tracked.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrackQuality {
    /// The sequence.
    pub id: SequenceId,
    /// Emotion label.
    pub emotion: String,
    /// Frames from neutral to apex.
    pub frames: usize,
    /// Share of (live node, frame) pairs after the neutral frame that were tracked, 0 to 1.
    pub tracked_share: f64,
    /// Mean forward-backward distance of tracked nodes, px.
    pub mean_residual_px: f64,
    /// Eye distance ES0 in the neutral frame, px.
    pub eye_distance_px: f64,
    /// Recovered (node, frame) pairs by reason.
    pub recovered: BTreeMap<String, usize>,
    /// Live nodes most often recovered, with the number of frames, worst first, at most five.
    pub worst_nodes: Vec<(NodeId, usize)>,
}

/// A sequence that failed, as in `failures.csv`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Failure {
    /// Subject.
    pub subject: String,
    /// Sequence.
    pub sequence: String,
    /// Stage that failed: dataset, fit, track, normalize, statistics.
    pub stage: String,
    /// The error in full.
    pub reason: String,
}

/// Everything the report shows.
#[derive(Debug)]
pub struct ReportData<'a> {
    /// Heading, such as the dataset's folder name.
    pub title: String,
    /// Program version and the options as label and value, in the order to show.
    pub options: Vec<(String, String)>,
    /// The representatives, by emotion and group.
    pub representatives: &'a [Representative],
    /// One row per tracked sequence, sorted by id.
    pub tracks: &'a [TrackQuality],
    /// What failed.
    pub failures: &'a [Failure],
    /// Topology and canonical neutral.
    pub wireframe: &'a Wireframe,
    /// Regions and feature points.
    pub tables: &'a Tables,
    /// FAPUs of the canonical neutral, face units.
    pub fapus: Fapus,
    /// FAP values at the apex of every representative (same order): FAP number, name, value in FAP units.
    pub apex_faps: Vec<Vec<(u8, String, i32)>>,
}

/// Renders the report.
///
/// # Errors
/// When the template does not render (a programmer's error).
pub fn render_html(data: &ReportData<'_>) -> Result<String, minijinja::Error> {
    let _ = data;
    unimplemented!()
}
