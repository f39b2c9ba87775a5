//! The dense surface of weights, evaluated once, when the weights are known.

use super::{Bank, regions::Regions};

/// Vertices per block: what is summed stays in the first-level cache while one member after another streams by.
const BLOCK: usize = 1024;

/// Displacements from neutral of all V vertices, `sum_r share_r(x) sum_i w_ri E_i(x)`.
///
/// `weights` are those of the M members, region by region; members that weigh nothing everywhere are not read. Sums are in the
/// members' order, so that every call gives the same bytes.
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

/// How far a surface is from the true one: the root of the summed squared distances over that of the true motion.
///
/// 0 for the truth itself, 1 for a face that rests. `None` when the truth rests.
pub fn surface_error(found: &[[f32; 3]], truth: &[[f32; 3]]) -> Option<f64> {
    let square = |v: [f32; 3]| v.iter().map(|&c| f64::from(c) * f64::from(c)).sum::<f64>();
    let difference: f64 = found.iter().zip(truth).map(|(a, b)| square([a[0] - b[0], a[1] - b[1], a[2] - b[2]])).sum();
    let size: f64 = truth.iter().copied().map(square).sum();
    (size > 0.0).then(|| (difference / size).sqrt())
}
