//! The stages of the locator: each looks at the picture where the points are, and moves them.
//!
//! Joint stages look around some of the points and move all of them together (explicit shape regression: Cao et al. 2012; Xiong and De
//! la Torre 2013). Local stages let each point look around itself, and then weigh what all of them say.

use super::{
    cells::{CellMap, Patch},
    linear::dot,
    picture::View,
    shape::{Placement, Point, Shape, distance},
};

/// A shape in the canonical frame and where that lies in the view.
#[derive(Clone, Debug)]
pub struct Placed {
    /// View pixels from canonical.
    pub placement: Placement,
    /// The shape, canonical.
    pub points: Shape,
}

impl Placed {
    /// A shape in pixels of the view, laid on the mean face.
    pub fn new(mean: &[Point], shape: &[Point]) -> Self {
        let placement = Placement::fit(mean, shape);
        Self { placement, points: shape.iter().map(|&p| placement.invert(p)).collect() }
    }

    /// The shape moved by canonical steps (x and y of each point in turn), in pixels of the view.
    pub fn moved(&self, steps: &[f32]) -> Shape {
        self.points.iter().zip(steps.chunks_exact(2)).map(|(p, s)| self.placement.apply([p[0] + s[0], p[1] + s[1]])).collect()
    }
}

/// A stage that moves all points together: `base + up (down (x - offset))` of what is around the feature points.
#[derive(Clone, Debug, PartialEq)]
pub struct JointStage {
    /// What is read around each feature point.
    pub patch: Patch,
    /// Mean of what is read.
    pub offset: Vec<f32>,
    /// Rank x numbers read, row by row.
    pub down: Vec<f32>,
    /// Numbers of a step x rank, row by row.
    pub up: Vec<f32>,
    /// Mean step.
    pub base: Vec<f32>,
}

impl JointStage {
    /// What is around the feature points.
    pub fn features(&self, view: View<'_>, placed: &Placed, feature_points: &[usize]) -> Vec<f32> {
        joint_features(&self.patch, view, placed, feature_points)
    }

    /// The step for what was read.
    pub fn step(&self, features: &[f32]) -> Vec<f32> {
        let centred: Vec<f32> = features.iter().zip(&self.offset).map(|(x, o)| x - o).collect();
        let hidden: Vec<f32> = self.down.chunks_exact(centred.len().max(1)).map(|row| dot(row, &centred)).collect();
        let rows = self.up.chunks_exact(hidden.len().max(1));
        rows.zip(&self.base).map(|(row, base)| base + dot(row, &hidden)).collect()
    }
}

/// What is around the feature points of a joint stage.
pub fn joint_features(patch: &Patch, view: View<'_>, placed: &Placed, feature_points: &[usize]) -> Vec<f32> {
    let points: Shape = feature_points.iter().map(|&k| placed.points[k]).collect();
    let map = CellMap::new(view, placed.placement, patch, &points);
    let mut features = Vec::with_capacity(points.len() * patch.len());
    points.iter().for_each(|&p| map.describe(p, patch, &mut features));
    features
}

/// A stage in which each point is moved by what is around itself, and then all by what all say.
#[derive(Clone, Debug, PartialEq)]
pub struct LocalStage {
    /// What is read around each point.
    pub patches: Vec<Patch>,
    /// Points x numbers read: their means.
    pub offset: Vec<f32>,
    /// Points x 2 x numbers read.
    pub weights: Vec<f32>,
    /// Mean step.
    pub base: Vec<f32>,
    /// The steps of all points from what each says, square.
    pub mix: Vec<f32>,
}

/// What a local stage says.
#[derive(Clone, Debug)]
pub struct LocalStep {
    /// The step, canonical: x and y of each point in turn.
    pub step: Vec<f32>,
    /// How far each point by itself would have gone elsewhere, eye distances.
    pub dissent: Vec<f32>,
}

impl LocalStage {
    /// What is around each point, the points one after the other.
    pub fn features(&self, view: View<'_>, placed: &Placed) -> Vec<f32> {
        local_features(&self.patches, view, placed)
    }

    /// The step for what was read.
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

/// What is around each point, the points one after the other.
pub fn local_features(patches: &[Patch], view: View<'_>, placed: &Placed) -> Vec<f32> {
    let maps: Vec<CellMap> = patches.iter().map(|patch| CellMap::new(view, placed.placement, patch, &placed.points)).collect();
    let mut features = Vec::with_capacity(placed.points.len() * patches.iter().map(Patch::len).sum::<usize>());
    for &point in &placed.points {
        maps.iter().zip(patches).for_each(|(map, patch)| map.describe(point, patch, &mut features));
    }
    features
}
