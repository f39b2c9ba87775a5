//! Marks found in the neutral frame: proposed to the user, or accepted without a review if they are accurate enough.

use image::RgbImage;
use rayon::prelude::*;

use super::{ProposalSource, ProposedMarks, desk::Desk};
use crate::{
    fit::Correspondence,
    locate::FacePart,
    pipeline::{FoundFace, found_face},
    sequence::{Frame, read_first_in_colour},
    units::SequenceId,
};

/// Proposals from the face found in a frame, and a note if it is not trusted; `None` without a face. `colour` is the same frame in colour,
/// if available.
///
/// # Errors
/// The error of the locator's model.
pub fn propose_from_face(frame: &Frame, colour: Option<&RgbImage>) -> Result<Option<(ProposedMarks, Option<String>)>, String> {
    let Some(face) = found_face(frame, colour).map_err(|e| e.to_string())? else { return Ok(None) };
    let covered = covered(&face);
    let FoundFace { marks, expected_error, trusted, .. } = face;
    let note = (!trusted).then(|| {
        format!(
            "the points of this face are uncertain: their median expected error is {:.0} % of the eye distance",
            100.0 * expected_error
        )
    });
    let note = note.or(covered);
    Ok(Some((ProposedMarks { source: ProposalSource::Found, marks }, note)))
}

/// Message that parts of a face are covered and the user has to mark them.
fn covered(face: &FoundFace) -> Option<String> {
    let parts = FacePart::listed(&face.covered);
    (!face.covered.is_empty())
        .then(|| format!("probably covered: {parts}; the points there are estimated from the rest of the face"))
}

/// Result of [`Annotator::accept`](super::Annotator::accept).
#[derive(Clone, Debug, Default)]
pub struct Accepted {
    /// Sequences whose found marks were saved.
    pub accepted: Vec<SequenceId>,
    /// Sequences to review, each with the reason.
    pub left: Vec<(SequenceId, String)>,
}

impl Desk {
    /// Saves the marks found in every sequence that has none, if their median expected error is below `limit` percent of the eye distance.
    /// Single marks with more than three times that are left out. Hand-set marks always have precedence. If there are several faces, the
    /// user has to choose.
    pub fn accept(&self, limit: f64, progress: impl Fn(usize, usize) + Sync) -> Accepted {
        let (open, left) = self.unmarked();
        let done = std::sync::atomic::AtomicUsize::new(0);
        let found: Vec<(SequenceId, Result<Vec<Correspondence>, String>)> = open
            .par_iter()
            .map(|id| {
                let marks = self.sure_marks(id, limit);
                progress(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1, open.len());
                (id.clone(), marks)
            })
            .collect();
        let mut outcome = Accepted::default();
        for (id, marks) in found {
            match marks {
                Ok(marks) => match self.save_found(&id, &marks) {
                    Ok(true) => outcome.accepted.push(id),
                    Ok(false) => outcome.left.push((id, "it was marked in the meantime".to_owned())),
                    Err(error) => outcome.left.push((id, error.to_string())),
                },
                Err(reason) => outcome.left.push((id, reason)),
            }
        }
        outcome.left.extend(left);
        outcome
    }

    fn sure_marks(&self, id: &SequenceId, limit: f64) -> Result<Vec<Correspondence>, String> {
        let frames = self.neutral_frames(id).map_err(|e| e.to_string())?;
        let (frame, colour) = read_first_in_colour(&frames).map_err(|e| e.to_string())?;
        let face = found_face(&frame, colour.as_ref()).map_err(|e| e.to_string())?.ok_or("no face was found")?;
        let percent = 100.0 * face.expected_error;
        if !face.trusted || percent >= limit {
            return Err(format!("the median expected error of the points is {percent:.1} % of the eye distance"));
        }
        if let Some(remark) = covered(&face).or_else(|| face.of_several()) {
            return Err(remark);
        }
        let most = 3.0 * limit / 100.0 * face.eye_distance;
        let sure: Vec<Correspondence> = face.marks.into_iter().filter(|m| m.expected_error.is_some_and(|e| e <= most)).collect();
        self.bench.fitter().fit(&self.bench.wireframe, &sure).map_err(|e| e.to_string())?;
        Ok(sure)
    }
}
