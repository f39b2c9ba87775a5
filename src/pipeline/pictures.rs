//! Lists pictures for face detection: from files, folders and datasets.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use image::RgbImage;

use crate::{
    dataset::{
        Dataset, DatasetError, FrameSource, IMAGE_EXTENSIONS, MANIFEST_COLUMNS, MANIFEST_NAME, is_picture, may_publish, visible,
    },
    input::CsvFile,
    sequence::{Frame, Portrait, SequenceError, read_first_in_colour},
};

/// A picture for face detection.
#[derive(Clone, Debug)]
pub struct PictureSource {
    /// Name of the picture in the table of points.
    pub name: String,
    /// Whether it may be shown to others. A dataset's column `publish` can forbid it.
    pub may_publish: bool,
    frames: Frames,
}

/// A decoded picture for face detection.
#[derive(Clone, Debug)]
pub struct ReadPicture {
    /// The grey picture in which faces are read: a file on a white background, a sequence as it is tracked.
    pub frame: Frame,
    /// The picture in colour; `None` for the first frame of a video.
    pub colour: Option<RgbImage>,
    /// Message to the user about the picture.
    pub remark: Option<String>,
}

#[derive(Clone, Debug)]
enum Frames {
    File(PathBuf),
    First(FrameSource),
}

/// Why pictures cannot be listed.
#[derive(Debug, thiserror::Error)]
pub enum BatchError {
    /// Neither a file nor a folder.
    #[error("{}: there is no such picture, folder or dataset", path.display())]
    NotFound {
        /// What was named.
        path: PathBuf,
    },
    /// A folder that cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The folder.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// There are no pictures.
    #[error("{}: this folder has no pictures (extensions: {}) and no {MANIFEST_NAME}", path.display(), IMAGE_EXTENSIONS.join(" "))]
    Empty {
        /// The folder.
        path: PathBuf,
    },
    /// The dataset cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
}

impl PictureSource {
    /// Decodes the picture.
    ///
    /// # Errors
    /// [`SequenceError`] when it cannot be read.
    pub fn read(&self) -> Result<ReadPicture, SequenceError> {
        match &self.frames {
            Frames::File(path) => {
                let portrait = Portrait::read(path)?;
                let remark = portrait.remark();
                Ok(ReadPicture { frame: Frame::new(0, portrait.grey), colour: Some(portrait.picture), remark })
            }
            Frames::First(source) => {
                let (frame, colour) = read_first_in_colour(source)?;
                Ok(ReadPicture { frame, colour, remark: None })
            }
        }
    }
}

/// Lists the pictures of a path, and the sequences without frames with the reason.
///
/// The path is one file; a dataset (a manifest, a folder with one, or the Cohn-Kanade layout), which gives its neutral frames; or a folder,
/// which gives all pictures in it and its subfolders, sorted by name.
///
/// # Errors
/// [`BatchError`].
pub fn pictures_of(path: &Path) -> Result<(Vec<PictureSource>, Vec<String>), BatchError> {
    let is_manifest = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv"));
    if path.is_file() && !is_manifest {
        return Ok((vec![file(path)], Vec::new()));
    }
    if !path.exists() {
        return Err(BatchError::NotFound { path: path.to_owned() });
    }
    match Dataset::open(path) {
        Ok(dataset) => return Ok(neutral_frames(&dataset)),
        Err(error) if is_manifest || is_dataset(path) => return Err(error.into()),
        Err(_) => {}
    }
    let mut files = Vec::new();
    gather(path, &mut files)?;
    if files.is_empty() {
        return Err(BatchError::Empty { path: path.to_owned() });
    }
    files.sort_by(|a, b| natord::compare(&a.to_string_lossy(), &b.to_string_lossy()));
    Ok((files.iter().map(|f| file(f)).collect(), Vec::new()))
}

/// Whether the folder's manifest, if any, has grimace's format. Other programs use the same file name.
fn is_dataset(folder: &Path) -> bool {
    let path = folder.join(MANIFEST_NAME);
    let csv = path.exists().then(|| CsvFile::open(&path)?.or_semicolons(&MANIFEST_COLUMNS));
    csv.is_some_and(|csv| csv.is_ok_and(|csv| MANIFEST_COLUMNS.iter().any(|name| csv.column(name).is_some())))
}

fn file(path: &Path) -> PictureSource {
    PictureSource { name: path.display().to_string(), may_publish: true, frames: Frames::File(path.to_owned()) }
}

fn neutral_frames(dataset: &Dataset) -> (Vec<PictureSource>, Vec<String>) {
    let mut failures: Vec<String> = dataset.failures.iter().map(|f| f.error.to_string()).collect();
    let mut pictures: Vec<PictureSource> = Vec::new();
    // Listed neutral pictures by name: several sequences of a person may share one.
    let mut shared: BTreeMap<String, usize> = BTreeMap::new();
    for entry in &dataset.sequences {
        match entry.frames() {
            Ok(source) => {
                let name = source.files().first().map_or(&*entry.frames_path, |f| *f).display().to_string();
                if !entry.pictures.is_empty() {
                    if let Some(known) = shared.get(&name).and_then(|&place| pictures.get_mut(place)) {
                        known.may_publish &= may_publish(&entry.metadata);
                        continue;
                    }
                    shared.insert(name.clone(), pictures.len());
                }
                pictures.push(PictureSource { name, may_publish: may_publish(&entry.metadata), frames: Frames::First(source) });
            }
            Err(error) => failures.push(format!("{}: {error}", entry.id)),
        }
    }
    // Sequences of one video are distinguished by their neutral frames.
    let mut times: BTreeMap<String, usize> = BTreeMap::new();
    pictures.iter().for_each(|picture| *times.entry(picture.name.clone()).or_default() += 1);
    for picture in &mut pictures {
        if let (Some(2..), Frames::First(source @ FrameSource::Video { .. })) = (times.get(&picture.name), &picture.frames) {
            picture.name = format!("{}#{}", picture.name, source.neutral_number());
        }
    }
    (pictures, failures)
}

fn gather(folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), BatchError> {
    let failed = |source| BatchError::Io { path: folder.to_owned(), source };
    for item in visible(folder).map_err(failed)? {
        let kind = item.file_type().map_err(failed)?;
        let path = item.path();
        if kind.is_dir() {
            gather(&path, files)?;
        } else if is_picture(&path) {
            files.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_of_another_kind_is_no_dataset() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.png"), "").unwrap();
        std::fs::write(folder.path().join(MANIFEST_NAME), "file,licence\na.png,CC0\n").unwrap();
        assert_eq!(pictures_of(folder.path()).unwrap().0.len(), 1);
        // A manifest that lacks a column is reported as damaged.
        std::fs::write(folder.path().join(MANIFEST_NAME), "subject,emotion\nS001,anger\n").unwrap();
        assert!(pictures_of(folder.path()).is_err());
    }

    #[test]
    fn a_folder_gives_its_pictures_in_natural_order() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("b")).unwrap();
        for name in ["p10.png", "p9.PNG", "b/q.jpg", "notes.txt", "._p9.PNG"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let (pictures, failures) = pictures_of(folder.path()).unwrap();
        let names: Vec<_> = pictures.iter().map(|p| p.name.rsplit('/').next().unwrap()).collect();
        assert_eq!((names, failures.len()), (vec!["q.jpg", "p9.PNG", "p10.png"], 0));
        assert!(pictures[0].read().is_err());
    }

    #[test]
    fn sequences_of_one_video_have_names_of_their_own() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.avi", "b.avi"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let rows = "S1,1,joy,a.avi,7\nS1,2,joy,a.avi,90\nS2,1,joy,b.avi,3\n";
        std::fs::write(folder.path().join(MANIFEST_NAME), format!("subject,sequence,emotion,frames,first_frame\n{rows}"))
            .unwrap();
        let (pictures, _) = pictures_of(folder.path()).unwrap();
        let names: Vec<_> = pictures.iter().map(|p| p.name.rsplit('/').next().unwrap()).collect();
        assert_eq!(names, ["a.avi#7", "a.avi#90", "b.avi"]);
    }

    #[test]
    fn a_neutral_picture_of_several_sequences_is_one_picture() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["n.jpg", "joy.jpg", "fear.jpg"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let rows = "S1,1,joy,n.jpg;joy.jpg,yes\nS1,2,fear,n.jpg;fear.jpg,no\n";
        std::fs::write(folder.path().join(MANIFEST_NAME), format!("subject,sequence,emotion,frames,publish\n{rows}")).unwrap();
        let (pictures, failures) = pictures_of(folder.path()).unwrap();
        assert_eq!((pictures.len(), pictures[0].may_publish, failures.len()), (1, false, 0));
        assert!(pictures[0].name.ends_with("n.jpg"));
    }

    #[test]
    fn missing_inputs_are_reported() {
        assert!(
            pictures_of(Path::new("nowhere.jpg")).unwrap_err().to_string().starts_with("nowhere.jpg: there is no such picture")
        );
        let folder = tempfile::tempdir().unwrap();
        assert!(pictures_of(folder.path()).unwrap_err().to_string().contains("this folder has no pictures"));
    }
}
