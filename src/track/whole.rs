//! Tracks a whole sequence.

use super::{
    Confidence, Ends, FrameTracker, PointTracker, Track, TrackError, TrackOptions, TrackPlan, TrackedFrame, expect_errors,
    sees_through, window_px,
};
use crate::{
    fit::FittedWireframe,
    sequence::{Frame, SequenceError},
    wireframe::Wireframe,
};

/// Tracks a fitted wireframe through the frames. The first frame is the neutral frame that the wireframe was fitted to.
///
/// `tick` is called after every frame with its number and may return `false` to stop. `wireframe` must be the one that was fitted.
///
/// ```
/// use grimace::{
///     correspondence::read_correspondences,
///     dataset::list_frames,
///     fit::Fitter,
///     sequence::SequenceReader,
///     track::{TrackOptions, TrackPlan, track_sequence},
///     wireframe::Face,
/// };
///
/// let Face { wireframe, tables } = Face::candide3();
/// let folder = std::path::Path::new("fixtures/simulated/S001/005");
/// let marks = read_correspondences(&folder.join("correspondences.csv"), &tables, wireframe.node_count())?;
/// let fitted = Fitter::new(&wireframe, Default::default()).fit(&wireframe, &marks)?;
///
/// let frames = SequenceReader::open(&list_frames(folder, None, Some(2))?)?;
/// let plan = TrackPlan::new(&wireframe, &tables);
/// let mut numbers = Vec::new();
/// // The last argument hears of every frame, and may stop the work.
/// let note = |number| { numbers.push(number); true };
/// let track = track_sequence(&wireframe, &plan, &fitted, frames, &TrackOptions::default(), note)?;
/// assert_eq!((track.frames.len(), numbers), (2, vec![1, 2]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`TrackError`] for frames that do not read, a lost face, or an interruption; for a plan or a fitted wireframe with other
/// nodes, frames of no or of differing size, and options out of range. Two frames may differ in size, as two photographs do, unless the
/// face is lost.
pub fn track_sequence(
    wireframe: &Wireframe,
    plan: &TrackPlan,
    fitted: &FittedWireframe,
    frames: impl IntoIterator<Item = Result<Frame, SequenceError>>,
    options: &TrackOptions,
    tick: impl FnMut(u32) -> bool,
) -> Result<Track, TrackError> {
    let window_px = window_px(&plan.tables, fitted.model.nodes(), options);
    let mut tracker = options.klt.tracker(options.levels, window_px)?;
    track_with(&mut tracker, wireframe, plan, fitted, frames, options, tick)
}

/// Same as [`track_sequence`], with any point tracker.
///
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let folder = std::path::Path::new("fixtures/simulated/S001/005");
/// # let marks = folder.join("correspondences.csv");
/// # let marks = grimace::correspondence::read_correspondences(&marks, &tables, wireframe.node_count())?;
/// # let fitted = grimace::fit::Fitter::new(&wireframe, Default::default()).fit(&wireframe, &marks)?;
/// use grimace::{dataset::list_frames, sequence::SequenceReader, track::{Klt, TrackOptions, TrackPlan, track_with}};
///
/// // `fitted` is the wireframe on the first frame of `folder`.
/// let frames = SequenceReader::open(&list_frames(folder, None, Some(2))?)?;
/// let (mut tracker, plan) = (Klt::new(4, 31), TrackPlan::new(&wireframe, &tables));
/// let track = track_with(&mut tracker, &wireframe, &plan, &fitted, frames, &TrackOptions::default(), |_| true)?;
/// assert_eq!(track.frames.len(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// As [`track_sequence`]; and for a tracker whose answers are not finite or not one for each point.
pub fn track_with(
    tracker: &mut impl PointTracker,
    wireframe: &Wireframe,
    plan: &TrackPlan,
    fitted: &FittedWireframe,
    frames: impl IntoIterator<Item = Result<Frame, SequenceError>>,
    options: &TrackOptions,
    mut tick: impl FnMut(u32) -> bool,
) -> Result<Track, TrackError> {
    let mut out: Vec<TrackedFrame> = Vec::new();
    let mut running: Option<FrameTracker<'_, _>> = None;
    let (mut tracker, mut last) = (Some(tracker), None);
    for frame in frames {
        let frame = frame?;
        match (&mut running, tracker.take()) {
            (Some(running), _) => out.push(running.step(&frame)?.clone()),
            (None, Some(tracker)) => {
                let started = FrameTracker::start(tracker, wireframe, plan, fitted, &frame, options)?;
                out.push(started.last().clone());
                running = Some(started);
            }
            (None, None) => {}
        }
        if !tick(frame.number()) {
            return Err(TrackError::Interrupted);
        }
        last = Some(frame);
    }
    match running.zip(last) {
        Some((running, last)) if out.len() >= 2 => {
            expect_errors(&mut out, wireframe, &plan.tables, Confidence::shipped());
            let Ends { mouth_moved, mut covered } = running.leap.map(|leap| leap.ends(&last, &running.last)).unwrap_or_default();
            let live = wireframe.live_nodes();
            if !covered.is_empty() && sees_through(out.iter().map(|frame| frame.lost(live)), live.len()) {
                covered.clear();
            }
            Ok(Track { size: running.size, frames: out, mouth_moved, covered_at_apex: covered })
        }
        _ => Err(TrackError::TooFewFrames { found: out.len() }),
    }
}
