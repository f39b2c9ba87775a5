//! `grimace fap`: read, validate and convert .fap files.

use std::{
    fmt::Write as _,
    io::{self, Write as _},
    path::{Path, PathBuf},
};

use anyhow::{Context as _, bail, ensure};
use grimace::{
    fap::{
        FapFile, FapFrame, FapMask, FapNumber, FapReadError, FapSequence, FapSummary, FapWriteError, Finding, Profile,
        SequenceSummary, Severity, ValueFormat, beyond_range, check_fap, check_lips, fap_text, is_for_greta, read_fap_bytes,
        read_tidy_csv, write_fap_as, write_tidy_csv,
    },
    input::is_stdin,
    interpolation::FPS,
    output::nine_digits,
    text::single_line,
};
use serde::Serialize;

use super::{Outcome, numbers::whole};

/// Version of the JSON that `info` and `check` print.
const SCHEMA_VERSION: u32 = 1;

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  grimace fap info out/fap/happiness.fap")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Describe .fap files: name, frame rate, duration, and the extremes of every FAP.
    Info(InfoArgs),
    /// Check .fap files against the subset that all known readers accept.
    Check(CheckArgs),
    /// Convert a .fap file to another frame rate, mask, number format or reader, or to and from CSV.
    Convert(ConvertArgs),
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  grimace fap info out/fap/*.fap\n\n\
    The apex of a FAP is its value farthest from neutral; the table shows it with the first frame that has it.\n\
    Values are in 1/1024 of the named unit of the neutral face; angles are in 1e-5 rad.")]
struct InfoArgs {
    /// FAP files
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  grimace fap check --strict out/fap/*.fap\n\n\
    Prints FILE:LINE: SEVERITY RULE: FIELD: MESSAGE. If many lines break a rule in the same way, only the first is printed, \
    with the number of lines. An error is something that no known tool writes; a warning is something that some readers refuse.\n\n\
    The exit status is 1 if there is an error.")]
struct CheckArgs {
    /// FAP files
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Treat warnings as errors; also warn about lips at rest that Xface shows differently
    #[arg(long)]
    strict: bool,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  grimace fap convert joy.fap --fps 50 -o joy50.fap\n  \
    grimace fap convert joy.fap --mask 3-13,31-38 --profile greta -o greta/joy.fap\n  \
    grimace fap convert joy.fap -o joy.csv\n\n\
    A CSV table has the columns frame,fap,name,value, with one row for every FAP that a frame sets.\n\n\
    Values outside the range of the standard are written unchanged, with a warning.")]
struct ConvertArgs {
    /// File to convert: a CSV table if its name ends in .csv, else a .fap file
    #[arg(value_name = "FILE")]
    input: PathBuf,
    /// File to write: a CSV table if its name ends in .csv, else a .fap file; `-` prints a .fap file
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Frames per second of the output; the motion keeps its speed
    ///
    /// Frame k (from 0) is interpolated at k/N seconds, and the last frame stays the last. The duration changes by less than a frame.
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1, 32_767))]
    fps: Option<u32>,
    /// Keep the frames when the frame rate changes: the motion becomes faster or slower
    #[arg(long)]
    keep_frames: bool,
    /// Insert N interpolated frames between every two frames; --fps then only sets the frame rate
    #[arg(long, value_name = "N")]
    between: Option<usize>,
    /// FAPs to write: `all`, `set` (those that any frame sets), or a list such as 3-13,31-38
    ///
    /// All frames get the same mask. A FAP that only some frames set is interpolated in the others, as MPEG-4's decoders do; one that no
    /// frame sets becomes 0.
    #[arg(long, value_name = "FAPS", default_value = "set")]
    mask: FapMask,
    /// Number format; by default integers in a .fap file and floats in a CSV table
    ///
    /// Only Xface reads a .fap file with floats.
    #[arg(long, value_enum)]
    values: Option<Values>,
    /// Reader to write a .fap file for; the default, `strict`, suits all readers
    #[arg(long, value_name = "strict|xface|greta|visage")]
    profile: Option<Profile>,
    /// Name of the motion in a .fap file; by default that of the input, or of its file if it is a CSV table
    #[arg(long, value_name = "NAME", value_parser = clap::builder::NonEmptyStringValueParser::new())]
    name: Option<String>,
    /// Overwrite OUT
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Values {
    /// Round to integers
    Integer,
    /// Keep decimals
    Float,
}

/// Runs the command.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    match args.command {
        Command::Info(args) => info(&args),
        Command::Check(args) => check(&args),
        Command::Convert(args) => convert(&args),
    }
}

fn info(args: &InfoArgs) -> anyhow::Result<Outcome> {
    #[derive(Serialize)]
    struct FileInfo<'a> {
        file: String,
        #[serde(flatten)]
        summary: &'a SequenceSummary,
        findings: &'a [Finding],
    }
    #[derive(Serialize)]
    struct Output<'a> {
        schema_version: u32,
        units: &'a str,
        files: Vec<FileInfo<'a>>,
    }
    let mut read = Vec::new();
    for path in &args.files {
        match read_counted(path) {
            Ok(FapFile { sequence, findings }) => read.push((path, sequence.summary(), findings)),
            Err(error) => eprintln!("error: {error}"),
        }
    }
    let text = if args.json {
        let units = "values of a FAP: its `unit`; fps: 1/s; seconds: s; frames and lines: numbers, frames from 0, lines from 1";
        let files = read.iter().map(|(path, summary, findings)| FileInfo { file: path.display().to_string(), summary, findings });
        json(&Output { schema_version: SCHEMA_VERSION, units, files: files.collect() })?
    } else {
        let blocks = read.iter().map(|(path, summary, findings)| summary_text(path, summary, findings));
        blocks.collect::<Vec<_>>().join("\n")
    };
    print(&text)?;
    let failed = args.files.len() - read.len();
    ensure!(failed == 0, "{} could not be read", count(failed, "file"));
    Ok(Outcome::Done)
}

/// Reads a file and counts all findings of `check`.
fn read_counted(path: &Path) -> Result<FapFile, FapReadError> {
    let bytes = bytes_of(path)?;
    Ok(FapFile { findings: check_fap(&bytes), ..read_fap_bytes(path, &bytes)? })
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, FapReadError> {
    grimace::input::read_or_stdin(path).map_err(|source| FapReadError::Io { path: path.to_owned(), source })
}

/// The summary of one file as text: two lines and a table.
fn summary_text(path: &Path, summary: &SequenceSummary, findings: &[Finding]) -> String {
    let SequenceSummary { name, version, fps, frames, seconds, faps } = summary;
    let set = FapMask::List(faps.iter().filter_map(|f| f.fap.try_into().ok()).collect());
    let mut text = format!("{}: `{name}`, version {version}\n", single_line(&path.display().to_string()));
    let _ = writeln!(text, "  {}, {} fps, {seconds:.2} s", count(*frames, "frame"), nine_digits(*fps));
    let _ = writeln!(text, "  {} set: {set}", count(faps.len(), "FAP"));
    if !findings.is_empty() {
        let _ = writeln!(text, "  {} tolerated; `grimace fap check` lists them", count(findings.len(), "deviation"));
    }
    if faps.is_empty() {
        return text;
    }
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), nine_digits);
    let header = ["FAP", "name", "unit", "min", "max", "apex", "frame"].map(str::to_owned);
    let row = |f: &FapSummary| {
        let frame = f.apex_frame.map_or_else(|| "-".to_owned(), |k| k.to_string());
        [f.fap.to_string(), f.name.clone(), f.unit.clone(), number(f.min), number(f.max), number(f.apex), frame]
    };
    let rows: Vec<[String; 7]> = std::iter::once(header).chain(faps.iter().map(row)).collect();
    let widths: [usize; 7] = std::array::from_fn(|k| rows.iter().map(|row| row[k].chars().count()).max().unwrap_or(0));
    for row in &rows {
        text.push_str("  ");
        for (k, (cell, width)) in row.iter().zip(widths).enumerate() {
            let gap = if k == 0 { "" } else { "  " };
            // Name and unit are left-aligned, numbers right-aligned.
            let _ = if k == 1 || k == 2 { write!(text, "{gap}{cell:<width$}") } else { write!(text, "{gap}{cell:>width$}") };
        }
        text.push('\n');
    }
    text
}

fn check(args: &CheckArgs) -> anyhow::Result<Outcome> {
    #[derive(Serialize)]
    struct FileCheck {
        file: String,
        /// Why the file cannot be opened; then there are no findings.
        unreadable: Option<String>,
        errors: usize,
        warnings: usize,
        findings: Vec<Finding>,
    }
    #[derive(Serialize)]
    struct Output<'a> {
        schema_version: u32,
        units: &'static str,
        strict: bool,
        files: &'a [FileCheck],
    }
    let mut files = Vec::new();
    for path in &args.files {
        let (unreadable, mut findings, lips) = match grimace::input::read_or_stdin(path) {
            Ok(bytes) if bytes.starts_with(b"frame,") => (
                Some("this is a CSV table, not a .fap file; convert it with `grimace fap convert`".to_owned()),
                Vec::new(),
                Vec::new(),
            ),
            Ok(bytes) => (None, check_fap(&bytes), if args.strict { check_lips(&bytes) } else { Vec::new() }),
            Err(error) => (Some(error.to_string()), Vec::new(), Vec::new()),
        };
        if args.strict {
            findings.iter_mut().for_each(|finding| finding.severity = Severity::Error);
        }
        findings.extend(lips);
        findings.sort_by_key(|finding| finding.line);
        let broken = findings.iter().filter(|f| f.severity == Severity::Error).count();
        let (errors, warnings) = (broken + usize::from(unreadable.is_some()), findings.len() - broken);
        files.push(FileCheck { file: path.display().to_string(), unreadable, errors, warnings, findings });
    }
    let errors: usize = files.iter().map(|file| file.errors).sum();
    let warnings: usize = files.iter().map(|file| file.warnings).sum();
    let text = if args.json {
        let units = "line: number, from 1; times: count";
        json(&Output { schema_version: SCHEMA_VERSION, units, strict: args.strict, files: &files })?
    } else {
        let mut text = String::new();
        for FileCheck { file, unreadable, findings, .. } in &files {
            let file = single_line(file);
            if let Some(reason) = unreadable {
                let _ = writeln!(text, "{file}: error: cannot be read: {reason}");
            }
            for finding in findings {
                let _ = writeln!(text, "{file}:{}: {finding}", finding.line);
            }
        }
        let [files, errors, warnings] =
            [(files.len(), "file"), (errors, "error"), (warnings, "warning")].map(|(n, w)| count(n, w));
        let _ = writeln!(text, "{files} checked: {errors}, {warnings}");
        text
    };
    print(&text)?;
    let failed = files.iter().filter(|file| file.errors > 0).count();
    ensure!(failed == 0, "{} did not pass", count(failed, "file"));
    Ok(Outcome::Done)
}

fn convert(args: &ConvertArgs) -> anyhow::Result<Outcome> {
    let output = &args.output;
    if !args.force && !is_stdin(output) && output.symlink_metadata().is_ok() {
        bail!("{} exists; give --force to overwrite it", output.display());
    }
    let to_csv = is_csv(output);
    if let (true, Some(profile)) = (to_csv, args.profile) {
        bail!("--profile {profile} is for .fap files, but {} is a CSV table", output.display());
    }
    if let (true, Some(name)) = (to_csv, &args.name) {
        bail!("--name {name} is for .fap files, but {} is a CSV table, which holds no name", output.display());
    }
    let (mut sequence, like_input) = read(args)?;
    if let Some(name) = &args.name {
        sequence.name.clone_from(name);
    }
    let profile = args.profile.unwrap_or(like_input);
    // The mask is applied before the timing, because interpolated frames depend on the meaning of an unset FAP.
    let filled = sequence.fill_gaps();
    sequence.apply_mask(&args.mask);
    if filled > 0 {
        note(&format!("interpolated {} in frames that leave a FAP out", count(filled, "value")));
    }
    let mut sequence = set_timing(args, profile, sequence)?;
    if !to_csv {
        let prepared = profile.prepare(&mut sequence);
        if let Some(name) = prepared.renamed {
            note(&format!("the name `{name}` became `{}`: readers take one word", sequence.name));
        }
        if prepared.dropped > 0 {
            let dropped = count(prepared.dropped, "value");
            note(&format!(
                "left out {dropped} of FAPs 1 and 2: the readers of the {profile} profile expect different formats of them"
            ));
        }
        if prepared.lips_copied > 0 {
            note(&format!("copied {} between inner and outer lips, as Xface would", count(prepared.lips_copied, "unset value")));
        }
        if prepared.lips_kept > 0 {
            note(&format!("set {} from 0 to 1, so that Xface keeps them", count(prepared.lips_kept, "lip value")));
        }
    }
    let values = args.values.unwrap_or(if to_csv { Values::Float } else { Values::Integer });
    if values == Values::Integer {
        let rounded = sequence.round();
        // Interpolated values are never integers: only values of the file itself need a warning.
        if rounded > 0 && args.between.is_none() && args.fps.is_none() {
            note(&format!("rounded {} to integers", count(rounded, "value")));
        }
    }
    for said in beyond_range_said(&sequence) {
        eprintln!("warning: {said}; the value is written unchanged, and readers may limit or refuse it");
    }
    if to_csv {
        write_tidy_csv(output, &sequence)?;
        return Ok(Outcome::Done);
    }
    let format = if values == Values::Integer { ValueFormat::Integer } else { ValueFormat::Float };
    if is_stdin(output) {
        print(&fap_text(&sequence, profile, format).context("standard output")?)?;
    } else {
        write_fap_as(output, &sequence, profile, format).map_err(|error| match error {
            // The message names the file.
            FapWriteError::Output(error) => anyhow::Error::from(error),
            error @ FapWriteError::Content(_) => anyhow::Error::from(error).context(output.display().to_string()),
        })?;
    }
    Ok(Outcome::Done)
}

/// Messages about the FAPs of a sequence that exceed the range of the standard, one for each.
pub fn beyond_range_said(sequence: &FapSequence) -> impl Iterator<Item = String> {
    beyond_range(sequence).into_iter().map(|Finding { line: frame, field, message, times, .. }| {
        let more = if times > 1 { format!("; this occurs in {times} frames") } else { String::new() };
        format!("{field} in frame {frame}: {message}{more}")
    })
}

/// Reads the input, prints what was tolerated, and returns the default profile of the output.
fn read(args: &ConvertArgs) -> anyhow::Result<(FapSequence, Profile)> {
    if is_csv(&args.input) {
        // A table has no frame rate: it gets that of the output, so that nothing is interpolated.
        let sequence = read_tidy_csv(&args.input, f64::from(args.fps.unwrap_or(FPS)))?;
        if args.fps.is_none() {
            note(&format!("a table has no frame rate; using {FPS} frames per second; --fps sets another"));
        }
        let is_empty = |frame: &FapFrame| FapNumber::all().all(|fap| !frame.is_set(fap));
        if let [first, second, ..] = sequence.frames.as_slice()
            && is_empty(first)
            && !is_empty(second)
        {
            note("the table has no row for frame 0, so the first frame is empty; frames count from 0");
        }
        return Ok((sequence, Profile::default()));
    }
    let bytes = bytes_of(&args.input)?;
    let FapFile { sequence, .. } = read_fap_bytes(&args.input, &bytes)?;
    let findings = check_fap(&bytes);
    if !findings.is_empty() {
        let deviations = count(findings.len(), "deviation");
        note(&format!("{}: {deviations} tolerated; `grimace fap check` lists them", args.input.display()));
    }
    // A file written for Greta stays so, unless options are given that Greta cannot play.
    let plays = |profile: Profile| {
        let fps = args.fps.map_or(sequence.fps, f64::from);
        args.values != Some(Values::Float) && profile.fixed_fps().is_some_and(|only| f64::from(only) == fps)
    };
    let stays = args.profile.is_none() && !is_csv(&args.output) && is_for_greta(&bytes) && plays(Profile::Greta);
    if stays {
        note("written for Greta, like the input; `--profile strict` writes for all readers");
    }
    Ok((sequence, if stays { Profile::Greta } else { Profile::default() }))
}

/// Changes frames and frame rate as requested.
fn set_timing(args: &ConvertArgs, profile: Profile, sequence: FapSequence) -> anyhow::Result<FapSequence> {
    let fps = args.fps.or(profile.fixed_fps()).map_or(sequence.fps, f64::from);
    if args.fps.is_none() && fps.total_cmp(&sequence.fps).is_ne() {
        note(&format!(
            "changed the frame rate from {} to {fps} frames per second, the only rate of the {profile} profile",
            sequence.fps
        ));
    }
    if let Some(between) = args.between {
        return Ok(FapSequence { fps, ..sequence.with_frames_between(between)? });
    }
    Ok(if args.keep_frames { FapSequence { fps, ..sequence } } else { sequence.retimed(fps)? })
}

fn is_csv(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv"))
}

/// `1 file`, `2 files`.
fn count(number: usize, noun: &str) -> String {
    if number == 1 { format!("1 {noun}") } else { format!("{number} {noun}s") }
}

fn note(text: &str) {
    eprintln!("note: {text}");
}

fn json<T: Serialize>(value: &T) -> anyhow::Result<String> {
    Ok(serde_json::to_string_pretty(value)? + "\n")
}

/// Writes to standard output. A reader that closes the pipe early (`| head`) is not an error.
fn print(text: &str) -> anyhow::Result<()> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(error).context("cannot write to standard output"),
        _ => Ok(()),
    }
}
