//! Normal equations from the rows of a least-squares problem.
//!
//! They take most of the time of fitting heads and action units, so they are computed in blocks of `LANES` numbers.

use nalgebra::{Cholesky, DMatrix, Dyn};

use crate::simd::widest;

/// Number of row elements multiplied at once.
const LANES: usize = 4;
/// Number of columns that a Cholesky factorization takes at once.
const PANEL: usize = 16;

/// Rows of equal length, each padded with zeros to whole blocks.
#[derive(Clone, Debug)]
pub struct Rows {
    size: usize,
    blocks: usize,
    cells: Vec<[f64; LANES]>,
}

impl Rows {
    /// Creates an empty set of rows of `size` numbers each.
    pub fn new(size: usize) -> Self {
        Self { size, blocks: size.div_ceil(LANES), cells: Vec::new() }
    }

    /// Removes all rows, keeping the memory.
    pub fn clear(&mut self) {
        self.cells.clear();
    }

    /// Adds a row of zeros and returns it for the caller to fill.
    pub fn add(&mut self) -> &mut [f64] {
        let first = self.cells.len();
        self.cells.resize(first + self.blocks, [0.0; LANES]);
        &mut self.cells[first..].as_flattened_mut()[..self.size]
    }

    /// Returns the blocks column by column: all rows of the first block, then all of the second. Products of two blocks thus read memory in
    /// order.
    fn by_block(&self) -> Vec<[f64; LANES]> {
        let count = self.cells.len() / self.blocks.max(1);
        (0..self.blocks).flat_map(|i| (0..count).map(move |row| self.cells[row * self.blocks + i])).collect()
    }

    /// Returns the rows, three at a time.
    pub fn threes(&self) -> impl Iterator<Item = [&[f64]; 3]> {
        let row = |at: usize| &self.cells[at * self.blocks..(at + 1) * self.blocks].as_flattened()[..self.size];
        let count = self.cells.len() / self.blocks.max(1) / 3;
        (0..count).map(move |k| [row(3 * k), row(3 * k + 1), row(3 * k + 2)])
    }

    /// Adds a row that is a linear combination of `rows` with weights `shares`.
    pub fn add_mixture<const N: usize>(&mut self, shares: [f64; N], rows: [&[f64]; N]) {
        add_mixture(self.add(), shares, rows);
    }

    /// Adds `A'A` to the lower triangle of `to`, where A are these rows.
    pub fn add_squares(&self, to: &mut DMatrix<f64>) {
        self.squares(|at, sum| to[at] += sum);
    }

    /// Passes the places and values of the lower triangle of `A'A` to `take`, where A are these rows.
    fn squares(&self, mut take: impl FnMut((usize, usize), f64)) {
        let count = self.cells.len() / self.blocks.max(1);
        let blocks = self.by_block();
        for (i, j) in (0..self.blocks).flat_map(|i| (0..=i).map(move |j| (i, j))) {
            let (a, b) = (&blocks[i * count..][..count], &blocks[j * count..][..count]);
            let sums = widest(
                #[inline(always)]
                || products(a, b),
            );
            for (p, q) in (0..LANES).flat_map(|p| (0..LANES).map(move |q| (p, q))) {
                let at = (LANES * i + p, LANES * j + q);
                if at.1 <= at.0 && at.0 < self.size {
                    take(at, sums[p][q]);
                }
            }
        }
    }
}

/// Returns the Cholesky factor of a matrix, of which only the lower triangle is read; `None` if it is not positive definite.
///
/// The columns are factored in panels of [`PANEL`], and what a panel takes from the columns behind it is computed like normal equations.
/// For the several hundred unknowns of a head this takes a fraction of the time of nalgebra's factorization, which goes column by column.
pub fn cholesky(mut matrix: DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    let size = matrix.nrows();
    for first in (0..size).step_by(PANEL) {
        let width = PANEL.min(size - first);
        let behind = first + width;
        let corner = matrix.view((first, first), (width, width)).into_owned().cholesky()?.unpack();
        let mut panel = matrix.view((behind, first), (size - behind, width)).transpose();
        if !corner.solve_lower_triangular_mut(&mut panel) {
            return None;
        }
        let mut rows = Rows::new(size - behind);
        for row in panel.row_iter() {
            rows.add().iter_mut().zip(row.iter()).for_each(|(cell, value)| *cell = *value);
        }
        rows.squares(|(i, j), sum| matrix[(behind + i, behind + j)] -= sum);
        matrix.view_mut((first, first), (width, width)).copy_from(&corner);
        matrix.view_mut((behind, first), (size - behind, width)).tr_copy_from(&panel);
    }
    Some(Cholesky::pack_dirty(matrix))
}

/// Returns the sums of the products of every number of one block with every number of another, over all rows.
#[inline(always)]
fn products(a: &[[f64; LANES]], b: &[[f64; LANES]]) -> [[f64; LANES]; LANES] {
    let mut sums = [[0.0; LANES]; LANES];
    for (a, b) in a.iter().zip(b) {
        for p in 0..LANES {
            for q in 0..LANES {
                sums[p][q] += a[p] * b[q];
            }
        }
    }
    sums
}

/// Adds a linear combination of `rows` with weights `shares` to `to`.
pub fn add_mixture<const N: usize>(to: &mut [f64], shares: [f64; N], rows: [&[f64]; N]) {
    for (share, row) in shares.into_iter().zip(rows) {
        to.iter_mut().zip(row).for_each(|(to, value)| *to += share * value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_are_those_of_the_matrix() {
        // Five columns: more than one block and not two whole ones.
        let value = |r: usize, c: usize| ((3 * r + 7 * c) % 11) as f64 - 4.0;
        let mut rows = Rows::new(5);
        for r in 0..3 {
            rows.add().iter_mut().enumerate().for_each(|(c, cell)| *cell = value(r, c));
        }
        let mut found = DMatrix::identity(5, 5);
        rows.add_squares(&mut found);
        let a = DMatrix::from_fn(3, 5, value);
        let expected = a.transpose() * a + DMatrix::identity(5, 5);
        assert_eq!(found.lower_triangle(), expected.lower_triangle());
        assert_eq!(found.upper_triangle() - DMatrix::from_diagonal(&found.diagonal()), DMatrix::zeros(5, 5));
    }
    #[test]
    fn a_factor_is_that_of_one_column_at_a_time() {
        // Sizes around whole panels; the upper triangle is not read.
        for size in [1, 15, 16, 17, 50] {
            let value = |r: usize, c: usize| ((5 * r * r + 3 * r * c + 7 * c) % 13) as f64 / 6.0 - 1.0;
            let a = DMatrix::from_fn(size, size, value);
            let matrix = a.transpose() * &a + DMatrix::identity(size, size);
            let lower = DMatrix::from_fn(size, size, |r, c| if c > r { f64::NAN } else { matrix[(r, c)] });
            let (found, expected) = (cholesky(lower).unwrap(), matrix.cholesky().unwrap());
            assert!((found.l() - expected.l()).amax() < 1e-12, "{size}");
        }
        // The last pivot is negative.
        let mut indefinite = DMatrix::<f64>::identity(20, 20);
        indefinite[(19, 19)] = -1.0;
        assert!(cholesky(indefinite).is_none());
    }
}
