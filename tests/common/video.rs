//! Makes videos from sequences of [`super::FACES`].

use std::ffi::OsString;

use grimace::internal::companion::{
    Answer, Companion,
    wire::{Reply, Request},
};

use super::{Work, grimace};

/// Writes the frames of a folder as a video, AVI (motion JPEG) or MP4 by its extension. Returns whether OpenCV has a writer for it here.
pub fn write_video(work: &Work, folder: &str, name: &str) -> bool {
    let files = work.files(folder);
    let pictures = files.iter().filter(|(name, _)| name.ends_with(".png"));
    write_pictures(work, pictures.map(|(_, bytes)| image::load_from_memory(bytes).unwrap().to_rgb8()), name)
}

/// Writes pictures of 200 x 160 px like [`write_video`].
pub fn write_pictures(work: &Work, pictures: impl Iterator<Item = image::RgbImage>, name: &str) -> bool {
    // Builds the programs that this test starts, in case only one test program was built.
    grimace();
    let kind = name.rsplit('.').next().unwrap();
    let words = ["encode", kind, "25", "200", "160"].map(OsString::from);
    let mut writer = Companion::start(words.into_iter().chain([work.path(name).into_os_string()])).unwrap();
    match writer.receive(0).unwrap() {
        Answer::Said(Reply::Ready) => {}
        Answer::Said(Reply::NoEncoder { tried }) => {
            eprintln!("SKIPPED: this OpenCV cannot write {tried}");
            return false;
        }
        other => panic!("{other:?}"),
    }
    for picture in pictures {
        writer.send_pixels((200, 160), 3, picture.as_raw()).unwrap();
    }
    writer.send(&Request::End).unwrap();
    assert!(matches!(writer.receive(0).unwrap(), Answer::Said(Reply::Done)));
    true
}

/// Returns a Matroska video of JPEG pictures with the given times, ms. `frame_ms` is the stated duration of a frame (no rate is stated
/// without it), and `length_ms` the stated duration of the video.
pub fn matroska(frames: &[Vec<u8>], times: &[u64], frame_ms: Option<u64>, length_ms: f64) -> Vec<u8> {
    let element = |number: &[u8], content: &[u8]| {
        // A length of 8 bytes, as the first byte states.
        let length = (content.len() as u64 | 1 << 56).to_be_bytes();
        [number, &length, content].concat()
    };
    let picture = image::load_from_memory(&frames[0]).unwrap();
    let [width, height] = [picture.width(), picture.height()].map(u32::to_be_bytes);
    let info = [element(&[0x2A, 0xD7, 0xB1], &1_000_000_u32.to_be_bytes()), element(&[0x44, 0x89], &length_ms.to_be_bytes())];
    let sides = [element(&[0xB0], &width), element(&[0xBA], &height)];
    let track = [
        element(&[0xD7], &[1]),
        element(&[0x73, 0xC5], &[1]),
        element(&[0x83], &[1]),
        element(&[0x86], b"V_MJPEG"),
        frame_ms.map(|ms| element(&[0x23, 0xE3, 0x83], &(ms * 1_000_000).to_be_bytes())).unwrap_or_default(),
        element(&[0xE0], &sides.concat()),
    ];
    let cluster = |(frame, time): (&Vec<u8>, &u64)| {
        let block = [&[0x81, 0, 0, 0x80], frame.as_slice()].concat();
        element(&[0x1F, 0x43, 0xB6, 0x75], &[element(&[0xE7], &time.to_be_bytes()), element(&[0xA3], &block)].concat())
    };
    let clusters: Vec<u8> = frames.iter().zip(times).flat_map(cluster).collect();
    let segment = [
        element(&[0x15, 0x49, 0xA9, 0x66], &info.concat()),
        element(&[0x16, 0x54, 0xAE, 0x6B], &element(&[0xAE], &track.concat())),
        clusters,
    ];
    [
        element(&[0x1A, 0x45, 0xDF, 0xA3], &element(&[0x42, 0x82], b"matroska")),
        element(&[0x18, 0x53, 0x80, 0x67], &segment.concat()),
    ]
    .concat()
}
