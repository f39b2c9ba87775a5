//! The files of normalized models and representatives.

use std::path::{Path, PathBuf};

use crate::{
    model::{DynamicExpressionModel, FrameExpressionModel, ModelError},
    output::{OutputError, nine_digits, write_atomic},
    plausible::{FaceSize, Implausible},
    units::FaceUnit,
};

/// Writes a normalized model or a representative: `frame,node,x,y`, face units, frames from 0.
///
/// # Errors
/// [`OutputError`].
pub fn write_model(path: &Path, model: &DynamicExpressionModel<FaceUnit>) -> Result<(), OutputError> {
    write_atomic(path, |out| {
        writeln!(out, "frame,node,x,y")?;
        for (m, frame) in model.frames().iter().enumerate() {
            for (k, point) in frame.nodes().iter().enumerate() {
                writeln!(out, "{m},{k},{},{}", nine_digits(point.x), nine_digits(point.y))?;
            }
        }
        Ok(())
    })
}

/// A model file that does not read.
#[derive(Debug, thiserror::Error)]
pub enum ModelFileError {
    /// It does not read as a table of `frame,node,x,y`.
    #[error(transparent)]
    Table(#[from] crate::track::TrackFileError),
    /// Its frames do not make a model.
    #[error("{}: {source}", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// Why.
        source: ModelError,
    },
    /// It moves as no face does.
    #[error("{}, {source}", path.display())]
    Implausible {
        /// The file.
        path: PathBuf,
        /// Frame, node and offset.
        source: Implausible,
    },
}

/// Reads a normalized model or a representative.
///
/// # Errors
/// [`ModelFileError`] with the line.
pub fn read_model(path: &Path) -> Result<DynamicExpressionModel<FaceUnit>, ModelFileError> {
    let frames = crate::track::read_track(path)?;
    let frame = |f: crate::track::TrackedFrame| FrameExpressionModel::new(f.nodes.iter().map(|n| n.position).collect());
    let model = DynamicExpressionModel::new(frames.into_iter().map(frame).collect());
    let model = model.map_err(|source| ModelFileError::Model { path: path.to_owned(), source })?;
    let checked = FaceSize::CANONICAL.check_model(&model);
    checked.map_err(|source| ModelFileError::Implausible { path: path.to_owned(), source })?;
    Ok(model)
}
