//! `grimace check`.

use std::path::PathBuf;

use grimace::{
    normalize::NormalizeOptions,
    output::{count, listed},
    pipeline::{self, CheckedColumn, CheckedEmotion, DatasetCheck, PipelineOptions},
};

use super::{
    Cli, Outcome,
    apart::{check_apart, check_own_table},
    failures::{LOOK_AGAIN, lines_by_kind},
    numbers::given_options,
    progress::SequenceBar,
    shared::{
        CheckArgs, ColumnArgs, FitArgs, GeneralArgs, MarksArgs, MethodArgs, ResampleArgs, quoted, set_threads, thread_count,
    },
};

/// Check a dataset for problems before `run` tracks it.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace check faces -o check.csv

`check` prepares every sequence as `run` does and reports problems in the same words. It lists the frames, reads the marks or finds them \
in the neutral frame, fits the wireframe, and compares given marks with the face in the picture. It decodes the neutral and the apex \
frame of images, and the neutral frame of a video; only `run` reads the frames between. It reads landmark sequences completely. Of a whole \
recording (a manifest row whose segment is auto) it checks only the row, the first frame and the length; it counts as one sequence.

Columns of the table:
  subject, sequence, emotion
  verdict                        good, look again or fails
  stage                          stage at which the sequence would fail
  reasons, notes                 `run` prints notes, too; a note is no reason to look again
  source                         images, video, landmarks or recording
  frames                         number of frames; for a video the number in its header
  width, height                  px
  marks                          file, landmarks, found or none; empty for a recording without marks
  marked                         number of marks
  eye_distance                   px
  face_error_percent_es          median expected error of found marks, percent of the eye distance
  placement_error_percent_es     median expected error of all nodes, percent of the eye distance
  id

Exit status:
  0 no problems
  1 nothing could be checked: the dataset does not open, a column or the results are missing, or the table exists already
  2 wrong usage
  3 some sequences would fail or need a look; notes do not count")]
pub struct Args {
    /// Dataset folder or manifest file
    dataset: PathBuf,
    /// Table to write, with one row per sequence
    #[arg(short, long, value_name = "TABLE.csv")]
    output: Option<PathBuf>,
    /// Output folder of an earlier run over this dataset; its hand corrections are checked, too
    #[arg(long, value_name = "OUT")]
    results: Option<PathBuf>,
    /// Number of threads; 0 uses one per processor
    #[arg(short = 'j', long, default_value_t = 0, value_parser = thread_count)]
    threads: usize,
    #[command(flatten)]
    columns: ColumnArgs,
    #[command(flatten)]
    frames: ResampleArgs,
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
        check_own_table(output, "subject,sequence,emotion,verdict,stage,")?;
        args.general.check_free(output)?;
    }
    if let Some(results) = &args.results {
        anyhow::ensure!(
            results.is_dir(),
            "--results {}: there is no such folder; give the output folder of a run, or leave --results out",
            results.display()
        );
    }
    let mut options = PipelineOptions {
        fit: args.fit.options_of(args.method.method),
        normalize: NormalizeOptions { resample: args.frames.resample, ..args.method.method.normalize() },
        marks: args.marks.which.marks.clone(),
        landmarks: args.marks.landmarks(),
        unchecked_marks: args.check.unchecked(),
        ..PipelineOptions::default()
    };
    args.columns.fill(&mut options);
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
    let DatasetCheck { sequences, people, emotions, columns, skipped, notes, .. } = checked;
    let failing = sequences.iter().filter(|s| s.failure.is_some()).count();
    let look = sequences.iter().filter(|s| s.failure.is_none() && !s.reasons.is_empty()).count();
    println!(
        "{} of {}: {} good, {look} need a look, {failing} would fail",
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
    let (measures, groups): (Vec<_>, Vec<_>) = columns.iter().partition(|column| column.is_measure);
    for (what, columns) in [("columns to group by (--by):", groups), ("columns of numbers (--covariate):", measures)] {
        if !columns.is_empty() {
            println!("{what}");
            columns.iter().for_each(|column| println!("  {}: {}", column.name, groups_said(column)));
        }
    }
    if !skipped.is_empty() {
        println!("{} left out: {}", count(skipped.len(), "sequence", "sequences"), skipped[0].1);
    }
    let table = args.output.as_deref();
    let failing_ones = sequences.iter().filter_map(|s| {
        let (stage, reason) = s.failure.as_ref()?;
        let what = if s.ends_run { "`run` would stop at" } else { "would fail at" };
        Some((&s.id, format!("{what} {stage}"), reason.clone()))
    });
    lines_by_kind(failing_ones, "would fail", table).iter().for_each(|line| println!("{line}"));
    let to_look_at = sequences.iter().filter(|s| s.failure.is_none() && !s.reasons.is_empty());
    let to_look_at = to_look_at.map(|s| (&s.id, LOOK_AGAIN.to_owned(), s.reasons.join("; ")));
    lines_by_kind(to_look_at, "need a look", table).iter().for_each(|line| println!("{line}"));
    let noted = sequences.iter().filter(|s| s.failure.is_none() && !s.notes.is_empty());
    let noted = noted.map(|s| (&s.id, "note".to_owned(), s.notes.join("; ")));
    lines_by_kind(noted, "have a note", table).iter().for_each(|line| println!("{line}"));
    notes.iter().for_each(|note| println!("note: {note}"));
    if let Some(output) = &args.output {
        println!("table: {}", output.display());
    }
    // A run that would stop has no results.
    if failing < sequences.len() && !sequences.iter().any(|s| s.ends_run) {
        let dataset = quoted(&args.dataset.display().to_string());
        // Corrections that were checked belong to the results in which they are.
        let results = args.results.as_ref().map_or_else(|| "results".to_owned(), |out| quoted(&out.display().to_string()));
        let mut command = vec![format!("grimace run {dataset} -o {results}")];
        command.extend(given_options::<Cli>(&NOT_OF_RUN));
        if checked.recommends_linear && !command.iter().any(|option| option.starts_with("--resample")) {
            command.push("--resample linear".to_owned());
        }
        println!("next: {}", command.join(" "));
    }
}

/// Options of this command that `run` does not have, or that concern only this check.
const NOT_OF_RUN: [&str; 5] = ["output", "results", "threads", "force", "quiet"];

/// The groups of a column in words.
fn groups_said(column: &CheckedColumn) -> String {
    /// Number of groups that are listed with their people.
    const NAMED: usize = 8;
    let groups = match &column.groups {
        Ok(groups) => groups,
        Err(why) => return why.to_string(),
    };
    let people = |n: usize| count(n, "person", "people");
    if column.is_measure {
        return format!("{} of {}", count(groups.len(), "number", "numbers"), people(column.people));
    }
    let of = if groups.len() <= NAMED {
        let named: Vec<String> = groups.iter().map(|(group, n)| format!("{group} ({})", people(*n))).collect();
        listed(&named, NAMED)
    } else {
        let sizes = || groups.iter().map(|(_, n)| *n);
        let (least, most) = (sizes().min().unwrap_or(0), sizes().max().unwrap_or(0));
        let range = if least == most { people(most) } else { format!("{least} to {}", people(most)) };
        format!("{range} each")
    };
    let untested =
        if column.is_testable { "" } else { "; not tested: a test needs two groups of two people with the same emotion" };
    format!("{}, {of}{untested}", count(groups.len(), "group", "groups"))
}
