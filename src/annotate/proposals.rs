//! Proposes marks for a neutral frame: from the dataset's landmarks, else from the face that [`crate::locate`] finds, else by OpenCV's Haar
//! cascades. Proposals are never saved automatically; the user accepts or moves them.
//!
//! The cascades find a face and the eyes in its upper half. Within each eye's box, the iris is the darkest spot after blurring. Eye and
//! mouth corners are placed as in the mean of real faces ([`ShapePrior::faces`]), by the similarity that maps its pupils to the irises. The
//! mouth is then moved along the face to the darkest line near its expected position, which is the line between the lips, and each corner
//! to where that line leads from the middle. OpenCV has only one mouth cascade, for smiles; on neutral mouths its error is larger than that
//! of the mean face.

use std::{
    ffi::OsStr,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use image::GrayImage;
use nalgebra::{Point2, Vector2};

use crate::{
    companion::{
        Answer, Companion, CompanionError,
        wire::{FaceBoxes, Reply},
    },
    dataset::{LandmarkSelection, SequenceEntry, correspondences_from_landmarks},
    fit::{Correspondence, ShapePrior},
    geometry::Similarity,
    sequence::Frame,
    track::smoothed,
    units::NodeId,
    wireframe::Tables,
};

/// Folders in which Debian's package `opencv-data` and OpenCV's own installation put the cascades.
pub const CASCADE_FOLDERS: [&str; 4] = [
    "/usr/share/opencv4/haarcascades",
    "/usr/local/share/opencv4/haarcascades",
    "/usr/share/opencv/haarcascades",
    "/opt/homebrew/share/opencv4/haarcascades",
];

const FACE: &str = "haarcascade_frontalface_alt2.xml";
/// Tried in this order; the second one detects eyes behind glasses.
const EYES: [&str; 2] = ["haarcascade_eye.xml", "haarcascade_eye_tree_eyeglasses.xml"];

/// Outer and inner corner of the left eye, inner and outer corner of the right eye, left and right corner of the mouth.
const PROPOSED: [NodeId; 6] = [NodeId(20), NodeId(23), NodeId(56), NodeId(53), NodeId(31), NodeId(64)];
const MOUTH_CORNERS: [NodeId; 2] = [NodeId(31), NodeId(64)];

/// Blur that turns an iris into one dark spot, and largest horizontal distance of that spot from the middle of the eye's box, as shares of
/// the distance of the boxes. The vertical position of the boxes is accurate, and vertically lashes and brows are dark, too.
const IRIS_BLUR: f64 = 0.07;
const IRIS_REACH: f64 = 0.1;

/// Parameters of the line between the lips, in eye distances: half its width, step along the face, search distance from its expected
/// position, standard deviation of that position between people, and length over which brightness is compared.
const LIPS_HALF_WIDTH: f64 = 0.2;
const LIPS_STEP: f64 = 0.01;
const LIPS_REACH: f64 = 0.3;
const LIPS_DEVIATION: f64 = 0.11;
const LIPS_SURROUND: f64 = 0.15;

/// Parameters for following the line between the lips: most steps of [`LIPS_STEP`] up or down per step along it; cost of each in grey
/// levels; largest distance of the end from the middle's height; smoothing of the picture. Lengths in eye distances.
const FOLLOW_STEPS: i32 = 2;
const FOLLOW_COST: f64 = 0.6;
const FOLLOW_REACH: f64 = 0.12;
const FOLLOW_BLUR: f64 = 0.015;

/// Limits of plausible detections: steepest line through the eyes, radians, and smallest and largest eye distance divided by the width of
/// the face box.
const EYE_LINE: f64 = 0.35;
const EYE_SPAN: (f64, f64) = (0.28, 0.62);

/// Source of proposals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ProposalSource {
    /// Landmarks of the dataset.
    Landmarks,
    /// The face found in the picture, each mark with its expected error.
    Found,
    /// OpenCV's Haar cascades.
    Cascades,
}

/// Marks proposed for a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct ProposedMarks {
    /// Their source.
    pub source: ProposalSource,
    /// The marks.
    pub marks: Vec<Correspondence>,
}

/// Why cascades cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CascadeError {
    /// The folder of cascades does not exist.
    #[error("OpenCV's face cascades are not installed; on Debian: apt-get install opencv-data")]
    NotInstalled,
    /// A cascade is missing or cannot be loaded.
    #[error("{}: the cascade does not load; on Debian: apt-get install opencv-data", path.display())]
    DoesNotLoad {
        /// The file.
        path: PathBuf,
    },
    /// The program that finds faces is missing or ended early.
    #[error(transparent)]
    Program(#[from] CompanionError),
    /// The detector failed.
    #[error("OpenCV's detector failed: {reason}")]
    Detector {
        /// Its message.
        reason: String,
    },
}

/// Haar cascades for faces and eyes.
#[derive(Debug)]
pub struct Cascades {
    folder: PathBuf,
    /// The program that has loaded them. It is started for the first picture, and again if it crashed.
    companion: Option<Companion>,
    mean: Vec<Point2<f64>>,
    pupils: [Vec<NodeId>; 2],
}

impl Cascades {
    /// Loads the cascades of a folder; `None` selects the first of [`CASCADE_FOLDERS`] that exists.
    ///
    /// # Errors
    /// [`CascadeError`] when they do not exist or cannot be loaded.
    pub fn load(folder: Option<&Path>, tables: &Tables) -> Result<Self, CascadeError> {
        let usual = || CASCADE_FOLDERS.iter().map(PathBuf::from).find(|f| f.join(FACE).is_file());
        let folder = folder.map(Path::to_owned).or_else(usual).ok_or(CascadeError::NotInstalled)?;
        if let Some(path) = [FACE, EYES[0], EYES[1]].map(|name| folder.join(name)).into_iter().find(|path| !path.is_file()) {
            return Err(CascadeError::DoesNotLoad { path });
        }
        let pupil = |fp: &str| fp.parse().ok().and_then(|fp| tables.feature_point_nodes(fp)).unwrap_or_default().to_vec();
        // The prior for marks set by people rather than by networks.
        let [_, by_hand] = ShapePrior::faces();
        Ok(Self { folder, companion: None, mean: by_hand.mean, pupils: ["3.5", "3.6"].map(pupil) })
    }

    /// Boxes that the cascades find in a picture.
    fn boxes(&mut self, image: &GrayImage) -> Result<Option<FaceBoxes>, CascadeError> {
        #[allow(clippy::single_match_else)]
        let mut companion = match self.companion.take() {
            Some(companion) => companion,
            None => {
                let words = [OsStr::new("faces"), self.folder.as_os_str(), FACE.as_ref(), EYES[0].as_ref(), EYES[1].as_ref()];
                let mut companion = Companion::start(words)?;
                match companion.receive(0)? {
                    Answer::Said(Reply::Ready) => companion,
                    Answer::Said(Reply::Failed { reason }) => {
                        return Err(CascadeError::DoesNotLoad { path: self.folder.join(reason) });
                    }
                    other => return Err(other.unexpected().into()),
                }
            }
        };
        companion.send_pixels(image.dimensions(), 1, image.as_raw())?;
        match companion.receive(0)? {
            Answer::Said(Reply::Face(boxes)) => {
                self.companion = Some(companion);
                Ok(boxes)
            }
            Answer::Said(Reply::Failed { reason }) => Err(CascadeError::Detector { reason }),
            other => Err(other.unexpected().into()),
        }
    }

    /// Corners of eyes and mouth of the largest face; `None` without a face with two eyes.
    ///
    /// # Errors
    /// [`CascadeError::Detector`], and [`CascadeError::Program`].
    pub fn find(&mut self, frame: &Frame) -> Result<Option<Vec<Correspondence>>, CascadeError> {
        let image = frame.image();
        let Some(boxes) = self.boxes(image)? else { return Ok(None) };
        let Some([left, right]) = eye_centres(&boxes) else { return Ok(None) };
        let [left, right] = [left, right].map(|eye| iris(image, eye, (left - right).norm()));
        let middle = |nodes: &[NodeId]| -> Option<Point2<f64>> {
            let points: Option<Vec<_>> = nodes.iter().map(|n| self.mean.get(n.index()).map(|p| p.coords)).collect();
            let points = points.filter(|p| !p.is_empty())?;
            Some(Point2::from(points.iter().sum::<Vector2<f64>>() / points.len() as f64))
        };
        let flip = |p: Point2<f64>| Point2::new(p.x, -p.y);
        let (Some(mean_left), Some(mean_right)) = (middle(&self.pupils[0]), middle(&self.pupils[1])) else { return Ok(None) };
        let Ok(placement) = Similarity::fit(&[mean_left, mean_right], &[flip(left), flip(right)], None) else { return Ok(None) };
        let place = |node: &NodeId| self.mean.get(node.index()).map(|p| flip(placement.apply(p)));
        let Some(mut places) = PROPOSED.iter().map(place).collect::<Option<Vec<_>>>() else { return Ok(None) };
        let corners: Vec<usize> = (0..PROPOSED.len()).filter(|&k| MOUTH_CORNERS.contains(&PROPOSED[k])).collect();
        let expected = Point2::from(corners.iter().map(|&k| places[k].coords).sum::<Vector2<f64>>() / corners.len() as f64);
        if let Some(offset) = lips_offset(image, [left, right], expected) {
            let middle = expected + offset;
            for &k in &corners {
                let corner = places[k] + offset;
                places[k] = corner + follow_lips(image, [left, right], middle, corner).unwrap_or_default();
            }
        }
        let mark = |(&node, position): (&NodeId, Point2<f64>)| Correspondence::mark(node, position);
        Ok(Some(PROPOSED.iter().zip(places).map(mark).collect()))
    }
}

/// Centres of the subject's left and right eye.
fn eye_centres(FaceBoxes { face, eyes }: &FaceBoxes) -> Option<[Point2<f64>; 2]> {
    let width = f64::from(face[2]);
    let middle = f64::from(face[0]) + width / 2.0;
    eyes.iter().find_map(|boxes| {
        let centres: Vec<_> = boxes.iter().map(|b| centre(*b, *face)).collect();
        let mut best: Option<(f64, [Point2<f64>; 2])> = None;
        // The subject's left eye is on the right of the image.
        for (l, left) in centres.iter().enumerate().filter(|(_, p)| p.x > middle) {
            for (r, right) in centres.iter().enumerate().filter(|(_, p)| p.x <= middle) {
                let span = (left - right).norm() / width;
                let slope = ((left.y - right.y) / (left.x - right.x)).atan().abs();
                if slope > EYE_LINE || span < EYE_SPAN.0 || span > EYE_SPAN.1 {
                    continue;
                }
                let size = |k: usize| f64::from(boxes[k][2]);
                let misfit = slope + (size(l) / size(r)).ln().abs() + (f64::midpoint(left.x, right.x) - middle).abs() / width;
                if best.is_none_or(|(least, _)| misfit < least) {
                    best = Some((misfit, [*left, *right]));
                }
            }
        }
        best.map(|(_, eyes)| eyes)
    })
}

/// The darkest spot, after blurring, beside the middle of an eye.
fn iris(image: &GrayImage, middle: Point2<f64>, eye_distance: f64) -> Point2<f64> {
    let margin = (3.0 * IRIS_BLUR * eye_distance).ceil();
    let range = |centre: f64, reach: f64, size: u32| {
        let last = f64::from(size.max(1) - 1);
        let bound = |v: f64| v.round().clamp(0.0, last) as u32;
        bound(centre - reach)..bound(centre + reach) + 1
    };
    let reach = IRIS_REACH * eye_distance;
    let (columns, rows) = (range(middle.x, reach + margin, image.width()), range(middle.y, margin, image.height()));
    let region = rows.clone().flat_map(|y| columns.clone().map(move |x| f32::from(image.get_pixel(x, y).0[0])));
    let blurred = smoothed(region.collect(), columns.len(), IRIS_BLUR * eye_distance);
    let row = (middle.y.round().max(0.0) as usize).saturating_sub(rows.start as usize).min(rows.len() - 1);
    let values = &blurred[row * columns.len()..][..columns.len()];
    // Rounded to whole grey levels, so that the most central of similar pixels is chosen.
    let near = columns.zip(values).map(|(column, value)| (value.round() as u8, f64::from(column)));
    let darkest = near
        .filter(|(_, column)| (column - middle.x).abs() <= reach)
        .min_by(|a, b| a.0.cmp(&b.0).then((a.1 - middle.x).abs().total_cmp(&(b.1 - middle.x).abs())));
    Point2::new(darkest.map_or(middle.x, |(_, column)| column), middle.y)
}

/// Vector from the expected middle of the mouth to the line between the lips, along the face; `None` where the image ends too early.
///
/// It minimizes z(t) + t^2 / (2 d^2) over offsets t in eye distances: z is the mean brightness of a line across the mouth minus that of its
/// surroundings, in standard deviations; d is [`LIPS_DEVIATION`].
fn lips_offset(image: &GrayImage, [left, right]: [Point2<f64>; 2], expected: Point2<f64>) -> Option<Vector2<f64>> {
    let across = left - right;
    let down = Vector2::new(-across.y, across.x);
    let steps = |reach: f64| {
        let count = (reach / LIPS_STEP).round() as i32;
        -count..=count
    };
    let brightness = |t: f64| -> Option<f64> {
        let pixel = |s: i32| {
            let point = expected + across * (f64::from(s) * 0.02) + down * t;
            let (x, y) = (point.x.round(), point.y.round());
            let inside = x >= 0.0 && y >= 0.0 && x < f64::from(image.width()) && y < f64::from(image.height());
            inside.then(|| f64::from(image.get_pixel(x as u32, y as u32).0[0]))
        };
        let half = (LIPS_HALF_WIDTH / 0.02).round() as i32;
        let values: Option<Vec<f64>> = (-half..=half).map(pixel).collect();
        values.map(|v| v.iter().sum::<f64>() / v.len() as f64)
    };
    let profile: Vec<f64> =
        steps(LIPS_REACH + LIPS_SURROUND).map(|k| brightness(f64::from(k) * LIPS_STEP)).collect::<Option<_>>()?;
    let surround = (LIPS_SURROUND / LIPS_STEP).round() as usize;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let relative: Vec<f64> = (surround..profile.len() - surround)
        .map(|k| mean(&profile[k - 1..=k + 1]) - mean(&profile[k - surround..=k + surround]))
        .collect();
    let deviation = mean(&relative.iter().map(|v| v * v).collect::<Vec<_>>()).sqrt();
    let cost = |(k, value): (i32, f64)| {
        let t = f64::from(k) * LIPS_STEP;
        (value / deviation.max(1.0) + (t / LIPS_DEVIATION).powi(2) / 2.0, t)
    };
    let costs = steps(LIPS_REACH).zip(relative).map(cost);
    costs.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, t)| down * t)
}

/// Vector along the face from the expected corner of a mouth to the end of the line between the lips, followed from its `middle`; `None`
/// where the image ends too early.
fn follow_lips(
    image: &GrayImage,
    [left, right]: [Point2<f64>; 2],
    middle: Point2<f64>,
    corner: Point2<f64>,
) -> Option<Vector2<f64>> {
    let across = left - right;
    let down = Vector2::new(-across.y, across.x);
    let brightness = |at: Point2<f64>| -> Option<f64> {
        let around = [Vector2::zeros(), across * FOLLOW_BLUR, -across * FOLLOW_BLUR, down * FOLLOW_BLUR, -down * FOLLOW_BLUR];
        let pixels = around.map(|offset| {
            let point = at + offset;
            let (x, y) = (point.x.round(), point.y.round());
            let inside = x >= 0.0 && y >= 0.0 && x < f64::from(image.width()) && y < f64::from(image.height());
            inside.then(|| f64::from(image.get_pixel(x as u32, y as u32).0[0]))
        });
        pixels.iter().copied().sum::<Option<f64>>().map(|sum| sum / around.len() as f64)
    };
    let along = corner - middle;
    let count = (along.norm() / (LIPS_STEP * across.norm())).round().max(1.0) as u32;
    let mut height = 0.0;
    for k in 1..=count {
        let on_line = middle + along * (f64::from(k) / f64::from(count));
        let mut best: Option<(f64, f64)> = None;
        for step in -FOLLOW_STEPS..=FOLLOW_STEPS {
            let next = (height + f64::from(step) * LIPS_STEP).clamp(-FOLLOW_REACH, FOLLOW_REACH);
            let cost = brightness(on_line + down * next)? + FOLLOW_COST * f64::from(step.abs());
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, next));
            }
        }
        height = best.map_or(height, |(_, next)| next);
    }
    Some(down * height)
}

/// Centre of a box found within another one, px of the image.
fn centre([x, y, width, height]: [i32; 4], within: [i32; 4]) -> Point2<f64> {
    Point2::new(
        f64::from(within[0]) + f64::from(x) + f64::from(width - 1) / 2.0,
        f64::from(within[1]) + f64::from(y) + f64::from(height - 1) / 2.0,
    )
}

/// Proposals from cascades, which all requests share.
///
/// # Errors
/// As [`Cascades::find`], and the reason why there are no cascades.
pub fn propose_from_cascades(
    cascades: &Mutex<Result<Cascades, CascadeError>>,
    frame: &Frame,
) -> Result<Option<ProposedMarks>, String> {
    let mut cascades = cascades.lock().unwrap_or_else(PoisonError::into_inner);
    let found = match cascades.as_mut() {
        Ok(cascades) => cascades.find(frame).map_err(|e| e.to_string())?,
        Err(error) => return Err(error.to_string()),
    };
    let size = frame.size();
    Ok(found
        .map(|mut marks| {
            marks.retain(|m| size.contains(&m.position));
            ProposedMarks { source: ProposalSource::Cascades, marks }
        })
        .filter(|p| !p.marks.is_empty()))
}

/// Proposals from the landmarks of the neutral frame; `None` for a sequence without landmarks.
///
/// # Errors
/// The reason why existing landmarks cannot be used.
pub fn propose_from_landmarks(entry: &SequenceEntry, neutral: u32, tables: &Tables) -> Result<Option<ProposedMarks>, String> {
    let Some(track) = entry.landmarks().map_err(|e| e.to_string())? else { return Ok(None) };
    let points = track.frame(neutral).map_err(|e| e.to_string())?;
    let marks = correspondences_from_landmarks(points, tables, &LandmarkSelection::Default).map_err(|e| e.to_string())?;
    Ok(Some(ProposedMarks { source: ProposalSource::Landmarks, marks }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_cascades_say_how_to_get_them() {
        let folder = tempfile::tempdir().unwrap();
        let error = Cascades::load(Some(folder.path()), &Tables::candide3()).unwrap_err().to_string();
        assert!(error.contains(FACE) && error.contains("apt-get install opencv-data"), "{error}");
        assert!(CascadeError::NotInstalled.to_string().contains("apt-get install opencv-data"));
    }

    #[test]
    fn the_mouth_is_put_on_the_dark_line_between_the_lips() {
        // Eyes 80 px apart, the mouth expected at (100, 140), a dark line of 3 px around y = 148: 8 px, a tenth of 80, further down.
        let image = GrayImage::from_fn(200, 220, |_, y| image::Luma([if (147..150).contains(&y) { 60 } else { 180 }]));
        let eyes = [Point2::new(140.0, 60.0), Point2::new(60.0, 60.0)];
        let offset = lips_offset(&image, eyes, Point2::new(100.0, 140.0)).unwrap();
        assert!(offset.x.abs() < 1e-9 && (offset.y - 8.0).abs() < 1.0, "{offset}");
        // Without a line it keeps its position. Too near to the border: no answer.
        let plain = GrayImage::from_pixel(200, 220, image::Luma([90]));
        assert_eq!(lips_offset(&plain, eyes, Point2::new(100.0, 140.0)), Some(Vector2::zeros()));
        assert_eq!(lips_offset(&plain, eyes, Point2::new(100.0, 210.0)), None);
    }

    #[test]
    fn the_corners_of_the_mouth_are_where_the_line_between_the_lips_leads() {
        // The line goes down by 1 px in 6 towards the right of the image: 24 px from the middle it is 4 px lower.
        let line = |x: u32| 148.0 + (f64::from(x) - 100.0) / 6.0;
        let image =
            GrayImage::from_fn(200, 220, |x, y| image::Luma([if (f64::from(y) - line(x)).abs() < 1.6 { 60 } else { 180 }]));
        let eyes = [Point2::new(140.0, 60.0), Point2::new(60.0, 60.0)];
        let follow = |image: &GrayImage, x: f64, y: f64| follow_lips(image, eyes, Point2::new(100.0, 148.0), Point2::new(x, y));
        let (right, left) = (follow(&image, 124.0, 148.0).unwrap(), follow(&image, 76.0, 148.0).unwrap());
        assert!((right.y - 4.0).abs() < 1.0 && (left.y + 4.0).abs() < 1.0, "{left} {right}");
        assert!(right.x.abs() < 1e-9);
        // Without a line it keeps its position. Beyond the image: no answer.
        let plain = GrayImage::from_pixel(200, 220, image::Luma([90]));
        assert_eq!(follow(&plain, 124.0, 148.0), Some(Vector2::zeros()));
        assert_eq!(follow(&plain, 260.0, 148.0), None);
    }

    #[test]
    fn the_iris_is_the_darkest_spot_beside_the_middle_of_the_eye() {
        // A disc of 7 px around (66, 60); the search covers up to 8 px beside (60, 60).
        let dark = |x: u32, y: u32| (f64::from(x) - 66.0).hypot(f64::from(y) - 60.0) <= 7.0;
        let image = GrayImage::from_fn(200, 120, |x, y| image::Luma([if dark(x, y) { 30 } else { 200 }]));
        assert_eq!(iris(&image, Point2::new(60.0, 60.0), 80.0), Point2::new(66.0, 60.0));
        // At and beyond the border of the image it does not fail.
        assert!(iris(&image, Point2::new(2.0, 119.0), 80.0).x < 20.0);
        iris(&image, Point2::new(-40.0, 500.0), 80.0);
    }

    #[test]
    fn boxes_have_centres_in_the_image() {
        // Columns 10 + 4 .. 10 + 4 + 6: pixels 14 to 19, whose middle is 16.5; rows 20 + 2 to 20 + 4, whose middle is 23.
        assert_eq!(centre([4, 2, 6, 3], [10, 20, 50, 50]), Point2::new(16.5, 23.0));
    }
}
