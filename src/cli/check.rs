//! `grimace check`.

use std::path::PathBuf;

use grimace::{
    output::{count, listed},
    pipeline::{self, CheckedColumn, CheckedEmotion, DatasetCheck, PipelineOptions},
};

use super::{
    Outcome,
    apart::{check_apart, check_not_over},
    failures::{LOOK_AGAIN, lines_by_kind},
    progress::SequenceBar,
    shared::{CheckArgs, FitArgs, GeneralArgs, MarksArgs, MethodArgs, quoted, set_threads, thread_count},
};

/// What `run` would meet in a dataset, before anything is tracked.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace check faces -o check.csv

Every sequence is prepared as `run` prepares it: its frames are listed, its marks are read, or found in its neutral frame, the wireframe is fitted, and marks \
that are given are held against the face of the picture; what is wrong is said in the words of `run`. Of pictures the neutral frame and the apex are decoded, of a \
video its neutral frame: whatever lies between shows in `run`. Sequences that landmarks drive are gone through whole.

Columns of the table: subject, sequence, emotion, verdict (good, look again, fails), stage at which it fails, reasons, source (images, video, landmarks, \
recording), frames (of a video as its header states them), width, height (px), marks (file, landmarks, found, none), marked (how many), eye_distance (px), \
face_error_percent_es (of marks that were found: half of them are expected to be nearer), placement_error_percent_es (the same of all nodes), id.

Exit status: 0 nothing wrong, 1 the dataset cannot be read, 2 bad usage, 3 some sequences would fail or deserve a look. Notes of the dataset as a whole do not change it.")]
pub struct Args {
    /// Dataset folder, or its manifest file
    dataset: PathBuf,
    /// Table to write, a row for every sequence
    #[arg(short, long, value_name = "TABLE.csv")]
    output: Option<PathBuf>,
    /// Columns of the manifest that `run` is to group by, besides the emotion
    #[arg(long, value_delimiter = ',', value_name = "COLUMN")]
    by: Vec<String>,
    /// Results of an earlier run over the dataset, whose corrections by hand are checked, too
    #[arg(long, value_name = "OUT")]
    results: Option<PathBuf>,
    /// Threads; 0 for one per processor
    #[arg(short = 'j', long, default_value_t = 0, value_parser = thread_count)]
    threads: usize,
    #[command(flatten)]
    marks: MarksArgs,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    fit: FitArgs,
    #[command(flatten)]
    check: CheckArgs,
    #[command(flatten)]
    general: GeneralArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    set_threads(args.threads)?;
    if let Some(output) = &args.output {
        check_apart(&[("--output", output)], &[("the dataset", &args.dataset)])?;
        check_not_over(output, &args.dataset)?;
        args.general.check_free(output)?;
    }
    if let Some(results) = &args.results {
        anyhow::ensure!(results.is_dir(), "--results {}: there is no such folder", results.display());
    }
    let options = PipelineOptions {
        fit: args.fit.options_of(args.method.method),
        normalize: args.method.method.normalize(),
        marks: args.marks.marks.clone(),
        landmarks: args.marks.landmarks(),
        unchecked_marks: args.check.unchecked(),
        by: args.by.clone(),
        ..PipelineOptions::default()
    };
    let bench = args.general.workbench(options)?;
    let bar = SequenceBar::new(args.general.quiet);
    let checked = pipeline::check_dataset(&args.dataset, &bench, args.results.as_deref(), |event| bar.show(&event));
    bar.finish();
    let checked = checked?;
    if let Some(output) = &args.output {
        pipeline::write_check(output, &checked)?;
    }
    if !args.general.quiet {
        print_summary(&checked, args);
    }
    let is_wrong = checked.sequences.iter().any(|s| s.failure.is_some() || !s.reasons.is_empty());
    Ok(if is_wrong { Outcome::SomeFailed } else { Outcome::Done })
}

fn print_summary(checked: &DatasetCheck, args: &Args) {
    let DatasetCheck { sequences, people, emotions, columns, skipped, notes } = checked;
    let failing = sequences.iter().filter(|s| s.failure.is_some()).count();
    let look = sequences.iter().filter(|s| s.failure.is_none() && !s.reasons.is_empty()).count();
    println!(
        "{} of {}: {} good, {look} to look at again, {failing} would fail",
        count(sequences.len(), "sequence", "sequences"),
        count(*people, "person", "people"),
        sequences.len() - look - failing
    );
    let width = emotions.iter().map(|e| e.emotion.chars().count()).max().unwrap_or(0);
    for CheckedEmotion { emotion, sequences, people, failing } in emotions {
        let fail = if *failing > 0 { format!(", {failing} would fail") } else { String::new() };
        let (sequences, people) = (count(*sequences, "sequence", "sequences"), count(*people, "person", "people"));
        println!("  {emotion:<width$}  {sequences:>15} of {people}{fail}");
    }
    if !columns.is_empty() {
        println!("columns to group by (--by):");
        columns.iter().for_each(|column| println!("  {}: {}", column.name, groups_said(column)));
    }
    if !skipped.is_empty() {
        println!("{} left out: {}", count(skipped.len(), "sequence", "sequences"), skipped[0].1);
    }
    let table = args.output.as_deref();
    let failing_ones = sequences.iter().filter_map(|s| {
        let (stage, reason) = s.failure.as_ref()?;
        Some((&s.id, format!("would fail at {stage}"), reason.clone()))
    });
    lines_by_kind(failing_ones, "would fail", table).iter().for_each(|line| println!("{line}"));
    let to_look_at = sequences.iter().filter(|s| s.failure.is_none() && !s.reasons.is_empty());
    let to_look_at = to_look_at.map(|s| (&s.id, LOOK_AGAIN.to_owned(), s.reasons.join("; ")));
    lines_by_kind(to_look_at, "deserve a look", table).iter().for_each(|line| println!("{line}"));
    notes.iter().for_each(|note| println!("note: {note}"));
    if let Some(output) = &args.output {
        println!("table: {}", output.display());
    }
    if failing < sequences.len() {
        let by = if args.by.is_empty() { String::new() } else { format!(" --by {}", quoted(&args.by.join(","))) };
        println!("next: grimace run {} -o results{by}", quoted(&args.dataset.display().to_string()));
    }
}

/// The groups of a column in words.
fn groups_said(column: &CheckedColumn) -> String {
    /// Groups that are named with their people.
    const NAMED: usize = 8;
    let groups = match &column.groups {
        Ok(groups) => groups,
        Err(why) => return why.to_string(),
    };
    let people = |n: usize| count(n, "person", "people");
    let of = if groups.len() <= NAMED {
        let named: Vec<String> = groups.iter().map(|(group, n)| format!("{group} ({})", people(*n))).collect();
        listed(&named, NAMED)
    } else {
        let sizes = || groups.iter().map(|(_, n)| *n);
        let (least, most) = (sizes().min().unwrap_or(0), sizes().max().unwrap_or(0));
        let range = if least == most { people(most) } else { format!("{least} to {}", people(most)) };
        format!("{range} each")
    };
    let untested = if column.is_testable() { "" } else { "; nothing to test: that takes two groups of two people" };
    format!("{}, {of}{untested}", count(groups.len(), "group", "groups"))
}
