//! One step from a frame to the next: search, judge, deform again [KP, section 3].
//!
//! KP drive the springs by the displacements of all nodes that were not lost, with equal weight. But a match on plain skin is less accurate
//! than one on a brow, and less accurate along an edge than along its normal. The force on a node is therefore the matrix
//!
//! ```text
//! F = f G / (n + w d^2) + e I
//! ```
//!
//! G: mean gradient matrix of the window; d: mean grey difference of the matched windows; f: [`TrackOptions::force`]; w:
//! [`TrackOptions::mismatch`]; n, e: floors. This is KLT's own estimate of how well it determined a displacement. Well-textured,
//! well-matched nodes stay where KLT found them; the others follow the springs.

use nalgebra::{Matrix2, Point2, Vector2};

use super::{
    AlignOptions, Evidence, Forces, Found, LossReason, NodeState, PointTracker, Probe, SkinMatch, Slot, TrackError, TrackOptions,
    TrackedFrame, TrackedNode,
    align::{Patch, Template, Ties},
    check_nodes,
    leap::{FAR, Leap, PREDICTED_FORCE, is_large},
    lids::Lids,
    lips::Lips,
    recover,
};
use crate::{
    fit::{DrivenNode, Pull, Springs},
    sequence::Frame,
    units::NodeId,
    wireframe::{Region, Tables, Wireframe},
};

/// Margin around the wireframe that the alignment may read, px.
const PATCH_MARGIN_PX: f64 = 12.0;

/// Smallest number of nodes that must be tracked in a step.
const MIN_TRACKED: usize = 8;

/// Where an inner-lip node is searched for, as a share of the way from the inner to the outer edge of its lip.
const LIP_PROBE: f64 = 0.7;

/// The same for an inner corner of the mouth: it moves with the outer corner, which has texture.
const CORNER_PROBE: f64 = 1.0;

/// Squared grey difference assumed for a perfect match.
const MISMATCH_FLOOR: f64 = 0.05;

/// Force on a node in a direction without any gradient, over the stiffness of a spring.
const FORCE_FLOOR: f64 = 1e-3;

/// Inner and outer nodes of the lips, by feature point: upper middle, upper left and right, lower middle, lower left and right.
const LIPS: [(&str, &str); 6] = [("2.2", "8.1"), ("2.6", "8.5"), ("2.7", "8.6"), ("2.3", "8.2"), ("2.8", "8.7"), ("2.9", "8.8")];

/// Inner and outer corners of the mouth, left and right.
const CORNERS: [(&str, &str); 2] = [("2.4", "8.3"), ("2.5", "8.4")];

/// Feature points of the pupils; their nodes are the corners of the iris boxes.
const PUPILS: [&str; 2] = ["3.5", "3.6"];

/// Returns the roots of the eigenvalues of a mean gradient matrix, the smaller first: gradients across and along the strongest edge.
fn root_eigenvalues(matrix: &Matrix2<f64>) -> [f64; 2] {
    let half_trace = f64::midpoint(matrix.m11, matrix.m22);
    let spread = ((matrix.m11 - matrix.m22) / 2.0).hypot(matrix.m12);
    [half_trace - spread, half_trace + spread].map(|value| value.max(0.0).sqrt())
}

/// What the tracker precomputes for a wireframe.
///
/// ```
/// # let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let folder = std::path::Path::new("fixtures/simulated/S001/005");
/// # let marks = folder.join("correspondences.csv");
/// # let marks = grimace::correspondence::read_correspondences(&marks, &tables, wireframe.node_count())?;
/// # let fitted = grimace::fit::Fitter::new(&wireframe, Default::default()).fit(&wireframe, &marks)?;
/// use grimace::{sequence::read_frame, track::{TrackPlan, track_sequence}};
///
/// // `fitted` is the wireframe on the first frame of `folder`.
/// // One plan serves all sequences of a wireframe. Nothing moves between a frame and itself.
/// let plan = TrackPlan::new(&wireframe, &tables);
/// let frame = || read_frame(&folder.join("S001_005_00000001.jpg"));
/// let track = track_sequence(&wireframe, &plan, &fitted, [frame(), frame()], &Default::default(), |_| true)?;
/// let moved = |k: usize| (track.frames[1].nodes[k].position - track.frames[0].nodes[k].position).norm();
/// assert!((0..113).all(|k| moved(k) < 0.01));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct TrackPlan {
    /// Live nodes of the wireframe, and the number of all its nodes.
    live: Vec<NodeId>,
    nodes: usize,
    springs: Springs,
    ties: Ties,
    neighbours: recover::Neighbours,
    lips: Vec<LipTwin>,
    corners: Vec<LipTwin>,
    /// Indices, among the live nodes, of nodes that move as one: the corners of each iris box.
    rigid: Vec<Vec<usize>>,
    pub(super) tables: Tables,
}

/// An inner-lip node and the outer-lip node of the same lip.
///
/// The inner-lip nodes of upper and lower lip coincide when the mouth is closed (40/87, 81/83, 82/84). KLT would then find the same patch
/// for both, and the mouth would never open. Each is therefore searched for by a patch inside its own lip.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LipTwin {
    inner: NodeId,
    outer: NodeId,
}

impl TrackPlan {
    /// Creates the plan for a wireframe.
    pub fn new(wireframe: &Wireframe, tables: &Tables) -> Self {
        let nodes = |fp: &str| fp.parse().ok().and_then(|fp| tables.feature_point_nodes(fp)).unwrap_or_default();
        let single = |fp: &str| match nodes(fp) {
            &[node] if node.index() < wireframe.node_count() => Some(node),
            _ => None,
        };
        let place = |node: &NodeId| wireframe.live_nodes().iter().position(|n| n == node);
        let springs = Springs::new(wireframe);
        let twin = |(inner, outer): &(&str, &str)| Some(LipTwin { inner: single(inner)?, outer: single(outer)? });
        let corners: Vec<_> = CORNERS.iter().filter_map(twin).collect();
        let held: Vec<_> = corners.iter().map(|corner| [corner.outer, corner.inner]).collect();
        Self {
            live: wireframe.live_nodes().to_vec(),
            nodes: wireframe.node_count(),
            ties: Ties::new(wireframe, &springs, &held),
            springs,
            neighbours: recover::Neighbours::new(wireframe),
            lips: LIPS.iter().filter_map(twin).collect(),
            corners,
            rigid: PUPILS.iter().map(|fp| nodes(fp).iter().filter_map(place).collect()).collect(),
            tables: tables.clone(),
        }
    }
}

/// Checks that a point tracker returned one of each for every point.
fn one_each<T>(what: &str, found: Vec<T>, asked: usize) -> Result<Vec<T>, TrackError> {
    if found.len() == asked {
        return Ok(found);
    }
    Err(TrackError::PointTracker {
        reason: format!("it returned {} {what} for {asked} points; it must return one each", found.len()),
    })
}

/// The error about an answer of a point tracker that is not finite.
fn not_finite(what: impl std::fmt::Display) -> TrackError {
    TrackError::PointTracker { reason: format!("it returned {what}; all numbers must be finite") }
}

/// Checks that a point tracker searched for every probe and that its results are finite.
fn search_results(found: Vec<Found>, probes: &[Probe]) -> Result<Vec<Found>, TrackError> {
    let found = one_each("search results", found, probes.len())?;
    let is_finite = |found: &Found| match found {
        Found::At { position, difference } => position.x.is_finite() && position.y.is_finite() && difference.is_finite(),
        Found::Lost => true,
    };
    match found.iter().zip(probes).find(|(found, _)| !is_finite(found)) {
        Some((&Found::At { position: to, difference }, Probe { position: from, .. })) => {
            let (to, from) = (written(&to), written(from));
            Err(not_finite(format_args!("the position {to} with difference {difference} for the point {from}")))
        }
        _ => Ok(found),
    }
}

/// Checks that the gradients of a point tracker are one for each point and finite.
fn finite_gradients(found: Vec<Matrix2<f64>>, points: &[Point2<f64>]) -> Result<Vec<Matrix2<f64>>, TrackError> {
    let found = one_each("gradients", found, points.len())?;
    match found.iter().zip(points).find(|(matrix, _)| matrix.iter().any(|number| !number.is_finite())) {
        Some((m, point)) => {
            let point = written(point);
            Err(not_finite(format_args!(
                "the gradient matrix ({}, {}; {}, {}) for the point {point}",
                m.m11, m.m12, m.m21, m.m22
            )))
        }
        None => Ok(found),
    }
}

/// Checks that a patch of a point tracker has as many grey values as its size says, and that they are finite.
fn whole(patch: Option<Patch>) -> Result<Option<Patch>, TrackError> {
    let Some(Patch { left, top, width, height, values }) = &patch else { return Ok(None) };
    let (width, height, found) = (*width, *height, values.len());
    if found == 0 || width.checked_mul(height) != Some(found) {
        let reason = format!("it returned a patch of {width}x{height} px with {found} grey values");
        return Err(TrackError::PointTracker { reason });
    }
    if let Some(place) = values.iter().position(|value| !value.is_finite()) {
        let (x, y, value) = (*left as usize + place % width, *top as usize + place / width, values[place]);
        return Err(not_finite(format_args!("a patch with the grey value {value} at ({x}, {y})")));
    }
    Ok(patch)
}

/// A position in a message.
fn written(point: &Point2<f64>) -> String {
    format!("({:.1}, {:.1})", point.x, point.y)
}

impl TrackPlan {
    /// Checks that the plan was made for a wireframe.
    ///
    /// # Errors
    /// [`TrackError::OtherWireframe`].
    pub(super) fn check_wireframe(&self, wireframe: &Wireframe) -> Result<(), TrackError> {
        check_nodes("plan", self.nodes, wireframe.node_count())?;
        check_nodes("plan", self.live.len(), wireframe.live_nodes().len())
    }

    /// Returns the template of the neutral frame's skin, for a tracker that has images.
    pub(super) fn template(
        &self,
        wireframe: &Wireframe,
        tracker: &impl PointTracker,
        nodes: &[Point2<f64>],
        lengths: (u32, f64),
        options: &AlignOptions,
    ) -> Result<Option<Template>, TrackError> {
        let patch = whole(tracker.patch(Slot::Neutral, nodes, PATCH_MARGIN_PX, options.smoothing)?)?;
        Ok(patch.map(|patch| Template::new(wireframe, &self.ties, &self.rigid.concat(), nodes, &patch, lengths, options)))
    }
}

/// One step from the previous to the current frame.
pub(super) struct Step<'a> {
    pub wireframe: &'a Wireframe,
    pub plan: &'a TrackPlan,
    pub options: &'a TrackOptions,
    /// Grey values of the neutral frame, for a tracker that has images.
    pub template: Option<&'a mut Template>,
    /// Side of the KLT window, px.
    pub window: u32,
    /// ES0 of the neutral frame, px.
    pub eye_distance: f64,
    /// Eyes of the neutral frame, when lids are read.
    pub lids: Option<&'a Lids>,
    /// Lips of the neutral frame, when lips are read.
    pub lips: Option<&'a Lips>,
    /// The neutral frame, in which the face is located when lips are read, and in a large step.
    pub leap: Option<&'a Leap>,
    /// The current frame as recorded; the tracker may hold a version with corrected lighting.
    pub frame: &'a Frame,
}

impl Step<'_> {
    /// Returns the nodes of the current frame.
    pub fn run(&mut self, tracker: &mut impl PointTracker, previous: &TrackedFrame) -> Result<Vec<TrackedNode>, TrackError> {
        let live = self.wireframe.live_nodes();
        let positions: Vec<_> = previous.nodes.iter().map(|n| n.position).collect();
        let starts: Vec<_> = live.iter().map(|&n| positions[n.index()] + self.probe_offset(n, &positions)).collect();
        let mut steps = self.search(tracker, &starts, None)?;
        recover::reject_extremes(&self.plan.neighbours, &mut steps, self.options.extreme, self.eye_distance);
        self.leap(tracker, &positions, &starts, &mut steps)?;
        if self.options.rigid_eyes {
            for group in &self.plan.rigid {
                recover::move_as_one(&mut steps, group);
            }
        }
        // A located face is not lost, however few of its nodes KLT found.
        let tracked = steps.iter().filter(|s| s.loss.is_none() || s.loss == Some(LossReason::Jump)).count();
        if tracked < MIN_TRACKED.min(live.len()) {
            return Err(TrackError::FaceLost { frame: self.frame.number(), found: tracked, live: live.len() });
        }
        let gradients = tracker.gradients(Slot::Previous, self.window, &starts)?;
        let gradients = finite_gradients(gradients, &starts)?;
        let mut moved = self.place(&positions, &steps, &gradients)?;
        let skin = self.align(tracker, &steps, &gradients, &mut moved)?;
        let follows = |&position| TrackedNode::new(position, NodeState::Follows, None);
        let mut nodes: Vec<_> = moved.iter().map(follows).collect();
        for (k, (step, gradient)) in steps.iter().zip(&gradients).enumerate() {
            let node = &mut nodes[step.node.index()];
            node.skin = skin.get(k).copied().flatten();
            node.state = step.loss.map_or(NodeState::Tracked, NodeState::Recovered);
            node.residual = step.residual;
            if step.loss.is_none() {
                let correction = (node.position - positions[step.node.index()] - step.displacement).norm();
                node.evidence = Some(Evidence { difference: step.difference, gradients: root_eigenvalues(gradient), correction });
            }
        }
        if let Some(lids) = self.lids {
            lids.place(self.frame, &mut nodes);
        }
        if let Some((lips, neutral)) = self.lips.zip(self.leap) {
            lips.place(neutral, self.frame, self.eye_distance, &mut nodes);
        }
        let mut positions: Vec<_> = nodes.iter().map(|node| node.position).collect();
        self.wireframe.place_followers(&mut positions);
        nodes.iter_mut().zip(positions).for_each(|(node, position)| node.position = position);
        Ok(nodes)
    }

    /// Returns the offset from a node to the point that is searched for in its place.
    fn probe_offset(&self, node: NodeId, positions: &[Point2<f64>]) -> Vector2<f64> {
        let of = |twins: &[LipTwin], share: f64| {
            let twin = twins.iter().find(|twin| twin.inner == node)?;
            Some((positions[twin.outer.index()] - positions[node.index()]) * share)
        };
        let lip = if self.options.lip_probes { of(&self.plan.lips, LIP_PROBE) } else { None };
        let corner = if self.options.align.corners > 0.0 { of(&self.plan.corners, CORNER_PROBE) } else { None };
        lip.or(corner).unwrap_or_default()
    }

    /// Searches again from where the located face predicts the nodes, if the step is large.
    fn leap(
        &mut self,
        tracker: &mut impl PointTracker,
        positions: &[Point2<f64>],
        starts: &[Point2<f64>],
        steps: &mut Vec<recover::NodeStep>,
    ) -> Result<(), TrackError> {
        if !is_large(steps, self.eye_distance, |node| self.plan.tables.region(node) == Region::Eye) {
            return Ok(());
        }
        let Some(leap) = self.leap.filter(|_| self.options.locate_lost) else { return Ok(()) };
        let Some(predicted) = leap.predict(self.frame, positions, self.wireframe, &self.plan.springs)? else { return Ok(()) };
        let live = self.wireframe.live_nodes();
        let guesses: Vec<_> = live.iter().map(|&n| predicted[n.index()] + self.probe_offset(n, &predicted)).collect();
        let mut again = self.search(tracker, starts, Some(&guesses))?;
        let frame = self.frame.size();
        for ((step, guess), start) in again.iter_mut().zip(&guesses).zip(starts) {
            let expected = guess - start;
            if step.loss.is_none() && (step.displacement - expected).norm() > FAR * self.eye_distance {
                step.loss = Some(LossReason::Extreme);
            }
        }
        recover::reject_extremes(&self.plan.neighbours, &mut again, self.options.extreme, self.eye_distance);
        for (step, node) in again.iter_mut().zip(live) {
            if step.loss.is_some() {
                // Nobody sees what the frame does not show.
                let is_inside = frame.contains(&predicted[node.index()]);
                step.loss = Some(if is_inside { LossReason::Jump } else { LossReason::Outside });
                step.displacement = predicted[node.index()] - positions[node.index()];
                step.predicted = true;
            }
        }
        // A reading that contradicts most of what was found is wrong, unless that would be too little for a face.
        let found = |steps: &[recover::NodeStep]| steps.iter().filter(|s| s.loss.is_none()).count();
        if 2 * found(&again) >= found(steps) || found(steps) < MIN_TRACKED {
            *steps = again;
        }
        Ok(())
    }

    /// Searches for every live node forward and back, from `guesses` if given, else from where it was.
    fn search(
        &self,
        tracker: &mut impl PointTracker,
        starts: &[Point2<f64>],
        guesses: Option<&[Point2<f64>]>,
    ) -> Result<Vec<recover::NodeStep>, TrackError> {
        let levels = self.options.levels;
        let guess = |k: usize, start: Point2<f64>| guesses.map_or(start, |guesses| guesses[k]);
        let probes: Vec<_> = starts.iter().enumerate().map(|(k, &p)| Probe { position: p, guess: guess(k, p) }).collect();
        let forward = tracker.find(Slot::Previous, Slot::Current, self.window, levels, &probes)?;
        let forward = search_results(forward, &probes)?;
        let live = self.wireframe.live_nodes().iter().zip(starts);
        if self.options.forward_backward == 0.0 {
            return Ok(live.zip(forward).map(|((&node, &start), forward)| self.judge(node, start, forward, None)).collect());
        }
        let end = |(k, (found, start)): (usize, (&Found, &Point2<f64>))| match *found {
            Found::At { position, .. } => Probe { position, guess: position + (start - guess(k, *start)) },
            Found::Lost => Probe { position: *start, guess: *start },
        };
        let ends: Vec<_> = forward.iter().zip(starts).enumerate().map(end).collect();
        let backward = tracker.find(Slot::Current, Slot::Previous, self.window, levels, &ends)?;
        let backward = search_results(backward, &ends)?;
        let ways = forward.into_iter().zip(backward);
        Ok(live.zip(ways).map(|((&node, &start), (there, back))| self.judge(node, start, there, Some(back))).collect())
    }

    /// Decides whether a node was tracked or lost. `backward` is the result of the backward search, if one was made.
    fn judge(&self, node: NodeId, start: Point2<f64>, forward: Found, backward: Option<Found>) -> recover::NodeStep {
        let lost = |reason, residual| recover::NodeStep {
            node,
            displacement: Vector2::zeros(),
            predicted: false,
            residual,
            difference: 0.0,
            loss: Some(reason),
        };
        let Found::At { position, difference } = forward else { return lost(LossReason::Klt, None) };
        if !self.frame.size().contains(&position) {
            return lost(LossReason::Outside, None);
        }
        let residual = match backward {
            None => None,
            Some(Found::Lost) => return lost(LossReason::ForwardBackward, None),
            Some(Found::At { position: returned, .. }) => Some((returned - start).norm()),
        };
        if residual.is_some_and(|r| r > self.options.forward_backward * self.eye_distance) {
            return lost(LossReason::ForwardBackward, residual);
        }
        recover::NodeStep { node, displacement: position - start, predicted: false, residual, difference, loss: None }
    }

    /// Deforms the wireframe again, driven by the nodes that were not lost.
    fn place(
        &self,
        positions: &[Point2<f64>],
        steps: &[recover::NodeStep],
        gradients: &[Matrix2<f64>],
    ) -> Result<Vec<Point2<f64>>, TrackError> {
        let kept = steps.iter().zip(gradients).filter(|(s, _)| s.loss.is_none() || s.predicted);
        if !self.options.deform {
            let mut nodes = positions.to_vec();
            kept.for_each(|(s, _)| nodes[s.node.index()] += s.displacement);
            self.wireframe.place_followers(&mut nodes);
            return Ok(nodes);
        }
        let target = |(s, g): (&recover::NodeStep, &Matrix2<f64>)| DrivenNode {
            node: s.node,
            position: positions[s.node.index()] + s.displacement,
            pull: Pull::Matrix(self.force(s, g)),
        };
        let targets: Vec<_> = kept.map(target).collect();
        Ok(self.plan.springs.deform(self.wireframe, positions, &targets)?)
    }

    /// Corrects the nodes by comparison with the neutral frame, and returns how the skin around each live node looks beside it; see
    /// [`super::align`]. Nothing without images or alignment.
    fn align(
        &mut self,
        tracker: &impl PointTracker,
        steps: &[recover::NodeStep],
        gradients: &[Matrix2<f64>],
        nodes: &mut [Point2<f64>],
    ) -> Result<Vec<Option<SkinMatch>>, TrackError> {
        let options = &self.options.align;
        if self.template.is_none() || options.gain <= 0.0 {
            return Ok(Vec::new());
        }
        let patch = tracker.patch(Slot::Current, nodes, PATCH_MARGIN_PX, options.smoothing)?;
        let Some(patch) = whole(patch)? else { return Ok(Vec::new()) };
        let force = |(s, g): (&recover::NodeStep, &Matrix2<f64>)| {
            if s.loss.is_some() && !s.predicted { Matrix2::zeros() } else { self.force(s, g) }
        };
        let forces: Vec<_> = steps.iter().zip(gradients).map(force).collect();
        let live = self.wireframe.live_nodes();
        let start: Vec<_> = live.iter().map(|n| nodes[n.index()]).collect();
        let Some(template) = &mut self.template else { return Ok(Vec::new()) };
        let (aligned, skin): (Vec<_>, Vec<_>) = template.align(&patch, &start, &forces, options).into_iter().unzip();
        live.iter().zip(aligned).for_each(|(n, position)| nodes[n.index()] = position);
        self.wireframe.place_followers(nodes);
        Ok(skin)
    }

    /// Returns the force matrix of a node that was not lost: the one of the module's equation, or the same for all nodes.
    fn force(&self, step: &recover::NodeStep, gradient: &Matrix2<f64>) -> Matrix2<f64> {
        if step.predicted {
            return Matrix2::identity() * PREDICTED_FORCE;
        }
        if self.options.forces == Forces::Same {
            return Matrix2::identity() * self.options.force;
        }
        let noise = MISMATCH_FLOOR + self.options.mismatch * step.difference.powi(2);
        gradient * (self.options.force / noise) + Matrix2::identity() * FORCE_FLOOR
    }
}
