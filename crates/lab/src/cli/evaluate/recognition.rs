//! `grimace evaluate recognition`.

use std::path::PathBuf;

use grimace::internal::{
    dataset::Dataset,
    output::write_bytes,
    pipeline::{NONE_LEVEL, PipelineOptions, Workbench, left_out_said, load_tracks, track_files},
    statistics::recognize::shown_by_several,
};
use grimace_lab::evaluate::{LabelledSequence, evaluate_discriminants, evaluate_recognition};
use serde_json::json;

use grimace::internal::cli::{Outcome, failures::say_failures, shared::ModelArgs};

use super::{CommonArgs, bar};

/// Accuracy of recognition by the representatives, and by the discriminants, of other people.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace evaluate recognition results/tracks -o recognition

Leave-one-subject-out cross-validation, in two ways:
  nearest representative: confusion.csv, confusion.svg, recognition.csv (one row per sequence)
  discriminants of `run` and `recognize`: confusion_discriminants.csv and .svg, recognition_discriminants.csv, calibration.csv and .svg \
(calibration of the probabilities)
evaluation.json has both accuracies.")]
pub struct Args {
    /// Track files, or folders of track files
    #[arg(required = true)]
    tracks: Vec<PathBuf>,
    /// Dataset or manifest with the emotion and other columns of the sequences
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Label to recognize: the emotion, or a column of the manifest
    #[arg(long, default_value = "emotion", value_name = "COLUMN")]
    label: String,
    #[command(flatten)]
    models: ModelArgs,
    #[command(flatten)]
    common: CommonArgs,
}

/// Runs the experiment.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut folder = args.common.start()?;
    let (normalize, statistics) =
        (args.models.normalize_of(grimace::internal::pipeline::Method::Default), args.models.statistics());
    let options = PipelineOptions { normalize, statistics, ..PipelineOptions::default() };
    let bench = Workbench::new(None, options)?;
    let dataset = args.dataset.as_deref().map(Dataset::open).transpose()?;
    let files = track_files(&args.tracks)?;
    anyhow::ensure!(!files.is_empty(), "no .csv file in {}", args.tracks[0].display());
    let (models, failures) = load_tracks(&files, dataset.as_ref(), &bench);
    say_failures(&failures, None);
    let models: Vec<_> = models.into_iter().filter(|m| !m.is_left_out()).collect();
    let known = models.iter().flat_map(|m| m.metadata.keys()).any(|column| *column == args.label);
    anyhow::ensure!(args.label == "emotion" || known, "no sequence has a column `{}`", args.label);
    let label = |m: &grimace::internal::pipeline::AnalyzedModel| match args.label.as_str() {
        "emotion" => m.emotion.clone(),
        column => m.metadata.get(column).cloned().unwrap_or_default(),
    };
    let labelled = models.iter().map(|m| LabelledSequence { model: m.model.clone(), label: label(m) });
    let (labelled, unlabelled): (Vec<_>, Vec<_>) = labelled.partition(|s| !s.label.is_empty());
    if !unlabelled.is_empty() {
        eprintln!("skipped {} sequences without a value in `{}`", unlabelled.len(), args.label);
    }
    let mut subjects: Vec<&str> = labelled.iter().map(|s| s.model.id.subject.as_str()).collect();
    subjects.sort_unstable();
    subjects.dedup();
    let bar = bar(args.common.quiet, "leaving out", subjects.len());
    let recognition = evaluate_recognition(&labelled, &bench.wireframe, &bench.options.statistics, || bar.inc(1))?;
    bar.finish_and_clear();

    let summary = recognition.summary(args.common.seed);
    let confusion = recognition.confusion_table();
    folder.table("confusion.csv", &confusion)?;
    folder.table("recognition.csv", &recognition.sequence_table())?;
    write_bytes(&folder.path.join("confusion.svg"), recognition.confusion_svg().as_bytes())?;
    folder.files.push("confusion.svg".to_owned());
    folder.print("Confusion: rows are true labels, columns recognized labels", &confusion);
    if !args.common.quiet {
        println!(
            "evaluated {} of {} sequences of {} subjects; recognized {:.1} % (95 % interval {:.1} to {:.1}), mean over labels {:.1} %",
            summary.judged,
            recognition.sequences.len(),
            subjects.len(),
            100.0 * summary.accuracy,
            100.0 * summary.accuracy_interval[0],
            100.0 * summary.accuracy_interval[1],
            100.0 * summary.balanced_accuracy
        );
        println!(
            "for comparison: always the most frequent label {:.1} %; chance, mean over labels {:.1} %",
            100.0 * summary.most_frequent,
            100.0 * summary.guessing
        );
    }
    let (learned, alone) = shown_by_several(labelled, |s| (&s.model.id.subject, &s.label));
    if let Some(said) = left_out_said(&alone) {
        eprintln!("note: discriminants: {said}");
    }
    let discriminants = match evaluate_discriminants(&learned, &bench.wireframe, NONE_LEVEL, || {}) {
        Ok(calibration) => {
            let summary = calibration.recognition.summary(args.common.seed);
            let confusion = calibration.recognition.confusion_table();
            folder.table("confusion_discriminants.csv", &confusion)?;
            folder.table("recognition_discriminants.csv", &calibration.recognition.sequence_table())?;
            folder.table("calibration.csv", &calibration.table())?;
            for (name, svg) in
                [("confusion_discriminants.svg", calibration.recognition.confusion_svg()), ("calibration.svg", calibration.svg())]
            {
                write_bytes(&folder.path.join(name), svg.as_bytes())?;
                folder.files.push(name.to_owned());
            }
            folder.print("Confusion of the discriminants", &confusion);
            folder.print("Calibration of their probabilities", &calibration.table());
            if !args.common.quiet {
                println!(
                    "discriminants: {} evaluated; recognized {:.1} % (95 % interval {:.1} to {:.1}); none of these: {}",
                    summary.judged,
                    100.0 * summary.accuracy,
                    100.0 * summary.accuracy_interval[0],
                    100.0 * summary.accuracy_interval[1],
                    calibration.none
                );
            }
            json!(summary)
        }
        Err(why) => {
            eprintln!("no discriminants: {why}");
            json!(why.to_string())
        }
    };
    let options = json!({
        "label": args.label,
        "resample": normalize.resample,
        "size": normalize.size,
        "irisd": normalize.irisd,
        "alpha": statistics.alpha,
        "median": statistics.median,
        "tracks": files.len(),
    });
    folder.finish(
        "recognition",
        args.dataset.as_deref(),
        args.common.seed,
        options,
        json!({ "nearest": summary, "discriminants": discriminants }),
    )?;
    Ok(if failures.is_empty() { Outcome::Done } else { Outcome::SomeFailed })
}
