//! Fits the person's head to frames with known poses: one step of its coefficients and own offsets, and of the camera's distance.

use nalgebra::{DMatrix, DVector, Matrix2x3, Matrix3, Vector2, Vector3};

use super::{
    CAMERA_DISTANCE, HEAD_ES, HeadModel, HeadPose,
    observe::Own,
    solve::{Directions, Seen, dots, robust, shape_with},
};
use crate::least_squares::{Rows, add_mixture};

/// Standard deviation of the logarithm of the distance.
const LOG_DISTANCE_DEVIATION: f64 = 1.0;
/// One frame as an observation of the head: its pose and the offsets of its expression.
pub(super) struct View<'a> {
    pub seen: &'a [Seen],
    pub pose: HeadPose,
    /// Offsets of the expression by node; `None` in the neutral frame.
    pub offsets: Option<Vec<Vector3<f64>>>,
}

impl View<'_> {
    /// Returns a visible node of a head in camera axes, and the residual from its projection to its observed position, px.
    fn explained(&self, shape: &[Vector3<f64>], seen: &Seen) -> (Vector3<f64>, Vector2<f64>) {
        let place = shape[seen.node] + self.offsets.as_ref().map_or_else(Vector3::zeros, |o| o[seen.node]);
        let turned = self.pose.turned(&place);
        (turned, seen.at - self.pose.image_of(&turned))
    }
}

/// A person's head.
#[derive(Clone)]
pub(super) struct Head {
    pub coefficients: DVector<f64>,
    /// Offsets of this person from the modes, by node, model units.
    pub own: Vec<Vector3<f64>>,
}

/// Information of the views on the position of one node: `sum J'J` and `sum J'(seen - explained)`, weighted.
#[derive(Clone, Copy)]
struct Evidence {
    normal: Matrix3<f64>,
    right: Vector3<f64>,
}

impl Head {
    /// Returns coefficients and own offsets, each over its standard deviation.
    pub fn in_deviations(&self, own: &[Own]) -> Vec<f64> {
        let offsets = self.own.iter().zip(own).flat_map(|(offset, own)| <[f64; 3]>::from(own.per_spread * offset));
        self.coefficients.iter().copied().chain(offsets).collect()
    }

    pub fn shape(&self, model: &HeadModel) -> Vec<Vector3<f64>> {
        let mut shape = shape_with(&model.mean, &model.identity, &self.coefficients);
        shape.iter_mut().zip(&self.own).for_each(|(x, own)| *x += own);
        shape
    }

    /// Solves for the head given poses and expressions.
    ///
    /// The person's own offsets are integrated out of the system for the coefficients: a node that its views determine with precision `H`
    /// has the precision `(H^-1 + C)^-1`, where C is the covariance of its own offset.
    pub fn improve(&mut self, model: &HeadModel, identity: &Directions, views: &[View<'_>], own: &[Own]) {
        let shape = self.shape(model);
        let nothing = Evidence { normal: Matrix3::zeros(), right: Vector3::zeros() };
        let mut evidence = vec![nothing; model.node_count()];
        for view in views {
            for s in view.seen {
                let (turned, residual) = view.explained(&shape, s);
                let deviation = s.deviation * view.pose.scale;
                let weight =
                    robust(residual.norm() / deviation.hypot(own[s.node].deviation * view.pose.scale)) / (deviation * deviation);
                let slope: Matrix2x3<f64> = view.pose.slope(&turned) * view.pose.rotation.matrix();
                evidence[s.node].normal += slope.transpose() * slope * weight;
                evidence[s.node].right += slope.transpose() * residual * weight;
            }
        }
        let count = model.identity.len();
        let mut normal = DMatrix::<f64>::identity(count, count);
        let mut right = -self.coefficients.clone();
        let (mut rows, mut counted_rows) = (Rows::new(count), Rows::new(count));
        for (k, e) in evidence.iter().enumerate() {
            // With precision P = C^-1 the optimal offset is (H + P)^-1 (b - P r); the remainder for the coefficients:
            let precision = own[k].precision;
            let Some(inverse) = (e.normal + precision).try_inverse() else { continue };
            let counted = e.normal - e.normal * inverse * e.normal;
            let pulled = e.right - e.normal * inverse * (e.right - precision * self.own[k]);
            let along = identity.of(k);
            add_mixture(right.as_mut_slice(), pulled.into(), along);
            for axis in 0..3 {
                rows.add().copy_from_slice(along[axis]);
                counted_rows.add_mixture([0, 1, 2].map(|other| counted[(axis, other)]), along);
            }
        }
        counted_rows.add_products(&rows, &mut normal);
        // Only the lower triangle of the matrix is read.
        let Some(step) = normal.cholesky().map(|factor| factor.solve(&right)) else { return };
        for (k, e) in evidence.iter().enumerate() {
            let precision = own[k].precision;
            let moved = Vector3::from(dots(identity.of(k), step.as_slice()));
            if let Some(inverse) = (e.normal + precision).try_inverse() {
                let change = inverse * (e.right - e.normal * moved - precision * self.own[k]);
                self.own[k] += change;
            }
        }
        self.coefficients += step;
    }
}

/// Returns the change of the logarithm of the camera's distance, with everything else fixed.
pub(super) fn log_distance_step(shape: &[Vector3<f64>], views: &[View<'_>]) -> f64 {
    let precision = LOG_DISTANCE_DEVIATION.powi(-2);
    let distance = views.first().map_or(CAMERA_DISTANCE * HEAD_ES, |view| view.pose.distance);
    let mut normal = precision;
    let mut right = -precision * (distance / (CAMERA_DISTANCE * HEAD_ES)).ln();
    for view in views {
        for s in view.seen {
            let (turned, residual) = view.explained(shape, s);
            let deviation = s.deviation * view.pose.scale;
            let weight = robust(residual.norm() / deviation) / (deviation * deviation);
            let slope = view.pose.distance_slope(&turned);
            normal += weight * slope.norm_squared();
            right += weight * slope.dot(&residual);
        }
    }
    right / normal
}
