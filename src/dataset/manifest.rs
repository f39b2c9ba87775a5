//! Reads `manifest.csv`: one row per sequence.
//!
//! Required columns: `subject,sequence,emotion`. Optional columns:
//!
//! - `frames`: folder of images, video, or pictures separated by `;`, relative to the manifest, by default `SUBJECT/SEQUENCE`
//! - `first_frame`, `last_frame`: numbers as in the file names
//! - `correspondences`: path relative to the manifest, by default `SUBJECT/SEQUENCE/correspondences.csv` if that exists
//! - `landmarks`: name in the frames' folder, or else path relative to the manifest
//! - `fps`: frames per second
//!
//! All other columns are metadata. Empty fields count as missing. Columns may be separated by semicolons; decimals then have commas.

use std::{
    collections::BTreeMap,
    io::{BufRead, BufReader, Read},
    path::{Path, PathBuf},
};

use super::{
    Dataset, DatasetError, FailedEntry, Labels, PUBLISH_COLUMN, RowError, SEGMENT_COLUMN, SequenceEntry,
    entry::{FACE_COLUMN, is_publish_column},
    error::{check_file_name, name_key},
    frames::is_video,
    listed::listed_pictures,
    spelling::place_of,
};
use crate::{
    input::{CsvFile, CsvRow},
    text::{composed, excerpt, is_missing_word},
    units::SequenceId,
};

/// Default name of a correspondence file.
pub(crate) const CORRESPONDENCES_NAME: &str = "correspondences.csv";

/// Required columns.
pub const MANIFEST_COLUMNS: [&str; 3] = ["subject", "sequence", "emotion"];

/// Column indices.
struct Columns {
    subject: usize,
    sequence: usize,
    /// `None` if emotions are optional.
    emotion: Option<usize>,
    frames: Option<usize>,
    first_frame: Option<usize>,
    last_frame: Option<usize>,
    correspondences: Option<usize>,
    landmarks: Option<usize>,
    fps: Option<usize>,
    metadata: Vec<(usize, String)>,
}

/// Opens a manifest.
///
/// # Errors
/// [`DatasetError`] when the file cannot be read, lacks a required column, or has no row. Invalid rows become failures of the dataset.
pub(super) fn open(path: &Path, labels: Labels) -> Result<Dataset, DatasetError> {
    let csv = CsvFile::open(path)?.or_semicolons(needed(labels))?;
    let columns = columns(&csv, labels)?;
    let root = path.parent().map_or_else(PathBuf::new, Path::to_owned);
    // Line and id of each file stem `SUBJECT_SEQUENCE`, by its key on file systems. Two ids may share a stem (`a_b`, `c` and `a`, `b_c`).
    let mut seen: BTreeMap<String, (usize, SequenceId)> = BTreeMap::new();
    let mut sequences = Vec::new();
    let mut failures = Vec::new();
    for row in csv.rows_or_fields() {
        let row = match row {
            Ok(row) => row,
            Err((error, fields)) => {
                let field = |k: usize| fields.get(k).cloned().unwrap_or_default();
                failures.push(FailedEntry {
                    subject: field(columns.subject),
                    sequence: field(columns.sequence),
                    error: error.into(),
                });
                continue;
            }
        };
        match entry(&root, &columns, &row, labels, &mut seen) {
            Ok(entry) => sequences.push(entry),
            Err(fault) => failures.push(FailedEntry {
                subject: row.get(columns.subject).to_owned(),
                sequence: row.get(columns.sequence).to_owned(),
                error: match fault {
                    Fault::Row(problem) => DatasetError::Row { path: path.to_owned(), line: row.line(), problem },
                    Fault::Field(error) => error,
                },
            }),
        }
    }
    if sequences.is_empty() && failures.is_empty() {
        return Err(DatasetError::EmptyManifest { path: path.to_owned() });
    }
    sequences.sort_by(|a, b| a.id.cmp(&b.id));
    Ok(Dataset { root, sequences, failures, skipped: Vec::new() })
}

/// Optional columns.
const OPTIONAL: [&str; 6] = ["frames", "first_frame", "last_frame", "correspondences", "landmarks", "fps"];

/// Valid frame rates, frames per second; values outside are in another unit, such as seconds per frame.
pub const FRAME_RATES: std::ops::RangeInclusive<f64> = 0.1..=1000.0;

/// Further columns with a meaning: permission to show pictures, whole recording, selected face.
const FURTHER: [&str; 3] = [PUBLISH_COLUMN, SEGMENT_COLUMN, FACE_COLUMN];

/// Whether a column name is a misspelling of one with a meaning: it differs by case, blanks or hyphens; from 6 letters on also by a
/// missing, additional, or transposed letter; from 10 on by up to two letters of any kind. `publish` tolerates two letters, too, because a
/// misspelt one would show people who refused.
fn is_misspelt(found: &str, meant: &str) -> bool {
    let plain = found.trim().to_lowercase().replace([' ', '-'], "_");
    let letters = |text: &str| {
        let mut letters: Vec<char> = text.chars().collect();
        letters.sort_unstable();
        letters
    };
    let distance = strsim::damerau_levenshtein(&plain, meant);
    match meant.len() {
        _ if distance == 0 => true,
        10.. => distance <= 2,
        6.. if meant == PUBLISH_COLUMN => distance <= 2,
        6.. => distance == 1 && (plain.len() != meant.len() || letters(&plain) == letters(meant)),
        _ => false,
    }
}

/// Required columns.
fn needed(labels: Labels) -> &'static [&'static str] {
    match labels {
        Labels::Needed => &MANIFEST_COLUMNS,
        Labels::IfAny => &MANIFEST_COLUMNS[..2],
    }
}

/// Whether a comma- or semicolon-separated file is a list of sequences, by its first line.
pub(crate) fn is_manifest(path: &Path) -> bool {
    has_columns(path, needed(Labels::IfAny))
}

/// Whether the first line of a comma- or semicolon-separated file has all of these columns.
pub(crate) fn has_columns(path: &Path, columns: &[&str]) -> bool {
    const MOST: u64 = 1 << 16;
    let mut line = Vec::new();
    let read = crate::input::open_file(path).and_then(|file| BufReader::new(file.take(MOST)).read_until(b'\n', &mut line));
    let line = String::from_utf8_lossy(&line);
    let names: Vec<&str> = line.split([',', ';']).map(|name| name.trim_matches(['\u{feff}', '"', ' ', '\r', '\n'])).collect();
    read.is_ok() && columns.iter().all(|name| names.contains(name))
}

fn columns(csv: &CsvFile, labels: Labels) -> Result<Columns, DatasetError> {
    let emotion = csv.column(MANIFEST_COLUMNS[2]);
    let (subject, sequence) = if labels == Labels::IfAny && emotion.is_none() {
        let [subject, sequence] = csv.require([MANIFEST_COLUMNS[0], MANIFEST_COLUMNS[1]])?;
        (subject, sequence)
    } else {
        let [subject, sequence, _] = csv.require(MANIFEST_COLUMNS)?;
        (subject, sequence)
    };
    let [frames, first_frame, last_frame, correspondences, landmarks, fps] = OPTIONAL.map(|name| csv.column(name));
    for meant in OPTIONAL.into_iter().chain(FURTHER).filter(|name| csv.column(name).is_none()) {
        let is_near = |name: &&String| !is_publish_column(name) && is_misspelt(name, meant);
        if let Some(found) = csv.header().iter().find(is_near) {
            return Err(DatasetError::MisspeltColumn {
                path: csv.path().to_owned(),
                found: excerpt(found),
                meant: meant.to_owned(),
            });
        }
    }
    let named = [Some(subject), Some(sequence), emotion].into_iter();
    let known: Vec<usize> = named.chain([frames, first_frame, last_frame, correspondences, landmarks, fps]).flatten().collect();
    let others = csv.header().iter().enumerate().filter(|(k, name)| !known.contains(k) && !name.is_empty());
    let metadata = others.map(|(k, name)| (k, name.clone())).collect();
    Ok(Columns { subject, sequence, emotion, frames, first_frame, last_frame, correspondences, landmarks, fps, metadata })
}

/// Fault in a row: in the whole row, or in one field.
enum Fault {
    Row(RowError),
    Field(DatasetError),
}

impl From<RowError> for Fault {
    fn from(error: RowError) -> Self {
        Self::Row(error)
    }
}

impl From<crate::input::InputError> for Fault {
    fn from(error: crate::input::InputError) -> Self {
        Self::Field(error.into())
    }
}

fn entry(
    root: &Path,
    columns: &Columns,
    row: &CsvRow<'_>,
    labels: Labels,
    seen: &mut BTreeMap<String, (usize, SequenceId)>,
) -> Result<SequenceEntry, Fault> {
    let given = |column: Option<usize>| column.filter(|&k| !row.get(k).is_empty());
    // Names and labels are composed: an accent that follows its letter counts as part of it.
    let id = SequenceId { subject: composed(row.get(columns.subject)), sequence: composed(row.get(columns.sequence)) };
    check_file_name("subject", &id.subject)?;
    check_file_name("sequence", &id.sequence)?;
    let key = name_key(&id.to_string());
    if let Some((first_line, first)) = seen.get(&key) {
        let first_line = *first_line;
        let problem = if *first == id {
            RowError::Duplicate { id, first_line }
        } else if first.to_string() == id.to_string() {
            RowError::SameFileName { id, first_line }
        } else {
            RowError::SimilarFileName { id, other: Box::new(first.clone()) }
        };
        return Err(problem.into());
    }
    seen.insert(key, (row.line(), id.clone()));
    let said = columns.emotion.map_or("", |k| row.get(k));
    let emotion = composed(said).to_lowercase();
    let is_open = is_missing_word(&emotion) || emotion == super::UNKNOWN_EMOTION;
    let emotion = if labels == Labels::IfAny && (is_open || emotion.is_empty()) {
        String::new()
    } else {
        if is_missing_word(&emotion) && emotion != super::UNKNOWN_EMOTION {
            return Err(RowError::EmotionMissing { value: excerpt(said) }.into());
        }
        check_file_name("emotion", &emotion)?;
        if is_open {
            return Err(RowError::EmotionOpen.into());
        }
        emotion
    };
    let number = |column| given(column).map(|k| row.whole_number(k)).transpose();
    let (first_frame, last_frame) = (number(columns.first_frame)?, number(columns.last_frame)?);
    if let Some((first, last)) = first_frame.zip(last_frame).filter(|(first, last)| first == last) {
        return Err(RowError::FrameRange { first, last }.into());
    }
    let fps = match given(columns.fps) {
        Some(k) => {
            let fps = row.number(k).ok().filter(|fps| FRAME_RATES.contains(fps));
            Some(fps.ok_or_else(|| row.field_error(k, "a number of frames per second from 0.1 to 1000"))?)
        }
        None => None,
    };
    let folder = place_of(root, &format!("{}/{}", id.subject, id.sequence));
    let pictures = given(columns.frames).and_then(|k| listed_pictures(root, row.get(k))).unwrap_or_default();
    let frames_path = match (pictures.first(), given(columns.frames)) {
        (Some(first), _) => first.clone(),
        (None, Some(k)) => place_of(root, row.get(k)),
        (None, None) => folder.clone(),
    };
    let landmarks_paths = given(columns.landmarks).map_or_else(Vec::new, |k| {
        let beside =
            if is_video(&frames_path) || !pictures.is_empty() { frames_path.parent().unwrap_or(root) } else { &frames_path };
        vec![place_of(beside, row.get(k)), place_of(root, row.get(k))]
    });
    Ok(SequenceEntry {
        id,
        emotion,
        frames_path,
        pictures,
        first_frame,
        last_frame,
        correspondences_path: given(columns.correspondences).map(|k| place_of(root, row.get(k))),
        default_correspondences_path: folder.join(CORRESPONDENCES_NAME),
        landmarks_paths,
        fps,
        metadata: columns.metadata.iter().map(|(k, name)| (name.clone(), one_line(&composed(row.get(*k))))).collect(),
    })
}

/// A field with its line breaks replaced by blanks.
fn one_line(field: &str) -> String {
    field.split(['\n', '\r']).filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ")
}
