//! The command line: parse, call the library, print.

/// Prints a line like `std`'s macro of this name, which panics when nobody reads on (`grimace fap info a.fap | head -1`).
macro_rules! println {
    ($($arg:tt)*) => { $crate::cli::print::line(format_args!($($arg)*)) };
}

/// Prints a line to standard error without a panic when that is not possible.
macro_rules! eprintln {
    ($($arg:tt)*) => { $crate::cli::print::error_line(format_args!($($arg)*)) };
}

mod analyze;
mod annotate;
pub mod apart;
pub mod bank;
mod check;
mod clone;
mod clone_again;
mod clone_skin;
pub mod failures;
mod fap;
mod features;
mod figures;
mod fit;
mod init;
mod lab;
mod learn;
mod learn_head;
mod learn_head_mesh;
mod locate;
pub mod numbers;
mod options;
mod own_folder;
mod package;
mod play;
pub mod portrait;
pub mod print;
mod prior;
pub mod progress;
mod recognize;
mod run;
mod segment;
pub mod shared;
mod source_frames;
mod synthesize;
mod synthesize_options;
mod synthesize_report;
mod synthesize_warnings;
mod track;
mod unfinished;
mod version;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use grimace::text::message;

/// Representative facial expressions from image sequences, as MPEG-4 FAP files.
#[derive(Debug, Parser)]
#[command(name = "grimace", version, about, propagate_version = true, max_term_width = 150, after_help = AFTER_HELP)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    pictures: shared::PictureArgs,
}

const AFTER_HELP: &str = "\
Example, from nothing to a report:
  grimace simulate -o faces --subjects 4
  grimace run faces -o results
  then open results/report.html

grimace --version --verbose says what this build can do: features, OpenCV, codecs.

Exit status: 0 done, 1 failed, 2 bad usage, 3 done but some sequences failed.";

#[derive(Debug, Subcommand)]
enum Command {
    /// The main job: every stage over a dataset, to representatives, FAP files and a report.
    Run(run::Args),
    /// Write a manifest for folders of images and videos.
    Init(init::Args),
    /// What `run` would meet in a dataset, before anything is tracked.
    Check(check::Args),
    /// Mark points on a local web page, or correct tracks.
    Annotate(annotate::Args),
    /// Fit the wireframe to one neutral face from marked points.
    Fit(fit::Args),
    /// Track one sequence from its neutral to its apex frame.
    Track(track::Args),
    /// Statistics, FAP files and report from tracks already there.
    Analyze(analyze::Args),
    /// Label sequences by the expressions of people seen before.
    Recognize(recognize::Args),
    /// Put an expression on a new face: a textured animation from one photograph.
    Clone(clone::Args),
    /// A page that plays motions on faces: scrub, compare, exaggerate, single FAPs.
    Play(play::Args),
    /// Read, validate and convert .fap files.
    Fap(fap::Args),
    /// A row for every frame of tracks: pose, FAPs, action units.
    Features(features::Args),
    /// The figures of a finished run as SVG and PDF, with captions.
    Figures(figures::Args),
    /// Find expressions in whole recordings, and propose sequences from neutral to apex.
    Segment(segment::Args),
    /// Learn a shape prior for the fit from landmarks of neutral faces.
    Prior(prior::Args),
    /// Find faces and their points.
    Locate(locate::Args),
    /// Learn what this program ships with, from your own data.
    Learn(learn::Args),
    /// Make synthetic sequences with exact ground truth.
    Simulate(lab::Args),
    /// Dense animation from the motion of feature points, by a bank of expression meshes.
    Synthesize(synthesize::Args),
    /// Banks of expression meshes for `synthesize`.
    Bank(bank::Args),
    /// Experiments against ground truth: the accuracy of fit, tracker, clones and synthesis.
    Evaluate(lab::Args),
    /// Print what completes commands and options in a shell.
    Completions(package::CompletionsArgs),
    /// Print the manual page, or write those of all commands.
    Man(package::ManArgs),
}

/// How a command that did not fail ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Exit status 0.
    Done,
    /// Exit status 1, everything worth saying having been said.
    Failed,
    /// Exit status 3: done, but some sequences failed.
    SomeFailed,
    /// The exit status of another program.
    #[cfg(not(unix))]
    Other(u8),
}

/// An error with its causes. Errors of the library hold their cause in their own text; it is not said twice.
pub fn chain(error: &anyhow::Error) -> String {
    error.chain().map(|cause| message(&cause.to_string()).into_owned()).fold(String::new(), |text, cause| {
        if text.contains(&cause) {
            text
        } else if text.is_empty() {
            cause
        } else {
            format!("{text}: {cause}")
        }
    })
}

/// Prints an error, if there is one, and gives the exit status: 0 done, 1 failed, 3 done but some sequences failed.
pub fn exit_code(result: anyhow::Result<Outcome>) -> ExitCode {
    // Done is said when it is on the disk.
    let result = result.and_then(|outcome| crate::output::sync_written().map(|()| outcome).map_err(Into::into));
    match result.and_then(|outcome| print::check().map(|()| outcome)) {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Failed) => ExitCode::FAILURE,
        Ok(Outcome::SomeFailed) => ExitCode::from(3),
        #[cfg(not(unix))]
        Ok(Outcome::Other(status)) => ExitCode::from(status),
        Err(error) => {
            eprintln!("error: {}", chain(&error));
            ExitCode::FAILURE
        }
    }
}

/// Parses the arguments, runs the command, prints errors, returns the exit status: 0 done, 1 failed, 2 bad usage, 3 done but
/// some sequences failed.
pub fn main() -> ExitCode {
    if let Some((command, arguments)) = lab::asked(std::env::args_os().skip(1)) {
        return exit_code(lab::run(command, &arguments));
    }
    if version::asked(std::env::args_os().skip(1)) {
        return exit_code(version::run());
    }
    let cli = match numbers::parse::<Cli>() {
        Ok(cli) => cli,
        Err(said) => return print::said_by_clap(&said),
    };
    cli.pictures.apply();
    exit_code(match cli.command {
        Command::Run(args) => run::run(&args),
        Command::Init(args) => init::run(&args),
        Command::Check(args) => check::run(&args),
        Command::Annotate(args) => annotate::run(&args),
        Command::Features(args) => features::run(&args),
        Command::Figures(args) => figures::run(&args),
        Command::Segment(args) => segment::run(&args),
        Command::Fit(args) => fit::run(&args),
        Command::Track(args) => track::run(&args),
        Command::Analyze(args) => analyze::run(&args),
        Command::Recognize(args) => recognize::run(&args),
        Command::Clone(args) => clone::run(&args),
        Command::Play(args) => play::run(&args),
        Command::Fap(args) => fap::run(args),
        Command::Prior(args) => prior::run(&args),
        Command::Locate(args) => locate::run(&args),
        Command::Learn(args) => learn::run(&args),
        Command::Simulate(args) => lab::run("simulate", &args.arguments),
        Command::Synthesize(args) => synthesize::run(&args),
        Command::Bank(args) => bank::run(&args),
        Command::Evaluate(args) => lab::run("evaluate", &args.arguments),
        Command::Completions(args) => package::completions(&args),
        Command::Man(args) => package::man(&args),
    })
}
