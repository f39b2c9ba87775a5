//! Expected error of tracked nodes.
//!
//! The error is that of the *neutral offset*, which a FAP measures: the distance of a node from the true position of its point of the
//! neutral frame. The features of a node in a frame ([`NodeFeatures`], a pure function of the track) give a score
//!
//! ```text
//! s = sum_j w_j f_j,    expected error = ES0 exp(c(s))
//! ```
//!
//! f: logarithms of the features and indicators of region and state; w: weights from a median regression on the logarithm of true errors;
//! c: a non-decreasing, piecewise linear calibration of the score. The expected error is a median: half of the errors of nodes with the
//! same expected error are larger, half smaller. Weights and calibration were learned from simulated people and from photographs that were
//! moved by known amounts (`grimace evaluate confidence`); they are in `candide/track_confidence.csv`. On faces smaller than those in the
//! training data, ES0 is the smallest of the training data. Jumps between two frames add an error of their own ([`jump_errors`]).

use std::{fmt::Write as _, sync::LazyLock};

use nalgebra::{Point2, Vector2};

use super::{
    Evidence, NodeState, TrackedFrame,
    evidence::{GRADIENT_FLOOR, STEP_TO_NEUTRAL},
    eye_distance_px,
    leap::jump_errors,
};
use crate::{
    robust::median,
    units::NodeId,
    wireframe::{Region, Tables, Wireframe},
};

const TABLE: &str = include_str!("../../candide/track_confidence.csv");

/// Header of the table of weights and calibration.
const HEADER: &str = "term,value,calibrated";
/// Term of a row of the calibration: a score and the calibrated logarithm of the error over ES0.
const KNOT: &str = "knot";

/// Largest expected error, over the eye distance; with a larger error a node is lost for good.
const MAX_EXPECTED: f64 = 0.5;
/// Smallest and largest eye distance in the training data, px. On larger faces the error over the eye distance is taken as that at the
/// largest; on smaller faces the error in px is taken as that at the smallest, because it is limited by the pixel size.
const SIZES: (f64, f64) = (15.0, 110.0);
/// Squared grey difference assumed for a perfect match.
const DIFFERENCE_FLOOR: f64 = 0.05;

/// Features of a live node in a frame. Lengths are over the eye distance ES0; sums run over the frames after the neutral one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeFeatures {
    /// Region of the face.
    pub region: Region,
    /// Whether the node was lost in this frame.
    pub lost: bool,
    /// Whether its position in the neutral frame was set exactly.
    pub hard_start: bool,
    /// The eye distance, px.
    pub size: f64,
    /// Frames since the neutral frame.
    pub frames: f64,
    /// Share of these frames in which the node was lost.
    pub lost_share: f64,
    /// Length of the neutral offset relative to the median offset of the face.
    pub offset: f64,
    /// Length of the neutral offset relative to the mean offset of its neighbours.
    pub strain: f64,
    /// Displacement in this frame.
    pub step: f64,
    /// Root of the sum of squares of the forward-backward distances.
    pub residual: f64,
    /// Largest grey difference so far, grey levels; a frame in which the node was lost counts with the median of that frame.
    pub difference: f64,
    /// Possible drift along the weaker gradient that the grey differences allow, root of the sum of squares.
    pub drift: f64,
    /// Weaker and stronger gradient, grey levels per eye distance.
    pub gradients: [f64; 2],
    /// Distance from the position that the tracker found to the final position.
    pub correction: f64,
    /// Root of the sum of squares of `correction` over the frames so far.
    pub corrections: f64,
    /// Largest median grey difference of any frame so far.
    pub frame_difference: f64,
    /// Share of live nodes lost in the frame.
    pub frame_lost: f64,
    /// Median neutral offset of the face: the head's motion.
    pub head: f64,
    /// Grey difference of the skin from the neutral frame (`SkinMatch::difference`); for a node without skin the largest grey difference
    /// so far.
    pub skin_difference: f64,
    /// Shift that it stands for (`SkinMatch::offset_px`); for a node without skin the median of the face.
    pub skin_offset: f64,
    /// Median of this shift over the face. Without alignment no skin is compared; then all three are those expected from the grey
    /// differences of the steps.
    pub frame_skin_offset: f64,
}

impl NodeFeatures {
    /// Returns the names of the terms of the score, in the order of [`NodeFeatures::terms`].
    #[must_use]
    pub fn names() -> Vec<String> {
        let fixed = [
            "one",
            "lost",
            "hard_start",
            "log_frames",
            "lost_share",
            "log_offset",
            "log_strain",
            "log_step",
            "log_residual",
            "log_difference",
            "log_drift",
            "log_weak_gradient",
            "log_strong_gradient",
            "log_correction",
            "log_corrections",
            "log_frame_difference",
            "frame_lost",
            "log_head",
            "hard_start_log_frames",
            "hard_start_log_offset",
            "log_size",
            "log_skin_difference",
            "log_skin_offset",
            "log_frame_skin_offset",
        ];
        let regions = Region::ALL.iter().skip(1).map(|region| format!("region_{region}"));
        fixed.into_iter().map(str::to_owned).chain(regions).collect()
    }

    /// Returns the terms of the score.
    #[must_use]
    pub fn terms(&self) -> Vec<f64> {
        let flag = |value: bool| f64::from(u8::from(value));
        let log = |value: f64, floor: f64| (value + floor).ln();
        let hard = flag(self.hard_start);
        let mut terms = vec![
            1.0,
            flag(self.lost),
            hard,
            self.frames.max(1.0).ln(),
            self.lost_share,
            log(self.offset, 0.005),
            log(self.strain, 0.002),
            log(self.step, 0.002),
            log(self.residual, 0.000_5),
            log(self.difference, 0.2),
            log(self.drift, 0.002),
            log(self.gradients[0], 20.0),
            log(self.gradients[1], 20.0),
            log(self.correction, 0.000_5),
            log(self.corrections, 0.002),
            log(self.frame_difference, 0.2),
            self.frame_lost,
            log(self.head, 0.01),
            hard * self.frames.max(1.0).ln(),
            hard * log(self.offset, 0.005),
            self.size.clamp(SIZES.0, SIZES.1).ln(),
            log(self.skin_difference, 0.2),
            log(self.skin_offset, 0.001),
            log(self.frame_skin_offset, 0.001),
        ];
        terms.extend(Region::ALL.iter().skip(1).map(|&region| flag(self.region == region)));
        terms
    }
}

/// Returns the features of every live node in every frame, `[frame][index among the live nodes]`. They are `None` in the neutral frame, for
/// a node set by hand, and in a frame without evidence, such as one read from a file.
#[must_use]
pub fn node_features(frames: &[TrackedFrame], wireframe: &Wireframe, tables: &Tables) -> Vec<Vec<Option<NodeFeatures>>> {
    let live = wireframe.live_nodes();
    let Some((neutral, later)) = frames.split_first() else { return Vec::new() };
    let positions: Vec<Point2<f64>> = neutral.nodes.iter().map(|n| n.position).collect();
    let Some(unit) = eye_distance_px(tables, &positions) else { return vec![vec![None; live.len()]; frames.len()] };
    let neighbours = neighbours(wireframe);
    let mut sums = vec![Sums::default(); live.len()];
    let mut frame_difference = 0.0_f64;
    let mut before = neutral;
    let mut out = vec![vec![None; live.len()]];
    for (k, frame) in (1_u32..).zip(later) {
        let context = FrameContext::new(frame, neutral, live);
        frame_difference = frame_difference.max(context.difference);
        let features = live.iter().enumerate().map(|(place, &id)| {
            let (node, start) = (frame.nodes.get(id.index())?, neutral.nodes.get(id.index())?);
            let sum = &mut sums[place];
            let lost = node.state.loss().is_some();
            sum.lost += u32::from(lost);
            sum.residual += node.residual.unwrap_or(0.0).powi(2);
            sum.difference = sum.difference.max(node.evidence.map_or(context.difference, |e| e.difference));
            if let Some(evidence) = &node.evidence {
                sum.add(evidence);
            }
            if !context.has_evidence || node.state == NodeState::Corrected {
                return None;
            }
            let evidence = node.evidence.as_ref();
            let offset = context.offsets[place];
            let near = &neighbours[place];
            let mean = near.iter().map(|&n| context.offsets[n]).sum::<Vector2<f64>>() / near.len().max(1) as f64;
            let step = node.position - before.nodes.get(id.index()).map_or(node.position, |n| n.position);
            Some(NodeFeatures {
                region: tables.region(id),
                lost,
                hard_start: start.state == NodeState::Corrected,
                size: unit,
                frames: f64::from(k),
                lost_share: f64::from(sum.lost) / f64::from(k),
                offset: (offset - context.head).norm() / unit,
                strain: (offset - mean).norm() / unit,
                step: step.norm() / unit,
                residual: sum.residual.sqrt() / unit,
                difference: sum.difference,
                drift: sum.drift.sqrt() / unit,
                gradients: sum.gradients.map(|g| g * unit),
                correction: evidence.map_or(0.0, |e| e.correction) / unit,
                corrections: sum.correction.sqrt() / unit,
                frame_difference,
                frame_lost: context.lost,
                head: context.head.norm() / unit,
                skin_difference: node
                    .skin
                    .map_or(sum.difference * if context.has_skin { 1.0 } else { STEP_TO_NEUTRAL }, |s| s.difference),
                skin_offset: node.skin.map_or(context.skin_offset, |skin| skin.offset_px()) / unit,
                frame_skin_offset: context.skin_offset / unit,
            })
        });
        out.push(features.collect());
        before = frame;
    }
    out
}

/// Sums of squares over the frames so far, and the largest grey difference. Consecutive frames hardly differ where motion slows down, so
/// the sums keep the errors made while it was fast.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    lost: u32,
    residual: f64,
    difference: f64,
    drift: f64,
    correction: f64,
    /// Gradients in the last frame in which the node was not lost.
    gradients: [f64; 2],
}

impl Sums {
    fn add(&mut self, evidence: &Evidence) {
        self.drift += (DIFFERENCE_FLOOR + evidence.difference.powi(2)) / (evidence.gradients[0] + GRADIENT_FLOOR).powi(2);
        self.correction += evidence.correction.powi(2);
        self.gradients = evidence.gradients;
    }
}

/// Quantities that all nodes of a frame share.
struct FrameContext {
    /// Neutral offsets of the live nodes, px.
    offsets: Vec<Vector2<f64>>,
    /// Their component-wise median.
    head: Vector2<f64>,
    difference: f64,
    /// Median shift that the skin's grey differences stand for, px.
    skin_offset: f64,
    has_skin: bool,
    lost: f64,
    has_evidence: bool,
}

impl FrameContext {
    fn new(frame: &TrackedFrame, neutral: &TrackedFrame, live: &[NodeId]) -> Self {
        let offset = |&id: &NodeId| match (frame.nodes.get(id.index()), neutral.nodes.get(id.index())) {
            (Some(node), Some(start)) => node.position - start.position,
            _ => Vector2::zeros(),
        };
        let offsets: Vec<Vector2<f64>> = live.iter().map(offset).collect();
        let (mut x, mut y): (Vec<f64>, Vec<f64>) = offsets.iter().map(|o| (o.x, o.y)).unzip();
        let head = Vector2::new(median(&mut x).unwrap_or(0.0), median(&mut y).unwrap_or(0.0));
        let nodes = || live.iter().filter_map(|id| frame.nodes.get(id.index()));
        let mut differences: Vec<f64> = nodes().filter_map(|n| Some(n.evidence?.difference)).collect();
        let has_skin = nodes().any(|n| n.skin.is_some());
        let mut skin_offsets: Vec<f64> = nodes().filter_map(|n| Some(n.skin?.offset_px())).collect();
        if !has_skin {
            skin_offsets = nodes().filter_map(|n| Some(n.evidence?.skin().offset_px())).collect();
        }
        Self {
            offsets,
            head,
            has_evidence: !differences.is_empty(),
            difference: median(&mut differences).unwrap_or(0.0),
            skin_offset: median(&mut skin_offsets).unwrap_or(0.0),
            has_skin,
            lost: frame.lost(live) as f64 / live.len().max(1) as f64,
        }
    }
}

/// Returns for every live node (by index) the indices of the live nodes one spring away.
fn neighbours(wireframe: &Wireframe) -> Vec<Vec<usize>> {
    let live = wireframe.live_nodes();
    let mut place = vec![None; wireframe.node_count()];
    live.iter().enumerate().for_each(|(k, n)| place[n.index()] = Some(k));
    let mut near = vec![Vec::new(); live.len()];
    for &(a, b) in wireframe.edges() {
        if let (Some(a), Some(b)) = (place[a.index()], place[b.index()]) {
            near[a].push(b);
            near[b].push(a);
        }
    }
    near
}

/// Weights and calibration of the expected error.
#[derive(Clone, Debug, PartialEq)]
pub struct Confidence {
    weights: Vec<f64>,
    /// Scores and logarithms of the expected error over ES0, both ascending.
    knots: Vec<(f64, f64)>,
}

/// A table of weights and calibration that does not read.
#[derive(Debug, thiserror::Error, PartialEq)]
#[error("line {line}: {reason}")]
pub struct ConfidenceError {
    /// Line, from 1.
    pub line: usize,
    /// What is wrong and what was expected.
    pub reason: String,
}

impl Confidence {
    /// Returns the model that is shipped with grimace.
    pub fn shipped() -> &'static Self {
        static SHIPPED: LazyLock<Confidence> =
            LazyLock::new(|| Confidence::parse(TABLE).unwrap_or_else(|error| unreachable!("track_confidence.csv: {error}")));
        &SHIPPED
    }

    /// Creates a model from weights in the order of [`NodeFeatures::names`] and at least one knot. Returns `None` for another number of
    /// weights or knots that do not ascend.
    #[must_use]
    pub fn new(weights: Vec<f64>, knots: Vec<(f64, f64)>) -> Option<Self> {
        let finite = weights.iter().chain(knots.iter().flat_map(|(s, e)| [s, e])).all(|v| v.is_finite());
        let ascending = knots.windows(2).all(|k| k[0].0 < k[1].0 && k[0].1 <= k[1].1);
        (finite && ascending && !knots.is_empty() && weights.len() == NodeFeatures::names().len())
            .then_some(Self { weights, knots })
    }

    /// Returns the score of a node: the sum of weights times terms.
    #[must_use]
    pub fn score(weights: &[f64], terms: &[f64]) -> f64 {
        weights.iter().zip(terms).map(|(w, f)| w * f).sum()
    }

    /// Returns the expected error of a node over the eye distance.
    #[must_use]
    pub fn expected(&self, features: &NodeFeatures) -> f64 {
        let score = Self::score(&self.weights, &features.terms());
        let (Some(&first), Some(&last)) = (self.knots.first(), self.knots.last()) else { return MAX_EXPECTED };
        let log = match self.knots.windows(2).find(|k| score < k[1].0) {
            _ if score <= first.0 => first.1,
            Some(k) => k[0].1 + (k[1].1 - k[0].1) * (score - k[0].0) / (k[1].0 - k[0].0),
            // Beyond the last knot the logarithm of the error grows with the score.
            None => last.1 + (score - last.0).max(0.0),
        };
        log.exp().min(MAX_EXPECTED)
    }

    /// Returns the table as CSV text.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = format!("{HEADER}\n");
        for (name, weight) in NodeFeatures::names().iter().zip(&self.weights) {
            let _ = writeln!(text, "{name},{weight:.6},");
        }
        for (score, error) in &self.knots {
            let _ = writeln!(text, "{KNOT},{score:.6},{error:.6}");
        }
        text
    }

    /// Parses the output of [`Confidence::to_csv`].
    ///
    /// # Errors
    /// [`ConfidenceError`] with the line number.
    pub fn parse(text: &str) -> Result<Self, ConfidenceError> {
        let names = NodeFeatures::names();
        let (mut weights, mut knots) = (Vec::new(), Vec::new());
        for (line, row) in (1..).zip(text.lines()) {
            let bad = |reason: String| ConfidenceError { line, reason };
            if line == 1 {
                if row != HEADER {
                    return Err(bad(format!("the header is `{row}`; expected `{HEADER}`")));
                }
                continue;
            }
            let fields: Vec<&str> = row.split(',').collect();
            let [term, value, calibrated] = fields[..] else {
                return Err(bad(format!("{} fields; expected 3", fields.len())));
            };
            let number = |text: &str| match text.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(value),
                _ => Err(bad(format!("`{text}` is not a finite number"))),
            };
            if term == KNOT {
                knots.push((number(value)?, number(calibrated)?));
            } else if names.get(weights.len()).is_some_and(|name| name == term) {
                weights.push(number(value)?);
            } else {
                let expected = names.get(weights.len()).map_or(KNOT, String::as_str);
                return Err(bad(format!("term `{term}` where `{expected}` was expected")));
            }
        }
        let line = text.lines().count();
        let reason = || "weights for every term and knots that ascend are needed".to_owned();
        Self::new(weights, knots).ok_or_else(|| ConfidenceError { line, reason: reason() })
    }
}

/// Writes the expected error (px) of every node into frames that have evidence; nodes in no triangle get the mean of the nodes they follow.
/// Frames without evidence keep their expected errors.
pub fn expect_errors(frames: &mut [TrackedFrame], wireframe: &Wireframe, tables: &Tables, confidence: &Confidence) {
    let features = node_features(frames, wireframe, tables);
    let neutral: Vec<Point2<f64>> = frames.first().map(|f| f.nodes.iter().map(|n| n.position).collect()).unwrap_or_default();
    let Some(unit) = eye_distance_px(tables, &neutral) else { return };
    let jumps = jump_errors(frames, wireframe.live_nodes(), unit);
    for ((frame, features), jumps) in frames.iter_mut().zip(features).zip(jumps) {
        for ((id, features), jump) in wireframe.live_nodes().iter().zip(&features).zip(jumps) {
            if let (Some(node), Some(features)) = (frame.nodes.get_mut(id.index()), features) {
                node.expected_error = Some((confidence.expected(features) * unit.max(SIZES.0)).hypot(jump));
            }
        }
        for follower in wireframe.followers() {
            let leaders = follower.leaders.iter().map(|n| frame.nodes.get(n.index())?.expected_error);
            let Some(errors) = leaders.collect::<Option<Vec<f64>>>() else { continue };
            if let Some(node) = frame.nodes.get_mut(follower.node.index()) {
                node.expected_error = Some(errors.iter().sum::<f64>() / errors.len().max(1) as f64);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::{LossReason, SkinMatch, TrackedNode};

    /// Two steps of a face 100 px wide per model unit: all nodes go 1 px right in each; the mouth corner goes 3 px more.
    fn frames(w: &Wireframe) -> Vec<TrackedFrame> {
        let node = |k: usize, shift: f64| TrackedNode {
            position: w.frontal()[k] * 100.0 + Vector2::new(shift, 0.0),
            state: if shift == 0.0 { NodeState::Fitted } else { NodeState::Tracked },
            residual: (shift > 0.0).then_some(0.3),
            evidence: (shift > 0.0).then_some(Evidence { difference: 2.0, gradients: [1.0, 4.0], correction: 0.4 }),
            skin: (shift > 0.0).then_some(SkinMatch { difference: 3.0, gradient: 6.0 }),
            expected_error: None,
        };
        let frame = |number: u32, shift: f64| TrackedFrame { number, nodes: (0..113).map(|k| node(k, shift)).collect() };
        let mut frames = vec![frame(1, 0.0), frame(2, 1.0), frame(3, 2.0)];
        frames[2].nodes[31].position.x += 3.0;
        frames[2].nodes[31].state = NodeState::Recovered(LossReason::Klt);
        frames[2].nodes[31].evidence = None;
        frames
    }

    #[test]
    fn features_are_read_off_the_track() {
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        let features = node_features(&frames(&w), &w, &t);
        assert!(features[0].iter().all(Option::is_none));
        let place = |node: u16| w.live_nodes().iter().position(|&n| n == NodeId(node)).unwrap();
        let unit = 61.3; // ES0 of Candide-3 is 0.613 model units
        let chin = features[2][place(10)].unwrap();
        assert_eq!((chin.region, chin.lost, chin.frames, chin.lost_share), (Region::Jaw, false, 2.0, 0.0));
        // Two residuals of 0.3: sqrt(0.18) = 0.4243. Two corrections of 0.4: 0.5657.
        assert!((chin.residual * unit - 0.4243).abs() < 1e-3 && (chin.corrections * unit - 0.5657).abs() < 1e-3);
        // (0.05 + 4) / (1 + 0.2)^2 = 2.8125, twice: sqrt(5.625) = 2.3717.
        assert!((chin.drift * unit - 2.3717).abs() < 1e-3);
        assert!((chin.head * unit - 2.0).abs() < 1e-9 && chin.offset < 1e-12 && (chin.step * unit - 1.0).abs() < 1e-9);
        assert!((chin.frame_lost - 1.0 / 104.0).abs() < 1e-12);
        let corner = features[2][place(31)].unwrap();
        assert!(corner.lost && (corner.lost_share - 0.5).abs() < 1e-12 && (corner.offset * unit - 3.0).abs() < 1e-9);
        // Lost: the median difference of the frame, and the gradients of the previous frame.
        assert!((corner.difference - 2.0).abs() < 1e-12 && (corner.gradients[0] - unit).abs() < 1e-9);
        assert!(corner.strain > 0.04);
        // The skin is compared around lost nodes, too: 3 grey levels where they change by 6 a px are half a px.
        assert!(corner.skin_difference == 3.0 && (corner.skin_offset * unit - 0.5).abs() < 1e-9);
        assert_eq!(corner.frame_skin_offset, corner.skin_offset);
    }

    #[test]
    fn a_node_without_skin_has_the_shift_of_the_face() {
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        let mut frames = frames(&w);
        frames[1].nodes[10].skin = None;
        frames[1].nodes[20].skin = Some(SkinMatch { difference: 3.0, gradient: 0.0 });
        let place = |node: u16| w.live_nodes().iter().position(|&n| n == NodeId(node)).unwrap();
        let features = node_features(&frames, &w, &t);
        let [none, flat] = [10, 20].map(|node| features[1][place(node)].unwrap());
        assert_eq!((none.skin_difference, none.skin_offset), (2.0, none.frame_skin_offset));
        // Skin without texture: 3 grey levels over the least gradient, 0.2 a px.
        assert!((flat.skin_offset * 61.3 - 15.0).abs() < 1e-9);
        // Without any skin: twice 2 grey levels over gradients of 1 and 4.
        frames[1].nodes.iter_mut().for_each(|node| node.skin = None);
        let without = node_features(&frames, &w, &t)[1][place(10)].unwrap();
        assert!((without.skin_offset * 61.3 - 4.0 / 17.0_f64.sqrt()).abs() < 1e-9);
        assert_eq!((without.skin_difference, without.skin_offset), (4.0, without.frame_skin_offset));
    }

    #[test]
    fn grey_differences_do_not_fall_when_motion_slows_down() {
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        let mut frames = frames(&w);
        let differences = |frame: &mut TrackedFrame, difference: f64| {
            frame.nodes.iter_mut().for_each(|n| n.evidence = n.evidence.map(|e| Evidence { difference, ..e }));
        };
        frames[1].nodes[10].evidence = Some(Evidence { difference: 5.0, gradients: [1.0, 4.0], correction: 0.4 });
        differences(&mut frames[2], 0.5);
        frames.push(frames[2].clone());
        differences(&mut frames[3], 3.0);
        let features = node_features(&frames, &w, &t);
        let place = |node: u16| w.live_nodes().iter().position(|&n| n == NodeId(node)).unwrap();
        let of = |frame: usize, node: u16| features[frame][place(node)].map(|f| (f.difference, f.frame_difference));
        // All differ by 2, 0.5 and 3 grey levels, the chin (node 10) by 5 at first; the mouth corner (31) is lost from the second step on.
        assert_eq!([of(1, 10), of(2, 10), of(3, 10)], [Some((5.0, 2.0)), Some((5.0, 2.0)), Some((5.0, 3.0))]);
        assert_eq!([of(1, 31), of(2, 31), of(3, 31)], [Some((2.0, 2.0)), Some((2.0, 2.0)), Some((3.0, 3.0))]);
    }

    #[test]
    fn scores_are_calibrated_between_knots_and_grow_beyond() {
        // Only `lost` counts: scores 0 and 2.
        let mut weights = vec![0.0; NodeFeatures::names().len()];
        weights[1] = 2.0;
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        let tracked = node_features(&frames(&w), &w, &t)[1][0].unwrap();
        let lost = NodeFeatures { lost: true, ..tracked };
        let log = |x: f64| x.ln();
        let between = Confidence::new(weights.clone(), vec![(0.0, log(0.01)), (4.0, log(0.04))]).unwrap();
        assert!((between.expected(&tracked) - 0.01).abs() < 1e-12);
        // Half way in the logarithm: 0.02.
        assert!((between.expected(&lost) - 0.02).abs() < 1e-12);
        // One beyond the last knot: e times as much.
        let beyond = Confidence::new(weights.clone(), vec![(1.0, log(0.01))]).unwrap();
        assert!((beyond.expected(&lost) - 0.01 * std::f64::consts::E).abs() < 1e-12);
        assert_eq!(Confidence::new(weights.clone(), vec![(1.0, 2.0), (2.0, 1.0)]), None);
        assert_eq!(Confidence::new(weights[1..].to_vec(), vec![(1.0, 2.0)]), None);
    }

    #[test]
    fn nodes_get_their_expected_error_and_followers_that_of_their_leaders() {
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        let mut weights = vec![0.0; NodeFeatures::names().len()];
        weights[1] = 1.0;
        let confidence = Confidence::new(weights, vec![(0.0, 0.01_f64.ln())]).unwrap();
        let mut frames = frames(&w);
        expect_errors(&mut frames, &w, &t, &confidence);
        assert!(frames[0].nodes.iter().all(|n| n.expected_error.is_none()));
        // 0.01 of 61.3 px; node 4 is in no triangle.
        assert!((frames[1].nodes[10].expected_error.unwrap() - 0.613).abs() < 1e-9);
        assert!((frames[1].nodes[4].expected_error.unwrap() - 0.613).abs() < 1e-9);
        assert!((frames[2].nodes[31].expected_error.unwrap() - 0.613 * std::f64::consts::E).abs() < 1e-9);
    }

    #[test]
    fn tables_are_written_and_read_back_and_bad_ones_named() {
        let shipped = Confidence::shipped();
        assert_eq!(&Confidence::parse(&shipped.to_csv()).unwrap(), shipped);
        let message = |text: &str| Confidence::parse(text).unwrap_err().to_string();
        assert!(message("a,b\n").contains("line 1: the header is `a,b`"));
        assert!(message(&format!("{HEADER}\nlost,1,\n")).contains("line 2: term `lost` where `one` was expected"));
        assert!(message(&format!("{HEADER}\none,x,\n")).contains("line 2: `x` is not a finite number"));
        assert!(message(&format!("{HEADER}\none,1\n")).contains("2 fields"));
        assert!(message(&format!("{HEADER}\none,1,\n")).contains("weights for every term"));
    }
}
