//! Sequences of [`super::FACES`] as videos.

use std::ffi::OsString;

use grimace::internal::companion::{
    Answer, Companion,
    wire::{Reply, Request},
};

use super::{Work, grimace};

/// Writes the frames of a folder as a video, AVI (motion JPEG) or MP4 by its name; whether OpenCV has a writer for it here.
pub fn write_video(work: &Work, folder: &str, name: &str) -> bool {
    // Builds what this test starts where only one test program was built.
    grimace();
    let kind = name.rsplit('.').next().unwrap();
    let words = ["encode", kind, "25", "200", "160"].map(OsString::from);
    let mut writer = Companion::start(words.into_iter().chain([work.path(name).into_os_string()])).unwrap();
    match writer.receive(0).unwrap() {
        Answer::Said(Reply::Ready) => {}
        Answer::Said(Reply::NoEncoder { tried }) => {
            eprintln!("SKIPPED: this OpenCV does not write {tried}");
            return false;
        }
        other => panic!("{other:?}"),
    }
    for (_, bytes) in work.files(folder).iter().filter(|(name, _)| name.ends_with(".png")) {
        writer.send_pixels((200, 160), 3, image::load_from_memory(bytes).unwrap().to_rgb8().as_raw()).unwrap();
    }
    writer.send(&Request::End).unwrap();
    assert!(matches!(writer.receive(0).unwrap(), Answer::Said(Reply::Done)));
    true
}
