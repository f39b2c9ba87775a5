//! Expected against true errors of fitted nodes, on people whom neither priors nor locator have seen.
//!
//! The people are divided into five parts, and each part is fitted with priors learned from the other four. Fits start from many kinds of
//! marks: 3 to all hand-set points, with the errors of hand-set marks, and points from a locator that has not seen the people, when one is
//! given. Every node with a known position is compared.

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

/// Number of parts of the cross-validation.
const PARTS: usize = 5;
/// Numbers of marks for every choice.
const COUNTS: [usize; 6] = [3, 5, 7, 11, 15, 25];
/// Standard deviation, in x and in y, of a hand-set mark at a node that is not in the list of markable nodes, relative to the eye distance.
const OTHER_DEVIATION: f64 = 0.016;
/// Name of the fits to points that the locator found.
pub const FOUND: &str = "found marks";
/// Name of the fits to hand-set marks, with unmarked nodes read from the picture.
pub const SET_AND_READ: &str = "7 and 11 set marks, others read";
/// Name of the same fits from the hand-set marks alone.
pub const SET_ALONE: &str = "7 and 11 set marks, of these people";
/// Number of bins of the calibration from the other parts.
const BINS: usize = 8;
/// Lower limit of the true error before its logarithm is taken, relative to the eye distance.
const FLOOR: f64 = 1e-4;

/// Errors of one node of a fitted face.
#[derive(Clone, Debug)]
pub struct PlacementSample {
    /// Kind of the marks.
    pub marks: &'static str,
    /// Index of the part that the person belongs to, 0 to 4.
    pub part: usize,
    /// Spread of the node's position that the fit leaves open, relative to the eye distance.
    pub spread: f64,
    /// Expected error, relative to the eye distance.
    pub expected: f64,
    /// True error, relative to the eye distance.
    pub error: f64,
}

/// Results of all fits.
#[derive(Clone, Debug, Default)]
pub struct Placements {
    /// Samples of all nodes of all fits.
    pub samples: Vec<PlacementSample>,
    /// Fits that refused their marks, with person, kind and reason; there should be none.
    pub refused: Vec<String>,
    /// For every fit of [`SET_AND_READ`]: whether unmarked nodes were read from the picture.
    pub read: Vec<bool>,
}

/// Fits all faces from many kinds of marks, with priors learned from other people.
///
/// `landmarks` holds the landmarks of a network on the same people; people without landmarks are left out of that prior. The locator of
/// `found` is used only for the people named there, whom it has not seen.
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
                    // These marks were fitted above, so a failure is in the list of refused marks already.
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

/// Returns marks with the errors of hand-set marks.
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

/// Returns the knots of the calibration: logarithms of spread and of median error.
#[must_use]
pub fn placement_knots<'a>(samples: impl Iterator<Item = &'a PlacementSample>, bins: usize) -> Vec<(f64, f64)> {
    calibrate(samples.map(|s| (s.spread.ln(), s.error.max(FLOOR).ln())).collect(), bins)
}

/// Returns expected and true errors by fifths, for each kind of marks and for all hand-set marks. The rows `all set by hand, others` use,
/// for each part of the people, the calibration from the other four parts.
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

/// Returns the errors of all nodes for fits to 7 and 11 hand-set marks, without and with unmarked nodes read from the picture, in percent
/// of the eye distance.
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
        // The spreads, 1 to 6 %, are twice the error, and the expected error equals the spread.
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
