//! Track files: `SUBJECT_SEQUENCE.csv` with every node of every frame, and a `.json` beside it with its sources and options.

use std::{
    collections::BTreeMap,
    io::Write,
    path::{Path, PathBuf},
};

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::{
    NodeState, TrackCorrections, TrackOptions, TrackSummary, TrackedFrame, TrackedNode,
    clock::{Counted, by_number},
    in_picture::{NotInPicture, check_in_picture, check_near_face},
};
use crate::{
    dataset::has_picture_name,
    fit::FitOptions,
    input::{CsvFile, InputError, RecordError, read_record},
    output::{self, OutputError, count, nine_digits},
    plausible::Implausible,
    positions::{PositionRow, PositionTable, PositionsError},
    sequence::{Clock, ImageSize},
    units::{NodeId, SequenceId},
};

/// Version of the track's JSON schema.
pub const TRACK_SCHEMA: u32 = 2;

/// Highest frame rate that a track may have, the tick rate of video clocks. The lowest is any rate above 0: slow films have one frame in
/// hours.
const HIGHEST_RATE: f64 = 100_000.0;

/// Steps per px to which expected errors are rounded in files.
const EXPECTED_STEPS: f64 = 1000.0;

/// Sources and options of a track: the content of the `.json` beside the `.csv`.
///
/// ```
/// # use grimace::{sequence::ImageSize, units::SequenceId};
/// # let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let track = grimace::track::read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("track.csv");
/// # let mut info = grimace::track::TrackInfo {
/// #     schema_version: 2,
/// #     made_by: "an example".to_owned(),
/// #     units: Default::default(),
/// #     id: SequenceId { subject: "S001".to_owned(), sequence: "005".to_owned() },
/// #     emotion: "happiness".to_owned(),
/// #     metadata: Default::default(),
/// #     source: vec![],
/// #     image_size: ImageSize { width: 320, height: 320 },
/// #     fps: Some(25.0),
/// #     times: None,
/// #     notes: vec![],
/// #     marks_from: "file".to_owned(),
/// #     marks: vec![],
/// #     read: vec![],
/// #     fit: Default::default(),
/// #     track: Default::default(),
/// #     summary: grimace::track::summarize(&track, &wireframe, &tables),
/// #     inputs_blake3: String::new(),
/// #     frames_blake3: None,
/// #     csv_blake3: String::new(),
/// #     neutral_frame: None,
/// #     apex_frame: None,
/// #     corrections: None,
/// # };
/// use grimace::track::{read_track_info, write_track};
///
/// // `track` holds the ten frames of a smile, `info` what it was made from.
/// write_track(&path, &track, &mut info)?;
/// let read = read_track_info(&path)?.expect("track.json");
/// assert_eq!((read.id.to_string().as_str(), read.emotion.as_str()), ("S001_005", "happiness"));
/// assert_eq!(read.summary.frames, 10);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackInfo {
    /// Always 2.
    pub schema_version: u32,
    /// Program and version that made it.
    pub made_by: String,
    /// Units of the columns, as text.
    pub units: BTreeMap<String, String>,
    /// Subject and sequence.
    #[serde(flatten)]
    pub id: SequenceId,
    /// Emotion label.
    pub emotion: String,
    /// Further columns of the manifest.
    pub metadata: BTreeMap<String, String>,
    /// Names of the frame files in order, or of the video.
    pub source: Vec<String>,
    /// Size of the frames; 0x0 for a track from landmarks, which has no images.
    pub image_size: ImageSize,
    /// Frames per second, if known; the mean rate when `times` is set.
    pub fps: Option<f64>,
    /// Seconds from the first frame to every frame, by ascending number, for videos with uneven frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub times: Option<Vec<f64>>,
    /// Notes on the video, or on landmarks that end before the images do.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Where the marks came from: `file`, `landmarks` or `command line`.
    pub marks_from: String,
    /// Marks on the neutral frame: node, x, y in px, and whether set by hand (hard).
    pub marks: Vec<(u16, f64, f64, bool)>,
    /// Nodes without a mark whose positions were read in the neutral frame.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub read: Vec<NodeId>,
    /// Options of the fit.
    pub fit: FitOptions,
    /// Options of the tracker.
    pub track: TrackOptions,
    /// Quality summary.
    pub summary: TrackSummary,
    /// BLAKE3 of everything the track depends on: program version, options, marks, a given frame rate, and the content of every frame.
    pub inputs_blake3: String,
    /// BLAKE3 of the names and bytes of the files of `source`, if they are images or a video.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frames_blake3: Option<String>,
    /// BLAKE3 of the `.csv` file.
    pub csv_blake3: String,
    /// Number of the neutral frame; absent in tracks of older versions, whose first frame is neutral.
    #[serde(default)]
    pub neutral_frame: Option<u32>,
    /// Number of the apex frame; absent in tracks of older versions, whose last frame is the apex.
    #[serde(default)]
    pub apex_frame: Option<u32>,
    /// Hand-set corrections in the track.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corrections: Option<TrackCorrections>,
}

impl TrackInfo {
    /// Returns the times at which the frames are shown.
    pub(crate) fn clock(&self) -> Clock {
        Clock { fps: self.fps, times: self.times.clone() }
    }

    /// Returns the clock that maps frame numbers to seconds. Pictures may be numbered in steps, and their rate counts pictures; the numbers
    /// of videos and landmarks count frames, except where landmark numbers are milliseconds.
    pub fn clock_of_numbers(&self, numbers: impl IntoIterator<Item = u32>) -> Clock {
        let counted = match (self.has_pictures(), self.is_of_video()) {
            (false, _) => Counted::Landmarks,
            (true, false) => Counted::Pictures,
            (true, true) => Counted::Frames,
        };
        by_number(self.clock(), counted, numbers)
    }

    /// Whether the track was made from pictures or a video, not from landmarks.
    pub(crate) fn has_pictures(&self) -> bool {
        self.image_size.width > 0
    }

    /// Whether the track was made from a video: the source is one file that is not a picture.
    pub(crate) fn is_of_video(&self) -> bool {
        self.has_pictures() && matches!(&self.source[..], [only] if !has_picture_name(Path::new(only)))
    }

    /// Returns the marked nodes with the positions of their marks, px.
    pub fn mark_places(&self) -> Vec<(NodeId, Point2<f64>)> {
        self.marks.iter().map(|&(node, x, y, _)| (NodeId(node), Point2::new(x, y))).collect()
    }
}

/// Returns the units of a track file's columns.
pub fn track_units() -> BTreeMap<String, String> {
    [
        ("x", "px, right, centre of the top-left pixel is 0"),
        ("y", "px, down, centre of the top-left pixel is 0"),
        ("residual", "px; neutral frame: node to mark; later frames: forward-backward distance"),
        (
            "expected_error",
            "px; half of such nodes are further off, half less: in the neutral frame from their place on the face, in later frames from where \
             their point of the neutral frame went",
        ),
        ("marks", "node, x px, y px, whether the node is held there exactly (kind hard)"),
    ]
    .into_iter()
    .map(|(k, v)| (k.to_owned(), v.to_owned()))
    .collect()
}

/// A track file that does not read.
///
/// ```
/// use grimace::track::{TrackFileError, read_track};
///
/// let error = read_track("no-such-track.csv".as_ref()).unwrap_err();
/// assert!(matches!(error, TrackFileError::Io { .. }) && error.to_string().starts_with("cannot read no-such-track.csv"));
/// ```
#[derive(Debug, thiserror::Error)]
pub enum TrackFileError {
    /// The file cannot be opened.
    #[error("cannot read {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A table cannot be read.
    #[error(transparent)]
    Table(#[from] InputError),
    /// The positions do not form a track.
    #[error(transparent)]
    Positions(#[from] PositionsError),
    /// An invalid state of a node.
    #[error("{}, line {line}: {reason}", path.display())]
    State {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What stands there, and what states there are.
        reason: String,
    },
    /// The file is a representative, not a track.
    #[error("{}: this is a representative, not a track; tracks are in the folder tracks of a run", path.display())]
    Representative {
        /// The table.
        path: PathBuf,
    },
    /// The file is a normalized model, not a track.
    #[error(
        "{}: this is a normalized model in face units, not a track; tracks are in the folder tracks of a run",
        path.display()
    )]
    Normalized {
        /// The table.
        path: PathBuf,
    },
    /// A `.csv` that is incomplete according to the `.json` beside it.
    #[error("{}: {reason}: the file is truncated or was changed; track the sequence again", path.display())]
    Cut {
        /// The file.
        path: PathBuf,
        /// What is missing.
        reason: String,
    },
    /// The nodes form a mirrored face.
    #[error("{}: {source}", path.display())]
    NotInPicture {
        /// The file.
        path: PathBuf,
        /// How.
        source: NotInPicture,
    },
    /// A node lies nowhere near its face.
    #[error("{}: {source}", path.display())]
    Implausible {
        /// The file.
        path: PathBuf,
        /// Which, and where.
        source: Implausible,
    },
    /// The `.json` has a newer layout.
    #[error("{}: schema version {found}; this program reads {TRACK_SCHEMA}; it comes from a newer version of grimace; use that version", path.display())]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: u64,
    },
    /// The times in the `.json` do not match the track.
    #[error("{}: {reason}; correct the file, or track the sequence again", path.display())]
    Times {
        /// The file.
        path: PathBuf,
        /// What is wrong, with the value.
        reason: String,
    },
    /// The `.json` cannot be read.
    #[error("{}: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Why, with the line.
        source: serde_json::Error,
    },
}

/// Returns the bytes of a track's `.csv`: its frames by ascending number.
pub fn track_csv(frames: &[TrackedFrame]) -> Vec<u8> {
    let mut ascending: Vec<&TrackedFrame> = frames.iter().collect();
    ascending.sort_by_key(|frame| frame.number);
    let mut out = Vec::with_capacity(frames.len() * 113 * 48);
    out.extend_from_slice(b"frame,node,x,y,state,residual,expected_error\n");
    for frame in ascending {
        for (k, node) in frame.nodes.iter().enumerate() {
            let (x, y) = (nine_digits(node.position.x), nine_digits(node.position.y));
            let residual = node.residual.map(nine_digits).unwrap_or_default();
            let expected =
                node.expected_error.map(|e| nine_digits((e * EXPECTED_STEPS).round() / EXPECTED_STEPS)).unwrap_or_default();
            // Writing to a vector cannot fail.
            let _ = writeln!(out, "{},{k},{x},{y},{},{residual},{expected}", frame.number, node.state);
        }
    }
    out
}

/// BLAKE3 hashes of the two files of a track, in hexadecimal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrackHashes {
    /// Hash of the `.csv`.
    pub csv: String,
    /// Hash of the `.json`.
    pub json: String,
}

/// Writes `STEM.csv` and `STEM.json` into a folder. The JSON is written last, so that its presence means a complete track. The first of
/// `frames` is the neutral frame and the last the apex, unless `info` names others.
///
/// ```
/// # use grimace::{sequence::ImageSize, units::SequenceId};
/// # let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let track = grimace::track::read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("track.csv");
/// # let mut info = grimace::track::TrackInfo {
/// #     schema_version: 2,
/// #     made_by: "an example".to_owned(),
/// #     units: Default::default(),
/// #     id: SequenceId { subject: "S001".to_owned(), sequence: "005".to_owned() },
/// #     emotion: "happiness".to_owned(),
/// #     metadata: Default::default(),
/// #     source: vec![],
/// #     image_size: ImageSize { width: 320, height: 320 },
/// #     fps: Some(25.0),
/// #     times: None,
/// #     notes: vec![],
/// #     marks_from: "file".to_owned(),
/// #     marks: vec![],
/// #     read: vec![],
/// #     fit: Default::default(),
/// #     track: Default::default(),
/// #     summary: grimace::track::summarize(&track, &wireframe, &tables),
/// #     inputs_blake3: String::new(),
/// #     frames_blake3: None,
/// #     csv_blake3: String::new(),
/// #     neutral_frame: None,
/// #     apex_frame: None,
/// #     corrections: None,
/// # };
/// use grimace::track::{read_track, write_track};
///
/// // `track` holds the ten frames of a smile, `info` what it was made from.
/// write_track(&path, &track, &mut info)?;
/// assert!(path.with_extension("json").exists());
/// assert_eq!(read_track(&path)?.len(), track.len());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`OutputError`].
pub fn write_track(csv_path: &Path, frames: &[TrackedFrame], info: &mut TrackInfo) -> Result<TrackHashes, OutputError> {
    let csv = output::write_hashed(csv_path, |out| out.write_all(&track_csv(frames)))?.to_hex().to_string();
    info.csv_blake3.clone_from(&csv);
    info.neutral_frame = info.neutral_frame.or(frames.first().map(|f| f.number));
    info.apex_frame = info.apex_frame.or(frames.last().map(|f| f.number));
    let json = output::write_hashed(&csv_path.with_extension("json"), |out| output::json_into(out, info))?;
    Ok(TrackHashes { csv, json: json.to_hex().to_string() })
}

/// Reads the `.json` beside a track; returns `None` if there is none.
///
/// ```
/// use grimace::track::read_track_info;
///
/// // The true positions of a simulated face were not tracked, and no JSON stands beside them.
/// assert!(read_track_info("fixtures/simulated/truth/S001_005.csv".as_ref())?.is_none());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`TrackFileError`].
pub fn read_track_info(csv_path: &Path) -> Result<Option<TrackInfo>, TrackFileError> {
    let path = csv_path.with_extension("json");
    let bytes = match crate::input::read(&path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(TrackFileError::Io { path, source }),
    };
    parse_track_info(csv_path, &bytes).map(Some)
}

/// Same as [`read_track_info`], from the bytes of the `.json`.
///
/// # Errors
/// As [`read_track_info`].
pub fn parse_track_info(csv_path: &Path, bytes: &[u8]) -> Result<TrackInfo, TrackFileError> {
    let path = || csv_path.with_extension("json");
    let info: TrackInfo = read_record(bytes, TRACK_SCHEMA).map_err(|error| match error {
        // The schema of a representative has its own version numbers.
        _ if is_representative(bytes) => TrackFileError::Representative { path: csv_path.to_owned() },
        RecordError::Newer { found, .. } => TrackFileError::Newer { path: path(), found },
        RecordError::Json(source) => TrackFileError::Json { path: path(), source },
    })?;
    let refused = |reason: String| Err(TrackFileError::Times { path: path(), reason });
    if let Some(fps) = info.fps.filter(|fps| !(*fps > 0.0 && *fps <= HIGHEST_RATE)) {
        return refused(format!("`fps` is {fps}; frames per second above 0 and up to {HIGHEST_RATE} were expected"));
    }
    let times = info.times.as_deref().unwrap_or_default();
    if let Some([before, after, ..]) = times.windows(2).find(|pair| pair[0] >= pair[1]) {
        return refused(format!("`times` has {after} after {before}; ascending seconds were expected"));
    }
    if info.times.is_some() && times.len() < info.summary.frames {
        return refused(times_said(times.len(), info.summary.frames));
    }
    Ok(info)
}

fn times_said(found: usize, frames: usize) -> String {
    format!("`times` has {}, but the track has {frames} frames; one time per frame was expected", count(found, "time", "times"))
}

/// Whether the `.json` beside a table is that of a representative: it lists the sequences that it was made from.
fn is_representative(bytes: &[u8]) -> bool {
    let read = serde_json::from_slice::<serde_json::Value>(bytes).unwrap_or_default();
    read.get("sequences").is_some_and(serde_json::Value::is_array) && read.get("image_size").is_none()
}

/// The fields of the `.json` beside a track that describe the frames of its `.csv`; other fields are ignored.
#[derive(Default, Deserialize)]
struct Beside {
    neutral_frame: Option<u32>,
    apex_frame: Option<u32>,
    csv_blake3: Option<String>,
    times: Option<Vec<f64>>,
}

impl Beside {
    fn read(csv_path: &Path) -> Self {
        let bytes = crate::input::read(&csv_path.with_extension("json")).ok();
        bytes.and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default()
    }

    /// Rejects a truncated file.
    fn check(&self, path: &Path, frames: &[TrackedFrame], bytes: &[u8]) -> Result<(), TrackFileError> {
        let cut = |reason: String| Err(TrackFileError::Cut { path: path.to_owned(), reason });
        for (what, number) in [("neutral", self.neutral_frame), ("apex", self.apex_frame)] {
            if let Some(number) = number.filter(|number| frames.iter().all(|frame| frame.number != *number)) {
                return cut(format!("it has no frame {number}, which the .json beside it names as the {what} frame"));
            }
        }
        // Times cover all numbers from the first to the last, including missing frames.
        let numbers = || frames.iter().map(|frame| frame.number);
        let all = numbers().min().zip(numbers().max()).map_or(0, |(first, last)| (last - first) as usize + 1);
        if let Some(found) = self.times.as_ref().map(Vec::len).filter(|&found| found != all) {
            return Err(TrackFileError::Times { path: path.with_extension("json"), reason: times_said(found, all) });
        }
        let is_changed = || self.csv_blake3.as_ref().is_some_and(|hash| blake3::hash(bytes).to_hex().as_str() != hash);
        if !bytes.ends_with(b"\n") && is_changed() {
            return cut(
                "its last line has no line end, so the last value may be incomplete, and the file was changed after it was written".to_owned()
            );
        }
        Ok(())
    }
}

/// Sorts ascending frames into tracking order: the neutral frame, the later frames, then the earlier frames backward in time. Without such
/// a frame the order stays unchanged.
pub fn neutral_first(mut frames: Vec<TrackedFrame>, neutral: Option<u32>) -> Vec<TrackedFrame> {
    let place = neutral.and_then(|number| frames.iter().position(|f| f.number == number));
    if let Some(place) = place {
        frames[..place].reverse();
        frames.rotate_left(place);
    }
    frames
}

/// Reads a track's `.csv`, the neutral frame first. The `.json` beside it names the neutral frame; otherwise it is the first frame.
///
/// Columns `frame,node,x,y` are required. Without `state` and `residual` nodes count as tracked; `expected_error` is optional.
/// ```
/// use grimace::track::{NodeState, read_track};
///
/// let track = read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// assert_eq!((track.len(), track[0].nodes[0].position.x), (10, 159.130832));
/// assert_eq!(track[0].nodes[0].state, NodeState::Tracked);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`TrackFileError`] with the line.
pub fn read_track(path: &Path) -> Result<Vec<TrackedFrame>, TrackFileError> {
    let bytes = crate::input::read(path).map_err(|source| TrackFileError::Io { path: path.to_owned(), source })?;
    let frames = parse_track(path, &bytes)?;
    if is_normalized(&frames) {
        let json = crate::input::read(&path.with_extension("json")).unwrap_or_default();
        let path = path.to_owned();
        return Err(if is_representative(&json) {
            TrackFileError::Representative { path }
        } else {
            TrackFileError::Normalized { path }
        });
    }
    let beside = Beside::read(path);
    beside.check(path, &frames, &bytes)?;
    let frames = neutral_first(frames, beside.neutral_frame);
    let neutral: Vec<_> = frames.iter().take(1).flat_map(|frame| &frame.nodes).map(|node| node.position).collect();
    check_in_picture(&neutral).map_err(|source| TrackFileError::NotInPicture { path: path.to_owned(), source })?;
    check_near_face(&frames).map_err(|source| TrackFileError::Implausible { path: path.to_owned(), source })?;
    Ok(frames)
}

/// Whether positions are those of a normalized model: only positions are given, about an origin within the face, with y up (the chin below
/// the outer corners of the eyes).
fn is_normalized(frames: &[TrackedFrame]) -> bool {
    const CHIN_AND_EYES: [usize; 3] = [10, 20, 53];
    let Some(neutral) = frames.first() else { return false };
    let is_bare = |node: &TrackedNode| node.state == NodeState::Tracked && node.residual.is_none();
    let [Some(chin), Some(left), Some(right)] = CHIN_AND_EYES.map(|k| neutral.nodes.get(k).map(|n| n.position)) else {
        return false;
    };
    frames.iter().flat_map(|frame| &frame.nodes).all(is_bare) && chin.y < 0.0 && chin.y < left.y.min(right.y) && right.x < 0.0
}

/// Same as [`read_track`], from bytes, with ascending frames. `path` is only used in error messages.
///
/// # Errors
/// As [`read_track`].
pub fn parse_track(path: &Path, bytes: &[u8]) -> Result<Vec<TrackedFrame>, TrackFileError> {
    let table = PositionTable::new(CsvFile::from_bytes(path, bytes.to_vec())?)?;
    let (state, residual, expected) = (table.column("state"), table.column("residual"), table.column("expected_error"));
    let frames = table.frames(|PositionRow { position, row, .. }| {
        let state = match state.map(|at| row.get(at)) {
            None | Some("") => NodeState::Tracked,
            Some(word) => {
                let at = |reason| TrackFileError::State { path: path.to_owned(), line: row.line(), reason };
                word.parse().map_err(at)?
            }
        };
        let optional = |at: Option<usize>| at.filter(|&at| !row.get(at).is_empty()).map(|at| row.number(at)).transpose();
        Ok::<_, TrackFileError>(TrackedNode {
            expected_error: optional(expected)?,
            ..TrackedNode::new(*position, state, optional(residual)?)
        })
    })?;
    Ok(frames.into_iter().map(|(number, nodes)| TrackedFrame { number, nodes }).collect())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::track::LossReason;

    fn frames() -> Vec<TrackedFrame> {
        let node = |x: f64, state, residual| TrackedNode::new(Point2::new(x, 1.5), state, residual);
        let expecting = |node| TrackedNode { expected_error: Some(0.75), ..node };
        vec![
            TrackedFrame { number: 3, nodes: vec![node(0.1, NodeState::Marked, Some(0.25)), node(1.0, NodeState::Fitted, None)] },
            TrackedFrame {
                number: 4,
                nodes: vec![
                    expecting(node(1.0 / 3.0, NodeState::Tracked, Some(0.01))),
                    node(-2.0, NodeState::Recovered(LossReason::Klt), None),
                ],
            },
        ]
    }

    fn read(text: &str) -> Result<Vec<TrackedFrame>, TrackFileError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        fs::write(&path, text).unwrap();
        read_track(&path)
    }

    #[test]
    fn a_truncated_track_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        let mut all = frames();
        all.push(TrackedFrame { number: 5, ..all[1].clone() });
        let whole = track_csv(&all);
        let hash = blake3::hash(&whole).to_hex().to_string();
        let json = format!(r#"{{"neutral_frame": 3, "apex_frame": 5, "csv_blake3": "{hash}"}}"#);
        fs::write(path.with_extension("json"), json).unwrap();
        let said = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            read_track(&path).map(|frames| frames.len()).map_err(|error| error.to_string())
        };
        assert_eq!(said(&whole), Ok(3));
        // At the end of a frame.
        let text = String::from_utf8(whole.clone()).unwrap();
        let first = text.split_inclusive('\n').filter(|line| !line.starts_with("5,")).collect::<String>();
        assert!(
            said(first.as_bytes()).unwrap_err().contains("it has no frame 5, which the .json beside it names as the apex frame")
        );
        // Cut within its last line; a changed value is accepted, because a user may edit it.
        let within = text.replace("0.75", "0.5");
        assert_eq!(said(within.as_bytes()), Ok(3));
        assert!(said(within.trim_end().as_bytes()).unwrap_err().contains("the last value may be incomplete"));
    }

    #[test]
    fn a_track_is_written_with_nine_digits_and_read_back() {
        let text = String::from_utf8(track_csv(&frames())).unwrap();
        assert_eq!(
            text,
            "frame,node,x,y,state,residual,expected_error\n3,0,0.1,1.5,marked,0.25,\n3,1,1,1.5,fitted,,\n\
             4,0,0.333333333,1.5,tracked,0.01,0.75\n4,1,-2,1.5,recovered_klt,,\n"
        );
        let back = read(&text).unwrap();
        assert_eq!(back[1].nodes[1], frames()[1].nodes[1]);
        assert!((back[1].nodes[0].position.x - 1.0 / 3.0).abs() < 1e-9);
    }

    #[test]
    fn frames_are_in_the_order_in_which_they_were_tracked() {
        let numbers = |neutral| {
            let frames = [1, 2, 5, 7].map(|number| TrackedFrame { number, nodes: Vec::new() });
            neutral_first(frames.to_vec(), neutral).iter().map(|f| f.number).collect::<Vec<_>>()
        };
        assert_eq!(numbers(None), [1, 2, 5, 7]);
        assert_eq!(numbers(Some(1)), [1, 2, 5, 7]);
        assert_eq!(numbers(Some(7)), [7, 5, 2, 1]);
        assert_eq!(numbers(Some(5)), [5, 7, 2, 1]);
        assert_eq!(numbers(Some(6)), [1, 2, 5, 7]);
        // Written frames ascend.
        let mut back = frames();
        back.reverse();
        assert_eq!(track_csv(&back), track_csv(&frames()));
    }

    #[test]
    fn a_normalized_model_is_no_track() {
        // Chin, outer corner of the left and of the right eye: with y up about the nose, and the same in a picture.
        let table = |place: fn(f64, f64) -> (f64, f64)| {
            let at = |node: usize| match node {
                10 => place(0.0, -1400.0),
                20 => place(780.0, 250.0),
                53 => place(-780.0, 250.0),
                _ => place(0.0, 0.0),
            };
            let row = |k: usize| format!("{},{},{},{}\n", k / 54, k % 54, at(k % 54).0, at(k % 54).1);
            format!("frame,node,x,y\n{}", (0..108).map(row).collect::<String>())
        };
        let error = read(&table(|x, y| (x, y))).unwrap_err().to_string();
        assert!(error.contains("t.csv: this is a normalized model in face units, not a track"), "{error}");
        assert_eq!(read(&table(|x, y| (0.1 * x + 320.0, 240.0 - 0.1 * y))).unwrap().len(), 2);
    }

    #[test]
    fn bad_rows_are_named_by_line_and_value() {
        let message = |text: &str| read(text).unwrap_err().to_string();
        assert!(message("frame,node,x\n1,0,1\n").contains("t.csv, line 1: has no column `y`"));
        assert!(message("frame,node,x,y\n1,0,1,nan\n").contains("t.csv, line 2: y is `nan`"));
        assert!(message("frame,node,x,y,state\n1,0,1,1,lost\n").contains("t.csv, line 2: `lost` is not a node state"));
        assert!(message("frame,node,x,y,expected_error\n1,0,1,1,much\n").contains("expected_error is `much`"));
        assert!(message("frame,node,x,y\n2,0,1,1\n1,0,1,1\n").contains("frames must ascend"));
        assert!(message("").contains("t.csv: is empty"));
    }
}
