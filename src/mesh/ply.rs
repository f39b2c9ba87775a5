//! Reads and writes PLY files: vertex positions and faces, ASCII or binary.

use std::{
    fs::File,
    io::{self, BufReader, Write},
    path::Path,
};

use ply_rs_bw::{
    parser::{Parser, Reader},
    ply::{
        Addable, ElementDef, Encoding, Ply, Property, PropertyAccess, PropertyAccessResult, PropertyDef, PropertyType, ScalarType,
    },
    writer::Writer,
};

use super::{MeshFileError, TriangleMesh, fan};
use crate::foreign::caught;

/// A row of a PLY file: the position of a vertex or the corners of a face.
#[derive(Debug)]
struct Row {
    /// NaN if missing.
    position: [f32; 3],
    corners: Vec<u32>,
    /// A corner that is not a valid vertex index.
    bad_corner: Option<f64>,
}

impl Row {
    fn set_corners(&mut self, values: impl Iterator<Item = i64>) {
        for value in values {
            match u32::try_from(value) {
                Ok(corner) => self.corners.push(corner),
                Err(_) => self.bad_corner = Some(value as f64),
            }
        }
    }
}

impl PropertyAccess for Row {
    fn new() -> Self {
        Self { position: [f32::NAN; 3], corners: Vec::new(), bad_corner: None }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if let Some(axis) = ["x", "y", "z"].iter().position(|&a| a == name) {
            self.position[axis] = match property {
                Property::Float(v) => v,
                Property::Double(v) => v as f32,
                Property::Char(v) => f32::from(v),
                Property::UChar(v) => f32::from(v),
                Property::Short(v) => f32::from(v),
                Property::UShort(v) => f32::from(v),
                Property::Int(v) => v as f32,
                Property::UInt(v) => v as f32,
                _ => return PropertyAccessResult::Ignored,
            };
            return PropertyAccessResult::Set;
        }
        if name != "vertex_indices" && name != "vertex_index" {
            return PropertyAccessResult::Ignored;
        }
        match property {
            Property::ListChar(v) => self.set_corners(v.into_iter().map(i64::from)),
            Property::ListUChar(v) => self.set_corners(v.into_iter().map(i64::from)),
            Property::ListShort(v) => self.set_corners(v.into_iter().map(i64::from)),
            Property::ListUShort(v) => self.set_corners(v.into_iter().map(i64::from)),
            Property::ListInt(v) => self.set_corners(v.into_iter().map(i64::from)),
            Property::ListUInt(v) => self.set_corners(v.into_iter().map(i64::from)),
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }

    fn get_float(&self, name: &str) -> Option<f32> {
        ["x", "y", "z"].iter().position(|&a| a == name).map(|axis| self.position[axis])
    }

    fn get_list_uint(&self, _: &str) -> Option<&[u32]> {
        Some(&self.corners)
    }
}

/// Reads the elements `vertex` (x, y, z) and `face` (`vertex_indices` or `vertex_index`) of a PLY file; polygons become triangle
/// fans.
///
/// ```
/// use grimace::{internal::mesh::write_ply, mesh::read_ply};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("triangle.ply");
/// let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// write_ply(&mut std::fs::File::create(&path)?, &positions, &[[0, 1, 2]])?;
/// assert_eq!(read_ply(&path)?.positions(), positions);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`MeshFileError`] for a file that cannot be read, is damaged or ends early, or for an invalid mesh.
pub fn read_ply(path: &Path) -> Result<TriangleMesh, MeshFileError> {
    let file = crate::input::open_file(path).map_err(MeshFileError::io(path))?;
    caught(|| parse(path, file)).unwrap_or_else(|reason| Err(MeshFileError::format(path, reason)))
}

fn parse(path: &Path, file: File) -> Result<TriangleMesh, MeshFileError> {
    let mut reader = Reader::new(BufReader::new(file));
    let parser = Parser::<Row>::new();
    let header = parser.read_header(&mut reader).map_err(|e| MeshFileError::format(path, e))?;
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (name, element) in &header.elements {
        let rows = parser.read_payload_for_element(&mut reader, element, &header).map_err(|e| MeshFileError::format(path, e))?;
        match name.as_str() {
            "vertex" => positions = rows.iter().map(|row| row.position).collect(),
            "face" => {
                for (face, row) in rows.iter().enumerate() {
                    if let Some(corner) = row.bad_corner {
                        return Err(MeshFileError::format(
                            path,
                            format!("face {face} has the corner {corner}; 0 or more was expected"),
                        ));
                    }
                    if row.corners.len() < 3 {
                        let found = row.corners.len();
                        let reason = format!("face {face} has {found} corners in `vertex_indices`; at least 3 are needed");
                        return Err(MeshFileError::format(path, reason));
                    }
                    triangles.extend(fan(&row.corners));
                }
            }
            _ => {}
        }
    }
    TriangleMesh::new(positions, triangles).map_err(MeshFileError::mesh(path))
}

/// Writes positions and triangles as binary little-endian PLY.
///
/// ```
/// use grimace::internal::mesh::write_ply;
///
/// let mut bytes = Vec::new();
/// write_ply(&mut bytes, &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
/// assert!(bytes.starts_with(b"ply\nformat binary_little_endian 1.0\n"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// When `out` cannot be written to.
pub fn write_ply(out: &mut dyn Write, positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> io::Result<()> {
    let mut ply = Ply::<Row>::new();
    ply.header.encoding = Encoding::BinaryLittleEndian;
    let mut vertex = ElementDef::new("vertex".to_owned());
    for axis in ["x", "y", "z"] {
        vertex.properties.add(PropertyDef::new(axis.to_owned(), PropertyType::Scalar(ScalarType::Float)));
    }
    let mut face = ElementDef::new("face".to_owned());
    let list = PropertyType::List(ScalarType::UChar, ScalarType::UInt);
    face.properties.add(PropertyDef::new("vertex_indices".to_owned(), list));
    ply.header.elements.add(vertex);
    ply.header.elements.add(face);
    let vertices = positions.iter().map(|&position| Row { position, corners: Vec::new(), bad_corner: None });
    let faces = triangles.iter().map(|t| Row { position: [0.0; 3], corners: t.to_vec(), bad_corner: None });
    ply.payload.insert("vertex".to_owned(), vertices.collect());
    ply.payload.insert("face".to_owned(), faces.collect());
    let mut out = out;
    Writer::new().write_ply(&mut out, &mut ply).map(drop).map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn read(bytes: &[u8]) -> Result<TriangleMesh, MeshFileError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        fs::write(&path, bytes).unwrap();
        read_ply(&path)
    }

    const ASCII: &str = "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\nproperty double x\nproperty float y\nproperty float z\n\
        property uchar red\nelement face 1\nproperty list uchar int vertex_index\nend_header\n0 0 0 255\n1 0 0 255\n1 1 0 0\n0 1 0.5 3\n4 0 1 2 3\n";

    #[test]
    fn ascii_with_quads_and_colours_is_read() {
        let mesh = read(ASCII.as_bytes()).unwrap();
        assert_eq!(mesh.positions()[3], [0.0, 1.0, 0.5]);
        assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn written_files_read_back_and_any_truncation_is_an_error() {
        let mesh = TriangleMesh::new(vec![[0.1, 1e-9, -3.0], [1.0, 2.0, 3.5], [7.25, 0.3, 0.0]], vec![[2, 0, 1]]).unwrap();
        let mut bytes = Vec::new();
        write_ply(&mut bytes, mesh.positions(), mesh.triangles()).unwrap();
        assert_eq!(read(&bytes).unwrap(), mesh);
        for length in 0..bytes.len() {
            assert!(read(&bytes[..length]).is_err(), "{length} bytes");
        }
    }

    #[test]
    fn damage_is_named() {
        let says = |from: &str, to: &str, part: &str| {
            let error = read(ASCII.replace(from, to).as_bytes()).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        };
        says("4 0 1 2 3", "4 0 1 2 7", "refers to vertex 7, but there are 4");
        says("4 0 1 2 3", "4 0 1 2 -7", "the corner -7");
        says("4 0 1 2 3", "2 0 1", "has 2 corners");
        says("0 1 0.5 3", "0 nan 0.5 3", "Line 15");
        says("0 1 0.5 3", "0 1e99 0.5 3", "vertex 3 is at (0, inf, 0.5)");
        says("property float y", "property float w", "not a finite position");
    }
}
