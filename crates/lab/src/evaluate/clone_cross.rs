//! Cross-cloning between simulated people: what one performs, put on another, against what the other looks like performing the same.
//!
//! The truth is the other's face with the same units at the same weights. Two kinds of units give two truths: *action units* of
//! Candide-3, whose vectors are the same lengths on everybody, and *FAPs*, whose lengths are the person's own FAPUs. Neutral nodes
//! are exact on both sides, so that the error is that of the transfer alone. Pictures of targets have other sizes than those of
//! sources, as real ones do.

use nalgebra::{Point2, Vector2};

use super::{Cell, ErrorSummary, EvaluateError, Table};
use crate::simulate::{Emotion, SimulateOptions, UnitScope, performed_nodes};
use grimace::internal::{
    clone::{Rescale, SourceMotion, Target},
    fit::FittedWireframe,
    geometry::Similarity,
    model::FrameExpressionModel,
    pipeline::Workbench,
    track::{NodeState, TrackedFrame, TrackedNode, eye_distance_px},
};

/// Sizes of the targets' pictures over those of the sources, in turn.
const SIZES: [f64; 3] = [0.8, 1.0, 1.3];

/// How offsets get from one face to the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// Not at all: the neutral face.
    Neutral,
    /// Scaled.
    Scaled(Rescale),
}

impl Transfer {
    /// All, the floor first.
    pub const ALL: [Self; 4] =
        [Self::Neutral, Self::Scaled(Rescale::None), Self::Scaled(Rescale::Uniform), Self::Scaled(Rescale::Fapu)];

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Neutral => "plain copy of the neutral",
            Self::Scaled(Rescale::None) => "no scaling",
            Self::Scaled(Rescale::Uniform) => "uniform (ES)",
            Self::Scaled(Rescale::Fapu) => "per region (FAPU)",
        }
    }
}

/// One transfer of one pair and emotion.
#[derive(Clone, Debug, PartialEq)]
pub struct CrossRow {
    /// Units of the truth.
    pub scope: UnitScope,
    /// Emotion.
    pub emotion: Emotion,
    /// Source and target, from 0.
    pub pair: (u32, u32),
    /// How it was scaled.
    pub transfer: Transfer,
    /// Mean error of the live nodes at the apex, percent of the target's eye distance.
    pub error: f64,
}

/// Clones the apex of every emotion from every simulated person to the next three.
///
/// # Errors
/// [`EvaluateError`] for simulation options out of range or a face that does not serve.
pub fn evaluate_cross_cloning(options: &SimulateOptions, bench: &Workbench) -> Result<Vec<CrossRow>, EvaluateError> {
    options.check()?;
    let mut rows = Vec::new();
    for scope in [UnitScope::All, UnitScope::Faps] {
        for source in 0..options.subjects {
            for step in 1..=3.min(options.subjects.saturating_sub(1)) {
                let target = (source + step) % options.subjects;
                for &emotion in &options.emotions {
                    rows.extend(pair(options, scope, emotion, (source, target), bench)?);
                }
            }
        }
    }
    Ok(rows)
}

fn pair(
    options: &SimulateOptions,
    scope: UnitScope,
    emotion: Emotion,
    (source, target): (u32, u32),
    bench: &Workbench,
) -> Result<Vec<CrossRow>, EvaluateError> {
    let size = SIZES[(source + target) as usize % SIZES.len()];
    let large = |side: u32| (f64::from(side) * size).round() as u32;
    let seen = SimulateOptions { width: large(options.width), height: large(options.height), ..options.clone() };
    let (from, to) = performed_nodes(options, source, emotion, scope)?;
    let (neutral, truth) = performed_nodes(&seen, target, emotion, scope)?;
    let track = [tracked(1, &from), tracked(2, &to)];
    let motion = SourceMotion::from_track("source", &track, &[], bench)?;
    let picture = image::RgbImage::new(8, 8);
    let fitted = FittedWireframe {
        model: FrameExpressionModel::new(neutral.clone()),
        image_from_face: Similarity::identity(),
        correspondences: Vec::new(),
        read: Vec::new(),
        residuals: Vec::new(),
        spreads: None,
        warnings: Vec::new(),
    };
    let face = Target::from_fit("target", picture, fitted, bench)?;
    let eye_distance = eye_distance_px(&bench.tables, &neutral).unwrap_or(f64::NAN);
    let live = bench.wireframe.live_nodes();
    let apex = motion.at(1.0);
    Ok(Transfer::ALL
        .into_iter()
        .map(|transfer| {
            let nodes = match transfer {
                Transfer::Neutral => neutral.clone(),
                Transfer::Scaled(rescale) => face.nodes_at(&motion, &apex, rescale, 1.0, false, bench),
            };
            let distance = |n: usize| -> f64 {
                let v: Vector2<f64> = nodes[n] - truth[n];
                v.norm()
            };
            let mean = live.iter().map(|n| distance(n.index())).sum::<f64>() / live.len() as f64;
            CrossRow { scope, emotion, pair: (source, target), transfer, error: 100.0 * mean / eye_distance }
        })
        .collect())
}

fn tracked(number: u32, nodes: &[Point2<f64>]) -> TrackedFrame {
    let node = |&position: &Point2<f64>| TrackedNode::new(position, NodeState::Tracked, None);
    TrackedFrame { number, nodes: nodes.iter().map(node).collect() }
}

/// Mean and 95th percentile of every transfer, over all pairs and by emotion.
pub fn cross_table(rows: &[CrossRow]) -> Table {
    let mut table = Table::new(["truth", "emotion", "scaling", "pairs", "mean (% ES)", "95 % of pairs below (% ES)"]);
    for scope in [UnitScope::All, UnitScope::Faps] {
        let mut emotions: Vec<Option<Emotion>> = rows.iter().map(|r| Some(r.emotion)).collect();
        emotions.sort_unstable();
        emotions.dedup();
        for emotion in [None].into_iter().chain(emotions) {
            for transfer in Transfer::ALL {
                let errors: Vec<f64> = rows
                    .iter()
                    .filter(|r| r.scope == scope && r.transfer == transfer && emotion.is_none_or(|e| e == r.emotion))
                    .map(|r| r.error)
                    .collect();
                let summary = ErrorSummary::of(&errors);
                table.rows.push(vec![
                    Cell::text(scope.name()),
                    Cell::text(emotion.map_or("all", Emotion::label)),
                    Cell::text(transfer.name()),
                    Cell::Count(errors.len()),
                    Cell::maybe(summary.map(|s| s.mean), 3),
                    Cell::maybe(summary.map(|s| s.p95), 3),
                ]);
            }
        }
    }
    table
}
