//! Detects teeth between parted lips by colour.
//!
//! The locator reads grey pictures, in which a bright lower lip below a dark upper one looks like a row of teeth, and a dark line between
//! two rows of teeth, or below one, like the line of closed lips. In colour, lips are the reddest and teeth the least red part of a face. If, on
//! most of five lines across the mouth, the area around the located line is less red than skin and lips, and redder again above and below,
//! the upper lip ends and the lower lip begins there.

use image::{RgbImage, imageops::interpolate_bilinear};
use nalgebra::{Point2, Vector2};

use super::{
    FacePart, LocatedFace,
    points::{EDGES, LIP_LINES, lip_lines},
};
use crate::robust::median;

/// Number of lines that are read: those of [`LIP_LINES`], and one between each two.
const READ_LINES: usize = 2 * LIP_LINES.len() - 1;
/// Length read to both sides of the middle between the lips, and the sampling distance, over the eye distance.
const RANGE: (f64, f64) = (0.45, 0.0125);
/// Distance of the additional samples to both sides, over the eye distance.
const BESIDE: f64 = 0.02;
/// Added to levels before the logarithm: darker pixels have no reliable colour.
const DARK: f64 = 8.0;
/// Distances over the eye distance: where skin begins above the upper lip, how far lips may reach beyond the upper one's upper and the lower
/// one's lower edge, and how far teeth may begin from the middle between the lips.
const SKIN_ABOVE: f64 = 0.04;
const LIP_BEYOND: (f64, f64) = (0.05, 0.15);
const TEETH_WITHIN: f64 = 0.08;
/// How much less red teeth are than skin, and than lips, as logarithms of red over green; and (`REDDER`) how much redder the lips above and
/// below them are.
const LESS_RED: (f64, f64) = (0.04, 0.19);
const REDDER: f64 = 0.15;
/// Smallest brightness of teeth, as a share of that of the skin: an open mouth without teeth is dark.
const LEAST_LIGHT: f64 = 0.45;
/// Number of samples above and below teeth within which the lips are searched for.
const LIP_WITHIN: usize = 11;
/// Smallest height of teeth, over the eye distance, as the median over the lines. On 90 neutral mouths no height exceeds 0.01; of 45 smiles that
/// show teeth, 42 exceed the limit. It was chosen on the same people (the 90 of the London Set).
const LEAST: f64 = 0.03;
/// Smallest difference, over the eye distance, between this height and that of the located opening, below which nothing is changed.
const LEAST_CHANGE: f64 = 0.02;
/// Distance between the lips' edges, over the eye distance, above which they were read as parted.
const PARTED: f64 = 0.02;
/// Smallest eye distance, px, at which mouths are examined.
const LEAST_EYE_DISTANCE: f64 = 30.0;
/// Median error of the edges, over the eye distance (the lower lip's upper edge, 36 smiles).
const EXPECTED_ERROR: f64 = 0.02;
/// Step of an edge on lines without detected teeth, at the corners, as a share of the median step; and the largest step, as a multiple of it.
const OTHERWISE: f64 = 0.6;
const LARGEST: f64 = 1.5;
/// Largest share of the located upper lip that may turn out to be teeth.
const OF_UPPER_LIP: f64 = 0.6;

impl LocatedFace {
    /// Moves the lips' inner edges to where teeth begin and end in colour, if the located lips are closed, or parted by less than the height of
    /// the teeth between them. Returns whether they are; never for a picture without colour.
    pub fn look_for_teeth(&mut self, picture: &RgbImage) -> bool {
        if self.eye_distance < LEAST_EYE_DISTANCE || self.covered.contains(&FacePart::Mouth) {
            return false;
        }
        let lips = lip_lines().map(|line| line.map(|point| self.shape[point]));
        let colour =
            |at: Point2<f64>| interpolate_bilinear(picture, at.x as f32, at.y as f32).map(|colour| colour.0.map(f64::from));
        let Some(steps) = steps_to_teeth(&lips, self.eye_distance, colour) else { return false };
        for (points, ways) in lip_lines().into_iter().zip(steps) {
            points.into_iter().zip(ways).for_each(|(point, way)| self.move_point(point, way));
        }
        true
    }

    fn move_point(&mut self, point: usize, way: Vector2<f64>) {
        if way == Vector2::zeros() {
            return;
        }
        self.shape[point] += way;
        let expected = self.expected_errors[point].max(EXPECTED_ERROR * self.eye_distance);
        self.expected_errors[point] = expected;
        if let Some(node) = super::points()[point].node
            && let Some(found) = self.points.iter_mut().find(|p| p.node == node)
        {
            (found.position, found.expected_error) = (self.shape[point], expected);
        }
    }
}

/// Edges of the lips on the lines of [`LIP_LINES`], px, or steps of them.
pub type LipEdges<T> = [[T; EDGES]; LIP_LINES.len()];

/// Returns by how much the edges of the lips move, px, so that the teeth which `colour` shows lie between them; `None` if it shows no teeth that
/// reach beyond the inner edges. `colour` returns levels of red, green and blue, or `None` outside the picture.
pub fn steps_to_teeth(
    lips: &LipEdges<Point2<f64>>,
    eye_distance: f64,
    colour: impl Fn(Point2<f64>) -> Option<[f64; 3]>,
) -> Option<LipEdges<Vector2<f64>>> {
    let teeth: [Option<Teeth>; READ_LINES] = std::array::from_fn(|k| {
        let (one, two) = (&lips[k / 2], &lips[k.div_ceil(2)]);
        Teeth::on(&std::array::from_fn(|edge| nalgebra::center(&one[edge], &two[edge])), eye_distance, &colour)
    });
    let of =
        |value: fn(&Teeth) -> f64| median(&mut teeth.iter().map(|line| line.as_ref().map_or(0.0, value)).collect::<Vec<_>>());
    let (height, rise, drop) = (of(|t| t.height)?, of(|t| t.rise)?, of(|t| t.drop)?);
    let gap = (lips[1][2] - lips[1][1]).norm() / eye_distance;
    if height < LEAST || height - gap < LEAST_CHANGE {
        return None;
    }
    let mut line = 0;
    Some(lips.map(|[start, upper, lower, end]| {
        let own =
            |of: fn(&Teeth) -> f64, usual: f64| teeth[line].as_ref().map_or(OTHERWISE * usual, |t| of(t).min(LARGEST * usual));
        let down = (end - start).try_normalize(0.0).unwrap_or(Vector2::y());
        let thickness = |from: Point2<f64>, to: Point2<f64>| (to - from).dot(&down).max(0.0) / eye_distance;
        let rise = own(|t| t.rise, rise).min(OF_UPPER_LIP * thickness(start, upper));
        let drop = own(|t| t.drop, drop);
        // The lower edge of a closed lip moves with the upper one; that of a parted lip is known, but is no thinner than half.
        let end_drop = if gap > PARTED { (drop - 0.5 * thickness(lower, end)).max(0.0) } else { drop };
        line += 2;
        [0.0, -rise, drop, end_drop].map(|step| down * (step * eye_distance))
    }))
}

/// Teeth on a line across the mouth, in eye distances.
struct Teeth {
    height: f64,
    /// Distances by which they reach above the upper lip's lower edge, and below the lower lip's upper edge.
    rise: f64,
    drop: f64,
}

impl Teeth {
    /// Returns the teeth on the line through the edges of the lips.
    fn on(edges: &[Point2<f64>; EDGES], unit: f64, colour: &impl Fn(Point2<f64>) -> Option<[f64; 3]>) -> Option<Self> {
        let down = (edges[3] - edges[0]).try_normalize(f64::EPSILON)?;
        // All distances are measured from the middle between the lips, over the eye distance.
        let middle = nalgebra::center(&edges[1], &edges[2]);
        let [top, upper, lower, bottom] = edges.map(|edge| (edge - middle).dot(&down) / unit);
        let side = (RANGE.0 / RANGE.1).round() as usize;
        let count = 2 * side + 1;
        let places: Vec<f64> = (0..count).map(|i| RANGE.1 * (i as f64 - side as f64)).collect();
        let read: Option<Vec<(f64, f64)>> =
            places.iter().map(|at| red_and_light(colour, middle + down * (at * unit), unit)).collect();
        let read = read?;
        let skin: Vec<usize> = (0..count).filter(|&i| places[i] < top - SKIN_ABOVE).collect();
        let of_skin = |of: fn(&(f64, f64)) -> f64| median(&mut skin.iter().map(|&i| of(&read[i])).collect::<Vec<_>>());
        let (skin_red, skin_light) = (of_skin(|place| place.0)?, of_skin(|place| place.1)?);
        let lips = (0..count).filter(|&i| places[i] > top - LIP_BEYOND.0 && places[i] < bottom + LIP_BEYOND.1);
        let lip_red = lips.map(|i| read[i].0).max_by(f64::total_cmp)?;
        let is_tooth = |i: usize| {
            let (red, light) = read[i];
            red < (skin_red - LESS_RED.0).min(lip_red - LESS_RED.1) && light > LEAST_LIGHT * skin_light
        };
        let within = (TEETH_WITHIN / RANGE.1).round() as usize;
        let nearest = (0..=within).flat_map(|step| [side - step, side + step]).find(|&i| is_tooth(i))?;
        let first = (0..nearest).rev().find(|&i| !is_tooth(i))? + 1;
        let end = (nearest..count).find(|&i| !is_tooth(i))?;
        let red = read[first..end].iter().map(|(red, _)| red).sum::<f64>() / (end - first) as f64;
        let reddest = |lip: &[(f64, f64)]| lip.iter().map(|(red, _)| *red).max_by(f64::total_cmp);
        let above = reddest(&read[first.saturating_sub(LIP_WITHIN)..first])?;
        let below = reddest(&read[end..count.min(end + LIP_WITHIN)])?;
        let (start, stop) = (places[first] - 0.5 * RANGE.1, places[end - 1] + 0.5 * RANGE.1);
        let teeth = Self { height: stop - start, rise: (upper - start).max(0.0), drop: (stop - lower).max(0.0) };
        (above.min(below) - red > REDDER).then_some(teeth)
    }
}

/// Returns redness at a position, as the logarithm of red over green, and brightness, in levels; `None` outside the picture.
fn red_and_light(colour: &impl Fn(Point2<f64>) -> Option<[f64; 3]>, at: Point2<f64>, unit: f64) -> Option<(f64, f64)> {
    let mut sum = [0.0; 3];
    for beside in [-BESIDE, 0.0, BESIDE] {
        let seen = colour(at + Vector2::new(beside * unit, 0.0))?;
        (0..3).for_each(|c| sum[c] += seen[c] / 3.0);
    }
    let [red, green, blue] = sum;
    Some((redness(red, green), 0.299 * red + 0.587 * green + 0.114 * blue))
}

/// Redness of a colour, as the logarithm of red over green, from levels.
pub fn redness(red: f64, green: f64) -> f64 {
    ((red + DARK) / (green + DARK)).ln()
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
        assert!((smile.shape[end].y - was[end].y - 12.0).abs() < 1.3 && (smile.shape[upper] - was[upper]).norm() < 0.7);
        assert_eq!(smile.expected_errors[lower], 2.0);
        // Where the lips were read as parted, but by less than the teeth, only the upper edge of the lower lip moves.
        let (mut half, _) = face([190, 185, 170], 87);
        lip_lines().into_iter().for_each(|[_, _, lower, end]| [lower, end].into_iter().for_each(|k| half.shape[k].y += 5.0));
        assert!(half.look_for_teeth(&picture));
        assert!((half.shape[lower].y - smile.shape[lower].y).abs() < 1.3, "{}", half.shape[lower]);
        assert_eq!(half.shape[end].y, was[end].y + 5.0);
        // A line that was read below the teeth, or between two rows, is taken apart.
        for low in [12.0, 6.0] {
            let (mut below, _) = face([190, 185, 170], 87);
            lip_lines()
                .into_iter()
                .for_each(|[_, upper, lower, _]| [upper, lower].into_iter().for_each(|k| below.shape[k].y += low));
            assert!(below.look_for_teeth(&picture), "{low}");
            let [upper, lower] = [upper, lower].map(|k| below.shape[k].y);
            // At most 0.6 of the upper lip can be teeth.
            assert!((upper - 75.0).abs() < 1.3 && (lower - 87.0).abs() < 1.3, "{low}: {upper} {lower}");
        }
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
