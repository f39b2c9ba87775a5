//! `back FROM TO MOST_PIXELS FILE`: sends a video's header data, decodes the frames up to number FROM (counted from 1), then sends those
//! from FROM back to TO in grey, each with its time if known. If the video ends before FROM, it sends only the number of frames.
//!
//! The last frames before FROM are kept in memory. Earlier ones are decoded again in sections, each from a key frame. Seeking is
//! unreliable: a key frame may not be where the file states, and the frames after it may refer to earlier ones. A frame is therefore sent
//! only if its hash equals that of the first decoding. If seeking does not achieve that, the section is decoded from the beginning.

use std::{
    collections::VecDeque,
    ffi::OsString,
    path::{Path, PathBuf},
};

use grimace::internal::companion::wire::Reply;

use crate::{
    Trouble,
    film::{Film, Picture},
    number,
    talk::{Talk, end_with_input},
};

/// Memory for decoded pixels, bytes.
const HELD_BYTES: u64 = 48 << 20;
/// Smallest and largest number of frames in a section.
const PIECE: (u32, u32) = (4, 512);
/// Numbers of frames before a section from which decoding it is tried, in this order.
const AHEAD: [u32; 3] = [1, 48, 480];

/// Data kept of a frame.
struct Seen {
    time: Option<f64>,
    hash: blake3::Hash,
}

struct Backward {
    path: PathBuf,
    film: Film,
    /// All frames from the first on.
    seen: Vec<Seen>,
}

pub fn run(arguments: &[OsString], talk: &mut Talk) -> Result<(), Trouble> {
    end_with_input();
    let (from, to, most) = (number::<u32>(arguments, 0)?, number::<u32>(arguments, 1)?.max(1), number::<u64>(arguments, 2)?);
    let path = Path::new(arguments.get(3).map(OsString::as_os_str).unwrap_or_default());
    let mut back = Backward { path: path.to_owned(), film: Film::open(path)?, seen: Vec::new() };
    let (header, pixels) = back.film.header();
    talk.say(&header)?;
    if pixels > most {
        return Ok(());
    }
    let Some((mut piece, length)) = back.pass(from, to, talk)? else {
        talk.say(&Reply::End { frames: back.seen.len() as u32 })?;
        return Ok(());
    };
    let mut next = from;
    loop {
        while let Some(picture) = piece.pop_back() {
            if let Some(seconds) = back.seen.get(next as usize - 1).and_then(|seen| seen.time) {
                talk.say(&Reply::Time { seconds })?;
            }
            talk.show(picture.size, picture.channels, &picture.data)?;
            next -= 1;
        }
        if next < to {
            return Ok(());
        }
        piece = back.fetch(next.saturating_sub(length - 1).max(to), next)?;
    }
}

impl Backward {
    /// Decodes the frames up to number `from`. Returns the last of them from `to` on, and how many fit in memory; `None` if the video ends
    /// earlier.
    fn pass(&mut self, from: u32, to: u32, talk: &mut Talk) -> Result<Option<(VecDeque<Picture>, u32)>, Trouble> {
        let (mut held, mut length, mut before) = (VecDeque::new(), PIECE.1, None);
        for number in 1..=from {
            if !self.film.advance(number)? {
                return Ok(None);
            }
            let time = self.film.time(before);
            before = time.or(before);
            self.seen.push(Seen { time, hash: self.film.hash()? });
            talk.say(&Reply::Passed { seconds: time })?;
            if number < to {
                continue;
            }
            let picture = self.film.picture(false)?;
            length = u32::try_from(HELD_BYTES / (picture.data.len() as u64).max(1)).unwrap_or(PIECE.1).clamp(PIECE.0, PIECE.1);
            held.push_back(picture);
            while held.len() > length as usize {
                held.pop_front();
            }
        }
        Ok(Some((held, length)))
    }

    /// Decodes frames `first` to `last` again.
    fn fetch(&mut self, first: u32, last: u32) -> Result<VecDeque<Picture>, Trouble> {
        for ahead in AHEAD {
            if first > ahead
                && let Some(piece) = self.fetch_from(first - ahead, first, last)?
            {
                return Ok(piece);
            }
        }
        self.film = Film::open(&self.path)?;
        let piece = self.go_on(0, first, last)?;
        piece.ok_or_else(|| Trouble::Failed("the video was changed while it was read".to_owned()))
    }

    /// Decodes frames `first` to `last` from a key frame before frame `start`; `None` if they differ from the first decoding.
    fn fetch_from(&mut self, start: u32, first: u32, last: u32) -> Result<Option<VecDeque<Picture>>, Trouble> {
        let Some(seconds) = self.seen.get(start as usize - 1).and_then(|seen| seen.time) else { return Ok(None) };
        if !self.film.seek(seconds) || !self.film.advance(start)? {
            return Ok(None);
        }
        let Some(time) = self.film.time(None) else { return Ok(None) };
        // The time identifies the frame; the last ones of a film may have none.
        let here = (1..=first).rev().find(|number| self.seen.get(*number as usize - 1).and_then(|seen| seen.time) == Some(time));
        let Some(here) = here else { return Ok(None) };
        self.go_on(here, first, last)
    }

    /// Continues from frame `here` (0: before the first one) to `last`. Returns the frames from `first` on, if they equal those of the
    /// first decoding.
    fn go_on(&mut self, mut here: u32, first: u32, last: u32) -> Result<Option<VecDeque<Picture>>, Trouble> {
        let mut piece = VecDeque::new();
        loop {
            if here >= first {
                let is_same = match self.seen.get(here as usize - 1) {
                    Some(seen) => seen.hash == self.film.hash()?,
                    None => false,
                };
                if !is_same {
                    return Ok(None);
                }
                piece.push_back(self.film.picture(false)?);
            }
            if here == last {
                return Ok(Some(piece));
            }
            here += 1;
            if !self.film.advance(here)? {
                return Ok(None);
            }
        }
    }
}
