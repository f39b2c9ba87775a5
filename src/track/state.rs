//! States of a node: how it got its position.

use std::{fmt, str::FromStr};

/// Reason why a node was lost in a step.
///
/// ```
/// use grimace::track::{LossReason, NodeState};
///
/// assert_eq!(LossReason::ForwardBackward.name(), "forward_backward");
/// assert_eq!("recovered_outside".parse(), Ok(NodeState::Recovered(LossReason::Outside)));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LossReason {
    /// KLT found no match.
    Klt,
    /// The backward search did not return to the start.
    ForwardBackward,
    /// The node left the image.
    Outside,
    /// The displacement was extreme compared with the neighbours'.
    Extreme,
    /// In a large step KLT lost the node, or found it far from where the face as located in the neutral frame and in this one puts it; the
    /// located face placed it.
    Jump,
    /// The node has no landmark; only in tracks from landmarks.
    NoLandmark,
    /// The whole frame was lost or is missing; only in tracks from landmarks.
    LostFrame,
}

impl LossReason {
    /// Returns the reason as one word, as in the `state` column after `recovered_`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Klt => "klt",
            Self::ForwardBackward => "forward_backward",
            Self::Outside => "outside",
            Self::Extreme => "extreme",
            Self::Jump => "jump",
            Self::NoLandmark => "no_landmark",
            Self::LostFrame => "lost_frame",
        }
    }
}

/// How a node got its position in a frame.
///
/// ```
/// use grimace::track::{LossReason, NodeState};
///
/// assert_eq!(NodeState::Recovered(LossReason::Klt).to_string(), "recovered_klt");
/// assert_eq!("tracked".parse(), Ok(NodeState::Tracked));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum NodeState {
    /// Neutral frame: pulled to a mark.
    Marked,
    /// Neutral frame: placed by the fit.
    Fitted,
    /// Set by hand.
    Corrected,
    /// Tracked by KLT, or by its landmark.
    Tracked,
    /// Lost, and placed by the springs.
    Recovered(LossReason),
    /// In no triangle: placed at the mean position of the nodes it follows.
    Follows,
}

impl NodeState {
    const NAMES: [(Self, &'static str); 12] = [
        (Self::Marked, "marked"),
        (Self::Fitted, "fitted"),
        (Self::Corrected, "corrected"),
        (Self::Tracked, "tracked"),
        (Self::Recovered(LossReason::Klt), "recovered_klt"),
        (Self::Recovered(LossReason::ForwardBackward), "recovered_forward_backward"),
        (Self::Recovered(LossReason::Outside), "recovered_outside"),
        (Self::Recovered(LossReason::Extreme), "recovered_extreme"),
        (Self::Recovered(LossReason::Jump), "recovered_jump"),
        (Self::Recovered(LossReason::NoLandmark), "recovered_no_landmark"),
        (Self::Recovered(LossReason::LostFrame), "recovered_lost_frame"),
        (Self::Follows, "follows"),
    ];

    /// Returns why the node was lost; `None` if it was not.
    pub fn loss(self) -> Option<LossReason> {
        match self {
            Self::Recovered(reason) => Some(reason),
            _ => None,
        }
    }

    /// Returns the word in the `state` column of a track file.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(state, _)| *state == self).map_or("", |(_, name)| name)
    }
}

impl fmt::Display for NodeState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for NodeState {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let found = Self::NAMES.iter().find(|(_, name)| *name == text).map(|(state, _)| *state);
        let names = || Self::NAMES.map(|(_, name)| name).join(", ");
        found.ok_or_else(|| format!("`{}` is not a node state; the states are {}", crate::text::excerpt(text), names()))
    }
}
