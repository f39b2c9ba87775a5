//! What of a mouth's inside goes by the face around it.

use crate::warp::Warp;

/// How far the upper incisors reach below the closed lips, over the eye distance (2.8 mm of a mean 63 mm between the pupils).
const UPPER_BELOW_LIPS: f64 = 0.058;
/// A lip is long or short, and shows less or more of them: its length from the base of the nose on the mean of 59 people, over the eye distance, by
/// how much less the teeth reach below a longer one, and by how much more and less at most. A mouth that gapes without any teeth is a hole.
const UPPER_LIP: (f64, f64, [f64; 2]) = (0.375, 0.30, [0.012, 0.004]);
/// Height of the tongue over the gap of the lips; it lies lower in a long jaw: length from the lips to the chin on the mean of 59 people, over the eye
/// distance, by how much less high it is in a longer one, and at most.
const TONGUE_HEIGHT: f64 = 0.56;
const JAW: (f64, f64, [f64; 2]) = (0.78, 1.0, [0.07; 2]);
/// Width of a mouth over the eye distance whose teeth are as large as the picture's, the power by which they grow with it, and the limits.
const MOUTH: (f64, f64) = (0.62, 0.6);
const TEETH_SIZES: (f64, f64) = (0.86, 1.12);

/// What of a mouth's inside goes by the face around it, which keeps it from being alike on everybody.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proportions {
    /// How far the upper incisors reach below the closed lips, over the eye distance: a short lip shows more of them.
    pub incisors: f64,
    /// Height of the tongue over the gap of the lips: it lies lower in a long jaw.
    pub tongue: f64,
}

impl Proportions {
    /// Those of a face.
    pub fn of(warp: &Warp) -> Self {
        let length = |from: usize, to: usize| warp.frame.height(&warp.nodes[to]) - warp.frame.height(&warp.nodes[from]);
        Self::by(length(6, 87) / warp.frame.eye_distance, length(40, 10) / warp.frame.eye_distance)
    }

    /// Where a face has its own piece of what is irregular: glints and teeth that are alike on everybody look drawn.
    pub fn own(&self) -> f64 {
        7.0 * (40.0 * self.incisors + 10.0 * self.tongue)
    }

    /// Those of a face whose upper lip and jaw have these lengths, over the eye distance.
    fn by(lip: f64, jaw: f64) -> Self {
        let less = |(mean, share, [more, less]): (f64, f64, [f64; 2]), length: f64| (share * (length - mean)).clamp(-more, less);
        Self { incisors: UPPER_BELOW_LIPS - less(UPPER_LIP, lip), tongue: TONGUE_HEIGHT - less(JAW, jaw) }
    }
}

/// Size of the teeth over that of the picture's: a wide mouth has larger ones, which keeps them from being alike on everybody.
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
        // What a bad fit measures changes no more than people differ.
        let bad = Proportions::by(5.0, -5.0);
        assert!(
            (mean.incisors - bad.incisors - UPPER_LIP.2[1]).abs() < 1e-12 && (bad.tongue - mean.tongue - JAW.2[0]).abs() < 1e-12
        );
    }
}
