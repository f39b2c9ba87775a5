//! Commands whose files would overwrite each other or their input are refused, and nothing is written.

use crate::common::{Work, root};

/// Makes a folder with a portrait, its marks and a FAP file.
fn portrait() -> Work {
    let work = Work::new();
    let fixture = |name: &str| std::fs::read(root().join("fixtures").join(name)).unwrap();
    work.write("P01.jpg", fixture("portraits/P01.jpg")).write("marks.csv", fixture("portraits/P01_correspondences.csv"));
    work.write("smile.fap", fixture("golden/fap/happiness.fap"));
    work
}

#[test]
fn two_outputs_with_the_same_name_are_refused() {
    let work = portrait();
    let both = |first: &str, second: &str| format!("{first} and {second} name the same file");
    let fit = "fit P01.jpg -c marks.csv";
    work.grimace(&format!("{fit} -o f.png --overlay ./f.png")).exit(1).says(&[&both("--output", "--overlay")]);
    for picture in ["ov.jpg", "ov.gif", "f.csv"] {
        let said = format!("--overlay {picture}: the picture must be a .png file; name one, or a folder");
        work.grimace(&format!("{fit} -o f.csv --overlay {picture}")).exit(1).says(&[&said]);
    }
    let mix = "bank mix candide --performance 20";
    work.grimace(&format!("{mix} --members 8 -o a.bank --unseen a.bank")).exit(1).says(&[&both("--output", "--unseen")]);
    work.grimace(&format!("{mix} -o b.bank --save-weights ./b.bank")).exit(1).says(&[&both("--output", "--save-weights")]);
    work.grimace("bank info candide --picture bank.jpg").exit(1).says(&["--picture bank.jpg: the picture must be a .png file"]);
    assert_eq!(work.files(".").keys().collect::<Vec<_>>(), ["P01.jpg", "marks.csv", "smile.fap"]);
}

#[test]
fn force_does_not_overwrite_the_inputs_of_a_command() {
    let work = portrait();
    let before = work.files(".");
    let over = |what: &str| format!("would overwrite {what}; give it another name");
    work.grimace("fit P01.jpg -c marks.csv -o marks.csv --force").exit(1).says(&["--output", &over("--correspondences")]);
    work.grimace("play smile.fap -o smile.fap --force").exit(1).says(&["--output", &over("a motion")]);
    work.grimace("play smile.fap --portrait P01.jpg -o ./P01.jpg --force").exit(1).says(&["--output", &over("--portrait")]);
    work.grimace("locate P01.jpg -o P01.jpg --force").exit(1).says(&["--output", &over("the picture")]);
    crate::common::assert_same_files(&before, &work.files("."));
    work.grimace("clone -s smile.fap -t P01.jpg -c marks.csv -o clone -q").exit(0);
    let before = work.files(".");
    let again = "-t P01.jpg -c marks.csv -o clone --force";
    work.grimace(&format!("clone -s clone/clone.fap {again}")).exit(1).says(&["clone.fap", &over("--source")]);
    let track = before.keys().find(|name| name.starts_with("clone/track/") && name.ends_with(".csv")).unwrap();
    work.grimace(&format!("clone -s {track} {again}")).exit(1).says(&["would replace this folder, but --source lies in it"]);
    work.grimace("features clone/track -o clone/track --force").exit(1).says(&[&over("the track")]);
    crate::common::assert_same_files(&before, &work.files("."));
}

#[test]
fn a_track_overwrites_no_frame_and_overlays_stay_out_of_frame_folders() {
    let work = Work::new();
    let portrait = std::fs::read(root().join("fixtures/portraits/P01.jpg")).unwrap();
    for number in 1..=3 {
        work.write(&format!("faces/S1/001/S1_001_{number:08}.jpg"), portrait.clone());
    }
    work.write("faces/manifest.csv", "subject,sequence,emotion\nS1,001,happiness\n");
    let before = work.files(".");
    let frames = "faces/S1/001";
    for frame in [1, 3] {
        // A frame that the options exclude is still protected.
        work.grimace(&format!("track {frames} --last-frame 2 -o {frames}/S1_001_0000000{frame}.jpg --force"))
            .exit(1)
            .says(&["--output would overwrite a frame of the sequence"]);
    }
    work.grimace(&format!("track {frames} -o t.csv --overlay {frames}"))
        .exit(1)
        .says(&["among the frames of this folder", "give another folder"]);
    crate::common::assert_same_files(&before, &work.files("."));
    work.grimace(&format!("run faces -o results --overlay {frames}"))
        .exit(1)
        .says(&["among the frames of S1_001", "give another folder"]);
    assert!(work.files(frames).len() == 3, "nothing is written among the frames");
}
