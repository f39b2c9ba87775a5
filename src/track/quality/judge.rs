//! Judges a track: reasons for a person to look at it again.

use nalgebra::Point2;

use super::{TrackSummary, Verdict};
use crate::{
    geometry::Similarity,
    robust::median,
    track::{LossReason, NodeState, TrackedFrame, TrackedNode, usual_step},
    units::NodeId,
    wireframe::{Region, Tables, Wireframe},
};

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
/// Corners of the mouth. Their motion has the same limit: the other nodes of the mouth move less, and hide in a mean that a smile went wrong.
const MOUTH_CORNERS: [NodeId; 2] = [NodeId(31), NodeId(64)];
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

/// Fills in expected errors, verdict and reasons.
pub(super) fn judge(summary: &mut TrackSummary, frames: &[TrackedFrame], wireframe: &Wireframe, tables: &Tables) {
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
    let corners: Vec<f64> = MOUTH_CORNERS.iter().filter_map(expected).collect();
    let corners_move = corners.iter().sum::<f64>() / corners.len().max(1) as f64;
    if corners_move > REGION_LIMIT * unit {
        is_motion = true;
        let percent = percent(corners_move);
        reasons.push(format!(
            "corners of the mouth: the expected error of their motion up to the apex is {corners_move:.1} px ({percent:.1} % of the eye distance)"
        ));
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
        "frames {first} to {last} are missing: the motion between them is unknown, and the model rests on the frames around"
    ))
}

/// Returns the first and last frame number of the longest gap, if it is long enough (see [`GAP_STEPS`] and [`GAP_SHARE`]).
pub(super) fn missing_frames(mut numbers: Vec<u32>) -> Option<(u32, u32)> {
    numbers.sort_unstable();
    let span = numbers.last()? - numbers.first()?;
    let usual = usual_step(&numbers);
    let (longest, before) = numbers.windows(2).map(|pair| (pair[1] - pair[0], pair[0])).max()?;
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
