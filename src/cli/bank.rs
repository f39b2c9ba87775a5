//! `grimace bank`.

use std::path::{Path, PathBuf};

use anyhow::Context;
use grimace::output::{count, listed};
use grimace::synthesis::{
    self, Bank, BuildOptions, EmbeddedBank, MAX_SUBDIVIDE, PerformanceOptions, arkit, build_bank, choose_members, mix_bank,
    perform, read_recipes, recipe_motions, source_files, write_feature_points, write_recipes,
};
use grimace::text::single_line;

use super::{
    Outcome,
    apart::{check_apart, check_png, maybe},
    shared::{about, check_free},
};

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// Build a bank from meshes over one topology.
    Build(BuildArgs),
    /// Make expressions from a bank's shapes by weights.
    Mix(MixArgs),
    /// Write a bank file of an older version anew.
    Convert(ConvertArgs),
    /// What is in a bank, with a picture on request.
    Info(InfoArgs),
}

/// Build a bank.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace bank build meshes -o face.bank                      (meshes/neutral.obj, one OBJ per expression, feature_points.csv)
  grimace bank build face.glb --feature-points fp.csv -o face.bank
  grimace bank build ict --part narrow_face --subdivide 1 -o shapes.bank

A source is a folder of OBJ or PLY files over one topology (neutral.obj and one file per expression, named after it), a glTF or GLB \
file with morph targets, or a folder of NumPy arrays: neutral_vertices.npy (V x 3), triangles.npy (T x 3) or quads.npy (Q x 4), \
expression_deltas.npy (M x V x 3), and manifest.json with `expressions` (names), and on request `units`, `regions` and `landmarks`.

Feature points come from a CSV file `fp,vertex` (8.3,1702; vertices from 0), or are placed by the vertices of the 68 iBUG landmarks. \
Members are read one after another: memory is that of two meshes, whatever their number; the file takes 12 bytes per vertex and member.")]
struct BuildArgs {
    /// Folder of meshes or arrays, or a .glb or .gltf file
    source: PathBuf,
    /// Bank file to write
    #[arg(short, long, value_name = "BANK")]
    output: PathBuf,
    /// CSV file `fp,vertex`; without it feature_points.csv in SOURCE, or placing by landmarks
    #[arg(long, value_name = "CSV")]
    feature_points: Option<PathBuf>,
    /// CSV file `landmark,vertex` (0 to 67) to place feature points by, where the source names no landmarks
    #[arg(long, value_name = "CSV", conflicts_with = "feature_points")]
    landmarks: Option<PathBuf>,
    /// Part of the surface to keep, one of `regions` in manifest.json
    #[arg(long, value_name = "NAME")]
    part: Option<String>,
    /// Mesh of a .glb or .gltf file that has several with morph targets; by default the one with most targets of ARKit names
    #[arg(long, value_name = "NAME")]
    mesh: Option<String>,
    /// Rounds of smooth (Loop) subdivision
    #[arg(long, default_value_t = 0, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=MAX_SUBDIVIDE as i64))]
    subdivide: u8,
    /// Unit of lengths, in words
    #[arg(long, value_name = "TEXT")]
    unit: Option<String>,
    /// Whose work the meshes are, with the licence
    #[arg(long, value_name = "TEXT")]
    credit: Option<String>,
    /// Also write the feature points in use as `fp,vertex`
    #[arg(long, value_name = "CSV")]
    save_feature_points: Option<PathBuf>,
    /// Write over a file that is there
    #[arg(long)]
    force: bool,
}

/// Mix a bank.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace bank mix shapes.bank --weights expressions.csv -o face.bank
  grimace bank mix shapes.bank --performance 384 --members 30 --seed 1 -o face.bank --unseen unseen.bank

--weights is a CSV file `member,shape,weight`. --performance makes models as a face shows them that goes through anger, disgust, fear, \
happiness, sadness and surprise: the six expressions in full, then frame after frame, with expressions that overlap, blend and are \
performed differently every time. It needs shapes with ARKit names (jawOpen, mouthSmileLeft or mouthSmile_L, ...), or --expressions. \
With --members N the six and the N - 6 frames that differ most become the bank, the rest goes to --unseen. The names `head` and \
`candide` stand for the shapes of the embedded banks.")]
struct MixArgs {
    /// Bank whose members are the shapes, or `head` or `candide`
    shapes: PathBuf,
    /// Bank file to write
    #[arg(short, long, value_name = "BANK")]
    output: PathBuf,
    /// CSV file `member,shape,weight`
    #[arg(long, value_name = "CSV", conflicts_with = "performance", required_unless_present = "performance")]
    weights: Option<PathBuf>,
    /// Models of a performance, the pure expressions included
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=20_000))]
    performance: Option<u16>,
    /// CSV file `member,shape,weight` of the expressions that are performed, instead of the six by ARKit names
    #[arg(long, value_name = "CSV", requires = "performance")]
    expressions: Option<PathBuf>,
    /// Models that become the bank
    #[arg(long, value_name = "N", requires = "performance", value_parser = clap::value_parser!(u16).range(1..=20_000))]
    members: Option<u16>,
    /// Bank file for the models that do not
    #[arg(long, value_name = "BANK", requires = "members")]
    unseen: Option<PathBuf>,
    /// Also write the weights of all models, as --weights reads them
    #[arg(long, value_name = "CSV")]
    save_weights: Option<PathBuf>,
    /// Seed of the performance
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write over files that are there
    #[arg(long)]
    force: bool,
}

/// Convert a bank.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace bank convert old.bank -o face.bank

Bank files are safetensors: tensors `neutral` (V x 3), `triangles` (T x 3), `feature_points` (group, point, vertex) and `displacements` \
(M x V x 3), and names, unit and credit as JSON in the metadata. Files of version 1 (grimace 0.1.0) are read, with a warning; this \
writes what they hold in the present version.")]
struct ConvertArgs {
    /// Bank file of any version
    bank: PathBuf,
    /// Bank file to write
    #[arg(short, long, value_name = "BANK")]
    output: PathBuf,
    /// Write over a file that is there
    #[arg(long)]
    force: bool,
}

/// Describe a bank.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace bank info face.bank --picture face.png")]
struct InfoArgs {
    /// Bank file, or `head` or `candide` for an embedded bank
    bank: PathBuf,
    /// Draw neutral, feature points and members into a PNG file
    #[arg(long, value_name = "PNG")]
    picture: Option<PathBuf>,
    /// Write the feature points as `fp,vertex`
    #[arg(long, value_name = "CSV")]
    save_feature_points: Option<PathBuf>,
    /// Write over files that are there
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    match &args.action {
        Action::Build(args) => build(args),
        Action::Mix(args) => mix(args),
        Action::Convert(args) => convert(args),
        Action::Info(args) => info(args),
    }
}

/// Opens a bank file, or makes an embedded bank; warns of a file of an older version.
pub fn open(path: &Path) -> anyhow::Result<Bank> {
    match EmbeddedBank::of_path(path) {
        Some(embedded) => Ok(embedded.bank()?),
        None => open_file(path),
    }
}

fn open_file(path: &Path) -> anyhow::Result<Bank> {
    let bank = Bank::open(path).map_err(|e| about(path)(&e))?;
    if bank.is_old_file() {
        let path = path.display();
        eprintln!(
            "warning: {path}: a bank file of version 1; `grimace bank convert {path} -o NEW.bank` writes it in the present version"
        );
    }
    Ok(bank)
}

/// A file with the option that names it, where it is given.
type Given<'a> = (&'a str, Option<&'a PathBuf>);

/// Refuses outputs that are there, unless forced, and such that are each other or an input.
fn check_outputs(force: bool, outputs: &[Given<'_>], inputs: &[Given<'_>]) -> anyhow::Result<()> {
    let [written, read] =
        [outputs, inputs].map(|files| files.iter().flat_map(|&(name, path)| maybe(name, path)).collect::<Vec<_>>());
    check_apart(&written, &read)?;
    outputs.iter().filter_map(|(_, path)| *path).try_for_each(|path| check_free(path, force))
}

fn build(args: &BuildArgs) -> anyhow::Result<Outcome> {
    let files = source_files(&args.source);
    let beside = [
        ("the meshes", Some(&args.source)),
        ("--feature-points", args.feature_points.as_ref()),
        ("--landmarks", args.landmarks.as_ref()),
    ];
    let read: Vec<Given<'_>> = beside.into_iter().chain(files.iter().map(|file| ("a file of SOURCE", Some(file)))).collect();
    check_outputs(
        args.force,
        &[("--output", Some(&args.output)), ("--save-feature-points", args.save_feature_points.as_ref())],
        &read,
    )?;
    let options = BuildOptions {
        feature_points: args.feature_points.clone(),
        landmarks: args.landmarks.clone(),
        part: args.part.clone(),
        mesh: args.mesh.clone(),
        subdivide: usize::from(args.subdivide),
        unit: args.unit.clone(),
        credit: args.credit.clone(),
    };
    let summary = build_bank(&args.source, &args.output, &options).map_err(|e| about(&args.source)(&e))?;
    if let Some(path) = &args.save_feature_points {
        write_feature_points(path, &summary.feature_points)?;
    }
    println!("{} vertices, {} triangles, {}", summary.vertices, summary.triangles, count(summary.members, "member", "members"));
    if !summary.other_meshes.is_empty() {
        println!("not taken (--mesh NAME takes another): {}", listed(&summary.other_meshes, 10));
    }
    println!("{}, from {}", count(summary.feature_points.len(), "feature point", "feature points"), summary.feature_points_from);
    if !summary.missing.is_empty() {
        let missing: Vec<String> = summary.missing.iter().map(ToString::to_string).collect();
        println!("lacks {} of the 56 feature points that a bank can have: {}", missing.len(), missing.join(" "));
    }
    println!("written to {}", args.output.display());
    Ok(Outcome::Done)
}

fn mix(args: &MixArgs) -> anyhow::Result<Outcome> {
    let embedded = EmbeddedBank::of_path(&args.shapes);
    check_outputs(
        args.force,
        &[("--output", Some(&args.output)), ("--unseen", args.unseen.as_ref()), ("--save-weights", args.save_weights.as_ref())],
        &[
            ("the shapes", Some(&args.shapes).filter(|_| embedded.is_none())),
            ("--weights", args.weights.as_ref()),
            ("--expressions", args.expressions.as_ref()),
        ],
    )?;
    let shapes = match embedded {
        Some(embedded) => embedded.shapes()?,
        None => open_file(&args.shapes)?,
    };
    let (recipes, dominant) = match (&args.weights, args.performance) {
        (Some(path), _) => (read_recipes(path, shapes.names())?, 0),
        (None, models) => {
            let expressions = match &args.expressions {
                Some(path) => read_recipes(path, shapes.names())?.into_iter().map(|r| (r.name, r.weights)).collect(),
                None if embedded == Some(EmbeddedBank::Candide) => synthesis::candide_expressions()?,
                None => arkit::dominant_expressions(shapes.names())
                    .context("the shapes have no ARKit names; give the expressions to perform with --expressions")?,
            };
            let sides: Vec<f64> = shapes.names().iter().map(|n| arkit::side(n)).collect();
            let options = PerformanceOptions { models: usize::from(models.unwrap_or_default()), seed: args.seed };
            let dominant = expressions.len();
            anyhow::ensure!(
                options.models >= dominant,
                "--performance {}: at least {dominant} models are needed, one for each expression",
                options.models
            );
            (perform(&expressions, &sides, &options), dominant)
        }
    };
    let write = |recipes: &[synthesis::Recipe], path: &Path| -> anyhow::Result<()> {
        mix_bank(&shapes, recipes, path)?;
        println!(
            "{}, {} vertices, written to {}",
            count(recipes.len(), "member", "members"),
            shapes.vertex_count(),
            path.display()
        );
        Ok(())
    };
    if let Some(path) = &args.save_weights {
        write_recipes(path, shapes.names(), &recipes)?;
    }
    let Some(members) = args.members else {
        write(&recipes, &args.output)?;
        return Ok(Outcome::Done);
    };
    let chosen = choose_members(&recipe_motions(&shapes, &recipes), dominant, usize::from(members));
    anyhow::ensure!(
        chosen.len() == usize::from(members),
        "--members {members}: only {} of {} models move enough to be chosen",
        chosen.len(),
        recipes.len()
    );
    let bank: Vec<_> = chosen.iter().map(|&k| recipes[k].clone()).collect();
    write(&bank, &args.output)?;
    if let Some(path) = &args.unseen {
        let rest: Vec<_> = (0..recipes.len()).filter(|k| !chosen.contains(k)).map(|k| recipes[k].clone()).collect();
        anyhow::ensure!(!rest.is_empty(), "--unseen: every model became a member of the bank");
        write(&rest, path)?;
    }
    Ok(Outcome::Done)
}

fn convert(args: &ConvertArgs) -> anyhow::Result<Outcome> {
    check_free(&args.output, args.force)?;
    let bank = Bank::open(&args.bank).map_err(|e| about(&args.bank)(&e))?;
    bank.write(&args.output)?;
    println!(
        "{}, {} vertices, written to {}",
        count(bank.member_count(), "member", "members"),
        bank.vertex_count(),
        args.output.display()
    );
    Ok(Outcome::Done)
}

fn info(args: &InfoArgs) -> anyhow::Result<Outcome> {
    if let Some(path) = &args.picture {
        check_png("--picture", path, "")?;
    }
    let file = Some(&args.bank).filter(|path| EmbeddedBank::of_path(path).is_none());
    check_outputs(
        args.force,
        &[("--picture", args.picture.as_ref()), ("--save-feature-points", args.save_feature_points.as_ref())],
        &[("the bank", file)],
    )?;
    let bank = open(&args.bank)?;
    print_info(&bank);
    if let Some(path) = &args.picture {
        synthesis::write_bank_picture(&bank, path)?;
    }
    if let Some(path) = &args.save_feature_points {
        write_feature_points(path, bank.feature_points())?;
    }
    Ok(Outcome::Done)
}

fn print_info(bank: &Bank) {
    let info = bank.info();
    let or_unknown = |text: &str| if text.is_empty() { "not stated".to_owned() } else { single_line(text).into_owned() };
    let bytes = 12 * bank.vertex_count() * bank.member_count();
    println!("vertices        {}", bank.vertex_count());
    println!("triangles       {}", bank.mesh().triangles().len());
    println!(
        "members         {} ({:.1} MB of displacements{})",
        bank.member_count(),
        bytes as f64 / 1e6,
        if bank.is_mapped() { ", mapped, not loaded" } else { "" }
    );
    println!("feature points  {}", bank.feature_points().len());
    println!("unit            {}", or_unknown(&info.unit));
    println!("source          {}", or_unknown(&info.source));
    println!("credit          {}", or_unknown(&info.credit));
    if let Some(composition) = &info.composition {
        println!("mixed from      {} shapes", composition.shapes.len());
    }
    let points: Vec<String> = bank.feature_points().iter().map(|p| p.fp.to_string()).collect();
    println!("\nfeature points: {}", points.join(" "));
    println!("\nmembers, with their largest displacement:");
    for (member, name) in bank.names().iter().enumerate() {
        let square = |d: &[f32; 3]| d.iter().map(|c| c * c).sum::<f32>();
        let largest = bank.displacements(member).iter().map(square).fold(0.0, f32::max).sqrt();
        println!("  {:<24} {largest:.4}", single_line(name));
    }
}
