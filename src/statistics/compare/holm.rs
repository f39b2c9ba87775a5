//! Holm's correction for multiple tests.

/// Returns p values corrected by Holm's step-down procedure (1979), in the given order; `NaN` counts as 1.
///
/// The i-th smallest of n, counted from 0, is multiplied by n - i. No corrected p is smaller than the previous one or larger than 1. If
/// you reject where the corrected p is at most q, the probability of one or more false rejections is at most q, whatever the dependence
/// between the tests.
pub fn holm(p: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p.len()).collect();
    let value = |k: usize| if p[k].is_nan() { 1.0 } else { p[k] };
    order.sort_by(|&a, &b| value(a).total_cmp(&value(b)).then(a.cmp(&b)));
    let mut adjusted = vec![1.0; p.len()];
    let mut largest: f64 = 0.0;
    for (rank, &k) in order.iter().enumerate() {
        largest = largest.max(value(k) * (p.len() - rank) as f64).min(1.0);
        adjusted[k] = largest;
    }
    adjusted
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn each_is_multiplied_by_the_tests_that_are_left() {
        // Sorted 0.01, 0.02, 0.03, 0.04: times 4, 3, 2, 1 = 0.04, 0.06, 0.06, 0.04, the last lifted to the one before it.
        assert_eq!(holm(&[0.04, 0.01, 0.03, 0.02]), [0.06, 0.04, 0.06, 0.06]);
        assert_eq!(holm(&[0.5, 0.9]), [1.0, 1.0]);
        assert_eq!(holm(&[0.02]), [0.02]);
        assert_eq!(holm(&[f64::NAN, 0.01]), [1.0, 0.02]);
        assert!(holm(&[]).is_empty());
    }

    proptest! {
        #[test]
        fn corrected_values_are_larger_and_in_the_same_order(p in proptest::collection::vec(0.0..1.0f64, 1..20)) {
            let adjusted = holm(&p);
            for i in 0..p.len() {
                prop_assert!(adjusted[i] >= p[i] && adjusted[i] <= 1.0);
                for j in 0..p.len() {
                    prop_assert!(p[i] > p[j] || adjusted[i] <= adjusted[j]);
                }
            }
        }
    }
}
