//! Shading of wrinkles and bulges from a 3D model: computes how a motion changes the brightness of a face.
//!
//! Skin grows lighter where it turns towards the light and darker in a fold, which receives less light. Candide-3 has too few
//! nodes for folds; the shapes of the embedded head have them (furrows of the forehead, cheeks that bulge over a nasolabial
//! fold). The motion of the nodes is therefore approximated by a mixture of those shapes, as \[ZL\] drive a bank of dense faces
//! by feature points. Here the method is least squares with non-negative weights and a prior towards 0. At every vertex, the
//! mixture is compared with the neutral head in two quantities: the normal n, and the depth c of the surface below its
//! surroundings. The logarithm of the ratio of brightnesses is modelled as `DEPTH (TURNED . (n1 - n0) - SUNKEN (c1 - c0))`.

use std::sync::OnceLock;

use nalgebra::{DMatrix, DVector, Vector2, Vector3};

use super::{
    BankError,
    feature_points::{landmark_pairs, no_warp},
    head::head_skin,
    head_mesh::HeadMesh,
    solve::nonnegative,
};
use crate::{geometry::SplineWarp, interpolation::smooth_step, mesh::vertex_normals, pose::HeadModel, wireframe::Face};

/// Change of log brightness for a change of the normal along y and z, in the mean of people; and factor by which a single
/// person's shading is deeper than the mean, because the position of folds varies between people.
///
/// Fitted with the depth term to the smiles of 90 people in soft light; correlation 0.64 on cheeks, lips and chin.
const TURNED: [f32; 2] = [0.11, 0.30];
const DEPTH: f32 = 1.6;
/// Decrease of log brightness per centimetre of depth.
///
/// The fit to the mean gives 0.59, which is too small because the folds of a mean are shallow. With 2.5, the darkest twentieth of
/// a smiling cheek darkens by 0.095, which matches 90 people (median 0.081, upper quartile 0.108), but in visibly wider bands
/// than theirs. This value darkens it by 0.075.
const SUNKEN: f32 = 1.5;
/// Limit of the shading, as log brightness.
const MOST: f32 = 0.20;
/// Heights on Candide-3, model units, over which shading fades to 0. The furrows of a forehead lie elsewhere on every person, and
/// those of an average head are visible as patches between the brows and lines above them.
const FOREHEAD: (f64, f64) = (0.24, 0.38);
/// Number of smoothing rounds that define the surroundings of a vertex.
const ROUNDS: usize = 5;
/// Variance of motion that no shape explains, divided by the variance of a shape's weight, in squared eye distances.
const PRIOR: f64 = 0.0025;
/// Name prefix of shapes that do not describe skin.
const LOOKS: &str = "eyeLook";

/// The embedded head, prepared for shading.
#[derive(Debug)]
pub(crate) struct Relief {
    head: HeadMesh,
    /// Shapes that may be mixed: index in the head, and motion of the nodes in eye distances.
    shapes: Vec<(usize, Vec<Vector2<f64>>)>,
    /// Concatenated lists of the neighbours of every vertex, and the start of each list.
    neighbours: (Vec<u32>, Vec<u32>),
    normals: Vec<[f32; 3]>,
    sunken: Vec<f32>,
    /// Positions of the vertices on Candide-3's neutral face, model units.
    places: Vec<Vector3<f64>>,
}

impl Relief {
    /// Returns the relief of the embedded head on Candide-3's nodes, computed on first use.
    ///
    /// # Errors
    /// [`BankError`], only if the embedded file is defective.
    pub fn shipped() -> Result<&'static Self, BankError> {
        static RELIEF: OnceLock<Relief> = OnceLock::new();
        match RELIEF.get() {
            Some(relief) => Ok(relief),
            None => Self::new().map(|relief| RELIEF.get_or_init(|| relief)),
        }
    }

    fn new() -> Result<Self, BankError> {
        let (head, face) = (head_skin()?, Face::candide3());
        let model = HeadModel::shipped(&face.wireframe, &face.tables);
        let pupils = model
            .irises
            .each_ref()
            .map(|iris| iris.iter().map(|n| model.mean[n.index()]).sum::<Vector3<f64>>() / iris.len().max(1) as f64);
        let unit = (pupils[0] - pupils[1]).norm().max(1e-9);
        let shapes = model.shapes.iter().filter(|shape| !shape.name.starts_with(LOOKS)).filter_map(|shape| {
            let place = head.names.iter().position(|name| *name == shape.name)?;
            Some((place, shape.offsets.iter().map(|o| o.xy() / unit).collect()))
        });
        let places = on_candide(&head, &face)?;
        let mut relief = Self {
            shapes: shapes.collect(),
            neighbours: neighbours(&head),
            normals: vertex_normals(&head.positions, &head.triangles),
            sunken: Vec::new(),
            places,
            head,
        };
        relief.sunken = relief.sunken_at(&relief.head.positions, &relief.normals);
        Ok(relief)
    }

    /// Positions of the vertices on Candide-3's neutral face, model units.
    pub fn places(&self) -> &[Vector3<f64>] {
        &self.places
    }

    /// Triangles visible from the front.
    pub fn triangles(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        let all = self.head.triangles.iter().map(|t| t.map(|v| v as usize));
        all.filter(|t| t.iter().all(|&v| self.normals[v][2] > 0.0))
    }

    /// Weights of the head's shapes for a motion of the nodes in eye distances, y up.
    fn weights(&self, offsets: &[Vector2<f64>]) -> Vec<f64> {
        let n = self.shapes.len();
        let product = |a: &[Vector2<f64>], b: &[Vector2<f64>]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
        let normal =
            DMatrix::from_fn(n, n, |i, j| product(&self.shapes[i].1, &self.shapes[j].1) + if i == j { PRIOR } else { 0.0 });
        let right = DVector::from_fn(n, |i, _| product(&self.shapes[i].1, offsets));
        nonnegative::minimize(&normal, &right, &[]).into_iter().map(|w| w.min(1.0)).collect()
    }

    /// Change of log brightness of every vertex for a motion of the nodes in eye distances, y up.
    pub fn shading(&self, offsets: &[Vector2<f64>]) -> Vec<f32> {
        let mut positions = self.head.positions.clone();
        for ((shape, _), weight) in self.shapes.iter().zip(self.weights(offsets)) {
            if weight > 0.0 {
                for (p, d) in positions.iter_mut().zip(&self.head.shapes[*shape]) {
                    (0..3).for_each(|c| p[c] += weight as f32 * d[c]);
                }
            }
        }
        let normals = vertex_normals(&positions, &self.head.triangles);
        let sunken = self.sunken_at(&positions, &normals);
        (0..positions.len())
            .map(|v| {
                let turned: f32 = (0..2).map(|k| TURNED[k] * (normals[v][k + 1] - self.normals[v][k + 1])).sum();
                let below_forehead = 1.0 - smooth_step(FOREHEAD.0, FOREHEAD.1, self.places[v].y) as f32;
                let shading = DEPTH * (turned - SUNKEN * (sunken[v] - self.sunken[v]));
                below_forehead * MOST * (shading / MOST).tanh()
            })
            .collect()
    }

    /// Depth of vertices below their surroundings, cm.
    fn sunken_at(&self, positions: &[[f32; 3]], normals: &[[f32; 3]]) -> Vec<f32> {
        let (list, starts) = &self.neighbours;
        let mut smooth = positions.to_vec();
        for _ in 0..ROUNDS {
            let before = smooth.clone();
            for (v, p) in smooth.iter_mut().enumerate() {
                let around = &list[starts[v] as usize..starts[v + 1] as usize];
                let share = 0.5 / around.len().max(1) as f32;
                *p = std::array::from_fn(|c| {
                    0.5 * before[v][c] + share * around.iter().map(|&o| before[o as usize][c]).sum::<f32>()
                });
            }
        }
        let below = |v: usize| (0..3).map(|c| (smooth[v][c] - positions[v][c]) * normals[v][c]).sum();
        (0..positions.len()).map(below).collect()
    }
}

/// Neighbours of each vertex along edges, ascending.
fn neighbours(head: &HeadMesh) -> (Vec<u32>, Vec<u32>) {
    let mut pairs: Vec<[u32; 2]> =
        head.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a], [b, a], [c, b], [a, c]]).collect();
    pairs.sort_unstable();
    pairs.dedup();
    let starts = (0..=head.positions.len() as u32).map(|v| pairs.partition_point(|p| p[0] < v) as u32).collect();
    (pairs.iter().map(|p| p[1]).collect(), starts)
}

/// Maps the head's vertices to Candide-3's neutral face by a smooth map from its landmarks to their nodes.
fn on_candide(head: &HeadMesh, face: &Face) -> Result<Vec<Vector3<f64>>, BankError> {
    let (nodes, places) = landmark_pairs(&head.positions, &head.landmarks, &face.wireframe, &face.tables);
    let warp = SplineWarp::new(&places, &nodes).ok_or_else(no_warp)?;
    Ok(head.positions.iter().map(|p| warp.apply(&Vector3::from(p.map(f64::from)).into())).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_is_taken_apart_into_what_it_was_made_of() {
        let relief = Relief::shipped().unwrap();
        let name = |k: usize| relief.head.names[relief.shapes[k].0].as_str();
        let sneer = |name: &str| name.starts_with("noseSneer");
        let mut offsets = vec![Vector2::zeros(); 113];
        for (_, shape) in relief.shapes.iter().filter(|(place, _)| sneer(&relief.head.names[*place])) {
            offsets.iter_mut().zip(shape).for_each(|(o, s)| *o += s * 0.8);
        }
        let weights = relief.weights(&offsets);
        for (k, weight) in weights.iter().enumerate() {
            // The prior draws it towards 0.
            let expected = if sneer(name(k)) { 0.6..0.85 } else { -0.01..0.2 };
            assert!(expected.contains(weight), "{} {weight}", name(k));
        }
        assert_eq!(relief.weights(&[Vector2::zeros(); 113]), vec![0.0; weights.len()]);
    }

    #[test]
    fn the_head_lies_on_candide_and_a_vertex_below_its_neighbours_is_sunken() {
        let (relief, face) = (Relief::shipped().unwrap(), Face::candide3());
        // The corner of the mouth is itself a landmark.
        let row = face.tables.landmarks.iter().find(|row| row.landmark == 48).unwrap();
        let vertex = relief.head.landmarks[48] as usize;
        assert!((relief.places()[vertex] - face.wireframe.vertices()[row.nodes[0].0.index()].coords).norm() < 1e-6);
        let mut positions = relief.head.positions.clone();
        // A vertex of the cheek is moved 1 mm deeper; at least half of it remains after the smoothing.
        let cheek =
            (0..positions.len()).find(|&v| (relief.places()[v] - Vector3::new(0.25, -0.2, 0.0)).xy().norm() < 0.03).unwrap();
        (0..3).for_each(|c| positions[cheek][c] -= 0.1 * relief.normals[cheek][c]);
        let normals = vertex_normals(&positions, &relief.head.triangles);
        let deeper = relief.sunken_at(&positions, &normals)[cheek] - relief.sunken[cheek];
        assert!((0.05..0.1).contains(&deeper), "{deeper}");
    }
}
