//! Tests of whole datasets in temporary folders.

use std::fs;

use nalgebra::Point2;
use tempfile::TempDir;

use super::*;
use crate::{
    units::NodeId,
    wireframe::{Tables, Wireframe},
};

const NODE_COUNT: usize = 113;

fn write(folder: &TempDir, name: &str, content: impl AsRef<[u8]>) {
    let path = folder.path().join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, content).unwrap();
}

fn manifest(text: impl AsRef<[u8]>) -> (TempDir, Dataset) {
    let folder = tempfile::tempdir().unwrap();
    write(&folder, MANIFEST_NAME, text);
    let dataset = Dataset::open(folder.path()).unwrap();
    (folder, dataset)
}

fn ids(dataset: &Dataset) -> Vec<String> {
    dataset.sequences.iter().map(|entry| entry.id.to_string()).collect()
}

fn failures(dataset: &Dataset) -> Vec<(&str, &str, String)> {
    dataset.failures.iter().map(|f| (f.subject.as_str(), f.sequence.as_str(), f.error.to_string())).collect()
}

fn open_error(folder: &TempDir) -> String {
    Dataset::open(folder.path()).unwrap_err().to_string()
}

/// 68 rows, landmark k at (k, 2 k).
fn landmark_lines() -> String {
    (0..68).map(|k| format!("{k} {}\n", 2 * k)).collect()
}

fn landmark_csv(frames: &[u32]) -> String {
    let header: String = (0..68).map(|k| format!(",x{k},y{k}")).collect();
    let points: String = (0..68).map(|k| format!(",{k},{}", 2 * k)).collect();
    let rows: String = frames.iter().map(|frame| format!("{frame}{points}\n")).collect();
    format!("frame{header}\n{rows}")
}

#[test]
fn pictures_of_a_row_are_listed_one_by_one() {
    let folder = tempfile::tempdir().unwrap();
    for file in ["n/a.jpg", "s/a.jpg"] {
        write(&folder, file, "");
    }
    write(&folder, "marks/a.csv", landmark_csv(&[1, 2]));
    let rows = "S1,1,joy,n/a.jpg; s/a.jpg,marks/a.csv\nS1,2,joy,n/a.jpg;none.jpg,\nS1,3,joy,none.jpg;n/a.jpg,marks/a.csv\n";
    write(&folder, MANIFEST_NAME, format!("subject,sequence,emotion,frames,landmarks\n{rows}"));
    let dataset = Dataset::open(folder.path()).unwrap();
    let [pair, broken, landmarks] = &dataset.sequences[..] else { panic!("three rows") };
    let frames = pair.frames().unwrap();
    assert_eq!((frames.names(), frames.neutral_number()), (vec!["n/a.jpg".to_owned(), "s/a.jpg".to_owned()], 1));
    assert_eq!(pair.places(), [folder.path().join("n"), folder.path().join("s")]);
    assert_eq!((pair.driving_landmarks(false).unwrap(), pair.missing_frames()), (None, None));
    assert_eq!(pair.driving_landmarks(true).unwrap(), Some(folder.path().join("marks/a.csv")));
    assert!(
        broken
            .frames()
            .unwrap_err()
            .to_string()
            .ends_with("none.jpg: there is no such picture (frames listed one by one, separated by `;`)")
    );
    // Landmarks drive a sequence whose pictures are elsewhere.
    assert!(landmarks.driving_landmarks(false).unwrap().is_some() && landmarks.missing_frames().is_some());
}

#[test]
fn a_manifest_of_semicolons_reads() {
    let (_folder, dataset) = manifest(
        "\u{FEFF}subject;sequence;emotion;fps;age;note\r\nS1;1;joy;12,5;23,5;\"mild; closed\"\r\nS1;2;joy;1.000,5;;\r\n;;;;;\r\nS1;3\r\n",
    );
    let joy = &dataset.sequences[0];
    assert_eq!((ids(&dataset), joy.fps), (vec!["S1_1".to_owned()], Some(12.5)));
    // A text that is not a valid number is kept as written.
    assert_eq!((joy.metadata["age"].as_str(), joy.metadata["note"].as_str()), ("23,5", "mild; closed"));
    let failures = failures(&dataset);
    assert_eq!((failures.len(), failures[0].1, failures[1].1), (2, "2", "3"));
    assert!(
        failures[0].2.ends_with("line 3: fps is `1.000,5`; a number of frames per second from 0.1 to 1000 was expected"),
        "{failures:?}"
    );
    assert!(failures[1].2.ends_with("line 5: the row has 2 fields, but the header has 6"), "{failures:?}");
    let folder = tempfile::tempdir().unwrap();
    write(&folder, MANIFEST_NAME, "subject;sequence;emotoin\nS1;1;joy\n");
    assert!(open_error(&folder).ends_with("found `subject`, `sequence`, `emotoin`; is `emotoin` meant for `emotion`?"));
    let folder = tempfile::tempdir().unwrap();
    write(&folder, "Manifest.CSV", "subject,sequence,emotion\nS1,1,joy\n");
    assert!(
        open_error(&folder)
            .ends_with("the manifest is called Manifest.CSV; rename it to manifest.csv, or name the file instead of the folder")
    );
}

#[test]
fn a_manifest_with_every_column_reads() {
    let (folder, dataset) = manifest(
        "\u{FEFF}nation,subject,sequence,emotion,frames,first_frame,last_frame,correspondences,landmarks,fps,note\r\n\
         GR,S2,001, Happiness ,clips/b.avi,3,9,marks/b.csv,l.csv,29.97,\"mild, closed\"\r\n\
         ,S1,002,anger,,,,,,,\r\n",
    );
    assert_eq!(ids(&dataset), ["S1_002", "S2_001"], "sorted by id");
    assert!(dataset.failures.is_empty() && dataset.skipped.is_empty());
    let root = folder.path();
    let [plain, full] = &dataset.sequences[..] else { panic!() };
    assert_eq!((plain.emotion.as_str(), plain.frames_path.clone()), ("anger", root.join("S1/002")));
    assert_eq!((plain.first_frame, plain.last_frame, plain.fps), (None, None, None));
    assert_eq!((full.emotion.as_str(), full.frames_path.clone()), ("happiness", root.join("clips/b.avi")));
    assert_eq!((full.first_frame, full.last_frame, full.fps), (Some(3), Some(9), Some(29.97)));
    assert_eq!(full.correspondences_path, Some(root.join("marks/b.csv")));
    assert_eq!(full.landmarks_paths, [root.join("clips/l.csv"), root.join("l.csv")], "beside the video, then the manifest");
    assert_eq!((full.column("nation"), full.column("note")), (Some("GR"), Some("mild, closed")));
    assert_eq!((full.column("subject"), full.column("emotion"), full.column("fps")), (Some("S2"), Some("happiness"), None));
    assert_eq!(full.metadata.len(), 2);
    // The manifest file itself is also accepted.
    let direct = Dataset::open(&root.join(MANIFEST_NAME)).unwrap();
    assert_eq!(direct.sequences, dataset.sequences);
}

#[test]
fn a_bad_row_fails_only_its_sequence() {
    let (folder, dataset) = manifest(
        b"subject,sequence,emotion,first_frame,last_frame,fps\n\
          S1,001,fear,,,\n\
          S1,001,anger,,,\n\
          ,002,fear,,,\n\
          S1,003,,,,\n\
          ../x,004,fear,,,\n\
          ..,005,fear,,,\n\
          S1,006,fear,9,9,\n\
          S1,007,fear,one,3,\n\
          S1,008,fear,,,0\n\
          S1,009\n\
          S\xE9,010,fear,,,\n\
          \"S1,011,fear,,,\n\
          S1,012,fear,,,\n\
          S1_001,x,fear,,,\n\
          S1,001_x,fear,,,\n\
          S1,013,a/b,,,\n"
            .as_slice(),
    );
    assert_eq!(ids(&dataset), ["S1_001", "S1_012", "S1_001_x"]);
    let path = folder.path().join(MANIFEST_NAME).display().to_string();
    let found: Vec<_> = failures(&dataset).into_iter().map(|(s, q, e)| (s, q, e.replace(&path, "M"))).collect();
    let expect = [
        ("S1", "001", "M, line 3: subject `S1`, sequence `001` is already in line 2; keep one row, or rename one"),
        ("", "002", "M, line 4: subject is empty"),
        ("S1", "003", "M, line 5: emotion is empty"),
        (
            "../x",
            "004",
            "M, line 6: subject is `../x`, with a path separator in it; choose another value, because results are named after it",
        ),
        (
            "..",
            "005",
            "M, line 7: subject is `..`, which is the name of a folder; choose another value, because results are named after it",
        ),
        ("S1", "006", "M, line 8: first_frame is 9 and last_frame is 9; neutral and apex frame must differ"),
        ("S1", "007", "M, line 9: first_frame is `one`; a whole number of 0 or more was expected"),
        ("S1", "008", "M, line 10: fps is `0`; a number of frames per second from 0.1 to 1000 was expected"),
        ("S1", "009", "M, line 11: the row has 2 fields, but the header has 6"),
        (
            "S\u{FFFD}",
            "010",
            "M, line 12: byte 2 of the line is not UTF-8; the file looks like Windows-1252 (Latin-1): save it as UTF-8 text, or convert it \
             (iconv -f WINDOWS-1252 -t UTF-8 OLD.csv > NEW.csv) and check the names",
        ),
        ("", "", "M, line 13: a quotation mark is not closed"),
        (
            "S1",
            "001_x",
            "M, line 16: the results of this sequence and of the one in line 15 would both be named `S1_001_x`; rename one",
        ),
        (
            "S1",
            "013",
            "M, line 17: emotion is `a/b`, with a path separator in it; choose another value, because results are named after it",
        ),
    ];
    assert_eq!(found, expect.map(|(s, q, e)| (s, q, e.to_owned())));
}

#[test]
fn manifests_that_do_not_read_as_a_whole_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let error = |text: &[u8]| {
        write(&folder, MANIFEST_NAME, text);
        open_error(&folder)
    };
    assert!(error(b"subject,emotion\nS1,fear\n").ends_with("has no column `sequence`; found `subject`, `emotion`"));
    assert!(error(b"subject;sequence;emotion\n").ends_with("the manifest lists no sequence"));
    assert!(error(b"subject,sequence,emotion\n,,\n").ends_with("the manifest lists no sequence"));
    assert!(error(b"").contains("is empty"));
    assert!(error(b"\xFF\xFEs\0u\0").contains("is a text in UTF-16"));
    assert!(Dataset::open(&folder.path().join("none")).unwrap_err().to_string().contains("no such dataset"));
}

#[test]
fn frames_are_listed_when_asked_for() {
    let (folder, dataset) = manifest("subject,sequence,emotion,first_frame,last_frame\nS1,001,fear,2,3\nS1,002,fear,,\n");
    for k in 1..=4 {
        write(&folder, &format!("S1/001/S1_001_{k:08}.png"), "");
    }
    let FrameSource::Images(frames) = dataset.sequences[0].frames().unwrap() else { panic!() };
    assert_eq!(frames.iter().map(|f| f.number).collect::<Vec<_>>(), [2, 3]);
    assert!(dataset.sequences[1].frames().unwrap_err().to_string().contains("there is no such folder"));
}

#[test]
fn correspondences_come_from_the_file_named_the_default_file_or_landmarks() {
    let (folder, dataset) = manifest(
        "subject,sequence,emotion,correspondences,landmarks\n\
         S1,001,fear,marks.csv,\nS1,002,fear,,\nS1,003,fear,,l.csv\nS1,004,fear,,\nS1,005,fear,none.csv,\nS1,006,fear,,none.csv\n",
    );
    write(&folder, "marks.csv", "node,x,y\n1,2,3\n");
    write(&folder, "S1/002/correspondences.csv", "node,x,y\n8.3,4,5\n");
    write(&folder, "S1/003/l.csv", landmark_csv(&[1, 2]));
    let read = |k: usize, frame| {
        let marks = dataset.sequences[k].correspondences(frame, &Tables::candide3(), NODE_COUNT, &LandmarkSelection::Default);
        marks.map(|m| m.iter().map(|c| (c.node, c.position)).collect::<Vec<_>>()).map_err(|e| e.to_string())
    };
    assert_eq!(read(0, 1), Ok(vec![(NodeId(1), Point2::new(2.0, 3.0))]));
    assert_eq!(read(1, 1), Ok(vec![(NodeId(31), Point2::new(4.0, 5.0))]));
    // Landmark 45 is the outer corner of the left eye, node 20.
    assert_eq!(read(2, 1).unwrap()[0], (NodeId(20), Point2::new(45.0, 90.0)));
    assert!(read(2, 7).unwrap_err().contains("frame 7 has no landmarks; 2 frames from 1 to 2 have them"));
    let none = read(3, 1).unwrap_err();
    assert!(none.starts_with("S1_004: no correspondences and no landmarks; mark 5 to 8 points"), "{none}");
    assert!(none.contains("004/correspondences.csv") && none.contains("`node,x,y`"), "{none}");
    assert!(read(4, 1).unwrap_err().contains("S1_005: the correspondence file"));
    assert!(read(5, 1).unwrap_err().contains("the landmark file does not exist; searched for"));
    assert!(matches!(dataset.sequences[3].correspondence_source(), Ok(CorrespondenceSource::None)));
    assert_eq!(dataset.sequences[3].landmarks().unwrap(), None);
}

fn cohn_kanade(images: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (sequence, code) in [("001", Some("   3.0000000e+00\n")), ("002", None), ("003", Some("8")), ("004", Some("0.0"))] {
        for k in 1..=3 {
            write(&folder, &format!("{images}/S005/{sequence}/S005_{sequence}_{k:08}.png"), "");
            write(&folder, &format!("Landmarks/S005/{sequence}/S005_{sequence}_{k:08}_landmarks.txt"), landmark_lines());
        }
        if let Some(code) = code {
            write(&folder, &format!("Emotion/S005/{sequence}/S005_{sequence}_00000003_emotion.txt"), code);
        }
    }
    write(&folder, &format!("{images}/S005/.DS_Store"), "");
    write(&folder, "FACS/S005/001/S005_001_00000003_facs.txt", "1 2\n");
    folder
}

fn check_cohn_kanade(path: &Path) {
    let dataset = Dataset::open(path).unwrap();
    assert_eq!(ids(&dataset), ["S005_001", "S005_004"], "{}", path.display());
    let emotions: Vec<_> = dataset.sequences.iter().map(|entry| entry.emotion.as_str()).collect();
    assert_eq!(emotions, ["disgust", "neutral"]);
    assert_eq!(dataset.skipped.iter().map(|s| s.id.to_string()).collect::<Vec<_>>(), ["S005_002"]);
    assert_eq!(dataset.failures.len(), 1);
    assert_eq!(dataset.failures[0].sequence, "003");
    assert!(dataset.failures[0].error.to_string().contains("found `8`; an emotion code was expected: 0 neutral, 1 anger"));
    let entry = &dataset.sequences[0];
    let frames = entry.frames().unwrap();
    assert_eq!(frames.neutral_number(), 1);
    let marks = entry.correspondences(1, &Tables::candide3(), NODE_COUNT, &LandmarkSelection::Default).unwrap();
    assert_eq!((marks.len(), marks[6].node, marks[6].position), (11, NodeId(10), Point2::new(8.0, 16.0)));
    assert_eq!(entry.landmarks().unwrap().unwrap().frames.len(), 3);
}

#[test]
fn cohn_kanade_reads_from_above_or_from_the_images() {
    let folder = cohn_kanade("cohn-kanade-images");
    check_cohn_kanade(folder.path());
    check_cohn_kanade(&folder.path().join("cohn-kanade-images"));
    let renamed = cohn_kanade("pictures");
    check_cohn_kanade(renamed.path());
    check_cohn_kanade(&renamed.path().join("pictures"));
    // Subjects, labels and landmarks in the same folder.
    check_cohn_kanade(cohn_kanade(".").path());
}

#[test]
fn cohn_kanade_with_several_or_no_labels_says_so() {
    let folder = cohn_kanade("cohn-kanade-images");
    write(&folder, "Emotion/S005/001/S005_001_00000002_emotion.txt", "3");
    let dataset = Dataset::open(folder.path()).unwrap();
    assert!(dataset.failures[0].error.to_string().ends_with("2 files *_emotion.txt; one was expected"));
    fs::remove_dir_all(folder.path().join("Emotion")).unwrap();
    assert!(open_error(&folder).contains("there is no folder Emotion beside it"));
    assert!(Dataset::open(&folder.path().join("cohn-kanade-images")).unwrap_err().to_string().contains("no folder Emotion"));
}

#[test]
fn folders_without_a_manifest_ask_for_one_with_an_example() {
    let folder = tempfile::tempdir().unwrap();
    assert!(open_error(&folder).contains("no sequences found; expected manifest.csv"));
    write(&folder, "anna/readme.txt", "");
    write(&folder, "bert/take1/notes.txt", "");
    write(&folder, "bert/take2/f1.jpg", "");
    assert!(open_error(&folder).ends_with("such as\nsubject,sequence,emotion\nbert,take2,happiness"), "{}", open_error(&folder));
}

#[test]
fn a_large_manifest_opens_without_touching_the_frames() {
    let rows: String = (0..20_000).rev().map(|k| format!("S{:05},{},fear,GR,f\n", k / 10, k % 10)).collect();
    let (_folder, dataset) = manifest(format!("subject,sequence,emotion,nation,sex\n{rows}"));
    assert_eq!((dataset.sequences.len(), dataset.failures.len()), (20_000, 0));
    assert!(dataset.sequences.windows(2).all(|pair| pair[0].id < pair[1].id));
}

#[test]
fn the_real_sequences_read() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/sequences");
    if !root.is_dir() {
        eprintln!("SKIPPED the_real_sequences_read: ../shared/data/sequences does not exist");
        return;
    }
    let dataset = Dataset::open(&root).unwrap();
    assert_eq!((dataset.sequences.len(), dataset.failures.len(), dataset.skipped.len()), (50, 0, 0));
    let tables = Tables::candide3();
    let mut frame_count = 0;
    for entry in &dataset.sequences {
        let source = entry.frames().unwrap();
        let FrameSource::Images(frames) = &source else { panic!("{}: a video", entry.id) };
        let (first, last) = (entry.first_frame.unwrap(), entry.last_frame.unwrap());
        assert_eq!(frames.len(), (last - first + 1) as usize, "{}", entry.id);
        let landmarks = entry.landmarks().unwrap().unwrap();
        assert_eq!(landmarks.frames.keys().copied().collect::<Vec<_>>(), frames.iter().map(|f| f.number).collect::<Vec<_>>());
        frame_count += frames.len();
        let count = Wireframe::candide3().node_count();
        let marks = entry.correspondences(source.neutral_number(), &tables, count, &LandmarkSelection::Default).unwrap();
        let size = |column| entry.column(column).unwrap().parse().unwrap();
        crate::correspondence::validate_correspondences(&marks, size("width"), size("height")).unwrap();
    }
    // Counted independently of this code: image files in the folder, and the sum of last_frame - first_frame + 1 over the rows.
    assert_eq!(frame_count, 638);
}

#[test]
fn columns_of_their_own_and_words_for_no_emotion_are_told_from_misspelt_ones() {
    let open = |header: &str, row: &str| {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("manifest.csv"), format!("subject,sequence,emotion,{header}\n{row}\n")).unwrap();
        Dataset::open(folder.path())
    };
    for own in ["case_id", "race_id", "page_id", "name_id", "names", "grades", "force"] {
        assert!(open(own, "S1,1,joy,x").is_ok(), "{own}");
    }
    for misspelt in
        ["publsh", "publich", "Frames", "frame", "farmes", "face-id", "correspondance", "landmark", "first frame", "FPS"]
    {
        assert!(matches!(open(misspelt, "S1,1,joy,x"), Err(DatasetError::MisspeltColumn { .. })), "{misspelt}");
    }
    for word in ["NA", "nan", "N/A", "null"] {
        let dataset = open("note", &format!("S1,1,{word},x")).unwrap();
        let said = dataset.failures[0].error.to_string();
        assert!(said.contains(&format!("the emotion is `{word}`")), "{said}");
    }
}

#[test]
fn a_video_or_a_picture_is_no_dataset() {
    let folder = tempfile::tempdir().unwrap();
    for (name, said) in [("film.mp4", "this is a video, not a dataset"), ("face.JPG", "grimace locate")] {
        write(&folder, name, b"\x00\x00\x00\x20ftypisom\xFF");
        let error = Dataset::open(&folder.path().join(name)).unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
}
