//! Tracks one stretch of a recording from its most typical face to both ends.

use nalgebra::Point2;

use super::{
    super::found::found_faces,
    RecordingError, RecordingStep, Tick,
    likeness::{Portrait, is_another},
    survey::{Covered, Stretch, Survey},
};
use crate::{
    dataset::FrameSource,
    fit::{Correspondence, validate_correspondences},
    pipeline::{FoundFace, Workbench},
    sequence::{Frame, SequenceError, SequenceReader, read_frame_of},
    track::{FrameTracker, NodeState, TrackedFrame, TrackedNode, eye_distance_px, sees_through, window_px},
    units::NodeId,
};

/// Median distance of tracked from detected points, in eye distances, above which the face is lost.
const ASTRAY: f64 = 0.2;
/// Share of lost nodes from which the face is lost in a frame without a detected face.
const GONE: f64 = 0.35;
/// Expected errors of a tracked and of a recovered node, in eye distances.
const EXPECTED: [f64; 2] = [0.01, 0.05];
/// The same between two stretches: points are found to about 2 % of the eye distance.
const EXPECTED_ANEW: [f64; 2] = [0.025, 0.055];

/// Compact storage for the nodes of one frame.
#[derive(Clone, Debug)]
pub(super) struct CompactFrame {
    pub number: u32,
    nodes: Box<[([f32; 2], NodeState)]>,
}

impl CompactFrame {
    fn new(frame: &TrackedFrame) -> Self {
        let node = |n: &TrackedNode| ([n.position.x as f32, n.position.y as f32], n.state);
        Self { number: frame.number, nodes: frame.nodes.iter().map(node).collect() }
    }

    /// Number of the `live` nodes that were lost, as [`TrackedFrame::lost`].
    fn lost(&self, live: &[NodeId]) -> usize {
        live.iter().filter_map(|id| self.nodes.get(id.index())).filter(|(_, state)| state.loss().is_some()).count()
    }

    /// Position of a node, px.
    pub fn position(&self, node: usize) -> Option<Point2<f64>> {
        self.nodes.get(node).map(|([x, y], _)| Point2::new(f64::from(*x), f64::from(*y)))
    }

    /// The frame in the tracker's format, without residuals. `eye_distance` in px.
    pub fn expanded(&self, eye_distance: f64) -> TrackedFrame {
        self.with_errors(eye_distance, EXPECTED)
    }

    /// As [`Self::expanded`], for comparison with a frame of another stretch, in which the wireframe was fitted anew.
    pub fn fitted_anew(&self, eye_distance: f64) -> TrackedFrame {
        self.with_errors(eye_distance, EXPECTED_ANEW)
    }

    fn with_errors(&self, eye_distance: f64, expected: [f64; 2]) -> TrackedFrame {
        let node = |&([x, y], state): &([f32; 2], NodeState)| {
            let share = expected[usize::from(matches!(state, NodeState::Recovered(_)))];
            let node = TrackedNode::new(Point2::new(f64::from(x), f64::from(y)), state, None);
            TrackedNode { expected_error: Some(share * eye_distance), ..node }
        };
        TrackedFrame { number: self.number, nodes: self.nodes.iter().map(node).collect() }
    }
}

/// Result of tracking a stretch.
pub(super) struct Followed {
    /// Its frames in ascending order, without gaps.
    pub frames: Vec<CompactFrame>,
    /// Index of its first frame among all frames of the recording.
    pub first: usize,
    /// Index of the fitted frame among `frames`.
    pub fitted: usize,
    /// The marks of that frame.
    pub marks: Vec<Correspondence>,
    /// Eye distance in it, px.
    pub eye_distance: f64,
    /// The face in it, and in its first and last frame.
    pub portraits: Vec<Portrait>,
    /// Untracked rest of the stretch on either side, where the face was lost, with the reason.
    pub left: Vec<(Stretch, String)>,
}

impl Followed {
    /// Whether the tracker sees through what looks like a cover: the cover begins or ends among these frames, not in the fitted one, and
    /// hardly a node is lost in any of them. A hand costs nodes where it comes and goes; a face that only looks covered, because it shows a
    /// strong expression, costs none.
    pub fn sees_through(&self, covered: &Covered, live: &[NodeId]) -> bool {
        let end = self.first + self.frames.len();
        let is_partial = covered.first > self.first || covered.last + 1 < end;
        let is_fitted = (covered.first..=covered.last).contains(&(self.first + self.fitted));
        let begin = covered.first.max(self.first) - self.first;
        let within = self.frames.get(begin..(covered.last + 1).min(end).saturating_sub(self.first)).unwrap_or_default();
        is_partial && !is_fitted && sees_through(within.iter().map(|frame| frame.lost(live)), live.len())
    }
}

/// Where tracking of a stretch starts.
pub(super) struct Start<'a> {
    pub place: usize,
    pub marks: &'a [Correspondence],
}

/// Tracks a stretch from a frame with marks.
pub(super) fn follow(
    source: &FrameSource,
    survey: &Survey,
    stretch: Stretch,
    start: &Start<'_>,
    bench: &Workbench,
    tick: Tick<'_>,
) -> Result<Followed, RecordingError> {
    validate_correspondences(start.marks, survey.size.width, survey.size.height)
        .map_err(|e| RecordingError::Marks { frame: survey.numbers[start.place], reason: e.to_string() })?;
    let number = survey.numbers[start.place];
    let frame = frames_between(source, number, number)?.next().transpose()?;
    let fitted = match &frame {
        Some(frame) if bench.reads_beside(start.marks) > 0.0 => bench.fit_in(frame.image(), start.marks).map(|read| read.fitted),
        _ => bench.fit(start.marks),
    };
    let fitted = fitted.map_err(|e| RecordingError::Marks { frame: number, reason: e.to_string() })?;
    let mut portraits: Vec<Portrait> = frame.iter().filter_map(|frame| Portrait::of(frame, start.marks)).collect();
    let eye_distance = eye_distance_px(&bench.tables, fitted.model.nodes()).unwrap_or(1.0);
    let options = &bench.options.track;
    let moved_in = |tracked: &TrackedFrame| {
        let at = |node: usize| tracked.nodes.get(node).map(|node| node.position);
        carried(start.marks, |node| fitted.model.nodes().get(node).copied(), at)
    };
    let one_way = |to: usize, end: &mut Option<Portrait>| -> Result<(Vec<CompactFrame>, Option<String>), RecordingError> {
        let mut out: Vec<CompactFrame> = Vec::new();
        let mut running = None;
        let mut before: Option<(Frame, TrackedFrame)> = None;
        let places: Vec<usize> =
            if to >= start.place { (start.place..=to).collect() } else { (to..=start.place).rev().collect() };
        let frames = frames_between(source, survey.numbers[start.place], survey.numbers[to])?;
        for (place, frame) in places.into_iter().zip(frames) {
            let frame = frame?;
            let tracked = match &mut running {
                None => {
                    let tracker = options.klt.tracker(options.levels, window_px(&bench.tables, fitted.model.nodes(), options));
                    let started = FrameTracker::start(tracker?, &bench.wireframe, bench.plan(), &fitted, &frame, options)?;
                    let first = started.last().clone();
                    running = Some(started);
                    first
                }
                Some(running) => match running.step(&frame) {
                    Ok(tracked) => tracked.clone(),
                    Err(error) if error.is_face_lost() => return Ok((out, Some(lost(&error)))),
                    Err(error) => return Err(error.into()),
                },
            };
            // Across missing frames a face changes as much as from one person to another.
            if let Some((frame_before, before)) = &before
                && survey.are_consecutive(before.number, frame.number())
                && is_another((frame_before, before), (&frame, &tracked), eye_distance, bench)?
            {
                let behind = frame.number().max(before.number);
                return Ok((out, Some(format!("frame {behind}: the face of another person appears, as after a cut"))));
            }
            if !(stretch.first..=stretch.last).contains(&place) && !is_found(&frame, &tracked, eye_distance)? {
                return Ok((out, None));
            }
            if let Some(reason) = astray(survey, place, &tracked, eye_distance, bench) {
                if place == start.place {
                    // Tracking cannot continue from there, and searching again would not terminate.
                    let where_it_is = reason.split_once(": ").map_or(reason.as_str(), |(_, reason)| reason);
                    let reason = format!("the marks are not on the face: {where_it_is}; check them with `grimace annotate`");
                    return Err(RecordingError::Marks { frame: frame.number(), reason });
                }
                // The tracker may have lost the face at any time since the previous check.
                let step = survey.looks.iter().map(|look| look.place.abs_diff(place)).filter(|&d| d > 0).min().unwrap_or(1);
                out.truncate(out.len().saturating_sub(step - 1).max(1));
                return Ok((out, Some(lost(&reason))));
            }
            out.push(CompactFrame::new(&tracked));
            before = Some((frame, tracked));
            if !tick(RecordingStep::Tracking, 1, Some(survey.numbers.len())) {
                return Err(RecordingError::Interrupted);
            }
        }
        *end = before.and_then(|(frame, tracked)| Portrait::of(&frame, &moved_in(&tracked)));
        Ok((out, None))
    };
    let (from, to) = stretch.reach;
    let mut ends = [None, None];
    let [end_ahead, end_behind] = &mut ends;
    let (ahead, lost_ahead) = one_way(to, end_ahead)?;
    let (mut frames, lost_behind) = if start.place > from { one_way(from, end_behind)? } else { (Vec::new(), None) };
    portraits.extend(ends.into_iter().flatten());
    // Both lists begin with the fitted frame.
    let behind = frames.len().saturating_sub(1);
    frames.drain(..frames.len().min(1));
    frames.reverse();
    frames.extend(ahead);
    let (first, last) = (start.place - behind, start.place - behind + frames.len() - 1);
    let before = Stretch { first: stretch.first, last: first.saturating_sub(1), reach: (from, first.saturating_sub(1)) };
    let after = Stretch { first: last + 1, last: stretch.last, reach: (last + 1, to) };
    let mut left = Vec::new();
    left.extend(lost_behind.filter(|_| first > stretch.first).map(|why| (before, why)));
    left.extend(lost_ahead.filter(|_| last < stretch.last).map(|why| (after, why)));
    Ok(Followed { frames, first, fitted: behind, marks: start.marks.to_vec(), eye_distance, portraits, left })
}

/// Marks that move with their nodes, whose positions are known before and after.
pub(super) fn carried(
    marks: &[Correspondence],
    before: impl Fn(usize) -> Option<Point2<f64>>,
    after: impl Fn(usize) -> Option<Point2<f64>>,
) -> Vec<Correspondence> {
    let moved = |mark: &Correspondence| {
        let k = mark.node.index();
        Some(Correspondence { position: mark.position + (after(k)? - before(k)?), ..*mark })
    };
    marks.iter().filter_map(moved).collect()
}

/// Message that a face was lost, with the reason.
fn lost(why: &impl std::fmt::Display) -> String {
    format!("the face was lost: {why}")
}

/// Whether a face is detected at the tracked position.
fn is_found(frame: &Frame, tracked: &TrackedFrame, eye_distance: f64) -> Result<bool, RecordingError> {
    let faces = found_faces(frame, None)?;
    Ok(faces.iter().filter_map(|face| apart(tracked, &face.marks)).any(|apart| apart <= ASTRAY * eye_distance))
}

/// Median distance between tracked nodes and marks, px.
fn apart(tracked: &TrackedFrame, marks: &[Correspondence]) -> Option<f64> {
    let apart = |m: &Correspondence| tracked.nodes.get(m.node.index()).map(|n| (n.position - m.position).norm());
    let mut distances: Vec<f64> = marks.iter().filter_map(apart).collect();
    crate::robust::median(&mut distances)
}

/// The reason why the tracked nodes are no longer on the face, if the survey looked at their frame and shows it.
fn astray(survey: &Survey, place: usize, tracked: &TrackedFrame, eye_distance: f64, bench: &Workbench) -> Option<String> {
    let look = survey.looks.binary_search_by_key(&place, |look| look.place).ok().map(|k| &survey.looks[k])?;
    let Some(FoundFace { marks, trusted: true, .. }) = &look.face else {
        let live = bench.wireframe.live_nodes();
        let lost = tracked.lost(live);
        let is_gone = look.face.is_none() && lost as f64 > GONE * live.len() as f64;
        return is_gone.then(|| format!("frame {}: no face is found, and {lost} nodes were lost", tracked.number));
    };
    let median = apart(tracked, marks)?;
    (median > ASTRAY * eye_distance).then(|| format!("frame {}: the face is {median:.0} px away", tracked.number))
}

type Frames = Box<dyn Iterator<Item = Result<Frame, SequenceError>>>;

/// The frames from one number to another, in reverse order if the second is smaller.
fn frames_between(whole: &FrameSource, from: u32, to: u32) -> Result<Frames, RecordingError> {
    let source = match whole {
        FrameSource::Images(files) => {
            let wanted = from.min(to)..=from.max(to);
            let mut files: Vec<_> = files.iter().filter(|f| wanted.contains(&f.number)).cloned().collect();
            if from > to {
                files.reverse();
            }
            if let [only] = &files[..] {
                let number = only.number;
                let first = whole.files().first().map_or(&*only.path, |first| *first);
                let frame = read_frame_of(&only.path, first).map(|frame| Frame::new(number, frame.into_image()));
                return Ok(Box::new(std::iter::once(frame)));
            }
            FrameSource::Images(files)
        }
        FrameSource::Video { path, .. } => FrameSource::Video { path: path.clone(), first: Some(from), last: Some(to) },
    };
    Ok(Box::new(SequenceReader::open_part(&source, whole)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::LossReason;

    /// Thirty frames with 20 nodes each, of which `lost` (frame, number) are lost.
    fn followed(fitted: usize, lost: &[(usize, usize)]) -> Followed {
        let frame = |k: usize| {
            let of = lost.iter().find(|(frame, _)| *frame == k).map_or(0, |(_, count)| *count);
            let state = |n: usize| if n < of { NodeState::Recovered(LossReason::Klt) } else { NodeState::Tracked };
            CompactFrame { number: k as u32 + 101, nodes: (0..20).map(|n| ([0.0; 2], state(n))).collect() }
        };
        let (frames, marks, portraits, left) = ((0..30).map(frame).collect(), Vec::new(), Vec::new(), Vec::new());
        Followed { frames, first: 100, fitted, marks, eye_distance: 100.0, portraits, left }
    }

    #[test]
    fn a_cover_that_costs_no_nodes_is_an_expression() {
        let live: Vec<NodeId> = (0..20).map(NodeId).collect();
        let covered = |first, last| Covered { first, last, parts: Vec::new() };
        let hand = covered(110, 120);
        // Two of twenty nodes in one of eleven frames; six of them; one in every third frame.
        assert!(followed(0, &[(12, 2)]).sees_through(&hand, &live));
        assert!(!followed(0, &[(12, 6)]).sees_through(&hand, &live));
        assert!(!followed(0, &[(10, 2), (13, 2), (16, 2)]).sees_through(&hand, &live));
        // What covers the face all the time, or where it was fitted, costs no nodes.
        assert!(!followed(0, &[]).sees_through(&covered(90, 140), &live));
        assert!(!followed(15, &[]).sees_through(&hand, &live));
        // Frames of another stretch.
        assert!(
            !followed(0, &[]).sees_through(&covered(0, 99), &live) && !followed(0, &[]).sees_through(&covered(130, 140), &live)
        );
    }
}
