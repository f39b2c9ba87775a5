//! The experiments of [ZL, sections 4 and 5] on any bank, and a comparison of the genetic algorithm with the other solvers.
//!
//! Targets are expressions that are not in the bank. A solver sees only their feature points; its answer is compared with their whole
//! surface.

use std::time::Instant;

use rayon::prelude::*;

use super::{Cell, EvaluateError, LineChart, Series, Table};
use grimace::internal::{
    mesh::TriangleMesh,
    synthesis::{
        Bank, Crossover, FpBasis, FpMotion, FrameAnswer, GaOptions, Goal, RegionScheme, Regions, Run, Solver, SynthesisOptions,
        Synthesizer, evolve, mix, surface_error,
    },
};

/// A target expression, which is not in the bank.
#[derive(Clone, Debug)]
pub struct SynthesisTarget<'a> {
    /// Name of the expression.
    pub name: String,
    /// Displacements of the whole surface.
    pub truth: &'a [[f32; 3]],
}

/// Inputs and options of the experiments.
#[derive(Clone, Debug)]
pub struct SynthesisStudy<'a> {
    /// The bank.
    pub bank: &'a Bank,
    /// Target expressions, which are not in the bank.
    pub targets: Vec<SynthesisTarget<'a>>,
    /// Number of targets, from the first on, for the comparison of one, two and four regions [ZL: 10].
    pub region_targets: usize,
    /// Number of runs of the genetic algorithm on every target [ZL: 10].
    pub runs: usize,
    /// Crossovers to compare.
    pub crossovers: Vec<Crossover>,
    /// Other parameters of the genetic algorithm.
    pub ga: GaOptions,
    /// Width of the overlap of regions relative to the width of the face.
    pub overlap: f64,
    /// Number of starts for the search of the upper bound.
    pub bound_starts: usize,
}

/// Results of one crossover, as in [ZL, Table 1].
#[derive(Clone, Debug, PartialEq)]
pub struct CrossoverRow {
    /// The crossover.
    pub crossover: Crossover,
    /// Mean over targets of the mean best fitness over runs.
    pub fitness: f64,
    /// Mean over targets of the standard deviation over runs (with n - 1); `None` for a single run.
    pub deviation: Option<f64>,
    /// For each generation from 0: mean best fitness so far, and mean fitness of the offspring.
    pub history: Vec<(f64, f64)>,
}

/// Results of one solver with one scheme of regions.
#[derive(Clone, Debug, PartialEq)]
pub struct SolverRow {
    /// The scheme.
    pub scheme: RegionScheme,
    /// The solver.
    pub solver: Solver,
    /// Number of targets.
    pub targets: usize,
    /// Fitness, averaged over the regions: mean and minimum over the targets.
    pub fitness: (f64, f64),
    /// Mean over targets of the fitness of the joined surface.
    pub joined: f64,
    /// Fitness as a share of the upper bound: mean and minimum over the targets; `None` without a bound.
    pub share_of_bound: Option<(f64, f64)>,
    /// Surface error of every target; see [`surface_error`].
    pub errors: Vec<f64>,
    /// Largest seam values over the targets; `None` for one region.
    pub seam: Option<Seam>,
}

impl SolverRow {
    /// Returns the mean surface error.
    pub fn mean_error(&self) -> f64 {
        mean(&self.errors)
    }
}

/// Duration of one search, including the dense surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeRow {
    /// The scheme.
    pub scheme: RegionScheme,
    /// The solver.
    pub solver: Solver,
    /// Time on one thread, milliseconds: median over targets of the shortest of [`REPEATS`] measurements.
    pub milliseconds: f64,
}

/// Number of repeated measurements, of which the shortest counts.
pub const REPEATS: usize = 5;

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Compares crossovers [ZL, Table 1]: `runs` runs of each on every target, with the whole face.
///
/// `go_on` is called before every target and may return `false` to stop.
///
/// # Errors
/// [`EvaluateError::Interrupted`].
pub fn evaluate_crossovers(
    study: &SynthesisStudy<'_>,
    go_on: &(impl Fn() -> bool + Sync),
) -> Result<Vec<CrossoverRow>, EvaluateError> {
    let basis = FpBasis::new(study.bank);
    let goals: Vec<Option<Goal>> =
        study.targets.iter().map(|t| Goal::new(&basis, &FpMotion::of_surface(study.bank, t.truth), |_| true)).collect();
    let mut rows = Vec::new();
    for &crossover in &study.crossovers {
        let options = GaOptions { crossover, ..study.ga };
        let runs: Vec<Vec<Run>> = goals
            .par_iter()
            .enumerate()
            .map(|(target, goal)| {
                let goal = goal.as_ref().filter(|_| go_on())?;
                Some((0..study.runs).map(|run| evolve(goal, &options, target, 0, run)).collect())
            })
            .collect::<Option<_>>()
            .ok_or(EvaluateError::Interrupted)?;
        let averages: Vec<f64> = runs.iter().map(|r| mean(&r.iter().map(|run| run.fitness).collect::<Vec<_>>())).collect();
        let deviation = |(runs, average): (&Vec<Run>, &f64)| {
            let squares: f64 = runs.iter().map(|r| (r.fitness - average).powi(2)).sum();
            (squares / (runs.len() - 1) as f64).sqrt()
        };
        let deviations: Option<Vec<f64>> = (study.runs > 1).then(|| runs.iter().zip(&averages).map(deviation).collect());
        let all: Vec<&Run> = runs.iter().flatten().collect();
        let length = all.iter().map(|r| r.history.len()).min().unwrap_or(0);
        let history = (0..length).map(|g| {
            let values = |pick: fn(&grimace::internal::synthesis::Generation) -> f64| {
                mean(&all.iter().map(|r| pick(&r.history[g])).collect::<Vec<_>>())
            };
            (values(|g| g.best), values(|g| g.offspring))
        });
        rows.push(CrossoverRow {
            crossover,
            fitness: mean(&averages),
            deviation: deviations.map(|d| mean(&d)),
            history: history.collect(),
        });
    }
    Ok(rows)
}

/// Runs every solver on the first `region_targets` targets with one, two and four regions; all rows use the same targets.
///
/// # Errors
/// [`EvaluateError`] for options out of range, or when `go_on` returns `false`.
pub fn evaluate_solvers(study: &SynthesisStudy<'_>, go_on: &(impl Fn() -> bool + Sync)) -> Result<Vec<SolverRow>, EvaluateError> {
    let mut rows = Vec::new();
    for scheme in [RegionScheme::Whole, RegionScheme::Halves, RegionScheme::Quarters] {
        let count = study.region_targets.min(study.targets.len());
        let regions = Regions::new(study.bank, scheme, study.overlap)?;
        let seams = (scheme != RegionScheme::Whole).then(|| Seams::new(study.bank.mesh(), &regions));
        for solver in Solver::ALL {
            if solver == Solver::Rbf && scheme != RegionScheme::Whole {
                continue;
            }
            let synthesizer = Synthesizer::new(study.bank, options(study, scheme, solver, study.bound_starts))?;
            let measured: Vec<Measured> = study.targets[..count]
                .par_iter()
                .enumerate()
                .map(|(frame, target)| go_on().then(|| measure(&synthesizer, target, frame, seams.as_ref())))
                .collect::<Option<_>>()
                .ok_or(EvaluateError::Interrupted)?;
            rows.push(summarize(scheme, solver, &measured));
        }
    }
    Ok(rows)
}

fn options(study: &SynthesisStudy<'_>, regions: RegionScheme, solver: Solver, bound_starts: usize) -> SynthesisOptions {
    SynthesisOptions { solver, ga: study.ga, regions, overlap: study.overlap, bound_starts, ..SynthesisOptions::default() }
}

struct Measured {
    answer: FrameAnswer,
    error: f64,
    seam: Option<Seam>,
}

fn measure(synthesizer: &Synthesizer<'_>, target: &SynthesisTarget<'_>, frame: usize, seams: Option<&Seams>) -> Measured {
    let motion = FpMotion::of_surface(synthesizer.bank(), target.truth);
    let answer = synthesizer.solve(&motion, frame);
    let surface = synthesizer.surface(&answer, &motion);
    let error = surface_error(&surface, target.truth).unwrap_or(0.0);
    let seam = seams.and_then(|seams| {
        let own: Vec<_> = answer.weights.iter().map(|weights| mix(synthesizer.bank(), weights)).collect();
        seams.measure(synthesizer.bank().mesh(), &surface, &own)
    });
    Measured { answer, error, seam }
}

fn summarize(scheme: RegionScheme, solver: Solver, measured: &[Measured]) -> SolverRow {
    let fitness: Vec<f64> = measured.iter().filter_map(|m| m.answer.mean_region_fitness()).collect();
    let joined: Vec<f64> = measured.iter().filter_map(|m| m.answer.fitness).collect();
    let shares: Vec<f64> = measured.iter().filter_map(|m| m.answer.share_of_bound()).collect();
    let least = |values: &[f64]| values.iter().copied().fold(f64::INFINITY, f64::min);
    SolverRow {
        scheme,
        solver,
        targets: measured.len(),
        fitness: (mean(&fitness), least(&fitness)),
        joined: mean(&joined),
        share_of_bound: (!shares.is_empty()).then(|| (mean(&shares), least(&shares))),
        errors: measured.iter().map(|m| m.error).collect(),
        seam: measured.iter().filter_map(|m| m.seam).reduce(Seam::largest),
    }
}

/// Measures the duration of searches without a bound, one after another on the calling thread.
///
/// # Errors
/// As [`evaluate_solvers`].
pub fn time_solvers(
    study: &SynthesisStudy<'_>,
    targets: usize,
    go_on: &impl Fn() -> bool,
) -> Result<Vec<TimeRow>, EvaluateError> {
    let mut rows = Vec::new();
    for scheme in [RegionScheme::Whole, RegionScheme::Halves, RegionScheme::Quarters] {
        for solver in Solver::ALL {
            if solver == Solver::Rbf && scheme != RegionScheme::Whole {
                continue;
            }
            let synthesizer = Synthesizer::new(study.bank, options(study, scheme, solver, 0))?;
            let mut times = Vec::new();
            for (frame, target) in study.targets.iter().take(targets).enumerate() {
                if !go_on() {
                    return Err(EvaluateError::Interrupted);
                }
                let motion = FpMotion::of_surface(study.bank, target.truth);
                let once = || {
                    let start = Instant::now();
                    let answer = synthesizer.solve(&motion, frame);
                    std::hint::black_box(synthesizer.surface(&answer, &motion));
                    start.elapsed().as_secs_f64() * 1e3
                };
                times.push((0..REPEATS).map(|_| once()).fold(f64::INFINITY, f64::min));
            }
            times.sort_by(f64::total_cmp);
            let milliseconds = super::percentile(&times, 0.5).unwrap_or(0.0);
            rows.push(TimeRow { scheme, solver, milliseconds });
        }
    }
    Ok(rows)
}

/// Stretch of the surface where regions are joined. Stretch is the length of an edge divided by its neutral length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seam {
    /// Largest stretch of an edge across an overlap, divided by the largest stretch of an edge inside a region, both in the joined surface.
    pub inside: f64,
    /// Largest stretch of an edge across an overlap in the joined surface, divided by that of the same edges in the regions' own surfaces.
    /// At 1 or less, joining adds no stretch.
    pub own: f64,
}

impl Seam {
    fn largest(self, other: Self) -> Self {
        Self { inside: self.inside.max(other.inside), own: self.own.max(other.own) }
    }
}

/// The edges across overlaps of regions, and the edges inside a region.
pub struct Seams {
    across: Vec<[u32; 2]>,
    inside: Vec<[u32; 2]>,
    /// For each region, the edges across overlaps with a share of the region at both ends.
    across_of: Vec<Vec<[u32; 2]>>,
}

impl Seams {
    /// Sorts the edges of a bank's mesh. An edge is across an overlap when one of its ends has a share in more than one region; otherwise
    /// it is inside a region.
    pub fn new(mesh: &TriangleMesh, regions: &Regions) -> Self {
        let has_share = |region: usize, v: u32| regions.vertex_shares(region)[v as usize] > 0.0;
        let is_shared = |v: u32| (0..regions.count()).filter(|&r| has_share(r, v)).count() > 1;
        let (across, inside): (Vec<[u32; 2]>, _) = mesh.edges().into_keys().partition(|&[a, b]| is_shared(a) || is_shared(b));
        let of_region = |r: usize| across.iter().copied().filter(|&[a, b]| has_share(r, a) && has_share(r, b)).collect();
        Self { across_of: (0..regions.count()).map(of_region).collect(), across, inside }
    }

    /// Measures the seams of a joined surface; `own` holds the surface of each region alone. Returns `None` when overlaps cover the whole
    /// face.
    pub fn measure(&self, mesh: &TriangleMesh, joined: &[[f32; 3]], own: &[Vec<[f32; 3]>]) -> Option<Seam> {
        let across = largest_stretch(mesh, &self.across, joined)?;
        let inside = largest_stretch(mesh, &self.inside, joined)?;
        let apart = self.across_of.iter().zip(own).filter_map(|(edges, surface)| largest_stretch(mesh, edges, surface));
        Some(Seam { inside: across / inside, own: across / apart.max_by(f64::total_cmp)? })
    }
}

fn largest_stretch(mesh: &TriangleMesh, edges: &[[u32; 2]], displacements: &[[f32; 3]]) -> Option<f64> {
    let stretch = |&[a, b]: &[u32; 2]| {
        let (p, q) = (mesh.positions()[a as usize], mesh.positions()[b as usize]);
        let (u, v) = (displacements[a as usize], displacements[b as usize]);
        let neutral: f32 = (0..3).map(|k| (p[k] - q[k]).powi(2)).sum();
        let moved: f32 = (0..3).map(|k| (p[k] + u[k] - q[k] - v[k]).powi(2)).sum();
        (neutral > 0.0).then(|| f64::from(moved / neutral).sqrt())
    };
    edges.iter().filter_map(stretch).max_by(f64::total_cmp)
}

/// Returns the results of the crossovers next to the figures of [ZL, Table 1].
pub fn crossover_table(rows: &[CrossoverRow]) -> Table {
    let mut table = Table::new(["crossover", "fitness", "SD", "ZL fitness", "ZL SD"]);
    for row in rows {
        let published = match row.crossover {
            Crossover::Blx { alpha: 0.2 } => Some((0.962, 0.0068)),
            Crossover::Midpoint => Some((0.960, 0.0057)),
            Crossover::Line => Some((0.970, 0.0075)),
            Crossover::Blx { .. } => None,
        };
        table.rows.push(vec![
            Cell::text(row.crossover.name()),
            Cell::Number(row.fitness, 4),
            Cell::maybe(row.deviation, 4),
            Cell::maybe(published.map(|p| p.0), 3),
            Cell::maybe(published.map(|p| p.1), 4),
        ]);
    }
    table
}

/// Returns the number of regions of a scheme.
fn region_count(scheme: RegionScheme) -> usize {
    scheme.names().len()
}

/// Returns fitness, bound and surface error of every solver and scheme.
pub fn solver_table(rows: &[SolverRow]) -> Table {
    let mut table = Table::new([
        "regions",
        "solver",
        "targets",
        "fitness",
        "least fitness",
        "joined fitness",
        "share of bound",
        "least share",
        "surface error",
        "largest error",
        "seam",
        "seam over own",
    ]);
    for row in rows {
        let largest = row.errors.iter().copied().fold(0.0, f64::max);
        table.rows.push(vec![
            Cell::Count(region_count(row.scheme)),
            Cell::text(row.solver.name()),
            Cell::Count(row.targets),
            Cell::Number(row.fitness.0, 4),
            Cell::Number(row.fitness.1, 4),
            Cell::Number(row.joined, 4),
            Cell::maybe(row.share_of_bound.map(|s| s.0), 4),
            Cell::maybe(row.share_of_bound.map(|s| s.1), 4),
            Cell::Number(row.mean_error(), 4),
            Cell::Number(largest, 4),
            Cell::maybe(row.seam.map(|s| s.inside), 3),
            Cell::maybe(row.seam.map(|s| s.own), 3),
        ]);
    }
    table
}

/// Returns the times of every solver and scheme, next to those of \[ZL\] for the genetic algorithm.
pub fn time_table(rows: &[TimeRow]) -> Table {
    let mut table = Table::new(["regions", "solver", "ms", "ZL ms"]);
    for row in rows {
        let published = match (row.solver, row.scheme) {
            (Solver::Ga, RegionScheme::Whole) => Some(40_000.0),
            (Solver::Ga, RegionScheme::Halves) => Some(120_000.0),
            (Solver::Ga, RegionScheme::Quarters) => Some(300_000.0),
            _ => None,
        };
        table.rows.push(vec![
            Cell::Count(region_count(row.scheme)),
            Cell::text(row.solver.name()),
            Cell::Number(row.milliseconds, 2),
            Cell::maybe(published, 0),
        ]);
    }
    table
}

/// Returns a chart of the mean best fitness over the generations [ZL, Fig. 6b], with one curve for each crossover.
pub fn history_chart(rows: &[CrossoverRow]) -> LineChart {
    let series = rows.iter().map(|row| Series {
        name: row.crossover.name(),
        points: row.history.iter().enumerate().map(|(g, h)| (g as f64, h.0)).collect(),
    });
    LineChart {
        title: "Mean best fitness so far".to_owned(),
        x_label: "generation".to_owned(),
        y_label: "fitness (mean cosine)".to_owned(),
        series: series.collect(),
    }
}

/// Returns a chart of the sorted surface errors of all targets with the whole face, with one curve for each solver.
pub fn error_chart(rows: &[SolverRow]) -> LineChart {
    let series = rows.iter().filter(|r| r.scheme == RegionScheme::Whole).map(|row| {
        let mut errors = row.errors.clone();
        errors.sort_by(f64::total_cmp);
        Series {
            name: row.solver.name().to_owned(),
            points: errors.into_iter().enumerate().map(|(k, e)| (k as f64 + 1.0, e)).collect(),
        }
    });
    LineChart {
        title: "Surface error, targets sorted for each solver".to_owned(),
        x_label: "target".to_owned(),
        y_label: "error over true motion".to_owned(),
        series: series.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seam_quality_is_a_ratio_of_stretches() {
        // Edges of length 1 from vertex 0 to 1 (across) and from 0 to 2 (inside).
        let mesh = TriangleMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]).unwrap();
        let seams = Seams { across: vec![[0, 1]], inside: vec![[0, 2]], across_of: vec![vec![[0, 1]], Vec::new()] };
        let along = |x: f32, y: f32| vec![[0.0; 3], [x, 0.0, 0.0], [0.0, y, 0.0]];
        // Joined: 1.5 across and 2 inside; the region alone stretches the edge across to 1.25.
        let seam = seams.measure(&mesh, &along(0.5, 1.0), &[along(0.25, 0.0), along(9.0, 0.0)]).unwrap();
        assert_eq!(seam, Seam { inside: 0.75, own: 1.2 });
        // Without edges inside there is nothing to compare with.
        let covered = Seams { inside: Vec::new(), ..seams };
        assert_eq!(covered.measure(&mesh, &along(0.5, 1.0), &[]), None);
    }
}
