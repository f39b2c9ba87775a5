//! Weights of the driving nodes for every vertex: the smoothest displacement field through the nodes.
//!
//! The field minimizes the bending energy `u' L M^-1 L u` (L the cotangent Laplacian over the triangles of the skin, M the area of each vertex).
//! It passes exactly through the displacements of the driving nodes, follows a weighted mean of them at tied vertices, and is 0 on the
//! ring around the face. It is cut at lips and lids: nothing pulls across an opening, and the field has no slope at its edge, so that lips
//! and lid margins move as a whole and keep their thickness. The solution is linear in the displacements. One weight for each pair of vertex
//! and node is solved once; a frame then takes one matrix product.

use nalgebra::Vector2;

use super::{WarpError, mesh::Mesh};
use crate::simd::widest;

/// Weights of the driving nodes for all vertices.
#[derive(Clone, Debug)]
pub struct Weights {
    columns: usize,
    /// The weights of each vertex, row by row.
    values: Vec<f64>,
}

impl Weights {
    /// Solves for the weights of a mesh.
    pub fn new(mesh: &Mesh) -> Result<Self, WarpError> {
        let count = mesh.vertices.len();
        let columns = mesh.drivers.len();
        let energy = Energy::new(mesh);
        // Weights of the drivers at the vertices whose displacement is known; empty where it is 0.
        let mut known: Vec<Option<Vec<(usize, f64)>>> = vec![None; count];
        mesh.fixed.iter().for_each(|&v| known[v as usize] = Some(Vec::new()));
        mesh.tied.iter().for_each(|(v, shares)| known[*v as usize] = Some(shares.clone()));
        mesh.drivers.iter().enumerate().for_each(|(k, &(_, v))| known[v as usize] = Some(vec![(k, 1.0)]));
        // Sorted from top to bottom, so that the system is banded.
        let mut free: Vec<usize> = (0..count).filter(|&v| known[v].is_none() && energy.masses[v] > 0.0).collect();
        free.sort_by(|&a, &b| {
            let (a, b) = (mesh.vertices[a], mesh.vertices[b]);
            a.y.total_cmp(&b.y).then(a.x.total_cmp(&b.x))
        });
        let mut place = vec![usize::MAX; count];
        free.iter().enumerate().for_each(|(i, &v)| place[v] = i);
        let mut system = Skyline::default();
        let mut right = vec![0.0; free.len() * columns];
        for (i, &vertex) in free.iter().enumerate() {
            let row = energy.row(vertex);
            let mut entries: Vec<(usize, f64)> = Vec::with_capacity(row.len());
            for &(other, value) in &row {
                match &known[other] {
                    Some(shares) => shares.iter().for_each(|&(driver, share)| right[i * columns + driver] -= value * share),
                    None if place[other] <= i => entries.push((place[other], value)),
                    // In the upper half, which is not stored.
                    None => {}
                }
            }
            system.push(i, &entries);
        }
        let solved = widest(
            #[inline(always)]
            || {
                let factored = system.factor();
                factored.map(
                    #[inline(always)]
                    |()| system.solve(&mut right, columns),
                )
            },
        );
        solved.ok_or(WarpError::Folded)?;
        let mut values = vec![0.0; count * columns];
        for (v, known) in known.iter().enumerate() {
            for &(driver, share) in known.iter().flatten() {
                values[v * columns + driver] += share;
            }
        }
        for (i, &v) in free.iter().enumerate() {
            values[v * columns..(v + 1) * columns].copy_from_slice(&right[i * columns..(i + 1) * columns]);
        }
        Ok(Self { columns, values })
    }

    /// Displacements of all vertices for those of the driving nodes.
    pub fn displaced(&self, offsets: &[Vector2<f64>]) -> Vec<Vector2<f64>> {
        /// Number of vertices that are summed together.
        const TOGETHER: usize = 4;
        let mut all = Vec::with_capacity(self.values.len() / self.columns.max(1));
        widest(
            #[inline(always)]
            || {
                for rows in self.values.chunks(TOGETHER * self.columns.max(1)) {
                    let (mut x, mut y) = ([0.0; TOGETHER], [0.0; TOGETHER]);
                    let count = rows.len() / self.columns.max(1);
                    let rows: [&[f64]; TOGETHER] =
                        std::array::from_fn(|k| &rows[k.min(count - 1) * self.columns..][..self.columns]);
                    for (d, offset) in offsets.iter().enumerate() {
                        for k in 0..TOGETHER {
                            x[k] += offset.x * rows[k][d];
                            y[k] += offset.y * rows[k][d];
                        }
                    }
                    all.extend((0..count).map(|k| Vector2::new(x[k], y[k])));
                }
            },
        );
        all
    }

    /// Weights of the driving nodes for a vertex.
    pub fn of(&self, vertex: usize) -> &[f64] {
        &self.values[vertex * self.columns..(vertex + 1) * self.columns]
    }
}

/// The bending energy as a sparse matrix, with rows computed on demand.
struct Energy {
    /// Cotangent Laplacian.
    laplacian: Vec<Vec<(usize, f64)>>,
    masses: Vec<f64>,
}

impl Energy {
    fn new(mesh: &Mesh) -> Self {
        let count = mesh.vertices.len();
        let mut laplacian: Vec<Vec<(usize, f64)>> = vec![Vec::new(); count];
        let mut masses = vec![0.0; count];
        let mut add = |row: usize, column: usize, value: f64| match laplacian[row].iter_mut().find(|e| e.0 == column) {
            Some(entry) => entry.1 += value,
            None => laplacian[row].push((column, value)),
        };
        for triangle in &mesh.skin {
            let corners = triangle.map(|v| mesh.vertices[v as usize]);
            let area = ((corners[1] - corners[0]).perp(&(corners[2] - corners[0])) / 2.0).abs();
            for k in 0..3 {
                let (i, j, o) = (k, (k + 1) % 3, (k + 2) % 3);
                let (a, b) = (corners[i] - corners[o], corners[j] - corners[o]);
                // Half the cotangent of the angle opposite the edge; the area is bounded below for numerical stability.
                let weight = a.dot(&b) / (4.0 * area.max(1e-9));
                let (i, j) = (triangle[i] as usize, triangle[j] as usize);
                add(i, i, weight);
                add(j, j, weight);
                add(i, j, -weight);
                add(j, i, -weight);
                masses[i] += area / 3.0;
            }
        }
        laplacian.iter_mut().for_each(|row| row.sort_unstable_by_key(|e| e.0));
        Self { laplacian, masses }
    }

    /// Row of `L M^-1 L`, sorted by column.
    fn row(&self, vertex: usize) -> Vec<(usize, f64)> {
        let mut row: Vec<(usize, f64)> = Vec::new();
        for &(k, value) in &self.laplacian[vertex] {
            let scale = value / self.masses[k].max(1e-12);
            row.extend(self.laplacian[k].iter().map(|&(j, other)| (j, scale * other)));
        }
        row.sort_by_key(|e| e.0);
        row.dedup_by(|from, into| {
            let same = from.0 == into.0;
            if same {
                into.1 += from.1;
            }
            same
        });
        row
    }
}

/// A symmetric positive definite matrix stored as rows of its lower half, each from its first entry; Cholesky preserves that shape.
#[derive(Default)]
struct Skyline {
    /// First column and values up to the diagonal.
    rows: Vec<(usize, Vec<f64>)>,
}

impl Skyline {
    fn push(&mut self, row: usize, entries: &[(usize, f64)]) {
        let first = entries.iter().map(|e| e.0).min().unwrap_or(row);
        let mut values = vec![0.0; row + 1 - first];
        entries.iter().for_each(|&(column, value)| values[column - first] += value);
        self.rows.push((first, values));
    }

    /// Cholesky factorization in place; `None` for a matrix that is not positive definite.
    #[inline(always)]
    fn factor(&mut self) -> Option<()> {
        for i in 0..self.rows.len() {
            let (above, rest) = self.rows.split_at_mut(i);
            let (first, row) = &mut rest[0];
            for j in *first..i {
                let (other_first, other) = &above[j];
                let from = (*first).max(*other_first);
                let sum = dot(&row[from - *first..j - *first], &other[from - other_first..j - other_first]);
                row[j - *first] = (row[j - *first] - sum) / other[j - other_first];
            }
            let last = row.len() - 1;
            let pivot = row[last] - dot(&row[..last], &row[..last]);
            if !(pivot > 0.0 && pivot.is_finite()) {
                return None;
            }
            row[last] = pivot.sqrt();
        }
        Some(())
    }

    /// Solves for several right-hand sides at once, stored row by row.
    #[inline(always)]
    fn solve(&self, right: &mut [f64], columns: usize) {
        for (i, (first, row)) in self.rows.iter().enumerate() {
            let (above, rest) = right.split_at_mut(i * columns);
            let target = &mut rest[..columns];
            for (j, &value) in (*first..i).zip(row) {
                subtract(target, &above[j * columns..(j + 1) * columns], value);
            }
            let pivot = row[row.len() - 1];
            for t in target {
                *t /= pivot;
            }
        }
        for (i, (first, row)) in self.rows.iter().enumerate().rev() {
            let (above, rest) = right.split_at_mut(i * columns);
            let source = &mut rest[..columns];
            let pivot = row[row.len() - 1];
            for t in &mut *source {
                *t /= pivot;
            }
            for (j, &value) in (*first..i).zip(row) {
                subtract(&mut above[j * columns..(j + 1) * columns], source, value);
            }
        }
    }
}

/// `target -= factor * source`.
#[inline(always)]
fn subtract(target: &mut [f64], source: &[f64], factor: f64) {
    if factor != 0.0 {
        for (t, s) in target.iter_mut().zip(source) {
            *t -= factor * s;
        }
    }
}

/// Scalar product in four fixed parts: fast, and identical on every machine.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (mut a, mut b) = (a.chunks_exact(4), b.chunks_exact(4));
    for (a, b) in a.by_ref().zip(b.by_ref()) {
        for k in 0..4 {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_banded_system_is_solved() {
        // 4 1 0   x   9        x = (1.928571, 1.285714, 2.571429): 4 x + y = 9, x + 4 y + z = 9.642857..., y + 4 z = 11.571428...
        // Checked by multiplying back.
        let matrix = [[4.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 4.0]];
        let mut skyline = Skyline::default();
        skyline.push(0, &[(0, 4.0)]);
        skyline.push(1, &[(0, 1.0), (1, 4.0)]);
        skyline.push(2, &[(1, 1.0), (2, 4.0)]);
        skyline.factor().unwrap();
        let mut x = vec![9.0, 1.0, 6.0, 2.0, 3.0, 3.0];
        skyline.solve(&mut x, 2);
        for (row, expected) in matrix.iter().zip([[9.0, 1.0], [6.0, 2.0], [3.0, 3.0]]) {
            for column in 0..2 {
                let product: f64 = (0..3).map(|k| row[k] * x[2 * k + column]).sum();
                assert!((product - expected[column]).abs() < 1e-12);
            }
        }
        let mut indefinite = Skyline::default();
        indefinite.push(0, &[(0, -1.0)]);
        assert!(indefinite.factor().is_none());
    }
}
