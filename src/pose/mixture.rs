//! Anderson acceleration of a fixed-point iteration.

use nalgebra::{DMatrix, DVector};

/// Number of steps that a mixture keeps.
const MEMORY: usize = 12;
/// Factor of growth of the change from one step to the next that restarts the mixture.
const ASTRAY: f64 = 4.0;
/// Ridge over the largest of the sums of squares; smaller differences are rounding errors.
const RIDGE: f64 = 1e-10;

/// Anderson mixture of the last steps of `x <- f(x)`: the combination of them whose changes `f(x) - x` would cancel best.
///
/// D. G. Anderson: *Iterative procedures for nonlinear integral equations*, J. ACM 12, 1965, in the form of H. F. Walker, P. Ni:
/// *Anderson acceleration for fixed-point iterations*, SIAM J. Numer. Anal. 49, 2011.
#[derive(Debug, Default)]
pub(super) struct Mixture {
    /// Changes and results, latest last.
    steps: Vec<(DVector<f64>, DVector<f64>)>,
}

impl Mixture {
    /// Returns the next starting point after a step from `before` to `after`.
    pub fn next(&mut self, before: &DVector<f64>, after: DVector<f64>) -> DVector<f64> {
        let change = &after - before;
        // After a diverging step, the previous steps are discarded.
        if self.steps.last().is_some_and(|(last, _)| change.norm() > ASTRAY * last.norm()) {
            self.steps.clear();
        }
        if self.steps.len() == MEMORY {
            self.steps.remove(0);
        }
        self.steps.push((change, after));
        let Some(((change, result), _)) = self.steps.split_last() else { return before.clone() };
        let pairs: Vec<_> = self.steps.windows(2).map(|w| (&w[1].0 - &w[0].0, &w[1].1 - &w[0].1)).collect();
        let count = pairs.len();
        let mut normal = DMatrix::from_fn(count, count, |i, j| pairs[i].0.dot(&pairs[j].0));
        let ridge = RIDGE * normal.diagonal().iter().copied().fold(0.0, f64::max);
        (0..count).for_each(|k| normal[(k, k)] += ridge);
        let right = DVector::from_iterator(count, pairs.iter().map(|(by, _)| by.dot(change)));
        let mut mixed = result.clone();
        if let Some(shares) = normal.cholesky().map(|factor| factor.solve(&right)) {
            pairs.iter().zip(shares.iter()).for_each(|((_, by), &share)| mixed.axpy(-share, by, 1.0));
        }
        mixed
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    #[test]
    fn a_linear_step_comes_to_rest_in_as_many_turns_as_it_has_dimensions() {
        // x <- A x + b with slow directions: plain iteration needs hundreds of steps.
        let by = DVector::from_vec(vec![0.99, 0.9, -0.5]);
        let step = |x: &DVector<f64>| x.component_mul(&by) + DVector::from_element(3, 1.0);
        let (mut mixture, mut x) = (Mixture::default(), DVector::zeros(3));
        for _ in 0..6 {
            let after = step(&x);
            x = mixture.next(&x, after);
        }
        let expected = by.map(|b| 1.0 / (1.0 - b));
        assert_relative_eq!(x, expected, max_relative = 1e-4);
    }
}
