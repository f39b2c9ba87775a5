//! Writes the files of simulated sequences, in the project's own layout or in that of Cohn-Kanade.

use std::{fmt::Write as _, fs, io, path::Path};

use image::{
    ImageEncoder, RgbImage,
    codecs::{
        jpeg::JpegEncoder,
        png::{CompressionType, FilterType, PngEncoder},
    },
};
use nalgebra::{Point2, Vector2};
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;

use super::{
    DatasetLayout, SimulateError, SimulateOptions, SimulatedFrame,
    options::FrameFormat,
    random::{Purpose, generator},
};
use grimace::internal::{
    dataset::{DEFAULT_LANDMARK_NODES, MANIFEST_NAME},
    output::{FolderRecord, OutputError, csv_into, csv_writer, nine_digits, write_json},
    wireframe::{LandmarkRow, Tables},
};

/// Name of the record of written files; a later simulation may remove the files in it.
const RECORD_NAME: &str = "simulate.b3";
/// Version of the layout of a simulated dataset.
const SCHEMA_VERSION: u32 = 1;

/// Folders of the Cohn-Kanade layout: images, labels, landmarks.
const COHN_KANADE: [&str; 3] = ["cohn-kanade-images", "Emotion", "Landmarks"];

/// A sequence to write.
pub(super) struct Performance<F: Fn(usize) -> Result<SimulatedFrame, SimulateError>> {
    pub subject: String,
    pub sequence: String,
    /// Label of the sequence.
    pub emotion: String,
    /// Subject and emotion code of the sequence's random streams.
    pub stream: (u32, u8),
    /// Function that returns frame k, from 0.
    pub frame: F,
}

/// A row of the manifest, for a written sequence.
pub(super) struct ManifestRow {
    subject: String,
    sequence: String,
    emotion: String,
    /// Folder of the frames, relative to the dataset; the path of the correspondences is also relative to the dataset.
    frames: String,
    correspondences: String,
    fps: f64,
    /// Values of the additional columns.
    further: Vec<String>,
}

impl ManifestRow {
    const COLUMNS: [&str; 6] = ["subject", "sequence", "emotion", "frames", "correspondences", "fps"];

    /// Returns the row with values of additional columns.
    pub fn with(self, further: impl IntoIterator<Item = String>) -> Self {
        Self { further: further.into_iter().collect(), ..self }
    }

    fn fields(self) -> Vec<String> {
        let own = [self.subject, self.sequence, self.emotion, self.frames, self.correspondences, format!("{:?}", self.fps)];
        own.into_iter().chain(self.further).collect()
    }
}

#[derive(Serialize)]
struct MarkRow {
    node: u16,
    x: String,
    y: String,
}

#[derive(Serialize)]
struct TruthRow {
    frame: usize,
    node: usize,
    x: String,
    y: String,
}

#[derive(Serialize)]
struct Provenance<'a> {
    schema_version: u32,
    program: &'static str,
    version: &'static str,
    units: Units,
    options: &'a SimulateOptions,
    #[serde(flatten)]
    further: &'a serde_json::Map<String, serde_json::Value>,
}

#[derive(Serialize)]
struct Units {
    positions: &'static str,
    noise_sigma: &'static str,
    angles: &'static str,
    fps: &'static str,
}

const UNITS: Units = Units {
    positions: "px; x right, y down, the centre of the top-left pixel is (0, 0)",
    noise_sigma: "grey levels of 0 to 255",
    angles: "degrees",
    fps: "frames per second",
};

/// Makes the output folder and returns the record of its files. Refuses a folder that is not empty, unless `force` is set.
pub(super) fn begin(out: &Path, force: bool) -> Result<FolderRecord, SimulateError> {
    fs::create_dir_all(out).map_err(OutputError::at(out))?;
    if !force && fs::read_dir(out).map_err(OutputError::at(out))?.next().is_some() {
        return Err(SimulateError::NotEmpty { path: out.to_owned() });
    }
    let record = FolderRecord::open(out, RECORD_NAME, force)?;
    // Removes the manifest of an earlier run, because the folder is incomplete while frames are written. A manifest that a user wrote or
    // changed is an error.
    let manifest = out.join(MANIFEST_NAME);
    let has_manifest = fs::symlink_metadata(&manifest).is_ok();
    if has_manifest && !record.is_unchanged(MANIFEST_NAME) {
        return Err(SimulateError::NotSimulated { path: manifest });
    }
    record.begin()?;
    if has_manifest {
        fs::remove_file(&manifest).map_err(OutputError::at(&manifest))?;
    }
    Ok(record)
}

/// Writes `simulate.json` and, last, the manifest with the additional `columns`; a folder with a manifest is a complete dataset.
///
/// Frames of an earlier simulation that this one did not make are removed first, because a longer sequence would otherwise mix with the new
/// one.
pub(super) fn finish(
    record: FolderRecord,
    out: &Path,
    options: &SimulateOptions,
    further: &serde_json::Map<String, serde_json::Value>,
    columns: &[&str],
    rows: impl IntoIterator<Item = ManifestRow>,
) -> Result<(), SimulateError> {
    let provenance = Provenance {
        schema_version: SCHEMA_VERSION,
        program: "grimace",
        version: env!("CARGO_PKG_VERSION"),
        units: UNITS,
        options,
        further,
    };
    write_json(&out.join("simulate.json"), &provenance)?;
    if let Some(name) = record.remove_stale()?.into_iter().next() {
        return Err(SimulateError::NotSimulated { path: out.join(name) });
    }
    if options.layout == DatasetLayout::Manifest {
        record.write(MANIFEST_NAME, |writer| {
            let mut csv = csv_writer(writer);
            csv.write_record(ManifestRow::COLUMNS.iter().chain(columns)).map_err(io::Error::from)?;
            for row in rows {
                csv.write_record(row.fields()).map_err(io::Error::from)?;
            }
            csv.flush()
        })?;
    }
    Ok(record.close()?)
}

/// Writes the frames of a sequence, its marks or landmarks and label, and the true positions.
pub(super) fn write_sequence<F: Fn(usize) -> Result<SimulatedFrame, SimulateError>>(
    performance: &Performance<F>,
    options: &SimulateOptions,
    record: &FolderRecord,
    tick: &impl Fn(),
) -> Result<ManifestRow, SimulateError> {
    let (who, what) = (&performance.subject, &performance.sequence);
    let folder = format!("{who}/{what}");
    let stem = format!("{who}_{what}_");
    let layout = Layout::new(options.layout, &folder);
    let tables = Tables::candide3();
    let mut truth = Vec::new();
    for frame in 0..options.frames {
        let simulated = (performance.frame)(frame)?;
        let name = format!("{stem}{:08}", frame + 1);
        let picture = format!("{}/{name}.{}", layout.images, options.format.extension());
        record.write(&picture, |writer| encode(&simulated.image, options.format, writer))?;
        truth.extend(simulated.nodes.iter().enumerate().map(|(node, p)| TruthRow {
            frame: frame + 1,
            node,
            x: nine_digits(p.x),
            y: nine_digits(p.y),
        }));
        if let Some([labels, landmarks]) = &layout.cohn_kanade {
            let text = landmark_text(&simulated.nodes, &tables.landmarks);
            record.write(&format!("{landmarks}/{name}_landmarks.txt"), |writer| writer.write_all(text.as_bytes()))?;
            // Cohn-Kanade stores the label with the apex frame.
            if frame + 1 == options.frames {
                let code = grimace::internal::dataset::emotion_code(&performance.emotion)
                    .ok_or_else(|| SimulateError::NoCode { emotion: performance.emotion.clone() })?;
                let label = format!("   {}\n", exponential(f64::from(code)));
                record.write(&format!("{labels}/{name}_emotion.txt"), |writer| writer.write_all(label.as_bytes()))?;
            }
        } else if frame == 0 {
            let marks = marks(&simulated.nodes, options, performance.stream);
            record.write(&format!("{}/correspondences.csv", layout.images), |writer| csv_into(writer, marks))?;
        }
        tick();
    }
    record.write(&format!("truth/{who}_{what}.csv"), |writer| csv_into(writer, truth))?;
    Ok(ManifestRow {
        subject: who.clone(),
        sequence: what.clone(),
        emotion: performance.emotion.clone(),
        correspondences: format!("{folder}/correspondences.csv"),
        frames: folder,
        fps: options.fps,
        further: Vec::new(),
    })
}

/// The folders of a sequence, relative to the dataset.
struct Layout {
    images: String,
    /// Folders of labels and landmarks.
    cohn_kanade: Option<[String; 2]>,
}

impl Layout {
    fn new(layout: DatasetLayout, folder: &str) -> Self {
        match layout {
            DatasetLayout::Manifest => Self { images: folder.to_owned(), cohn_kanade: None },
            DatasetLayout::CohnKanade => {
                let [images, labels, landmarks] = COHN_KANADE.map(|name| format!("{name}/{folder}"));
                Self { images, cohn_kanade: Some([labels, landmarks]) }
            }
        }
    }
}

/// Returns the 68 landmarks of a face, px, each from the nodes at its position; `nodes` holds the positions of all nodes.
pub(crate) fn landmark_points(nodes: &[Point2<f64>], landmarks: &[LandmarkRow]) -> Vec<Point2<f64>> {
    let place = |row: &LandmarkRow| {
        let sum: Vector2<f64> = row.nodes.iter().map(|&(node, weight)| nodes[node.index()].coords * weight).sum();
        let total: f64 = row.nodes.iter().map(|&(_, weight)| weight).sum();
        Point2::from(sum / total)
    };
    landmarks.iter().map(place).collect()
}

/// Returns the 68 landmarks of a frame in the format of CK+: one line `x y` for each, with 8 significant digits.
fn landmark_text(nodes: &[Point2<f64>], landmarks: &[LandmarkRow]) -> String {
    let mut text = String::new();
    for p in landmark_points(nodes, landmarks) {
        // Writing to a string does not fail.
        let _ = writeln!(text, "   {}   {}", exponential(p.x), exponential(p.y));
    }
    text
}

/// Formats a number like C's `%.7e`: `1.1495612e+02`.
fn exponential(value: f64) -> String {
    let text = format!("{value:.7e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let (sign, digits) = exponent.strip_prefix('-').map_or(('+', exponent), |digits| ('-', digits));
    format!("{mantissa}e{sign}{digits:0>2}")
}

/// Returns the marks of the neutral frame: true positions plus Gaussian errors.
fn marks(nodes: &[Point2<f64>], options: &SimulateOptions, (subject, code): (u32, u8)) -> Vec<MarkRow> {
    let mut random = generator(options.seed, Purpose::Marks, subject, code, 0);
    let mut error = || -> f64 {
        let z: f64 = StandardNormal.sample(&mut random);
        z * options.marks_noise_px
    };
    DEFAULT_LANDMARK_NODES
        .iter()
        .map(|&node| {
            let p = nodes[node.index()];
            let (x, y) = (p.x + error(), p.y + error());
            MarkRow { node: node.0, x: nine_digits(x), y: nine_digits(y) }
        })
        .collect()
}

/// Writes a picture as `STEM.png` or `STEM.jpg`.
pub(super) fn write_picture(
    record: &FolderRecord,
    stem: &str,
    image: &RgbImage,
    format: FrameFormat,
) -> Result<(), SimulateError> {
    Ok(record.write(&format!("{stem}.{}", format.extension()), |writer| encode(image, format, writer))?)
}

/// Writes the last files like [`finish`], for one recording of every subject. The manifest tells `segment` to cut the recordings.
pub(super) fn finish_recordings(
    record: FolderRecord,
    out: &Path,
    options: &SimulateOptions,
    subjects: &[String],
) -> Result<(), SimulateError> {
    let row = |subject: &String| ManifestRow {
        subject: subject.clone(),
        sequence: super::recording::RECORDING_NAME.to_owned(),
        emotion: "unlabelled".to_owned(),
        frames: format!("{subject}/{}", super::recording::RECORDING_NAME),
        correspondences: String::new(),
        fps: options.fps,
        further: vec!["auto".to_owned()],
    };
    finish(record, out, options, &serde_json::Map::new(), &["segment"], subjects.iter().map(row))
}

fn encode(image: &RgbImage, format: FrameFormat, writer: &mut dyn io::Write) -> io::Result<()> {
    let (width, height) = image.dimensions();
    let colour = image::ExtendedColorType::Rgb8;
    match format {
        FrameFormat::Png => PngEncoder::new_with_quality(writer, CompressionType::Fast, FilterType::Adaptive)
            .write_image(image, width, height, colour),
        FrameFormat::Jpg { quality } => JpegEncoder::new_with_quality(writer, quality).write_image(image, width, height, colour),
    }
    .map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_as_c_does() {
        assert_eq!(exponential(114.956_123_4), "1.1495612e+02");
        assert_eq!(exponential(-0.05), "-5.0000000e-02");
        assert_eq!(exponential(3.0), "3.0000000e+00");
    }
}
