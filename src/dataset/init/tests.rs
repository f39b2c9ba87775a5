use std::fs;

use super::super::folder_with as folder;
use super::*;

fn rows(files: &[&str]) -> Vec<[String; 4]> {
    let manifest = propose_manifest(folder(files).path()).unwrap();
    manifest.rows.into_iter().map(|r| [r.subject, r.sequence, r.emotion, r.frames]).collect()
}

#[test]
fn folders_and_videos_of_any_depth_become_rows() {
    let files = ["S1/happy/1.png", "S1/happy/2.png", "S1/clip.mp4", "S2/a/sad_01/1.jpg", "S2/a/sad_01/2.jpg", "S2/notes.txt"];
    let expected = [
        ["S1", "clip", "?", "S1/clip.mp4"],
        ["S1", "happy", "happiness", "S1/happy"],
        ["S2", "a-sad_01", "sadness", "S2/a/sad_01"],
    ];
    assert_eq!(rows(&files), expected.map(|r| r.map(str::to_owned)));
}

#[test]
fn names_that_say_no_emotion_leave_it_open() {
    let files = ["S1/happy/not_happy/1.png", "S1/happy/not_happy/2.png", "S1/x/1.png", "S1/x/2.png"];
    assert_eq!(rows(&files).iter().map(|r| r[2].as_str()).collect::<Vec<_>>(), ["?", "?"]);
}

#[test]
fn emotions_first_and_flat_videos_name_their_people() {
    let files = ["anger/P1/1.png", "anger/P1/2.png", "fear/P1/1.png", "fear/P1/2.png"];
    let expected = [["P1", "anger", "anger", "anger/P1"], ["P1", "fear", "fear", "fear/P1"]];
    assert_eq!(rows(&files), expected.map(|r| r.map(str::to_owned)));
    let expected = [["anna", "surprised", "surprise", "anna_surprised.avi"], ["ben", "2", "?", "ben-2.mov"]];
    assert_eq!(rows(&["anna_surprised.avi", "ben-2.mov"]), expected.map(|r| r.map(str::to_owned)));
    // The emotion comes first and is not a person.
    let expected = [
        ["P01", "happy", "happiness", "happy_P01.mp4"],
        ["P01", "sad_2", "sadness", "sad-P01-2.mp4"],
        ["happy", "sad", "?", "happy_sad.mp4"],
    ];
    assert_eq!(rows(&["happy_P01.mp4", "happy_sad.mp4", "sad-P01-2.mp4"]), expected.map(|r| r.map(str::to_owned)));
}

#[test]
fn a_table_of_landmarks_among_the_frames_is_named() {
    let pictures = ["S1/a/1.png", "S1/a/2.png", "S1/b/1.png", "S1/b/2.png", "S1/c/1.png", "S1/c/2.png"];
    let folder = folder(&pictures);
    let points = |of: &dyn Fn(usize) -> String| (0..68).map(of).collect::<Vec<_>>().join(",");
    let table = format!("frame,{}\n1,{}\n", points(&|k| format!("x{k},y{k}")), points(&|k| format!("{k},{k}.5")));
    let files = [("a/landmarks68.csv", &*table), ("b/Landmarks_1.csv", &table), ("b/landmarks_2.csv", &table)];
    for (file, text) in
        files.into_iter().chain([("c/landmarks.csv", "about these landmarks\n"), ("c/correspondences.csv", "node,x,y\n")])
    {
        fs::write(folder.path().join("S1").join(file), text).unwrap();
    }
    // Two tables, or one that is none, are not guessed at.
    let manifest = propose_manifest(folder.path()).unwrap();
    assert_eq!(manifest.rows.iter().map(|row| &*row.landmarks).collect::<Vec<_>>(), ["S1/a/landmarks68.csv", "", ""]);
}

#[test]
fn people_may_have_the_name_joy_and_names_that_differ_by_case_are_distinguished() {
    let files = ["Joy/clip1/1.png", "Joy/clip1/2.png", "anna/happy/1.png", "anna/happy/2.png", "ben/sad/1.png", "ben/sad/2.png"];
    let expected =
        [["Joy", "clip1", "?", "Joy/clip1"], ["anna", "happy", "happiness", "anna/happy"], ["ben", "sad", "sadness", "ben/sad"]];
    assert_eq!(rows(&files), expected.map(|r| r.map(str::to_owned)));
    let files = ["S1/Take/1.png", "S1/Take/2.png", "S1/take/1.png", "S1/take/2.png"];
    assert_eq!(rows(&files).iter().map(|r| r[1].as_str()).collect::<Vec<_>>(), ["Take", "take-2"]);
}

#[test]
fn marks_of_a_labelled_dataset_are_named_and_what_has_no_label_is_said() {
    let folder = folder(&["1", "2"].map(|f| format!("cohn-kanade-images/S005/001/{f}.png")).each_ref().map(String::as_str));
    for (file, text) in [
        ("cohn-kanade-images/S005/001/correspondences.csv", "node,x,y\n"),
        ("cohn-kanade-images/S005/002/1.png", ""),
        ("cohn-kanade-images/S005/002/2.png", ""),
        ("Emotion/S005/001/S005_001_00000002_emotion.txt", "   3.0000000e+00\n"),
    ] {
        let path = folder.path().join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    let manifest = propose_manifest(folder.path()).unwrap();
    assert_eq!(manifest.skipped, ["S005_002: no emotion label"]);
    let path = manifest_path(folder.path());
    manifest.write(&path).unwrap();
    let expected = "subject,sequence,emotion,frames,correspondences\n\
                    S005,001,disgust,cohn-kanade-images/S005/001,cohn-kanade-images/S005/001/correspondences.csv\n";
    assert_eq!(fs::read_to_string(&path).unwrap(), expected);
}

#[test]
fn cohn_kanade_without_labels_is_read_and_people_are_joined() {
    let folder = folder(&["cohn-kanade/S005/001/1.png", "cohn-kanade/S005/001/2.png", "cohn-kanade/S010/001/1.png"]);
    fs::write(folder.path().join("cohn-kanade/S010/001/2.png"), "").unwrap();
    let people = folder.path().join("people.csv");
    fs::write(&people, "subject,gender\nS005,f\nS099,m\n").unwrap();
    let mut manifest = propose_manifest(folder.path()).unwrap();
    manifest.join_people(&people).unwrap();
    assert_eq!(manifest.unknown_people, ["S010"]);
    assert!(manifest.not_joined.is_empty());
    let path = manifest_path(folder.path());
    manifest.write(&path).unwrap();
    let expected = "subject,sequence,emotion,frames,gender\n\
                    S005,001,?,cohn-kanade/S005/001,f\nS010,001,?,cohn-kanade/S010/001,\n";
    assert_eq!(fs::read_to_string(&path).unwrap(), expected);
    fs::write(&people, "who,gender\nS005,f\n").unwrap();
    assert!(manifest.join_people(&people).unwrap_err().to_string().contains("has no column `subject`"));
    fs::write(&people, "subject,gender\nX,f\n").unwrap();
    let nobody = manifest.join_people(&people).unwrap_err().to_string();
    assert!(nobody.ends_with("none of its subjects is in the dataset, whose first subject is `S005`"), "{nobody}");
    assert!(propose_manifest(&folder.path().join("cohn-kanade/S005/001")).is_ok(), "a folder of images is one sequence");
}

#[test]
fn leading_zeros_that_a_spreadsheet_removed_are_noticed() {
    let folder = folder(&["001/a.mp4", "002/a.mp4"]);
    let people = folder.path().join("people.csv");
    fs::write(&people, "subject,gender\n1,f\n2,m\n").unwrap();
    let error = propose_manifest(folder.path()).unwrap().join_people(&people).unwrap_err().to_string();
    assert!(error.contains("whose first subject is `001`; without leading zeros some are"), "{error}");
}

#[test]
fn columns_of_people_that_are_not_taken_are_named() {
    let folder = folder(&["S1/a.mp4"]);
    let people = folder.path().join("people.csv");
    let joined = |table: &str| {
        fs::write(&people, table).unwrap();
        let mut manifest = propose_manifest(folder.path()).unwrap();
        manifest.join_people(&people).unwrap();
        (manifest.person_columns, manifest.not_joined)
    };
    let (taken, left) = joined("subject,Emotion,gender,,frames,\nS1,joy,f,old,12,\n");
    assert_eq!(taken, ["gender"]);
    let own = |name: &str| format!("`{name}`, which the manifest sets for each sequence");
    assert_eq!(left, [own("Emotion"), own("frames"), "column 4, which has no name".to_owned()]);
    assert_eq!(joined("person,gender\nS1,f\n"), (vec!["gender".to_owned()], Vec::new()));
    assert_eq!(joined("Participant ID;gender\nS1;f\n"), (vec!["gender".to_owned()], Vec::new()));
    // The column `id` counts rows.
    assert_eq!(joined("id,Name,gender\n1,S1,f\n"), (["id", "gender"].map(str::to_owned).to_vec(), Vec::new()));
}

#[test]
fn people_missing_from_a_table_of_consents_have_not_consented() {
    let folder = folder(&["anna/happy.mp4", "ben/happy.mp4", "carl/happy.mp4"]);
    let people = folder.path().join("people.csv");
    fs::write(&people, "subject,publish\nanna,yes\nBEN,no\ndora,yes\n").unwrap();
    let mut manifest = propose_manifest(folder.path()).unwrap();
    manifest.join_people(&people).unwrap();
    let said: Vec<(&str, &str)> = manifest.rows.iter().map(|row| (row.subject.as_str(), row.person[0].as_str())).collect();
    assert_eq!(said, [("anna", "yes"), ("ben", "no"), ("carl", "no")]);
    assert_eq!((manifest.unknown_people, manifest.people_without_rows), (vec!["carl".to_owned()], vec!["dora".to_owned()]));
}

#[test]
fn consent_of_one_person_is_not_that_of_another_with_a_similar_name() {
    let folder = folder(&["A_1/happy.mp4", "A-1/happy.mp4"]);
    let people = folder.path().join("people.csv");
    fs::write(&people, "subject,publish\nA_1,yes\n").unwrap();
    let mut manifest = propose_manifest(folder.path()).unwrap();
    manifest.join_people(&people).unwrap();
    let mut said: Vec<(&str, &str)> = manifest.rows.iter().map(|row| (row.subject.as_str(), row.person[0].as_str())).collect();
    said.sort_unstable();
    assert_eq!(said, [("A-1", "no"), ("A_1", "yes")]);
    assert_eq!(manifest.unknown_people, ["A-1"]);
}

#[test]
fn people_are_joined_however_the_words_of_their_names_are_separated() {
    let files = ["Ole B_neutral.jpg", "Ole B_happy.jpg", "A_1_neutral.jpg", "A_1_happy.jpg"];
    let folder = folder(&files);
    let people = folder.path().join("people.csv");
    let joined = |table: &str| {
        fs::write(&people, table).unwrap();
        let mut manifest = propose_manifest(folder.path()).unwrap();
        manifest.join_people(&people).unwrap();
        assert!(manifest.people_without_rows.len() < 2, "{manifest:?}");
        manifest.rows.into_iter().map(|row| format!("{} {}", row.subject, row.person[0])).collect::<Vec<_>>()
    };
    assert_eq!(joined("subject,sex\nole b,m\nA-1,f\n"), ["A_1 f", "Ole_B m"]);
    assert_eq!(joined("subject,sex\nOle B,m\nA_1,f\nA-1,x\n"), ["A_1 f", "Ole_B m"], "the same name comes first");
}

#[cfg(unix)]
#[test]
fn links_back_lead_nowhere() {
    let outside = folder(&["other/secret/1.png", "other/secret/2.png", "set/anna/happy/1.png", "set/anna/happy/2.png"]);
    let root = outside.path().join("set");
    std::os::unix::fs::symlink("../..", root.join("anna/loop")).unwrap();
    let manifest = propose_manifest(&root).unwrap();
    assert_eq!(manifest.rows.iter().map(|row| row.frames.as_str()).collect::<Vec<_>>(), ["anna/happy"]);
}

#[test]
fn folders_that_hold_no_sequence_are_named() {
    let folder = folder(&["anna/smile/1.png", "anna/smile/2.png", "ben/fear/1.png"]);
    fs::create_dir(folder.path().join("carl")).unwrap();
    let manifest = propose_manifest(folder.path()).unwrap();
    assert_eq!((manifest.rows.len(), manifest.left_out), (1, vec!["ben/fear".to_owned(), "carl".to_owned()]));
}

#[test]
fn one_person_alone_is_one_person() {
    let two = |folder: &str| ["1.png", "2.png"].map(|file| format!("{folder}/{file}"));
    let subjects = |folders: &[&str]| -> Vec<String> {
        let files: Vec<String> = folders.iter().flat_map(|f| two(f)).collect();
        rows(&files.iter().map(String::as_str).collect::<Vec<_>>()).into_iter().map(|[subject, ..]| subject).collect()
    };
    assert_eq!(subjects(&["S1/happy", "S1/sad"]), ["S1", "S1"]);
    assert_eq!(subjects(&["anna/happy", "anna/sad"]), ["anna", "anna"]);
    assert_eq!(subjects(&["S1/s01/happy", "S1/s02/happy"]), ["S1", "S1"]);
    assert_eq!(subjects(&["S1/happy_01", "S1/sad_01"]), ["S1", "S1"]);
    assert_eq!(subjects(&["videos/anna/happy", "videos/ben/happy"]), ["anna", "ben"]);
    assert_eq!(subjects(&["data2/S1/happy", "data2/S1/sad"]), ["S1", "S1"]);
    for (name, expected) in [("S1", true), ("sub-01", true), ("012", true), ("video3", false), ("anna", false), ("S1b", false)] {
        assert_eq!(is_label(name), expected, "{name}");
    }
    let folder = folder(&["videos/anna/1.png", "videos/anna/2.png"]);
    assert_eq!(propose_manifest(folder.path()).unwrap().holds_all.as_deref(), Some("videos"));
}

#[test]
fn what_is_not_read_and_results_are_named() {
    let folder = folder(&["S1/a.mp4", "S2/b.wmv", "S2/c.HEIC", "out/run.json", "out/overlays/1.png", "out/overlays/2.png"]);
    let manifest = propose_manifest(folder.path()).unwrap();
    assert_eq!((manifest.rows.len(), manifest.rows[0].subject.as_str()), (1, "S1"));
    assert_eq!(manifest.unread, ["S2/b.wmv", "S2/c.HEIC"]);
    assert_eq!(manifest.results, ["out"]);
    let folder = self::folder(&[
        "S1/a.mp4",
        "smile/clone.json",
        "smile/sheet.png",
        "smile/overlay.png",
        "smile/frames/a_1.png",
        "smile/frames/a_2.png",
    ]);
    let manifest = propose_manifest(folder.path()).unwrap();
    assert_eq!((manifest.rows.len(), manifest.results), (1, vec!["smile".to_owned()]), "a clone is not a recording");
}

#[test]
fn pictures_that_a_command_of_ours_wrote_are_no_sequence() {
    let root = folder(&[
        "S1/a/1.png",
        "S1/a/2.png",
        "overlays/S1_a_00000001_overlay.png",
        "overlays/S1_a_00000002_overlay.png",
        "made/turntable.png",
        "made/contact_sheet.png",
        "made/films/clone.mp4",
        "S1/mixed/1.png",
        "S1/mixed/2.png",
        "S1/mixed/S1_a_00000001_overlay.png",
    ]);
    let record = "00  turntable.png\n00  contact_sheet.png\n00  films/clone.mp4\n";
    fs::write(root.path().join("made/synthesize.b3"), record).unwrap();
    let manifest = propose_manifest(root.path()).unwrap();
    assert_eq!(manifest.rows.iter().map(|row| row.frames.as_str()).collect::<Vec<_>>(), ["S1/a", "S1/mixed"]);
    assert_eq!(manifest.results, ["made", "made/films", "overlays"]);
    // A recording among written files is included, and checksums of recordings are not a record of this program.
    fs::write(root.path().join("S1/checksums.b3"), "00  a/1.png\n00  a/2.png\n").unwrap();
    fs::write(root.path().join("made/films/anna.mp4"), "").unwrap();
    assert_eq!(propose_manifest(root.path()).unwrap().rows.len(), 3);
    // In the results folder itself.
    let out = folder(&["run.json", "overlays/S1_1_00000001_overlay.png", "representatives/joy_skin.png"]);
    let error = propose_manifest(out.path()).unwrap_err().to_string();
    assert!(error.contains("only results of grimace, in overlays; representatives; give the folder"), "{error}");
}

#[test]
#[cfg(unix)]
fn links_in_circles_are_not_followed() {
    let folder = folder(&["S1/a.mp4", "S2/b.mp4"]);
    std::os::unix::fs::symlink(folder.path(), folder.path().join("S1/loop")).unwrap();
    assert_eq!(propose_manifest(folder.path()).unwrap().rows.len(), 2);
}

#[test]
fn people_who_appear_twice_must_have_the_same_fields() {
    let folder = folder(&["A/a.mp4", "B/b.mp4"]);
    let people = folder.path().join("people.csv");
    let mut manifest = propose_manifest(folder.path()).unwrap();
    fs::write(&people, "subject,gender\nA,f\nA,f\nB,m\n").unwrap();
    manifest.join_people(&people).unwrap();
    fs::write(&people, "subject,gender\nA,f\nB,m\nA,m\n").unwrap();
    let error = manifest.join_people(&people).unwrap_err().to_string();
    assert!(error.contains("line 4") && error.contains("`A`"), "{error}");
}

#[test]
fn nothing_is_said() {
    let empty = tempfile::tempdir().unwrap();
    assert!(propose_manifest(empty.path()).unwrap_err().to_string().contains("no sequences found"));
    assert!(matches!(propose_manifest(&empty.path().join("x")), Err(DatasetError::NotFound { .. })));
}
