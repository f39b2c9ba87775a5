//! Reads and writes Wavefront OBJ files: positions and faces.
//!
//! Vertices keep the order of the file, with indices from 0. Normals, texture coordinates, groups and materials are neither read
//! nor written.

use std::{
    io::{self, Write},
    path::Path,
};

use ::obj::{Group, IndexTuple, LoadConfig, ObjData, ObjError, Object, SimplePolygon};

use super::{MeshFileError, TriangleMesh, fan};
use crate::{foreign::caught, text::excerpt};

/// Reads an OBJ file; polygons become triangle fans.
///
/// ```
/// use grimace::mesh::read_obj;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("square.obj");
/// std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")?;
/// assert_eq!(read_obj(&path)?.triangles(), [[0, 1, 2], [0, 2, 3]]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`MeshFileError`] for a file that cannot be read, for lines that do not parse (with their number), or for an invalid mesh.
pub fn read_obj(path: &Path) -> Result<TriangleMesh, MeshFileError> {
    let bytes = crate::input::read(path).map_err(MeshFileError::io(path))?;
    // Only positions and faces are needed. Other lines are blanked, so that comments in any encoding and statements of other
    // programs do no harm and line numbers stay valid.
    let mut plain = Vec::with_capacity(bytes.len());
    for line in bytes.split(|&b| b == b'\n') {
        let line = line.trim_ascii();
        if line.starts_with(b"v ") || line.starts_with(b"v\t") || line.starts_with(b"f ") || line.starts_with(b"f\t") {
            plain.extend(line.iter().map(|&b| if b.is_ascii() { b } else { b'?' }));
        }
        plain.push(b'\n');
    }
    let config = LoadConfig { strict: false };
    let data = caught(|| ObjData::load_buf_with_config(&plain[..], config)).map_err(|e| MeshFileError::format(path, e))?;
    let data = data.map_err(|e| MeshFileError::format(path, reason(&e)))?;
    let mut triangles = Vec::new();
    let polygons = data.objects.iter().flat_map(|o| &o.groups).flat_map(|g| &g.polys);
    for (face, polygon) in polygons.enumerate() {
        let corners: Vec<usize> = polygon.0.iter().map(|corner| corner.0).collect();
        if corners.len() < 3 {
            let found = corners.len();
            return Err(MeshFileError::format(path, format!("face {} has {found} corners; at least 3 are needed", face + 1)));
        }
        let count = data.position.len();
        if let Some(&vertex) = corners.iter().find(|&&v| v >= count) {
            let reason = format!("face {} refers to vertex {}, but there are {count}", face + 1, vertex.wrapping_add(1) as i64);
            return Err(MeshFileError::format(path, reason));
        }
        triangles.extend(fan(&corners).map(|t| t.map(|v| v as u32)));
    }
    TriangleMesh::new(data.position, triangles).map_err(MeshFileError::mesh(path))
}

fn reason(error: &ObjError) -> String {
    match error {
        ObjError::MalformedFaceGroup { line_number, group } => {
            format!("line {}: `{}` is not a corner such as 7, 7/1 or 7/1/3", line_number + 1, excerpt(group))
        }
        ObjError::ArgumentListFailure { line_number, .. } => format!("line {}: three numbers were expected", line_number + 1),
        ObjError::ZeroVertexNumber { line_number } => format!("line {}: vertex 0; OBJ counts from 1", line_number + 1),
        other => other.to_string(),
    }
}

/// Writes positions and triangles as OBJ, with the shortest decimals that read back to the same `f32`.
///
/// ```
/// use grimace::mesh::write_obj;
///
/// let mut text = Vec::new();
/// write_obj(&mut text, &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.5, 0.0]], &[[0, 1, 2]])?;
/// let text = String::from_utf8(text)?;
/// assert!(text.contains("v 0 0 0\nv 1 0 0\nv 0 0.5 0\n") && text.ends_with("f 1 2 3\n"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// When `out` cannot be written to.
pub fn write_obj(out: &mut dyn Write, positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> io::Result<()> {
    let corner = |v: u32| IndexTuple(v as usize, None, None);
    let mut group = Group::new("face".to_owned());
    group.polys = triangles.iter().map(|t| SimplePolygon(t.map(corner).to_vec())).collect();
    let mut object = Object::new("face".to_owned());
    object.groups.push(group);
    let data = ObjData { position: positions.to_vec(), objects: vec![object], ..ObjData::default() };
    let mut out = out;
    data.write_to_buf(&mut out).map_err(|e| match e {
        ObjError::Io(e) => e,
        other => io::Error::other(other.to_string()),
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn read(text: &[u8]) -> Result<TriangleMesh, MeshFileError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        fs::write(&path, text).unwrap();
        read_obj(&path)
    }

    #[test]
    fn quads_negative_indices_and_foreign_lines_are_read() {
        let text = b"# caf\xe9\no head\ng a\nv 0 0 0\nv 1 0 0\nvn 0 0 1\nv 1 1 0\nv 0 1 0.5\nusemtl skin\ng b\nf 1//1 2//1 3//1 4//1\no x\nf -4 -3 -2\n";
        let mesh = read(text).unwrap();
        assert_eq!(mesh.positions()[3], [0.0, 1.0, 0.5]);
        assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
    }

    #[test]
    fn damaged_files_name_the_line() {
        let says = |text: &[u8], part: &str| {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        };
        says(b"v 0 0 0\nv 1 0\n", "line 2: three numbers");
        says(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n", "line 4: `x`");
        says(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n", "line 4: vertex 0");
        says(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "face 1 refers to vertex 9, but there are 3");
        says(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -9\n", "face 1 refers to vertex");
        says(b"v 0 0 0\nv 1 0 0\nf 1 2\n", "face 1 has 2 corners");
        says(b"v 0 nan 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "vertex 0 is at (0, NaN, 0)");
        says(b"", "no triangles");
    }

    #[test]
    fn written_files_read_back() {
        let mesh = TriangleMesh::new(vec![[0.1, 1e-9, -3.0], [1.0, 2.0, 3.5], [7.25, 0.3, 0.0]], vec![[2, 0, 1]]).unwrap();
        let mut bytes = Vec::new();
        write_obj(&mut bytes, mesh.positions(), mesh.triangles()).unwrap();
        assert_eq!(read(&bytes).unwrap(), mesh);
    }
}
