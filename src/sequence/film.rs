//! Writes frames as a video file through `grimace-opencv`, if OpenCV has the codecs.

use std::{
    ffi::{OsStr, OsString},
    path::{Path, PathBuf},
};

use image::RgbImage;

use super::packets::set_random_numbers;
use crate::{
    companion::{
        Answer, Companion, CompanionError,
        wire::{Reply, Request},
    },
    output::{OutputError, PendingFolder},
};

/// Errors of writing a video.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// This OpenCV has no encoder for the format.
    #[error(
        "{}: this OpenCV has no encoder for {format} (tried {tried}); write frames, a GIF or an APNG instead, or install OpenCV's FFmpeg plug-in", path.display()
    )]
    NoEncoder {
        /// The file.
        path: PathBuf,
        /// `mp4` or `webm`.
        format: &'static str,
        /// Codecs tried, as four-character codes.
        tried: String,
    },
    /// The frame rate is so low that a film cannot store the duration of a frame.
    #[error("{}: a frame would last {seconds:.0} s, but a film can show a frame for at most {LONGEST_FRAME_S} s", path.display())]
    TooSlow {
        /// The file.
        path: PathBuf,
        /// Seconds per frame.
        seconds: f64,
    },
    /// The encoder wrote no file.
    #[error("{}: the encoder wrote nothing", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The program that encodes videos is missing or ended early.
    #[error(
        "{}: {source}{}",
        path.display(),
        if matches!(source, CompanionError::NotInstalled) { "; where a command writes GIF or APNG, these do not need it" } else { "" }
    )]
    Program {
        /// The file.
        path: PathBuf,
        /// The error.
        source: CompanionError,
    },
    /// The encoder failed.
    #[error("{}: the encoder failed: {reason}", path.display())]
    Encoder {
        /// The file.
        path: PathBuf,
        /// Its message.
        reason: String,
    },
}

/// Longest display time of a frame, s: the maximum of GIF.
pub const LONGEST_FRAME_S: f64 = 655.0;

/// Ticks per second of films whose own rate OpenCV cannot write.
const TICKS: f64 = 10.0;

/// Timing of a film's frames.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pace {
    /// Requested frames per second.
    fps: f64,
    /// Written frames per second.
    written: f64,
}

impl Pace {
    /// Chooses the written rate.
    ///
    /// OpenCV writes a rate as a whole number divided by 1, 10, 100, ..., and chooses the first one within a thousandth, which is a large
    /// error for a slow rate. If the error is visible, the film has ten ticks per second, and every frame is repeated for its number of
    /// ticks.
    fn of(path: &Path, fps: f64) -> Result<Self, FilmError> {
        /// Rate in frames per second from which an error of a thousandth is invisible, and the invisible share of error of slower rates.
        const USUAL: f64 = 1.0;
        const UNSEEN: f64 = 1e-4;
        if !(fps > 0.0 && 1.0 / fps <= LONGEST_FRAME_S) {
            return Err(FilmError::TooSlow { path: path.to_owned(), seconds: 1.0 / fps });
        }
        let mut base = 1.0;
        while ((fps * base + 0.5).floor() / base - fps).abs() > 1e-3 {
            base *= 10.0;
        }
        let off = ((fps * base + 0.5).floor() / base - fps).abs() / fps;
        let written = if fps >= USUAL || off < UNSEEN { fps } else { TICKS };
        Ok(Self { fps, written })
    }

    /// Number of repetitions of the frame with index `k`.
    fn times(self, k: usize) -> u64 {
        let end = |k: usize| (k as f64 * self.written / self.fps).round() as u64;
        if self.written.total_cmp(&self.fps).is_eq() { 1 } else { end(k + 1).saturating_sub(end(k)).max(1) }
    }
}

/// Checks that a film can be written, by starting and stopping its encoder. Callers that make frames before the film check first.
///
/// # Errors
/// As [`write_video`].
pub fn check_video(path: &Path, fps: f64, size: (u32, u32)) -> Result<(), FilmError> {
    // Beside the film, or where its folder will be: nothing is left, not even this folder.
    let here = Path::new(".");
    let above = path.ancestors().skip(1).map(|folder| if folder.as_os_str().is_empty() { here } else { folder });
    let place = above.into_iter().find(|folder| folder.is_dir()).unwrap_or(here);
    let scratch = tempfile::Builder::new().prefix(".grimace-").suffix(".tmp").tempdir_in(place);
    let scratch = scratch.map_err(OutputError::at(path))?;
    let (format, name) = format_of(path);
    let pace = Pace::of(path, fps)?;
    Encoder::start(path, &scratch.path().join(name), format, pace.written, even(size)).map(drop)
}

/// Format of a film by its extension, and its temporary name. OpenCV chooses the container by the extension, so the temporary name has it,
/// too.
fn format_of(path: &Path) -> (&'static str, &'static str) {
    let is_webm = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("webm"));
    if is_webm { ("webm", "film.webm") } else { ("mp4", "film.mp4") }
}

fn even((width, height): (u32, u32)) -> (u32, u32) {
    (width & !1, height & !1)
}

/// Writes frames of one size as MP4 or `WebM`, by the extension of the path.
///
/// Odd sides lose their last row or column, since video codecs require even ones. Frames are consumed one by one, so that memory does not
/// depend on length. Films with less than one frame per second may repeat every frame to keep their duration.
///
/// # Errors
/// [`FilmError`] when this OpenCV has no encoder for the format or the file cannot be written; the errors of `frames`.
pub fn write_video<E: From<FilmError>>(
    path: &Path,
    frames: impl IntoIterator<Item = Result<RgbImage, E>>,
    fps: f64,
) -> Result<(), E> {
    let mut frames = frames.into_iter();
    let first = frames.next().ok_or_else(|| FilmError::Empty { path: path.to_owned() })??;
    let scratch = PendingFolder::create(path).map_err(FilmError::from)?;
    let (format, name) = format_of(path);
    let temporary = scratch.file(name);
    let pace = Pace::of(path, fps)?;
    let mut encoder = Encoder::start(path, &temporary, format, pace.written, even(first.dimensions()))?;
    for (k, frame) in std::iter::once(Ok(first)).chain(frames).enumerate() {
        let frame = frame?;
        for _ in 0..pace.times(k) {
            encoder.write(&frame)?;
        }
    }
    encoder.finish()?;
    if std::fs::metadata(&temporary).map_or(0, |m| m.len()) == 0 {
        return Err(FilmError::Empty { path: path.to_owned() }.into());
    }
    if format == "webm" {
        set_random_numbers(&temporary).map_err(OutputError::at(path)).map_err(FilmError::from)?;
    }
    Ok(scratch.persist(name).map_err(FilmError::from)?)
}

/// An open video file.
struct Encoder<'a> {
    /// Its name in errors.
    path: &'a Path,
    format: &'static str,
    size: (u32, u32),
    companion: Companion,
}

impl<'a> Encoder<'a> {
    fn start(
        path: &'a Path,
        temporary: &Path,
        format: &'static str,
        fps: f64,
        (width, height): (u32, u32),
    ) -> Result<Self, FilmError> {
        let words = ["encode", format, &fps.to_string(), &width.to_string(), &height.to_string()];
        let arguments = words.iter().map(OsStr::new).chain([temporary.as_os_str()]).map(OsString::from);
        let companion = Companion::start(arguments).map_err(|source| FilmError::Program { path: path.to_owned(), source })?;
        let mut encoder = Self { path, format, size: (width, height), companion };
        encoder.expect(&Reply::Ready)?;
        Ok(encoder)
    }

    fn write(&mut self, frame: &RgbImage) -> Result<(), FilmError> {
        let (width, height) = self.size;
        let fitting: Vec<u8>;
        let pixels = if frame.dimensions() == self.size {
            frame.as_raw()
        } else {
            let pixel = |x: u32, y: u32| frame.get_pixel(x.min(frame.width() - 1), y.min(frame.height() - 1)).0;
            fitting = (0..height).flat_map(|y| (0..width).flat_map(move |x| pixel(x, y))).collect();
            &fitting
        };
        match self.companion.send_pixels(self.size, 3, pixels) {
            Ok(()) => Ok(()),
            // If the process stopped reading, its message has the reason.
            Err(source) => Err(self.failure(source)),
        }
    }

    fn finish(mut self) -> Result<(), FilmError> {
        if let Err(source) = self.companion.send(&Request::End) {
            return Err(self.failure(source));
        }
        self.expect(&Reply::Done)
    }

    fn expect(&mut self, expected: &Reply) -> Result<(), FilmError> {
        let path = self.path.to_owned();
        let failed = |source| FilmError::Program { path: path.clone(), source };
        match self.companion.receive(0).map_err(failed)? {
            Answer::Said(said) if said == *expected => Ok(()),
            Answer::Said(Reply::NoEncoder { tried }) => Err(FilmError::NoEncoder { path, format: self.format, tried }),
            Answer::Said(Reply::Failed { reason }) => Err(FilmError::Encoder { path, reason }),
            other => Err(failed(other.unexpected())),
        }
    }

    fn failure(&mut self, source: CompanionError) -> FilmError {
        match self.companion.receive(0) {
            Ok(Answer::Said(Reply::Failed { reason })) => FilmError::Encoder { path: self.path.to_owned(), reason },
            _ => FilmError::Program { path: self.path.to_owned(), source },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_films_last_as_long_as_they_should() {
        let path = Path::new("a.mp4");
        // Returns the number of frames and their duration in seconds.
        let film = |fps: f64, count: usize| {
            let pace = Pace::of(path, fps).unwrap();
            let frames: u64 = (0..count).map(|k| pace.times(k)).sum();
            (frames, frames as f64 / pace.written)
        };
        assert_eq!(film(25.0, 50), (50, 2.0));
        assert_eq!(film(0.05, 3), (3, 60.0));
        // OpenCV alone would write 0.333 and 0.1 frames per second, and nothing for the last.
        let (frames, seconds) = film(1.0 / 3.0, 1000);
        assert_eq!((frames, seconds.round()), (30_000, 3000.0));
        let (frames, seconds) = film(0.0994, 71);
        assert!(frames == 7143 && (seconds - 71.0 / 0.0994).abs() < 0.05, "{frames} {seconds}");
        assert_eq!(film(1.0 / 600.0, 2), (12_000, 1200.0));
        for fps in [1e-3, 1e-300, 0.0, -1.0] {
            assert!(matches!(Pace::of(path, fps), Err(FilmError::TooSlow { .. })), "{fps}");
        }
    }
}
