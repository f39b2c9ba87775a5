//! Shape prior ahead of the springs: how neutral faces differ from Candide-3's neutral.
//!
//! A face of the prior is `mean + sum_j c_j mode_j` with independent `c_j ~ N(0, deviation_j^2)`. From the marks the similarity and the
//! coefficients are found in turn; the coefficients by ridge regression (maximum a posteriori under Gaussian marking noise).

use nalgebra::{DMatrix, DVector, Point2, Vector2};

use super::Correspondence;
use crate::{geometry::Similarity, wireframe::Wireframe};

/// Standard deviation of Candide's shape units among people; PITFALLS of the field put it near 0.3.
const SHAPE_UNIT_DEVIATION: f64 = 0.3;

/// Standard deviation of a mark in face space, in model units: about a pixel and a half on a face with 100 px between the eyes.
const MARK_DEVIATION: f64 = 0.009;

/// Turns of similarity and coefficients; the change after eight is far below the marking noise.
const ITERATIONS: usize = 8;

/// A linear model of neutral face shape, in face space and Candide's model units.
#[derive(Clone, Debug, PartialEq)]
pub struct ShapePrior {
    /// Mean shape, all N nodes.
    pub mean: Vec<Point2<f64>>,
    /// Modes, each N node offsets.
    pub modes: Vec<Vec<Vector2<f64>>>,
    /// Standard deviation of each mode's coefficient.
    pub deviations: Vec<f64>,
}

impl ShapePrior {
    /// Candide's own neutral and its shape units, as far as a frontal view shows them.
    pub fn candide(wireframe: &Wireframe) -> Self {
        let mut modes = Vec::new();
        for unit in wireframe.shape_units() {
            let mut mode = vec![Vector2::zeros(); wireframe.node_count()];
            for (node, offset) in &unit.offsets {
                mode[node.index()] += offset.xy();
            }
            if mode.iter().any(|v| *v != Vector2::zeros()) {
                modes.push(mode);
            }
        }
        let deviations = vec![SHAPE_UNIT_DEVIATION; modes.len()];
        Self { mean: wireframe.frontal(), modes, deviations }
    }

    /// The most probable face for the marks, in face space; marks are given in the image, `place` maps face space to it.
    pub(super) fn adapt(
        &self,
        marks: &[Correspondence],
        place: impl Fn(&[Point2<f64>]) -> Result<Similarity, super::FitError>,
    ) -> Result<Vec<Point2<f64>>, super::FitError> {
        let rows = 2 * marks.len();
        let modes = self.modes.len();
        let design = DMatrix::from_fn(rows, modes, |r, c| self.modes[c][marks[r / 2].node.index()][r % 2]);
        // (A^T A / s^2 + diag(1 / d^2)) c = A^T r / s^2, solved in the smaller space of the marks.
        let scaled = DMatrix::from_fn(rows, modes, |r, c| design[(r, c)] * self.deviations[c].powi(2));
        let covariance = &scaled * design.transpose() + DMatrix::identity(rows, rows) * MARK_DEVIATION.powi(2);
        let Some(factor) = covariance.cholesky() else { return Ok(self.mean.clone()) };
        let mut shape = self.mean.clone();
        for _ in 0..ITERATIONS {
            let face_from_image = place(&shape)?.inverse();
            let mut residual = DVector::zeros(rows);
            for (i, mark) in marks.iter().enumerate() {
                let seen = face_from_image.apply(&super::flip(mark.position));
                let offset = seen - self.mean[mark.node.index()];
                residual[2 * i] = offset.x;
                residual[2 * i + 1] = offset.y;
            }
            let coefficients = scaled.transpose() * factor.solve(&residual);
            for (k, node) in shape.iter_mut().enumerate() {
                let offset: Vector2<f64> = self.modes.iter().zip(coefficients.iter()).map(|(m, c)| m[k] * *c).sum();
                *node = self.mean[k] + offset;
            }
        }
        Ok(shape)
    }
}
