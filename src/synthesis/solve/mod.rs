//! Solvers for the weights of one goal: the genetic algorithm of \[ZL\] and alternatives.

mod climb;
pub(super) mod nonnegative;
mod rbf;

use std::fmt;

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

pub use climb::{Climb, Signs, climb};
pub use rbf::interpolate;

use super::{
    fitness::fitness,
    random::{distinct, generator, unit},
    search::{GaOptions, Run, evolve},
    target::Goal,
};

/// Method that finds a surface.
///
/// ```
/// use grimace::synthesis::{Solver, SynthesisOptions};
///
/// assert_eq!(Solver::ALL.map(Solver::name), ["best", "rbf", "nnls", "ga", "refined", "cosine"]);
/// assert_eq!(SynthesisOptions::default().solver, Solver::Refined);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Solver {
    /// The single fittest member of the bank.
    Best,
    /// Radial basis functions over the feature points, without the bank.
    Rbf,
    /// Non-negative least squares: weights that bring the feature points closest to the target, including lengths and points at
    /// rest. Points with unknown motion are drawn to rest weakly.
    Nnls,
    /// The genetic algorithm as published.
    Ga,
    /// The genetic algorithm, followed by a climb from its answer: the fitness with a pull towards the target's lengths (see
    /// `Climb`).
    Refined,
    /// The best of climbs from many starts; it serves as the bound for the other solvers.
    Cosine,
}

impl Solver {
    /// All solvers, in the order of reports.
    pub const ALL: [Self; 6] = [Self::Best, Self::Rbf, Self::Nnls, Self::Ga, Self::Refined, Self::Cosine];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Best => "best",
            Self::Rbf => "rbf",
            Self::Nnls => "nnls",
            Self::Ga => "ga",
            Self::Refined => "refined",
            Self::Cosine => "cosine",
        }
    }
}

impl fmt::Display for Solver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Weights of the members, and their fitness.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Weights, scaled so that the summed length of motion is the target's (for [`Solver::Nnls`] as least squares gives them).
    pub weights: Vec<f64>,
    /// Fitness.
    pub fitness: f64,
    /// Runs of the genetic algorithm, if any.
    pub runs: Vec<Run>,
}

/// Returns the fittest single member; the first of equally fit ones.
pub fn best_member(goal: &Goal) -> Solution {
    let value = |m: usize| fitness(goal, goal.moving_candidate(m));
    let best = (1..goal.member_count()).fold((0, value(0)), |best, m| if value(m) > best.1 { (m, value(m)) } else { best });
    let mut weights = vec![0.0; goal.member_count()];
    weights[best.0] = 1.0;
    goal.fit_length(&mut weights);
    Solution { weights, fitness: best.1, runs: Vec::new() }
}

/// Solves by non-negative least squares over moving and resting feature points.
pub fn least_squares(goal: &Goal) -> Solution {
    let (gram, right) = normal_equations(goal);
    let mut weights = nonnegative::minimize(&gram, &right, &[]);
    if goal.ridge() > 0.0 {
        // The ridge shortens the motion.
        goal.fit_closest(&mut weights);
    }
    Solution { fitness: fitness(goal, &goal.motion(&weights)), weights, runs: Vec::new() }
}

fn normal_equations(goal: &Goal) -> (DMatrix<f64>, DVector<f64>) {
    let matrix = DMatrix::from_fn(goal.target().len(), goal.member_count(), |row, m| goal.candidate(m)[row]);
    // Points with unknown motion have the target 0, and nothing to add to the right side.
    let free = DMatrix::from_fn(goal.free_candidate(0).len(), goal.member_count(), |row, m| goal.free_candidate(m)[row]);
    let mut gram = matrix.tr_mul(&matrix) + free.tr_mul(&free);
    let ridge = goal.ridge() * gram.trace() / goal.member_count() as f64;
    (0..goal.member_count()).for_each(|k| gram[(k, k)] += ridge + goal.ridge_elsewhere(k));
    (gram, matrix.tr_mul(&DVector::from_column_slice(goal.target())))
}

/// Runs the genetic algorithm and returns the best of its runs.
pub fn genetic(goal: &Goal, options: &GaOptions, frame: usize, region: usize) -> Solution {
    let runs: Vec<Run> = (0..options.runs.max(1)).map(|run| evolve(goal, options, frame, region, run)).collect();
    let best = (1..runs.len()).fold(0, |best, k| if runs[k].fitness > runs[best].fitness { k } else { best });
    Solution { weights: runs[best].weights.clone(), fitness: runs[best].fitness, runs }
}

/// Share of the target motion below which an answer shows almost none of it, whatever its fitness.
const NEXT_TO_NOTHING: f64 = 0.25;
/// Fitness from which least squares can replace such an answer: most points move roughly in the target direction.
const ABOUT_THAT_WAY: f64 = 0.5;

/// Refines the genetic algorithm's answer by a climb.
///
/// If points that should rest limit the length, the answer is that of least squares when it is fitter (with those points
/// counted). It is also that of least squares when the climb's answer shows less than a quarter of the motion, least squares show
/// more than twice as much, and their fitness exceeds `ABOUT_THAT_WAY`.
pub fn refined(goal: &Goal, options: &GaOptions, is_signed: bool, frame: usize, region: usize) -> Solution {
    let found = genetic(goal, options, frame, region);
    let (mut weights, fitness) = climb(goal, &found.weights, Climb::with_pull(is_signed));
    let mut scaled = weights.clone();
    if goal.fit_length(&mut scaled) {
        let closest = least_squares(goal);
        let [climbed, least] = [&scaled, &closest.weights].map(|weights| goal.shown(weights));
        let fitness = goal.fitness_of(&closest.weights);
        let shows_more = climbed < NEXT_TO_NOTHING && least > 2.0 * climbed && fitness > ABOUT_THAT_WAY;
        if shows_more || fitness > goal.fitness_of(&weights) {
            weights = closest.weights;
        }
        return Solution { fitness: goal.fitness_of(&weights), weights, runs: found.runs };
    }
    Solution { weights, fitness, runs: found.runs }
}

/// Run number of the random stream for the starts of the bound.
const BOUND_RUN: usize = (1 << 24) - 1;

/// Returns the fittest result of climbs from `starts` starting points: the refined least-squares solution, then the fittest
/// members in turn with random mixtures.
///
/// The result is feasible, so the largest possible fitness over the allowed weights is at least this. In practice they are equal,
/// but this is no proof.
pub fn bound(goal: &Goal, starts: usize, is_signed: bool, seed: u64, frame: usize, region: usize) -> Solution {
    let members = goal.member_count();
    let mut random = generator(seed, frame, region, BOUND_RUN);
    let mut order: Vec<usize> = (0..members).collect();
    order.sort_by(|&a, &b| {
        let value = |m: usize| fitness(goal, goal.moving_candidate(m));
        value(b).total_cmp(&value(a)).then(a.cmp(&b))
    });
    let mut best: Option<(Vec<f64>, f64)> = None;
    for k in 0..starts.max(1) {
        let start = if k == 0 {
            climb(goal, &least_squares(goal).weights, Climb::with_pull(is_signed)).0
        } else if k % 2 == 1 {
            let mut one = vec![0.0; members];
            one[order[(k / 2) % members]] = 1.0;
            one
        } else {
            let mut mixture = vec![0.0; members];
            for member in distinct(&mut random, members, 5) {
                mixture[member] = unit(&mut random);
            }
            mixture
        };
        let found = climb(goal, &start, Climb::fitness_alone(is_signed));
        if best.as_ref().is_none_or(|b| found.1 > b.1) {
            best = Some(found);
        }
    }
    let (weights, fitness) = best.unwrap_or_else(|| (vec![0.0; members], 0.0));
    Solution { weights, fitness, runs: Vec::new() }
}
