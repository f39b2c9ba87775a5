//! Learns the locator. Each stage is trained on the results of the previous stages for people outside their training data.

mod augment;
mod calibrate;
mod covers;
mod detector;
mod faces;
mod hidden;
mod mouth;
mod ridge;
mod scenery;
mod summary;

use std::collections::BTreeSet;

use nalgebra::DMatrix;
use rayon::prelude::*;

pub use faces::{MovedFace, TrainingFace, TrainingFaces, read_faces};
pub use hidden::CoverSummary;
pub use mouth::MouthSummary;
pub use summary::LearnSummary;

use super::{
    PUPILS,
    cells::Patch,
    expect::Reading,
    mean_shape,
    model::{ErrorModel, Model},
    picture::Picture,
    points,
    shape::{Placement, Point, Shape, distance},
    stages::{JointStage, LocalStage, Placed, joint_features, local_features},
};
use augment::{Sample, Source, normal, render, stream};
use calibrate::{JudgedReading, learn_errors};
use detector::{learn_template, learn_verifier, scenes};
use hidden::learn_covers;
use mouth::learn_mouth;
use ridge::{FOLDS, Folded, among_numbers, among_samples, centre_rows, each_point};

/// Smallest number of people for training.
pub const LEAST_PEOPLE: usize = 20;

/// Patches of the joint stages, and their ranks.
const JOINT: [(Patch, usize); 2] =
    [(Patch { size: 24.0, cell: 0.26, side: 4, blur: 3 }, 24), (Patch { size: 36.0, cell: 0.18, side: 4, blur: 3 }, 32)];

/// Patches of the local stages.
const LOCAL: [&[Patch]; 2] = [
    &[Patch { size: 48.0, cell: 0.13, side: 4, blur: 3 }, Patch { size: 64.0, cell: 0.07, side: 4, blur: 2 }],
    &[Patch { size: 64.0, cell: 0.085, side: 4, blur: 2 }, Patch { size: 80.0, cell: 0.05, side: 4, blur: 2 }],
];

const JOINT_PENALTIES: [f32; 3] = [10.0, 50.0, 250.0];
const LOCAL_PENALTIES: [f32; 3] = [3.0, 30.0, 300.0];
const MIX_PENALTIES: [f32; 3] = [0.03, 0.3, 3.0];

/// Points that joint stages do not read around: a neighbouring point covers the same surroundings.
const WITHOUT_FEATURES: [&str; 2] = ["iris", "pupil"];

/// Options of learning the locator.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LearnOptions {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Pictures per photograph and per mirror image.
    pub pictures: usize,
    /// People excluded from training.
    pub leave_out: BTreeSet<String>,
}

impl Default for LearnOptions {
    fn default() -> Self {
        Self { seed: 1, pictures: 14, leave_out: BTreeSet::new() }
    }
}

/// A learned locator with its accuracy.
#[derive(Clone, Debug)]
pub struct Learned {
    /// The model, trained on all people.
    pub model: Model,
    /// Errors on people left out in turn.
    pub summary: LearnSummary,
}

/// Learns a locator. `progress` is called with the name of each part of the work that begins. There must be at least as many people as
/// [`read_faces`] requires (`FacesError::TooFew`).
pub fn learn_locator(people: &TrainingFaces, options: &LearnOptions, progress: &dyn Fn(&str)) -> Learned {
    let faces = &people.faces;
    progress("making pictures");
    let sources: Vec<Source> = faces.iter().filter_map(Source::new).collect();
    let samples = pictures(&sources, options.pictures, options.seed, 1);
    let mean = mean_face(faces);
    let features: Vec<usize> = (0..points().len()).filter(|&k| !WITHOUT_FEATURES.contains(&points()[k].group.as_str())).collect();
    let person: Vec<usize> = samples.iter().map(|s| s.face).collect();
    let fold: Vec<usize> = person.iter().map(|p| p % FOLDS).collect();
    let empty = Model {
        mean: mean.clone(),
        features: features.clone(),
        joint: Vec::new(),
        local: Vec::new(),
        template: super::template::Template { weights: Vec::new(), bias: 0.0 },
        verifier: (Vec::new(), 0.0),
        errors: ErrorModel::default(),
        covers: None,
        mouth: None,
    };
    // The model of all people, then those without each fold.
    let mut models = vec![empty; FOLDS + 1];
    let mut shapes: Vec<Shape> =
        samples.iter().enumerate().map(|(i, s)| start(&mean, &s.truth, &mut stream(options.seed, 2, i as u64))).collect();

    progress("finding where faces may be");
    let places = scenes(&samples, &mean, options.seed);
    let template = learn_template(&samples, &places, &mean, options.seed);

    let all: Vec<&Sample> = samples.iter().collect();
    let truths: Vec<Shape> = samples.iter().map(|s| s.truth.clone()).collect();
    let mut verifier = None;
    for (k, (patch, rank)) in JOINT.iter().enumerate() {
        progress(["first joint stage", "second joint stage"][k.min(1)]);
        let placed: Vec<Placed> = shapes.iter().map(|s| Placed::new(&mean, s)).collect();
        let read: Vec<Vec<f32>> = read_all(&all, &placed, |view, p| joint_features(patch, view, p, &features));
        let mut read = matrix(read);
        if k + 1 == JOINT.len() {
            let parts = (mean.as_slice(), features.as_slice(), models[0].joint.as_slice(), patch);
            verifier = Some(learn_verifier(&read, &person, &places, &template.alarms, parts));
        }
        let offset = centre_rows(&mut read);
        let (wanted, base) = wanted(&truths, &placed);
        let folded = among_samples(&read, &wanted, &fold, &JOINT_PENALTIES);
        shapes = moved(&placed, &folded.predicted, &base);
        let stage = |weights: &DMatrix<f32>| joint_stage(*patch, weights, &read, &offset, &base, *rank);
        let stages: Vec<JointStage> = [&folded.all].into_iter().chain(&folded.without).map(stage).collect();
        models.iter_mut().zip(stages).for_each(|(m, s)| m.joint.push(s));
    }
    for patches in LOCAL {
        progress("local stages");
        let placed: Vec<Placed> = shapes.iter().map(|s| Placed::new(&mean, s)).collect();
        let (stages, after) = local_stages(patches, &all, &truths, &placed, &fold);
        shapes = after;
        models.iter_mut().zip(stages).for_each(|(model, stage)| model.local.push(stage));
    }

    progress("expected errors");
    let verifier =
        verifier.map_or_else(|| (Vec::new(), 0.0, Vec::new(), Vec::new()), |v| (v.verifier.0, v.verifier.1, v.faces, v.others));
    for model in &mut models {
        model.template = template.template.clone();
        model.verifier = (verifier.0.clone(), verifier.1);
    }
    let fresh = pictures(&sources, 3, options.seed, 7);
    let judged: Vec<JudgedReading> = fresh
        .par_iter()
        .enumerate()
        .filter_map(|(i, sample)| judge(&models[1 + sample.face % FOLDS], sample, &mut stream(options.seed, 8, i as u64)))
        .collect();
    models[0].errors = learn_errors(&judged);

    progress("moved mouths");
    let (mouth, mouth_summary) = learn_mouth(&models[1..], people, &sources, options).unzip();
    progress("covered parts");
    let (covers, cover_summary) = learn_covers(&models, &sources, &people.smiles, options.seed).unzip();
    models[0].covers = covers;
    models[0].mouth = mouth;
    let summary = LearnSummary {
        covers: cover_summary,
        mouth: mouth_summary,
        ..LearnSummary::new(faces.len(), &judged, &models[0].errors, template.found, (verifier.2, verifier.3))
    };
    let model = models.swap_remove(0);
    Learned { model, summary }
}

/// Returns pictures of all faces and their mirror images.
fn pictures(sources: &[Source], count: usize, seed: u64, purpose: u64) -> Vec<Sample> {
    pictures_covered(sources, count, seed, purpose, false)
}

/// Same as [`pictures`]; covers part of each face if `is_covered`.
fn pictures_covered(sources: &[Source], count: usize, seed: u64, purpose: u64, is_covered: bool) -> Vec<Sample> {
    let units: Vec<(usize, bool, usize)> = (0..sources.len())
        .flat_map(|face| [false, true].into_iter().flat_map(move |mirrored| (0..count).map(move |k| (face, mirrored, k))))
        .collect();
    units
        .par_iter()
        .map(|&(face, mirrored, k)| {
            let unit = (face as u64) << 24 | u64::from(mirrored) << 23 | k as u64;
            // Covers have their own random stream, so that the pictures stay the same.
            let mut covers = is_covered.then(|| stream(seed, purpose + 100, unit));
            render(&sources[face], (face, mirrored), &mut stream(seed, purpose, unit), covers.as_mut())
        })
        .collect()
}

/// Returns the mean of all faces and their mirror images, with pupils at (-0.5, 0) and (0.5, 0).
fn mean_face(faces: &[TrainingFace]) -> Shape {
    let upright = |shape: &[Point]| -> Shape {
        let placement = Placement::fit(&[[0.5, 0.0], [-0.5, 0.0]], &[shape[PUPILS[0]], shape[PUPILS[1]]]);
        shape.iter().map(|&p| placement.invert(p)).collect()
    };
    let average = |shapes: &[Shape]| -> Shape {
        let share = 1.0 / shapes.len().max(1) as f32;
        (0..points().len())
            .map(|k| shapes.iter().fold([0.0, 0.0], |s, shape| [s[0] + shape[k][0] * share, s[1] + shape[k][1] * share]))
            .collect()
    };
    let mut shapes: Vec<Shape> = faces.iter().map(|f| upright(&f.shape)).collect();
    let mirrored: Vec<Shape> =
        shapes.iter().map(|s| points().iter().map(|p| [-s[p.mirror][0], s[p.mirror][1]]).collect()).collect();
    shapes.extend(mirrored);
    let mut mean = average(&shapes);
    for _ in 0..3 {
        let laid: Vec<Shape> = shapes
            .iter()
            .map(|s| {
                let placement = Placement::fit(s, &mean);
                s.iter().map(|&p| placement.apply(p)).collect()
            })
            .collect();
        mean = upright(&average(&laid));
    }
    mean
}

/// Returns a start about as inaccurate as the template's proposals, sometimes more.
fn start(mean: &[Point], truth: &[Point], random: &mut rand_chacha::ChaCha8Rng) -> Shape {
    use rand::RngExt;
    let at = Placement::fit(mean, truth);
    let worse = if random.random::<f32>() < 0.15 { 2.0 } else { 1.0 };
    let size = at.scale() * (worse * normal(random, 0.0, 0.07)).exp();
    let middle = [at.x + worse * normal(random, 0.0, 0.07) * at.scale(), at.y + worse * normal(random, 0.0, 0.07) * at.scale()];
    // The template does not detect the rotation of a head.
    let angle = if random.random::<f32>() < 0.6 { 0.0 } else { at.b.atan2(at.a) + worse * normal(random, 0.0, 0.05) };
    let placement = Placement::new(middle, size, angle);
    mean.iter().map(|&p| placement.apply(p)).collect()
}

fn read_all(samples: &[&Sample], placed: &[Placed], read: impl Fn(super::View<'_>, &Placed) -> Vec<f32> + Sync) -> Vec<Vec<f32>> {
    let pairs = samples.par_iter().zip(placed);
    pairs.map(|(s, p)| Picture::new(&s.image).map(|picture| read(picture.view(false), p)).unwrap_or_default()).collect()
}

/// Builds a matrix, numbers x samples.
fn matrix(columns: Vec<Vec<f32>>) -> DMatrix<f32> {
    let (rows, count) = (columns.first().map_or(0, Vec::len), columns.len());
    let mut values = Vec::with_capacity(rows * count);
    columns.into_iter().for_each(|c| values.extend(c));
    DMatrix::from_vec(rows, count, values)
}

/// Returns the canonical steps to the truth, samples x numbers, minus their mean, and that mean.
fn wanted(truths: &[Shape], placed: &[Placed]) -> (DMatrix<f32>, Vec<f32>) {
    let rows = truths.iter().zip(placed).map(|(truth, p)| {
        let pairs = truth.iter().zip(&p.points);
        pairs
            .flat_map(|(&t, z)| {
                let t = p.placement.invert(t);
                [t[0] - z[0], t[1] - z[1]]
            })
            .collect::<Vec<f32>>()
    });
    let mut steps = matrix(rows.collect());
    let base = centre_rows(&mut steps);
    (steps.transpose(), base)
}

/// Returns the shapes after the predicted steps.
fn moved(placed: &[Placed], predicted: &DMatrix<f32>, base: &[f32]) -> Vec<Shape> {
    let step = |i: usize| predicted.row(i).iter().zip(base).map(|(v, b)| v + b).collect::<Vec<f32>>();
    placed.iter().enumerate().map(|(i, p)| p.moved(&step(i))).collect()
}

/// Learns a local stage from the placed points: the stage learned from all people, then those without each fold, and the points that the
/// latter move, in pixels.
fn local_stages(
    patches: &[Patch],
    samples: &[&Sample],
    truths: &[Shape],
    placed: &[Placed],
    fold: &[usize],
) -> (Vec<LocalStage>, Vec<Shape>) {
    let length: usize = patches.iter().map(Patch::len).sum();
    let mut read = matrix(read_all(samples, placed, |view, p| local_features(patches, view, p)));
    let offset = centre_rows(&mut read);
    let (wanted, base) = wanted(truths, placed);
    let own = each_point(&read, &wanted, length, fold, &LOCAL_PENALTIES);
    drop(read);
    let mut said = DMatrix::zeros(wanted.ncols(), wanted.nrows());
    for (j, point) in own.iter().enumerate() {
        (0..2).for_each(|d| said.set_row(2 * j + d, &point.predicted.column(d).transpose()));
    }
    let mix = among_numbers(&said, &wanted, fold, &MIX_PENALTIES);
    let stage = |m: usize| {
        let of = |f: &Folded| if m == 0 { f.all.clone() } else { f.without[m - 1].clone() };
        LocalStage {
            patches: patches.to_vec(),
            offset: offset.clone(),
            weights: own.iter().flat_map(|point| of(point).as_slice().to_vec()).collect(),
            base: base.clone(),
            // Columns of the regression are rows of the stage.
            mix: of(&mix).as_slice().to_vec(),
        }
    };
    ((0..=FOLDS).map(stage).collect(), moved(placed, &mix.predicted, &base))
}

/// Returns a joint stage of the best rank: the directions in which the predictions vary most are kept.
fn joint_stage(
    patch: Patch,
    weights: &DMatrix<f32>,
    read: &DMatrix<f32>,
    offset: &[f32],
    base: &[f32],
    rank: usize,
) -> JointStage {
    let predicted = weights.transpose() * read;
    let spread = nalgebra::SymmetricEigen::new(&predicted * predicted.transpose());
    let mut order: Vec<usize> = (0..spread.eigenvalues.len()).collect();
    order.sort_by(|&a, &b| spread.eigenvalues[b].total_cmp(&spread.eigenvalues[a]));
    order.truncate(rank);
    let up = spread.eigenvectors.select_columns(&order);
    let down = weights * &up;
    // Columns of `down` are rows of the stage; rows of `up` are columns of its transpose.
    JointStage {
        patch,
        offset: offset.to_vec(),
        down: down.as_slice().to_vec(),
        up: up.transpose().as_slice().to_vec(),
        base: base.to_vec(),
    }
}

/// Returns both readings of a face, each from a start as inaccurate as the template's.
fn read_twice(model: &Model, picture: &Picture, sample: &Sample, random: &mut rand_chacha::ChaCha8Rng) -> (Reading, Reading) {
    let plain = model.reading(picture.view(false), start(&model.mean, &sample.truth, random));
    (plain, model.mirrored_reading(picture, &start(&model.mean, &sample.truth, random)))
}

/// Reads a face as the locator does, from a start as inaccurate as the template's, with a model trained without its person.
fn judge(model: &Model, sample: &Sample, random: &mut rand_chacha::ChaCha8Rng) -> Option<JudgedReading> {
    let (plain, mirrored) = read_twice(model, &Picture::new(&sample.image)?, sample, random);
    let shape = mean_shape(&plain, &mirrored);
    let eye_distance = distance(shape[PUPILS[0]], shape[PUPILS[1]]).max(1e-3);
    let true_distance = distance(sample.truth[PUPILS[0]], sample.truth[PUPILS[1]]);
    let apart = plain.shape.iter().zip(&mirrored.shape).map(|(&p, &q)| distance(p, q) / eye_distance).collect();
    let errors = shape.iter().zip(&sample.truth).map(|(&p, &t)| distance(p, t) / true_distance).collect();
    Some(JudgedReading { readings: [plain, mirrored], apart, eye_distance, errors })
}
