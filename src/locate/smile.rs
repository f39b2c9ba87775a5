//! Reads smiling faces: the other stages know neutral faces only, and put the corners of a broad smile's mouth too near to each other.
//!
//! A linear function of what the local stages read around the lower face estimates how far the corners of the mouth have moved. If that
//! exceeds what most neutral faces show, further local stages, learned from smiles and neutral faces, move the points of the lower face, the
//! more the further it exceeds that. All other faces keep the points of the other stages.

use super::{
    PUPILS,
    expect::Reading,
    linear::dot,
    lips::{between, line_points},
    picture::{Picture, View},
    points,
    shape::{Point, Shape, distance},
    stages::{LocalStage, Placed},
};

/// Parts of the face whose points a smile moves.
const MOVED: [&str; 6] = ["nose", "mouth corner", "lip", "hollow", "chin", "jaw"];

/// Distance of the inner edges of the lips, over the eye distance, up to which they are closed.
const CLOSED: f32 = 0.025;

/// Learned weights for smiles.
#[derive(Clone, Debug, PartialEq)]
pub struct SmileStage {
    /// Weights of the estimate: for each local stage, the descriptors around [`moved_points`].
    pub weights: Vec<f32>,
    /// Constant of the estimate.
    pub base: f32,
    /// Estimated motion of the corners of the mouth, over the eye distance, up to which a face does not smile, and from which the points
    /// of the smile stages are taken; between the two they are mixed.
    pub ramp: [f32; 2],
    /// Stages that move the points of the lower face.
    pub stages: Vec<LocalStage>,
    /// Median error of each of [`moved_points`] on smiles, over the eye distance.
    pub errors: Vec<f32>,
}

/// Returns the indices in [`points()`] of the points that a smile moves.
pub fn moved_points() -> Vec<usize> {
    (0..points().len()).filter(|&k| MOVED.contains(&points()[k].group.as_str())).collect()
}

/// Returns the descriptors around [`moved_points`] among those around all points, of each local stage.
pub fn around_moved(looks: &[Vec<f32>]) -> Vec<f32> {
    let moved = moved_points();
    let mut read = Vec::new();
    for look in looks {
        let length = look.len() / points().len();
        moved.iter().for_each(|k| read.extend(&look[k * length..][..length]));
    }
    read
}

/// Returns the part of a shape that a smile moves, placed as the whole shape.
pub fn placed_part(mean: &[Point], shape: &[Point]) -> Placed {
    let Placed { placement, points } = Placed::new(mean, shape);
    Placed { placement, points: moved_points().into_iter().map(|k| points[k]).collect() }
}

impl SmileStage {
    /// Returns the estimated motion of the corners of the mouth, over the eye distance, in one view. `looks`: descriptors of each local
    /// stage, the points one after the other.
    pub fn amount(&self, looks: &[Vec<f32>]) -> f32 {
        let read = around_moved(looks);
        if read.len() == self.weights.len() { dot(&self.weights, &read) + self.base } else { 0.0 }
    }

    /// Returns the share of the smile reading in the points of a face, 0 to 1, from the estimates of both readings.
    pub fn share(&self, amounts: [f32; 2]) -> f32 {
        let [from, to] = self.ramp;
        ((0.5 * (amounts[0] + amounts[1]) - from) / (to - from).max(f32::MIN_POSITIVE)).clamp(0.0, 1.0)
    }

    /// Returns the points that a smile moves, with their indices in [`points()`] and expected errors (over the eye distance); `None` for a
    /// face that does not smile. `shape` is the mean of both readings, with the lips as read; pixels of the picture.
    pub fn read(
        &self,
        picture: &Picture,
        mean: &[Point],
        readings: [&Reading; 2],
        shape: &[Point],
    ) -> Option<Vec<(usize, Point, f32)>> {
        let share = self.share(readings.map(|r| r.smile));
        if share == 0.0 {
            return None;
        }
        let plain = self.refined(picture.view(false), mean, readings[0].shape.clone());
        let mirror = picture.view(true);
        let mirrored = mirror.turn_shape(&self.refined(mirror, mean, mirror.turn_shape(&readings[1].shape)));
        let mut moved = shape.to_vec();
        for k in moved_points() {
            let smiling = between(plain[k], mirrored[k], 0.5);
            moved[k] = between(shape[k], smiling, share);
        }
        close_lips(&mut moved);
        Some(moved_points().into_iter().zip(&self.errors).map(|(k, &error)| (k, moved[k], share * error)).collect())
    }

    /// Returns a shape in pixels of a view after all stages.
    fn refined(&self, view: View<'_>, mean: &[Point], mut shape: Shape) -> Shape {
        for stage in &self.stages {
            let placed = placed_part(mean, &shape);
            let after = placed.moved(&stage.step(&stage.features(view, &placed)).step);
            moved_points().into_iter().zip(after).for_each(|(k, point)| shape[k] = point);
        }
        shape
    }
}

/// Closes lips whose inner edges are nearly at one place: both edges of each line move to their middle.
fn close_lips(shape: &mut [Point]) {
    let unit = distance(shape[PUPILS[0]], shape[PUPILS[1]]);
    let [_, upper, lower, _] = line_points()[1];
    if distance(shape[upper], shape[lower]) > CLOSED * unit {
        return;
    }
    for [_, upper, lower, _] in line_points() {
        let middle = between(shape[upper], shape[lower], 0.5);
        (shape[upper], shape[lower]) = (middle, middle);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modules::locate::{cells::Patch, model::Model};

    #[test]
    fn the_amount_is_read_around_the_lower_face_only() {
        let (count, moved) = (points().len(), moved_points());
        assert!(moved.len() > 25 && moved.iter().all(|&k| points()[k].group != "brow"));
        let stage = SmileStage {
            weights: vec![1.0; moved.len()].into_iter().chain(vec![0.5; 2 * moved.len()]).collect(),
            base: -1.0,
            ramp: [0.03, 0.07],
            stages: Vec::new(),
            errors: vec![0.02; moved.len()],
        };
        // One number around each point in the first local stage, two in the second; only the points that move are not zero.
        let look = |length: usize, value: f32| {
            let is_moved = |k: usize| moved.contains(&(k / length));
            (0..count * length).map(|k| if is_moved(k) { value } else { 100.0 }).collect::<Vec<f32>>()
        };
        let n = moved.len() as f32;
        approx::assert_relative_eq!(stage.amount(&[look(1, 0.25), look(2, 2.0)]), 0.25 * n + 2.0 * n - 1.0, epsilon = 1e-3);
        // Without the descriptors of both stages nothing is estimated.
        assert_eq!(stage.amount(&[look(1, 0.25)]), 0.0);
        approx::assert_relative_eq!(stage.share([0.03, 0.05]), 0.25, epsilon = 1e-5);
        assert_eq!([stage.share([0.01, 0.04]), stage.share([0.1, 0.2])], [0.0, 1.0]);
    }

    #[test]
    fn a_smile_moves_the_lower_face_as_far_as_it_is_one() {
        let (moved, mean) = (moved_points(), Model::shipped().unwrap().mean);
        let shape: Shape = mean.iter().map(|p| [100.0 * p[0] + 100.0, 100.0 * p[1] + 50.0]).collect();
        let patch = Patch { size: 24.0, cell: 0.2, side: 2, blur: 1 };
        // Every point of the lower face moves down by a tenth of the eye distance, whatever is read.
        let stage = LocalStage {
            patches: vec![patch],
            offset: vec![0.0; moved.len() * patch.len()],
            weights: vec![0.0; 2 * moved.len() * patch.len()],
            base: [0.0, 0.1].repeat(moved.len()),
            mix: vec![0.0; 4 * moved.len() * moved.len()],
        };
        let stage = SmileStage {
            weights: Vec::new(),
            base: 0.0,
            ramp: [0.03, 0.07],
            stages: vec![stage],
            errors: vec![0.02; moved.len()],
        };
        let picture = Picture::new(&image::GrayImage::new(200, 200)).unwrap();
        let reading = |smile: f32| Reading {
            shape: shape.clone(),
            score: 1.0,
            last_step: Vec::new(),
            dissent: Vec::new(),
            seen: Vec::new(),
            smile,
        };
        let read = |smile: f32| stage.read(&picture, &mean, [&reading(smile), &reading(smile)], &shape);
        assert_eq!(read(0.03), None);
        for (smile, share) in [(0.05, 0.5), (0.2, 1.0)] {
            let found = read(smile).unwrap();
            assert_eq!(found.iter().map(|f| f.0).collect::<Vec<_>>(), moved);
            // The corner of the mouth is on no line that is closed.
            let (_, corner, error) = found[moved.iter().position(|&k| k == 48).unwrap()];
            approx::assert_relative_eq!(corner[0], shape[48][0], epsilon = 0.01);
            approx::assert_relative_eq!(corner[1], shape[48][1] + 10.0 * share, epsilon = 0.01);
            approx::assert_relative_eq!(error, 0.02 * share, epsilon = 1e-5);
        }
    }

    #[test]
    fn lips_that_nearly_touch_are_closed_and_parted_ones_are_not() {
        let mut shape = vec![[0.0, 0.0]; points().len()];
        shape[PUPILS[0]] = [100.0, 0.0];
        let [_, upper, lower, _] = line_points()[1];
        (shape[upper], shape[lower]) = ([50.0, 99.0], [50.0, 101.0]);
        let mut closed = shape.clone();
        close_lips(&mut closed);
        assert_eq!((closed[upper], closed[lower]), ([50.0, 100.0], [50.0, 100.0]));
        shape[lower] = [50.0, 102.0];
        let mut parted = shape.clone();
        close_lips(&mut parted);
        assert_eq!(parted, shape);
    }
}
