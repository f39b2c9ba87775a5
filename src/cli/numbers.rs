//! Numbers on the command line: accepted values, and messages about others.

use std::{
    error::Error as _,
    fmt::Display,
    num::{IntErrorKind, ParseFloatError, ParseIntError},
    ops::RangeInclusive,
    str::FromStr,
};

use clap::{Command, Parser};
use grimace::dataset::FRAME_RATES;

use super::shared::quoted;

/// Parses the arguments of the process. Negative numbers are values of options; each option checks its own.
pub fn parse<C: Parser>() -> Result<C, clap::Error> {
    let mut command = with_negative_numbers(C::command());
    let mut matches = command.try_get_matches_from_mut(std::env::args_os())?;
    C::from_arg_matches_mut(&mut matches).map_err(|error| error.format(&mut command))
}

/// The options of a command as given to the process, in the form for a shell, by their long names, without those of `left_out` and without
/// arguments that have no name. Used to suggest another command with the same options.
pub fn given_options<C: Parser>(left_out: &[&str]) -> Vec<String> {
    let mut command = with_negative_numbers(C::command());
    let Ok(matches) = command.try_get_matches_from_mut(std::env::args_os()) else { return Vec::new() };
    let Some((name, matches)) = matches.subcommand() else { return Vec::new() };
    let Some(command) = command.find_subcommand(name) else { return Vec::new() };
    let is_given = |id: &str| matches.value_source(id) == Some(clap::parser::ValueSource::CommandLine);
    let said = |arg: &clap::Arg| {
        let id = arg.get_id().as_str();
        let long = arg.get_long().filter(|long| !left_out.contains(long) && is_given(id))?;
        if !arg.get_action().takes_values() {
            return Some(format!("--{long}"));
        }
        let values: Vec<_> = matches.get_raw(id)?.map(|value| value.to_string_lossy()).collect();
        Some(format!("--{long} {}", quoted(&values.join(","))))
    };
    command.get_arguments().filter_map(said).collect()
}

fn with_negative_numbers(command: Command) -> Command {
    let takes = |arg: &clap::Arg| !arg.is_positional() && arg.get_action().takes_values();
    command
        .mut_args(|arg| if takes(&arg) { arg.allow_negative_numbers(true) } else { arg })
        .mut_subcommands(with_negative_numbers)
}

/// Translates Rust's message about a text that is not a number.
pub fn expected_number(said: &clap::Error) -> Option<(String, &'static str)> {
    let source = said.source()?;
    let expected = match source.downcast_ref::<ParseIntError>().map(ParseIntError::kind) {
        Some(IntErrorKind::PosOverflow) => "expected a smaller whole number",
        Some(_) => "expected a whole number of at least 0",
        None => source.downcast_ref::<ParseFloatError>().map(|_| "expected a number")?,
    };
    Some((source.to_string(), expected))
}

/// A number for which `fits` holds.
fn number(text: &str, fits: impl Fn(f64) -> bool, expected: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && fits(value) => Ok(value),
        _ => Err(format!("expected {expected}")),
    }
}

/// A number within bounds; `said` describes them.
pub fn within(text: &str, bounds: RangeInclusive<f64>, said: &str) -> Result<f64, String> {
    number(text, |v| bounds.contains(&v), &format!("a number from {said}"))
}

pub fn positive(text: &str) -> Result<f64, String> {
    number(text, |v| v > 0.0, "a number greater than 0")
}

/// The emphasis of `synthesize`, whose letter other commands use for marks.
pub fn emphasis_beside_marks(text: &str) -> Result<f64, String> {
    number(text, |v| v > 0.0, "a number greater than 0; marks of a portrait are given with --correspondences")
}

/// Frames per second of a recording or of an output.
pub fn frame_rate(text: &str) -> Result<f64, String> {
    within(text, FRAME_RATES, "0.1 to 1000 frames per second")
}

/// A factor on a motion; no face moves a hundred times as far.
pub fn emphasis(text: &str) -> Result<f64, String> {
    number(text, |v| v > 0.0 && v <= 100.0, "a number greater than 0, 100 at most")
}

/// Gains for which the equations can be solved in double precision, at a stiffness of 1.
const GAINS: RangeInclusive<f64> = 1e-9..=1e9;

pub fn gain(text: &str) -> Result<f64, String> {
    within(text, GAINS, "1e-9 to 1e9")
}

pub fn gain_or_none(text: &str) -> Result<f64, String> {
    number(text, |v| v == 0.0 || GAINS.contains(&v), "0, or a number from 1e-9 to 1e9")
}

pub fn share_up_to_one(text: &str) -> Result<f64, String> {
    number(text, |v| v > 0.0 && v <= 1.0, "a number greater than 0, 1 at most")
}

pub fn not_negative(text: &str) -> Result<f64, String> {
    number(text, |v| v >= 0.0, "a number of at least 0")
}

pub fn alpha(text: &str) -> Result<f64, String> {
    number(text, |v| (0.0..0.5).contains(&v), "a share of at least 0 and less than 0.5, such as 0.1 to trim a tenth")
}

/// A whole number within bounds.
pub fn count(least: usize, most: usize) -> impl Fn(&str) -> Result<usize, String> + Clone + Send + Sync + 'static {
    whole(least, most)
}

/// A number of bootstrap draws: fewer than 99 give no 95 % interval, except 0 for none.
pub fn draws(text: &str) -> Result<usize, String> {
    const LEAST: usize = 99;
    const MOST: usize = 1_000_000;
    match text.parse() {
        Ok(value) if value == 0 || (LEAST..=MOST).contains(&value) => Ok(value),
        _ => Err(format!("expected a whole number from {LEAST} to {MOST}, or 0 for no intervals")),
    }
}

/// [`count`] of any type.
pub fn whole<T>(least: T, most: T) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: FromStr + PartialOrd + Display + Copy + Send + Sync + 'static,
{
    move |text| match text.parse::<T>() {
        Ok(value) if least <= value && value <= most => Ok(value),
        _ => Err(format!("expected a whole number from {least} to {most}")),
    }
}

/// Largest number of threads: no machine has more processors that one process may use.
const MOST_THREADS: usize = 1024;

/// A number of threads; 0 for one per processor.
pub fn thread_count(text: &str) -> Result<usize, String> {
    count(0, MOST_THREADS)(text)
}

/// Bytes from a text such as `500MB`, `2GB` or `1.5 GiB`.
pub fn memory(text: &str) -> Result<u64, String> {
    const LEAST: f64 = 16e6;
    let text = text.trim();
    let digits = text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len());
    let factor = match text[digits..].to_lowercase().as_str() {
        "" | "b" => 1.0,
        "k" | "kb" => 1e3,
        "m" | "mb" => 1e6,
        "g" | "gb" => 1e9,
        "t" | "tb" => 1e12,
        "kib" => 1024.0,
        "mib" => 1024.0 * 1024.0,
        "gib" => 1024.0 * 1024.0 * 1024.0,
        _ => return Err("expected a size such as 500MB or 2GB".to_owned()),
    };
    number(text[..digits].trim(), |v| v * factor >= LEAST && v * factor < 1e15, "a size of at least 16MB, such as 500MB or 2GB")
        .map(|v| (v * factor) as u64)
}

pub fn share(text: &str) -> Result<f64, String> {
    within(text, 0.0..=1.0, "0 to 1")
}

pub fn power(text: &str) -> Result<f64, String> {
    within(text, 0.5..=0.99, "0.5 to 0.99")
}
