//! The summary of a track, and its verdict.

use std::collections::BTreeMap;

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::judge::judge;
use crate::{
    track::{LossReason, NodeState, TrackedFrame, eye_distance_px},
    units::NodeId,
    wireframe::{Tables, Wireframe},
};

/// Most worst nodes that a summary lists.
const WORST_NODES: usize = 5;

/// Whether a person should look at a tracked sequence again. A warning, never a failure.
///
/// ```
/// use grimace::track::Verdict;
///
/// let said = |verdict| match verdict {
///     Verdict::Good => "use it",
///     Verdict::LookAgain => "look at it",
/// };
/// assert_eq!(said(Verdict::default()), "use it");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// No reason to look again.
    #[default]
    Good,
    /// See [`TrackSummary::reasons`].
    LookAgain,
}

impl Verdict {
    /// The verdict in words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::LookAgain => "look again",
        }
    }
}

/// Summary of one track.
///
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let track = grimace::track::read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// use grimace::track::{TrackSummary, summarize};
///
/// // `track` holds the ten frames of a smile.
/// let TrackSummary { frames, tracked_share, recovered, .. } = summarize(&track, &wireframe, &tables);
/// assert_eq!((frames, tracked_share, recovered.len()), (10, 1.0, 0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackSummary {
    /// Frames from neutral to apex.
    pub frames: usize,
    /// Share of (live node, frame) pairs after the neutral frame that were tracked or corrected, 0 to 1.
    pub tracked_share: f64,
    /// Mean forward-backward distance of tracked nodes, px.
    pub mean_residual_px: f64,
    /// Eye distance ES0 in the neutral frame, px.
    pub eye_distance_px: f64,
    /// Recovered (live node, frame) pairs by reason.
    pub recovered: BTreeMap<String, usize>,
    /// Live nodes most often recovered, with the number of frames, worst first, at most five.
    pub worst_nodes: Vec<(NodeId, usize)>,
    /// Median over the live nodes of the expected error of their position on the neutral face, px; `None` when unknown.
    #[serde(default)]
    pub placement_error_px: Option<f64>,
    /// Median over the live nodes of the expected error of their motion at the apex frame, px; `None` for a track without expected errors.
    #[serde(default)]
    pub expected_error_px: Option<f64>,
    /// Whether a person should look at the track again.
    #[serde(default)]
    pub verdict: Verdict,
    /// Reasons to look again, one sentence each.
    #[serde(default)]
    pub reasons: Vec<String>,
    /// The reasons among `reasons` that list given marks that lie beside the face of the neutral frame.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub beside: Vec<String>,
    /// The reason among `reasons` that lists the parts of the face covered in the neutral frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covered: Option<String>,
    /// The reason among `reasons` that says that the mouth of the neutral frame looks less neutral than that of the apex frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mouth_back: Option<String>,
    /// The reason among `reasons` that lists the parts of the face that something covers in the apex frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covered_at_apex: Option<String>,
}

impl TrackSummary {
    /// Returns a length of the neutral frame, px, in percent of the eye distance; `None` when the eye distance is unknown.
    pub(crate) fn percent_of_eyes(&self, px: f64) -> Option<f64> {
        (self.eye_distance_px > 0.0).then(|| 100.0 * px / self.eye_distance_px)
    }

    /// Adds reasons to look again.
    fn with_reasons(mut self, reasons: impl IntoIterator<Item = String>) -> Self {
        let before = self.reasons.len();
        self.reasons.extend(reasons);
        if self.reasons.len() > before {
            self.verdict = Verdict::LookAgain;
        }
        self
    }

    /// Adds the covered parts of the face as a reason to look again.
    #[must_use]
    pub(crate) fn with_covered(self, covered: Option<String>) -> Self {
        Self { covered: covered.clone(), ..self.with_reasons(covered) }
    }

    /// Adds a mouth that moves back to neutral as a reason to look again.
    #[must_use]
    pub(crate) fn with_mouth_back(self, mouth_back: Option<String>) -> Self {
        Self { mouth_back: mouth_back.clone(), ..self.with_reasons(mouth_back) }
    }

    /// Adds parts that something covers in the apex frame as a reason to look again.
    #[must_use]
    pub(crate) fn with_covered_at_apex(self, covered: Option<String>) -> Self {
        Self { covered_at_apex: covered.clone(), ..self.with_reasons(covered) }
    }

    /// Copies the findings from the pictures out of `earlier`, a summary of the same track: the frames alone cannot give them.
    #[must_use]
    pub(crate) fn told_by_the_pictures_of(self, earlier: &Self) -> Self {
        self.with_marks_beside(earlier.beside.clone())
            .with_covered(earlier.covered.clone())
            .with_mouth_back(earlier.mouth_back.clone())
            .with_covered_at_apex(earlier.covered_at_apex.clone())
    }

    /// Adds marks that lie beside the face as reasons to look again.
    #[must_use]
    pub(crate) fn with_marks_beside(self, beside: Vec<String>) -> Self {
        Self { beside: beside.clone(), ..self.with_reasons(beside) }
    }
}

/// Summarizes the frames of a track.
///
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let track = grimace::track::read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// use grimace::track::summarize;
///
/// // `track` holds the ten frames of a smile.
/// let summary = summarize(&track, &wireframe, &tables);
/// assert_eq!(summary.frames, 10);
/// assert!((summary.eye_distance_px - 70.0).abs() < 5.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn summarize(frames: &[TrackedFrame], wireframe: &Wireframe, tables: &Tables) -> TrackSummary {
    let live = wireframe.live_nodes();
    let mut recovered = BTreeMap::new();
    let mut losses: BTreeMap<NodeId, usize> = BTreeMap::new();
    let (mut tracked, mut pairs) = (0usize, 0usize);
    let (mut residual_sum, mut residuals) = (0.0, 0usize);
    for frame in frames.iter().skip(1) {
        for &id in live {
            let Some(node) = frame.nodes.get(id.index()) else { continue };
            pairs += 1;
            match node.state {
                NodeState::Recovered(reason) => {
                    *recovered.entry(reason.name().to_owned()).or_insert(0) += 1;
                    // A node without a landmark is never tracked, so this says nothing about the node.
                    if reason != LossReason::NoLandmark {
                        *losses.entry(id).or_insert(0) += 1;
                    }
                }
                _ => tracked += 1,
            }
            if let (NodeState::Tracked, Some(residual)) = (node.state, node.residual) {
                residual_sum += residual;
                residuals += 1;
            }
        }
    }
    let mut worst_nodes: Vec<_> = losses.into_iter().collect();
    worst_nodes.sort_by_key(|&(node, count)| (std::cmp::Reverse(count), node));
    worst_nodes.truncate(WORST_NODES);
    let share = |part: f64, whole: usize| if whole == 0 { 0.0 } else { part / whole as f64 };
    let neutral: Vec<Point2<f64>> = frames.first().map(|f| f.nodes.iter().map(|n| n.position).collect()).unwrap_or_default();
    let mut summary = TrackSummary {
        frames: frames.len(),
        tracked_share: share(tracked as f64, pairs),
        mean_residual_px: share(residual_sum, residuals),
        eye_distance_px: eye_distance_px(tables, &neutral).unwrap_or(0.0),
        recovered,
        worst_nodes,
        placement_error_px: None,
        expected_error_px: None,
        verdict: Verdict::Good,
        reasons: Vec::new(),
        beside: Vec::new(),
        covered: None,
        mouth_back: None,
        covered_at_apex: None,
    };
    judge(&mut summary, frames, wireframe, tables);
    summary
}
