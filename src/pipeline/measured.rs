//! Measurements of a track: normalized model, features, FAPs.

use std::{collections::BTreeMap, path::Path};

use nalgebra::Point2;

use super::{SequenceFailure, Stage, Workbench};
use crate::{
    fap::{ValueFormat, write_fap_as},
    features::{
        ColumnNames, FrameFeatures, apex_warning, fap_sequence, order_warning, pose_warning, turn_warning, write_features,
    },
    model::DynamicExpressionModel,
    normalize::PoseMode,
    plausible::FaceSize,
    pose::{HeadFit, PoseError},
    sequence::Clock,
    track::{TrackInfo, TrackSummary, TrackedFrame, Verdict, seconds_of, track_model},
    units::{FaceUnit, NodeId, Px, SequenceId},
};

/// A normalized sequence.
pub(super) struct Normalized {
    /// The normalized model.
    pub model: DynamicExpressionModel<FaceUnit>,
    /// All frames without head motion, px.
    pub head_free: DynamicExpressionModel<Px>,
    /// Head and poses; `None` if normalization keeps the pose and no head was fitted.
    pub fit: Option<HeadFit>,
}

impl Normalized {
    /// Adds the head pose and the order of the frames to the summary of a track.
    pub fn judge(&self, summary: &mut TrackSummary, frames: &[TrackedFrame], bench: &Workbench) {
        let Some(fit) = &self.fit else { return };
        // Otherwise action units would explain a nodding or turning head better in one direction.
        let is_free = bench.options.normalize.pose == PoseMode::Full;
        let is_known = summary.mouth_back.is_some();
        let order = if is_free && !is_known { bench.order(frames, &self.head_free).unwrap_or(0.0) } else { 0.0 };
        let apex = is_free.then(|| apex_warning(&self.head_free, frames, &bench.tables)).flatten();
        let warnings = [turn_warning(fit, frames), pose_warning(fit, frames), order_warning(order, frames), apex];
        for warning in warnings.into_iter().flatten() {
            if !summary.reasons.contains(&warning) {
                summary.verdict = Verdict::LookAgain;
                summary.reasons.push(warning);
            }
        }
    }
}

/// Normalizes tracked frames, with the known marks of the neutral frame and the known frame times.
///
/// # Errors
/// [`SequenceFailure`] when no head fits the track, or its model is not plausible for a face.
pub fn normalize_track(
    frames: &[TrackedFrame],
    info: Option<&TrackInfo>,
    bench: &Workbench,
) -> Result<DynamicExpressionModel<FaceUnit>, SequenceFailure> {
    let marks = info.map(TrackInfo::mark_places).unwrap_or_default();
    let times = info.and_then(|info| info.times.as_deref());
    normalized(frames, &marks, times, bench).map(|normalized| normalized.model)
}

/// Normalizes tracked frames with the marks of the neutral frame. `times` are sorted by number and given if they are uneven.
pub(super) fn normalized(
    frames: &[TrackedFrame],
    marks: &[(NodeId, Point2<f64>)],
    times: Option<&[f64]>,
    bench: &Workbench,
) -> Result<Normalized, SequenceFailure> {
    let failed = |error: PoseError| SequenceFailure::at(Stage::Normalize)(error);
    let (fit, head_free) = match bench.options.normalize.pose {
        PoseMode::Full => {
            let fit = bench.fit_head(frames, marks).map_err(failed)?;
            let free = bench.frontal_model(&fit, frames).map_err(failed)?;
            (Some(fit), free)
        }
        PoseMode::Roll => {
            (bench.fit_head(frames, marks).ok(), track_model(frames).map_err(SequenceFailure::at(Stage::Normalize))?)
        }
    };
    let normalizer = bench.normalizer().map_err(SequenceFailure::at(Stage::Normalize))?;
    let numbers = moments(frames, times);
    let model = normalizer.normalize_numbered(&head_free, &numbers).map_err(SequenceFailure::at(Stage::Normalize))?;
    // One such model would stop the statistics of all.
    FaceSize::CANONICAL.check_model(&model).map_err(|e| {
        let reason = format!("of the frames of the normalized model, {e}");
        SequenceFailure { stage: Stage::Normalize, reason, fatal: false }
    })?;
    Ok(Normalized { model, head_free, fit })
}

/// Steps per second into which uneven times are rounded, to serve in place of frame numbers: models sample their frames evenly in time.
const STEPS: f64 = 1e4;

/// Times of a track's frames: their numbers, or time steps if intervals vary.
fn moments(frames: &[TrackedFrame], times: Option<&[f64]>) -> Vec<u32> {
    let first = frames.iter().map(|frame| frame.number).min().unwrap_or_default();
    let own = times.filter(|times| times.len() == frames.len()).and_then(|times| {
        let at = |frame: &TrackedFrame| times.get((frame.number - first) as usize).map(|s| (s * STEPS).round() as u32);
        frames.iter().map(at).collect()
    });
    own.unwrap_or_else(|| frames.iter().map(|frame| frame.number).collect())
}

/// Names of the files that [`write_measured`] writes.
pub(super) fn measured_files(id: &SequenceId) -> [String; 3] {
    [format!("features/{id}.csv"), format!("features/{id}.json"), format!("fap/tracks/{id}.fap")]
}

/// Pose, FAPs and action units of every frame; `None` without a fitted head. `clock` is by number.
pub(super) fn measure(
    normalized: &Normalized,
    frames: &[TrackedFrame],
    clock: &Clock,
    bench: &Workbench,
) -> Result<Option<Vec<FrameFeatures>>, SequenceFailure> {
    let Some(fit) = &normalized.fit else { return Ok(None) };
    let features = bench.features(frames, fit, &normalized.head_free, &seconds_of(frames, clock));
    features.map(Some).map_err(|reason| SequenceFailure { stage: Stage::Normalize, reason, fatal: false })
}

/// Writes the features of a sequence and its FAPs, including those of the head. Returns the BLAKE3 of every file by name.
pub(super) fn write_measured(
    features: &[FrameFeatures],
    info: &TrackInfo,
    out: &Path,
    bench: &Workbench,
) -> Result<BTreeMap<String, String>, SequenceFailure> {
    let id = &info.id;
    let [csv, json, fap] = measured_files(id);
    let clock = info.clock();
    let by_number = info.clock_of_numbers(features.iter().map(|f| f.frame));
    let hashes = write_features(&out.join(&csv), features, &by_number, ColumnNames::Grimace, None);
    let hashes = hashes.map_err(SequenceFailure::at(Stage::Write))?;
    let faps = fap_sequence(features, &id.to_string(), &clock, f64::from(bench.options.fap.fps));
    let profile = bench.options.fap.profile;
    let faps = faps.for_profile(profile).map_err(SequenceFailure::at(Stage::Write))?;
    let fap_hash =
        write_fap_as(&out.join(&fap), &faps, profile, ValueFormat::Integer).map_err(SequenceFailure::at(Stage::Write))?;
    let hex = |hash: blake3::Hash| hash.to_hex().to_string();
    Ok(BTreeMap::from([(csv, hex(hashes.csv)), (json, hex(hashes.json)), (fap, hex(fap_hash))]))
}
