//! `grimace evaluate`: the experiments.

mod action_units;
mod beside;
mod clone;
mod clone_sheets;
mod confidence;
mod figures;
mod fit;
mod groups;
mod locate;
mod placement;
mod pose;
mod recognition;
mod scale;
mod segment;
mod synthesis;
mod tracking;

use std::{
    borrow::Cow,
    collections::BTreeSet,
    io::IsTerminal,
    path::{Path, PathBuf},
};

use anyhow::Context;
use grimace::internal::{
    locate::{
        Locator, Model,
        learn::{TrainingFace, read_faces},
    },
    output::{write_bytes, write_json},
    units::NodeId,
    wireframe::{Tables, Wireframe, parse_node_or_feature_point},
};
use grimace_lab::{
    evaluate::{LineChart, Table},
    simulate::{Emotion, SimulateOptions},
};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::{Value, json};

use grimace::internal::cli::{
    Outcome,
    shared::{set_threads, thread_count},
};

/// Version of the layout of `evaluation.json`.
const SCHEMA_VERSION: u32 = 1;

/// Measure accuracy against ground truth: fit, tracker, clones, synthesis and more.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    experiment: Experiment,
}

#[derive(Debug, clap::Subcommand)]
enum Experiment {
    /// Accuracy of the intensities of action units.
    ActionUnits(action_units::Args),
    /// Detection of marks that do not fit the face: detection rate and false alarms.
    Beside(beside::Args),
    /// Accuracy of clones: sequences cloned onto their own neutral frame, and simulated people onto each other.
    Clone(clone::Args),
    /// Error of the fit by number and choice of marks, and the best marks.
    Fit(fit::Args),
    /// Reproduce all figures and tables of both papers in one folder.
    Figures(figures::Args),
    /// Error of the tracker per frame, with and without deformation, compared with plain KLT.
    Tracking(tracking::Args),
    /// Expected errors of the tracker against true errors; also trains their model on simulated people.
    Confidence(confidence::Args),
    /// Fitness, surface error and time of the dense synthesis for every solver.
    Synthesis(synthesis::Args),
    /// Accuracy of the head pose, and head motion left in the models.
    Pose(pose::Args),
    /// Accuracy of recognition by the representatives of other people.
    Recognition(recognition::Args),
    /// Error of found points, on photographs with hand-set points.
    Locate(locate::Args),
    /// Expected errors of fitted nodes against true errors.
    Placement(placement::Args),
    /// Size and power of the test between groups, and coverage of intervals, on simulated people.
    Groups(groups::Args),
    /// Detection of expressions and rests in whole recordings.
    Segment(segment::Args),
    /// Time and memory of the statistics by number of models.
    Scale(scale::Args),
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    match &args.experiment {
        Experiment::ActionUnits(args) => action_units::run(args),
        Experiment::Beside(args) => beside::run(args),
        Experiment::Clone(args) => clone::run(args),
        Experiment::Fit(args) => fit::run(args),
        Experiment::Figures(args) => figures::run(args),
        Experiment::Tracking(args) => tracking::run(args),
        Experiment::Confidence(args) => confidence::run(args),
        Experiment::Synthesis(args) => synthesis::run(args),
        Experiment::Pose(args) => pose::run(args),
        Experiment::Recognition(args) => recognition::run(args),
        Experiment::Locate(args) => locate::run(args),
        Experiment::Placement(args) => placement::run(args),
        Experiment::Groups(args) => groups::run(args),
        Experiment::Segment(args) => segment::run(args),
        Experiment::Scale(args) => scale::run(args),
    }
}

/// The people of a folder with hand-set points; `only` names some of them, or none for all.
fn people_named(folder: &Path, only: &[String]) -> anyhow::Result<Vec<TrainingFace>> {
    let mut faces = read_faces(folder, &BTreeSet::new())?.faces;
    check_named(&faces, folder, only)?;
    faces.retain(|f| only.is_empty() || only.contains(&f.person));
    Ok(faces)
}

/// Refuses names that no person in a folder has.
fn check_named(faces: &[TrainingFace], folder: &Path, only: &[String]) -> anyhow::Result<()> {
    match only.iter().find(|name| !faces.iter().any(|f| &f.person == *name)) {
        Some(name) => anyhow::bail!("--only: {} has nobody called {name}", folder.display()),
        None => Ok(()),
    }
}

/// The locator from a file, or the built-in one.
fn locator(model: Option<&Path>) -> anyhow::Result<Cow<'static, Locator>> {
    Ok(match model {
        Some(path) => Cow::Owned(Locator::new(Model::read(path)?.0)),
        None => Cow::Borrowed(Locator::shipped()?),
    })
}

/// Flags of every experiment.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "General")]
struct CommonArgs {
    /// Output folder for tables, figures and evaluation.json
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Random seed of people, marks and pictures
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of threads; 0 uses one per processor
    #[arg(short = 'j', long, default_value_t = 0, value_parser = thread_count)]
    threads: usize,
    /// Write into a folder that is not empty
    #[arg(long)]
    force: bool,
    /// Print no progress bar and no tables
    #[arg(short, long)]
    quiet: bool,
}

impl CommonArgs {
    /// Starts the threads, and refuses a folder that is not empty.
    fn start(&self) -> anyhow::Result<Folder> {
        set_threads(self.threads)?;
        let path = &self.output;
        let occupied = path.is_file() || std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_some());
        anyhow::ensure!(
            self.force || !occupied,
            "{} is not empty; choose a new folder, or --force to write into it",
            path.display()
        );
        Ok(Folder { path: path.clone(), quiet: self.quiet, files: Vec::new() })
    }
}

/// The folder for the results.
struct Folder {
    path: PathBuf,
    quiet: bool,
    files: Vec<String>,
}

impl Folder {
    fn table(&mut self, name: &str, table: &Table) -> anyhow::Result<()> {
        table.write_csv(&self.path.join(name))?;
        self.files.push(name.to_owned());
        Ok(())
    }

    fn figure(&mut self, name: &str, chart: &LineChart) -> anyhow::Result<()> {
        write_bytes(&self.path.join(name), chart.svg()?.as_bytes())?;
        self.files.push(name.to_owned());
        Ok(())
    }

    /// Prints a titled Markdown table.
    fn print(&self, title: &str, table: &Table) {
        if !self.quiet {
            println!("{title}\n\n{}", table.markdown());
        }
    }

    /// Writes `evaluation.json`, the last file.
    fn finish(
        mut self,
        experiment: &str,
        dataset: Option<&Path>,
        seed: u64,
        options: Value,
        results: Value,
    ) -> anyhow::Result<()> {
        self.files.sort();
        let document = json!({
            "schema_version": SCHEMA_VERSION,
            "program": "grimace",
            "version": env!("CARGO_PKG_VERSION"),
            "experiment": experiment,
            "dataset": dataset.map(|path| path.display().to_string()),
            "seed": seed,
            "units": {
                "px": "pixels of the frame",
                "percent_es": "percent of the eye distance ES0, the distance of the pupils in the neutral frame",
                "frame": "frame of the sequence, 1 is the neutral frame",
            },
            "options": options,
            "results": results,
            "files": self.files,
        });
        write_json(&self.path.join("evaluation.json"), &document)?;
        if !self.quiet {
            println!("written to {}", self.path.display());
        }
        Ok(())
    }
}

/// A progress bar on standard error, if this is a terminal.
fn bar(quiet: bool, what: &str, total: usize) -> ProgressBar {
    let shown = !quiet && std::io::stderr().is_terminal();
    let target = if shown { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let bar = ProgressBar::with_draw_target(Some(total as u64), target);
    if let Ok(style) = ProgressStyle::with_template("{msg} {bar:32.cyan/blue} {pos}/{len}  {elapsed} elapsed, {eta} left") {
        bar.set_style(style);
    }
    bar.set_message(what.to_owned());
    bar
}

/// Heading of the options that make simulated sequences.
const SIMULATION: &str = "Simulation, without a DATASET";

/// Simulated sequences, if no dataset is given.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = SIMULATION)]
struct SimulationArgs {
    /// Emotions, separated by commas
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "LIST",
        conflicts_with = "dataset",
        default_value = "anger,disgust,fear,happiness,sadness,surprise"
    )]
    emotions: Vec<Emotion>,
    /// Frames per sequence
    #[arg(long, default_value_t = 24, value_name = "N", conflicts_with = "dataset")]
    frames: usize,
    /// Size of the frames, in px
    #[arg(long, default_value = "640x480", value_name = "WxH", value_parser = size, conflicts_with = "dataset")]
    size: (u32, u32),
    /// Standard deviation of the error of the marks, in px, for sequences that start from marks
    #[arg(long, default_value_t = 0.7, value_name = "PX", value_parser = grimace::internal::cli::shared::not_negative, conflicts_with = "dataset")]
    marks_noise: f64,
}

impl SimulationArgs {
    /// The clean simulation.
    fn options(&self, subjects: u32, seed: u64) -> SimulateOptions {
        SimulateOptions {
            subjects,
            emotions: self.emotions.clone(),
            frames: self.frames,
            width: self.size.0,
            height: self.size.1,
            seed,
            ..SimulateOptions::default()
        }
    }
}

/// A list of nodes or feature points from the command line.
fn nodes(list: &[String], tables: &Tables, wireframe: &Wireframe) -> anyhow::Result<Vec<NodeId>> {
    let mut nodes = Vec::new();
    for text in list {
        let node =
            parse_node_or_feature_point(text, tables, wireframe.node_count()).map_err(anyhow::Error::msg).context("--marks")?;
        anyhow::ensure!(wireframe.live_nodes().contains(&node), "--marks: node {node} is in no triangle and cannot be marked");
        anyhow::ensure!(!nodes.contains(&node), "--marks: node {node} is listed twice");
        nodes.push(node);
    }
    Ok(nodes)
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some((w.trim().parse().ok()?, h.trim().parse().ok()?)));
    sides.ok_or_else(|| format!("`{text}` is not a size such as 640x480"))
}

/// Name of a group as part of a file name.
fn file_word(group: &str) -> String {
    group.chars().map(|c| if c.is_alphanumeric() || matches!(c, '-' | '_') { c } else { '_' }).collect()
}
