//! Neutral faces as landmarks or as nodes, from a CSV file or a dataset.

use std::{
    collections::{BTreeMap, BTreeSet, btree_map::Entry},
    path::{Path, PathBuf},
};

use nalgebra::Point2;

use crate::{
    dataset::{Dataset, DatasetError, LANDMARK_COUNT, SequenceEntry},
    input::{CsvFile, InputError},
    units::NodeId,
};

/// What is known of one neutral face.
#[derive(Clone, Debug, PartialEq)]
pub struct NeutralFace {
    /// Who, for messages.
    pub name: String,
    /// Where its features are.
    pub points: FacePoints,
}

/// Points of a face, px, y down.
#[derive(Clone, Debug, PartialEq)]
pub enum FacePoints {
    /// 68 landmarks (iBUG order).
    Landmarks(Vec<Point2<f64>>),
    /// Some of the wireframe's nodes, each once.
    Nodes(Vec<(NodeId, Point2<f64>)>),
}

/// The faces of one file or dataset.
#[derive(Clone, Debug, PartialEq)]
pub struct NeutralFaces {
    /// In the order of the file, or of the subjects.
    pub faces: Vec<NeutralFace>,
    /// Subjects of a dataset without a usable neutral frame, with the reason.
    pub skipped: Vec<(String, String)>,
    /// BLAKE3 of what was read, in hexadecimal.
    pub blake3: String,
}

/// Landmarks of faces that do not read.
#[derive(Debug, thiserror::Error)]
pub enum FacesError {
    /// The CSV file.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The dataset.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// Another number of points.
    #[error("{}: {found} points in columns x0,y0,...; {LANDMARK_COUNT} were expected", path.display())]
    Count {
        /// The file.
        path: PathBuf,
        /// Points found.
        found: usize,
    },
    /// No column that says whose landmarks they are.
    #[error("{}: no column `person`, `subject` or `frame` says whose face a row is", path.display())]
    NoName {
        /// The file.
        path: PathBuf,
    },
    /// A face twice.
    #[error("{}, line {line}: {name} stands in line {first_line} already; a face counts once", path.display())]
    Duplicate {
        /// The file.
        path: PathBuf,
        /// Line of the second row.
        line: usize,
        /// Whose face.
        name: String,
        /// Line of the first.
        first_line: usize,
    },
    /// A node twice in one face.
    #[error("{}, line {line}: node {node} of {name} stands in line {first_line} already", path.display())]
    NodeTwice {
        /// The file.
        path: PathBuf,
        /// Line of the second row.
        line: usize,
        /// Whose face.
        name: String,
        /// The node.
        node: NodeId,
        /// Line of the first.
        first_line: usize,
    },
    /// No row in the wanted state.
    #[error("{}: no row has the state `{state}`; there are {}", path.display(), list(found))]
    NoSuchState {
        /// The file.
        path: PathBuf,
        /// The state asked for.
        state: String,
        /// States there are.
        found: BTreeSet<String>,
    },
}

fn list(states: &BTreeSet<String>) -> String {
    if states.is_empty() { "no rows".to_owned() } else { states.iter().cloned().collect::<Vec<_>>().join(", ") }
}

/// Reads neutral faces.
///
/// - A CSV file with the columns `x0,y0,...,x67,y67` and one of `person`, `subject` and `frame` to name the face; every row is one
///   face. With a column `state`, only the rows of the state `state`.
/// - A CSV file with the columns `node,x,y`, one of `person`, `subject` and `image`, and perhaps `face`, as `grimace locate` writes it:
///   every row is one node of a face.
/// - A dataset (a folder, or its `manifest.csv`) with landmarks: the neutral frame of each subject's first sequence that has one.
///
/// # Errors
/// `FacesError`. In a dataset a subject without landmarks is no error but skipped.
pub fn read_neutral_faces(path: &Path, state: &str) -> Result<NeutralFaces, FacesError> {
    if path.is_dir() {
        return read_dataset(path);
    }
    let csv = CsvFile::open(path)?;
    let is_manifest = ["subject", "sequence", "emotion"].iter().all(|name| csv.column(name).is_some());
    if is_manifest {
        read_dataset(path)
    } else if csv.column("node").is_some() {
        read_nodes(&csv)
    } else {
        read_csv(&csv, state)
    }
}

fn read_csv(csv: &CsvFile, state: &str) -> Result<NeutralFaces, FacesError> {
    let place: BTreeMap<&str, usize> = csv.header().iter().enumerate().map(|(k, name)| (name.as_str(), k)).collect();
    let pair = |k: usize| Some((*place.get(format!("x{k}").as_str())?, *place.get(format!("y{k}").as_str())?));
    let columns: Vec<(usize, usize)> = (0..csv.header().len()).map_while(pair).collect();
    if columns.len() != LANDMARK_COUNT {
        return Err(FacesError::Count { path: csv.path().to_owned(), found: columns.len() });
    }
    let name_column = ["person", "subject", "frame"].iter().find_map(|name| csv.column(name));
    let name_column = name_column.ok_or_else(|| FacesError::NoName { path: csv.path().to_owned() })?;
    let state_column = csv.column("state");
    let mut faces = Vec::new();
    let mut states = BTreeSet::new();
    let mut lines: BTreeMap<String, usize> = BTreeMap::new();
    for row in csv.rows() {
        let row = row?;
        if let Some(found) = state_column.map(|k| row.get(k)) {
            states.insert(found.to_owned());
            if found != state {
                continue;
            }
        }
        let name = row.get(name_column).to_owned();
        if let Some(&first_line) = lines.get(&name) {
            return Err(FacesError::Duplicate { path: csv.path().to_owned(), line: row.line(), name, first_line });
        }
        lines.insert(name.clone(), row.line());
        let mut landmarks = Vec::with_capacity(LANDMARK_COUNT);
        for &(x, y) in &columns {
            landmarks.push(Point2::new(row.number(x)?, row.number(y)?));
        }
        faces.push(NeutralFace { name, points: FacePoints::Landmarks(landmarks) });
    }
    if faces.is_empty() && state_column.is_some() {
        return Err(FacesError::NoSuchState { path: csv.path().to_owned(), state: state.to_owned(), found: states });
    }
    Ok(with_hash(faces, Vec::new()))
}

fn read_nodes(csv: &CsvFile) -> Result<NeutralFaces, FacesError> {
    let [node_column, x, y] = csv.require(["node", "x", "y"])?;
    let name_column = ["person", "subject", "image"].iter().find_map(|name| csv.column(name));
    let name_column = name_column.ok_or_else(|| FacesError::NoName { path: csv.path().to_owned() })?;
    let face_column = csv.column("face");
    let mut order = Vec::new();
    let mut points: BTreeMap<String, Vec<(NodeId, Point2<f64>)>> = BTreeMap::new();
    let mut lines: BTreeMap<(String, NodeId), usize> = BTreeMap::new();
    for row in csv.rows() {
        let row = row?;
        let number = row.whole_number(node_column)?;
        let node = NodeId(u16::try_from(number).map_err(|_| row.field_error(node_column, "the number of a node"))?);
        let whose = row.get(name_column);
        let name = face_column.map_or_else(|| whose.to_owned(), |k| format!("{whose}, face {}", row.get(k)));
        match lines.entry((name.clone(), node)) {
            Entry::Occupied(first) => {
                let (path, first_line) = (csv.path().to_owned(), *first.get());
                return Err(FacesError::NodeTwice { path, line: row.line(), name, node, first_line });
            }
            Entry::Vacant(free) => drop(free.insert(row.line())),
        }
        let of_face = points.entry(name.clone()).or_insert_with(|| {
            order.push(name);
            Vec::new()
        });
        of_face.push((node, Point2::new(row.number(x)?, row.number(y)?)));
    }
    let face = |name: String| points.remove(&name).map(|nodes| NeutralFace { name, points: FacePoints::Nodes(nodes) });
    Ok(with_hash(order.into_iter().filter_map(face).collect(), Vec::new()))
}

fn read_dataset(path: &Path) -> Result<NeutralFaces, FacesError> {
    let dataset = Dataset::open(path)?;
    let mut subjects: BTreeMap<&str, Result<NeutralFace, String>> = BTreeMap::new();
    for failure in &dataset.failures {
        subjects.entry(&failure.subject).or_insert_with(|| Err(failure.error.to_string()));
    }
    for entry in &dataset.sequences {
        let found = subjects.entry(&entry.id.subject).or_insert_with(|| Err(String::new()));
        if found.is_err() {
            *found = neutral_face(entry);
        }
    }
    let (mut faces, mut skipped) = (Vec::new(), Vec::new());
    for (subject, found) in subjects {
        match found {
            Ok(face) => faces.push(face),
            Err(reason) => skipped.push((subject.to_owned(), reason)),
        }
    }
    Ok(with_hash(faces, skipped))
}

fn neutral_face(entry: &SequenceEntry) -> Result<NeutralFace, String> {
    let track = entry.landmarks().map_err(|e| e.to_string())?.ok_or("the manifest names no landmarks")?;
    let frames = entry.frames().map_err(|e| e.to_string())?;
    let landmarks = track.frame(frames.neutral_number()).map_err(|e| e.to_string())?.to_vec();
    Ok(NeutralFace { name: entry.id.subject.clone(), points: FacePoints::Landmarks(landmarks) })
}

/// Faces with the hash of their names and numbers: the same faces have the same hash, wherever they were read from.
fn with_hash(faces: Vec<NeutralFace>, skipped: Vec<(String, String)>) -> NeutralFaces {
    let mut hasher = blake3::Hasher::new();
    for face in &faces {
        hasher.update(&(face.name.len() as u64).to_le_bytes());
        hasher.update(face.name.as_bytes());
        let mut add = |p: &Point2<f64>| {
            hasher.update(&p.x.to_le_bytes());
            hasher.update(&p.y.to_le_bytes());
        };
        match &face.points {
            FacePoints::Landmarks(landmarks) => landmarks.iter().for_each(add),
            FacePoints::Nodes(nodes) => nodes.iter().for_each(|(node, p)| {
                add(&Point2::new(f64::from(node.0), f64::NAN));
                add(p);
            }),
        }
    }
    NeutralFaces { faces, skipped, blake3: hasher.finalize().to_hex().to_string() }
}

#[cfg(test)]
#[allow(clippy::format_collect)]
mod tests {
    use super::*;

    fn read(header: &str, rows: &[&str], points: usize) -> Result<NeutralFaces, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("faces.csv");
        let columns: String = (0..points).map(|k| format!(",x{k},y{k}")).collect();
        let values: String = (0..points).map(|k| format!(",{k},{}", 2 * k)).collect();
        let body: String = rows.iter().map(|row| format!("{row}{values}\n")).collect();
        std::fs::write(&path, format!("{header}{columns}\n{body}")).unwrap();
        read_neutral_faces(&path, "neutral").map_err(|e| e.to_string())
    }

    #[test]
    fn rows_of_the_wanted_state_are_faces() {
        let read_faces = read("person,state", &["A,neutral", "A,smiling", "B,neutral"], 68).unwrap();
        assert_eq!(read_faces.faces.iter().map(|f| f.name.as_str()).collect::<Vec<_>>(), ["A", "B"]);
        let FacePoints::Landmarks(landmarks) = &read_faces.faces[1].points else { panic!("no landmarks") };
        assert_eq!(landmarks[67], Point2::new(67.0, 134.0));
        assert_eq!(read("frame", &["1", "2"], 68).unwrap().faces.len(), 2);
    }

    #[test]
    fn rows_of_one_face_are_its_nodes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.csv");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read_neutral_faces(&path, "neutral").map_err(|e| e.to_string())
        };
        let found = read("image,face,node,x,y,expected_error\nb.png,1,20,5,6,1\nb.png,2,20,7,8,1\nb.png,1,53,1,2,1\n").unwrap();
        assert_eq!(found.faces.iter().map(|f| f.name.as_str()).collect::<Vec<_>>(), ["b.png, face 1", "b.png, face 2"]);
        let nodes = [(NodeId(20), Point2::new(5.0, 6.0)), (NodeId(53), Point2::new(1.0, 2.0))];
        assert_eq!(found.faces[0].points, FacePoints::Nodes(nodes.to_vec()));
        let twice = read("person,node,x,y\nA,20,5,6\nA,20,7,8\n").unwrap_err();
        assert!(twice.ends_with("line 3: node 20 of A stands in line 2 already"), "{twice}");
        assert!(read("who,node,x,y\nA,20,5,6\n").unwrap_err().contains("no column `person`, `subject` or"));
        assert!(read("person,node,x,y\nA,70000,5,6\n").unwrap_err().contains("70000"));
    }

    #[test]
    fn bad_files_are_named() {
        assert!(read("person", &["A"], 67).unwrap_err().ends_with("67 points in columns x0,y0,...; 68 were expected"));
        assert!(read("name", &["A"], 68).unwrap_err().contains("no column `person`, `subject` or `frame`"));
        assert!(read("person", &["A", "A"], 68).unwrap_err().contains("line 3: A stands in line 2 already"));
        let error = read("person,state", &["A,smiling", "B,sad"], 68).unwrap_err();
        assert!(error.ends_with("no row has the state `neutral`; there are sad, smiling"), "{error}");
    }
}
