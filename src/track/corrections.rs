//! Hand-set corrections of tracks, kept apart from computed results: `corrections/SUBJECT_SEQUENCE.csv` beside the folder `tracks`.
//!
//! One row for every node that a person placed: `frame,node,x,y`, px. A correction counts as saved once the file is on the disk. The
//! program never removes the file; whenever a track is computed again, it uses the corrections.

use std::{
    collections::BTreeMap,
    io,
    path::{Path, PathBuf},
};

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::{Corrections, TrackFileError, TrackInfo, TrackedFrame, corrections_of, eye_distance_px, read_track};
use crate::{
    geometry::Similarity,
    input::CsvFile,
    output::{OutputError, nine_digits, write_durable},
    positions::{PositionRow, PositionTable},
    sequence::ImageSize,
    wireframe::{Tables, Wireframe},
};

/// What a track records about its corrections.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackCorrections {
    /// BLAKE3 of the corrections file that the track was made with.
    pub blake3: String,
    /// Size of the frames on which the corrections were set.
    pub image_size: ImageSize,
    /// Messages about corrections that do not fit the present frames.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_applied: Vec<String>,
    /// Messages about corrections that were applied although they lie far from the expected face ([`far_corrections`]).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub far: Vec<String>,
}

/// Corrections as read from their file.
#[derive(Clone, Debug, PartialEq)]
pub struct SavedCorrections {
    /// Hard (hand-set) positions.
    pub corrections: Corrections,
    /// BLAKE3 of the file.
    pub blake3: String,
}

/// The folder of the corrections, beside `tracks`.
pub(crate) const CORRECTIONS_FOLDER: &str = "corrections";

/// Returns the path of a track's corrections: `OUT/corrections/ID.csv` for `OUT/tracks/ID.csv`, else `corrections/ID.csv` beside it.
#[must_use]
pub fn corrections_path(track: &Path) -> PathBuf {
    let folder = track.parent().unwrap_or(Path::new(""));
    let above = folder.file_name().filter(|name| *name == "tracks").and_then(|_| folder.parent());
    above.unwrap_or(folder).join(CORRECTIONS_FOLDER).join(track.file_name().unwrap_or_default())
}

/// Reads the corrections of a track; returns `None` if there is no corrections file.
///
/// # Errors
/// [`TrackFileError`] with the line.
pub fn read_corrections(track: &Path) -> Result<Option<SavedCorrections>, TrackFileError> {
    let path = corrections_path(track);
    let bytes = match crate::input::read(&path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(TrackFileError::Io { path, source }),
    };
    let blake3 = blake3::hash(&bytes).to_hex().to_string();
    let mut corrections = Corrections::new();
    let csv = CsvFile::from_bytes(&path, bytes)?.or_semicolons(&["frame", "node", "x", "y"])?;
    for row in PositionTable::new(csv)?.rows() {
        let PositionRow { frame, node, position, .. } = row?;
        corrections.entry(frame).or_default().insert(node, position);
    }
    Ok(Some(SavedCorrections { corrections, blake3 }))
}

/// Saves all corrections of a track, replacing the file; they are on the disk when it returns. Without corrections the file keeps its
/// header: removing all corrections is hand work too.
///
/// # Errors
/// [`OutputError`].
pub fn write_corrections(track: &Path, corrections: &Corrections) -> Result<SavedCorrections, OutputError> {
    let hash = write_durable(&corrections_path(track), |out| {
        writeln!(out, "frame,node,x,y")?;
        for (frame, nodes) in corrections {
            for (node, place) in nodes {
                writeln!(out, "{frame},{node},{},{}", nine_digits(place.x), nine_digits(place.y))?;
            }
        }
        Ok(())
    })?;
    Ok(SavedCorrections { corrections: corrections.clone(), blake3: hash.to_hex().to_string() })
}

/// Returns corrections that an older version stored in the track only. `None` if there are none, or if the track refers to a corrections
/// file (which somebody has then removed).
#[must_use]
pub fn corrections_in_track(track: &Path, info: Option<&TrackInfo>) -> Option<Corrections> {
    if info.is_some_and(|info| info.corrections.is_some()) {
        return None;
    }
    read_track(track).ok().map(|frames| corrections_of(&frames)).filter(|corrections| !corrections.is_empty())
}

/// Splits corrections into those that fit frames of a given size (0x0 if unknown) and messages about the others.
#[must_use]
pub fn fitting_corrections(
    corrections: &Corrections,
    set_on: ImageSize,
    size: ImageSize,
    frames: &[TrackedFrame],
    wireframe: &Wireframe,
) -> (Corrections, Vec<String>) {
    let is_known = |size: ImageSize| size.width > 0 && size.height > 0;
    if is_known(set_on) && is_known(size) && set_on != size {
        let count = corrections.values().map(std::collections::BTreeMap::len).sum::<usize>();
        let all = format!("all {count} corrections: they were set on frames of {set_on}, but the frames are {size} now");
        return (Corrections::new(), if count == 0 { Vec::new() } else { vec![all] });
    }
    let (mut fit, mut misfits) = (Corrections::new(), Vec::new());
    for (&frame, nodes) in corrections {
        let reason = match frames.iter().position(|f| f.number == frame) {
            None => Some("the sequence has no such frame"),
            Some(0) => Some("it is the neutral frame, which is fitted to marks; correct the marks instead"),
            Some(_) => None,
        };
        for (&node, place) in nodes {
            let reason = reason
                .or_else(|| {
                    (!wireframe.live_nodes().contains(&node))
                        .then_some("the wireframe has no such node, or it cannot be corrected")
                })
                .or_else(|| (is_known(size) && !size.contains(place)).then_some("it lies outside the image"));
            match reason {
                Some(reason) => misfits.push(format!("frame {frame}, node {node}: {reason}")),
                None => {
                    fit.entry(frame).or_default().insert(node, *place);
                }
            }
        }
    }
    (fit, misfits)
}

/// Distance, over the eye distance, beyond which a correction is probably a slip.
const FAR: f64 = 0.5;

/// More corrections of a frame than this are needed to derive the position of the face from the others.
const FEWEST_TOGETHER: usize = 3;
/// Share of lost nodes from which the tracker counts as having lost the face.
const LOST: f64 = 0.5;

/// Returns messages about corrections that lie further than half an eye distance from every expected position of their node.
///
/// Expected positions are: the tracked position without corrections; the neutral position moved with the head of the tracked frame; the
/// position of the node's last plausible correction; and, where the tracker lost half of its nodes, the neutral position moved with the
/// other corrections of that frame (elsewhere, wrong corrections would confirm each other). `frames` are the track without corrections, the
/// neutral frame first, px.
/// other. `frames` are the track without corrections, the neutral frame first, px.
#[must_use]
pub fn far_corrections(
    corrections: &Corrections,
    frames: &[TrackedFrame],
    wireframe: &Wireframe,
    tables: &Tables,
) -> Vec<String> {
    let places = |frame: &TrackedFrame| frame.nodes.iter().map(|n| n.position).collect::<Vec<_>>();
    let Some(neutral) = frames.first().map(places) else { return Vec::new() };
    let Some(eye_distance) = eye_distance_px(tables, &neutral) else { return Vec::new() };
    let live: Vec<usize> = wireframe.live_nodes().iter().map(|node| node.index()).collect();
    let (mut good, mut far) = (BTreeMap::new(), Vec::new());
    for frame in frames.iter().skip(1) {
        let Some(set) = corrections.get(&frame.number) else { continue };
        let tracked = places(frame);
        let is_lost = |&&k: &&usize| frame.nodes.get(k).is_some_and(|n| n.state.loss().is_some());
        let is_lost = live.iter().filter(is_lost).count() as f64 >= LOST * live.len() as f64;
        let head = carried(&neutral, live.iter().filter_map(|&k| Some((k, *tracked.get(k)?))));
        for (node, place) in set {
            let others = set.iter().filter(|(other, _)| *other != node).map(|(other, place)| (other.index(), *place));
            let together = if is_lost && set.len() > FEWEST_TOGETHER { carried(&neutral, others) } else { None };
            let from_neutral = [head, together].into_iter().flatten().filter_map(|s| Some(s.apply(neutral.get(node.index())?)));
            let expected = tracked.get(node.index()).copied().into_iter().chain(from_neutral).chain(good.get(node).copied());
            let distance = expected.map(|p| (p - place).norm() / eye_distance).min_by(f64::total_cmp).unwrap_or(0.0);
            if distance > FAR {
                let at = format!("({:.0}, {:.0})", place.x, place.y);
                far.push(format!("frame {}, node {node} at {at}: {distance:.1} eye distances", frame.number));
            } else {
                good.insert(*node, *place);
            }
        }
    }
    far
}

/// Fits the similarity that carries nodes of the neutral frame, by index, to other positions. `None` if there is no fit, or if it halves or
/// doubles the size of the face.
fn carried(neutral: &[Point2<f64>], places: impl Iterator<Item = (usize, Point2<f64>)>) -> Option<Similarity> {
    let (from, to): (Vec<_>, Vec<_>) = places.filter_map(|(k, place)| Some((*neutral.get(k)?, place))).unzip();
    Similarity::fit(&from, &to, None).ok().filter(|s| (0.5..=2.0).contains(&s.scale))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use nalgebra::Vector2;

    use super::*;
    use crate::{
        track::{LossReason, NodeState, TrackedNode},
        units::NodeId,
    };

    fn corrections() -> Corrections {
        let nodes = |list: &[(u16, f64)]| list.iter().map(|&(n, x)| (NodeId(n), Point2::new(x, 2.5))).collect::<BTreeMap<_, _>>();
        Corrections::from([(3, nodes(&[(31, 90.5), (64, 1.0 / 3.0)])), (9, nodes(&[(31, 7.0)]))])
    }

    #[test]
    fn corrections_are_kept_beside_the_folder_of_tracks() {
        assert_eq!(corrections_path(Path::new("out/tracks/S_1.csv")), Path::new("out/corrections/S_1.csv"));
        assert_eq!(corrections_path(Path::new("tracks/S_1.csv")), Path::new("corrections/S_1.csv"));
        assert_eq!(corrections_path(Path::new("S_1.csv")), Path::new("corrections/S_1.csv"));
    }

    #[test]
    fn they_are_written_and_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let track = folder.path().join("tracks/S_1.csv");
        assert_eq!(read_corrections(&track).unwrap(), None);
        let written = write_corrections(&track, &corrections()).unwrap();
        let text = fs::read_to_string(folder.path().join("corrections/S_1.csv")).unwrap();
        assert_eq!(text, "frame,node,x,y\n3,31,90.5,2.5\n3,64,0.333333333,2.5\n9,31,7,2.5\n");
        let read = read_corrections(&track).unwrap().unwrap();
        assert_eq!((read.corrections[&3].len(), &read.blake3), (2, &written.blake3));
        write_corrections(&track, &Corrections::new()).unwrap();
        assert!(read_corrections(&track).unwrap().unwrap().corrections.is_empty());
        fs::write(corrections_path(&track), "frame,node,x,y\n3,31,left,2\n").unwrap();
        let error = read_corrections(&track).unwrap_err().to_string();
        assert!(error.contains("S_1.csv, line 2: x is `left`"), "{error}");
    }

    #[test]
    fn invalid_corrections_are_reported_and_the_rest_is_applied() {
        let wireframe = Wireframe::candide3();
        let node = TrackedNode::new(Point2::new(1.0, 1.0), NodeState::Tracked, None);
        let frames: Vec<_> = [1, 3].map(|number| TrackedFrame { number, nodes: vec![node; 113] }).to_vec();
        let size = |width| ImageSize { width, height: 60 };
        let mut wanted = corrections();
        wanted.entry(1).or_default().insert(NodeId(31), Point2::new(5.0, 5.0));
        wanted.entry(3).or_default().insert(NodeId(500), Point2::new(5.0, 5.0));
        let (fit, misfits) = fitting_corrections(&wanted, size(80), size(80), &frames, &wireframe);
        assert_eq!(fit.keys().copied().collect::<Vec<_>>(), [3]);
        assert_eq!(fit[&3].keys().copied().collect::<Vec<_>>(), [NodeId(64)]);
        assert_eq!(
            misfits,
            [
                "frame 1, node 31: it is the neutral frame, which is fitted to marks; correct the marks instead",
                "frame 3, node 31: it lies outside the image",
                "frame 3, node 500: the wireframe has no such node, or it cannot be corrected",
                "frame 9, node 31: the sequence has no such frame",
            ]
        );
        let (none, all) = fitting_corrections(&corrections(), size(80), size(160), &frames, &wireframe);
        assert!(
            none.is_empty() && all == ["all 3 corrections: they were set on frames of 80x60, but the frames are 160x60 now"],
            "{all:?}"
        );
    }

    /// Two frames after a neutral one of 100 px per unit, 61 px between the eyes; in the third the tracker lost all nodes, and the face by
    /// 300 px.
    fn lost_track(wireframe: &Wireframe) -> Vec<TrackedFrame> {
        let at = |dx: f64, state: NodeState| {
            let place = |p: Point2<f64>| Point2::new(400.0 + dx + 100.0 * p.x, 300.0 - 100.0 * p.y);
            wireframe.frontal().into_iter().map(|p| TrackedNode::new(place(p), state, None)).collect::<Vec<_>>()
        };
        let lost = NodeState::Recovered(LossReason::ForwardBackward);
        let frames = [(1, 0.0, NodeState::Fitted), (2, 5.0, NodeState::Tracked), (3, 305.0, lost)];
        frames.map(|(number, dx, state)| TrackedFrame { number, nodes: at(dx, state) }).to_vec()
    }

    #[test]
    fn corrections_far_from_the_face_are_reported_and_large_ones_are_not() {
        type Set = Vec<(NodeId, Point2<f64>)>;
        let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
        let frames = lost_track(&wireframe);
        let at = |node: u16, dx: f64, dy: f64| (NodeId(node), frames[1].nodes[usize::from(node)].position + Vector2::new(dx, dy));
        let said = |list: Vec<(u32, Set)>| {
            let corrections = list.into_iter().map(|(frame, nodes)| (frame, nodes.into_iter().collect())).collect();
            far_corrections(&corrections, &frames, &wireframe, &tables)
        };
        // Half an eye distance is 31 px: the tracker may have missed a jaw that drops by 28 px.
        assert!(said(vec![(2, vec![at(10, 0.0, 28.0)])]).is_empty());
        let place = at(31, 0.0, 240.0).1;
        let text = format!("frame 2, node 31 at ({:.0}, {:.0}): 3.9 eye distances", place.x, place.y);
        assert_eq!(said(vec![(2, vec![at(10, 0.0, 5.0), at(31, 0.0, 240.0)])]), [text]);
        // Corrections of a lost face agree with each other; one that does not is reported.
        let whole = [10, 20, 31, 53, 64].map(|node| at(node, 3.0, 4.0)).to_vec();
        assert!(said(vec![(3, whole.clone())]).is_empty());
        assert_eq!(said(vec![(3, whole[..2].to_vec())]).len(), 2);
        assert!(said(vec![(2, whole[..2].to_vec()), (3, whole[..2].to_vec())]).is_empty(), "at its earlier position");
        // In a face that was not lost all five are reported, even if they agree.
        let beside = [10, 20, 31, 53, 64].map(|node| at(node, 3.0, 240.0)).to_vec();
        assert_eq!(said(vec![(2, beside)]).len(), 5);
        assert!(said(vec![(1, whole.clone()), (9, whole)]).is_empty(), "these are not applied");
    }
}
