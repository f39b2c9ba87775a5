//! Detection rate and false alarm rate of the check for marks that do not lie on the face of their picture.
//!
//! The check runs on good marks and on marks with deliberate errors: shifted, scaled, taken from another person, or with single marks
//! moved.

use std::collections::BTreeMap;

use grimace::internal::{
    dataset::{
        DEFAULT_LANDMARK_NODES, Dataset, DatasetError, FrameSource, LandmarkSelection, SequenceEntry,
        correspondences_from_landmarks,
    },
    fit::{Correspondence, FacePoints, FitOptions, Fitter},
    locate::{LocateOptions, LocatedFace, Locator, learn::TrainingFace},
    pipeline::{face_of_marks, held},
    sequence::read_frame,
    units::NodeId,
    wireframe::{Tables, Wireframe},
};
use image::{GrayImage, Luma, imageops};
use nalgebra::{Point2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::{Cell, EvaluateError, Person, Table, TruthNode, placement::marks};

/// Value of [`BesideTrial::wrong`] for good marks.
const GOOD: &str = "nothing";
/// Name of the neutral photograph, on which every error is tried.
const NEUTRAL: &str = "neutral";
/// A set of five marks: the outer corners of the eyes, the corners of the mouth, and the chin.
const FIVE: [u16; 5] = [20, 53, 31, 64, 10];
/// Nodes of the brows, each paired with the node of the upper lid below it.
const BROW_ON_LID: [(u16, u16); 6] = [(15, 97), (16, 21), (17, 105), (48, 98), (49, 54), (50, 106)];
/// Sizes of the shifts, in px and (`SHIFTS`) relative to the eye distance.
const SHIFTS_PX: [f64; 2] = [20.0, 40.0];
const SHIFTS: [f64; 3] = [0.05, 0.1, 0.15];
/// Factors by which all coordinates are multiplied.
const FACTORS: [f64; 2] = [1.3, 0.75];
/// Eye distances of the reduced pictures, px; they correspond to 40, 60, 80 and 110 px between the outer corners of the eyes.
const SMALL: [f64; 4] = [31.0, 47.0, 63.0, 86.0];
/// Outward displacement of the mouth corners, relative to the eye distance.
const OUT: f64 = 0.15;

/// A person of the study.
#[derive(Clone, Debug)]
pub struct BesidePerson {
    /// The neutral photograph with its hand-set points.
    pub neutral: TrainingFace,
    /// Landmarks that a network found on the neutral photograph.
    pub landmarks: Option<FacePoints>,
    /// A photograph of a smile, with its landmarks.
    pub smile: Option<(GrayImage, FacePoints)>,
}

/// Result of the check for one set of marks on one picture.
#[derive(Clone, Debug)]
pub struct BesideTrial {
    /// Name of the person.
    pub person: String,
    /// The deliberate error of the marks; `nothing` for good marks.
    pub wrong: String,
    /// Name of the picture.
    pub picture: &'static str,
    /// Name of the set of marks.
    pub marks: &'static str,
    /// `refused` when the fit fails, `no face` or `not trusted` when no reliable face is found, otherwise `held`.
    pub outcome: &'static str,
    /// Messages of the check or of the fit; empty when there are none.
    pub said: String,
}

impl BesideTrial {
    fn is_noticed(&self) -> bool {
        !self.said.is_empty()
    }
}

struct Shot {
    name: &'static str,
    image: GrayImage,
    faces: Vec<LocatedFace>,
    sets: Vec<(&'static str, Vec<Correspondence>)>,
}

/// Checks good and wrong marks of all people against their pictures.
pub fn evaluate_beside(people: &[BesidePerson], locator: &Locator, seed: u64, tick: impl Fn() + Sync) -> Vec<BesideTrial> {
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let fitter = Fitter::new(&wireframe, FitOptions::default());
    let landmark_marks = |points: &FacePoints| match points {
        FacePoints::Landmarks(points) => {
            correspondences_from_landmarks(points, &tables, &LandmarkSelection::Auto).unwrap_or_default()
        }
        FacePoints::Nodes(_) => Vec::new(),
    };
    let shots_of = |index: usize, one: &BesidePerson| -> Vec<Shot> {
        let face = &one.neutral;
        let truth = face.nodes().into_iter().map(|(node, position)| TruthNode { node, position, inner: true }).collect();
        let person = Person::new(face.person.clone(), face.eye_distance(), truth, seed, index as u32);
        let known: Vec<NodeId> = person.truth.iter().map(|t| t.node).collect();
        let mut sets = vec![
            ("11 by hand", marks(&person, &DEFAULT_LANDMARK_NODES)),
            ("5 by hand", marks(&person, &FIVE.map(NodeId))),
            ("64 by hand", marks(&person, &known)),
        ];
        sets.extend(one.landmarks.as_ref().map(|points| ("landmarks", landmark_marks(points))));
        let locate = |image: &GrayImage| locator.locate(image, &LocateOptions::default());
        let mut shots = Vec::new();
        for es in SMALL {
            let factor = es / face.eye_distance();
            let size = |side: u32| (f64::from(side) * factor).round() as u32;
            let small =
                imageops::resize(&face.grey, size(face.grey.width()), size(face.grey.height()), imageops::FilterType::Triangle);
            let [x, y] = [(small.width(), face.grey.width()), (small.height(), face.grey.height())]
                .map(|(s, l)| f64::from(s) / f64::from(l));
            let scaled = |m: &Correspondence| Correspondence {
                position: Point2::new((m.position.x + 0.5) * x - 0.5, (m.position.y + 0.5) * y - 0.5),
                expected_error: m.expected_error.map(|e| e * factor),
                ..*m
            };
            let sets = sets.iter().map(|(name, set)| (*name, set.iter().map(scaled).collect())).collect();
            shots.push(Shot { name: "small", faces: locate(&small), image: small, sets });
        }
        for (name, light, noise) in [("dark", 0.25, 4.0), ("noisy", 1.0, 20.0)] {
            let grainy = grainy(&face.grey, light, noise, seed + index as u64);
            shots.push(Shot { name, faces: locate(&grainy), image: grainy, sets: sets.clone() });
        }
        if let Some((picture, points)) = &one.smile {
            shots.push(Shot {
                name: "smile",
                faces: locate(picture),
                image: picture.clone(),
                sets: vec![("landmarks", landmark_marks(points))],
            });
        }
        shots.push(Shot { name: NEUTRAL, faces: locate(&face.grey), image: face.grey.clone(), sets });
        shots
    };
    let shots: Vec<Vec<Shot>> = people
        .par_iter()
        .enumerate()
        .map(|(index, one)| {
            let shots = shots_of(index, one);
            tick();
            shots
        })
        .collect();
    let judged = |shot: &Shot, set: &[Correspondence]| judged(locator, &fitter, &wireframe, shot, set);
    let of_person = |k: usize| -> Vec<BesideTrial> {
        let place: BTreeMap<NodeId, Point2<f64>> = people[k].neutral.nodes().into_iter().collect();
        let mut trials = Vec::new();
        for shot in &shots[k] {
            for (index, (marks, set)) in shot.sets.iter().enumerate() {
                let mut all = vec![(GOOD.to_owned(), set.clone())];
                all.extend(spoilt(set, &place, shot.name == NEUTRAL));
                if shot.name == NEUTRAL {
                    let others =
                        (1..people.len().min(4)).filter_map(|step| shots[(k + step) % people.len()].last()?.sets.get(index));
                    all.extend(others.map(|(_, set)| ("those of another person".to_owned(), set.clone())));
                }
                trials.extend(all.into_iter().map(|(wrong, set)| {
                    let (outcome, said) = judged(shot, &set);
                    BesideTrial { person: people[k].neutral.person.clone(), wrong, picture: shot.name, marks, outcome, said }
                }));
            }
        }
        trials
    };
    (0..people.len()).into_par_iter().flat_map_iter(of_person).collect()
}

/// Checks the landmarks of the first and the last frame of every sequence against these frames, unchanged and with errors.
///
/// # Errors
/// [`EvaluateError`] when the dataset or a frame cannot be read.
pub fn evaluate_beside_in(
    dataset: &Dataset,
    locator: &Locator,
    tick: impl Fn() + Sync,
) -> Result<Vec<BesideTrial>, EvaluateError> {
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let fitter = Fitter::new(&wireframe, FitOptions::default());
    let of_sequence = |entry: &SequenceEntry| -> Result<Vec<BesideTrial>, EvaluateError> {
        let FrameSource::Images(files) = entry.frames().map_err(DatasetError::from)? else { return Ok(Vec::new()) };
        let mut trials = Vec::new();
        for (name, file) in [("first frame", files.first()), ("last frame", files.last())] {
            let Some(file) = file else { continue };
            // A file of marks belongs to the first frame only.
            if name == "last frame" && entry.landmarks_path()?.is_none() {
                continue;
            }
            let frame = read_frame(&file.path)?;
            let set = entry.correspondences(file.number, &tables, wireframe.node_count(), &LandmarkSelection::Auto)?;
            let faces = locator.locate(frame.image(), &LocateOptions::default());
            let shot = Shot { name, image: frame.image().clone(), faces, sets: Vec::new() };
            let all = std::iter::once((GOOD.to_owned(), set.clone())).chain(spoilt(&set, &BTreeMap::new(), false));
            trials.extend(all.map(|(wrong, set)| {
                let (outcome, said) = judged(locator, &fitter, &wireframe, &shot, &set);
                BesideTrial { person: entry.id.to_string(), wrong, picture: name, marks: "landmarks", outcome, said }
            }));
        }
        tick();
        Ok(trials)
    };
    let trials: Result<Vec<_>, _> = dataset.sequences.par_iter().map(of_sequence).collect();
    Ok(trials?.into_iter().flatten().collect())
}

/// Returns the outcome and the messages of the check for a set of marks.
fn judged(
    locator: &Locator,
    fitter: &Fitter,
    wireframe: &Wireframe,
    shot: &Shot,
    set: &[Correspondence],
) -> (&'static str, String) {
    match fitter.fit(wireframe, set) {
        Err(error) => ("refused", error.to_string()),
        Ok(fitted) => match face_of_marks((locator, &shot.image), set, &fitted, || shot.faces.clone()) {
            None => ("no face", String::new()),
            Some(face) if !face.trusted() => ("not trusted", String::new()),
            Some(face) => ("held", held(&face, set, &fitted).said().join("; ")),
        },
    }
}

/// Returns copies of the marks with deliberate errors, each with the name of its error. `place` holds the hand-set points of the neutral
/// photograph.
fn spoilt(set: &[Correspondence], place: &BTreeMap<NodeId, Point2<f64>>, neutral: bool) -> Vec<(String, Vec<Correspondence>)> {
    let unit = es_of(set);
    let mut all = shifted(set, unit, if neutral { 4 } else { 1 });
    if neutral {
        let scaled = |f: f64| moved(set, |m| Point2::from(m.position.coords * f));
        all.extend(FACTORS.map(|f| (format!("all coordinates times {f}"), scaled(f))));
        let below = |m: &Correspondence| place.get(&NodeId(BROW_ON_LID.iter().find(|pair| pair.0 == m.node.0)?.1)).copied();
        all.push(("brows on the lids".to_owned(), moved(set, |m| below(m).unwrap_or(m.position))));
    }
    let away = |m: &Correspondence, left: Vector2<f64>, right: Vector2<f64>| match m.node.0 {
        31 => m.position + left * unit,
        64 => m.position + right * unit,
        _ => m.position,
    };
    let out = Vector2::new(OUT, 0.0);
    all.push(("mouth corners 15 % out".to_owned(), moved(set, |m| away(m, out, -out))));
    let cheek = Vector2::new(0.2, -0.2);
    all.push(("a mouth corner on the cheek".to_owned(), moved(set, |m| away(m, cheek, Vector2::zeros()))));
    // Drops errors that concern nodes which are not in this set.
    all.retain(|(_, other)| other.iter().zip(set).any(|(a, b)| a.position != b.position));
    all
}

/// Returns the eye distance of a set of marks, px: from the inner and outer corners of the eyes, or from the outer ones alone.
fn es_of(set: &[Correspondence]) -> f64 {
    let at = |node: u16| set.iter().find(|m| m.node.0 == node).map(|m| m.position);
    match (at(20), at(53), at(23), at(56)) {
        (Some(a), Some(b), Some(c), Some(d)) => 0.5 * ((a - b).norm() + (c - d).norm()),
        (Some(a), Some(b), ..) => (a - b).norm() / 1.4,
        _ => 1.0,
    }
}

fn moved(set: &[Correspondence], to: impl Fn(&Correspondence) -> Point2<f64>) -> Vec<Correspondence> {
    set.iter().map(|m| Correspondence { position: to(m), ..*m }).collect()
}

/// Returns copies of the marks shifted by every size in the first `sides` of four directions.
fn shifted(set: &[Correspondence], unit: f64, sides: usize) -> Vec<(String, Vec<Correspondence>)> {
    let ways = [Vector2::x(), Vector2::y(), -Vector2::x(), -Vector2::y()];
    let by = |name: String, px: f64| {
        let one = |way: &Vector2<f64>| (name.clone(), moved(set, |m| m.position + way * px));
        ways[..sides].iter().map(one).collect::<Vec<_>>()
    };
    let px = SHIFTS_PX.map(|px| by(format!("shifted by {px} px"), px));
    let shares = SHIFTS.map(|share| by(format!("shifted by {:.0} %", 100.0 * share), share * unit));
    px.into_iter().chain(shares).flatten().collect()
}

/// Returns the picture darkened by the factor `light`, with Gaussian noise of standard deviation `noise` grey levels.
fn grainy(picture: &GrayImage, light: f64, noise: f64, seed: u64) -> GrayImage {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut out = picture.clone();
    for pixel in out.pixels_mut() {
        // The sum of twelve uniform numbers is approximately normal.
        let sum: f64 = (0..12).map(|_| random.random_range(-0.5..0.5)).sum();
        *pixel = Luma([(f64::from(pixel[0]) * light + noise * sum).round().clamp(0.0, 255.0) as u8]);
    }
    out
}

/// Returns a table of all trials with the columns `person`, `picture`, `marks`, `wrong`, `outcome` and `said`.
#[must_use]
pub fn beside_trials(trials: &[BesideTrial]) -> Table {
    let mut table = Table::new(["person", "picture", "marks", "wrong", "outcome", "said"]);
    let row = |t: &BesideTrial| [&*t.person, t.picture, t.marks, &*t.wrong, t.outcome, &*t.said].map(Cell::text).to_vec();
    table.rows = trials.iter().map(row).collect();
    table
}

/// Returns a table by error, picture and set of marks: people, sets of marks, sets whose face was not read, and sets with a message.
#[must_use]
pub fn beside_table(trials: &[BesideTrial]) -> Table {
    let mut table = Table::new(["wrong", "picture", "marks", "people", "sets", "not_read", "noticed", "percent_noticed"]);
    let mut kinds: BTreeMap<(&str, &str, &str), Vec<&BesideTrial>> = BTreeMap::new();
    for trial in trials {
        kinds.entry((&trial.wrong, trial.picture, trial.marks)).or_default().push(trial);
        kinds.entry((&trial.wrong, "all", "all")).or_default().push(trial);
    }
    for ((wrong, picture, marks), of_kind) in kinds {
        let mut people: Vec<&str> = of_kind.iter().map(|t| t.person.as_str()).collect();
        people.dedup();
        let noticed = of_kind.iter().filter(|t| t.is_noticed()).count();
        table.rows.push(vec![
            Cell::text(wrong),
            Cell::text(picture),
            Cell::text(marks),
            Cell::Count(people.len()),
            Cell::Count(of_kind.len()),
            Cell::Count(of_kind.iter().filter(|t| matches!(t.outcome, "no face" | "not trusted")).count()),
            Cell::Count(noticed),
            Cell::Number(100.0 * noticed as f64 / of_kind.len() as f64, 1),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_counts_what_was_noticed() {
        let trial = |person: &str, wrong: &str, outcome, said: &str| BesideTrial {
            person: person.to_owned(),
            wrong: wrong.to_owned(),
            picture: NEUTRAL,
            marks: "5 by hand",
            outcome,
            said: said.to_owned(),
        };
        let trials = [
            trial("a", GOOD, "held", ""),
            trial("a", "shifted", "held", "the marks lie"),
            trial("b", "shifted", "not trusted", ""),
        ];
        let table = beside_table(&trials);
        let row = table.rows.iter().find(|row| row[0] == Cell::text("shifted") && row[1] == Cell::text(NEUTRAL)).unwrap();
        assert_eq!(row[3..], [Cell::Count(2), Cell::Count(2), Cell::Count(1), Cell::Count(1), Cell::Number(50.0, 1)]);
    }

    #[test]
    fn marks_are_spoilt_as_named() {
        let set = [(20, 140.0, 100.0), (53, 0.0, 100.0), (31, 100.0, 200.0), (64, 40.0, 200.0)]
            .map(|(node, x, y)| Correspondence::mark(NodeId(node), Point2::new(x, y)));
        // 140 px between the outer corners are 100 between the pupils.
        assert!((es_of(&set) - 100.0).abs() < 1e-9);
        let all = spoilt(&set, &BTreeMap::new(), true);
        let of = |name: &str| &all.iter().find(|(wrong, _)| wrong == name).unwrap().1;
        assert_eq!(of("mouth corners 15 % out")[2].position, Point2::new(115.0, 200.0));
        assert_eq!(of("mouth corners 15 % out")[3].position, Point2::new(25.0, 200.0));
        assert_eq!(of("all coordinates times 0.75")[0].position, Point2::new(105.0, 75.0));
        assert!(all.iter().all(|(wrong, _)| wrong != "brows on the lids"));
    }
}
