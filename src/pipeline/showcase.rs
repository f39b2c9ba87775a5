//! The representatives on one face, moving, for the report.

use std::path::{Path, PathBuf};

use image::{RgbImage, codecs::jpeg::JpegEncoder};
use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::{Workbench, file_blake3};
use crate::{
    clone::{CloneError, CloneOptions, SourceMotion, Target, at_height, read_marks},
    dataset::LandmarkSelection,
    fit::FittedWireframe,
    geometry::Similarity,
    model::FrameExpressionModel,
    report::Film,
    sequence::read_colour,
    statistics::Representative,
    warp::{MouthInside, NODE_COUNT},
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
        /// Its marks.
        correspondences: PathBuf,
        /// BLAKE3 of both, so that another picture under the same name is another option.
        blake3: [Option<String>; 2],
    },
}

impl ReportFace {
    /// A photograph and its marks.
    pub fn photograph(image: &Path, correspondences: &Path) -> Self {
        let blake3 = [file_blake3(image), file_blake3(correspondences)];
        Self::Photograph { image: image.to_owned(), correspondences: correspondences.to_owned(), blake3 }
    }
}

/// Frames of a film.
const FRAMES: usize = 9;
/// Height of a film, px.
const HEIGHT: u32 = 236;
/// Quality of its JPEG, 1 to 100.
const QUALITY: u8 = 84;
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
            let marks = read_marks(correspondences, &LandmarkSelection::HighAndMedium, bench)?;
            Target::new(&image.file_stem().unwrap_or_default().to_string_lossy(), picture, &marks, bench.fitter(), bench)
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

/// A film of each representative on the face of the report; none for a wireframe that the warp does not know.
///
/// # Errors
/// [`CloneError`] for a face that does not serve.
pub(super) fn films(representatives: &[Representative], bench: &Workbench) -> Result<Vec<Film>, CloneError> {
    if bench.wireframe.node_count() != NODE_COUNT || representatives.is_empty() {
        return Ok(Vec::new());
    }
    let target = showcase_target(bench)?;
    representatives.iter().map(|r| film(r, &target, bench)).collect()
}

fn film(representative: &Representative, target: &Target, bench: &Workbench) -> Result<Film, CloneError> {
    let motion = SourceMotion::from_model(&representative.label.emotion, &representative.model, bench)?;
    let options = CloneOptions::default();
    let (left, top, width, height) = target.surroundings();
    let mut strip = RgbImage::new(0, 0);
    for k in 0..FRAMES {
        let place = (motion.frame_count() - 1) as f64 * k as f64 / (FRAMES - 1) as f64;
        let nodes = target.nodes_at(&motion, &motion.at(place), options.rescale, options.emphasis, false, bench);
        let deformation = target.warp().deform(&nodes)?;
        let picture = target.warp().render(target.texture(), &deformation, &MouthInside::Teeth);
        let face = at_height(&image::imageops::crop_imm(&picture, left, top, width, height).to_image(), HEIGHT);
        if k == 0 {
            strip = RgbImage::new(face.width() * FRAMES as u32, HEIGHT);
        }
        image::imageops::replace(&mut strip, &face, i64::from(face.width()) * k as i64, 0);
    }
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, QUALITY)
        .encode_image(&strip)
        .map_err(|e| CloneError::Encode { what: "a film of the report", reason: e.to_string() })?;
    Ok(Film { jpeg, frames: FRAMES, width: strip.width() / FRAMES as u32, height: HEIGHT })
}
