//! MP4 and `QuickTime`: a table with the times of all pictures. Fragmented files have none.

use std::{
    io::{self, Read, Seek, SeekFrom},
    path::Path,
};

use super::{MOST_PACKETS, Packets};

/// Largest movie description that is read, bytes.
const MOST_DESCRIPTION: u64 = 1 << 28;

pub(super) fn read(path: &Path) -> io::Result<Option<Packets>> {
    let mut file = crate::input::open_file(path)?;
    let mut at = 0_u64;
    loop {
        let mut head = Vec::new();
        file.seek(SeekFrom::Start(at))?;
        (&mut file).take(16).read_to_end(&mut head)?;
        let Some((name, start, size)) = head_of(&head) else { return Ok(None) };
        if name == *b"moov" && size <= MOST_DESCRIPTION {
            let mut film = Vec::new();
            file.seek(SeekFrom::Start(at + start as u64))?;
            file.take(size - start as u64).read_to_end(&mut film)?;
            let scale = inner(&film, *b"mvhd").and_then(scale_of);
            return Ok(boxes(&film).filter(|(name, _)| name == b"trak").find_map(|(_, track)| packets(track, scale)));
        }
        let Some(next) = at.checked_add(size) else { return Ok(None) };
        at = next;
    }
}

/// Units per second in a header of the film (`mvhd`) or of a track's media (`mdhd`).
fn scale_of(header: &[u8]) -> Option<f64> {
    u32_at(header, if header.first() == Some(&1) { 20 } else { 12 }).map(f64::from)
}

/// Packets of a track, if it is a video track. `film`: units per second of the film.
fn packets(track: &[u8], film: Option<f64>) -> Option<Packets> {
    let media = inner(track, *b"mdia")?;
    if inner(media, *b"hdlr")?.get(8..12)? != b"vide" {
        return None;
    }
    let scale = scale_of(inner(media, *b"mdhd")?)?;
    let table = inner(inner(media, *b"minf")?, *b"stbl")?;
    let mut times: Vec<i64> = Vec::new();
    let mut time = 0_i64;
    for (count, step) in entries(inner(table, *b"stts")?) {
        if times.len() + count as usize > MOST_PACKETS {
            return None;
        }
        times.extend((0..i64::from(count)).map(|k| time + k * i64::from(step)));
        time += i64::from(count) * i64::from(step);
    }
    let shifts = inner(table, *b"ctts").into_iter().flat_map(entries);
    let shifts = shifts
        .flat_map(|(count, shift)| std::iter::repeat_n(i64::from(shift.cast_signed()), count.min(MOST_PACKETS as u32) as usize));
    times.iter_mut().zip(shifts).for_each(|(time, shift)| *time += shift);
    let first = times.iter().min().copied()?;
    // Frames cut off at the beginning are decoded but not shown.
    let edits = inner(track, *b"edts").and_then(|edits| inner(edits, *b"elst")).map(edits_of).unwrap_or_default();
    let start = edits.first().map(|edit| edit.start);
    let from_start = start.and_then(|start| times.iter().filter(|time| **time >= start).min().copied());
    let seconds = |time: i64| time as f64 / scale;
    let shown = match edits[..] {
        [] => Some(times.len()),
        // Rounding in the coarser units of the film may cut off a frame.
        [Edit { start, duration }] => film.filter(|film| *film > 0.0).map(|film| {
            let end = if duration > 0 { seconds(start) + (duration as f64 + 1.0) / film } else { f64::INFINITY };
            times.iter().filter(|time| **time >= start && seconds(**time) < end).count()
        }),
        _ => None,
    };
    let origins = std::iter::once(first).chain(from_start).chain(start).map(seconds).collect();
    let times = times.iter().map(|&time| seconds(time)).collect();
    (scale > 0.0).then_some(Packets { times, origins, breaks: Vec::new(), shown })
}

/// An edit that shows a part of the media.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Edit {
    /// Start, in the units of the media.
    start: i64,
    /// Length, in the units of the film; 0 for all that follows.
    duration: u64,
}

/// The edits of a list (`elst`) that show something.
fn edits_of(list: &[u8]) -> Vec<Edit> {
    let is_long = list.first() == Some(&1);
    let count = (u32_at(list, 4).unwrap_or(0) as usize).min(list.len());
    let long = |at: usize| Some(u64::from(u32_at(list, at)?) << 32 | u64::from(u32_at(list, at + 4)?));
    let edit = |k: usize| {
        if is_long {
            Some(Edit { start: long(16 + 20 * k)?.cast_signed(), duration: long(8 + 20 * k)? })
        } else {
            let start = i64::from(u32_at(list, 12 + 12 * k)?.cast_signed());
            Some(Edit { start, duration: u64::from(u32_at(list, 8 + 12 * k)?) })
        }
    };
    (0..count).map_while(edit).filter(|edit| edit.start >= 0).collect()
}

/// Pairs of numbers in a table that begins with their count.
fn entries(table: &[u8]) -> impl Iterator<Item = (u32, u32)> {
    let count = u32_at(table, 4).unwrap_or(0) as usize;
    let pairs = table.get(8..).unwrap_or_default().as_chunks::<8>().0;
    pairs.iter().take(count).map(|&[a, b, c, d, e, f, g, h]| (u32::from_be_bytes([a, b, c, d]), u32::from_be_bytes([e, f, g, h])))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|four| u32::from_be_bytes(*four))
}

/// Name, offset of the content, and size including the header, of the box at the start of some bytes.
fn head_of(bytes: &[u8]) -> Option<([u8; 4], usize, u64)> {
    let name = *bytes.get(4..)?.first_chunk()?;
    match u32_at(bytes, 0)? {
        1 => {
            let size = u64::from_be_bytes(*bytes.get(8..)?.first_chunk()?);
            (size >= 16).then_some((name, 16, size))
        }
        size => (size >= 8).then_some((name, 8, u64::from(size))),
    }
}

fn boxes(content: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> {
    let mut rest = content;
    std::iter::from_fn(move || {
        let (name, start, size) = head_of(rest)?;
        let end = usize::try_from(size).ok()?;
        let inner = rest.get(start..end)?;
        rest = rest.get(end..)?;
        Some((name, inner))
    })
}

fn inner(content: &[u8], wanted: [u8; 4]) -> Option<&[u8]> {
    boxes(content).find_map(|(name, inner)| (name == wanted).then_some(inner))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn box_of(name: [u8; 4], content: &[u8]) -> Vec<u8> {
        [&(content.len() as u32 + 8).to_be_bytes(), &name[..], content].concat()
    }

    fn numbers(values: &[u32]) -> Vec<u8> {
        values.iter().flat_map(|value| value.to_be_bytes()).collect()
    }

    #[test]
    fn pictures_have_the_times_at_which_they_are_shown() {
        let track = |kind: &[u8; 4]| {
            let table = [
                // Three of 512 ticks, one of 1024; displayed in another order, from 1024 on.
                box_of(*b"stts", &numbers(&[0, 2, 3, 512, 1, 1024])),
                box_of(*b"ctts", &numbers(&[0, 4, 1, 1024, 1, 1536, 1, 512, 1, 1024])),
            ];
            let media = [
                box_of(*b"mdhd", &numbers(&[0, 0, 0, 12_800, 9])),
                box_of(*b"hdlr", &[&[0; 8], &kind[..], &[0; 12]].concat()),
                box_of(*b"minf", &box_of(*b"stbl", &table.concat())),
            ];
            let edits = box_of(*b"edts", &box_of(*b"elst", &numbers(&[0, 2, 40, u32::MAX, 0x1_0000, 100, 1024, 0x1_0000])));
            box_of(*b"trak", &[edits, box_of(*b"mdia", &media.concat())].concat())
        };
        let file = [
            box_of(*b"ftyp", b"isom"),
            box_of(*b"mdat", b"pictures"),
            box_of(*b"moov", &[track(b"soun"), track(b"vide")].concat()),
        ];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        std::fs::write(&path, file.concat()).unwrap();
        let packets = Packets::of(&path, None).unwrap();
        assert_eq!(packets.times, [0.08, 0.12, 0.16, 0.2]);
        assert_eq!(packets.origins, [0.08, 0.08, 0.08]);
        assert_eq!((packets.shown(), packets.start()), (None, 0.08), "the film's units are unknown");
        // From 0.12 s on, and 0.1 s of it, in milliseconds of the film: the pictures at 0.12, 0.16 and 0.2 are shown, or only two.
        let packets_of = |track: &[u8]| super::packets(track, Some(1000.0)).unwrap().shown();
        let shown = |duration: u32| {
            let edits = numbers(&[0, 1, duration, 1536, 0x1_0000]);
            let edits = box_of(*b"edts", &box_of(*b"elst", &edits));
            let whole = track(b"vide");
            let media = boxes(&whole).next().map(|(_, track)| inner(track, *b"mdia").unwrap()).unwrap();
            packets_of(&[edits, box_of(*b"mdia", media)].concat())
        };
        assert_eq!([0, 100, 60].map(shown), [Some(3), Some(3), Some(2)]);
        // A table that states more entries than it has is rejected.
        let table = box_of(*b"stts", &numbers(&[0, u32::MAX, u32::MAX, 1]));
        assert_eq!(entries(&table[8..]).collect::<Vec<_>>(), [(u32::MAX, 1)]);
    }
}
