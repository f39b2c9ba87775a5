//! `grimace features`.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
};

use grimace::{
    features::{ActionUnit, ColumnNames, read_blendshapes, write_features},
    normalize::NormalizeOptions,
    normalize::PoseMode,
    output::{OutputError, count},
    pipeline::{PipelineOptions, Workbench, id_of, track_files},
    track::{TrackInfo, read_track, read_track_info, seconds_of},
    units::SequenceId,
};
use rayon::prelude::*;

use super::{
    Outcome,
    apart::{check_apart, maybe},
    own_folder::{OwnFolder, check_is_folder},
    shared::{GeneralArgs, about, file_name, set_threads},
};

/// Write pose, FAPs and action units for every frame of tracks.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace features results/tracks -o features
  grimace features results/tracks -o openface --names openface
  grimace features results/tracks/S005_001.csv -o compared --blendshapes mediapipe.json

Writes SUBJECT_SEQUENCE.csv for every track, with one row per frame: head pose in degrees, action units AU.._r (0 to 5) with presence _c \
and expected error _e, openings of eyes and mouth, and FAPs. A .json beside it names the units. `run` writes the same tables into \
OUT/features.")]
pub struct Args {
    /// Track files, or folders of track files
    #[arg(required = true, value_name = "TRACK")]
    tracks: Vec<PathBuf>,
    /// Output folder for the tables
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Column names; `openface` writes those that readers of OpenFace files expect
    #[arg(long, value_enum, default_value_t = Names::Grimace)]
    names: Names,
    /// Action units to write, such as AU04,AU12; by default all
    #[arg(long, value_name = "AU", value_delimiter = ',')]
    units: Vec<ActionUnit>,
    /// MediaPipe blendshapes of the same frames, added as columns mediapipe_jawOpen, ...
    ///
    /// Give MediaPipe's results as .json, or a .csv with a column frame and one column per blendshape. For several tracks give a folder with
    /// one SUBJECT_SEQUENCE.json or .csv for each.
    #[arg(long, value_name = "FILE|DIR")]
    blendshapes: Option<PathBuf>,
    /// Number of threads; 0 uses one per processor
    #[arg(short = 'j', long, default_value_t = 0)]
    threads: usize,
    #[command(flatten)]
    general: GeneralArgs,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Names {
    /// All columns, in degrees and face units
    Grimace,
    /// x_0 ..., pose_Rx in radians, AU01_r ..., as py-feat and openFaceR read them
    Openface,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    set_threads(args.threads)?;
    let normalize = NormalizeOptions { pose: PoseMode::Full, ..NormalizeOptions::default() };
    let bench = args.general.workbench(PipelineOptions { normalize, ..PipelineOptions::default() })?;
    if matches!(args.names, Names::Openface)
        && let Some(unit) = args.units.iter().find(|unit| !ColumnNames::OpenFace.has(unit.number))
    {
        anyhow::bail!("--units AU{:02}: OpenFace files have no such column; leave it out, or give --names grimace", unit.number);
    }
    check_is_folder(&args.output)?;
    let files = track_files(&args.tracks)?;
    anyhow::ensure!(
        files.len() == 1 || args.blendshapes.as_ref().is_none_or(|path| path.is_dir()),
        "--blendshapes: for {} tracks, give a folder with one SUBJECT_SEQUENCE.json or .csv for each",
        files.len()
    );
    anyhow::ensure!(!files.is_empty(), "found no track files; a track is a .csv that `grimace run` or `grimace track` wrote");
    let mut targets: BTreeMap<PathBuf, &Path> = BTreeMap::new();
    for path in &files {
        // Unreadable tracks are reported below.
        let Ok(info) = read_track_info(path) else { continue };
        let target = target_of(&id_beside(info.as_ref(), path), args);
        let same = |a: &Path, b: &Path| matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b);
        if let Some(first) = targets.insert(target.clone(), path).filter(|first| !same(first, path)) {
            anyhow::bail!(
                "{} and {} are tracks of the same name: both tables would be {}; write them into two folders",
                first.display(),
                path.display(),
                target.display()
            );
        }
    }
    let existing: Vec<&PathBuf> = targets.keys().filter(|target| !args.general.force && target.exists()).collect();
    if let [first, others @ ..] = existing.as_slice() {
        let others = match others.len() {
            0 => "exists; give --force to overwrite it".to_owned(),
            1 => "and another table exist; give --force to overwrite them".to_owned(),
            n => format!("and {n} other tables exist; give --force to overwrite them"),
        };
        anyhow::bail!("{} {others}", first.display());
    }
    let own = OwnFolder::open(&args.output, "features")?;
    let cannot_write = AtomicBool::new(false);
    let table = |path: &PathBuf| {
        // What this disk did not take is not the fault of the tracks.
        if cannot_write.load(Ordering::Relaxed) {
            return None;
        }
        let written = one(path, args, &bench, &own);
        if written.as_ref().is_err_and(is_of_writing) {
            cannot_write.store(true, Ordering::Relaxed);
        }
        Some(written)
    };
    let results: Vec<Option<anyhow::Result<bool>>> = files.par_iter().map(table).collect();
    let mut results: Vec<anyhow::Result<bool>> = results.into_iter().flatten().collect();
    if results.iter().any(Result::is_ok) {
        own.end_beside_earlier()?;
    }
    if let Some(k) = results.iter().position(|result| result.as_ref().is_err_and(is_of_writing)) {
        return results.swap_remove(k).map(|_| Outcome::Failed);
    }
    let mut failed = 0;
    for (path, result) in files.iter().zip(&results) {
        if let Err(error) = result {
            failed += 1;
            eprintln!("failed: {}", about(path)(&super::chain(error)));
        }
    }
    let timeless = results.iter().filter(|result| matches!(result, Ok(false))).count();
    if timeless > 0 && matches!(args.names, Names::Openface) {
        eprintln!(
            "note: {} {} no frame rate, so every timestamp is 0: give the column fps in the manifest of `run`, or --fps of `track`",
            count(timeless, "track", "tracks"),
            if timeless == 1 { "has" } else { "have" }
        );
    }
    if !args.general.quiet {
        println!("{} written to {}", count(files.len() - failed, "table", "tables"), args.output.display());
    }
    Ok(if failed == files.len() {
        Outcome::Failed
    } else if failed > 0 {
        Outcome::SomeFailed
    } else {
        Outcome::Done
    })
}

/// Whether an error is one of the place that is written to.
fn is_of_writing(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| cause.is::<OutputError>())
}

/// Id of a track: from the file beside it, otherwise from its name.
fn id_beside(info: Option<&TrackInfo>, path: &Path) -> SequenceId {
    info.map_or_else(|| id_of(path), |info| info.id.clone())
}

/// The table of a track.
fn target_of(id: &SequenceId, args: &Args) -> PathBuf {
    args.output.join(format!("{}.csv", id.to_string().replace(['/', '\\', '\0'], "-")))
}

/// Writes the table of a track. Returns whether the times of its frames are known.
fn one(path: &Path, args: &Args, bench: &Workbench, own: &OwnFolder) -> anyhow::Result<bool> {
    let track = read_track(path)?;
    let info = read_track_info(path)?;
    let id = id_beside(info.as_ref(), path);
    let target = target_of(&id, args);
    let blendshapes = args.blendshapes.as_deref().and_then(|path| blendshapes_of(path, &id.to_string()));
    if let Some(given) = args.blendshapes.as_ref().filter(|_| blendshapes.is_none()) {
        eprintln!("note: {}: there is no {id}.json, .jsonl or .csv; {} gets no blendshapes", given.display(), target.display());
    }
    let (units, of_track) = (target.with_extension("json"), path.with_extension("json"));
    let inputs = [("the track", path), ("the .json beside the track", of_track.as_path())];
    let inputs: Vec<_> = inputs.into_iter().chain(maybe("--blendshapes", blendshapes.as_ref())).collect();
    check_apart(&[("a table of --output", &target), ("a .json of --output", &units)], &inputs)?;
    args.general.check_free(&target)?;
    let names = [&target, &units].map(|path| file_name(path));
    own.check_own(&names)?;
    let numbers = track.iter().map(|frame| frame.number);
    let clock = info.as_ref().map(|info| info.clock_of_numbers(numbers)).unwrap_or_default();
    let marks = info.as_ref().map(TrackInfo::mark_places).unwrap_or_default();
    let fit = bench.fit_head(&track, &marks)?;
    let model = bench.frontal_model(&fit, &track)?;
    let mut features = bench.features(&track, &fit, &model, &seconds_of(&track, &clock)).map_err(anyhow::Error::msg)?;
    let wanted = |number: u8| args.units.is_empty() || args.units.iter().any(|unit| unit.number == number);
    features.iter_mut().for_each(|row| row.action_units.retain(|unit| wanted(unit.number)));
    let columns = match args.names {
        Names::Grimace => ColumnNames::Grimace,
        Names::Openface => ColumnNames::OpenFace,
    };
    let beside = blendshapes.map(|path| read_blendshapes(&path)?.beside(&features)).transpose()?;
    own.begin()?;
    write_features(&target, &features, &clock, columns, beside.as_ref())?;
    for name in &names {
        own.wrote(name)?;
    }
    Ok(clock.seconds(1).is_some())
}

/// The file of a track's blendshapes. In a folder it is the file with the name of the track; `None` if there is none.
fn blendshapes_of(path: &Path, id: &str) -> Option<PathBuf> {
    if !path.is_dir() {
        return Some(path.to_owned());
    }
    ["json", "jsonl", "csv"].iter().map(|end| path.join(format!("{id}.{end}"))).find(|path| path.exists())
}
