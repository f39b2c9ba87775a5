//! `grimace recognize` on pictures: they are tracked with the options of the run that serves as training data.

use crate::common::{SEQUENCES, Work, root};

#[test]
fn pictures_are_recognized_as_their_tracks_are() {
    let work = Work::with_faces();
    work.grimace("run faces -o R --window 0.25 -q").exit(0);
    let ran = work.grimace("recognize --with R R/tracks/S001_005.csv R/tracks/S001_007.csv -o tracks.csv -q").exit(0);
    assert!(!ran.stderr.contains("run.json"), "{}", ran.stderr);
    let before = work.files("faces");
    // A dataset without emotions, in which one sequence cannot be tracked.
    work.write("faces/manifest.csv", "subject,sequence\nS001,005\nS001,007\nS009,001\n");
    let ran = work.grimace("recognize --with R faces -o unlabelled.csv -j 1").exit(3);
    let ran = ran.prints(&["2 sequences recognized"]).says(&["failed: S009_001 at dataset: "]);
    assert!(ran.stderr.contains("2 of the sequences have names of people of the training data"), "{}", ran.stderr);
    let unlabelled = work.read("tracks.csv").replace("005,happiness,", "005,,").replace("007,surprise,", "007,,");
    assert_eq!(work.read("unlabelled.csv"), unlabelled);
    // If emotions are given, they are in the table; a folder of frames is a sequence.
    work.write("faces/manifest.csv", "subject,sequence,emotion\nS001,005,Happiness\nS001,007,?\n");
    work.grimace("recognize --with R faces -o labelled.csv -j 3").exit(0);
    assert_eq!(work.read("labelled.csv"), unlabelled.replace("005,,", "005,happiness,"));
    let printed = work.grimace("recognize --with R faces/S001/005").exit(0).stdout;
    assert_eq!(printed.lines().collect::<Vec<_>>(), unlabelled.lines().take(2).collect::<Vec<_>>());
    // Options with other names, and options of another wireframe.
    let run_json = work.read("R/run.json");
    work.write("R/run.json", run_json.replace("\"even_light\"", "\"light\""));
    let ran = work.grimace("recognize --with R R/tracks/S001_005.csv").exit(0);
    ran.says(&["the run.json of R has settings that this version does not know: track.light; the defaults are used instead"]);
    work.write("R/run.json", run_json.replace("\"wireframe_blake3\": null", "\"wireframe_blake3\": \"0a1b\""));
    let other = "R holds a run with another wireframe (previously a file, now Candide-3)";
    work.grimace("recognize --with R R/tracks/S001_005.csv").exit(1).says(&[other]);
    work.write("R/run.json", run_json);
    // The input of the recognition is unchanged.
    work.write("faces/manifest.csv", &before["manifest.csv"]);
    crate::common::assert_same_files(&before, &work.files("faces"));
}

#[test]
fn inputs_without_motion_are_refused() {
    let work = Work::after_run(&SEQUENCES, "R");
    let portrait = root().join("fixtures/portraits/P01.jpg");
    let said = "P01.jpg: recognition needs the motion from a neutral frame to the expression, so a single picture is not enough";
    work.grimace(&format!("recognize --with R {}", portrait.display())).exit(1).says(&[said]);
    work.write("one/a_1.jpg", std::fs::read(&portrait).unwrap());
    work.grimace("recognize --with R one").exit(1).says(&["failed: ", "_one at ", "at least 2 are needed"]);
    std::fs::create_dir(work.path("empty")).unwrap();
    work.grimace("recognize --with R empty")
        .exit(1)
        .says(&["empty: this is neither a track (.csv), nor the frames of a sequence, nor a dataset: "]);
    work.grimace("recognize --with R none").exit(1).says(&["none: "]);
    work.grimace("recognize --with R faces/S001/005 -o faces/S001/005/correspondences.csv --force")
        .exit(1)
        .says(&["would overwrite"]);
    // It also protects the files that a manifest names, and the results that it learns from.
    work.grimace("recognize --with R faces/manifest.csv -o faces/S001/005/correspondences.csv --force")
        .exit(1)
        .says(&["would overwrite a file that this command did not write"]);
    work.grimace("recognize --with R R/tracks/S001_005.csv -o R/run.json --force")
        .exit(1)
        .says(&["would overwrite a file that this command did not write"]);
    // If nothing can be learned, the command says so before it tracks anything.
    work.write("few/S001_005.csv", work.bytes("R/tracks/S001_005.csv"));
    work.write("few/S001_005.json", work.bytes("R/tracks/S001_005.json"));
    let ran = work.grimace("recognize --with few faces").exit(1).says(&["cannot learn from few"]);
    assert!(!ran.stderr.contains("few has no run.json"), "{}", ran.stderr);
}

#[test]
fn good_inputs_are_recognized_beside_bad_ones() {
    let work = Work::after_run(&SEQUENCES, "R");
    // A recording that is too short, in two datasets.
    let rows = "subject,sequence,emotion,frames,segment\nS009,talk,unlabelled,../faces/S001/005,auto\n";
    work.write("a/manifest.csv", rows).write("b/manifest.csv", rows);
    let ran = work.grimace("recognize --with R R a a b -o all.csv").exit(3).prints(&["6 sequences recognized"]);
    ran.says(&[
        "too short for a rest and an expression: 6 frames; at least 25 are needed",
        "S009_talk is given twice, also in a/",
    ]);
    assert_eq!(work.rows("all.csv").iter().map(|row| row["id"].clone()).collect::<Vec<_>>(), SEQUENCES);
}
