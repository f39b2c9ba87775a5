//! 68-point landmarks (Multi-PIE / iBUG order): one CSV per sequence, or CK+'s text file per frame; and correspondences from them.
//!
//! Positions are taken as they are: pixels, x right, y down.

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
    str::FromStr,
};

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::frames::{last_digits, visible};
use crate::{
    fit::{Correspondence, MarkKind},
    input::{CsvFile, InputError},
    units::NodeId,
    wireframe::{LandmarkConfidence, Tables},
};

/// Points of the scheme.
pub const LANDMARK_COUNT: usize = 68;

/// Nodes fitted from landmarks by default: outer and inner eye corners (left 20, 23, right 53, 56), mouth corners (left 31,
/// right 64), chin (10).
pub const DEFAULT_LANDMARK_NODES: [NodeId; 7] =
    [NodeId(20), NodeId(23), NodeId(53), NodeId(56), NodeId(31), NodeId(64), NodeId(10)];

/// End of the names of CK+'s landmark files, before the extension.
const TEXT_FILE_SUFFIX: &str = "_landmarks";

/// Landmarks of the frames of one sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct LandmarkTrack {
    /// File or folder they were read from.
    pub path: PathBuf,
    /// Frame number to [`LANDMARK_COUNT`] positions in image pixels, in the order of the scheme.
    pub frames: BTreeMap<u32, Vec<Point2<f64>>>,
}

/// Landmarks that do not read or do not serve.
#[derive(Debug, thiserror::Error)]
pub enum LandmarksError {
    /// A CSV file that does not read, or a field that is no finite number.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A file or folder that can not be read.
    #[error("{}: cannot be read: {reason}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        reason: io::Error,
    },
    /// Another number of points than the scheme has.
    #[error("{}: {found} points, {LANDMARK_COUNT} were expected", path.display())]
    Count {
        /// The file.
        path: PathBuf,
        /// Points found: rows of a text file, or column pairs of a CSV file.
        found: usize,
    },
    /// A line of a text file that is not two finite numbers.
    #[error("{}, line {line}: found `{found}`; two finite numbers `x y` were expected", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The line, shortened.
        found: String,
    },
    /// A frame in two rows or files.
    #[error("{}: landmarks of frame {frame} are there twice", path.display())]
    DuplicateFrame {
        /// The file, or the second of two files.
        path: PathBuf,
        /// The frame number.
        frame: u32,
    },
    /// A text file without a frame number in its name.
    #[error("{}: the file name has no frame number such as in S005_001_00000001_landmarks.txt", path.display())]
    NoNumber {
        /// The file.
        path: PathBuf,
    },
    /// No frame at all.
    #[error("{}: no landmarks of any frame", path.display())]
    Empty {
        /// The file or folder.
        path: PathBuf,
    },
    /// A file named in the manifest that is not there.
    #[error("the landmark file is not there; looked for {}", paths.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(" and "))]
    NotFound {
        /// Where it was looked for.
        paths: Vec<PathBuf>,
    },
    /// A frame without landmarks.
    #[error("{}: frame {frame} has no landmarks; there are {count} frames from {first} to {last}", path.display())]
    NoSuchFrame {
        /// File or folder of the landmarks.
        path: PathBuf,
        /// The frame asked for.
        frame: u32,
        /// Frames there are.
        count: usize,
        /// Smallest frame number.
        first: u32,
        /// Largest frame number.
        last: u32,
    },
    /// A node that no landmark stands for.
    #[error("no landmark marks node {node}; nodes with one are {}", nodes.iter().map(ToString::to_string).collect::<Vec<_>>().join(" "))]
    NoLandmark {
        /// The node.
        node: NodeId,
        /// Nodes that have a landmark.
        nodes: Vec<NodeId>,
    },
}

impl LandmarkTrack {
    /// The 68 positions in a frame.
    ///
    /// # Errors
    /// [`LandmarksError::NoSuchFrame`] with the frames there are.
    pub fn frame(&self, frame: u32) -> Result<&[Point2<f64>], LandmarksError> {
        self.frames.get(&frame).map(Vec::as_slice).ok_or_else(|| {
            let number = |key: Option<&u32>| key.copied().unwrap_or_default();
            let (first, last) = (number(self.frames.keys().next()), number(self.frames.keys().next_back()));
            LandmarksError::NoSuchFrame { path: self.path.clone(), frame, count: self.frames.len(), first, last }
        })
    }
}

/// Reads the landmarks of a sequence: a CSV file `frame,x0,y0,...,x67,y67`, or a folder of text files, one per frame, with 68
/// lines `x y` and the frame number last in the name (`S005_001_00000001_landmarks.txt`).
///
/// # Errors
/// [`LandmarksError`] for files that can not be read, another number of points than 68, fields that are no finite numbers, frames
/// that are there twice, or no frame.
pub fn read_landmarks(path: &Path) -> Result<LandmarkTrack, LandmarksError> {
    let frames = if path.is_dir() { read_text_files(path)? } else { read_csv(&CsvFile::open(path)?)? };
    if frames.is_empty() {
        return Err(LandmarksError::Empty { path: path.to_owned() });
    }
    Ok(LandmarkTrack { path: path.to_owned(), frames })
}

fn read_csv(csv: &CsvFile) -> Result<BTreeMap<u32, Vec<Point2<f64>>>, LandmarksError> {
    let [frame_column] = csv.require(["frame"])?;
    let place: BTreeMap<&str, usize> = csv.header().iter().enumerate().map(|(k, name)| (name.as_str(), k)).collect();
    let pair = |k: usize| Some((*place.get(format!("x{k}").as_str())?, *place.get(format!("y{k}").as_str())?));
    let columns: Vec<(usize, usize)> = (0..csv.header().len()).map_while(pair).collect();
    if columns.len() != LANDMARK_COUNT {
        return Err(LandmarksError::Count { path: csv.path().to_owned(), found: columns.len() });
    }
    let mut frames = BTreeMap::new();
    for row in csv.rows() {
        let row = row?;
        let frame = row.whole_number(frame_column)?;
        let mut points = Vec::with_capacity(LANDMARK_COUNT);
        for &(x, y) in &columns {
            points.push(Point2::new(row.number(x)?, row.number(y)?));
        }
        if frames.insert(frame, points).is_some() {
            return Err(LandmarksError::DuplicateFrame { path: csv.path().to_owned(), frame });
        }
    }
    Ok(frames)
}

/// Files `*_landmarks.txt` of a folder, or all `*.txt` where no name ends so.
fn read_text_files(folder: &Path) -> Result<BTreeMap<u32, Vec<Point2<f64>>>, LandmarksError> {
    let entries = visible(folder).map_err(|reason| LandmarksError::Io { path: folder.to_owned(), reason })?;
    let mut files: Vec<PathBuf> = entries.iter().map(fs::DirEntry::path).collect();
    files.retain(|path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("txt")));
    let is_named = |path: &PathBuf| path.file_stem().is_some_and(|s| s.to_string_lossy().ends_with(TEXT_FILE_SUFFIX));
    if files.iter().any(is_named) {
        files.retain(is_named);
    }
    let mut frames = BTreeMap::new();
    for path in files {
        let number = last_digits(&path).and_then(|digits| digits.parse().ok());
        let frame = number.ok_or_else(|| LandmarksError::NoNumber { path: path.clone() })?;
        if frames.insert(frame, read_text_file(&path)?).is_some() {
            return Err(LandmarksError::DuplicateFrame { path, frame });
        }
    }
    Ok(frames)
}

/// 68 lines of two numbers between white space; blank lines are passed over.
fn read_text_file(path: &Path) -> Result<Vec<Point2<f64>>, LandmarksError> {
    const SHOWN: usize = 60;
    let bytes = fs::read(path).map_err(|reason| LandmarksError::Io { path: path.to_owned(), reason })?;
    let text = String::from_utf8_lossy(&bytes);
    let mut points = Vec::new();
    for (line, content) in (1..).zip(text.lines()).filter(|(_, content)| !content.trim().is_empty()) {
        let fields: Vec<Option<f64>> =
            content.split_whitespace().map(|f| f.parse().ok().filter(|v: &f64| v.is_finite())).collect();
        let [Some(x), Some(y)] = fields[..] else {
            let found = content.trim().chars().take(SHOWN).collect();
            return Err(LandmarksError::Line { path: path.to_owned(), line, found });
        };
        points.push(Point2::new(x, y));
    }
    if points.len() == LANDMARK_COUNT {
        Ok(points)
    } else {
        Err(LandmarksError::Count { path: path.to_owned(), found: points.len() })
    }
}

/// Which landmarks become correspondences. Interpolated ones (confidence low, or between two nodes) never do.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LandmarkSelection {
    /// Those of [`DEFAULT_LANDMARK_NODES`].
    #[default]
    Default,
    /// Those of the given nodes, in the order given.
    Nodes(Vec<NodeId>),
    /// All that are the same anatomical point as a node.
    High,
    /// These and all on the same contour.
    HighAndMedium,
}

impl FromStr for LandmarkSelection {
    type Err = String;

    /// `default`, `high`, `all` (high and medium), or node numbers separated by commas.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "default" => Ok(Self::Default),
            "high" => Ok(Self::High),
            "all" => Ok(Self::HighAndMedium),
            list => {
                let node = |word: &str| word.trim().parse().map(NodeId);
                let nodes: Result<Vec<NodeId>, _> = list.split(',').map(node).collect();
                nodes
                    .map(Self::Nodes)
                    .map_err(|_| format!("`{text}` is neither default, high, all nor a list of nodes such as 20,23,53"))
            }
        }
    }
}

/// Correspondences from the landmarks of one frame, through [`Tables::landmarks`]; `points` in the order of the scheme.
///
/// # Errors
/// [`LandmarksError::NoLandmark`] when a node was asked for that no landmark in `points` marks.
pub fn correspondences_from_landmarks(
    points: &[Point2<f64>],
    tables: &Tables,
    selection: &LandmarkSelection,
) -> Result<Vec<Correspondence>, LandmarksError> {
    let marks: Vec<(NodeId, LandmarkConfidence, Point2<f64>)> = tables
        .landmarks
        .iter()
        .filter_map(|row| match row.nodes[..] {
            [(node, _)] => Some((node, row.confidence, *points.get(usize::from(row.landmark))?)),
            _ => None,
        })
        .filter(|&(_, confidence, _)| confidence != LandmarkConfidence::Low)
        .collect();
    let correspondence = |node, position| Correspondence { node, position, kind: MarkKind::Mark };
    let of_nodes = |nodes: &[NodeId]| {
        let one = |&node: &NodeId| match marks.iter().find(|mark| mark.0 == node) {
            Some(&(_, _, position)) => Ok(correspondence(node, position)),
            None => Err(LandmarksError::NoLandmark { node, nodes: marks.iter().map(|mark| mark.0).collect() }),
        };
        nodes.iter().map(one).collect()
    };
    let at_least = |least| marks.iter().filter(|mark| mark.1 >= least).map(|mark| correspondence(mark.0, mark.2)).collect();
    match selection {
        LandmarkSelection::Default => of_nodes(&DEFAULT_LANDMARK_NODES),
        LandmarkSelection::Nodes(nodes) => of_nodes(nodes),
        LandmarkSelection::High => Ok(at_least(LandmarkConfidence::High)),
        LandmarkSelection::HighAndMedium => Ok(at_least(LandmarkConfidence::Medium)),
    }
}

#[cfg(test)]
#[allow(clippy::format_collect)]
mod tests {
    use super::*;

    /// Landmark k of frame f at (k, 1000 f + k).
    fn row(frame: u32, count: u32) -> String {
        let points = (0..count).map(|k| format!(",{k},{}", 1000 * frame + k)).collect::<String>();
        format!("{frame}{points}\n")
    }

    fn header(count: u32) -> String {
        format!("frame{}\n", (0..count).map(|k| format!(",x{k},y{k}")).collect::<String>())
    }

    fn csv(text: &str) -> Result<LandmarkTrack, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("landmarks.csv");
        fs::write(&path, text).unwrap();
        read_landmarks(&path).map_err(|e| e.to_string())
    }

    #[test]
    fn a_csv_file_reads() {
        let track = csv(&format!("{}{}{}", header(68), row(3, 68), row(1, 68))).unwrap();
        assert_eq!(track.frames.keys().copied().collect::<Vec<_>>(), [1, 3]);
        assert_eq!(track.frame(3).unwrap()[67], Point2::new(67.0, 3067.0));
        let error = track.frame(2).unwrap_err().to_string();
        assert!(error.ends_with(": frame 2 has no landmarks; there are 2 frames from 1 to 3"), "{error}");
    }

    #[test]
    fn other_counts_and_bad_numbers_are_refused() {
        let error = |text: String| csv(&text).unwrap_err();
        assert!(error(header(67) + &row(1, 67)).ends_with("67 points, 68 were expected"));
        assert!(error(header(69) + &row(1, 69)).ends_with("69 points, 68 were expected"));
        assert!(error(header(68) + &row(1, 67)).ends_with("line 2: the row has 135 fields where the header has 137"));
        let nan = (header(68) + &row(1, 68)).replace("1,0,1000,", "1,0,NaN,");
        assert!(error(nan).ends_with("line 2: y0 is `NaN`; a finite number was expected"));
        assert!(error(header(68) + &row(1, 68) + &row(1, 68)).contains("frame 1 are there twice"));
        assert!(error(header(68)).contains("no landmarks of any frame"));
        assert!(error(header(68).replace("frame", "f")).contains("has no column `frame`"));
    }

    fn text_folder(files: &[(&str, String)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            fs::write(folder.path().join(name), text).unwrap();
        }
        folder
    }

    fn lines(count: u32) -> String {
        (0..count).map(|k| format!("   {k}.0000000e+00   {}.5e+01 \r\n", k + 1)).collect()
    }

    #[test]
    fn text_files_per_frame_read() {
        let files = [("S1_2_00000001_landmarks.txt", lines(68)), ("S1_2_00000002_landmarks.txt", lines(68)), ("a.txt", lines(1))];
        let track = read_landmarks(text_folder(&files).path()).unwrap();
        assert_eq!(track.frames.len(), 2);
        // 3.5e+01 = 35.
        assert_eq!(track.frame(2).unwrap()[2], Point2::new(2.0, 35.0));
    }

    #[test]
    fn bad_text_files_are_named() {
        let error = |name: &str, text: String| read_landmarks(text_folder(&[(name, text)]).path()).unwrap_err().to_string();
        assert!(error("a_1_landmarks.txt", lines(67)).ends_with("a_1_landmarks.txt: 67 points, 68 were expected"));
        assert!(
            error("a_1_landmarks.txt", lines(2) + "3 nan\n")
                .ends_with("line 3: found `3 nan`; two finite numbers `x y` were expected")
        );
        assert!(error("a_1_landmarks.txt", "1 2 3\n".to_owned()).contains("line 1: found `1 2 3`"));
        assert!(error("a_landmarks.txt", lines(68)).contains("no frame number"));
        assert!(error("a.csv", lines(68)).contains("no landmarks of any frame"));
        let two = text_folder(&[("a_1_landmarks.txt", lines(68)), ("b_01_landmarks.txt", lines(68))]);
        assert!(read_landmarks(two.path()).unwrap_err().to_string().contains("frame 1 are there twice"));
    }

    #[test]
    fn landmarks_become_correspondences() {
        let tables = Tables::candide3();
        let points: Vec<_> = (0..68).map(|k| Point2::new(f64::from(k), -f64::from(k))).collect();
        let nodes = |selection| -> Vec<(u16, f64)> {
            let marks = correspondences_from_landmarks(&points, &tables, &selection).unwrap();
            marks.iter().map(|c| (c.node.0, c.position.x)).collect()
        };
        // Landmarks, from 0: outer eye corners 45 L, 36 R; inner 42 L, 39 R; mouth corners 54 L, 48 R; chin 8.
        let default = [(20, 45.0), (23, 42.0), (53, 36.0), (56, 39.0), (31, 54.0), (64, 48.0), (10, 8.0)];
        assert_eq!(nodes(LandmarkSelection::Default), default);
        assert_eq!(nodes(LandmarkSelection::Nodes(vec![NodeId(10), NodeId(20)])), [(10, 8.0), (20, 45.0)]);
        // Counted in ibug68.csv: 21 rows are high; 32 are medium, one of them (27, the nasion) lies between two nodes.
        let (high, all) = (nodes(LandmarkSelection::High), nodes(LandmarkSelection::HighAndMedium));
        assert_eq!((high.len(), all.len()), (21, 21 + 32 - 1));
        assert!(all.iter().all(|&(_, landmark)| landmark as u8 != 27 && landmark as u8 != 1));
        let error = correspondences_from_landmarks(&points, &tables, &LandmarkSelection::Nodes(vec![NodeId(0)])).unwrap_err();
        assert!(error.to_string().starts_with("no landmark marks node 0; nodes with one are 62 61 63"), "{error}");
    }
}
