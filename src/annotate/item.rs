//! One sequence opened for marking: its manifest entries, and the version that a page has read.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use super::{RequestError, frames::FrameList};
use crate::{
    dataset::{FrameFile, FrameSource, SequenceEntry, is_picture},
    units::SequenceId,
};

/// Confidence of a sequence that `segment` proposed.
pub fn confidence(entry: &SequenceEntry) -> Option<f64> {
    entry.metadata.get("confidence")?.trim().parse().ok().filter(|c| (0.0..=1.0).contains(c))
}

/// A sequence opened for marking.
pub struct Item {
    pub entry: SequenceEntry,
    /// Whether the manifest lists it, as far as is known.
    pub listed: bool,
    pub marks: usize,
    pub frames: Option<FrameList>,
}

/// One picture as a sequence of one frame, with marks in a `.csv` of the same name.
pub fn picture_entry(path: &Path) -> SequenceEntry {
    let name = path.file_stem().unwrap_or_default().to_string_lossy().replace('_', "-");
    SequenceEntry {
        id: SequenceId { subject: name, sequence: "picture".to_owned() },
        emotion: String::new(),
        frames_path: path.to_owned(),
        pictures: Vec::new(),
        first_frame: None,
        last_frame: None,
        correspondences_path: None,
        default_correspondences_path: path.with_extension("csv"),
        landmarks_paths: Vec::new(),
        fps: None,
        metadata: BTreeMap::new(),
    }
}

pub fn frames_of(entry: &SequenceEntry) -> Result<FrameSource, RequestError> {
    match single_picture(entry) {
        Some(source) => Ok(source),
        None => entry.frames().map_err(RequestError::refused),
    }
}

/// All frames of a sequence, also those before its neutral and after its apex frame.
pub fn all_frames_of(entry: &SequenceEntry) -> Result<FrameSource, RequestError> {
    match single_picture(entry) {
        Some(source) => Ok(source),
        None => entry.readable_frames().map_err(RequestError::refused),
    }
}

/// The picture that was opened without a dataset.
fn single_picture(entry: &SequenceEntry) -> Option<FrameSource> {
    let is_single = entry.pictures.is_empty() && is_picture(&entry.frames_path);
    is_single.then(|| FrameSource::Images(vec![FrameFile { number: 1, path: entry.frames_path.clone() }]))
}

pub fn no_sequence(id: &str) -> RequestError {
    RequestError::NotFound(format!("there is no sequence {id}"))
}

pub fn find<'a>(items: &'a mut [Item], id: &str) -> Result<&'a mut Item, RequestError> {
    items.iter_mut().find(|item| item.entry.id.to_string() == id).ok_or_else(|| no_sequence(id))
}

/// Numbers of the neutral and the apex frame: those in the manifest, else the first and the last. Also returns a message, shown before
/// marking, if the manifest names a frame that does not exist.
pub fn cut(entry: &SequenceEntry, frames: &FrameList) -> Result<(u32, u32, Option<String>), RequestError> {
    let none = || RequestError::Refused("the sequence has no frames".to_owned());
    let (first, last) = (*frames.numbers.first().ok_or_else(none)?, *frames.numbers.last().ok_or_else(none)?);
    let is_there = |n: &u32| frames.numbers.binary_search(n).is_ok();
    let named = [
        ("first_frame", entry.first_frame, "press F to choose the neutral frame"),
        ("last_frame", entry.last_frame, "press L to choose the apex frame"),
    ];
    let missing = named.iter().find_map(|(column, named, key)| Some((column, named.filter(|n| !is_there(n))?, key)));
    let problem = missing.map(|(column, number, key)| {
        format!("{column} is {number} in the manifest, but the frames are {first} to {last}: {key}; until then nothing is saved")
    });
    let (neutral, apex) = (entry.first_frame.filter(is_there), entry.last_frame.filter(is_there));
    Ok((neutral.unwrap_or(first), apex.unwrap_or(last), problem))
}

pub fn manifest_blake3(path: &Path) -> Option<blake3::Hash> {
    crate::input::read(path).ok().map(|bytes| blake3::hash(&bytes))
}

/// Version of a sequence in 16 digits: a hash of its marks file and of the files and frames in its manifest entry.
pub fn version(entry: &SequenceEntry) -> String {
    let mut hasher = blake3::Hasher::new();
    match crate::input::read(entry.marks_path()) {
        Ok(bytes) => hasher.update(&[1]).update(&bytes),
        Err(_) => hasher.update(&[0]),
    };
    let SequenceEntry { frames_path, pictures, first_frame, last_frame, landmarks_paths, .. } = entry;
    // The path of the marks counts, and not whether the manifest names it: the first save enters the default path there.
    let listed = pictures.iter().skip(1).chain(landmarks_paths).map(PathBuf::as_path);
    for path in [entry.marks_path(), frames_path].into_iter().chain(listed) {
        hasher.update(path.as_os_str().as_encoded_bytes()).update(&[0]);
    }
    hasher.update(format!("{first_frame:?} {last_frame:?}").as_bytes());
    hasher.finalize().to_hex()[..16].to_owned()
}
