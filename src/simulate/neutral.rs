//! Neutral faces as points, without a picture: what the evaluation of the fit needs, thousands of times.

use nalgebra::Point2;

use super::{SimulateError, SimulateOptions, expression::Emotion, motion::Course, subject::identity};
use crate::wireframe::Wireframe;

/// Exact image positions (pixels) of all N nodes of subject number `subject` (from 0) in the neutral frame of an emotion's sequence.
///
/// The same positions as those of the first frame of [`super::simulate_sequence`]; nothing is painted or drawn.
///
/// # Errors
/// [`SimulateError`] when the options are out of range.
pub fn neutral_nodes(options: &SimulateOptions, subject: u32, emotion: Emotion) -> Result<Vec<Point2<f64>>, SimulateError> {
    options.check()?;
    let pose = Course::new(options, subject, emotion).pose(0.0);
    Ok(identity(&Wireframe::candide3(), options.seed, subject).iter().map(|node| pose.project(node)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::simulate_sequence;

    #[test]
    fn they_are_the_nodes_of_the_first_frame() {
        let options = SimulateOptions { width: 96, height: 72, frames: 2, ..SimulateOptions::default() };
        let first = simulate_sequence(&options, 3, Emotion::Fear).unwrap().next().unwrap();
        assert_eq!(neutral_nodes(&options, 3, Emotion::Fear).unwrap(), first.nodes);
    }
}
