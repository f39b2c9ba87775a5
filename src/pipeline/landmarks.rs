//! Processes one sequence given as landmarks: from its files to its track.

use std::{collections::BTreeMap, path::PathBuf};

use nalgebra::Point2;

use super::{
    MADE_BY, SequenceFailure, Stage, Workbench,
    inputs::Inputs,
    sequence::{LANDMARKS, Labels, file_name},
};
use crate::{
    dataset::{
        CorrespondenceSource, FrameSource, LandmarkSequence, LandmarkTrack, LandmarksError, SequenceEntry, read_face, read_marks,
    },
    fit::{Correspondence, FittedWireframe, MarkKind},
    sequence::{Clock, ImageSize},
    track::{TRACK_SCHEMA, TrackInfo, TrackedFrame, summarize, track_units},
    units::SequenceId,
};

/// Frames and record of a tracked sequence.
type Read = (Vec<TrackedFrame>, TrackInfo);

/// A sequence that landmarks drive. The landmarks are read only when it is processed, to limit memory.
#[derive(Clone, Debug)]
pub(super) struct LandmarkSource {
    pub id: SequenceId,
    emotion: String,
    metadata: BTreeMap<String, String>,
    fps: Option<f64>,
    path: PathBuf,
    /// The row, for its images: they only determine the frame numbers.
    entry: Box<SequenceEntry>,
    /// Id of the face, if there are several.
    face: Option<String>,
    /// Marks given in the manifest; without them, the landmarks of the neutral frame are used.
    marks: Option<Vec<Correspondence>>,
    pub marks_from: &'static str,
    first_frame: Option<u32>,
    last_frame: Option<u32>,
}

impl LandmarkSource {
    /// Returns the source of a sequence with landmarks at `path`.
    pub(super) fn new(entry: &SequenceEntry, path: PathBuf, bench: &Workbench) -> Result<Self, SequenceFailure> {
        let marks = match entry.correspondence_source().map_err(SequenceFailure::at(Stage::Dataset))? {
            CorrespondenceSource::File(file) => {
                let marks = read_marks(&file, &bench.options.marks, &bench.tables, bench.wireframe.node_count());
                Some(marks.map_err(SequenceFailure::at(Stage::Dataset))?)
            }
            CorrespondenceSource::Landmarks(_) | CorrespondenceSource::None => None,
        };
        Ok(Self {
            id: entry.id.clone(),
            emotion: entry.emotion.clone(),
            metadata: entry.metadata.clone(),
            fps: entry.fps,
            path,
            entry: Box::new(entry.clone()),
            face: entry.face_id().map(str::to_owned),
            marks_from: if marks.is_some() { "file" } else { LANDMARKS },
            marks,
            first_frame: entry.first_frame,
            last_frame: entry.last_frame,
        })
    }

    pub(super) fn labels(&self) -> Labels<'_> {
        Labels { emotion: &self.emotion, metadata: &self.metadata, marks_from: self.marks_from, fps: self.fps }
    }

    /// Hash of everything the track depends on.
    pub(super) fn inputs(&self, bench: &Workbench) -> Result<Inputs, SequenceFailure> {
        self.inputs_beside(&self.image_numbers(), bench)
    }

    /// As [`LandmarkSource::inputs`], with images of these numbers.
    fn inputs_beside(&self, images: &[u32], bench: &Workbench) -> Result<Inputs, SequenceFailure> {
        let mut hasher = blake3::Hasher::new();
        let mut part = |bytes: &[u8]| {
            hasher.update(&(bytes.len() as u64).to_le_bytes());
            hasher.update(bytes);
        };
        part(MADE_BY.as_bytes());
        let options = &bench.options;
        let depends = (
            TRACK_SCHEMA,
            "landmarks",
            &options.fit,
            options.track.force,
            options.landmarks.least_confidence,
            &bench.wireframe_blake3,
        );
        part(&serde_json::to_vec(&depends).unwrap_or_default());
        part(self.id.to_string().as_bytes());
        part(format!("{:?} {:?}", self.first_frame, self.last_frame).as_bytes());
        images.iter().for_each(|number| part(&number.to_le_bytes()));
        // The two that the report shows. One that cannot be read is not shown.
        let shown = self.shown_images(bench);
        let files = shown.iter().flat_map(|images| images.files());
        let ends = files.clone().next().into_iter().chain(files.last());
        ends.filter_map(|file| crate::input::read(file).ok()).for_each(|bytes| part(&bytes));
        self.face.iter().for_each(|face| part(face.as_bytes()));
        for mark in self.marks.iter().flatten() {
            part(&mark.node.0.to_le_bytes());
            part(&[u8::from(mark.kind == MarkKind::Hard)]);
            part(&mark.position.x.to_le_bytes());
            part(&mark.position.y.to_le_bytes());
            part(&mark.expected_error.unwrap_or_default().to_le_bytes());
        }
        for file in crate::dataset::landmark_files(&self.path).map_err(SequenceFailure::at(Stage::Dataset))? {
            let unreadable = |reason| LandmarksError::Io { path: file.clone(), reason };
            let bytes = crate::input::read(&file).map_err(unreadable).map_err(SequenceFailure::at(Stage::Dataset))?;
            part(file_name(&file).as_bytes());
            part(&bytes);
        }
        Ok(Inputs::new(hasher.finalize()))
    }

    /// Reads the frames' own times again. `inputs` identifies the files.
    pub(super) fn own_clock(&self, inputs: &Inputs, bench: &Workbench) -> Result<Clock, SequenceFailure> {
        let (read, sequence) = self.read(bench)?;
        if self.inputs(bench)? == *inputs { Ok(clock(&read, &sequence)) } else { Err(SequenceFailure::changed(&self.path)) }
    }

    /// Its images from the neutral to the apex frame, if they may be shown: the report has small pictures of two of them.
    pub(super) fn shown_images(&self, bench: &Workbench) -> Option<FrameSource> {
        let images = self.entry.frames().ok().filter(|frames| matches!(frames, FrameSource::Images(_)));
        images.filter(|_| bench.options.shows(&self.metadata))
    }

    /// Numbers of the images from the neutral to the apex frame; empty for a video or without images.
    fn image_numbers(&self) -> Vec<u32> {
        match self.entry.frames() {
            Ok(FrameSource::Images(files)) => files.iter().map(|file| file.number).collect(),
            _ => Vec::new(),
        }
    }

    /// As [`LandmarkSource::track_read`], with a check that no file changes meanwhile. Also returns the hash of the data that were read.
    pub(super) fn track(&self, bench: &Workbench) -> (Option<String>, Result<Read, SequenceFailure>) {
        // Images only determine the frame numbers and are listed once.
        let images = self.image_numbers();
        let before = match self.inputs_beside(&images, bench) {
            Ok(inputs) => inputs,
            Err(failure) => return (None, Err(failure)),
        };
        let tracked = self.track_read(&images, bench);
        match self.inputs_beside(&images, bench) {
            Ok(after) if after == before => {
                let inputs_blake3 = after.with_rate(self.fps);
                let tracked = tracked.map(|(frames, info)| (frames, TrackInfo { inputs_blake3: inputs_blake3.clone(), ..info }));
                (Some(inputs_blake3), tracked)
            }
            _ => (None, Err(SequenceFailure::changed(&self.path))),
        }
    }

    /// Reads the landmarks, and selects the requested frames.
    fn read(&self, bench: &Workbench) -> Result<(LandmarkTrack, LandmarkSequence), SequenceFailure> {
        let read = read_face(&self.path, bench.options.landmarks.least_confidence, self.face.as_deref());
        let read = read.map_err(SequenceFailure::at(Stage::Dataset))?;
        let sequence = read.sequence(self.first_frame, self.last_frame).map_err(SequenceFailure::at(Stage::Dataset))?;
        Ok((read, sequence))
    }

    /// Fits the wireframe to the neutral frame and drives it through the others.
    fn track_read(&self, images: &[u32], bench: &Workbench) -> Result<(Vec<TrackedFrame>, TrackInfo), SequenceFailure> {
        let (read, sequence) = self.read(bench)?;
        let plan = bench.landmark_plan().map_err(SequenceFailure::at(Stage::Track))?;
        let neutral = sequence.frames.first().and_then(|frame| frame.points.as_deref()).unwrap_or_default();
        let (marks, fitted) = fit_landmarks(bench, neutral, self.marks.clone())?;
        let frames = plan.track(&bench.wireframe, &fitted, &sequence).map_err(SequenceFailure::at(Stage::Track))?;
        // A given rate has precedence.
        let clock = self.fps.map_or_else(|| clock(&read, &sequence), |fps| Clock::even(Some(fps)));
        let info = TrackInfo {
            schema_version: TRACK_SCHEMA,
            made_by: MADE_BY.to_owned(),
            units: track_units(),
            id: self.id.clone(),
            emotion: self.emotion.clone(),
            metadata: self.metadata.clone(),
            source: read.files.iter().map(|file| file_name(file)).collect(),
            image_size: ImageSize { width: 0, height: 0 },
            fps: clock.fps,
            times: clock.times,
            notes: sequence.ends_early(images),
            marks_from: self.marks_from.to_owned(),
            marks: marks.iter().map(|m| (m.node.0, m.position.x, m.position.y, m.kind == MarkKind::Hard)).collect(),
            read: Vec::new(),
            fit: bench.options.fit.clone(),
            track: bench.options.track,
            summary: summarize(&frames, &bench.wireframe, &bench.tables),
            inputs_blake3: String::new(),
            frames_blake3: None,
            csv_blake3: String::new(),
            corrections: None,
            neutral_frame: None,
            apex_frame: None,
        };
        Ok((frames, info))
    }
}

/// Times of a sequence's frames, from its files.
fn clock(read: &LandmarkTrack, sequence: &LandmarkSequence) -> Clock {
    let numbers = || sequence.frames.iter().map(|frame| frame.number);
    let (Some(lowest), Some(highest)) = (numbers().min(), numbers().max()) else { return Clock::default() };
    Clock::of_times(read.times.range(lowest..=highest).map(|(&number, &seconds)| (number, seconds)))
}

/// Fits the wireframe to the neutral frame of a landmark sequence. Returns it with its marks: those given, or else the landmarks.
///
/// # Errors
/// [`SequenceFailure`] with the stage.
pub fn fit_landmarks(
    bench: &Workbench,
    neutral: &[Point2<f64>],
    given: Option<Vec<Correspondence>>,
) -> Result<(Vec<Correspondence>, FittedWireframe), SequenceFailure> {
    let plan = bench.landmark_plan().map_err(SequenceFailure::at(Stage::Track))?;
    let marks = given.unwrap_or_else(|| plan.marks(neutral, &bench.tables));
    let fitted = bench.fitter.fit(&bench.wireframe, &marks).map_err(SequenceFailure::at(Stage::Fit))?;
    Ok((marks, fitted))
}

#[cfg(test)]
mod tests {
    use std::{fs, path::Path};

    use super::*;
    use crate::{
        dataset::Dataset,
        pipeline::{LandmarkOptions, PipelineOptions},
        track::read_track,
    };

    #[test]
    fn landmarks_that_end_before_the_images_are_reported_in_the_track() {
        let landmarks = LandmarkOptions { prefer: true, ..LandmarkOptions::default() };
        let bench = Workbench::new(None, PipelineOptions { landmarks, ..PipelineOptions::default() }).unwrap();
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/simulated");
        let folder = tempfile::tempdir().unwrap();
        let frames = folder.path().join("S001/005");
        fs::create_dir_all(&frames).unwrap();
        (1..=10).for_each(|k| fs::write(frames.join(format!("f_{k}.png")), "").unwrap());
        // Landmarks of the first six of ten frames of a smile.
        let header: String = (0..68).map(|k| format!(",x{k},y{k}")).collect();
        let place = |frame: &TrackedFrame, nodes: &[(crate::units::NodeId, f64)]| {
            let sum =
                |of: fn(Point2<f64>) -> f64| nodes.iter().map(|(n, w)| w * of(frame.nodes[n.index()].position)).sum::<f64>();
            format!(",{},{}", sum(|p| p.x), sum(|p| p.y))
        };
        let smile = read_track(&root.join("truth/S001_005.csv")).unwrap();
        let row = |frame: &TrackedFrame| {
            let points: String = bench.tables.landmarks.iter().map(|row| place(frame, &row.nodes)).collect();
            format!("{}{points}\n", frame.number)
        };
        let rows: String = smile[..6].iter().map(row).collect();
        fs::write(frames.join("landmarks.csv"), format!("frame{header}\n{rows}")).unwrap();
        let notes = |manifest: &str| {
            fs::write(folder.path().join("manifest.csv"), manifest).unwrap();
            let dataset = Dataset::open(folder.path()).unwrap();
            let entry = &dataset.sequences[0];
            let path = entry.driving_landmarks(true).unwrap().unwrap();
            let (inputs, tracked) = LandmarkSource::new(entry, path, &bench).unwrap().track(&bench);
            (inputs.unwrap(), tracked.unwrap().1.notes)
        };
        let header = "subject,sequence,emotion,first_frame,last_frame\nS001,005,happiness,";
        let (inputs, said) = notes(&format!("{header},"));
        assert!(
            said.len() == 1 && said[0].starts_with("frames 7 to 10 have an image but no landmarks, so frame 6 became the apex")
        );
        assert_eq!(notes(&format!("{header}1,6")).1, [""; 0], "it is meant");
        // The note is part of the result, so the track without it does not count as the same.
        (7..=10).for_each(|k| fs::remove_file(frames.join(format!("f_{k}.png"))).unwrap());
        let (without, said) = notes(&format!("{header},"));
        assert!(said.is_empty() && without != inputs);
    }
}
