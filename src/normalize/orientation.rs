//! Orientation: removes roll about z, and the head's translation and scale changes between frames.
//!
//! KP assume frontal views and rotate every frame model about z until it is vertical; for the angle they refer to their reference [1].
//! Here each frame is aligned with the neutral frame by the least-squares similarity of the eye corners. Roll of the neutral frame is the
//! angle of the similarity from the canonical frontal wireframe to its eye corners and nose.
//!
//! Expressions hardly move the eye corners: from the neutral to the smiling photographs of 90 people, their size relative to the width of
//! the face changes by 0.04 % on average. With the bone of the nose included, which a dropping jaw pulls down, it changes by 0.6 %, in a
//! surprise by 2 %; the normalized head would shrink by as much.

use nalgebra::{Point2, Rotation2};

use super::NormalizeError;
use crate::{
    geometry::{Similarity, SimilarityError},
    model::DynamicExpressionModel,
    units::{FeaturePoint, Px},
    wireframe::Tables,
};

/// Outer and inner eye corners, as (group, point).
const EYE_CORNERS: [(u8, u8); 4] = [(3, 7), (3, 11), (3, 8), (3, 12)];
/// Upper and lower bone of the nose, as (group, point).
const NOSE_BONE: [(u8, u8); 5] = [(9, 6), (9, 7), (9, 12), (9, 13), (9, 14)];

/// Returns the indices of the nodes that expressions move little: eye corners and bone of the nose. Indices are below `count`, the number
/// of nodes of the wireframe.
///
/// They locate a face, but do not give its distance to within a percent; see [`EyeCorners`].
pub fn stable_nodes(tables: &Tables, count: usize) -> Vec<usize> {
    nodes_of(EYE_CORNERS.iter().chain(&NOSE_BONE), tables, count)
}

/// The eye corners, which separate the head's motion in the image from expressions.
#[derive(Clone, Debug)]
pub struct EyeCorners(Vec<usize>);

impl EyeCorners {
    /// Finds the eye corners of a wireframe of `count` nodes.
    pub fn new(tables: &Tables, count: usize) -> Self {
        Self(nodes_of(EYE_CORNERS.iter(), tables, count))
    }

    /// Returns the indices of their nodes.
    pub(crate) fn nodes(&self) -> &[usize] {
        &self.0
    }

    /// Returns the similarity that maps the eye corners of `from` to those of `to`.
    ///
    /// # Errors
    /// [`SimilarityError`] where they coincide.
    pub fn similarity(&self, from: &[Point2<f64>], to: &[Point2<f64>]) -> Result<Similarity, SimilarityError> {
        let pick = |nodes: &[Point2<f64>]| -> Vec<Point2<f64>> { self.0.iter().filter_map(|&k| nodes.get(k).copied()).collect() };
        Similarity::fit(&pick(from), &pick(to), None)
    }
}

fn nodes_of<'a>(points: impl Iterator<Item = &'a (u8, u8)>, tables: &Tables, count: usize) -> Vec<usize> {
    points
        .filter_map(|&(group, point)| tables.feature_point_nodes(FeaturePoint { group, point }))
        .flatten()
        .map(|n| n.index())
        .filter(|&k| k < count)
        .collect()
}

/// Returns the node positions of all frames, upright, y up, in pixels of the neutral frame.
pub fn upright(
    model: &DynamicExpressionModel<Px>,
    frontal: &[Point2<f64>],
    tables: &Tables,
) -> Result<Vec<Vec<Point2<f64>>>, NormalizeError> {
    let (stable, corners) = (stable_nodes(tables, frontal.len()), EyeCorners::new(tables, frontal.len()));
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
            let neutral_from_frame = corners.similarity(&nodes, &neutral)?;
            Ok(nodes.iter().map(|p| unroll * neutral_from_frame.apply(p)).collect())
        })
        .collect()
}
