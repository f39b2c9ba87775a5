//! Reads a mesh with morph targets from a glTF or GLB file.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use gltf::{
    Accessor, Document, Gltf, Primitive, Semantic,
    accessor::{DataType, Dimensions},
    buffer,
    json::{self, validation::Checked},
    mesh::Mode,
};

use nalgebra::{Affine3, Matrix4, Point3, Vector3};

use crate::{
    foreign::caught,
    mesh::{MeshFileError, TriangleMesh, check_finite},
    text::excerpt,
};

/// A neutral mesh and its morph targets.
#[derive(Clone, Debug, PartialEq)]
pub struct GltfMorphs {
    /// The neutral mesh; several primitives are concatenated.
    pub mesh: TriangleMesh,
    /// Names of the targets; `target_0`, `target_1`, ... if the file has none.
    pub names: Vec<String>,
    /// Displacements of every vertex for each target.
    pub targets: Vec<Vec<[f32; 3]>>,
    /// Other meshes of the file that have morph targets, with the number of targets.
    pub others: Vec<String>,
}

/// Reads a mesh with morph targets: the mesh called `name`, or by default the one with the most targets accepted by `wanted`.
///
/// Ties are broken by the number of targets, then by order in the file. The transforms of the first node with the mesh are
/// applied, except to a mesh with a skin, as glTF requires. Normals and skins are not read.
///
/// # Errors
/// [`MeshFileError`] for a file that is no glTF, has no morph targets or no such mesh, is compressed, or refers to missing data.
pub fn read_gltf(path: &Path, name: Option<&str>, wanted: impl Fn(&str) -> bool) -> Result<GltfMorphs, MeshFileError> {
    let bytes = crate::input::read(path).map_err(MeshFileError::io(path))?;
    caught(|| parse(path, &bytes, name, &wanted)).unwrap_or_else(|reason| Err(MeshFileError::format(path, reason)))
}

/// Lists the separate files with the buffers of a .gltf file; empty for a file that cannot be read.
pub fn buffer_files(path: &Path) -> Vec<PathBuf> {
    let Ok(bytes) = crate::input::read(path) else { return Vec::new() };
    let root: serde_json::Value = serde_json::from_slice(&bytes).unwrap_or_default();
    let buffers = root["buffers"].as_array().cloned().unwrap_or_default();
    let uris = buffers.iter().filter_map(|buffer| buffer["uri"].as_str()).filter(|uri| !uri.starts_with("data:"));
    uris.filter_map(|uri| Some(buffer_file(path, &percent_decoded(uri)?))).collect()
}

/// Returns the file of a buffer from its decoded URI.
fn buffer_file(path: &Path, decoded: &str) -> PathBuf {
    let plain = decoded.strip_prefix("file://").or_else(|| decoded.strip_prefix("file:")).unwrap_or(decoded);
    path.parent().unwrap_or(Path::new("")).join(plain)
}

/// Extensions with encodings of meshes that are not supported.
const COMPRESSED: [&str; 4] =
    ["EXT_meshopt_compression", "KHR_meshopt_compression", "KHR_draco_mesh_compression", "KHR_mesh_quantization"];

fn parse(path: &Path, bytes: &[u8], name: Option<&str>, wanted: &dyn Fn(&str) -> bool) -> Result<GltfMorphs, MeshFileError> {
    let error = |reason: String| MeshFileError::format(path, reason);
    let invalid = |e: gltf::Error| error(format!("no valid glTF: {e}"));
    let Gltf { document, blob } = Gltf::from_slice_without_validation(bytes).map_err(invalid)?;
    let mut root = document.into_json();
    if root.asset.version.split('.').next() != Some("2") {
        return Err(error(format!(
            "the file is glTF {}, but only glTF 2.0 is supported: export it again as glTF 2.0",
            excerpt(&root.asset.version)
        )));
    }
    let used: Vec<&str> = root.extensions_used.iter().chain(&root.extensions_required).map(String::as_str).collect();
    let compressed: Vec<&str> = COMPRESSED.into_iter().filter(|name| used.contains(name)).collect();
    if !compressed.is_empty() {
        return Err(error(format!(
            "its meshes are stored with {}, which is not supported: convert them with `gltf-transform dequantize IN.glb OUT.glb`",
            compressed.join(" and ")
        )));
    }
    // Textures are not read, so their encoding does not matter.
    root.extensions_required.retain(|name| !name.contains("texture"));
    // The crate's validation does not check the accessors of positions.
    let positions =
        root.meshes.iter().flat_map(|m| &m.primitives).filter_map(|p| p.attributes.get(&Checked::Valid(Semantic::Positions)));
    if let Some(missing) = positions.map(json::Index::value).find(|&index| index >= root.accessors.len()) {
        return Err(error(format!("no valid glTF: there is no accessor {missing}, which has a mesh's positions")));
    }
    let document = Document::from_json(root).map_err(invalid)?;
    let buffers = load_buffers(&document, blob, path)?;
    let (mesh, others) = choose(&document, name, wanted).map_err(error)?;
    let (mut positions, mut triangles, mut targets) = (Vec::new(), Vec::new(), Vec::<Vec<[f32; 3]>>::new());
    // Primitives of several materials may share their vertices; each shared set is read once.
    let mut firsts = BTreeMap::new();
    for primitive in mesh.primitives() {
        let vertices: Vec<Option<usize>> = [primitive.get(&Semantic::Positions).map(|a| a.index())]
            .into_iter()
            .chain(primitive.morph_targets().map(|morph| morph.positions().map(|a| a.index())))
            .collect();
        let known = firsts.get(&vertices).copied();
        firsts.entry(vertices).or_insert(positions.len());
        read_primitive(&primitive, &buffers, known, &mut positions, &mut triangles, &mut targets).map_err(error)?;
    }
    if let Some(placed) = placement(&document, mesh.index()).map_err(error)? {
        positions.iter_mut().for_each(|p| *p = placed.transform_point(&Point3::from(*p).cast()).cast::<f32>().coords.into());
        let linear = placed.matrix().fixed_view::<3, 3>(0, 0).into_owned();
        // A mirroring transform reverses the triangles.
        if linear.determinant() < 0.0 {
            triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
        }
        let moved = |v: &[f32; 3]| -> [f32; 3] { (linear * Vector3::from(*v).cast::<f64>()).cast::<f32>().into() };
        targets.iter_mut().flatten().for_each(|v| *v = moved(v));
    }
    let names = target_names(&mesh, targets.len());
    let mesh = TriangleMesh::new(positions, triangles).map_err(MeshFileError::mesh(path))?;
    for (name, target) in names.iter().zip(&targets) {
        check_finite(target).map_err(|e| error(format!("morph target `{name}`: {e}")))?;
    }
    Ok(GltfMorphs { mesh, names, targets, others })
}

/// Transform of the first node that holds a mesh; `None` for the identity.
fn placement(document: &Document, mesh: usize) -> Result<Option<Affine3<f64>>, String> {
    let Some(node) = document.nodes().find(|node| node.mesh().is_some_and(|m| m.index() == mesh)) else { return Ok(None) };
    if node.skin().is_some() {
        return Ok(None);
    }
    let parents: BTreeMap<usize, gltf::Node<'_>> = document
        .nodes()
        .flat_map(|parent| parent.children().map(move |child| (child.index(), parent.clone())).collect::<Vec<_>>())
        .collect();
    let mut whole = Matrix4::identity();
    let mut at = Some(&node);
    let mut steps = 0;
    while let Some(node) = at {
        whole = Matrix4::from(node.transform().matrix()).cast::<f64>() * whole;
        steps += 1;
        if steps > document.nodes().len() {
            return Err(format!("no valid glTF: node {} is among its own parents", node.index()));
        }
        at = parents.get(&node.index());
    }
    if whole == Matrix4::identity() {
        return Ok(None);
    }
    let volume = whole.fixed_view::<3, 3>(0, 0).determinant();
    if whole.iter().any(|v| !v.is_finite()) || !(volume.abs() > 0.0) {
        return Err(format!("the transform of node {} is not finite, or scales the mesh to nothing", node.index()));
    }
    Ok(Some(Affine3::from_matrix_unchecked(whole)))
}

/// Chooses the mesh with this name, or the one with the most wanted targets; also returns descriptions of the other meshes with
/// targets.
fn choose<'d>(
    document: &'d Document,
    name: Option<&str>,
    wanted: &dyn Fn(&str) -> bool,
) -> Result<(gltf::Mesh<'d>, Vec<String>), String> {
    let targets_of = |mesh: &gltf::Mesh| mesh.primitives().map(|p| p.morph_targets().len()).max().unwrap_or(0);
    let morphed: Vec<gltf::Mesh> = document.meshes().filter(|mesh| targets_of(mesh) > 0).collect();
    let name_of = |mesh: &gltf::Mesh| mesh.name().map_or_else(|| format!("mesh {}", mesh.index()), str::to_owned);
    let described = |mesh: &gltf::Mesh| format!("{} ({} targets)", excerpt(&name_of(mesh)), targets_of(mesh));
    let chosen = if let Some(name) = name {
        morphed.iter().position(|mesh| name_of(mesh) == name).ok_or_else(|| {
            let there: Vec<String> = morphed.iter().map(described).collect();
            let there = if there.is_empty() { "none".to_owned() } else { there.join(", ") };
            format!("no mesh with morph targets is named `{}`; there are {there}", excerpt(name))
        })?
    } else {
        let worth = |mesh: &gltf::Mesh| {
            let count = targets_of(mesh);
            (target_names(mesh, count).iter().filter(|name| wanted(name)).count(), count)
        };
        // The first of equal ones.
        let best = (0..morphed.len()).rev().max_by_key(|&k| worth(&morphed[k]));
        best.ok_or_else(|| "no mesh with morph targets".to_owned())?
    };
    let others = morphed.iter().enumerate().filter(|(k, _)| *k != chosen).map(|(_, mesh)| described(mesh)).collect();
    Ok((morphed[chosen].clone(), others))
}

fn load_buffers(document: &Document, mut blob: Option<Vec<u8>>, path: &Path) -> Result<Vec<buffer::Data>, MeshFileError> {
    let error = |reason: String| MeshFileError::format(path, reason);
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        if let buffer::Source::Uri(uri) = buffer.source()
            && !uri.starts_with("data:")
        {
            let decoded =
                percent_decoded(uri).ok_or_else(|| error(format!("the buffer's address `{}` is not UTF-8", excerpt(uri))))?;
            // The crate opens any kind of file, and would read a pipe or a device endlessly.
            let file = buffer_file(path, &decoded);
            let length = crate::input::open_file(&file).and_then(|file| file.metadata()).map(|m| m.len());
            let length =
                length.map_err(|e| error(format!("buffer {}, {}: {e}", buffer.index(), excerpt(&file.to_string_lossy()))))?;
            if length > crate::input::MAX_BYTES {
                return Err(error(format!(
                    "buffer {} has {length} bytes, more than the limit of {}",
                    buffer.index(),
                    crate::input::MAX_BYTES
                )));
            }
        }
        let data = buffer::Data::from_source_and_blob(buffer.source(), path.parent(), &mut blob)
            .map_err(|e| error(format!("buffer {}: {e}", buffer.index())))?;
        if data.len() < buffer.length() {
            let (found, expected) = (data.len(), buffer.length());
            return Err(error(format!("buffer {} has {found} bytes; {expected} were expected", buffer.index())));
        }
        buffers.push(data);
    }
    Ok(buffers)
}

/// Decodes the percent escapes of a URI; `None` when the result is not UTF-8.
fn percent_decoded(uri: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let hex = after.get(..2).and_then(|h| std::str::from_utf8(h).ok()).and_then(|h| u8::from_str_radix(h, 16).ok());
        if let (b'%', Some(byte)) = (first, hex) {
            bytes.push(byte);
            rest = &after[2..];
        } else {
            bytes.push(first);
            rest = after;
        }
    }
    String::from_utf8(bytes).ok()
}

fn read_primitive(
    primitive: &Primitive,
    buffers: &[buffer::Data],
    known: Option<usize>,
    positions: &mut Vec<[f32; 3]>,
    triangles: &mut Vec<[u32; 3]>,
    targets: &mut Vec<Vec<[f32; 3]>>,
) -> Result<(), String> {
    if primitive.mode() != Mode::Triangles {
        return Err(format!("primitive {} is not made of triangles", primitive.index()));
    }
    let first = known.unwrap_or(positions.len());
    let accessor =
        primitive.get(&Semantic::Positions).ok_or_else(|| format!("primitive {} has no positions", primitive.index()))?;
    let own = vectors(&accessor, buffers)?;
    let count = own.len();
    if known.is_none() {
        positions.extend(own);
    }
    let indices = match primitive.indices() {
        Some(accessor) => indices(&accessor, buffers)?,
        None => (0..count as u32).collect(),
    };
    if !indices.len().is_multiple_of(3) {
        let (index, found) = (primitive.index(), indices.len());
        return Err(format!("primitive {index} has {found} indices; triangles take a multiple of 3"));
    }
    for corners in indices.chunks_exact(3) {
        if let Some(vertex) = corners.iter().find(|&&v| v as usize >= count) {
            return Err(format!("an index refers to vertex {vertex}, but the primitive has {count}"));
        }
        triangles.push([corners[0], corners[1], corners[2]].map(|v| v + first as u32));
    }
    if known.is_some() {
        return Ok(());
    }
    let morphs: Vec<_> = primitive.morph_targets().collect();
    if first > 0 && morphs.len() != targets.len() {
        return Err(format!(
            "primitive {} has {} morph targets; {} were expected",
            primitive.index(),
            morphs.len(),
            targets.len()
        ));
    }
    targets.resize(morphs.len(), Vec::new());
    for (target, morph) in targets.iter_mut().zip(&morphs) {
        let moves = match morph.positions() {
            Some(accessor) => vectors(&accessor, buffers)?,
            None => vec![[0.0; 3]; count],
        };
        if moves.len() != count {
            return Err(format!("a morph target has {} vertices; {count} were expected", moves.len()));
        }
        target.extend(moves);
    }
    Ok(())
}

/// Iterates over the bytes of `count` items of `size` bytes in a view.
fn items<'b>(
    view: &buffer::View,
    offset: usize,
    count: usize,
    size: usize,
    buffers: &'b [buffer::Data],
) -> Result<impl Iterator<Item = &'b [u8]>, String> {
    let beyond = || format!("an accessor reaches beyond buffer view {}", view.index());
    let start = view.offset();
    let end = start.checked_add(view.length()).ok_or_else(beyond)?;
    let bytes = buffers.get(view.buffer().index()).and_then(|data| data.get(start..end)).ok_or_else(beyond)?;
    let stride = view.stride().unwrap_or(size);
    let needed = count.checked_sub(1).map_or(Some(0), |n| n.checked_mul(stride)?.checked_add(size)?.checked_add(offset));
    if needed.is_none_or(|n| n > bytes.len()) {
        return Err(beyond());
    }
    Ok((0..count).map(move |k| &bytes[offset + k * stride..offset + k * stride + size]))
}

/// Reads a float VEC3 accessor, including its sparse part.
fn vectors(accessor: &Accessor, buffers: &[buffer::Data]) -> Result<Vec<[f32; 3]>, String> {
    if accessor.data_type() != DataType::F32 || accessor.dimensions() != Dimensions::Vec3 {
        let (found, kind) = (accessor.dimensions(), accessor.data_type());
        return Err(format!("accessor {} holds {kind:?} {found:?}; float VEC3 was expected", accessor.index()));
    }
    let number = |b: &[u8], k: usize| f32::from_le_bytes([b[4 * k], b[4 * k + 1], b[4 * k + 2], b[4 * k + 3]]);
    let vector = |b: &[u8]| [number(b, 0), number(b, 1), number(b, 2)];
    let limit: usize = buffers.iter().map(|b| b.len()).sum();
    let mut values = match accessor.view() {
        Some(view) => items(&view, accessor.offset(), accessor.count(), 12, buffers)?.map(vector).collect(),
        // Zeros take no bytes in the file: a count that the file could not hold otherwise is refused.
        None if accessor.count() > limit => {
            return Err(format!("accessor {} counts {} values", accessor.index(), accessor.count()));
        }
        None => vec![[0.0; 3]; accessor.count()],
    };
    if let Some(sparse) = accessor.sparse() {
        let (places, moved) = (sparse.indices(), sparse.values());
        let size = places.index_type().size();
        let (places_view, moved_view) = (places.view(), moved.view());
        let places = items(&places_view, places.offset(), sparse.count(), size, buffers)?.map(|b| match size {
            1 => usize::from(b[0]),
            2 => usize::from(u16::from_le_bytes([b[0], b[1]])),
            _ => u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize,
        });
        for (place, bytes) in places.zip(items(&moved_view, moved.offset(), sparse.count(), 12, buffers)?) {
            let count = values.len();
            *values.get_mut(place).ok_or_else(|| format!("a sparse index is {place}; there are {count} values"))? = vector(bytes);
        }
    }
    Ok(values)
}

fn indices(accessor: &Accessor, buffers: &[buffer::Data]) -> Result<Vec<u32>, String> {
    let size = match (accessor.data_type(), accessor.dimensions()) {
        (DataType::U8, Dimensions::Scalar) => 1,
        (DataType::U16, Dimensions::Scalar) => 2,
        (DataType::U32, Dimensions::Scalar) => 4,
        (kind, found) => return Err(format!("indices are {kind:?} {found:?}; whole scalars were expected")),
    };
    let view = accessor.view().ok_or("indices have no buffer view")?;
    let read = |b: &[u8]| match size {
        1 => u32::from(b[0]),
        2 => u32::from(u16::from_le_bytes([b[0], b[1]])),
        _ => u32::from_le_bytes([b[0], b[1], b[2], b[3]]),
    };
    Ok(items(&view, accessor.offset(), accessor.count(), size, buffers)?.map(read).collect())
}

fn target_names(mesh: &gltf::Mesh, count: usize) -> Vec<String> {
    #[derive(Default, serde::Deserialize)]
    struct Extras {
        #[serde(rename = "targetNames", default)]
        names: Vec<String>,
    }
    let extras: Extras = mesh.extras().as_ref().and_then(|raw| serde_json::from_str(raw.get()).ok()).unwrap_or_default();
    (0..count).map(|k| extras.names.get(k).cloned().unwrap_or_else(|| format!("target_{k}"))).collect()
}
