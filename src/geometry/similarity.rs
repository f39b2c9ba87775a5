//! Least-squares similarity between two planar point sets.

use nalgebra::{Point2, Rotation2, Vector2};

/// A planar similarity without reflection: `p -> scale * R(angle) * p + translation`.
///
/// ```
/// use grimace::geometry::Similarity;
/// use nalgebra::Point2;
///
/// let source = [Point2::new(0.0, 0.0), Point2::new(1.0, 0.0)];
/// let target = [Point2::new(5.0, 0.0), Point2::new(5.0, 2.0)];
/// let quarter_turn = Similarity::fit(&source, &target, None)?;
/// assert!((quarter_turn.scale - 2.0).abs() < 1e-12 && (quarter_turn.angle.to_degrees() - 90.0).abs() < 1e-9);
/// assert!((quarter_turn.apply(&source[1]) - target[1]).norm() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Positive scale, target unit per source unit.
    pub scale: f64,
    /// Rotation angle in radians, from the x axis towards the y axis of the target space.
    pub angle: f64,
    /// Translation in the target's unit.
    pub translation: Vector2<f64>,
}

/// Why point pairs do not determine a similarity.
///
/// ```
/// use grimace::geometry::{Similarity, SimilarityError};
/// use nalgebra::Point2;
///
/// let point = [Point2::new(1.0, 1.0)];
/// assert_eq!(Similarity::fit(&point, &point, None), Err(SimilarityError::TooFewPairs { found: 1 }));
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SimilarityError {
    /// The two sets differ in size, or there are fewer than two pairs with a positive weight.
    #[error("a similarity needs at least 2 point pairs, found {found}")]
    TooFewPairs {
        /// Pairs with a positive weight.
        found: usize,
    },
    /// All points of one set coincide, or a coordinate is not finite.
    #[error("a similarity needs points that do not all coincide")]
    Coincident,
}

impl Similarity {
    /// Returns the identity.
    pub fn identity() -> Self {
        Self { scale: 1.0, angle: 0.0, translation: Vector2::zeros() }
    }

    /// Returns the similarity that minimises `sum_i w_i |target_i - S(source_i)|^2` (closed form, Umeyama 1991 without reflection).
    ///
    /// Weights are 1 if `weights` is `None`.
    ///
    /// # Errors
    /// [`SimilarityError`] for fewer than two pairs or coincident points.
    pub fn fit(source: &[Point2<f64>], target: &[Point2<f64>], weights: Option<&[f64]>) -> Result<Self, SimilarityError> {
        let weight = |i: usize| weights.map_or(1.0, |w| w.get(i).copied().unwrap_or(0.0));
        let count = source.len().min(target.len());
        let used = (0..count).filter(|&i| weight(i) > 0.0).count();
        if used < 2 || source.len() != target.len() {
            return Err(SimilarityError::TooFewPairs { found: used });
        }
        let total: f64 = (0..count).map(weight).sum();
        let mean = |points: &[Point2<f64>]| -> Vector2<f64> {
            (0..count).map(|i| points[i].coords * weight(i)).sum::<Vector2<f64>>() / total
        };
        let (source_mean, target_mean) = (mean(source), mean(target));
        let (mut dot, mut cross, mut source_square) = (0.0, 0.0, 0.0);
        for i in 0..count {
            let (a, b) = (source[i].coords - source_mean, target[i].coords - target_mean);
            dot += weight(i) * a.dot(&b);
            cross += weight(i) * a.perp(&b);
            source_square += weight(i) * a.norm_squared();
        }
        let scale = dot.hypot(cross) / source_square;
        if !scale.is_finite() || scale <= 0.0 {
            return Err(SimilarityError::Coincident);
        }
        let angle = cross.atan2(dot);
        let translation = target_mean - Rotation2::new(angle) * source_mean * scale;
        Ok(Self { scale, angle, translation })
    }

    /// Returns the similarity of those pairs that agree best, `share` of all: fits, keeps the pairs with the smallest distances, and fits again.
    /// So a mouth that opens, or a brow that rises, does not turn or scale the head.
    ///
    /// # Errors
    /// As [`Similarity::fit`].
    pub fn fit_most(source: &[Point2<f64>], target: &[Point2<f64>], share: f64) -> Result<Self, SimilarityError> {
        const ROUNDS: usize = 10;
        let mut fitted = Self::fit(source, target, None)?;
        let kept = ((share * source.len() as f64).ceil() as usize).clamp(2, source.len());
        for _ in 0..ROUNDS {
            let mut order: Vec<(f64, usize)> =
                source.iter().zip(target).map(|(a, b)| (b - fitted.apply(a)).norm_squared()).zip(0..).collect();
            order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let mut weights = vec![0.0; source.len()];
            order[..kept].iter().for_each(|&(_, k)| weights[k] = 1.0);
            // The pairs that agree best may coincide.
            match Self::fit(source, target, Some(&weights)) {
                Ok(next) if next != fitted => fitted = next,
                _ => break,
            }
        }
        Ok(fitted)
    }

    /// Returns the image of a point.
    pub fn apply(&self, point: &Point2<f64>) -> Point2<f64> {
        Rotation2::new(self.angle) * point * self.scale + self.translation
    }

    /// Returns the image of a vector (no translation).
    pub fn apply_vector(&self, vector: &Vector2<f64>) -> Vector2<f64> {
        Rotation2::new(self.angle) * vector * self.scale
    }

    /// Returns the composition: `first`, then this similarity.
    pub fn after(&self, first: &Self) -> Self {
        Self {
            scale: self.scale * first.scale,
            angle: self.angle + first.angle,
            translation: self.apply_vector(&first.translation) + self.translation,
        }
    }

    /// Returns the inverse.
    pub fn inverse(&self) -> Self {
        let scale = 1.0 / self.scale;
        let translation = -(Rotation2::new(-self.angle) * self.translation) * scale;
        Self { scale, angle: -self.angle, translation }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use approx::assert_relative_eq;

    use super::*;

    #[test]
    fn most_pairs_decide() {
        let source: Vec<Point2<f64>> = (0..10).map(|k| Point2::new(f64::from(k % 4), f64::from(k / 4))).collect();
        let turned = Similarity { scale: 2.0, angle: 0.3, translation: Vector2::new(5.0, -1.0) };
        let mut target: Vec<Point2<f64>> = source.iter().map(|p| turned.apply(p)).collect();
        // A mouth that opens.
        target[8].y += 3.0;
        target[9].y += 3.0;
        let found = Similarity::fit_most(&source, &target, 0.6).unwrap();
        assert_relative_eq!(found.scale, 2.0, epsilon = 1e-9);
        assert_relative_eq!(found.angle, 0.3, epsilon = 1e-9);
        assert!((Similarity::fit(&source, &target, None).unwrap().angle - 0.3).abs() > 0.01);
        // Pairs that coincide decide nothing.
        let same = [Point2::new(1.0, 1.0); 3];
        assert!(Similarity::fit_most(&[&same[..], &source[..2]].concat(), &[&same[..], &target[..2]].concat(), 0.6).is_ok());
        assert!(Similarity::fit_most(&same, &same, 0.6).is_err() && Similarity::fit_most(&[], &[], 0.6).is_err());
    }

    #[test]
    fn quarter_turn_doubling_and_shift_are_found() {
        // (1,0) -> (5,2+... ): rotate 90 degrees, double, add (5, 0).
        let source = [Point2::new(0.0, 0.0), Point2::new(1.0, 0.0), Point2::new(0.0, 1.0)];
        let target = [Point2::new(5.0, 0.0), Point2::new(5.0, 2.0), Point2::new(3.0, 0.0)];
        let s = Similarity::fit(&source, &target, None).unwrap();
        assert_relative_eq!(s.scale, 2.0, epsilon = 1e-12);
        assert_relative_eq!(s.angle, FRAC_PI_2, epsilon = 1e-12);
        assert_relative_eq!(s.translation, Vector2::new(5.0, 0.0), epsilon = 1e-12);
        let back = s.inverse();
        for (p, q) in source.iter().zip(&target) {
            assert_relative_eq!(s.apply(p), *q, epsilon = 1e-12);
            assert_relative_eq!(back.apply(q), *p, epsilon = 1e-12);
            assert_relative_eq!(back.after(&s).apply(p), *p, epsilon = 1e-12);
        }
    }

    #[test]
    fn zero_weight_ignores_a_point() {
        let source = [Point2::new(0.0, 0.0), Point2::new(1.0, 0.0), Point2::new(0.0, 1.0)];
        let target = [Point2::new(0.0, 0.0), Point2::new(1.0, 0.0), Point2::new(50.0, 70.0)];
        let s = Similarity::fit(&source, &target, Some(&[1.0, 1.0, 0.0])).unwrap();
        assert_relative_eq!(s.scale, 1.0, epsilon = 1e-12);
        assert_relative_eq!(s.angle, 0.0, epsilon = 1e-12);
    }

    #[test]
    fn too_few_or_coincident_points_are_refused() {
        let p = Point2::new(1.0, 1.0);
        assert_eq!(Similarity::fit(&[p], &[p], None), Err(SimilarityError::TooFewPairs { found: 1 }));
        assert_eq!(Similarity::fit(&[p, p], &[p, p], None), Err(SimilarityError::Coincident));
        let nan = Point2::new(f64::NAN, 1.0);
        assert_eq!(Similarity::fit(&[p, nan], &[p, p], None), Err(SimilarityError::Coincident));
    }
}
