//! `encode mp4|webm FPS WIDTH HEIGHT FILE`: receives frames in colour until the end is announced, and writes them as a film.

use std::ffi::OsString;

use grimace::internal::companion::wire::{Reply, Request};
use opencv::{
    core::{Mat, Size, Vec3b},
    imgproc::{COLOR_RGB2BGR, cvt_color_def},
    prelude::*,
    videoio::VideoWriter,
};

use crate::{
    Trouble, number,
    talk::{Heard, Talk},
};

/// Codecs of a container, best first.
pub fn codecs(format: Option<&str>) -> Option<&'static [&'static [u8; 4]]> {
    match format? {
        "mp4" => Some(&[b"avc1", b"mp4v"]),
        "webm" => Some(&[b"VP90", b"VP80"]),
        // Every OpenCV has this codec; the tests write videos with it.
        "avi" => Some(&[b"MJPG"]),
        _ => None,
    }
}

pub fn run(arguments: &[OsString], talk: &mut Talk) -> Result<(), Trouble> {
    let codecs = codecs(arguments.first().and_then(|word| word.to_str()));
    let codecs = codecs.ok_or_else(|| Trouble::Failed("only mp4, webm and avi are written".to_owned()))?;
    let (fps, width, height) = (number::<f64>(arguments, 1)?, number::<i32>(arguments, 2)?, number::<i32>(arguments, 3)?);
    let path = arguments.get(4).map(|path| path.to_string_lossy().into_owned()).unwrap_or_default();
    let Some(mut writer) = open(&path, codecs, fps, Size::new(width, height))? else {
        let tried = codecs.iter().map(|c| String::from_utf8_lossy(*c).into_owned()).collect::<Vec<_>>().join(", ");
        talk.say(&Reply::NoEncoder { tried })?;
        return Ok(());
    };
    talk.say(&Reply::Ready)?;
    let mut converted = Mat::default();
    loop {
        match talk.hear()? {
            Heard::Picture(pixels) if pixels.channels == 3 && i64::from(pixels.width) == i64::from(width) => {
                let rows: Vec<Vec3b> = pixels.data.chunks_exact(3).map(|p| Vec3b::from([p[0], p[1], p[2]])).collect();
                let frame = Mat::new_rows_cols_with_data(height, width, &rows)?;
                cvt_color_def(&frame, &mut converted, COLOR_RGB2BGR)?;
                writer.write(&converted)?;
            }
            Heard::Picture(_) => return Err(Trouble::Failed("a frame of another size".to_owned())),
            Heard::Asked(Request::End) => break,
            Heard::Asked(_) | Heard::Nothing => return Err(Trouble::Gone),
        }
    }
    writer.release()?;
    talk.say(&Reply::Done)?;
    Ok(())
}

/// Opens a writer with the first codec that this OpenCV has.
fn open(path: &str, codecs: &[&[u8; 4]], fps: f64, size: Size) -> Result<Option<VideoWriter>, Trouble> {
    for codec in codecs {
        let [a, b, c, d] = codec.map(char::from);
        let fourcc = VideoWriter::fourcc(a, b, c, d)?;
        let writer = VideoWriter::new(path, fourcc, fps, size, true)?;
        if writer.is_opened()? {
            return Ok(Some(writer));
        }
    }
    Ok(None)
}
