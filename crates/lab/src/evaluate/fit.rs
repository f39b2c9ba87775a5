//! Error of the fit by number and choice of marks, for every fit method.
//!
//! People with known nodes are marked at 3 to 15 nodes and fitted; the error of a node is its distance to its true position. For simulated
//! people the marks have Gaussian errors and all live nodes are compared. For real people, whose landmarks are known, the marks are
//! landmarks and only the *other* landmarks are compared.

use nalgebra::Point2;
use rayon::prelude::*;

use super::{Cell, ErrorSummary, EvaluateError, LineChart, MarkChoice, MarkNoise, Person, Population, Series, Table};
use grimace::internal::{
    fit::{Correspondence, FitError, FitOptions, Fitter, PriorKind},
    geometry::Similarity,
    units::NodeId,
    wireframe::Wireframe,
};

/// A method to fit the wireframe to marks.
#[derive(Clone, Debug)]
pub struct FitMethod {
    /// Name in tables and figures.
    pub name: String,
    solver: Solver,
}

#[derive(Clone, Debug)]
enum Solver {
    /// The least-squares similarity alone: the scaling step of KP.
    Similarity(Vec<Point2<f64>>),
    /// A complete fit.
    Fit(Box<Fitter>),
}

impl FitMethod {
    /// Returns the method that fits the similarity alone.
    pub fn similarity(wireframe: &Wireframe) -> Self {
        let frontal = wireframe.frontal().iter().map(|p| Point2::new(p.x, -p.y)).collect();
        Self { name: "similarity".to_owned(), solver: Solver::Similarity(frontal) }
    }

    /// Returns a complete fit with options.
    pub fn fit_with(name: impl Into<String>, wireframe: &Wireframe, options: FitOptions) -> Self {
        Self { name: name.into(), solver: Solver::Fit(Box::new(Fitter::new(wireframe, options))) }
    }

    /// Returns the standard methods: similarity alone, springs alone, and every shape prior followed by the springs.
    pub fn standard(wireframe: &Wireframe) -> Vec<Self> {
        let fit = |name: &str, prior| Self::fit_with(name, wireframe, FitOptions { prior, ..FitOptions::default() });
        vec![
            Self::similarity(wireframe),
            fit("springs", PriorKind::None),
            fit("candide prior", PriorKind::Candide),
            fit("faces prior", PriorKind::Faces),
            fit("auto prior", PriorKind::Auto),
        ]
    }

    /// Returns the name in [`FitMethod::standard`] of the program's default method.
    pub fn default_name() -> &'static str {
        match FitOptions::default().prior {
            PriorKind::None => "springs",
            PriorKind::Candide => "candide prior",
            PriorKind::Faces => "faces prior",
            PriorKind::Auto | PriorKind::File(_) => "auto prior",
        }
    }

    /// Returns the positions of all N nodes, px.
    ///
    /// # Errors
    /// [`FitError`] when the marks do not determine the fit.
    pub fn place(&self, wireframe: &Wireframe, marks: &[Correspondence]) -> Result<Vec<Point2<f64>>, FitError> {
        match &self.solver {
            Solver::Similarity(frontal) => {
                let source: Vec<_> = marks.iter().map(|m| frontal[m.node.index()]).collect();
                let target: Vec<_> = marks.iter().map(|m| m.position).collect();
                let image_from_face = Similarity::fit(&source, &target, None)?;
                Ok(frontal.iter().map(|p| image_from_face.apply(p)).collect())
            }
            Solver::Fit(fitter) => Ok(fitter.fit(wireframe, marks)?.model.nodes().to_vec()),
        }
    }
}

/// The nodes that a row compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FitArea {
    /// All nodes with a known position: the live nodes of simulated people, or all known landmarks of real people.
    All,
    /// The nodes of the inner face, landmarks 17 to 67.
    Inner,
}

impl FitArea {
    /// Returns the name of the area in tables.
    pub fn name(self, population: &Population) -> &'static str {
        match (self, population.real) {
            (Self::All, false) => "live nodes",
            (Self::All, true) => "other landmarks",
            (Self::Inner, _) => "other inner-face landmarks",
        }
    }
}

/// Inputs of the experiment.
#[derive(Clone, Debug)]
pub struct FitStudy<'a> {
    /// The wireframe.
    pub wireframe: &'a Wireframe,
    /// Populations of people with known nodes.
    pub populations: Vec<Population>,
    /// Fit methods.
    pub methods: Vec<FitMethod>,
    /// Ways to choose marks.
    pub choices: Vec<MarkChoice>,
    /// Numbers of marks.
    pub counts: Vec<usize>,
    /// Standard deviation of the errors of the marks of simulated people, px.
    pub marks_noise_px: f64,
    /// Seed of the random choices.
    pub seed: u64,
}

/// Result for one population, area, method, choice and number of marks.
#[derive(Clone, Debug, PartialEq)]
pub struct FitRow {
    /// Name of the population.
    pub population: String,
    /// Name of the area.
    pub area: &'static str,
    /// Name of the method.
    pub method: String,
    /// Name of the choice.
    pub choice: String,
    /// Number of marks.
    pub marks: usize,
    /// The marked nodes, when they are the same for all people.
    pub nodes: Vec<NodeId>,
    /// Number of fitted people.
    pub people: usize,
    /// Number of people whose marks did not determine a fit; they are not part of the errors.
    pub failed: usize,
    /// Errors over all people and nodes, px.
    pub px: ErrorSummary,
    /// The same errors in percent of the eye distance.
    pub percent: ErrorSummary,
}

/// Errors of one person: px, and whether the node belongs to the inner face.
type PersonErrors = Vec<(f64, bool)>;

/// Returns the node errors of a fit, without the marked nodes when `others_only` is set. Returns `None` when the marks do not determine a
/// fit.
pub(super) fn person_errors(
    wireframe: &Wireframe,
    method: &FitMethod,
    person: &Person,
    marked: &[NodeId],
    noise: MarkNoise,
    others_only: bool,
) -> Option<PersonErrors> {
    let marks: Vec<Correspondence> = marked.iter().filter_map(|&n| person.mark(n, noise)).collect();
    let nodes = method.place(wireframe, &marks).ok()?;
    let compared = person.truth.iter().filter(|t| !(others_only && marked.contains(&t.node)));
    Some(compared.map(|t| ((nodes[t.node.index()] - t.position).norm(), t.inner)).collect())
}

/// Runs the experiment. `progress` is called with the number of finished rows and of all rows, and may return `false` to stop.
///
/// # Errors
/// [`EvaluateError::Interrupted`].
pub fn evaluate_fit(study: &FitStudy, mut progress: impl FnMut(usize, usize) -> bool) -> Result<Vec<FitRow>, EvaluateError> {
    let total = study.populations.len() * study.choices.len() * study.counts.len() * study.methods.len();
    let mut done = 0;
    let mut rows = Vec::new();
    for population in &study.populations {
        let noise = MarkNoise::Uniform(if population.real { 0.0 } else { study.marks_noise_px });
        for choice in &study.choices {
            for &count in &study.counts {
                let marked: Option<Vec<Vec<NodeId>>> =
                    population.people.iter().zip(0..).map(|(p, k)| choice.nodes(p, k, count, study.seed)).collect();
                for method in &study.methods {
                    done += 1;
                    if !progress(done, total) {
                        return Err(EvaluateError::Interrupted);
                    }
                    // A choice with fewer nodes than this count has no row.
                    let Some(marked) = &marked else { continue };
                    let errors: Vec<Option<PersonErrors>> = population
                        .people
                        .par_iter()
                        .zip(marked)
                        .map(|(person, nodes)| person_errors(study.wireframe, method, person, nodes, noise, population.real))
                        .collect();
                    let row = |area| fit_row(population, method, choice, marked, &errors, area);
                    rows.extend(row(FitArea::All));
                    if population.real {
                        rows.extend(row(FitArea::Inner));
                    }
                }
            }
        }
    }
    Ok(rows)
}

fn fit_row(
    population: &Population,
    method: &FitMethod,
    choice: &MarkChoice,
    marked: &[Vec<NodeId>],
    errors: &[Option<PersonErrors>],
    area: FitArea,
) -> Option<FitRow> {
    let (mut px, mut percent) = (Vec::new(), Vec::new());
    for (person, errors) in population.people.iter().zip(errors) {
        for (error, _) in errors.iter().flatten().filter(|e| area == FitArea::All || e.1) {
            px.push(*error);
            percent.push(100.0 * error / person.eye_distance);
        }
    }
    let first = marked.first()?;
    let same = marked.iter().all(|nodes| nodes == first);
    Some(FitRow {
        population: population.name.clone(),
        area: area.name(population),
        method: method.name.clone(),
        choice: choice.name.clone(),
        marks: first.len(),
        nodes: if same { first.clone() } else { Vec::new() },
        people: errors.len(),
        failed: errors.iter().filter(|e| e.is_none()).count(),
        px: ErrorSummary::of(&px)?,
        percent: ErrorSummary::of(&percent)?,
    })
}

/// Returns the nodes as text, separated by spaces.
pub(super) fn node_list(nodes: &[NodeId]) -> String {
    nodes.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
}

/// Returns a table of all rows.
pub fn fit_table(rows: &[FitRow]) -> Table {
    let mut table = Table::new([
        "population",
        "compared",
        "method",
        "choice",
        "marks",
        "nodes",
        "people",
        "failed",
        "errors",
        "mean_px",
        "median_px",
        "p95_px",
        "mean_percent_es",
        "median_percent_es",
        "p95_percent_es",
    ]);
    for r in rows {
        table.rows.push(vec![
            Cell::text(&r.population),
            Cell::text(r.area),
            Cell::text(&r.method),
            Cell::text(&r.choice),
            Cell::Count(r.marks),
            Cell::Text(node_list(&r.nodes)),
            Cell::Count(r.people),
            Cell::Count(r.failed),
            Cell::Count(r.px.count),
            Cell::Number(r.px.mean, 2),
            Cell::Number(r.px.median, 2),
            Cell::Number(r.px.p95, 2),
            Cell::Number(r.percent.mean, 2),
            Cell::Number(r.percent.median, 2),
            Cell::Number(r.percent.p95, 2),
        ]);
    }
    table
}

/// Returns a chart of the error against the number of marks, with one curve for each method, for one choice of marks.
pub fn chart_of_methods(rows: &[FitRow], population: &str, area: &str, choice: &str) -> LineChart {
    let rows = rows.iter().filter(|r| r.population == population && r.area == area && r.choice == choice);
    chart(format!("Fit, people: {population}, marks: {choice}"), area, rows.map(|r| (r.method.as_str(), r)))
}

/// Returns a chart of the error against the number of marks, with one curve for each choice, for one method.
pub fn chart_of_choices(rows: &[FitRow], population: &str, area: &str, method: &str) -> LineChart {
    let rows = rows.iter().filter(|r| r.population == population && r.area == area && r.method == method);
    chart(format!("Fit, people: {population}, method: {method}"), area, rows.map(|r| (r.choice.as_str(), r)))
}

fn chart<'a>(title: String, area: &str, rows: impl Iterator<Item = (&'a str, &'a FitRow)>) -> LineChart {
    let mut series: Vec<Series> = Vec::new();
    for (name, row) in rows {
        let point = (row.marks as f64, row.percent.mean);
        match series.iter_mut().find(|s| s.name == name) {
            Some(series) => series.points.push(point),
            None => series.push(Series { name: name.to_owned(), points: vec![point] }),
        }
    }
    LineChart {
        title,
        x_label: "number of marks".to_owned(),
        y_label: format!("mean error over {area} (% of eye distance)"),
        series,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::{TruthNode, people::Person};

    /// A face equal to Candide-3, 100 px per model unit, with one node displaced by (3, 4) px.
    fn people(moved: NodeId, real: bool) -> (Wireframe, Population) {
        let wireframe = Wireframe::candide3();
        let frontal = wireframe.frontal();
        let truth = |node: &NodeId| {
            let p = frontal[node.index()];
            let shift = if *node == moved { 1.0 } else { 0.0 };
            let position = Point2::new(300.0 + 100.0 * p.x + 3.0 * shift, 200.0 - 100.0 * p.y + 4.0 * shift);
            TruthNode { node: *node, position, inner: *node == moved }
        };
        let person = Person::new("p".to_owned(), 50.0, wireframe.live_nodes().iter().map(truth).collect(), 1, 0);
        (wireframe, Population { name: "test".to_owned(), real, people: vec![person] })
    }

    fn study(wireframe: &Wireframe, population: Population, nodes: &[u16], noise: f64) -> Vec<FitRow> {
        let choice = MarkChoice::fixed("these", nodes.iter().map(|&n| NodeId(n)).collect());
        let study = FitStudy {
            wireframe,
            populations: vec![population],
            methods: vec![FitMethod::similarity(wireframe)],
            choices: vec![choice],
            counts: vec![nodes.len(), 50],
            marks_noise_px: noise,
            seed: 1,
        };
        evaluate_fit(&study, |_, _| true).unwrap()
    }

    #[test]
    fn an_error_at_one_node_is_found_there() {
        let (wireframe, population) = people(NodeId(5), false);
        let rows = study(&wireframe, population, &[20, 53, 31, 64, 10], 0.0);
        // The marks fit exactly, so 103 of 104 errors are 0, and one is 5 px, or 10 % of the eye distance of 50 px.
        assert_eq!(rows.len(), 1, "there are not 50 nodes to choose from");
        assert_eq!((rows[0].px.count, rows[0].marks, rows[0].failed), (104, 5, 0));
        assert!((rows[0].px.mean - 5.0 / 104.0).abs() < 1e-9);
        assert!((rows[0].percent.mean - 10.0 / 104.0).abs() < 1e-9);
        assert!(rows[0].px.median < 1e-9 && rows[0].px.p95 < 1e-9);
    }

    #[test]
    fn marked_nodes_of_real_people_are_not_compared() {
        let (wireframe, population) = people(NodeId(5), true);
        // Marks of real people get no noise; noise would show in the errors.
        let rows = study(&wireframe, population, &[20, 53, 31, 64, 10], 100.0);
        assert_eq!((rows[0].area, rows[0].px.count), ("other landmarks", 99));
        assert_eq!((rows[1].area, rows[1].px.count), ("other inner-face landmarks", 1));
        assert!((rows[1].px.mean - 5.0).abs() < 1e-9);
    }

    #[test]
    fn a_stopped_experiment_says_so() {
        let (wireframe, population) = people(NodeId(5), false);
        let choices = vec![MarkChoice::fixed("these", vec![NodeId(20), NodeId(53), NodeId(10)])];
        let study = FitStudy {
            wireframe: &wireframe,
            populations: vec![population],
            methods: FitMethod::standard(&wireframe),
            choices,
            counts: vec![3],
            marks_noise_px: 0.0,
            seed: 1,
        };
        assert!(matches!(evaluate_fit(&study, |_, _| false), Err(EvaluateError::Interrupted)));
        let rows = evaluate_fit(&study, |_, _| true).unwrap();
        assert_eq!(
            rows.iter().map(|r| r.method.as_str()).collect::<Vec<_>>(),
            ["similarity", "springs", "candide prior", "faces prior", "auto prior"]
        );
        assert!(rows.iter().any(|r| r.method == FitMethod::default_name()));
    }
}
