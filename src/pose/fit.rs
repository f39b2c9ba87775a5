//! Fits the person's neutral head, and pose and expression in every frame, together.
//!
//! The unknowns are those of [`HeadModel`]: coefficients of identity and the person's own offset of every node, and a pose and coefficients
//! of expression in every frame; the neutral frame has no expression. The observations are all nodes that the tracker placed, with a
//! standard deviation by state. The neutral frame gives a first head, and this the first poses; from there all are fitted together
//! ([`descend`]). Frames seen from other sides thus improve the depth.

use std::iter;

use nalgebra::{DVector, Point2, Vector2, Vector3};

use super::{
    HEAD_ES, HeadModel, HeadPose,
    frontal::visibility,
    joint::{Head, Problem, Unknowns, descend},
    observe::{FEWEST_SEEN, Frame, Own, mark_shifts, observe, own_offsets, rough_pose},
    solve::{Directions, Limit, Matrix, Seen, Solved, shape_with, solve},
};
use crate::{
    fit::SpringError,
    geometry::SimilarityError,
    model::ModelError,
    track::{NodeState, TrackedFrame},
    units::NodeId,
    wireframe::Tables,
};

/// Number of evenly spread frames that the head is fitted to. With five, six and nine, heads from landmarks have a mean error of pose of
/// 0.49, 0.50 and 0.53 degrees; more frames take longer, and of those from images more are better, but hardly.
const HEAD_FRAMES: usize = 6;
/// Steps of the first head and frames end below this change.
const FIRST_AT_REST: f64 = 0.003;
/// Steps of a frame end below this change once the head is known: radians, logarithms, standard deviations.
const FRAME_AT_REST: f64 = 1e-5;
/// Largest number of steps of a frame once the head is known.
const FRAME_STEPS: usize = 20;
/// Visibility below which a node is not used.
const HIDDEN: f64 = 0.05;
/// Median distance between observed and explained nodes, over the eye distance, beyond which the fit is rejected.
const UNEXPLAINED: f64 = 0.1;

/// Reason why a track has no pose.
///
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let track = grimace::track::read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// use grimace::pose::{HeadFitter, PoseError};
///
/// // `track` holds the ten frames of a smile.
/// let mut cut = track.clone();
/// cut[0].nodes.truncate(10);
/// let error = HeadFitter::new(&wireframe, &tables).fit(&tables, &cut, &[]).unwrap_err();
/// assert_eq!(error, PoseError::NodeCount { frame: 1, found: 10, expected: 113 });
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// The points that expressions do not move do not determine a placement.
    #[error("the head's pose is not determined: {0}")]
    Placement(#[from] SimilarityError),
    /// Too few nodes.
    #[error("frame {frame}: only {found} nodes were tracked; a pose needs at least {FEWEST_SEEN}")]
    TooFewNodes {
        /// Frame number.
        frame: u32,
        /// Nodes tracked.
        found: usize,
    },
    /// No head fits the nodes.
    #[error("frame {frame}: no pose of a head explains the nodes; check that the marks are those of a face")]
    NoHead {
        /// Frame number.
        frame: u32,
    },
    /// The springs have no equilibrium.
    #[error(transparent)]
    Springs(#[from] SpringError),
    /// The frames do not form a model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Too few frames for a head.
    #[error("a head needs a track of at least 2 frames, from neutral to apex, found {found}")]
    TooFewFrames {
        /// Number of frames.
        found: usize,
    },
    /// A head fit of another track.
    #[error(
        "the head fit has {found} frames, but the track has {expected}; fit or follow the head in all frames of the track first"
    )]
    FrameCount {
        /// Frames of the head fit.
        found: usize,
        /// Frames of the track.
        expected: usize,
    },
    /// A head fit or wireframe of another head model.
    #[error("the {what} has {found} nodes, but the head model has {expected}; use the wireframe of the head model")]
    OtherWireframe {
        /// The head fit, or the wireframe.
        what: &'static str,
        /// Its number of nodes.
        found: usize,
        /// Nodes of the model.
        expected: usize,
    },
    /// A mark at a node that the head model does not have.
    #[error("there is a mark of node {node}, but the head model has {count} nodes (0 to {})", count.saturating_sub(1))]
    NoSuchNode {
        /// The node.
        node: NodeId,
        /// Nodes of the model.
        count: usize,
    },
    /// The track has another wireframe.
    #[error("frame {frame} has {found} nodes, but the head model has {expected}")]
    NodeCount {
        /// Frame number.
        frame: u32,
        /// Nodes of the frame.
        found: usize,
        /// Nodes of the model.
        expected: usize,
    },
}

/// A person's head, and its pose and expression in every frame.
///
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let track = grimace::track::read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// use grimace::pose::HeadFitter;
///
/// // `track` holds the ten frames of a smile.
/// let fit = HeadFitter::new(&wireframe, &tables).fit(&tables, &track, &[])?;
/// assert_eq!((fit.poses.len(), fit.neutral.len()), (10, 113));
/// assert!(fit.failures.iter().all(Option::is_none) && fit.residuals.iter().all(|px| *px < 1.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct HeadFit {
    /// The neutral head, N nodes, model units, face axes, from the middle of the head.
    pub neutral: Vec<Vector3<f64>>,
    /// Pose in every frame; for a frame of [`HeadFit::failures`], the last pose before it.
    pub poses: Vec<HeadPose>,
    /// Head with its expression in every frame.
    pub shapes: Vec<Vec<Vector3<f64>>>,
    /// Median distance between observed and explained nodes in every frame, px.
    pub residuals: Vec<f64>,
    /// Reason why a frame has no pose; `None` for a frame with a pose. The neutral frame always has one.
    pub failures: Vec<Option<PoseError>>,
    /// Offset from every node to the position of its mark, px, frame by frame.
    pub(super) mark_shifts: Vec<Vec<Vector2<f64>>>,
}

impl HeadFit {
    /// Returns the offset from a node to the position of its mark, px, in the frame of an index; zero for nodes without a mark.
    pub fn mark_shift(&self, frame: usize, node: usize) -> Vector2<f64> {
        self.mark_shifts.get(frame).and_then(|shifts| shifts.get(node)).copied().unwrap_or_else(Vector2::zeros)
    }
}

/// Checks that a track and marks are over the nodes of a head model.
fn check_input(model: &HeadModel, track: &[TrackedFrame], marks: &[(NodeId, Point2<f64>)]) -> Result<(), PoseError> {
    let count = model.node_count();
    if let Some(odd) = track.iter().find(|frame| frame.nodes.len() != count) {
        return Err(PoseError::NodeCount { frame: odd.number, found: odd.nodes.len(), expected: count });
    }
    match marks.iter().find(|(node, _)| node.index() >= count) {
        Some(&(node, _)) => Err(PoseError::NoSuchNode { node, count }),
        None if track.is_empty() => Err(PoseError::TooFewFrames { found: 0 }),
        None => Ok(()),
    }
}

/// Checks that a head fit is one of a head model, and has at least the frames of a track.
pub(super) fn check_fit(model: &HeadModel, fit: &HeadFit, track: &[TrackedFrame]) -> Result<(), PoseError> {
    check_input(model, track, &[])?;
    let (found, expected) = (fit.poses.len().min(fit.shapes.len()), track.len());
    if found < expected {
        return Err(PoseError::FrameCount { found, expected });
    }
    let count = model.node_count();
    match fit.shapes.iter().chain([&fit.neutral]).find(|shape| shape.len() != count) {
        Some(odd) => Err(PoseError::OtherWireframe { what: "head fit", found: odd.len(), expected: count }),
        None => Ok(()),
    }
}

/// Fits a head to tracked frames, the neutral one first. `marks` are those of the neutral frame: where a mark differs from its node, the
/// mark determines the head.
///
/// A later frame without a pose does not fail the fit: [`HeadFit::failures`] gives the reason.
///
/// # Errors
/// [`PoseError`] for too few frames, another wireframe, a mark that it lacks, and for a neutral frame with too few nodes or with
/// nodes that no head explains.
pub fn fit_head(
    model: &HeadModel,
    tables: &Tables,
    track: &[TrackedFrame],
    marks: &[(NodeId, Point2<f64>)],
) -> Result<HeadFit, PoseError> {
    check_input(model, track, marks)?;
    let Some(neutral) = track.first() else { return Err(PoseError::TooFewFrames { found: 0 }) };
    let shifts = mark_shifts(model, tables, track, marks);
    let mut frames = vec![observe(model, neutral, &shifts[0], None)?];
    if !frames[0].is_seen() {
        return Err(PoseError::TooFewNodes { frame: frames[0].number, found: frames[0].seen.len() });
    }
    let start = rough_pose(model, tables, neutral)?;
    for (frame, shifts) in track.iter().zip(&shifts).skip(1) {
        frames.push(observe(model, frame, shifts, Some(start.scale))?);
    }
    // A node that no later frame shows only carries the fit's assumption of a frontal face.
    let is_followed: Vec<bool> =
        (0..model.node_count()).map(|k| frames[1..].iter().any(|f| f.seen.iter().any(|s| s.node == k))).collect();
    let is_marked = |k: usize| matches!(neutral.nodes[k].state, NodeState::Marked | NodeState::Corrected);
    frames[0].seen.retain(|s| is_marked(s.node) || is_followed[s.node]);
    let own = own_offsets(model, neutral, start.scale);
    let sequence = Sequence {
        model,
        frames: &frames,
        own: &own,
        start,
        expression: Directions::new(&model.expression, model.node_count()),
        identity: Directions::new(&model.identity, model.node_count()),
    };
    // A single frame has a head only if enough of its nodes are marked.
    let found =
        sequence.head().map_err(|why| if track.len() < 2 { PoseError::TooFewFrames { found: track.len() } } else { why })?;
    let pose = found.views.first().map_or(start, |neutral| neutral.pose);
    let shape = sequence.problem().shape(&found.head);
    Sequence { start: pose, ..sequence }.every_frame(shape, pose, shifts)
}

/// Returns pose and expression of further frames of a known head. `track` is the neutral frame that `known` was fitted with, followed by
/// the frames. The search in the first of them starts at the pose `from`.
///
/// # Errors
/// [`PoseError`] for an empty track, another wireframe, a mark that it lacks, and for a head fit without frames or of another
/// wireframe.
pub fn follow_head(
    model: &HeadModel,
    tables: &Tables,
    (known, from): (&HeadFit, Option<HeadPose>),
    track: &[TrackedFrame],
    marks: &[(NodeId, Point2<f64>)],
) -> Result<HeadFit, PoseError> {
    check_input(model, track, marks)?;
    check_fit(model, known, &track[..track.len().min(1)])?;
    let neutral_pose = *known.poses.first().ok_or(PoseError::FrameCount { found: 0, expected: track.len() })?;
    let shifts = mark_shifts(model, tables, track, marks);
    let mut frames = Vec::with_capacity(track.len());
    for (m, (frame, shifts)) in track.iter().zip(&shifts).enumerate() {
        frames.push(observe(model, frame, shifts, (m > 0).then_some(neutral_pose.scale))?);
    }
    let sequence = Sequence {
        model,
        frames: &frames,
        own: &[],
        start: from.unwrap_or(neutral_pose),
        expression: Directions::new(&model.expression, model.node_count()),
        identity: Directions::none(),
    };
    sequence.every_frame(known.neutral.clone(), neutral_pose, shifts)
}

/// Inputs of a fit of one sequence.
struct Sequence<'a> {
    model: &'a HeadModel,
    frames: &'a [Frame],
    own: &'a [Own],
    /// Pose at which the search for the head starts.
    start: HeadPose,
    expression: Directions,
    identity: Directions,
}

impl Sequence<'_> {
    /// Returns the most probable head, with the frames that it is fitted to. Frames that the head does not explain in the end are left out,
    /// and the fit is repeated.
    fn head(&self) -> Result<Unknowns, PoseError> {
        let Some((first, rest)) = self.frames.split_first() else { return Err(PoseError::NoHead { frame: 0 }) };
        let usable: Vec<&Frame> = rest.iter().filter(|frame| frame.is_seen()).collect();
        let mut chosen: Vec<&Frame> = spread(usable.len(), HEAD_FRAMES).into_iter().map(|k| usable[k]).collect();
        loop {
            let found = self.head_of(first, &mut chosen)?;
            let shape = self.problem().shape(&found.head);
            let explains = |frame: &Frame, solved: &Solved| {
                let shape = shape_with(&shape, &self.model.expression, &solved.coefficients);
                !is_unexplained(residual(&shape, &solved.pose, &frame.seen), &solved.pose)
            };
            let kept: Vec<&Frame> = chosen
                .iter()
                .zip(&found.views[1..])
                .filter(|(frame, solved)| explains(frame, solved))
                .map(|(frame, _)| *frame)
                .collect();
            if kept.len() == chosen.len() {
                return Ok(found);
            }
            chosen = kept;
        }
    }

    fn problem(&self) -> Problem<'_> {
        Problem { model: self.model, identity: &self.identity, expression: &self.expression, own: self.own }
    }

    /// Returns the head of the neutral frame and the chosen frames; removes frames that no pose explains from `chosen`.
    fn head_of(&self, first: &Frame, chosen: &mut Vec<&Frame>) -> Result<Unknowns, PoseError> {
        let problem = self.problem();
        let mut found = self.first_head(first, chosen)?;
        let observe = |found: &Unknowns| {
            let shape = problem.shape(&found.head);
            let visible = chosen.iter().zip(&found.views[1..]).map(|(frame, view)| {
                // A frame that shows too little is ignored in this step.
                Some(self.visible(&shape, frame, &view.pose)).filter(|seen| seen.len() >= FEWEST_SEEN).unwrap_or_default()
            });
            iter::once(first.seen.clone()).chain(visible).collect()
        };
        descend(&problem, &mut found, observe).ok_or(PoseError::NoHead { frame: first.number })?;
        Ok(found)
    }

    /// Returns a first head from the neutral frame, with the person's own offsets treated as noise, and first frames from the previous
    /// ones. Removes frames that no pose explains from `chosen`.
    fn first_head(&self, first: &Frame, chosen: &mut Vec<&Frame>) -> Result<Unknowns, PoseError> {
        let noisy = |s: &Seen| Seen { deviation: s.deviation.hypot(self.own[s.node].deviation), ..*s };
        let seen: Vec<Seen> = first.seen.iter().map(noisy).collect();
        let start = Solved { pose: self.start, coefficients: DVector::zeros(self.model.identity.len()) };
        let limit = Limit { steps: FRAME_STEPS, at_rest: FIRST_AT_REST };
        let solved = solve(&self.model.mean, &self.identity, &seen, start, limit, &mut Matrix::default());
        let solved = solved.ok_or(PoseError::NoHead { frame: first.number })?;
        let head = Head { coefficients: solved.coefficients, own: vec![Vector3::zeros(); self.model.node_count()] };
        let shape = self.problem().shape(&head);
        let mut before = no_expression(self.model, solved.pose);
        let mut views = vec![Solved { pose: solved.pose, coefficients: DVector::zeros(0) }];
        chosen.retain(|frame| {
            let solved = self.solve_frame(&shape, frame, before.clone(), limit, &mut Matrix::default());
            if let Some(solved) = &solved {
                before = solved.clone();
                views.push(solved.clone());
            }
            solved.is_some()
        });
        Ok(Unknowns { head, views })
    }

    /// Returns the observations of a frame that the head does not hide in a pose; those seen nearly edge-on count less.
    fn visible(&self, shape: &[Vector3<f64>], frame: &Frame, pose: &HeadPose) -> Vec<Seen> {
        let visible = visibility(self.model, shape, pose);
        let seen = frame.seen.iter().filter(|s| visible[s.node] > HIDDEN);
        seen.map(|s| Seen { deviation: s.deviation / visible[s.node].sqrt(), ..*s }).collect()
    }

    fn solve_frame(
        &self,
        shape: &[Vector3<f64>],
        frame: &Frame,
        start: Solved,
        limit: Limit,
        matrix: &mut Matrix,
    ) -> Option<Solved> {
        let seen = self.visible(shape, frame, &start.pose);
        if seen.len() < FEWEST_SEEN {
            return None;
        }
        solve(shape, &self.expression, &seen, start, limit, matrix)
    }

    /// Returns pose and expression of every frame.
    fn every_frame(
        &self,
        neutral: Vec<Vector3<f64>>,
        neutral_pose: HeadPose,
        mark_shifts: Vec<Vec<Vector2<f64>>>,
    ) -> Result<HeadFit, PoseError> {
        let Some((first, rest)) = self.frames.split_first() else { return Err(PoseError::NoHead { frame: 0 }) };
        let left = residual(&neutral, &neutral_pose, &first.seen);
        if is_unexplained(left, &neutral_pose) {
            return Err(PoseError::NoHead { frame: first.number });
        }
        let mut fit = HeadFit {
            residuals: vec![left],
            poses: vec![neutral_pose],
            shapes: vec![neutral.clone()],
            failures: vec![None],
            neutral,
            mark_shifts,
        };
        let limit = Limit { steps: FRAME_STEPS, at_rest: FRAME_AT_REST };
        let mut before = no_expression(self.model, self.start);
        let mut matrix = Matrix::default();
        for frame in rest {
            matrix.renew();
            let solve = || self.solve_frame(&fit.neutral, frame, before.clone(), limit, &mut matrix);
            let solved = frame.is_seen().then(solve).flatten();
            let now = solved.as_ref().unwrap_or(&before);
            let shape = shape_with(&fit.neutral, &self.model.expression, &now.coefficients);
            let left = residual(&shape, &now.pose, &frame.seen);
            let failure = if !frame.is_seen() {
                Some(PoseError::TooFewNodes { frame: frame.number, found: frame.seen.len() })
            } else if solved.is_none() || is_unexplained(left, &now.pose) {
                Some(PoseError::NoHead { frame: frame.number })
            } else {
                None
            };
            // A frame that is not explained is no starting point for the next one.
            if let (Some(solved), None) = (solved, &failure) {
                before = solved;
            }
            fit.shapes.push(if failure.is_none() { shape } else { fit.neutral.clone() });
            fit.residuals.push(left);
            fit.poses.push(before.pose);
            fit.failures.push(failure);
        }
        Ok(fit)
    }
}

/// Whether a head with a median residual in px does not explain the nodes.
fn is_unexplained(residual: f64, pose: &HeadPose) -> bool {
    residual > UNEXPLAINED * HEAD_ES * pose.scale
}

fn no_expression(model: &HeadModel, pose: HeadPose) -> Solved {
    Solved { pose, coefficients: DVector::zeros(model.expression.len()) }
}

/// Returns the indices of `count` of `of` frames, evenly spread, including the last.
fn spread(of: usize, count: usize) -> Vec<usize> {
    if of <= count { (0..of).collect() } else { (1..=count).map(|k| k * of / count - 1).collect() }
}

fn residual(shape: &[Vector3<f64>], pose: &HeadPose, seen: &[Seen]) -> f64 {
    let mut distances: Vec<f64> = seen.iter().map(|s| (s.at - pose.image_of(&pose.turned(&shape[s.node]))).norm()).collect();
    crate::robust::median(&mut distances).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{track::read_track, wireframe::Face};

    #[test]
    fn the_pose_does_not_depend_on_the_place_of_the_face() {
        let Face { wireframe, tables } = Face::candide3();
        let model = HeadModel::shipped(&wireframe, &tables);
        let track = read_track("fixtures/simulated/truth/S001_005.csv".as_ref()).unwrap();
        let fit = |shift: Vector2<f64>, noise: f64| {
            let mut track = track.clone();
            for (k, node) in track.iter_mut().flat_map(|frame| &mut frame.nodes).enumerate() {
                node.position += shift + noise * Vector2::new((k as f64).sin(), (1.7 * k as f64).cos());
            }
            fit_head(&model, &tables, &track, &[]).unwrap().poses[0].degrees()
        };
        let [yaw, pitch, _] = fit(Vector2::zeros(), 0.0);
        for (shift, noise, tolerance) in [(Vector2::new(137.31, -11.73), 0.0, 0.01), (Vector2::zeros(), 0.02, 0.1)] {
            let [other_yaw, other_pitch, _] = fit(shift, noise);
            assert!(
                (yaw - other_yaw).abs() < tolerance && (pitch - other_pitch).abs() < tolerance,
                "{yaw} {other_yaw} {pitch} {other_pitch}"
            );
        }
    }
}
