//! Shape prior that is applied before the springs: a model of neutral faces beyond Candide-3's own neutral shape.
//!
//! A face of the prior is `mean + sum_j c_j mode_j + e` in face space, with independent `c_j ~ N(0, deviation_j^2)` and, at node k, a
//! residual `e ~ N(0, residual_k^2)` outside the modes. A mark adds its own error of [`ShapePrior::mark_deviation`]. With the marks z, the
//! similarity A from image to face space and the coefficients c follow from one linear system, the maximum a posteriori
//! ```text
//! minimise |A z - mean - M c|^2_S + sum_j (c_j / deviation_j)^2        S: diagonal, residual_k^2 + mark_deviation^2
//! ```
//!
//! A is linear in its four parameters, so no iteration is needed. Competing priors are weighted by the probability of the marks
//! ([`Explanation::log_evidence`]).

mod faces;
mod far;
mod file;
mod learn;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix4, Point2, Vector2, Vector4};

use crate::{
    geometry::{Similarity, SimilarityError},
    units::NodeId,
    wireframe::Wireframe,
};

pub use faces::{FacePoints, NeutralFace, check_faces_once, read_neutral_faces};
pub use file::{FaceSource, PriorFile, PriorFileError, PriorOrigin, read_prior, write_prior};
pub(crate) use learn::mirror_nodes;
pub use learn::{DEFAULT_MODES, LearnError, learn_prior};

/// Standard deviation of Candide's shape units among people; the literature puts it near 0.3.
const SHAPE_UNIT_DEVIATION: f64 = 0.3;

/// Standard deviation of a mark on a face that differs from Candide's only by shape units, model units: one pixel on a face with 100 px
/// between the pupils.
const CANDIDE_MARK_DEVIATION: f64 = 0.006;

/// Standard deviation of a mark on a real face, model units: 1.6 % of the eye distance. Points set by hand and points of a landmark network
/// differ by 1.3 to 2.5 % at the corners of eyes and mouth.
const FACES_MARK_DEVIATION: f64 = 0.01;

/// Smallest standard deviation of a mark, model units: no mark is exact.
const LEAST_MARK_DEVIATION: f64 = 0.002;

/// A linear model of neutral face shape, in face space and Candide's model units.
///
/// ```
/// use grimace::{fit::ShapePrior, wireframe::Wireframe};
///
/// let candide = ShapePrior::candide(&Wireframe::candide3());
/// assert_eq!((candide.mean.len(), candide.modes.len()), (113, candide.deviations.len()));
/// // Two priors were learned from real faces: by landmarks of networks, and by points set by hand.
/// assert!(ShapePrior::faces().iter().all(|prior| prior.mean.len() == 113));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ShapePrior {
    /// Mean shape, all N nodes.
    pub mean: Vec<Point2<f64>>,
    /// Modes, each N node offsets.
    pub modes: Vec<Vec<Vector2<f64>>>,
    /// Standard deviation of each mode's coefficient, > 0.
    pub deviations: Vec<f64>,
    /// Residual of each node's position that the modes leave: standard deviation in x and in y, >= 0.
    pub residuals: Vec<f64>,
    /// Standard deviation of a mark in x and in y, > 0.
    pub mark_deviation: f64,
}

/// The most probable face of a prior for some marks.
#[derive(Clone, Debug, PartialEq)]
pub struct Explanation {
    /// All N nodes in face space.
    pub shape: Vec<Point2<f64>>,
    /// Maps the shape to the space of the marks.
    pub marks_from_face: Similarity,
    /// Standard deviation of the position of every node in x and in y given the marks, in the unit of the marks.
    pub deviations: Vec<f64>,
    /// Logarithm of the probability density of the marks under the prior at this placement, up to a constant that does not depend on the
    /// prior.
    pub log_evidence: f64,
}

impl ShapePrior {
    /// Checks that all parts are over the nodes of the mean, all numbers are finite, and deviations positive.
    ///
    /// # Errors
    /// What is wrong.
    pub(super) fn check(&self) -> Result<(), String> {
        let count = self.mean.len();
        let counted = |what: &str, found: usize, expected: usize| {
            if found == expected { Ok(()) } else { Err(format!("it has {found} {what}, but {expected} are needed")) }
        };
        self.modes.iter().try_for_each(|mode| counted("offsets in a mode", mode.len(), count))?;
        counted("deviations of modes", self.deviations.len(), self.modes.len())?;
        counted("residuals", self.residuals.len(), count)?;
        if let Some(k) = self.mean.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
            return Err(format!("node {k} of its mean is not at a finite position"));
        }
        if !self.modes.iter().flatten().flat_map(|offset| offset.iter()).all(|c| c.is_finite()) {
            return Err("an offset of a mode is not finite".to_owned());
        }
        let deviations = self.deviations.iter().chain([&self.mark_deviation]);
        if let Some(odd) = deviations.copied().find(|d| !(d.is_finite() && *d > 0.0)) {
            return Err(format!("a deviation is {odd}; it must be a finite number above 0"));
        }
        match self.residuals.iter().find(|r| !(r.is_finite() && **r >= 0.0)) {
            Some(odd) => Err(format!("a residual is {odd}; it must be a finite number of at least 0")),
            None => Ok(()),
        }
    }

    /// Returns the prior of Candide's own neutral shape and its shape units, as far as a frontal view shows them.
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
        Self {
            mean: wireframe.frontal(),
            deviations: vec![SHAPE_UNIT_DEVIATION; modes.len()],
            modes,
            residuals: vec![0.0; wireframe.node_count()],
            mark_deviation: CANDIDE_MARK_DEVIATION,
        }
    }

    /// Returns the embedded priors learned from real faces: one from landmarks of networks (`candide/face_prior.json`), one from points set
    /// by hand (`candide/face_prior_by_hand.json`). The files contain their credits.
    ///
    /// Both are of the same people, but networks and people define features such as the end of a brow or the tip of a chin differently: a
    /// network's brows lie a tenth of the eye distance higher. The marks decide which definition applies.
    pub fn faces() -> [Self; 2] {
        file::embedded()
    }

    /// Returns the most probable face for marks at `nodes` (at least three, all of them below the mean's length).
    ///
    /// `seen` are their positions, y up, in any unit: the image with y flipped. Every mark has the error [`Self::mark_deviation`].
    ///
    /// # Errors
    /// [`SimilarityError`] if the marks do not determine a placement.
    ///
    /// # Panics
    /// If a node is not one of the prior's, or `nodes` and `seen` differ in length (a programmer's error).
    pub(crate) fn explain(&self, nodes: &[NodeId], seen: &[Point2<f64>]) -> Result<Explanation, SimilarityError> {
        self.explain_by_errors(nodes, seen, &vec![None; nodes.len()])
    }

    /// Same as [`Self::explain`], for marks with individual errors: `deviations` are their standard deviations in x and in y, in the unit
    /// of `seen`; `None` for a mark of [`Self::mark_deviation`].
    ///
    /// # Errors
    /// As [`Self::explain`].
    ///
    /// # Panics
    /// As [`Self::explain`].
    pub(crate) fn explain_by_errors(
        &self,
        nodes: &[NodeId],
        seen: &[Point2<f64>],
        deviations: &[Option<f64>],
    ) -> Result<Explanation, SimilarityError> {
        assert!(nodes.len() == seen.len() && nodes.len() == deviations.len(), "a place for every node");
        let rows = 2 * nodes.len();
        let mean: Vec<Point2<f64>> = nodes.iter().map(|n| self.mean[n.index()]).collect();
        // Positions near the mean make the linear system well scaled for any image.
        let rough = Similarity::fit(seen, &mean, None)?;
        let near: Vec<Point2<f64>> = seen.iter().map(|p| rough.apply(p)).collect();
        let modes = DMatrix::from_fn(rows, self.modes.len(), |r, c| self.modes[c][nodes[r / 2].index()][r % 2]);
        let scaled = DMatrix::from_fn(rows, self.modes.len(), |r, c| modes[(r, c)] * self.deviations[c].powi(2));
        let of_mark = |d: &Option<f64>| d.map_or(self.mark_deviation, |d| (d * rough.scale).max(LEAST_MARK_DEVIATION)).powi(2);
        let own: Vec<f64> = deviations.iter().map(of_mark).collect();
        let noise: Vec<f64> = nodes.iter().zip(&own).map(|(node, own)| own + self.residuals[node.index()].powi(2)).collect();
        let mut covariance = &scaled * modes.transpose();
        for (i, noise) in noise.iter().enumerate() {
            covariance[(2 * i, 2 * i)] += noise;
            covariance[(2 * i + 1, 2 * i + 1)] += noise;
        }
        let factor: Cholesky<f64, Dyn> = covariance.cholesky().ok_or(SimilarityError::Coincident)?;
        // A p = (a x - b y + u, b x + a y + v) with the unknowns (a, b, u, v).
        let design = DMatrix::from_fn(rows, 4, |r, c| {
            let p = near[r / 2];
            [[p.x, -p.y, 1.0, 0.0], [p.y, p.x, 0.0, 1.0]][r % 2][c]
        });
        let target = DVector::from_fn(rows, |r, _| mean[r / 2][r % 2]);
        let weighted = factor.solve(&design);
        let normal = Matrix4::from_iterator((weighted.transpose() * &design).iter().copied());
        let right = Vector4::from_iterator((weighted.transpose() * &target).iter().copied());
        let unknowns = normal.cholesky().ok_or(SimilarityError::Coincident)?.solve(&right);
        let [a, b, u, v] = [unknowns[0], unknowns[1], unknowns[2], unknowns[3]];
        let scale = a.hypot(b);
        if !scale.is_finite() || scale <= 0.0 {
            return Err(SimilarityError::Coincident);
        }
        let fine = Similarity { scale, angle: b.atan2(a), translation: Vector2::new(u, v) };
        let residual = &design * DVector::from_column_slice(unknowns.as_slice()) - target;
        let pull = factor.solve(&residual);
        let coefficients = scaled.transpose() * &pull;
        let offset = |k: usize| -> Vector2<f64> { self.modes.iter().zip(coefficients.iter()).map(|(m, c)| m[k] * *c).sum() };
        let shape: Vec<Point2<f64>> = self.mean.iter().enumerate().map(|(k, p)| p + offset(k)).collect();
        let open = self.left_open(&modes, &design, &noise, &shape.iter().map(|p| fine.inverse().apply(p)).collect::<Vec<_>>());
        let marked = |k: usize| nodes.iter().zip(&own).find(|(node, _)| node.index() == k).map(|(_, own)| *own);
        let deviation = |(k, open): (usize, f64)| {
            let residual = self.residuals[k].powi(2);
            // A node's mark reduces the residual that the modes leave.
            let left = marked(k).map_or(residual, |own| residual * own / (residual + own));
            (open + left).max(0.0).sqrt() / (fine.scale * rough.scale)
        };
        let deviations = open.into_iter().enumerate().map(deviation).collect();
        let log_determinant: f64 = (0..rows).map(|i| 2.0 * factor.l_dirty()[(i, i)].ln()).sum();
        // The last term is the Jacobian of the similarity: it makes the evidence independent of a prior's unit of length.
        let log_scale = rough.scale.ln() + fine.scale.ln();
        let log_evidence = -0.5 * residual.dot(&pull) - 0.5 * log_determinant + rows as f64 * log_scale;
        Ok(Explanation { shape, marks_from_face: rough.inverse().after(&fine.inverse()), deviations, log_evidence })
    }

    /// Returns the variance in x and in y, face space, of every node at `near`, given the uncertainty of coefficients and similarity. The
    /// marks are a linear measurement of both, `[modes, -design]`, with variance `noise` at each mark. Infinite if they do not determine
    /// them.
    fn left_open(&self, modes: &DMatrix<f64>, design: &DMatrix<f64>, noise: &[f64], near: &[Point2<f64>]) -> Vec<f64> {
        let count = self.modes.len();
        let size = count + 4;
        let mut rows = DMatrix::zeros(modes.nrows(), size);
        rows.columns_mut(0, count).copy_from(modes);
        rows.columns_mut(count, 4).copy_from(&-design);
        let weighted = DMatrix::from_fn(rows.nrows(), size, |r, c| rows[(r, c)] / noise[r / 2]);
        let mut information = rows.transpose() * weighted;
        self.deviations.iter().enumerate().for_each(|(c, deviation)| information[(c, c)] += deviation.powi(-2));
        let Some(factor) = information.cholesky() else { return vec![f64::INFINITY; near.len()] };
        let node = |(k, p): (usize, &Point2<f64>)| {
            let mut x = DVector::from_fn(size, |c, _| if c < count { self.modes[c][k].x } else { 0.0 });
            let mut y = DVector::from_fn(size, |c, _| if c < count { self.modes[c][k].y } else { 0.0 });
            x.rows_mut(count, 4).copy_from_slice(&[-p.x, p.y, -1.0, 0.0]);
            y.rows_mut(count, 4).copy_from_slice(&[-p.y, -p.x, 0.0, -1.0]);
            0.5 * [x, y]
                .into_iter()
                .map(|v| factor.l_dirty().solve_lower_triangular(&v).map_or(f64::INFINITY, |h| h.norm_squared()))
                .sum::<f64>()
        };
        near.iter().enumerate().map(node).collect()
    }
}

/// Returns the weights of competing explanations: proportional to their evidence times their prior odds, with sum 1.
pub(super) fn shares(explanations: &[Explanation], log_odds: &[f64]) -> Vec<f64> {
    let posterior: Vec<f64> = explanations.iter().zip(log_odds).map(|(e, odds)| e.log_evidence + odds).collect();
    let best = posterior.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = posterior.iter().map(|p| (p - best).exp()).collect();
    let total: f64 = weights.iter().sum();
    weights.iter().map(|w| w / total).collect()
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    /// Three nodes on a triangle; one mode that moves node 2 up.
    fn small(mark_deviation: f64) -> ShapePrior {
        let mean = vec![Point2::new(-1.0, 0.0), Point2::new(1.0, 0.0), Point2::new(0.0, 1.0)];
        let mode = vec![Vector2::zeros(), Vector2::zeros(), Vector2::new(0.0, 1.0)];
        ShapePrior { mean, modes: vec![mode], deviations: vec![1.0], residuals: vec![0.0; 3], mark_deviation }
    }

    const NODES: [NodeId; 3] = [NodeId(0), NodeId(1), NodeId(2)];

    #[test]
    fn exact_marks_are_explained_by_the_mode() {
        // Node 2 at 1.5 is half a mode; then everything doubled and shifted by (10, 20).
        let seen = [Point2::new(8.0, 20.0), Point2::new(12.0, 20.0), Point2::new(10.0, 23.0)];
        let found = small(1e-4).explain(&NODES, &seen).unwrap();
        assert_relative_eq!(found.shape[2], Point2::new(0.0, 1.5), epsilon = 1e-5);
        assert_relative_eq!(found.marks_from_face.scale, 2.0, epsilon = 1e-5);
        for (p, q) in found.shape.iter().zip(&seen) {
            assert_relative_eq!(found.marks_from_face.apply(p), *q, epsilon = 1e-5);
        }
    }

    #[test]
    fn the_evidence_does_not_depend_on_the_unit_of_the_prior_and_favours_the_fitting_one() {
        let seen = [Point2::new(8.0, 20.0), Point2::new(12.0, 20.0), Point2::new(10.0, 23.0)];
        let prior = small(0.01);
        let mut larger = prior.clone();
        larger.mean.iter_mut().for_each(|p| *p *= 3.0);
        larger.modes[0].iter_mut().for_each(|v| *v *= 3.0);
        larger.mark_deviation *= 3.0;
        let evidence = |prior: &ShapePrior| prior.explain(&NODES, &seen).unwrap().log_evidence;
        assert_relative_eq!(evidence(&prior), evidence(&larger), epsilon = 1e-9);
        let mut stiff = prior.clone();
        stiff.deviations[0] = 0.01;
        assert!(evidence(&prior) > evidence(&stiff));
        let both = [&prior, &larger].map(|p| p.explain(&NODES, &seen).unwrap());
        assert_relative_eq!(shares(&both, &[0.0, 0.0])[0], 0.5, epsilon = 1e-9);
        // Prior odds of e to 1.
        assert_relative_eq!(shares(&both, &[1.0, 0.0])[0], 0.731_058_578_630, epsilon = 1e-9);
    }

    #[test]
    fn coincident_marks_are_refused() {
        let seen = [Point2::new(1.0, 1.0); 3];
        assert_eq!(small(0.01).explain(&NODES, &seen), Err(SimilarityError::Coincident));
    }

    #[test]
    fn the_shipped_faces_are_symmetric_and_lie_on_candide_s_eyes_and_nose() {
        let w = Wireframe::candide3();
        for faces in ShapePrior::faces() {
            assert_eq!(faces.mean.len(), w.node_count());
            // Left and right mouth corner: 31 and 64; eye corners 20 and 53.
            for (left, right) in [(31, 64), (20, 53)] {
                let (l, r): (Point2<f64>, Point2<f64>) = (faces.mean[left], faces.mean[right]);
                assert_relative_eq!(l.x, -r.x, epsilon = 2e-5);
                assert_relative_eq!(l.y, r.y, epsilon = 2e-5);
            }
            let stable = learn::stable_nodes(&crate::wireframe::Tables::candide3());
            let pick = |shape: &[Point2<f64>]| -> Vec<Point2<f64>> { stable.iter().map(|n| shape[n.index()]).collect() };
            let onto = Similarity::fit(&pick(&faces.mean), &pick(&w.frontal()), None).unwrap();
            // Aligned by construction; the file is rounded to 1e-5.
            assert_relative_eq!(onto.scale, 1.0, epsilon = 1e-4);
            assert_relative_eq!(onto.translation, Vector2::zeros(), epsilon = 1e-4);
        }
    }
}
