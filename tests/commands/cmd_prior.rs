//! `grimace prior` and `--prior`: commands and their output.

use std::{
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use crate::common::{Ran, Run};
use grimace::internal::{
    units::NodeId,
    wireframe::{Tables, Wireframe},
};
use tempfile::TempDir;

fn grimace(folder: &TempDir, arguments: &[&str]) -> Ran {
    Command::new(crate::common::grimace()).current_dir(folder.path()).args(arguments).run()
}

fn write(folder: &TempDir, name: &str, text: &str) -> PathBuf {
    let path = folder.path().join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, text).unwrap();
    path
}

/// Returns the landmarks of face `k`: Candide-3 at about 100 px per unit, with a width and height that depend on `k`.
fn landmarks(k: usize) -> String {
    let (w, tables) = (Wireframe::candide3(), Tables::candide3());
    let (wide, high) = (100.0 + 3.0 * ((k * 7) % 5) as f64, 100.0 + 2.0 * ((k * 5) % 7) as f64);
    let mut text = String::new();
    for row in &tables.landmarks {
        let place = |(n, share): &(NodeId, f64)| w.frontal()[n.index()].coords * *share;
        let p: nalgebra::Vector2<f64> = row.nodes.iter().map(place).sum();
        write!(text, ",{:.2},{:.2}", 320.0 + wide * p.x, 240.0 - high * p.y).unwrap();
    }
    text
}

fn header(first: &str) -> String {
    let columns: String = (0..68).fold(String::new(), |text, k| text + &format!(",x{k},y{k}"));
    format!("{first}{columns}\n")
}

/// Returns a table `person,state,...` with a neutral and a smiling row for each person.
fn people(count: usize) -> String {
    (0..count).fold(header("person,state"), |text, k| {
        text + &format!("P{k},neutral{}\nP{k},smiling{}\n", landmarks(k), landmarks(k + 1))
    })
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn a_prior_is_learned_and_written_with_its_origin_the_same_each_time() {
    let folder = tempfile::tempdir().unwrap();
    write(&folder, "people.csv", &people(12));
    let learn =
        |output| grimace(&folder, &["prior", "people.csv", "-o", output, "--modes", "3", "--credit", "Nobody, public domain"]);
    learn("a/p.json").exit(0).only_prints("12 faces, 3 modes\n");
    learn("b/p.json").exit(0);
    let (a, b) = (folder.path().join("a/p.json"), folder.path().join("b/p.json"));
    assert_eq!(fs::read(&a).unwrap(), fs::read(&b).unwrap());
    let prior = json(&a);
    assert_eq!(prior["schema_version"], 1);
    assert_eq!(prior["faces"], 12);
    assert_eq!(prior["credit"], "Nobody, public domain");
    assert_eq!(prior["command"], "grimace prior people.csv --state neutral --modes 3 -o p.json");
    assert_eq!(prior["sources"][0]["name"], "people.csv");
    assert_eq!(prior["mean"].as_array().unwrap().len(), 113);
    assert_eq!(prior["modes"].as_array().unwrap().len(), 3);
    // Written once; a second time only with --force.
    learn("a/p.json").exit(1).says(&["give --force to overwrite it"]);
}

#[test]
fn datasets_and_several_files_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let mut manifest = "subject,sequence,emotion,landmarks\n".to_owned();
    for k in 0..8 {
        for sequence in ["001", "002"] {
            writeln!(manifest, "S{k},{sequence},fear,l.csv").unwrap();
            let body = format!("{}1{}\n2{}\n", header("frame"), landmarks(k), landmarks(k + 3));
            write(&folder, &format!("data/S{k}/{sequence}/l.csv"), &body);
            for frame in [1, 2] {
                // Only the names matter.
                write(&folder, &format!("data/S{k}/{sequence}/f_{frame:08}.png"), "");
            }
        }
    }
    manifest.push_str("T,001,fear,\n");
    write(&folder, "data/T/001/f_00000001.png", "");
    write(&folder, "data/T/001/f_00000002.png", "");
    write(&folder, "data/manifest.csv", &manifest);
    let rows = (20..26).fold(header("frame"), |text, k| text + &format!("{k}{}\n", landmarks(k)));
    write(&folder, "rows.csv", &rows);
    // 8 subjects, one neutral frame of each, and 6 rows.
    grimace(&folder, &["prior", "data", "rows.csv", "-o", "p.json", "--modes", "2"])
        .exit(0)
        .prints(&["14 faces, 2 modes", "no --credit"])
        .says(&["skipped T: the manifest names no landmarks"]);
    assert_eq!(json(&folder.path().join("p.json"))["sources"][0]["faces"], 8);
}

#[test]
fn inputs_that_give_no_prior_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    write(&folder, "nine.csv", &people(9));
    write(&folder, "points.csv", "person,x0,y0\nA,1,2\n");
    write(&folder, "nan.csv", &people(12).replacen("P3,neutral,", "P3,neutral,NaN,", 1));
    let mut cells = people(12);
    cells = cells.replacen("P5,neutral", "P4,neutral", 1);
    write(&folder, "twice.csv", &cells);
    let error = |arguments: &[&str], text: &str| {
        let all = [&["prior"], arguments, &["-o", "p.json"]].concat();
        grimace(&folder, &all).exit(1).says(&[text]);
        assert!(!folder.path().join("p.json").exists());
    };
    error(&["nine.csv"], "9 faces; a prior needs at least 10");
    error(&["nine.csv", "--state", "sad"], "no row has the state `sad`; there are neutral, smiling");
    error(&["points.csv"], "1 points in columns x0,y0,...; 68 were expected");
    error(&["nan.csv"], "nan.csv, line 8");
    error(&["twice.csv"], "P4 is already in line 10");
    error(&["none.csv"], "cannot be read");
    write(&folder, "many.csv", &people(12));
    error(&["many.csv", "--modes", "12"], "cannot learn 12 modes from 12 faces; choose 1 to 11");
    error(&["many.csv", "many.csv"], "P0 is in many.csv and in many.csv; each face must appear once");
    let of_one = landmarks(4);
    let mut values: Vec<&str> = of_one.split(',').collect();
    // The row starts with a comma: x48 is the value after 96 others.
    values[97] = "5000";
    write(
        &folder,
        "wild.csv",
        &people(12).replacen(&format!("P4,neutral{of_one}"), &format!("P4,neutral{}", values.join(",")), 1),
    );
    error(&["wild.csv", "--modes", "3"], "P4: point 48 is at (5000.0, ");
    grimace(&folder, &["prior", "-o", "p.json"]).exit(2);
}

/// Writes a white picture and the marks of face `k`.
fn picture_and_marks(folder: &TempDir, k: usize) {
    image::RgbImage::from_pixel(640, 480, image::Rgb([255; 3])).save(folder.path().join("face.png")).unwrap();
    let text = landmarks(k);
    let values: Vec<&str> = text.trim_start_matches(',').split(',').collect();
    let marks = [(53, 36), (56, 39), (23, 42), (20, 45), (64, 48), (31, 54), (10, 8)];
    let body = marks.iter().fold("node,x,y\n".to_owned(), |text, &(node, landmark)| {
        text + &format!("{node},{},{}\n", values[2 * landmark], values[2 * landmark + 1])
    });
    write(folder, "marks.csv", &body);
}

#[test]
fn the_prior_of_a_fit_is_chosen_by_word_or_file() {
    let folder = tempfile::tempdir().unwrap();
    write(&folder, "people.csv", &people(12));
    picture_and_marks(&folder, 3);
    grimace(&folder, &["prior", "people.csv", "-o", "p.json", "--modes", "3"]).exit(0);
    let mut fits = Vec::new();
    for prior in ["none", "candide", "faces", "auto", "p.json"] {
        let output = format!("{prior}.csv");
        grimace(&folder, &["fit", "face.png", "-c", "marks.csv", "-o", &output, "--prior", prior, "--check-marks", "off", "-q"])
            .exit(0);
        fits.push(fs::read_to_string(folder.path().join(output)).unwrap());
    }
    for (k, fit) in fits.iter().enumerate() {
        assert!(fits[..k].iter().all(|other| other != fit), "fit {k} equals that of another prior");
    }
    // Without --prior, the prior is `auto`.
    grimace(&folder, &["fit", "face.png", "-c", "marks.csv", "-o", "default.csv", "-q"]).exit(0);
    assert_eq!(fs::read_to_string(folder.path().join("default.csv")).unwrap(), fits[3]);

    let refused = |prior: &str, text: &str| {
        let arguments = ["fit", "face.png", "-c", "marks.csv", "-o", "x.csv", "--prior", prior];
        grimace(&folder, &arguments).exit(2).says(&[text]);
    };
    refused("face", "expected none, candide, faces, auto or a prior file");
    refused("marks.csv", "a prior file as written by `grimace prior` was expected");
    write(&folder, "old.json", "{\"schema_version\": 9}");
    refused("old.json", "schema version 9; this program reads 1");
    // A prior for another wireframe: every face has one node less.
    let mut short = json(&folder.path().join("p.json"));
    for list in ["mean", "residuals"] {
        short[list].as_array_mut().unwrap().pop();
    }
    short["modes"].as_array_mut().unwrap().iter_mut().for_each(|mode| drop(mode.as_array_mut().unwrap().pop()));
    write(&folder, "short.json", &short.to_string());
    grimace(&folder, &["fit", "face.png", "-c", "marks.csv", "-o", "x.csv", "--prior", "short.json"])
        .exit(1)
        .says(&["the shape prior has 112 nodes, but the wireframe has 113"]);
}

#[test]
fn a_run_remembers_the_content_of_its_prior_file() {
    let folder = tempfile::tempdir().unwrap();
    let simulate = ["simulate", "-o", "data", "--subjects", "1", "--emotions", "happiness", "--frames", "5", "--size", "160x120"];
    grimace(&folder, &simulate).exit(0);
    write(&folder, "people.csv", &people(12));
    grimace(&folder, &["prior", "people.csv", "-o", "p.json", "--modes", "3"]).exit(0);
    let run = |prior: &str| grimace(&folder, &["run", "data", "-o", "out", "--prior", prior]);
    run("p.json").exit(0);
    let record = json(&folder.path().join("out/run.json"));
    let hash = blake3::hash(&fs::read(folder.path().join("p.json")).unwrap()).to_hex().to_string();
    assert_eq!(record["options"]["fit"]["prior"]["file"]["blake3"], hash.as_str());
    let inputs = record["sequences"][0]["inputs_blake3"].clone();
    // The same content under another name changes nothing; other content under the same name makes another run.
    fs::copy(folder.path().join("p.json"), folder.path().join("copy.json")).unwrap();
    run("copy.json").exit(0);
    assert_eq!(json(&folder.path().join("out/run.json")), record);
    grimace(&folder, &["prior", "people.csv", "-o", "p.json", "--modes", "2", "--force"]).exit(0);
    run("p.json").exit(1).says(&["other options (fit prior: previously a file, now a file with another content);"]);
    grimace(&folder, &["run", "data", "-o", "out", "--prior", "p.json", "--force"]).exit(0);
    assert_ne!(json(&folder.path().join("out/run.json"))["sequences"][0]["inputs_blake3"], inputs);
}
