//! Videos: frames after damage, and reading of earlier frames.

use std::path::Path;

use grimace::{
    dataset::FrameSource,
    sequence::{SequenceError, SequenceReader},
};
use image::{ImageFormat, RgbImage};

use crate::common::{
    Work,
    video::{matroska, write_pictures, write_video},
};

/// Number of bits of a frame number in a picture.
const BITS: u32 = 10;

/// Returns a picture that shows its number: a white or black column for each bit.
fn picture(number: u32) -> RgbImage {
    // Every row of bits is the same: it is drawn once, because the tests draw many of these.
    let bits: Vec<u8> = (0..20 * BITS).flat_map(|x| [255 * (number >> (x / 20) & 1) as u8; 3]).collect();
    let mut pixels = bits.repeat(140);
    for y in 140..160 {
        pixels.extend((0..200).flat_map(|x| [(60 + x / 2 + number * 7 % 50) as u8, (y + number % 40) as u8, 90]));
    }
    RgbImage::from_raw(200, 160, pixels).unwrap()
}

/// Returns the number that a decoded picture shows.
fn shown(image: &image::GrayImage) -> u32 {
    (0..BITS).map(|bit| u32::from(image.get_pixel(20 * bit + 10, 70).0[0] > 128) << bit).sum()
}

/// Returns the numbers of the frames of a video and of the pictures in them, up to the first error.
fn read(path: &Path, first: Option<u32>, last: Option<u32>) -> (Vec<(u32, u32)>, Option<SequenceError>) {
    let source = FrameSource::Video { path: path.to_owned(), first, last };
    let mut frames = Vec::new();
    for frame in SequenceReader::open(&source).unwrap() {
        match frame {
            Ok(frame) => frames.push((frame.number(), shown(frame.image()))),
            Err(error) => return (frames, Some(error)),
        }
    }
    (frames, None)
}

/// Checks a video of 20 frames that is damaged between frames 8 and 13: frames before the damage are read, frames after it are not.
fn check_damage(path: &Path) {
    let last = match read(path, None, None) {
        (frames, Some(SequenceError::Damaged { last, .. })) => {
            assert_eq!(frames, (1..=last).map(|number| (number, number)).collect::<Vec<_>>());
            last
        }
        other => panic!("{}: {other:?}", path.display()),
    };
    assert!((8..=13).contains(&last), "{}: {last}", path.display());
    let (frames, error) = read(path, Some(3), Some(last));
    assert!(error.is_none() && frames.len() as u32 == last - 2, "{error:?}");
    // Frames after the damage are refused, in either direction, whether earlier frames are requested or not.
    for (first, last) in [(Some(last + 2), None), (Some(1), Some(last + 1)), (Some(last + 2), Some(2))] {
        let (frames, error) = read(path, first, last);
        let is_reported = matches!(error, Some(SequenceError::Damaged { .. }));
        assert!(is_reported && frames.iter().all(|(number, shown)| number == shown), "{first:?} {last:?}: {frames:?} {error:?}");
    }
}

/// Returns a Matroska video with a broken cluster header.
fn without_cluster(mut video: Vec<u8>, place: usize) -> Vec<u8> {
    let clusters: Vec<usize> = (0..video.len() - 4).filter(|&k| video[k..k + 4] == [0x1F, 0x43, 0xB6, 0x75]).collect();
    video[clusters[place]..clusters[place] + 4].fill(0);
    video
}

#[test]
fn no_frame_after_damage_has_a_wrong_number() {
    let work = Work::new();
    let jpegs: Vec<Vec<u8>> = (1..=20)
        .map(|number| {
            let mut bytes = std::io::Cursor::new(Vec::new());
            picture(number).write_to(&mut bytes, ImageFormat::Jpeg).unwrap();
            bytes.into_inner()
        })
        .collect();
    let even: Vec<u64> = (0..20).map(|k| 40 * k).collect();
    let write = |name: &str, frames: &[Vec<u8>], times: &[u64]| {
        work.write(name, matroska(frames, times, Some(40), 800.0));
        work.path(name)
    };
    // A cluster with a damaged header: the reader continues with the next one.
    let whole = write("whole.mkv", &jpegs, &even);
    assert!(read(&whole, None, None).1.is_none());
    work.write("cluster.mkv", without_cluster(work.bytes("whole.mkv"), 10));
    check_damage(&work.path("cluster.mkv"));
    // A camera that left out frames.
    let mut uneven = even.clone();
    uneven[10..].iter_mut().for_each(|time| *time += 200);
    let (frames, error) = read(&write("camera.mkv", &jpegs, &uneven), None, None);
    assert!(error.is_none() && frames.len() == 20, "{error:?}");

    if write_pictures(&work, (1..=20).map(picture), "whole.avi") {
        let mut avi = work.bytes("whole.avi");
        let chunks: Vec<usize> = (0..avi.len() - 4).filter(|&k| &avi[k..k + 4] == b"00dc").collect();
        avi[chunks[10]..chunks[10] + 8].fill(0);
        work.write("chunk.avi", &avi);
        check_damage(&work.path("chunk.avi"));
        assert!(read(&work.path("whole.avi"), None, None).1.is_none());
    }
    // A picture that the decoder skips, or at which it stops: every frame has the right number, and no frame is missing without
    // an error.
    if write_pictures(&work, (1..=80).map(picture), "whole.webm") {
        assert!(read(&work.path("whole.webm"), None, None).1.is_none());
        let whole = work.bytes("whole.webm");
        for share in [3, 4, 5, 6, 7] {
            let mut webm = whole.clone();
            let place = webm.len() * share / 10;
            webm[place..place + 100].fill(0);
            work.write("picture.webm", &webm);
            let (frames, error) = read(&work.path("picture.webm"), None, None);
            // The bits of a returned frame may be damaged, but those after the next key frame are complete.
            assert!(frames.iter().zip(1..).all(|((number, _), expected)| *number == expected));
            assert!(frames.len() == 80 || error.is_some(), "{share}: {} frames", frames.len());
        }
    }
}

#[test]
fn the_command_says_up_to_which_frame_a_damaged_video_can_be_used() {
    let work = Work::with_sequences(&["S001_005"]);
    let frames: Vec<Vec<u8>> = work
        .files("faces/S001/005")
        .iter()
        .filter(|(name, _)| name.ends_with(".png"))
        .map(|(_, bytes)| {
            let mut jpeg = std::io::Cursor::new(Vec::new());
            image::load_from_memory(bytes).unwrap().to_luma8().write_to(&mut jpeg, ImageFormat::Jpeg).unwrap();
            jpeg.into_inner()
        })
        .collect();
    let video = matroska(&frames, &[0, 40, 80, 120, 160, 200], Some(40), 240.0);
    work.write("face.mkv", without_cluster(video, 3));
    let track = "track face.mkv -c faces/S001/005/correspondences.csv -o S001_1.csv";
    work.grimace(track).exit(1).says(&["face.mkv: damaged after frame 3", "use frames 1 to 3"]);
    work.grimace(&format!("{track} --last-frame 3")).exit(0).prints(&["3 frames"]);
}

#[test]
fn a_long_video_is_the_same_in_reverse() {
    let work = Work::new();
    // More frames than are held at a time; the bits encode numbers up to 1023.
    const COUNT: u32 = 1100;
    let numbers = || (1..=COUNT).map(|number| picture(number % 1024));
    for name in ["film.avi", "film.mp4"] {
        if !write_pictures(&work, numbers(), name) {
            continue;
        }
        let read = |first: u32, last: u32| -> Vec<_> {
            let source = FrameSource::Video { path: work.path(name), first: Some(first), last: Some(last) };
            SequenceReader::open(&source).unwrap().map(|frame| frame.unwrap()).collect()
        };
        let mut forward = read(1, COUNT);
        forward.reverse();
        let back = read(COUNT, 1);
        assert!(back == forward, "{name}: not the same frames");
        assert!(read(COUNT - 5, 500) == forward[5..=600], "{name}: not the same frames from the middle");
        assert!(back.iter().all(|frame| shown(frame.image()) == frame.number() % 1024));
    }
}

#[test]
#[cfg(unix)]
fn a_reversed_video_is_opened_once() {
    let work = Work::with_sequences(&["S001_005"]);
    if !write_video(&work, "faces/S001/005", "face.avi") {
        return;
    }
    // A decoder that counts how often it is started.
    let program = crate::common::grimace();
    let real = program.with_file_name("grimace-opencv");
    work.write("script", format!("#!/bin/sh\necho \"$1\" >> \"$0.log\"\nexec '{}' \"$@\"\n", real.display()));
    crate::common::install(&work.path("script"), &work.path("bin/grimace-opencv"));
    crate::common::install(program, &work.path("bin/grimace"));
    let track = "track face.avi -c faces/S001/005/correspondences.csv -o S001_1.csv --first-frame 6 --last-frame 1";
    let mut command = std::process::Command::new(work.path("bin/grimace"));
    let ran = command.current_dir(work.path(".")).args(track.split_whitespace()).output().unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let starts = work.read("bin/grimace-opencv.log");
    assert!(starts.lines().filter(|word| *word == "back").count() >= 1, "{starts}");
    // One pass for information about the neutral frame, one over all frames.
    assert!(starts.lines().count() <= 2, "{starts}");
}
