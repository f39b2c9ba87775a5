//! What a triangle's grey values say of its motion.

use nalgebra::{DMatrix, DVector};

use super::{
    sampler::{PRODUCTS, Sample, product},
    surface::Quadratic,
};

/// Fewest samples that tell a motion from a change of brightness.
pub const MIN_SAMPLES: usize = 4;

/// Sum of weights below which a triangle says nothing.
const MIN_WEIGHT: f64 = 0.02;

/// Squared grey levels by which triangles differ that look alike.
const MISMATCH_FLOOR: f64 = 1.0;

/// Standard deviation of a triangle's change of brightness, grey levels.
const BRIGHTNESS_SIGMA: f64 = 20.0;

/// A sample's grey difference to the neutral frame, and the current frame's gradient there.
pub struct Compared<'a> {
    pub difference: f64,
    pub gradient: [f32; 2],
    pub sample: &'a Sample,
}

pub fn mean_difference(list: &[Compared<'_>]) -> f64 {
    list.iter().map(|c| c.difference).sum::<f64>() / list.len().max(1) as f64
}

/// One triangle's normal equations in its control values, x and y of each in turn, with the change of brightness eliminated.
pub struct NormalEquations {
    /// Only if asked for.
    matrix: Option<[[f64; 12]; 12]>,
    right: [f64; 12],
    /// Squared grey levels left.
    pub variance: f64,
}

impl NormalEquations {
    /// A sample's row of the Jacobian is its control weights times its gradient, so their products are the (fixed) products of the
    /// weights times the three of the gradient, and the sums over the samples need no 12 x 12 product of each.
    pub fn new(list: &[Compared<'_>], scale: f64, with_matrix: bool) -> Option<Self> {
        if list.len() < MIN_SAMPLES {
            return None;
        }
        let (mean, scale) = (mean_difference(list), scale as f32);
        // Sums over the samples of weights w, differences r from their mean, Jacobian J, and their products.
        let (mut sum, mut sum_r, mut sum_rr) = (0.0f64, 0.0f64, 0.0f64);
        let (mut sum_j, mut sum_jr, mut sum_jj) = ([[0.0f32; 6]; 2], [[0.0f32; 6]; 2], [[0.0f32; PRODUCTS]; 3]);
        for Compared { difference, gradient: [gx, gy], sample } in list {
            let r = (difference - mean) as f32;
            let w = sample.nearness / (1.0 + (r / scale) * (r / scale));
            let wr = w * r;
            sum += f64::from(w);
            sum_r += f64::from(wr);
            sum_rr += f64::from(wr * r);
            for (sums, factor) in sum_j.iter_mut().zip([w * gx, w * gy]) {
                sums.iter_mut().zip(&sample.weights).for_each(|(s, weight)| *s += factor * weight);
            }
            for (sums, factor) in sum_jr.iter_mut().zip([wr * gx, wr * gy]) {
                sums.iter_mut().zip(&sample.weights).for_each(|(s, weight)| *s += factor * weight);
            }
            if with_matrix {
                for (sums, factor) in sum_jj.iter_mut().zip([w * gx * gx, w * gx * gy, w * gy * gy]) {
                    sums.iter_mut().zip(&sample.products).for_each(|(s, product)| *s += factor * product);
                }
            }
        }
        if sum < MIN_WEIGHT {
            return None;
        }
        let variance = (sum_rr / sum - (sum_r / sum).powi(2)).max(0.0) + MISMATCH_FLOOR;
        // The brightness b is held near 0 by its expected size: b = (sum w r - ...) / divisor.
        let divisor = sum + variance / BRIGHTNESS_SIGMA.powi(2);
        let sum_j: [f64; 12] = std::array::from_fn(|k| sum_j[k % 2][k / 2].into());
        // Differences count from 0, not from their mean.
        let sum_r = sum_r + mean * sum;
        let right = std::array::from_fn(|k| {
            let sum_jr = f64::from(sum_jr[k % 2][k / 2]) + mean * sum_j[k];
            sum_j[k] * sum_r / divisor - sum_jr
        });
        let entry = |k: usize, l: usize| f64::from(sum_jj[k % 2 + l % 2][product(k / 2, l / 2)]) - sum_j[k] * sum_j[l] / divisor;
        let matrix = with_matrix.then(|| std::array::from_fn(|k| std::array::from_fn(|l| entry(k, l))));
        Some(Self { matrix, right, variance })
    }

    /// Carries the right side from the control values to the nodes.
    pub fn add_right(&self, motion: &Quadratic, gain: f64, pull: &mut DVector<f64>) {
        for (node, control) in motion.nodes() {
            for axis in 0..2 {
                pull[2 * node + axis] += gain * (0..6).map(|k| control[k] * self.right[2 * k + axis]).sum::<f64>();
            }
        }
    }

    /// Carries the matrix from the control values to the nodes; only its lower triangle, which is all that the factorization reads.
    pub fn add_matrix(&self, motion: &Quadratic, gain: f64, system: &mut DMatrix<f64>) {
        let Some(matrix) = &self.matrix else { return };
        for (node, control) in motion.nodes() {
            for axis in 0..2 {
                let mut row = [0.0; 12];
                for (k, weight) in control.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
                    row.iter_mut().zip(&matrix[2 * k + axis]).for_each(|(r, m)| *r += gain * weight * m);
                }
                let mut column = system.column_mut(2 * node + axis);
                for (other, control) in motion.nodes().filter(|(other, _)| *other >= node) {
                    let (mut x, mut y) = (0.0, 0.0);
                    for (entry, weight) in row.chunks_exact(2).zip(control) {
                        x += entry[0] * weight;
                        y += entry[1] * weight;
                    }
                    column[2 * other] += x;
                    column[2 * other + 1] += y;
                }
            }
        }
    }
}
