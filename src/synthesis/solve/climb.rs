//! Local maximization of the fitness.
//!
//! The fitness of \[ZL\] is smooth except where a feature point does not move. Each step maximizes a quadratic model of it: the
//! gradient g, and as curvature the Gauss-Newton matrix of the angles, `H = sum_i c_i A_i' (I - v v') A_i / s_i^2`, with v the
//! direction, s the length and c the cosine of feature point i's motion `A_i w`. The step is halved until the fitness rises. A
//! small constant added to the lengths keeps s from 0; it is reduced in rounds, and the fitness returned is the exact one.
//!
//! The fitness does not depend on lengths, and hardly on surfaces where members nearly cancel. On request a pull is therefore
//! added, `- pull (|A w - d|^2 + ridge |w|^2) / (2 |d|^2)`, with d the target. Of weights with about the same fitness it prefers
//! small ones, and those whose feature points also come close to the target.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::nonnegative::minimize;
use crate::synthesis::{Goal, fitness};

/// Allowed signs of the weights.
///
/// ```
/// use grimace::synthesis::{Signs, SynthesisOptions};
///
/// let options = SynthesisOptions { signs: Signs::Nonnegative, ..SynthesisOptions::default() };
/// options.check()?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Signs {
    /// Signed for motions in space, non-negative for planar motions. Planar motions do not determine depth, where members
    /// subtracted from each other could do anything.
    #[default]
    Auto,
    /// Any sign: members may be subtracted.
    Any,
    /// Zero or more: mixtures only.
    Nonnegative,
}

/// The function to maximize.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Climb {
    /// Whether weights below 0 are allowed.
    pub is_signed: bool,
    /// Weight of the pull towards the target's lengths.
    pub pull: f64,
    /// Ridge on the weights, as a fraction of the members' mean squared motion.
    pub ridge: f64,
}

impl Climb {
    /// The fitness alone, used for the bound.
    pub fn fitness_alone(is_signed: bool) -> Self {
        Self { is_signed, pull: 0.0, ridge: 0.0 }
    }

    /// The fitness with the pull, used for the refinement.
    pub fn with_pull(is_signed: bool) -> Self {
        Self { is_signed, pull: PULL, ridge: RIDGE }
    }
}

/// Weight of the refinement's pull, and its ridge.
const PULL: f64 = 1.0;
const RIDGE: f64 = 3e-4;
/// Constant added to the lengths in each round, as a fraction of the target's mean length.
const RESTS: [f64; 3] = [0.3, 0.03, 0.003];
/// Largest number of steps per round; most rounds end earlier.
const STEPS: usize = 30;
/// Largest number of halvings of a step.
const HALVINGS: usize = 12;
/// An increase below this ends a round.
const RISE: f64 = 1e-7;
/// Damping of the curvature, as a fraction of its mean.
const DAMPING: f64 = 1e-5;

/// Climbs from `start` to a local maximum; returns the weights there and their fitness.
///
/// Without a pull, the fitness is never below that of `start` (made non-negative if required). The weights are scaled so that the
/// summed length of the motion is the target's.
pub fn climb(goal: &Goal, start: &[f64], how: Climb) -> (Vec<f64>, f64) {
    let mut weights: Vec<f64> = start.iter().map(|&w| if how.is_signed { w } else { w.max(0.0) }).collect();
    goal.fit_length(&mut weights);
    let pull = Pull::new(goal, how);
    let exact = |weights: &[f64]| {
        let fitness = fitness(goal, &goal.motion(weights));
        (fitness - pull.value(goal, weights), fitness)
    };
    let mut best = (weights.clone(), exact(&weights));
    let mean = goal.length() / goal.moving() as f64;
    for rest in RESTS {
        let rest = rest * mean;
        let mut value = rested_fitness(goal, &goal.motion(&weights), rest) - pull.value(goal, &weights);
        for _ in 0..STEPS {
            let Some(next) = step(goal, &weights, value, rest, how, &pull) else { break };
            let rise = next.1 - value;
            (weights, value) = next;
            if rise < RISE {
                break;
            }
        }
        let found = exact(&weights);
        if found.0 > best.1.0 {
            best = (weights.clone(), found);
        }
    }
    let (mut weights, (_, fitness)) = best;
    goal.fit_length(&mut weights);
    (weights, fitness)
}

/// The pull as a quadratic form `w' H w / 2 - f' w + c`.
struct Pull {
    curvature: DMatrix<f64>,
    right: DVector<f64>,
    constant: f64,
    is_on: bool,
}

impl Pull {
    fn new(goal: &Goal, how: Climb) -> Self {
        let members = goal.member_count();
        if how.pull == 0.0 {
            let (curvature, right) = (DMatrix::zeros(members, members), DVector::zeros(members));
            return Self { curvature, right, constant: 0.0, is_on: false };
        }
        let (mut gram, right) = super::normal_equations(goal);
        let ridge = how.ridge * gram.trace() / members as f64;
        (0..members).for_each(|k| gram[(k, k)] += ridge);
        let square: f64 = goal.target().iter().map(|d| d * d).sum();
        let scale = how.pull / square;
        Self { curvature: gram * scale, right: right * scale, constant: how.pull / 2.0, is_on: true }
    }

    fn value(&self, goal: &Goal, weights: &[f64]) -> f64 {
        debug_assert_eq!(weights.len(), goal.member_count());
        if !self.is_on {
            return 0.0;
        }
        let w = DVector::from_column_slice(weights);
        (&self.curvature * &w).dot(&w) / 2.0 - self.right.dot(&w) + self.constant
    }
}

/// The fitness with lengths `sqrt(|v|^2 + rest^2)`.
fn rested_fitness(goal: &Goal, motion: &[f64], rest: f64) -> f64 {
    let pairs = motion.as_chunks::<3>().0.iter().zip(goal.directions().as_chunks::<3>().0);
    let cosine = |(v, u): (&[f64; 3], &[f64; 3])| dot(v, u) / (dot(v, v) + rest * rest).sqrt();
    pairs.map(cosine).sum::<f64>() / goal.moving() as f64
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Makes one step up; `None` if none was found.
fn step(goal: &Goal, weights: &[f64], value: f64, rest: f64, how: Climb, pull: &Pull) -> Option<(Vec<f64>, f64)> {
    let members = goal.member_count();
    let motion = goal.motion(weights);
    let mut gradient = DVector::zeros(members);
    let mut curvature = DMatrix::zeros(members, members);
    let share = 1.0 / goal.moving() as f64;
    let directions = goal.directions().as_chunks::<3>().0;
    // For every member at one feature point: its motion divided by s, and the component of that along v.
    let mut at_point = vec![[0.0; 4]; members];
    for (point, (v, u)) in motion.as_chunks::<3>().0.iter().zip(directions).enumerate() {
        let s = (dot(v, v) + rest * rest).sqrt();
        let v = v.map(|c| c / s);
        let cosine = dot(&v, u);
        // Weight of a change of direction at this point: the second derivative of the cosine, kept positive.
        let worth = cosine.max(0.1) * share;
        // (a - (a v) v)(b - (b v) v) = a b - (2 - v v)(a v)(b v); v is shorter than 1 because of the constant added to the
        // length.
        let twice = 2.0 - dot(&v, &v);
        for (member, at) in at_point.iter_mut().enumerate() {
            let candidate = goal.moving_candidate(member);
            let a = [candidate[3 * point] / s, candidate[3 * point + 1] / s, candidate[3 * point + 2] / s];
            let along = dot(&a, &v);
            gradient[member] += share * (dot(&a, u) - cosine * along);
            *at = [a[0], a[1], a[2], along];
        }
        // The upper triangle of a symmetric matrix, column by column.
        for (k, (column, a)) in curvature.as_mut_slice().chunks_exact_mut(members).zip(&at_point).enumerate() {
            let [x, y, z, l] = [worth * a[0], worth * a[1], worth * a[2], -worth * twice * a[3]];
            column[..=k].iter_mut().zip(&at_point).for_each(|(sum, b)| *sum += x * b[0] + y * b[1] + z * b[2] + l * b[3]);
        }
    }
    curvature.fill_lower_triangle_with_upper_triangle();
    let here = DVector::from_column_slice(weights);
    if pull.is_on {
        gradient += &pull.right - &pull.curvature * &here;
        curvature += &pull.curvature;
    }
    let damping = DAMPING * curvature.trace() / members as f64;
    if damping <= 0.0 {
        return None;
    }
    (0..members).for_each(|k| curvature[(k, k)] += damping);
    let wanted = if how.is_signed {
        let toward = curvature.cholesky()?.solve(&gradient);
        (&here + toward).as_slice().to_vec()
    } else {
        minimize(&curvature, &(&gradient + &curvature * &here), weights)
    };
    let mut share = 1.0;
    for _ in 0..HALVINGS {
        let mut next: Vec<f64> = weights.iter().zip(&wanted).map(|(w, z)| w + share * (z - w)).collect();
        if !how.is_signed {
            next.iter_mut().for_each(|w| *w = w.max(0.0));
        }
        if !pull.is_on {
            goal.fit_length(&mut next);
        }
        let found = rested_fitness(goal, &goal.motion(&next), rest) - pull.value(goal, &next);
        if found > value {
            return Some((next, found));
        }
        share /= 2.0;
    }
    None
}
