//! Sequences of [`super::FACES`] as videos.

use opencv::{
    core::{Mat, Size},
    imgcodecs::{IMREAD_COLOR, imdecode},
    prelude::*,
    videoio::VideoWriter,
};

use super::Work;

/// Writes the frames of a folder as a video of motion JPEG; whether OpenCV has a writer for it here.
pub fn write_video(work: &Work, folder: &str, name: &str) -> bool {
    opencv::core::set_log_level(opencv::core::LogLevel::LOG_LEVEL_SILENT).unwrap();
    let codec = VideoWriter::fourcc('M', 'J', 'P', 'G').unwrap();
    let path = work.path(name);
    let mut writer = VideoWriter::new(&path, codec, 25.0, Size::new(200, 160), true).unwrap();
    if !writer.is_opened().unwrap() {
        eprintln!("SKIPPED: this OpenCV does not write motion JPEG");
        return false;
    }
    for (_, bytes) in work.files(folder).iter().filter(|(name, _)| name.ends_with(".png")) {
        writer.write(&imdecode(&Mat::from_slice(bytes).unwrap(), IMREAD_COLOR).unwrap()).unwrap();
    }
    writer.release().unwrap();
    true
}
