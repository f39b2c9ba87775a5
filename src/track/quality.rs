//! How well a sequence was tracked, in a few numbers.

use std::collections::BTreeMap;

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::{LossReason, NodeState, TrackedFrame, eye_distance_px};
use crate::{
    units::{NodeId, SequenceId},
    wireframe::{Tables, Wireframe},
};

/// Worst nodes that are named.
const WORST_NODES: usize = 5;

/// Summary of one track.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackSummary {
    /// Frames from neutral to apex.
    pub frames: usize,
    /// Share of (live node, frame) pairs after the neutral frame that were tracked or corrected, 0 to 1.
    pub tracked_share: f64,
    /// Mean forward-backward distance of tracked nodes, px.
    pub mean_residual_px: f64,
    /// Eye distance ES0 in the neutral frame, px.
    pub eye_distance_px: f64,
    /// Recovered (live node, frame) pairs by reason.
    pub recovered: BTreeMap<String, usize>,
    /// Live nodes most often recovered, with the number of frames, worst first, at most five.
    pub worst_nodes: Vec<(NodeId, usize)>,
}

/// How well one sequence was tracked: its summary with its name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackQuality {
    /// The sequence.
    pub id: SequenceId,
    /// Emotion label.
    pub emotion: String,
    /// The summary.
    pub summary: TrackSummary,
}

/// Summarizes the frames of a track.
pub fn summarize(frames: &[TrackedFrame], wireframe: &Wireframe, tables: &Tables) -> TrackSummary {
    let live = wireframe.live_nodes();
    let mut recovered = BTreeMap::new();
    let mut losses: BTreeMap<NodeId, usize> = BTreeMap::new();
    let (mut tracked, mut pairs) = (0usize, 0usize);
    let (mut residual_sum, mut residuals) = (0.0, 0usize);
    for frame in frames.iter().skip(1) {
        for &id in live {
            let Some(node) = frame.nodes.get(id.index()) else { continue };
            pairs += 1;
            match node.state {
                NodeState::Recovered(reason) => {
                    *recovered.entry(reason.name().to_owned()).or_insert(0) += 1;
                    // Without a landmark it is never tracked: that is no weakness of the node.
                    if reason != LossReason::NoLandmark {
                        *losses.entry(id).or_insert(0) += 1;
                    }
                }
                _ => tracked += 1,
            }
            if let (NodeState::Tracked, Some(residual)) = (node.state, node.residual) {
                residual_sum += residual;
                residuals += 1;
            }
        }
    }
    let mut worst_nodes: Vec<_> = losses.into_iter().collect();
    worst_nodes.sort_by_key(|&(node, count)| (std::cmp::Reverse(count), node));
    worst_nodes.truncate(WORST_NODES);
    let share = |part: f64, whole: usize| if whole == 0 { 0.0 } else { part / whole as f64 };
    let neutral: Vec<Point2<f64>> = frames.first().map(|f| f.nodes.iter().map(|n| n.position).collect()).unwrap_or_default();
    TrackSummary {
        frames: frames.len(),
        tracked_share: share(tracked as f64, pairs),
        mean_residual_px: share(residual_sum, residuals),
        eye_distance_px: eye_distance_px(tables, &neutral).unwrap_or(0.0),
        recovered,
        worst_nodes,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::{LossReason, TrackedNode};

    #[test]
    fn shares_and_worst_nodes_are_counted() {
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        let node = |k: usize, state, residual| TrackedNode { position: w.frontal()[k] * 100.0, state, residual };
        let neutral = (0..113).map(|k| node(k, NodeState::Fitted, None)).collect();
        let mut moved: Vec<_> = (0..113).map(|k| node(k, NodeState::Tracked, Some(0.5))).collect();
        moved[31].state = NodeState::Recovered(LossReason::Extreme);
        moved[4].state = NodeState::Follows; // not live: does not count
        let frames = [neutral, moved.clone(), moved].map(|nodes| TrackedFrame { number: 1, nodes });
        let summary = summarize(&frames, &w, &t);
        assert_eq!(summary.frames, 3);
        assert!((summary.tracked_share - 103.0 / 104.0).abs() < 1e-12);
        assert!((summary.mean_residual_px - 0.5).abs() < 1e-12);
        assert!((summary.eye_distance_px - 61.3).abs() < 1e-9);
        assert_eq!(summary.recovered, BTreeMap::from([("extreme".to_owned(), 2)]));
        assert_eq!(summary.worst_nodes, [(NodeId(31), 2)]);
    }
}
