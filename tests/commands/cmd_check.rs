//! `grimace check`: reports the problems that `run` would meet in a dataset, in the same words, without tracking.

use std::collections::BTreeMap;

use crate::common::{Work, assert_same_files};

type Row = BTreeMap<String, String>;

#[test]
fn check_reports_the_problems_of_a_run() {
    let work = Work::with_sequences(&["S001_005", "S001_007", "S002_005", "S002_007", "S003_005", "S003_007"]);
    let rows =
        ["S001,005,happiness,A", "S001,007,surprise,A", "S002,005,joy,A", "S002,007,surprise,A", "S003,005,joy,B", "S003,007,,B"];
    work.write("faces/manifest.csv", format!("subject,sequence,emotion,cohort\n{}\n", rows.join("\n")));
    // An invalid node, a truncated neutral frame, marks outside the picture, and an apex that is not a picture.
    work.write("faces/S001/005/correspondences.csv", "node,x,y\n20,100,60\n500,90,60\n");
    let pictures = |folder: &str| -> Vec<String> {
        let names = work.files(folder).into_keys().filter(|name| !name.ends_with(".csv"));
        names.map(|name| format!("{folder}/{name}")).collect()
    };
    let neutral = &pictures("faces/S001/007")[0];
    work.write(neutral, &work.bytes(neutral)[..300]);
    work.write("faces/S002/005/correspondences.csv", "node,x,y\n20,100,60\n23,90,60\n56,80,60\n31,100,900\n");
    work.write(pictures("faces/S002/007").last().unwrap(), "no picture");
    let before = work.files("faces");
    let checked = work.grimace("check faces -o check.csv -j 1").exit(3);
    let checked = checked.prints(&["6 sequences of 3 people: 1 good, 0 need a look, 5 would fail", "next: grimace run faces"]);
    let checked =
        checked.prints(&["cohort: 2 groups, A (2 people); B (1 person); not tested", "happiness and joy (if they mean"]);
    assert!(checked.stdout.contains("would fail at dataset: S003_007: "), "{}", checked.stdout);
    assert_same_files(&before, &work.files("faces"));
    assert_eq!(checked.stdout, work.grimace("check faces -o again.csv -j 3").exit(3).stdout.replace("again.csv", "check.csv"));
    assert_eq!(work.read("check.csv"), work.read("again.csv"));

    work.grimace("run faces -o out").exit(3);
    let fields = |row: &Row, reason: &str| [&row["id"], &row["stage"], &row[reason]].map(String::clone);
    let failed: Vec<_> = work.rows("out/failures.csv").iter().map(|row| fields(row, "reason")).collect();
    let (good, fails): (Vec<Row>, Vec<Row>) = work.rows("check.csv").into_iter().partition(|row| row["verdict"] == "good");
    assert_eq!(fails.iter().map(|row| fields(row, "reasons")).collect::<Vec<_>>(), failed);
    assert_eq!(
        failed.iter().map(|[_, stage, _]| stage.as_str()).collect::<Vec<_>>(),
        ["dataset", "track", "fit", "track", "dataset"]
    );
    // For the valid sequence: six frames of 200x160, its marks, and the expected error of its nodes, as in the verdict of the
    // run.
    let (row, verdict) = (&good[0], &work.rows("out/verdicts.csv")[0]);
    let of = ["id", "source", "frames", "width", "height", "marks", "marked", "face_error_percent_es"]
        .map(|column| row[column].as_str());
    assert_eq!(of, ["S003_005", "images", "6", "200", "160", "file", "11", ""]);
    let [checked, ran] = [row, verdict].map(|row| row["placement_error_percent_es"].parse::<f64>().unwrap());
    // Tracks are rounded to a ten-thousandth of a pixel.
    assert!((checked - ran).abs() < 0.01, "{checked} {ran}");

    // Corrections are in the folder of results.
    work.write("out/corrections/S9_1.csv", "frame,node,x,y\n");
    let quiet = work.grimace("check faces --results out -q").exit(3);
    assert!(quiet.stdout.is_empty() && quiet.stderr.is_empty(), "{quiet:?}");
    work.grimace("check faces --results out").exit(3).prints(&["note: S9_1.csv in corrections/ is not applied"]);
}

#[test]
fn an_input_that_is_not_a_dataset_is_refused() {
    let work = Work::with_sequences(&["S001_005", "S002_005"]);
    work.grimace("check none").exit(1).says(&["none"]);
    work.grimace("check faces --by size").exit(1).says(&["no sequence has a column `size`; the columns are: subject, sequence"]);
    work.grimace("check faces --marks 3 --by").exit(2);
    work.grimace("check faces -o faces/manifest.csv --force")
        .exit(1)
        .says(&["faces/manifest.csv: --output would overwrite a file that this command did not write"]);
    work.grimace("check faces/manifest.csv -o faces/manifest.csv --force").exit(1).says(&["would overwrite the dataset"]);
    work.grimace("check faces/manifest.csv -o faces/S001/005/correspondences.csv --force")
        .exit(1)
        .says(&["would overwrite a file that this command did not write"]);
    work.grimace("check faces --results none").exit(1).says(&["--results none: there is no such folder"]);
    // There are no problems, and the groups have the names they have in the files of a run.
    let ran = work.grimace("check faces --by cohort").exit(0).prints(&["happiness (2); happiness_cohort-A (2)"]);
    assert!(ran.stdout.ends_with("next: grimace run faces -o results --by cohort\n"), "{}", ran.stdout);
    // The suggested run has the options of the check.
    let args = "--by cohort --check-marks off --resample linear --fit-force 15 -j 1 -q";
    work.grimace(&format!("check faces {args}")).exit(0);
    let ran = work.grimace(&format!("check faces {}", args.replace(" -q", ""))).exit(0);
    let next = "next: grimace run faces -o results --by cohort --resample linear --fit-force 15 --check-marks off\n";
    assert!(ran.stdout.ends_with(next), "{}", ran.stdout);
}

#[test]
fn notes_do_not_change_the_verdict_and_numbers_are_not_suggested_as_groups() {
    let work = Work::with_sequences(&["S001_005", "S002_005"]);
    // Two recordings, one of them too short; a file beside the frames that is not a frame; and the columns about the people.
    let rows = [
        "S001,005,happiness,,,,20,A",
        "S002,005,happiness,,,,30,B",
        "S003,talk,anger,S001/005,auto,5,40,B",
        "S004,talk,anger,S001/005,auto,,50,B",
    ];
    let header = "subject,sequence,emotion,frames,segment,fps,age,cohort";
    work.write("faces/manifest.csv", format!("{header}\n{}\n", rows.join("\n")));
    work.write("faces/S002/005/notes.heic", "");
    let checked = work.grimace("check faces -o check.csv --covariate age").exit(3);
    let checked = checked
        .prints(&["3 good, 0 need a look, 1 would fail", "columns of numbers (--covariate):\n  age: 4 numbers of 4 people"]);
    let checked =
        checked.prints(&["too short for a rest and an expression: 6 frames; at least 25 are needed", "note: S002_005: "]);
    let checked = checked
        .prints(&["whole recordings are not searched here; `run` makes a sequence of each expression that it finds in them"]);
    assert!(!checked.stdout.contains("a single sequence"), "{}", checked.stdout);
    let rows = work.rows("check.csv");
    let of = |column: &str| rows.iter().map(|row| row[column].clone()).collect::<Vec<_>>();
    assert_eq!(of("verdict"), ["good", "good", "good", "fails"]);
    assert_eq!(of("marks"), ["file", "file", "", ""]);
    assert_eq!(of("source"), ["images", "images", "recording", "recording"]);
    assert!(rows[0]["notes"].is_empty() && rows[1]["notes"].contains("notes.heic"), "{rows:?}");
    work.grimace("check faces --covariate cohort").exit(1).says(&["the column `cohort` has no numbers"]);
    work.grimace("check faces --strata cohort").exit(2);
}
