//! Single FAPs on a bank: what each asks of the feature points, and whether a mixture of the bank's members shows it.

use std::path::Path;

use nalgebra::{Vector2, Vector3};

use super::{bank_face::BankFace, read::fap_motion};
use crate::{
    fap::{FapCatalog, FapFrame, FapNumber, FapSequence, offsets_from_frame},
    synthesis::{Bank, FpMotion, Solver, SynthesisError, SynthesisOptions, Synthesizer},
};

/// Share of a FAP's motion from which the mixture of members that comes closest to it counts as that FAP.
const LEAST_SHOWN: f64 = 0.25;
/// Value by which a FAP is tried. All is linear, so any one would do.
const PROBE: f64 = 100.0;

/// What single FAPs ask of the feature points of a bank.
#[derive(Debug)]
pub(crate) struct SingleFaps {
    /// For each feature point whether any FAP moves its x and its y.
    pub drivable: Vec<[bool; 2]>,
    /// The FAPs that move a feature point, in ascending order.
    pub faps: Vec<SingleFap>,
}

/// What a FAP asks of the feature points of a bank.
#[derive(Debug)]
pub(crate) struct SingleFap {
    /// The FAP.
    pub number: FapNumber,
    /// The FAP of the other contour of the lips with the same motion, which follows where it is not set.
    pub twin: Option<FapNumber>,
    /// Feature points that move, and their offsets at a value of 1, the bank's unit.
    pub points: Vec<(usize, [f64; 2])>,
    /// Feature points that it may take along.
    pub near: Vec<usize>,
    /// Whether a mixture of members shows the FAP alone, on its side of the face, for values below and above 0.
    pub shows: [bool; 2],
}

impl SingleFaps {
    /// Tries all FAPs on a bank.
    ///
    /// # Errors
    /// [`SynthesisError::Scale`] for a bank without the feature points that its size is measured on.
    pub(crate) fn new(bank: &Bank) -> Result<Self, SynthesisError> {
        let face = BankFace::new(bank, None)?;
        let options =
            SynthesisOptions { solver: Solver::Nnls, bound_starts: 0, smoothing_frames: 0.0, ..SynthesisOptions::default() };
        let synthesizer = Synthesizer::new(bank, options)?;
        let catalog = FapCatalog::mpeg4();
        let measured = || FapNumber::low_level().filter(|&fap| catalog.row(fap).frontal.is_measured());
        let mut drivable = vec![[false; 2]; bank.feature_points().len()];
        let mut faps = Vec::new();
        for number in measured() {
            let points = asked(number, &face)?;
            if points.is_empty() {
                continue;
            }
            for (point, [x, y]) in &points {
                drivable[*point][0] |= *x != 0.0;
                drivable[*point][1] |= *y != 0.0;
            }
            let is_one = |&(inner, outer): &(FapNumber, FapNumber)| match number {
                n if n == inner => Some(outer),
                n if n == outer => Some(inner),
                _ => None,
            };
            let mut shows = [false; 2];
            for (shows, value) in shows.iter_mut().zip([-PROBE, PROBE]) {
                *shows = pose(number, value, &face)?.is_some_and(|pose| {
                    let answer = synthesizer.solve(&pose, 0);
                    let is_shown = answer.shown.is_some_and(|shown| shown >= LEAST_SHOWN);
                    is_shown && !synthesizer.answers_in_the_mirror(&[answer], &[pose])
                });
            }
            let moving: Vec<usize> = points.iter().map(|p| p.0).collect();
            faps.push(SingleFap {
                number,
                twin: catalog.lip_twins().iter().find_map(is_one),
                near: synthesizer.near_points(&moving),
                points,
                shows,
            });
        }
        Ok(Self { drivable, faps })
    }
}

/// Feature points that a FAP moves, and their offsets at a value of 1.
fn asked(number: FapNumber, face: &BankFace<'_>) -> Result<Vec<(usize, [f64; 2])>, SynthesisError> {
    let mut frame = FapFrame::default();
    frame.set_value(number, Some(PROBE));
    let offsets = offsets_from_frame(&frame, &face.canonical.fapus, FapCatalog::mpeg4())?;
    let moved = face.frame(|node| offsets.get(&node).map(|o| Vector2::new(o.x.unwrap_or(0.0), o.y.unwrap_or(0.0))));
    let per_unit = |(point, offset): (usize, &Option<Vector3<f64>>)| {
        let [x, y] = offset.map(|o| [o.x / PROBE, o.y / PROBE])?;
        (x != 0.0 || y != 0.0).then_some((point, [x, y]))
    };
    Ok(moved.offsets.iter().enumerate().filter_map(per_unit).collect())
}

/// The pose of a file that sets one FAP.
fn pose(number: FapNumber, value: f64, face: &BankFace<'_>) -> Result<Option<FpMotion>, SynthesisError> {
    let mut frame = FapFrame::default();
    frame.set_value(number, Some(value));
    let name = format!("FAP {number}");
    let sequence = FapSequence { version: "2.1".to_owned(), name: name.clone(), fps: 25.0, frames: vec![frame] };
    Ok(fap_motion(sequence, face, Path::new(&name))?.frames.pop())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthesis::EmbeddedBank;

    #[test]
    fn shapes_of_one_side_show_faps_of_one_side_and_members_of_both_do_not() {
        let head = EmbeddedBank::Head;
        // The left upper lid, the left inner brow, the left corner of the mouth, and the jaw.
        for (bank, expected) in [(head.shapes().unwrap(), [true; 4]), (head.bank().unwrap(), [false, false, false, true])] {
            let single = SingleFaps::new(&bank).unwrap();
            let shows = [19, 31, 59, 3].map(|fap: u8| single.faps.iter().find(|f| f.number.get() == fap).unwrap().shows[1]);
            assert_eq!(shows, expected);
        }
        let single = SingleFaps::new(&head.shapes().unwrap()).unwrap();
        let jaw = single.faps.iter().find(|f| f.number.get() == 3).unwrap();
        // The jaw drops the chin along y, and has no twin; inner corners of the lips have outer ones.
        assert!(jaw.twin.is_none() && jaw.points.iter().all(|(_, [x, y])| *x == 0.0 && *y < 0.0));
        assert_eq!(single.faps.iter().find(|f| f.number.get() == 12).unwrap().twin.map(FapNumber::get), Some(59));
    }
}
