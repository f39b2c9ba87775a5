//! A tracked sequence: its frames and their nodes.

use nalgebra::Point2;

use super::{Evidence, NodeState, SkinMatch};
use crate::{
    locate::FacePart,
    model::{DynamicExpressionModel, FrameExpressionModel, ModelError},
    sequence::ImageSize,
    units::{NodeId, Px},
};

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
    /// Comparison of the skin around the node with the neutral frame, whether the node was lost or not; `None` in the neutral frame,
    /// without images or alignment, where a node has no skin, and in a track read from a file. Only expected errors are made of it.
    #[doc(hidden)]
    pub skin: Option<SkinMatch>,
    /// Expected error, px: half of such nodes are closer, half further away. In the neutral frame it is the error of the node's position on
    /// the face, `None` when unknown. In later frames it is the error of its offset from the neutral frame, see
    /// [`Confidence`](super::Confidence).
    pub expected_error: Option<f64>,
}

impl TrackedNode {
    /// Creates a node without evidence and expected error.
    pub fn new(position: Point2<f64>, state: NodeState, residual: Option<f64>) -> Self {
        Self { position, state, residual, evidence: None, skin: None, expected_error: None }
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

impl TrackedFrame {
    /// Number of the `live` nodes that were lost.
    pub(crate) fn lost(&self, live: &[NodeId]) -> usize {
        live.iter().filter_map(|id| self.nodes.get(id.index())).filter(|node| node.state.loss().is_some()).count()
    }
}

/// A tracked sequence, neutral frame first.
///
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
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
