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
mod error;
mod evidence;
mod file;
mod frame_tracker;
mod in_picture;
mod klt;
mod landmarks;
mod leap;
mod lengths;
mod lids;
mod light;
mod lips;
mod looked;
mod options;
mod point_tracker;
mod quality;
mod recover;
mod resume;
mod state;
mod step;
mod tracked;
mod whole;

pub use align::{AlignOptions, Patch};
pub(crate) use clock::{MOST_FILLED, clock_of_frames, usual_step};
pub use confidence::{Confidence, NodeFeatures, expect_errors, node_features};
pub(crate) use corrections::CORRECTIONS_FOLDER;
pub use corrections::{
    SavedCorrections, TrackCorrections, corrections_in_track, corrections_path, far_corrections, fitting_corrections,
    read_corrections, write_corrections,
};
pub(crate) use ends::{Ends, backwards_said, covered_at_apex_said, mouth_back_said, sees_through};
pub use error::TrackError;
use error::check_nodes;
pub use evidence::{Evidence, SkinMatch};
pub(crate) use file::write_hashed_track;
pub use file::{
    TRACK_SCHEMA, TrackFileError, TrackHashes, TrackInfo, neutral_first, parse_track, parse_track_info, read_track,
    read_track_info, seconds_of, track_csv, track_units, write_track,
};
use frame_tracker::Sizes;
pub use frame_tracker::{FrameTracker, neutral_nodes};
#[cfg(feature = "annotate")]
pub(crate) use klt::smoothed;
pub use klt::{Klt, KltKind, OpenCvKlt};
pub use landmarks::LandmarkPlan;
pub use lengths::{eye_distance_px, window_px};
pub(crate) use looked::{LOOKED_AT, Looks, content_of};
pub use looked::{Look, LooksError};
pub use options::{Forces, MIN_WINDOW_PX, TrackOptions};
pub use point_tracker::{Found, PointTracker, Probe, Slot};
pub use quality::{FrameQuality, TrackQuality, TrackSummary, Verdict, summarize};
pub(crate) use quality::{missing_said, two_pictures_said};
pub use resume::{Corrections, correct_nodes, corrections_of, resume_with};
pub use state::{LossReason, NodeState};
pub use step::TrackPlan;
pub use tracked::{Track, TrackedFrame, TrackedNode, track_model};
pub use whole::{track_sequence, track_with};
