//! Measures every frame of a track: the head's pose, FAPs, action units, openings of eyes and mouth.
//!
//! Everything except the pose is measured relative to the neutral frame on the track without head motion, in the proportions of the
//! canonical face. Values of people with different sizes and proportions are therefore comparable.

mod action_units;
mod alignment;
mod blendshapes;
mod course;
mod facs;
mod file;
mod in_time;
mod openface;
mod presence;
mod strengths;
mod warnings;

use std::cmp::Ordering;

use nalgebra::{Point2, Vector2};

use crate::{
    dataset::LANDMARK_COUNT,
    fap::{ANGLE_UNIT_RAD, ConvertError, FapCatalog, FapNumber, unlimited_faps},
    model::{DynamicExpressionModel, ModelError},
    normalize::{IrisdMode, NormalizeError, NormalizeOptions, Normalizer},
    pose::{HEAD_ES, HeadFit, HeadModel},
    track::{LossReason, NodeState, TrackedFrame, eye_distance_px},
    units::{FaceUnit, NodeId},
    wireframe::{Region, Tables},
};

pub use action_units::{ActionUnits, FULL, Intensity};
use action_units::{EVIDENCE, SeenFrame};
pub use blendshapes::{COEFFICIENTS, ColumnsBeside, read_blendshapes};
pub use course::{COURSE_POINTS, Course};
pub use facs::{ACTION_UNITS, ActionUnit, LIPS_PART};
pub use file::{ColumnNames, write_features};
pub(crate) use file::{fap_column, measured, unit_column};
pub use in_time::fap_sequence;
pub(crate) use in_time::frame_steps;
use in_time::in_time;
pub(crate) use openface::{ABOUT as OPENFACE_UNITS, OpenFaceFace, OpenFaceRow, openface_csv};
pub use warnings::{apex_warning, order_warning, pose_warning, turn_warning};

/// Yaw or pitch, degrees, up to which a frame's values are reliable.
pub const TRUSTED_TURN: f64 = 25.0;
/// Yaw or pitch, degrees, beyond which nothing is measured: half of the face is hidden.
pub const MEASURED_TURN: f64 = 40.0;
/// Expected error of a node in a track without expected errors, share of the eye distance.
const NODE_ERROR: f64 = 0.01;
/// Upper and lower lid of the left and the right eye, inner upper and lower lip.
const LIDS: [[usize; 2]; 2] = [[21, 22], [54, 55]];
const LIPS: [usize; 2] = [87, 40];
/// Number of the action unit that raises the upper lids.
const UPPER_LIDS: u8 = 5;
/// Number of the action unit that closes the eyes.
const BLINK: u8 = 45;
/// Opening below which an eye closes, relative to the neutral frame. A blink of intensity 1, the least that is present, closes a fifth.
const CLOSING: f64 = 0.9;
/// The top of the skull, which lies on hair or beyond the picture: no muscle moves it, and its track may be far off.
const SKULL: [u16; 5] = [0, 11, 12, 44, 45];

/// The values of one frame.
///
/// ```
/// use grimace::{pipeline::Workbench, track::{read_track, track_model}};
///
/// let bench = Workbench::new(None, Default::default())?;
/// let track = read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// let fit = bench.fit_head(&track, &[])?;
/// let rows = bench.features(&track, &fit, &bench.frontal_model(&fit, &track)?, &[])?;
/// let last = &rows[9];
/// assert_eq!((last.frame, last.landmarks.len(), last.reason.as_deref()), (10, 68, None));
/// // The subject looks into the camera.
/// assert!(last.pose[0].abs() < 10.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FrameFeatures {
    /// Frame number.
    pub frame: u32,
    /// Share of the nodes that were observed, not recovered, 0 to 1.
    pub confidence: f64,
    /// Reason why the frame should not be used; `None` for a good one.
    pub reason: Option<String>,
    /// Yaw, pitch, roll, degrees.
    pub pose: [f64; 3],
    /// Middle of the head, px.
    pub position: Point2<f64>,
    /// Positions of the 68 landmarks, from the nodes, px; `None` for a landmark without a node.
    pub landmarks: Vec<Option<Point2<f64>>>,
    /// Eye distance of the mean head at the size of this one, px. It measures the size of the head, not the distance of this person's eyes.
    pub eye_distance: f64,
    /// FAPs that can be measured in a frontal view, and those of the head, in the units of the standard, whole, not limited to its ranges.
    pub faps: Vec<(FapNumber, f64)>,
    /// Action units.
    pub action_units: Vec<Intensity>,
    /// Opening of the left and of the right eye over that of the neutral frame.
    pub eye_opening: [f64; 2],
    /// Distance between the inner lips over MNS0.
    pub mouth_opening: f64,
    /// Offset of the left and the right iris from neutral, x to the subject's left and y up, over the normalizer's IRISD0; `None` if the
    /// irises were not tracked.
    pub iris: Option<[Vector2<f64>; 2]>,
}

/// Reason why features cannot be measured.
///
/// ```
/// use grimace::{features::FeaturesError, model::ModelError};
///
/// // It says what the step says that failed.
/// let error = FeaturesError::from(ModelError::TooFewFrames { found: 1 });
/// assert_eq!(error.to_string(), "a dynamic model needs at least 2 frames, found 1");
/// ```
#[derive(Debug, thiserror::Error)]
pub enum FeaturesError {
    /// The track cannot be normalized.
    #[error(transparent)]
    Normalize(#[from] NormalizeError),
    /// The frames do not form a model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// FAPs cannot be computed.
    #[error(transparent)]
    Convert(#[from] ConvertError),
    /// A name that is no action unit of the list.
    #[error("`{}` is not an action unit that grimace measures; choose from {}", crate::text::excerpt(name), facs::known())]
    UnknownActionUnit {
        /// What was given.
        name: String,
    },
    /// A part of [`Measured`] with another number of frames than the track.
    #[error("the {what} has {found} frames, but the track has {expected}; give the {what} of this track, all frames of it")]
    FrameCount {
        /// The part: the model, the head fit or the times.
        what: &'static str,
        /// Its number of frames.
        found: usize,
        /// Number of frames of the track.
        expected: usize,
    },
    /// A part with another number of nodes than the meter's wireframe.
    #[error(
        "the {what} has {found} nodes, but the meter's wireframe has {expected}; use one wireframe for track, model and meter"
    )]
    NodeCount {
        /// The part: the track, the model, the head model or the normalizer.
        what: &'static str,
        /// Its number of nodes.
        found: usize,
        /// Number of nodes of the wireframe.
        expected: usize,
    },
    /// A time that is no number.
    #[error("the time of frame {frame} is {seconds} s; times are finite, or minus infinity for a frame without a time")]
    Time {
        /// Frame number.
        frame: u32,
        /// The time.
        seconds: f64,
    },
}

/// A track to be measured.
///
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let track = grimace::track::read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// # let fitter = grimace::pose::HeadFitter::new(&wireframe, &tables);
/// # let fit = fitter.fit(&tables, &track, &[])?;
/// use grimace::{features::Measured, normalize::Normalizer};
///
/// // `track` holds the ten frames of a smile.
/// let normalizer = Normalizer::new(&wireframe, &tables, Default::default())?;
/// let model = normalizer.normalize_every_frame(&fitter.frontal((&wireframe, &tables), &fit, &track)?)?;
/// let measured = Measured { track: &track, fit: &fit, model: &model, seconds: &[] };
/// assert_eq!((measured.track.len(), measured.model.frame_count()), (10, 10));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy)]
pub struct Measured<'a> {
    /// The tracked frames.
    pub track: &'a [TrackedFrame],
    /// Head and poses of the track.
    pub fit: &'a HeadFit,
    /// All frames without the head's motion, face units.
    pub model: &'a DynamicExpressionModel<FaceUnit>,
    /// Seconds of the frames from any start, in the order of the track ([`TrackInfo::seconds`](crate::track::TrackInfo::seconds)); empty
    /// if unknown. Minus infinity is a frame without a time. Action units of frames that follow each other are measured together.
    pub seconds: &'a [f64],
}

impl Measured<'_> {
    /// Checks that all parts have the frames of the track, and `nodes` nodes.
    fn check(&self, nodes: usize) -> Result<(), FeaturesError> {
        let Self { track, fit, model, seconds } = self;
        let expected = track.len();
        let frames =
            |what, found| if found == expected { Ok(()) } else { Err(FeaturesError::FrameCount { what, found, expected }) };
        frames("model", model.frame_count())?;
        frames("head fit", fit.poses.len().min(expected))?;
        if !seconds.is_empty() {
            frames("list of times", seconds.len())?;
        }
        if let Some((frame, &seconds)) = track.iter().zip(*seconds).find(|(_, s)| s.is_nan() || **s == f64::INFINITY) {
            return Err(FeaturesError::Time { frame: frame.number, seconds });
        }
        check_nodes("model", model.node_count(), nodes)?;
        track.iter().try_for_each(|frame| check_nodes("track", frame.nodes.len(), nodes))
    }
}

fn check_nodes(what: &'static str, found: usize, expected: usize) -> Result<(), FeaturesError> {
    if found == expected { Ok(()) } else { Err(FeaturesError::NodeCount { what, found, expected }) }
}

/// Measures features of a face; holds everything that is the same for all tracks.
///
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let track = grimace::track::read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// # let fitter = grimace::pose::HeadFitter::new(&wireframe, &tables);
/// # let fit = fitter.fit(&tables, &track, &[])?;
/// use grimace::{features::{FeatureMeter, Measured}, normalize::Normalizer};
///
/// // `track` holds the ten frames of a smile.
/// let options = FeatureMeter::normalize_options(Default::default());
/// let normalizer = Normalizer::new(&wireframe, &tables, options)?;
/// let model = normalizer.normalize_every_frame(&fitter.frontal((&wireframe, &tables), &fit, &track)?)?;
/// let meter = FeatureMeter::new(fitter.model(), &normalizer)?;
/// let rows = meter.measure(Measured { track: &track, fit: &fit, model: &model, seconds: &[] }, &normalizer, &tables)?;
/// let smile = rows[9].action_units.iter().find(|unit| unit.number == 12).expect("AU12");
/// assert!(smile.is_present());
/// // An eye is open by what the FAPs of its lids, which are whole numbers, leave: 19 and 21 on the left.
/// let fap = |number: u8| rows[9].faps.iter().find(|(fap, _)| fap.get() == number).map_or(0.0, |(_, value)| *value);
/// assert!((rows[9].eye_opening[0] - (1.0 - (fap(19) + fap(21)) / 1024.0)).abs() <= 1.0 / 1024.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct FeatureMeter {
    units: ActionUnits,
    /// Gap between the inner lips, face units, at full intensity of "lips part".
    lips_full: f64,
    live: Vec<NodeId>,
    /// The forehead, which says nothing of action units: how far its skin follows a raised brow differs from face to face, and its upper
    /// part lies on hair. With it, raised brows of 300 FAP units had an AU 1 of 0 to 3 from pictures and of 5 from landmarks, which it lacks.
    forehead: Vec<NodeId>,
    irises: [Vec<NodeId>; 2],
}

impl FeatureMeter {
    /// Creates a meter for the wireframe of a normalizer.
    ///
    /// # Errors
    /// [`FeaturesError`] when the head model does not normalize, or is of another wireframe.
    pub fn new(head: &HeadModel, normalizer: &Normalizer<'_>) -> Result<Self, FeaturesError> {
        let units = ActionUnits::new(head, normalizer)?;
        let lips_full = units.gap_of_jaw(LIPS).max(1.0);
        let (wireframe, tables) = normalizer.face();
        let live = wireframe.live_nodes().to_vec();
        let forehead = live.iter().copied().filter(|node| tables.region(*node) == Region::Forehead).collect();
        Ok(Self { units, lips_full, live, forehead, irises: head.irises.clone() })
    }

    /// Returns the options with which tracks are normalized for a meter. The deviations of nodes from the shapes of action units were
    /// determined in face units of the iris boxes; with other options the intensities of action units are less accurate.
    pub fn normalize_options(options: NormalizeOptions) -> NormalizeOptions {
        NormalizeOptions { irisd: IrisdMode::Boxes, ..options }
    }

    /// Returns the observed nodes of a frame with their expected errors, face units. `es`, `es_px`: eye distance in face units and px.
    fn deviations(&self, frame: &TrackedFrame, is_neutral: bool, (es, es_px): (f64, f64)) -> Vec<(NodeId, f64)> {
        let one = |&node: &NodeId| {
            let tracked = &frame.nodes[node.index()];
            let expected = match tracked.state {
                NodeState::Recovered(LossReason::NoLandmark | LossReason::LostFrame) | NodeState::Follows => return None,
                // The expected error in the neutral frame is that of the position, not of the motion.
                _ => tracked.expected_error.filter(|_| !is_neutral).map_or(NODE_ERROR * es, |e| e * es / es_px),
            };
            let is_iris = self.irises.iter().flatten().any(|n| *n == node);
            (!is_iris).then_some((node, expected.max(1.0)))
        };
        self.live.iter().filter_map(one).collect()
    }

    /// Returns the action units of all frames, in the order of the track. `es`, `es_px`: eye distance in face units and px.
    fn action_units(&self, measured: Measured<'_>, es: (f64, f64)) -> Vec<Vec<Intensity>> {
        let Measured { track, model, seconds, .. } = measured;
        let mut by_time: Vec<usize> = (0..track.len()).collect();
        by_time.sort_by(|&a, &b| seconds.get(a).partial_cmp(&seconds.get(b)).unwrap_or(Ordering::Equal));
        let frame = |k: usize| {
            let m = by_time[k];
            let mut nodes = self.deviations(&track[m], m == 0, es);
            nodes.retain(|(node, _)| !self.forehead.contains(node));
            SeenFrame { offsets: model.neutral_offsets(m), nodes, seconds: seconds.get(m).copied(), is_neutral: m == 0 }
        };
        let mut units = vec![Vec::new(); track.len()];
        for (k, found) in self.units.over_time(track.len(), frame).into_iter().enumerate() {
            units[by_time[k]] = found;
        }
        units
    }

    /// Returns how much better the action units explain the motion from the first frame of a track to its last than the reverse motion, -1
    /// to 1 ([`ActionUnits::order`]). `model` is that of the track without head motion, normalized, or its first and last frame alone. The
    /// top of the skull does not count. 0 for a track or model of another wireframe than the meter's, which has no order.
    pub fn order(
        &self,
        track: &[TrackedFrame],
        model: &DynamicExpressionModel<FaceUnit>,
        normalizer: &Normalizer<'_>,
        tables: &Tables,
    ) -> f64 {
        let [neutral, .., apex] = track else { return 0.0 };
        let count = self.units.node_count();
        if [neutral.nodes.len(), apex.nodes.len(), model.node_count()].iter().any(|&found| found != count) {
            return 0.0;
        }
        let positions: Vec<Point2<f64>> = neutral.nodes.iter().map(|n| n.position).collect();
        let es_px = eye_distance_px(tables, &positions).unwrap_or(1.0);
        let mut nodes = self.deviations(apex, false, (normalizer.canonical().fapus.es, es_px));
        nodes.retain(|(node, _)| !SKULL.contains(&node.0));
        self.units.order(&model.neutral_offsets(model.frames().len() - 1), &nodes)
    }

    /// Returns the values of all frames, in the order of the track.
    ///
    /// # Errors
    /// [`FeaturesError`] when the model has no FAPs, a part has another number of frames than the track or another number of
    /// nodes than the meter, or a time is no number.
    pub fn measure(
        &self,
        measured: Measured<'_>,
        normalizer: &Normalizer<'_>,
        tables: &Tables,
    ) -> Result<Vec<FrameFeatures>, FeaturesError> {
        let Measured { track, fit, model, .. } = measured;
        measured.check(self.units.node_count())?;
        let canonical = normalizer.canonical();
        check_nodes("normalizer", canonical.neutral.node_count(), self.units.node_count())?;
        let catalog = FapCatalog::mpeg4();
        let neutral: Vec<Point2<f64>> = track.first().map(|f| f.nodes.iter().map(|n| n.position).collect()).unwrap_or_default();
        let lid_units = normalizer.lid_units(&neutral);
        let es = eye_distance_px(tables, &neutral).unwrap_or(1.0);
        let mut action_units = self.action_units(measured, (canonical.fapus.es, es));
        let mut features = Vec::with_capacity(track.len());
        for (m, frame) in track.iter().enumerate() {
            let pose = &fit.poses[m];
            let angles = pose.degrees();
            let nodes = model.frames()[m].nodes();
            let offsets = model.neutral_offsets(m);
            let faps = unlimited_faps(&offsets, (&canonical.fapus, lid_units), catalog)?;
            let gap = |nodes: &[Point2<f64>], [above, below]: [usize; 2]| nodes[above].y - nodes[below].y;
            let rest = model.neutral().nodes();
            // As for the FAPs of the lids: relative to the eye's own opening, not to the iris boxes that models may be normalized by.
            let opening = |lids: [usize; 2]| {
                let change = gap(nodes, lids) - gap(rest, lids);
                1.0 + change / canonical.fapus.irisd * lid_units.of_node(NodeId(lids[0] as u16))
            };
            let deviations = self.deviations(frame, m == 0, (canonical.fapus.es, es));
            let tracked_irises = self
                .irises
                .iter()
                .flatten()
                .all(|n| matches!(frame.nodes[n.index()].state, NodeState::Tracked | NodeState::Corrected));
            let iris = tracked_irises.then(|| {
                [0, 1].map(|side| {
                    let nodes = &self.irises[side];
                    nodes.iter().map(|n| offsets[n.index()]).sum::<Vector2<f64>>() / (nodes.len() as f64 * canonical.fapus.irisd)
                })
            });
            let mut row = FrameFeatures {
                frame: frame.number,
                confidence: seen_share(frame, &self.live),
                reason: None,
                pose: angles,
                position: pose.position,
                landmarks: landmarks(fit, m, frame, tables),
                eye_distance: pose.scale * HEAD_ES,
                faps: faps.into_iter().map(|(fap, value)| (fap, value.round() + 0.0)).collect(),
                action_units: std::mem::take(&mut action_units[m]),
                eye_opening: LIDS.map(opening),
                mouth_opening: gap(nodes, LIPS) / canonical.fapus.mns,
                iris,
            };
            let errors = LIPS.map(|k| deviations.iter().find(|(n, _)| n.index() == k).map_or(f64::INFINITY, |(_, e)| *e));
            let parted = gap(nodes, LIPS) - gap(rest, LIPS);
            row.action_units.iter_mut().filter(|unit| unit.number == LIPS_PART).for_each(|unit| {
                unit.value = (FULL * parted / self.lips_full).clamp(0.0, FULL);
                unit.expected_error = (FULL * errors[0].hypot(errors[1]) / self.lips_full).min(FULL);
                // Enough at twice the expected error, which counts the errors of both lips as independent.
                unit.evidence = EVIDENCE * (unit.value / (2.0 * unit.expected_error)).powi(2);
            });
            // Without a wider eye, what looks like raised upper lids is the rest of the face.
            let wider = row.eye_opening.iter().any(|opening| *opening > 1.0);
            row.action_units.iter_mut().filter(|unit| unit.number == UPPER_LIDS && !wider).for_each(|unit| unit.evidence = 0.0);
            // Without an eye that closes, what looks like a blink is the rest of the face.
            let closes = row.eye_opening.iter().any(|opening| *opening < CLOSING);
            row.action_units.iter_mut().filter(|unit| unit.number == BLINK && !closes).for_each(|unit| unit.evidence = 0.0);
            row.faps.extend(head_faps(angles));
            row.faps.sort_by_key(|(fap, _)| *fap);
            row.reason = reason(&row, fit, m);
            features.push(row);
        }
        Ok(features)
    }
}

/// Returns the landmarks of a frame from its nodes, at the positions of their marks.
fn landmarks(fit: &HeadFit, m: usize, frame: &TrackedFrame, tables: &Tables) -> Vec<Option<Point2<f64>>> {
    let mut points = vec![None; LANDMARK_COUNT];
    for row in tables.landmarks.iter().filter(|row| !row.nodes.is_empty()) {
        let place = |(node, weight): &(NodeId, f64)| {
            let k = node.index();
            Some((frame.nodes.get(k)?.position.coords + fit.mark_shift(m, k)) * *weight)
        };
        let sum: Option<Vector2<f64>> = row.nodes.iter().map(place).sum();
        if let Some(point) = points.get_mut(usize::from(row.landmark)) {
            *point = sum.map(Point2::from);
        }
    }
    points
}

/// Returns FAPs 48 to 50 for yaw, pitch and roll in degrees, in 1e-5 rad: positive down, left, and towards the right shoulder.
pub fn head_faps([yaw, pitch, roll]: [f64; 3]) -> Vec<(FapNumber, f64)> {
    let units = |degrees: f64| degrees.to_radians() / ANGLE_UNIT_RAD;
    let values = [(48, units(pitch)), (49, units(yaw)), (50, units(roll))];
    values.into_iter().filter_map(|(number, value)| Some((FapNumber::try_from(number).ok()?, value))).collect()
}

fn seen_share(frame: &TrackedFrame, live: &[NodeId]) -> f64 {
    let counted = |n: &&NodeId| frame.nodes[n.index()].state != NodeState::Recovered(LossReason::NoLandmark);
    let all = live.iter().filter(counted).count();
    let seen = live.iter().filter(counted).filter(|n| frame.nodes[n.index()].state.loss().is_none()).count();
    if all == 0 { 0.0 } else { seen as f64 / all as f64 }
}

fn reason(row: &FrameFeatures, fit: &HeadFit, m: usize) -> Option<String> {
    let [yaw, pitch, _] = row.pose;
    let turn = yaw.abs().max(pitch.abs());
    if row.confidence <= 0.0 {
        Some("the frame was lost".to_owned())
    } else if let Some(failure) = fit.failures.get(m).and_then(Option::as_ref) {
        Some(failure.to_string())
    } else if turn > MEASURED_TURN {
        Some(format!("the head is turned by {turn:.0} degrees; beyond {MEASURED_TURN:.0} half of the face is hidden"))
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{model::FrameExpressionModel, wireframe::Wireframe};

    /// The ten frames of a simulated smile, with the meter for them.
    struct Smile {
        track: Vec<TrackedFrame>,
        fit: HeadFit,
        model: DynamicExpressionModel<FaceUnit>,
        meter: FeatureMeter,
    }

    fn smile(normalizer: &Normalizer<'_>) -> Smile {
        let (w, t) = normalizer.face();
        let truth = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/simulated/truth/S001_005.csv");
        let track = crate::track::read_track(&truth).unwrap();
        let fitter = crate::pose::HeadFitter::new(w, t);
        let fit = fitter.fit(t, &track, &[]).unwrap();
        let model = normalizer.normalize_every_frame(&fitter.frontal((w, t), &fit, &track).unwrap()).unwrap();
        let meter = FeatureMeter::new(fitter.model(), normalizer).unwrap();
        Smile { track, fit, model, meter }
    }

    #[test]
    fn the_top_of_the_skull_does_not_decide_the_order() {
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        let normalizer = Normalizer::new(&w, &t, FeatureMeter::normalize_options(NormalizeOptions::default())).unwrap();
        let Smile { track, model, meter, .. } = smile(&normalizer);
        // Hair that was followed upwards, by a sixteenth of the eye distance, as in tracks of real smiles.
        let (last, mut frames) = (model.frame_count() - 1, model.frames().to_vec());
        let up =
            |k: usize, place: &Point2<f64>| Point2::new(place.x, place.y + if SKULL.contains(&(k as u16)) { 64.0 } else { 0.0 });
        frames[last] = FrameExpressionModel::new(frames[last].nodes().iter().enumerate().map(|(k, p)| up(k, p)).collect());
        let moved = DynamicExpressionModel::new(frames).unwrap();
        let [order, of_moved] = [&model, &moved].map(|model| meter.order(&track, model, &normalizer, &t));
        assert!(order > 0.05 && (order - of_moved).abs() < 1e-12, "{order} {of_moved}");
    }

    #[test]
    fn parts_of_other_tracks_and_times_that_are_none_are_an_error() {
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        let normalizer = Normalizer::new(&w, &t, FeatureMeter::normalize_options(NormalizeOptions::default())).unwrap();
        let Smile { track, fit, model, meter } = smile(&normalizer);
        let why = |measured: Measured<'_>| meter.measure(measured, &normalizer, &t).unwrap_err().to_string();
        let good = Measured { track: &track, fit: &fit, model: &model, seconds: &[] };
        let mut times = [0.0; 10];
        times[0] = f64::NEG_INFINITY;
        assert_eq!(meter.measure(Measured { seconds: &times, ..good }, &normalizer, &t).unwrap().len(), 10);
        let five = DynamicExpressionModel::new(model.frames()[..5].to_vec()).unwrap();
        assert!(why(Measured { model: &five, ..good }).starts_with("the model has 5 frames, but the track has 10"));
        let mut short = fit.clone();
        short.poses.truncate(3);
        assert!(why(Measured { fit: &short, ..good }).starts_with("the head fit has 3 frames, but the track has 10"));
        assert!(why(Measured { seconds: &[1.0; 4], ..good }).starts_with("the list of times has 4 frames"));
        times[2] = f64::NAN;
        assert!(why(Measured { seconds: &times, ..good }).starts_with("the time of frame 3 is NaN s"));
        let mut cut = track.clone();
        cut[9].nodes.truncate(7);
        assert!(why(Measured { track: &cut, ..good }).starts_with("the track has 7 nodes, but the meter's wireframe has 113"));
        assert_eq!(meter.order(&cut, &model, &normalizer, &t), 0.0);
        assert!(meter.order(&track, &five, &normalizer, &t).is_finite());
    }

    #[test]
    fn the_head_faps_are_hundred_thousandths_of_a_radian() {
        let faps = head_faps([10.0, -5.0, 2.0]);
        let value = |number: u8| faps.iter().find(|(fap, _)| fap.get() == number).unwrap().1;
        // 10 degrees are 0.1745329 rad.
        assert!((value(49) - 17453.29).abs() < 0.01);
        assert!((value(48) + 8726.65).abs() < 0.01);
        assert!((value(50) - 3490.66).abs() < 0.01);
    }
}
