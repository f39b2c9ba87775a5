//! Errors of banks and synthesis.

use std::path::PathBuf;

use crate::{
    fap::{ConvertError, FapReadError},
    input::InputError,
    mesh::{MeshError, MeshFileError},
    model::ModelError,
    normalize::{NormalizeError, NotFaceUnits},
    output::OutputError,
    plausible::Implausible,
    positions::PositionsError,
    track::TrackFileError,
    units::FeaturePoint,
    wireframe::FapusError,
};

/// A bank that cannot be made, read or used.
///
/// ```
/// # let mesh = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// # let mesh = grimace::mesh::TriangleMesh::new(mesh, vec![[0, 1, 2], [0, 2, 3]])?;
/// # let names = ["right", "up"].map(str::to_owned).to_vec();
/// # let moves = [[[1.0, 0.0, 0.0]; 4], [[0.0, 1.0, 0.0]; 4]].concat();
/// # let points = [("8.4", 0), ("8.3", 1), ("3.11", 2)];
/// # let points = points.map(|(fp, vertex)| grimace::synthesis::FeaturePointVertex { fp: fp.parse().unwrap(), vertex }).to_vec();
/// # let bank = grimace::synthesis::Bank::new(mesh, names, moves, points, Default::default())?;
/// use grimace::synthesis::{Bank, BankError};
///
/// // The two members of `bank` move all vertices by 1: to the right, and up.
/// let mesh = bank.mesh().clone();
/// let error = Bank::new(mesh, vec![], vec![], bank.feature_points().to_vec(), Default::default()).unwrap_err();
/// assert!(matches!(error, BankError::NoMembers));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum BankError {
    /// A mesh or array file cannot be read.
    #[error(transparent)]
    File(#[from] MeshFileError),
    /// A CSV file cannot be read.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A file that cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The neutral mesh is invalid.
    #[error("the neutral mesh: {0}")]
    Mesh(#[from] MeshError),
    /// A folder or file without a source for a bank.
    #[error("{}: {reason}", path.display())]
    Source {
        /// Folder or file.
        path: PathBuf,
        /// What was found and what was expected.
        reason: String,
    },
    /// A bank file that is damaged or of another version.
    #[error("{} is not a readable bank: {reason}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The bank would overwrite a file from which it is built.
    #[error("{}: the bank would overwrite a file that it is built from; give it another name", path.display())]
    OverSource {
        /// The bank file to be written.
        path: PathBuf,
    },
    /// The bank has no members.
    #[error("the bank has no members; it needs at least one expression in addition to the neutral mesh")]
    NoMembers,
    /// Two members have the same name.
    #[error("two members are named `{name}`; names must differ")]
    DuplicateMember {
        /// The name.
        name: String,
    },
    /// A member with another number of vertices.
    #[error("member `{name}` has {found} vertices, but the neutral mesh has {expected}; all meshes must share one topology")]
    VertexCount {
        /// The member.
        name: String,
        /// Its number of vertices.
        found: usize,
        /// Number of vertices of the neutral mesh.
        expected: usize,
    },
    /// A member whose triangles differ from the neutral mesh.
    #[error("member `{name}` differs from the neutral mesh in triangle {triangle}; all meshes must share one topology")]
    Topology {
        /// The member.
        name: String,
        /// First triangle that differs, from 0.
        triangle: usize,
    },
    /// A displacement that is NaN or infinite.
    #[error("member `{name}`: vertex {vertex} has a displacement that is not a finite number")]
    NotFinite {
        /// The member.
        name: String,
        /// The vertex.
        vertex: usize,
    },
    /// A displacement that is impossible for a face.
    #[error(
        "member `{name}`: vertex {vertex} is displaced by {length:.3e}, further than ten times the neutral mesh's diagonal ({limit:.3e}); \
         check that it has the same units as the neutral mesh"
    )]
    Implausible {
        /// The member.
        name: String,
        /// The vertex.
        vertex: usize,
        /// Length of its displacement, units of the mesh.
        length: f64,
        /// Largest allowed length.
        limit: f64,
    },
    /// A feature point at a vertex that the mesh does not have.
    #[error("feature point {fp} is at vertex {vertex}, but the mesh has {count} vertices (0 to {})", count.saturating_sub(1))]
    NoSuchVertex {
        /// The feature point.
        fp: FeaturePoint,
        /// Its vertex.
        vertex: u64,
        /// Number of vertices.
        count: usize,
    },
    /// A feature point that MPEG-4 does not have.
    #[error(
        "feature point {fp} (vertex {vertex}) is not one of the 84 of MPEG-4, such as 8.3; correct its name, or leave it out"
    )]
    NoSuchFeaturePoint {
        /// The feature point.
        fp: FeaturePoint,
        /// Its vertex.
        vertex: u32,
    },
    /// A feature point given twice.
    #[error("feature point {fp} appears twice; keep one")]
    DuplicateFeaturePoint {
        /// The feature point.
        fp: FeaturePoint,
    },
    /// No feature points.
    #[error("the bank has no feature points; give them as a CSV file `fp,vertex` (--feature-points)")]
    NoFeaturePoints,
    /// A member or shape that does not exist.
    #[error("there is no `{name}`; choose from {}", found.join(", "))]
    NoSuchMember {
        /// The requested name.
        name: String,
        /// The names that exist.
        found: Vec<String>,
    },
    /// A part of the surface that the source does not have.
    #[error(
        "the source has no part `{name}` of its surface: {}",
        if found.is_empty() {
            "it has no named parts that begin at vertex 0 (`regions` in the manifest.json beside NumPy arrays); leave --part out".to_owned()
        } else {
            format!("there are {}", found.join(", "))
        }
    )]
    NoSuchPart {
        /// The requested part.
        name: String,
        /// The parts that exist.
        found: Vec<String>,
    },
    /// A number that does not match what was expected.
    #[error("{what} is {found}; {expected} was expected")]
    Number {
        /// Name of the quantity.
        what: &'static str,
        /// The number.
        found: String,
        /// What was expected.
        expected: String,
    },
}

/// A motion that cannot be read or synthesized.
///
/// ```
/// # let mesh = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// # let mesh = grimace::mesh::TriangleMesh::new(mesh, vec![[0, 1, 2], [0, 2, 3]])?;
/// # let names = ["right", "up"].map(str::to_owned).to_vec();
/// # let moves = [[[1.0, 0.0, 0.0]; 4], [[0.0, 1.0, 0.0]; 4]].concat();
/// # let points = [("8.4", 0), ("8.3", 1), ("3.11", 2)];
/// # let points = points.map(|(fp, vertex)| grimace::synthesis::FeaturePointVertex { fp: fp.parse().unwrap(), vertex }).to_vec();
/// # let bank = grimace::synthesis::Bank::new(mesh, names, moves, points, Default::default())?;
/// use grimace::synthesis::{SynthesisError, SynthesisOptions, Synthesizer};
///
/// // The two members of `bank` move all vertices by 1: to the right, and up.
/// let options = SynthesisOptions { overlap: 2.0, ..SynthesisOptions::default() };
/// let error = Synthesizer::new(&bank, options).unwrap_err();
/// assert!(matches!(error, SynthesisError::Option { found, .. } if found == "2"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum SynthesisError {
    /// The bank cannot be read or built.
    #[error(transparent)]
    Bank(#[from] BankError),
    /// A head with too few feature points to show a portrait.
    #[error("the bank has only {found} of the feature points of a portrait; it needs {needed} to show a portrait")]
    Portrait {
        /// Number of shared feature points.
        found: usize,
        /// Number required.
        needed: usize,
    },
    /// A CSV file cannot be read.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A track cannot be read.
    #[error(transparent)]
    Track(#[from] TrackFileError),
    /// A model cannot be read.
    #[error(transparent)]
    Positions(#[from] PositionsError),
    /// A track that cannot be normalized.
    #[error("{}: {source}", path.display())]
    Normalize {
        /// The track.
        path: PathBuf,
        /// The reason.
        source: NormalizeError,
    },
    /// The frames do not form a model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The FAPUs of the wireframe cannot be measured.
    #[error(transparent)]
    Fapus(#[from] FapusError),
    /// A FAP file cannot be read.
    #[error(transparent)]
    Fap(#[from] FapReadError),
    /// FAP values that cannot be converted to a motion.
    #[error(transparent)]
    Convert(#[from] ConvertError),
    /// A file that cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// An animation whose parts do not fit together.
    #[error("{name}: {reason}")]
    Animation {
        /// Its name.
        name: String,
        /// What was found and what was expected.
        reason: String,
    },
    /// A motion file of an unknown kind.
    #[error("{}: {reason}", path.display())]
    Motion {
        /// The file.
        path: PathBuf,
        /// What was found and what was expected.
        reason: String,
    },
    /// A model whose neutral face is not in face units.
    #[error("{}: {source}", path.display())]
    NotFaceUnits {
        /// The file.
        path: PathBuf,
        /// The unit found instead.
        source: NotFaceUnits,
    },
    /// A motion that is impossible for a face.
    #[error("{}, {source}", path.display())]
    Implausible {
        /// The file.
        path: PathBuf,
        /// Frame, feature point and offset.
        source: Implausible,
    },
    /// The feature points of the bank do not determine the size of the face.
    #[error("the bank's facial animation units cannot be measured: {reason}")]
    Scale {
        /// What is missing.
        reason: String,
    },
    /// None of the motion's feature points is in the bank.
    #[error("the motion has no feature points in common with the bank, which has {}", found.join(", "))]
    NothingInCommon {
        /// Feature points of the bank.
        found: Vec<String>,
    },
    /// An option out of range.
    #[error("{what} is {found}; {expected} was expected")]
    Option {
        /// The option.
        what: &'static str,
        /// The value given.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// A picture that cannot be encoded.
    #[error("cannot create the picture: {0}")]
    Picture(#[from] image::ImageError),
}
