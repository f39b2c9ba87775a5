//! Learning when lips are parted, and where their edges are, from what the stages before say of people who did not serve for them.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::{
    Sample,
    augment::stream,
    calibrate::median,
    read_twice,
    ridge::{FOLDS, among_numbers, centre_rows},
};
use crate::modules::locate::{
    PUPILS,
    lips::{EDGES, LEAST_EYE_DISTANCE, LENGTH, LINES, LipStage, PREDICTED, line_points, read_both, wanted},
    mean_shape,
    model::Model,
    picture::Picture,
    shape::{Shape, distance},
};

/// From which distance over the eye distance lips are parted for certain, and up to which they are closed: landmarks are off by so much.
const CERTAIN: (f32, f32) = (0.045, 0.0055);

/// Share of pictures of closed mouths that may be taken for open ones.
const FALSE_ALARMS: f64 = 0.001;

/// Other people and cameras are said to be this much further open.
const MARGIN: f32 = 1.15;

/// Mean distance of the points, over the eye distance, from which a face was not read at all.
const MISREAD: f32 = 0.07;

/// Fewest pictures of parted lips to learn from.
const LEAST: usize = 40;

const PENALTIES: [f32; 4] = [100.0, 1000.0, 10_000.0, 100_000.0];

/// How well parted lips are told from closed ones, on people left out in turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LipSummary {
    /// Pictures of lips that are parted for certain, and of closed ones.
    pub pictures: (usize, usize),
    /// Shares of them that are said to be parted.
    pub said: (f64, f64),
    /// Median distance of the edges of parted lips from the truth along the lines, percent of the eye distance: as the other stages place them, and
    /// then.
    pub errors: (f64, f64),
}

/// A mouth that was read.
struct Mouth {
    fold: usize,
    shape: Shape,
    truth: Shape,
    /// As it is, and in the mirror.
    read: [Vec<f32>; 2],
    wanted: [f32; PREDICTED],
}

/// Learns the stage; `models` are those without each fold. `None` where hardly any lips are parted.
pub fn learn_lips(models: &[Model], samples: &[Sample], seed: u64) -> Option<(LipStage, LipSummary)> {
    let mouths: Vec<Mouth> = samples
        .par_iter()
        .enumerate()
        .filter_map(|(i, sample)| {
            let fold = sample.face % FOLDS;
            let picture = Picture::new(&sample.image)?;
            let (plain, mirrored) = read_twice(&models[fold], &picture, sample, &mut stream(seed, 12, i as u64));
            let shape = mean_shape(&plain, &mirrored);
            if mean_distance(&shape, &sample.truth) > MISREAD {
                return None;
            }
            if pupils_apart(&sample.truth) < LEAST_EYE_DISTANCE {
                return None;
            }
            let read = read_both(&picture, &models[fold].mean, &shape);
            let wanted = wanted(&shape, &sample.truth);
            Some(Mouth { fold, shape, truth: sample.truth.clone(), read, wanted })
        })
        .collect();
    let (parted, closed): (Vec<&Mouth>, Vec<&Mouth>) =
        mouths.iter().filter(|m| m.wanted[0] >= CERTAIN.0 || m.wanted[0] <= CERTAIN.1).partition(|m| m.wanted[0] >= CERTAIN.0);
    if parted.len() < LEAST || closed.len() < LEAST {
        return None;
    }
    let all: Vec<&Mouth> = parted.iter().chain(&closed).copied().collect();
    let gap = regression(&all, |m| &m.wanted[..1], |k| k);
    let said = &gap.said;
    let mut of_closed: Vec<f32> = said.column(0).iter().skip(parted.len()).copied().collect();
    of_closed.sort_by(f32::total_cmp);
    let place = ((1.0 - FALSE_ALARMS) * of_closed.len() as f64) as usize;
    let parted_from = of_closed.get(place.min(of_closed.len() - 1)).map_or(CERTAIN.0, |most| (MARGIN * most).max(CERTAIN.0));

    // The lines of the subject's left half are those of the right half in the mirror.
    let edges = regression(&parted, |m| &m.wanted[1..], |k| EDGES * (LINES.len() - 1 - k / EDGES) + k % EDGES);
    // All rows are of what is read less one offset; that of the edges goes into their constants.
    let shift = DVector::from_iterator(LENGTH, gap.offset.iter().zip(&edges.offset).map(|(all, own)| all - own));
    let bases: Vec<f32> = (edges.weights.transpose() * shift).iter().zip(&edges.base).map(|(s, b)| s + b).collect();
    let weights = gap.weights.iter().chain(edges.weights.iter()).copied().collect();
    let mut stage = LipStage {
        offset: gap.offset.clone(),
        weights,
        base: [gap.base.clone(), bases].concat(),
        parted_from,
        expected_error: 0.0,
    };
    let errors = parted.iter().enumerate().flat_map(|(i, m)| edge_errors(m, edges.said.row(i).iter().copied()));
    let (mut before, mut after): (Vec<f32>, Vec<f32>) = errors.unzip();
    let (before, after) = (median(&mut before), median(&mut after));
    stage.expected_error = after;
    let over = |range: std::ops::Range<usize>| {
        let count = range.len().max(1) as f64;
        range.filter(|&i| said[(i, 0)] >= parted_from).count() as f64 / count
    };
    let summary = LipSummary {
        pictures: (parted.len(), closed.len()),
        said: (over(0..parted.len()), over(parted.len()..all.len())),
        errors: (100.0 * f64::from(before), 100.0 * f64::from(after)),
    };
    Some((stage, summary))
}

/// What is regressed from what was read, and how it does.
struct Regression {
    /// Means of what is read.
    offset: Vec<f32>,
    /// Numbers read x numbers predicted.
    weights: DMatrix<f32>,
    /// Means of what is predicted.
    base: Vec<f32>,
    /// For each mouth by the regression without its fold, as the mean of what it and its mirror image give; mouths x numbers predicted.
    said: DMatrix<f32>,
}

/// `mirrored` is which number in the mirror a number is.
fn regression(mouths: &[&Mouth], wanted: impl Fn(&Mouth) -> &[f32], mirrored: impl Fn(usize) -> usize) -> Regression {
    let reads =
        |side: usize| DMatrix::from_iterator(LENGTH, mouths.len(), mouths.iter().flat_map(|m| m.read[side].iter().copied()));
    let mut read = reads(0);
    let offset = centre_rows(&mut read);
    let numbers = mouths.first().map_or(0, |m| wanted(m).len());
    let mut wanted = DMatrix::from_iterator(numbers, mouths.len(), mouths.iter().flat_map(|m| wanted(m).iter().copied()));
    let base = centre_rows(&mut wanted);
    let fold: Vec<usize> = mouths.iter().map(|m| m.fold).collect();
    let folded = among_numbers(&read, &wanted.transpose(), &fold, &PENALTIES);
    let mut other = reads(1);
    for mut column in other.column_iter_mut() {
        column.iter_mut().zip(&offset).for_each(|(v, o)| *v -= o);
    }
    let said = DMatrix::from_fn(mouths.len(), numbers, |i, k| {
        let turned = folded.without[fold[i]].column(mirrored(k)).dot(&other.column(i)) + base[mirrored(k)];
        0.5 * (folded.predicted[(i, k)] + base[k] + turned)
    });
    Regression { offset, weights: folded.all, base, said }
}

/// How far the edges are off along their lines before and after, over the eye distance.
fn edge_errors(mouth: &Mouth, said: impl Iterator<Item = f32>) -> Vec<(f32, f32)> {
    let unit = pupils_apart(&mouth.truth);
    let as_found = wanted(&mouth.shape, &mouth.shape);
    let lengths = line_points().map(|[start, _, _, end]| distance(mouth.shape[start], mouth.shape[end]) / unit);
    let numbers = said.enumerate().map(|(k, said)| {
        let (truth, length) = (mouth.wanted[1 + k], lengths[k / EDGES]);
        ((as_found[1 + k] - truth).abs() * length, (said - truth).abs() * length)
    });
    numbers.collect()
}

/// Mean distance of points over the true eye distance.
fn mean_distance(shape: &Shape, truth: &Shape) -> f32 {
    let sum: f32 = shape.iter().zip(truth).map(|(&p, &q)| distance(p, q)).sum();
    sum / (shape.len().max(1) as f32 * pupils_apart(truth))
}

fn pupils_apart(shape: &Shape) -> f32 {
    distance(shape[PUPILS[0]], shape[PUPILS[1]]).max(f32::MIN_POSITIVE)
}
