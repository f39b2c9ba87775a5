//! Further runs over a dataset: what is made again, what is kept, what is refused.

use crate::common::{SEQUENCES, Work, assert_same_files};
use std::{
    collections::BTreeSet,
    fs,
    time::{Duration, SystemTime},
};

/// Sets the dates of all files back, so that newly written files are recognizable.
fn date_back(work: &Work, folder: &str) {
    for name in work.files(folder).keys() {
        fs::File::options().append(true).open(work.path(folder).join(name)).unwrap().set_modified(long_ago()).unwrap();
    }
}

fn long_ago() -> SystemTime {
    SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000)
}

/// Returns the files written since [`date_back`].
pub fn written(work: &Work, folder: &str) -> BTreeSet<String> {
    let is_new = |name: &String| fs::metadata(work.path(folder).join(name)).unwrap().modified().unwrap() != long_ago();
    work.files(folder).into_keys().filter(is_new).collect()
}

#[test]
fn a_second_run_over_the_same_dataset_writes_nothing() {
    let work = Work::with_faces();
    work.grimace("run faces -o out").exit(0);
    date_back(&work, "out");
    let before = work.files("out");
    work.grimace("run faces -o out").exit(0).prints(&["nothing changed since the last run: 6 sequences; nothing written"]);
    assert_eq!(written(&work, "out"), BTreeSet::new());
    // A new date of the frames is not a change of content.
    date_back(&work, "faces");
    work.grimace("run faces -o out --threads 2").exit(0).prints(&["nothing changed"]);
    assert_same_files(&before, &work.files("out"));
}

#[test]
fn a_changed_correspondence_file_redoes_that_sequence_only() {
    let work = Work::after_run(&SEQUENCES, "out");
    date_back(&work, "out");
    let marks = work.read("faces/S002/005/correspondences.csv");
    let moved: Vec<String> =
        marks.lines().map(|l| l.strip_prefix("10,").map_or(l.to_owned(), |_| "10,100,150".to_owned())).collect();
    work.write("faces/S002/005/correspondences.csv", moved.join("\n") + "\n");
    work.grimace("run faces -o out").exit(0).prints(&["6 sequences: 1 tracked, 5 unchanged, 0 failed"]);
    let tracks: Vec<_> = written(&work, "out").into_iter().filter(|name| name.starts_with("tracks/")).collect();
    assert_eq!(tracks, ["tracks/S002_005.csv", "tracks/S002_005.json"]);
    work.grimace("run faces -o fresh").exit(0);
    assert_same_files(&work.files("fresh"), &work.files("out"));
}

#[test]
fn a_track_that_was_damaged_or_removed_is_made_again() {
    let work = Work::after_run(&["S001_005", "S002_005"], "out");
    let before = work.files("out");
    work.replace("out/tracks/S001_005.csv", "tracked", "fitted");
    fs::remove_file(work.path("out/models/S002_005.csv")).unwrap();
    let said = "note: tracks/S001_005.csv was changed by hand and is overwritten";
    work.grimace("run faces -o out").exit(0).prints(&["1 tracked, 1 unchanged", said]);
    // The record differs only by this note.
    let (mut before, mut after) = (before, work.files("out"));
    let [was, mut is] = [&mut before, &mut after]
        .map(|files| serde_json::from_slice::<serde_json::Value>(&files.remove("run.json").unwrap()).unwrap());
    is["warnings"].as_array_mut().unwrap().retain(|note| !note.as_str().unwrap().starts_with(&said["note: ".len()..]));
    assert_eq!(was, is);
    assert_same_files(&before, &after);
}

#[test]
fn unreadable_corrections_fail_their_sequence_until_they_are_repaired() {
    let work = Work::after_run(&["S001_005", "S002_005"], "out");
    let before = work.files("out/tracks");
    work.write("out/corrections/S001_005.csv", "frame,node,x,y\n3,abc,1,2\n");
    let bad = "S001_005.csv, line 2: node is `abc`";
    work.grimace("run faces -o out").exit(3).says(&[bad]);
    work.grimace("run faces -o out").exit(3).prints(&["nothing changed"]).says(&[bad]);
    work.write("out/corrections/S001_005.csv", "frame,node,x,y\n3,31,90.5,100.25\n");
    work.grimace("run faces -o out").exit(0).prints(&["1 unchanged, 0 failed"]);
    assert!(work.read("out/tracks/S001_005.csv").contains("3,31,90.5,100.25,corrected"));
    // A damaged file again, which is then removed.
    work.write("out/corrections/S001_005.csv", "none");
    work.grimace("run faces -o out").exit(3);
    fs::remove_file(work.path("out/corrections/S001_005.csv")).unwrap();
    work.grimace("run faces -o out").exit(0).prints(&["1 unchanged, 0 failed"]);
    assert_same_files(&before, &work.files("out/tracks"));
}

#[test]
fn a_sequence_removed_from_the_dataset_is_removed_from_the_results() {
    let work = Work::after_run(&["S001_005", "S002_005", "S001_007"], "out");
    let manifest = work.read("faces/manifest.csv");
    work.write("faces/manifest.csv", manifest.lines().filter(|l| !l.starts_with("S001,007")).collect::<Vec<_>>().join("\n"));
    work.grimace("run faces -o out").exit(0).prints(&["2 sequences: 0 tracked, 2 unchanged"]);
    work.grimace("run faces -o fresh").exit(0);
    assert_same_files(&work.files("fresh"), &work.files("out"));
}

#[test]
fn a_new_label_or_column_is_a_change() {
    let work = Work::after_run(&["S001_005", "S002_005"], "out");
    work.replace("faces/manifest.csv", "S002,005,happiness", "S002,005,joy");
    // Nothing is tracked again for this.
    work.grimace("run faces -o out").exit(0).prints(&["0 tracked, 2 unchanged"]);
    work.grimace("run faces -o fresh").exit(0);
    assert_same_files(&work.files("fresh"), &work.files("out"));
    assert!(work.path("out/fap/joy.fap").exists());
    work.replace("faces/manifest.csv", ",f,A", ",f,C");
    work.grimace("run faces -o out").exit(0);
    work.grimace("run faces -o fresh --force").exit(0);
    assert_same_files(&work.files("fresh"), &work.files("out"));
}

#[test]
fn another_dataset_of_the_same_name_does_not_replace_results() {
    let work = Work::with_sequences(&["S001_005", "S002_005"]);
    let manifest = work.read("faces/manifest.csv");
    let rows = |subject: &str| -> String {
        let kept = manifest.lines().enumerate().filter(|(i, line)| *i == 0 || line.starts_with(subject));
        kept.map(|(_, line)| format!("{line}\n")).collect()
    };
    work.write("faces/train.csv", rows("S001")).write("faces/test.csv", rows("S002"));
    work.grimace("run faces/train.csv -o out").exit(0);
    let before = work.files("out");
    work.grimace("run faces/test.csv -o out").exit(1).says(&["another dataset", "faces/train.csv", "--force"]);
    assert_same_files(&before, &work.files("out"));
    // The same name, but other people.
    work.write("faces/manifest.csv", rows("S001")).grimace("run faces -o both").exit(0);
    work.write("faces/manifest.csv", rows("S002"));
    work.grimace("run faces -o both").exit(1).says(&["that has no sequence in common with this one"]);
    // With --force nothing of the first dataset remains.
    work.grimace("run faces -o both --force").exit(0);
    work.grimace("run faces -o fresh").exit(0);
    assert_same_files(&work.files("fresh"), &work.files("both"));
}

#[test]
fn only_results_of_an_interrupted_run_are_removed() {
    let work = Work::after_run(&["S001_005"], "out");
    // Files as from an interrupted run with a sequence that has left the dataset since; and files that no run wrote.
    let track = work.bytes("out/tracks/S001_005.csv");
    let ours = ["tracks/S009_001.csv", "models/S009_001.csv"];
    let mine = [
        "tracks/mine.csv",
        "tracks/notes.json",
        "models/mine.csv",
        "representatives/mine.csv",
        "fap/mine.fap",
        "parts/mine.json",
    ];
    for name in ours.iter().chain(&mine) {
        work.write(&format!("out/{name}"), &track);
    }
    let hash = blake3::hash(&track).to_hex();
    work.write("out/run.journal", ours.map(|name| format!("{name}\t\n{name}\t{hash}\n")).concat());
    work.replace("faces/manifest.csv", ",happiness,", ",joy,");
    work.grimace("run faces -o out").exit(0);
    assert!(ours.iter().all(|name| !work.path(&format!("out/{name}")).exists()));
    assert!(!work.path("out/fap/happiness.fap").exists() && !work.path("out/run.journal").exists());
    for name in mine {
        assert_eq!(work.bytes(&format!("out/{name}")), track, "{name}");
    }
    // A run that is killed between its last two steps leaves its journal; the next run only has to finish this.
    work.write("out/run.journal", "fap/joy.fap\t\n");
    work.grimace("run faces -o out").exit(0);
    assert!(!work.path("out/run.journal").exists() && work.path("out/fap/joy.fap").exists());
}

#[test]
fn a_changed_stale_result_is_kept_and_reported() {
    let work = Work::after_run(&["S001_005", "S002_005"], "out");
    work.write("out/models/S002_005.csv", "mine");
    let manifest = work.read("faces/manifest.csv");
    work.write("faces/manifest.csv", manifest.lines().filter(|l| !l.starts_with("S002")).collect::<Vec<_>>().join("\n"));
    work.grimace("run faces -o out").exit(0).prints(&["note: models/S002_005.csv", "is kept"]);
    assert_eq!(work.read("out/models/S002_005.csv"), "mine");
    assert!(!work.path("out/tracks/S002_005.csv").exists());
}

#[test]
fn a_result_that_was_changed_is_not_replaced_without_force() {
    let work = Work::after_run(&["S001_005", "S002_005"], "out");
    let table = work.bytes("out/statistics.csv");
    work.write("out/statistics.csv", "my notes");
    work.grimace("run faces -o out")
        .exit(1)
        .says(&["statistics.csv: a result has this name, but no run wrote this file, or it was \
         changed since"]);
    assert_eq!(work.read("out/statistics.csv"), "my notes");
    work.grimace("run faces -o out --force")
        .exit(0)
        .prints(&["note: statistics.csv was not written by a run into this folder, or was \
         changed since; it was replaced"]);
    assert_eq!(work.bytes("out/statistics.csv"), table);
    // A missing result is made again.
    fs::remove_file(work.path("out/statistics.csv")).unwrap();
    work.grimace("run faces -o out").exit(0).prints(&["0 tracked, 2 unchanged"]);
    assert_eq!(work.bytes("out/statistics.csv"), table);
}

#[test]
fn files_of_no_run_are_not_replaced_without_force() {
    let work = Work::with_sequences(&["S001_005", "S002_005"]);
    let manifest = work.read("faces/manifest.csv");
    work.write("faces/manifest.csv", manifest.lines().filter(|l| !l.starts_with("S002")).collect::<Vec<_>>().join("\n"));
    work.grimace("run faces -o out").exit(0);
    work.write("faces/manifest.csv", &manifest).write("out/models/S002_005.csv", "mine");
    work.grimace("run faces -o out")
        .exit(1)
        .says(&["S002_005.csv: a result has this name, but no run wrote this file, or it was changed since", "--force"]);
    assert_eq!(work.read("out/models/S002_005.csv"), "mine");
    work.grimace("run faces -o out --force")
        .exit(0)
        .prints(&["note: models/S002_005.csv was not written by a run into this folder, or \
         was changed since; it was replaced"]);
    work.write("out/run.json", "{}");
    work.grimace("run faces -o out").exit(1).says(&["run.json: damaged", "--force"]);
}

#[test]
fn corrections_by_hand_are_applied_after_every_new_tracking_and_kept() {
    let work = Work::after_run(&["S001_005"], "out");
    let state = || {
        let rows = work.rows("out/tracks/S001_005.csv");
        let row = rows.iter().find(|r| r["frame"] == "3" && r["node"] == "31").unwrap().clone();
        (row["state"].clone(), row["x"].clone(), row["y"].clone())
    };
    let corrected = ("corrected".to_owned(), "90.5".to_owned(), "100.25".to_owned());
    let file = "frame,node,x,y\n3,31,90.5,100.25\n";
    work.write("out/corrections/S001_005.csv", file);
    work.grimace("run faces -o out").exit(0).prints(&["1 tracked, 0 unchanged"]);
    assert_eq!(state(), corrected);
    work.grimace("run faces -o out").exit(0).prints(&["nothing changed"]);
    // Another option, another mark: tracked and corrected again.
    work.grimace("run faces -o out --window 0.2 --force").exit(0).prints(&["1 tracked"]);
    assert_eq!(state(), corrected);
    // The same inputs and corrections give the same bytes.
    work.write("fresh/corrections/S001_005.csv", file);
    work.grimace("run faces -o fresh --window 0.2 --force").exit(0);
    assert_eq!(work.bytes("fresh/tracks/S001_005.csv"), work.bytes("out/tracks/S001_005.csv"));
    // A correction of a missing frame is reported and kept.
    work.write("out/corrections/S001_005.csv", format!("{file}99,31,1,1\n"));
    let said = "corrections/S001_005.csv no longer fits the track and is kept, but not applied: frame 99, node 31";
    work.grimace("run faces -o out --window 0.2").exit(0).prints(&[said]);
    assert_eq!(state(), corrected);
    assert_eq!(work.read("out/corrections/S001_005.csv"), format!("{file}99,31,1,1\n"));
    // A track of an older version has its corrections only inside: they are copied to their file before the track is made
    // again.
    fs::remove_dir_all(work.path("out/corrections")).unwrap();
    let json = work.read("out/tracks/S001_005.json");
    let mut json: serde_json::Value = serde_json::from_str(&json).unwrap();
    json.as_object_mut().unwrap().remove("corrections");
    work.write("out/tracks/S001_005.json", json.to_string());
    work.grimace("run faces -o out --force").exit(0).prints(&["1 tracked"]);
    assert_eq!((state(), work.read("out/corrections/S001_005.csv")), (corrected, file.to_owned()));
}

#[test]
fn other_options_are_refused_without_force_and_the_difference_is_reported() {
    let work = Work::after_run(&["S001_005", "S002_005"], "out");
    let before = work.files("out");
    work.grimace("run faces -o out --alpha 0.2").exit(1).says(&["statistics", "0.1", "0.2", "--force"]);
    work.grimace("run faces -o out --by sex").exit(1).says(&["by: previously none", "now sex", "--force"]);
    work.grimace("run faces -o out --window 0.2").exit(1).says(&["window", "0.2", "--force"]);
    // For files the message gives the names, not the hashes.
    let (picture, marks) = ("faces/S001/005/S001_005_00000001.png", "faces/S001/005/correspondences.csv");
    let portrait = format!("other options (portrait: previously the built-in one, now {picture}); choose another folder");
    work.grimace(&format!("run faces -o out --portrait {picture} -c {marks}")).exit(1).says(&[&portrait]);
    assert_same_files(&before, &work.files("out"));
    // With --force, tracks that do not depend on the option are kept.
    work.grimace("run faces -o out --alpha 0.2 --force").exit(0).prints(&["0 tracked, 2 unchanged"]);
    work.grimace("run faces -o out --alpha 0.2 --window 0.2 --force").exit(0).prints(&["2 tracked, 0 unchanged"]);
    work.grimace("run faces -o fresh --alpha 0.2 --window 0.2").exit(0);
    assert_same_files(&work.files("fresh"), &work.files("out"));
}

#[test]
fn options_of_any_digits_are_recognized_in_the_next_run() {
    let work = Work::with_sequences(&["S001_005"]);
    // Numbers whose shortest text is read wrongly in the last bit by a fast but inexact JSON reader.
    let options = "--alpha 0.12345678901234566 --extreme 7.038531e-1 --window 0.11700000000000001 --fit-force 19.999999999999996";
    work.grimace(&format!("run faces -o out {options}")).exit(0);
    work.grimace(&format!("run faces -o out {options}")).exit(0).prints(&["nothing changed"]);
}

#[test]
fn a_folder_with_other_files_is_refused() {
    let work = Work::with_sequences(&["S001_005"]);
    work.write("out/holiday.txt", "sun");
    work.grimace("run faces -o out").exit(1).says(&["out is not empty", "another folder, or give --force"]);
    assert_eq!(work.files("out").len(), 1);
    work.grimace("run faces -o out --force").exit(0);
    assert_eq!(work.read("out/holiday.txt"), "sun");
    work.write("other/manifest.csv", work.read("faces/manifest.csv"));
    work.grimace("run other -o out").exit(1).says(&["another dataset, `faces`", "--force"]);
}
