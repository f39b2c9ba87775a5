//! `grimace analyze`: commands and their output.

use crate::common::{SEQUENCES, Work, assert_same_files};

#[test]
fn models_and_representatives_given_as_tracks_are_refused_by_kind() {
    let work = Work::with_sequences(&["S001_005", "S002_005"]);
    work.grimace("run faces -o R -q").exit(0);
    let model = "S001_005.csv: this is a normalized model in face units, not a track";
    work.grimace("analyze R/models -o x").exit(1).says(&[model, "none of the 2 tracks is usable"]);
    work.grimace("features R/models/S001_005.csv -o x").exit(1).says(&[model]);
    work.grimace("recognize --with R R/models/S001_005.csv").exit(1).says(&[model]);
    work.grimace("features R/representatives/happiness.csv -o x")
        .exit(1)
        .says(&["happiness.csv: this is a representative, not a track"]);
}

#[test]
fn invalid_numbers_are_reported_with_their_option() {
    let work = Work::new();
    let refused = |args: &str, said: &str| {
        let ran = work.grimace(args).exit(2).says(&[said]);
        assert!(!ran.stderr.contains("tip") && !ran.stderr.contains("invalid digit"), "{}", ran.stderr);
    };
    refused("analyze a.csv -o x --fps 29.97", "invalid value '29.97' for '--fps <FPS>': expected a whole number from 1 to 1000");
    refused("fap convert a.fap -o b.fap --fps 29.97", "expected a whole number from 1 to 32767");
    refused("clone -s a.fap -t a.jpg -o x --emphasis 1e300", "expected a number greater than 0, 100 at most");
    refused("track faces -o a.csv --fps 1e300", "expected a number from 0.1 to 1000 frames per second");
    work.grimace("analyze a.csv -o x --profile greta --fps 30").exit(1).says(&["the greta profile needs 25 frames per second"]);
    refused("analyze a.csv -o x --alpha -0.1", "'--alpha <ALPHA>': expected a share of at least 0 and less than 0.5");
    refused("clone -s a.fap -t a.jpg -o x --emphasis -1", "'--emphasis <C>': expected a number greater than 0");
    refused("analyze a.csv -o x --seed -1", "'--seed <SEED>': expected a whole number of at least 0");
    refused("simulate -o x --noise much", "'--noise <SIGMA>': expected a number");
    refused("simulate -o x --seed -1", "'--seed <SEED>': expected a whole number of at least 0");
}

#[test]
fn analyzing_the_tracks_of_a_run_gives_its_statistics() {
    let work = Work::after_run(&SEQUENCES, "out");
    let ran = work.grimace("analyze out/tracks -o again").exit(0);
    work.grimace("analyze again -o more").exit(1).says(&["again: this is a result of `grimace analyze`, which has no tracks"]);
    ran.prints(&["6 tracks, 0 failed", "3 sequences  again/fap/happiness.fap", "report: again/report.html"]);
    assert_same_files(&work.files("out/models"), &work.files("again/models"));
    // Only a run reads pictures; it gives the reason why these few people have no common skin.
    let without_skin = |folder: &str| {
        let mut files = work.files(folder);
        for (_, bytes) in files.iter_mut().filter(|(name, _)| name.ends_with(".json")) {
            let mut value: serde_json::Value = serde_json::from_slice(bytes).unwrap();
            value.as_object_mut().unwrap().remove("no_skin");
            *bytes = value.to_string().into_bytes();
        }
        files
    };
    assert_same_files(&without_skin("out/representatives"), &without_skin("again/representatives"));
    for file in ["fap/happiness.fap", "fap/surprise.fap", "features/happiness.svg"] {
        assert_eq!(work.read(&format!("out/{file}")), work.read(&format!("again/{file}")), "{file}");
    }
    for file in ["statistics.csv", "trimming.csv", "failures.csv"] {
        assert_eq!(work.read(&format!("out/{file}")), work.read(&format!("again/{file}")), "{file}");
    }
    // The folder of a run is accepted in place of its tracks.
    work.grimace("analyze out -o whole").exit(0).prints(&["6 tracks, 0 failed"]);
    assert_same_files(&work.files("again/representatives"), &work.files("whole/representatives"));
}

#[test]
fn bytes_do_not_depend_on_threads_or_on_the_order_of_the_files() {
    let work = Work::after_run(&SEQUENCES, "out");
    work.grimace("analyze out/tracks -o a/results --threads 1").exit(0);
    let backwards: Vec<String> = SEQUENCES.iter().rev().map(|id| format!("out/tracks/{id}.csv")).collect();
    work.grimace(&format!("analyze {} -o b/results --threads 2", backwards.join(" "))).exit(0);
    assert_same_files(&work.files("a"), &work.files("b"));
}

#[test]
fn groups_may_come_from_columns_written_after_tracking() {
    let work = Work::after_run(&SEQUENCES, "out");
    let manifest = work.read("faces/manifest.csv");
    let classes = ["class", "low", "low", "high", "high", "high", "high"];
    let later: Vec<String> = manifest.lines().zip(classes).map(|(line, class)| format!("{line},{class}")).collect();
    work.write("later.csv", later.join("\n"));
    work.grimace("analyze out/tracks -o groups --by class").exit(1).says(&["class", "cohort"]);
    work.grimace("analyze out/tracks -o groups --dataset later.csv --by class").exit(0);
    assert!(work.header("groups/statistics.csv").ends_with(",class"));
    let rows = work.rows("groups/statistics.csv");
    let count = |emotion: &str, class: &str| {
        rows.iter().find(|r| r["emotion"] == emotion && r["class"] == class).map(|r| r["sequences"].clone())
    };
    assert_eq!((count("happiness", "low").as_deref(), count("happiness", "high").as_deref()), (Some("1"), Some("2")));
    assert!(work.path("groups/fap/surprise_class-high.fap").exists());
}

#[test]
fn options_of_the_statistics_take_effect() {
    let work = Work::after_run(&SEQUENCES, "out");
    work.grimace("analyze out/tracks -o trimmed --alpha 0.4 --median exact --between 2 --fps 30").exit(0);
    // floor(0.4 * 3) = 1 of 3 models is dropped in each of the 4 fields of the 2 emotions.
    let dropped = work.rows("trimmed/trimming.csv").iter().filter(|r| r["dropped"] == "true").count();
    assert_eq!(dropped, 8);
    // 5 key frames and 2 between: 5 + 4 * 2 = 13 frames.
    assert!(work.read("trimmed/fap/happiness.fap").starts_with("2.1 happiness 30 13\n"));
    work.grimace("analyze out/tracks -o uniform --size uniform --resample linear").exit(0);
    assert_ne!(work.read("uniform/models/S001_005.csv"), work.read("trimmed/models/S001_005.csv"));
}

#[test]
fn only_files_of_an_earlier_analysis_are_removed() {
    let work = Work::after_run(&["S001_005", "S002_005", "S003_005"], "out");
    work.grimace("analyze out/tracks -o again --by cohort --alpha 0.4").exit(0);
    let record = std::fs::File::options().append(true).open(work.path("again/analyze.b3")).unwrap();
    record.lock().unwrap();
    let before = work.files("again");
    work.grimace("analyze out/tracks -o again --force").exit(1).says(&["another command is writing into this folder"]);
    assert_same_files(&before, &work.files("again"));
    drop(record);
    work.write("file", "").grimace("analyze out/tracks -o file --force").exit(1).says(&["file: this is a file"]);
    let stale = ["comparisons.csv", "representatives/happiness_cohort-B.json", "fap/happiness_cohort-B.fap"];
    assert!(stale.iter().all(|name| work.path(&format!("again/{name}")).exists()));
    work.write("again/representatives/mine.txt", "mine").write("again/intervals.csv", "edited");
    let ran = work.grimace("analyze out/tracks -o again --alpha 0 --force").exit(0);
    ran.says(&["intervals.csv: this file of an earlier `analyze` was changed by hand and is kept"]);
    assert!(stale.iter().all(|name| !work.path(&format!("again/{name}")).exists()));
    work.grimace("figures again -o figures -q").exit(0);
    assert!(!work.read("figures/captions.md").contains("cohort"));
    // The remaining files equal those of a new folder.
    work.grimace("analyze out/tracks -o new/again --alpha 0").exit(0);
    let (mut again, mut new) = (work.files("again"), work.files("new/again"));
    assert_eq!(again.remove("representatives/mine.txt").as_deref(), Some(&b"mine"[..]));
    assert_eq!(again.remove("intervals.csv").as_deref(), Some(&b"edited"[..]));
    assert!(again.remove("analyze.b3").is_some() && new.remove("analyze.b3").is_some());
    assert_same_files(&again, &new);
    // Without a record the command cannot know which files are its own, and says so.
    work.write("foreign/representatives/joy.json", "{}");
    let ran = work.grimace("analyze out/tracks -o foreign --force").exit(0);
    ran.says(&["note: foreign has no analyze.b3, the record of an earlier analysis"]);
    assert!(work.path("foreign/representatives/joy.json").exists());
    // It overwrites no file that it did not write itself or that was edited since.
    let whole = work.files("foreign");
    work.write("mine/statistics.csv", "mine");
    for folder in ["mine", "foreign"] {
        let text = work.read(&format!("{folder}/statistics.csv"));
        work.write(&format!("{folder}/statistics.csv"), text + "\n# checked");
        let ran = work.grimace(&format!("analyze out/tracks -o {folder} --force")).exit(1);
        ran.says(&["statistics.csv: this file exists and differs from what an earlier `analyze` wrote"]);
        assert!(work.read(&format!("{folder}/statistics.csv")).ends_with("# checked"));
    }
    std::fs::write(work.path("foreign/statistics.csv"), &whole["statistics.csv"]).unwrap();
    work.grimace("analyze out/tracks -o foreign --by cohort --force").exit(0);
    work.write("foreign/comparisons.csv", "edited");
    work.grimace("analyze out/tracks -o foreign --by cohort --force").exit(1).says(&["comparisons.csv: this file exists"]);
    assert_eq!(work.read("foreign/comparisons.csv"), "edited");
    // An analysis that stopped early has recorded its files, so the next one recognizes them.
    work.write("stopped/fap", "no folder");
    work.grimace("analyze out/tracks -o stopped --force").exit(1);
    let written = work.read("stopped/analyze.b3");
    assert!(written.contains("  models/S001_005.csv\n") && written.contains("  representatives/"), "{written}");
    std::fs::remove_file(work.path("stopped/fap")).unwrap();
    work.grimace("analyze out/tracks -o stopped --force").exit(0);
}

#[test]
fn damaged_manifest_rows_and_unlisted_tracks_are_reported() {
    let work = Work::after_run(&SEQUENCES, "out");
    let row = |id: &str, emotion: &str| {
        let (subject, sequence) = id.split_once('_').unwrap();
        format!("{subject},{sequence},{emotion},faces/{subject}/{sequence}\n")
    };
    let tracks: Vec<String> =
        work.files("out/tracks").into_keys().filter_map(|n| n.strip_suffix(".csv").map(str::to_owned)).collect();
    let [first, second, third, ..] = tracks.as_slice() else { panic!("{tracks:?}") };
    let rows = [row(first, "joy"), row(first, "anger"), row(second, "")].concat();
    work.write("relabelled.csv", format!("subject,sequence,emotion,frames\n{rows}"));
    let ran = work.grimace("analyze out/tracks -o labels --dataset relabelled.csv").exit(3);
    ran.says(&["emotion is empty", "are not in the manifest of --dataset", third]);
    let statistics = work.read("labels/statistics.csv");
    assert!(statistics.contains("joy"), "{statistics}");
    // The sequence with the damaged row has no label, and the duplicate is reported.
    let reasons: Vec<String> = work.rows("labels/failures.csv").iter().map(|r| r["reason"].clone()).collect();
    assert!(reasons.len() == 2 && reasons.iter().any(|r| r.contains("line 3")), "{reasons:?}");
    assert!(!work.path(&format!("labels/models/{second}.csv")).exists());
}

#[test]
fn a_bad_track_fails_alone() {
    let work = Work::after_run(&SEQUENCES, "out");
    let track = work.read("out/tracks/S001_005.csv");
    let lines: Vec<&str> = track.lines().collect();
    work.write("out/tracks/S001_005.csv", lines[..lines.len() - 7].join("\n"));
    work.write("out/tracks/S001_007.csv", work.read("out/tracks/S001_007.csv").replacen(",tracked,", ",lucky,", 1));
    work.write("out/tracks/S002_005.csv", "frame,node,x\n1,0,3\n");
    let nan = work
        .read("out/tracks/S002_007.csv")
        .lines()
        .map(|l| if l.starts_with("3,7,") { "3,7,NaN,1,tracked,," } else { l })
        .collect::<Vec<_>>()
        .join("\n");
    work.write("out/tracks/S002_007.csv", nan);
    work.write("out/tracks/S003_005.csv", "");
    work.write("out/tracks/alone_1.csv", &track);
    let ran = work.grimace("analyze out/tracks -o again").exit(3).prints(&["7 tracks, 6 failed"]);
    ran.says(&[
        "S001_005.csv: frame 6 has 106 nodes, but frame 1 has 113",
        "`lucky` is not a node state; the states are marked,",
        "S002_005.csv, line 1: has no column `y`",
        "x is `NaN`; a finite number was expected",
        "S003_005.csv: is empty; a header line was expected",
        "alone_1.csv: the emotion is unknown; give --dataset",
    ]);
    assert_eq!(work.rows("again/failures.csv").len(), 6);
    assert_eq!(work.rows("again/statistics.csv").len(), 1);
    let ran = work.grimace("analyze out/tracks/alone_1.csv -o none").exit(1);
    ran.says(&["none of the 1 tracks is usable"]);
}

#[test]
fn many_bad_tracks_are_summarized_and_all_are_in_a_table() {
    let work = Work::after_run(&["S001_005", "S002_005"], "out");
    for k in 0..20 {
        work.write(&format!("out/tracks/S1{k:02}_005.csv"), "frame,node,x\n1,0,3\n");
    }
    let named = "S101_005; S102_005; S103_005; S104_005; S105_005; S106_005; and 13 more";
    let more = format!("19 more sequences failed like S100_005: {named}");
    let ran = work.grimace("analyze out/tracks -o again").exit(3).prints(&["22 tracks, 20 failed"]);
    let ran = ran.says(&["S100_005.csv, line 1: has no column `y`", &format!("{more}; reasons: again/failures.csv")]);
    assert_eq!(ran.stderr.lines().count(), 2, "{}", ran.stderr);
    assert_eq!(work.rows("again/failures.csv").len(), 20);
    // If nothing is written, there is no table of failures.
    let ran = work.grimace("analyze out/tracks -o none --by shoesize").exit(1).says(&[&more]);
    assert!(!ran.stderr.contains("failures.csv") && !work.path("none/failures.csv").exists(), "{}", ran.stderr);
    let ran = work.grimace("recognize --with out out/tracks/S001_005.csv -o r.csv").exit(1).says(&[&more]);
    assert!(!ran.stderr.contains("S119_005"), "{}", ran.stderr);
}

#[test]
fn a_track_read_twice_counts_once() {
    let work = Work::after_run(&["S001_005", "S002_005"], "out");
    work.grimace("analyze out/tracks out/tracks/S001_005.csv -o again").exit(0).prints(&["2 tracks, 0 failed"]);
    for extension in ["csv", "json"] {
        work.write(&format!("copy/S009_005.{extension}"), work.read(&format!("out/tracks/S001_005.{extension}")));
    }
    let ran = work.grimace("analyze out/tracks copy -o twice").exit(3);
    ran.says(&["S001_005", "was read before"]);
}

#[test]
fn missing_and_obstructing_files_are_reported() {
    let work = Work::after_run(&["S001_005"], "out");
    work.grimace("analyze nowhere -o again").exit(1).says(&["nowhere", "No such file"]);
    work.write("none/a.txt", "x").grimace("analyze none -o again").exit(1).says(&["found no tracks (.csv) in none"]);
    work.write("full/a.txt", "x").grimace("analyze out/tracks -o full").exit(1).says(&["full is not empty", "--force"]);
    work.write("file", "x").grimace("analyze out/tracks -o file/results").exit(1).says(&["cannot write file/results"]);
    work.grimace("analyze out/tracks -o again --dataset nowhere").exit(1).says(&["nowhere: there is no such dataset"]);
}
