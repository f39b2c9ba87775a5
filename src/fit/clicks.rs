//! Accuracy of marks set by a person.

use crate::{units::NodeId, wireframe::mark_deviation};

/// Standard deviation, over the eye distance, up to which a mark counts as sharp: the one that priors assume.
const SHARP: f64 = 0.016;

/// Returns the standard deviation in x and in y, over the eye distance, of a person's mark on a feature without a sharp position: brows,
/// chin, jaw.
///
/// `None` for a sharp mark. Along a soft contour people differ by 3 to 6 % of the eye distance; a fit that took such marks as exact would
/// explain the difference by a different face.
/// such marks for exact would explain the difference by another face.
pub(super) fn soft_deviation(node: NodeId) -> Option<f64> {
    mark_deviation(node).filter(|&deviation| deviation > SHARP)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brows_and_chin_are_soft_and_corners_are_not() {
        assert_eq!([15, 17, 48, 50, 10].map(|n| soft_deviation(NodeId(n))), [Some(0.03); 5]);
        assert_eq!([20, 23, 53, 56, 31, 64].map(|n| soft_deviation(NodeId(n))), [None; 6]);
        assert_eq!(soft_deviation(NodeId(200)), None);
    }
}
