//! The expression bank [ZL, section 2]: a neutral mesh, members over its topology, and the vertices of MPEG-4 feature points.

use std::{borrow::Cow, collections::BTreeSet, path::Path};

use memmap2::Mmap;
use serde::{Deserialize, Serialize};

use super::{BankError, file};
use crate::{
    mesh::{TriangleMesh, check_finite},
    units::FeaturePoint,
};

/// The vertex that represents a feature point.
///
/// ```
/// use grimace::synthesis::candide_bank;
///
/// let bank = candide_bank()?;
/// let corner = bank.feature_points().iter().find(|point| point.fp.to_string() == "8.3").expect("8.3");
/// assert!((corner.vertex as usize) < bank.vertex_count());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FeaturePointVertex {
    /// The feature point.
    pub fp: FeaturePoint,
    /// Index of its vertex.
    pub vertex: u32,
}

/// How the members of a mixed bank are composed of shapes.
///
/// ```
/// use grimace::synthesis::candide_bank;
///
/// let bank = candide_bank()?;
/// let composition = bank.info().composition.as_ref().expect("members are mixed of motion units");
/// assert_eq!(composition.weights.len(), bank.member_count());
/// assert!(composition.weights.iter().all(|weights| weights.len() == composition.shapes.len()));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Composition {
    /// Names of the shapes.
    pub shapes: Vec<String>,
    /// Weights of the shapes for each member.
    pub weights: Vec<Vec<f64>>,
}

/// Description of a bank: origin, unit, licence, composition and colours.
///
/// ```
/// use grimace::synthesis::BankInfo;
///
/// let info = BankInfo { credit: "scans of my own, CC BY 4.0".to_owned(), ..BankInfo::default() };
/// assert!(info.composition.is_none());
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BankInfo {
    /// Program and version that made the bank.
    pub made_by: String,
    /// Name of the unit of lengths.
    pub unit: String,
    /// What it was made from.
    pub source: String,
    /// Authors and licence.
    pub credit: String,
    /// How the members are mixed from shapes; `None` for members that are not mixed.
    pub composition: Option<Composition>,
    /// Colours of all vertices, sRGB, for a mesh with parts other than skin: eyes, teeth, brows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub paint: Option<Vec<[u8; 3]>>,
}

/// Displacements of all members, in memory or in a mapped file.
#[derive(Debug)]
pub(super) enum Displacements {
    /// All members, one after another.
    Owned(Vec<[f32; 3]>),
    /// In a mapped file, starting at this byte.
    Mapped(Mmap, usize),
}

/// An expression bank: V vertices, M members, F feature points.
///
/// Every displacement is finite, every feature point is a vertex of the mesh, and names and feature points are unique. When a
/// bank is read from a file, the displacements stay there (memory-mapped). A bank of any size therefore needs little more memory
/// than its neutral mesh.
///
/// ```
/// use grimace::{mesh::TriangleMesh, synthesis::{Bank, BankInfo, FeaturePointVertex}};
///
/// let mesh = TriangleMesh::new(vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]], vec![[0, 1, 2]])?;
/// let corner = FeaturePointVertex { fp: "8.3".parse()?, vertex: 1 };
/// let info = BankInfo { unit: "cm".to_owned(), ..BankInfo::default() };
/// let bank = Bank::new(mesh, vec!["smile".to_owned()], vec![[0.0; 3], [0.5, 0.5, 0.0], [0.0; 3]], vec![corner], info)?;
/// assert_eq!((bank.vertex_count(), bank.member_count(), bank.names()[0].as_str()), (3, 1, "smile"));
/// assert_eq!(bank.displacements(0)[1], [0.5, 0.5, 0.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Bank {
    mesh: TriangleMesh,
    names: Vec<String>,
    feature_points: Vec<FeaturePointVertex>,
    info: BankInfo,
    displacements: Displacements,
    is_old_file: bool,
}

impl Bank {
    /// Creates a bank in memory. `displacements` has V vectors for each of the M names.
    ///
    /// # Errors
    /// [`BankError`] when there are no members or feature points, counts do not match, numbers are not finite, or names or
    /// feature points occur twice.
    pub fn new(
        mesh: TriangleMesh,
        names: Vec<String>,
        displacements: Vec<[f32; 3]>,
        feature_points: Vec<FeaturePointVertex>,
        info: BankInfo,
    ) -> Result<Self, BankError> {
        let expected = mesh.vertex_count();
        if displacements.len() != expected * names.len() {
            let name = names.last().cloned().unwrap_or_default();
            let found = displacements.len().saturating_sub(expected * names.len().saturating_sub(1));
            return Err(BankError::VertexCount { name, found, expected });
        }
        Self::from_parts(mesh, names, feature_points, info, Displacements::Owned(displacements))
    }

    /// Checks everything except the number of displacements, which the caller checks.
    pub(super) fn from_parts(
        mesh: TriangleMesh,
        names: Vec<String>,
        feature_points: Vec<FeaturePointVertex>,
        info: BankInfo,
        displacements: Displacements,
    ) -> Result<Self, BankError> {
        check_head(&mesh, &names, &feature_points)?;
        if let Some(found) = info.paint.as_ref().map(Vec::len).filter(|&found| found != mesh.vertex_count()) {
            return Err(BankError::VertexCount { name: "paint".to_owned(), found, expected: mesh.vertex_count() });
        }
        let bank = Self { mesh, names, feature_points, info, displacements, is_old_file: false };
        for (member, name) in bank.names.iter().enumerate() {
            check_member(name, bank.displacements(member), &bank.mesh)?;
        }
        Ok(bank)
    }

    /// Marks a bank as read from a file of version 1.
    pub(super) fn of_old_file(self) -> Self {
        Self { is_old_file: true, ..self }
    }

    /// Whether the bank was read from a file of version 1. `grimace bank convert` rewrites such a file.
    pub fn is_old_file(&self) -> bool {
        self.is_old_file
    }

    /// Whether the displacements are used directly from their mapped file.
    pub fn is_mapped(&self) -> bool {
        matches!(self.displacements, Displacements::Mapped(..))
    }

    /// Opens a bank file; the displacements stay in the file.
    ///
    /// # Errors
    /// [`BankError::Format`] for a file that is damaged or of another version; and the errors of [`Bank::new`].
    pub fn open(path: &Path) -> Result<Self, BankError> {
        file::open(path)
    }

    /// Writes the bank file.
    ///
    /// # Errors
    /// [`BankError::Output`].
    pub fn write(&self, path: &Path) -> Result<(), BankError> {
        let head = BankHead { mesh: &self.mesh, names: &self.names, feature_points: &self.feature_points, info: &self.info };
        file::write(path, &head, |member| Ok(Cow::Borrowed(self.displacements(member))))
    }

    /// The neutral mesh.
    pub fn mesh(&self) -> &TriangleMesh {
        &self.mesh
    }

    /// Number of vertices V.
    pub fn vertex_count(&self) -> usize {
        self.mesh.vertex_count()
    }

    /// Names of the members.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Number of members M.
    pub fn member_count(&self) -> usize {
        self.names.len()
    }

    /// The feature points with their vertices.
    pub fn feature_points(&self) -> &[FeaturePointVertex] {
        &self.feature_points
    }

    /// Index of a feature point in [`Bank::feature_points`].
    pub fn feature_point_index(&self, fp: FeaturePoint) -> Option<usize> {
        self.feature_points.iter().position(|p| p.fp == fp)
    }

    /// Neutral position of a feature point; `None` when the bank does not have it.
    pub fn feature_point_position(&self, fp: FeaturePoint) -> Option<[f32; 3]> {
        self.feature_point_index(fp).map(|k| self.mesh.positions()[self.feature_points[k].vertex as usize])
    }

    /// Colours of all vertices, sRGB; `None` when the mesh is only skin.
    pub fn paint(&self) -> Option<&[[u8; 3]]> {
        self.info.paint.as_deref()
    }

    /// Description of the bank.
    pub fn info(&self) -> &BankInfo {
        &self.info
    }

    /// Displacements of all vertices from neutral in a member, in the bank's unit.
    ///
    /// # Panics
    /// If `member` is not less than the number of members (a programming error).
    pub fn displacements(&self, member: usize) -> &[[f32; 3]] {
        let count = self.mesh.vertex_count();
        match &self.displacements {
            Displacements::Owned(all) => &all[member * count..(member + 1) * count],
            Displacements::Mapped(map, start) => {
                let bytes = 12 * count;
                bytemuck::cast_slice(&map[start + member * bytes..start + (member + 1) * bytes])
            }
        }
    }

    /// Returns a bank of the given members, in the given order.
    ///
    /// # Errors
    /// The errors of [`Bank::new`]; [`BankError::Number`] for a member that does not exist.
    pub fn select(&self, members: &[usize]) -> Result<Self, BankError> {
        let mut displacements = Vec::with_capacity(members.len() * self.vertex_count());
        for &member in members {
            if member >= self.member_count() {
                let expected = format!("0 to {}", self.member_count() - 1);
                return Err(BankError::Number { what: "the member", found: member.to_string(), expected });
            }
            displacements.extend_from_slice(self.displacements(member));
        }
        let composition = self.info.composition.as_ref().map(|c| Composition {
            shapes: c.shapes.clone(),
            weights: members.iter().map(|&m| c.weights.get(m).cloned().unwrap_or_default()).collect(),
        });
        let names = members.iter().map(|&m| self.names[m].clone()).collect();
        let info = BankInfo { composition, ..self.info.clone() };
        Self::new(self.mesh.clone(), names, displacements, self.feature_points.clone(), info)
    }
}

/// Everything in a bank except its displacements.
#[derive(Clone, Copy, Debug)]
pub struct BankHead<'a> {
    /// The neutral mesh.
    pub mesh: &'a TriangleMesh,
    /// Names of the members.
    pub names: &'a [String],
    /// Feature points.
    pub feature_points: &'a [FeaturePointVertex],
    /// Description of the bank.
    pub info: &'a BankInfo,
}

pub(super) fn check_head(mesh: &TriangleMesh, names: &[String], feature_points: &[FeaturePointVertex]) -> Result<(), BankError> {
    if names.is_empty() {
        return Err(BankError::NoMembers);
    }
    let mut seen = BTreeSet::new();
    if let Some(name) = names.iter().find(|n| !seen.insert(n.as_str())) {
        return Err(BankError::DuplicateMember { name: name.clone() });
    }
    if feature_points.is_empty() {
        return Err(BankError::NoFeaturePoints);
    }
    let mut seen = BTreeSet::new();
    for &FeaturePointVertex { fp, vertex } in feature_points {
        let count = mesh.vertex_count();
        if vertex as usize >= count {
            return Err(BankError::NoSuchVertex { fp, vertex: u64::from(vertex), count });
        }
        if !fp.is_of_mpeg4() {
            return Err(BankError::NoSuchFeaturePoint { fp, vertex });
        }
        if !seen.insert(fp) {
            return Err(BankError::DuplicateFeaturePoint { fp });
        }
    }
    Ok(())
}

/// Checks the displacements of a member: one for each neutral vertex, finite, and none longer than [`MAX_DIAGONALS`].
pub(super) fn check_member(name: &str, displacements: &[[f32; 3]], neutral: &TriangleMesh) -> Result<(), BankError> {
    let expected = neutral.vertex_count();
    if displacements.len() != expected {
        return Err(BankError::VertexCount { name: name.to_owned(), found: displacements.len(), expected });
    }
    if let Err(crate::mesh::MeshError::NotFinite { vertex, .. }) = check_finite(displacements) {
        return Err(BankError::NotFinite { name: name.to_owned(), vertex });
    }
    let limit = MAX_DIAGONALS * neutral.diagonal();
    let length = |d: &[f32; 3]| d.iter().map(|c| f64::from(*c).powi(2)).sum::<f64>().sqrt();
    match displacements.iter().position(|d| length(d) > limit) {
        Some(vertex) => {
            Err(BankError::Implausible { name: name.to_owned(), vertex, length: length(&displacements[vertex]), limit })
        }
        None => Ok(()),
    }
}

/// Longest displacement of a member, in diagonals of the neutral mesh; longer ones mean that the mesh is not of the same face.
const MAX_DIAGONALS: f64 = 10.0;
