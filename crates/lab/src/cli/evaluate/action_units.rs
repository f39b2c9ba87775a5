//! `grimace evaluate action-units`.

use std::{path::PathBuf, sync::atomic::Ordering};

use grimace::internal::{
    dataset::LandmarkSelection,
    pipeline::{PipelineOptions, Workbench},
};
use grimace_lab::evaluate::{
    ActionUnitOptions, action_unit_table, evaluate_action_units, evaluate_action_units_in_images, judged_mean,
};
use serde_json::json;

use super::{CommonArgs, bar};
use grimace::internal::cli::{Outcome, shared::stop_flag};

/// Accuracy of the intensities of action units.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace evaluate action-units ict -o action-units
  grimace evaluate action-units --images -o action-units-images
  grimace evaluate action-units --images --marks auto -o action-units-found

Heads of a dense face model (a folder of NumPy arrays as for `grimace learn head`) turn and show bursts of several action units at once. A \
perspective camera sees 68 landmarks of each head, with 110 px between the pupils. The table has the correlation over time of measured and \
true intensity, the mean error on the scale of 0 to 5, the share of frames within the expected error (ideally one half), and the \
shares of frames with a true intensity of 1.5 and more, and below 0.5, in which the unit counts as present.")]
pub struct Args {
    /// Folder of the dense face model
    #[arg(value_name = "MODEL", required_unless_present = "images")]
    folder: Option<PathBuf>,
    /// Use images instead of landmarks: render, mark and track simulated people who show Candide's action units
    #[arg(long, conflicts_with_all = ["folder", "camera", "noise", "first_mode"])]
    images: bool,
    /// Number of heads
    #[arg(long, default_value_t = 5, value_name = "N", value_parser = grimace::internal::cli::shared::count(1, 10_000))]
    heads: usize,
    /// First identity mode of the heads; 15 excludes the modes that the head model was learned from
    #[arg(long, default_value_t = 15, value_name = "MODE")]
    first_mode: usize,
    /// Number of frames per head
    #[arg(long, default_value_t = 120, value_name = "N", value_parser = grimace::internal::cli::shared::count(10, 100_000))]
    frames: usize,
    /// Standard deviation of the error of the landmarks, in px
    #[arg(long, default_value_t = 0.4, value_name = "PX", value_parser = grimace::internal::cli::shared::not_negative)]
    noise: f64,
    /// Largest yaw and pitch, in degrees
    #[arg(long, default_value_t = 10.0, value_name = "DEGREES", value_parser = grimace::internal::cli::shared::not_negative)]
    turn: f64,
    /// Distance of the camera at 110 px between the pupils, in px
    #[arg(long, default_value_t = 1200.0, value_name = "PX", value_parser = grimace::internal::cli::shared::positive)]
    camera: f64,
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
    let bench = Workbench::new(None, PipelineOptions::default())?;
    let options = ActionUnitOptions {
        heads: args.heads,
        first_mode: args.first_mode,
        frames: args.frames,
        noise_px: args.noise,
        turn: args.turn,
        camera: args.camera,
        marks: args.marks.clone(),
        seed: args.common.seed,
    };
    let stop = stop_flag()?;
    let bar = bar(args.common.quiet, "measuring heads", args.heads);
    let tick = || {
        bar.inc(1);
        !stop.load(Ordering::SeqCst)
    };
    let trials = match &args.folder {
        Some(folder) => evaluate_action_units(folder, &bench, &options, tick)?,
        None => evaluate_action_units_in_images(&bench, &options, tick)?,
    };
    bar.finish_and_clear();
    let table = action_unit_table(&trials);
    folder.table("action_units.csv", &table)?;
    let mean = judged_mean(&trials);
    folder
        .print(&format!("Action units against the strengths that made the faces; {mean:.3} on the mean of those judged"), &table);
    let written = json!({
        "images": args.images, "heads": args.heads, "first_mode": args.first_mode, "frames": args.frames, "noise_px": args.noise, "turn_degrees": args.turn,
        "camera_px": args.camera, "marks": args.marks,
    });
    folder.finish("action-units", args.folder.as_deref(), options.seed, written, json!({ "mean_correlation": mean }))?;
    Ok(Outcome::Done)
}
