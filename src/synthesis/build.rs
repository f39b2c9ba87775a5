//! `bank build`: writes a bank file from a source, with one member in memory at a time.

use std::{
    borrow::Cow,
    path::{Path, PathBuf},
};

use super::{
    BankError, BankHead, BankInfo, FeaturePointVertex,
    feature_points::{place_feature_points, read_feature_points, read_landmark_vertices, skin_feature_points},
    file,
    source::{BankSource, source_files},
};
use crate::{mesh::Subdivision, output::MADE_BY, units::FeaturePoint};

/// Options of [`build_bank`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BuildOptions {
    /// CSV file `fp,vertex`; `None` uses the source's own feature points, or places them by landmarks.
    pub feature_points: Option<PathBuf>,
    /// CSV file `landmark,vertex` for placing feature points.
    pub landmarks: Option<PathBuf>,
    /// Part of the surface to keep, by its name in the source's manifest.
    pub part: Option<String>,
    /// Mesh of a glTF file; by default the one with the most targets that have `ARKit` names.
    pub mesh: Option<String>,
    /// Number of rounds of smooth subdivision.
    pub subdivide: usize,
    /// Name of the unit of lengths; `None` uses the source's.
    pub unit: Option<String>,
    /// Authors and licence; `None` uses the source's.
    pub credit: Option<String>,
}

/// Largest number of rounds of subdivision: each triangle becomes 256.
pub const MAX_SUBDIVIDE: usize = 4;

/// Summary of a built bank.
#[derive(Clone, Debug, PartialEq)]
pub struct BuildSummary {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Number of members.
    pub members: usize,
    /// Feature points with their vertices.
    pub feature_points: Vec<FeaturePointVertex>,
    /// Description of where the feature points came from.
    pub feature_points_from: String,
    /// Feature points of a face's skin that the bank does not have.
    pub missing: Vec<FeaturePoint>,
    /// Meshes of the source that were not used, with their number of morph targets.
    pub other_meshes: Vec<String>,
}

/// Builds a bank file from a source.
///
/// It needs memory for the neutral mesh, the subdivision rule and one member (for `NumPy` arrays and folders; a glTF file is
/// loaded as a whole).
///
/// # Errors
/// [`BankError`].
pub fn build_bank(source_path: &Path, output: &Path, options: &BuildOptions) -> Result<BuildSummary, BankError> {
    if options.subdivide > MAX_SUBDIVIDE {
        let (found, expected) = (options.subdivide.to_string(), format!("0 to {MAX_SUBDIVIDE}"));
        return Err(BankError::Number { what: "the number of subdivisions", found, expected });
    }
    let read = source_files(source_path).into_iter().chain(options.feature_points.clone()).chain(options.landmarks.clone());
    let real = |path: &Path| path.canonicalize().ok();
    if real(output).is_some_and(|output| read.into_iter().any(|file| real(&file).is_some_and(|file| file == output))) {
        return Err(BankError::OverSource { path: output.to_owned() });
    }
    let mut source = BankSource::open(source_path, options.mesh.as_deref())?;
    let kept = match &options.part {
        None => source.mesh.vertex_count(),
        Some(name) => *source
            .about
            .parts
            .get(name)
            .ok_or_else(|| BankError::NoSuchPart { name: name.clone(), found: source.about.parts.keys().cloned().collect() })?,
    };
    let coarse = source.mesh.first_vertices(kept)?;
    let kept = coarse.vertex_count();
    let rule = Subdivision::new(&coarse, options.subdivide)?;
    let mesh = rule.refine_mesh(&coarse)?;
    let (points, from) = feature_points(options, &source, &coarse)?;
    let info = BankInfo {
        made_by: MADE_BY.to_owned(),
        unit: options.unit.clone().unwrap_or_else(|| source.about.unit.clone()),
        source: source_path.file_name().unwrap_or(source_path.as_os_str()).to_string_lossy().into_owned(),
        credit: options.credit.clone().unwrap_or_else(|| source.about.credit.clone()),
        composition: None,
        paint: None,
    };
    let names = source.names.clone();
    let head = BankHead { mesh: &mesh, names: &names, feature_points: &points, info: &info };
    file::write(output, &head, |member| {
        let mut displacements = source.next_member(&names[member])?;
        displacements.truncate(kept);
        Ok(Cow::Owned(if options.subdivide == 0 { displacements } else { rule.refine(&displacements) }))
    })?;
    let missing = skin_feature_points().filter(|fp| points.iter().all(|p| p.fp != *fp)).collect();
    Ok(BuildSummary {
        vertices: mesh.vertex_count(),
        triangles: mesh.triangles().len(),
        members: names.len(),
        feature_points: points,
        feature_points_from: from,
        missing,
        other_meshes: source.about.other_meshes,
    })
}

/// Finds the feature points. They are placed on the coarse mesh, because subdivision keeps the indices of old vertices.
fn feature_points(
    options: &BuildOptions,
    source: &BankSource,
    coarse: &crate::mesh::TriangleMesh,
) -> Result<(Vec<FeaturePointVertex>, String), BankError> {
    if let Some(path) =
        options.feature_points.as_ref().or(source.about.feature_points.as_ref().filter(|_| options.landmarks.is_none()))
    {
        return Ok((read_feature_points(path, coarse.vertex_count())?, path.display().to_string()));
    }
    let landmarks = match &options.landmarks {
        Some(path) => Some(read_landmark_vertices(path)?),
        None => source.about.landmarks.clone(),
    };
    let landmarks = landmarks.ok_or(BankError::NoFeaturePoints)?;
    Ok((place_feature_points(coarse, &landmarks)?, "the 68 landmarks".to_owned()))
}
