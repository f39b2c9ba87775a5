//! Places on the skin of the neutral frame.

use nalgebra::Point2;

use super::{
    patch::{Patch, Reading},
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

/// Products of two of a sample's six control weights: 21, and zeros up to a multiple of eight.
pub const PRODUCTS: usize = 24;

/// Place of the product of weights k and l.
pub const fn product(k: usize, l: usize) -> usize {
    let (k, l) = if k < l { (k, l) } else { (l, k) };
    // Rows of a triangle: 6, 5, 4 ... long.
    k * (11 - k) / 2 + l
}

fn products(weights: &[f32; 6]) -> [f32; PRODUCTS] {
    let mut out = [0.0; PRODUCTS];
    (0..6).flat_map(|k| (k..6).map(move |l| (k, l))).for_each(|(k, l)| out[product(k, l)] = weights[k] * weights[l]);
    out
}

/// A place on the skin of the neutral frame.
#[derive(Clone, Debug)]
pub struct Sample {
    pub at: [f32; 2],
    pub grey: f32,
    pub nearness: f32,
    /// Weights of the triangle's control values.
    pub weights: [f32; 6],
    /// Their products, see `product`.
    pub products: [f32; PRODUCTS],
}

/// Samples triangles of the neutral frame.
pub struct Sampler<'a> {
    pub patch: &'a Patch,
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
            if let Some(Reading { value: grey, .. }) = self.patch.read(at) {
                let weights = Quadratic::weights(inner);
                out.push(Sample { at, grey, nearness: nearness as f32, weights, products: products(&weights) });
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
