//! Smooth subdivision of triangle meshes by Loop's scheme.
//!
//! C. Loop: *Smooth subdivision surfaces based on triangles*, 1987, with his weights for vertices of any valence, and the cubic
//! B-spline rule (1/8, 3/4, 1/8) along borders. The scheme is linear and its weights depend only on the topology, so one
//! [`Subdivision`] refines a neutral face and all its displacements. Old vertices keep their indices; new ones follow.

use std::{collections::BTreeMap, f32::consts::TAU};

use super::{MeshError, TriangleMesh};

/// The rule for one or several rounds of subdivision of one topology.
#[derive(Clone, Debug)]
pub struct Subdivision {
    levels: Vec<Level>,
    triangles: Vec<[u32; 3]>,
}

/// One round: each new vertex as a weighted sum of old ones.
#[derive(Clone, Debug)]
struct Level {
    /// Start of every new vertex's terms, and the end of the last one's.
    starts: Vec<u32>,
    terms: Vec<(u32, f32)>,
}

impl Subdivision {
    /// Creates the rule for `levels` rounds on a mesh's topology; 0 changes nothing. Each round splits a triangle into four.
    ///
    /// # Errors
    /// [`MeshError::TooManyVertices`] when a round needs more vertices than an index can address.
    pub fn new(mesh: &TriangleMesh, levels: usize) -> Result<Self, MeshError> {
        let mut triangles = mesh.triangles().to_vec();
        let mut count = mesh.vertex_count();
        let mut made = Vec::with_capacity(levels);
        for _ in 0..levels {
            let (level, finer) = split(count, &triangles)?;
            count = level.starts.len() - 1;
            triangles = finer;
            made.push(level);
        }
        Ok(Self { levels: made, triangles })
    }

    /// The refined triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Refines positions or displacements of the coarse vertices.
    pub fn refine(&self, coarse: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let mut values = coarse.to_vec();
        for level in &self.levels {
            values = level
                .starts
                .windows(2)
                .map(|range| {
                    let mut sum = [0.0_f32; 3];
                    for &(vertex, weight) in &level.terms[range[0] as usize..range[1] as usize] {
                        let value = values[vertex as usize];
                        (0..3).for_each(|axis| sum[axis] += weight * value[axis]);
                    }
                    sum
                })
                .collect();
        }
        values
    }

    /// Refines the mesh.
    ///
    /// # Errors
    /// [`MeshError`] when a position exceeds the range of `f32`.
    pub fn refine_mesh(&self, mesh: &TriangleMesh) -> Result<TriangleMesh, MeshError> {
        TriangleMesh::new(self.refine(mesh.positions()), self.triangles.clone())
    }
}

/// An edge being split: its new vertex, and the corners opposite to it.
struct Edge {
    middle: u32,
    opposite: Vec<u32>,
}

fn split(count: usize, triangles: &[[u32; 3]]) -> Result<(Level, Vec<[u32; 3]>), MeshError> {
    let mut edges: BTreeMap<[u32; 2], Edge> = BTreeMap::new();
    let mut order = Vec::new();
    let mut finer = Vec::with_capacity(4 * triangles.len());
    for &[a, b, c] in triangles {
        let mut middle = |from: u32, to: u32, opposite: u32| -> Result<u32, MeshError> {
            let key = [from.min(to), from.max(to)];
            if let Some(edge) = edges.get_mut(&key) {
                edge.opposite.push(opposite);
                return Ok(edge.middle);
            }
            let found = count + order.len() + 1;
            let middle = u32::try_from(found - 1).map_err(|_| MeshError::TooManyVertices { found })?;
            edges.insert(key, Edge { middle, opposite: vec![opposite] });
            order.push(key);
            Ok(middle)
        };
        let (ab, bc, ca) = (middle(a, b, c)?, middle(b, c, a)?, middle(c, a, b)?);
        finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    let mut ring = vec![Vec::new(); count];
    let mut border = vec![Vec::new(); count];
    for (&[a, b], edge) in &edges {
        let lists = if edge.opposite.len() == 2 { &mut ring } else { &mut border };
        lists[a as usize].push(b);
        lists[b as usize].push(a);
    }
    let mut level = Level { starts: vec![0], terms: Vec::new() };
    for vertex in 0..count {
        let own = vertex as u32;
        match (&border[vertex][..], &ring[vertex][..]) {
            ([], []) => level.terms.push((own, 1.0)),
            ([], neighbours) => {
                let n = neighbours.len() as f32;
                let inner = 3.0 / 8.0 + (TAU / n).cos() / 4.0;
                let beta = (5.0 / 8.0 - inner * inner) / n;
                level.terms.push((own, 1.0 - n * beta));
                level.terms.extend(neighbours.iter().map(|&v| (v, beta)));
            }
            (&[a, b], _) => level.terms.extend([(own, 0.75), (a, 0.125), (b, 0.125)]),
            // Borders that meet at a point: a corner, which does not move.
            _ => level.terms.push((own, 1.0)),
        }
        level.starts.push(level.terms.len() as u32);
    }
    for key in order {
        let [a, b] = key;
        match edges.get(&key).map(|e| &e.opposite[..]) {
            Some(&[c, d]) => level.terms.extend([(a, 0.375), (b, 0.375), (c, 0.125), (d, 0.125)]),
            _ => level.terms.extend([(a, 0.5), (b, 0.5)]),
        }
        level.starts.push(level.terms.len() as u32);
    }
    Ok((level, finer))
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    fn tetrahedron() -> TriangleMesh {
        let positions = vec![[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
        TriangleMesh::new(positions, vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]).unwrap()
    }

    #[test]
    fn a_closed_mesh_follows_loops_weights() {
        let mesh = tetrahedron();
        let rule = Subdivision::new(&mesh, 1).unwrap();
        let fine = rule.refine(mesh.positions());
        // 4 old vertices and 6 edges; 16 triangles.
        assert_eq!((fine.len(), rule.triangles().len()), (10, 16));
        // Valence 3: beta = (5/8 - (3/8 - 1/8)^2)/3 = 3/16; vertex 0: 7/16 (1,1,1) + 3/16 (-1,-1,-1) = (1/4, 1/4, 1/4).
        for coordinate in fine[0] {
            assert_relative_eq!(coordinate, 0.25, epsilon = 1e-6);
        }
        // Edge 0-1, opposite 2 and 3: 3/8 (2, 0, 0) + 1/8 (-2, 0, 0) = (1/2, 0, 0).
        assert_relative_eq!(fine[4][0], 0.5, epsilon = 1e-6);
        assert_relative_eq!(fine[4][1], 0.0, epsilon = 1e-6);
    }

    #[test]
    fn borders_are_cubic_splines_and_stay_on_their_line() {
        let mesh = super::super::tests::frame();
        let rule = Subdivision::new(&mesh, 1).unwrap();
        let fine = rule.refine(mesh.positions());
        // Corner 0: 3/4 (0,0) + 1/8 (3,0) + 1/8 (0,3) = (0.375, 0.375).
        assert_eq!(fine[0], [0.375, 0.375, 0.0]);
        assert!(fine.iter().all(|p| p[2] == 0.0));
        // The new vertex of a border edge is its midpoint: 0-1 is the first edge found.
        assert_eq!(fine[8], [1.5, 0.0, 0.0]);
    }

    #[test]
    fn weights_sum_to_one_at_every_vertex_of_every_level() {
        let mesh = super::super::tests::frame();
        for level in &Subdivision::new(&mesh, 3).unwrap().levels {
            for range in level.starts.windows(2) {
                let sum: f32 = level.terms[range[0] as usize..range[1] as usize].iter().map(|t| t.1).sum();
                assert_relative_eq!(sum, 1.0, epsilon = 1e-5);
            }
        }
    }

    #[test]
    fn three_rounds_count_as_euler_says() {
        // V - E + F = 2 - 2 borders = 0 for a ring: 8 - 16 + 8, and 4^3 * 8 = 512 triangles with V = E - F.
        let rule = Subdivision::new(&super::super::tests::frame(), 3).unwrap();
        let mesh = rule.refine_mesh(&super::super::tests::frame()).unwrap();
        assert_eq!(mesh.triangles().len(), 512);
        assert_eq!(mesh.vertex_count(), mesh.edges().len() - 512);
    }
}
