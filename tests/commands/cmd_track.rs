//! `grimace track`: commands and their output, with frames of every format and with invalid frames.

use crate::common::{
    Work, assert_same_files,
    video::{matroska, write_video},
};
use image::{DynamicImage, ImageFormat};
use opencv::{
    core::{CV_16U, Mat, Vector},
    imgcodecs::{IMREAD_UNCHANGED, imdecode, imencode},
    prelude::*,
};

const MARKS: &str = "faces/S001/005/correspondences.csv";
const TRACK: &str = "track faces/S001/005 -c faces/S001/005/correspondences.csv -o S001_005.csv";

fn work() -> Work {
    Work::with_sequences(&["S001_005"])
}

/// Returns the name of a frame of the sequence, from 1.
fn frame(number: usize) -> String {
    format!("faces/S001/005/S001_005_{number:08}.png")
}

/// Returns the mean distance between the nodes of two tracks, px.
fn mean_difference(work: &Work, a: &str, b: &str) -> f64 {
    let (a, b) = (work.rows(a), work.rows(b));
    assert_eq!(a.len(), b.len());
    let value = |row: &std::collections::BTreeMap<String, String>, axis: &str| row[axis].parse::<f64>().unwrap();
    let distance = |(a, b)| (value(a, "x") - value(b, "x")).hypot(value(a, "y") - value(b, "y"));
    a.iter().zip(&b).map(distance).sum::<f64>() / a.len() as f64
}

#[test]
fn a_track_has_every_node_of_every_frame_and_records_its_inputs() {
    let work = work();
    let ran = work.grimace(&format!("{TRACK} --emotion Happiness --fps 25 --overlay pictures")).exit(0);
    ran.prints(&["6 frames, ", "% of the nodes tracked, mean forward-backward distance", "eye distance"]);
    assert_eq!(work.header("S001_005.csv"), "frame,node,x,y,state,residual,expected_error");
    let rows = work.rows("S001_005.csv");
    assert_eq!(rows.len(), 6 * 113);
    let follows = |node: &str| ["4", "35", "36", "37", "38", "39", "41", "42", "43"].contains(&node);
    for row in &rows {
        let state = row["state"].as_str();
        match (row["frame"].as_str(), follows(&row["node"])) {
            (_, true) => assert_eq!(state, "follows"),
            ("1", _) => assert!(["marked", "fitted"].contains(&state), "{row:?}"),
            _ => assert!(state == "tracked" || state.starts_with("recovered_"), "{row:?}"),
        }
    }
    let info: serde_json::Value = serde_json::from_str(&work.read("S001_005.json")).unwrap();
    assert_eq!((&info["subject"], &info["sequence"], &info["emotion"]), (&"S001".into(), &"005".into(), &"happiness".into()));
    assert_eq!(info["image_size"], serde_json::json!({ "width": 200, "height": 160 }));
    assert_eq!(info["source"][5], "S001_005_00000006.png");
    assert_eq!(info["marks"].as_array().unwrap().len(), 11);
    assert_eq!(info["fps"], 25.0);
    assert!(info["units"]["x"].as_str().unwrap().starts_with("px"));
    assert!(["good", "look_again"].contains(&info["summary"]["verdict"].as_str().unwrap()));
    assert!(info["summary"]["expected_error_px"].as_f64().unwrap() > 0.0);
    assert_eq!(work.files("pictures").keys().filter(|name| name.ends_with(".png")).count(), 6);
}

#[test]
fn run_and_track_give_the_same_positions() {
    let work = work();
    work.grimace(TRACK).exit(0);
    work.grimace("run faces -o out").exit(0);
    assert_eq!(work.read("S001_005.csv"), work.read("out/tracks/S001_005.csv"));
}

#[test]
fn the_paper_s_method_is_one_switch_and_each_of_its_parts_a_flag() {
    let work = work();
    work.grimace(&format!("{TRACK} --method kp")).exit(0);
    let options = |name: &str| {
        let info: serde_json::Value = serde_json::from_str(&work.read(name)).unwrap();
        (info["fit"]["prior"].clone(), info["track"].clone())
    };
    let (prior, kp) = options("S001_005.json");
    assert_eq!(prior, "none");
    assert_eq!((&kp["forces"], &kp["forward_backward"], &kp["align"]["gain"]), (&"same".into(), &0.0.into(), &0.0.into()));
    assert_eq!((&kp["lip_probes"], &kp["rigid_eyes"], &kp["deform"]), (&false.into(), &false.into(), &true.into()));
    // Without tracking backward there is no residual.
    assert!(work.rows("S001_005.csv").iter().filter(|r| r["frame"] != "1").all(|r| r["residual"].is_empty()));
    assert_eq!((&kp["align"]["corners"], &kp["read_lids"], &kp["locate_lost"]), (&0.0.into(), &false.into(), &false.into()));
    assert_eq!(kp["read_lips"], false);
    let parts = "--prior none --forces same --forward-backward 0 --align-gain 0 --corner-stiffness 0 --lip-probes off \
                 --rigid-eyes off --even-light off --read-lids off --read-lips off --locate-lost off";
    let by_hand = TRACK.replace("-o S001_005.csv", "-o S001_006.csv");
    work.grimace(&format!("{by_hand} {parts}")).exit(0);
    assert_eq!(work.read("S001_005.csv"), work.read("S001_006.csv"));
    // Options given together with --method have precedence.
    work.grimace(&format!("{TRACK} --force --method kp --lip-probes on --deform off")).exit(0);
    let (_, changed) = options("S001_005.json");
    assert_eq!((&changed["lip_probes"], &changed["deform"], &changed["forces"]), (&true.into(), &false.into(), &"same".into()));
    work.grimace(&format!("{TRACK} --force --lip-probes maybe")).exit(2).says(&["expected on or off"]);
    work.grimace("run faces -o out --method kp").exit(0);
    let record: serde_json::Value = serde_json::from_str(&work.read("out/run.json")).unwrap();
    assert_eq!((&record["method"], &record["options"]["statistics"]["weighting"]), (&"kp".into(), &"sequence".into()));
}

#[test]
fn first_and_last_frame_cut_the_sequence() {
    let work = work();
    let ran = work.grimace(&format!("{TRACK} --first-frame 1 --last-frame 4")).exit(0);
    ran.prints(&["4 frames"]);
    let ran = work.grimace(&format!("{TRACK} --force --first-frame 3 --last-frame 9")).exit(1);
    ran.says(&["last_frame is 9, but the folder has no such frame; it has 6 frames from 1 to 6"]);
    assert_eq!(work.rows("S001_005.csv").len(), 4 * 113);
}

#[test]
fn tracks_are_not_written_over_without_force() {
    let work = work();
    work.write("S001_005.csv", "mine");
    work.grimace(TRACK).exit(1).says(&["S001_005.csv exists", "--force"]);
    assert_eq!(work.read("S001_005.csv"), "mine");
}

#[test]
fn corrections_by_hand_are_applied_to_a_track_that_is_made_again() {
    let work = work();
    work.grimace(&format!("track faces/S001/005 -c {MARKS} -o tracks/S001_005.csv")).exit(0);
    let file = "frame,node,x,y\n3,31,90.5,140.25\n";
    work.write("corrections/S001_005.csv", file);
    work.grimace(&format!("track faces/S001/005 -c {MARKS} -o tracks/S001_005.csv --force")).exit(0);
    assert!(work.read("tracks/S001_005.csv").contains("\n3,31,90.5,140.25,corrected"));
    assert_eq!(work.read("corrections/S001_005.csv"), file);
    // The track of a part has no frame 99: the correction is reported and kept.
    work.write("corrections/S001_005.csv", format!("{file}99,31,1,1\n"));
    let ran = work.grimace(&format!("track faces/S001/005 -c {MARKS} -o tracks/S001_005.csv --force")).exit(0);
    ran.prints(&["corrections/S001_005.csv no longer fits the track and is kept, but not applied: frame 99, node 31"]);
}

/// Tracks the sequence of `work` with its frames encoded by `encode`, in a folder and a track of this name.
fn track_as(work: &Work, name: &str, extension: &str, encode: impl Fn(&[u8]) -> Vec<u8>) {
    for number in 1..=6 {
        let bytes = encode(&work.bytes(&frame(number)));
        // Numbers without leading zeros: frame 10 must follow frame 9.
        work.write(&format!("{name}/f{}.{extension}", number + 6), bytes);
    }
    work.grimace(&format!("track {name} -c {MARKS} -o {name}.csv")).exit(0).prints(&["6 frames"]);
}

/// Like [`track_as`]; returns the mean distance to the track of the original frames, px.
fn tracked_as(extension: &str, encode: impl Fn(&[u8]) -> Vec<u8>) -> f64 {
    let work = work();
    work.grimace(TRACK).exit(0);
    track_as(&work, "other", extension, encode);
    mean_difference(&work, "S001_005.csv", "other.csv")
}

fn with_image(format: ImageFormat, change: impl Fn(DynamicImage) -> DynamicImage) -> impl Fn(&[u8]) -> Vec<u8> {
    move |bytes| {
        let mut out = std::io::Cursor::new(Vec::new());
        change(image::load_from_memory(bytes).unwrap()).write_to(&mut out, format).unwrap();
        out.into_inner()
    }
}

/// Encodes with OpenCV, in 16 bits if requested, so that not only the output of this project's encoders is read.
fn with_opencv(extension: &'static str, sixteen_bits: bool, flags: &'static [i32]) -> impl Fn(&[u8]) -> Vec<u8> {
    move |bytes| {
        let mut mat = imdecode(&Mat::from_slice(bytes).unwrap(), IMREAD_UNCHANGED).unwrap();
        if sixteen_bits {
            let mut deep = Mat::default();
            mat.convert_to(&mut deep, CV_16U, 257.0, 0.0).unwrap();
            mat = deep;
        }
        let mut out = Vector::<u8>::new();
        assert!(imencode(extension, &mat, &mut out, &Vector::from_slice(flags)).unwrap());
        out.to_vec()
    }
}

/// Returns the grey pixels of an image file as a binary PGM.
fn grey_map(bytes: &[u8]) -> Vec<u8> {
    let image = image::load_from_memory(bytes).unwrap().to_luma8();
    [format!("P5\n# by hand\n{} {}\n255\n", image.width(), image.height()).as_bytes(), image.as_raw()].concat()
}

#[test]
fn the_same_grey_pixels_give_the_same_track_in_every_lossless_format() {
    let work = work();
    let opencv_writes =
        |extension: &'static str, sixteen_bits| move |bytes: &[u8]| with_opencv(extension, sixteen_bits, &[])(&grey_map(bytes));
    track_as(&work, "pgm", "pgm", grey_map);
    track_as(&work, "png", "PNG", with_image(ImageFormat::Png, |i| i.to_luma8().into()));
    track_as(&work, "bmp", "BMP", opencv_writes(".bmp", false));
    track_as(&work, "tif", "tif", opencv_writes(".tif", false));
    // A grey level times 257 is the same share of 65535.
    track_as(&work, "tiff16", "tiff", opencv_writes(".tiff", true));
    track_as(&work, "png16", "png", opencv_writes(".png", true));
    let deep_map = |bytes: &[u8]| {
        let image = image::load_from_memory(bytes).unwrap().to_luma8();
        let pixels: Vec<u8> = image.as_raw().iter().flat_map(|&v| [v, v]).collect();
        [format!("P5\n{} {}\n65535\n", image.width(), image.height()).as_bytes(), &pixels].concat()
    };
    track_as(&work, "pgm16", "pgm", deep_map);
    let expected = work.read("pgm.csv");
    for name in ["png", "bmp", "tif", "tiff16", "png16", "pgm16"] {
        assert!(work.read(&format!("{name}.csv")) == expected, "{name}");
    }
}

#[test]
fn colour_is_read_in_every_format_and_depth() {
    // Decoders round or truncate when they convert to grey: this changes a grey level by one and moves nodes by some hundredths
    // of a pixel.
    let near = 0.05;
    assert!(tracked_as("png", with_image(ImageFormat::Png, |i| i)) == 0.0, "the same pixels");
    assert!(tracked_as("png", with_image(ImageFormat::Png, |i| i.to_luma8().into())) < near, "grey PNG");
    assert!(tracked_as("png", with_image(ImageFormat::Png, |i| i.to_rgba8().into())) < near, "PNG with alpha");
    assert!(tracked_as("png", with_opencv(".png", true, &[])) < near, "16-bit PNG");
    assert!(tracked_as("bmp", with_opencv(".bmp", false, &[])) < near, "BMP");
    assert!(tracked_as("tif", with_opencv(".tif", false, &[])) < near, "TIFF");
    assert!(tracked_as("tiff", with_opencv(".tiff", true, &[])) < near, "16-bit TIFF");
}

#[test]
fn jpeg_of_good_quality_moves_nodes_little() {
    let jpeg = |bytes: &[u8]| {
        let mut out = Vec::new();
        let image = image::load_from_memory(bytes).unwrap().to_rgb8();
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut out, 95).encode_image(&image).unwrap();
        out
    };
    let moved = tracked_as("jpg", jpeg);
    assert!(moved > 0.0 && moved < 0.5, "{moved} px");
}

#[test]
fn a_video_is_a_sequence() {
    let work = work();
    if !write_video(&work, "faces/S001/005", "face.avi") {
        return;
    }
    work.grimace(&format!("track face.avi -c {MARKS} -o S001_1.csv")).exit(0).prints(&["6 frames"]);
    let info: serde_json::Value = serde_json::from_str(&work.read("S001_1.json")).unwrap();
    assert_eq!((&info["fps"], &info["source"]), (&25.0.into(), &serde_json::json!(["face.avi"])));
    work.grimace(TRACK).exit(0);
    let moved = mean_difference(&work, "S001_005.csv", "S001_1.csv");
    assert!(moved < 0.5, "motion JPEG moves nodes by {moved} px");
    let ran = work.grimace(&format!("track face.avi -c {MARKS} -o S001_2.csv --first-frame 1 --last-frame 4")).exit(0);
    ran.prints(&["4 frames"]);
    let ran = work.grimace(&format!("track face.avi -c {MARKS} -o S001_3.csv --last-frame 40")).exit(1);
    ran.says(&["face.avi: ends at frame 6, but `last_frame` is 40"]);
    work.grimace(&format!("track face.avi -c {MARKS} -o S001_3.csv --first-frame 9")).exit(1).says(&["face.avi: has 6 frames"]);
    let ran = work.grimace(&format!("track face.avi -c {MARKS} -o S001_3.csv --first-frame 6")).exit(1);
    ran.says(&["face.avi", "at least 2 frames"]);
}

/// Returns the frames of the sequence as JPEG.
fn jpegs(work: &Work) -> Vec<Vec<u8>> {
    let jpeg = with_image(ImageFormat::Jpeg, |image| image.to_rgb8().into());
    (1..=6).map(|number| jpeg(&work.bytes(&frame(number)))).collect()
}

/// Returns the frame rate and the frame times from the `.json` of a track.
fn rate_and_times(work: &Work, json: &str) -> (f64, Option<Vec<f64>>) {
    let info: serde_json::Value = serde_json::from_str(&work.read(json)).unwrap();
    let times = info.get("times").map(|times| serde_json::from_value(times.clone()).unwrap());
    (info["fps"].as_f64().unwrap(), times)
}

#[test]
fn frames_of_a_video_have_their_own_times() {
    let work = work();
    let frames = jpegs(&work);
    // No rate is stated: OpenCV takes the time base for the rate, 1000 frames per second.
    let uneven = [0, 40, 80, 160, 240, 320];
    work.write("films/uneven.mkv", matroska(&frames, &uneven, None, 400.0));
    work.write("films/even.mkv", matroska(&frames, &[40, 120, 200, 280, 360, 440], None, 520.0));
    let marks = format!("../{MARKS}");
    let row = |sequence: &str, file: &str, rest: &str| format!("S001,{sequence},happiness,{file}.mkv,{marks},{rest}\n");
    let rows = [row("1", "uneven", ",,"), row("2", "uneven", "6,1,"), row("3", "uneven", ",,25"), row("4", "even", ",,")];
    let header = "subject,sequence,emotion,frames,correspondences,first_frame,last_frame,fps\n";
    work.write("films/manifest.csv", header.to_owned() + &rows.concat());
    work.grimace("run films -o out").exit(0);
    let own: Vec<f64> = uneven.iter().map(|&ms| ms as f64 / 1e3).collect();
    let times = |sequence: u32| -> Vec<f64> {
        work.rows(&format!("out/features/S001_{sequence}.csv")).iter().map(|row| row["timestamp"].parse().unwrap()).collect()
    };
    let of = |sequence: u32| rate_and_times(&work, &format!("out/tracks/S001_{sequence}.json"));
    assert_eq!((of(1), times(1)), ((15.625, Some(own.clone())), own.clone()));
    assert_eq!((of(2), times(2)), ((15.625, Some(own.clone())), own.clone()), "times that decrease");
    // A stated rate is used.
    assert_eq!((of(3), times(3)), ((25.0, None), vec![0.0, 0.04, 0.08, 0.12, 0.16, 0.2]));
    assert_eq!((of(4), times(4)), ((12.5, None), vec![0.0, 0.08, 0.16, 0.24, 0.32, 0.4]));
    // Its FAPs are equally spaced: 0.32 s at 16 frames per second.
    let fap = work.read("out/fap/tracks/S001_1.fap");
    assert!(fap.starts_with("2.1 S001_1 16 6\n"), "{}", &fap[..40]);
    // Models take frames at equal times: their second frame is the third of the track, at 0.08 s. By frame number it would be
    // the second.
    assert_ne!(work.read("out/models/S001_1.csv"), work.read("out/models/S001_3.csv"));
    // Reading the files again gives the same result.
    work.grimace("features out/tracks -o again").exit(0);
    assert_eq!(work.read("again/S001_1.csv"), work.read("out/features/S001_1.csv"));
    let ran = work.grimace(&format!("track films/uneven.mkv -c {MARKS} -o S001_9.csv")).exit(0);
    ran.prints(&["the frames are 40 to 80 ms apart (mean rate: 15.63 frames per second); every frame keeps its own time"]);
    work.grimace(&format!("track films/uneven.mkv -c {MARKS} -o S001_8.csv --fps 30")).exit(0);
    assert_eq!(rate_and_times(&work, "S001_8.json"), (30.0, None));
}

#[test]
fn without_a_stated_rate_frames_have_their_recorded_times() {
    let work = work();
    let frames = jpegs(&work);
    work.write("films/uneven.mkv", matroska(&frames, &[0, 40, 80, 160, 240, 320], None, 400.0));
    work.write("films/even.mkv", matroska(&frames, &[40, 120, 200, 280, 360, 440], None, 520.0));
    let table = |fps: &str| {
        let row = |sequence, file, range| format!("S001,{sequence},happiness,{file},../{MARKS},{range},{fps}\n");
        let rows =
            [row(1, "uneven.mkv", ","), row(2, "uneven.mkv", "6,2"), row(3, "even.mkv", ","), row(4, "../faces/S001/005", ",")];
        "subject,sequence,emotion,frames,correspondences,first_frame,last_frame,fps\n".to_owned() + &rows.concat()
    };
    for fps in ["20", "", "12.5", "20"] {
        work.write("films/manifest.csv", table(fps));
        let again = work.path("out").exists();
        let ran = work.grimace("run films -o out --no-faces").exit(0);
        ran.prints(&[if again { "4 sequences: 0 tracked, 4 unchanged" } else { "4 sequences: 4 tracked, 0 unchanged" }]);
        if !work.path(&format!("fresh{fps}")).exists() {
            work.grimace(&format!("run films -o fresh{fps} --no-faces")).exit(0);
        }
        assert_same_files(&work.files("out"), &work.files(&format!("fresh{fps}")));
    }
    // The state after a run that ended early and left only its tracks.
    work.write("films/manifest.csv", table(""));
    for name in work.files("out").keys().filter(|name| !name.starts_with("tracks/")) {
        std::fs::remove_file(work.path("out").join(name)).unwrap();
    }
    work.grimace("run films -o out --no-faces --force").exit(0).prints(&["4 sequences: 0 tracked, 4 unchanged"]);
    assert_same_files(&work.files("out"), &work.files("fresh"));
}

#[test]
fn a_video_with_dropped_frames_is_complete_and_a_truncated_one_is_not() {
    let work = work();
    let frames = jpegs(&work);
    // The rate is 25 frames per second, and 9 or 25 frames follow from the duration.
    let times = [0, 40, 120, 160, 240, 320];
    work.write("dropped.mkv", matroska(&frames, &times, Some(40), 360.0));
    work.write("cut.mkv", matroska(&frames, &times, Some(40), 1000.0));
    work.grimace(&format!("track dropped.mkv -c {MARKS} -o S001_1.csv")).exit(0).prints(&["6 frames", "40 to 80 ms apart"]);
    let ran = work.grimace(&format!("track cut.mkv -c {MARKS} -o S001_2.csv")).exit(1);
    ran.says(&["cut.mkv: ends unexpectedly at frame 6 of 25; the file is truncated or damaged"]);
    // An AVI states its number of frames. 5 times the sequence, cut where the last frame begins: the decoder also omits the one
    // before it.
    for copy in 1..=4 {
        for number in 1..=6 {
            work.write(&format!("faces/S001/005/copy_{copy}_{number}.png"), work.bytes(&frame(number)));
        }
    }
    if !write_video(&work, "faces/S001/005", "whole.avi") {
        return;
    }
    let whole = work.bytes("whole.avi");
    let chunks: Vec<usize> = (0..whole.len() - 4).filter(|&k| &whole[k..k + 4] == b"00dc").collect();
    work.write("cut.avi", &whole[..chunks[29] + 2]);
    let ran = work.grimace(&format!("track cut.avi -c {MARKS} -o S001_3.csv")).exit(0);
    ran.prints(&["28 frames,", "the file has only 28 of the 30 frames that its header announces; it may be truncated"]);
    let ran = work.grimace(&format!("track whole.avi -c {MARKS} -o S001_4.csv")).exit(0);
    assert!(!ran.stdout.contains("may be truncated"), "{}", ran.stdout);
}

#[test]
fn a_dataset_may_hold_videos() {
    let work = work();
    if !write_video(&work, "faces/S001/005", "films/face.avi") {
        return;
    }
    let marks = format!("../{MARKS}");
    work.write(
        "films/manifest.csv",
        format!("subject,sequence,emotion,frames,correspondences\nS001,1,happiness,face.avi,{marks}\nS002,1,happiness,torn.avi,{marks}\nS003,1,happiness,text.avi,{marks}\nS004,1,happiness,empty.avi,{marks}\n"),
    );
    let video = work.bytes("films/face.avi");
    work.write("films/torn.avi", &video[..200]).write("films/text.avi", "no video").write("films/empty.avi", "");
    let ran = work.grimace("run films -o out").exit(3).prints(&["4 sequences: 1 tracked, 0 unchanged, 3 failed"]);
    for name in ["torn", "text", "empty"] {
        assert!(ran.stderr.contains(&format!("{name}.avi: not a video that OpenCV can decode; convert it")), "{}", ran.stderr);
    }
}

/// Runs `track` on the damaged sequence of `work`, and checks the message.
#[track_caller]
fn refused(work: &Work, texts: &[&str]) {
    work.grimace(TRACK).exit(1).says(texts);
    assert!(!work.path("S001_005.csv").exists() && !work.path("S001_005.json").exists());
}

#[test]
fn files_that_are_not_frames_are_reported() {
    let work = work();
    let bytes = work.bytes(&frame(4));
    work.write(&frame(4), "");
    refused(&work, &["S001_005_00000004.png: the file is empty"]);
    work.write(&frame(4), &bytes[..bytes.len() - 40]);
    refused(&work, &["S001_005_00000004.png: the PNG image is cut off"]);
    work.write(&frame(4), "GIF89a and more");
    refused(&work, &["S001_005_00000004.png: not an image in a known format", "GIF89a"]);
    let mut damaged = bytes.clone();
    let half = damaged.len() / 2;
    damaged[half..half + 64].fill(0);
    work.write(&frame(4), damaged);
    refused(&work, &["S001_005_00000004.png", "damaged"]);
    std::fs::remove_file(work.path(&frame(4))).unwrap();
    work.grimace(TRACK).exit(0).prints(&["5 frames"]);
}

#[test]
fn a_truncated_jpeg_and_tiff_are_reported() {
    for (extension, encode) in [(".jpg", with_opencv(".jpg", false, &[])), (".tif", with_opencv(".tif", false, &[]))] {
        let work = work();
        let whole = encode(&work.bytes(&frame(4)));
        work.write(&format!("faces/S001/005/S001_005_00000004{extension}"), &whole[..whole.len() * 2 / 3]);
        std::fs::remove_file(work.path(&frame(4))).unwrap();
        refused(&work, &[&format!("S001_005_00000004{extension}")]);
    }
}

#[test]
fn frames_of_another_size_are_named() {
    let work = work();
    let small = image::load_from_memory(&work.bytes(&frame(3))).unwrap().crop_imm(0, 0, 180, 160);
    small.save(work.path(&frame(3))).unwrap();
    refused(
        &work,
        &["S001_005_00000003.png", "is 180x160 where the first frame is 200x160; all frames of a sequence must have one size"],
    );
}

#[test]
fn two_photographs_may_be_cropped_and_scaled_differently() {
    let work = Work::new();
    let portrait = image::open(crate::common::root().join("fixtures/portraits/P01.jpg")).unwrap();
    portrait.save(work.path("neutral.png")).unwrap();
    let (left, top, scale) = (50, 40, 0.8);
    let cropped = portrait.crop_imm(left, top, portrait.width() - 60, portrait.height() - 60);
    let side = |px: u32| (f64::from(px) * scale).round() as u32;
    cropped
        .resize_exact(side(cropped.width()), side(cropped.height()), image::imageops::Lanczos3)
        .save(work.path("apex.png"))
        .unwrap();
    work.grimace("track neutral.png;apex.png -o pair.csv --overlay pictures").exit(0);
    let rows = work.rows("pair.csv");
    let (neutral, apex) = rows.split_at(113);
    let value = |row: &std::collections::BTreeMap<String, String>, axis: &str| row[axis].parse::<f64>().unwrap();
    let seen = |at: f64, from: u32| (at - f64::from(from) + 0.5) * scale - 0.5;
    let off = |(a, b)| (seen(value(a, "x"), left) - value(b, "x")).hypot(seen(value(a, "y"), top) - value(b, "y"));
    let mean = neutral.iter().zip(apex).map(off).sum::<f64>() / 113.0;
    // The pupils are 86 px apart in the second picture.
    assert!(mean < 0.9, "{mean} px");
    work.grimace("features pair.csv -o features").exit(0);
    let names = crate::common::files_in(&work.path("features"));
    let table = names.keys().find(|name| name.ends_with(".csv")).unwrap();
    let last = work.rows(&format!("features/{table}")).pop().unwrap();
    assert!(last["AU12_r"].parse::<f64>().unwrap() < 0.3 && last["AU17_r"].parse::<f64>().unwrap() < 0.3);
}

#[test]
fn folders_that_are_not_sequences_are_refused() {
    let work = work();
    let track = |sequence: &str| work.grimace(&format!("track {sequence} -c {MARKS} -o S001_005.csv")).exit(1);
    work.write("one/f1.png", work.bytes(&frame(1))).write("none/a.txt", "x");
    track("one").says(&["one: 1 frame from neutral to apex; at least 2 are needed"]);
    track("none").says(&["none: no images in the folder (extensions of images: png"]);
    // A file that is or may be a frame is never left out silently.
    work.write("heic/f1.png", work.bytes(&frame(1))).write("heic/f2.png", work.bytes(&frame(2))).write("heic/f3.HEIC", "x");
    track("heic").says(&["heic/f3.HEIC: this looks like a frame, but its format is not supported; convert it to PNG"]);
    track("nowhere").says(&["nowhere: there is no such folder of frames or video file"]);
    track("none/a.txt").says(&["a.txt: is neither a folder of images nor a video file"]);
}

#[test]
fn marks_that_do_not_make_a_fit_name_their_file() {
    let work = work();
    let track = |marks: &str| {
        work.write("marks.csv", marks);
        work.grimace("track faces/S001/005 -c marks.csv -o S001_005.csv").exit(1)
    };
    track("node,x,y\n20,80,60\n53,120,60\n").says(&["marks.csv: 2 correspondences; at least 3"]);
    track("node,x,y\n20,80,60\n53,100,60\n56,120,60\n").says(&["marks.csv: the 3 marks lie on one line"]);
    track("node,x,y\n20,80,60\n53,120,60\n10,100,1000\n")
        .says(&["marks.csv: node 10 is marked at (100, 1000), outside the image"]);
    work.grimace("track faces/S001/005 -c none.csv -o S001_005.csv").exit(1).says(&["none.csv: cannot be read"]);
}

#[test]
fn a_missing_face_is_reported_as_lost() {
    let work = work();
    let grey = image::GrayImage::from_pixel(200, 160, image::Luma([128]));
    for number in 3..=6 {
        grey.save(work.path(&frame(number))).unwrap();
    }
    refused(&work, &["frame 3: only", "of 104 nodes could be tracked; the face is lost"]);
}

#[test]
fn corrections_off_the_face_are_applied_and_reported_and_those_off_the_picture_are_refused() {
    let work = work();
    work.grimace(TRACK).exit(0);
    let place = |node: &str| {
        let rows = work.rows("S001_005.csv");
        let row = rows.iter().find(|r| r["frame"] == "3" && r["node"] == node).unwrap().clone();
        (row["x"].clone(), row["y"].clone(), row["state"].clone())
    };
    let tracked = place("64");
    work.write("corrections/S001_005.csv", "frame,node,x,y\n3,31,5,5\n3,64,9000,1\n");
    let far = "S001_005.csv is applied, but these corrections lie far from the expected place; check them: frame 3, node 31 at (5, 5): ";
    let outside = "no longer fits the track and is kept, but not applied: frame 3, node 64: it lies outside the image";
    let ran = work.grimace(&format!("{TRACK} --force")).exit(0).prints(&[far, " eye distances", outside]);
    assert!(!ran.stdout.contains("node 64 at"));
    assert_eq!(place("31"), ("5".to_owned(), "5".to_owned(), "corrected".to_owned()));
    assert_eq!(place("64").2, tracked.2);
    let beside = tracked.0.parse::<f64>().unwrap() + 4.0;
    work.write("corrections/S001_005.csv", format!("frame,node,x,y\n3,64,{beside},{}\n", tracked.1));
    assert!(!work.grimace(&format!("{TRACK} --force")).exit(0).stdout.contains("check them"));
    assert_eq!(place("64").2, "corrected");
}
