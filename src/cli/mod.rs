//! The command line: parse, call the library, print.

mod fap;
mod simulate;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Representative facial expressions from image sequences, as MPEG-4 FAP files.
#[derive(Debug, Parser)]
#[command(name = "grimace", version, about, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Read, validate and convert .fap files.
    Fap(fap::Args),
    /// Make synthetic sequences with exact ground truth.
    Simulate(simulate::Args),
}

/// How a command that did not fail ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Exit status 0.
    Done,
    /// Exit status 3: done, but some sequences failed.
    SomeFailed,
}

/// Parses the arguments, runs the command, prints errors, returns the exit status: 0 done, 1 failed, 2 bad usage, 3 done but
/// some sequences failed.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let result = match cli.command {
        Command::Fap(args) => fap::run(args),
        Command::Simulate(args) => simulate::run(args),
    };
    match result {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::SomeFailed) => ExitCode::from(3),
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
