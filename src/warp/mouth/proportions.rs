//! Proportions of the inside of a mouth that depend on the face around it.

use crate::warp::Warp;

/// Distance that the upper incisors reach below the closed lips, in eye distances (2.8 mm of a mean 63 mm between the pupils).
const UPPER_BELOW_LIPS: f64 = 0.058;
/// Upper lip: mean length from the base of the nose over 59 people, in eye distances; the reach of the incisors lost per additional length; and
/// the limits of its increase and decrease. A long lip shows less of the incisors, but a gaping mouth without any teeth looks like a hole.
const UPPER_LIP: (f64, f64, [f64; 2]) = (0.375, 0.30, [0.012, 0.004]);
/// Height of the tongue over the gap of the lips. `JAW`: mean length from the lips to the chin over 59 people, in eye distances; the height lost
/// per additional length; and the limits of its increase and decrease. The tongue lies lower in a long jaw.
const TONGUE_HEIGHT: f64 = 0.56;
const JAW: (f64, f64, [f64; 2]) = (0.78, 1.0, [0.07; 2]);
/// Width of a mouth, in eye distances, whose teeth have the size of the picture's, and the exponent with which teeth grow with the width.
/// `TEETH_SIZES` limits the size.
const MOUTH: (f64, f64) = (0.62, 0.6);
const TEETH_SIZES: (f64, f64) = (0.86, 1.12);

/// Proportions of the inside of a mouth that depend on the face around it, so that it is not the same on everybody.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proportions {
    /// Distance that the upper incisors reach below the closed lips, in eye distances; larger with a short lip.
    pub incisors: f64,
    /// Height of the tongue over the gap of the lips; smaller with a long jaw.
    pub tongue: f64,
}

impl Proportions {
    /// Measures the proportions of a face.
    pub fn of(warp: &Warp) -> Self {
        let length = |from: usize, to: usize| warp.frame.height(&warp.nodes[to]) - warp.frame.height(&warp.nodes[from]);
        Self::by(length(6, 87) / warp.frame.eye_distance, length(40, 10) / warp.frame.eye_distance)
    }

    /// Offset of this face into the irregular patterns: identical glints and teeth on everybody would look drawn.
    pub fn own(&self) -> f64 {
        7.0 * (40.0 * self.incisors + 10.0 * self.tongue)
    }

    /// Proportions for lengths of the upper lip and the jaw, in eye distances.
    fn by(lip: f64, jaw: f64) -> Self {
        let less = |(mean, share, [more, less]): (f64, f64, [f64; 2]), length: f64| (share * (length - mean)).clamp(-more, less);
        Self { incisors: UPPER_BELOW_LIPS - less(UPPER_LIP, lip), tongue: TONGUE_HEIGHT - less(JAW, jaw) }
    }
}

/// Size of the teeth relative to the picture's; larger in a wide mouth.
pub fn teeth_size(warp: &Warp) -> f64 {
    let width = (warp.nodes[88] - warp.nodes[89]).norm() / warp.frame.eye_distance;
    (width / MOUTH.0).powf(MOUTH.1).clamp(TEETH_SIZES.0, TEETH_SIZES.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_lip_shows_more_of_the_incisors_and_a_long_jaw_less_of_the_tongue() {
        let mean = Proportions::by(UPPER_LIP.0, JAW.0);
        assert_eq!(mean, Proportions { incisors: UPPER_BELOW_LIPS, tongue: TONGUE_HEIGHT });
        let (short, long) = (Proportions::by(UPPER_LIP.0 - 0.02, JAW.0), Proportions::by(UPPER_LIP.0, JAW.0 + 0.05));
        assert!((short.incisors - mean.incisors - 0.006).abs() < 1e-12 && short.tongue == mean.tongue);
        assert!((mean.tongue - long.tongue - 0.05).abs() < 1e-12 && long.incisors == mean.incisors);
        // Lengths from a bad fit have no more effect than the differences between people.
        let bad = Proportions::by(5.0, -5.0);
        assert!(
            (mean.incisors - bad.incisors - UPPER_LIP.2[1]).abs() < 1e-12 && (bad.tongue - mean.tongue - JAW.2[0]).abs() < 1e-12
        );
    }
}
