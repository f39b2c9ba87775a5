//! The files of normalized models and representatives.

use std::path::{Path, PathBuf};

use crate::{
    model::DynamicExpressionModel,
    normalize::{NotFaceUnits, check_face_units},
    output::{OutputError, nine_digits, write_hashed},
    plausible::{FaceSize, Implausible},
    positions::{PositionTable, PositionsError},
    units::FaceUnit,
};

/// Writes a normalized model or a representative as `frame,node,x,y`, in face units, frames from 0. Returns the BLAKE3 of the file.
///
/// ```
/// use grimace::pipeline::{read_model, write_model};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("copy.csv");
/// let happiness = read_model("fixtures/golden/representatives/happiness.csv".as_ref())?;
/// write_model(&path, &happiness)?;
/// assert_eq!(read_model(&path)?, happiness);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`OutputError`].
pub fn write_model(path: &Path, model: &DynamicExpressionModel<FaceUnit>) -> Result<blake3::Hash, OutputError> {
    write_hashed(path, |out| {
        writeln!(out, "frame,node,x,y")?;
        for (m, frame) in model.frames().iter().enumerate() {
            for (k, point) in frame.nodes().iter().enumerate() {
                writeln!(out, "{m},{k},{},{}", nine_digits(point.x), nine_digits(point.y))?;
            }
        }
        Ok(())
    })
}

/// Errors of reading a model file.
///
/// ```
/// use grimace::pipeline::{ModelFileError, read_model};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("model.csv");
/// std::fs::write(&path, "frame,node,x,y\n0,0,zero,0\n")?;
/// assert!(matches!(read_model(&path), Err(ModelFileError::Positions(_))));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum ModelFileError {
    /// The file is not a table of `frame,node,x,y` with complete frames.
    #[error(transparent)]
    Positions(#[from] PositionsError),
    /// A model whose neutral face is not in face units.
    #[error("{}: {source}", path.display())]
    NotFaceUnits {
        /// The file.
        path: PathBuf,
        /// The unit it has instead.
        source: NotFaceUnits,
    },
    /// The motion is impossible for a face.
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
/// ```
/// use grimace::pipeline::read_model;
///
/// let happiness = read_model("fixtures/golden/representatives/happiness.csv".as_ref())?;
/// assert_eq!((happiness.frame_count(), happiness.node_count()), (5, 113));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`ModelFileError`] with the line.
pub fn read_model(path: &Path) -> Result<DynamicExpressionModel<FaceUnit>, ModelFileError> {
    let model = PositionTable::open(path).map_err(PositionsError::from)?.model()?;
    let checked = FaceSize::CANONICAL.check_model(&model);
    checked.map_err(|source| ModelFileError::Implausible { path: path.to_owned(), source })?;
    let upright = check_face_units(model.neutral().nodes());
    upright.map_err(|source| ModelFileError::NotFaceUnits { path: path.to_owned(), source })?;
    Ok(model)
}
