//! Symmetric positive definite systems over the nodes of a wireframe.
//!
//! Only nodes near each other are coupled. In a suitable order of the nodes (reverse Cuthill-McKee), the rows of the lower triangle start
//! late. They are stored from their first entry to the diagonal, one after the other: the "skyline". The Cholesky factor has the same
//! skyline, and all its sums run over adjacent values. The order is computed once per wireframe.

use std::{cmp::Ordering, sync::Arc};

use nalgebra::{Matrix2, Vector2};

/// Number of orders that are tried.
const SWEEPS: usize = 4;

/// Order of the nodes, and start of each row.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// Row of each node's x; its y is the next row.
    rows: Vec<usize>,
    /// Column of the first entry of each row.
    first: Vec<usize>,
    /// Index in the values of the (virtual) column 0 of each row; never used below `first`.
    origin: Vec<isize>,
    /// Number of values.
    size: usize,
}

impl Layout {
    /// Creates the layout for `count` nodes. Nodes of a group are coupled with each other.
    pub fn new(count: usize, groups: impl IntoIterator<Item = Vec<usize>>) -> Self {
        let mut near = vec![Vec::new(); count];
        for group in groups {
            for &a in group.iter().filter(|a| **a < count) {
                near[a].extend(group.iter().copied().filter(|b| *b != a && *b < count));
            }
        }
        for list in &mut near {
            list.sort_unstable();
            list.dedup();
        }
        // A good order begins at an end of the wireframe, which is the last node of another order.
        let mut start = 0;
        let orders = (0..SWEEPS).map(|_| {
            let order = order_from(start, &near);
            start = order.first().copied().unwrap_or_default();
            Self::of(&order, &near)
        });
        let best = orders.min_by_key(Self::work);
        best.unwrap_or_else(|| Self::of(&[], &near))
    }

    fn of(order: &[usize], near: &[Vec<usize>]) -> Self {
        let mut rows = vec![0; near.len()];
        order.iter().enumerate().for_each(|(k, node)| rows[*node] = 2 * k);
        let (mut first, mut origin, mut size) = (Vec::new(), Vec::new(), 0);
        for node in order {
            let row = rows[*node];
            let begin = near[*node].iter().map(|n| rows[*n]).min().map_or(row, |least| least.min(row));
            for row in [row, row + 1] {
                first.push(begin);
                origin.push(size as isize - begin as isize);
                size += row - begin + 1;
            }
        }
        Self { rows, first, origin, size }
    }

    /// Returns approximately the number of multiplications of a factorization.
    fn work(&self) -> usize {
        self.first.iter().enumerate().map(|(row, first)| (row - first).pow(2)).sum()
    }

    /// Returns the position of the block of two nodes, for [`Skyline::add_at`].
    pub fn places(&self, a: usize, b: usize) -> BlockPlaces {
        let (row, column) = (self.rows[a].max(self.rows[b]), self.rows[a].min(self.rows[b]));
        let (upper, lower) = (self.at(row, column), self.at(row + 1, column));
        let kind = match self.rows[a].cmp(&self.rows[b]) {
            Ordering::Less => BlockKind::Turned,
            Ordering::Equal => BlockKind::Diagonal,
            Ordering::Greater => BlockKind::Upright,
        };
        BlockPlaces { upper: upper as u32, lower: lower as u32, kind }
    }

    fn at(&self, row: usize, column: usize) -> usize {
        (self.origin[row] + column as isize) as usize
    }
}

/// Returns a reverse breadth-first order from a node, neighbours with few neighbours first.
fn order_from(start: usize, near: &[Vec<usize>]) -> Vec<usize> {
    let (mut order, mut seen) = (Vec::with_capacity(near.len()), vec![false; near.len()]);
    for start in std::iter::once(start).chain(0..near.len()) {
        if seen.get(start).is_none_or(|seen| *seen) {
            continue;
        }
        seen[start] = true;
        let mut next = order.len();
        order.push(start);
        while let Some(node) = order.get(next).copied() {
            next += 1;
            let mut found: Vec<usize> = near[node].iter().copied().filter(|n| !seen[*n]).collect();
            found.sort_by_key(|n| (near[*n].len(), *n));
            found.iter().for_each(|n| seen[*n] = true);
            order.extend(found);
        }
    }
    order.reverse();
    order
}

/// Position of the block of two nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockPlaces {
    /// Indices in the values of the first entries of its two rows.
    upper: u32,
    lower: u32,
    kind: BlockKind,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum BlockKind {
    /// The rows are those of the first node.
    Upright,
    /// The rows are those of the second node.
    Turned,
    /// The block couples a node with itself.
    Diagonal,
}

/// A symmetric matrix over the coordinates of nodes, or its factor.
#[derive(Clone, Debug)]
pub struct Skyline {
    layout: Arc<Layout>,
    values: Vec<f64>,
}

impl Skyline {
    /// Creates a zero matrix.
    pub fn new(layout: &Arc<Layout>) -> Self {
        Self { layout: Arc::clone(layout), values: vec![0.0; layout.size] }
    }

    /// Copies the values of another matrix of the same layout.
    pub fn copy_from(&mut self, other: &Self) {
        self.values.copy_from_slice(&other.values);
    }

    /// Copies the values of another matrix of the same layout, times `factor`.
    pub fn scaled_from(&mut self, other: &Self, factor: f64) {
        self.values.iter_mut().zip(&other.values).for_each(|(own, value)| *own = value * factor);
    }

    /// Adds a symmetric block to the coordinates of a node.
    pub fn add_diagonal(&mut self, node: usize, block: &Matrix2<f64>) {
        let places = self.layout.places(node, node);
        self.add_at(&places, block);
    }

    /// Adds a block to the entries of node `a`'s coordinates (rows) with those of node `b` (columns), and its transpose to those of `b`
    /// with `a`. The nodes must differ and be coupled.
    pub fn add_coupling(&mut self, a: usize, b: usize, block: &Matrix2<f64>) {
        let places = self.layout.places(a, b);
        self.add_at(&places, block);
    }

    /// Adds a spring between two different nodes, which must be coupled in the layout.
    pub fn add_spring(&mut self, [a, b]: [usize; 2], stiffness: f64) {
        let block = Matrix2::identity() * stiffness;
        self.add_diagonal(a, &block);
        self.add_diagonal(b, &block);
        self.add_coupling(a, b, &-block);
    }

    /// Same as [`Self::add_diagonal`] or [`Self::add_coupling`], at precomputed positions.
    #[inline(always)]
    pub fn add_at(&mut self, places: &BlockPlaces, block: &Matrix2<f64>) {
        let (upper, lower) = (places.upper as usize, places.lower as usize);
        self.values[upper] += block.m11;
        self.values[lower + 1] += block.m22;
        match places.kind {
            BlockKind::Upright => {
                self.values[upper + 1] += block.m12;
                self.values[lower] += block.m21;
            }
            BlockKind::Turned => {
                self.values[upper + 1] += block.m21;
                self.values[lower] += block.m12;
            }
            BlockKind::Diagonal => self.values[lower] += block.m21,
        }
    }

    /// Returns the layout.
    pub fn layout(&self) -> &Arc<Layout> {
        &self.layout
    }

    fn row(&self, row: usize) -> &[f64] {
        let begin = self.layout.at(row, self.layout.first[row]);
        &self.values[begin..=self.layout.at(row, row)]
    }

    /// Computes the product with a vector over the nodes.
    #[inline(always)]
    pub fn times(&self, nodes: &[Vector2<f64>], out: &mut [Vector2<f64>]) {
        let rows = &self.layout.rows;
        let mut ordered = vec![0.0; 2 * rows.len()];
        for (node, row) in nodes.iter().zip(rows) {
            ordered[*row..*row + 2].copy_from_slice(&[node.x, node.y]);
        }
        let mut product = vec![0.0; ordered.len()];
        for k in 0..ordered.len() {
            let (first, row) = (self.layout.first[k], self.row(k));
            let [before @ .., diagonal] = row else { continue };
            product[k] += dot(before, &ordered[first..k]) + diagonal * ordered[k];
            product[first..k].iter_mut().zip(before).for_each(|(sum, value)| *sum += value * ordered[k]);
        }
        for (out, row) in out.iter_mut().zip(rows) {
            *out = Vector2::new(product[*row], product[*row + 1]);
        }
    }

    /// Replaces the matrix by its Cholesky factor; returns `false` for a matrix that is not positive definite.
    #[must_use]
    #[inline(always)]
    pub fn factor(&mut self) -> bool {
        let layout = Arc::clone(&self.layout);
        // Reciprocals of the diagonal: a division in every entry would wait for the previous one.
        let mut inverses = Vec::with_capacity(layout.first.len());
        // Both rows of a node begin at the same column and are computed together.
        for row in (0..layout.first.len()).step_by(2) {
            let first = layout.first[row];
            let (above, own) = self.values.split_at_mut(layout.at(row, first));
            let (upper, lower) = own.split_at_mut(row - first + 1);
            for (column, inverse) in (first..row).zip(&inverses[first..row]) {
                let from = first.max(layout.first[column]);
                let other = &above[layout.at(column, from)..layout.at(column, column)];
                let (begin, end) = (from - first, column - first);
                let sums = dots([&upper[begin..end], &lower[begin..end]], other);
                upper[end] = (upper[end] - sums[0]) * inverse;
                lower[end] = (lower[end] - sums[1]) * inverse;
            }
            let (before, diagonal) = upper.split_at_mut(row - first);
            let Some(inverse) = finish(before, &mut diagonal[0]) else { return false };
            inverses.push(inverse);
            let (before_both, last) = lower.split_at_mut(row - first);
            last[0] = (last[0] - dot(before_both, before)) * inverse;
            let (before, diagonal) = lower.split_at_mut(row - first + 1);
            let Some(inverse) = finish(before, &mut diagonal[0]) else { return false };
            inverses.push(inverse);
        }
        true
    }

    /// Solves for a right side over the nodes, using this factor.
    #[inline(always)]
    pub fn solve(&self, nodes: &mut [Vector2<f64>]) {
        let rows = &self.layout.rows;
        let mut ordered = vec![0.0; 2 * rows.len()];
        for (node, row) in nodes.iter().zip(rows) {
            ordered[*row..*row + 2].copy_from_slice(&[node.x, node.y]);
        }
        for k in 0..ordered.len() {
            if let [before @ .., diagonal] = self.row(k) {
                ordered[k] = (ordered[k] - dot(before, &ordered[self.layout.first[k]..k])) / diagonal;
            }
        }
        for k in (0..ordered.len()).rev() {
            if let [before @ .., diagonal] = self.row(k) {
                let value = ordered[k] / diagonal;
                ordered[k] = value;
                ordered[self.layout.first[k]..k].iter_mut().zip(before).for_each(|(sum, entry)| *sum -= entry * value);
            }
        }
        for (node, row) in nodes.iter_mut().zip(rows) {
            *node = Vector2::new(ordered[*row], ordered[*row + 1]);
        }
    }
}

/// Computes the diagonal entry of a factor's row from its other entries and returns its reciprocal; `None` if the matrix is not positive
/// definite.
#[inline(always)]
fn finish(before: &[f64], diagonal: &mut f64) -> Option<f64> {
    let rest = *diagonal - dot(before, before);
    (rest > 0.0 && rest.is_finite()).then(|| {
        *diagonal = rest.sqrt();
        1.0 / *diagonal
    })
}

/// Returns the sum of products of two lists, in eight lanes, so that it is the same on every machine.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 8];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a.iter().zip(b) {
        for k in 0..8 {
            lanes[k] += a[k] * b[k];
        }
    }
    total(lanes, a_rest, b_rest)
}

/// Returns [`dot`] of each of two lists with a third one.
#[inline(always)]
fn dots([a, b]: [&[f64]; 2], with: &[f64]) -> [f64; 2] {
    let mut lanes = [[0.0; 8]; 2];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let (with, rest) = with.as_chunks::<8>();
    for ((a, b), with) in a.iter().zip(b).zip(with) {
        for k in 0..8 {
            lanes[0][k] += a[k] * with[k];
            lanes[1][k] += b[k] * with[k];
        }
    }
    [total(lanes[0], a_rest, rest), total(lanes[1], b_rest, rest)]
}

/// Returns the sum of the lanes and of the remaining products.
#[inline(always)]
fn total([p, q, r, s, t, u, v, w]: [f64; 8], a: &[f64], b: &[f64]) -> f64 {
    let rest: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    // Halves are added first, so that vectors of any width give the same sum.
    ((p + t) + (r + v)) + ((q + u) + (s + w)) + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chain_is_solved() {
        // Three nodes in a row, springs of stiffness 1 between them, node 0 tied by 1: pulling node 2 by (1, 2) moves node 0 by (1, 2),
        // node 1 by twice, node 2 by three times as much.
        let layout = Arc::new(Layout::new(3, [vec![0, 1], vec![2, 1]]));
        let one = Matrix2::identity();
        let mut system = Skyline::new(&layout);
        for (a, b) in [(0, 1), (1, 2)] {
            system.add_diagonal(a, &one);
            system.add_diagonal(b, &one);
            system.add_coupling(b, a, &-one);
        }
        system.add_diagonal(0, &one);
        let answer = [Vector2::new(1.0, 2.0), Vector2::new(2.0, 4.0), Vector2::new(3.0, 6.0)];
        let mut product = answer;
        system.times(&answer, &mut product);
        assert_eq!(product, [Vector2::zeros(), Vector2::zeros(), Vector2::new(1.0, 2.0)]);
        assert!(system.factor());
        let mut found = product;
        system.solve(&mut found);
        found.iter().zip(&answer).for_each(|(a, b)| assert!((a - b).norm() < 1e-12, "{a} {b}"));
    }

    #[test]
    fn blocks_couple_x_and_y_whichever_node_comes_first() {
        // [2 1; 1 3] at node 0, 5 at node 1, and the block [0.5 0.25; -1 0.75] between them; against the same system, dense.
        let block = Matrix2::new(0.5, 0.25, -1.0, 0.75);
        for swapped in [false, true] {
            let layout = Arc::new(Layout::new(2, [vec![0, 1]]));
            let mut system = Skyline::new(&layout);
            system.add_diagonal(0, &Matrix2::new(2.0, 1.0, 1.0, 3.0));
            system.add_diagonal(1, &(Matrix2::identity() * 5.0));
            if swapped {
                system.add_coupling(1, 0, &block.transpose());
            } else {
                system.add_coupling(0, 1, &block);
            }
            let dense = nalgebra::Matrix4::new(
                2.0, 1.0, 0.5, 0.25, //
                1.0, 3.0, -1.0, 0.75, //
                0.5, -1.0, 5.0, 0.0, //
                0.25, 0.75, 0.0, 5.0,
            );
            let right = nalgebra::Vector4::new(1.0, -2.0, 0.5, 3.0);
            let expected = dense.lu().solve(&right).unwrap();
            let mut found = [Vector2::new(1.0, -2.0), Vector2::new(0.5, 3.0)];
            assert!(system.factor());
            system.solve(&mut found);
            let found = nalgebra::Vector4::new(found[0].x, found[0].y, found[1].x, found[1].y);
            assert!((found - expected).norm() < 1e-12, "{found} {expected}");
        }
    }

    #[test]
    fn what_is_not_positive_definite_has_no_factor() {
        let layout = Arc::new(Layout::new(1, []));
        let mut system = Skyline::new(&layout);
        assert!(!system.factor());
        system.add_diagonal(0, &Matrix2::new(f64::NAN, 0.0, 0.0, 1.0));
        assert!(!system.factor());
        assert!(Skyline::new(&Arc::new(Layout::new(0, []))).factor());
    }
}
