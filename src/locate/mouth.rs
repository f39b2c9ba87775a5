//! Reads mouths that have moved: the other stages know neutral faces only, and put the corners of a broad smile's mouth too near to each
//! other and the lower lip of an open mouth on its teeth.
//!
//! Linear functions of what the local stages read around the lower face estimate how far the corners of the mouth have moved and how far the
//! lips are apart. If one of the two exceeds what most neutral faces show, further local stages, learned from smiles, open mouths and
//! neutral faces, move the points of the lower face, the more the further it exceeds that. All other faces keep the points of the other
//! stages.

use image::GrayImage;
use nalgebra::{Point2, Vector2};

use super::{
    PUPILS,
    expect::Reading,
    linear::dot,
    picture::{Picture, View},
    points,
    points::{lip_lines, points_of, pupils_apart},
    shape::{Point, Shape, between, distance},
    stages::{LocalStage, Placed},
};

/// Parts of the face whose points move with the mouth.
const MOVED: [&str; 6] = ["nose", "mouth corner", "lip", "hollow", "chin", "jaw"];

/// Distance of the inner edges of the lips, over the eye distance, up to which they are closed, and up to which they are closed if the
/// estimate of their distance does not exceed what most neutral faces show: a dark upper lip above a bright lower one looks parted.
const CLOSED: [f32; 2] = [0.025, 0.09];

/// Number of estimates: the motion of the corners of the mouth from the neutral face, and the distance between the lips; over the eye
/// distance.
pub const ESTIMATES: usize = 2;

/// Learned weights for moved mouths.
#[derive(Clone, Debug, PartialEq)]
pub struct MouthStage {
    /// Weights of each estimate: for each local stage, the descriptors around [`moved_points`].
    pub weights: [Vec<f32>; ESTIMATES],
    /// Constant of each estimate.
    pub base: [f32; ESTIMATES],
    /// For each estimate, the value up to which the mouth counts as still, and that from which the points of these stages are taken; between
    /// the two they are mixed.
    pub ramps: [[f32; 2]; ESTIMATES],
    /// Stages that move the points of the lower face.
    pub stages: Vec<LocalStage>,
    /// Median error of each of [`moved_points`] after the stages, over the eye distance.
    pub errors: Vec<f32>,
}

/// Returns the indices in [`points()`] of the points that move with the mouth.
pub fn moved_points() -> Vec<usize> {
    points_of(&MOVED)
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

/// Returns the part of a shape that moves with the mouth, placed as the whole shape.
pub fn placed_part(mean: &[Point], shape: &[Point]) -> Placed {
    let Placed { placement, points } = Placed::new(mean, shape);
    Placed { placement, points: moved_points().into_iter().map(|k| points[k]).collect() }
}

impl MouthStage {
    /// Returns the estimates in one view; 0 without descriptors. `looks`: descriptors of each local stage, the points one after the other.
    pub fn estimates(&self, looks: &[Vec<f32>]) -> [f32; ESTIMATES] {
        let read = around_moved(looks);
        let estimate =
            |k: usize| if read.len() == self.weights[k].len() { dot(&self.weights[k], &read) + self.base[k] } else { 0.0 };
        std::array::from_fn(estimate)
    }

    /// Returns the share of these stages in the points of a face, 0 to 1, from the estimates of both readings.
    pub fn share(&self, [one, two]: [[f32; ESTIMATES]; 2]) -> f32 {
        let shares =
            self.ramps.iter().zip(one).zip(two).map(|((&[from, to], one), two)| {
                ((0.5 * (one + two) - from) / (to - from).max(f32::MIN_POSITIVE)).clamp(0.0, 1.0)
            });
        shares.fold(0.0, f32::max)
    }

    /// Moves the points of a shape that move with the mouth and updates their expected errors (over the eye distance), if the mouth of the
    /// face has moved. `shape` is the mean of both readings; pixels of the picture.
    pub fn read(&self, picture: &Picture, mean: &[Point], readings: [&Reading; 2], shape: &mut [Point], expected: &mut [f32]) {
        let estimates = readings.map(|r| r.mouth);
        let share = self.share(estimates);
        if share == 0.0 {
            return;
        }
        let plain = self.refined(picture.view(false), mean, readings[0].shape.clone());
        let mirror = picture.view(true);
        let mirrored = mirror.turn_shape(&self.refined(mirror, mean, mirror.turn_shape(&readings[1].shape)));
        for (k, error) in moved_points().into_iter().zip(&self.errors) {
            shape[k] = between(shape[k], between(plain[k], mirrored[k], 0.5), share);
            // What looks unlike a face to the other stages does so here, too.
            expected[k] += share * (error.max((error * expected[k]).sqrt()) - expected[k]);
        }
        let [_, [_, parted]] = self.ramps;
        let is_parted = 0.5 * (estimates[0][1] + estimates[1][1]) >= parted;
        close_lips(shape, CLOSED[usize::from(!is_parted)]);
    }

    /// Returns a shape in pixels of a view after all stages.
    pub fn refined(&self, view: View<'_>, mean: &[Point], mut shape: Shape) -> Shape {
        for stage in &self.stages {
            let placed = placed_part(mean, &shape);
            let after = placed.moved(&stage.step(&stage.features(view, &placed)).step);
            moved_points().into_iter().zip(after).for_each(|(k, point)| shape[k] = point);
        }
        shape
    }
}

/// Margin of the part of a picture that is read, around the points that move with the mouth, over the eye distance.
const MARGIN: f64 = 0.6;

/// Pixels to which the corner of that part is rounded, so that its halved levels are those of the whole picture.
const GRID: u32 = 32;

/// Returns the part of a picture around the lower face, with its left and top edge; `None` if it is outside the picture.
pub fn part_of(image: &GrayImage, shape: &[Point2<f64>]) -> Option<(u32, u32, GrayImage)> {
    let unit = (shape.get(PUPILS[0])? - shape.get(PUPILS[1])?).norm();
    let margin = Vector2::repeat(MARGIN * unit);
    let (mut low, mut high) = (shape[PUPILS[0]], shape[PUPILS[0]]);
    for p in moved_points().into_iter().filter_map(|k| shape.get(k)) {
        (low, high) = (low.inf(p), high.sup(p));
    }
    let (low, high) = (low - margin, high + margin);
    let start = |at: f64| at.max(0.0) as u32 / GRID * GRID;
    let (left, top) = (start(low.x), start(low.y));
    let end = |at: f64, most: u32| (at.max(0.0).ceil() as u32).min(most);
    let width = end(high.x, image.width()).checked_sub(left).filter(|w| *w > 0)?;
    let height = end(high.y, image.height()).checked_sub(top).filter(|h| *h > 0)?;
    Some((left, top, image::imageops::crop_imm(image, left, top, width, height).to_image()))
}

/// Closes lips whose inner edges are at most `closed` eye distances apart: both edges of each line move to their middle.
fn close_lips(shape: &mut [Point], closed: f32) {
    let unit = pupils_apart(shape);
    let [_, upper, lower, _] = lip_lines()[1];
    if distance(shape[upper], shape[lower]) > closed * unit {
        return;
    }
    for [_, upper, lower, _] in lip_lines() {
        let middle = between(shape[upper], shape[lower], 0.5);
        (shape[upper], shape[lower]) = (middle, middle);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modules::locate::{cells::Patch, model::Model};

    fn stage(weights: [Vec<f32>; ESTIMATES], base: f32, stages: Vec<LocalStage>) -> MouthStage {
        MouthStage {
            weights,
            base: [base; ESTIMATES],
            ramps: [[0.03, 0.07], [0.05, 0.15]],
            stages,
            errors: vec![0.02; moved_points().len()],
        }
    }

    #[test]
    fn motion_is_estimated_around_the_lower_face_only() {
        let (count, moved) = (points().len(), moved_points());
        assert!(moved.len() > 25 && moved.iter().all(|&k| points()[k].group != "brow"));
        let weights: Vec<f32> = vec![1.0; moved.len()].into_iter().chain(vec![0.5; 2 * moved.len()]).collect();
        let stage = stage([weights.clone(), weights.iter().map(|w| 2.0 * w).collect()], -1.0, Vec::new());
        // One number around each point in the first local stage, two in the second; only the points that move are not zero.
        let look = |length: usize, value: f32| {
            let is_moved = |k: usize| moved.contains(&(k / length));
            (0..count * length).map(|k| if is_moved(k) { value } else { 100.0 }).collect::<Vec<f32>>()
        };
        let n = moved.len() as f32;
        let [corners, lips] = stage.estimates(&[look(1, 0.25), look(2, 2.0)]);
        approx::assert_relative_eq!(corners, 0.25 * n + 2.0 * n - 1.0, epsilon = 1e-3);
        approx::assert_relative_eq!(lips, 2.0 * (0.25 * n + 2.0 * n) - 1.0, epsilon = 1e-3);
        // Without the descriptors of both stages nothing is estimated.
        assert_eq!(stage.estimates(&[look(1, 0.25)]), [0.0; 2]);
        // Means of both readings, each on its own ramp; the larger share counts.
        approx::assert_relative_eq!(stage.share([[0.03, 0.0], [0.05, 0.0]]), 0.25, epsilon = 1e-5);
        approx::assert_relative_eq!(stage.share([[0.03, 0.1], [0.05, 0.1]]), 0.5, epsilon = 1e-5);
        assert_eq!([stage.share([[0.01, 0.02], [0.04, 0.0]]), stage.share([[0.1, 0.0], [0.2, 0.0]])], [0.0, 1.0]);
    }

    #[test]
    fn a_moved_mouth_is_read_as_far_as_the_other_stages_are_off() {
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
        let stage = self::stage(Default::default(), 0.0, vec![stage]);
        let picture = Picture::new(&image::GrayImage::new(200, 200)).unwrap();
        let reading = |corners: f32| Reading {
            shape: shape.clone(),
            score: 1.0,
            last_step: Vec::new(),
            dissent: Vec::new(),
            seen: Vec::new(),
            mouth: [corners, 0.0],
        };
        let chin = points().iter().position(|p| p.group == "chin").unwrap();
        for (corners, share) in [(0.03, 0.0), (0.05, 0.5), (0.2, 1.0)] {
            let (mut read, mut expected) = (shape.clone(), vec![0.01; shape.len()]);
            expected[chin] = 0.04;
            stage.read(&picture, &mean, [&reading(corners), &reading(corners)], &mut read, &mut expected);
            // The corner of the mouth is on no line that is closed.
            let corner = points().iter().position(|p| p.group == "mouth corner").unwrap();
            approx::assert_relative_eq!(read[corner][0], shape[corner][0], epsilon = 0.01);
            approx::assert_relative_eq!(read[corner][1], shape[corner][1] + 10.0 * share, epsilon = 0.01);
            approx::assert_relative_eq!(expected[corner], 0.01 + 0.01 * share, epsilon = 1e-5);
            // The geometric mean of 0.02 and 0.04.
            approx::assert_relative_eq!(expected[chin], 0.04 + (0.028_284 - 0.04) * share, epsilon = 1e-5);
            // The eyes stay.
            assert!((0..shape.len()).filter(|k| !moved.contains(k)).all(|k| read[k] == shape[k] && expected[k] == 0.01));
        }
    }

    #[test]
    fn lips_that_nearly_touch_are_closed_and_parted_ones_are_not() {
        let mut shape = vec![[0.0, 0.0]; points().len()];
        shape[PUPILS[0]] = [100.0, 0.0];
        let [_, upper, lower, _] = lip_lines()[1];
        (shape[upper], shape[lower]) = ([50.0, 99.0], [50.0, 101.0]);
        let mut closed = shape.clone();
        close_lips(&mut closed, CLOSED[0]);
        assert_eq!((closed[upper], closed[lower]), ([50.0, 100.0], [50.0, 100.0]));
        shape[lower] = [50.0, 102.0];
        let mut parted = shape.clone();
        close_lips(&mut parted, CLOSED[0]);
        assert_eq!(parted, shape);
        close_lips(&mut parted, CLOSED[1]);
        assert_eq!(parted[upper], parted[lower]);
    }
}
