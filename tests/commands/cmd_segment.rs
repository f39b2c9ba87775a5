//! Whole recordings: `grimace segment`, recordings in a manifest, and sequences that start with the apex.

use std::{collections::BTreeMap, fs};

use crate::common::{Work, root, video::matroska};

/// A frame of a recording: a frame number (from 1) of a fixture sequence, or a black square of the given size, px.
#[derive(Clone, Copy)]
enum Shot {
    Face(&'static str, u32),
    Black(u32),
}

/// A recording without a face: small, because every frame is searched, and of the shortest valid length.
const DARK: [Shot; 26] = [Shot::Black(120); 26];

/// Returns a rest, a rise to the apex, a short hold, a fall and a rest, with two frames for each step.
fn expression(sequence: &'static str) -> Vec<Shot> {
    let up = (1..=10).flat_map(|k| [k, k]);
    let steps = std::iter::repeat_n(1, 22).chain(up.clone()).chain([10; 4]).chain(up.rev()).chain([1; 22]);
    steps.map(|k| Shot::Face(sequence, k)).collect()
}

/// Indices, from 0, of the first and the last frame of the hold of [`expression`].
const HOLD: (i64, i64) = (40, 46);
const LENGTH: i64 = 88;

fn record(work: &Work, folder: &str, shots: &[Shot]) {
    fs::create_dir_all(work.path(folder)).unwrap();
    for (k, shot) in shots.iter().enumerate() {
        let target = work.path(&format!("{folder}/r_{:05}.jpg", k + 1));
        match shot {
            Shot::Face(sequence, number) => {
                let name = format!("fixtures/simulated/S001/{sequence}/S001_{sequence}_{number:08}.jpg");
                fs::copy(root().join(name), target).unwrap();
            }
            Shot::Black(side) => image::RgbImage::new(*side, *side).save(target).unwrap(),
        }
    }
}

/// Records frames of 480 x 320 px before a plain wall. Each shows portraits at (name, x, relative size); at size 1 the eyes are about 55 px
/// apart.
fn record_before_a_wall(work: &Work, folder: &str, frames: &[Vec<(&str, i64, f64)>]) {
    fs::create_dir_all(work.path(folder)).unwrap();
    let mut drawn = BTreeMap::new();
    for (k, faces) in frames.iter().enumerate() {
        let target = work.path(&format!("{folder}/r_{:05}.jpg", k + 1));
        // Most frames equal an earlier one.
        if let Some(same) = frames[..k].iter().position(|other| other == faces) {
            fs::copy(work.path(&format!("{folder}/r_{:05}.jpg", same + 1)), target).unwrap();
            continue;
        }
        let mut frame = image::RgbImage::from_pixel(480, 320, image::Rgb([120; 3]));
        for (name, x, share) in faces {
            let face = drawn.entry((*name, share.to_bits())).or_insert_with(|| {
                let face = image::open(root().join("fixtures/portraits").join(name)).unwrap().to_rgb8();
                let side = |side: u32| (f64::from(side) * 0.5 * share).round() as u32;
                image::imageops::resize(&face, side(face.width()), side(face.height()), image::imageops::FilterType::Triangle)
            });
            image::imageops::replace(&mut frame, face, *x, 20);
        }
        frame.save(target).unwrap();
    }
}

fn number(row: &BTreeMap<String, String>, column: &str) -> i64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column} is `{}`", row[column]))
}

fn number_of(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap()
}

/// Whether a frame number is at most two frames from the hold of an expression that begins with frame `start`.
fn is_apex(frame: i64, start: i64) -> bool {
    (start + HOLD.0 - 2..=start + HOLD.1 + 2).contains(&frame)
}

#[test]
fn expressions_of_a_recording_become_sequences_for_run() {
    let work = Work::new();
    const GAP: i64 = 16;
    let gap = vec![Shot::Black(320); GAP as usize];
    let shots: Vec<Shot> = [expression("005"), gap, expression("007")].concat();
    record(&work, "talk", &shots);
    let ran = work.grimace("segment talk -o segments.csv --subject P1 --emotion happiness --openface");
    ran.exit(0).prints(&["talk: 2 sequences proposed", "no face is found", "a face is found again"]);
    let rows = work.rows("segments.csv");
    assert_eq!(rows.len(), 2, "{rows:?}");
    let second = LENGTH + GAP;
    for (row, start) in rows.iter().zip([1, second + 1]) {
        assert!(is_apex(number(row, "last_frame"), start), "{row:?}");
        let neutral = number(row, "first_frame") - start;
        assert!((0..=23).contains(&neutral), "{row:?}");
        assert!((0.3..=1.0).contains(&row["confidence"].parse::<f64>().unwrap()), "{row:?}");
    }
    assert_eq!((rows[0]["sequence"].as_str(), rows[1]["sequence"].as_str()), ("talk-01", "talk-02"));
    for name in ["talk-01.csv", "talk-02.csv", "talk-01.png", "talk-02.png", "talk.json"] {
        assert!(work.path(&format!("segments/{name}")).is_file(), "{name}");
    }
    let frames = work.rows("segments/talk_frames.csv");
    assert!(frames.iter().any(|r| r["phase"] == "apex") && frames.iter().filter(|r| r["phase"] == "rest").count() > 40);
    assert!(!frames.iter().any(|r| (LENGTH + 4..=second - 4).contains(&number(r, "frame"))), "black frames have no row");
    // With OpenFace's columns every frame of the recording has a row.
    let table = work.rows("segments/talk_openface.csv");
    assert_eq!(table.len() as i64, LENGTH + second);
    for row in &table {
        let Some(known) = frames.iter().find(|known| known["frame"] == row["frame"]) else {
            assert!(row["success"] == "0" && row["confidence"] == "0" && row["x_30"].is_empty() && row["AU12_r"].is_empty());
            continue;
        };
        let same = ["timestamp", "success", "AU12_r"];
        assert!(same.iter().all(|&column| row[column] == known[column]), "{row:?}, {known:?}");
        let (least, range) = if row["success"] == "1" { (0.8, 0.2) } else { (0.0, 0.7) };
        let confidence = least + range * number_of(known, "confidence");
        assert!((number_of(row, "confidence") - confidence).abs() < 1e-4, "{row:?}, {known:?}");
        // The tip of the nose lies in the picture, and landmark 9, the chin, below it.
        let [nose, chin] = ["y_30", "y_8"].map(|column| number_of(row, column));
        assert!(0.0 < nose && nose < chin && chin < 320.0, "{row:?}");
    }
    // The output is a manifest.
    work.grimace("run segments.csv -o out").exit(0);
    assert!(work.path("out/tracks/P1_talk-01.csv").is_file() && work.path("out/fap/happiness.fap").is_file());
    // A recording that has not changed is kept; results are not overwritten.
    let before = work.files("segments");
    work.grimace("segment talk -o segments.csv --subject P1 --emotion happiness").exit(1).says(&["segments.csv", "--force"]);
    work.grimace("segment talk -o segments.csv --subject P1 --emotion happiness --openface --force").exit(0);
    assert_eq!(work.files("segments"), before);
}

#[test]
fn a_smile_that_goes_on_after_a_gap_is_still_one() {
    let work = Work::new();
    let portrait = root().join("fixtures/portraits/P01.jpg");
    let simulate = "simulate -o smile --emotions happiness --frames 10 --yaw 0 --roll 0 --noise 1 --format jpg --photo";
    work.grimace(&format!("{simulate} {}", portrait.display())).exit(0);
    let frames: Vec<_> = work.files("smile").into_keys().filter(|name| name.ends_with("jpg")).collect();
    let [rest, apex] = [frames.first().unwrap(), frames.last().unwrap()].map(|name| work.path(&format!("smile/{name}")));
    // At rest, the smile, black, the smile again, black, and the smile for half a second.
    fs::create_dir_all(work.path("talk")).unwrap();
    let up = frames.iter().flat_map(|name| vec![Some(work.path(&format!("smile/{name}"))); 2]);
    let shots = std::iter::repeat_n(Some(rest), 22).chain(up).chain(vec![Some(apex.clone()); 14]);
    let size = image::image_dimensions(&apex).unwrap();
    let smile_after = |count: usize| std::iter::repeat_n(None, 16).chain(std::iter::repeat_n(Some(apex.clone()), count));
    for (k, shot) in shots.chain(smile_after(40)).chain(smile_after(14)).enumerate() {
        let target = work.path(&format!("talk/r_{:05}.jpg", k + 1));
        match shot {
            Some(frame) => fs::copy(frame, target).map(|_| ()).unwrap(),
            None => image::RgbImage::new(size.0, size.1).save(target).unwrap(),
        }
    }
    let ran = work.grimace("segment talk -o segments.csv --no-faces --openface");
    ran.exit(0)
        .prints(&["frames 73 to 112: what would be their rest shows an expression beside frame", "they are measured against"])
        .prints(&["frames 129 to 142: too short to show a rest; they are measured against frame"]);
    let rows = work.rows("segments/talk_openface.csv");
    let mean =
        |from: usize, to: usize| rows[from..to].iter().map(|row| number_of(row, "AU12_r")).sum::<f64>() / (to - from) as f64;
    let [rest, before, after, last] = [mean(0, 20), mean(44, 54), mean(78, 108), mean(130, 140)];
    assert!(rest < 0.3 && before > 1.5 && after.min(last) > 0.5 * before, "{rest} {before} {after} {last}");
    // The smile is no rest, and no second expression.
    assert_eq!(work.rows("segments.csv").len(), 1);
    assert!(work.rows("segments/talk_frames.csv").iter().filter(|row| row["stretch"] == "2").all(|row| row["phase"] != "rest"));
}

#[test]
fn labels_by_a_person_are_kept_when_a_recording_is_segmented_again() {
    let work = Work::new();
    record(&work, "talk", &expression("005")[10..78]);
    let segment = |more: &str| work.grimace(&format!("segment talk -o segments.csv --no-faces --force {more}")).exit(0);
    segment("");
    let table = work.read("segments.csv");
    let mut edited = String::new();
    for (k, line) in table.lines().enumerate() {
        let line = line.replace("unlabelled", "happiness").replacen("talk,", "P7,", 1);
        edited += &format!("{line},{}\n", if k == 0 { "publish" } else { "no" });
    }
    work.write("segments.csv", &edited);
    segment("").says(&["labels kept from the old table: 1 sequence", "columns kept from the old table: publish"]);
    assert_eq!(work.read("segments.csv"), edited);
    // Frames that were changed and rows that were added are in a copy of the table; the label is kept.
    let first = work.rows("segments.csv")[0]["first_frame"].clone();
    let moved = edited.replace(&format!(",{first},"), &format!(",{},", first.parse::<u32>().unwrap() + 1));
    assert_ne!(moved, edited);
    let by_hand = format!("{moved}P7,talk-09,fear,talk,900,910,,25,1,yes\n");
    work.write("segments.csv", &by_hand);
    segment("").says(&[
        "the old table had other frames: talk-01 (happiness, frames ",
        "in the old table, but not found now: talk-09 (fear, frames 900 to 910)",
        "the old table is kept as segments_edited.csv",
    ]);
    assert_eq!((work.read("segments.csv"), work.read("segments_edited.csv")), (edited.clone(), by_hand.clone()));
    work.write("segments.csv", &by_hand);
    segment("").says(&["the old table is kept as segments_edited-2.csv"]);
    segment("--emotion joy").says(&["the old table had other labels: talk-01 (happiness, now joy)"]);
    assert_eq!(work.rows("segments.csv")[0]["emotion"], "joy");
    // Rows of a recording that is not named are not dropped.
    let table = work.read("segments.csv");
    record(&work, "other", &expression("005")[10..78]);
    work.grimace("segment other -o segments.csv --no-faces --force")
        .exit(1)
        .says(&["segments.csv: the table also has sequences of talk, whose rows would be lost; name this recording too"]);
    assert_eq!(work.read("segments.csv"), table);
    // Another spelling of the path of a named recording is that recording.
    work.write("segments.csv", table.replace(",talk,", ",./other/../talk,"));
    segment("");
    work.write("segments.csv", &table);
    // A record of a newer version of the program leaves the table unchanged.
    let (table, known) = (work.read("segments.csv"), work.read("segments/talk.json"));
    record(&work, "dark", &DARK);
    work.write("segments/talk.json", known.replacen("\"schema_version\": 2", "\"schema_version\": 9", 1));
    work.grimace("segment dark talk -o segments.csv --no-faces --force")
        .exit(1)
        .says(&["talk.json: schema version 9", "give another name for the table of `segment`"]);
    assert_eq!(work.read("segments.csv"), table);
    work.write("segments/talk.json", known);
    work.write("segments.csv", format!("{edited}P7,talk-02\n"));
    work.grimace("segment talk -o segments.csv --no-faces --force")
        .exit(1)
        .says(&["line 3", "would be lost: repair it, or move it away"]);
}

#[test]
fn corrected_marks_are_kept_and_pictures_are_updated() {
    let work = Work::new();
    record(&work, "talk", &expression("005")[10..78]);
    let segment = |more: &str| work.grimace(&format!("segment talk -o segments.csv --force {more}"));
    segment("").exit(0);
    let picture = work.path("segments/talk-01.png");
    assert!(picture.is_file());
    let marks = work.read("segments/talk-01.csv");
    let corrected =
        marks.lines().map(|line| if line.starts_with("5,") { "5,150,150,mark" } else { line }).collect::<Vec<_>>().join("\n");
    work.write("segments/talk-01.csv", &corrected);
    segment("").exit(0);
    assert_eq!(work.read("segments/talk-01.csv"), corrected);
    segment("--no-faces").exit(0);
    assert!(!picture.exists());
    // Corrected marks have precedence over a picture; another option divides the recording again.
    segment("").exit(0);
    assert!(!picture.exists() && work.read("segments/talk-01.csv") == corrected);
    segment("--shortest 0.21").exit(0).prints(&["talk-01.csv were edited; they are kept as talk-01_edited.csv"]);
    assert!(picture.is_file());
    assert_eq!((work.read("segments/talk-01_edited.csv"), work.read("segments/talk-01.csv")), (corrected, marks));
    // Files of sequences that are no longer proposed are removed.
    segment("--high 60").exit(1).prints(&["0 sequences proposed", "no expression was found"]);
    segment("--high 60 -q").exit(1).says(&["failed: talk: found no expression"]);
    assert!(!picture.exists() && !work.path("segments/talk-01.csv").exists());
}

#[test]
fn a_recording_in_a_manifest_is_segmented_by_run() {
    let work = Work::new();
    // The recording begins in the middle of the expression: the rest after it is the neutral.
    let shots = &expression("005")[34..];
    record(&work, "data/talk", shots);
    work.write("data/manifest.csv", "subject,sequence,emotion,frames,segment\nP1,talk,happiness,talk,auto\n");
    work.grimace("run data -o out").exit(0).prints(&["1 sequence: 1 tracked"]);
    let info: serde_json::Value = serde_json::from_str(&work.read("out/tracks/P1_talk-01.json")).unwrap();
    let (neutral, apex) = (info["neutral_frame"].as_i64().unwrap(), info["apex_frame"].as_i64().unwrap());
    assert!(neutral > apex && is_apex(apex, 1 - 34), "neutral {neutral}, apex {apex}");
    let frames: Vec<i64> = work.rows("out/tracks/P1_talk-01.csv").iter().map(|r| number(r, "frame")).collect();
    assert!(frames.is_sorted() && frames[0] == apex && *frames.last().unwrap() == neutral, "{neutral} {apex}");
    work.grimace("run data -o out").exit(0).prints(&["nothing changed"]);
    // A person who may no longer be shown is not shown.
    let picture = work.path("out/segments/P1/talk-01.png");
    assert!(picture.is_file());
    let manifest = work.read("data/manifest.csv");
    work.write("data/manifest.csv", "subject,sequence,emotion,frames,segment,publish\nP1,talk,happiness,talk,auto,no\n");
    work.grimace("run data -o out --force --fit-force 21").exit(0);
    assert!(!picture.exists());
    work.write("data/manifest.csv", manifest);
    work.grimace("run data -o out --force").exit(0);
    assert!(picture.is_file());
    // Nothing is found in one of two recordings: it is reported.
    record(&work, "data/still", &[Shot::Face("005", 1); 26]);
    work.grimace("segment data/talk data/still -o some.csv")
        .exit(3)
        .prints(&["still: 0 sequences proposed", "1 sequence written"]);
    let two = "subject,sequence,emotion,frames,segment\nP1,talk,happiness,talk,auto\nP2,still,happiness,still,auto\n";
    work.write("data/manifest.csv", two);
    work.grimace("run data -o out").exit(3).prints(&["2 sequences: 0 tracked, 1 unchanged, 1 failed"]);
    let failures = work.rows("out/failures.csv");
    assert_eq!(failures.len(), 1, "{failures:?}");
    assert_eq!((failures[0]["id"].as_str(), failures[0]["stage"].as_str()), ("P2_still", "dataset"));
    assert!(failures[0]["reason"].ends_with("found no sequence: no expression was found"), "{failures:?}");
    work.grimace("run data -o out").exit(3).prints(&["nothing changed"]);
    work.write("alone.csv", "subject,sequence,emotion,frames,segment\nP2,still,happiness,data/still,auto\n");
    work.grimace("run alone.csv -o nothing").exit(1).says(&["none of the 1 sequences", "no expression was found"]);
    // A row with the name of a part of another row, and a row with its own frames.
    let rows = "P1,talk,happiness,talk,auto,,\nP1,talk-01,surprise,talk,,1,20\nP3,part,happiness,talk,auto,1,20\n";
    work.write("data/doubles.csv", format!("subject,sequence,emotion,frames,segment,first_frame,last_frame\n{rows}"));
    work.grimace("run data/doubles.csv -o out --force").exit(3);
    let reasons: Vec<String> = work.rows("out/failures.csv").iter().map(|r| r["reason"].clone()).collect();
    assert!(reasons.iter().any(|r| r.contains("would be named P1_talk-01, but P1_talk-01 exists already")), "{reasons:?}");
    assert!(reasons.iter().any(|r| r.contains("leave them empty")), "{reasons:?}");
    // `locate` accepts a table of segments as a manifest, too.
    work.grimace("locate some.csv -o points.csv").exit(0).prints(&["1 picture, 1 face"]);
}

#[test]
fn a_recording_keeps_the_times_of_its_frames() {
    let work = Work::new();
    record(&work, "talk", &expression("005"));
    // Frames are 40 ms apart, from the middle on 60 ms; no rate is stated.
    let files = work.files("talk");
    let frames: Vec<Vec<u8>> = files.values().cloned().collect();
    let times: Vec<u64> = (0..LENGTH as u64).map(|k| 40 * k + 20 * k.saturating_sub(43)).collect();
    let length = times[times.len() - 1] + 60;
    work.write("talk.mkv", matroska(&frames, &times, None, length as f64));
    let ran = work.grimace("segment talk.mkv -o segments.csv --subject P1 --emotion happiness").exit(0);
    ran.prints(&["talk.mkv: 1 sequence proposed", "the frames are 40 to 60 ms apart (mean rate: 19.95 frames per second)"]);
    let rows = work.rows("segments.csv");
    assert!(rows.len() == 1 && is_apex(number(&rows[0], "last_frame"), 1), "{rows:?}");
    assert_eq!(rows[0]["fps"], "", "the rate of the video is better known");
    for row in work.rows("segments/talk_frames.csv") {
        let time = times[number(&row, "frame") as usize - 1] as f64 / 1e3;
        assert!((row["timestamp"].parse::<f64>().unwrap() - time).abs() < 1e-9, "{row:?}");
    }
    // The part from the middle of the expression on is enough to propose a sequence.
    let (frames, times) = (&frames[34..], &times[34..]);
    let times: Vec<u64> = times.iter().map(|time| time - times[0]).collect();
    work.write("part.mkv", matroska(frames, &times, None, (times[times.len() - 1] + 60) as f64));
    work.grimace("segment part.mkv -o given.csv --fps 30").exit(0);
    assert_eq!(work.rows("given.csv")[0]["fps"], "30");
    assert_eq!(work.rows("given/part_frames.csv")[3]["timestamp"], "0.1");
}

#[test]
fn a_sequence_may_go_back_in_time() {
    let work = Work::with_sequences(&["S001_005"]);
    let files = work.files("faces/S001/005");
    let pictures: Vec<&String> = files.keys().filter(|name| !name.ends_with(".csv")).collect();
    let extension = pictures[0].rsplit('.').next().unwrap().to_owned();
    let count = pictures.len();
    for (k, name) in pictures.iter().enumerate() {
        work.write(&format!("back/S001/005/b_{:03}.{extension}", count - k), &files[*name]);
    }
    work.write("back/S001/005/correspondences.csv", work.bytes("faces/S001/005/correspondences.csv"));
    let rows = format!("subject,sequence,emotion,first_frame,last_frame\nS001,005,happiness,{count},1\n");
    work.write("back/manifest.csv", rows);
    work.write("forth/manifest.csv", "subject,sequence,emotion,frames,correspondences\nS001,005,happiness,../faces/S001/005,../faces/S001/005/correspondences.csv\n");
    work.grimace("run forth -o there").exit(0);
    work.grimace("run back -o out").exit(0);
    // The same pictures in the same order give the same model, whatever their numbers.
    assert_eq!(work.read("there/models/S001_005.csv"), work.read("out/models/S001_005.csv"));
    let rows = work.rows("out/features/S001_005.csv");
    assert!(rows.iter().map(|r| number(r, "frame")).is_sorted());
    let info: serde_json::Value = serde_json::from_str(&work.read("out/tracks/S001_005.json")).unwrap();
    assert_eq!((info["neutral_frame"].as_u64(), info["apex_frame"].as_u64()), (Some(count as u64), Some(1)));
    // Reading the files again gives the same result.
    work.grimace("analyze out/tracks -o again").exit(0);
    assert_eq!(work.read("again/representatives/happiness.csv"), work.read("out/representatives/happiness.csv"));
}

#[test]
fn an_input_that_is_not_a_recording_is_reported() {
    let work = Work::new();
    record(&work, "dark", &DARK);
    work.grimace("segment dark -o a.csv").exit(1).says(&["dark", "no face was found"]);
    assert!(!work.path("a.csv").exists());
    record(&work, "short", &expression("005")[..12]);
    work.grimace("segment short -o a.csv").exit(1).says(&["short", "too short for a rest and an expression"]);
    record(&work, "one", &expression("005")[..1]);
    work.grimace("segment one -o a.csv")
        .exit(1)
        .says(&["too short for a rest", "1 frame; at least 25 are needed at 25 frames per second"]);
    work.grimace("segment one -o a.csv --fps 1").exit(1).says(&["1 frame; at least 2 are needed at 1 frame per second"]);
    work.grimace("segment one -o a.csv --high 0.5 --low 2").exit(1).says(&["give a smaller --low"]);
    work.grimace("segment nothing -o a.csv").exit(1).says(&["nothing: there is no such folder"]);
    work.grimace("segment short other/short -o a.csv").exit(1);
    work.grimace("segment short -o short.csv").exit(1).says(&["among the frames of the recording"]);
    work.write("full/notes.txt", "");
    work.grimace("segment short -o full.csv").exit(1).says(&["holds other files"]);
    work.grimace("segment short -o a.csv --subject A/B").exit(1).says(&["path separator"]);
    work.grimace("segment short -o a.csv --emotion a/b").exit(1).says(&["emotion"]);
    work.grimace("segment short -o segments").exit(1).says(&["the table must end in .csv"]);
    work.grimace("segment short -o a.csv --correspondences c.csv").exit(2).says(&["--neutral-frame"]);
    work.write("c.csv", "node,x,y\n20,1,1\n23,2,2\n56,3,1\n");
    work.grimace("segment short -o a.csv -c c.csv --neutral-frame 99").exit(1).says(&["frame 99", "frames 1 to 12"]);
    // Marks beside the face, in a frame that is read.
    record(&work, "whole", &expression("005")[..40]);
    work.grimace("locate whole/r_00001.jpg -o found.csv").exit(0);
    let shifted = work
        .rows("found.csv")
        .iter()
        .map(|r| format!("{},{},{}\n", r["node"], number_of(r, "x") + 30.0, r["y"]))
        .collect::<String>();
    work.write("shifted.csv", format!("node,x,y\n{shifted}"));
    work.grimace("segment whole -o a.csv -c shifted.csv --neutral-frame 1")
        .exit(1)
        .says(&["frame 1: the marks are not on the face"]);
    // In a manifest only that recording fails.
    work.write("manifest.csv", "subject,sequence,emotion,frames,segment\nP1,dark,anger,dark,auto\n");
    work.grimace("run manifest.csv -o out").exit(1).says(&["no face was found"]);
}

#[test]
fn a_cut_to_another_person_is_detected_and_frames_beside_a_gap_are_kept() {
    let work = Work::new();
    let (first, second, nobody) = (vec![("P01.jpg", 130, 1.0)], vec![("P10.jpg", 130, 1.0)], Vec::new());
    let frames: Vec<_> = [(27, &first), (8, &nobody), (26, &first), (26, &second)]
        .iter()
        .flat_map(|(count, faces)| std::iter::repeat_n((*faces).clone(), *count))
        .collect();
    record_before_a_wall(&work, "talk", &frames);
    let said = [
        "a face in 79 of 87 frames",
        "frame 28: from here no face is found",
        "frame 36: a face is found again",
        "frame 62: the face of another person appears, as after a cut",
    ];
    work.grimace("segment talk -o segments.csv --no-faces").exit(1).prints(&said);
    let rows = work.rows("segments/talk_frames.csv");
    let stretches: Vec<(i64, i64)> = rows.iter().map(|r| (number(r, "frame"), number(r, "stretch"))).collect();
    let expected = (1..=27).map(|k| (k, 1)).chain((36..=61).map(|k| (k, 2))).chain((62..=87).map(|k| (k, 3)));
    assert_eq!(stretches, expected.collect::<Vec<_>>());
    // The share of visible nodes is the last column.
    assert!(work.read("segments/talk_frames.csv").lines().next().unwrap().ends_with(",confidence"));
    assert!(rows.iter().all(|r| r["confidence"].parse::<f64>().is_ok_and(|c| (0.5..=1.0).contains(&c))));
}

#[test]
fn of_two_people_one_is_followed_and_this_is_reported() {
    let work = Work::new();
    let frames = vec![vec![("P01.jpg", 10, 1.0), ("P10.jpg", 250, 0.9)]; 40];
    record_before_a_wall(&work, "two", &frames);
    let said = "frame 1: found 2 faces; the largest on average is followed";
    let ran = work.grimace("segment two -o segments.csv --no-faces");
    ran.exit(1).prints(&[said, "a face in 40 of 40 frames"]);
    assert!(work.rows("segments/two_frames.csv").iter().all(|row| row["stretch"] == "1"));
}

#[test]
fn of_two_commands_with_one_table_the_second_does_not_begin() {
    let work = Work::new();
    record(&work, "dark", &DARK);
    fs::create_dir_all(work.path("segments")).unwrap();
    let claim = fs::File::open(work.path("segments")).unwrap();
    claim.lock().unwrap();
    let said = ["segments", "another command is writing into this folder; wait for it"];
    work.grimace("segment dark -o segments.csv").exit(1).says(&said);
    drop(claim);
    work.grimace("segment dark -o segments.csv").exit(1).says(&["no face was found"]);
    // The folder was there before; one that was not does not stay.
    assert!(work.path("segments").exists() && !work.path("segments.csv").exists());
    work.grimace("segment dark -o other.csv").exit(1);
    assert!(!work.path("other").exists());
}
