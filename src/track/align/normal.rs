//! What a triangle's grey values say of its motion.

use nalgebra::{Matrix2, Vector2};

use super::{
    sampler::{QUARTICS, Sample, quartic},
    surface::Quadratic,
};
use crate::fit::{BlockPlaces, Layout, Skyline};

/// Fewest samples that tell a motion from a change of brightness.
pub const MIN_SAMPLES: usize = 4;

/// Sum of weights below which a triangle says nothing.
const MIN_WEIGHT: f64 = 0.02;

/// Squared grey levels by which triangles differ that look alike.
const MISMATCH_FLOOR: f64 = 1.0;

/// Standard deviation of a triangle's change of brightness, grey levels.
const BRIGHTNESS_SIGMA: f64 = 20.0;

/// Place of the first control value that is no corner.
const EDGES: usize = 3;

/// A sample's grey difference to the neutral frame, and the current frame's gradient there.
#[derive(Clone, Copy, Debug)]
pub struct Compared {
    pub difference: f32,
    pub gradient: [f32; 2],
    /// Place of the sample in its triangle's list.
    pub sample: u32,
}

pub fn mean_difference(list: &[Compared]) -> f64 {
    list.iter().map(|c| f64::from(c.difference)).sum::<f64>() / list.len().max(1) as f64
}

/// Room for the sums over the samples of a triangle.
///
/// A sample's row of the Jacobian is its control weights times its gradient, so their products are the (fixed) products of the weights
/// times the three of the gradient, and the sums over the samples need no 12 x 12 product of each. The products of two weights are
/// multiples of 15 quartics.
#[derive(Clone, Debug, Default)]
pub struct Sums {
    /// Of each sample, its weight times the products of its gradient, and its place.
    factors: Vec<([f32; 3], u32)>,
}

/// One triangle's normal equations in its control values, with the change of brightness eliminated: the matrix is that of the products
/// less the outer product of `level`.
pub struct NormalEquations {
    /// Products of x with x, x with y, y with y; only if asked for.
    products: Option<[[[f64; 6]; 6]; 3]>,
    /// What a change of brightness has in common with each control value along x and y, over the root of its own square.
    level: [[f64; 6]; 2],
    right: [[f64; 6]; 2],
    /// Squared grey levels left.
    pub variance: f64,
}

impl NormalEquations {
    pub fn new(samples: &[Sample], list: &[Compared], scale: f64, with_matrix: bool, room: &mut Sums) -> Option<Self> {
        if list.len() < MIN_SAMPLES {
            return None;
        }
        let mean = mean_difference(list);
        let (level, inverse) = (mean as f32, 1.0 / scale as f32);
        // Sums of weights w, differences r from their mean, Jacobian J, and their products.
        let (mut sum, mut sum_r, mut sum_rr) = (0.0f64, 0.0f64, 0.0f64);
        let (mut sum_j, mut sum_jr) = ([[0.0f32; 8]; 2], [[0.0f32; 8]; 2]);
        room.factors.clear();
        for Compared { difference, gradient: [gx, gy], sample: place } in list {
            let Some(sample) = samples.get(*place as usize) else { continue };
            let r = difference - level;
            let w = sample.nearness / (1.0 + (r * inverse) * (r * inverse));
            let wr = w * r;
            sum += f64::from(w);
            sum_r += f64::from(wr);
            sum_rr += f64::from(wr * r);
            let [x, y, xr, yr] = [w * gx, w * gy, wr * gx, wr * gy];
            for k in 0..8 {
                sum_j[0][k] += x * sample.weights[k];
                sum_j[1][k] += y * sample.weights[k];
                sum_jr[0][k] += xr * sample.weights[k];
                sum_jr[1][k] += yr * sample.weights[k];
            }
            room.factors.push(([x * gx, x * gy, y * gy], *place));
        }
        if sum < MIN_WEIGHT {
            return None;
        }
        let variance = (sum_rr / sum - (sum_r / sum).powi(2)).max(0.0) + MISMATCH_FLOOR;
        // The brightness b is held near 0 by its expected size: b = (sum w r - ...) / divisor.
        let divisor = sum + variance / BRIGHTNESS_SIGMA.powi(2);
        let wide = |sums: [[f32; 8]; 2]| sums.map(|row| std::array::from_fn::<f64, 6, _>(|k| f64::from(row[k])));
        let (sum_j, sum_jr) = (wide(sum_j), wide(sum_jr));
        // Differences count from 0, not from their mean.
        let sum_r = sum_r + mean * sum;
        let right = std::array::from_fn(|axis| {
            std::array::from_fn(|k| {
                let with_mean = sum_jr[axis][k] + mean * sum_j[axis][k];
                sum_j[axis][k] * sum_r / divisor - with_mean
            })
        });
        let level = sum_j.map(|row| row.map(|value| value / divisor.sqrt()));
        Some(Self { products: with_matrix.then(|| room.products(samples)), level, right, variance })
    }

    /// Carries the right side from the control values to the nodes.
    pub fn add_right(&self, motion: &Quadratic, gain: f64, pull: &mut [Vector2<f64>]) {
        for (node, control) in motion.nodes() {
            let along = |axis: usize| gain * (0..6).map(|k| control[k] * self.right[axis][k]).sum::<f64>();
            pull[node] += Vector2::new(along(0), along(1));
        }
    }

    /// Carries the matrix from the control values to the nodes.
    pub fn add_matrix(
        &self,
        motion: &Quadratic,
        places: &[BlockPlaces],
        gain: f64,
        levels: &mut Vec<[f64; 2]>,
        system: &mut Skyline,
    ) {
        let Some(products) = &self.products else { return };
        let products = products.map(|block| block.map(|row| row.map(|value| value * gain)));
        let root = gain.sqrt();
        let level_of = |(_, control): (usize, &[f64; 6])| {
            let mut level = [0.0; 2];
            #[allow(clippy::needless_range_loop)]
            for k in 0..6 {
                level[0] += root * control[k] * self.level[0][k];
                level[1] += root * control[k] * self.level[1][k];
            }
            level
        };
        levels.clear();
        levels.extend(motion.nodes().map(level_of));
        let mut places = places.iter();
        for (j, (_, control)) in motion.nodes().enumerate() {
            // Only corners have a part in the control values of corners.
            let from = if j < EDGES { 0 } else { EDGES };
            let mut carried = [[0.0; 6]; 3];
            for (carried, block) in carried.iter_mut().zip(&products) {
                for (carried, row) in carried.iter_mut().zip(block) {
                    for k in from..6 {
                        *carried += row[k] * control[k];
                    }
                }
            }
            let [bx, by] = levels[j];
            for (i, (_, other)) in motion.nodes().take(j + 1).enumerate() {
                let Some(place) = places.next() else { return };
                let from = if i < EDGES { 0 } else { EDGES };
                let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
                for k in from..6 {
                    xx += carried[0][k] * other[k];
                    xy += carried[1][k] * other[k];
                    yy += carried[2][k] * other[k];
                }
                let [ax, ay] = levels[i];
                system.add_at(place, &Matrix2::new(xx - ax * bx, xy - ax * by, xy - ay * bx, yy - ay * by));
            }
        }
    }
}

impl Sums {
    /// Sums of products of the control weights, by the samples' factors.
    fn products(&self, samples: &[Sample]) -> [[[f64; 6]; 6]; 3] {
        let mut sums = [[0.0f32; QUARTICS]; 3];
        for (factors, place) in &self.factors {
            let Some(sample) = samples.get(*place as usize) else { continue };
            #[allow(clippy::needless_range_loop)]
            for k in 0..QUARTICS {
                sums[0][k] += factors[0] * sample.quartics[k];
                sums[1][k] += factors[1] * sample.quartics[k];
                sums[2][k] += factors[2] * sample.quartics[k];
            }
        }
        sums.map(|sums| {
            std::array::from_fn(|k| {
                std::array::from_fn(|l| {
                    let (place, factor) = quartic(k, l);
                    f64::from(sums[place]) * factor
                })
            })
        })
    }
}

/// Where the blocks of a triangle's nodes with each other lie in the system, in the order in which [`NormalEquations::add_matrix`] gives
/// them.
pub fn places(motion: &Quadratic, layout: &Layout) -> Vec<BlockPlaces> {
    let nodes: Vec<usize> = motion.nodes().map(|(node, _)| node).collect();
    (0..nodes.len()).flat_map(|j| (0..=j).map(move |i| (i, j))).map(|(i, j)| layout.places(nodes[i], nodes[j])).collect()
}
