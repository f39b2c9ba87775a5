//! Files of a segmented recording: tables, marks, pictures, and the table of segments, which is a manifest.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use image::RgbImage;
use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::{Recording, RecordingError, RecordingFrame, RecordingStep, Segment, SegmentedRecording, Tick, kept::free_edited};
use crate::{
    correspondence::write_correspondences,
    features::{ACTION_UNITS, OPENFACE_UNITS, OpenFaceFace, OpenFaceRow, measured, openface_csv, unit_column},
    fit::MarkKind,
    input::record_at,
    output::{self, MADE_BY, OutputError, is_inside, nine_digits, write_records},
    overlay::{png_bytes, thumbnail},
    pipeline::Workbench,
    segment::SegmentOptions,
    sequence::{SequenceReader, colour_of, content_blake3},
};

/// Version of the record of a recording.
const SCHEMA: u32 = 2;
/// Height of the faces of a segment's picture, px.
const PICTURE_HEIGHT: u32 = 320;
/// Columns of a table of segments.
pub const SEGMENT_COLUMNS: [&str; 9] =
    ["subject", "sequence", "emotion", "frames", "first_frame", "last_frame", "correspondences", "fps", "confidence"];

/// Record of a segmented recording, stored as `STEM.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RecordingFiles {
    schema_version: u32,
    made_by: String,
    units: BTreeMap<String, String>,
    /// BLAKE3 of all inputs.
    inputs_blake3: String,
    /// Frames per second; the mean if `uneven`.
    pub fps: f64,
    /// Whether frame intervals vary, so that each frame has its own time.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub uneven: bool,
    /// Number of all frames and of those with a tracked face.
    pub frames: [usize; 2],
    /// The sequences.
    pub segments: Vec<Segment>,
    /// Notes to the user.
    pub notes: Vec<String>,
    /// BLAKE3 of the other files.
    files: BTreeMap<String, String>,
}

/// What is written of a recording beside the table of its frames and the marks of its sequences.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordingOutputs {
    /// Pictures of the sequences, which show the face.
    pub pictures: bool,
    /// `STEM_openface.csv`: a row for every frame, with the columns that readers of `OpenFace`'s files expect.
    pub openface: bool,
}

/// Columns of a table of segments that are equal for all sequences of a recording.
#[derive(Clone, Debug)]
pub struct ManifestColumns {
    /// The subject.
    pub subject: String,
    /// Label.
    pub emotion: String,
    /// The recording, as named in the table.
    pub frames: String,
}

/// BLAKE3 of everything that the segments of a recording depend on. `content` is the hash of its files.
fn inputs_of(recording: &Recording, content: &str, options: &SegmentOptions, bench: &Workbench) -> String {
    let mut hasher = blake3::Hasher::new();
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    part(MADE_BY.as_bytes());
    let pose = bench.options.normalize.pose;
    let depends = (SCHEMA, options, &bench.options.fit, &bench.options.track, pose, &bench.wireframe_blake3, recording.fps);
    part(&serde_json::to_vec(&depends).unwrap_or_default());
    part(recording.stem.as_bytes());
    if let Some((frame, marks)) = &recording.marks {
        part(&frame.to_le_bytes());
        for mark in marks {
            part(&mark.node.0.to_le_bytes());
            part(&[u8::from(mark.kind == MarkKind::Hard), u8::from(mark.expected_error.is_some())]);
            part(&mark.position.x.to_le_bytes());
            part(&mark.position.y.to_le_bytes());
            part(&mark.expected_error.unwrap_or_default().to_le_bytes());
        }
    }
    part(content.as_bytes());
    hasher.finalize().to_hex().to_string()
}

/// Reads the record of a recording from a folder, if a readable one exists. A record of a later version is an error.
fn record_of(folder: &Path, stem: &str) -> Result<Option<RecordingFiles>, RecordingError> {
    let path = folder.join(format!("{stem}.json"));
    record_at(&path, SCHEMA).map_err(|source| RecordingError::Newer { path, source })
}

/// State of a file since it was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Since {
    Unchanged,
    Edited,
    Gone,
}

fn since(folder: &Path, name: &str, hash: &str) -> Since {
    match crate::input::read(&folder.join(name)) {
        Ok(bytes) if blake3::hash(&bytes).to_hex().as_str() == hash => Since::Unchanged,
        Ok(_) => Since::Edited,
        Err(_) => Since::Gone,
    }
}

impl RecordingFiles {
    fn is_picture(name: &str) -> bool {
        is_inside(name) && Path::new(name).extension().is_some_and(|e| e == "png")
    }

    /// Whether a file holds the marks of a sequence. Users may correct such files.
    fn is_marks(&self, name: &str) -> bool {
        self.segments.iter().any(|segment| name.strip_suffix(".csv") == Some(&segment.name))
    }

    /// Whether the record can be reused: what is wanted exists, and all files are unchanged except corrected marks.
    fn is_whole(&self, folder: &Path, (stem, outputs): (&str, RecordingOutputs)) -> bool {
        if outputs.openface && !self.files.contains_key(&openface_name(stem)) {
            return false;
        }
        let lacks_pictures =
            outputs.pictures && !self.segments.is_empty() && !self.files.keys().any(|name| Self::is_picture(name));
        // Pictures cannot be made without replacing the marks, and corrected marks are more valuable.
        let marks = self.files.iter().filter(|(name, _)| self.is_marks(name));
        let is_corrected = marks.clone().any(|(name, hash)| since(folder, name, hash) == Since::Edited);
        let stands = |(name, hash): (&String, &String)| match since(folder, name, hash) {
            Since::Unchanged => true,
            Since::Edited => self.is_marks(name),
            Since::Gone => is_corrected && Self::is_picture(name),
        };
        (!lacks_pictures || is_corrected) && self.files.iter().all(stands)
    }
}

/// Returns the earlier [`RecordingFiles`] if they have the same inputs and all files are unchanged, except marks that the user corrected,
/// which stay. Existing pictures that are not wanted are removed.
///
/// # Errors
/// [`RecordingError`] when the recording cannot be read or a picture cannot be removed.
pub fn reuse_recording(
    folder: &Path,
    recording: &Recording,
    options: &SegmentOptions,
    bench: &Workbench,
    outputs: RecordingOutputs,
) -> Result<Option<RecordingFiles>, RecordingError> {
    let Some(files) = record_of(folder, &recording.stem)? else { return Ok(None) };
    let inputs = recording_inputs_blake3(recording, options, bench)?;
    if files.inputs_blake3 != inputs || !files.is_whole(folder, (&recording.stem, outputs)) {
        return Ok(None);
    }
    if outputs.pictures { Ok(Some(files)) } else { withdraw_pictures(folder, &recording.stem, files).map(Some) }
}

/// Removes the unchanged pictures of a recording from the folder and from its record, when its person may no longer be shown.
fn withdraw_pictures(folder: &Path, stem: &str, mut files: RecordingFiles) -> Result<RecordingFiles, RecordingError> {
    let pictures: Vec<String> = files.files.keys().filter(|name| RecordingFiles::is_picture(name)).cloned().collect();
    if pictures.is_empty() {
        return Ok(files);
    }
    for name in pictures {
        if let Some(hash) = files.files.remove(&name)
            && since(folder, &name, &hash) == Since::Unchanged
        {
            let path = folder.join(&name);
            std::fs::remove_file(&path).map_err(OutputError::at(&path))?;
        }
    }
    output::write_json(&folder.join(format!("{stem}.json")), &files)?;
    Ok(files)
}

/// Prepares a new segmentation: removes earlier files, and renames corrected marks. Returns messages about these.
fn make_room(folder: &Path, stem: &str) -> Result<Vec<String>, RecordingError> {
    let mut notes = Vec::new();
    let Some(old) = record_of(folder, stem)? else { return Ok(notes) };
    for (name, hash) in old.files.iter().filter(|(name, _)| is_inside(name)) {
        let path = folder.join(name);
        match since(folder, name, hash) {
            Since::Unchanged => std::fs::remove_file(&path).map_err(OutputError::at(&path))?,
            Since::Edited if old.is_marks(name) => {
                let free = free_edited(&path);
                std::fs::rename(&path, &free).map_err(OutputError::at(&path))?;
                let kept = free.file_name().unwrap_or_default().to_string_lossy();
                notes.push(format!(
                    "the marks in {name} were edited; they are kept as {kept}, because the recording is segmented again"
                ));
            }
            Since::Edited | Since::Gone => {}
        }
    }
    // An incomplete file of this run must not count as a user's correction later.
    let record = folder.join(format!("{stem}.json"));
    std::fs::remove_file(&record).map_err(OutputError::at(&record))?;
    Ok(notes)
}

/// BLAKE3 of everything that the segments of a recording depend on.
///
/// # Errors
/// [`RecordingError`] when the recording cannot be read.
pub fn recording_inputs_blake3(
    recording: &Recording,
    options: &SegmentOptions,
    bench: &Workbench,
) -> Result<String, RecordingError> {
    let content = content_blake3(&recording.frames)?.to_hex().to_string();
    Ok(inputs_of(recording, &content, options, bench))
}

/// Writes a segmented recording into a folder: `STEM_frames.csv`, then `STEM-01.csv` (marks) of every segment, what `outputs` names, and
/// `STEM.json` last.
///
/// # Errors
/// [`RecordingError`] when a file cannot be written or the recording cannot be read again.
pub fn write_recording(
    folder: &Path,
    (recording, found): (&Recording, &SegmentedRecording),
    options: &SegmentOptions,
    bench: &Workbench,
    outputs: RecordingOutputs,
    tick: Tick<'_>,
) -> Result<RecordingFiles, RecordingError> {
    let mut notes = found.notes.clone();
    notes.extend(make_room(folder, &found.stem)?);
    let mut files = BTreeMap::new();
    let table = format!("{}_frames.csv", found.stem);
    let (header, rows) = frames_table(found);
    let hash = write_records(&folder.join(&table), header, rows)?;
    files.insert(table, hash.to_hex().to_string());
    if outputs.openface {
        let (header, rows) = openface_table(found);
        let hash = write_records(&folder.join(openface_name(&found.stem)), header, rows)?;
        files.insert(openface_name(&found.stem), hash.to_hex().to_string());
    }
    for segment in &found.segments {
        let name = format!("{}.csv", segment.name);
        write_correspondences(&folder.join(&name), &segment.marks)?;
        let bytes = crate::input::read(&folder.join(&name)).map_err(OutputError::at(&folder.join(&name)))?;
        files.insert(name, blake3::hash(&bytes).to_hex().to_string());
    }
    if outputs.pictures {
        for (name, picture) in segment_pictures(recording, found, bench, tick)? {
            let path = folder.join(&name);
            let bytes = png_bytes(&picture).map_err(|e| OutputError::at(&path)(std::io::Error::other(e)))?;
            output::write_bytes(&path, &bytes)?;
            files.insert(name, blake3::hash(&bytes).to_hex().to_string());
        }
    }
    let record = RecordingFiles {
        schema_version: SCHEMA,
        made_by: MADE_BY.to_owned(),
        units: units(outputs),
        inputs_blake3: inputs_of(recording, &found.content_blake3, options, bench),
        fps: found.fps,
        uneven: found.clock.times.is_some(),
        frames: [found.frame_count, found.frames.len()],
        segments: found.segments.clone(),
        notes,
        files,
    };
    output::write_json(&folder.join(format!("{}.json", found.stem)), &record)?;
    Ok(record)
}

/// Name of the table for readers of `OpenFace`'s files.
fn openface_name(stem: &str) -> String {
    format!("{stem}_openface.csv")
}

/// Units of the columns.
fn units(outputs: RecordingOutputs) -> BTreeMap<String, String> {
    let mut units = frames_units();
    if outputs.openface {
        let own = units.keys().flat_map(|key| key.split(", ")).map(str::to_owned).collect::<Vec<_>>();
        let others = OPENFACE_UNITS.iter().filter(|(key, _)| key.split(", ").any(|name| !own.iter().any(|known| known == name)));
        units.extend(others.map(|&(key, unit)| (key.to_owned(), unit.to_owned())));
    }
    units
}

fn frames_units() -> BTreeMap<String, String> {
    [
        ("frame", "number of the frame"),
        ("timestamp", "s from the first frame of the recording"),
        ("stretch", "number of the stretch between cuts and lost faces"),
        ("phase", "rest, onset, apex, offset, or other (speech, a blink, a frame that cannot be used)"),
        ("activity", "norm of the intensities above those at rest, 0 to 5 each; without a rest, of the intensities"),
        ("success, reason", "1, or 0 where `reason` says why the row is not to be used"),
        ("pose_yaw, pose_pitch, pose_roll", "degrees"),
        ("eye_opening_*", "over the opening at rest"),
        ("mouth_opening", "distance of the inner lips over MNS0"),
        ("AU.._r", "intensity 0 to 5"),
        ("*_frame", "number of a frame"),
        (
            "confidence",
            "of a frame: share of the nodes that were seen, 0 to 1; of a sequence: how sure it is that this is an expression from rest to \
             apex, 0 to 1",
        ),
    ]
    .into_iter()
    .map(|(k, v)| (k.to_owned(), v.to_owned()))
    .collect()
}

/// Header and rows of the table of frames.
fn frames_table(found: &SegmentedRecording) -> (Vec<String>, Vec<Vec<String>>) {
    let fixed = [
        "frame",
        "timestamp",
        "stretch",
        "phase",
        "activity",
        "success",
        "reason",
        "pose_yaw",
        "pose_pitch",
        "pose_roll",
        "eye_opening_left",
        "eye_opening_right",
        "mouth_opening",
    ];
    let units = ACTION_UNITS.iter().map(|u| unit_column(u.number, "r"));
    let header = fixed.into_iter().map(str::to_owned).chain(units).chain(["confidence".to_owned()]);
    let number = measured;
    let row = |frame: &RecordingFrame| {
        let m = &frame.measured;
        let mut row = vec![
            m.number.to_string(),
            found.seconds(m.number).map(number).unwrap_or_default(),
            frame.stretch.to_string(),
            frame.phase.name().to_owned(),
            number(frame.activity),
            u8::from(m.reason.is_none()).to_string(),
            m.reason.clone().unwrap_or_default(),
        ];
        let measured = m.pose.iter().chain(&m.eyes).chain([&m.mouth]).chain(&m.units).chain([&m.confidence]);
        row.extend(measured.map(|&value| number(f64::from(value))));
        row
    };
    (header.collect(), found.frames.iter().map(row).collect())
}

/// Header and rows of the table for readers of `OpenFace`'s files: a row for every frame of the recording, also without a face.
fn openface_table(found: &SegmentedRecording) -> (Vec<String>, Vec<Vec<String>>) {
    let numbers: Vec<u8> = ACTION_UNITS.iter().map(|unit| unit.number).collect();
    let of_frame = |frame: &RecordingFrame| {
        let (measured, shown) = (&frame.measured, &frame.shown);
        let units = numbers.iter().zip(measured.units).zip(shown.present);
        let landmarks = shown.landmarks.iter().map(|p| p.map(|[x, y]| Point2::new(f64::from(x), f64::from(y))));
        OpenFaceFace {
            confidence: f64::from(measured.confidence),
            success: measured.reason.is_none(),
            pose: measured.pose.map(f64::from),
            landmarks: landmarks.collect(),
            units: units.map(|((&number, value), present)| (number, f64::from(value), present)).collect(),
        }
    };
    let mut seen = found.frames.iter().peekable();
    let rows = found.numbers().map(|number| {
        let face = seen.next_if(|frame| frame.measured.number == number).map(of_frame);
        OpenFaceRow { frame: number, seconds: found.seconds(number), face }
    });
    openface_csv(rows, &numbers)
}

/// Pictures of every segment: neutral and apex frame side by side, with the wireframe.
fn segment_pictures(
    recording: &Recording,
    found: &SegmentedRecording,
    bench: &Workbench,
    tick: Tick<'_>,
) -> Result<Vec<(String, RgbImage)>, RecordingError> {
    let mut pictures: BTreeMap<u32, RgbImage> = BTreeMap::new();
    let wanted = |number: u32| found.segments.iter().any(|s| s.neutral_frame == number || s.apex_frame == number);
    if !found.segments.is_empty() {
        for frame in SequenceReader::open(&recording.frames)? {
            let frame = frame?;
            if !tick(RecordingStep::Drawing, 1, Some(found.frame_count)) {
                return Err(RecordingError::Interrupted);
            }
            let Some(seen) = found.frames.iter().find(|f| f.measured.number == frame.number() && wanted(frame.number())) else {
                continue;
            };
            let nodes = seen.nodes.expanded(1.0).nodes;
            let plain = colour_of(frame.image());
            pictures.insert(frame.number(), thumbnail(&plain, &bench.wireframe, &nodes, PICTURE_HEIGHT));
        }
    }
    let pair = |segment: &Segment| {
        let (a, b) = (pictures.get(&segment.neutral_frame)?, pictures.get(&segment.apex_frame)?);
        let mut both = RgbImage::from_pixel(a.width() + b.width() + 8, a.height().max(b.height()), image::Rgb([255; 3]));
        image::imageops::replace(&mut both, a, 0, 0);
        image::imageops::replace(&mut both, b, i64::from(a.width()) + 8, 0);
        Some((format!("{}.png", segment.name), both))
    };
    Ok(found.segments.iter().filter_map(pair).collect())
}

/// A row of a table of segments.
#[derive(Clone, Debug)]
pub struct SegmentRow<'a> {
    /// Columns of its recording. The user's own entries for the segment follow in `more`.
    pub of: ManifestColumns,
    /// Fields of the columns that the user added.
    pub more: Vec<String>,
    /// Frames per second; `None` if frame intervals vary and the times are in the video.
    pub fps: Option<f64>,
    /// The segment.
    pub segment: &'a Segment,
}

/// Writes a table of segments: a manifest with a confidence, followed by the columns `more`. `folder` holds the marks, as named in the
/// table.
///
/// # Errors
/// [`OutputError`] when it cannot be written.
pub fn write_segments(path: &Path, folder: &str, more: &[String], rows: &[SegmentRow<'_>]) -> Result<(), OutputError> {
    let row = |row: &SegmentRow<'_>| {
        let SegmentRow { of, more, fps, segment } = row;
        let confidence = (segment.confidence * 1e3).round() / 1e3;
        let marks = PathBuf::from(folder).join(format!("{}.csv", segment.name)).display().to_string();
        let fields = [
            of.subject.clone(),
            segment.name.clone(),
            of.emotion.clone(),
            of.frames.clone(),
            segment.neutral_frame.to_string(),
            segment.apex_frame.to_string(),
            marks,
            fps.map(nine_digits).unwrap_or_default(),
            nine_digits(confidence),
        ];
        fields.iter().chain(more).cloned().collect::<Vec<String>>()
    };
    let header = SEGMENT_COLUMNS.iter().map(|name| (*name).to_owned()).chain(more.iter().cloned());
    write_records(path, header.collect::<Vec<_>>(), rows.iter().map(row)).map(|_| ())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_of_a_later_version_is_refused_and_its_files_stay() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let marks = "node,x,y\n";
        let record = |schema_version: u32| RecordingFiles {
            schema_version,
            made_by: String::new(),
            units: BTreeMap::new(),
            inputs_blake3: String::new(),
            fps: 25.0,
            uneven: false,
            frames: [0, 0],
            segments: Vec::new(),
            notes: Vec::new(),
            files: [("talk-01.csv".to_owned(), blake3::hash(marks.as_bytes()).to_hex().to_string())].into(),
        };
        std::fs::write(at("talk-01.csv"), marks).unwrap();
        output::write_json(&at("talk.json"), &record(9)).unwrap();
        let said = make_room(folder.path(), "talk").unwrap_err().to_string();
        assert!(said.contains("talk.json: schema version 9; this program reads 2"), "{said}");
        assert!(at("talk.json").is_file() && at("talk-01.csv").is_file());
        // A record of the present version is replaced.
        output::write_json(&at("talk.json"), &record(SCHEMA)).unwrap();
        assert!(make_room(folder.path(), "talk").is_ok_and(|notes| notes.is_empty()));
        assert!(!at("talk.json").exists() && !at("talk-01.csv").exists());
        // An unreadable record means that nothing was completed.
        std::fs::write(at("talk.json"), "{\"schema_version\": 2,").unwrap();
        assert!(make_room(folder.path(), "talk").is_ok_and(|notes| notes.is_empty()));
        assert!(make_room(folder.path(), "walk").is_ok());
    }
}
