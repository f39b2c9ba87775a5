//! `grimace recognize`.

use std::{fs, path::PathBuf};

use anyhow::Context;

use super::{
    Outcome,
    apart::{all, check_apart},
    failures::{say_failures, say_unlisted},
    shared::{GeneralArgs, set_threads, share, some_track_files},
};
use crate::{
    dataset::Dataset,
    output::write_records,
    pipeline::{
        NONE_LEVEL, PipelineOptions, RecognitionResults, RecognizedRow, left_out_said, load_tracks, read_run_json,
        recognition_header, recognition_record, results_folder, track_files, tracks_folder, write_recognition,
    },
    statistics::recognize::{Recognizer, shown_by_several},
};

/// Label sequences by the expressions of people seen before.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace recognize --with results new-people/tracks/*.csv -o recognition.csv

Columns: subject, sequence, emotion (where the track's .json names one), recognized, probability, p_LABEL for every label, distance \
(squared, in standard deviations within labels), typicality (share of known sequences that are as far from their label; beyond all of them, by how their distances scatter; of a sequence that moves \
less than all of them, at most the chance of that), id. A sequence that is less typical than --none is `none of these`. Probabilities are calibrated on people who were left out.")]
pub struct Args {
    /// Tracks to label: files, or folders of them
    #[arg(required = true, value_name = "TRACK")]
    tracks: Vec<PathBuf>,
    /// Results of `run`, or a folder of labelled tracks, to learn from
    #[arg(long, value_name = "OUT")]
    with: PathBuf,
    /// Dataset or manifest that says the emotions of the tracks to learn from, where no .json beside them does
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Table to write; without it, it is printed
    #[arg(short, long, value_name = "FILE.csv")]
    output: Option<PathBuf>,
    /// Typicality, 0 to 1, under which a sequence is none of the labels; 0 never says so
    #[arg(long, default_value_t = NONE_LEVEL, value_parser = share, value_name = "SHARE")]
    none: f64,
    /// Threads; 0 for one per processor
    #[arg(short = 'j', long, default_value_t = 0)]
    threads: usize,
    #[command(flatten)]
    general: GeneralArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    set_threads(args.threads)?;
    if let Some(path) = &args.output {
        args.general.check_free(path)?;
    }
    let mut options = PipelineOptions::default();
    // Sequences are normalized as those that are learned from.
    if let Some(run) = read_run_json::<serde_json::Value>(&results_folder(&args.with))?
        && let Ok(normalize) = serde_json::from_value(run["options"]["normalize"].clone())
    {
        options.normalize = normalize;
    }
    let bench = args.general.workbench(options)?;
    let dataset = args.dataset.as_deref().map(Dataset::open).transpose()?;
    let known_files = track_files(std::slice::from_ref(&args.with))?;
    anyhow::ensure!(
        !known_files.is_empty(),
        "{} has no tracks to learn from; give results of `run`, or a folder of tracks",
        tracks_folder(&args.with).display()
    );
    let (known, known_failures) = load_tracks(&known_files, dataset.as_ref(), &bench);
    say_unlisted(&known, dataset.as_ref());
    let files = some_track_files(&args.tracks)?;
    if let Some(output) = &args.output {
        let inputs: Vec<_> = all("a track", &files).chain(all("a track of --with", &known_files)).collect();
        check_apart(&[("--output", output)], &inputs)?;
    }
    let (unseen, failures) = crate::pipeline::load_unlabelled_tracks(&files, &bench);
    say_failures(known_failures.iter().chain(&failures), None);
    let labelled: Vec<_> = known.iter().map(|m| (&m.model, m.emotion.as_str())).collect();
    let (labelled, left_out) = shown_by_several(labelled, |(model, label)| (&model.id.subject, label));
    if let Some(said) = left_out_said(&left_out) {
        eprintln!("note: {said}");
    }
    let recognizer = Recognizer::new(&labelled, bench.wireframe.live_nodes(), || {})
        .with_context(|| format!("cannot learn from {}", args.with.display()))?;
    if recognizer.is_beyond_counting(args.none) {
        let (few, level) = (recognizer.left_out.len(), args.none);
        let enough = (1.0 / level).floor();
        eprintln!(
            "note: {few} known sequences are too few to count a share of {level}, which takes {enough:.0}: `none of these` is what is farther \
             off than all of them, and by how their distances scatter would be in less than {level} of all"
        );
    }
    let subjects: std::collections::BTreeSet<&str> = known.iter().map(|m| m.model.id.subject.as_str()).collect();
    let seen = unseen.iter().filter(|m| subjects.contains(m.model.id.subject.as_str())).count();
    if seen > 0 {
        eprintln!(
            "note: {seen} of the sequences are of people that were learned from; recognition.csv of `run` leaves people out"
        );
    }
    let row = |m: &crate::pipeline::AnalyzedModel| -> anyhow::Result<RecognizedRow> {
        Ok(RecognizedRow { id: m.model.id.clone(), emotion: m.emotion.clone(), recognized: recognizer.recognize(&m.model)? })
    };
    let rows = unseen.iter().map(row).collect::<anyhow::Result<Vec<_>>>()?;
    let results = RecognitionResults { labels: recognizer.labels.clone(), rows, left_out };
    match &args.output {
        // A table without a row would only be in the way of the next one.
        Some(_) if results.rows.is_empty() => eprintln!("note: no sequence was recognized; no table is written"),
        Some(path) => {
            write_recognition(path, &results, args.none)?;
            if !args.general.quiet {
                println!("{} sequences recognized, in {}", results.rows.len(), path.display());
            }
        }
        None => print_table(&results, args.none)?,
    }
    Ok(match (results.rows.is_empty(), failures.is_empty() && known_failures.is_empty()) {
        (true, _) => Outcome::Failed,
        (false, true) => Outcome::Done,
        (false, false) => Outcome::SomeFailed,
    })
}

/// Prints the table as CSV.
fn print_table(results: &RecognitionResults, level: f64) -> anyhow::Result<()> {
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let path = folder.path().join("recognition.csv");
    let records = results.rows.iter().map(|row| recognition_record(row, level));
    write_records(&path, recognition_header(&results.labels), records)?;
    let text = fs::read_to_string(&path).context("cannot read the table back")?;
    text.lines().for_each(|line| println!("{line}"));
    Ok(())
}
