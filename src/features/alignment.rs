//! What errors of the alignment do to a whole face.
//!
//! Frames are aligned with the neutral frame by the similarity of the eye corners ([`crate::normalize::EyeCorners`]). If these are off, every
//! node is, the chin most.

use nalgebra::{Point2, Vector2};

use crate::{normalize::EyeCorners, units::NodeId};

/// Motions of the whole face that errors of the eye corners cause.
pub(super) const ALIGNMENTS: usize = 4;
/// Median absolute deviation of a standard normal number.
pub(super) const MEDIAN: f64 = 0.6745;

/// Motions of all nodes by errors of the eye corners, by which frames are aligned with the neutral frame.
#[derive(Clone, Debug)]
pub(super) struct AlignmentErrors {
    /// Nodes of the eye corners.
    pub corners: Vec<usize>,
    /// Offset of each node for each of [`ALIGNMENTS`] independent motions (along x, along y, turn, size), one standard deviation each for
    /// eye corners with one of 1 in x and in y.
    pub motions: Vec<[Vector2<f64>; ALIGNMENTS]>,
}

impl AlignmentErrors {
    /// Creates the motions for a neutral face and its eye corners.
    pub fn new(neutral: &[Point2<f64>], corners: &EyeCorners) -> Self {
        let corners = corners.nodes().to_vec();
        let count = corners.len().max(1) as f64;
        let middle = corners.iter().map(|&k| neutral[k].coords).sum::<Vector2<f64>>() / count;
        let spread = corners.iter().map(|&k| (neutral[k].coords - middle).norm_squared()).sum::<f64>().sqrt().max(1.0);
        let shift = count.sqrt().recip();
        let motion = |at: &Point2<f64>| {
            let from = (at.coords - middle) / spread;
            [Vector2::new(shift, 0.0), Vector2::new(0.0, shift), Vector2::new(-from.y, from.x), from]
        };
        Self { corners, motions: neutral.iter().map(motion).collect() }
    }

    /// Returns the standard deviation of the eye corners among nodes with these expected errors; 0 if none of them is there.
    pub fn deviation(&self, nodes: &[(NodeId, f64)]) -> f64 {
        let squares: Vec<f64> =
            nodes.iter().filter(|(n, _)| self.corners.contains(&n.index())).map(|(_, e)| (e / MEDIAN).powi(2)).collect();
        (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wireframe::{Tables, Wireframe};

    #[test]
    fn motions_have_the_deviations_of_a_least_squares_similarity() {
        let (w, tables) = (Wireframe::candide3(), Tables::candide3());
        let face: Vec<Point2<f64>> = w.frontal().iter().map(|p| p * 1000.0).collect();
        let errors = AlignmentErrors::new(&face, &EyeCorners::new(&tables, w.node_count()));
        // Four corners: their mean is known to half of one corner's error. What turns and scales is independent of it.
        assert_eq!(errors.corners.len(), 4);
        let sum = |m: usize| errors.corners.iter().map(|&k| errors.motions[k][m]).sum::<Vector2<f64>>();
        assert!((sum(0) - Vector2::new(2.0, 0.0)).norm() < 1e-12 && sum(2).norm() < 1e-12 && sum(3).norm() < 1e-12);
        // Each motion of the corners has the length 1 in the space of their eight coordinates.
        for m in 0..ALIGNMENTS {
            let squares: f64 = errors.corners.iter().map(|&k| errors.motions[k][m].norm_squared()).sum();
            assert!((squares - 1.0).abs() < 1e-12, "{squares}");
        }
        let corner = NodeId(errors.corners[0] as u16);
        assert!((errors.deviation(&[(corner, 0.6745), (NodeId(10), 99.0)]) - 1.0).abs() < 1e-12);
        assert_eq!(errors.deviation(&[(NodeId(10), 99.0)]), 0.0);
    }
}
