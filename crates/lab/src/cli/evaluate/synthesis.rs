//! `grimace evaluate synthesis`.

use std::{path::PathBuf, sync::atomic::Ordering};

use grimace::internal::synthesis::{
    BOUND_STARTS, Bank, Crossover, GENERATIONS, GaOptions, OVERLAP, TOURNAMENT_SIZE, choose_targets,
};
use grimace_lab::evaluate::{
    Cell, SynthesisStudy, SynthesisTarget, Table, crossover_table, error_chart, evaluate_crossovers, evaluate_solvers,
    history_chart, solver_table, time_solvers, time_table,
};
use serde_json::json;

use super::{CommonArgs, bar};
use grimace::internal::cli::{Outcome, bank, shared::stop_flag};

/// Fitness, surface error and time of every solver.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace evaluate synthesis -o synthesis-error                                 (the bank `candide`)
  grimace evaluate synthesis face.bank --unseen unseen.bank -o synthesis-error

Repeats the experiments of Zhu and Lee: their Table 1 (every crossover, --runs times on --targets expressions that are not in the bank) \
and their regions (one, two, four), and compares all other solvers with the genetic algorithm. A solver sees only the feature points of a \
target; the surface error compares the whole surface with that of the target. Without --unseen, the targets are members held out of the bank.")]
pub struct Args {
    /// Bank file; by default the embedded bank `candide`
    bank: Option<PathBuf>,
    /// Bank file with expressions that are not in BANK, over the same mesh
    #[arg(long, value_name = "BANK", requires = "bank")]
    unseen: Option<PathBuf>,
    /// Number of targets, chosen at random with --seed
    #[arg(long, default_value_t = 20, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    targets: u16,
    /// Number of targets, from the first, to measure one, two and four regions on
    #[arg(long, default_value_t = 20, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    region_targets: u16,
    /// Number of runs per target and crossover
    #[arg(long, default_value_t = 10, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    runs: u16,
    /// Number of generations of the genetic algorithm
    #[arg(long, default_value_t = GENERATIONS, value_name = "N")]
    generations: usize,
    /// Number of individuals drawn per generation
    #[arg(long, default_value_t = TOURNAMENT_SIZE, value_name = "N")]
    tournament: usize,
    /// Width of the overlap of two regions, as a share of the width of the face
    #[arg(long, default_value_t = OVERLAP, value_name = "SHARE")]
    overlap: f64,
    /// Number of starts of the search for the upper bound of the fitness
    #[arg(long, default_value_t = BOUND_STARTS, value_name = "N")]
    bound_starts: usize,
    /// Alphas of the BLX crossover to compare, separated by commas
    #[arg(long, default_value = "0.2", value_delimiter = ',', value_name = "LIST")]
    alphas: Vec<f64>,
    #[command(flatten)]
    common: CommonArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut folder = args.common.start()?;
    let quiet = args.common.quiet;
    let (bank, unseen) = banks(args)?;
    let chosen = choose_targets(unseen.member_count(), usize::from(args.targets), args.common.seed);
    let targets = chosen
        .iter()
        .map(|&k| SynthesisTarget { name: unseen.names()[k].clone(), truth: unseen.displacements(k) })
        .filter(|t| t.truth.iter().any(|d| *d != [0.0; 3]))
        .collect();
    let ga = GaOptions {
        tournament: args.tournament,
        generations: args.generations,
        seed: args.common.seed,
        crossover: Crossover::Line,
        ..GaOptions::default()
    };
    let mut crossovers: Vec<Crossover> = args.alphas.iter().map(|&alpha| Crossover::Blx { alpha }).collect();
    crossovers.extend([Crossover::Midpoint, Crossover::Line]);
    for &crossover in &crossovers {
        GaOptions { crossover, ..ga }.check()?;
    }
    let study = SynthesisStudy {
        bank: &bank,
        targets,
        region_targets: usize::from(args.region_targets),
        runs: usize::from(args.runs),
        crossovers,
        ga,
        overlap: args.overlap,
        bound_starts: args.bound_starts,
    };
    let stop = stop_flag()?;
    let progress = bar(quiet, "searching", 0);
    let go_on = || {
        progress.inc(1);
        !stop.load(Ordering::SeqCst)
    };
    let crossovers = evaluate_crossovers(&study, &go_on)?;
    let solvers = evaluate_solvers(&study, &go_on)?;
    let times = time_solvers(&study, 5, &go_on)?;
    progress.finish_and_clear();

    folder.table("crossovers.csv", &crossover_table(&crossovers))?;
    folder.table("solvers.csv", &solver_table(&solvers))?;
    folder.table("time.csv", &time_table(&times))?;
    let mut generations = Table::new(["crossover", "generation", "best", "offspring"]);
    for row in &crossovers {
        for (generation, (best, offspring)) in row.history.iter().enumerate() {
            let numbers = [Cell::Number(*best, 4), Cell::Number(*offspring, 4)];
            generations
                .rows
                .push([Cell::text(row.crossover.name()), Cell::Count(generation)].into_iter().chain(numbers).collect());
        }
    }
    folder.table("history.csv", &generations)?;
    folder.figure("history.svg", &history_chart(&crossovers))?;
    folder.figure("surface_error.svg", &error_chart(&solvers))?;
    let (count, runs) = (study.targets.len(), study.runs);
    folder.print(
        &format!("Whole face, {count} unseen targets, {runs} runs each (Zhu and Lee, Table 1)"),
        &crossover_table(&crossovers),
    );
    folder.print("Solvers by number of regions", &solver_table(&solvers));
    folder.print("Time of one search with its surface, one thread", &time_table(&times));
    let names: Vec<&str> = study.targets.iter().map(|t| t.name.as_str()).collect();
    let options = json!({
        "ga": study.ga,
        "runs": runs,
        "overlap": args.overlap,
        "bound_starts": args.bound_starts,
        "bank": { "source": bank.info().source, "vertices": bank.vertex_count(), "members": bank.names(),
            "feature_points": bank.feature_points().iter().map(|p| p.fp.to_string()).collect::<Vec<_>>() },
        "targets": names,
    });
    let whole = solvers.iter().filter(|r| r.scheme == grimace::internal::synthesis::RegionScheme::Whole);
    let errors: serde_json::Map<_, _> = whole.map(|r| (r.solver.name().to_owned(), json!(r.mean_error()))).collect();
    folder.finish("synthesis", args.bank.as_deref(), args.common.seed, options, json!({ "mean_surface_error": errors }))?;
    Ok(Outcome::Done)
}

/// The bank, and the expressions that are not part of it.
fn banks(args: &Args) -> anyhow::Result<(Bank, Bank)> {
    let Some(path) = &args.bank else {
        return Ok(grimace::internal::synthesis::candide_study(args.common.seed)?);
    };
    let bank = bank::open(path)?;
    if let Some(path) = &args.unseen {
        let unseen = bank::open(path)?;
        let same = unseen.mesh() == bank.mesh() && unseen.feature_points() == bank.feature_points();
        anyhow::ensure!(same, "{}: its neutral mesh or feature points differ from those of the bank", path.display());
        let moves = |bank: &Bank, k: usize| bank.displacements(k).iter().any(|d| *d != [0.0; 3]);
        let is_member = |k: usize| (0..bank.member_count()).any(|m| bank.displacements(m) == unseen.displacements(k));
        if let Some(k) = (0..unseen.member_count()).find(|&k| moves(&unseen, k) && is_member(k)) {
            anyhow::bail!(
                "--unseen {}: its member `{}` is also in the bank; give expressions that are not in the bank, as `grimace bank mix \
                 --unseen` writes them",
                path.display(),
                unseen.names()[k]
            );
        }
        return Ok((bank, unseen));
    }
    let wanted = usize::from(args.targets);
    anyhow::ensure!(
        bank.member_count() > wanted,
        "{}: cannot hold out --targets {wanted} members, because the bank has {}; choose fewer, or give --unseen",
        path.display(),
        bank.member_count()
    );
    let held = choose_targets(bank.member_count(), wanted, args.common.seed);
    let rest: Vec<usize> = (0..bank.member_count()).filter(|k| !held.contains(k)).collect();
    Ok((bank.select(&rest)?, bank.select(&held)?))
}
