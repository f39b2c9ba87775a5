//! Learns to read moved mouths, from readings of people outside the training data of the other stages. What the photographs at hand do not
//! show, such as wide open mouths, is shown by pictures made from them.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::{
    LOCAL, LearnOptions, MovedFace, Sample, TrainingFaces,
    augment::{Source, render, stream},
    calibrate::median,
    local_stages, pictures,
    ridge::{FOLDS, among_samples, centre_rows},
    start,
};
use crate::modules::locate::{
    cells::Patch,
    model::Model,
    mouth::{ESTIMATES, MouthStage, around_moved, moved_points, placed_part},
    picture::Picture,
    points,
    points::{lip_lines, points_of, pupils_apart},
    shape::{Placement, Shape, distance},
    stages::LocalStage,
};

/// Patches of the first stage: lips are further from their places than on neutral faces.
const WIDE: &[Patch] = &[Patch { size: 36.0, cell: 0.18, side: 4, blur: 3 }, Patch { size: 48.0, cell: 0.13, side: 4, blur: 3 }];

/// Shares of the pictures of neutral faces whose estimate lies below the two ends of each of [`MouthStage::ramps`].
const NEUTRAL: [f64; 2] = [0.6, 0.9];

/// Parts of the face that a mouth does not move.
const STILL: [&str; 3] = ["pupil", "eye corner", "nose"];

/// Mean error of the points of nose and eyes, over the eye distance, above which a face was not found.
const MISREAD: f32 = 0.07;

/// Upper bound of the ends of [`MouthStage::ramps`].
const MOST_LIMIT: f32 = 0.9;

/// Smallest number of pictures of moved mouths, and of neutral faces, for training.
const LEAST: usize = 100;

const PENALTIES: [f32; 4] = [50.0, 250.0, 1000.0, 4000.0];

/// Kinds of training pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MouthKind {
    /// Neutral photographs.
    Neutral,
    /// Photographs of smiles.
    Smile,
    /// Pictures made from neutral photographs, with the lips closed or nearly so: apart by less than 2 % of the eye distance.
    Closed,
    /// The same with open mouths: lips apart by up to 20 % of the eye distance.
    Open,
    /// The same with wide open mouths.
    WideOpen,
}

impl MouthKind {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::Neutral, Self::Smile, Self::Closed, Self::Open, Self::WideOpen];

    /// Returns the name of the kind.
    pub fn name(self) -> &'static str {
        match self {
            Self::Neutral => "neutral",
            Self::Smile => "smile",
            Self::Closed => "made, closed",
            Self::Open => "made, open",
            Self::WideOpen => "made, wide open",
        }
    }

    /// Returns the kind of a made picture.
    fn of_made(truth: &Shape) -> Self {
        let [_, upper, lower, _] = lip_lines()[1];
        match distance(truth[upper], truth[lower]) / pupils_apart(truth) {
            gap if gap < 0.02 => Self::Closed,
            gap if gap < 0.2 => Self::Open,
            _ => Self::WideOpen,
        }
    }
}

/// Reading of the mouths of one kind of picture, of people left out in turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MouthSummary {
    /// The kind.
    pub kind: MouthKind,
    /// Number of pictures.
    pub pictures: usize,
    /// Share of pictures whose mouth counts as moved, in part at least, and in full.
    pub moved: [f64; 2],
    /// Mean error of the corners of the mouth, of all points of the lips, and of the chin, percent of the eye distance: without these
    /// stages, and with them wherever the mouth counts as moved.
    pub errors: [[f64; 2]; 3],
}

/// A face with its reading.
struct Face {
    sample: Sample,
    fold: usize,
    kind: MouthKind,
    /// What is estimated; 0 for a neutral face.
    amounts: [f32; ESTIMATES],
    shape: Shape,
    /// Descriptors around the points that move with the mouth.
    read: Vec<f32>,
}

/// Learns the stage. `models` are those without each fold. Returns `None` if there are too few moved mouths.
pub fn learn_mouth(
    models: &[Model],
    people: &TrainingFaces,
    sources: &[Source],
    options: &LearnOptions,
) -> Option<(MouthStage, Vec<MouthSummary>)> {
    let count = options.pictures.div_ceil(2);
    let neutral = pictures(sources, count, options.seed, 20).into_iter().map(|s| (MouthKind::Neutral, [0.0; ESTIMATES], s));
    let (kept, smiling): (Vec<&MovedFace>, Vec<Source>) =
        people.smiles.iter().filter_map(|s| Some((s, Source::new(&s.face)?))).unzip();
    let smiling = pictures(&smiling, count, options.seed, 21).into_iter().map(|sample| {
        let smile = kept[sample.face];
        (MouthKind::Smile, amounts(people, smile), Sample { face: smile.person, ..sample })
    });
    let made = made_pictures(&people.mouths, options.seed);
    let made = made.into_iter().map(|(mouth, sample)| (MouthKind::of_made(&sample.truth), amounts(people, mouth), sample));
    let samples: Vec<(MouthKind, [f32; ESTIMATES], Sample)> = neutral.chain(smiling).chain(made).collect();
    let faces: Vec<Face> = samples
        .into_par_iter()
        .enumerate()
        .filter_map(|(i, (kind, amounts, sample))| read(models, (kind, amounts), sample, (options.seed, i as u64)))
        .collect();
    let moved = faces.iter().filter(|f| f.kind != MouthKind::Neutral).count();
    if moved < LEAST || faces.len() - moved < LEAST {
        return None;
    }
    let fold: Vec<usize> = faces.iter().map(|f| f.fold).collect();
    let Estimates { weights, base, ramps, said } = learn_estimates(&faces, &fold);
    let (stages, shapes) = learn_points(models, &faces, &fold);
    let stage = MouthStage { weights, base, ramps, stages, errors: Vec::new() };
    let judged: Vec<Judged> = faces
        .iter()
        .zip(shapes)
        .zip(said)
        .map(|((face, after), said)| Judged { face, after, share: stage.share([said; 2]) })
        .collect();
    let summaries = MouthKind::ALL.into_iter().map(|kind| summary(kind, &judged)).collect();
    Some((MouthStage { errors: median_errors(&judged), ..stage }, summaries))
}

/// Returns a picture of each face and of its mirror image.
fn made_pictures(mouths: &[MovedFace], seed: u64) -> Vec<(&MovedFace, Sample)> {
    let units: Vec<(usize, bool)> = (0..mouths.len()).flat_map(|k| [(k, false), (k, true)]).collect();
    let made = units.par_chunks(2).flat_map_iter(|pair| {
        let source = Source::new(&mouths[pair[0].0].face);
        pair.iter().filter_map(move |&(k, mirrored)| {
            let random = &mut stream(seed, 23, (k as u64) << 1 | u64::from(mirrored));
            Some((&mouths[k], render(source.as_ref()?, (mouths[k].person, mirrored), random, None)))
        })
    });
    made.collect()
}

/// A face with its points after the stages.
struct Judged<'a> {
    face: &'a Face,
    after: Shape,
    /// Share of the stages in its points.
    share: f32,
}

impl Judged<'_> {
    /// Returns the error of a point before and after the stages, over the eye distance.
    fn errors(&self, k: usize) -> [f32; 2] {
        let Face { sample: Sample { truth, .. }, shape, .. } = self.face;
        [shape[k], self.after[k]].map(|p| distance(p, truth[k]) / pupils_apart(truth))
    }
}

fn summary(kind: MouthKind, judged: &[Judged]) -> MouthSummary {
    let own: Vec<&Judged> = judged.iter().filter(|j| j.face.kind == kind).collect();
    let part = |is: &dyn Fn(f32) -> bool| own.iter().filter(|j| is(j.share)).count() as f64 / own.len().max(1) as f64;
    let errors = ["mouth corner", "lip", "chin"].map(|group| {
        let members = points_of(&[group]);
        let mut sums = [0.0; 2];
        for j in &own {
            for errors in members.iter().map(|&k| j.errors(k)) {
                sums[0] += f64::from(errors[0]);
                sums[1] += f64::from(if j.share > 0.0 { errors[1] } else { errors[0] });
            }
        }
        sums.map(|sum| 100.0 * sum / (own.len() * members.len()).max(1) as f64)
    });
    MouthSummary { kind, pictures: own.len(), moved: [part(&|share| share > 0.0), part(&|share| share >= 1.0)], errors }
}

/// Returns what is estimated of a moved face.
fn amounts(people: &TrainingFaces, moved: &MovedFace) -> [f32; ESTIMATES] {
    let (neutral, shape) = (&people.faces[moved.person].shape, &moved.face.shape);
    let (still, corners) = (points_of(&STILL), points_of(&["mouth corner"]));
    let pick = |shape: &Shape| still.iter().map(|&k| shape[k]).collect::<Shape>();
    let onto = Placement::fit(&pick(neutral), &pick(shape));
    let motion: f32 = corners.iter().map(|&k| distance(onto.apply(neutral[k]), shape[k])).sum();
    let [_, upper, lower, _] = lip_lines()[1];
    let unit = pupils_apart(shape);
    [motion / (corners.len() as f32 * unit), distance(shape[upper], shape[lower]) / unit]
}

/// Linear estimates of the motion of a mouth.
struct Estimates {
    weights: [Vec<f32>; ESTIMATES],
    base: [f32; ESTIMATES],
    ramps: [[f32; 2]; ESTIMATES],
    /// Estimates for each face, learned without the face's fold.
    said: Vec<[f32; ESTIMATES]>,
}

fn learn_estimates(faces: &[Face], fold: &[usize]) -> Estimates {
    let length = faces.first().map_or(0, |f| f.read.len());
    let mut read = DMatrix::from_iterator(length, faces.len(), faces.iter().flat_map(|f| f.read.iter().copied()));
    let offset = centre_rows(&mut read);
    let mut wanted = DMatrix::from_iterator(ESTIMATES, faces.len(), faces.iter().flat_map(|f| f.amounts));
    let means = centre_rows(&mut wanted);
    let learned = among_samples(&read, &wanted.transpose(), fold, &PENALTIES);
    let said: Vec<[f32; ESTIMATES]> =
        learned.predicted.row_iter().map(|row| std::array::from_fn(|k| row[k] + means[k])).collect();
    let weights: [Vec<f32>; ESTIMATES] = std::array::from_fn(|k| learned.all.column(k).iter().copied().collect());
    let base =
        std::array::from_fn(|k| means[k] - weights[k].iter().zip(&offset).map(|(w, o)| f64::from(w * o)).sum::<f64>() as f32);
    let ramps = std::array::from_fn(|k| {
        let neutral = faces.iter().zip(&said).filter(|(f, _)| f.kind == MouthKind::Neutral);
        let mut of_neutral: Vec<f32> = neutral.map(|(_, said)| said[k]).collect();
        of_neutral.sort_by(f32::total_cmp);
        let limit = |share: f64| {
            of_neutral.get((share * of_neutral.len() as f64) as usize).map_or(MOST_LIMIT, |s| s.clamp(0.0, MOST_LIMIT))
        };
        NEUTRAL.map(limit)
    });
    Estimates { weights, base, ramps, said }
}

/// Learns the stages that move the points; also returns the points of each face that stages without its fold lead to.
fn learn_points(models: &[Model], faces: &[Face], fold: &[usize]) -> (Vec<LocalStage>, Vec<Shape>) {
    let samples: Vec<&Sample> = faces.iter().map(|f| &f.sample).collect();
    let moved = moved_points();
    let truths: Vec<Shape> = samples.iter().map(|s| moved.iter().map(|&k| s.truth[k]).collect()).collect();
    let mut shapes: Vec<Shape> = faces.iter().map(|f| f.shape.clone()).collect();
    let mut stages = Vec::new();
    for patches in [WIDE, LOCAL[1]] {
        let placed: Vec<_> = shapes.iter().zip(faces).map(|(s, f)| placed_part(&models[f.fold].mean, s)).collect();
        let (learned, after) = local_stages(patches, &samples, &truths, &placed, fold);
        for (shape, part) in shapes.iter_mut().zip(after) {
            moved.iter().zip(part).for_each(|(&k, point)| shape[k] = point);
        }
        stages.extend(learned.into_iter().next());
    }
    (stages, shapes)
}

/// Returns the median error of each of [`moved_points`] together with its mirror image on moved mouths, over the eye distance.
fn median_errors(judged: &[Judged]) -> Vec<f32> {
    let moved = || judged.iter().filter(|j| j.share > 0.0 && j.face.kind != MouthKind::Neutral);
    let of = |k: usize| moved().map(move |j| j.errors(k)[1]);
    moved_points().into_iter().map(|k| median(&mut of(k).chain(of(points()[k].mirror)).collect::<Vec<f32>>())).collect()
}

/// Reads a picture with the model trained without its person; `None` if the face was not found.
fn read(
    models: &[Model],
    (kind, amounts): (MouthKind, [f32; ESTIMATES]),
    sample: Sample,
    (seed, unit): (u64, u64),
) -> Option<Face> {
    let fold = sample.face % FOLDS;
    let model = &models[fold];
    let picture = Picture::new(&sample.image)?;
    let (reading, looks) =
        model.reading_and_looks(picture.view(false), start(&model.mean, &sample.truth, &mut stream(seed, 22, unit)));
    let still = points_of(&STILL);
    let off: f32 = still.iter().map(|&k| distance(reading.shape[k], sample.truth[k])).sum();
    if off > MISREAD * still.len() as f32 * pupils_apart(&sample.truth) {
        return None;
    }
    Some(Face { fold, kind, amounts, shape: reading.shape, read: around_moved(&looks), sample })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modules::locate::PUPILS;

    #[test]
    fn the_motion_of_corners_and_lips_is_measured_without_that_of_the_head() {
        // Pupils 100 px apart, everything else at one place; then all twice as large, shifted, and with the mouth moved.
        let mut neutral: Shape = (0..points().len()).map(|k| [40.0 + (k % 5) as f32, 30.0 + (k % 7) as f32]).collect();
        (neutral[PUPILS[0]], neutral[PUPILS[1]]) = ([100.0, 0.0], [0.0, 0.0]);
        let [_, upper, lower, _] = lip_lines()[1];
        (neutral[upper], neutral[lower]) = ([50.0, 100.0], [50.0, 100.0]);
        let mut moved: Shape = neutral.iter().map(|p| [2.0 * p[0] + 7.0, 2.0 * p[1] - 3.0]).collect();
        (0..points().len()).filter(|&k| points()[k].group == "mouth corner").for_each(|k| moved[k][0] += 20.0);
        moved[lower][1] += 50.0;
        let face = |shape: Shape| super::super::faces::test_face(shape);
        let people = TrainingFaces { faces: vec![face(neutral)], smiles: Vec::new(), mouths: Vec::new(), blake3: String::new() };
        let [corners, lips] = amounts(&people, &MovedFace { person: 0, face: face(moved.clone()) });
        approx::assert_relative_eq!(corners, 0.1, epsilon = 1e-4);
        approx::assert_relative_eq!(lips, 0.25, epsilon = 1e-4);
        assert_eq!(MouthKind::of_made(&moved), MouthKind::WideOpen);
        for (gap, kind) in
            [(0.0, MouthKind::Closed), (3.0, MouthKind::Closed), (10.0, MouthKind::Open), (45.0, MouthKind::WideOpen)]
        {
            moved[lower][1] = moved[upper][1] + gap;
            assert_eq!(MouthKind::of_made(&moved), kind, "{gap} px of 200");
        }
    }
}
