//! Effect of head turns through images: simulated people are rendered, marked and tracked.

use image::DynamicImage;
use nalgebra::Point2;
use rayon::prelude::*;

use super::{
    EvaluateError,
    image_marks::marks_of_picture,
    pose::{PoseStudyOptions, PoseTrial, SeenCase, Still, TurnCase, case, failed, judge},
};
use crate::simulate::{Emotion, SimulateOptions, SimulatedSequence, Subject, TurnCourse};
use grimace::internal::{
    pipeline::{SequenceFailure, Workbench},
    report::Stage,
    sequence::Frame,
    track::{eye_distance_px, track_sequence},
    units::NodeId,
};

/// Emotions of the study.
const EMOTIONS: [(&str, Emotion); 4] = [
    ("happiness", Emotion::Happiness),
    ("surprise", Emotion::Surprise),
    ("anger", Emotion::Anger),
    ("disgust", Emotion::Disgust),
];

/// Cases of the study, the still one first; the signs of the angles depend on the seed.
const CASES: [TurnCase; 8] = [
    case("still", 0.0, 0.0, false),
    case("turning 10", 10.0, 0.0, false),
    case("turning 10", 0.0, 10.0, false),
    case("turning 15 (yaw)", 15.0, 0.0, false),
    case("turning 20/15", 20.0, 0.0, false),
    case("turning 20/15", 0.0, 15.0, false),
    case("turned throughout 20/15", 20.0, 0.0, true),
    case("turned throughout 20/15", 0.0, 15.0, true),
];

/// Number of sequences of each head.
pub const IMAGE_SEQUENCES: usize = CASES.len() * EMOTIONS.len();

/// Runs the study on simulated people, seen by an orthographic camera and marked at `options.marks`.
///
/// # Errors
/// [`EvaluateError`] when a sequence fails.
pub fn evaluate_pose_images(
    full: &Workbench,
    roll: &Workbench,
    options: &PoseStudyOptions,
    tick: impl Fn() -> bool + Sync,
) -> Result<Vec<PoseTrial>, EvaluateError> {
    let work: Vec<(usize, usize)> = (0..options.heads).flat_map(|h| (0..EMOTIONS.len()).map(move |e| (h, e))).collect();
    let one = |&(head, e): &(usize, usize)| -> Result<Vec<PoseTrial>, EvaluateError> {
        let mut still: Still = None;
        let mut trials = Vec::new();
        for case in CASES {
            if !tick() {
                return Err(EvaluateError::Interrupted);
            }
            trials.push(one_sequence(case, head, EMOTIONS[e], full, roll, options, &mut still)?);
        }
        Ok(trials)
    };
    let trials = work.par_iter().map(one).collect::<Result<Vec<_>, _>>()?;
    Ok(trials.into_iter().flatten().collect())
}

fn one_sequence(
    case: TurnCase,
    head: usize,
    (expression, emotion): (&'static str, Emotion),
    full: &Workbench,
    roll: &Workbench,
    options: &PoseStudyOptions,
    still: &mut Still,
) -> Result<PoseTrial, EvaluateError> {
    let simulated = SimulateOptions {
        frames: options.frames,
        seed: options.seed,
        roll_degrees: 0.0,
        yaw_degrees: case.yaw,
        pitch_degrees: case.pitch,
        turn: if case.throughout { TurnCourse::Throughout } else { TurnCourse::During },
        shift_px: 0.0,
        scale_change: 0.0,
        ..SimulateOptions::default()
    };
    let subject = Subject::new(&simulated, head as u32)?;
    let sequence = SimulatedSequence::new(&subject, emotion, &simulated)?;
    let neutral = sequence.nodes(0);
    let marks = marks_of_picture(&neutral, sequence.image(0), &options.marks, full)?;
    // Unmarked nodes are read from the picture, as in the tracking of any sequence.
    let first = DynamicImage::ImageRgb8(sequence.image(0)).to_luma8();
    let fitted = full.fit_in(&first, &marks).map_err(|e| failed(&SequenceFailure::at(Stage::Fit)(e)))?.fitted;
    let images = (1..)
        .zip(0..options.frames)
        .map(|(number, k)| Ok(Frame::new(number, DynamicImage::ImageRgb8(sequence.image(k)).to_luma8())));
    let track = track_sequence(&full.wireframe, full.plan(), &fitted, images, &full.options.track, |_| true)
        .map_err(|e| failed(&SequenceFailure::at(Stage::Track)(e)))?
        .frames;
    let truth: Vec<[f64; 2]> = (0..options.frames)
        .map(|k| {
            let (pitch, yaw, _) = sequence.pose(k).turn().euler_angles();
            [yaw.to_degrees(), pitch.to_degrees()]
        })
        .collect();
    let places: Vec<(NodeId, Point2<f64>)> = marks.iter().map(|m| (m.node, m.position)).collect();
    let seen = SeenCase { case, camera: f64::INFINITY, head, expression, truth: &truth };
    let mut trial = judge(&seen, (&track, &places), full, roll, still)?;
    let (first, last, apex) = (&track[0], &track[track.len() - 1], sequence.nodes(options.frames - 1));
    let live = full.wireframe.live_nodes();
    let off = |n: &NodeId| {
        let k = n.index();
        ((last.nodes[k].position - first.nodes[k].position) - (apex[k] - neutral[k])).norm()
    };
    let mean = live.iter().map(off).sum::<f64>() / live.len() as f64;
    trial.tracking_percent = eye_distance_px(&full.tables, &neutral).map(|es| 100.0 * mean / es);
    Ok(trial)
}
