//! Faces and their points, found without a click.
//!
//! A linear template over gradient cells says where faces may be; joint stages place all points together at each such place; a linear
//! verifier says whether that is a face; local stages let each point look around itself. Each face is read twice, once in the mirror:
//! the points are the mean of both, and how far the two are apart tells, with other signs, the error to expect. Everything is learned by
//! [`learn`] from hand-set points; what was learned ships with the program. Hand-set points are there of closed mouths only, so a last
//! stage looks whether the lips are parted, and where their edges are then.

pub mod learn;

mod cells;
mod covers;
mod expect;
mod linear;
mod lips;
mod model;
mod part;
mod picture;
mod points;
mod shape;
mod stages;
mod teeth;
mod template;

use std::sync::OnceLock;

use image::GrayImage;
use nalgebra::{Point2, Vector2};

pub use model::{Model, ModelError, ModelOrigin};
pub use part::FacePart;
pub use points::{PUPILS, points};

use crate::units::NodeId;
use expect::Reading;
pub(crate) use picture::Picture;
use picture::View;
use shape::{Placement, Shape, distance};
use stages::Placed;
use template::{Candidate, Search, best, best_first, scored};

/// Score of the verifier from which a place counts as a face.
pub const LEAST_SCORE: f32 = 0.0;

/// Median expected error, over the eye distance, up to which a face is trusted.
pub const TRUSTED: f64 = 0.035;

/// A face that is read starts its second reading this much larger (logarithm) and this far off, eye distances.
const SECOND_START: (f32, f32) = (0.05, 0.03);

/// Where one of this many candidates is a face of its own, more of them are looked at.
const CROWDED: usize = 4;

/// What to look for.
///
/// ```
/// use grimace::locate::{LocateOptions, Locator};
/// use image::{GrayImage, Luma};
///
/// let options = LocateOptions { most_faces: 1, ..LocateOptions::default() };
/// let wall = GrayImage::from_pixel(200, 200, Luma([128]));
/// assert!(Locator::shipped()?.locate(&wall, &options).is_empty());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocateOptions {
    /// Most faces of a picture.
    pub most_faces: usize,
    /// Smallest eye distance, px; `None` for a share of the picture's longer side.
    pub least_eye_distance: Option<f64>,
    /// Whether small faces are looked for beside large ones, too; else only where there are no large ones.
    pub every_size: bool,
}

impl Default for LocateOptions {
    fn default() -> Self {
        Self { most_faces: 20, least_eye_distance: None, every_size: false }
    }
}

/// A point that was found.
///
/// A point that was found serves as a mark, with the error to expect of it.
/// ```
/// use grimace::{correspondence::Correspondence, locate::{LocateOptions, LocatedPoint, Locator}, sequence::read_frame};
///
/// let picture = read_frame("fixtures/portraits/P01.jpg".as_ref())?;
/// let face = &Locator::shipped()?.locate(picture.image(), &LocateOptions::default())[0];
/// let as_mark = |point: &LocatedPoint| Correspondence::found(point.node, point.position, point.expected_error);
/// let marks: Vec<Correspondence> = face.points.iter().map(as_mark).collect();
/// assert!(marks.len() > 30 && marks.iter().all(|mark| mark.expected_error > Some(0.0)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocatedPoint {
    /// The node.
    pub node: NodeId,
    /// Where it is, image pixels.
    pub position: Point2<f64>,
    /// Half of such points are further off than this, half less; px.
    pub expected_error: f64,
}

/// A face that was found.
///
/// ```
/// use grimace::{locate::{LocateOptions, Locator}, sequence::read_frame};
///
/// let picture = read_frame("fixtures/portraits/P01.jpg".as_ref())?;
/// let face = &Locator::shipped()?.locate(picture.image(), &LocateOptions::default())[0];
/// assert!(face.trusted() && face.expected_error() < 0.035);
/// // The eyes of the portraits are about 110 px apart.
/// assert!((face.eye_distance - 110.0).abs() < 10.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct LocatedFace {
    /// Its points, by node.
    pub points: Vec<LocatedPoint>,
    /// All points that the locator knows, in its own order, image pixels.
    pub shape: Vec<Point2<f64>>,
    /// The error to expect of each of these, px.
    pub expected_errors: Vec<f64>,
    /// Distance of the pupils, px.
    pub eye_distance: f64,
    /// Score of the verifier; the higher the more like a face.
    pub score: f64,
    /// Parts that something covers: their points are guessed from the rest of the face, and so are their expected errors.
    pub covered: Vec<FacePart>,
}

impl LocatedFace {
    /// Median expected error over the eye distance.
    pub fn expected_error(&self) -> f64 {
        let mut errors = self.expected_errors.clone();
        errors.sort_by(f64::total_cmp);
        errors.get(errors.len() / 2).map_or(1.0, |e| e / self.eye_distance.max(f64::MIN_POSITIVE))
    }

    /// Median expected error of the points of parts, over the eye distance; 0 of none.
    pub fn expected_error_of(&self, parts: &[FacePart]) -> f64 {
        let named = points().iter().zip(&self.expected_errors);
        let of_parts = named.filter(|(point, _)| FacePart::of(point).is_some_and(|part| parts.contains(&part)));
        let mut errors: Vec<f64> = of_parts.map(|(_, &error)| error).collect();
        errors.sort_by(f64::total_cmp);
        errors.get(errors.len() / 2).map_or(0.0, |e| e / self.eye_distance.max(f64::MIN_POSITIVE))
    }

    /// Whether the points may be used without a look, but for those of the parts that are [`covered`](Self::covered): the median expected error
    /// is at most 0.035 of the eye distance.
    pub fn trusted(&self) -> bool {
        self.expected_error() <= TRUSTED
    }
}

/// Finds faces and their points.
///
/// ```
/// use grimace::{locate::{LocateOptions, Locator}, sequence::read_frame};
///
/// let picture = read_frame("fixtures/portraits/P01.jpg".as_ref())?;
/// let faces = Locator::shipped()?.locate(picture.image(), &LocateOptions::default());
/// assert_eq!(faces.len(), 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Locator {
    model: Model,
}

impl Locator {
    /// With a model that was learned.
    pub fn new(model: Model) -> Self {
        Self { model }
    }

    /// With the model that ships; it is read once.
    ///
    /// # Errors
    /// `ModelError` when it was not built in whole.
    pub fn shipped() -> Result<&'static Self, ModelError> {
        static SHIPPED: OnceLock<Locator> = OnceLock::new();
        if let Some(locator) = SHIPPED.get() {
            return Ok(locator);
        }
        let locator = Self::new(Model::shipped()?);
        Ok(SHIPPED.get_or_init(|| locator))
    }

    /// The faces of a picture, the largest first; none where there are none.
    ///
    /// Faces are looked for upright and large first; where there are none, small ones are, and where there are none of these, turned ones.
    pub fn locate(&self, image: &GrayImage, options: &LocateOptions) -> Vec<LocatedFace> {
        self.locate_counted(image, options).0
    }

    /// [`Locator::locate`], and how many more places look like faces that [`LocateOptions::most_faces`] leaves out.
    pub fn locate_counted(&self, image: &GrayImage, options: &LocateOptions) -> (Vec<LocatedFace>, usize) {
        let Some(picture) = Picture::new(image) else { return (Vec::new(), 0) };
        let (longer, shorter) = (picture.width().max(picture.height()) as f32, picture.width().min(picture.height()) as f32);
        let least = options.least_eye_distance.map_or((0.055 * longer).max(18.0), |d| d.max(10.0) as f32);
        let most = (0.5 * shorter).max(least);
        let smaller = options.least_eye_distance.map_or((0.02 * longer).clamp(10.0, least), |d| d as f32);
        let degrees = f32::to_radians;
        let searches = [
            (least, most, 0.0, 12),
            (smaller * 1.07, most, 0.0, 40),
            (least, most, degrees(25.0), 12),
            (least, most, degrees(-25.0), 12),
            (least, most, degrees(90.0), 12),
            (least, most, degrees(-90.0), 12),
            (least, most, degrees(180.0), 12),
            (least, most, degrees(50.0), 12),
            (least, most, degrees(-50.0), 12),
        ];
        for (k, (least, most, angle, count)) in searches.into_iter().enumerate() {
            let search = Search { eye_distance: (least, most), angle, most: count };
            let (found, left_out) = self.faces(&picture, &search, options);
            if found.is_empty() {
                continue;
            }
            if !(options.every_size && k == 0 && found.len() < options.most_faces) {
                return (found, left_out);
            }
            let [_, (smaller, _, angle, count), ..] = searches;
            let below = Search { eye_distance: (smaller, least.max(smaller)), angle, most: count };
            let (small, more) = self.faces(&picture, &below, options);
            let mut all = found;
            for face in small {
                if !all.iter().any(|known| is_same(known, &face)) {
                    all.push(face);
                }
            }
            all.sort_by(|p, q| q.eye_distance.total_cmp(&p.eye_distance));
            let beyond = all.len().saturating_sub(options.most_faces);
            all.truncate(options.most_faces);
            return (all, left_out.max(more) + beyond);
        }
        (Vec::new(), 0)
    }

    /// The faces of one search, and how many more places look like some.
    fn faces(&self, picture: &Picture, search: &Search, options: &LocateOptions) -> (Vec<LocatedFace>, usize) {
        let likely = self.likely(picture, search, options.most_faces);
        let mut waiting = likely.iter().map(|c| c.placement);
        let mut faces: Vec<LocatedFace> = Vec::new();
        while faces.len() < options.most_faces {
            let room = options.most_faces - faces.len();
            let read: Vec<_> = waiting.by_ref().take(room).map(|place| self.read(picture, place)).collect();
            if read.is_empty() {
                break;
            }
            faces.extend(read.into_iter().filter(|f| f.eye_distance > 0.0 && f.score >= f64::from(LEAST_SCORE)));
            faces = each_once(faces);
        }
        let left_out = places(&likely) - places(&likely[..likely.len() - waiting.len()]);
        faces.sort_by(|p, q| q.eye_distance.total_cmp(&p.eye_distance));
        (faces, left_out)
    }

    /// Places that the verifier takes for faces, best first. Each face takes a few of the search's candidates: where those that were looked
    /// at are full of faces, twice as many are, until there are more than `most_faces`.
    fn likely(&self, picture: &Picture, search: &Search, most_faces: usize) -> Vec<Candidate> {
        let view = picture.view(false);
        let verified = |c: &Candidate| {
            let (placement, score) = self.verify(view, c.placement);
            (score >= LEAST_SCORE).then_some(Candidate { placement, score })
        };
        let all = scored(view, (picture.width(), picture.height()), &self.model.template, search);
        let (mut most, mut verified_so_far, mut looked_at) = (search.most, Vec::new(), 0);
        loop {
            let next = best(&all, most);
            verified_so_far.extend(next.iter().skip(looked_at).filter_map(verified));
            looked_at = next.len();
            let likely = best(&best_first(verified_so_far.clone()), usize::MAX);
            let faces = places(&likely);
            if looked_at < most || faces * CROWDED < looked_at || faces > most_faces {
                return likely;
            }
            most *= 2;
        }
    }

    /// Where the first joint stages put a face that may be at a place, and how much it looks like one.
    fn verify(&self, view: View<'_>, start: Placement) -> (Placement, f32) {
        let shape: Shape = self.model.mean.iter().map(|&p| start.apply(p)).collect();
        let (placed, features) = self.model.before_last_joint(view, shape);
        (placed.placement, self.model.score(&features))
    }

    /// Reads the face that may be where points of it are thought to be; `None` where nothing looks like one.
    pub(crate) fn read_near(&self, image: &GrayImage, places: &[(NodeId, Point2<f64>)]) -> Option<LocatedFace> {
        let picture = Picture::new(image)?;
        let mean =
            |node: NodeId| points().iter().zip(&self.model.mean).find(|(p, _)| p.node == Some(node)).map(|(_, &mean)| mean);
        let pairs = places.iter().filter_map(|(node, p)| Some((mean(*node)?, [p.x as f32, p.y as f32])));
        let (from, to): (Shape, Shape) = pairs.unzip();
        let face = (from.len() >= 2).then(|| self.read(&picture, Placement::fit(&from, &to)))?;
        (face.eye_distance > 0.0 && face.score >= f64::from(LEAST_SCORE)).then_some(face)
    }

    /// Reads the face at a place.
    pub(crate) fn read(&self, picture: &Picture, start: Placement) -> LocatedFace {
        let model = &self.model;
        let mean_at = |p: Placement| -> Shape { model.mean.iter().map(|&m| p.apply(m)).collect() };
        let plain = model.reading(picture.view(false), mean_at(start));
        let larger = SECOND_START.0.exp();
        let shift = SECOND_START.1 * start.scale();
        let other = Placement { a: start.a * larger, b: start.b * larger, x: start.x + shift, y: start.y - shift };
        let mirrored = model.mirrored_reading(picture, &mean_at(other));
        face(model, picture, &plain, &mirrored)
    }
}

/// How many faces placements show: those nearer than the larger one's eye distance are one, as in [`each_once`].
fn places<'a>(candidates: impl IntoIterator<Item = &'a Candidate>) -> usize {
    let mut apart: Vec<Placement> = Vec::new();
    for Candidate { placement: p, .. } in candidates {
        if apart.iter().all(|q| distance([p.x, p.y], [q.x, q.y]) >= p.scale().max(q.scale())) {
            apart.push(*p);
        }
    }
    apart.len()
}

/// Faces whose middles are nearer than the larger one's eye distance are one face; the reading with the smallest expected error is kept.
fn each_once(mut faces: Vec<LocatedFace>) -> Vec<LocatedFace> {
    faces.sort_by(|p, q| p.expected_error().total_cmp(&q.expected_error()));
    let mut kept: Vec<LocatedFace> = Vec::new();
    for face in faces {
        if !kept.iter().any(|known| is_same(known, &face)) {
            kept.push(face);
        }
    }
    kept
}

/// Whether the middles of two faces are nearer than the larger one's eye distance.
fn is_same(p: &LocatedFace, q: &LocatedFace) -> bool {
    let middle = |face: &LocatedFace| {
        let sum = face.shape.iter().fold(Vector2::zeros(), |sum, p| sum + p.coords);
        Point2::from(sum / face.shape.len().max(1) as f64)
    };
    (middle(p) - middle(q)).norm() < p.eye_distance.max(q.eye_distance)
}

/// The mean of two readings.
fn mean_shape(plain: &Reading, mirrored: &Reading) -> Shape {
    plain.shape.iter().zip(&mirrored.shape).map(|(p, q)| [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])]).collect()
}

/// The mean of two readings, with lips that are parted where they are, and what errors to expect of it.
fn face(model: &Model, picture: &Picture, plain: &Reading, mirrored: &Reading) -> LocatedFace {
    let mut shape = mean_shape(plain, mirrored);
    let eye_distance = distance(shape[PUPILS[0]], shape[PUPILS[1]]);
    let unit = eye_distance.max(1e-3);
    let mut expected = model.errors.expect_all([plain, mirrored], unit);
    let mut covered = Vec::new();
    if let Some(covers) = &model.covers {
        let seen = covers.seen([&plain.seen, &mirrored.seen]);
        covered = covers.covered(&seen);
        // Of a face of which all is to be seen nothing else is expected than without the stage.
        if !covered.is_empty() {
            expected.iter_mut().enumerate().for_each(|(k, error)| *error = covers.expect(k, &seen, *error));
        }
    }
    let mut expected: Vec<f64> = expected.into_iter().map(|error| f64::from(error * unit)).collect();
    // What lies over a mouth has no lips.
    if let Some(lips) = model.lips.as_ref().filter(|_| !covered.contains(&FacePart::Mouth)) {
        for (k, point) in lips.parted(picture, &model.mean, &shape).into_iter().flatten() {
            shape[k] = point;
            expected[k] = expected[k].max(f64::from(lips.expected_error * unit));
        }
    }
    let shape: Vec<Point2<f64>> = shape.iter().map(|p| Point2::new(f64::from(p[0]), f64::from(p[1]))).collect();
    let named = points().iter().zip(&shape).zip(&expected);
    let mut found: Vec<LocatedPoint> = named
        .filter_map(|((point, &position), &expected_error)| Some(LocatedPoint { node: point.node?, position, expected_error }))
        .collect();
    found.sort_by_key(|p| p.node);
    let score = 0.5 * f64::from(plain.score + mirrored.score);
    LocatedFace { points: found, shape, expected_errors: expected, eye_distance: f64::from(eye_distance), score, covered }
}

impl Model {
    /// A shape after all joint stages but the last, and what the last one reads there.
    fn before_last_joint(&self, view: View<'_>, mut shape: Shape) -> (Placed, Vec<f32>) {
        let last = self.joint.len().saturating_sub(1);
        for stage in &self.joint[..last] {
            let placed = Placed::new(&self.mean, &shape);
            shape = placed.moved(&stage.step(&stage.features(view, &placed, &self.features)));
        }
        let placed = Placed::new(&self.mean, &shape);
        let features = self.joint.last().map(|s| s.features(view, &placed, &self.features)).unwrap_or_default();
        (placed, features)
    }

    /// How much what the last joint stage reads looks like a face.
    fn score(&self, features: &[f32]) -> f32 {
        linear::dot(&self.verifier.0, features) + self.verifier.1
    }

    /// All stages from a start in pixels of the view.
    fn reading(&self, view: View<'_>, start: Shape) -> Reading {
        self.reading_and_looks(view, start).0
    }

    /// [`Model::reading`], and what each local stage saw around each point.
    fn reading_and_looks(&self, view: View<'_>, start: Shape) -> (Reading, Vec<Vec<f32>>) {
        let (placed, features) = self.before_last_joint(view, start);
        let score = self.score(&features);
        let mut shape = match self.joint.last() {
            Some(stage) => placed.moved(&stage.step(&features)),
            None => placed.moved(&vec![0.0; 2 * self.mean.len()]),
        };
        let (mut last_step, mut dissent, mut looks) = (Vec::new(), Vec::new(), Vec::new());
        for stage in &self.local {
            let placed = Placed::new(&self.mean, &shape);
            let features = stage.features(view, &placed);
            let said = stage.step(&features);
            looks.push(features);
            shape = placed.moved(&said.step);
            last_step = said.step.chunks_exact(2).map(|s| s[0].hypot(s[1])).collect();
            dissent = said.dissent;
        }
        let seen = self.covers.as_ref().map(|covers| covers.say(&looks)).unwrap_or_default();
        (Reading { shape, score, last_step, dissent, seen }, looks)
    }

    /// As [`Model::reading`] of the picture in the mirror; start and answer are those of the picture as it is.
    fn mirrored_reading(&self, picture: &Picture, start: &Shape) -> Reading {
        self.mirrored_reading_and_looks(picture, start).0
    }

    /// [`Model::mirrored_reading`], and what each local stage saw around each point, in the mirror's order.
    fn mirrored_reading_and_looks(&self, picture: &Picture, start: &Shape) -> (Reading, Vec<Vec<f32>>) {
        let view = picture.view(true);
        let turned = |values: &[f32]| points().iter().filter_map(|p| values.get(p.mirror).copied()).collect::<Vec<f32>>();
        let (reading, looks) = self.reading_and_looks(view, view.turn_shape(start));
        let reading = Reading {
            shape: view.turn_shape(&reading.shape),
            last_step: turned(&reading.last_step),
            dissent: turned(&reading.dissent),
            seen: turned(&reading.seen),
            ..reading
        };
        (reading, looks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_face_that_is_read_twice_is_one() {
        let face = |x: f64, eye_distance: f64, expected: f64| LocatedFace {
            points: Vec::new(),
            shape: vec![Point2::new(x - 5.0, 90.0), Point2::new(x + 5.0, 110.0)],
            expected_errors: vec![expected * eye_distance; 3],
            eye_distance,
            score: 1.0,
            covered: Vec::new(),
        };
        // 20 px apart with 60 px between the eyes: the same; 150 px away: somebody else.
        let kept = each_once(vec![face(100.0, 60.0, 0.03), face(120.0, 50.0, 0.02), face(270.0, 60.0, 0.04)]);
        assert_eq!(kept.iter().map(|f| f.shape[0].x).collect::<Vec<_>>(), [115.0, 265.0]);
    }
}
