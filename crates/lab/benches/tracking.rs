//! One sequence end to end on one thread, against the least that tracking can cost.
//!
//! `cargo bench --bench tracking` simulates a 24-frame sequence of 640x480 PNG files and times in turn, many times over:
//! - **bare**: a loop that decodes the frames and calls OpenCV's pyramidal KLT forward and backward on the live nodes;
//! - **tracked**: fit, decode, pyramids, KLT, forward-backward check, re-deformation, and the track file written.
//!
//! Machines drift, so the figure to quote is the median of the ratios of neighbouring runs.
#![allow(missing_docs, clippy::pedantic)]

use std::{fs, path::Path, time::Instant};

use grimace::internal::{
    dataset::{FrameSource, list_frames},
    fit::read_correspondences,
    pipeline::{PipelineOptions, SequenceSource, Workbench, track_one},
    track::{window_px, write_track},
    units::SequenceId,
};
use grimace_lab::simulate::{Emotion, FrameFormat, SimulateOptions, simulate_dataset};
use opencv::{
    core::{Mat, Point2f, Size, TermCriteria, Vector},
    imgcodecs::{IMREAD_GRAYSCALE, imread},
    video::calc_optical_flow_pyr_lk,
};

/// Pairs of runs.
const PAIRS: usize = 15;

/// Decodes the frames and follows the points forward and back, nothing else.
fn bare(files: &[&Path], points: &Vector<Point2f>, window: i32, levels: u32) -> opencv::Result<f32> {
    let mut previous = Mat::default();
    let mut points = points.clone();
    let criteria = TermCriteria { typ: 3, max_count: 30, epsilon: 0.01 };
    let size = Size::new(window, window);
    let mut sum = 0.0;
    for (index, path) in files.iter().enumerate() {
        let frame = imread(path, IMREAD_GRAYSCALE)?;
        if index > 0 {
            let (mut forward, mut backward) = (Vector::<Point2f>::new(), Vector::<Point2f>::new());
            let (mut status, mut error) = (Vector::<u8>::new(), Vector::<f32>::new());
            let levels = levels as i32 - 1;
            calc_optical_flow_pyr_lk(
                &previous,
                &frame,
                &points,
                &mut forward,
                &mut status,
                &mut error,
                size,
                levels,
                criteria,
                0,
                1e-4,
            )?;
            calc_optical_flow_pyr_lk(
                &frame,
                &previous,
                &forward,
                &mut backward,
                &mut status,
                &mut error,
                size,
                levels,
                criteria,
                0,
                1e-4,
            )?;
            sum += backward.get(0)?.x;
            points = forward;
        }
        previous = frame;
    }
    Ok(sum)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let options = SimulateOptions {
        subjects: 1,
        emotions: vec![Emotion::Surprise],
        format: FrameFormat::Png,
        ..SimulateOptions::default()
    };
    simulate_dataset(&options, folder.path(), false, |_, _| {})?;
    let sequence = fs::read_dir(folder.path().join("S001"))?.next().ok_or("no sequence")??.path();
    let bench = Workbench::new(None, PipelineOptions::default())?;
    let source = SequenceSource {
        id: SequenceId { subject: "S001".into(), sequence: "1".into() },
        emotion: "surprise".into(),
        metadata: Default::default(),
        frames: list_frames(&sequence, None, None)?,
        marks: read_correspondences(&sequence.join("correspondences.csv"), &bench.tables, bench.wireframe.node_count())?,
        marks_from: "file".into(),
        covered: Vec::new(),
        fps: None,
    };
    let FrameSource::Images(frames) = &source.frames else { return Err("not images".into()) };
    let files: Vec<&Path> = frames.iter().map(|f| f.path.as_path()).collect();
    let fitted = bench.fitter().fit(&bench.wireframe, &source.marks)?;
    let window = window_px(&bench.tables, fitted.model.nodes(), &bench.options.track);
    let live = bench.wireframe.live_nodes().iter().map(|n| fitted.model.nodes()[n.index()]);
    let points: Vector<Point2f> = live.map(|p| Point2f::new(p.x as f32, p.y as f32)).collect();
    let csv = folder.path().join("track.csv");
    let tracked = || -> Result<(), Box<dyn std::error::Error>> {
        let (track, mut info) = track_one(&source, &bench, |_| true).map_err(|f| f.reason)?;
        write_track(&csv, &track.frames, &mut info)?;
        Ok(())
    };
    let levels = bench.options.track.levels;
    bare(&files, &points, window as i32, levels)?;
    tracked()?;
    let mut rows = Vec::new();
    for _ in 0..PAIRS {
        let start = Instant::now();
        std::hint::black_box(bare(&files, &points, window as i32, levels)?);
        let bare_ms = start.elapsed().as_secs_f64() * 1e3;
        let start = Instant::now();
        tracked()?;
        rows.push((bare_ms, start.elapsed().as_secs_f64() * 1e3));
    }
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    println!(
        "{} frames of 640x480 PNG, {} nodes, {window} px window, {levels} levels, {PAIRS} pairs of runs",
        files.len(),
        points.len()
    );
    println!("bare     {:8.1} ms (median)", median(rows.iter().map(|r| r.0).collect()));
    println!("tracked  {:8.1} ms (median)", median(rows.iter().map(|r| r.1).collect()));
    println!("ratio    {:8.3} (median of pairs)", median(rows.iter().map(|r| r.1 / r.0).collect()));
    Ok(())
}
