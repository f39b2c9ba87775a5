//! Marks of the neutral frame for studies through images.

use image::{DynamicImage, RgbImage};
use nalgebra::Point2;

use super::{EvaluateError, pose::failed};
use crate::simulate::landmark_points;
use grimace::internal::{
    dataset::{LandmarkSelection, correspondences_from_landmarks},
    fit::Correspondence,
    pipeline::{SequenceFailure, Workbench, found_marks},
    report::Stage,
    sequence::Frame,
};

/// Returns the marks of a rendered neutral face.
///
/// The marks lie at the exact positions of the chosen nodes (`nodes` holds the positions of all nodes, px). With
/// [`LandmarkSelection::Auto`] they are found in the picture, as in `run`.
///
/// # Errors
/// [`EvaluateError`] when a chosen node has no landmark, or no face is found.
pub(super) fn marks_of_picture(
    nodes: &[Point2<f64>],
    image: RgbImage,
    which: &LandmarkSelection,
    bench: &Workbench,
) -> Result<Vec<Correspondence>, EvaluateError> {
    if *which == LandmarkSelection::Auto {
        let frame = Frame::new(1, DynamicImage::ImageRgb8(image).into_luma8());
        return found_marks(&frame, bench).map_err(|e| failed(&SequenceFailure::at(Stage::Fit)(e)));
    }
    let points = landmark_points(nodes, &bench.tables.landmarks);
    let marks = correspondences_from_landmarks(&points, &bench.tables, which)?;
    Ok(marks.into_iter().map(|mark| Correspondence::mark(mark.node, mark.position)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{Emotion, SimulateOptions, SimulatedSequence, Subject};
    use grimace::internal::{dataset::DEFAULT_LANDMARK_NODES, pipeline::PipelineOptions};

    #[test]
    fn marks_lie_on_their_nodes_and_found_ones_near_them() {
        let bench = Workbench::new(None, PipelineOptions::default()).unwrap();
        let simulated = SimulateOptions::default();
        let subject = Subject::new(&simulated, 0).unwrap();
        let sequence = SimulatedSequence::new(&subject, Emotion::Happiness, &simulated).unwrap();
        let nodes = sequence.nodes(0);
        let marks = |which: &LandmarkSelection| marks_of_picture(&nodes, sequence.image(0), which, &bench).unwrap();
        let off = |mark: &Correspondence| (mark.position - nodes[mark.node.index()]).norm();

        let eleven = marks(&LandmarkSelection::Default);
        assert_eq!(eleven.len(), DEFAULT_LANDMARK_NODES.len());
        assert!(eleven.iter().all(|mark| off(mark) < 1e-9 && mark.expected_error.is_none()));
        let chosen: Vec<usize> = marks(&"20,53,10".parse().unwrap()).iter().map(|mark| mark.node.index()).collect();
        assert_eq!(chosen, [20, 53, 10]);
        assert!(marks(&LandmarkSelection::HighAndMedium).len() > 40);

        let found = marks(&LandmarkSelection::Auto);
        assert!(found.len() > 40 && found.iter().all(|mark| mark.expected_error.is_some()));
        let mut errors: Vec<f64> = found.iter().map(off).collect();
        errors.sort_by(f64::total_cmp);
        let median = errors[errors.len() / 2];
        assert!(median > 0.1 && median < 8.0, "half of the found marks are more than {median} px off");
    }
}
