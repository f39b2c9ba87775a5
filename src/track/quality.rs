//! Summarizes in a few numbers how well a sequence was tracked, and judges whether a person should look at it again.

use std::collections::BTreeMap;

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::{Look, LossReason, NodeState, TrackedFrame, TrackedNode, eye_distance_px};
use crate::{
    geometry::Similarity,
    robust::median,
    units::{NodeId, SequenceId},
    wireframe::{Region, Tables, Wireframe},
};

/// Most worst nodes that a summary lists.
const WORST_NODES: usize = 5;
/// Most regions that a reason lists.
const WORST_REGIONS: usize = 3;

/// Limit of the median expected error at the apex, over the eye distance. Above it the verdict is "look again"; so it is when more than one
/// node in ten exceeds [`WORST_LIMIT`].
const MEDIAN_LIMIT: f64 = 0.02;
/// Limit of a single node's expected error, over the eye distance; see [`MEDIAN_LIMIT`].
const WORST_LIMIT: f64 = 0.06;
/// Limit of the mean expected error at the apex of a region that FAPs measure, over the eye distance. Above it the verdict is "look again".
/// A node's error is the root of the sum of squares of its position error on the neutral face and its motion error since.
const REGION_LIMIT: f64 = 0.05;
/// The regions that FAPs measure.
const MEASURED: [Region; 4] = [Region::Brow, Region::Eye, Region::Mouth, Region::Jaw];
/// Limit of the share of lost (node, frame) pairs. Above it the verdict is "look again".
const LOST_LIMIT: f64 = 0.1;
/// Limit of the share of nodes lost in one frame. Above it the verdict is "look again".
const FRAME_LOST_LIMIT: f64 = 0.35;
/// Fewest nodes that must move, and by how much, over the eye distance, relative to the head's motion at the apex. With fewer, nothing
/// moves in the sequence. In 50 sequences of photographed people, six expressions, the fifth node moves by at least 4.6 %, in one that
/// begins with a smile by 3.8 %, and by less than 0.001 % where one picture is repeated.
const STILL: (usize, f64) = (5, 0.01);
/// Frames count as missing where the frame number jumps by more than this many usual steps.
const GAP_STEPS: u32 = 3;
/// A gap is reported when it is longer than this share of the sequence.
const GAP_SHARE: f64 = 0.25;

/// Whether a person should look at a tracked sequence again. A warning, never a failure.
///
/// ```
/// use grimace::track::Verdict;
///
/// let said = |verdict| match verdict {
///     Verdict::Good => "use it",
///     Verdict::LookAgain => "look at it",
/// };
/// assert_eq!(said(Verdict::default()), "use it");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// No reason to look again.
    #[default]
    Good,
    /// See [`TrackSummary::reasons`].
    LookAgain,
}

impl Verdict {
    /// The verdict in words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::LookAgain => "look again",
        }
    }
}

/// Summary of one track.
///
/// ```
/// # let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let track = grimace::track::read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// use grimace::track::{TrackSummary, summarize};
///
/// // `track` holds the ten frames of a smile.
/// let TrackSummary { frames, tracked_share, recovered, .. } = summarize(&track, &wireframe, &tables);
/// assert_eq!((frames, tracked_share, recovered.len()), (10, 1.0, 0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackSummary {
    /// Frames from neutral to apex.
    pub frames: usize,
    /// Share of (live node, frame) pairs after the neutral frame that were tracked or corrected, 0 to 1.
    pub tracked_share: f64,
    /// Mean forward-backward distance of tracked nodes, px.
    pub mean_residual_px: f64,
    /// Eye distance ES0 in the neutral frame, px.
    pub eye_distance_px: f64,
    /// Recovered (live node, frame) pairs by reason.
    pub recovered: BTreeMap<String, usize>,
    /// Live nodes most often recovered, with the number of frames, worst first, at most five.
    pub worst_nodes: Vec<(NodeId, usize)>,
    /// Median over the live nodes of the expected error of their position on the neutral face, px; `None` when unknown.
    #[serde(default)]
    pub placement_error_px: Option<f64>,
    /// Median over the live nodes of the expected error of their motion at the apex frame, px; `None` for a track without expected errors.
    #[serde(default)]
    pub expected_error_px: Option<f64>,
    /// Whether a person should look at the track again.
    #[serde(default)]
    pub verdict: Verdict,
    /// Reasons to look again, one sentence each.
    #[serde(default)]
    pub reasons: Vec<String>,
    /// The reasons among `reasons` that list given marks that lie beside the face of the neutral frame.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub beside: Vec<String>,
    /// The reason among `reasons` that lists the parts of the face covered in the neutral frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covered: Option<String>,
    /// The reason among `reasons` that says that the mouth of the neutral frame looks less neutral than that of the apex frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mouth_back: Option<String>,
    /// The reason among `reasons` that lists the parts of the face that something covers in the apex frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covered_at_apex: Option<String>,
}

impl TrackSummary {
    /// Returns a length of the neutral frame, px, in percent of the eye distance; `None` when the eye distance is unknown.
    pub(crate) fn percent_of_eyes(&self, px: f64) -> Option<f64> {
        (self.eye_distance_px > 0.0).then(|| 100.0 * px / self.eye_distance_px)
    }

    /// Adds reasons to look again.
    fn with_reasons(mut self, reasons: impl IntoIterator<Item = String>) -> Self {
        let before = self.reasons.len();
        self.reasons.extend(reasons);
        if self.reasons.len() > before {
            self.verdict = Verdict::LookAgain;
        }
        self
    }

    /// Adds the covered parts of the face as a reason to look again.
    #[must_use]
    pub(crate) fn with_covered(self, covered: Option<String>) -> Self {
        Self { covered: covered.clone(), ..self.with_reasons(covered) }
    }

    /// Adds a mouth that moves back to neutral as a reason to look again.
    #[must_use]
    pub(crate) fn with_mouth_back(self, mouth_back: Option<String>) -> Self {
        Self { mouth_back: mouth_back.clone(), ..self.with_reasons(mouth_back) }
    }

    /// Adds parts that something covers in the apex frame as a reason to look again.
    #[must_use]
    pub(crate) fn with_covered_at_apex(self, covered: Option<String>) -> Self {
        Self { covered_at_apex: covered.clone(), ..self.with_reasons(covered) }
    }

    /// Copies the findings from the pictures out of `earlier`, a summary of the same track: the frames alone cannot give them.
    #[must_use]
    pub(crate) fn told_by_the_pictures_of(self, earlier: &Self) -> Self {
        self.with_marks_beside(earlier.beside.clone())
            .with_covered(earlier.covered.clone())
            .with_mouth_back(earlier.mouth_back.clone())
            .with_covered_at_apex(earlier.covered_at_apex.clone())
    }

    /// Adds marks that lie beside the face as reasons to look again.
    #[must_use]
    pub(crate) fn with_marks_beside(self, beside: Vec<String>) -> Self {
        Self { beside: beside.clone(), ..self.with_reasons(beside) }
    }
}

/// How well one sequence was tracked: its summary with its name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackQuality {
    /// The sequence.
    pub id: SequenceId,
    /// Emotion label.
    pub emotion: String,
    /// The summary.
    pub summary: TrackSummary,
    /// Quality of every frame after the neutral one; empty when the frames are not available.
    #[serde(default)]
    pub course: Vec<FrameQuality>,
    /// Small JPEG files of the wireframe on the neutral and the apex frame; `None` where there are no pictures or they may not be shown.
    #[serde(skip)]
    pub pictures: Option<[Vec<u8>; 2]>,
    /// Identifies its pictures and its nodes, for looks at it; empty if unknown.
    #[serde(default)]
    pub content: String,
    /// What a person found when looking at it.
    #[serde(default)]
    pub look: Option<Look>,
}

impl TrackQuality {
    /// Creates the quality of a track, without pictures.
    pub fn new(id: SequenceId, emotion: String, summary: TrackSummary, frames: &[TrackedFrame], wireframe: &Wireframe) -> Self {
        Self { id, emotion, summary, course: course(frames, wireframe), pictures: None, content: String::new(), look: None }
    }

    /// Whether a person should look at it: there is a reason, and nobody has looked at it as it is.
    pub fn is_to_look_at(&self) -> bool {
        self.summary.verdict == Verdict::LookAgain && !matches!(self.look, Some(Look::Right | Look::LeaveOut))
    }

    /// Whether a person has looked at it and left it out of the statistics.
    pub fn is_left_out(&self) -> bool {
        self.look == Some(Look::LeaveOut)
    }
}

/// How well one frame was tracked.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameQuality {
    /// Share of the live nodes that were lost, 0 to 1.
    pub lost: f64,
    /// Median expected error of the live nodes, px; `None` when unknown.
    pub expected_error_px: Option<f64>,
}

/// Returns the quality of every frame after the neutral one.
pub fn course(frames: &[TrackedFrame], wireframe: &Wireframe) -> Vec<FrameQuality> {
    let live = wireframe.live_nodes();
    let frame = |frame: &TrackedFrame| {
        let nodes: Vec<_> = live.iter().filter_map(|id| frame.nodes.get(id.index())).collect();
        let lost = nodes.iter().filter(|n| n.state.loss().is_some()).count();
        let mut errors: Vec<f64> = nodes.iter().filter_map(|n| n.expected_error).collect();
        FrameQuality { lost: lost as f64 / nodes.len().max(1) as f64, expected_error_px: median(&mut errors) }
    };
    frames.iter().skip(1).map(frame).collect()
}

/// Summarizes the frames of a track.
///
/// ```
/// # let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let track = grimace::track::read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// use grimace::track::summarize;
///
/// // `track` holds the ten frames of a smile.
/// let summary = summarize(&track, &wireframe, &tables);
/// assert_eq!(summary.frames, 10);
/// assert!((summary.eye_distance_px - 70.0).abs() < 5.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn summarize(frames: &[TrackedFrame], wireframe: &Wireframe, tables: &Tables) -> TrackSummary {
    let live = wireframe.live_nodes();
    let mut recovered = BTreeMap::new();
    let mut losses: BTreeMap<NodeId, usize> = BTreeMap::new();
    let (mut tracked, mut pairs) = (0usize, 0usize);
    let (mut residual_sum, mut residuals) = (0.0, 0usize);
    for frame in frames.iter().skip(1) {
        for &id in live {
            let Some(node) = frame.nodes.get(id.index()) else { continue };
            pairs += 1;
            match node.state {
                NodeState::Recovered(reason) => {
                    *recovered.entry(reason.name().to_owned()).or_insert(0) += 1;
                    // A node without a landmark is never tracked, so this says nothing about the node.
                    if reason != LossReason::NoLandmark {
                        *losses.entry(id).or_insert(0) += 1;
                    }
                }
                _ => tracked += 1,
            }
            if let (NodeState::Tracked, Some(residual)) = (node.state, node.residual) {
                residual_sum += residual;
                residuals += 1;
            }
        }
    }
    let mut worst_nodes: Vec<_> = losses.into_iter().collect();
    worst_nodes.sort_by_key(|&(node, count)| (std::cmp::Reverse(count), node));
    worst_nodes.truncate(WORST_NODES);
    let share = |part: f64, whole: usize| if whole == 0 { 0.0 } else { part / whole as f64 };
    let neutral: Vec<Point2<f64>> = frames.first().map(|f| f.nodes.iter().map(|n| n.position).collect()).unwrap_or_default();
    let mut summary = TrackSummary {
        frames: frames.len(),
        tracked_share: share(tracked as f64, pairs),
        mean_residual_px: share(residual_sum, residuals),
        eye_distance_px: eye_distance_px(tables, &neutral).unwrap_or(0.0),
        recovered,
        worst_nodes,
        placement_error_px: None,
        expected_error_px: None,
        verdict: Verdict::Good,
        reasons: Vec::new(),
        beside: Vec::new(),
        covered: None,
        mouth_back: None,
        covered_at_apex: None,
    };
    judge(&mut summary, frames, wireframe, tables);
    summary
}

/// Fills in expected errors, verdict and reasons.
fn judge(summary: &mut TrackSummary, frames: &[TrackedFrame], wireframe: &Wireframe, tables: &Tables) {
    let live = wireframe.live_nodes();
    let Some((neutral, later)) = frames.split_first() else { return };
    let placed = |&id: &NodeId| neutral.nodes.get(id.index()).and_then(|n| n.expected_error);
    let mut placements: Vec<f64> = live.iter().filter_map(placed).collect();
    summary.placement_error_px = median(&mut placements);
    let expected = |&id: &NodeId| later.last().and_then(|apex| apex.nodes.get(id.index())?.expected_error);
    let mut errors: Vec<f64> = live.iter().filter_map(expected).collect();
    summary.expected_error_px = median(&mut errors);
    let unit = summary.eye_distance_px;
    let percent = |px: f64| 100.0 * px / unit;
    let mut reasons = Vec::new();
    if let Some(middle) = summary.expected_error_px.filter(|&e| e > MEDIAN_LIMIT * unit) {
        let percent = percent(middle);
        reasons.push(format!(
            "at the apex the median expected error of the nodes is {middle:.1} px ({percent:.1} % of the eye distance)"
        ));
    }
    let far: Vec<&NodeId> = live.iter().filter(|id| expected(id).is_some_and(|e| e > WORST_LIMIT * unit)).collect();
    if 10 * far.len() > live.len() {
        let (count, limit) = (far.len(), WORST_LIMIT * unit);
        let (share, of) = (percent(limit), live.len());
        let regions = Region::ALL.map(|region| (far.iter().filter(|&&&id| tables.region(id) == region).count(), region));
        let mut worst: Vec<_> = regions.into_iter().filter(|(count, _)| *count > 0).collect();
        worst.sort_by_key(|&(count, region)| (std::cmp::Reverse(count), region));
        let list =
            worst.iter().take(WORST_REGIONS).map(|(count, region)| format!("{region} {count}")).collect::<Vec<_>>().join(", ");
        reasons.push(format!(
            "at the apex {count} of {of} nodes have an expected error above {limit:.1} px ({share:.0} % of the eye distance): {list}"
        ));
    }
    // Whether a reason is that the motion is expected to be wrong.
    let mut is_motion = !reasons.is_empty();
    for region in MEASURED {
        let nodes: Vec<[f64; 2]> = live
            .iter()
            .filter(|&&id| tables.region(id) == region)
            .filter_map(|id| Some([placed(id)?, expected(id).unwrap_or(0.0)]))
            .collect();
        let mean = |of: fn(&[f64; 2]) -> f64| nodes.iter().map(of).sum::<f64>() / nodes.len().max(1) as f64;
        let both = mean(|[placed, moved]| placed.hypot(*moved));
        if both > REGION_LIMIT * unit {
            let (sits, moves) = (percent(mean(|e| e[0])), percent(mean(|e| e[1])));
            is_motion |= moves > sits;
            let hint = if sits > moves {
                format!("; mark the {region} in the neutral frame, or, if you set marks, try without them")
            } else {
                String::new()
            };
            reasons.push(format!(
                "{region}: the expected error at the apex is {both:.1} px ({:.1} % of the eye distance; its place on the face {sits:.1} \
                 %, its motion {moves:.1} %){hint}",
                percent(both)
            ));
        }
    }
    // Counts the nodes lost in a frame and the nodes that can be lost: a node without a landmark is never tracked, so it cannot be lost. A
    // node that the located face placed counts as seen; its expected error says how well.
    let lost = |frame: &TrackedFrame| {
        let states = live.iter().filter_map(|id| frame.nodes.get(id.index())).map(|n| n.state.loss());
        let could_be = states.filter(|&loss| loss != Some(LossReason::NoLandmark));
        could_be.fold((0, 0), |(lost, of), loss| (lost + usize::from(loss.is_some_and(|loss| loss != LossReason::Jump)), of + 1))
    };
    let by_frame: Vec<((usize, usize), u32)> = frames.iter().skip(1).map(|f| (lost(f), f.number)).collect();
    let (all_lost, all) = by_frame.iter().fold((0, 0), |(lost, of), &((l, o), _)| (lost + l, of + o));
    let before = reasons.len();
    if all_lost as f64 > LOST_LIMIT * all as f64 {
        reasons.push(format!("{:.0} % of the nodes were lost in all frames together", 100.0 * all_lost as f64 / all as f64));
    }
    let worst_frame = by_frame.into_iter().max_by_key(|&((count, _), number)| (count, std::cmp::Reverse(number)));
    if let Some(((count, of), number)) = worst_frame.filter(|&((count, of), _)| count as f64 > FRAME_LOST_LIMIT * of as f64) {
        reasons.push(format!("{count} of {of} nodes were lost in frame {number}"));
    }
    if let ([apex], true) = (later, (reasons.len() > before && by_images(later)) || (is_motion && jumps(later))) {
        reasons.push(two_pictures_said(neutral.number, apex.number, "lie"));
    }
    if let Some(apex) = later.last().filter(|apex| !moves(neutral, apex, live, unit)) {
        reasons.push(format!(
            "the face does not move: in frame {} fewer than {} nodes are more than {:.1} px ({:.0} % of the eye distance) from their \
             place in frame {}",
            apex.number,
            STILL.0,
            STILL.1 * unit,
            100.0 * STILL.1,
            neutral.number
        ));
    }
    reasons.extend(missing_said(frames.iter().map(|frame| frame.number)));
    summary.verdict = if reasons.is_empty() { Verdict::Good } else { Verdict::LookAgain };
    summary.reasons = reasons;
}

/// Returns the message about a sequence of two pictures, before or after tracking.
pub(crate) fn two_pictures_said(neutral: u32, apex: u32, lie: &str) -> String {
    format!(
        "there are only two pictures, {neutral} and {apex}, and they {lie} far apart for a tracker, which follows small steps; landmarks in \
         both (--prefer-landmarks), or a video of the motion between them, give better tracks"
    )
}

/// Whether nodes were placed by a face that was located again.
fn jumps(later: &[TrackedFrame]) -> bool {
    later.iter().flat_map(|frame| &frame.nodes).any(|node| node.state.loss() == Some(LossReason::Jump))
}

/// Whether nodes were searched for in pictures: then they have a residual, or a loss reason that does not occur with landmarks.
fn by_images(later: &[TrackedFrame]) -> bool {
    let looked_for = |node: &TrackedNode| match node.state {
        NodeState::Tracked => node.residual.is_some(),
        NodeState::Recovered(reason) => matches!(reason, LossReason::Klt | LossReason::ForwardBackward | LossReason::Outside),
        _ => false,
    };
    later.iter().flat_map(|frame| &frame.nodes).any(looked_for)
}

/// Returns the message about missing frames in a sequence with these frame numbers, if any.
pub(crate) fn missing_said(numbers: impl Iterator<Item = u32>) -> Option<String> {
    let (first, last) = missing_frames(numbers.collect())?;
    Some(format!(
        "frames {first} to {last} are missing: the motion between them is unknown, and the model uses the nearest frames"
    ))
}

/// Returns the first and last frame number of the longest gap, if it is long enough (see [`GAP_STEPS`] and [`GAP_SHARE`]).
fn missing_frames(mut numbers: Vec<u32>) -> Option<(u32, u32)> {
    numbers.sort_unstable();
    let span = numbers.last()? - numbers.first()?;
    let mut steps: Vec<(u32, u32)> = numbers.windows(2).map(|pair| (pair[1] - pair[0], pair[0])).collect();
    steps.sort_unstable();
    let usual = steps.get(steps.len() / 2)?.0.max(1);
    let &(longest, before) = steps.last()?;
    let matters = longest / usual > GAP_STEPS && f64::from(longest) > GAP_SHARE * f64::from(span);
    matters.then(|| (before + usual, before + longest - usual))
}

/// Whether enough nodes move far enough (see [`STILL`]); `true` when this cannot be determined.
fn moves(neutral: &TrackedFrame, apex: &TrackedFrame, live: &[NodeId], eye_distance: f64) -> bool {
    let pair = |id: &NodeId| Some((neutral.nodes.get(id.index())?.position, apex.nodes.get(id.index())?.position));
    let (from, to): (Vec<Point2<f64>>, Vec<Point2<f64>>) = live.iter().filter_map(pair).unzip();
    let Ok(head) = Similarity::fit(&from, &to, None) else { return true };
    let far = from.iter().zip(&to).filter(|(from, to)| (head.apply(from) - **to).norm() > STILL.1 * eye_distance);
    far.count() >= STILL.0
}

#[cfg(test)]
mod tests {
    use super::*;
    #[test]
    fn shares_and_worst_nodes_are_counted() {
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        let node = |k: usize, state, residual| TrackedNode::new(w.frontal()[k] * 100.0, state, residual);
        let neutral = (0..113).map(|k| node(k, NodeState::Fitted, None)).collect();
        let mut moved: Vec<_> = (0..113).map(|k| node(k, NodeState::Tracked, Some(0.5))).collect();
        moved[31].state = NodeState::Recovered(LossReason::Extreme);
        moved[4].state = NodeState::Follows; // not live: does not count
        let frames = [neutral, moved.clone(), moved].map(|nodes| TrackedFrame { number: 1, nodes });
        let summary = summarize(&frames, &w, &t);
        assert_eq!(summary.frames, 3);
        assert!((summary.tracked_share - 103.0 / 104.0).abs() < 1e-12);
        assert!((summary.mean_residual_px - 0.5).abs() < 1e-12);
        assert!((summary.eye_distance_px - 61.3).abs() < 1e-9);
        assert_eq!(summary.recovered, BTreeMap::from([("extreme".to_owned(), 2)]));
        assert_eq!(summary.worst_nodes, [(NodeId(31), 2)]);
    }

    #[test]
    fn what_the_pictures_told_is_carried_over() {
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        let nodes: Vec<_> = w.frontal().iter().map(|&p| TrackedNode::new(p * 100.0, NodeState::Fitted, None)).collect();
        let again = || summarize(&[TrackedFrame { number: 1, nodes: nodes.clone() }], &w, &t);
        let covered = "the mouth is covered".to_owned();
        let back = "back to neutral".to_owned();
        let earlier = again().with_marks_beside(vec!["the chin".to_owned()]).with_covered(Some(covered.clone()));
        let hand = "a hand".to_owned();
        let earlier = earlier.with_mouth_back(Some(back.clone())).with_covered_at_apex(Some(hand.clone()));
        let told = again().told_by_the_pictures_of(&earlier);
        assert_eq!(told, earlier);
        assert_eq!((told.verdict, told.covered), (Verdict::LookAgain, Some(covered.clone())));
        assert!(told.reasons.ends_with(&["the chin".to_owned(), covered, back, hand]), "{:?}", told.reasons);
        assert_eq!(again().told_by_the_pictures_of(&again()), again());
    }

    #[test]
    fn missing_frames_are_reported_where_they_matter() {
        let gap = |numbers: &[u32]| missing_frames(numbers.to_vec());
        let without = |from: u32, to: u32| (1..=24).filter(|n| !(from..=to).contains(n)).collect::<Vec<u32>>();
        assert_eq!(gap(&without(14, 23)), Some((14, 23)));
        assert_eq!(gap(&without(14, 16)), None);
        assert_eq!(gap(&[1, 40]), None);
        assert_eq!(gap(&[10, 20, 30, 40]), None);
        // Every tenth frame, the later one first.
        assert_eq!(gap(&[200, 190, 180, 80, 70, 60]), Some((90, 170)));
    }

    /// A face of 61.3 px between the pupils, in whose later frames every third node goes 1 px further down.
    fn place(w: &Wireframe, number: u32, k: usize) -> Point2<f64> {
        let down = if k.is_multiple_of(3) { f64::from(number) } else { 0.0 };
        Point2::new(w.frontal()[k].x * 100.0, w.frontal()[k].y * 100.0 + down)
    }

    #[test]
    fn a_still_face_has_the_verdict_look_again() {
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        // The head shifts and rotates; relative to it only the first `count` live nodes move, by 1 px of 61.3.
        let frame = |number: u32, count: usize| TrackedFrame {
            number,
            nodes: (0..113)
                .map(|k| {
                    let p = place(&w, 0, k);
                    let moved = w.live_nodes().iter().take(count).any(|id| id.index() == k);
                    let p = Point2::new(p.x + if moved { 1.0 } else { 0.0 }, p.y);
                    let (sin, cos) = (0.1 * f64::from(number - 1)).sin_cos();
                    let turned = Point2::new(cos * p.x - sin * p.y + 5.0 * f64::from(number), sin * p.x + cos * p.y);
                    TrackedNode::new(turned, if number == 1 { NodeState::Fitted } else { NodeState::Tracked }, None)
                })
                .collect(),
        };
        let still = summarize(&[frame(1, 0), frame(2, 0)], &w, &t);
        assert_eq!(still.verdict, Verdict::LookAgain);
        let said = "the face does not move: in frame 2 fewer than 5 nodes are more than 0.6 px (1 % of the eye distance) from their place in frame 1";
        assert_eq!(still.reasons, [said]);
        assert_eq!(summarize(&[frame(1, 0), frame(2, 4)], &w, &t).reasons, [said]);
        assert_eq!(summarize(&[frame(1, 0), frame(2, 6)], &w, &t).verdict, Verdict::Good);
    }

    #[test]
    fn two_distant_pictures_are_reported_if_nodes_were_lost() {
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        let frame = |number: u32, lost: usize, reason| TrackedFrame {
            number,
            nodes: (0..113)
                .map(|k| {
                    let is_lost = number > 1 && w.live_nodes().iter().take(lost).any(|id| id.index() == k);
                    let state = if is_lost { NodeState::Recovered(reason) } else { NodeState::Tracked };
                    TrackedNode::new(place(&w, number, k), if number == 1 { NodeState::Fitted } else { state }, None)
                })
                .collect(),
        };
        let said = |frames: &[TrackedFrame]| {
            let reasons = summarize(frames, &w, &t).reasons;
            reasons.iter().any(|r| r.starts_with("there are only two pictures, 1 and 2, and they lie far apart for a tracker"))
        };
        let of = |lost, reason| [frame(1, 0, reason), frame(2, lost, reason)];
        // 104 live nodes: 11 are more than a tenth.
        assert!(said(&of(11, LossReason::Klt)) && !said(&of(10, LossReason::Klt)));
        assert!(!said(&of(11, LossReason::LostFrame)), "landmarks were there");
        assert!(!said(&of(60, LossReason::Jump)), "placed by the located face, with no other reason to look again");
        let mut vague = of(60, LossReason::Jump);
        // Two thirds of the nodes are expected to be 5 % of the eye distance off.
        vague[1].nodes.iter_mut().take(80).for_each(|n| n.expected_error = Some(3.1));
        assert!(said(&vague));
        let [neutral, apex] = of(11, LossReason::Klt);
        assert!(!said(&[neutral, frame(3, 11, LossReason::Klt), apex]), "three pictures");
    }

    #[test]
    fn a_region_with_large_placement_errors_has_the_verdict_look_again() {
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        // 61.3 px between the pupils; the limit is 3.065 px.
        let frame = |number: u32, brow: f64| TrackedFrame {
            number,
            nodes: (0..113)
                .map(|k| {
                    let expected = if t.region(NodeId(k as u16)) == Region::Brow { brow } else { 0.5 };
                    let state = if number == 1 { NodeState::Fitted } else { NodeState::Tracked };
                    TrackedNode { expected_error: Some(expected), ..TrackedNode::new(place(&w, number, k), state, None) }
                })
                .collect(),
        };
        let good = summarize(&[frame(1, 2.0), frame(2, 0.5)], &w, &t);
        assert_eq!((good.verdict, good.placement_error_px, good.expected_error_px), (Verdict::Good, Some(0.5), Some(0.5)));
        // A position error of 3 px and a motion error of 1 px give sqrt(10) px.
        let again = summarize(&[frame(1, 3.0), frame(2, 1.0)], &w, &t);
        assert_eq!(again.verdict, Verdict::LookAgain);
        assert_eq!(
            again.reasons,
            [
                "brow: the expected error at the apex is 3.2 px (5.2 % of the eye distance; its place on the face 4.9 %, its motion 1.6 \
                 %); mark the brow in the neutral frame, or, if you set marks, try without them"
            ]
        );
    }

    #[test]
    fn a_node_without_a_landmark_is_not_lost() {
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        let frame = |number: u32, state: fn(usize) -> NodeState| TrackedFrame {
            number,
            nodes: (0..113).map(|k| TrackedNode::new(place(&w, number, k), state(k), None)).collect(),
        };
        let neutral = || frame(0, |_| NodeState::Fitted);
        let without = |k: usize| k.is_multiple_of(2);
        // Half of the nodes have no landmark: still good.
        let driven = frame(1, |k| if k % 2 == 0 { NodeState::Recovered(LossReason::NoLandmark) } else { NodeState::Tracked });
        assert_eq!(summarize(&[neutral(), driven.clone()], &w, &t).verdict, Verdict::Good);
        // A frame without landmarks loses the nodes that have one, and these are counted.
        let lost = frame(2, |_| NodeState::Recovered(LossReason::LostFrame));
        let summary = summarize(&[neutral(), driven, lost], &w, &t);
        let with = w.live_nodes().iter().filter(|id| !without(id.index())).count();
        let share = 100.0 * 104.0 / (104 + with) as f64;
        let expected = [
            format!("{share:.0} % of the nodes were lost in all frames together"),
            "104 of 104 nodes were lost in frame 2".to_owned(),
        ];
        assert_eq!(summary.reasons, expected);
    }
}
