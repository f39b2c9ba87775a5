//! Presence of action units in films: a unit is present, or not, over a whole bout.
//!
//! In a single frame another unit often explains the face nearly as well. But muscles do not change from frame to frame: frames in a row in
//! which the intensity of a unit, which is measured over time, is at least [`PRESENT`], are one bout, and are judged together.

use super::{
    action_units::{Intensity, PRESENT},
    strengths::seconds_between,
};

/// A bout has the evidence that one in so many of its frames reaches. Over all frames of simulated faces with true intensities of 1.5 and
/// more (units and heads pooled), 52 to 56 % count as present when judged alone, 52 to 58 % when half of a bout decides, 60 to 64 % when a third
/// does, and 67 to 76 % when one frame does; but then noise makes four times as many false ones.
const ONE_IN: usize = 3;

/// Gives every frame of a bout of a unit the evidence of the bout. Frames are in order of time, with a time or `None` for each; those without
/// a time, or not later than the one before, are bouts of their own.
pub(super) fn share(frames: &mut [Vec<Intensity>], seconds: &[Option<f64>]) {
    let follows = |k: usize| seconds_between(seconds[k - 1], seconds[k]).is_some();
    let units = frames.iter().map(Vec::len).min().unwrap_or(0);
    for unit in 0..units {
        let mut start = 0;
        while start < frames.len() {
            let is_up = |k: usize| frames[k][unit].value >= PRESENT;
            let mut end = start + 1;
            while is_up(start) && end < frames.len() && follows(end) && is_up(end) {
                end += 1;
            }
            let bout = &mut frames[start..end];
            let mut evidence: Vec<f64> = bout.iter().map(|frame| frame[unit].evidence).collect();
            evidence.sort_by(|a, b| b.total_cmp(a));
            let shared = evidence[(evidence.len() - 1) / ONE_IN];
            bout.iter_mut().for_each(|frame| frame[unit].evidence = shared);
            start = end;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One unit over time, from intensities and evidence.
    fn film(course: &[(f64, f64)]) -> Vec<Vec<Intensity>> {
        let frame =
            |&(value, evidence): &(f64, f64)| vec![Intensity { number: 12, value, sides: None, expected_error: 0.2, evidence }];
        course.iter().map(frame).collect()
    }

    fn evidence(frames: &[Vec<Intensity>]) -> Vec<f64> {
        frames.iter().map(|frame| frame[0].evidence).collect()
    }

    #[test]
    fn frames_of_a_bout_have_what_a_third_of_them_reaches() {
        let course = [(1.5, 0.5), (2.0, 6.0), (1.2, 0.0), (0.9, 0.0), (1.4, 0.3)];
        let mut frames = film(&course);
        share(&mut frames, &[0.0, 0.04, 0.08, 0.12, 0.16].map(Some));
        assert_eq!(evidence(&frames), [6.0, 6.0, 6.0, 0.0, 0.3]);
        // One of four frames is less than a third.
        let mut frames = film(&[(1.5, 0.5), (2.0, 6.0), (1.2, 0.0), (1.2, 0.0)]);
        share(&mut frames, &[0.0, 0.04, 0.08, 0.12].map(Some));
        assert_eq!(evidence(&frames), [0.5; 4]);
    }

    #[test]
    fn frames_without_times_stand_alone() {
        let course = [(1.5, 0.5), (2.0, 6.0), (1.2, 0.1)];
        let never = Some(f64::NEG_INFINITY);
        for seconds in [[None; 3], [Some(0.0), None, Some(0.04)], [Some(0.0); 3], [never, never, Some(0.0)]] {
            let mut frames = film(&course);
            share(&mut frames, &seconds);
            assert_eq!(evidence(&frames), [0.5, 6.0, 0.1]);
        }
        share(&mut [], &[]);
    }
}
