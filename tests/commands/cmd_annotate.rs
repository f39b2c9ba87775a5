//! `grimace annotate` over plain HTTP: what it saves, what it refuses, and how it recovers. The page itself is tested in
//! `annotate_page.rs`.

use crate::annotation::Server;
use crate::common::Work;
use serde_json::{Value, json};
use std::fs;

/// Makes two sequences without correspondences and without a column for them.
pub fn unmarked() -> Work {
    let work = Work::with_sequences(&["S001_005", "S002_007"]);
    for name in ["faces/S001/005/correspondences.csv", "faces/S002/007/correspondences.csv"] {
        fs::remove_file(work.path(name)).unwrap();
    }
    let column = work.header("faces/manifest.csv").split(',').position(|name| name == "correspondences").unwrap();
    let without =
        |line: &str| line.split(',').enumerate().filter(|(k, _)| *k != column).map(|(_, f)| f).collect::<Vec<_>>().join(",");
    let lines: Vec<String> = work.read("faces/manifest.csv").lines().map(without).collect();
    work.write("faces/manifest.csv", lines.join("\n") + "\n");
    work
}

/// Returns the simulation's marks of a sequence.
pub fn true_marks(sequence: &str) -> Vec<Value> {
    let file = &crate::common::FACES[&format!("{sequence}/correspondences.csv")];
    let rows = csv::Reader::from_reader(file.as_slice()).into_deserialize::<(u16, f64, f64)>().map(Result::unwrap);
    rows.map(|(node, x, y)| json!({"node": node, "x": x, "y": y, "kind": "mark"})).collect()
}

pub fn save(server: &Server, id: &str, version: &Value, marks: &[Value]) -> crate::annotation::Answer {
    server.send("PUT", &format!("api/sequences/{id}/marks"), &json!({"version": version, "marks": marks}))
}

pub fn open(server: &Server, id: &str) -> Value {
    server.get(&format!("api/sequences/{id}")).ok()
}

#[test]
fn marks_are_saved_byte_for_byte_where_fit_and_run_find_them() {
    let work = unmarked();
    let manifest = work.read("faces/manifest.csv");
    let server = Server::start(&work, "faces");
    for (id, folder) in [("S001_005", "S001/005"), ("S002_007", "S002/007")] {
        let opened = open(&server, id);
        assert_eq!((opened["marks"].as_array().unwrap().len(), &opened["problem"]), (0, &Value::Null));
        let mut marks = true_marks(folder);
        let first = save(&server, id, &opened["version"], &marks).ok();
        let path = format!("faces/{folder}/correspondences.csv");
        let bytes = work.bytes(&path);
        assert!(work.header(&path) == "node,x,y,kind" && work.rows(&path).len() == marks.len());
        // If the answer was lost and the marks are sent again in another order, the bytes are the same and there is no
        // conflict.
        marks.reverse();
        assert_eq!(save(&server, id, &opened["version"], &marks).ok()["version"], first["version"]);
        assert_eq!(work.bytes(&path), bytes);
        assert_eq!(open(&server, id)["version"], first["version"]);
    }
    assert_eq!(server.get("api/sequences").ok()["left"], 0);
    // The manifest names the files; everything else in it is unchanged.
    let named = work.read("faces/manifest.csv");
    let without: String = named.lines().map(|line| line.rsplit_once(',').unwrap().0.to_owned() + "\n").collect();
    assert_eq!(without, manifest);
    assert!(named.lines().nth(1).unwrap().ends_with(",S001/005/correspondences.csv"), "{named}");
    drop(server);
    work.grimace("fit faces/S001/005/S001_005_00000001.png -c faces/S001/005/correspondences.csv -o fit.csv").exit(0);
    work.grimace("run faces -o results -q").exit(0);
    assert_eq!(work.rows("results/failures.csv").len(), 0);
    // No partly written file remains.
    assert!(crate::common::leftovers(&work.files("faces")).is_empty());
}

#[test]
fn a_hard_position_is_kept_as_such_and_released() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let mut marks = true_marks("S001/005");
    let version = open(&server, "S001_005")["version"].clone();
    marks.push(json!({"node": 6, "x": 100.25, "y": 90.5, "kind": "hard"}));
    let version = save(&server, "S001_005", &version, &marks).ok()["version"].clone();
    let text = work.read("faces/S001/005/correspondences.csv");
    assert!(text.contains("\n6,100.25,90.5,hard\n"), "{text}");
    marks.pop();
    save(&server, "S001_005", &version, &marks).ok();
    assert!(!work.read("faces/S001/005/correspondences.csv").contains("hard"));
}

#[test]
fn removing_all_marks_restores_the_sequence() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let version = open(&server, "S001_005")["version"].clone();
    let saved = save(&server, "S001_005", &version, &true_marks("S001/005")).ok();
    let emptied = save(&server, "S001_005", &saved["version"], &[]).ok();
    assert_eq!((&emptied["version"], &emptied["left"]), (&version, &json!(2)));
    assert!(!work.path("faces/S001/005/correspondences.csv").exists());
    assert!(work.read("faces/manifest.csv").lines().nth(1).unwrap().ends_with(','), "the field is empty again");
}

#[test]
fn two_tabs_do_not_overwrite_each_other() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let (first, second) = (open(&server, "S001_005"), open(&server, "S001_005"));
    let marks = true_marks("S001/005");
    save(&server, "S001_005", &first["version"], &marks).ok();
    let bytes = work.bytes("faces/S001/005/correspondences.csv");
    let refused = save(&server, "S001_005", &second["version"], &marks[..3]);
    assert_eq!(refused.status, 409);
    let current = &refused.json()["current"];
    assert_eq!(current["marks"].as_array().unwrap().len(), marks.len());
    assert_eq!(work.bytes("faces/S001/005/correspondences.csv"), bytes, "nothing was written");
    // With the current version, the marks may be replaced.
    save(&server, "S001_005", &current["version"], &marks[..3]).ok();
    // A change by an editor is like a change in another tab.
    work.replace("faces/S001/005/correspondences.csv", "mark", "hard");
    assert_eq!(save(&server, "S001_005", &current["version"], &marks).status, 409);
}

#[test]
fn a_killed_server_loses_nothing() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let marks = true_marks("S001/005");
    let mut version = open(&server, "S001_005")["version"].clone();
    for count in 1..=marks.len() {
        version = save(&server, "S001_005", &version, &marks[..count]).ok()["version"].clone();
    }
    server.kill();
    assert!(crate::common::leftovers(&work.files("faces")).is_empty());
    let server = Server::start(&work, "faces");
    assert_eq!(server.lines[0], "1 of 1 sequence left to mark");
    assert_eq!(server.get("api/sequences").ok()["sequences"][0]["id"], "S002_007");
    drop(server);
    let server = Server::start(&work, "faces --all");
    let opened = open(&server, "S001_005");
    assert_eq!((opened["marks"].as_array().unwrap().len(), &opened["version"]), (marks.len(), &version));
}

#[test]
fn wrong_marks_are_refused_and_the_file_stays() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let opened = open(&server, "S001_005");
    let saved = save(&server, "S001_005", &opened["version"], &true_marks("S001/005")).ok();
    let bytes = work.bytes("faces/S001/005/correspondences.csv");
    let mark = |node: u32, x: f64, y: f64| json!({"node": node, "x": x, "y": y});
    let cases = [
        (vec![mark(20, -3.0, 10.0)], "outside the image of 200x160"),
        (vec![mark(20, 10.0, 1e300)], "outside the image"),
        (vec![mark(20, 10.0, 10.0), mark(20, 11.0, 10.0)], "node 20 is marked twice"),
        (vec![mark(35, 10.0, 10.0)], "node 35 cannot be marked"),
        (vec![mark(113, 10.0, 10.0)], "node 113 cannot be marked"),
    ];
    for (marks, reason) in cases {
        let refused = save(&server, "S001_005", &saved["version"], &marks);
        assert_eq!(refused.status, 422);
        assert!(refused.json()["error"].as_str().unwrap().contains(reason), "{}", refused.text());
    }
    assert_eq!(work.bytes("faces/S001/005/correspondences.csv"), bytes);
    assert_eq!(save(&server, "S009_009", &saved["version"], &[]).status, 404);
    // A file that cannot be read may be somebody's work: it is not replaced.
    work.write("faces/S002/007/correspondences.csv", "node,x,y\n20,ten,10\n");
    let opened = open(&server, "S002_007");
    assert!(opened["problem"].as_str().unwrap().contains("x is `ten`"), "{opened}");
    let refused = save(&server, "S002_007", &opened["version"], &true_marks("S002/007"));
    assert!(refused.status == 422 && refused.text().contains("correct the file or move it away"), "{}", refused.text());
    assert!(work.read("faces/S002/007/correspondences.csv").contains("ten"));
}

#[test]
fn any_frame_may_be_neutral_or_apex() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let opened = open(&server, "S001_005");
    assert_eq!((&opened["neutral"], &opened["apex"], opened["frames"].as_array().unwrap().len()), (&json!(1), &json!(6), 6));
    let range = |version: &Value, neutral: u32, apex: u32| {
        server.send("PUT", "api/sequences/S001_005/range", &json!({"version": version, "neutral": neutral, "apex": apex}))
    };
    let changed = range(&opened["version"], 2, 5).ok();
    assert_eq!((&changed["neutral"], &changed["apex"]), (&json!(2), &json!(5)));
    let row = |work: &Work| work.rows("faces/manifest.csv")[0].clone();
    assert_eq!((row(&work)["first_frame"].as_str(), row(&work)["last_frame"].as_str()), ("2", "5"));
    assert_eq!(range(&opened["version"], 1, 6).status, 409, "another tab has changed the frames");
    assert!(range(&changed["version"], 5, 5).text().contains("cannot be both the neutral and the apex frame"));
    assert!(range(&changed["version"], 2, 7).text().contains("there is no frame 7"));
    assert_eq!(row(&work)["first_frame"], "2");
    drop(server);
    // If the named frame no longer exists, the first frame is shown and can be chosen.
    work.replace("faces/manifest.csv", ",2,5", ",0,5");
    let server = Server::start(&work, "faces");
    let opened = open(&server, "S001_005");
    assert_eq!((&opened["neutral"], &opened["apex"]), (&json!(1), &json!(5)));
    assert!(opened["problem"].as_str().unwrap().starts_with("first_frame is 0 in the manifest, but the frames are 1 to 6"));
    let refused = save(&server, "S001_005", &opened["version"], &true_marks("S001/005"));
    assert!(refused.status == 422 && refused.text().contains("first_frame is 0"), "marks on another frame are refused");
    server.send("PUT", "api/sequences/S001_005/range", &json!({"version": opened["version"], "neutral": 1, "apex": 5})).ok();
    assert_eq!(row(&work)["first_frame"], "1");
}

#[test]
fn a_video_is_marked_and_scrubbed_like_images() {
    let work = unmarked();
    if !crate::common::video::write_video(&work, "faces/S001/005", "faces/face.avi") {
        return;
    }
    work.write("faces/manifest.csv", "subject,sequence,emotion,frames\nS001,005,happiness,face.avi\n");
    let server = Server::start(&work, "faces");
    let opened = open(&server, "S001_005");
    assert_eq!((&opened["frames"], &opened["width"], &opened["apex"]), (&json!([1, 2, 3, 4, 5, 6]), &json!(200), &json!(6)));
    let frame = server.get("api/sequences/S001_005/frames/4");
    let shown = image::load_from_memory(&frame.body).unwrap().to_luma8();
    let still = image::open(work.path("faces/S001/005/S001_005_00000004.png")).unwrap().to_luma8();
    let differences = shown.iter().zip(still.iter()).map(|(a, b)| f64::from(a.abs_diff(*b)));
    assert!(differences.sum::<f64>() / f64::from(200 * 160) < 5.0, "frame 4 is shown, up to JPEG compression");
    assert_eq!(server.get("api/sequences/S001_005/frames/7").status, 404);
    save(&server, "S001_005", &opened["version"], &true_marks("S001/005")).ok();
    work.grimace("run faces -o results -q").exit(0);
    drop(server);
    let server = Server::start(&work, "--tracks results");
    let track = open(&server, "S001_005");
    let body = json!({"version": track["version"], "frame": 3, "corrections": [{"node": 31, "x": 90.5, "y": 100.25}]});
    let corrected = server.send("PUT", "api/sequences/S001_005/corrections", &body).ok();
    let again = server.send("POST", "api/sequences/S001_005/retrack", &json!({"version": corrected["version"], "frame": 3})).ok();
    assert_eq!(
        (&again["frames"][2]["nodes"][31], &again["frames"][2]["states"][31]),
        (&json!([90.5, 100.25]), &json!("corrected"))
    );
}

#[test]
fn inputs_that_cannot_be_annotated_are_reported() {
    let work = unmarked();
    work.grimace("annotate").exit(2);
    work.grimace("annotate nowhere --no-open").exit(1).says(&["nowhere: there is no such dataset"]);
    work.grimace("annotate --tracks nowhere --no-open").exit(1).says(&["nowhere"]);
    fs::create_dir(work.path("empty")).unwrap();
    work.grimace("annotate faces --tracks empty --no-open").exit(1).says(&["no tracks found"]);
    work.write("bad/manifest.csv", "subject,sequence,emotion\n../x,1,joy\n");
    work.grimace("annotate bad --no-open").exit(1).says(&["no sequence can be annotated", "path separator"]);
    let marked = Work::after_run(&["S001_005"], "results");
    fs::rename(marked.path("faces"), marked.path("elsewhere")).unwrap();
    marked
        .grimace("annotate --tracks results --no-open")
        .exit(1)
        .says(&["the dataset of this run, `faces`, is neither", "grimace annotate DATASET --tracks"]);
    let server = Server::start(&marked, "elsewhere --tracks results");
    assert_eq!(server.lines[0], "1 track: the first of those to look at opens; the list has most lost nodes first");
}

#[test]
fn a_file_that_the_manifest_no_longer_lists_is_not_written() {
    let work = Work::with_sequences(&["S001_005"]);
    let server = Server::start(&work, "faces --all");
    let opened = open(&server, "S001_005");
    work.write("faces/other.csv", "node,x,y\n20,80,60\n53,120,60\n31,80,100\n");
    work.replace("faces/manifest.csv", "S001/005/correspondences.csv", "other.csv");
    let before = work.bytes("faces/S001/005/correspondences.csv");
    let answer = save(&server, "S001_005", &opened["version"], &true_marks("S001/005")[..4]);
    assert_eq!(answer.status, 409, "{}", answer.text());
    assert_eq!(work.bytes("faces/S001/005/correspondences.csv"), before);
    let now = open(&server, "S001_005");
    assert_eq!((&now["file"], now["marks"].as_array().unwrap().len()), (&json!("other.csv"), 3));
    save(&server, "S001_005", &now["version"], &true_marks("S001/005")[..4]).ok();
    assert_eq!(work.rows("faces/other.csv").len(), 4);
    assert_eq!(work.bytes("faces/S001/005/correspondences.csv"), before);
    // A sequence that is no longer in the manifest is not saved.
    work.write("faces/manifest.csv", format!("{}\n", work.header("faces/manifest.csv")) + "S009,001,fear,,,,,,,,,,\n");
    assert_ne!(save(&server, "S001_005", &now["version"], &true_marks("S001/005")).status, 200);
}
