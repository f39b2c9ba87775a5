//! Malicious files in use: what reaches a terminal, a spreadsheet or a picture.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use tempfile::TempDir;

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Runs a command in a new folder and returns its exit status and standard error.
fn grimace(folder: &TempDir, arguments: &[&str]) -> (Option<i32>, String) {
    let ran = Command::new(env!("CARGO_BIN_EXE_grimace")).args(arguments).current_dir(folder.path()).output().unwrap();
    (ran.status.code(), String::from_utf8_lossy(&ran.stderr).into_owned())
}

/// Makes a folder with `face.jpg` and `marks.csv`, and the representative of happiness with one coordinate replaced.
fn clone_folder(wild: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(repository("fixtures/simulated/S001/001/S001_001_00000001.jpg"), folder.path().join("face.jpg")).unwrap();
    fs::copy(repository("fixtures/simulated/S001/001/correspondences.csv"), folder.path().join("marks.csv")).unwrap();
    fs::copy(repository("fixtures/golden/fap/happiness.fap"), folder.path().join("happiness.fap")).unwrap();
    let model = fs::read_to_string(repository("fixtures/golden/representatives/happiness.csv")).unwrap();
    let line = model.lines().find(|line| line.starts_with("3,31,")).unwrap();
    let (_, y) = line.rsplit_once(',').unwrap();
    fs::write(folder.path().join("wild.csv"), model.replace(line, &format!("3,31,{wild},{y}"))).unwrap();
    folder
}

const CLONE: [&str; 8] = ["clone", "-t", "face.jpg", "-c", "marks.csv", "-o", "out", "-q"];

#[test]
fn impossible_motion_is_refused_in_every_input() {
    let folder = clone_folder("1e30");
    let (status, said) = grimace(&folder, &[&CLONE[..], &["-s", "wild.csv"]].concat());
    assert_eq!(status, Some(1), "{said}");
    assert!(said.contains("wild.csv, frame 3: node 31 is (1.000e30"), "{said}");
    let (status, said) = grimace(&folder, &["synthesize", "--bank", "candide", "--motion", "wild.csv", "-o", "faces", "-q"]);
    assert_eq!(status, Some(1), "{said}");
    assert!(said.contains("wild.csv, frame 3: node 31 is (1.000e30"), "{said}");
    assert!(!folder.path().join("out").exists() && !folder.path().join("faces").exists());
    fs::write(folder.path().join("points.csv"), "frame,fp,dx,dy\n0,8.3,0,0\n7,8.3,0,-1e30\n").unwrap();
    let (status, said) = grimace(&folder, &["synthesize", "--bank", "candide", "--motion", "points.csv", "-o", "faces", "-q"]);
    assert_eq!(status, Some(1), "{said}");
    assert!(said.contains("points.csv, frame 7: feature point 8.3 is (0.000e0, -1.000e30)"), "{said}");
    // A FAP that opens the jaw by two million times its unit.
    let fap = "2.1 wide 25 1\n0 0 1".to_owned() + &" 0".repeat(65) + "\n0 2000000000\n";
    fs::write(folder.path().join("wide.fap"), fap).unwrap();
    let (status, said) = grimace(&folder, &[&CLONE[..], &["-s", "wide.fap"]].concat());
    assert_eq!(status, Some(1), "{said}");
    assert!(said.contains("wide.fap, frame") && said.contains("away from"), "{said}");
}

#[test]
fn possible_motion_is_accepted() {
    let folder = clone_folder("200");
    let (status, said) = grimace(&folder, &["synthesize", "--bank", "candide", "--motion", "wild.csv", "-o", "faces", "-q"]);
    assert_eq!(status, Some(0), "{said}");
}

#[test]
fn a_film_is_the_same_bytes_in_every_run() {
    let folder = clone_folder("200");
    let film = |out: &str| {
        let arguments = [&CLONE[..5], &["-o", out, "-q", "-s", "happiness.fap", "--duration", "0.2", "--film", "webm"]].concat();
        let (status, said) = grimace(&folder, &arguments);
        assert!(status == Some(0) || said.contains("has no encoder"), "{said}");
        fs::read(folder.path().join(out).join("clone.webm")).ok()
    };
    let Some(first) = film("one") else {
        return eprintln!("SKIPPED: this OpenCV has no encoder for WebM");
    };
    assert_eq!(Some(first), film("two"));
}

#[test]
fn terminal_escapes_are_escaped_and_long_fields_are_shortened() {
    let folder = tempfile::tempdir().unwrap();
    let marks = format!("node,x,y\n1,\u{1b}]0;pwned\u{7},2\n2,{},3\n", "9e".repeat(20_000_000));
    fs::write(folder.path().join("marks.csv"), marks).unwrap();
    fs::copy(repository("fixtures/simulated/S001/001/S001_001_00000001.jpg"), folder.path().join("face.jpg")).unwrap();
    let (status, said) = grimace(&folder, &["fit", "face.jpg", "--correspondences", "marks.csv", "-o", "fit.csv"]);
    assert_eq!(status, Some(1));
    assert!(said.contains("marks.csv, line 2: x is `\\u{1b}]0;pwned\\u{7}`"), "{said:?}");
    assert!(said.len() < 3000, "{} bytes", said.len());
    // The name of the file itself, and text quoted by another crate.
    fs::write(folder.path().join("\u{1b}[2J.csv"), "a,b\n").unwrap();
    let (_, said) = grimace(&folder, &["fit", "face.jpg", "--correspondences", "\u{1b}[2J.csv", "-o", "fit.csv"]);
    assert!(said.contains("\\u{1b}[2J.csv, line 1: has no column `node`"), "{said:?}");
    fs::write(folder.path().join("prior.json"), format!("{{\"schema_version\": \"{}\"}}", "\u{9b}31m".repeat(1_000_000)))
        .unwrap();
    let (_, said) =
        grimace(&folder, &["fit", "face.jpg", "--correspondences", "marks.csv", "-o", "fit.csv", "--prior", "prior.json"]);
    assert!(said.len() < 5000 && !said.contains('\u{9b}'), "{} bytes", said.len());
}

#[test]
fn no_table_holds_a_formula() {
    let folder = tempfile::tempdir().unwrap();
    for subject in ["S001", "S002"] {
        let to = folder.path().join("faces").join(subject);
        fs::create_dir_all(&to).unwrap();
        for entry in fs::read_dir(repository("fixtures/simulated").join(subject).join("005")).unwrap() {
            let path = entry.unwrap().path();
            fs::copy(&path, to.join(path.file_name().unwrap())).unwrap();
        }
    }
    let manifest = "subject,sequence,emotion,frames,correspondences,site\n\
        =1+1,005,@happiness,S001,S001/correspondences.csv,\"=HYPERLINK(\"\"http://x\"\",\"\"y\"\")\"\n\
        -2,005,@happiness,S002,S002/correspondences.csv,-1.5\n+3,1,@happiness,none,,+cmd|' /C calc'!A0\n";
    fs::write(folder.path().join("faces/manifest.csv"), manifest).unwrap();
    let (status, said) = grimace(&folder, &["run", "faces", "-o", "out", "-q", "--by", "site"]);
    assert_eq!(status, Some(3), "{said}");
    let mut fields = Vec::new();
    for name in ["statistics.csv", "trimming.csv", "failures.csv", "verdicts.csv"] {
        let text = fs::read_to_string(folder.path().join("out").join(name)).unwrap();
        for record in csv::ReaderBuilder::new().has_headers(false).flexible(true).from_reader(text.as_bytes()).records() {
            fields.extend(record.unwrap().iter().map(str::to_owned));
        }
    }
    let formula = |f: &&String| f.starts_with(['=', '+', '-', '@', '\t', '\r']) && f.parse::<f64>().is_err();
    assert_eq!(fields.iter().find(formula), None);
    let expected = ["'@happiness", "'=HYPERLINK(\"http://x\",\"y\")", "-1.5"];
    assert!(expected.iter().all(|e| fields.iter().any(|f| f == e)), "{fields:?}");
}
