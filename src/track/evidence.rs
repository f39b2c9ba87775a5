//! What was measured at a node: by the step into a frame, and beside the neutral frame.

/// Gradient, grey levels per px, below which a window has no usable texture.
pub(super) const GRADIENT_FLOOR: f64 = 0.2;

/// Grey difference from the neutral frame over the one between two consecutive frames, assumed where no skin is compared. Without it,
/// errors expected without alignment were 0.64 of the true ones on animated photographs.
pub(super) const STEP_TO_NEUTRAL: f64 = 2.0;

/// Measurements of one tracker step at a node that was not lost.
///
/// ```
/// use grimace::track::{Evidence, NodeState, TrackedNode};
/// use nalgebra::Point2;
///
/// let evidence = Some(Evidence { difference: 1.5, gradients: [4.0, 20.0], correction: 0.1 });
/// let chin = TrackedNode { evidence, ..TrackedNode::new(Point2::new(149.5, 240.0), NodeState::Tracked, Some(0.02)) };
/// assert!(chin.evidence.is_some_and(|e| e.gradients[0] <= e.gradients[1]));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// Mean absolute grey difference of the matched windows, 0 to 255.
    pub difference: f64,
    /// Root mean square gradient of the window across and along its strongest edge, the weaker first; grey levels per px.
    pub gradients: [f64; 2],
    /// Distance from the position that the tracker found to the final position, px.
    pub correction: f64,
}

/// How the skin around a node looks beside the neutral frame, read through the wireframe as it was placed in this frame. Where the wireframe
/// was left behind, it does not look the same, whatever the steps before said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkinMatch {
    /// Mean absolute grey difference from the neutral frame, but for a change of brightness of each triangle; 0 to 255.
    pub difference: f64,
    /// Mean absolute gradient of the current frame, grey levels per px.
    pub gradient: f64,
}

impl Evidence {
    /// Returns the comparison with the neutral frame that is expected from the step.
    pub(super) fn skin(&self) -> SkinMatch {
        SkinMatch { difference: STEP_TO_NEUTRAL * self.difference, gradient: self.gradients[0].hypot(self.gradients[1]) }
    }
}

impl SkinMatch {
    /// Returns the shift that the difference stands for, px: 6 grey levels where they change by 3 a px are 2 px.
    #[must_use]
    pub fn offset_px(&self) -> f64 {
        self.difference / self.gradient.max(GRADIENT_FLOOR)
    }
}
