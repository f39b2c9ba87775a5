//! Looks of a person at the tracks of a run: `looked_at.csv`.

use std::fs;

use crate::common::Work;

/// Three smiles. The first is played backwards, which is a reason to look at it. The second ends early: so small a picture of a broad smile
/// is no clear case. `run` has run over them.
fn doubtful() -> Work {
    let work = Work::with_sequences(&["S001_005", "S002_005", "S003_005"]);
    let manifest = work.read("faces/manifest.csv");
    let rows = manifest.lines().map(|line| {
        let [first, last] = match line.split(',').next() {
            Some("subject") => ["first_frame", "last_frame"],
            Some("S001") => ["6", "1"],
            Some("S002") => ["1", "4"],
            _ => ["", ""],
        };
        format!("{line},{first},{last}")
    });
    let rows: Vec<String> = rows.collect();
    work.write("faces/manifest.csv", rows.join("\n") + "\n");
    let said = ["note: 1 of 3 sequences need a look; verdicts.csv has the reasons: S001_005", NEXT];
    work.grimace("run faces -o out").exit(0).prints(&said).prints(&["3 sequences  out/fap/happiness.fap"]);
    work
}

const NEXT: &str = "next: look at them with grimace annotate faces --tracks out: Y where one looks right, X to leave one out";

fn look(work: &Work, id: &str) -> String {
    let rows = work.rows("out/verdicts.csv");
    rows.iter().find(|row| row["id"] == id).unwrap()["look"].clone()
}

#[test]
fn a_look_written_by_hand_counts_until_the_track_changes() {
    let work = doubtful();
    // Nothing changed, and yet everything is said again.
    let again = work.grimace("run faces -o out").exit(0);
    again.prints(&[
        "nothing changed since the last run",
        "1 of 3 sequences need a look",
        "3 sequences  out/fap/happiness.fap",
        NEXT,
    ]);
    work.write("out/looked_at.csv", "id,look,by\nS001_005,right,Anna\n");
    let ran = work.grimace("run faces -o out").exit(0).prints(&["note: 1 sequence was looked at and found right"]);
    assert!(!ran.stdout.contains("need a look") && !ran.stdout.contains("next:"), "{}", ran.stdout);
    let row = work.rows("out/verdicts.csv")[0].clone();
    assert_eq!((row["verdict"].as_str(), row["look"].as_str()), ("look again", "right"));
    // The file says what was looked at, and keeps the other columns.
    let content = &row["content"];
    assert_eq!(work.read("out/looked_at.csv"), format!("id,look,by,content\nS001_005,right,Anna,{content}\n"));
    assert!(work.read("out/report.html").contains("1 looked at: right"));
    work.grimace("run faces -o out").exit(0).prints(&["nothing changed", "found right"]);
    // Another mark makes another track.
    let marks = work.read("faces/S001/005/correspondences.csv");
    let moved: Vec<String> =
        marks.lines().map(|l| l.strip_prefix("10,").map_or(l.to_owned(), |_| "10,101,120".to_owned())).collect();
    work.write("faces/S001/005/correspondences.csv", moved.join("\n") + "\n");
    let said = "1 sequence has other pictures or another track than when they were looked at";
    work.grimace("run faces -o out").exit(0).prints(&["1 of 3 sequences need a look", said]);
    assert_eq!(look(&work, "S001_005"), "outdated");
    work.write("faces/S001/005/correspondences.csv", marks);
    work.grimace("run faces -o out").exit(0).prints(&["found right"]);
}

#[test]
fn a_sequence_that_is_left_out_counts_nowhere_and_is_named() {
    let work = doubtful();
    work.write("out/looked_at.csv", "id;look\nS001_005;leave out\n");
    let said = "note: 1 sequence is left out of the statistics after a look (looked_at.csv): S001_005";
    work.grimace("run faces -o out").exit(0).prints(&[said, "2 sequences  out/fap/happiness.fap"]);
    assert_eq!(look(&work, "S001_005"), "leave out");
    for table in ["sequences.csv", "trimming.csv", "amplitudes.csv"] {
        assert!(!work.read(&format!("out/{table}")).contains("S001_005"), "{table}");
    }
    let report = work.read("out/report.html");
    assert!(report.contains("1 left out") && report.contains("1 sequence left out after a look"));
    // The same as if the manifest did not list it.
    let manifest = work.read("faces/manifest.csv");
    work.write("faces/two.csv", manifest.lines().filter(|l| !l.starts_with("S001")).collect::<Vec<_>>().join("\n"));
    work.grimace("run faces/two.csv -o two -q").exit(0);
    let model = "representatives/happiness.csv";
    assert_eq!(work.read(&format!("out/{model}")), work.read(&format!("two/{model}")));
    // `analyze` gives the same statistics, and labels are learned without it.
    work.grimace("analyze out -o again").exit(0).prints(&[said]);
    assert_eq!(work.read(&format!("again/{model}")), work.read(&format!("out/{model}")));
    assert!(!work.read("again/sequences.csv").contains("S001_005"));
    // Taken back.
    fs::remove_file(work.path("out/looked_at.csv")).unwrap();
    work.grimace("run faces -o out").exit(0).prints(&["1 of 3 sequences need a look", "3 sequences  out/fap"]);
}

#[test]
fn looks_that_are_wrong_are_said_before_anything_is_done() {
    let work = doubtful();
    let before = work.files("out");
    work.write("out/looked_at.csv", "id,look\nS001_005,fine\n");
    let said = "out/looked_at.csv, line 2: look is `fine`; `right`, `leave out` or nothing was expected";
    work.grimace("run faces -o out").exit(1).says(&[said]);
    work.grimace("analyze out -o again").exit(1).says(&[said]);
    fs::remove_file(work.path("out/looked_at.csv")).unwrap();
    assert!(before == work.files("out"));
    work.write("out/looked_at.csv", "id,look\nS009_005,right\n");
    work.grimace("run faces -o out").exit(0).prints(&["looked_at.csv: 1 row is not used", "S009_005"]);
    work.write("out/looked_at.csv", "id,look\nS001_005,leave out\nS002_005,leave out\nS003_005,leave out\n");
    work.grimace("run faces -o out").exit(1).says(&["all 3 tracked sequences are left out in looked_at.csv"]);
}

#[test]
fn looks_at_tracks_of_another_run_count_where_the_tracks_are_the_same() {
    let work = doubtful();
    work.write("out/looked_at.csv", "id,look\nS001_005,right\n");
    work.grimace("run faces -o out -q").exit(0);
    work.write("other/looked_at.csv", work.read("out/looked_at.csv"));
    work.grimace("run faces -o other").exit(0).prints(&["found right"]);
    // A step of a divided run takes them into account, too.
    let out = work.read("out/looked_at.csv").replace("right", "leave out");
    work.write("parts/looked_at.csv", out);
    work.grimace("run faces -o parts --plan").exit(0);
    work.grimace("run faces -o parts --emotion happiness -q").exit(0);
    work.grimace("run faces -o parts").exit(0).prints(&["left out of the statistics", "2 sequences  parts/fap"]);
}
