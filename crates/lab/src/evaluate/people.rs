//! Neutral faces with known nodes: simulated people, and real people with 68-point landmarks.

use std::{collections::BTreeMap, path::Path};

use nalgebra::{Point2, Vector2};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::{
    EvaluateError,
    truth::{compared_nodes, group_of, landmark_eye_distance},
};
use crate::simulate::{SimulateOptions, neutral_nodes};
use grimace::internal::{
    dataset::{Dataset, DatasetError, LANDMARK_COUNT, SequenceEntry},
    fit::Correspondence,
    input::CsvFile,
    track::eye_distance_px,
    units::NodeId,
    wireframe::{MarkableNode, Tables, Wireframe},
};

/// Name of the population of simulated people.
const SIMULATED: &str = "simulated";

/// A node with its true position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthNode {
    /// The node.
    pub node: NodeId,
    /// True position, px.
    pub position: Point2<f64>,
    /// Whether the node belongs to the inner face.
    pub inner: bool,
}

/// A neutral face with known nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Person {
    /// Name of the person.
    pub id: String,
    /// Eye distance ES0, px.
    pub eye_distance: f64,
    /// Nodes with a known position, in ascending order.
    pub truth: Vec<TruthNode>,
    /// Error of a mark at each node of `truth`, in standard deviations; it does not depend on which other nodes are marked.
    errors: Vec<Vector2<f64>>,
}

/// Standard deviation of the errors of marks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MarkNoise<'a> {
    /// One standard deviation for all nodes, px, in x and in y; 0 for exact marks.
    Uniform(f64),
    /// The typical error of each node's feature, relative to the eye distance.
    Reliability(&'a [MarkableNode]),
}

/// A group of people of one kind.
#[derive(Clone, Debug, PartialEq)]
pub struct Population {
    /// Name in tables and figures.
    pub name: String,
    /// Whether the faces are real and known at landmarks only. Marks are then the landmarks themselves, and only unmarked nodes are
    /// compared.
    pub real: bool,
    /// The people, at least one.
    pub people: Vec<Person>,
}

impl Person {
    /// Makes a face from known nodes; `seed` and `index` determine the errors of its marks.
    pub fn new(id: String, eye_distance: f64, mut truth: Vec<TruthNode>, seed: u64, index: u32) -> Self {
        truth.sort_by_key(|t| t.node);
        let errors = truth.iter().map(|t| mark_error(seed, index, t.node)).collect();
        Self { id, eye_distance, truth, errors }
    }

    /// Returns the mark of a node with its error, or `None` when the position of the node is not known.
    pub fn mark(&self, node: NodeId, noise: MarkNoise) -> Option<Correspondence> {
        let place = self.truth.binary_search_by_key(&node, |t| t.node).ok()?;
        let deviation = match noise {
            MarkNoise::Uniform(px) => px,
            MarkNoise::Reliability(nodes) => {
                self.eye_distance * nodes.iter().find(|m| m.node == node).map_or(0.0, |m| m.deviation_es)
            }
        };
        let position = self.truth[place].position + self.errors[place] * deviation;
        Some(Correspondence::mark(node, position))
    }

    /// Whether the position of a node is known.
    pub fn knows(&self, node: NodeId) -> bool {
        self.truth.binary_search_by_key(&node, |t| t.node).is_ok()
    }
}

/// Returns two standard normal numbers from a random stream of this person and node.
fn mark_error(seed: u64, person: u32, node: NodeId) -> Vector2<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(u64::from(person) << 16 | u64::from(node.0));
    Vector2::new(StandardNormal.sample(&mut random), StandardNormal.sample(&mut random))
}

/// Returns [`SimulateOptions::subjects`] simulated people with the exact positions of all live nodes in the neutral frame.
///
/// # Errors
/// [`EvaluateError::Simulate`] for options out of range.
pub fn simulated_people(options: &SimulateOptions, wireframe: &Wireframe, tables: &Tables) -> Result<Population, EvaluateError> {
    options.check()?;
    // The emotion affects only the position of the head in the picture.
    let emotion = options.emotions[0];
    let person = |index: u32| -> Result<Person, EvaluateError> {
        let nodes = neutral_nodes(options, index, emotion)?;
        let truth = wireframe.live_nodes().iter().map(|&node| TruthNode { node, position: nodes[node.index()], inner: true });
        let eye_distance = eye_distance_px(tables, &nodes).unwrap_or(f64::NAN);
        Ok(Person::new(format!("S{:03}", index + 1), eye_distance, truth.collect(), options.seed, index))
    };
    let people = (0..options.subjects).map(person).collect::<Result<_, _>>()?;
    Ok(Population { name: SIMULATED.to_owned(), real: false, people })
}

/// Returns the people of a dataset, known at the landmarks of their neutral frames.
///
/// There is one population for each value of the manifest column `by`, or a single one without it. Sequences of one subject with equal
/// neutral landmarks count once in a population; sequences without landmarks are left out.
///
/// # Errors
/// [`EvaluateError`] when the dataset cannot be opened or lacks the column, landmarks cannot be read, or no sequence has any.
pub fn people_of_dataset(path: &Path, by: Option<&str>, tables: &Tables, seed: u64) -> Result<Vec<Population>, EvaluateError> {
    let dataset = Dataset::open(path)?;
    let mut populations: BTreeMap<String, Vec<Person>> = BTreeMap::new();
    let mut seen: Vec<(String, String, Vec<Point2<f64>>)> = Vec::new();
    for entry in &dataset.sequences {
        let Some(points) = neutral_landmarks(entry)? else { continue };
        let name = match group_of(entry, by)? {
            _ if by.is_none() => "real".to_owned(),
            // This name is reserved for the simulated people.
            group if group == SIMULATED => format!("real_{group}"),
            group => group,
        };
        let key = (name, entry.id.subject.clone(), points);
        if seen.contains(&key) {
            continue;
        }
        let people = populations.entry(key.0.clone()).or_default();
        people.extend(landmark_person(entry.id.to_string(), &key.2, tables, seed, people.len()));
        seen.push(key);
    }
    populations.retain(|_, people| !people.is_empty());
    if populations.is_empty() {
        return Err(EvaluateError::NoTruth { path: path.to_owned() });
    }
    Ok(populations.into_iter().map(|(name, people)| Population { name, real: true, people }).collect())
}

/// Returns the landmarks of a sequence's neutral frame, if it has any.
fn neutral_landmarks(entry: &SequenceEntry) -> Result<Option<Vec<Point2<f64>>>, EvaluateError> {
    let Some(track) = entry.landmarks()? else { return Ok(None) };
    let number = match entry.first_frame {
        Some(number) => number,
        None => entry.frames().map_err(DatasetError::from)?.neutral_number(),
    };
    Ok(Some(track.frame(number)?.to_vec()))
}

/// Reads people from a CSV file of landmarks: the first column names the person, and the columns `x0,y0,...,x67,y67` hold the coordinates.
/// When there is a column `state`, only rows with the value `neutral` are read.
///
/// # Errors
/// [`EvaluateError::Input`] when the file or a row cannot be read, [`EvaluateError::NoTruth`] when it has no neutral face.
pub fn people_of_landmark_file(path: &Path, tables: &Tables, seed: u64) -> Result<Population, EvaluateError> {
    let csv = CsvFile::open(path)?;
    csv.require(["x0", "y0", "x67", "y67"])?;
    let state = csv.column("state");
    let mut people = Vec::new();
    for row in csv.rows() {
        let row = row?;
        if state.is_some_and(|column| row.get(column).trim() != "neutral") {
            continue;
        }
        let mut points = Vec::with_capacity(LANDMARK_COUNT);
        for k in 0..LANDMARK_COUNT {
            let [x, y] = csv.require([format!("x{k}").as_str(), format!("y{k}").as_str()])?;
            points.push(Point2::new(row.number(x)?, row.number(y)?));
        }
        people.extend(landmark_person(row.get(0).trim().to_owned(), &points, tables, seed, people.len()));
    }
    if people.is_empty() {
        return Err(EvaluateError::NoTruth { path: path.to_owned() });
    }
    Ok(Population { name: "real".to_owned(), real: true, people })
}

/// Whether a file holds people for [`people_of_landmark_file`], rather than a manifest.
pub fn is_landmark_file(path: &Path) -> bool {
    path.is_file() && CsvFile::open(path).is_ok_and(|csv| csv.require(["x0", "y0", "x67", "y67"]).is_ok())
}

fn landmark_person(id: String, points: &[Point2<f64>], tables: &Tables, seed: u64, index: usize) -> Option<Person> {
    let eye_distance = landmark_eye_distance(points)?;
    let node = |c: super::truth::ComparedNode| TruthNode { node: c.node, position: points[c.landmark], inner: c.inner };
    let truth = compared_nodes(tables).into_iter().map(node).collect();
    Some(Person::new(id, eye_distance, truth, seed, index as u32))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn person(seed: u64) -> Person {
        let node = |n: u16, x: f64| TruthNode { node: NodeId(n), position: Point2::new(x, 2.0 * x), inner: true };
        Person::new("p".to_owned(), 100.0, vec![node(31, 3.0), node(10, 1.0)], seed, 4)
    }

    #[test]
    fn marks_have_the_error_asked_for_and_none_without() {
        let p = person(1);
        let exact = p.mark(NodeId(31), MarkNoise::Uniform(0.0)).unwrap();
        assert_eq!(exact.position, Point2::new(3.0, 6.0));
        let error = |px| p.mark(NodeId(31), MarkNoise::Uniform(px)).unwrap().position - exact.position;
        assert_eq!(error(2.0), error(1.0) * 2.0);
        assert_ne!(error(1.0), Vector2::zeros());
        assert_eq!(p.mark(NodeId(5), MarkNoise::Uniform(1.0)), None);
        // A node's own error: 0.02 of 100 px is 2 px.
        let nodes = [MarkableNode { node: NodeId(31), deviation_es: 0.02, description: String::new() }];
        let own = p.mark(NodeId(31), MarkNoise::Reliability(&nodes)).unwrap().position - exact.position;
        assert!((own - error(2.0)).norm() < 1e-12);
        assert_ne!(person(2).mark(NodeId(31), MarkNoise::Uniform(1.0)), p.mark(NodeId(31), MarkNoise::Uniform(1.0)));
    }

    #[test]
    fn mark_errors_are_standard_normal() {
        // 4000 numbers: their mean is within 4 / sqrt(4000) = 0.063 and their variance within 4 sqrt(2 / 4000) = 0.09 of 0 and 1.
        let errors: Vec<f64> = (0..2000)
            .flat_map(|k| {
                let e = mark_error(5, k, NodeId(7));
                [e.x, e.y]
            })
            .collect();
        let mean = errors.iter().sum::<f64>() / 4000.0;
        let variance = errors.iter().map(|e| e * e).sum::<f64>() / 4000.0;
        assert!(mean.abs() < 0.063 && (variance - 1.0).abs() < 0.09, "{mean} {variance}");
    }

    #[test]
    fn landmark_files_give_their_neutral_people() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("people.csv");
        let header = (0..68).map(|k| format!(",x{k},y{k}")).collect::<Vec<_>>().concat();
        let row = |shift: f64| (0..68).map(|k| format!(",{},{}", f64::from(k) + shift, k % 7)).collect::<Vec<_>>().concat();
        let text = format!("person,state{header}\nA,neutral{}\nA,smiling{}\nB,neutral{}\n", row(0.0), row(9.0), row(1.0));
        std::fs::write(&path, &text).unwrap();
        assert!(is_landmark_file(&path));
        let population = people_of_landmark_file(&path, &Tables::candide3(), 1).unwrap();
        assert_eq!(population.people.iter().map(|p| p.id.as_str()).collect::<Vec<_>>(), ["A", "B"]);
        // Node 10 is landmark 8: x is 8, y is 8 mod 7.
        let chin = population.people[0].mark(NodeId(10), MarkNoise::Uniform(0.0)).unwrap().position;
        assert_eq!(chin, Point2::new(8.0, 1.0));
        std::fs::write(&path, text.replace(",neutral", ",smiling")).unwrap();
        let error = people_of_landmark_file(&path, &Tables::candide3(), 1).unwrap_err();
        assert!(error.to_string().contains("no sequence has 68-point landmarks to compare with"), "{error}");
        std::fs::write(&path, text.replace("neutral,0,", "neutral,zero,")).unwrap();
        let error = people_of_landmark_file(&path, &Tables::candide3(), 1).unwrap_err();
        assert!(error.to_string().contains("line 2: x0 is `zero`"), "{error}");
    }
}
