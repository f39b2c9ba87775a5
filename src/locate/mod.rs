//! Locates faces and their points automatically.
//!
//! 1. A linear template over gradient cells proposes positions of faces.
//! 2. Joint stages place all points together at each proposal.
//! 3. A linear verifier accepts or rejects the face.
//! 4. Local stages refine each point from its own neighbourhood.
//! 5. If the mouth has moved, further local stages move the points of the lower face, because the hand-set points are of neutral faces only.
//!
//! Each face is read twice, once mirrored. The points are the mean of both readings; the distance between the readings gives, with other
//! features, the expected error. All stages are learned by [`learn`] from hand-set points; the learned model ships with the program.

pub mod learn;

mod cells;
mod covers;
mod expect;
mod linear;
mod model;
mod mouth;
mod part;
mod picture;
mod points;
mod shape;
mod stages;
mod teeth;
mod template;

use std::{path::Path, sync::OnceLock};

use image::GrayImage;
use nalgebra::{Point2, Vector2};

pub use model::{LocatorError, Model, ModelOrigin};
pub use part::FacePart;
pub(crate) use points::{LIP_LINES, known_nodes};
pub use points::{PUPILS, points};
pub(crate) use teeth::{redness, steps_to_teeth};

use crate::units::NodeId;
use expect::Reading;
pub(crate) use picture::Picture;
use picture::View;
use shape::{Placement, Shape, distance};
use stages::Placed;
use template::{Candidate, Search, best, best_first, scored};

/// Nodes with the positions at which they were read, px.
pub(crate) type ReadNodes = Vec<(NodeId, Point2<f64>)>;

/// Smallest score of the verifier at which a position counts as a face.
pub const LEAST_SCORE: f32 = 0.0;

/// Median expected error, over the eye distance, up to which a face is trusted.
pub const TRUSTED: f64 = 0.035;

/// Change of size (logarithm) and position (eye distances) with which the second reading of a face starts.
const SECOND_START: (f32, f32) = (0.05, 0.03);

/// More candidates are examined when at least one in this many is a separate face.
const CROWDED: usize = 4;

/// Options of the search.
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
    /// Largest number of faces per picture.
    pub most_faces: usize,
    /// Smallest eye distance, px, at least 10; `None`, and what is no number, for a share of the picture's longer side. There is
    /// no face with an eye distance larger than the picture.
    pub least_eye_distance: Option<f64>,
    /// Whether small faces are searched for in addition to large ones; otherwise only if there are no large ones.
    pub every_size: bool,
}

impl Default for LocateOptions {
    fn default() -> Self {
        Self { most_faces: 20, least_eye_distance: None, every_size: false }
    }
}

/// A located point.
///
/// It can serve as a mark, with its expected error.
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
    /// Position, image pixels.
    pub position: Point2<f64>,
    /// Expected error, px: half of such points are closer, half further away.
    pub expected_error: f64,
}

/// A located face.
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
    /// All points of the locator, in its own order, image pixels.
    pub shape: Vec<Point2<f64>>,
    /// Expected error of each point of `shape`, px.
    pub expected_errors: Vec<f64>,
    /// Distance of the pupils, px.
    pub eye_distance: f64,
    /// Score of the verifier; higher scores are more face-like.
    pub score: f64,
    /// Covered parts: their points are guesses from the rest of the face, with expected errors to match.
    pub covered: Vec<FacePart>,
}

impl LocatedFace {
    /// Returns the median expected error over the eye distance.
    pub fn expected_error(&self) -> f64 {
        let mut errors = self.expected_errors.clone();
        errors.sort_by(f64::total_cmp);
        errors.get(errors.len() / 2).map_or(1.0, |e| e / self.eye_distance.max(f64::MIN_POSITIVE))
    }

    /// Returns the median expected error of the points of parts, over the eye distance; 0 for no points.
    pub fn expected_error_of(&self, parts: &[FacePart]) -> f64 {
        let named = points().iter().zip(&self.expected_errors);
        let of_parts = named.filter(|(point, _)| FacePart::of(point).is_some_and(|part| parts.contains(&part)));
        let mut errors: Vec<f64> = of_parts.map(|(_, &error)| error).collect();
        errors.sort_by(f64::total_cmp);
        errors.get(errors.len() / 2).map_or(0.0, |e| e / self.eye_distance.max(f64::MIN_POSITIVE))
    }

    /// Whether the points can be used without inspection, except those of [`covered`](Self::covered) parts: the median expected error is at
    /// most 0.035 of the eye distance.
    pub fn trusted(&self) -> bool {
        self.expected_error() <= TRUSTED
    }
}

/// What one reading of a face near known places sees.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Look {
    /// How far the corners of the mouth are from where a neutral face has them, and how far its lips are apart, over the eye distance; `None`
    /// if the mouth is covered.
    pub mouth: Option<[f64; mouth::ESTIMATES]>,
    /// Parts that look covered.
    pub covered: Vec<FacePart>,
}

/// Locates faces and their points.
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
    /// Creates a locator with a learned model.
    #[doc(hidden)]
    pub fn new(model: Model) -> Self {
        Self { model }
    }

    /// Returns the locator with the shipped model, which is read once.
    ///
    /// # Errors
    /// [`LocatorError::Format`] if the program was built with an incomplete model.
    pub fn shipped() -> Result<&'static Self, LocatorError> {
        static SHIPPED: OnceLock<Locator> = OnceLock::new();
        if let Some(locator) = SHIPPED.get() {
            return Ok(locator);
        }
        let locator = Self::new(Model::shipped()?);
        Ok(SHIPPED.get_or_init(|| locator))
    }

    /// Reads a locator that `grimace learn locator` wrote.
    ///
    /// # Errors
    /// [`LocatorError`].
    pub fn open(path: &Path) -> Result<Self, LocatorError> {
        Ok(Self::new(Model::read(path)?.0))
    }

    /// Returns the faces of a picture, the largest first; empty if there are none.
    ///
    /// The search is for large upright faces first; if there are none that are trusted, for small ones; then for turned ones.
    pub fn locate(&self, image: &GrayImage, options: &LocateOptions) -> Vec<LocatedFace> {
        self.locate_counted(image, options).0
    }

    /// Same as [`Locator::locate`]; also returns the number of probable faces omitted because of [`LocateOptions::most_faces`].
    pub fn locate_counted(&self, image: &GrayImage, options: &LocateOptions) -> (Vec<LocatedFace>, usize) {
        let Some(picture) = Picture::new(image) else { return (Vec::new(), 0) };
        let (longer, shorter) = (picture.width().max(picture.height()) as f32, picture.width().min(picture.height()) as f32);
        let asked = options.least_eye_distance.filter(|d| !d.is_nan()).map(|d| d.max(10.0) as f32);
        if asked.is_some_and(|d| d > longer) {
            return (Vec::new(), 0);
        }
        let least = asked.unwrap_or((0.055 * longer).max(18.0));
        let most = (0.5 * shorter).max(least);
        let smaller = asked.unwrap_or((0.02 * longer).clamp(10.0, least));
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
        // What is found and not trusted may be something else than the face, which a later search finds.
        let mut doubtful = None;
        for (k, (least, most, angle, count)) in searches.into_iter().enumerate() {
            let search = Search { eye_distance: (least, most), angle, most: count };
            let (found, left_out) = self.faces(&picture, &search, options);
            if found.is_empty() {
                continue;
            }
            let found = if options.every_size && k == 0 && found.len() < options.most_faces {
                let [_, (smaller, _, angle, count), ..] = searches;
                let below = Search { eye_distance: (smaller, least.max(smaller)), angle, most: count };
                let (small, more) = self.faces(&picture, &below, options);
                with_smaller(found, small, left_out.max(more), options.most_faces)
            } else {
                (found, left_out)
            };
            if found.0.iter().any(LocatedFace::trusted) {
                return found;
            }
            doubtful.get_or_insert(found);
        }
        doubtful.unwrap_or_default()
    }

    /// Returns the faces of one search, and the number of further probable faces.
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

    /// Returns the candidates that the verifier accepts, best first. Each face takes up several of the search's candidates: if many of
    /// those examined are faces, twice as many are examined, until there are more than `most_faces` faces.
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

    /// Returns the placement of a candidate face after the first joint stages, and the verifier's score.
    fn verify(&self, view: View<'_>, start: Placement) -> (Placement, f32) {
        let shape: Shape = self.model.mean.iter().map(|&p| start.apply(p)).collect();
        let (placed, features) = self.model.before_last_joint(view, shape);
        (placed.placement, self.model.score(&features))
    }

    /// Reads the face near approximate positions of some of its points; `None` if nothing there looks like a face.
    pub(crate) fn read_near(&self, image: &GrayImage, places: &[(NodeId, Point2<f64>)]) -> Option<LocatedFace> {
        let face = self.read(&Picture::new(image)?, self.placement_of(places)?);
        (face.eye_distance > 0.0 && face.score >= f64::from(LEAST_SCORE)).then_some(face)
    }

    /// Returns the placement of a mean face on approximate positions of some of its points; `None` for fewer than two.
    fn placement_of(&self, places: &[(NodeId, Point2<f64>)]) -> Option<Placement> {
        let mean =
            |node: NodeId| points().iter().zip(&self.model.mean).find(|(p, _)| p.node == Some(node)).map(|(_, &mean)| mean);
        let pairs = places.iter().filter_map(|(node, p)| Some((mean(*node)?, [p.x as f32, p.y as f32])));
        let (from, to): (Shape, Shape) = pairs.unzip();
        (from.len() >= 2).then(|| Placement::fit(&from, &to))
    }

    /// Looks at the face near approximate positions of some of its points; `None` if nothing there looks like a face. The mirror image is not
    /// read; the caller compares with another picture of the same person.
    pub(crate) fn look(&self, image: &GrayImage, places: &[(NodeId, Point2<f64>)]) -> Option<Look> {
        let (picture, start) = (Picture::new(image)?, self.placement_of(places)?);
        let start: Shape = self.model.mean.iter().map(|&p| start.apply(p)).collect();
        let reading = self.model.reading(picture.view(false), start);
        let covers = self.model.covers.as_ref();
        let covered = covers.map(|c| c.covered(&c.seen([&reading.seen, &reading.seen]))).unwrap_or_default();
        let mouth = self.model.mouth.as_ref().filter(|_| !covered.contains(&FacePart::Mouth));
        let mouth = mouth.map(|_| reading.mouth.map(f64::from));
        (reading.score >= LEAST_SCORE).then_some(Look { mouth, covered })
    }

    /// Reads the points that move with the mouth from the places of all points, px; nodes only. `None` if there is nothing to read. The
    /// mirror image is not read; the caller subtracts the reading of another picture, and errors that both share cancel.
    pub(crate) fn read_mouth(&self, image: &GrayImage, shape: &[Point2<f64>]) -> Option<ReadNodes> {
        let mouth = self.model.mouth.as_ref()?;
        let (left, top, part) = mouth::part_of(image, shape)?;
        let corner = [left as f32, top as f32];
        let start: Shape = shape.iter().map(|p| [p.x as f32 - corner[0], p.y as f32 - corner[1]]).collect();
        let read = mouth.refined(Picture::new(&part)?.view(false), &self.model.mean, start);
        let at = |k: usize| Point2::new(f64::from(read[k][0] + corner[0]), f64::from(read[k][1] + corner[1]));
        Some(mouth::moved_points().into_iter().filter_map(|k| Some((points()[k].node?, at(k)))).collect())
    }

    /// Reads the face at a placement.
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

/// Returns the number of faces among placements: those nearer than the larger one's eye distance are one, as in [`each_once`].
fn places<'a>(candidates: impl IntoIterator<Item = &'a Candidate>) -> usize {
    let mut apart: Vec<Placement> = Vec::new();
    for Candidate { placement: p, .. } in candidates {
        if apart.iter().all(|q| distance([p.x, p.y], [q.x, q.y]) >= p.scale().max(q.scale())) {
            apart.push(*p);
        }
    }
    apart.len()
}

/// Adds small faces to large ones, largest first, up to `most`. Returns them, and the number of others: `beside` and those beyond.
fn with_smaller(mut faces: Vec<LocatedFace>, small: Vec<LocatedFace>, beside: usize, most: usize) -> (Vec<LocatedFace>, usize) {
    for face in small {
        if !faces.iter().any(|known| is_same(known, &face)) {
            faces.push(face);
        }
    }
    faces.sort_by(|p, q| q.eye_distance.total_cmp(&p.eye_distance));
    let beyond = faces.len().saturating_sub(most);
    faces.truncate(most);
    (faces, beside + beyond)
}

/// Merges faces whose middles are nearer than the larger one's eye distance; keeps the one with the smallest expected error.
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

/// Returns the mean of two readings.
fn mean_shape(plain: &Reading, mirrored: &Reading) -> Shape {
    plain.shape.iter().zip(&mirrored.shape).map(|(p, q)| [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])]).collect()
}

/// Returns the face of two readings: their mean, with a moved mouth corrected, and expected errors.
fn face(model: &Model, picture: &Picture, plain: &Reading, mirrored: &Reading) -> LocatedFace {
    let mut shape = mean_shape(plain, mirrored);
    let eye_distance = distance(shape[PUPILS[0]], shape[PUPILS[1]]);
    let unit = eye_distance.max(1e-3);
    let mut expected = model.errors.expect_all([plain, mirrored], unit);
    let mut covered = Vec::new();
    if let Some(covers) = &model.covers {
        let seen = covers.seen([&plain.seen, &mirrored.seen]);
        covered = covers.covered(&seen);
        // For a fully visible face the expected errors are those without the cover stage.
        if !covered.is_empty() {
            expected.iter_mut().enumerate().for_each(|(k, error)| *error = covers.expect(k, &seen, *error));
        }
    }
    // A covered mouth is not examined.
    if let Some(mouth) = model.mouth.as_ref().filter(|_| !covered.contains(&FacePart::Mouth)) {
        mouth.read(picture, &model.mean, [plain, mirrored], &mut shape, &mut expected);
    }
    let expected: Vec<f64> = expected.into_iter().map(|error| f64::from(error * unit)).collect();
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
    /// Returns a shape after all joint stages but the last, and the features of the last one there.
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

    /// Returns the verifier's score of the last joint stage's features.
    fn score(&self, features: &[f32]) -> f32 {
        linear::dot(&self.verifier.0, features) + self.verifier.1
    }

    /// Runs all stages from a start in pixels of the view.
    fn reading(&self, view: View<'_>, start: Shape) -> Reading {
        self.reading_and_looks(view, start).0
    }

    /// Same as [`Model::reading`]; also returns the features of each local stage around each point.
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
        let mouth = self.mouth.as_ref().map(|stage| stage.estimates(&looks)).unwrap_or_default();
        (Reading { shape, score, last_step, dissent, seen, mouth }, looks)
    }

    /// Same as [`Model::reading`] on the mirrored picture; start and result refer to the unmirrored picture.
    fn mirrored_reading(&self, picture: &Picture, start: &Shape) -> Reading {
        self.mirrored_reading_and_looks(picture, start).0
    }

    /// Same as [`Model::mirrored_reading`]; also returns the features of each local stage, in the order of the mirrored points.
    fn mirrored_reading_and_looks(&self, picture: &Picture, start: &Shape) -> (Reading, Vec<Vec<f32>>) {
        let view = picture.view(true);
        let (reading, looks) = self.reading_and_looks(view, view.turn_shape(start));
        (reading.turned(view), looks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_least_eye_distance_that_is_none_ends_the_search() {
        let (locator, wall) = (Locator::shipped().unwrap(), GrayImage::from_pixel(40, 32, image::Luma([128])));
        for distance in [f64::INFINITY, 1e300, f64::NAN, 0.0, -5.0, f64::NEG_INFINITY] {
            let options = LocateOptions { least_eye_distance: Some(distance), ..LocateOptions::default() };
            assert!(locator.locate(&wall, &options).is_empty(), "{distance}");
        }
    }

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
        // 20 px apart with 60 px between the eyes: the same face; 150 px apart: another person.
        let kept = each_once(vec![face(100.0, 60.0, 0.03), face(120.0, 50.0, 0.02), face(270.0, 60.0, 0.04)]);
        assert_eq!(kept.iter().map(|f| f.shape[0].x).collect::<Vec<_>>(), [115.0, 265.0]);
    }
}
