//! Samples for learning and testing the tracker's expected errors: nodes of tracked sequences with known motion.
//!
//! People are either rendered, or photographed and warped; warped photographs have real skin and hair with equally exact motion. Every
//! sequence is tracked twice: from exact positions of all nodes, and from a fit to marks. The marks are a few nodes for rendered people,
//! and all hand-set points, with their errors, for photographed people. A sample is the error of the offset from neutral of one node, taken
//! in every third frame and in the last.

use grimace::internal::{
    fit::{Correspondence, Fitter},
    locate::learn::TrainingFace,
    sequence::Frame,
    track::{NodeFeatures, TrackOptions, TrackPlan, TrackedFrame, eye_distance_px, node_features, track_sequence},
    units::NodeId,
    wireframe::{Tables, Wireframe},
};
use image::{DynamicImage, RgbImage, imageops};
use nalgebra::Point2;
use rayon::prelude::*;

use super::{EvaluateError, MarkNoise, Person, Start, TruthNode, placement};
use crate::simulate::{
    AnimatedPortrait, Emotion, Portrait, PortraitMarks, PortraitMotion, SimulateError, SimulateOptions, SimulatedFrame,
    SimulatedSequence, Subject,
};

/// Interval between sampled frames.
const FRAME_STEP: usize = 3;
/// Eye distance to which photographs are scaled, relative to the width of the rendered pictures; it is that of rendered people.
const EYE_DISTANCE: f64 = 0.17;

/// One kind of sequence to learn from or to test on.
#[derive(Debug)]
pub struct ConfidenceCondition {
    /// Name in tables.
    pub name: String,
    /// Motion and camera; for rendered people the seed also determines the identities.
    pub simulation: SimulateOptions,
    /// Photographed people; when empty, [`SimulateOptions::subjects`] people are rendered.
    pub photographs: Vec<PhotographedPerson>,
}

/// A photograph to animate, with its marked nodes.
#[derive(Debug)]
pub struct PhotographedPerson {
    portrait: Portrait,
    marked: Vec<NodeId>,
}

impl PhotographedPerson {
    /// Prepares a photograph with hand-set points, scaled to the face size of people rendered `width` px wide.
    ///
    /// # Errors
    /// [`EvaluateError`] when the points do not determine a fit.
    pub fn new(
        face: &TrainingFace,
        width: u32,
        fitter: &Fitter,
        wireframe: &Wireframe,
        tables: &Tables,
    ) -> Result<Self, EvaluateError> {
        let scale = EYE_DISTANCE * f64::from(width) / face.eye_distance();
        let side = |pixels: u32| (f64::from(pixels) * scale).round().max(1.0) as u32;
        let (width, height) = face.grey.dimensions();
        let picture = imageops::resize(&face.grey, side(width), side(height), imageops::FilterType::CatmullRom);
        let picture: RgbImage = DynamicImage::ImageLuma8(picture).into_rgb8();
        // Coordinates refer to pixel centres.
        let scaled = |at: Point2<f64>| at.map(|v| (v + 0.5) * scale - 0.5);
        let points: Vec<(NodeId, Point2<f64>)> = face.nodes().into_iter().map(|(node, at)| (node, scaled(at))).collect();
        let marks = points.iter().map(|&(node, at)| Correspondence::mark(node, at)).collect();
        let portrait = Portrait::new(&face.person, &picture, &PortraitMarks::Correspondences(marks), fitter, wireframe, tables)
            .map_err(SimulateError::from)?;
        Ok(Self { portrait, marked: points.into_iter().map(|(node, _)| node).collect() })
    }
}

impl ConfidenceCondition {
    fn people(&self) -> u32 {
        if self.photographs.is_empty() { self.simulation.subjects } else { self.photographs.len() as u32 }
    }

    /// Returns the number of sequences.
    #[must_use]
    pub fn sequences(&self) -> usize {
        self.people() as usize * self.simulation.emotions.len()
    }

    /// Returns the name of the person, and the frames of an emotion.
    fn frames(
        &self,
        person: u32,
        emotion: Emotion,
        wireframe: &Wireframe,
    ) -> Result<(String, Vec<SimulatedFrame>), EvaluateError> {
        if let Some(PhotographedPerson { portrait, .. }) = self.photographs.get(person as usize) {
            let motion = PortraitMotion::Emotion(emotion);
            let sequence = AnimatedPortrait::new(portrait, &motion, &self.simulation, wireframe, person, emotion.code());
            let warped =
                |source| SimulateError::from(crate::simulate::PortraitError::Warp { id: portrait.id().to_owned(), source });
            let frames = (0..sequence.frame_count()).map(|k| sequence.frame(k)).collect::<Result<_, _>>().map_err(warped)?;
            return Ok((portrait.id().to_owned(), frames));
        }
        let subject = Subject::new(&self.simulation, person)?;
        let sequence = SimulatedSequence::new(&subject, emotion, &self.simulation)?;
        Ok((subject.id(), (0..sequence.frame_count()).map(|k| sequence.frame(k)).collect()))
    }
}

/// Options of the tracking of samples.
#[derive(Clone, Debug)]
pub struct ConfidenceOptions {
    /// Options of the tracker.
    pub track: TrackOptions,
    /// Marked nodes for a sequence of a rendered person that starts from a fit.
    pub marks: Vec<NodeId>,
    /// Standard deviation of the errors of those marks, px.
    pub marks_noise_px: f64,
}

/// One sample: a node in a frame, with its features and its true error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConfidenceSample {
    /// Features from which the tracker predicts the error.
    pub features: NodeFeatures,
    /// True error of the offset from neutral, relative to the eye distance.
    pub error: f64,
}

/// The samples of one tracked sequence.
#[derive(Clone, Debug)]
pub struct SampledSequence {
    /// Name of the sequence.
    pub id: String,
    /// Name of the condition.
    pub condition: String,
    /// How the tracking started.
    pub start: Start,
    /// Eye distance in the neutral frame, px.
    pub eye_distance: f64,
    /// The samples.
    pub samples: Vec<ConfidenceSample>,
    /// Mean true error of all live nodes at the last frame, relative to the eye distance.
    pub last_error: f64,
    /// The tracked frames, from which the verdict is computed.
    pub(super) frames: Vec<TrackedFrame>,
}

/// Makes and tracks every emotion of every person of every condition.
///
/// `progress` is called from any thread after every sequence and may return `false` to stop. A sequence in which the tracker loses the face
/// gives no samples.
///
/// # Errors
/// [`EvaluateError`] for options out of range, marks that do not determine a fit, or an interruption.
pub fn confidence_samples(
    conditions: &[ConfidenceCondition],
    fitter: &Fitter,
    wireframe: &Wireframe,
    tables: &Tables,
    options: &ConfidenceOptions,
    progress: impl Fn() -> bool + Sync,
) -> Result<Vec<SampledSequence>, EvaluateError> {
    for condition in conditions {
        condition.simulation.check()?;
    }
    let plan = TrackPlan::new(wireframe, tables);
    let bench = Bench { fitter, wireframe, tables, options, plan };
    let cases: Vec<(&ConfidenceCondition, u32, Emotion)> = conditions
        .iter()
        .flat_map(|c| {
            let emotions = move |person| c.simulation.emotions.iter().map(move |&emotion| (c, person, emotion));
            (0..c.people()).flat_map(emotions)
        })
        .collect();
    let sampled: Vec<Vec<SampledSequence>> = cases
        .par_iter()
        .map(|&(condition, person, emotion)| {
            let samples = bench.sample(condition, person, emotion)?;
            if progress() { Ok(samples) } else { Err(EvaluateError::Interrupted) }
        })
        .collect::<Result<_, _>>()?;
    Ok(sampled.into_iter().flatten().collect())
}

struct Bench<'a> {
    fitter: &'a Fitter,
    wireframe: &'a Wireframe,
    tables: &'a Tables,
    options: &'a ConfidenceOptions,
    plan: TrackPlan,
}

impl Bench<'_> {
    fn sample(
        &self,
        condition: &ConfidenceCondition,
        person: u32,
        emotion: Emotion,
    ) -> Result<Vec<SampledSequence>, EvaluateError> {
        let (name, frames) = condition.frames(person, emotion, self.wireframe)?;
        let grey = |SimulatedFrame { image, nodes }| (DynamicImage::ImageRgb8(image).into_luma8(), nodes);
        let (images, truth): (Vec<_>, Vec<_>) = frames.into_iter().map(grey).unzip();
        let Some(neutral) = truth.first() else { return Ok(Vec::new()) };
        let Some(eye_distance) = eye_distance_px(self.tables, neutral) else { return Ok(Vec::new()) };
        let mut out = Vec::new();
        for start in [Start::Landmarks, Start::Marks] {
            let fitted = self.fitter.fit(self.wireframe, &self.marks(start, neutral, eye_distance, condition, person))?;
            let frames = (1..).zip(&images).map(|(number, image)| Ok(Frame::new(number, image.clone())));
            let Ok(track) = track_sequence(self.wireframe, &self.plan, &fitted, frames, &self.options.track, |_| true) else {
                continue;
            };
            let features = node_features(&track.frames, self.wireframe, self.tables);
            let error = |k: usize, id: NodeId| {
                let found = track.frames[k].nodes[id.index()].position - track.frames[0].nodes[id.index()].position;
                (found - (truth[k][id.index()] - neutral[id.index()])).norm() / eye_distance
            };
            let live = self.wireframe.live_nodes();
            let last = track.frames.len() - 1;
            let mut samples = Vec::new();
            for k in (1..=last).filter(|&k| k % FRAME_STEP == 0 || k == last) {
                for (&id, features) in live.iter().zip(&features[k]) {
                    samples.extend(features.map(|features| ConfidenceSample { features, error: error(k, id) }));
                }
            }
            let last_error = live.iter().map(|&id| error(last, id)).sum::<f64>() / live.len().max(1) as f64;
            let id = format!("{name}_{:03}", emotion.code());
            let condition = condition.name.clone();
            out.push(SampledSequence { id, condition, start, eye_distance, samples, last_error, frames: track.frames });
        }
        Ok(out)
    }

    fn marks(
        &self,
        start: Start,
        neutral: &[Point2<f64>],
        eye_distance: f64,
        condition: &ConfidenceCondition,
        person: u32,
    ) -> Vec<Correspondence> {
        let live = self.wireframe.live_nodes();
        if start == Start::Landmarks {
            return live.iter().map(|&node| Correspondence::hard(node, neutral[node.index()])).collect();
        }
        let truth = live.iter().map(|&node| TruthNode { node, position: neutral[node.index()], inner: true }).collect();
        let who = Person::new(String::new(), eye_distance, truth, condition.simulation.seed, person);
        if let Some(photographed) = condition.photographs.get(person as usize) {
            return placement::marks(&who, &photographed.marked);
        }
        let noise = MarkNoise::Uniform(self.options.marks_noise_px);
        self.options.marks.iter().filter_map(|&n| who.mark(n, noise)).collect()
    }
}
