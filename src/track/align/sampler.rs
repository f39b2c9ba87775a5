//! Places on the skin of the neutral frame.

use nalgebra::Point2;

use super::{
    patch::{LANES, Lanes, Texture},
    surface::{Quadratic, doubled_area},
};

/// Most samples of one triangle; larger ones are sampled more sparsely.
const MAX_SAMPLES: f64 = 200.0;

/// Nearness weight below which a place is not sampled.
const MIN_NEARNESS: f64 = 0.02;

/// Smallest triangle that is used, squared px in the neutral frame.
const MIN_AREA: f64 = 4.0;

/// Samples nearer than this to an edge of the skin, px, count less: beyond it something else moves.
const BORDER_PX: f64 = 1.0;

/// Products of two of a sample's six control weights are multiples of these many quartics of its barycentric coordinates u, v, w (and
/// one that is always 0, up to a multiple of four).
pub const QUARTICS: usize = 16;

/// Exponents of u, v, w in the quartics.
const EXPONENTS: [[u8; 3]; 15] = [
    [4, 0, 0],
    [0, 4, 0],
    [0, 0, 4],
    [3, 1, 0],
    [3, 0, 1],
    [1, 3, 0],
    [0, 3, 1],
    [1, 0, 3],
    [0, 1, 3],
    [2, 2, 0],
    [0, 2, 2],
    [2, 0, 2],
    [2, 1, 1],
    [1, 2, 1],
    [1, 1, 2],
];

/// Exponents of u, v, w in the control weights; the last three have a factor of 2 (see `Quadratic::weights`).
const CONTROL: [[u8; 3]; 6] = [[2, 0, 0], [0, 2, 0], [0, 0, 2], [1, 1, 0], [0, 1, 1], [1, 0, 1]];

/// Which quartic the product of the control weights k and l is, and how many times.
pub const fn quartic(k: usize, l: usize) -> (usize, f64) {
    PRODUCTS[k][l]
}

const PRODUCTS: [[(usize, f64); 6]; 6] = {
    let mut table = [[(0, 0.0); 6]; 6];
    let mut at = 0;
    while at < 36 {
        let (k, l) = (at / 6, at % 6);
        let mut place = 0;
        while EXPONENTS[place][0] != CONTROL[k][0] + CONTROL[l][0] || EXPONENTS[place][1] != CONTROL[k][1] + CONTROL[l][1] {
            place += 1;
        }
        table[k][l] = (place, if k < 3 { 1.0 } else { 2.0 } * if l < 3 { 1.0 } else { 2.0 });
        at += 1;
    }
    table
};

fn quartics(barycentric: [f64; 3]) -> [f32; QUARTICS] {
    let mut out = [0.0; QUARTICS];
    for (out, exponents) in out.iter_mut().zip(EXPONENTS) {
        let powers = barycentric.iter().zip(exponents).map(|(value, exponent)| value.powi(exponent.into()));
        *out = powers.product::<f64>() as f32;
    }
    out
}

/// A place on the skin of the neutral frame, and its grey value there.
#[derive(Clone, Debug)]
pub struct Sample {
    at: [f32; 2],
    grey: f32,
    nearness: f32,
    control: Control,
}

/// What the control values of a triangle have to do with a sample.
#[derive(Clone, Copy, Debug, Default)]
pub struct Control {
    /// Weights of the six control values, and two zeros.
    pub weights: [f32; 8],
    /// The quartics that their products are made of.
    pub quartics: [f32; QUARTICS],
}

/// Up to [`LANES`] samples of a triangle: places, weights of the control values, grey values, nearness; where they are fewer, zeros: the corner
/// of the picture, at which nothing is read, for it has no gradient. What is read at once stands side by side, so that little memory is gone
/// through for each.
#[derive(Clone, Debug)]
pub struct Group {
    at: [Lanes; 2],
    weights: [Lanes; 6],
    pub grey: Lanes,
    pub nearness: Lanes,
    pub controls: [Control; LANES],
}

impl Group {
    pub fn new(samples: &[Sample]) -> Self {
        let each = |value: &dyn Fn(&Sample) -> f32| std::array::from_fn(|k| samples.get(k).map_or(0.0, value));
        Self {
            at: std::array::from_fn(|axis| each(&|sample| sample.at[axis])),
            weights: std::array::from_fn(|control| each(&|sample| sample.control.weights[control])),
            grey: each(&|sample| sample.grey),
            nearness: each(&|sample| sample.nearness),
            controls: std::array::from_fn(|k| samples.get(k).map_or_else(Control::default, |sample| sample.control)),
        }
    }

    /// Where the samples are when the control values move.
    #[inline(always)]
    pub fn moved(&self, control: &[[f32; 2]; 6]) -> [Lanes; 2] {
        let mut at = self.at;
        for (weights, displacement) in self.weights.iter().zip(control) {
            for k in 0..LANES {
                at[0][k] += weights[k] * displacement[0];
                at[1][k] += weights[k] * displacement[1];
            }
        }
        at
    }
}

/// Samples triangles of the neutral frame.
pub struct Sampler<'a> {
    pub texture: &'a Texture,
    /// Standard deviation of the nearness, px.
    pub reach: f64,
    /// Edges of the skin.
    pub border: Vec<[Point2<f64>; 2]>,
}

impl Sampler<'_> {
    /// Samples of a triangle on a grid of at least one px; none of a very small one.
    pub fn samples(&self, points: [Point2<f64>; 3]) -> Vec<Sample> {
        let [a, b, c] = points;
        let doubled = doubled_area(points);
        if doubled.abs() < 2.0 * MIN_AREA {
            return Vec::new();
        }
        let step = (doubled.abs() / 2.0 / MAX_SAMPLES).sqrt().max(1.0);
        let grid = |axis: usize| {
            let values = points.map(|p| p[axis]);
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let count = ((high - low) / step).clamp(0.0, 4096.0) as u32;
            (0..=count).map(move |k| low + (f64::from(k) + 0.5) * step)
        };
        let mut out = Vec::new();
        for p in grid(1).flat_map(|y| grid(0).map(move |x| Point2::new(x, y))) {
            let inner = [[p, b, c], [a, p, c], [a, b, p]].map(|t| doubled_area(t) / doubled);
            if inner.iter().any(|w| *w < 0.0) {
                continue;
            }
            let nearness = self.nearness(p, points);
            if nearness < MIN_NEARNESS {
                continue;
            }
            let at = [p.x as f32, p.y as f32];
            if let Some([grey, ..]) = self.texture.read_one(at) {
                let mut weights = [0.0; 8];
                weights[..6].copy_from_slice(&Quadratic::weights(inner));
                let control = Control { weights, quartics: quartics(inner) };
                out.push(Sample { at, grey, nearness: nearness as f32, control });
            }
        }
        out
    }

    /// Weight of a place: near a corner, and not at the border.
    fn nearness(&self, p: Point2<f64>, corners: [Point2<f64>; 3]) -> f64 {
        let corner = corners.iter().map(|q| (p - q).norm_squared()).fold(f64::INFINITY, f64::min);
        let edge = |[a, b]: &[Point2<f64>; 2]| {
            let along = b - a;
            let share = ((p - a).dot(&along) / along.norm_squared().max(1e-9)).clamp(0.0, 1.0);
            (p - (a + along * share)).norm_squared()
        };
        let near = (-corner / (2.0 * self.reach.powi(2)).max(1e-9)).exp();
        if near < MIN_NEARNESS {
            return 0.0;
        }
        let border = self.border.iter().map(edge).fold(f64::INFINITY, f64::min);
        near * (border / BORDER_PX.powi(2)).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_of_control_weights_are_multiples_of_the_quartics() {
        let barycentric = [0.2, 0.5, 0.3];
        let (weights, quartics) = (Quadratic::weights(barycentric), quartics(barycentric));
        for k in 0..6 {
            for l in 0..6 {
                let (place, factor) = quartic(k, l);
                assert!((weights[k] * weights[l] - quartics[place] * factor as f32).abs() < 1e-7, "{k} {l}");
            }
        }
        assert_eq!(quartics[15], 0.0);
    }
}
