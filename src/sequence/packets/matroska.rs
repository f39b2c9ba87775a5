//! Matroska and `WebM`: clusters that contain blocks with times.

use std::{
    fs::File,
    io::{self, Read, Seek, SeekFrom},
    path::Path,
};

use super::{
    MOST_PACKETS, Packets,
    webm::{
        element::{
            BLOCK, BLOCK_GROUP, CLUSTER, INFO, SEGMENT, SIMPLE_BLOCK, TIMESTAMP, TIMESTAMP_SCALE, TRACK_ENTRY, TRACK_NUMBER,
            TRACK_TYPE, TRACKS,
        },
        element_at, element_in,
    },
};

/// Elements by their number (RFC 9559): those that contain others, and those that are read.
const KNOWN: [u32; 7] = [SEGMENT, CLUSTER, BLOCK_GROUP, INFO, TRACKS, TIMESTAMP, SIMPLE_BLOCK];
/// Other elements at the same level: the head, index, tags, chapters, attachments, metadata of clusters and blocks, checksums and voids.
const OTHERS: [u32; 20] = [
    BLOCK,
    0x1A45_DFA3,
    0x114D_9B74,
    0x1C53_BB6B,
    0x1254_C367,
    0x1043_A770,
    0x1941_A469,
    0xA7,
    0xAB,
    0x5854,
    0x9B,
    0xFA,
    0xFB,
    0xFD,
    0xA4,
    0x75A1,
    0x75A2,
    0x8E,
    0xBF,
    0xEC,
];

/// Largest description element that is read, bytes.
const MOST_DESCRIPTION: u64 = 1 << 20;
/// Most bytes of a block before its picture: number of the track, time, flags.
const BLOCK_HEAD: u64 = 11;
/// Flag of a block whose picture only helps to decode others.
const INVISIBLE: u8 = 0x08;
/// Track type of video.
const VIDEO: u64 = 1;

pub(super) fn read(path: &Path) -> io::Result<Packets> {
    let mut file = crate::input::open_file(path)?;
    let length = file.metadata()?.len();
    let (mut scale, mut track, mut cluster) = (1e6, None, 0);
    let mut packets = Packets::default();
    let mut at = 0;
    while packets.times.len() < MOST_PACKETS {
        let found = element_at(&mut file, at)?;
        let is_known = |number: &u32| KNOWN.contains(number) || OTHERS.contains(number);
        let Some((number, start, size)) = found.filter(|(number, ..)| is_known(number)) else {
            packets.breaks.extend(packets.times.last());
            match next_cluster(&mut file, at + 1)? {
                Some(place) if at < length => at = place,
                _ => break,
            }
            continue;
        };
        let end = start.saturating_add(size);
        match number {
            // Their content follows the header, whether their length is known or not.
            SEGMENT | CLUSTER | BLOCK_GROUP => {
                at = start;
                continue;
            }
            INFO if size <= MOST_DESCRIPTION => {
                let content = content(&mut file, start, size)?;
                scale = find(&content, TIMESTAMP_SCALE).map_or(scale, |bytes| unsigned(bytes) as f64);
            }
            TRACKS if track.is_none() && size <= MOST_DESCRIPTION => {
                let content = content(&mut file, start, size)?;
                track = elements(&content)
                    .filter(|(number, entry)| {
                        *number == TRACK_ENTRY && find(entry, TRACK_TYPE).is_some_and(|kind| unsigned(kind) == VIDEO)
                    })
                    .find_map(|(_, entry)| find(entry, TRACK_NUMBER).map(unsigned));
            }
            TIMESTAMP if size <= 8 => cluster = unsigned(&content(&mut file, start, size)?) as i64,
            SIMPLE_BLOCK | BLOCK if end <= length => {
                let head = content(&mut file, start, size.min(BLOCK_HEAD))?;
                if let Some((_, time, _)) = block(&head).filter(|(of, _, flags)| Some(*of) == track && flags & INVISIBLE == 0) {
                    packets.times.push(cluster.saturating_add(time) as f64 * scale / 1e9);
                }
            }
            _ => {}
        }
        at = end;
    }
    packets.origins = packets.times.iter().copied().min_by(f64::total_cmp).into_iter().collect();
    Ok(packets)
}

fn content(file: &mut File, start: u64, size: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(start))?;
    file.take(size).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Track, time relative to the cluster, and flags of a block.
fn block(head: &[u8]) -> Option<(u64, i64, u8)> {
    let length = head.first()?.leading_zeros() as usize + 1;
    let track = unsigned(head.get(..length).filter(|bytes| bytes.len() <= 8)?) ^ 1 << (7 * length);
    let [high, low, flags] = *head.get(length..length + 3)? else { return None };
    Some((track, i64::from(i16::from_be_bytes([high, low])), flags))
}

/// The elements inside the content of another one.
fn elements(content: &[u8]) -> impl Iterator<Item = (u32, &[u8])> {
    let mut rest = content;
    std::iter::from_fn(move || {
        let (number, start, size) = element_in(rest)?;
        let end = usize::try_from(size).ok().and_then(|size| start.checked_add(size))?;
        let inner = rest.get(start..end)?;
        rest = rest.get(end..)?;
        Some((number, inner))
    })
}

fn find(content: &[u8], wanted: u32) -> Option<&[u8]> {
    elements(content).find_map(|(number, inner)| (number == wanted).then_some(inner))
}

fn unsigned(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0, |n, &b| n << 8 | u64::from(b))
}

/// Offset of the next cluster from an offset on.
fn next_cluster(file: &mut File, from: u64) -> io::Result<Option<u64>> {
    const PIECE: u64 = 1 << 16;
    let (wanted, mut at) = (CLUSTER.to_be_bytes(), from);
    loop {
        let piece = content(file, at, PIECE)?;
        if let Some(place) = piece.windows(wanted.len()).position(|four| four == wanted) {
            return Ok(Some(at + place as u64));
        }
        if (piece.len() as u64) < PIECE {
            return Ok(None);
        }
        at += PIECE - wanted.len() as u64 + 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn element(number: &[u8], content: &[u8]) -> Vec<u8> {
        [number, &[0x80 | content.len() as u8], content].concat()
    }

    #[test]
    fn blocks_have_times_and_broken_places_are_found() {
        let track = |number: u8, kind: u8| element(&[0xAE], &[element(&[0xD7], &[number]), element(&[0x83], &[kind])].concat());
        let tracks = element(&[0x16, 0x54, 0xAE, 0x6B], &[track(1, 2), track(2, 1)].concat());
        let info = element(&[0x15, 0x49, 0xA9, 0x66], &element(&[0x2A, 0xD7, 0xB1], &2_000_000_u32.to_be_bytes()));
        let simple = |track: u8, time: u8, flags: u8| element(&[0xA3], &[0x80 | track, 0, time, flags, 7, 7]);
        let group = element(&[0xA0], &element(&[0xA1], &[0x82, 0, 30, 0, 7]));
        let cluster = |time: u8, blocks: Vec<Vec<u8>>| {
            element(&[0x1F, 0x43, 0xB6, 0x75], &[element(&[0xE7], &[time]), blocks.concat()].concat())
        };
        let first = cluster(0, vec![simple(2, 0, 0x80), simple(1, 5, 0), simple(2, 11, 8), simple(2, 20, 0), group]);
        let second = cluster(40, vec![simple(2, 0, 0), simple(2, 10, 0)]);
        let file = |first: &[u8]| {
            [&element(&[0x1A, 0x45, 0xDF, 0xA3], b"webm")[..], &[0x18, 0x53, 0x80, 0x67, 0xFF], &info, &tracks, first, &second]
                .concat()
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.webm");
        std::fs::write(&path, file(&first)).unwrap();
        let packets = Packets { times: vec![0.0, 0.04, 0.06, 0.08, 0.1], origins: vec![0.0], breaks: vec![0.1], shown: None };
        assert_eq!(read(&path).unwrap(), packets);
        // Without the number of the group, FFmpeg also continues at the next cluster.
        let mut broken = first.clone();
        let place = broken.len() - 9;
        assert_eq!(broken[place], 0xA0);
        broken[place..place + 4].fill(0);
        std::fs::write(&path, file(&broken)).unwrap();
        assert_eq!(
            read(&path).unwrap(),
            Packets { times: vec![0.0, 0.04, 0.08, 0.1], origins: vec![0.0], breaks: vec![0.04, 0.1], shown: None }
        );
    }
}
