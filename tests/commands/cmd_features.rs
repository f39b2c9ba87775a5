//! `grimace features` and the features of a run: commands and their output.

use grimace::internal::{
    pose::{HEAD_ES, HeadModel, HeadPose},
    wireframe::{Tables, Wireframe},
};
use nalgebra::{Point2, Point3, Vector3};

use crate::common::{Work, assert_same_files};

/// Returns landmarks of the mean head in three frames, 100 px between the pupils: neutral, then half and all of a turn (yaw, degrees) and a
/// smile.
fn turning(yaw: f64, smile: f64) -> String {
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let head = HeadModel::shipped(&wireframe, &tables);
    let mut text: String = std::iter::once("frame".to_owned()).chain((0..68).map(|k| format!(",x{k},y{k}"))).collect();
    for frame in 1..=3 {
        let share = f64::from(frame - 1) / 2.0;
        let pose = HeadPose {
            rotation: HeadPose::rotation_of(yaw * share, 0.0, 0.0),
            scale: 100.0 / HEAD_ES,
            position: Point2::new(320.0, 240.0),
            distance: 11.0 * HEAD_ES,
        };
        let mut shape = head.mean.clone();
        for named in head.shapes.iter().filter(|shape| shape.name.starts_with("mouthSmile")) {
            shape.iter_mut().zip(&named.offsets).for_each(|(x, d)| *x += d * (smile * share));
        }
        text += &format!("\n{frame}");
        for row in &tables.landmarks {
            let place: Vector3<f64> = row.nodes.iter().map(|(n, w)| shape[n.index()] * *w).sum();
            let seen = pose.project(&Point3::from(place));
            text += &format!(",{:.4},{:.4}", seen.x, seen.y);
        }
    }
    text + "\n"
}

fn dataset(work: &Work, rows: &[(&str, f64, f64)]) {
    let mut manifest = "subject,sequence,emotion,frames,fps\n".to_owned();
    for (subject, yaw, smile) in rows {
        work.write(&format!("heads/{subject}.csv"), turning(*yaw, *smile));
        manifest += &format!("{subject},1,happiness,{subject}.csv,25\n");
    }
    work.write("heads/manifest.csv", manifest);
}

fn number(row: &std::collections::BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column} is `{}`", row[column]))
}

#[test]
fn motions_keep_their_time_at_any_frame_rate() {
    let work = Work::new();
    dataset(&work, &[("A", 0.0, 0.8), ("B", 0.0, 0.8)]);
    let table = work.read("heads/B.csv");
    // The frames of B are at 0, 0.1 and 0.5 s.
    let times = ["timestamp", "3", "3.1", "3.5"];
    let timed: String = table.lines().zip(times).map(|(row, time)| format!("{row},{time}\n")).collect();
    work.write("heads/B.csv", timed);
    work.write("heads/manifest.csv", "subject,sequence,emotion,frames,fps\nA,1,happiness,A.csv,12.5\nB,1,happiness,B.csv,\n");
    work.grimace("run heads -o out").exit(0);
    let header = |name: &str| work.read(name).lines().find(|line| line.starts_with("2.1")).unwrap().to_owned();
    // Three frames at 12.5 per second become six at 25, a whole number.
    assert_eq!(header("out/fap/tracks/A_1.fap").split_whitespace().skip(2).collect::<Vec<_>>(), ["25", "6"]);
    let seconds = |name: &str| work.rows(name).iter().map(|row| row["timestamp"].clone()).collect::<Vec<_>>();
    assert_eq!(seconds("out/features/A_1.csv"), ["0", "0.08", "0.16"]);
    assert_eq!(seconds("out/features/B_1.csv"), ["0", "0.1", "0.5"]);
    // Four frames per second on average, over half a second.
    assert_eq!(header("out/fap/tracks/B_1.fap").split_whitespace().skip(2).collect::<Vec<_>>(), ["4", "3"]);
    // A stated rate is used from then on, and no longer when it is removed. The results are the same as if it had been so from
    // the beginning, and nothing is tracked again.
    let table = |fps: &str| format!("subject,sequence,emotion,frames,fps\nA,1,happiness,A.csv,12.5\nB,1,happiness,B.csv,{fps}\n");
    for (fps, expected) in [("20", ["0", "0.05", "0.1"]), ("10", ["0", "0.1", "0.2"]), ("", ["0", "0.1", "0.5"])] {
        work.write("heads/manifest.csv", table(fps));
        work.grimace("run heads -o out").exit(0).prints(&["2 sequences: 0 tracked, 2 unchanged, 0 failed"]);
        assert_eq!(seconds("out/features/B_1.csv"), expected, "{fps}");
        work.grimace(&format!("run heads -o fresh{fps}")).exit(0);
        assert_same_files(&work.files("out"), &work.files(&format!("fresh{fps}")));
        work.grimace("run heads -o out").exit(0).prints(&["nothing changed since the last run"]);
    }
}

#[test]
fn a_run_writes_pose_action_units_and_faps_of_every_frame() {
    let work = Work::new();
    dataset(&work, &[("A", 12.0, 0.8)]);
    work.grimace("run heads -o out").exit(0);
    let rows = work.rows("out/features/A_1.csv");
    assert_eq!(rows.len(), 3);
    assert!(number(&rows[0], "pose_yaw").abs() < 1.0 && (number(&rows[2], "pose_yaw") - 12.0).abs() < 1.0, "{:?}", rows[2]);
    // FAP 49 is the yaw in 1e-5 rad; 12 degrees are 0.2094 rad.
    assert!((number(&rows[2], "FAP49_head_yaw") - 20944.0).abs() < 1800.0);
    // A smile of 0.8 is an intensity of 4 out of 5; no brow was raised.
    assert!((number(&rows[2], "AU12_r") - 4.0).abs() < 0.8 && number(&rows[2], "AU01_r") < 0.8, "{:?}", rows[2]);
    assert_eq!((rows[2]["AU12_c"].as_str(), rows[0]["AU12_c"].as_str(), rows[2]["success"].as_str()), ("1", "0", "1"));
    assert_eq!(rows[2]["timestamp"], "0.08");
    let json: serde_json::Value = serde_json::from_str(&work.read("out/features/A_1.json")).unwrap();
    assert!(json["units"]["pose_yaw, pose_pitch, pose_roll"].as_str().unwrap().contains("degrees"));
    assert_eq!(json["action_units"]["AU12"], "lip corner puller");
    work.grimace("fap check out/fap/tracks/A_1.fap").exit(0);
    // The same results from the tracks alone.
    work.grimace("features out/tracks -o again").exit(0);
    assert_eq!(work.read("again/A_1.csv"), work.read("out/features/A_1.csv"));
    work.grimace("features out/tracks -o again").exit(1).says(&["A_1.csv", "--force"]);
    let record = std::fs::File::options().append(true).open(work.path("again/features.b3")).unwrap();
    record.lock().unwrap();
    work.grimace("features out/tracks -o again --force").exit(1).says(&["another command is writing into this folder"]);
    drop(record);
    work.grimace("features out/tracks -o again --force").exit(0);
    work.write("again/A_1.json", "mine");
    work.grimace("features out/tracks -o again --force")
        .exit(1)
        .says(&["A_1.json: this file exists and differs from what an earlier `features`"]);
    assert_eq!(work.read("again/A_1.json"), "mine");
    work.write("file", "").grimace("features out/tracks -o file --force").exit(1).says(&["file: this is a file"]);
    work.grimace("features out/tracks -o two --units AU12,4").exit(0);
    let header = work.header("two/A_1.csv");
    assert!(header.contains("AU12_r") && header.contains("AU04_e") && !header.contains("AU01_r"), "{header}");
    work.grimace("features out/tracks -o none --units AU12,AU3").exit(2).says(&["`AU3` is not an action unit", "AU45"]);
}

#[test]
fn openface_s_names_are_read_back_as_landmarks() {
    let work = Work::new();
    dataset(&work, &[("A", 8.0, 0.8)]);
    work.grimace("run heads -o out").exit(0);
    work.grimace("features out/tracks -o openface --names openface").exit(0);
    let rows = work.rows("openface/A_1.csv");
    // 8 degrees to the subject's left are -0.14 rad there.
    assert!((number(&rows[2], "pose_Ry") + 8.0_f64.to_radians()).abs() < 0.02, "{}", rows[2]["pose_Ry"]);
    for column in ["face_id", "AU45_r", "AU45_c", "x_67", "y_67"] {
        assert!(rows[0].contains_key(column), "{column}");
    }
    // Landmarks that correspond to nodes are back at their positions.
    let given = work.rows("heads/A.csv");
    for landmark in [30, 36, 39, 45, 48, 54] {
        let off = number(&rows[0], &format!("x_{landmark}")) - number(&given[0], &format!("x{landmark}"));
        assert!(off.abs() < 0.01, "landmark {landmark}: {off} px");
    }
    work.write("back/manifest.csv", "subject,sequence,emotion,frames\nA,1,happiness,A.csv\n");
    work.write("back/A.csv", work.read("openface/A_1.csv"));
    work.grimace("run back -o returned").exit(0);
    let apex = |name: &str| {
        let row = work.rows(name).into_iter().find(|r| r["frame"] == "4" && r["node"] == "31").unwrap();
        number(&row, "x")
    };
    let (there, back) = (apex("out/models/A_1.csv"), apex("returned/models/A_1.csv"));
    assert!((there - back).abs() < 5.0, "{there} {back}");
}

#[test]
fn a_head_turned_too_far_is_reported() {
    let work = Work::new();
    dataset(&work, &[("near", 10.0, 0.5), ("far", 46.0, 0.5)]);
    work.grimace("run heads -o out").exit(0);
    let last = &work.rows("out/features/far_1.csv")[2];
    assert_eq!(last["success"], "0");
    assert!(last["reason"].contains("the head is turned by"), "{}", last["reason"]);
    let verdicts = work.rows("out/verdicts.csv");
    let of = |subject: &str| verdicts.iter().find(|r| r["subject"] == subject).unwrap().clone();
    assert_eq!(of("far")["verdict"], "look again");
    assert!(of("far")["reasons"].contains("turned by"), "{}", of("far")["reasons"]);
    assert!(!of("near")["reasons"].contains("turned by"), "{}", of("near")["reasons"]);
}

#[test]
fn inputs_that_are_not_tracks_or_faces_are_refused_by_name() {
    let work = Work::new();
    work.write("x.csv", "frame,node,x\n1,0,3\n");
    work.grimace("features x.csv -o out").exit(1).says(&["x.csv, line 1: has no column `y`"]);
    work.grimace("features nothing -o out").exit(1).says(&["nothing"]);
    work.write("joy.csv", "frame,node,x,y\n0,0,1,1\n1,0,2,2\n")
        .write("joy.json", "{\"emotion\": \"joy\", \"sequences\": [\"A_1\"]}");
    work.grimace("features joy.csv -o out").exit(1).says(&["joy.csv: this is a representative, not a track"]);
    // An OpenFace table without its landmarks.
    work.write("heads/manifest.csv", "subject,sequence,emotion,frames\nA,1,anger,A.csv\n");
    work.write("heads/A.csv", "frame,confidence,success,AU12_r\n1,0.9,1,0.5\n2,0.9,1,2.5\n");
    work.grimace("run heads -o out").exit(1).says(&["A.csv"]);
}

/// Returns a table of landmarks with one frame replaced.
fn with_frame(table: &str, frame: usize, points: impl Fn(usize, f64, f64) -> (f64, f64)) -> String {
    let mut lines: Vec<String> = table.lines().map(str::to_owned).collect();
    let numbers: Vec<f64> = lines[frame].split(',').skip(1).map(|n| n.parse().unwrap()).collect();
    let changed = (0..68).map(|k| points(k, numbers[2 * k], numbers[2 * k + 1]));
    lines[frame] = changed.fold(frame.to_string(), |line, (x, y)| format!("{line},{x:.4},{y:.4}"));
    lines.join("\n") + "\n"
}

#[test]
fn a_frame_without_a_pose_is_left_out_alone() {
    let work = Work::new();
    dataset(&work, &[("lost", 8.0, 0.8), ("same", 8.0, 0.8), ("wild", 8.0, 0.8)]);
    let table = work.read("heads/lost.csv");
    // Frames 1, 2 and 4; the third is missing.
    let lines: Vec<&str> = table.lines().collect();
    work.write("heads/lost.csv", [lines[0], lines[1], lines[2], &lines[3].replacen('3', "4", 1)].join("\n") + "\n");
    // All landmarks at one position; and the landmarks of one side of the face on the other side, upside down.
    work.write("heads/same.csv", with_frame(&table, 2, |_, _, _| (320.0, 240.0)));
    work.write("heads/wild.csv", with_frame(&table, 2, |k, x, y| if k % 2 == 0 { (640.0 - x, 480.0 - y) } else { (y, x) }));
    work.grimace("run heads -o out").exit(0);
    for (subject, reason) in [("lost", "the frame was lost"), ("same", "the frame was lost"), ("wild", "no pose of a head")] {
        let rows = work.rows(&format!("out/features/{subject}_1.csv"));
        let (bad, last) = (rows.len() - 2, rows.len() - 1);
        let expected: Vec<&str> = (0..rows.len()).map(|k| if k == bad { "0" } else { "1" }).collect();
        assert_eq!(rows.iter().map(|r| r["success"].as_str()).collect::<Vec<_>>(), expected, "{subject}");
        assert!(rows[bad]["reason"].contains(reason), "{subject}: {}", rows[bad]["reason"]);
        assert!((number(&rows[last], "pose_yaw") - 8.0).abs() < 1.0, "{subject}: {:?}", rows[last]);
    }
    let verdicts = work.rows("out/verdicts.csv");
    for verdict in &verdicts {
        let said = if verdict["subject"] == "lost" {
            "in 1 of 4 frames, first in frame 3"
        } else {
            "in 1 of 3 frames, first in frame 2"
        };
        assert!(verdict["reasons"].contains(&format!("found no head pose {said}")), "{verdict:?}");
    }
}

#[test]
fn marks_that_fit_no_head_are_an_error() {
    let work = Work::new();
    dataset(&work, &[("A", 8.0, 0.8), ("B", 8.0, 0.8)]);
    // A neutral face in which every second landmark lies on a ring around it.
    let table = work.read("heads/A.csv");
    let ring = |k: usize, x: f64, y: f64| {
        let turn = k as f64 * 2.4;
        if k.is_multiple_of(3) { (x, y) } else { (320.0 + 140.0 * turn.cos(), 240.0 + 140.0 * turn.sin()) }
    };
    work.write("heads/A.csv", with_frame(&table, 1, ring));
    work.grimace("run heads -o out").exit(3);
    let failure = &work.rows("out/failures.csv")[0];
    assert_eq!(failure["subject"], "A");
    assert!(failure["reason"].contains("frame 1") || failure["stage"] == "fit", "{failure:?}");
    assert!(failure["reason"].len() > 20, "{failure:?}");
}

#[test]
fn blendshapes_of_mediapipe_are_added_to_the_action_units() {
    let work = Work::new();
    dataset(&work, &[("A", 0.0, 0.8), ("B", 5.0, 0.4)]);
    work.grimace("run heads -o out").exit(0);
    let result =
        |smile: f64| format!(r#"{{"faceBlendshapes":[{{"categories":[{{"categoryName":"mouthSmileLeft","score":{smile}}}]}}]}}"#);
    work.write("theirs/A_1.json", format!("[{},{},{}]", result(0.0), result(0.4), result(0.8)));
    work.grimace("features out/tracks -o compared --blendshapes theirs").exit(0);
    let rows = work.rows("compared/A_1.csv");
    assert_eq!([0, 1, 2].map(|k| number(&rows[k], "mediapipe_mouthSmileLeft")), [0.0, 0.4, 0.8]);
    assert!(number(&rows[2], "AU12_r") > number(&rows[0], "AU12_r"));
    assert!(work.read("compared/A_1.json").contains("mediapipe_*"));
    // Sequences without OpenFace measurements have only grimace's columns.
    assert!(!work.rows("compared/B_1.csv")[0].contains_key("mediapipe_mouthSmileLeft"));
    let said = work.grimace("features out/tracks -o more --blendshapes theirs/A_1.json").exit(1);
    assert!(said.stderr.contains("for 2 tracks, give a folder"), "{}", said.stderr);
    work.write("short.json", format!("[{}]", result(0.0)));
    let said = work.grimace("features out/tracks/A_1.csv -o more --blendshapes short.json").exit(1);
    assert!(said.stderr.contains("1 results without frame numbers, but the track has 3 frames"), "{}", said.stderr);
}
