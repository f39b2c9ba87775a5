//! Reads a video through the program that decodes it.

use std::{
    cell::OnceCell,
    collections::VecDeque,
    ffi::{OsStr, OsString},
    io::Read,
    path::{Path, PathBuf},
};

use super::{
    DecodeError, SequenceError,
    limit::{check_size, max_pixels},
    packets::{Packets, Walk, walk},
};
use crate::companion::{
    Answer, Companion, CompanionError,
    wire::{Pixels, Reply},
};

/// Which frames of a video are returned.
#[derive(Clone, Copy, Debug)]
pub(super) enum Wanted {
    /// From a number on, grey.
    Grey { first: u32 },
    /// From a number on, in colour.
    Colour { first: u32 },
    /// From a number back to a lower one, both included, grey.
    Back { from: u32, to: u32 },
}

pub(super) struct Stream {
    path: PathBuf,
    companion: Companion,
    fps: f64,
    /// Frames stated in the file's header; 0 or less without one. Some containers only estimate it.
    stated: f64,
    /// Time of the last returned frame, s from the start of the video.
    time: Option<f64>,
    /// Whether frames are returned as they are decoded, rather than after all were decoded.
    is_forward: bool,
    losses: Losses,
}

/// The next item of a video.
pub(super) enum Next {
    Frame(Pixels),
    /// The end, with the total number of frames.
    End(u32),
}

impl Stream {
    /// Opens a video.
    pub(super) fn open(path: &Path, wanted: Wanted) -> Result<Self, SequenceError> {
        let unreadable = |e: std::io::Error| SequenceError::Decode { path: path.to_owned(), source: e.into() };
        if is_text(&mut crate::input::open_file(path).map_err(unreadable)?) {
            let reason = "this is a text file, such as a list of other files, not a video".to_owned();
            return Err(SequenceError::Video { path: path.to_owned(), reason });
        }
        // An absolute path: in a bare name, FFmpeg would read the text before a colon as a protocol.
        let full = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let words = match wanted {
            Wanted::Grey { first } => vec!["decode".to_owned(), "grey".to_owned(), first.to_string()],
            Wanted::Colour { first } => vec!["decode".to_owned(), "colour".to_owned(), first.to_string()],
            Wanted::Back { from, to } => vec!["back".to_owned(), from.to_string(), to.to_string()],
        };
        let most = max_pixels().to_string();
        let arguments = words.iter().chain([&most]).map(OsStr::new).chain([full.as_os_str()]).map(OsString::from);
        let failed = |source| SequenceError::Decoder { path: path.to_owned(), source };
        let mut companion = Companion::start(arguments).map_err(failed)?;
        match companion.receive(0).map_err(failed)? {
            Answer::Said(Reply::Video { fps, frames, width, height }) => {
                if width > 0 && height > 0 {
                    let of_size = |e: DecodeError| SequenceError::Video { path: path.to_owned(), reason: e.to_string() };
                    check_size(width, height).map_err(of_size)?;
                }
                Ok(Self {
                    path: path.to_owned(),
                    companion,
                    fps,
                    stated: frames,
                    time: None,
                    is_forward: !matches!(wanted, Wanted::Back { .. }),
                    losses: Losses::of(path, fps),
                })
            }
            Answer::Said(Reply::Failed { reason }) => Err(SequenceError::Video { path: path.to_owned(), reason }),
            other => Err(failed(other.unexpected())),
        }
    }

    /// Returns the next frame, or the end.
    ///
    /// # Errors
    /// [`SequenceError`] when the decoder fails, or frames before this one were lost.
    pub(super) fn next(&mut self) -> Result<Next, SequenceError> {
        let mut answer = self.answer()?;
        while let Answer::Said(Reply::Passed { seconds }) = answer {
            self.enter(seconds)?;
            answer = self.answer()?;
        }
        self.time = None;
        if let Answer::Said(Reply::Time { seconds }) = answer {
            self.time = Some(seconds);
            answer = self.answer()?;
        }
        match answer {
            Answer::Pixels(pixels) => {
                let of_size = |e: DecodeError| SequenceError::Video { path: self.path.clone(), reason: e.to_string() };
                check_size(pixels.width, pixels.height).map_err(of_size)?;
                if self.is_forward {
                    self.enter(self.time)?;
                }
                Ok(Next::Frame(pixels))
            }
            Answer::Said(Reply::End { frames }) => Ok(Next::End(frames)),
            Answer::Said(Reply::Failed { reason }) => Err(SequenceError::Video { path: self.path.clone(), reason }),
            other @ Answer::Said(_) => Err(SequenceError::Decoder { path: self.path.clone(), source: other.unexpected() }),
        }
    }

    fn answer(&mut self) -> Result<Answer<Reply>, SequenceError> {
        let failed = |source: CompanionError| SequenceError::Decoder { path: self.path.clone(), source };
        self.companion.receive(max_pixels()).map_err(failed)
    }

    /// Counts a frame that was decoded.
    fn enter(&mut self, seconds: Option<f64>) -> Result<(), SequenceError> {
        match self.losses.enter(seconds) {
            Some(last) => Err(SequenceError::Damaged { path: self.path.clone(), last }),
            None => Ok(()),
        }
    }

    /// Time of the last returned frame, s from the start of the video, if known.
    pub(super) fn time(&self) -> Option<f64> {
        self.time
    }

    /// Frames per second that the file states.
    pub(super) fn fps(&self) -> Option<f64> {
        Some(self.fps).filter(|fps| fps.is_finite() && *fps > 0.0)
    }

    /// Frames stated in the file; 0 or less without them.
    pub(super) fn stated(&self) -> f64 {
        self.stated
    }

    /// Duration stated in the file, s.
    pub(super) fn duration(&self) -> Option<f64> {
        self.fps().map(|fps| self.stated / fps).filter(|seconds| seconds.is_finite() && *seconds > 0.0)
    }
}

/// Detects frames that are in the file but missing among the decoded ones.
struct Losses {
    path: PathBuf,
    /// Frames so far.
    count: u32,
    /// Detects where frames can no longer be counted.
    walk: Option<Walk>,
    before: Option<f64>,
    /// Recent frame distances, s.
    steps: VecDeque<f64>,
    /// Frame distance at the rate stated in the file, s.
    stated: Option<f64>,
    /// Read at the first gap.
    packets: OnceCell<Option<Packets>>,
}

/// Number of frame distances from which the usual one is computed.
const REMEMBERED: usize = 9;
/// Multiple of the usual distance from which a frame may be missing.
const GAP: f64 = 1.5;
/// Frames per second that are accepted as a rate; other values are time bases.
const RATES: std::ops::RangeInclusive<f64> = 1.0..=250.0;

impl Losses {
    fn of(path: &Path, fps: f64) -> Self {
        Self {
            path: path.to_owned(),
            count: 0,
            walk: walk(path),
            before: None,
            steps: VecDeque::new(),
            stated: RATES.contains(&fps).then(|| 1.0 / fps),
            packets: OnceCell::new(),
        }
    }

    /// Adds the next frame and its time. Returns the number of the last frame before a loss, if there was one.
    fn enter(&mut self, seconds: Option<f64>) -> Option<u32> {
        self.count = self.count.saturating_add(1);
        if let Some(whole) = self.walk.as_mut().and_then(|walk| walk.whole_before(self.count)) {
            return Some(whole);
        }
        let before = std::mem::replace(&mut self.before, seconds);
        let (from, to) = before.zip(seconds)?;
        let mut steps: Vec<f64> = self.steps.iter().copied().collect();
        steps.sort_by(f64::total_cmp);
        let usual = steps.get(steps.len() / 2).copied().or(self.stated);
        let lost = usual.is_some_and(|usual| to - from > GAP * usual && self.lose(from, to, usual));
        if self.steps.len() == REMEMBERED {
            self.steps.pop_front();
        }
        self.steps.push_back(to - from);
        lost.then(|| self.count - 1)
    }

    fn lose(&mut self, from: f64, to: f64, usual: f64) -> bool {
        let packets = self.packets.get_or_init(|| Packets::of(&self.path, self.walk.as_mut()));
        packets.as_ref().is_some_and(|packets| packets.lose(from, to, usual))
    }
}

/// Whether a file begins with text. `FFmpeg` follows lists of files (`ffconcat`, `#EXTM3U`, an MPD) anywhere, to endless pipes and to
/// videos whose changes would go unnoticed. No supported container begins with text.
fn is_text(file: &mut impl Read) -> bool {
    const LOOKED_AT: u64 = 64;
    let mut begin = Vec::new();
    let is_letter = |b: &u8| matches!(b, b'\t' | b'\n' | b'\r' | b' '..=b'~' | 0x80..);
    file.take(LOOKED_AT).read_to_end(&mut begin).is_ok() && !begin.is_empty() && begin.iter().all(is_letter)
}
