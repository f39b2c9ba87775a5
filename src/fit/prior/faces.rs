//! Reads neutral faces, as landmarks or as nodes, from a CSV file or a dataset.

use std::{
    collections::{BTreeMap, BTreeSet, btree_map::Entry},
    path::{Path, PathBuf},
};

use nalgebra::Point2;

use crate::{
    dataset::{Dataset, DatasetError, LANDMARK_COUNT, LEAST_CONFIDENCE, SequenceEntry, name_key, read_face},
    input::{CsvFile, InputError},
    units::NodeId,
};

/// Columns that identify the kind of a table, and whether semicolons or commas separate it.
const KNOWN_COLUMNS: [&str; 12] =
    ["person", "subject", "frame", "image", "state", "node", "x", "y", "x0", "y0", "sequence", "emotion"];

/// Points of one neutral face.
#[derive(Clone, Debug, PartialEq)]
pub struct NeutralFace {
    /// Name for messages.
    pub name: String,
    /// Points of the face.
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

/// Faces of one file or dataset.
#[derive(Clone, Debug, PartialEq)]
pub struct NeutralFaces {
    /// Faces in the order of the file, or of the subjects.
    pub faces: Vec<NeutralFace>,
    /// Subjects of a dataset without a usable neutral frame, with the reason.
    pub skipped: Vec<(String, String)>,
    /// BLAKE3 of the faces' names and points, in hexadecimal.
    pub blake3: String,
    /// Whether names identify persons, not frames or pictures. Then one name is one person in all inputs.
    pub of_persons: bool,
}

/// Checks that no face occurs in two of several named inputs: no person of the same name, or, where names do not identify persons, no face
/// with identical points.
///
/// # Errors
/// [`FacesError::InTwoInputs`] or [`FacesError::SameFace`] with the first such face.
pub fn check_faces_once(inputs: &[(String, &NeutralFaces)]) -> Result<(), FacesError> {
    let mut persons: BTreeMap<String, &str> = BTreeMap::new();
    let mut hashes: BTreeMap<[u8; 32], (&str, &str)> = BTreeMap::new();
    for (input, read) in inputs {
        let key = |face: &NeutralFace| name_key(&face.name);
        let points = |face: &NeutralFace| hash_of_points(&face.points);
        for face in &read.faces {
            let (name, second) = (face.name.clone(), input.clone());
            if let Some(&first) = persons.get(&key(face)).filter(|_| read.of_persons) {
                return Err(FacesError::InTwoInputs { name, first: first.to_owned(), second });
            }
            if let Some(&(other, first)) = hashes.get(&points(face)) {
                return Err(FacesError::SameFace { name, second, other: other.to_owned(), first: first.to_owned() });
            }
        }
        // Added after the check: duplicates within one input were handled when it was read.
        for face in &read.faces {
            if read.of_persons {
                persons.insert(key(face), input);
            }
            hashes.insert(points(face), (&face.name, input));
        }
    }
    Ok(())
}

/// Landmarks of faces that do not read.
#[derive(Debug, thiserror::Error)]
pub enum FacesError {
    /// The CSV file cannot be read.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The dataset cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The number of points is wrong.
    #[error("{}: {found} points in columns x0,y0,...; {LANDMARK_COUNT} were expected", path.display())]
    Count {
        /// The file.
        path: PathBuf,
        /// Points found.
        found: usize,
    },
    /// No column identifies the faces.
    #[error("{}: there is no column `person`, `subject` or `frame` to name the person of a row", path.display())]
    NoName {
        /// The file.
        path: PathBuf,
    },
    /// A face appears twice.
    #[error("{}, line {line}: {name} is already in line {first_line}; give one face per person", path.display())]
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
    /// A face in two inputs.
    #[error(
        "{name} is in {first} and in {second}; each face must appear once: remove it from one file, or rename one of two different people"
    )]
    InTwoInputs {
        /// Whose face, as the second input has it.
        name: String,
        /// The first input.
        first: String,
        /// The second.
        second: String,
    },
    /// Two inputs have faces with the same points.
    #[error("{name} in {second} has exactly the points of {other} in {first}; each face must appear once: remove one of them")]
    SameFace {
        /// Whose face, as the second input has it.
        name: String,
        /// The second input.
        second: String,
        /// Whose face, as the first input has it.
        other: String,
        /// The first input.
        first: String,
    },
    /// A node appears twice in one face.
    #[error("{}, line {line}: node {node} of {name} is already in line {first_line}; keep one row", path.display())]
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
    /// No row has the requested state.
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
/// - A CSV file with the columns `x0,y0,...,x67,y67` and one of `person`, `subject` and `frame` to name the face; every row is one face. If
///   there is a column `state`, only rows with the state `state` are used.
/// - A CSV file with the columns `node,x,y`, one of `person`, `subject` and `image`, and optionally `face`, as `grimace locate` writes it;
///   every row is one node of a face.
/// - A dataset (a folder, or its `manifest.csv`) with landmarks: the neutral frame of each subject's first sequence that has one. The
///   landmarks are those that drive a sequence ([`SequenceEntry::driving_landmarks`]); without images the neutral frame is their first.
///
/// Columns may be separated by semicolons; then decimals have commas.
///
/// # Errors
/// `FacesError`. In a dataset, a subject without landmarks is skipped without error.
pub fn read_neutral_faces(path: &Path, state: &str) -> Result<NeutralFaces, FacesError> {
    if path.is_dir() {
        return read_dataset(path);
    }
    let csv = CsvFile::open(path)?.or_semicolons(&KNOWN_COLUMNS)?;
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
    let of_persons = csv.header().get(name_column).is_some_and(|name| name != "frame");
    Ok(with_hash(faces, Vec::new(), of_persons))
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
    let of_persons = face_column.is_none() && csv.header().get(name_column).is_some_and(|name| name != "image");
    Ok(with_hash(order.into_iter().filter_map(face).collect(), Vec::new(), of_persons))
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
    Ok(with_hash(faces, skipped, true))
}

fn neutral_face(entry: &SequenceEntry) -> Result<NeutralFace, String> {
    let driving = |prefer| entry.driving_landmarks(prefer).map_err(|e| e.to_string());
    let path = driving(true)?.ok_or("the manifest names no landmarks")?;
    let track = read_face(&path, LEAST_CONFIDENCE, entry.face_id()).map_err(|e| e.to_string())?;
    // Landmarks that drive a sequence without being preferred are its only data.
    let neutral = if driving(false)?.is_some() {
        track.neutral_frame(entry.first_frame)
    } else {
        track.frame(entry.frames().map_err(|e| e.to_string())?.neutral_number())
    };
    let landmarks = neutral.map_err(|e| e.to_string())?.to_vec();
    Ok(NeutralFace { name: entry.id.subject.clone(), points: FacePoints::Landmarks(landmarks) })
}

/// Creates faces with the hash of their names and coordinates: equal faces have equal hashes, whatever the source.
fn with_hash(faces: Vec<NeutralFace>, skipped: Vec<(String, String)>, of_persons: bool) -> NeutralFaces {
    let mut hasher = blake3::Hasher::new();
    for face in &faces {
        hasher.update(&(face.name.len() as u64).to_le_bytes());
        hasher.update(face.name.as_bytes());
        add_points(&mut hasher, &face.points);
    }
    NeutralFaces { faces, skipped, blake3: hasher.finalize().to_hex().to_string(), of_persons }
}

/// Returns a hash that identifies a face without its name.
fn hash_of_points(points: &FacePoints) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    add_points(&mut hasher, points);
    hasher.finalize().into()
}

fn add_points(hasher: &mut blake3::Hasher, points: &FacePoints) {
    let mut add = |p: &Point2<f64>| {
        hasher.update(&p.x.to_le_bytes());
        hasher.update(&p.y.to_le_bytes());
    };
    match points {
        FacePoints::Landmarks(landmarks) => landmarks.iter().for_each(add),
        FacePoints::Nodes(nodes) => nodes.iter().for_each(|(node, p)| {
            add(&Point2::new(f64::from(node.0), f64::NAN));
            add(p);
        }),
    }
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
        assert!(twice.ends_with("line 3: node 20 of A is already in line 2; keep one row"), "{twice}");
        assert!(read("who,node,x,y\nA,20,5,6\n").unwrap_err().contains("no column `person`, `subject` or"));
        assert!(read("person,node,x,y\nA,70000,5,6\n").unwrap_err().contains("70000"));
    }

    /// Checks the faces of several files and folders together.
    fn once(inputs: &[(&str, &Path)]) -> Result<(), String> {
        let read: Vec<_> =
            inputs.iter().map(|(name, path)| ((*name).to_owned(), read_neutral_faces(path, "neutral").unwrap())).collect();
        let inputs: Vec<_> = read.iter().map(|(name, read)| (name.clone(), read)).collect();
        check_faces_once(&inputs).map_err(|e| e.to_string())
    }

    fn columns() -> String {
        (0..68).map(|k| format!(",x{k},y{k}")).collect()
    }

    /// A row whose points are shifted by `by` relative to those of `row(0)`.
    fn row(by: usize) -> String {
        (0..68).map(|k| format!(",{}.5,{}", k + by, 2 * k)).collect()
    }

    #[test]
    fn a_person_counts_once_in_all_inputs_together() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, text: String| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, text).unwrap();
            path
        };
        let table = |name: &str, first: &str, rows: &[(&str, usize)]| {
            let rows: String = rows.iter().map(|(name, by)| format!("{name}{}\n", row(*by))).collect();
            file(name, format!("{first}{}\n{rows}", columns()))
        };
        let a = table("a.csv", "person", &[("A", 0), ("B", 1)]);
        let b = table("b.csv", "subject", &[("C", 2), ("b", 3)]);
        let c = table("c.csv", "person", &[("D", 4)]);
        let said = "A is in a.csv and in again.csv; each face must appear once: remove it from one file, or rename one of two different people";
        assert_eq!(once(&[("a.csv", &a), ("c.csv", &c), ("again.csv", &a)]).unwrap_err(), said);
        assert!(once(&[("a.csv", &a), ("b.csv", &b)]).unwrap_err().starts_with("b is in a.csv and in b.csv;"));
        once(&[("b.csv", &b), ("c.csv", &c)]).unwrap();
        // A dataset and a table.
        table("data/l.csv", "frame", &[("1", 5), ("2", 6)]);
        file("data/manifest.csv", "subject,sequence,emotion,frames\nD,1,fear,l.csv\n".to_owned());
        let data = folder.path().join("data");
        assert!(once(&[("c.csv", &c), ("data", &data)]).unwrap_err().starts_with("D is in c.csv and in data;"));
        once(&[("a.csv", &a), ("data", &data)]).unwrap();
        // A frame number does not identify a person; identical points are the same face.
        let d = table("d.csv", "frame", &[("1", 7), ("2", 8)]);
        let e = table("e.csv", "frame", &[("1", 9), ("2", 10)]);
        let f = table("f.csv", "frame", &[("11", 8)]);
        once(&[("d.csv", &d), ("e.csv", &e)]).unwrap();
        assert!(
            once(&[("d.csv", &d), ("f.csv", &f)]).unwrap_err().starts_with("11 in f.csv has exactly the points of 2 in d.csv;")
        );
    }

    #[test]
    fn tables_of_semicolons_may_have_decimal_commas() {
        let folder = tempfile::tempdir().unwrap();
        let read = |text: &str| {
            let path = folder.path().join("faces.csv");
            std::fs::write(&path, text).unwrap();
            read_neutral_faces(&path, "neutral").map_err(|e| e.to_string())
        };
        let semicolons = |commas: &str| commas.replace(',', ";").replace('.', ",");
        let commas = format!("person,state{}\nA,neutral{}\nA,sad{}\n", columns(), row(0), row(1));
        assert!(semicolons(&commas).contains("\nA;neutral;0,5;0;1,5;2;"));
        assert_eq!(read(&semicolons(&commas)), read(&commas));
        let commas = "person,node,x,y\nA,20,5.5,6\nA,53,1.25,2\n";
        assert_eq!(read(&semicolons(commas)), read(commas));
        let error = read("person;node;x;y\nA;20;1.000,5;6\n").unwrap_err();
        assert!(error.ends_with("line 2: x is `1.000,5`; a finite number was expected"), "{error}");
    }

    #[test]
    fn landmarks_without_images_have_their_first_frame_as_the_neutral_one() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
        write("l.csv", format!("frame{}\n4{}\n9{}\n", columns(), row(4), row(9)));
        write("lost.csv", format!("frame,success{}\n4,0{}\n9,1{}\n", columns(), row(4), row(9)));
        let first_x = |manifest: &str| {
            write("manifest.csv", format!("subject,sequence,emotion,first_frame,frames,landmarks\n{manifest}\n"));
            let read = read_neutral_faces(folder.path(), "neutral").unwrap();
            match read.faces.first().map(|face| &face.points) {
                Some(FacePoints::Landmarks(points)) => Ok(points[0].x),
                _ => Err(read.skipped[0].1.clone()),
            }
        };
        assert_eq!(first_x("A,1,fear,,l.csv,"), Ok(4.5));
        assert_eq!(first_x("A,1,fear,,,l.csv"), Ok(4.5));
        assert_eq!(first_x("A,1,fear,9,l.csv,"), Ok(9.5));
        assert_eq!(first_x("A,1,fear,9,,l.csv"), Ok(9.5));
        assert!(first_x("A,1,fear,5,l.csv,").unwrap_err().contains('5'));
        assert!(first_x("A,1,fear,,lost.csv,").unwrap_err().contains("the face is lost in frame 4, the neutral frame"));
        assert_eq!(first_x("A,1,fear,,,").unwrap_err(), "the manifest names no landmarks");
    }

    #[test]
    fn bad_files_are_named() {
        assert!(read("person", &["A"], 67).unwrap_err().ends_with("67 points in columns x0,y0,...; 68 were expected"));
        assert!(read("name", &["A"], 68).unwrap_err().contains("no column `person`, `subject` or `frame`"));
        assert!(read("person", &["A", "A"], 68).unwrap_err().contains("line 3: A is already in line 2"));
        let error = read("person,state", &["A,smiling", "B,sad"], 68).unwrap_err();
        assert!(error.ends_with("no row has the state `neutral`; there are sad, smiling"), "{error}");
    }
}
