//! `grimace evaluate figures`.

use std::{fmt::Write as _, path::PathBuf, sync::atomic::Ordering};

use grimace::internal::{
    cli::{
        Outcome,
        shared::{MethodArgs, stop_flag},
    },
    clone::encode_png,
    dataset::DEFAULT_LANDMARK_NODES,
    fit::Fitter,
    output::{write_atomic, write_bytes},
    pipeline::{Event, PipelineOptions, Workbench, run as run_dataset},
    report::{Failure, failed_name},
    synthesis::candide_study,
    wireframe::{Tables, Wireframe},
};
use grimace_lab::{
    evaluate::{
        KpFigures, Plate, PlateContent, Start, TrackingOptions, ZlFigures, dataset_cases, evaluate_tracking, last_table,
        scaling_rows, scaling_table, simulated_people, standard_choices, standard_variants, tracking_chart, zl_plates,
    },
    simulate::{SimulateOptions, simulate_dataset},
};
use serde_json::json;

use super::{CommonArgs, Folder, bar};

/// Reproduce all figures and tables of both papers.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace evaluate figures -o figures                     (simulated people and the bank `candide`)
  grimace evaluate figures -o figures faces --method kp   (a dataset of yours, by the paper's method)

Krinidis and Pitas: Fig. 1a, 1b, 2, 3, 5, 6, 7, Table 1, and the claim that scaling first needs fewer marks. Zhu and Lee: Fig. 3b, 6b, 7 \
to 11, Table 1, and the regions on the same targets.

Plots are SVG, faces PNG, tables CSV; captions.md explains them. OUT/run holds the run over the dataset, OUT/sequences the simulated \
dataset. The command lists figures that the dataset does not allow, with the reason.")]
pub struct Args {
    /// Dataset with pictures and marks or landmarks; by default simulated people
    dataset: Option<PathBuf>,
    /// Number of simulated people, at least 3
    #[arg(long, default_value_t = 3, value_name = "N", conflicts_with = "dataset", value_parser = clap::value_parser!(u32).range(3..=999))]
    subjects: u32,
    /// Number of target expressions for the tables of Zhu and Lee
    #[arg(long, default_value_t = 20, value_name = "N", value_parser = clap::value_parser!(u16).range(2..))]
    targets: u16,
    /// Number of runs of the genetic algorithm per target
    #[arg(long, default_value_t = 10, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    runs: u16,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    common: CommonArgs,
}

/// Number of simulated people for the test of the claim about scaling.
const SCALED_PEOPLE: u32 = 50;

/// Numbers of marks for the test of the claim about scaling.
const SCALED_MARKS: [usize; 8] = [5, 6, 7, 8, 10, 15, 20, 30];

/// Standard deviation of the error of a mark, px.
const MARKS_NOISE_PX: f64 = 0.7;

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut folder = args.common.start()?;
    let stop = stop_flag()?;
    let seed = args.common.seed;
    let simulation = SimulateOptions { subjects: args.subjects, seed, ..SimulateOptions::default() };
    let (dataset, who) = match &args.dataset {
        Some(path) => (path.clone(), format!("dataset {}", path.file_name().unwrap_or_default().to_string_lossy())),
        None => {
            let path = args.common.output.join("sequences");
            let bar = bar(args.common.quiet, "simulating", 0);
            simulate_dataset(&simulation, &path, args.common.force, |done, total| {
                bar.set_length(total as u64);
                bar.set_position(done as u64);
            })?;
            bar.finish_and_clear();
            (path, format!("simulated people, seed {seed}"))
        }
    };
    let method = args.method.method;
    let options = PipelineOptions {
        fit: method.fit(),
        track: method.track(),
        normalize: method.normalize(),
        statistics: method.statistics(),
        ..PipelineOptions::default()
    };
    let bench = Workbench::new(None, options)?;
    let out = args.common.output.join("run");
    let progress = bar(args.common.quiet, "running", 0);
    let summary = run_dataset(&dataset, &out, &bench, None, args.common.force, &stop, |event| match event {
        Event::Started { sequences } => progress.set_length(sequences as u64),
        Event::Finished { .. } => progress.inc(1),
        _ => {}
    })?;
    progress.finish_and_clear();
    let said = |Failure { subject, sequence, stage, reason }: &Failure| {
        let name = failed_name(subject, sequence, reason);
        // For a row without an id, the name is the beginning of the reason.
        if reason.starts_with(&name) { format!("{stage}: {reason}") } else { format!("{name}: {stage}: {reason}") }
    };
    let mut missing: Vec<String> = summary.failures.iter().map(said).collect();

    let (mut plates, not_made) = KpFigures::new(&dataset, &out, &who, &bench)?.plates()?;
    missing.extend(not_made);
    match tracking_plates(&dataset, &who, args, &stop) {
        Ok(made) => plates.extend(made),
        Err(why) => missing.push(format!("KP Fig. 3: {why:#}")),
    }
    plates.push(scaling_plate(seed)?);
    let (bank, unseen) = candide_study(seed)?;
    let figures = ZlFigures { targets: usize::from(args.targets), runs: usize::from(args.runs), seed };
    let progress = bar(args.common.quiet, "searching", 0);
    plates.extend(zl_plates(&bank, &unseen, &figures, &|| {
        progress.inc(1);
        !stop.load(Ordering::SeqCst)
    })?);
    progress.finish_and_clear();
    write(&mut folder, &plates, &missing)?;
    let options = json!({
        "method": method,
        "simulation": args.dataset.is_none().then_some(&simulation),
        "targets": args.targets,
        "runs": args.runs,
    });
    let results = json!({ "plates": plates.iter().map(|p| &p.name).collect::<Vec<_>>(), "not_made": missing });
    folder.finish("figures", args.dataset.as_deref(), seed, options, results)?;
    for why in &missing {
        eprintln!("not made: {why}");
    }
    Ok(if missing.is_empty() { Outcome::Done } else { Outcome::SomeFailed })
}

/// Figure 3 of [KP], and its data.
fn tracking_plates(
    dataset: &std::path::Path,
    who: &str,
    args: &Args,
    stop: &std::sync::atomic::AtomicBool,
) -> anyhow::Result<Vec<Plate>> {
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let (cases, _) = dataset_cases(dataset, None)?;
    let method = args.method.method;
    let options = TrackingOptions {
        start: Start::Landmarks,
        variants: standard_variants(&method.track()),
        marks: DEFAULT_LANDMARK_NODES.to_vec(),
        marks_noise_px: 0.0,
        by: None,
        seed: args.common.seed,
    };
    let fitter = Fitter::new(&wireframe, method.fit());
    let progress = bar(args.common.quiet, "tracking", cases.len());
    let result = evaluate_tracking(&cases, &fitter, &wireframe, &tables, &options, || {
        progress.inc(1);
        !stop.load(Ordering::SeqCst)
    });
    progress.finish_and_clear();
    let records = result?.records;
    anyhow::ensure!(!records.errors.is_empty(), "no sequence could be compared with true positions");
    let caption = format!(
        "Mean node error, eq. (1), over the frames of {} sequences, started from the true positions: with and without the deformation, \
         each with and without the alignment with the neutral frame, and plain KLT; {who}.",
        records.sequences.len()
    );
    let chart = tracking_chart(&records, 0, "position error");
    Ok(vec![
        plate("kp_fig3", "KP, Fig. 3", &caption, PlateContent::Chart(chart)),
        plate("kp_fig3_last", "KP, Fig. 3, last frame", &caption, PlateContent::Table(last_table(&records))),
    ])
}

fn plate(name: &str, what: &str, caption: &str, content: PlateContent) -> Plate {
    Plate { name: name.to_owned(), what: what.to_owned(), caption: caption.to_owned(), content }
}

/// Tests the claim that fewer marks are needed if the wireframe is scaled first.
fn scaling_plate(seed: u64) -> anyhow::Result<Plate> {
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let simulation = SimulateOptions { subjects: SCALED_PEOPLE, seed, ..SimulateOptions::default() };
    let population = simulated_people(&simulation, &wireframe, &tables)?;
    let choices = standard_choices(&tables);
    let Some(choice) = choices.first() else { anyhow::bail!("there is no order of marks") };
    let rows = scaling_rows(&population, choice, &SCALED_MARKS, &wireframe, (MARKS_NOISE_PX, seed))?;
    let caption = format!(
        "Mean error of the fit by springs alone, percent of the eye distance, over {SCALED_PEOPLE} simulated people: the model scaled to \
         the marks first, and 1.5 times too large or too small. The paper: 5 to 8 marks with the scaling, 15 without."
    );
    Ok(plate("kp_scaling", "KP, section 2, scaling first", &caption, PlateContent::Table(scaling_table(&rows))))
}

fn write(folder: &mut Folder, plates: &[Plate], missing: &[String]) -> anyhow::Result<()> {
    let mut captions = String::from("# Figures and tables\n\nKP: Krinidis and Pitas; ZL: Zhu and Lee.\n");
    for plate in plates {
        let file = match &plate.content {
            PlateContent::Picture(picture) => {
                let file = format!("{}.png", plate.name);
                write_atomic(&folder.path.join(&file), |writer| encode_png(picture, writer))?;
                folder.files.push(file.clone());
                file
            }
            PlateContent::Chart(chart) => {
                let file = format!("{}.svg", plate.name);
                folder.figure(&file, chart)?;
                file
            }
            PlateContent::Table(table) => {
                let file = format!("{}.csv", plate.name);
                folder.table(&file, table)?;
                folder.print(&plate.what, table);
                file
            }
        };
        let shown = match &plate.content {
            PlateContent::Table(table) => table.markdown(),
            _ => format!("![{}]({file})\n", plate.what),
        };
        let _ = write!(captions, "\n## {}\n\n{shown}\n{} (`{file}`)\n", plate.what, plate.caption);
    }
    if !missing.is_empty() {
        captions.push_str("\n## Not made\n\n");
        missing.iter().for_each(|why| {
            let _ = writeln!(captions, "- {why}");
        });
    }
    write_bytes(&folder.path.join("captions.md"), captions.as_bytes())?;
    folder.files.push("captions.md".to_owned());
    Ok(())
}
