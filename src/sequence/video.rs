//! Reads frames of a video file through `grimace-opencv`.

use std::{
    io::Read,
    path::{Path, PathBuf},
};

use image::GrayImage;

use super::{
    SequenceError,
    clock::{Clock, FrameTimes},
    content::{Stamp, content_blake3},
    packets::Packets,
    stream::{Next, Stream, Wanted},
};
use crate::{companion::wire::Pixels, dataset::FrameSource};

/// Smallest share of the stated frames that a complete video decodes to; headers may contain estimates.
const COMPLETE: f64 = 0.9;

/// Decodes a video from its first to its last requested frame.
pub struct VideoReader {
    path: PathBuf,
    stamp: Stamp,
    stream: Stream,
    first: u32,
    last: Option<u32>,
    next: u32,
    given: usize,
    ended: bool,
    times: FrameTimes,
    remark: Option<String>,
}

impl VideoReader {
    /// Opens the file.
    pub fn open(path: &Path, first: Option<u32>, last: Option<u32>) -> Result<Self, SequenceError> {
        let unreadable = |source: std::io::Error| SequenceError::Decode { path: path.to_owned(), source: source.into() };
        crate::input::open_file(path).map_err(unreadable)?;
        let stamp = Stamp::of(path).map_err(unreadable)?;
        let first = first.unwrap_or(1);
        let stream = Stream::open(path, Wanted::Grey { first: first.max(1) })?;
        check_numbers(path, first, last)?;
        Ok(Self {
            path: path.to_owned(),
            stamp,
            stream,
            first,
            last,
            next: first,
            given: 0,
            ended: false,
            times: FrameTimes::default(),
            remark: None,
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// BLAKE3 of the file. It must be unchanged since it was opened, because the codec reads it separately.
    pub fn content_blake3(self) -> Result<blake3::Hash, SequenceError> {
        content_of(self.path, &self.stamp)
    }

    /// Times of the returned frames.
    pub(super) fn times(&self) -> &FrameTimes {
        &self.times
    }

    /// Clock of the returned frames.
    pub fn clock(&self) -> Clock {
        self.times.clock(self.fps(), self.stream.duration())
    }

    /// Note about a video that was read to its end.
    pub fn remark(&self) -> Option<&str> {
        self.remark.as_deref()
    }

    /// Frames per second stated by the file.
    pub fn fps(&self) -> Option<f64> {
        self.stream.fps()
    }

    /// Frames that the file's header states.
    pub fn stated_frames(&self) -> Option<usize> {
        let stated = self.stream.stated();
        (stated.is_finite() && stated >= 1.0).then_some(stated as usize)
    }

    /// The next requested frame and its number.
    pub fn next_frame(&mut self) -> Option<Result<(u32, GrayImage), SequenceError>> {
        if self.ended {
            return None;
        }
        let result = self.advance();
        self.ended = !matches!(result, Some(Ok(_)));
        result
    }

    fn advance(&mut self) -> Option<Result<(u32, GrayImage), SequenceError>> {
        let number = self.next;
        if self.last.is_some_and(|last| number > last) {
            return None;
        }
        match self.stream.next() {
            Ok(Next::Frame(Pixels { width, height, data, .. })) => {
                self.next += 1;
                self.given += 1;
                self.times.enter(number, self.stream.time());
                Some(Ok((number, GrayImage::from_raw(width, height, data).unwrap_or_default())))
            }
            Ok(Next::End(count)) => self.end(count).map(Err),
            Err(error) => Some(Err(error)),
        }
    }

    /// The error, if any, of a video that ended after `count` frames.
    fn end(&mut self, count: u32) -> Option<SequenceError> {
        let error = |reason: String| Some(SequenceError::Video { path: self.path.clone(), reason });
        match self.last {
            Some(last) => error(format!("ends at frame {count}, but `last_frame` is {last}")),
            None if self.given == 0 && count > 0 => error(format!("has {count} frames; `first_frame` is {}", self.first)),
            None if self.breaks_off(count) => {
                error(format!("ends unexpectedly at frame {count} of {}; the file is truncated or damaged", self.stream.stated()))
            }
            None if self.given < 2 => {
                error(format!("a sequence needs at least 2 frames, from neutral to apex; found {}", self.given))
            }
            None => {
                self.remark = self.remark_at(count);
                None
            }
        }
    }

    /// Whether a video of `count` frames is incomplete. Some containers state their duration and only estimate the number of frames from
    /// it. The estimate is too high if frames were dropped, or if the rate is not one; then the time of the last frame decides. Durations
    /// count from the container's start, which may lie before the first frame, and numbers of frames include those that were cut off
    /// without decoding.
    fn breaks_off(&self, count: u32) -> bool {
        let lacks = |stated: f64, start: f64| {
            let is_late = |end: f64| self.fps().is_some_and(|fps| (start + end) * fps + 1.0 >= COMPLETE * stated);
            f64::from(count) < COMPLETE * stated && !self.times.end().is_some_and(is_late)
        };
        let stated = self.stream.stated();
        lacks(stated, 0.0)
            && match Packets::of(&self.path, None) {
                Some(packets) => match packets.shown() {
                    Some(shown) => lacks(shown as f64, 0.0),
                    None => lacks(stated, packets.start()),
                },
                None => true,
            }
    }

    /// Note about a video in which `count` frames were found.
    fn remark_at(&self, count: u32) -> Option<String> {
        let (stated, fps) = (self.stream.stated(), self.fps());
        let is_early = |end: f64| fps.is_some_and(|fps| end * fps < stated - 1.0);
        if f64::from(count) >= stated || !self.times.end().is_none_or(is_early) || !counts_frames(&self.path) {
            return None;
        }
        let shown = Packets::of(&self.path, None).and_then(|packets| packets.shown());
        let stated = shown.map_or(stated, |shown| shown as f64);
        (f64::from(count) < stated)
            .then(|| format!("the file has only {count} of the {stated} frames that its header announces; it may be truncated"))
    }
}

/// Returns an error for frame numbers that no video has.
pub(super) fn check_numbers(path: &Path, first: u32, last: Option<u32>) -> Result<(), SequenceError> {
    if first > 0 && last != Some(0) {
        return Ok(());
    }
    let zero = if first == 0 { "first_frame" } else { "last_frame" };
    let reason = format!("the frames of a video are numbered from 1; `{zero}` is 0");
    Err(SequenceError::Video { path: path.to_owned(), reason })
}

/// BLAKE3 of a video, which must be unchanged since it was opened.
pub(super) fn content_of(path: PathBuf, opened: &Stamp) -> Result<blake3::Hash, SequenceError> {
    let source = FrameSource::Video { path: path.clone(), first: None, last: None };
    let content = content_blake3(&source)?;
    match Stamp::of(&path) {
        Ok(stamp) if stamp == *opened => Ok(content),
        _ => Err(SequenceError::Changed { path }),
    }
}

/// Whether a video's header counts its frames. AVI and MP4 do; others only state the duration, including the sound.
fn counts_frames(path: &Path) -> bool {
    let mut begin = [0; 8];
    let read = crate::input::open_file(path).and_then(|mut file| file.read_exact(&mut begin));
    read.is_ok() && (begin.starts_with(b"RIFF") || begin.ends_with(b"ftyp"))
}
