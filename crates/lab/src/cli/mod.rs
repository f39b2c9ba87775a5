//! The command line of `grimace simulate` and `grimace evaluate`: parse, call the libraries, print.

/// Prints a line like the macro of `std`, which panics when nobody reads the output.
macro_rules! println {
    ($($arg:tt)*) => { ::grimace::internal::cli::print::line(format_args!($($arg)*)) };
}

/// Prints a line to standard error, without a panic if this fails.
macro_rules! eprintln {
    ($($arg:tt)*) => { ::grimace::internal::cli::print::error_line(format_args!($($arg)*)) };
}

mod evaluate;
mod simulate;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Simulated faces with exact ground truth, and experiments against ground truth.
#[derive(Debug, Parser)]
#[command(name = "grimace", bin_name = "grimace", version, about, propagate_version = true, max_term_width = 150, after_help = AFTER_HELP)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    pictures: grimace::internal::cli::shared::PictureArgs,
}

const AFTER_HELP: &str = "\
Example:
  grimace simulate -o faces --subjects 4
  grimace evaluate fit -o fit-error

`grimace` starts the program grimace-lab for these two commands.";

#[derive(Debug, Subcommand)]
enum Command {
    /// Make synthetic sequences with exact ground truth.
    Simulate(simulate::Args),
    /// Measure accuracy against ground truth: fit, tracker, clones, synthesis and more.
    Evaluate(evaluate::Args),
}

/// Parses the arguments, runs the command, prints errors, returns the exit status.
pub fn main() -> ExitCode {
    let cli = match grimace::internal::cli::numbers::parse::<Cli>() {
        Ok(cli) => cli,
        Err(said) => return grimace::internal::cli::print::said_by_clap(&said),
    };
    cli.pictures.apply();
    grimace::internal::cli::exit_code(match cli.command {
        Command::Simulate(args) => simulate::run(args),
        Command::Evaluate(args) => evaluate::run(&args),
    })
}
