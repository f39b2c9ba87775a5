//! AVI: consecutive chunks with a name of four letters and a length. A frame's time is its index among them, so `FFmpeg` miscounts after
//! damage that it had to skip.

use std::{
    fs::File,
    io::{self, Read, Seek, SeekFrom},
    path::Path,
};

use super::{MOST_PACKETS, Packets};

/// Iterates over the chunks of an AVI file.
#[derive(Debug)]
pub(in super::super) struct Walk {
    file: File,
    length: u64,
    at: u64,
    /// Streams so far.
    streams: u32,
    /// Number of the video stream, and seconds per frame.
    video: Option<(u32, f64)>,
    /// Indices of pictures that are not empty; an empty one repeats the previous one.
    places: Vec<u32>,
    /// Pictures so far, empty ones included.
    place: u32,
    has_ended: bool,
    /// Whether the data that follow are not a chunk.
    is_broken: bool,
}

/// Bytes read of a stream header: kind, rate and everything before them.
const STREAM_HEADER: u64 = 28;

impl Walk {
    pub(super) fn of(path: &Path) -> io::Result<Self> {
        let file = crate::input::open_file(path)?;
        let length = file.metadata()?.len();
        let (places, video) = (Vec::new(), None);
        Ok(Self { file, length, at: 0, streams: 0, video, places, place: 0, has_ended: false, is_broken: false })
    }

    /// Times of all pictures. The walk continues from its present position.
    pub(super) fn packets(&mut self) -> io::Result<Option<Packets>> {
        while !self.has_ended {
            self.step()?;
        }
        let Some((_, step)) = self.video else { return Ok(None) };
        let times: Vec<f64> = self.places.iter().map(|place| f64::from(*place) * step).collect();
        let origins = times.first().copied().into_iter().collect();
        Ok(Some(Packets { times, origins, ..Packets::default() }))
    }

    /// Number of frames before the first damage, if the damage comes before frame `number`.
    pub(in super::super) fn whole_before(&mut self, number: u32) -> Option<u32> {
        while !self.has_ended && self.places.len() < number as usize {
            // A file that cannot be read cannot be decoded either.
            self.step().ok()?;
        }
        let found = self.places.len() as u32;
        (self.is_broken && found < number).then_some(found)
    }

    /// Goes to the next chunk.
    fn step(&mut self) -> io::Result<()> {
        let Some((name, size)) = chunk(&mut self.file, self.at)? else {
            self.has_ended = true;
            return Ok(());
        };
        let end = self.at.saturating_add(8 + u64::from(size));
        match &name {
            // Both have a kind, and contain chunks.
            b"RIFF" | b"LIST" => {
                self.at += 12;
                return Ok(());
            }
            b"strh" => self.stream_header()?,
            [a @ b'0'..=b'9', b @ b'0'..=b'9', kind @ ..] => {
                let stream = u32::from(a - b'0') * 10 + u32::from(b - b'0');
                if end > self.length || self.places.len() == MOST_PACKETS {
                    self.has_ended = true;
                } else if self.video.is_some_and(|(number, _)| number == stream) && matches!(kind, b"dc" | b"db") {
                    if size > 0 {
                        self.places.push(self.place);
                    }
                    self.place = self.place.saturating_add(1);
                }
            }
            name if !name.iter().all(|letter| letter.is_ascii_alphanumeric() || *letter == b' ') => {
                (self.has_ended, self.is_broken) = (true, !self.places.is_empty());
            }
            _ => {}
        }
        self.at = end.saturating_add(u64::from(size % 2));
        Ok(())
    }

    /// Reads the header of a stream at the file's position.
    fn stream_header(&mut self) -> io::Result<()> {
        let mut header = Vec::new();
        (&mut self.file).take(STREAM_HEADER).read_to_end(&mut header)?;
        let number = |from: usize| header.get(from..)?.first_chunk().map(|four| f64::from(u32::from_le_bytes(*four)));
        if let (None, true, Some(scale), Some(rate)) = (self.video, header.starts_with(b"vids"), number(20), number(24)) {
            self.video = Some((self.streams, scale / rate)).filter(|(_, step)| step.is_finite() && *step > 0.0);
        }
        self.streams += 1;
        Ok(())
    }
}

/// Name and length of the chunk at an offset; the file is then positioned at its content. `None` at the end of the file.
fn chunk(file: &mut File, at: u64) -> io::Result<Option<([u8; 4], u32)>> {
    let mut head = Vec::new();
    file.seek(SeekFrom::Start(at))?;
    file.take(8).read_to_end(&mut head)?;
    Ok(match head.as_slice() {
        &[a, b, c, d, e, f, g, h] => Some(([a, b, c, d], u32::from_le_bytes([e, f, g, h]))),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunk_of(name: &[u8], content: &[u8]) -> Vec<u8> {
        let odd: &[u8] = if content.len() % 2 == 1 { &[0] } else { &[] };
        [name, &(content.len() as u32).to_le_bytes(), content, odd].concat()
    }

    #[test]
    fn pictures_are_counted_to_where_no_chunk_follows() {
        let header = |kind: &[u8]| chunk_of(b"strh", &[kind, &[0; 16], &2_u32.to_le_bytes(), &50_u32.to_le_bytes()].concat());
        let headers = chunk_of(b"LIST", &[b"hdrl".to_vec(), header(b"auds"), header(b"vids")].concat());
        let chunks = [("00wb", "sound"), ("01dc", "one"), ("01dc", ""), ("01dc", "two"), ("JUNK", "x"), ("01dc", "three")];
        let chunks: Vec<u8> = chunks.iter().flat_map(|(name, content)| chunk_of(name.as_bytes(), content.as_bytes())).collect();
        let movie = chunk_of(b"LIST", &[b"movi".to_vec(), chunks].concat());
        let mut file = chunk_of(b"RIFF", &[b"AVI ".to_vec(), headers, movie].concat());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.avi");
        std::fs::write(&path, &file).unwrap();
        let whole = |number: u32| Walk::of(&path).unwrap().whole_before(number);
        assert_eq!(Walk::of(&path).unwrap().packets().unwrap().unwrap().times, [0.0, 0.08, 0.12]);
        assert_eq!((whole(3), whole(4)), (None, None));
        // Without the name of the chunk between the second and the third picture.
        let junk = file.windows(4).position(|four| four == b"JUNK").unwrap();
        file[junk..junk + 4].fill(0);
        std::fs::write(&path, &file).unwrap();
        assert_eq!((whole(2), whole(3)), (None, Some(2)));
        // The same walk gives the times at a gap and continues counting, without restarting.
        let mut walk = Walk::of(&path).unwrap();
        assert_eq!(walk.whole_before(1), None);
        let passed = walk.at;
        assert!(passed > 0 && walk.packets().unwrap().unwrap().times == [0.0, 0.08] && walk.at > passed);
        let ended = walk.at;
        assert_eq!((walk.whole_before(2), walk.whole_before(3), walk.at), (None, Some(2), ended));
        assert_eq!(walk.packets().unwrap().unwrap().times, [0.0, 0.08]);
        // Truncated within a picture: nothing follows that could be miscounted.
        std::fs::write(&path, &file[..junk - 1]).unwrap();
        assert_eq!((whole(2), whole(3)), (None, None));
    }
}
