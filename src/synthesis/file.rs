//! The bank file, version 1. Little endian; every section starts at a multiple of 64 bytes, so that a mapped file is used in place.
//!
//! | bytes | content |
//! | --- | --- |
//! | 0 to 7 | `GRIMBANK` |
//! | 8 to 15 | version 1, then the number 0x01020304 (byte order), u32 each |
//! | 16 to 47 | V vertices, T triangles, M members, F feature points, u64 each |
//! | 48 to 103 | offset and length of the description, offsets of positions, triangles, feature points, displacements; length of the file, u64 each |
//! | 104 to 127 | zero |
//!
//! The description is JSON (`names` and [`BankInfo`]); positions are V x 3 f32; triangles T x 3 u32; feature points F x (u8 group, u8
//! point, u16 zero, u32 vertex); displacements M x V x 3 f32, member by member.

use std::{borrow::Cow, fs::File, io, path::Path};

use memmap2::Mmap;
use serde::{Deserialize, Serialize};

use super::{
    BankError,
    bank::{Bank, BankHead, BankInfo, Displacements, FeaturePointVertex, check_head, check_member},
};
use crate::{mesh::TriangleMesh, output::write_atomic, units::FeaturePoint};

const MAGIC: &[u8; 8] = b"GRIMBANK";
/// Version of the layout.
pub const BANK_VERSION: u32 = 1;
const BYTE_ORDER: u32 = 0x0102_0304;
const HEADER: u64 = 128;
const ALIGNMENT: u64 = 64;

#[derive(Serialize, Deserialize)]
struct Description {
    names: Vec<String>,
    #[serde(flatten)]
    info: BankInfo,
}

/// Offsets of a file, bytes.
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
    /// The layout of V, T, M, F and a description's length; `None` when a length leaves `u64`.
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

/// Writes a bank file, asking for one member's displacements after another and keeping none.
///
/// # Errors
/// [`BankError::Output`]; what `member` fails with; and as [`Bank::new`] for a head or a member that makes no bank.
pub fn write<'a>(
    path: &Path,
    head: &BankHead<'_>,
    mut member: impl FnMut(usize) -> Result<Cow<'a, [[f32; 3]]>, BankError>,
) -> Result<(), BankError> {
    check_head(head.mesh, head.names, head.feature_points)?;
    let description = Description { names: head.names.to_vec(), info: head.info.clone() };
    let mut failure = None;
    let written = write_atomic(path, |out| {
        let text = serde_json::to_vec(&description).map_err(io::Error::from)?;
        let counts = [head.mesh.vertex_count(), head.mesh.triangles().len(), head.names.len(), head.feature_points.len()];
        let layout =
            Layout::new(counts.map(|n| n as u64), text.len() as u64).ok_or_else(|| io::Error::other("the bank is too large"))?;
        let mut place = 0;
        let mut put = |at: u64, bytes: &[u8]| -> io::Result<()> {
            let gap = [0; 2 * HEADER as usize];
            out.write_all(&gap[..at.saturating_sub(place) as usize])?;
            out.write_all(bytes)?;
            place = at + bytes.len() as u64;
            Ok(())
        };
        let mut header = MAGIC.to_vec();
        header.extend([BANK_VERSION, BYTE_ORDER].iter().flat_map(|w| w.to_le_bytes()));
        header.extend(layout.words().iter().flat_map(|w| w.to_le_bytes()));
        put(0, &header)?;
        put(layout.description, &text)?;
        put(layout.positions, &float_bytes(head.mesh.positions()))?;
        let triangles = head.mesh.triangles().as_flattened();
        put(layout.triangles, &triangles.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>())?;
        let points = head.feature_points.iter().flat_map(|p| {
            let [a, b, c, d] = p.vertex.to_le_bytes();
            [p.fp.group, p.fp.point, 0, 0, a, b, c, d]
        });
        put(layout.feature_points, &points.collect::<Vec<u8>>())?;
        let mut at = layout.displacements;
        for (k, name) in head.names.iter().enumerate() {
            let values = match member(k).and_then(|m| check_member(name, &m, head.mesh).map(|()| m)) {
                Ok(values) => values,
                Err(error) => {
                    failure = Some(error);
                    return Err(io::Error::other("a member failed"));
                }
            };
            put(at, &float_bytes(&values))?;
            at += 12 * values.len() as u64;
        }
        Ok(())
    });
    match failure {
        Some(error) => Err(error),
        None => Ok(written?),
    }
}

fn float_bytes(values: &[[f32; 3]]) -> Cow<'_, [u8]> {
    if cfg!(target_endian = "little") {
        Cow::Borrowed(bytemuck::cast_slice(values))
    } else {
        Cow::Owned(values.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect())
    }
}

/// Opens and checks a bank file.
pub(super) fn open(path: &Path) -> Result<Bank, BankError> {
    let error = |reason: String| BankError::Format { path: path.to_owned(), reason };
    if cfg!(target_endian = "big") {
        return Err(error("bank files are little endian, this machine is not".to_owned()));
    }
    let file = crate::input::open_file(path).map_err(|e| error(e.to_string()))?;
    if file.metadata().is_ok_and(|m| m.len() < HEADER || !m.is_file()) {
        return Err(error(format!("it is shorter than the header of {HEADER} bytes")));
    }
    let map = map(&file).map_err(|e| error(e.to_string()))?;
    let layout = read_layout(&map).map_err(error)?;
    let section = |start: u64, length: u64| &map[start as usize..(start + length) as usize];
    let description: Description = serde_json::from_slice(section(layout.description, layout.description_length))
        .map_err(|e| error(format!("its description does not read: {e}")))?;
    let [vertices, triangles, members, feature_points] = layout.counts;
    if description.names.len() as u64 != members {
        return Err(error(format!("it names {} members where {members} are stored", description.names.len())));
    }
    let positions = bytemuck::cast_slice(section(layout.positions, 12 * vertices)).to_vec();
    let corners = bytemuck::cast_slice(section(layout.triangles, 12 * triangles)).to_vec();
    let points = section(layout.feature_points, 8 * feature_points).chunks_exact(8).map(|b| FeaturePointVertex {
        fp: FeaturePoint { group: b[0], point: b[1] },
        vertex: u32::from_le_bytes([b[4], b[5], b[6], b[7]]),
    });
    let points = points.collect();
    let mesh = TriangleMesh::new(positions, corners).map_err(|e| error(e.to_string()))?;
    let displacements = Displacements::Mapped(map, layout.displacements as usize);
    Bank::from_parts(mesh, description.names, points, description.info, displacements).map_err(|e| error(e.to_string()))
}

fn read_layout(bytes: &[u8]) -> Result<Layout, String> {
    let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
    if bytes.len() < HEADER as usize || !bytes.starts_with(MAGIC) {
        return Err("it does not start with GRIMBANK; make one with `grimace bank build`".to_owned());
    }
    if word(8) != BANK_VERSION {
        return Err(format!("it is of version {}; this program reads version {BANK_VERSION}", word(8)));
    }
    if word(12) != BYTE_ORDER {
        return Err("its byte order is not little endian".to_owned());
    }
    let words: [u64; 11] = std::array::from_fn(|k| long(16 + 8 * k));
    let layout = Layout::new([words[0], words[1], words[2], words[3]], words[5]).filter(|l| l.words() == words);
    let layout = layout.ok_or("its header is damaged: counts and offsets do not fit together")?;
    if layout.length != bytes.len() as u64 {
        return Err(format!("it has {} bytes where {} were expected; it was cut or damaged", bytes.len(), layout.length));
    }
    Ok(layout)
}

/// Maps a file for reading.
#[allow(unsafe_code)]
fn map(file: &File) -> io::Result<Mmap> {
    // SAFETY: the map is only read, as bytes of any value. Bank files are replaced by renaming, never written in place, by this
    // program; another program that shortens one in place while it is in use ends this one, as it would end any that maps files.
    unsafe { Mmap::map(file) }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::synthesis::testing;

    fn written() -> (tempfile::TempDir, std::path::PathBuf, Vec<u8>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bank");
        testing::bank().write(&path).unwrap();
        let bytes = fs::read(&path).unwrap();
        (folder, path, bytes)
    }

    #[test]
    fn a_bank_reads_back_to_the_last_bit() {
        let (_folder, path, _) = written();
        let (bank, read) = (testing::bank(), Bank::open(&path).unwrap());
        assert_eq!(read.mesh(), bank.mesh());
        assert_eq!(read.names(), bank.names());
        assert_eq!(read.feature_points(), bank.feature_points());
        assert_eq!(read.info(), bank.info());
        assert!((0..3).all(|m| read.displacements(m) == bank.displacements(m)));
    }

    #[test]
    fn sections_lie_where_the_format_says() {
        let (_folder, _, bytes) = written();
        let long = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
        assert_eq!(&bytes[..8], MAGIC);
        assert_eq!([16, 24, 32, 40].map(long), [4, 2, 3, 3]);
        // Displacements, the last section: 3 members of 4 vertices of 12 bytes.
        assert_eq!(long(96), bytes.len() as u64);
        assert_eq!(long(88), long(96) - 3 * 4 * 12);
        assert!([64, 72, 80, 88].iter().all(|&at| long(at).is_multiple_of(ALIGNMENT)));
        assert_eq!(bytes[long(88) as usize..][..4], 1.0_f32.to_le_bytes());
    }

    #[test]
    fn damaged_files_are_errors() {
        let (_folder, path, whole) = written();
        let says = |bytes: &[u8], part: &str| {
            fs::write(&path, bytes).unwrap();
            let error = Bank::open(&path).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        };
        let with = |at: usize, byte: u8| {
            let mut bytes = whole.clone();
            bytes[at] = byte;
            bytes
        };
        says(b"hello", "shorter than the header");
        says(&with(0, b'X'), "does not start with GRIMBANK");
        says(&with(8, 2), "version 2; this program reads version 1");
        says(&with(12, 9), "byte order");
        says(&with(16, 9), "counts and offsets do not fit");
        says(&with(23, 255), "counts and offsets do not fit");
        says(&whole[..whole.len() - 1], "it was cut or damaged");
        says(&with(128, b'X'), "description does not read");
        let last = whole.len() - 1;
        let mut nan = whole.clone();
        nan[last - 3..].copy_from_slice(&f32::NAN.to_le_bytes());
        says(&nan, "member `out`: vertex 3 has a displacement that is not a finite number");
        let mut wild = whole.clone();
        wild[last - 3..].copy_from_slice(&1e30_f32.to_le_bytes());
        says(&wild, "member `out`: vertex 3 is displaced by 1.000e30");
        for length in (0..whole.len()).step_by(7) {
            fs::write(&path, &whole[..length]).unwrap();
            assert!(Bank::open(&path).is_err());
        }
    }

    #[test]
    fn a_member_that_fails_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("b.bank");
        let bank = testing::bank();
        let head = BankHead { mesh: bank.mesh(), names: bank.names(), feature_points: bank.feature_points(), info: bank.info() };
        let error = write(&path, &head, |_| Ok(Cow::Owned(vec![[0.0; 3]; 5]))).unwrap_err();
        assert_eq!(error.to_string(), "member `right` has 5 vertices, the neutral mesh 4; all must share one topology");
        assert!(!path.exists());
    }
}
