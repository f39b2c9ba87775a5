//! Generates models like those of a recorded performance of the six expressions.
//!
//! \[ZL\] take their 384 models from one recorded performance; this module simulates one. Expressions follow each other and
//! overlap in time. Each has a random strength and may be blended with another one. Each time, every unit of it has its own
//! strength and lag, and one side is stronger than the other. The first models are the pure expressions at full strength.

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;

use super::random::{distinct, generator, unit};

/// A named mixture of shapes.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    /// Name of the mixture.
    pub name: String,
    /// Weight of every shape.
    pub weights: Vec<f64>,
}

/// Options of a performance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PerformanceOptions {
    /// Total number of models, including the pure expressions; at least the number of these.
    pub models: usize,
    /// Seed of all random draws.
    pub seed: u64,
}

impl Default for PerformanceOptions {
    /// The 384 models of \[ZL\].
    fn default() -> Self {
        Self { models: 384, seed: 1 }
    }
}

/// Smallest and largest number of frames from the onset of an expression to its end.
const DURATION: (f64, f64) = (16.0, 32.0);
/// Fraction of the duration after which the next expression starts.
const OVERLAP_AT: f64 = 0.7;
/// Fractions of the duration at which the apex starts and ends.
const APEX: (f64, f64) = (0.4, 0.6);
/// Smallest and largest strength at the apex.
const STRENGTH: (f64, f64) = (0.6, 1.0);
/// Probability that another expression is blended in, and its largest share.
const BLEND: (f64, f64) = (0.4, 0.5);
/// Standard deviations of a unit's strength (fraction), its lag (frames) and the asymmetry (fraction).
const UNIT_SD: f64 = 0.15;
const LAG_SD: f64 = 1.0;
const ASYMMETRY_SD: f64 = 0.1;
/// Limit of the draws, in standard deviations.
const LIMIT_SD: f64 = 2.0;

/// One expression in time.
struct Gesture {
    start: f64,
    duration: f64,
    /// Weights of the shapes at the apex.
    apex: Vec<f64>,
    /// Lag of every shape, frames.
    lags: Vec<f64>,
}

/// Generates the recipes of a performance: the pure expressions, then the frames.
///
/// `expressions` are named weights of S shapes. `sides` gives the side of each shape: left (1), right (-1) or neither (0).
/// Weights of a frame are limited to -1 to 1.
pub fn perform(expressions: &[(String, Vec<f64>)], sides: &[f64], options: &PerformanceOptions) -> Vec<Recipe> {
    let mut recipes: Vec<Recipe> =
        expressions.iter().map(|(name, weights)| Recipe { name: name.clone(), weights: weights.clone() }).collect();
    let frames = options.models.saturating_sub(recipes.len());
    let mut random = generator(options.seed, 0, 0, 0);
    let mut gestures = Vec::new();
    let mut start = -DURATION.1 * APEX.0;
    while start < frames as f64 && !expressions.is_empty() {
        for expression in distinct(&mut random, expressions.len(), expressions.len()) {
            let gesture = gesture(expressions, expression, sides, start, &mut random);
            start += OVERLAP_AT * gesture.duration;
            gestures.push(gesture);
        }
    }
    for frame in 0..frames {
        let mut weights = vec![0.0; sides.len()];
        for gesture in &gestures {
            for (shape, weight) in weights.iter_mut().enumerate().filter(|(shape, _)| gesture.apex[*shape] != 0.0) {
                let time = (frame as f64 - gesture.start - gesture.lags[shape]) / gesture.duration;
                *weight += gesture.apex[shape] * envelope(time);
            }
        }
        weights.iter_mut().for_each(|w| *w = w.clamp(-1.0, 1.0));
        recipes.push(Recipe { name: format!("frame_{frame:03}"), weights });
    }
    recipes
}

fn gesture(expressions: &[(String, Vec<f64>)], which: usize, sides: &[f64], start: f64, random: &mut ChaCha8Rng) -> Gesture {
    let between = |(low, high): (f64, f64), random: &mut ChaCha8Rng| low + (high - low) * unit(random);
    let normal = |sd: f64, random: &mut ChaCha8Rng| -> f64 {
        let z: f64 = StandardNormal.sample(random);
        z.clamp(-LIMIT_SD, LIMIT_SD) * sd
    };
    let duration = between(DURATION, random);
    let strength = between(STRENGTH, random);
    let asymmetry = normal(ASYMMETRY_SD, random);
    let share = if unit(random) < BLEND.0 { BLEND.1 * unit(random) } else { 0.0 };
    let other = &expressions[distinct(random, expressions.len(), 1)[0]].1;
    let shapes = expressions[which].1.iter().zip(other).zip(sides);
    let apex = shapes
        .map(|((own, other), side)| {
            let factor = (1.0 + normal(UNIT_SD, random)) * (1.0 + asymmetry * side);
            strength * factor * ((1.0 - share) * own + share * other)
        })
        .collect();
    let lags = sides.iter().map(|_| normal(LAG_SD, random)).collect();
    Gesture { start, duration, apex, lags }
}

/// Strength of an expression, 0 to 1, at a fraction of its duration. It rises and falls along half a cosine each.
fn envelope(time: f64) -> f64 {
    let rise = |share: f64| (1.0 - (std::f64::consts::PI * share).cos()) / 2.0;
    if time <= 0.0 || time >= 1.0 {
        0.0
    } else if time < APEX.0 {
        rise(time / APEX.0)
    } else if time > APEX.1 {
        rise((1.0 - time) / (1.0 - APEX.1))
    } else {
        1.0
    }
}

/// Fraction of the median motion; a model with less motion is too weak to become a member of a bank.
const WEAK: f64 = 0.3;

/// Chooses `count` models as members of a bank, so that they differ from each other. Returns their indices in the order of
/// choice.
///
/// The first `dominant` models are always chosen. Each further model is the one whose feature points move in the direction
/// farthest from all chosen ones (by the angle between whole motions). `motions` are the flat motions of the feature points of
/// each model. Models with very little motion are not chosen.
pub fn choose_members(motions: &[Vec<f64>], dominant: usize, count: usize) -> Vec<usize> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let lengths: Vec<f64> = motions.iter().map(|m| dot(m, m).sqrt()).collect();
    let mut sorted = lengths.clone();
    sorted.sort_by(f64::total_cmp);
    let least = WEAK * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let mut chosen: Vec<usize> = (0..dominant.min(count).min(motions.len())).collect();
    let cosine = |a: usize, b: usize| dot(&motions[a], &motions[b]) / (lengths[a] * lengths[b]).max(f64::MIN_POSITIVE);
    let mut nearest: Vec<f64> =
        (0..motions.len()).map(|k| chosen.iter().map(|&c| cosine(k, c)).fold(f64::NEG_INFINITY, f64::max)).collect();
    while chosen.len() < count {
        let free = (0..motions.len()).filter(|k| lengths[*k] > least && !chosen.contains(k));
        let Some(next) = free.min_by(|&a, &b| nearest[a].total_cmp(&nearest[b]).then(a.cmp(&b))) else { break };
        chosen.push(next);
        (0..motions.len()).for_each(|k| nearest[k] = nearest[k].max(cosine(k, next)));
    }
    chosen
}

/// Chooses `count` of `models` models as targets of an experiment, in ascending order; all of them when there are no more.
pub fn choose_targets(models: usize, count: usize, seed: u64) -> Vec<usize> {
    let mut chosen = distinct(&mut generator(seed, 0, 1, 0), models, count);
    chosen.sort_unstable();
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    fn expressions() -> Vec<(String, Vec<f64>)> {
        vec![("a".to_owned(), vec![1.0, 0.0, 0.5, 0.5]), ("b".to_owned(), vec![0.0, -0.8, 0.0, 0.0])]
    }

    #[test]
    fn the_first_are_pure_and_the_rest_flow() {
        let options = PerformanceOptions { models: 100, seed: 3 };
        let recipes = perform(&expressions(), &[0.0, 0.0, 1.0, -1.0], &options);
        assert_eq!(recipes.len(), 100);
        assert_eq!((recipes[0].name.as_str(), &recipes[0].weights), ("a", &expressions()[0].1));
        assert_eq!(recipes[2].name, "frame_000");
        // From frame to frame, half a cosine over 0.4 of 16 frames rises by at most pi/2 / 6.4, about 0.25 of at most 1.4.
        for pair in recipes[2..].windows(2) {
            for (a, b) in pair[0].weights.iter().zip(&pair[1].weights) {
                assert!((a - b).abs() < 0.7 && a.abs() <= 1.0);
            }
        }
        assert!(recipes[2..].iter().any(|r| r.weights[1] < -0.4) && recipes[2..].iter().any(|r| r.weights[0] > 0.5));
        assert_eq!(recipes, perform(&expressions(), &[0.0, 0.0, 1.0, -1.0], &options));
        assert_ne!(recipes[50], perform(&expressions(), &[0.0; 4], &PerformanceOptions { models: 100, seed: 4 })[50]);
    }

    #[test]
    fn the_envelope_starts_and_ends_at_rest() {
        assert_eq!([envelope(-0.1), envelope(0.0), envelope(0.5), envelope(1.0)], [0.0, 0.0, 1.0, 0.0]);
        assert!((envelope(0.2) - 0.5).abs() < 1e-12 && (envelope(0.8) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn members_are_far_from_each_other() {
        // 0 is given; 1 is its double, 3 the opposite, 2 is perpendicular, 4 is too weak.
        let motions = vec![vec![1.0, 0.0], vec![2.0, 0.1], vec![0.0, 1.0], vec![-1.0, 0.0], vec![0.0, -0.01]];
        assert_eq!(choose_members(&motions, 1, 3), [0, 3, 2]);
        assert_eq!(choose_members(&motions, 1, 9), [0, 3, 2, 1]);
    }
}
