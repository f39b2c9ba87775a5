//! How precisely a person can set a mark.

use crate::{units::NodeId, wireframe::mark_deviation};

/// Standard deviations up to here, over the eye distance, are those of any mark: what priors take for granted.
const SHARP: f64 = 0.016;

/// Standard deviation of a person's mark in x and in y, over the eye distance, on a feature without a sharp place: brows, the
/// chin, the jaw.
///
/// `None` where a mark is as good as any. Along a soft contour people differ by 3 to 6 % of the eye distance; a fit that took
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
