//! Learns to detect parted lips and to locate their edges, from readings of people outside the training data of the earlier stages.

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

/// Lip distance, over the eye distance, from which lips are certainly parted, and up to which they are closed: the landmarks' error lies
/// between.
const CERTAIN: (f32, f32) = (0.045, 0.0055);

/// Largest share of pictures of closed mouths that may be detected as open.
const FALSE_ALARMS: f64 = 0.001;

/// Factor on the threshold, a margin for other people and cameras.
const MARGIN: f32 = 1.15;

/// Mean error of the points, over the eye distance, above which a face was not found.
const MISREAD: f32 = 0.07;

/// Smallest number of pictures of parted lips for training.
const LEAST: usize = 40;

const PENALTIES: [f32; 4] = [100.0, 1000.0, 10_000.0, 100_000.0];

/// Detection of parted lips on people left out in turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LipSummary {
    /// Number of pictures of certainly parted lips, and of closed ones.
    pub pictures: (usize, usize),
    /// Shares of both that are detected as parted.
    pub said: (f64, f64),
    /// Median distance of the edges of parted lips from the truth along the lines, percent of the eye distance: before and after this
    /// stage.
    pub errors: (f64, f64),
}

/// A mouth with its readings.
struct Mouth {
    fold: usize,
    shape: Shape,
    truth: Shape,
    /// Values read in the picture and in its mirror image.
    read: [Vec<f32>; 2],
    wanted: [f32; PREDICTED],
}

/// Learns the stage; `models` are those without each fold. Returns `None` if there are too few parted lips.
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

    // The mirror image of a line of the subject's left half is that of the right half.
    let edges = regression(&parted, |m| &m.wanted[1..], |k| EDGES * (LINES.len() - 1 - k / EDGES) + k % EDGES);
    // All rows share one offset of the values read; the difference goes into the constants of the edges.
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

/// A regression with its predictions.
struct Regression {
    /// Means of the values read.
    offset: Vec<f32>,
    /// Number of values read x number of values predicted.
    weights: DMatrix<f32>,
    /// Means of the predicted values.
    base: Vec<f32>,
    /// Prediction for each mouth by the regression without its fold, the mean over the mouth and its mirror image; mouths x values
    /// predicted.
    said: DMatrix<f32>,
}

/// Fits a regression. `mirrored` maps the index of a predicted value to that in the mirror image.
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

/// Returns the distances of the edges from the truth along their lines before and after, over the eye distance.
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

/// Returns the mean distance of points over the true eye distance.
fn mean_distance(shape: &Shape, truth: &Shape) -> f32 {
    let sum: f32 = shape.iter().zip(truth).map(|(&p, &q)| distance(p, q)).sum();
    sum / (shape.len().max(1) as f32 * pupils_apart(truth))
}

/// Returns the eye distance of a shape, above 0.
pub fn pupils_apart(shape: &Shape) -> f32 {
    distance(shape[PUPILS[0]], shape[PUPILS[1]]).max(f32::MIN_POSITIVE)
}
