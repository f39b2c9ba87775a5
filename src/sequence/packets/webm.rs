//! Elements of `WebM` and Matroska files; replaces their random numbers by fixed ones.
//!
//! `FFmpeg` gives every track a random number (`TrackUID`) and repeats it in tags about the track. A Matroska file may also have one for
//! the segment. They only need to be unique within the file. Numbering them 1, 2, ... makes files of the same frames identical.

use std::{
    collections::BTreeMap,
    fs::{File, OpenOptions},
    io::{self, Read, Seek, SeekFrom, Write},
    path::Path,
};

/// Elements by their number in the Matroska specification (RFC 9559).
pub(super) mod element {
    pub const SEGMENT: u32 = 0x1853_8067;
    pub const INFO: u32 = 0x1549_A966;
    pub const TIMESTAMP_SCALE: u32 = 0x002A_D7B1;
    pub const SEGMENT_UID: u32 = 0x73A4;
    pub const TRACKS: u32 = 0x1654_AE6B;
    pub const TRACK_ENTRY: u32 = 0xAE;
    pub const TRACK_NUMBER: u32 = 0xD7;
    pub const TRACK_TYPE: u32 = 0x83;
    pub const TRACK_UID: u32 = 0x73C5;
    pub const CLUSTER: u32 = 0x1F43_B675;
    pub const TIMESTAMP: u32 = 0xE7;
    pub const SIMPLE_BLOCK: u32 = 0xA3;
    pub const BLOCK_GROUP: u32 = 0xA0;
    pub const BLOCK: u32 = 0xA1;
    pub const TAGS: u32 = 0x1254_C367;
    pub const TAG: u32 = 0x7373;
    pub const TARGETS: u32 = 0x63C0;
    pub const TAG_TRACK_UID: u32 = 0x63C5;
}

/// Largest element that is searched, bytes: descriptions are small, pictures are skipped.
const MOST_DESCRIPTION: u64 = 1 << 20;

/// Sets the random numbers of a `WebM` or Matroska file to 1, 2, ... in the order in which they appear.
///
/// # Errors
/// When the file cannot be read or written.
pub(in super::super) fn set_random_numbers(path: &Path) -> io::Result<()> {
    let mut file = OpenOptions::new().read(true).write(true).open(path)?;
    let length = file.metadata()?.len();
    let mut known = BTreeMap::new();
    let mut at = 0;
    while let Some((number, start, size)) = element_at(&mut file, at)? {
        // The content of a segment follows its header, whether its length is known or not.
        if number == element::SEGMENT {
            at = start;
            continue;
        }
        let Some(end) = start.checked_add(size).filter(|&end| end <= length) else { break };
        if matches!(number, element::INFO | element::TRACKS | element::TAGS) && size <= MOST_DESCRIPTION {
            let mut content = vec![0; size as usize];
            file.seek(SeekFrom::Start(start))?;
            file.read_exact(&mut content)?;
            replace(&mut content, &mut known);
            file.seek(SeekFrom::Start(start))?;
            file.write_all(&content)?;
        }
        at = end;
    }
    Ok(())
}

/// Number, offset of the content, and size of the element at an offset of the file; `None` at its end.
pub(super) fn element_at(file: &mut File, at: u64) -> io::Result<Option<(u32, u64, u64)>> {
    let mut head = Vec::new();
    file.seek(SeekFrom::Start(at))?;
    file.take(12).read_to_end(&mut head)?;
    Ok(element_in(&head).map(|(number, start, size)| (number, at + start as u64, size)))
}

/// Number, offset of the content, and size of the element at the start of some bytes. A number has up to 4 bytes, a size up to 8; the count
/// of leading zero bits gives the length.
pub(super) fn element_in(bytes: &[u8]) -> Option<(u32, usize, u64)> {
    let number_length = bytes.first()?.leading_zeros() as usize + 1;
    let number = bytes.get(..number_length).filter(|b| b.len() <= 4)?;
    let number = number.iter().fold(0, |n, &b| n << 8 | u32::from(b));
    let rest = bytes.get(number_length..)?;
    let size_length = rest.first()?.leading_zeros() as usize + 1;
    let size = rest.get(..size_length).filter(|b| b.len() <= 8)?;
    let mark = 1 << (7 * size_length);
    let size = size.iter().fold(0, |n: u64, &b| n << 8 | u64::from(b)) ^ mark;
    Some((number, number_length + size_length, size))
}

/// Replaces the numbers in the content of an element, including nested elements.
fn replace(content: &mut [u8], known: &mut BTreeMap<Vec<u8>, u64>) {
    let mut rest = content;
    while let Some((number, start, size)) = element_in(rest) {
        let Some(end) = usize::try_from(size).ok().and_then(|size| start.checked_add(size)).filter(|&end| end <= rest.len())
        else {
            return;
        };
        let (this, after) = rest.split_at_mut(end);
        let inner = &mut this[start..];
        match number {
            element::TRACK_ENTRY | element::TAG | element::TARGETS => replace(inner, known),
            element::SEGMENT_UID | element::TRACK_UID | element::TAG_TRACK_UID => {
                let next = known.len() as u64 + 1;
                let fixed = known.entry(inner.to_vec()).or_insert(next).to_be_bytes();
                let length = inner.len();
                let digits = length.min(fixed.len());
                inner.fill(0);
                inner[length - digits..].copy_from_slice(&fixed[fixed.len() - digits..]);
            }
            _ => {}
        }
        rest = after;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An element with a number of `number_length` bytes and a size of one byte.
    fn element(number: &[u8], content: &[u8]) -> Vec<u8> {
        [number, &[0x80 | content.len() as u8], content].concat()
    }

    #[test]
    fn a_track_has_the_same_number_wherever_it_is_named() {
        let file = |a: &[u8; 8], b: &[u8; 8]| {
            let track = |uid: &[u8]| element(&[0xAE], &[element(&[0xD7], &[1]), element(&[0x73, 0xC5], uid)].concat());
            let tracks = element(&[0x16, 0x54, 0xAE, 0x6B], &[track(a), track(b)].concat());
            let targets = element(&[0x63, 0xC0], &element(&[0x63, 0xC5], b));
            let tags = element(&[0x12, 0x54, 0xC3, 0x67], &element(&[0x73, 0x73], &targets));
            let cluster = element(&[0x1F, 0x43, 0xB6, 0x75], b"pictures");
            // The segment's length is not known.
            [element(&[0x1A, 0x45, 0xDF, 0xA3], b"webm"), vec![0x18, 0x53, 0x80, 0x67, 0xFF], tracks, cluster, tags].concat()
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.webm");
        std::fs::write(&path, file(b"\xA7\x24\xC5\xEE\x52\x55\x40\x58", b"randomly")).unwrap();
        set_random_numbers(&path).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), file(b"\0\0\0\0\0\0\0\x01", b"\0\0\0\0\0\0\0\x02"));
        // A file of another kind is not changed.
        for bytes in [&b""[..], b"\x1A", b"text that is no film", &[0; 40], &[0xFF; 40]] {
            std::fs::write(&path, bytes).unwrap();
            set_random_numbers(&path).unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), bytes);
        }
    }
}
