//! Tests of every form of landmark file, valid and invalid.

use super::*;
use crate::wireframe::Tables;

/// Landmark k of frame f at (k, 1000 f + k).
fn row(frame: u32, count: u32) -> String {
    let points = (0..count).map(|k| format!(",{k},{}", 1000 * frame + k)).collect::<String>();
    format!("{frame}{points}\n")
}

fn header(count: u32) -> String {
    format!("frame{}\n", (0..count).map(|k| format!(",x{k},y{k}")).collect::<String>())
}

fn csv(text: &str) -> Result<LandmarkTrack, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("landmarks.csv");
    fs::write(&path, text).unwrap();
    read_landmarks(&path).map_err(|e| e.to_string())
}

#[test]
fn a_csv_file_reads() {
    let track = csv(&format!("{}{}{}", header(68), row(3, 68), row(1, 68))).unwrap();
    assert_eq!(track.frames.keys().copied().collect::<Vec<_>>(), [1, 3]);
    assert_eq!(track.frame(3).unwrap()[67], Point2::new(67.0, 3067.0));
    let error = track.frame(2).unwrap_err().to_string();
    assert!(error.ends_with(": frame 2 has no landmarks; 2 frames from 1 to 3 have them"), "{error}");
}

#[test]
fn other_counts_and_bad_numbers_are_refused() {
    let error = |text: String| csv(&text).unwrap_err();
    assert!(error(header(67) + &row(1, 67)).ends_with("67 points, 68 were expected (of MediaPipe 468 or 478)"));
    assert!(error(header(69) + &row(1, 69)).ends_with("69 points, 68 were expected (of MediaPipe 468 or 478)"));
    assert!(error(header(68) + &row(1, 67)).ends_with("line 2: the row has 135 fields, but the header has 137"));
    let inf = (header(68) + &row(1, 68)).replace("1,0,1000,", "1,0,inf,");
    assert!(error(inf).ends_with("line 2: y0 is `inf`; a finite number was expected"));
    let shares = (0..68).map(|k| format!(",0.{k:02},0.5")).collect::<String>();
    let shares = format!("{}1{shares}\n", header(68));
    assert!(error(shares.clone()).contains("line 2: the points are shares of the picture's width and height (0 to 1)"));
    let sized = shares.replace("y67\n", "y67,width,height\n").replace(",0.67,0.5\n", ",0.67,0.5,100,50\n");
    assert_eq!(csv(&sized).unwrap().frame(1).unwrap()[1], Point2::new(0.5, 24.5));
    let file = (0..68).map(|k| format!("0.{k:02} 0.5\n")).collect::<String>();
    let folder = text_folder(&[("a_1.txt", file)]);
    let found = read_landmarks(folder.path()).unwrap_err().to_string();
    assert!(found.ends_with("a_1.txt: the points are shares of the picture's width and height (0 to 1); multiply x by the width and y by the height, px"), "{found}");
    assert!(error(header(68) + &row(1, 68) + &row(1, 68)).contains("frame 1 appear twice"));
    assert!(error(header(68)).contains("no frame has landmarks"));
    assert!(error(header(68).replace("frame", "f")).contains("has no column `frame`"));
}

#[test]
fn a_frame_without_a_coordinate_is_lost() {
    for word in ["", "NaN", "nan", "NA", "n/a", "NULL"] {
        let text = header(68) + &row(1, 68) + &row(2, 68).replace("2,0,2000,", &format!("2,0,{word},")) + &row(3, 68);
        let track = csv(&text).unwrap();
        assert_eq!((track.frames.keys().copied().collect::<Vec<_>>(), &track.lost[..]), (vec![1, 3], &[2][..]), "{word}");
    }
    let all = header(68) + &row(1, 68).replace("1,0,1000,", "1,0,NA,");
    assert!(csv(&all).is_ok_and(|track| track.frames.is_empty() && track.lost == [1]));
}

fn text_folder(files: &[(&str, String)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

fn lines(count: u32) -> String {
    (0..count).map(|k| format!("   {k}.0000000e+00   {}.5e+01 \r\n", k + 1)).collect()
}

#[test]
fn text_files_per_frame_read() {
    let files = [("S1_2_00000001_landmarks.txt", lines(68)), ("S1_2_00000002_landmarks.txt", lines(68)), ("a.txt", lines(1))];
    let track = read_landmarks(text_folder(&files).path()).unwrap();
    assert_eq!(track.frames.len(), 2);
    // 3.5e+01 = 35.
    assert_eq!(track.frame(2).unwrap()[2], Point2::new(2.0, 35.0));
}

#[test]
fn bad_text_files_are_named() {
    let error = |name: &str, text: String| read_landmarks(text_folder(&[(name, text)]).path()).unwrap_err().to_string();
    assert!(
        error("a_1_landmarks.txt", lines(67))
            .ends_with("a_1_landmarks.txt: 67 points, 68 were expected (of MediaPipe 468 or 478)")
    );
    assert!(
        error("a_1_landmarks.txt", lines(2) + "3 nan\n")
            .ends_with("line 3: found `3 nan`; two finite numbers `x y` were expected")
    );
    assert!(error("a_1_landmarks.txt", "1 2 3\n".to_owned()).contains("line 1: found `1 2 3`"));
    assert!(error("a_landmarks.txt", lines(68)).contains("no frame number"));
    assert!(error("a.csv", lines(68)).contains("no frame has landmarks"));
    let two = text_folder(&[("a_1_landmarks.txt", lines(68)), ("b_01_landmarks.txt", lines(68))]);
    assert!(read_landmarks(two.path()).unwrap_err().to_string().contains("frame 1 appear twice"));
}

#[test]
fn landmarks_become_correspondences() {
    let tables = Tables::candide3();
    let points: Vec<_> = (0..68).map(|k| Point2::new(f64::from(k), -f64::from(k))).collect();
    let nodes = |selection| -> Vec<(u16, f64)> {
        let marks = correspondences_from_landmarks(&points, &tables, &selection).unwrap();
        marks.iter().map(|c| (c.node.0, c.position.x)).collect()
    };
    // Landmarks, from 0: outer eye corners 45 L, 36 R; inner 42 L, 39 R; mouth corners 54 L, 48 R; chin 8; brows' ends 26 and
    // 22 L, 17 and 21 R.
    let corners = [(20, 45.0), (23, 42.0), (53, 36.0), (56, 39.0), (31, 54.0), (64, 48.0), (10, 8.0)];
    let brows = [(15, 26.0), (17, 22.0), (48, 17.0), (50, 21.0)];
    assert_eq!(nodes(LandmarkSelection::Default), [&corners[..], &brows].concat());
    assert_eq!(nodes(LandmarkSelection::Nodes(vec![NodeId(10), NodeId(20)])), [(10, 8.0), (20, 45.0)]);
    // Counted in ibug68.csv: 21 rows are high; 32 are medium, one of them (27, the nasion) lies between two nodes.
    let (high, all) = (nodes(LandmarkSelection::High), nodes(LandmarkSelection::HighAndMedium));
    assert_eq!((high.len(), all.len()), (21, 21 + 32 - 1));
    assert_eq!(nodes(LandmarkSelection::Auto), all);
    assert!(all.iter().all(|&(_, landmark)| landmark as u8 != 27 && landmark as u8 != 1));
    let error = correspondences_from_landmarks(&points, &tables, &LandmarkSelection::Nodes(vec![NodeId(0)])).unwrap_err();
    assert!(error.to_string().starts_with("node 0 has no landmark; nodes with a landmark are 62 61 63"), "{error}");
}

/// A row as `OpenFace` writes it: blanks after commas, all x and then all y, zeros where the face is lost.
fn open_face(rows: &[(u32, f64, u8)]) -> String {
    let names = |axis: &str| (0..68).map(|k| format!(", {axis}_{k}")).collect::<String>();
    let header = format!("frame, face_id, timestamp, confidence, success, gaze_0_x{}{}, X_0, AU01_r\n", names("x"), names("y"));
    let row = |&(frame, confidence, success): &(u32, f64, u8)| {
        let point = |offset: u32| {
            let value = |k| if success == 1 { f64::from(k + offset) + 0.5 } else { 0.0 };
            (0..68).map(|k| format!(", {}", value(k))).collect::<String>()
        };
        format!("{frame}, 0, 0.04, {confidence}, {success}, 0.1{}{}, 3, 0.2\n", point(0), point(1000 * frame))
    };
    header + &rows.iter().map(row).collect::<String>()
}

#[test]
fn openface_reads_by_name_and_low_confidence_or_no_success_is_lost() {
    let track = csv(&open_face(&[(1, 0.98, 1), (2, 0.4, 1), (3, 0.9, 0), (4, 0.75, 1)])).unwrap();
    assert_eq!(track.frames.keys().copied().collect::<Vec<_>>(), [1, 4]);
    assert_eq!(track.lost, [2, 3]);
    assert_eq!(track.frame(4).unwrap()[10], Point2::new(10.5, 4010.5));
    let frames = track.sequence(None, None).unwrap().frames;
    assert_eq!(
        frames.iter().map(|f| (f.number, f.points.is_some())).collect::<Vec<_>>(),
        [(1, true), (2, false), (3, false), (4, true)]
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("o.csv");
    fs::write(&path, open_face(&[(1, 0.98, 1), (2, 0.4, 1)])).unwrap();
    assert!(read_landmarks_with(&path, 0.3).unwrap().lost.is_empty());
}

#[test]
fn of_several_faces_the_longest_or_the_one_asked_for_is_read() {
    // Face 1 is in frames 1 and 2, face 0 in frame 2 alone.
    let two =
        open_face(&[(1, 0.9, 1), (2, 0.9, 1), (2, 0.9, 1)]).replacen("\n1, 0,", "\n1, 1,", 1).replacen("\n2, 0,", "\n2, 1,", 1);
    assert_eq!(csv(&two).unwrap().frames.keys().copied().collect::<Vec<_>>(), [1, 2]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("o.csv");
    fs::write(&path, &two).unwrap();
    let of = |face| read_face(&path, 0.5, Some(face)).map(|track| track.frames.len()).map_err(|e| e.to_string());
    assert_eq!((of("0"), of("1")), (Ok(1), Ok(2)));
    assert!(of("7").unwrap_err().ends_with("no row has the `face_id` 7; choose from 0; 1"));
}

#[test]
fn rows_of_frame_0_are_pictures_in_order_or_faces_of_one_picture() {
    let pictures = csv(&open_face(&[(0, 0.9, 1), (0, 0.9, 0), (0, 0.9, 1)])).unwrap();
    assert_eq!((pictures.frames.keys().copied().collect::<Vec<_>>(), pictures.lost), (vec![1, 3], vec![2]));
    // Two faces of one picture: the second one is twice as large.
    let text = open_face(&[(0, 0.9, 1), (0, 0.9, 1)]);
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let numbers: Vec<String> = lines[2].split(", ").map(str::to_owned).collect();
    let larger = |k: usize, v: &String| match k {
        1 => "1".to_owned(),
        6.. => format!("{}", 2.0 * v.parse::<f64>().unwrap()),
        _ => v.clone(),
    };
    lines[2] = numbers.iter().enumerate().map(|(k, v)| larger(k, v)).collect::<Vec<_>>().join(", ");
    let faces = csv(&(lines.join("\n") + "\n")).unwrap();
    assert_eq!(faces.frame(0).unwrap()[10], Point2::new(21.0, 21.0));
}

#[test]
fn timestamps_are_the_times_of_the_frames() {
    let text = open_face(&[(1, 0.9, 1), (5, 0.9, 1)]).replacen("5, 0, 0.04", "5, 0, 0.2", 1);
    assert_eq!(csv(&text).unwrap().times, BTreeMap::from([(1, 0.04), (5, 0.2)]));
}

#[test]
fn mediapipes_points_are_read_in_pixels_and_in_shares() {
    let names: String = (0..478).map(|k| format!(",x{k},y{k},z{k}")).collect();
    let row = |scale: f64, size: &str| {
        let points: String = (0..478).map(|k| format!(",{},{},0", scale * f64::from(k), scale * f64::from(2 * k))).collect();
        format!("1{size}{points}\n")
    };
    let pixels = csv(&format!("frame{names}\n{}", row(1.0, ""))).unwrap();
    // The chin, landmark 8, is point 152.
    assert_eq!(pixels.frame(1).unwrap()[8], Point2::new(152.0, 304.0));
    let shares = csv(&format!("frame,width,height{names}\n{}", row(0.001, ",2000,1000"))).unwrap();
    let chin = shares.frame(1).unwrap()[8];
    assert!((chin.x - 303.5).abs() < 1e-9 && (chin.y - 303.5).abs() < 1e-9, "{chin}");
    let unknown = csv(&format!("frame{names}\n{}", row(0.001, ""))).unwrap_err();
    assert!(unknown.contains("line 2: the points are shares") && unknown.contains("`width`"), "{unknown}");
}

#[test]
fn rows_without_a_coordinate_are_lost() {
    let empty = format!("2{}\n", ",".repeat(136));
    let track = csv(&(header(68) + &row(1, 68) + &empty + &row(3, 68))).unwrap();
    assert_eq!((track.frames.len(), track.lost), (2, vec![2]));
    let half = row(2, 68).replace(",67,2067", ",,");
    assert_eq!(csv(&(header(68) + &row(1, 68) + &half)).unwrap().lost, [2]);
}

fn pts(count: u32) -> String {
    let points: String = (0..count).map(|k| format!("{k}.25 {}\n", k + 1)).collect();
    format!("version: 1\nn_points:  {count}\n{{\n{points}}}\n")
}

#[test]
fn pts_files_count_pixels_from_one() {
    let folder = text_folder(&[("a_0001.pts", pts(68)), ("a_0003.pts", pts(68)), ("notes.txt", "who 1\n".to_owned())]);
    let track = read_landmarks(folder.path()).unwrap();
    assert_eq!(track.frames.keys().copied().collect::<Vec<_>>(), [1, 3]);
    assert_eq!(track.files.len(), 2);
    // (2.25, 3) from 1 is (1.25, 2) from 0.
    assert_eq!(track.frame(1).unwrap()[2], Point2::new(1.25, 2.0));
    // The content counts, not the extension.
    let renamed = text_folder(&[("a_0001.txt", pts(68)), ("a_0002.txt", pts(68))]);
    assert_eq!(read_landmarks(renamed.path()).unwrap().frame(2).unwrap()[2], Point2::new(1.25, 2.0));
}

#[test]
fn bad_pts_files_say_line_and_what_was_expected() {
    let error = |text: String| read_landmarks(text_folder(&[("a_1.pts", text)]).path()).unwrap_err().to_string();
    assert!(error(pts(51)).ends_with("a_1.pts: 51 points, 68 were expected (of MediaPipe 468 or 478)"), "{}", error(pts(51)));
    assert!(error(pts(68).replace("68", "66")).contains("line 2: found `n_points: 66`; n_points: 68 was expected"));
    assert!(error(pts(68).replace("n_points:  68", "n_points:  many")).contains("a number of points was expected"));
    assert!(error(pts(68).replace('}', "")).contains("`}` after the last point was expected"));
    assert!(error(pts(68).replace("{\n", "")).contains("line 3: found `0.25 1`; `{` was expected"));
    assert!(error(pts(68).replace("3.25 4", "3,25 4")).contains("line 7: found `3,25 4`; write decimals with a point"));
    assert!(error("version: 1\n".to_owned()).contains("`{` was expected"));
    assert!(error(pts(68).replace("3.25 4", "3.25 inf")).contains("two finite numbers"));
    // Shares of the picture are found before pixels are counted from 0, with and without the lines above the points.
    let shares = (0..68).map(|k| format!("0.{k:02} 0.5\n")).collect::<String>();
    for above in ["version: 1\nn_points: 68\n", ""] {
        let found = error(format!("{above}{{\n{shares}}}\n"));
        assert!(found.contains("the points are shares of the picture's width and height"), "{found}");
    }
}

#[test]
fn decimal_commas_are_named() {
    let quoted = (header(68) + &row(1, 68)).replace("1,0,1000,", "1,\"0,5\",1000,");
    assert!(csv(&quoted).unwrap_err().ends_with("line 2: found `0,5`; write decimals with a point and columns with commas"));
    let bare = (header(68) + &row(1, 68)).replace("1,0,1000,", "1,0,5,1000,");
    assert!(csv(&bare).unwrap_err().contains("138 fields, but the header has 137; if there are decimal commas"));
    let text = read_landmarks(text_folder(&[("a_1_landmarks.txt", "1,5 2,5\n".to_owned())]).path()).unwrap_err();
    assert!(text.to_string().contains("line 1: found `1,5 2,5`; write decimals with a point"));
}

#[test]
fn tables_of_semicolons_may_have_decimal_commas() {
    let commas = header(68) + &row(1, 68) + &row(2, 68).replace("2,0,2000,", "2,0.5,2000,");
    let semicolons = format!("\u{feff}{}", commas.replace(',', ";").replace('.', ",").replace('\n', "\r\n"));
    assert!(semicolons.contains("\r\n2;0,5;2000;"));
    let track = csv(&semicolons).unwrap();
    assert_eq!((track.frame(2).unwrap()[0], track.frames), (Point2::new(0.5, 2000.0), csv(&commas).unwrap().frames));
    // Such a table is also found in a folder.
    let folder = text_folder(&[("a.csv", semicolons.clone()), ("marks.csv", "node;x;y\n1;2;3\n".to_owned())]);
    assert_eq!(read_landmarks(folder.path()).unwrap().frames.len(), 2);
    assert!(csv(&semicolons.replace("0,5", "")).unwrap().lost == [2]);
    let error = |found: &str| csv(&semicolons.replace("0,5", found)).unwrap_err();
    assert!(error("1.000,5").ends_with("line 3: x0 is `1.000,5`; a finite number was expected"), "{}", error("1.000,5"));
    assert!(error("0;5").ends_with("line 3: the row has 138 fields, but the header has 137"), "{}", error("0;5"));
}

#[test]
fn several_sets_in_one_folder_are_not_guessed_between() {
    let table = header(68) + &row(1, 68);
    let two = text_folder(&[("a.csv", table.clone()), ("b.csv", table.clone()), ("marks.csv", "node,x,y\n".to_owned())]);
    let error = read_landmarks(two.path()).unwrap_err().to_string();
    assert!(error.contains("more than one set of landmarks: a.csv, b.csv; name one"), "{error}");
    let mixed = text_folder(&[("a.csv", table.clone()), ("f_1.pts", pts(68))]);
    assert!(read_landmarks(mixed.path()).unwrap_err().to_string().contains("a.csv, 1 files per frame such as f_1.pts"));
    let one = text_folder(&[("a.csv", table), ("marks.csv", "node,x,y\n1,2,3\n".to_owned())]);
    assert_eq!(read_landmarks(one.path()).unwrap().frames.len(), 1);
    let other = text_folder(&[("a.dat", "hello\n".to_owned())]);
    assert!(read_landmarks(&other.path().join("a.dat")).unwrap_err().to_string().contains("is not a landmark file"));
}

fn numbers(frames: &[u32], lost: &[u32], first: Option<u32>, last: Option<u32>) -> Result<Vec<(u32, bool)>, String> {
    let track = LandmarkTrack {
        path: PathBuf::from("l.csv"),
        files: Vec::new(),
        frames: frames.iter().map(|&f| (f, vec![Point2::origin(); 68])).collect(),
        lost: lost.to_vec(),
        least_confidence: 0.75,
        times: BTreeMap::new(),
    };
    let sequence = track.sequence(first, last).map_err(|e| e.to_string())?;
    Ok(sequence.frames.iter().map(|f| (f.number, f.points.is_some())).collect())
}

#[test]
fn missing_frames_are_filled_in_as_lost() {
    assert_eq!(numbers(&[1, 2, 4], &[], None, None).unwrap(), [(1, true), (2, true), (3, false), (4, true)]);
    // A neutral and an apex alone lack nothing; neither does every tenth frame.
    assert_eq!(numbers(&[1, 24], &[], None, None).unwrap(), [(1, true), (24, true)]);
    assert_eq!(numbers(&[10, 20, 40], &[], None, None).unwrap().len(), 4);
    assert_eq!(numbers(&[1, 2, 3, 4], &[], Some(2), Some(3)).unwrap(), [(2, true), (3, true)]);
}

#[test]
fn sequences_without_ends_or_mostly_lost_are_refused() {
    let error = |frames: &[u32], lost: &[u32], first, last| numbers(frames, lost, first, last).unwrap_err();
    let all = error(&[], &[1, 2, 3], None, None);
    assert_eq!(all, "l.csv: the face is lost in all 3 frames (no success, a confidence under 0.75, or a coordinate missing)");
    let neutral = error(&[2, 3], &[1], None, None);
    assert!(neutral.contains("lost in frame 1, the neutral frame; choose another `first_frame` (found in frames 2 to 3)"));
    assert!(error(&[1, 2], &[3], None, None).contains("frame 3, the apex frame; choose another `last_frame`"));
    assert!(error(&[1, 2], &[], None, Some(9)).contains("frame 9 has no landmarks; 2 frames from 1 to 2 have them"));
    assert!(error(&[1], &[], None, None).contains("1 frame from neutral to apex"));
    assert!(error(&[1, 2], &[], Some(2), None).contains("1 frame from neutral to apex"));
    assert!(error(&[1, 2, 1_000_000_000], &[], None, None).contains("only 3 of 1000000000 frames from 1 to 1000000000"));
}
