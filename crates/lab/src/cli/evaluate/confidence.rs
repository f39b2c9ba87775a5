//! `grimace evaluate confidence`.

use std::{path::PathBuf, sync::atomic::Ordering};

use anyhow::Context;
use grimace::internal::{
    dataset::DEFAULT_LANDMARK_NODES,
    fit::Fitter,
    locate::learn::{TrainingFace, read_faces},
    output::write_bytes,
    track::Confidence,
    wireframe::{Tables, Wireframe},
};
use grimace_lab::{
    evaluate::{
        ConfidenceCondition, ConfidenceOptions, PhotographedPerson, QUINTILES, SampledSequence, Start, TrackerVariant,
        TrackingOptions, VariantKind, calibration, calibration_chart, calibration_rows, calibration_table, confidence_samples,
        dataset_cases, evaluate_tracking, expected_of_records, expected_of_samples, fit_confidence, hard_simulation,
        verdict_table,
    },
    simulate::SimulateOptions,
};
use serde_json::json;

use super::{CommonArgs, Folder, SimulationArgs, bar, nodes, tracking::StartWord};
use grimace::internal::cli::{
    Outcome,
    shared::{FitArgs, TrackArgs, stop_flag},
};

/// Expected errors of the tracker against true errors; also trains their model.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace evaluate confidence -o confidence
  grimace evaluate confidence -o confidence --photographs FACES --leave-out L004,L022
  grimace evaluate confidence faces -o confidence --by kind --start landmarks

Without a DATASET, simulated people are tracked, and with --photographs also warped photographs: clean, hard, and hard in a third of the frames, at full, half, quarter and \
sixth size (down to 64 px), from exact positions and from marks. Weights and calibration are trained on them, written to \
track_confidence.csv, and evaluated on held-out people: every fifth person of FACES and the simulated people of --held-out. With --photographs, clean simulated people serve for \
evaluation only. confidence_quintiles.csv and confidence.svg show expected and true median error by quintile; verdicts.csv the verdicts. \
FACES is a folder as for `grimace learn locator`.

With a DATASET, the built-in model is evaluated with the landmarks or exact positions of the dataset.")]
pub struct Args {
    /// Dataset with 68-point landmarks or exact positions, to evaluate the built-in model
    dataset: Option<PathBuf>,
    /// Start of the sequences of a DATASET: from landmarks, or from a fit to marks
    #[arg(long, value_enum, default_value_t = StartWord::Landmarks, requires = "dataset")]
    start: StartWord,
    /// Column of the manifest to group by
    #[arg(long, value_name = "COLUMN", requires = "dataset")]
    by: Option<String>,
    /// Number of simulated subjects for training
    #[arg(long, default_value_t = 8, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=500), conflicts_with = "dataset")]
    subjects: u32,
    /// Number of further simulated subjects for evaluation
    #[arg(long, default_value_t = 6, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=500), conflicts_with = "dataset")]
    held_out: u32,
    /// Folder of photographs and their points, also used for training and evaluation
    #[arg(long, value_name = "FACES", conflicts_with = "dataset")]
    photographs: Option<PathBuf>,
    /// People of FACES to exclude, separated by commas
    #[arg(long, requires = "photographs", value_delimiter = ',', value_name = "PERSON")]
    leave_out: Vec<String>,
    /// Nodes or feature points to mark, for sequences that start from a fit
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    marks: Vec<String>,
    #[command(flatten)]
    simulation: SimulationArgs,
    #[command(flatten)]
    fit: FitArgs,
    #[command(flatten)]
    track: TrackArgs,
    #[command(flatten)]
    common: CommonArgs,
}

/// Added to the seed for the test people.
const HELD_OUT_SEED: u64 = 0x5EED_0000;

/// Every how many photographed people one is a test person.
const PHOTOGRAPHED_HELD_OUT: usize = 5;
/// Number of kinds of pictures over which the other people are distributed.
const PHOTOGRAPHED_SPLIT: usize = 4;
/// How many times fewer frames a fast expression has.
const FAST: usize = 3;
/// Smallest width and height of rendered pictures, px.
const LEAST_SIDE: u32 = 64;
/// Name of pictures without noise, blur and changing light.
const CLEAN: &str = "clean";

impl Args {
    /// Rendered people and, if given, photographed ones.
    fn conditions(
        &self,
        subjects: u32,
        seed: u64,
        faces: &[&TrainingFace],
        (fitter, wireframe, tables): (&Fitter, &Wireframe, &Tables),
    ) -> anyhow::Result<Vec<ConfidenceCondition>> {
        let clean = self.simulation.options(subjects, seed);
        // Smaller pictures show other people.
        let smaller = |part: u32| SimulateOptions {
            width: clean.width / part,
            height: clean.height / part,
            seed: seed.wrapping_add(u64::from(part)),
            ..clean.clone()
        };
        let sizes = [("", 1), (", half size", 2), (", quarter size", 4), (", sixth size", 6)];
        let fits = |part: u32| part == 1 || clean.width.min(clean.height) / part >= LEAST_SIDE;
        let simulations = sizes.iter().filter(|(_, part)| fits(*part)).flat_map(|&(size, part)| {
            let clean = smaller(part);
            let fast = SimulateOptions { frames: (clean.frames / FAST).max(2), ..clean.clone() };
            [
                (format!("hard{size}"), hard_simulation(&clean)),
                (format!("{CLEAN}{size}"), clean),
                (format!("fast{size}"), hard_simulation(&fast)),
            ]
        });
        let mut out = Vec::new();
        for (k, (name, simulation)) in simulations.enumerate() {
            // Every photographed person is seen clean, hard and fast, at three sizes.
            let chosen = faces.iter().skip(k % PHOTOGRAPHED_SPLIT).step_by(PHOTOGRAPHED_SPLIT);
            let photographs = chosen
                .map(|face| Ok(PhotographedPerson::new(face, simulation.width, fitter, wireframe, tables)?))
                .collect::<anyhow::Result<Vec<_>>>()?;
            if !photographs.is_empty() {
                out.push(ConfidenceCondition {
                    name: format!("photographs, {name}"),
                    simulation: simulation.clone(),
                    photographs,
                });
            }
            out.push(ConfidenceCondition { name, simulation, photographs: Vec::new() });
        }
        Ok(out)
    }
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut folder = args.common.start()?;
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let marks = if args.marks.is_empty() { DEFAULT_LANDMARK_NODES.to_vec() } else { nodes(&args.marks, &tables, &wireframe)? };
    let fitter = Fitter::new(&wireframe, args.fit.options());
    if args.dataset.is_some() {
        return judge_dataset(args, folder, &fitter, &wireframe, &tables, marks);
    }
    let options = ConfidenceOptions { track: args.track.options(), marks, marks_noise_px: args.simulation.marks_noise };
    let seed = args.common.seed;
    let faces = match &args.photographs {
        Some(folder) => read_faces(folder, &args.leave_out.iter().cloned().collect())?.faces,
        None => Vec::new(),
    };
    let judge_faces: Vec<_> = faces.iter().step_by(PHOTOGRAPHED_HELD_OUT).collect();
    let others = faces.iter().enumerate().filter(|(k, _)| k % PHOTOGRAPHED_HELD_OUT != 0);
    let learn_faces: Vec<_> = others.map(|(_, face)| face).collect();
    let with = (&fitter, &wireframe, &tables);
    let mut learn = args.conditions(args.subjects, seed, &learn_faces, with)?;
    if !learn_faces.is_empty() {
        // No photograph is as clear as a picture rendered without noise, so such pictures are used for evaluation only.
        learn.retain(|condition| !(condition.photographs.is_empty() && condition.name.starts_with(CLEAN)));
    }
    let judge = args.conditions(args.held_out, seed.wrapping_add(HELD_OUT_SEED), &judge_faces, with)?;
    let total = learn.iter().chain(&judge).map(ConfidenceCondition::sequences).sum();
    let stop = stop_flag()?;
    let bar = bar(args.common.quiet, "tracking", total);
    let tick = || {
        bar.inc(1);
        !stop.load(Ordering::SeqCst)
    };
    let learned = confidence_samples(&learn, &fitter, &wireframe, &tables, &options, tick)?;
    let held_out = confidence_samples(&judge, &fitter, &wireframe, &tables, &options, tick)?;
    bar.finish_and_clear();
    let confidence =
        fit_confidence(&learned).context("too few samples for training; give more --subjects, --emotions or --frames")?;
    write_bytes(&folder.path.join("track_confidence.csv"), confidence.to_csv().as_bytes())?;
    folder.files.push("track_confidence.csv".to_owned());

    let mut table = calibration_table();
    let mut judged = |name: &str, of: &dyn Fn(&SampledSequence) -> bool, confidence: &Confidence| {
        let chosen = held_out.iter().filter(|s| of(s));
        table.rows.extend(calibration_rows(name, &calibration(expected_of_samples(chosen, confidence), QUINTILES)));
    };
    judged("all", &|_| true, &confidence);
    for condition in &judge {
        judged(&condition.name, &|s| s.condition == condition.name, &confidence);
    }
    judged("from exact positions", &|s| s.start == Start::Landmarks, &confidence);
    judged("from marks", &|s| s.start == Start::Marks, &confidence);
    judged("all, model as shipped", &|_| true, Confidence::shipped());
    let title = "Expected and true error of tracked nodes, held-out people";
    folder.figure("confidence.svg", &calibration_chart(title, expected_of_samples(&held_out, &confidence)))?;
    folder.table("confidence_quintiles.csv", &table)?;
    folder.print("Expected and true median error by quintile of the expected error, held-out people", &table);
    let verdicts = verdict_table(&held_out, &confidence, &wireframe, &tables);
    folder.table("verdicts.csv", &verdicts)?;
    folder.print("Verdicts, and true mean error at the last frame", &verdicts);
    let count = |sequences: &[SampledSequence]| sequences.iter().map(|s| s.samples.len()).sum::<usize>();
    let written = json!({
        "subjects": args.subjects, "held_out": args.held_out,
        "photographs": learn_faces.len(), "photographs_held_out": judge_faces.len(),
        "emotions": args.simulation.emotions, "frames": args.simulation.frames, "size": args.simulation.size,
        "marks": options.marks, "marks_noise_px": options.marks_noise_px,
        "fit": args.fit.options(), "track": options.track,
    });
    let results = json!({ "samples": count(&learned), "held_out_samples": count(&held_out) });
    folder.finish("confidence", None, seed, written, results)?;
    Ok(Outcome::Done)
}

fn judge_dataset(
    args: &Args,
    mut folder: Folder,
    fitter: &Fitter,
    wireframe: &Wireframe,
    tables: &Tables,
    marks: Vec<grimace::internal::units::NodeId>,
) -> anyhow::Result<Outcome> {
    let Some(dataset) = &args.dataset else { return Ok(Outcome::Failed) };
    let (cases, mut failures) = dataset_cases(dataset, args.by.as_deref())?;
    let variant = TrackerVariant { name: "tracker".to_owned(), kind: VariantKind::Options(args.track.options()) };
    let options = TrackingOptions {
        start: args.start.into(),
        variants: vec![variant],
        marks,
        marks_noise_px: args.simulation.marks_noise,
        by: args.by.clone(),
        seed: args.common.seed,
    };
    let stop = stop_flag()?;
    let bar = bar(args.common.quiet, "tracking", cases.len());
    let result = evaluate_tracking(&cases, fitter, wireframe, tables, &options, || {
        bar.inc(1);
        !stop.load(Ordering::SeqCst)
    })?;
    bar.finish_and_clear();
    failures.extend(result.failures.iter().cloned());
    let mut table = calibration_table();
    for (g, group) in result.records.groups.iter().enumerate() {
        let errors = expected_of_records(&result.records, 0, g);
        table.rows.extend(calibration_rows(group, &calibration(errors.clone(), QUINTILES)));
        if !errors.is_empty() {
            let name = format!("confidence_{}.svg", super::file_word(group));
            folder.figure(&name, &calibration_chart(&format!("Expected and true error of tracked nodes, {group}"), errors))?;
        }
    }
    folder.table("confidence_quintiles.csv", &table)?;
    folder.print("Expected and true median error by quintile of the expected error", &table);
    for failure in &failures {
        eprintln!("failed: {}: {}", failure.id, failure.reason);
    }
    let written = json!({
        "start": options.start, "marks": options.marks, "by": options.by, "fit": args.fit.options(), "track": args.track.options(),
    });
    let results = json!({ "sequences": cases.len() - result.failures.len(), "failed": failures.len() });
    folder.finish("confidence", Some(dataset), options.seed, written, results)?;
    Ok(match (result.failures.len() == cases.len(), failures.is_empty()) {
        (true, _) => Outcome::Failed,
        (false, false) => Outcome::SomeFailed,
        (false, true) => Outcome::Done,
    })
}
