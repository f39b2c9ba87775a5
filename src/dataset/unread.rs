//! Detects pictures and videos in unsupported formats, and which of them would be frames.

use std::{
    collections::BTreeSet,
    io,
    path::{Path, PathBuf},
};

use super::{
    FrameFile, FrameSource,
    frames::{has_digits, has_extension, has_picture_name, visible},
    numbering::{Numbering, numbered, pattern, value_of},
};
use crate::output::count;

/// Extensions of unsupported picture formats.
const UNREAD_PICTURES: [&str; 18] = [
    "gif", "heic", "heif", "avif", "jp2", "j2k", "jxl", "jfif", "jpe", "pbm", "tga", "exr", "dng", "cr2", "cr3", "nef", "arw",
    "raw",
];

/// Extensions of unsupported video formats.
const UNREAD_VIDEOS: [&str; 12] = ["wmv", "mts", "m2ts", "ts", "flv", "f4v", "3gp", "3g2", "ogv", "mxf", "vob", "asf"];

/// Whether a path has the extension of an unsupported picture or video format.
pub(super) fn is_unread(path: &Path) -> bool {
    is_unread_picture(path) || has_extension(path, &UNREAD_VIDEOS)
}

fn is_unread_picture(path: &Path) -> bool {
    has_extension(path, &UNREAD_PICTURES)
}

/// Pictures of a folder in unsupported formats, by name, except those that also exist in a supported one.
pub(super) fn unread_pictures(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let paths: Vec<PathBuf> = visible(folder)?.iter().map(std::fs::DirEntry::path).collect();
    let stem = |path: &Path| path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
    let read: BTreeSet<String> = paths.iter().filter(|path| has_picture_name(path)).map(|path| stem(path)).collect();
    Ok(paths.into_iter().filter(|path| is_unread_picture(path) && !read.contains(&stem(path)) && path.is_file()).collect())
}

/// The `unread` pictures that would be frames from `first` to `last`, in order: their names have the form of the supported frames `read`,
/// and their numbers lie in the range without being taken. Without `first` or `last`, that end is open.
pub(super) fn unread_frames(read: &[FrameFile], unread: Vec<PathBuf>, first: Option<u32>, last: Option<u32>) -> Vec<PathBuf> {
    let patterns: BTreeSet<_> = read.iter().map(|frame| pattern(&frame.path)).collect();
    let unread: Vec<PathBuf> = unread.into_iter().filter(|path| has_digits(path) && patterns.contains(&pattern(path))).collect();
    if unread.is_empty() {
        return unread;
    }
    let all: Vec<&Path> = read.iter().map(|frame| frame.path.as_path()).chain(unread.iter().map(PathBuf::as_path)).collect();
    let digits = match numbered(&all) {
        Numbering::Named(digits) => digits,
        Numbering::Counted(places) => places.iter().map(u32::to_string).collect(),
    };
    let values: Vec<_> = digits.iter().map(|digits| value_of(digits)).collect();
    let (of_read, of_unread) = values.split_at(read.len());
    let asked = |number: Option<u32>| {
        let number = number?;
        let digits = read.iter().position(|frame| frame.number == number).and_then(|k| digits.get(k).cloned());
        Some(digits.unwrap_or_else(|| number.to_string()))
    };
    let (first, last) = (asked(first), asked(last));
    let from = first.as_deref().map(value_of).or_else(|| values.iter().min().copied());
    let to = last.as_deref().map(value_of).or_else(|| values.iter().max().copied());
    let (low, high) = if from <= to { (from, to) } else { (to, from) };
    let is_wanted = |value: &(usize, &str)| low <= Some(*value) && Some(*value) <= high && !of_read.contains(value);
    let mut found: Vec<_> = of_unread.iter().zip(&unread).filter(|(value, _)| is_wanted(value)).collect();
    found.sort();
    found.into_iter().map(|(_, path)| path.clone()).collect()
}

/// Note about unsupported pictures in the folder of the frames with names of another form. Beside listed pictures there is anything.
pub fn unread_beside(frames: &FrameSource) -> Option<String> {
    if frames.is_numbered_apart() {
        return None;
    }
    let FrameSource::Images(files) = frames else { return None };
    let folder = files.first()?.path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let patterns: BTreeSet<_> = files.iter().map(|frame| pattern(&frame.path)).collect();
    let mut beside = unread_pictures(folder).ok()?;
    beside.retain(|path| !patterns.contains(&pattern(path)));
    let name = beside.first()?.file_name()?.to_string_lossy().into_owned();
    Some(match beside.len() {
        1 => format!("{name} has an unsupported format and is not used; if it is a frame, convert it"),
        n => format!(
            "{name} and {} beside the frames have unsupported formats and are not used; if they are frames, convert them",
            count(n - 1, "more picture", "more pictures")
        ),
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::{super::list_frames, *};

    fn listed(names: &[&str], first: Option<u32>, last: Option<u32>) -> Result<(usize, Option<String>), String> {
        let folder = tempfile::tempdir().unwrap();
        names.iter().for_each(|name| fs::write(folder.path().join(name), b"").unwrap());
        let frames = list_frames(folder.path(), first, last).map_err(|e| e.to_string())?;
        Ok((frames.files().len(), unread_beside(&frames)))
    }

    #[test]
    fn a_frame_of_a_format_that_is_not_read_is_refused_wherever_it_is_asked_for() {
        let apex = ["f_1.png", "f_2.png", "f_3.png", "f_4.GIF"];
        let said = listed(&apex, None, None).unwrap_err();
        assert!(
            said.contains("f_4.GIF: ") && said.contains("not supported") && said.contains("convert") && said.contains("move"),
            "{said}"
        );
        assert!(
            listed(&apex, Some(2), Some(4)).unwrap_err().contains("f_4.GIF"),
            "the unreadable file is named, not only reported missing"
        );
        assert_eq!(listed(&apex, None, Some(3)), Ok((3, None)), "after the requested frames");
        assert_eq!(listed(&apex, Some(3), Some(1)), Ok((3, None)));
        assert!(listed(&apex, Some(2), None).is_err());
        let within = ["f_1.png", "f_2.heic", "f_3.jp2", "f_4.png", "f_5.png"];
        assert!(listed(&within, None, None).unwrap_err().contains("f_2.heic and 1 more: "));
        assert_eq!(listed(&within, Some(4), None), Ok((2, None)));
        assert!(listed(&["IMG_1.HEIC", "IMG_2.jpg", "IMG_3.jpg"], None, None).is_err(), "the neutral frame");
        assert!(listed(&["1.heic", "2.heic"], None, None).unwrap_err().contains("1.heic and 1 more: "));
        let times = ["1_12-30-59.png", "1_12-31-00.png", "1_12-31-30.heic", "1_12-32-00.png"];
        assert!(listed(&times, None, None).unwrap_err().contains("1_12-31-30.heic"), "frames that are counted");
        assert!(listed(&times, Some(2), Some(3)).unwrap_err().contains("1_12-31-30.heic"), "3 is the third that is read");
        assert_eq!(listed(&times, Some(1), Some(2)), Ok((2, None)));
    }

    #[test]
    fn other_pictures_are_passed_over_and_said() {
        let read = ["f_1.png", "f_2.png"];
        let with = |more: &[&str]| listed(&[&read[..], more].concat(), None, None).unwrap();
        assert_eq!(with(&["f_1.heic", "F_2.HEIC"]), (2, None), "the same frames, converted");
        assert_eq!(with(&["a.txt", "b.mp4"]), (2, None));
        let said = with(&["preview.gif"]).1.unwrap();
        assert!(said.starts_with("preview.gif has an unsupported format"), "{said}");
        assert!(with(&["S1_05.gif", "x.jp2"]).1.unwrap().starts_with("S1_05.gif and 1 more picture beside"));
    }
}
