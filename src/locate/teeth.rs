//! Detects teeth between parted lips by colour.
//!
//! The locator reads grey pictures, in which a bright lower lip below a dark upper one looks like a row of teeth. In colour, lips are the
//! reddest and teeth the least red part of a face. If, on most of five lines across the mouth, the area below the upper lip's edge is less
//! red than skin and lips, and the area further down is redder again, the lower lip begins there.

use image::{RgbImage, imageops::interpolate_bilinear};
use nalgebra::{Point2, Vector2};

use super::{
    FacePart, LocatedFace,
    points::{EDGES, LIP_LINES, lip_lines},
};
use crate::robust::median;

/// Number of lines that are read: those of [`LIP_LINES`], and one between each two.
const READ_LINES: usize = 2 * LIP_LINES.len() - 1;
/// Start and end of a line, from the edge of the upper lip, and the sampling distance, over the eye distance.
const RANGE: (f64, f64, f64) = (-0.35, 0.75, 0.0125);
/// Distance of the additional samples to both sides, over the eye distance.
const BESIDE: f64 = 0.02;
/// Added to levels before the logarithm: darker pixels have no reliable colour.
const DARK: f64 = 8.0;
/// Distances over the eye distance: where skin begins above the upper lip, how far lips may reach below the lower one's edge, and where
/// teeth begin.
const SKIN_ABOVE: f64 = 0.04;
const LIP_BELOW: f64 = 0.25;
const TEETH_FROM: (f64, f64) = (-0.06, 0.08);
/// How much less red teeth are than skin, and than lips, as logarithms of red over green; and (`REDDER_BELOW`) how much redder the lip
/// below them is.
const LESS_RED: (f64, f64) = (0.04, 0.19);
const REDDER_BELOW: f64 = 0.15;
/// Smallest brightness of teeth, as a share of that of the skin: an open mouth without teeth is dark.
const LEAST_LIGHT: f64 = 0.45;
/// Number of samples below teeth within which the lip is searched for.
const LIP_WITHIN: usize = 11;
/// Smallest height of teeth, over the eye distance, as the median over the lines. On 120 closed mouths, 90 of them neutral, the height is
/// at most 0.0125; on 39 mouths open by 0.06 and more, 35 exceed the limit. It was chosen on the same people (the 90 of the London Set).
const LEAST: f64 = 0.03;
/// Distance between the lips' edges, over the eye distance, above which they were read as parted.
const PARTED: f64 = 0.02;
/// Smallest eye distance, px, at which mouths are examined.
const LEAST_EYE_DISTANCE: f64 = 30.0;
/// Median error of the edges, over the eye distance (the lower lip's upper edge, 36 smiles).
const EXPECTED_ERROR: f64 = 0.02;
/// Height assumed on lines without detected teeth, at the corners, as a share of the median height.
const OTHERWISE: f64 = 0.6;

impl LocatedFace {
    /// Moves the lower lip to its edge in colour, if the located lips are closed, or parted by less than the height of the teeth between
    /// them. Returns whether they are; never for a picture without colour.
    pub fn look_for_teeth(&mut self, picture: &RgbImage) -> bool {
        if self.eye_distance < LEAST_EYE_DISTANCE || self.covered.contains(&FacePart::Mouth) {
            return false;
        }
        let heights: [f64; READ_LINES] = std::array::from_fn(|k| self.teeth_on(k, picture).unwrap_or(0.0));
        let Some(usual) = median(&mut heights.clone()).filter(|height| *height >= LEAST) else { return false };
        let gaps = lip_lines().map(|[_, upper, lower, _]| (self.shape[lower] - self.shape[upper]).norm() / self.eye_distance);
        if usual - gaps[1] < LEAST {
            return false;
        }
        for (k, line) in lip_lines().into_iter().enumerate() {
            let height = if heights[2 * k] > 0.0 { heights[2 * k] } else { OTHERWISE * usual };
            let [start, _, lower, end] = line;
            let step = (height - gaps[k]).max(0.0);
            let down = (self.shape[end] - self.shape[start]).try_normalize(0.0).unwrap_or(Vector2::y());
            // The lower edge of a closed lip moves with the upper one; that of a parted lip is known, but is no thinner than half.
            let thickness = (self.shape[end] - self.shape[lower]).dot(&down) / self.eye_distance;
            let end_step = if gaps[1] > PARTED { (step - 0.5 * thickness).max(0.0) } else { step };
            self.move_point(lower, down * (step * self.eye_distance));
            self.move_point(end, down * (end_step * self.eye_distance));
        }
        true
    }

    fn move_point(&mut self, point: usize, way: Vector2<f64>) {
        self.shape[point] += way;
        let expected = self.expected_errors[point].max(EXPECTED_ERROR * self.eye_distance);
        self.expected_errors[point] = expected;
        if let Some(node) = super::points()[point].node
            && let Some(found) = self.points.iter_mut().find(|p| p.node == node)
        {
            (found.position, found.expected_error) = (self.shape[point], expected);
        }
    }

    /// Returns the height of the teeth on a line, over the eye distance.
    fn teeth_on(&self, k: usize, picture: &RgbImage) -> Option<f64> {
        let lines = lip_lines();
        let (one, two) = (lines[k / 2], lines[k.div_ceil(2)]);
        let edges: [Point2<f64>; EDGES] =
            std::array::from_fn(|edge| nalgebra::center(&self.shape[one[edge]], &self.shape[two[edge]]));
        let unit = self.eye_distance;
        let down = (edges[3] - edges[0]).try_normalize(f64::EPSILON)?;
        // All distances are measured from the edge of the upper lip, over the eye distance.
        let (top, bottom) = ((edges[0] - edges[1]).dot(&down) / unit, (edges[3] - edges[1]).dot(&down) / unit);
        let count = ((RANGE.1 - RANGE.0) / RANGE.2).round() as usize;
        let places: Vec<f64> = (0..count).map(|i| RANGE.0 + RANGE.2 * i as f64).collect();
        let read: Option<Vec<(f64, f64)>> =
            places.iter().map(|at| red_and_light(picture, edges[1] + down * (at * unit), unit)).collect();
        let read = read?;
        let skin: Vec<usize> = (0..count).filter(|&i| places[i] < top - SKIN_ABOVE).collect();
        let of_skin = |of: fn(&(f64, f64)) -> f64| median(&mut skin.iter().map(|&i| of(&read[i])).collect::<Vec<_>>());
        let (skin_red, skin_light) = (of_skin(|place| place.0)?, of_skin(|place| place.1)?);
        let lips = (0..count).filter(|&i| places[i] > top && places[i] < bottom + LIP_BELOW);
        let lip_red = lips.map(|i| read[i].0).max_by(f64::total_cmp)?;
        let is_tooth = |i: usize| {
            let (red, light) = read[i];
            red < (skin_red - LESS_RED.0).min(lip_red - LESS_RED.1) && light > LEAST_LIGHT * skin_light
        };
        let first = (0..count).find(|&i| (TEETH_FROM.0..=TEETH_FROM.1).contains(&places[i]) && is_tooth(i))?;
        let end = (first..count).find(|&i| !is_tooth(i))?;
        let red = read[first..end].iter().map(|(red, _)| red).sum::<f64>() / (end - first) as f64;
        let below = read[end..count.min(end + LIP_WITHIN)].iter().map(|(red, _)| *red).max_by(f64::total_cmp)?;
        // The lower edge moves from the end of the upper lip to the end of the teeth.
        (below - red > REDDER_BELOW).then(|| (places[end - 1] + 0.5 * RANGE.2).max(0.0))
    }
}

/// Returns redness at a position, as the logarithm of red over green, and brightness, in levels; `None` outside the picture.
fn red_and_light(picture: &RgbImage, at: Point2<f64>, unit: f64) -> Option<(f64, f64)> {
    let mut sum = [0.0; 3];
    for beside in [-BESIDE, 0.0, BESIDE] {
        let colour = interpolate_bilinear(picture, (at.x + beside * unit) as f32, at.y as f32)?;
        (0..3).for_each(|c| sum[c] += f64::from(colour.0[c]) / 3.0);
    }
    let [red, green, blue] = sum;
    Some((((red + DARK) / (green + DARK)).ln(), 0.299 * red + 0.587 * green + 0.114 * blue))
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;
    use crate::modules::locate::{PUPILS, points};

    /// A face of skin, eyes 100 px apart, with lips 60 px wide from y 60 to 90 that meet at 75, and the colour `between` from 75 to
    /// `until`.
    fn face(between: [u8; 3], until: u32) -> (LocatedFace, RgbImage) {
        let picture = RgbImage::from_fn(200, 200, |x, y| {
            let mouth = (60..140).contains(&x);
            Rgb(match y {
                75.. if mouth && y < until => between,
                60..75 if mouth => [150, 80, 80],
                75.. if mouth && y < until.max(75) + 15 => [150, 80, 80],
                _ => [180, 140, 120],
            })
        });
        let mut shape = vec![Point2::new(100.0, 20.0); points().len()];
        (shape[PUPILS[0]], shape[PUPILS[1]]) = (Point2::new(150.0, 10.0), Point2::new(50.0, 10.0));
        for ([start, upper, lower, end], x) in lip_lines().into_iter().zip([120.0, 100.0, 80.0]) {
            for (point, y) in [(start, 60.0), (upper, 75.0), (lower, 75.0), (end, 90.0)] {
                shape[point] = Point2::new(x, y);
            }
        }
        let expected_errors = vec![1.0; shape.len()];
        let face =
            LocatedFace { points: Vec::new(), shape, expected_errors, eye_distance: 100.0, score: 1.0, covered: Vec::new() };
        (face, picture)
    }

    #[test]
    fn a_lower_lip_is_below_the_teeth_and_closed_lips_stay() {
        let [_, upper, lower, end] = lip_lines()[1];
        let (mut smile, picture) = face([190, 185, 170], 87);
        let was = smile.shape.clone();
        assert!(smile.look_for_teeth(&picture));
        // 12 px of teeth, sampled every 1.25 px.
        assert!((smile.shape[lower].y - was[lower].y - 12.0).abs() < 1.3, "{}", smile.shape[lower]);
        assert!((smile.shape[end].y - was[end].y - 12.0).abs() < 1.3 && smile.shape[upper] == was[upper]);
        assert_eq!(smile.expected_errors[lower], 2.0);
        // Where the lips were read as parted, but by less than the teeth, only the upper edge of the lower lip moves.
        let (mut half, _) = face([190, 185, 170], 87);
        lip_lines().into_iter().for_each(|[_, _, lower, end]| [lower, end].into_iter().for_each(|k| half.shape[k].y += 5.0));
        assert!(half.look_for_teeth(&picture));
        assert!((half.shape[lower].y - smile.shape[lower].y).abs() < 1.3, "{}", half.shape[lower]);
        assert_eq!(half.shape[end].y, was[end].y + 5.0);
        // Nothing happens once they are parted, where lips are closed, where the gap is dark, and without colour.
        assert!(!smile.look_for_teeth(&picture));
        for (between, until) in [([190, 185, 170], 75), ([190, 185, 170], 77), ([40, 25, 25], 87)] {
            let (mut closed, picture) = face(between, until);
            let was = closed.clone();
            assert!(!closed.look_for_teeth(&picture) && closed == was, "{between:?} {until}");
        }
        // A covered mouth has no lips, and those of a small face are not read.
        let (smile, picture) = face([190, 185, 170], 87);
        let mut covered = LocatedFace { covered: vec![FacePart::Mouth], ..smile.clone() };
        let mut small = LocatedFace { eye_distance: 29.0, ..smile };
        assert!(!covered.look_for_teeth(&picture) && !small.look_for_teeth(&picture));
        let grey = image::DynamicImage::ImageRgb8(picture).into_luma8();
        let (mut other, _) = face([190, 185, 170], 87);
        assert!(!other.look_for_teeth(&image::DynamicImage::ImageLuma8(grey).into_rgb8()));
        // A picture that ends at the chin does not panic.
        assert!(!other.look_for_teeth(&RgbImage::new(100, 80)));
    }
}
