//! `grimace evaluate tracking`.

use std::{path::PathBuf, sync::atomic::Ordering};

use grimace::internal::{
    dataset::DEFAULT_LANDMARK_NODES,
    fit::Fitter,
    wireframe::{Tables, Wireframe},
};
use grimace_lab::evaluate::{
    Cell, Failed, Start, Table, TrackerVariant, TrackingOptions, TrackingResult, VariantKind, curve_table, dataset_cases,
    evaluate_tracking, frames_worse, hard_simulation, last_table, markdown_last, sequence_table, simulated_cases,
    standard_variants, tracking_chart, truth_case,
};
use serde_json::{Value, json};

use super::{CommonArgs, Folder, SimulationArgs, bar, file_word, nodes};
use grimace::internal::cli::{
    Outcome,
    shared::{FitArgs, MethodArgs, TrackArgs, stop_flag},
};

/// Error of the tracker per frame, with and without deformation, compared with plain KLT.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace evaluate tracking -o tracking-error --subjects 4 --hard
  grimace evaluate tracking faces -o tracking-error --by kind --start marks
  grimace evaluate tracking -o ablation --variants narrow:window=0.08 --variants stiff:force=10,extreme=4
  grimace evaluate tracking -o paper --method kp
  grimace evaluate tracking -o mine --truth S005_001_by_hand.csv --tracks before:old/S005_001.csv --tracks now:results/tracks/S005_001.csv

Without a DATASET, sequences are simulated in memory. A DATASET needs 68-point landmarks for at least the neutral and the last frame; errors \
are measured at the nodes of the landmarks. If DATASET/truth/SUBJECT_SEQUENCE.csv exists (frame,node,x,y in px, for any nodes and frames, \
including the neutral frame), it is used instead. --truth is such a file for the tracks of --tracks.

The experiment switches deformation and alignment off, each alone and both together. tracking_frames.csv and tracking_*.svg have the error \
per frame, tracking_last.csv that of the last frames, tracking_sequences.csv that of every sequence. failures.csv lists sequences that fail; \
the exit status is then 3.")]
pub struct Args {
    /// Dataset with 68-point landmarks; by default sequences are simulated
    dataset: Option<PathBuf>,
    /// Start of the tracks: all known nodes of the neutral frame (`landmarks`), or a fit to marks (`marks`)
    ///
    /// `landmarks` measures the error of positions, `marks` the error of offsets from neutral.
    #[arg(long, value_enum, default_value_t = StartWord::Landmarks)]
    start: StartWord,
    /// Manifest column to group by
    #[arg(long, value_name = "COLUMN", requires = "dataset")]
    by: Option<String>,
    /// Nodes or feature points to mark, with --start marks
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    marks: Vec<String>,
    /// Additional tracker to compare: a name and the tracker options that differ; can be given several times
    #[arg(long, value_name = "NAME:KEY=VALUE,...")]
    variants: Vec<String>,
    /// Existing tracks to compare: a name and a track, or a folder of SUBJECT_SEQUENCE.csv; can be given several times
    #[arg(long, value_parser = named_tracks, value_name = "NAME:PATH")]
    tracks: Vec<(String, PathBuf)>,
    /// Hand-set positions to compare --tracks with, a CSV file frame,node,x,y in px
    #[arg(long, value_name = "TRUTH.csv", requires = "tracks", conflicts_with_all = ["dataset", "variants", "hard"])]
    truth: Option<PathBuf>,
    /// Number of simulated subjects
    #[arg(long, default_value_t = 4, value_name = "N", conflicts_with = "dataset", help_heading = super::SIMULATION)]
    subjects: u32,
    /// Use the hard simulation: blur, changing light, noise, compression, head turned by up to 8 degrees
    #[arg(long, conflicts_with = "dataset", help_heading = super::SIMULATION)]
    hard: bool,
    #[command(flatten)]
    simulation: SimulationArgs,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    fit: FitArgs,
    #[command(flatten)]
    track: TrackArgs,
    #[command(flatten)]
    common: CommonArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum StartWord {
    Landmarks,
    #[value(alias = "seven")]
    Marks,
}

/// A name and a path.
fn named_tracks(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once(':') {
        Some((name, path)) if !name.trim().is_empty() && !path.is_empty() => Ok((name.trim().to_owned(), PathBuf::from(path))),
        _ => Err("expected a name and a path, as in before:old/S005_001.csv".to_owned()),
    }
}

impl From<StartWord> for Start {
    fn from(word: StartWord) -> Self {
        match word {
            StartWord::Landmarks => Self::Landmarks,
            StartWord::Marks => Self::Marks,
        }
    }
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut folder = args.common.start()?;
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let base = args.track.options_of(args.method.method);
    let mut variants = if args.truth.is_some() { Vec::new() } else { standard_variants(&base) };
    for text in &args.variants {
        let variant = TrackerVariant::parse(text, &base)?;
        anyhow::ensure!(
            variants.iter().all(|v| v.name != variant.name),
            "--variants: the name `{}` appears twice; rename one",
            variant.name
        );
        variants.push(variant);
    }
    for (name, path) in &args.tracks {
        anyhow::ensure!(path.exists(), "--tracks: {} does not exist", path.display());
        anyhow::ensure!(variants.iter().all(|v| v.name != *name), "--tracks: the name `{name}` appears twice; rename one");
        variants.push(TrackerVariant { name: name.clone(), kind: VariantKind::Tracks(path.clone()) });
    }
    anyhow::ensure!(
        args.tracks.is_empty() || args.dataset.is_some() || args.truth.is_some(),
        "--tracks: give the DATASET of the tracks, or hand-set positions with --truth"
    );
    let marks = if args.marks.is_empty() { DEFAULT_LANDMARK_NODES.to_vec() } else { nodes(&args.marks, &tables, &wireframe)? };
    let options = TrackingOptions {
        start: args.start.into(),
        variants,
        marks,
        marks_noise_px: args.simulation.marks_noise,
        by: args.by.clone(),
        seed: args.common.seed,
    };
    let clean = args.simulation.options(args.subjects, args.common.seed);
    let simulation = if args.hard { hard_simulation(&clean) } else { clean };
    let (cases, mut failures) = match (&args.dataset, &args.truth) {
        (Some(path), _) => dataset_cases(path, args.by.as_deref())?,
        (None, Some(truth)) => (vec![truth_case(truth)], Vec::new()),
        (None, None) => (simulated_cases(&simulation)?, Vec::new()),
    };
    let fit_options = args.fit.options_of(args.method.method);
    let fitter = Fitter::new(&wireframe, fit_options.clone());
    let stop = stop_flag()?;
    let bar = bar(args.common.quiet, "tracking", cases.len());
    let result = evaluate_tracking(&cases, &fitter, &wireframe, &tables, &options, || {
        bar.inc(1);
        !stop.load(Ordering::SeqCst)
    });
    bar.finish_and_clear();
    let result = result?;
    failures.extend(result.failures.iter().cloned());
    write(&mut folder, &result, &failures, options.start)?;
    for failure in &failures {
        let variant = if failure.variant.is_empty() { String::new() } else { format!(" ({})", failure.variant) };
        eprintln!("failed: {}{variant}: {}", failure.id, failure.reason);
    }

    let names = |v: &TrackerVariant| {
        let settings = match &v.kind {
            VariantKind::Options(options) => json!(options),
            VariantKind::PlainKlt => json!("plain KLT: frame to frame, 21-pixel window, 4 levels, no check"),
            VariantKind::Tracks(path) => json!(format!("tracks that were there: {}", path.display())),
        };
        (v.name.clone(), settings)
    };
    let written = json!({
        "start": options.start,
        "marks": options.marks,
        "by": options.by,
        "fit": fit_options,
        "variants": options.variants.iter().map(names).collect::<serde_json::Map<String, Value>>(),
        "truth": args.truth,
        "method": args.method.method,
        "simulation": (args.dataset.is_none() && args.truth.is_none()).then_some(&simulation),
        "marks_noise_px": args.dataset.is_none().then_some(options.marks_noise_px),
    });
    let results = json!({ "sequences": cases.len() - result.failures.len(), "failed": failures.len() });
    folder.finish("tracking", args.dataset.as_deref(), options.seed, written, results)?;
    Ok(match (result.failures.len() == cases.len(), failures.is_empty()) {
        (true, _) => Outcome::Failed,
        (false, false) => Outcome::SomeFailed,
        (false, true) => Outcome::Done,
    })
}

fn write(folder: &mut Folder, result: &TrackingResult, failures: &[Failed], start: Start) -> anyhow::Result<()> {
    let records = &result.records;
    folder.table("tracking_frames.csv", &curve_table(records))?;
    folder.table("tracking_last.csv", &last_table(records))?;
    folder.table("tracking_sequences.csv", &sequence_table(records))?;
    let mut failed = Table::new(["sequence", "variant", "reason"]);
    failed.rows.extend(failures.iter().map(|f| [&f.id, &f.variant, &f.reason].map(Cell::text).to_vec()));
    folder.table("failures.csv", &failed)?;
    if records.errors.is_empty() {
        return Ok(());
    }
    let what = match start {
        Start::Landmarks => "position error",
        Start::Marks => "error of the offset from neutral",
    };
    for (g, group) in records.groups.iter().enumerate() {
        if records.errors.iter().any(|e| e.group == g) {
            folder.figure(&format!("tracking_{}.svg", file_word(group)), &tracking_chart(records, g, what))?;
        }
    }
    folder.print(&format!("Last frame, mean {what}"), &markdown_last(records));
    // The first two variants are the tracker with and without its deformation, unless only tracks were compared.
    if records.variants.get(1).is_none_or(|name| name != "without deformation") {
        return Ok(());
    }
    let mut claim = Table::new(["group", "frames from the 5th on", "worse with deformation"]);
    for (group, frames, worse) in frames_worse(records, 0, 1) {
        claim.rows.push(vec![Cell::text(group), Cell::Count(frames), Cell::Count(worse)]);
    }
    folder.print("With deformation against without, mean per frame", &claim);
    Ok(())
}
