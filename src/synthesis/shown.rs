//! Detects motion that a bank cannot show: frames in which nothing moves, and motion limited by points that should rest.

use nalgebra::Vector3;

use super::{
    FpMotion, FrameAnswer, RegionScheme, Regions, Solver, Synthesizer,
    target::{REST_REACH, free_points, staying_points},
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

/// Fraction of the largest motion from which a frame counts for [`HeldBack`]: what little moves in other frames is rounding, or hardly
/// seen.
const SEEN: f64 = 0.2;

/// Motion that a bank shows only in part, because it would also move points that should rest, or others too far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct HeldBack {
    /// The point that holds the motion back.
    pub point: FeaturePoint,
    /// Whether it should rest. Otherwise it is free, and its motion limited to about that of the point that should move farthest.
    pub rests: bool,
    /// Frame index, from 0.
    pub frame: usize,
    /// Its motion, in the bank's unit.
    pub moved: f64,
    /// The longest target motion in that frame.
    pub asked: f64,
    /// Share of the motion shown in that frame ([`FrameAnswer::shown`]).
    pub shown: f64,
}

/// Motion of one side over that of the other, from which a motion is on both sides.
const BOTH: f64 = 1.0 / 3.0;

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

    /// Whether a motion is on one side of the face.
    pub(crate) fn is_one_sided(&self, motions: &[FpMotion]) -> bool {
        self.is_on_one_side(motions.iter().map(|m| m.offsets.iter().map(|o| o.map_or(0.0, |v| v.norm())).collect()))
    }

    /// Whether a motion on one side of the face is answered on both sides.
    pub(crate) fn answers_both_sides(&self, answers: &[FrameAnswer], motions: &[FpMotion]) -> bool {
        self.is_one_sided(motions) && self.weaker_side(self.shown_lengths(answers, motions)) >= BOTH
    }

    /// Whether a motion on one side of the face is answered by the same on the other one: the members move both sides alike.
    pub(crate) fn answers_in_the_mirror(&self, answers: &[FrameAnswer], motions: &[FpMotion]) -> bool {
        const ALIKE: f64 = 0.8;
        self.is_one_sided(motions) && self.weaker_side(self.shown_lengths(answers, motions)) >= ALIKE
    }

    /// How far each feature point goes in every frame of an answer.
    fn shown_lengths(&self, answers: &[FrameAnswer], motions: &[FpMotion]) -> impl Iterator<Item = Vec<f64>> {
        let lengths = |points: Vec<[f64; 3]>| points.iter().map(|[x, y, z]| x.hypot(*y).hypot(*z)).collect();
        self.point_motions(answers, motions).into_iter().map(lengths)
    }

    /// Whether feature points of one side go less than a third as far as those of the other, summed over frames of their lengths.
    fn is_on_one_side(&self, lengths: impl Iterator<Item = Vec<f64>>) -> bool {
        self.weaker_side(lengths) < BOTH
    }

    /// How far the feature points of the side that moves less go, over how far those of the other go; summed over frames of their lengths.
    fn weaker_side(&self, lengths: impl Iterator<Item = Vec<f64>>) -> f64 {
        let Ok(sides) = Regions::new(self.bank(), RegionScheme::Halves, self.options().overlap) else { return 1.0 };
        let [mut right, mut left] = [0.0; 2];
        for frame in lengths {
            for (k, length) in frame.into_iter().enumerate() {
                right += length * sides.point_shares(0).get(k).copied().unwrap_or_default();
                left += length * sides.point_shares(1).get(k).copied().unwrap_or_default();
            }
        }
        if right == left { 1.0 } else { f64::min(right, left) / f64::max(right, left) }
    }

    /// Finds motion limited by points that should rest, and returns the frame with the longest target motion among those
    /// affected. Frames with less than a fifth of the largest motion do not count. `motions` are as given, not emphasized.
    pub(crate) fn held_back(&self, answers: &[FrameAnswer], motions: &[FpMotion]) -> Option<HeldBack> {
        if self.options().solver == Solver::Rbf {
            return None;
        }
        let count = self.bank().feature_points().len();
        let mut held: Option<HeldBack> = None;
        // Of the motions as given: the emphasis is the same in all frames.
        let farthest = |motion: &FpMotion| {
            let length = |v: &Vector3<f64>| if motion.planar { v.xy().norm() } else { v.norm() };
            motion.offsets.iter().flatten().map(length).fold(0.0, f64::max)
        };
        let least = SEEN * motions.iter().map(farthest).fold(0.0, f64::max);
        for (frame, (answer, motion)) in answers.iter().zip(motions).enumerate().filter(|(_, (_, m))| farthest(m) >= least) {
            let motion = motion.emphasized(self.options().emphasis);
            let points = self.joined_motion(&answer.weights);
            let size = |[x, y, z]: [f64; 3]| x.hypot(y).hypot(z);
            let length = |point: usize, vector: [f64; 3]| size(motion.seen(point, vector));
            let moving: Vec<(usize, f64)> = self
                .moving_points(&motion, &|_| true)
                .into_iter()
                .filter_map(|point| Some((point, length(point, motion.offsets[point]?.into()))))
                .collect();
            let asked = moving.iter().map(|m| m.1).fold(0.0, f64::max);
            let all: f64 = moving.iter().map(|m| m.1).sum();
            let length_share = moving.iter().map(|m| length(m.0, points[m.0])).sum::<f64>() / all;
            // The point that is nearest to how far it may go.
            let rest = staying_points(&motion, count, &|_| true).into_iter().map(|point| (point, true));
            let free = free_points(&motion, count, &|_| true).into_iter().map(|point| (point, false));
            let near: Vec<usize> = moving.iter().map(|m| m.0).collect();
            let reach = |point: usize, rests: bool| if rests { REST_REACH } else { self.free_reach(point, &near) };
            let used = rest.chain(free).map(|(point, rests)| {
                let vector = if rests { motion.seen(point, points[point]) } else { motion.free(point, points[point]) };
                (point, rests, size(vector) / reach(point, rests))
            });
            let (Some((point, rests, used)), Some(shown)) = (used.max_by(|a, b| a.2.total_cmp(&b.2)), answer.shown) else {
                continue;
            };
            // The motion of the point if the motion were scaled to the target's length.
            let would_tear = used > 0.99 * asked * length_share;
            if length_share < SHOWN && would_tear && held.as_ref().is_none_or(|h| asked > h.asked) {
                let (point, moved) = (self.bank().feature_points()[point].fp, used * reach(point, rests));
                held = Some(HeldBack { point, rests, frame, moved, asked, shown });
            }
        }
        held
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthesis::{Bank, BankInfo, SynthesisOptions, testing};

    /// Answers of the bank's first two members, right and up, to one motion of all three feature points.
    fn answered(offset: Vector3<f64>, solver: Solver, smoothing_frames: f64) -> (Vec<FrameAnswer>, Option<Unshown>) {
        let bank = testing::bank().select(&[0, 1]).unwrap();
        let options = SynthesisOptions { solver, smoothing_frames, bound_starts: 0, ..SynthesisOptions::default() };
        let synthesizer = Synthesizer::new(&bank, options).unwrap();
        let motion = |share: f64| FpMotion { offsets: vec![Some(offset * share); 3], planar: true, ..FpMotion::default() };
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
        let answers = synthesizer.animate(&[FpMotion { offsets, planar: true, ..FpMotion::default() }], || {});
        assert_eq!(synthesizer.unshown(&answers), Some(Unshown { regions: vec!["right"], frames: 1, moving: 1 }));
        assert_eq!(answers[0].weights[0], [0.0]);
        assert!((answers[0].weights[1][0] - 1.0).abs() < 1e-9, "{:?}", answers[0].weights);
    }

    #[test]
    fn frames_that_hardly_move_hold_nothing_back() {
        // `both` moves the corner of the mouth up and, half as far again, a point that should rest; `one` the corner alone.
        let mesh = testing::bank().mesh().clone();
        let (zero, up) = ([0.0; 3], [0.0, 1.0, 0.0]);
        let displacements = [[up, zero, [0.0, 1.5, 0.0], zero], [up, zero, zero, zero]].concat();
        let points = testing::bank().feature_points().to_vec();
        let names = ["both", "one"].map(str::to_owned).to_vec();
        let bank = Bank::new(mesh, names, displacements, points, BankInfo::default()).unwrap();
        let synthesizer = Synthesizer::new(&bank, SynthesisOptions { bound_starts: 0, ..SynthesisOptions::default() }).unwrap();
        let motion = |y: f64| FpMotion {
            offsets: vec![Some(Vector3::y() * y), Some(Vector3::zeros()), Some(Vector3::zeros())],
            planar: true,
            ..FpMotion::default()
        };
        let motions = [motion(0.1), motion(1.0)];
        // A frame shown by `both`, as far as the resting point allows, and one shown by `one` in full.
        let answer = |motion: &FpMotion, weights: [f64; 2]| {
            let mut answer = synthesizer.solve(motion, 0);
            answer.weights = vec![weights.to_vec()];
            answer.shown = Some(weights.iter().sum::<f64>() / motion.total_length());
            answer
        };
        let held = |small: [f64; 2], large: [f64; 2]| {
            synthesizer.held_back(&[answer(&motions[0], small), answer(&motions[1], large)], &motions)
        };
        assert_eq!(held([0.033, 0.0], [0.0, 1.0]), None);
        let found = held([0.0, 0.1], [0.33, 0.0]).unwrap();
        assert!(found.frame == 1 && found.rests && (found.shown - 0.33).abs() < 1e-9, "{found:?}");
        // A side that moves less than a third as far as the other is at rest beside it: the points are on the left, the right and the left.
        let side = |left: f64, right: f64| FpMotion {
            offsets: [right, left, 0.0].map(|y| Some(Vector3::y() * y)).to_vec(),
            planar: true,
            ..FpMotion::default()
        };
        assert!(synthesizer.is_one_sided(&[side(1.0, 0.2)]) && !synthesizer.is_one_sided(&[side(1.0, 0.5)]));
        // `one` moves the right alone; the bank has nothing for the left.
        let right = side(0.0, 1.0);
        assert!(!synthesizer.answers_both_sides(&[answer(&right, [0.0, 1.0])], std::slice::from_ref(&right)));
        assert!(synthesizer.answers_both_sides(&[answer(&right, [1.0, 0.0])], std::slice::from_ref(&right)));
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
        let answer = &synthesizer.animate(&[FpMotion { offsets, planar: true, ..FpMotion::default() }], || {})[0];
        let weights = &answer.weights[0];
        assert!(weights[0] > 1.0, "{weights:?}");
        assert!(answer.fitness.is_some_and(|fitness| fitness > 0.5), "{answer:?}");
    }
}
