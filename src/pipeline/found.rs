//! Finds marks in the neutral frame when there are no hand-set marks.

use std::collections::BTreeSet;

use image::RgbImage;
use nalgebra::{Point2, Vector2};

use super::Workbench;
use crate::{
    fit::{Correspondence, validate_correspondences},
    locate::{FacePart, LocateOptions, LocatedFace, Locator, LocatorError, TRUSTED},
    sequence::{Frame, ImageSize, SequenceError},
    units::NodeId,
};

/// Nodes that are tried when the fit to all found nodes fails: corners and lids of the eyes, brows, nose, lips, chin and jaw, without the
/// closest ones.
const FEWER: [u16; 33] = [
    20, 23, 53, 56, 21, 22, 54, 55, 15, 16, 17, 48, 49, 50, 5, 6, 26, 59, 31, 64, 7, 33, 66, 8, 85, 86, 87, 10, 9, 30, 63, 32, 65,
];

/// Nodes that are tried last: corners of eyes and mouth, brows and chin.
const FEWEST: [u16; 13] = [20, 23, 53, 56, 31, 64, 10, 15, 16, 17, 48, 49, 50];

/// Why no marks were found.
#[derive(Debug, thiserror::Error)]
pub enum FoundMarksError {
    /// No face was found.
    #[error(
        "there are no hand-set marks, and no face was found in the neutral frame; if it shows a face, mark it with `grimace annotate`"
    )]
    NoFace,
    /// A face whose points have large expected errors.
    #[error(
        "there are no hand-set marks, and the found marks are not trusted: their median expected error is {percent:.1} % of the eye \
         distance, above the limit of {:.1} %{}; view them with `grimace locate --overlay`, and mark the face with `grimace annotate`", 100.0 * TRUSTED, covered_too(.covered)
    )]
    NotTrusted {
        /// Median expected error, percent of the eye distance.
        percent: f64,
        /// Covered parts.
        covered: Vec<FacePart>,
    },
    /// A face that is upside down.
    #[error(
        "there are no hand-set marks, and the found face is upside down (turned by {degrees:.0} degrees): turn the picture upright"
    )]
    UpsideDown {
        /// Angle between the face's down and the picture's, up to 180 degrees.
        degrees: f64,
    },
    /// The pixels cannot be read.
    #[error(transparent)]
    Frame(#[from] SequenceError),
    /// The model of the locator cannot be read.
    #[error(transparent)]
    Model(#[from] LocatorError),
}

/// A detected face as marks.
#[derive(Clone, Debug)]
pub struct FoundFace {
    /// Its points inside the picture, each with its expected error.
    pub marks: Vec<Correspondence>,
    /// Median expected error, in eye distances.
    pub expected_error: f64,
    /// Eye distance, px.
    pub eye_distance: f64,
    /// Whether the marks may be used without a review ([`LocatedFace::trusted`]).
    pub trusted: bool,
    /// Number of other trusted faces in the picture.
    pub others: usize,
    /// Covered parts: their marks are guesses from the rest of the face, with correspondingly large expected errors.
    pub covered: Vec<FacePart>,
}

impl FoundFace {
    /// Note to the user about other faces in the picture, or about covered parts.
    pub fn remark(&self) -> Option<String> {
        let several = self.chosen_of_several("the largest is used", "to use another face, mark it with `grimace annotate`");
        let said: Vec<String> = several.into_iter().chain(covered_said(&self.covered)).collect();
        (!said.is_empty()).then(|| said.join("; "))
    }

    /// Message that the user has to choose one of several faces; `None` for a single face.
    pub(crate) fn of_several(&self) -> Option<String> {
        self.chosen_of_several("the largest is proposed", "mark the face that you want")
    }

    /// Message that there are several faces, naming the one that was `taken` and how to choose another; `None` for a single face.
    pub(super) fn chosen_of_several(&self, taken: &str, another: &str) -> Option<String> {
        let middle = self.middle();
        (self.others > 0).then(|| {
            format!(
                "found {} faces; {taken} (eyes {:.0} px apart, near ({:.0}, {:.0})); {another}",
                self.others + 1,
                self.eye_distance,
                middle.x,
                middle.y
            )
        })
    }

    /// Rotation of an upside-down face (mouth above the eyes) in degrees; `None` for others.
    fn upside_down(&self) -> Option<f64> {
        /// Smallest rotation reported, degrees. The fit accepts faces that lie on their side.
        const LEAST: f64 = 120.0;
        let at = |node: u16| Some(self.marks.iter().find(|mark| mark.node.0 == node)?.position.coords);
        // Outer corners of the eyes, and corners of the mouth.
        let down = at(31)? + at(64)? - at(20)? - at(53)?;
        let degrees = down.x.atan2(down.y).abs().to_degrees();
        (degrees > LEAST).then_some(degrees)
    }

    /// Centroid of its marks.
    pub(super) fn middle(&self) -> Point2<f64> {
        middle_of(&self.marks)
    }
}

/// Message that parts of an untrusted face are covered, above a limit.
fn covered_too(parts: &[FacePart]) -> String {
    FacePart::said_covered(parts).map(|said| format!(", and {said}")).unwrap_or_default()
}

/// Message that parts of a face are covered where marks were found; `None` if none is.
pub(crate) fn covered_said(parts: &[FacePart]) -> Option<String> {
    let (their, them) = if parts.len() == 1 { ("its", "it") } else { ("their", "them") };
    FacePart::said_covered(parts).map(|said| {
        format!(
            "{said} in the neutral frame: {their} marks are estimated from the rest of the face; mark {them} with `grimace annotate` if \
             you can see more"
        )
    })
}

/// Centroid of marks.
pub(super) fn middle_of(marks: &[Correspondence]) -> Point2<f64> {
    let sum = marks.iter().map(|m| m.position.coords).sum::<Vector2<f64>>();
    Point2::from(sum / marks.len().max(1) as f64)
}

/// Finds the largest face of a frame, `None` if there is none. `colour` is the same frame in colour, if available.
///
/// # Errors
/// [`FoundMarksError::Model`].
pub fn found_face(frame: &Frame, colour: Option<&RgbImage>) -> Result<Option<FoundFace>, FoundMarksError> {
    Ok(found_faces(frame, colour)?.into_iter().next())
}

/// Finds the faces of a frame, the largest first. With `colour`, the lower lip is distinguished from teeth
/// ([`LocatedFace::look_for_teeth`]).
///
/// # Errors
/// [`FoundMarksError::Model`].
pub(super) fn found_faces(frame: &Frame, colour: Option<&RgbImage>) -> Result<Vec<FoundFace>, FoundMarksError> {
    let size = frame.size();
    let mut faces = Locator::shipped()?.locate(frame.image(), &LocateOptions::default());
    if let Some(picture) = colour {
        faces.iter_mut().for_each(|face| _ = face.look_for_teeth(picture));
    }
    let all_trusted = faces.iter().filter(|face| face.trusted()).count();
    let found = |face: &LocatedFace| FoundFace {
        marks: marks_of(face, |p| size.contains(p)),
        expected_error: face.expected_error(),
        eye_distance: face.eye_distance,
        trusted: face.trusted(),
        others: all_trusted - usize::from(face.trusted()),
        covered: face.covered.clone(),
    };
    Ok(faces.iter().map(found).collect())
}

/// Finds the marks of the largest face of a frame. Marks outside the picture are left out, and as many are kept as can be fitted.
///
/// # Errors
/// `FoundMarksError` where there is no face, or none that is trusted ([`LocatedFace::trusted`]).
pub fn found_marks(frame: &Frame, bench: &Workbench) -> Result<Vec<Correspondence>, FoundMarksError> {
    found_marks_and_remark(frame, None, bench).map(|found| found.marks)
}

/// Marks found in a frame.
#[derive(Clone, Debug, Default)]
pub struct FoundMarks {
    /// The marks.
    pub marks: Vec<Correspondence>,
    /// Note to the user about the marks.
    pub remark: Option<String>,
    /// Covered parts of the face, whose marks are guesses.
    pub covered: Vec<FacePart>,
    /// Median expected error of the found points, in eye distances; `None` for given marks.
    pub expected_error: Option<f64>,
}

/// As [`found_marks`]. Also returns a note if the frame shows several faces or a partly covered one. `colour` is the same picture in
/// colour, in which teeth are distinguished from a lower lip.
///
/// # Errors
/// As [`found_marks`].
pub fn found_marks_and_remark(
    frame: &Frame,
    colour: Option<&RgbImage>,
    bench: &Workbench,
) -> Result<FoundMarks, FoundMarksError> {
    let face = found_faces(frame, colour)?.into_iter().next().ok_or(FoundMarksError::NoFace)?;
    if let Some(degrees) = face.upside_down() {
        return Err(FoundMarksError::UpsideDown { degrees });
    }
    if !face.trusted {
        return Err(FoundMarksError::NotTrusted { percent: 100.0 * face.expected_error, covered: face.covered });
    }
    Ok(FoundMarks {
        marks: fitting_marks(&face, frame.size(), bench),
        remark: face.remark(),
        expected_error: Some(face.expected_error),
        covered: face.covered,
    })
}

/// As many marks of a face as can be fitted; all of them if no subset can, so that the fit reports the reason.
pub(super) fn fitting_marks(face: &FoundFace, size: ImageSize, bench: &Workbench) -> Vec<Correspondence> {
    let all = &face.marks;
    let only = |nodes: &[u16]| -> Vec<Correspondence> {
        let nodes: BTreeSet<NodeId> = nodes.iter().map(|&n| NodeId(n)).collect();
        all.iter().filter(|m| nodes.contains(&m.node)).copied().collect()
    };
    let fits = |marks: &[Correspondence]| {
        validate_correspondences(marks, size.width, size.height).is_ok() && bench.fitter.fit(&bench.wireframe, marks).is_ok()
    };
    let tried = [only(&FEWER), only(&FEWEST)];
    if fits(all) {
        return all.clone();
    }
    tried.iter().find(|marks| fits(marks)).unwrap_or(all).clone()
}

fn marks_of(face: &LocatedFace, inside: impl Fn(&Point2<f64>) -> bool) -> Vec<Correspondence> {
    let points = face.points.iter().filter(|p| inside(&p.position));
    points.map(|p| Correspondence::found(p.node, p.position, p.expected_error)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_face_on_its_head_is_known() {
        let face = |turn: f64| {
            let at = |(node, x, y): (u16, f64, f64)| {
                let (sin, cos) = turn.to_radians().sin_cos();
                Correspondence::found(NodeId(node), Point2::new(100.0 + cos * x - sin * y, 100.0 + sin * x + cos * y), 1.0)
            };
            let marks = [(53, -40.0, 0.0), (20, 40.0, 0.0), (64, -20.0, 60.0), (31, 20.0, 60.0)].map(at).to_vec();
            FoundFace { marks, expected_error: 0.01, eye_distance: 60.0, trusted: true, others: 0, covered: Vec::new() }
        };
        assert_eq!([0.0, 25.0, -90.0, 110.0].map(|turn| face(turn).upside_down()), [None; 4]);
        for turn in [180.0, 150.0, -170.0] {
            let found = face(turn).upside_down().unwrap();
            assert!((found - f64::abs(turn)).abs() < 1e-9, "{found}");
        }
    }

    #[test]
    fn an_upside_down_portrait_is_reported() {
        let portrait = crate::sequence::read_frame("fixtures/portraits/P01.jpg".as_ref()).unwrap();
        let bench = Workbench::new(None, crate::pipeline::PipelineOptions::default()).unwrap();
        let (width, height) = portrait.image().dimensions();
        let small = image::imageops::resize(portrait.image(), width / 2, height / 2, image::imageops::FilterType::Triangle);
        let turned = Frame::new(0, image::imageops::rotate180(&small));
        let said = found_marks(&turned, &bench).unwrap_err().to_string();
        assert!(
            said.contains("the found face is upside down (turned by 1") && said.ends_with("turn the picture upright"),
            "{said}"
        );
    }
}
