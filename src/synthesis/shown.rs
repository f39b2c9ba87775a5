//! Detects motion that a bank cannot show: frames in which nothing moves, and motion limited by points that should rest.

use super::{
    FpMotion, FrameAnswer, Solver, Synthesizer,
    target::{REST_REACH, staying_points},
};
use crate::units::FeaturePoint;

/// Motion that a bank cannot show at all: in some frames the face or a region of it stays at rest.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Unshown {
    /// Names of regions that rest in some frame although the target moves there.
    pub regions: Vec<&'static str>,
    /// Number of frames in which one of them rests.
    pub frames: usize,
    /// Number of frames whose target moves.
    pub moving: usize,
}

/// Fraction of the target's length from which a motion counts as fully shown.
const SHOWN: f64 = 0.9;

/// Motion that a bank shows only in part, because it would also move points that should rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct HeldBack {
    /// The point that should rest and moves most.
    pub point: FeaturePoint,
    /// Frame index, from 0.
    pub frame: usize,
    /// Its motion, in the bank's unit.
    pub moved: f64,
    /// The longest target motion in that frame.
    pub asked: f64,
    /// Share of the motion shown in that frame ([`FrameAnswer::shown`]).
    pub shown: f64,
}

impl Synthesizer<'_> {
    /// Finds regions that rest although their target moves; `None` if there are none.
    pub(crate) fn unshown(&self, answers: &[FrameAnswer]) -> Option<Unshown> {
        if self.options().solver == Solver::Rbf {
            return None;
        }
        let rests = |answer: &FrameAnswer, region: usize| {
            answer.region_fitness[region].is_some() && answer.weights[region].iter().all(|w| *w == 0.0)
        };
        let regions: Vec<usize> = (0..self.regions().count()).filter(|&r| answers.iter().any(|a| rests(a, r))).collect();
        let frames = answers.iter().filter(|a| regions.iter().any(|&r| rests(a, r))).count();
        let moving = answers.iter().filter(|a| a.fitness.is_some()).count();
        let names = self.regions().scheme().names();
        (frames > 0).then(|| Unshown { regions: regions.into_iter().map(|r| names[r]).collect(), frames, moving })
    }

    /// Finds motion limited by points that should rest, and returns the frame with the longest target motion among those
    /// affected. `motions` are as given, not emphasized.
    pub(crate) fn held_back(&self, answers: &[FrameAnswer], motions: &[FpMotion]) -> Option<HeldBack> {
        if self.options().solver == Solver::Rbf {
            return None;
        }
        let count = self.bank().feature_points().len();
        let mut held: Option<HeldBack> = None;
        for (frame, (answer, motion)) in answers.iter().zip(motions).enumerate() {
            let motion = motion.emphasized(self.options().emphasis);
            let points = self.joined_motion(&answer.weights);
            let length = |[x, y, z]: [f64; 3]| x.hypot(y).hypot(if motion.planar { 0.0 } else { z });
            let moving: Vec<(usize, f64)> = self
                .moving_points(&motion, &|_| true)
                .into_iter()
                .filter_map(|point| Some((point, length(motion.offsets[point]?.into()))))
                .collect();
            let asked = moving.iter().map(|m| m.1).fold(0.0, f64::max);
            let all: f64 = moving.iter().map(|m| m.1).sum();
            let length_share = moving.iter().map(|m| length(points[m.0])).sum::<f64>() / all;
            let rest = staying_points(&motion, count, &|_| true).into_iter().map(|point| (point, length(points[point])));
            let (Some((point, moved)), Some(shown)) = (rest.max_by(|a, b| a.1.total_cmp(&b.1)), answer.shown) else { continue };
            // The motion of the point if the motion were scaled to the target's length.
            let would_tear = moved > 0.99 * REST_REACH * asked * length_share;
            if length_share < SHOWN && would_tear && held.as_ref().is_none_or(|h| asked > h.asked) {
                held = Some(HeldBack { point: self.bank().feature_points()[point].fp, frame, moved, asked, shown });
            }
        }
        held
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::synthesis::{Bank, BankInfo, RegionScheme, SynthesisOptions, testing};

    /// Answers of the bank's first two members, right and up, to one motion of all three feature points.
    fn answered(offset: Vector3<f64>, solver: Solver, smoothing_frames: f64) -> (Vec<FrameAnswer>, Option<Unshown>) {
        let bank = testing::bank().select(&[0, 1]).unwrap();
        let options = SynthesisOptions { solver, smoothing_frames, bound_starts: 0, ..SynthesisOptions::default() };
        let synthesizer = Synthesizer::new(&bank, options).unwrap();
        let motion = |share: f64| FpMotion { offsets: vec![Some(offset * share); 3], planar: true };
        let answers = synthesizer.animate(&[motion(0.0), motion(0.5), motion(1.0)], || {});
        let unshown = synthesizer.unshown(&answers);
        (answers, unshown)
    }

    #[test]
    fn a_motion_that_no_mixture_shows_leaves_the_face_at_rest() {
        for solver in [Solver::Best, Solver::Nnls, Solver::Ga, Solver::Refined, Solver::Cosine] {
            for smoothing in [0.0, 2.0] {
                // The opposite direction would need subtraction: the cosine of the answers would be -1 or 0.
                for away in [Vector3::new(-1.0, -1.0, 0.0), Vector3::new(-1.0, 0.0, 0.0)] {
                    let (answers, unshown) = answered(away, solver, smoothing);
                    assert!(answers.iter().flat_map(|a| a.weights.iter().flatten()).all(|w| *w == 0.0), "{solver}");
                    assert_eq!(answers.iter().map(|a| a.fitness).collect::<Vec<_>>(), [None, Some(0.0), Some(0.0)], "{solver}");
                    assert_eq!(unshown, Some(Unshown { regions: vec!["whole"], frames: 2, moving: 2 }), "{solver}");
                }
                let (answers, unshown) = answered(Vector3::new(1.0, 0.0, 0.0), solver, smoothing);
                assert!(answers[2].fitness.is_some_and(|f| f > 0.99), "{solver}");
                assert_eq!(unshown, None, "{solver}");
            }
        }
    }

    #[test]
    fn only_the_region_rests_that_cannot_be_shown() {
        // The mouth's left corner (8.3) moves left, which `right` can show; its right corner (8.4) moves the other way.
        let bank = testing::bank().select(&[0]).unwrap();
        let options = SynthesisOptions { regions: RegionScheme::Halves, bound_starts: 0, ..SynthesisOptions::default() };
        let synthesizer = Synthesizer::new(&bank, options).unwrap();
        let offsets = vec![Some(-Vector3::x()), Some(Vector3::x()), Some(Vector3::x())];
        let answers = synthesizer.animate(&[FpMotion { offsets, planar: true }], || {});
        assert_eq!(synthesizer.unshown(&answers), Some(Unshown { regions: vec!["right"], frames: 1, moving: 1 }));
        assert_eq!(answers[0].weights[0], [0.0]);
        assert!((answers[0].weights[1][0] - 1.0).abs() < 1e-9, "{:?}", answers[0].weights);
    }

    #[test]
    fn a_direction_without_a_length_is_no_answer() {
        // An upper lid moves down and the lower one equally far up. `lid` moves the lower one sideways; `stray` moves both
        // exactly as required, by a hundredth, and a point that should rest by much more.
        let mesh = testing::bank().mesh().clone();
        let (zero, lid) = ([0.0; 3], [[0.0, -1.0, 0.0], [0.3, 0.1, 0.0], [0.0; 3]]);
        let stray = [[0.0, -0.01, 0.0], [0.0, 0.01, 0.0], [0.5, 0.0, 0.0]];
        let displacements = [lid.as_slice(), &[zero], &stray, &[zero]].concat();
        let names = ["lid", "stray"].map(str::to_owned).to_vec();
        let points = testing::bank().feature_points().to_vec();
        let bank = Bank::new(mesh, names, displacements, points, BankInfo::default()).unwrap();
        let synthesizer = Synthesizer::new(&bank, SynthesisOptions { bound_starts: 0, ..SynthesisOptions::default() }).unwrap();
        let offsets = vec![Some(-Vector3::y()), Some(Vector3::y()), Some(Vector3::zeros())];
        let answer = &synthesizer.animate(&[FpMotion { offsets, planar: true }], || {})[0];
        let weights = &answer.weights[0];
        assert!(weights[0] > 1.0, "{weights:?}");
        assert!(answer.fitness.is_some_and(|fitness| fitness > 0.5), "{answer:?}");
    }
}
