//! Sample points on the skin of the neutral frame.

use nalgebra::Point2;

use super::{
    patch::{LANES, Lanes, Patch},
    surface::{Quadratic, doubled_area},
};

/// Most samples of one triangle; larger ones are sampled more sparsely.
const MAX_SAMPLES: f64 = 200.0;

/// Nearness weight below which a point is not sampled.
const MIN_NEARNESS: f64 = 0.02;

/// Smallest triangle that is used, squared px in the neutral frame.
const MIN_AREA: f64 = 4.0;

/// Distance from an edge of the skin, px, below which samples get less weight: the area beyond it moves differently.
const BORDER_PX: f64 = 1.0;

/// Fewer samples than this have no coarse subset.
const MIN_PARTED: usize = 64;

/// A sample point on the skin of the neutral frame, with its grey value.
#[derive(Clone, Debug)]
pub struct Sample {
    at: [f32; 2],
    grey: f32,
    nearness: f32,
    /// Weights of the six control values.
    weights: [f32; 6],
}

/// Up to [`LANES`] samples of a triangle: positions, weights of the control values, grey values, nearness. Missing samples are zeros: they
/// lie in the corner of the picture, where nothing is read because there is no gradient. Values that are read together are stored together,
/// for memory locality.
#[derive(Clone, Debug)]
pub struct Group {
    at: [Lanes; 2],
    pub weights: [Lanes; 6],
    pub grey: Lanes,
    pub nearness: Lanes,
}

impl Group {
    pub fn new(samples: &[Sample]) -> Self {
        let each = |value: &dyn Fn(&Sample) -> f32| std::array::from_fn(|k| samples.get(k).map_or(0.0, value));
        Self {
            at: std::array::from_fn(|axis| each(&|sample| sample.at[axis])),
            weights: std::array::from_fn(|control| each(&|sample| sample.weights[control])),
            grey: each(&|sample| sample.grey),
            nearness: each(&|sample| sample.nearness),
        }
    }

    /// Returns the positions of the samples for moved control values.
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
    pub patch: &'a Patch,
    /// Standard deviation of the nearness, px.
    pub reach: f64,
    /// Edges of the skin.
    pub border: Vec<[Point2<f64>; 2]>,
}

impl Sampler<'_> {
    /// Samples a triangle on a grid of at least one px (none for a very small triangle). Also returns the number of the first samples that
    /// form the coarse subset.
    pub fn samples(&self, points: [Point2<f64>; 3]) -> (Vec<Sample>, usize) {
        let [a, b, c] = points;
        let doubled = doubled_area(points);
        if doubled.abs() < 2.0 * MIN_AREA {
            return (Vec::new(), 0);
        }
        let step = (doubled.abs() / 2.0 / MAX_SAMPLES).sqrt().max(1.0);
        let grid = |axis: usize| {
            let values = points.map(|p| p[axis]);
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let count = ((high - low) / step).clamp(0.0, 4096.0) as u32;
            (0..=count).map(move |k| (k, low + (f64::from(k) + 0.5) * step))
        };
        let border = self.border_near(points);
        // As on a chessboard: first all white squares, then all black ones.
        let (mut white, mut black) = (Vec::new(), Vec::new());
        for ((row, y), (column, x)) in grid(1).flat_map(|y| grid(0).map(move |x| (y, x))) {
            let p = Point2::new(x, y);
            let inner = [[p, b, c], [a, p, c], [a, b, p]].map(|t| doubled_area(t) / doubled);
            if inner.iter().any(|w| *w < 0.0) {
                continue;
            }
            let nearness = self.nearness(p, points, &border);
            if nearness < MIN_NEARNESS {
                continue;
            }
            let at = [p.x as f32, p.y as f32];
            if let Some([grey, ..]) = self.patch.read_one(at) {
                let sample = Sample { at, grey, nearness: nearness as f32, weights: Quadratic::weights(inner) };
                if (row + column) % 2 == 0 { &mut white } else { &mut black }.push(sample);
            }
        }
        let first = white.len();
        white.append(&mut black);
        let parted = white.len() >= MIN_PARTED;
        let first = if parted { first } else { white.len() };
        (white, first)
    }

    /// Returns the edges of the skin that may lie within [`BORDER_PX`] of a point in a triangle.
    fn border_near(&self, corners: [Point2<f64>; 3]) -> Vec<[Point2<f64>; 2]> {
        let apart = |axis: usize, [a, b]: &[Point2<f64>; 2]| {
            let (low, high) = (a[axis].min(b[axis]) - BORDER_PX, a[axis].max(b[axis]) + BORDER_PX);
            corners.iter().all(|p| p[axis] < low) || corners.iter().all(|p| p[axis] > high)
        };
        self.border.iter().filter(|edge| !apart(0, edge) && !apart(1, edge)).copied().collect()
    }

    /// Returns the weight of a point: high near a corner of the triangle, low at the border, of which `border` are the edges near the
    /// triangle.
    fn nearness(&self, p: Point2<f64>, corners: [Point2<f64>; 3], border: &[[Point2<f64>; 2]]) -> f64 {
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
        let border = border.iter().map(edge).fold(f64::INFINITY, f64::min);
        near * (border / BORDER_PX.powi(2)).min(1.0)
    }
}
