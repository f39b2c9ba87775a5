//! Accuracy of the locator: compares found points with hand-set points, and expected with true errors.

use std::collections::BTreeMap;

use grimace::internal::locate::{LEAST_SCORE, LocateOptions, LocatedFace, Locator, PUPILS, learn::TrainingFace, points};
use nalgebra::Point2;
use rayon::prelude::*;

use super::table::{Cell, Table};

/// A face with hand-set points, and the locator's result for it.
#[derive(Clone, Debug)]
pub struct LocatedPerson {
    /// Name of the person.
    pub person: String,
    /// The largest face found, if any.
    pub face: Option<LocatedFace>,
    /// Error of every point, percent of the eye distance; empty when no face was found.
    pub errors: Vec<f64>,
    /// Expected error of every point, percent of the true eye distance.
    pub expected: Vec<f64>,
}

/// A face whose mean error exceeds this value is grossly wrong, percent of the eye distance.
pub const GROSS: f64 = 10.0;

/// Locates every person's face in their picture.
pub fn evaluate_locate(faces: &[TrainingFace], locator: &Locator, tick: impl Fn() + Sync) -> Vec<LocatedPerson> {
    let one = |training: &TrainingFace| {
        let truth: Vec<Point2<f64>> = training.shape.iter().map(|p| Point2::new(f64::from(p[0]), f64::from(p[1]))).collect();
        let eye_distance = (truth[PUPILS[0]] - truth[PUPILS[1]]).norm();
        let face = locator.locate(&training.grey, &LocateOptions::default()).into_iter().next();
        let percent = |distance: f64| 100.0 * distance / eye_distance;
        let errors =
            face.iter().flat_map(|f| f.shape.iter().zip(&truth).map(|(p, t)| percent((p - t).norm())).collect::<Vec<_>>());
        let expected = face.iter().flat_map(|f| f.expected_errors.iter().map(|&e| percent(e)).collect::<Vec<_>>());
        let (errors, expected) = (errors.collect(), expected.collect());
        tick();
        LocatedPerson { person: training.person.clone(), face, errors, expected }
    };
    faces.par_iter().map(one).collect()
}

/// Returns a table of the errors by group of people and part of the face, in percent of the eye distance.
///
/// Columns: `group`, `part`, number of faces, mean, 95th percentile, worst, and the person with the worst error.
pub fn locate_table(people: &[LocatedPerson], group_of: &BTreeMap<String, String>) -> Table {
    let mut groups: Vec<&str> = group_of.values().map(String::as_str).collect();
    groups.sort_unstable();
    groups.dedup();
    let mut parts: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    points().iter().enumerate().for_each(|(k, point)| parts.entry(&point.group).or_default().push(k));
    let mut table = Table::new(["group", "part", "faces", "mean", "percentile_95", "worst", "worst_person"]);
    for group in std::iter::once("all").chain(groups.into_iter().filter(|g| *g != "all")) {
        let members: Vec<&LocatedPerson> = people
            .iter()
            .filter(|p| !p.errors.is_empty() && (group == "all" || group_of.get(&p.person).is_some_and(|g| g == group)))
            .collect();
        for (part, indices) in &parts {
            let mean = |p: &LocatedPerson| indices.iter().map(|&k| p.errors[k]).sum::<f64>() / indices.len() as f64;
            let mut errors: Vec<(f64, &str)> = members.iter().map(|p| (mean(p), p.person.as_str())).collect();
            errors.sort_by(|a, b| a.0.total_cmp(&b.0));
            let Some(worst) = errors.last() else { continue };
            table.rows.push(vec![
                Cell::text(group),
                Cell::text(*part),
                Cell::Count(errors.len()),
                Cell::Number(errors.iter().map(|e| e.0).sum::<f64>() / errors.len() as f64, 2),
                Cell::Number(errors[(errors.len() - 1) * 95 / 100].0, 2),
                Cell::Number(worst.0, 2),
                Cell::text(worst.1),
            ]);
        }
    }
    table
}

/// Returns the expected and true median errors by fifths of the points in order of expected error, percent of the eye distance.
pub fn locate_calibration(people: &[LocatedPerson]) -> Table {
    let mut pairs: Vec<(f64, f64)> =
        people.iter().flat_map(|p| p.expected.iter().copied().zip(p.errors.iter().copied())).collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut table = Table::new(["fifth", "points", "expected", "real"]);
    for (k, part) in pairs.chunks(pairs.len().div_ceil(5).max(1)).enumerate() {
        let median = |mut values: Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        table.rows.push(vec![
            Cell::Count(k + 1),
            Cell::Count(part.len()),
            Cell::Number(median(part.iter().map(|p| p.0).collect()), 2),
            Cell::Number(median(part.iter().map(|p| p.1).collect()), 2),
        ]);
    }
    table
}

/// Returns the numbers of missed faces, and of accepted faces that are grossly wrong ([`GROSS`]) or not trusted.
pub fn locate_failures(people: &[LocatedPerson]) -> [usize; 3] {
    let mean = |p: &LocatedPerson| p.errors.iter().sum::<f64>() / p.errors.len().max(1) as f64;
    let accepted = |p: &&LocatedPerson| p.face.as_ref().is_some_and(|f| f.score >= f64::from(LEAST_SCORE));
    [
        people.iter().filter(|p| p.face.is_none()).count(),
        people.iter().filter(accepted).filter(|p| mean(p) > GROSS).count(),
        people.iter().filter(accepted).filter(|p| p.face.as_ref().is_some_and(|f| !f.trusted())).count(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_have_the_mean_and_the_worst() {
        let person = |name: &str, error: f64| LocatedPerson {
            person: name.to_owned(),
            face: None,
            errors: vec![error; points().len()],
            expected: vec![error / 2.0; points().len()],
        };
        let people = [person("a", 1.0), person("b", 4.0)];
        let groups = BTreeMap::from([("a".to_owned(), "x".to_owned())]);
        let table = locate_table(&people, &groups);
        assert_eq!(
            table.rows[0][2..],
            [Cell::Count(2), Cell::Number(2.5, 2), Cell::Number(1.0, 2), Cell::Number(4.0, 2), Cell::text("b")]
        );
        assert!(table.rows.iter().any(|row| row[0] == Cell::text("x") && row[5] == Cell::Number(1.0, 2)));
        assert_eq!(locate_calibration(&people).rows.len(), 5);
        assert_eq!(locate_failures(&people), [2, 0, 0]);
    }
}
