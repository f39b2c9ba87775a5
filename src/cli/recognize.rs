//! `grimace recognize`.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use anyhow::Context;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::{
    Outcome,
    apart::{all, check_apart, check_not_over},
    failures::{LOOK_AGAIN, lines_by_kind, say_failures, say_unlisted},
    progress::SequenceBar,
    shared::{GeneralArgs, set_threads, share, stop_flag},
};
use crate::{
    dataset::Dataset,
    fit::{LoadedPrior, PriorKind},
    output::write_records,
    pipeline::{
        AnalyzedModel, NONE_LEVEL, PipelineOptions, RecognitionResults, RecognizedRow, RunError, Unseen, Workbench,
        left_out_said, load_tracks, load_unlabelled_tracks, read_run_json, recognition_header, recognition_record,
        results_folder, track_files, track_unseen, tracks_folder, write_recognition,
    },
    report::{Failure, Stage},
    statistics::recognize::{Recognizer, shown_by_several},
    units::SequenceId,
};

/// Label sequences by the expressions of people seen before.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace recognize --with results new-people/tracks/*.csv -o recognition.csv
  grimace recognize --with results new-people anna.mp4 -o recognition.csv

What is no track is tracked first, as the run in OUT was (options of fit, tracker and marks in its run.json), and nothing of it is kept: a dataset (a folder with manifest.csv, which \
needs no emotions here, or in the layout of Cohn-Kanade), a folder of the frames of one sequence, neutral first, or a video. Marks are found where there are none. What cannot \
be tracked is named as `run` names it.

Columns: subject, sequence, emotion (where the track's .json or the manifest names one), recognized, probability, p_LABEL for every label, distance \
(squared, in standard deviations within labels), typicality (share of known sequences that are as far from their label; beyond all of them, by how their distances scatter; of a sequence that moves \
less than all of them, at most the chance of that), id. A sequence that is less typical than --none is `none of these`. Probabilities are calibrated on people who were left out.

Exit status: 0 done, 1 nothing recognized, 2 bad usage, 3 some sequences failed.")]
pub struct Args {
    /// What to label: tracks or folders of them, datasets, folders of the frames of one sequence, videos
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
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

/// The options of the run that is learned from, where it says them: sequences are tracked and normalized as its are.
fn options_of_run(with: &Path) -> anyhow::Result<PipelineOptions> {
    fn take<T: DeserializeOwned>(option: &mut T, said: &Value) {
        if let Ok(value) = serde_json::from_value(said.clone()) {
            *option = value;
        }
    }
    let mut options = PipelineOptions::default();
    if let Some(run) = read_run_json::<Value>(&results_folder(with))? {
        let said = &run["options"];
        take(&mut options.normalize, &said["normalize"]);
        take(&mut options.fit, &said["fit"]);
        take(&mut options.track, &said["track"]);
        take(&mut options.marks, &said["marks"]);
        take(&mut options.landmarks, &said["landmarks"]);
        take(&mut options.unchecked_marks, &said["unchecked_marks"]);
    }
    Ok(options)
}

/// Reads the tracks, and tracks the pictures; what failed, too.
fn read_unseen(unseen: Unseen, bench: &Workbench, quiet: bool) -> anyhow::Result<(Vec<AnalyzedModel>, Vec<Failure>)> {
    let (mut models, mut failures) = load_unlabelled_tracks(&unseen.tracks, bench);
    if unseen.pictures.sequences.is_empty() && unseen.pictures.failures.is_empty() {
        return Ok((models, failures));
    }
    let scratch = tempfile::tempdir().context("cannot make a temporary folder")?;
    let stop = stop_flag()?;
    let bar = SequenceBar::new(quiet);
    let tracked = track_unseen(unseen.pictures, scratch.path(), bench, &stop, |event| bar.show(&event));
    bar.finish();
    let tracked = tracked.map_err(|error| match error {
        RunError::Interrupted => anyhow::anyhow!("interrupted"),
        other => other.into(),
    })?;
    tracked.notes.iter().for_each(|note| eprintln!("note: {note}"));
    let reasons = tracked.models.iter().filter_map(|m| Some((&m.model.id, m.quality.as_ref()?.summary.reasons.join("; "))));
    let to_look_at = reasons.filter(|(_, said)| !said.is_empty()).map(|(id, said)| (id, LOOK_AGAIN.to_owned(), said));
    lines_by_kind(to_look_at, "deserve a look", None).iter().for_each(|line| eprintln!("{line}"));
    failures.extend(tracked.failures);
    let read: BTreeSet<String> = models.iter().map(|m| m.model.id.to_string()).collect();
    for model in tracked.models {
        let SequenceId { subject, sequence } = model.model.id.clone();
        if read.contains(&model.model.id.to_string()) {
            let reason = format!("a track of {} was read already", model.model.id);
            failures.push(Failure { subject, sequence, stage: Stage::Dataset, reason });
        } else {
            models.push(model);
        }
    }
    Ok((models, failures))
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    set_threads(args.threads)?;
    if let Some(path) = &args.output {
        args.general.check_free(path)?;
    }
    let mut options = options_of_run(&args.with)?;
    // Of a prior's file only the content is recorded.
    if let PriorKind::File(LoadedPrior { prior: None, .. }) = &options.fit.prior {
        options.fit.prior = PriorKind::default();
        eprintln!(
            "note: the run in {} had a shape prior of a file, which is not in it; pictures are fitted with --prior auto",
            args.with.display()
        );
    }
    let bench = args.general.workbench(options)?;
    let dataset = args.dataset.as_deref().map(Dataset::open).transpose()?;
    let known_files = track_files(std::slice::from_ref(&args.with))?;
    anyhow::ensure!(
        !known_files.is_empty(),
        "{} has no tracks to learn from; give results of `run`, or a folder of tracks",
        tracks_folder(&args.with).display()
    );
    let unseen = Unseen::of(&args.inputs)?;
    if let Some(output) = &args.output {
        let inputs = all("an input", &args.inputs).chain(all("a track", &unseen.tracks));
        check_apart(&[("--output", output)], &inputs.chain(all("a track of --with", &known_files)).collect::<Vec<_>>())?;
        for folder in args.inputs.iter().filter(|path| path.is_dir()) {
            check_not_over(output, folder)?;
        }
    }
    let (known, known_failures) = load_tracks(&known_files, dataset.as_ref(), &bench);
    say_unlisted(&known, dataset.as_ref());
    let (unseen, failures) = read_unseen(unseen, &bench, args.general.quiet)?;
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
    let subjects: BTreeSet<&str> = known.iter().map(|m| m.model.id.subject.as_str()).collect();
    let seen = unseen.iter().filter(|m| subjects.contains(m.model.id.subject.as_str())).count();
    if seen > 0 {
        eprintln!(
            "note: {seen} of the sequences are of people that were learned from; recognition.csv of `run` leaves people out"
        );
    }
    let row = |m: &AnalyzedModel| -> anyhow::Result<RecognizedRow> {
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
