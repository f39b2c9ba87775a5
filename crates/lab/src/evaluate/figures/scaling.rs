//! Test of a claim in [KP, section 2]: a model 1.5 times too large or too small needs 15 marks; a model that is scaled first needs 5 to 8.

use nalgebra::{Point2, Vector2};

use super::super::{Cell, EvaluateError, MarkChoice, MarkNoise, Person, Population, Table};
use grimace::internal::{
    fit::{DrivenNode, FIT_FORCE, FitOptions, Fitter, PriorKind, Pull, Springs},
    geometry::Similarity,
    wireframe::Wireframe,
};

/// Mean errors of the fit by springs for one number of marks, percent of the eye distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScalingRow {
    /// Number of marks.
    pub marks: usize,
    /// Error when the model is scaled to the marks first.
    pub scaled: f64,
    /// Error when the model is 1.5 times too large.
    pub too_large: f64,
    /// Error when the model is 1.5 times too small.
    pub too_small: f64,
}

/// Factor by which the model is too large or too small [KP].
const FACTOR: f64 = 1.5;

/// Returns the errors of the fit by springs alone, with and without scaling first, for several numbers of marks of a choice.
///
/// # Errors
/// [`EvaluateError::Figure`] when marks do not determine a fit.
pub fn scaling_rows(
    population: &Population,
    choice: &MarkChoice,
    counts: &[usize],
    wireframe: &Wireframe,
    (marks_noise_px, seed): (f64, u64),
) -> Result<Vec<ScalingRow>, EvaluateError> {
    let springs = Springs::new(wireframe);
    let fitter = Fitter::new(wireframe, FitOptions { prior: PriorKind::None, ..FitOptions::default() });
    let failed = super::failed("the claim of the scaling");
    let mut rows = Vec::new();
    for &count in counts {
        let mut sums = [0.0; 3];
        let mut people = 0usize;
        for (index, person) in population.people.iter().enumerate() {
            let Some(nodes) = choice.nodes(person, index as u32, count, seed) else { continue };
            let marks: Vec<_> = nodes.iter().filter_map(|&n| person.mark(n, MarkNoise::Uniform(marks_noise_px))).collect();
            let scaled = fitter.fit(wireframe, &marks).map_err(|e| failed(&e))?;
            // Frontal wireframe in the image, y down; below it is scaled by 1.5 or 1 / 1.5 about the middle of the marks.
            let frontal: Vec<Point2<f64>> = wireframe.frontal().iter().map(|p| Point2::new(p.x, -p.y)).collect();
            let source: Vec<_> = marks.iter().map(|m| frontal[m.node.index()]).collect();
            let seen: Vec<_> = marks.iter().map(|m| m.position).collect();
            let placed = Similarity::fit(&source, &seen, None).map_err(|e| failed(&e))?;
            let middle: Vector2<f64> = seen.iter().map(|p| p.coords).sum::<Vector2<f64>>() / seen.len() as f64;
            let targets: Vec<DrivenNode> =
                marks.iter().map(|m| DrivenNode { node: m.node, position: m.position, pull: Pull::Force(FIT_FORCE) }).collect();
            let unscaled = |factor: f64| -> Result<f64, EvaluateError> {
                let rest: Vec<Point2<f64>> =
                    frontal.iter().map(|p| Point2::from(middle + (placed.apply(p).coords - middle) * factor)).collect();
                Ok(error(person, &springs.deform(wireframe, &rest, &targets).map_err(|e| failed(&e))?))
            };
            sums[0] += error(person, scaled.model.nodes());
            sums[1] += unscaled(FACTOR)?;
            sums[2] += unscaled(1.0 / FACTOR)?;
            people += 1;
        }
        if people > 0 {
            let [scaled, too_large, too_small] = sums.map(|sum| sum / people as f64);
            rows.push(ScalingRow { marks: count, scaled, too_large, too_small });
        }
    }
    Ok(rows)
}

/// Returns the mean distance to the true positions, percent of the eye distance.
fn error(person: &Person, nodes: &[Point2<f64>]) -> f64 {
    let sum: f64 = person.truth.iter().map(|t| (nodes[t.node.index()] - t.position).norm()).sum();
    100.0 * sum / person.truth.len() as f64 / person.eye_distance
}

/// Returns a table of the rows.
pub fn scaling_table(rows: &[ScalingRow]) -> Table {
    let mut table = Table::new(["marks", "scaled_first_percent_es", "too_large_percent_es", "too_small_percent_es"]);
    for row in rows {
        let numbers = [row.scaled, row.too_large, row.too_small].map(|v| Cell::Number(v, 2));
        table.rows.push([Cell::Count(row.marks)].into_iter().chain(numbers).collect());
    }
    table
}
