//! Track files: `SUBJECT_SEQUENCE.csv` with every node of every frame, and a `.json` beside it with its sources and options.

mod error;
mod info;
mod read;

use std::{io::Write, path::Path};

pub use self::{
    error::TrackFileError,
    info::{TRACK_SCHEMA, TrackInfo, parse_track_info, read_track_info, seconds_of, track_units},
    read::{neutral_first, parse_track, read_track},
};
use super::TrackedFrame;
use crate::output::{self, OutputError, nine_digits};

/// Steps per px to which expected errors are rounded in files.
const EXPECTED_STEPS: f64 = 1000.0;

/// Returns the bytes of a track's `.csv`: its frames by ascending number.
pub fn track_csv(frames: &[TrackedFrame]) -> Vec<u8> {
    let mut ascending: Vec<&TrackedFrame> = frames.iter().collect();
    ascending.sort_by_key(|frame| frame.number);
    let mut out = Vec::with_capacity(frames.len() * 113 * 48);
    out.extend_from_slice(b"frame,node,x,y,state,residual,expected_error\n");
    for frame in ascending {
        for (k, node) in frame.nodes.iter().enumerate() {
            let (x, y) = (nine_digits(node.position.x), nine_digits(node.position.y));
            let residual = node.residual.map(nine_digits).unwrap_or_default();
            let expected =
                node.expected_error.map(|e| nine_digits((e * EXPECTED_STEPS).round() / EXPECTED_STEPS)).unwrap_or_default();
            // Writing to a vector cannot fail.
            let _ = writeln!(out, "{},{k},{x},{y},{},{residual},{expected}", frame.number, node.state);
        }
    }
    out
}

/// BLAKE3 hashes of the two files of a track, in hexadecimal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrackHashes {
    /// Hash of the `.csv`.
    pub csv: String,
    /// Hash of the `.json`.
    pub json: String,
}

/// Writes `STEM.csv` and `STEM.json` into a folder. The JSON is written last, so that its presence means a complete track. The first of
/// `frames` is the neutral frame and the last the apex, unless `info` names others.
///
/// ```
/// # use grimace::{sequence::ImageSize, units::SequenceId};
/// # let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let track = grimace::track::read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("track.csv");
/// # let mut info = grimace::track::TrackInfo {
/// #     schema_version: 2,
/// #     made_by: "an example".to_owned(),
/// #     units: Default::default(),
/// #     id: SequenceId { subject: "S001".to_owned(), sequence: "005".to_owned() },
/// #     emotion: "happiness".to_owned(),
/// #     metadata: Default::default(),
/// #     source: vec![],
/// #     image_size: ImageSize { width: 320, height: 320 },
/// #     fps: Some(25.0),
/// #     times: None,
/// #     notes: vec![],
/// #     marks_from: "file".to_owned(),
/// #     marks: vec![],
/// #     read: vec![],
/// #     fit: Default::default(),
/// #     track: Default::default(),
/// #     summary: grimace::track::summarize(&track, &wireframe, &tables),
/// #     inputs_blake3: String::new(),
/// #     frames_blake3: None,
/// #     csv_blake3: String::new(),
/// #     neutral_frame: None,
/// #     apex_frame: None,
/// #     corrections: None,
/// # };
/// use grimace::track::{read_track, write_track};
///
/// // `track` holds the ten frames of a smile, `info` what it was made from.
/// write_track(&path, &track, &mut info)?;
/// assert!(path.with_extension("json").exists());
/// assert_eq!(read_track(&path)?.len(), track.len());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`OutputError`].
pub fn write_track(csv_path: &Path, frames: &[TrackedFrame], info: &mut TrackInfo) -> Result<(), OutputError> {
    write_hashed_track(csv_path, frames, info).map(|_| ())
}

/// As [`write_track`]. Returns the hashes of both files.
///
/// # Errors
/// [`OutputError`].
pub(crate) fn write_hashed_track(
    csv_path: &Path,
    frames: &[TrackedFrame],
    info: &mut TrackInfo,
) -> Result<TrackHashes, OutputError> {
    let csv = output::write_hashed(csv_path, |out| out.write_all(&track_csv(frames)))?.to_hex().to_string();
    info.csv_blake3.clone_from(&csv);
    info.neutral_frame = info.neutral_frame.or(frames.first().map(|f| f.number));
    info.apex_frame = info.apex_frame.or(frames.last().map(|f| f.number));
    let json = output::write_hashed(&csv_path.with_extension("json"), |out| output::json_into(out, info))?;
    Ok(TrackHashes { csv, json: json.to_hex().to_string() })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use nalgebra::Point2;

    use super::*;
    use crate::track::{LossReason, NodeState, TrackedNode};

    fn frames() -> Vec<TrackedFrame> {
        let node = |x: f64, state, residual| TrackedNode::new(Point2::new(x, 1.5), state, residual);
        let expecting = |node| TrackedNode { expected_error: Some(0.75), ..node };
        vec![
            TrackedFrame { number: 3, nodes: vec![node(0.1, NodeState::Marked, Some(0.25)), node(1.0, NodeState::Fitted, None)] },
            TrackedFrame {
                number: 4,
                nodes: vec![
                    expecting(node(1.0 / 3.0, NodeState::Tracked, Some(0.01))),
                    node(-2.0, NodeState::Recovered(LossReason::Klt), None),
                ],
            },
        ]
    }

    fn read(text: &str) -> Result<Vec<TrackedFrame>, TrackFileError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        fs::write(&path, text).unwrap();
        read_track(&path)
    }

    #[test]
    fn a_truncated_track_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        let mut all = frames();
        all.push(TrackedFrame { number: 5, ..all[1].clone() });
        let whole = track_csv(&all);
        let hash = blake3::hash(&whole).to_hex().to_string();
        let json = format!(r#"{{"neutral_frame": 3, "apex_frame": 5, "csv_blake3": "{hash}"}}"#);
        fs::write(path.with_extension("json"), json).unwrap();
        let said = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            read_track(&path).map(|frames| frames.len()).map_err(|error| error.to_string())
        };
        assert_eq!(said(&whole), Ok(3));
        // At the end of a frame.
        let text = String::from_utf8(whole.clone()).unwrap();
        let first = text.split_inclusive('\n').filter(|line| !line.starts_with("5,")).collect::<String>();
        assert!(
            said(first.as_bytes()).unwrap_err().contains("it has no frame 5, which the .json beside it names as the apex frame")
        );
        // Cut within its last line; a changed value is accepted, because a user may edit it.
        let within = text.replace("0.75", "0.5");
        assert_eq!(said(within.as_bytes()), Ok(3));
        assert!(said(within.trim_end().as_bytes()).unwrap_err().contains("the last value may be incomplete"));
    }

    #[test]
    fn a_track_is_written_with_nine_digits_and_read_back() {
        let text = String::from_utf8(track_csv(&frames())).unwrap();
        assert_eq!(
            text,
            "frame,node,x,y,state,residual,expected_error\n3,0,0.1,1.5,marked,0.25,\n3,1,1,1.5,fitted,,\n\
             4,0,0.333333333,1.5,tracked,0.01,0.75\n4,1,-2,1.5,recovered_klt,,\n"
        );
        let back = read(&text).unwrap();
        assert_eq!(back[1].nodes[1], frames()[1].nodes[1]);
        assert!((back[1].nodes[0].position.x - 1.0 / 3.0).abs() < 1e-9);
    }

    #[test]
    fn frames_are_in_the_order_in_which_they_were_tracked() {
        let numbers = |neutral| {
            let frames = [1, 2, 5, 7].map(|number| TrackedFrame { number, nodes: Vec::new() });
            neutral_first(frames.to_vec(), neutral).iter().map(|f| f.number).collect::<Vec<_>>()
        };
        assert_eq!(numbers(None), [1, 2, 5, 7]);
        assert_eq!(numbers(Some(1)), [1, 2, 5, 7]);
        assert_eq!(numbers(Some(7)), [7, 5, 2, 1]);
        assert_eq!(numbers(Some(5)), [5, 7, 2, 1]);
        assert_eq!(numbers(Some(6)), [1, 2, 5, 7]);
        // Written frames ascend.
        let mut back = frames();
        back.reverse();
        assert_eq!(track_csv(&back), track_csv(&frames()));
    }

    #[test]
    fn a_normalized_model_is_no_track() {
        // Chin, outer corner of the left and of the right eye: with y up about the nose, and the same in a picture.
        let table = |place: fn(f64, f64) -> (f64, f64)| {
            let at = |node: usize| match node {
                10 => place(0.0, -1400.0),
                20 => place(780.0, 250.0),
                53 => place(-780.0, 250.0),
                _ => place(0.0, 0.0),
            };
            let row = |k: usize| format!("{},{},{},{}\n", k / 54, k % 54, at(k % 54).0, at(k % 54).1);
            format!("frame,node,x,y\n{}", (0..108).map(row).collect::<String>())
        };
        let error = read(&table(|x, y| (x, y))).unwrap_err().to_string();
        assert!(error.contains("t.csv: this is a normalized model in face units, not a track"), "{error}");
        assert_eq!(read(&table(|x, y| (0.1 * x + 320.0, 240.0 - 0.1 * y))).unwrap().len(), 2);
    }

    #[test]
    fn bad_rows_are_named_by_line_and_value() {
        let message = |text: &str| read(text).unwrap_err().to_string();
        assert!(message("frame,node,x\n1,0,1\n").contains("t.csv, line 1: has no column `y`"));
        assert!(message("frame,node,x,y\n1,0,1,nan\n").contains("t.csv, line 2: y is `nan`"));
        assert!(message("frame,node,x,y,state\n1,0,1,1,lost\n").contains("t.csv, line 2: `lost` is not a node state"));
        assert!(message("frame,node,x,y,expected_error\n1,0,1,1,much\n").contains("expected_error is `much`"));
        assert!(message("frame,node,x,y\n2,0,1,1\n1,0,1,1\n").contains("frames must ascend"));
        assert!(message("").contains("t.csv: is empty"));
    }
}
