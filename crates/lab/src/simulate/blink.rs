//! Blinks: the lids close and open again in the middle of a sequence, before the apex.

use grimace::internal::wireframe::LID_MARGINS;
use nalgebra::{Point3, Vector3};
use rand::RngExt;

use super::{
    SimulateOptions,
    motion::smooth_step,
    random::{Purpose, generator},
};

/// Range for the time of closed lids, as a share of the sequence: well after the neutral frame and before the apex.
const MIDDLE: std::ops::Range<f64> = 0.3..0.6;
/// Time from open to closed, seconds.
const CLOSING_SECONDS: f64 = 0.1;
/// Shortest time from open to closed, as a share of the sequence; short sequences blink more slowly.
const SHORTEST: f64 = 0.06;
/// Shares of the gap that the upper and the lower lid close; together slightly less than the whole gap.
const LID_SHARES: [f64; 2] = [0.83, 0.14];

/// Time and duration of a blink.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blink {
    /// Frame with closed lids.
    middle: f64,
    /// Number of frames from open to closed.
    half: f64,
}

impl Blink {
    /// Returns the blink of a sequence, if it has one; [`SimulateOptions::blink`] is the probability.
    pub fn new(options: &SimulateOptions, subject: u32, emotion_code: u8) -> Option<Self> {
        let mut random = generator(options.seed, Purpose::Blink, subject, emotion_code, 0);
        let (wanted, place) = (random.random_bool(options.blink.clamp(0.0, 1.0)), random.random_range(MIDDLE));
        let last = (options.frames - 1) as f64;
        let half = (CLOSING_SECONDS * options.fps).max(SHORTEST * last).min(MIDDLE.start * last);
        wanted.then_some(Self { middle: place * last, half })
    }

    /// Returns the closure of the lids at a time in frames, from 0 (open) to 1 (closed).
    pub fn closure(&self, time: f64) -> f64 {
        smooth_step((1.0 - (time - self.middle).abs() / self.half).max(0.0))
    }
}

/// Moves the lids towards each other by changing `offsets` from `neutral`, in face space.
pub fn close_lids(neutral: &[Point3<f64>], offsets: &mut [Vector3<f64>], closure: f64) {
    for [upper, lower] in LID_MARGINS {
        // The corners of the eyes stay in place.
        for (&u, &l) in upper.iter().zip(&lower).skip(1).take(3) {
            let (u, l) = (usize::from(u), usize::from(l));
            let gap = (neutral[l] + offsets[l]) - (neutral[u] + offsets[u]);
            offsets[u] += gap * (LID_SHARES[0] * closure);
            offsets[l] -= gap * (LID_SHARES[1] * closure);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::Emotion;
    use grimace::internal::wireframe::Wireframe;

    #[test]
    fn lids_shut_in_the_middle_and_are_open_at_both_ends() {
        let options = SimulateOptions { blink: 1.0, ..SimulateOptions::default() };
        let last = (options.frames - 1) as f64;
        for subject in 0..40 {
            let blink = Blink::new(&options, subject, Emotion::Fear.code()).unwrap();
            assert!(blink.closure(0.0) == 0.0 && blink.closure(last) == 0.0);
            let most = (0..options.frames).map(|k| blink.closure(k as f64)).fold(0.0, f64::max);
            assert!(most > 0.85, "{most}");
        }
        let none = SimulateOptions { blink: 0.0, ..options };
        assert_eq!(Blink::new(&none, 0, 1), None);
    }

    #[test]
    fn shut_lids_nearly_meet() {
        let wireframe = Wireframe::candide3();
        let neutral = wireframe.vertices();
        let mut offsets = vec![Vector3::zeros(); neutral.len()];
        close_lids(neutral, &mut offsets, 1.0);
        let gap = |o: &[Vector3<f64>]| ((neutral[21] + o[21]) - (neutral[22] + o[22])).norm();
        // 1 - 0.83 - 0.14 = 0.03 of the gap remains.
        assert!((gap(&offsets) / gap(&vec![Vector3::zeros(); neutral.len()]) - 0.03).abs() < 1e-9);
        assert_eq!(offsets[20], Vector3::zeros());
    }
}
