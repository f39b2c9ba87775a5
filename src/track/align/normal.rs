//! What a triangle's grey values say of its motion.

use nalgebra::{Matrix2, Vector2};

use super::{
    patch::{LANES, Lanes},
    sampler::{Group, QUARTICS, quartic},
    surface::{Quadratic, Shares},
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

/// Of each sample of a group, its grey difference to the neutral frame, the current frame's gradient there along x and y, and 1; all 0 where the
/// current frame says nothing.
pub type Compared = [[f32; 4]; LANES];

/// The mean grey difference of a triangle's samples, and how many of them there are.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mean {
    pub difference: f64,
    pub count: usize,
}

/// The differences of a group's samples from a level, and what they weigh by their size times `inverse`.
#[inline(always)]
fn weighed(group: &Group, list: &Compared, level: f32, inverse: f32) -> [Lanes; 2] {
    let (mut rests, mut weights) = ([0.0; LANES], [0.0; LANES]);
    for k in 0..LANES {
        let [difference, .., inside] = list[k];
        let rest = difference - level;
        rests[k] = rest;
        weights[k] = group.nearness[k] * inside / (1.0 + (rest * inverse) * (rest * inverse));
    }
    [rests, weights]
}

/// Room for the sums over the samples of a triangle.
///
/// A sample's row of the Jacobian is its control weights times its gradient, so their products are the (fixed) products of the weights
/// times the three of the gradient, and the sums over the samples need no 12 x 12 product of each. The products of two weights are
/// multiples of 15 quartics.
#[derive(Clone, Debug, Default)]
pub struct Sums {
    /// Of each sample, its weight times the products of its gradient, and nothing.
    factors: Vec<[[f32; 4]; LANES]>,
    /// Sums of Jacobians along x and y, and of these times the differences. They stand here as a whole: as variables of which some are not
    /// used they would be computed one by one.
    rows: [[f32; 8]; 4],
    products: [[f32; QUARTICS]; 3],
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
    #[inline(always)]
    pub fn new(
        groups: &[Group],
        (list, mean): (&[Compared], &Mean),
        scale: f64,
        with_matrix: bool,
        room: &mut Sums,
    ) -> Option<Self> {
        if mean.count < MIN_SAMPLES {
            return None;
        }
        let mean = mean.difference;
        let (level, inverse) = (mean as f32, 1.0 / scale as f32);
        // Sums of weights w, differences r from their mean, Jacobian J, and their products.
        let (mut sum, mut sum_r, mut sum_rr) = (0.0f64, 0.0f64, 0.0f64);
        let mut rows = [[0.0f32; 8]; 4];
        room.factors.resize(list.len(), [[0.0; 4]; LANES]);
        for ((group, list), factors) in groups.iter().zip(list).zip(&mut room.factors) {
            let [rests, weights] = weighed(group, list, level, inverse);
            for n in 0..LANES {
                let ([_, gx, gy, _], r, w) = (list[n], rests[n], weights[n]);
                let wr = w * r;
                sum += f64::from(w);
                sum_r += f64::from(wr);
                sum_rr += f64::from(wr * r);
                let [x, y, xr, yr] = [w * gx, w * gy, wr * gx, wr * gy];
                let control = &group.controls[n].weights;
                for k in 0..8 {
                    rows[0][k] += x * control[k];
                    rows[1][k] += y * control[k];
                    rows[2][k] += xr * control[k];
                    rows[3][k] += yr * control[k];
                }
                factors[n] = [x * gx, x * gy, y * gy, 0.0];
            }
        }
        room.rows = rows;
        if sum < MIN_WEIGHT {
            return None;
        }
        let variance = (sum_rr / sum - (sum_r / sum).powi(2)).max(0.0) + MISMATCH_FLOOR;
        // The brightness b is held near 0 by its expected size: b = (sum w r - ...) / divisor.
        let divisor = sum + variance / BRIGHTNESS_SIGMA.powi(2);
        let [sum_jx, sum_jy, sum_jrx, sum_jry] = room.rows.map(|row| std::array::from_fn::<f64, 6, _>(|k| f64::from(row[k])));
        let (sum_j, sum_jr) = ([sum_jx, sum_jy], [sum_jrx, sum_jry]);
        // Differences count from 0, not from their mean.
        let sum_r = sum_r + mean * sum;
        let right = std::array::from_fn(|axis| {
            std::array::from_fn(|k| {
                let with_mean = sum_jr[axis][k] + mean * sum_j[axis][k];
                sum_j[axis][k] * sum_r / divisor - with_mean
            })
        });
        let level = sum_j.map(|row| row.map(|value| value / divisor.sqrt()));
        let products = if with_matrix { Some(room.products(groups)) } else { None };
        Some(Self { products, level, right, variance })
    }

    /// Carries the right side from the control values to the nodes.
    #[inline(always)]
    pub fn add_right(&self, motion: &Quadratic, gain: f64, pull: &mut [Vector2<f64>]) {
        for (node, control) in motion.nodes() {
            let along = |axis: usize| gain * (0..6).map(|k| control[k] * self.right[axis][k]).sum::<f64>();
            pull[node] += Vector2::new(along(0), along(1));
        }
    }

    /// Carries the matrix from the control values to the nodes, whose weights `shares` gives in fours.
    #[inline(always)]
    pub fn add_matrix(
        &self,
        motion: &Quadratic,
        shares: &[Shares],
        places: &[BlockPlaces],
        gain: f64,
        levels: &mut Vec<[[f64; 4]; 2]>,
        system: &mut Skyline,
    ) {
        let Some(products) = &self.products else { return };
        let products = products.map(|block| block.map(|row| row.map(|value| value * gain)));
        let level = self.level.map(|row| row.map(|value| value * gain.sqrt()));
        levels.clear();
        for shares in shares {
            let mut sums = [[0.0; 4]; 2];
            for (control, share) in shares.iter().enumerate() {
                for k in 0..4 {
                    sums[0][k] += share[k] * level[0][control];
                    sums[1][k] += share[k] * level[1][control];
                }
            }
            levels.push(sums);
        }
        let mut places = places.iter();
        for (j, (_, control)) in motion.nodes().enumerate() {
            // Only corners have a part in the control values of corners.
            let from = if j < EDGES { 0 } else { EDGES };
            let mut carried = [[0.0; 6]; 3];
            for (carried, block) in carried.iter_mut().zip(&products) {
                for (control, row) in control.iter().zip(block).skip(from) {
                    for k in 0..6 {
                        carried[k] += row[k] * control;
                    }
                }
            }
            let (own, lane) = (levels.get(j / 4).copied().unwrap_or_default(), j % 4);
            let (bx, by) = (own[0][lane], own[1][lane]);
            for (group, (shares, level)) in shares.iter().zip(&*levels).take(j / 4 + 1).enumerate() {
                let (mut xx, mut xy, mut yx, mut yy) = ([0.0; 4], [0.0; 4], [0.0; 4], [0.0; 4]);
                for k in 0..4 {
                    xx[k] = -level[0][k] * bx;
                    xy[k] = -level[0][k] * by;
                    yx[k] = -level[1][k] * bx;
                    yy[k] = -level[1][k] * by;
                }
                for (control, share) in shares.iter().enumerate() {
                    for k in 0..4 {
                        let mixed = carried[1][control] * share[k];
                        xx[k] += carried[0][control] * share[k];
                        xy[k] += mixed;
                        yx[k] += mixed;
                        yy[k] += carried[2][control] * share[k];
                    }
                }
                for (k, place) in places.by_ref().take((j + 1 - 4 * group).min(4)).enumerate() {
                    system.add_at(place, &Matrix2::new(xx[k], xy[k], yx[k], yy[k]));
                }
            }
        }
    }
}

impl Sums {
    /// Sums of products of the control weights, by the samples' factors.
    #[inline(always)]
    fn products(&mut self, groups: &[Group]) -> [[[f64; 6]; 6]; 3] {
        let mut sums = [[0.0f32; QUARTICS]; 3];
        for (factors, group) in self.factors.iter().zip(groups) {
            for n in 0..LANES {
                let (factors, quartics) = (factors[n], &group.controls[n].quartics);
                for k in 0..QUARTICS {
                    sums[0][k] += factors[0] * quartics[k];
                    sums[1][k] += factors[1] * quartics[k];
                    sums[2][k] += factors[2] * quartics[k];
                }
            }
        }
        self.products = sums;
        self.products.map(|sums| {
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
