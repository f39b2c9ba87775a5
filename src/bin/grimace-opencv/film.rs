//! Decodes a video frame by frame.

use std::path::Path;

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

use crate::Trouble;

/// An open video positioned at one of its frames.
pub struct Film {
    capture: VideoCapture,
    turn: Option<i32>,
    frame: Mat,
    converted: Mat,
    upright: Mat,
}

/// Pixels of a frame: columns and rows, channels, rows from the top.
pub struct Picture {
    pub size: (u32, u32),
    pub channels: u8,
    pub data: Vec<u8>,
}

impl Film {
    pub fn open(path: &Path) -> Result<Self, Trouble> {
        let capture = VideoCapture::from_file(path, CAP_ANY).ok().filter(|c| c.is_opened().unwrap_or(false));
        let Some(mut capture) = capture else {
            let reason = "not a video that OpenCV can decode; convert it (for example to H.264 in MP4) or to images";
            return Err(Trouble::Failed(reason.to_owned()));
        };
        let turn = turn(&mut capture);
        Ok(Self { capture, turn, frame: Mat::default(), converted: Mat::default(), upright: Mat::default() })
    }

    /// Header data, and the number of pixels per frame by the header.
    pub fn header(&self) -> (Reply, u64) {
        let stated = |property| self.capture.get(property).unwrap_or(0.0);
        let side = |property| stated(property).max(0.0) as u32;
        let (width, height) = (side(CAP_PROP_FRAME_WIDTH), side(CAP_PROP_FRAME_HEIGHT));
        let lies = matches!(self.turn, Some(ROTATE_90_CLOCKWISE | ROTATE_90_COUNTERCLOCKWISE));
        let (width, height) = if lies { (height, width) } else { (width, height) };
        let finite = |value: f64| if value.is_finite() { value } else { 0.0 };
        let (fps, frames) = (finite(stated(CAP_PROP_FPS)), finite(stated(CAP_PROP_FRAME_COUNT)));
        (Reply::Video { fps, frames, width, height }, u64::from(width) * u64::from(height))
    }

    /// Advances to the next frame; returns whether there is one. `number` is its number, for errors.
    pub fn advance(&mut self, number: u32) -> Result<bool, Trouble> {
        let of_frame = |error: opencv::Error| Trouble::Failed(format!("frame {number}: OpenCV: {error}"));
        Ok(self.capture.read(&mut self.frame).map_err(of_frame)? && !self.frame.empty())
    }

    /// Time of the frame, s from the start of the video, if OpenCV knows it. `before` is the time of the last frame that has one.
    pub fn time(&self, before: Option<f64>) -> Option<f64> {
        self.capture.get(CAP_PROP_POS_MSEC).ok().map(|ms| ms / 1e3).filter(|seconds| is_time(*seconds, before))
    }

    /// Seeks to before the frame at a time, or near it; returns whether this was possible.
    pub fn seek(&mut self, seconds: f64) -> bool {
        self.capture.set(CAP_PROP_POS_MSEC, seconds * 1e3).unwrap_or(false)
    }

    /// Hash of the decoded frame.
    pub fn hash(&self) -> Result<blake3::Hash, Trouble> {
        if self.frame.is_continuous() {
            return Ok(blake3::hash(self.frame.data_bytes()?));
        }
        Ok(blake3::hash(self.frame.try_clone()?.data_bytes()?))
    }

    /// The frame rotated upright.
    pub fn picture(&mut self, is_coloured: bool) -> Result<Picture, Trouble> {
        let (conversion, channels) = match (is_coloured, self.frame.channels()) {
            (false, 1) => (None, 1),
            (false, _) => (Some(COLOR_BGR2GRAY), 1),
            (true, 1) => (Some(COLOR_GRAY2RGB), 3),
            (true, _) => (Some(COLOR_BGR2RGB), 3),
        };
        let pixels = match conversion {
            None => &self.frame,
            Some(code) => {
                cvt_color_def(&self.frame, &mut self.converted, code)?;
                &self.converted
            }
        };
        let pixels = match self.turn {
            None => pixels,
            Some(turn) => {
                rotate(pixels, &mut self.upright, turn)?;
                &self.upright
            }
        };
        let size = (pixels.cols().max(0) as u32, pixels.rows().max(0) as u32);
        let data =
            if pixels.is_continuous() { pixels.data_bytes()?.to_vec() } else { pixels.try_clone()?.data_bytes()?.to_vec() };
        Ok(Picture { size, channels, data })
    }
}

/// Longest plausible video, s; larger values are not times.
const LONGEST: f64 = 1e6;

/// Whether OpenCV knows a frame's time. Frames that a decoder still held at the end of the file have 0.
fn is_time(seconds: f64, before: Option<f64>) -> bool {
    (0.0..LONGEST).contains(&seconds) && before.is_none_or(|before| seconds > before)
}

/// Rotation that makes frames upright, as stated in the video: a telephone held upright films sideways and states so.
///
/// OpenCV can rotate frames itself, but 4.6 confuses clockwise and counterclockwise with the FFmpeg of Debian and Ubuntu (fixed in 4.7),
/// and shows such films upside down.
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
