//! Learns to read smiles, from readings of people outside the training data of the other stages.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::{
    LOCAL, LearnOptions, Sample, Smile,
    augment::{Source, stream},
    calibrate::median,
    lips::pupils_apart,
    local_stages, pictures,
    ridge::{FOLDS, among_samples, centre_rows},
    start,
};
use crate::modules::locate::{
    cells::Patch,
    lips::line_points,
    model::Model,
    picture::Picture,
    points,
    shape::{Shape, distance},
    smile::{SmileStage, around_moved, moved_points, placed_part},
    stages::LocalStage,
};

/// Patches of the first stage: lips are further from their places than on neutral faces.
const WIDE: &[Patch] = &[Patch { size: 36.0, cell: 0.18, side: 4, blur: 3 }, Patch { size: 48.0, cell: 0.13, side: 4, blur: 3 }];

/// Shares of the pictures of neutral faces whose estimate lies below the two ends of [`SmileStage::ramp`].
const NEUTRAL: [f64; 2] = [0.97, 0.999];

/// Mean error of the points of nose and eyes, over the eye distance, above which a face was not found.
const MISREAD: f32 = 0.07;

/// Upper bound of the ends of [`SmileStage::ramp`].
const MOST_LIMIT: f32 = 0.9;

/// Smallest number of pictures of smiles, and of neutral faces, for training.
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
) -> Option<(SmileStage, SmileSummary)> {
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
    let smiling = faces.iter().filter(|f| f.amount > 0.0).count();
    if smiling < LEAST || faces.len() - smiling < LEAST {
        return None;
    }
    let fold: Vec<usize> = faces.iter().map(|f| f.fold).collect();
    let estimate = learn_estimate(&faces, &fold);
    let (stages, shapes) = learn_points(models, &faces, &fold);

    let judged: Vec<(&Face, &Shape)> = (faces.iter().zip(&shapes).zip(&estimate.said))
        .filter(|((face, _), said)| face.amount > 0.0 && **said >= estimate.ramp[1])
        .map(|(pair, _)| pair)
        .collect();
    let found = |of_smiles: bool| {
        let own = faces.iter().zip(&estimate.said).filter(|(f, _)| (f.amount > 0.0) == of_smiles);
        let (all, over) = own.fold((0_usize, 0_usize), |(n, k), (_, said)| (n + 1, k + usize::from(*said >= estimate.ramp[1])));
        over as f64 / all.max(1) as f64
    };
    let corners: Vec<usize> = (0..points().len()).filter(|&k| points()[k].group == "mouth corner").collect();
    let inner: Vec<usize> = line_points().into_iter().flat_map(|[_, upper, lower, _]| [upper, lower]).collect();
    let summary = SmileSummary {
        pictures: (smiling, faces.len() - smiling),
        said: (found(true), found(false)),
        corners: mean_errors(&judged, &corners),
        inner_lips: mean_errors(&judged, &inner),
    };
    let Estimate { weights, base, ramp, .. } = estimate;
    Some((SmileStage { weights, base, ramp, stages, errors: median_errors(&judged) }, summary))
}

/// Linear estimate of the motion of the corners of the mouth.
struct Estimate {
    weights: Vec<f32>,
    base: f32,
    ramp: [f32; 2],
    /// Estimate for each face, learned without the face's fold.
    said: Vec<f32>,
}

fn learn_estimate(faces: &[Face], fold: &[usize]) -> Estimate {
    let length = faces.first().map_or(0, |f| f.read.len());
    let mut read = DMatrix::from_iterator(length, faces.len(), faces.iter().flat_map(|f| f.read.iter().copied()));
    let offset = centre_rows(&mut read);
    let mut wanted = DMatrix::from_iterator(1, faces.len(), faces.iter().map(|f| f.amount));
    let mean = centre_rows(&mut wanted).first().copied().unwrap_or(0.0);
    let learned = among_samples(&read, &wanted.transpose(), fold, &PENALTIES);
    let said: Vec<f32> = learned.predicted.iter().map(|v| v + mean).collect();
    let mut of_neutral: Vec<f32> = faces.iter().zip(&said).filter(|(f, _)| f.amount == 0.0).map(|(_, &s)| s).collect();
    of_neutral.sort_by(f32::total_cmp);
    let limit =
        |share: f64| of_neutral.get((share * of_neutral.len() as f64) as usize).map_or(MOST_LIMIT, |s| s.clamp(0.0, MOST_LIMIT));
    let weights = learned.all.as_slice().to_vec();
    let base = mean - weights.iter().zip(&offset).map(|(w, o)| f64::from(w * o)).sum::<f64>() as f32;
    Estimate { weights, base, ramp: NEUTRAL.map(limit), said }
}

/// Learns the stages that move the points; also returns the points of each face that stages without its fold lead to.
fn learn_points(models: &[Model], faces: &[Face], fold: &[usize]) -> (Vec<LocalStage>, Vec<Shape>) {
    let samples: Vec<&Sample> = faces.iter().map(|f| &f.sample).collect();
    let moved = moved_points();
    let truths: Vec<Shape> = samples.iter().map(|s| moved.iter().map(|&k| s.truth[k]).collect()).collect();
    let mut shapes: Vec<Shape> = faces.iter().map(|f| f.shape.clone()).collect();
    let mut stages = Vec::new();
    for patches in [WIDE, LOCAL[0], LOCAL[1]] {
        let placed: Vec<_> = shapes.iter().zip(faces).map(|(s, f)| placed_part(&models[f.fold].mean, s)).collect();
        let (learned, after) = local_stages(patches, &samples, &truths, &placed, fold);
        for (shape, part) in shapes.iter_mut().zip(after) {
            moved.iter().zip(part).for_each(|(&k, point)| shape[k] = point);
        }
        stages.extend(learned.into_iter().next());
    }
    (stages, shapes)
}

/// Returns the error of a point, over the eye distance.
fn error(face: &Face, shape: &Shape, k: usize) -> f32 {
    distance(shape[k], face.sample.truth[k]) / pupils_apart(&face.sample.truth)
}

/// Returns the mean error of some points before and after the stages, percent of the eye distance.
fn mean_errors(judged: &[(&Face, &Shape)], points: &[usize]) -> (f64, f64) {
    let mean = |of: &dyn Fn(&(&Face, &Shape), usize) -> f32| {
        let sum: f64 = judged.iter().flat_map(|pair| points.iter().map(|&k| f64::from(of(pair, k)))).sum();
        100.0 * sum / (judged.len() * points.len()).max(1) as f64
    };
    (mean(&|(face, _), k| error(face, &face.shape, k)), mean(&|(face, shape), k| error(face, shape, k)))
}

/// Returns the median error of each of [`moved_points`] together with its mirror image, over the eye distance.
fn median_errors(judged: &[(&Face, &Shape)]) -> Vec<f32> {
    let of = |k: usize| judged.iter().map(move |(face, shape)| error(face, shape, k));
    moved_points().into_iter().map(|k| median(&mut of(k).chain(of(points()[k].mirror)).collect::<Vec<f32>>())).collect()
}

/// Reads a picture with the model trained without its person; `None` if the face was not found.
fn read(models: &[Model], amount: f32, sample: Sample, (seed, unit): (u64, u64)) -> Option<Face> {
    let fold = sample.face % FOLDS;
    let model = &models[fold];
    let picture = Picture::new(&sample.image)?;
    let (reading, looks) =
        model.reading_and_looks(picture.view(false), start(&model.mean, &sample.truth, &mut stream(seed, 22, unit)));
    let still: Vec<usize> =
        (0..points().len()).filter(|&k| ["pupil", "eye corner", "nose"].contains(&points()[k].group.as_str())).collect();
    let off: f32 = still.iter().map(|&k| distance(reading.shape[k], sample.truth[k])).sum();
    if off > MISREAD * still.len() as f32 * pupils_apart(&sample.truth) {
        return None;
    }
    Some(Face { fold, amount, shape: reading.shape, read: around_moved(&looks), sample })
}
