//! Accuracy of action unit intensities on landmarks.
//!
//! Heads of a dense face model show several action units at once while they turn. A perspective camera sees them as 68 landmarks with
//! noise; the measured intensities are compared with the strengths that made the frames.

use std::path::Path;

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::{
    Cell, EvaluateError, Table,
    heads::{Camera, Faces},
    pose::{failed, tracked},
};
use grimace::internal::{
    dataset::{LandmarkFrame, LandmarkSelection, LandmarkSequence},
    features::{ACTION_UNITS, ActionUnit, FULL, FrameFeatures, Intensity},
    pipeline::{SequenceFailure, Workbench},
    pose::PoseError,
    report::Stage,
    sequence::Clock,
    track::seconds_of,
};

/// FACS numbers of the action units in the reported mean correlation.
const JUDGED: [u8; 10] = [1, 2, 4, 5, 10, 12, 15, 20, 26, 45];
/// Share of the frames in which an action unit is active.
const ACTIVE: f64 = 0.3;
/// True intensity, 0 to 5, from which an action unit should count as present.
const SHOWN: f64 = 1.5;
/// True intensity below which it should not.
const ABSENT: f64 = 0.5;
/// Frames a second.
pub(super) const FPS: f64 = 30.0;
/// Shortest and longest duration of a burst, frames.
const BURST: (usize, usize) = (8, 24);

/// Options of the study.
#[derive(Clone, Debug)]
pub struct ActionUnitOptions {
    /// Number of heads.
    pub heads: usize,
    /// First identity mode of the heads; 15 leaves out the modes that the shipped head was learned from.
    pub first_mode: usize,
    /// Frames of a sequence.
    pub frames: usize,
    /// Standard deviation of the landmarks' error, px at an eye distance of 110 px.
    pub noise_px: f64,
    /// Largest yaw and pitch, degrees.
    pub turn: f64,
    /// Distance of the camera, in px at an eye distance of 110 px.
    pub camera: f64,
    /// Marks of the neutral frame, in the study through images.
    pub marks: LandmarkSelection,
    /// Seed of the heads, strengths and noise.
    pub seed: u64,
}

impl Default for ActionUnitOptions {
    fn default() -> Self {
        Self {
            heads: 5,
            first_mode: 15,
            frames: 120,
            noise_px: 0.4,
            turn: 10.0,
            camera: 1200.0,
            marks: LandmarkSelection::Default,
            seed: 1,
        }
    }
}

/// Accuracy of one action unit on one head.
#[derive(Clone, Debug)]
pub struct ActionUnitTrial {
    /// Number of the action unit in FACS.
    pub number: u8,
    /// Name of the action unit.
    pub name: &'static str,
    /// Index of the head.
    pub head: usize,
    /// Pearson correlation of measured and true intensity over the frames.
    pub correlation: f64,
    /// Mean absolute error of the intensity, on the scale 0 to 5.
    pub error: f64,
    /// Share of the frames whose error is below the expected error; 0.5 is ideal.
    pub within: f64,
    /// Share of the frames with a true intensity of at least 1.5 in which the unit counts as present; NaN if there are none.
    pub found: f64,
    /// Share of the frames with a true intensity below 0.5 in which the unit counts as present; NaN if there are none.
    pub false_alarms: f64,
}

/// Runs the study; `bench` must remove the head pose.
///
/// # Errors
/// [`EvaluateError`] when the face model cannot be read or a sequence fails.
pub fn evaluate_action_units(
    folder: &Path,
    bench: &Workbench,
    options: &ActionUnitOptions,
    tick: impl Fn() -> bool + Sync,
) -> Result<Vec<ActionUnitTrial>, EvaluateError> {
    let faces = Faces::read(folder)?;
    let mut random = ChaCha8Rng::seed_from_u64(options.seed);
    let heads = faces.heads(options.heads, options.first_mode, 0.6, &mut random);
    // Parting the lips (AU 25) has no shape of its own; it results from other shapes.
    let shapes: Vec<Vec<Vector3<f64>>> = ACTION_UNITS
        .iter()
        .map(|unit| faces.expression(&unit.shapes.iter().map(|stem| (*stem, 1.0)).collect::<Vec<_>>()))
        .collect();
    let one = |(h, head): (usize, &Vec<Vector3<f64>>)| -> Result<Vec<ActionUnitTrial>, EvaluateError> {
        if !tick() {
            return Err(EvaluateError::Interrupted);
        }
        let mut random = ChaCha8Rng::seed_from_u64(options.seed);
        random.set_stream(1 + h as u64);
        let strengths: Vec<Vec<f64>> = shapes.iter().map(|_| bursts(options.frames, &mut random)).collect();
        let phases: [f64; 2] = std::array::from_fn(|_| random.random_range(0.0..std::f64::consts::TAU));
        let mut camera = Camera { distance: options.camera, noise_px: options.noise_px, random: &mut random };
        let frames = (0..options.frames).map(|m| {
            let mut shape = head.clone();
            for (unit, strength) in shapes.iter().zip(&strengths) {
                shape.iter_mut().zip(unit).for_each(|(x, d)| *x += d * strength[m]);
            }
            // The head faces the camera in the neutral frame and starts to turn gradually.
            let begun = (m as f64 / 10.0).min(1.0);
            let angle = |k: usize| options.turn * begun * (m as f64 / 18.0 + phases[k]).sin();
            let points = camera.see(head, &shape, [angle(0), angle(1), 0.0]);
            LandmarkFrame { number: m as u32 + 1, points: Some(points) }
        });
        let sequence = LandmarkSequence { frames: frames.collect() };
        let (track, marks) = tracked(&sequence, bench).map_err(|f| failed(&f))?;
        let pose_failed = |e: PoseError| failed(&SequenceFailure::at(Stage::Normalize)(e));
        let fit = bench.fit_head(&track, &marks).map_err(pose_failed)?;
        let frontal = bench.frontal_model(&fit, &track).map_err(pose_failed)?;
        let features = bench
            .features(&track, &fit, &frontal, &seconds_of(&track, &Clock::even(Some(FPS))))
            .map_err(|reason| EvaluateError::Sequences { reason })?;
        let seen = ACTION_UNITS.iter().zip(&strengths).filter(|(unit, _)| !unit.shapes.is_empty());
        Ok(seen.map(|(unit, truth)| judge(h, unit, truth, &features)).collect())
    };
    let trials = heads.par_iter().enumerate().map(one).collect::<Result<Vec<_>, _>>()?;
    Ok(trials.into_iter().flatten().collect())
}

/// Compares measured intensities with the strengths that made the frames.
pub(super) fn judge(head: usize, unit: &ActionUnit, truth: &[f64], features: &[FrameFeatures]) -> ActionUnitTrial {
    let of = |f: &FrameFeatures| f.action_units.iter().find(|found| found.number == unit.number).copied();
    let measured: Vec<Intensity> = features.iter().filter_map(of).collect();
    let off: Vec<f64> = measured.iter().zip(truth).map(|(found, s)| (found.value - FULL * s).abs()).collect();
    let count = off.len() as f64;
    let present_among = |counts: &dyn Fn(f64) -> bool| {
        let among: Vec<bool> =
            measured.iter().zip(truth).filter(|(_, s)| counts(FULL * **s)).map(|(u, _)| u.is_present()).collect();
        among.iter().filter(|present| **present).count() as f64 / among.len() as f64
    };
    ActionUnitTrial {
        number: unit.number,
        name: unit.name,
        head,
        correlation: correlation(&measured.iter().map(|found| found.value).collect::<Vec<_>>(), truth),
        error: off.iter().sum::<f64>() / count,
        within: off.iter().zip(&measured).filter(|(off, found)| **off <= found.expected_error).count() as f64 / count,
        found: present_among(&|intensity| intensity >= SHOWN),
        false_alarms: present_among(&|intensity| intensity < ABSENT),
    }
}

/// Returns a strength over time: rest, and smooth bursts of random height. The first frame is neutral.
pub(super) fn bursts(frames: usize, random: &mut ChaCha8Rng) -> Vec<f64> {
    let mut course = vec![0.0; frames];
    let mut at = 2 + random.random_range(0..BURST.1);
    while at < frames {
        let length = random.random_range(BURST.0..=BURST.1);
        let height = random.random_range(0.3..=1.0);
        for (k, value) in course.iter_mut().skip(at).take(length).enumerate() {
            let part = (k as f64 + 1.0) / (length as f64 + 1.0);
            *value = height * (std::f64::consts::PI * part).sin().powi(2);
        }
        let rest = length as f64 * (1.0 - ACTIVE) / ACTIVE;
        at += length + (rest * random.random_range(0.5..=1.5)) as usize;
    }
    course
}

/// Returns the Pearson correlation, or 0 when one of the two is constant.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().max(1) as f64;
    let (ma, mb) = (a.iter().sum::<f64>() / n, b.iter().sum::<f64>() / n);
    let sum = |f: &dyn Fn(f64, f64) -> f64| a.iter().zip(b).map(|(x, y)| f(x - ma, y - mb)).sum::<f64>();
    let (xy, xx, yy) = (sum(&|x, y| x * y), sum(&|x, _| x * x), sum(&|_, y| y * y));
    if xx > 0.0 && yy > 0.0 { xy / (xx * yy).sqrt() } else { 0.0 }
}

/// Returns a table with one row for each action unit.
pub fn action_unit_table(trials: &[ActionUnitTrial]) -> Table {
    let mut table = Table::new([
        "action unit",
        "name",
        "heads",
        "correlation",
        "worst",
        "mean error (0 to 5)",
        "within the expected error",
        "present at 1.5 and more",
        "present below 0.5",
        "judged",
    ]);
    for unit in &ACTION_UNITS {
        let of: Vec<&ActionUnitTrial> = trials.iter().filter(|t| t.number == unit.number).collect();
        if of.is_empty() {
            continue;
        }
        let mean = |f: &dyn Fn(&ActionUnitTrial) -> f64| of.iter().map(|t| f(t)).sum::<f64>() / of.len() as f64;
        let known = |f: &dyn Fn(&ActionUnitTrial) -> f64| {
            let known: Vec<f64> = of.iter().map(|t| f(t)).filter(|share| share.is_finite()).collect();
            known.iter().sum::<f64>() / known.len() as f64
        };
        table.rows.push(vec![
            Cell::Count(usize::from(unit.number)),
            Cell::text(unit.name),
            Cell::Count(of.len()),
            Cell::Number(mean(&|t| t.correlation), 3),
            Cell::Number(of.iter().map(|t| t.correlation).fold(f64::INFINITY, f64::min), 3),
            Cell::Number(mean(&|t| t.error), 2),
            Cell::Number(mean(&|t| t.within), 2),
            Cell::Number(known(&|t| t.found), 2),
            Cell::Number(known(&|t| t.false_alarms), 2),
            Cell::text(if JUDGED.contains(&unit.number) { "yes" } else { "" }),
        ]);
    }
    table
}

/// Returns the mean correlation of the action units in `JUDGED`.
pub fn judged_mean(trials: &[ActionUnitTrial]) -> f64 {
    let of: Vec<f64> = trials.iter().filter(|t| JUDGED.contains(&t.number)).map(|t| t.correlation).collect();
    of.iter().sum::<f64>() / of.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correlations_are_pearsons() {
        // The points (-1, 1), (0, 3), (1, 5) lie on one line; with (1, 0, 1) there is no correlation.
        assert!((correlation(&[-1.0, 0.0, 1.0], &[1.0, 3.0, 5.0]) - 1.0).abs() < 1e-12);
        assert!(correlation(&[-1.0, 0.0, 1.0], &[1.0, 0.0, 1.0]).abs() < 1e-12);
        assert_eq!(correlation(&[2.0, 2.0], &[1.0, 0.0]), 0.0);
    }

    #[test]
    fn strengths_begin_neutral_and_stay_between_none_and_full() {
        let course = bursts(200, &mut ChaCha8Rng::seed_from_u64(3));
        assert_eq!(course[0], 0.0);
        assert!(course.iter().all(|s| (0.0..=1.0).contains(s)));
        let active = course.iter().filter(|s| **s > 0.0).count() as f64 / 200.0;
        assert!((0.15..0.45).contains(&active), "{active}");
    }
}
