//! Self-cloning: clones a sequence's own expression onto its neutral frame and compares the result with the real apex frame.
//!
//! The sequence is tracked as in `run`, and its motion, head motion included, is applied to the neutral frame. The comparison covers the
//! convex hull of the face. It includes four variants ([`SelfVariant`]): the neutral frame itself (the baseline), a warp by true landmarks,
//! the clone, and the clone with wrinkles and teeth of the sequence's own frames.

use std::path::Path;

use image::RgbImage;
use nalgebra::Point2;
use rayon::prelude::*;

use super::{
    Cell, ErrorSummary, EvaluateError, Failed, Table,
    clone_quality::{Likeness, likeness},
    truth::{compared_nodes, group_of, landmark_eye_distance},
};
use grimace::internal::{
    clone::{CloneOptions, Details, SourceMotion, Target, clone_expression},
    dataset::{Dataset, LandmarkSelection, SequenceEntry},
    fit::FittedWireframe,
    pipeline::{SequenceSource, Workbench, track_one},
    sequence::read_colour_frames,
    units::NodeId,
    warp::{MouthInside, Texture, Warp},
};

/// What is compared with the apex frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SelfVariant {
    /// The neutral frame without a change: the baseline.
    Neutral,
    /// The neutral frame warped by the true motion of all landmarks: the best result without tracking error.
    Landmarks,
    /// The clone: the neutral frame warped by the tracked motion.
    Clone,
    /// The clone with wrinkles and teeth of the sequence's frames.
    Details,
}

impl SelfVariant {
    /// All variants, the baseline first.
    pub const ALL: [Self; 4] = [Self::Neutral, Self::Landmarks, Self::Clone, Self::Details];

    /// Returns the name of the variant in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Neutral => "neutral copy",
            Self::Landmarks => "landmark warp",
            Self::Clone => "clone",
            Self::Details => "clone, wrinkles, teeth",
        }
    }
}

/// Result of one variant on one sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct SelfRow {
    /// Name of the sequence.
    pub id: String,
    /// Group of the sequence.
    pub group: String,
    /// Emotion.
    pub emotion: String,
    /// Variant.
    pub variant: SelfVariant,
    /// Similarity to the real apex frame.
    pub likeness: Likeness,
    /// Mean error of the motion of the compared nodes at the apex, percent of the eye distance.
    pub node_error: f64,
}

/// Clones every sequence of a dataset that has landmarks onto its own neutral frame.
///
/// `progress` is called from any thread after every finished sequence and may return `false` to stop.
///
/// # Errors
/// [`EvaluateError`] when the dataset cannot be opened or has no landmarks, or on interruption.
pub fn evaluate_self_cloning(
    path: &Path,
    by: Option<&str>,
    selection: &LandmarkSelection,
    options: &CloneOptions,
    bench: &Workbench,
    progress: impl Fn() -> bool + Sync,
) -> Result<(Vec<SelfRow>, Vec<Failed>), EvaluateError> {
    let dataset = Dataset::open(path)?;
    let entries: Vec<&SequenceEntry> = dataset.sequences.iter().filter(|e| !e.landmarks_paths.is_empty()).collect();
    if entries.is_empty() {
        return Err(EvaluateError::NoTruth { path: path.to_owned() });
    }
    let groups: Vec<String> = entries.iter().map(|e| group_of(e, by)).collect::<Result<_, _>>()?;
    let results: Vec<Option<Result<Vec<SelfRow>, Failed>>> = entries
        .par_iter()
        .zip(&groups)
        .map(|(entry, group)| {
            let failed = |reason: String| Failed { id: entry.id.to_string(), variant: String::new(), reason };
            let rows = self_clone(entry, group, selection, options, bench).map_err(failed);
            progress().then_some(rows)
        })
        .collect();
    let (mut rows, mut failures) = (Vec::new(), Vec::new());
    for result in results {
        match result.ok_or(EvaluateError::Interrupted)? {
            Ok(found) => rows.extend(found),
            Err(failed) => failures.push(failed),
        }
    }
    Ok((rows, failures))
}

fn self_clone(
    entry: &SequenceEntry,
    group: &str,
    selection: &LandmarkSelection,
    options: &CloneOptions,
    bench: &Workbench,
) -> Result<Vec<SelfRow>, String> {
    fn text(error: impl std::fmt::Display) -> String {
        error.to_string()
    }
    let frames = entry.frames().map_err(text)?;
    let neutral_number = frames.neutral_number();
    let count = bench.wireframe.node_count();
    let marks = entry.correspondences(neutral_number, &bench.tables, count, selection).map_err(text)?;
    let landmarks = entry.landmarks().map_err(text)?.ok_or("no landmarks")?;
    let source = SequenceSource {
        id: entry.id.clone(),
        emotion: entry.emotion.clone(),
        metadata: entry.metadata.clone(),
        frames,
        marks: marks.clone(),
        marks_from: "landmarks".to_owned(),
        covered: Vec::new(),
        fps: entry.fps,
    };
    let (track, _) = track_one(&source, bench, |_| true).map_err(|f| f.reason)?;
    let motion = SourceMotion::from_track(&entry.id.to_string(), &track.frames, &[], bench).map_err(text)?;
    let numbers: Vec<u32> = motion.frames.iter().map(|f| f.0).collect();
    let pictures: Vec<RgbImage> =
        read_colour_frames(&source.frames, &numbers).map_err(text)?.into_iter().map(|(_, picture)| picture).collect();
    let (Some(neutral), Some(apex), Some(&apex_number)) = (pictures.first(), pictures.last(), numbers.last()) else {
        return Err("no frames".to_owned());
    };
    let (neutral, apex) = (neutral.clone(), apex.clone());
    let fitted: FittedWireframe = bench.fitter().fit(&bench.wireframe, &marks).map_err(text)?;
    let target = Target::from_fit(&entry.id.to_string(), neutral.clone(), fitted, bench).map_err(text)?;
    let details = Details::new(&target, &motion, pictures).map_err(text)?;
    let (first, truth) = (landmarks.frame(neutral_number).map_err(text)?, landmarks.frame(apex_number).map_err(text)?);
    let eye_distance = landmark_eye_distance(first).ok_or("the landmarks of the eyes coincide")?;
    let region = hull(truth);
    let compared = compared_nodes(&bench.tables);
    // The error is that of the offset from neutral, so that an error of the fit in the neutral frame does not count as motion.
    let error = |nodes: &dyn Fn(NodeId) -> Point2<f64>, start: &dyn Fn(NodeId) -> Point2<f64>| {
        let one =
            |c: &super::truth::ComparedNode| ((nodes(c.node) - start(c.node)) - (truth[c.landmark] - first[c.landmark])).norm();
        let inner: Vec<_> = compared.iter().filter(|c| c.inner).collect();
        100.0 * inner.iter().map(|c| one(c)).sum::<f64>() / inner.len() as f64 / eye_distance
    };
    let start = |n: NodeId| target.fitted.model.nodes()[n.index()];
    let mut rows = Vec::new();
    for variant in SelfVariant::ALL {
        let (picture, node_error) = match variant {
            SelfVariant::Neutral => (neutral.clone(), error(&start, &start)),
            SelfVariant::Landmarks => (landmark_warp(&neutral, first, truth, &target, bench)?, 0.0),
            SelfVariant::Clone | SelfVariant::Details => {
                let with = variant == SelfVariant::Details;
                let options = CloneOptions { head: true, wrinkles: if with { 1.0 } else { 0.0 }, ..*options };
                let clone = clone_expression(&motion, &target, with.then_some(&details), &options, bench).map_err(text)?;
                let last = clone.frames.len() - 1;
                let nodes = clone.frames[last].deformation.nodes();
                (clone.picture(last).map_err(text)?, error(&|n| nodes[n.index()], &start))
            }
        };
        let likeness = likeness(&picture, &apex, &region).ok_or("the landmarks lie outside the frame")?;
        let (id, group, emotion) = (entry.id.to_string(), group.to_owned(), entry.emotion.clone());
        rows.push(SelfRow { id, group, emotion, variant, likeness, node_error });
    }
    Ok(rows)
}

/// Returns the neutral frame warped by the true motion of the landmarks. Compared nodes move with their landmarks, and the springs move the
/// others.
fn landmark_warp(
    neutral: &RgbImage,
    first: &[Point2<f64>],
    truth: &[Point2<f64>],
    target: &Target,
    bench: &Workbench,
) -> Result<RgbImage, String> {
    use grimace::internal::fit::{DrivenNode, Pull, Springs};
    let start = target.fitted.model.nodes();
    let pulled: Vec<DrivenNode> = compared_nodes(&bench.tables)
        .iter()
        .map(|c| DrivenNode {
            node: c.node,
            position: start[c.node.index()] + (truth[c.landmark] - first[c.landmark]),
            pull: Pull::Hard,
        })
        .collect();
    let moved = Springs::new(&bench.wireframe).deform(&bench.wireframe, start, &pulled).map_err(|e| e.to_string())?;
    let warp = Warp::new(start).map_err(|e| e.to_string())?;
    let deformation = warp.deform(&moved).map_err(|e| e.to_string())?;
    Ok(warp.render(&Texture::new(neutral), &deformation, &MouthInside::Dark))
}

/// Returns the convex hull of points.
fn hull(points: &[Point2<f64>]) -> Vec<Point2<f64>> {
    grimace::internal::warp::convex_hull(points.to_vec())
}

/// Returns the means over the sequences of each group and variant: SSIM, PSNR, node error, and `of_the_way`, the share of the SSIM
/// difference between the neutral frame and 1 that the variant gains.
pub fn self_table(rows: &[SelfRow]) -> Table {
    let mut table = Table::new(["group", "variant", "sequences", "ssim", "of_the_way", "psnr (dB)", "node error (% ES)"]);
    let mut groups: Vec<&str> = rows.iter().map(|r| r.group.as_str()).collect();
    groups.sort_unstable();
    groups.dedup();
    for group in groups {
        let mean = |variant: SelfVariant, value: &dyn Fn(&SelfRow) -> f64| {
            let values: Vec<f64> =
                rows.iter().filter(|r| r.group == group && r.variant == variant).map(value).filter(|v| v.is_finite()).collect();
            (ErrorSummary::of(&values).map(|s| s.mean), values.len())
        };
        let (floor, _) = mean(SelfVariant::Neutral, &|r| r.likeness.ssim);
        for variant in SelfVariant::ALL {
            let (ssim, count) = mean(variant, &|r| r.likeness.ssim);
            let way = ssim.zip(floor).filter(|&(_, f)| f < 1.0).map(|(s, f)| (s - f) / (1.0 - f));
            table.rows.push(vec![
                Cell::text(group),
                Cell::text(variant.name()),
                Cell::Count(count),
                Cell::maybe(ssim, 3),
                Cell::maybe(way, 3),
                Cell::maybe(mean(variant, &|r| r.likeness.psnr_db).0, 2),
                Cell::maybe(mean(variant, &|r| r.node_error).0, 2),
            ]);
        }
    }
    table
}

/// Returns a row for every sequence and variant.
pub fn self_rows_table(rows: &[SelfRow]) -> Table {
    let mut table = Table::new(["sequence", "group", "emotion", "variant", "ssim", "psnr_db", "node_error_percent_es"]);
    for row in rows {
        table.rows.push(vec![
            Cell::text(&row.id),
            Cell::text(&row.group),
            Cell::text(&row.emotion),
            Cell::text(row.variant.name()),
            Cell::Number(row.likeness.ssim, 4),
            Cell::Number(row.likeness.psnr_db.min(99.0), 2),
            Cell::Number(row.node_error, 3),
        ]);
    }
    table
}
