//! `grimace clone` end to end.

use crate::cmd_clone_faps::fap_file;
use crate::common::{Ran, Work};
use grimace::internal::fap::{FapNumber, read_fap};
use image::RgbImage;

/// Makes a folder with S001's happiness as `faces`, its track as `S001_005.csv`, and S002's neutral frame as `target.png` with `marks.csv`.
pub fn work() -> Work {
    let work = Work::with_sequences(&["S001_005", "S002_005"]);
    work.grimace("track faces/S001/005 -c faces/S001/005/correspondences.csv -o S001_005.csv --emotion happiness -q").exit(0);
    let target = work.bytes("faces/S002/005/S002_005_00000001.png");
    work.write("target.png", target);
    let marks = work.read("faces/S002/005/correspondences.csv");
    work.write("marks.csv", marks);
    work
}

pub fn clone(work: &Work, args: &str) -> Ran {
    work.grimace(&format!("clone --target target.png --correspondences marks.csv {args}"))
}

pub fn picture(work: &Work, name: &str) -> RgbImage {
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
    // The lids were asked to.
    let json: serde_json::Value = serde_json::from_str(&work.read("even/clone.json")).unwrap();
    let is_lid = |one: &serde_json::Value| (19..=22).contains(&one["fap"].as_u64().unwrap());
    assert!(!json["faps_changed"].as_array().unwrap().iter().any(is_lid), "{}", json["faps_changed"]);
    let ratio = smile("half/clone.fap") / smile("full/clone.fap");
    assert!((ratio - 0.5).abs() < 0.02, "half the emphasis is half the smile: {ratio}");
    let said = ["FAP files need a whole frame rate: clone.fap has 30 frames per second, the clone 29.97"];
    clone(&work, &format!("{source} -o rate --fps 29.97 --duration 0.1")).exit(0).says(&said);
    clone(&work, &format!("{source} -o long --duration 1e9")).exit(1).says(&["frames, more than 20000"]);
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
