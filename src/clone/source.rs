//! The source of cloning: the motion of a track, a representative, a normalized model or a FAP file.

use std::path::{Path, PathBuf};

use nalgebra::{Point2, Vector2};

use super::{CloneError, fap_motion, timing::MAX_FRAMES};
use crate::{
    fap::{FapNumber, FapSequence, read_fap},
    geometry::Similarity,
    model::DynamicExpressionModel,
    normalize::{Canonical, EyeCorners, NormalizeOptions, Normalizer, check_face_units},
    plausible::{FaceSize, Implausible},
    pose::turns,
    positions::PositionTable,
    track::{TrackFileError, TrackInfo, TrackedFrame, clock_of_frames, read_track, read_track_info, track_model},
    units::{FaceUnit, NodeId, Px},
    wireframe::{Face, Fapus, LID_LIMIT, LidUnits},
};

/// Kind of file a motion comes from.
///
/// ```
/// use grimace::{clone::{SourceKind, SourceMotion}, wireframe::Face};
///
/// let kind = |path: &str| SourceMotion::read(path.as_ref(), &Face::candide3()).map(|motion| motion.kind);
/// assert_eq!(kind("fixtures/golden/fap/happiness.fap")?, SourceKind::Fap);
/// assert_eq!(kind("fixtures/golden/representatives/happiness.csv")?, SourceKind::Model);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SourceKind {
    /// A tracked sequence, in pixels.
    Track,
    /// A representative or a normalized model, in face units.
    Model,
    /// A FAP file.
    Fap,
}

/// The motion of one expression without head motion: offsets of all nodes from neutral over time.
///
/// ```
/// use grimace::{clone::SourceMotion, track::read_track, wireframe::Face};
///
/// let track = read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// let motion = SourceMotion::from_track("smile", &track, &[], &Face::candide3())?;
/// assert_eq!((motion.frame_count(), motion.apex(), motion.offsets[0][31].norm()), (10, 9, 0.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct SourceMotion {
    /// Name for files and captions: the stem of the file.
    pub name: String,
    /// Kind of file it comes from.
    pub kind: SourceKind,
    /// Offsets of all nodes from neutral for each frame: upright, y up, in the unit of `fapus`. The first frame of a track or a model is zero.
    pub offsets: Vec<Vec<Vector2<f64>>>,
    /// FAPUs of the source's neutral face.
    pub fapus: Fapus,
    /// Distance of the lids of the neutral face at each pair of `LID_PAIRS`, in the same unit; in face units one IRISD0 at the middle.
    pub lid_gaps: [f64; LID_PAIRS.len()],
    /// Head motion from the neutral frame to each frame, in the source's picture (px); the identity if unknown.
    pub head: Vec<Similarity>,
    /// Yaw, pitch and roll of the head relative to the first frame for each frame, degrees; empty if unknown.
    pub turns: Vec<[f64; 3]>,
    /// Frame numbers and node positions in the source's own pictures; empty except for tracks.
    pub frames: Vec<(u32, Vec<Point2<f64>>)>,
    /// Frames per second, if the source has them.
    pub fps: Option<f64>,
    /// Seconds from the first frame to each frame, ascending, if frames are not evenly spaced (missing frames or individual times).
    pub times: Option<Vec<f64>>,
    /// Emotion label, if the source has one.
    pub emotion: Option<String>,
    /// FAPs that have values but do not show on a frontal face.
    pub not_shown: Vec<FapNumber>,
    /// FAPs set by a FAP file, ascending; all other motion follows by the springs. `None` if the whole motion is intended.
    pub asked: Option<Vec<FapNumber>>,
}

impl SourceMotion {
    /// Reads a track (`.csv` with a column `state`), a representative or normalized model (`.csv` without), or a FAP file.
    ///
    /// # Errors
    /// [`CloneError`] for a file of another kind, an invalid file, or one for another wireframe.
    pub fn read(path: &Path, face: &Face) -> Result<Self, CloneError> {
        if path.is_dir() {
            return Err(CloneError::SourceFolder { path: path.to_owned(), motion: motion_in(path) });
        }
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let motion = match extension.as_str() {
            "fap" => {
                let file = read_fap(path)?;
                Self::from_fap(&name, &file.sequence, face).map_err(|error| with_path(error, path))?
            }
            "csv" => {
                let table = PositionTable::open(path).map_err(TrackFileError::from)?;
                let expected = face.wireframe.node_count();
                let check = |found: usize| {
                    let what = || path.display().to_string();
                    if found == expected { Ok(()) } else { Err(CloneError::Topology { what: what(), found, expected }) }
                };
                if table.is_track() {
                    let frames = read_track(path)?;
                    check(frames.first().map_or(0, |f| f.nodes.len()))?;
                    let info = read_track_info(path)?;
                    let marks = info.as_ref().map(TrackInfo::mark_places).unwrap_or_default();
                    let mut motion = Self::from_track(&name, &frames, &marks, face)?;
                    let numbers: Vec<u32> = frames.iter().map(|frame| frame.number).collect();
                    let clock = clock_of_frames(&numbers, info.as_ref());
                    (motion.fps, motion.times) = (clock.fps, clock.times);
                    motion.emotion = info.map(|info| info.emotion);
                    motion
                } else {
                    let model = table.model().map_err(TrackFileError::from)?;
                    check(model.node_count())?;
                    let implausible = |source| CloneError::Implausible { path: path.to_owned(), source };
                    let first = table.rows().next().and_then(Result::ok).map_or(0, |row| row.frame);
                    FaceSize::CANONICAL.check_neutral(first, model.neutral().nodes()).map_err(implausible)?;
                    let not_face_units = |source| CloneError::NotFaceUnits { path: path.to_owned(), source };
                    check_face_units(model.neutral().nodes()).map_err(not_face_units)?;
                    Self::from_model(&name, &model, face)?
                }
            }
            _ => return Err(CloneError::UnknownSource { path: path.display().to_string() }),
        };
        motion.check().map_err(|source| CloneError::Implausible { path: path.to_owned(), source })?;
        Ok(motion)
    }

    /// Checks that a face can make the motion.
    fn check(&self) -> Result<(), Implausible> {
        let unit = if self.kind == SourceKind::Track { "px" } else { "face units" };
        let size = FaceSize { eye_separation: self.fapus.es, unit };
        let number = |m: usize| self.frames.get(m).map_or(m as u32, |(number, _)| *number);
        self.offsets.iter().enumerate().try_for_each(|(m, offsets)| size.check_offsets(number(m), offsets))?;
        if let Some((number, neutral)) = self.frames.first() {
            size.check_neutral(*number, neutral)?;
        }
        Ok(())
    }

    /// Creates the motion of tracked frames, with the marks of the neutral frame if known. Head turns of more than a few degrees are
    /// removed, because they would look like an expression; the head motion in the picture is kept separately.
    ///
    /// # Errors
    /// [`CloneError`] for fewer than two frames or a neutral face without FAPUs.
    pub fn from_track(
        name: &str,
        frames: &[TrackedFrame],
        marks: &[(NodeId, Point2<f64>)],
        face: &Face,
    ) -> Result<Self, CloneError> {
        let model: DynamicExpressionModel<Px> = track_model(frames)?;
        let normalizer = normalizer(face)?;
        let turns = turns(face, frames, marks);
        let upright = normalizer.upright(turns.as_ref().and_then(|turns| turns.removed.as_ref()).unwrap_or(&model))?;
        let fapus = Fapus::measure(&face.tables.fapus, &upright[0])
            .map_err(|source| CloneError::Fapus { what: "the source's neutral face", source })?;
        let corners = EyeCorners::new(&face.tables, face.wireframe.node_count());
        let neutral = model.neutral().nodes();
        let head =
            model.frames().iter().map(|f| corners.similarity(neutral, f.nodes()).unwrap_or_else(|_| Similarity::identity()));
        let head = head.collect();
        Ok(Self {
            name: name.to_owned(),
            kind: SourceKind::Track,
            offsets: upright.iter().map(|f| f.iter().zip(&upright[0]).map(|(p, n)| p - n).collect()).collect(),
            fapus,
            lid_gaps: lid_gaps(&upright[0], &fapus, normalizer.canonical()),
            head,
            turns: turns.map(|turns| turns.angles).unwrap_or_default(),
            frames: frames.iter().map(|f| (f.number, f.nodes.iter().map(|n| n.position).collect())).collect(),
            fps: None,
            times: None,
            emotion: None,
            not_shown: Vec::new(),
            asked: None,
        })
    }

    /// Creates the motion of a representative or a normalized model.
    ///
    /// # Errors
    /// [`CloneError::Topology`] for another wireframe.
    pub fn from_model(name: &str, model: &DynamicExpressionModel<FaceUnit>, face: &Face) -> Result<Self, CloneError> {
        let expected = face.wireframe.node_count();
        if model.node_count() != expected {
            return Err(CloneError::Topology { what: name.to_owned(), found: model.node_count(), expected });
        }
        let normalizer = normalizer(face)?;
        let canonical = normalizer.canonical();
        let offsets: Vec<_> = (0..model.frame_count()).map(|m| model.neutral_offsets(m)).collect();
        Ok(Self {
            name: name.to_owned(),
            kind: SourceKind::Model,
            head: vec![Similarity::identity(); offsets.len()],
            offsets,
            fapus: canonical.fapus,
            lid_gaps: canonical_lid_gaps(canonical),
            turns: Vec::new(),
            frames: Vec::new(),
            fps: None,
            times: None,
            emotion: None,
            not_shown: Vec::new(),
            asked: None,
        })
    }

    /// Creates the motion of FAPs: they drive their nodes, and the springs place the rest.
    ///
    /// # Errors
    /// [`CloneError`] for a file without frames, with more than 20,000 of them, or without a FAP that shows from the front.
    pub fn from_fap(name: &str, sequence: &FapSequence, face: &Face) -> Result<Self, CloneError> {
        if sequence.frames.len() > MAX_FRAMES {
            return Err(CloneError::SourceTooLong { path: name.to_owned(), frames: sequence.frames.len(), most: MAX_FRAMES });
        }
        let (mut offsets, not_shown) = fap_motion::offsets(name, sequence, face)?;
        let normalizer = normalizer(face)?;
        let canonical = normalizer.canonical();
        if offsets.len() == 1 {
            // A single pose starts from the neutral face.
            offsets.insert(0, vec![Vector2::zeros(); face.wireframe.node_count()]);
        }
        Ok(Self {
            name: name.to_owned(),
            kind: SourceKind::Fap,
            head: vec![Similarity::identity(); offsets.len()],
            offsets,
            fapus: canonical.fapus,
            lid_gaps: canonical_lid_gaps(canonical),
            turns: Vec::new(),
            frames: Vec::new(),
            fps: Some(sequence.fps),
            times: None,
            emotion: None,
            not_shown,
            asked: Some(sequence.set_faps()),
        })
    }

    /// Whether the motion sets a FAP itself, rather than moving it along.
    pub fn asks_for(&self, fap: FapNumber) -> bool {
        self.asked.as_ref().is_none_or(|asked| asked.contains(&fap))
    }

    /// Units of the lids' FAPs for the source.
    pub(crate) fn lid_units(&self) -> LidUnits {
        lid_units(&self.fapus, &self.lid_gaps)
    }

    /// Whether all frames show the neutral face: no node moves more than a thousandth of the eye distance, about one FAP unit, which is
    /// invisible.
    pub fn is_still(&self) -> bool {
        const SEEN: f64 = 1e-3;
        self.offsets.iter().flatten().all(|offset| offset.norm() <= SEEN * self.fapus.es)
    }

    /// Number of frames, at least one.
    pub fn frame_count(&self) -> usize {
        self.offsets.len()
    }

    /// Checks that every frame has a head and plausible offsets of the same nodes, that there are as many turns, positions and
    /// times as frames if any, and that lengths, times and the frame rate are numbers that a motion can have.
    ///
    /// # Errors
    /// [`CloneError`].
    pub(super) fn check_parts(&self) -> Result<(), CloneError> {
        let Some(first) = self.offsets.first() else { return Err(CloneError::NoFrames { path: self.name.clone() }) };
        let (frames, nodes) = (self.offsets.len(), first.len());
        let equal = |what, found: usize, expected: usize| {
            if found == expected {
                Ok(())
            } else {
                Err(CloneError::UnevenSource { name: self.name.clone(), what, found, expected })
            }
        };
        self.offsets.iter().try_for_each(|offsets| equal("offsets in a frame", offsets.len(), nodes))?;
        equal("heads", self.head.len(), frames)?;
        let of_all = |what, found| if found == 0 { Ok(()) } else { equal(what, found, frames) };
        of_all("turns", self.turns.len())?;
        of_all("frames with positions", self.frames.len())?;
        self.frames.iter().try_for_each(|(_, positions)| equal("positions in a frame", positions.len(), nodes))?;
        let number = |what, value: f64, allowed| Err(CloneError::Number { what, value, allowed });
        if let Some(fps) = self.fps.filter(|fps| !(fps.is_finite() && *fps > 0.0)) {
            return number("the frame rate of the source", fps, "a finite number above 0");
        }
        if let Some(times) = &self.times {
            equal("times", times.len(), frames)?;
            let ascends = times.windows(2).all(|pair| pair[0] <= pair[1]);
            if let Some(&odd) = times.iter().find(|time| !(time.is_finite() && **time >= 0.0 && ascends)) {
                return number("a time of the source", odd, "finite, at least 0 and not before the time of the frame before");
            }
        }
        let Fapus { irisd, es, ens, mns, mw } = self.fapus;
        if let Some(odd) = [es, ens, mns, mw, irisd].into_iter().find(|length| !(length.is_finite() && *length > 0.0)) {
            return number("a length of the source's neutral face", odd, "a finite number above 0");
        }
        if let Some(&odd) = self.lid_gaps.iter().find(|gap| !gap.is_finite()) {
            return number("a distance of the source's lids", odd, "a finite number");
        }
        self.check().map_err(|source| CloneError::Implausible { path: PathBuf::from(&self.name), source })
    }

    /// Index of the frame with the largest sum of offsets; the first one of equals.
    pub fn apex(&self) -> usize {
        let size = |frame: &Vec<Vector2<f64>>| frame.iter().map(Vector2::norm).sum::<f64>();
        let sizes: Vec<f64> = self.offsets.iter().map(size).collect();
        (0..sizes.len()).fold(0, |best, k| if sizes[k] > sizes[best] { k } else { best })
    }
}

/// Nodes of the upper lid margin, each with the node of the lower lid that it meets: left eye, right eye, from outside to inside.
pub const LID_PAIRS: [(usize, usize); 6] = [(97, 99), (21, 22), (105, 107), (98, 100), (54, 55), (106, 108)];

/// Indices in [`LID_PAIRS`] of the middle of the left and of the right eye.
const MIDDLES: [usize; 2] = [1, 4];

/// Distance of the lids of an upright face (y up) at each pair, limited to what its iris boxes make plausible; 0 if the wireframe lacks
/// these nodes.
pub(super) fn lid_gaps(upright: &[Point2<f64>], fapus: &Fapus, canonical: &Canonical) -> [f64; LID_PAIRS.len()] {
    let scale = fapus.irisd / canonical.fapus.irisd;
    let (seen, of_boxes) = (gaps(upright), canonical_lid_gaps(canonical).map(|gap| gap * scale));
    std::array::from_fn(|pair| match (seen[pair], of_boxes[pair]) {
        (seen, expected) if seen > 0.0 && expected > 0.0 => seen.clamp(expected / LID_LIMIT, expected * LID_LIMIT),
        (_, expected) => expected,
    })
}

/// The first representative or track in a folder of results.
fn motion_in(results: &Path) -> Option<PathBuf> {
    let csv_files = |folder: &str| {
        let entries = std::fs::read_dir(results.join(folder)).into_iter().flatten().flatten().map(|entry| entry.path());
        entries.filter(|path| path.extension().is_some_and(|extension| extension == "csv")).min()
    };
    csv_files("representatives").or_else(|| csv_files("tracks"))
}

/// The same in face units: the lids of the canonical neutral face, scaled so that their middles are one IRISD0 apart.
pub fn canonical_lid_gaps(canonical: &Canonical) -> [f64; LID_PAIRS.len()] {
    let gaps = gaps(canonical.neutral.nodes());
    let middle = MIDDLES.map(|pair| gaps[pair]).iter().sum::<f64>() / MIDDLES.len() as f64;
    gaps.map(|gap| if middle > 0.0 && gap > 0.0 { gap * canonical.fapus.irisd / middle } else { 0.0 })
}

fn gaps(upright: &[Point2<f64>]) -> [f64; LID_PAIRS.len()] {
    LID_PAIRS.map(|(above, below)| match (upright.get(above), upright.get(below)) {
        (Some(above), Some(below)) => above.y - below.y,
        _ => 0.0,
    })
}

/// Units of the lids' FAPs for these distances of the lids.
pub(super) fn lid_units(fapus: &Fapus, gaps: &[f64; LID_PAIRS.len()]) -> LidUnits {
    LidUnits::new(fapus, MIDDLES.map(|pair| gaps[pair]))
}

/// A normalizer for what does not depend on its options: upright frames and the canonical neutral face.
pub(super) fn normalizer(face: &Face) -> Result<Normalizer<'_>, CloneError> {
    Normalizer::new(&face.wireframe, &face.tables, NormalizeOptions::default())
        .map_err(|source| CloneError::Fapus { what: "the wireframe", source })
}

fn with_path(error: CloneError, path: &Path) -> CloneError {
    let path = path.display().to_string();
    match error {
        CloneError::NoFrames { .. } => CloneError::NoFrames { path },
        CloneError::NothingToShow { faps, .. } => CloneError::NothingToShow { path, faps },
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fap::FapFrame;

    #[test]
    fn a_motion_that_nobody_sees_stands_still() {
        let face = Face::candide3();
        let jaw = |values: &[f64]| {
            let frame = |&value: &f64| {
                let mut frame = FapFrame::default();
                frame.set_value(FapNumber::try_from(3).unwrap(), Some(value));
                frame
            };
            let frames = values.iter().map(frame).collect();
            let sequence = FapSequence { version: "2.1".to_owned(), name: "jaw".to_owned(), fps: 25.0, frames };
            SourceMotion::from_fap("jaw", &sequence, &face).unwrap().is_still()
        };
        assert!(jaw(&[0.0, 0.0]) && jaw(&[0.0]) && !jaw(&[0.0, 200.0, 0.0]));
        // A unit of FAP 3 is MNS0/1024, less than a thousandth of the eye distance.
        assert!(jaw(&[0.0, 1.0]) && !jaw(&[0.0, 20.0]));
    }
}
