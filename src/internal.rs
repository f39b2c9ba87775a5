//! Items that the command line, `grimace-lab`, the Python package, tests and fuzzing need, re-exported by name. There is no
//! stability promise: they change from one version to the next.

#![allow(missing_docs)]

#[cfg(feature = "tool")]
pub mod cli {
    pub use crate::modules::cli::{Outcome, chain, exit_code, main};
    pub mod bank {
        pub use crate::modules::cli::bank::open;
    }
    pub mod failures {
        pub use crate::modules::cli::failures::say_failures;
    }
    pub mod numbers {
        pub use crate::modules::cli::numbers::parse;
    }
    pub mod portrait {
        pub use crate::modules::cli::portrait::target;
    }
    pub mod print {
        pub use crate::modules::cli::print::{error_line, line, said_by_clap};
    }
    pub mod shared {
        pub use crate::modules::cli::shared::{
            FitArgs, MethodArgs, ModelArgs, PictureArgs, TrackArgs, WhichMarksArgs, alpha, count, memory, not_negative, positive,
            set_threads, stop_flag, thread_count, words,
        };
    }
}
pub mod clone {
    pub use crate::modules::clone::{
        CloneError, CloneOptions, ClonedSkin, Details, FaceCell, Rescale, Sheet, Skin, SourceMotion, Target, clone_expression,
        encode_png,
    };
}
#[cfg(feature = "columnar")]
pub mod columnar {
    pub use crate::modules::columnar::{ColumnarClass, ColumnarError, ColumnarModels, ColumnarRow, ColumnarWriter};
}
pub mod companion {
    pub use crate::modules::companion::wire;
    pub use crate::modules::companion::{Answer, Companion};
}
pub mod correspondence {
    pub use crate::modules::correspondence::{Correspondence, MarkKind, validate_correspondences};
}
pub mod dataset {
    pub use crate::modules::dataset::{
        CorrespondenceSource, DEFAULT_LANDMARK_NODES, Dataset, DatasetError, FrameSource, FramesError, LANDMARK_COUNT,
        LandmarkFrame, LandmarkSelection, LandmarkSequence, LandmarksError, MANIFEST_NAME, SequenceEntry,
        correspondences_from_landmarks, emotion_code, has_picture_name, is_picture, list_frames, list_readable, may_publish,
        read_landmarks, read_marks,
    };
}
pub mod fap {
    pub use crate::modules::fap::{
        FapCatalog, FapFrame, FapMotion, FapNumber, FapSequence, Profile, ValueFormat, check_fap, name_token, read_fap,
        write_fap, write_fap_as,
    };
}
pub mod features {
    pub use crate::modules::features::{ACTION_UNITS, ActionUnit, Course, FULL, FrameFeatures, Intensity};
}
pub mod fit {
    pub use crate::modules::fit::placement;
    pub use crate::modules::fit::{
        Correspondence, CorrespondenceError, DEFAULT_MODES, DrivenNode, FIT_FORCE, FacePoints, FitError, FitOptions,
        FittedWireframe, Fitter, LearnError, LoadedPrior, MarksError, NeutralFace, PriorKind, Pull, ShapePrior, Springs,
        learn_prior, read_correspondences, read_neutral_faces, read_prior, validate_correspondences, write_correspondences,
    };
}
#[cfg(feature = "tool")]
pub mod fuzzing {
    pub use crate::modules::fuzzing::{TARGETS, Target, dictionary, mutate, target};
}
pub mod geometry {
    pub use crate::modules::geometry::Similarity;
    pub mod polygon {
        pub use crate::modules::geometry::polygon::inside;
    }
}
pub mod input {
    pub use crate::modules::input::{CsvFile, InputError, read};
}
pub mod interpolation {
    pub use crate::modules::interpolation::FPS;
}
pub mod locate {
    pub use crate::modules::locate::{LEAST_SCORE, LocateOptions, LocatedFace, Locator, Model, PUPILS, points};
    pub mod learn {
        pub use crate::modules::locate::learn::{TrainingFace, read_faces};
    }
}
pub mod mesh {
    pub use crate::modules::mesh::{TriangleMesh, read_obj, read_ply, vertex_normals, write_ply};
}
pub mod model {
    pub use crate::modules::model::{DynamicExpressionModel, FrameExpressionModel, ModelError};
}
pub mod normalize {
    pub use crate::modules::normalize::{CANONICAL_ES, Canonical, FRAMES_PER_MODEL, NormalizeOptions, Normalizer, PoseMode};
}
pub mod output {
    pub use crate::modules::output::{
        FolderRecord, OutputError, count, csv_into, csv_writer, listed, nine_digits, write_atomic, write_bytes, write_json,
    };
}
pub mod overlay {
    pub use crate::modules::overlay::draw_overlay;
}
pub mod pipeline {
    pub use crate::modules::pipeline::{
        AnalyzedModel, Event, FapOptions, FoundMarks, FoundMarksError, Method, NONE_LEVEL, PipelineOptions, Recording,
        RecordingError, RunError, RunSummary, SegmentedRecording, SequenceFailure, SequenceSource, Workbench, WorkbenchError,
        analyze, by_hand, face_of_marks, fit_beside, fit_landmarks, found_marks, found_marks_and_remark, held, id_of,
        left_out_said, load_tracks, normalize_track, read_model, run, segment_recording, showcase_target, track_files, track_one,
        track_pictures, write_analysis, write_model,
    };
}
pub mod plausible {
    pub use crate::modules::plausible::FaceSize;
}
pub mod pose {
    pub use crate::modules::pose::{HEAD_ES, HeadModel, HeadPose, PoseError};
}
pub mod positions {
    pub use crate::modules::positions::{PositionRow, PositionTable};
}
pub mod render {
    pub use crate::modules::render::{Canvas, Labelled, Shade, Vertex};
}
pub mod report {
    pub use crate::modules::report::{ApexFap, Failure, ReportData, Stage, failed_name, render_html};
}
pub mod segment {
    pub use crate::modules::segment::{Phase, SegmentOptions};
}
pub mod sequence {
    pub use crate::modules::sequence::{
        Clock, DecodeError, Frame, GrayDecoder, ImageSize, Portrait, SequenceError, SequenceReader, content_blake3, grey_of,
        read_colour, read_colour_frames, read_first_frame, read_frame,
    };
}
pub mod statistics {
    pub use crate::modules::statistics::{
        ClassLabel, EMOTIONS, MedianKind, Representative, SequenceModel, StatisticsError, StatisticsOptions, check_models,
        representative,
    };
    pub mod bootstrap {
        pub use crate::modules::statistics::bootstrap::{LEAST_PEOPLE, dispersion_replicates};
    }
    pub mod compare {
        pub use crate::modules::statistics::compare::{CompareOptions, Comparison, adjust, compare, test};
    }
    pub mod distance {
        pub use crate::modules::statistics::distance::{DisplacementFields, vector_distance};
    }
    pub mod recognize {
        pub use crate::modules::statistics::recognize::{RecognizeError, Recognized, Recognizer, shown_by_several};
    }
    pub mod scale {
        pub use crate::modules::statistics::scale::{
            DEFAULT_MEMORY, SlotSource, representative_of_many, streamed_median, trim_certified,
        };
    }
}
pub mod synthesis {
    pub use crate::modules::synthesis::{
        Animation, BOUND_STARTS, Bank, BuildOptions, Crossover, EmbeddedBank, FaceScene, FeaturePointVertex, FpBasis, FpMotion,
        FrameAnswer, GENERATIONS, GaOptions, Generation, Goal, HeadTexture, OVERLAP, PerformanceOptions, RegionScheme, Regions,
        Run, Solver, SynthesisError, SynthesisOptions, Synthesizer, TOURNAMENT_SIZE, View, build_bank, candide_bank,
        candide_study, choose_members, choose_targets, evolve, mix, mix_bank, perform, read_dense_faces, read_motion,
        recipe_motions, surface_error, write_gltf,
    };
    pub mod arkit {
        pub use crate::modules::synthesis::arkit::{coefficient, coefficients, dominant_expressions, side};
    }
}
pub mod track {
    pub use crate::modules::track::{
        AlignOptions, Confidence, Found, FrameQuality, Klt, LossReason, NodeFeatures, NodeState, OpenCvKlt, PointTracker, Probe,
        Slot, Track, TrackError, TrackFileError, TrackInfo, TrackOptions, TrackPlan, TrackQuality, TrackSummary, TrackedFrame,
        TrackedNode, Verdict, expect_errors, eye_distance_px, node_features, read_track, read_track_info, seconds_of, summarize,
        track_csv, track_model, track_sequence, track_with, window_px, write_track,
    };
}
pub mod units {
    pub use crate::modules::units::{FaceUnit, NodeId, Px, SequenceId, Unit};
}
pub mod warp {
    pub use crate::modules::warp::{MouthInside, Texture, Warp, WarpError, convex_hull};
}
pub mod wireframe {
    pub use crate::modules::wireframe::{
        Emotion, ExpressionUnit, Face, Fapu, Fapus, FapusError, LID_MARGINS, LandmarkConfidence, LandmarkRow, MarkableNode,
        Region, SuggestedMark, Tables, UnitKind, Wireframe, expressions, find_unit, keep_lips_apart, markable_nodes,
        parse_node_or_feature_point, settle_offsets, suggested_marks, write_wfm,
    };
}
