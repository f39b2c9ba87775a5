//! `grimace segment`.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::{
        Mutex,
        atomic::{AtomicBool, Ordering},
    },
};

use anyhow::Context;
use grimace::{
    dataset::{check_file_name, list_recording},
    output::{check_writable, claim_folder, count, listed},
    pipeline::{
        EarlierSegments, GivenForAll, KeptRows, ManifestColumns, PipelineOptions, Recording, RecordingError, RecordingFiles,
        RecordingOutputs, RecordingStep, SegmentRow, UNLABELLED, Workbench, keep_edited, reuse_recording, segment_recording,
        segments_folder, write_recording, write_recording_film, write_segments,
    },
    segment::SegmentOptions,
    sequence::check_video,
};
use indicatif::ProgressBar;

use super::{
    Outcome,
    apart::{all, check_apart, check_films_name, lies_in, maybe},
    progress::counted_bar,
    shared::{
        FitArgs, GeneralArgs, MethodArgs, TrackArgs, about, frame_rate, marks_or_found, positive, quoted, set_threads, stop_flag,
        thread_count,
    },
};

/// Find expressions in recordings and propose sequences from neutral to apex.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace segment interview.mp4 -o segments.csv --subject P01 --emotion happiness --overlay interview-film.mp4
  grimace run segments.csv -o results

SEGMENTS.csv is a manifest for `run`, `annotate` and `locate`, with one row per expression: subject, sequence (STEM-01, STEM-02, ... with the \
name of the recording), emotion, frames, first_frame (neutral), last_frame (apex; it may come before the neutral frame), correspondences, fps, \
and the confidence of the proposal, 0 to 1. A folder of the same name holds the marks and a picture of every proposal, and for every recording a table with \
phase, pose and action units of each frame. `segment` does not recognize emotions: correct the labels in the table.

With --force you can run it again: recordings that did not change are kept, also your edits of rows for the same frames; deleted rows stay \
deleted. If you added rows or changed frames, the old table is kept beside the new one. See docs/recordings.md.

Exit status: 0 done, 1 no proposals for any recording, 3 no proposals for some recordings.")]
pub struct Args {
    /// Videos, or folders of images in order
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Table of proposed sequences to write
    #[arg(short, long, value_name = "SEGMENTS.csv")]
    output: PathBuf,
    /// Subject of the recordings; by default the name of each recording
    #[arg(long)]
    subject: Option<String>,
    /// Emotion label for all proposals
    #[arg(long, default_value = UNLABELLED)]
    emotion: String,
    /// Marked points on a neutral frame of the recording, a CSV file node,x,y; by default found. Needs a single recording
    #[arg(short, long, value_name = "C.csv", requires = "neutral_frame")]
    correspondences: Option<PathBuf>,
    /// Number of the frame of --correspondences
    #[arg(long, value_name = "NUMBER", requires = "correspondences")]
    neutral_frame: Option<u32>,
    /// Frames per second; by default those of the recording, or 25
    #[arg(long, value_parser = frame_rate)]
    fps: Option<f64>,
    /// Film to write (.mp4, .webm), or a folder for one film per recording
    ///
    /// It shows the wireframe, the pose, the phases and the strongest action units.
    #[arg(long, value_name = "FILM|DIR", conflicts_with = "no_faces")]
    overlay: Option<PathBuf>,
    /// Do not write pictures of the proposals
    #[arg(long)]
    no_faces: bool,
    /// Also write STEM_openface.csv: a row for every frame of the recording, with the columns of OpenFace's files
    #[arg(long)]
    openface: bool,
    /// Number of threads; 0 uses one per processor
    #[arg(short = 'j', long, default_value_t = 0, value_parser = thread_count)]
    threads: usize,
    #[command(flatten)]
    thresholds: Thresholds,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    fit: FitArgs,
    #[command(flatten)]
    track: TrackArgs,
    #[command(flatten)]
    general: GeneralArgs,
}

/// What counts as an expression.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Rests and expressions")]
pub struct Thresholds {
    /// Shortest expression, in seconds; shorter activity is a blink or speech
    #[arg(long, default_value_t = SegmentOptions::default().shortest, value_parser = positive, value_name = "SECONDS")]
    shortest: f64,
    /// Activity that an expression must reach, in intensities of action units (0 to 5)
    #[arg(long, default_value_t = SegmentOptions::default().high, value_parser = positive, value_name = "ACTIVITY")]
    high: f64,
    /// Activity at which an expression begins and ends, in intensities of action units (0 to 5)
    #[arg(long, default_value_t = SegmentOptions::default().low, value_parser = positive, value_name = "ACTIVITY")]
    low: f64,
    /// Largest activity of a frame at rest, in intensities of action units (0 to 5)
    #[arg(long, default_value_t = SegmentOptions::default().rest, value_parser = positive, value_name = "ACTIVITY")]
    rest: f64,
}

impl Thresholds {
    pub fn options(&self) -> SegmentOptions {
        SegmentOptions { shortest: self.shortest, high: self.high, low: self.low, rest: self.rest }
    }
}

/// Progress bars for the steps of a recording, one after the other.
struct Steps<'a> {
    quiet: bool,
    name: &'a str,
    bar: Mutex<Option<(RecordingStep, ProgressBar)>>,
    stop: &'a AtomicBool,
}

impl<'a> Steps<'a> {
    fn new(quiet: bool, name: &'a str, stop: &'a AtomicBool) -> Self {
        Self { quiet, name, bar: Mutex::new(None), stop }
    }

    fn tick(&self, step: RecordingStep, done: usize, of: Option<usize>) -> bool {
        let mut bar = self.bar.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if bar.as_ref().is_none_or(|(shown, _)| *shown != step) {
            if let Some((_, before)) = bar.take() {
                before.finish_and_clear();
            }
            let what = match step {
                RecordingStep::Looking => "frames looked through",
                RecordingStep::Tracking => "frames tracked",
                RecordingStep::Measuring => "frames measured",
                RecordingStep::Drawing => "frames drawn",
            };
            *bar = Some((step, counted_bar(self.quiet, of.map(|n| n as u64), &format!("{what} of {}", self.name))));
        }
        if let Some((_, bar)) = bar.as_ref() {
            bar.inc(done as u64);
        }
        !self.stop.load(Ordering::Relaxed)
    }

    fn finish(&self) {
        if let Some((_, bar)) = self.bar.lock().unwrap_or_else(std::sync::PoisonError::into_inner).take() {
            bar.finish_and_clear();
        }
    }
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let thresholds = args.thresholds.options();
    anyhow::ensure!(
        thresholds.low <= thresholds.high,
        "--low {} is larger than --high {}: an expression begins and ends at --low and reaches --high; give a smaller --low",
        thresholds.low,
        thresholds.high
    );
    set_threads(args.threads)?;
    let folder = segments_folder(&args.output);
    anyhow::ensure!(
        folder != args.output,
        "{}: the table must end in .csv; the folder beside it has the same name without .csv",
        args.output.display()
    );
    for path in args.recordings.iter().filter(|path| path.is_dir()) {
        anyhow::ensure!(
            !lies_in(&folder, path),
            "{}: the results would go into {}, which lies among the frames of the recording; give the table another name or place",
            args.output.display(),
            folder.display()
        );
    }
    let is_ours = |name: &std::ffi::OsStr| name.to_string_lossy().ends_with("_frames.csv");
    let is_hidden = |name: &std::ffi::OsStr| name.to_string_lossy().starts_with('.');
    let entries = std::fs::read_dir(&folder).into_iter().flatten().flatten();
    let mut entries = entries.filter(|entry| !is_hidden(&entry.file_name())).peekable();
    anyhow::ensure!(
        entries.peek().is_none() || entries.any(|entry| is_ours(&entry.file_name())),
        "{}: the results would go into {}, which holds other files; give the table another name",
        args.output.display(),
        folder.display()
    );
    if let Some(subject) = &args.subject {
        check_file_name("subject", subject).context("--subject")?;
    }
    check_file_name("emotion", args.emotion.trim()).context("--emotion")?;
    let inputs: Vec<_> =
        all("the recording", &args.recordings).chain(maybe("--correspondences", args.correspondences.as_ref())).collect();
    let films: Vec<PathBuf> = args.recordings.iter().filter_map(|path| film_of(args, &stem_of(path))).collect();
    let outputs: Vec<_> = maybe("--output", Some(&args.output)).chain(all("--overlay", &films)).collect();
    check_apart(&outputs, &inputs)?;
    args.overlay.as_deref().map_or(Ok(()), check_films_name)?;
    // Of two commands that write the same table, one would lose its rows.
    let is_new = !folder.exists();
    let claim = claim_folder(&folder)?;
    let proposed = propose(args, &folder);
    drop(claim);
    if is_new {
        // It goes if it is empty, because nothing was written.
        let _ = std::fs::remove_dir(&folder);
    }
    proposed
}

/// Segments the recordings and writes the table and the files in its folder, which is claimed.
fn propose(args: &Args, folder: &Path) -> anyhow::Result<Outcome> {
    args.general.check_free(&args.output)?;
    let earlier = EarlierSegments::read(&args.output).map_err(|error| {
        anyhow::anyhow!("{error}; it is not overwritten, because its content would be lost: repair it, or move it away")
    })?;
    let base = base_of(&args.output);
    let resolved = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let named: Vec<PathBuf> = args.recordings.iter().map(|path| resolved(path)).collect();
    let others = earlier.others_than(|frames| named.contains(&resolved(&base.join(frames))));
    anyhow::ensure!(
        others.is_empty(),
        "{}: the table also has sequences of {}, whose rows would be lost; name {} too, delete these rows, or choose another table",
        args.output.display(),
        listed(&others, 5),
        if others.len() == 1 { "this recording" } else { "these recordings" }
    );
    anyhow::ensure!(
        args.recordings.len() == 1 || args.correspondences.is_none(),
        "--correspondences belong to a frame of one recording; give only one recording"
    );
    let options = PipelineOptions {
        fit: args.fit.options_of(args.method.method),
        track: args.track.options_of(args.method.method),
        ..PipelineOptions::default()
    };
    let bench = args.general.workbench(options)?;
    let recordings = recordings(args, &bench)?;
    // A recording may take minutes.
    check_writable(&args.output)?;
    let stop = stop_flag()?;
    let (mut done, mut failed): (Vec<(ManifestColumns, RecordingFiles)>, usize) = (Vec::new(), 0);
    for (path, recording) in &recordings {
        match one(args, recording, folder, &bench, &stop) {
            Ok(files) => {
                if !args.general.quiet {
                    let [all, seen] = files.frames;
                    println!(
                        "{}: {} proposed; found a face in {seen} of {all} frames",
                        path.display(),
                        count(files.segments.len(), "sequence", "sequences")
                    );
                    files.notes.iter().for_each(|note| println!("  {note}"));
                }
                if files.segments.is_empty() {
                    failed += 1;
                    if args.general.quiet {
                        let [all, seen] = files.frames;
                        eprintln!("failed: {}: found no expression; found a face in {seen} of {all} frames", path.display());
                    }
                }
                let columns = ManifestColumns {
                    subject: args.subject.clone().unwrap_or_else(|| recording.stem.clone()),
                    emotion: args.emotion.trim().to_lowercase(),
                    frames: named_from(&base, path),
                };
                done.push((columns, files));
            }
            Err(_) if stop.load(Ordering::Relaxed) => anyhow::bail!("interrupted; finished recordings are kept"),
            // The table would be overwritten without its rows, although nothing is wrong with it.
            Err(error) if matches!(error.downcast_ref(), Some(RecordingError::Newer { .. })) => return Err(error),
            Err(error) => {
                failed += 1;
                eprintln!("failed: {}", about(path)(&super::chain(&error)));
            }
        }
    }
    if done.is_empty() {
        return Ok(Outcome::Failed);
    }
    let mut rows: Vec<SegmentRow<'_>> = Vec::new();
    for (of, files) in &done {
        let fps = (!files.uneven).then_some(files.fps);
        rows.extend(files.segments.iter().map(|segment| SegmentRow { of: of.clone(), more: Vec::new(), fps, segment }));
    }
    let added = earlier.columns().to_vec();
    let given = GivenForAll { emotion: args.emotion.trim() != UNLABELLED, subject: args.subject.is_some() };
    let KeptRows { notes, proposed, is_lossy } = earlier.keep_in(&mut rows, given);
    for note in notes {
        eprintln!("note: {note}");
    }
    if is_lossy {
        eprintln!("note: the old table is kept as {}; copy from it what you need", keep_edited(&args.output)?.display());
    }
    let marks = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    proposed.write(&args.output, || write_segments(&args.output, &marks, &added, &rows))?;
    if !args.general.quiet {
        println!("{} written to {}", count(rows.len(), "sequence", "sequences"), args.output.display());
        let run = format!("grimace run {} -o results", quoted(&args.output.display().to_string()));
        if rows.iter().any(|row| row.of.emotion == UNLABELLED) {
            println!(
                "next: fill in the column emotion for every sequence (`{UNLABELLED}` would count as an emotion), then {run}"
            );
        } else if !rows.is_empty() {
            println!("next: {run}");
        }
    }
    Ok(match failed {
        0 => Outcome::Done,
        _ if rows.is_empty() => Outcome::Failed,
        _ => Outcome::SomeFailed,
    })
}

/// The recordings by path; each has a unique name.
fn recordings(args: &Args, bench: &Workbench) -> anyhow::Result<Vec<(PathBuf, Recording)>> {
    let mut names: BTreeMap<String, PathBuf> = BTreeMap::new();
    let mut out = Vec::new();
    for path in &args.recordings {
        let frames = list_recording(path)?;
        let stem = stem_of(path);
        if let Some(first) = names.insert(stem.clone(), path.clone()) {
            anyhow::bail!(
                "{} and {} have the same name, {stem}, and sequences are named after their recording; rename one of them, or make two tables",
                first.display(),
                path.display()
            );
        }
        let marks = match (&args.correspondences, args.neutral_frame) {
            (Some(marks), Some(frame)) => {
                let read = marks_or_found(Some(marks), bench, marks, || anyhow::bail!("given marks need no frame"))?;
                Some((frame, read.marks))
            }
            _ => None,
        };
        out.push((path.clone(), Recording { stem, frames, fps: args.fps, marks }));
    }
    Ok(out)
}

/// Prefix of the names of sequences of a recording: the name of the folder, or of the video without its extension.
fn stem_of(path: &Path) -> String {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let name = if full.is_dir() { full.file_name() } else { full.file_stem() };
    name.unwrap_or_default().to_string_lossy().into_owned()
}

/// The film of a recording, if films are requested.
fn film_of(args: &Args, stem: &str) -> Option<PathBuf> {
    args.overlay.as_ref().map(|path| {
        let is_film = path.extension().is_some_and(|e| ["mp4", "webm"].iter().any(|f| e.eq_ignore_ascii_case(f)));
        if is_film { path.clone() } else { path.join(format!("{stem}.mp4")) }
    })
}

fn one(
    args: &Args,
    recording: &Recording,
    folder: &Path,
    bench: &Workbench,
    stop: &AtomicBool,
) -> anyhow::Result<RecordingFiles> {
    let options = args.thresholds.options();
    let film = film_of(args, &recording.stem);
    anyhow::ensure!(
        args.recordings.len() == 1 || film.is_none() || film != args.overlay,
        "--overlay names one film, but there are {} recordings; name a folder",
        args.recordings.len()
    );
    let outputs = RecordingOutputs { pictures: !args.no_faces, openface: args.openface };
    let reusable = reuse_recording(folder, recording, &options, bench, outputs)?;
    if let Some(film) = &film {
        args.general.check_free(film)?;
        check_video(film, recording.fps.unwrap_or(25.0), (64, 64))?;
    } else if let Some(files) = reusable {
        return Ok(files);
    }
    let steps = Steps::new(args.general.quiet, &recording.stem, stop);
    let tick = |step, done, of| steps.tick(step, done, of);
    let found = segment_recording(recording, bench, &options, &tick);
    let written = found.map_err(anyhow::Error::from).and_then(|found| {
        // Existing results of the same recording are kept, with corrected marks.
        let files = match reusable {
            Some(files) => files,
            None => write_recording(folder, (recording, &found), &options, bench, outputs, &tick)?,
        };
        if let Some(film) = &film
            && let Err(error) = write_recording_film(film, (recording, &found), bench, &tick)
        {
            anyhow::ensure!(!stop.load(Ordering::Relaxed), error);
            eprintln!("no film: {}: {}", film.display(), super::chain(&error.into()));
        }
        Ok(files)
    });
    steps.finish();
    written
}

/// Absolute folder of the table.
fn base_of(table: &Path) -> PathBuf {
    let folder = table.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    folder.canonicalize().unwrap_or_else(|_| folder.to_owned())
}

/// Path of a recording in the table: relative if it is inside the folder of the table, otherwise absolute.
fn named_from(base: &Path, path: &Path) -> String {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    full.strip_prefix(base).unwrap_or(&full).display().to_string()
}
