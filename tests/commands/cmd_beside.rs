//! Marks that do not lie on the face of their picture: every command that takes marks warns about them, and does not warn about correct
//! marks.

use crate::common::{Work, root};

/// Makes a smiling portrait as the dataset `faces`: its frames, its marks, and a manifest.
fn smiling() -> Work {
    let work = Work::new();
    let fixture = |name: &str| root().join("fixtures").join(name).display().to_string();
    let (smile, portrait) = (fixture("golden/fap/happiness.fap"), fixture("portraits/P01.jpg"));
    let marks = fixture("portraits/P01_correspondences.csv");
    work.grimace(&format!("clone --source {smile} --target {portrait} -c {marks} -o clone -q")).exit(0);
    for (name, bytes) in work.files("clone/frames") {
        work.write(&format!("faces/P01/001/{name}"), bytes);
    }
    work.write("faces/manifest.csv", "subject,sequence,emotion\nP01,001,happiness\n");
    work.write(MARKS, std::fs::read(marks).unwrap());
    work
}

const MARKS: &str = "faces/P01/001/correspondences.csv";

/// Writes a copy of the marks, each moved by `moved`.
fn move_marks(work: &Work, to: &str, moved: impl Fn(u16, f64, f64) -> (f64, f64)) {
    let rows = work.rows(MARKS);
    let row = |row: &std::collections::BTreeMap<String, String>| {
        let [x, y] = ["x", "y"].map(|axis| row[axis].parse::<f64>().unwrap());
        let (x, y) = moved(row["node"].parse().unwrap(), x, y);
        format!("{},{x},{y}\n", row["node"])
    };
    let text: String = rows.iter().map(row).collect();
    work.write(to, format!("node,x,y\n{text}"));
}

#[test]
fn shifted_marks_are_reported_and_correct_ones_are_not() {
    let work = smiling();
    work.grimace("run faces -o right").exit(0);
    let verdict = |out: &str| work.rows(&format!("{out}/verdicts.csv"))[0].clone();
    assert_eq!((verdict("right")["verdict"].as_str(), verdict("right")["reasons"].as_str()), ("good", ""));
    // The eyes of the portrait are 107 px apart: 30 px are 0.28 of that.
    move_marks(&work, MARKS, |_, x, y| (x + 30.0, y));
    let said = "the marks lie 30 px (0.28 of the eye distance) from the face found in the picture; check that they belong to this frame \
         and this person";
    work.grimace("check faces").exit(3).prints(&[&format!("look again: P01_001: {said}")]);
    work.grimace("check faces --check-marks off").exit(0);
    work.grimace("run faces -o beside").exit(0).prints(&["the marks of 1 of 1 sequences do not fit the face found", said]);
    assert_eq!((verdict("beside")["verdict"].as_str(), verdict("beside")["reasons"].as_str()), ("look again", said));
    assert!(work.read("beside/report.html").contains("0.28 of the eye distance"));
    // A second run and a new analysis of the tracks keep the verdict.
    work.grimace("analyze beside/tracks -o again").exit(0);
    assert_eq!(verdict("again")["reasons"], said);
    work.grimace("run faces -o trusted --check-marks off").exit(0);
    assert_eq!(verdict("trusted")["verdict"], "good");
}

#[test]
fn fit_and_track_report_which_marks_miss_the_face() {
    let work = smiling();
    let first = "faces/P01/001/P01_00000001.png";
    let quiet = work.grimace(&format!("fit {first} -c {MARKS} -o right.csv")).exit(0);
    assert!(!quiet.stdout.contains("note"), "{}", quiet.stdout);
    // The left mouth corner is 30 px further out and 20 px higher, on the cheek.
    move_marks(&work, "cheek.csv", |node, x, y| if node == 31 { (x + 30.0, y - 20.0) } else { (x, y) });
    let said = "some marks do not lie on their features in the picture: left mouth corner";
    work.grimace(&format!("fit {first} -c cheek.csv -o fit.csv")).exit(0).prints(&["note: ", said]);
    work.grimace("track faces/P01/001 -c cheek.csv -o track.csv").exit(0).prints(&[said, "verdict: look again"]);
    // A file with the coordinates of a picture three quarters as large.
    move_marks(&work, "other_size.csv", |_, x, y| (0.75 * x, 0.75 * y));
    let scaled = work.grimace(&format!("fit {first} -c other_size.csv -o scaled.csv")).exit(0);
    scaled.prints(&["from the face found in the picture and fit a face 0.7", "check that they belong to a picture of this size"]);
    let off = work.grimace(&format!("fit {first} -c cheek.csv -o off.csv --check-marks off")).exit(0);
    assert!(!off.stdout.contains(said), "{}", off.stdout);
    // If no face is found, there is no warning.
    image::GrayImage::from_fn(440, 560, |x, y| image::Luma([(40 + (x * 7 + y * 3) % 60) as u8]))
        .save(work.path("wall.png"))
        .unwrap();
    let wall = work.grimace("fit wall.png -c cheek.csv -o wall.csv").exit(0);
    assert!(!wall.stdout.contains("picture"), "{}", wall.stdout);
}

#[test]
fn marks_of_another_picture_size_are_reported_for_lost_faces_and_portraits() {
    let work = smiling();
    move_marks(&work, "half.csv", |_, x, y| (0.5 * x, 0.5 * y));
    move_marks(&work, "shares.csv", |_, x, y| (x / 440.0, y / 560.0));
    let asks = "check that they belong to a picture of this size";
    // At a point without texture nothing can be tracked.
    let lost = work.grimace("track faces/P01/001 -c shares.csv -o track.csv").exit(1);
    lost.says(&["the face is lost: the marks lie", "fit a face 0.00 times as large", asks]);
    let unchecked = work.grimace("track faces/P01/001 -c shares.csv -o track.csv --check-marks off").exit(1);
    assert!(!unchecked.stderr.contains("the marks lie"), "{}", unchecked.stderr);
    let portrait = root().join("fixtures/portraits/P01.jpg").display().to_string();
    let smile = root().join("fixtures/golden/fap/happiness.fap").display().to_string();
    let half = [portrait.as_str(), " with half.csv: the marks lie 192 px (1.79 of the eye distance)", asks];
    work.grimace(&format!("clone -s {smile} -t {portrait} -c half.csv -o clone-half -q")).exit(0).says(&half);
    work.grimace(&format!("play {smile} --portrait {portrait} -c half.csv -o half.html")).exit(0).says(&half);
    let head = "synthesize -b head --format glb --solver nnls --bound-starts 0";
    work.grimace(&format!("{head} -m {smile} --portrait {portrait} --correspondences half.csv -o head")).exit(0).says(&half);
    let right = work.grimace(&format!("play {smile} --portrait {portrait} -c {MARKS} -o right.html")).exit(0);
    assert!(!right.stderr.contains("the marks"), "{}", right.stderr);
    work.write(MARKS, work.read("shares.csv"));
    let run = work.grimace(&format!("run faces -o results --portrait {portrait} -c half.csv")).exit(1);
    run.says(&["note: --portrait", "the marks lie 192 px", "the face is lost: the marks lie"]);
}
