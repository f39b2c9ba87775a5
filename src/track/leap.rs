//! Large motion between two frames, as between a neutral photograph and one of the apex, bridged by the locator.
//!
//! KLT assumes small changes from frame to frame. In a large step ([`is_large`]) the face is located in the neutral and in the current frame.
//! The difference of the two readings predicts the motion of the nodes: that of the head ([`Similarity::fit_most`], photographs show heads at
//! different sizes and angles), and what parts of the face move against it. Errors that both readings share cancel. The search starts again
//! from the predicted positions, matches far from them are rejected, and lost nodes are drawn to them ([`LossReason::Jump`]).
//!
//! After such a step the expected errors are larger ([`jump_errors`]): the model of [`super::confidence`] was learned from small steps.

use std::cell::OnceCell;

use image::GrayImage;
use nalgebra::{Point2, Vector2};

use super::{LossReason, NodeState, TrackError, TrackedFrame, ends::Ends, recover::NodeStep};
use crate::{
    fit::{DrivenNode, Pull, Springs},
    geometry::Similarity,
    locate::{LocateOptions, LocatedFace, Locator, known_nodes},
    robust::median,
    sequence::Frame,
    units::NodeId,
    wireframe::Wireframe,
};

/// A step is large if it loses more than this share of the live nodes.
const LOST_SHARE: f64 = 0.2;
/// The same for a step that is also fast: one in ten of the nodes that are not lost goes further than [`JUMP`].
const FAST_LOST_SHARE: f64 = 0.1;
/// Largest distance of a match from the prediction, over the eye distance of the neutral face; a match further away is lost.
pub const FAR: f64 = 0.03;
/// Force that draws a lost node to its predicted position, in units of a spring's stiffness.
pub const PREDICTED_FORCE: f64 = 30.0;
/// Largest median expected error of a reading that is used, over the eye distance.
const LARGEST_ERROR: f64 = 0.06;
/// Share of the points that moves with the head alone.
const HEAD_SHARE: f64 = 0.6;
/// Force of a located node with an expected error of [`COMMON_ERROR`] over the eye distance, in units of a spring's stiffness.
const FORCE: f64 = 20.0;
const COMMON_ERROR: f64 = 0.02;

/// The neutral frame, kept to locate the face in it in a large step.
pub struct Leap {
    neutral: Frame,
    nodes: Vec<Point2<f64>>,
    /// The face in the neutral frame, if it is there; located when it is first needed.
    reading: OnceCell<Option<LocatedFace>>,
}

impl Leap {
    /// Keeps the neutral frame and its nodes; nothing is located yet.
    pub fn new(neutral: &Frame, nodes: &[Point2<f64>]) -> Self {
        Self { neutral: neutral.clone(), nodes: nodes.to_vec(), reading: OnceCell::new() }
    }

    /// The neutral frame's picture.
    pub fn image(&self) -> &GrayImage {
        self.neutral.image()
    }

    /// The nodes of the neutral frame, px.
    pub fn nodes(&self) -> &[Point2<f64>] {
        &self.nodes
    }

    /// The face in the neutral frame; `None` if it is not there or its expected error is too large.
    pub fn face(&self) -> Option<&LocatedFace> {
        let located = || Locator::shipped().ok().and_then(|locator| read(locator, &self.neutral, &self.nodes));
        self.reading.get_or_init(located).as_ref()
    }

    /// What is seen in the neutral frame and in another one.
    pub fn ends(&self, frame: &Frame, tracked: &TrackedFrame) -> Ends {
        let nodes: Vec<Point2<f64>> = tracked.nodes.iter().map(|node| node.position).collect();
        Ends::look((self.image(), &self.nodes), (frame.image(), &nodes))
    }

    /// Returns the predicted position of every node in a frame, px; `None` if the face cannot be located in both frames.
    ///
    /// # Errors
    /// [`TrackError::Springs`] when the springs have no equilibrium.
    pub fn predict(
        &self,
        frame: &Frame,
        previous: &[Point2<f64>],
        wireframe: &Wireframe,
        springs: &Springs,
    ) -> Result<Option<Vec<Point2<f64>>>, TrackError> {
        let Ok(locator) = Locator::shipped() else { return Ok(None) };
        let Some(neutral) = self.face() else { return Ok(None) };
        // Only two photographs may show the face in different places; in a film it would be another face, after a cut.
        let is_first = previous == self.nodes;
        let anew = || is_first.then(|| nearest_face(locator, frame, neutral)).flatten();
        let Some(current) = read(locator, frame, previous).or_else(anew) else { return Ok(None) };
        let places = |face: &LocatedFace| face.points.iter().map(|point| point.position).collect::<Vec<_>>();
        let Ok(head) = Similarity::fit_most(&places(neutral), &places(&current), HEAD_SHARE) else { return Ok(None) };
        let carried: Vec<Point2<f64>> = self.nodes.iter().map(|node| head.apply(node)).collect();
        let unit = head.scale * neutral.eye_distance;
        let targets: Vec<DrivenNode> = neutral
            .points
            .iter()
            .zip(&current.points)
            .filter(|(a, _)| wireframe.live_nodes().contains(&a.node))
            .map(|(a, b)| {
                let moved: Vector2<f64> = b.position - head.apply(&a.position);
                let error = b.expected_error.max(0.5 * COMMON_ERROR * unit) / (COMMON_ERROR * unit);
                DrivenNode { node: a.node, position: carried[a.node.index()] + moved, pull: Pull::Force(FORCE / error.powi(2)) }
            })
            .collect();
        Ok(Some(springs.deform(wireframe, &carried, &targets)?))
    }
}

/// Returns the trusted face of a frame that is nearest to another one in place and size; `None` if there is none.
fn nearest_face(locator: &Locator, frame: &Frame, known: &LocatedFace) -> Option<LocatedFace> {
    let centre = |face: &LocatedFace| {
        let sum: Vector2<f64> = face.points.iter().map(|point| point.position.coords).sum();
        sum / face.points.len().max(1) as f64
    };
    let way = |face: &LocatedFace| {
        (centre(face) - centre(known)).norm() / known.eye_distance + (face.eye_distance / known.eye_distance).ln().abs()
    };
    let faces = locator.locate(frame.image(), &LocateOptions::default());
    faces.into_iter().filter(LocatedFace::trusted).min_by(|a, b| way(a).total_cmp(&way(b)))
}

/// Locates the face near nodes; `None` if it is not there or its expected error is too large.
fn read(locator: &Locator, frame: &Frame, nodes: &[Point2<f64>]) -> Option<LocatedFace> {
    locator.read_near(frame.image(), &known_nodes(nodes)).filter(|face| face.expected_error() <= LARGEST_ERROR)
}

/// Step, over the eye distance, from which motion is a jump, and the share of what goes beyond it that a node is expected to be off.
const JUMP: (f64, f64) = (0.03, 0.5);
/// Expected error of a node that the located face placed, over the eye distance: without motion, its growth with the node's step, and the
/// largest. Chosen on pairs of pictures; see docs/evaluation.md, two pictures alone.
const LOCATED: (f64, f64, f64) = (0.016, 0.2, 0.04);
/// Quantile of the steps of all nodes that stands for the fastest ones, and for a lost node's step.
const FAST_QUANTILE: f64 = 0.9;

/// Whether a step is too large for KLT: it loses many nodes, or it is fast and loses some. Of 588 steps of 50 sequences one is large. A blink
/// loses the nodes of the eyes, a quarter of all, and few others: it is no large step, and a face with shut eyes is not located well enough
/// to place its brows. `is_eye` says which nodes belong to the eyes.
pub fn is_large(steps: &[NodeStep], unit: f64, is_eye: impl Fn(NodeId) -> bool) -> bool {
    let lost_of = |steps: &mut dyn Iterator<Item = &NodeStep>| {
        let (mut lost, mut all) = (0.0, 0.0);
        for step in steps {
            all += 1.0;
            lost += f64::from(u8::from(step.loss.is_some()));
        }
        (lost, all)
    };
    let (lost_elsewhere, elsewhere) = lost_of(&mut steps.iter().filter(|step| !is_eye(step.node)));
    if lost_elsewhere <= FAST_LOST_SHARE * elsewhere {
        return false;
    }
    let (lost, all) = lost_of(&mut steps.iter());
    let moved: Vec<Vector2<f64>> = steps.iter().filter(|s| s.loss.is_none()).map(|s| s.displacement).collect();
    let is_fast = || fastest(&against_head(&moved)) > JUMP.0 * unit;
    lost > LOST_SHARE * all || (lost > FAST_LOST_SHARE * all && is_fast())
}

/// Returns the lengths of steps relative to their median, which is the step of the head.
fn against_head(steps: &[Vector2<f64>]) -> Vec<f64> {
    let (mut x, mut y): (Vec<f64>, Vec<f64>) = steps.iter().map(|s| (s.x, s.y)).unzip();
    let head = Vector2::new(median(&mut x).unwrap_or(0.0), median(&mut y).unwrap_or(0.0));
    steps.iter().map(|s| (s - head).norm()).collect()
}

/// Returns the lengths of steps between two frames relative to the head's, which may also turn and change its size.
fn against_turning_head(from: &[Point2<f64>], to: &[Point2<f64>]) -> Vec<f64> {
    match Similarity::fit_most(from, to, HEAD_SHARE) {
        Ok(head) => from.iter().zip(to).map(|(a, b)| (b - head.apply(a)).norm()).collect(),
        Err(_) => from.iter().zip(to).map(|(a, b)| (b - a).norm()).collect(),
    }
}

/// Returns the length that one step in ten exceeds; zero for no steps.
fn fastest(lengths: &[f64]) -> f64 {
    let mut sorted = lengths.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get((FAST_QUANTILE * sorted.len() as f64) as usize).copied().unwrap_or(0.0)
}

/// Returns the additional error that jumps lead to, `[frame][index among the live nodes]`, px.
///
/// A step is the motion of a node between two frames against that of the head. A tracked node is expected to be off by a share of
/// the part of its step beyond a limit; a lost node by the same share of the step of the fastest tenth of the nodes, unless the located
/// face placed it: then by an error that grows with its step to a limit. Errors of several steps add as squares. A corrected node has none. Only steps in which the located face placed a node, or that lose many nodes, count:
/// where KLT follows, fast motion is not a jump.
pub fn jump_errors(frames: &[TrackedFrame], live: &[NodeId], unit: f64) -> Vec<Vec<f64>> {
    let mut squares = vec![0.0_f64; live.len()];
    let mut out = vec![squares.clone()];
    for pair in frames.windows(2) {
        let node = |frame: usize, id: &NodeId| pair[frame].nodes.get(id.index());
        let places = |frame: usize| -> Vec<Point2<f64>> {
            live.iter().map(|id| node(frame, id).map_or_else(Point2::origin, |node| node.position)).collect()
        };
        let losses = || live.iter().filter_map(|id| node(1, id)?.state.loss());
        let is_jump = losses().any(|loss| loss == LossReason::Jump) || losses().count() as f64 > LOST_SHARE * live.len() as f64;
        if !is_jump {
            out.push(squares.iter().map(|s| s.sqrt()).collect());
            continue;
        }
        let lengths = against_turning_head(&places(0), &places(1));
        let fast = fastest(&lengths);
        for ((square, id), &length) in squares.iter_mut().zip(live).zip(&lengths) {
            let beyond = |length: f64| JUMP.1 * (length - JUMP.0 * unit).max(0.0);
            let error = match node(1, id).map(|n| n.state) {
                Some(NodeState::Corrected) => {
                    *square = 0.0;
                    continue;
                }
                Some(NodeState::Recovered(LossReason::Jump)) => (LOCATED.0 * unit + LOCATED.1 * length).min(LOCATED.2 * unit),
                Some(NodeState::Recovered(_)) => beyond(fast.max(length)),
                _ => beyond(length),
            };
            *square += error.powi(2);
        }
        out.push(squares.iter().map(|s| s.sqrt()).collect());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        correspondence::read_correspondences,
        fit::{FitOptions, Fitter},
        sequence::{SequenceError, read_frame},
        track::{Found, PointTracker, Probe, Slot, TrackOptions, TrackPlan, TrackedNode, track_with},
        wireframe::Face,
    };

    /// Loses one node in three, and all that are not searched for where they were.
    struct Stubborn;

    impl PointTracker for Stubborn {
        fn advance(&mut self, _: &Frame) -> Result<(), TrackError> {
            Ok(())
        }

        fn find(&mut self, _: Slot, _: Slot, _: u32, _: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError> {
            let find = |(k, probe): (usize, &Probe)| {
                let is_found = k % 3 != 0 && probe.guess == probe.position;
                if is_found { Found::At { position: probe.position, difference: 0.0 } } else { Found::Lost }
            };
            Ok(probes.iter().enumerate().map(find).collect())
        }
    }

    #[test]
    fn a_prediction_from_which_less_is_found_is_not_used() {
        let Face { wireframe, tables } = Face::candide3();
        let fixture = |name: &str| std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/portraits").join(name);
        let marks = read_correspondences(&fixture("P01_correspondences.csv"), &tables, wireframe.node_count()).unwrap();
        let fitted = Fitter::new(&wireframe, FitOptions::default()).fit(&wireframe, &marks).unwrap();
        let frame = read_frame(&fixture("P01.jpg")).unwrap();
        // The same face, further to the right.
        let shifted =
            GrayImage::from_fn(frame.size().width, frame.size().height, |x, y| *frame.image().get_pixel(x.max(3) - 3, y));
        let frames: [Result<Frame, SequenceError>; 2] = [Ok(frame), Ok(Frame::new(2, shifted))];
        let plan = TrackPlan::new(&wireframe, &tables);
        let options = TrackOptions::default();
        let track = track_with(&mut Stubborn, &wireframe, &plan, &fitted, frames, &options, |_| true).unwrap();
        let losses = || track.frames[1].nodes.iter().filter_map(|node| node.state.loss());
        assert!((30..40).contains(&losses().count()) && losses().all(|loss| loss == LossReason::Klt));
    }

    #[test]
    fn two_photographs_may_show_the_face_in_different_places_and_a_film_may_not() {
        let Face { wireframe, tables } = Face::candide3();
        let fixture = |name: &str| std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/portraits").join(name);
        let marks = read_correspondences(&fixture("P01_correspondences.csv"), &tables, wireframe.node_count()).unwrap();
        let fitted = Fitter::new(&wireframe, FitOptions::default()).fit(&wireframe, &marks).unwrap();
        let frame = read_frame(&fixture("P01.jpg")).unwrap();
        // Almost an eye distance to the right.
        let shifted =
            GrayImage::from_fn(frame.size().width, frame.size().height, |x, y| *frame.image().get_pixel(x.max(90) - 90, y));
        let tracked = |images: &[&GrayImage]| {
            let frames = images.iter().zip(1..).map(|(image, number)| Ok(Frame::new(number, (*image).clone())));
            let plan = TrackPlan::new(&wireframe, &tables);
            let mut tracker = crate::track::Klt::new(4, 31);
            let frames: Vec<Result<Frame, SequenceError>> = frames.collect();
            track_with(&mut tracker, &wireframe, &plan, &fitted, frames, &TrackOptions::default(), |_| true)
        };
        let track = tracked(&[frame.image(), &shifted]).unwrap();
        let pairs = track.frames[0].nodes.iter().zip(&track.frames[1].nodes);
        let off = pairs.map(|(a, b)| (b.position - a.position - Vector2::new(90.0, 0.0)).norm()).sum::<f64>() / 113.0;
        assert!(off < 1.0, "{off} px");
        let cut = tracked(&[frame.image(), frame.image(), &shifted]);
        assert!(matches!(cut, Err(TrackError::FaceLost { frame: 3, .. })));
    }

    /// Ten nodes; the first goes `way` px to the right in the second frame, the others rest; the last `lost` ones are lost there, and
    /// the second has `state`.
    fn frames(way: f64, lost: u16, state: NodeState) -> Vec<TrackedFrame> {
        let state_of = |number: u32, k: u16| match (number, k) {
            (2, 1) => state,
            (2, k) if k >= 10 - lost => NodeState::Recovered(LossReason::Klt),
            _ => NodeState::Tracked,
        };
        let x = |number: u32, k: u16| 10.0 * f64::from(k) + if k == 0 && number > 1 { way } else { 0.0 };
        let node = |number: u32, k: u16| TrackedNode::new(Point2::new(x(number, k), 0.0), state_of(number, k), None);
        (1..=3).map(|number| TrackedFrame { number, nodes: (0..10).map(|k| node(number, k)).collect() }).collect()
    }

    #[test]
    fn a_step_is_large_that_loses_many_nodes_or_some_and_is_fast() {
        // Of 20 nodes `lost` are lost and `fast` others go 4 px, the rest 1 px.
        let is_large = |lost: usize, fast: usize| {
            let step = |k: usize| NodeStep {
                node: NodeId(k as u16),
                displacement: Vector2::new(if k < fast { 4.1 } else { 1.0 }, 0.0),
                predicted: false,
                residual: None,
                difference: 0.0,
                loss: (k >= 20 - lost).then_some(LossReason::Klt),
            };
            let steps: Vec<NodeStep> = (0..20).map(step).collect();
            // The last six nodes are those of the eyes, or none are.
            [is_large(&steps, 100.0, |_| false), is_large(&steps, 100.0, |node| node.0 >= 14)]
        };
        // The eyes are 100 px apart: against the head's 1 px, 3.1 px are more than 3 %.
        assert_eq!([is_large(4, 0), is_large(5, 0)], [[false; 2], [true, false]]);
        assert_eq!([is_large(3, 0), is_large(3, 2), is_large(2, 2)], [[false; 2], [true, false], [false; 2]]);
        // Both eyes alone are a blink, and so are they with one other node in fourteen; with two it is more.
        assert_eq!([is_large(6, 2), is_large(7, 2), is_large(8, 2)], [[true, false], [true, false], [true, true]]);
    }

    #[test]
    fn a_step_in_which_the_face_was_located_counts_whatever_it_loses() {
        let live: Vec<NodeId> = (0..10).map(NodeId).collect();
        // The second node rests, and the first goes as far as a tenth or a fifth of the eye distance.
        let jump = NodeState::Recovered(LossReason::Jump);
        let errors = jump_errors(&frames(13.0, 1, jump), &live, 100.0);
        assert_eq!(errors[1][..2], [5.0, 1.6]);
        let mut moved = frames(13.0, 1, NodeState::Tracked);
        for (way, expected) in [(10.0, 3.6), (20.0, 4.0)] {
            moved[1].nodes[0] = TrackedNode::new(Point2::new(way, 0.0), jump, None);
            approx::assert_relative_eq!(jump_errors(&moved, &live, 100.0)[1][0], expected, epsilon = 1e-9);
        }
    }

    #[test]
    fn what_goes_beyond_a_limit_in_a_step_that_loses_many_nodes_counts_by_half() {
        let live: Vec<NodeId> = (0..10).map(NodeId).collect();
        let of = |way: f64, lost: u16, state: NodeState| jump_errors(&frames(way, lost, state), &live, 100.0);
        // The eyes are 100 px apart: half of what goes beyond 3 px. A lost node may have gone as far as the fastest tenth.
        let errors = of(13.0, 3, NodeState::Tracked);
        assert_eq!((errors[0][0], errors[1][0], errors[2][0]), (0.0, 5.0, 5.0));
        assert_eq!((errors[1][1], errors[1][9], errors[2][9]), (0.0, 5.0, 5.0));
        for none in [of(2.9, 3, NodeState::Tracked), of(13.0, 2, NodeState::Tracked)] {
            assert!(none.iter().flatten().all(|&e| e == 0.0));
        }
        // A corrected node is where it was put.
        let lost = of(13.0, 3, NodeState::Recovered(LossReason::Klt));
        let set = of(13.0, 3, NodeState::Corrected);
        assert_eq!((lost[1][1], set[1][1]), (5.0, 0.0));
    }
}
