use super::super::super::folder_with as folder;
use super::super::{ProposedRow, propose_manifest};
use crate::dataset::DatasetError;

fn files(names: &[&str]) -> Vec<String> {
    names.iter().map(|&name| name.to_owned()).collect()
}

fn pairs(names: &[String]) -> (Vec<String>, Vec<String>) {
    let manifest = propose_manifest(folder(names).path()).unwrap();
    let row = |row: &ProposedRow| format!("{} {} {} {}", row.subject, row.sequence, row.emotion, row.frames);
    (manifest.rows.iter().map(row).collect(), manifest.lacking)
}

#[test]
fn a_folder_for_every_emotion_with_a_file_for_every_person_gives_pairs() {
    let mut names = files(&["S9/happy/1.png", "S9/happy/2.png", "mix/neutral/L004.jpg", "mix/smiling/L005.jpg"]);
    names.extend(["neutral", "smiling"].iter().flat_map(|f| ["L001", "L002"].map(|p| format!("mix/{f}/{p}.jpg"))));
    let (rows, lacking) = pairs(&names);
    let expected = [
        "L001 smiling happiness mix/neutral/L001.jpg;mix/smiling/L001.jpg",
        "L002 smiling happiness mix/neutral/L002.jpg;mix/smiling/L002.jpg",
        "S9 happy happiness S9/happy",
    ];
    assert_eq!(rows, expected);
    assert_eq!(lacking, ["mix/neutral/L004.jpg (the only picture of L004)", "mix/smiling/L005.jpg (no neutral picture of L005)"]);
    // Several emotions, one with a single picture, and other words for neutral.
    let (rows, lacking) = pairs(&files(&["visage neutre/a.jpg", "visage neutre/b.jpg", "sad/a.png", "joy/a.jpg", "joy/b.jpg"]));
    let expected = [
        "a joy happiness visage neutre/a.jpg;joy/a.jpg",
        "a sad sadness visage neutre/a.jpg;sad/a.png",
        "b joy happiness visage neutre/b.jpg;joy/b.jpg",
    ];
    assert_eq!(rows, expected);
    assert!(lacking.is_empty(), "every picture is in a pair: {lacking:?}");
}

#[test]
fn names_with_a_code_of_the_expression_are_paired_by_what_precedes_it() {
    let names = files(&[
        "neutral_front/001_03.jpg",
        "neutral_front/002_03.jpg",
        "neutral_front/005_03.jpg",
        "smiling_front/001_08.jpg",
        "smiling_front/002_08.jpg",
        "neutral_left/001_01.jpg",
        "neutral_left/002_01.jpg",
        "joie/001_09.jpg",
        "joie/002_09.jpg",
    ]);
    let (rows, lacking) = pairs(&names);
    let expected =
        ["001", "002"].map(|p| format!("{p} smiling_front happiness neutral_front/{p}_03.jpg;smiling_front/{p}_08.jpg"));
    assert_eq!(rows, expected);
    let left_out = |folder: &str| format!("`{folder}` (no emotion in its name, or no neutral folder of this kind)");
    assert_eq!(
        lacking,
        ["neutral_front/005_03.jpg (the only picture of 005)".to_owned(), left_out("joie"), left_out("neutral_left")]
    );
}

#[test]
fn a_flat_folder_of_people_and_emotions_gives_pairs() {
    let names = ["L001_neutral.jpg", "L001_happy.jpg", "L003_Trauer.jpg", "L003_rest.jpg", "L004_neutral.jpg", "L005.jpg"];
    let (rows, lacking) = pairs(&files(&names));
    let expected = ["L001 happy happiness L001_neutral.jpg;L001_happy.jpg", "L003 Trauer sadness L003_rest.jpg;L003_Trauer.jpg"];
    assert_eq!(rows, expected);
    assert_eq!(lacking, ["L004_neutral.jpg (the only picture of L004)", "L005.jpg (no emotion in the name)"]);
    let (rows, _) = pairs(&files(&["anna/neutral.jpg", "anna/happy.jpg", "ben/neutral.jpg", "ben/happy.jpg"]));
    let expected = ["anna", "ben"].map(|p| format!("{p} happy happiness {p}/neutral.jpg;{p}/happy.jpg"));
    assert_eq!(rows, expected);
    // The two sessions of KDEF are of one person.
    let (rows, lacking) = pairs(&files(&["AF01NES.JPG", "AF01HAS.JPG", "BF01NES.JPG", "BF01HAS.JPG", "AF01HAHL.JPG"]));
    let expected = ["A", "B"].map(|s| format!("F01 {s}-HA happiness {s}F01NES.JPG;{s}F01HAS.JPG"));
    assert_eq!((rows, lacking), (expected.to_vec(), vec!["1 picture from the side".to_owned()]));
}

/// Without the frames.
fn sequences(names: &[&str]) -> Vec<String> {
    let manifest = propose_manifest(folder(names).path()).unwrap();
    manifest.rows.iter().map(|row| format!("{} {} {}", row.subject, row.sequence, row.emotion)).collect()
}

fn refusal(names: &[&str]) -> String {
    propose_manifest(folder(names).path()).unwrap_err().to_string()
}

#[test]
fn folders_of_emotions_without_a_common_name_are_no_sequences() {
    let camera = |folder: &str, last: u32| [0, 20, 40].map(|at| format!("{folder}/IMG_20240501_{}.jpg", 120_001 + last + at));
    let mut names = [camera("B4/neutral", 0), camera("B4/happy", 10)].concat();
    let said = refusal(&names.iter().map(String::as_str).collect::<Vec<_>>());
    let expected = "no sequences found: `B4/happy/`; `B4/neutral/`: these folders hold pictures with no name in common; name the two \
                    pictures of a person alike, e.g. B4/neutral/anna.jpg and B4/happy/anna.jpg";
    assert!(said.contains(expected), "{said}");
    // Beside others they are skipped.
    names.extend(files(&["S1/joy/1.png", "S1/joy/2.png"]));
    let manifest = propose_manifest(folder(&names).path()).unwrap();
    assert_eq!((manifest.rows.len(), manifest.pictures_of_people.len()), (1, 1));
    // One common name is a pair.
    let one = ["neutral/anna.jpg", "neutral/ben.jpg", "neutral/eva.jpg", "joy/anna.jpg", "joy/ole.jpg", "joy/ida.jpg"];
    assert_eq!(sequences(&one), ["anna joy happiness"]);
    // Frames that start anew, or that one person has, are sequences.
    assert_eq!(sequences(&["neutral/n1.png", "neutral/n2.png", "joy/j1.png", "joy/j2.png"]).len(), 2);
    let several = ["anna", "ben"].map(|p| [1, 2, 3, 4].map(|n| format!("{p}/{}/{n}.png", ["neutral", "joy"][n / 3])));
    assert_eq!(sequences(&several.concat().iter().map(String::as_str).collect::<Vec<_>>()).len(), 4);
}

#[test]
fn people_may_have_the_name_of_an_emotion() {
    let names =
        ["Neu_neutral.jpg", "Neu_happy.jpg", "Joy_neutral.jpg", "Joy_happy.jpg", "ida_neutral.jpg", "ida_happy_smile.jpg"];
    assert_eq!(sequences(&names), ["Joy happy happiness", "Neu happy happiness", "ida happy_smile happiness"]);
    assert_eq!(sequences(&["happy_Joy.jpg", "neutral_Joy.jpg"]), ["Joy happy happiness"]);
    assert_eq!(
        sequences(&["neutral/Joy.jpg", "neutral/ida.jpg", "sad/Joy.jpg", "sad/ida.jpg"]),
        ["Joy sad sadness", "ida sad sadness"]
    );
    let (rows, lacking) = pairs(&files(&["ida_neutral.jpg", "ida_sad.jpg", "ida_sad_happy.jpg"]));
    assert_eq!((rows.len(), lacking), (1, vec!["ida_sad_happy.jpg (no neutral picture of ida_sad)".to_owned()]));
}

#[test]
fn numbers_of_shots_are_not_of_people() {
    let names = ["anna_01_neutral.jpg", "anna_02_happy.jpg", "ben_03_neutral.jpg", "ben_04_happy.jpg"];
    assert_eq!(sequences(&names), ["anna happy happiness", "ben happy happiness"]);
    let names = ["anna_neutral_1.jpg", "anna_happy_2.jpg", "ben_neutral.jpg", "ben_happy.jpg"];
    assert_eq!(sequences(&names), ["anna happy happiness", "ben happy happiness"]);
    let names = ["neutral/anna_1.jpg", "neutral/ben_1.jpg", "happy/anna_2.jpg", "happy/ben_3.jpg"];
    assert_eq!(sequences(&names), ["anna happy happiness", "ben happy happiness"]);
    // These are people.
    let names =
        ["S_001_neutral.jpg", "S_001_happy.jpg", "S_002_neutral.jpg", "S_003_happy.jpg", "T_1_neutral.jpg", "T_1_sad.jpg"];
    assert_eq!(sequences(&names), ["S_001 happy happiness", "T_1 sad sadness"]);
}

#[test]
fn every_picture_of_an_expression_pairs_with_the_neutral_one() {
    let expected = ["anna happy_1 happiness", "anna happy_2 happiness"];
    assert_eq!(sequences(&["anna_neutral.jpg", "anna_happy_1.jpg", "anna_happy_2.jpg"]), expected);
    assert_eq!(sequences(&["anna_neutral_1.jpg", "anna_happy_1.jpg", "anna_happy_2.jpg"]), expected);
    assert_eq!(sequences(&["anna/neutral.jpg", "anna/happy_1.jpg", "anna/happy_2.jpg"]), expected);
    let (_, lacking) =
        pairs(&files(&["anna_neutral.jpg", "anna_happy.jpg", "anna_sad_1.jpg", "anna_smile.jpg", "anna-smile.jpg"]));
    let of = |file: &str| format!("{file} (several pictures of anna in `smile`)");
    assert_eq!(lacking, ["anna-smile.jpg", "anna_smile.jpg"].map(of));
}

#[test]
fn people_whose_names_differ_only_in_case_are_named() {
    let names = ["Carla_neutral.jpg", "Carla_happy.jpg", "carla_neutral.jpg", "carla_happy.jpg"];
    let said = refusal(&names);
    assert!(said.ends_with("this folder: names of people differ only in case: Carla and carla; rename one of them"), "{said}");
    let (rows, lacking) = pairs(&files(&[&names[..], &["ida_neutral.jpg", "Ida_sad.jpg"]].concat()));
    assert_eq!(rows, ["ida sad sadness ida_neutral.jpg;Ida_sad.jpg"]);
    assert_eq!((lacking.len(), lacking[0].as_str()), (4, "Carla_neutral.jpg (Carla and carla differ only in case; rename one)"));
}

#[test]
fn pictures_with_unknown_words_are_no_sequence() {
    let said = refusal(&["anna_before.jpg", "anna_after.jpg", "ben_before.jpg", "ben_after.jpg"]);
    assert!(said.contains("known word for an expression") && said.contains("anna_after.jpg; anna_before.jpg"), "{said}");
    let said = refusal(&["L001n.jpg", "L001h.jpg", "L002n.jpg", "L002h.jpg"]);
    assert!(said.contains("name the two pictures of a person like anna_neutral.jpg and anna_happy.jpg"), "{said}");
    for frames in [
        &["a_1.png", "b_2.png", "c_3.png"][..],
        &["1_cropped.png", "2_cropped.png", "3_cropped.png"],
        &["1.png", "2.png", "3.png", "cover.png", "title.png"],
        &["start.png", "apex.png"],
    ] {
        let names: Vec<String> = frames.iter().map(|name| format!("anna/x/{name}")).collect();
        assert_eq!(sequences(&names.iter().map(String::as_str).collect::<Vec<_>>()).len(), 1, "{frames:?}");
    }
}

#[test]
fn pictures_without_a_neutral_one_are_no_sequence() {
    let names = files(&["mix/L001_sad.jpg", "mix/L001_happy.jpg", "mix/L003_sad.jpg", "mix/L003_Trauer.jpg"]);
    let error = propose_manifest(folder(&names).path()).unwrap_err();
    assert!(matches!(&error, DatasetError::PicturesOfPeople { found, .. } if found.len() == 1), "{error}");
    let said = "`mix`: single pictures of several people: L001; L003; make a folder for every person and expression, with the neutral picture \
                as 1 and the other as 2";
    assert!(error.to_string().ends_with(said), "{error}");
    // A person twice in one folder.
    let twice = files(&["L001_neutral.jpg", "L001-neutral.jpg", "L001_happy.jpg"]);
    let error = propose_manifest(folder(&twice).path()).unwrap_err().to_string();
    assert!(error.contains("to L001/happiness/1.jpg and L001_happy.jpg to L001/happiness/2.jpg"), "{error}");
}

#[test]
fn frames_of_one_person_stay_a_sequence() {
    let taken = |names: &[String]| propose_manifest(folder(names).path()).unwrap().rows.len();
    let frames = |folders: &[&str], names: [&str; 2]| -> Vec<String> {
        folders.iter().flat_map(|folder| names.map(|name| format!("{folder}/{name}.png"))).collect()
    };
    assert_eq!(taken(&frames(&["S1/neutral", "S1/happy"], ["a001", "a002"])), 2, "the folder is named after a person");
    assert_eq!(taken(&frames(&["anna/neutral", "anna/happy"], ["1", "2"])), 2);
    assert_eq!(taken(&frames(&["anna/neutral", "anna/happy"], ["anna_001", "anna_002"])), 2);
    assert_eq!(taken(&frames(&["anna/neutral", "anna/happy", "ben/neutral", "ben/happy"], ["x01", "x02"])), 4);
    assert_eq!(taken(&frames(&["neutral", "happy"], ["frame_1", "frame_2"])), 2);
    assert_eq!(taken(&files(&["anna/neutral_1.png", "anna/happy_2.png"])), 1, "numbered from neutral to happy");
    let phases = files(&["anna/t_neutral_1.png", "anna/t_onset_2.png", "anna/t_happy_3.png", "anna/t_offset_4.png"]);
    assert_eq!(taken(&phases), 1, "phases between");
}

#[test]
fn files_of_the_same_names_in_the_folders_of_a_study_are_people() {
    let study = |name: &str, people: &[&str]| {
        let names: Vec<String> =
            ["neutral", "smiling"].iter().flat_map(|f| people.iter().map(move |p| format!("{name}/{f}/{p}.jpg"))).collect();
        let folder = folder(&names);
        propose_manifest(&folder.path().join(name)).unwrap()
    };
    // The name of the study looks like that of a person; numbers with gaps, or not from 1, do not count frames.
    for (name, people) in [
        ("ds3", ["L001", "L003", "L004"]),
        ("ds3", ["P001", "P002", "P003"]),
        ("faces", ["005", "006", "007"]),
        ("faces", ["1", "3", "4"]),
    ] {
        let manifest = study(name, &people);
        let subjects: Vec<&str> = manifest.rows.iter().map(|row| row.subject.as_str()).collect();
        assert_eq!(subjects, people, "{name}");
        assert!(manifest.rows[0].frames.ends_with(&format!("smiling/{}.jpg", people[0])), "{}", manifest.rows[0].frames);
        assert!(manifest.frames_or_people.is_empty());
    }
    // Numbered from 1 they may be either; that is said.
    let manifest = study("faces", &["001", "002", "003"]);
    assert_eq!((manifest.rows.len(), manifest.frames_or_people.as_slice()), (2, files(&["neutral/", "smiling/"]).as_slice()));
    assert!(study("faces", &["anna_1", "anna_2"]).frames_or_people.is_empty());
}

#[test]
fn without_readable_files_the_readable_formats_are_listed() {
    let error = propose_manifest(folder(&files(&["anna/1.HEIC", "anna/2.HEIC", "b.gif"])).path()).unwrap_err();
    assert!(matches!(&error, DatasetError::NothingReadable { files, .. } if files.len() == 3), "{error}");
    let said = error.to_string();
    assert!(said.contains("anna/1.HEIC; anna/2.HEIC; b.gif") && said.contains("png jpg") && said.contains("mp4"), "{said}");
}

#[test]
fn groups_of_people_are_paired_and_frames_of_one_person_each_are_not() {
    let of = |parent: &str, people: &[&str]| -> Vec<String> {
        ["neutral", "happy"].iter().flat_map(|f| people.iter().map(move |p| format!("{parent}/{f}/{p}.jpg"))).collect()
    };
    let sorted = [of("women", &["W01", "W02"]), of("men", &["anna", "M01", "M02"])].concat();
    let (rows, lacking) = pairs(&sorted);
    let row = |group: &str, p: &str| format!("{p} happy happiness {group}/neutral/{p}.jpg;{group}/happy/{p}.jpg");
    let expected = [row("men", "M01"), row("men", "M02"), row("women", "W01"), row("women", "W02"), row("men", "anna")];
    assert_eq!(rows, expected);
    assert!(lacking.is_empty(), "{lacking:?}");
    let (rows, _) = pairs(&[of("Women", &["W01", "W02"]), of("Men", &["M01", "M02"])].concat());
    assert_eq!((rows.len(), rows[0].as_str()), (4, row("Men", "M01").as_str()));
    // The same word everywhere, other numbers: people. The same numbers, or a word for each parent: frames of one person.
    let (rows, _) = pairs(&[of("london", &["P01", "P02"]), of("paris", &["P03", "P04"])].concat());
    assert_eq!((rows.len(), rows[0].as_str()), (4, row("london", "P01").as_str()));
    for frames in [
        [of("anna", &["P01", "P02"]), of("ben", &["P01", "P02"])].concat(),
        [of("anna", &["a1", "a2"]), of("ben", &["b1", "b2"])].concat(),
        [of("anna", &["001", "002"]), of("ben", &["003", "004"])].concat(),
    ] {
        let (rows, _) = pairs(&frames);
        assert_eq!(rows.first().map(String::as_str), Some("anna happy happiness anna/happy"), "{rows:?}");
    }
}

#[test]
fn stills_of_one_person_are_paired_whatever_their_numbers() {
    let (rows, lacking) = pairs(&files(&["p01/happy_01.jpg", "p01/neutral_02.jpg", "p02/happy_01.jpg", "p02/neutral_02.jpg"]));
    let row = |p: &str| format!("{p} happy happiness {p}/neutral_02.jpg;{p}/happy_01.jpg");
    assert_eq!(rows, [row("p01"), row("p02")]);
    assert!(lacking.is_empty(), "{lacking:?}");
    let (rows, _) = pairs(&files(&["anna/neutral_1.jpg", "anna/happy_2.jpg", "anna/sad_3.jpg"]));
    assert_eq!(rows.len(), 2, "{rows:?}");
    // Frames, of which only the first is called neutral.
    let (rows, _) = pairs(&files(&["anna/neutral_1.jpg", "anna/happy_2.jpg", "anna/happy_3.jpg"]));
    assert_eq!((rows.len(), rows[0].ends_with(" anna")), (1, true), "{rows:?}");
}

#[test]
fn pictures_of_several_people_with_numbers_alone_are_no_sequence() {
    let names: Vec<String> = ["p01", "p02", "p03"].iter().flat_map(|p| [1, 2].map(|k| format!("six/{p}_{k}.jpg"))).collect();
    let both = [names, files(&["S9/happy/1.png", "S9/happy/2.png"])].concat();
    let manifest = propose_manifest(folder(&both).path()).unwrap();
    assert_eq!((manifest.rows.len(), manifest.pictures_of_people.len()), (1, 1));
    assert!(manifest.pictures_of_people[0].to_string().contains("six"), "{}", manifest.pictures_of_people[0]);
}

#[test]
fn names_of_nimstim_are_paired() {
    let (rows, lacking) =
        pairs(&files(&["n/01F_NE_C.BMP", "n/01F_NE_O.BMP", "n/01F_HA_O.BMP", "n/22M_ne_c.bmp", "n/22M_sp_o.bmp"]));
    let expected = [
        "01F HA-O happiness n/01F_NE_C.BMP;n/01F_HA_O.BMP",
        "01F NE-O mouth_open n/01F_NE_C.BMP;n/01F_NE_O.BMP",
        "22M SP-O surprise n/22M_ne_c.bmp;n/22M_sp_o.bmp",
    ];
    assert_eq!(rows, expected);
    assert!(lacking.is_empty(), "{lacking:?}");
}
