//! Frames as a browser shows them: the dataset's own image files, or what OpenCV decodes of others.

use std::{
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use super::RequestError;
use crate::{
    dataset::{FrameFile, FrameSource, is_picture, list_frames},
    sequence::{Frame, ImageSize, SequenceReader, read_frame},
};

/// Most frames of a video that are kept for scrubbing.
const MAX_VIDEO_FRAMES: usize = 2000;

/// A frame's bytes and their type.
pub struct Picture {
    /// `image/png`, `image/jpeg` or `image/webp`.
    pub mime: &'static str,
    /// The file.
    pub bytes: Vec<u8>,
}

/// All frames of one sequence, whatever its neutral and apex frame.
#[derive(Clone, Debug)]
pub struct FrameList {
    /// Frame numbers, ascending.
    pub numbers: Vec<u32>,
    /// Size of the first frame, px.
    pub size: ImageSize,
}

/// Lists and shows frames; keeps the decoded frames of one video, because a video only decodes in order.
#[derive(Default)]
pub struct FrameShelf {
    video: Mutex<Option<(PathBuf, Arc<Vec<VideoFrame>>)>>,
}

struct VideoFrame {
    number: u32,
    size: ImageSize,
    png: Vec<u8>,
}

impl FrameShelf {
    /// The frames of a folder, a video or a picture.
    ///
    /// # Errors
    /// [`RequestError::Refused`] when there are none, or the first one does not decode.
    pub fn list(&self, path: &Path) -> Result<FrameList, RequestError> {
        match frames_at(path)? {
            FrameSource::Images(files) => {
                let first = files.first().ok_or_else(|| RequestError::Refused("no frames".to_owned()))?;
                let size = read_frame(&first.path).map_err(RequestError::refused)?.size();
                Ok(FrameList { numbers: files.iter().map(|f| f.number).collect(), size })
            }
            source @ FrameSource::Video { .. } => {
                let frames = self.video(path, &source)?;
                let first = frames.first().ok_or_else(|| RequestError::Refused("the video has no frames".to_owned()))?;
                Ok(FrameList { numbers: frames.iter().map(|f| f.number).collect(), size: first.size })
            }
        }
    }

    /// One frame for the browser.
    ///
    /// # Errors
    /// [`RequestError`] when there is no such frame or it does not decode.
    pub fn picture(&self, path: &Path, number: u32) -> Result<Picture, RequestError> {
        let missing = || RequestError::NotFound(format!("there is no frame {number}"));
        match frames_at(path)? {
            FrameSource::Images(files) => {
                let file = files.iter().find(|f| f.number == number).ok_or_else(missing)?;
                image_file(&file.path)
            }
            source @ FrameSource::Video { .. } => {
                let frames = self.video(path, &source)?;
                let frame = frames.iter().find(|f| f.number == number).ok_or_else(missing)?;
                Ok(Picture { mime: "image/png", bytes: frame.png.clone() })
            }
        }
    }

    fn video(&self, path: &Path, source: &FrameSource) -> Result<Arc<Vec<VideoFrame>>, RequestError> {
        let mut shelf = self.video.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, frames)) = shelf.as_ref().filter(|(known, _)| known == path) {
            return Ok(Arc::clone(frames));
        }
        let mut frames = Vec::new();
        for frame in SequenceReader::open(source).map_err(RequestError::refused)?.take(MAX_VIDEO_FRAMES) {
            let frame = frame.map_err(RequestError::refused)?;
            frames.push(VideoFrame { number: frame.number(), size: frame.size(), png: png(&frame)? });
        }
        let frames = Arc::new(frames);
        *shelf = Some((path.to_owned(), Arc::clone(&frames)));
        Ok(frames)
    }
}

/// One picture as the frames of a sequence.
pub fn picture_frames(path: &Path) -> FrameSource {
    FrameSource::Images(vec![FrameFile { number: 1, path: path.to_owned() }])
}

/// The frames of a folder, a video or a picture.
fn frames_at(path: &Path) -> Result<FrameSource, RequestError> {
    if is_picture(path) {
        return Ok(picture_frames(path));
    }
    list_frames(path, None, None).map_err(RequestError::refused)
}

/// An image file as it is where browsers show it right, decoded to grey where they do not.
fn image_file(path: &Path) -> Result<Picture, RequestError> {
    // Only a whole image is given out, whatever the file is called: this decodes it.
    let frame = read_frame(path).map_err(RequestError::refused)?;
    let bytes = crate::input::read(path).map_err(RequestError::failed)?;
    match browser_type(&bytes) {
        Some(mime) => Ok(Picture { mime, bytes }),
        None => Ok(Picture { mime: "image/png", bytes: png(&frame)? }),
    }
}

/// The type of bytes that a browser shows as OpenCV decodes them.
fn browser_type(bytes: &[u8]) -> Option<&'static str> {
    /// Place of the bit depth in a PNG file. Browsers show 16 bits by the upper 8: a 12-bit camera would give black.
    const PNG_DEPTH: usize = 24;
    match bytes {
        [0xFF, 0xD8, 0xFF, ..] => Some("image/jpeg"),
        [0x89, b'P', b'N', b'G', ..] if bytes.get(PNG_DEPTH) != Some(&16) => Some("image/png"),
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
        let list = shelf.list(folder.path()).unwrap();
        assert_eq!((list.numbers, list.size), (vec![3, 5, 9], ImageSize { width: 8, height: 6 }));
        assert_eq!(shelf.picture(folder.path(), 5).ok().map(|p| p.mime), Some("image/png"));
        assert!(matches!(shelf.picture(folder.path(), 4), Err(RequestError::NotFound(_))));
        assert!(matches!(shelf.picture(folder.path(), 9), Err(RequestError::Refused(reason)) if reason.contains("not an image")));
    }

    #[test]
    fn what_browsers_do_not_show_is_decoded() {
        let folder = tempfile::tempdir().unwrap();
        let mut pgm = b"P5 4 2 255\n".to_vec();
        pgm.extend([0, 50, 100, 150, 200, 250, 10, 20]);
        fs::write(folder.path().join("a1.pgm"), &pgm).unwrap();
        fs::write(folder.path().join("a2.pgm"), &pgm).unwrap();
        let picture = FrameShelf::default().picture(folder.path(), 1).ok().unwrap();
        let shown = image::load_from_memory(&picture.bytes).unwrap().to_luma8();
        assert_eq!((picture.mime, shown.get_pixel(1, 1).0[0]), ("image/png", 250));
        // A PNG file of 16 bits per sample is decoded as well.
        let mut deep = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01".to_vec();
        deep.push(16);
        assert_eq!((browser_type(&deep), browser_type(&[0xFF, 0xD8, 0xFF, 0])), (None, Some("image/jpeg")));
    }
}
