//! Reads bank files of version 1, which are no longer written. Little endian; every section starts at a multiple of 64 bytes.
//!
//! | bytes | content |
//! | --- | --- |
//! | 0 to 7 | `GRIMBANK` |
//! | 8 to 15 | version 1, then the number 0x01020304 (byte order), u32 each |
//! | 16 to 47 | V vertices, T triangles, M members, F feature points, u64 each |
//! | 48 to 103 | offset and length of the description, offsets of positions, triangles, feature points, displacements; length of the file, u64 each |
//! | 104 to 127 | zero |
//!
//! The description is JSON (`names` and [`BankInfo`]); positions are V x 3 f32; triangles T x 3 u32; feature points F x (u8
//! group, u8 point, u16 zero, u32 vertex); displacements M x V x 3 f32, member by member.

use memmap2::Mmap;
use serde::Deserialize;

use super::bank::{Bank, BankInfo, Displacements, FeaturePointVertex};
use crate::{mesh::TriangleMesh, units::FeaturePoint};

/// First bytes of such a file.
pub const MAGIC: &[u8; 8] = b"GRIMBANK";
const VERSION: u32 = 1;
const BYTE_ORDER: u32 = 0x0102_0304;
const HEADER: u64 = 128;
const ALIGNMENT: u64 = 64;

#[derive(Deserialize)]
struct Description {
    names: Vec<String>,
    #[serde(flatten)]
    info: BankInfo,
}

/// Offsets of the sections of a file, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Layout {
    counts: [u64; 4],
    description: u64,
    description_length: u64,
    positions: u64,
    triangles: u64,
    feature_points: u64,
    displacements: u64,
    length: u64,
}

impl Layout {
    /// Computes the layout from V, T, M, F and the length of the description; `None` when a length exceeds `u64`.
    fn new(counts: [u64; 4], description_length: u64) -> Option<Self> {
        let [vertices, triangles, members, feature_points] = counts;
        let align = |n: u64| n.checked_next_multiple_of(ALIGNMENT);
        let positions_at = align(HEADER.checked_add(description_length)?)?;
        let triangles_at = align(vertices.checked_mul(12)?.checked_add(positions_at)?)?;
        let feature_points_at = align(triangles.checked_mul(12)?.checked_add(triangles_at)?)?;
        let displacements = align(feature_points.checked_mul(8)?.checked_add(feature_points_at)?)?;
        let length = vertices.checked_mul(12)?.checked_mul(members)?.checked_add(displacements)?;
        Some(Self {
            counts,
            description: HEADER,
            description_length,
            positions: positions_at,
            triangles: triangles_at,
            feature_points: feature_points_at,
            displacements,
            length,
        })
    }

    fn words(&self) -> [u64; 11] {
        let [v, t, m, f] = self.counts;
        let Self { description, description_length, positions, triangles, feature_points, displacements, length, .. } = *self;
        [v, t, m, f, description, description_length, positions, triangles, feature_points, displacements, length]
    }
}

/// Reads the bank from a mapped file. The error is a message.
pub fn read(map: Mmap) -> Result<Bank, String> {
    let layout = read_layout(&map)?;
    let section = |start: u64, length: u64| &map[start as usize..(start + length) as usize];
    let description: Description = serde_json::from_slice(section(layout.description, layout.description_length))
        .map_err(|e| format!("its description cannot be read: {e}"))?;
    let [vertices, triangles, members, feature_points] = layout.counts;
    if description.names.len() as u64 != members {
        return Err(format!("it names {} members, but stores {members}", description.names.len()));
    }
    let positions = bytemuck::cast_slice(section(layout.positions, 12 * vertices)).to_vec();
    let corners = bytemuck::cast_slice(section(layout.triangles, 12 * triangles)).to_vec();
    let points = section(layout.feature_points, 8 * feature_points).chunks_exact(8).map(|b| FeaturePointVertex {
        fp: FeaturePoint { group: b[0], point: b[1] },
        vertex: u32::from_le_bytes([b[4], b[5], b[6], b[7]]),
    });
    let points = points.collect();
    let mesh = TriangleMesh::new(positions, corners).map_err(|e| e.to_string())?;
    let displacements = Displacements::Mapped(map, layout.displacements as usize);
    let bank = Bank::from_parts(mesh, description.names, points, description.info, displacements).map_err(|e| e.to_string())?;
    Ok(bank.of_old_file())
}

fn read_layout(bytes: &[u8]) -> Result<Layout, String> {
    let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
    if bytes.len() < HEADER as usize || !bytes.starts_with(MAGIC) {
        return Err(format!("it is shorter than the header of {HEADER} bytes"));
    }
    if word(8) != VERSION {
        return Err(format!("it is of version {}; this program reads versions 1 and 2", word(8)));
    }
    if word(12) != BYTE_ORDER {
        return Err("its byte order is not little endian".to_owned());
    }
    let words: [u64; 11] = std::array::from_fn(|k| long(16 + 8 * k));
    let layout = Layout::new([words[0], words[1], words[2], words[3]], words[5]).filter(|l| l.words() == words);
    let layout = layout.ok_or("its header is damaged: counts and offsets contradict each other")?;
    if layout.length != bytes.len() as u64 {
        return Err(format!(
            "it has {} bytes, but {} were expected; the file is truncated or damaged",
            bytes.len(),
            layout.length
        ));
    }
    Ok(layout)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// A file written by version 0.1.0: a tetrahedron whose vertex 2 rises by a half in its only member.
    const WRITTEN: &[u8] = include_bytes!("../../fuzz/seeds/bank/version-1.bank");

    #[test]
    fn a_file_of_version_1_is_read_and_written_anew() {
        let folder = tempfile::tempdir().unwrap();
        let (old, new) = (folder.path().join("old.bank"), folder.path().join("new.bank"));
        fs::write(&old, WRITTEN).unwrap();
        let bank = Bank::open(&old).unwrap();
        assert!(bank.is_old_file() && bank.is_mapped());
        assert_eq!((bank.vertex_count(), bank.mesh().triangles().len(), bank.names()), (4, 3, &["smile".to_owned()][..]));
        assert_eq!(bank.displacements(0), [[0.0; 3], [0.0; 3], [0.0, 0.5, 0.0], [0.0; 3]]);
        let points: Vec<_> = bank.feature_points().iter().map(|p| (p.fp.to_string(), p.vertex)).collect();
        assert_eq!(points, [("8.3".to_owned(), 1), ("8.4".to_owned(), 2)]);
        bank.write(&new).unwrap();
        let converted = Bank::open(&new).unwrap();
        assert!(!converted.is_old_file());
        assert_eq!((converted.mesh(), converted.info()), (bank.mesh(), bank.info()));
        assert_eq!(converted.displacements(0), bank.displacements(0));
    }

    #[test]
    fn damaged_files_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bank");
        let says = |bytes: &[u8], part: &str| {
            fs::write(&path, bytes).unwrap();
            let error = Bank::open(&path).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        };
        let with = |at: usize, byte: u8| {
            let mut bytes = WRITTEN.to_vec();
            bytes[at] = byte;
            bytes
        };
        says(&WRITTEN[..100], "shorter than the header of 128 bytes");
        says(&with(8, 3), "version 3; this program reads versions 1 and 2");
        says(&with(12, 9), "byte order");
        says(&with(16, 9), "counts and offsets contradict each other");
        says(&with(23, 255), "counts and offsets contradict each other");
        says(&WRITTEN[..WRITTEN.len() - 1], "the file is truncated or damaged");
        says(&with(128, b'X'), "description cannot be read");
        let last = WRITTEN.len() - 4;
        says(
            &[&WRITTEN[..last], &f32::NAN.to_le_bytes()].concat(),
            "member `smile`: vertex 3 has a displacement that is not a finite",
        );
        for length in (0..WRITTEN.len()).step_by(7) {
            fs::write(&path, &WRITTEN[..length]).unwrap();
            assert!(Bank::open(&path).is_err());
        }
    }
}
