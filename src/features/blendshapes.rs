//! Reads blendshapes that `MediaPipe`'s face landmarker measured on the same frames, as additional columns of the feature table.
//!
//! The input is a table (`frame` and columns named after the blendshapes) or the landmarker's results in JSON: one result, an array, or one
//! after the other, each with `faceBlendshapes` (JavaScript) or `face_blendshapes` (Python). Of several faces the first is used. Results
//! without `frame` belong to the track's frames in order.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use serde::Deserialize;

use super::{FrameFeatures, in_time};
use crate::{
    input::{CsvFile, InputError},
    output::nine_digits,
    text::message,
};

/// The 52 blend shape coefficients in the order of Apple's face capture files.
pub const COEFFICIENTS: [&str; 52] = [
    "eyeBlinkLeft",
    "eyeLookDownLeft",
    "eyeLookInLeft",
    "eyeLookOutLeft",
    "eyeLookUpLeft",
    "eyeSquintLeft",
    "eyeWideLeft",
    "eyeBlinkRight",
    "eyeLookDownRight",
    "eyeLookInRight",
    "eyeLookOutRight",
    "eyeLookUpRight",
    "eyeSquintRight",
    "eyeWideRight",
    "jawForward",
    "jawRight",
    "jawLeft",
    "jawOpen",
    "mouthClose",
    "mouthFunnel",
    "mouthPucker",
    "mouthRight",
    "mouthLeft",
    "mouthSmileLeft",
    "mouthSmileRight",
    "mouthFrownLeft",
    "mouthFrownRight",
    "mouthDimpleLeft",
    "mouthDimpleRight",
    "mouthStretchLeft",
    "mouthStretchRight",
    "mouthRollLower",
    "mouthRollUpper",
    "mouthShrugLower",
    "mouthShrugUpper",
    "mouthPressLeft",
    "mouthPressRight",
    "mouthLowerDownLeft",
    "mouthLowerDownRight",
    "mouthUpperUpLeft",
    "mouthUpperUpRight",
    "browDownLeft",
    "browDownRight",
    "browInnerUp",
    "browOuterUpLeft",
    "browOuterUpRight",
    "cheekPuff",
    "cheekSquintLeft",
    "cheekSquintRight",
    "noseSneerLeft",
    "noseSneerRight",
    "tongueOut",
];

/// Score that `MediaPipe` has instead of `tongueOut`.
const NEUTRAL: &str = "_neutral";

/// Blendshapes that do not read, or not beside a track.
#[derive(Debug, thiserror::Error)]
pub enum BlendshapesError {
    /// The table cannot be read.
    #[error(transparent)]
    Table(#[from] InputError),
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The JSON is not a result of a face landmarker.
    #[error(
        "{}: not MediaPipe's results in JSON (`faceBlendshapes` or `face_blendshapes` with names and scores): {reason}",
        path.display()
    )]
    Json {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The file has no blendshapes.
    #[error("{}: no blendshapes; expected {what}", path.display())]
    None {
        /// The file.
        path: PathBuf,
        /// What was looked for.
        what: &'static str,
    },
    /// A frame appears twice.
    #[error("{}: frame {frame} appears twice; keep one", path.display())]
    DuplicateFrame {
        /// The file.
        path: PathBuf,
        /// Frame number.
        frame: u32,
    },
    /// Results without frame numbers, whose count differs from that of the frames.
    #[error("{}: there are {found} results without frame numbers, but the track has {expected} frames", path.display())]
    Count {
        /// The file.
        path: PathBuf,
        /// Results.
        found: usize,
        /// Frames of the track.
        expected: usize,
    },
    /// The frame numbers of the results do not match those of the track.
    #[error(
        "{}: the results have frames {} to {}, but the track has {} to {}: use the results of the same frames, with the frame numbers of \
         the track",
        path.display(), found.0, found.1, expected.0, expected.1
    )]
    Numbers {
        /// The file.
        path: PathBuf,
        /// First and last frame there.
        found: (u32, u32),
        /// First and last frame of the track.
        expected: (u32, u32),
    },
    /// An invalid score.
    #[error("{}: {name} is {score} in {}; scores are 0 to 1", path.display(), frame.map_or_else(|| "a result".to_owned(), |f| format!("frame {f}")))]
    Score {
        /// The file.
        path: PathBuf,
        /// The blendshape.
        name: String,
        /// Frame number, where there is one.
        frame: Option<u32>,
        /// The number there.
        score: f64,
    },
}

/// Tolerance for scores slightly below 0 or above 1 due to rounding.
const SCORE_ROUNDING: f64 = 1e-3;

/// Frame number, if given, and scores by name.
type Row = (Option<u32>, BTreeMap<String, f64>);

/// Scores of blendshapes, 0 to 1, frame by frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Blendshapes {
    path: PathBuf,
    names: Vec<String>,
    frames: Vec<Row>,
}

/// Additional columns of a feature file, with frames by ascending number.
#[derive(Clone, Debug, PartialEq)]
pub struct ColumnsBeside {
    pub(super) header: Vec<String>,
    pub(super) rows: Vec<Vec<String>>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Part {
    Many(Vec<Measured>),
    One(Measured),
}

/// A result of the face landmarker.
#[derive(Deserialize)]
struct Measured {
    frame: Option<u32>,
    #[serde(alias = "faceBlendshapes", alias = "face_blendshapes")]
    blendshapes: Vec<Face>,
}

/// Blendshapes of a face, in the JavaScript or the Python layout.
#[derive(Deserialize)]
#[serde(untagged)]
enum Face {
    Named { categories: Vec<Category> },
    Bare(Vec<Category>),
}

#[derive(Deserialize)]
struct Category {
    #[serde(alias = "categoryName", alias = "category_name")]
    name: String,
    score: f64,
}

/// Reads blendshapes: JSON for the extensions `.json` and `.jsonl`, else a table.
///
/// # Errors
/// [`BlendshapesError`] for a file that is neither, or has none of the 52 coefficients.
pub fn read_blendshapes(path: &Path) -> Result<Blendshapes, BlendshapesError> {
    let is_json = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json") || e.eq_ignore_ascii_case("jsonl"));
    let frames = if is_json { from_json(path)? } else { from_table(path)? };
    let held: BTreeSet<&String> = frames.iter().flat_map(|(_, scores)| scores.keys()).collect();
    // In the order of `COEFFICIENTS`, whatever the order in the file.
    let names: Vec<String> =
        COEFFICIENTS.iter().chain([&NEUTRAL]).map(|&name| name.to_owned()).filter(|name| held.contains(name)).collect();
    if names.is_empty() {
        let what = if is_json { "`faceBlendshapes` with scores such as jawOpen" } else { "columns such as jawOpen" };
        return Err(BlendshapesError::None { path: path.to_owned(), what });
    }
    for (frame, scores) in &frames {
        if let Some((name, &score)) = scores.iter().find(|(_, score)| !(-SCORE_ROUNDING..=1.0 + SCORE_ROUNDING).contains(*score))
        {
            return Err(BlendshapesError::Score { path: path.to_owned(), name: name.clone(), frame: *frame, score });
        }
    }
    let numbered = frames.iter().filter(|(number, _)| number.is_some()).count();
    if numbered > 0 && numbered < frames.len() {
        let reason = format!("{numbered} of {} results have a frame number; give one to all or to none", frames.len());
        return Err(BlendshapesError::Json { path: path.to_owned(), reason });
    }
    let mut numbers = BTreeSet::new();
    if let Some(frame) = frames.iter().filter_map(|(number, _)| *number).find(|&number| !numbers.insert(number)) {
        return Err(BlendshapesError::DuplicateFrame { path: path.to_owned(), frame });
    }
    Ok(Blendshapes { path: path.to_owned(), names, frames })
}

/// Returns the matching name in [`COEFFICIENTS`], or `_neutral`.
fn known(name: &str) -> Option<&'static str> {
    COEFFICIENTS.into_iter().chain([NEUTRAL]).find(|known| known.eq_ignore_ascii_case(name.trim()))
}

fn from_table(path: &Path) -> Result<Vec<Row>, BlendshapesError> {
    let csv = CsvFile::open(path)?;
    let [frame] = csv.require(["frame"])?;
    let columns: Vec<(usize, &str)> = csv.header().iter().enumerate().filter_map(|(k, name)| Some((k, known(name)?))).collect();
    let mut frames = Vec::new();
    for row in csv.rows() {
        let row = row?;
        let mut scores = BTreeMap::new();
        for &(k, name) in columns.iter().filter(|(k, _)| !row.get(*k).is_empty()) {
            scores.insert(name.to_owned(), row.number(k)?);
        }
        frames.push((Some(row.whole_number(frame)?), scores));
    }
    Ok(frames)
}

fn from_json(path: &Path) -> Result<Vec<Row>, BlendshapesError> {
    let bytes = crate::input::read(path).map_err(|source| BlendshapesError::Io { path: path.to_owned(), source })?;
    let mut frames = Vec::new();
    for part in serde_json::Deserializer::from_slice(&bytes).into_iter::<Part>() {
        let part =
            part.map_err(|e| BlendshapesError::Json { path: path.to_owned(), reason: message(&e.to_string()).into_owned() })?;
        let measured = match part {
            Part::Many(measured) => measured,
            Part::One(measured) => vec![measured],
        };
        for Measured { frame, blendshapes } in measured {
            // A frame without a face has no scores.
            let scores = match blendshapes.into_iter().next() {
                Some(Face::Named { categories } | Face::Bare(categories)) => categories,
                None => Vec::new(),
            };
            let scores = scores.into_iter().filter_map(|c| Some((known(&c.name)?.to_owned(), c.score))).collect();
            frames.push((frame, scores));
        }
    }
    Ok(frames)
}

impl Blendshapes {
    /// Returns columns `mediapipe_NAME` for frames, rows by ascending frame number.
    ///
    /// # Errors
    /// As [`Blendshapes::scores`].
    pub fn beside(&self, features: &[FrameFeatures]) -> Result<ColumnsBeside, BlendshapesError> {
        let numbers: Vec<u32> = in_time(features).iter().map(|f| f.frame).collect();
        let header = self.names.iter().map(|name| format!("mediapipe_{}", name.trim_start_matches('_'))).collect();
        let field = |score: Option<f64>| score.map(nine_digits).unwrap_or_default();
        let rows = self.scores(&numbers)?.into_iter().map(|row| row.into_iter().map(field).collect()).collect();
        Ok(ColumnsBeside { header, rows })
    }

    /// Returns the scores in the frames with these numbers, one row per frame in the order of [`Blendshapes::names`]; `None` where nothing
    /// was measured.
    ///
    /// # Errors
    /// [`BlendshapesError::Count`] if results without numbers are more or fewer than the frames; [`BlendshapesError::Numbers`] if the
    /// numbers are not those of the frames.
    pub fn scores(&self, numbers: &[u32]) -> Result<Vec<Vec<Option<f64>>>, BlendshapesError> {
        let row = |scores: Option<&BTreeMap<String, f64>>| {
            self.names.iter().map(|name| scores.and_then(|s| s.get(name)).copied()).collect::<Vec<_>>()
        };
        if self.frames.iter().all(|(number, _)| number.is_none()) {
            if self.frames.len() != numbers.len() {
                return Err(BlendshapesError::Count {
                    path: self.path.clone(),
                    found: self.frames.len(),
                    expected: numbers.len(),
                });
            }
            return Ok(self.frames.iter().map(|(_, scores)| row(Some(scores))).collect());
        }
        let by_number: BTreeMap<u32, _> = self.frames.iter().filter_map(|(number, scores)| Some(((*number)?, scores))).collect();
        let common = numbers.iter().filter(|number| by_number.contains_key(number)).count();
        let ends = |numbers: &mut dyn Iterator<Item = u32>| {
            numbers.fold(None, |ends: Option<(u32, u32)>, n| Some(ends.map_or((n, n), |(low, high)| (low.min(n), high.max(n)))))
        };
        if let (Some(found), Some(expected)) = (ends(&mut by_number.keys().copied()), ends(&mut numbers.iter().copied())) {
            // Equally many but different numbers, or numbers that start and end earlier: counted from another start. Fewer or more numbers
            // are fine: those of a part, or of the whole recording.
            let as_many = by_number.len() == numbers.len() && common < numbers.len();
            let before = found.0 < expected.0 && found.1 < expected.1;
            if common == 0 || as_many || before {
                return Err(BlendshapesError::Numbers { path: self.path.clone(), found, expected });
            }
        }
        Ok(numbers.iter().map(|number| row(by_number.get(number).copied())).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(name: &str, text: &str) -> Result<Blendshapes, BlendshapesError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        read_blendshapes(&path)
    }

    #[test]
    fn frames_that_are_counted_otherwise_and_scores_that_are_none_are_refused() {
        let table = |frames: &[u32]| {
            let rows: String = frames.iter().map(|frame| format!("{frame},0.5\n")).collect();
            read("a.csv", &format!("frame,jawOpen\n{rows}")).unwrap()
        };
        let said = |frames: &[u32], of: &[u32]| table(frames).scores(of).unwrap_err().to_string();
        assert!(said(&[0, 1, 2], &[1, 2, 3]).contains("the results have frames 0 to 2, but the track has 1 to 3"));
        assert!(said(&[0, 2], &[1, 2, 3]).contains("frames 0 to 2"));
        assert!(said(&[100, 200], &[1, 2, 3]).contains("frames 100 to 200"));
        // A frame without a face, and a recording of which the track is a part.
        assert_eq!(table(&[1, 3]).scores(&[1, 2, 3]).unwrap()[1], [None]);
        assert_eq!(table(&[1, 2, 3, 4, 5]).scores(&[2, 3]).unwrap(), [[Some(0.5)], [Some(0.5)]]);
        let said = |score: &str| read("a.csv", &format!("frame,jawOpen\n4,{score}\n")).map_err(|e| e.to_string());
        assert!(said("7").unwrap_err().contains("jawOpen is 7 in frame 4; scores are 0 to 1"));
        assert!(said("-0.01").is_err() && said("1.0000001").is_ok());
    }

    #[test]
    fn results_of_javascript_and_python_and_a_table_are_the_same() {
        let javascript = r#"[{"faceLandmarks":[],"faceBlendshapes":[{"categories":[{"index":0,"score":0.25,"categoryName":"_neutral",
            "displayName":""},{"index":25,"score":0.5,"categoryName":"jawOpen"}],"headIndex":-1}]},{"faceBlendshapes":[]}]"#;
        let python = r#"{"face_blendshapes":[[{"category_name":"jawOpen","score":0.5},{"category_name":"_neutral","score":0.25}]]}
            {"face_blendshapes":[]}"#;
        let expected = vec![vec![Some(0.5), Some(0.25)], vec![None, None]];
        for (name, text) in [("a.json", javascript), ("a.jsonl", python)] {
            let found = read(name, text).unwrap();
            assert_eq!(found.names, ["jawOpen", "_neutral"]);
            assert_eq!(found.scores(&[3, 4]).unwrap(), expected);
            assert!(matches!(found.scores(&[3]), Err(BlendshapesError::Count { found: 2, expected: 1, .. })));
        }
        let table = read("a.csv", "frame,JawOpen,_neutral,width\n4,,,640\n3,0.5,0.25,640\n").unwrap();
        assert_eq!(table.scores(&[3, 4, 5]).unwrap(), [expected[0].clone(), expected[1].clone(), expected[1].clone()]);
    }

    #[test]
    fn files_without_blendshapes_are_refused_with_the_reason() {
        let said = |name: &str, text: &str| read(name, text).unwrap_err().to_string();
        assert!(said("a.csv", "frame,x0\n1,2\n").contains("columns such as jawOpen"));
        assert!(said("a.csv", "frame,jawOpen\n1,wide\n").contains("line 2"));
        assert!(said("a.json", "{\"faceLandmarks\":[]}").contains("`face_blendshapes` with names and scores"));
        assert!(said("a.json", "[]").contains("faceBlendshapes"));
        assert!(said("a.csv", "frame,jawOpen\n1,0.5\n1,0.5\n").contains("frame 1 appears twice"));
    }
}
