//! Tracks the fitted wireframe from the neutral to the apex frame [KP, section 3].
//!
//! Pyramidal KLT follows every live node from frame to frame, forward and back. A node is *lost* when KLT reports a failure, when the
//! backward search does not return to the start, when the node leaves the image, or when its displacement is extreme compared with its
//! neighbours' (KP require "a uniform distribution" of displacements and give no rule; see `recover`). After each step the springs deform
//! the wireframe again, driven by the displacements of the nodes that were not lost. They also place the lost nodes, which are tracked
//! again in the next frame (see `step`).

mod align;
mod clock;
mod confidence;
mod corrections;
mod ends;
mod file;
mod in_picture;
mod klt;
mod landmarks;
mod leap;
mod lids;
mod light;
mod lips;
mod looked;
mod options;
mod quality;
mod recover;
mod resume;
mod state;
mod step;

use nalgebra::{Matrix2, Point2, Vector2};

use crate::{
    companion::CompanionError,
    fit::{FittedWireframe, MarkKind, SpringError},
    locate::FacePart,
    model::{DynamicExpressionModel, FrameExpressionModel, ModelError},
    sequence::{Frame, ImageSize, SequenceError},
    units::{NodeId, Px},
    wireframe::{Tables, Wireframe},
};

pub use align::{AlignOptions, Patch};
pub(crate) use clock::{MOST_FILLED, clock_of_frames, whole_steps};
pub use confidence::{Confidence, Evidence, NodeFeatures, expect_errors, node_features};
pub(crate) use corrections::CORRECTIONS_FOLDER;
pub use corrections::{
    SavedCorrections, TrackCorrections, corrections_in_track, corrections_path, far_corrections, fitting_corrections,
    read_corrections, write_corrections,
};
pub(crate) use ends::{Ends, backwards_said, covered_at_apex_said, mouth_back_said};
pub(crate) use file::write_hashed_track;
pub use file::{
    TRACK_SCHEMA, TrackFileError, TrackHashes, TrackInfo, neutral_first, parse_track, parse_track_info, read_track,
    read_track_info, seconds_of, track_csv, track_units, write_track,
};
#[cfg(feature = "annotate")]
pub(crate) use klt::smoothed;
pub use klt::{Klt, KltKind, OpenCvKlt};
pub use landmarks::LandmarkPlan;
pub(crate) use looked::{LOOKED_AT, Looks, content_of};
pub use looked::{Look, LooksError};
pub use options::{Forces, MIN_WINDOW_PX, TrackOptions};
pub use quality::{FrameQuality, TrackQuality, TrackSummary, Verdict, summarize};
pub(crate) use quality::{missing_said, two_pictures_said};
pub use resume::{Corrections, correct_nodes, corrections_of, resume_with};
pub use state::{LossReason, NodeState};
pub use step::TrackPlan;

/// One node in one frame.
///
/// ```
/// use grimace::track::{NodeState, TrackedNode};
/// use nalgebra::Point2;
///
/// let chin = TrackedNode::new(Point2::new(149.5, 240.0), NodeState::Tracked, Some(0.02));
/// assert_eq!((chin.residual, chin.expected_error), (Some(0.02), None));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackedNode {
    /// Position, px.
    pub position: Point2<f64>,
    /// How the position was obtained.
    pub state: NodeState,
    /// Measured residual, px. In the neutral frame: distance of a marked node from its mark. In later frames: forward-backward distance,
    /// between the start of a step and its end tracked back. `None` where neither exists.
    pub residual: Option<f64>,
    /// Measurements of the step into this frame; `None` in the neutral frame, for a lost node, and in a track read from a file.
    pub evidence: Option<Evidence>,
    /// Expected error, px: half of such nodes are closer, half further away. In the neutral frame it is the error of the node's position on
    /// the face, `None` when unknown. In later frames it is the error of its offset from the neutral frame, see [`Confidence`].
    pub expected_error: Option<f64>,
}

impl TrackedNode {
    /// Creates a node without evidence and expected error.
    pub fn new(position: Point2<f64>, state: NodeState, residual: Option<f64>) -> Self {
        Self { position, state, residual, evidence: None, expected_error: None }
    }
}

/// Returns the dynamic facial expression model of tracked frames, in px.
///
/// ```
/// use grimace::track::{read_track, track_model};
///
/// let track = read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// let model = track_model(&track)?;
/// assert_eq!((model.frame_count(), model.node_count()), (10, 113));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`ModelError`] for fewer than two frames, differing node counts, or positions that are not finite.
pub fn track_model(frames: &[TrackedFrame]) -> Result<DynamicExpressionModel<Px>, ModelError> {
    let frame = |f: &TrackedFrame| FrameExpressionModel::new(f.nodes.iter().map(|n| n.position).collect());
    DynamicExpressionModel::new(frames.iter().map(frame).collect())
}

/// The wireframe in one frame, all N nodes in order.
///
/// ```
/// use grimace::track::{TrackedFrame, read_track};
///
/// let track = read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// let TrackedFrame { number, nodes } = &track[9];
/// assert_eq!((*number, nodes.len()), (10, 113));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct TrackedFrame {
    /// Frame number.
    pub number: u32,
    /// Its nodes.
    pub nodes: Vec<TrackedNode>,
}

/// A tracked sequence, neutral frame first.
///
/// ```
/// # let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let folder = std::path::Path::new("fixtures/simulated/S001/005");
/// # let marks = folder.join("correspondences.csv");
/// # let marks = grimace::correspondence::read_correspondences(&marks, &tables, wireframe.node_count())?;
/// # let fitted = grimace::fit::Fitter::new(&wireframe, Default::default()).fit(&wireframe, &marks)?;
/// use grimace::{dataset::list_frames, sequence::SequenceReader, track::{Track, TrackOptions, TrackPlan, track_sequence}};
///
/// // `fitted` is the wireframe on the first frame of `folder`.
/// let frames = SequenceReader::open(&list_frames(folder, None, Some(3))?)?;
/// let plan = TrackPlan::new(&wireframe, &tables);
/// let Track { size, frames, .. } = track_sequence(&wireframe, &plan, &fitted, frames, &TrackOptions::default(), |_| true)?;
/// assert_eq!((size.to_string().as_str(), frames.len()), ("320x320", 3));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Size of its frames.
    pub size: ImageSize,
    /// Its frames, at least two.
    pub frames: Vec<TrackedFrame>,
    /// By how much the mouth moved away from that of a neutral face, from the first to the last frame, as the locator reads it: the corners
    /// of the mouth and the distance between the lips, over the eye distance. `None` if the locator was not used or saw no face there.
    pub mouth_moved: Option<[f64; 2]>,
    /// Parts of the face that something covers in the last frame, but not in the first.
    pub covered_at_apex: Vec<FacePart>,
}

/// Why a sequence cannot be tracked.
///
/// ```
/// # let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let folder = std::path::Path::new("fixtures/simulated/S001/005");
/// # let marks = folder.join("correspondences.csv");
/// # let marks = grimace::correspondence::read_correspondences(&marks, &tables, wireframe.node_count())?;
/// # let fitted = grimace::fit::Fitter::new(&wireframe, Default::default()).fit(&wireframe, &marks)?;
/// use grimace::track::{TrackError, TrackOptions, TrackPlan, track_sequence};
///
/// // `fitted` is the wireframe on the first frame of `folder`.
/// let plan = TrackPlan::new(&wireframe, &tables);
/// let error = track_sequence(&wireframe, &plan, &fitted, [], &TrackOptions::default(), |_| true).unwrap_err();
/// assert!(matches!(error, TrackError::TooFewFrames { found: 0 }));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum TrackError {
    /// A frame cannot be read.
    #[error(transparent)]
    Sequence(#[from] SequenceError),
    /// Fewer than two frames.
    #[error("a track needs at least 2 frames, from neutral to apex; found {found}")]
    TooFewFrames {
        /// Frames found.
        found: usize,
    },
    /// Too few nodes are tracked for the springs: the face is lost.
    #[error("frame {frame}: only {found} of {live} nodes could be tracked; the face is lost")]
    FaceLost {
        /// Frame number.
        frame: u32,
        /// Nodes not lost.
        found: usize,
        /// Live nodes.
        live: usize,
    },
    /// The face is lost in the second of two frames that differ in size. Of two photographs that are cropped differently the second can
    /// often be tracked all the same.
    #[error(
        "frame {frame} has {size} pixels, but the first has {expected}, and only {found} of {live} nodes could be tracked; the face is \
         lost. Crop and scale both pictures alike"
    )]
    FaceLostInOtherSize {
        /// Frame number.
        frame: u32,
        /// Its size.
        size: ImageSize,
        /// Size of the first frame.
        expected: ImageSize,
        /// Nodes not lost.
        found: usize,
        /// Live nodes.
        live: usize,
    },
    /// The landmarks of a frame do not determine the position of the face.
    #[error("frame {frame}: {reason}")]
    Landmarks {
        /// Frame number.
        frame: u32,
        /// What is wrong.
        reason: String,
    },
    /// The springs have no equilibrium.
    #[error(transparent)]
    Springs(#[from] SpringError),
    /// The point tracker failed.
    #[error("the point tracker failed: {reason}")]
    PointTracker {
        /// What it says.
        reason: String,
    },
    /// A part for another wireframe.
    #[error("the {what} has {found} nodes, but the wireframe has {expected}; give the {what} that was made for this wireframe")]
    OtherWireframe {
        /// The part: the fitted wireframe, the plan or the track.
        what: &'static str,
        /// Its number of nodes.
        found: usize,
        /// Nodes of the wireframe.
        expected: usize,
    },
    /// A frame without pixels.
    #[error("frame {frame} has {size} pixels; a track needs frames that show a face")]
    NoPixels {
        /// Frame number.
        frame: u32,
        /// Its size.
        size: ImageSize,
    },
    /// A frame of another size than the first, among more than two.
    #[error("frame {frame} has {found} pixels, but the first has {expected}; of more than two frames, all must have one size")]
    FrameSize {
        /// Frame number.
        frame: u32,
        /// Its size.
        found: ImageSize,
        /// Size of the first frame.
        expected: ImageSize,
    },
    /// An option out of range.
    #[error("the option `{name}` of the tracker is {value}; it must be {allowed}")]
    Option {
        /// Name of the field.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// The program of the point tracker is missing or ended early.
    #[error("{0}")]
    #[doc(hidden)]
    Program(#[from] CompanionError),
    /// The caller asked to stop.
    #[error("interrupted")]
    Interrupted,
}

impl TrackError {
    /// Whether the face is lost.
    pub(crate) fn is_face_lost(&self) -> bool {
        matches!(self, Self::FaceLost { .. } | Self::FaceLostInOtherSize { .. })
    }
}

/// Which prepared frame a [`PointTracker`] works on.
///
/// The example is a tracker that keeps three frames.
/// ```
/// use grimace::track::Slot;
///
/// let numbers = [1, 8, 9];
/// let number = |slot| match slot {
///     Slot::Neutral => numbers[0],
///     Slot::Previous => numbers[1],
///     Slot::Current => numbers[2],
/// };
/// assert_eq!(number(Slot::Previous) + 1, number(Slot::Current));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// The first frame given.
    Neutral,
    /// The frame before the current one.
    Previous,
    /// The frame given last.
    Current,
}

/// A point to search for in another frame.
///
/// ```
/// use grimace::track::Probe;
/// use nalgebra::{Point2, Vector2};
///
/// // The search starts where the head's motion leads.
/// let position = Point2::new(150.0, 240.0);
/// let probe = Probe { position, guess: position + Vector2::new(3.0, 0.0) };
/// assert_eq!(probe.guess.x, 153.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// Position in the frame it comes from, px.
    pub position: Point2<f64>,
    /// Start of the search, px.
    pub guess: Point2<f64>,
}

/// Result of a search.
///
/// ```
/// use grimace::track::Found;
/// use nalgebra::Point2;
///
/// let found = Found::At { position: Point2::new(150.25, 240.0), difference: 1.5 };
/// assert!(matches!(found, Found::At { difference, .. } if difference < 2.0));
/// assert_ne!(found, Found::Lost);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Found {
    /// A match.
    At {
        /// Position, px.
        position: Point2<f64>,
        /// Mean absolute grey difference of the two windows, 0 to 255.
        difference: f64,
    },
    /// No match.
    Lost,
}

/// Finds points of one frame in another: the interface between the tracking method and the code that reads pixels.
///
/// ```
/// use grimace::{sequence::Frame, track::{Found, PointTracker, Probe, Slot, TrackError}};
///
/// /// Finds every point where the search starts.
/// struct Still;
///
/// impl PointTracker for Still {
///     fn advance(&mut self, _: &Frame) -> Result<(), TrackError> {
///         Ok(())
///     }
///
///     fn find(&mut self, _: Slot, _: Slot, _: u32, _: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError> {
///         Ok(probes.iter().map(|probe| Found::At { position: probe.guess, difference: 0.0 }).collect())
///     }
/// }
///
/// assert_eq!(Still.find(Slot::Previous, Slot::Current, 15, 4, &[])?, []);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait PointTracker {
    /// Takes the next frame. It becomes the current frame, the current one becomes the previous one, and the first one stays the neutral
    /// one.
    ///
    /// # Errors
    /// [`TrackError`] when the frame cannot be prepared.
    fn advance(&mut self, frame: &Frame) -> Result<(), TrackError>;

    /// Returns the mean gradient matrices of the windows around points of a frame, squared grey levels per px: one for each point, finite.
    /// They tell how well, and in which direction, a match is determined. The default treats all points and directions alike.
    ///
    /// # Errors
    /// [`TrackError`] when the gradients cannot be read.
    fn gradients(&self, _slot: Slot, _window_px: u32, points: &[Point2<f64>]) -> Result<Vec<Matrix2<f64>>, TrackError> {
        Ok(vec![Matrix2::identity(); points.len()])
    }

    /// Returns the grey values of a frame around points, all finite, smoothed by a Gaussian of standard deviation `smoothing` px, reaching at least
    /// `margin` px beyond the points within the image. The default returns `None`, for a tracker without images; nodes are then not
    /// aligned.
    ///
    /// # Errors
    /// [`TrackError`] when the image cannot be read.
    fn patch(&self, _slot: Slot, _points: &[Point2<f64>], _margin: f64, _smoothing: f64) -> Result<Option<Patch>, TrackError> {
        Ok(None)
    }

    /// Finds the probes of frame `from` in frame `to`, with a square window of `window_px` and `levels` pyramid levels. Returns one result
    /// per probe, with finite numbers.
    ///
    /// # Errors
    /// [`TrackError`] when the search cannot run at all.
    fn find(&mut self, from: Slot, to: Slot, window_px: u32, levels: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError>;
}

/// Forwards to the tracker behind a `&mut T` or `Box<T>`.
impl<P: std::ops::DerefMut<Target: PointTracker>> PointTracker for P {
    fn advance(&mut self, frame: &Frame) -> Result<(), TrackError> {
        (**self).advance(frame)
    }

    fn gradients(&self, slot: Slot, window_px: u32, points: &[Point2<f64>]) -> Result<Vec<Matrix2<f64>>, TrackError> {
        (**self).gradients(slot, window_px, points)
    }

    fn patch(&self, slot: Slot, points: &[Point2<f64>], margin: f64, smoothing: f64) -> Result<Option<Patch>, TrackError> {
        (**self).patch(slot, points, margin, smoothing)
    }

    fn find(&mut self, from: Slot, to: Slot, window_px: u32, levels: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError> {
        (**self).find(from, to, window_px, levels, probes)
    }
}

/// Tracks a fitted wireframe through the frames. The first frame is the neutral frame that the wireframe was fitted to.
///
/// `tick` is called after every frame with its number and may return `false` to stop. `wireframe` must be the one that was fitted.
///
/// ```
/// # let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let folder = std::path::Path::new("fixtures/simulated/S001/005");
/// # let marks = folder.join("correspondences.csv");
/// # let marks = grimace::correspondence::read_correspondences(&marks, &tables, wireframe.node_count())?;
/// # let fitted = grimace::fit::Fitter::new(&wireframe, Default::default()).fit(&wireframe, &marks)?;
/// use grimace::{dataset::list_frames, sequence::SequenceReader, track::{TrackOptions, TrackPlan, track_sequence}};
///
/// // `fitted` is the wireframe on the first frame of `folder`.
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

/// Returns the eye distance of the fitted wireframe, px: the unit of the relative options.
pub fn eye_distance_px(tables: &Tables, nodes: &[Point2<f64>]) -> Option<f64> {
    // Only the length matters: taking both axes of the vector between the pupils removes the effect of roll.
    let definition = tables.fapus.iter().find(|d| d.fapu == crate::wireframe::Fapu::Es)?;
    let mean = |ids: &[NodeId]| -> Option<Vector2<f64>> {
        let points: Option<Vec<_>> = ids.iter().map(|n| nodes.get(n.index()).map(|p| p.coords)).collect();
        Some(points?.iter().sum::<Vector2<f64>>() / ids.len() as f64)
    };
    Some((mean(&definition.plus_nodes)? - mean(&definition.minus_nodes)?).norm()).filter(|d| *d > 0.0)
}

/// Returns the side of the KLT window for a neutral face: odd, px.
pub fn window_px(tables: &Tables, neutral: &[Point2<f64>], options: &TrackOptions) -> u32 {
    let eye_distance = eye_distance_px(tables, neutral).unwrap_or(0.0);
    let half = (options.window * eye_distance / 2.0).round().clamp(0.0, 100.0) as u32;
    (2 * half + 1).max(MIN_WINDOW_PX)
}

/// Same as [`track_sequence`], with any point tracker.
///
/// ```
/// # let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
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
            let Ends { mouth_moved, covered } = running.leap.map(|leap| leap.ends(&last, &running.last)).unwrap_or_default();
            Ok(Track { size: running.size, frames: out, mouth_moved, covered_at_apex: covered })
        }
        _ => Err(TrackError::TooFewFrames { found: out.len() }),
    }
}

/// Tracks frame after frame and keeps only the last one; the caller stores the tracked frames. Expected errors are not filled in, because
/// they depend on the whole track ([`expect_errors`]).
pub struct FrameTracker<'a, T> {
    tracker: T,
    wireframe: &'a Wireframe,
    plan: &'a TrackPlan,
    options: &'a TrackOptions,
    template: Option<align::Template>,
    light: Option<light::Light>,
    lids: Option<lids::Lids>,
    lips: Option<lips::Lips>,
    leap: Option<leap::Leap>,
    window: u32,
    eye_distance: f64,
    size: ImageSize,
    sizes: Sizes,
    last: TrackedFrame,
}

impl<'a, T: PointTracker> FrameTracker<'a, T> {
    /// Starts with the frame that the wireframe was fitted to.
    ///
    /// # Errors
    /// [`TrackError`] when the tracker cannot take the frame, for a plan or a fitted wireframe with other nodes, a frame without
    /// pixels, and options out of range.
    pub fn start(
        mut tracker: T,
        wireframe: &'a Wireframe,
        plan: &'a TrackPlan,
        fitted: &FittedWireframe,
        frame: &Frame,
        options: &'a TrackOptions,
    ) -> Result<Self, TrackError> {
        options.check()?;
        plan.check_wireframe(wireframe)?;
        let nodes = fitted.model.nodes();
        check_nodes("fitted wireframe", nodes.len(), wireframe.node_count())?;
        let mut sizes = Sizes::default();
        sizes.add(frame)?;
        let eye_distance = eye_distance_px(&plan.tables, nodes).unwrap_or(100.0);
        let window = window_px(&plan.tables, nodes, options);
        tracker.advance(frame)?;
        let template = plan.template(wireframe, &tracker, nodes, (window, eye_distance), &options.align)?;
        let light = options.even_light.then(|| light::Light::new(frame, wireframe.live_nodes(), nodes, window));
        let lids = options.read_lids.then(|| lids::Lids::new(frame, nodes));
        let leap = options.locates().then(|| leap::Leap::new(frame, nodes));
        let lips = options.read_lips.then(|| lips::Lips::new(&plan.tables)).flatten();
        let last = TrackedFrame { number: frame.number(), nodes: neutral_nodes(wireframe, fitted) };
        let size = frame.size();
        Ok(Self { tracker, wireframe, plan, options, template, light, lids, lips, leap, window, eye_distance, size, sizes, last })
    }

    /// The frame tracked last.
    pub fn last(&self) -> &TrackedFrame {
        &self.last
    }

    /// Tracks the next frame, forward or backward in time.
    ///
    /// # Errors
    /// [`TrackError`] for a lost face, a frame without pixels, more than two frames that are not of one size, and a tracker whose answers
    /// are not finite or not one for each point.
    pub fn step(&mut self, frame: &Frame) -> Result<&TrackedFrame, TrackError> {
        self.sizes.add(frame)?;
        let even = self.light.as_ref().and_then(|light| light.undone_at(frame, self.wireframe, &self.last));
        self.tracker.advance(even.as_ref().unwrap_or(frame))?;
        let Self { wireframe, plan, options, window, eye_distance, .. } = *self;
        let (template, lids, lips, leap) = (self.template.as_mut(), self.lids.as_ref(), self.lips.as_ref(), self.leap.as_ref());
        let mut step = step::Step { wireframe, plan, options, template, window, eye_distance, lids, lips, leap, frame };
        let nodes = step.run(&mut self.tracker, &self.last).map_err(|error| self.sizes.named_in(error))?;
        self.last = TrackedFrame { number: frame.number(), nodes };
        Ok(&self.last)
    }
}

/// Checks that a part has as many nodes as the wireframe.
fn check_nodes(what: &'static str, found: usize, expected: usize) -> Result<(), TrackError> {
    if found == expected { Ok(()) } else { Err(TrackError::OtherWireframe { what, found, expected }) }
}

/// Sizes of the frames so far. Two photographs alone may be cropped differently; of more frames, all have the size of the first.
#[derive(Clone, Copy, Debug, Default)]
struct Sizes {
    first: Option<ImageSize>,
    /// Number and size of a second frame of another size.
    odd: Option<(u32, ImageSize)>,
    /// Number of frames.
    count: usize,
}

impl Sizes {
    /// Checks the next frame.
    ///
    /// # Errors
    /// [`TrackError::NoPixels`], [`TrackError::FrameSize`].
    fn add(&mut self, frame: &Frame) -> Result<(), TrackError> {
        let (number, size) = (frame.number(), frame.size());
        if size.width == 0 || size.height == 0 {
            return Err(TrackError::NoPixels { frame: number, size });
        }
        let expected = *self.first.get_or_insert(size);
        self.count += 1;
        self.odd = self.odd.or((size != expected).then_some((number, size)));
        match self.odd.filter(|_| self.count > 2) {
            Some((frame, found)) => Err(TrackError::FrameSize { frame, found, expected }),
            None => Ok(()),
        }
    }

    /// Returns the error of a step with the sizes of its frames, if they differ and the face is lost.
    fn named_in(&self, error: TrackError) -> TrackError {
        match (error, self.first, self.odd) {
            (TrackError::FaceLost { frame, found, live }, Some(expected), Some((_, size))) => {
                TrackError::FaceLostInOtherSize { frame, size, expected, found, live }
            }
            (error, ..) => error,
        }
    }
}

/// Returns the nodes of the neutral frame with their states: marked, corrected (set by hand), fitted, or following. Their expected error is
/// the error of their position on the face.
pub fn neutral_nodes(wireframe: &Wireframe, fitted: &FittedWireframe) -> Vec<TrackedNode> {
    let fit = |position: &Point2<f64>| TrackedNode::new(*position, NodeState::Fitted, None);
    let mut nodes: Vec<_> = fitted.model.nodes().iter().map(fit).collect();
    for (node, expected) in nodes.iter_mut().zip(fitted.expected_errors().unwrap_or_default()) {
        node.expected_error = Some(expected);
    }
    for follower in wireframe.followers() {
        if let Some(node) = nodes.get_mut(follower.node.index()) {
            node.state = NodeState::Follows;
        }
    }
    for (mark, residual) in fitted.correspondences.iter().zip(&fitted.residuals) {
        let Some(node) = nodes.get_mut(mark.node.index()) else { continue };
        node.residual = Some(*residual);
        node.state = match mark.kind {
            MarkKind::Mark => NodeState::Marked,
            MarkKind::Hard => NodeState::Corrected,
        };
    }
    nodes
}
