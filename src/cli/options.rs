//! Options of the library's stages that several commands have.

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

use super::numbers::{alpha, count, gain, gain_or_none, not_negative, positive, power, share, share_up_to_one, whole};

/// One of some words, turned into the library's enum of the same words.
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
                Err(format!("neither none, candide, faces nor auto, nor a prior file: {reason}"))
            }
        },
    }
}

/// The method as a whole.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Method")]
pub struct MethodArgs {
    /// Ours, or Krinidis and Pitas' to the letter: `kp` sets --prior none, --read-unmarked off, --forces same, --forward-backward 0,
    /// --align-gain 0, --corner-stiffness 0, --lip-probes off, --rigid-eyes off, --even-light off, --read-lids off,
    /// --pose roll, --irisd boxes and --weight sequence, as far as the command has them; each can be set otherwise beside it
    #[arg(long, default_value = "default", value_parser = words::<Method>(&["default", "kp"]))]
    pub method: Method,
}

/// Options of the fit.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Fit")]
pub struct FitArgs {
    /// Shape prior ahead of the springs: `none` (similarity and springs alone), `candide` (Candide's shape units), `faces` (learned
    /// from 90 real people), `auto` (whichever of candide and faces explains the marks), or a file made by `grimace prior` [default: auto]
    #[arg(long, value_parser = prior, value_name = "none|candide|faces|auto|FILE")]
    prior: Option<PriorKind>,
    /// Force on a marked node per pixel, over the stiffness of a spring
    #[arg(long, default_value_t = FitOptions::default().force, value_parser = gain, value_name = "GAIN")]
    fit_force: f64,
    /// Read nodes without a mark in the picture, where seven marks and more were set by hand and agree with its face; off: the marks alone
    /// [default: on, with --method kp off]
    #[arg(long, value_parser = switch, action = clap::ArgAction::Set, value_name = "on|off")]
    read_unmarked: Option<bool>,
}

impl FitArgs {
    pub fn options(&self) -> FitOptions {
        self.options_of(Method::Default)
    }

    /// The options, those that are not given as the method has them.
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
    /// Side of the KLT window, over the eye distance
    #[arg(long, default_value_t = TrackOptions::default().window, value_parser = share_up_to_one, value_name = "SHARE")]
    window: f64,
    /// Pyramid levels, the image itself included
    #[arg(long, default_value_t = TrackOptions::default().levels, value_parser = clap::value_parser!(u32).range(1..=8))]
    levels: u32,
    /// Largest forward-backward distance, over the eye distance; 0 leaves the way back out [default: 0.01]
    #[arg(long, value_parser = not_negative, value_name = "SHARE")]
    forward_backward: Option<f64>,
    /// A displacement is extreme beyond this many robust standard deviations from its neighbours'
    #[arg(long, default_value_t = TrackOptions::default().extreme, value_parser = positive, value_name = "FACTOR")]
    extreme: f64,
    /// What forces on tracked nodes are made of: how well each displacement is determined (measured), or nothing (same: one for all)
    #[arg(long, value_parser = words::<Forces>(&["measured", "same"]), value_name = "FORCES")]
    forces: Option<Forces>,
    /// Force per pixel on a tracked node, over the stiffness of a spring: on every node with --forces same; with --forces measured on a
    /// node whose window has gradients, in grey levels per pixel, as large as its mismatch, in grey levels, more on clearer windows
    #[arg(long, default_value_t = TrackOptions::default().force, value_parser = gain, value_name = "GAIN")]
    track_force: f64,
    /// Weight of the mismatch of two windows against their gradients, in measured forces; 0 trusts every match alike
    #[arg(long, default_value_t = TrackOptions::default().mismatch, value_parser = not_negative, value_name = "WEIGHT")]
    mismatch: f64,
    /// Gain of the alignment with the neutral frame; 0 leaves it out [default: 150]
    #[arg(long, value_parser = gain_or_none, value_name = "GAIN")]
    align_gain: Option<f64>,
    /// Stiffness of the springs that hold the inner corners of the mouth to the outer ones; 0 leaves them free [default: 25]
    #[arg(long, value_parser = not_negative, value_name = "STIFFNESS")]
    corner_stiffness: Option<f64>,
    /// Search for nodes of the inner lip within their own lip [default: on]
    #[arg(long, value_parser = switch, value_name = "on|off")]
    lip_probes: Option<bool>,
    /// Move the corners of each iris box as one [default: on]
    #[arg(long, value_parser = switch, value_name = "on|off")]
    rigid_eyes: Option<bool>,
    /// Give every frame the light of the neutral one: exposure that adapts, a lamp that is dimmed [default: on]
    #[arg(long, value_parser = switch, value_name = "on|off")]
    even_light: Option<bool>,
    /// Put upper lids that shut where their eyes look as if they were [default: on]
    #[arg(long, value_parser = switch, value_name = "on|off")]
    read_lids: Option<bool>,
    /// Re-deform the wireframe after every step; off leaves lost nodes where they were
    #[arg(long, default_value = "on", value_parser = switch, action = clap::ArgAction::Set, value_name = "on|off")]
    deform: bool,
    /// Which pyramidal KLT finds points again: `grimace`'s own, or `opencv`'s, the reference, which takes longer; whole tracks
    /// differ by some ten-thousandths of a pixel
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

    /// The options, those that are not given as the method has them.
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
    /// How the five frames are taken from a sequence: the nearest frame, or linear interpolation
    #[arg(long, default_value = "nearest", value_parser = words::<Resample>(&["nearest", "linear"]))]
    pub resample: Resample,
}

/// Options of normalization and of the generalized median.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Normalization and statistics")]
pub struct ModelArgs {
    #[command(flatten)]
    frames: ResampleArgs,
    /// Sizes made equal by the FAPUs of each facial region, or by the eye separation alone
    #[arg(long, default_value = "fapu", value_parser = words::<SizeMode>(&["fapu", "uniform"]))]
    size: SizeMode,
    /// Motion of the head that is taken out: yaw, pitch and roll by a three-dimensional head, or roll alone (Krinidis and Pitas)
    /// [default: full, with --method kp roll]
    #[arg(long, value_parser = words::<PoseMode>(&["full", "roll"]))]
    pose: Option<PoseMode>,
    /// The unit of the eyes' motion, IRISD0: the opening of the neutral face's lids (MPEG-4), or the height of its iris boxes (Candide-3's
    /// report) [default: lids, with --method kp boxes]
    #[arg(long, value_parser = words::<IrisdMode>(&["lids", "boxes"]), value_name = "WHAT")]
    irisd: Option<IrisdMode>,
    /// Share of models trimmed per displacement field
    #[arg(long, default_value_t = StatisticsOptions::default().alpha, value_parser = alpha)]
    alpha: f64,
    /// What is trimmed: displacement fields, each in its own order (frame), or whole models
    #[arg(long, default_value = "frame", value_parser = words::<TrimLevel>(&["frame", "model"]))]
    trim: TrimLevel,
    /// What has the same weight: every person, however many sequences they have, or every sequence [default: person]
    #[arg(long, value_parser = words::<Weighting>(&["person", "sequence"]), value_name = "WHAT")]
    weight: Option<Weighting>,
    /// Which generalized median becomes the representative; the gap between the two is always reported
    #[arg(long, default_value = "greedy", value_parser = words::<MedianKind>(&["greedy", "exact"]))]
    median: MedianKind,
}

impl ModelArgs {
    /// The options of normalization, those that are not given as the method has them.
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

    /// The options of the statistics, those that are not given as the method has them.
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
    /// Columns of the manifest to group by, besides the emotion
    #[arg(long, value_delimiter = ',', value_name = "COLUMN")]
    by: Vec<String>,
    /// Columns of the manifest, such as age or site: people exchange their labels in tests with people of the same value only
    #[arg(long, value_delimiter = ',', value_name = "COLUMN", requires = "tested")]
    strata: Vec<String>,
    /// Columns of numbers in the manifest, such as age: whether the expressions change with them is tested, and what they are like at low and at
    /// high numbers is written
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
    /// Amplitudes that differ by less than this count as equivalent, in times the median motion
    #[arg(long, default_value_t = AmplitudeOptions::default().equivalence, value_parser = positive, value_name = "AMPLITUDE")]
    equivalence: f64,
    /// Power, 0.5 to 0.99, for which the number of people that a study would take is given
    #[arg(long, default_value_t = AmplitudeOptions::default().power, value_parser = power, value_name = "SHARE")]
    power: f64,
    /// Permutations of a test between groups, or by a number
    #[arg(long, default_value_t = CompareOptions::default().permutations, value_parser = count(99, 10_000_000), value_name = "COUNT")]
    permutations: usize,
    /// Most people of a group, or with a number, that a test uses; of more as many are drawn by the seed
    #[arg(long, default_value_t = CompareOptions::default().people, value_parser = count(5, 2000), value_name = "COUNT")]
    test_people: usize,
    /// Draws of people for the 95 % interval of every dispersion, where there are groups; 0 for none
    #[arg(long, default_value_t = GroupOptions::default().bootstrap, value_parser = count(0, 1_000_000), value_name = "COUNT")]
    bootstrap: usize,
    /// Seed of permutations and draws
    #[arg(long, default_value_t = CompareOptions::default().seed)]
    seed: u64,
    /// Write all normalized models into one Parquet file, models.parquet, too
    #[arg(long)]
    columnar: bool,
    /// Interpolated frames between two of the five key frames of a FAP file
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u16).range(0..=10_000), value_name = "FRAMES")]
    between: u16,
    /// Neutral photograph, frontal, that the report shows the representatives on, instead of a composite portrait
    #[arg(long, alias = "report-face", value_name = "PORTRAIT")]
    portrait: Option<PathBuf>,
    /// Marked points on the portrait: node,x,y, or 68 landmarks as point,x,y; found in it if none are given
    #[arg(short, long, alias = "report-marks", requires = "portrait", value_name = "C.csv")]
    correspondences: Option<PathBuf>,
    /// Wireframes only: no picture of a person in the report or beside it
    #[arg(long, conflicts_with = "portrait")]
    no_faces: bool,
    /// Frame rate of the FAP files; 25 unless given, and always for Greta
    #[arg(long, value_parser = whole::<u32>(1, 1000))]
    fps: Option<u32>,
    #[command(flatten)]
    profile: ProfileArgs,
}

/// Whom FAP files are written for.
#[derive(Debug, clap::Args)]
pub struct ProfileArgs {
    /// Reader that FAP files are written for; `strict` is the subset that all of them read, `xface` sets lip values that are 0 to 1 where
    /// Xface would show the other contour's, `greta` is at 25 frames per second and has a blank behind each mask
    #[arg(long, default_value_t, value_name = "strict|xface|greta|visage")]
    pub profile: Profile,
}

impl AnalysisArgs {
    pub fn fill(&self, options: &mut PipelineOptions, method: Method) -> anyhow::Result<()> {
        let profile = self.profile.profile;
        if let (Some(given), Some(only)) = (self.fps, profile.fixed_fps()) {
            anyhow::ensure!(
                given == only,
                "--fps {given}: the {profile} profile takes {only} frames per second; leave --fps out"
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
    /// Marks of a sequence or picture that has no correspondences: `auto` takes all its landmarks, each by its expected error, or
    /// finds marks in the neutral frame where there are none; `default` (corners of eyes and mouth, chin, ends of the brows),
    /// `high`, `all`, or a list of nodes such as 20,23,53,56,31,64,10 take such landmarks and find nothing
    #[arg(long, default_value = "auto", value_parser = landmark_marks, value_name = "WHICH")]
    pub marks: LandmarkSelection,
    /// Least confidence, 0 to 1, at which a frame of a landmark file that tells one counts; frames under it are lost
    #[arg(long, default_value_t = LandmarkOptions::default().least_confidence, value_parser = share, value_name = "SHARE")]
    landmark_confidence: f64,
    /// Drive sequences by their landmarks even where they have images
    #[arg(long)]
    prefer_landmarks: bool,
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
    /// Hold marks that are given against the face that is read in the neutral frame, and say so where they lie beside it
    #[arg(long, default_value = "on", value_parser = switch, action = clap::ArgAction::Set, value_name = "on|off")]
    check_marks: bool,
}

impl CheckArgs {
    pub fn unchecked(&self) -> bool {
        !self.check_marks
    }
}
