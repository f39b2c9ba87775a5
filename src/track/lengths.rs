//! Lengths that are measured on the neutral face: the eye distance and the window of the KLT.

use nalgebra::{Point2, Vector2};

use super::{MIN_WINDOW_PX, TrackOptions};
use crate::{units::NodeId, wireframe::Tables};

/// Returns the eye distance of the fitted wireframe, px: the unit of the relative options.
pub fn eye_distance_px(tables: &Tables, nodes: &[Point2<f64>]) -> Option<f64> {
    // Only the length matters: taking both axes of the vector between the pupils removes the effect of roll.
    let definition = tables.fapus.iter().find(|d| d.fapu == crate::wireframe::Fapu::Es)?;
    let mean = |ids: &[NodeId]| -> Option<Vector2<f64>> {
        let points: Option<Vec<_>> = ids.iter().map(|n| nodes.get(n.index()).map(|p| p.coords)).collect();
        Some(points?.iter().sum::<Vector2<f64>>() / ids.len() as f64)
    };
    Some((mean(&definition.plus_nodes)? - mean(&definition.minus_nodes)?).norm()).filter(|d| *d > 0.0)
}

/// Returns the side of the KLT window for a neutral face: odd, px.
pub fn window_px(tables: &Tables, neutral: &[Point2<f64>], options: &TrackOptions) -> u32 {
    let eye_distance = eye_distance_px(tables, neutral).unwrap_or(0.0);
    let half = (options.window * eye_distance / 2.0).round().clamp(0.0, 100.0) as u32;
    (2 * half + 1).max(MIN_WINDOW_PX)
}
