//! The mesh of the warp: a triangulation of the reference that keeps the edges of mouth and eyes and is finest where the face moves most.

use nalgebra::Point2;
use spade::{ConstrainedDelaunayTriangulation, Triangulation};

use super::{
    WarpError,
    followers::{self, Tied},
    layout::{self, Frame, OPENINGS, Opening, OpeningNodes},
};
use crate::{
    geometry::polygon::{distance_to_segment, inside},
    units::NodeId,
};

/// Longest step along the edge of an opening, in eye distances.
const EDGE_STEP: f64 = 0.03;
/// Spacing of vertices near the openings, on the rest of the face, and around it, in eye distances.
const SPACINGS: [f64; 3] = [0.036, 0.065, 0.13];
/// Distance from the edge of an opening within which the finest spacing applies, in eye distances.
const FINE_REACH: f64 = 0.14;
/// Distance from the face within which the middle spacing applies, in eye distances.
const FACE_REACH: f64 = 0.10;
/// Least distance between vertices, as a fraction of the local spacing.
const CLEARANCE: f64 = 0.62;
/// Two driving nodes nearer than this, in eye distances, share a vertex.
const SAME_PLACE: f64 = 0.008;
/// Width of the surroundings that follow the face, in eye distances: to the sides and above, and below the chin.
const MARGIN: (f64, f64) = (0.45, 0.75);
/// Fraction of the margin beyond which vertices are fixed, so that the motion ends without a crease.
const FIXED_FROM: f64 = 0.82;
/// Number of vertices in the outermost ring.
const RING: usize = 72;
/// Positions of the vertices on the eyeball, as fractions of the way from the upper to the lower lid margin.
pub const EYEBALL_SHARES: [f64; 2] = [0.22, 0.78];

/// An opening of the mesh.
#[derive(Clone, Debug)]
pub struct OpeningMesh {
    /// Which opening.
    pub opening: Opening,
    /// Vertices of the upper edge from corner to corner.
    pub upper: Vec<u32>,
    /// Vertices of the lower edge, equally many, with the same corners.
    pub lower: Vec<u32>,
    /// Vertices on the eyeball, each between the two vertices at one index along the edges: that index, the fraction of the way from
    /// the upper to the lower one, the vertex. Empty for the mouth.
    pub eyeball: Vec<(usize, f64, u32)>,
    /// Indices along the edges of the five nodes.
    pub stops: [usize; 5],
    /// Triangles inside: strips between pairs of vertices, so that a shut opening has none.
    pub triangles: Vec<[u32; 3]>,
}

/// The triangulated reference.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Vertices in the reference, px.
    pub vertices: Vec<Point2<f64>>,
    /// Triangles of the skin and the surroundings, all with the same winding in the reference.
    pub skin: Vec<[u32; 3]>,
    /// The openings, in the order of [`OPENINGS`].
    pub openings: Vec<OpeningMesh>,
    /// Driving nodes and their vertices.
    pub drivers: Vec<(NodeId, u32)>,
    /// Vertices that follow a weighted mean of driving nodes: the vertex, and indices in `drivers` with weights that sum to 1.
    pub tied: Vec<Tied>,
    /// Vertices that never move.
    pub fixed: Vec<u32>,
}

/// Vertices collected so far.
pub struct Gathered {
    points: Vec<Point2<f64>>,
    pub eye_distance: f64,
}

impl Gathered {
    pub fn add(&mut self, point: Point2<f64>) -> u32 {
        self.points.push(point);
        self.points.len() as u32 - 1
    }

    /// Whether a vertex at the finest spacing fits here.
    pub fn has_room(&self, point: &Point2<f64>) -> bool {
        self.all_beyond(point, CLEARANCE * SPACINGS[0] * self.eye_distance)
    }

    /// Whether all vertices are farther than `distance` from a point.
    fn all_beyond(&self, point: &Point2<f64>, distance: f64) -> bool {
        // Most cases are decided without a square root.
        let surely = distance * distance * (1.0 + 1e-9);
        let is_beyond = |square: f64| square > surely || square.sqrt() > distance;
        self.points.iter().all(|p| is_beyond(squared_apart(p, point)))
    }

    fn at(&self, point: &Point2<f64>, within: f64) -> Option<u32> {
        self.points.iter().position(|p| (p - point).norm() < within).map(|k| k as u32)
    }
}

/// Squared distance of two points, in coordinates: a mesh asks for a million, and unoptimized vectors take ten times as long.
fn squared_apart(a: &Point2<f64>, b: &Point2<f64>) -> f64 {
    let (x, y) = (a.x - b.x, a.y - b.y);
    x * x + y * y
}

impl Mesh {
    /// Creates the mesh over the reference nodes.
    pub fn new(reference: &[Point2<f64>], frame: &Frame) -> Result<Self, WarpError> {
        let unit = frame.eye_distance;
        let mut gathered = Gathered { points: Vec::new(), eye_distance: unit };
        let mut openings = Vec::new();
        let mut edges: Vec<[u32; 2]> = Vec::new();
        for nodes in &OPENINGS {
            let opening = edge_vertices(nodes, reference, &mut gathered);
            for edge in [&opening.upper, &opening.lower] {
                edges.extend(edge.windows(2).map(|w| [w[0], w[1]]));
            }
            openings.push(opening);
        }
        let mut drivers = Vec::new();
        for (k, point) in reference.iter().enumerate() {
            let node = NodeId(k as u16);
            if layout::drives(node) {
                let on_edge = |o: &OpeningNodes| o.upper.contains(&node.0) || o.lower.contains(&node.0);
                match gathered.at(point, SAME_PLACE * unit) {
                    Some(vertex) if OPENINGS.iter().any(on_edge) => drivers.push((node, vertex)),
                    Some(_) => {}
                    None => drivers.push((node, gathered.add(*point))),
                }
            }
        }
        drivers.dedup_by_key(|d| d.1);
        let mut tied = followers::lid_skin(reference, &drivers, &mut gathered);
        tied.extend(followers::brows(reference, &drivers, &mut gathered));
        for (nodes, opening) in OPENINGS.iter().zip(&openings) {
            for (list, edge) in [(nodes.upper, &opening.upper), (nodes.lower, &opening.lower)] {
                tied.extend(followers::edge(list, edge, opening, &gathered.points, &drivers));
            }
        }
        let hull = convex_hull(drivers.iter().map(|&(n, _)| reference[n.index()]).collect());
        let middle = Point2::from(hull.iter().map(|p| p.coords).sum::<nalgebra::Vector2<f64>>() / hull.len().max(1) as f64);
        let margin = |point: &Point2<f64>| {
            let direction = (point - middle).try_normalize(1e-9).unwrap_or_default();
            let below = direction.dot(&frame.down).max(0.0);
            (MARGIN.0 + (MARGIN.1 - MARGIN.0) * below * below) * unit
        };
        let mut fixed = ring(&mut gathered, &hull, &middle, &margin);
        let edge_points: Vec<Point2<f64>> = edges.iter().flatten().map(|&v| gathered.points[v as usize]).collect();
        fill(&mut gathered, &hull, &edge_points, &margin, &mut fixed);
        Ok(Mesh { tied, ..triangulate(gathered.points, &edges, openings, drivers, fixed)? })
    }
}

/// Adds the edges of an opening and the points on its eyeball as vertices.
fn edge_vertices(nodes: &OpeningNodes, reference: &[Point2<f64>], gathered: &mut Gathered) -> OpeningMesh {
    let unit = gathered.eye_distance;
    let place = |list: [u16; 5]| list.map(|n| reference[usize::from(n)]);
    let (upper, lower) = (place(nodes.upper), place(nodes.lower));
    // Equal numbers of samples above and below in each segment, so that they form pairs.
    let counts: Vec<usize> = (0..4)
        .map(|k| {
            let length = (upper[k + 1] - upper[k]).norm().max((lower[k + 1] - lower[k]).norm());
            (length / (EDGE_STEP * unit)).ceil().clamp(1.0, 64.0) as usize
        })
        .collect();
    let upper: Vec<u32> = layout::curve(&upper, &counts).into_iter().map(|p| gathered.add(p)).collect();
    let samples = layout::curve(&lower, &counts);
    let mut below: Vec<u32> = samples[1..samples.len() - 1].iter().map(|&p| gathered.add(p)).collect();
    below.insert(0, upper[0]);
    below.push(upper[upper.len() - 1]);
    let mut eyeball = Vec::new();
    if !nodes.iris.is_empty() {
        for k in 1..upper.len() - 1 {
            let (from, to) = (gathered.points[upper[k] as usize], gathered.points[below[k] as usize]);
            eyeball.extend(EYEBALL_SHARES.map(|share| (k, share, gathered.add(from + (to - from) * share))));
        }
    }
    let mut stops = [0; 5];
    for k in 0..4 {
        stops[k + 1] = stops[k] + counts[k];
    }
    let triangles = strips(&upper, &below, &eyeball);
    OpeningMesh { opening: nodes.opening, upper, lower: below, eyeball, stops, triangles }
}

/// Bands of triangles from the upper edge across the vertices between to the lower edge; they close at the corners.
fn strips(upper: &[u32], lower: &[u32], between: &[(usize, f64, u32)]) -> Vec<[u32; 3]> {
    let column = |k: usize| -> Vec<u32> {
        let inner = between.iter().filter(|b| b.0 == k).map(|b| b.2);
        let mut column: Vec<u32> = std::iter::once(upper[k]).chain(inner).chain([lower[k]]).collect();
        column.dedup();
        column
    };
    let mut triangles = Vec::new();
    for k in 0..upper.len() - 1 {
        let (left, right) = (column(k), column(k + 1));
        let bands = left.len().max(right.len()) - 1;
        // At a corner the column is a single vertex.
        let at = |column: &[u32], band: usize| column[band.min(column.len() - 1)];
        for band in 0..bands {
            let (a, b) = (at(&left, band), at(&left, band + 1));
            let (c, d) = (at(&right, band), at(&right, band + 1));
            triangles.extend([[a, b, c], [c, b, d]].into_iter().filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]));
        }
    }
    triangles
}

/// Adds the outermost ring of vertices.
fn ring(gathered: &mut Gathered, hull: &[Point2<f64>], middle: &Point2<f64>, margin: &impl Fn(&Point2<f64>) -> f64) -> Vec<u32> {
    (0..RING)
        .map(|k| {
            let angle = std::f64::consts::TAU * k as f64 / RING as f64;
            let direction = nalgebra::Vector2::new(angle.cos(), angle.sin());
            // Bisection on the ray: the distance to a convex hull grows along it.
            let (mut near, mut far) = (0.0, 40.0 * gathered.eye_distance);
            for _ in 0..48 {
                let half = f64::midpoint(near, far);
                let point = middle + direction * half;
                if distance_to_hull(hull, &point) < margin(&point) { near = half } else { far = half }
            }
            gathered.add(middle + direction * near)
        })
        .collect()
}

/// Fills the plane with vertices, fine near the openings, coarse around the face.
fn fill(
    gathered: &mut Gathered,
    hull: &[Point2<f64>],
    edges: &[Point2<f64>],
    margin: &impl Fn(&Point2<f64>) -> f64,
    fixed: &mut Vec<u32>,
) {
    let unit = gathered.eye_distance;
    let (mut low, mut high) = (Point2::new(f64::INFINITY, f64::INFINITY), Point2::new(f64::NEG_INFINITY, f64::NEG_INFINITY));
    for point in &gathered.points {
        low = low.inf(point);
        high = high.sup(point);
    }
    for (level, spacing) in SPACINGS.iter().map(|s| s * unit).enumerate() {
        let rows = ((high.y - low.y) / (spacing * 0.866)).ceil() as usize;
        let columns = ((high.x - low.x) / spacing).ceil() as usize + 1;
        for row in 0..=rows {
            for column in 0..=columns {
                let shift = if row % 2 == 0 { 0.0 } else { 0.5 };
                let point = Point2::new(low.x + (column as f64 + shift) * spacing, low.y + row as f64 * spacing * 0.866);
                let outside = distance_to_hull(hull, &point);
                let limit = margin(&point);
                if outside >= limit {
                    continue;
                }
                let near_opening = edges.iter().any(|e| squared_apart(e, &point) < (FINE_REACH * unit).powi(2));
                let wanted = if near_opening { 0 } else { usize::from(outside > FACE_REACH * unit) + 1 };
                if wanted == level && gathered.all_beyond(&point, CLEARANCE * spacing) {
                    let vertex = gathered.add(point);
                    if outside > FIXED_FROM * limit {
                        fixed.push(vertex);
                    }
                }
            }
        }
    }
}

fn triangulate(
    vertices: Vec<Point2<f64>>,
    edges: &[[u32; 2]],
    openings: Vec<OpeningMesh>,
    drivers: Vec<(NodeId, u32)>,
    fixed: Vec<u32>,
) -> Result<Mesh, WarpError> {
    let mut triangulation: ConstrainedDelaunayTriangulation<spade::Point2<f64>> = ConstrainedDelaunayTriangulation::new();
    let mut handles = Vec::with_capacity(vertices.len());
    let mut vertex_of = Vec::with_capacity(vertices.len());
    for (k, point) in vertices.iter().enumerate() {
        let handle = triangulation.insert(spade::Point2::new(point.x, point.y)).map_err(|_| WarpError::NotFinite)?;
        if handle.index() == vertex_of.len() {
            vertex_of.push(k as u32);
        }
        handles.push(handle);
    }
    for &[a, b] in edges {
        let (from, to) = (handles[a as usize], handles[b as usize]);
        if from == to || !triangulation.can_add_constraint(from, to) {
            return Err(WarpError::Folded);
        }
        triangulation.add_constraint(from, to);
    }
    let outlines: Vec<Vec<Point2<f64>>> = openings
        .iter()
        .map(|o| o.upper.iter().chain(o.lower[1..o.lower.len() - 1].iter().rev()).map(|&v| vertices[v as usize]).collect())
        .collect();
    let mut skin = Vec::new();
    for face in triangulation.inner_faces() {
        let corners = face.vertices().map(|v| vertex_of[v.fix().index()]);
        let [a, b, c] = corners.map(|v| vertices[v as usize].coords);
        let centre = Point2::from((a + b + c) / 3.0);
        if !outlines.iter().any(|outline| inside(outline, &centre)) {
            skin.push(corners);
        }
    }
    Ok(Mesh { vertices, skin, openings, drivers, tied: Vec::new(), fixed })
}

/// Convex hull, with all corners turning the same way (Andrew's monotone chain).
pub fn convex_hull(mut points: Vec<Point2<f64>>) -> Vec<Point2<f64>> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let turn = |o: &Point2<f64>, a: &Point2<f64>, b: &Point2<f64>| (a - o).perp(&(b - o));
    let chain = |points: &mut dyn Iterator<Item = Point2<f64>>| {
        let mut chain: Vec<Point2<f64>> = Vec::new();
        for point in points {
            while chain.len() >= 2 && turn(&chain[chain.len() - 2], &chain[chain.len() - 1], &point) <= 0.0 {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    hull
}

/// Distance of a point to a convex hull, 0 inside.
fn distance_to_hull(hull: &[Point2<f64>], point: &Point2<f64>) -> f64 {
    let mut is_inside = true;
    let mut nearest = f64::INFINITY;
    for (k, a) in hull.iter().enumerate() {
        let b = &hull[(k + 1) % hull.len()];
        let (edge, to) = (b - a, point - a);
        is_inside &= edge.perp(&to) >= 0.0;
        nearest = nearest.min(distance_to_segment(a, b, point));
    }
    if is_inside { 0.0 } else { nearest }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> Vec<Point2<f64>> {
        [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (1.0, 1.0)].map(|(x, y)| Point2::new(x, y)).to_vec()
    }

    #[test]
    fn the_hull_of_a_square_leaves_its_middle_out() {
        let hull = convex_hull(square());
        assert_eq!(hull.len(), 4);
        assert_eq!(distance_to_hull(&hull, &Point2::new(1.0, 1.5)), 0.0);
        // (5, 6) is 3 right of and 4 below the corner (2, 2).
        assert_eq!(distance_to_hull(&hull, &Point2::new(5.0, 6.0)), 5.0);
        assert!(inside(&hull, &Point2::new(0.5, 0.5)) && !inside(&hull, &Point2::new(2.5, 0.5)));
    }
}
