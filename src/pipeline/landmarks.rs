//! One sequence given as landmarks, from its files to its track.

use std::{collections::BTreeMap, fs, path::PathBuf};

use super::{
    MADE_BY, SequenceFailure, Stage, Workbench,
    sequence::{Labels, file_name},
};
use crate::{
    dataset::{
        CorrespondenceSource, LandmarkSelection, LandmarkSequence, SequenceEntry, correspondences_from_landmarks,
        read_landmarks_with,
    },
    fit::{Correspondence, FitError, MarkKind, read_correspondences},
    sequence::ImageSize,
    track::{TRACK_SCHEMA, TrackInfo, TrackedFrame, summarize, track_units},
    units::SequenceId,
};

/// A sequence that landmarks drive. The landmarks are read when it is its turn, so that a million sequences need no memory.
#[derive(Clone, Debug)]
pub(super) struct LandmarkSource {
    pub id: SequenceId,
    emotion: String,
    metadata: BTreeMap<String, String>,
    fps: Option<f64>,
    path: PathBuf,
    /// Marks of the manifest's own; the landmarks of the neutral frame serve where there are none.
    marks: Option<Vec<Correspondence>>,
    marks_from: &'static str,
    first_frame: Option<u32>,
    last_frame: Option<u32>,
}

impl LandmarkSource {
    /// The source of a sequence with landmarks at `path`, and the BLAKE3 of everything the track depends on.
    pub(super) fn new(entry: &SequenceEntry, path: PathBuf, bench: &Workbench) -> Result<(Self, String), SequenceFailure> {
        let marks = match entry.correspondence_source().map_err(SequenceFailure::at(Stage::Dataset))? {
            CorrespondenceSource::File(file) => {
                let marks = read_correspondences(&file, &bench.tables, bench.wireframe.node_count());
                Some(marks.map_err(SequenceFailure::at(Stage::Dataset))?)
            }
            CorrespondenceSource::Landmarks(_) | CorrespondenceSource::None => None,
        };
        let source = Self {
            id: entry.id.clone(),
            emotion: entry.emotion.clone(),
            metadata: entry.metadata.clone(),
            fps: entry.fps,
            path,
            marks_from: if marks.is_some() { "file" } else { "landmarks" },
            marks,
            first_frame: entry.first_frame,
            last_frame: entry.last_frame,
        };
        let hash = source.inputs_blake3(bench)?;
        Ok((source, hash))
    }

    pub(super) fn labels(&self) -> Labels<'_> {
        Labels { emotion: &self.emotion, metadata: &self.metadata, marks_from: self.marks_from, fps: self.fps }
    }

    fn inputs_blake3(&self, bench: &Workbench) -> Result<String, SequenceFailure> {
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
        for mark in self.marks.iter().flatten() {
            part(&mark.node.0.to_le_bytes());
            part(&[u8::from(mark.kind == MarkKind::Hard)]);
            part(&mark.position.x.to_le_bytes());
            part(&mark.position.y.to_le_bytes());
            part(&mark.expected_error.unwrap_or_default().to_le_bytes());
        }
        for file in crate::dataset::landmark_files(&self.path).map_err(SequenceFailure::at(Stage::Dataset))? {
            let bytes = fs::read(&file).map_err(|e| SequenceFailure {
                stage: Stage::Dataset,
                reason: format!("{}: cannot be read: {e}", file.display()),
                fatal: false,
            })?;
            part(file_name(&file).as_bytes());
            part(&bytes);
        }
        Ok(hasher.finalize().to_hex().to_string())
    }

    /// Fits the wireframe to the neutral frame and drives it through the others.
    pub(super) fn track(&self, bench: &Workbench) -> Result<(Vec<TrackedFrame>, TrackInfo), SequenceFailure> {
        let read = read_landmarks_with(&self.path, bench.options.landmarks.least_confidence);
        let read = read.map_err(SequenceFailure::at(Stage::Dataset))?;
        let sequence: LandmarkSequence =
            read.sequence(self.first_frame, self.last_frame).map_err(SequenceFailure::at(Stage::Dataset))?;
        let plan = bench.landmark_plan().map_err(SequenceFailure::at(Stage::Track))?;
        let neutral = sequence.frames.first().and_then(|frame| frame.points.as_deref()).unwrap_or_default();
        let fit = |marks: &[Correspondence]| bench.fitter.fit(&bench.wireframe, marks);
        let mut marks = self.marks.clone().unwrap_or_else(|| plan.marks(neutral, &bench.tables));
        let mut fitted = fit(&marks);
        // On a head that is turned a little, or by eyes shut or wide open, points that are only on the same contour as their node may
        // fold the wireframe: fewer marks then, those that are the same anatomical point, or the corners and the chin.
        for fewer in [LandmarkSelection::High, LandmarkSelection::Default] {
            if self.marks.is_none() && matches!(fitted, Err(FitError::Folded { .. })) {
                marks =
                    correspondences_from_landmarks(neutral, &bench.tables, &fewer).map_err(SequenceFailure::at(Stage::Fit))?;
                fitted = fit(&marks);
            }
        }
        let fitted = fitted.map_err(SequenceFailure::at(Stage::Fit))?;
        let frames = plan.track(&bench.wireframe, &fitted, &sequence).map_err(SequenceFailure::at(Stage::Track))?;
        let info = TrackInfo {
            schema_version: TRACK_SCHEMA,
            made_by: MADE_BY.to_owned(),
            units: track_units(),
            id: self.id.clone(),
            emotion: self.emotion.clone(),
            metadata: self.metadata.clone(),
            source: read.files.iter().map(|file| file_name(file)).collect(),
            image_size: ImageSize { width: 0, height: 0 },
            fps: self.fps,
            marks_from: self.marks_from.to_owned(),
            marks: marks.iter().map(|m| (m.node.0, m.position.x, m.position.y, m.kind == MarkKind::Hard)).collect(),
            fit: bench.options.fit.clone(),
            track: bench.options.track,
            summary: summarize(&frames, &bench.wireframe, &bench.tables),
            inputs_blake3: String::new(),
            csv_blake3: String::new(),
        };
        Ok((frames, info))
    }
}
