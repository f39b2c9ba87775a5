//! Learns a head model from a dense face model: its neutral mesh, identity modes and expression shapes, on Candide's nodes.
//!
//! Nodes that stand for one landmark (confidence high and medium) take the landmark's vertex. For the other nodes, the neutral Candide-3 is
//! warped onto the mesh through these (biharmonic spline with an affine part), and the nearest vertex is taken. Irises, where a mesh has
//! holes, keep their warped position and move with the corners of their eye. The mean head is made symmetric, scaled to Candide's size
//! (ES0), and aligned by the points that expressions do not move. It is not rotated: the frontal direction is that of the face model.

use nalgebra::Vector3;

use super::{NamedOffsets, camera::HEAD_ES};
use crate::{
    fit::mirror_nodes,
    geometry::SplineWarp,
    units::{FeaturePoint, NodeId},
    wireframe::{Fapus, FapusError, LandmarkConfidence, Tables, Wireframe},
};

/// Default number of identity modes.
pub const IDENTITY_MODES: usize = 15;

/// Weight of depth in the search for the nearest vertex: Candide-3's depth is its least accurate coordinate.
const DEPTH_WEIGHT: f64 = 0.5;

/// A learned head over Candide-3's nodes, model units, face space: a mean, modes of identity and expression shapes.
#[derive(Clone, Debug, PartialEq)]
pub struct LearnedHead {
    /// Mean head.
    pub mean: Vec<Vector3<f64>>,
    /// Modes of identity, each at one standard deviation.
    pub identity: Vec<Vec<Vector3<f64>>>,
    /// Expression shapes at full strength.
    pub expressions: Vec<NamedOffsets>,
}

/// A dense face model: a neutral mesh, modes of identity, and expression shapes. V vertices each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DenseFaces {
    /// Neutral mesh; x to the subject's left, y up, z out of the face, any unit.
    pub neutral: Vec<[f32; 3]>,
    /// Vertices of the 68 landmarks.
    pub landmarks: Vec<u32>,
    /// Modes of identity, offsets from the neutral mesh, each at one standard deviation.
    pub identity: Vec<Vec<[f32; 3]>>,
    /// Expression shapes by their names, offsets from the neutral mesh at full strength.
    pub expressions: Vec<(String, Vec<[f32; 3]>)>,
}

/// Why no head is learned.
#[derive(Debug, thiserror::Error)]
pub enum LearnHeadError {
    /// The 68 landmarks do not form a face.
    #[error("the landmarks of the face model: {reason}")]
    Landmarks {
        /// What is wrong.
        reason: String,
    },
    /// A shape with another number of vertices.
    #[error("{name} has {found} vertices, but the neutral mesh has {expected}")]
    Vertices {
        /// The shape.
        name: String,
        /// Its vertices.
        found: usize,
        /// Those of the neutral mesh.
        expected: usize,
    },
    /// Too few modes.
    #[error("--modes {modes}: the face model has only {found} identity modes")]
    Modes {
        /// Modes there are.
        found: usize,
        /// Modes asked for.
        modes: usize,
    },
    /// The eye distance of the mean head cannot be measured.
    #[error(transparent)]
    Fapus(#[from] FapusError),
}

/// Position of a node on a dense mesh.
#[derive(Clone, Debug, PartialEq)]
pub enum Binding {
    /// On a vertex.
    Vertex(usize),
    /// At a fixed position that moves with the mean of these vertices.
    With(Vector3<f64>, Vec<usize>),
}

/// Binds every node of Candide-3 to a mesh with known vertices of the 68 landmarks.
///
/// # Errors
/// A message, if the landmarks do not determine a warp.
pub fn bind_nodes(
    positions: &[[f32; 3]],
    landmarks: &[u32],
    wireframe: &Wireframe,
    tables: &Tables,
) -> Result<Vec<Binding>, String> {
    let vertex = |landmark: u8| {
        let found = landmarks.get(usize::from(landmark)).map(|&v| v as usize).filter(|&v| v < positions.len());
        found.ok_or_else(|| format!("landmark {landmark} has no vertex among the {} of the mesh", positions.len()))
    };
    let place = |v: usize| Vector3::from(positions[v].map(f64::from));
    let node_place = |n: NodeId| wireframe.vertices()[n.index()].coords;
    let (mut from, mut to): (Vec<Vector3<f64>>, Vec<Vector3<f64>>) = (Vec::new(), Vec::new());
    let mut bound: Vec<Option<usize>> = vec![None; wireframe.node_count()];
    for row in tables.landmarks.iter().filter(|r| r.confidence != LandmarkConfidence::Low) {
        let at = vertex(row.landmark)?;
        if let [(node, _)] = row.nodes[..] {
            bound[node.index()] = Some(at);
        }
        let source = row.nodes.iter().map(|&(n, w)| node_place(n) * w).sum();
        // Candide-3's inner lips coincide in the neutral shape: one of the two nodes defines the position.
        if !from.contains(&source) {
            from.push(source);
            to.push(place(at));
        }
    }
    let warp = SplineWarp::new(&from, &to).ok_or("the landmarks lie on a line or a point")?;
    let corners = |points: [u8; 2]| -> Vec<usize> {
        let nodes = points.iter().filter_map(|&point| tables.feature_point_nodes(FeaturePoint { group: 3, point }));
        nodes.flatten().filter_map(|n| bound[n.index()]).collect()
    };
    let irises = [(5, corners([7, 11])), (6, corners([8, 12]))];
    let bind = |k: usize| {
        let warped = warp.apply(&wireframe.vertices()[k]);
        if let Some(at) = bound[k] {
            return Binding::Vertex(at);
        }
        for (point, corners) in &irises {
            let nodes = tables.feature_point_nodes(FeaturePoint { group: 3, point: *point }).unwrap_or_default();
            if nodes.iter().any(|n| n.index() == k) {
                return Binding::With(warped, corners.clone());
            }
        }
        let distance = |v: usize| {
            let d = place(v) - warped;
            d.x * d.x + d.y * d.y + DEPTH_WEIGHT * DEPTH_WEIGHT * d.z * d.z
        };
        let nearest = (0..positions.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)));
        Binding::Vertex(nearest.unwrap_or(0))
    };
    Ok((0..wireframe.node_count()).map(bind).collect())
}

impl Binding {
    /// Returns the position of the node on the mesh.
    pub fn place(&self, positions: &[[f32; 3]]) -> Vector3<f64> {
        match self {
            Self::Vertex(v) => Vector3::from(positions[*v].map(f64::from)),
            Self::With(place, _) => *place,
        }
    }

    /// Returns the displacement of the node for displacements of the mesh.
    pub fn moves(&self, displacements: &[[f32; 3]]) -> Vector3<f64> {
        match self {
            Self::Vertex(v) => Vector3::from(displacements[*v].map(f64::from)),
            Self::With(_, with) => {
                with.iter().map(|&v| Vector3::from(displacements[v].map(f64::from))).sum::<Vector3<f64>>()
                    / with.len().max(1) as f64
            }
        }
    }
}

/// Learns a head from the first `modes` identity modes of a face model. Also returns the BLAKE3 of the data used.
///
/// # Errors
/// [`LearnHeadError`].
pub fn learn_head(
    faces: &DenseFaces,
    modes: usize,
    wireframe: &Wireframe,
    tables: &Tables,
) -> Result<(LearnedHead, String), LearnHeadError> {
    let wrong = |reason: String| LearnHeadError::Landmarks { reason };
    let bindings = bind_nodes(&faces.neutral, &faces.landmarks, wireframe, tables).map_err(wrong)?;
    let mirror = mirror_nodes(wireframe).map_err(|e| wrong(e.to_string()))?;
    let mirrored = |k: usize, of: &[Vector3<f64>]| Vector3::new(-of[mirror[k]].x, of[mirror[k]].y, of[mirror[k]].z);
    let raw: Vec<Vector3<f64>> = bindings.iter().map(|b| b.place(&faces.neutral)).collect();
    let mut mean: Vec<Vector3<f64>> = (0..raw.len()).map(|k| (raw[k] + mirrored(k, &raw)) / 2.0).collect();
    follow(wireframe, &mut mean);
    let frontal: Vec<nalgebra::Point2<f64>> = mean.iter().map(|v| nalgebra::Point2::new(v.x, v.y)).collect();
    let scale = HEAD_ES / Fapus::measure(&tables.fapus, &frontal)?.es;
    let stable = crate::normalize::stable_nodes(tables, wireframe.node_count());
    let middle = |of: &dyn Fn(usize) -> Vector3<f64>| stable.iter().map(|&k| of(k)).sum::<Vector3<f64>>() / stable.len() as f64;
    let shift = middle(&|k| wireframe.vertices()[k].coords) - middle(&|k| mean[k] * scale);
    mean.iter_mut().for_each(|v| *v = *v * scale + shift);

    let mut hasher = blake3::Hasher::new();
    let mut on_nodes = |name: &str, displacements: &[[f32; 3]]| {
        let (found, expected) = (displacements.len(), faces.neutral.len());
        if found != expected {
            return Err(LearnHeadError::Vertices { name: name.to_owned(), found, expected });
        }
        displacements.iter().flatten().for_each(|v| {
            hasher.update(&v.to_le_bytes());
        });
        let mut moved: Vec<Vector3<f64>> = bindings.iter().map(|b| b.moves(displacements) * scale).collect();
        follow(wireframe, &mut moved);
        Ok(moved)
    };
    if faces.identity.len() < modes {
        return Err(LearnHeadError::Modes { found: faces.identity.len(), modes });
    }
    let mut identity = Vec::with_capacity(modes);
    for (k, mode) in faces.identity[..modes].iter().enumerate() {
        identity.push(on_nodes(&format!("identity mode {k}"), mode)?);
    }
    let mut expressions = Vec::new();
    for (name, shape) in &faces.expressions {
        let mut offsets = on_nodes(name, shape)?;
        for (node, binding) in bindings.iter().enumerate() {
            // Irises do not move with the skin.
            if matches!(binding, Binding::With(..)) {
                offsets[node] = Vector3::zeros();
            }
        }
        expressions.push(NamedOffsets { name: name.clone(), offsets });
    }
    Ok((LearnedHead { mean, identity, expressions }, hasher.finalize().to_hex().to_string()))
}

/// Gives every node in no triangle the mean of its leaders.
fn follow(wireframe: &Wireframe, nodes: &mut [Vector3<f64>]) {
    for follower in wireframe.followers() {
        let sum: Vector3<f64> = follower.leaders.iter().map(|n| nodes[n.index()]).sum();
        nodes[follower.node.index()] = sum / follower.leaders.len().max(1) as f64;
    }
}
