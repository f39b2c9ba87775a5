//! Reads motions from the output of other stages: representatives, normalized models, tracks, FAP files, or a CSV file.

use std::{collections::BTreeMap, path::Path};

use nalgebra::{Vector2, Vector3};

use super::{
    Motion, MotionKind,
    bank_face::{BankFace, face_size, implausible},
};
use crate::{
    fap::{ANGLE_UNIT_RAD, FapCatalog, FapFrame, FapNumber, FapSequence, offsets_from_frame, read_fap},
    input::CsvFile,
    interpolation::{MOST_EVEN, too_many_between},
    model::DynamicExpressionModel,
    normalize::{NormalizeOptions, Normalizer, check_face_units},
    plausible::FaceSize,
    pose::without_turns,
    positions::PositionTable,
    synthesis::{Bank, FpMotion, SynthesisError},
    text::excerpt,
    track::{TrackInfo, clock_of_frames, read_track, read_track_info, track_model},
    units::{FaceUnit, FeaturePoint, NodeId},
    wireframe::LidUnits,
};

/// Reads a motion for a bank.
///
/// `scale`, in bank units per face unit, replaces the bank's FAPUs when these cannot be measured. The kind is recognized by the
/// extension (`.fap`) or the header: a column `fp` means feature points, `state` a track, anything else a model.
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
/// [`SynthesisError`] for files that cannot be read, for a bank without the feature points that its size is measured on, and for
/// motions that share no feature point with the bank.
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
                "the header is `{found}`; expected frame,fp,dx,dy,dz (feature points), frame,node,x,y (a representative or a normalized \
                 model) or frame,node,x,y,state,residual (a track)"
            );
            return Err(SynthesisError::Motion { path: path.to_owned(), reason });
        }
    };
    with_something_in_common(motion, bank)
}

impl Motion {
    /// Returns the motion of a model for a bank: of a representative, or of a normalized sequence. `name` is for errors; `scale` as in
    /// [`read_motion`].
    ///
    /// # Errors
    /// [`SynthesisError`] for a model that is not of Candide-3 or not in face units, for a motion that is impossible for a face, and for a
    /// bank as in [`read_motion`].
    pub fn from_model(
        name: &str,
        model: &DynamicExpressionModel<FaceUnit>,
        bank: &Bank,
        scale: Option<f64>,
    ) -> Result<Self, SynthesisError> {
        with_something_in_common(model_motion(model, &BankFace::new(bank, scale)?, Path::new(name))?, bank)
    }

    /// Returns the motion of FAPs for a bank. `name` is for errors; `scale` as in [`read_motion`].
    ///
    /// # Errors
    /// [`SynthesisError`] for a sequence without frames, a motion that is impossible for a face, and a bank as in [`read_motion`].
    pub fn from_fap(name: &str, sequence: &FapSequence, bank: &Bank, scale: Option<f64>) -> Result<Self, SynthesisError> {
        if sequence.frames.is_empty() {
            return Err(SynthesisError::Motion { path: name.into(), reason: "the FAP sequence has no frames".to_owned() });
        }
        with_something_in_common(fap_motion(sequence.clone(), &BankFace::new(bank, scale)?, Path::new(name))?, bank)
    }
}

/// Returns a motion that shares a feature point with the bank.
fn with_something_in_common(motion: Motion, bank: &Bank) -> Result<Motion, SynthesisError> {
    if motion.frames.iter().all(|f| f.offsets.iter().all(Option::is_none)) {
        let found = bank.feature_points().iter().map(|p| p.fp.to_string()).collect();
        return Err(SynthesisError::NothingInCommon { found });
    }
    Ok(motion)
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
        let motion = frames.entry(number).or_insert_with(|| FpMotion { offsets: vec![None; count], ..FpMotion::default() });
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
    let found = frames.len();
    let of = |frames| Motion {
        kind: MotionKind::FeaturePoints,
        frames,
        fps: None,
        ignored,
        not_shown: Vec::new(),
        scale: None,
        uneven: None,
    };
    let filled = filled(frames, of);
    let said = |motion: Motion| Motion { uneven: (motion.frames.len() > found).then_some(found), ..motion };
    filled.map(said).map_err(|reason| SynthesisError::Motion { path: file.path().to_owned(), reason })
}

/// Fills in the frames missing between key frames. The interpolation is the curve of FAP files if the key frames are equally
/// spaced, otherwise linear.
fn filled(frames: BTreeMap<u32, FpMotion>, of: impl FnOnce(Vec<FpMotion>) -> Motion) -> Result<Motion, String> {
    let (numbers, keys): (Vec<u32>, Vec<FpMotion>) = frames.into_iter().unzip();
    let (Some(first), Some(last)) = (numbers.first(), numbers.last()) else { return Err("the table has no rows".to_owned()) };
    if last - first >= MOST_EVEN {
        return Err(format!("{} frames, numbered from {first} to {last}: number the frames consecutively", numbers.len()));
    }
    let steps: Vec<u32> = numbers.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if let Some(&step) = steps.first().filter(|step| steps.iter().all(|other| other == *step)) {
        return of(keys).with_frames_between(step as usize - 1).map_err(|e| e.to_string());
    }
    let mut all = Vec::new();
    for (pair, step) in keys.windows(2).zip(steps) {
        let between = |k: u32| {
            let share = f64::from(k) / f64::from(step);
            let offset = |(a, b): (&Option<Vector3<f64>>, &Option<Vector3<f64>>)| Some((*a)?.lerp(&(*b)?, share));
            FpMotion { offsets: pair[0].offsets.iter().zip(&pair[1].offsets).map(offset).collect(), ..pair[0].clone() }
        };
        all.push(pair[0].clone());
        all.extend((1..step).map(between));
    }
    all.extend(keys.last().cloned());
    Ok(of(all))
}

fn read_model(file: CsvFile, face: &BankFace<'_>) -> Result<Motion, SynthesisError> {
    let table = PositionTable::new(file)?;
    model_motion(&table.model()?, face, table.path())
}

/// The motion of a normalized model; `path` is for errors.
fn model_motion(model: &DynamicExpressionModel<FaceUnit>, face: &BankFace<'_>, path: &Path) -> Result<Motion, SynthesisError> {
    // Models that are too far off to be a face are reported below.
    if FaceSize::CANONICAL.check_model(model).is_ok() {
        let not_face_units = |source| SynthesisError::NotFaceUnits { path: path.to_owned(), source };
        check_face_units(model.neutral().nodes()).map_err(not_face_units)?;
    }
    face.motion(MotionKind::Model, (model, LidUnits::CANONICAL), None, path)
}

fn read_track_motion(path: &Path, face: &BankFace<'_>) -> Result<Motion, SynthesisError> {
    let (frames, info) = (read_track(path)?, read_track_info(path)?);
    let (found, expected) = (frames.first().map_or(0, |f| f.nodes.len()), face.candide.wireframe.node_count());
    if found != expected {
        let reason = format!("{found} nodes; Candide-3 has {expected}");
        return Err(SynthesisError::Motion { path: path.to_owned(), reason });
    }
    let marks = info.as_ref().map(TrackInfo::mark_places).unwrap_or_default();
    let numbers: Vec<u32> = frames.iter().map(|frame| frame.number).collect();
    let clock = clock_of_frames(&numbers, info.as_ref());
    // A turning head would look like an expression.
    let track = match without_turns(&face.candide, &frames, &marks) {
        Some(track) => track,
        None => track_model(&frames)?,
    };
    let normalizer = Normalizer::new(&face.candide.wireframe, &face.candide.tables, NormalizeOptions::default())?;
    let model =
        normalizer.normalize_every_frame(&track).map_err(|source| SynthesisError::Normalize { path: path.to_owned(), source })?;
    // As in the FAP file of the same track.
    let lids = normalizer.lid_units(track.neutral().nodes());
    let motion = face.motion(MotionKind::Track, (&model, lids), clock.fps, path)?;
    let Some(times) = clock.times else { return Ok(motion) };
    motion.evenly(&times).map_err(|frames| {
        let reason = too_many_between(frames, MOST_EVEN);
        SynthesisError::Motion { path: path.to_owned(), reason }
    })
}

/// Reads the motion of a FAP file.
fn read_fap_motion(path: &Path, face: &BankFace<'_>) -> Result<Motion, SynthesisError> {
    fap_motion(read_fap(path)?.sequence, face, path)
}

/// The motion of a FAP file's sequence; `path` is for errors.
///
/// A FAP that only some frames set is interpolated in the others (`FapSequence::fill_gaps`). Of the inner and the outer contour
/// of the lips, one that the file never sets follows the other, as MPEG-4's decoders do it. Feature points of which the file sets no
/// FAP are free, and so is one axis of a point of which it sets the other: whoever raises two corners of a mouth does not hold the
/// rest of it still.
pub(super) fn fap_motion(mut sequence: FapSequence, face: &BankFace<'_>, path: &Path) -> Result<Motion, SynthesisError> {
    sequence.fill_gaps();
    let catalog = FapCatalog::mpeg4();
    let is_shown = |fap: FapNumber| {
        let row = catalog.row(fap);
        row.shows_from_front() && row.nodes.iter().any(|&node| face.has(node))
    };
    let turns = [48, 49, 50].map(|number| FapNumber::try_from(number).ok());
    let not_shown = sequence.moving_faps().into_iter().filter(|&fap| !is_shown(fap) && !turns.contains(&Some(fap))).collect();
    let turn_of =
        |frame: &FapFrame| Vector3::from(turns.map(|fap| ANGLE_UNIT_RAD * fap.and_then(|fap| frame.value(fap)).unwrap_or(0.0)));
    let set = sequence.set_faps();
    for (from, to) in catalog.lip_twins().iter().flat_map(|&(inner, outer)| [(inner, outer), (outer, inner)]) {
        if set.contains(&from) && !set.contains(&to) {
            sequence.frames.iter_mut().for_each(|frame| frame.set_value(to, frame.value(from)));
        }
    }
    // Where nothing is set that the bank has, the face rests. What a frontal view does not measure rests, too.
    let is_free = |fap: FapNumber| catalog.row(fap).frontal.is_measured() && set.iter().any(|&fap| is_shown(fap));
    let mut free = FapFrame::default();
    let set_now = sequence.set_faps();
    for fap in FapNumber::low_level().filter(|fap| !set_now.contains(fap)) {
        if is_free(fap) {
            free.set_value(fap, Some(0.0));
        } else {
            sequence.frames.iter_mut().for_each(|frame| frame.set_value(fap, Some(0.0)));
        }
    }
    let free = offsets_from_frame(&free, &face.canonical.fapus, catalog)?;
    let free = face.frame(|node| {
        let axis = |unset: Option<f64>| f64::from(u8::from(unset.is_some()));
        free.get(&node).map(|unset| Vector2::new(axis(unset.x), axis(unset.y)))
    });
    let free_axes: Vec<[bool; 2]> = free.offsets.iter().map(|o| o.map_or([false; 2], |v| [v.x > 0.0, v.y > 0.0])).collect();
    let frame_of =
        |offset: &dyn Fn(NodeId) -> Option<Vector2<f64>>| FpMotion { free_axes: free_axes.clone(), ..face.frame(offset) };
    let mut frames = Vec::with_capacity(sequence.frames.len());
    for (number, frame) in (0..).zip(&sequence.frames) {
        let offsets = offsets_from_frame(frame, &face.canonical.fapus, catalog)?;
        let (size, from) = (FaceSize::CANONICAL, "its place in the neutral face");
        for (node, offset) in &offsets {
            let offset = Vector2::new(offset.x.unwrap_or(0.0), offset.y.unwrap_or(0.0));
            size.check(number, || format!("node {node}"), offset, from).map_err(implausible(path))?;
        }
        // An axis that no FAP of a point drives does not move.
        let of_node = |node| offsets.get(&node).map(|o| Vector2::new(o.x.unwrap_or(0.0), o.y.unwrap_or(0.0)));
        if sequence.frames.len() == 1 {
            // A single pose is reached from the neutral face, as in `clone` and `play`.
            frames.push(frame_of(&|node| of_node(node).map(|_| Vector2::zeros())));
        }
        frames.push(FpMotion { turn: turn_of(frame), ..frame_of(&of_node) });
    }
    let fps = Some(sequence.fps);
    Ok(Motion { kind: MotionKind::Fap, frames, fps, ignored: Vec::new(), not_shown, scale: Some(face.scale), uneven: None })
}
