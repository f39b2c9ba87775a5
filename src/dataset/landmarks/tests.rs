//! Every form of landmark file, good and bad.

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
    assert!(error.ends_with(": frame 2 has no landmarks; there are 2 frames from 1 to 3"), "{error}");
}

#[test]
fn other_counts_and_bad_numbers_are_refused() {
    let error = |text: String| csv(&text).unwrap_err();
    assert!(error(header(67) + &row(1, 67)).ends_with("67 points, 68 were expected"));
    assert!(error(header(69) + &row(1, 69)).ends_with("69 points, 68 were expected"));
    assert!(error(header(68) + &row(1, 67)).ends_with("line 2: the row has 135 fields where the header has 137"));
    let nan = (header(68) + &row(1, 68)).replace("1,0,1000,", "1,0,NaN,");
    assert!(error(nan).ends_with("line 2: y0 is `NaN`; a finite number was expected"));
    assert!(error(header(68) + &row(1, 68) + &row(1, 68)).contains("frame 1 are there twice"));
    assert!(error(header(68)).contains("no landmarks of any frame"));
    assert!(error(header(68).replace("frame", "f")).contains("has no column `frame`"));
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
    assert!(error("a_1_landmarks.txt", lines(67)).ends_with("a_1_landmarks.txt: 67 points, 68 were expected"));
    assert!(
        error("a_1_landmarks.txt", lines(2) + "3 nan\n")
            .ends_with("line 3: found `3 nan`; two finite numbers `x y` were expected")
    );
    assert!(error("a_1_landmarks.txt", "1 2 3\n".to_owned()).contains("line 1: found `1 2 3`"));
    assert!(error("a_landmarks.txt", lines(68)).contains("no frame number"));
    assert!(error("a.csv", lines(68)).contains("no landmarks of any frame"));
    let two = text_folder(&[("a_1_landmarks.txt", lines(68)), ("b_01_landmarks.txt", lines(68))]);
    assert!(read_landmarks(two.path()).unwrap_err().to_string().contains("frame 1 are there twice"));
}

#[test]
fn landmarks_become_correspondences() {
    let tables = Tables::candide3();
    let points: Vec<_> = (0..68).map(|k| Point2::new(f64::from(k), -f64::from(k))).collect();
    let nodes = |selection| -> Vec<(u16, f64)> {
        let marks = correspondences_from_landmarks(&points, &tables, &selection).unwrap();
        marks.iter().map(|c| (c.node.0, c.position.x)).collect()
    };
    // Landmarks, from 0: outer eye corners 45 L, 36 R; inner 42 L, 39 R; mouth corners 54 L, 48 R; chin 8.
    let default = [(20, 45.0), (23, 42.0), (53, 36.0), (56, 39.0), (31, 54.0), (64, 48.0), (10, 8.0)];
    assert_eq!(nodes(LandmarkSelection::Default), default);
    assert_eq!(nodes(LandmarkSelection::Nodes(vec![NodeId(10), NodeId(20)])), [(10, 8.0), (20, 45.0)]);
    // Counted in ibug68.csv: 21 rows are high; 32 are medium, one of them (27, the nasion) lies between two nodes.
    let (high, all) = (nodes(LandmarkSelection::High), nodes(LandmarkSelection::HighAndMedium));
    assert_eq!((high.len(), all.len()), (21, 21 + 32 - 1));
    assert!(all.iter().all(|&(_, landmark)| landmark as u8 != 27 && landmark as u8 != 1));
    let error = correspondences_from_landmarks(&points, &tables, &LandmarkSelection::Nodes(vec![NodeId(0)])).unwrap_err();
    assert!(error.to_string().starts_with("no landmark marks node 0; nodes with one are 62 61 63"), "{error}");
}
