//! How far fitted nodes are expected to sit from their place on the face, against how far they do: on people whom neither priors nor
//! locator have seen.
//!
//! The people are dealt into five parts. Each part is fitted by priors learned from the other four, from marks of many kinds: hand-set
//! points with the errors that hand-set marks have, from three of them to all, and, where a locator is given that has not seen the people,
//! points that were found. What is compared is every node that is known.

use std::collections::{BTreeMap, BTreeSet};

use grimace::internal::{
    fit::{Correspondence, DEFAULT_MODES, FacePoints, FittedWireframe, Fitter, NeutralFace, learn_prior, placement},
    locate::{LocateOptions, Locator, learn::TrainingFace},
    pipeline::{by_hand, fit_beside},
    units::NodeId,
    wireframe::{MarkableNode, Tables, Wireframe, markable_nodes},
};
use rayon::prelude::*;

use super::{
    CalibrationPart, EvaluateError, ExpectedError, MarkNoise, Person, QUINTILES, TruthNode, calibration, calibration_rows,
    calibration_table,
    confidence::calibrate,
    standard_choices,
    table::{Cell, Table},
};

/// Parts the people are dealt into.
const PARTS: usize = 5;
/// Numbers of marks tried of every choice.
const COUNTS: [usize; 6] = [3, 5, 7, 11, 15, 25];
/// Standard deviation in x and in y of a hand-set mark at a node that is not in the list of markable ones, over the eye distance.
const OTHER_DEVIATION: f64 = 0.016;
/// Kind of the marks that were found.
pub const FOUND: &str = "found marks";
/// Kind of the marks that were set by hand, with what is read where there is none.
pub const SET_AND_READ: &str = "7 and 11 set marks, others read";
/// The same fits by their marks alone.
pub const SET_ALONE: &str = "7 and 11 set marks, of these people";
/// Parts of the calibration when it is judged.
const BINS: usize = 8;
/// Smallest true error that is told from none, over the eye distance.
const FLOOR: f64 = 1e-4;

/// A node of a fitted face.
#[derive(Clone, Debug)]
pub struct PlacementSample {
    /// What the fit was made from.
    pub marks: &'static str,
    /// Part of the people, 0 to 4.
    pub part: usize,
    /// What the fit left open, over the eye distance.
    pub spread: f64,
    /// What it expected, over the eye distance.
    pub expected: f64,
    /// How far the node was off, over the eye distance.
    pub error: f64,
}

/// What became of all fits.
#[derive(Clone, Debug, Default)]
pub struct Placements {
    /// The nodes of the fits.
    pub samples: Vec<PlacementSample>,
    /// Marks that were refused: who, which, and why. None should be.
    pub refused: Vec<String>,
    /// Of every fit to marks set by hand of people whom the locator has not seen, whether nodes without a mark were read.
    pub read: Vec<bool>,
}

/// Fits the faces in many ways by priors that have not seen them. `landmarks` are the same people as a network's landmarks have them; a
/// person without is left out of that prior. `locator` serves for the people in `found` alone.
///
/// # Errors
/// [`EvaluateError`] when there are too few people to learn from.
pub fn placement_samples(
    faces: &[TrainingFace],
    landmarks: &[NeutralFace],
    found: Option<(&Locator, &BTreeSet<String>)>,
    seed: u64,
) -> Result<Placements, EvaluateError> {
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let set_by_hand: Vec<NeutralFace> =
        faces.iter().map(|f| NeutralFace { name: f.person.clone(), points: FacePoints::Nodes(f.nodes()) }).collect();
    let part_of: BTreeMap<&str, usize> = faces.iter().enumerate().map(|(k, f)| (f.person.as_str(), k % PARTS)).collect();
    let mut out = Placements::default();
    for part in 0..PARTS {
        let others = |all: &[NeutralFace]| -> Vec<NeutralFace> {
            all.iter().filter(|f| part_of.get(f.name.as_str()).is_some_and(|p| *p != part)).cloned().collect()
        };
        let learn = |all: &[NeutralFace]| learn_prior(&wireframe, &tables, &others(all), DEFAULT_MODES);
        let fitter = Fitter::with_faces(&wireframe, learn(landmarks)?, learn(&set_by_hand)?)?;
        let of_part: Vec<(usize, &TrainingFace)> = faces.iter().enumerate().filter(|(k, _)| k % PARTS == part).collect();
        let sampled = of_part.par_iter().map(|(index, face)| {
            let person = person(face, seed, *index);
            let mut placed = Placements::default();
            let mut add = |name: &'static str, marks: &[Correspondence]| match fitter.fit(&wireframe, marks) {
                Ok(fitted) => placed.samples.extend(samples_of(name, part, &fitted, &person)),
                Err(why) => placed.refused.push(format!("{}, {name}, {} of them: {why}", face.person, marks.len())),
            };
            for choice in standard_choices(&tables) {
                for count in COUNTS {
                    let Some(nodes) = choice.nodes(&person, *index as u32, count, seed) else { continue };
                    let name = if count < 7 {
                        "3 and 5 set marks"
                    } else if count < 15 {
                        "7 and 11 set marks"
                    } else {
                        "more set marks"
                    };
                    add(name, &marks(&person, &nodes));
                }
            }
            add("all set marks", &marks(&person, &person.truth.iter().map(|t| t.node).collect::<Vec<_>>()));
            if let Some((locator, _)) = found.filter(|(_, people)| people.contains(&face.person)) {
                let seen = locator.locate(&face.grey, &LocateOptions::default());
                let found =
                    seen.first().map(|f| f.points.iter().map(|p| Correspondence::found(p.node, p.position, p.expected_error)));
                add(FOUND, &found.into_iter().flatten().collect::<Vec<_>>());
                for (choice, count) in standard_choices(&tables).iter().flat_map(|c| [(c, 7), (c, 11)]) {
                    let Some(nodes) = choice.nodes(&person, *index as u32, count, seed) else { continue };
                    let marks = marks(&person, &nodes);
                    // Refused marks are named above.
                    let Ok(fitted) = fitter.fit(&wireframe, &marks) else { continue };
                    placed.samples.extend(samples_of(SET_ALONE, part, &fitted, &person));
                    let counts = by_hand(&fitter, &wireframe, &marks);
                    let find = || locator.locate(&face.grey, &LocateOptions::default());
                    let fit = |marks: &[Correspondence]| fitter.fit(&wireframe, marks);
                    let read = fit_beside(fit, fitted, counts, (locator, &face.grey), find).fitted;
                    placed.read.push(!read.read.is_empty());
                    placed.samples.extend(samples_of(SET_AND_READ, part, &read, &person));
                }
            }
            placed
        });
        for placed in sampled.collect::<Vec<_>>() {
            out.samples.extend(placed.samples);
            out.refused.extend(placed.refused);
            out.read.extend(placed.read);
        }
    }
    Ok(out)
}

fn person(face: &TrainingFace, seed: u64, index: usize) -> Person {
    let truth = face.nodes().into_iter().map(|(node, position)| TruthNode { node, position, inner: true }).collect();
    Person::new(face.person.clone(), face.eye_distance(), truth, seed, index as u32)
}

/// Marks with the errors of hand-set ones.
pub(super) fn marks(person: &Person, nodes: &[NodeId]) -> Vec<Correspondence> {
    let mut markable = markable_nodes().to_vec();
    let others = person.truth.iter().map(|t| t.node).filter(|n| markable.iter().all(|m| m.node != *n)).collect::<Vec<_>>();
    markable.extend(others.into_iter().map(|node| MarkableNode {
        node,
        deviation_es: OTHER_DEVIATION,
        description: String::new(),
    }));
    nodes.iter().filter_map(|&node| person.mark(node, MarkNoise::Reliability(&markable))).collect()
}

fn samples_of(marks: &'static str, part: usize, fitted: &FittedWireframe, person: &Person) -> Vec<PlacementSample> {
    let (Some(spreads), Some(expected)) = (&fitted.spreads, fitted.expected_errors()) else { return Vec::new() };
    let es = person.eye_distance;
    let sample = |t: &TruthNode| PlacementSample {
        marks,
        part,
        spread: spreads[t.node.index()],
        expected: expected[t.node.index()] / es,
        error: (fitted.model.nodes()[t.node.index()] - t.position).norm() / es,
    };
    person.truth.iter().map(sample).collect()
}

/// Knots of the calibration: logarithms of spread and median error.
#[must_use]
pub fn placement_knots<'a>(samples: impl Iterator<Item = &'a PlacementSample>, bins: usize) -> Vec<(f64, f64)> {
    calibrate(samples.map(|s| (s.spread.ln(), s.error.max(FLOOR).ln())).collect(), bins)
}

/// Expected and true errors by fifths, for each kind of marks and for all set by hand; for these also as the other four parts of the people
/// calibrate them.
#[must_use]
pub fn placement_table(samples: &[PlacementSample]) -> Table {
    let pair = |expected: f64, s: &PlacementSample| ExpectedError { expected: 100.0 * expected, truth: 100.0 * s.error, px: 1.0 };
    let mut kinds: BTreeMap<&str, Vec<ExpectedError>> = BTreeMap::new();
    for s in samples {
        kinds.entry(s.marks).or_default().push(pair(s.expected, s));
    }
    let set = || samples.iter().filter(|s| ![FOUND, SET_AND_READ, SET_ALONE].contains(&s.marks));
    kinds.insert("all set by hand", set().map(|s| pair(s.expected, s)).collect());
    let others = (0..PARTS).flat_map(|part| {
        let knots = placement_knots(set().filter(move |s| s.part != part), BINS);
        let of_part = set().filter(move |s| s.part == part);
        of_part.map(|s| pair(placement::between(&knots, s.spread.ln()).exp(), s)).collect::<Vec<_>>()
    });
    kinds.insert("all set by hand, others", others.collect());
    let mut table = calibration_table();
    for (kind, errors) in kinds {
        let parts: Vec<CalibrationPart> = calibration(errors, QUINTILES);
        table.rows.extend(calibration_rows(kind, &parts));
    }
    table
}

/// How far all nodes are off where seven or eleven marks are set, by these alone and with what is read beside them: percent of the eye distance.
#[must_use]
pub fn unmarked_table(samples: &[PlacementSample]) -> Table {
    let mut table = Table::new(["marks", "nodes", "mean", "median", "percentile_95"]);
    for kind in [SET_ALONE, SET_AND_READ] {
        let mut errors: Vec<f64> = samples.iter().filter(|s| s.marks == kind).map(|s| 100.0 * s.error).collect();
        errors.sort_by(f64::total_cmp);
        let at = |share: f64| errors.get((share * errors.len() as f64) as usize).copied().unwrap_or(f64::NAN);
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let numbers = [mean, at(0.5), at(0.95)].map(|n| Cell::Number(n, 2));
        table.rows.push([vec![Cell::Text(kind.to_owned()), Cell::Count(errors.len())], numbers.to_vec()].concat());
    }
    table
}

#[cfg(test)]
mod tests {
    use super::{super::Cell, *};

    #[test]
    fn the_calibration_of_others_makes_up_for_spreads_that_are_too_large() {
        // Spreads of 1 to 6 % that are twice the error; what the fit expects is the spread.
        let sample = |k: usize| {
            let spread = 0.01 * (1.0 + 5.0 * k as f64 / 499.0);
            PlacementSample { marks: "all set marks", part: k % PARTS, spread, expected: spread, error: spread / 2.0 }
        };
        let samples: Vec<PlacementSample> = (0..500).map(sample).collect();
        for (spread, error) in placement_knots(samples.iter(), 4) {
            assert!((spread - error - std::f64::consts::LN_2).abs() < 1e-9);
        }
        let table = placement_table(&samples);
        let ratios = |kind: &str| -> Vec<f64> {
            let rows = table.rows.iter().filter(|row| row[0] == Cell::text(kind));
            rows.map(|row| if let Cell::Number(ratio, _) = row[5] { ratio } else { f64::NAN }).collect()
        };
        assert!(ratios("all set by hand").iter().all(|r| (r - 2.0).abs() < 0.01));
        let by_others = ratios("all set by hand, others");
        assert!(by_others.len() == QUINTILES && by_others.iter().all(|r| (r - 1.0).abs() < 0.02), "{by_others:?}");
    }
}
