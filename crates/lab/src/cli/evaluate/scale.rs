//! `grimace evaluate scale`.

use grimace_lab::evaluate::{ScaleOptions, evaluate_scale, growth_exponent, scale_table};
use serde_json::json;

use grimace::internal::cli::{
    Outcome,
    shared::{alpha, memory},
};

use super::CommonArgs;

/// Time and memory of the statistics by number of models.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace evaluate scale -o scale --models 10000,100000,1000000

The experiment writes random models to a Parquet file in OUT (9 KB per model), computes the statistics from it, with trimming up to \
--trim-up-to models and without, and removes it. It reports wall-clock time, processor time of all threads, and the peak resident memory of \
the process.")]
pub struct Args {
    /// Numbers of models, ascending, separated by commas
    #[arg(long, default_value = "10000,100000", value_delimiter = ',', value_name = "COUNT")]
    models: Vec<usize>,
    /// Largest number of models to run with trimming
    #[arg(long, default_value_t = 100_000, value_name = "COUNT")]
    trim_up_to: usize,
    /// Share of the models to trim from each displacement field
    #[arg(long, default_value_t = 0.1, value_parser = alpha)]
    alpha: f64,
    /// Memory for displacement vectors, such as 500MB or 2GB
    #[arg(long, default_value = "1GB", value_parser = memory, value_name = "SIZE")]
    memory: u64,
    #[command(flatten)]
    common: CommonArgs,
}

/// Measures.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    anyhow::ensure!(
        args.models.iter().all(|&n| (2..=100_000_000).contains(&n)),
        "--models: expected numbers from 2 to 100000000"
    );
    anyhow::ensure!(args.models.is_sorted_by(|a, b| a < b), "--models: give the numbers in ascending order, each once");
    let mut folder = args.common.start()?;
    std::fs::create_dir_all(&folder.path)?;
    let options = ScaleOptions {
        models: args.models.clone(),
        trim_up_to: args.trim_up_to,
        alpha: args.alpha,
        memory: args.memory,
        seed: args.common.seed,
    };
    let quiet = args.common.quiet;
    let rows = evaluate_scale(&options, &folder.path, |row| {
        if !quiet {
            let peak = row.peak_mb.map(|mb| format!(", peak {mb:.0} MB")).unwrap_or_default();
            let cpu = row.cpu_seconds.map(|s| format!(" ({s:.2} s of processor time)")).unwrap_or_default();
            println!("{} models, alpha {}: {:.2} s{cpu}{peak}", row.models, row.alpha, row.seconds);
        }
    })?;
    let table = scale_table(&rows);
    folder.table("scale.csv", &table)?;
    folder.print("Statistics of one emotion, read from the file", &table);
    let exponent = growth_exponent(&rows);
    if let Some(exponent) = exponent.filter(|_| !quiet) {
        println!("growth of the time without trimming: N'' to the power {exponent:.2}");
    }
    let options = json!({ "models": args.models, "trim_up_to": args.trim_up_to, "alpha": args.alpha, "memory": args.memory });
    folder.finish("scale", None, args.common.seed, options, json!({ "growth_exponent": exponent }))?;
    Ok(Outcome::Done)
}
