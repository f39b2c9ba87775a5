//! Writes a clone to files: frames, films, track, FAP file, overlay, sheet and `clone.json`.

use std::{collections::BTreeMap, fs, io, path::Path};

use image::{
    ImageEncoder, RgbImage,
    codecs::png::{CompressionType, FilterType, PngEncoder},
};
use nalgebra::Point2;
use serde::Serialize;

use super::{CloneError, CloneOptions, ClonedExpression, FaceCell, Sheet, SourceMotion, picture};
use crate::{
    fap::{Clamped, ConvertError, FapCatalog, FapMotion, FapSequence, Profile, ValueFormat, unlimited_faps, write_fap_as},
    features::head_faps,
    fit::{FitOptions, MarkKind},
    interpolation::FPS,
    model::{DynamicExpressionModel, FrameExpressionModel},
    normalize::{NormalizeOptions, SizeMode},
    output::{FolderRecord, MADE_BY, OutputError, write_atomic, write_bytes, write_json},
    overlay::draw_overlay,
    sequence::{Frame, ImageSize, check_video, write_video},
    track::{NodeState, TRACK_SCHEMA, TrackInfo, TrackOptions, TrackedFrame, TrackedNode, summarize, track_units, write_track},
    units::{Px, SequenceId},
    wireframe::Face,
};

/// A kind of film file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Film {
    /// Animated GIF.
    Gif,
    /// Animated PNG.
    Apng,
    /// MP4, through OpenCV.
    Mp4,
    /// `WebM`, through OpenCV.
    Webm,
}

impl Film {
    const ALL: [Self; 4] = [Self::Gif, Self::Apng, Self::Mp4, Self::Webm];

    fn file_name(self) -> &'static str {
        match self {
            Self::Gif => "clone.gif",
            Self::Apng => "clone.apng",
            Self::Mp4 => "clone.mp4",
            Self::Webm => "clone.webm",
        }
    }
}

/// Version of the schema of `clone.json`.
pub const CLONE_SCHEMA: u32 = 1;

/// Contents of `clone.json`: the inputs, options and results of a clone.
#[derive(Clone, Debug, Serialize)]
pub struct CloneInfo {
    /// Always [`CLONE_SCHEMA`].
    pub schema_version: u32,
    /// Program and version.
    pub made_by: &'static str,
    /// Units of lengths.
    pub units: BTreeMap<&'static str, &'static str>,
    /// The source's file.
    pub source: String,
    /// BLAKE3 of the source's file.
    pub source_blake3: Option<String>,
    /// The target's file.
    pub target: String,
    /// BLAKE3 of the target's file.
    pub target_blake3: Option<String>,
    /// BLAKE3 of the correspondences' file.
    pub correspondences_blake3: Option<String>,
    /// BLAKE3 of all inputs including the options; an identical later clone is not made again.
    pub inputs_blake3: String,
    /// Options of cloning.
    pub options: CloneOptions,
    /// Frames per second.
    pub fps: f64,
    /// Number of frames.
    pub frames: usize,
    /// Number of the apex frame, from 1.
    pub apex_frame: usize,
    /// FAPs that have values but do not show on a frontal face.
    pub faps_not_shown: Vec<u8>,
    /// Frames whose motion was smoothed so that no skin folds.
    pub frames_unfolded: usize,
    /// Number of FAP values beyond the standard's range that were set to its limit.
    pub faps_limited: usize,
    /// FAPs whose motion the warp reduced, because the skin would fold over, or lips and lids would pass through each other.
    pub faps_cut: Vec<CutFap>,
    /// FAPs that are shown stronger than requested or the other way, for the same reasons or because other FAPs take them along.
    pub faps_changed: Vec<CutFap>,
    /// File of the skin change that grows with the expression.
    pub skin: Option<String>,
    /// BLAKE3 of that file.
    pub skin_blake3: Option<String>,
    /// Factor on the strength of `--wrinkles` from the similarity of the light on source and target.
    pub wrinkles_light_share: Option<f64>,
}

/// A FAP that is not shown as requested: if it was reduced, in the frame with its largest requested value; if it was changed, in the
/// frame in which it goes farthest beyond.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CutFap {
    /// Number of the FAP.
    pub fap: u8,
    /// Frame of the clone, from 1.
    pub frame: usize,
    /// Value requested of the target, FAP units.
    pub asked: f64,
    /// Value that the clone shows, FAP units.
    pub shown: f64,
}

/// A FAP counts as cut if it lacks more than this fraction of the requested value, and more than `CUT_UNITS` units (angles: `CUT_ANGLE`
/// units of 1e-5 rad).
const CUT_SHARE: f64 = 0.1;
const CUT_UNITS: f64 = 20.0;
const CUT_ANGLE: f64 = 500.0;
/// FAPs of the eyelids, which a blink moves.
const LID_FAPS: std::ops::RangeInclusive<u8> = 19..=22;
/// A FAP counts as changed if it differs by as much and the value shown lies beyond what was requested, that is outside the range from 0
/// to the requested value, by more than this fraction of those units.
const BEYOND_SHARE: f64 = 0.5;

/// Where a clone is written, and which files besides the frames.
#[derive(Clone, Copy, Debug)]
pub struct CloneFiles<'a> {
    /// The folder.
    pub folder: &'a Path,
    /// Whether to overwrite files that no earlier clone recorded.
    pub force: bool,
    /// Films to write.
    pub films: &'a [Film],
    /// Options used to fit the target.
    pub fit: &'a FitOptions,
    /// Profile of the FAP file, for the programs that read it.
    pub profile: Profile,
    /// The source's pictures in the order of its track, for the sheet.
    pub source_frames: Option<&'a [RgbImage]>,
}

/// What [`write_clone`] wrote.
#[derive(Clone, Debug)]
pub struct WrittenClone {
    /// The rendered apex frame.
    pub apex: RgbImage,
    /// Frames, films and tracks of an earlier clone that were kept because they were changed since or not recorded.
    pub kept: Vec<String>,
    /// FAPs whose motion was reduced.
    pub faps_cut: Vec<CutFap>,
    /// FAPs that are shown stronger than requested or the other way.
    pub faps_changed: Vec<CutFap>,
}

/// File with the names and hashes of the frames, the track and the films.
pub const FRAMES_RECORD: &str = "frames.b3";
/// Height of the pictures of a sheet, px.
const SHEET_HEIGHT: u32 = 480;
/// Number of frames in each row of the sheet.
const SHEET_FRAMES: usize = 5;

/// Writes a clone to a folder: `frames/`, `track/` (the target's own dynamic model, readable by `analyze`), `clone.fap`,
/// `overlay.png` (the wireframe on the apex frame), `sheet.png` (source and clone side by side), `clone.json`, and the requested films.
///
/// `info` is completed with the results of rendering. `tick` is called after every frame and returns whether to continue.
///
/// Removes frames, films and tracks of an earlier clone that this one does not have, unless they were changed since
/// (compared with `frames.b3`).
///
/// # Errors
/// [`CloneError`] for a file that cannot be written, or for an interruption.
pub fn write_clone(
    files: &CloneFiles,
    clone: &ClonedExpression,
    source: &SourceMotion,
    mut info: CloneInfo,
    face: &Face,
    mut tick: impl FnMut() -> bool,
) -> Result<WrittenClone, CloneError> {
    let &CloneFiles { folder, films, source_frames, profile, .. } = files;
    let apex = clone.apex();
    let chosen = spread(clone.frames.len().min(apex + 1));
    let (mut shown, mut apex_picture) = (BTreeMap::new(), RgbImage::default());
    let name = |k: usize| format!("frames/{}_{:08}.png", clone.target().name, k + 1);
    let file = |k: usize| folder.join(name(k));
    // A missing video encoder is reported before any frame is drawn.
    for film in films {
        picture::check_rate(clone.fps)?;
        if matches!(film, Film::Mp4 | Film::Webm) {
            check_video(&folder.join(film.file_name()), clone.fps, clone.target().picture.dimensions())?;
        }
    }
    let record = FolderRecord::open(folder, FRAMES_RECORD, files.force)?;
    films.iter().try_for_each(|film| record.check_free(film.file_name()))?;
    (0..clone.frames.len()).try_for_each(|k| record.check_free(&name(k)))?;
    record.begin()?;
    // `clone.json` is written last: a folder without it holds no finished clone.
    let info_path = folder.join("clone.json");
    match fs::remove_file(&info_path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(OutputError::at(&info_path)(error).into()),
        _ => {}
    }
    for k in 0..clone.frames.len() {
        let picture = clone.picture(k)?;
        record.write(&name(k), |writer| encode_png(&picture, writer))?;
        if chosen.contains(&k) {
            shown.insert(k, picture.clone());
        }
        if k == apex {
            apex_picture.clone_from(&picture);
        }
        if !tick() {
            return Err(CloneError::Interrupted);
        }
    }
    // Films are made from the written frames, one at a time, because a film of large pictures does not fit into memory.
    let frame = |k: usize| match image::open(file(k)) {
        Ok(picture) => Ok(picture.into_rgb8()),
        Err(error) => Err(CloneError::Encode { what: "a film", reason: format!("{}: {error}", file(k).display()) }),
    };
    for film in films {
        let count = clone.frames.len();
        let frames = (0..count).map(frame);
        let path = folder.join(film.file_name());
        match film {
            Film::Gif => write_bytes(&path, &picture::animated_gif(frames, clone.fps)?)?,
            Film::Apng => write_bytes(&path, &picture::animated_png(frames, count, clone.fps)?)?,
            Film::Mp4 | Film::Webm => write_video(&path, frames, clone.fps)?,
        }
        record.enter_written(film.file_name())?;
    }
    let model = clone.model()?;
    let frames = tracked(clone, face);
    let (csv, mut track_info) = track_info(files, clone, source, &frames, &info, face);
    write_track(&csv, &frames, &mut track_info)?;
    for extension in ["csv", "json"] {
        record.enter_written(&format!("track/{}.{extension}", track_info.id))?;
    }
    let mut kept = record.remove_stale()?;
    // Versions up to 0.1.0 did not record films.
    let unrecorded = |film: &Film| !record.knows(film.file_name()) && folder.join(film.file_name()).exists();
    kept.extend(Film::ALL.iter().filter(|film| unrecorded(film)).map(|film| film.file_name().to_owned()));
    record.close()?;
    let (faps, clamped) = fap_of(&model, clone, source, face)?;
    (info.faps_cut, info.faps_changed) = faps_not_as_asked(source, clone, &model, face)?;
    let faps = faps.for_profile(profile).map_err(ConvertError::from)?;
    write_fap_as(&folder.join("clone.fap"), &faps, profile, ValueFormat::Integer)?;
    info.fps = clone.fps;
    info.frames = clone.frames.len();
    info.apex_frame = apex + 1;
    info.frames_unfolded = clone.frames.iter().filter(|f| f.deformation.unfolding_rounds() > 0).count();
    info.faps_limited = clamped.len();
    info.faps_not_shown = source.not_shown.iter().map(|f| f.get()).collect();
    let grey = image::imageops::grayscale(&apex_picture);
    let at_apex = &frames[apex + usize::from(clone.rest_before().is_some())].nodes;
    let overlay = draw_overlay(&Frame::new(1, grey), &face.wireframe, at_apex, &[]);
    write_atomic(&folder.join("overlay.png"), |writer| encode_png(&overlay, writer))?;
    let mut sheet = Sheet::new(SHEET_HEIGHT);
    if let Some(pictures) = source_frames {
        let row: Vec<_> = chosen.iter().filter_map(|&k| pictures.get(clone.frames[k].nearest)).collect();
        let nodes = chosen.iter().filter_map(|&k| source.frames.get(clone.frames[k].nearest)).flat_map(|(_, nodes)| nodes);
        let cell = FaceCell::around(row.first().map_or((0, 0), |p| p.dimensions()), nodes);
        sheet.push_row(row.into_iter().map(|picture| cell.of(picture)).collect());
    }
    let nodes = shown.keys().flat_map(|&k| clone.frames[k].deformation.nodes());
    let cell = FaceCell::around(clone.target().picture.dimensions(), nodes);
    sheet.push_row(shown.values().map(|picture| cell.of(picture)).collect());
    write_atomic(&folder.join("sheet.png"), |writer| encode_png(&sheet.draw(), writer))?;
    write_json(&info_path, &info)?;
    Ok(WrittenClone { apex: apex_picture, kept, faps_cut: info.faps_cut, faps_changed: info.faps_changed })
}

/// Indices of evenly spaced frames from the first to the last.
fn spread(count: usize) -> Vec<usize> {
    let wanted = SHEET_FRAMES.min(count);
    let mut chosen: Vec<usize> = (0..wanted).map(|k| if wanted < 2 { 0 } else { k * (count - 1) / (wanted - 1) }).collect();
    chosen.dedup();
    chosen
}

/// Converts the clone to a track. Its nodes are computed, not tracked: followers have the state `follows`, all others `fitted`.
fn tracked(clone: &ClonedExpression, face: &Face) -> Vec<TrackedFrame> {
    let followers: Vec<usize> = face.wireframe.followers().iter().map(|f| f.node.index()).collect();
    let frame = |(k, frame): (usize, &super::CloneFrame)| TrackedFrame {
        number: k as u32 + 1,
        nodes: frame
            .deformation
            .nodes()
            .iter()
            .enumerate()
            .map(|(n, &position)| {
                let state = if followers.contains(&n) { NodeState::Follows } else { NodeState::Fitted };
                TrackedNode::new(position, state, None)
            })
            .collect(),
    };
    let mut frames: Vec<TrackedFrame> = clone.frames.iter().enumerate().map(frame).collect();
    if let Some(rest) = clone.rest_before() {
        // A track begins with the neutral face: frame 0, which has no picture.
        let node = |&position: &Point2<f64>| TrackedNode::new(position, NodeState::Fitted, None);
        frames.insert(0, TrackedFrame { number: 0, nodes: rest.iter().map(node).collect() });
    }
    frames
}

/// Path of the track, and the metadata file next to it.
fn track_info(
    files: &CloneFiles,
    clone: &ClonedExpression,
    source: &SourceMotion,
    frames: &[TrackedFrame],
    info: &CloneInfo,
    face: &Face,
) -> (std::path::PathBuf, TrackInfo) {
    let target = clone.target();
    let id = SequenceId { subject: target.name.replace('_', "-"), sequence: source.name.replace('_', "-") };
    let (width, height) = target.picture.dimensions();
    let marks = &target.fitted.correspondences;
    let inputs = [&info.source_blake3, &info.target_blake3, &info.correspondences_blake3];
    let inputs = inputs.map(|hash| hash.clone().unwrap_or_default()).join(" ");
    let track_info = TrackInfo {
        schema_version: TRACK_SCHEMA,
        made_by: MADE_BY.to_owned(),
        units: track_units(),
        emotion: source.emotion.clone().unwrap_or_else(|| source.name.to_lowercase()),
        metadata: BTreeMap::from([("cloned_from".to_owned(), source.name.clone())]),
        source: vec![info.target.clone()],
        image_size: ImageSize { width, height },
        fps: Some(clone.fps),
        times: None,
        notes: Vec::new(),
        marks_from: "clone".to_owned(),
        marks: marks.iter().map(|m| (m.node.0, m.position.x, m.position.y, m.kind == MarkKind::Hard)).collect(),
        read: target.fitted.read.iter().map(|m| m.node).collect(),
        fit: files.fit.clone(),
        track: TrackOptions::default(),
        summary: summarize(frames, &face.wireframe, &face.tables),
        inputs_blake3: blake3::hash(inputs.as_bytes()).to_hex().to_string(),
        frames_blake3: None,
        csv_blake3: String::new(),
        corrections: None,
        neutral_frame: None,
        apex_frame: None,
        id: id.clone(),
    };
    (files.folder.join("track").join(format!("{id}.csv")), track_info)
}

/// Prepends the target's neutral face if the clone does not begin with it, because FAPs are offsets from neutral.
fn from_neutral(model: DynamicExpressionModel<Px>, clone: &ClonedExpression) -> Result<DynamicExpressionModel<Px>, CloneError> {
    let Some(rest) = clone.rest_before() else { return Ok(model) };
    let neutral = FrameExpressionModel::new(rest.to_vec());
    Ok(DynamicExpressionModel::new(std::iter::once(neutral).chain(model.frames().iter().cloned()).collect())?)
}

/// The target's FAP sequence: its own motion in its own FAPUs, and the turns of the source's head if they are carried over.
fn fap_of(
    model: &DynamicExpressionModel<Px>,
    clone: &ClonedExpression,
    source: &SourceMotion,
    face: &Face,
) -> Result<(FapSequence, Vec<Clamped>), CloneError> {
    let wireframe = |source| CloneError::Fapus { what: "the wireframe", source };
    let options = NormalizeOptions { size: SizeMode::Fapu, ..NormalizeOptions::default() };
    let normalizer = crate::normalize::Normalizer::new(&face.wireframe, &face.tables, options).map_err(wireframe)?;
    let starts_neutral = clone.rest_before().is_none();
    let normalized = normalizer.normalize_every_frame(&from_neutral(model.clone(), clone)?)?;
    let name = format!("{}_{}", clone.target().name, source.name);
    let units = (&normalizer.canonical().fapus, clone.target().lid_units());
    let (measured, clamped) = FapSequence::from_measured(&normalized, units, FapCatalog::mpeg4(), &name, FPS, 0)?;
    let mut sequence = FapSequence { fps: clone.fps, ..measured };
    if !starts_neutral {
        sequence.frames.remove(0);
    }
    for (frame, turn) in sequence.frames.iter_mut().zip(&clone.frames).filter_map(|(faps, frame)| Some((faps, frame.turn?))) {
        head_faps(turn).into_iter().for_each(|(fap, value)| frame.set_value(fap, Some(value)));
    }
    let mut sequence = sequence.at_whole_rate();
    sequence.round();
    Ok((sequence, clamped))
}

/// Requested FAPs that the model `shown` reduces, and those that it shows stronger or the other way. Values from a FAP file are those of
/// the file times the emphasis.
fn faps_not_as_asked(
    source: &SourceMotion,
    clone: &ClonedExpression,
    shown: &DynamicExpressionModel<Px>,
    face: &Face,
) -> Result<(Vec<CutFap>, Vec<CutFap>), CloneError> {
    let wireframe = |source| CloneError::Fapus { what: "the wireframe", source };
    let options = NormalizeOptions { size: SizeMode::Fapu, ..NormalizeOptions::default() };
    let normalizer = crate::normalize::Normalizer::new(&face.wireframe, &face.tables, options).map_err(wireframe)?;
    let catalog = FapCatalog::mpeg4();
    let units = (&normalizer.canonical().fapus, clone.target().lid_units());
    let asked = DynamicExpressionModel::new(clone.unshaped(source, face)?.into_iter().map(FrameExpressionModel::new).collect())?;
    let first = usize::from(clone.rest_before().is_some());
    let (asked, shown) = (from_neutral(asked, clone)?, from_neutral(shown.clone(), clone)?);
    let (asked, shown) = (normalizer.normalize_every_frame(&asked)?, normalizer.normalize_every_frame(&shown)?);
    // Of every FAP the frame with its largest requested value, and the one in which it goes farthest beyond.
    let (mut most, mut farthest): (BTreeMap<u8, CutFap>, BTreeMap<u8, CutFap>) = Default::default();
    for frame in first..asked.frame_count().min(shown.frame_count()) {
        let asked = unlimited_faps(&asked.neutral_offsets(frame), units, catalog)?;
        let shown = unlimited_faps(&shown.neutral_offsets(frame), units, catalog)?;
        let blinks = clone.blinks(frame - first);
        for ((fap, asked), (_, shown)) in asked.into_iter().zip(shown).filter(|((fap, _), _)| source.asks_for(*fap)) {
            let fap = fap.get();
            if blinks && LID_FAPS.contains(&fap) {
                continue; // The blink was asked for, too.
            }
            let found = CutFap { fap, frame: frame + 1 - first, asked: asked.round() + 0.0, shown: shown.round() + 0.0 };
            if asked.abs() > most.get(&fap).map_or(0.0, |cut| cut.asked.abs()) {
                most.insert(fap, found);
            }
            if found.beyond() > farthest.get(&fap).map_or(0.0, CutFap::beyond) {
                farthest.insert(fap, found);
            }
        }
    }
    let cut = most.into_values().filter(|cut| is_cut(cut, catalog)).collect();
    Ok((cut, farthest.into_values().filter(|changed| is_changed(changed, catalog)).collect()))
}

impl CutFap {
    /// How far the value shown lies outside the range from 0 to the requested value, FAP units.
    fn beyond(&self) -> f64 {
        let (low, high) = (self.asked.min(0.0), self.asked.max(0.0));
        (self.shown - self.shown.clamp(low, high)).abs()
    }
}

/// Units of a FAP that are visible.
fn visible(fap: u8, catalog: &FapCatalog) -> f64 {
    let is_angle = catalog.rows().iter().any(|r| r.number.get() == fap && r.motion.is_some_and(FapMotion::is_angle));
    if is_angle { CUT_ANGLE } else { CUT_UNITS }
}

/// Whether visibly less is shown than requested. A request that is too small to be seen cannot be cut, and a value that is visibly of
/// opposite sign counts as changed instead.
fn is_cut(cut: &CutFap, catalog: &FapCatalog) -> bool {
    let visible = visible(cut.fap, catalog);
    let (asked, shown) = (cut.asked.abs(), cut.shown * cut.asked.signum());
    let lacking = asked - shown;
    asked > visible && shown > -visible && lacking > CUT_SHARE * asked && lacking > visible
}

/// Whether visibly more is shown than requested, or the opposite.
fn is_changed(changed: &CutFap, catalog: &FapCatalog) -> bool {
    let visible = visible(changed.fap, catalog);
    let difference = (changed.shown - changed.asked).abs();
    changed.beyond() > BEYOND_SHARE * visible && difference > CUT_SHARE * changed.asked.abs() && difference > visible
}

/// Writes a picture as PNG with fast compression.
///
/// # Errors
/// [`io::Error`] if `writer` fails.
pub fn encode_png(picture: &RgbImage, writer: &mut dyn io::Write) -> io::Result<()> {
    PngEncoder::new_with_quality(writer, CompressionType::Fast, FilterType::Paeth)
        .write_image(picture, picture.width(), picture.height(), image::ExtendedColorType::Rgb8)
        .map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_visibly_less_is_cut() {
        let cut = |fap, asked, shown| is_cut(&CutFap { fap, frame: 1, asked, shown }, FapCatalog::mpeg4());
        assert!(cut(6, 300.0, 138.0) && cut(4, -300.0, -191.0) && cut(3, 500.0, 0.0));
        // Rounding; a small value; more than requested; opposite sign.
        assert!(
            !cut(19, 1024.0, 988.0)
                && !cut(31, 30.0, 12.0)
                && !cut(19, 0.0, -163.0)
                && !cut(42, -5.0, 9.0)
                && !cut(4, 37.0, -36.0)
                && !cut(10, 5.0, -16.0)
        );
        assert!(!cut(23, 20_000.0, 19_600.0) && cut(23, 20_000.0, 12_000.0));
    }

    #[test]
    fn visibly_more_and_the_opposite_are_changed() {
        let changed = |fap, asked, shown| is_changed(&CutFap { fap, frame: 1, asked, shown }, FapCatalog::mpeg4());
        assert!(changed(11, -13.0, -49.0) && changed(52, -13.0, 19.0) && changed(19, 0.0, -163.0) && changed(4, 300.0, 340.0));
        // Weaker; less than a tenth more; too little to be seen; next to nothing instead of something small.
        assert!(
            !changed(6, 300.0, 138.0) && !changed(4, 300.0, 325.0) && !changed(4, -122.0, -133.0) && !changed(10, 31.0, -5.0)
        );
        assert!(!changed(23, 0.0, 450.0) && changed(23, 0.0, 600.0));
    }
}
