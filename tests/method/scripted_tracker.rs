//! The tracking method without OpenCV: a scripted point tracker determines where points move and which are lost.
//!
//! The face is Candide-3 with its pupils 100 px apart, so options relative to the eye distance are in hundredths of a pixel.

use grimace::internal::{
    fit::FittedWireframe,
    geometry::Similarity,
    model::FrameExpressionModel,
    sequence::{Frame, SequenceError},
    track::{
        Found, LossReason, NodeState, PointTracker, Probe, Slot, Track, TrackError, TrackOptions, TrackPlan, TrackedNode,
        track_with,
    },
    units::NodeId,
    wireframe::{Tables, Wireframe},
};
use nalgebra::{Point2, Vector2};

/// Fault of a node in the step to a frame.
#[derive(Clone, Copy, Debug)]
enum Fault {
    /// No match forward.
    Lost,
    /// A match forward, but none back.
    LostBack,
    /// Found at this distance from its true position; the way back returns to the start.
    Astray(f64, f64),
    /// The way back ends at this distance from the start.
    ReturnsAstray(f64, f64),
}

/// A point tracker that knows the position of every live node in every frame; it gets probes in the order of the live nodes.
struct Scripted<'a> {
    truth: &'a [Vec<Point2<f64>>],
    live: &'a [NodeId],
    faults: &'a [(usize, u16, Fault)],
    /// Number of frames so far.
    given: usize,
}

impl PointTracker for Scripted<'_> {
    fn advance(&mut self, _: &Frame) -> Result<(), TrackError> {
        self.given += 1;
        Ok(())
    }

    fn find(&mut self, from: Slot, to: Slot, _: u32, _: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError> {
        assert_eq!(probes.len(), self.live.len());
        let index = |slot| match slot {
            Slot::Neutral => 0,
            Slot::Previous => self.given - 2,
            Slot::Current => self.given - 1,
        };
        let (from, to) = (index(from), index(to));
        let answer = |(probe, node): (&Probe, &NodeId)| {
            let fault = self.faults.iter().find(|f| f.0 == from.max(to) && f.1 == node.0).map(|f| f.2);
            let moved = probe.position + (self.truth[to][node.index()] - self.truth[from][node.index()]);
            let position = match (fault, from < to) {
                (Some(Fault::Lost), true) | (Some(Fault::LostBack), false) => return Found::Lost,
                (Some(Fault::Astray(x, y)), true) => moved + Vector2::new(x, y),
                (Some(Fault::Astray(x, y)), false) => moved - Vector2::new(x, y),
                (Some(Fault::ReturnsAstray(x, y)), false) => moved + Vector2::new(x, y),
                _ => moved,
            };
            Found::At { position, difference: 0.0 }
        };
        Ok(probes.iter().zip(self.live).map(answer).collect())
    }
}

/// Tolerance for a face that moves as a whole, px: the springs tie each of the 104 live nodes to its previous position with 1e-9 of their
/// stiffness, and a step is a few pixels.
const AT_REST: f64 = 1e-7;

const WIDTH: u32 = 400;
const HEIGHT: u32 = 400;

/// Returns Candide-3 in the middle of the picture, y down.
fn neutral(wireframe: &Wireframe) -> Vec<Point2<f64>> {
    let place = |p: &Point2<f64>| Point2::new(200.0 + p.x * 100.0 / 0.613, 200.0 - p.y * 100.0 / 0.613);
    let mut nodes: Vec<_> = wireframe.frontal().iter().map(place).collect();
    wireframe.place_followers(&mut nodes);
    nodes
}

/// Returns frames that each move by `step` px.
fn shifted(frames: usize, step: Vector2<f64>) -> Vec<Vec<Point2<f64>>> {
    let start = neutral(&Wireframe::candide3());
    (0..frames).map(|m| start.iter().map(|p| p + step * m as f64).collect()).collect()
}

/// Tracks the scripted frames, numbered from 1.
fn track(truth: &[Vec<Point2<f64>>], faults: &[(usize, u16, Fault)], options: &TrackOptions) -> Result<Track, TrackError> {
    let wireframe = Wireframe::candide3();
    let plan = TrackPlan::new(&wireframe, &Tables::candide3());
    let fitted = FittedWireframe {
        model: FrameExpressionModel::new(truth[0].clone()),
        image_from_face: Similarity::identity(),
        correspondences: Vec::new(),
        read: Vec::new(),
        residuals: Vec::new(),
        spreads: None,
        warnings: Vec::new(),
    };
    let picture = image::GrayImage::new(WIDTH, HEIGHT);
    let frames = (1..).take(truth.len()).map(|number| Ok::<_, SequenceError>(Frame::new(number, picture.clone())));
    let mut tracker = Scripted { truth, live: wireframe.live_nodes(), faults, given: 0 };
    track_with(&mut tracker, &wireframe, &plan, &fitted, frames, options, |_| true)
}

/// Returns a node in a frame, both from 0.
fn node(track: &Track, frame: usize, node: usize) -> TrackedNode {
    track.frames[frame].nodes[node]
}

/// Returns the largest distance of a node to its true position in a frame.
fn largest_error(track: &Track, truth: &[Vec<Point2<f64>>], frame: usize) -> f64 {
    let errors = track.frames[frame].nodes.iter().zip(&truth[frame]).map(|(n, p)| (n.position - p).norm());
    errors.fold(0.0, f64::max)
}

#[test]
fn a_face_that_only_moves_is_followed_exactly() {
    let truth = shifted(5, Vector2::new(2.0, -1.0));
    let track = track(&truth, &[], &TrackOptions::default()).unwrap();
    assert_eq!(track.frames.iter().map(|f| f.number).collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
    // If the whole wireframe moves, its springs are at rest.
    let error = largest_error(&track, &truth, 4);
    assert!(error < AT_REST, "{error:e} px");
    for (k, node) in track.frames[4].nodes.iter().enumerate() {
        let in_no_triangle = k == 4 || (35..=39).contains(&k) || (41..=43).contains(&k);
        assert_eq!(node.state, if in_no_triangle { NodeState::Follows } else { NodeState::Tracked });
        assert!(in_no_triangle || node.residual.unwrap() < 1e-9);
    }
}

#[test]
fn a_lost_node_is_placed_by_the_springs_and_tracked_again() {
    let truth = shifted(4, Vector2::new(2.0, -1.0));
    let track = track(&truth, &[(2, 20, Fault::Lost), (2, 53, Fault::LostBack)], &TrackOptions::default()).unwrap();
    assert_eq!(node(&track, 2, 20).state, NodeState::Recovered(LossReason::Klt));
    assert_eq!(node(&track, 2, 53).state, NodeState::Recovered(LossReason::ForwardBackward));
    assert_eq!((node(&track, 2, 20).residual, node(&track, 2, 53).residual), (None, None));
    let error = largest_error(&track, &truth, 2);
    assert!(error < AT_REST, "{error:e} px");
    for k in [20, 53] {
        assert_eq!((node(&track, 1, k).state, node(&track, 3, k).state), (NodeState::Tracked, NodeState::Tracked));
    }
    let error = largest_error(&track, &truth, 3);
    assert!(error < AT_REST, "{error:e} px");
}

#[test]
fn without_deformation_a_lost_node_stays_behind() {
    let truth = shifted(3, Vector2::new(3.0, 4.0));
    let options = TrackOptions { deform: false, ..TrackOptions::default() };
    let track = track(&truth, &[(1, 20, Fault::Lost)], &options).unwrap();
    // From then on, one step of 5 px is missing.
    assert!(((node(&track, 2, 20).position - truth[2][20]).norm() - 5.0).abs() < 1e-9);
    assert!((node(&track, 2, 21).position - truth[2][21]).norm() < 1e-9);
}

#[test]
fn a_node_that_runs_away_is_extreme_and_returns_to_its_face() {
    let truth = shifted(3, Vector2::new(1.0, 1.0));
    let track = track(&truth, &[(1, 31, Fault::Astray(12.0, 0.0))], &TrackOptions::default()).unwrap();
    assert_eq!(node(&track, 1, 31).state, NodeState::Recovered(LossReason::Extreme));
    let error = largest_error(&track, &truth, 1);
    assert!(error < AT_REST, "{error:e} px");
    assert_eq!(node(&track, 2, 31).state, NodeState::Tracked);
}

#[test]
fn a_failed_forward_backward_check_is_measured_and_refused() {
    let truth = shifted(3, Vector2::new(1.0, 0.0));
    // The limit is forward_backward times 100 px.
    let options = TrackOptions { forward_backward: 0.04, ..TrackOptions::default() };
    let faults = [(1, 20, Fault::ReturnsAstray(3.0, 4.0)), (1, 53, Fault::ReturnsAstray(0.0, 3.5))];
    let track = track(&truth, &faults, &options).unwrap();
    let (refused, kept) = (node(&track, 1, 20), node(&track, 1, 53));
    assert_eq!(refused.state, NodeState::Recovered(LossReason::ForwardBackward));
    assert!((refused.residual.unwrap() - 5.0).abs() < 1e-9);
    assert!((refused.position - truth[1][20]).norm() < 1e-9);
    assert_eq!(kept.state, NodeState::Tracked);
    assert!((kept.residual.unwrap() - 3.5).abs() < 1e-9);
}

#[test]
fn nodes_that_leave_the_image_are_placed_by_the_others() {
    // The chin (10) is the lowest node, at 200 + 100 / 0.613 * |y| px; 8 steps move it over the edge, but not the eyes.
    let wireframe = Wireframe::candide3();
    let chin = neutral(&wireframe)[10].y;
    let step = (f64::from(HEIGHT) + 4.0 - chin) / 8.0;
    let truth = shifted(9, Vector2::new(0.0, step));
    let track = track(&truth, &[], &TrackOptions::default()).unwrap();
    assert_eq!(node(&track, 8, 10).state, NodeState::Recovered(LossReason::Outside));
    assert_eq!(node(&track, 8, 20).state, NodeState::Tracked);
    assert!(node(&track, 8, 10).position.y > f64::from(HEIGHT));
    let error = largest_error(&track, &truth, 8);
    assert!(error < AT_REST, "{error:e} px");
}

#[test]
fn with_too_few_nodes_the_face_is_lost() {
    let truth = shifted(3, Vector2::new(1.0, 0.0));
    let wireframe = Wireframe::candide3();
    let all_but = |kept: usize| -> Vec<_> { wireframe.live_nodes().iter().skip(kept).map(|n| (2, n.0, Fault::Lost)).collect() };
    let error = track(&truth, &all_but(3), &TrackOptions::default()).unwrap_err();
    assert!(matches!(error, TrackError::FaceLost { frame: 3, found: 3, live: 104 }), "{error}");
    let track = track(&truth, &all_but(30), &TrackOptions::default()).unwrap();
    let error = largest_error(&track, &truth, 2);
    assert!(error < AT_REST, "{error:e} px");
}

#[test]
fn the_mouth_opens_although_its_inner_lips_coincide() {
    let wireframe = Wireframe::candide3();
    let jaw = wireframe.action_units().iter().find(|unit| unit.name.contains("Jaw drop")).unwrap();
    let scale = 100.0 / 0.613;
    let start = neutral(&wireframe);
    let truth: Vec<Vec<Point2<f64>>> = (0..12)
        .map(|m| {
            let mut nodes = start.clone();
            for (node, offset) in &jaw.offsets {
                nodes[node.index()] += Vector2::new(offset.x, -offset.y) * scale * f64::from(m) / 12.0;
            }
            wireframe.place_followers(&mut nodes);
            nodes
        })
        .collect();
    let track = track(&truth, &[], &TrackOptions::default()).unwrap();
    // Upper and lower inner lip: 87 and 40 in the middle, 81/83 and 82/84 at the sides.
    for (a, b) in [(40, 87), (81, 83), (82, 84)] {
        assert_eq!(start[a], start[b]);
        let gap = (node(&track, 11, a).position.y - node(&track, 11, b).position.y).abs();
        let open = (truth[11][a].y - truth[11][b].y).abs();
        assert!(open > 5.0 && (gap - open).abs() < 0.1 * open, "{a}/{b}: {gap} px open where {open} px are true");
    }
}

#[test]
fn one_frame_is_no_track_and_a_caller_may_stop() {
    let truth = shifted(1, Vector2::zeros());
    let error = track(&truth, &[], &TrackOptions::default()).unwrap_err();
    assert_eq!(error.to_string(), "a track needs at least 2 frames, from neutral to apex; found 1");
}
