//! Units and identifiers shared by every stage.
//!
//! There are two coordinate spaces. *Image space* is in pixels, x to the right, y **down**; the centre of the top-left pixel is (0, 0).
//! *Face space* has Candide-3's axes, x to the subject's left, y **up**. A model carries its unit in its type ([`Px`], [`FaceUnit`]), so
//! that a tracked model in pixels cannot be passed to a function for face units.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Serialize};

/// A unit of length that a model can be expressed in.
///
/// Implement it for your own unit to keep models in that unit apart from others.
/// ```
/// use grimace::{model::FrameExpressionModel, units::Unit};
/// use nalgebra::Point2;
///
/// #[derive(Clone, Copy)]
/// struct Millimetre;
///
/// impl Unit for Millimetre {
///     const NAME: &'static str = "mm";
/// }
///
/// let frame = FrameExpressionModel::<Millimetre>::new(vec![Point2::new(31.5, 0.0)]);
/// assert_eq!((frame.node_count(), Millimetre::NAME), (1, "mm"));
/// ```
pub trait Unit: Copy + Send + Sync + 'static {
    /// Name of the unit in reports and JSON files.
    const NAME: &'static str;
}

/// Image pixels, y down.
///
/// ```
/// use grimace::units::{Px, Unit};
///
/// assert_eq!(Px::NAME, "px");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Px;

/// Face units: the canonical neutral Candide-3 scaled so that ES0 = 1024, y up.
///
/// ```
/// use grimace::units::{FaceUnit, Unit};
///
/// assert_eq!(FaceUnit::NAME, "face unit (ES0/1024)");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaceUnit;

impl FaceUnit {
    /// Face units in the eye separation ES0 of the canonical neutral.
    pub const PER_ES: f64 = 1024.0;
}

impl Unit for Px {
    const NAME: &'static str = "px";
}

impl Unit for FaceUnit {
    const NAME: &'static str = "face unit (ES0/1024)";
}

/// Index of a wireframe node, from 0, in the order of the wireframe file.
///
/// ```
/// use grimace::units::NodeId;
///
/// let chin = NodeId(10);
/// assert_eq!(chin.index(), 10);
/// assert_eq!(format!("node {chin}"), "node 10");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct NodeId(pub u16);

impl NodeId {
    /// Returns the node's index in an array over all nodes.
    pub fn index(self) -> usize {
        usize::from(self.0)
    }
}

impl fmt::Display for NodeId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// An MPEG-4 feature point, `group.point`, such as `8.3` (left mouth corner).
///
/// ```
/// use grimace::units::FeaturePoint;
///
/// let left_corner_of_the_mouth: FeaturePoint = "8.3".parse()?;
/// assert_eq!(left_corner_of_the_mouth, FeaturePoint { group: 8, point: 3 });
/// assert_eq!(left_corner_of_the_mouth.to_string(), "8.3");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FeaturePoint {
    /// FDP group, 2 to 11.
    pub group: u8,
    /// Number within the group, from 1.
    pub point: u8,
}

/// Number of points in each group of MPEG-4, as (group, points); points are numbered from 1. There are 84 in all.
const FEATURE_POINTS: [(u8, u8); 10] = [(2, 14), (3, 14), (4, 6), (5, 4), (6, 4), (7, 1), (8, 10), (9, 15), (10, 10), (11, 6)];

impl FeaturePoint {
    /// Returns whether it is one of the 84 feature points of MPEG-4.
    pub fn is_of_mpeg4(self) -> bool {
        FEATURE_POINTS.iter().any(|&(group, points)| group == self.group && (1..=points).contains(&self.point))
    }
}

impl fmt::Display for FeaturePoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.group, self.point)
    }
}

/// Error for a text that is not `group.point` or not one of MPEG-4's 84 feature points.
///
/// ```
/// use grimace::units::FeaturePoint;
///
/// let error = "8.0".parse::<FeaturePoint>().unwrap_err();
/// assert_eq!(error.to_string(), "`8.0` is not an MPEG-4 feature point such as `8.3`");
/// ```
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not an MPEG-4 feature point such as `8.3`")]
pub struct ParseFeaturePointError(pub String);

impl FromStr for FeaturePoint {
    type Err = ParseFeaturePointError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let error = || ParseFeaturePointError(text.to_owned());
        let (group, point) = text.split_once('.').ok_or_else(error)?;
        let number = |part: &str| part.parse::<u8>().ok().filter(|&n| n > 0);
        match (number(group), number(point)) {
            (Some(group), Some(point)) => Some(Self { group, point }).filter(|fp| fp.is_of_mpeg4()).ok_or_else(error),
            _ => Err(error()),
        }
    }
}

/// Identity of one sequence: subject and recording.
///
/// ```
/// use grimace::units::SequenceId;
///
/// let id = SequenceId { subject: "S001".to_owned(), sequence: "005".to_owned() };
/// assert_eq!(id.to_string(), "S001_005");
/// ```
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct SequenceId {
    /// Subject, as in the manifest or the folder name.
    pub subject: String,
    /// Sequence of that subject.
    pub sequence: String,
}

impl fmt::Display for SequenceId {
    /// `SUBJECT_SEQUENCE`, the stem of every file made from the sequence.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}_{}", self.subject, self.sequence)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn feature_points_parse_and_print() {
        let fp: FeaturePoint = "2.10".parse().unwrap();
        assert_eq!(fp, FeaturePoint { group: 2, point: 10 });
        assert_eq!(fp.to_string(), "2.10");
        for bad in ["", "8", "8.", ".3", "8.0", "8.3.1", "a.b", "-8.3", "8.300", "1.1", "77.1", "99.3", "7.2", "8.11", "12.1"] {
            assert!(bad.parse::<FeaturePoint>().is_err(), "{bad}");
        }
        let all = (0..=u8::MAX).flat_map(|group| (0..=u8::MAX).map(move |point| FeaturePoint { group, point }));
        assert_eq!(all.filter(|fp| fp.is_of_mpeg4()).count(), 84);
    }
}
