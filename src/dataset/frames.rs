//! Lists the frames of a sequence: a folder of images sorted by number, or a video file.

use std::{
    ffi::OsStr,
    fs, io,
    path::{Path, PathBuf},
};

use super::{
    listed::{frames_of_list, pictures_in},
    numbering::{Numbering, numbered},
    unread::{unread_frames, unread_pictures},
};

/// Extensions of image files, in any case: png, jpg, jpeg, tif, tiff, bmp, pgm, ppm, webp.
pub const IMAGE_EXTENSIONS: [&str; 9] = ["png", "jpg", "jpeg", "tif", "tiff", "bmp", "pgm", "ppm", "webp"];

/// Extensions of video files, in any case.
pub const VIDEO_EXTENSIONS: [&str; 8] = ["mp4", "avi", "mpg", "mpeg", "mov", "mkv", "webm", "m4v"];

/// Number of the first frame of a video file, as in programs that split videos into images.
pub const FIRST_VIDEO_FRAME: u32 = 1;

/// Fewest frames of a sequence.
const MINIMUM_FRAMES: usize = 2;

/// An image file and its frame number.
///
/// ```
/// use grimace::dataset::{FrameFile, FrameSource, list_frames};
///
/// let FrameSource::Images(files) = list_frames("fixtures/simulated/S001/005".as_ref(), None, None)? else {
///     panic!("a folder of images");
/// };
/// let FrameFile { number, path } = &files[9];
/// assert!(*number == 10 && path.ends_with("S001_005_00000010.jpg"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameFile {
    /// Its number: from the file name in lists made by [`list_frames`]; in other lists any ascending or descending numbers.
    pub number: u32,
    /// The file.
    pub path: PathBuf,
}

/// Source of the frames of a sequence, ordered from neutral to apex, whichever was recorded first. [`list_frames`] creates it from a folder,
/// a video or a list of pictures. A custom list of files is read in its order.
///
/// ```
/// use grimace::dataset::{FrameSource, list_frames};
///
/// let frames = list_frames("fixtures/simulated/S001/005".as_ref(), Some(3), Some(7))?;
/// assert_eq!((frames.neutral_number(), frames.files().len()), (3, 5));
/// assert!(matches!(frames, FrameSource::Images(_)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FrameSource {
    /// At least two image files by ascending number, or by descending number if the apex was recorded before the neutral frame. Numbers may
    /// have gaps.
    Images(Vec<FrameFile>),
    /// A video file. Decoding determines whether it has the frames.
    Video {
        /// The file.
        path: PathBuf,
        /// Number of the neutral frame, counted from 1; the first of the file if `None`.
        first: Option<u32>,
        /// Number of the apex frame; the last of the file if `None`.
        last: Option<u32>,
    },
}

fn leading_zeros(near: &Path) -> String {
    format!("; {} exists: spreadsheets drop leading zeros, so format the column as text", near.display())
}

/// Hint for a path that was written on another system.
fn backslashes(path: &Path) -> &'static str {
    let is_of_windows = !cfg!(windows) && path.to_string_lossy().contains('\\');
    if is_of_windows { "; this system separates folders with / and has no drive letters" } else { "" }
}

impl FrameSource {
    /// Number of the neutral frame.
    #[must_use]
    pub fn neutral_number(&self) -> u32 {
        match self {
            Self::Images(frames) => frames.first().map_or(FIRST_VIDEO_FRAME, |frame| frame.number),
            Self::Video { first, .. } => first.unwrap_or(FIRST_VIDEO_FRAME),
        }
    }

    /// The files that contain the frames, in order.
    #[must_use]
    pub fn files(&self) -> Vec<&Path> {
        match self {
            Self::Images(files) => files.iter().map(|f| f.path.as_path()).collect(),
            Self::Video { path, .. } => vec![path],
        }
    }
}

/// Why the frames of a sequence cannot be listed.
///
/// ```
/// use grimace::dataset::{FramesError, list_frames};
///
/// let error = list_frames("fixtures/simulated/S001/005".as_ref(), None, Some(11)).unwrap_err();
/// assert!(matches!(error, FramesError::NoSuchFrame { column: "last_frame", number: 11, first: 1, last: 10, .. }));
/// ```
#[derive(Debug, thiserror::Error)]
pub enum FramesError {
    /// The folder cannot be listed.
    #[error("{}: cannot be read: {reason}", path.display())]
    Io {
        /// The folder.
        path: PathBuf,
        /// Why.
        #[source]
        reason: io::Error,
    },
    /// No such folder or file.
    #[error(
        "{}: there is no such folder of frames or video file{}{}",
        path.display(), near.as_deref().map(leading_zeros).unwrap_or_default(), backslashes(path)
    )]
    NotFound {
        /// The path.
        path: PathBuf,
        /// Existing path with the same number but other leading zeros.
        near: Option<PathBuf>,
    },
    /// A file that is not a video.
    #[error(
        "{}: is neither a folder of images nor a video file (extensions of videos: {})",
        path.display(), VIDEO_EXTENSIONS.join(" ")
    )]
    NotAVideo {
        /// The file.
        path: PathBuf,
    },
    /// A listed picture that does not exist.
    #[error("{}: there is no such picture (frames listed one by one, separated by `;`){}", path.display(), backslashes(path))]
    PictureNotFound {
        /// The file.
        path: PathBuf,
    },
    /// A list of pictures names a file that is not a picture.
    #[error(
        "{}: is not a picture that is read (extensions of images: {}); frames separated by `;` are pictures only",
        path.display(), IMAGE_EXTENSIONS.join(" ")
    )]
    NotAPicture {
        /// The folder or file.
        path: PathBuf,
    },
    /// A picture that is listed twice.
    #[error("{}: is in the list twice, as picture {first} and {second}; a sequence shows two states of the face", path.display())]
    ListedTwice {
        /// The file.
        path: PathBuf,
        /// Its first place in the list, from 1.
        first: u32,
        /// The later place.
        second: u32,
    },
    /// A single picture.
    #[error(
        "{}: one picture alone is not a sequence; list the neutral picture and those up to the apex, separated by `;`",
        path.display()
    )]
    OnePicture {
        /// The file.
        path: PathBuf,
    },
    /// The first or last frame is not in the list.
    #[error("{}: {column} is {number}, but the list has {found} pictures, numbered from 1", path.display())]
    NotListed {
        /// The first picture of the list.
        path: PathBuf,
        /// `first_frame` or `last_frame`.
        column: &'static str,
        /// The number asked for.
        number: u32,
        /// Number of pictures.
        found: u32,
    },
    /// A folder without images.
    #[error("{}: no images in the folder (extensions of images: {})", folder.display(), IMAGE_EXTENSIONS.join(" "))]
    NoImages {
        /// The folder.
        folder: PathBuf,
    },
    /// Pictures in formats that cannot be read.
    #[error(
        "{}{}: this looks like a frame, but its format is not supported; convert it to PNG under the same name and number, or move it \
         out of the folder",
        files.first().map(|file| file.display().to_string()).unwrap_or_default(),
        if files.len() > 1 { format!(" and {} more", files.len() - 1) } else { String::new() }
    )]
    Unread {
        /// The pictures, sorted by number.
        files: Vec<PathBuf>,
    },
    /// An image without a frame number in its name.
    #[error("{}: the file name has no frame number such as in S005_001_00000001.png; rename the file or move it away", path.display())]
    NoNumber {
        /// The file.
        path: PathBuf,
    },
    /// A frame number above 4294967295, which two files share.
    #[error("{}: `{digits}` is too large for a frame number (at most {}), and another file has the same number; rename the files", path.display(), u32::MAX)]
    NumberTooLarge {
        /// The file.
        path: PathBuf,
        /// The number found.
        digits: String,
    },
    /// Two images with the same number.
    #[error("{}: frame {number} appears twice, as {first} and {second}; keep one of the two", folder.display())]
    DuplicateNumber {
        /// The folder.
        folder: PathBuf,
        /// The number.
        number: u32,
        /// One file name.
        first: String,
        /// The other.
        second: String,
    },
    /// The first or last frame does not exist.
    #[error("{}: {column} is {number}, but the folder has no such frame; it has {found} frames from {first} to {last}", folder.display())]
    NoSuchFrame {
        /// The folder.
        folder: PathBuf,
        /// `first_frame` or `last_frame`.
        column: &'static str,
        /// The number asked for.
        number: u32,
        /// Number of frames.
        found: usize,
        /// Smallest existing number.
        first: u32,
        /// Largest existing number.
        last: u32,
    },
    /// Fewer than two frames from first to last.
    #[error("{}: {found} frame from neutral to apex; at least {MINIMUM_FRAMES} are needed", folder.display())]
    TooFew {
        /// The folder.
        folder: PathBuf,
        /// Frames from `first_frame` to `last_frame`.
        found: usize,
    },
}

/// Lists the frames of a folder, or recognizes a video file. `first` and `last` are the numbers of the neutral and the apex frame, both
/// included. If `first` is the later of the two, the order is reversed.
///
/// Hidden files and files other than images are ignored. Pictures in unsupported formats are an error if they have the frames' names and
/// lie in the requested range.
///
/// The number of an image is the last run of digits in its name before the extension. If that is ambiguous or contradicts the order of the
/// names, it is the one run of digits that varies. Images are sorted by number. If several runs vary, as in dates with times, images are
/// sorted by name and counted from 1.
///
/// A path such as `neutral/1.jpg;smiling/1.jpg`, which names no folder or file, lists the pictures of a sequence. They are numbered from 1 in
/// this order.
///
/// ```
/// use grimace::dataset::list_frames;
///
/// let forward = list_frames("fixtures/simulated/S001/005".as_ref(), None, None)?;
/// assert_eq!((forward.neutral_number(), forward.files().len()), (1, 10));
/// let backward = list_frames("fixtures/simulated/S001/005".as_ref(), Some(10), Some(1))?;
/// assert_eq!(backward.neutral_number(), 10);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`FramesError`] when there is no such folder, video or listed picture, no image, a frame in an unsupported format, an image without a number, a
/// duplicate number, a `first` or `last` that does not exist, or fewer than two frames.
pub fn list_frames(path: &Path, first: Option<u32>, last: Option<u32>) -> Result<FrameSource, FramesError> {
    list_frames_among(path, first, last).map(|(frames, _)| frames)
}

/// As [`list_frames`]. Also returns the files of all frames, including those before and after, in no particular order.
///
/// # Errors
/// As [`list_frames`].
pub fn list_frames_among(path: &Path, first: Option<u32>, last: Option<u32>) -> Result<(FrameSource, Vec<PathBuf>), FramesError> {
    match pictures_in(path) {
        Some(pictures) => Ok((frames_of_list(&pictures, first, last)?, pictures)),
        None => frames_of_place(path, first, last),
    }
}

/// As [`list_frames_among`] for a folder or a video.
pub(super) fn frames_of_place(
    path: &Path,
    first: Option<u32>,
    last: Option<u32>,
) -> Result<(FrameSource, Vec<PathBuf>), FramesError> {
    if path.is_dir() {
        let all = numbered_images(path)?;
        check_unread(path, &all, first, last)?;
        let files = all.iter().map(|frame| frame.path.clone()).collect();
        return Ok((images(path, cut(path, all, first, last)?)?, files));
    }
    Ok((video(path, first, last)?, vec![path.to_owned()]))
}

/// Checks that a sequence has at least two frames.
pub(super) fn images(folder: &Path, frames: Vec<FrameFile>) -> Result<FrameSource, FramesError> {
    match frames.len() {
        found @ 0..MINIMUM_FRAMES => Err(FramesError::TooFew { folder: folder.to_owned(), found }),
        _ => Ok(FrameSource::Images(frames)),
    }
}

/// As [`list_frames`] for a whole recording, without neutral and apex frame: all images of a folder, even a single one.
///
/// # Errors
/// As [`list_frames`], except too few frames.
pub fn list_recording(path: &Path) -> Result<FrameSource, FramesError> {
    if path.is_dir() {
        let all = numbered_images(path)?;
        check_unread(path, &all, None, None)?;
        return Ok(FrameSource::Images(cut(path, all, None, None)?));
    }
    video(path, None, None)
}

/// As [`list_frames`] for all readable frames, to choose from. Pictures in unsupported formats are ignored.
///
/// # Errors
/// As [`list_frames`], except unsupported pictures.
pub fn list_readable(path: &Path) -> Result<FrameSource, FramesError> {
    match pictures_in(path) {
        Some(pictures) => frames_of_list(&pictures, None, None),
        None => readable_of_place(path),
    }
}

/// As [`list_readable`] for a folder or a video.
pub(super) fn readable_of_place(path: &Path) -> Result<FrameSource, FramesError> {
    if path.is_dir() {
        return images(path, cut(path, numbered_images(path)?, None, None)?);
    }
    video(path, None, None)
}

/// Returns an error for pictures in unsupported formats within the requested range or, in a folder without frames, for any such picture.
fn check_unread(folder: &Path, frames: &[FrameFile], first: Option<u32>, last: Option<u32>) -> Result<(), FramesError> {
    let unread = unread_pictures(folder).map_err(|reason| FramesError::Io { path: folder.to_owned(), reason })?;
    let files = if frames.is_empty() { unread } else { unread_frames(frames, unread, first, last) };
    if files.is_empty() { Ok(()) } else { Err(FramesError::Unread { files }) }
}

fn video(path: &Path, first: Option<u32>, last: Option<u32>) -> Result<FrameSource, FramesError> {
    match path.metadata() {
        // What lies behind a folder without permission may well be there.
        Err(reason) if reason.kind() == io::ErrorKind::PermissionDenied => {
            return Err(FramesError::Io { path: path.to_owned(), reason });
        }
        Err(_) => return Err(FramesError::NotFound { path: path.to_owned(), near: same_number(path) }),
        Ok(_) => {}
    }
    if is_picture(path) {
        return Err(FramesError::OnePicture { path: path.to_owned() });
    }
    if !is_video(path) {
        return Err(FramesError::NotAVideo { path: path.to_owned() });
    }
    Ok(FrameSource::Video { path: path.to_owned(), first, last })
}

/// Existing path whose name has the same number written differently, since spreadsheets change 002 to 2.
fn same_number(path: &Path) -> Option<PathBuf> {
    let missing = path.ancestors().take_while(|p| !p.exists()).last()?;
    let number = |name: &OsStr| name.to_str()?.parse::<u64>().ok();
    let wanted = number(missing.file_name()?)?;
    let folder = missing.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = visible(folder).ok()?;
    entries.iter().find(|e| number(&e.file_name()) == Some(wanted)).map(fs::DirEntry::path)
}

/// Whether a path has the extension of a video file.
pub(crate) fn is_video(path: &Path) -> bool {
    has_extension(path, &VIDEO_EXTENSIONS)
}

/// Whether a folder contains an image.
pub(crate) fn has_frames(folder: &Path) -> bool {
    visible(folder).is_ok_and(|entries| entries.iter().any(|e| has_picture_name(Path::new(&e.file_name()))))
}

/// Number of images in a folder.
pub(super) fn picture_count(folder: &Path) -> usize {
    visible(folder).map_or(0, |entries| entries.iter().filter(|e| is_picture(&e.path())).count())
}

/// Sorted names of the folders in a folder, without hidden ones.
pub(super) fn sub_folders(folder: &Path) -> io::Result<Vec<String>> {
    let entries = visible(folder)?;
    let folders = entries.iter().filter(|e| e.path().is_dir());
    Ok(folders.map(|e| e.file_name().to_string_lossy().into_owned()).collect())
}

/// Entries of a folder sorted by name, without hidden ones.
pub(crate) fn visible(folder: &Path) -> io::Result<Vec<fs::DirEntry>> {
    let mut entries = fs::read_dir(folder)?.collect::<io::Result<Vec<_>>>()?;
    entries.retain(|e| !e.file_name().as_encoded_bytes().starts_with(b"."));
    entries.sort_by_key(fs::DirEntry::file_name);
    Ok(entries)
}

/// Whether a path is a file with the extension of a picture.
pub fn is_picture(path: &Path) -> bool {
    path.is_file() && has_picture_name(path)
}

/// Whether a path has the extension of a picture, whether it exists or not.
pub fn has_picture_name(path: &Path) -> bool {
    has_extension(path, &IMAGE_EXTENSIONS)
}

pub(super) fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    let extension = path.extension().and_then(OsStr::to_str);
    extension.is_some_and(|found| extensions.iter().any(|e| e.eq_ignore_ascii_case(found)))
}

/// Whether there is a digit in the stem of a file name.
pub(super) fn has_digits(path: &Path) -> bool {
    path.file_stem().is_some_and(|stem| stem.as_encoded_bytes().iter().any(u8::is_ascii_digit))
}

/// Images of a folder, sorted by number.
fn numbered_images(folder: &Path) -> Result<Vec<FrameFile>, FramesError> {
    let io = |reason| FramesError::Io { path: folder.to_owned(), reason };
    let mut frames = Vec::new();
    let mut paths = Vec::new();
    for entry in visible(folder).map_err(io)? {
        let path = entry.path();
        if !has_picture_name(&path) || entry.file_type().map_err(io)?.is_dir() {
            continue;
        }
        if !has_digits(&path) {
            return Err(FramesError::NoNumber { path });
        }
        paths.push(path);
    }
    match numbered(&paths) {
        Numbering::Counted(places) => {
            frames.extend(paths.into_iter().zip(places).map(|(path, number)| FrameFile { number, path }));
        }
        Numbering::Named(digits) => {
            for (path, digits) in paths.into_iter().zip(digits) {
                let number = digits.parse().map_err(|_| FramesError::NumberTooLarge { path: path.clone(), digits })?;
                frames.push(FrameFile { number, path });
            }
        }
    }
    // A stable sort keeps files with equal numbers in the order of their names.
    frames.sort_by_key(|frame| frame.number);
    let name = |frame: &FrameFile| frame.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    match frames.windows(2).find(|pair| pair[0].number == pair[1].number) {
        Some(pair) => Err(FramesError::DuplicateNumber {
            folder: folder.to_owned(),
            number: pair[0].number,
            first: name(&pair[0]),
            second: name(&pair[1]),
        }),
        None => Ok(frames),
    }
}

/// The frames from `first` to `last`.
fn cut(folder: &Path, mut frames: Vec<FrameFile>, first: Option<u32>, last: Option<u32>) -> Result<Vec<FrameFile>, FramesError> {
    let folder = || folder.to_owned();
    let (Some(smallest), Some(largest)) = (frames.first().map(|f| f.number), frames.last().map(|f| f.number)) else {
        return Err(FramesError::NoImages { folder: folder() });
    };
    for (column, number) in [("first_frame", first), ("last_frame", last)] {
        if let Some(number) = number.filter(|n| frames.binary_search_by_key(n, |f| f.number).is_err()) {
            let found = frames.len();
            return Err(FramesError::NoSuchFrame { folder: folder(), column, number, found, first: smallest, last: largest });
        }
    }
    let (from, to) = (first.unwrap_or(smallest), last.unwrap_or(largest));
    frames.retain(|f| (from.min(to)..=from.max(to)).contains(&f.number));
    if from > to {
        frames.reverse();
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    use super::{super::folder_with as folder, *};

    fn numbers(folder: &tempfile::TempDir, first: Option<u32>, last: Option<u32>) -> Result<Vec<u32>, String> {
        match list_frames(folder.path(), first, last).map_err(|e| e.to_string())? {
            FrameSource::Images(frames) => Ok(frames.iter().map(|f| f.number).collect()),
            FrameSource::Video { .. } => Err("video".to_owned()),
        }
    }

    #[test]
    fn images_are_in_the_order_of_their_numbers() {
        let names = ["a10.png", "a9.PNG", "a2.Jpeg", ".a1.png", "._a3.png", "landmarks68.csv", "note4.txt", "a0011.webp"];
        let folder = folder(&names);
        fs::create_dir(folder.path().join("old7.png")).unwrap();
        assert_eq!(numbers(&folder, None, None), Ok(vec![2, 9, 10, 11]));
        assert_eq!(numbers(&folder, Some(9), Some(10)), Ok(vec![9, 10]));
        assert_eq!(list_frames(folder.path(), Some(9), None).unwrap().neutral_number(), 9);
    }

    #[test]
    fn a_folder_of_the_same_number_is_named() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir_all(folder.path().join("005/002")).unwrap();
        let error = |name: &str| list_frames(&folder.path().join(name), None, None).unwrap_err().to_string();
        assert!(
            error("005/2").ends_with("005/002 exists: spreadsheets drop leading zeros, so format the column as text"),
            "{}",
            error("005/2")
        );
        assert!(error("5/002").contains("005 exists"), "{}", error("5/002"));
        assert!(!error("005/3").contains("exists:"));
    }

    #[test]
    fn frames_are_in_the_order_in_which_a_person_reads_their_names() {
        let names = |names: &[&str]| {
            let folder = folder(names);
            let FrameSource::Images(frames) = list_frames(folder.path(), None, None).unwrap() else { panic!("a folder") };
            frames.iter().map(|f| (f.number, f.path.file_name().unwrap().to_string_lossy().into_owned())).collect::<Vec<_>>()
        };
        let expected = |list: &[(u32, &str)]| list.iter().map(|(n, name)| (*n, (*name).to_owned())).collect::<Vec<_>>();
        let times = ["01_12-31-00.png", "01_12-30-59.png", "01_12-31-01.png"];
        assert_eq!(names(&times), expected(&[(1, times[1]), (2, times[0]), (3, times[2])]));
        assert_eq!(names(&["007_cam2.png", "003_cam2.png"]), expected(&[(3, "003_cam2.png"), (7, "007_cam2.png")]));
    }

    #[test]
    fn missing_ranges_are_reported_with_the_existing_ones() {
        let folder = folder(&["f1.png", "f2.png", "f5.png"]);
        let error = numbers(&folder, Some(3), None).unwrap_err();
        assert!(error.ends_with("first_frame is 3, but the folder has no such frame; it has 3 frames from 1 to 5"), "{error}");
        assert!(numbers(&folder, None, Some(99)).unwrap_err().contains("last_frame is 99"));
        assert!(numbers(&folder, Some(5), None).unwrap_err().ends_with("1 frame from neutral to apex; at least 2 are needed"));
        assert_eq!(numbers(&folder, Some(5), Some(1)), Ok(vec![5, 2, 1]), "the apex may come first");
    }

    #[test]
    fn folders_that_are_not_sequences_are_refused() {
        assert!(numbers(&folder(&["a.txt"]), None, None).unwrap_err().contains("no images in the folder"));
        assert!(numbers(&folder(&["f1.png"]), None, None).unwrap_err().contains("1 frame from"));
        assert!(
            numbers(&folder(&["f1.png", "neutral.png"]), None, None).unwrap_err().contains("neutral.png: the file name has no")
        );
        let twice = numbers(&folder(&["f1.png", "f01.jpg", "f2.png"]), None, None).unwrap_err();
        assert!(twice.contains("frame 1 appears twice, as f01.jpg and f1.png"), "{twice}");
        let long = numbers(&folder(&["f99999999999.png", "f099999999999.jpg"]), None, None).unwrap_err();
        assert!(
            long.contains(
                "99999999999` is too large for a frame number (at most 4294967295), and another file has the same number"
            ),
            "{long}"
        );
        assert_eq!(numbers(&folder(&["f99999999999.png", "f99999999998.png"]), None, None), Ok(vec![1, 2]));
    }

    #[test]
    fn a_video_is_recognized_by_its_extension() {
        let folder = folder(&["a.MP4", "b.txt"]);
        let path = folder.path().join("a.MP4");
        let source = list_frames(&path, Some(3), None).unwrap();
        assert_eq!(source, FrameSource::Video { path, first: Some(3), last: None });
        assert_eq!(source.neutral_number(), 3);
        let error = |name: &str| list_frames(&folder.path().join(name), None, None).unwrap_err().to_string();
        assert!(error("b.txt").contains("neither a folder of images nor a video file"));
        assert!(error("none").contains("there is no such folder"));
    }
}
