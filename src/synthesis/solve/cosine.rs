//! Climbing the fitness over non-negative weights.
//!
//! The fitness of [ZL] is smooth but where a feature point rests. Each step climbs a model of it: the gradient g, and for the
//! curvature the Gauss-Newton matrix of the angles, `H = sum_i A_i' (I - v v') A_i / s_i^2` with v the direction and s the length of
//! feature point i's motion A_i w; the model is maximized over weights >= 0 and the step halved until the fitness rises. A rest in
//! the length keeps s from 0; it is made smaller in rounds, and the fitness that is kept is the exact one.

use nalgebra::{DMatrix, DVector};

use super::nonnegative::minimize;
use crate::synthesis::{fitness::fitness, target::Goal};

/// Rest in the lengths by round, as a share of the target's mean length.
const RESTS: [f64; 3] = [0.3, 0.03, 0.003];
/// Steps per round; most rounds end earlier.
const STEPS: usize = 30;
/// Halvings of a step.
const HALVINGS: usize = 12;
/// A rise of the fitness below this ends a round.
const RISE: f64 = 1e-7;
/// Damping of the curvature, as a share of its mean.
const DAMPING: f64 = 1e-4;

/// Weights of a local maximum of the fitness and its value, climbed to from `start`; never less fit than `start`.
///
/// The summed length of the motion is the target's.
pub fn climb(goal: &Goal, start: &[f64]) -> (Vec<f64>, f64) {
    let mut weights: Vec<f64> = start.iter().map(|w| w.max(0.0)).collect();
    goal.fit_length(&mut weights);
    let mut best = (start.to_vec(), fitness(goal, &goal.motion(start)));
    goal.fit_length(&mut best.0);
    let mean = goal.length() / goal.moving() as f64;
    for rest in RESTS {
        let rest = rest * mean;
        let mut value = rested_fitness(goal, &goal.motion(&weights), rest);
        for _ in 0..STEPS {
            let Some(next) = step(goal, &weights, value, rest) else { break };
            let rise = next.1 - value;
            (weights, value) = next;
            if rise < RISE {
                break;
            }
        }
        let exact = fitness(goal, &goal.motion(&weights));
        if exact > best.1 {
            best = (weights.clone(), exact);
        }
    }
    best
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
fn step(goal: &Goal, weights: &[f64], value: f64, rest: f64) -> Option<(Vec<f64>, f64)> {
    let members = goal.member_count();
    let motion = goal.motion(weights);
    let mut gradient = DVector::zeros(members);
    // Rows of the curvature's square root, three for each feature point.
    let mut root = DMatrix::zeros(3 * goal.moving(), members);
    let directions = goal.directions().as_chunks::<3>().0;
    for (point, (v, u)) in motion.as_chunks::<3>().0.iter().zip(directions).enumerate() {
        let s = (dot(v, v) + rest * rest).sqrt();
        let v = v.map(|c| c / s);
        let cosine = dot(&v, u);
        // How much a bend of the direction is worth there: the second derivative of the cosine.
        let worth = cosine.max(0.1).sqrt();
        for member in 0..members {
            let candidate = goal.moving_candidate(member);
            let a = [candidate[3 * point] / s, candidate[3 * point + 1] / s, candidate[3 * point + 2] / s];
            let along = dot(&a, &v);
            gradient[member] += dot(&a, u) - cosine * along;
            for axis in 0..3 {
                root[(3 * point + axis, member)] = worth * (a[axis] - along * v[axis]);
            }
        }
    }
    let mut curvature = root.tr_mul(&root);
    let damping = DAMPING * curvature.trace() / members as f64;
    if damping <= 0.0 {
        return None;
    }
    (0..members).for_each(|k| curvature[(k, k)] += damping);
    let here = DVector::from_column_slice(weights);
    let wanted = minimize(&curvature, &(&gradient + &curvature * &here), weights);
    let mut share = 1.0;
    for _ in 0..HALVINGS {
        let mut next: Vec<f64> = weights.iter().zip(&wanted).map(|(w, z)| (w + share * (z - w)).max(0.0)).collect();
        goal.fit_length(&mut next);
        let found = rested_fitness(goal, &goal.motion(&next), rest);
        if found > value {
            return Some((next, found));
        }
        share /= 2.0;
    }
    None
}
