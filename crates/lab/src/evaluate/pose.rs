//! Effect of head turns on normalized models, and accuracy of the head pose.
//!
//! Heads of a dense face model show an expression, once still and once turning. A perspective camera sees them as 68 landmarks, which are
//! processed like any sequence of landmarks. *Motion lost to the head* is the mean distance of the nodes of the two normalized apex models,
//! divided by the mean motion of the still one.

use std::path::Path;

use nalgebra::{Point2, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::{
    Cell, EvaluateError, Table,
    heads::{Camera, Faces},
};
use grimace::internal::{
    dataset::{LandmarkFrame, LandmarkSelection, LandmarkSequence},
    model::DynamicExpressionModel,
    normalize::{FRAMES_PER_MODEL, PoseMode},
    pipeline::{SequenceFailure, Workbench, fit_landmarks},
    pose::{HeadPose, PoseError},
    report::Stage,
    track::{TrackedFrame, track_model},
    units::{FaceUnit, NodeId, Px},
};

/// Expressions: shapes (both sides, where there are two) and their strengths.
const EXPRESSIONS: [(&str, &[(&str, f64)]); 4] = [
    ("happiness", &[("mouthSmile", 0.9), ("cheekSquint", 0.7), ("eyeSquint", 0.4), ("jawOpen", 0.15)]),
    ("surprise", &[("browInnerUp", 0.7), ("browOuterUp", 0.9), ("eyeWide", 0.7), ("jawOpen", 0.7)]),
    ("anger", &[("browDown", 0.9), ("eyeSquint", 0.5), ("mouthPress", 0.6), ("noseSneer", 0.3), ("mouthFrown", 0.2)]),
    ("disgust", &[("noseSneer", 0.9), ("mouthUpperUp", 0.6), ("browDown", 0.5), ("cheekSquint", 0.5), ("mouthShrugLower", 0.3)]),
];

/// A turn of the head during a sequence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurnCase {
    /// Name of the group of cases.
    pub group: &'static str,
    /// Yaw at the apex, degrees.
    pub yaw: f64,
    /// Pitch at the apex, degrees.
    pub pitch: f64,
    /// Whether the head is turned in every frame, the neutral frame included.
    pub throughout: bool,
}

pub(super) const fn case(group: &'static str, yaw: f64, pitch: f64, throughout: bool) -> TurnCase {
    TurnCase { group, yaw, pitch, throughout }
}

/// Cases of the study, the still one first.
const CASES: [TurnCase; 9] = [
    case("still", 0.0, 0.0, false),
    case("turning 10", 10.0, 0.0, false),
    case("turning 10", 0.0, 10.0, false),
    case("turning 10", 0.0, -10.0, false),
    case("turning 20/15", 20.0, 0.0, false),
    case("turning 20/15", 0.0, -15.0, false),
    case("turning 20/15", 0.0, 15.0, false),
    case("turned throughout 20/15", 20.0, 0.0, true),
    case("turned throughout 20/15", 0.0, 15.0, true),
];

/// Number of sequences of each head.
pub const LANDMARK_SEQUENCES: usize = CASES.len() * EXPRESSIONS.len();

/// Options of the study.
#[derive(Clone, Debug)]
pub struct PoseStudyOptions {
    /// Number of heads.
    pub heads: usize,
    /// First identity mode of the heads; 15 leaves out the modes that the shipped head was learned from.
    pub first_mode: usize,
    /// Standard deviation of the weights of the identity modes.
    pub spread: f64,
    /// Frames of a sequence.
    pub frames: usize,
    /// Standard deviation of the noise on the landmarks, px.
    pub noise_px: f64,
    /// Distances of the camera in px, equal to its focal length when the eyes are 110 px apart.
    pub cameras: Vec<f64>,
    /// Marks of the neutral frame, in the study through images.
    pub marks: LandmarkSelection,
    /// Seed of the heads and of the noise.
    pub seed: u64,
}

impl Default for PoseStudyOptions {
    fn default() -> Self {
        Self {
            heads: 5,
            first_mode: 0,
            spread: 0.6,
            frames: 9,
            noise_px: 0.0,
            cameras: vec![1200.0],
            marks: LandmarkSelection::Default,
            seed: 1,
        }
    }
}

/// Result of one sequence.
#[derive(Clone, Debug)]
pub struct PoseTrial {
    /// Turn of the head.
    pub case: TurnCase,
    /// Distance of the camera, px.
    pub camera: f64,
    /// Index of the head.
    pub head: usize,
    /// Name of the expression.
    pub expression: &'static str,
    /// Motion lost to the head: with the pose removed, and with roll alone removed.
    pub lost: [f64; 2],
    /// Largest error of yaw and pitch over the frames, relative to the neutral frame, degrees.
    pub relative_error: f64,
    /// Mean over the frames of the larger of the absolute errors of yaw and pitch, degrees.
    pub pose_error: f64,
    /// Relative change of the motion by removing the pose; meaningful for a still head.
    pub changed: f64,
    /// Mean error of the displacements of all live nodes in the last frame, percent of the eye distance; only in the study through images.
    pub tracking_percent: Option<f64>,
}

/// A sequence of landmarks with the true yaw and pitch of every frame.
struct Filmed {
    sequence: LandmarkSequence,
    truth: Vec<[f64; 2]>,
}

fn film(head: &[Vector3<f64>], apex: &[Vector3<f64>], case: &TurnCase, camera: &mut Camera<'_>, frames: usize) -> Filmed {
    let (mut seen, mut truth) = (Vec::new(), Vec::new());
    for m in 0..frames {
        let t = m as f64 / (frames - 1) as f64;
        let share = t * t * (3.0 - 2.0 * t);
        let turn = if case.throughout { 1.0 } else { share };
        let shape: Vec<Vector3<f64>> = head.iter().zip(apex).map(|(x, d)| x + d * share).collect();
        let points = camera.see(head, &shape, [case.yaw * turn, case.pitch * turn, 0.0]);
        seen.push(LandmarkFrame { number: m as u32 + 1, points: Some(points) });
        truth.push([case.yaw * turn, case.pitch * turn]);
    }
    Filmed { sequence: LandmarkSequence { frames: seen }, truth }
}

pub(super) fn failed(failure: &SequenceFailure) -> EvaluateError {
    EvaluateError::Sequences { reason: format!("{}: {}", failure.stage, failure.reason) }
}

/// A track from landmarks, and its marks.
pub(super) type Tracked = (Vec<TrackedFrame>, Vec<(NodeId, Point2<f64>)>);

pub(super) fn tracked(landmarks: &LandmarkSequence, bench: &Workbench) -> Result<Tracked, SequenceFailure> {
    let neutral = landmarks.frames[0].points.as_deref().unwrap_or_default();
    let (marks, fitted) = fit_landmarks(bench, neutral, None)?;
    let plan = bench.landmark_plan().map_err(SequenceFailure::at(Stage::Track))?;
    let track = plan.track(&bench.wireframe, &fitted, landmarks).map_err(SequenceFailure::at(Stage::Track))?;
    Ok((track, marks.iter().map(|m| (m.node, m.position)).collect()))
}

fn normalized(
    model: &DynamicExpressionModel<Px>,
    bench: &Workbench,
) -> Result<DynamicExpressionModel<FaceUnit>, SequenceFailure> {
    let normalizer = bench.normalizer().map_err(SequenceFailure::at(Stage::Normalize))?;
    normalizer.normalize(model).map_err(SequenceFailure::at(Stage::Normalize))
}

/// Returns the mean distance of the apex nodes of two models, divided by the mean motion of the first.
pub fn motion_lost(still: &DynamicExpressionModel<FaceUnit>, other: &DynamicExpressionModel<FaceUnit>, bench: &Workbench) -> f64 {
    let apex = FRAMES_PER_MODEL - 1;
    let (a, b) = (still.neutral_offsets(apex), other.neutral_offsets(apex));
    let live = bench.wireframe.live_nodes();
    let distance: f64 = live.iter().map(|n| (a[n.index()] - b[n.index()]).norm()).sum();
    let motion: f64 = live.iter().map(|n| a[n.index()].norm()).sum();
    distance / motion
}

/// Normalized models of the still head: with the pose removed, and with roll alone removed.
pub(super) type Still = Option<[DynamicExpressionModel<FaceUnit>; 2]>;

/// The conditions of a trial.
pub(super) struct SeenCase<'a> {
    pub case: TurnCase,
    pub camera: f64,
    pub head: usize,
    pub expression: &'static str,
    /// True yaw and pitch of every frame, degrees.
    pub truth: &'a [[f64; 2]],
}

/// Compares a track with that of the still head; the first call sets `still`.
pub(super) fn judge(
    seen: &SeenCase<'_>,
    (track, marks): (&[TrackedFrame], &[(NodeId, Point2<f64>)]),
    full: &Workbench,
    roll: &Workbench,
    still: &mut Still,
) -> Result<PoseTrial, EvaluateError> {
    let pose_failed = |e: PoseError| failed(&SequenceFailure::at(Stage::Normalize)(e));
    let fit = full.fit_head(track, marks).map_err(pose_failed)?;
    let frontal = full.frontal_model(&fit, track).map_err(pose_failed)?;
    let plain = track_model(track).map_err(|e| failed(&SequenceFailure::at(Stage::Normalize)(e)))?;
    let models = [normalized(&frontal, full).map_err(|f| failed(&f))?, normalized(&plain, roll).map_err(|f| failed(&f))?];
    let changed = motion_lost(&models[1], &models[0], full);
    let reference = still.get_or_insert_with(|| models.clone());
    let lost = [0, 1].map(|k| motion_lost(&reference[k], &models[k], full));
    let found: Vec<[f64; 3]> = fit.poses.iter().map(HeadPose::degrees).collect();
    let off = |m: usize, k: usize| found[m][k] - seen.truth[m][k];
    let error = |m: usize, zero: [f64; 2]| (0..2).map(|k| (off(m, k) - zero[k]).abs()).fold(0.0, f64::max);
    let zero = [off(0, 0), off(0, 1)];
    let frames = seen.truth.len();
    Ok(PoseTrial {
        case: seen.case,
        camera: seen.camera,
        head: seen.head,
        expression: seen.expression,
        lost,
        relative_error: (0..frames).map(|m| error(m, zero)).fold(0.0, f64::max),
        pose_error: (0..frames).map(|m| error(m, [0.0; 2])).sum::<f64>() / frames as f64,
        changed,
        tracking_percent: None,
    })
}

/// Runs the study. `full` and `roll` are workbenches that differ in the pose mode only.
///
/// # Errors
/// [`EvaluateError`] when the face model cannot be read, or a sequence fails.
pub fn evaluate_pose(
    folder: &Path,
    full: &Workbench,
    roll: &Workbench,
    options: &PoseStudyOptions,
    tick: impl Fn() -> bool + Sync,
) -> Result<Vec<PoseTrial>, EvaluateError> {
    debug_assert!(full.options.normalize.pose == PoseMode::Full && roll.options.normalize.pose == PoseMode::Roll);
    let faces = Faces::read(folder)?;
    let mut random = ChaCha8Rng::seed_from_u64(options.seed);
    let heads = faces.heads(options.heads, options.first_mode, options.spread, &mut random);
    let count = heads.len() * EXPRESSIONS.len();
    let work: Vec<(f64, usize)> = options.cameras.iter().flat_map(|&camera| (0..count).map(move |k| (camera, k))).collect();
    let one = |&(camera, k): &(f64, usize)| -> Result<Vec<PoseTrial>, EvaluateError> {
        let (h, (name, recipe)) = (k / EXPRESSIONS.len(), EXPRESSIONS[k % EXPRESSIONS.len()]);
        let apex = faces.expression(recipe);
        let mut random = ChaCha8Rng::seed_from_u64(options.seed);
        random.set_stream(1 + k as u64);
        let mut trials = Vec::new();
        let mut still: Option<[DynamicExpressionModel<FaceUnit>; 2]> = None;
        for case in CASES {
            if !tick() {
                return Err(EvaluateError::Interrupted);
            }
            let mut camera = Camera { distance: camera, noise_px: options.noise_px, random: &mut random };
            let filmed = film(&heads[h], &apex, &case, &mut camera, options.frames);
            let (track, marks) = tracked(&filmed.sequence, full).map_err(|f| failed(&f))?;
            let seen = SeenCase { case, camera: camera.distance, head: h, expression: name, truth: &filmed.truth };
            trials.push(judge(&seen, (&track, &marks), full, roll, &mut still)?);
        }
        Ok(trials)
    };
    let trials = work.par_iter().map(one).collect::<Result<Vec<_>, _>>()?;
    Ok(trials.into_iter().flatten().collect())
}

/// Returns a row for each group of cases.
pub fn pose_table(trials: &[PoseTrial]) -> Table {
    let mut table = Table::new([
        "camera (px)",
        "case",
        "sequences",
        "motion lost",
        "worst",
        "motion lost, roll only",
        "pose error (degrees)",
        "worst pose error",
        "turn error",
        "worst turn error",
        "tracking error (% ES)",
    ]);
    let mut groups: Vec<(f64, &str)> = Vec::new();
    for t in trials {
        if !groups.contains(&(t.camera, t.case.group)) {
            groups.push((t.camera, t.case.group));
        }
    }
    for (camera, group) in groups {
        let of: Vec<&PoseTrial> = trials.iter().filter(|t| t.camera == camera && t.case.group == group).collect();
        let mean = |f: &dyn Fn(&PoseTrial) -> f64| of.iter().map(|t| f(t)).sum::<f64>() / of.len() as f64;
        let worst = |f: &dyn Fn(&PoseTrial) -> f64| of.iter().map(|t| f(t)).fold(0.0, f64::max);
        // For still heads the table shows the change by removing the pose.
        let lost = |t: &PoseTrial| if group == "still" { t.changed } else { t.lost[0] };
        table.rows.push(vec![
            Cell::Number(camera, 0),
            Cell::text(group),
            Cell::Count(of.len()),
            Cell::Number(mean(&lost), 3),
            Cell::Number(worst(&lost), 3),
            Cell::Number(mean(&|t| t.lost[1]), 3),
            Cell::Number(mean(&|t| t.pose_error), 2),
            Cell::Number(worst(&|t| t.pose_error), 2),
            Cell::Number(mean(&|t| t.relative_error), 2),
            Cell::Number(worst(&|t| t.relative_error), 2),
            Cell::maybe(of[0].tracking_percent.map(|_| mean(&|t| t.tracking_percent.unwrap_or(f64::NAN))), 2),
        ]);
    }
    table
}

/// Returns a row for each sequence.
pub fn pose_trials_table(trials: &[PoseTrial]) -> Table {
    let mut table = Table::new([
        "camera_px",
        "head",
        "expression",
        "case",
        "yaw",
        "pitch",
        "throughout",
        "motion_lost",
        "motion_lost_roll_only",
        "pose_error_degrees",
        "turn_error_degrees",
        "changed_against_roll_only",
        "tracking_error_percent_es",
    ]);
    for t in trials {
        table.rows.push(vec![
            Cell::Number(t.camera, 0),
            Cell::Count(t.head),
            Cell::text(t.expression),
            Cell::text(t.case.group),
            Cell::Number(t.case.yaw, 0),
            Cell::Number(t.case.pitch, 0),
            Cell::text(t.case.throughout.to_string()),
            Cell::Number(t.lost[0], 4),
            Cell::Number(t.lost[1], 4),
            Cell::Number(t.pose_error, 3),
            Cell::Number(t.relative_error, 3),
            Cell::Number(t.changed, 4),
            Cell::maybe(t.tracking_percent, 3),
        ]);
    }
    table
}
