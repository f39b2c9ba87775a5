//! `grimace recognize`.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
};

use anyhow::Context;
use serde::Deserialize;
use serde_json::Value;

use super::{
    Outcome,
    apart::{all, check_apart, check_own_table},
    failures::{LOOK_AGAIN, lines_by_kind, say_failures, say_unlisted},
    progress::SequenceBar,
    shared::{GeneralArgs, set_threads, share, stop_flag},
};
use crate::{
    dataset::Dataset,
    fit::{LoadedPrior, PriorKind},
    output::{count, write_records},
    pipeline::{
        AnalyzedModel, NONE_LEVEL, PipelineOptions, RecognitionResults, RecognizedRow, RunError, Unseen, Workbench,
        differing_wireframes, left_out_said, load_tracks, load_unlabelled_tracks, read_run_json, recognition_header,
        recognition_record, results_folder, track_files, track_unseen, tracks_folder, write_recognition,
    },
    report::{Failure, Stage},
    statistics::recognize::{Recognizer, shown_by_several},
    units::SequenceId,
};

/// Recognize the expressions of sequences, after learning from labelled ones.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace recognize --with results new-people/tracks/*.csv -o recognition.csv
  grimace recognize --with results new-people anna.mp4 -o recognition.csv

An INPUT is a track or a folder with tracks, a dataset (a folder with manifest.csv, or in the layout of Cohn-Kanade; emotions are not \
needed), a folder with the frames of one sequence, neutral first, or a video. `recognize` tracks all inputs that are not tracks, with the options of \
the run in OUT (fit, tracker and marks in its run.json), finds missing marks, and keeps no tracks. If a folder contains tracks, only these are used. A folder S005/001 or \
S005_001 and a video S005_001.mp4 or S005/001.mp4 are sequence 001 of subject S005; anna.mp4 is of subject anna. Inputs that cannot be \
tracked are reported and skipped. Of two inputs with the same name, the first is used.

Columns:
  subject, sequence
  emotion            label in the track's .json or in the manifest, if there is one
  recognized         most probable label, or `none of these` if typicality is below --none
  probability        of the most probable label; calibrated on held-out people
  p_LABEL            probability of every label
  distance           squared, in standard deviations within labels
  typicality         share of the known sequences that are as far from their label
  id

For a sequence beyond all known ones, typicality is extrapolated from the spread of their distances. For a sequence that moves less than all known ones, it is at \
most the chance of so little motion.

Exit status: 0 done, 1 nothing recognized, 2 wrong usage, 3 some sequences failed.")]
pub struct Args {
    /// Sequences to recognize: tracks, folders of tracks, datasets, folders with the frames of one sequence, or videos
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// Results of `run`, or a folder of labelled tracks, to learn from
    #[arg(long, value_name = "OUT")]
    with: PathBuf,
    /// Dataset or manifest with the emotions of the tracks of --with, if the .json beside them has none
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Table to write; by default it is printed
    #[arg(short, long, value_name = "FILE.csv")]
    output: Option<PathBuf>,
    /// Minimum typicality, 0 to 1; below it the result is `none of these`; 0 switches this off
    #[arg(long, default_value_t = NONE_LEVEL, value_parser = share, value_name = "SHARE")]
    none: f64,
    /// Number of threads; 0 uses one per processor
    #[arg(short = 'j', long, default_value_t = 0)]
    threads: usize,
    #[command(flatten)]
    general: GeneralArgs,
}

/// Merges options with those of a record. `name` is the path of the option; unknown ones are added to `unknown`.
fn merged(usual: Value, said: &Value, name: &str, unknown: &mut Vec<String>) -> Value {
    let (Value::Object(mut all), Value::Object(said)) = (usual, said) else { return said.clone() };
    for (key, value) in said {
        let name = format!("{name}.{key}");
        match all.get_mut(key) {
            Some(own) => *own = merged(own.take(), value, &name, unknown),
            None => unknown.push(name),
        }
    }
    Value::Object(all)
}

/// The parts of a run's record that are used.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Record {
    options: Value,
    wireframe_blake3: Option<String>,
}

impl Record {
    /// The options of the run: sequences are tracked and normalized in the same way. Missing ones have their defaults, and unknown ones are
    /// reported.
    fn options(&self, with: &Path) -> PipelineOptions {
        // Pictures of segments of recordings are not shown.
        let mut options = PipelineOptions { no_faces: true, ..PipelineOptions::default() };
        let mut unknown = Vec::new();
        for name in ["normalize", "fit", "track", "marks", "landmarks", "unchecked_marks"] {
            let said = &self.options[name];
            let Ok(mut all) = serde_json::to_value(&options) else { continue };
            if !said.is_null() {
                all[name] = merged(all[name].take(), said, name, &mut unknown);
            }
            match serde_json::from_value(all) {
                Ok(read) => options = read,
                Err(_) => unknown.push(name.to_owned()),
            }
        }
        if !unknown.is_empty() {
            eprintln!(
                "note: the run.json of {} has settings that this version does not know: {}; the defaults are used instead",
                with.display(),
                unknown.join(", ")
            );
        }
        // For the file of a prior only the content is recorded.
        if let PriorKind::File(LoadedPrior { prior: None, .. }) = &options.fit.prior {
            options.fit.prior = PriorKind::default();
            eprintln!(
                "note: the run in {} used a prior file, which it does not contain; pictures are fitted with --prior auto",
                with.display()
            );
        }
        options
    }
}

/// A workbench like that of the run; its record may be missing.
fn workbench(args: &Args, record: Option<&Record>) -> anyhow::Result<Workbench> {
    let options =
        record.map_or_else(|| PipelineOptions { no_faces: true, ..PipelineOptions::default() }, |r| r.options(&args.with));
    let bench = args.general.workbench(options)?;
    let now = args.general.wireframe_blake3();
    let differing = record.and_then(|r| differing_wireframes(r.wireframe_blake3.as_deref(), now.as_deref()));
    if let Some(what) = differing {
        anyhow::bail!("{} holds a run with {what}; give the same --wireframe as for that run", args.with.display());
    }
    Ok(bench)
}

/// Learns from the labelled tracks and prints notes.
fn learn(known: &[AnalyzedModel], args: &Args, bench: &Workbench) -> anyhow::Result<(Recognizer, Vec<String>)> {
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
            "note: {few} known sequences are too few to measure a typicality of {level}, which needs {enough:.0}: a sequence is `none of these` if \
             it is beyond all of them and its typicality, extrapolated from the spread of their distances, is below {level}"
        );
    }
    Ok((recognizer, left_out))
}

/// Tracks pictures; returns their models and failures.
fn track(
    pictures: Dataset,
    bench: &Workbench,
    stop: &AtomicBool,
    quiet: bool,
) -> anyhow::Result<(Vec<AnalyzedModel>, Vec<Failure>)> {
    let scratch = tempfile::tempdir().context("cannot create a temporary folder")?;
    let bar = SequenceBar::new(quiet);
    let tracked = track_unseen(pictures, scratch.path(), bench, stop, |event| bar.show(&event));
    bar.finish();
    let tracked = tracked.map_err(|error| match error {
        RunError::Interrupted => interrupted(),
        other => other.into(),
    })?;
    let lines = |said: &[(SequenceId, String)], what: &str, became: &str| {
        let said = said.iter().map(|(id, said)| (id, what.to_owned(), said.clone()));
        lines_by_kind(said, became, None).iter().for_each(|line| eprintln!("{line}"));
    };
    if !quiet {
        lines(&tracked.notes, "note", "have a note");
    }
    lines(&tracked.reasons, LOOK_AGAIN, "need a look");
    Ok((tracked.models, tracked.failures))
}

fn interrupted() -> anyhow::Error {
    anyhow::anyhow!("interrupted")
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    set_threads(args.threads)?;
    if let Some(path) = &args.output {
        args.general.check_free(path)?;
    }
    let results = results_folder(&args.with);
    let record: Option<Record> = read_run_json(&results)?;
    let bench = workbench(args, record.as_ref())?;
    let dataset = args.dataset.as_deref().map(Dataset::open).transpose()?;
    let known_files = track_files(std::slice::from_ref(&args.with))?;
    anyhow::ensure!(
        !known_files.is_empty(),
        "{} has no tracks to learn from; give the output folder of `run`, or a folder of tracks",
        tracks_folder(&args.with).display()
    );
    let unseen = Unseen::of(&args.inputs)?;
    if let Some(output) = &args.output {
        let inputs = all("an input", &args.inputs).chain(all("a track", &unseen.tracks));
        check_apart(&[("--output", output)], &inputs.chain(all("a track of --with", &known_files)).collect::<Vec<_>>())?;
        check_own_table(output, "subject,sequence,emotion,recognized,probability,")?;
    }
    let (known, known_failures) = load_tracks(&known_files, dataset.as_ref(), &bench);
    say_unlisted(&known, dataset.as_ref());
    let known: Vec<AnalyzedModel> = known.into_iter().filter(|m| !m.is_left_out()).collect();
    let Unseen { tracks, pictures, .. } = unseen;
    let (mut unseen, mut failures) = load_unlabelled_tracks(&tracks, &bench);
    say_failures(known_failures.iter().chain(&failures), None);
    // Checked before hours of tracking, not after.
    let (recognizer, left_out) = learn(&known, args, &bench)?;
    let has_pictures = !pictures.sequences.is_empty() || !pictures.failures.is_empty();
    let stop = has_pictures.then(stop_flag).transpose()?;
    if let Some(stop) = &stop {
        if record.is_none() {
            eprintln!("note: {} has no run.json; pictures are tracked with the default options", results.display());
        }
        let (tracked, mut failed) = track(pictures, &bench, stop, args.general.quiet)?;
        let read: BTreeSet<String> = unseen.iter().map(|m| m.model.id.to_string()).collect();
        for model in tracked {
            let SequenceId { subject, sequence } = model.model.id.clone();
            if read.contains(&model.model.id.to_string()) {
                let reason = format!("a track of {} is given, too; this input is skipped", model.model.id);
                failed.push(Failure { subject, sequence, stage: Stage::Dataset, reason });
            } else {
                unseen.push(model);
            }
        }
        say_failures(&failed, None);
        failures.extend(failed);
    }
    let subjects: BTreeSet<&str> = known.iter().map(|m| m.model.id.subject.as_str()).collect();
    let seen = unseen.iter().filter(|m| subjects.contains(m.model.id.subject.as_str())).count();
    if seen > 0 {
        eprintln!(
            "note: {seen} of the sequences have names of people of the training data; if they are the same people, their results are \
             optimistic; recognition.csv of `run` holds out every person"
        );
    }
    let row = |m: &AnalyzedModel| -> anyhow::Result<RecognizedRow> {
        Ok(RecognizedRow { id: m.model.id.clone(), emotion: m.emotion.clone(), recognized: recognizer.recognize(&m.model)? })
    };
    let rows = unseen.iter().map(row).collect::<anyhow::Result<Vec<_>>>()?;
    if stop.is_some_and(|stop| stop.load(Ordering::Relaxed)) {
        return Err(interrupted());
    }
    let results = RecognitionResults { labels: recognizer.labels.clone(), rows, left_out };
    match &args.output {
        // A table without rows would only be in the way of the next run.
        Some(_) if results.rows.is_empty() => eprintln!("note: no sequence was recognized, so no table was written"),
        Some(path) => {
            write_recognition(path, &results, args.none)?;
            if !args.general.quiet {
                println!("{} recognized; table: {}", count(results.rows.len(), "sequence", "sequences"), path.display());
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
    let folder = tempfile::tempdir().context("cannot create a temporary folder")?;
    let path = folder.path().join("recognition.csv");
    let records = results.rows.iter().map(|row| recognition_record(row, level));
    write_records(&path, recognition_header(&results.labels), records)?;
    let text = fs::read_to_string(&path).context("cannot read the table back")?;
    text.lines().for_each(|line| println!("{line}"));
    Ok(())
}
