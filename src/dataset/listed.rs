//! Sequences whose pictures are listed one by one: `neutral/L001.jpg;smiling/L001.jpg`.

use std::{
    collections::BTreeMap,
    ffi::OsStr,
    path::{Component, Path, PathBuf},
};

use super::{
    FrameFile, FrameSource, FramesError,
    frames::{FIRST_VIDEO_FRAME, has_digits, has_picture_name, images},
    numbering::{Numbering, numbered},
    spelling::place_of,
};

/// Separator of the pictures in a list.
pub(crate) const PICTURE_SEPARATOR: char = ';';

/// The pictures that `text` lists, relative to `root`, without blanks around the names; `None` for the name of one folder or file, which may
/// contain the separator if it exists.
pub(super) fn listed_pictures(root: &Path, text: &str) -> Option<Vec<PathBuf>> {
    if !text.contains(PICTURE_SEPARATOR) || place_of(root, text).exists() {
        return None;
    }
    let names = text.split(PICTURE_SEPARATOR).map(str::trim).filter(|name| !name.is_empty());
    Some(names.map(|name| place_of(root, name)).collect())
}

/// The pictures that a path lists, relative to the current folder.
pub(super) fn pictures_in(path: &Path) -> Option<Vec<PathBuf>> {
    listed_pictures(Path::new(""), path.to_str()?)
}

/// The frames of a list of pictures from `first` to `last`, numbered from 1 in the order of the list.
///
/// # Errors
/// [`FramesError`] for fewer than two pictures, a file that does not exist or is no picture, a picture listed twice, or a `first` or `last`
/// that is not in the list.
pub(super) fn frames_of_list(pictures: &[PathBuf], first: Option<u32>, last: Option<u32>) -> Result<FrameSource, FramesError> {
    let start = pictures.first().map_or(Path::new(""), PathBuf::as_path);
    let mut seen: BTreeMap<PathBuf, u32> = BTreeMap::new();
    let mut files = Vec::with_capacity(pictures.len());
    for (path, number) in pictures.iter().zip(FIRST_VIDEO_FRAME..) {
        let path = path.clone();
        if !path.exists() {
            return Err(FramesError::PictureNotFound { path });
        }
        if !path.is_file() || !has_picture_name(&path) {
            return Err(FramesError::NotAPicture { path });
        }
        // One file may be named in several ways.
        let resolved = path.canonicalize().unwrap_or_else(|_| path.clone());
        if let Some(earlier) = seen.insert(resolved, number) {
            return Err(FramesError::ListedTwice { path, first: earlier, second: number });
        }
        files.push(FrameFile { number, path });
    }
    if files.len() < 2 {
        return Err(FramesError::OnePicture { path: start.to_owned() });
    }
    let found = files.len() as u32;
    for (column, number) in [("first_frame", first), ("last_frame", last)] {
        if let Some(number) = number.filter(|n| !(FIRST_VIDEO_FRAME..=found).contains(n)) {
            return Err(FramesError::NotListed { path: start.to_owned(), column, number, found });
        }
    }
    let (from, to) = (first.unwrap_or(FIRST_VIDEO_FRAME), last.unwrap_or(found));
    files.retain(|file| (from.min(to)..=from.max(to)).contains(&file.number));
    if from > to {
        files.reverse();
    }
    images(start, files)
}

impl FrameSource {
    /// Names of the files, in order: names in their folder, or paths from the folder that contains all of them if they are in several.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        let name = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        let files = self.files();
        if !are_in_several_folders(&files) {
            return files.into_iter().map(name).collect();
        }
        let parts: Vec<Vec<Component<'_>>> = files.iter().map(|path| path.components().collect()).collect();
        let shared = parts.iter().skip(1).fold(parts[0].len() - 1, |shared, other| {
            parts[0].iter().zip(other).take(shared).take_while(|(a, b)| a == b).count()
        });
        let joined = |parts: &Vec<Component<'_>>| {
            let names: Vec<_> = parts.iter().skip(shared).map(|part| OsStr::to_string_lossy(part.as_os_str())).collect();
            names.join("/")
        };
        parts.iter().map(joined).collect()
    }

    /// Whether the numbers of the frames do not follow from the names of their files: they were listed one by one.
    pub(crate) fn is_numbered_apart(&self) -> bool {
        let Self::Images(files) = self else { return false };
        let paths: Vec<&Path> = files.iter().map(|file| file.path.as_path()).collect();
        let are_counted = files.iter().map(|file| file.number).min() == Some(FIRST_VIDEO_FRAME);
        if are_in_several_folders(&paths) || !paths.iter().all(|path| has_digits(path)) {
            return true;
        }
        match numbered(&paths) {
            Numbering::Counted(_) => false,
            Numbering::Named(digits) => {
                are_counted && files.iter().zip(digits).any(|(file, digits)| digits.parse() != Ok(file.number))
            }
        }
    }
}

fn are_in_several_folders(files: &[&Path]) -> bool {
    files.windows(2).any(|pair| pair[0].parent() != pair[1].parent())
}

#[cfg(test)]
mod tests {
    use super::{
        super::{folder_with as folder, list_frames},
        *,
    };

    fn listed(folder: &tempfile::TempDir, text: &str, first: Option<u32>, last: Option<u32>) -> Result<FrameSource, String> {
        let pictures = listed_pictures(folder.path(), text).expect("a list");
        frames_of_list(&pictures, first, last).map_err(|error| error.to_string())
    }

    #[test]
    fn pictures_of_a_list_are_numbered_in_its_order() {
        let folder = folder(&["neutral/L001.jpg", "smiling/L001.jpg", "L001_a.png", "L001_b.png", "L001_3.png"]);
        let numbered = |text: &str, first, last| {
            let FrameSource::Images(files) = listed(&folder, text, first, last).unwrap() else { panic!("pictures") };
            files.iter().map(|file| file.number).collect::<Vec<_>>()
        };
        let pair = "smiling/L001.jpg ; ;\tneutral/L001.jpg;";
        assert_eq!(numbered(pair, None, None), [1, 2]);
        assert_eq!(numbered(pair, Some(2), Some(1)), [2, 1]);
        assert_eq!(numbered("L001_b.png;L001_3.png;L001_a.png", Some(2), None), [2, 3]);
        let names = |text: &str| listed(&folder, text, None, None).unwrap().names();
        assert_eq!(names(pair), ["smiling/L001.jpg", "neutral/L001.jpg"]);
        assert_eq!(names("L001_a.png;L001_b.png"), ["L001_a.png", "L001_b.png"]);
        assert_eq!(names("L001_a.png;neutral/L001.jpg"), ["L001_a.png", "neutral/L001.jpg"]);
        assert!(listed(&folder, pair, None, None).unwrap().is_numbered_apart());
    }

    #[test]
    fn lists_that_are_no_sequence_name_the_file() {
        let folder = folder(&["a.jpg", "b.jpg", "c.mp4", "d.heic", "e/1.png"]);
        let said = |text: &str, first, last| listed(&folder, text, first, last).unwrap_err();
        assert!(said("a.jpg;x.jpg", None, None).contains("x.jpg: there is no such picture"));
        assert!(said("a.jpg;c.mp4", None, None).contains("c.mp4: is not a picture"));
        assert!(said("a.jpg;d.heic", None, None).contains("d.heic: is not a picture"));
        assert!(said("a.jpg;e", None, None).contains("e: is not a picture"));
        assert!(said("a.jpg;", None, None).contains("a.jpg: one picture alone"));
        assert!(said("a.jpg;b.jpg;./a.jpg", None, None).contains("a.jpg: is in the list twice, as picture 1 and 3"));
        let range = said("a.jpg;b.jpg", None, Some(3));
        assert!(range.contains("a.jpg: last_frame is 3, but the list has 2 pictures, numbered from 1"), "{range}");
    }

    #[test]
    fn a_folder_with_the_separator_in_its_name_is_a_folder() {
        let folder = folder(&["a;b/1.png", "a;b/2.png"]);
        assert_eq!(listed_pictures(folder.path(), "a;b"), None);
        let source = list_frames(&folder.path().join("a;b"), None, None).unwrap();
        assert_eq!((source.names(), source.is_numbered_apart()), (vec!["1.png".to_owned(), "2.png".to_owned()], false));
        let path = folder.path().join("a;b/1.png").display().to_string();
        assert!(list_frames(path.as_ref(), None, None).unwrap_err().to_string().contains("1.png: one picture alone"));
    }
}
