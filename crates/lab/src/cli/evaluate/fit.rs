//! `grimace evaluate fit`.

use std::{path::PathBuf, sync::atomic::Ordering};

use grimace::internal::wireframe::{Tables, Wireframe};
use grimace_lab::{
    evaluate::{
        Cell, FitMethod, FitRow, FitStudy, MarkChoice, Population, Table, chart_of_choices, chart_of_methods, evaluate_fit,
        fit_table, is_landmark_file, people_of_dataset, people_of_landmark_file, simulated_people, standard_choices,
        suggest_marks, suggested_table,
    },
    simulate::SimulateOptions,
};
use serde_json::json;

use super::{CommonArgs, bar, file_word, nodes};
use grimace::internal::cli::{Outcome, shared::stop_flag};

/// Numbers of marks in the printed tables; the files have all numbers.
const PRINTED_COUNTS: [usize; 5] = [5, 7, 8, 11, 15];

/// Error of the fit by number and choice of marks.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace evaluate fit -o fit-error --subjects 200
  grimace evaluate fit faces -o fit-error --by kind    (also on the neutral frames of faces, by their 68-point landmarks)
  grimace evaluate fit -o fit-error --suggest          (also searches for the best marks)

Simulated people are marked with an error of --marks-noise and compared at all live nodes. Real people, from a dataset with landmarks or \
a CSV file with the columns person,x0,y0,...,x67,y67, are marked at some landmarks and compared at the others. fit_error.csv has one row for \
every combination of method (similarity alone, springs alone, each shape prior with the springs), choice of marks and number of marks.")]
pub struct Args {
    /// Dataset with 68-point landmarks, or a CSV file of people with the columns x0,y0,...,x67,y67
    dataset: Option<PathBuf>,
    /// Manifest column to group by: each value is a separate population
    #[arg(long, value_name = "COLUMN", requires = "dataset")]
    by: Option<String>,
    /// Number of simulated people
    #[arg(long, default_value_t = 200, value_name = "N")]
    subjects: u32,
    /// Standard deviation of the error of the marks on simulated people, in px
    #[arg(long, default_value_t = 0.7, value_name = "PX", value_parser = grimace::internal::cli::shared::not_negative)]
    marks_noise: f64,
    /// Numbers of marks to evaluate, separated by commas
    #[arg(long, value_delimiter = ',', value_name = "LIST", default_value = "3,4,5,6,7,8,9,10,11,12,13,14,15",
        value_parser = clap::value_parser!(u8).range(3..=104))]
    counts: Vec<u8>,
    /// Additional order of marks to compare: nodes or feature points, such as 20,53,10,8.3
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    marks: Vec<String>,
    /// Search for the best marks of these people, write suggested_marks.csv, and compare them
    #[arg(long)]
    suggest: bool,
    #[command(flatten)]
    common: CommonArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut folder = args.common.start()?;
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let (seed, quiet) = (args.common.seed, args.common.quiet);
    let simulation = SimulateOptions { subjects: args.subjects, seed, ..SimulateOptions::default() };
    let mut populations = vec![simulated_people(&simulation, &wireframe, &tables)?];
    if let Some(path) = &args.dataset {
        if is_landmark_file(path) {
            populations.push(people_of_landmark_file(path, &tables, seed)?);
        } else {
            populations.extend(people_of_dataset(path, args.by.as_deref(), &tables, seed)?);
        }
    }
    let methods = FitMethod::standard(&wireframe);
    let mut choices = standard_choices(&tables);
    if !args.marks.is_empty() {
        choices.insert(1, MarkChoice::fixed("given", nodes(&args.marks, &tables, &wireframe)?));
    }
    let stop = stop_flag()?;
    let go_on = || !stop.load(Ordering::SeqCst);
    if args.suggest
        && let Some(method) = methods.iter().find(|m| m.name == FitMethod::default_name())
    {
        let bar = bar(quiet, "searching marks", 0);
        let found = suggest_marks(&wireframe, &tables, &populations, method, |done, total| {
            bar.set_length(total as u64);
            bar.set_position(done as u64);
            go_on()
        });
        bar.finish_and_clear();
        let found = found?;
        let table = suggested_table(&found);
        folder.table("suggested_marks.csv", &table)?;
        folder.print("Suggested marks, best first", &table);
        choices[0] = MarkChoice::fixed("suggested", found.iter().map(|m| m.node).collect());
    }
    let counts: Vec<usize> = args.counts.iter().map(|&c| usize::from(c)).collect();
    let study = FitStudy { wireframe: &wireframe, populations, methods, choices, counts, marks_noise_px: args.marks_noise, seed };
    let bar = bar(quiet, "fitting", 0);
    let rows = evaluate_fit(&study, |done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
        go_on()
    });
    bar.finish_and_clear();
    let rows = rows?;

    folder.table("fit_error.csv", &fit_table(&rows))?;
    for population in &study.populations {
        let area = area(population);
        let (name, word) = (&population.name, file_word(&population.name));
        folder.figure(&format!("methods_{word}.svg"), &chart_of_methods(&rows, name, area, "suggested"))?;
        folder.figure(&format!("choices_{word}.svg"), &chart_of_choices(&rows, name, area, FitMethod::default_name()))?;
        let people = population.people.len();
        let title = format!("Mean error over {area} of {people} {name} people, % of eye distance");
        folder.print(&title, &printed(&rows, population, &study.counts));
    }
    let people: serde_json::Map<_, _> = study.populations.iter().map(|p| (p.name.clone(), p.people.len().into())).collect();
    let options = json!({
        "simulation": simulation,
        "people": people,
        "by": args.by,
        "marks_noise_px": args.marks_noise,
        "counts": study.counts,
        "choices": study.choices.iter().map(|c| &c.name).collect::<Vec<_>>(),
        "marks": args.marks,
        "methods": study.methods.iter().map(|m| &m.name).collect::<Vec<_>>(),
        "suggest": args.suggest,
    });
    folder.finish("fit", args.dataset.as_deref(), seed, options, json!({ "rows": rows.len() }))?;
    Ok(Outcome::Done)
}

/// The nodes in figures and printed tables.
fn area(population: &Population) -> &'static str {
    let area = if population.real { grimace_lab::evaluate::FitArea::Inner } else { grimace_lab::evaluate::FitArea::All };
    area.name(population)
}

/// Table with a row per method and choice, and a column per number of marks.
fn printed(rows: &[FitRow], population: &Population, counts: &[usize]) -> Table {
    let shown: Vec<usize> = PRINTED_COUNTS.into_iter().filter(|c| counts.contains(c)).collect();
    let shown = if shown.is_empty() { counts.to_vec() } else { shown };
    let heads = shown.iter().map(|c| format!("{c} marks"));
    let seven = shown.iter().copied().find(|&c| c == 7).or(shown.first().copied()).unwrap_or_default();
    let tail = [format!("median, {seven} marks"), format!("p95, {seven} marks")];
    let mut table = Table::new(["choice", "method"].map(str::to_owned).into_iter().chain(heads).chain(tail));
    let of: Vec<&FitRow> = rows.iter().filter(|r| r.population == population.name && r.area == area(population)).collect();
    let mut keys: Vec<(&str, &str)> = Vec::new();
    for row in &of {
        let key = (row.choice.as_str(), row.method.as_str());
        if !keys.contains(&key) {
            keys.push(key);
        }
    }
    for (choice, method) in keys {
        let find = |count: usize| of.iter().find(|r| r.choice == choice && r.method == method && r.marks == count);
        let mut cells = vec![Cell::text(choice), Cell::text(method)];
        cells.extend(shown.iter().map(|&c| Cell::maybe(find(c).map(|r| r.percent.mean), 2)));
        cells.push(Cell::maybe(find(seven).map(|r| r.percent.median), 2));
        cells.push(Cell::maybe(find(seven).map(|r| r.percent.p95), 2));
        table.rows.push(cells);
    }
    table
}
