//! `grimace clone` end to end.

use std::io::Cursor;

use crate::common::{Ran, Work};
use grimace::internal::fap::{FapNumber, read_fap};
use image::{DynamicImage, ImageFormat, RgbImage};

/// Makes a folder with S001's happiness as `faces`, its track as `S001_005.csv`, and S002's neutral frame as `target.png` with `marks.csv`.
fn work() -> Work {
    let work = Work::with_sequences(&["S001_005", "S002_005"]);
    work.grimace("track faces/S001/005 -c faces/S001/005/correspondences.csv -o S001_005.csv --emotion happiness -q").exit(0);
    let target = work.bytes("faces/S002/005/S002_005_00000001.png");
    work.write("target.png", target);
    let marks = work.read("faces/S002/005/correspondences.csv");
    work.write("marks.csv", marks);
    work
}

fn clone(work: &Work, args: &str) -> Ran {
    work.grimace(&format!("clone --target target.png --correspondences marks.csv {args}"))
}

fn picture(work: &Work, name: &str) -> RgbImage {
    image::load_from_memory(&work.bytes(name)).unwrap().to_rgb8()
}

#[test]
fn a_track_on_a_photograph_gives_frames_track_fap_overlay_sheet_and_films() {
    let work = work();
    clone(&work, "--source S001_005.csv --source-frames faces/S001/005 --wrinkles -o out --film gif,apng")
        .exit(0)
        .prints(&["6 frames at 25 frames per second: S001_005 on target"]);
    let files = work.files("out");
    let names: Vec<&str> = files.keys().map(String::as_str).collect();
    let expected = [
        "clone.apng",
        "clone.fap",
        "clone.gif",
        "clone.json",
        "frames.b3",
        "frames/target_00000001.png",
        "frames/target_00000002.png",
        "frames/target_00000003.png",
        "frames/target_00000004.png",
        "frames/target_00000005.png",
        "frames/target_00000006.png",
        "overlay.png",
        "sheet.png",
        "track/target_S001-005.csv",
        "track/target_S001-005.json",
    ];
    assert_eq!(names, expected);
    let (first, last) = (picture(&work, "out/frames/target_00000001.png"), picture(&work, "out/frames/target_00000006.png"));
    assert_eq!(first, picture(&work, "target.png"), "the first frame equals the neutral photograph, bit for bit");
    assert_ne!(first, last);
    // The target smiles like the source: the corners of its mouth move out and up.
    let fap = read_fap(&work.path("out/clone.fap")).unwrap().sequence;
    let apex = fap.frames.last().unwrap();
    for number in [53, 54, 59, 60] {
        assert!(apex.value(FapNumber::try_from(number).unwrap()).unwrap() > 20.0, "FAP {number}");
    }
    work.grimace("fap check out/clone.fap").exit(0);
    work.grimace("analyze out/track -o analysed").exit(0).prints(&["1 track, 0 failed", "happiness"]);
}

#[test]
fn a_sheet_shows_the_face_of_a_wide_picture() {
    let work = work();
    let target = picture(&work, "target.png");
    let (width, height) = target.dimensions();
    let mut wide = RgbImage::from_pixel(3 * width, height, image::Rgb([90; 3]));
    image::imageops::replace(&mut wide, &target, i64::from(width), 0);
    wide.save(work.path("wide.png")).unwrap();
    let moved = |row: &std::collections::BTreeMap<String, String>| {
        format!("{},{},{}\n", row["node"], row["x"].parse::<f64>().unwrap() + f64::from(width), row["y"])
    };
    work.write("wide.csv", "node,x,y\n".to_owned() + &work.rows("marks.csv").iter().map(moved).collect::<String>());
    work.grimace(
        "clone --source S001_005.csv --source-frames faces/S001/005 --target wide.png --correspondences wide.csv -o wide",
    )
    .exit(0);
    // Two rows of five; no cell is wider than the area around the face. The frames are whole pictures.
    assert_eq!(picture(&work, "wide/frames/wide_00000006.png").dimensions(), wide.dimensions());
    let sheet = picture(&work, "wide/sheet.png");
    assert!(sheet.width() <= 5 * (width + 6) + 6 && sheet.height() > height, "{:?}", sheet.dimensions());
}

#[test]
fn a_clone_is_the_same_to_the_byte_and_is_not_written_over() {
    let work = work();
    clone(&work, "--source S001_005.csv -o a").exit(0);
    clone(&work, "--source S001_005.csv -o b").exit(0);
    crate::common::assert_same_files(&work.files("a"), &work.files("b"));
    clone(&work, "--source S001_005.csv -o a").exit(0).prints(&["a already holds this clone", "nothing written"]);
    clone(&work, "--source S001_005.csv -o a --fps 50").exit(1).says(&["clone.json exists; give --force to overwrite it"]);
    clone(&work, "--source S001_005.csv -o a --fps 50 --force").exit(0);
    assert_eq!(work.files("a/frames").len(), 11);
    clone(&work, "--source S001_005.csv -o a --force").exit(0);
    assert_eq!(work.files("a/frames").len(), 6, "frames of the longer clone are gone");
    // A folder with a newer schema version is left unchanged, with and without --force.
    let (record, files) = (work.read("a/clone.json"), work.files("a/frames"));
    work.write("a/clone.json", record.replacen("\"schema_version\": 1", "\"schema_version\": 9", 1));
    let said = ["a/clone.json: schema version 9", "or choose another folder"];
    clone(&work, "--source S001_005.csv -o a --fps 50 --force").exit(1).says(&said);
    crate::common::assert_same_files(&work.files("a/frames"), &files);
    work.write("a/clone.json", record);
    // Files that somebody added or changed are kept.
    clone(&work, "--source S001_005.csv -o a --fps 50 --force").exit(0);
    work.write("a/frames/mine.png", "mine");
    work.write("a/frames/target_00000011.png", "retouched");
    let ran = clone(&work, "--source S001_005.csv -o a --force").exit(0);
    ran.says(&["a/frames/target_00000011.png: this file of an earlier clone was changed by hand and is kept"]);
    assert_eq!(work.files("a/frames").len(), 8);
    work.write("b2/frames/target_00000002.png", "mine");
    clone(&work, "--source S001_005.csv -o b2").exit(1).says(&["b2 is not empty", "--force to write into it"]);
    assert_eq!(work.read("b2/frames/target_00000002.png"), "mine");
    // With --force it overwrites files with its names and keeps the rest.
    work.write("b2/mine.txt", "mine");
    clone(&work, "--source S001_005.csv -o b2 --force").exit(0);
    assert_eq!(work.read("b2/mine.txt"), "mine");
    assert_ne!(work.bytes("b2/frames/target_00000002.png"), b"mine");
}

#[test]
fn films_and_tracks_of_an_earlier_clone_are_removed_with_its_frames() {
    let work = work();
    clone(&work, "--source S001_005.csv -o a --film gif,apng").exit(0);
    work.write("raised.fap", fap_file(&[31, 32], "200 200"));
    clone(&work, "--source raised.fap -o a --force --film apng").exit(0);
    let names = work.files("a");
    assert!(!names.contains_key("clone.gif") && names.contains_key("clone.apng"), "{:?}", names.keys());
    assert!(!names.contains_key("track/target_S001-005.csv") && names.contains_key("track/target_raised.csv"));
    // A changed file and an unrecorded file of an earlier clone are reported.
    work.write("a/clone.apng", "cut");
    work.write("a/clone.gif", "of version 0.1.0");
    let ran = clone(&work, "--source S001_005.csv -o a --force").exit(0);
    ran.says(&["a/clone.apng: this file of an earlier clone", "a/clone.gif: this file of an earlier clone"]);
    assert_eq!((work.read("a/clone.apng").as_str(), work.read("a/clone.gif").as_str()), ("cut", "of version 0.1.0"));
}

#[test]
fn duration_rate_loop_and_emphasis_take_effect() {
    let work = work();
    work.grimace("analyze S001_005.csv -o analysed -q").exit(0);
    clone(&work, "--source analysed -o out")
        .exit(1)
        .says(&["analysed: this is a folder; name a motion in it, such as analysed/representatives/happiness.csv"]);
    let source = "--source analysed/representatives/happiness.csv";
    // One second at 10 frames per second: 11 frames. Back again without both ends: 9 more.
    clone(&work, &format!("{source} -o loop --fps 10 --duration 1 --loop --ease in-out")).exit(0);
    assert_eq!(work.files("loop/frames").len(), 20);
    assert_eq!(picture(&work, "loop/frames/target_00000010.png"), picture(&work, "loop/frames/target_00000012.png"));
    clone(&work, &format!("{source} -o half --emphasis 0.5")).exit(0);
    clone(&work, &format!("{source} -o full")).exit(0);
    let smile = |name: &str| {
        let fap = read_fap(&work.path(name)).unwrap().sequence;
        fap.frames.last().unwrap().value(FapNumber::try_from(59).unwrap()).unwrap()
    };
    // A representative has no timing: by default it rises quickly and holds. Halfway the smile is nearly complete.
    let halfway = |name: &str| {
        let fap = read_fap(&work.path(name)).unwrap().sequence;
        fap.frames[fap.frames.len() / 2].value(FapNumber::try_from(59).unwrap()).unwrap() / smile(name)
    };
    clone(&work, &format!("{source} -o even --ease linear --blink")).exit(0);
    assert!(halfway("full/clone.fap") > 0.8 && halfway("even/clone.fap") < 0.8);
    assert!(work.read("full/clone.json").contains("\"ease\": \"natural\""));
    // The eyes are closed in the sixth frame (0.2 s) and open at the end.
    let lids = |frame: usize| {
        read_fap(&work.path("even/clone.fap")).unwrap().sequence.frames[frame].value(FapNumber::try_from(19).unwrap())
    };
    assert!(lids(5).unwrap() > lids(25).unwrap() + 300.0, "{:?} {:?}", lids(5), lids(25));
    let ratio = smile("half/clone.fap") / smile("full/clone.fap");
    assert!((ratio - 0.5).abs() < 0.02, "half the emphasis is half the smile: {ratio}");
    let said = ["FAP files need a whole frame rate: clone.fap has 30 frames per second, the clone 29.97"];
    clone(&work, &format!("{source} -o rate --fps 29.97 --duration 0.1")).exit(0).says(&said);
    clone(&work, &format!("{source} -o long --duration 1e9")).exit(1).says(&["frames, more than 20000"]);
}

fn fap_file(mask: &[usize], values: &str) -> String {
    let flags = (1..=68).map(|k| if mask.contains(&k) { "1" } else { "0" }).collect::<Vec<_>>().join(" ");
    let zeros = mask.iter().map(|_| "0").collect::<Vec<_>>().join(" ");
    format!("2.1 test 25 2\n{flags}\n0 {zeros}\n{flags}\n1 {values}\n")
}

#[test]
fn faps_close_the_eyes_and_faps_that_cannot_be_shown_are_reported() {
    let work = work();
    // Upper lids closed by one IRISD (FAP 19, 20); a tongue (44) and a head turned by 0.1 rad (49), which no photograph can
    // show.
    work.write("blink.fap", fap_file(&[19, 20, 44, 49], "1024 1024 500 10000"));
    clone(&work, "--source blink.fap -o blink").exit(0).says(&["FAP 44, 49 cannot be shown"]);
    assert!(work.read("blink/clone.json").contains("44"));
    let rows = work.rows("blink/track/target_blink.csv");
    let gap = |frame: &str| {
        let y = |node: &str| {
            let row = rows.iter().find(|r| r["frame"] == frame && r["node"] == node).unwrap();
            row["y"].parse::<f64>().unwrap()
        };
        y("22") - y("21")
    };
    assert!(gap("2") < 0.25 * gap("1"), "the lids close: {} of {}", gap("2"), gap("1"));
    work.write("tongue.fap", fap_file(&[44], "500"));
    clone(&work, "--source tongue.fap -o tongue").exit(1).says(&["tongue.fap: none of its FAPs (44) can be shown"]);
}

#[test]
fn lids_move_by_the_values_of_a_fap_file_on_any_face() {
    let work = work();
    // The marked lids are wider apart than the iris boxes, which the springs carry: the unit of the lids is their opening.
    let marks = work.read("marks.csv");
    let mark = |node: &str| -> [f64; 2] {
        let line = marks.lines().find(|line| line.starts_with(&format!("{node},"))).unwrap();
        let values: Vec<f64> = line.split(',').skip(1).take(2).map(|value| value.parse().unwrap()).collect();
        [values[0], values[1]]
    };
    let lids: String = [("20", "23", [21, 22]), ("53", "56", [54, 55])]
        .into_iter()
        .flat_map(|(outer, inner, nodes)| {
            let ([ax, ay], [bx, by]) = (mark(outer), mark(inner));
            let half = 0.19 * (ax - bx).hypot(ay - by);
            let (x, y) = (f64::midpoint(ax, bx), f64::midpoint(ay, by));
            [format!("{},{x},{}\n", nodes[0], y - half), format!("{},{x},{}\n", nodes[1], y + 0.8 * half)]
        })
        .collect();
    work.write("marks.csv", format!("{}\n{lids}", marks.trim_end()));
    let values = |name: &str| {
        let sequence = read_fap(&work.path(name)).unwrap().sequence;
        [19, 20, 21, 22, 31].map(|fap| sequence.frames.last().unwrap().value(FapNumber::try_from(fap).unwrap()).unwrap())
    };
    work.write("lids.fap", fap_file(&[19, 20, 21, 22, 31], "300 -200 100 150 300"));
    clone(&work, "--source lids.fap -o once").exit(0);
    clone(&work, "--source once/clone.fap -o twice").exit(0);
    let near = |found: [f64; 5]| found.iter().zip([300.0, -200.0, 100.0, 150.0, 300.0]).all(|(a, b)| (a - b).abs() <= 4.0);
    assert!(
        near(values("once/clone.fap")) && near(values("twice/clone.fap")),
        "{:?} {:?}",
        values("once/clone.fap"),
        values("twice/clone.fap")
    );
    // A track moves the lids in the same way as its own FAP file.
    work.grimace("run faces -o out -q").exit(0);
    clone(&work, "--source out/tracks/S001_005.csv -o track").exit(0);
    clone(&work, "--source out/fap/tracks/S001_005.fap -o fap").exit(0);
    let (track, fap) = (values("track/clone.fap"), values("fap/clone.fap"));
    assert!(track.iter().zip(&fap).take(4).all(|(a, b)| (a - b).abs() < 20.0), "{track:?} {fap:?}");
    // With --head, the turns of the head are those of the track's own FAP file, from its first frame on.
    clone(&work, "--source out/tracks/S001_005.csv --head -o head").exit(0);
    let head = |name: &str| -> Vec<[Option<f64>; 3]> {
        let sequence = read_fap(&work.path(name)).unwrap().sequence;
        sequence.frames.iter().map(|f| [48, 49, 50].map(|fap| f.value(FapNumber::try_from(fap).unwrap()))).collect()
    };
    let (cloned, tracked) = (head("head/clone.fap"), head("out/fap/tracks/S001_005.fap"));
    assert_eq!(cloned.len(), tracked.len());
    for (cloned, tracked_now) in cloned.iter().zip(&tracked) {
        for axis in 0..3 {
            let turn = tracked_now[axis].unwrap() - tracked[0][axis].unwrap();
            assert!((cloned[axis].unwrap() - turn).abs() <= 2.0, "{cloned:?} {tracked_now:?} {:?}", tracked[0]);
        }
    }
    assert_eq!(head("track/clone.fap")[1], [None; 3]);
}

#[test]
fn only_faps_that_the_file_sets_are_reported_as_clamped() {
    let work = work();
    // A jaw that falls by nine times the distance from nose to mouth takes the lips along, as far as skin stretches.
    work.write("jaw.fap", fap_file(&[3], "9000"));
    clone(&work, "--source jaw.fap -o jaw").exit(0).says(&["reduced FAP 3 ("]);
    let info: serde_json::Value = serde_json::from_str(&work.read("jaw/clone.json")).unwrap();
    let cut: Vec<_> = info["faps_cut"].as_array().unwrap().iter().map(|cut| cut["fap"].as_u64().unwrap()).collect();
    assert_eq!(cut, [3], "{info}");
    let changed = info["faps_changed"].as_array().unwrap();
    assert!(changed.iter().all(|changed| changed["fap"] == 3), "{info}");
}

#[test]
fn sources_of_one_name_are_told_apart() {
    let work = work();
    let jaw = fap_file(&[3], "200");
    work.write("a/jaw.fap", jaw.clone()).write("b/jaw.fap", jaw);
    clone(&work, "--source a/jaw.fap b/jaw.fap -o batch").exit(0).prints(&["2 of 2 clones written to batch"]);
    assert!(work.path("batch/target_jaw-a/clone.json").exists() && work.path("batch/target_jaw-b/clone.json").exists());
}

#[test]
fn puffed_cheeks_leave_the_mouth_where_it_is() {
    let work = work();
    work.write("puff.fap", fap_file(&[39, 40], "400 400"));
    clone(&work, "--source puff.fap -o puff").exit(0);
    let rows = work.rows("puff/track/target_puff.csv");
    let aside = |node: &str| {
        let x =
            |frame: &str| rows.iter().find(|r| r["frame"] == frame && r["node"] == node).unwrap()["x"].parse::<f64>().unwrap();
        (x("2") - x("1")).abs()
    };
    // Cheek and corner of the mouth, left and right.
    for (cheek, corner) in [("90", "31"), ("91", "64")] {
        assert!(aside(cheek) > 10.0 && aside(corner) < 0.1 * aside(cheek), "{} px, {} px", aside(cheek), aside(corner));
    }
}

#[test]
fn an_open_mouth_has_teeth_unless_dark_is_requested() {
    let work = work();
    // The upper lip moves up, the lower lip down.
    work.write("open.fap", fap_file(&[4, 5, 8, 9, 10, 11], "-250 -400 -200 -200 -350 -350"));
    for teeth in ["auto", "drawn", "dark"] {
        clone(&work, &format!("--source open.fap -o {teeth} --teeth {teeth}")).exit(0);
    }
    let apex = |teeth: &str| picture(&work, &format!("{teeth}/frames/target_00000002.png"));
    assert_eq!(apex("auto"), apex("drawn"), "a FAP file has no pictures of teeth");
    let brightness = |p: &RgbImage| p.pixels().map(|p| u64::from(p.0[1])).sum::<u64>();
    assert!(brightness(&apex("drawn")) > brightness(&apex("dark")));
}

#[test]
fn a_folder_in_use_by_another_command_is_not_changed() {
    let work = work();
    clone(&work, "--source S001_005.csv -o out").exit(0);
    let before = work.files("out");
    let record = std::fs::File::options().append(true).open(work.path("out/frames.b3")).unwrap();
    record.lock().unwrap();
    clone(&work, "--source S001_005.csv -o out --fps 50 --force").exit(1).says(&["another command is writing into this folder"]);
    crate::common::assert_same_files(&before, &work.files("out"));
    drop(record);
    clone(&work, "--source S001_005.csv -o out --fps 50 --force").exit(0);
}

#[test]
fn a_fap_file_of_several_hours_is_refused_at_once() {
    let work = work();
    let flags = (1..=68).map(|k| if k == 3 { "1" } else { "0" }).collect::<Vec<_>>().join(" ");
    let frames: String = (0..20_001).map(|k| format!("{flags}\n{k} 100\n")).collect();
    work.write("long.fap", format!("2.1 long 25 20001\n{frames}"));
    clone(&work, "--source long.fap -o out").exit(1).says(&["long", "it has 20001 frames, more than 20000", "fap convert --fps"]);
}

#[test]
fn the_option_marks_without_a_landmark_file_is_refused() {
    let work = work();
    work.grimace("clone --source S001_005.csv --target target.png --marks default -o out")
        .exit(1)
        .says(&["target.png: --marks selects landmarks of a file, but no file is given", "--correspondences"]);
}

#[test]
fn another_face_has_its_own_teeth_unless_those_of_the_source_are_requested() {
    let work = work();
    for teeth in ["auto", "drawn", "source"] {
        let clone_with = format!("--source S001_005.csv --source-frames faces/S001/005 -o {teeth} --teeth {teeth}");
        clone(&work, &clone_with).exit(0);
    }
    let apex = |teeth: &str| picture(&work, &format!("{teeth}/frames/target_00000006.png"));
    assert_eq!(apex("auto"), apex("drawn"));
    assert_ne!(apex("auto"), apex("source"), "the lips of the smile are open");
    let none = "--source S001_005.csv -o none --teeth source";
    clone(&work, none).exit(1).says(&["--teeth source needs the frames of the source: give --source-frames"]);
}

#[test]
fn head_motion_of_a_track_is_copied_on_request() {
    let work = work();
    clone(&work, "--source S001_005.csv -o still").exit(0);
    clone(&work, "--source S001_005.csv -o moving --head").exit(0);
    let nose = |folder: &str| {
        let rows = work.rows(&format!("{folder}/track/target_S001-005.csv"));
        let last = rows.iter().rev().find(|r| r["node"] == "77").unwrap();
        (last["x"].parse::<f64>().unwrap(), last["y"].parse::<f64>().unwrap())
    };
    let (still, moving) = (nose("still"), nose("moving"));
    // The simulated head shifts and rolls; nothing else moves the bridge of the nose.
    assert!((still.0 - moving.0).hypot(still.1 - moving.1) > 0.5, "{still:?} {moving:?}");
}

#[test]
fn several_sources_and_targets_give_a_sheet_and_a_bad_one_fails_alone() {
    let work = work();
    work.write("still.fap", fap_file(&[3], "0")).write("broken.fap", "2.1 test 25");
    let ran = work.grimace(
        "clone --source still.fap S001_005.csv broken.fap --target target.png faces/S001/005/S001_005_00000001.png gone.png \
         --correspondences marks.csv faces/S001/005/correspondences.csv marks.csv -o batch --sheet",
    );
    ran.exit(3).prints(&["4 of 9 clones written"]).says(&["broken.fap", "gone.png"]);
    let files = work.files("batch");
    assert!(files.contains_key("sheet.png") && files.contains_key("target_S001_005/clone.fap"));
    // A still face equals the photograph.
    assert_eq!(picture(&work, "batch/target_still/frames/target_00000002.png"), picture(&work, "target.png"));
}

#[test]
fn an_interrupted_batch_continues_where_it_stopped() {
    let work = work();
    work.write("still.fap", fap_file(&[3], "0"));
    let batch = || clone(&work, "--source S001_005.csv still.fap -o batch --sheet");
    batch().exit(0).prints(&["2 of 2 clones written to batch"]);
    let files = work.files("batch");
    // The state after an interruption: frames and their record, but no sheet.
    std::fs::remove_file(work.path("batch/target_still/clone.json")).unwrap();
    std::fs::remove_file(work.path("batch/sheet.png")).unwrap();
    clone(&work, "--source S001_005.csv -o batch").exit(1).says(&["holds the clones of several sources or targets"]);
    batch().exit(0).prints(&["1 of 2 clones written to batch; 1 unchanged since the last time"]);
    crate::common::assert_same_files(&files, &work.files("batch"));
    batch().exit(0).prints(&["0 of 2 clones written to batch; 2 unchanged"]);
    // Different content is not overwritten: that of other options, and a frame that somebody changed.
    clone(&work, "--source S001_005.csv still.fap -o batch --emphasis 0.5").exit(1).says(&["clone.json exists"]);
    work.write("batch/target_still/frames/target_00000001.png", "mine");
    let there = ["target_still/clone.json exists; give --force", "batch/sheet.png exists; give --force"];
    batch().exit(3).says(&there);
}

#[test]
fn targets_without_marks_turned_away_or_of_another_size_are_reported() {
    let work = work();
    work.grimace("clone --source S001_005.csv --target target.png target.png -c marks.csv -o out")
        .exit(1)
        .says(&["or none to find the marks"]);
    work.write("empty.csv", "node,x,y\n");
    let with = |marks: &str| work.grimace(&format!("clone --source S001_005.csv --target target.png -c {marks} -o out"));
    with("empty.csv").exit(1).says(&["empty.csv", "at least 3"]);
    with("gone.csv").exit(1).says(&["gone.csv"]);
    // A profile: the subject's left half appears a fifth as wide as the right half.
    let middle = 100.0;
    let rows = work.rows("marks.csv");
    let turned: String = rows
        .iter()
        .map(|row| {
            let x: f64 = row["x"].parse().unwrap();
            let x = if x > middle { middle + 0.12 * (x - middle) } else { x };
            format!("{},{x},{}\n", row["node"], row["y"])
        })
        .collect();
    work.write("profile.csv", format!("node,x,y\n{turned}"));
    let ran = with("profile.csv").exit(1);
    // The fit reports the first mark that is impossible in a frontal face.
    assert!(
        ran.stderr.contains("turned away by about") || ran.stderr.contains("the other marks expect it near"),
        "{}",
        ran.stderr
    );
    let outside = work.read("marks.csv").replace("node,x,y\n", "node,x,y\n94,5000,10\n");
    work.write("outside.csv", outside);
    with("outside.csv").exit(1).says(&["5000"]);
    work.write("short.csv", "point,x,y\n0,1,1\n1,2,2\n");
    with("short.csv").exit(1).says(&["2 landmarks; the points 0 to 67"]);
    work.grimace("clone --source S001_005.csv --target target.png target.png -c marks.csv -o out")
        .exit(1)
        .says(&["2 targets but 1 files of --correspondences"]);
}

/// Returns the marks of `marks.csv` multiplied by a factor.
fn scaled_marks(work: &Work, factor: f64) -> String {
    let row = |row: &std::collections::BTreeMap<String, String>| {
        let scale = |column: &str| (row[column].parse::<f64>().unwrap() + 0.5) * factor - 0.5;
        format!("{},{},{}\n", row["node"], scale("x"), scale("y"))
    };
    format!("node,x,y\n{}", work.rows("marks.csv").iter().map(row).collect::<String>())
}

fn png(image: impl Into<DynamicImage>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.into().write_to(&mut bytes, ImageFormat::Png).unwrap();
    bytes.into_inner()
}

#[test]
fn tiny_and_huge_pictures_work_or_say_what_is_missing() {
    let work = work();
    let original = picture(&work, "target.png");
    let resized = |factor: f64| {
        let (w, h) = original.dimensions();
        let side = |s: u32| (f64::from(s) * factor) as u32;
        image::imageops::resize(&original, side(w), side(h), image::imageops::FilterType::Triangle)
    };
    for (name, factor) in [("small", 0.25), ("large", 12.0)] {
        work.write(&format!("{name}.png"), png(resized(factor))).write(&format!("{name}.csv"), scaled_marks(&work, factor));
        work.grimace(&format!("clone --source S001_005.csv --target {name}.png -c {name}.csv -o {name} --fps 1 --duration 1"))
            .exit(0);
        assert_eq!(picture(&work, &format!("{name}/frames/{name}_00000002.png")).dimensions(), resized(factor).dimensions());
    }
    // In a picture 32 px wide, the eyes are 5 px apart.
    work.write("tiny.png", png(resized(0.08))).write("tiny.csv", scaled_marks(&work, 0.08));
    work.grimace("clone --source S001_005.csv --target tiny.png -c tiny.csv -o tiny").exit(1).says(&["px apart; at least 6 px"]);
    let wide = RgbImage::new(16_400, 40);
    work.write("wide.png", png(wide));
    work.grimace("clone --source S001_005.csv --target wide.png -c marks.csv -o wide")
        .exit(1)
        .says(&["16400x40, larger than 16384 px"]);
}

/// Returns a JPEG that EXIF data mark as lying on its side (orientation 6: rotate clockwise to see it upright).
fn on_its_side(upright: &RgbImage) -> Vec<u8> {
    let mut jpeg = Cursor::new(Vec::new());
    image::imageops::rotate270(upright).write_to(&mut jpeg, ImageFormat::Jpeg).unwrap();
    let jpeg = jpeg.into_inner();
    let tiff = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
    let mut out = jpeg[..2].to_vec();
    out.extend([0xFF, 0xE1]);
    out.extend((2 + 6 + tiff.len() as u16).to_be_bytes());
    out.extend(b"Exif\0\0");
    out.extend(tiff);
    out.extend(&jpeg[2..]);
    out
}

#[test]
fn sixteen_bit_transparent_and_rotated_pictures_are_the_same_face() {
    let work = work();
    let original = picture(&work, "target.png");
    clone(&work, "--source S001_005.csv -o plain").exit(0);
    let apex = picture(&work, "plain/frames/target_00000006.png");
    let apex_of = |name: &str, file: &str| {
        work.grimace(&format!("clone --source S001_005.csv --target {file} -c marks.csv -o {name}")).exit(0);
        picture(&work, &format!("{name}/frames/{}_00000006.png", file.split('.').next().unwrap()))
    };
    let deep = image::ImageBuffer::from_fn(original.width(), original.height(), |x, y| {
        image::Rgb(original.get_pixel(x, y).0.map(|c| u16::from(c) * 257))
    });
    work.write("deep.png", png(DynamicImage::ImageRgb16(deep)));
    assert_eq!(apex_of("deep", "deep.png"), apex);
    work.write("clear.png", png(DynamicImage::ImageRgb8(original.clone()).to_rgba8()));
    assert_eq!(apex_of("clear", "clear.png"), apex);
    work.write("grey.png", png(image::imageops::grayscale(&original)));
    assert_eq!(apex_of("grey", "grey.png").dimensions(), apex.dimensions());
    work.write("side.jpg", on_its_side(&original));
    let side = apex_of("side", "side.jpg");
    assert_eq!(side.dimensions(), apex.dimensions());
    let difference: f64 = side.as_raw().iter().zip(apex.as_raw()).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
    assert!(difference / (apex.as_raw().len() as f64) < 6.0, "upright, up to JPEG compression");
}

#[test]
fn unsuitable_sources_are_reported() {
    let work = work();
    work.write("other.csv", "frame,node,x,y\n0,0,1,1\n0,1,2,2\n1,0,1,1\n1,1,2,2\n");
    clone(&work, "--source other.csv -o out").exit(1).says(&["other.csv has 2 nodes, but the wireframe has 113"]);
    work.write("smile.fap", std::fs::read(crate::common::root().join("fixtures/golden/fap/happiness.fap")).unwrap());
    clone(&work, "--source smile.fap --head -o nod").exit(0).says(&["smile.fap: --head has no effect: only tracks"]);
    let track = clone(&work, "--source S001_005.csv --head -o turn").exit(0);
    assert!(!track.stderr.contains("--head"), "{}", track.stderr);
    // With y counted from the bottom, and from a mirrored picture.
    let text = String::from_utf8(work.bytes("S001_005.csv")).unwrap();
    for (name, column, says) in
        [("below.csv", 3, "y must be counted downwards from the top"), ("side.csv", 2, "left and right are swapped")]
    {
        let flipped = text.lines().enumerate().map(|(line, row)| {
            let mut cells: Vec<String> = row.split(',').map(str::to_owned).collect();
            if line > 0 {
                cells[column] = (300.0 - cells[column].parse::<f64>().unwrap()).to_string();
            }
            cells.join(",") + "\n"
        });
        work.write(name, flipped.collect::<String>());
        clone(&work, &format!("--source {name} -o out")).exit(1).says(&[name, says]);
    }
    clone(&work, "--source below.csv side.csv -o out").exit(1).says(&["no source could be read: below.csv: ", "; side.csv: "]);
    clone(&work, "--source target.png -o out")
        .exit(1)
        .says(&["target.png: this is neither a track or model (.csv) nor a FAP file"]);
    clone(&work, "--source gone.csv -o out").exit(1).says(&["gone.csv"]);
    clone(&work, "--source S001_005.csv --wrinkles -o out").exit(1).says(&["--wrinkles needs the frames of the source"]);
    work.grimace("analyze S001_005.csv -o analysed -q").exit(0);
    clone(&work, "--source analysed/representatives/happiness.csv --source-frames faces/S001/005 --wrinkles -o out")
        .exit(1)
        .says(&["belong to a track"]);
    for k in 1..=6 {
        let small = image::imageops::thumbnail(&picture(&work, &format!("faces/S001/005/S001_005_{k:08}.png")), 40, 40);
        work.write(&format!("small/S001_005_{k:08}.png"), png(small));
    }
    clone(&work, "--source S001_005.csv --source-frames small --wrinkles -o out")
        .exit(1)
        .says(&["small: frame 1 is 40x40, but the frames of the track S001_005 are"]);
    // Frames of another person with the same size and number; and the right frames in another folder.
    let other = "other: S002_005_00000001.png is not one of the files that the track S001_005 was made from (S001_005_00000001.png and others)";
    std::fs::rename(work.path("faces/S002/005"), work.path("other")).unwrap();
    clone(&work, "--source S001_005.csv --source-frames other --wrinkles -o out").exit(1).says(&[other]);
    for (name, bytes) in work.files("faces/S001/005") {
        work.write(&format!("moved/{name}"), bytes);
    }
    // Frames of another person with the same names, as when all frames are named by number.
    for (name, bytes) in work.files("other") {
        work.write(&format!("namesake/{}", name.replace("S002", "S001")), bytes);
    }
    clone(&work, "--source S001_005.csv --source-frames namesake --wrinkles -o out").exit(1).says(&[
        "namesake: the files have the same names as those that the track S001_005 was made from, but another content; give the folder",
    ]);
    // A folder with additional pictures still counts as the same.
    work.write("moved/S001_005_00000007.png", work.bytes("target.png"));
    clone(&work, "--source S001_005.csv --source-frames moved --wrinkles -o moved-clone").exit(0);
    std::fs::remove_file(work.path("faces/S001/005/S001_005_00000003.png")).unwrap();
    clone(&work, "--source S001_005.csv --source-frames faces/S001/005 --wrinkles -o out")
        .exit(1)
        .says(&["has only 5 of the 6 frames of the track S001_005"]);
}

#[test]
fn videos_are_written_or_refused_with_a_reason() {
    let work = work();
    for format in ["mp4", "webm"] {
        let ran = clone(&work, &format!("--source S001_005.csv -o {format} --film {format}"));
        // OpenCV warns if a codec is used under another tag than requested; users do not see this.
        assert!(!ran.stderr.contains("tag"), "{}", ran.stderr);
        if ran.status == Some(0) {
            // A track of the film has one frame per frame of the clone, with the size of the picture.
            work.grimace(&format!("track {format}/clone.{format} --correspondences marks.csv -o {format}.csv")).exit(0);
            let rows = work.rows(&format!("{format}.csv"));
            assert_eq!(rows.iter().map(|r| &r["frame"]).collect::<std::collections::BTreeSet<_>>().len(), 6, "{format}");
        } else {
            ran.exit(1).says(&["no encoder"]);
        }
    }
}

#[test]
fn the_report_shows_the_representatives_on_a_face_of_choice() {
    let work = work();
    work.grimace("analyze S001_005.csv -o plain -q").exit(0);
    assert!(work.read("plain/report.html").contains("\"a composite portrait\""));
    work.grimace("analyze S001_005.csv -o photo -q --portrait target.png -c marks.csv").exit(0);
    let html = work.read("photo/report.html");
    // The player contains the photograph, not the built-in portrait.
    assert!(
        html.contains("target.png") && html.contains("data:image/jpeg;base64,") && !html.contains("\"a composite portrait\"")
    );
    // Earlier names of these options still work.
    work.grimace("analyze S001_005.csv -o bad -q --report-face target.png --report-marks gone.csv").exit(1).says(&["gone.csv"]);
    work.grimace("analyze S001_005.csv -o bad -q -c marks.csv").exit(2).says(&["--portrait"]);
}

#[test]
fn cloning_is_evaluated_on_sequences_and_on_simulated_people() {
    let work = work();
    work.grimace("evaluate clone -o cross --subjects 3 -q").exit(0);
    let mean = |rows: &[std::collections::BTreeMap<String, String>], truth: &str, scaling: &str| -> f64 {
        let row = rows.iter().find(|r| r["truth"] == truth && r["emotion"] == "all" && r["scaling"] == scaling).unwrap();
        row["mean (% ES)"].parse().unwrap()
    };
    let rows = work.rows("cross/cross_cloning.csv");
    for truth in ["action units and FAPs", "FAPs"] {
        let (floor, plain) = (mean(&rows, truth, "plain copy of the neutral"), mean(&rows, truth, "no scaling"));
        let region = mean(&rows, truth, "per region (FAPU)");
        assert!(region < plain && plain < floor && region < 1.5, "{truth}: {region}, {plain}, {floor}");
    }
    // FAPs are in the person's own FAPUs: only the scale per region is right.
    assert!(mean(&rows, "FAPs", "per region (FAPU)") < 0.5 * mean(&rows, "FAPs", "uniform (ES)"));
    work.grimace("evaluate clone faces -o self -q").exit(1).says(&["68-point landmarks"]);
}

#[test]
fn sheets_for_graders_hide_the_expressions_and_grades_are_summarized() {
    let work = Work::new();
    for name in ["P01.jpg", "P02.jpg"] {
        work.write(name, std::fs::read(crate::common::root().join("fixtures/portraits").join(name)).unwrap());
    }
    for name in ["happiness.csv", "surprise.csv"] {
        work.write(name, std::fs::read(crate::common::root().join("fixtures/golden/representatives").join(name)).unwrap());
    }
    work.grimace("evaluate clone --sheets P01.jpg P02.jpg --sources happiness.csv surprise.csv -o sheets").exit(0).prints(&[
        "2 sheets",
        "without seeing key.csv",
        "5: passes as a photograph",
    ]);
    let sheet = picture(&work, "sheets/P01.png");
    assert!(sheet.height() > 500 && sheet.width() > 900, "{:?}", sheet.dimensions());
    let key = work.rows("sheets/key.csv");
    assert_eq!(key.len(), 4);
    // The table to be filled in does not reveal the intended expressions.
    let grades = work.read("sheets/grades.csv");
    assert_eq!(grades.lines().next().unwrap(), "sheet,picture,read_as,grade,artefact");
    assert!(!grades.contains("happiness") && grades.lines().count() == 5);
    work.write("sheets/grades.csv", grades.replace(",,,", ",happiness,4,teeth"));
    work.grimace("evaluate clone --grades sheets/grades.csv -o graded").exit(0).prints(&["happiness", "4.00"]);
    let rows = work.rows("graded/graded.csv");
    let row = |source: &str| rows.iter().find(|r| r["source"] == source).unwrap();
    assert_eq!((row("happiness")["read_as_it_is"].as_str(), row("surprise")["read_as_it_is"].as_str()), ("2", "0"));
    assert_eq!((row("all")["pictures"].as_str(), row("all")["costliest"].as_str()), ("4", "teeth"));
    // The same seed gives the same order.
    work.grimace("evaluate clone --sheets P01.jpg P02.jpg --sources happiness.csv surprise.csv -o again -q").exit(0);
    assert_eq!(work.read("again/key.csv"), work.read("sheets/key.csv"));
    work.grimace("evaluate clone --sheets P01.jpg -o none").exit(2).says(&["--sources"]);
    work.grimace("evaluate clone --grades graded/graded.csv -o bad").exit(1).says(&["key.csv"]);
}

#[test]
fn a_clone_that_does_not_begin_at_rest_is_measured_from_rest() {
    let work = Work::new();
    let mask = (1..=68).map(|k| if k == 12 || k == 13 { "1" } else { "0" }).collect::<Vec<_>>().join(" ");
    for (name, first) in [("rest", 0), ("late", 200)] {
        work.write(&format!("{name}.fap"), format!("2.1 {name} 25 2\n{mask}\n0 {first} {first}\n{mask}\n1 200 200\n"));
        let portraits = crate::common::root().join("fixtures/portraits");
        let target =
            format!("{} -c {}", portraits.join("P05.jpg").display(), portraits.join("P05_correspondences.csv").display());
        work.grimace(&format!("clone -s {name}.fap -t {target} -o {name} -q")).exit(0);
        let track = work.files(&format!("{name}/track")).keys().find(|file| file.ends_with(".csv")).unwrap().clone();
        let frames: std::collections::BTreeSet<String> =
            work.rows(&format!("{name}/track/{track}")).into_iter().map(|row| row["frame"].clone()).collect();
        let faps = work.read(&format!("{name}/clone.fap"));
        let row: Vec<i32> = faps.lines().nth(2).unwrap().split(' ').skip(1).map(|word| word.parse().unwrap()).collect();
        // Frame 0 is the face at rest if the motion does not begin there.
        if first == 0 {
            assert_eq!((frames.len(), row.iter().all(|value| *value == 0)), (2, true), "{row:?}");
        } else {
            assert!(frames.len() == 3 && frames.contains("0") && row.iter().any(|value| *value > 150), "{row:?}");
        }
    }
}
