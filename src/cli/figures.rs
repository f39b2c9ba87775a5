//! `grimace figures`.

use std::path::PathBuf;

use grimace::{
    output::count,
    pipeline::{PipelineOptions, figure_files, figures_of, write_figures},
};

use super::{
    Outcome,
    own_folder::{OwnFolder, check_is_folder, is_used},
    shared::GeneralArgs,
};

/// Draw the figures of a finished run as SVG and PDF, with captions.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace figures results -o figures

Writes every figure as .svg and .pdf: representatives, displacement fields on one scale, dispersion, distances, action units and FAPs over \
time, differences between people, and the groups compared with --by. captions.csv and captions.md hold the captions with the numbers of \
sequences and people, alpha and the method. The figures show wireframes only, no faces of people.")]
pub struct Args {
    /// Output folder of `run` or `analyze`
    #[arg(value_name = "OUT")]
    results: PathBuf,
    /// Output folder for the figures
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    general: GeneralArgs,
}

/// Name of the command in its record.
const COMMAND: &str = "figures";

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    check_is_folder(&args.output)?;
    let used = is_used(&args.output, COMMAND);
    anyhow::ensure!(
        args.general.force || !used,
        "{} is not empty; choose another folder, or give --force to overwrite its figures",
        args.output.display()
    );
    let bench = args.general.workbench(PipelineOptions::default())?;
    let (figures, left_out) = figures_of(&args.results, &bench)?;
    for what in left_out {
        eprintln!("note: {}: {what}", args.results.display());
    }
    let own = OwnFolder::open(&args.output, COMMAND)?;
    own.check_own(figure_files(&figures))?;
    own.begin()?;
    write_figures(&figures, &args.output, |name| own.wrote(name))?;
    own.end()?;
    if !args.general.quiet {
        println!(
            "{}, each as .svg and .pdf; captions: {}/captions.md",
            count(figures.len(), "figure", "figures"),
            args.output.display()
        );
    }
    Ok(Outcome::Done)
}
