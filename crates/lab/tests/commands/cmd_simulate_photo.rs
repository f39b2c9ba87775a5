//! `grimace simulate --photo`, with a rendered neutral face as the photograph.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
    sync::LazyLock,
};

use crate::common::Run;
use grimace_lab::simulate::{Emotion, SimulateOptions, simulate_sequence};
use tempfile::TempDir;

fn grimace() -> Command {
    Command::new(crate::common::grimace())
}

/// A folder with `anna.png`, its marks `anna_correspondences.csv`, and its landmarks `points.csv`.
struct Photo {
    _folder: TempDir,
    path: PathBuf,
}

static PHOTO: LazyLock<Photo> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_owned();
    let options = SimulateOptions { frames: 2, width: 320, height: 240, seed: 3, ..SimulateOptions::default() };
    let neutral = simulate_sequence(&options, 1, Emotion::Fear).unwrap().next().unwrap();
    neutral.image.save(path.join("anna.png")).unwrap();
    let marks = [20, 23, 53, 56, 31, 64, 10, 7, 8, 6, 17, 50];
    let rows: String = marks
        .iter()
        .fold("node,x,y\n".to_owned(), |text, &n: &usize| format!("{text}{n},{},{}\n", neutral.nodes[n].x, neutral.nodes[n].y));
    fs::write(path.join("anna_correspondences.csv"), rows).unwrap();
    let tables = grimace::internal::wireframe::Tables::candide3();
    let points = tables.landmarks.iter().enumerate().fold("point,x,y\n".to_owned(), |text, (k, row)| {
        let at = |axis: usize| row.nodes.iter().map(|(n, w)| neutral.nodes[n.index()][axis] * w).sum::<f64>();
        format!("{text}{k},{},{}\n", at(0), at(1))
    });
    fs::write(path.join("points.csv"), points).unwrap();
    Photo { _folder: folder, path }
});

fn animate(photo: &Path, out: &Path) -> Command {
    let mut command = grimace();
    command.arg("simulate").arg("--photo").arg(photo).arg("-o").arg(out).args(["--frames", "5", "--emotions", "surprise"]);
    command
}

fn positions(path: &Path) -> BTreeMap<(u32, usize), [f64; 2]> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let row = |r: csv::StringRecord| ((r[0].parse().unwrap(), r[1].parse().unwrap()), [&r[2], &r[3]].map(|v| v.parse().unwrap()));
    reader.records().map(|r| row(r.unwrap())).collect()
}

#[test]
fn a_photograph_performs_and_the_tracker_finds_its_nodes_where_the_truth_says() {
    let folder = tempfile::tempdir().unwrap();
    let (out, results) = (folder.path().join("faces"), folder.path().join("results"));
    let photo = PHOTO.path.join("anna.png");
    let still = ["--noise", "0", "--roll", "0", "--shift", "0", "--scale-change", "0"];
    animate(&photo, &out).args(still).args(["--blink", "1"]).run().exit(0).prints(&["1 sequence of 1 subject, 5 frames"]);
    let manifest = fs::read_to_string(out.join("manifest.csv")).unwrap();
    assert_eq!(
        manifest.lines().collect::<Vec<_>>(),
        [
            "subject,sequence,emotion,frames,correspondences,fps,portrait",
            "anna,007,surprise,anna/007,anna/007/correspondences.csv,25.0,anna"
        ]
    );
    // Without noise and head motion, the first frame is the photograph.
    let open = |path: &Path| image::open(path).unwrap().into_rgb8();
    assert!(open(&out.join("anna/007/anna_007_00000001.png")) == open(&photo));
    let truth = positions(&out.join("truth/anna_007.csv"));
    assert_eq!(truth.len(), 5 * 113);
    let gap = |frame: u32, upper: usize, lower: usize| truth[&(frame, lower)][1] - truth[&(frame, upper)][1];
    // The jaw drops, the lips part, and at the apex the lids are open again.
    assert!(gap(5, 87, 40) > gap(1, 87, 40) + 4.0);
    assert!(truth[&(5, 10)][1] > truth[&(1, 10)][1] + 4.0);
    assert!((2..5).map(|frame| gap(frame, 21, 22)).fold(f64::INFINITY, f64::min) < 0.5 * gap(1, 21, 22));
    assert!(gap(5, 21, 22) >= gap(1, 21, 22));
    // Five frames to a wide open mouth are large steps; the rigid parts of the face are found within a fraction of a pixel.
    let mut evaluate = grimace();
    evaluate.args(["evaluate", "tracking"]).arg(&out).arg("-o").arg(&results).run().exit(0);
    let mut reader = csv::Reader::from_path(results.join("tracking_last.csv")).unwrap();
    let header = reader.headers().unwrap().clone();
    let at = |name: &str| header.iter().position(|h| h == name).unwrap();
    let nose = reader.records().map(Result::unwrap).find(|r| &r[at("part")] == "nose").unwrap();
    let px: f64 = nose[at("mean_px")].parse().unwrap();
    assert!(px < 1.0, "the nose is {px} px off");
}

#[test]
fn the_same_seed_gives_the_same_bytes_whatever_the_threads() {
    let folder = tempfile::tempdir().unwrap();
    let photo = PHOTO.path.join("anna.png");
    let faults = ["--shutter", "0.5", "--defocus", "0.6", "--gain-change", "0.1", "--compression", "80", "--yaw", "4"];
    let bytes = |threads: &str| {
        let out = folder.path().join(threads);
        animate(&photo, &out).args(faults).args(["--subjects", "2", "--threads", threads]).run().exit(0);
        ["anna/007/anna_007_00000004.png", "anna-2/007/anna-2_007_00000005.png", "truth/anna-2_007.csv", "manifest.csv"]
            .map(|file| fs::read(out.join(file)).unwrap())
    };
    assert!(bytes("1") == bytes("2"));
}

#[test]
fn landmarks_folders_and_datasets_are_accepted_as_portraits() {
    let folder = tempfile::tempdir().unwrap();
    let portraits = folder.path().join("portraits");
    fs::create_dir(&portraits).unwrap();
    for name in ["anna", "ben", "smiling"] {
        fs::copy(PHOTO.path.join("anna.png"), portraits.join(format!("{name}.png"))).unwrap();
        fs::copy(PHOTO.path.join("points.csv"), portraits.join(format!("{name}_landmarks68.csv"))).unwrap();
    }
    let (all, listed, again, one) = ("all", "listed", "again", "one");
    let out = |name: &str| folder.path().join(name);
    let subjects = |name: &str| {
        let mut reader = csv::Reader::from_path(out(name).join("manifest.csv")).unwrap();
        reader.records().map(|r| r.unwrap()[0].to_owned()).collect::<Vec<_>>()
    };
    animate(&portraits, &out(all)).run().exit(0);
    assert_eq!(subjects(all), ["anna", "ben", "smiling"]);
    fs::write(portraits.join("manifest.csv"), "file,state,publish,fps,age\nben.png,neutral,no,9,31\nsmiling.png,smile,,,\n")
        .unwrap();
    animate(&portraits, &out(listed)).run().exit(0);
    assert_eq!(subjects(listed), ["ben"]);
    // Columns about the person are copied, but not those about the original sequence.
    let manifest = fs::read_to_string(out(listed).join("manifest.csv")).unwrap();
    assert!(manifest.starts_with("subject,sequence,emotion,frames,correspondences,fps,portrait,age,publish\n"), "{manifest}");
    assert!(manifest.trim_end().ends_with(",25.0,ben,31,no"), "{manifest}");
    // A dataset as input: the neutral frames of its subjects.
    animate(&out(all), &out(again)).args(["--subjects", "4"]).run().exit(0);
    assert_eq!(subjects(again), ["anna", "ben", "smiling", "anna-2"]);
    let points = PHOTO.path.join("points.csv");
    animate(&PHOTO.path.join("anna.png"), &out(one)).arg("--landmarks").arg(points).run().exit(0);
    assert_eq!(subjects(one), ["anna"]);
}

#[test]
fn missing_marks_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let photo = folder.path().join("composite.jpg");
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/portraits");
    fs::copy(fixtures.join("P01.jpg"), &photo).unwrap();
    let out = folder.path().join("out");
    animate(&photo, &out).run().exit(0).says(&["marks that nobody set are found: composite"]);
    // The outer corner of an eye, compared with the hand-set mark: within 3 % of the 110 px between the eyes.
    let found = positions(&out.join("truth/composite_007.csv"))[&(1, 20)];
    let marks = fs::read_to_string(fixtures.join("P01_correspondences.csv")).unwrap();
    let set = marks.lines().find_map(|line| line.strip_prefix("20,")).unwrap().split(',').map(|v| v.parse::<f64>().unwrap());
    let off = found.into_iter().zip(set).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    assert!(off < 3.3, "{off}");
}

#[test]
fn fap_curves_are_performed_and_run_reads_the_layout_of_cohn_kanade() {
    let folder = tempfile::tempdir().unwrap();
    let (out, results) = (folder.path().join("ck"), folder.path().join("results"));
    // Frame 1: FAP 3 opens the mouth by half of MNS, and the corners move out.
    let fap = folder.path().join("happiness.fap");
    let mask = |set: &[usize]| (1..=68).map(|k| if set.contains(&k) { "1" } else { "0" }).collect::<Vec<_>>().join(" ");
    let set = mask(&[3, 6, 7]);
    fs::write(&fap, format!("2.1 test 25 2\n{set}\n0 0 0 0\n{set}\n1 500 200 200\n")).unwrap();
    let mut command = grimace();
    command.arg("simulate").arg("--photo").arg(PHOTO.path.join("anna.png")).arg("-o").arg(&out).arg("--fap").arg(&fap);
    command.args([
        "--frames",
        "4",
        "--layout",
        "cohn-kanade",
        "--yaw",
        "0",
        "--roll",
        "0",
        "--shift",
        "0",
        "--scale-change",
        "0",
    ]);
    command.run().exit(0);
    let truth = positions(&out.join("truth/anna_008.csv"));
    let moved = |node: usize, axis: usize| truth[&(4, node)][axis] - truth[&(1, node)][axis];
    // The subject's left is at the image's right.
    assert!(
        moved(31, 0) > 2.0 && moved(64, 0) < -2.0 && moved(10, 1) > 2.0,
        "{} {} {}",
        moved(31, 0),
        moved(64, 0),
        moved(10, 1)
    );
    // Curves are linear between their frames: halfway in time is half of the motion, except for what the texture engine
    // smooths.
    let third = truth[&(2, 31)][0] - truth[&(1, 31)][0];
    assert!((third / moved(31, 0) - 1.0 / 3.0).abs() < 0.02);
    grimace().arg("run").arg(&out).arg("-o").arg(&results).run().exit(0).prints(&["1 sequence: 1 tracked"]);
    assert!(results.join("fap/happiness.fap").is_file());
}

#[test]
fn inputs_that_cannot_be_animated_are_explained() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let photo = PHOTO.path.join("anna.png");
    let fails = |command: &mut Command, message: &str| {
        command.run().exit(1).says(&[message]);
        assert!(!out.join("manifest.csv").exists());
    };
    let file = |name: &str, content: &str| {
        let path = folder.path().join(name);
        fs::write(&path, content).unwrap();
        path
    };
    fails(&mut animate(&folder.path().join("none.png"), &out), "none.png: there is no such file");
    let no_picture = file("text.png", "no picture");
    fails(&mut animate(&no_picture, &out), "not an image in a known format");
    let plain = folder.path().join("plain.png");
    image::GrayImage::from_pixel(200, 200, image::Luma([128])).save(&plain).unwrap();
    fails(&mut animate(&plain, &out), "no face was found");
    let marks = PHOTO.path.join("anna_correspondences.csv");
    fails(animate(&no_picture, &out).arg("--correspondences").arg(&marks), "not an image in a known format");
    let empty = folder.path().join("empty");
    fs::create_dir(&empty).unwrap();
    fails(&mut animate(&empty, &out), "the folder has no portraits");
    let few = file("few.csv", "point,x,y\n0,1,2\n1,3,4\n");
    fails(animate(&photo, &out).arg("--landmarks").arg(few), "2 of 68 landmarks");
    let twice = file("twice.csv", "point,x,y\n0,1,2\n0,3,4\n");
    fails(animate(&photo, &out).arg("--landmarks").arg(twice), "each of the points 0 to 67 once");
    let two = file("two.csv", "node,x,y\n20,200,100\n53,100,100\n");
    fails(animate(&photo, &out).arg("--correspondences").arg(two), "at least 3 are needed");
    fails(animate(&PHOTO.path, &out).arg("--landmarks").arg(&marks), "is a folder");
    // A label without a code in the other layout.
    let fap = file(
        "wink.fap",
        &format!("2.1 test 25 1\n{}\n0 5\n", (1..=68).map(|k| if k == 3 { "1 " } else { "0 " }).collect::<String>()),
    );
    let mut command = grimace();
    command.arg("simulate").arg("--photo").arg(&photo).arg("-o").arg(&out).arg("--fap").arg(fap);
    fails(command.args(["--frames", "2", "--layout", "cohn-kanade"]), "no code for the emotion `wink`");
    // Options that need each other, and options that exclude each other.
    grimace().args(["simulate", "-o", "x", "--fap", "a.fap"]).run().exit(2).says(&["--photo"]);
    animate(&photo, &out).args(["--size", "64x64"]).run().exit(2).says(&["--size"]);
    animate(&photo, &out).args(["--blink", "2"]).run().exit(1).says(&["--blink is 2"]);
}
