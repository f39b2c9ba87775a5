//! Stages of the locator: each reads the picture around the present points and moves them.
//!
//! Joint stages read around some of the points and move all of them together (explicit shape regression: Cao et al. 2012; Xiong and De la
//! Torre 2013). Local stages predict a step for each point from its own neighbourhood, and then combine the predictions of all points.

use super::{
    cells::{CellMap, Patch},
    linear::dot,
    picture::View,
    shape::{Placement, Point, Shape, distance},
};

/// A shape in the canonical frame with its placement in the view.
#[derive(Clone, Debug)]
pub struct Placed {
    /// Maps canonical coordinates to pixels of the view.
    pub placement: Placement,
    /// The shape in canonical coordinates.
    pub points: Shape,
}

impl Placed {
    /// Aligns a shape in pixels of the view with the mean face.
    pub fn new(mean: &[Point], shape: &[Point]) -> Self {
        let placement = Placement::fit(mean, shape);
        Self { placement, points: shape.iter().map(|&p| placement.invert(p)).collect() }
    }

    /// Returns the shape moved by canonical steps (alternating x and y of each point), in pixels of the view.
    pub fn moved(&self, steps: &[f32]) -> Shape {
        self.points.iter().zip(steps.chunks_exact(2)).map(|(p, s)| self.placement.apply([p[0] + s[0], p[1] + s[1]])).collect()
    }
}

/// A stage that moves all points together: `base + up (down (x - offset))`, where x are the features around the feature points.
#[derive(Clone, Debug, PartialEq)]
pub struct JointStage {
    /// Geometry of the features around each feature point.
    pub patch: Patch,
    /// Mean of the features.
    pub offset: Vec<f32>,
    /// Rank x number of features, row by row.
    pub down: Vec<f32>,
    /// Number of step values x rank, row by row.
    pub up: Vec<f32>,
    /// Mean step.
    pub base: Vec<f32>,
}

impl JointStage {
    /// Returns the features around the feature points.
    pub fn features(&self, view: View<'_>, placed: &Placed, feature_points: &[usize]) -> Vec<f32> {
        joint_features(&self.patch, view, placed, feature_points)
    }

    /// Returns the step for given features.
    pub fn step(&self, features: &[f32]) -> Vec<f32> {
        let centred: Vec<f32> = features.iter().zip(&self.offset).map(|(x, o)| x - o).collect();
        let hidden: Vec<f32> = self.down.chunks_exact(centred.len().max(1)).map(|row| dot(row, &centred)).collect();
        let rows = self.up.chunks_exact(hidden.len().max(1));
        rows.zip(&self.base).map(|(row, base)| base + dot(row, &hidden)).collect()
    }
}

/// Returns the features around the feature points of a joint stage.
pub fn joint_features(patch: &Patch, view: View<'_>, placed: &Placed, feature_points: &[usize]) -> Vec<f32> {
    let points: Shape = feature_points.iter().map(|&k| placed.points[k]).collect();
    let map = CellMap::new(view, placed.placement, patch, &points);
    let mut features = Vec::with_capacity(points.len() * patch.len());
    points.iter().for_each(|&p| map.describe(p, patch, &mut features));
    features
}

/// A stage that predicts a step for each point from its own neighbourhood, and then combines all predictions.
#[derive(Clone, Debug, PartialEq)]
pub struct LocalStage {
    /// Geometries of the features around each point.
    pub patches: Vec<Patch>,
    /// Means of the features: points x number of features.
    pub offset: Vec<f32>,
    /// Weights: points x 2 x number of features.
    pub weights: Vec<f32>,
    /// Mean step.
    pub base: Vec<f32>,
    /// Square matrix that combines the predictions of all points into their steps.
    pub mix: Vec<f32>,
}

/// Result of a local stage.
#[derive(Clone, Debug)]
pub struct LocalStep {
    /// Step in canonical coordinates: alternating x and y of each point.
    pub step: Vec<f32>,
    /// Distance from each point's own prediction to the combined one, eye distances.
    pub dissent: Vec<f32>,
}

impl LocalStage {
    /// Returns the features around each point, the points one after the other.
    pub fn features(&self, view: View<'_>, placed: &Placed) -> Vec<f32> {
        local_features(&self.patches, view, placed)
    }

    /// Returns the step for given features.
    pub fn step(&self, features: &[f32]) -> LocalStep {
        let length = self.patches.iter().map(Patch::len).sum::<usize>().max(1);
        let centred: Vec<f32> = features.iter().zip(&self.offset).map(|(x, o)| x - o).collect();
        let rows = self.weights.chunks_exact(length).enumerate();
        let own: Vec<f32> = rows.map(|(k, row)| dot(row, &centred[k / 2 * length..][..length])).collect();
        let mixed: Vec<f32> = self.mix.chunks_exact(own.len().max(1)).map(|row| dot(row, &own)).collect();
        let pairs = own.chunks_exact(2).zip(mixed.chunks_exact(2));
        let dissent = pairs.map(|(o, m)| distance([o[0], o[1]], [m[0], m[1]])).collect();
        LocalStep { step: mixed.iter().zip(&self.base).map(|(m, b)| m + b).collect(), dissent }
    }
}

/// Returns the features around each point, the points one after the other.
pub fn local_features(patches: &[Patch], view: View<'_>, placed: &Placed) -> Vec<f32> {
    let maps: Vec<CellMap> = patches.iter().map(|patch| CellMap::new(view, placed.placement, patch, &placed.points)).collect();
    let mut features = Vec::with_capacity(placed.points.len() * patches.iter().map(Patch::len).sum::<usize>());
    for &point in &placed.points {
        maps.iter().zip(patches).for_each(|(map, patch)| map.describe(point, patch, &mut features));
    }
    features
}
