//! `grimace evaluate`: commands and their output.

use std::{fs, path::Path, process::Command};

use crate::common::{Run, Work};
use grimace::internal::{
    fit::{FitOptions, Fitter},
    wireframe::{Tables, Wireframe},
};
use grimace_lab::evaluate::{Start, TrackerVariant, TrackingOptions, VariantKind, dataset_cases, evaluate_tracking, last_table};
fn number(row: &std::collections::BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column} is {:?}", row[column]))
}

/// Options for small and few sequences, which take a tenth of a second each.
const TINY: &str = "--subjects 1 --emotions happiness --frames 4 --size 240x180";

#[test]
fn fit_errors_fall_with_more_marks_and_springs_beat_the_similarity() {
    let work = Work::new();
    let printed = work.grimace("evaluate fit -o out --subjects 12 --counts 5,7,15").exit(0).stdout;
    assert!(
        printed.contains("Mean error over live nodes of 12 simulated people") && printed.contains("| 15 marks |"),
        "{printed}"
    );
    let rows = work.rows("out/fit_error.csv");
    // 4 choices, 3 numbers of marks, 5 methods.
    assert_eq!(rows.len(), 60);
    let mean = |method: &str, choice: &str, marks: &str| {
        let row = rows.iter().find(|r| r["method"] == method && r["choice"] == choice && r["marks"] == marks).unwrap();
        assert_eq!((row["people"].as_str(), row["failed"].as_str(), row["errors"].as_str()), ("12", "0", "1248"));
        assert!(number(row, "median_px") <= number(row, "p95_px"));
        number(row, "mean_percent_es")
    };
    for method in ["springs", "candide prior"] {
        assert!(mean(method, "suggested", "15") < mean(method, "suggested", "5"), "{method}");
        assert!(mean(method, "suggested", "7") < mean("similarity", "suggested", "7"), "{method}");
    }
    let suggested = rows.iter().find(|r| r["choice"] == "suggested" && r["marks"] == "5").unwrap();
    assert_eq!(suggested["nodes"].split(' ').count(), 5);
    for figure in ["methods_simulated.svg", "choices_simulated.svg"] {
        let svg = work.read(&format!("out/{figure}"));
        assert!(svg.contains("number of marks") && svg.contains("% of eye distance"), "{figure}");
    }
    let json = work.json("out/evaluation.json");
    assert_eq!((&json["seed"], &json["options"]["marks_noise_px"]), (&1.into(), &0.7.into()));
    assert!(json["units"]["percent_es"].as_str().unwrap().contains("eye distance"));
}

#[test]
fn exact_marks_at_every_node_of_a_choice_leave_less_error_than_noisy_ones() {
    let work = Work::new();
    let error = |out: &str, noise: &str| {
        work.grimace(&format!(
            "evaluate fit -o {out} --subjects 6 --counts 7 --marks-noise {noise} --marks 20,53,8.3,64,10,23,56"
        ))
        .exit(0);
        let rows = work.rows(&format!("{out}/fit_error.csv"));
        let row = rows.iter().find(|r| r["choice"] == "given" && r["method"] == "springs").unwrap().clone();
        assert_eq!(row["nodes"], "20 53 31 64 10 23 56");
        number(&row, "mean_px")
    };
    assert!(error("exact", "0") < error("noisy", "5"));
}

#[test]
fn people_from_landmarks_are_compared_at_the_landmarks_that_were_not_marked() {
    let work = Work::new();
    write_people(&work.path("people.csv"));
    work.grimace("evaluate fit people.csv -o out --subjects 2 --counts 7").exit(0);
    let rows = work.rows("out/fit_error.csv");
    let real: Vec<_> = rows.iter().filter(|r| r["population"] == "real" && r["choice"] == "corners and chin").collect();
    // 52 landmarks less 7 marked, 43 inner ones less 6 (the chin is not inner), 3 people.
    let counts: Vec<_> = real.iter().take(2).map(|r| (r["compared"].as_str(), r["errors"].as_str())).collect();
    assert_eq!(counts, [("other landmarks", "135"), ("other inner-face landmarks", "111")]);
    assert!(work.path("out/methods_real.svg").is_file());
}

/// Writes three people whose landmarks are Candide-3's own nodes at different sizes, each with a displaced nose.
fn write_people(path: &Path) {
    let (wireframe, tables) =
        (grimace::internal::wireframe::Wireframe::candide3(), grimace::internal::wireframe::Tables::candide3());
    let frontal = wireframe.frontal();
    let mut text = format!("person,{}\n", (0..68).map(|k| format!("x{k},y{k}")).collect::<Vec<_>>().join(","));
    for (name, scale) in [("A", 100.0), ("B", 150.0), ("C", 220.0)] {
        text.push_str(name);
        for row in &tables.landmarks {
            let (mut x, mut y) = (0.0, 0.0);
            for (node, weight) in &row.nodes {
                x += weight * (400.0 + scale * frontal[node.index()].x);
                y += weight * (400.0 - scale * frontal[node.index()].y);
            }
            let lower = if row.part == "nose" { 0.05 * scale } else { 0.0 };
            text.push_str(&format!(",{x},{}", y + lower));
        }
        text.push('\n');
    }
    fs::write(path, text).unwrap();
}

#[test]
fn suggested_marks_are_searched_on_request() {
    let work = Work::new();
    write_people(&work.path("people.csv"));
    let printed = work.grimace("evaluate fit people.csv -o out --subjects 3 --counts 5 --suggest").exit(0).stdout;
    assert!(printed.contains("error_after_percent_es"), "{printed}");
    let rows = work.rows("out/suggested_marks.csv");
    assert_eq!(rows.len(), 15);
    assert_eq!((rows[0]["rank"].as_str(), rows[0]["error_after_percent_es"].as_str()), ("1", ""));
    let nodes: Vec<_> = rows[..5].iter().map(|r| r["node"].as_str()).collect();
    let errors = work.rows("out/fit_error.csv");
    let row = errors.iter().find(|r| r["population"] == "simulated" && r["choice"] == "suggested").unwrap();
    assert_eq!(row["nodes"].split(' ').collect::<Vec<_>>(), nodes, "the found marks are the compared ones");
}

#[test]
fn tracking_starts_right_and_drifts_and_every_frame_is_there() {
    let work = Work::new();
    let printed = work.grimace(&format!("evaluate tracking -o out {TINY}")).exit(0).stdout;
    assert!(printed.contains("Last frame, mean position error") && printed.contains("plain KLT"), "{printed}");
    let rows = work.rows("out/tracking_frames.csv");
    for variant in [
        "with deformation",
        "without deformation",
        "with deformation, not aligned",
        "without deformation, not aligned",
        "plain KLT",
    ] {
        let curve: Vec<_> =
            rows.iter().filter(|r| r["variant"] == variant && r["part"] == "all" && r["state"] == "any").collect();
        assert_eq!(curve.iter().map(|r| r["frame"].as_str()).collect::<Vec<_>>(), ["1", "2", "3", "4"]);
        assert!(curve.iter().all(|r| r["errors"] == "104"));
        // Started at the true nodes, up to the rounding of OpenCV's single precision.
        assert!(number(curve[0], "mean_px") < 1e-6);
        assert!(number(curve[3], "mean_px") > 0.0 && number(curve[3], "mean_px") < 20.0);
    }
    let last = work.rows("out/tracking_last.csv");
    let parts: std::collections::BTreeSet<_> = last.iter().map(|r| r["part"].clone()).collect();
    let expected = ["all", "brow", "cheek", "contour", "eye", "forehead", "jaw", "mouth", "nose"];
    assert_eq!(parts.iter().map(String::as_str).collect::<Vec<_>>(), expected);
    assert_eq!(work.rows("out/tracking_sequences.csv").len(), 1);
    assert_eq!(work.read("out/failures.csv"), "sequence,variant,reason\n");
    let svg = work.read("out/tracking_simulated.svg");
    assert!(svg.contains("frame (1 is the neutral frame)") && svg.contains("mean error over the live nodes"));
}

#[test]
fn the_same_options_give_the_same_bytes_whatever_the_threads() {
    let work = Work::new();
    work.grimace(&format!("evaluate tracking -o a {TINY} --start seven --hard -j 1")).exit(0);
    work.grimace(&format!("evaluate tracking -o b {TINY} --start seven --hard -j 3")).exit(0);
    assert_eq!(work.files("a"), work.files("b"));
    work.grimace("evaluate fit -o c --subjects 5 --counts 4 -j 1").exit(0);
    work.grimace("evaluate fit -o d --subjects 5 --counts 4 -j 3").exit(0);
    assert_eq!(work.files("c"), work.files("d"));
    work.grimace("evaluate fit -o e --subjects 5 --counts 4 --seed 2").exit(0);
    assert_ne!(work.read("c/fit_error.csv"), work.read("e/fit_error.csv"));
}

#[test]
fn variants_are_rows_of_their_own() {
    let work = Work::new();
    work.grimace(&format!("evaluate tracking -o out {TINY} --variants same: --variants loose:force=0.5,levels=2")).exit(0);
    let rows = work.rows("out/tracking_last.csv");
    let whole = |variant: &str| {
        let row = rows.iter().find(|r| r["variant"] == variant && r["part"] == "all" && r["state"] == "any").unwrap();
        row["mean_px"].clone()
    };
    assert_eq!(whole("same"), whole("with deformation"));
    assert_ne!(whole("loose"), whole("with deformation"));
    assert_eq!(work.json("out/evaluation.json")["options"]["variants"]["loose"]["levels"], 2);
    work.grimace("evaluate tracking -o other --variants x:wide=1").exit(1).says(&["there is no option `wide`"]);
    work.grimace("evaluate tracking -o other --variants x: --variants x:").exit(1).says(&["the name `x` appears twice"]);
}

#[test]
fn simulated_datasets_are_compared_with_their_exact_nodes() {
    let work = Work::new();
    work.grimace("simulate -o faces --subjects 2 --emotions happiness,anger --frames 3 --size 240x180").exit(0);
    work.grimace("evaluate tracking faces -o out --by cohort").exit(0);
    let rows = work.rows("out/tracking_last.csv");
    let all = rows.iter().find(|r| r["variant"] == "with deformation" && r["part"] == "all" && r["state"] == "any").unwrap();
    // 4 sequences of 104 live nodes; both subjects are in cohort A.
    assert_eq!((all["group"].as_str(), all["sequences"].as_str(), all["errors"].as_str()), ("A", "4", "416"));
    work.grimace("evaluate tracking faces -o other --by colour")
        .exit(1)
        .says(&["has no column `colour` to group by; choose from subject, sequence, emotion, cohort"]);

    // A damaged file makes only its own sequence fail.
    fs::write(work.path("faces/truth/S001_005.csv"), "frame,node,x,y\n1,0,a,2\n").unwrap();
    work.grimace("evaluate tracking faces -o partial").exit(3).says(&["failed: S001_005", "x is `a`"]);
    assert_eq!(work.rows("partial/tracking_sequences.csv").len(), 3);
    assert_eq!(work.rows("partial/failures.csv")[0]["sequence"], "S001_005");
}

#[test]
fn partial_truth_is_accepted_and_existing_tracks_are_compared() {
    let work = Work::new();
    work.grimace("simulate -o faces --subjects 1 --emotions happiness --frames 4 --size 240x180").exit(0);
    let truth = work.read("faces/truth/S001_005.csv");
    // Mouth corners, eye corners and the chin in the neutral and the third frame.
    let wanted = |line: &str| {
        let mut fields = line.split(',');
        let (frame, node) = (fields.next().unwrap_or_default(), fields.next().unwrap_or_default());
        ["1", "3"].contains(&frame) && ["20", "23", "53", "56", "31", "64", "10"].contains(&node)
    };
    let some: String = truth.lines().filter(|line| line.starts_with("frame") || wanted(line)).map(|l| format!("{l}\n")).collect();
    fs::write(work.path("faces/truth/S001_005.csv"), &some).unwrap();
    work.grimace("evaluate tracking faces -o out").exit(0);
    let whole = |folder: &str, variant: &str| {
        let rows = work.rows(&format!("{folder}/tracking_last.csv"));
        rows.into_iter().find(|r| r["variant"] == variant && r["part"] == "all" && r["state"] == "any").unwrap()
    };
    let compared = whole("out", "with deformation");
    assert_eq!(compared["errors"], "7");
    assert!(number(&compared, "mean_px") > 0.0 && number(&compared, "mean_px") < 5.0);
    // The truth as a track has no error; moved by (3, 4) px it has 5 px.
    fs::write(work.path("by_hand.csv"), &some).unwrap();
    let moved = |dx: f64, dy: f64| {
        let row = |line: &str| {
            let f: Vec<&str> = line.split(',').collect();
            let (x, y): (f64, f64) = (f[2].parse().unwrap(), f[3].parse().unwrap());
            format!("{},{},{},{},tracked,,\n", f[0], f[1], x + dx, y + dy)
        };
        format!("frame,node,x,y,state,residual,expected_error\n{}", truth.lines().skip(1).map(row).collect::<String>())
    };
    fs::write(work.path("a.csv"), moved(0.0, 0.0)).unwrap();
    fs::write(work.path("b.csv"), moved(3.0, 4.0)).unwrap();
    work.grimace("evaluate tracking -o mine --truth by_hand.csv --tracks exact:a.csv --tracks off:b.csv").exit(0);
    assert!(number(&whole("mine", "exact"), "mean_px") < 1e-9);
    assert!((number(&whole("mine", "off"), "mean_px") - 5.0).abs() < 1e-6);
    work.grimace("evaluate tracking -o none --tracks x:a.csv").exit(1).says(&["give the DATASET"]);
    work.grimace("evaluate tracking -o none --truth by_hand.csv").exit(2);
    work.grimace("evaluate tracking -o none --truth by_hand.csv --tracks x:nowhere.csv")
        .exit(1)
        .says(&["nowhere.csv does not exist"]);
}

#[test]
fn mistakes_are_reported() {
    let work = Work::new();
    work.grimace("evaluate fit nowhere -o out").exit(1).says(&["nowhere"]);
    work.grimace("evaluate tracking nowhere -o out").exit(1).says(&["nowhere"]);
    work.grimace("evaluate fit -o out --subjects 0").exit(1).says(&["--subjects is 0; it must be 1 to 999"]);
    work.grimace("evaluate fit -o out --counts 2").exit(2).says(&["3..=104"]);
    work.grimace("evaluate fit -o out --marks-noise -1").exit(2);
    work.grimace("evaluate fit -o out --marks 4,20,53").exit(1).says(&["node 4 is in no triangle"]);
    work.grimace("evaluate fit -o out --marks 20,3.7").exit(1).says(&["node 20 is listed twice"]);
    work.grimace("evaluate tracking -o out --by kind").exit(2);
    work.grimace("evaluate tracking -o out --size 9").exit(2).says(&["not a size such as 640x480"]);
    assert!(!work.path("out").exists(), "nothing is written");
    // A dataset without anything to compare with.
    work.grimace("simulate -o faces --subjects 1 --emotions anger --frames 2 --size 96x72").exit(0);
    fs::remove_dir_all(work.path("faces/truth")).unwrap();
    for experiment in ["fit", "tracking"] {
        work.grimace(&format!("evaluate {experiment} faces -o out"))
            .exit(1)
            .says(&["no sequence has 68-point landmarks to compare with"]);
    }
}

#[test]
fn results_are_not_written_over_unless_forced() {
    let work = Work::new();
    work.grimace("evaluate fit -o out --subjects 2 --counts 5 -q").exit(0);
    work.grimace("evaluate fit -o out --subjects 2 --counts 5").exit(1).says(&["out is not empty"]);
    work.grimace("evaluate fit -o out --subjects 2 --counts 5 --force").exit(0);
    assert_eq!(work.grimace("evaluate fit -o quiet --subjects 2 --counts 5 --quiet").exit(0).stdout, "");
}

#[test]
fn help_has_an_example() {
    let work = Work::new();
    for experiment in ["fit", "tracking"] {
        assert!(
            work.grimace(&format!("evaluate {experiment} --help"))
                .exit(0)
                .stdout
                .contains(&format!("grimace evaluate {experiment}"))
        );
    }
}

#[test]
fn found_points_are_compared_with_points_set_by_hand() {
    let work = Work::new();
    work.grimace("evaluate locate nowhere -o out").exit(1).says(&["nowhere"]);
    let Some(faces) = crate::common::shared_data("faces", "found points were not compared") else { return };
    let faces = faces.display();
    work.grimace(&format!("evaluate locate {faces} -o out --only L022,nobody")).exit(1).says(&["has nobody called nobody"]);
    let said = work.grimace(&format!("evaluate locate {faces} -o out --only L022,L045 --force")).exit(0).stdout;
    assert!(said.contains("2 faces: 0 missed, 0 grossly wrong"), "{said}");
    let errors = work.read("out/errors.csv");
    assert!(errors.lines().any(|line| line.starts_with("all,eye corner,2,")), "{errors}");
}

/// Plain KLT and the fit on the real sequences, compared with the figures of independent prototypes.
#[test]
fn real_sequences_give_the_figures_of_the_prototypes() {
    let Some(data) = crate::common::shared_data("sequences", "the prototypes' figures were not compared") else { return };
    let work = Work::new();
    // The plain tracker only; the command evaluates it among others, which take five times as long.
    let (cases, failed) = dataset_cases(&data, Some("kind")).unwrap();
    let options = TrackingOptions {
        start: Start::Landmarks,
        variants: vec![TrackerVariant { name: "plain KLT".to_owned(), kind: VariantKind::PlainKlt }],
        marks: Vec::new(),
        marks_noise_px: 0.0,
        by: Some("kind".to_owned()),
        seed: 1,
    };
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let fitter = Fitter::new(&wireframe, FitOptions::default());
    let result = evaluate_tracking(&cases, &fitter, &wireframe, &tables, &options, || true).unwrap();
    assert!(!cases.is_empty() && failed.is_empty() && result.failures.is_empty(), "{failed:?} {:?}", result.failures);
    last_table(&result.records).write_csv(&work.path("last.csv")).unwrap();
    let rows = work.rows("last.csv");
    // A prototype with OpenCV gave inner face and inner lips in % of the eye distance.
    for (kind, inner, lips) in [("photo_animated", 1.32, 3.69), ("real_endpoints_morph", 2.53, 5.11), ("real_video", 5.10, 12.40)]
    {
        for (part, expected) in [("inner_face", inner), ("inner_lip", lips)] {
            let wanted = |r: &&std::collections::BTreeMap<String, String>| {
                r["group"] == kind && r["variant"] == "plain KLT" && r["part"] == part && r["state"] == "any"
            };
            let found = number(rows.iter().find(wanted).unwrap(), "mean_percent_es");
            assert!((found - expected).abs() < 0.02 * expected, "{kind} {part}: {found}, {expected} expected");
        }
    }
    work.grimace(&format!("evaluate fit {} -o fit --subjects 2 --counts 7", data.display())).exit(0);
    let rows = work.rows("fit/fit_error.csv");
    assert!(rows.iter().any(|r| r["population"] == "real" && r["method"] == "springs" && number(r, "mean_percent_es") < 10.0));
}

#[test]
fn confidence_is_learned_judged_and_reproducible() {
    let folder = tempfile::tempdir().unwrap();
    let run = |name: &str, threads: &str| {
        let out = folder.path().join(name);
        let mut command = Command::new(crate::common::grimace());
        command.args(["evaluate", "confidence", "--subjects", "1", "--held-out", "1", "--emotions", "surprise", "--frames", "6"]);
        command.args(["--size", "240x200", "-j", threads, "-o"]).arg(&out).run().exit(0);
        out
    };
    let (one, two) = (run("one", "1"), run("two", "2"));
    for file in ["track_confidence.csv", "confidence_quintiles.csv", "verdicts.csv", "confidence.svg", "evaluation.json"] {
        assert!(fs::read(one.join(file)).unwrap() == fs::read(two.join(file)).unwrap(), "{file}");
    }
    let table = fs::read_to_string(one.join("track_confidence.csv")).unwrap();
    let learned = grimace::internal::track::Confidence::parse(&table).unwrap();
    assert_ne!(&learned, grimace::internal::track::Confidence::shipped());
    let mut reader = csv::Reader::from_path(one.join("confidence_quintiles.csv")).unwrap();
    let rows: Vec<_> = reader.records().map(Result::unwrap).filter(|r| &r[0] == "all").collect();
    assert_eq!(rows.len(), 5);
    let expected: Vec<f64> = rows.iter().map(|r| r[3].parse().unwrap()).collect();
    assert!(expected.windows(2).all(|e| e[0] <= e[1]), "{expected:?}");
}

#[test]
fn confidence_is_learned_from_photographs_too() {
    let Some(faces) = crate::common::shared_data("faces", "confidence was not learned from photographs") else { return };
    let work = Work::new();
    let mut people = csv::Reader::from_path(faces.join("delineation189.csv")).unwrap();
    let left_out: Vec<String> = people.records().skip(20).map(|row| row.unwrap()[0].to_owned()).collect();
    let options = "--subjects 1 --held-out 1 --emotions happiness --frames 4 --size 240x200";
    let people = format!("--photographs {} --leave-out {}", faces.display(), left_out.join(","));
    work.grimace(&format!("evaluate confidence -o out {options} {people}")).exit(0);
    // Of 20 people every fifth is a test person, each in one of the four conditions.
    let results = work.json("out/evaluation.json");
    assert_eq!((&results["options"]["photographs"], &results["options"]["photographs_held_out"]), (&16.into(), &4.into()));
    let rows = work.rows("out/confidence_quintiles.csv");
    for condition in ["photographs, clean", "photographs, hard", "photographs, clean, half size", "photographs, hard, half size"]
    {
        assert_eq!(rows.iter().filter(|r| r["sequences"] == condition).count(), 5, "{condition}");
    }
    work.grimace("evaluate confidence -o none --leave-out L004").exit(2).says(&["--photographs"]);
}

#[test]
fn the_shipped_confidence_is_judged_by_a_dataset() {
    let folder = tempfile::tempdir().unwrap();
    let (faces, out) = (folder.path().join("faces"), folder.path().join("out"));
    let mut simulate = Command::new(crate::common::grimace());
    simulate.args(["simulate", "--subjects", "2", "--emotions", "happiness", "--frames", "5", "--size", "240x200", "-o"]);
    simulate.arg(&faces).run().exit(0);
    let mut command = Command::new(crate::common::grimace());
    command.args(["evaluate", "confidence"]).arg(&faces).args(["--by", "cohort", "--start", "seven", "-o"]).arg(&out);
    command.run().exit(0);
    // Four frames after the neutral one of two sequences, 104 nodes each.
    let mut reader = csv::Reader::from_path(out.join("confidence_quintiles.csv")).unwrap();
    let nodes: usize = reader.records().map(|r| r.unwrap()[2].parse::<usize>().unwrap()).sum();
    assert_eq!(nodes, 2 * 4 * 104);
    let mut wrong = Command::new(crate::common::grimace());
    wrong.args(["evaluate", "confidence"]).arg(&faces).args(["--by", "age", "-o"]).arg(folder.path().join("none"));
    wrong.run().exit(1).says(&["no column `age`"]);
}
