//! The tracking experiment: node errors over the frames of sequences with known nodes [KP, Fig. 3 and eq. (1)].
//!
//! There are two protocols ([`Start`]). A start from true positions measures the tracker alone. A start from a few marks measures fit and
//! tracker together, by the error of the offset from neutral, which is what a FAP measures. KP's eq. (1) is the mean over the nodes of one
//! frame; the nodes are all live nodes in simulated sequences, and those with a landmark in real ones.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use image::{DynamicImage, GrayImage};
use nalgebra::Point2;
use rayon::prelude::*;
use serde::Serialize;

use super::{
    EvaluateError, MarkNoise, Person, Records, TrackerVariant, TruthError, TruthNode,
    records::RecordedError,
    truth::{TruthFrames, compared_nodes, group_of, landmark_eye_distance, read_truth, truth_path},
};
use crate::simulate::{CameraOptions, Emotion, SimulateOptions, SimulatedSequence, Subject};
use grimace::internal::{
    dataset::{Dataset, DatasetError, FrameSource, LandmarkSelection, SequenceEntry, correspondences_from_landmarks},
    fit::{Correspondence, Fitter},
    report::failed_name,
    sequence::{Frame, SequenceError, SequenceReader},
    track::{TrackPlan, eye_distance_px},
    units::NodeId,
    wireframe::{Region, Tables, Wireframe},
};

/// The start of a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Start {
    /// The known nodes of the neutral frame are fixed at their true positions; the error is that of the position.
    Landmarks,
    /// The wireframe is fitted to a few marks; the error is that of the offset from neutral.
    Marks,
}

/// Options of the experiment.
#[derive(Clone, Debug)]
pub struct TrackingOptions {
    /// How sequences start.
    pub start: Start,
    /// Trackers to compare.
    pub variants: Vec<TrackerVariant>,
    /// Marked nodes for [`Start::Marks`].
    pub marks: Vec<NodeId>,
    /// Standard deviation of the errors of those marks in simulated sequences, px.
    pub marks_noise_px: f64,
    /// Manifest column to group by; a single group without it.
    pub by: Option<String>,
    /// Seed of the errors of the marks.
    pub seed: u64,
}

/// A sequence to track.
#[derive(Clone, Debug)]
pub struct TrackingCase {
    /// Name of the sequence.
    pub id: String,
    group: String,
    source: CaseSource,
}

#[derive(Clone, Debug)]
enum CaseSource {
    Simulated {
        options: SimulateOptions,
        subject: u32,
        emotion: Emotion,
    },
    /// A sequence of a dataset, with landmarks, or with exact positions of all nodes when there is a file of them.
    Entry {
        entry: Box<SequenceEntry>,
        exact: Option<PathBuf>,
    },
    /// File of true positions; the tracks are read from files.
    Truth(PathBuf),
}

/// Makes a case from a file of true positions, for the comparison with existing tracks.
pub fn truth_case(path: &Path) -> TrackingCase {
    let id = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    TrackingCase { id, group: "all".to_owned(), source: CaseSource::Truth(path.to_owned()) }
}

/// A sequence that was left out for all variants.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failed {
    /// Name of the sequence.
    pub id: String,
    /// Name of the variant that failed; empty when the sequence itself cannot be used.
    pub variant: String,
    /// The reason.
    pub reason: String,
}

/// Results of the experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackingResult {
    /// Errors of all sequences.
    pub records: Records,
    /// Sequences left out.
    pub failures: Vec<Failed>,
}

/// Returns the options of the hard simulation, similar to film of a dim room with a consumer camera.
///
/// The head is turned by up to 8 degrees; pixel noise is 4 grey levels; motion blur covers half the time between two frames; the lens is
/// out of focus by 0.8 px (standard deviation). Brightness changes by up to 15 % and 8 grey levels over the sequence, a gradient of ±15 %
/// moves over the face, and JPEG compression has quality 75. None of these moves a node.
pub fn hard_simulation(options: &SimulateOptions) -> SimulateOptions {
    let camera = CameraOptions {
        shutter: 0.5,
        defocus_px: 0.8,
        gain_change: 0.15,
        bias_change: 8.0,
        light_gradient: 0.15,
        compression: Some(75),
    };
    SimulateOptions { noise_sigma: 4.0, yaw_degrees: 8.0, camera, ..options.clone() }
}

/// Returns one sequence for every subject and emotion of a simulation.
///
/// # Errors
/// [`EvaluateError::Simulate`] for options out of range.
pub fn simulated_cases(options: &SimulateOptions) -> Result<Vec<TrackingCase>, EvaluateError> {
    options.check()?;
    let case = |subject: u32, emotion: Emotion| TrackingCase {
        id: format!("S{:03}_{:03}", subject + 1, emotion.code()),
        group: "simulated".to_owned(),
        source: CaseSource::Simulated { options: options.clone(), subject, emotion },
    };
    let emotions = |subject| options.emotions.iter().map(move |&emotion| case(subject, emotion));
    Ok((0..options.subjects).flat_map(emotions).collect())
}

/// Returns the sequences of a dataset that have landmarks, or exact positions in `truth/SUBJECT_SEQUENCE.csv`, grouped by a manifest
/// column. The second list holds the sequences that cannot be read.
///
/// # Errors
/// [`EvaluateError`] when the dataset cannot be opened, lacks the column, or has no sequence with landmarks.
pub fn dataset_cases(path: &Path, by: Option<&str>) -> Result<(Vec<TrackingCase>, Vec<Failed>), EvaluateError> {
    let dataset = Dataset::open(path)?;
    let mut failures: Vec<Failed> = Vec::new();
    for f in &dataset.failures {
        let reason = f.error.to_string();
        failures.push(Failed { id: failed_name(&f.subject, &f.sequence, &reason), variant: String::new(), reason });
    }
    let mut cases = Vec::new();
    for entry in dataset.sequences {
        // The folder `truth` is next to the manifest, or, in the layout of Cohn-Kanade, next to the folder of images.
        let exact = [&dataset.root, path].map(|root| truth_path(root, &entry.id)).into_iter().find(|path| path.is_file());
        if entry.landmarks_paths.is_empty() && exact.is_none() {
            continue;
        }
        let group = group_of(&entry, by)?;
        cases.push(TrackingCase { id: entry.id.to_string(), group, source: CaseSource::Entry { entry: Box::new(entry), exact } });
    }
    if cases.is_empty() {
        return Err(EvaluateError::NoTruth { path: path.to_owned() });
    }
    Ok((cases, failures))
}

/// A sequence ready for tracking.
struct Prepared {
    frames: PreparedFrames,
    /// ES0, px, if the truth determines it; otherwise the value of the track's neutral frame is used.
    eye_distance: Option<f64>,
    /// Compared nodes: the node, its part, and whether it belongs to the inner face.
    compared: Vec<(NodeId, String, bool)>,
    /// True positions by frame number, in the order of `compared`, `None` if not known. Frames without an entry are not compared.
    truth: TruthFrames,
    /// Marks that the wireframe is fitted to.
    marks: Vec<Correspondence>,
}

enum PreparedFrames {
    Images(Vec<GrayImage>),
    Source(FrameSource),
    /// No frames: existing tracks are compared.
    None,
}

impl PreparedFrames {
    fn open(&self) -> Result<Box<dyn Iterator<Item = Result<Frame, SequenceError>> + '_>, SequenceError> {
        Ok(match self {
            Self::Images(images) => Box::new((1..).zip(images).map(|(number, image)| Ok(Frame::new(number, image.clone())))),
            Self::Source(source) => Box::new(SequenceReader::open(source)?),
            Self::None => Box::new(std::iter::empty()),
        })
    }
}

/// Tracks every sequence with every variant and compares the tracks with the truth.
///
/// `progress` is called from any thread after every sequence and may return `false` to stop. A sequence that fails for one variant is left
/// out for all, so that all variants are compared on the same sequences.
///
/// # Errors
/// [`EvaluateError::Interrupted`].
pub fn evaluate_tracking(
    cases: &[TrackingCase],
    fitter: &Fitter,
    wireframe: &Wireframe,
    tables: &Tables,
    options: &TrackingOptions,
    progress: impl Fn() -> bool + Sync,
) -> Result<TrackingResult, EvaluateError> {
    let bench = Bench { fitter, wireframe, tables, options, plan: TrackPlan::new(wireframe, tables) };
    let results: Vec<Option<Result<CaseErrors, Failed>>> = cases
        .par_iter()
        .enumerate()
        .map(|(index, case)| {
            let result = bench.run(case, index);
            progress().then_some(result)
        })
        .collect();
    let mut groups: Vec<String> = cases.iter().map(|c| c.group.clone()).collect();
    groups.sort();
    groups.dedup();
    let mut records = Records {
        variants: options.variants.iter().map(|v| v.name.clone()).collect(),
        groups,
        sequences: cases.iter().map(|c| c.id.clone()).collect(),
        parts: Vec::new(),
        has_inner: false,
        errors: Vec::new(),
    };
    let mut failures = Vec::new();
    for (sequence, (case, result)) in cases.iter().zip(results).enumerate() {
        match result.ok_or(EvaluateError::Interrupted)? {
            Ok(errors) => append(&mut records, sequence, &case.group, errors),
            Err(failed) => failures.push(failed),
        }
    }
    records.has_inner = records.errors.iter().any(|e| e.inner) && records.errors.iter().any(|e| !e.inner);
    Ok(TrackingResult { records, failures })
}

/// Errors of one sequence. The field `part` of `errors` is an index into `parts`.
struct CaseErrors {
    parts: Vec<String>,
    errors: Vec<RecordedError>,
}

fn append(records: &mut Records, sequence: usize, group: &str, case: CaseErrors) {
    let group = records.groups.iter().position(|g| g == group).unwrap_or_default();
    let mut places = Vec::new();
    for part in case.parts {
        places.push(records.parts.iter().position(|p| *p == part).unwrap_or_else(|| {
            records.parts.push(part);
            records.parts.len() - 1
        }));
    }
    records.errors.extend(case.errors.into_iter().map(|e| RecordedError { sequence, group, part: places[e.part], ..e }));
}

struct Bench<'a> {
    fitter: &'a Fitter,
    wireframe: &'a Wireframe,
    tables: &'a Tables,
    options: &'a TrackingOptions,
    plan: TrackPlan,
}

impl Bench<'_> {
    fn run(&self, case: &TrackingCase, index: usize) -> Result<CaseErrors, Failed> {
        let failed = |variant: &str, reason: String| Failed { id: case.id.clone(), variant: variant.to_owned(), reason };
        let prepared = match &case.source {
            CaseSource::Simulated { options, subject, emotion } => self.simulated(options, *subject, *emotion, index),
            CaseSource::Entry { entry, exact: Some(path) } => self.exact_entry(entry, path, index),
            CaseSource::Entry { entry, exact: None } => self.entry(entry),
            CaseSource::Truth(path) => self.truth_alone(path),
        };
        let prepared = prepared.map_err(|e| failed("", e.to_string()))?;
        let fitted = match &prepared.frames {
            PreparedFrames::None => None,
            _ => Some(self.fitter.fit(self.wireframe, &prepared.marks).map_err(|e| failed("", e.to_string()))?),
        };
        let last_known = prepared.truth.keys().next_back().copied();
        let mut parts: Vec<String> = Vec::new();
        for (_, part, _) in &prepared.compared {
            if !parts.contains(part) {
                parts.push(part.clone());
            }
        }
        let mut errors = Vec::new();
        for (variant, tracker) in self.options.variants.iter().enumerate() {
            let frames = prepared.frames.open().map_err(|e| failed("", e.to_string()))?;
            let track = tracker
                .track(&case.id, self.wireframe, &self.plan, fitted.as_ref(), frames)
                .map_err(|e| failed(&tracker.name, e.to_string()))?;
            let Some((first, neutral)) = track.first() else { continue };
            let true_neutral = prepared.truth.get(first);
            if !track.iter().any(|(number, _)| number != first && prepared.truth.contains_key(number)) {
                let reason = "no frame after the neutral one has true positions to compare with";
                return Err(failed(&tracker.name, reason.to_owned()));
            }
            let eye_distance = prepared.eye_distance.unwrap_or_else(|| {
                let neutral: Vec<_> = neutral.iter().map(|n| n.position).collect();
                eye_distance_px(self.tables, &neutral).unwrap_or(f64::NAN)
            });
            for (k, (number, nodes)) in track.iter().enumerate() {
                // The last frame with known positions: the apex, when the sequence is known to its end.
                let last = Some(*number) == last_known.min(track.last().map(|(number, _)| *number));
                let Some(truth) = prepared.truth.get(number) else { continue };
                for (i, (node, part, inner)) in prepared.compared.iter().enumerate() {
                    let Some(truth) = truth[i] else { continue };
                    let (found, start) = (nodes[node.index()], neutral[node.index()].position);
                    let px = match self.options.start {
                        Start::Landmarks => (found.position - truth).norm(),
                        Start::Marks => {
                            let Some(true_neutral) = true_neutral.and_then(|neutral| neutral[i]) else { continue };
                            ((found.position - start) - (truth - true_neutral)).norm()
                        }
                    };
                    errors.push(RecordedError {
                        variant,
                        group: 0,
                        sequence: 0,
                        frame: k + 1,
                        last,
                        part: parts.iter().position(|p| p == part).unwrap_or_default(),
                        inner: *inner,
                        tracked: found.tracked,
                        px,
                        percent: 100.0 * px / eye_distance,
                        expected_px: found.expected,
                    });
                }
            }
        }
        Ok(CaseErrors { parts, errors })
    }

    fn simulated(
        &self,
        options: &SimulateOptions,
        subject: u32,
        emotion: Emotion,
        index: usize,
    ) -> Result<Prepared, EvaluateError> {
        let subject = Subject::new(options, subject)?;
        let sequence = SimulatedSequence::new(&subject, emotion, options)?;
        let (mut images, mut positions) = (Vec::new(), BTreeMap::new());
        for (number, k) in (1..).zip(0..sequence.frame_count()) {
            let frame = sequence.frame(k);
            positions.insert(number, frame.nodes.into_iter().map(Some).collect());
            images.push(DynamicImage::ImageRgb8(frame.image).to_luma8());
        }
        let neutral: Vec<_> = sequence.nodes(0).into_iter().map(Some).collect();
        Ok(self.known_nodes(PreparedFrames::Images(images), &neutral, &positions, index))
    }

    fn exact_entry(&self, entry: &SequenceEntry, path: &Path, index: usize) -> Result<Prepared, EvaluateError> {
        let frames = entry.frames().map_err(DatasetError::from)?;
        let positions = read_truth(path, self.wireframe.node_count())?;
        let frame = frames.neutral_number();
        let Some(neutral) = positions.get(&frame) else {
            return Err(TruthError::NoNeutral { path: path.to_owned(), frame }.into());
        };
        Ok(self.known_nodes(PreparedFrames::Source(frames), neutral, &positions, index))
    }

    /// Prepares true positions for the comparison with existing tracks.
    fn truth_alone(&self, path: &Path) -> Result<Prepared, EvaluateError> {
        let positions = read_truth(path, self.wireframe.node_count())?;
        let none = vec![None; self.wireframe.node_count()];
        let neutral = positions.values().next().unwrap_or(&none).clone();
        Ok(self.known_nodes(PreparedFrames::None, &neutral, &positions, 0))
    }

    /// Prepares a sequence with known positions of all or some nodes.
    fn known_nodes(
        &self,
        frames: PreparedFrames,
        neutral: &[Option<Point2<f64>>],
        positions: &TruthFrames,
        index: usize,
    ) -> Prepared {
        let is_known = |n: &NodeId| positions.values().any(|nodes| nodes[n.index()].is_some());
        let live: Vec<NodeId> = self.wireframe.live_nodes().iter().copied().filter(is_known).collect();
        let at_start: Vec<(NodeId, Point2<f64>)> = live.iter().filter_map(|&n| Some((n, neutral[n.index()]?))).collect();
        // Compares regions from top to bottom, so that the parts keep this order.
        let mut compared: Vec<(NodeId, String, bool)> = Vec::new();
        for region in Region::ALL {
            let of_region = live.iter().filter(|&&n| self.tables.region(n) == region);
            compared.extend(of_region.map(|&n| (n, region.to_string(), true)));
        }
        let of_frame = |nodes: &Vec<Option<Point2<f64>>>| compared.iter().map(|(n, _, _)| nodes[n.index()]).collect();
        let truth = positions.iter().map(|(&number, nodes)| (number, of_frame(nodes))).collect();
        let whole: Option<Vec<Point2<f64>>> = neutral.iter().copied().collect();
        let eye_distance = whole.and_then(|nodes| eye_distance_px(self.tables, &nodes));
        let marks = match self.options.start {
            Start::Landmarks => at_start.iter().map(|&(node, position)| hard(node, position)).collect(),
            Start::Marks => {
                let node = |&(node, position): &(NodeId, Point2<f64>)| TruthNode { node, position, inner: true };
                let truth = at_start.iter().map(node).collect();
                let person = Person::new(String::new(), eye_distance.unwrap_or(f64::NAN), truth, self.options.seed, index as u32);
                let noise = MarkNoise::Uniform(self.options.marks_noise_px);
                self.options.marks.iter().filter_map(|&n| person.mark(n, noise)).collect()
            }
        };
        Prepared { frames, eye_distance, compared, truth, marks }
    }

    fn entry(&self, entry: &SequenceEntry) -> Result<Prepared, EvaluateError> {
        let frames = entry.frames().map_err(DatasetError::from)?;
        let Some(track) = entry.landmarks()? else {
            return Err(EvaluateError::NoTruth { path: entry.frames_path.clone() });
        };
        let points = track.frame(frames.neutral_number())?;
        let nodes = compared_nodes(self.tables);
        let Some(eye_distance) = landmark_eye_distance(points) else {
            return Err(EvaluateError::NoTruth { path: entry.frames_path.clone() });
        };
        let marks = match self.options.start {
            Start::Landmarks => nodes.iter().map(|c| hard(c.node, points[c.landmark])).collect(),
            Start::Marks => {
                let selection = LandmarkSelection::Nodes(self.options.marks.clone());
                correspondences_from_landmarks(points, self.tables, &selection)?
            }
        };
        let of_frame = |points: &Vec<Point2<f64>>| nodes.iter().map(|c| Some(points[c.landmark])).collect();
        let truth = track.frames.iter().map(|(&number, points)| (number, of_frame(points))).collect();
        let compared = nodes.iter().map(|c| (c.node, c.part.clone(), c.inner)).collect();
        Ok(Prepared { frames: PreparedFrames::Source(frames), eye_distance: Some(eye_distance), compared, truth, marks })
    }
}

fn hard(node: NodeId, position: Point2<f64>) -> Correspondence {
    Correspondence::hard(node, position)
}
