//! Landmarks of other programs instead of pictures.

use crate::common::Work;
use grimace::internal::wireframe::{Tables, Wireframe};

/// Returns landmarks of Candide-3 in an image of about 500 px, with the mouth corners moved by `smile` px out and up.
pub fn face(smile: f64) -> Vec<(f64, f64)> {
    let frontal = Wireframe::candide3().frontal();
    let landmarks = Tables::candide3().landmarks;
    let place = |(k, row): (usize, &grimace::internal::wireframe::LandmarkRow)| {
        let sum = row.nodes.iter().map(|(n, w)| frontal[n.index()].coords * *w).sum::<nalgebra::Vector2<f64>>();
        let (dx, dy) = match k {
            48 | 60 => (-smile, -smile),
            54 | 64 => (smile, -smile),
            _ => (0.0, 0.0),
        };
        (300.0 + 160.0 * sum.x + dx, 300.0 - 160.0 * sum.y + dy)
    };
    landmarks.iter().enumerate().map(place).collect()
}

pub fn own(frames: &[(u32, f64)]) -> String {
    let header: String = (0..68).map(|k| format!(",x{k},y{k}")).collect();
    let row = |&(frame, smile): &(u32, f64)| {
        format!("{frame}{}\n", face(smile).iter().map(|(x, y)| format!(",{x},{y}")).collect::<String>())
    };
    format!("frame{header}\n{}", frames.iter().map(row).collect::<String>())
}

fn open_face(frames: &[(u32, f64, f64)]) -> String {
    let names = |axis: &str| (0..68).map(|k| format!(", {axis}_{k}")).collect::<String>();
    let row = |&(frame, smile, confidence): &(u32, f64, f64)| {
        let face = face(smile);
        let xs: String = face.iter().map(|(x, _)| format!(", {x}")).collect();
        let ys: String = face.iter().map(|(_, y)| format!(", {y}")).collect();
        format!("{frame}, 0, 0.0, {confidence}, 1{xs}{ys}\n")
    };
    let header = format!("frame, face_id, timestamp, confidence, success{}{}\n", names("x"), names("y"));
    header + &frames.iter().map(row).collect::<String>()
}

fn pts(smile: f64) -> String {
    // These formats count from 1.
    let points: String = face(smile).iter().map(|(x, y)| format!("{} {}\n", x + 1.0, y + 1.0)).collect();
    format!("version: 1\nn_points: 68\n{{\n{points}}}\n")
}

fn ck(smile: f64) -> String {
    face(smile).iter().map(|(x, y)| format!("   {x:.7e}   {y:.7e}\n")).collect()
}

/// Returns the x offset of a node at the apex of a model, face units.
pub fn moved(work: &Work, model: &str, node: &str) -> f64 {
    let rows = work.rows(model);
    let x = |frame: &str| rows.iter().find(|r| r["frame"] == frame && r["node"] == node).unwrap()["x"].parse::<f64>().unwrap();
    x("4") - x("0")
}

#[test]
fn every_form_of_landmarks_gives_the_same_model_beside_images() {
    let work = Work::with_sequences(&["S001_005"]);
    let manifest = work.read("faces/manifest.csv");
    // The manifest of the simulated dataset may or may not have columns for landmarks and frames: missing ones are added.
    let mut text = manifest;
    for name in ["frames", "landmarks"] {
        if !text.lines().next().unwrap().split(',').any(|c| c == name) {
            let mut lines = text.lines();
            let header = format!("{},{name}", lines.next().unwrap());
            text = std::iter::once(header).chain(lines.map(|l| format!("{l},"))).collect::<Vec<_>>().join("\n") + "\n";
        }
    }
    work.write("faces/manifest.csv", &text);
    let manifest = text;
    let header = manifest.lines().next().unwrap().to_owned();
    let row = |subject: &str, frames: &str, landmarks: &str| {
        let value = |name: &str| match name {
            "subject" => subject,
            "sequence" => "1",
            "emotion" => "happiness",
            "frames" => frames,
            "landmarks" => landmarks,
            _ => "",
        };
        header.split(',').map(value).collect::<Vec<_>>().join(",")
    };
    work.write("faces/own.csv", own(&[(1, 0.0), (2, 10.0)]));
    work.write("faces/openface.csv", open_face(&[(1, 0.0, 0.98), (2, 10.0, 0.9)]));
    for (frame, smile) in [(1, 0.0), (2, 10.0)] {
        work.write(&format!("faces/pts/p_{frame:04}.pts"), pts(smile));
        work.write(&format!("faces/ck/S9_1_{frame:08}_landmarks.txt"), ck(smile));
    }
    let rows =
        [row("A", "own.csv", ""), row("B", "openface.csv", ""), row("C", "pts", ""), row("D", "ck", ""), row("E", "", "own.csv")];
    work.write("faces/manifest.csv", format!("{manifest}{}\n", rows.join("\n")));
    work.grimace("run faces -o out --resample linear").exit(0).prints(&["6 sequences: 6 tracked"]);
    // 10 px on a face whose eyes are 160 * 0.613 px apart are 10 * 1024 / 98.1 = 104 face units, less what the springs hold
    // back.
    let own_x = moved(&work, "out/models/A_1.csv", "31");
    assert!((95.0..105.0).contains(&own_x), "{own_x}");
    for other in ["B", "C", "D", "E"] {
        let x = moved(&work, &format!("out/models/{other}_1.csv"), "31");
        assert!((x - own_x).abs() < 1e-4, "{other}: {x} {own_x}");
    }
    // Linear in time: a quarter of the motion at frame 1.
    let states: Vec<String> = work.rows("out/tracks/A_1.csv").into_iter().map(|r| r["state"].clone()).collect();
    let count = |state: &str| states.iter().filter(|s| *s == state).count();
    assert_eq!((count("tracked"), count("recovered_no_landmark"), count("follows")), (52, 52, 18));
    let json: serde_json::Value = serde_json::from_str(&work.read("out/tracks/C_1.json")).unwrap();
    assert_eq!(json["source"], serde_json::json!(["p_0001.pts", "p_0002.pts"]));
    assert_eq!((&json["marks_from"], &json["image_size"]["width"]), (&"landmarks".into(), &0.into()));
    // On a second run nothing is repeated; one changed landmark repeats only its sequence.
    work.grimace("run faces -o out --resample linear").exit(0).prints(&["nothing changed"]);
    work.write("faces/own.csv", own(&[(1, 0.0), (2, 12.0)]));
    work.grimace("run faces -o out --resample linear").exit(0).prints(&["2 tracked, 4 unchanged"]);
}

#[test]
fn bad_landmark_files_fail_their_sequence_with_a_reason() {
    let work = Work::new();
    let mut manifest = "subject,sequence,emotion,frames\n".to_owned();
    let good = own(&[(1, 0.0), (2, 8.0)]);
    let files = [
        ("good", good.clone(), None),
        ("count", good.replace(",x67,y67", ""), Some("67 points, 68 were expected")),
        ("commas", good.replacen("\n1,", "\n1,3,5,", 1), Some("decimal commas")),
        ("lost", open_face(&[(1, 0.0, 0.1), (2, 5.0, 0.2)]), Some("lost in all 2 frames")),
        ("end", open_face(&[(1, 0.0, 0.9), (2, 5.0, 0.2)]), Some("frame 2, the apex frame")),
        ("gap", own(&[(1, 0.0), (2, 1.0), (900, 8.0)]), Some("only 3 of 900 frames")),
        ("empty", String::new(), Some("is empty")),
    ];
    for (name, text, _) in &files {
        work.write(&format!("people/{name}.csv"), text);
        manifest += &format!("{name},1,happiness,{name}.csv\n");
    }
    manifest += "missing,1,happiness,missing.csv\n";
    work.write("people/manifest.csv", manifest);
    work.grimace("run people -o out --resample linear").exit(3).prints(&["8 sequences: 1 tracked, 0 unchanged, 7 failed"]);
    let failures = work.rows("out/failures.csv");
    for (name, _, reason) in &files {
        let failure = failures.iter().find(|f| f["subject"] == *name);
        match reason {
            None => assert!(failure.is_none()),
            Some(reason) => assert!(failure.unwrap()["reason"].contains(reason), "{name}: {}", failure.unwrap()["reason"]),
        }
    }
}
