//! Learns the template that proposes faces and the verifier that accepts them.

use nalgebra::DMatrix;
use rand::RngExt;
use rayon::prelude::*;

use super::{
    augment::{Sample, normal, spoilt, stream},
    ridge::{FOLDS, among_numbers, among_samples, centre_rows},
    scenery::faceless,
};
use crate::modules::locate::{
    cells::Patch,
    picture::Picture,
    shape::{Placement, Point, Shape, distance},
    stages::{JointStage, Placed, joint_features},
    template::{self, CELL, COLUMNS, CORNER, EYE_DISTANCE, Grid, ROWS, Search, Template, alike, candidates},
};

/// Numbers of scenes from which false alarms are collected: without faces, and with faces or distorted faces.
const FACELESS: usize = 260;
const WITH_FACES: usize = 360;

/// Rounds of collecting false alarms.
const ROUNDS: usize = 3;

/// A picture in which no face may be found, or only one at a known position.
#[derive(Debug)]
pub struct Scene {
    picture: Picture,
    /// Position of the face, if it counts as one.
    face: Option<Placement>,
}

/// Generates the scenes.
pub fn scenes(samples: &[Sample], mean: &[Point], seed: u64) -> Vec<Scene> {
    let plain = (0..FACELESS).into_par_iter().filter_map(|k| {
        let mut random = stream(seed, 3, k as u64);
        let (width, height) = (random.random_range(160..420), random.random_range(160..420));
        Some(Scene { picture: Picture::new(&faceless(&mut random, width, height).image())?, face: None })
    });
    let step = (samples.len() / WITH_FACES).max(1);
    let faces: Vec<&Sample> = samples.iter().step_by(step).collect();
    let with_faces = faces.par_iter().enumerate().filter_map(|(k, sample)| {
        let mut random = stream(seed, 4, k as u64);
        if k % 2 == 0 {
            let face = Some(Placement::fit(mean, &sample.truth));
            return Some(Scene { picture: Picture::new(&sample.image)?, face });
        }
        Some(Scene { picture: Picture::new(&spoilt(sample, &mut random))?, face: None })
    });
    plain.chain(with_faces).collect()
}

/// Returns the exact window of a template at a placement.
fn window(picture: &Picture, placement: Placement) -> Vec<f32> {
    // One more cell on each side, for the normalization by neighbours.
    let (columns, rows) = (COLUMNS + 2, ROWS + 2);
    let f = placement.scale() / EYE_DISTANCE;
    let corner = [CORNER[0] * EYE_DISTANCE - CELL as f32 + 0.5, CORNER[1] * EYE_DISTANCE - CELL as f32 + 0.5];
    let to_view = Placement { a: f, b: 0.0, x: placement.x + f * corner[0], y: placement.y + f * corner[1] };
    Grid::new(&picture.view(false).warp(to_view, columns * CELL, rows * CELL), columns * CELL, rows * CELL).window(1, 1)
}

fn template_from(faces: &[Vec<f32>], others: &[Vec<f32>]) -> Template {
    let (n, m) = (faces.len(), others.len());
    // Both classes have the same total weight.
    let (share, other_share) = ((0.5 / n as f32).sqrt(), (0.5 / m as f32).sqrt());
    let mean: Vec<f32> = (0..template::LENGTH)
        .map(|k| 0.5 * (faces.iter().map(|w| w[k]).sum::<f32>() / n as f32 + others.iter().map(|w| w[k]).sum::<f32>() / m as f32))
        .collect();
    let columns = faces.iter().map(|w| (w, share)).chain(others.iter().map(|w| (w, other_share)));
    let values: Vec<f32> = columns.flat_map(|(w, s)| w.iter().zip(&mean).map(move |(v, o)| (v - o) * s)).collect();
    let read = DMatrix::from_vec(template::LENGTH, n + m, values);
    let wanted = DMatrix::from_fn(n + m, 1, |i, _| if i < n { share } else { -other_share });
    let fold: Vec<usize> = (0..n + m).map(|i| i % FOLDS).collect();
    let weights: Vec<f32> = among_numbers(&read, &wanted, &fold, &[0.01]).all.as_slice().to_vec();
    let bias = -weights.iter().zip(&mean).map(|(w, o)| w * o).sum::<f32>();
    Template { weights, bias }
}

fn search(picture: &Picture) -> Search {
    let shorter = picture.width().min(picture.height()) as f32;
    Search { eye_distance: (24.0, (0.5 * shorter).max(24.0)), angle: 0.0, most: 10 }
}

/// Returns false alarms of a template: positions that are not the face of the scene.
fn false_alarms(scene: &Scene, template: &Template) -> Vec<Placement> {
    let picture = &scene.picture;
    let found = candidates(picture.view(false), (picture.width(), picture.height()), template, &search(picture));
    let near = |p: Placement| {
        scene.face.is_some_and(|f| {
            alike(f, p) || (distance([f.x, f.y], [p.x, p.y]) < 0.45 * f.scale() && (f.scale() / p.scale()).ln().abs() < 0.4)
        })
    };
    found.into_iter().map(|c| c.placement).filter(|&p| !near(p)).collect()
}

/// The learned template with its performance.
#[derive(Clone, Debug)]
pub struct LearnedTemplate {
    /// The template.
    pub template: Template,
    /// False alarms: index of the scene, and placement.
    pub alarms: Vec<(usize, Placement)>,
    /// Share of the scenes with a face in which the face is among the candidates.
    pub found: f64,
}

/// Learns the template in rounds; each uses the false alarms of the previous one.
pub fn learn_template(samples: &[Sample], scenes: &[Scene], mean: &[Point], seed: u64) -> LearnedTemplate {
    let step = (samples.len() / 1500).max(1);
    let chosen: Vec<&Sample> = samples.iter().step_by(step).collect();
    let faces: Vec<Vec<f32>> = chosen
        .par_iter()
        .enumerate()
        .filter_map(|(k, sample)| {
            let picture = Picture::new(&sample.image)?;
            let truth = Placement::fit(mean, &sample.truth);
            let mut random = stream(seed, 5, k as u64);
            let windows = (0..2).map(|_| {
                let size = truth.scale() * normal(&mut random, 0.0, 0.05).exp();
                let at = [truth.x + normal(&mut random, 0.0, 0.06) * size, truth.y + normal(&mut random, 0.0, 0.06) * size];
                window(&picture, Placement::new(at, size, 0.0))
            });
            Some(windows.collect::<Vec<_>>())
        })
        .flatten()
        .collect();
    // The first negatives are arbitrary windows without a face.
    let mut others: Vec<Vec<f32>> = scenes
        .par_iter()
        .enumerate()
        .flat_map_iter(|(k, scene)| {
            let mut random = stream(seed, 6, k as u64);
            let picture = &scene.picture;
            let windows = (0..6).filter_map(|_| {
                let size = random.random_range(20.0..60.0_f32);
                let (w, h) = (picture.width() as f32, picture.height() as f32);
                let place = Placement::new([random.random_range(0.0..w), random.random_range(0.0..h)], size, 0.0);
                let free = scene.face.is_none_or(|f| distance([f.x, f.y], [place.x, place.y]) > 0.6 * f.scale());
                free.then(|| window(picture, place))
            });
            windows.collect::<Vec<_>>()
        })
        .collect();
    let mut template = template_from(&faces, &others);
    for _ in 1..ROUNDS {
        let gathered = scenes
            .par_iter()
            .flat_map_iter(|s| false_alarms(s, &template).into_iter().map(|p| window(&s.picture, p)).collect::<Vec<_>>());
        others.extend(gathered.collect::<Vec<_>>());
        template = template_from(&faces, &others);
    }
    let alarms = scenes
        .par_iter()
        .enumerate()
        .flat_map_iter(|(k, s)| false_alarms(s, &template).into_iter().map(|p| (k, p)).collect::<Vec<_>>())
        .collect();
    let with_face: Vec<_> = scenes.iter().filter(|s| s.face.is_some()).collect();
    let seen = with_face.par_iter().filter(|scene| {
        let picture = &scene.picture;
        let found = candidates(picture.view(false), (picture.width(), picture.height()), &template, &search(picture));
        found.iter().any(|c| scene.face.is_some_and(|f| distance([f.x, f.y], [c.placement.x, c.placement.y]) < 0.25 * f.scale()))
    });
    let found = seen.count() as f64 / with_face.len().max(1) as f64;
    LearnedTemplate { template, alarms, found }
}

/// The learned verifier with its performance on people and scenes left out.
#[derive(Clone, Debug)]
pub struct LearnedVerifier {
    /// Weights and constant; the threshold is 0.
    pub verifier: (Vec<f32>, f32),
    /// Scores of faces, each from a verifier trained without that person, ascending.
    pub faces: Vec<f32>,
    /// Scores of false alarms, ascending.
    pub others: Vec<f32>,
}

/// Largest numbers of faces and false alarms used.
const MOST_FACES: usize = 1500;
const MOST_ALARMS: usize = 2600;

/// Learns the verifier. `read`: features of the last joint stage, features x samples; `person` of each sample.
pub fn learn_verifier(
    read: &DMatrix<f32>,
    person: &[usize],
    scenes: &[Scene],
    alarms: &[(usize, Placement)],
    (mean, features, first, patch): (&[Point], &[usize], &[JointStage], &Patch),
) -> LearnedVerifier {
    let step = (read.ncols() / MOST_FACES).max(1);
    let chosen: Vec<usize> = (0..read.ncols()).step_by(step).collect();
    let step = alarms.len().div_ceil(MOST_ALARMS).max(1);
    let alarms: Vec<_> = alarms.iter().step_by(step).collect();
    let others: Vec<Vec<f32>> = alarms
        .par_iter()
        .map(|(k, start)| {
            let view = scenes[*k].picture.view(false);
            let mut shape: Shape = mean.iter().map(|&p| start.apply(p)).collect();
            for stage in first {
                let placed = Placed::new(mean, &shape);
                shape = placed.moved(&stage.step(&stage.features(view, &placed, features)));
            }
            joint_features(patch, view, &Placed::new(mean, &shape), features)
        })
        .collect();
    let (n, m) = (chosen.len(), others.len());
    let values: Vec<f32> = chosen
        .iter()
        .flat_map(|&i| read.column(i).iter().copied().collect::<Vec<_>>())
        .chain(others.into_iter().flatten())
        .collect();
    let mut both = DMatrix::from_vec(read.nrows(), n + m, values);
    let offset = centre_rows(&mut both);
    let balance = (m as f32 - n as f32) / (n + m) as f32;
    let wanted = DMatrix::from_fn(n + m, 1, |i, _| if i < n { 1.0 } else { -1.0 } + balance);
    let fold: Vec<usize> = (0..n + m).map(|i| if i < n { person[chosen[i]] % FOLDS } else { alarms[i - n].0 % FOLDS }).collect();
    let learned = among_samples(&both, &wanted, &fold, &[10.0, 60.0]);
    let sorted = |range: std::ops::Range<usize>| {
        let mut scores: Vec<f32> = range.map(|i| learned.predicted[(i, 0)]).collect();
        scores.sort_by(f32::total_cmp);
        scores
    };
    let (faces, others) = (sorted(0..n), sorted(n..n + m));
    // The threshold lies between the two classes, nearer to the false alarms when they are far apart.
    let at = |scores: &[f32], share: f64| scores.get(((scores.len() as f64 - 1.0) * share) as usize).copied().unwrap_or(0.0);
    let (low, high) = (at(&faces, 0.003), at(&others, 0.995));
    let limit = if low > high { 0.4 * low + 0.6 * high } else { 0.5 * (low + high) };
    let weights = learned.all.as_slice().to_vec();
    let bias = -weights.iter().zip(&offset).map(|(w, o)| w * o).sum::<f32>() - limit;
    let shifted = |scores: Vec<f32>| scores.into_iter().map(|s| s - limit).collect();
    LearnedVerifier { verifier: (weights, bias), faces: shifted(faces), others: shifted(others) }
}

/// Returns the window of a template, for tests.
#[cfg(test)]
pub fn window_at(picture: &Picture, placement: Placement) -> Vec<f32> {
    window(picture, placement)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modules::locate::template::placement_of;

    #[test]
    fn a_window_cut_out_is_the_window_of_the_grid() {
        let image = image::GrayImage::from_fn(160, 160, |x, y| image::Luma([((x * 7 + y * y / 5) % 251) as u8]));
        let picture = Picture::new(&image).unwrap();
        let whole = Placement { a: 1.0, b: 0.0, x: 0.0, y: 0.0 };
        let grid = Grid::new(&picture.view(false).warp(whole, 160, 160), 160, 160);
        let cut = window_at(&picture, placement_of(5, 6, whole));
        // The gradient of the outermost pixels differs, and so does the normalization of their cells.
        let far = cut.iter().zip(grid.window(5, 6)).filter(|(a, b)| (*a - b).abs() > 0.1).count();
        assert!(far < cut.len() / 20, "{far} of {}", cut.len());
    }
}
