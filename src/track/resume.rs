//! Hand-set corrections in a tracked sequence, and tracking again from a corrected frame.
//!
//! A correction is a hard position of one node in one frame after the neutral. It is stored in the track: the node's state in that frame is
//! [`NodeState::Corrected`], so that tracking again respects all corrections. In a corrected frame the springs repeat the step from the
//! previous frame: corrected nodes keep their set position, nodes that KLT tracked are held at the found position, and lost nodes follow.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Point2;

use super::{
    NodeState, PointTracker, Sizes, TrackError, TrackOptions, TrackPlan, TrackedFrame, TrackedNode, align::Template, check_nodes,
    eye_distance_px, leap::Leap, lids::Lids, light::Light, lips::Lips, step::Step, window_px,
};
use crate::{
    fit::{DrivenNode, Pull, Springs},
    sequence::{Frame, SequenceError},
    units::NodeId,
    wireframe::Wireframe,
};

/// Force that holds a tracked node in a corrected frame, over the stiffness of a spring. A corrected neighbour that moves by d moves it by
/// less than d / 20.
const HOLDING_FORCE: f64 = 20.0;

/// Hard positions by frame number and node, px.
pub type Corrections = BTreeMap<u32, BTreeMap<NodeId, Point2<f64>>>;

/// Returns the corrections in a track: nodes set by hand in frames after the neutral.
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

/// Returns the nodes of a frame with hard positions applied.
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
    let is_held = |node: &&NodeId| !hard.contains_key(*node) && nodes.get(node.index()).is_some_and(|n| n.state.loss().is_none());
    let held = wireframe.live_nodes().iter().filter(is_held);
    let held = held.map(|&node| DrivenNode { node, position: rest[node.index()], pull: Pull::Force(HOLDING_FORCE) });
    let set = hard.iter().map(|(&node, &position)| DrivenNode { node, position, pull: Pull::Hard });
    let places = springs.deform(wireframe, &rest, &held.chain(set).collect::<Vec<_>>())?;
    let corrected = |(k, (node, position)): (usize, (&TrackedNode, Point2<f64>))| match hard.get(&NodeId(k as u16)) {
        Some(&position) => TrackedNode::new(position, NodeState::Corrected, None),
        None => TrackedNode { position, ..*node },
    };
    Ok(nodes.iter().zip(places).enumerate().map(corrected).collect())
}

/// Tracks the frames after frame `start` of a track again, from its nodes in the track.
///
/// `frames` are the neutral frame, the frame `start` and the frames to track, in order; frames between the neutral frame and `start` are
/// skipped. Returns only the frames after `start`. Nodes in `corrections` are put at their positions. The window and all lengths come from
/// the neutral frame of the track, as in [`super::track_with`]. Expected errors are not filled in: they depend on the whole track
/// ([`super::expect_errors`]).
///
/// # Errors
/// [`TrackError`] as for tracking, for a `start` that the track does not have, and for corrections that the springs cannot take.
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
    options.check()?;
    plan.check_wireframe(wireframe)?;
    track.iter().try_for_each(|frame| check_nodes("track", frame.nodes.len(), wireframe.node_count()))?;
    let mut sizes = Sizes::default();
    let rest: Vec<_> = track.first().map(|f| f.nodes.iter().map(|n| n.position).collect()).unwrap_or_default();
    let eye_distance = eye_distance_px(&plan.tables, &rest).unwrap_or(100.0);
    let window = window_px(&plan.tables, &rest, options);
    let springs = Springs::new(wireframe);
    let first = track.iter().find(|f| f.number == start);
    let mut previous = first.ok_or(TrackError::TooFewFrames { found: track.len() })?.clone();
    let before_start = track.iter().take_while(|f| f.number != start).last();
    let mut out: Vec<TrackedFrame> = Vec::new();
    let mut template = None;
    let (mut light, mut lids, mut leap): (Option<Light>, Option<Lids>, Option<Leap>) = (None, None, None);
    let mut lips = options.read_lips.then(|| Lips::new(&plan.tables)).flatten();
    // Frame numbers may ascend or descend; only their order in the track matters.
    let passed: BTreeSet<u32> = track.iter().map(|f| f.number).take_while(|&n| n != start).chain([start]).collect();
    for (index, frame) in frames.into_iter().enumerate() {
        let frame = frame?;
        let number = frame.number();
        sizes.add(&frame)?;
        if index == 0 || number == start || !passed.contains(&number) {
            // As in the original tracking, from the nodes of the previous frame.
            let before = if number == start { before_start.unwrap_or(&previous) } else { &previous };
            let even = light.as_ref().and_then(|light| light.undone_at(&frame, wireframe, before));
            tracker.advance(even.as_ref().unwrap_or(&frame))?;
        }
        if index == 0 {
            light = options.even_light.then(|| Light::new(&frame, wireframe.live_nodes(), &rest, window));
            lids = options.read_lids.then(|| Lids::new(&frame, &rest));
            leap = options.locates().then(|| Leap::new(&frame, &rest));
            template = plan.template(wireframe, tracker, &rest, (window, eye_distance), &options.align)?;
            // A corrected node's patch differs from the neutral frame: from there on it is not aligned with that frame.
            let corrected = corrections.iter().filter(|(number, _)| passed.contains(number)).flat_map(|(_, nodes)| nodes.keys());
            corrected.for_each(|node| release(template.as_mut(), lids.as_mut(), lips.as_mut(), wireframe, *node));
        }
        if passed.contains(&number) {
            continue;
        }
        let (template_now, lids_now, frame) = (template.as_mut(), lids.as_ref(), &frame);
        let mut step = Step {
            wireframe,
            plan,
            options,
            template: template_now,
            window,
            eye_distance,
            lids: lids_now,
            lips: lips.as_ref(),
            leap: leap.as_ref(),
            frame,
        };
        let nodes = step.run(tracker, &previous).map_err(|error| sizes.named_in(error))?;
        let nodes = match corrections.get(&number) {
            Some(hard) => {
                hard.keys().for_each(|node| release(template.as_mut(), lids.as_mut(), lips.as_mut(), wireframe, *node));
                correct_nodes(wireframe, &springs, &nodes, hard)?
            }
            None => nodes,
        };
        previous = TrackedFrame { number, nodes };
        out.push(previous.clone());
    }
    Ok(out)
}

fn release(
    template: Option<&mut Template>,
    lids: Option<&mut Lids>,
    lips: Option<&mut Lips>,
    wireframe: &Wireframe,
    node: NodeId,
) {
    if let Some(lips) = lips {
        lips.release(node);
    }
    if let Some(lids) = lids {
        lids.release(node);
    }
    if let (Some(template), Ok(place)) = (template, wireframe.live_nodes().binary_search(&node)) {
        template.release(place);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Vector2};

    use super::*;
    use crate::{
        fit::FittedWireframe,
        geometry::Similarity,
        model::FrameExpressionModel,
        track::{Found, LossReason, Patch, Probe, Slot, Track, track_with},
        wireframe::Tables,
    };

    /// Finds every point 1 px further right in the next frame, and back.
    struct Drift;

    impl PointTracker for Drift {
        fn advance(&mut self, _: &Frame) -> Result<(), TrackError> {
            Ok(())
        }

        fn find(&mut self, from: Slot, _: Slot, _: u32, _: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError> {
            let way = if from == Slot::Current { -1.0 } else { 1.0 };
            let found = |p: &Probe| Found::At { position: p.position + Vector2::new(way, 0.0), difference: 1.0 };
            Ok(probes.iter().map(found).collect())
        }
    }

    /// Finds nothing.
    struct Blind;

    impl PointTracker for Blind {
        fn advance(&mut self, _: &Frame) -> Result<(), TrackError> {
            Ok(())
        }

        fn find(&mut self, _: Slot, _: Slot, _: u32, _: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError> {
            Ok(vec![Found::Lost; probes.len()])
        }
    }

    struct Bench {
        wireframe: Wireframe,
        plan: TrackPlan,
        track: Track,
    }

    fn frames() -> impl Iterator<Item = Result<Frame, SequenceError>> {
        (1..=5).map(|number| Ok(Frame::new(number, image::GrayImage::new(400, 400))))
    }

    /// Five frames of a wireframe of 100 px per unit that drifts by 1 px a frame.
    fn bench() -> Bench {
        let wireframe = Wireframe::candide3();
        let plan = TrackPlan::new(&wireframe, &Tables::candide3());
        let fitted = fitted(&wireframe);
        let track = track_with(&mut Drift, &wireframe, &plan, &fitted, frames(), &TrackOptions::default(), |_| true).unwrap();
        Bench { wireframe, plan, track }
    }

    fn resume(bench: &Bench, track: &[TrackedFrame], start: u32, corrections: &Corrections) -> Vec<TrackedFrame> {
        let options = TrackOptions::default();
        resume_with(&mut Drift, &bench.wireframe, &bench.plan, track, start, corrections, frames(), &options).unwrap()
    }

    /// A point tracker that returns one result, or gradient, too few, a patch without grey values, or a number that is not finite.
    struct Faulty(&'static str);

    impl PointTracker for Faulty {
        fn advance(&mut self, _: &Frame) -> Result<(), TrackError> {
            Ok(())
        }

        fn gradients(&self, _: Slot, _: u32, points: &[Point2<f64>]) -> Result<Vec<Matrix2<f64>>, TrackError> {
            let mut matrices = vec![Matrix2::identity(); points.len() - usize::from(self.0 == "gradients")];
            if self.0 == "infinite gradient" {
                matrices[1].m12 = f64::INFINITY;
            }
            Ok(matrices)
        }

        fn patch(&self, _: Slot, _: &[Point2<f64>], _: f64, _: f64) -> Result<Option<Patch>, TrackError> {
            let mut patch = Patch { left: 10, top: 20, width: 380, height: 380, values: Vec::new() };
            if self.0 == "NaN patch" {
                patch.values = vec![0.0; 380 * 380];
                patch.values[381] = f32::NAN;
            }
            Ok(Some(patch).filter(|_| self.0.ends_with("patch")))
        }

        fn find(&mut self, _: Slot, to: Slot, _: u32, _: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError> {
            let found = |p: &Probe| match self.0 {
                "NaN position" => Found::At { position: Point2::new(p.position.x, f64::NAN), difference: 1.0 },
                "NaN on the way back" if to == Slot::Previous => {
                    Found::At { position: Point2::new(f64::NAN, p.position.y), difference: 1.0 }
                }
                "NaN difference" => Found::At { position: p.position, difference: f64::NAN },
                _ => Found::At { position: p.position, difference: 1.0 },
            };
            Ok(probes.iter().map(found).skip(usize::from(self.0 == "search results")).collect())
        }
    }

    fn fitted(wireframe: &Wireframe) -> FittedWireframe {
        let nodes = wireframe.frontal().iter().map(|p| Point2::new(200.0 + 100.0 * p.x, 200.0 - 100.0 * p.y)).collect();
        FittedWireframe {
            model: FrameExpressionModel::new(nodes),
            image_from_face: Similarity::identity(),
            correspondences: vec![],
            read: Vec::new(),
            residuals: vec![],
            spreads: None,
            warnings: Vec::new(),
        }
    }

    #[test]
    fn a_faulty_answer_of_a_point_tracker_is_named() {
        let wireframe = Wireframe::candide3();
        let plan = TrackPlan::new(&wireframe, &Tables::candide3());
        let (options, fitted) = (TrackOptions::default(), fitted(&wireframe));
        for (what, said) in [
            ("search results", "it returned 103 search results for 104 points"),
            ("gradients", "it returned 103 gradients for 104 points"),
            ("patch", "it returned a patch of 380x380 px with 0 grey values"),
            // The first live node is 0, the top of the skull, at (200, 200 - 100 y).
            ("NaN position", "it returned the position (200.0, NaN) with difference 1 for the point (200.0,"),
            ("NaN on the way back", "it returned the position (NaN, "),
            ("NaN difference", "it returned the position (200.0, "),
            ("infinite gradient", "it returned the gradient matrix (1, inf; 0, 1) for the point ("),
            // Value 381 of 380 columns is the second in the second row.
            ("NaN patch", "it returned a patch with the grey value NaN at (11, 21); all numbers must be finite"),
        ] {
            let error = track_with(&mut Faulty(what), &wireframe, &plan, &fitted, frames(), &options, |_| true).unwrap_err();
            assert!(matches!(&error, TrackError::PointTracker { reason } if reason.starts_with(said)), "{error}");
        }
    }

    #[test]
    fn plans_wireframes_and_frames_of_another_shape_are_an_error() {
        let Bench { wireframe, plan, track } = bench();
        let options = TrackOptions::default();
        let with = |plan: &TrackPlan, fitted: &FittedWireframe, sizes: [(u32, u32); 3]| {
            let frame = |(k, (width, height))| Ok(Frame::new(k, image::GrayImage::new(width, height)));
            track_with(&mut Drift, &wireframe, plan, fitted, (1..).zip(sizes).map(frame), &options, |_| true)
                .unwrap_err()
                .to_string()
        };
        let small = {
            let (vertices, triangles) = (wireframe.vertices()[..3].to_vec(), vec![[NodeId(0), NodeId(1), NodeId(2)]]);
            Wireframe::new(vertices, triangles, vec![], vec![]).unwrap()
        };
        let good = fitted(&wireframe);
        let sizes = [(400, 400); 3];
        assert!(with(&plan, &fitted(&small), sizes).starts_with("the fitted wireframe has 3 nodes, but the wireframe has 113"));
        let other = TrackPlan::new(&small, &Tables::candide3());
        assert!(with(&other, &good, sizes).starts_with("the plan has 3 nodes, but the wireframe has 113"));
        for (sizes, frame) in [([(400, 400), (401, 400), (400, 400)], 2), ([(400, 400), (400, 400), (401, 400)], 3)] {
            let said = format!("frame {frame} has 401x400 pixels, but the first has 400x400");
            assert!(with(&plan, &good, sizes).starts_with(&said));
        }
        assert!(with(&plan, &good, [(0, 0); 3]).starts_with("frame 1 has 0x0 pixels"));
        // Two photographs may be cropped differently.
        let pair = [400, 440].map(|side| Ok(Frame::new(side, image::GrayImage::new(side, side))));
        assert!(track_with(&mut Drift, &wireframe, &plan, &good, pair, &options, |_| true).is_ok());
        let pair = [400, 440].map(|side| Ok(Frame::new(side, image::GrayImage::new(side, side))));
        let lost = track_with(&mut Blind, &wireframe, &plan, &good, pair, &options, |_| true).unwrap_err();
        let said = "frame 440 has 440x440 pixels, but the first has 400x400, and only 0 of 104 nodes could be tracked; the face is lost.";
        assert!(
            matches!(lost, TrackError::FaceLostInOtherSize { found: 0, live: 104, .. }) && lost.to_string().starts_with(said)
        );
        let pair = [1, 2].map(|number| Ok(Frame::new(number, image::GrayImage::new(400, 400))));
        let lost = track_with(&mut Blind, &wireframe, &plan, &good, pair, &options, |_| true).unwrap_err();
        assert!(matches!(lost, TrackError::FaceLost { frame: 2, found: 0, live: 104 }), "{lost}");
        let mut cut = track.frames;
        cut[1].nodes.truncate(5);
        let error = resume_with(&mut Drift, &wireframe, &plan, &cut, 1, &Corrections::new(), frames(), &options).unwrap_err();
        assert!(matches!(error, TrackError::OtherWireframe { what: "track", found: 5, expected: 113 }), "{error}");
    }

    #[test]
    fn resumed_without_corrections_a_track_is_what_it_was() {
        let bench = bench();
        for start in 1..=5 {
            let again = resume(&bench, &bench.track.frames, start, &Corrections::new());
            let mut whole = bench.track.frames.clone();
            // The expected error of a node depends on the whole track.
            whole.iter_mut().flat_map(|f| &mut f.nodes).for_each(|n| n.expected_error = None);
            assert_eq!(again, whole[start as usize..], "from frame {start}");
        }
        let none = resume_with(
            &mut Drift,
            &bench.wireframe,
            &bench.plan,
            &bench.track.frames,
            9,
            &Corrections::new(),
            frames(),
            &TrackOptions::default(),
        );
        assert!(none.is_err(), "there is no frame 9");
    }

    #[test]
    fn a_correction_starts_a_new_path_and_later_ones_are_honoured() {
        let bench = bench();
        let node = NodeId(31);
        let at = |frames: &[TrackedFrame], k: usize| frames[k].nodes[node.index()];
        let start = at(&bench.track.frames, 1).position;
        let hard = |dx: f64| BTreeMap::from([(node, start + Vector2::new(dx, -7.0))]);
        let mut track = bench.track.frames.clone();
        track[1].nodes = correct_nodes(&bench.wireframe, &Springs::new(&bench.wireframe), &track[1].nodes, &hard(5.0)).unwrap();
        track[3].nodes = correct_nodes(&bench.wireframe, &Springs::new(&bench.wireframe), &track[3].nodes, &hard(9.0)).unwrap();
        let corrections = corrections_of(&track);
        assert_eq!(corrections, Corrections::from([(2, hard(5.0)), (4, hard(9.0))]));
        let again = resume(&bench, &track, 2, &corrections);
        assert_eq!(again.iter().map(|f| f.number).collect::<Vec<_>>(), [3, 4, 5]);
        // Frame 3: the corrected position, drifted by 1 px. Frame 4: the set position. Frame 5: drifted from there.
        assert!((at(&again, 0).position - (start + Vector2::new(6.0, -7.0))).norm() < 0.05, "{:?}", at(&again, 0));
        assert_eq!((at(&again, 1).position, at(&again, 1).state), (start + Vector2::new(9.0, -7.0), NodeState::Corrected));
        assert!((at(&again, 2).position - (start + Vector2::new(10.0, -7.0))).norm() < 0.05, "{:?}", at(&again, 2));
    }

    #[test]
    fn tracked_neighbours_hold_and_lost_ones_follow() {
        let bench = bench();
        let (wireframe, springs) = (&bench.wireframe, Springs::new(&bench.wireframe));
        let node = NodeId(31);
        let mut nodes = bench.track.frames[1].nodes.clone();
        let near: Vec<usize> = wireframe
            .edges()
            .iter()
            .filter_map(|&(a, b)| if a == node { Some(b.index()) } else { (b == node).then_some(a.index()) })
            .collect();
        let hard = BTreeMap::from([(node, nodes[node.index()].position + Vector2::new(10.0, 0.0))]);
        let moved = |nodes: &[TrackedNode], k: usize| {
            let corrected = correct_nodes(wireframe, &springs, nodes, &hard).unwrap();
            (corrected[k].position - nodes[k].position).norm()
        };
        // Held by 20, pulled by one spring of 1 over 10 px: less than 10 / 21 px.
        assert!(near.iter().all(|&k| moved(&nodes, k) < 10.0 / 21.0));
        nodes[near[0]].state = NodeState::Recovered(LossReason::Klt);
        assert!(moved(&nodes, near[0]) > 1.0);
        // Without corrections nothing changes.
        assert_eq!(correct_nodes(wireframe, &springs, &nodes, &BTreeMap::new()).unwrap(), nodes);
        // A node in no triangle drives nothing.
        let follower = BTreeMap::from([(NodeId(35), Point2::new(1.0, 1.0))]);
        assert!(matches!(correct_nodes(wireframe, &springs, &nodes, &follower), Err(TrackError::Springs(_))));
    }
}
