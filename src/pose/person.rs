//! The person's head given what is seen of it in posed frames: one step of its coefficients and own offsets, and of the camera's distance.

use nalgebra::{DMatrix, DVector, Matrix2x3, Matrix3, Vector2, Vector3};

use super::{
    CAMERA_DISTANCE, HEAD_ES, HeadModel, HeadPose,
    observe::Own,
    solve::{Directions, Seen, dots, robust, shape_with},
};
use crate::least_squares::{Rows, add_mixture};

/// Standard deviation of the logarithm of the distance.
const LOG_DISTANCE_DEVIATION: f64 = 1.0;
/// One frame as seen by the head: its pose and the offsets of its expression.
pub(super) struct View<'a> {
    pub seen: &'a [Seen],
    pub pose: HeadPose,
    /// The expression's, by node; none in the neutral frame.
    pub offsets: Option<Vec<Vector3<f64>>>,
}

impl View<'_> {
    /// A seen node of a head as the face is turned, and what is left from there to where it is seen, px.
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
    /// From the modes to this person, by node, model units.
    pub own: Vec<Vector3<f64>>,
}

/// What the views say of the place of one node: `sum J'J` and `sum J'(seen - explained)`, weighted.
#[derive(Clone, Copy)]
struct Evidence {
    normal: Matrix3<f64>,
    right: Vector3<f64>,
}

impl Head {
    /// Coefficients and own offsets, each over its standard deviation.
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
    /// The person's own offsets are integrated out of the system for the coefficients: a node whose views determine it by `H` counts
    /// with `(H^-1 + C)^-1`, C the covariance of its own offset.
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
            // With precision P = C^-1 the offset's best answer is (H + P)^-1 (b - P r); what is left for the coefficients:
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
        // Of the matrix only the lower triangle is read.
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

/// By how much the logarithm of the camera's distance is to change, all else given.
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
