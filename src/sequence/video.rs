//! Frames of a video file.

use std::path::{Path, PathBuf};

use image::GrayImage;
use opencv::{
    core::Mat,
    imgproc::{COLOR_BGR2GRAY, cvt_color_def},
    prelude::*,
    videoio::{CAP_ANY, CAP_PROP_FPS, CAP_PROP_FRAME_COUNT, CAP_PROP_FRAME_HEIGHT, CAP_PROP_FRAME_WIDTH, VideoCapture},
};

use super::{SequenceError, limit::check_size};
use crate::native;

/// Share of the stated frames that a whole video decodes at least; headers may be estimates.
const COMPLETE: f64 = 0.9;

/// Decodes a video from its first to its last wanted frame.
pub struct VideoReader {
    path: PathBuf,
    capture: VideoCapture,
    first: u32,
    /// Frames that the file's header states; 0 or less when it does not. Some containers only estimate it.
    stated: f64,
    last: Option<u32>,
    next: u32,
    given: usize,
    ended: bool,
}

impl VideoReader {
    /// Opens the file.
    pub fn open(path: &Path, first: Option<u32>, last: Option<u32>) -> Result<Self, SequenceError> {
        let error = |reason: String| SequenceError::Video { path: path.to_owned(), reason };
        let capture = open_capture(path).map_err(error)?;
        let first = first.unwrap_or(1);
        if first == 0 {
            return Err(error("the frames of a video are numbered from 1; `first_frame` is 0".into()));
        }
        let stated = capture.get(CAP_PROP_FRAME_COUNT).unwrap_or(0.0);
        Ok(Self { path: path.to_owned(), capture, first, last, stated, next: 1, given: 0, ended: false })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Frames per second stated by the file.
    pub fn fps(&self) -> Option<f64> {
        self.capture.get(CAP_PROP_FPS).ok().filter(|fps| fps.is_finite() && *fps > 0.0)
    }

    /// The next wanted frame and its number.
    pub fn next_frame(&mut self) -> Option<Result<(u32, GrayImage), SequenceError>> {
        if self.ended {
            return None;
        }
        let result = self.advance();
        self.ended = !matches!(result, Some(Ok(_)));
        result
    }

    fn advance(&mut self) -> Option<Result<(u32, GrayImage), SequenceError>> {
        loop {
            let number = self.next;
            if self.last.is_some_and(|last| number > last) {
                return None;
            }
            let mut colour = Mat::default();
            match self.capture.read(&mut colour) {
                Ok(true) if !colour.empty() => {}
                Ok(_) => return self.end(number - 1).map(Err),
                Err(error) => return Some(Err(self.failure(&error))),
            }
            self.next += 1;
            if number < self.first {
                continue;
            }
            self.given += 1;
            return Some(grey(colour).map(|image| (number, image)).map_err(|error| self.failure(&error)));
        }
    }

    fn failure(&self, error: &opencv::Error) -> SequenceError {
        SequenceError::Video { path: self.path.clone(), reason: format!("frame {}: OpenCV: {error}", self.next) }
    }

    /// The error, if any, of a video that ended after `count` frames.
    fn end(&self, count: u32) -> Option<SequenceError> {
        let error = |reason: String| Some(SequenceError::Video { path: self.path.clone(), reason });
        match self.last {
            Some(last) => error(format!("ends at frame {count}, before frame {last} that `last_frame` asks for")),
            None if self.given == 0 && count > 0 => error(format!("has {count} frames; `first_frame` is {}", self.first)),
            None if f64::from(count) < COMPLETE * self.stated => {
                error(format!("breaks off at frame {count} of {}; the file is cut or damaged", self.stated))
            }
            None if self.given < 2 => {
                error(format!("a sequence needs at least 2 frames, from neutral to apex; found {}", self.given))
            }
            None => None,
        }
    }
}

/// Opens a video whose frames are not too large.
pub(super) fn open_capture(path: &Path) -> Result<VideoCapture, String> {
    native::configure();
    crate::input::open_file(path).map_err(|e| format!("cannot be read: {e}"))?;
    let capture = VideoCapture::from_file(path, CAP_ANY).ok().filter(|c| c.is_opened().unwrap_or(false));
    let capture = capture.ok_or("not a video that OpenCV can decode; convert it (for example to H.264 in MP4) or to images")?;
    let stated = |property| capture.get(property).unwrap_or(0.0).max(0.0) as u32;
    let (width, height) = (stated(CAP_PROP_FRAME_WIDTH), stated(CAP_PROP_FRAME_HEIGHT));
    if width > 0 && height > 0 {
        check_size(width, height).map_err(|e| e.to_string())?;
    }
    Ok(capture)
}

fn grey(frame: Mat) -> opencv::Result<GrayImage> {
    let mut grey = Mat::default();
    if frame.channels() == 1 {
        grey = frame;
    } else {
        cvt_color_def(&frame, &mut grey, COLOR_BGR2GRAY)?;
    }
    let grey = if grey.is_continuous() { grey } else { grey.try_clone()? };
    let (width, height) = (grey.cols().max(0) as u32, grey.rows().max(0) as u32);
    Ok(GrayImage::from_raw(width, height, grey.data_typed::<u8>()?.to_vec()).unwrap_or_default())
}
