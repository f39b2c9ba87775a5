//! Makes a track from landmarks that another program tracked, instead of from images.
//!
//! The wireframe is fitted to the landmarks of the neutral frame as to marks. Then, in every later frame,
//!
//! 1. the fitted wireframe follows the head: the similarity between the landmarks of the eye corners and the nose, neutral to current;
//! 2. every node with a landmark (one that stands for this node alone, confidence high or medium) is pulled by the remaining displacement of
//!    its landmark, and the springs place all other nodes, as they place lost nodes in [KP, section 3];
//! 3. nodes that move as one (the corners of an iris box) take their mean displacement, and nodes in no triangle follow.
//!
//! Nodes are driven by the displacements of the landmarks, not their positions, so that a landmark slightly beside its node does no harm.
//! Each frame is placed from the neutral one, so errors do not accumulate. Nodes of a lost or missing frame are interpolated linearly
//! between the adjacent frames; their states record it.
//!
//! Forces and springs are the same in every frame, so the deformation is one linear map, computed once for a wireframe.

use nalgebra::{DMatrix, Point2, Vector2};

use super::{LossReason, NodeState, TrackError, TrackedFrame, TrackedNode, check_nodes, neutral_nodes};
use crate::{
    dataset::{LandmarkSelection, LandmarkSequence, correspondences_from_landmarks},
    fit::{Correspondence, DrivenNode, FittedWireframe, Pull, SpringError, Springs},
    geometry::Similarity,
    units::{FeaturePoint, NodeId},
    wireframe::{LandmarkConfidence, Tables, Wireframe},
};

/// Feature points of the pupils; their nodes are the corners of the iris boxes.
const PUPILS: [FeaturePoint; 2] = [FeaturePoint { group: 3, point: 5 }, FeaturePoint { group: 3, point: 6 }];

/// Landmarks that expressions hardly move: the ridge of the nose and the corners of the eyes.
const HEAD_LANDMARKS: [usize; 8] = [27, 28, 29, 30, 36, 39, 42, 45];

/// Precomputed map from landmarks to a wireframe.
///
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let track = grimace::track::read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// # let points = |frame: &grimace::track::TrackedFrame| -> Vec<nalgebra::Point2<f64>> {
/// #     let place = |node: &grimace::units::NodeId| frame.nodes[node.index()].position.coords;
/// #     let sum = |nodes: &[(_, f64)]| nodes.iter().map(|(node, share)| place(node) * *share).sum::<nalgebra::Vector2<f64>>();
/// #     tables.landmarks.iter().map(|row| sum(&row.nodes).into()).collect()
/// # };
/// use grimace::{dataset::{LandmarkFrame, LandmarkSequence}, fit::Fitter, track::LandmarkPlan};
///
/// // `track` holds the ten frames of a smile.
/// let plan = LandmarkPlan::new(&wireframe, &tables, 20.0)?;
/// // `points` gives the 68 landmarks of a frame of `track`.
/// let marks = plan.marks(&points(&track[0]), &tables);
/// let fitted = Fitter::new(&wireframe, Default::default()).fit(&wireframe, &marks)?;
/// let frame = |frame: &grimace::track::TrackedFrame| LandmarkFrame { number: frame.number, points: Some(points(frame)) };
/// let landmarks = LandmarkSequence { frames: track.iter().map(frame).collect() };
/// assert_eq!(plan.track(&wireframe, &fitted, &landmarks)?.len(), 10);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct LandmarkPlan {
    /// Landmark and node of every driven node.
    driven: Vec<(usize, NodeId)>,
    /// Displacement of every live node (rows, in their order) for a unit displacement of every driven node's target (columns).
    response: DMatrix<f64>,
    /// Nodes that move as one.
    rigid: Vec<Vec<NodeId>>,
}

impl LandmarkPlan {
    /// Creates the plan for a wireframe. `force` is the gain of the pull on a driven node over the stiffness of a spring.
    ///
    /// # Errors
    /// [`SpringError`] when no node is driven or the force is not positive.
    pub fn new(wireframe: &Wireframe, tables: &Tables, force: f64) -> Result<Self, SpringError> {
        let live = wireframe.live_nodes();
        let driven: Vec<(usize, NodeId)> = tables
            .landmarks
            .iter()
            .filter(|row| row.confidence != LandmarkConfidence::Low)
            .filter_map(|row| match row.nodes[..] {
                [(node, _)] if live.contains(&node) => Some((usize::from(row.landmark), node)),
                _ => None,
            })
            .collect();
        let springs = Springs::new(wireframe);
        let rest = vec![Point2::origin(); wireframe.node_count()];
        let mut response = DMatrix::zeros(live.len(), driven.len());
        for column in 0..driven.len() {
            let target = |(k, &(_, node)): (usize, &(usize, NodeId))| DrivenNode {
                node,
                position: Point2::new(if k == column { 1.0 } else { 0.0 }, 0.0),
                pull: Pull::Force(force),
            };
            let targets: Vec<_> = driven.iter().enumerate().map(target).collect();
            let moved = springs.deform(wireframe, &rest, &targets)?;
            live.iter().enumerate().for_each(|(row, node)| response[(row, column)] = moved[node.index()].x);
        }
        if driven.is_empty() {
            return Err(SpringError::NoTarget);
        }
        let nodes = |fp: &FeaturePoint| tables.feature_point_nodes(*fp).unwrap_or_default().to_vec();
        let in_range = |nodes: Vec<NodeId>| nodes.into_iter().filter(|n| n.index() < wireframe.node_count()).collect();
        Ok(Self { driven, response, rigid: PUPILS.iter().map(nodes).map(in_range).collect() })
    }

    /// Returns marks for the fit from the landmarks of the neutral frame, one for every driven node.
    pub fn marks(&self, points: &[Point2<f64>], tables: &Tables) -> Vec<Correspondence> {
        let all = correspondences_from_landmarks(points, tables, &LandmarkSelection::HighAndMedium).unwrap_or_default();
        all.into_iter().filter(|mark| self.driven.iter().any(|(_, node)| *node == mark.node)).collect()
    }

    /// Returns the track of a wireframe that was fitted to the neutral frame of the landmarks.
    ///
    /// # Errors
    /// [`TrackError::TooFewFrames`], or [`TrackError::Landmarks`] when the neutral or the apex frame has no landmarks or those of
    /// the head coincide or are not at the positions of a picture; such a frame between them counts as lost.
    /// [`TrackError::OtherWireframe`] for a plan or a fitted wireframe with other nodes.
    pub fn track(
        &self,
        wireframe: &Wireframe,
        fitted: &FittedWireframe,
        landmarks: &LandmarkSequence,
    ) -> Result<Vec<TrackedFrame>, TrackError> {
        let frames = &landmarks.frames;
        let (Some(first), true) = (frames.first(), frames.len() >= 2) else {
            return Err(TrackError::TooFewFrames { found: frames.len() });
        };
        check_nodes("fitted wireframe", fitted.model.node_count(), wireframe.node_count())?;
        check_nodes("plan", self.response.nrows(), wireframe.live_nodes().len())?;
        let without = |frame: u32| TrackError::Landmarks { frame, reason: "it has no landmarks".to_owned() };
        let neutral = first.points.as_deref().ok_or_else(|| without(first.number))?;
        check_places(neutral).map_err(|reason| TrackError::Landmarks { frame: first.number, reason })?;
        let mut track = vec![TrackedFrame { number: first.number, nodes: neutral_nodes(wireframe, fitted) }];
        // Frames without landmarks wait for the next frame that has some.
        let mut waiting: Vec<u32> = Vec::new();
        for frame in &frames[1..] {
            let Some(points) = &frame.points else {
                waiting.push(frame.number);
                continue;
            };
            let placed = self.place(wireframe, fitted.model.nodes(), neutral, points);
            let placed = match placed {
                Ok(placed) => placed,
                // Only the frames that the sequence is measured between are required.
                Err(_) if Some(frame.number) != frames.last().map(|f| f.number) => {
                    waiting.push(frame.number);
                    continue;
                }
                Err(reason) => return Err(TrackError::Landmarks { frame: frame.number, reason }),
            };
            let nodes = self.with_states(wireframe, &placed);
            if let Some(before) = track.last().filter(|_| !waiting.is_empty()).cloned() {
                let after = TrackedFrame { number: frame.number, nodes: nodes.clone() };
                track.extend(waiting.drain(..).map(|number| between(&before, &after, number)));
            }
            track.push(TrackedFrame { number: frame.number, nodes });
        }
        match waiting.last() {
            Some(&number) => Err(without(number)),
            None => Ok(track),
        }
    }

    /// Returns the positions of all nodes in a frame, from the fitted positions and the landmarks of the neutral and the current frame.
    fn place(
        &self,
        wireframe: &Wireframe,
        fitted: &[Point2<f64>],
        neutral: &[Point2<f64>],
        now: &[Point2<f64>],
    ) -> Result<Vec<Point2<f64>>, String> {
        let at = |points: &[Point2<f64>], k: usize| points.get(k).copied().ok_or_else(|| format!("landmark {k} is not there"));
        check_places(now)?;
        let head = |points: &[Point2<f64>]| HEAD_LANDMARKS.iter().map(|&k| at(points, k)).collect::<Result<Vec<_>, _>>();
        let now_from_neutral = Similarity::fit(&head(neutral)?, &head(now)?, None).map_err(|e| e.to_string())?;
        let mut nodes: Vec<Point2<f64>> = fitted.iter().map(|p| now_from_neutral.apply(p)).collect();
        let mut pulls = Vec::with_capacity(self.driven.len());
        for &(landmark, _) in &self.driven {
            pulls.push(at(now, landmark)? - now_from_neutral.apply(&at(neutral, landmark)?));
        }
        let mut displacements = vec![Vector2::zeros(); nodes.len()];
        for (row, node) in wireframe.live_nodes().iter().enumerate() {
            let moved = pulls.iter().enumerate().map(|(column, pull)| pull * self.response[(row, column)]);
            displacements[node.index()] = moved.sum::<Vector2<f64>>();
        }
        for group in &self.rigid {
            let mean = group.iter().map(|n| displacements[n.index()]).sum::<Vector2<f64>>() / group.len().max(1) as f64;
            group.iter().for_each(|n| displacements[n.index()] = mean);
        }
        nodes.iter_mut().zip(&displacements).for_each(|(node, displacement)| *node += displacement);
        wireframe.place_followers(&mut nodes);
        Ok(nodes)
    }

    fn with_states(&self, wireframe: &Wireframe, positions: &[Point2<f64>]) -> Vec<TrackedNode> {
        let follows = |&position| TrackedNode::new(position, NodeState::Follows, None);
        let mut nodes: Vec<_> = positions.iter().map(follows).collect();
        for node in wireframe.live_nodes() {
            nodes[node.index()].state = NodeState::Recovered(LossReason::NoLandmark);
        }
        for (_, node) in &self.driven {
            nodes[node.index()].state = NodeState::Tracked;
        }
        nodes
    }
}

/// Largest coordinate of a landmark, px: no picture is as large.
const MOST_PX: f64 = 1e6;

/// Checks that landmarks are at positions that a picture can have.
fn check_places(points: &[Point2<f64>]) -> Result<(), String> {
    match points.iter().position(|p| !(p.x.abs() <= MOST_PX && p.y.abs() <= MOST_PX)) {
        Some(k) => Err(format!("landmark {k} is at ({}, {}), which is in no picture", points[k].x, points[k].y)),
        None => Ok(()),
    }
}

/// Returns a lost frame: each node interpolated linearly between the adjacent frames.
fn between(before: &TrackedFrame, after: &TrackedFrame, number: u32) -> TrackedFrame {
    let since = |number: u32| f64::from(number) - f64::from(before.number);
    let share = since(number) / since(after.number);
    let node = |(a, b): (&TrackedNode, &TrackedNode)| {
        let state = if b.state == NodeState::Follows { b.state } else { NodeState::Recovered(LossReason::LostFrame) };
        TrackedNode::new(a.position + (b.position - a.position) * share, state, None)
    };
    TrackedFrame { number, nodes: before.nodes.iter().zip(&after.nodes).map(node).collect() }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;
    use crate::{
        dataset::LandmarkFrame,
        fit::{FitOptions, Fitter},
    };

    /// Landmarks of Candide-3's own neutral, 100 px per model unit around (300, 300).
    fn neutral_points(wireframe: &Wireframe, tables: &Tables) -> Vec<Point2<f64>> {
        let frontal = wireframe.frontal();
        let place = |nodes: &[(NodeId, f64)]| {
            let p: Vector2<f64> = nodes.iter().map(|(n, w)| frontal[n.index()].coords * *w).sum();
            Point2::new(300.0 + 100.0 * p.x, 300.0 - 100.0 * p.y)
        };
        tables.landmarks.iter().map(|row| place(&row.nodes)).collect()
    }

    struct Bench {
        wireframe: Wireframe,
        plan: LandmarkPlan,
        fitted: FittedWireframe,
        neutral: Vec<Point2<f64>>,
    }

    fn bench() -> Bench {
        let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
        let plan = LandmarkPlan::new(&wireframe, &tables, 150.0).unwrap();
        let neutral = neutral_points(&wireframe, &tables);
        let marks = plan.marks(&neutral, &tables);
        let fitted = Fitter::new(&wireframe, FitOptions::default()).fit(&wireframe, &marks).unwrap();
        Bench { wireframe, plan, fitted, neutral }
    }

    fn sequence(frames: Vec<(u32, Option<Vec<Point2<f64>>>)>) -> LandmarkSequence {
        LandmarkSequence { frames: frames.into_iter().map(|(number, points)| LandmarkFrame { number, points }).collect() }
    }

    #[test]
    fn driven_nodes_go_with_their_landmarks_and_the_states_say_which() {
        let Bench { wireframe, plan, fitted, neutral } = bench();
        let mut smile = neutral.clone();
        smile[54] += Vector2::new(6.0, -4.0); // left mouth corner, node 31
        let track = plan.track(&wireframe, &fitted, &sequence(vec![(1, Some(neutral)), (2, Some(smile))])).unwrap();
        let (before, after) = (&track[0].nodes, &track[1].nodes);
        let moved = |n: usize| after[n].position - before[n].position;
        // The springs at the corner hold it back by less than a twentieth: gain 150 against about six springs of stiffness 1.
        assert!((moved(31) - Vector2::new(6.0, -4.0)).norm() < 0.05 * 52f64.sqrt(), "{}", moved(31));
        // The other corner has a landmark that did not move.
        assert!(moved(64).norm() < 0.1);
        // Node 27, the cheek, has no landmark and moves part of the way.
        assert!(moved(27).norm() > 0.1 && moved(27).x > 0.0, "{}", moved(27));
        assert_eq!(after[31].state, NodeState::Tracked);
        assert_eq!(after[27].state, NodeState::Recovered(LossReason::NoLandmark));
        assert_eq!(after[4].state, NodeState::Follows);
        // 52 landmarks stand for one node each (counted in candide/ibug68.csv), all of them live.
        assert_eq!(after.iter().filter(|n| n.state == NodeState::Tracked).count(), 52);
        assert!(after.iter().all(|n| n.residual.is_none()));
    }

    #[test]
    fn a_moving_head_moves_every_node_with_it() {
        let Bench { wireframe, plan, fitted, neutral } = bench();
        let turn = Similarity { scale: 1.2, angle: 0.3, translation: Vector2::new(40.0, -15.0) };
        let turned: Vec<_> = neutral.iter().map(|p| turn.apply(p)).collect();
        let track = plan.track(&wireframe, &fitted, &sequence(vec![(7, Some(neutral)), (9, Some(turned))])).unwrap();
        for (a, b) in track[0].nodes.iter().zip(&track[1].nodes) {
            assert_relative_eq!(b.position, turn.apply(&a.position), epsilon = 1e-6);
        }
    }

    #[test]
    fn lost_frames_lie_on_the_line_and_say_so() {
        let Bench { wireframe, plan, fitted, neutral } = bench();
        let shifted: Vec<_> = neutral.iter().map(|p| p + Vector2::new(8.0, 0.0)).collect();
        let frames = vec![(1, Some(neutral.clone())), (2, None), (3, None), (5, Some(shifted))];
        let track = plan.track(&wireframe, &fitted, &sequence(frames)).unwrap();
        assert_eq!(track.iter().map(|f| f.number).collect::<Vec<_>>(), [1, 2, 3, 5]);
        let x = |m: usize| track[m].nodes[31].position.x - track[0].nodes[31].position.x;
        // 8 px over 4 frame numbers.
        assert_relative_eq!(x(1), 2.0, epsilon = 1e-6);
        assert_relative_eq!(x(2), 4.0, epsilon = 1e-6);
        assert_eq!(track[1].nodes[31].state, NodeState::Recovered(LossReason::LostFrame));
        assert_eq!(track[1].nodes[4].state, NodeState::Follows);
        let open_end = plan.track(&wireframe, &fitted, &sequence(vec![(1, Some(neutral)), (2, None)])).unwrap_err();
        assert_eq!(open_end.to_string(), "frame 2: it has no landmarks");
    }

    #[test]
    fn landmarks_that_are_in_no_picture_lose_a_frame_and_end_a_track() {
        let Bench { wireframe, plan, fitted, neutral } = bench();
        for bad in [f64::NAN, 1e300, f64::NEG_INFINITY] {
            let mut odd = neutral.clone();
            odd[60].y = bad;
            let of = |frames: [&Vec<Point2<f64>>; 3]| {
                let frames = (1..).zip(frames).map(|(number, points)| (number, Some(points.clone())));
                plan.track(&wireframe, &fitted, &sequence(frames.collect()))
            };
            let said = format!("landmark 60 is at ({}, {bad}), which is in no picture", neutral[60].x);
            assert_eq!(of([&odd, &neutral, &neutral]).unwrap_err().to_string(), format!("frame 1: {said}"));
            assert_eq!(of([&neutral, &neutral, &odd]).unwrap_err().to_string(), format!("frame 3: {said}"));
            let track = of([&neutral, &odd, &neutral]).unwrap();
            assert_eq!(track[1].nodes[31].state, NodeState::Recovered(LossReason::LostFrame));
        }
        // Frame numbers may descend.
        let frames = vec![(5, Some(neutral.clone())), (4, None), (3, Some(neutral.clone()))];
        assert_eq!(plan.track(&wireframe, &fitted, &sequence(frames)).unwrap().len(), 3);
        let mut small = fitted.clone();
        small.model = crate::model::FrameExpressionModel::new(fitted.model.nodes()[..9].to_vec());
        let error = plan.track(&wireframe, &small, &sequence(vec![(1, Some(neutral.clone())), (2, Some(neutral))])).unwrap_err();
        assert!(matches!(error, TrackError::OtherWireframe { found: 9, expected: 113, .. }), "{error}");
    }

    #[test]
    fn landmarks_in_one_place_are_refused() {
        let Bench { wireframe, plan, fitted, neutral } = bench();
        let collapsed = vec![Point2::new(5.0, 5.0); 68];
        let error = plan.track(&wireframe, &fitted, &sequence(vec![(1, Some(neutral)), (2, Some(collapsed))])).unwrap_err();
        assert!(error.to_string().starts_with("frame 2: a similarity needs points"), "{error}");
    }
}
