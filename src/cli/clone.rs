//! `grimace clone`.

use std::{
    cell::RefCell,
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use grimace::{
    clone::{
        CLONE_SCHEMA, CloneFiles, CloneInfo, CloneOptions, ClonedSkin, Details, Ease, FRAMES_RECORD, FaceCell, Film, Rescale,
        Sheet, SourceKind, SourceMotion, Target, Teeth, Timing, clone_expression, encode_png, write_clone,
    },
    dataset::{PUBLISH_COLUMN, may_publish},
    fap::whole_rate,
    output::{MADE_BY, count, per_second, write_bytes},
    pipeline::{PipelineOptions, Workbench, file_blake3},
    render::Labelled,
    track::read_track_info,
};
use image::RgbImage;
use indicatif::ProgressBar;

use super::{
    Outcome,
    apart::{check_apart, check_folder_name, check_outside, maybe},
    clone_again::{holds_a_batch, inputs_hash, made_before, pictures_hash, record_of},
    clone_said::{NotAsAsked, not_as_asked_said, warn_beyond_range},
    clone_skin::{SkinChoice, SourceSkin, skin_of},
    distinct::{FILES, LABELS, distinct},
    portrait,
    progress::frame_bar,
    shared::{
        FitArgs, GeneralArgs, ProfileArgs, WhichMarksArgs, about, are, emphasis, file_name, frame_rate, named_folder,
        note_if_still, positive, stop_flag, words,
    },
    source_frames::source_pictures,
};

/// Clone an expression onto a new face: animate one photograph.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace clone --source results/representatives/happiness.csv --target anna.jpg --correspondences anna.csv -o anna-happy --film gif
  grimace clone --source tracks/S005_001.csv --source-frames faces/S005/001 --wrinkles --target anna.jpg --correspondences anna.csv -o smile
  grimace clone --source results/representatives/*.csv --target anna.jpg --correspondences anna.csv -o anna --sheet

Files in OUT:
  frames/      the animation, one PNG per frame
  track/       the dynamic model of the target, for `analyze`
  clone.fap    the motion as a FAP file
  clone.gif    a film, with --film (also .apng, .mp4, .webm)
  overlay.png  the wireframe on the apex frame
  sheet.png    five frames, below those of the source with --source-frames
  clone.json   inputs and options
  frames.b3    names and hashes of the files, for the next clone into OUT

With several sources or targets, every pair gets its own folder OUT/TARGET_SOURCE. If two sources have the same name, the extension or the folder \
is added (TARGET_sadness-csv, TARGET_sadness-fap). A pair that fails does not stop the others. After an interruption, run the command again: it \
keeps the clones that have the same files and options.")]
pub struct Args {
    /// Motion to clone: a track, a representative or normalized model (.csv), or a FAP file (.fap); several for a batch
    #[arg(short, long, required = true, num_args = 1.., value_name = "S")]
    source: Vec<PathBuf>,
    /// Photograph to animate, a neutral face from the front; several for a batch
    #[arg(short, long, required = true, num_args = 1.., value_name = "IMAGE")]
    target: Vec<PathBuf>,
    /// Marked points on each photograph, in the same order; by default found in the photographs
    ///
    /// A CSV file with the columns node,x,y, or 68 landmarks as point,x,y; pixels.
    #[arg(short, long, num_args = 1.., value_name = "C.csv")]
    correspondences: Vec<PathBuf>,
    /// Output folder
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Also draw all clones into OUT/sheet.png: one row per target, with its neutral face and the apex of every source
    #[arg(long)]
    sheet: bool,
    #[command(flatten)]
    motion: MotionArgs,
    #[command(flatten)]
    look: LookArgs,
    #[command(flatten)]
    marks: WhichMarksArgs,
    #[command(flatten)]
    fit: FitArgs,
    #[command(flatten)]
    general: GeneralArgs,
}

/// How the motion is carried over.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Motion")]
struct MotionArgs {
    /// Factor on the strength of the motion: 0.5 halves it, 1.5 makes a caricature
    #[arg(long, default_value_t = 1.0, value_parser = emphasis, value_name = "C")]
    emphasis: f64,
    /// Frames per second; by default those of the source, or 25
    #[arg(long, value_parser = frame_rate)]
    fps: Option<f64>,
    /// Seconds from neutral to apex; by default those of the source, or 1 for a representative
    #[arg(long, value_parser = positive, value_name = "SECONDS")]
    duration: Option<f64>,
    /// Timing of the motion from neutral to apex
    ///
    /// By default `natural` (a quick onset, then a held apex) for a representative, and `linear` for a track or a FAP file, which have their
    /// own timing.
    #[arg(long, value_parser = words::<Ease>(&["natural", "linear", "in", "out", "in-out"]))]
    ease: Option<Ease>,
    /// Add blinks: one when the expression begins, then one every few seconds
    #[arg(long)]
    blink: bool,
    /// Return to the neutral face at the end, so that the film loops without a jump
    #[arg(long = "loop")]
    back: bool,
    /// How the motion is scaled to the target: by the FAPUs of each facial region, by the eye distance alone, or not at all
    #[arg(long, default_value = "fapu", value_parser = words::<Rescale>(&["fapu", "uniform", "none"]))]
    rescale: Rescale,
    /// Also transfer the head motion of the source (tracks only)
    ///
    /// The pictures show it in the plane. clone.fap has yaw, pitch and roll relative to the first frame, FAPs 48 to 50.
    #[arg(long)]
    head: bool,
    #[command(flatten)]
    profile: ProfileArgs,
}

/// What the frames show.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Picture")]
struct LookArgs {
    /// Frames of the source's track: a folder, a video, or pictures separated by `;`
    ///
    /// They are needed for --wrinkles, for --teeth source, and to show the source on the sheet.
    #[arg(long, value_name = "SEQUENCE")]
    source_frames: Option<PathBuf>,
    /// Transfer the folds and wrinkles of the source, with this strength; 1 if no number is given
    #[arg(long, num_args = 0..=1, default_missing_value = "1", value_parser = positive, value_name = "STRENGTH")]
    wrinkles: Option<f64>,
    /// Folds of the skin that appear with the expression
    ///
    /// `auto` takes the mean folds of the people of the class, which `run` writes beside a representative (NAME_skin.png), and `form` if
    /// there are none. `form` takes the folds that the motion makes on an average head. `none` adds no folds. NAME.csv, a representative, takes
    /// the folds beside that file for any motion.
    #[arg(long, default_value = "auto", value_name = "auto|form|none|NAME.csv")]
    skin: SkinChoice,
    /// What an open mouth shows: `drawn` teeth and tongue, those of the `source`, or a `dark` mouth
    ///
    /// `auto` draws teeth and tongue, except on the neutral frame of the source itself, where it takes those of the source. `source` needs
    /// --source-frames.
    #[arg(long, default_value = "auto", value_parser = words::<Teeth>(&["auto", "source", "drawn", "dark"]))]
    teeth: Teeth,
    /// Also write films: gif, apng, mp4, webm, separated by commas
    #[arg(long, value_delimiter = ',', value_parser = film, value_name = "FORMAT")]
    film: Vec<Film>,
}

fn film(text: &str) -> Result<Film, String> {
    match text.to_lowercase().as_str() {
        "gif" => Ok(Film::Gif),
        "apng" => Ok(Film::Apng),
        "mp4" => Ok(Film::Mp4),
        "webm" => Ok(Film::Webm),
        _ => Err("expected gif, apng, mp4 or webm".to_owned()),
    }
}

impl Args {
    /// The options of the clone of a motion.
    fn options(&self, motion: &SourceMotion) -> CloneOptions {
        CloneOptions {
            rescale: self.motion.rescale,
            emphasis: self.motion.emphasis,
            head: self.motion.head,
            wrinkles: self.look.wrinkles.unwrap_or(0.0),
            teeth: self.look.teeth,
            blink: self.motion.blink,
            timing: Timing {
                fps: self.motion.fps,
                duration: self.motion.duration,
                ease: self.motion.ease.unwrap_or_else(|| motion.ease()),
                back: self.motion.back,
            },
        }
    }
}

/// A source with its pictures.
struct Source<'a> {
    path: &'a Path,
    /// Name on the sheet and in messages, unlike those of the other sources.
    label: String,
    /// The same for the folder of a batch.
    file: String,
    motion: SourceMotion,
    pictures: Option<Arc<[RgbImage]>>,
    /// BLAKE3 of their pixels, found once for all targets.
    pictures_blake3: Option<String>,
    skin: Option<SourceSkin>,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    anyhow::ensure!(
        args.correspondences.is_empty() || args.correspondences.len() == args.target.len(),
        "{} targets but {} files of --correspondences: give one file for each target, in the same order, or none to find the marks",
        args.target.len(),
        args.correspondences.len()
    );
    anyhow::ensure!(
        args.look.source_frames.is_none() || args.source.len() == 1,
        "--source-frames belong to one track, but {} sources are given; give one --source",
        args.source.len()
    );
    anyhow::ensure!(
        args.look.wrinkles.is_none() || args.look.source_frames.is_some(),
        "--wrinkles needs the frames of the source: give --source-frames"
    );
    anyhow::ensure!(
        args.look.teeth != Teeth::Source || args.look.source_frames.is_some(),
        "--teeth source needs the frames of the source: give --source-frames"
    );
    anyhow::ensure!(
        args.look.wrinkles.is_none() || matches!(args.look.skin, SkinChoice::Auto | SkinChoice::None),
        "--wrinkles and --skin both add folds; give only one of them"
    );
    check_folder_name(&args.output, "choose films with --film: gif, apng, mp4, webm")?;
    let bench = args.general.workbench(PipelineOptions { fit: args.fit.options(), ..PipelineOptions::default() })?;
    let stop = stop_flag()?;
    let pairs = args.source.len() * args.target.len();
    let sheet_path = args.output.join("sheet.png");
    let (sources, mut failed) = read_sources(args, &bench, pairs == 1)?;
    // A second run of the batch gives the same sheet.
    if args.sheet && pairs > 1 && !holds_a_batch(&args.output) {
        args.general.check_free(&sheet_path)?;
    }
    let bar = frame_bar(args.general.quiet, None);
    let mut sheet = Sheet::new(480);
    let (mut done, mut unchanged) = (0, 0);
    let mut folders = BTreeSet::new();
    let batch = RefCell::new(NotAsAsked::default());
    for (k, target_path) in args.target.iter().enumerate() {
        let marks_path = args.correspondences.get(k).map(PathBuf::as_path);
        let job =
            Job { args, bench: &bench, target_path, marks_path, stop: &stop, bar: &bar, batch: (pairs > 1).then_some(&batch) };
        let target = match job.target() {
            Ok(target) => target,
            Err(error) if pairs == 1 => return Err(error),
            Err(error) => {
                failed.push(super::chain(&error));
                continue;
            }
        };
        let cell = FaceCell::around(target.picture.dimensions(), target.fitted.model.nodes());
        let mut row = vec![Labelled { picture: cell.of(&target.picture), label: target.name.clone() }];
        for source in &sources {
            let folder =
                if pairs == 1 { args.output.clone() } else { args.output.join(clone_folder(&target.name, source, &mut folders)) };
            match job.clone(&target, source, &folder) {
                Ok((apex, written)) => {
                    row.push(Labelled { picture: cell.of(&apex), label: source.label.clone() });
                    done += 1;
                    unchanged += usize::from(!written);
                }
                Err(error) if pairs == 1 || stop.load(Ordering::Relaxed) => return Err(error),
                Err(error) => {
                    // Its cell stays empty, so that later targets keep the columns of their sources.
                    row.push(Labelled { picture: RgbImage::new(0, 0), label: String::new() });
                    failed.push(super::chain(&error));
                }
            }
        }
        sheet.push_labelled_row(row);
    }
    bar.finish_and_clear();
    if args.sheet && pairs > 1 && done > 0 {
        let mut drawn = Vec::new();
        encode_png(&sheet.draw(), &mut drawn)?;
        if !std::fs::read(&sheet_path).is_ok_and(|there| there == drawn) {
            match args.general.check_free(&sheet_path) {
                Ok(()) => write_bytes(&sheet_path, &drawn)?,
                Err(error) => failed.push(super::chain(&error)),
            }
        }
    }
    if let Some(said) = batch.borrow().said(done - unchanged).filter(|_| !args.general.quiet) {
        eprintln!("note: {said}");
    }
    for failure in &failed {
        eprintln!("failed: {failure}");
    }
    if !args.general.quiet && pairs > 1 {
        let as_before = if unchanged > 0 { format!("; {unchanged} unchanged since the last time") } else { String::new() };
        println!("{} of {pairs} clones written to {}{as_before}", done - unchanged, args.output.display());
    }
    Ok(match (done, failed.is_empty()) {
        (_, true) => Outcome::Done,
        (0, _) => Outcome::Failed,
        _ => Outcome::SomeFailed,
    })
}

/// Folder name for one clone of a batch; a number tells targets of the same name apart.
fn clone_folder(target: &str, source: &Source, taken: &mut BTreeSet<String>) -> String {
    let name = format!("{target}_{}", source.file);
    let mut unique = name.clone();
    for number in 2.. {
        if taken.insert(unique.clone()) {
            break;
        }
        unique = format!("{name}~{number}");
    }
    unique
}

/// Reads all sources. In a batch, unreadable ones are reported and left out.
fn read_sources<'a>(args: &'a Args, bench: &Workbench, alone: bool) -> anyhow::Result<(Vec<Source<'a>>, Vec<String>)> {
    let (mut sources, mut failed) = (Vec::new(), Vec::new());
    for path in &args.source {
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("fap")) {
            warn_beyond_range(path);
        }
        let read = || -> anyhow::Result<Source> {
            let motion = SourceMotion::read(path, bench)?;
            anyhow::ensure!(
                args.motion.rescale != Rescale::None || motion.kind == SourceKind::Track,
                "{}: --rescale none needs a motion in pixels, but this one is in face units; give --rescale uniform, or a track",
                path.display()
            );
            let wants_pictures = args.look.source_frames.is_some() && !motion.frames.is_empty();
            let info = if wants_pictures { read_track_info(path)? } else { None };
            if let Some(info) = &info {
                anyhow::ensure!(
                    may_publish(&info.metadata),
                    "{}: the column `{PUBLISH_COLUMN}` of its manifest forbids showing pictures of this person; \
                     leave --source-frames out: the motion alone shows no picture",
                    path.display()
                );
            }
            let pictures =
                args.look.source_frames.as_ref().map(|folder| source_pictures(folder, &motion, info.as_ref())).transpose()?;
            let pictures: Option<Arc<[RgbImage]>> = pictures.map(Arc::from);
            let pictures_blake3 = pictures.as_deref().map(pictures_hash);
            let skin = skin_of(&args.look.skin, path, &motion, bench)?;
            Ok(Source { path, label: String::new(), file: String::new(), motion, pictures, pictures_blake3, skin })
        };
        match read().map_err(|error| about(path)(&super::chain(&error))) {
            Ok(source) => {
                if !source.motion.not_shown.is_empty() {
                    let faps = source.motion.not_shown.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
                    eprintln!(
                        "warning: {}: FAP {faps} cannot be shown on a photograph from the front (depth, tongue, ears, head, visemes, expressions) and {} ignored",
                        path.display(),
                        are(source.motion.not_shown.len())
                    );
                }
                note_if_still(path, &source.motion);
                note_whole_rate(path, args.motion.fps.or(source.motion.fps));
                if args.motion.head && source.motion.kind != SourceKind::Track {
                    eprintln!("note: {}: --head has no effect: only tracks have a motion of the head", path.display());
                } else if args.motion.head && source.motion.turns.is_empty() {
                    eprintln!("note: {}: no head fits this track: clone.fap has no FAPs 48 to 50", path.display());
                }
                sources.push(source);
            }
            Err(error) if alone => return Err(error),
            Err(error) => failed.push(super::chain(&error)),
        }
    }
    anyhow::ensure!(!sources.is_empty(), "no source could be read: {}", failed.join("; "));
    let names: Vec<String> = sources.iter().map(|source| source.motion.name.clone()).collect();
    let paths: Vec<&Path> = sources.iter().map(|source| source.path).collect();
    let named = distinct(&names, &paths, LABELS).into_iter().zip(distinct(&names, &paths, FILES));
    for (source, (label, file)) in sources.iter_mut().zip(named) {
        (source.label, source.file) = (label, file);
    }
    Ok((sources, failed))
}

/// Notes that the FAP file of a clone has another rate than its frames.
fn note_whole_rate(path: &Path, fps: Option<f64>) {
    if let Some((fps, written)) = fps.map(|fps| (fps, whole_rate(fps).written)).filter(|(fps, written)| fps != written) {
        eprintln!(
            "note: {}: FAP files need a whole frame rate: clone.fap has {}, the clone {}",
            path.display(),
            per_second(written),
            per_second(fps)
        );
    }
}

/// One target in work.
struct Job<'a> {
    args: &'a Args,
    bench: &'a Workbench,
    target_path: &'a Path,
    marks_path: Option<&'a Path>,
    stop: &'a AtomicBool,
    bar: &'a ProgressBar,
    /// FAPs not shown as requested, in a batch.
    batch: Option<&'a RefCell<NotAsAsked>>,
}

impl Job<'_> {
    fn target(&self) -> anyhow::Result<Target> {
        portrait::target(self.target_path, self.marks_path, &self.args.marks.marks, self.bench)
    }

    /// Refuses a folder whose files would overwrite inputs.
    fn check_inputs(&self, source: &Source, folder: &Path) -> anyhow::Result<()> {
        let marks = self.args.correspondences.iter().find(|path| Some(path.as_path()) == self.marks_path);
        let inputs = [("--source", source.path), ("--target", self.target_path)];
        let frames = maybe("--source-frames", self.args.look.source_frames.as_ref());
        let inputs: Vec<_> = inputs.into_iter().chain(maybe("--correspondences", marks)).chain(frames).collect();
        let files = ["clone.fap", "clone.json", "overlay.png", "sheet.png"].map(|name| folder.join(name));
        check_apart(&files.each_ref().map(|path| ("--output", path.as_path())), &inputs)?;
        ["frames", "track"].iter().try_for_each(|name| check_outside("--output", &folder.join(name), &inputs))
    }

    /// BLAKE3 of all inputs of a clone.
    fn inputs_blake3(&self, source: &Source, options: &CloneOptions) -> String {
        let Args { look, motion, marks, general, .. } = self.args;
        inputs_hash(&serde_json::json!({
            "source": [file_name(source.path), file_blake3(source.path).unwrap_or_default()],
            "target": [file_name(self.target_path), file_blake3(self.target_path).unwrap_or_default()],
            "correspondences": self.marks_path.and_then(file_blake3),
            "marks": format!("{:?}", marks.marks),
            "wireframe": general.wireframe_blake3(),
            "fit": self.bench.options.fit,
            "options": options,
            "profile": motion.profile.profile,
            "skin_choice": format!("{:?}", look.skin),
            "skin": source.skin.as_ref().map(|s| s.path.as_deref().and_then(file_blake3)),
            "source_frames": source.pictures_blake3,
            "films": format!("{:?}", look.film),
        }))
    }

    /// Returns the apex frame of the clone, and whether it was written now.
    fn clone(&self, target: &Target, source: &Source, folder: &Path) -> anyhow::Result<(RgbImage, bool)> {
        self.check_inputs(source, folder)?;
        let options = self.args.options(&source.motion);
        let inputs_blake3 = self.inputs_blake3(source, &options);
        let record = record_of(folder)?.filter(|_| !self.args.general.force);
        if let Some(apex) = record.and_then(|info| made_before(folder, &info, &target.name, &inputs_blake3)) {
            if !self.args.general.quiet && self.args.source.len() * self.args.target.len() == 1 {
                println!("{} already holds this clone, with the same files and options: nothing written", folder.display());
            }
            return Ok((apex, false));
        }
        self.args.general.check_free(&folder.join("clone.json"))?;
        // A folder of an interrupted clone has a record.
        let used = folder.read_dir().is_ok_and(|mut entries| entries.next().is_some()) && !folder.join(FRAMES_RECORD).exists();
        anyhow::ensure!(
            self.args.general.force || !used,
            "{} {}; choose a new folder, or give --force to write into it",
            named_folder(folder),
            if holds_a_batch(folder) {
                "holds the clones of several sources or targets, one folder each"
            } else {
                "is not empty and was not written by `clone`"
            }
        );
        let details = match &source.pictures {
            Some(pictures) => Some(Details::new(target, &source.motion, Arc::clone(pictures))?),
            None => None,
        };
        let skin = source.skin.as_ref().map(|s| ClonedSkin::new(target, &s.skin, &s.representative)).transpose()?;
        let mut clone = clone_expression(&source.motion, target, details.as_ref(), &options, self.bench)?;
        if let Some(skin) = &skin {
            clone = clone.with_skin(skin, &source.motion)?;
        }
        let worn = source.skin.as_ref().filter(|_| clone.has_skin());
        let info = CloneInfo {
            schema_version: CLONE_SCHEMA,
            made_by: MADE_BY,
            units: BTreeMap::from([
                ("track", "px; x right, y down, the centre of the top-left pixel is (0, 0)"),
                ("clone.fap", "FAPU/1024; angles 1e-5 rad"),
            ]),
            source: file_name(source.path),
            source_blake3: file_blake3(source.path),
            target: file_name(self.target_path),
            target_blake3: file_blake3(self.target_path),
            correspondences_blake3: self.marks_path.and_then(file_blake3),
            inputs_blake3,
            options,
            fps: clone.fps,
            frames: 0,
            apex_frame: 0,
            faps_not_shown: Vec::new(),
            frames_unfolded: 0,
            faps_limited: 0,
            faps_cut: Vec::new(),
            faps_changed: Vec::new(),
            skin: worn.map(|s| s.path.as_deref().map_or_else(|| "form".to_owned(), file_name)),
            skin_blake3: worn.and_then(|s| file_blake3(s.path.as_deref()?)),
            wrinkles_light_share: details.as_ref().filter(|_| options.wrinkles > 0.0).map(Details::light_share),
        };
        let films = self.args.look.film.as_slice();
        let force = self.args.general.force;
        let files = CloneFiles {
            folder,
            force,
            films,
            fit: &self.bench.options.fit,
            profile: self.args.motion.profile.profile,
            source_frames: source.pictures.as_deref(),
        };
        let written = write_clone(&files, &clone, &source.motion, info, self.bench, || {
            self.bar.inc(1);
            !self.stop.load(Ordering::Relaxed)
        })?;
        if !self.args.general.quiet && self.args.source.len() * self.args.target.len() == 1 {
            println!(
                "{} at {}: {} on {}, in {}",
                count(clone.frames.len(), "frame", "frames"),
                per_second(clone.fps),
                source.motion.name,
                target.name,
                folder.display()
            );
        }
        if let Some(batch) = self.batch {
            batch.borrow_mut().add(&written.faps_cut, &written.faps_changed);
        } else if let Some(said) =
            not_as_asked_said(&written.faps_cut, &written.faps_changed).filter(|_| !self.args.general.quiet)
        {
            self.bar.suspend(|| eprintln!("{} on {}: {said}", source.label, target.name));
        }
        for name in &written.kept {
            self.bar.suspend(|| {
                eprintln!(
                    "{}: this file of an earlier clone was changed by hand and is kept; it does not belong to this clone",
                    folder.join(name).display()
                );
            });
        }
        Ok((written.apex, true))
    }
}
