//! Reads the table of a track.

use std::path::Path;

use serde::Deserialize;

use super::{
    super::{
        NodeState, TrackedFrame, TrackedNode,
        in_picture::{NotInPicture, check_in_picture, check_near_face},
    },
    TrackFileError,
    info::{is_representative, times_said},
};
use crate::{
    input::CsvFile,
    positions::{PositionRow, PositionTable},
};

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
    check_in_picture(&neutral).map_err(|found| match found {
        NotInPicture::YUpwards => TrackFileError::YUpwards { path: path.to_owned() },
        NotInPicture::Mirrored => TrackFileError::Mirrored { path: path.to_owned() },
    })?;
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
