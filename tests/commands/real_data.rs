//! The main task on real sequences, when the project's shared data is next to the repository; otherwise the tests print that they were
//! skipped.

use std::path::{Path, PathBuf};

use crate::common::Work;
use grimace::internal::fap::{FapNumber, read_fap};

fn sequences() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/sequences");
    let found = folder.join("manifest.csv").is_file();
    if !found {
        eprintln!("SKIPPED, NOTHING WAS TESTED: {} does not exist", folder.display());
    }
    found.then_some(folder)
}

#[test]
fn real_sequences_give_representatives_with_the_signs_of_their_expressions() {
    let Some(folder) = sequences() else { return };
    let work = Work::new();
    let output = work.command().arg("run").arg(&folder).args(["-o", "out"]).output().unwrap();
    let ran = crate::common::Ran::from(output).exit(0);
    assert!(ran.stdout.contains(" 0 failed"), "{}", ran.stdout);
    assert_eq!(work.read("out/failures.csv").lines().count(), 1);
    let signs: [(&str, f64, &[u8]); 5] = [
        ("happiness", 1.0, &[53, 54, 59, 60]),
        ("surprise", 1.0, &[31, 32, 33, 34, 35, 36]),
        ("surprise", -1.0, &[52]),
        ("anger", -1.0, &[31, 32, 33, 34, 35, 36]),
        ("mouth_open", -1.0, &[52]),
    ];
    for (emotion, sign, faps) in signs {
        let sequence = read_fap(&work.path(&format!("out/fap/{emotion}.fap"))).unwrap().sequence;
        let apex = sequence.frames.last().unwrap();
        for &fap in faps {
            let value = apex.value(FapNumber::try_from(fap).unwrap()).unwrap();
            assert!(value * sign > 0.0, "{emotion}: FAP {fap} is {value} at the apex");
        }
    }
    for row in work.rows("out/statistics.csv") {
        assert!(row["gap"].parse::<f64>().unwrap() <= 1e-3, "greedy gap of {}: {}", row["emotion"], row["gap"]);
        assert!(row["certificate_gap"].parse::<f64>().unwrap() <= 1e-9, "certificate of {}", row["emotion"]);
    }
}

#[test]
fn parted_lips_of_real_smiles_are_found_and_reported() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/faces");
    if !folder.join("smiling").is_dir() {
        eprintln!("SKIPPED, NOTHING WAS TESTED: {} does not exist", folder.display());
        return;
    }
    let work = Work::new();
    // The teeth of the last person can be detected by colour only.
    let people = ["L030", "L096", "L130", "L114"];
    let pictures = ["neutral", "smiling"].map(|state| people.map(|p| folder.join(state).join(format!("{p}.jpg"))));
    let located = work.command().arg("locate").args(pictures.concat()).args(["-o", "points.csv"]).output().unwrap();
    crate::common::Ran::from(located).exit(0);
    let rows = work.rows("points.csv");
    let at = |picture: &Path, node: &str| -> [f64; 2] {
        let name = picture.file_name().unwrap().to_string_lossy().into_owned();
        let state = picture.parent().unwrap().file_name().unwrap().to_string_lossy().into_owned();
        let is_it = |image: &str| image.ends_with(&name) && image.contains(&state);
        let row = rows.iter().find(|row| is_it(&row["image"]) && row["node"] == node).unwrap();
        ["x", "y"].map(|axis| row[axis].parse().unwrap())
    };
    let closed = [-0.03..0.03, -0.03..0.03, -0.03..0.03, -0.03..0.03];
    let parted = [0.10..0.30, 0.10..0.30, 0.10..0.30, 0.05..0.20];
    for (state, ranges) in pictures.iter().zip([closed, parted]) {
        for (picture, range) in state.iter().zip(ranges) {
            // Distance of the inner edges of the lips over that of the outer corners of the eyes, which is 1.4 to 1.5 times the
            // eye distance.
            let gap = (at(picture, "40")[1] - at(picture, "87")[1])
                / (1.45_f64.recip() * (at(picture, "20")[0] - at(picture, "53")[0]));
            assert!(range.contains(&gap), "{}: {gap:.3}", picture.display());
        }
    }
    for (picture, says) in [(&pictures[0][0], false), (&pictures[1][0], true)] {
        let fap = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/golden/fap/happiness.fap");
        let out = if says { "smiling" } else { "neutral" };
        let cloned = work.command().arg("clone").arg("-s").arg(fap).arg("-t").arg(picture).args(["-o", out]).output().unwrap();
        let said = String::from_utf8_lossy(&cloned.stderr).into_owned();
        crate::common::Ran::from(cloned).exit(0);
        assert_eq!(said.contains("the lips are parted"), says, "{said}");
    }
    // A smile with closed lips.
    for (state, says) in [("neutral", false), ("smiling", true)] {
        let fap = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/golden/fap/happiness.fap");
        let picture = folder.join(state).join("L045.jpg");
        let output =
            work.command().arg("play").arg(fap).arg("--portrait").arg(picture).args(["-o", "player.html", "--force"]).output();
        let ran = crate::common::Ran::from(output.unwrap()).exit(0);
        assert_eq!(ran.stderr.contains("the face seems to show an expression already"), says, "{}", ran.stderr);
    }
}
