//! The person's neutral head, and pose and expression in every frame, all together.
//!
//! The unknowns are those of [`HeadModel`]: coefficients of identity and the person's own offset of every node, and in every frame
//! a pose and coefficients of expression; the neutral frame has no expression. What is seen is every node that the tracker placed, with
//! a standard deviation by its state. The neutral frame gives a first head; then frames (pose and expression) and head (given
//! those) are solved in turn, each by linear least squares with robust weights, so that frames seen from other sides improve the depth.

use nalgebra::{DMatrix, DVector, Matrix2x3, Matrix3, Point2, Vector2, Vector3};

use super::{
    CAMERA_DISTANCE, HEAD_ES, HeadModel, HeadPose,
    frontal::visibility,
    solve::{Directions, Seen, Solved, cost, robust, shape_with, solve},
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
/// Turns of frames and head at the first distance, and at a next one, which begins with what the one before found.
const TURNS: usize = 3;
const NEXT_TURNS: usize = 2;
/// The last step of a frame while the head is sought, and once it is known: radians, logarithms, standard deviations.
const NEARLY_AT_REST: f64 = 1e-3;
const AT_REST: f64 = 1e-5;
/// Distances of the camera that are tried, eye distances: each 1.4 times the one before, and one so far that nothing is magnified.
const DISTANCES: [f64; 6] = [5.5, 7.8, 11.0, 15.5, 22.0, 44.0];
/// The one of them that is tried first: the nearest to [`CAMERA_DISTANCE`].
const FIRST_DISTANCE: usize = 3;
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
/// The distance of the camera is the one of `DISTANCES` which explains the frames best: from the likeliest on, each way as long as the
/// next explains them better.
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
    let first = sequence.head_at(DISTANCES[FIRST_DISTANCE], None)?;
    let (nearer, farther) = (&DISTANCES[..FIRST_DISTANCE], &DISTANCES[FIRST_DISTANCE + 1..]);
    let nearest = sequence.while_better(first.clone(), nearer.iter().rev());
    let farthest = sequence.while_better(first, farther.iter());
    let found = if nearest.cost < farthest.cost { nearest } else { farthest };
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

/// A head, its pose in the neutral frame, pose and expression of the frames that it was learned from, and what it leaves unexplained:
/// minus the logarithm of its probability, up to a constant.
#[derive(Clone)]
struct Found {
    head: Head,
    neutral_pose: HeadPose,
    /// `None` for a frame that no pose explains.
    frames: Vec<Option<Solved>>,
    cost: f64,
}

impl Sequence<'_> {
    /// The head that explains the frames best with the camera at a distance, eye distances; `nearby` is what was found at another.
    fn head_at(&self, distance: f64, nearby: Option<&Found>) -> Result<Found, PoseError> {
        let Self { model, frames, own, .. } = *self;
        let none = |number| PoseError::NoHead { frame: number };
        let Some((first, rest)) = frames.split_first() else { return Err(none(0)) };
        let unlikely = (distance / CAMERA_DISTANCE).ln() / LOG_DISTANCE_DEVIATION;
        let camera = distance * HEAD_ES;
        let mut found = match nearby {
            Some(nearby) => nearby.clone(),
            None => self.first_head(first)?,
        };
        let usable: Vec<&Frame> = rest.iter().filter(|frame| frame.is_seen()).collect();
        let chosen: Vec<&Frame> = spread(usable.len(), HEAD_FRAMES).into_iter().map(|k| usable[k]).collect();
        found.neutral_pose.distance = camera;
        found.frames.iter_mut().flatten().for_each(|solved| solved.pose.distance = camera);
        let nothing = vec![Vector3::zeros(); model.node_count()];
        for _ in 0..if nearby.is_some() { NEXT_TURNS } else { TURNS } {
            self.solve_frames(&mut found, &chosen);
            let mut views = vec![View { seen: &first.seen, pose: found.neutral_pose, offsets: None }];
            for (frame, solved) in solved_frames(&chosen, &found.frames) {
                let offsets = shape_with(&nothing, &model.expression, &solved.coefficients);
                views.push(View { seen: &frame.seen, pose: solved.pose, offsets: Some(offsets) });
            }
            found.head.improve(model, &views, own);
            let start = Solved { pose: found.neutral_pose, coefficients: DVector::zeros(0) };
            let solved = solve(&found.head.shape(model), &Directions::none(), &first.seen, start, AT_REST);
            found.neutral_pose = solved.ok_or(none(first.number))?.pose;
        }
        self.solve_frames(&mut found, &chosen);
        let shape = found.head.shape(model);
        let own_share = |(offset, own): (&Vector3<f64>, &f64)| offset.norm_squared() / (own * own);
        let head = found.head.coefficients.norm_squared() + found.head.own.iter().zip(own).map(own_share).sum::<f64>();
        found.cost = 0.5 * (unlikely * unlikely + head) + unexplained(&shape, &found.neutral_pose, &first.seen);
        for (frame, solved) in solved_frames(&chosen, &found.frames) {
            let now = shape_with(&shape, &model.expression, &solved.coefficients);
            found.cost += 0.5 * solved.coefficients.norm_squared() + unexplained(&now, &solved.pose, &frame.seen);
        }
        Ok(found)
    }

    /// The best head of distances that lead away from that of `found`, tried as long as the next explains the frames better.
    fn while_better<'d>(&self, mut found: Found, distances: impl Iterator<Item = &'d f64>) -> Found {
        for &distance in distances {
            match self.head_at(distance, Some(&found)) {
                Ok(next) if next.cost < found.cost => found = next,
                _ => break,
            }
        }
        found
    }

    /// A first head from the neutral frame: the person's own offsets count as noise.
    fn first_head(&self, first: &Frame) -> Result<Found, PoseError> {
        let noisy = |s: &Seen| Seen { deviation: s.deviation.hypot(self.own[s.node]), ..*s };
        let seen: Vec<Seen> = first.seen.iter().map(noisy).collect();
        let start = Solved { pose: self.start, coefficients: DVector::zeros(self.model.identity.len()) };
        let solved = solve(&self.model.mean, &self.identity, &seen, start, NEARLY_AT_REST);
        let solved = solved.ok_or(PoseError::NoHead { frame: first.number })?;
        let head = Head { coefficients: solved.coefficients, own: vec![Vector3::zeros(); self.model.node_count()] };
        Ok(Found { head, neutral_pose: solved.pose, frames: Vec::new(), cost: f64::INFINITY })
    }

    /// Pose and expression of the chosen frames, each from what was found of it before, else from the frame before it.
    fn solve_frames(&self, found: &mut Found, chosen: &[&Frame]) {
        let shape = found.head.shape(self.model);
        let mut frames: Vec<Option<Solved>> = Vec::with_capacity(chosen.len());
        for (k, frame) in chosen.iter().enumerate() {
            let earlier = found.frames.get(k).and_then(Option::as_ref);
            let start = earlier.or_else(|| frames.iter().rev().find_map(Option::as_ref)).cloned();
            let start = start.unwrap_or_else(|| no_expression(self.model, found.neutral_pose));
            frames.push(self.solve_frame(&shape, frame, start, NEARLY_AT_REST));
        }
        found.frames = frames;
    }

    fn solve_frame(&self, shape: &[Vector3<f64>], frame: &Frame, start: Solved, at_rest: f64) -> Option<Solved> {
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
        solve(shape, &self.expression, &seen, start, at_rest)
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
        let mut before = no_expression(self.model, self.start);
        for frame in rest {
            let solved = frame.is_seen().then(|| self.solve_frame(&fit.neutral, frame, before.clone(), AT_REST)).flatten();
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

/// The chosen frames that have a pose.
fn solved_frames<'a>(chosen: &'a [&Frame], solved: &'a [Option<Solved>]) -> impl Iterator<Item = (&'a Frame, &'a Solved)> {
    chosen.iter().zip(solved).filter_map(|(frame, solved)| Some((*frame, solved.as_ref()?)))
}

fn no_expression(model: &HeadModel, pose: HeadPose) -> Solved {
    Solved { pose, coefficients: DVector::zeros(model.expression.len()) }
}

/// What a shape in a pose leaves unexplained.
fn unexplained(shape: &[Vector3<f64>], pose: &HeadPose, seen: &[Seen]) -> f64 {
    let one = |s: &Seen| cost((s.at - pose.image_of(&pose.turned(&shape[s.node]))).norm() / (s.deviation * pose.scale));
    seen.iter().map(one).sum()
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
