//! The `.json` beside a track: its sources and options.

use std::{collections::BTreeMap, path::Path};

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::{
    super::{
        TrackCorrections, TrackOptions, TrackSummary, TrackedFrame,
        clock::{Counted, by_number},
    },
    TrackFileError,
};
use crate::{
    dataset::has_picture_name,
    fit::FitOptions,
    input::{RecordError, read_record},
    output::count,
    sequence::{Clock, ImageSize},
    units::{NodeId, SequenceId},
};

/// Version of the track's JSON schema.
pub const TRACK_SCHEMA: u32 = 2;

/// Highest frame rate that a track may have, the tick rate of video clocks. The lowest is any rate above 0: slow films have one frame in
/// hours.
const HIGHEST_RATE: f64 = 100_000.0;

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
    #[doc(hidden)]
    pub corrections: Option<TrackCorrections>,
}

impl TrackInfo {
    /// Returns the times at which the frames are shown.
    pub(crate) fn clock(&self) -> Clock {
        Clock { fps: self.fps, times: self.times.clone() }
    }

    /// Returns the clock that maps frame numbers to seconds. Pictures may be numbered in steps, and their rate counts pictures; the numbers
    /// of videos and landmarks count frames, except where landmark numbers are milliseconds.
    pub(crate) fn clock_of_numbers(&self, numbers: impl IntoIterator<Item = u32>) -> Clock {
        let counted = match (self.has_pictures(), self.is_of_video()) {
            (false, _) => Counted::Landmarks,
            (true, false) => Counted::Pictures,
            (true, true) => Counted::Frames,
        };
        by_number(self.clock(), counted, numbers)
    }

    /// Returns the seconds of the frames of this track from the one with the lowest number, in the order of the track; empty if the frame
    /// rate is not known.
    ///
    /// ```
    /// use grimace::track::{read_track, read_track_info};
    ///
    /// let path = std::path::Path::new("fixtures/simulated/truth/S001_005.csv");
    /// let track = read_track(path)?;
    /// // Nothing beside the track says how fast its frames follow each other.
    /// let seconds = read_track_info(path)?.map(|info| info.seconds(&track)).unwrap_or_default();
    /// assert!(seconds.is_empty());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn seconds(&self, track: &[TrackedFrame]) -> Vec<f64> {
        seconds_of(track, &self.clock_of_numbers(track.iter().map(|frame| frame.number)))
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

/// Message about a wrong number of times.
pub(super) fn times_said(found: usize, frames: usize) -> String {
    format!("`times` has {}, but the track has {frames} frames; one time per frame was expected", count(found, "time", "times"))
}

/// Whether the `.json` beside a table is that of a representative: it lists the sequences that it was made from.
pub(super) fn is_representative(bytes: &[u8]) -> bool {
    let read = serde_json::from_slice::<serde_json::Value>(bytes).unwrap_or_default();
    read.get("sequences").is_some_and(serde_json::Value::is_array) && read.get("image_size").is_none()
}
/// Returns the seconds of a track's frames from the one with the lowest number, in the order of the track; empty if the clock does not know
/// them. `clock` is by number.
pub fn seconds_of(track: &[TrackedFrame], clock: &Clock) -> Vec<f64> {
    let first = track.iter().map(|frame| frame.number).min().unwrap_or_default();
    let seconds: Option<Vec<f64>> = track.iter().map(|frame| clock.seconds(frame.number - first)).collect();
    seconds.unwrap_or_default()
}
