//! `grimace recognize` of pictures: they are tracked as the run was that is learned from.

use crate::common::{SEQUENCES, Work, root};

#[test]
fn pictures_are_recognized_as_their_tracks_are() {
    let work = Work::after_run(&SEQUENCES, "R");
    work.grimace("recognize --with R R/tracks/S001_005.csv R/tracks/S001_007.csv -o tracks.csv -q").exit(0);
    let before = work.files("faces");
    // A dataset without a word of emotions, of which one sequence has nothing to track.
    work.write("faces/manifest.csv", "subject,sequence\nS001,005\nS001,007\nS009,001\n");
    let ran = work.grimace("recognize --with R faces -o unlabelled.csv -j 1").exit(3);
    let ran = ran.prints(&["2 sequences recognized"]).says(&["failed: S009_001 at dataset: "]);
    assert!(ran.stderr.contains("2 of the sequences are of people that were learned from"), "{}", ran.stderr);
    let unlabelled = work.read("tracks.csv").replace("005,happiness,", "005,,").replace("007,surprise,", "007,,");
    assert_eq!(work.read("unlabelled.csv"), unlabelled);
    // With emotions they are in the table; a folder of frames is a sequence of its own.
    work.write("faces/manifest.csv", "subject,sequence,emotion\nS001,005,Happiness\nS001,007,?\n");
    work.grimace("recognize --with R faces -o labelled.csv -j 3").exit(0);
    let rows = |name: &str| work.rows(name).iter().map(|row| row["emotion"].clone()).collect::<Vec<_>>();
    assert_eq!(rows("labelled.csv"), ["happiness", ""]);
    let printed = work.grimace("recognize --with R faces/S001/005").exit(0).stdout;
    assert_eq!(printed.lines().collect::<Vec<_>>(), unlabelled.lines().take(2).collect::<Vec<_>>());
    // What is recognized is left as it was.
    work.write("faces/manifest.csv", &before["manifest.csv"]);
    crate::common::assert_same_files(&before, &work.files("faces"));
}

#[test]
fn what_shows_no_motion_is_refused() {
    let work = Work::after_run(&SEQUENCES, "R");
    let portrait = root().join("fixtures/portraits/P01.jpg");
    let said = "P01.jpg: a single picture shows no motion, and an expression is recognized by how the face moves from neutral to it: two frames";
    work.grimace(&format!("recognize --with R {}", portrait.display())).exit(1).says(&[said]);
    work.write("one/a.jpg", std::fs::read(&portrait).unwrap());
    work.grimace("recognize --with R one").exit(1).says(&["one"]).says(&["failed: "]);
    std::fs::create_dir(work.path("empty")).unwrap();
    work.grimace("recognize --with R empty")
        .exit(1)
        .says(&["empty: neither tracks (.csv), nor the frames of a sequence, nor a dataset: "]);
    work.grimace("recognize --with R none").exit(1).says(&["none: "]);
    work.grimace("recognize --with R faces/S001/005 -o faces/S001/005/correspondences.csv --force")
        .exit(1)
        .says(&["would be written over"]);
}
