//! `decode grey|colour FIRST MOST_PIXELS FILE`: says what the video's header says, then gives its frames from number FIRST (counted from 1)
//! on, each with its time where it is known, then how many it has.

use std::{ffi::OsString, path::Path};

use grimace::internal::companion::wire::Reply;
use opencv::{
    core::{CV_VERSION_MAJOR, CV_VERSION_MINOR, Mat, ROTATE_90_CLOCKWISE, ROTATE_90_COUNTERCLOCKWISE, ROTATE_180, rotate},
    imgproc::{COLOR_BGR2GRAY, COLOR_BGR2RGB, COLOR_GRAY2RGB, cvt_color_def},
    prelude::*,
    videoio::{
        CAP_ANY, CAP_PROP_FPS, CAP_PROP_FRAME_COUNT, CAP_PROP_FRAME_HEIGHT, CAP_PROP_FRAME_WIDTH, CAP_PROP_ORIENTATION_AUTO,
        CAP_PROP_ORIENTATION_META, CAP_PROP_POS_MSEC, VideoCapture,
    },
};

use crate::{
    Trouble, number,
    talk::{Talk, end_with_input},
};

pub fn run(arguments: &[OsString], talk: &mut Talk) -> Result<(), Trouble> {
    end_with_input();
    let is_coloured = arguments.first().is_some_and(|word| word == "colour");
    let (first, most) = (number::<u32>(arguments, 1)?, number::<u64>(arguments, 2)?);
    let path = Path::new(arguments.get(3).map(OsString::as_os_str).unwrap_or_default());
    let capture = VideoCapture::from_file(path, CAP_ANY).ok().filter(|c| c.is_opened().unwrap_or(false));
    let Some(mut capture) = capture else {
        let reason = "not a video that OpenCV can decode; convert it (for example to H.264 in MP4) or to images";
        return Err(Trouble::Failed(reason.to_owned()));
    };
    let turn = turn(&mut capture);
    let stated = |property| capture.get(property).unwrap_or(0.0);
    let side = |property| stated(property).max(0.0) as u32;
    let (width, height) = (side(CAP_PROP_FRAME_WIDTH), side(CAP_PROP_FRAME_HEIGHT));
    let lies = matches!(turn, Some(ROTATE_90_CLOCKWISE | ROTATE_90_COUNTERCLOCKWISE));
    let (width, height) = if lies { (height, width) } else { (width, height) };
    let finite = |value: f64| if value.is_finite() { value } else { 0.0 };
    let (fps, frames) = (finite(stated(CAP_PROP_FPS)), finite(stated(CAP_PROP_FRAME_COUNT)));
    talk.say(&Reply::Video { fps, frames, width, height })?;
    if u64::from(width) * u64::from(height) > most {
        // The other program says that it is too large, and how large a picture may be.
        return Ok(());
    }
    let (mut frame, mut converted, mut upright) = (Mat::default(), Mat::default(), Mat::default());
    let (mut count, mut before) = (0, None);
    loop {
        let of_frame = |error: opencv::Error| Trouble::Failed(format!("frame {}: OpenCV: {error}", count + 1));
        if !capture.read(&mut frame).map_err(of_frame)? || frame.empty() {
            break;
        }
        count += 1;
        let time = capture.get(CAP_PROP_POS_MSEC).ok().map(|ms| ms / 1e3).filter(|seconds| is_time(*seconds, before));
        before = time.or(before);
        if count < first {
            continue;
        }
        let (conversion, channels) = match (is_coloured, frame.channels()) {
            (false, 1) => (None, 1),
            (false, _) => (Some(COLOR_BGR2GRAY), 1),
            (true, 1) => (Some(COLOR_GRAY2RGB), 3),
            (true, _) => (Some(COLOR_BGR2RGB), 3),
        };
        let pixels = match conversion {
            None => &frame,
            Some(code) => {
                cvt_color_def(&frame, &mut converted, code)?;
                &converted
            }
        };
        let pixels = match turn {
            None => pixels,
            Some(turn) => {
                rotate(pixels, &mut upright, turn)?;
                &upright
            }
        };
        if let Some(seconds) = time {
            talk.say(&Reply::Time { seconds })?;
        }
        let size = (pixels.cols().max(0) as u32, pixels.rows().max(0) as u32);
        if pixels.is_continuous() {
            talk.show(size, channels, pixels.data_bytes()?)?;
        } else {
            talk.show(size, channels, pixels.try_clone()?.data_bytes()?)?;
        }
    }
    talk.say(&Reply::End { frames: count })?;
    Ok(())
}

/// Longest video that is believed, s: what is beyond it was never written as a time.
const LONGEST: f64 = 1e6;

/// Whether OpenCV knows a frame's time: frames that a decoder still held at the end of the file have 0.
fn is_time(seconds: f64, before: Option<f64>) -> bool {
    (0.0..LONGEST).contains(&seconds) && before.is_none_or(|before| seconds > before)
}

/// How frames have to be turned so that they stand as the video says: a telephone held upright films lying and says so.
///
/// OpenCV can do that by itself, but 4.6 takes clockwise for counterclockwise with the FFmpeg that Debian and Ubuntu have it with (mended in
/// 4.7), and shows such films upside down.
fn turn(capture: &mut VideoCapture) -> Option<i32> {
    if !capture.set(CAP_PROP_ORIENTATION_AUTO, 0.0).unwrap_or(false) {
        return None;
    }
    let stated = capture.get(CAP_PROP_ORIENTATION_META).ok().filter(|angle| angle.is_finite()).unwrap_or(0.0);
    let is_reversed = (CV_VERSION_MAJOR, CV_VERSION_MINOR) == (4, 6);
    let clockwise = if is_reversed { -stated } else { stated };
    match (clockwise.rem_euclid(360.0) / 90.0).round() as i32 {
        1 => Some(ROTATE_90_CLOCKWISE),
        2 => Some(ROTATE_180),
        3 => Some(ROTATE_90_COUNTERCLOCKWISE),
        _ => None,
    }
}
