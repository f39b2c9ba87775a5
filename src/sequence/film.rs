//! Writing frames as a video file through OpenCV, where its codecs are there.

use std::path::{Path, PathBuf};

use image::RgbImage;
use opencv::{
    core::{Mat, Size, Vec3b},
    prelude::*,
    videoio::VideoWriter,
};

use super::webm::set_random_numbers;

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
    /// The file cannot be moved to its name.
    #[error("cannot write {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// OpenCV failed.
    #[error("OpenCV: {0}")]
    OpenCv(#[from] opencv::Error),
}

/// Codecs of a container, best first.
const MP4: (&str, &[&[u8; 4]]) = ("mp4", &[b"avc1", b"mp4v"]);
const WEBM: (&str, &[&[u8; 4]]) = ("webm", &[b"VP90", b"VP80"]);

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
    let io = |source| FilmError::Io { path: path.to_owned(), source };
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(io)?;
    // The container follows the extension, so the temporary name has it too.
    let scratch = tempfile::Builder::new().prefix(".grimace-").tempdir_in(folder).map_err(io)?;
    let is_webm = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("webm"));
    let temporary = scratch.path().join(if is_webm { "film.webm" } else { "film.mp4" });
    let size = Size::new((first.width() & !1) as i32, (first.height() & !1) as i32);
    let mut writer = open_writer(path, &temporary, if is_webm { WEBM } else { MP4 }, size, fps)?;
    for frame in std::iter::once(Ok(first)).chain(frames) {
        let frame: RgbImage = frame?;
        bgr(&frame, size).and_then(|mat| writer.write(&mat)).map_err(FilmError::from)?;
    }
    writer.release().map_err(FilmError::from)?;
    if std::fs::metadata(&temporary).map_or(0, |m| m.len()) == 0 {
        return Err(FilmError::Empty { path: path.to_owned() }.into());
    }
    if is_webm {
        set_random_numbers(&temporary).map_err(io)?;
    }
    Ok(std::fs::rename(&temporary, path).map_err(io)?)
}

/// A writer with the first codec that this OpenCV has.
fn open_writer(
    path: &Path,
    temporary: &Path,
    (format, codecs): (&'static str, &[&[u8; 4]]),
    size: Size,
    fps: f64,
) -> Result<VideoWriter, FilmError> {
    let name = temporary.to_string_lossy().into_owned();
    for codec in codecs {
        let [a, b, c, d] = codec.map(char::from);
        let writer = VideoWriter::new(&name, VideoWriter::fourcc(a, b, c, d)?, fps, size, true)?;
        if writer.is_opened()? {
            return Ok(writer);
        }
    }
    let tried = codecs.iter().map(|c| String::from_utf8_lossy(*c).into_owned()).collect::<Vec<_>>().join(", ");
    Err(FilmError::NoEncoder { path: path.to_owned(), format, tried })
}

fn bgr(frame: &RgbImage, size: Size) -> Result<Mat, opencv::Error> {
    let pixels: Vec<Vec3b> = (0..size.height as u32)
        .flat_map(|y| (0..size.width as u32).map(move |x| (x, y)))
        .map(|(x, y)| {
            let [r, g, b] = frame.get_pixel(x.min(frame.width() - 1), y.min(frame.height() - 1)).0;
            Vec3b::from([b, g, r])
        })
        .collect();
    Mat::new_rows_cols_with_data(size.height, size.width, &pixels)?.try_clone()
}
