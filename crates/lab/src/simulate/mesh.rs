//! The drawn surface: Candide-3's triangles and a skirt around them, refined smoothly so that the surface passes exactly through every
//! node.
//!
//! The *plane* is the subject's own neutral frontal view; textures are painted on it. A Hermite rule extends a function of the nodes (a
//! displacement, a depth) to the refined vertices. It estimates a gradient at each vertex; the middle of an edge gets the mean of its ends
//! plus a bend from these gradients. Values at nodes are kept, so the map from plane to image is exact at nodes, and the facets of the 184
//! triangles disappear.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix2, Point2, Vector2, Vector3};

use grimace::internal::{units::NodeId, wireframe::Wireframe};

/// Number of refinement rounds; each splits every triangle into four.
const ROUNDS: usize = 2;
/// Share of the estimated bend that is applied; values below 1 keep the surface closer to the flat triangles.
const TENSION: f64 = 0.85;
/// The nodes of the iris boxes; triangles with one of them belong to the eyeball, not to the skin.
const EYEBALL: std::ops::RangeInclusive<u16> = 67..=74;
/// Distance of the first ring of the skirt from the middle of the face, relative to the distance of the border node.
const INNER_RING: f64 = 1.32;
/// Middle of the face for the skirt, model units.
const MIDDLE: Point2<f64> = Point2::new(0.0, 0.05);
/// Half width and vertical range of the outer ring, model units; it lies outside every picture.
const OUTER_RING: (f64, f64, f64) = (7.0, -7.0, 7.0);

/// The motion that a vertex of the drawn surface follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Anchor {
    /// A node of the wireframe.
    Node(NodeId),
    /// The head, without the expression.
    Head,
    /// The body, which shifts with the head but does not rotate.
    Body,
}

/// The refined surface of one subject.
#[derive(Clone, Debug)]
pub struct SkinMesh {
    anchors: Vec<Anchor>,
    plane: Vec<Point2<f64>>,
    levels: Vec<Level>,
    triangles: Vec<[u32; 3]>,
}

/// One round of refinement.
#[derive(Clone, Debug)]
struct Level {
    /// Neighbours of each vertex and the inverse of its normal equations; `None` when the neighbours lie on one line.
    rings: Vec<(Vec<u32>, Option<Matrix2<f64>>)>,
    /// Ends of each split edge, in the order of the new vertices.
    edges: Vec<[u32; 2]>,
}

impl SkinMesh {
    /// Makes the drawn surface over a subject's neutral frontal view.
    pub fn new(wireframe: &Wireframe, neutral: &[Point2<f64>]) -> Self {
        let is_eyeball = |t: &[NodeId; 3]| t.iter().any(|n| EYEBALL.contains(&n.0));
        let skin: Vec<[NodeId; 3]> = wireframe.triangles().iter().filter(|t| !is_eyeball(t)).copied().collect();
        let border = outer_border(wireframe);
        let mut index_of: BTreeMap<NodeId, u32> = BTreeMap::new();
        let mut anchors = Vec::new();
        for node in skin.iter().flatten() {
            index_of.entry(*node).or_insert_with(|| {
                anchors.push(Anchor::Node(*node));
                anchors.len() as u32 - 1
            });
        }
        let mut plane: Vec<Point2<f64>> =
            anchors.iter().map(|a| if let Anchor::Node(n) = a { neutral[n.index()] } else { MIDDLE }).collect();
        let mut triangles: Vec<[u32; 3]> = skin.iter().map(|t| t.map(|n| index_of[&n])).collect();
        let count = border.len() as u32;
        let inner = anchors.len() as u32;
        for node in &border {
            anchors.push(Anchor::Head);
            plane.push(MIDDLE + (neutral[node.index()] - MIDDLE) * INNER_RING);
        }
        let outer = anchors.len() as u32;
        for node in &border {
            let direction = neutral[node.index()] - MIDDLE;
            anchors.push(if direction.y < -0.3 { Anchor::Body } else { Anchor::Head });
            plane.push(on_rectangle(direction));
        }
        for k in 0..count {
            let next = (k + 1) % count;
            let (a, b) = (index_of[&border[k as usize]], index_of[&border[next as usize]]);
            for (near, far) in [([a, b], inner), ([inner + k, inner + next], outer)] {
                triangles.push([near[0], far + k, near[1]]);
                triangles.push([near[1], far + k, far + next]);
            }
        }
        let mut levels = Vec::new();
        for _ in 0..ROUNDS {
            let (level, finer) = split(&plane, &triangles);
            for &[a, b] in &level.edges {
                plane.push(nalgebra::center(&plane[a as usize], &plane[b as usize]));
            }
            triangles = finer;
            levels.push(level);
        }
        Self { anchors, plane, levels, triangles }
    }

    /// Returns the motion of each vertex of the coarse surface; the refined vertices follow them.
    pub fn anchors(&self) -> &[Anchor] {
        &self.anchors
    }

    /// Returns the refined vertices on the plane.
    pub fn plane(&self) -> &[Point2<f64>] {
        &self.plane
    }

    /// Returns the refined triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Extends values at the coarse vertices to all refined vertices; values at coarse vertices do not change.
    pub fn refine(&self, coarse: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut values = coarse.to_vec();
        for level in &self.levels {
            let gradients: Vec<[Vector3<f64>; 2]> = level
                .rings
                .iter()
                .enumerate()
                .map(|(k, (ring, inverse))| self.gradient(&values, k, ring, inverse.as_ref()))
                .collect();
            for &[a, b] in &level.edges {
                let (a, b) = (a as usize, b as usize);
                let step = self.plane[b] - self.plane[a];
                let bend = (gradients[a][0] - gradients[b][0]) * step.x + (gradients[a][1] - gradients[b][1]) * step.y;
                values.push((values[a] + values[b]) / 2.0 + bend * (TENSION / 8.0));
            }
        }
        values
    }

    fn gradient(&self, values: &[Vector3<f64>], k: usize, ring: &[u32], inverse: Option<&Matrix2<f64>>) -> [Vector3<f64>; 2] {
        let Some(inverse) = inverse else { return [Vector3::zeros(); 2] };
        let (mut right_x, mut right_y) = (Vector3::zeros(), Vector3::zeros());
        for &n in ring {
            let step = self.plane[n as usize] - self.plane[k];
            let weighted = (values[n as usize] - values[k]) / step.norm_squared();
            right_x += weighted * step.x;
            right_y += weighted * step.y;
        }
        [right_x * inverse[(0, 0)] + right_y * inverse[(0, 1)], right_x * inverse[(1, 0)] + right_y * inverse[(1, 1)]]
    }
}

/// Computes one round: the finer triangles, and the data for the Hermite rule on the coarser ones.
fn split(plane: &[Point2<f64>], triangles: &[[u32; 3]]) -> (Level, Vec<[u32; 3]>) {
    let mut neighbours = vec![BTreeSet::new(); plane.len()];
    let mut middle_of: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    let mut edges = Vec::new();
    let mut middle = |a: u32, b: u32| {
        *middle_of.entry([a.min(b), a.max(b)]).or_insert_with(|| {
            edges.push([a.min(b), a.max(b)]);
            (plane.len() + edges.len()) as u32 - 1
        })
    };
    let mut finer = Vec::with_capacity(4 * triangles.len());
    for &[a, b, c] in triangles {
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        for (from, to) in [(a, b), (b, c), (c, a)] {
            neighbours[from as usize].insert(to);
            neighbours[to as usize].insert(from);
        }
    }
    let rings = neighbours
        .into_iter()
        .enumerate()
        .map(|(k, ring)| {
            // Twin vertices at the same position have no direction to each other.
            let ring: Vec<u32> = ring.into_iter().filter(|&n| (plane[n as usize] - plane[k]).norm_squared() > 1e-12).collect();
            let mut normal = Matrix2::zeros();
            for &n in &ring {
                let unit: Vector2<f64> = (plane[n as usize] - plane[k]).normalize();
                normal += unit * unit.transpose();
            }
            let inverse = if normal.determinant() > 1e-3 { normal.try_inverse() } else { None };
            (ring, inverse)
        })
        .collect();
    (Level { rings, edges }, finer)
}

/// Returns the outer border of the wireframe as a closed sequence of nodes.
fn outer_border(wireframe: &Wireframe) -> Vec<NodeId> {
    let mut uses: BTreeMap<(NodeId, NodeId), usize> = BTreeMap::new();
    for &[a, b, c] in wireframe.triangles() {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *uses.entry((from.min(to), from.max(to))).or_default() += 1;
        }
    }
    let mut next: BTreeMap<NodeId, Vec<NodeId>> = BTreeMap::new();
    for (&(a, b), _) in uses.iter().filter(|&(_, &count)| count == 1) {
        next.entry(a).or_default().push(b);
        next.entry(b).or_default().push(a);
    }
    // The walk starts at the chin, which lies on the outer border, so it never reaches the border of the mouth.
    let start = NodeId(10);
    let mut walk = vec![start];
    let mut previous = None;
    let mut here = start;
    while let Some(&onward) = next.get(&here).and_then(|ways| ways.iter().find(|&&n| Some(n) != previous)) {
        if onward == start || walk.len() > next.len() {
            break;
        }
        walk.push(onward);
        previous = Some(here);
        here = onward;
    }
    walk
}

/// Returns the point where a ray from the middle leaves the rectangle of the outer ring.
fn on_rectangle(direction: Vector2<f64>) -> Point2<f64> {
    let (half_width, bottom, top) = OUTER_RING;
    let along_x = half_width / direction.x.abs().max(1e-9);
    let along_y = if direction.y < 0.0 { (bottom - MIDDLE.y) / direction.y } else { (top - MIDDLE.y) / direction.y.max(1e-9) };
    MIDDLE + direction * along_x.min(along_y)
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    fn mesh() -> SkinMesh {
        let w = Wireframe::candide3();
        SkinMesh::new(&w, &w.frontal())
    }

    #[test]
    fn the_surface_has_every_skin_node_and_two_rings() {
        let mesh = mesh();
        let nodes = mesh.anchors().iter().filter(|a| matches!(a, Anchor::Node(_))).count();
        // 104 live nodes minus the 8 of the iris boxes.
        assert_eq!(nodes, 96);
        let border = outer_border(&Wireframe::candide3());
        assert_eq!(mesh.anchors().len(), 96 + 2 * border.len());
    }

    #[test]
    fn refinement_keeps_node_values_and_reproduces_linear_functions() {
        let mesh = mesh();
        let linear = |p: &Point2<f64>| Vector3::new(2.0 * p.x - p.y, 0.5 * p.y + 1.0, -p.x);
        let count = mesh.anchors().len();
        let coarse: Vec<Vector3<f64>> = mesh.plane()[..count].iter().map(linear).collect();
        let fine = mesh.refine(&coarse);
        assert_eq!(fine.len(), mesh.plane().len());
        assert_eq!(&fine[..count], &coarse[..]);
        for (value, point) in fine.iter().zip(mesh.plane()) {
            assert_relative_eq!(*value, linear(point), epsilon = 1e-9);
        }
    }
}
