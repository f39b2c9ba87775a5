//! Training faces: photographs with the 189 hand-set points of the Face Research Lab London Set.

mod smiles;

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use image::RgbImage;
use nalgebra::{Point2, Vector2};
use rayon::prelude::*;

use crate::{
    input::{CsvFile, InputError},
    modules::locate::{
        PUPILS, points,
        points::LocatorPoint,
        shape::{Point, Shape, distance, step_near},
    },
    units::NodeId,
};

/// Number of points of a face in the file.
pub const POINTS: usize = 189;

/// Range of the indices of the outline of the face, starting at the chin.
const OUTLINE: std::ops::Range<usize> = 125..145;

/// Largest side of a photograph that is read, px.
const LARGEST: u32 = 4000;

/// Distance from a node, over the eye distance, at which its weight in the motion of other points falls to an eighth.
const NEAR: f32 = 0.05;

/// Faces that do not read.
#[derive(Debug, thiserror::Error)]
pub enum FacesError {
    /// The table cannot be read.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A photograph cannot be read.
    #[error("{}: {reason}", path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// A person to leave out does not exist.
    #[error("{}: there is no person {name}; --leave-out needs names from the column person", path.display())]
    NoSuchPerson {
        /// The table.
        path: PathBuf,
        /// Who was named.
        name: String,
    },
    /// A person appears twice.
    #[error("{}, line {line}: {name} appears twice; keep one row", path.display())]
    Twice {
        /// The table.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Who.
        name: String,
    },
    /// The pupils of a face are too close together.
    #[error("{}, line {line}: the pupils of {name} are {distance} px apart; at least 20 are needed", path.display())]
    Small {
        /// The table.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Who.
        name: String,
        /// Distance, px.
        distance: f32,
    },
    /// Too few faces to learn from.
    #[error("{}: {found} people; at least {} are needed", path.display(), super::LEAST_PEOPLE)]
    TooFew {
        /// The table.
        path: PathBuf,
        /// How many there are.
        found: usize,
    },
}

/// One person's photograph.
#[derive(Clone, Debug)]
pub struct TrainingFace {
    /// Name of the person.
    pub person: String,
    /// Grey pixels.
    pub grey: image::GrayImage,
    /// The locator's points, px.
    pub shape: Shape,
    picture: RgbImage,
    outline: Vec<Point>,
}

/// A face of a person of [`TrainingFaces::faces`] whose mouth has moved.
#[derive(Clone, Debug)]
pub struct MovedFace {
    /// Index of the person among the faces.
    pub person: usize,
    /// The picture, with the hand-set points of the neutral face moved.
    pub face: TrainingFace,
}

/// Masks of a photograph: the face, and the background.
#[derive(Clone, Debug)]
pub struct Masks {
    /// 255 in the background, 0 on the person.
    pub background: image::GrayImage,
    /// 255 inside the outline of the face.
    pub inside: image::GrayImage,
}

impl TrainingFace {
    fn new(person: String, picture: RgbImage, outline: &[Point], shape: Shape) -> Self {
        let (width, height) = picture.dimensions();
        // Weights of BT.601, as in OpenCV.
        let luma =
            |p: &image::Rgb<u8>| ((u32::from(p[0]) * 299 + u32::from(p[1]) * 587 + u32::from(p[2]) * 114 + 500) / 1000) as u8;
        let grey = image::GrayImage::from_fn(width, height, |x, y| image::Luma([luma(picture.get_pixel(x, y))]));
        Self { person, grey, shape, picture, outline: outline.to_vec() }
    }

    /// Returns the points that are nodes, px.
    pub fn nodes(&self) -> Vec<(NodeId, Point2<f64>)> {
        let named = points().iter().zip(&self.shape);
        named.filter_map(|(point, at)| Some((point.node?, Point2::from(at.map(f64::from))))).collect()
    }

    /// Returns the photograph in colour.
    pub fn picture(&self) -> &RgbImage {
        &self.picture
    }

    /// Returns the face on a picture in which the nodes have moved; `motion` has one vector for each node, px. Points that are no nodes
    /// move as the nodes near them.
    pub fn moved(&self, picture: RgbImage, motion: &[Vector2<f64>]) -> Self {
        let step = |point: &LocatorPoint| motion.get(point.node?.index()).map(|m| [m.x as f32, m.y as f32]);
        let named = || points().iter().zip(&self.shape);
        let known: Vec<(Point, Point)> = named().filter_map(|(point, &at)| Some((at, step(point)?))).collect();
        let near = NEAR * self.eye_distance() as f32;
        let moved = |at: Point, [x, y]: Point| [at[0] + x, at[1] + y];
        let carried = |at: Point| moved(at, step_near(at, &known, near));
        let shape = named().map(|(point, &at)| step(point).map_or_else(|| carried(at), |step| moved(at, step))).collect();
        let outline: Vec<Point> = self.outline.iter().map(|&at| carried(at)).collect();
        Self::new(self.person.clone(), picture, &outline, shape)
    }

    /// Returns the distance between the pupils, px.
    pub fn eye_distance(&self) -> f64 {
        let [left, right] = PUPILS.map(|k| Point2::from(self.shape[k].map(f64::from)));
        (left - right).norm()
    }

    /// Returns the face resized so that the pupils are `eye_distance` px apart.
    pub fn resized(&self, eye_distance: f64) -> Self {
        let factor = eye_distance / self.eye_distance();
        let (width, height) = self.picture.dimensions();
        let [new_width, new_height] = [width, height].map(|side| (f64::from(side) * factor).round().max(1.0) as u32);
        let picture = image::imageops::resize(&self.picture, new_width, new_height, image::imageops::FilterType::Triangle);
        let [x, y] = [(new_width, width), (new_height, height)].map(|(new, old)| new as f32 / old as f32);
        // Pixel coordinates refer to the centres of pixels.
        let place = |points: &[Point]| -> Vec<Point> {
            points.iter().map(|p| [(p[0] + 0.5) * x - 0.5, (p[1] + 0.5) * y - 0.5]).collect()
        };
        Self::new(self.person.clone(), picture, &place(&self.outline), place(&self.shape))
    }

    /// Returns the masks, blurred by one pixel.
    pub fn masks(&self) -> Masks {
        let (width, height) = self.picture.dimensions();
        let is_inside = |x: u32, y: u32| within(&self.outline, x as f32, y as f32);
        let inside = image::GrayImage::from_fn(width, height, |x, y| image::Luma([if is_inside(x, y) { 255 } else { 0 }]));
        let background = image::imageops::fast_blur(&background_of(&self.picture, &inside), 1.2);
        Masks { background, inside: image::imageops::fast_blur(&inside, 1.2) }
    }
}

/// Training faces with the hash of their files.
#[derive(Clone, Debug)]
pub struct TrainingFaces {
    /// Faces in the order of the table.
    pub faces: Vec<TrainingFace>,
    /// Smiles of the same people, if available and requested.
    pub smiles: Vec<MovedFace>,
    /// Moved mouths of the same people, if requested.
    pub mouths: Vec<MovedFace>,
    /// BLAKE3 of the tables and all photographs used, in hexadecimal.
    pub blake3: String,
}

impl TrainingFaces {
    /// Adds smiles of these people from `FOLDER/smiling/PERSON.jpg`. `FOLDER/landmarks68.csv` (`person,state,x0,y0,...,x67,y67`, iBUG's
    /// order, px) must list a person as both `neutral` and `smiling`. Without that table there are no smiles.
    ///
    /// # Errors
    /// `FacesError`.
    pub fn with_smiles(self, folder: &Path) -> Result<Self, FacesError> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.blake3.as_bytes());
        let smiles = smiles::read(folder, &self.faces, &mut hasher)?;
        let blake3 = if smiles.is_empty() { self.blake3 } else { hasher.finalize().to_hex().to_string() };
        Ok(Self { smiles, blake3, ..self })
    }
}

impl TrainingFaces {
    /// Adds pictures of the same people with moved mouths: `make` returns them with the motion of every node, px.
    #[must_use]
    pub fn with_mouths(self, make: impl Fn(usize, &TrainingFace) -> Vec<(RgbImage, Vec<Vector2<f64>>)> + Sync) -> Self {
        let mouths = self.faces.par_iter().enumerate().flat_map_iter(|(person, face)| {
            let made = make(person, face).into_iter();
            made.map(move |(picture, motion)| MovedFace { person, face: face.moved(picture, &motion) })
        });
        Self { mouths: mouths.collect(), ..self }
    }
}

/// Reads `FOLDER/delineation189.csv` (`person,x0,y0,...,x188,y188`, px) and `FOLDER/neutral/PERSON.jpg`.
///
/// # Errors
/// `FacesError`.
pub fn read_faces(folder: &Path, leave_out: &BTreeSet<String>) -> Result<TrainingFaces, FacesError> {
    let path = folder.join("delineation189.csv");
    let csv = CsvFile::open(&path)?;
    let [person_column] = csv.require(["person"])?;
    let names: Vec<String> = (0..POINTS).flat_map(|k| [format!("x{k}"), format!("y{k}")]).collect();
    let columns = csv.require::<{ 2 * POINTS }>(std::array::from_fn(|k| names[k].as_str()))?;
    let mut hasher = blake3::Hasher::new();
    let (mut seen, mut faces) = (BTreeSet::new(), Vec::new());
    for row in csv.rows() {
        let row = row?;
        let person = row.get(person_column).to_owned();
        if !seen.insert(person.clone()) {
            return Err(FacesError::Twice { path, line: row.line(), name: person });
        }
        if leave_out.contains(&person) {
            continue;
        }
        let numbers = columns.iter().map(|&c| row.number(c)).collect::<Result<Vec<f64>, _>>()?;
        let all: Vec<Point> = numbers.chunks_exact(2).map(|p| [p[0] as f32, p[1] as f32]).collect();
        let shape: Shape = points().iter().map(|p| mean_of(&all, &p.sources)).collect();
        let apart = distance(shape[PUPILS[0]], shape[PUPILS[1]]);
        if apart < 20.0 {
            return Err(FacesError::Small { path, line: row.line(), name: person, distance: apart });
        }
        let (picture, bytes) = read_picture(&folder.join("neutral").join(format!("{person}.jpg")))?;
        add(&mut hasher, &bytes, &numbers);
        faces.push(TrainingFace::new(person, picture, &all[OUTLINE], shape));
    }
    if let Some(name) = leave_out.iter().find(|name| !seen.contains(*name)) {
        return Err(FacesError::NoSuchPerson { path, name: name.clone() });
    }
    if faces.len() < super::LEAST_PEOPLE {
        return Err(FacesError::TooFew { path, found: faces.len() });
    }
    Ok(TrainingFaces { faces, smiles: Vec::new(), mouths: Vec::new(), blake3: hasher.finalize().to_hex().to_string() })
}

/// Adds a photograph and its points to the hash.
fn add(hasher: &mut blake3::Hasher, picture: &[u8], numbers: &[f64]) {
    hasher.update(&blake3::hash(picture).as_bytes()[..]);
    numbers.iter().for_each(|n| {
        hasher.update(&n.to_le_bytes());
    });
}

fn mean_of(all: &[Point], sources: &[(usize, f64)]) -> Point {
    sources.iter().fold([0.0, 0.0], |sum, &(k, share)| {
        let p = all.get(k).copied().unwrap_or_default();
        [sum[0] + p[0] * share as f32, sum[1] + p[1] * share as f32]
    })
}

fn read_picture(path: &Path) -> Result<(RgbImage, Vec<u8>), FacesError> {
    let failed = |reason: String| FacesError::Picture { path: path.to_owned(), reason };
    let bytes = crate::input::read(path).map_err(|e| failed(e.to_string()))?;
    let picture = image::load_from_memory(&bytes).map_err(|e| failed(e.to_string()))?.to_rgb8();
    if picture.width().max(picture.height()) > LARGEST {
        return Err(failed(format!("{}x{} px; at most {LARGEST} a side", picture.width(), picture.height())));
    }
    Ok((picture, bytes))
}

/// Whether a position is inside a closed outline (even-odd rule).
pub fn within(outline: &[Point], x: f32, y: f32) -> bool {
    let edges = outline.iter().zip(outline.iter().cycle().skip(1));
    edges.filter(|(p, q)| (p[1] > y) != (q[1] > y) && x < p[0] + (y - p[1]) / (q[1] - p[1]) * (q[0] - p[0])).count() % 2 == 1
}

/// Returns the mask of the uniform background, flood-filled from the upper border and the upper half of the sides.
fn background_of(picture: &RgbImage, inside: &image::GrayImage) -> image::GrayImage {
    let (width, height) = picture.dimensions();
    let smooth = image::imageops::fast_blur(picture, 1.5);
    let mut mask = image::GrayImage::new(width, height);
    let starts = [(1, 1), (width.saturating_sub(2), 1), (1, height / 4), (width.saturating_sub(2), height / 4)];
    for start in starts {
        if start.0 >= width || start.1 >= height || mask.get_pixel(start.0, start.1)[0] > 0 {
            continue;
        }
        let seed = *smooth.get_pixel(start.0, start.1);
        let chroma = |p: &image::Rgb<u8>| [i32::from(p[0]) - i32::from(p[1]), i32::from(p[2]) - i32::from(p[1])];
        let like = |p: &image::Rgb<u8>| {
            let level = (0..3).map(|k| i32::from(p[k]) - i32::from(seed[k])).sum::<i32>().abs() <= 3 * 22;
            let (a, b) = (chroma(p), chroma(&seed));
            level && (a[0] - b[0]).abs() <= 10 && (a[1] - b[1]).abs() <= 10
        };
        let mut open = vec![start];
        while let Some((x, y)) = open.pop() {
            if mask.get_pixel(x, y)[0] > 0 || inside.get_pixel(x, y)[0] > 0 || !like(smooth.get_pixel(x, y)) {
                continue;
            }
            mask.put_pixel(x, y, image::Luma([255]));
            let next = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
            open.extend(next.into_iter().filter(|&(x, y)| x < width && y < height));
        }
    }
    mask
}

/// Returns a face without a photograph.
#[cfg(test)]
pub(super) fn test_face(shape: Shape) -> TrainingFace {
    TrainingFace::new("P".to_owned(), RgbImage::new(8, 8), &[], shape)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_move_with_their_nodes_and_others_with_the_nodes_near_them() {
        let shape: Shape = (0..points().len()).map(|k| [10.0 * (k % 9) as f32, 12.0 * (k / 9) as f32]).collect();
        let face = test_face(shape.clone());
        // All nodes move by the same, so everything does.
        let moved = face.moved(RgbImage::new(8, 8), &vec![Vector2::new(3.0, -2.0); 113]);
        for (from, to) in shape.iter().zip(&moved.shape) {
            approx::assert_relative_eq!(to[0] - from[0], 3.0, epsilon = 1e-4);
            approx::assert_relative_eq!(to[1] - from[1], -2.0, epsilon = 1e-4);
        }
        // One node moves: others stay, points that are no nodes follow a little.
        let mut motion = vec![Vector2::zeros(); 113];
        motion[10] = Vector2::new(0.0, 5.0);
        let moved = face.moved(RgbImage::new(8, 8), &motion);
        for (point, (from, to)) in points().iter().zip(shape.iter().zip(&moved.shape)) {
            let way = to[1] - from[1];
            match point.node {
                Some(NodeId(10)) => assert_eq!(way, 5.0),
                Some(_) => assert_eq!(way, 0.0),
                None => assert!((0.0..2.5).contains(&way), "{way}"),
            }
        }
    }
}
