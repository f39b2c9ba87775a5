//! `decode grey|colour FIRST MOST_PIXELS FILE`: says what the video's header says, then gives its frames from number FIRST (counted from 1)
//! on, then how many it has.

use std::{ffi::OsString, path::Path};

use grimace::internal::companion::wire::Reply;
use opencv::{
    core::Mat,
    imgproc::{COLOR_BGR2GRAY, COLOR_BGR2RGB, COLOR_GRAY2RGB, cvt_color_def},
    prelude::*,
    videoio::{CAP_ANY, CAP_PROP_FPS, CAP_PROP_FRAME_COUNT, CAP_PROP_FRAME_HEIGHT, CAP_PROP_FRAME_WIDTH, VideoCapture},
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
    let stated = |property| capture.get(property).unwrap_or(0.0);
    let side = |property| stated(property).max(0.0) as u32;
    let (width, height) = (side(CAP_PROP_FRAME_WIDTH), side(CAP_PROP_FRAME_HEIGHT));
    let finite = |value: f64| if value.is_finite() { value } else { 0.0 };
    let (fps, frames) = (finite(stated(CAP_PROP_FPS)), finite(stated(CAP_PROP_FRAME_COUNT)));
    talk.say(&Reply::Video { fps, frames, width, height })?;
    if u64::from(width) * u64::from(height) > most {
        // The other program says that it is too large, and how large a picture may be.
        return Ok(());
    }
    let (mut frame, mut converted) = (Mat::default(), Mat::default());
    let mut count = 0;
    loop {
        let of_frame = |error: opencv::Error| Trouble::Failed(format!("frame {}: OpenCV: {error}", count + 1));
        if !capture.read(&mut frame).map_err(of_frame)? || frame.empty() {
            break;
        }
        count += 1;
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
