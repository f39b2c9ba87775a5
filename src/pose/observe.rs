//! Observations of a head in a track: visible nodes of every frame with their standard deviations, and a first pose.

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use super::{CAMERA_DISTANCE, HEAD_ES, HeadModel, HeadPose, PoseError, frontal::normals, solve::Seen};
use crate::{
    fit::MEDIAN_OVER_DEVIATION,
    geometry::Similarity,
    normalize::stable_nodes,
    track::{LossReason, NodeState, TrackedFrame, TrackedNode},
    units::NodeId,
    wireframe::Tables,
};

/// Standard deviation of a tracked node, model units: 1 % of the eye distance.
const TRACKED: f64 = 0.006;
/// Standard deviation of a node that the springs placed, model units.
const RECOVERED: f64 = 0.06;
/// Factor on a node's expected error when it is added to its standard deviation. Errors of neighbours, and of one node over the frames, are
/// correlated; treated as independent, the skin of the forehead would determine the camera's distance. Of the factors 2, 3, 4 and 6, 4
/// leaves the smallest error of a turn in simulated people.
const ALIKE: f64 = 4.0;
/// Standard deviation of the person's own offset of a marked node, beyond the modes, model units. If it is halved, heads with depth outside
/// the modes are explained by a turn instead.
const OWN_MARKED: f64 = 0.015;
/// Standard deviations of an unmarked node's own offset, along the skin and (`OWN_ACROSS`) across it: it may lie on another part of the
/// skin, but it lies on the skin.
const OWN_ALONG: f64 = 0.025;
const OWN_ACROSS: f64 = 0.02;
/// Fewest visible nodes for a pose.
pub(super) const FEWEST_SEEN: usize = 6;
/// Observations in one frame.
pub(super) struct Frame {
    pub number: u32,
    pub seen: Vec<Seen>,
}

impl Frame {
    pub fn is_seen(&self) -> bool {
        self.seen.len() >= FEWEST_SEEN
    }
}

/// Returns the offset from every node to its mark, px, in every frame: that of the neutral frame, rotated and scaled with the face.
///
/// A fitted node may differ from its mark, and moves as the mark would. Nodes without a mark, and nodes corrected by hand, have no offset.
pub(super) fn mark_shifts(
    model: &HeadModel,
    tables: &Tables,
    track: &[TrackedFrame],
    marks: &[(NodeId, Point2<f64>)],
) -> Vec<Vec<Vector2<f64>>> {
    let count = model.node_count();
    let Some(neutral) = track.first() else { return Vec::new() };
    let mut shifts = vec![Vector2::zeros(); count];
    for (node, at) in marks.iter().filter(|(node, _)| node.index() < count.min(neutral.nodes.len())) {
        let fitted = &neutral.nodes[node.index()];
        if fitted.state != NodeState::Corrected {
            shifts[node.index()] = at - fitted.position;
        }
    }
    let stable = stable_nodes(tables, count);
    let turned = |frame: &TrackedFrame| {
        let pick = |frame: &TrackedFrame| -> Vec<Point2<f64>> {
            stable.iter().filter_map(|&k| frame.nodes.get(k).map(|n| n.position)).collect()
        };
        let moved = Similarity::fit(&pick(neutral), &pick(frame), None).unwrap_or_else(|_| Similarity::identity());
        let origin = moved.apply(&Point2::origin());
        shifts.iter().map(|&shift| moved.apply(&Point2::from(shift)) - origin).collect()
    };
    track.iter().map(turned).collect()
}

/// Returns the nodes that the tracker placed, each at the position of its mark. `scale`: px per model unit of the neutral head; `None` for
/// the neutral frame.
///
/// # Errors
/// [`PoseError::NodeCount`] for a frame of another wireframe.
pub(super) fn observe(
    model: &HeadModel,
    frame: &TrackedFrame,
    shifts: &[Vector2<f64>],
    scale: Option<f64>,
) -> Result<Frame, PoseError> {
    if frame.nodes.len() != model.node_count() {
        let (found, expected) = (frame.nodes.len(), model.node_count());
        return Err(PoseError::NodeCount { frame: frame.number, found, expected });
    }
    let iris = |k: usize| model.irises.iter().flatten().any(|n| n.index() == k);
    let mut seen = Vec::new();
    for node in &model.live {
        let k = node.index();
        let tracked = &frame.nodes[k];
        let deviation = match tracked.state {
            NodeState::Follows | NodeState::Recovered(LossReason::NoLandmark | LossReason::LostFrame) => continue,
            NodeState::Recovered(_) => RECOVERED,
            _ => {
                let off = scale.zip(tracked.expected_error).map_or(0.0, |(scale, median)| median / MEDIAN_OVER_DEVIATION / scale);
                TRACKED.hypot(ALIKE * off)
            }
        };
        if !iris(k) {
            seen.push(Seen { node: k, at: tracked.position + shifts[k], deviation });
        }
    }
    Ok(Frame { number: frame.number, seen })
}

/// Normal distribution, with mean 0, of a person's own offset of a node.
#[derive(Clone, Copy)]
pub(super) struct Own {
    /// Largest standard deviation.
    pub deviation: f64,
    /// Inverse of the square root of the covariance, and inverse of the covariance.
    pub per_spread: Matrix3<f64>,
    pub precision: Matrix3<f64>,
}

impl Own {
    /// Creates a distribution with standard deviations along a surface with a unit normal, and across it.
    fn new(along: f64, across: f64, normal: &Vector3<f64>) -> Self {
        let across_share = normal * normal.transpose();
        let along_share = Matrix3::identity() - across_share;
        let with = |power: i32| along_share * along.powi(power) + across_share * across.powi(power);
        Self { deviation: along.max(across), per_spread: with(-1), precision: with(-2) }
    }
}

/// Returns the distribution of the person's own offset of every node; a model unit of the neutral head is `scale` px.
///
/// A mark with an error (a located one has several pixels) lies on another part of the skin, equally in all frames, and does not determine
/// its depth there: taken as exact, it would turn the head. The error of hand-set marks is included in [`OWN_MARKED`].
pub(super) fn own_offsets(model: &HeadModel, neutral: &TrackedFrame, scale: f64) -> Vec<Own> {
    let own = |(node, normal): (&TrackedNode, &Vector3<f64>)| {
        let normal = normal.try_normalize(1e-12).unwrap_or_else(Vector3::z);
        match node.state {
            NodeState::Marked | NodeState::Corrected | NodeState::Tracked => {
                let off = node.expected_error.map_or(0.0, |median| median / MEDIAN_OVER_DEVIATION / scale);
                Own::new(OWN_MARKED.max(off), OWN_MARKED, &normal)
            }
            _ => Own::new(OWN_ALONG, OWN_ACROSS, &normal),
        }
    };
    neutral.nodes.iter().zip(&normals(model, &model.mean)).map(own).collect()
}

/// Returns a frontal pose from the similarity of the points that expressions do not move.
pub(super) fn rough_pose(model: &HeadModel, tables: &Tables, frame: &TrackedFrame) -> Result<HeadPose, PoseError> {
    let stable = stable_nodes(tables, model.node_count());
    let face: Vec<Point2<f64>> = stable.iter().map(|&k| frontal(model, k)).collect();
    let seen: Vec<Point2<f64>> = stable.iter().map(|&k| frame.nodes[k].position).collect();
    Ok(pose_of(&Similarity::fit(&face, &seen, None)?))
}

/// Returns a node of the mean head from the front, y down.
pub(super) fn frontal(model: &HeadModel, k: usize) -> Point2<f64> {
    Point2::new(model.mean[k].x, -model.mean[k].y)
}

/// Returns the frontal pose of a similarity from the frontal head to the image, y down in both.
pub(super) fn pose_of(placed: &Similarity) -> HeadPose {
    HeadPose {
        // The similarity's angle is measured with y down.
        rotation: HeadPose::rotation_of(0.0, 0.0, -placed.angle.to_degrees()),
        scale: placed.scale,
        position: placed.apply(&Point2::origin()),
        distance: CAMERA_DISTANCE * HEAD_ES,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wireframe::Face;

    #[test]
    fn a_mark_that_may_be_off_lies_elsewhere_along_the_skin_and_not_deeper() {
        let Face { wireframe, tables } = Face::candide3();
        let model = HeadModel::shipped(&wireframe, &tables);
        let scale = 50.0;
        let place = |k: usize| Point2::from(frontal(&model, k).coords * scale);
        let nodes = (0..model.node_count()).map(|k| TrackedNode::new(place(k), NodeState::Marked, None)).collect();
        let mut neutral = TrackedFrame { number: 1, nodes };
        // Standard deviations of 1.25 px, 0.025 of a head's units, and of 0.25 px.
        neutral.nodes[5].expected_error = Some(1.25 * MEDIAN_OVER_DEVIATION);
        neutral.nodes[7].expected_error = Some(0.25 * MEDIAN_OVER_DEVIATION);
        neutral.nodes[6].state = NodeState::Fitted;
        let own = own_offsets(&model, &neutral, scale);
        let normal = normals(&model, &model.mean)[5].normalize();
        let aside = normal.cross(&Vector3::x()).normalize();
        let deviation = |own: &Own, along: &Vector3<f64>| (own.per_spread * along).norm().recip();
        assert!((deviation(&own[5], &aside) - 0.025).abs() < 1e-12);
        assert!((deviation(&own[5], &normal) - OWN_MARKED).abs() < 1e-12);
        // A small error is the same in every direction; a node without a mark may be further off along the skin, but not much deeper.
        assert!((deviation(&own[7], &aside) - OWN_MARKED).abs() < 1e-12);
        assert_eq!([own[5].deviation, own[6].deviation, own[7].deviation], [0.025, OWN_ALONG, OWN_MARKED]);
    }

    #[test]
    fn a_node_that_is_expected_to_be_off_says_less_of_the_head() {
        let Face { wireframe, tables } = Face::candide3();
        let model = HeadModel::shipped(&wireframe, &tables);
        let scale = 50.0;
        let place = |k: usize| Point2::from(frontal(&model, k).coords * scale);
        let mut nodes: Vec<_> = (0..model.node_count()).map(|k| TrackedNode::new(place(k), NodeState::Tracked, None)).collect();
        // A standard deviation of 0.5 px, 0.01 of a head's units.
        nodes[5].expected_error = Some(0.5 * MEDIAN_OVER_DEVIATION);
        let frame = TrackedFrame { number: 2, nodes };
        let shifts = vec![Vector2::zeros(); model.node_count()];
        let deviation = |node: usize, scale| {
            let seen = observe(&model, &frame, &shifts, scale).unwrap().seen;
            seen.iter().find(|s| s.node == node).unwrap().deviation
        };
        assert!((deviation(5, Some(scale)) - TRACKED.hypot(0.01 * ALIKE)).abs() < 1e-12);
        // The neutral frame, and tracks from landmarks, have no expected errors.
        assert_eq!([deviation(5, None), deviation(7, Some(scale))], [TRACKED; 2]);
    }
}
