//! The bank file: safetensors, little endian, memory-mapped.
//!
//! | tensor | type | shape | content |
//! | --- | --- | --- | --- |
//! | `neutral` | F32 | V x 3 | positions of the neutral mesh |
//! | `triangles` | U32 | T x 3 | its triangles |
//! | `feature_points` | U32 | F x 3 | group, point, vertex |
//! | `displacements` | F32 | M x V x 3 | displacements from neutral, member by member |
//!
//! The format's `__metadata__` has one entry, `grimace`: JSON with `schema_version`, `names` of the members and [`BankInfo`].
//! Files of version 1 have a different layout and can still be read ([`super::old_file`]).

use std::{borrow::Cow, collections::HashMap, fs::File, io, path::Path};

use memmap2::Mmap;
use safetensors::tensor::{Dtype, Metadata, TensorInfo};
use serde::{Deserialize, Serialize};

use super::{
    BankError,
    bank::{Bank, BankHead, BankInfo, Displacements, FeaturePointVertex, check_head, check_member},
    old_file,
};
use crate::{mesh::TriangleMesh, output::write_atomic, units::FeaturePoint};

/// Version of the bank file.
pub const BANK_VERSION: u32 = 2;

/// Name of our entry in the metadata.
const ENTRY: &str = "grimace";
/// Largest header that readers of the format accept, bytes.
const MOST_HEADER: usize = 100_000_000;
/// Number of bytes that hold the header's length; tensors begin at a multiple of it.
const WORD: usize = 8;

#[derive(Serialize, Deserialize)]
struct Description {
    schema_version: u32,
    names: Vec<String>,
    #[serde(flatten)]
    info: BankInfo,
}

/// Returns the length and the header of a file, padded so that the tensors are aligned.
fn header(head: &BankHead<'_>) -> io::Result<Vec<u8>> {
    let description = Description { schema_version: BANK_VERSION, names: head.names.to_vec(), info: head.info.clone() };
    // Only one entry: the order of several would be that of a hash table.
    let entries = HashMap::from([(ENTRY.to_owned(), serde_json::to_string(&description)?)]);
    let (vertices, members) = (head.mesh.vertex_count(), head.names.len());
    let mut end = 0_usize;
    let mut tensor = |name: &str, dtype: Dtype, shape: Vec<usize>| {
        let size = shape.iter().try_fold(4_usize, |size, &n| size.checked_mul(n));
        let begin = end;
        end = size.and_then(|size| begin.checked_add(size)).ok_or_else(|| io::Error::other("the bank is too large"))?;
        Ok::<_, io::Error>((name.to_owned(), TensorInfo { dtype, shape, data_offsets: (begin, end) }))
    };
    let tensors = vec![
        tensor("neutral", Dtype::F32, vec![vertices, 3])?,
        tensor("triangles", Dtype::U32, vec![head.mesh.triangles().len(), 3])?,
        tensor("feature_points", Dtype::U32, vec![head.feature_points.len(), 3])?,
        tensor("displacements", Dtype::F32, vec![members, vertices, 3])?,
    ];
    let metadata = Metadata::new(Some(entries), tensors).map_err(io::Error::other)?;
    let mut text = serde_json::to_vec(&metadata)?;
    text.resize(text.len().next_multiple_of(WORD), b' ');
    if text.len() > MOST_HEADER {
        return Err(io::Error::other(format!("names and weights of the members take more than {MOST_HEADER} bytes")));
    }
    let mut bytes = (text.len() as u64).to_le_bytes().to_vec();
    bytes.append(&mut text);
    Ok(bytes)
}

/// Writes a bank file. It requests the displacements of one member at a time and keeps none in memory.
///
/// # Errors
/// [`BankError::Output`]; the errors of `member`; and those of [`Bank::new`] for an invalid head or member.
pub fn write<'a>(
    path: &Path,
    head: &BankHead<'_>,
    mut member: impl FnMut(usize) -> Result<Cow<'a, [[f32; 3]]>, BankError>,
) -> Result<(), BankError> {
    check_head(head.mesh, head.names, head.feature_points)?;
    let mut failure = None;
    let written = write_atomic(path, |out| {
        out.write_all(&header(head)?)?;
        out.write_all(&float_bytes(head.mesh.positions()))?;
        let corners = head.mesh.triangles().as_flattened();
        let points = head.feature_points.iter().flat_map(|p| [u32::from(p.fp.group), u32::from(p.fp.point), p.vertex]);
        out.write_all(&corners.iter().copied().chain(points).flat_map(u32::to_le_bytes).collect::<Vec<u8>>())?;
        for (k, name) in head.names.iter().enumerate() {
            match member(k).and_then(|m| check_member(name, &m, head.mesh).map(|()| m)) {
                Ok(values) => out.write_all(&float_bytes(&values))?,
                Err(error) => {
                    failure = Some(error);
                    return Err(io::Error::other("a member failed"));
                }
            }
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

/// Opens and checks a bank file of this version, or of version 1.
pub(super) fn open(path: &Path) -> Result<Bank, BankError> {
    let error = |reason: String| BankError::Format { path: path.to_owned(), reason };
    if cfg!(target_endian = "big") {
        return Err(error("bank files are little endian, but this machine is not".to_owned()));
    }
    let file = crate::input::open_file(path).map_err(|e| error(e.to_string()))?;
    if file.metadata().is_ok_and(|m| m.len() < WORD as u64 || !m.is_file()) {
        return Err(error("it is shorter than any bank file".to_owned()));
    }
    let map = map(&file).map_err(|e| error(e.to_string()))?;
    if map.starts_with(old_file::MAGIC) {
        return old_file::read(map).map_err(error);
    }
    read(map).map_err(error)
}

/// Reads the header; returns it with the offset of the tensors.
fn read_header(bytes: &[u8]) -> Result<(usize, Metadata), String> {
    let none =
        "it is not a bank: it is neither a safetensors file nor starts with GRIMBANK; make a bank with `grimace bank build`";
    let (word, rest) = bytes.split_first_chunk::<WORD>().ok_or(none)?;
    let length = usize::try_from(u64::from_le_bytes(*word)).ok().filter(|&n| n <= MOST_HEADER && n <= rest.len()).ok_or(none)?;
    let text = &rest[..length];
    if !text.starts_with(b"{") {
        return Err(none.to_owned());
    }
    let metadata: Metadata = serde_json::from_slice(text).map_err(|e| format!("its header cannot be read: {e}"))?;
    let (found, expected) = (rest.len() - length, metadata.data_len());
    if found != expected {
        return Err(format!("its tensors have {found} bytes, but {expected} were expected; the file is truncated or damaged"));
    }
    Ok((WORD + length, metadata))
}

fn read(map: Mmap) -> Result<Bank, String> {
    let (start, metadata) = read_header(&map)?;
    let text = metadata.metadata().as_ref().and_then(|entries| entries.get(ENTRY));
    let text = text.ok_or("its metadata has no entry `grimace`, so it is not a bank; make one with `grimace bank build`")?;
    let described = |e: serde_json::Error| format!("its description cannot be read: {e}");
    let version = serde_json::from_str::<serde_json::Value>(text).map_err(described)?.get("schema_version").cloned();
    if version != Some(BANK_VERSION.into()) {
        let found = version.map_or_else(|| "unknown".to_owned(), |v| crate::text::excerpt(&v.to_string()));
        return Err(format!("it has version {found}, but this program reads versions 1 and {BANK_VERSION}"));
    }
    let description: Description = serde_json::from_str(text).map_err(described)?;
    // Returns the bytes of a tensor with rows of three, after checking its type and shape.
    let tensor = |name: &str, dtype: Dtype, shape: &[Option<usize>]| {
        let info = metadata.info(name).ok_or_else(|| format!("it has no tensor `{name}`"))?;
        let fits = info.shape.len() == shape.len() && info.shape.iter().zip(shape).all(|(n, want)| want.is_none_or(|w| *n == w));
        if info.dtype != dtype || !fits {
            let want: Vec<String> = shape.iter().map(|n| n.map_or_else(|| "any".to_owned(), |n| n.to_string())).collect();
            let (found, want) = (crate::text::excerpt(&format!("{:?}", info.shape)), want.join(", "));
            return Err(format!("its tensor `{name}` is {:?} {found}; {dtype:?} [{want}] was expected", info.dtype));
        }
        let (begin, end) = info.data_offsets;
        map.get(start + begin..start + end).ok_or_else(|| format!("its tensor `{name}` lies outside the file"))
    };
    let positions: Vec<[f32; 3]> = rows(tensor("neutral", Dtype::F32, &[None, Some(3)])?, f32::from_le_bytes);
    let corners: Vec<[u32; 3]> = rows(tensor("triangles", Dtype::U32, &[None, Some(3)])?, u32::from_le_bytes);
    let points: Vec<[u32; 3]> = rows(tensor("feature_points", Dtype::U32, &[None, Some(3)])?, u32::from_le_bytes);
    let shape = [Some(description.names.len()), Some(positions.len()), Some(3)];
    let values = tensor("displacements", Dtype::F32, &shape)?;
    let byte = |n: u32| {
        u8::try_from(n).map_err(|_| format!("its tensor `feature_points` has the group or point {n}; 0 to 255 was expected"))
    };
    let point = |[group, point, vertex]: [u32; 3]| {
        Ok::<_, String>(FeaturePointVertex { fp: FeaturePoint { group: byte(group)?, point: byte(point)? }, vertex })
    };
    let points = points.into_iter().map(point).collect::<Result<Vec<_>, _>>()?;
    let mesh = TriangleMesh::new(positions, corners).map_err(|e| e.to_string())?;
    let displacements = if bytemuck::try_cast_slice::<u8, [f32; 3]>(values).is_ok() {
        let at = values.as_ptr().addr() - map.as_ptr().addr();
        Displacements::Mapped(map, at)
    } else {
        // Headers written by other programs may leave the tensors unaligned.
        Displacements::Owned(rows(values, f32::from_le_bytes))
    };
    Bank::from_parts(mesh, description.names, points, description.info, displacements).map_err(|e| e.to_string())
}

/// Decodes rows of three numbers of four bytes each.
fn rows<T>(bytes: &[u8], number: fn([u8; 4]) -> T) -> Vec<[T; 3]> {
    let (numbers, _) = bytes.as_chunks::<4>();
    let (rows, _) = numbers.as_chunks::<3>();
    rows.iter().map(|row| row.map(number)).collect()
}

/// Maps a file for reading.
#[allow(unsafe_code)]
fn map(file: &File) -> io::Result<Mmap> {
    // SAFETY: the map is only read, as bytes of any value. This program replaces bank files by renaming and never writes them in
    // place. If another program shortens a mapped file in place, this process ends, as any process that maps files would.
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

    /// The file with another header of the same or another length.
    fn with_header(bytes: &[u8], change: impl Fn(&str) -> String) -> Vec<u8> {
        let (start, _) = read_header(bytes).unwrap();
        let text = change(std::str::from_utf8(&bytes[WORD..start]).unwrap());
        [&(text.len() as u64).to_le_bytes()[..], text.as_bytes(), &bytes[start..]].concat()
    }

    fn assert_same(read: &Bank, bank: &Bank) {
        assert_eq!(read.mesh(), bank.mesh());
        assert_eq!(read.names(), bank.names());
        assert_eq!(read.feature_points(), bank.feature_points());
        assert_eq!(read.info(), bank.info());
        assert!((0..bank.member_count()).all(|m| read.displacements(m) == bank.displacements(m)));
    }

    #[test]
    fn a_bank_reads_back_to_the_last_bit() {
        let (_folder, path, bytes) = written();
        let read = Bank::open(&path).unwrap();
        assert_same(&read, &testing::bank());
        assert!(read.is_mapped() && !read.is_old_file());
        // The same bank gives the same bytes.
        let again = path.with_extension("again");
        read.write(&again).unwrap();
        assert_eq!(fs::read(&again).unwrap(), bytes);
    }

    #[test]
    fn any_reader_of_the_format_finds_the_tensors() {
        let (_folder, _, bytes) = written();
        let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        let shape = |name: &str| file.tensor(name).unwrap().shape().to_vec();
        assert_eq!(shape("neutral"), [4, 3]);
        assert_eq!(shape("triangles"), [2, 3]);
        assert_eq!(shape("displacements"), [3, 4, 3]);
        let displacements = file.tensor("displacements").unwrap();
        assert_eq!(displacements.data()[..4], 1.0_f32.to_le_bytes());
        // 8.4 at vertex 0, 8.3 at 1, 3.11 at 2.
        let points: Vec<[u32; 3]> = rows(file.tensor("feature_points").unwrap().data(), u32::from_le_bytes);
        assert_eq!(points, [[8, 4, 0], [8, 3, 1], [3, 11, 2]]);
        // The tensors begin at a multiple of eight bytes.
        assert!(read_header(&bytes).unwrap().0.is_multiple_of(WORD));
    }

    #[test]
    fn files_of_another_writer_of_the_format_are_read() {
        // Written by Python's safetensors: the tensors are in another order.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.bank");
        fs::write(&path, include_bytes!("../../fuzz/seeds/bank/python.bank")).unwrap();
        let bank = Bank::open(&path).unwrap();
        assert!(bank.is_mapped());
        assert_eq!(bank.displacements(0), [[0.0; 3], [0.0; 3], [0.0, 0.5, 0.0], [0.0; 3]]);
        assert_eq!(bank.mesh().triangles(), [[0, 1, 2], [0, 2, 3], [0, 1, 3]]);
    }

    #[test]
    fn misaligned_tensors_are_copied() {
        let (_folder, path, bytes) = written();
        for blanks in 1..=4 {
            fs::write(&path, with_header(&bytes, |text| text.trim_end().to_owned() + &" ".repeat(blanks))).unwrap();
            let length = read_header(&fs::read(&path).unwrap()).unwrap().0;
            let read = Bank::open(&path).unwrap();
            assert_same(&read, &testing::bank());
            assert_eq!(read.is_mapped(), length.is_multiple_of(4), "{length}");
        }
    }

    #[test]
    fn damaged_files_are_errors() {
        let (_folder, path, whole) = written();
        let says = |bytes: &[u8], part: &str| {
            fs::write(&path, bytes).unwrap();
            let error = Bank::open(&path).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        };
        let replaced = |from: &str, to: &str| {
            with_header(&whole, |text| {
                assert!(text.contains(from), "{text}");
                text.replacen(from, to, 1)
            })
        };
        says(b"hello", "shorter than any bank file");
        says(b"hello world, hello", "it is not a bank: it is neither a safetensors file nor starts with GRIMBANK");
        says(&[0xFF; 64], "it is not a bank");
        says(&[&[0; 8][..], &[b'{'; 8]].concat(), "it is not a bank");
        says(&whole[..whole.len() - 1], "bytes, but 252 were expected; the file is truncated or damaged");
        says(&[&whole[..], &[0]].concat(), "the file is truncated or damaged");
        says(&replaced("{", "["), "it is not a bank");
        says(&replaced("[4,3]", "[4,4]"), "its header cannot be read");
        // Sizes whose product or sum exceeds 64 bits.
        says(&replaced("[4,3]", "[9223372036854775807,3]"), "its header cannot be read");
        says(&replaced("[0,48]", "[0,18446744073709551615]"), "its header cannot be read");
        says(&replaced("[0,48]", "[4,48]"), "its header cannot be read");
        says(&replaced("\"neutral\"", "\"nobody\""), "it has no tensor `neutral`");
        says(&replaced("\"F32\"", "\"I32\""), "its tensor `neutral` is I32 [4, 3]; F32 [any, 3] was expected");
        says(&replaced("[3,4,3]", "[4,3,3]"), "its tensor `displacements` is F32 [4, 3, 3]; F32 [3, 4, 3] was expected");
        says(&replaced("\"grimace\"", "\"another\""), "its metadata has no entry `grimace`");
        says(
            &replaced("schema_version\\\":2", "schema_version\\\":3"),
            "it has version 3, but this program reads versions 1 and 2",
        );
        says(&replaced("\\\"names\\\"", "\\\"nobody\\\""), "its description cannot be read");
        // 252 bytes: neutral 4 x 12, triangles 2 x 12, feature points 3 x 12, displacements 3 x 4 x 12.
        let (start, _) = read_header(&whole).unwrap();
        let with = |at: usize, value: [u8; 4]| {
            let mut bytes = whole.clone();
            bytes[at..at + 4].copy_from_slice(&value);
            bytes
        };
        says(&with(start + 72, 300_u32.to_le_bytes()), "has the group or point 300");
        says(&with(start + 48, 9_u32.to_le_bytes()), "vertex");
        let last = whole.len() - 4;
        says(&with(last, f32::NAN.to_le_bytes()), "member `out`: vertex 3 has a displacement that is not a finite number");
        says(&with(last, 1e30_f32.to_le_bytes()), "member `out`: vertex 3 is displaced by 1.000e30");
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
        assert_eq!(
            error.to_string(),
            "member `right` has 5 vertices, but the neutral mesh has 4; all meshes must share one topology"
        );
        assert!(!path.exists());
    }
}
