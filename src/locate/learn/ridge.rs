//! Ridge regression with cross-validation by people.

use nalgebra::{Cholesky, DMatrix, Dyn};
use rayon::prelude::*;

/// Number of groups of people that are left out in turn.
pub const FOLDS: usize = 5;

/// Regressions on the same features: one on all people, one without each fold, and the prediction for each sample by the regression without
/// its fold.
#[derive(Debug)]
pub struct Folded {
    /// Features x predicted values.
    pub all: DMatrix<f32>,
    /// Without each fold.
    pub without: Vec<DMatrix<f32>>,
    /// Samples x predicted values.
    pub predicted: DMatrix<f32>,
}

fn solve(mut gram: DMatrix<f32>, right: &DMatrix<f32>, lambda: f32) -> DMatrix<f32> {
    (0..gram.nrows()).for_each(|k| gram[(k, k)] += lambda);
    // A Gram matrix with a ridge is positive definite; if rounding breaks that, the mean is predicted.
    Cholesky::<f32, Dyn>::new(gram).map_or_else(|| DMatrix::zeros(right.nrows(), right.ncols()), |c| c.solve(right))
}

fn members(fold: &[usize], f: Option<usize>) -> (Vec<usize>, Vec<usize>) {
    (0..fold.len()).partition(|&i| Some(fold[i]) != f)
}

/// Ridge regression for more features than samples, solved in the sample space. `read`: features x samples, with mean 0; `wanted`: samples
/// x values, with mean 0; `fold` of each sample.
pub fn among_samples(read: &DMatrix<f32>, wanted: &DMatrix<f32>, fold: &[usize], lambdas: &[f32]) -> Folded {
    let gram = read.transpose() * read;
    let part = |rows: &[usize], columns: &[usize]| gram.select_rows(rows).select_columns(columns);
    let without = |f: Option<usize>, lambda: f32| {
        let (kept, held) = members(fold, f);
        let shares = solve(part(&kept, &kept), &wanted.select_rows(&kept), lambda);
        let predicted = part(&held, &kept) * &shares;
        (kept, held, shares, predicted)
    };
    let error = |lambda: f32| {
        let (_, held, _, predicted) = without(Some(0), lambda);
        (predicted - wanted.select_rows(&held)).norm_squared()
    };
    let lambda = lowest(lambdas, error);
    let mut predicted = DMatrix::zeros(wanted.nrows(), wanted.ncols());
    let mut folds = Vec::new();
    for f in 0..FOLDS {
        let (kept, held, shares, values) = without(Some(f), lambda);
        held.iter().enumerate().for_each(|(k, &i)| predicted.set_row(i, &values.row(k)));
        folds.push(read.select_columns(&kept) * shares);
    }
    let (kept, _, shares, _) = without(None, lambda);
    Folded { all: read.select_columns(&kept) * shares, without: folds, predicted }
}

fn lowest(lambdas: &[f32], error: impl Fn(f32) -> f32) -> f32 {
    let scored = lambdas.iter().map(|&l| (l, if lambdas.len() > 1 { error(l) } else { 0.0 }));
    scored.min_by(|p, q| p.1.total_cmp(&q.1)).map_or(1.0, |(l, _)| l)
}

/// Ridge regression for fewer features than samples, solved in the feature space.
pub fn among_numbers(read: &DMatrix<f32>, wanted: &DMatrix<f32>, fold: &[usize], lambdas: &[f32]) -> Folded {
    let parts: Vec<_> = (0..FOLDS)
        .map(|f| {
            let held = members(fold, Some(f)).1;
            let (own, own_wanted) = (read.select_columns(&held), wanted.select_rows(&held));
            let gram = &own * own.transpose();
            (gram, &own * &own_wanted, own, own_wanted, held)
        })
        .collect();
    let sum = |skip: Option<usize>| {
        let mut gram = DMatrix::zeros(read.nrows(), read.nrows());
        let mut right = DMatrix::zeros(read.nrows(), wanted.ncols());
        for (_, part) in parts.iter().enumerate().filter(|(f, _)| Some(*f) != skip) {
            gram += &part.0;
            right += &part.1;
        }
        (gram, right)
    };
    let sums: Vec<_> = (0..FOLDS).map(|f| sum(Some(f))).collect();
    let weights = |f: usize, lambda: f32| solve(sums[f].0.clone(), &sums[f].1, lambda);
    let error = |lambda: f32| (parts[0].2.transpose() * weights(0, lambda) - &parts[0].3).norm_squared();
    let lambda = lowest(lambdas, error);
    let mut predicted = DMatrix::zeros(wanted.nrows(), wanted.ncols());
    let without: Vec<_> = (0..FOLDS).map(|f| weights(f, lambda)).collect();
    for (part, w) in parts.iter().zip(&without) {
        let values = part.2.transpose() * w;
        part.4.iter().enumerate().for_each(|(k, &i)| predicted.set_row(i, &values.row(k)));
    }
    let (gram, right) = sum(None);
    Folded { all: solve(gram, &right, lambda), without, predicted }
}

/// Same as [`among_numbers`], separately for each point. `read` holds the features of the points one after the other, `length` each; two
/// columns of `wanted` belong to each point.
pub fn each_point(read: &DMatrix<f32>, wanted: &DMatrix<f32>, length: usize, fold: &[usize], lambdas: &[f32]) -> Vec<Folded> {
    (0..wanted.ncols() / 2)
        .into_par_iter()
        .map(|j| {
            among_numbers(&read.rows(j * length, length).into_owned(), &wanted.columns(2 * j, 2).into_owned(), fold, lambdas)
        })
        .collect()
}

/// Subtracts the mean of each row and returns the means.
pub fn centre_rows(matrix: &mut DMatrix<f32>) -> Vec<f32> {
    let count = matrix.ncols().max(1) as f64;
    let mut sums = vec![0.0_f64; matrix.nrows()];
    for column in matrix.column_iter() {
        sums.iter_mut().zip(column.iter()).for_each(|(s, v)| *s += f64::from(*v));
    }
    let means: Vec<f32> = sums.iter().map(|s| (s / count) as f32).collect();
    for mut column in matrix.column_iter_mut() {
        column.iter_mut().zip(&means).for_each(|(v, m)| *v -= m);
    }
    means
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ways_give_the_same_and_leave_the_fold_out() {
        // wanted = 2 a - b, exactly: found by both, and predicted for samples outside the training data.
        let numbers: Vec<f32> = (0..40).map(|k| ((k * 37 % 23) as f32 - 11.0) / 5.0).collect();
        let mut read = DMatrix::from_vec(2, 20, numbers);
        centre_rows(&mut read);
        let wanted = DMatrix::from_fn(20, 1, |i, _| 2.0 * read[(0, i)] - read[(1, i)]);
        let fold: Vec<usize> = (0..20).map(|i| i % FOLDS).collect();
        for folded in [among_samples(&read, &wanted, &fold, &[1e-3]), among_numbers(&read, &wanted, &fold, &[1e-3])] {
            approx::assert_relative_eq!(folded.all[(0, 0)], 2.0, epsilon = 1e-2);
            approx::assert_relative_eq!(folded.all[(1, 0)], -1.0, epsilon = 1e-2);
            assert!((&folded.predicted - &wanted).norm() < 0.05, "{}", folded.predicted);
            assert_eq!(folded.without.len(), FOLDS);
        }
    }

    #[test]
    fn the_penalty_is_chosen_by_people_left_out() {
        let read = DMatrix::from_fn(1, 20, |_, i| i as f32 - 9.5);
        let wanted = DMatrix::from_fn(20, 1, |i, _| i as f32 - 9.5);
        let fold: Vec<usize> = (0..20).map(|i| i % FOLDS).collect();
        approx::assert_relative_eq!(among_numbers(&read, &wanted, &fold, &[1e5, 1e-2, 1e3]).all[(0, 0)], 1.0, epsilon = 1e-3);
    }
}
