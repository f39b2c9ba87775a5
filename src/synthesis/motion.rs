//! The motion of feature points from what other stages write: representatives, normalized models, tracks, FAP files, or a CSV file.
//!
//! Everything but the CSV file is seen from the front: two-dimensional, in units of Candide-3's face. It is brought to the bank's face as
//! the main job makes faces equal: each offset by the ratio of the FAPUs of its facial region, along x and along y. FAPUs of bank and
//! Candide-3 are measured on the same feature points.

use std::{collections::BTreeMap, path::Path};

use nalgebra::{Vector2, Vector3};

use super::{Bank, FpMotion, SynthesisError};
use crate::{
    fap::{FapCatalog, FapMask, FapNumber, offsets_from_frame, read_fap},
    input::CsvFile,
    interpolation::{Curve, FRAMES_BETWEEN, Moment},
    model::DynamicExpressionModel,
    normalize::{Canonical, NormalizeOptions, Normalizer},
    plausible::{FaceSize, Implausible},
    pose::without_turns,
    positions::PositionTable,
    text::excerpt,
    track::{TrackInfo, read_track, read_track_info, track_model},
    units::{FaceUnit, FeaturePoint, NodeId},
    wireframe::{Face, Fapu, LidUnits, Tables, Wireframe},
};

/// What a motion was read from.
///
/// ```
/// use grimace::synthesis::{MotionKind, candide_bank, read_motion};
///
/// let motion = read_motion("fixtures/golden/fap/happiness.fap".as_ref(), &candide_bank()?, None)?;
/// assert_eq!((motion.kind, motion.fps), (MotionKind::Fap, Some(25.0)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MotionKind {
    /// `frame,fp,dx,dy,dz` in the bank's unit.
    FeaturePoints,
    /// `frame,node,x,y`: a representative or a normalized model, face units.
    Model,
    /// `frame,node,x,y,state,residual`: a track, pixels.
    Track,
    /// A FAP file.
    Fap,
}

/// A motion of the bank's feature points over time.
///
/// ```
/// use std::path::Path;
///
/// use grimace::synthesis::{candide_bank, read_motion};
///
/// let motion = read_motion(Path::new("fixtures/golden/representatives/happiness.csv"), &candide_bank()?, None)?;
/// assert!(!motion.is_still());
/// // Five key frames, and two frames between every two of them.
/// assert_eq!(motion.with_frames_between(2).frames.len(), 13);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// What it was read from.
    pub kind: MotionKind,
    /// Frames in order.
    pub frames: Vec<FpMotion>,
    /// Frames per second, where the source says so.
    pub fps: Option<f64>,
    /// Feature points of the motion that the bank does not have.
    pub ignored: Vec<FeaturePoint>,
    /// FAPs with values of a FAP file that move nothing of the bank: turns of head and eyes, depth, tongue, visemes, expressions, and those
    /// of feature points that it does not have.
    pub not_shown: Vec<FapNumber>,
    /// Bank units per face unit along x and y for the five FAPUs in the order of the standard; `None` for motion in the bank's unit.
    pub scale: Option<[f64; 5]>,
}

/// Share of the farthest motion that tracking may give a point at rest.
pub const NOISE: f64 = 0.05;

impl Motion {
    /// The motion as it is animated: by default 5 frames between the key frames of a model and none between others', and
    /// `NOISE` taken for rest but for feature points that a CSV file gives.
    pub fn as_animated(&self, between: Option<usize>, noise: Option<f64>) -> Self {
        let between = between.unwrap_or(if self.kind == MotionKind::Model { FRAMES_BETWEEN } else { 0 });
        self.without_noise(noise.unwrap_or_else(|| self.default_noise())).with_frames_between(between)
    }

    /// Share of the farthest motion under which a point of such a motion is taken to be at rest.
    pub fn default_noise(&self) -> f64 {
        if self.kind == MotionKind::FeaturePoints { 0.0 } else { NOISE }
    }

    /// The motion with `between` frames put between every two, every coordinate on a monotone cubic, as in the FAP
    /// file of the same motion. A feature point is known only between two frames that know it.
    pub fn with_frames_between(&self, between: usize) -> Self {
        let steps = self.frames.len().saturating_sub(1);
        let last = steps.saturating_mul(between.saturating_add(1));
        if last == 0 || between == 0 {
            return self.clone();
        }
        let count = self.frames.first().map_or(0, |f| f.offsets.len());
        let curve =
            |point: usize, axis: usize| Curve::through(self.frames.iter().map(|f| Some(f.offsets[point]?[axis])).collect());
        let curves: Vec<[Curve; 3]> = (0..count).map(|point| [0, 1, 2].map(|axis| curve(point, axis))).collect();
        let frames = (0..=last).map(|k| {
            let moment = Moment::of_frame(k, last, steps);
            if moment.share == 0.0 {
                return self.frames[moment.key].clone();
            }
            let point = |[x, y, z]: &[Curve; 3]| Some(Vector3::new(x.at(moment)?, y.at(moment)?, z.at(moment)?));
            let planar = self.frames[moment.key].planar || self.frames[moment.key + 1].planar;
            FpMotion { offsets: curves.iter().map(point).collect(), planar }
        });
        Self { frames: frames.collect(), ..self.clone() }
    }

    /// The motion with feature points at rest that move less than `share` of the farthest moving one, each judged by its largest offset
    /// of all frames.
    ///
    /// The fitness counts every feature point with a motion alike \[ZL\], and a tracker gives some to all of them.
    pub fn without_noise(&self, share: f64) -> Self {
        let count = self.frames.first().map_or(0, |f| f.offsets.len());
        let largest = |point: usize| self.frames.iter().filter_map(|f| f.offsets[point]).map(|v| v.norm()).fold(0.0, f64::max);
        let reach: Vec<f64> = (0..count).map(largest).collect();
        let least = share * reach.iter().copied().fold(0.0, f64::max);
        let still =
            |(offset, reach): (&Option<Vector3<f64>>, &f64)| offset.map(|v| if *reach < least { Vector3::zeros() } else { v });
        let frame = |f: &FpMotion| FpMotion { offsets: f.offsets.iter().zip(&reach).map(still).collect(), planar: f.planar };
        Self { frames: self.frames.iter().map(frame).collect(), ..self.clone() }
    }

    /// The motion with its last frame held for so many frames more, and then back to its first frame, the last again.
    pub fn there_and_back(&self, hold: usize) -> Self {
        let mut frames = self.frames.clone();
        if let Some(apex) = self.frames.last() {
            frames.extend(std::iter::repeat_n(apex.clone(), hold));
            frames.extend(self.frames.iter().rev().skip(1).cloned());
        }
        Self { frames, ..self.clone() }
    }

    /// Whether nothing moves in any frame.
    pub fn is_still(&self) -> bool {
        self.frames.iter().all(|f| f.total_length() == 0.0)
    }
}

/// Reads a motion for a bank. `scale` is in bank units per face unit and stands for the bank's FAPUs where these cannot be measured.
///
/// The kind is known by the name (`.fap`) or the header: a column `fp` for feature points, `state` for a track, else a model.
///
/// ```
/// # let mesh = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// # let mesh = grimace::mesh::TriangleMesh::new(mesh, vec![[0, 1, 2], [0, 2, 3]])?;
/// # let names = ["right", "up"].map(str::to_owned).to_vec();
/// # let moves = [[[1.0, 0.0, 0.0]; 4], [[0.0, 1.0, 0.0]; 4]].concat();
/// # let points = [("8.4", 0), ("8.3", 1), ("3.11", 2)];
/// # let points = points.map(|(fp, vertex)| grimace::synthesis::FeaturePointVertex { fp: fp.parse().unwrap(), vertex }).to_vec();
/// # let bank = grimace::synthesis::Bank::new(mesh, names, moves, points, Default::default())?;
/// use grimace::synthesis::{MotionKind, read_motion};
///
/// // The two members of `bank` move all vertices by 1: to the right, and up.
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("motion.csv");
/// std::fs::write(&path, "frame,fp,dx,dy,dz\n0,8.3,0,0,0\n1,8.3,0.25,0,0\n")?;
/// let motion = read_motion(&path, &bank, None)?;
/// assert_eq!((motion.kind, motion.frames.len()), (MotionKind::FeaturePoints, 2));
/// assert_eq!(motion.frames[1].total_length(), 0.25);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`SynthesisError`] for files that do not read, for a bank without the feature points that its size is measured on, and for motions
/// that have no feature point in common with the bank.
pub fn read_motion(path: &Path, bank: &Bank, scale: Option<f64>) -> Result<Motion, SynthesisError> {
    let motion = if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("fap")) {
        read_fap_motion(path, &BankFace::new(bank, scale)?)?
    } else {
        let file = CsvFile::open(path)?;
        if file.column("fp").is_some() {
            read_points(&file, bank)?
        } else if file.column("state").is_some() {
            read_track_motion(path, &BankFace::new(bank, scale)?)?
        } else if file.column("node").is_some() {
            read_model(file, &BankFace::new(bank, scale)?)?
        } else {
            let found = excerpt(&file.header().join(","));
            let reason = format!(
                "the header is `{found}`; expected were frame,fp,dx,dy,dz (feature points), frame,node,x,y (a representative or a \
                 normalized model) or frame,node,x,y,state,residual (a track)"
            );
            return Err(SynthesisError::Motion { path: path.to_owned(), reason });
        }
    };
    if motion.frames.iter().all(|f| f.offsets.iter().all(Option::is_none)) {
        let found = bank.feature_points().iter().map(|p| p.fp.to_string()).collect();
        return Err(SynthesisError::NothingInCommon { found });
    }
    Ok(motion)
}

fn implausible(path: &Path) -> impl Fn(Implausible) -> SynthesisError {
    move |source| SynthesisError::Implausible { path: path.to_owned(), source }
}

/// The size of a bank's face: its eye separation; where it has no eyes, as much as its mesh measures from corner to corner.
fn face_size(bank: &Bank) -> FaceSize {
    let at = |fp: FeaturePoint| bank.feature_point_position(fp).map(|[x, y, _]| Vector2::new(f64::from(x), f64::from(y)));
    let eye_separation = length(Fapu::Es, &at).filter(|es| *es > 0.0).unwrap_or_else(|| bank.mesh().diagonal());
    FaceSize { eye_separation, unit: "of the bank's units" }
}

fn read_points(file: &CsvFile, bank: &Bank) -> Result<Motion, SynthesisError> {
    let size = face_size(bank);
    let [frame, fp, dx, dy] = file.require(["frame", "fp", "dx", "dy"])?;
    let dz = file.column("dz");
    let mut frames: BTreeMap<u32, FpMotion> = BTreeMap::new();
    let mut ignored = Vec::new();
    let count = bank.feature_points().len();
    let mut planar = dz.is_none();
    for row in file.rows() {
        let row = row?;
        let point: FeaturePoint = row.get(fp).parse().map_err(|_| row.field_error(fp, "an MPEG-4 feature point such as 8.3"))?;
        let depth = dz.filter(|&dz| !row.get(dz).is_empty());
        planar |= depth.is_none();
        let z = depth.map_or(Ok(0.0), |dz| row.number(dz))?;
        let offset = Vector3::new(row.number(dx)?, row.number(dy)?, z);
        let number = row.whole_number(frame)?;
        for offset in [offset.xy(), offset.yz()] {
            let named = || format!("feature point {point}");
            size.check(number, named, offset, "its place in the neutral mesh").map_err(implausible(file.path()))?;
        }
        let motion = frames.entry(number).or_insert_with(|| FpMotion { offsets: vec![None; count], planar: false });
        match bank.feature_point_index(point) {
            None if !ignored.contains(&point) => ignored.push(point),
            None => {}
            Some(place) if motion.offsets[place].is_some() => {
                return Err(row.field_error(fp, "one row for every feature point of a frame").into());
            }
            Some(place) => motion.offsets[place] = Some(offset),
        }
    }
    frames.values_mut().for_each(|f| f.planar = planar);
    let of = |frames| Motion { kind: MotionKind::FeaturePoints, frames, fps: None, ignored, not_shown: Vec::new(), scale: None };
    filled(frames, of).map_err(|reason| SynthesisError::Motion { path: file.path().to_owned(), reason })
}

/// Key frames by their numbers with those between that are not there: on the curve of FAP files where they are evenly apart, else on a line.
fn filled(frames: BTreeMap<u32, FpMotion>, of: impl FnOnce(Vec<FpMotion>) -> Motion) -> Result<Motion, String> {
    /// Most frames in all.
    const MOST: u32 = 100_000;
    let (numbers, keys): (Vec<u32>, Vec<FpMotion>) = frames.into_iter().unzip();
    let (Some(first), Some(last)) = (numbers.first(), numbers.last()) else { return Err("the table has no rows".to_owned()) };
    if last - first > MOST {
        return Err(format!("{} frames, numbered from {first} to {last}: number frames one after the other", numbers.len()));
    }
    let steps: Vec<u32> = numbers.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if let Some(&step) = steps.first().filter(|step| steps.iter().all(|other| other == *step)) {
        return Ok(of(keys).with_frames_between(step as usize - 1));
    }
    let mut all = Vec::new();
    for (pair, step) in keys.windows(2).zip(steps) {
        let between = |k: u32| {
            let share = f64::from(k) / f64::from(step);
            let offset = |(a, b): (&Option<Vector3<f64>>, &Option<Vector3<f64>>)| Some((*a)?.lerp(&(*b)?, share));
            FpMotion { offsets: pair[0].offsets.iter().zip(&pair[1].offsets).map(offset).collect(), planar: pair[0].planar }
        };
        all.push(pair[0].clone());
        all.extend((1..step).map(between));
    }
    all.extend(keys.last().cloned());
    Ok(of(all))
}

fn read_model(file: CsvFile, face: &BankFace<'_>) -> Result<Motion, SynthesisError> {
    let table = PositionTable::new(file)?;
    let model = table.model()?;
    face.motion(MotionKind::Model, (&model, LidUnits::CANONICAL), None, table.path())
}

fn read_track_motion(path: &Path, face: &BankFace<'_>) -> Result<Motion, SynthesisError> {
    let (frames, info) = (read_track(path)?, read_track_info(path)?);
    let (found, expected) = (frames.first().map_or(0, |f| f.nodes.len()), face.wireframe.node_count());
    if found != expected {
        let reason = format!("{found} nodes; Candide-3 has {expected}");
        return Err(SynthesisError::Motion { path: path.to_owned(), reason });
    }
    let marks = info.as_ref().map(TrackInfo::mark_places).unwrap_or_default();
    let fps = info.and_then(|info| info.fps);
    // A head that turns would be taken for an expression.
    let own = Face { wireframe: face.wireframe.clone(), tables: face.tables.clone() };
    let track = match without_turns(&own, &frames, &marks) {
        Some(track) => track,
        None => track_model(&frames)?,
    };
    let normalizer = Normalizer::new(&face.wireframe, &face.tables, NormalizeOptions::default())?;
    let model =
        normalizer.normalize_every_frame(&track).map_err(|source| SynthesisError::Normalize { path: path.to_owned(), source })?;
    // As in the FAP file of the same track.
    let lids = normalizer.lid_units(track.neutral().nodes());
    face.motion(MotionKind::Track, (&model, lids), fps, path)
}

/// A FAP file's motion. FAPs that no frame sets rest: FAPs are offsets from neutral, and a mixture in which feature points were free
/// that the file does not speak of would close the eyes or open the mouth for the sake of a brow. So a file that sets few FAPs moves as
/// the same file with the others at 0, as \[ZL\] have it, whose input is the motion of all 56 feature points, zero or not. A FAP that only
/// some frames set is 0 in the others: files leave out what rests. What is unknown are points that no frontal FAP drives.
fn read_fap_motion(path: &Path, face: &BankFace<'_>) -> Result<Motion, SynthesisError> {
    let mut sequence = read_fap(path)?.sequence;
    let set = sequence.set_faps();
    let catalog = FapCatalog::mpeg4();
    let is_shown = |fap: FapNumber| {
        let row = catalog.row(fap);
        row.shows_from_front() && row.nodes.iter().any(|&node| face.has(node))
    };
    sequence.apply_mask(&FapMask::Set);
    let not_shown = sequence.moving_faps().into_iter().filter(|&fap| !is_shown(fap)).collect();
    for fap in FapNumber::low_level().filter(|fap| !set.contains(fap)) {
        sequence.frames.iter_mut().for_each(|frame| frame.set_value(fap, Some(0.0)));
    }
    let mut frames = Vec::with_capacity(sequence.frames.len());
    for (number, frame) in (0..).zip(&sequence.frames) {
        let offsets = offsets_from_frame(frame, &face.canonical.fapus, catalog)?;
        let (size, from) = (FaceSize::CANONICAL, "where the neutral face has it");
        for (node, offset) in &offsets {
            let offset = Vector2::new(offset.x.unwrap_or(0.0), offset.y.unwrap_or(0.0));
            size.check(number, || format!("node {node}"), offset, from).map_err(implausible(path))?;
        }
        // An axis that no FAP drives rests with its point.
        frames.push(face.frame(|node| offsets.get(&node).map(|o| Vector2::new(o.x.unwrap_or(0.0), o.y.unwrap_or(0.0)))));
    }
    let fps = Some(sequence.fps);
    Ok(Motion { kind: MotionKind::Fap, frames, fps, ignored: Vec::new(), not_shown, scale: Some(face.scale) })
}

/// Candide-3's face beside the bank's.
struct BankFace<'b> {
    bank: &'b Bank,
    wireframe: Wireframe,
    tables: Tables,
    canonical: Canonical,
    /// Bank units per face unit, by FAPU.
    scale: [f64; 5],
}

impl<'b> BankFace<'b> {
    fn new(bank: &'b Bank, scale: Option<f64>) -> Result<Self, SynthesisError> {
        let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
        let canonical = Canonical::new(&wireframe, &tables)?;
        let scale = match scale {
            Some(scale) if scale > 0.0 && scale.is_finite() => [scale; 5],
            Some(scale) => {
                let found = scale.to_string();
                return Err(SynthesisError::Option { what: "the scale", found, expected: "a number greater than 0" });
            }
            None => {
                let of_bank =
                    |fp: FeaturePoint| bank.feature_point_position(fp).map(|[x, y, _]| Vector2::new(f64::from(x), f64::from(y)));
                let of_candide = |fp: FeaturePoint| {
                    let node = tables.feature_point_nodes(fp)?.first()?;
                    canonical.neutral.node(*node).map(|p| p.coords)
                };
                scale_of(&of_bank, &of_candide)?
            }
        };
        Ok(Self { bank, wireframe, tables, canonical, scale })
    }

    fn motion(
        &self,
        kind: MotionKind,
        (model, lids): (&DynamicExpressionModel<FaceUnit>, LidUnits),
        fps: Option<f64>,
        path: &Path,
    ) -> Result<Motion, SynthesisError> {
        let (found, expected) = (model.node_count(), self.wireframe.node_count());
        if found != expected {
            let reason = format!("{found} nodes; Candide-3 has {expected}");
            return Err(SynthesisError::Motion { path: path.to_owned(), reason });
        }
        FaceSize::CANONICAL.check_model(model).map_err(implausible(path))?;
        let frames = (0..model.frame_count())
            .map(|m| {
                let offsets = model.neutral_offsets(m);
                self.frame(|node| offsets.get(node.index()).map(|o| Vector2::new(o.x, o.y * lids.of_node(node))))
            })
            .collect();
        Ok(Motion { kind, frames, fps, ignored: Vec::new(), not_shown: Vec::new(), scale: Some(self.scale) })
    }

    /// Whether a feature point of the bank goes with a node.
    fn has(&self, node: NodeId) -> bool {
        let mut nodes = self.bank.feature_points().iter().filter_map(|p| self.tables.feature_point_nodes(p.fp));
        nodes.any(|nodes| nodes.contains(&node))
    }

    /// The motion of the bank's feature points from node offsets, face units.
    fn frame(&self, offset: impl Fn(NodeId) -> Option<Vector2<f64>>) -> FpMotion {
        let ratio = |fapu: Fapu| Fapu::LENGTHS.iter().position(|&u| u == fapu).map_or(self.scale[1], |k| self.scale[k]);
        let of_point = |fp: FeaturePoint| {
            let nodes = self.tables.feature_point_nodes(fp)?;
            let known: Vec<Vector2<f64>> = nodes
                .iter()
                .filter_map(|&node| {
                    let (x, y) = self.tables.node_fapus(node);
                    offset(node).map(|o| Vector2::new(o.x * ratio(x), o.y * ratio(y)))
                })
                .collect();
            let sum: Vector2<f64> = known.iter().sum();
            (!known.is_empty()).then(|| (sum / known.len() as f64).push(0.0))
        };
        FpMotion { offsets: self.bank.feature_points().iter().map(|p| of_point(p.fp)).collect(), planar: true }
    }
}

/// Lengths of the bank over those of the canonical Candide-3 for the five FAPUs. A length that one of them lacks takes the ratio of the
/// eye separation.
fn scale_of(
    bank: &dyn Fn(FeaturePoint) -> Option<Vector2<f64>>,
    candide: &dyn Fn(FeaturePoint) -> Option<Vector2<f64>>,
) -> Result<[f64; 5], SynthesisError> {
    let ratio = |fapu: Fapu| {
        let (bank, candide) = (length(fapu, bank)?, length(fapu, candide)?);
        (bank > 0.0 && candide > 0.0).then(|| bank / candide)
    };
    let es = ratio(Fapu::Es).ok_or_else(|| SynthesisError::Scale {
        reason: "the eye separation needs the corners of both eyes, feature points 3.7, 3.8, 3.11 and 3.12, left of each other"
            .to_owned(),
    })?;
    Ok(Fapu::LENGTHS.map(|fapu| ratio(fapu).unwrap_or(es)))
}

/// A FAPU length of a bank's face, in its unit; `None` where its feature points are not there.
pub fn fapu_length(bank: &Bank, fapu: Fapu) -> Option<f64> {
    let at = |fp: FeaturePoint| bank.feature_point_position(fp).map(|[x, y, _]| Vector2::new(f64::from(x), f64::from(y)));
    length(fapu, &at).filter(|length| *length > 0.0)
}

/// A FAPU length by feature points of the skin; the pupils stand halfway between the corners of their eye.
fn length(fapu: Fapu, at: &dyn Fn(FeaturePoint) -> Option<Vector2<f64>>) -> Option<f64> {
    let at = |group: u8, point: u8| at(FeaturePoint { group, point });
    let pupil = |outer: u8, inner: u8| Some((at(3, outer)? + at(3, inner)?) / 2.0);
    let eyes = || Some((pupil(7, 11)?, pupil(12, 8)?));
    match fapu {
        Fapu::Irisd => Some(f64::midpoint(at(3, 1)?.y - at(3, 3)?.y, at(3, 2)?.y - at(3, 4)?.y)),
        Fapu::Es => eyes().map(|(left, right)| left.x - right.x),
        Fapu::Ens => eyes().and_then(|(left, right)| Some(f64::midpoint(left.y, right.y) - at(9, 15)?.y)),
        Fapu::Mns => Some(at(9, 15)?.y - at(2, 2)?.y),
        Fapu::Mw => Some(at(8, 3)?.x - at(8, 4)?.x),
        Fapu::Au => None,
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use approx::assert_relative_eq;

    use super::*;
    use crate::synthesis::{candide_bank, testing};

    fn read(text: &str) -> Result<Motion, SynthesisError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.csv");
        fs::write(&path, text).unwrap();
        read_motion(&path, &testing::bank(), None)
    }

    #[test]
    fn feature_points_are_read_in_space_and_in_the_plane() {
        let motion = read("frame,fp,dx,dy,dz\n3,8.4,1,2,3\n7,8.3,0,0,0\n7,2.1,1,1,1\n").unwrap();
        // Frames 4 to 6 are put between.
        assert_eq!(motion.frames.len(), 5);
        assert_eq!(motion.frames[0].offsets, [Some(Vector3::new(1.0, 2.0, 3.0)), None, None]);
        assert!(!motion.frames[0].planar);
        assert_eq!(motion.ignored, ["2.1".parse().unwrap()]);
        let uneven = read("frame,fp,dx,dy\n0,8.4,0,0\n2,8.4,2,0\n3,8.4,6,0\n").unwrap();
        let x: Vec<f64> = uneven.frames.iter().map(|f| f.offsets[0].unwrap().x).collect();
        assert_eq!(x, [0.0, 1.0, 2.0, 6.0]);
        assert!(read("frame,fp,dx,dy\n0,8.4,0,0\n4000000000,8.4,2,0\n").is_err());
        assert!(read("frame,fp,dx,dy,dz\n3,8.4,1,2,\n").unwrap().frames[0].planar);
        assert!(read("frame,fp,dx,dy\n3,8.4,1,2\n").unwrap().frames[0].planar);
    }

    #[test]
    fn bad_motions_say_where() {
        let says = |text: &str, part: &str| {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        };
        says("a,b\n1,2\n", "the header is `a,b`; expected were frame,fp,dx,dy,dz");
        says("frame,fp,dx,dy\n0,8.4,1,x\n", "line 2: dy is `x`");
        says("frame,fp,dx,dy\n0,8.4,1,1\n0,8.4,1,1\n", "line 3: fp is `8.4`; one row for every feature point");
        says("frame,fp,dx,dy\n0,2.1,1,1\n", "no feature point in common with the bank, which has 8.4, 8.3, 3.11");
        // The tiny bank has no eyes to measure its size on.
        says("frame,node,x,y\n0,0,1,1\n", "3.7, 3.8, 3.11 and 3.12");
    }

    #[test]
    fn candide_measures_itself_at_its_own_size() {
        // The bank's neutral is Candide-3 in model units, rounded by the subdivision; ES0 is 0.613 of them and 1024 face units.
        let bank = candide_bank().unwrap();
        let face = BankFace::new(&bank, None).unwrap();
        let expected = 0.613 / 1024.0;
        for scale in face.scale {
            assert!((scale / expected - 1.0).abs() < 0.25, "{scale}");
        }
        let motion = face.frame(|node| (node == NodeId(31)).then(|| Vector2::new(10.0, 0.0)));
        let corner = bank.feature_point_index("8.3".parse().unwrap()).unwrap();
        assert_relative_eq!(motion.offsets[corner].unwrap().x, 10.0 * face.scale[4], epsilon = 1e-12);
        assert_eq!(motion.offsets.iter().flatten().count(), 1);
    }

    #[test]
    fn feature_points_of_faps_that_a_file_never_sets_rest() {
        let bank = candide_bank().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("brow.fap");
        // Inner brows in both frames, the left middle one in the first frame alone.
        let mask = |set: &[u8]| (1..=68).map(|k| if set.contains(&k) { "1" } else { "0" }).collect::<Vec<_>>().join(" ");
        fs::write(&path, format!("2.1 brow 25 2\n{}\n0 0 0 0\n{}\n1 100 100\n", mask(&[31, 32, 33]), mask(&[31, 32]))).unwrap();
        let motion = read_motion(&path, &bank, None).unwrap();
        let offset =
            |frame: usize, fp: &str| motion.frames[frame].offsets[bank.feature_point_index(fp.parse().unwrap()).unwrap()];
        assert!(offset(1, "4.1").is_some_and(|v| v.y > 0.0));
        // Lids, lips and chin stay where they are, and so does the middle brow in the frame that leaves it out.
        assert!(["3.1", "8.3", "2.1", "4.3"].iter().all(|fp| offset(1, fp) == Some(Vector3::zeros())));
        assert_eq!(offset(0, "4.3"), Some(Vector3::zeros()));
    }

    #[test]
    fn frames_in_between_lie_on_the_curve_of_fap_files() {
        let motion = read("frame,fp,dx,dy\n0,8.4,0,0\n1,8.4,3,6\n").unwrap().with_frames_between(2);
        let x: Vec<f64> = motion.frames.iter().map(|f| f.offsets[0].unwrap().x).collect();
        assert_eq!(motion.frames.len(), 4);
        (0..4).for_each(|k| assert_relative_eq!(x[k], k as f64, epsilon = 1e-12));
        // Keys 0, 8, 8: half-way of the first step 5, as a FAP of the same keys has it; the second is flat.
        let keys = read("frame,fp,dx,dy\n0,8.4,0,0\n1,8.4,8,-8\n2,8.4,8,-8\n").unwrap().with_frames_between(1);
        let offsets: Vec<_> = keys.frames.iter().map(|f| f.offsets[0].unwrap()).map(|o| (o.x, o.y)).collect();
        assert_eq!(offsets, [(0.0, 0.0), (5.0, -5.0), (8.0, -8.0), (8.0, -8.0), (8.0, -8.0)]);
        // 8.3 goes 0.1 at most where 8.4 goes 6.7: less than 5 %.
        let noisy = read("frame,fp,dx,dy\n0,8.4,0,0\n0,8.3,0.1,0\n1,8.4,3,6\n1,8.3,0,0.1\n").unwrap();
        let quiet = noisy.without_noise(0.05);
        assert!(quiet.frames.iter().all(|f| f.offsets[1] == Some(Vector3::zeros())));
        assert_eq!(quiet.frames[1].offsets[0], noisy.frames[1].offsets[0]);
        assert_eq!(noisy.without_noise(0.0), noisy);
        assert!(!motion.is_still() && read("frame,fp,dx,dy\n0,8.4,0,0\n").unwrap().is_still());
    }
}
