//! Frames of a video file.

use std::path::{Path, PathBuf};

use opencv::{
    core::Mat,
    imgproc::{COLOR_BGR2GRAY, cvt_color_def},
    prelude::*,
    videoio::{CAP_ANY, CAP_PROP_FPS, CAP_PROP_FRAME_COUNT, VideoCapture},
};

use super::{
    SequenceError,
    content::{Stamp, content_blake3},
};
use crate::dataset::FrameSource;

/// Share of the stated frames that a whole video decodes at least; headers may be estimates.
const COMPLETE: f64 = 0.9;

/// Decodes a video from its first to its last wanted frame.
pub struct VideoReader {
    path: PathBuf,
    stamp: Stamp,
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
        let unreadable = |source: std::io::Error| SequenceError::Decode { path: path.to_owned(), source: source.into() };
        std::fs::File::open(path).map_err(unreadable)?;
        let stamp = Stamp::of(path).map_err(unreadable)?;
        let capture = VideoCapture::from_file(path, CAP_ANY)?;
        if !capture.is_opened()? {
            return Err(error(
                "not a video that OpenCV can decode; convert it (for example to H.264 in MP4) or to images".into(),
            ));
        }
        let first = first.unwrap_or(1);
        if first == 0 {
            return Err(error("the frames of a video are numbered from 1; `first_frame` is 0".into()));
        }
        let stated = capture.get(CAP_PROP_FRAME_COUNT).unwrap_or(0.0);
        Ok(Self { path: path.to_owned(), stamp, capture, first, last, stated, next: 1, given: 0, ended: false })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// BLAKE3 of the file, which must be as it was when it was opened: the codec reads it by itself.
    pub fn content_blake3(self) -> Result<blake3::Hash, SequenceError> {
        let source = FrameSource::Video { path: self.path.clone(), first: None, last: None };
        let content = content_blake3(&source)?;
        match Stamp::of(&self.path) {
            Ok(stamp) if stamp == self.stamp => Ok(content),
            _ => Err(SequenceError::Changed { path: self.path }),
        }
    }

    /// Frames per second stated by the file.
    pub fn fps(&self) -> Option<f64> {
        self.capture.get(CAP_PROP_FPS).ok().filter(|fps| fps.is_finite() && *fps > 0.0)
    }

    /// The next wanted frame and its number.
    pub fn next_frame(&mut self) -> Option<Result<(u32, Mat), SequenceError>> {
        if self.ended {
            return None;
        }
        let result = self.advance();
        self.ended = !matches!(result, Some(Ok(_)));
        result
    }

    fn advance(&mut self) -> Option<Result<(u32, Mat), SequenceError>> {
        loop {
            let number = self.next;
            if self.last.is_some_and(|last| number > last) {
                return None;
            }
            let mut colour = Mat::default();
            match self.capture.read(&mut colour) {
                Ok(true) if !colour.empty() => {}
                Ok(_) => return self.end(number - 1).map(Err),
                Err(error) => return Some(Err(error.into())),
            }
            self.next += 1;
            if number < self.first {
                continue;
            }
            self.given += 1;
            if colour.channels() == 1 {
                return Some(Ok((number, colour)));
            }
            let mut gray = Mat::default();
            return Some(cvt_color_def(&colour, &mut gray, COLOR_BGR2GRAY).map(|()| (number, gray)).map_err(Into::into));
        }
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
