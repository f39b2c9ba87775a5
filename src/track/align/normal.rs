//! Normal equations of one triangle: its motion from its grey values.

use nalgebra::{Matrix2, Vector2};

use super::{
    patch::{LANES, Lanes, Readings, add, times, total},
    sampler::Group,
    surface::{Quadratic, Shares},
};
use crate::fit::{BlockPlaces, Layout, Skyline};

/// Fewest samples that separate a motion from a change of brightness.
pub const MIN_SAMPLES: usize = 4;

/// Sum of weights below which a triangle is ignored.
const MIN_WEIGHT: f64 = 0.02;

/// Smallest variance assumed for the grey differences of a triangle, squared grey levels.
const MISMATCH_FLOOR: f64 = 1.0;

/// Standard deviation of a triangle's change of brightness, grey levels.
const BRIGHTNESS_SIGMA: f64 = 20.0;

/// Index of the first control value that is not a corner.
const EDGES: usize = 3;

/// For each sample of a group: grey difference from the neutral frame, gradient of the current frame along x and y, and 1; all 0 outside
/// the current frame.
pub type Compared = Readings;

/// Mean grey difference of a triangle's samples, and their number.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mean {
    pub difference: f64,
    pub count: usize,
}

/// Pairs of control weights whose products are distinct up to a factor. Such a product is a quartic of the barycentric coordinates u, v, w,
/// of which there are 15. For the edges' weights 2uv, 2vw and 2wu, the square of one and the product of the corners' weights coincide.
const PAIRS: [[usize; 2]; 15] =
    [[0, 0], [1, 1], [2, 2], [0, 3], [0, 5], [1, 3], [1, 4], [2, 5], [2, 4], [0, 1], [1, 2], [0, 2], [0, 4], [1, 5], [2, 3]];

/// Exponents of u, v, w in the control weights; the last three have a factor of 2 (see `Quadratic::weights`).
const CONTROL: [[u8; 3]; 6] = [[2, 0, 0], [0, 2, 0], [0, 0, 2], [1, 1, 0], [0, 1, 1], [1, 0, 1]];

/// For the control weights k and l: index of the pair that their product is a multiple of, and the factor.
const PRODUCTS: [[(usize, f64); 6]; 6] = {
    let mut table = [[(0, 0.0); 6]; 6];
    let mut at = 0;
    while at < 36 {
        let (k, l) = (at / 6, at % 6);
        let (mut place, mut axis) = (0, 0);
        while axis < 3 {
            let [a, b] = PAIRS[place];
            if CONTROL[a][axis] + CONTROL[b][axis] == CONTROL[k][axis] + CONTROL[l][axis] {
                axis += 1;
            } else {
                (place, axis) = (place + 1, 0);
            }
        }
        table[k][l] = (place, factor(k, l) / factor(PAIRS[place][0], PAIRS[place][1]));
        at += 1;
    }
    table
};

const fn factor(k: usize, l: usize) -> f64 {
    if k < 3 && l < 3 {
        1.0
    } else if k < 3 || l < 3 {
        2.0
    } else {
        4.0
    }
}

/// Buffers for the sums over the samples of a triangle. For each sample: weight times gradient along x and y, the same times its
/// difference, and weight times the products of the gradient (x with x, x with y, y with y).
///
/// A sample's row of the Jacobian is its control weights times its gradient. Its products are therefore the 15 distinct products of the
/// control weights times the three of the gradient, so no 12 x 12 product per sample is needed.
#[derive(Clone, Debug, Default)]
pub struct Sums(Vec<[Lanes; 7]>);

/// Normal equations of one triangle in its control values, with the change of brightness eliminated: the matrix is that of the products
/// minus the outer product of `level`.
pub struct NormalEquations {
    /// Products of x with x, x with y, y with y; only if asked for.
    products: Option<[[[f64; 6]; 6]; 3]>,
    /// Coupling of the change of brightness with each control value along x and y, over the root of its own square.
    level: [[f64; 6]; 2],
    right: [[f64; 6]; 2],
    /// Variance of the remaining differences, squared grey levels.
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
        let mut sums = [[0.0; LANES]; 3];
        room.0.resize(list.len(), Default::default());
        for ((group, [differences, gx, gy, inside]), factors) in groups.iter().zip(list).zip(&mut room.0) {
            let (mut rests, mut weights) = ([0.0; LANES], [0.0; LANES]);
            for k in 0..LANES {
                rests[k] = differences[k] - level;
                // Large differences get small weights.
                weights[k] = group.nearness[k] * inside[k] / (1.0 + (rests[k] * inverse) * (rests[k] * inverse));
            }
            let weighed = times(&weights, &rests);
            let (x, y) = (times(&weights, gx), times(&weights, gy));
            *factors = [x, y, times(&weighed, gx), times(&weighed, gy), times(&x, gx), times(&x, gy), times(&y, gy)];
            add(&mut sums[0], &weights);
            add(&mut sums[1], &weighed);
            add(&mut sums[2], &times(&weighed, &rests));
        }
        let [sum, sum_r, sum_rr] = sums.map(|lanes| f64::from(total(&lanes)));
        if sum < MIN_WEIGHT {
            return None;
        }
        let variance = (sum_rr / sum - (sum_r / sum).powi(2)).max(0.0) + MISMATCH_FLOOR;
        // A prior of its expected size keeps the brightness b near 0: b = (sum w r - ...) / divisor.
        let divisor = sum + variance / BRIGHTNESS_SIGMA.powi(2);
        let [sum_jx, sum_jy, sum_jrx, sum_jry] = room.rows(groups);
        let (sum_j, sum_jr) = ([sum_jx, sum_jy], [sum_jrx, sum_jry]);
        // Differences are counted from 0, not from their mean.
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

    /// Maps the right side from the control values to the nodes.
    #[inline(always)]
    pub fn add_right(&self, motion: &Quadratic, gain: f64, pull: &mut [Vector2<f64>]) {
        for (node, control) in motion.nodes() {
            let along = |axis: usize| gain * (0..6).map(|k| control[k] * self.right[axis][k]).sum::<f64>();
            pull[node] += Vector2::new(along(0), along(1));
        }
    }

    /// Maps the matrix from the control values to the nodes, whose weights are given in `shares` in groups of four.
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
            // Only corners contribute to the control values of corners.
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
    /// Returns the sum of one factor times weights over all samples. Sums are computed one at a time: for several, the compiler mixes the
    /// lanes.
    #[inline(always)]
    fn of(&self, factor: usize, groups: &[Group], weights: impl Fn(&Group) -> Lanes) -> f64 {
        let mut sums = [0.0; LANES];
        for (factors, group) in self.0.iter().zip(groups) {
            add(&mut sums, &times(&factors[factor], &weights(group)));
        }
        f64::from(total(&sums))
    }

    /// Returns sums of the Jacobians along x and y, and of these times the differences.
    #[inline(always)]
    fn rows(&self, groups: &[Group]) -> [[f64; 6]; 4] {
        let mut rows = [[0.0; 6]; 4];
        for (factor, row) in rows.iter_mut().enumerate() {
            for (control, sum) in row.iter_mut().enumerate() {
                *sum = self.of(
                    factor,
                    groups,
                    #[inline(always)]
                    |group| group.weights[control],
                );
            }
        }
        rows
    }

    /// Returns sums of products of the control weights, by the products of the gradients.
    #[inline(always)]
    fn products(&self, groups: &[Group]) -> [[[f64; 6]; 6]; 3] {
        let mut products = [[0.0; PAIRS.len()]; 3];
        for (axes, row) in products.iter_mut().enumerate() {
            for ([a, b], sum) in PAIRS.into_iter().zip(row) {
                *sum = self.of(
                    4 + axes,
                    groups,
                    #[inline(always)]
                    |group| times(&group.weights[a], &group.weights[b]),
                );
            }
        }
        products.map(|sums| PRODUCTS.map(|row| row.map(|(place, factor)| sums[place] * factor)))
    }
}

/// Returns the positions in the system of the blocks of a triangle's nodes, in the order in which [`NormalEquations::add_matrix`] writes
/// them.
pub fn places(motion: &Quadratic, layout: &Layout) -> Vec<BlockPlaces> {
    let nodes: Vec<usize> = motion.nodes().map(|(node, _)| node).collect();
    (0..nodes.len()).flat_map(|j| (0..=j).map(move |i| (i, j))).map(|(i, j)| layout.places(nodes[i], nodes[j])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_products_of_control_weights_are_multiples_of_some() {
        let weights = Quadratic::weights([0.2, 0.5, 0.3]);
        for k in 0..6 {
            for l in 0..6 {
                let (place, factor) = PRODUCTS[k][l];
                let [a, b] = PAIRS[place];
                assert!((weights[k] * weights[l] - weights[a] * weights[b] * factor as f32).abs() < 1e-7, "{k} {l}");
            }
        }
    }
}
