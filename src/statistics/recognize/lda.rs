//! Linear discriminant analysis with a shrunk covariance.
//!
//! Models have more coordinates than there are sequences. Therefore the pooled covariance S within labels is shrunk towards a multiple of
//! the identity, `(1 - lambda) S + lambda mu I`, by the share lambda that Ledoit & Wolf (2004) derive from the data. A sequence's squared
//! distance to a label's mean is the Mahalanobis distance in that covariance. With equal priors, probabilities are proportional to
//! `exp(-distance / 2)`, so the nearest label is the most probable.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Discriminants of a set of labels.
#[derive(Clone, Debug)]
pub(super) struct Discriminants {
    /// Mean by label; `None` for a label without sequences.
    means: Vec<Option<DVector<f64>>>,
    /// The data minus their labels' means, one row each.
    centered: DMatrix<f64>,
    /// Cholesky factor of `X X^T + ridge I`.
    gram: Cholesky<f64, Dyn>,
    /// lambda mu.
    floor: f64,
}

/// Sequences of the same label do not differ: there are no discriminants.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoScatter;

impl Discriminants {
    /// Computes the discriminants of `data` (one row per sequence). `label_of` are the label numbers of the rows, less than `labels`.
    pub fn new(data: &DMatrix<f64>, label_of: &[usize], labels: usize) -> Result<Self, NoScatter> {
        let (n, p) = (data.nrows(), data.ncols());
        let mut means: Vec<Option<DVector<f64>>> = vec![None; labels];
        let mut counts = vec![0usize; labels];
        for (row, &label) in data.row_iter().zip(label_of) {
            counts[label] += 1;
            *means[label].get_or_insert_with(|| DVector::zeros(p)) += row.transpose();
        }
        for (mean, &count) in means.iter_mut().zip(&counts) {
            if let Some(mean) = mean {
                *mean /= count.max(1) as f64;
            }
        }
        let mut centered = data.clone();
        for (mut row, &label) in centered.row_iter_mut().zip(label_of) {
            if let Some(mean) = &means[label] {
                row -= mean.transpose();
            }
        }
        let products = &centered * centered.transpose();
        let count = n as f64;
        // Traces of S and of its square, from the products of the rows.
        let mu = products.trace() / count / p as f64;
        let square = products.norm_squared() / (count * count);
        if !(mu > 0.0 && mu.is_finite()) {
            return Err(NoScatter);
        }
        let shrinkage = shrinkage(&products, square, mu, p as f64);
        let floor = shrinkage * mu;
        // (a X^T X + f I)^-1 = (I - X^T (X X^T + f / a I)^-1 X) / f with a = (1 - lambda) / n.
        let mut gram = products;
        let ridge = floor * count / (1.0 - shrinkage);
        gram.fill_diagonal_with(|d| d + ridge);
        let gram = Cholesky::new(gram).ok_or(NoScatter)?;
        Ok(Self { means, centered, gram, floor })
    }

    /// Returns the squared Mahalanobis distance to the mean of every label.
    pub fn distances(&self, data: &DVector<f64>) -> Vec<Option<f64>> {
        let of_mean = |mean: &DVector<f64>| {
            let d = data - mean;
            let products = &self.centered * &d;
            ((d.norm_squared() - products.dot(&self.gram.solve(&products))) / self.floor).max(0.0)
        };
        self.means.iter().map(|mean| mean.as_ref().map(of_mean)).collect()
    }
}

trait FillDiagonal {
    fn fill_diagonal_with(&mut self, value: impl Fn(f64) -> f64);
}

impl FillDiagonal for DMatrix<f64> {
    fn fill_diagonal_with(&mut self, value: impl Fn(f64) -> f64) {
        for k in 0..self.nrows().min(self.ncols()) {
            self[(k, k)] = value(self[(k, k)]);
        }
    }
}

/// Returns Ledoit & Wolf's lambda, kept away from 0 and 1 so that the covariance can be inverted.
fn shrinkage(products: &DMatrix<f64>, square: f64, mu: f64, p: f64) -> f64 {
    const LEAST: f64 = 1e-6;
    let n = products.nrows() as f64;
    let distance = square / p - mu * mu;
    let fourth: f64 = (0..products.nrows()).map(|k| products[(k, k)].powi(2)).sum::<f64>() / n;
    let error = (fourth - square) / (n * p);
    let share = if distance > 0.0 { error.min(distance) / distance } else { 1.0 };
    share.clamp(LEAST, 1.0 - LEAST)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn data() -> (DMatrix<f64>, Vec<usize>) {
        let value = |i: usize, j: usize| {
            let shift = if i % 2 == 1 && j == 1 { 1.5 } else { 0.0 };
            (1.7 * i as f64 + 0.9 * j as f64).sin() + shift
        };
        (DMatrix::from_fn(12, 5, value), (0..12).map(|i| i % 2).collect())
    }

    #[test]
    fn distances_agree_with_scikit_learn() {
        // scripts/check_statistics.py prints these.
        let (data, labels) = data();
        let discriminants = Discriminants::new(&data, &labels, 3).unwrap();
        let found = discriminants.distances(&DVector::from_vec(vec![0.3, -0.2, 0.5, 0.1, -0.4]));
        approx::assert_relative_eq!(found[0].unwrap(), 5.71049548, max_relative = 1e-7);
        approx::assert_relative_eq!(found[1].unwrap(), 46.7427272, max_relative = 1e-7);
        assert_eq!(found[2], None);
    }

    #[test]
    fn sequences_that_do_not_scatter_say_so() {
        let data = DMatrix::from_element(4, 3, 2.0);
        assert_eq!(Discriminants::new(&data, &[0, 0, 1, 1], 2).unwrap_err(), NoScatter);
    }
}
