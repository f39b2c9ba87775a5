//! Climbing the fitness.
//!
//! The fitness of \[ZL\] is smooth but where a feature point rests. Each step climbs a model of it: the gradient g, and for the
//! curvature the Gauss-Newton matrix of the angles, `H = sum_i c_i A_i' (I - v v') A_i / s_i^2` with v the direction, s the length and c
//! the cosine of feature point i's motion `A_i w`; the model is maximized and the step halved until the fitness rises. A rest in the
//! length keeps s from 0; it is made smaller in rounds, and the fitness that is kept is the exact one.
//!
//! The fitness says nothing of lengths, and little of surfaces where members nearly cancel. A pull therefore joins it on request,
//! `- pull (|A w - d|^2 + ridge |w|^2) / (2 |d|^2)`, d the target: of the weights that are about as fit it prefers those whose feature
//! points also come close, and small ones.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::nonnegative::minimize;
use crate::synthesis::{Goal, fitness};

/// Which weights are allowed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Signs {
    /// Signed for motions in space, non-negative for motions in the plane: those say nothing of depth, and members that are
    /// subtracted from each other there could do anything.
    #[default]
    Auto,
    /// Any: members may be subtracted.
    Any,
    /// Zero or more: mixtures only.
    Nonnegative,
}

/// What is climbed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Climb {
    /// Whether weights below 0 are allowed.
    pub is_signed: bool,
    /// Weight of the pull towards the target's lengths.
    pub pull: f64,
    /// Ridge on the weights, as a share of the members' mean squared motion.
    pub ridge: f64,
}

impl Climb {
    /// The fitness alone, as the bound climbs it.
    pub fn fitness_alone(is_signed: bool) -> Self {
        Self { is_signed, pull: 0.0, ridge: 0.0 }
    }

    /// The fitness with the pull, as the refinement climbs it.
    pub fn with_pull(is_signed: bool) -> Self {
        Self { is_signed, pull: PULL, ridge: RIDGE }
    }
}

/// Weight of the refinement's pull, and its ridge.
const PULL: f64 = 1.0;
const RIDGE: f64 = 3e-4;
/// Rest in the lengths by round, as a share of the target's mean length.
const RESTS: [f64; 3] = [0.3, 0.03, 0.003];
/// Steps per round; most rounds end earlier.
const STEPS: usize = 30;
/// Halvings of a step.
const HALVINGS: usize = 12;
/// A rise below this ends a round.
const RISE: f64 = 1e-7;
/// Damping of the curvature, as a share of its mean.
const DAMPING: f64 = 1e-5;

/// Weights at a local maximum and their fitness, climbed to from `start`.
///
/// Without a pull never less fit than `start` (made non-negative where that is asked for). The summed length of the motion is the
/// target's.
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

/// A step up; `None` where none was found.
fn step(goal: &Goal, weights: &[f64], value: f64, rest: f64, how: Climb, pull: &Pull) -> Option<(Vec<f64>, f64)> {
    let members = goal.member_count();
    let motion = goal.motion(weights);
    let mut gradient = DVector::zeros(members);
    let mut curvature = DMatrix::zeros(members, members);
    let share = 1.0 / goal.moving() as f64;
    let directions = goal.directions().as_chunks::<3>().0;
    // Of every member at one feature point: its motion over s and the part of it along v, member by member.
    let mut at_point = vec![[0.0; 4]; members];
    for (point, (v, u)) in motion.as_chunks::<3>().0.iter().zip(directions).enumerate() {
        let s = (dot(v, v) + rest * rest).sqrt();
        let v = v.map(|c| c / s);
        let cosine = dot(&v, u);
        // How much a bend of the direction is worth there: the second derivative of the cosine, kept positive.
        let worth = cosine.max(0.1) * share;
        // (a - (a v) v)(b - (b v) v) = a b - (2 - v v)(a v)(b v); v is shorter than 1 by the rest.
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
