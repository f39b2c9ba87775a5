//! Representative facial expressions from image sequences.
//!
//! Data flow, one owned type per step, the unit part of the model's type:
//!
//! ```text
//! frames + correspondences -> fitted wireframe -> DynamicExpressionModel<Px> (tracked)
//!   -> DynamicExpressionModel<FaceUnit> (normalized) -> models of one expression, trimmed
//!   -> Representative { generalized median, dispersion } -> FAP file, report
//! ```
//!
//! # The method in order
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
//! All are on by default. Without them (`default-features = false`) the library is the method alone, in Rust, for every platform that
//! Rust has: image files ([`dataset::list_frames`] names their kinds), fit, tracking, normalization, statistics, FAP files, synthesis and
//! cloning.
//!
//! - `tool`: the command line, and all that its commands need.
//! - `annotate`: the page on which marks are set.
//! - `columnar`: models in Parquet files.
//! - `opencv`: the program `grimace-opencv`, which reads and writes videos. The library starts it and never links OpenCV.
//!
//! Types of [`image`], [`nalgebra`] and [`blake3`] are part of the interface; these crates are shown under their names, so that a program
//! need not guess their versions. An error printed with `{}` says everything in one line, its cause included; what
//! `main` prints of an error that it returns is the other form, for looking into the code.
//!
//! In the repository `examples/` goes on from here, and `docs/architecture.md` says how the modules lie on each other.
//!
//! # The modules in order
//!
//! | for | modules |
//! | --- | --- |
//! | numbers with units, the wireframe, models | [`units`] [`geometry`] [`wireframe`] [`model`] [`correspondence`] |
//! | what a user brings | [`dataset`] [`sequence`] |
//! | the method's steps | [`locate`] [`fit`] [`track`] [`normalize`] [`statistics`] [`fap`] [`pose`] [`features`] [`segment`] |
//! | pictures and surfaces | [`mesh`] [`synthesis`] [`clone`](mod@clone) |
//! | all of it at once | [`pipeline`] |
//!
//! These are the library's promise. What `grimace-lab`, the Python package and the command line need beyond it stands in a hidden module,
//! `internal`, which may change in any version.
//!
//! Axes and units are those of [`units`]. Left and right are always the subject's own.
//!
//! # References
//! - **\[KP\]** S. Krinidis, I. Pitas: *Facial expression synthesis through facial expressions statistical analysis*, EUSIPCO 2006.
//! - **\[ZL\]** L. Zhu, W.-S. Lee: *Facial expression via genetic algorithms*.
//! - **\[Candide-3\]** J. Ahlberg: *Candide-3 - an updated parameterised face*, report LiTH-ISY-R-2326, 2001.
//! - **\[MPEG-4\]** ISO/IEC 14496-2 (Visual), Annex C: FAPs, FAPUs, feature points.
//! - **\[Bouguet\]** J.-Y. Bouguet: *Pyramidal implementation of the Lucas Kanade feature tracker*, Intel, 1999.
// Much of it only the command line uses.
#![cfg_attr(not(feature = "tool"), allow(dead_code, unused_imports))]
// Tests compare exact values on purpose.
#![cfg_attr(test, allow(clippy::unreadable_literal, clippy::items_after_statements, clippy::format_collect))]

// The command line uses the library by its outer name.
extern crate self as grimace;

#[doc(no_inline)]
pub use {blake3, image, nalgebra};

/// All modules, at home. Within the library each is known by its name alone, whether the facade shows it or not.
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

// Modules that the facade does not show.
#[allow(unused_imports, clippy::wildcard_imports)]
use modules::*;

#[doc(hidden)]
pub mod internal;

/// A module of the facade: what it shows of the module of that name. The library itself sees all of it by the same path.
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
    /// Ground: units of length as types, and the names of nodes, feature points and sequences.
    units: FaceUnit, FeaturePoint, NodeId, ParseFeaturePointError, Px, SequenceId, Unit
}
facade! {
    /// Ground: transforms of points.
    geometry: Similarity, SimilarityError
}
facade! {
    /// Ground: a wireframe with its tables ([`Face`](wireframe::Face)); Candide-3 comes along, another is read from a `.wfm` file.
    wireframe: Axis, Face, Fapu, FapuDefinition, Fapus, FapusError, FeaturePointRow, MotionUnit, Region, TableError, Tables,
    UnitKind, WfmError, WfmErrorKind, Wireframe, WireframeError, read_wfm, write_wfm
}
facade! {
    /// Ground: frame and dynamic facial expression models \[KP, section 1 and eq. 2\].
    model: DynamicExpressionModel, FrameExpressionModel, ModelError
}
facade! {
    /// Ground: marked points of the neutral frame, `node,x,y`.
    correspondence: Correspondence, CorrespondenceError, MarkKind, MarksError, read_correspondences,
    validate_correspondences, write_correspondences
}
facade! {
    /// Sources: what a user brings. Sequences with their emotions, frames, landmarks.
    dataset: CorrespondenceSource, Dataset, DatasetError, FailedEntry, FrameFile, FrameSource, FramesError, LandmarkFrame,
    LandmarkSelection, LandmarkSequence, LandmarkTrack, LandmarksError, RowError, SequenceEntry, SkippedEntry,
    correspondences_from_landmarks, list_frames, read_landmarks
}
facade! {
    /// Sources: frames in order, decoded.
    sequence: DecodeError, Frame, ImageSize, SequenceError, SequenceReader, read_frame
}
facade! {
    /// Method: faces and their marks found in pictures.
    locate: FacePart, LocateOptions, LocatedFace, LocatedPoint, Locator
}
facade! {
    /// Method: the wireframe fitted to marked points \[KP, section 2\].
    fit: DrivenNode, FitError, FitOptions, FitWarning, FittedWireframe, Fitter, LoadedPrior, PriorFile, PriorFileError, PriorKind, Pull,
    ShapePrior, SpringError, Springs, read_prior
}
facade! {
    /// Method: the wireframe tracked from the neutral to the apex frame \[KP, section 3\], by a
    /// [`PointTracker`](track::PointTracker) or by landmarks.
    track: AlignOptions, Evidence, Forces, Found, Klt, KltKind, LandmarkPlan, LossReason, NodeState, PointTracker, Probe, Slot, Track,
    TrackError, TrackFileError, TrackInfo, TrackOptions, TrackPlan, TrackSummary, TrackedFrame, TrackedNode, read_track,
    read_track_info, summarize, track_model, track_sequence, track_with, write_track
}
facade! {
    /// Method: five frames, upright, in face units \[KP, section 4.1\].
    normalize: CANONICAL_ES, Canonical, FRAMES_PER_MODEL, IrisdMode, NormalizeError, NormalizeOptions, Normalizer, PoseMode, Resample, SizeMode
}
facade! {
    /// Method: the representative of the models of one expression: trimming, generalized median, dispersion \[KP, sections 4.2 to 4.4\];
    /// how people vary around it, and which expression a model shows.
    statistics: ClassLabel, MedianKind, MedianSearch, MedianSums, Representative, SequenceModel, StatisticsError, StatisticsOptions,
    TrimLevel, TrimmingRow, Weighting, compare::{CompareOptions, NotTested, Strata, StrataError, Tested, compare},
    distance::DisplacementFields, recognize::{RecognizeError, Recognized, Recognizer}, representative,
    median::SearchEnding, variation::{Component, Variation, VariationError}
}
facade! {
    /// Method: facial animation parameters of MPEG-4, and their files.
    fap: Clamped, ConvertError, Directionality, FapCatalog, FapFile, FapFrame, FapMask, FapMotion, FapNumber, FapReadError, FapRow,
    FapSequence, FapWriteError, FapWriteErrorKind, Finding, FrontalRating, HighLevelField, InterpolateError,
    ParseFapNumberError, Profile, Rule, Severity, TidyError, ValueFormat, check_fap, measure_faps, read_fap,
    read_tidy_csv, write_fap, write_fap_as, write_tidy_csv
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
    /// Method: rests and expressions in a whole recording.
    segment: Expression, Phase, RecordedFrame, SegmentError, SegmentOptions, Segmentation, segment
}
facade! {
    /// Making: triangle meshes and their files.
    mesh: MeshError, MeshFileError, TriangleMesh, read_obj, read_ply, write_obj
}
facade! {
    /// Making: dense surfaces from a bank of expressions \[ZL\].
    synthesis: Bank, BankError, BankInfo, BuildOptions, BuildSummary, Composition, Crossover, FeaturePointVertex, FpMotion,
    FrameAnswer, GaOptions, Motion, MotionKind, RegionScheme, Solver, SynthesisError, SynthesisOptions, Synthesizer,
    build_bank, candide_bank, head_bank, read_motion
}
facade! {
    /// Making: an expression on a new face, with its texture \[KP, section 5\].
    clone: CloneError, CloneFrame, CloneOptions, ClonedExpression, Course, Details, Ease, Moment, Rescale, SourceKind, SourceMotion,
    Target, Teeth, Timing, clone_expression
}
facade! {
    /// Tool: the main job, stage by stage, from a dataset to representatives, FAP files and a report; the files of models.
    pipeline: Event, FapOptions, ModelFileError, PipelineOptions, RunError, RunSummary, Workbench, WorkbenchError, read_model, run,
    write_model
}
