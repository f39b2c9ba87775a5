//! Options of `grimace synthesize` for its search, for time and for scale.

use clap::ValueEnum;
use grimace::synthesis::{
    BLX_ALPHA, BOUND_STARTS, Crossover, GENERATIONS, GaOptions, OVERLAP, RegionScheme, SMOOTHING_FRAMES, Signs, Solver,
    SynthesisOptions, TOURNAMENT_SIZE,
};

use super::{
    numbers::{self, within},
    shared::{gain, positive},
};

#[derive(Clone, Copy, Debug, ValueEnum)]
enum SolverWord {
    /// The single best member
    Best,
    /// Radial basis functions, without the members of the bank
    Rbf,
    /// Non-negative least squares
    Nnls,
    /// The genetic algorithm as published
    Ga,
    /// The genetic algorithm, then hill climbing from its result
    Refined,
    /// The best of many hill climbs from different starts
    Cosine,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum CrossoverWord {
    Midpoint,
    Line,
    Blx,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum SignsWord {
    /// `any` for motion in space, `nonnegative` for motion in the plane
    Auto,
    /// Weights may be negative: members can be subtracted
    Any,
    /// Weights of at least 0: mixtures only
    Nonnegative,
}

/// Options of the search.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Search")]
pub struct SearchArgs {
    /// Solver that finds the weights of the members
    #[arg(long, value_enum, default_value = "refined")]
    solver: SolverWord,
    /// Number of face regions that are solved separately: 1, 2 (right, left) or 4 (right and left, upper and lower)
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = regions)]
    regions: usize,
    /// Width of the overlap of two regions, as a share of the width of the face
    #[arg(long, default_value_t = OVERLAP, value_name = "SHARE", value_parser = positive)]
    overlap: f64,
    /// Emphasis c: a factor on the strength of the motion
    #[arg(short = 'c', long, default_value_t = 1.0, value_name = "C", value_parser = numbers::emphasis_beside_marks)]
    emphasis: f64,
    /// Crossover of the genetic algorithm
    #[arg(long, value_enum, default_value = "line")]
    crossover: CrossoverWord,
    /// Alpha of the BLX crossover
    #[arg(long, default_value_t = BLX_ALPHA)]
    alpha: f64,
    /// Number of generations of the genetic algorithm
    #[arg(long, default_value_t = GENERATIONS, value_name = "N", value_parser = numbers::count(0, 1_000_000))]
    generations: usize,
    /// Number of individuals; by default the number of members of the bank
    #[arg(long, value_name = "N", value_parser = numbers::count(1, 100_000))]
    population: Option<usize>,
    /// Number of individuals drawn per generation
    #[arg(long, default_value_t = TOURNAMENT_SIZE, value_name = "N", value_parser = numbers::count(1, 100_000))]
    tournament: usize,
    /// Number of independent runs; the best is used
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = numbers::count(1, 10_000))]
    runs: usize,
    /// Random seed
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Signs of the weights that the refinement and the bound allow
    #[arg(long, value_enum, default_value = "auto")]
    weights: SignsWord,
    /// Number of starts of the search for the upper bound of the fitness; 0 for no bound
    #[arg(long, default_value_t = BOUND_STARTS, value_name = "N", value_parser = numbers::count(0, 100_000))]
    bound_starts: usize,
}

/// Time and scale.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Time and scale")]
pub struct TimeArgs {
    /// Width of the smoothing over time, in frames; 0 for no smoothing
    #[arg(long, default_value_t = SMOOTHING_FRAMES, value_name = "FRAMES")]
    pub smooth: f64,
    /// Number of frames to insert between every two frames of the motion; by default 5 for representatives and models, else 0
    ///
    /// A motion with its own frame rate (a track, a FAP file) keeps its duration.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(0..=1000))]
    pub between: Option<u16>,
    /// Frames per second of the output; by default those of the motion, or 25
    ///
    /// All frames are kept, so another rate makes the motion faster or slower. `grimace fap convert --fps` changes the rate of a FAP file and
    /// keeps its duration.
    #[arg(long, value_parser = frame_rate)]
    pub fps: Option<f64>,
    /// Motion below which a feature point counts as at rest, as a share of the largest motion of a feature point
    ///
    /// By default 0.05 for measured motion and 0 for a CSV file of feature points.
    #[arg(long, value_name = "SHARE")]
    pub noise: Option<f64>,
    /// Hold the last frame for half a second, then play the motion backwards to its first frame, so that it loops without a jump
    #[arg(long = "loop")]
    pub there_and_back: bool,
    /// Bank units per face unit (1/1024 of the eye separation), to use instead of the bank's facial animation units
    #[arg(long, value_parser = gain, value_name = "FACTOR")]
    pub scale: Option<f64>,
}

/// Frame rates whose times differ in single precision.
pub const FRAME_RATES: std::ops::RangeInclusive<f64> = 0.001..=10_000.0;

fn frame_rate(text: &str) -> Result<f64, String> {
    within(text, FRAME_RATES, "0.001 to 10000")
}

fn regions(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|regions| [1, 2, 4].contains(regions)).ok_or_else(|| "expected 1, 2 or 4".to_owned())
}

impl SearchArgs {
    /// The options, checked.
    pub fn options(&self, smoothing_frames: f64) -> anyhow::Result<SynthesisOptions> {
        let crossover = match self.crossover {
            CrossoverWord::Midpoint => Crossover::Midpoint,
            CrossoverWord::Line => Crossover::Line,
            CrossoverWord::Blx => Crossover::Blx { alpha: self.alpha },
        };
        let ga = GaOptions {
            population: self.population,
            tournament: self.tournament,
            generations: self.generations,
            crossover,
            runs: self.runs,
            seed: self.seed,
        };
        let options = SynthesisOptions {
            solver: match self.solver {
                SolverWord::Best => Solver::Best,
                SolverWord::Rbf => Solver::Rbf,
                SolverWord::Nnls => Solver::Nnls,
                SolverWord::Ga => Solver::Ga,
                SolverWord::Refined => Solver::Refined,
                SolverWord::Cosine => Solver::Cosine,
            },
            ga,
            regions: RegionScheme::of_count(self.regions)?,
            overlap: self.overlap,
            emphasis: self.emphasis,
            smoothing_frames,
            bound_starts: self.bound_starts,
            signs: match self.weights {
                SignsWord::Auto => Signs::Auto,
                SignsWord::Any => Signs::Any,
                SignsWord::Nonnegative => Signs::Nonnegative,
            },
        };
        options.check()?;
        Ok(options)
    }
}
