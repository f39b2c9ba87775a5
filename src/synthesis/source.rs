//! Sources of banks: a folder of OBJ or PLY files, a glTF file with morph targets, or `NumPy` arrays.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use serde::Deserialize;

use super::{BankError, arkit::coefficient, bank::check_member};
use crate::mesh::{
    MeshFileError, NpyRows, TriangleMesh,
    gltf::{buffer_files, read_gltf},
    read_npy_indices, read_npy_rows, read_obj, read_ply, sub,
};

/// A neutral mesh with its members, which are read one after another.
pub struct BankSource {
    /// The neutral mesh.
    pub mesh: TriangleMesh,
    /// Names of the members.
    pub names: Vec<String>,
    /// Metadata of the source.
    pub about: About,
    members: Members,
}

/// Metadata that a source stores beside its meshes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct About {
    /// Name of the unit of lengths; empty if unknown.
    pub unit: String,
    /// Authors and licence; empty if unknown.
    pub credit: String,
    /// Vertex indices of the 68 landmarks.
    pub landmarks: Option<Vec<u32>>,
    /// Named parts of the surface; each consists of this many first vertices.
    pub parts: BTreeMap<String, usize>,
    /// Path of the folder's `feature_points.csv`.
    pub feature_points: Option<PathBuf>,
    /// Other meshes of a glTF file that have morph targets, with the number of targets.
    pub other_meshes: Vec<String>,
}

enum Members {
    Files(std::vec::IntoIter<PathBuf>),
    Arrays(NpyRows),
    Targets(std::vec::IntoIter<Vec<[f32; 3]>>),
}

impl BankSource {
    /// Opens a source and reads its neutral mesh.
    ///
    /// # Errors
    /// [`BankError`] for a folder or file that is no source, and for files that cannot be read.
    pub fn open(path: &Path, mesh: Option<&str>) -> Result<Self, BankError> {
        if !path.is_dir() {
            return open_gltf(path, mesh);
        }
        if let Some(mesh) = mesh {
            let reason = format!("--mesh {mesh} needs a .glb or .gltf file; other sources have no named meshes");
            return Err(BankError::Source { path: path.to_owned(), reason });
        }
        if path.join("neutral_vertices.npy").is_file() {
            return open_arrays(path);
        }
        open_folder(path)
    }

    /// Reads the displacements of the next member for all vertices of the neutral mesh.
    ///
    /// # Errors
    /// [`BankError`] for a file that cannot be read, another topology, or numbers that are not finite.
    pub fn next_member(&mut self, name: &str) -> Result<Vec<[f32; 3]>, BankError> {
        let missing = || BankError::NoSuchMember { name: name.to_owned(), found: Vec::new() };
        let displacements = match &mut self.members {
            Members::Files(files) => difference(&self.mesh, &read_mesh(&files.next().ok_or_else(missing)?)?, name)?,
            Members::Arrays(rows) => rows.next_block()?.as_chunks::<3>().0.to_vec(),
            Members::Targets(targets) => targets.next().ok_or_else(missing)?,
        };
        check_member(name, &displacements, &self.mesh)?;
        Ok(displacements)
    }
}

/// Lists the files that a bank is read from: the meshes or arrays of a folder with their metadata files, or a glTF file with its
/// buffers.
pub fn source_files(path: &Path) -> Vec<PathBuf> {
    if !path.is_dir() {
        let mut files = buffer_files(path);
        files.push(path.to_owned());
        return files;
    }
    let is_read = |file: &PathBuf| {
        let named = ["feature_points.csv", "manifest.json"].iter().any(|name| file.file_name().is_some_and(|n| n == *name));
        named || ["obj", "ply", "npy"].iter().any(|extension| has_extension(file, extension))
    };
    fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path()).filter(is_read).collect()
}

fn read_mesh(path: &Path) -> Result<TriangleMesh, MeshFileError> {
    if has_extension(path, "ply") { read_ply(path) } else { read_obj(path) }
}

fn has_extension(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(wanted))
}

/// Returns the displacements of a member mesh from the neutral one, which must have the same triangles.
fn difference(neutral: &TriangleMesh, member: &TriangleMesh, name: &str) -> Result<Vec<[f32; 3]>, BankError> {
    let (expected, found) = (neutral.vertex_count(), member.vertex_count());
    if found != expected {
        return Err(BankError::VertexCount { name: name.to_owned(), found, expected });
    }
    if neutral.triangles() != member.triangles() {
        let pairs = neutral.triangles().iter().zip(member.triangles());
        let triangle = pairs.take_while(|(a, b)| a == b).count();
        return Err(BankError::Topology { name: name.to_owned(), triangle });
    }
    Ok(member.positions().iter().zip(neutral.positions()).map(|(&p, &q)| sub(p, q)).collect())
}

fn open_folder(path: &Path) -> Result<BankSource, BankError> {
    let source = |reason: String| BankError::Source { path: path.to_owned(), reason };
    let entries = fs::read_dir(path).map_err(|e| source(e.to_string()))?;
    let mut files = Vec::new();
    for entry in entries {
        let file = entry.map_err(|e| source(e.to_string()))?.path();
        if has_extension(&file, "obj") || has_extension(&file, "ply") {
            files.push(file);
        }
    }
    let stem = |file: &Path| file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    files.sort_by(|a, b| natord::compare(&stem(a), &stem(b)).then_with(|| a.cmp(b)));
    let neutral = files.iter().position(|f| stem(f).eq_ignore_ascii_case("neutral"));
    let Some(neutral) = neutral.map(|k| files.remove(k)) else {
        return Err(source(format!(
            "found {} OBJ or PLY files but no neutral.obj or neutral.ply, and no neutral_vertices.npy; a bank is built from \
             neutral.obj and one OBJ per expression, from a .glb file, or from NumPy arrays",
            files.len()
        )));
    };
    let points = path.join("feature_points.csv");
    let about = About { feature_points: points.is_file().then_some(points), ..About::default() };
    let names = files.iter().map(|f| stem(f)).collect();
    Ok(BankSource { mesh: read_mesh(&neutral)?, names, about, members: Members::Files(files.into_iter()) })
}

fn open_gltf(path: &Path, mesh: Option<&str>) -> Result<BankSource, BankError> {
    if !has_extension(path, "glb") && !has_extension(path, "gltf") {
        let reason = "a folder, a .glb or a .gltf file was expected".to_owned();
        return Err(BankError::Source { path: path.to_owned(), reason });
    }
    let morphs = read_gltf(path, mesh, |target| coefficient(target).is_some())?;
    let about = About { unit: "metre".to_owned(), other_meshes: morphs.others, ..About::default() };
    Ok(BankSource { mesh: morphs.mesh, names: morphs.names, about, members: Members::Targets(morphs.targets.into_iter()) })
}

/// Content of `manifest.json` beside `NumPy` arrays; every entry is optional.
#[derive(Default, Deserialize)]
struct Manifest {
    #[serde(default)]
    units: String,
    #[serde(default)]
    expressions: Vec<String>,
    #[serde(default)]
    regions: BTreeMap<String, Part>,
    #[serde(alias = "landmarks_multipie68")]
    landmarks: Option<Vec<u32>>,
    source: Option<Origin>,
}

#[derive(Deserialize)]
struct Part {
    vertices: [usize; 2],
}

#[derive(Deserialize)]
struct Origin {
    #[serde(default)]
    repository: String,
    #[serde(default)]
    license: String,
}

fn open_arrays(path: &Path) -> Result<BankSource, BankError> {
    let file = path.join("manifest.json");
    let manifest: Manifest = match crate::input::read(&file) {
        Ok(bytes) => {
            let error = |e: serde_json::Error| BankError::Source { path: file.clone(), reason: e.to_string() };
            serde_json::from_slice(&bytes).map_err(error)?
        }
        Err(_) => Manifest::default(),
    };
    let wrong = |file: &Path, shape: &[usize], expected: String| MeshFileError::Format {
        path: file.to_owned(),
        reason: format!("the array is of shape {shape:?}; {expected} was expected"),
    };
    let file = path.join("neutral_vertices.npy");
    let mut rows = read_npy_rows(&file)?;
    let &[count, 3] = rows.shape() else { return Err(wrong(&file, rows.shape(), "V x 3".to_owned()).into()) };
    let positions = (0..count).map(|_| rows.next_block().map(|p| [p[0], p[1], p[2]])).collect::<Result<Vec<_>, _>>()?;
    let (triangles, quads) = (path.join("triangles.npy"), path.join("quads.npy"));
    let file = if triangles.is_file() { triangles } else { quads };
    let corners = read_npy_indices(&file)?;
    let triangles = match corners.shape[..] {
        [_, 3] => corners.data.as_chunks::<3>().0.to_vec(),
        [_, 4] => corners.data.as_chunks::<4>().0.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        _ => return Err(wrong(&file, &corners.shape, "T x 3, or Q x 4".to_owned()).into()),
    };
    let mesh = TriangleMesh::new(positions, triangles)?;
    let file = path.join("expression_deltas.npy");
    let rows = read_npy_rows(&file)?;
    let members = match *rows.shape() {
        [members, vertices, 3] if vertices == count => members,
        _ => return Err(wrong(&file, rows.shape(), format!("M x {count} x 3")).into()),
    };
    let names =
        if manifest.expressions.is_empty() { (0..members).map(|k| format!("shape_{k}")).collect() } else { manifest.expressions };
    if names.len() != members {
        let reason = format!("it names {} expressions, but expression_deltas.npy has {members}", names.len());
        return Err(BankError::Source { path: path.join("manifest.json"), reason });
    }
    let points = path.join("feature_points.csv");
    let credit = manifest.source.map(|o| format!("{} ({})", o.repository, o.license)).unwrap_or_default();
    let about = About {
        unit: manifest.units.split(';').next().unwrap_or_default().to_owned(),
        credit,
        landmarks: manifest.landmarks,
        // Only parts that start at the first vertex can be cut off without renumbering.
        parts: manifest.regions.into_iter().filter(|(_, p)| p.vertices[0] == 0).map(|(name, p)| (name, p.vertices[1])).collect(),
        feature_points: points.is_file().then_some(points),
        other_meshes: Vec::new(),
    };
    Ok(BankSource { mesh, names, about, members: Members::Arrays(rows) })
}
