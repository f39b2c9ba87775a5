//! `grimace-opencv`: the part of `grimace` that uses OpenCV, as a separate program. `grimace` starts it to read or write a video, to track
//! with OpenCV's KLT, and to propose marks by Haar cascades on the page of `annotate`.
//!
//! Its arguments select the task. It uses the protocol of [`grimace::internal::companion::wire`] on its standard input and output, and ends
//! when its input ends.
#![allow(missing_docs, clippy::pedantic)]

mod about;
mod back;
mod decode;
mod encode;
mod faces;
mod film;
mod klt;
mod talk;

use std::{ffi::OsString, process::ExitCode};

use grimace::internal::companion::wire::{Reply, VERSION};

use self::talk::Talk;

/// Why the program stops.
pub enum Trouble {
    /// A reason that is sent to the other program.
    Failed(String),
    /// The other program has closed the connection.
    Gone,
}

impl From<opencv::Error> for Trouble {
    fn from(error: opencv::Error) -> Self {
        Self::Failed(format!("OpenCV: {error}"))
    }
}

impl From<std::io::Error> for Trouble {
    fn from(_: std::io::Error) -> Self {
        Self::Gone
    }
}

const USAGE: &str = "\
grimace-opencv does what grimace needs OpenCV for, and is started by it. It has no commands of its own; see grimace --help.";

/// Makes OpenCV quiet and single-threaded: `grimace` runs sequences in parallel, and results must not depend on threads.
fn configure() {
    // Failures are ignored: more output or less speed does not change the results.
    let _ = opencv::core::set_log_level(opencv::core::LogLevel::LOG_LEVEL_SILENT);
    let _ = opencv::core::set_use_opencl(false);
    let _ = opencv::core::set_num_threads(1);
}

fn main() -> ExitCode {
    let arguments: Vec<OsString> = std::env::args_os().skip(1).collect();
    match arguments.first().and_then(|word| word.to_str()) {
        Some("--version" | "-V") => println!("grimace-opencv {}", env!("CARGO_PKG_VERSION")),
        Some("--about") => {
            configure();
            about::lines().iter().for_each(|line| println!("{line}"));
        }
        Some("--help" | "-h") => println!("{USAGE}"),
        Some(work @ ("back" | "decode" | "encode" | "faces" | "klt")) => return run(work, &arguments[1..]),
        _ => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
    }
    ExitCode::SUCCESS
}

fn run(work: &str, arguments: &[OsString]) -> ExitCode {
    let Ok(mut talk) = Talk::begin() else { return ExitCode::FAILURE };
    configure();
    let done = talk.say(&Reply::Hello { version: VERSION }).map_err(Trouble::from).and_then(|()| match work {
        "back" => back::run(arguments, &mut talk),
        "decode" => decode::run(arguments, &mut talk),
        "encode" => encode::run(arguments, &mut talk),
        "faces" => faces::run(arguments, &mut talk),
        _ => klt::run(arguments, &mut talk),
    });
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(Trouble::Failed(reason)) => talk.say(&Reply::Failed { reason }).map_or(ExitCode::FAILURE, |()| ExitCode::SUCCESS),
        Err(Trouble::Gone) => ExitCode::FAILURE,
    }
}

/// Parses an argument as a number.
fn number<T: std::str::FromStr>(arguments: &[OsString], place: usize) -> Result<T, Trouble> {
    let word = arguments.get(place).and_then(|word| word.to_str());
    word.and_then(|word| word.parse().ok()).ok_or_else(|| Trouble::Failed(format!("argument {place} is no number: {word:?}")))
}
