//! The dense surface for given weights, evaluated once after the search.

use super::{Bank, regions::Regions};

/// Number of vertices per block: a block of sums stays in the first-level cache while the members are added one after another.
const BLOCK: usize = 1024;

/// Displacements from neutral of all V vertices, `sum_r share_r(x) sum_i w_ri E_i(x)`.
///
/// `weights` are those of the M members for each region. Members whose weights are all 0 are not read. Sums are in the order of
/// the members, so that every call gives the same bytes.
pub fn surface(bank: &Bank, regions: &Regions, weights: &[Vec<f64>]) -> Vec<[f32; 3]> {
    let mut sum = vec![[0.0_f32; 3]; bank.vertex_count()];
    let members: Vec<(&[[f32; 3]], Vec<f32>)> = (0..bank.member_count())
        .map(|member| (member, weights.iter().map(|region| region.get(member).map_or(0.0, |&w| w as f32)).collect::<Vec<f32>>()))
        .filter(|(_, weights)| weights.iter().any(|&w| w != 0.0))
        .map(|(member, weights)| (bank.displacements(member), weights))
        .collect();
    let mut coefficients = vec![0.0_f32; BLOCK];
    for (block, sums) in sum.chunks_mut(BLOCK).enumerate() {
        let range = block * BLOCK..block * BLOCK + sums.len();
        for (displacements, weights) in &members {
            let displacements = &displacements[range.clone()];
            if let [weight] = weights[..] {
                for (sum, value) in sums.iter_mut().zip(displacements) {
                    (0..3).for_each(|axis| sum[axis] += weight * value[axis]);
                }
                continue;
            }
            let coefficients = &mut coefficients[..sums.len()];
            coefficients.fill(0.0);
            for (region, &weight) in weights.iter().enumerate().filter(|(_, w)| **w != 0.0) {
                let shares = &regions.vertex_shares(region)[range.clone()];
                coefficients.iter_mut().zip(shares).for_each(|(c, share)| *c += weight * share);
            }
            for ((sum, value), &weight) in sums.iter_mut().zip(displacements).zip(&*coefficients) {
                (0..3).for_each(|axis| sum[axis] += weight * value[axis]);
            }
        }
    }
    sum
}

/// Relative error of a surface: the root of the summed squared distances to the truth, divided by that of the true motion.
///
/// It is 0 for the truth itself and 1 for a face at rest. `None` when the truth does not move.
pub fn surface_error(found: &[[f32; 3]], truth: &[[f32; 3]]) -> Option<f64> {
    let square = |v: [f32; 3]| v.iter().map(|&c| f64::from(c) * f64::from(c)).sum::<f64>();
    let difference: f64 = found.iter().zip(truth).map(|(a, b)| square([a[0] - b[0], a[1] - b[1], a[2] - b[2]])).sum();
    let size: f64 = truth.iter().copied().map(square).sum();
    (size > 0.0).then(|| (difference / size).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthesis::{FpBasis, OVERLAP, RegionScheme, candide_bank, testing};

    #[test]
    fn a_surface_is_the_weighted_sum_of_members() {
        let bank = testing::bank();
        let whole = Regions::new(&bank, RegionScheme::Whole, OVERLAP).unwrap();
        let sum = surface(&bank, &whole, &[vec![2.0, 0.0, 0.5]]);
        // 2 right + 1/2 out: vertex 0 along x, 1 along y, 2 along z.
        assert_eq!(sum[..3], [[2.5, 0.0, 0.0], [2.0, 0.5, 0.0], [2.0, 0.0, 0.5]]);
        // The right half, vertices 0 and 3, only moves up.
        let halves = Regions::new(&bank, RegionScheme::Halves, 0.5).unwrap();
        let sum = surface(&bank, &halves, &[vec![0.0, 1.0, 0.0], vec![0.0; 3]]);
        assert_eq!(sum, [[0.0, 1.0, 0.0], [0.0; 3], [0.0; 3], [0.0, 1.0, 0.0]]);
    }

    #[test]
    fn equal_weights_in_all_regions_are_the_whole_face_and_blocks_do_not_show() {
        let bank = candide_bank().unwrap();
        let weights: Vec<f64> = (0..30).map(|k| (f64::from(k) * 0.7).sin()).collect();
        let whole = surface(&bank, &Regions::new(&bank, RegionScheme::Whole, OVERLAP).unwrap(), std::slice::from_ref(&weights));
        let quarters = Regions::new(&bank, RegionScheme::Quarters, OVERLAP).unwrap();
        let joined = surface(&bank, &quarters, &vec![weights.clone(); 4]);
        assert!(surface_error(&joined, &whole).unwrap() < 1e-5);
        let basis = FpBasis::new(&bank);
        for (k, point) in bank.feature_points().iter().enumerate() {
            for (axis, found) in whole[point.vertex as usize].into_iter().enumerate() {
                let expected: f64 = (0..30).map(|m| weights[m] * basis.motion(m, k)[axis]).sum();
                assert!((f64::from(found) - expected).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn errors_are_relative_to_the_true_motion() {
        let truth = [[3.0, 4.0, 0.0], [0.0; 3]];
        assert_eq!(surface_error(&truth, &truth), Some(0.0));
        assert_eq!(surface_error(&[[0.0; 3]; 2], &truth), Some(1.0));
        // The error is (0, 0, 5) for a motion of length 5.
        assert_eq!(surface_error(&[[3.0, 4.0, 5.0], [0.0; 3]], &truth), Some(1.0));
        assert_eq!(surface_error(&truth, &[[0.0; 3]; 2]), None);
    }
}
