//! Why a sequence cannot be tracked.

use crate::{
    companion::CompanionError,
    fit::SpringError,
    sequence::{ImageSize, SequenceError},
};

/// Why a sequence cannot be tracked.
///
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
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

/// Checks that a part has as many nodes as the wireframe.
pub(super) fn check_nodes(what: &'static str, found: usize, expected: usize) -> Result<(), TrackError> {
    if found == expected { Ok(()) } else { Err(TrackError::OtherWireframe { what, found, expected }) }
}
