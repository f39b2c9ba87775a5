//! Reads frames of a video in reverse order.
//!
//! Codecs only decode forwards. `grimace-opencv` decodes the video up to the later frame, then section by section, each from a key frame
//! before it. It returns a frame only if all its pixels equal those of the first decoding.

use std::path::{Path, PathBuf};

use image::GrayImage;

use super::{
    SequenceError,
    clock::{Clock, FrameTimes},
    content::Stamp,
    stream::{Next, Stream, Wanted},
    video::{check_numbers, content_of},
};
use crate::companion::wire::Pixels;

/// Returns the frames of a video by descending number.
pub(super) struct BackwardVideo {
    path: PathBuf,
    stamp: Stamp,
    stream: Stream,
    from: u32,
    /// Last requested number.
    to: u32,
    /// Number of the next frame; `None` at the end.
    next: Option<u32>,
    times: FrameTimes,
}

impl BackwardVideo {
    /// Opens a video for its frames `from` down to `to`, both included.
    pub(super) fn open(path: &Path, from: u32, to: u32) -> Result<Self, SequenceError> {
        let unreadable = |source: std::io::Error| SequenceError::Decode { path: path.to_owned(), source: source.into() };
        crate::input::open_file(path).map_err(unreadable)?;
        let stamp = Stamp::of(path).map_err(unreadable)?;
        let stream = Stream::open(path, Wanted::Back { from, to: to.max(1) })?;
        check_numbers(path, from, Some(to))?;
        Ok(Self { path: path.to_owned(), stamp, stream, from, to, next: Some(from), times: FrameTimes::default() })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn fps(&self) -> Option<f64> {
        self.stream.fps()
    }

    pub(super) fn clock(&self) -> Clock {
        self.times.clock(self.fps(), self.stream.duration())
    }

    pub(super) fn content_blake3(self) -> Result<blake3::Hash, SequenceError> {
        content_of(self.path, &self.stamp)
    }

    pub(super) fn next_frame(&mut self) -> Option<Result<(u32, GrayImage), SequenceError>> {
        let number = self.next.take()?;
        match self.stream.next() {
            Ok(Next::Frame(Pixels { width, height, data, .. })) => {
                self.next = number.checked_sub(1).filter(|next| *next >= self.to);
                self.times.enter(number, self.stream.time());
                Some(Ok((number, GrayImage::from_raw(width, height, data).unwrap_or_default())))
            }
            Ok(Next::End(count)) => {
                let from = self.from;
                let reason = format!("ends at frame {count}, but `first_frame` is {from}");
                Some(Err(SequenceError::Video { path: self.path.clone(), reason }))
            }
            Err(error) => Some(Err(error)),
        }
    }
}
