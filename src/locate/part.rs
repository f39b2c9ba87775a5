//! Parts of a face, each of which may be covered.

use super::points::{LocatorPoint, points};
use crate::units::NodeId;

/// A part of a face; left and right are the subject's own.
///
/// ```
/// use grimace::locate::FacePart;
///
/// let hidden = [FacePart::LeftEye, FacePart::RightEye, FacePart::Mouth];
/// assert_eq!(FacePart::listed(&hidden), "both eyes and the mouth");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FacePart {
    /// The brow at the subject's left.
    LeftBrow,
    /// The brow at the subject's right.
    RightBrow,
    /// Corners, lids, iris and pupil at the subject's left.
    LeftEye,
    /// Corners, lids, iris and pupil at the subject's right.
    RightEye,
    /// Nostrils, base and tip of the nose.
    Nose,
    /// Corners of the mouth and lips.
    Mouth,
    /// The chin, and the hollow above it.
    Chin,
}

impl FacePart {
    /// All parts, from top to bottom.
    pub const ALL: [Self; 7] =
        [Self::LeftBrow, Self::RightBrow, Self::LeftEye, Self::RightEye, Self::Nose, Self::Mouth, Self::Chin];

    /// Returns the name of the part.
    pub fn name(self) -> &'static str {
        match self {
            Self::LeftBrow => "left brow",
            Self::RightBrow => "right brow",
            Self::LeftEye => "left eye",
            Self::RightEye => "right eye",
            Self::Nose => "nose",
            Self::Mouth => "mouth",
            Self::Chin => "chin",
        }
    }

    /// Lists parts in the order of [`FacePart::ALL`], for example `both eyes and the mouth`; empty for none.
    pub fn listed(parts: &[Self]) -> String {
        let has = |part: Self| parts.contains(&part);
        let mut names = Vec::new();
        for (left, right, both) in [(Self::LeftBrow, Self::RightBrow, "both brows"), (Self::LeftEye, Self::RightEye, "both eyes")]
        {
            if has(left) && has(right) {
                names.push(both.to_owned());
            } else {
                names.extend([left, right].into_iter().filter(|&p| has(p)).map(|p| format!("the {}", p.name())));
            }
        }
        names.extend([Self::Nose, Self::Mouth, Self::Chin].into_iter().filter(|&p| has(p)).map(|p| format!("the {}", p.name())));
        match names.split_last() {
            Some((last, [])) => last.clone(),
            Some((last, others)) => format!("{} and {last}", others.join(", ")),
            None => String::new(),
        }
    }

    /// Returns a sentence about covered parts, for example `the mouth and the chin look covered`; `None` for none.
    pub(crate) fn said_covered(parts: &[Self]) -> Option<String> {
        let look = if parts.len() == 1 { "looks" } else { "look" };
        (!parts.is_empty()).then(|| format!("{} {look} covered", Self::listed(parts)))
    }

    /// Returns the corresponding part of the other side; the part itself if there is only one.
    pub(super) fn in_mirror(self) -> Self {
        match self {
            Self::LeftBrow => Self::RightBrow,
            Self::RightBrow => Self::LeftBrow,
            Self::LeftEye => Self::RightEye,
            Self::RightEye => Self::LeftEye,
            Self::Nose | Self::Mouth | Self::Chin => self,
        }
    }

    /// Returns the part of a node; `None` for one that the locator does not know, and for the contour beside the chin.
    pub(crate) fn of_node(node: NodeId) -> Option<Self> {
        points().iter().find(|point| point.node == Some(node)).and_then(Self::of)
    }

    /// Returns the part of a point; `None` for the contour beside the chin, which hair and collars hide on many faces.
    pub(super) fn of(point: &LocatorPoint) -> Option<Self> {
        let is_left = point.description.starts_with("left");
        let side = |left: Self, right: Self| if is_left { left } else { right };
        match point.group.as_str() {
            "pupil" | "eye corner" | "lid" | "iris" => Some(side(Self::LeftEye, Self::RightEye)),
            "brow" => Some(side(Self::LeftBrow, Self::RightBrow)),
            "nose" | "nose tip" => Some(Self::Nose),
            "mouth corner" | "lip" => Some(Self::Mouth),
            "hollow" | "chin" => Some(Self::Chin),
            "jaw" if point.description.ends_with("corner of the chin") => Some(Self::Chin),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_has_its_points_and_is_named_once() {
        let count = |part: FacePart| points().iter().filter(|p| FacePart::of(p) == Some(part)).count();
        // Brows: three nodes and five points on the edges; eyes: pupil, two corners, six points of the lids, four of the iris.
        assert_eq!(FacePart::ALL.map(count), [8, 8, 13, 13, 6, 18, 4]);
        let of = |text: &str| points().iter().find(|p| p.description == text).and_then(FacePart::of);
        assert_eq!(of("left pupil"), Some(FacePart::LeftEye));
        assert_eq!(of("right brow: outer end"), Some(FacePart::RightBrow));
        assert_eq!(of("left angle of the jaw"), None);
        assert_eq!((FacePart::of_node(NodeId(10)), FacePart::of_node(NodeId(0))), (Some(FacePart::Chin), None));
    }

    #[test]
    fn parts_are_listed_as_one_says_them() {
        use FacePart::{Chin, LeftBrow, LeftEye, Mouth, RightBrow, RightEye};
        assert_eq!(FacePart::listed(&[]), "");
        assert_eq!(FacePart::listed(&[Mouth]), "the mouth");
        assert_eq!(FacePart::listed(&[Chin, Mouth]), "the mouth and the chin");
        assert_eq!(FacePart::listed(&[LeftBrow, RightBrow, RightEye, Mouth]), "both brows, the right eye and the mouth");
        assert_eq!(FacePart::listed(&[LeftEye]), "the left eye");
    }
}
