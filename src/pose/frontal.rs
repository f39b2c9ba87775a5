//! Tracked nodes carried back to the head that looks into the camera.

use nalgebra::{Point2, Rotation3, Vector2, Vector3};

use super::{HeadFit, HeadModel, HeadPose};
use crate::{
    fit::{DrivenNode, Pull, SpringError, Springs},
    geometry::Similarity,
    normalize::EyeCorners,
    track::{LossReason, NodeState, TrackedFrame},
    wireframe::{Tables, Wireframe},
};

/// Cosine between normal and line of sight below which a node counts less, and the range over which it ceases to count.
const EDGE_ON: f64 = 0.2;
const FADING: f64 = 0.3;
/// Gain of the pull on a node that is seen, over the stiffness of a spring.
const FORCE: f64 = 150.0;
/// Standard deviation of the yaw and pitch of a neutral head, degrees.
const ABSOLUTE: f64 = 4.0;
/// Standard deviation of a turn against the neutral frame, degrees.
const SMALL_TURN: f64 = 0.5;
/// Visibility from which a node keeps its own place.
const SEEN: f64 = 0.98;

/// How well every node is seen in a pose, 0 (behind the head) to 1.
///
/// By the angle between its normal and the line of sight; nodes at the outline, which are edge-on from the front already, count from
/// where they are from the front.
pub fn visibility(model: &HeadModel, shape: &[Vector3<f64>], pose: &HeadPose) -> Vec<f64> {
    let seen = |normal: &Vector3<f64>| {
        let length = normal.norm();
        if length < 1e-12 {
            return 1.0;
        }
        let turned = pose.turned(normal).z / length;
        let edge = EDGE_ON.min(normal.z / length);
        (1.0 + (turned - edge) / FADING).clamp(0.0, 1.0)
    };
    normals(model, shape).iter().map(seen).collect()
}

/// Normals of the nodes of a head, of any length, out of it; zero for a node in no triangle.
pub(super) fn normals(model: &HeadModel, shape: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let mut normals = vec![Vector3::zeros(); shape.len()];
    for &[a, b, c] in &model.triangles {
        let [p, q, r] = [a, b, c].map(|n| shape[n.index()]);
        let normal: Vector3<f64> = (q - p).cross(&(r - p));
        [a, b, c].iter().for_each(|n| normals[n.index()] += normal);
    }
    normals
}

/// The part of the neutral frame's yaw and pitch that is left in the models.
///
/// How a neutral head is turned is known from its shape alone, to some [`ABSOLUTE`] degrees, and neutral frames are frontal as a rule:
/// of an angle `a` the share `a^2 / (a^2 + ABSOLUTE^2)` is taken out, most of a large one, little of one that may be an error.
/// Turns against the neutral frame, which are known much better, are taken out whole.
fn untrusted_turn(neutral: &HeadPose) -> Rotation3<f64> {
    let [yaw, pitch, _] = neutral.degrees();
    let share = ABSOLUTE * ABSOLUTE / (yaw * yaw + pitch * pitch + ABSOLUTE * ABSOLUTE);
    HeadPose::rotation_of(yaw * share, pitch * share, 0.0)
}

/// The angle between the directions of two heads, roll left out, degrees.
fn turn_degrees(a: &HeadPose, b: &HeadPose) -> f64 {
    let direction = |pose: &HeadPose| pose.rotation * Vector3::z();
    direction(a).angle(&direction(b)).to_degrees()
}

/// The nodes of all frames as the same head would show them looking into the same camera: px of the size of the neutral frame, y
/// down.
///
/// Turns below `SMALL_TURN` cannot be told from none: a frame counts as turned by the share `t^2 / (t^2 + SMALL_TURN^2)` of its turn t
/// against the neutral frame. A node that was tracked goes back along its line of sight to the depth of the fitted head. Nodes that
/// were not seen (no landmark stands for them, or the head hides them) take their offset from neutral from those around them by the
/// springs.
///
/// # Errors
/// [`SpringError`] when the springs have no equilibrium.
pub fn frontalized(
    model: &HeadModel,
    fit: &HeadFit,
    track: &[TrackedFrame],
    (wireframe, tables): (&Wireframe, &Tables),
    springs: &Springs,
) -> Result<Vec<Vec<Point2<f64>>>, SpringError> {
    let Some(neutral_pose) = fit.poses.first() else { return Ok(Vec::new()) };
    let corners = EyeCorners::new(tables, wireframe.node_count());
    let seen_in = |frame: &TrackedFrame| -> Vec<Point2<f64>> { frame.nodes.iter().map(|n| n.position).collect() };
    let seen_neutral = track.first().map(&seen_in).unwrap_or_default();
    let front = HeadPose { rotation: untrusted_turn(neutral_pose), ..*neutral_pose };
    let mut neutral: Vec<Point2<f64>> = Vec::new();
    // Marks and not nodes are followed, and what they moved moves the nodes: see `mark_shifts`.
    let mut from_mark: Vec<Vector2<f64>> = Vec::new();
    let mut out = Vec::with_capacity(track.len());
    for (m, frame) in track.iter().enumerate() {
        let (pose, shape) = (&fit.poses[m], &fit.shapes[m]);
        let turn = turn_degrees(neutral_pose, pose);
        let turned_share = turn * turn / (turn * turn + SMALL_TURN * SMALL_TURN);
        // Without a turn of the head a similarity takes the frame onto the neutral one.
        let still = corners.similarity(&seen_in(frame), &seen_neutral).unwrap_or_else(|_| Similarity::identity());
        let carried = |k: usize, seen: Point2<f64>| {
            let turned = front.project(&pose.back(&seen, pose.turned(&shape[k]).z));
            let at_rest = still.apply(&seen);
            let unturned = front.project(&neutral_pose.back(&at_rest, neutral_pose.turned(&shape[k]).z));
            unturned + (turned - unturned) * turned_share
        };
        let marked: Vec<Point2<f64>> =
            (0..shape.len()).map(|k| carried(k, frame.nodes[k].position + fit.mark_shifts[m][k])).collect();
        if m == 0 {
            let node = |k: usize| carried(k, frame.nodes[k].position) - marked[k];
            from_mark = (0..shape.len()).map(node).collect();
        }
        let mut nodes: Vec<Point2<f64>> = marked.iter().zip(&from_mark).map(|(at, shift)| at + shift).collect();
        if m == 0 {
            wireframe.place_followers(&mut nodes);
            neutral.clone_from(&nodes);
            out.push(nodes);
            continue;
        }
        let visible = visibility(model, shape, pose);
        let seen = |k: usize| match frame.nodes[k].state {
            NodeState::Recovered(LossReason::NoLandmark) => 0.0,
            _ => visible[k],
        };
        if wireframe.live_nodes().iter().any(|n| seen(n.index()) < SEEN) {
            let drives = |n: &&crate::units::NodeId| seen(n.index()) > 0.0;
            let targets: Vec<DrivenNode> = wireframe
                .live_nodes()
                .iter()
                .filter(drives)
                .map(|&node| DrivenNode { node, position: nodes[node.index()], pull: Pull::Force(FORCE * seen(node.index())) })
                .collect();
            let completed = springs.deform(wireframe, &neutral, &targets)?;
            for &node in wireframe.live_nodes() {
                let (k, share) = (node.index(), seen(node.index()));
                nodes[k] = completed[k] + (nodes[k] - completed[k]) * share;
            }
            for iris in &model.irises {
                let moved: Vector2<f64> = iris.iter().map(|n| nodes[n.index()] - neutral[n.index()]).sum();
                let mean = moved / iris.len().max(1) as f64;
                iris.iter().for_each(|n| nodes[n.index()] = neutral[n.index()] + mean);
            }
        }
        wireframe.place_followers(&mut nodes);
        out.push(nodes);
    }
    Ok(out)
}
