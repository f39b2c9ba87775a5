//! `grimace simulate`.

use std::{fs, path::Path, process::Command};

use crate::common::{Run, files_in};

fn simulate(out: &Path) -> Command {
    let mut command = Command::new(crate::common::grimace());
    command.arg("simulate").arg("-o").arg(out);
    command
}

/// Returns the command that simulates a small, fast dataset.
fn small(out: &Path) -> Command {
    let mut command = simulate(out);
    command.args(["--subjects", "2", "--emotions", "happiness,surprise", "--frames", "3", "--size", "96x80", "--seed", "5"]);
    command
}

fn rows(path: &Path) -> (Vec<String>, Vec<Vec<String>>) {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let text = |record: &csv::StringRecord| record.iter().map(str::to_owned).collect::<Vec<_>>();
    let header = text(reader.headers().unwrap());
    (header, reader.records().map(|r| text(&r.unwrap())).collect())
}

#[test]
fn writes_a_dataset_with_manifest_frames_marks_and_truth() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("faces");
    small(&out).args(["--marks-noise", "0"]).run().exit(0).prints(&["4 sequences of 2 subjects, 12 frames"]);
    let (header, manifest) = rows(&out.join("manifest.csv"));
    assert_eq!(header, ["subject", "sequence", "emotion", "frames", "correspondences", "fps", "sex", "cohort"]);
    assert_eq!(manifest.len(), 4);
    assert_eq!(manifest[0], ["S001", "005", "happiness", "S001/005", "S001/005/correspondences.csv", "25.0", "f", "A"]);
    assert_eq!(manifest[3][..3], ["S002", "007", "surprise"]);
    let frame = image::open(out.join("S002/007/S002_007_00000003.png")).unwrap();
    assert_eq!((frame.width(), frame.height()), (96, 80));
    assert!(!out.join("S002/007/S002_007_00000004.png").exists());
    // 3 frames of 113 nodes.
    let (header, truth) = rows(&out.join("truth/S002_007.csv"));
    assert_eq!((header.join(","), truth.len()), ("frame,node,x,y".to_owned(), 3 * 113));
    // Marks without noise are the true positions of the neutral frame.
    let (header, marks) = rows(&out.join("S002/007/correspondences.csv"));
    assert_eq!(header, ["node", "x", "y"]);
    let marked = ["20", "23", "53", "56", "31", "64", "10", "15", "17", "48", "50"];
    assert_eq!(marks.iter().map(|m| m[0].as_str()).collect::<Vec<_>>(), marked);
    for mark in &marks {
        let true_row = &truth[mark[0].parse::<usize>().unwrap()];
        assert_eq!((&true_row[0], &true_row[1..]), (&"1".to_owned(), &mark[..]));
    }
    let provenance: serde_json::Value = serde_json::from_slice(&fs::read(out.join("simulate.json")).unwrap()).unwrap();
    assert_eq!((&provenance["schema_version"], &provenance["options"]["seed"]), (&1.into(), &5.into()));
    assert!(provenance["units"]["positions"].as_str().unwrap().starts_with("px"));
}

#[test]
fn gives_the_same_bytes_for_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let [one, two] = ["one", "two"].map(|name| folder.path().join(name));
    small(&one).args(["--threads", "1"]).run().exit(0);
    small(&two).args(["-j", "2", "--quiet"]).run().exit(0).only_prints("");
    let (a, b) = (files_in(&one), files_in(&two));
    // 12 frames, 4 files of marks, 4 of truth, the manifest, the provenance, and the record of all files.
    assert_eq!(a.len(), 23);
    assert!(a == b, "files differ between 1 and 2 threads");
}

#[test]
fn another_seed_gives_other_faces() {
    let folder = tempfile::tempdir().unwrap();
    let pictures = ["1", "2"].map(|seed| {
        let out = folder.path().join(seed);
        simulate(&out)
            .args(["--subjects", "1", "--emotions", "fear", "--frames", "2", "--size", "64x64", "--seed", seed])
            .run()
            .exit(0);
        fs::read(out.join("S001/004/S001_004_00000001.png")).unwrap()
    });
    assert_ne!(pictures[0], pictures[1]);
}

#[test]
fn a_sequence_does_not_depend_on_what_else_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let [all, one] = ["all", "one"].map(|name| folder.path().join(name));
    small(&all).run().exit(0);
    let options = ["--subjects", "1", "--emotions", "surprise", "--frames", "3", "--size", "96x80", "--seed", "5"];
    simulate(&one).args(options).run().exit(0);
    let name = "S001/007/S001_007_00000003.png";
    assert_eq!(fs::read(all.join(name)).unwrap(), fs::read(one.join(name)).unwrap());
}

#[test]
fn refuses_a_folder_that_is_not_empty_unless_forced() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("precious.txt"), "keep").unwrap();
    small(folder.path()).run().exit(1).says(&["is not empty", "--force"]);
    assert_eq!(files_in(folder.path()).len(), 1);
    small(folder.path()).arg("--force").run().exit(0);
    assert_eq!(fs::read(folder.path().join("precious.txt")).unwrap(), b"keep");
}

#[test]
fn forcing_leaves_no_frames_of_the_earlier_run() {
    let folder = tempfile::tempdir().unwrap();
    let [again, fresh] = ["again", "fresh"].map(|name| folder.path().join(name));
    small(&again).run().exit(0);
    let short = ["--subjects", "2", "--emotions", "happiness,surprise", "--frames", "2", "--size", "96x80", "--format", "jpg"];
    simulate(&again).args(short).arg("--force").run().exit(0);
    simulate(&fresh).args(short).run().exit(0);
    assert!(files_in(&again) == files_in(&fresh), "files of the earlier run remain");
}

/// Datasets are read by folder, so foreign files would become part of the dataset; only the user may remove them.
#[test]
fn forcing_removes_only_files_of_a_simulation() {
    let folder = tempfile::tempdir().unwrap();
    let mine = folder.path().join("manifest.csv");
    fs::write(&mine, "subject,sequence\n").unwrap();
    small(folder.path()).arg("--force").run().exit(1).says(&["manifest.csv was not written by a simulation"]);
    assert_eq!(fs::read(&mine).unwrap(), b"subject,sequence\n");
    fs::remove_file(&mine).unwrap();
    small(folder.path()).arg("--force").run().exit(0);
    let frame = folder.path().join("S001/005/S001_005_00000003.png");
    fs::write(&frame, "edited").unwrap();
    fs::write(folder.path().join("S001/005/S001_005_notes.txt"), "mine").unwrap();
    let short = ["--subjects", "2", "--emotions", "happiness,surprise", "--frames", "2", "--size", "96x80"];
    simulate(folder.path()).args(short).arg("--force").run().exit(1).says(&["S001_005_00000003.png"]);
    assert_eq!(fs::read(&frame).unwrap(), b"edited");
    assert!(folder.path().join("S001/005/S001_005_notes.txt").exists());
}

#[test]
fn bad_options_are_named_with_their_range() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let cases: [(&[&str], i32, &str); 8] = [
        (&["--frames", "1"], 1, "--frames is 1; it must be 2 to 9999"),
        (&["--subjects", "0"], 1, "--subjects is 0"),
        (&["--size", "10x10"], 1, "--size is 10x10; it must be 64 to 4096"),
        (&["--size", "big"], 2, "`big` is not a size such as 640x480"),
        (&["--emotions", "joy"], 2, "`joy` is not an emotion"),
        (&["--emotions", "fear,fear"], 1, "fear is listed twice"),
        (&["--noise", "NaN"], 1, "--noise is NaN"),
        (&["--format", "jpg", "--quality", "101"], 1, "--quality is 101"),
    ];
    for (args, status, message) in cases {
        simulate(&out).args(args).run().exit(status).says(&[message]);
        assert!(!out.exists(), "{args:?} left a folder behind");
    }
}

#[test]
fn help_has_an_example() {
    Command::new(crate::common::grimace())
        .args(["simulate", "--help"])
        .run()
        .exit(0)
        .prints(&["grimace simulate -o faces", "correspondences.csv"]);
}

/// Tolerances in grey levels, mean and (`LARGEST_TOLERANCE`) largest, between a frame of the shipped dataset and a new one: libraries of
/// other machines may round a sine differently, and a JPEG block spreads the difference.
const MEAN_TOLERANCE: f64 = 0.05;
const LARGEST_TOLERANCE: u8 = 24;

#[test]
fn the_shipped_dataset_is_what_its_command_makes() {
    let shipped = crate::common::root().join("fixtures/simulated");
    let readme = fs::read_to_string(shipped.with_file_name("README.md")).unwrap();
    let command =
        readme.lines().find(|l| l.trim_start().starts_with("grimace simulate")).expect("the README contains the command");
    let mut args: Vec<&str> = command.split_whitespace().skip(2).collect();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("again");
    let place = args.iter().position(|&a| a == "fixtures/simulated").unwrap();
    let out_text = out.to_str().unwrap();
    args[place] = out_text;
    // Of one subject: the others do not change it.
    let subjects = args.iter().position(|&a| a == "--subjects").unwrap();
    args[subjects + 1] = "1";
    Command::new(crate::common::grimace()).arg("simulate").args(args).run().exit(0);
    let again = files_in(&out);
    let mut frames = 0;
    for (path, bytes) in again.iter().filter(|(p, _)| p.starts_with("S001") || p.starts_with("truth")) {
        if path.ends_with(".csv") {
            let (fresh, kept) = (rows(&out.join(path)), rows(&shipped.join(path)));
            assert_eq!((&fresh.0, fresh.1.len()), (&kept.0, kept.1.len()), "{path}");
            for (a, b) in fresh.1.iter().flatten().zip(kept.1.iter().flatten()) {
                let (a, b): (f64, f64) = (a.parse().unwrap(), b.parse().unwrap());
                assert!((a - b).abs() < 1e-5, "{path}: {a} and {b}");
            }
            continue;
        }
        let fresh = image::load_from_memory(bytes).unwrap().to_rgb8();
        let kept = image::open(shipped.join(path)).unwrap().to_rgb8();
        assert_eq!(fresh.dimensions(), kept.dimensions());
        let differences: Vec<u8> = fresh.iter().zip(kept.iter()).map(|(a, b)| a.abs_diff(*b)).collect();
        let mean = differences.iter().map(|&d| f64::from(d)).sum::<f64>() / differences.len() as f64;
        assert!(mean <= MEAN_TOLERANCE, "{path}: mean difference {mean}");
        assert!(differences.iter().all(|&d| d <= LARGEST_TOLERANCE), "{path}");
        frames += 1;
    }
    assert_eq!(frames, 60, "frames compared");
}

#[test]
fn writes_the_layout_of_cohn_kanade_and_run_reads_it() {
    let folder = tempfile::tempdir().unwrap();
    let (out, results) = (folder.path().join("ck"), folder.path().join("results"));
    let mut command = simulate(&out);
    command.args(["--subjects", "2", "--emotions", "surprise", "--frames", "3", "--size", "200x160", "--layout", "cohn-kanade"]);
    command.run().exit(0);
    assert!(!out.join("manifest.csv").exists());
    assert!(out.join("cohn-kanade-images/S002/007/S002_007_00000003.png").is_file());
    let label = fs::read_to_string(out.join("Emotion/S001/007/S001_007_00000003_emotion.txt")).unwrap();
    assert_eq!(label, "   7.0000000e+00\n");
    // The chin is landmark 8 and node 10.
    let landmarks = fs::read_to_string(out.join("Landmarks/S001/007/S001_007_00000002_landmarks.txt")).unwrap();
    assert_eq!(landmarks.lines().count(), 68);
    let chin: Vec<f64> = landmarks.lines().nth(8).unwrap().split_whitespace().map(|v| v.parse().unwrap()).collect();
    let (_, truth) = rows(&out.join("truth/S001_007.csv"));
    let node = &truth[113 + 10];
    assert_eq!(node[..2], ["2", "10"]);
    assert!((chin[0] - node[2].parse::<f64>().unwrap()).abs() < 1e-4 && (chin[1] - node[3].parse::<f64>().unwrap()).abs() < 1e-4);
    let mut run = Command::new(crate::common::grimace());
    run.arg("run").arg(&out).arg("-o").arg(&results).run().exit(0).prints(&["2 sequences: 2 tracked"]);
    assert!(results.join("fap/surprise.fap").is_file());
}

#[test]
fn faults_of_the_camera_change_pictures_and_never_positions() {
    let folder = tempfile::tempdir().unwrap();
    let (plain, faulty) = (folder.path().join("plain"), folder.path().join("faulty"));
    small(&plain).run().exit(0);
    let faults = ["--shutter", "0.5", "--defocus", "1", "--gain-change", "0.2", "--bias-change", "5", "--light-gradient", "0.1"];
    small(&faulty).args(faults).args(["--compression", "60"]).run().exit(0);
    let (plain, faulty) = (files_in(&plain), files_in(&faulty));
    assert_eq!(plain.keys().collect::<Vec<_>>(), faulty.keys().collect::<Vec<_>>());
    for (path, bytes) in &plain {
        let picture = path.ends_with(".png");
        let options = path.ends_with("simulate.json") || path.ends_with("simulate.b3");
        assert_eq!(faulty[path] != *bytes, picture || options, "{path}");
    }
}

#[test]
fn faults_out_of_range_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("faces");
    for (flag, value, message) in [
        ("--shutter", "2", "--shutter is 2; it must be 0 to 1"),
        ("--compression", "0", "--compression is 0; it must be 1 to 100"),
        ("--light-gradient", "nan", "--light-gradient is NaN; it must be 0 to 0.9"),
    ] {
        small(&out).args([flag, value]).run().exit(1).says(&[message]);
    }
    small(&out).args(["--layout", "ck"]).run().exit(2).says(&["cohn-kanade"]);
}

#[test]
fn recordings_have_their_truth_and_are_the_same_every_time() {
    let folder = tempfile::tempdir().unwrap();
    let make = |name: &str, threads: &str| {
        let out = folder.path().join(name);
        let options = ["--recordings", "--subjects", "2", "--emotions", "happiness,surprise", "--size", "96x80", "--yaw", "10"];
        let said = simulate(&out).args(options).args(["--format", "jpg", "--threads", threads]).run().exit(0);
        said.prints(&["2 recordings of 2 subjects"]);
        out
    };
    let out = make("a", "1");
    let (header, manifest) = rows(&out.join("manifest.csv"));
    assert_eq!(header, ["subject", "sequence", "emotion", "frames", "correspondences", "fps", "segment"]);
    assert_eq!(manifest[1], ["S002", "R1", "unlabelled", "S002/R1", "", "25.0", "auto"]);
    let (header, expressions) = rows(&out.join("truth/expressions.csv"));
    assert_eq!(header, ["subject", "sequence", "emotion", "onset_frame", "apex_frame", "offset_frame"]);
    assert_eq!(expressions.len(), 4);
    let frames = fs::read_dir(out.join("S001/R1")).unwrap().count() as i64;
    let (_, rests) = rows(&out.join("truth/rests.csv"));
    let number = |text: &String| text.parse::<i64>().unwrap();
    for e in expressions.iter().filter(|e| e[0] == "S001") {
        let (onset, apex, offset) = (number(&e[3]), number(&e[4]), number(&e[5]));
        assert!(onset < apex && apex < offset && apex >= 1 && offset <= frames, "{e:?} of {frames}");
        let overlaps = |r: &&Vec<String>| r[0] == "S001" && number(&r[2]) > onset && number(&r[3]) < offset;
        assert_eq!(rests.iter().find(overlaps), None, "a rest within {e:?}");
    }
    assert_eq!(files_in(&out), files_in(&make("b", "2")));
    simulate(&folder.path().join("c")).args(["--recordings", "--blink", "1"]).run().exit(2).says(&["--blink"]);
}
