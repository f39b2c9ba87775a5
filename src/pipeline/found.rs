//! Marks that nobody set: found in the neutral frame.

use std::collections::BTreeSet;

use nalgebra::{Point2, Vector2};

use super::Workbench;
use crate::{
    fit::{Correspondence, validate_correspondences},
    locate::{LocateOptions, LocatedFace, Locator, ModelError, TRUSTED},
    sequence::{Frame, ImageSize, SequenceError},
    units::NodeId,
};

/// Nodes that are tried when all that were found make no fit: corners and lids of the eyes, brows, nose, lips, chin and jaw, without what
/// lies closest together.
const FEWER: [u16; 33] = [
    20, 23, 53, 56, 21, 22, 54, 55, 15, 16, 17, 48, 49, 50, 5, 6, 26, 59, 31, 64, 7, 33, 66, 8, 85, 86, 87, 10, 9, 30, 63, 32, 65,
];

/// Nodes that are tried last: corners of eyes and mouth, brows and the chin.
const FEWEST: [u16; 13] = [20, 23, 53, 56, 31, 64, 10, 15, 16, 17, 48, 49, 50];

/// Why no marks were found.
#[derive(Debug, thiserror::Error)]
pub enum FoundMarksError {
    /// No face.
    #[error("no marks are set and no face was found in the neutral frame; if there is one, mark it with `grimace annotate`")]
    NoFace,
    /// A face that is read with large errors.
    #[error(
        "no marks are set, and those found are not trusted: half of them are expected to be more than {percent:.1} % of the eye distance \
         off, {:.1} % is the limit; look at them with `grimace locate --overlay`, mark the face with `grimace annotate`", 100.0 * TRUSTED
    )]
    NotTrusted {
        /// Median expected error, percent of the eye distance.
        percent: f64,
    },
    /// The pixels.
    #[error(transparent)]
    Frame(#[from] SequenceError),
    /// The model.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// A face of a frame, as marks.
#[derive(Clone, Debug)]
pub struct FoundFace {
    /// Its points inside the picture, each with its expected error.
    pub marks: Vec<Correspondence>,
    /// Median expected error over the eye distance.
    pub expected_error: f64,
    /// Eye distance, px.
    pub eye_distance: f64,
    /// Whether they may be used without a look ([`LocatedFace::trusted`]).
    pub trusted: bool,
    /// Further faces of the picture that could be the one that is meant: trusted ones.
    pub others: usize,
}

impl FoundFace {
    /// What a person should know who meant another face of the picture.
    pub fn remark(&self) -> Option<String> {
        self.chosen_of_several("the largest was taken", "another one is taken where `grimace annotate` marks it")
    }

    /// That a person has to say which of several faces is meant; `None` where there is one.
    pub(crate) fn of_several(&self) -> Option<String> {
        self.chosen_of_several("the largest is proposed", "mark the one that is meant")
    }

    /// That there are several faces, which one was `taken`, and how another one is; `None` where there is one.
    pub(super) fn chosen_of_several(&self, taken: &str, another: &str) -> Option<String> {
        let middle = self.middle();
        (self.others > 0).then(|| {
            format!(
                "{} faces were found, and {taken}, whose eyes are {:.0} px apart, near ({:.0}, {:.0}); {another}",
                self.others + 1,
                self.eye_distance,
                middle.x,
                middle.y
            )
        })
    }

    /// The middle of its marks.
    pub(super) fn middle(&self) -> Point2<f64> {
        middle_of(&self.marks)
    }
}

/// The middle of marks.
pub(super) fn middle_of(marks: &[Correspondence]) -> Point2<f64> {
    let sum = marks.iter().map(|m| m.position.coords).sum::<Vector2<f64>>();
    Point2::from(sum / marks.len().max(1) as f64)
}

/// Finds the largest face of a frame; `None` where there is none.
///
/// # Errors
/// [`FoundMarksError::Model`].
pub fn found_face(frame: &Frame) -> Result<Option<FoundFace>, FoundMarksError> {
    Ok(found_faces(frame)?.into_iter().next())
}

/// Finds the faces of a frame, the largest first.
///
/// # Errors
/// [`FoundMarksError::Model`].
pub(super) fn found_faces(frame: &Frame) -> Result<Vec<FoundFace>, FoundMarksError> {
    let size = frame.size();
    let faces = Locator::shipped()?.locate(frame.image(), &LocateOptions::default());
    let all_trusted = faces.iter().filter(|face| face.trusted()).count();
    let found = |face: &LocatedFace| FoundFace {
        marks: marks_of(face, |p| size.contains(p)),
        expected_error: face.expected_error(),
        eye_distance: face.eye_distance,
        trusted: face.trusted(),
        others: all_trusted - usize::from(face.trusted()),
    };
    Ok(faces.iter().map(found).collect())
}

/// Finds the marks of the largest face of a frame, those outside the picture left out; so many of them as make a fit.
///
/// # Errors
/// `FoundMarksError` where there is no face, or none that is trusted ([`LocatedFace::trusted`]).
pub fn found_marks(frame: &Frame, bench: &Workbench) -> Result<Vec<Correspondence>, FoundMarksError> {
    found_marks_and_remark(frame, bench).map(|found| found.0)
}

/// [`found_marks`], and what is to be said where the frame shows more than one face.
///
/// # Errors
/// As [`found_marks`].
pub fn found_marks_and_remark(
    frame: &Frame,
    bench: &Workbench,
) -> Result<(Vec<Correspondence>, Option<String>), FoundMarksError> {
    let face = found_face(frame)?.ok_or(FoundMarksError::NoFace)?;
    if !face.trusted {
        return Err(FoundMarksError::NotTrusted { percent: 100.0 * face.expected_error });
    }
    Ok((fitting_marks(&face, frame.size(), bench), face.remark()))
}

/// So many of the marks of a face as make a fit; all of them where none do, so that the fit says why.
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
