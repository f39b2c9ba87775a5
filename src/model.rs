//! Frame and dynamic facial expression models [KP, section 1 and eq. 2].

use std::marker::PhantomData;

use nalgebra::{Point2, Vector2};

use crate::units::{NodeId, Unit};

/// The wireframe in one video frame: the position of every node, in unit `U`.
///
/// ```
/// use grimace::{model::FrameExpressionModel, units::{NodeId, Px}};
/// use nalgebra::Point2;
///
/// let frame = FrameExpressionModel::<Px>::new(vec![Point2::new(160.0, 40.0), Point2::new(180.0, 66.0)]);
/// assert_eq!(frame.node(NodeId(1)), Some(Point2::new(180.0, 66.0)));
/// assert_eq!(frame.node(NodeId(2)), None);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FrameExpressionModel<U: Unit> {
    nodes: Vec<Point2<f64>>,
    unit: PhantomData<U>,
}

impl<U: Unit> FrameExpressionModel<U> {
    /// Creates a frame model from the positions of all N nodes of a wireframe, in node order.
    pub fn new(nodes: Vec<Point2<f64>>) -> Self {
        Self { nodes, unit: PhantomData }
    }

    /// Returns the positions in node order.
    pub fn nodes(&self) -> &[Point2<f64>] {
        &self.nodes
    }

    /// Returns the position of one node, or `None` if the wireframe does not have the node.
    pub fn node(&self, node: NodeId) -> Option<Point2<f64>> {
        self.nodes.get(node.index()).copied()
    }

    /// Returns the number of nodes N (live or not).
    pub fn node_count(&self) -> usize {
        self.nodes.len()
    }
}

/// Why frame models do not make a dynamic model.
///
/// ```
/// use grimace::{model::{DynamicExpressionModel, FrameExpressionModel, ModelError}, units::Px};
/// use nalgebra::Point2;
///
/// let neutral = FrameExpressionModel::<Px>::new(vec![Point2::origin()]);
/// let error = DynamicExpressionModel::new(vec![neutral]).unwrap_err();
/// assert_eq!(error, ModelError::TooFewFrames { found: 1 });
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// Fewer than two frames, hence no motion.
    #[error("a dynamic model needs at least 2 frames, found {found}")]
    TooFewFrames {
        /// Frames given.
        found: usize,
    },
    /// Frames over different wireframes.
    #[error("frame {frame} has {found} nodes, but frame 0 has {expected}")]
    NodeCount {
        /// Frame index, from 0.
        frame: usize,
        /// Its nodes.
        found: usize,
        /// Nodes of frame 0.
        expected: usize,
    },
    /// A coordinate that is NaN or infinite.
    #[error("node {node} of frame {frame} is at ({x}, {y}), which is not a finite position")]
    NotFinite {
        /// Frame index, from 0.
        frame: usize,
        /// The node.
        node: NodeId,
        /// Its x coordinate.
        x: f64,
        /// Its y coordinate.
        y: f64,
    },
}

/// The frame models of one sequence, from the neutral to the apex frame.
///
/// At least two frames, all over the same nodes, all coordinates finite.
///
/// ```
/// use grimace::{model::{DynamicExpressionModel, FrameExpressionModel}, units::Px};
/// use nalgebra::{Point2, Vector2};
///
/// let frame = |x: f64| FrameExpressionModel::<Px>::new(vec![Point2::new(x, 0.0)]);
/// let model = DynamicExpressionModel::new(vec![frame(0.0), frame(1.0), frame(3.0)])?;
/// assert_eq!(model.displacement_field(1), [Vector2::new(2.0, 0.0)]);
/// assert_eq!(model.neutral_offsets(2), [Vector2::new(3.0, 0.0)]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct DynamicExpressionModel<U: Unit> {
    frames: Vec<FrameExpressionModel<U>>,
}

impl<U: Unit> DynamicExpressionModel<U> {
    /// Creates a dynamic model from frame models, neutral first, apex last.
    ///
    /// # Errors
    /// [`ModelError`] for fewer than two frames, differing node counts, or coordinates that are not finite.
    pub fn new(frames: Vec<FrameExpressionModel<U>>) -> Result<Self, ModelError> {
        if frames.len() < 2 {
            return Err(ModelError::TooFewFrames { found: frames.len() });
        }
        let expected = frames[0].node_count();
        for (index, frame) in frames.iter().enumerate() {
            if frame.node_count() != expected {
                return Err(ModelError::NodeCount { frame: index, found: frame.node_count(), expected });
            }
            if let Some(k) = frame.nodes.iter().position(|p| !(p.x.is_finite() && p.y.is_finite())) {
                let (x, y) = (frame.nodes[k].x, frame.nodes[k].y);
                return Err(ModelError::NotFinite { frame: index, node: NodeId(k as u16), x, y });
            }
        }
        Ok(Self { frames })
    }

    /// Returns the frame models in order.
    pub fn frames(&self) -> &[FrameExpressionModel<U>] {
        &self.frames
    }

    /// Returns the neutral frame model.
    pub fn neutral(&self) -> &FrameExpressionModel<U> {
        &self.frames[0]
    }

    /// Returns the apex frame model.
    pub fn apex(&self) -> &FrameExpressionModel<U> {
        &self.frames[self.frames.len() - 1]
    }

    /// Returns the number of frames N'.
    pub fn frame_count(&self) -> usize {
        self.frames.len()
    }

    /// Returns the number of nodes N (live or not).
    pub fn node_count(&self) -> usize {
        self.frames[0].node_count()
    }

    /// Returns the displacement vectors tau of all nodes from frame `m` to `m + 1`, with `m` in `0..frame_count() - 1`.
    ///
    /// Implements [KP, eq. (2)].
    ///
    /// # Panics
    /// If `m + 1` is not a frame (a programmer's error).
    pub fn displacement_field(&self, m: usize) -> Vec<Vector2<f64>> {
        let (from, to) = (&self.frames[m].nodes, &self.frames[m + 1].nodes);
        from.iter().zip(to).map(|(a, b)| b - a).collect()
    }

    /// Returns the neutral offsets of all nodes in frame `m`: position minus neutral position (what a FAP measures).
    ///
    /// # Panics
    /// If `m` is not a frame (a programmer's error).
    pub fn neutral_offsets(&self, m: usize) -> Vec<Vector2<f64>> {
        self.neutral().nodes.iter().zip(&self.frames[m].nodes).map(|(a, b)| b - a).collect()
    }
}

/// Serializes a dynamic model as a list of frames, each a list of positions `[x, y]`, for `#[serde(with)]`.
pub(crate) mod as_points {
    use nalgebra::Point2;
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

    use super::{DynamicExpressionModel, FrameExpressionModel, Unit};

    pub fn serialize<U: Unit, S: Serializer>(model: &DynamicExpressionModel<U>, serializer: S) -> Result<S::Ok, S::Error> {
        let frames: Vec<Vec<[f64; 2]>> =
            model.frames().iter().map(|frame| frame.nodes().iter().map(|p| [p.x, p.y]).collect()).collect();
        frames.serialize(serializer)
    }

    pub fn deserialize<'de, U: Unit, D: Deserializer<'de>>(deserializer: D) -> Result<DynamicExpressionModel<U>, D::Error> {
        let frames = Vec::<Vec<[f64; 2]>>::deserialize(deserializer)?;
        let frame = |nodes: Vec<[f64; 2]>| FrameExpressionModel::new(nodes.into_iter().map(|[x, y]| Point2::new(x, y)).collect());
        DynamicExpressionModel::new(frames.into_iter().map(frame).collect()).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Px;

    fn frame(points: &[(f64, f64)]) -> FrameExpressionModel<Px> {
        FrameExpressionModel::new(points.iter().map(|&(x, y)| Point2::new(x, y)).collect())
    }

    #[test]
    fn displacements_are_to_the_next_frame_and_offsets_from_neutral() {
        let model = DynamicExpressionModel::new(vec![frame(&[(0.0, 0.0)]), frame(&[(1.0, 0.0)]), frame(&[(3.0, 1.0)])]).unwrap();
        assert_eq!(model.displacement_field(1), [Vector2::new(2.0, 1.0)]);
        assert_eq!(model.neutral_offsets(2), [Vector2::new(3.0, 1.0)]);
    }

    #[test]
    fn bad_frames_are_named() {
        assert_eq!(DynamicExpressionModel::new(vec![frame(&[(0.0, 0.0)])]), Err(ModelError::TooFewFrames { found: 1 }));
        let uneven = DynamicExpressionModel::new(vec![frame(&[(0.0, 0.0)]), frame(&[])]);
        assert_eq!(uneven, Err(ModelError::NodeCount { frame: 1, found: 0, expected: 1 }));
        let nan = DynamicExpressionModel::new(vec![frame(&[(0.0, 0.0)]), frame(&[(0.0, f64::NAN)])]);
        assert!(matches!(nan, Err(ModelError::NotFinite { frame: 1, node: NodeId(0), .. })));
    }
}
