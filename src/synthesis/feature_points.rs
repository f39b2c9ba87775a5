//! Assigns feature points to vertices: from a CSV file, or by 68 landmarks.

use std::path::Path;

use nalgebra::Vector3;

use super::{BankError, FeaturePointVertex};
use crate::{
    geometry::SplineWarp,
    input::CsvFile,
    mesh::TriangleMesh,
    output::{OutputError, write_csv},
    units::FeaturePoint,
    wireframe::{LandmarkConfidence, LandmarkRow, Tables, Wireframe},
};

/// The 56 feature points, as group and point numbers.
///
/// \[ZL\] use 56 of MPEG-4's 84 and list them only in a figure. They leave out tongue, teeth, ears, hair and head, and some
/// points "too close to each other (e.g. some points in the eye area)". Without tongue (4), teeth (4), ears (10), hair (6) and
/// the centre of the head (1), 59 remain. This list also leaves out the pupils (3.5, 3.6), which are not skin, and the middle of
/// the nose bone (9.12, between 9.13 and 9.14).
const FEATURE_POINTS: [(u8, &[u8]); 6] = [
    (2, &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14]),
    (3, &[1, 2, 3, 4, 7, 8, 9, 10, 11, 12, 13, 14]),
    (4, &[1, 2, 3, 4, 5, 6]),
    (5, &[1, 2, 3, 4]),
    (8, &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]),
    (9, &[1, 2, 3, 4, 5, 6, 7, 13, 14, 15]),
];

/// Returns the 56 feature points that the skin of a face can have, in the order of the standard.
pub fn skin_feature_points() -> impl Iterator<Item = FeaturePoint> {
    FEATURE_POINTS.iter().flat_map(|&(group, points)| points.iter().map(move |&point| FeaturePoint { group, point }))
}

/// Reads a CSV file with the columns `fp` and `vertex` (from 0).
///
/// # Errors
/// [`BankError::Input`] for a file or row that cannot be read; [`BankError::NoSuchVertex`] for a vertex that the mesh does not
/// have.
pub fn read_feature_points(path: &Path, vertex_count: usize) -> Result<Vec<FeaturePointVertex>, BankError> {
    let file = CsvFile::open(path)?;
    let [fp, vertex] = file.require(["fp", "vertex"])?;
    let mut points = Vec::new();
    for row in file.rows() {
        let row = row?;
        let point: FeaturePoint = row.get(fp).parse().map_err(|_| row.field_error(fp, "an MPEG-4 feature point such as 8.3"))?;
        let number = row.whole_number(vertex)?;
        if number as usize >= vertex_count {
            return Err(BankError::NoSuchVertex { fp: point, vertex: u64::from(number), count: vertex_count });
        }
        points.push(FeaturePointVertex { fp: point, vertex: number });
    }
    Ok(points)
}

/// Reads a CSV file with the columns `landmark` (0 to 67) and `vertex`, and returns the vertices of the 68 landmarks.
///
/// # Errors
/// [`BankError`] for a file or row that cannot be read, or unless every landmark is given exactly once.
pub fn read_landmark_vertices(path: &Path) -> Result<Vec<u32>, BankError> {
    let file = CsvFile::open(path)?;
    let [landmark, vertex] = file.require(["landmark", "vertex"])?;
    let mut vertices = vec![None; LANDMARKS];
    for row in file.rows() {
        let row = row?;
        let place = row.whole_number(landmark)? as usize;
        let slot = vertices.get_mut(place).ok_or_else(|| row.field_error(landmark, "a landmark of 0 to 67"))?;
        *slot = Some(row.whole_number(vertex)?);
    }
    let found = vertices.iter().flatten().count();
    let all: Option<Vec<u32>> = vertices.into_iter().collect();
    all.ok_or_else(|| BankError::Source {
        path: path.to_owned(),
        reason: format!("found {found} landmarks; all of 0 to 67 were expected"),
    })
}

/// Writes the CSV file `fp,vertex`.
///
/// # Errors
/// [`OutputError`].
pub fn write_feature_points(path: &Path, points: &[FeaturePointVertex]) -> Result<(), OutputError> {
    #[derive(serde::Serialize)]
    struct Row {
        fp: String,
        vertex: u32,
    }
    write_csv(path, points.iter().map(|p| Row { fp: p.fp.to_string(), vertex: p.vertex }))
}

/// Number of landmarks of the iBUG 300-W scheme.
const LANDMARKS: usize = 68;
/// Largest distance of a warped node from the nearest vertex, as a fraction of the width of the face; beyond it, the node is not
/// on the surface.
const OFF_SURFACE: f64 = 0.08;
/// Weight of depth in the search for the nearest vertex: depth is the coarsest of Candide-3's coordinates.
const DEPTH_WEIGHT: f64 = 0.5;

/// Places the 56 feature points on a mesh by the vertices of its 68 landmarks, in the order of the standard.
///
/// A feature point whose Candide-3 node corresponds to a single landmark takes the vertex of that landmark. For the others, the
/// neutral Candide-3 is warped onto the mesh (the biharmonic spline `|r|` with an affine part, exact at the landmarks of medium
/// and high confidence), and the feature point takes the vertex nearest to the warped node. Points that the surface does not
/// have, and points whose vertex is already taken, are left out.
///
/// # Errors
/// [`BankError::Number`] for another number of landmarks, [`BankError::NoSuchVertex`] for vertices that the mesh does not have,
/// and [`BankError::Source`] when the landmarks do not determine a warp.
pub fn place_feature_points(mesh: &TriangleMesh, landmarks: &[u32]) -> Result<Vec<FeaturePointVertex>, BankError> {
    if landmarks.len() != LANDMARKS {
        let (found, expected) = (landmarks.len().to_string(), LANDMARKS.to_string());
        return Err(BankError::Number { what: "the number of landmarks", found, expected });
    }
    let count = mesh.vertex_count();
    if let Some(&vertex) = landmarks.iter().find(|&&v| v as usize >= count) {
        let expected = format!("a vertex of 0 to {}", count - 1);
        return Err(BankError::Number { what: "a landmark's vertex", found: vertex.to_string(), expected });
    }
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let trusted: Vec<&LandmarkRow> = trusted_landmarks(&tables).collect();
    let (source, target) = landmark_pairs(mesh.positions(), landmarks, &wireframe, &tables);
    let warp = SplineWarp::new(&source, &target).ok_or_else(no_warp)?;
    let [low, high] = mesh.bounds().map(|p| p.map(f64::from));
    let reach = OFF_SURFACE * (high[0] - low[0]);
    let mut points: Vec<FeaturePointVertex> = Vec::new();
    for fp in skin_feature_points() {
        let Some(nodes) = tables.feature_point_nodes(fp) else { continue };
        let landmark = trusted.iter().find(|r| matches!(&r.nodes[..], [(node, _)] if *node == nodes[0]));
        let vertex = match landmark {
            Some(row) => Some(landmarks[usize::from(row.landmark)]),
            None => nearest(mesh, &warp.apply(&wireframe.vertices()[nodes[0].index()]), reach),
        };
        if let Some(vertex) = vertex
            && points.iter().all(|p| p.vertex != vertex)
        {
            points.push(FeaturePointVertex { fp, vertex });
        }
    }
    Ok(points)
}

fn trusted_landmarks(tables: &Tables) -> impl Iterator<Item = &LandmarkRow> {
    tables.landmarks.iter().filter(|r| r.confidence != LandmarkConfidence::Low)
}

/// Positions of the landmarks of medium and high confidence on Candide-3 and on a mesh.
pub fn landmark_pairs(
    positions: &[[f32; 3]],
    landmarks: &[u32],
    wireframe: &Wireframe,
    tables: &Tables,
) -> (Vec<Vector3<f64>>, Vec<Vector3<f64>>) {
    let (mut nodes, mut places): (Vec<Vector3<f64>>, Vec<Vector3<f64>>) = (Vec::new(), Vec::new());
    for row in trusted_landmarks(tables) {
        let node = row.nodes.iter().map(|&(n, w)| wireframe.vertices()[n.index()].coords * w).sum();
        // Candide-3's inner lips coincide in neutral: one of the two landmarks is enough.
        if !nodes.contains(&node) {
            nodes.push(node);
            places.push(Vector3::from(positions[landmarks[usize::from(row.landmark)] as usize].map(f64::from)));
        }
    }
    (nodes, places)
}

/// The error for landmarks between which there is no smooth map.
pub fn no_warp() -> BankError {
    BankError::Number { what: "the landmarks' place", found: "on a line or a point".to_owned(), expected: "a face".to_owned() }
}

fn nearest(mesh: &TriangleMesh, place: &Vector3<f64>, reach: f64) -> Option<u32> {
    let distance = |p: &[f32; 3]| {
        let d = Vector3::from(p.map(f64::from)) - place;
        (d.x * d.x + d.y * d.y + DEPTH_WEIGHT * DEPTH_WEIGHT * d.z * d.z).sqrt()
    };
    let all = mesh.positions().iter().map(distance).enumerate();
    let (vertex, found) = all.min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)))?;
    (found <= reach).then_some(vertex as u32)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::units::NodeId;

    #[test]
    fn there_are_56_and_candide_has_a_node_for_each() {
        let tables = Tables::candide3();
        let points: Vec<FeaturePoint> = skin_feature_points().collect();
        assert_eq!(points.len(), 56);
        assert!(points.iter().all(|&fp| tables.feature_point_nodes(fp).is_some_and(|n| n.len() == 1)));
    }

    #[test]
    fn candide_itself_gets_its_own_nodes_back() {
        // Landmarks of Candide's own mesh: single nodes unchanged, interpolated ones by their first node.
        let (w, tables) = (Wireframe::candide3(), Tables::candide3());
        let positions = w.vertices().iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
        let triangles = w.triangles().iter().map(|t| t.map(|n| u32::from(n.0))).collect();
        let mesh = TriangleMesh::new(positions, triangles).unwrap();
        let landmarks: Vec<u32> = tables.landmarks.iter().map(|r| u32::from(r.nodes[0].0.0)).collect();
        let points = place_feature_points(&mesh, &landmarks).unwrap();
        let mut right = 0;
        for point in &points {
            let nodes = tables.feature_point_nodes(point.fp).unwrap();
            let same = w.vertices()[point.vertex as usize] == w.vertices()[nodes[0].index()];
            right += usize::from(same || nodes == [NodeId(point.vertex as u16)]);
        }
        assert!(right >= 50 && points.len() >= 52, "{right} of {}", points.len());
    }

    #[test]
    fn bad_files_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("fp.csv");
        let says = |text: &str, part: &str| {
            fs::write(&path, text).unwrap();
            let error = read_feature_points(&path, 10).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        };
        says("fp,vertex\n8.3,9\n8.x,1\n", "line 3: fp is `8.x`");
        says("fp,vertex\n8.3,10\n", "feature point 8.3 is at vertex 10, but the mesh has 10 vertices (0 to 9)");
        says("fp,vertex\n8.3,-1\n", "vertex is `-1`");
        says("fp\n8.3\n", "no column `vertex`");
    }
}
