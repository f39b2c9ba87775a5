//! Learns to detect hidden points, and their expected errors, from pictures of people outside the training data of the stages that read
//! them.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::{
    augment::{Sample, Source, stream},
    faces::MovedFace,
    ridge::{FOLDS, among_numbers},
    start,
};
use crate::modules::locate::{
    PUPILS,
    covers::{CoverStage, part_seen},
    model::Model,
    part::FacePart,
    picture::Picture,
    points,
    shape::distance,
};

/// Pictures per photograph and per mirror image, of neutral faces and of smiles: without a cover, and (`COVERED`) with a covered part.
const OPEN: [usize; 2] = [3, 2];
const COVERED: [usize; 2] = [8, 2];

/// Covered share of a point's surroundings from which it counts as hidden, and (`SEEN_TO`) up to which it counts as visible. Points between
/// the two are not used.
const HIDDEN_FROM: f32 = 0.7;
const SEEN_TO: f32 = 0.1;

const PENALTY: f32 = 30.0;
const MIX_PENALTY: f32 = 300.0;

/// Mean error over the eye distance above which a face was not found; such faces are not used for the limits of parts.
const MISREAD: f32 = 0.08;
/// Largest share of visible parts that may be reported as covered.
const FALSE_ALARMS: f32 = 0.002;
/// Upper bound of the limit below which a part is reported as covered.
const MOST_LIMIT: f32 = -0.35;

/// Performance of the stage on people left out in turn.
#[derive(Clone, Debug, PartialEq)]
pub struct CoverSummary {
    /// Number of pictures with and without a covered part.
    pub pictures: [usize; 2],
    /// For each part: share of covered parts that are detected, and share of uncovered faces for which the part is reported.
    pub parts: Vec<(FacePart, f64, f64)>,
    /// Mean error of hidden points: expected and actual, percent of the eye distance.
    pub errors: [f64; 2],
}

/// A picture with both readings.
struct Looked {
    fold: usize,
    /// Whether nothing is covered.
    open: bool,
    /// Covered share of each point's surroundings.
    covered: Vec<f32>,
    /// Features of each local stage, in each view and in the order of that view.
    looks: [Vec<Vec<f32>>; 2],
    /// Error of each point, over the true eye distance, and its expected error.
    errors: Vec<f32>,
    expected: Vec<f32>,
}

/// Learns the stage. `models`: the model of all people, whose expected errors are learned, then the models without each fold.
pub fn learn_covers(models: &[Model], sources: &[Source], smiles: &[MovedFace], seed: u64) -> Option<(CoverStage, CoverSummary)> {
    let (smilers, smiling): (Vec<usize>, Vec<Source>) =
        smiles.iter().filter_map(|s| Some((s.person, Source::new(&s.face)?))).unzip();
    let everybody: Vec<usize> = (0..sources.len()).collect();
    let mut samples = Vec::new();
    for (k, (sources, people)) in [(sources, &everybody), (smiling.as_slice(), &smilers)].into_iter().enumerate() {
        for (count, purpose) in [(OPEN[k], 12), (COVERED[k], 14)] {
            let drawn = super::pictures_covered(sources, count, seed, purpose + k as u64, purpose == 14);
            samples.extend(drawn.into_iter().map(|s| Sample { face: people[s.face], ..s }));
        }
    }
    let looked: Vec<Looked> =
        samples.par_iter().enumerate().filter_map(|(i, sample)| look(models, sample, (seed, i as u64))).collect();
    drop(samples);
    let count = points().len();
    let lengths: Vec<usize> = looked.first()?.looks[0].iter().map(|look| look.len() / count).collect();
    let fold: Vec<usize> = looked.iter().map(|l| l.fold).collect();
    let twice: Vec<usize> = fold.iter().chain(&fold).copied().collect();
    let own: Vec<Separated> = (0..count)
        .into_par_iter()
        .map(|j| {
            let mut numbers = Vec::with_capacity(2 * looked.len() * lengths.iter().sum::<usize>());
            for view in 0..2 {
                for l in &looked {
                    l.looks[view].iter().zip(&lengths).for_each(|(look, length)| numbers.extend(&look[j * length..][..*length]));
                }
            }
            let in_mirror = points()[j].mirror;
            let covered = looked.iter().map(|l| l.covered[j]).chain(looked.iter().map(|l| l.covered[in_mirror]));
            separate(
                DMatrix::from_vec(lengths.iter().sum(), 2 * looked.len(), numbers),
                &covered.collect::<Vec<_>>(),
                &twice,
                PENALTY,
            )
        })
        .collect();
    // Mean of both views, in the order of the unmirrored picture.
    let said = |k: usize, i: usize| 0.5 * (own[k].said[i] + own[points()[k].mirror].said[looked.len() + i]);
    let all = DMatrix::from_fn(count, looked.len(), said);
    let mixed: Vec<Separated> = (0..count)
        .into_par_iter()
        .map(|k| separate(all.clone(), &looked.iter().map(|l| l.covered[k]).collect::<Vec<_>>(), &fold, MIX_PENALTY))
        .collect();
    let seen: Vec<Vec<f32>> = (0..looked.len()).map(|i| mixed.iter().map(|m| m.said[i]).collect()).collect();
    // Reordered so that the weights of one stage are contiguous, as they are read.
    let mut weights = Vec::new();
    let mut begin = 0;
    for length in &lengths {
        own.iter().for_each(|point| weights.extend(&point.weights[begin..begin + length]));
        begin += length;
    }
    let stage = CoverStage {
        weights,
        base: own.iter().map(|s| s.base).collect(),
        mix: mixed.iter().flat_map(|s| s.weights.iter().copied()).collect(),
        mix_base: mixed.iter().map(|s| s.base).collect(),
        errors: hidden_errors(&looked),
        limits: limits(&looked, &seen),
    };
    let summary = summary(&stage, &looked, &seen);
    Some((stage, summary))
}

/// Reads a picture twice, with the model trained without its person.
fn look(models: &[Model], sample: &Sample, (seed, unit): (u64, u64)) -> Option<Looked> {
    let fold = sample.face % FOLDS;
    let (everybodys, model) = (models.first()?, models.get(1 + fold)?);
    let picture = Picture::new(&sample.image)?;
    let random = &mut stream(seed, 16, unit);
    let mut start = || start(&model.mean, &sample.truth, random);
    let (plain, looks) = model.reading_and_looks(picture.view(false), start());
    let (mirrored, others) = model.mirrored_reading_and_looks(&picture, &start());
    let shape = super::mean_shape(&plain, &mirrored);
    let eye_distance = distance(shape[PUPILS[0]], shape[PUPILS[1]]).max(1e-3);
    let true_distance = distance(sample.truth[PUPILS[0]], sample.truth[PUPILS[1]]);
    let expected = everybodys.errors.expect_all([&plain, &mirrored], eye_distance);
    let open = sample.covered.is_empty();
    Some(Looked {
        fold,
        open,
        covered: if open { vec![0.0; points().len()] } else { sample.covered.clone() },
        looks: [looks, others],
        errors: shape.iter().zip(&sample.truth).map(|(&p, &t)| distance(p, t) / true_distance).collect(),
        expected,
    })
}

/// A linear function that separates visible from hidden points.
struct Separated {
    weights: Vec<f32>,
    base: f32,
    /// Its value for each sample, learned without the sample's fold.
    said: Vec<f32>,
}

/// Learns the function. `read`: features x samples. Both classes have the same total weight.
fn separate(mut read: DMatrix<f32>, covered: &[f32], fold: &[usize], penalty: f32) -> Separated {
    let (seen, hidden) = (covered.iter().filter(|c| **c < SEEN_TO).count(), covered.iter().filter(|c| **c > HIDDEN_FROM).count());
    let half = (seen + hidden) as f32 / 2.0;
    // Weight and target of a sample.
    let of = |c: f32| match c {
        c if c < SEEN_TO => (half / seen.max(1) as f32, 1.0),
        c if c > HIDDEN_FROM => (half / hidden.max(1) as f32, -1.0),
        _ => (0.0, 0.0),
    };
    let total = covered.iter().map(|&c| f64::from(of(c).0)).sum::<f64>().max(1e-9);
    let mut mean = vec![0.0_f64; read.nrows()];
    for (column, &c) in read.column_iter().zip(covered) {
        let weight = f64::from(of(c).0) / total;
        mean.iter_mut().zip(column.iter()).for_each(|(m, v)| *m += weight * f64::from(*v));
    }
    for mut column in read.column_iter_mut() {
        column.iter_mut().zip(&mean).for_each(|(v, m)| *v -= *m as f32);
    }
    let weighed = DMatrix::from_fn(read.nrows(), read.ncols(), |r, i| read[(r, i)] * of(covered[i]).0.sqrt());
    let wanted = DMatrix::from_fn(read.ncols(), 1, |i, _| of(covered[i]).0.sqrt() * of(covered[i]).1);
    let learned = among_numbers(&weighed, &wanted, fold, &[penalty]);
    let said = (0..read.ncols()).map(|i| learned.without[fold[i]].column(0).dot(&read.column(i))).collect();
    let weights: Vec<f32> = learned.all.as_slice().to_vec();
    let base = -weights.iter().zip(&mean).map(|(w, m)| f64::from(*w) * m).sum::<f64>() as f32;
    Separated { weights, base, said }
}

/// Returns the median error of each point together with its mirror image where they are hidden.
fn hidden_errors(looked: &[Looked]) -> Vec<f32> {
    let of = |k: usize| looked.iter().filter(move |l| l.covered[k] > HIDDEN_FROM).map(move |l| l.errors[k]);
    points()
        .iter()
        .enumerate()
        .map(|(k, point)| super::calibrate::median(&mut of(k).chain(of(point.mirror)).collect::<Vec<_>>()))
        .collect()
}

fn is_misread(l: &Looked) -> bool {
    l.errors.iter().sum::<f32>() > MISREAD * l.errors.len() as f32
}

/// Returns for each part the value below which it is covered, the same for left and right.
fn limits(looked: &[Looked], seen: &[Vec<f32>]) -> Vec<f32> {
    let of = |part: FacePart| {
        let open = looked.iter().zip(seen).filter(|(l, _)| l.open && !is_misread(l));
        open.map(move |(_, seen)| part_seen(part, seen)).collect::<Vec<f32>>()
    };
    let limit = |part: FacePart| {
        let mut values: Vec<f32> = of(part).into_iter().chain(of(part.in_mirror())).collect();
        values.sort_by(f32::total_cmp);
        values.get((values.len() as f32 * FALSE_ALARMS) as usize).map_or(MOST_LIMIT, |v| v.min(MOST_LIMIT))
    };
    FacePart::ALL.into_iter().map(limit).collect()
}

fn summary(stage: &CoverStage, looked: &[Looked], seen: &[Vec<f32>]) -> CoverSummary {
    let share = |hits: usize, of: usize| hits as f64 / of.max(1) as f64;
    let parts = FacePart::ALL.map(|part| {
        let said = |is_meant: &dyn Fn(&Looked) -> bool| {
            let meant = || looked.iter().zip(seen).filter(|(l, _)| is_meant(l));
            share(meant().filter(|(_, seen)| stage.covered(seen).contains(&part)).count(), meant().count())
        };
        (part, said(&|l| part_seen(part, &l.covered) > 0.9), said(&|l| l.open && !is_misread(l)))
    });
    let mut sums = [0.0; 2];
    let mut count = 0;
    for (l, seen) in looked.iter().zip(seen) {
        for k in (0..l.covered.len()).filter(|&k| l.covered[k] > HIDDEN_FROM) {
            sums[0] += f64::from(stage.expect(k, seen, l.expected[k]));
            sums[1] += f64::from(l.errors[k]);
            count += 1;
        }
    }
    let covered = looked.iter().filter(|l| !l.open).count();
    CoverSummary {
        pictures: [covered, looked.len() - covered],
        parts: parts.to_vec(),
        errors: sums.map(|sum| 100.0 * sum / f64::from(count.max(1))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_that_separate_visible_from_hidden_are_found_and_the_rest_is_left_out() {
        // The first number is 2 where a point is visible and 0 where it is hidden, the second is constant, the third alternates.
        let covered: Vec<f32> = (0..60).map(|i| [0.0, 0.0, 0.0, 1.0, 0.4][i % 5]).collect();
        let read = DMatrix::from_fn(3, 60, |r, i| match r {
            0 if covered[i] > HIDDEN_FROM => 0.0,
            0 => 2.0,
            1 => 7.0,
            _ => (i / 5 % 2) as f32,
        });
        let fold: Vec<usize> = (0..60).map(|i| i / 5 % FOLDS).collect();
        let found = separate(read, &covered, &fold, 1e-3);
        // The range from 0 to 2 maps to -1 to 1.
        approx::assert_relative_eq!(found.weights[0], 1.0, epsilon = 1e-3);
        approx::assert_relative_eq!(found.base + 2.0 * found.weights[0], 1.0, epsilon = 1e-3);
        assert!(found.weights[1].abs() < 1e-3 && found.weights[2].abs() < 1e-3, "{:?}", found.weights);
        approx::assert_relative_eq!(found.said[3], -1.0, epsilon = 0.01);
        assert_eq!(found.said.len(), 60);
    }
}
