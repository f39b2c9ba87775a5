//! `grimace evaluate groups`.

use grimace::internal::{
    cli::{Outcome, shared::words},
    statistics::bootstrap::LEAST_PEOPLE,
};
use grimace_lab::evaluate::{GroupStudyOptions, Spread, evaluate_groups};
use serde_json::json;

use super::{CommonArgs, bar};

/// Size and power of the test between groups, and coverage of the intervals, on simulated people.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace evaluate groups -o study --people 50,50 --pairs 1000 --differences 0,10,20,30
  grimace evaluate groups -o coverage --pairs 1 --differences 0 --intervals 200 --interval-people 10,20,50 --populations smile,heavy-tails

The experiment repeatedly draws two groups of people whose smiles differ in strength, pace, symmetry and error; the second group smiles \
stronger by --differences. At a difference of 0, a test at 5 % must reject 5 % of the pairs.")]
pub struct Args {
    /// Number of people in each of the two groups
    #[arg(long, default_value = "50,50", value_delimiter = ',', num_args = 1, value_name = "A,B")]
    people: Vec<usize>,
    /// Number of pairs of groups per difference
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pairs: u32,
    /// How much stronger the second group smiles, in percent; separated by commas
    #[arg(long, default_value = "0,10,20,30", value_delimiter = ',', value_name = "PERCENT")]
    differences: Vec<f64>,
    /// Number of permutations per test
    #[arg(long, default_value_t = 999, value_parser = clap::value_parser!(u32).range(99..=1_000_000))]
    permutations: u32,
    /// Number of classes, per size and population, to test the interval of the dispersion on; 0 for none
    #[arg(long, default_value_t = 0)]
    intervals: usize,
    /// Numbers of people per class, at least 8; by default that of group A
    #[arg(long, value_delimiter = ',', value_name = "COUNT")]
    interval_people: Vec<usize>,
    /// Populations to draw the classes from, by how people differ in strength, pace and error
    #[arg(long, default_value = "smile", value_delimiter = ',', value_parser = words::<Spread>(&["smile", "heavy-tails", "mixture", "clusters"]))]
    populations: Vec<Spread>,
    /// Number of bootstrap replicates per interval
    #[arg(long, default_value_t = 500)]
    replicates: usize,
    #[command(flatten)]
    common: CommonArgs,
}

/// Number of people whose dispersion is taken as the true one.
const TRUTH: usize = 20_000;

/// Runs the study.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let &[a, b] = &args.people[..] else { anyhow::bail!("--people: expected two numbers such as 50,50") };
    anyhow::ensure!(a >= 2 && b >= 2 && a + b <= 4000, "--people: expected groups of at least 2 people, 4000 together at most");
    anyhow::ensure!(
        args.differences.iter().all(|d| d.is_finite() && (-90.0..=1000.0).contains(d)),
        "--differences: expected percentages from -90 to 1000"
    );
    let interval_people = if args.interval_people.is_empty() { vec![a] } else { args.interval_people.clone() };
    anyhow::ensure!(
        args.intervals == 0 || interval_people.iter().all(|&n| (LEAST_PEOPLE..=2000).contains(&n)),
        "--interval-people: expected {LEAST_PEOPLE} to 2000 people; smaller classes get no interval"
    );
    anyhow::ensure!(
        args.intervals == 0 || args.replicates >= 2,
        "--replicates: expected at least 2, because an interval needs them"
    );
    let mut folder = args.common.start()?;
    let options = GroupStudyOptions {
        people: [a, b],
        pairs: args.pairs as usize,
        differences: args.differences.iter().map(|d| d / 100.0).collect(),
        permutations: args.permutations as usize,
        intervals: args.intervals,
        interval_people: interval_people.clone(),
        populations: args.populations.clone(),
        replicates: args.replicates,
        truth: TRUTH,
        seed: args.common.seed,
    };
    let intervals = options.intervals * options.interval_people.len() * options.populations.len();
    let bar = bar(args.common.quiet, "testing", options.pairs * options.differences.len() + intervals);
    let study = evaluate_groups(&options, || bar.inc(1))?;
    bar.finish_and_clear();
    let table = study.table();
    folder.table("groups.csv", &table)?;
    folder.print("Rejections at 5 %, with their 95 % interval", &table);
    if !args.common.quiet {
        println!("one test of 10000 permutations of {a} and {b} people: {:.2} s", study.seconds_per_10000);
    }
    if !study.intervals.is_empty() {
        let table = study.interval_table();
        folder.table("intervals.csv", &table)?;
        folder.print(&format!("95 % intervals that hold the dispersion of {TRUTH} people, face units"), &table);
    }
    let options = json!({
        "people": args.people,
        "pairs": args.pairs,
        "differences_percent": args.differences,
        "permutations": args.permutations,
        "intervals": args.intervals,
        "interval_people": interval_people,
        "populations": args.populations,
        "replicates": args.replicates,
    });
    // No times are written, so that the same options give the same file.
    folder.finish("groups", None, args.common.seed, options, json!({ "people_of_truth": TRUTH }))?;
    Ok(Outcome::Done)
}
