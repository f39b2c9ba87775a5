//! `grimace figures`.

use std::path::PathBuf;

use grimace::{
    output::count,
    pipeline::{PipelineOptions, figures_of, write_figures},
};

use super::{Outcome, shared::GeneralArgs};

/// The figures of a finished run, to publish.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace figures results -o figures

Writes every figure as .svg and as .pdf, and their captions with numbers of sequences and people, alpha and method as captions.csv and \
captions.md: representatives, displacement fields on one scale, dispersion, distances, courses of action units and of FAPs, how people \
differ, and groups that were compared with --by. Wireframes only: no figure shows anybody's face.")]
pub struct Args {
    /// Folder that `run` or `analyze` wrote
    #[arg(value_name = "OUT")]
    results: PathBuf,
    /// Folder for the figures
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    general: GeneralArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let used = args.output.read_dir().is_ok_and(|mut entries| entries.next().is_some());
    anyhow::ensure!(args.general.force || !used, "{} is not empty; --force writes over its figures", args.output.display());
    let bench = args.general.workbench(PipelineOptions::default())?;
    let figures = figures_of(&args.results, &bench)?;
    write_figures(&figures, &args.output)?;
    if !args.general.quiet {
        println!(
            "{}, each as .svg and .pdf; captions: {}/captions.md",
            count(figures.len(), "figure", "figures"),
            args.output.display()
        );
    }
    Ok(Outcome::Done)
}
