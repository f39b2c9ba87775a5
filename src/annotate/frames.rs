//! Frames for the browser: the dataset's own image files, or pictures decoded by OpenCV.

use std::{
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use image::{ExtendedColorType, GrayImage, ImageEncoder, codecs::png::PngEncoder};

use super::RequestError;
use crate::{
    dataset::FrameSource,
    sequence::{Frame, ImageSize, SequenceReader, read_frame, read_frame_of},
};

/// Most frames of a video that are kept for scrubbing.
const MAX_VIDEO_FRAMES: u32 = 2000;

/// Numbers of the neutral and the apex frame in the manifest or track, in either order.
pub type Named = (Option<u32>, Option<u32>);

/// A frame's bytes and their media type.
pub struct Picture {
    /// `image/png`, `image/jpeg` or `image/webp`.
    pub mime: &'static str,
    /// The file.
    pub bytes: Vec<u8>,
}

/// All frames of one sequence, also beyond its neutral and apex frame; of a long video only those around them.
#[derive(Clone, Debug)]
pub struct FrameList {
    /// Frame numbers, ascending.
    pub numbers: Vec<u32>,
    /// Size of the first frame, px.
    pub size: ImageSize,
}

/// Lists and returns frames. It keeps the decoded frames of one video, because a video can only be decoded in order.
#[derive(Default)]
pub struct FrameShelf {
    video: Mutex<Option<Shelved>>,
}

struct Shelved {
    path: PathBuf,
    named: Named,
    frames: Arc<Vec<VideoFrame>>,
}

struct VideoFrame {
    number: u32,
    size: ImageSize,
    png: Vec<u8>,
}

impl FrameShelf {
    /// Lists the given frames. Of a video with more than 2,000 frames it lists those around the `named` ones,
    /// or every second or fewer if these are further apart.
    ///
    /// # Errors
    /// [`RequestError::Refused`] when there are none, or the first one cannot be decoded.
    pub fn list(&self, source: &FrameSource, named: Named) -> Result<FrameList, RequestError> {
        match source {
            FrameSource::Images(files) => {
                let first = files.first().ok_or_else(|| RequestError::Refused("no frames".to_owned()))?;
                let size = read_frame(&first.path).map_err(RequestError::refused)?.size();
                Ok(FrameList { numbers: files.iter().map(|f| f.number).collect(), size })
            }
            FrameSource::Video { path, .. } => {
                let frames = self.video(path, source, named)?;
                let first = frames.first().ok_or_else(|| RequestError::Refused("the video has no frames".to_owned()))?;
                Ok(FrameList { numbers: frames.iter().map(|f| f.number).collect(), size: first.size })
            }
        }
    }

    /// Returns one frame for the browser.
    ///
    /// # Errors
    /// [`RequestError`] when the frame does not exist or cannot be decoded.
    pub fn picture(&self, source: &FrameSource, named: Named, number: u32) -> Result<Picture, RequestError> {
        let missing = || RequestError::NotFound(format!("there is no frame {number}"));
        match source {
            FrameSource::Images(files) => {
                let file = files.iter().find(|f| f.number == number).ok_or_else(missing)?;
                image_file(&file.path, files.first().map_or(&file.path, |first| &first.path))
            }
            FrameSource::Video { path, .. } => {
                let frames = self.video(path, source, named)?;
                let frame = frames.iter().find(|f| f.number == number).ok_or_else(missing)?;
                Ok(Picture { mime: "image/png", bytes: frame.png.clone() })
            }
        }
    }

    /// Returns one frame in grey, as used for tracking.
    ///
    /// # Errors
    /// As [`FrameShelf::picture`].
    pub fn grey(&self, source: &FrameSource, named: Named, number: u32) -> Result<GrayImage, RequestError> {
        if let FrameSource::Images(files) = source {
            let missing = || RequestError::NotFound(format!("there is no frame {number}"));
            let file = files.iter().find(|f| f.number == number).ok_or_else(missing)?;
            let frame = read_frame_of(&file.path, files.first().map_or(&file.path, |first| &first.path));
            return Ok(frame.map_err(RequestError::refused)?.into_image());
        }
        let picture = self.picture(source, named, number)?;
        Ok(image::load_from_memory(&picture.bytes).map_err(RequestError::failed)?.into_luma8())
    }

    /// Returns one frame for the browser, whether it is in the list or not. Of a long video the frames around it are kept.
    ///
    /// # Errors
    /// As [`FrameShelf::picture`].
    pub fn any_picture(&self, source: &FrameSource, number: u32) -> Result<Picture, RequestError> {
        /// Number of frames of a video that are kept together.
        const BLOCK: u32 = 1000;
        let kept = {
            let shelf = self.video.lock().unwrap_or_else(PoisonError::into_inner);
            let known = shelf.as_ref().filter(|known| source.files() == [known.path.as_path()]);
            known.filter(|known| known.frames.iter().any(|f| f.number == number)).map(|known| known.named)
        };
        let low = (number - number % BLOCK).max(1);
        self.picture(source, kept.unwrap_or((Some(low), Some(low + BLOCK - 1))), number)
    }

    fn video(&self, path: &Path, source: &FrameSource, named: Named) -> Result<Arc<Vec<VideoFrame>>, RequestError> {
        let mut shelf = self.video.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = shelf.as_ref().filter(|known| known.path == path && known.named == named) {
            return Ok(Arc::clone(&known.frames));
        }
        let read = |named: Named| window(SequenceReader::open(source).map_err(RequestError::refused)?, named, MAX_VIDEO_FRAMES);
        let (mut frames, end) = read(named)?;
        // A number beyond the end of the video does not determine the range.
        let reached = |n: Option<u32>| n.filter(|n| *n <= end);
        if (reached(named.0), reached(named.1)) != named {
            frames = read((reached(named.0), reached(named.1)))?.0;
        }
        let frames = Arc::new(frames);
        *shelf = Some(Shelved { path: path.to_owned(), named, frames: Arc::clone(&frames) });
        Ok(frames)
    }
}

/// Selects about `most` frames at most: those around the `named` ones, or every second, every fourth and so on if these are further apart,
/// or if only the end of the video bounds the range.
///
/// The selection contains the named frames or, without them, the first and the last frame of the video, and a few earlier frames. Also
/// returns the last number that was read.
fn window(reader: SequenceReader, (neutral, apex): Named, most: u32) -> Result<(Vec<VideoFrame>, u32), RequestError> {
    let to_end = neutral.is_none() || apex.is_none();
    let (low, high) = (neutral.min(apex).or(neutral).or(apex).unwrap_or(1), neutral.max(apex).unwrap_or(1));
    let around = (most.saturating_sub(high - low) / 2).max(most / 10);
    let start = if neutral.is_none() { 1 } else { low.saturating_sub(around).max(1) };
    let end = if to_end { u32::MAX } else { high.saturating_add(around) };
    let mut every = if to_end { 1 } else { ((high - low) / most + 1).next_power_of_two() };
    let before = (start / (most / 10).max(1)).max(1);
    let mut read = 0;
    let is_named = |n: u32| Some(n) == neutral || Some(n) == apex;
    let mut kept: Vec<VideoFrame> = Vec::new();
    let mut last = None;
    for frame in reader {
        let frame = frame.map_err(RequestError::refused)?;
        let number = frame.number();
        if number > end {
            break;
        }
        read = number;
        let is_wanted = if number < start { (number - 1) % before == 0 } else { (number - start) % every == 0 };
        if is_wanted || is_named(number) {
            kept.push(VideoFrame { number, size: frame.size(), png: png(&frame)? });
        }
        if to_end && kept.len() > most as usize {
            every *= 2;
            kept.retain(|f| f.number < start || (f.number - start) % every == 0 || is_named(f.number));
        }
        last = kept.last().is_none_or(|f| f.number != number).then_some(frame).filter(|_| number >= start);
    }
    if let Some(frame) = last.filter(|_| to_end) {
        kept.push(VideoFrame { number: frame.number(), size: frame.size(), png: png(&frame)? });
    }
    Ok((kept, read))
}

/// An image file of a sequence whose first picture is `first`: unchanged if browsers show it correctly, otherwise decoded to grey.
fn image_file(path: &Path, first: &Path) -> Result<Picture, RequestError> {
    // Decoding ensures that only a complete image is sent, whatever the file's name.
    let frame = read_frame_of(path, first).map_err(RequestError::refused)?;
    let bytes = crate::input::read(path).map_err(RequestError::failed)?;
    match browser_type(&bytes) {
        Some(mime) => Ok(Picture { mime, bytes }),
        None => Ok(Picture { mime: "image/png", bytes: png(&frame)? }),
    }
}

/// Media type of bytes that a browser shows like OpenCV.
fn browser_type(bytes: &[u8]) -> Option<&'static str> {
    /// Offset of the bit depth in a PNG file. Browsers show the upper 8 of 16 bits, so pictures of a 12-bit camera would be black.
    const PNG_DEPTH: usize = 24;
    /// Flag of a WebP file with Exif data.
    const WEBP_EXIF: u8 = 0x08;
    match bytes {
        [0xFF, 0xD8, 0xFF, ..] => Some("image/jpeg"),
        [0x89, b'P', b'N', b'G', ..] if bytes.get(PNG_DEPTH) != Some(&16) => Some("image/png"),
        // Browsers do not rotate these by their Exif data, but the reader does.
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', b'V', b'P', b'8', b'X', _, _, _, _, flags, ..]
            if flags & WEBP_EXIF != 0 =>
        {
            None
        }
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Some("image/webp"),
        _ => None,
    }
}

fn png(frame: &Frame) -> Result<Vec<u8>, RequestError> {
    let image = frame.image();
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(image.as_raw(), image.width(), image.height(), ExtendedColorType::L8)
        .map_err(RequestError::failed)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::dataset::{FrameFile, list_readable};

    fn gray(width: u32, height: u32) -> image::GrayImage {
        image::GrayImage::from_fn(width, height, |x, y| image::Luma([(x * 7 + y * 3) as u8]))
    }

    #[test]
    fn images_are_listed_and_shown_and_nothing_else_is() {
        let folder = tempfile::tempdir().unwrap();
        for number in [3, 5] {
            gray(8, 6).save(folder.path().join(format!("f_{number}.png"))).unwrap();
        }
        fs::write(folder.path().join("secret_9.png"), "a text that is called an image").unwrap();
        fs::write(folder.path().join("notes.txt"), "x").unwrap();
        let shelf = FrameShelf::default();
        let source = list_readable(folder.path()).unwrap();
        let list = shelf.list(&source, (None, None)).unwrap();
        assert_eq!((list.numbers, list.size), (vec![3, 5, 9], ImageSize { width: 8, height: 6 }));
        assert_eq!(shelf.picture(&source, (None, None), 5).ok().map(|p| p.mime), Some("image/png"));
        assert!(matches!(shelf.picture(&source, (None, None), 4), Err(RequestError::NotFound(_))));
        assert!(
            matches!(shelf.picture(&source, (None, None), 9), Err(RequestError::Refused(reason)) if reason.contains("not an image"))
        );
    }

    #[test]
    fn formats_that_browsers_cannot_show_are_decoded() {
        let folder = tempfile::tempdir().unwrap();
        let mut pgm = b"P5 4 2 255\n".to_vec();
        pgm.extend([0, 50, 100, 150, 200, 250, 10, 20]);
        fs::write(folder.path().join("a1.pgm"), &pgm).unwrap();
        fs::write(folder.path().join("a2.pgm"), &pgm).unwrap();
        let picture = FrameShelf::default().picture(&list_readable(folder.path()).unwrap(), (None, None), 1).ok().unwrap();
        let shown = image::load_from_memory(&picture.bytes).unwrap().to_luma8();
        assert_eq!((picture.mime, shown.get_pixel(1, 1).0[0]), ("image/png", 250));
        // A PNG file with 16 bits per sample is decoded, too.
        let mut deep = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01".to_vec();
        deep.push(16);
        assert_eq!((browser_type(&deep), browser_type(&[0xFF, 0xD8, 0xFF, 0])), (None, Some("image/jpeg")));
        // So is a WebP file that may need rotation.
        let webp = |flags: u8| [b"RIFF\0\0\0\0WEBPVP8X\x0A\0\0\0".as_slice(), &[flags]].concat();
        assert_eq!((browser_type(&webp(0x08)), browser_type(&webp(0x10))), (None, Some("image/webp")));
    }

    #[test]
    fn a_long_recording_shows_the_frames_around_those_that_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let files: Vec<FrameFile> = (1..=60)
            .map(|number| {
                let path = folder.path().join(format!("{number}.png"));
                gray(8, 6).save(&path).unwrap();
                FrameFile { number, path }
            })
            .collect();
        let numbers = |named: Named, most: u32| -> Vec<u32> {
            let reader = SequenceReader::open(&FrameSource::Images(files.clone())).unwrap();
            window(reader, named, most).map_err(|e| e.to_string()).unwrap().0.iter().map(|f| f.number).collect()
        };
        assert_eq!(numbers((None, None), 100), (1..=60).collect::<Vec<_>>());
        let around: Vec<u32> = std::iter::once(1).chain(37..=47).collect();
        assert_eq!(numbers((Some(40), Some(44)), 10), around);
        assert_eq!(numbers((Some(44), Some(40)), 10), around, "against the time, too");
        assert_eq!(numbers((Some(2), Some(5)), 10), (1..=8).collect::<Vec<_>>());
        // Further apart than can be kept: fewer frames, but both named ones.
        assert_eq!(numbers((Some(10), Some(50)), 10), [1, 9, 10, 17, 25, 33, 41, 49, 50]);
        // To the end of the video, wherever it is.
        assert_eq!(numbers((None, None), 8), [1, 9, 17, 25, 33, 41, 49, 57, 60]);
        assert_eq!(numbers((Some(31), None), 8), [1, 27, 31, 35, 43, 51, 59, 60]);
    }
}
