//! The genetic algorithm [ZL, section 3].
//!
//! It is steady-state: each generation draws three individuals from the population and replaces the worst of them by the
//! crossover of the other two. An individual consists of its weights of the bank's members. The motion of its feature points is
//! stored with it and is combined like the weights; its fitness is computed once. The dense surface is not needed during the
//! search.

use serde::{Deserialize, Serialize};

use super::{
    Crossover, SynthesisError,
    fitness::fitness,
    random::{distinct, generator},
    target::{Goal, summed_length},
};

/// Number of individuals drawn per generation [ZL: "we decide to evaluate 3 expression faces at a time"].
pub const TOURNAMENT_SIZE: usize = 3;
/// Number of generations [ZL: "N = 70 is chosen"].
pub const GENERATIONS: usize = 70;
/// The best alpha of BLX in [ZL, section 4].
pub const BLX_ALPHA: f64 = 0.2;

/// Parameters of the search.
///
/// ```
/// use grimace::synthesis::{Crossover, GaOptions};
///
/// let options = GaOptions { crossover: Crossover::Blx { alpha: 0.2 }, ..GaOptions::default() };
/// assert_eq!((options.tournament, options.generations, options.runs), (3, 70, 1));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GaOptions {
    /// Number of individuals; `None` for the number of the bank's members \[ZL\]. A smaller population is drawn from the bank, a
    /// larger one repeats it.
    pub population: Option<usize>,
    /// Number of individuals drawn per generation, at least 2. The worst of them is replaced by the crossover of the two best.
    pub tournament: usize,
    /// Number of generations.
    pub generations: usize,
    /// Crossover that produces offspring.
    pub crossover: Crossover,
    /// Number of independent runs per goal, at least 1; the best is used.
    pub runs: usize,
    /// Seed of all random draws.
    pub seed: u64,
}

impl Default for GaOptions {
    /// The parameters of \[ZL\], with line crossover, the best of their Table 1.
    fn default() -> Self {
        let (tournament, generations) = (TOURNAMENT_SIZE, GENERATIONS);
        Self { population: None, tournament, generations, crossover: Crossover::Line, runs: 1, seed: 1 }
    }
}

impl GaOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`SynthesisError::Option`].
    pub fn check(&self) -> Result<(), SynthesisError> {
        let wrong = |what, found: String, expected| Err(SynthesisError::Option { what, found, expected });
        if self.tournament < 2 {
            return wrong("the tournament's size", self.tournament.to_string(), "2 or more");
        }
        if self.population == Some(0) {
            return wrong("the population", "0".to_owned(), "1 or more");
        }
        if self.runs == 0 || self.runs >= 1 << 24 {
            return wrong("the number of runs", self.runs.to_string(), "1 to 16777215");
        }
        match self.crossover {
            Crossover::Blx { alpha } if !(0.0..=1.0).contains(&alpha) => wrong("alpha", alpha.to_string(), "0 to 1"),
            _ => Ok(()),
        }
    }
}

/// One generation of a run, as in [ZL, Fig. 6b].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Generation {
    /// Fitness of the offspring; in generation 0, that of the best individual in the initial population.
    pub offspring: f64,
    /// Best fitness so far.
    pub best: f64,
}

/// One run of the search.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Weights of the best individual of the run, scaled so that its summed length of motion is that of the target.
    pub weights: Vec<f64>,
    /// Its fitness.
    pub fitness: f64,
    /// The generations, starting with 0, the initial population.
    pub history: Vec<Generation>,
}

#[derive(Clone)]
struct Individual {
    weights: Vec<f64>,
    /// Motion of the moving feature points.
    motion: Vec<f64>,
    fitness: f64,
}

/// Runs the genetic algorithm once on a goal.
///
/// Implements [ZL, section 3 and Fig. 4]. The paper leaves these points open; they are decided as follows:
///
/// - The initial population is the bank, unscaled, and its members can be the best individual of the run.
/// - Of equally fit individuals, the first drawn counts as the fitter one.
/// - An offspring without motion is not scaled.
/// - At the end the length of the best individual is fitted, which matters when it is a member of the bank.
///
/// The random stream depends on `frame`, `region` and `run`.
pub fn evolve(goal: &Goal, options: &GaOptions, frame: usize, region: usize, run: usize) -> Run {
    let mut random = generator(options.seed, frame, region, run);
    let members = goal.member_count();
    let size = options.population.unwrap_or(members).max(1);
    let founders = if size < members { distinct(&mut random, members, size) } else { (0..size).map(|k| k % members).collect() };
    let mut population: Vec<Individual> = founders
        .into_iter()
        .map(|member| {
            let mut weights = vec![0.0; members];
            weights[member] = 1.0;
            let motion = goal.moving_candidate(member).to_vec();
            Individual { fitness: fitness(goal, &motion), weights, motion }
        })
        .collect();
    let first = (0..size).fold(0, |best, k| if population[k].fitness > population[best].fitness { k } else { best });
    let mut best = population[first].clone();
    let mut history = Vec::with_capacity(options.generations + 1);
    history.push(Generation { offspring: best.fitness, best: best.fitness });
    for _ in 0..options.generations {
        let mut drawn = distinct(&mut random, size, options.tournament);
        drawn.sort_by(|&a, &b| population[b].fitness.total_cmp(&population[a].fitness));
        // A population of one has no second parent.
        let [mother, father, ..] = drawn[..] else { break };
        let (a, b) = options.crossover.shares(&mut random);
        let mut offspring = cross(&population[mother], &population[father], a, b);
        let length = summed_length(&offspring.motion);
        if length > 0.0 {
            let factor = goal.length() / length;
            offspring.weights.iter_mut().chain(&mut offspring.motion).for_each(|w| *w *= factor);
        }
        offspring.fitness = fitness(goal, &offspring.motion);
        if offspring.fitness > best.fitness {
            best = offspring.clone();
        }
        history.push(Generation { offspring: offspring.fitness, best: best.fitness });
        let worst = drawn[drawn.len() - 1];
        population[worst] = offspring;
    }
    goal.fit_length(&mut best.weights);
    Run { weights: best.weights, fitness: best.fitness, history }
}

fn cross(mother: &Individual, father: &Individual, a: f64, b: f64) -> Individual {
    let mix = |m: &[f64], f: &[f64]| m.iter().zip(f).map(|(m, f)| a * m + b * f).collect();
    Individual { weights: mix(&mother.weights, &father.weights), motion: mix(&mother.motion, &father.motion), fitness: 0.0 }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;
    use crate::synthesis::{FpBasis, FpMotion, testing};

    fn goal(x: f64, y: f64, z: f64) -> Goal {
        let basis = FpBasis::new(&testing::bank());
        let offsets = vec![Some(Vector3::new(x, y, z)); 3];
        Goal::new(&basis, &FpMotion { offsets, planar: false, ..FpMotion::default() }, |_| true).unwrap()
    }

    #[test]
    fn the_first_generation_is_the_papers() {
        // Members right, up, out; all three are drawn with any stream. Target along x: right has fitness 1, up 0; out moves point
        // 0 along x, point 1 along y, point 2 along z: 1/3. So up is replaced by the midpoint of right and out.
        let options = GaOptions { crossover: Crossover::Midpoint, generations: 1, ..GaOptions::default() };
        let run = evolve(&goal(2.0, 0.0, 0.0), &options, 0, 0, 0);
        // Points of the offspring: (1,0,0), (1/2,1/2,0), (1/2,0,1/2); cosines 1, 1/sqrt 2, 1/sqrt 2.
        let expected = (1.0 + 2.0_f64.sqrt()) / 3.0;
        assert_eq!(run.history.len(), 2);
        assert_eq!(run.history[0], Generation { offspring: 1.0, best: 1.0 });
        assert_relative_eq!(run.history[1].offspring, expected, epsilon = 1e-12);
        // The best is the member itself, with its length fitted: three motions of 2 instead of three of 1.
        assert_eq!(run.weights, [2.0, 0.0, 0.0]);
        assert_eq!(run.fitness, 1.0);
    }

    #[test]
    fn a_mixture_that_no_member_is_is_found() {
        let target = goal(1.0, 1.0, 0.0);
        let run = evolve(&target, &GaOptions::default(), 0, 0, 0);
        // Every member has at most cos 45 degrees = 0.707; the sum of the first two has 1.
        assert!(run.fitness > 0.8 && run.fitness <= 1.0 + 1e-12, "{}", run.fitness);
        assert_relative_eq!(summed_length(&target.motion(&run.weights)), target.length(), epsilon = 1e-9);
        assert_relative_eq!(fitness(&target, &target.motion(&run.weights)), run.fitness, epsilon = 1e-12);
    }

    #[test]
    fn a_single_member_and_a_target_opposite_to_it_are_answered() {
        let bank = testing::bank().select(&[0]).unwrap();
        let offsets = vec![Some(-Vector3::x()); 3];
        let goal =
            Goal::new(&FpBasis::new(&bank), &FpMotion { offsets, planar: false, ..FpMotion::default() }, |_| true).unwrap();
        let run = evolve(&goal, &GaOptions::default(), 0, 0, 0);
        assert_eq!((run.fitness, &run.weights[..]), (-1.0, &[1.0][..]));
        assert_eq!(run.history.len(), 1);
    }

    #[test]
    fn options_out_of_range_are_named() {
        let says = |options: GaOptions, text: &str| assert!(options.check().unwrap_err().to_string().contains(text));
        says(GaOptions { tournament: 1, ..GaOptions::default() }, "2 or more");
        says(GaOptions { population: Some(0), ..GaOptions::default() }, "the population is 0");
        says(GaOptions { runs: 0, ..GaOptions::default() }, "the number of runs is 0");
        says(GaOptions { crossover: Crossover::Blx { alpha: 1.5 }, ..GaOptions::default() }, "alpha is 1.5");
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn the_best_never_worsens_and_seeds_repeat(
            x in -1.0..1.0_f64, y in -1.0..1.0_f64, z in 0.1..1.0_f64, seed in 0..1000_u64, population in 1..9_usize,
        ) {
            let goal = goal(x, y, z);
            let options = GaOptions { seed, population: Some(population), crossover: Crossover::Blx { alpha: 0.3 }, ..GaOptions::default() };
            let run = evolve(&goal, &options, 3, 1, 2);
            prop_assert!(run.history.windows(2).all(|p| p[1].best >= p[0].best));
            prop_assert!(run.history.iter().all(|g| g.offspring <= 1.0 + 1e-12 && g.best >= g.offspring));
            prop_assert_eq!(run.fitness, run.history.last().unwrap().best);
            prop_assert_eq!(&run, &evolve(&goal, &options, 3, 1, 2));
        }
    }
}
