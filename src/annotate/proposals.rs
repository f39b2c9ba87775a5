//! Marks proposed for a neutral frame: from the dataset's landmarks, else by OpenCV's Haar cascades. They are never saved by
//! themselves; a person accepts or moves them.
//!
//! The cascades find a face, the eyes in its upper half, and the mouth below. Eye and mouth corners are then placed as in the mean of
//! real faces ([`ShapePrior::faces`]) by the similarity that takes its pupils to the centres of the eyes; the mouth moves with the box
//! of the mouth where one was found.

use std::{
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use nalgebra::{Point2, Vector2};
use opencv::{
    core::{Mat, Rect, Size, Vector},
    imgproc::equalize_hist,
    objdetect::CascadeClassifier,
    prelude::*,
};

use crate::{
    dataset::{LandmarkSelection, SequenceEntry, correspondences_from_landmarks},
    fit::{Correspondence, MarkKind, ShapePrior},
    geometry::Similarity,
    sequence::Frame,
    units::NodeId,
    wireframe::Tables,
};

/// Where Debian's package `opencv-data` and OpenCV's own installation put the cascades.
pub const CASCADE_FOLDERS: [&str; 4] = [
    "/usr/share/opencv4/haarcascades",
    "/usr/local/share/opencv4/haarcascades",
    "/usr/share/opencv/haarcascades",
    "/opt/homebrew/share/opencv4/haarcascades",
];

const FACE: &str = "haarcascade_frontalface_alt2.xml";
/// Tried one after the other; the second sees eyes behind glasses.
const EYES: [&str; 2] = ["haarcascade_eye.xml", "haarcascade_eye_tree_eyeglasses.xml"];
const MOUTH: &str = "haarcascade_smile.xml";

/// Outer and inner corner of the left eye, inner and outer corner of the right eye, left and right corner of the mouth.
const PROPOSED: [NodeId; 6] = [NodeId(20), NodeId(23), NodeId(56), NodeId(53), NodeId(31), NodeId(64)];
const MOUTH_CORNERS: [NodeId; 2] = [NodeId(31), NodeId(64)];

/// Share of a face box's height above which eyes are looked for.
const EYE_BAND: f64 = 0.6;

/// Most that a box of a mouth may lie off the expected place, over the eye distance, to be believed.
const MOUTH_TOLERANCE: f64 = 0.25;

/// Steepest line through the eyes, radians, and least and greatest eye distance over the width of the face box, to be believed.
const EYE_LINE: f64 = 0.35;
const EYE_SPAN: (f64, f64) = (0.28, 0.62);

/// Where proposals come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ProposalSource {
    /// Landmarks of the dataset.
    Landmarks,
    /// OpenCV's Haar cascades.
    Cascades,
}

/// Marks proposed for a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct ProposedMarks {
    /// Where they come from.
    pub source: ProposalSource,
    /// The marks.
    pub marks: Vec<Correspondence>,
}

/// Cascades that can not be used.
#[derive(Debug, thiserror::Error)]
pub enum CascadeError {
    /// No folder of cascades.
    #[error("OpenCV's face cascades are not installed; on Debian: apt-get install opencv-data")]
    NotInstalled,
    /// A cascade that is missing or does not load.
    #[error("{}: the cascade does not load; on Debian: apt-get install opencv-data", path.display())]
    DoesNotLoad {
        /// The file.
        path: PathBuf,
    },
    /// OpenCV failed.
    #[error("OpenCV: {0}")]
    OpenCv(#[from] opencv::Error),
}

/// Haar cascades for faces, eyes and mouths.
#[derive(Debug)]
pub struct Cascades {
    face: CascadeClassifier,
    eyes: [CascadeClassifier; 2],
    mouth: CascadeClassifier,
    mean: Vec<Point2<f64>>,
    pupils: [Vec<NodeId>; 2],
}

impl Cascades {
    /// Loads the cascades of a folder; of the first of [`CASCADE_FOLDERS`] that is there if `None`.
    ///
    /// # Errors
    /// [`CascadeError`] when they are not there or do not load.
    pub fn load(folder: Option<&Path>, tables: &Tables) -> Result<Self, CascadeError> {
        let folder = match folder {
            Some(folder) => folder.to_owned(),
            None => {
                let mut folders = CASCADE_FOLDERS.iter().map(PathBuf::from);
                folders.find(|f| f.join(FACE).is_file()).ok_or(CascadeError::NotInstalled)?
            }
        };
        let load = |name: &str| {
            let path = folder.join(name);
            // OpenCV gives an empty classifier for a file that is not there.
            let classifier = CascadeClassifier::new(&path).ok();
            match classifier.map(|c| c.empty().map(|empty| (c, empty))) {
                Some(Ok((classifier, false))) => Ok(classifier),
                _ => Err(CascadeError::DoesNotLoad { path }),
            }
        };
        let pupil = |fp: &str| fp.parse().ok().and_then(|fp| tables.feature_point_nodes(fp)).unwrap_or_default().to_vec();
        Ok(Self {
            face: load(FACE)?,
            eyes: [load(EYES[0])?, load(EYES[1])?],
            mouth: load(MOUTH)?,
            mean: ShapePrior::faces().mean,
            pupils: ["3.5", "3.6"].map(pupil),
        })
    }

    /// Corners of eyes and mouth of the largest face; `None` when no face with two eyes is found.
    ///
    /// # Errors
    /// [`CascadeError::OpenCv`].
    pub fn find(&mut self, frame: &Frame) -> Result<Option<Vec<Correspondence>>, CascadeError> {
        let mut grey = Mat::default();
        equalize_hist(frame.mat(), &mut grey)?;
        let Some(face) = largest(&detect(&mut self.face, &grey, 1.1, 3, 40)?) else { return Ok(None) };
        let Some([left, right]) = self.eye_centres(&grey, face)? else { return Ok(None) };
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
        let expected = corners.iter().map(|&k| places[k].coords).sum::<Vector2<f64>>() / corners.len() as f64;
        let eye_distance = (left - right).norm();
        if let Some(offset) = self.mouth_offset(&grey, face, Point2::from(expected), eye_distance)? {
            corners.iter().for_each(|&k| places[k].y += offset);
        }
        let mark = |(&node, position): (&NodeId, Point2<f64>)| Correspondence { node, position, kind: MarkKind::Mark };
        Ok(Some(PROPOSED.iter().zip(places).map(mark).collect()))
    }

    /// Centres of the subject's left and right eye.
    fn eye_centres(&mut self, grey: &Mat, face: Rect) -> Result<Option<[Point2<f64>; 2]>, CascadeError> {
        let band = Rect::new(face.x, face.y, face.width, (f64::from(face.height) * EYE_BAND) as i32);
        let region = Mat::roi(grey, band)?.try_clone()?;
        for cascade in &mut self.eyes {
            let boxes = detect(cascade, &region, 1.05, 3, face.width / 8)?;
            let centres: Vec<_> = boxes.iter().map(|b| centre(*b, band)).collect();
            let middle = f64::from(face.x) + f64::from(face.width) / 2.0;
            let mut best: Option<(f64, [Point2<f64>; 2])> = None;
            // The subject's left eye is on the right of the image.
            for (l, left) in centres.iter().enumerate().filter(|(_, p)| p.x > middle) {
                for (r, right) in centres.iter().enumerate().filter(|(_, p)| p.x <= middle) {
                    let span = (left - right).norm() / f64::from(face.width);
                    let slope = ((left.y - right.y) / (left.x - right.x)).atan().abs();
                    if slope > EYE_LINE || span < EYE_SPAN.0 || span > EYE_SPAN.1 {
                        continue;
                    }
                    let size = |k: usize| f64::from(boxes[k].width);
                    let misfit = slope
                        + (size(l) / size(r)).ln().abs()
                        + ((left.x + right.x) / 2.0 - middle).abs() / f64::from(face.width);
                    if best.is_none_or(|(least, _)| misfit < least) {
                        best = Some((misfit, [*left, *right]));
                    }
                }
            }
            if let Some((_, eyes)) = best {
                return Ok(Some(eyes));
            }
        }
        Ok(None)
    }

    /// How far below its expected place a mouth was found, px; `None` when none was found near it.
    fn mouth_offset(
        &mut self,
        grey: &Mat,
        face: Rect,
        expected: Point2<f64>,
        eye_distance: f64,
    ) -> Result<Option<f64>, CascadeError> {
        let top = face.y + face.height / 2;
        let bottom = (face.y + face.height + face.height / 6).min(grey.rows());
        if bottom - top < 20 {
            return Ok(None);
        }
        let band = Rect::new(face.x, top, face.width, bottom - top);
        let region = Mat::roi(grey, band)?.try_clone()?;
        let boxes = detect(&mut self.mouth, &region, 1.1, 8, face.width / 4)?;
        let offsets = boxes.iter().map(|b| centre(*b, band) - expected);
        let near = offsets.filter(|d| d.norm() < MOUTH_TOLERANCE * eye_distance).min_by(|a, b| a.norm().total_cmp(&b.norm()));
        Ok(near.map(|d| d.y))
    }
}

fn detect(
    cascade: &mut CascadeClassifier,
    image: &Mat,
    scale: f64,
    neighbours: i32,
    least: i32,
) -> Result<Vec<Rect>, CascadeError> {
    let mut found = Vector::<Rect>::new();
    let least = Size::new(least.max(8), least.max(4) / 2);
    cascade.detect_multi_scale(image, &mut found, scale, neighbours, 0, least, Size::new(0, 0))?;
    Ok(found.to_vec())
}

fn largest(boxes: &[Rect]) -> Option<Rect> {
    boxes.iter().copied().max_by_key(|b| (b.width, std::cmp::Reverse((b.y, b.x))))
}

/// Middle of a box found within another, px of the image.
fn centre(found: Rect, within: Rect) -> Point2<f64> {
    Point2::new(
        f64::from(within.x + found.x) + f64::from(found.width - 1) / 2.0,
        f64::from(within.y + found.y) + f64::from(found.height - 1) / 2.0,
    )
}

/// Proposals of cascades shared by all requests.
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

/// Proposals from the landmarks of the neutral frame; `None` for a sequence without.
///
/// # Errors
/// The reason why there are landmarks that do not serve.
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
    fn boxes_have_centres_in_the_image() {
        // Columns 10 + 4 .. 10 + 4 + 6: pixels 14 to 19, whose middle is 16.5; rows 20 + 2 to 20 + 4, whose middle is 23.
        assert_eq!(centre(Rect::new(4, 2, 6, 3), Rect::new(10, 20, 50, 50)), Point2::new(16.5, 23.0));
        assert_eq!(largest(&[Rect::new(0, 0, 5, 5), Rect::new(9, 9, 7, 7)]), Some(Rect::new(9, 9, 7, 7)));
        assert_eq!(largest(&[]), None);
    }
}
