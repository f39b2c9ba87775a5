//! Accuracy of action unit intensities through images.
//!
//! Simulated people show several of Candide-3's action unit vectors at once. They are rendered, marked and tracked; the measured
//! intensities are compared with the simulated strengths.

use image::DynamicImage;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::{
    EvaluateError,
    action_units::{ActionUnitOptions, ActionUnitTrial, FPS, bursts, judge},
    image_marks::marks_of_picture,
    pose::failed,
};
use crate::simulate::{SimulateOptions, SimulatedFrame, Subject, show_units};
use grimace::internal::{
    features::ACTION_UNITS,
    pipeline::{SequenceFailure, Workbench},
    pose::PoseError,
    report::Stage,
    sequence::{Clock, Frame},
    track::{seconds_of, track_sequence},
};

/// Action units by FACS number, each with the number of the Candide-3 action unit vector that shows it.
const UNITS: [(u8, u16); 8] = [(2, 5), (4, 3), (5, 10), (9, 8), (10, 0), (15, 14), (20, 2), (26, 11)];
/// FACS number of the blink, which the renderer draws by closing the lids.
const BLINK: u8 = 45;
/// Largest strength of a vector; all of Candide-3's vectors at strength 1 distort the face.
const STRONGEST: f64 = 0.6;

/// Runs the study on simulated people, seen by an orthographic camera, marked at `options.marks` and turning by up to `options.turn`.
///
/// # Errors
/// [`EvaluateError`] when a sequence fails.
pub fn evaluate_action_units_in_images(
    bench: &Workbench,
    options: &ActionUnitOptions,
    tick: impl Fn() -> bool + Sync,
) -> Result<Vec<ActionUnitTrial>, EvaluateError> {
    let one = |head: usize| -> Result<Vec<ActionUnitTrial>, EvaluateError> {
        if !tick() {
            return Err(EvaluateError::Interrupted);
        }
        one_person(head, bench, options)
    };
    let trials = (0..options.heads).into_par_iter().map(one).collect::<Result<Vec<_>, _>>()?;
    Ok(trials.into_iter().flatten().collect())
}

fn one_person(head: usize, bench: &Workbench, options: &ActionUnitOptions) -> Result<Vec<ActionUnitTrial>, EvaluateError> {
    let mut random = ChaCha8Rng::seed_from_u64(options.seed);
    random.set_stream(1 + head as u64);
    let strengths: Vec<Vec<f64>> = UNITS.iter().map(|_| bursts(options.frames, &mut random)).collect();
    let lids = bursts(options.frames, &mut random);
    let phases: [f64; 2] = std::array::from_fn(|_| random.random_range(0.0..std::f64::consts::TAU));
    let simulated = SimulateOptions { seed: options.seed, ..SimulateOptions::default() };
    let who = Subject::new(&simulated, head as u32)?;
    let seen = |m: usize| -> SimulatedFrame {
        let units: Vec<(u16, f64)> = UNITS.iter().zip(&strengths).map(|((_, auv), s)| (*auv, STRONGEST * s[m])).collect();
        // The head faces the camera in the neutral frame and starts to turn gradually.
        let begun = (m as f64 / 10.0).min(1.0);
        let angle = |k: usize| options.turn * begun * (m as f64 / 18.0 + phases[k]).sin();
        show_units(&who, &units, lids[m], [angle(0), angle(1)], &simulated, m)
    };
    let neutral = seen(0);
    let marks = marks_of_picture(&neutral.nodes, neutral.image, &options.marks, bench)?;
    let fitted = bench.fit(&marks).map_err(|e| failed(&SequenceFailure::at(Stage::Fit)(e)))?;
    let frames =
        (1..).zip(0..options.frames).map(|(number, m)| Ok(Frame::new(number, DynamicImage::ImageRgb8(seen(m).image).to_luma8())));
    let track = track_sequence(&bench.wireframe, bench.plan(), &fitted, frames, &bench.options.track, |_| true)
        .map_err(|e| failed(&SequenceFailure::at(Stage::Track)(e)))?
        .frames;
    let places: Vec<_> = marks.iter().map(|m| (m.node, m.position)).collect();
    let pose_failed = |e: PoseError| failed(&SequenceFailure::at(Stage::Normalize)(e));
    let fit = bench.fit_head(&track, &places).map_err(pose_failed)?;
    let frontal = bench.frontal_model(&fit, &track).map_err(pose_failed)?;
    let features = bench
        .features(&track, &fit, &frontal, &seconds_of(&track, &Clock::even(Some(FPS))))
        .map_err(|reason| EvaluateError::Sequences { reason })?;
    let shown = UNITS.iter().map(|(number, _)| *number).zip(&strengths).chain([(BLINK, &lids)]);
    Ok(shown
        .filter_map(|(number, truth)| Some(judge(head, ACTION_UNITS.iter().find(|u| u.number == number)?, truth, &features)))
        .collect())
}
