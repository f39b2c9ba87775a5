//! A whole dataset on disk.

use std::{
    fs, io,
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
};

use image::{
    ImageEncoder, RgbImage,
    codecs::{
        jpeg::JpegEncoder,
        png::{CompressionType, FilterType, PngEncoder},
    },
};
use nalgebra::Point2;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde::Serialize;

use super::{
    Cohort, Sex, SimulateError, SimulateOptions, SimulatedSequence, Subject,
    expression::Emotion,
    options::FrameFormat,
    random::{Purpose, generator},
};
use crate::output::{OutputError, nine_digits, write_atomic, write_csv, write_json};

/// Nodes that are marked on the neutral frame: corners of the eyes, corners of the mouth, chin.
pub const MARKED_NODES: [u16; 7] = [20, 23, 53, 56, 31, 64, 10];
/// Name of the list of sequences.
const MANIFEST: &str = "manifest.csv";
/// Version of the layout of a simulated dataset.
const SCHEMA_VERSION: u32 = 1;

/// What was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DatasetSummary {
    /// Sequences.
    pub sequences: usize,
    /// Frames in all of them.
    pub frames: usize,
}

#[derive(Serialize)]
struct ManifestRow {
    subject: String,
    sequence: String,
    emotion: Emotion,
    frames: String,
    correspondences: String,
    fps: f64,
    sex: &'static str,
    cohort: &'static str,
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

/// Writes a dataset: `manifest.csv`, the frames, correspondences, the true position of every node, and `simulate.json`.
///
/// Sequences are made in parallel; the bytes do not depend on the number of threads. `progress` is called with the number of
/// frames finished and the number of all frames, from any thread.
///
/// With `force`, frames that an earlier run left in the folder of a sequence are removed; other files stay.
///
/// # Errors
/// [`SimulateError`] for options out of range, a folder that is not empty (unless `force`), or a file that can not be written.
pub fn simulate_dataset(
    options: &SimulateOptions,
    out: &Path,
    force: bool,
    progress: impl Fn(usize, usize) + Sync,
) -> Result<DatasetSummary, SimulateError> {
    options.check()?;
    fs::create_dir_all(out).map_err(OutputError::at(out))?;
    if !force && fs::read_dir(out).map_err(OutputError::at(out))?.next().is_some() {
        return Err(SimulateError::NotEmpty { path: out.to_owned() });
    }
    // What an earlier run left is not a dataset while frames are written over it.
    remove(&out.join(MANIFEST))?;
    let total = options.subjects as usize * options.emotions.len() * options.frames;
    let done = AtomicUsize::new(0);
    let tick = || progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
    let rows: Vec<Vec<ManifestRow>> = (0..options.subjects)
        .into_par_iter()
        .map(|index| {
            let subject = Subject::new(options, index)?;
            options.emotions.par_iter().map(|&emotion| write_sequence(&subject, emotion, options, out, &tick)).collect()
        })
        .collect::<Result<_, SimulateError>>()?;
    let sequences = rows.iter().map(Vec::len).sum();
    let provenance = Provenance {
        schema_version: SCHEMA_VERSION,
        program: env!("CARGO_PKG_NAME"),
        version: env!("CARGO_PKG_VERSION"),
        units: UNITS,
        options,
    };
    write_json(&out.join("simulate.json"), &provenance)?;
    // Last: a folder with a manifest is a complete dataset.
    write_csv(&out.join(MANIFEST), rows.into_iter().flatten())?;
    Ok(DatasetSummary { sequences, frames: total })
}

fn write_sequence(
    subject: &Subject,
    emotion: Emotion,
    options: &SimulateOptions,
    out: &Path,
    tick: &(impl Fn() + Sync),
) -> Result<ManifestRow, SimulateError> {
    let (who, what) = (subject.id(), format!("{:03}", emotion.code()));
    let folder = format!("{who}/{what}");
    let sequence = SimulatedSequence::new(subject, emotion, options)?;
    remove_frames(&out.join(&folder), &format!("{who}_{what}_"))?;
    let mut truth = Vec::new();
    for frame in 0..options.frames {
        let simulated = sequence.frame(frame);
        let name = format!("{who}_{what}_{:08}.{}", frame + 1, options.format.extension());
        write_atomic(&out.join(&folder).join(name), |writer| encode(&simulated.image, options.format, writer))?;
        truth.extend(simulated.nodes.iter().enumerate().map(|(node, p)| TruthRow {
            frame: frame + 1,
            node,
            x: nine_digits(p.x),
            y: nine_digits(p.y),
        }));
        if frame == 0 {
            let marks = marks(&simulated.nodes, options, subject.index(), emotion);
            write_csv(&out.join(&folder).join("correspondences.csv"), marks)?;
        }
        tick();
    }
    write_csv(&out.join("truth").join(format!("{who}_{what}.csv")), truth)?;
    Ok(ManifestRow {
        subject: who,
        sequence: what,
        emotion,
        correspondences: format!("{folder}/correspondences.csv"),
        frames: folder,
        fps: options.fps,
        sex: match subject.sex() {
            Sex::Female => "f",
            Sex::Male => "m",
        },
        cohort: match subject.cohort() {
            Cohort::A => "A",
            Cohort::B => "B",
        },
    })
}

/// Removes a file if it is there.
fn remove(path: &Path) -> Result<(), OutputError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(OutputError::at(path)(error)),
        _ => Ok(()),
    }
}

/// Removes the frames of an earlier run: a longer sequence, or another format, would mix with the new one.
fn remove_frames(folder: &Path, stem: &str) -> Result<(), OutputError> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries.map_err(OutputError::at(folder))?,
    };
    for entry in entries {
        let path = entry.map_err(OutputError::at(folder))?.path();
        let is_frame = path.file_name().and_then(|name| name.to_str()).is_some_and(|name| name.starts_with(stem));
        if is_frame {
            remove(&path)?;
        }
    }
    Ok(())
}

/// The marks a person would set on the neutral frame: true positions plus Gaussian errors.
fn marks(nodes: &[Point2<f64>], options: &SimulateOptions, subject: u32, emotion: Emotion) -> Vec<MarkRow> {
    let mut random = generator(options.seed, Purpose::Marks, subject, emotion.code(), 0);
    let mut error = || -> f64 {
        let z: f64 = StandardNormal.sample(&mut random);
        z * options.marks_noise_px
    };
    MARKED_NODES
        .iter()
        .map(|&node| {
            let p = nodes[usize::from(node)];
            let (x, y) = (p.x + error(), p.y + error());
            MarkRow { node, x: nine_digits(x), y: nine_digits(y) }
        })
        .collect()
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
