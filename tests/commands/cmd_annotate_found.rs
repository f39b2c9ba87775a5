//! Marks that `grimace annotate` proposes: found, from landmarks, of one picture; datasets without a manifest.

use crate::annotation::Server;
use crate::cmd_annotate::{open, save, true_marks, unmarked};
use crate::common::Work;
use serde_json::{Value, json};
use std::fs;

#[test]
fn proposed_sequences_are_shown_with_their_confidence() {
    // Both have all their marks; only one is a proposal.
    let work = Work::with_sequences(&["S001_005", "S002_007"]);
    let manifest = work.read("faces/manifest.csv");
    let lines: Vec<String> =
        manifest.lines().zip(["confidence", "0.62", ""]).map(|(line, confidence)| format!("{line},{confidence}\n")).collect();
    work.write("faces/manifest.csv", lines.concat());
    let server = Server::start(&work, "faces");
    let list = server.get("api/sequences").ok();
    assert_eq!((list["sequences"].as_array().unwrap().len(), &list["left"], &list["total"]), (1, &json!(0), &json!(2)));
    assert_eq!(list["sequences"][0]["confidence"], 0.62);
    assert_eq!(list["sequences"][0]["id"], "S001_005");
}

/// Makes the two sequences of [`unmarked`] in the layout of Cohn-Kanade.
fn cohn_kanade() -> Work {
    let work = unmarked();
    for (subject, sequence, code) in [("S001", "005", 5), ("S002", "007", 7)] {
        for (name, bytes) in work.files(&format!("faces/{subject}/{sequence}")) {
            if name.ends_with(".png") {
                work.write(&format!("ck/cohn-kanade-images/{subject}/{sequence}/{name}"), bytes);
            }
        }
        work.write(
            &format!("ck/Emotion/{subject}/{sequence}/{subject}_{sequence}_00000006_emotion.txt"),
            format!("   {code}.0000000e+00\n"),
        );
    }
    work
}

#[test]
fn a_dataset_without_a_manifest_gets_one_by_consent_only() {
    let work = cohn_kanade();
    let server = Server::start(&work, "ck");
    let opened = open(&server, "S001_005");
    // Marks need no manifest: they are beside the frames.
    save(&server, "S001_005", &opened["version"], &true_marks("S001/005")).ok();
    assert_eq!(work.rows("ck/cohn-kanade-images/S001/005/correspondences.csv").len(), true_marks("S001/005").len());
    let opened = open(&server, "S001_005");
    let mut request = json!({"version": opened["version"], "neutral": 2, "apex": 5});
    let asked = server.send("PUT", "api/sequences/S001_005/range", &request);
    assert_eq!((asked.status, &asked.json()["consent"]), (428, &json!(true)));
    assert!(!work.path("ck/manifest.csv").exists());
    request["createManifest"] = json!(true);
    server.send("PUT", "api/sequences/S001_005/range", &request).ok();
    assert_eq!(
        work.read("ck/manifest.csv"),
        "subject,sequence,emotion,frames,first_frame,last_frame,correspondences,landmarks\n\
         S001,005,happiness,cohn-kanade-images/S001/005,2,5,cohn-kanade-images/S001/005/correspondences.csv,\n\
         S002,007,surprise,cohn-kanade-images/S002/007,,,,\n"
    );
    drop(server);
    let server = Server::start(&work, "ck --all");
    let opened = open(&server, "S001_005");
    assert_eq!((&opened["neutral"], opened["marks"].as_array().unwrap().len()), (&json!(2), true_marks("S001/005").len()));
}

#[test]
fn proposals_come_from_landmarks_and_missing_cascades_are_explained() {
    let work = unmarked();
    let header: String = (0..68).map(|k| format!(",x{k},y{k}")).collect();
    let points: String = (0..68).map(|k| format!(",{k},{}", k + 10)).collect();
    work.write("faces/S001/005/landmarks.csv", format!("frame{header}\n1{points}\n"));
    let manifest = work.read("faces/manifest.csv");
    let mut lines = manifest.lines();
    let header = lines.next().unwrap();
    let rows: Vec<String> = lines.map(|l| format!("{l}{}", if l.starts_with("S001") { ",landmarks.csv" } else { "," })).collect();
    work.write("faces/manifest.csv", format!("{header},landmarks\n{}\n", rows.join("\n")));
    // A wall instead of a face.
    for number in 1..=2 {
        let path = work.path(&format!("faces/S002/wall/{number}.png"));
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        image::GrayImage::from_fn(160, 120, |x, y| image::Luma([(100 + (x / 40 + y / 30) % 3) as u8])).save(path).unwrap();
    }
    let manifest = work.read("faces/manifest.csv");
    let fields = manifest.lines().next().unwrap().split(',').map(|column| match column {
        "subject" => "S002",
        "sequence" => "wall",
        "emotion" => "anger",
        "frames" => "S002/wall",
        _ => "",
    });
    let row = fields.collect::<Vec<_>>().join(",");
    work.write("faces/manifest.csv", format!("{manifest}{row}\n"));
    let server = Server::start(&work, "faces --cascades .");
    let proposed = server.get("api/sequences/S001_005/proposals").ok();
    assert_eq!((&proposed["source"], proposed["marks"].as_array().unwrap().len()), (&json!("landmarks"), 11));
    // Landmark 8, from 0, is the chin, node 10.
    let chin = proposed["marks"].as_array().unwrap().iter().find(|mark| mark["node"] == 10).unwrap();
    assert_eq!((&chin["x"], &chin["y"], &chin["kind"]), (&json!(8.0), &json!(18.0), &json!("mark")), "{chin}");
    let none = server.get("api/sequences/S002_wall/proposals").ok();
    assert_eq!((&none["source"], none["marks"].as_array().unwrap().len()), (&Value::Null, 0));
    assert!(none["note"].as_str().unwrap().contains("apt-get install opencv-data"), "{none}");
    // Proposals are never saved before they are accepted.
    assert!(!work.path("faces/S001/005/correspondences.csv").exists());
    assert_eq!(open(&server, "S001_005")["marks"], json!([]));
}

/// Copies the first composite portrait of the fixtures as `NAME.jpg` and `NAME/1.jpg`, `NAME/2.jpg`.
fn portrait(work: &Work, name: &str) {
    let folder = crate::common::root().join("fixtures/portraits");
    let mut pictures: Vec<_> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    pictures.retain(|path| path.extension().is_some_and(|e| e == "jpg"));
    pictures.sort();
    let bytes = fs::read(&pictures[0]).unwrap();
    for file in [format!("{name}.jpg"), format!("faces/{name}/1.jpg"), format!("faces/{name}/2.jpg")] {
        work.write(&file, &bytes);
    }
}

#[test]
fn a_found_face_is_proposed_with_its_expected_errors_and_accepted_by_a_limit() {
    let work = Work::new();
    portrait(&work, "anna");
    work.write("faces/anna/by_hand.csv", "node,x,y\n20,10,10\n");
    let manifest = "subject,sequence,emotion,frames,correspondences\nA,found,joy,anna,\nA,hand,joy,anna,anna/by_hand.csv\n";
    work.write("faces/manifest.csv", manifest);
    let server = Server::start(&work, "faces");
    let found = server.get("api/sequences/A_found/proposals").ok();
    assert_eq!(found["source"], "found", "{found}");
    let marks = found["marks"].as_array().unwrap();
    assert!(marks.len() > 40 && marks.iter().all(|m| m["expected_error"].as_f64().unwrap() > 0.0), "{found}");
    // Accepted unchanged, they keep their expected errors.
    let version = open(&server, "A_found")["version"].clone();
    save(&server, "A_found", &version, marks).ok();
    assert_eq!(work.header("faces/A/found/correspondences.csv"), "node,x,y,kind,expected_error");
    drop(server);
    fs::remove_dir_all(work.path("faces/A")).unwrap();
    work.write("faces/manifest.csv", manifest);
    // No points are that certain: all remain to be reviewed.
    let server = Server::start(&work, "faces --accept 0.001");
    assert_eq!(server.lines[0], "accepted the found marks of 0 sequences");
    assert!(server.lines[1].contains("not accepted: A_found: the median expected error of the points is"), "{:?}", server.lines);
    drop(server);
    let server = Server::start(&work, "faces --accept 5 --all");
    assert_eq!(server.lines[0], "accepted the found marks of 1 sequence");
    assert!(open(&server, "A_found")["marks"].as_array().unwrap().len() > 30);
    // A mark set by hand has precedence.
    assert_eq!(open(&server, "A_hand")["marks"].as_array().unwrap().len(), 1);
    drop(server);
    work.grimace("annotate faces --accept -1 --no-open").exit(2);
    // `--no-page` opens no page, and the command ends.
    work.grimace("annotate faces --accept 5 --no-page")
        .exit(3)
        .prints(&["1 of 1 sequence left to mark", "A_hand: it has 1 mark"]);
    work.write("faces/manifest.csv", "subject,sequence,emotion,frames\nA,found,joy,anna\n");
    fs::remove_dir_all(work.path("faces/A")).unwrap();
    work.grimace("annotate faces --accept 0.001 --no-page")
        .exit(3)
        .prints(&["not accepted: A_found: the median", "1 of 1 sequence left"]);
    work.grimace("annotate faces --accept 5 --no-page")
        .exit(0)
        .prints(&["accepted the found marks of 1 sequence", "0 of 1 sequence left to mark"]);
    work.grimace("annotate faces --accept 5 --no-page").exit(0).prints(&["nothing is left to mark"]);
    work.grimace("annotate faces --no-page").exit(2);
}

#[test]
fn one_picture_is_marked_beside_itself() {
    let work = Work::new();
    portrait(&work, "anna");
    let server = Server::start(&work, "anna.jpg");
    let opened = open(&server, "anna_picture");
    assert_eq!((&opened["frames"], &opened["file"]), (&json!([1]), &json!("anna.csv")));
    assert_eq!(server.get("api/sequences/anna_picture/frames/1").status, 200);
    let marks = [json!({"node": 20, "x": 100.5, "y": 90.25, "kind": "mark"})];
    save(&server, "anna_picture", &opened["version"], &marks).ok();
    assert_eq!(work.read("anna.csv"), "node,x,y,kind\n20,100.5,90.25,mark\n");
    let range = json!({"version": open(&server, "anna_picture")["version"], "neutral": 1, "apex": 1});
    let refused = server.send("PUT", "api/sequences/anna_picture/range", &range);
    assert!(refused.status == 422 && refused.text().contains("one picture"), "{}", refused.text());
    assert!(!work.path("manifest.csv").exists());
    drop(server);
    work.grimace("annotate anna.jpg --tracks anna").exit(1);
}

#[test]
fn the_face_of_one_picture_is_proposed_and_accepted() {
    let work = Work::new();
    portrait(&work, "anna");
    let server = Server::start(&work, "anna.jpg");
    let found = server.get("api/sequences/anna_picture/proposals").ok();
    assert_eq!((&found["source"], &found["note"]), (&json!("found"), &Value::Null), "{found}");
    assert!(found["marks"].as_array().unwrap().len() > 40, "{found}");
    assert!(!work.path("anna.csv").exists());
    drop(server);
    let server = Server::start(&work, "anna.jpg --accept 5");
    assert_eq!(server.lines[0], "accepted the found marks of 1 sequence");
    assert_eq!(work.header("anna.csv"), "node,x,y,kind,expected_error");
    let opened = open(&server, "anna_picture");
    assert_eq!(opened["marks"].as_array().unwrap().len(), work.rows("anna.csv").len());
    drop(server);
    work.grimace("fit anna.jpg -c anna.csv -o fit.csv").exit(0);
    // A file in the place of the marks that is not a file of marks is reported and kept.
    for text in ["", "eggs\nmilk\n"] {
        work.write("anna.csv", text);
        let ran = work.grimace("annotate anna.jpg --accept 5 --no-page").exit(3);
        ran.prints(&[
            "accepted the found marks of 0 sequences",
            "not accepted: anna_picture: ",
            "anna.csv",
            "correct the file or move it away",
        ]);
        assert_eq!(work.read("anna.csv"), text);
    }
}
