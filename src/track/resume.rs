//! Corrections by hand in a tracked sequence, and tracking again from a corrected frame.
//!
//! A correction is a hard position of one node in one frame after the neutral. It is kept in the track itself: the node's state in that
//! frame is [`NodeState::Corrected`], so that tracking again honours every correction that is there. A corrected frame is the step from
//! the frame before it, re-deformed by the springs: corrected nodes are where they were set, nodes that KLT tracked are held where it
//! found them, nodes that were lost follow.

use std::collections::BTreeMap;

use nalgebra::Point2;

use super::{
    NodeState, PointTracker, TrackError, TrackOptions, TrackPlan, TrackedFrame, TrackedNode, eye_distance_px, step::Step,
    window_px,
};
use crate::{
    fit::{Pull, Springs, Target},
    sequence::{Frame, SequenceError},
    units::NodeId,
    wireframe::Wireframe,
};

/// Force that holds a tracked node in a corrected frame, over the stiffness of a spring: a corrected neighbour at distance d moves it
/// by less than d / 20.
const HOLDING_FORCE: f64 = 20.0;

/// Hard positions by frame number and node, px.
pub type Corrections = BTreeMap<u32, BTreeMap<NodeId, Point2<f64>>>;

/// The corrections in a track: nodes set by hand in frames after the neutral.
pub fn corrections_of(frames: &[TrackedFrame]) -> Corrections {
    let mut corrections = Corrections::new();
    for frame in frames.iter().skip(1) {
        let corrected = frame.nodes.iter().enumerate().filter(|(_, n)| n.state == NodeState::Corrected);
        let nodes: BTreeMap<_, _> = corrected.map(|(k, n)| (NodeId(k as u16), n.position)).collect();
        if !nodes.is_empty() {
            corrections.insert(frame.number, nodes);
        }
    }
    corrections
}

/// The nodes of a frame with hard positions put into them.
///
/// # Errors
/// [`TrackError::Springs`] for a node in no triangle, or a position that is not finite.
pub fn correct_nodes(
    wireframe: &Wireframe,
    springs: &Springs,
    nodes: &[TrackedNode],
    hard: &BTreeMap<NodeId, Point2<f64>>,
) -> Result<Vec<TrackedNode>, TrackError> {
    if hard.is_empty() {
        return Ok(nodes.to_vec());
    }
    let rest: Vec<_> = nodes.iter().map(|n| n.position).collect();
    let is_held = |node: &&NodeId| {
        !hard.contains_key(*node) && nodes.get(node.index()).is_some_and(|n| !matches!(n.state, NodeState::Recovered(_)))
    };
    let held = wireframe.live_nodes().iter().filter(is_held);
    let held = held.map(|&node| Target { node, position: rest[node.index()], pull: Pull::Force(HOLDING_FORCE) });
    let set = hard.iter().map(|(&node, &position)| Target { node, position, pull: Pull::Hard });
    let places = springs.deform(wireframe, &rest, &held.chain(set).collect::<Vec<_>>())?;
    let corrected = |(k, (node, position)): (usize, (&TrackedNode, Point2<f64>))| match hard.get(&NodeId(k as u16)) {
        Some(&position) => TrackedNode { position, state: NodeState::Corrected, residual: None },
        None => TrackedNode { position, ..*node },
    };
    Ok(nodes.iter().zip(places).enumerate().map(corrected).collect())
}

/// Tracks the frames behind frame `start` of a track again, from its nodes as they are there.
///
/// `frames` are the neutral frame, the frame `start` and those to be tracked, in order; frames between the neutral and `start` are passed
/// over. The answer holds the frames tracked, without `start` and what is before it. Nodes that `corrections` names are put in their
/// places. The window and all lengths come from the neutral frame of the track, as in [`super::track_with`].
///
/// # Errors
/// [`TrackError`] as for tracking, for a `start` that the track does not have, and for corrections that the springs can not take.
#[allow(clippy::too_many_arguments)]
pub fn resume_with(
    tracker: &mut impl PointTracker,
    wireframe: &Wireframe,
    plan: &TrackPlan,
    track: &[TrackedFrame],
    start: u32,
    corrections: &Corrections,
    frames: impl IntoIterator<Item = Result<Frame, SequenceError>>,
    options: &TrackOptions,
) -> Result<Vec<TrackedFrame>, TrackError> {
    let rest: Vec<_> = track.first().map(|f| f.nodes.iter().map(|n| n.position).collect()).unwrap_or_default();
    let eye_distance = eye_distance_px(&plan.tables, &rest).unwrap_or(100.0);
    let window = window_px(&plan.tables, &rest, options);
    let springs = Springs::new(wireframe);
    let first = track.iter().find(|f| f.number == start);
    let mut previous = first.ok_or(TrackError::TooFewFrames { found: track.len() })?.clone();
    let mut out: Vec<TrackedFrame> = Vec::new();
    for (index, frame) in frames.into_iter().enumerate() {
        let frame = frame?;
        let number = frame.number();
        if index == 0 || number >= start {
            tracker.advance(&frame)?;
        }
        if number <= start {
            continue;
        }
        let step = Step { wireframe, plan, options, window, eye_distance, size: frame.size(), number };
        let nodes = step.run(tracker, &previous)?;
        let nodes = match corrections.get(&number) {
            Some(hard) => correct_nodes(wireframe, &springs, &nodes, hard)?,
            None => nodes,
        };
        previous = TrackedFrame { number, nodes };
        out.push(previous.clone());
    }
    Ok(out)
}
