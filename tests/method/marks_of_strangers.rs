//! Good marks are never refused, and wrong ones always are. Good marks are landmarks of real people in any number, with errors of several
//! pixels, on small and turned faces with open mouths, and faces of the shape space at three standard deviations.

use std::collections::{BTreeMap, BTreeSet};

use grimace::internal::{
    dataset::{Dataset, LandmarkSelection, correspondences_from_landmarks},
    fit::{Correspondence, FacePoints, FitOptions, Fitter, ShapePrior, read_neutral_faces, validate_correspondences},
    locate::learn::read_faces,
    units::NodeId,
    wireframe::{Tables, Wireframe},
};
use nalgebra::{Point2, Vector2};
use rand::{RngExt, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// A face with exact positions of nodes, px, y down, and its eye distance.
struct Face {
    name: String,
    places: Vec<(NodeId, Point2<f64>)>,
    eye_distance: f64,
}

fn mean_of(points: &[Point2<f64>]) -> Point2<f64> {
    Point2::from(points.iter().map(|p| p.coords).sum::<Vector2<f64>>() / points.len() as f64)
}

fn of_landmarks(name: String, points: &[Point2<f64>], tables: &Tables) -> Face {
    let marks = correspondences_from_landmarks(points, tables, &LandmarkSelection::HighAndMedium).unwrap();
    let eye_distance = (mean_of(&points[36..42]) - mean_of(&points[42..48])).norm();
    Face { name, places: marks.iter().map(|m| (m.node, m.position)).collect(), eye_distance }
}

/// Returns 90 people with landmarks of a network and with hand-set points, neutral and (by the network) smiling; and the first and the last
/// frame of every sequence.
fn real_faces(tables: &Tables) -> Vec<Face> {
    let mut faces = Vec::new();
    let skipped = "marks of real people were not tried";
    let [people, photographed, sequences] =
        ["people/landmarks68.csv", "faces", "sequences"].map(|name| crate::common::shared_data(name, skipped));
    let (Some(people), Some(photographed), Some(sequences)) = (people, photographed, sequences) else { return faces };
    for state in ["neutral", "smiling"] {
        let read = read_neutral_faces(&people, state).unwrap().faces;
        for face in read {
            let FacePoints::Landmarks(landmarks) = &face.points else { unreachable!("a file of landmarks") };
            faces.push(of_landmarks(format!("{} {state}", face.name), landmarks, tables));
        }
    }
    for face in read_faces(&photographed, &BTreeSet::new()).unwrap().faces {
        faces.push(Face { name: format!("{} by hand", face.person), places: face.nodes(), eye_distance: face.eye_distance() });
    }
    for entry in Dataset::open(&sequences).unwrap().sequences {
        let track = entry.landmarks().unwrap().unwrap();
        let ends = [track.frames.keys().next(), track.frames.keys().next_back()].map(|k| *k.unwrap());
        faces.extend(ends.map(|k| of_landmarks(format!("{} frame {k}", entry.id), &track.frames[&k], tables)));
    }
    faces
}

/// Returns faces of every prior: each mode at three standard deviations, and random combinations with a total of three.
fn extreme_faces(wireframe: &Wireframe) -> Vec<Face> {
    let mut faces = Vec::new();
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let [networks, by_hand] = ShapePrior::faces();
    for (name, prior) in [("faces", networks), ("by hand", by_hand), ("candide", ShapePrior::candide(wireframe))] {
        let count = prior.modes.len();
        let mut all: Vec<Vec<f64>> = Vec::new();
        for j in 0..count {
            for sign in [-3.0, 3.0] {
                all.push((0..count).map(|k| if k == j { sign } else { 0.0 }).collect());
            }
        }
        for _ in 0..60 {
            let c: Vec<f64> = (0..count).map(|_| StandardNormal.sample(&mut random)).collect();
            let norm: f64 = c.iter().map(|v: &f64| v * v).sum::<f64>().sqrt();
            all.push(c.iter().map(|v| 3.0 * v / norm).collect());
        }
        for (n, c) in all.iter().enumerate() {
            let place = |k: usize| {
                let moved: Vector2<f64> = (0..count).map(|j| prior.modes[j][k] * (prior.deviations[j] * c[j])).sum();
                let p = prior.mean[k] + moved;
                Point2::new(320.0 + 163.0 * p.x, 240.0 - 163.0 * p.y)
            };
            let places: Vec<_> = wireframe.live_nodes().iter().map(|&node| (node, place(node.index()))).collect();
            faces.push(Face { name: format!("{name} {n}"), places, eye_distance: 100.0 });
        }
    }
    faces
}

/// Returns marks of a face under difficult conditions: fewer, smaller, turned, with errors.
fn strange_marks(face: &Face, size: usize, depth: &[f64], random: &mut ChaCha8Rng) -> Vec<Correspondence> {
    let mut places = face.places.clone();
    places.shuffle(random);
    places.truncate(size);
    let eye_distance = random.random_range(40.0..160.0);
    let zoom: f64 = eye_distance / face.eye_distance;
    let yaw = random.random_range(-15.0_f64..15.0).to_radians();
    let roll = nalgebra::Rotation2::new(random.random_range(-0.35..0.35));
    // Detectors are biased: all marks of one are shifted together, by up to 2 px of 100, and each mark by up to 2 px more.
    let noise = 2.0 * (eye_distance / 100.0).sqrt();
    let middle = mean_of(&face.places.iter().map(|p| p.1).collect::<Vec<_>>());
    let whole = random.random_bool(0.5);
    places
        .iter()
        .map(|&(node, p)| {
            let mut q = (p - middle) * zoom;
            q.x = q.x * yaw.cos() + depth[node.index()] * eye_distance / 0.613 * yaw.sin();
            let error = Vector2::new(StandardNormal.sample(random), StandardNormal.sample(random)) * noise;
            let mut at = Point2::new(400.0, 400.0) + (roll * q + error);
            if whole {
                at = at.map(f64::round);
            }
            Correspondence::mark(node, at)
        })
        .collect()
}

fn refusals(faces: &[Face], rounds: usize, seed: u64) -> (usize, BTreeMap<String, Vec<String>>, f64) {
    let wireframe = Wireframe::candide3();
    let fitter = Fitter::new(&wireframe, FitOptions::default());
    let depth: Vec<f64> = wireframe.vertices().iter().map(|v| v.z - 0.2).collect();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (mut tried, mut warned) = (0, 0);
    let mut refused: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (k, face) in faces.iter().enumerate() {
        for round in 0..rounds {
            let most = face.places.len();
            let size = 3 + (k + round * 7) % (most - 2);
            let marks = strange_marks(face, size, &depth, &mut random);
            // Three marks on one line determine no placement; the fit rightly says so.
            if validate_correspondences(&marks, 800, 800).is_err() {
                continue;
            }
            tried += 1;
            match fitter.fit(&wireframe, &marks) {
                Ok(fitted) => warned += usize::from(!fitted.warnings.is_empty()),
                Err(error) => {
                    let text = error.to_string();
                    let kind = text.split_whitespace().take(2).collect::<Vec<_>>().join(" ");
                    refused.entry(kind).or_default().push(format!("{}, {size} marks: {text}", face.name));
                }
            }
        }
    }
    (tried, refused, warned as f64 / f64::from(tried as u32))
}

#[test]
fn good_marks_are_never_refused() {
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    for (name, faces, rounds) in [("real", real_faces(&tables), 3), ("3 sd", extreme_faces(&wireframe), 2)] {
        let (tried, refused, warned) = refusals(&faces, rounds, 11);
        println!("{name}: {} faces, {tried} sets of marks, {:.1} % with a warning", faces.len(), 100.0 * warned);
        for (kind, texts) in &refused {
            println!("  {} {kind}", texts.len());
            texts.iter().take(6).for_each(|t| println!("    {t}"));
        }
        assert!(refused.is_empty());
    }
}

/// The seven most common marks.
const SEVEN: [u16; 7] = [20, 23, 53, 56, 31, 64, 10];

type Mistake = (&'static str, fn(&mut Vec<Correspondence>, f64));

fn exchange(marks: &mut [Correspondence], pairs: &[(u16, u16)]) {
    for &(a, b) in pairs {
        let place = |n: u16| marks.iter().position(|m| m.node == NodeId(n));
        if let (Some(i), Some(j)) = (place(a), place(b)) {
            let kept = marks[i].position;
            marks[i].position = marks[j].position;
            marks[j].position = kept;
        }
    }
}

fn shift(marks: &mut [Correspondence], node: u16, by: Vector2<f64>) {
    marks.iter_mut().filter(|m| m.node == NodeId(node)).for_each(|m| m.position += by);
}

/// Common mistakes, each with the node that the message must name (none: no node).
const MISTAKES: [(Option<u16>, Mistake); 20] = [
    (Some(20), ("left eye: outer and inner corner exchanged", |m, _| exchange(m, &[(20, 23)]))),
    (Some(53), ("right eye: outer and inner corner exchanged", |m, _| exchange(m, &[(53, 56)]))),
    (Some(31), ("corners of the mouth exchanged", |m, _| exchange(m, &[(31, 64)]))),
    (Some(20), ("outer corners of the eyes exchanged", |m, _| exchange(m, &[(20, 53)]))),
    (Some(23), ("outer and inner corners of both eyes exchanged", |m, _| exchange(m, &[(20, 23), (53, 56)]))),
    (Some(56), ("inner corners of the eyes exchanged", |m, _| exchange(m, &[(23, 56)]))),
    (Some(17), ("ends of both brows exchanged", |m, _| exchange(m, &[(15, 17), (48, 50)]))),
    (Some(50), ("brows exchanged", |m, _| exchange(m, &[(15, 48), (16, 49), (17, 50)]))),
    (Some(8), ("lips exchanged", |m, _| exchange(m, &[(7, 8)]))),
    (None, ("eyes exchanged", |m, _| exchange(m, &[(20, 53), (23, 56)]))),
    (Some(10), ("chin on the mouth", |m, _| exchange(m, &[(10, 31)]))),
    (Some(10), ("chin at the nose", |m, es| shift(m, 10, Vector2::new(0.0, -es)))),
    (Some(10), ("chin on the collar", |m, es| shift(m, 10, Vector2::new(0.0, 0.9 * es)))),
    (Some(64), ("mouth corner on the cheek", |m, es| shift(m, 64, Vector2::new(-0.7 * es, -0.3 * es)))),
    (Some(53), ("eye corner on the brow", |m, es| shift(m, 53, Vector2::new(0.0, -0.6 * es)))),
    (Some(15), ("ends of a brow exchanged", |m, _| exchange(m, &[(15, 17)]))),
    (Some(48), ("outer ends of the brows exchanged", |m, _| exchange(m, &[(15, 48)]))),
    (Some(49), ("brow in the hair", |m, es| shift(m, 49, Vector2::new(0.0, -0.7 * es)))),
    (Some(30), ("angles of the jaw exchanged", |m, _| exchange(m, &[(30, 63)]))),
    (Some(23), ("inner corner of the eye at the nose", |m, es| shift(m, 23, Vector2::new(-0.2 * es, 0.6 * es)))),
];

#[test]
fn wrong_marks_are_refused_by_name() {
    let tables = Tables::candide3();
    let wireframe = Wireframe::candide3();
    let fitter = Fitter::new(&wireframe, FitOptions::default());
    let faces = real_faces(&tables);
    let chosen: Vec<&Face> = faces.iter().step_by(20).collect();
    let depth = vec![0.0; wireframe.node_count()];
    let mut missed = Vec::new();
    for (named, (what, mistake)) in MISTAKES {
        for few in [true, false] {
            let (mut tried, mut caught, mut by_name) = (0, 0, 0);
            for (k, face) in chosen.iter().enumerate() {
                let mut random = ChaCha8Rng::seed_from_u64(k as u64);
                let seven = |n: NodeId| SEVEN.contains(&n.0);
                let places = face.places.iter().copied().filter(|p| !few || seven(p.0)).collect();
                let face = Face { name: face.name.clone(), places, eye_distance: face.eye_distance };
                let mut marks = strange_marks(&face, face.places.len(), &depth, &mut random);
                if named.is_some_and(|n| marks.iter().all(|m| m.node != NodeId(n))) {
                    continue;
                }
                tried += 1;
                let at = |n: u16| marks.iter().find(|m| m.node == NodeId(n)).unwrap().position;
                let es = 0.7 * (at(20) - at(53)).norm();
                mistake(&mut marks, es);
                match fitter.fit(&wireframe, &marks) {
                    Ok(_) => missed.push(format!("{what}, {} marks, {}", marks.len(), face.name)),
                    Err(error) => {
                        caught += 1;
                        let text = error.to_string();
                        by_name += usize::from(named.is_none_or(|n| text.contains(&n.to_string())));
                    }
                }
            }
            println!("{what}, {} marks: {caught} of {tried} refused, {by_name} by name", if few { "7" } else { "all" });
        }
    }
    missed.iter().take(20).for_each(|m| println!("  missed: {m}"));
    assert!(missed.is_empty());
}

#[test]
fn mirrored_and_upside_down_faces_are_refused() {
    let tables = Tables::candide3();
    let wireframe = Wireframe::candide3();
    let fitter = Fitter::new(&wireframe, FitOptions::default());
    let (mut tried, mut wrong) = (0, Vec::new());
    for face in real_faces(&tables).iter().step_by(20) {
        for few in [true, false] {
            let places = face.places.iter().filter(|p| !few || SEVEN.contains(&p.0.0));
            let turned = |x: f64, y: f64| -> Vec<Correspondence> {
                places.clone().map(|(n, p)| Correspondence::mark(*n, Point2::new(x * p.x, y * p.y))).collect()
            };
            tried += 1;
            let mirrored = fitter.fit(&wireframe, &turned(-1.0, 1.0)).map_err(|e| e.to_string()).err().unwrap_or_default();
            let upside_down = fitter.fit(&wireframe, &turned(-1.0, -1.0)).map_err(|e| e.to_string()).err().unwrap_or_default();
            let y_upwards = fitter.fit(&wireframe, &turned(1.0, -1.0)).map_err(|e| e.to_string()).err().unwrap_or_default();
            if !mirrored.contains("mirrored")
                || !upside_down.contains("upside down")
                || !y_upwards.contains("counted from the bottom")
            {
                wrong.push(format!("{}: {mirrored} / {upside_down} / {y_upwards}", face.name));
            }
        }
    }
    println!("{tried} faces mirrored, turned by 180 degrees, and with y upwards");
    assert!(wrong.is_empty(), "{wrong:?}");
}
