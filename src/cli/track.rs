//! `grimace track`.

use std::path::{Path, PathBuf};

use grimace::{
    dataset::{FrameSource, list_frames_among},
    overlay::png_bytes,
    pipeline::{
        OverlayFolder, PipelineOptions, SequenceFailure, SequenceSource, correct_track, corrections_said, id_of,
        overlay_pictures, track_one,
    },
    report::Stage,
    sequence::read_first_frame,
    track::{corrections_path, write_track},
};

use super::{
    Outcome,
    apart::{check_apart, maybe},
    progress::frame_bar,
    shared::{CheckArgs, FitArgs, GeneralArgs, MethodArgs, TrackArgs, about, frame_rate, marks_or_found, stop_flag},
};

/// Track one sequence from its neutral to its apex frame.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace track faces/S001/001 --correspondences faces/S001/001/correspondences.csv -o S001_001.csv --emotion happiness --overlay pictures

The track has one row for every node of every frame: frame,node,x,y,state,residual,expected_error. The springs place lost nodes, and their \
state shows it. A .json beside the track records the source files and the options.")]
pub struct Args {
    /// Folder of images in order, a video, or pictures separated by `;`; the first frame is neutral, the last one the apex
    sequence: PathBuf,
    /// Marked points on the first frame, a CSV file node,x,y in pixels; by default found in it
    #[arg(short, long, value_name = "C.csv")]
    correspondences: Option<PathBuf>,
    /// Track to write; a name SUBJECT_SEQUENCE.csv sets subject and sequence
    #[arg(short, long, value_name = "TRACK.csv")]
    output: PathBuf,
    /// Emotion label, for `analyze`
    #[arg(long, default_value = "unlabelled")]
    emotion: String,
    /// Number of the neutral frame, as in the file name; if several numbers in the names vary, frames count from 1
    #[arg(long)]
    first_frame: Option<u32>,
    /// Number of the apex frame, as in the file name
    #[arg(long)]
    last_frame: Option<u32>,
    /// Frames per second; by default those of the video
    #[arg(long, value_parser = frame_rate)]
    fps: Option<f64>,
    /// Output folder for pictures of the wireframe on every frame
    #[arg(long, value_name = "DIR")]
    overlay: Option<PathBuf>,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    fit: FitArgs,
    #[command(flatten)]
    track: TrackArgs,
    #[command(flatten)]
    check: CheckArgs,
    #[command(flatten)]
    general: GeneralArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let json = args.output.with_extension("json");
    anyhow::ensure!(
        json != args.output,
        "{}: the name of a track must end in .csv; the .json beside it has the same name",
        args.output.display()
    );
    let inputs: Vec<_> =
        maybe("the sequence", Some(&args.sequence)).chain(maybe("--correspondences", args.correspondences.as_ref())).collect();
    check_apart(&[("--output", &args.output), ("the .json beside --output", &json)], &inputs)?;
    args.general.check_free(&args.output)?;
    args.general.check_free(&json)?;
    let options = PipelineOptions {
        fit: args.fit.options_of(args.method.method),
        track: args.track.options_of(args.method.method),
        unchecked_marks: args.check.unchecked(),
        ..PipelineOptions::default()
    };
    let bench = args.general.workbench(options)?;
    // Frames that the options exclude are not overwritten, either.
    let (frames, all) = list_frames_among(&args.sequence, args.first_frame, args.last_frame)?;
    let inputs: Vec<_> = all.iter().map(|file| ("a frame of the sequence", file.as_path())).collect();
    check_apart(&[("--output", &args.output), ("the .json beside --output", &json)], &inputs)?;
    if let Some(folder) = &args.overlay {
        let is_folder = matches!(frames, FrameSource::Images(_));
        let folders = all.iter().filter(|_| is_folder).filter_map(|file| file.parent());
        let folders = folders.map(|place| if place.as_os_str().is_empty() { Path::new(".") } else { place });
        OverlayFolder::check_apart(folder, folders.map(|place| ("this folder", place)))?;
    }
    let found =
        marks_or_found(args.correspondences.as_deref(), &bench, &args.sequence, || Ok((read_first_frame(&frames)?, None)))?;
    let source = SequenceSource {
        id: id_of(&args.output),
        emotion: args.emotion.trim().to_lowercase(),
        metadata: Default::default(),
        frames,
        marks: found.marks,
        covered: found.covered,
        marks_from: if args.correspondences.is_some() { "command line" } else { "found" }.to_owned(),
        fps: args.fps,
    };
    let frames = match &source.frames {
        FrameSource::Images(files) => Some(files.len() as u64),
        FrameSource::Video { .. } => None,
    };
    let stop = stop_flag()?;
    let bar = frame_bar(args.general.quiet, frames);
    let tracked = track_one(&source, &bench, |_| {
        bar.inc(1);
        !stop.load(std::sync::atomic::Ordering::Relaxed)
    });
    bar.finish_and_clear();
    let (mut track, mut info) = tracked.map_err(|SequenceFailure { stage, reason, .. }| match stage {
        Stage::Fit => about(args.correspondences.as_ref().unwrap_or(&args.sequence))(&reason),
        _ => about(&args.sequence)(&reason),
    })?;
    // Corrections by hand of an earlier track of this name are kept in a separate file.
    correct_track(&source, &args.output, &mut track.frames, &mut info, &bench).map_err(|f| about(&args.output)(&f.reason))?;
    write_track(&args.output, &track.frames, &mut info)?;
    if let Some(folder) = &args.overlay {
        let folder = OverlayFolder::open(folder, args.general.force)?;
        let fit = bench.fit_head(&track.frames, &info.mark_places()).ok();
        overlay_pictures(
            &source,
            (&track.frames, fit.as_ref().map_or(&[], |fit| &fit.poses)),
            &bench,
            |_| true,
            |number, picture| {
                let bytes = png_bytes(&picture).map_err(SequenceFailure::at(Stage::Write))?;
                folder.write(&source.id, number, &bytes).map_err(SequenceFailure::at(Stage::Write))
            },
        )
        .map_err(|f| about(&args.sequence)(&f.reason))?;
        if let Some(note) = folder.close(|id| id == source.id.to_string())? {
            eprintln!("note: {note}");
        }
    }
    if !args.general.quiet {
        let s = &info.summary;
        println!(
            "{} frames, {:.1} % of the nodes tracked, mean forward-backward distance {:.3} px, eye distance {:.1} px",
            s.frames,
            100.0 * s.tracked_share,
            s.mean_residual_px,
            s.eye_distance_px
        );
        for (reason, count) in &s.recovered {
            println!("  recovered after {reason}: {count}");
        }
        if let Some(placed) = s.placement_error_px {
            println!("expected error of the median node's place on the neutral face: {placed:.2} px");
        }
        if let Some(expected) = s.expected_error_px {
            println!(
                "expected error of the median node's motion in the last frame: {expected:.2} px; verdict: {}",
                s.verdict.name()
            );
        }
        for note in info.clock().remark().iter().chain(&info.notes) {
            println!("  {note}");
        }
        let path = corrections_path(&args.output).display().to_string();
        for said in info.corrections.iter().flat_map(|c| corrections_said(c, &path)) {
            println!("  {said}");
        }
        for reason in &s.reasons {
            println!("  {reason}");
        }
    }
    Ok(Outcome::Done)
}
