//! Frames of a video file, decoded by `grimace-opencv`.

use std::{
    ffi::{OsStr, OsString},
    io::Read,
    path::{Path, PathBuf},
};

use image::GrayImage;

use super::{
    DecodeError, SequenceError,
    clock::{Clock, FrameTimes},
    content::{Stamp, content_blake3},
    limit::{check_size, max_pixels},
};
use crate::{
    companion::{
        Answer, Companion, CompanionError,
        wire::{Pixels, Reply},
    },
    dataset::FrameSource,
};

/// Share of the stated frames that a whole video decodes at least; headers may be estimates.
const COMPLETE: f64 = 0.9;

/// A video at the program that decodes it.
pub(super) struct Stream {
    path: PathBuf,
    companion: Companion,
    fps: f64,
    /// Frames that the file's header states; 0 or less when it does not. Some containers only estimate it.
    stated: f64,
    /// When the frame that was given last is shown, s from the start of the video.
    time: Option<f64>,
}

/// What comes next in a video.
pub(super) enum Next {
    Frame(Pixels),
    /// The end, after so many frames in all.
    End(u32),
}

impl Stream {
    /// Opens a video; frames come from number `first` on, in colour or grey.
    pub(super) fn open(path: &Path, is_coloured: bool, first: u32) -> Result<Self, SequenceError> {
        let unreadable = |e: std::io::Error| SequenceError::Decode { path: path.to_owned(), source: e.into() };
        if is_text(&mut crate::input::open_file(path).map_err(unreadable)?) {
            let reason = "a text, such as a list of other files, and not a video".to_owned();
            return Err(SequenceError::Video { path: path.to_owned(), reason });
        }
        // From the root on: what comes before a colon in a bare name would be a protocol to FFmpeg.
        let full = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let words = ["decode", if is_coloured { "colour" } else { "grey" }, &first.to_string(), &max_pixels().to_string()];
        let arguments = words.iter().map(OsStr::new).chain([full.as_os_str()]).map(OsString::from);
        let failed = |source| SequenceError::Decoder { path: path.to_owned(), source };
        let mut companion = Companion::start(arguments).map_err(failed)?;
        match companion.receive(0).map_err(failed)? {
            Answer::Said(Reply::Video { fps, frames, width, height }) => {
                if width > 0 && height > 0 {
                    let of_size = |e: DecodeError| SequenceError::Video { path: path.to_owned(), reason: e.to_string() };
                    check_size(width, height).map_err(of_size)?;
                }
                Ok(Self { path: path.to_owned(), companion, fps, stated: frames, time: None })
            }
            Answer::Said(Reply::Failed { reason }) => Err(SequenceError::Video { path: path.to_owned(), reason }),
            other => Err(failed(other.unexpected())),
        }
    }

    /// The next frame, or the end.
    pub(super) fn next(&mut self) -> Result<Next, SequenceError> {
        let failed = |source: CompanionError| SequenceError::Decoder { path: self.path.clone(), source };
        let mut answer = self.companion.receive(max_pixels()).map_err(failed)?;
        self.time = None;
        if let Answer::Said(Reply::Time { seconds }) = answer {
            self.time = Some(seconds);
            answer = self.companion.receive(max_pixels()).map_err(failed)?;
        }
        match answer {
            Answer::Pixels(pixels) => {
                let of_size = |e: DecodeError| SequenceError::Video { path: self.path.clone(), reason: e.to_string() };
                check_size(pixels.width, pixels.height).map_err(of_size)?;
                Ok(Next::Frame(pixels))
            }
            Answer::Said(Reply::End { frames }) => Ok(Next::End(frames)),
            Answer::Said(Reply::Failed { reason }) => Err(SequenceError::Video { path: self.path.clone(), reason }),
            other @ Answer::Said(_) => Err(failed(other.unexpected())),
        }
    }
}

/// Decodes a video from its first to its last wanted frame.
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
    /// What names the last frame.
    asked_by: &'static str,
}

impl VideoReader {
    /// Opens the file.
    pub fn open(path: &Path, first: Option<u32>, last: Option<u32>) -> Result<Self, SequenceError> {
        let unreadable = |source: std::io::Error| SequenceError::Decode { path: path.to_owned(), source: source.into() };
        crate::input::open_file(path).map_err(unreadable)?;
        let stamp = Stamp::of(path).map_err(unreadable)?;
        let first = first.unwrap_or(1);
        let stream = Stream::open(path, false, first.max(1))?;
        if first == 0 || last == Some(0) {
            let zero = if first == 0 { "first_frame" } else { "last_frame" };
            let reason = format!("the frames of a video are numbered from 1; `{zero}` is 0");
            return Err(SequenceError::Video { path: path.to_owned(), reason });
        }
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
            asked_by: "last_frame",
        })
    }

    /// The reader of a video that goes back in time: there it is the neutral frame that comes last in the file.
    pub(super) fn of_backward(self) -> Self {
        Self { asked_by: "first_frame", ..self }
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

    /// Times of the frames that were given.
    pub(super) fn times(&self) -> &FrameTimes {
        &self.times
    }

    /// How fast the frames that were given follow on each other.
    pub fn clock(&self) -> Clock {
        self.times.clock(self.fps(), self.duration())
    }

    /// What is to be said of a video that was read to its end.
    pub fn remark(&self) -> Option<&str> {
        self.remark.as_deref()
    }

    /// Frames per second stated by the file.
    pub fn fps(&self) -> Option<f64> {
        Some(self.stream.fps).filter(|fps| fps.is_finite() && *fps > 0.0)
    }

    /// How long the file says that it is, s.
    pub(super) fn duration(&self) -> Option<f64> {
        self.fps().map(|fps| self.stream.stated / fps).filter(|seconds| seconds.is_finite() && *seconds > 0.0)
    }

    /// Frames that the file's header states.
    pub fn stated_frames(&self) -> Option<usize> {
        let stated = self.stream.stated;
        (stated.is_finite() && stated >= 1.0).then_some(stated as usize)
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
        let number = self.next;
        if self.last.is_some_and(|last| number > last) {
            return None;
        }
        match self.stream.next() {
            Ok(Next::Frame(Pixels { width, height, data, .. })) => {
                self.next += 1;
                self.given += 1;
                self.times.enter(number, self.stream.time);
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
            Some(last) => error(format!("ends at frame {count}, before frame {last} that `{}` asks for", self.asked_by)),
            None if self.given == 0 && count > 0 => error(format!("has {count} frames; `first_frame` is {}", self.first)),
            None if self.breaks_off(count) => {
                error(format!("breaks off at frame {count} of {}; the file is cut or damaged", self.stream.stated))
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

    /// Whether a video of `count` frames lacks its end. Some containers state how long they are, and their frames only as a guess from
    /// that, which is too many where frames were dropped, or where their rate is none: there the last frame's time tells.
    fn breaks_off(&self, count: u32) -> bool {
        let Stream { stated, fps, .. } = self.stream;
        let is_late = |end: f64| fps > 0.0 && end * fps + 1.0 >= COMPLETE * stated;
        f64::from(count) < COMPLETE * stated && !self.times.end().is_some_and(is_late)
    }

    /// What is to be said of a video in which `count` frames were found.
    fn remark_at(&self, count: u32) -> Option<String> {
        let Stream { stated, fps, .. } = self.stream;
        let is_early = |end: f64| fps > 0.0 && end * fps < stated - 1.0;
        let lacks = f64::from(count) < stated && self.times.end().is_none_or(is_early) && counts_frames(&self.path);
        lacks.then(|| format!("{count} of the {stated} frames that the file promises were found in it; it may be cut"))
    }
}

/// Whether a file begins as a text does: `FFmpeg` follows lists of files (`ffconcat`, `#EXTM3U`, an MPD) wherever they lead, to pipes that
/// never end and to videos whose changes nobody would see. No container of ours begins so.
fn is_text(file: &mut impl Read) -> bool {
    const LOOKED_AT: u64 = 64;
    let mut begin = Vec::new();
    let is_letter = |b: &u8| matches!(b, b'\t' | b'\n' | b'\r' | b' '..=b'~' | 0x80..);
    file.take(LOOKED_AT).read_to_end(&mut begin).is_ok() && !begin.is_empty() && begin.iter().all(is_letter)
}

/// Whether a video's header counts its frames: that of AVI and MP4 does, others only say how long they are, the sound included.
fn counts_frames(path: &Path) -> bool {
    let mut begin = [0; 8];
    let read = crate::input::open_file(path).and_then(|mut file| file.read_exact(&mut begin));
    read.is_ok() && (begin.starts_with(b"RIFF") || begin.ends_with(b"ftyp"))
}
