//! Cloning: an expression on a new face [KP, section 5].
//!
//! A [`SourceMotion`] is a tracked sequence, a representative, a normalized model or a FAP file: upright offsets of all nodes from
//! neutral over time, in the source's own units. A [`Target`] is a neutral photograph with the wireframe fitted to it. The offsets are
//! rescaled by target over source FAPU in each region ([`Target::nodes_at`]), rotated by the target's roll and added to its neutral nodes;
//! [`crate::warp`] then warps the photograph. [`Details`] transfers wrinkles and teeth from the source's frames.
//!
//! KP add the displacement vectors of the source to the target. Offsets from neutral are the sums of these vectors, so the result is the
//! same without accumulating errors. The rescaling is an addition: KP's models have equal FAPUs before the transfer.

mod arches;
mod cloned_skin;
mod detail;
mod fap_motion;
mod form;
mod mouths;
mod output;
mod picture;
mod render;
mod skin;
mod source;
mod target;
#[cfg(test)]
pub(crate) mod test_target;
mod timing;

use std::path::{Path, PathBuf};

use crate::{
    dataset::MarksFileError,
    fap::{ConvertError, FapReadError, FapWriteError},
    fit::{FitError, MarksError, SpringError},
    interpolation::too_many_between,
    model::ModelError,
    normalize::{NormalizeError, NotFaceUnits},
    output::OutputError,
    plausible::Implausible,
    sequence::{FilmError, SequenceError},
    synthesis::BankError,
    track::TrackFileError,
    warp::WarpError,
    wireframe::FapusError,
};

pub use cloned_skin::{ClonedSkin, MOST_SKIN, fold_powers, fold_softening, places_on_skin};
pub use detail::{Details, Teeth};
pub use mouths::moved_mouths;
pub use output::{CLONE_SCHEMA, CloneFiles, CloneInfo, CutFap, FRAMES_RECORD, Film, encode_png, write_clone};
pub use picture::{FaceCell, Sheet, at_height};
pub use render::{CloneFrame, CloneOptions, ClonedExpression, clone_expression};
pub use skin::{
    LEAST_SKIN_PEOPLE, MOST_SKIN_PEOPLE, NO_CHANGE, NoSkin, SKIN_LOG_LIMIT, SKIN_SUFFIX, Skin, SkinLayout, SkinSample,
};
pub use source::{LID_PAIRS, SourceKind, SourceMotion, canonical_lid_gaps};
pub use target::{Rescale, Target};
pub(crate) use timing::Moment;
pub use timing::{Ease, Timing};

/// Why an expression cannot be cloned.
///
/// ```
/// use grimace::{clone::{CloneError, SourceMotion}, wireframe::Face};
///
/// let error = SourceMotion::read("holiday.jpg".as_ref(), &Face::candide3()).unwrap_err();
/// assert!(matches!(error, CloneError::UnknownSource { path } if path == "holiday.jpg"));
/// ```
#[derive(Debug, thiserror::Error)]
pub enum CloneError {
    /// A model whose neutral face is not in face units.
    #[error("{}: {source}", path.display())]
    NotFaceUnits {
        /// The file.
        path: PathBuf,
        /// What it is instead.
        source: NotFaceUnits,
    },
    /// A motion that is impossible for a face.
    #[error("{}, {source}", path.display())]
    Implausible {
        /// The source's file.
        path: PathBuf,
        /// Frame, node and offset.
        source: Implausible,
    },
    /// The track or model of the source cannot be read.
    #[error(transparent)]
    Track(#[from] TrackFileError),
    /// The FAP file of the source cannot be read.
    #[error(transparent)]
    FapRead(#[from] FapReadError),
    /// A source of an unknown kind, or no file.
    #[error(
        "{path}: {} a track or model (.csv) nor a FAP file (.fap)",
        if Path::new(path).exists() { "this is neither" } else { "there is no such file, neither" }
    )]
    UnknownSource {
        /// The file.
        path: String,
    },
    /// A folder, such as the results of a run.
    #[error("{}: this is a folder; name a motion in it{}", path.display(), example(motion.as_deref()))]
    SourceFolder {
        /// The folder.
        path: PathBuf,
        /// A motion in it.
        motion: Option<PathBuf>,
    },
    /// A FAP file without motion.
    #[error("{path}: the file has no frames")]
    NoFrames {
        /// The file.
        path: String,
    },
    /// No FAP of the file moves anything a frontal face can show.
    #[error("{path}: none of its FAPs ({faps}) can be shown on a face seen from the front")]
    NothingToShow {
        /// The file.
        path: String,
        /// The FAPs it sets.
        faps: String,
    },
    /// The topology of source or target differs from the wireframe in use.
    #[error("{what} has {found} nodes, but the wireframe has {expected}; give its wireframe with --wireframe")]
    Topology {
        /// The source or the target.
        what: String,
        /// Its nodes.
        found: usize,
        /// Nodes of the wireframe.
        expected: usize,
    },
    /// The frames do not form a model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The source cannot be made upright.
    #[error("the source: {0}")]
    Normalize(#[from] NormalizeError),
    /// FAPs cannot be converted.
    #[error(transparent)]
    Convert(#[from] ConvertError),
    /// The FAPUs of a face cannot be measured.
    #[error("{what}: {source}")]
    Fapus {
        /// Source or target.
        what: &'static str,
        /// Why.
        source: FapusError,
    },
    /// The springs have no equilibrium.
    #[error(transparent)]
    Springs(#[from] SpringError),
    /// A file of marks cannot be read.
    #[doc(hidden)]
    #[error(transparent)]
    MarksFile(#[from] MarksFileError),
    /// Marks that do not determine a fit.
    #[error(transparent)]
    Marks(#[from] MarksError),
    /// The wireframe cannot be fitted to the target.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The face is turned: eyes, mouth and chin are not arranged as in a frontal view.
    #[error(
        "the face is turned away by about {degrees:.0} degrees: one half of it is {ratio:.1} times as wide as the other; cloning needs a frontal photograph (up to about 25 degrees)"
    )]
    Profile {
        /// Estimated yaw.
        degrees: f64,
        /// Wider over narrower half.
        ratio: f64,
    },
    /// A face too small to show anything.
    #[error(
        "the eyes are {eye_distance:.1} px apart; at least {least} px are needed for an expression to show: take a larger picture of the face"
    )]
    TooSmall {
        /// Distance between the eyes.
        eye_distance: f64,
        /// Least distance.
        least: f64,
    },
    /// The picture is too large.
    #[error("the picture is {width}x{height}, larger than {most} px per side: scale it down")]
    TooLarge {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Most px a side.
        most: u32,
    },
    /// A face whose number of nodes is not Candide-3's.
    #[error("{}", WarpError::NodeCount { found: *found })]
    NodeCount {
        /// Nodes of the face.
        found: usize,
    },
    /// A node of the face is not at a finite position.
    #[error("{}", WarpError::NotFinite)]
    NotFinite,
    /// Both eyes of the face are at the same position.
    #[error("{}", WarpError::NoEyes)]
    NoEyes,
    /// The edges of mouth and eyes cross: the nodes do not form a face seen from the front.
    #[error("{}", WarpError::Folded)]
    Folded,
    /// The embedded head cannot be bent.
    #[error(transparent)]
    Bank(#[from] BankError),
    /// A picture cannot be read.
    #[error(transparent)]
    Sequence(#[from] SequenceError),
    /// A picture that does not have the size of a representative's skin.
    #[error("{}: the picture is {width}x{height} px, but the skin of a representative that `run` writes has {}x{}", path.display(), expected.0, expected.1)]
    SkinSize {
        /// The file.
        path: PathBuf,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// What it should have.
        expected: (u32, u32),
    },
    /// Wrinkles or teeth are requested from a source without frames.
    #[error("{0}")]
    NoSourceFrames(String),
    /// A frame that the clone does not have.
    #[error("the clone has no frame {frame}; its {count} frames are numbered from 0")]
    NoSuchFrame {
        /// The frame asked for.
        frame: usize,
        /// Frames of the clone.
        count: usize,
    },
    /// Details that were prepared for another source or target.
    #[error(
        "the details are of {frames} frames and a picture of {}x{} px, but the source has a frame {needed} (from 1) and the target {}x{} px; \
         prepare them for this source and target", of.0, of.1, size.0, size.1
    )]
    OtherDetails {
        /// Frames of the details.
        frames: usize,
        /// Columns and rows of the details.
        of: (u32, u32),
        /// Largest frame of the source that is needed, from 1.
        needed: usize,
        /// Columns and rows of the target.
        size: (u32, u32),
    },
    /// More frames than a clone may have.
    #[error("the clone would have {frames} frames, more than {most}: choose a shorter duration or a lower frame rate")]
    TooManyFrames {
        /// Frames asked for.
        frames: f64,
        /// Most frames.
        most: usize,
    },
    /// Too many frames between those of a motion.
    #[error("{name}: {}", too_many_between(*frames, *most))]
    TooManyBetween {
        /// Name of the motion.
        name: String,
        /// Frames that there would be.
        frames: f64,
        /// Most frames.
        most: u32,
    },
    /// A FAP file with more frames than are supported.
    #[error(
        "{path}: it has {frames} frames, more than {most}: lower its frame rate (`grimace fap convert --fps`), or use a part of it"
    )]
    SourceTooLong {
        /// The file.
        path: String,
        /// Frames it has.
        frames: usize,
        /// Most frames.
        most: usize,
    },
    /// A duration too short for a second frame.
    #[error("{seconds} s at {fps} frames per second are less than half a frame; choose a longer duration or a higher frame rate")]
    TooFewFrames {
        /// Seconds from the first to the last frame.
        seconds: f64,
        /// Frames per second.
        fps: f64,
    },
    /// The frame rate is so low that a film cannot store the duration of a frame.
    #[error("a frame would last {seconds:.0} s, but a film can show a frame for at most {most} s; choose a higher frame rate")]
    TooSlow {
        /// Seconds for which a frame would be shown.
        seconds: f64,
        /// The longest time.
        most: f64,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The FAP file cannot be written.
    #[error(transparent)]
    FapWrite(#[from] FapWriteError),
    /// The video cannot be written.
    #[error(transparent)]
    #[doc(hidden)]
    Film(#[from] FilmError),
    /// A picture cannot be encoded.
    #[error("cannot encode {what}: {reason}")]
    Encode {
        /// GIF, APNG, PNG.
        what: &'static str,
        /// Why.
        reason: String,
    },
    /// The face that shows the expressions cannot be created.
    #[error("the face to show them on: {0}")]
    Showcase(String),
    /// The user asked to stop.
    #[error("interrupted")]
    Interrupted,
    /// A source whose parts have differing numbers of frames or nodes.
    #[error("the source {name} has {found} {what}, but {expected} are needed; every frame has offsets of all nodes and a head")]
    UnevenSource {
        /// Name of the source.
        name: String,
        /// The part, with its unit.
        what: &'static str,
        /// Its number.
        found: usize,
        /// The number needed.
        expected: usize,
    },
    /// A number out of range, of the options or of the source.
    #[error("{what} is {value}; it must be {allowed}")]
    Number {
        /// The option, or the part of the source.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
}

#[doc(hidden)]
impl From<WarpError> for CloneError {
    fn from(error: WarpError) -> Self {
        match error {
            WarpError::NodeCount { found } => Self::NodeCount { found },
            WarpError::NotFinite => Self::NotFinite,
            WarpError::NoEyes => Self::NoEyes,
            WarpError::Folded => Self::Folded,
        }
    }
}

/// Says which motion to name, for the end of a message.
fn example(motion: Option<&std::path::Path>) -> String {
    motion.map(|path| format!(", such as {}", path.display())).unwrap_or_default()
}
