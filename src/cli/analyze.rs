//! `grimace analyze`.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use anyhow::Context;
use grimace::{
    columnar::ColumnarModels,
    dataset::Dataset,
    output::{FolderRecord, count},
    pipeline::{
        Analysis, AnalyzedModel, PipelineOptions, Workbench, analyze, analyze_columnar, load_columnar, load_tracks, track_files,
        write_analysis, write_columnar, write_model,
    },
    report::Failure,
};

use super::{
    Outcome,
    apart::check_outside,
    failures::say_failures,
    own_folder::check_is_folder,
    run::print_results,
    shared::{AnalysisArgs, GeneralArgs, MethodArgs, memory, set_threads, thread_count},
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
    #[arg(required_unless_present = "models")]
    tracks: Vec<PathBuf>,
    /// A Parquet file of normalized models, as --columnar writes it, instead of tracks
    #[arg(long, value_name = "FILE", conflicts_with_all = ["tracks", "dataset"])]
    models: Option<PathBuf>,
    /// Memory for models, such as 500MB or 2GB; a file of --models that needs more is read node by node
    #[arg(long, default_value = "2GB", value_parser = memory, value_name = "SIZE")]
    memory: u64,
    /// Folder for models, representatives, FAP files, tables and the report
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Dataset or manifest that says emotion and further columns of the sequences
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Threads; 0 for one per processor
    #[arg(short = 'j', long, default_value_t = 0, value_parser = thread_count)]
    threads: usize,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    analysis: AnalysisArgs,
    #[command(flatten)]
    general: GeneralArgs,
}

/// Names and hashes of the results in a folder, by which a later analysis knows what it may remove.
const RECORD_NAME: &str = "analyze.b3";

/// Files written, by name relative to the output folder, with their BLAKE3.
type Written = BTreeMap<String, String>;

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    set_threads(args.threads)?;
    check_is_folder(&args.output)?;
    let used = args.output.read_dir().is_ok_and(|mut entries| entries.next().is_some());
    anyhow::ensure!(args.general.force || !used, "{} is not empty; --force writes over its results", args.output.display());
    anyhow::ensure!(
        !args.output.join("run.json").exists(),
        "{} holds a run, whose results `analyze` would contradict; choose another folder",
        args.output.display()
    );
    let mut options = PipelineOptions::default();
    args.analysis.fill(&mut options, args.method.method)?;
    if used && !args.output.join(RECORD_NAME).exists() {
        eprintln!(
            "note: {} has no {RECORD_NAME}, the record of an earlier analysis: whatever is there under a name that this one does not write \
             stays, and `figures` may show it",
            args.output.display()
        );
    }
    let bench = args.general.workbench(options)?;
    if let Some(path) = &args.models {
        if args.output.join(RECORD_NAME).exists() {
            check_outside("--output", &args.output, &[("--models", path)])?;
        }
        return from_models(args, path, &bench);
    }
    let dataset = args.dataset.as_deref().map(Dataset::open).transpose()?;
    let files = track_files(&args.tracks)?;
    anyhow::ensure!(!files.is_empty(), "no .csv file in {}", args.tracks[0].display());
    let (models, failures) = load_tracks(&files, dataset.as_ref(), &bench);
    if models.is_empty() {
        say_failures(&failures, None);
        anyhow::bail!("none of the {} tracks can be used", files.len());
    }
    let results = of_tracks(args, models, failures.clone(), &bench);
    // The table that has them all is one of the results.
    say_failures(&failures, results.is_ok().then(|| args.output.join("failures.csv")).as_deref());
    print(args, &results?, &format!("{}, {} failed", count(files.len(), "track", "tracks"), failures.len()));
    Ok(if failures.is_empty() { Outcome::Done } else { Outcome::SomeFailed })
}

/// Statistics of tracks, with their models beside them.
fn of_tracks(args: &Args, models: Vec<AnalyzedModel>, failures: Vec<Failure>, bench: &Workbench) -> anyhow::Result<Analysis> {
    let record = FolderRecord::open(&args.output, RECORD_NAME, true)?;
    let normalized: Vec<_> = models.iter().map(|m| m.model.clone()).collect();
    let mut written = Written::new();
    let mut wrote = |name: String, hash: blake3::Hash| written.insert(name, hash.to_hex().to_string());
    if bench.options.columnar {
        record.begin()?;
        wrote("models.parquet".to_owned(), write_columnar(&args.output.join("models.parquet"), &models)?);
    }
    let analysis = analyze(models, failures, bench)?;
    // Two at once would mix their results.
    record.begin()?;
    for model in &normalized {
        let name = format!("models/{}.csv", model.id);
        let hash = write_model(&args.output.join(&name), &model.model)?;
        wrote(name, hash);
    }
    write(args, record, &analysis, bench, written)?;
    Ok(analysis)
}

/// Statistics of a columnar file.
fn from_models(args: &Args, path: &Path, bench: &Workbench) -> anyhow::Result<Outcome> {
    let file = ColumnarModels::open(path)?;
    anyhow::ensure!(
        file.node_count() == bench.wireframe.node_count(),
        "{}: its models have {} nodes, the wireframe {}",
        path.display(),
        file.node_count(),
        bench.wireframe.node_count()
    );
    if let Some(column) = bench.options.by.iter().find(|column| file.not_read.contains(column)) {
        anyhow::bail!(
            "{}: column `{column}` holds neither text nor plain numbers (a date, a decimal fraction, a list); save it as text to group by it",
            path.display()
        );
    }
    let analysis = if file.memory() <= args.memory {
        analyze(load_columnar(&file)?, Vec::new(), bench)?
    } else {
        analyze_columnar(&file, bench, args.memory)?
    };
    let record = FolderRecord::open(&args.output, RECORD_NAME, true)?;
    record.begin()?;
    write(args, record, &analysis, bench, Written::new())?;
    print(args, &analysis, &format!("{} models", file.row_count()));
    Ok(Outcome::Done)
}

/// Writes the results, and removes those of an earlier analysis that this one did not make.
fn write(args: &Args, record: FolderRecord, analysis: &Analysis, bench: &Workbench, mut written: Written) -> anyhow::Result<()> {
    let title = args.output.file_name().map_or_else(|| "tracks".to_owned(), |n| n.to_string_lossy().into_owned());
    written.extend(write_analysis(analysis, &args.output, &title, bench).context("writing the results")?);
    for (name, hash) in written {
        record.wrote(&name, hash)?;
    }
    for name in record.remove_stale()? {
        eprintln!("note: {name} is of an earlier analysis and was changed since; it is kept");
    }
    Ok(record.close()?)
}

fn print(args: &Args, analysis: &Analysis, what: &str) {
    if !args.general.quiet {
        println!("{what}");
        print_results(&analysis.counts(), &analysis.warnings, &args.output);
    }
}
