//! `grimace play`.

use std::path::{Path, PathBuf};

use grimace::{
    clone::{Skin, SourceKind, SourceMotion, Target},
    dataset::LandmarkSelection,
    output,
    pipeline::{PORTRAIT_NAME, PipelineOptions, Workbench, id_of, showcase_target},
    player::{PlayerFace, PlayerHead, Shown, page},
    synthesis::{Bank, EmbeddedBank, Motion, SynthesisError, read_motion},
    track::{TrackFileError, read_track_info},
    units::SequenceId,
};

use super::{
    Outcome,
    apart::{all, check_apart, check_page_name, maybe},
    bank,
    distinct::{LABELS, distinct},
    portrait,
    shared::{FitArgs, GeneralArgs, about, are, note_if_still},
    synthesize_warnings::nothing_shown,
};

/// Height of the picture of a face in the page, px.
const HEIGHT: u32 = 640;

/// Make a web page that plays motions on faces.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace play results/representatives/*.csv -o player.html
  grimace play results/representatives/anger.csv smile.fap results/tracks/S005_001.csv --portrait anna.jpg -c anna.csv -o anna.html
  grimace play results/fap/*.fap --portrait anna.jpg ben.png -o both.html
  grimace play results/representatives/*.csv --bank head -o head.html

The page is a single file that works offline and sends no data. It plays every motion on every face, also two side by side, at any \
strength and speed. It plots the FAPs over time, moves the face by single FAPs, and saves frames as PNG. The page contains the portraits: \
whoever gets the page gets the pictures.")]
pub struct Args {
    /// Motions to play: representatives, normalized models or tracks (.csv), or FAP files (.fap)
    #[arg(required_unless_present = "portrait", value_name = "MOTION")]
    motions: Vec<PathBuf>,
    /// Photographs to play on, neutral faces from the front; by default a built-in face
    #[arg(long, num_args = 1.., value_name = "PORTRAIT")]
    portrait: Vec<PathBuf>,
    /// Marked points on each portrait, in the same order; by default found in the portraits
    ///
    /// A CSV file with the columns node,x,y, or 68 landmarks as point,x,y; pixels.
    #[arg(short, long, num_args = 1.., requires = "portrait", value_name = "C.csv")]
    correspondences: Vec<PathBuf>,
    /// Dense head to play on, in addition to the portraits: a bank file, or `head` or `candide` for an embedded bank
    #[arg(short, long, value_name = "BANK")]
    bank: Option<PathBuf>,
    /// HTML page to write
    #[arg(short, long, value_name = "PLAYER.html")]
    output: PathBuf,
    #[command(flatten)]
    fit: FitArgs,
    #[command(flatten)]
    general: GeneralArgs,
}

impl Args {
    /// The motions, also those behind `--portrait`, which takes all files behind it. A table or a FAP file is no picture.
    fn motions(&self) -> Vec<&PathBuf> {
        self.motions.iter().chain(self.portrait.iter().filter(|path| is_motion(path))).collect()
    }

    /// The photographs.
    fn portraits(&self) -> Vec<&PathBuf> {
        self.portrait.iter().filter(|path| !is_motion(path)).collect()
    }
}

fn is_motion(path: &Path) -> bool {
    path.extension().is_some_and(|extension| ["csv", "fap"].iter().any(|known| extension.eq_ignore_ascii_case(known)))
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let (chosen, portraits) = (args.motions(), args.portraits());
    anyhow::ensure!(
        !chosen.is_empty(),
        "name a motion to play: a representative, model or track (.csv) or a FAP file (.fap), before --portrait and --correspondences"
    );
    anyhow::ensure!(
        args.correspondences.is_empty() || args.correspondences.len() == portraits.len(),
        "{} portraits but {} files of --correspondences: give one file for each portrait, in the same order, or none to find the marks. \
         Name the motions first: --correspondences takes all files behind it",
        portraits.len(),
        args.correspondences.len()
    );
    let inputs: Vec<_> = all("a motion", chosen.iter().copied())
        .chain(all("--portrait", portraits.iter().copied()))
        .chain(all("--correspondences", &args.correspondences))
        .chain(maybe("--bank", args.bank.as_ref()))
        .collect();
    check_apart(&[("--output", &args.output)], &inputs)?;
    check_page_name(&args.output)?;
    args.general.check_free(&args.output)?;
    let bench = args.general.workbench(PipelineOptions { fit: args.fit.options(), ..PipelineOptions::default() })?;
    let dense = args.bank.as_deref().map(bank::open).transpose()?;
    let shapes = args.bank.as_deref().and_then(EmbeddedBank::of_path).map(EmbeddedBank::shapes).transpose()?;
    let (read, failed) = read_motions(&chosen, dense.as_ref(), &bench)?;
    let paths: Vec<&Path> = read.iter().map(|one| one.path).collect();
    let motions: Vec<&SourceMotion> = read.iter().map(|one| &one.motion).collect();
    for (path, motion) in paths.iter().zip(&motions) {
        if !motion.not_shown.is_empty() {
            let faps = motion.not_shown.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
            eprintln!(
                "warning: {}: FAP {faps} cannot be shown on a photograph from the front and {} ignored",
                path.display(),
                are(motion.not_shown.len())
            );
        }
        note_if_still(path, motion);
    }
    let labels = labels(&paths, &motions)?;
    let targets = targets(args, &portraits, &bench)?;
    let faces: Vec<PlayerFace> =
        targets.iter().map(|(label, target)| PlayerFace { label: label.as_str(), target, height: HEIGHT }).collect();
    let shown = labels.iter().zip(&read).map(|(label, one)| Shown { label, motion: &one.motion, skin: &one.skin });
    let shown: Vec<Shown> = shown.collect();
    let title = title(&labels);
    let name = args.bank.as_deref().and_then(Path::file_stem).unwrap_or_default().to_string_lossy().into_owned();
    let mut heads = Vec::new();
    if let Some(dense) = &dense {
        let motions = read.iter().filter_map(|one| one.on_head.clone()).collect();
        let head = PlayerHead { label: &name, bank: dense, shapes: shapes.as_ref(), motions };
        for (path, (unshown, is_on_both_sides)) in paths.iter().zip(head.unshown()?) {
            let path = path.display();
            if let Some(unshown) = unshown {
                eprintln!("warning: {path}: on the head {name}, {}", nothing_shown(&unshown));
            } else if is_on_both_sides {
                eprintln!(
                    "note: {path}: the motion is on one side of the face, and the head {name} moves both; portraits move one, and so does \
                     `grimace synthesize --regions 2`"
                );
            }
        }
        heads.push(head);
    }
    let html = page(&title, &shown, &faces, &heads, &bench)?;
    output::write_bytes(&args.output, html.as_bytes())?;
    // Frames as in the page, including inserted ones.
    let frames = motions.iter().map(|motion| motion.even_frame_count()).collect::<Result<Vec<_>, _>>()?;
    if let Some(said) = too_large(html.len(), &labels, &frames, faces.len() + heads.len()) {
        eprintln!("note: {}: {said}", args.output.display());
    }
    if !args.general.quiet {
        let count = output::count;
        println!(
            "{} on {}: {} ({:.1} MB)",
            count(motions.len(), "motion", "motions"),
            count(faces.len() + heads.len(), "face", "faces"),
            args.output.display(),
            html.len() as f64 / 1e6
        );
    }
    failed.iter().for_each(|failure| eprintln!("failed: {failure}"));
    Ok(if failed.is_empty() { Outcome::Done } else { Outcome::SomeFailed })
}

/// A motion for the page.
struct Read<'a> {
    path: &'a Path,
    motion: SourceMotion,
    skin: Skin,
    /// The motion of the dense head's feature points, if there is a head.
    on_head: Option<Motion>,
}

/// Reads all motions. One of several that cannot be played is left out and reported.
fn read_motions<'a>(
    chosen: &[&'a PathBuf],
    dense: Option<&Bank>,
    bench: &Workbench,
) -> anyhow::Result<(Vec<Read<'a>>, Vec<String>)> {
    let read = |path: &'a PathBuf| -> anyhow::Result<Read<'a>> {
        let motion = SourceMotion::read(path, bench).map_err(|error| about(path)(&super::chain(&error.into())))?;
        let on_head = dense.map(|dense| read_motion(path, dense, None)).transpose();
        let on_head = on_head.map_err(|error| about(path)(&format!("{error}{}", to_do(&error))))?;
        let skin = Skin::going_with(path, &motion)?.0;
        Ok(Read { path, motion, skin, on_head })
    };
    let (mut motions, mut failed) = (Vec::new(), Vec::new());
    for &path in chosen {
        match read(path) {
            Ok(motion) => motions.push(motion),
            Err(error) if chosen.len() == 1 => return Err(error),
            Err(error) => failed.push(super::chain(&error)),
        }
    }
    anyhow::ensure!(!motions.is_empty(), "no motion can be played: {}", failed.join("; "));
    Ok((motions, failed))
}

/// Title of a page.
fn title(labels: &[String]) -> String {
    match labels {
        [] => String::new(),
        [only] => only.clone(),
        [first, second] => format!("{first} and {second}"),
        [first, others @ ..] => format!("{first} and {} more", others.len()),
    }
}

/// Advice if a bank cannot show a motion.
fn to_do(error: &SynthesisError) -> &'static str {
    match error {
        SynthesisError::Scale { .. } => "; give another --bank that has them, or none",
        _ => "",
    }
}

/// Size above which a page opens slowly, bytes.
const LARGE_BYTES: usize = 10_000_000;

/// Size of one frame of a motion, bytes: offsets of 113 nodes and a few FAPs.
const FRAME_BYTES: usize = 650;

/// Warning about a large page, with the cause: its faces, the longest motion, or the number of motions.
fn too_large(bytes: usize, labels: &[String], frames: &[usize], faces: usize) -> Option<String> {
    let (longest, most) = labels.iter().zip(frames).max_by_key(|(_, frames)| **frames)?;
    let all: usize = frames.iter().sum();
    let to_do = if 2 * FRAME_BYTES * all < bytes {
        format!("most of its size comes from {}: use fewer, or make several pages", output::count(faces, "face", "faces"))
    } else if 2 * most >= all {
        format!(
            "{longest} has {most} of its {all} frames: lower the frame rate of a FAP file (`grimace fap convert --fps 12`), or use a part of \
             the motion"
        )
    } else {
        format!("it has {all} frames of {} motions: use fewer motions, or make several pages", frames.len())
    };
    (bytes > LARGE_BYTES).then(|| format!("the page has {:.0} MB and opens slowly; {to_do}", bytes as f64 / 1e6))
}

/// Labels of the motions: tracks by subject and emotion, all others and duplicates by their files, told apart by [`distinct`].
fn labels(paths: &[&Path], motions: &[&SourceMotion]) -> Result<Vec<String>, TrackFileError> {
    let ids = paths.iter().zip(motions).map(|(path, motion)| shown_of(path, motion)).collect::<Result<Vec<_>, _>>()?;
    let is_alone = |id: &&SequenceId| ids.iter().flatten().filter(|other| other == id).count() == 1;
    let name = |(id, motion): (&Option<SequenceId>, &&SourceMotion)| match id.as_ref().filter(is_alone) {
        Some(SequenceId { subject, sequence }) => format!("{subject} {sequence}"),
        // The name of a track's file has both, too.
        None if motion.kind == SourceKind::Track => motion.name.replace('_', " "),
        None => motion.name.clone(),
    };
    Ok(distinct(&ids.iter().zip(motions).map(name).collect::<Vec<_>>(), paths, LABELS))
}

/// Subject and emotion of a track, if the file beside it has more than its name.
fn shown_of(path: &Path, motion: &SourceMotion) -> Result<Option<SequenceId>, TrackFileError> {
    let info = if motion.kind == SourceKind::Track { read_track_info(path)? } else { None };
    Ok(info.map(|info| info.id).filter(|id| *id != id_of(path)))
}

/// The faces and their labels.
fn targets(args: &Args, portraits: &[&PathBuf], bench: &Workbench) -> anyhow::Result<Vec<(String, Target)>> {
    if portraits.is_empty() && args.bank.is_some() {
        return Ok(Vec::new());
    }
    if portraits.is_empty() {
        return Ok(vec![(PORTRAIT_NAME.to_owned(), showcase_target(bench)?)]);
    }
    let portrait = |(k, path): (usize, &&PathBuf)| -> anyhow::Result<(String, Target)> {
        let marks = args.correspondences.get(k).map(PathBuf::as_path);
        let target = portrait::target(path, marks, &LandmarkSelection::Auto, bench)?;
        Ok((target.name.clone(), target))
    };
    let mut targets: Vec<(String, Target)> = portraits.iter().enumerate().map(portrait).collect::<Result<_, _>>()?;
    // Pictures with the same name get numbers.
    for k in 0..targets.len() {
        let name = targets[k].0.clone();
        let free = (2..).map(|n| format!("{name} ({n})")).find(|l| targets[..k].iter().all(|(known, _)| known != l));
        if targets[..k].iter().any(|(known, _)| *known == name) {
            targets[k].0 = free.unwrap_or(name);
        }
    }
    Ok(targets)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_that_is_slow_to_open_says_what_makes_it_large() {
        let labels = ["long", "short", "joy"].map(str::to_owned);
        assert_eq!(too_large(10_000_000, &labels, &[20_000, 5, 5], 1), None);
        let said = too_large(15_700_000, &labels, &[20_000, 5, 5], 1).unwrap();
        assert!(said.starts_with("the page has 16 MB and opens slowly; long has 20000 of its 20010 frames:"), "{said}");
        let said = too_large(30_000_000, &labels, &[10_000, 10_000, 10_000], 1).unwrap();
        assert!(said.ends_with("it has 30000 frames of 3 motions: use fewer motions, or make several pages"), "{said}");
        let said = too_large(12_000_000, &labels, &[5, 5, 5], 12).unwrap();
        assert!(said.ends_with("most of its size comes from 12 faces: use fewer, or make several pages"), "{said}");
    }

    #[test]
    fn a_title_names_motions_without_an_order() {
        let labels = ["joy", "fear_2", "S001 007"].map(str::to_owned);
        let titles = [1, 2, 3].map(|count| title(&labels[..count]));
        assert_eq!(titles, ["joy", "joy and fear_2", "joy and 2 more"]);
    }
}
