//! Animates the representatives on one face for the report.

use std::path::{Path, PathBuf};

use image::{RgbImage, codecs::jpeg::JpegEncoder};
use serde::{Deserialize, Serialize};

use super::{AnalyzedClass, SequenceFailure, Workbench, file_blake3, found_marks_and_remark};
use crate::{
    clone::{CloneError, Skin, SourceMotion, Target},
    correspondence::{Correspondence, correspondences_of},
    dataset::{FrameSource, LandmarkSelection, read_marks},
    input::CsvFile,
    overlay::thumbnail,
    player::{PlayerError, PlayerFace, Shown, payload},
    report::Stage,
    sequence::{Frame, Portrait, read_colour_frames, read_first_frame},
    statistics::Representative,
    track::TrackedFrame,
    units::NodeId,
    warp::NODE_COUNT,
    wireframe::Region,
};

/// Face on which the report shows the representatives.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ReportFace {
    /// The shipped portrait.
    #[default]
    #[serde(alias = "simulated")]
    Composite,
    /// A photograph with marks.
    Photograph {
        /// The photograph.
        image: PathBuf,
        /// Its marks; `None` to find them in the photograph.
        correspondences: Option<PathBuf>,
        /// BLAKE3 of both files, so that changed files count as a changed option.
        blake3: [Option<String>; 2],
    },
}

impl ReportFace {
    /// Returns the option for a photograph and its marks.
    pub fn photograph(image: &Path, correspondences: Option<&Path>) -> Self {
        let blake3 = [file_blake3(image), correspondences.and_then(file_blake3)];
        Self::Photograph { image: image.to_owned(), correspondences: correspondences.map(Path::to_owned), blake3 }
    }
}

/// Height of the face in the report, px.
const HEIGHT: u32 = 480;
/// Height of a thumbnail, px.
const THUMBNAIL_HEIGHT: u32 = 150;
/// Largest size of a thumbnail, bytes. The qualities below are tried in descending order.
const MOST_BYTES: usize = 6000;
const THUMBNAIL_QUALITIES: [u8; 5] = [82, 70, 55, 35, 15];
/// A composite portrait, the average of five people, and its marks: `fixtures/portraits/P09`, which names the source photographs.
const PORTRAIT: &[u8] = include_bytes!("assets/portrait.jpg");
const PORTRAIT_MARKS: &[u8] = include_bytes!("assets/portrait_marks.csv");
/// Name of the portrait.
pub const PORTRAIT_NAME: &str = "a composite portrait";

/// Returns the face on which the report shows the representatives.
///
/// # Errors
/// [`CloneError`] for an unusable photograph or unusable marks.
pub fn showcase_target(bench: &Workbench) -> Result<Target, CloneError> {
    match &bench.options.report_face {
        ReportFace::Photograph { image, correspondences, .. } => Ok(photograph(image, correspondences.as_deref(), bench)?.0),
        ReportFace::Composite => {
            let (picture, marks) = portrait(bench)?;
            bench.target("portrait", picture, &marks)
        }
    }
}

/// The shipped composite portrait with its marks.
pub(super) fn portrait(bench: &Workbench) -> Result<(RgbImage, Vec<Correspondence>), CloneError> {
    let unusable = |e: &dyn std::error::Error| CloneError::Showcase(e.to_string());
    let picture = image::load_from_memory(PORTRAIT).map_err(|e| unusable(&e))?.into_rgb8();
    let marks = CsvFile::from_bytes(Path::new("portrait_marks.csv"), PORTRAIT_MARKS.to_vec()).map_err(|e| unusable(&e))?;
    let marks = correspondences_of(&marks, &bench.tables, bench.wireframe.node_count()).map_err(|e| unusable(&e))?;
    Ok((picture, marks))
}

/// Prepares a photograph for animation. Returns it with messages about it and its marks.
fn photograph(image: &Path, correspondences: Option<&Path>, bench: &Workbench) -> Result<(Target, Vec<String>), CloneError> {
    let portrait = Portrait::read(image)?;
    let mut said: Vec<String> = portrait.remark().into_iter().collect();
    let Portrait { picture, grey, .. } = portrait;
    let name = image.file_stem().unwrap_or_default().to_string_lossy();
    if let Some(marks) = correspondences {
        let marks = read_marks(marks, &LandmarkSelection::HighAndMedium, &bench.tables, bench.wireframe.node_count())?;
        let (target, beside) = bench.marked_target(&name, (picture, &grey), &marks)?;
        said.extend(beside);
        return Ok((target, said));
    }
    let found = found_marks_and_remark(&Frame::new(0, grey), Some(&picture), bench);
    let marks = found.map_err(|e| CloneError::Showcase(e.to_string()))?.marks;
    Ok((bench.target(&name, picture, &marks)?, said))
}

/// Messages about the report's photograph: that it is transparent, and where given marks miss its face.
///
/// # Errors
/// [`CloneError`] for an unusable photograph or unusable marks.
pub fn showcase_remarks(bench: &Workbench) -> Result<Vec<String>, CloneError> {
    let ReportFace::Photograph { image, correspondences, .. } = &bench.options.report_face else { return Ok(Vec::new()) };
    Ok(photograph(image, correspondences.as_deref(), bench)?.1)
}

/// Player data of all representatives on the report's face, each with the skin of its class, or else folds computed from its shape. `None`
/// for a wireframe that the warp does not support, and if no face may be shown.
///
/// # Errors
/// [`CloneError`] for an unusable face.
pub(super) fn player(classes: &[AnalyzedClass], bench: &Workbench) -> Result<Option<serde_json::Value>, CloneError> {
    let options = &bench.options;
    if bench.wireframe.node_count() != NODE_COUNT || classes.is_empty() || options.no_faces {
        return Ok(None);
    }
    let target = showcase_target(bench)?;
    let label = |r: &Representative| {
        let group: Vec<String> = r.label.group.iter().map(|(column, value)| format!("{column} {value}")).collect();
        // The same form as in the tables of the report.
        [vec![r.label.emotion.clone()], group].concat().join(", ").replace('_', " ")
    };
    let labels: Vec<String> = classes.iter().map(|c| label(&c.representative)).collect();
    let motion = |c: &AnalyzedClass| SourceMotion::from_model(&c.representative.label.emotion, &c.representative.model, bench);
    let motions = classes.iter().map(motion).collect::<Result<Vec<_>, _>>()?;
    let skin = |(motion, class): (&SourceMotion, &AnalyzedClass)| class.skin.clone().or_else(|_| Skin::of_form(motion));
    let skins = motions.iter().zip(classes).map(skin).collect::<Result<Vec<_>, _>>()?;
    let show = |((label, motion), skin)| Shown { label: String::as_str(label), motion, skin };
    let shown: Vec<Shown> = labels.iter().zip(&motions).zip(&skins).map(show).collect();
    let face = face_name(bench);
    payload(&shown, &[PlayerFace { label: &face, target: &target, height: HEIGHT }], bench).map(Some).map_err(|e| match e {
        PlayerError::Clone(error) => error,
        other => CloneError::Showcase(other.to_string()),
    })
}

/// Name of the report's face.
pub(super) fn face_name(bench: &Workbench) -> String {
    match &bench.options.report_face {
        ReportFace::Composite => PORTRAIT_NAME.to_owned(),
        ReportFace::Photograph { image, .. } => image.file_name().unwrap_or_default().to_string_lossy().into_owned(),
    }
}

/// As [`thumbnails`] for a sequence that landmarks drive, whose images are not needed: `None` if one cannot be read, or if the landmarks
/// are not in its pixels.
pub(super) fn thumbnails_beside(images: &FrameSource, frames: &[TrackedFrame], bench: &Workbench) -> Option<[Vec<u8>; 2]> {
    let size = read_first_frame(images).ok()?.size();
    let ends = [frames.first()?, frames.last()?];
    let is_inside = |frame: &TrackedFrame| {
        let of_eyes = frame.nodes.iter().enumerate().filter(|(k, _)| bench.tables.region(NodeId(*k as u16)) == Region::Eye);
        of_eyes.into_iter().all(|(_, node)| size.contains(&node.position))
    };
    ends.into_iter().all(is_inside).then(|| thumbnails(images, frames, bench).ok().flatten())?
}

/// Returns JPEG files of the wireframe on the neutral and on the apex frame, at most [`MOST_BYTES`] each; `None` for a picture that cannot
/// be made so small.
///
/// # Errors
/// [`SequenceFailure`] when a frame cannot be read that was readable for tracking. Without its pictures the report would not be
/// reproducible.
pub(super) fn thumbnails(
    source: &FrameSource,
    frames: &[TrackedFrame],
    bench: &Workbench,
) -> Result<Option<[Vec<u8>; 2]>, SequenceFailure> {
    let (Some(first), Some(last)) = (frames.first(), frames.last()) else { return Ok(None) };
    let wanted = [first.number, last.number];
    let pictures = read_colour_frames(source, &wanted).map_err(SequenceFailure::at(Stage::Track))?;
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
