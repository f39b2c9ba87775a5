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
    /// Build a bank from meshes that share one topology.
    Build(BuildArgs),
    /// Make a bank of expressions by mixing the shapes of another bank.
    Mix(MixArgs),
    /// Convert a bank file of an older version to the current one.
    Convert(ConvertArgs),
    /// Describe a bank and optionally draw it.
    Info(InfoArgs),
}

/// Build a bank.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace bank build meshes -o face.bank                      (meshes/neutral.obj, one OBJ per expression, feature_points.csv)
  grimace bank build face.glb --feature-points fp.csv -o face.bank
  grimace bank build ict --part narrow_face --subdivide 1 -o shapes.bank

SOURCE is one of:
  a folder of OBJ or PLY files with one topology: neutral.obj and one file per expression, named after it
  a glTF or GLB file with morph targets
  a folder of NumPy arrays: neutral_vertices.npy (V x 3), triangles.npy (T x 3) or quads.npy (Q x 4), expression_deltas.npy (M x V x 3), \
and manifest.json with `expressions` (names) and optionally `units`, `regions` and `landmarks`

Feature points come from a CSV file `fp,vertex` (such as 8.3,1702; vertices count from 0). Without it they are placed with the vertices of \
the 68 iBUG landmarks. Building needs the memory of two meshes; the file takes 12 bytes per vertex and member.")]
struct BuildArgs {
    /// Folder of meshes or arrays, or a .glb or .gltf file
    source: PathBuf,
    /// Bank file to write
    #[arg(short, long, value_name = "BANK")]
    output: PathBuf,
    /// Feature points, a CSV file `fp,vertex`; by default SOURCE/feature_points.csv, or placed with the landmarks
    #[arg(long, value_name = "CSV")]
    feature_points: Option<PathBuf>,
    /// Landmarks to place feature points with, a CSV file `landmark,vertex` (landmarks 0 to 67), if SOURCE has none
    #[arg(long, value_name = "CSV", conflicts_with = "feature_points")]
    landmarks: Option<PathBuf>,
    /// Part of the surface to keep, one of the `regions` in manifest.json
    #[arg(long, value_name = "NAME")]
    part: Option<String>,
    /// Mesh to take from a .glb or .gltf file; by default the one with the most morph targets named as in ARKit
    #[arg(long, value_name = "NAME")]
    mesh: Option<String>,
    /// Rounds of smooth (Loop) subdivision
    #[arg(long, default_value_t = 0, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=MAX_SUBDIVIDE as i64))]
    subdivide: u8,
    /// Unit of length, as text such as `cm`
    #[arg(long, value_name = "TEXT")]
    unit: Option<String>,
    /// Credit and licence of the meshes, written into the bank
    #[arg(long, value_name = "TEXT")]
    credit: Option<String>,
    /// Also write the feature points used, as a CSV file `fp,vertex`
    #[arg(long, value_name = "CSV")]
    save_feature_points: Option<PathBuf>,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
}

/// Mix a bank.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace bank mix shapes.bank --weights expressions.csv -o face.bank
  grimace bank mix shapes.bank --performance 384 --members 30 --seed 1 -o face.bank --unseen unseen.bank

--weights reads a CSV file `member,shape,weight` with the names of the shapes as the bank has them. `head` is itself a mixture: this command \
mixes its 52 shapes (mouthSmile_L, jawLeft, ...), not its 30 members, which `bank info head` lists. A wrong name lists all shapes.

--performance N makes N models of a performance of anger, disgust, fear, happiness, sadness and surprise: first the six full \
expressions, then frames in which the expressions overlap and vary. It needs shapes with ARKit names, however they are written (jawOpen, \
mouthSmileLeft or mouthSmile_L, ...), or --expressions. With --members N, the six expressions and the N - 6 most different frames become the bank; the \
others go to the file of --unseen.

`head` and `candide` name the shapes of the embedded banks.")]
struct MixArgs {
    /// Bank file whose members are the shapes, or `head` or `candide` for an embedded bank
    shapes: PathBuf,
    /// Bank file to write
    #[arg(short, long, value_name = "BANK")]
    output: PathBuf,
    /// Weights of the shapes for every new member, a CSV file `member,shape,weight`
    #[arg(long, value_name = "CSV", conflicts_with = "performance", required_unless_present = "performance")]
    weights: Option<PathBuf>,
    /// Number of models to make from a performance, including the pure expressions
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=20_000))]
    performance: Option<u16>,
    /// Expressions to perform instead of the six, a CSV file `member,shape,weight`
    #[arg(long, value_name = "CSV", requires = "performance")]
    expressions: Option<PathBuf>,
    /// Number of models in the bank; by default all
    #[arg(long, value_name = "N", requires = "performance", value_parser = clap::value_parser!(u16).range(1..=20_000))]
    members: Option<u16>,
    /// Bank file for the models that --members leaves out
    #[arg(long, value_name = "BANK", requires = "members")]
    unseen: Option<PathBuf>,
    /// Also write the weights of all models, in the format of --weights
    #[arg(long, value_name = "CSV")]
    save_weights: Option<PathBuf>,
    /// Random seed of the performance
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
}

/// Convert a bank.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace bank convert old.bank -o face.bank

Bank files are safetensors: tensors `neutral` (V x 3), `triangles` (T x 3), `feature_points` (group, point, vertex) and `displacements` \
(M x V x 3), with names, unit and credit as JSON in the metadata. All commands still read files of version 1 (grimace 0.1.0), with a \
warning.")]
struct ConvertArgs {
    /// Bank file of any version
    bank: PathBuf,
    /// Bank file to write
    #[arg(short, long, value_name = "BANK")]
    output: PathBuf,
    /// Overwrite existing files
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
    /// PNG file to draw the neutral mesh, the feature points and the members into
    #[arg(long, value_name = "PNG")]
    picture: Option<PathBuf>,
    /// Write the feature points, as a CSV file `fp,vertex`
    #[arg(long, value_name = "CSV")]
    save_feature_points: Option<PathBuf>,
    /// Overwrite existing files
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

/// Opens a bank file or an embedded bank, and warns of a file of an older version.
pub fn open(path: &Path) -> anyhow::Result<Bank> {
    match EmbeddedBank::of_path(path) {
        Some(embedded) => Ok(embedded.bank()?),
        None if !path.exists() => {
            let path = path.display();
            anyhow::bail!(
                "{path}: there is no such bank: `head` and `candide` are in the program, all others are files (see `grimace bank`)"
            )
        }
        None => open_file(path),
    }
}

fn open_file(path: &Path) -> anyhow::Result<Bank> {
    let bank = Bank::open(path).map_err(|e| about(path)(&e))?;
    if bank.is_old_file() {
        let path = path.display();
        eprintln!("warning: {path}: this bank file is of version 1; `grimace bank convert {path} -o NEW.bank` converts it");
    }
    Ok(bank)
}

/// A file with the option that names it, if it is given.
type Given<'a> = (&'a str, Option<&'a PathBuf>);

/// Refuses outputs that exist, unless forced, and outputs that are each other or an input.
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
        println!("meshes not used (choose one with --mesh NAME): {}", listed(&summary.other_meshes, 10));
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
                    .context("the shapes do not have ARKit names; give the expressions to perform with --expressions")?,
            };
            let sides: Vec<f64> = shapes.names().iter().map(|n| arkit::side(n)).collect();
            let options = PerformanceOptions { models: usize::from(models.unwrap_or_default()), seed: args.seed };
            let dominant = expressions.len();
            anyhow::ensure!(
                options.models >= dominant,
                "--performance {}: give at least {dominant}, one model for each expression",
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
        "--members {members}: only {} of {} models move enough; give a smaller number",
        chosen.len(),
        recipes.len()
    );
    let bank: Vec<_> = chosen.iter().map(|&k| recipes[k].clone()).collect();
    write(&bank, &args.output)?;
    if let Some(path) = &args.unseen {
        let rest: Vec<_> = (0..recipes.len()).filter(|k| !chosen.contains(k)).map(|k| recipes[k].clone()).collect();
        anyhow::ensure!(
            !rest.is_empty(),
            "--unseen: no model is left, every one is a member of the bank; give a smaller --members"
        );
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
