//! The main job in stages: dataset, tracks, normalized models, representatives, FAP files, report.

mod amplitudes;
mod analysis;
mod beside;
mod check;
mod classes;
#[cfg(feature = "columnar")]
mod columnar;
mod corrected;
mod covariates;
mod differing;
mod divide;
mod figures;
mod files;
mod folder;
mod found;
mod groups;
mod inputs;
mod landmarks;
mod ledger;
mod looks;
mod measured;
mod method;
mod model_file;
mod neutral;
mod overlays;
mod parts;
mod pictures;
mod recognition;
mod recording;
mod run;
mod same;
mod sequence;
mod sequence_table;
mod showcase;
mod skins;
mod tracks;
mod units;
mod unseen;
mod variation;
mod work;
mod write;

use std::{collections::BTreeMap, ops::Deref, path::Path, sync::OnceLock};

use image::{GrayImage, RgbImage};
use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use crate::{
    clone::{CloneError, Target},
    dataset::{LEAST_CONFIDENCE, LandmarkSelection, may_publish},
    fap::Profile,
    features::{FeatureMeter, FrameFeatures, Measured},
    fit::{Correspondence, FitError, FitOptions, FittedWireframe, Fitter, SpringError},
    interpolation::{FPS, FRAMES_BETWEEN},
    model::DynamicExpressionModel,
    normalize::{NormalizeOptions, Normalizer, PoseMode},
    output::MADE_BY,
    pose::{HeadFit, HeadFitter, PoseError},
    report::Stage,
    statistics::{StatisticsOptions, compare::GroupOptions},
    track::{LandmarkPlan, TrackOptions, TrackPlan, TrackedFrame},
    units::{FaceUnit, NodeId, Px},
    wireframe::{Face, FapusError, WfmError, Wireframe, read_wfm},
};

pub use crate::input::file_blake3;
pub use crate::report::Failure;
pub use amplitudes::AmplitudeResults;
pub use analysis::{Analysis, AnalysisError, AnalyzedClass, AnalyzedModel, analyze};
pub use beside::{face_of_marks, held};
pub use check::{CheckedColumn, CheckedEmotion, DatasetCheck, check_dataset, write_check};
#[cfg(feature = "columnar")]
pub use columnar::{analyze_columnar, load_columnar, write_columnar};
pub use corrected::{correct_track, corrections_said};
pub(crate) use differing::differing_wireframes;
pub use divide::{run_emotion, run_part, run_plan};
pub use figures::{figure_files, figures_of, write_figures};
pub use files::{RunJson, RunJsonError, SCHEMA_VERSION, SequenceRecord, read_run_json};
pub use found::{FoundFace, FoundMarks, FoundMarksError, found_face, found_marks, found_marks_and_remark};
pub use landmarks::fit_landmarks;
pub use measured::normalize_track;
pub use method::Method;
pub use model_file::{ModelFileError, read_model, write_model};
pub use neutral::{NeutralFit, by_hand, fit_beside};
pub use overlays::{OverlayFolder, overlay_pictures};
pub use pictures::{PictureSource, ReadPicture, pictures_of};
pub use recognition::{
    NONE_LEVEL, RecognitionResults, RecognizedRow, left_out_said, recognition_header, recognition_record, write_recognition,
};
pub use recording::{
    EarlierSegments, GivenForAll, KeptRows, ManifestColumns, Recording, RecordingError, RecordingFiles, RecordingOutputs,
    RecordingStep, SegmentRow, SegmentedRecording, UNLABELLED, keep_edited, reuse_recording, segment_recording, segments_folder,
    write_recording, write_recording_film, write_segments,
};
pub use run::{Event, RunError, RunSummary, run};
pub use sequence::{SequenceFailure, SequenceSource, track_one, track_pictures};
pub use showcase::{PORTRAIT_NAME, ReportFace, showcase_remarks, showcase_target};
pub(crate) use tracks::ANALYZE_RECORD;
pub use tracks::{id_of, load_tracks, load_unlabelled_tracks, results_folder, track_files, tracks_folder};
pub use unseen::{Unseen, track_unseen};
pub use write::{ANALYSIS_TABLES, analysis_files, write_analysis};

/// Options of all stages, one struct per stage.
///
/// ```
/// use grimace::pipeline::{PipelineOptions, Workbench};
///
/// let options = PipelineOptions { by: vec!["cohort".to_owned()], no_faces: true, ..PipelineOptions::default() };
/// assert_eq!(Workbench::new(None, options)?.options.by, ["cohort"]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PipelineOptions {
    /// Fit of the wireframe.
    pub fit: FitOptions,
    /// Tracking.
    pub track: TrackOptions,
    /// Normalization.
    pub normalize: NormalizeOptions,
    /// Statistics.
    pub statistics: StatisticsOptions,
    /// FAP files.
    pub fap: FapOptions,
    /// Manifest columns to group by, besides the emotion; may be empty.
    pub by: Vec<String>,
    /// Manifest columns that restrict the permutation tests: labels are exchanged only among people with equal values. May be empty.
    #[serde(default)]
    pub strata: Vec<String>,
    /// Manifest columns of numbers, such as ages, to test for association with the expressions; may be empty.
    #[serde(default)]
    pub covariates: Vec<String>,
    /// Landmarks that become correspondences for sequences without marks.
    pub marks: LandmarkSelection,
    /// Face on which the report animates the representatives.
    #[serde(default)]
    #[doc(hidden)]
    pub report_face: ReportFace,
    /// Whether to show wireframes only: no picture of a face in or beside the report.
    #[serde(default)]
    pub no_faces: bool,
    /// Whether to skip the comparison of given marks with the face in the neutral frame.
    #[serde(default)]
    pub unchecked_marks: bool,
    /// Options for sequences given as landmarks.
    #[serde(default)]
    pub landmarks: LandmarkOptions,
    /// Intervals and tests of groups.
    #[serde(default)]
    pub groups: GroupOptions,
    /// Whether to write `models.parquet`.
    #[cfg(feature = "columnar")]
    #[serde(default)]
    pub columnar: bool,
}

impl PipelineOptions {
    /// Whether pictures of a sequence may be shown: not with `no_faces`, and not if its column `publish` forbids it.
    pub fn shows(&self, metadata: &BTreeMap<String, String>) -> bool {
        !self.no_faces && may_publish(metadata)
    }
}

/// Options for sequences given as landmarks.
///
/// ```
/// use grimace::pipeline::{LandmarkOptions, PipelineOptions};
///
/// let landmarks = LandmarkOptions { prefer: true, ..LandmarkOptions::default() };
/// let options = PipelineOptions { landmarks, ..PipelineOptions::default() };
/// assert_eq!(options.landmarks.least_confidence, 0.75);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LandmarkOptions {
    /// Confidence below which a frame counts as lost, 0 to 1, for files that state one.
    pub least_confidence: f64,
    /// Whether landmarks drive a sequence that also has images.
    pub prefer: bool,
}

impl Default for LandmarkOptions {
    fn default() -> Self {
        Self { least_confidence: LEAST_CONFIDENCE, prefer: false }
    }
}

/// Options of the FAP files.
///
/// ```
/// use grimace::pipeline::{FapOptions, PipelineOptions};
///
/// let fap = FapOptions { fps: 50, ..FapOptions::default() };
/// let options = PipelineOptions { fap, ..PipelineOptions::default() };
/// assert_eq!((options.fap.fps, options.fap.between), (50, 5));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FapOptions {
    /// Interpolated frames between two key frames.
    pub between: usize,
    /// Frames per second, at least 1.
    pub fps: u32,
    /// Players that the files are written for.
    #[serde(default)]
    pub profile: Profile,
}

impl Default for FapOptions {
    fn default() -> Self {
        Self { between: FRAMES_BETWEEN, fps: FPS, profile: Profile::default() }
    }
}

/// Errors of [`Workbench::new`].
///
/// ```
/// use grimace::pipeline::{Workbench, WorkbenchError};
///
/// let error = Workbench::new(Some("no-such-file.wfm".as_ref()), Default::default()).unwrap_err();
/// assert!(matches!(error, WorkbenchError::Wfm(_)));
/// ```
#[derive(Debug, thiserror::Error)]
pub enum WorkbenchError {
    /// The file cannot be read.
    #[error(transparent)]
    Wfm(#[from] WfmError),
    /// The file cannot be read.
    #[error("cannot read the wireframe: {0}")]
    Io(#[from] std::io::Error),
    /// The wireframe lacks nodes on which FAPUs are measured.
    #[error("the wireframe cannot be used: {0}")]
    Fapus(#[from] FapusError),
}

/// A wireframe with the data computed once for it, and the options of all stages.
///
/// ```
/// use grimace::{correspondence::read_correspondences, pipeline::Workbench};
///
/// let bench = Workbench::new(None, Default::default())?;
/// let marks = read_correspondences("fixtures/simulated/S001/005/correspondences.csv".as_ref(), &bench.tables, 113)?;
/// assert_eq!(bench.fit(&marks)?.model.node_count(), bench.wireframe.node_count());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Workbench {
    /// The wireframe and its tables. `bench.wireframe` is short for `bench.face.wireframe`.
    pub face: Face,
    /// Options of every stage.
    pub options: PipelineOptions,
    fitter: Fitter,
    plan: TrackPlan,
    /// Created for the first sequence that landmarks drive.
    landmark_plan: OnceLock<Result<LandmarkPlan, SpringError>>,
    /// Created for the first head pose.
    head: OnceLock<HeadFitter>,
    /// Created for the first features.
    meter: OnceLock<Result<FeatureMeter, String>>,
    /// BLAKE3 of the wireframe file; `None` for the embedded Candide-3, which the program version identifies.
    wireframe_blake3: Option<String>,
}

impl Deref for Workbench {
    type Target = Face;

    fn deref(&self) -> &Face {
        &self.face
    }
}

impl Workbench {
    /// Returns a workbench for Candide-3, or for a `.wfm` file with Candide-3's node numbers.
    ///
    /// # Errors
    /// [`WorkbenchError`] when the file cannot be read or has no FAPUs.
    pub fn new(wfm: Option<&Path>, options: PipelineOptions) -> Result<Self, WorkbenchError> {
        let wireframe = wfm.map_or_else(|| Ok(Wireframe::candide3()), read_wfm)?;
        let wireframe_blake3 = match wfm {
            Some(path) => Some(blake3::hash(&crate::input::read(path)?).to_hex().to_string()),
            None => None,
        };
        let face = Face::new(wireframe);
        let fitter = Fitter::new(&face.wireframe, options.fit.clone());
        let plan = TrackPlan::new(&face.wireframe, &face.tables);
        let bench = Self {
            face,
            options,
            fitter,
            plan,
            landmark_plan: OnceLock::new(),
            head: OnceLock::new(),
            meter: OnceLock::new(),
            wireframe_blake3,
        };
        bench.normalizer()?;
        Ok(bench)
    }

    /// Returns the fitter of the wireframe.
    pub fn fitter(&self) -> &Fitter {
        &self.fitter
    }

    /// Returns the tracker's tables for the wireframe.
    pub fn plan(&self) -> &TrackPlan {
        &self.plan
    }

    /// Returns the tables by which landmarks drive the wireframe.
    ///
    /// # Errors
    /// [`SpringError`] when no landmark corresponds to a node of the wireframe.
    pub fn landmark_plan(&self) -> Result<&LandmarkPlan, SpringError> {
        let make = || LandmarkPlan::new(&self.wireframe, &self.tables, self.options.track.force);
        self.landmark_plan.get_or_init(make).as_ref().map_err(Clone::clone)
    }

    /// Returns the fitter of heads to tracks.
    pub fn head_fitter(&self) -> &HeadFitter {
        self.head.get_or_init(|| HeadFitter::new(&self.wireframe, &self.tables))
    }

    /// Fits the wireframe to the marks of a neutral frame. It allows for a turned head, unless normalization removes roll only.
    ///
    /// # Errors
    /// [`FitError`].
    pub fn fit(&self, marks: &[Correspondence]) -> Result<FittedWireframe, FitError> {
        match self.options.normalize.pose {
            PoseMode::Full => self.head_fitter().fit_neutral(&self.fitter, &self.wireframe, marks),
            PoseMode::Roll => self.fitter.fit(&self.wireframe, marks),
        }
    }

    /// Returns a photograph with marks as a target for clones, its wireframe fitted with [`Workbench::fit`].
    ///
    /// # Errors
    /// As [`Target::new`].
    pub fn target(&self, name: &str, picture: RgbImage, marks: &[Correspondence]) -> Result<Target, CloneError> {
        Target::fitted_by(|marks| self.fit(marks), name, picture, marks, self)
    }

    /// As [`Workbench::target`] for marks given by the user, fitted to the grey picture with [`Workbench::fit_in`]. Also returns its
    /// messages about the marks.
    ///
    /// # Errors
    /// As [`Target::new`].
    pub(crate) fn marked_target(
        &self,
        name: &str,
        (picture, grey): (RgbImage, &GrayImage),
        marks: &[Correspondence],
    ) -> Result<(Target, Vec<String>), CloneError> {
        let mut beside = Vec::new();
        let fit = |marks: &[Correspondence]| {
            let fit = self.fit_in(grey, marks)?;
            beside = fit.beside;
            Ok(fit.fitted)
        };
        let target = Target::fitted_by(fit, name, picture, marks, self)?;
        Ok((target, beside))
    }

    /// Fits head, poses and expressions to a track; `marks` are the known marks of its neutral frame.
    ///
    /// # Errors
    /// [`PoseError`].
    pub fn fit_head(&self, track: &[TrackedFrame], marks: &[(NodeId, Point2<f64>)]) -> Result<HeadFit, PoseError> {
        self.head_fitter().fit(&self.tables, track, marks)
    }

    /// Returns the model of a track without head rotation.
    ///
    /// # Errors
    /// [`PoseError`].
    pub fn frontal_model(&self, fit: &HeadFit, track: &[TrackedFrame]) -> Result<DynamicExpressionModel<Px>, PoseError> {
        self.head_fitter().frontal((&self.wireframe, &self.tables), fit, track)
    }

    /// Returns pose, FAPs and action units of every frame of a track. `model` is its model without head motion, `seconds` are the times of
    /// its frames, empty if unknown ([`TrackInfo::seconds`](crate::track::TrackInfo::seconds)).
    ///
    /// # Errors
    /// A message when the track has no features.
    pub fn features(
        &self,
        track: &[TrackedFrame],
        fit: &HeadFit,
        model: &DynamicExpressionModel<Px>,
        seconds: &[f64],
    ) -> Result<Vec<FrameFeatures>, String> {
        self.measured(model, |meter, normalizer, model| {
            meter.measure(Measured { track, fit, model, seconds }, normalizer, &self.tables).map_err(|e| e.to_string())
        })?
    }

    /// Order of a track: how much better action units explain its motion from the first to the last frame than the reverse, -1 to 1
    /// ([`FeatureMeter::order`]). `model` is the track's model without head motion.
    ///
    /// # Errors
    /// A message when the track has no features.
    pub fn order(&self, track: &[TrackedFrame], model: &DynamicExpressionModel<Px>) -> Result<f64, String> {
        let [neutral, .., apex] = model.frames() else { return Ok(0.0) };
        let ends = DynamicExpressionModel::new(vec![neutral.clone(), apex.clone()]).map_err(|e| e.to_string())?;
        self.measured(&ends, |meter, normalizer, model| meter.order(track, model, normalizer, &self.tables))
    }

    /// Calls a function with the feature meter, its normalizer, and all normalized frames of a model.
    fn measured<T>(
        &self,
        model: &DynamicExpressionModel<Px>,
        measure: impl FnOnce(&FeatureMeter, &Normalizer<'_>, &DynamicExpressionModel<FaceUnit>) -> T,
    ) -> Result<T, String> {
        let normalize = FeatureMeter::normalize_options(self.options.normalize);
        let normalizer = Normalizer::new(&self.wireframe, &self.tables, normalize).map_err(|e| e.to_string())?;
        let make = || FeatureMeter::new(self.head_fitter().model(), &normalizer).map_err(|e| e.to_string());
        let meter = self.meter.get_or_init(make).as_ref().map_err(Clone::clone)?;
        let model = normalizer.normalize_every_frame(model).map_err(|e| e.to_string())?;
        Ok(measure(meter, &normalizer, &model))
    }

    /// Returns the normalizer of tracked models.
    ///
    /// # Errors
    /// [`FapusError`] when the wireframe has no FAPUs; never after [`Workbench::new`].
    pub fn normalizer(&self) -> Result<Normalizer<'_>, FapusError> {
        Normalizer::new(&self.wireframe, &self.tables, self.options.normalize)
    }
}
