//! Smiles of the training people. Only the neutral photographs have hand-set points. Both photographs have 68 landmarks of a network, whose
//! inner lips are apart on closed full lips. The landmarks' error on the neutral photograph is assumed to be the same on the smile.

use std::{collections::BTreeMap, path::Path};

use super::{FacesError, MovedFace, TrainingFace, add, read_picture};
use crate::{
    input::CsvFile,
    modules::locate::{
        points::{EDGES, lip_lines},
        shape::{Placement, Point, Shape, distance, step_near},
    },
};

/// Number of landmarks of a face in the file.
const LANDMARKS: usize = 68;

/// Landmarks of nose and eyes, which a smile hardly moves.
const STILL: std::ops::Range<usize> = 27..48;

/// Landmarks of the corners of the mouth, from left to right in the picture.
const CORNERS: [usize; 2] = [48, 54];

/// Landmarks of the outer corners of the eyes.
const EYES: [usize; 2] = [36, 45];

/// Distance from a landmark, over that of the outer corners of the eyes, at which its weight falls to an eighth.
const NEAR: f32 = 0.03;

/// Landmarks at the points of [`lip_lines`]; where there are two, their mean is used.
const ON_LINES: [[[usize; 2]; EDGES]; 3] = [
    [[53, 53], [63, 63], [65, 65], [55, 56]],
    [[51, 51], [62, 62], [66, 66], [57, 57]],
    [[49, 49], [61, 61], [67, 67], [58, 59]],
];

/// Reads the smiles of these faces; none if there is no table, or the person is not in it.
pub fn read(folder: &Path, faces: &[TrainingFace], hasher: &mut blake3::Hasher) -> Result<Vec<MovedFace>, FacesError> {
    let path = folder.join("landmarks68.csv");
    if !path.exists() {
        return Ok(Vec::new());
    }
    let csv = CsvFile::open(&path)?;
    let [person, state] = csv.require(["person", "state"])?;
    let names: Vec<String> = (0..LANDMARKS).flat_map(|k| [format!("x{k}"), format!("y{k}")]).collect();
    let columns = csv.require::<{ 2 * LANDMARKS }>(std::array::from_fn(|k| names[k].as_str()))?;
    let mut rows = BTreeMap::new();
    for row in csv.rows() {
        let row = row?;
        let numbers = columns.iter().map(|&c| row.number(c)).collect::<Result<Vec<f64>, _>>()?;
        rows.insert((row.get(person).to_owned(), row.get(state).to_owned()), numbers);
    }
    let mut smiles = Vec::new();
    for (person, face) in faces.iter().enumerate() {
        let of = |state: &str| rows.get(&(face.person.clone(), state.to_owned()));
        let (Some(neutral), Some(smiling)) = (of("neutral"), of("smiling")) else { continue };
        let (picture, bytes) = read_picture(&folder.join("smiling").join(format!("{}.jpg", face.person)))?;
        add(hasher, &bytes, &[neutral.as_slice(), smiling.as_slice()].concat());
        let landmarks = |numbers: &[f64]| numbers.chunks_exact(2).map(|p| [p[0] as f32, p[1] as f32]).collect::<Shape>();
        let Smiling { shape, outline } = smile(face, &landmarks(neutral), &landmarks(smiling));
        smiles.push(MovedFace { person, face: TrainingFace::new(face.person.clone(), picture, &outline, shape) });
    }
    Ok(smiles)
}

/// A smile in terms of the hand-set points.
struct Smiling {
    shape: Shape,
    outline: Vec<Point>,
}

/// Moves the points and the outline of a neutral face as the landmarks.
fn smile(face: &TrainingFace, neutral: &[Point], smiling: &[Point]) -> Smiling {
    let onto = Placement::fit(&neutral[STILL], &smiling[STILL]);
    let near = NEAR * distance(neutral[EYES[0]], neutral[EYES[1]]).max(f32::MIN_POSITIVE);
    let motions: Vec<Point> = neutral
        .iter()
        .zip(smiling)
        .map(|(&from, &to)| {
            let from = onto.apply(from);
            [to[0] - from[0], to[1] - from[1]]
        })
        .collect();
    let known: Vec<(Point, Point)> = neutral.iter().copied().zip(motions.iter().copied()).collect();
    let moved = |p: Point| {
        let (placed, step) = (onto.apply(p), step_near(p, &known, near));
        [placed[0] + step[0], placed[1] + step[1]]
    };
    let mut shape: Shape = face.shape.iter().map(|&p| moved(p)).collect();
    let outline = face.outline.iter().map(|&p| moved(p)).collect();
    let down = |landmarks: &[Point]| {
        let [left, right] = CORNERS.map(|k| landmarks[k]);
        let width = distance(left, right).max(f32::MIN_POSITIVE);
        [-(right[1] - left[1]) / width, (right[0] - left[0]) / width]
    };
    let (was, is) = (down(neutral), down(smiling));
    let mean = |landmarks: &[Point], [one, other]: [usize; 2]| {
        let (p, q) = (landmarks[one], landmarks[other]);
        [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])]
    };
    for (point, pair) in lip_lines().into_iter().flatten().zip(ON_LINES.into_iter().flatten()) {
        let (set, said, smiles) = (face.shape[point], mean(neutral, pair), mean(smiling, pair));
        let off = onto.scale() * ((said[0] - set[0]) * was[0] + (said[1] - set[1]) * was[1]);
        shape[point] = [smiles[0] - off * is[0], smiles[1] - off * is[1]];
    }
    Smiling { shape, outline }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modules::locate::points;

    #[test]
    fn the_bias_of_a_network_on_closed_lips_is_removed() {
        // All points coincide except the mouth's corners. The network has the closed lips 6 px apart, and the smiling ones 16: they are 10
        // apart.
        let mut shape = vec![[50.0, 50.0]; points().len()];
        let [_, upper, lower, _] = lip_lines()[1];
        (shape[upper], shape[lower]) = ([50.0, 100.0], [50.0, 100.0]);
        let face = TrainingFace::new("P".to_owned(), image::RgbImage::new(8, 8), &[], shape);
        let landmarks = |gap: f32| {
            let mut landmarks: Vec<Point> = (0..LANDMARKS).map(|k| [k as f32, (k * k % 7) as f32]).collect();
            (landmarks[CORNERS[0]], landmarks[CORNERS[1]]) = ([20.0, 100.0], [80.0, 100.0]);
            (landmarks[62], landmarks[66]) = ([50.0, 100.0 - 0.5 * gap], [50.0, 100.0 + 0.5 * gap]);
            landmarks
        };
        let Smiling { shape, .. } = smile(&face, &landmarks(6.0), &landmarks(16.0));
        approx::assert_relative_eq!(shape[upper][1], 95.0, epsilon = 1e-3);
        approx::assert_relative_eq!(shape[lower][1], 105.0, epsilon = 1e-3);
    }
}
