//! Minimizes quadratic functions over non-negative numbers.

use nalgebra::{DMatrix, DVector};

/// Ridge on the diagonal, as a fraction of its mean: members that are sums of others make the matrix singular.
const RIDGE: f64 = 1e-10;
/// A gradient below this fraction of the largest entry of `f` counts as zero.
const TOLERANCE: f64 = 1e-10;

/// Returns the z >= 0 that minimizes `z' H z / 2 - f' z`, with H symmetric and positive semidefinite, starting from the support
/// of `warm`.
///
/// Active-set method of C. Lawson, R. Hanson: *Solving least squares problems*, 1974, chapter 23, on the normal equations. It
/// stops after at most `4 n + 8` exchanges; well-posed problems need a fraction of that. The result is always feasible.
pub fn minimize(h: &DMatrix<f64>, f: &DVector<f64>, warm: &[f64]) -> Vec<f64> {
    let n = f.len();
    let ridge = RIDGE * h.trace() / n.max(1) as f64;
    let tolerance = TOLERANCE * f.amax();
    let mut z: Vec<f64> = (0..n).map(|k| warm.get(k).copied().unwrap_or(0.0).max(0.0)).collect();
    let mut free: Vec<usize> = (0..n).filter(|&k| z[k] > 0.0).collect();
    let mut exchanges = 0;
    let mut settled = free.is_empty();
    while exchanges < 4 * n + 8 {
        if settled {
            // The number at its bound with the largest gradient.
            let gradient = |k: usize| f[k] - free.iter().map(|&j| h[(k, j)] * z[j]).sum::<f64>();
            let enter = (0..n).filter(|k| !free.contains(k)).map(|k| (k, gradient(k))).max_by(|a, b| a.1.total_cmp(&b.1));
            match enter {
                Some((k, gain)) if gain > tolerance => {
                    free.push(k);
                    free.sort_unstable();
                }
                _ => break,
            }
        }
        exchanges += 1;
        let Some(wanted) = solve(h, f, &free, ridge) else { break };
        let step = free.iter().zip(&wanted).filter(|(_, w)| **w <= 0.0).map(|(&k, &w)| (z[k] / (z[k] - w), k));
        match step.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))) {
            None => {
                free.iter().zip(&wanted).for_each(|(&k, &w)| z[k] = w);
                settled = true;
            }
            Some((share, leaver)) => {
                let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
                free.iter().zip(&wanted).for_each(|(&k, &w)| z[k] += share * (w - z[k]));
                z[leaver] = 0.0;
                free.retain(|&k| k != leaver && z[k] > 0.0);
                settled = free.is_empty();
            }
        }
    }
    (0..n).for_each(|k| {
        if !free.contains(&k) {
            z[k] = 0.0;
        }
    });
    z.iter().map(|v| v.max(0.0)).collect()
}

/// Minimum over the free numbers, with the others at 0.
fn solve(h: &DMatrix<f64>, f: &DVector<f64>, free: &[usize], ridge: f64) -> Option<Vec<f64>> {
    let part = DMatrix::from_fn(free.len(), free.len(), |a, b| h[(free[a], free[b])] + if a == b { ridge } else { 0.0 });
    let right = DVector::from_iterator(free.len(), free.iter().map(|&k| f[k]));
    let answer = part.cholesky()?.solve(&right);
    answer.iter().all(|v| v.is_finite()).then(|| answer.iter().copied().collect())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_bound_that_binds_is_kept() {
        // (z0 - 1)^2/2 + (z1 + 2)^2/2: the minimum over z >= 0 is (1, 0).
        let z = minimize(&DMatrix::identity(2, 2), &DVector::from_vec(vec![1.0, -2.0]), &[0.0, 5.0]);
        assert!((z[0] - 1.0).abs() < 1e-8 && z[1] == 0.0);
    }

    #[test]
    fn a_member_given_twice_does_no_harm() {
        let h = DMatrix::from_element(2, 2, 1.0);
        let z = minimize(&h, &DVector::from_vec(vec![1.0, 1.0]), &[]);
        assert!((z[0] + z[1] - 1.0).abs() < 1e-6 && z.iter().all(|&v| v >= 0.0));
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn the_conditions_of_a_minimum_hold(
            entries in prop::collection::vec(-1.0..1.0_f64, 72), f in prop::collection::vec(-1.0..1.0_f64, 6),
            warm in prop::collection::vec(-1.0..1.0_f64, 6),
        ) {
            // H = A'A with A 12 x 6. At the minimum the gradient is 0 where z > 0 and points nowhere to larger z.
            let a = DMatrix::from_vec(12, 6, entries);
            let (h, f) = (a.transpose() * &a, DVector::from_vec(f));
            let z = DVector::from_vec(minimize(&h, &f, &warm));
            let gradient = &f - &h * &z;
            for k in 0..6 {
                prop_assert!(z[k] >= 0.0);
                prop_assert!(gradient[k] <= 1e-6);
                prop_assert!(z[k] == 0.0 || gradient[k].abs() < 1e-6);
            }
        }
    }
}
