//! One sequence from its frames to its track and normalized model.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use image::RgbImage;
use nalgebra::Point2;

use super::{MADE_BY, Stage, Workbench};
use crate::{
    dataset::FrameSource,
    fit::{Correspondence, MarkKind, validate_correspondences},
    model::DynamicExpressionModel,
    output,
    overlay::draw_overlay,
    plausible::FaceSize,
    sequence::{SequenceReader, read_first_frame},
    text::message,
    track::{
        TRACK_SCHEMA, Track, TrackError, TrackInfo, TrackSummary, TrackedFrame, read_track, read_track_info, summarize,
        track_model, track_sequence, track_units, write_track,
    },
    units::{FaceUnit, SequenceId},
};

/// A sequence that cannot be processed, and where it failed.
#[derive(Clone, Debug)]
pub struct SequenceFailure {
    /// The stage.
    pub stage: Stage,
    /// The error in full.
    pub reason: String,
    /// Not the sequence's fault: the run was interrupted or the disk is full.
    pub fatal: bool,
}

impl SequenceFailure {
    /// A failure of a stage, from the error with its causes.
    pub fn at<E: std::error::Error>(stage: Stage) -> impl Fn(E) -> Self {
        move |error| {
            let mut reason = error.to_string();
            let mut cause = error.source();
            while let Some(inner) = cause {
                // Errors of this crate include their cause in their own text.
                let text = inner.to_string();
                if !reason.contains(&text) {
                    reason = format!("{reason}: {text}");
                }
                cause = inner.source();
            }
            let reason = message(&reason).into_owned();
            Self { stage, reason, fatal: stage == Stage::Write }
        }
    }
}

/// Everything that one track is made from.
#[derive(Clone, Debug)]
pub struct SequenceSource {
    /// Subject and sequence.
    pub id: SequenceId,
    /// Emotion label.
    pub emotion: String,
    /// Further columns of the manifest.
    pub metadata: BTreeMap<String, String>,
    /// The frames.
    pub frames: FrameSource,
    /// Marks on the neutral frame.
    pub marks: Vec<Correspondence>,
    /// Where the marks came from: `file`, `landmarks`, `command line`.
    pub marks_from: String,
    /// Frames per second, where known.
    pub fps: Option<f64>,
}

impl SequenceSource {
    /// What the track is labelled with.
    pub(super) fn labels(&self) -> Labels<'_> {
        Labels { emotion: &self.emotion, metadata: &self.metadata, marks_from: &self.marks_from, fps: self.fps }
    }

    /// BLAKE3 of everything the track depends on: program version, options, wireframe, marks, and name and content of every frame.
    /// Emotion, further columns and frame rate are not among it: a new label does not make a new track.
    ///
    /// # Errors
    /// [`SequenceFailure`] when a frame cannot be read.
    pub fn inputs_blake3(&self, bench: &Workbench) -> Result<String, SequenceFailure> {
        let mut hasher = blake3::Hasher::new();
        let mut part = |bytes: &[u8]| {
            hasher.update(&(bytes.len() as u64).to_le_bytes());
            hasher.update(bytes);
        };
        part(MADE_BY.as_bytes());
        let options = serde_json::to_vec(&(TRACK_SCHEMA, &bench.options.fit, &bench.options.track, &bench.wireframe_blake3));
        part(&options.unwrap_or_default());
        part(self.id.to_string().as_bytes());
        for mark in &self.marks {
            part(&mark.node.0.to_le_bytes());
            part(&[u8::from(mark.kind == MarkKind::Hard)]);
            part(&mark.position.x.to_le_bytes());
            part(&mark.position.y.to_le_bytes());
            part(&mark.expected_error.unwrap_or_default().to_le_bytes());
        }
        if let FrameSource::Video { first, last, .. } = &self.frames {
            part(format!("{first:?} {last:?}").as_bytes());
        }
        for path in self.frames.files() {
            part(file_name(path).as_bytes());
            let bytes = fs::read(path).map_err(|e| SequenceFailure {
                stage: Stage::Dataset,
                reason: format!("{}: cannot be read: {e}", path.display()),
                fatal: false,
            })?;
            part(&bytes);
        }
        Ok(hasher.finalize().to_hex().to_string())
    }
}

pub(super) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Fits and tracks one sequence.
///
/// # Errors
/// [`SequenceFailure`] with the stage.
pub fn track_one(
    source: &SequenceSource,
    bench: &Workbench,
    tick: impl FnMut(u32) -> bool,
) -> Result<(Track, TrackInfo), SequenceFailure> {
    let size = read_first_frame(&source.frames).map_err(SequenceFailure::at(Stage::Track))?.size();
    validate_correspondences(&source.marks, size.width, size.height).map_err(SequenceFailure::at(Stage::Fit))?;
    let fitted = bench.fitter.fit(&bench.wireframe, &source.marks).map_err(SequenceFailure::at(Stage::Fit))?;
    let reader = SequenceReader::open(&source.frames).map_err(SequenceFailure::at(Stage::Track))?;
    let fps = source.fps.or_else(|| reader.fps());
    let track = track_sequence(&bench.wireframe, &bench.plan, &fitted, reader, &bench.options.track, tick).map_err(|error| {
        let fatal = matches!(error, TrackError::Interrupted);
        SequenceFailure { fatal, ..SequenceFailure::at(Stage::Track)(error) }
    })?;
    let info = TrackInfo {
        schema_version: TRACK_SCHEMA,
        made_by: MADE_BY.to_owned(),
        units: track_units(),
        id: source.id.clone(),
        emotion: source.emotion.clone(),
        metadata: source.metadata.clone(),
        source: source.frames.files().into_iter().map(file_name).collect(),
        image_size: track.size,
        fps,
        marks_from: source.marks_from.clone(),
        marks: source.marks.iter().map(|m| (m.node.0, m.position.x, m.position.y, m.kind == MarkKind::Hard)).collect(),
        fit: bench.options.fit.clone(),
        track: bench.options.track,
        summary: summarize(&track.frames, &bench.wireframe, &bench.tables),
        inputs_blake3: String::new(),
        csv_blake3: String::new(),
    };
    Ok((track, info))
}

/// What a track is labelled with; none of it makes another track.
pub(super) struct Labels<'a> {
    pub emotion: &'a str,
    pub metadata: &'a BTreeMap<String, String>,
    pub marks_from: &'a str,
    pub fps: Option<f64>,
}

/// The tracked frames of a sequence, their summary, and whether they were there already: read where an unchanged track is there,
/// made by `make` and written where not.
pub(super) fn track_or_reuse(
    labels: &Labels<'_>,
    inputs_blake3: &str,
    csv_path: &Path,
    make: impl FnOnce() -> Result<(Vec<TrackedFrame>, TrackInfo), SequenceFailure>,
) -> Result<(Vec<TrackedFrame>, TrackSummary, bool), SequenceFailure> {
    if let Ok(Some(info)) = read_track_info(csv_path) {
        let unchanged =
            info.inputs_blake3 == inputs_blake3 && super::files::file_blake3(csv_path) == Some(info.csv_blake3.clone());
        if unchanged && let Ok(frames) = read_track(csv_path) {
            let summary = info.summary.clone();
            relabel(labels, info, csv_path)?;
            return Ok((frames, summary, true));
        }
    }
    let (frames, mut info) = make()?;
    inputs_blake3.clone_into(&mut info.inputs_blake3);
    write_track(csv_path, &frames, &mut info).map_err(SequenceFailure::at(Stage::Write))?;
    // What is used is what is in the file, so that a resumed run gives the same bytes.
    let frames = read_track(csv_path).map_err(SequenceFailure::at(Stage::Write))?;
    Ok((frames, info.summary, false))
}

/// Brings the labels beside an unchanged track up to date.
fn relabel(labels: &Labels<'_>, mut info: TrackInfo, csv_path: &Path) -> Result<(), SequenceFailure> {
    let fps = labels.fps.or(info.fps);
    let same = info.emotion == labels.emotion
        && info.metadata == *labels.metadata
        && info.fps == fps
        && info.marks_from == labels.marks_from;
    if same {
        return Ok(());
    }
    labels.emotion.clone_into(&mut info.emotion);
    info.metadata.clone_from(labels.metadata);
    labels.marks_from.clone_into(&mut info.marks_from);
    info.fps = fps;
    output::write_json(&csv_path.with_extension("json"), &info).map_err(SequenceFailure::at(Stage::Write))
}

/// The normalized model of tracked frames.
pub(super) fn normalized(
    frames: &[TrackedFrame],
    bench: &Workbench,
) -> Result<DynamicExpressionModel<FaceUnit>, SequenceFailure> {
    let model = track_model(frames).map_err(SequenceFailure::at(Stage::Normalize))?;
    let normalizer = bench.normalizer().map_err(SequenceFailure::at(Stage::Normalize))?;
    let model = normalizer.normalize(&model).map_err(SequenceFailure::at(Stage::Normalize))?;
    // One such model would end the statistics of all.
    FaceSize::CANONICAL.check_model(&model).map_err(|e| {
        let reason = format!("of the frames of the normalized model, {e}");
        SequenceFailure { stage: Stage::Normalize, reason, fatal: false }
    })?;
    Ok(model)
}

/// Pictures of the wireframe on the wanted frames of a track, with the frame's number.
///
/// # Errors
/// [`SequenceFailure`] when frames do not read.
pub fn overlay_pictures(
    source: &SequenceSource,
    frames: &[TrackedFrame],
    bench: &Workbench,
    wanted: impl Fn(usize) -> bool,
    mut each: impl FnMut(u32, RgbImage) -> Result<(), SequenceFailure>,
) -> Result<(), SequenceFailure> {
    let marks: Vec<Point2<f64>> = source.marks.iter().map(|m| m.position).collect();
    let reader = SequenceReader::open(&source.frames).map_err(SequenceFailure::at(Stage::Track))?;
    for (index, (frame, tracked)) in reader.zip(frames).enumerate() {
        if !wanted(index) {
            continue;
        }
        let frame = frame.map_err(SequenceFailure::at(Stage::Track))?;
        let marks = if index == 0 { marks.as_slice() } else { &[] };
        let picture = draw_overlay(&frame, &bench.wireframe, &tracked.nodes, marks).map_err(SequenceFailure::at(Stage::Track))?;
        each(tracked.number, picture)?;
    }
    Ok(())
}

/// Path of an overlay picture.
pub fn overlay_path(folder: &Path, id: &SequenceId, number: u32) -> PathBuf {
    // Not the name of a Cohn-Kanade frame, lest a picture replace the frame it shows.
    folder.join(format!("{id}_{number:08}_overlay.png"))
}
