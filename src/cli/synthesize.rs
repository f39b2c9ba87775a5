//! `grimace synthesize`.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use super::{
    Outcome,
    apart::{all, check_apart, check_folder_name, maybe},
    bank,
    distinct::{FILES, distinct},
    own_folder::{OwnFolder, check_is_folder, is_used},
    portrait,
    progress::frame_bar,
    shared::{about, named_folder, set_threads, thread_count},
    synthesize_options::{FRAME_RATES, SearchArgs, TimeArgs},
    synthesize_report::Report,
    synthesize_warnings::{note_frames_between, note_other_rate, note_turns, warn_of_answers, warn_of_not_shown},
    unfinished::Unfinished,
};
use anyhow::Context;
use clap::ValueEnum;
use grimace::{
    dataset::LandmarkSelection,
    interpolation::FPS,
    output::{count, listed, write_json},
    pipeline::{PipelineOptions, Workbench},
    synthesis::{
        Animation, Bank, EmbeddedBank, FrameAnswer, HeadTexture, Motion, Solver, SynthesisError, Synthesizer, arkit,
        compare_with_truth, read_motion, write_gltf,
    },
};

const EXAMPLE: &str = "\
Examples:
  grimace synthesize --bank head --motion results/representatives/happiness.csv -o happiness
  grimace synthesize --bank face.bank --motion results/fap/surprise.fap --regions 4 -o surprise
  grimace synthesize --bank head --motion results/representatives/*.csv --loop -o all
  grimace synthesize --bank head --motion smile.fap --portrait anna.jpg -o anna
  grimace synthesize --bank face.bank --motion points.csv --solver ga --crossover line --seed 3 --history -o points

A motion is a representative or a normalized model (frame,node,x,y), a track (frame,node,x,y,state,...), a .fap file, or a CSV file \
frame,fp,dx,dy,dz in the unit of the bank (dz empty or missing for motion in the plane). The first three are seen from the front: they are \
compared in the x-y plane and scaled by the facial animation units of the bank.

Files in OUT: animation.glb (metres; morph targets with the names of the members, one animation per motion), weights.csv, fitness.csv, \
synthesis.json, contact_sheet.png, turntable.png, turntable.gif, arkit.csv and livelink.csv if the shapes have ARKit names, and on request \
surface.npy, obj/, ply/ and history.csv.";

/// Animate a dense mesh from the motion of feature points, with a bank of expression meshes.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLE)]
pub struct Args {
    /// Bank file, or `head` or `candide` for an embedded bank
    #[arg(short, long, value_name = "BANK")]
    pub bank: PathBuf,
    /// Motions: representatives, models, tracks, .fap files, or CSV files of feature point motion
    ///
    /// With several motions, animation.glb has one animation for each, and the other files of each motion are in its own folder.
    #[arg(short, long, required = true, num_args = 1.., value_name = "FILE")]
    motion: Vec<PathBuf>,
    /// Output folder; must be new or empty, unless --force is given
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Formats to write, separated by commas
    #[arg(long, value_enum, value_delimiter = ',', default_value = "glb,pictures", value_name = "LIST")]
    format: Vec<Format>,
    /// Photograph to use as the skin of the head, a neutral face from the front
    #[arg(long, value_name = "IMAGE")]
    pub portrait: Option<PathBuf>,
    /// Marked points on the portrait, a CSV file node,x,y in pixels; by default found in it
    #[arg(long, value_name = "C.csv", requires = "portrait")]
    pub correspondences: Option<PathBuf>,
    /// True surface to compare with, in the format of --format npy
    #[arg(long, value_name = "NPY")]
    truth: Option<PathBuf>,
    /// Write every generation of the genetic algorithm to history.csv
    #[arg(long)]
    history: bool,
    #[command(flatten)]
    search: SearchArgs,
    #[command(flatten)]
    time: TimeArgs,
    /// Number of threads; 0 uses one per processor. The results do not depend on it
    #[arg(short = 'j', long, default_value_t = 0, value_parser = thread_count)]
    threads: usize,
    /// Write into a folder that is not empty, and overwrite results of an earlier `synthesize`; other files stay
    #[arg(long)]
    force: bool,
    /// Print no progress bar and no summary
    #[arg(short, long)]
    quiet: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// Animated binary glTF
    Glb,
    /// NumPy array of displacements, frames x vertices x 3
    Npy,
    /// An OBJ file for every frame
    Obj,
    /// A PLY file for every frame
    Ply,
    /// Contact sheet and turntable
    Pictures,
}

/// Largest number of synthesized frames.
const MOST_FRAMES: f64 = 360_000.0;

/// Name of the command in its record.
const COMMAND: &str = "synthesize";
/// File with the animation of all motions.
const GLB: &str = "animation.glb";
/// File that describes the results.
const ABOUT: &str = "synthesis.json";

/// Names of output files that might also be inputs.
const NAMES: [&str; 8] = [
    "surface.npy",
    "weights.csv",
    "fitness.csv",
    "history.csv",
    "arkit.csv",
    "livelink.csv",
    "contact_sheet.png",
    "turntable.png",
];

impl Args {
    /// Refuses a folder whose files would overwrite inputs.
    fn check_inputs(&self, names: &[String]) -> anyhow::Result<()> {
        let inputs: Vec<_> = all("--motion", &self.motion)
            .chain(maybe("--truth", self.truth.as_ref()))
            .chain(maybe("--portrait", self.portrait.as_ref()))
            .chain(maybe("--correspondences", self.correspondences.as_ref()))
            .collect();
        let folder_of = |name: &String| if names.len() > 1 { self.output.join(name) } else { self.output.clone() };
        names.iter().map(folder_of).try_for_each(|folder| {
            let files = NAMES.map(|name| folder.join(name));
            check_apart(&files.each_ref().map(|path| ("--output", path.as_path())), &inputs)
        })
    }
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    set_threads(args.threads)?;
    let options = args.search.options(args.time.smooth)?;
    let out = &args.output;
    check_is_folder(out)?;
    let occupied = is_used(out, COMMAND);
    let unfinished = Unfinished::in_folder(out);
    let is_unfinished = unfinished.is_there();
    let not_empty = || format!("{} is not empty; choose a new folder, or give --force to write into it", named_folder(out));
    anyhow::ensure!(args.force || !occupied || is_unfinished, not_empty());
    check_folder_name(out, "choose the files with --format: glb, npy, obj, ply, pictures")?;
    let several = args.motion.len() > 1;
    let stem = |path: &PathBuf| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let names = distinct(&args.motion.iter().map(stem).collect::<Vec<_>>(), &args.motion, FILES);
    args.check_inputs(&names)?;
    if let Some(twice) = (1..args.motion.len()).find(|&k| args.motion[..k].contains(&args.motion[k])) {
        anyhow::bail!("{}: this motion is given twice", args.motion[twice].display());
    }
    anyhow::ensure!(
        args.truth.is_none() || !several,
        "--truth belongs to one motion, but {} motions are given; give one --motion",
        args.motion.len()
    );
    anyhow::ensure!(
        args.portrait.is_none() || EmbeddedBank::of_path(&args.bank) != Some(EmbeddedBank::Candide),
        "--portrait {}: the lids of the bank `candide` are too coarse for the eyes of a photograph; give --bank head",
        args.portrait.as_deref().unwrap_or(Path::new("")).display()
    );
    let bank = bank::open(&args.bank)?;
    let synthesizer = Synthesizer::new(&bank, options)?;
    let (mut played, mut failed): (Vec<Played>, Vec<String>) = (Vec::new(), Vec::new());
    for (path, name) in args.motion.iter().zip(names) {
        match Played::new((path, name), args, &synthesizer) {
            Ok(motion) => played.push(motion),
            Err(error) if !several => return Err(error),
            Err(error) => failed.push(super::chain(&error)),
        }
    }
    anyhow::ensure!(!played.is_empty(), "no motion can be synthesized: {}", failed.join("; "));
    let texture = args.portrait.as_deref().map(|path| worn(path, args.correspondences.as_deref(), &bank)).transpose()?;
    let animations: Vec<Animation<'_>> = played.iter().map(|p| p.animation(&synthesizer, texture.as_ref())).collect();
    // A truth that cannot be compared is reported before anything is written. With a truth there is only one motion.
    let compare = |animation: &Animation<'_>| args.truth.as_ref().map(|path| compare_with_truth(animation, path)).transpose();
    let errors = animations.iter().map(compare).collect::<Result<Vec<_>, _>>()?;
    let own = OwnFolder::open(out, COMMAND)?;
    if !is_unfinished {
        own.check_own(names_of(args, several, &played, &synthesizer))?;
    }
    own.begin()?;
    // Another process may have started to write during the search.
    anyhow::ensure!(args.force || occupied || !is_used(out, COMMAND), not_empty());
    unfinished.begin()?;
    if args.format.contains(&Format::Glb) {
        let weights = |one: &Played<'_>| one.answers.iter().flat_map(|a| a.weights.iter().flatten()).any(|w| *w != 0.0);
        let moves = |one: &Played<'_>| weights(one) || one.motion.turns();
        if synthesizer.options().solver != Solver::Rbf && !played.iter().any(moves) {
            eprintln!("warning: the motion contains no movement: animation.glb holds the neutral face, without an animation");
        }
        write_gltf(&out.join(GLB), &animations)?;
        own.wrote(GLB)?;
    }
    for ((one, animation), errors) in played.iter().zip(&animations).zip(&errors) {
        let prefix = if several { format!("{}/", one.name) } else { String::new() };
        let mut results = Results { own: &own, out, prefix, files: BTreeSet::new() };
        write(args, animation, &mut results)?;
        let report = Report::new(animation, errors.as_deref());
        let about = report.json(args, one, animation, &results.files);
        results.write(ABOUT, |path| write_json(path, &about))?;
        if !args.quiet {
            if several {
                println!("{}:", one.name);
            }
            report.print(&one.motion, &bank, &if several { out.join(&one.name) } else { out.clone() });
            say_what_viewers_clamp(args, animation);
        }
    }
    own.end()?;
    unfinished.end()?;
    failed.iter().for_each(|failure| eprintln!("failed: {failure}"));
    Ok(if failed.is_empty() { Outcome::Done } else { Outcome::SomeFailed })
}

/// The files of one motion, as they are written.
struct Results<'a> {
    own: &'a OwnFolder,
    out: &'a Path,
    /// The motion's folder in `out`, `joy/`; empty where there is one motion.
    prefix: String,
    /// Names, as synthesis.json lists them.
    files: BTreeSet<String>,
}

impl Results<'_> {
    /// Writes a file and records it.
    fn write<E: Into<anyhow::Error>>(&mut self, name: &str, fill: impl FnOnce(&Path) -> Result<(), E>) -> anyhow::Result<()> {
        let path = format!("{}{name}", self.prefix);
        fill(&self.out.join(&path)).map_err(Into::into)?;
        self.own.wrote(&path)?;
        self.files.insert(name.to_owned());
        Ok(())
    }

    /// Writes a mesh for every frame and records each.
    fn write_meshes(&mut self, animation: &Animation<'_>, as_ply: bool) -> anyhow::Result<()> {
        let name = mesh_folder(as_ply);
        let folder = format!("{}{name}", self.prefix);
        animation.write_meshes(&self.out.join(&folder), as_ply, |file| self.own.wrote(&format!("{folder}/{file}")))?;
        self.files.insert(name.to_owned());
        Ok(())
    }
}

fn mesh_folder(as_ply: bool) -> &'static str {
    if as_ply { "ply" } else { "obj" }
}

/// Names of all files to be written, relative to OUT.
fn names_of(args: &Args, several: bool, played: &[Played<'_>], synthesizer: &Synthesizer<'_>) -> Vec<String> {
    let has_weights = synthesizer.options().solver != Solver::Rbf;
    let bank = synthesizer.bank();
    let shapes = bank.info().composition.as_ref().map_or(bank.names().len(), |c| c.shapes.len());
    let has_arkit = has_weights && arkit::unnamed(bank.names(), bank.info().composition.as_ref()).len() < shapes;
    let mut names = Vec::new();
    if args.format.contains(&Format::Glb) {
        names.push(GLB.to_owned());
    }
    for one in played {
        let prefix = if several { format!("{}/", one.name) } else { String::new() };
        let mut add = |name: &str| names.push(format!("{prefix}{name}"));
        for format in &args.format {
            match format {
                Format::Glb => {}
                Format::Npy => add("surface.npy"),
                Format::Obj | Format::Ply => {
                    let as_ply = *format == Format::Ply;
                    let name = |frame| format!("{}/{}", mesh_folder(as_ply), Animation::mesh_name(frame, as_ply));
                    (0..one.answers.len()).for_each(|frame| add(&name(frame)));
                }
                Format::Pictures => ["contact_sheet.png", "turntable.png", "turntable.gif"].iter().for_each(|name| add(name)),
            }
        }
        ["fitness.csv", ABOUT].iter().for_each(|name| add(name));
        if has_weights {
            add("weights.csv");
        }
        if has_arkit {
            ["arkit.csv", "livelink.csv"].iter().for_each(|name| add(name));
        }
        if args.history {
            add("history.csv");
        }
    }
    names
}

/// Puts a portrait on the skin of the bank's head.
fn worn(path: &Path, marks: Option<&Path>, bank: &Bank) -> anyhow::Result<HeadTexture> {
    let bench = Workbench::new(None, PipelineOptions::default())?;
    let target = portrait::target(path, marks, &LandmarkSelection::Auto, &bench)?;
    HeadTexture::new(bank, &target.picture, target.fitted.model.nodes(), &bench.tables)
        .with_context(|| path.display().to_string())
}

/// A motion and its animation by the bank.
pub struct Played<'a> {
    pub path: &'a Path,
    name: String,
    pub motion: Motion,
    pub noise: f64,
    fps: f64,
    answers: Vec<FrameAnswer>,
}

impl<'a> Played<'a> {
    fn new((path, name): (&'a Path, String), args: &Args, synthesizer: &Synthesizer<'_>) -> anyhow::Result<Self> {
        /// How long the last frame is held before the way back, s.
        const HOLD_S: f64 = 0.5;
        let motion = read_motion(path, synthesizer.bank(), args.time.scale).map_err(|error| {
            let to_do =
                if matches!(error, SynthesisError::Scale { .. }) { "; give --scale, the bank's units per face unit" } else { "" };
            about(path)(&format!("{error}{to_do}"))
        })?;
        warn_of_not_shown(path, &motion)?;
        note_turns(path, &motion, args.format.contains(&Format::Glb));
        note_frames_between(path, &motion);
        let noise = args.time.noise.unwrap_or_else(|| motion.default_noise());
        anyhow::ensure!((0.0..1.0).contains(&noise), "--noise {noise}: expected a share of at least 0 and less than 1");
        let between = args.time.between.map(usize::from);
        let own_fps = motion.fps.map(|fps| fps * (between.unwrap_or(0) + 1) as f64);
        let fps = args.time.fps.or(own_fps).unwrap_or(f64::from(FPS));
        note_other_rate(path, motion.kind, own_fps, fps);
        anyhow::ensure!(
            FRAME_RATES.contains(&fps),
            "{}: cannot write {fps} frames per second; choose a rate from {} to {} with --fps",
            path.display(),
            FRAME_RATES.start(),
            FRAME_RATES.end()
        );
        let frames =
            motion.frames.len() as f64 * (between.unwrap_or(0) + 1) as f64 * if args.time.there_and_back { 2.0 } else { 1.0 };
        anyhow::ensure!(
            frames <= MOST_FRAMES,
            "{}: the animation would have {frames} frames, more than {MOST_FRAMES}; give a smaller --between",
            path.display()
        );
        let mut motion = motion.as_animated(between, Some(noise))?.for_solver(synthesizer.options().solver);
        if args.time.there_and_back {
            motion = motion.there_and_back((HOLD_S * fps).round() as usize);
        }
        let bar = frame_bar(args.quiet, Some(motion.frames.len() as u64));
        let answers = synthesizer.animate(&motion.frames, || bar.inc(1));
        bar.finish_and_clear();
        warn_of_answers(path, &args.bank, synthesizer, &motion.frames, &answers);
        Ok(Self { path, name, motion, noise, fps, answers })
    }

    fn animation<'s>(&'s self, synthesizer: &'s Synthesizer<'s>, texture: Option<&'s HeadTexture>) -> Animation<'s> {
        let (motions, answers, name) = (&self.motion.frames, &self.answers, &self.name);
        Animation { synthesizer, motions, answers, name, fps: self.fps, texture }
    }
}

/// Notes that viewers show weights below 0 as 0.
fn say_what_viewers_clamp(args: &Args, animation: &Animation<'_>) {
    let below = |a: &&FrameAnswer| a.weights.iter().flatten().any(|w| *w < 0.0);
    let frames = animation.answers.iter().filter(below).count();
    if frames > 0 && args.format.contains(&Format::Glb) {
        println!("negative weights in {}: Blender and other viewers show them as 0", count(frames, "frame", "frames"));
    }
}

/// Writes the requested files, except the glTF for all motions, which is already written.
fn write(args: &Args, animation: &Animation<'_>, results: &mut Results<'_>) -> anyhow::Result<()> {
    for format in &args.format {
        match format {
            Format::Glb => {
                if results.prefix.is_empty() {
                    results.files.insert(GLB.to_owned());
                }
            }
            Format::Npy => results.write("surface.npy", |path| animation.write_npy(path))?,
            Format::Obj | Format::Ply => results.write_meshes(animation, *format == Format::Ply)?,
            Format::Pictures => {
                results.write("contact_sheet.png", |path| animation.write_contact_sheet(path))?;
                results.write("turntable.png", |path| animation.write_turntable(path))?;
                results.write("turntable.gif", |path| animation.write_turning(path))?;
            }
        }
    }
    results.write("fitness.csv", |path| animation.write_fitness(path))?;
    if animation.synthesizer.options().solver != Solver::Rbf {
        results.write("weights.csv", |path| animation.write_weights(path))?;
        let (bank, scheme) = (animation.synthesizer.bank(), animation.synthesizer.regions().scheme());
        let coefficients =
            |a: &FrameAnswer| arkit::coefficients(bank.names(), bank.info().composition.as_ref(), scheme, &a.weights);
        let frames: Option<Vec<[f64; 52]>> = animation.answers.iter().map(coefficients).collect();
        if let Some(mut frames) = frames {
            let limited = arkit::limit(&mut frames);
            results.write("arkit.csv", |path| arkit::write_arkit(path, animation.fps, &frames))?;
            results.write("livelink.csv", |path| arkit::write_live_link(path, animation.fps, &frames))?;
            if !args.quiet {
                say_what_coefficients_lack(bank, animation, &limited);
            }
        }
    }
    if args.history {
        results.write("history.csv", |path| animation.write_history(path))?;
    }
    Ok(())
}

/// Notes what the files of coefficients lack of an animation.
fn say_what_coefficients_lack(bank: &Bank, animation: &Animation<'_>, limited: &[arkit::Limited]) {
    let beyond = |one: &arkit::Limited| (one.farthest - one.farthest.clamp(0.0, 1.0)).abs();
    if let Some(arkit::Limited { coefficient, frames, farthest }) = limited.iter().max_by(|a, b| beyond(a).total_cmp(&beyond(b)))
    {
        println!(
            "{}: arkit.csv, livelink.csv: {} limited to 0 to 1; farthest beyond is {coefficient}, {farthest:.3}, in {}",
            animation.name,
            count(limited.len(), "coefficient is", "coefficients are"),
            count(*frames, "frame", "frames")
        );
    }
    let unnamed = arkit::unnamed(bank.names(), bank.info().composition.as_ref());
    if !unnamed.is_empty() {
        let list: Vec<String> = unnamed.iter().map(|&name| name.to_owned()).collect();
        println!("not in arkit.csv and livelink.csv, because they do not have ARKit names: {}", listed(&list, 10));
    }
    if animation.fps < 1.0 {
        println!("the timecodes of livelink.csv are whole seconds, because frames are more than a second apart");
    } else if animation.fps.fract() != 0.0 {
        println!("the timecodes of livelink.csv count {} frames for a second", animation.fps.round());
    }
}
