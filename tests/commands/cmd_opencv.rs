//! `grimace` without `grimace-opencv`, with another version of it, and with one that fails.

use std::{ffi::OsString, fs, process::Command};

use grimace::internal::companion::{Answer, Companion, wire::Reply};

use crate::common::{Ran, Run, SEQUENCES, Work, grimace, install, video::write_video};

const MARKS: &str = "faces/S001/005/correspondences.csv";

#[test]
fn the_command_itself_links_no_opencv() {
    let program = fs::read(grimace()).unwrap();
    let name = b"libopencv_";
    assert!(!program.windows(name.len()).any(|bytes| bytes == name), "grimace starts slowly: it loads OpenCV");
}

/// Runs a copy of the command that is alone in `bin`, with `path` as the only folder of PATH.
fn alone(work: &Work, args: &str) -> Ran {
    let program = work.path("bin/grimace");
    if !program.exists() {
        install(grimace(), &program);
    }
    let mut command = Command::new(program);
    command.current_dir(work.path(".")).env("PATH", work.path("path")).args(args.split_whitespace());
    command.run()
}

#[test]
fn pictures_need_no_opencv_and_videos_say_what_is_missing() {
    let work = Work::with_sequences(&["S001_005"]);
    if !write_video(&work, "faces/S001/005", "face.avi") {
        return;
    }
    alone(&work, &format!("track faces/S001/005 -c {MARKS} -o S001_1.csv")).exit(0).prints(&["6 frames"]);
    let ran = alone(&work, &format!("track face.avi -c {MARKS} -o S001_2.csv")).exit(1);
    ran.says(&["face.avi: this needs grimace-opencv", "neither beside this program nor on PATH", "cargo install --path ."]);
    let ran = alone(&work, &format!("track faces/S001/005 -c {MARKS} -o S001_2.csv --klt opencv")).exit(1);
    ran.says(&["this needs grimace-opencv"]);
    // The command knows that a film is impossible before it draws frames.
    let clone =
        format!("clone --source S001_1.csv --target faces/S001/005/S001_005_00000001.png -c {MARKS} -o film --film gif,mp4");
    alone(&work, &clone).exit(1).says(&["film/clone.mp4: this needs grimace-opencv"]);
    assert!(!work.path("film").exists());
    // In a run this does not count as a failure of the sequence.
    let manifest = format!("subject,sequence,emotion,frames,correspondences\nS001,1,happiness,../face.avi,../{MARKS}\n");
    work.write("films/manifest.csv", &manifest);
    alone(&work, "run films -o out").exit(1).says(&["S001_1", "this needs grimace-opencv"]);
    let checked = alone(&work, "check films").exit(3);
    let checked = checked.prints(&["`run` would stop at track: S001_1: ", "this needs grimace-opencv"]);
    assert!(!checked.stdout.contains("next:"), "{}", checked.stdout);
    // A frame that the video does not have according to its header.
    let manifest = manifest.replace("frames,", "frames,last_frame,").replace("face.avi,", "face.avi,500,");
    work.write("films/manifest.csv", manifest);
    work.grimace("check films").exit(3).prints(&["`last_frame` is 500, but the header of the video states 6 frames", "next:"]);
}

#[test]
fn inputs_that_need_no_opencv_are_recognized_beside_videos() {
    let work = Work::after_run(&SEQUENCES, "R");
    if !write_video(&work, "faces/S001/005", "anna.avi") {
        return;
    }
    let ran = alone(&work, "recognize --with R anna.avi R/tracks -o all.csv").exit(3).prints(&["6 sequences recognized"]);
    ran.says(&["failed: anna_1 at track: ", "this needs grimace-opencv"]);
}

#[test]
fn the_klt_of_opencv_gives_nearly_the_same_nodes() {
    let work = Work::with_sequences(&["S001_005"]);
    for (klt, track) in [("grimace", "S001_1"), ("opencv", "S001_2")] {
        work.grimace(&format!("track faces/S001/005 -c {MARKS} -o {track}.csv --klt {klt}")).exit(0);
        let info: serde_json::Value = serde_json::from_str(&work.read(&format!("{track}.json"))).unwrap();
        assert_eq!(info["track"]["klt"], klt);
    }
    let mut distances: Vec<f64> = work
        .rows("S001_1.csv")
        .iter()
        .zip(work.rows("S001_2.csv"))
        .map(|(a, b)| {
            let side = |name: &str| a[name].parse::<f64>().unwrap() - b[name].parse::<f64>().unwrap();
            side("x").hypot(side("y"))
        })
        .collect();
    distances.sort_by(f64::total_cmp);
    let (middle, most) = (distances[distances.len() / 2], distances[distances.len() * 95 / 100]);
    assert!(middle < 0.01 && most < 0.03, "median {middle} px, 95 % {most} px");
}

/// Writes a shell script in place of `grimace-opencv`.
#[cfg(unix)]
fn script(folder: &std::path::Path, text: &str) {
    fs::create_dir_all(folder).unwrap();
    let script = folder.join("script");
    fs::write(&script, format!("#!/bin/sh\n{text}\n")).unwrap();
    install(&script, &folder.join("grimace-opencv"));
}

#[test]
#[cfg(unix)]
fn a_failing_or_wrong_decoder_fails_only_its_video() {
    let work = Work::with_sequences(&["S001_005"]);
    work.write("face.avi", "any bytes\0");
    // The first message is the text {"hello":{"version":3}}; then a video without frames, and nothing else.
    let hello = r#"printf '\000\027\000\000\000{"hello":{"version":3}}'"#;
    let video = r#"printf '\000\070\000\000\000{"video":{"fps":25,"frames":9,"width":200,"height":160}}'"#;
    let huge = r#"printf '\001\377\377\377\377\377\377\000\000\377\377\000\000\003'"#;
    let cases = [
        ("exit 0".to_owned(), "grimace-opencv ended before its work was done"),
        ("echo hello world, I am another program".to_owned(), "has another version than this program"),
        (r#"printf '\000\027\000\000\000{"hello":{"version":9}}'; cat"#.to_owned(), "has another version than this program"),
        (format!("{hello}; kill -SEGV $$"), "grimace-opencv ended before its work was done (signal: 11"),
        (format!("{hello}; {video}; kill -SEGV $$"), "grimace-opencv ended before its work was done (signal: 11"),
        (format!("{hello}; {video}; {huge}; cat"), "gave an unknown answer: a picture of 65535x65535"),
    ];
    for (text, said) in cases {
        script(&work.path("bin"), &text);
        let ran = alone(&work, &format!("track face.avi -c {MARKS} -o S001_1.csv")).exit(1);
        ran.says(&["face.avi: ", said]);
    }
}

#[test]
fn lists_of_files_are_not_videos_and_colons_are_not_protocols() {
    let work = Work::with_sequences(&["S001_005"]);
    if !crate::common::video::write_video(&work, "faces/S001/005", "real.avi") {
        return;
    }
    work.write("list.mp4", "ffconcat version 1.0\nfile real.avi\n");
    work.grimace(&format!("track list.mp4 -c {MARKS} -o S001_1.csv"))
        .exit(1)
        .says(&["list.mp4: ", "this is a text file, such as a list of other files"]);
    #[cfg(unix)]
    {
        fs::rename(work.path("real.avi"), work.path("10:20.avi")).unwrap();
        work.grimace(&format!("track 10:20.avi -c {MARKS} -o S001_1.csv")).exit(0);
        work.grimace(&format!("track 10:20.avi -c {MARKS} -o S001_2.csv --first-frame 41 --last-frame 1"))
            .exit(1)
            .says(&["but `first_frame` is 41"]);
    }
}

#[test]
fn the_program_explains_its_purpose() {
    let program = grimace().with_file_name(format!("grimace-opencv{}", std::env::consts::EXE_SUFFIX));
    let run = |word: &str| Command::new(&program).arg(word).run();
    run("--help").exit(0).prints(&["started by it", "grimace --help"]);
    run("--version").exit(0).prints(&[&format!("grimace-opencv {}", env!("CARGO_PKG_VERSION"))]);
    run("nonsense").exit(2).says(&["grimace --help"]);
}

/// Returns the first frame of a video, in grey.
fn first_frame(path: &std::path::Path) -> image::GrayImage {
    let words = ["decode", "grey", "1", "1000000"].map(OsString::from);
    let mut reader = Companion::start(words.into_iter().chain([path.as_os_str().to_owned()])).unwrap();
    assert!(matches!(reader.receive(0).unwrap(), Answer::Said(Reply::Video { .. })));
    assert!(matches!(reader.receive(0).unwrap(), Answer::Said(Reply::Time { seconds: 0.0 })));
    match reader.receive::<Reply>(1_000_000).unwrap() {
        Answer::Pixels(pixels) => image::GrayImage::from_raw(pixels.width, pixels.height, pixels.data).unwrap(),
        other => panic!("{other:?}"),
    }
}

/// A phone films lying on its side and records the rotation: its matrix maps x to y and y to -x for a quarter turn clockwise.
#[test]
fn a_film_has_the_stated_rotation() {
    let work = Work::with_sequences(&["S001_005"]);
    if !write_video(&work, "faces/S001/005", "film.mp4") {
        return;
    }
    let (plain, bytes) = (first_frame(&work.path("film.mp4")), work.bytes("film.mp4"));
    let matrix = bytes.windows(4).position(|four| four == b"tkhd").unwrap() + 4 + 40;
    let turned = |name: &str, ab_cd: [i32; 4]| {
        let mut bytes = bytes.clone();
        for (value, place) in ab_cd.into_iter().zip([0, 4, 12, 16]) {
            bytes[matrix + place..matrix + place + 4].copy_from_slice(&(value << 16).to_be_bytes());
        }
        work.write(name, bytes);
        first_frame(&work.path(name))
    };
    assert!(turned("clockwise.mp4", [0, 1, -1, 0]) == image::imageops::rotate90(&plain));
    assert!(turned("back.mp4", [0, -1, 1, 0]) == image::imageops::rotate270(&plain));
    assert!(turned("over.mp4", [-1, 0, 0, -1]) == image::imageops::rotate180(&plain));
}
