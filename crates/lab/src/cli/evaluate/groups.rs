//! `grimace evaluate groups`.

use grimace_lab::evaluate::{GroupStudyOptions, evaluate_groups};
use serde_json::json;

use grimace::cli::Outcome;

use super::{CommonArgs, bar};

/// Size and power of the test between groups, and coverage of the intervals, on simulated people.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace evaluate groups -o study --people 50,50 --pairs 1000 --differences 0,10,20,30

Two groups are drawn again and again from people whose smiles differ in strength, pace, symmetry and error; the second group smiles by so \
many percent stronger. At a difference of 0 a test at 5 % must reject 5 % of the pairs.")]
pub struct Args {
    /// People in each of the two groups
    #[arg(long, default_value = "50,50", value_delimiter = ',', num_args = 1, value_name = "A,B")]
    people: Vec<usize>,
    /// Pairs of groups per difference
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pairs: u32,
    /// How much stronger the second group smiles, percent
    #[arg(long, default_value = "0,10,20,30", value_delimiter = ',', value_name = "PERCENT")]
    differences: Vec<f64>,
    /// Permutations of each test
    #[arg(long, default_value_t = 999, value_parser = clap::value_parser!(u32).range(99..=1_000_000))]
    permutations: u32,
    /// Classes of as many people as group A whose bootstrap interval is tried; 0 for none
    #[arg(long, default_value_t = 0)]
    intervals: usize,
    /// Replicates of each interval
    #[arg(long, default_value_t = 500)]
    replicates: usize,
    #[command(flatten)]
    common: CommonArgs,
}

/// People whose dispersion stands for the truth.
const TRUTH: usize = 20_000;

/// Runs the study.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let &[a, b] = &args.people[..] else { anyhow::bail!("--people: two numbers such as 50,50 were expected") };
    anyhow::ensure!(a >= 2 && b >= 2 && a + b <= 4000, "--people: groups of 2 or more, together 4000 at most");
    anyhow::ensure!(
        args.differences.iter().all(|d| d.is_finite() && (-90.0..=1000.0).contains(d)),
        "--differences: percentages from -90 to 1000"
    );
    let mut folder = args.common.start()?;
    let options = GroupStudyOptions {
        people: [a, b],
        pairs: args.pairs as usize,
        differences: args.differences.iter().map(|d| d / 100.0).collect(),
        permutations: args.permutations as usize,
        intervals: args.intervals,
        replicates: args.replicates,
        truth: TRUTH,
        seed: args.common.seed,
    };
    let bar = bar(args.common.quiet, "testing", options.pairs * options.differences.len() + options.intervals);
    let study = evaluate_groups(&options, || bar.inc(1))?;
    bar.finish_and_clear();
    let table = study.table();
    folder.table("groups.csv", &table)?;
    folder.print("Rejections at 5 %, with their 95 % interval", &table);
    if !args.common.quiet {
        println!("one test of 10000 permutations of {a} and {b} people: {:.2} s", study.seconds_per_10000);
        if let (Some((covered, tried)), Some(truth)) = (study.covered, study.true_dispersion) {
            let share = 100.0 * covered as f64 / tried as f64;
            println!(
                "95 % intervals that hold the dispersion of {TRUTH} people, {truth:.3}: {covered} of {tried} ({share:.1} %)"
            );
        }
    }
    let options = json!({
        "people": args.people,
        "pairs": args.pairs,
        "differences_percent": args.differences,
        "permutations": args.permutations,
        "intervals": args.intervals,
        "replicates": args.replicates,
    });
    let covered = study.covered.map(|(covered, tried)| json!({ "covered": covered, "tried": tried }));
    // No times here: the same options give the same file.
    folder.finish(
        "groups",
        None,
        args.common.seed,
        options,
        json!({ "intervals": covered, "true_dispersion": study.true_dispersion }),
    )?;
    Ok(Outcome::Done)
}
