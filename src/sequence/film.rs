//! Writing frames as a video file through `grimace-opencv`, where OpenCV's codecs are there.

use std::{
    ffi::{OsStr, OsString},
    path::{Path, PathBuf},
};

use image::RgbImage;

use super::webm::set_random_numbers;
use crate::{
    companion::{
        Answer, Companion, CompanionError,
        wire::{Reply, Request},
    },
    output::{OutputError, PendingFolder},
};

/// A video that could not be written.
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
    /// The encoder gave no file.
    #[error("{}: the encoder wrote nothing", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The program that encodes videos is not there, or ended in the middle.
    #[error("{}: {source}", path.display())]
    Program {
        /// The file.
        path: PathBuf,
        /// What happened.
        source: CompanionError,
    },
    /// The encoder failed.
    #[error("{}: the encoder failed: {reason}", path.display())]
    Encoder {
        /// The file.
        path: PathBuf,
        /// What it says.
        reason: String,
    },
}

/// Tries whether a film could be written: its encoder is started and ended. Whoever makes frames first and a film of them later asks
/// before.
///
/// # Errors
/// As [`write_video`].
pub fn check_video(path: &Path, fps: f64, size: (u32, u32)) -> Result<(), FilmError> {
    let scratch = tempfile::tempdir().map_err(OutputError::at(path))?;
    let (format, name) = format_of(path);
    Encoder::start(path, &scratch.path().join(name), format, fps, even(size)).map(drop)
}

/// Format of a film by its extension, and its temporary name: the container follows the extension, so that has it too.
fn format_of(path: &Path) -> (&'static str, &'static str) {
    let is_webm = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("webm"));
    if is_webm { ("webm", "film.webm") } else { ("mp4", "film.mp4") }
}

fn even((width, height): (u32, u32)) -> (u32, u32) {
    (width & !1, height & !1)
}

/// Writes frames of one size as MP4 or `WebM`, by the extension of the path; odd sides lose their last row or column, as video codecs
/// want even ones. Frames are taken one after the other, so that a long film needs no more memory than a short one.
///
/// # Errors
/// [`FilmError`] when this OpenCV has no encoder for the format or the file cannot be written; what `frames` gives as error.
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
    let mut encoder = Encoder::start(path, &temporary, format, fps, even(first.dimensions()))?;
    for frame in std::iter::once(Ok(first)).chain(frames) {
        encoder.write(&frame?)?;
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

/// A film that is being written.
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
            // It says why it does not listen any more, if it can.
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
