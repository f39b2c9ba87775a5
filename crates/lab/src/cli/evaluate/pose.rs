//! `grimace evaluate pose`.

use std::{path::PathBuf, sync::atomic::Ordering};

use grimace::internal::{
    dataset::LandmarkSelection,
    normalize::NormalizeOptions,
    normalize::PoseMode,
    pipeline::{PipelineOptions, Workbench},
};
use grimace_lab::evaluate::{
    IMAGE_SEQUENCES, LANDMARK_SEQUENCES, PoseStudyOptions, evaluate_pose, evaluate_pose_images, pose_table, pose_trials_table,
};
use serde_json::json;

use super::{CommonArgs, bar};
use grimace::internal::cli::{Outcome, shared::stop_flag};

/// Accuracy of the head pose, and head motion left in the models.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace evaluate pose ict -o pose
  grimace evaluate pose --images -o pose-images
  grimace evaluate pose --images --marks auto -o pose-found

Heads of a dense face model (a folder of NumPy arrays as for `grimace learn head`) show four expressions, still and turning. A perspective \
camera sees 68 landmarks of each head, with 110 px between the pupils.

Motion lost: mean distance between the nodes of the normalized apex models of the turning and the still head, divided by the mean motion of \
the still head. Turn error: error of the angles relative to the neutral frame.")]
pub struct Args {
    /// Folder of the dense face model
    #[arg(value_name = "MODEL", required_unless_present = "images")]
    folder: Option<PathBuf>,
    /// Use images instead of landmarks: render, mark and track simulated people
    #[arg(long, conflicts_with_all = ["folder", "camera", "noise", "first_mode", "spread"])]
    images: bool,
    /// Number of heads
    #[arg(long, default_value_t = 5, value_name = "N", value_parser = grimace::internal::cli::shared::count(1, 10_000))]
    heads: usize,
    /// First identity mode of the heads; 15 excludes the modes that the head model was learned from
    #[arg(long, default_value_t = 0, value_name = "MODE")]
    first_mode: usize,
    /// Standard deviation of the weights of the identity modes
    #[arg(long, default_value_t = 0.6, value_name = "SD", value_parser = grimace::internal::cli::shared::not_negative)]
    spread: f64,
    /// Number of frames per sequence
    #[arg(long, default_value_t = 9, value_name = "N", value_parser = grimace::internal::cli::shared::count(2, 10_000))]
    frames: usize,
    /// Distances of the camera at 110 px between the pupils, in px; separated by commas
    #[arg(long, default_value = "1200", value_name = "PX", value_delimiter = ',', value_parser = grimace::internal::cli::shared::positive)]
    camera: Vec<f64>,
    /// Standard deviation of the error of the landmarks, in px
    #[arg(long, default_value_t = 0.0, value_name = "PX", value_parser = grimace::internal::cli::shared::not_negative)]
    noise: f64,
    /// With --images, the marks of the neutral frame: `auto`, found in the picture, or exact ones: `default`, `high`, `all`, or a list of
    /// nodes
    #[arg(long, default_value = "default", value_name = "WHICH", requires = "images")]
    marks: LandmarkSelection,
    #[command(flatten)]
    common: CommonArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut folder = args.common.start()?;
    let bench = |pose| {
        let options =
            PipelineOptions { normalize: NormalizeOptions { pose, ..NormalizeOptions::default() }, ..PipelineOptions::default() };
        Workbench::new(None, options)
    };
    let (full, roll) = (bench(PoseMode::Full)?, bench(PoseMode::Roll)?);
    let options = PoseStudyOptions {
        heads: args.heads,
        first_mode: args.first_mode,
        spread: args.spread,
        frames: args.frames,
        noise_px: args.noise,
        cameras: args.camera.clone(),
        marks: args.marks.clone(),
        seed: args.common.seed,
    };
    let stop = stop_flag()?;
    let sequences = if args.images { args.heads * IMAGE_SEQUENCES } else { args.camera.len() * args.heads * LANDMARK_SEQUENCES };
    let bar = bar(args.common.quiet, "fitting heads", sequences);
    let tick = || {
        bar.inc(1);
        !stop.load(Ordering::SeqCst)
    };
    let trials = match &args.folder {
        Some(model) => evaluate_pose(model, &full, &roll, &options, tick)?,
        None => evaluate_pose_images(&full, &roll, &options, tick)?,
    };
    bar.finish_and_clear();
    let table = pose_table(&trials);
    folder.table("pose.csv", &table)?;
    folder.table("pose_sequences.csv", &pose_trials_table(&trials))?;
    folder.print(
        "Motion lost to the head, as a share of the motion (still: change against roll only), and error of the pose",
        &table,
    );
    let written = json!({
        "heads": args.heads, "first_mode": args.first_mode, "spread": args.spread, "frames": args.frames, "noise_px": args.noise,
        "camera_px": args.camera, "marks": args.marks,
    });
    folder.finish("pose", args.folder.as_deref(), options.seed, written, json!({ "sequences": trials.len() }))?;
    Ok(Outcome::Done)
}
