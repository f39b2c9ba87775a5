//! The representatives on one face, moving, for the report.

use std::path::{Path, PathBuf};

use image::{RgbImage, codecs::jpeg::JpegEncoder};
use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::{SequenceFailure, SequenceSource, Workbench, file_blake3, found_marks};
use crate::{
    clone::{CloneError, SourceMotion, Target},
    dataset::{LandmarkSelection, read_marks},
    fit::FittedWireframe,
    geometry::Similarity,
    model::FrameExpressionModel,
    overlay::thumbnail,
    player::{PlayerError, PlayerFace, Shown, payload},
    report::Stage,
    sequence::{read_colour, read_colour_frames, read_frame},
    statistics::Representative,
    track::TrackedFrame,
    warp::NODE_COUNT,
};

/// On whom the report shows the representatives.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ReportFace {
    /// A simulated person.
    #[default]
    Simulated,
    /// A photograph with marks.
    Photograph {
        /// The photograph.
        image: PathBuf,
        /// Its marks; found in it if there are none.
        correspondences: Option<PathBuf>,
        /// BLAKE3 of both, so that another picture under the same name is another option.
        blake3: [Option<String>; 2],
    },
}

impl ReportFace {
    /// A photograph and its marks.
    pub fn photograph(image: &Path, correspondences: Option<&Path>) -> Self {
        let blake3 = [file_blake3(image), correspondences.and_then(file_blake3)];
        Self::Photograph { image: image.to_owned(), correspondences: correspondences.map(Path::to_owned), blake3 }
    }
}

/// Height of the face in the report, px.
const HEIGHT: u32 = 480;
/// Height of a thumbnail, px.
const THUMBNAIL_HEIGHT: u32 = 150;
/// Largest thumbnail, bytes, and the qualities of its JPEG that are tried, best first.
const MOST_BYTES: usize = 6000;
const THUMBNAIL_QUALITIES: [u8; 5] = [82, 70, 55, 35, 15];
/// A simulated person, neutral, and all nodes of the wireframe in the picture, px. Made by the simulation (`crates/lab`), whose test
/// `the_face_of_the_report_is_what_the_simulation_makes` compares them with it and makes them anew.
const SIMULATED_PICTURE: &[u8] = include_bytes!("assets/simulated_face.png");
const SIMULATED_NODES: &str = include_str!("assets/simulated_face.csv");

/// The face that the report shows the representatives on.
///
/// # Errors
/// [`CloneError`] for a photograph or marks that do not serve.
pub fn showcase_target(bench: &Workbench) -> Result<Target, CloneError> {
    match &bench.options.report_face {
        ReportFace::Photograph { image, correspondences, .. } => {
            let picture = read_colour(image)?;
            let nodes = bench.wireframe.node_count();
            let marks = match correspondences {
                Some(marks) => read_marks(marks, &LandmarkSelection::HighAndMedium, &bench.tables, nodes)?,
                None => found_marks(&read_frame(image)?, bench).map_err(|e| CloneError::Showcase(e.to_string()))?,
            };
            bench.target(&image.file_stem().unwrap_or_default().to_string_lossy(), picture, &marks)
        }
        ReportFace::Simulated => {
            let (picture, nodes) = simulated_face().map_err(CloneError::Showcase)?;
            let fitted = FittedWireframe {
                model: FrameExpressionModel::new(nodes),
                image_from_face: Similarity::identity(),
                correspondences: Vec::new(),
                residuals: Vec::new(),
                warnings: Vec::new(),
            };
            Target::from_fit("simulated", picture, fitted, bench)
        }
    }
}

/// The picture, and the positions of all nodes.
fn simulated_face() -> Result<(RgbImage, Vec<Point2<f64>>), String> {
    let picture = image::load_from_memory(SIMULATED_PICTURE).map_err(|e| e.to_string())?.into_rgb8();
    let nodes = csv::Reader::from_reader(SIMULATED_NODES.as_bytes())
        .deserialize::<(u16, f64, f64)>()
        .map(|row| row.map(|(_, x, y)| Point2::new(x, y)).map_err(|e| e.to_string()))
        .collect::<Result<_, _>>()?;
    Ok((picture, nodes))
}

/// The player of all representatives on the face of the report; `None` for a wireframe that the warp does not know, and where no face is to
/// be shown.
///
/// # Errors
/// [`CloneError`] for a face that does not serve.
pub(super) fn player(representatives: &[Representative], bench: &Workbench) -> Result<Option<serde_json::Value>, CloneError> {
    let options = &bench.options;
    if bench.wireframe.node_count() != NODE_COUNT || representatives.is_empty() || options.no_faces {
        return Ok(None);
    }
    let target = showcase_target(bench)?;
    let label = |r: &Representative| {
        let group: Vec<String> = r.label.group.iter().map(|(column, value)| format!("{column} {value}")).collect();
        [vec![r.label.emotion.clone()], group].concat().join(", ")
    };
    let labels: Vec<String> = representatives.iter().map(label).collect();
    let motions = representatives
        .iter()
        .map(|r| SourceMotion::from_model(&r.label.emotion, &r.model, bench))
        .collect::<Result<Vec<_>, _>>()?;
    let shown: Vec<Shown> = labels.iter().zip(&motions).map(|(label, motion)| Shown { label: label.as_str(), motion }).collect();
    let face = face_name(bench);
    payload(&shown, &[PlayerFace { label: &face, target: &target, height: HEIGHT }], bench).map(Some).map_err(|e| match e {
        PlayerError::Clone(error) => error,
        other => CloneError::Showcase(other.to_string()),
    })
}

/// What the face of the report is called.
pub(super) fn face_name(bench: &Workbench) -> String {
    match &bench.options.report_face {
        ReportFace::Simulated => "a simulated person".to_owned(),
        ReportFace::Photograph { image, .. } => image.file_name().unwrap_or_default().to_string_lossy().into_owned(),
    }
}

/// JPEG files of the wireframe on the neutral and on the apex frame, [`MOST_BYTES`] each at most; `None` for a picture that does not get so
/// small.
///
/// # Errors
/// [`SequenceFailure`] when a frame does not read, which it did for tracking: a report without pictures would not be the same again.
pub(super) fn thumbnails(
    source: &SequenceSource,
    frames: &[TrackedFrame],
    bench: &Workbench,
) -> Result<Option<[Vec<u8>; 2]>, SequenceFailure> {
    let (Some(first), Some(last)) = (frames.first(), frames.last()) else { return Ok(None) };
    let wanted = [first.number, last.number];
    let pictures = read_colour_frames(&source.frames, &wanted).map_err(SequenceFailure::at(Stage::Track))?;
    let small = |frame: &TrackedFrame| {
        let (_, picture) = pictures.iter().find(|(number, _)| *number == frame.number)?;
        let thumbnail = thumbnail(picture, &bench.wireframe, &frame.nodes, THUMBNAIL_HEIGHT);
        THUMBNAIL_QUALITIES.iter().find_map(|&quality| {
            let mut jpeg = Vec::new();
            JpegEncoder::new_with_quality(&mut jpeg, quality).encode_image(&thumbnail).ok()?;
            (jpeg.len() <= MOST_BYTES).then_some(jpeg)
        })
    };
    Ok(small(first).zip(small(last)).map(|(first, last)| [first, last]))
}
