//! `grimace learn`.

use std::{collections::BTreeSet, path::PathBuf};

use anyhow::Context;
use clap::{Subcommand, ValueEnum};
use grimace::{
    clone::moved_mouths,
    correspondence::Correspondence,
    locate::{
        Model, ModelOrigin,
        learn::{LearnOptions, LearnSummary, TrainingFace, learn_locator, read_faces},
    },
    output,
    output::MADE_BY,
    pipeline::{PipelineOptions, Workbench},
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
Set, in pixels). To learn smiles, too, add smiling/PERSON.jpg and landmarks68.csv (person,state,x0,...,y67; states neutral and smiling). Open \
mouths are learned from pictures that are made from the neutral ones.

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
    #[arg(short = 'j', long, alias = "jobs", default_value_t = 0)]
    threads: usize,
    #[command(flatten)]
    file: LearnedFileArgs,
}

/// Expected error of points set by hand, px.
const SET_BY_HAND: f64 = 0.3;

/// Part of a model that is trained anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Anew {
    /// The detection of covered parts
    CoveredParts,
    /// The reading of moved mouths
    Mouths,
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
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.threads).build()?;
    let bar = frame_bar(args.file.quiet, Some(10));
    bar.set_style(indicatif::ProgressStyle::with_template("{bar:32.cyan/blue} {msg}  {elapsed} elapsed")?);
    let begins = |part: &str| {
        bar.inc(1);
        bar.set_message(part.to_owned());
    };
    let bench = Workbench::new(None, PipelineOptions::default())?;
    let (faces, learned) = pool.install(|| {
        begins("moving mouths");
        let count = options.pictures.div_ceil(2);
        let faces = faces.with_mouths(|person, face| moved(&bench, face, count, (options.seed, person as u64)));
        let learned = learn_locator(&faces, &options, &begins);
        (faces, learned)
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
            Anew::Mouths => Model { mouth: learned.model.mouth, ..kept },
        },
        None => learned.model,
    };
    let bytes = model.to_bytes(&origin)?;
    output::write_bytes(&args.output, &bytes).context("the model was not written")?;
    args.file.summarize(|| print_summary(&learned.summary, bytes.len()), "faces these are");
    Ok(Outcome::Done)
}

/// Returns pictures of a face whose mouth has moved, with the motion of every node; none if the face cannot be warped.
fn moved(
    bench: &Workbench,
    face: &TrainingFace,
    count: usize,
    chance: (u64, u64),
) -> Vec<(image::RgbImage, Vec<nalgebra::Vector2<f64>>)> {
    let marks: Vec<Correspondence> =
        face.nodes().into_iter().map(|(node, at)| Correspondence::found(node, at, SET_BY_HAND)).collect();
    let made = bench
        .target(&face.person, face.picture().clone(), &marks)
        .and_then(|target| moved_mouths(&target, bench, count, chance))
        .unwrap_or_default();
    made.into_iter().map(|mouth| (mouth.picture, mouth.motion)).collect()
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
    if let Some(mouths) = &summary.mouth {
        println!(
            "mouths, on pictures of held-out people: counted as moved (in part, in full); mean error without and with the stage for moved mouths:"
        );
        for mouth in mouths {
            let [corners, lips, chin] = mouth.errors.map(|[before, after]| format!("{before:.2} {after:.2}"));
            println!(
                "{:<16} {:>5} {:>5.1} % {:>5.1} %   corners {corners}   lips {lips}   chin {chin}",
                mouth.kind.name(),
                mouth.pictures,
                100.0 * mouth.moved[0],
                100.0 * mouth.moved[1]
            );
        }
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
