//! Cross-cloning between simulated people: compares a cloned expression with the same expression performed by the target.
//!
//! The truth is the target's face with the same units at the same weights. Two kinds of units give two truths: *action units* of Candide-3,
//! whose vectors have the same lengths on everybody, and *FAPs*, whose lengths are in the person's own FAPUs. Neutral nodes are exact on
//! both sides, so the error is that of the transfer alone. Pictures of targets and sources differ in size, as real ones do.

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

/// Sizes of the targets' pictures relative to those of the sources, used in turn.
const SIZES: [f64; 3] = [0.8, 1.0, 1.3];

/// How offsets are transferred from one face to the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// No transfer: the neutral face.
    Neutral,
    /// Offsets scaled by the given rule.
    Scaled(Rescale),
}

impl Transfer {
    /// All transfers, the baseline first.
    pub const ALL: [Self; 4] =
        [Self::Neutral, Self::Scaled(Rescale::None), Self::Scaled(Rescale::Uniform), Self::Scaled(Rescale::Fapu)];

    /// Returns the name of the transfer in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Neutral => "plain copy of the neutral",
            Self::Scaled(Rescale::None) => "no scaling",
            Self::Scaled(Rescale::Uniform) => "uniform (ES)",
            Self::Scaled(Rescale::Fapu) => "per region (FAPU)",
        }
    }
}

/// Result of one transfer for one pair of people and one emotion.
#[derive(Clone, Debug, PartialEq)]
pub struct CrossRow {
    /// Units that make the truth.
    pub scope: UnitScope,
    /// Emotion.
    pub emotion: Emotion,
    /// Indices of source and target, from 0.
    pub pair: (u32, u32),
    /// The transfer.
    pub transfer: Transfer,
    /// Mean error of the live nodes at the apex, percent of the target's eye distance.
    pub error: f64,
}

/// Clones the apex of every emotion from every simulated person to the next three.
///
/// # Errors
/// [`EvaluateError`] for simulation options out of range or a face that cannot be fitted or cloned.
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

/// Returns the mean and 95th percentile of the error of every transfer, over all pairs and by emotion.
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
