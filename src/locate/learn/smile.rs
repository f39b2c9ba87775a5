//! Learns to read smiles, from readings of people outside the training data of the other stages.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::{
    LOCAL, LearnOptions, Sample, Smile,
    augment::{Source, stream},
    calibrate::median,
    local_stages, pictures,
    ridge::{FOLDS, among_samples, centre_rows},
    start,
};
use crate::modules::locate::{
    PUPILS,
    model::Model,
    picture::Picture,
    points,
    shape::{Shape, distance},
    smile::{SmileStage, around_moved, moved_points, placed_part},
};

/// Largest share of pictures of neutral faces that may be read as smiles.
const FALSE_ALARMS: f64 = 0.001;

/// Factor on the threshold, a margin for other people and cameras.
const MARGIN: f32 = 1.15;

/// Mean error of the points of nose and eyes, over the eye distance, above which a face was not found.
const MISREAD: f32 = 0.07;

/// Smallest number of pictures of smiles for training.
const LEAST: usize = 100;

const PENALTIES: [f32; 4] = [50.0, 250.0, 1000.0, 4000.0];

/// Reading of smiles of people left out in turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmileSummary {
    /// Number of pictures of smiles, and of neutral faces.
    pub pictures: (usize, usize),
    /// Shares of both that are read as smiles.
    pub said: (f64, f64),
    /// Mean error of the corners of the mouth on pictures read as smiles, percent of the eye distance, before and after this stage.
    pub corners: (f64, f64),
    /// The same of the inner edges of the lips.
    pub inner_lips: (f64, f64),
}

/// A face with its reading.
struct Face {
    sample: Sample,
    fold: usize,
    /// Motion of the corners of the mouth, over the eye distance; 0 for a neutral face.
    amount: f32,
    shape: Shape,
    /// Descriptors around the points that a smile moves.
    read: Vec<f32>,
}

/// Learns the stage. `models` are those without each fold. Returns `None` if there are too few smiles.
pub fn learn_smile(
    models: &[Model],
    sources: &[Source],
    smiles: &[Smile],
    options: &LearnOptions,
) -> Option<(Vec<SmileStage>, SmileSummary)> {
    let (kept, smiling): (Vec<&Smile>, Vec<Source>) = smiles.iter().filter_map(|s| Some((s, Source::new(&s.face)?))).unzip();
    let count = options.pictures.div_ceil(2);
    let neutral = pictures(sources, count, options.seed, 20).into_iter().map(|s| (0.0, s));
    let smiling = pictures(&smiling, count, options.seed, 21).into_iter();
    let smiling = smiling.map(|s| (kept[s.face].amount, Sample { face: kept[s.face].person, ..s }));
    let samples: Vec<(f32, Sample)> = neutral.chain(smiling).collect();
    let faces: Vec<Face> = samples
        .into_par_iter()
        .enumerate()
        .filter_map(|(i, (amount, sample))| read(models, amount, sample, (options.seed, i as u64)))
        .collect();
    if faces.iter().filter(|f| f.amount > 0.0).count() < LEAST {
        return None;
    }
    let fold: Vec<usize> = faces.iter().map(|f| f.fold).collect();

    // The estimate of the motion.
    let mut numbers = DMatrix::from_iterator(faces[0].read.len(), faces.len(), faces.iter().flat_map(|f| f.read.iter().copied()));
    let offset = centre_rows(&mut numbers);
    let mut wanted = DMatrix::from_iterator(1, faces.len(), faces.iter().map(|f| f.amount));
    let base = centre_rows(&mut wanted)[0];
    let amount = among_samples(&numbers, &wanted.transpose(), &fold, &PENALTIES);
    drop(numbers);
    let said: Vec<f32> = amount.predicted.iter().map(|v| v + base).collect();
    let mut of_neutral: Vec<f32> = faces.iter().zip(&said).filter(|(f, _)| f.amount == 0.0).map(|(_, &s)| s).collect();
    of_neutral.sort_by(f32::total_cmp);
    let place = ((1.0 - FALSE_ALARMS) * of_neutral.len() as f64) as usize;
    let smiles_from = of_neutral.get(place.min(of_neutral.len().saturating_sub(1))).map_or(1.0, |most| (MARGIN * most).clamp(0.0, 0.9));

    // The stages that move the points.
    let samples: Vec<&Sample> = faces.iter().map(|f| &f.sample).collect();
    let moved = moved_points();
    let truths: Vec<Shape> = samples.iter().map(|s| moved.iter().map(|&k| s.truth[k]).collect()).collect();
    let mut shapes: Vec<Shape> = faces.iter().map(|f| f.shape.clone()).collect();
    let mut stages: Vec<Vec<_>> = vec![Vec::new(); FOLDS + 1];
    for patches in LOCAL {
        let placed: Vec<_> = shapes.iter().zip(&faces).map(|(s, f)| placed_part(&models[f.fold].mean, s)).collect();
        let (learned, after) = local_stages(patches, &samples, &truths, &placed, &fold);
        for (shape, part) in shapes.iter_mut().zip(after) {
            moved.iter().zip(part).for_each(|(&k, point)| shape[k] = point);
        }
        stages.iter_mut().zip(learned).for_each(|(all, stage)| all.push(stage));
    }

    let smiles = || (0..faces.len()).filter(|&i| faces[i].amount > 0.0 && said[i] >= smiles_from);
    let error = |shape: &Shape, i: usize, k: usize| distance(shape[k], faces[i].sample.truth[k]) / pupils_apart(&faces[i].sample.truth);
    let errors: Vec<f32> = moved
        .iter()
        .map(|&k| {
            let both = [k, points()[k].mirror];
            let of = |&k: &usize| smiles().map(|i| error(&shapes[i], i, k)).collect::<Vec<f32>>();
            median(&mut both.iter().flat_map(of).collect::<Vec<f32>>())
        })
        .collect();
    let mean = |group: &dyn Fn(usize) -> bool| {
        let of = |shape: &dyn Fn(usize) -> Shape| {
            let all: Vec<f32> = smiles()
                .flat_map(|i| {
                    let shape = shape(i);
                    moved.iter().filter(|&&k| group(k)).map(|&k| error(&shape, i, k)).collect::<Vec<f32>>()
                })
                .collect();
            100.0 * all.iter().map(|&e| f64::from(e)).sum::<f64>() / all.len().max(1) as f64
        };
        (of(&|i| faces[i].shape.clone()), of(&|i| shapes[i].clone()))
    };
    let share = |of_smiles: bool| {
        let own: Vec<f32> = faces.iter().zip(&said).filter(|(f, _)| (f.amount > 0.0) == of_smiles).map(|(_, &s)| s).collect();
        own.iter().filter(|&&s| s >= smiles_from).count() as f64 / own.len().max(1) as f64
    };
    let summary = SmileSummary {
        pictures: (faces.len() - of_neutral.len(), of_neutral.len()),
        said: (share(true), share(false)),
        corners: mean(&|k| points()[k].group == "mouth corner"),
        inner_lips: mean(&|k| INNER.contains(&k)),
    };
    let weights = std::iter::once(&amount.all).chain(&amount.without);
    let learned = weights.zip(stages).map(|(weights, stages)| {
        let weights = weights.as_slice().to_vec();
        let base = base - weights.iter().zip(&offset).map(|(w, o)| f64::from(w * o)).sum::<f64>() as f32;
        SmileStage { weights, base, smiles_from, stages, errors: errors.clone() }
    });
    Some((learned.collect(), summary))
}

/// Inner edges of the lips, without the corners.
const INNER: std::ops::RangeInclusive<usize> = 58..=63;

/// Reads a picture with the model trained without its person; `None` if the face was not found.
fn read(models: &[Model], amount: f32, sample: Sample, (seed, unit): (u64, u64)) -> Option<Face> {
    let fold = sample.face % FOLDS;
    let model = &models[fold];
    let picture = Picture::new(&sample.image)?;
    let (reading, looks) =
        model.reading_and_looks(picture.view(false), start(&model.mean, &sample.truth, &mut stream(seed, 22, unit)));
    let still: Vec<usize> = (0..points().len()).filter(|&k| ["pupil", "eye corner", "nose"].contains(&points()[k].group.as_str())).collect();
    let off: f32 = still.iter().map(|&k| distance(reading.shape[k], sample.truth[k])).sum();
    if off > MISREAD * still.len() as f32 * pupils_apart(&sample.truth) {
        return None;
    }
    Some(Face { fold, amount, shape: reading.shape, read: around_moved(&looks), sample })
}

fn pupils_apart(shape: &Shape) -> f32 {
    distance(shape[PUPILS[0]], shape[PUPILS[1]]).max(f32::MIN_POSITIVE)
}
