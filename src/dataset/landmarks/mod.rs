//! 68-point landmarks (Multi-PIE / iBUG order) of the frames of a sequence, and correspondences from them.
//!
//! | form | what | frame number | unit |
//! | --- | --- | --- | --- |
//! | own | CSV `frame,x0,y0,...,x67,y67` | column `frame` | px from 0 |
//! | `OpenFace` | CSV with `frame`, `confidence`, `success`, `x_0..x_67`, `y_0..y_67` among others | column `frame` | px from 0 |
//! | iBUG | a `.pts` file per frame | in the name, as for images | px from 1; shifted to 0 here |
//! | `MediaPipe` | CSV as own, with 468 or 478 points, reduced to the 68 | column `frame` | px from 0, or shares |
//! | CK+ | a text file per frame, 68 lines `x y` | in the name, as for images | px, unchanged |
//!
//! Points of CSV files may be shares of the picture, if `width` and `height` are given.
//!
//! The form is recognized by content, columns by name. Columns may be separated by semicolons; decimals then have commas. Inside the
//! program the centre of the top-left pixel is (0, 0), y down. `OpenFace` rows with frame 0 throughout are numbered in their order. A frame
//! is *lost* if its row says so (`success` 0, a confidence below the minimum, or a missing coordinate: empty, NaN, NA or null).

mod correspond;
mod mediapipe;
mod points;
mod sequence;
mod table;

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
};

use nalgebra::Point2;

use super::{
    frames::{has_digits, has_extension, picture_count, visible},
    numbering::{Numbering, numbered},
};
use crate::{input::InputError, units::NodeId};

pub use correspond::{DEFAULT_LANDMARK_NODES, LandmarkSelection, correspondences_from_landmarks};
pub(super) use points::read as read_points;
pub use sequence::{LandmarkFrame, LandmarkSequence};

/// Number of points in the scheme.
pub const LANDMARK_COUNT: usize = 68;

/// Extensions of files with the points of one frame.
const FRAME_EXTENSIONS: [&str; 2] = ["txt", "pts"];
/// Extensions of tables with the points of many frames.
const TABLE_EXTENSIONS: [&str; 1] = ["csv"];

/// Whether a file may contain landmarks, by its name.
pub(super) fn has_landmark_extension(path: &Path) -> bool {
    has_extension(path, &FRAME_EXTENSIONS) || has_extension(path, &TABLE_EXTENSIONS)
}

/// Confidence below which a frame counts as lost, for files that state one; the limit that users of `OpenFace` commonly apply.
pub const LEAST_CONFIDENCE: f64 = 0.75;

/// Ending of the names of CK+'s landmark files, before the extension.
const TEXT_FILE_SUFFIX: &str = "_landmarks";

/// Number of bytes from which the form of a file is recognized. The header of an `OpenFace` table is longer, but contains `frame` within
/// it.
const SNIFFED_BYTES: usize = 4096;

/// Landmarks of the frames of one sequence.
///
/// ```
/// use grimace::dataset::read_landmarks;
///
/// // The table at `path` has frames 1, 2 and 4.
/// let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("landmarks.csv");
/// # let header: String = (0..68).map(|k| format!(",x{k},y{k}")).collect();
/// # let row: String = (0..68).map(|k| format!(",{k},{}", k * k)).collect();
/// # std::fs::write(&path, format!("frame{header}\n1{row}\n2{row}\n4{row}\n"))?;
/// let track = read_landmarks(&path)?;
/// assert_eq!(track.frames.keys().copied().collect::<Vec<u32>>(), [1, 2, 4]);
/// assert_eq!(track.frame(2)?.len(), 68);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct LandmarkTrack {
    /// File or folder they were read from.
    pub path: PathBuf,
    /// The files, in the order of the frames.
    pub files: Vec<PathBuf>,
    /// Frame number to [`LANDMARK_COUNT`] positions in image pixels, in the order of the scheme.
    pub frames: BTreeMap<u32, Vec<Point2<f64>>>,
    /// Lost frames, ascending.
    pub lost: Vec<u32>,
    /// Confidence below which a frame counted as lost.
    pub least_confidence: f64,
    /// Times of the frames in seconds, from the column `timestamp`.
    pub times: BTreeMap<u32, f64>,
}

/// Errors of reading or using landmarks.
///
/// ```
/// use grimace::dataset::{LandmarksError, read_landmarks};
///
/// // The table at `path` has frames 1, 2 and 4.
/// let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("landmarks.csv");
/// # let header: String = (0..68).map(|k| format!(",x{k},y{k}")).collect();
/// # let row: String = (0..68).map(|k| format!(",{k},{}", k * k)).collect();
/// # std::fs::write(&path, format!("frame{header}\n1{row}\n2{row}\n4{row}\n"))?;
/// let error = read_landmarks(&path)?.sequence(Some(3), None).unwrap_err();
/// assert!(matches!(error, LandmarksError::NoSuchFrame { frame: 3, count: 3, first: 1, last: 4, .. }));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum LandmarksError {
    /// A CSV file cannot be read, or a field is not a finite number.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A file or folder that cannot be read.
    #[error("{}: cannot be read: {reason}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        #[source]
        reason: io::Error,
    },
    /// The number of points differs from that of the scheme.
    #[error("{}: {found} points, {LANDMARK_COUNT} were expected (of MediaPipe 468 or 478)", path.display())]
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
    /// A number with a decimal comma.
    #[error("{}, line {line}: found `{found}`; write decimals with a point and columns with commas", path.display())]
    DecimalComma {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The field or line, shortened.
        found: String,
    },
    /// A row with more fields than columns, probably because of decimal commas.
    #[error("{}, line {line}: the line has {found} fields, but the header has {expected}; if there are decimal commas, write decimals \
         with a point, or separate columns by semicolons", path.display())]
    ExtraFields {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Fields of the row.
        found: usize,
        /// Columns of the header.
        expected: usize,
    },
    /// An invalid `.pts` file.
    #[error("{}, line {line}: found `{found}`; {expected} was expected (a .pts file is `version: 1`, `n_points: 68`, `{{`, a line `x y` per point, `}}`)", path.display())]
    Pts {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The line, shortened.
        found: String,
        /// The expected content.
        expected: &'static str,
    },
    /// The table does not have the requested face.
    #[error("{}: no row has the `face_id` {face}; choose from {}", path.display(), crate::output::listed(found, 10))]
    NoSuchFace {
        /// The file.
        path: PathBuf,
        /// The face asked for.
        face: String,
        /// The existing faces.
        found: Vec<String>,
    },
    /// Points are relative to the size of the picture, which is unknown.
    #[error(
        "{}, line {line}: the points are shares of the picture's width and height (0 to 1); add the columns `width` and `height`, px, or \
         multiply by them", path.display()
    )]
    Normalized {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
    },
    /// As [`LandmarksError::Normalized`], in a file of one frame.
    #[error("{}: the points are shares of the picture's width and height (0 to 1); multiply x by the width and y by the height, px", path.display())]
    NormalizedFile {
        /// The file.
        path: PathBuf,
    },
    /// A folder with more than one set of landmarks.
    #[error("{}: more than one set of landmarks: {}; name one in the manifest's column `landmarks`, or leave one in the folder", folder.display(), found.join(", "))]
    Ambiguous {
        /// The folder.
        folder: PathBuf,
        /// The landmark files found.
        found: Vec<String>,
    },
    /// The file has no landmarks in a known form.
    #[error("{}: this is not a landmark file; supported are tables with a column `frame` (of grimace and OpenFace), .pts files, and \
         CK+'s text files of 68 lines `x y`", path.display())]
    Unknown {
        /// The file.
        path: PathBuf,
    },
    /// Every frame was lost.
    #[error("{}: the face is lost in all {frames} frames (no success, a confidence under {least}, or a coordinate missing)", path.display())]
    AllLost {
        /// File or folder.
        path: PathBuf,
        /// Number of frames.
        frames: usize,
        /// Least confidence of a found face.
        least: f64,
    },
    /// The neutral or the apex frame was lost.
    #[error("{}: the face is lost in frame {frame}, the {what} frame; choose another `{column}` (found in frames {first} to {last})", path.display())]
    EndLost {
        /// File or folder.
        path: PathBuf,
        /// The frame.
        frame: u32,
        /// `neutral` or `apex`.
        what: &'static str,
        /// `first_frame` or `last_frame`.
        column: &'static str,
        /// First frame in which the face was found.
        first: u32,
        /// Last frame in which the face was found.
        last: u32,
    },
    /// Fewer than half of the frames have landmarks.
    #[error("{}: only {found} of {frames} frames from {first} to {last} have landmarks; at least half are needed", path.display())]
    MostlyLost {
        /// File or folder.
        path: PathBuf,
        /// Frames from neutral to apex.
        frames: u64,
        /// The neutral frame.
        first: u32,
        /// The apex frame.
        last: u32,
        /// Frames with landmarks.
        found: usize,
    },
    /// Fewer than two frames.
    #[error("{}: {found} frame from neutral to apex; at least 2 are needed", path.display())]
    TooFew {
        /// File or folder.
        path: PathBuf,
        /// Frames.
        found: usize,
    },
    /// A frame has two rows or files.
    #[error("{}: landmarks of frame {frame} appear twice; keep one", path.display())]
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
    /// Files that are numbered in the order of their names, but do not match the images.
    #[error(
        "{}: several numbers vary in the names, so files are matched in order, but there are {files} landmark files and {images} images; \
         name them by frame number, such as S005_001_00000001", folder.display()
    )]
    Counted {
        /// The folder.
        folder: PathBuf,
        /// Files of landmarks.
        files: usize,
        /// Images beside them.
        images: usize,
    },
    /// There are no frames.
    #[error("{}: no frame has landmarks", path.display())]
    Empty {
        /// The file or folder.
        path: PathBuf,
    },
    /// The manifest names a file that does not exist.
    #[error("the landmark file does not exist; searched for {}", paths.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(" and "))]
    NotFound {
        /// Paths that were searched.
        paths: Vec<PathBuf>,
    },
    /// A frame without landmarks.
    #[error("{}: frame {frame} has no landmarks; {count} frames from {first} to {last} have them", path.display())]
    NoSuchFrame {
        /// File or folder of the landmarks.
        path: PathBuf,
        /// The frame asked for.
        frame: u32,
        /// Number of frames.
        count: usize,
        /// Smallest frame number.
        first: u32,
        /// Largest frame number.
        last: u32,
    },
    /// A node without a landmark.
    #[error("node {node} has no landmark; nodes with a landmark are {}", nodes.iter().map(ToString::to_string).collect::<Vec<_>>().join(" "))]
    NoLandmark {
        /// The node.
        node: NodeId,
        /// Nodes that have a landmark.
        nodes: Vec<NodeId>,
    },
}

impl LandmarkTrack {
    /// First and last frame with landmarks; 0 if there is none.
    fn ends(&self) -> (u32, u32) {
        let number = |key: Option<&u32>| key.copied().unwrap_or_default();
        (number(self.frames.keys().next()), number(self.frames.keys().next_back()))
    }

    /// Returns the 68 positions in a frame.
    ///
    /// # Errors
    /// [`LandmarksError::NoSuchFrame`] with the existing frames.
    pub fn frame(&self, frame: u32) -> Result<&[Point2<f64>], LandmarksError> {
        self.frames.get(&frame).map(Vec::as_slice).ok_or_else(|| {
            let (first, last) = self.ends();
            LandmarksError::NoSuchFrame { path: self.path.clone(), frame, count: self.frames.len(), first, last }
        })
    }
}

/// Form of a file, by its content. [`points`] reads `Pts` and `Text`, [`table`] reads `Table`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// A table with a column `frame`.
    Table,
    /// iBUG's `.pts`.
    Pts,
    /// Two numbers in the first line.
    Text,
    /// Something else.
    Other,
}

/// Recognizes the form of a file by its first non-blank line, or the part of it within [`SNIFFED_BYTES`]. The first form that fits counts.
fn form_of(path: &Path) -> Form {
    let mut start = Vec::new();
    let read = crate::input::open_file(path)
        .and_then(|file| io::Read::read_to_end(&mut io::Read::take(file, SNIFFED_BYTES as u64), &mut start));
    if read.is_err() {
        return Form::Other;
    }
    let text = String::from_utf8_lossy(&start);
    let text = text.trim_start_matches('\u{FEFF}');
    let Some(line) = text.lines().map(str::trim).find(|line| !line.is_empty()) else { return Form::Other };
    let lower = line.to_lowercase();
    if lower.starts_with("version:") || lower.starts_with("n_points:") {
        return Form::Pts;
    }
    if lower.split([',', ';', '\t']).any(|name| name.trim().trim_matches('"') == "frame") {
        return Form::Table;
    }
    let numbers = line.split_whitespace().map(|word| word.replace(',', ".").parse::<f64>());
    let numbers: Vec<_> = numbers.collect();
    if numbers.len() == 2 && numbers.iter().all(Result::is_ok) { Form::Text } else { Form::Other }
}

/// Reads the landmarks of a sequence: a table, or a folder with a table or with one file per frame.
///
/// Supported are tables `frame,x0,y0,...` of 68 points, or of `MediaPipe`'s 468 or 478; tables of `OpenFace`; CK+'s text files and iBUG's
/// `.pts` files, one per frame. The form is recognized by content. Positions are px, the centre of the top-left pixel (0, 0).
///
/// ```
/// use grimace::dataset::read_landmarks;
/// use nalgebra::Point2;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("landmarks.csv");
/// let header: String = (0..68).map(|k| format!(",x{k},y{k}")).collect();
/// let row: String = (0..68).map(|k| format!(",{k},100.5")).collect();
/// std::fs::write(&path, format!("frame{header}\n1{row}\n"))?;
/// assert_eq!(read_landmarks(&path)?.frame(1)?[30], Point2::new(30.0, 100.5));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`LandmarksError`] for files that cannot be read, an unsupported number of points, fields that are not finite numbers, duplicate frames,
/// several sets of landmarks in one folder, or no frame.
pub fn read_landmarks(path: &Path) -> Result<LandmarkTrack, LandmarksError> {
    read_landmarks_with(path, LEAST_CONFIDENCE)
}

/// As [`read_landmarks`] with another least confidence.
///
/// # Errors
/// As [`read_landmarks`].
pub fn read_landmarks_with(path: &Path, least_confidence: f64) -> Result<LandmarkTrack, LandmarksError> {
    read_face(path, least_confidence, None)
}

/// As [`read_landmarks_with`] for the face with a `face_id`; by default for the one found in most frames, or the largest of several such.
///
/// # Errors
/// As [`read_landmarks`], and [`LandmarksError::NoSuchFace`].
pub fn read_face(path: &Path, least_confidence: f64, face: Option<&str>) -> Result<LandmarkTrack, LandmarksError> {
    let files = landmark_files(path)?;
    let (frames, lost) = (BTreeMap::new(), Vec::new());
    let mut track = LandmarkTrack { path: path.to_owned(), files, frames, lost, least_confidence, times: BTreeMap::new() };
    match &track.files[..] {
        [] => {}
        [file] if file == path || has_extension(file, &TABLE_EXTENSIONS) => {
            let file = file.clone();
            table::read(&file, face, &mut track)?;
        }
        files => {
            for (file, frame) in files.iter().zip(frame_numbers(path, files)?) {
                if track.frames.insert(frame, points::read(file)?).is_some() {
                    return Err(LandmarksError::DuplicateFrame { path: file.clone(), frame });
                }
            }
        }
    }
    if track.frames.is_empty() && track.lost.is_empty() {
        return Err(LandmarksError::Empty { path: path.to_owned() });
    }
    Ok(track)
}

/// Frame numbers of files per frame, determined like those of images.
fn frame_numbers(folder: &Path, files: &[PathBuf]) -> Result<Vec<u32>, LandmarksError> {
    let no_number = |file: &PathBuf| LandmarksError::NoNumber { path: file.clone() };
    if let Some(file) = files.iter().find(|file| !has_digits(file)) {
        return Err(no_number(file));
    }
    match numbered(files) {
        Numbering::Named(digits) => {
            files.iter().zip(digits).map(|(file, digits)| digits.parse().map_err(|_| no_number(file))).collect()
        }
        Numbering::Counted(places) => match picture_count(folder) {
            images if images > 0 && images != files.len() => {
                Err(LandmarksError::Counted { folder: folder.to_owned(), files: files.len(), images })
            }
            _ => Ok(places),
        },
    }
}

/// Whether a file holds the landmarks of one frame.
pub(super) fn is_frame_file(path: &Path) -> bool {
    has_extension(path, &["pts"]) || matches!(form_of(path), Form::Pts | Form::Text)
}

/// Lists the files that hold the landmarks at `path`: the table itself, or those of a folder; empty for a folder without landmarks.
///
/// In a folder, files `*_landmarks.txt` have precedence; then files per frame (`.pts`, or `.txt` of that content); then a table.
///
/// # Errors
/// [`LandmarksError::Io`] for a folder that cannot be listed, [`LandmarksError::Unknown`] for a file that is not a table,
/// [`LandmarksError::Ambiguous`] for a folder with several tables, or with a table and files per frame.
pub fn landmark_files(path: &Path) -> Result<Vec<PathBuf>, LandmarksError> {
    if !path.is_dir() {
        // A file named `.csv` is read as a table, so that the error names what it lacks.
        let is_table = has_extension(path, &TABLE_EXTENSIONS) || !path.exists() || form_of(path) == Form::Table;
        return if is_table { Ok(vec![path.to_owned()]) } else { Err(LandmarksError::Unknown { path: path.to_owned() }) };
    }
    let entries = visible(path).map_err(|reason| LandmarksError::Io { path: path.to_owned(), reason })?;
    let files: Vec<PathBuf> = entries.iter().map(fs::DirEntry::path).collect();
    let texts: Vec<&PathBuf> = files.iter().filter(|file| has_extension(file, &FRAME_EXTENSIONS)).collect();
    let is_named = |file: &PathBuf| file.file_stem().is_some_and(|s| s.to_string_lossy().ends_with(TEXT_FILE_SUFFIX));
    let named: Vec<PathBuf> = texts.iter().filter(|file| is_named(file)).map(|&file| file.clone()).collect();
    if !named.is_empty() {
        return Ok(named);
    }
    let per_frame: Vec<PathBuf> = texts.iter().filter(|file| is_frame_file(file)).map(|&file| file.clone()).collect();
    let tables: Vec<PathBuf> =
        files.iter().filter(|file| has_extension(file, &TABLE_EXTENSIONS) && table::is_landmarks(file)).cloned().collect();
    if tables.len() + usize::from(!per_frame.is_empty()) > 1 {
        let name = |file: &PathBuf| file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut found: Vec<String> = tables.iter().map(name).collect();
        if let Some(first) = per_frame.first() {
            found.push(format!("{} files per frame such as {}", per_frame.len(), name(first)));
        }
        return Err(LandmarksError::Ambiguous { folder: path.to_owned(), found });
    }
    Ok(if per_frame.is_empty() { tables } else { per_frame })
}

#[cfg(test)]
mod tests;
