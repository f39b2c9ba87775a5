//! Learns a shape prior from points of neutral faces.
//!
//! 1. Every face is completed to all nodes. Its known nodes (for landmarks: those that stand for one node, confidence high and medium)
//!    place Candide-3 with its shape units; unknown iris boxes follow the similarity of the eye's lids; the springs carry all other nodes,
//!    with the known ones as hard positions. A face with a point implausibly far from the median of the faces is refused (`far.rs`).
//! 2. Every face is joined by its mirror image, so that the mean is symmetric and left and right do not differ by chance.
//! 3. The faces are aligned by similarity on the landmarks of eyes and nose (generalized Procrustes), the mean on Candide-3.
//! 4. The principal components of the live nodes are the modes; the remainder is the residual of each node.

use std::collections::BTreeSet;

use nalgebra::{DMatrix, Point2, SymmetricEigen, Vector2};

use super::{
    FACES_MARK_DEVIATION, FacePoints, NeutralFace, ShapePrior,
    far::{Known, far_points},
};
use crate::{
    dataset::{LandmarkSelection, LandmarksError, correspondences_from_landmarks},
    fit::{DrivenNode, Pull, SpringError, Springs},
    geometry::{Similarity, SimilarityError},
    units::NodeId,
    wireframe::{Fapu, Region, Tables, Wireframe},
};

/// Default number of modes: 99 % of the variance of 90 faces.
pub const DEFAULT_MODES: usize = 12;

/// Smallest number of faces for a prior.
pub const MINIMUM_FACES: usize = 10;

/// Iterations of alignment and mean; the mean of 90 faces has converged after three.
const ALIGNMENT_TURNS: usize = 10;

/// Largest distance of a point from the median face's, in distances between the eyes' middles. Of 90 neutral faces the largest is 0.30, at
/// a chin; of the same people smiling 0.28.
const FURTHEST: f64 = 1.0;

/// Share of points beyond that limit above which the whole face is wrong, not a point.
const MOST_FAR: f64 = 0.25;

/// Largest distance of a node from the mirror image of its counterpart, model units.
const MIRROR_TOLERANCE: f64 = 1e-3;

/// Why no prior is learned.
#[derive(Debug, thiserror::Error)]
pub enum LearnError {
    /// Too few faces.
    #[error("{found} faces; a prior needs at least {MINIMUM_FACES}, and more than 50 for a good one")]
    TooFewFaces {
        /// Faces given.
        found: usize,
    },
    /// The number of modes is not available.
    #[error("cannot learn {asked} modes from {faces} faces; choose 1 to {most}")]
    Modes {
        /// Modes asked for.
        asked: usize,
        /// Faces given.
        faces: usize,
        /// The most there can be.
        most: usize,
    },
    /// A face whose landmarks do not determine a placement.
    #[error("{name}: the landmarks do not determine a placement: {source}")]
    Placement {
        /// The face.
        name: String,
        /// Why.
        source: SimilarityError,
    },
    /// A face with landmarks missing.
    #[error("{name}: {source}")]
    Landmarks {
        /// The face.
        name: String,
        /// Which.
        source: Box<LandmarksError>,
    },
    /// A face with a node that the wireframe does not have.
    #[error("{name}: there is no node {node}; there are {count}")]
    NoSuchNode {
        /// The face.
        name: String,
        /// The node.
        node: NodeId,
        /// Nodes of the wireframe.
        count: usize,
    },
    /// A face that the springs do not complete.
    #[error("{name}: {source}")]
    Springs {
        /// The face.
        name: String,
        /// Why.
        source: SpringError,
    },
    /// A face that is mirrored or upside down.
    #[error(
        "{name}: the face is upside down (roll {degrees:.0} degrees); check that y points down and that the 68 points are in the iBUG order"
    )]
    UpsideDown {
        /// The face.
        name: String,
        /// Its roll.
        degrees: f64,
    },
    /// A face with a point at an impossible position.
    #[error(
        "{name}: {point} is at ({x:?}, {y:?}), {distance:.1} eye distances from its place in the other faces; correct it, or leave the face out"
    )]
    FarPoint {
        /// The face.
        name: String,
        /// Its node, and the landmark that stands for it where landmarks were given.
        point: String,
        /// Its x, px.
        x: f64,
        /// Its y, px.
        y: f64,
        /// How far off it is, distances of the eyes' middles.
        distance: f64,
    },
    /// A wireframe whose halves are not mirror images.
    #[error("node {node} of the wireframe has no counterpart on the other side; learn the prior with Candide-3")]
    NotSymmetric {
        /// The node.
        node: NodeId,
    },
}

/// Learns a prior with `modes` modes from neutral faces (px, y down).
///
/// # Errors
/// `LearnError` for fewer than 10 faces, more modes than faces allow, or a face that does not determine a placement of the wireframe.
pub fn learn_prior(
    wireframe: &Wireframe,
    tables: &Tables,
    faces: &[NeutralFace],
    modes: usize,
) -> Result<ShapePrior, LearnError> {
    if faces.len() < MINIMUM_FACES {
        return Err(LearnError::TooFewFaces { found: faces.len() });
    }
    let live = wireframe.live_nodes();
    let most = (faces.len() - 1).min(2 * live.len());
    if modes == 0 || modes > most {
        return Err(LearnError::Modes { asked: modes, faces: faces.len(), most });
    }
    let mirror = mirror_nodes(wireframe)?;
    let completion = Completion::new(wireframe, tables);
    let known = faces.iter().map(|face| completion.known(face)).collect::<Result<Vec<_>, _>>()?;
    let eye_distance = completion.eye_distance();
    let far = far_points(&known, &completion.frontal, FURTHEST * eye_distance);
    let mut shapes = Vec::with_capacity(2 * faces.len());
    for ((face, known), far) in faces.iter().zip(&known).zip(far) {
        let error = far.map(|far| (far.count, completion.far_point(face, known, far.point, far.distance / eye_distance)));
        let shape = match error {
            Some((count, error)) if count as f64 <= MOST_FAR * known.0.len() as f64 => return Err(error),
            // The completion gives a better message for a face that is wrong as a whole, for example upside down.
            Some((_, error)) => return Err(completion.complete(face, known).err().unwrap_or(error)),
            None => completion.complete(face, known)?,
        };
        shapes.push(mirrored(&shape, &mirror));
        shapes.push(shape);
    }
    let stable = stable_nodes(tables);
    let mut mean = align(&mut shapes, wireframe, &stable, &mirror)
        .map_err(|source| LearnError::Placement { name: "the mean face".to_owned(), source })?;

    let offsets = DMatrix::from_fn(shapes.len(), 2 * live.len(), |i, c| {
        let k = live[c / 2].index();
        shapes[i][k][c % 2] - mean[k][c % 2]
    });
    let covariance = offsets.transpose() * &offsets / shapes.len() as f64;
    let total: Vec<f64> = (0..live.len()).map(|i| covariance[(2 * i, 2 * i)] + covariance[(2 * i + 1, 2 * i + 1)]).collect();
    let eigen = SymmetricEigen::new(covariance);
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]).then(a.cmp(&b)));

    let mut held = vec![0.0; live.len()];
    let mut prior_modes = Vec::with_capacity(modes);
    for &column in order.iter().take(modes) {
        let deviation = eigen.eigenvalues[column].max(0.0).sqrt();
        let vector = eigen.eigenvectors.column(column);
        // The sign of an eigenvector is arbitrary: the sum of its components, each times its index, is made positive. A rule on the largest
        // component would depend on rounding in a mirrored mode, where two components are equally large.
        let moment: f64 = vector.iter().enumerate().map(|(c, v)| c as f64 * v).sum();
        let sign = if moment < 0.0 { -deviation } else { deviation };
        let mut mode = vec![Vector2::zeros(); wireframe.node_count()];
        for (i, node) in live.iter().enumerate() {
            mode[node.index()] = Vector2::new(vector[2 * i], vector[2 * i + 1]) * sign;
            held[i] += mode[node.index()].norm_squared();
        }
        follow(wireframe, &mut mode);
        prior_modes.push(mode);
    }
    wireframe.place_followers(&mut mean);
    let mut residuals = vec![0.0; wireframe.node_count()];
    for (i, node) in live.iter().enumerate() {
        // Sum of the variances of x and y, halved for one of them.
        residuals[node.index()] = ((total[i] - held[i]).max(0.0) / 2.0).sqrt();
    }
    Ok(ShapePrior { mean, deviations: vec![1.0; modes], modes: prior_modes, residuals, mark_deviation: FACES_MARK_DEVIATION })
}

/// Gives every node in no triangle the mean offset of its leaders.
fn follow(wireframe: &Wireframe, mode: &mut [Vector2<f64>]) {
    let mut points: Vec<Point2<f64>> = mode.iter().map(|&v| Point2::from(v)).collect();
    wireframe.place_followers(&mut points);
    mode.iter_mut().zip(points).for_each(|(v, p)| *v = p.coords);
}

/// Completes faces to all nodes.
struct Completion<'a> {
    wireframe: &'a Wireframe,
    tables: &'a Tables,
    springs: Springs,
    candide: ShapePrior,
    frontal: Vec<Point2<f64>>,
    /// Nodes of each eye's landmarks and of its iris box.
    eyes: [(Vec<NodeId>, Vec<NodeId>); 2],
}

impl<'a> Completion<'a> {
    fn new(wireframe: &'a Wireframe, tables: &'a Tables) -> Self {
        let frontal = wireframe.frontal();
        let lids: Vec<NodeId> =
            tables.landmarks.iter().filter(|r| r.part == "eye").flat_map(|r| r.nodes.iter().map(|n| n.0)).collect();
        let irises = |left: bool| -> Vec<NodeId> {
            let of_es = tables.fapus.iter().filter(|d| d.fapu == Fapu::Es);
            of_es.flat_map(|d| if left { d.plus_nodes.clone() } else { d.minus_nodes.clone() }).collect()
        };
        let eye = |left: bool| {
            let side = lids.iter().copied().filter(|n| (frontal[n.index()].x > 0.0) == left).collect();
            (side, irises(left))
        };
        let eyes = [eye(true), eye(false)];
        Self { wireframe, tables, springs: Springs::new(wireframe), candide: ShapePrior::candide(wireframe), frontal, eyes }
    }

    /// Returns the distance between the middles of Candide-3's eyes.
    fn eye_distance(&self) -> f64 {
        let [left, right] = [0, 1].map(|eye: usize| {
            let lids = &self.eyes[eye].0;
            lids.iter().map(|n| self.frontal[n.index()].coords).sum::<Vector2<f64>>() / lids.len().max(1) as f64
        });
        (left - right).norm()
    }

    /// Returns the error that the `k`-th known point of a face is too far off.
    fn far_point(&self, face: &NeutralFace, (nodes, seen): &Known, k: usize, distance: f64) -> LearnError {
        let (node, place) = (nodes[k], seen[k]);
        let of_node = |row: &&crate::wireframe::LandmarkRow| matches!(row.nodes[..], [(single, _)] if single == node);
        let landmark = self.tables.landmarks.iter().find(of_node).filter(|_| matches!(face.points, FacePoints::Landmarks(_)));
        let point = landmark.map_or_else(|| format!("node {node}"), |row| format!("point {}", row.landmark));
        LearnError::FarPoint { name: face.name.clone(), point, x: place.x, y: -place.y, distance }
    }

    /// Returns the known nodes of a face and their positions, y up.
    fn known(&self, face: &NeutralFace) -> Result<Known, LearnError> {
        let known: Vec<(NodeId, Point2<f64>)> = match &face.points {
            FacePoints::Landmarks(landmarks) => {
                let marks = correspondences_from_landmarks(landmarks, self.tables, &LandmarkSelection::HighAndMedium)
                    .map_err(|source| LearnError::Landmarks { name: face.name.clone(), source: Box::new(source) })?;
                marks.iter().map(|m| (m.node, m.position)).collect()
            }
            FacePoints::Nodes(nodes) => nodes.clone(),
        };
        let count = self.wireframe.node_count();
        if let Some(&(node, _)) = known.iter().find(|(n, _)| n.index() >= count) {
            return Err(LearnError::NoSuchNode { name: face.name.clone(), node, count });
        }
        Ok(known.into_iter().map(|(node, p)| (node, Point2::new(p.x, -p.y))).unzip())
    }

    /// Returns all nodes of a face, in face space, approximately at Candide's position and size.
    fn complete(&self, face: &NeutralFace, (nodes, seen): &Known) -> Result<Vec<Point2<f64>>, LearnError> {
        let placement = |source| LearnError::Placement { name: face.name.clone(), source };
        let found = self.candide.explain(nodes, seen).map_err(placement)?;
        if found.marks_from_face.angle.abs() > std::f64::consts::FRAC_PI_2 {
            let degrees = found.marks_from_face.angle.to_degrees();
            return Err(LearnError::UpsideDown { name: face.name.clone(), degrees });
        }
        let face_from_marks = found.marks_from_face.inverse();
        let hard = |node, position| DrivenNode { node, position, pull: Pull::Hard };
        let mut place: Vec<Option<Point2<f64>>> = vec![None; self.wireframe.node_count()];
        let mut targets = Vec::with_capacity(nodes.len());
        for (&node, p) in nodes.iter().zip(seen) {
            let position = face_from_marks.apply(p);
            place[node.index()] = Some(position);
            targets.push(hard(node, position));
        }
        for (lids, iris) in &self.eyes {
            let pairs = lids.iter().filter_map(|n| Some((self.frontal[n.index()], place[n.index()]?)));
            let (from, to): (Vec<_>, Vec<_>) = pairs.unzip();
            let moved = Similarity::fit(&from, &to, None).map_err(placement)?;
            let unknown = iris.iter().filter(|n| place[n.index()].is_none());
            targets.extend(unknown.map(|&n| hard(n, moved.apply(&self.frontal[n.index()]))));
        }
        self.springs
            .deform(self.wireframe, &found.shape, &targets)
            .map_err(|source| LearnError::Springs { name: face.name.clone(), source })
    }
}

/// Returns the nodes of landmarks that expressions hardly move: eyes and nose.
pub(super) fn stable_nodes(tables: &Tables) -> Vec<NodeId> {
    let single = tables.landmarks.iter().filter_map(|row| match row.nodes[..] {
        [(node, _)] => Some(node),
        _ => None,
    });
    single.filter(|&n| matches!(tables.region(n), Region::Eye | Region::Nose)).collect()
}

/// Aligns the shapes with their mean by the stable nodes; returns the mean, symmetric and aligned with Candide-3.
fn align(
    shapes: &mut [Vec<Point2<f64>>],
    wireframe: &Wireframe,
    stable: &[NodeId],
    mirror: &[usize],
) -> Result<Vec<Point2<f64>>, SimilarityError> {
    let pick = |shape: &[Point2<f64>]| -> Vec<Point2<f64>> { stable.iter().map(|n| shape[n.index()]).collect() };
    let frontal = wireframe.frontal();
    let mut mean = frontal.clone();
    for _ in 0..ALIGNMENT_TURNS {
        let mut sum = vec![Vector2::zeros(); mean.len()];
        for shape in shapes.iter_mut() {
            let onto = Similarity::fit(&pick(shape), &pick(&mean), None)?;
            for (p, s) in shape.iter_mut().zip(&mut sum) {
                *p = onto.apply(p);
                *s += p.coords;
            }
        }
        let average: Vec<_> = sum.iter().map(|s| Point2::from(s / shapes.len() as f64)).collect();
        let other = mirrored(&average, mirror);
        mean = average.iter().zip(&other).map(|(a, b)| nalgebra::center(a, b)).collect();
        let onto = Similarity::fit(&pick(&mean), &pick(&frontal), None)?;
        mean.iter_mut().for_each(|p| *p = onto.apply(p));
    }
    for shape in shapes.iter_mut() {
        let onto = Similarity::fit(&pick(shape), &pick(&mean), None)?;
        shape.iter_mut().for_each(|p| *p = onto.apply(p));
    }
    Ok(mean)
}

/// Returns the mirrored face, with every node keeping its meaning.
fn mirrored(shape: &[Point2<f64>], mirror: &[usize]) -> Vec<Point2<f64>> {
    mirror.iter().map(|&k| Point2::new(-shape[k].x, shape[k].y)).collect()
}

/// Returns the mirror node of every node; a node on the midline is its own. If two candidates coincide (the inner lips), the one whose
/// neighbours are the mirror images of the node's own is taken.
pub(crate) fn mirror_nodes(wireframe: &Wireframe) -> Result<Vec<usize>, LearnError> {
    let vertices = wireframe.vertices();
    let live = wireframe.live_nodes();
    let mut neighbours = vec![BTreeSet::new(); vertices.len()];
    for &(a, b) in wireframe.edges() {
        neighbours[a.index()].insert(b.index());
        neighbours[b.index()].insert(a.index());
    }
    let candidates: Vec<Vec<usize>> = vertices
        .iter()
        .map(|v| {
            let other = nalgebra::Point3::new(-v.x, v.y, v.z);
            live.iter().map(|n| n.index()).filter(|&k| (vertices[k] - other).norm() <= MIRROR_TOLERANCE).collect()
        })
        .collect();
    let shared = |i: usize, candidate: usize| {
        let certain = neighbours[i].iter().filter_map(|&n| match candidates[n][..] {
            [only] => Some(only),
            _ => None,
        });
        certain.filter(|n| neighbours[candidate].contains(n)).count()
    };
    let mut mirror: Vec<usize> = (0..vertices.len()).collect();
    for node in live {
        let i = node.index();
        // The first of the best.
        let best = candidates[i].iter().rev().max_by_key(|&&candidate| (shared(i, candidate), candidate == i));
        mirror[i] = *best.ok_or(LearnError::NotSymmetric { node: *node })?;
    }
    match live.iter().find(|n| mirror[mirror[n.index()]] != n.index()) {
        Some(&node) => Err(LearnError::NotSymmetric { node }),
        None => Ok(mirror),
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    /// Landmarks of Candide-3 itself, 100 px per unit, mouth corners moved by `wide` px to the sides.
    fn face(name: usize, wide: f64) -> NeutralFace {
        let (w, tables) = (Wireframe::candide3(), Tables::candide3());
        let frontal = w.frontal();
        let landmarks = tables.landmarks.iter().map(|row| {
            let p: Vector2<f64> = row.nodes.iter().map(|(n, share)| frontal[n.index()].coords * *share).sum();
            let side = if matches!(row.landmark, 48 | 54) { wide * p.x.signum() } else { 0.0 };
            Point2::new(300.0 + 100.0 * p.x + side, 200.0 - 100.0 * p.y)
        });
        NeutralFace { name: name.to_string(), points: FacePoints::Landmarks(landmarks.collect()) }
    }

    #[test]
    fn the_mirror_is_an_involution_that_keeps_the_springs() {
        let w = Wireframe::candide3();
        let mirror = mirror_nodes(&w).unwrap();
        let edges: BTreeSet<_> = w.edges().iter().map(|(a, b)| (a.index(), b.index())).collect();
        let other = |&(a, b): &(usize, usize)| (mirror[a].min(mirror[b]), mirror[a].max(mirror[b]));
        let unmatched: Vec<_> = edges.iter().filter(|edge| !edges.contains(&other(edge))).collect();
        // Only the diagonals of the two iris boxes correspond on both sides.
        assert_eq!(unmatched, [&(67, 72), &(70, 73)]);
        // The coincident inner lips keep upper and lower apart.
        assert_eq!([81, 83, 82, 84, 40, 87, 31].map(|k| mirror[k]), [82, 84, 81, 83, 40, 87, 64]);
    }

    #[test]
    fn faces_that_differ_in_one_way_have_one_mode() {
        let (w, tables) = (Wireframe::candide3(), Tables::candide3());
        // Mouth corners -2 and +2 px out: mean 0, standard deviation 2 px = 0.02 units at each corner.
        let faces: Vec<_> = (0..10).map(|i| face(i, if i % 2 == 0 { -2.0 } else { 2.0 })).collect();
        let prior = learn_prior(&w, &tables, &faces, 1).unwrap();
        assert_relative_eq!(prior.mean[31], w.frontal()[31], epsilon = 1e-3);
        assert_relative_eq!(prior.modes[0][31].x.abs(), 0.02, epsilon = 5e-4);
        assert_relative_eq!(prior.modes[0][31].x, -prior.modes[0][64].x, epsilon = 1e-9);
        assert!(prior.residuals.iter().all(|r| *r < 1e-3));
        // Wide marks give a wide mouth.
        let nodes = [20, 23, 53, 56, 31, 64, 10].map(NodeId);
        let mut seen = nodes.map(|n| w.frontal()[n.index()]);
        seen[4].x += 0.02;
        seen[5].x -= 0.02;
        let found = prior.explain(&nodes, &seen).unwrap();
        assert!(found.shape[31].x > prior.mean[31].x + 0.01);
    }

    #[test]
    fn nodes_teach_what_landmarks_do_and_unknown_ones_are_refused() {
        let (w, tables) = (Wireframe::candide3(), Tables::candide3());
        let as_nodes = |face: NeutralFace| {
            let FacePoints::Landmarks(landmarks) = &face.points else { unreachable!() };
            let marks = correspondences_from_landmarks(landmarks, &tables, &LandmarkSelection::HighAndMedium).unwrap();
            NeutralFace { points: FacePoints::Nodes(marks.iter().map(|m| (m.node, m.position)).collect()), ..face }
        };
        let faces: Vec<_> = (0..10).map(|i| face(i, i as f64)).collect();
        let mut nodes: Vec<_> = faces.iter().cloned().map(as_nodes).collect();
        assert_eq!(learn_prior(&w, &tables, &nodes, 3).unwrap(), learn_prior(&w, &tables, &faces, 3).unwrap());
        let FacePoints::Nodes(of_one) = &mut nodes[4].points else { unreachable!() };
        of_one[0].0 = NodeId(113);
        let error = learn_prior(&w, &tables, &nodes, 3).unwrap_err().to_string();
        assert_eq!(error, "4: there is no node 113; there are 113");
    }

    #[test]
    fn too_few_faces_or_too_many_modes_are_refused() {
        let (w, tables) = (Wireframe::candide3(), Tables::candide3());
        let faces: Vec<_> = (0..10).map(|i| face(i, i as f64)).collect();
        let error = |faces: &[NeutralFace], modes| learn_prior(&w, &tables, faces, modes).unwrap_err().to_string();
        assert!(error(&faces[..9], 3).starts_with("9 faces; a prior needs at least 10"));
        assert_eq!(error(&faces, 10), "cannot learn 10 modes from 10 faces; choose 1 to 9");
        let mut wild = faces.clone();
        let set = |faces: &mut [NeutralFace], k: usize, to: fn(&mut Point2<f64>)| {
            let FacePoints::Landmarks(landmarks) = &mut faces[7].points else { unreachable!() };
            to(&mut landmarks[k]);
        };
        // A digit too many, in a corner of the mouth or of an eye, or a coordinate so large that its square overflows.
        set(&mut wild, 48, |p| p.x = 5000.0);
        assert!(error(&wild, 3).starts_with("7: point 48 is at (5000.0, "), "{}", error(&wild, 3));
        for (k, to) in [(36, (|p| p.y = -1e4) as fn(&mut Point2<f64>)), (30, |p| p.x = 1e300)] {
            wild.clone_from(&faces);
            set(&mut wild, k, to);
            assert!(error(&wild, 3).starts_with(&format!("7: point {k} is at (")), "{}", error(&wild, 3));
        }
        let mut upside_down = faces.clone();
        let change = |faces: &mut [NeutralFace], f: fn(&mut Point2<f64>)| match &mut faces[3].points {
            FacePoints::Landmarks(landmarks) => landmarks.iter_mut().for_each(f),
            FacePoints::Nodes(_) => unreachable!(),
        };
        change(&mut upside_down, |p| *p = -*p);
        assert!(error(&upside_down, 3).starts_with("3: the face is upside down"));
        change(&mut upside_down, |p| *p = Point2::origin());
        assert!(error(&upside_down, 3).starts_with("3: the landmarks do not determine a placement"));
    }
}
