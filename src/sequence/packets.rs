//! Reads frame times from a video's container without decoding.
//!
//! A decoder skips undecodable frames silently, and the following frames would get wrong numbers. A gap in the times of frames may come
//! from the camera, or from a frame that is in the file but was lost in decoding. The container distinguishes the two.

mod avi;
mod matroska;
mod mp4;
mod webm;

use std::{io::Read, path::Path};

pub(super) use self::{avi::Walk, webm::set_random_numbers};

/// Largest difference between the times of a frame and its packet, s: containers and OpenCV round to milliseconds.
const ROUNDED: f64 = 2e-3;
/// Smallest distance of another frame's packet from both adjacent frames, as a share of the usual frame distance. A frame may have two
/// packets (fields, and pictures that only help to decode others), which are closer.
const APART: f64 = 0.75;
/// Largest number of packets: 38 hours at 72 frames per second.
const MOST_PACKETS: usize = 10_000_000;

/// Times of the picture packets of a video, and of damage in the container.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Packets {
    /// Seconds, ascending.
    times: Vec<f64>,
    /// Possible times of the first frame in `times`.
    origins: Vec<f64>,
    /// Time of the last packet before each damaged place in the container.
    breaks: Vec<f64>,
    /// Number of pictures that are shown, if the container lists all of them: an MP4 whose beginning or end was cut off without decoding
    /// keeps the pictures there.
    shown: Option<usize>,
}

impl Packets {
    /// Reads the container; `None` for an unsupported kind or missing times. For AVI, it continues the given walk.
    pub(super) fn of(path: &Path, walk: Option<&mut Walk>) -> Option<Self> {
        let mut packets = match Container::of(path)? {
            Container::Avi => walk?.packets().ok().flatten()?,
            Container::Matroska => matroska::read(path).ok()?,
            Container::Mp4 => mp4::read(path).ok().flatten()?,
        };
        packets.times.sort_by(f64::total_cmp);
        Some(packets)
    }

    /// Number of pictures that the container lists to be shown, if it lists them.
    pub(super) fn shown(&self) -> Option<usize> {
        self.shown
    }

    /// Time of the first picture, s: the clock of a container may have run before.
    pub(super) fn start(&self) -> f64 {
        self.origins.iter().copied().fold(f64::INFINITY, f64::min).max(0.0)
    }

    /// Whether a frame was lost between two consecutive ones, with times in seconds from the first frame. Frames are `usual` seconds apart.
    /// If unknown, the answer is no.
    pub(super) fn lose(&self, from: f64, to: f64, usual: f64) -> bool {
        let has = |time: f64| {
            let place = self.times.partition_point(|other| *other < time - ROUNDED);
            self.times.get(place).is_some_and(|other| *other <= time + ROUNDED)
        };
        let origin = self.origins.iter().find(|&&origin| has(origin + from) && has(origin + to));
        origin.is_some_and(|origin| {
            let (from, to) = (origin + from, origin + to);
            let is_between = |time: &f64| *time > from + APART * usual && *time < to - APART * usual;
            self.times.iter().any(is_between) || self.breaks.iter().any(|time| (from - ROUNDED..to - ROUNDED).contains(time))
        })
    }
}

/// Returns the walk that detects damage in a video's container, for formats whose times are unreliable after damage.
pub(super) fn walk(path: &Path) -> Option<Walk> {
    match Container::of(path)? {
        Container::Avi => Walk::of(path).ok(),
        Container::Matroska | Container::Mp4 => None,
    }
}

enum Container {
    Avi,
    Matroska,
    Mp4,
}

impl Container {
    fn of(path: &Path) -> Option<Self> {
        let mut begin = [0; 12];
        crate::input::open_file(path).and_then(|mut file| file.read_exact(&mut begin)).ok()?;
        match (&begin[..4], &begin[4..8], &begin[8..]) {
            (b"RIFF", _, b"AVI ") => Some(Self::Avi),
            ([0x1A, 0x45, 0xDF, 0xA3], ..) => Some(Self::Matroska),
            (_, b"ftyp", _) => Some(Self::Mp4),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_of_the_camera_is_none_of_the_file() {
        // 25 frames per second from 2 s on; the camera left out 2.12.
        let times: Vec<f64> = [0, 1, 2, 4, 5, 6, 7].map(|k| 2.0 + 0.04 * f64::from(k)).to_vec();
        let whole = Packets { times, origins: vec![0.0, 2.0], ..Packets::default() };
        assert!(!whole.lose(0.08, 0.16, 0.04));
        // 2.20 was lost; missing times give no answer.
        assert!(whole.lose(0.16, 0.24, 0.04));
        assert!(!whole.lose(0.17, 0.25, 0.04));
        // A second field between two frames is not a frame.
        let mut fields = whole.clone();
        fields.times.insert(3, 2.10);
        assert!(!fields.lose(0.08, 0.16, 0.04));
        let broken = Packets { breaks: vec![2.08], ..whole };
        assert!(broken.lose(0.08, 0.16, 0.04) && !broken.lose(0.04, 0.08, 0.04) && !broken.lose(0.16, 0.2, 0.04));
    }
}
