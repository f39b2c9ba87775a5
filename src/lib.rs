//! Measures facial expressions in image sequences and computes representative facial expressions.
//!
//! Data flow. Every step returns one owned type; a model carries its unit in its type:
//!
//! ```text
//! frames + correspondences -> fitted wireframe -> DynamicExpressionModel<Px> (tracked)
//!   -> DynamicExpressionModel<FaceUnit> (normalized) -> models of one expression, trimmed
//!   -> Representative { generalized median, dispersion } -> FAP file, report
//! ```
//!
//! # The method step by step
//!
//! ```no_run
//! use std::path::Path;
//!
//! use grimace::{
//!     correspondence::read_correspondences,
//!     dataset::list_frames,
//!     fap::{FapCatalog, FapNumber, FapSequence, read_fap, write_fap},
//!     fit::{FitOptions, Fitter},
//!     normalize::{NormalizeOptions, Normalizer},
//!     sequence::SequenceReader,
//!     track::{TrackOptions, TrackPlan, track_model, track_sequence},
//!     wireframe::Face,
//! };
//!
//! let folder = Path::new("fixtures/simulated/S001/005");
//! let Face { wireframe, tables } = Face::candide3();
//! // Fit: marked points of the neutral frame pull the wireframe.
//! let marks = read_correspondences(&folder.join("correspondences.csv"), &tables, wireframe.node_count())?;
//! let fitted = Fitter::new(&wireframe, FitOptions::default()).fit(&wireframe, &marks)?;
//! fitted.warnings.iter().for_each(|warning| eprintln!("{warning}"));
//! // Track: it follows the face to the apex frame.
//! let frames = SequenceReader::open(&list_frames(folder, None, None)?)?;
//! let plan = TrackPlan::new(&wireframe, &tables);
//! let track = track_sequence(&wireframe, &plan, &fitted, frames, &TrackOptions::default(), |_| true)?;
//! // Normalize: five frames in face units, without roll; `pose::HeadFitter` takes out yaw and pitch before. Models of many people
//! // make a `statistics::representative`.
//! let normalizer = Normalizer::new(&wireframe, &tables, NormalizeOptions::default())?;
//! let model = normalizer.normalize(&track_model(&track.frames)?)?;
//! // FAPs, 25 frames a second and 5 frames between those of the model; some are cut to the standard's ranges.
//! let catalog = FapCatalog::mpeg4();
//! let (faps, _cut) = FapSequence::from_model(&model, &normalizer.canonical().fapus, catalog, "smile", 25, 5)?;
//! write_fap(Path::new("smile.fap"), &faps)?;
//! // Read again: the last frame is the apex.
//! let smile = read_fap(Path::new("smile.fap"))?.sequence;
//! let row = catalog.row(FapNumber::try_from(59)?);
//! println!("{}: {:?} {}", row.name, smile.frames.last().and_then(|apex| apex.value(row.number)), row.unit_name());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Features
//!
//! All features are on by default. Without them (`default-features = false`) the library contains only the method. It is then pure Rust
//! and builds on every platform that Rust supports. It still has image files (formats: see [`dataset::list_frames`]), fit, tracking,
//! normalization, statistics, FAP files, synthesis and cloning.
//!
//! - `tool`: the command line and everything its commands need.
//! - `annotate`: the web page for setting marks.
//! - `columnar`: models in Parquet files.
//! - `opencv`: the program `grimace-opencv`, which reads and writes videos. The library starts it as a process and never links OpenCV.
//!
//! **Debug builds.** Cargo compiles dependencies without optimization for a debug build, and tracking then takes some fifty times as long:
//! ten frames of 320 x 320 pixels 12 s instead of 0.2 s. To optimize this library, add to the `Cargo.toml` of the program, or of its
//! workspace:
//!
//! ```toml
//! [profile.dev.package.grimace]
//! opt-level = 3
//! ```
//!
//! The interface uses types of [`image`], [`nalgebra`] and [`blake3`]. These crates are re-exported under their names, so that a program
//! uses matching versions. An error formatted with `{}` gives the whole message in one line, including its cause. `main` prints a
//! returned error in the `Debug` form, which is meant for developers.
//!
//! More examples are in `examples/` of the repository. `docs/architecture.md` describes how the modules depend on each other.
//!
//! # The modules by topic
//!
//! | for | modules |
//! | --- | --- |
//! | numbers with units, the wireframe, models | [`units`] [`geometry`] [`wireframe`] [`model`] [`correspondence`] [`errors`] |
//! | the user's data | [`dataset`] [`sequence`] |
//! | the method's steps | [`locate`] [`fit`] [`track`] [`normalize`] [`statistics`] [`fap`] [`pose`] [`features`] [`segment`] |
//! | pictures and surfaces | [`mesh`] [`synthesis`] [`clone`](mod@clone) |
//! | the whole job in one call | [`pipeline`] |
//!
//! These modules are the stable interface. `grimace-lab`, the Python package and the command line also use the hidden module `internal`,
//! which may change in any version.
//!
//! Axes and units are defined in [`units`]. Left and right are always the subject's own.
//!
//! # References
//! - **\[KP\]** S. Krinidis, I. Pitas: *Facial expression synthesis through facial expressions statistical analysis*, EUSIPCO 2006.
//! - **\[ZL\]** L. Zhu, W.-S. Lee: *Facial expression via genetic algorithms*.
//! - **\[Candide-3\]** J. Ahlberg: *Candide-3 - an updated parameterised face*, report LiTH-ISY-R-2326, 2001.
//! - **\[MPEG-4\]** ISO/IEC 14496-2 (Visual), Annex C: FAPs, FAPUs, feature points.
//! - **\[Bouguet\]** J.-Y. Bouguet: *Pyramidal implementation of the Lucas Kanade feature tracker*, Intel, 1999.
// Only the command line uses much of the code.
#![cfg_attr(not(feature = "tool"), allow(dead_code, unused_imports))]
// Tests compare exact values on purpose.
#![cfg_attr(test, allow(clippy::unreadable_literal, clippy::items_after_statements, clippy::format_collect))]

// The command line refers to the library by its crate name.
extern crate self as grimace;

#[doc(no_inline)]
pub use {blake3, image, nalgebra};

/// All modules. Code inside the library refers to each by its short name, whether or not the facade exports it.
#[path = "."]
mod modules {
    #[cfg(feature = "annotate")]
    pub mod annotate;
    #[cfg(feature = "tool")]
    #[allow(missing_docs, clippy::pedantic)]
    pub mod cli;
    pub mod clone;
    #[cfg(feature = "columnar")]
    pub mod columnar;
    pub mod companion;
    pub mod correspondence;
    pub mod dataset;
    pub mod errors;
    pub mod fap;
    pub mod features;
    pub mod fit;
    pub mod foreign;
    pub mod formula;
    #[cfg(feature = "tool")]
    pub mod fuzzing;
    pub mod geometry;
    pub mod input;
    pub mod interpolation;
    pub mod least_squares;
    pub mod locate;
    pub mod mesh;
    pub mod model;
    pub mod normalize;
    pub mod output;
    pub mod overlay;
    pub mod pipeline;
    pub mod plausible;
    pub mod player;
    pub mod pose;
    pub mod positions;
    pub mod render;
    pub mod report;
    pub mod robust;
    pub mod segment;
    pub mod sequence;
    pub mod simd;
    pub mod statistics;
    pub mod synthesis;
    pub mod text;
    pub mod track;
    pub mod units;
    pub mod warp;
    pub mod wireframe;
}

// Modules that the facade does not export.
#[allow(unused_imports, clippy::wildcard_imports)]
use modules::*;

#[doc(hidden)]
pub mod internal;

/// Declares a public module that exports the listed items of the internal module of the same name. Inside the library the same path gives
/// access to all of its items.
macro_rules! facade {
    ($(#[$about:meta])* $module:ident: $($shown:tt)*) => {
        $(#[$about])*
        pub mod $module {
            #[doc(inline)]
            pub use crate::modules::$module::{$($shown)*};
            #[allow(unused_imports)]
            pub(crate) use crate::modules::$module::*;
        }
    };
}

facade! {
    /// Basics: units of length as types, and the names of nodes, feature points and sequences.
    units: FaceUnit, FeaturePoint, NodeId, ParseFeaturePointError, Px, SequenceId, Unit
}
facade! {
    /// Basics: transforms of points.
    geometry: Similarity, SimilarityError
}
facade! {
    /// Basics: a wireframe with its tables ([`Face`](wireframe::Face)). Candide-3 is built in; other wireframes are read from `.wfm`
    /// files.
    wireframe: Axis, Face, Fapu, FapuDefinition, Fapus, FapusError, FeaturePointRow, MotionUnit, Region, Tables, UnitKind,
    WfmError, WfmErrorKind, Wireframe, WireframeError, read_wfm
}
facade! {
    /// Basics: frame and dynamic facial expression models \[KP, section 1 and eq. 2\].
    model: DynamicExpressionModel, FrameExpressionModel, ModelError
}
facade! {
    /// Basics: marked points of the neutral frame, `node,x,y`.
    correspondence: Correspondence, CorrespondenceError, MarkKind, MarksError, read_correspondences, validate_correspondences,
    write_correspondences
}
facade! {
    /// Basics: errors that several modules share.
    errors: Implausible, InputError, OutputError, PositionsError
}
facade! {
    /// Input: the user's sequences with their emotions, frames and landmarks.
    dataset: CorrespondenceSource, Dataset, DatasetError, FailedEntry, FrameFile, FrameSource, FramesError, LandmarkFrame,
    LandmarkSelection, LandmarkSequence, LandmarkTrack, LandmarksError, RowError, SequenceEntry, SkippedEntry,
    correspondences_from_landmarks, list_frames, read_landmarks
}
facade! {
    /// Input: decoded frames in order.
    sequence: DecodeError, Frame, ImageSize, SequenceError, SequenceReader, read_frame
}
facade! {
    /// Method: finds faces and their marks in pictures.
    locate: FacePart, LocateOptions, LocatedFace, LocatedPoint, Locator, LocatorError
}
facade! {
    /// Method: fits the wireframe to marked points \[KP, section 2\].
    fit: DrivenNode, FitError, FitOptions, FitWarning, FittedWireframe, Fitter, LoadedPrior, PriorFileError, PriorKind, Pull,
    ShapePrior, SpringError, Springs, read_prior
}
facade! {
    /// Method: tracks the wireframe from the neutral to the apex frame \[KP, section 3\], with a [`PointTracker`](track::PointTracker) or
    /// with landmarks.
    track: AlignOptions, Evidence, Forces, Found, Klt, KltKind, LandmarkPlan, LossReason, NodeState, Patch, PointTracker, Probe, Slot, Track,
    TrackError, TrackFileError, TrackInfo, TrackOptions, TrackPlan, TrackSummary, TrackedFrame, TrackedNode, Verdict, read_track,
    read_track_info, summarize, track_model, track_sequence, track_with, write_track
}
facade! {
    /// Method: normalizes a track to five upright frames in face units \[KP, section 4.1\].
    normalize: Canonical, IrisdMode, NormalizeError, NormalizeOptions, Normalizer, NotFaceUnits, PoseMode, Resample, SizeMode
}
facade! {
    /// Method: the representative of the models of one expression by trimming, generalized median and dispersion \[KP, sections 4.2 to
    /// 4.4\]; variation of people around it; recognition of a model's expression.
    statistics: ClassLabel, Dispersions, GroupOptions, MedianKind, MedianSearch, MedianSums, NotComparable, Representative, SequenceModel, StatisticsError, StatisticsOptions,
    TrimLevel, TrimmingRow, Weighting, compare::{CompareOptions, NotTested, Strata, StrataError, Tested, compare},
    recognize::{RecognizeError, Recognized, Recognizer}, representative,
    median::SearchEnding, variation::{Component, Variation, VariationError}
}
facade! {
    /// Method: facial animation parameters of MPEG-4 and their files.
    fap: Clamped, ConvertError, Directionality, FapCatalog, FapFile, FapFrame, FapMask, FapMotion, FapNumber, FapReadError, FapRow,
    FapSequence, FapWriteError, FapWriteErrorKind, Finding, InterpolateError,
    ParseFapNumberError, Profile, Rule, Severity, ValueFormat, check_fap, measure_faps, read_fap, write_fap, write_fap_as
}
facade! {
    /// Method: the head in three dimensions, its pose, and the camera's distance.
    pose: HeadFit, HeadFitter, HeadModel, HeadPose, PoseError
}
facade! {
    /// Method: action units and FAPs of every frame of a track.
    features: ActionUnit, ActionUnits, FeatureMeter, FeaturesError, FrameFeatures, Intensity, Measured
}
facade! {
    /// Method: finds rests and expressions in a whole recording.
    segment: Expression, Phase, RecordedFrame, SegmentError, SegmentOptions, Segmentation, segment
}
facade! {
    /// Output: triangle meshes and their files.
    mesh: MeshError, MeshFileError, TriangleMesh, read_obj, read_ply, write_obj
}
facade! {
    /// Output: dense surfaces from a bank of expressions \[ZL\].
    synthesis: Animation, Bank, BankError, BankInfo, Composition, Crossover, FeaturePointVertex, FpMotion,
    FrameAnswer, GaOptions, Motion, MotionKind, RegionScheme, Signs, Solver, SynthesisError, SynthesisOptions, Synthesizer,
    candide_bank, head_bank, read_motion, write_gltf
}
facade! {
    /// Output: an expression on a new face, with its texture \[KP, section 5\].
    clone: CloneError, CloneFrame, CloneOptions, ClonedExpression, Details, Ease, Rescale, SourceKind, SourceMotion,
    Target, Teeth, Timing, clone_expression
}
facade! {
    /// Tool: the main job, stage by stage, from a dataset to representatives, FAP files and a report; model files.
    pipeline: Event, Failure, FapOptions, LandmarkOptions, ModelFileError, PipelineOptions, RunError, RunSummary, Workbench, WorkbenchError, read_model, run,
    write_model
}
