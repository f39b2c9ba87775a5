//! Writing frames as a video file through OpenCV, where its codecs are there.

use std::path::{Path, PathBuf};

use image::RgbImage;
use opencv::{
    core::{Mat, Size, Vec3b},
    prelude::*,
    videoio::VideoWriter,
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
    /// The file can not be moved to its name.
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
/// want even ones.
///
/// # Errors
/// [`FilmError`] when this OpenCV has no encoder for the format or the file can not be written.
pub fn write_video(path: &Path, frames: &[RgbImage], fps: f64) -> Result<(), FilmError> {
    let is_webm = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("webm"));
    let (format, codecs) = if is_webm { WEBM } else { MP4 };
    let Some(first) = frames.first() else { return Err(FilmError::Empty { path: path.to_owned() }) };
    let size = Size::new((first.width() & !1) as i32, (first.height() & !1) as i32);
    let io = |source| FilmError::Io { path: path.to_owned(), source };
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(io)?;
    // The container follows the extension, so the temporary name has it too.
    let scratch = tempfile::Builder::new().prefix(".grimace-").tempdir_in(folder).map_err(io)?;
    let temporary = scratch.path().join(format!("film.{format}"));
    let name = temporary.to_string_lossy().into_owned();
    for codec in codecs {
        let [a, b, c, d] = codec.map(char::from);
        let mut writer = VideoWriter::new(&name, VideoWriter::fourcc(a, b, c, d)?, fps, size, true)?;
        if !writer.is_opened()? {
            continue;
        }
        for frame in frames {
            writer.write(&bgr(frame, size)?)?;
        }
        writer.release()?;
        let written = std::fs::metadata(&temporary).map_or(0, |m| m.len());
        if written == 0 {
            return Err(FilmError::Empty { path: path.to_owned() });
        }
        return std::fs::rename(&temporary, path).map_err(io);
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
