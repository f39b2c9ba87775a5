//! The answer for one frame: weights, fitness and bound.

use super::search::Run;

/// The answer for one frame.
///
/// ```
/// # let mesh = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// # let mesh = grimace::mesh::TriangleMesh::new(mesh, vec![[0, 1, 2], [0, 2, 3]])?;
/// # let names = ["right", "up"].map(str::to_owned).to_vec();
/// # let moves = [[[1.0, 0.0, 0.0]; 4], [[0.0, 1.0, 0.0]; 4]].concat();
/// # let points = [("8.4", 0), ("8.3", 1), ("3.11", 2)];
/// # let points = points.map(|(fp, vertex)| grimace::synthesis::FeaturePointVertex { fp: fp.parse().unwrap(), vertex }).to_vec();
/// # let bank = grimace::synthesis::Bank::new(mesh, names, moves, points, Default::default())?;
/// use grimace::synthesis::{FpMotion, SynthesisOptions, Synthesizer};
///
/// // The two members of `bank` move all vertices by 1: to the right, and up.
/// let synthesizer = Synthesizer::new(&bank, SynthesisOptions::default())?;
/// let answer = synthesizer.solve(&FpMotion::of_surface(&bank, bank.displacements(1)), 0);
/// // The bank's own member is found: its motion has the target's directions.
/// assert!(answer.fitness.is_some_and(|fitness| fitness > 0.999));
/// assert_eq!(answer.weights.len(), 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FrameAnswer {
    /// Weights of the members for each region; zeros where nothing should move, empty for [`Solver::Rbf`](super::Solver::Rbf).
    pub weights: Vec<Vec<f64>>,
    /// Fitness in each region; `None` where nothing should move.
    pub region_fitness: Vec<Option<f64>>,
    /// Fitness of the joined surface over all feature points; `None` where nothing should move.
    pub fitness: Option<f64>,
    /// Share of the target motion that the joined surface shows; `None` where nothing should move.
    ///
    /// It is the summed motion of the feature points along their target directions, divided by the summed length of the target.
    /// It is 0 or more, and 1 when all of the motion is shown. The fitness does not measure this.
    pub shown: Option<f64>,
    /// Share of the target motion shown in each region.
    pub region_shown: Vec<Option<f64>>,
    /// Best known fitness in each region (the bound), never less than the fitness; `None` where nothing should move or no bound
    /// was requested.
    pub region_bound: Vec<Option<f64>>,
    /// Runs of the genetic algorithm for each region.
    #[doc(hidden)]
    pub runs: Vec<Vec<Run>>,
}

impl FrameAnswer {
    /// Mean fitness of the regions that move.
    pub fn mean_region_fitness(&self) -> Option<f64> {
        mean(self.region_fitness.iter().flatten())
    }

    /// Mean share of the motion shown in the regions that move.
    pub fn mean_region_shown(&self) -> Option<f64> {
        mean(self.region_shown.iter().flatten())
    }

    /// Mean fitness of the regions divided by their mean bound; 1 at the bound.
    pub fn share_of_bound(&self) -> Option<f64> {
        let pairs = self.region_fitness.iter().zip(&self.region_bound).filter_map(|(f, b)| f.zip(*b));
        let (fitness, bound) = pairs.fold((0.0, 0.0), |(f, b), (x, y)| (f + x, b + y));
        (bound > 0.0).then(|| fitness / bound)
    }
}

fn mean<'a>(values: impl Iterator<Item = &'a f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), v| (sum + v, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}
