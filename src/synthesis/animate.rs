//! Computes weights over time from the motion of feature points: solves every frame, then smooths the weights in time.
//!
//! Each frame and region is searched independently. Two searches can return different weights for nearly the same target, which
//! would make the animation flicker. The weights of a frame are therefore split, as in the paper, into a length and a direction.
//! The length is the length of the target motion and stays unchanged. The direction, `u = w / L` (weights per length of motion),
//! is smoothed in time by the x that minimizes
//!
//! `sum_t L_t^2 |x_t - u_t|^2 + sigma^2 mean(L^2) sum_t |x_(t+1) - x_t|^2`
//!
//! with sigma in frames. This is E. Whittaker's smoother (*On a new method of graduation*, 1923) with first differences. Frames
//! with a large motion have a large weight; a frame near neutral, whose direction is uncertain, takes it from its neighbours. The
//! smoother is an average with positive weights: non-negative weights stay non-negative, and a constant direction stays constant.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    Bank, FpBasis, FpMotion, FrameAnswer, Goal, RegionScheme, Regions, Signs, Solution, Solver, SynthesisError,
    fitness::fitness,
    regions::OVERLAP,
    search::GaOptions,
    solve::{best_member, bound, genetic, interpolate, least_squares, refined},
    surface::surface,
    target::{moving_points, staying_points, summed_length},
};

/// Default width sigma of the smoothing in time, in frames.
pub const SMOOTHING_FRAMES: f64 = 2.0;
/// Smallest emphasis; the largest is its reciprocal. Beyond these limits, squared motions are lost in rounding.
const LEAST_EMPHASIS: f64 = 1e-6;
/// Range of the smoothing width, in frames. Below it the smoother's equations equal no smoothing, above it an average over
/// all frames, up to rounding.
const LEAST_SMOOTHING: f64 = 1e-6;
const MOST_SMOOTHING: f64 = 1e5;
/// Default number of starts of the search for the bound.
pub const BOUND_STARTS: usize = 8;

/// Options for turning a motion into a surface.
///
/// ```
/// use grimace::synthesis::{RegionScheme, SynthesisOptions};
///
/// let options = SynthesisOptions { regions: RegionScheme::Halves, emphasis: 1.2, ..SynthesisOptions::default() };
/// assert!(options.check().is_ok());
/// assert!(SynthesisOptions { emphasis: 0.0, ..options }.check().is_err());
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SynthesisOptions {
    /// Method that finds the weights.
    pub solver: Solver,
    /// Parameters of the genetic algorithm.
    pub ga: GaOptions,
    /// How the face is divided into regions.
    pub regions: RegionScheme,
    /// Width of the overlap of two regions, as a fraction of the width of the face.
    pub overlap: f64,
    /// Emphasis level c [ZL, section 5]: a factor on the input motion, greater than 0.
    pub emphasis: f64,
    /// Width sigma of the smoothing in time, in frames; 0 for none.
    pub smoothing_frames: f64,
    /// Number of starts of the search for the bound; 0 for no bound.
    pub bound_starts: usize,
    /// Signs of weights that refinement and bound allow.
    pub signs: Signs,
}

impl Default for SynthesisOptions {
    fn default() -> Self {
        Self {
            solver: Solver::Refined,
            ga: GaOptions::default(),
            regions: RegionScheme::Whole,
            overlap: OVERLAP,
            emphasis: 1.0,
            smoothing_frames: SMOOTHING_FRAMES,
            bound_starts: BOUND_STARTS,
            signs: Signs::Auto,
        }
    }
}

impl SynthesisOptions {
    /// Checks the ranges that [`Regions::new`] does not check.
    ///
    /// # Errors
    /// [`SynthesisError::Option`].
    pub fn check(&self) -> Result<(), SynthesisError> {
        self.ga.check()?;
        if !(LEAST_EMPHASIS..=1.0 / LEAST_EMPHASIS).contains(&self.emphasis) {
            let found = self.emphasis.to_string();
            return Err(SynthesisError::Option { what: "the emphasis", found, expected: "a number from 0.000001 to 1000000" });
        }
        let smooths = (LEAST_SMOOTHING..=MOST_SMOOTHING).contains(&self.smoothing_frames);
        if !(smooths || self.smoothing_frames == 0.0) {
            let found = self.smoothing_frames.to_string();
            return Err(SynthesisError::Option { what: "the smoothing", found, expected: "0, or 0.000001 to 100000 frames" });
        }
        Ok(())
    }
}

/// A bank prepared for searches.
///
/// ```
/// # let mesh = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// # let mesh = grimace::mesh::TriangleMesh::new(mesh, vec![[0, 1, 2], [0, 2, 3]])?;
/// # let names = ["right", "up"].map(str::to_owned).to_vec();
/// # let moves = [[[1.0, 0.0, 0.0]; 4], [[0.0, 1.0, 0.0]; 4]].concat();
/// # let points = [("8.4", 0), ("8.3", 1), ("3.11", 2)];
/// # let points = points.map(|(fp, vertex)| grimace::synthesis::FeaturePointVertex { fp: fp.parse().unwrap(), vertex }).to_vec();
/// # let bank = grimace::synthesis::Bank::new(mesh, names, moves, points, Default::default())?;
/// use grimace::synthesis::{FpMotion, Solver, SynthesisOptions, Synthesizer};
///
/// // The two members of `bank` move all vertices by 1: to the right, and up.
/// let options = SynthesisOptions { solver: Solver::Nnls, ..SynthesisOptions::default() };
/// let synthesizer = Synthesizer::new(&bank, options)?;
/// let up = FpMotion::of_surface(&bank, bank.displacements(1));
/// let surface = synthesizer.surface(&synthesizer.solve(&up, 0), &up);
/// // Every vertex goes up by 1, as in the bank's second member.
/// assert!(surface.iter().all(|[x, y, _]| x.abs() < 1e-5 && (y - 1.0).abs() < 1e-5));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Synthesizer<'b> {
    bank: &'b Bank,
    basis: FpBasis,
    regions: Regions,
    options: SynthesisOptions,
}

impl<'b> Synthesizer<'b> {
    /// Reads the motion of the bank's feature points and divides the face into regions.
    ///
    /// # Errors
    /// [`SynthesisError::Option`] for options out of range.
    pub fn new(bank: &'b Bank, options: SynthesisOptions) -> Result<Self, SynthesisError> {
        options.check()?;
        let regions = Regions::new(bank, options.regions, options.overlap)?;
        Ok(Self { bank, basis: FpBasis::new(bank), regions, options })
    }

    /// The bank.
    pub fn bank(&self) -> &'b Bank {
        self.bank
    }

    /// The regions.
    #[doc(hidden)]
    pub fn regions(&self) -> &Regions {
        &self.regions
    }

    /// The options.
    pub fn options(&self) -> &SynthesisOptions {
        &self.options
    }

    /// The feature points that motion of these may take along.
    pub(crate) fn near_points(&self, moving: &[usize]) -> Vec<usize> {
        self.basis.near_points(moving)
    }

    /// The goal of a region; `None` when nothing in it should move, or there is no such region. `motion` must already be
    /// emphasized.
    pub(crate) fn goal(&self, motion: &FpMotion, region: usize) -> Option<Goal> {
        if region >= self.regions.count() {
            return None;
        }
        Goal::new(&self.basis, motion, |point| self.regions.point_shares(region)[point] > 0.0)
    }

    /// The goal of all feature points, regardless of regions. `motion` must already be emphasized.
    pub(crate) fn whole_goal(&self, motion: &FpMotion) -> Option<Goal> {
        Goal::new(&self.basis, motion, |_| true)
    }

    /// Solves one frame. `frame` only selects the random streams.
    pub fn solve(&self, motion: &FpMotion, frame: usize) -> FrameAnswer {
        let motion = motion.emphasized(self.options.emphasis);
        let count = self.regions.count();
        let mut answer = FrameAnswer {
            weights: Vec::with_capacity(count),
            region_fitness: Vec::with_capacity(count),
            fitness: None,
            shown: None,
            region_shown: vec![None; count],
            region_bound: Vec::with_capacity(count),
            runs: Vec::with_capacity(count),
        };
        for region in 0..count {
            let Some(goal) = self.goal(&motion, region) else {
                answer.weights.push(vec![0.0; self.bank.member_count()]);
                answer.region_fitness.push(None);
                answer.region_bound.push(None);
                answer.runs.push(Vec::new());
                continue;
            };
            let (starts, seed) = (self.options.bound_starts, self.options.ga.seed);
            let is_signed = match self.options.signs {
                Signs::Auto => !motion.planar,
                Signs::Any => true,
                Signs::Nonnegative => false,
            };
            let climbed = (starts > 0).then(|| bound(&goal, starts, is_signed, seed, frame, region));
            let mut solution = self.solve_goal(&goal, is_signed, frame, region, climbed.as_ref());
            if goal.rest_where_nothing_is_shown(&mut solution.weights) {
                solution.fitness = 0.0;
            }
            answer.region_bound.push(climbed.map(|b| b.fitness));
            answer.region_fitness.push(Some(solution.fitness));
            answer.weights.push(solution.weights);
            answer.runs.push(solution.runs);
        }
        self.measure(&mut answer, &motion);
        answer
    }

    fn solve_goal(&self, goal: &Goal, is_signed: bool, frame: usize, region: usize, climbed: Option<&Solution>) -> Solution {
        let ga = &self.options.ga;
        match self.options.solver {
            Solver::Best | Solver::Rbf => best_member(goal),
            Solver::Nnls => least_squares(goal),
            Solver::Ga => genetic(goal, ga, frame, region),
            Solver::Refined => refined(goal, ga, is_signed, frame, region),
            Solver::Cosine => climbed.cloned().unwrap_or_else(|| bound(goal, BOUND_STARTS, is_signed, ga.seed, frame, region)),
        }
    }

    /// Computes the fitness and the share shown, for each region and for the joined surface.
    ///
    /// They follow from the weights, for [`Solver::Rbf`] from its surface. `motion` must already be emphasized. A bound below the
    /// fitness of the answer is raised to that fitness.
    fn measure(&self, answer: &mut FrameAnswer, motion: &FpMotion) {
        let rbf = (self.options.solver == Solver::Rbf).then(|| {
            let surface = interpolate(self.bank, motion);
            self.bank.feature_points().iter().map(|p| surface[p.vertex as usize].map(f64::from)).collect::<Vec<_>>()
        });
        let points = match &rbf {
            Some(points) => points.clone(),
            None => self.joined_motion(&answer.weights),
        };
        let of_points = |goal: &Goal, is_in: &dyn Fn(usize) -> bool| {
            let flat = |chosen: Vec<usize>| -> Vec<f64> { chosen.iter().flat_map(|&k| motion.seen(k, points[k])).collect() };
            let rest = flat(staying_points(motion, self.bank.feature_points().len(), is_in));
            let moved = flat(self.moving_points(motion, is_in));
            (goal.counting_rest(fitness(goal, &moved), &rest), goal.shown_by(&moved))
        };
        (answer.fitness, answer.shown) = self.whole_goal(motion).map(|goal| of_points(&goal, &|_| true)).unzip();
        for region in 0..self.regions.count() {
            let measured = self.goal(motion, region).map(|goal| match &rbf {
                Some(_) => of_points(&goal, &|point| self.regions.point_shares(region)[point] > 0.0),
                None => (goal.fitness_of(&answer.weights[region]), goal.shown(&answer.weights[region])),
            });
            (answer.region_fitness[region], answer.region_shown[region]) = measured.unzip();
            if let (Some(bound), Some((fitness, _))) = (&mut answer.region_bound[region], measured) {
                *bound = bound.max(fitness);
            }
        }
        if rbf.is_some() {
            // The bound holds for mixtures of the bank only; this surface is not one.
            answer.weights.clear();
            answer.region_bound.fill(None);
        }
    }

    /// Indices of the feature points that a goal treats as moving, in the goal's order.
    pub(super) fn moving_points(&self, motion: &FpMotion, is_in: &dyn Fn(usize) -> bool) -> Vec<usize> {
        moving_points(motion, self.bank.feature_points().len(), is_in)
    }

    /// Largest motion of a free point, as a fraction of the longest target motion, beside these moving points.
    pub(super) fn free_reach(&self, point: usize, moving: &[usize]) -> f64 {
        self.basis.free_reach(point, moving)
    }

    /// Motion of the feature points in the joined surface.
    pub(super) fn joined_motion(&self, weights: &[Vec<f64>]) -> Vec<[f64; 3]> {
        let points = self.bank.feature_points().len();
        let mut sum = vec![[0.0; 3]; points];
        for (region, weights) in weights.iter().enumerate() {
            let shares = self.regions.point_shares(region);
            for (member, &weight) in weights.iter().enumerate().filter(|(_, w)| **w != 0.0) {
                for (point, sum) in sum.iter_mut().enumerate() {
                    let motion = self.basis.motion(member, point);
                    (0..3).for_each(|axis| sum[axis] += weight * shares[point] * motion[axis]);
                }
            }
        }
        sum
    }

    /// Vertex displacements of the surface for an answer to `motion` (as given, not emphasized).
    pub fn surface(&self, answer: &FrameAnswer, motion: &FpMotion) -> Vec<[f32; 3]> {
        if self.options.solver == Solver::Rbf {
            interpolate(self.bank, &motion.emphasized(self.options.emphasis))
        } else {
            surface(self.bank, &self.regions, &answer.weights)
        }
    }

    /// Solves all frames and smooths the weights in time. Frames run in parallel; the result does not depend on the number of
    /// threads.
    ///
    /// `done` is called after every solved frame.
    pub fn animate(&self, motions: &[FpMotion], done: impl Fn() + Sync) -> Vec<FrameAnswer> {
        let solve = |(frame, motion)| {
            let answer = self.solve(motion, frame);
            done();
            answer
        };
        let mut answers: Vec<FrameAnswer> = motions.par_iter().enumerate().map(solve).collect();
        if self.options.smoothing_frames > 0.0 && self.options.solver != Solver::Rbf {
            for region in 0..self.regions.count() {
                self.smooth(&mut answers, motions, region);
            }
            let measured = answers.par_iter_mut().zip(motions);
            measured.for_each(|(answer, motion)| self.measure(answer, &motion.emphasized(self.options.emphasis)));
        }
        answers
    }

    fn smooth(&self, answers: &mut [FrameAnswer], motions: &[FpMotion], region: usize) {
        let emphasized = |m: &FpMotion| m.emphasized(self.options.emphasis);
        let goals: Vec<Option<Goal>> = motions.iter().map(|m| self.goal(&emphasized(m), region)).collect();
        let lengths: Vec<f64> = goals.iter().map(|g| g.as_ref().map_or(0.0, Goal::length)).collect();
        let Some(smoother) = Smoother::new(&lengths, self.options.smoothing_frames) else { return };
        for member in 0..self.bank.member_count() {
            let weights: Vec<f64> = answers.iter().map(|a| a.weights[region][member]).collect();
            let directions = smoother.directions(&weights);
            for ((answer, direction), length) in answers.iter_mut().zip(directions).zip(&lengths) {
                answer.weights[region][member] = direction * length;
            }
        }
        for (answer, goal) in answers.iter_mut().zip(&goals) {
            let Some(goal) = goal else { continue };
            if self.options.solver != Solver::Nnls {
                goal.fit_length(&mut answer.weights[region]);
            }
            goal.rest_where_nothing_is_shown(&mut answer.weights[region]);
        }
    }
}

/// The tridiagonal system of the smoother after elimination.
struct Smoother<'a> {
    lengths: &'a [f64],
    tie: f64,
    pivots: Vec<f64>,
}

impl<'a> Smoother<'a> {
    /// `None` when nothing moves in any frame.
    fn new(lengths: &'a [f64], sigma: f64) -> Option<Self> {
        let mean = lengths.iter().map(|l| l * l).sum::<f64>() / lengths.len().max(1) as f64;
        if mean <= 0.0 {
            return None;
        }
        let tie = sigma * sigma * mean;
        let last = lengths.len() - 1;
        let mut pivots = Vec::with_capacity(lengths.len());
        for (t, length) in lengths.iter().enumerate() {
            let ties = if last == 0 { 0.0 } else { f64::from(u8::from(t > 0) + u8::from(t < last)) };
            let diagonal = length * length + ties * tie;
            let above = pivots.last().map_or(0.0, |p: &f64| tie * tie / p);
            pivots.push(diagonal - above);
        }
        Some(Self { lengths, tie, pivots })
    }

    /// Returns the smoothed weights per length of motion.
    fn directions(&self, weights: &[f64]) -> Vec<f64> {
        // L^2 u = L w.
        let mut x: Vec<f64> = weights.iter().zip(self.lengths).map(|(w, l)| w * l).collect();
        for t in 1..x.len() {
            x[t] += x[t - 1] * self.tie / self.pivots[t - 1];
        }
        for t in (0..x.len()).rev() {
            let next = x.get(t + 1).copied().unwrap_or(0.0);
            x[t] = (x[t] + self.tie * next) / self.pivots[t];
        }
        x
    }
}

/// Jitter of the motion of feature points: the root mean square of the second differences in time, divided by that of the motion.
///
/// It is 0 for a motion of constant speed. For the target it measures how smooth the input is, for the result how much the
/// surface flickers. `None` for fewer than three frames or no motion.
pub fn jump(motions: &[Vec<[f64; 3]>]) -> Option<f64> {
    let square = |v: [f64; 3]| v.iter().map(|c| c * c).sum::<f64>();
    let mut jumps = (0.0, 0_usize);
    for three in motions.windows(3) {
        for ((a, b), c) in three[0].iter().zip(&three[1]).zip(&three[2]) {
            jumps.0 += square(std::array::from_fn(|axis| a[axis] - 2.0 * b[axis] + c[axis]));
            jumps.1 += 1;
        }
    }
    let size: f64 = motions.iter().flatten().map(|&v| square(v)).sum();
    let count = motions.iter().map(Vec::len).sum::<usize>();
    (jumps.1 > 0 && size > 0.0).then(|| (jumps.0 / jumps.1 as f64).sqrt() / (size / count as f64).sqrt())
}

impl Synthesizer<'_> {
    /// Motion of the feature points in every answer; for [`Solver::Rbf`] it is read from the interpolated surface.
    pub fn point_motions(&self, answers: &[FrameAnswer], motions: &[FpMotion]) -> Vec<Vec<[f64; 3]>> {
        let of = |(answer, motion): (&FrameAnswer, &FpMotion)| {
            if self.options.solver == Solver::Rbf {
                let surface = self.surface(answer, motion);
                self.bank.feature_points().iter().map(|p| surface[p.vertex as usize].map(f64::from)).collect()
            } else {
                self.joined_motion(&answer.weights)
            }
        };
        answers.iter().zip(motions).map(of).collect()
    }

    /// Summed length of motion of the moving feature points in an answer, divided by that of the target; 1 when the lengths
    /// agree.
    pub fn length_ratio(&self, answer: &FrameAnswer, motion: &FpMotion) -> Option<f64> {
        let motion = motion.emphasized(self.options.emphasis);
        let goal = self.whole_goal(&motion)?;
        let points = self.joined_motion(&answer.weights);
        let moved = self.moving_points(&motion, &|_| true);
        let flat: Vec<f64> = moved.iter().flat_map(|&k| motion.seen(k, points[k])).collect();
        Some(summed_length(&flat) / goal.length())
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use nalgebra::Vector3;

    use super::*;
    use crate::synthesis::testing;

    /// The target moves three points by 2 to the right; the answer moves them by 1 to the right and 1 up.
    fn halved(bound: f64) -> FrameAnswer {
        let bank = testing::bank().select(&[0, 1]).unwrap();
        let synthesizer = Synthesizer::new(&bank, SynthesisOptions::default()).unwrap();
        let motion = FpMotion { offsets: vec![Some(2.0 * Vector3::x()); 3], planar: true, ..FpMotion::default() };
        let mut answer = synthesizer.solve(&motion, 0);
        (answer.weights, answer.region_bound) = (vec![vec![1.0, 1.0]], vec![Some(bound)]);
        synthesizer.measure(&mut answer, &motion);
        answer
    }

    #[test]
    fn surfaces_and_regions_that_are_not_there_have_no_motion() {
        let bank = testing::bank();
        let synthesizer = Synthesizer::new(&bank, SynthesisOptions::default()).unwrap();
        let none = FpMotion::of_surface(&bank, &[]);
        assert!(!none.offsets.is_empty() && none.offsets.iter().all(Option::is_none));
        let motion = FpMotion::of_surface(&bank, bank.displacements(0));
        assert!((0..synthesizer.regions().count()).any(|region| synthesizer.goal(&motion, region).is_some()));
        assert!(synthesizer.goal(&motion, usize::MAX).is_none());
    }

    #[test]
    fn the_share_shown_counts_lengths_along_the_motion_asked_for() {
        // The cosine of 45 degrees; and 1 of 2.
        let answer = halved(0.9);
        assert_relative_eq!(answer.fitness.unwrap(), 0.5_f64.sqrt(), epsilon = 1e-9);
        assert_relative_eq!(answer.shown.unwrap(), 0.5, epsilon = 1e-9);
        assert_eq!((answer.region_shown, answer.region_bound), (vec![answer.shown], vec![Some(0.9)]));
    }

    #[test]
    fn a_bound_that_an_answer_exceeds_rises_to_it() {
        let answer = halved(0.6);
        assert_eq!(answer.region_bound, answer.region_fitness);
        assert_eq!(answer.share_of_bound(), Some(1.0));
    }

    #[test]
    fn the_smoother_keeps_what_is_constant_and_averages_what_jumps() {
        // Weights in proportion to the lengths: direction 2 in every frame, also in the frame without motion.
        let lengths = [0.0, 1.0, 2.0, 3.0];
        let smoother = Smoother::new(&lengths, 2.0).unwrap();
        for x in smoother.directions(&[0.0, 2.0, 4.0, 6.0]) {
            assert_relative_eq!(x, 2.0, epsilon = 1e-12);
        }
        // Two frames of length 1 with directions 0 and 1, sigma 1: (x0 - 0) = x1 - x0 and (1 - x1) = x1 - x0, so 1/3 and 2/3.
        let lengths = [1.0, 1.0];
        let x = Smoother::new(&lengths, 1.0).unwrap().directions(&[0.0, 1.0]);
        assert_relative_eq!(x[0], 1.0 / 3.0, epsilon = 1e-12);
        assert_relative_eq!(x[1], 2.0 / 3.0, epsilon = 1e-12);
        assert!(Smoother::new(&[0.0; 5], 2.0).is_none());
    }

    #[test]
    fn constant_speed_has_no_jump() {
        let line: Vec<Vec<[f64; 3]>> = (0..5).map(|t| vec![[f64::from(t), 0.0, 0.0]]).collect();
        assert_eq!(jump(&line), Some(0.0));
        // 0, 1, 0: second difference -2 over the mean square 1/3.
        let tick = vec![vec![[0.0; 3]], vec![[1.0, 0.0, 0.0]], vec![[0.0; 3]]];
        assert_relative_eq!(jump(&tick).unwrap(), 2.0 * 3.0_f64.sqrt(), epsilon = 1e-12);
        assert_eq!(jump(&line[..2]), None);
    }
}
