//! `grimace run` on datasets of every form, valid and invalid: which are read, which are refused, and with what message.

use crate::common::{FACES, Work, assert_same_files, root};
use grimace::internal::wireframe::{LandmarkRow, Tables};

/// A manifest of the sequences S001_005 and S002_005 with default paths.
const PLAIN: &str = "subject,sequence,emotion\nS001,005,happiness\nS002,005,happiness\n";

/// Makes a dataset of two sequences with this manifest.
fn with_manifest(manifest: impl AsRef<[u8]>) -> Work {
    let work = Work::with_sequences(&["S001_005", "S002_005"]);
    work.write("faces/manifest.csv", manifest);
    work
}

#[test]
fn a_manifest_is_read_as_spreadsheets_write_it() {
    let plain = with_manifest(PLAIN);
    plain.grimace("run faces -o out").exit(0);
    let crlf = format!("\u{feff}{}\r\n,,\r\n", PLAIN.replace('\n', "\r\n"));
    let quoted = "\"sequence\",\"subject\",\"emotion\"\n\"005\",\"S001\",\" Happiness \"\n005,S002,HAPPINESS\n\n";
    let semicolons = crlf.replace(',', ";");
    for manifest in [crlf.as_str(), quoted, &semicolons] {
        let work = with_manifest(manifest);
        work.grimace("run faces -o out").exit(0).prints(&["2 sequences: 2 tracked"]);
        assert_same_files(&plain.files("out"), &work.files("out"));
        // The manifest file itself may be given.
        work.grimace("run faces/manifest.csv -o out").exit(0).prints(&["nothing changed"]);
    }
}

#[test]
fn a_row_may_span_lines_and_a_bad_row_keeps_its_name() {
    let manifest = "subject,sequence,emotion,note\nS001,005,happiness,\"a\n\nb\"\nS002,005,happiness\n";
    let work = with_manifest(manifest);
    work.grimace("run faces -o out").exit(3).prints(&["2 sequences: 1 tracked, 0 unchanged, 1 failed"]);
    let failures = work.rows("out/failures.csv");
    assert_eq!((failures.len(), failures[0]["id"].as_str()), (1, "S002_005"));
    assert!(failures[0]["reason"].ends_with("line 5: the row has 3 fields, but the header has 4"), "{failures:?}");
    assert!(work.read("out/tracks/S001_005.json").contains("\"note\": \"a b\""));
}

#[test]
#[cfg(target_os = "linux")]
fn names_match_however_their_accents_are_encoded() {
    // Folders named as macOS does, with the accent after its letter, and a table with composed letters.
    let work = Work::new();
    for ((name, bytes), at) in FACES.iter().flat_map(|file| ["S001", "S002"].map(|at| (file, at))) {
        if let Some(rest) = name.strip_prefix(&format!("{at}/005/")) {
            work.write(&format!("faces/{}/fe\u{302}te/{rest}", ["Andre\u{301}", "Zoe\u{308}"][usize::from(at == "S002")]), bytes);
        }
    }
    let table = "subject,sequence,emotion,correspondences\nAndr\u{e9},f\u{ea}te,happiness,\n\
                 Zo\u{eb},f\u{ea}te,happiness,Zo\u{eb}/f\u{ea}te/correspondences.csv\n";
    work.write("faces/manifest.csv", table);
    work.grimace("run faces -o out").exit(0).prints(&["2 sequences: 2 tracked"]);
    assert!(work.path("out/tracks/Andr\u{e9}_f\u{ea}te.csv").exists());
    std::fs::remove_file(work.path("faces/manifest.csv")).unwrap();
    work.write("people.csv", "subject,sex,emotion\nAndr\u{e9},m,\nZo\u{eb},f,\n");
    let ran = work.grimace("init faces --people people.csv").exit(0);
    let ran = ran.prints(&["note: columns not taken from people.csv: `emotion`, which the manifest sets for each sequence"]);
    assert!(!ran.stdout.contains("not in the table of people"), "{}", ran.stdout);
    let rows = work.rows("faces/manifest.csv");
    assert_eq!((rows[0]["subject"].as_str(), rows[0]["sequence"].as_str()), ("Andr\u{e9}", "f\u{ea}te"));
    assert_eq!([&rows[0]["sex"], &rows[1]["sex"]], ["m", "f"]);
    work.replace("faces/manifest.csv", ",?,", ",happiness,");
    work.grimace("run faces -o from_init").exit(0).prints(&["2 sequences: 2 tracked"]);
}

#[test]
#[cfg(unix)]
fn a_dangling_link_is_reported() {
    let work = with_manifest(PLAIN);
    std::os::unix::fs::symlink(work.path("nowhere"), work.path("link")).unwrap();
    work.grimace("run faces -o link").exit(1).says(&["cannot write link: it is a link to a folder that does not exist"]);
    work.grimace("annotate faces/none.gif").exit(1);
    work.write("a.gif", "GIF89a\u{1}");
    work.grimace("annotate a.gif").exit(1).says(&["a.gif: is a GIF picture"]);
}

#[test]
fn an_empty_dataset_has_no_plan() {
    // A folder, no file, no table, a table without rows, and a table without any usable row: the first by id is reported.
    let of = |manifest: &str| with_manifest(manifest);
    let (none, folder) = (of(PLAIN), of(PLAIN));
    for work in [&none, &folder] {
        std::fs::remove_file(work.path("faces/manifest.csv")).unwrap();
    }
    std::fs::create_dir(folder.path("faces/manifest.csv")).unwrap();
    let damaged = of("subject,sequence,emotion,fps\nS002,005,happiness\nS001,005,happiness,fast\n");
    for (work, texts) in [
        (none, ["faces", "manifest.csv"]),
        (folder, ["manifest.csv", "it is a folder"]),
        (of("no table"), ["manifest.csv", "has no column"]),
        (of("subject,sequence,emotion\n"), ["manifest.csv", "lists no sequence"]),
        (damaged, ["none of the 2 sequences could be processed", "line 3: fps is `fast`"]),
    ] {
        let error = |ran: crate::common::Ran| ran.stderr.lines().find(|line| line.starts_with("error")).unwrap().to_owned();
        let planned = error(work.grimace("run faces -o plan --plan").exit(1).says(&texts));
        assert!(work.files("plan").is_empty(), "{planned}");
        assert_eq!(planned, error(work.grimace("run faces -o out").exit(1)));
    }
}

#[test]
fn accents_of_either_encoding_are_one_label() {
    let rows = "S001,005,de\u{301}gou\u{302}t,cafe\u{301}\nS002,005,d\u{e9}go\u{fb}t,caf\u{e9}\n";
    let work = with_manifest(format!("subject,sequence,emotion,place\n{rows}"));
    work.grimace("run faces -o plan --plan").exit(0).prints(&["{\"sequences\":2,\"emotions\":[[\"d\u{e9}go\u{fb}t\",2]]}"]);
    work.grimace("run faces -o out --by place").exit(0);
    assert_eq!(work.read("out/statistics.csv").lines().count(), 3, "the class of all people, and one group");
}

#[test]
fn an_invalid_manifest_is_refused_as_a_whole() {
    let refused = |manifest: &[u8], texts: &[&str]| {
        let work = with_manifest(manifest);
        work.grimace("run faces -o out").exit(1).says(&["manifest.csv"]).says(texts);
        assert!(work.files("out").is_empty());
    };
    refused(
        b"subject,sequence,emoton\nS001,005,happiness\n",
        &["has no column `emotion`", "found `subject`, `sequence`, `emoton`"],
    );
    // If this counted as a column to group by, marks would be reported missing for each sequence instead.
    refused(
        b"subject,sequence,emotion,correspondence\nS001,005,happiness,a.csv\n",
        &["the column `correspondence` is unknown; if it is the column `correspondences`, rename it to that"],
    );
    refused(
        b"subject,sequence,emotion,First frame\nS001,005,happiness,1\n",
        &["if it is the column `first_frame`, rename it to that"],
    );
    // Consent, and other columns that would be ignored silently.
    refused(
        b"subject,sequence,emotion,publsh\nS001,005,happiness,no\n",
        &["the column `publsh`", "if it is the column `publish`, rename it to that"],
    );
    refused(
        b"subject,sequence,emotion,FPS\nS001,005,happiness,50\n",
        &["the column `FPS`", "if it is the column `fps`, rename it to that"],
    );
    refused(
        b"subject,sequence,emotion,Segment\nS001,005,happiness,auto\n",
        &["if it is the column `segment`, rename it to that"],
    );
    refused(b"sequence\n005\n", &["has no column `subject`, `emotion`"]);
    refused(b"subject;sequence;emoton\nS001;005;happiness\n", &["found `subject`, `sequence`, `emoton`"]);
    refused(b"subject\tsequence\temotion\nS001\t005\thappiness\n", &["columns are separated by commas"]);
    refused(b"", &["is empty; a header line was expected"]);
    refused(b"subject,sequence,emotion\n", &["the manifest lists no sequence"]);
    refused(b"subject,sequence,emotion,emotion\n", &["has the column `emotion` twice"]);
    refused(b"sub\xFFject,sequence,emotion\n", &["line 1", "not UTF-8"]);
}

#[test]
fn a_bad_row_fails_its_sequence_with_its_line() {
    let rows: [(&[u8], &[&str]); 9] = [
        (b"S001,005,joy", &["line 4", "subject `S001`, sequence `005` is already in line 2"]),
        (b"S009,005,", &["line 4", "emotion is empty"]),
        (b"S009,005", &["line 4", "the row has 2 fields, but the header has 3"]),
        (b"S009,\"005,joy", &["line 4", "a quotation mark is not closed"]),
        (
            b"Zo\xE9,005,joy",
            &["line 4", "not UTF-8; the file looks like Windows-1252 (Latin-1)", "iconv -f WINDOWS-1252 -t UTF-8"],
        ),
        (b"../S009,005,joy", &["line 4", "subject is `../S009`", "path separator"]),
        (b"S009,005,joy", &["S009_005", "there is no such folder of frames or video file"]),
        (b"S009,a/b,joy", &["line 4", "sequence is `a/b`"]),
        (b"S009,005,a\\b", &["line 4", "emotion is `a\\b`"]),
    ];
    for (row, texts) in rows {
        let work = with_manifest([PLAIN.as_bytes(), row, b"\n"].concat());
        let ran = work.grimace("run faces -o out --no-faces").exit(3).prints(&["3 sequences: 2 tracked, 0 unchanged, 1 failed"]);
        ran.says(texts);
        let failures = work.rows("out/failures.csv");
        assert_eq!((failures.len(), failures[0]["stage"].as_str()), (1, "dataset"));
        assert_eq!(work.rows("out/statistics.csv")[0]["sequences"], "2");
    }
}

#[test]
fn values_of_optional_columns_are_checked() {
    let header = "subject,sequence,emotion,first_frame,last_frame,fps,correspondences";
    for (row, texts) in [
        ("5,5,,", &["line 3", "first_frame is 5 and last_frame is 5; neutral and apex frame must differ"] as &[&str]),
        ("one,,,", &["line 3", "first_frame is `one`; a whole number of 0 or more was expected"]),
        (",99,,", &["last_frame is 99, but the folder has no such frame; it has 6 frames from 1 to 6"]),
        (",,-25,", &["line 3", "fps is `-25`; a number of frames per second from 0.1 to 1000 was expected"]),
        (",,25000,", &["fps is `25000`"]),
        (",,0.04,", &["fps is `0.04`; a number of frames per second from 0.1 to 1000 was expected"]),
        (",,NaN,", &["line 3", "fps is `NaN`"]),
        (",,,none.csv", &["S002_005: the correspondence file faces/none.csv is not there"]),
    ] {
        let work = with_manifest(format!("{header}\nS001,005,happiness,,,,\nS002,005,happiness,{row}\n"));
        work.grimace("run faces -o out").exit(3).says(texts);
    }
    let work = with_manifest(format!("{header}\nS001,005,happiness,2,5,,\n"));
    work.grimace("run faces -o out").exit(0);
    let rows = work.rows("out/tracks/S001_005.csv");
    assert_eq!((rows[0]["frame"].as_str(), rows.len()), ("2", 4 * 113));
}

#[test]
fn an_invalid_dataset_is_refused() {
    let work = Work::with_sequences(&["S001_005"]);
    work.grimace("run nowhere -o out").exit(1).says(&["nowhere: there is no such dataset; give a folder with manifest.csv"]);
    std::fs::remove_file(work.path("faces/manifest.csv")).unwrap();
    let ran = work.grimace("run faces -o out").exit(1);
    ran.says(&["faces: the emotions are unknown; run `grimace init faces`, which writes manifest.csv", "S001,005,happiness"]);
    std::fs::create_dir(work.path("empty")).unwrap();
    work.grimace("run empty -o out").exit(1).says(&["empty: no sequences found", "Cohn-Kanade"]);
    assert!(work.files("out").is_empty());
}

#[test]
fn a_sequence_without_marks_is_reported_with_the_place_for_them() {
    let work = with_manifest(PLAIN);
    std::fs::remove_file(work.path("faces/S002/005/correspondences.csv")).unwrap();
    let ran = work.grimace("run faces -o out --marks default").exit(3);
    ran.says(&["S002_005: no correspondences and no landmarks; mark 5 to 8 points", "faces/S002/005/correspondences.csv"]);
}

#[test]
fn a_sequence_of_one_frame_is_refused() {
    let work = with_manifest(PLAIN);
    for number in 2..=6 {
        std::fs::remove_file(work.path(&format!("faces/S002/005/S002_005_{number:08}.png"))).unwrap();
    }
    let ran = work.grimace("run faces -o out").exit(3);
    ran.says(&["faces/S002/005: 1 frame from neutral to apex; at least 2 are needed"]);
}

#[test]
fn a_reversed_sequence_has_the_verdict_look_again() {
    let work = Work::new();
    let is_frame = |name: &str| name.starts_with("S001/005/") && name.ends_with(".png");
    let frames: Vec<_> = FACES.iter().filter(|(name, _)| is_frame(name)).collect();
    for (name, bytes) in &frames {
        work.write(&format!("faces/{name}"), bytes);
    }
    let verdict = |(neutral, apex): (usize, usize), out: &str| {
        let row = format!("S001,005,happiness,{neutral},{apex}\n");
        work.write("faces/manifest.csv", format!("subject,sequence,emotion,first_frame,last_frame\n{row}"));
        work.grimace(&format!("run faces -o {out}")).exit(0);
        work.rows(&format!("{out}/verdicts.csv"))[0]["reasons"].clone()
    };
    let said = "the sequence seems to go from an expression back to neutral";
    assert!(!verdict((1, frames.len()), "there").contains(said));
    let back = verdict((frames.len(), 1), "back");
    assert!(
        back.contains(said) && back.contains("if frame 1 is neutral, set it as first_frame and frame 6 as last_frame"),
        "{back}"
    );
}

/// Returns the 68 landmarks of the neutral frame of a sequence from its true nodes; landmarks without a node are arbitrary.
fn landmarks(id: &str) -> Vec<(f64, f64)> {
    let truth = csv::Reader::from_reader(FACES[&format!("truth/{id}.csv")].as_slice())
        .deserialize::<(u32, usize, f64, f64)>()
        .map(Result::unwrap)
        .filter(|row| row.0 == 1)
        .map(|row| (row.2, row.3))
        .collect::<Vec<_>>();
    let place = |row: &LandmarkRow| {
        let sum = |axis: fn(&(f64, f64)) -> f64| row.nodes.iter().map(|(n, w)| w * axis(&truth[n.index()])).sum::<f64>();
        if row.nodes.is_empty() { (1.0, 1.0) } else { (sum(|p| p.0), sum(|p| p.1)) }
    };
    Tables::candide3().landmarks.iter().map(place).collect()
}

#[test]
fn the_report_shows_images_beside_landmarks_that_drive_a_sequence() {
    let work = Work::with_sequences(&["S001_005"]);
    let points = landmarks("S001_005");
    let names: Vec<String> = (0..68).map(|k| format!("x{k},y{k}")).collect();
    // The lips are the points 48 to 67.
    let row = |frame: u32, wider: f64| {
        let x = |k: usize, x: f64| {
            if k == 48 {
                x - wider
            } else if k == 54 {
                x + wider
            } else {
                x
            }
        };
        let fields: Vec<String> = points.iter().enumerate().map(|(k, p)| format!("{},{}", x(k, p.0), p.1)).collect();
        format!("{frame},{}\n", fields.join(","))
    };
    work.write("faces/points.csv", format!("frame,{}\n{}{}", names.join(","), row(1, 0.0), row(6, 4.0)));
    let manifest = |publish: &str| {
        let row = format!("S001,005,happiness,S001/005,points.csv,{publish}\n");
        work.write("faces/manifest.csv", format!("subject,sequence,emotion,frames,landmarks,publish\n{row}"));
    };
    let run = |out: &str| work.grimace(&format!("run faces -o {out} --prefer-landmarks --resample linear")).exit(0);
    let pictures = |out: &str| work.read(&format!("{out}/report.html")).matches("\"/9j/").count();
    manifest("no");
    run("hidden");
    manifest("");
    run("out").prints(&["1 sequence: 1 tracked"]);
    assert_eq!(pictures("out"), pictures("hidden") + 2);
    run("out").prints(&["nothing changed"]);
    // Another picture is another report; one that does not read costs the pictures alone.
    let frame = |number: u32| format!("faces/S001/005/S001_005_{number:08}.png");
    work.write(&frame(6), work.bytes(&frame(5)));
    run("out").prints(&["1 sequence: 1 tracked"]);
    work.write(&frame(6), "no picture");
    run("out").prints(&["1 sequence: 1 tracked"]);
    assert_eq!(pictures("out"), pictures("hidden"));
}

/// Makes a dataset in the layout of CK+: three labelled sequences and one without a label.
fn cohn_kanade() -> Work {
    let work = Work::new();
    for (id, code) in [("S001_005", Some(5)), ("S002_005", Some(5)), ("S003_007", Some(7)), ("S003_005", None)] {
        let folder = id.replace('_', "/");
        for number in 1..=6 {
            let name = format!("{folder}/{id}_{number:08}.png");
            work.write(&format!("ck/cohn-kanade-images/{name}"), &FACES[&name]);
        }
        if let Some(code) = code {
            work.write(&format!("ck/Emotion/{folder}/{id}_00000006_emotion.txt"), format!("   {code}.0000000e+00\n"));
        }
        let lines: String = landmarks(id).iter().map(|(x, y)| format!("   {x:.7e}   {y:.7e}\n")).collect();
        work.write(&format!("ck/Landmarks/{folder}/{id}_00000001_landmarks.txt"), lines);
    }
    work
}

#[test]
fn the_layout_of_cohn_kanade_is_read_as_it_is() {
    let work = cohn_kanade();
    let ran = work.grimace("run ck -o out").exit(0);
    ran.prints(&["3 sequences: 3 tracked, 0 unchanged, 0 failed", "1 sequence left out: no emotion label"]);
    let statistics = work.rows("out/statistics.csv");
    let rows: Vec<_> = statistics.iter().map(|r| (r["emotion"].as_str(), r["sequences"].as_str())).collect();
    assert_eq!(rows, [("happiness", "2"), ("surprise", "1")]);
    let info: serde_json::Value = serde_json::from_str(&work.read("out/tracks/S001_005.json")).unwrap();
    assert_eq!((&info["marks_from"], info["marks"].as_array().unwrap().len()), (&"landmarks".into(), 52));
    work.grimace("run ck/cohn-kanade-images -o other").exit(0).prints(&["3 tracked"]);
    assert_same_files(&work.files("out/models"), &work.files("other/models"));
    work.grimace("run ck -o few --marks default").exit(0);
    let info: serde_json::Value = serde_json::from_str(&work.read("few/tracks/S001_005.json")).unwrap();
    assert_eq!(info["marks"].as_array().unwrap().len(), 11);
}

#[test]
fn bad_labels_and_landmarks_fail_their_sequence() {
    let work = cohn_kanade();
    let landmark_file = "ck/Landmarks/S002/005/S002_005_00000001_landmarks.txt";
    let whole = work.read(landmark_file);
    let refused = |texts: &[&str]| {
        work.grimace("run ck -o out --force").exit(3).says(texts);
        assert_eq!(work.rows("out/failures.csv").len(), 1);
    };
    work.write(landmark_file, whole.lines().take(67).collect::<Vec<_>>().join("\n"));
    refused(&["S002_005_00000001_landmarks.txt: 67 points, 68 were expected"]);
    work.write(landmark_file, whole.replacen('e', "x", 1));
    refused(&["S002_005_00000001_landmarks.txt, line 1: found `", "two finite numbers `x y` were expected"]);
    std::fs::rename(work.path(landmark_file), work.path(&landmark_file.replace("00000001", "00000006"))).unwrap();
    refused(&["S002/005"]);
    work.write(landmark_file, &whole);
    std::fs::remove_file(work.path(&landmark_file.replace("00000001", "00000006"))).unwrap();
    work.write("ck/Emotion/S002/005/S002_005_00000006_emotion.txt", "nine");
    refused(&["S002_005_00000006_emotion.txt: found `nine`; an emotion code was expected: 0 neutral, 1 anger"]);
}

#[test]
fn landmarks_of_a_manifest_serve_as_marks() {
    let work = with_manifest("subject,sequence,emotion,landmarks\nS001,005,happiness,landmarks68.csv\nS002,005,happiness,\n");
    let header: String = (0..68).map(|k| format!(",x{k},y{k}")).collect();
    let points: String = landmarks("S001_005").iter().map(|(x, y)| format!(",{x},{y}")).collect();
    std::fs::remove_file(work.path("faces/S001/005/correspondences.csv")).unwrap();
    work.write("faces/S001/005/landmarks68.csv", format!("frame{header}\n1{points}\n"));
    work.grimace("run faces -o out").exit(0);
    let shorter = format!("frame{}\n1{}\n", header.replace(",x67,y67", ""), points.rsplitn(3, ',').last().unwrap());
    work.write("faces/S001/005/landmarks68.csv", shorter);
    work.grimace("run faces -o out").exit(3).says(&["landmarks68.csv: 67 points, 68 were expected"]);
    work.write("faces/S001/005/landmarks68.csv", format!("frame{header}\n2{points}\n"));
    work.grimace("run faces -o out")
        .exit(3)
        .says(&["S001_005", "landmarks68.csv: frame 1 has no landmarks; 1 frames from 2 to 2 have them"]);
}

#[test]
#[cfg(unix)]
fn a_frame_that_cannot_be_read_fails_alike_in_every_run() {
    let work = with_manifest(PLAIN);
    let frame = work.path("faces/S001/005/S001_005_00000004.png");
    let bytes = std::fs::read(&frame).unwrap();
    std::fs::remove_file(&frame).unwrap();
    std::os::unix::fs::symlink("/no/such/picture.png", &frame).unwrap();
    work.grimace("run faces -o out").exit(3);
    let first = work.read("out/failures.csv");
    assert!(first.contains("S001,005,track,") && first.contains("S001_005_00000004.png: cannot be read"), "{first}");
    work.grimace("run faces -o out").exit(3).prints(&["2 sequences: 0 tracked, 1 unchanged, 1 failed"]);
    assert_eq!(work.read("out/failures.csv"), first);
    // The same if the frame existed once and its track exists.
    std::fs::remove_file(&frame).unwrap();
    std::fs::write(&frame, bytes).unwrap();
    work.grimace("run faces -o out").exit(0);
    std::fs::remove_file(&frame).unwrap();
    std::os::unix::fs::symlink("/no/such/picture.png", &frame).unwrap();
    work.grimace("run faces -o out").exit(3);
    assert_eq!(work.read("out/failures.csv"), first);
}

/// Photographs of two people in folders by expression, with marks where they are expected.
fn photographs() -> Work {
    let work = Work::with_sequences(&["S001_005", "S002_005"]);
    for id in ["S001", "S002"] {
        let frame = |number: u32| work.bytes(&format!("faces/{id}/005/{id}_005_{number:08}.png"));
        work.write(&format!("photos/neutral/{id}.png"), frame(1)).write(&format!("photos/smiling/{id}.png"), frame(6));
        let marks = work.read(&format!("faces/{id}/005/correspondences.csv"));
        work.write(&format!("photos/{id}/smiling/correspondences.csv"), marks);
    }
    work
}

#[test]
fn two_photographs_are_told_when_the_apex_comes_first() {
    let fixture = |path: &str| std::fs::read(root().join("fixtures").join(path)).unwrap();
    let work = Work::new();
    work.write("P01.jpg", fixture("portraits/P01.jpg")).write("marks.csv", fixture("portraits/P01_correspondences.csv"));
    work.write("surprise.csv", fixture("golden/representatives/surprise.csv"));
    work.grimace("clone -s surprise.csv -t P01.jpg -c marks.csv -o clone -q --ease linear --fps 5 --duration 1").exit(0);
    let [neutral, apex] = [1, 6].map(|number| format!("clone/frames/P01_{number:08}.png"));
    let rows = format!("P01,forth,surprise,{neutral};{apex}\nP01,back,surprise,{apex};{neutral}\n");
    work.write("manifest.csv", format!("subject,sequence,emotion,frames\n{rows}"));
    let back =
        "back to neutral: the mouth of frame 1 looks further from a neutral one than that of frame 2; if frame 2 is neutral";
    let checked = work.grimace("check .").exit(3).prints(&[back]);
    assert_eq!(checked.stdout.matches("back to neutral").count(), 1, "{}", checked.stdout);
    work.grimace("run . -o out --resample linear").exit(0);
    let verdicts = work.read("out/verdicts.csv");
    let of = |id: &str| verdicts.lines().find(|line| line.starts_with(&format!("P01,{id}"))).unwrap();
    assert_eq!(of("back").matches("back to neutral").count(), 1, "{verdicts}");
    assert!(of("back").contains(back) && !of("forth").contains("back to neutral"), "{verdicts}");
    assert!(work.read("out/tracks/P01_forth.csv").contains("recovered_jump"));
    let info = work.read("out/tracks/P01_back.json");
    // The finding stays when the tracks are analysed without the pictures.
    assert!(info.contains("\"mouth_back\"") && !work.read("out/tracks/P01_forth.json").contains("\"mouth_back\""));
    work.grimace("analyze out/tracks -o again --resample linear").exit(0);
    assert!(work.read("again/verdicts.csv").contains(back));
    // Without the locator nothing is said of the mouth.
    work.grimace("run . -o plain --resample linear --locate-lost off --read-lips off").exit(0);
    assert!(!work.read("plain/verdicts.csv").contains("the mouth of frame"));
}

#[test]
fn a_neutral_photograph_and_one_of_an_expression_are_a_sequence() {
    let work = photographs();
    work.write("photos/neutral/S003.png", "");
    let init = work.grimace("init photos").exit(0);
    init.prints(&[
        "manifest.csv: 2 sequences",
        "note: in no pair: neutral/S003.png (the only picture of S003)",
        "grimace run photos -o results --resample linear",
    ]);
    let manifest = "subject,sequence,emotion,frames\n\
                    S001,smiling,happiness,neutral/S001.png;smiling/S001.png\n\
                    S002,smiling,happiness,neutral/S002.png;smiling/S002.png\n";
    assert_eq!(work.read("photos/manifest.csv"), manifest);
    let checked = work.grimace("check photos").exit(0);
    let checked = checked.prints(&["next: grimace run photos -o results --resample linear"]);
    checked.prints(&["there are only two pictures, 1 and 2, and they may lie far apart", "(--prefer-landmarks)"]);
    assert!(!work.grimace("check photos --resample nearest").exit(0).stdout.contains("nearest --resample linear"));
    let run = work.grimace("run photos -o out --resample linear --overlay drawn").exit(0);
    run.prints(&["2 sequences: 2 tracked"]);
    assert!(work.path("drawn/S001_smiling_00000002_overlay.png").exists());
    let info: serde_json::Value = serde_json::from_str(&work.read("out/tracks/S001_smiling.json")).unwrap();
    assert_eq!(info["source"], serde_json::json!(["neutral/S001.png", "smiling/S001.png"]));
    work.grimace("run photos -o out --resample linear").exit(0).prints(&["nothing changed"]);
    // The same sequence in a folder of its own.
    let folder = |number: u32| format!("faces/S001/two/{number}.png");
    work.write(&folder(1), work.bytes("photos/neutral/S001.png")).write(&folder(2), work.bytes("photos/smiling/S001.png"));
    let marks = "faces/S001/005/correspondences.csv";
    work.grimace(&format!("track faces/S001/two -c {marks} -o folder.csv")).exit(0);
    work.shell(&format!("$GRIMACE track 'photos/neutral/S001.png; photos/smiling/S001.png' -c {marks} -o list.csv")).exit(0);
    assert_eq!(work.read("folder.csv"), work.read("list.csv"));
    assert_eq!(work.read("folder.csv"), work.read("out/tracks/S001_smiling.csv"));
    // Another order is another sequence, and so are other numbers.
    work.replace("photos/manifest.csv", "neutral/S002.png;smiling/S002.png", "\"smiling/S002.png ; neutral/S002.png\"");
    work.grimace("run photos -o out --resample linear").exit(0).prints(&["2 sequences: 1 tracked, 1 unchanged"]);
    // Overlay pictures are kept apart from the photographs.
    work.grimace("run photos -o other --overlay photos/smiling").exit(1).says(&["would lie among the frames of S001_smiling"]);
}

#[test]
fn pictures_of_people_without_common_names_are_in_no_manifest() {
    let work = Work::new();
    for (folder, seconds) in [("neutral", ["01", "21", "41"]), ("happy", ["11", "31", "51"])] {
        for second in seconds {
            work.write(&format!("faces/{folder}/IMG_20240501_1200{second}.jpg"), "");
        }
    }
    let said = "`happy/`; `neutral/`: these folders hold pictures with no name in common; name the two pictures of a person alike, e.g. \
                neutral/anna.jpg and happy/anna.jpg";
    work.grimace("init faces").exit(1).says(&[said]);
    assert!(!work.path("faces/manifest.csv").exists());
    // Beside people whose pictures pair, it is a note.
    for file in [
        "Joy_neutral",
        "Joy_happy_1",
        "Joy_happy_2",
        "Ole B_01_neutral",
        "Ole B_02_sad",
        "ida_sad",
        "Eva_sad",
        "Eva_neutral",
        "eva_neutral",
    ] {
        work.write(&format!("faces/{file}.jpg"), "");
    }
    work.write("people.csv", "subject,sex\nOle B,m\nJoy,f\n");
    work.grimace("init faces --people people.csv").exit(0).prints(&[
        "manifest.csv: 3 sequences",
        "note: in no pair: Eva_neutral.jpg (Eva and eva differ only in case; rename one), eva_neutral.jpg",
        "ida_sad.jpg (no neutral picture of ida)",
        said,
    ]);
    let manifest = "subject,sequence,emotion,frames,sex\n\
                    Joy,happy_1,happiness,Joy_neutral.jpg;Joy_happy_1.jpg,f\n\
                    Joy,happy_2,happiness,Joy_neutral.jpg;Joy_happy_2.jpg,f\n\
                    Ole_B,sad,sadness,Ole B_01_neutral.jpg;Ole B_02_sad.jpg,m\n";
    assert_eq!(work.read("faces/manifest.csv"), manifest);
}

#[test]
fn listed_pictures_that_are_not_a_sequence_are_reported() {
    let work = photographs();
    let small = image::load_from_memory(&work.bytes("photos/neutral/S001.png")).unwrap().crop_imm(0, 0, 180, 160);
    small.save(work.path("photos/small.png")).unwrap();
    work.write("photos/a.mp4", "");
    for (frames, said) in [
        ("neutral/S001.png;none.png", "none.png: there is no such picture"),
        ("neutral/S001.png;a.mp4", "a.mp4: is not a picture"),
        ("neutral/S001.png;smiling", "smiling: is not a picture"),
        ("neutral/S001.png", "neutral/S001.png: one picture alone is not a sequence"),
        (";neutral/S001.png", "neutral/S001.png: one picture alone is not a sequence"),
        ("neutral/S001.png;neutral/S001.png", "neutral/S001.png: is in the list twice"),
        ("neutral/S001.png;smiling/S001.png;small.png", "small.png: frame 3 is 180x160 where the first frame is 200x160"),
    ] {
        work.write("photos/manifest.csv", format!("subject,sequence,emotion,frames\nS001,smiling,joy,{frames}\n"));
        work.grimace("check photos").exit(3).prints(&[said]);
        work.grimace("run photos -o out --force").exit(1).says(&[said]);
    }
}
