//! `grimace simulate`.

use std::{
    io::IsTerminal,
    path::{Path, PathBuf},
    sync::OnceLock,
    time::{Duration, Instant},
};

use anyhow::Context;
use clap::ValueEnum;
use grimace::internal::{
    fap::read_fap,
    output::{count, listed},
    wireframe::{Tables, Wireframe},
};
use grimace_lab::simulate::{
    CameraOptions, DatasetLayout, Emotion, FrameFormat, Portrait, PortraitMotion, PortraitSource, SimulateOptions, TurnCourse,
    faps_without_unit, portrait_fitter, simulate_dataset, simulate_photographs, simulate_recordings,
};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use rayon::prelude::*;

use grimace::internal::cli::{Outcome, shared::thread_count};

/// Number of rendered subjects by default.
const RENDERED_SUBJECTS: u32 = 4;
/// Duration of the work after which a bar appears.
const QUIET: Duration = Duration::from_secs(1);

const EXAMPLE: &str = "\
Examples:
  grimace simulate -o faces --subjects 6 --emotions happiness,surprise --frames 12 --size 320x240 --seed 7
  grimace simulate -o animated --photo portrait.jpg --landmarks portrait_landmarks68.csv --blink 0.5 --yaw 4
  grimace simulate -o animated --photo portraits --fap happiness.fap --layout cohn-kanade
  grimace simulate -o recordings --recordings --subjects 3 --yaw 12 --pitch 8 --format jpg

Writes faces/manifest.csv (with the columns sex and cohort to group by), frames such as faces/S001/005/S001_005_00000001.png with \
correspondences.csv beside them, faces/truth/S001_005.csv with the exact position of every node in every frame (pixels), and \
faces/simulate.json with all options. The sequence number is the Cohn-Kanade emotion code: 1 anger, 2 contempt, 3 disgust, \
4 fear, 5 happiness, 6 sadness, 7 surprise; numbers from 8 are motions from FAP files. The same options give the same files.";

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLE)]
pub struct Args {
    /// Output folder of the dataset; must be new or empty, unless --force is given
    #[arg(short, long, value_name = "DATASET")]
    output: PathBuf,
    /// Number of subjects; by default 4 rendered ones, or every portrait once
    #[arg(long, value_name = "N")]
    subjects: Option<u32>,
    /// Emotions, separated by commas: anger, contempt, disgust, fear, happiness, sadness, surprise
    #[arg(long, value_delimiter = ',', value_name = "LIST", default_value = "anger,disgust,fear,happiness,sadness,surprise")]
    emotions: Vec<Emotion>,
    /// Make one long recording of every subject instead of sequences
    ///
    /// A recording shows every emotion once, rests, speech, blinks and turns of the head. truth/expressions.csv and truth/rests.csv list the
    /// expressions and rests.
    #[arg(long, conflicts_with_all = ["photo", "layout", "blink", "frames", "turn"])]
    recordings: bool,
    /// Number of frames per sequence, from the neutral to the apex frame
    #[arg(long, default_value_t = 24, value_name = "N")]
    frames: usize,
    /// Size of the frames, in px
    #[arg(long, default_value = "640x480", value_name = "WxH", value_parser = parse_size, conflicts_with = "photo")]
    size: (u32, u32),
    /// Random seed of identities, expressions, motion and noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Standard deviation of the pixel noise, in grey levels of 0 to 255
    #[arg(long, default_value_t = 1.5, value_name = "SIGMA")]
    noise: f64,
    /// Largest roll of the head, in degrees
    #[arg(long, default_value_t = 4.0, value_name = "DEG")]
    roll: f64,
    /// Largest yaw of the head, in degrees
    #[arg(long, default_value_t = 0.0, value_name = "DEG")]
    yaw: f64,
    /// Largest pitch of the head, in degrees
    #[arg(long, default_value_t = 0.0, value_name = "DEG")]
    pitch: f64,
    /// How the head turns within --yaw and --pitch
    ///
    /// `free`: by random angles within these limits. `during`: from a frontal neutral frame to the full angles at the apex. `throughout`: by
    /// the full angles in all frames.
    #[arg(long, value_enum, default_value_t = Turn::Free)]
    turn: Turn,
    /// Largest shift of the head, in px
    #[arg(long, default_value_t = 6.0, value_name = "PX")]
    shift: f64,
    /// Share of the sequences with one blink, 0 to 1
    #[arg(long, default_value_t = 0.0, value_name = "SHARE")]
    blink: f64,
    /// Largest relative change of the head's size
    #[arg(long, default_value_t = 0.02, value_name = "SHARE")]
    scale_change: f64,
    /// Layout of the dataset: with a manifest, or in the folders of Cohn-Kanade with exact landmarks for every frame
    #[arg(long, value_enum, default_value_t = Layout::Manifest)]
    layout: Layout,
    /// File format of the frames
    #[arg(long, value_enum, default_value_t = Format::Png)]
    format: Format,
    /// Quality of JPEG frames, 1 to 100
    #[arg(long, default_value_t = 90, value_name = "Q")]
    quality: u8,
    /// Standard deviation of the error of the marks in correspondences.csv, in px
    #[arg(long, default_value_t = 0.5, value_name = "PX")]
    marks_noise: f64,
    /// Frames per second stated in the manifest
    #[arg(long, default_value_t = 25.0)]
    fps: f64,
    /// Number of threads; 0 uses one per processor
    #[arg(short = 'j', long, value_name = "N", default_value_t = 0, value_parser = thread_count)]
    threads: usize,
    /// Write into a folder that is not empty
    #[arg(long)]
    force: bool,
    /// Print no progress bar and no summary
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    photograph: PhotographArgs,
    #[command(flatten)]
    camera: CameraArgs,
}

#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Photographs instead of rendered faces")]
struct PhotographArgs {
    /// Neutral portrait to animate, a folder of portraits with marks beside each, or a dataset, whose neutral frames are animated
    #[arg(long, value_name = "IMAGE|FOLDER")]
    photo: Option<PathBuf>,
    /// 68 landmarks of the portrait, a CSV file point,x,y, or frame,x0,y0,...; pixels
    #[arg(long, value_name = "L.csv", requires = "photo", conflicts_with = "correspondences")]
    landmarks: Option<PathBuf>,
    /// Marks of the portrait, a CSV file node,x,y; pixels
    #[arg(long, value_name = "C.csv", requires = "photo")]
    correspondences: Option<PathBuf>,
    /// FAP file to perform instead of the emotions; its name becomes the label; can be given up to 8 times
    #[arg(long, value_name = "FILE.fap", requires = "photo", conflicts_with = "emotions")]
    fap: Vec<PathBuf>,
}

/// Number of portraits that a note lists.
const NAMED: usize = 10;

impl PhotographArgs {
    /// The portraits, fitted.
    fn portraits(&self, path: &Path) -> anyhow::Result<Vec<Portrait>> {
        let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
        let marks = self.landmarks.as_deref().or(self.correspondences.as_deref());
        let nodes = wireframe.node_count();
        let sources = if path.is_dir() {
            anyhow::ensure!(
                marks.is_none(),
                "--landmarks and --correspondences belong to one picture; {} is a folder",
                path.display()
            );
            PortraitSource::folder(path, &tables, nodes)?
        } else {
            vec![PortraitSource::photograph(path, marks, &tables, nodes)?]
        };
        let unmarked = sources.iter().filter(|source| source.marks.is_none());
        let unmarked: Vec<String> = unmarked.map(|source| source.id.clone()).collect();
        if !unmarked.is_empty() {
            eprintln!("note: marks that nobody set are found: {}", listed(&unmarked, NAMED));
        }
        let fitter = portrait_fitter(&wireframe);
        sources.par_iter().map(|source| Ok(source.open(&fitter, &wireframe, &tables)?)).collect()
    }

    /// The motions: those of the FAP files, or the emotions.
    fn motions(&self, emotions: &[Emotion]) -> anyhow::Result<Vec<PortraitMotion>> {
        if self.fap.is_empty() {
            return Ok(emotions.iter().map(|&emotion| PortraitMotion::Emotion(emotion)).collect());
        }
        let wireframe = Wireframe::candide3();
        let motion = |path: &PathBuf| {
            let mut faps = read_fap(path)?.sequence;
            faps.fill_gaps();
            anyhow::ensure!(!faps.frames.is_empty(), "{}: it has no frames", path.display());
            let unknown = faps_without_unit(&wireframe, &faps);
            if !unknown.is_empty() {
                let list = unknown.iter().map(|fap| fap.get().to_string()).collect::<Vec<_>>().join(", ");
                eprintln!("note: {}: Candide-3 has no unit for FAP {list}; they move nothing", path.display());
            }
            let label = path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
            Ok(PortraitMotion::Faps { label, faps })
        };
        self.fap.iter().map(motion).collect()
    }
}

#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Faults of camera and light, none by default")]
struct CameraArgs {
    /// Motion blur: share of the frame time during which the shutter is open, 0 to 1
    #[arg(long, default_value_t = 0.0, value_name = "SHARE")]
    shutter: f64,
    /// Standard deviation of the Gaussian blur of the lens, in px
    #[arg(long, default_value_t = 0.0, value_name = "PX")]
    defocus: f64,
    /// Largest relative change of the brightness over a sequence
    #[arg(long, default_value_t = 0.0, value_name = "SHARE")]
    gain_change: f64,
    /// Largest change of the black level over a sequence, in grey levels of 0 to 255
    #[arg(long, default_value_t = 0.0, value_name = "LEVELS")]
    bias_change: f64,
    /// Strength of a smooth light gradient that moves over the picture: brightness times 1 ± this value
    #[arg(long, default_value_t = 0.0, value_name = "SHARE")]
    light_gradient: f64,
    /// Quality of a JPEG compression applied to every picture, in any file format, 1 to 100
    #[arg(long, value_name = "Q")]
    compression: Option<u8>,
}

impl CameraArgs {
    fn options(&self) -> CameraOptions {
        CameraOptions {
            shutter: self.shutter,
            defocus_px: self.defocus,
            gain_change: self.gain_change,
            bias_change: self.bias_change,
            light_gradient: self.light_gradient,
            compression: self.compression,
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Layout {
    Manifest,
    CohnKanade,
}

impl From<Layout> for DatasetLayout {
    fn from(layout: Layout) -> Self {
        match layout {
            Layout::Manifest => Self::Manifest,
            Layout::CohnKanade => Self::CohnKanade,
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Format {
    Png,
    Jpg,
}

fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let error = || format!("`{text}` is not a size such as 640x480");
    let (width, height) = text.split_once(['x', 'X']).ok_or_else(error)?;
    Ok((width.trim().parse().map_err(|_| error())?, height.trim().parse().map_err(|_| error())?))
}

/// When the head has its yaw and pitch.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Turn {
    Free,
    During,
    Throughout,
}

impl From<Turn> for TurnCourse {
    fn from(turn: Turn) -> Self {
        match turn {
            Turn::Free => Self::Free,
            Turn::During => Self::During,
            Turn::Throughout => Self::Throughout,
        }
    }
}

/// Runs the command.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    let options = SimulateOptions {
        subjects: args.subjects.unwrap_or(RENDERED_SUBJECTS),
        emotions: args.emotions,
        frames: args.frames,
        width: args.size.0,
        height: args.size.1,
        seed: args.seed,
        noise_sigma: args.noise,
        roll_degrees: args.roll,
        yaw_degrees: args.yaw,
        pitch_degrees: args.pitch,
        turn: args.turn.into(),
        shift_px: args.shift,
        scale_change: args.scale_change,
        blink: args.blink,
        format: match args.format {
            Format::Png => FrameFormat::Png,
            Format::Jpg => FrameFormat::Jpg { quality: args.quality },
        },
        layout: args.layout.into(),
        marks_noise_px: args.marks_noise,
        fps: args.fps,
        camera: args.camera.options(),
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.threads).build().context("cannot start the threads")?;
    let progress = Progress::new(args.quiet);
    let show = |done, total| progress.show(done, total);
    let (summary, subjects) = match &args.photograph.photo {
        None if args.recordings => {
            (pool.install(|| simulate_recordings(&options, &args.output, args.force, show))?, options.subjects)
        }
        None => (pool.install(|| simulate_dataset(&options, &args.output, args.force, show))?, options.subjects),
        Some(path) => {
            let motions = args.photograph.motions(&options.emotions)?;
            let portraits = pool.install(|| args.photograph.portraits(path))?;
            let options = SimulateOptions { subjects: args.subjects.unwrap_or(portraits.len() as u32), ..options };
            let write = || simulate_photographs(&portraits, &motions, &options, &args.output, args.force, show);
            (pool.install(write)?, options.subjects)
        }
    };
    progress.finish();
    if !args.quiet {
        println!(
            "{} of {}, {}, written to {}",
            if args.recordings {
                count(summary.sequences, "recording", "recordings")
            } else {
                count(summary.sequences, "sequence", "sequences")
            },
            count(subjects as usize, "subject", "subjects"),
            count(summary.frames, "frame", "frames"),
            args.output.display()
        );
    }
    Ok(Outcome::Done)
}

/// A progress bar on standard error, shown after the work has taken a while.
struct Progress {
    start: Instant,
    terminal: bool,
    bar: OnceLock<ProgressBar>,
}

impl Progress {
    fn new(quiet: bool) -> Self {
        Self { start: Instant::now(), terminal: !quiet && std::io::stderr().is_terminal(), bar: OnceLock::new() }
    }

    fn show(&self, done: usize, total: usize) {
        if !self.terminal || self.start.elapsed() < QUIET {
            return;
        }
        let bar = self.bar.get_or_init(|| {
            let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr());
            if let Ok(style) = ProgressStyle::with_template("simulating {bar:40} {pos}/{len} frames, {eta} left") {
                bar.set_style(style);
            }
            bar
        });
        bar.set_position(done as u64);
    }

    fn finish(&self) {
        if let Some(bar) = self.bar.get() {
            bar.finish_and_clear();
        }
    }
}
