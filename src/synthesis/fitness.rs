//! The fitness of a candidate [ZL, section 3].

use super::target::{Goal, norm};

/// Mean cosine between candidate and target motion over the M feature points with a target motion, -1 to 1.
///
/// Implements [ZL, section 3], `F = sum(cos theta_i) / M`. The paper does not define the angle of a candidate motion of length 0;
/// it counts as cosine 0 here. `motion` has three numbers for each moving feature point, in any unit.
pub fn fitness(goal: &Goal, motion: &[f64]) -> f64 {
    let pairs = motion.as_chunks::<3>().0.iter().zip(goal.directions().as_chunks::<3>().0);
    let sum: f64 = pairs
        .map(|(v, u)| {
            let length = norm(v);
            if length > 0.0 { (v[0] * u[0] + v[1] * u[1] + v[2] * u[2]) / length } else { 0.0 }
        })
        .sum();
    sum / goal.moving() as f64
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use nalgebra::Vector3;

    use super::*;
    use crate::synthesis::{FpBasis, FpMotion, testing};

    #[test]
    fn the_mean_cosine_over_points_that_should_move() {
        let bank = testing::bank();
        let basis = FpBasis::new(&bank);
        // Three feature points: the first should move along x, the second not at all, the third along y.
        let offsets = vec![Some(Vector3::x()), Some(Vector3::zeros()), Some(2.0 * Vector3::y())];
        let goal = Goal::new(&basis, &FpMotion { offsets, planar: false, ..FpMotion::default() }, |_| true).unwrap();
        assert_eq!(goal.moving(), 2);
        // 60 degrees and 0 degrees: (1/2 + 1) / 2.
        assert_relative_eq!(fitness(&goal, &[0.5, 0.75_f64.sqrt(), 0.0, 0.0, 7.0, 0.0]), 0.75, epsilon = 1e-12);
        // A point that does not move counts as 0: (0 + 1) / 2.
        assert_relative_eq!(fitness(&goal, &[0.0, 0.0, 0.0, 0.0, 1.0, 0.0]), 0.5, epsilon = 1e-12);
        assert_relative_eq!(fitness(&goal, &[-3.0, 0.0, 0.0, 0.0, -1.0, 0.0]), -1.0, epsilon = 1e-12);
    }

    #[test]
    fn in_the_plane_depth_does_not_count() {
        let basis = FpBasis::new(&testing::bank());
        let offsets = vec![Some(Vector3::new(1.0, 0.0, 5.0)), None, None];
        let goal = Goal::new(&basis, &FpMotion { offsets, planar: true, ..FpMotion::default() }, |_| true).unwrap();
        assert_relative_eq!(goal.length(), 1.0);
        assert!(goal.moving_candidate(1).iter().skip(2).step_by(3).all(|&z| z == 0.0));
    }
}
