//! Radial basis functions: the surface from the feature points alone, without the bank [ZL, section 2, Fig. 3b].

use nalgebra::{DMatrix, Matrix3xX, MatrixXx3, Vector3};

use crate::synthesis::{Bank, FpMotion};

/// Interpolates the displacement of every vertex from the motion of the feature points.
///
/// Uses Hardy multiquadrics whose softness is the distance of each feature point to its nearest neighbour, as in J. Noh, D.
/// Fidaleo and U. Neumann (*Animated deformations with radial basis functions*, 2000), to which \[ZL\] refer. Unknown feature
/// points are left out; unknown depth is 0. Feature points at the same position use their mean. All displacements are zero when
/// no feature point is known.
pub fn interpolate(bank: &Bank, motion: &FpMotion) -> Vec<[f32; 3]> {
    let positions = bank.mesh().positions();
    let mut centres: Vec<(Vector3<f64>, Vector3<f64>, f64)> = Vec::new();
    for (point, offset) in bank.feature_points().iter().zip(&motion.offsets) {
        let Some(mut offset) = *offset else { continue };
        if motion.planar {
            offset.z = 0.0;
        }
        let position = Vector3::from(positions[point.vertex as usize].map(f64::from));
        match centres.iter_mut().find(|c| c.0 == position) {
            Some(centre) => {
                centre.1 += offset;
                centre.2 += 1.0;
            }
            None => centres.push((position, offset, 1.0)),
        }
    }
    let count = centres.len();
    if count == 0 {
        return vec![[0.0; 3]; positions.len()];
    }
    let softness = |k: usize| {
        let others = centres.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, c)| (c.0 - centres[k].0).norm_squared());
        others.fold(f64::INFINITY, f64::min)
    };
    let softness: Vec<f64> = (0..count).map(|k| if count > 1 { softness(k) } else { 1.0 }).collect();
    let basis = |p: &Vector3<f64>, k: usize| ((p - centres[k].0).norm_squared() + softness[k]).sqrt();
    let matrix = DMatrix::from_fn(count, count, |row, k| basis(&centres[row].0, k));
    let wanted = MatrixXx3::from_rows(&centres.iter().map(|c| (c.1 / c.2).transpose()).collect::<Vec<_>>());
    let weights = match matrix.lu().solve(&wanted) {
        Some(weights) if weights.iter().all(|w| w.is_finite()) => weights.transpose(),
        _ => Matrix3xX::zeros(count),
    };
    positions
        .iter()
        .map(|p| {
            let p = Vector3::from(p.map(f64::from));
            let sum = (0..count).fold(Vector3::zeros(), |sum, k| sum + weights.column(k) * basis(&p, k));
            [sum.x as f32, sum.y as f32, sum.z as f32]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthesis::testing;

    #[test]
    fn feature_points_move_as_requested() {
        let bank = testing::bank();
        let offsets = vec![Some(Vector3::new(1.0, 0.0, 0.0)), Some(Vector3::new(0.0, 2.0, 0.0)), Some(Vector3::zeros())];
        let surface = interpolate(&bank, &FpMotion { offsets: offsets.clone(), planar: false, ..FpMotion::default() });
        for (point, offset) in bank.feature_points().iter().zip(offsets) {
            let found = Vector3::from(surface[point.vertex as usize].map(f64::from));
            assert!((found - offset.unwrap()).norm() < 1e-5);
        }
    }

    #[test]
    fn nothing_known_moves_nothing() {
        let bank = testing::bank();
        let surface = interpolate(&bank, &FpMotion { offsets: vec![None; 3], planar: true, ..FpMotion::default() });
        assert!(surface.iter().all(|d| *d == [0.0; 3]));
    }
}
