//! `grimace run`.

use std::path::{Path, PathBuf};

use grimace::{
    dataset::unlisted_said,
    output::count,
    pipeline::{self, PipelineOptions, RunSummary, Workbench},
};

use super::{
    Outcome,
    failures::say_failures,
    progress::SequenceBar,
    shared::{
        AnalysisArgs, CheckArgs, FitArgs, GeneralArgs, MarksArgs, MethodArgs, TrackArgs, quoted, set_threads, stop_flag,
        thread_count,
    },
};

/// Run all stages over a dataset: track, normalize, compute representatives, write FAP files and a report.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace run faces -o results --by cohort --overlay results/overlays

DATASET is a folder with manifest.csv (subject,sequence,emotion and more) or in the layout of Cohn-Kanade. After an interruption, run the \
command again: it keeps all sequences whose files have the same content. A sequence that fails does not stop the others: `run` lists it in \
failures.csv, and the exit status is 3.")]
pub struct Args {
    /// Dataset folder or manifest file
    dataset: PathBuf,
    /// Output folder for tracks, models, representatives, FAP files, tables and the report
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Output folder for pictures of the wireframe on the neutral and apex frame of every sequence
    #[arg(long, value_name = "DIR", conflicts_with_all = ["no_faces", "plan", "part", "emotion"])]
    overlay: Option<PathBuf>,
    /// Number of threads; 0 uses one per processor
    #[arg(short = 'j', long, default_value_t = 0, value_parser = thread_count)]
    threads: usize,
    #[command(flatten)]
    division: DivisionArgs,
    #[command(flatten)]
    marks: MarksArgs,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    fit: FitArgs,
    #[command(flatten)]
    track: TrackArgs,
    #[command(flatten)]
    analysis: AnalysisArgs,
    #[command(flatten)]
    check: CheckArgs,
    #[command(flatten)]
    general: GeneralArgs,
}

/// One step of a run that is divided among processes or machines; the last step is the same command without any of these.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Division of a run (see docs/scale.md)")]
#[group(multiple = false)]
struct DivisionArgs {
    /// Only start a run in OUT and print its steps as JSON
    #[arg(long)]
    plan: bool,
    /// Only track and normalize part K of N of the sequences, such as 3/24
    #[arg(long, value_parser = part, value_name = "K/N")]
    part: Option<(usize, usize)>,
    /// Only compute the statistics of one emotion
    #[arg(long, value_name = "EMOTION")]
    emotion: Option<String>,
}

fn part(text: &str) -> Result<(usize, usize), String> {
    let numbers = text.split_once('/').and_then(|(k, n)| Some((k.trim().parse().ok()?, n.trim().parse().ok()?)));
    numbers.filter(|&(k, n)| k >= 1 && k <= n).ok_or_else(|| "expected K/N such as 3/24, K from 1 to N".to_owned())
}

/// Runs one step of a divided run; `None` when the run is not divided.
fn run_division(args: &Args, bench: &Workbench) -> anyhow::Result<Option<Outcome>> {
    let DivisionArgs { plan, part, emotion } = &args.division;
    if *plan {
        let plan = pipeline::run_plan(&args.dataset, &args.output, bench, args.general.force)?;
        println!("{}", serde_json::to_string(&plan)?);
        // The plan itself is printed to standard output; a workflow does not need these notes.
        plan.failures.iter().for_each(|failure| eprintln!("skipped: {failure}"));
        return Ok(Some(Outcome::Done));
    }
    let stop = || stop_flag();
    let bar = SequenceBar::new(args.general.quiet);
    let failures = match (part, emotion) {
        (Some(part), _) => pipeline::run_part(&args.dataset, &args.output, bench, *part, &*stop()?, |event| bar.show(&event)),
        (_, Some(emotion)) => {
            pipeline::run_emotion(&args.dataset, &args.output, bench, emotion, &*stop()?, |event| bar.show(&event))
        }
        _ => return Ok(None),
    };
    bar.finish();
    Ok(Some(if failures?.is_empty() { Outcome::Done } else { Outcome::SomeFailed }))
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    set_threads(args.threads)?;
    let mut options = PipelineOptions {
        fit: args.fit.options_of(args.method.method),
        track: args.track.options_of(args.method.method),
        marks: args.marks.which.marks.clone(),
        landmarks: args.marks.landmarks(),
        unchecked_marks: args.check.unchecked(),
        ..PipelineOptions::default()
    };
    args.analysis.fill(&mut options, args.method.method)?;
    let bench = args.general.workbench(options)?;
    if let Some(outcome) = run_division(args, &bench)? {
        return Ok(outcome);
    }
    let stop = stop_flag()?;
    let bar = SequenceBar::new(args.general.quiet);
    let result =
        pipeline::run(&args.dataset, &args.output, &bench, args.overlay.as_deref(), args.general.force, &stop, |event| {
            bar.show(&event)
        });
    bar.finish();
    let summary = result?;
    if !args.general.quiet {
        print_summary(&summary, args);
    }
    Ok(if summary.failures.is_empty() { Outcome::Done } else { Outcome::SomeFailed })
}

fn print_summary(summary: &RunSummary, args: &Args) {
    let RunSummary { sequences, tracked, reused, failures, skipped, .. } = summary;
    let out = args.output.as_path();
    let all = count(*sequences, "sequence", "sequences");
    if summary.unchanged {
        say_failures(failures, Some(&out.join("failures.csv")));
        println!("nothing changed since the last run: {all}; nothing written");
        if let Some(said) = unlisted_said(&args.dataset) {
            println!("note: {said}");
        }
    } else {
        println!("{all}: {tracked} tracked, {reused} unchanged, {} failed", failures.len());
    }
    if let Some((_, reason)) = skipped.first() {
        println!("{} left out: {reason}", count(skipped.len(), "sequence", "sequences"));
    }
    print_results(&summary.representatives, &summary.warnings, out);
    if summary.to_look_at > 0 {
        println!(
            "next: look at them with grimace annotate {} --tracks {}: Y where one looks right, X to leave one out (or write id,look into \
             {}); then run again",
            quoted(&args.dataset.display().to_string()),
            quoted(&out.display().to_string()),
            quoted(&out.join("looked_at.csv").display().to_string())
        );
    }
}

/// Prints the results: representatives with their numbers of sequences, notes, and the path of the report.
pub fn print_results(representatives: &[(String, usize)], warnings: &[String], out: &Path) {
    let width = representatives.iter().map(|(stem, _)| stem.len()).max().unwrap_or(0);
    for (stem, members) in representatives {
        let file = out.join("fap").join(format!("{stem}.fap"));
        println!("  {stem:<width$}  {:>15}  {}", count(*members, "sequence", "sequences"), file.display());
    }
    for warning in warnings {
        println!("note: {warning}");
    }
    println!("report: {}", out.join("report.html").display());
}
