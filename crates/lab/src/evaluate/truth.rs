//! Ground truth: exact node positions from a file, or landmarks in place of nodes.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use nalgebra::{Point2, Vector2};

use super::EvaluateError;
use grimace::internal::{
    dataset::{LANDMARK_COUNT, SequenceEntry},
    input::InputError,
    positions::{PositionRow, PositionTable},
    units::{NodeId, SequenceId},
    wireframe::{LandmarkConfidence, Tables},
};

/// First landmark that is not on the contour; landmarks 17 to 67 form the inner face.
pub const FIRST_INNER_LANDMARK: u8 = 17;

/// Landmarks around the right and the left eye; their mean approximates the pupil.
const EYES: [std::ops::Range<usize>; 2] = [36..42, 42..48];

/// A node at exactly one landmark, of high or medium confidence.
#[derive(Clone, Debug, PartialEq)]
pub struct ComparedNode {
    /// The node.
    pub node: NodeId,
    /// Its landmark.
    pub landmark: usize,
    /// Part of the face, from the table of landmarks.
    pub part: String,
    /// Whether the node belongs to the inner face.
    pub inner: bool,
}

/// Returns the nodes that can be compared with landmarks, in the order of the landmarks.
pub fn compared_nodes(tables: &Tables) -> Vec<ComparedNode> {
    let rows = tables.landmarks.iter().filter(|row| row.confidence >= LandmarkConfidence::Medium);
    rows.filter_map(|row| match row.nodes[..] {
        [(node, _)] => Some(ComparedNode {
            node,
            landmark: usize::from(row.landmark),
            part: row.part.clone(),
            inner: row.landmark >= FIRST_INNER_LANDMARK,
        }),
        _ => None,
    })
    .collect()
}

/// Returns the eye distance ES0 of a face with 68 landmarks, px: the distance between the mean landmarks of the two eyes. Returns `None`
/// when it is not positive, or when there are not 68 landmarks.
pub fn landmark_eye_distance(points: &[Point2<f64>]) -> Option<f64> {
    if points.len() != LANDMARK_COUNT {
        return None;
    }
    let [right, left] = EYES.map(|eye| {
        let count = eye.len() as f64;
        points[eye].iter().map(|p| p.coords).sum::<Vector2<f64>>() / count
    });
    Some((left - right).norm()).filter(|d| d.is_finite() && *d > 0.0)
}

/// Returns the group of a sequence: its value in a manifest column, `(none)` for an empty value, or `all` without a column.
///
/// # Errors
/// [`EvaluateError::NoColumn`] when the sequence has no such column.
pub fn group_of(entry: &SequenceEntry, by: Option<&str>) -> Result<String, EvaluateError> {
    let Some(column) = by else { return Ok("all".to_owned()) };
    match entry.column(column) {
        Some("") => Ok("(none)".to_owned()),
        Some(value) => Ok(value.to_owned()),
        None => {
            let fixed = ["subject", "sequence", "emotion"].map(str::to_owned);
            let found = fixed.into_iter().chain(entry.metadata.keys().cloned()).collect();
            Err(EvaluateError::NoColumn { id: entry.id.to_string(), column: column.to_owned(), found })
        }
    }
}

/// Why exact node positions cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    /// The file, a row or a number cannot be read.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A node that the wireframe does not have.
    #[error("{}, line {line}: node {node} does not exist; the wireframe has nodes 0 to {}", path.display(), count.saturating_sub(1))]
    NoSuchNode {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The node.
        node: u32,
        /// Nodes there are.
        count: usize,
    },
    /// The neutral frame is missing.
    #[error("{}: there are no positions for the neutral frame {frame}, where a track starts", path.display())]
    NoNeutral {
        /// The file.
        path: PathBuf,
        /// Frame number.
        frame: u32,
    },
    /// A node appears twice in a frame.
    #[error("{}, line {line}: node {node} of frame {frame} appears twice; keep one row", path.display())]
    Twice {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Frame number.
        frame: u32,
        /// The node.
        node: u32,
    },
    /// The file has no positions.
    #[error("{}: has no positions; a row frame,node,x,y for each node tracked by hand was expected", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
}

/// Returns the path of a sequence's exact positions: `truth/SUBJECT_SEQUENCE.csv` in the dataset's folder, as `grimace simulate` writes it.
pub fn truth_path(root: &Path, id: &SequenceId) -> PathBuf {
    root.join("truth").join(format!("{id}.csv"))
}

/// True positions by frame number and node, px; `None` for nodes that are not known.
pub type TruthFrames = BTreeMap<u32, Vec<Option<Point2<f64>>>>;

/// Reads true positions from a file with the columns `frame,node,x,y`, for any nodes of any frames.
///
/// # Errors
/// [`TruthError`] for a file that cannot be read, a node that does not exist or occurs twice in a frame, or a file without positions.
pub fn read_truth(path: &Path, node_count: usize) -> Result<TruthFrames, TruthError> {
    let mut frames = TruthFrames::new();
    for row in PositionTable::open(path)?.rows() {
        let PositionRow { frame, node, position, row } = row?;
        let number = u32::from(node.0);
        let nodes = frames.entry(frame).or_insert_with(|| vec![None; node_count]);
        let Some(known) = nodes.get_mut(node.index()) else {
            return Err(TruthError::NoSuchNode { path: path.to_owned(), line: row.line(), node: number, count: node_count });
        };
        if known.is_some() {
            return Err(TruthError::Twice { path: path.to_owned(), line: row.line(), frame, node: number });
        }
        *known = Some(position);
    }
    if frames.is_empty() {
        return Err(TruthError::Empty { path: path.to_owned() });
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_of_any_nodes_and_frames_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read_truth(&path, 2).map_err(|e| e.to_string().replace(&path.display().to_string(), "t.csv"))
        };
        let frames = read("frame,node,x,y\n7,1,3,4\n7,0,1,2\n").unwrap();
        assert_eq!(frames, TruthFrames::from([(7, vec![Some(Point2::new(1.0, 2.0)), Some(Point2::new(3.0, 4.0))])]));
        let partial = read("frame,node,x,y\n7,0,1,2\n").unwrap();
        assert_eq!(partial, TruthFrames::from([(7, vec![Some(Point2::new(1.0, 2.0)), None])]));
        assert!(
            read("frame,node,x,y\n7,0,1,2\n7,0,1,3\n").unwrap_err().starts_with("t.csv, line 3: node 0 of frame 7 appears twice")
        );
        assert!(read("frame,node,x,y\n").unwrap_err().contains("has no positions"));
        let error = read("frame,node,x,y\n7,2,1,2\n").unwrap_err();
        assert_eq!(error, "t.csv, line 2: node 2 does not exist; the wireframe has nodes 0 to 1");
        assert!(read("frame,node,x,y\n7,0,one,2\n").unwrap_err().contains("x is `one`"));
        assert!(read("frame,node,x\n").unwrap_err().contains("no column `y`"));
    }

    #[test]
    fn fifty_two_landmarks_stand_for_one_node() {
        // 68 landmarks, without 15 of low confidence and without the nasion (27), which lies between two nodes.
        let compared = compared_nodes(&Tables::candide3());
        assert_eq!(compared.len(), 52);
        // The 51 inner landmarks without the four between brow nodes (18, 20, 23, 25), and without 27, 29, 56 and 58.
        assert_eq!(compared.iter().filter(|c| c.inner).count(), 43);
        let nodes: std::collections::BTreeSet<_> = compared.iter().map(|c| c.node).collect();
        assert_eq!(nodes.len(), 52, "no node appears twice");
    }

    #[test]
    fn the_eye_distance_is_between_the_middles_of_the_eyes() {
        let mut points = vec![Point2::new(0.0, 0.0); LANDMARK_COUNT];
        for (k, point) in points[36..42].iter_mut().enumerate() {
            *point = Point2::new(10.0 + k as f64, 5.0); // mean 12.5
        }
        points[42..48].fill(Point2::new(15.5, 9.0));
        // The distance from (12.5, 5) to (15.5, 9) is 5.
        assert_eq!(landmark_eye_distance(&points), Some(5.0));
        assert_eq!(landmark_eye_distance(&points[..67]), None);
        assert_eq!(landmark_eye_distance(&[Point2::origin(); LANDMARK_COUNT]), None);
    }
}
