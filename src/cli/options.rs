//! Options of the stages of the library, shared by several commands.

use std::path::{Path, PathBuf};

use clap::builder::{PossibleValuesParser, TypedValueParser};
use grimace::{
    dataset::LandmarkSelection,
    fap::Profile,
    fit::{FitOptions, LoadedPrior, PriorKind},
    normalize::{IrisdMode, NormalizeOptions, PoseMode, Resample, SizeMode},
    pipeline::{FapOptions, LandmarkOptions, Method, PipelineOptions, ReportFace},
    statistics::{
        MedianKind, StatisticsOptions, TrimLevel, Weighting,
        amplitude::AmplitudeOptions,
        compare::{CompareOptions, GroupOptions},
    },
    track::{AlignOptions, Forces, KltKind, TrackOptions},
};
use serde::de::DeserializeOwned;

use super::numbers::{alpha, count, draws, gain, gain_or_none, not_negative, positive, power, share, share_up_to_one, whole};

/// One of several words, converted to the enum of the library with the same words.
pub fn words<T: DeserializeOwned + Clone + Send + Sync + 'static>(
    list: &'static [&'static str],
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(list).try_map(|word| serde_json::from_value::<T>(serde_json::Value::String(word)))
}

fn landmark_marks(text: &str) -> Result<LandmarkSelection, String> {
    text.parse()
}

fn prior(text: &str) -> Result<PriorKind, String> {
    match text {
        "none" => Ok(PriorKind::None),
        "candide" => Ok(PriorKind::Candide),
        "faces" => Ok(PriorKind::Faces),
        "auto" => Ok(PriorKind::Auto),
        path => match LoadedPrior::read(Path::new(path)) {
            Ok(loaded) => Ok(PriorKind::File(loaded)),
            Err(error) => {
                let reason = grimace::text::message(&error.to_string()).into_owned();
                Err(format!("expected none, candide, faces, auto or a prior file: {reason}"))
            }
        },
    }
}

/// The method as a whole.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Method")]
pub struct MethodArgs {
    /// Method: this program's (`default`), or that of Krinidis and Pitas as published (`kp`)
    ///
    /// `kp` sets --prior none, --read-unmarked off, --forces same, --forward-backward 0, --align-gain 0, --corner-stiffness 0, --lip-probes
    /// off, --rigid-eyes off, --even-light off, --read-lids off, --read-lips off, --locate-lost off, --pose roll, --irisd boxes and --weight sequence, for the options that the
    /// command has. You can still set each of them yourself.
    #[arg(long, default_value = "default", value_parser = words::<Method>(&["default", "kp"]))]
    pub method: Method,
}

/// Options of the fit.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Fit")]
pub struct FitArgs {
    /// Shape prior of the fit, applied before the springs [default: auto]
    ///
    /// `none` uses a similarity transform and the springs only, `candide` Candide's shape units, `faces` shapes learned from 90 real people.
    /// `auto` takes candide or faces, whichever explains the marks. FILE is a prior made with `grimace prior`.
    #[arg(long, value_parser = prior, value_name = "none|candide|faces|auto|FILE")]
    prior: Option<PriorKind>,
    /// Force on a marked node per pixel of distance, relative to the stiffness of a spring
    #[arg(long, default_value_t = FitOptions::default().force, value_parser = gain, value_name = "GAIN")]
    fit_force: f64,
    /// Also find the unmarked nodes in the picture [default: on]
    ///
    /// This needs seven or more hand-set marks that agree with the face found in the picture. With off, the fit uses the marks only.
    #[arg(long, value_parser = switch, action = clap::ArgAction::Set, value_name = "on|off")]
    read_unmarked: Option<bool>,
}

impl FitArgs {
    pub fn options(&self) -> FitOptions {
        self.options_of(Method::Default)
    }

    /// The options; those that are not given have the values of the method.
    pub fn options_of(&self, method: Method) -> FitOptions {
        let of_method = method.fit();
        FitOptions {
            force: self.fit_force,
            prior: self.prior.clone().unwrap_or(of_method.prior),
            read_unmarked: self.read_unmarked.unwrap_or(of_method.read_unmarked),
        }
    }
}

/// Options of the tracker.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Track")]
pub struct TrackArgs {
    /// Side of the KLT window, as a share of the eye distance
    #[arg(long, default_value_t = TrackOptions::default().window, value_parser = share_up_to_one, value_name = "SHARE")]
    window: f64,
    /// Number of pyramid levels, including the image itself
    #[arg(long, default_value_t = TrackOptions::default().levels, value_parser = clap::value_parser!(u32).range(1..=8))]
    levels: u32,
    /// Largest forward-backward distance, as a share of the eye distance; 0 omits this check [default: 0.01]
    #[arg(long, value_parser = not_negative, value_name = "SHARE")]
    forward_backward: Option<f64>,
    /// Largest difference of a displacement from its neighbours', in robust standard deviations; beyond it the displacement is extreme
    #[arg(long, default_value_t = TrackOptions::default().extreme, value_parser = positive, value_name = "FACTOR")]
    extreme: f64,
    /// Forces on tracked nodes: by how well each displacement is determined (`measured`), or the `same` for all [default: measured]
    #[arg(long, value_parser = words::<Forces>(&["measured", "same"]), value_name = "FORCES")]
    forces: Option<Forces>,
    /// Force on a tracked node per pixel, relative to the stiffness of a spring
    ///
    /// With --forces same this is the force on every node. With --forces measured it is the force on a node whose window has gradients (grey
    /// levels per pixel) as large as its mismatch (grey levels); nodes with clearer windows get a larger force.
    #[arg(long, default_value_t = TrackOptions::default().force, value_parser = gain, value_name = "GAIN")]
    track_force: f64,
    /// Weight of the mismatch of two windows against their gradients, for --forces measured; 0 ignores the mismatch
    #[arg(long, default_value_t = TrackOptions::default().mismatch, value_parser = not_negative, value_name = "WEIGHT")]
    mismatch: f64,
    /// Gain of the alignment with the neutral frame; 0 omits the alignment [default: 150]
    #[arg(long, value_parser = gain_or_none, value_name = "GAIN")]
    align_gain: Option<f64>,
    /// Stiffness of the springs between the inner and outer corners of the mouth; 0 omits them [default: 25]
    #[arg(long, value_parser = not_negative, value_name = "STIFFNESS")]
    corner_stiffness: Option<f64>,
    /// Search for the nodes of each inner lip within that lip [default: on]
    #[arg(long, value_parser = switch, value_name = "on|off")]
    lip_probes: Option<bool>,
    /// Move the corners of each iris box together [default: on]
    #[arg(long, value_parser = switch, value_name = "on|off")]
    rigid_eyes: Option<bool>,
    /// Adjust the brightness of every frame to the neutral frame, against changing exposure or light [default: on]
    #[arg(long, value_parser = switch, value_name = "on|off")]
    even_light: Option<bool>,
    /// Read the position of closing upper lids from the picture of the eye [default: on]
    #[arg(long, value_parser = switch, value_name = "on|off")]
    read_lids: Option<bool>,
    /// Read the position of moved lips from the picture of the mouth [default: on]
    #[arg(long, value_parser = switch, value_name = "on|off")]
    read_lips: Option<bool>,
    /// Locate the face again in a large step, as between two photographs [default: on]
    #[arg(long, value_parser = switch, value_name = "on|off")]
    locate_lost: Option<bool>,
    /// Deform the wireframe after every step, which places lost nodes; with off they stay where they were
    #[arg(long, default_value = "on", value_parser = switch, action = clap::ArgAction::Set, value_name = "on|off")]
    deform: bool,
    /// Implementation of the pyramidal KLT tracker: this program's (`grimace`), or the slower reference of OpenCV (`opencv`)
    ///
    /// Their tracks differ by a few ten-thousandths of a pixel.
    #[arg(long, default_value = "grimace", value_parser = words::<KltKind>(&["grimace", "opencv"]))]
    klt: KltKind,
}

fn switch(text: &str) -> Result<bool, String> {
    match text {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err("expected on or off".to_owned()),
    }
}

impl TrackArgs {
    pub fn options(&self) -> TrackOptions {
        self.options_of(Method::Default)
    }

    /// The options; those that are not given have the values of the method.
    pub fn options_of(&self, method: Method) -> TrackOptions {
        let of = method.track();
        TrackOptions {
            window: self.window,
            levels: self.levels,
            forward_backward: self.forward_backward.unwrap_or(of.forward_backward),
            extreme: self.extreme,
            force: self.track_force,
            mismatch: self.mismatch,
            forces: self.forces.unwrap_or(of.forces),
            lip_probes: self.lip_probes.unwrap_or(of.lip_probes),
            rigid_eyes: self.rigid_eyes.unwrap_or(of.rigid_eyes),
            even_light: self.even_light.unwrap_or(of.even_light),
            read_lids: self.read_lids.unwrap_or(of.read_lids),
            read_lips: self.read_lips.unwrap_or(of.read_lips),
            locate_lost: self.locate_lost.unwrap_or(of.locate_lost),
            deform: self.deform,
            align: AlignOptions {
                gain: self.align_gain.unwrap_or(of.align.gain),
                corners: self.corner_stiffness.unwrap_or(of.align.corners),
                ..of.align
            },
            klt: self.klt,
        }
    }
}

/// How sequences of any length become models of five frames.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Normalization and statistics")]
pub struct ResampleArgs {
    /// How to take the five key frames from a sequence: the nearest frame, or linear interpolation
    #[arg(long, default_value = "nearest", value_parser = words::<Resample>(&["nearest", "linear"]))]
    pub resample: Resample,
}

/// Options of normalization and of the generalized median.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Normalization and statistics")]
pub struct ModelArgs {
    #[command(flatten)]
    frames: ResampleArgs,
    /// How to normalize size: by the FAPUs of each facial region, or by the eye separation alone
    #[arg(long, default_value = "fapu", value_parser = words::<SizeMode>(&["fapu", "uniform"]))]
    size: SizeMode,
    /// Head motion to remove: yaw, pitch and roll with a three-dimensional head (`full`), or `roll` only [default: full; roll with
    /// --method kp]
    #[arg(long, value_parser = words::<PoseMode>(&["full", "roll"]))]
    pose: Option<PoseMode>,
    /// Unit of eye motion, IRISD0: the opening of the neutral lids (MPEG-4), or the height of the neutral iris boxes (Candide-3's report)
    /// [default: lids; boxes with --method kp]
    #[arg(long, value_parser = words::<IrisdMode>(&["lids", "boxes"]), value_name = "WHAT")]
    irisd: Option<IrisdMode>,
    /// Share of the models to trim from each displacement field, from 0 to less than 0.5
    #[arg(long, default_value_t = StatisticsOptions::default().alpha, value_parser = alpha)]
    alpha: f64,
    /// What to trim: single displacement fields, ranked per frame (`frame`), or whole models (`model`)
    #[arg(long, default_value = "frame", value_parser = words::<TrimLevel>(&["frame", "model"]))]
    trim: TrimLevel,
    /// What gets equal weight: every person, whatever the number of sequences, or every sequence [default: person]
    #[arg(long, value_parser = words::<Weighting>(&["person", "sequence"]), value_name = "WHAT")]
    weight: Option<Weighting>,
    /// Generalized median that becomes the representative; the gap between the two is always reported
    #[arg(long, default_value = "greedy", value_parser = words::<MedianKind>(&["greedy", "exact"]))]
    median: MedianKind,
}

impl ModelArgs {
    /// The options of normalization; those that are not given have the values of the method.
    pub fn normalize_of(&self, method: Method) -> NormalizeOptions {
        let by_method = method.normalize();
        NormalizeOptions {
            resample: self.frames.resample,
            size: self.size,
            pose: self.pose.unwrap_or(by_method.pose),
            irisd: self.irisd.unwrap_or(by_method.irisd),
        }
    }

    pub fn statistics(&self) -> StatisticsOptions {
        self.statistics_of(Method::Default)
    }

    /// The options of the statistics; those that are not given have the values of the method.
    pub fn statistics_of(&self, method: Method) -> StatisticsOptions {
        let weighting = self.weight.unwrap_or(method.statistics().weighting);
        StatisticsOptions { alpha: self.alpha, median: self.median, weighting, trim: self.trim }
    }
}

/// Columns of the manifest that the analysis goes by.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Normalization and statistics")]
#[command(group(clap::ArgGroup::new("tested").args(["by", "covariate"]).multiple(true)))]
pub struct ColumnArgs {
    /// Manifest columns to group by, in addition to the emotion; separated by commas
    #[arg(long, alias = "group-by", value_delimiter = ',', value_name = "COLUMN")]
    by: Vec<String>,
    /// Manifest columns, such as site, that define strata: tests permute labels only between people with the same values
    #[arg(long, value_delimiter = ',', value_name = "COLUMN", requires = "tested")]
    strata: Vec<String>,
    /// Numeric manifest columns, such as age: test whether the expressions change with them
    ///
    /// Also writes what the expressions look like at low and at high values.
    #[arg(long, value_delimiter = ',', value_name = "COLUMN")]
    covariate: Vec<String>,
}

impl ColumnArgs {
    pub fn fill(&self, options: &mut PipelineOptions) {
        options.by.clone_from(&self.by);
        options.strata.clone_from(&self.strata);
        options.covariates.clone_from(&self.covariate);
    }
}

/// Options of normalization, statistics and FAP files.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Normalization and statistics")]
pub struct AnalysisArgs {
    #[command(flatten)]
    models: ModelArgs,
    #[command(flatten)]
    columns: ColumnArgs,
    /// Largest difference of amplitudes that counts as equivalent, in multiples of the median motion
    #[arg(long, default_value_t = AmplitudeOptions::default().equivalence, value_parser = positive, value_name = "AMPLITUDE")]
    equivalence: f64,
    /// Power, 0.5 to 0.99, for which the results report the number of people a study needs
    #[arg(long, default_value_t = AmplitudeOptions::default().power, value_parser = power, value_name = "SHARE")]
    power: f64,
    /// Number of permutations of every test
    #[arg(long, default_value_t = CompareOptions::default().permutations, value_parser = count(99, 10_000_000), value_name = "COUNT")]
    permutations: usize,
    /// Maximum number of people per group, or per numeric column, in a test; more are reduced by a random draw
    #[arg(long, default_value_t = CompareOptions::default().people, value_parser = count(5, 2000), value_name = "COUNT")]
    test_people: usize,
    /// Number of bootstrap draws of people for the 95 % interval of every dispersion, with groups only: 99 or more, 0 for no intervals
    #[arg(long, default_value_t = GroupOptions::default().bootstrap, value_parser = draws, value_name = "COUNT")]
    bootstrap: usize,
    /// Random seed of permutations and draws
    #[arg(long, default_value_t = CompareOptions::default().seed)]
    seed: u64,
    /// Also write all normalized models into one Parquet file, models.parquet
    #[arg(long)]
    columnar: bool,
    /// Number of interpolated frames between every two of the five key frames of a FAP file
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u16).range(0..=10_000), value_name = "FRAMES")]
    between: u16,
    /// Photograph on which the report shows the representatives, a neutral face from the front; by default a composite portrait
    #[arg(long, alias = "report-face", value_name = "PORTRAIT")]
    portrait: Option<PathBuf>,
    /// Marked points on the portrait, a CSV file node,x,y, or 68 landmarks point,x,y, in pixels; by default found in it
    #[arg(short, long, alias = "report-marks", requires = "portrait", value_name = "C.csv")]
    correspondences: Option<PathBuf>,
    /// Show wireframes only; write no picture of a person into the report or its folder
    #[arg(long, conflicts_with = "portrait")]
    no_faces: bool,
    /// Frames per second of the FAP files; by default 25, the only rate for Greta
    #[arg(long, value_parser = whole::<u32>(1, 1000))]
    fps: Option<u32>,
    #[command(flatten)]
    profile: ProfileArgs,
}

/// Whom FAP files are written for.
#[derive(Debug, clap::Args)]
pub struct ProfileArgs {
    /// Program that will read the FAP files; `strict` writes the subset that all of them read
    ///
    /// `xface` changes lip values of 0 to 1 where Xface would show those of the other contour. `greta` uses 25 frames per second and writes a
    /// blank after each mask.
    #[arg(long, default_value_t, value_name = "strict|xface|greta|visage")]
    pub profile: Profile,
}

impl AnalysisArgs {
    pub fn fill(&self, options: &mut PipelineOptions, method: Method) -> anyhow::Result<()> {
        let profile = self.profile.profile;
        if let (Some(given), Some(only)) = (self.fps, profile.fixed_fps()) {
            anyhow::ensure!(
                given == only,
                "--fps {given}: the {profile} profile needs {only} frames per second; leave --fps out"
            );
        }
        options.normalize = self.models.normalize_of(method);
        options.statistics = self.models.statistics_of(method);
        self.columns.fill(options);
        if let Some(portrait) = &self.portrait {
            options.report_face = ReportFace::photograph(portrait, self.correspondences.as_deref());
        }
        options.columnar = self.columnar;
        options.no_faces = self.no_faces;
        options.groups.amplitude = AmplitudeOptions { equivalence: self.equivalence, power: self.power };
        options.groups.bootstrap = self.bootstrap;
        options.groups.compare = CompareOptions {
            permutations: self.permutations,
            people: self.test_people,
            seed: self.seed,
            ..CompareOptions::default()
        };
        let fps = self.fps.unwrap_or(FapOptions::default().fps);
        options.fap = FapOptions { between: usize::from(self.between), fps, profile };
        Ok(())
    }
}

/// Where marks come from when a sequence has landmarks only.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Marks and landmarks")]
pub struct MarksArgs {
    #[command(flatten)]
    pub which: WhichMarksArgs,
    /// Minimum confidence, 0 to 1, of a frame in a landmark file that has a confidence; frames below are lost
    #[arg(long, default_value_t = LandmarkOptions::default().least_confidence, value_parser = share, value_name = "SHARE")]
    landmark_confidence: f64,
    /// Use the landmarks of a sequence instead of its images, if it has both
    #[arg(long)]
    prefer_landmarks: bool,
}

/// Which landmarks of a picture serve as marks.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Marks and landmarks")]
pub struct WhichMarksArgs {
    /// Landmarks to use as marks if there are no correspondences: auto, default, high, all, or a list of nodes
    ///
    /// `auto` uses all landmarks, weighted by their expected errors, and finds marks in the neutral frame if there are no landmarks. The
    /// others use only the chosen landmarks and find none: `default` (corners of eyes and mouth, chin, ends of the brows), `high`, `all`, or a
    /// list of nodes such as 20,23,53,56,31,64,10.
    #[arg(long, default_value = "auto", value_parser = landmark_marks, value_name = "WHICH")]
    pub marks: LandmarkSelection,
}

impl MarksArgs {
    pub fn landmarks(&self) -> LandmarkOptions {
        LandmarkOptions { least_confidence: self.landmark_confidence, prefer: self.prefer_landmarks }
    }
}

/// Whether marks are held against the picture.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Marks and landmarks")]
pub struct CheckArgs {
    /// Compare given marks with the face found in the neutral frame, and report marks that do not fit it
    #[arg(long, default_value = "on", value_parser = switch, action = clap::ArgAction::Set, value_name = "on|off")]
    check_marks: bool,
}

impl CheckArgs {
    pub fn unchecked(&self) -> bool {
        !self.check_marks
    }
}
