//! Measures pose and action units of a stretch, in blocks of frames.

use nalgebra::Point2;

use super::{
    RecordingError, RecordingStep, Tick,
    follow::{Followed, carried},
    survey::Survey,
};
use crate::{
    features::{ACTION_UNITS, FrameFeatures, Intensity, frame_steps},
    fit::Correspondence,
    pipeline::Workbench,
    pose::{HeadFit, HeadPose},
    segment::RecordedFrame,
    track::TrackedFrame,
    units::NodeId,
};

/// Number of evenly spread frames that the head is fitted to.
const HEAD_FRAMES: usize = 40;
/// Frames that are measured together, and further ones on either side: action units depend on the frames before and after.
const BLOCK: (usize, usize) = (200, 16);

/// Measurements of a stretch, by frame.
pub(super) struct Measured {
    pub frames: Vec<RecordedFrame>,
    pub poses: Vec<Option<HeadPose>>,
    pub shown: Vec<Shown>,
}

/// What tables of other programs say of a frame beside its measurements.
#[derive(Clone, Debug)]
pub(super) struct Shown {
    /// The 68 landmarks, px.
    pub landmarks: Box<[Option<[f32; 2]>]>,
    /// Presence of the action units, in the order of [`ACTION_UNITS`].
    pub present: [bool; ACTION_UNITS.len()],
}

impl From<&FrameFeatures> for Shown {
    fn from(row: &FrameFeatures) -> Self {
        let present = |k: usize| row.action_units.get(k).is_some_and(Intensity::is_present);
        Self {
            landmarks: row.landmarks.iter().map(|p| p.map(|p| [p.x as f32, p.y as f32])).collect(),
            present: std::array::from_fn(present),
        }
    }
}

/// Positions of the fitted frame's marks in another frame: each moves with its node.
pub(super) fn marks_in(followed: &Followed, place: usize) -> Vec<Correspondence> {
    let (Some(from), Some(to)) = (followed.frames.get(followed.fitted), followed.frames.get(place)) else { return Vec::new() };
    carried(&followed.marks, |node| from.position(node), |node| to.position(node))
}

/// A neutral frame, and the places of its marks.
pub(super) struct Neutral {
    frame: TrackedFrame,
    marks: Vec<(NodeId, Point2<f64>)>,
    /// The frame with the errors that it has within its own stretch.
    tracked: TrackedFrame,
    /// Its index in the stretch that is measured; `None` if it belongs to another one.
    place: Option<usize>,
}

impl Neutral {
    /// The frame with index `place` of the stretch that is measured.
    pub fn own(followed: &Followed, place: usize) -> Self {
        let marks = marks_in(followed, place).iter().map(|m| (m.node, m.position)).collect();
        let tracked = followed.frames[place].expanded(followed.eye_distance);
        Self { frame: tracked.clone(), marks, tracked, place: Some(place) }
    }

    /// The frame with index `place` of another stretch.
    pub fn elsewhere(followed: &Followed, place: usize) -> Self {
        let frame = followed.frames[place].fitted_anew(followed.eye_distance);
        Self { frame, place: None, ..Self::own(followed, place) }
    }

    /// A frame of the stretch that is measured.
    fn expanded(&self, followed: &Followed, place: usize) -> TrackedFrame {
        let frame = &followed.frames[place];
        if self.place.is_some() { frame.expanded(followed.eye_distance) } else { frame.fitted_anew(followed.eye_distance) }
    }

    /// Returns what the frame with index `place` of a stretch shows relative to this one, and by how much better action units explain the
    /// way there than the way back, -1 to 1 ([`Workbench::order`]).
    pub fn compare(&self, followed: &Followed, place: usize, bench: &Workbench) -> Result<(RecordedFrame, f64), RecordingError> {
        let failed = |reason| RecordingError::Features { reason };
        let block = [self.frame.clone(), self.expanded(followed, place)];
        let fit = bench.fit_head(&block, &self.marks)?;
        let model = bench.frontal_model(&fit, &block)?;
        let rows = bench.features(&block, &fit, &model, &[]).map_err(failed)?;
        let row = rows.last().map(RecordedFrame::from).ok_or(RecordingError::NoFrames)?;
        // The order is known for frames of one stretch; with the larger errors between two it would never be decided.
        let order = bench.order(&[self.tracked.clone(), followed.frames[place].expanded(followed.eye_distance)], &model);
        Ok((row, order.map_err(failed)?))
    }
}

/// Measures a stretch relative to a neutral frame.
pub(super) fn measure(
    followed: &Followed,
    neutral: &Neutral,
    survey: &Survey,
    bench: &Workbench,
    tick: Tick<'_>,
) -> Result<Measured, RecordingError> {
    let count = followed.frames.len();
    let spread = count.min(HEAD_FRAMES);
    let others = (0..spread).map(|k| k * count / spread).filter(|&k| Some(k) != neutral.place);
    let head_track: Vec<TrackedFrame> =
        std::iter::once(neutral.frame.clone()).chain(others.map(|k| neutral.expanded(followed, k))).collect();
    let known: HeadFit = bench.fit_head(&head_track, &neutral.marks)?;
    let mut out =
        Measured { frames: Vec::with_capacity(count), poses: Vec::with_capacity(count), shown: Vec::with_capacity(count) };
    let mut from: Option<HeadPose> = None;
    let steps = frame_steps(&survey.numbers);
    // The neutral frame is compared with every frame; it is none of the film.
    let seconds = |k: usize| survey.clock.seconds(steps[followed.first + k]).unwrap_or(f64::NEG_INFINITY);
    let (length, margin) = BLOCK;
    for start in (0..count).step_by(length) {
        let (end, first) = ((start + length).min(count), start.saturating_sub(margin));
        let last = (end + margin).min(count);
        let frames = (first..last).map(|k| neutral.expanded(followed, k));
        let block: Vec<TrackedFrame> = std::iter::once(neutral.frame.clone()).chain(frames).collect();
        let fit = bench.head_fitter().follow(&bench.tables, (&known, from), &block, &neutral.marks)?;
        let model = bench.frontal_model(&fit, &block)?;
        let times: Vec<f64> = std::iter::once(f64::NEG_INFINITY).chain((first..last).map(seconds)).collect();
        let rows = bench.features(&block, &fit, &model, &times).map_err(|reason| RecordingError::Features { reason })?;
        // Behind the neutral frame, which comes first.
        let own = 1 + start - first..1 + end - first;
        out.frames.extend(rows[own.clone()].iter().map(RecordedFrame::from));
        out.shown.extend(rows[own.clone()].iter().map(Shown::from));
        let poses = fit.poses.iter().zip(&fit.failures).skip(own.start).take(own.len());
        out.poses.extend(poses.map(|(pose, failure)| failure.is_none().then_some(*pose)));
        from = (own.end - 1).checked_sub(margin).and_then(|before| fit.poses.get(before)).copied();
        if !tick(RecordingStep::Measuring, own.len(), Some(survey.numbers.len())) {
            return Err(RecordingError::Interrupted);
        }
    }
    Ok(out)
}
