//! Carries tracked nodes back to a head that looks into the camera.

use nalgebra::{Point2, Point3, Rotation3, Vector2, Vector3};

use super::{HeadFit, HeadModel, HeadPose};
use crate::{
    fit::{DrivenNode, MEDIAN_OVER_DEVIATION, Pull, SpringError, Springs},
    geometry::Similarity,
    normalize::EyeCorners,
    track::{LossReason, NodeState, TrackedFrame, TrackedNode},
    wireframe::{Tables, Wireframe},
};

/// Cosine between normal and line of sight at which the visibility of a node falls, and the range over which it falls to 0.
const EDGE_ON: f64 = 0.2;
const FADING: f64 = 0.3;
/// Gain of the pull on a visible node, over the stiffness of a spring.
const FORCE: f64 = 150.0;
/// Standard deviation of the yaw and pitch of a neutral head, degrees.
const ABSOLUTE: f64 = 4.0;
/// Standard deviation of a turn relative to the neutral frame, degrees.
const SMALL_TURN: f64 = 0.5;
/// Visibility from which a node keeps its own position.
const SEEN: f64 = 0.98;
/// Error in the image, model units, due to unknown depth, at which a node's own position has weight one half.
const HALF_CARRIED: f64 = 0.001;
/// Lower bound of the cosine between normal and line of sight: steeper skin is treated as this steep.
const STEEPEST: f64 = 0.2;

/// Returns the visibility of every node in a pose, 0 (hidden by the head) to 1.
///
/// It depends on the angle between the node's normal and the line of sight. For nodes at the outline, which are edge-on even from the
/// front, the angle is measured from their frontal one.
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

/// Returns the outward normals of the nodes of a head, of any length; zero for a node in no triangle.
pub(super) fn normals(model: &HeadModel, shape: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let mut normals = vec![Vector3::zeros(); shape.len()];
    for &[a, b, c] in &model.triangles {
        let [p, q, r] = [a, b, c].map(|n| shape[n.index()]);
        let normal: Vector3<f64> = (q - p).cross(&(r - p));
        [a, b, c].iter().for_each(|n| normals[n.index()] += normal);
    }
    normals
}

/// Returns the part of the neutral frame's yaw and pitch that stays in the models.
///
/// The turn of a neutral head is known from its shape alone, to [`ABSOLUTE`] degrees, and neutral frames are usually frontal. Of an angle
/// `a` the share `a^2 / (a^2 + ABSOLUTE^2)` is removed: most of a large angle, little of one that may be an error. Turns relative to the
/// neutral frame are known much better and are removed entirely.
fn untrusted_turn(neutral: &HeadPose) -> Rotation3<f64> {
    let [yaw, pitch, _] = neutral.degrees();
    let share = ABSOLUTE * ABSOLUTE / (yaw * yaw + pitch * pitch + ABSOLUTE * ABSOLUTE);
    HeadPose::rotation_of(yaw * share, pitch * share, 0.0)
}

/// Returns the angle between the directions of two heads without roll, degrees.
fn turn_degrees(a: &HeadPose, b: &HeadPose) -> f64 {
    let direction = |pose: &HeadPose| pose.rotation * Vector3::z();
    direction(a).angle(&direction(b)).to_degrees()
}

/// Returns the uncertainty of the depth of every node, as standard deviations in model units, because the fit may have put it on another
/// part of the skin. It is the node's expected error in the neutral frame times the slope of the skin, the tangent between normal and line
/// of sight.
fn open_depths(normals: &[Vector3<f64>], neutral: &TrackedFrame, pose: &HeadPose) -> Vec<f64> {
    let open = |(normal, node): (&Vector3<f64>, &TrackedNode)| {
        let length = normal.norm();
        let cosine = if length < 1e-12 { 1.0 } else { (pose.turned(normal).z / length).clamp(STEEPEST, 1.0) };
        let off = node.expected_error.map_or(0.0, |median| median / MEDIAN_OVER_DEVIATION / pose.scale);
        off * (cosine.powi(-2) - 1.0).max(0.0).sqrt()
    };
    normals.iter().zip(&neutral.nodes).map(open).collect()
}

/// Returns the weight of a node's own position, 0 to 1, on a head turned by `turn` degrees: a turn `t` moves a node whose depth is off by
/// `d` by `d sin t` in the image. Nodes placed by landmarks or by hand have no expected error, and full weight.
fn own_share(node: &TrackedNode, open_depth: f64, turn: f64) -> f64 {
    if node.expected_error.is_none() || node.state == NodeState::Corrected {
        return 1.0;
    }
    1.0 / (1.0 + (open_depth * turn.to_radians().sin() / HALF_CARRIED).powi(2))
}

/// Returns the nodes of all frames as the same head would show them looking into the same camera: px at the size of the neutral frame, y
/// down.
///
/// Turns below `SMALL_TURN` cannot be distinguished from none: of a turn t relative to the neutral frame, the share `t^2 / (t^2 +
/// SMALL_TURN^2)` is removed. A tracked node goes back along its line of sight to the depth of the fitted head. Nodes that were not
/// observed (without a landmark, or hidden by the head) get their offset from neutral from their neighbours by the springs. The same holds,
/// increasingly with the turn, for nodes on steep skin with an uncertain position in the neutral frame. For a track from pictures the rest
/// positions of the springs are those of the fitted expression.
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
    let open_depths =
        track.first().map(|frame| open_depths(&normals(model, &fit.neutral), frame, neutral_pose)).unwrap_or_default();
    let mut neutral: Vec<Point2<f64>> = Vec::new();
    // Marks are followed instead of nodes, and their motion moves the nodes: see `mark_shifts`.
    let mut from_mark: Vec<Vector2<f64>> = Vec::new();
    let mut out = Vec::with_capacity(track.len());
    for (m, frame) in track.iter().enumerate() {
        let (pose, shape) = (&fit.poses[m], &fit.shapes[m]);
        let turn = turn_degrees(neutral_pose, pose);
        let turned_share = turn * turn / (turn * turn + SMALL_TURN * SMALL_TURN);
        // Without a turn of the head, a similarity maps the frame onto the neutral one.
        let still = corners.similarity(&seen_in(frame), &seen_neutral).unwrap_or_else(|_| Similarity::identity());
        let carried = |k: usize, seen: Point2<f64>| {
            let turned = front.project(&pose.back(&seen, pose.turned(&shape[k]).z));
            let at_rest = still.apply(&seen);
            let unturned = front.project(&neutral_pose.back(&at_rest, neutral_pose.turned(&shape[k]).z));
            unturned + (turned - unturned) * turned_share
        };
        let marked: Vec<Point2<f64>> =
            (0..shape.len()).map(|k| carried(k, frame.nodes[k].position + fit.mark_shift(m, k))).collect();
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
            _ => visible[k] * own_share(&frame.nodes[k], open_depths[k], turn),
        };
        if wireframe.live_nodes().iter().any(|n| seen(n.index()) < SEEN) {
            let drives = |n: &&crate::units::NodeId| seen(n.index()) > 0.0;
            let targets: Vec<DrivenNode> = wireframe
                .live_nodes()
                .iter()
                .filter(drives)
                .map(|&node| DrivenNode { node, position: nodes[node.index()], pull: Pull::Force(FORCE * seen(node.index())) })
                .collect();
            let at_front = |place: &Vector3<f64>| front.project(&Point3::from(*place));
            let shown = |k: usize| at_front(&shape[k]) - at_front(&fit.neutral[k]);
            let in_picture = frame.nodes.iter().any(|n| n.expected_error.is_some());
            let rest: Vec<Point2<f64>> =
                if in_picture { neutral.iter().enumerate().map(|(k, at)| at + shown(k)).collect() } else { neutral.clone() };
            let completed = springs.deform(wireframe, &rest, &targets)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn on_steep_skin_a_place_that_is_not_known_leaves_the_depth_open() {
        let pose = HeadPose {
            rotation: HeadPose::rotation_of(0.0, 0.0, 10.0),
            scale: 100.0,
            position: Point2::new(320.0, 240.0),
            distance: 8.0,
        };
        let node = |error: Option<f64>| {
            let node = TrackedNode::new(Point2::origin(), NodeState::Fitted, None);
            TrackedNode { expected_error: error.map(|deviation| deviation * MEDIAN_OVER_DEVIATION), ..node }
        };
        // Standard deviations of 2 px, 0.02 of a head's units.
        let nodes = vec![node(Some(2.0)), node(Some(2.0)), node(Some(2.0)), node(None)];
        let normals = [Vector3::z(), Vector3::new(-3.0, 0.0, 3.0), Vector3::x(), Vector3::x()];
        let open = open_depths(&normals, &TrackedFrame { number: 1, nodes }, &pose);
        // Flat, 45 degrees (slope 1), edge-on (slope at most sqrt(1 / 0.04 - 1)), and one without expected error.
        let expected = [0.0, 0.02, 0.02 * 24.0_f64.sqrt(), 0.0];
        assert!(open.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{open:?}");
    }

    #[test]
    fn a_node_of_unknown_depth_counts_less_on_a_turned_head_only() {
        let tracked = TrackedNode { expected_error: Some(1.0), ..TrackedNode::new(Point2::origin(), NodeState::Tracked, None) };
        let share = |open: f64, turn: f64| own_share(&tracked, open, turn);
        assert_eq!((share(0.02, 0.0), share(0.0, 20.0)), (1.0, 1.0));
        // 0.002 sin 30 = 0.001 halves it, 0.006 sin 30 = 0.003 leaves a tenth.
        assert!((share(0.002, 30.0) - 0.5).abs() < 1e-12 && (share(0.006, 30.0) - 0.1).abs() < 1e-12);
        // Positions from landmarks and hand-set corrections are kept.
        let landmark = TrackedNode { expected_error: None, ..tracked };
        let corrected = TrackedNode { state: NodeState::Corrected, ..tracked };
        assert_eq!([landmark, corrected].map(|node| own_share(&node, 0.02, 20.0)), [1.0; 2]);
    }
}
