//! Orientation: roll about z, and the head's translation and scale between frames, removed.
//!
//! KP assume frontal views and rotate every frame model about z until it is vertical; how the angle is found they leave to their
//! reference [1]. Here every frame is laid on the neutral frame by the least-squares similarity of points that expressions do not
//! move: eye corners and the bone of the nose. The neutral frame's own roll is that of the similarity from the canonical frontal
//! wireframe to the same points.

use nalgebra::{Point2, Rotation2};

use super::NormalizeError;
use crate::{
    geometry::Similarity,
    model::DynamicExpressionModel,
    units::{FeaturePoint, Px},
    wireframe::Tables,
};

/// Points that expressions do not move: outer and inner eye corners, bone of the nose above and below.
const STABLE_FEATURE_POINTS: [(u8, u8); 9] = [(3, 7), (3, 11), (3, 8), (3, 12), (9, 6), (9, 7), (9, 12), (9, 13), (9, 14)];

/// Indices of the nodes that expressions do not move, of those that a wireframe of `count` nodes has.
pub fn stable_nodes(tables: &Tables, count: usize) -> Vec<usize> {
    STABLE_FEATURE_POINTS
        .iter()
        .filter_map(|&(group, point)| tables.feature_point_nodes(FeaturePoint { group, point }))
        .flatten()
        .map(|n| n.index())
        .filter(|&k| k < count)
        .collect()
}

/// Frames of node positions, upright, y up, in pixels of the neutral frame.
pub fn upright(
    model: &DynamicExpressionModel<Px>,
    frontal: &[Point2<f64>],
    tables: &Tables,
) -> Result<Vec<Vec<Point2<f64>>>, NormalizeError> {
    let stable = stable_nodes(tables, frontal.len());
    let pick = |nodes: &[Point2<f64>]| -> Vec<Point2<f64>> { stable.iter().map(|&k| nodes[k]).collect() };
    let y_up = |nodes: &[Point2<f64>]| -> Vec<Point2<f64>> { nodes.iter().map(|p| Point2::new(p.x, -p.y)).collect() };
    let neutral = y_up(model.neutral().nodes());
    let neutral_from_face = Similarity::fit(&pick(frontal), &pick(&neutral), None)?;
    let unroll = Rotation2::new(-neutral_from_face.angle);
    model
        .frames()
        .iter()
        .map(|frame| {
            let nodes = y_up(frame.nodes());
            let neutral_from_frame = Similarity::fit(&pick(&nodes), &pick(&neutral), None)?;
            Ok(nodes.iter().map(|p| unroll * neutral_from_frame.apply(p)).collect())
        })
        .collect()
}
