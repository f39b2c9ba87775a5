//! `grimace learn`.

use std::{collections::BTreeSet, path::PathBuf};

use anyhow::Context;
use clap::{Subcommand, ValueEnum};
use grimace::{
    locate::{
        Model, ModelOrigin,
        learn::{LearnOptions, LearnSummary, learn_locator, read_faces},
    },
    output,
    output::MADE_BY,
};

use super::{
    Outcome,
    apart::check_not_over,
    progress::frame_bar,
    shared::{LearnedFileArgs, check_free, file_name},
};

/// Train the models that ship with this program on your own data.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  grimace learn locator FACES -o locator.bin")]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Train the model that finds faces and their points, on photographs with hand-set points.
    Locator(LocatorArgs),
    /// Derive a three-dimensional head with Candide-3's nodes from a dense face model.
    Head(super::learn_head::Args),
    /// Derive the dense head that ships with the program from a symmetric face model.
    HeadMesh(super::learn_head_mesh::Args),
}

/// Train the model that finds faces and their points, on photographs with hand-set points.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace learn locator FACES -o locator.bin --credit \"Whose faces these are, and the licence\"
  grimace locate photo.jpg -o points.csv --model locator.bin

FACES is a folder with neutral/PERSON.jpg and delineation189.csv (person,x0,y0,...,x188,y188: the 189 points of the Face Research Lab London \
Set, in pixels). To learn smiles and parted lips, too, add smiling/PERSON.jpg and landmarks68.csv (person,state,x0,...,y67; states neutral and smiling).

Training varies the size, turn, light, background, clothes and hair of every photograph. It prints errors from five-fold cross-validation \
over people, in percent of the eye distance.")]
struct LocatorArgs {
    /// Folder of photographs and their points
    faces: PathBuf,
    /// Model file to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// People to exclude from training, separated by commas
    #[arg(long, value_delimiter = ',', value_name = "PERSON")]
    leave_out: Vec<String>,
    /// Number of training pictures made from each photograph and from its mirror image
    #[arg(long, default_value_t = LearnOptions::default().pictures as u16, value_parser = clap::value_parser!(u16).range(2..=200))]
    pictures: u16,
    /// Existing model to keep, except for the part named by --anew
    #[arg(long, value_name = "FILE")]
    keep: Option<PathBuf>,
    /// Part to train anew in the model of --keep
    #[arg(long, value_enum, default_value = "covered-parts", value_name = "PART", requires = "keep")]
    anew: Anew,
    /// Random seed
    #[arg(long, default_value_t = LearnOptions::default().seed)]
    seed: u64,
    /// Number of threads; 0 uses one per core
    #[arg(short, long, default_value_t = 0)]
    jobs: usize,
    #[command(flatten)]
    file: LearnedFileArgs,
}

/// Part of a model that is trained anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Anew {
    /// The detection of covered parts
    CoveredParts,
    /// The reading of smiles
    Smiles,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    match &args.what {
        What::Locator(args) => locator(args),
        What::Head(args) => super::learn_head::run(args),
        What::HeadMesh(args) => super::learn_head_mesh::run(args),
    }
}

fn locator(args: &LocatorArgs) -> anyhow::Result<Outcome> {
    check_not_over(&args.output, &args.faces)?;
    check_free(&args.output, args.file.force)?;
    let options = LearnOptions {
        seed: args.seed,
        pictures: usize::from(args.pictures),
        leave_out: args.leave_out.iter().cloned().collect::<BTreeSet<_>>(),
    };
    let kept = args.keep.as_deref().map(Model::read).transpose()?;
    let faces = read_faces(&args.faces, &options.leave_out)?.with_smiles(&args.faces)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.jobs).build()?;
    let bar = frame_bar(args.file.quiet, Some(10));
    bar.set_style(indicatif::ProgressStyle::with_template("{bar:32.cyan/blue} {msg}  {elapsed} elapsed")?);
    let learned = pool.install(|| {
        learn_locator(&faces, &options, &|part| {
            bar.inc(1);
            bar.set_message(part.to_owned());
        })
    });
    bar.finish_and_clear();
    let origin = ModelOrigin {
        made_by: MADE_BY.to_owned(),
        command: command(args),
        blake3: faces.blake3,
        people: faces.faces.len(),
        left_out: options.leave_out.into_iter().collect(),
        credit: args.file.credit.clone(),
    };
    let model = match kept {
        Some((kept, _)) => match args.anew {
            Anew::CoveredParts => Model { covers: learned.model.covers, ..kept },
            Anew::Smiles => Model { smile: learned.model.smile, ..kept },
        },
        None => learned.model,
    };
    let bytes = model.to_bytes(&origin)?;
    output::write_bytes(&args.output, &bytes).context("the model was not written")?;
    args.file.summarize(|| print_summary(&learned.summary, bytes.len()), "faces these are");
    Ok(Outcome::Done)
}

fn print_summary(summary: &LearnSummary, size: usize) {
    println!(
        "{} people, {} bytes; errors on {} pictures of held-out people, percent of the eye distance:",
        summary.people, size, summary.pictures
    );
    println!("{:<14} {:>6} {:>6} {:>6}", "points", "mean", "95 %", "worst");
    for group in &summary.groups {
        println!("{:<14} {:>6.2} {:>6.2} {:>6.2}", group.group, group.mean, group.percentile_95, group.worst);
    }
    println!("expected and true median error, by quintile of the points:");
    for [expected, real] in &summary.quintiles {
        println!("{expected:>14.2} {real:>6.2}");
    }
    println!(
        "faces proposed {:.2} %, accepted {:.2} %; false alarms accepted {:.2} %",
        100.0 * summary.proposed,
        100.0 * summary.accepted,
        100.0 * summary.false_alarms
    );
    if let Some(covers) = &summary.covers {
        let [covered, open] = covers.pictures;
        println!(
            "covered parts, on {covered} pictures of covered and {open} of uncovered faces; detections, and false detections:"
        );
        for (part, found, falsely) in &covers.parts {
            println!("{:<14} {:>6.1} % {:>6.2} %", part.name(), 100.0 * found, 100.0 * falsely);
        }
        println!("hidden points: expected mean error {:.2}, true mean error {:.2}", covers.errors[0], covers.errors[1]);
    }
    if let Some(smile) = summary.smile {
        println!(
            "smiles: read as such in {:.2} % of {} pictures, and wrongly in {:.2} % of {} neutral ones; mean error of the corners of the \
             mouth {:.2} %, before {:.2} %, of the inner lips {:.2} %, before {:.2} %",
            100.0 * smile.said.0,
            smile.pictures.0,
            100.0 * smile.said.1,
            smile.pictures.1,
            smile.corners.1,
            smile.corners.0,
            smile.inner_lips.1,
            smile.inner_lips.0
        );
    }
    if let Some(lips) = summary.lips {
        println!(
            "parted lips: detected in {:.2} % of {} pictures, and wrongly in {:.2} % of {} with closed lips; error of their edges {:.2} %, before {:.2} %",
            100.0 * lips.said.0,
            lips.pictures.0,
            100.0 * lips.said.1,
            lips.pictures.1,
            lips.errors.1,
            lips.errors.0
        );
    }
}

/// The command line without folders of this machine.
fn command(args: &LocatorArgs) -> String {
    let left_out = if args.leave_out.is_empty() { String::new() } else { format!(" --leave-out {}", args.leave_out.join(",")) };
    let kept = args.keep.as_deref().map(|path| {
        let anew = args.anew.to_possible_value().map(|v| format!(" --anew {}", v.get_name())).unwrap_or_default();
        format!(" --keep {}{anew}", file_name(path))
    });
    let kept = kept.unwrap_or_default();
    format!(
        "grimace learn locator {} -o {} --pictures {} --seed {}{left_out}{kept}",
        file_name(&args.faces),
        file_name(&args.output),
        args.pictures,
        args.seed
    )
}
