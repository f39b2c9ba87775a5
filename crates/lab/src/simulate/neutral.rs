//! Positions of simulated faces without pictures, for studies of the fit that need thousands of faces.

use nalgebra::{Point2, Vector3};

use super::{Emotion, SimulateError, SimulateOptions, motion::Course, subject::identity};
use grimace::internal::wireframe::{ExpressionUnit, Fapus, Tables, Wireframe, expressions, find_unit, keep_lips_apart};

/// Returns the exact image positions (pixels) of all N nodes of subject `subject` (from 0) in the neutral frame of an emotion's sequence.
///
/// The positions equal those of the first frame of [`super::simulate_sequence`], but nothing is painted or drawn.
///
/// # Errors
/// [`SimulateError`] when the options are out of range.
pub fn neutral_nodes(options: &SimulateOptions, subject: u32, emotion: Emotion) -> Result<Vec<Point2<f64>>, SimulateError> {
    options.check()?;
    let pose = Course::new(options, subject, emotion).pose(0.0);
    Ok(identity(&Wireframe::candide3(), options.seed, subject).iter().map(|node| pose.project(node)).collect())
}

/// Positions of all nodes.
type Nodes = Vec<Point2<f64>>;

/// The units of an emotion that are performed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnitScope {
    /// All units: FAPs, and action unit vectors, whose lengths are the same for everybody.
    All,
    /// FAPs only, whose lengths are in the person's own FAPUs.
    Faps,
}

impl UnitScope {
    /// Returns the name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "action units and FAPs",
            Self::Faps => "FAPs",
        }
    }
}

/// Returns the exact image positions (pixels) of all nodes of a subject, neutral and at the apex of an emotion.
///
/// The weights are those of [`expressions`] without random factors, so that the units and weights are the same for every subject.
///
/// # Errors
/// [`SimulateError`] when the options are out of range or the face has no FAPUs.
pub fn performed_nodes(
    options: &SimulateOptions,
    subject: u32,
    emotion: Emotion,
    scope: UnitScope,
) -> Result<(Nodes, Nodes), SimulateError> {
    options.check()?;
    let wireframe = Wireframe::candide3();
    let neutral = identity(&wireframe, options.seed, subject);
    let frontal: Vec<Point2<f64>> = neutral.iter().map(nalgebra::OPoint::xy).collect();
    let fapus = Fapus::measure(&Tables::candide3().fapus, &frontal)?;
    let mut offsets = vec![Vector3::zeros(); wireframe.node_count()];
    for row in expressions().iter().filter(|r| r.emotion == emotion) {
        if scope == UnitScope::Faps && matches!(row.unit, ExpressionUnit::Auv(_)) {
            continue;
        }
        let Some((unit, length)) = find_unit(&wireframe, &fapus, row.unit) else { continue };
        for &(node, offset) in &wireframe.action_units()[unit].offsets {
            offsets[node.index()] += offset * (row.weight * length);
        }
    }
    keep_lips_apart(&wireframe, &mut offsets);
    let pose = Course::new(options, subject, emotion).pose(0.0);
    let still = neutral.iter().map(|node| pose.project(node)).collect();
    let moved = neutral.iter().zip(&offsets).map(|(node, offset)| pose.project(&(node + offset))).collect();
    Ok((still, moved))
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
