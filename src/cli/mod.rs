//! The command line: parse, call the library, print.

/// Prints a line like the macro of `std`, which panics when nobody reads the output (`grimace fap info a.fap | head -1`).
macro_rules! println {
    ($($arg:tt)*) => { $crate::cli::print::line(format_args!($($arg)*)) };
}

/// Prints a line to standard error, without a panic if this fails.
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
mod clone_said;
mod clone_skin;
mod distinct;
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
mod signals;
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

/// Compute representative facial expressions from image sequences and write them as MPEG-4 FAP files.
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

`grimace COMMAND --help` explains a command. `grimace --version --verbose` lists what this build supports: features, OpenCV, codecs.

Exit status: 0 done, 1 failed, 2 wrong usage, 3 done, but some sequences failed.";

#[derive(Debug, Subcommand)]
enum Command {
    /// Run all stages over a dataset: track, normalize, compute representatives, write FAP files and a report.
    Run(run::Args),
    /// Write a manifest for a folder of image sequences and videos.
    Init(init::Args),
    /// Check a dataset for problems before `run` tracks it.
    Check(check::Args),
    /// Mark facial points, or correct tracks, on a local web page.
    Annotate(annotate::Args),
    /// Fit the wireframe to one neutral face from marked points.
    Fit(fit::Args),
    /// Track one sequence from its neutral to its apex frame.
    Track(track::Args),
    /// Compute statistics, FAP files and a report from existing tracks.
    Analyze(analyze::Args),
    /// Recognize the expressions of sequences, after learning from labelled ones.
    Recognize(recognize::Args),
    /// Clone an expression onto a new face: animate one photograph.
    Clone(clone::Args),
    /// Make a web page that plays motions on faces.
    Play(play::Args),
    /// Read, validate and convert .fap files.
    Fap(fap::Args),
    /// Write pose, FAPs and action units for every frame of tracks.
    Features(features::Args),
    /// Draw the figures of a finished run as SVG and PDF, with captions.
    Figures(figures::Args),
    /// Find expressions in recordings and propose sequences from neutral to apex.
    Segment(segment::Args),
    /// Learn a shape prior for the fit from landmarks of neutral faces.
    Prior(prior::Args),
    /// Find faces and their points in pictures.
    Locate(locate::Args),
    /// Train the models that ship with this program on your own data.
    Learn(learn::Args),
    /// Make synthetic sequences with exact ground truth.
    Simulate(lab::Args),
    /// Animate a dense mesh from the motion of feature points, with a bank of expression meshes.
    Synthesize(synthesize::Args),
    /// Build, mix, convert and describe banks of expression meshes for `synthesize`.
    Bank(bank::Args),
    /// Measure accuracy against ground truth: fit, tracker, clones, synthesis and more.
    Evaluate(lab::Args),
    /// Print a completion script for a shell.
    Completions(package::CompletionsArgs),
    /// Print the manual page, or write the pages of all commands.
    Man(package::ManArgs),
}

/// How a command ended that did not fail.
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

/// An error with its causes. Errors of the library contain the text of their cause, which is not repeated.
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

/// Prints an error, if there is one, and returns the exit status: 0 done, 1 failed, 3 done but some sequences failed.
pub fn exit_code(result: anyhow::Result<Outcome>) -> ExitCode {
    // Success is reported only when the output is on the disk.
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
    signals::let_large_writes_fail();
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
