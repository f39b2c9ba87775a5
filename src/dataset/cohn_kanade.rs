//! Reads Cohn-Kanade and CK+ as distributed: images, emotion labels and landmarks in three folders with the same sub-folders (P. Lucey et
//! al.: *The extended Cohn-Kanade dataset (CK+)*, CVPR workshops 2010).
//!
//! ```text
//! cohn-kanade-images/S005/001/S005_001_00000001.png
//! Emotion/S005/001/S005_001_00000011_emotion.txt        a code, such as `   3.0000000e+00`
//! Landmarks/S005/001/S005_001_00000001_landmarks.txt    68 lines `x y`
//! ```
//!
//! CK+ labels only part of its sequences. Those without a label are skipped rather than failed, unless labels are optional.

use std::{
    collections::{BTreeMap, btree_map::Entry},
    fs,
    path::{Path, PathBuf},
};

use super::{
    Dataset, DatasetError, FailedEntry, Labels, RowError, SequenceEntry, SkippedEntry,
    error::{check_file_name, name_key},
    frames::{has_frames, sub_folders, visible},
    manifest::CORRESPONDENCES_NAME,
};
use crate::{text::excerpt, units::SequenceId};

/// Emotions by their code in CK+.
const EMOTION_CODES: [&str; 8] = ["neutral", "anger", "contempt", "disgust", "fear", "happiness", "sadness", "surprise"];

/// CK+ code of an emotion; `None` for a label that CK+ does not have.
#[must_use]
pub fn emotion_code(emotion: &str) -> Option<u8> {
    (0..).zip(EMOTION_CODES).find(|(_, name)| *name == emotion).map(|(code, _)| code)
}

/// [`EMOTION_CODES`] as text for messages.
pub(super) const CODES_IN_WORDS: &str = "0 neutral, 1 anger, 2 contempt, 3 disgust, 4 fear, 5 happiness, 6 sadness, 7 surprise";

/// Names of the image folder, unless it is the root itself.
const IMAGE_FOLDERS: [&str; 3] =
    ["cohn-kanade-images", "extended-cohn-kanade-images/cohn-kanade-images", "extended-cohn-kanade-images"];

/// Names of the label folder, by the name of the image folder.
const EMOTION_FOLDERS: [&str; 3] = ["Emotion", "Emotion_labels/Emotion", "Emotion_labels"];

/// Names of the landmark folder.
const LANDMARK_FOLDERS: [&str; 2] = ["Landmarks/Landmarks", "Landmarks"];

/// Names of the folder of action unit labels, which is not read.
const FACS_FOLDERS: [&str; 2] = ["FACS", "FACS_labels"];

/// The three folders of the layout.
struct Folders {
    images: PathBuf,
    /// `None` only if labels are optional.
    emotions: Option<PathBuf>,
    landmarks: Option<PathBuf>,
}

/// Opens a folder in this layout, its parent, or its image folder; `None` for another layout.
///
/// # Errors
/// [`DatasetError`] when images exist without the required labels, or a folder cannot be listed.
pub(super) fn open(root: &Path, labels: Labels) -> Result<Option<Dataset>, DatasetError> {
    let Some(folders) = find_folders(root, labels)? else { return Ok(None) };
    let images = &folders.images;
    let list = |folder: &Path| sub_folders(folder).map_err(|reason| DatasetError::Io { path: folder.to_owned(), reason });
    let mut dataset = Dataset { root: images.clone(), sequences: Vec::new(), failures: Vec::new(), skipped: Vec::new() };
    for subject in list(images)? {
        let folder = images.join(&subject);
        if folders.has_labels(&folder) {
            continue;
        }
        for sequence in list(&folder)? {
            let id = SequenceId { subject: subject.clone(), sequence };
            match entry(&folders, &id, labels) {
                Ok(Some(entry)) => dataset.sequences.push(entry),
                Ok(None) => dataset.skipped.push(SkippedEntry { id, reason: "no emotion label".to_owned() }),
                Err(error) => dataset.failures.push(FailedEntry { subject: id.subject, sequence: id.sequence, error }),
            }
        }
    }
    if dataset.sequences.is_empty() && dataset.failures.is_empty() && dataset.skipped.is_empty() {
        return Err(DatasetError::NothingFound { root: root.to_owned() });
    }
    dataset.sequences.sort_by(|a, b| a.id.cmp(&b.id));
    let mut seen: BTreeMap<String, SequenceId> = BTreeMap::new();
    for entry in std::mem::take(&mut dataset.sequences) {
        match seen.entry(name_key(&entry.id.to_string())) {
            Entry::Vacant(place) => {
                place.insert(entry.id.clone());
                dataset.sequences.push(entry);
            }
            Entry::Occupied(place) => {
                let SequenceId { subject, sequence } = entry.id.clone();
                let problem = RowError::SimilarFileName { id: entry.id, other: Box::new(place.get().clone()) };
                let error = DatasetError::FolderName { path: entry.frames_path, problem };
                dataset.failures.push(FailedEntry { subject, sequence, error });
            }
        }
    }
    dataset.skipped.sort_by(|a, b| a.id.cmp(&b.id));
    Ok(Some(dataset))
}

impl Folders {
    /// Whether a folder beside the subjects contains labels or landmarks.
    fn has_labels(&self, folder: &Path) -> bool {
        [&self.emotions, &self.landmarks].into_iter().flatten().any(|labels| labels.starts_with(folder))
            || FACS_FOLDERS.iter().any(|name| folder.ends_with(name))
    }
}

fn find_folders(root: &Path, labels: Labels) -> Result<Option<Folders>, DatasetError> {
    // The parent of `.` and of other paths without a name is known only after resolving them.
    let resolved = fs::canonicalize(root).unwrap_or_else(|_| root.to_owned());
    let bases: Vec<&Path> = [Some(root), resolved.parent()].into_iter().flatten().collect();
    let find = |names: &[&str]| {
        let mut candidates = bases.iter().flat_map(|base| names.iter().map(move |name| base.join(name)));
        candidates.find(|path| path.is_dir())
    };
    let named = IMAGE_FOLDERS.iter().map(|name| root.join(name)).find(|path| path.is_dir());
    let is_named = resolved.file_name().is_some_and(|name| IMAGE_FOLDERS.iter().any(|known| name == *known));
    let named = named.or_else(|| is_named.then(|| root.to_owned()));
    let landmarks = find(&LANDMARK_FOLDERS);
    let Some(emotions) = find(&EMOTION_FOLDERS) else {
        return match (named, labels) {
            (None, _) => Ok(None),
            (Some(images), Labels::IfAny) => Ok(Some(Folders { images, emotions: None, landmarks })),
            (Some(images), Labels::Needed) => Err(DatasetError::NoEmotionFolder { images }),
        };
    };
    let images = named.or_else(|| {
        let below = sub_folders(root).unwrap_or_default().into_iter().map(|name| root.join(name));
        std::iter::once(root.to_owned()).chain(below).find(|folder| has_images_of(folder, &emotions))
    });
    Ok(images.map(|images| Folders { images, emotions: Some(emotions), landmarks }))
}

/// Whether a folder contains images of a subject that has a label.
fn has_images_of(folder: &Path, emotions: &Path) -> bool {
    let subjects = sub_folders(folder).unwrap_or_default();
    let Some(subject) = subjects.iter().find(|subject| emotions.join(subject).is_dir()) else { return false };
    let folder = folder.join(subject);
    sub_folders(&folder).unwrap_or_default().iter().any(|sequence| has_frames(&folder.join(sequence)))
}

/// The entry of a sequence with its label; `None` if a required label is missing.
fn entry(folders: &Folders, id: &SequenceId, labels: Labels) -> Result<Option<SequenceEntry>, DatasetError> {
    let inside = Path::new(&id.subject).join(&id.sequence);
    let frames_path = folders.images.join(&inside);
    for (column, value) in [("subject", &id.subject), ("sequence", &id.sequence)] {
        check_file_name(column, value).map_err(|problem| DatasetError::FolderName { path: frames_path.clone(), problem })?;
    }
    let emotion = match folders.emotions.as_ref().map(|emotions| read_emotion(&emotions.join(&inside))).transpose()?.flatten() {
        None if labels == Labels::Needed => return Ok(None),
        emotion => emotion.unwrap_or_default(),
    };
    Ok(Some(SequenceEntry {
        id: id.clone(),
        emotion: emotion.to_owned(),
        default_correspondences_path: frames_path.join(CORRESPONDENCES_NAME),
        frames_path,
        pictures: Vec::new(),
        first_frame: None,
        last_frame: None,
        correspondences_path: None,
        landmarks_paths: folders.landmarks.iter().map(|folder| folder.join(&inside)).filter(|path| path.is_dir()).collect(),
        fps: None,
        metadata: BTreeMap::new(),
    }))
}

/// The label in a sequence's label folder; `None` without the folder or a file in it.
fn read_emotion(folder: &Path) -> Result<Option<&'static str>, DatasetError> {
    if !folder.is_dir() {
        return Ok(None);
    }
    let entries = visible(folder).map_err(|reason| DatasetError::Io { path: folder.to_owned(), reason })?;
    let files: Vec<PathBuf> =
        entries.iter().filter(|e| e.file_name().to_string_lossy().ends_with("_emotion.txt")).map(fs::DirEntry::path).collect();
    let path = match &files[..] {
        [] => return Ok(None),
        [path] => path,
        _ => return Err(DatasetError::SeveralEmotions { folder: folder.to_owned(), found: files.len() }),
    };
    let bytes = crate::input::read(path).map_err(|reason| DatasetError::Io { path: path.clone(), reason })?;
    let text = String::from_utf8_lossy(&bytes);
    // Only whole numbers, although written as `3.0000000e+00`.
    let code = text.trim().parse::<f64>().ok().filter(|code| code.fract() == 0.0 && *code >= 0.0);
    match code.and_then(|code| EMOTION_CODES.get(code as usize)) {
        Some(emotion) => Ok(Some(emotion)),
        None => Err(DatasetError::EmotionCode { path: path.clone(), found: excerpt(text.trim()) }),
    }
}
