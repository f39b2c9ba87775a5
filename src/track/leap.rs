//! Large motion between two frames, as between a neutral photograph and one of the apex, bridged by the locator.
//!
//! KLT follows motion of a fraction of its window per pyramid level. Where it loses much of the face in one step, the face is located in
//! the neutral and in the current frame: the difference of both readings, in which most of what the locator gets wrong about a person
//! cancels, predicts where the nodes went. The search starts again from there, and nodes that it still loses are drawn to the prediction.

use nalgebra::{Point2, Vector2};

use super::TrackError;
use crate::{
    fit::{DrivenNode, Pull, Springs},
    locate::{LocateOptions, LocatedFace, Locator},
    sequence::Frame,
    wireframe::Wireframe,
};

/// Share of the nodes lost in a step from which on the face is located.
pub const LOST_SHARE: f64 = 0.2;
/// Largest median expected error of a reading that is used, over the eye distance.
const LARGEST_ERROR: f64 = 0.06;
/// Force of a located node with an expected error of [`COMMON_ERROR`] over the eye distance, in units of a spring's stiffness.
const FORCE: f64 = 20.0;
const COMMON_ERROR: f64 = 0.02;

/// What is needed to locate the face when the tracker loses it.
pub struct Leap {
    neutral: Frame,
    nodes: Vec<Point2<f64>>,
    reading: Option<Option<LocatedFace>>,
}

impl Leap {
    /// Keeps the neutral frame and its nodes; nothing is located yet.
    pub fn new(neutral: &Frame, nodes: &[Point2<f64>]) -> Self {
        Self { neutral: neutral.clone(), nodes: nodes.to_vec(), reading: None }
    }

    /// Returns the predicted position of every node in a frame, px; `None` if the face cannot be located in one of the two frames.
    pub fn predict(
        &mut self,
        frame: &Frame,
        previous: &[Point2<f64>],
        wireframe: &Wireframe,
        springs: &Springs,
    ) -> Result<Option<Vec<Point2<f64>>>, TrackError> {
        let Ok(locator) = Locator::shipped() else { return Ok(None) };
        if self.reading.is_none() {
            self.reading = Some(read(locator, &self.neutral, &self.nodes));
        }
        let Some(Some(neutral)) = &self.reading else { return Ok(None) };
        let Some(current) = read(locator, frame, previous) else { return Ok(None) };
        let unit = neutral.eye_distance;
        let targets: Vec<DrivenNode> = neutral
            .points
            .iter()
            .zip(&current.points)
            .filter(|(a, _)| wireframe.live_nodes().contains(&a.node))
            .map(|(a, b)| {
                let moved: Vector2<f64> = b.position - a.position;
                let error = b.expected_error.max(0.5 * COMMON_ERROR * unit) / (COMMON_ERROR * unit);
                DrivenNode { node: a.node, position: self.nodes[a.node.index()] + moved, pull: Pull::Force(FORCE / error.powi(2)) }
            })
            .collect();
        Ok(Some(springs.deform(wireframe, &self.nodes, &targets)?))
    }
}

/// Reads the face near nodes, or wherever it is; `None` if it is read too inaccurately.
fn read(locator: &Locator, frame: &Frame, nodes: &[Point2<f64>]) -> Option<LocatedFace> {
    let places: Vec<_> = crate::locate::points()
        .iter()
        .filter_map(|p| Some((p.node?, *nodes.get(p.node?.index())?)))
        .collect();
    let near = locator.read_near(frame.image(), &places);
    let face = near.or_else(|| {
        locator.locate(frame.image(), &LocateOptions { most_faces: 1, ..LocateOptions::default() }).into_iter().next()
    })?;
    (face.expected_error() <= LARGEST_ERROR).then_some(face)
}
