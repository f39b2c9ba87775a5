//! `grimace analyze`.

use std::path::{Path, PathBuf};

use anyhow::Context;
use grimace::{
    columnar::ColumnarModels,
    dataset::Dataset,
    output::count,
    pipeline::{
        ANALYSIS_TABLES, ANALYZE_RECORD, Analysis, AnalyzedModel, PipelineOptions, Workbench, analysis_files, analyze,
        analyze_columnar, load_columnar, load_tracks, write_analysis, write_columnar, write_model,
    },
    report::Failure,
    units::SequenceId,
};

use super::{
    Outcome,
    apart::check_outside,
    failures::{say_failures, say_unlisted},
    own_folder::{OwnFolder, check_is_folder},
    run::print_results,
    shared::{AnalysisArgs, GeneralArgs, MethodArgs, memory, set_threads, some_track_files, thread_count},
};

/// Compute statistics, FAP files and a report from existing tracks.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace analyze results/tracks -o by-cohort --by cohort

The emotion and other columns of a sequence come from the .json beside its track. With --dataset they come from that manifest, which \
may have columns that were added after tracking.")]
pub struct Args {
    /// Track files, or folders of track files
    #[arg(required_unless_present = "models")]
    tracks: Vec<PathBuf>,
    /// Parquet file of normalized models, written with --columnar, to analyze instead of tracks
    #[arg(long, value_name = "FILE", conflicts_with_all = ["tracks", "dataset"])]
    models: Option<PathBuf>,
    /// Memory for models, such as 500MB or 2GB
    ///
    /// A file given with --models that needs more memory is read node by node.
    #[arg(long, default_value = "2GB", value_parser = memory, value_name = "SIZE")]
    memory: u64,
    /// Output folder for models, representatives, FAP files, tables and the report
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Dataset or manifest with the emotion and other columns of the sequences
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Number of threads; 0 uses one per processor
    #[arg(short = 'j', long, default_value_t = 0, value_parser = thread_count)]
    threads: usize,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    analysis: AnalysisArgs,
    #[command(flatten)]
    general: GeneralArgs,
}

/// Name of the command, also in the record in a folder of results. A later analysis uses it to know what it may remove.
const COMMAND: &str = "analyze";
/// Name of the file with all models.
const COLUMNAR: &str = "models.parquet";

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    set_threads(args.threads)?;
    check_is_folder(&args.output)?;
    let used = args.output.read_dir().is_ok_and(|mut entries| entries.next().is_some());
    anyhow::ensure!(
        args.general.force || !used,
        "{} is not empty; choose another folder, or give --force to overwrite its results",
        args.output.display()
    );
    anyhow::ensure!(
        !args.output.join("run.json").exists(),
        "{} holds the results of `run`, which `analyze` would overwrite in part; choose another folder",
        args.output.display()
    );
    let mut options = PipelineOptions::default();
    args.analysis.fill(&mut options, args.method.method)?;
    if used && !args.output.join(ANALYZE_RECORD).exists() {
        eprintln!(
            "note: {} has no {ANALYZE_RECORD}, the record of an earlier analysis: files that this analysis does not overwrite stay, and \
             `figures` may show them",
            args.output.display()
        );
    }
    let bench = args.general.workbench(options)?;
    if let Some(path) = &args.models {
        if args.output.join(ANALYZE_RECORD).exists() {
            check_outside("--output", &args.output, &[("--models", path)])?;
        }
        return from_models(args, path, &bench);
    }
    let dataset = args.dataset.as_deref().map(Dataset::open).transpose()?;
    let files = some_track_files(&args.tracks)?;
    let (models, failures) = load_tracks(&files, dataset.as_ref(), &bench);
    say_unlisted(&models, dataset.as_ref());
    if models.is_empty() {
        say_failures(&failures, None);
        anyhow::bail!("none of the {} tracks is usable", files.len());
    }
    let failed = files.len() - models.len();
    let results = of_tracks(args, models, failures.clone(), &bench);
    // The table with all failures is one of the results.
    say_failures(&failures, results.is_ok().then(|| args.output.join("failures.csv")).as_deref());
    print(args, &results?, &format!("{}, {failed} failed", count(files.len(), "track", "tracks")));
    Ok(if failures.is_empty() { Outcome::Done } else { Outcome::SomeFailed })
}

/// Computes statistics of tracks, with their models beside them.
fn of_tracks(args: &Args, models: Vec<AnalyzedModel>, failures: Vec<Failure>, bench: &Workbench) -> anyhow::Result<Analysis> {
    let folder = OwnFolder::open(&args.output, COMMAND)?;
    let normalized: Vec<_> = models.iter().map(|m| m.model.clone()).collect();
    let name_of = |id: &SequenceId| format!("models/{id}.csv");
    folder.check_own(normalized.iter().map(|m| name_of(&m.id)).chain(ANALYSIS_TABLES.map(str::to_owned)))?;
    if bench.options.columnar {
        folder.check_own([COLUMNAR])?;
        folder.begin()?;
        folder.wrote_as(COLUMNAR, write_columnar(&args.output.join(COLUMNAR), &models)?)?;
    }
    let analysis = analyze(models, failures, bench)?;
    // Two analyses at the same time would mix their results.
    begin(&folder, &analysis, bench)?;
    for model in &normalized {
        let name = name_of(&model.id);
        folder.wrote_as(&name, write_model(&args.output.join(&name), &model.model)?)?;
    }
    write(args, folder, &analysis, bench)?;
    Ok(analysis)
}

/// Computes statistics of a columnar file.
fn from_models(args: &Args, path: &Path, bench: &Workbench) -> anyhow::Result<Outcome> {
    let file = ColumnarModels::open(path)?;
    anyhow::ensure!(
        file.node_count() == bench.wireframe.node_count(),
        "{}: its models have {} nodes, but the wireframe has {}",
        path.display(),
        file.node_count(),
        bench.wireframe.node_count()
    );
    let asked = || [&bench.options.by, &bench.options.strata, &bench.options.covariates].into_iter().flatten();
    if let Some(column) = asked().find(|column| file.not_read.contains(column)) {
        anyhow::bail!(
            "{}: column `{column}` holds neither text nor plain numbers (perhaps a date, a decimal or a list); save it as text",
            path.display()
        );
    }
    let analysis = if file.memory() <= args.memory {
        analyze(load_columnar(&file)?, Vec::new(), bench)?
    } else {
        analyze_columnar(&file, bench, args.memory)?
    };
    let folder = OwnFolder::open(&args.output, COMMAND)?;
    begin(&folder, &analysis, bench)?;
    write(args, folder, &analysis, bench)?;
    print(args, &analysis, &format!("{} models", file.row_count()));
    Ok(Outcome::Done)
}

/// Claims the folder for an analysis, unless it would overwrite files of others.
fn begin(folder: &OwnFolder, analysis: &Analysis, bench: &Workbench) -> anyhow::Result<()> {
    folder.check_own(analysis_files(analysis, bench))?;
    Ok(folder.begin()?)
}

/// Writes the results, records each one as soon as it is written, and removes results of an earlier analysis that this one did not make.
fn write(args: &Args, folder: OwnFolder, analysis: &Analysis, bench: &Workbench) -> anyhow::Result<()> {
    let title = args.output.file_name().map_or_else(|| "tracks".to_owned(), |n| n.to_string_lossy().into_owned());
    write_analysis(analysis, &args.output, &title, bench, |name, hash| folder.wrote_as(name, hash))
        .context("writing the results")?;
    Ok(folder.end()?)
}

fn print(args: &Args, analysis: &Analysis, what: &str) {
    if !args.general.quiet {
        println!("{what}");
        print_results(&analysis.counts(), &analysis.warnings, &args.output);
    }
}
