//! Dense triangle meshes: topology, normals, smooth subdivision, and mesh file formats.
//!
//! Positions are `f32`, as in all supported file formats. Axes are those of face space (x to the subject's left, y up, z out of
//! the face); the unit is the file's own. Polygons become triangle fans: the quad a b c d becomes a b c and a c d.

pub(crate) mod colour;
pub mod gltf;
mod npy;
mod obj;
mod ply;
mod sphere;
mod subdivide;

use std::{collections::BTreeMap, path::PathBuf};

pub use npy::{NpyRows, read_npy_indices, read_npy_rows, write_npy_f32};
pub use obj::{read_obj, write_obj};
pub use ply::{read_ply, write_ply};
pub use sphere::sphere_front;
pub use subdivide::Subdivision;

/// Error for positions and triangles that do not form a mesh.
///
/// ```
/// use grimace::mesh::{MeshError, TriangleMesh};
///
/// let error = TriangleMesh::new(vec![[0.0; 3]], vec![[0, 0, 3]]).unwrap_err();
/// assert_eq!(error, MeshError::NoSuchVertex { triangle: 0, vertex: 3, count: 1 });
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// The mesh has no triangles.
    #[error("the mesh has no triangles")]
    NoTriangles,
    /// A coordinate that is NaN or infinite.
    #[error("vertex {vertex} is at ({}, {}, {}), which is not a finite position", at[0], at[1], at[2])]
    NotFinite {
        /// Vertex index, from 0.
        vertex: usize,
        /// Its position.
        at: [f32; 3],
    },
    /// An index that exceeds the number of vertices.
    #[error("triangle {triangle} refers to vertex {vertex}, but there are {count} vertices (0 to {})", count.saturating_sub(1))]
    NoSuchVertex {
        /// Triangle index, from 0.
        triangle: usize,
        /// The vertex index.
        vertex: u64,
        /// Number of vertices.
        count: usize,
    },
    /// More vertices than an index can address.
    #[error("the mesh has {found} vertices; at most {} are supported", u32::MAX)]
    TooManyVertices {
        /// Number of vertices found.
        found: usize,
    },
}

/// Error for a mesh file that cannot be read.
///
/// ```
/// use grimace::mesh::{MeshError, MeshFileError, read_obj};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("points.obj");
/// std::fs::write(&path, "v 0 0 0\nv 1 0 0\n")?;
/// assert!(matches!(read_obj(&path), Err(MeshFileError::Mesh { source: MeshError::NoTriangles, .. })));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// The file cannot be opened or ends early.
    #[error("cannot read {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// The content does not follow the format.
    #[error("{}: {reason}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong and where, and what was expected.
        reason: String,
    },
    /// The file can be read, but is not a valid mesh.
    #[error("{}: {source}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: MeshError,
    },
}

impl MeshFileError {
    pub(crate) fn format(path: &std::path::Path, reason: impl std::fmt::Display) -> Self {
        Self::Format { path: path.to_owned(), reason: reason.to_string() }
    }

    pub(crate) fn io(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |source| Self::Io { path: path.to_owned(), source }
    }

    pub(crate) fn mesh(path: &std::path::Path) -> impl FnOnce(MeshError) -> Self + '_ {
        move |source| Self::Mesh { path: path.to_owned(), source }
    }
}

/// A mesh of V vertices and T triangles. Every index is in range and every coordinate is finite.
///
/// ```
/// use grimace::mesh::TriangleMesh;
///
/// let square = vec![[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0], [0.0, 4.0, 0.0]];
/// let mesh = TriangleMesh::new(square, vec![[0, 1, 2], [0, 2, 3]])?;
/// assert_eq!((mesh.vertex_count(), mesh.edges().len(), mesh.diagonal()), (4, 5, 5.0));
/// assert_eq!(mesh.border_loops().len(), 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct TriangleMesh {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// Creates a mesh from V positions and T index triples, counter-clockwise seen from outside.
    ///
    /// # Errors
    /// [`MeshError`] when there are no triangles, an index is out of range, or a position is not finite.
    pub fn new(positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        let count = positions.len();
        if triangles.is_empty() {
            return Err(MeshError::NoTriangles);
        }
        if u32::try_from(count).is_err() {
            return Err(MeshError::TooManyVertices { found: count });
        }
        check_finite(&positions)?;
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= count) {
                return Err(MeshError::NoSuchVertex { triangle, vertex: u64::from(vertex), count });
            }
        }
        Ok(Self { positions, triangles })
    }

    /// Positions in vertex order.
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    /// Triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Number of vertices V.
    pub fn vertex_count(&self) -> usize {
        self.positions.len()
    }

    /// Returns the part of the mesh on the vertices `0..count`: these vertices, and the triangles that use no others.
    ///
    /// # Errors
    /// [`MeshError::NoTriangles`] when no triangle is left.
    pub fn first_vertices(&self, count: usize) -> Result<Self, MeshError> {
        let inside = |t: &&[u32; 3]| t.iter().all(|&v| (v as usize) < count);
        let triangles = self.triangles.iter().filter(inside).copied().collect();
        Self::new(self.positions[..count.min(self.positions.len())].to_vec(), triangles)
    }

    /// Smallest and largest coordinate along each axis.
    pub fn bounds(&self) -> [[f32; 3]; 2] {
        let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        for position in &self.positions {
            for axis in 0..3 {
                bounds[0][axis] = bounds[0][axis].min(position[axis]);
                bounds[1][axis] = bounds[1][axis].max(position[axis]);
            }
        }
        bounds
    }

    /// Length of the diagonal of the mesh's bounding box.
    pub fn diagonal(&self) -> f64 {
        let [least, most] = self.bounds();
        (0..3).map(|axis| f64::from(most[axis] - least[axis]).powi(2)).sum::<f64>().sqrt()
    }

    /// Every edge once, `[smaller, larger]`, sorted, with its number of triangles.
    pub fn edges(&self) -> BTreeMap<[u32; 2], u32> {
        let mut edges = BTreeMap::new();
        for &[a, b, c] in &self.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *edges.entry([from.min(to), from.max(to)]).or_default() += 1;
            }
        }
        edges
    }

    /// Returns the borders as closed chains of vertices, the longest (by vertices) first.
    ///
    /// A border follows the edges with one triangle, in the direction of that triangle. Where borders touch at a vertex, it
    /// continues to the smallest next vertex. Chains that do not close are left out.
    pub fn border_loops(&self) -> Vec<Vec<u32>> {
        let edges = self.edges();
        let mut next: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for &[a, b, c] in &self.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                if edges.get(&[from.min(to), from.max(to)]) == Some(&1) {
                    next.entry(from).or_default().push(to);
                }
            }
        }
        let mut loops = Vec::new();
        while let Some((&start, _)) = next.first_key_value() {
            let mut walk = vec![start];
            let mut here = start;
            let closed = loop {
                let Some(ways) = next.get_mut(&here) else { break false };
                ways.sort_unstable_by(|a, b| b.cmp(a));
                let Some(onward) = ways.pop() else { break false };
                if ways.is_empty() {
                    next.remove(&here);
                }
                if onward == start {
                    break true;
                }
                walk.push(onward);
                here = onward;
            };
            if closed && walk.len() > 2 {
                loops.push(walk);
            }
        }
        loops.sort_by_key(|l| std::cmp::Reverse(l.len()));
        loops
    }
}

/// Checks that all coordinates are finite.
///
/// # Errors
/// [`MeshError::NotFinite`] for the first coordinate that is not finite.
pub fn check_finite(positions: &[[f32; 3]]) -> Result<(), MeshError> {
    match positions.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        Some(vertex) => Err(MeshError::NotFinite { vertex, at: positions[vertex] }),
        None => Ok(()),
    }
}

/// Unit normals of vertices: the mean of their triangles' normals, weighted by area. A vertex in no triangle has a normal along
/// z.
pub fn vertex_normals(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let mut normals = vec![[0.0_f32; 3]; positions.len()];
    for &[a, b, c] in triangles {
        let (p, q, r) = (positions[a as usize], positions[b as usize], positions[c as usize]);
        let normal = cross(sub(q, p), sub(r, p));
        for vertex in [a, b, c] {
            let sum = &mut normals[vertex as usize];
            *sum = add(*sum, normal);
        }
    }
    normals.iter().map(|&n| normalized(n).unwrap_or([0.0, 0.0, 1.0])).collect()
}

/// Splits a polygon into the triangle fan around its first corner.
pub(crate) fn fan<T: Copy>(corners: &[T]) -> impl Iterator<Item = [T; 3]> + '_ {
    let first = corners.first().copied();
    corners.windows(2).skip(1).filter_map(move |pair| first.map(|f| [f, pair[0], pair[1]]))
}

pub(crate) fn add(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns the vector scaled to length 1; `None` for a vector without a direction.
pub(crate) fn normalized(a: [f32; 3]) -> Option<[f32; 3]> {
    let length = dot(a, a).sqrt();
    (length > 0.0 && length.is_finite()).then(|| a.map(|c| c / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A unit square in the xy plane with a square hole: 8 vertices, 8 triangles.
    pub fn frame() -> TriangleMesh {
        let outer = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 3.0, 0.0], [0.0, 3.0, 0.0]];
        let inner = [[1.0, 1.0, 0.0], [2.0, 1.0, 0.0], [2.0, 2.0, 0.0], [1.0, 2.0, 0.0]];
        let mut triangles = Vec::new();
        for k in 0..4_u32 {
            let next = (k + 1) % 4;
            triangles.push([k, next, 4 + next]);
            triangles.push([k, 4 + next, 4 + k]);
        }
        TriangleMesh::new([outer, inner].concat(), triangles).unwrap()
    }

    #[test]
    fn borders_are_closed_walks() {
        let loops = frame().border_loops();
        // The outer border is counter-clockwise and the hole clockwise, like their triangles.
        assert_eq!(loops.len(), 2);
        assert_eq!(loops[0], [0, 1, 2, 3]);
        assert_eq!(loops[1], [4, 7, 6, 5]);
    }

    #[test]
    fn normals_of_a_flat_mesh_look_out() {
        let mesh = frame();
        assert!(vertex_normals(mesh.positions(), mesh.triangles()).iter().all(|&n| n == [0.0, 0.0, 1.0]));
    }

    #[test]
    fn a_polygon_becomes_a_fan() {
        let fan: Vec<_> = fan(&[7, 8, 9, 4]).collect();
        assert_eq!(fan, [[7, 8, 9], [7, 9, 4]]);
    }

    #[test]
    fn bad_meshes_are_refused_by_place() {
        let error = TriangleMesh::new(vec![[0.0; 3]; 3], vec![[0, 1, 3]]).unwrap_err();
        assert_eq!(error.to_string(), "triangle 0 refers to vertex 3, but there are 3 vertices (0 to 2)");
        let mut positions = vec![[0.0; 3]; 3];
        positions[1][2] = f32::NAN;
        let error = TriangleMesh::new(positions, vec![[0, 1, 2]]).unwrap_err();
        assert!(error.to_string().starts_with("vertex 1 is at (0, 0, NaN)"), "{error}");
        assert_eq!(TriangleMesh::new(vec![[0.0; 3]; 3], vec![]), Err(MeshError::NoTriangles));
    }

    #[test]
    fn the_first_vertices_keep_their_triangles() {
        let part = TriangleMesh::new(vec![[0.0; 3]; 5], vec![[0, 1, 2], [2, 3, 4]]).unwrap().first_vertices(3).unwrap();
        assert_eq!((part.vertex_count(), part.triangles()), (3, &[[0, 1, 2]][..]));
    }
}
