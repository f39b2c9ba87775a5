//! Summarizes in a few numbers how well a sequence was tracked, and judges whether a person should look at it again.

mod judge;
mod summary;

use serde::{Deserialize, Serialize};

use super::{Look, TrackedFrame};
use crate::{robust::median, units::SequenceId, wireframe::Wireframe};

pub(crate) use judge::{missing_said, two_pictures_said};
pub use summary::{TrackSummary, Verdict, summarize};

/// How well one sequence was tracked: its summary with its name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackQuality {
    /// The sequence.
    pub id: SequenceId,
    /// Emotion label.
    pub emotion: String,
    /// The summary.
    pub summary: TrackSummary,
    /// Quality of every frame after the neutral one; empty when the frames are not available.
    #[serde(default)]
    pub course: Vec<FrameQuality>,
    /// Small JPEG files of the wireframe on the neutral and the apex frame; `None` where there are no pictures or they may not be shown.
    #[serde(skip)]
    pub pictures: Option<[Vec<u8>; 2]>,
    /// Identifies its pictures and its nodes, for looks at it; empty if unknown.
    #[serde(default)]
    pub content: String,
    /// What a person found when looking at it.
    #[serde(default)]
    pub look: Option<Look>,
}

impl TrackQuality {
    /// Creates the quality of a track, without pictures.
    pub fn new(id: SequenceId, emotion: String, summary: TrackSummary, frames: &[TrackedFrame], wireframe: &Wireframe) -> Self {
        Self { id, emotion, summary, course: course(frames, wireframe), pictures: None, content: String::new(), look: None }
    }

    /// Whether a person should look at it: there is a reason, and nobody has looked at it as it is.
    pub fn is_to_look_at(&self) -> bool {
        self.summary.verdict == Verdict::LookAgain && !matches!(self.look, Some(Look::Right | Look::LeaveOut))
    }

    /// Whether a person has looked at it and left it out of the statistics.
    pub fn is_left_out(&self) -> bool {
        self.look == Some(Look::LeaveOut)
    }
}

/// How well one frame was tracked.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameQuality {
    /// Share of the live nodes that were lost, 0 to 1.
    pub lost: f64,
    /// Median expected error of the live nodes, px; `None` when unknown.
    pub expected_error_px: Option<f64>,
}

/// Returns the quality of every frame after the neutral one.
pub fn course(frames: &[TrackedFrame], wireframe: &Wireframe) -> Vec<FrameQuality> {
    let live = wireframe.live_nodes();
    let frame = |frame: &TrackedFrame| {
        let nodes: Vec<_> = live.iter().filter_map(|id| frame.nodes.get(id.index())).collect();
        let lost = nodes.iter().filter(|n| n.state.loss().is_some()).count();
        let mut errors: Vec<f64> = nodes.iter().filter_map(|n| n.expected_error).collect();
        FrameQuality { lost: lost as f64 / nodes.len().max(1) as f64, expected_error_px: median(&mut errors) }
    };
    frames.iter().skip(1).map(frame).collect()
}

#[cfg(test)]
mod tests;
