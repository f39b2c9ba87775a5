//! `grimace analyze`.

use std::path::PathBuf;

use anyhow::Context;
use grimace::{
    dataset::Dataset,
    pipeline::{PipelineOptions, analyze, load_tracks, track_files, write_analysis, write_model},
};

use super::{
    Outcome,
    shared::{AnalysisArgs, GeneralArgs, set_threads},
};

/// Statistics from tracks already there.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace analyze results/tracks -o by-cohort --by cohort

Emotion and further columns come from the .json beside each track, or from the manifest of --dataset, which may have columns that were \
not there when the sequences were tracked.")]
pub struct Args {
    /// Track files, or folders of them
    #[arg(required = true)]
    tracks: Vec<PathBuf>,
    /// Folder for models, representatives, FAP files, tables and the report
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Dataset or manifest that says emotion and further columns of the sequences
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Threads; 0 for one per processor
    #[arg(short = 'j', long, default_value_t = 0)]
    threads: usize,
    #[command(flatten)]
    analysis: AnalysisArgs,
    #[command(flatten)]
    general: GeneralArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    set_threads(args.threads)?;
    let used = args.output.read_dir().is_ok_and(|mut entries| entries.next().is_some());
    anyhow::ensure!(args.general.force || !used, "{} is not empty; --force writes over its results", args.output.display());
    anyhow::ensure!(
        !args.output.join("run.json").exists(),
        "{} holds a run, whose results `analyze` would contradict; choose another folder",
        args.output.display()
    );
    let mut options = PipelineOptions::default();
    args.analysis.fill(&mut options);
    let bench = args.general.workbench(options)?;
    let dataset = args.dataset.as_deref().map(Dataset::open).transpose()?;
    let files = track_files(&args.tracks)?;
    anyhow::ensure!(!files.is_empty(), "no .csv file in {}", args.tracks[0].display());
    let (models, failures) = load_tracks(&files, dataset.as_ref(), &bench);
    let failed = failures.len();
    for failure in &failures {
        eprintln!("failed: {}_{} at {}: {}", failure.subject, failure.sequence, failure.stage, failure.reason);
    }
    anyhow::ensure!(!models.is_empty(), "none of the {} tracks can be used", files.len());
    let normalized: Vec<_> = models.iter().map(|m| m.model.clone()).collect();
    let analysis = analyze(models, failures, &bench)?;
    for model in &normalized {
        write_model(&args.output.join("models").join(format!("{}.csv", model.id)), &model.model)?;
    }
    let title = args.output.file_name().map_or_else(|| "tracks".to_owned(), |n| n.to_string_lossy().into_owned());
    write_analysis(&analysis, &args.output, &title, &bench).context("writing the results")?;
    if !args.general.quiet {
        println!("{} tracks, {failed} failed", files.len());
        for (stem, count) in analysis.counts() {
            println!("  {stem:<12} {count:>4} sequences  {}/fap/{stem}.fap", args.output.display());
        }
        for warning in &analysis.warnings {
            println!("note: {warning}");
        }
        println!("report: {}/report.html", args.output.display());
    }
    Ok(if failed == 0 { Outcome::Done } else { Outcome::SomeFailed })
}
