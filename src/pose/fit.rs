//! The person's neutral head, and pose and expression in every frame, all together.
//!
//! The unknowns are those of [`HeadModel`]: coefficients of identity and the person's own offset of every node, and in every frame
//! a pose and coefficients of expression; the neutral frame has no expression. What is seen is every node that the tracker placed, with
//! a standard deviation by its state. The neutral frame gives a first head; then frames (pose and expression) and head (given
//! those) are solved in turn, each by linear least squares with robust weights, so that frames seen from other sides improve the depth.

use nalgebra::{DMatrix, DVector, Matrix2x3, Matrix3, Point2, Rotation3, Vector2, Vector3};

use super::{
    CAMERA_DISTANCE, HEAD_ES, HeadModel, HeadPose,
    frontal::visibility,
    mixture::Mixture,
    solve::{Directions, Limit, Seen, Solved, robust, shape_with, solve},
};
use crate::{
    fit::SpringError,
    geometry::{Similarity, SimilarityError},
    model::ModelError,
    normalize::stable_nodes,
    track::{LossReason, NodeState, TrackedFrame},
    units::NodeId,
    wireframe::Tables,
};

/// Standard deviation of a tracked node, model units: 1 % of the eye distance.
const TRACKED: f64 = 0.006;
/// The same of a node that the springs placed.
const RECOVERED: f64 = 0.06;
/// Standard deviation of each person's own offset of a node, beyond the modes: of a node that was marked, and of one that was not.
const OWN_MARKED: f64 = 0.007;
const OWN_FITTED: f64 = 0.04;
/// Frames, evenly spread, that the head is learned from.
const HEAD_FRAMES: usize = 9;
/// Most turns of frames, head and camera.
const TURNS: usize = 120;
/// A turn that changes everything by less is the last: standard deviations, and [`PER_UNIT`] of the rest.
const AT_REST: f64 = 0.003;
/// What counts as one in poses: radians, logarithms of sizes, and distances in the image over the size.
const PER_UNIT: f64 = 0.01;
/// The last step of a frame once the head is known: radians, logarithms, standard deviations.
const FRAME_AT_REST: f64 = 1e-5;
/// Steps of a frame at most, once the head is known.
const FRAME_STEPS: usize = 20;
/// Distances of the camera that a face may be seen from, eye distances.
const DISTANCES: [f64; 2] = [4.0, 60.0];
/// Standard deviation of the logarithm of the distance.
const LOG_DISTANCE_DEVIATION: f64 = 1.0;
/// Fewest nodes seen that give a pose.
const FEWEST_SEEN: usize = 6;
/// Visibility below which a node does not serve.
const HIDDEN: f64 = 0.05;
/// Median distance between seen and explained nodes, over the eye distance, beyond which no head explains them.
const UNEXPLAINED: f64 = 0.1;

/// Why a track has no pose.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// The points that expressions do not move determine no placement.
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
    /// No head explains the nodes.
    #[error("frame {frame}: no pose of a head explains the nodes; are the marks those of a face?")]
    NoHead {
        /// Frame number.
        frame: u32,
    },
    /// The springs have no equilibrium.
    #[error(transparent)]
    Springs(#[from] SpringError),
    /// The frames do not make a model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The track is of another wireframe.
    #[error("frame {frame} has {found} nodes, the head model {expected}")]
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
#[derive(Clone, Debug)]
pub struct HeadFit {
    /// The neutral head, N nodes, model units, face axes, from the middle of the head.
    pub neutral: Vec<Vector3<f64>>,
    /// Pose in every frame; of a frame of [`HeadFit::failures`] the last one before it.
    pub poses: Vec<HeadPose>,
    /// The head with its expression in every frame.
    pub shapes: Vec<Vec<Vector3<f64>>>,
    /// Median distance between seen and explained nodes in every frame, px.
    pub residuals: Vec<f64>,
    /// Why a frame has no pose; `None` for a frame that has one. The neutral frame always has.
    pub failures: Vec<Option<PoseError>>,
    /// From every node to where its mark would be, px, frame by frame.
    pub(super) mark_shifts: Vec<Vec<Vector2<f64>>>,
}

impl HeadFit {
    /// From a node to where its mark would be, px, in the frame of an index; zero for nodes without a mark.
    pub fn mark_shift(&self, frame: usize, node: usize) -> Vector2<f64> {
        self.mark_shifts.get(frame).and_then(|shifts| shifts.get(node)).copied().unwrap_or_else(Vector2::zeros)
    }
}

/// What is seen of one frame.
struct Frame {
    number: u32,
    seen: Vec<Seen>,
}

impl Frame {
    fn is_seen(&self) -> bool {
        self.seen.len() >= FEWEST_SEEN
    }
}

/// Fits a head to tracked frames, the neutral one first. `marks` are those of the neutral frame: where they lie beside their nodes, they
/// and not the nodes say where the head is.
///
/// A later frame without a pose fails for itself alone: [`HeadFit::failures`] says why.
///
/// # Errors
/// [`PoseError`] for another wireframe, and for a neutral frame with too few nodes or nodes that no head explains.
pub fn fit_head(
    model: &HeadModel,
    tables: &Tables,
    track: &[TrackedFrame],
    marks: &[(NodeId, Point2<f64>)],
) -> Result<HeadFit, PoseError> {
    let Some(neutral) = track.first() else { return Err(PoseError::NoHead { frame: 0 }) };
    let shifts = mark_shifts(model, tables, track, marks);
    let mut frames = Vec::with_capacity(track.len());
    for (frame, shifts) in track.iter().zip(&shifts) {
        frames.push(observe(model, frame, shifts)?);
    }
    if !frames[0].is_seen() {
        return Err(PoseError::TooFewNodes { frame: frames[0].number, found: frames[0].seen.len() });
    }
    // A node that no later frame sees says only where the fit expects it from the front.
    let is_followed: Vec<bool> =
        (0..model.node_count()).map(|k| frames[1..].iter().any(|f| f.seen.iter().any(|s| s.node == k))).collect();
    let is_marked = |k: usize| matches!(neutral.nodes[k].state, NodeState::Marked | NodeState::Corrected);
    frames[0].seen.retain(|s| is_marked(s.node) || is_followed[s.node]);
    let own = own_deviations(model, neutral);
    let start = rough_pose(model, tables, neutral)?;
    let sequence = Sequence {
        model,
        frames: &frames,
        own: &own,
        start,
        expression: Directions::new(&model.expression, model.node_count()),
        identity: Directions::new(&model.identity, model.node_count()),
    };
    let found = sequence.head()?;
    let pose = found.neutral_pose;
    Sequence { start: pose, ..sequence }.every_frame(found.head.shape(model), pose, shifts)
}

/// Pose and expression of further frames of a head that is known: `track` is the neutral frame that `known` was fitted with, and the frames.
/// The first of them is looked for from the pose `from`.
///
/// # Errors
/// [`PoseError::NodeCount`] for another wireframe.
pub fn follow_head(
    model: &HeadModel,
    tables: &Tables,
    (known, from): (&HeadFit, Option<HeadPose>),
    track: &[TrackedFrame],
    marks: &[(NodeId, Point2<f64>)],
) -> Result<HeadFit, PoseError> {
    let neutral_pose = *known.poses.first().ok_or(PoseError::NoHead { frame: 0 })?;
    let shifts = mark_shifts(model, tables, track, marks);
    let frames: Vec<Frame> =
        track.iter().zip(&shifts).map(|(frame, shifts)| observe(model, frame, shifts)).collect::<Result<_, _>>()?;
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

/// What is known of a sequence before its head is.
struct Sequence<'a> {
    model: &'a HeadModel,
    frames: &'a [Frame],
    own: &'a [f64],
    /// Where the head, or what is followed of it, is looked for first.
    start: HeadPose,
    expression: Directions,
    identity: Directions,
}

/// All that is sought at once: the head, its pose in the neutral frame, pose and expression of the frames that it is learned from. All
/// poses have the same distance of the camera.
#[derive(Clone)]
struct Found {
    head: Head,
    neutral_pose: HeadPose,
    frames: Vec<Solved>,
}

impl Sequence<'_> {
    /// The most probable head: one step of every frame given head and camera, of the head given the frames, of the camera given both,
    /// again and again.
    ///
    /// That comes to rest slowly, for each can take over from the others, as the depth of a nose from a turn; so each turn begins with a
    /// mixture of the last ones ([`Mixture`]).
    fn head(&self) -> Result<Found, PoseError> {
        let Some((first, rest)) = self.frames.split_first() else { return Err(PoseError::NoHead { frame: 0 }) };
        let usable: Vec<&Frame> = rest.iter().filter(|frame| frame.is_seen()).collect();
        let mut chosen: Vec<&Frame> = spread(usable.len(), HEAD_FRAMES).into_iter().map(|k| usable[k]).collect();
        let mut found = self.first_head(first, &mut chosen)?;
        let mut mixture = Mixture::default();
        for _ in 0..TURNS {
            let before = self.numbers(&found);
            self.turn(&mut found, first, &chosen)?;
            let after = self.numbers(&found);
            if (&after - &before).amax() < AT_REST {
                break;
            }
            self.set_numbers(&mut found, &mixture.next(&before, after));
        }
        Ok(found)
    }

    /// A first head from the neutral frame, where the person's own offsets count as noise, and first frames from the ones before them.
    /// Frames that no pose explains are no longer chosen.
    fn first_head(&self, first: &Frame, chosen: &mut Vec<&Frame>) -> Result<Found, PoseError> {
        let noisy = |s: &Seen| Seen { deviation: s.deviation.hypot(self.own[s.node]), ..*s };
        let seen: Vec<Seen> = first.seen.iter().map(noisy).collect();
        let start = Solved { pose: self.start, coefficients: DVector::zeros(self.model.identity.len()) };
        let limit = Limit { steps: FRAME_STEPS, at_rest: AT_REST };
        let solved = solve(&self.model.mean, &self.identity, &seen, start, limit);
        let solved = solved.ok_or(PoseError::NoHead { frame: first.number })?;
        let head = Head { coefficients: solved.coefficients, own: vec![Vector3::zeros(); self.model.node_count()] };
        let shape = head.shape(self.model);
        let mut before = no_expression(self.model, solved.pose);
        let mut frames = Vec::with_capacity(chosen.len());
        chosen.retain(|frame| {
            let solved = self.solve_frame(&shape, frame, before.clone(), limit);
            if let Some(solved) = &solved {
                before = solved.clone();
                frames.push(solved.clone());
            }
            solved.is_some()
        });
        Ok(Found { head, neutral_pose: solved.pose, frames })
    }

    /// One step of the frames, then one of the head, then one of the camera's distance.
    fn turn(&self, found: &mut Found, first: &Frame, chosen: &[&Frame]) -> Result<(), PoseError> {
        let model = self.model;
        let limit = Limit { steps: 1, at_rest: 0.0 };
        let shape = found.head.shape(model);
        let start = Solved { pose: found.neutral_pose, coefficients: DVector::zeros(0) };
        let solved = solve(&shape, &Directions::none(), &first.seen, start, limit);
        found.neutral_pose = solved.ok_or(PoseError::NoHead { frame: first.number })?.pose;
        let nothing = vec![Vector3::zeros(); model.node_count()];
        let mut views = vec![View { seen: &first.seen, pose: found.neutral_pose, offsets: None }];
        for (frame, solved) in chosen.iter().zip(&mut found.frames) {
            // A frame that no pose explains any more says nothing in this turn.
            let Some(stepped) = self.solve_frame(&shape, frame, solved.clone(), limit) else { continue };
            *solved = stepped;
            let offsets = shape_with(&nothing, &model.expression, &solved.coefficients);
            views.push(View { seen: &frame.seen, pose: solved.pose, offsets: Some(offsets) });
        }
        found.head.improve(model, &views, self.own);
        let log_distance = log_distance_step(&found.head.shape(model), &views);
        found.set_log_distance(found.neutral_pose.distance.ln() + log_distance);
        Ok(())
    }

    /// All that is sought as numbers of like size.
    fn numbers(&self, found: &Found) -> DVector<f64> {
        let mut numbers = found.head.in_deviations(self.own);
        numbers.push(found.neutral_pose.distance.ln() / PER_UNIT / 10.0);
        push_pose(&mut numbers, &found.neutral_pose);
        for frame in &found.frames {
            push_pose(&mut numbers, &frame.pose);
            numbers.extend(frame.coefficients.iter().copied());
        }
        DVector::from_vec(numbers)
    }

    /// The inverse of [`Self::numbers`].
    fn set_numbers(&self, found: &mut Found, numbers: &DVector<f64>) {
        let mut rest = numbers.as_slice().iter().copied();
        found.head.coefficients.iter_mut().zip(&mut rest).for_each(|(c, number)| *c = number);
        for (offset, own) in found.head.own.iter_mut().zip(self.own) {
            offset.iter_mut().zip(&mut rest).for_each(|(o, number)| *o = number * own);
        }
        let log_distance = rest.next().map_or(0.0, |number| number * PER_UNIT * 10.0);
        set_pose(&mut found.neutral_pose, &mut rest);
        for frame in &mut found.frames {
            set_pose(&mut frame.pose, &mut rest);
            frame.coefficients.iter_mut().zip(&mut rest).for_each(|(c, number)| *c = number);
        }
        found.set_log_distance(log_distance);
    }

    fn solve_frame(&self, shape: &[Vector3<f64>], frame: &Frame, start: Solved, limit: Limit) -> Option<Solved> {
        let visible = visibility(self.model, shape, &start.pose);
        let seen: Vec<Seen> = frame
            .seen
            .iter()
            .filter(|s| visible[s.node] > HIDDEN)
            .map(|s| Seen { deviation: s.deviation / visible[s.node].sqrt(), ..*s })
            .collect();
        if seen.len() < FEWEST_SEEN {
            return None;
        }
        solve(shape, &self.expression, &seen, start, limit)
    }

    /// Pose and expression of every frame.
    fn every_frame(
        &self,
        neutral: Vec<Vector3<f64>>,
        neutral_pose: HeadPose,
        mark_shifts: Vec<Vec<Vector2<f64>>>,
    ) -> Result<HeadFit, PoseError> {
        let Some((first, rest)) = self.frames.split_first() else { return Err(PoseError::NoHead { frame: 0 }) };
        let is_unexplained = |residual: f64, pose: &HeadPose| residual > UNEXPLAINED * HEAD_ES * pose.scale;
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
        for frame in rest {
            let solved = frame.is_seen().then(|| self.solve_frame(&fit.neutral, frame, before.clone(), limit)).flatten();
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
            // A frame that is not explained says nothing of the next one either.
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

fn no_expression(model: &HeadModel, pose: HeadPose) -> Solved {
    Solved { pose, coefficients: DVector::zeros(model.expression.len()) }
}

impl Found {
    /// Moves the camera of all frames, within [`DISTANCES`].
    fn set_log_distance(&mut self, log_distance: f64) {
        let [nearest, farthest] = DISTANCES.map(|distance| distance * HEAD_ES);
        let distance = log_distance.exp().clamp(nearest, farthest);
        let frames = self.frames.iter_mut().map(|frame| &mut frame.pose);
        frames.chain([&mut self.neutral_pose]).for_each(|pose| pose.distance = distance);
    }
}

/// By how much the logarithm of the camera's distance is to change, all else given.
fn log_distance_step(shape: &[Vector3<f64>], views: &[View<'_>]) -> f64 {
    let precision = LOG_DISTANCE_DEVIATION.powi(-2);
    let distance = views.first().map_or(CAMERA_DISTANCE * HEAD_ES, |view| view.pose.distance);
    let mut normal = precision;
    let mut right = -precision * (distance / (CAMERA_DISTANCE * HEAD_ES)).ln();
    for view in views {
        for s in view.seen {
            let place = shape[s.node] + view.offsets.as_ref().map_or_else(Vector3::zeros, |o| o[s.node]);
            let turned = view.pose.turned(&place);
            let residual: Vector2<f64> = s.at - view.pose.image_of(&turned);
            let deviation = s.deviation * view.pose.scale;
            let weight = robust(residual.norm() / deviation) / (deviation * deviation);
            let slope = view.pose.distance_slope(&turned);
            normal += weight * slope.norm_squared();
            right += weight * slope.dot(&residual);
        }
    }
    right / normal
}

fn push_pose(numbers: &mut Vec<f64>, pose: &HeadPose) {
    let turn = pose.rotation.scaled_axis();
    numbers.extend(turn.iter().map(|angle| angle / PER_UNIT));
    numbers.push(pose.scale.ln() / PER_UNIT);
    numbers.extend(pose.position.coords.iter().map(|at| at / pose.scale / PER_UNIT));
}

fn set_pose(pose: &mut HeadPose, numbers: &mut impl Iterator<Item = f64>) {
    let mut next = || numbers.next().unwrap_or(0.0) * PER_UNIT;
    pose.rotation = Rotation3::new(Vector3::new(next(), next(), next()));
    pose.scale = next().exp();
    pose.position = Point2::new(next(), next()) * pose.scale;
}

/// How far every node's mark lies from its node, px, in every frame: as in the neutral one, turned and sized with the face.
///
/// A node that was fitted need not lie where its mark is, and moves as the mark would. Nodes without a mark, and those that were
/// corrected by hand, have no shift.
fn mark_shifts(
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

/// `count` of `of` frames, evenly spread, the last among them.
fn spread(of: usize, count: usize) -> Vec<usize> {
    if of <= count { (0..of).collect() } else { (1..=count).map(|k| k * of / count - 1).collect() }
}

fn observe(model: &HeadModel, frame: &TrackedFrame, shifts: &[Vector2<f64>]) -> Result<Frame, PoseError> {
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
            _ => TRACKED,
        };
        if !iris(k) {
            seen.push(Seen { node: k, at: tracked.position + shifts[k], deviation });
        }
    }
    Ok(Frame { number: frame.number, seen })
}

/// Standard deviation of each person's own offset by node.
fn own_deviations(model: &HeadModel, neutral: &TrackedFrame) -> Vec<f64> {
    let own = |k: usize| match neutral.nodes[k].state {
        NodeState::Marked | NodeState::Corrected | NodeState::Tracked => OWN_MARKED,
        _ => OWN_FITTED,
    };
    (0..model.node_count()).map(own).collect()
}

/// A frontal pose by the similarity of the points that expressions do not move.
fn rough_pose(model: &HeadModel, tables: &Tables, frame: &TrackedFrame) -> Result<HeadPose, PoseError> {
    let stable = stable_nodes(tables, model.node_count());
    let face: Vec<Point2<f64>> = stable.iter().map(|&k| frontal(model, k)).collect();
    let seen: Vec<Point2<f64>> = stable.iter().map(|&k| frame.nodes[k].position).collect();
    Ok(pose_of(&Similarity::fit(&face, &seen, None)?))
}

/// A node of the mean head from the front, y down.
fn frontal(model: &HeadModel, k: usize) -> Point2<f64> {
    Point2::new(model.mean[k].x, -model.mean[k].y)
}

/// The frontal pose of a similarity from the frontal head to the image, y down in both.
fn pose_of(placed: &Similarity) -> HeadPose {
    HeadPose {
        // The similarity turns with y down.
        rotation: HeadPose::rotation_of(0.0, 0.0, -placed.angle.to_degrees()),
        scale: placed.scale,
        position: placed.apply(&Point2::origin()),
        distance: CAMERA_DISTANCE * HEAD_ES,
    }
}

fn residual(shape: &[Vector3<f64>], pose: &HeadPose, seen: &[Seen]) -> f64 {
    let mut distances: Vec<f64> = seen.iter().map(|s| (s.at - pose.image_of(&pose.turned(&shape[s.node]))).norm()).collect();
    crate::robust::median(&mut distances).unwrap_or(0.0)
}

/// One frame as seen by the head: its pose and the offsets of its expression.
struct View<'a> {
    seen: &'a [Seen],
    pose: HeadPose,
    offsets: Option<Vec<Vector3<f64>>>,
}

/// A person's head.
#[derive(Clone)]
struct Head {
    coefficients: DVector<f64>,
    own: Vec<Vector3<f64>>,
}

/// What the views say of the place of one node: `sum J'J` and `sum J'(seen - explained)`, weighted.
#[derive(Clone, Copy)]
struct Evidence {
    normal: Matrix3<f64>,
    right: Vector3<f64>,
}

impl Head {
    /// Coefficients and own offsets, each over its standard deviation.
    fn in_deviations(&self, own: &[f64]) -> Vec<f64> {
        let offsets = self.own.iter().zip(own).flat_map(|(offset, own)| [offset.x / own, offset.y / own, offset.z / own]);
        self.coefficients.iter().copied().chain(offsets).collect()
    }

    fn shape(&self, model: &HeadModel) -> Vec<Vector3<f64>> {
        let mut shape = shape_with(&model.mean, &model.identity, &self.coefficients);
        shape.iter_mut().zip(&self.own).for_each(|(x, own)| *x += own);
        shape
    }

    /// Solves for the head given poses and expressions.
    ///
    /// The person's own offsets are integrated out of the system for the coefficients: a node whose views determine it by `H` counts
    /// with `(H^-1 + own^2)^-1`.
    fn improve(&mut self, model: &HeadModel, views: &[View<'_>], own: &[f64]) {
        let shape = self.shape(model);
        let nothing = Evidence { normal: Matrix3::zeros(), right: Vector3::zeros() };
        let mut evidence = vec![nothing; model.node_count()];
        for view in views {
            for s in view.seen {
                let place = shape[s.node] + view.offsets.as_ref().map_or_else(Vector3::zeros, |o| o[s.node]);
                let turned = view.pose.turned(&place);
                let residual: Vector2<f64> = s.at - view.pose.image_of(&turned);
                let deviation = s.deviation * view.pose.scale;
                let weight = robust(residual.norm() / deviation.hypot(own[s.node] * view.pose.scale)) / (deviation * deviation);
                let slope: Matrix2x3<f64> = view.pose.slope(&turned) * view.pose.rotation.matrix();
                evidence[s.node].normal += slope.transpose() * slope * weight;
                evidence[s.node].right += slope.transpose() * residual * weight;
            }
        }
        let count = model.identity.len();
        let mut normal = DMatrix::<f64>::identity(count, count);
        let mut right = -self.coefficients.clone();
        for (k, e) in evidence.iter().enumerate() {
            // With precision p = 1 / own^2 the offset's best answer is (H + p)^-1 (b - p r); what is left for the coefficients:
            let precision = own[k].powi(-2);
            let Some(inverse) = (e.normal + Matrix3::identity() * precision).try_inverse() else { continue };
            let counted = e.normal - e.normal * inverse * e.normal;
            let pulled = e.right - e.normal * inverse * (e.right - self.own[k] * precision);
            for i in 0..count {
                let along = counted * model.identity[i][k];
                right[i] += model.identity[i][k].dot(&pulled);
                for j in 0..=i {
                    normal[(i, j)] += along.dot(&model.identity[j][k]);
                }
            }
        }
        normal.fill_upper_triangle_with_lower_triangle();
        let Some(step) = normal.cholesky().map(|factor| factor.solve(&right)) else { return };
        for (k, e) in evidence.iter().enumerate() {
            let precision = own[k].powi(-2);
            let moved: Vector3<f64> = model.identity.iter().zip(step.iter()).map(|(d, c)| d[k] * *c).sum();
            if let Some(inverse) = (e.normal + Matrix3::identity() * precision).try_inverse() {
                let change = inverse * (e.right - e.normal * moved - self.own[k] * precision);
                self.own[k] += change;
            }
        }
        self.coefficients += step;
    }
}
