//! Frames of a video from a later one back to an earlier one.
//!
//! Codecs only go forward: a piece of the video is decoded, held, and given back to front; then the piece before it. Pieces are as long as
//! fits into [`HELD_BYTES`], so that memory does not grow with the video.

use std::path::{Path, PathBuf};

use image::GrayImage;

use super::{
    SequenceError,
    clock::{Clock, FrameTimes},
    video::VideoReader,
};

/// Pixels held at a time, bytes.
const HELD_BYTES: u64 = 48 << 20;
/// Frames of a piece at least and at most.
const PIECE: (u32, u32) = (4, 512);

/// Gives the frames of a video by descending number.
pub(super) struct BackwardVideo {
    path: PathBuf,
    /// Opened first, so that it says what the file is and whether it was changed.
    whole: VideoReader,
    /// Last number wanted.
    to: u32,
    /// Next number that is not in the piece; `None` when nothing is left.
    next: Option<u32>,
    piece: Vec<(u32, GrayImage)>,
    /// Frames of a piece; known once one frame was seen.
    length: u32,
    times: FrameTimes,
}

impl BackwardVideo {
    /// Opens a video for its frames `from` down to `to`, both included.
    pub(super) fn open(path: &Path, from: u32, to: u32) -> Result<Self, SequenceError> {
        let whole = VideoReader::open(path, Some(to), Some(from))?;
        Ok(Self {
            path: path.to_owned(),
            whole,
            to,
            next: Some(from),
            piece: Vec::new(),
            length: 1,
            times: FrameTimes::default(),
        })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn fps(&self) -> Option<f64> {
        self.whole.fps()
    }

    pub(super) fn clock(&self) -> Clock {
        self.times.clock(self.fps(), self.whole.duration())
    }

    pub(super) fn content_blake3(self) -> Result<blake3::Hash, SequenceError> {
        self.whole.content_blake3()
    }

    pub(super) fn next_frame(&mut self) -> Option<Result<(u32, GrayImage), SequenceError>> {
        if self.piece.is_empty() {
            let last = self.next?;
            if let Err(error) = self.fill(last) {
                self.next = None;
                return Some(Err(error));
            }
        }
        self.piece.pop().map(Ok)
    }

    /// Decodes the piece that ends with frame `last`.
    fn fill(&mut self, last: u32) -> Result<(), SequenceError> {
        let first = last.saturating_sub(self.length - 1).max(self.to);
        let mut reader = VideoReader::open(&self.path, Some(first), Some(last))?.of_backward();
        while let Some(frame) = reader.next_frame() {
            let (number, image) = frame?;
            let bytes = (u64::from(image.width()) * u64::from(image.height())).max(1);
            self.length = u32::try_from(HELD_BYTES / bytes).unwrap_or(PIECE.1).clamp(PIECE.0, PIECE.1);
            self.piece.push((number, image));
        }
        self.times.append(reader.times().clone());
        self.next = (first > self.to).then(|| first - 1);
        Ok(())
    }
}
