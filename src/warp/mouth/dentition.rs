//! Teeth with individual irregularities.
//!
//! The mean picture alone has an even, symmetric row that is the same on everybody and looks like the keys of a piano. Here each face gets
//! a row of its own: the crowns of the mean picture, each with its own length, turn, brightness and colour, and with the wet light that it
//! reflects. They vary nearly as much as people's crowns vary around the mean; the values are a deterministic function of the face's proportions.

use image::Rgba32FImage;

use super::{
    grain::grain,
    proportions::Proportions,
    teeth::{TEETH_ORIGIN, TEETH_SCALE, picture, sampled},
};
use crate::interpolation::smooth_step;

/// Ends of the crowns, outwards from the midline, in eye distances: two incisors, the canine, two premolars.
const CROWNS: [f64; 5] = [0.130, 0.217, 0.295, 0.368, 0.43];
/// Heights of the crowns' edges on the mean picture, in eye distances, y down.
const EDGES: [f64; 5] = [0.002, -0.025, -0.048, -0.066, -0.093];
/// Scales from the face's value ([`Proportions::own`]) and the size of its teeth to positions on the lattice of irregular values. Measurements
/// of one mouth that differ by twice the error of a fit still give similar teeth.
const APART: (f64, f64) = (0.4, 12.0);
/// Standard deviations of the crowns around the mean picture, outwards from the midline: shared by the two crowns of a pair, and of each by
/// itself. They hold at the lattice points and are a seventh smaller between them. Quantities: logarithm of brightness, height of the edge in
/// eye distances, logarithm of red over blue. The 24 smiles of the picture vary a half more in brightness, a quarter more in edges and
/// more than twice as much in colour. Part of that is light, gums and measurement errors, and teeth with all of it look patched.
const BRIGHT: [(f64, f64); 5] = [(0.024, 0.015), (0.009, 0.035), (0.017, 0.045), (0.017, 0.045), (0.017, 0.045)];
const EDGE: [(f64, f64); 5] = [(0.006, 0.004), (0.0, 0.0055), (0.0055, 0.006), (0.0055, 0.005), (0.0055, 0.005)];
const RED: [(f64, f64); 5] = [(0.010, 0.004), (0.006, 0.008), (0.015, 0.008), (0.015, 0.008), (0.015, 0.008)];
/// Standard deviation of the crowns' turn, radians. No picture separates it from that of the edge; it is of the order that dentists call straight.
const TURN: f64 = 0.030;
/// Factor from a standard deviation to the range of a uniform distribution: the square root of 3.
const SPREAD: f64 = 1.732;
/// Half the width of the transition between two crowns, in eye distances.
const BETWEEN: f64 = 0.008;
/// Height of a crown's axis of turning above the row's edge, in eye distances.
const AXIS: f64 = 0.055;
/// Wet light on a crown: mean strength and its relative variation; greatest offset from the middle of the crown, over its width;
/// height above the edge and its variation; extent across and down. Lengths are in eye distances. In the same smiles the brightest
/// fiftieth of a crown is 0.06 to 0.13 above its median, as a logarithm.
struct WetLight {
    strength: [f64; 5],
    varies: f64,
    beside: f64,
    height: [f64; 5],
    rises: f64,
    extent: (f64, f64),
}
const WET_LIGHT: WetLight = WetLight {
    strength: [0.12, 0.14, 0.12, 0.08, 0.05],
    varies: 0.6,
    beside: 0.22,
    height: [0.050, 0.050, 0.045, 0.040, 0.032],
    rises: 0.012,
    extent: (0.011, 0.020),
};

/// Individual values of one crown.
#[derive(Clone, Copy, Debug)]
struct Crown {
    /// Distance of its middle from the midline, in eye distances, positive to the right on the picture.
    middle: f64,
    bright: f64,
    edge: f64,
    red: f64,
    turn: f64,
    /// Height of the axis of its turn, in eye distances.
    axis: f64,
    /// Strength and position of the wet light.
    wet: f64,
    wet_at: (f64, f64),
}

/// The crowns of a face on one side of the midline (0: left on the picture), outwards.
fn crowns(face: (f64, f64), side: usize) -> [Crown; 5] {
    std::array::from_fn(|k| {
        // Each value of each crown uses its own part of the lattice.
        let at = |what: usize| grain(APART.0 * face.0 + 100.0 * k as f64, APART.1 * face.1 + 50.0 * what as f64);
        let drawn = |what: usize| at(10 * side + what);
        let of_pair = |(pair, one): (f64, f64), what: usize| SPREAD * (pair * at(20 + what) + one * drawn(what));
        let sign = if side == 0 { -1.0 } else { 1.0 };
        let from = k.checked_sub(1).map_or(0.0, |k| CROWNS[k]);
        let (width, middle) = (CROWNS[k] - from, sign * f64::midpoint(from, CROWNS[k]));
        let wet = WET_LIGHT.strength[k] * (1.0 + WET_LIGHT.varies * drawn(4));
        Crown {
            middle,
            bright: of_pair(BRIGHT[k], 0),
            edge: of_pair(EDGE[k], 1),
            red: of_pair(RED[k], 2),
            turn: SPREAD * TURN * drawn(3),
            wet,
            wet_at: (middle + width * WET_LIGHT.beside * drawn(5), EDGES[k] - WET_LIGHT.height[k] + WET_LIGHT.rises * drawn(6)),
            axis: EDGES[k] - AXIS,
        }
    })
}

/// Draws the teeth of a face. `size` is that of its teeth relative to the picture's. Position and levels are those of the mean picture.
/// `None` if that cannot be decoded.
pub fn dentition(proportions: &Proportions, size: f64) -> Option<Rgba32FImage> {
    let mean = picture()?;
    let sides = [0, 1].map(|side| crowns((proportions.own(), size), side));
    let row: Vec<Crown> = sides[0].iter().rev().chain(&sides[1]).copied().collect();
    let ends: Vec<f64> = CROWNS.iter().rev().skip(1).map(|end| -end).chain([0.0]).chain(CROWNS.iter().copied().take(4)).collect();
    Some(Rgba32FImage::from_fn(mean.width(), mean.height(), |column, line| {
        let (x, y) = ((f64::from(column) - TEETH_ORIGIN.0) / TEETH_SCALE, (f64::from(line) - TEETH_ORIGIN.1) / TEETH_SCALE);
        // The crowns on both sides of the nearest end.
        let nearest = (0..ends.len()).min_by(|&a, &b| (x - ends[a]).abs().total_cmp(&(x - ends[b]).abs())).unwrap_or(0);
        let share = smooth_step(-BETWEEN, BETWEEN, x - ends[nearest]);
        let (left, right) = (row[nearest], row[nearest + 1]);
        let between = |of: &dyn Fn(&Crown) -> f64| of(&left) + (of(&right) - of(&left)) * share;
        let edge = between(&|crown| crown.edge + crown.turn * (x - crown.middle));
        let from = (x + between(&|crown| crown.turn * (y - crown.axis)), y - edge);
        let Some((colour, cover)) = sampled(mean, from.0, from.1) else {
            return image::Rgba([0.0; 4]);
        };
        let wet: f64 = [left, right]
            .iter()
            .map(|crown| {
                let ((dx, dy), extent) = ((x - crown.wet_at.0, y - edge - crown.wet_at.1), WET_LIGHT.extent);
                crown.wet * (-(dx / extent.0).powi(2) - (dy / extent.1).powi(2)).exp()
            })
            .sum();
        let (bright, red) = (between(&|crown| crown.bright) + wet, between(&|crown| crown.red));
        let factors = [bright + 0.35 * red, bright, bright - 0.65 * red];
        let [r, g, b]: [f32; 3] = std::array::from_fn(|c| colour[c] * factors[c].exp() as f32);
        image::Rgba([r, g, b, 255.0 * cover])
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn face(incisors: f64) -> Proportions {
        Proportions { incisors, tongue: 0.55 }
    }

    #[test]
    fn crowns_differ_as_much_as_they_are_said_to_and_from_face_to_face() {
        let rows: Vec<[Crown; 5]> = (0..900).map(|k| crowns((50.0 + 0.9 * f64::from(k), 1.0), 0)).collect();
        for k in 0..CROWNS.len() {
            let deviation =
                |of: fn(&Crown) -> f64| (rows.iter().map(|row| of(&row[k]).powi(2)).sum::<f64>() / rows.len() as f64).sqrt();
            for (drawn, (pair, one)) in [(deviation(|c| c.bright), BRIGHT[k]), (deviation(|c| c.edge), EDGE[k])] {
                let given = pair.hypot(one);
                assert!((0.7..1.1).contains(&(drawn / given)), "{k}: {drawn} of {given}");
            }
        }
        // A minimally different measurement gives the same teeth; another lip or another width gives others.
        let bright = |incisors: f64, size: f64| crowns((face(incisors).own(), size), 1).map(|crown| crown.bright);
        let apart = |a: [f64; 5], b: [f64; 5]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let one = bright(0.058, 1.0);
        assert!(apart(one, bright(0.058 + 1e-6, 1.0 + 1e-6)) < 1e-3);
        assert!(apart(one, bright(0.048, 1.0)) > 0.02 && apart(one, bright(0.058, 0.9)) > 0.02);
    }

    #[test]
    fn a_row_of_ones_own_is_not_the_same_on_both_sides_but_lies_where_the_mean_lies() {
        let (mean, own) = (picture().unwrap(), dentition(&face(0.055), 1.0).unwrap());
        assert_eq!(own.dimensions(), mean.dimensions());
        let (mut apart, mut cover) = (0.0_f32, [0.0_f32; 2]);
        for (a, b) in mean.pixels().zip(own.pixels()) {
            cover = [cover[0] + a.0[3], cover[1] + b.0[3]];
            assert!(b.0.iter().all(|level| level.is_finite() && *level >= 0.0));
        }
        for x in [0.03, 0.09, 0.17, 0.25] {
            let [left, right] = [-x, x].map(|x| sampled(&own, x, -0.07).unwrap());
            apart = apart.max((left.0[1] - right.0[1]).abs());
        }
        assert!((cover[1] / cover[0] - 1.0).abs() < 0.08 && apart > 4.0, "{cover:?} {apart}");
    }

    #[test]
    fn the_wet_light_is_on_the_crowns() {
        let mean = picture().unwrap();
        for side in [0, 1] {
            for crown in (0..40).flat_map(|k| crowns((50.0 + 1.3 * f64::from(k), 1.0), side)) {
                let (_, cover) = sampled(mean, crown.wet_at.0, crown.wet_at.1).unwrap();
                assert!(cover > 0.5, "{crown:?} {cover}");
            }
        }
    }
}
