//! What a track is made from, as a hash, with and without the frame rate that was given for it.

use crate::track::TrackInfo;

/// BLAKE3 of all that the places of a track's nodes depend on. A frame rate is not among it: another one does not make another track.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Inputs(blake3::Hash);

/// Whose times the frames of a track have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Timed {
    /// Their own, as far as they have some.
    ByThemselves,
    /// Those of a rate that was given.
    ByRate,
}

impl Inputs {
    /// Of the hash of all of them.
    pub fn new(hash: blake3::Hash) -> Self {
        Self(hash)
    }

    /// BLAKE3 of everything that a track and its times depend on: with the rate that was given, frames per second, where one was.
    pub fn with_rate(&self, fps: Option<f64>) -> String {
        let Some(fps) = fps else { return self.0.to_hex().to_string() };
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.0.as_bytes()).update(&fps.to_le_bytes());
        hasher.finalize().to_hex().to_string()
    }

    /// Whose times a track has that was made from these inputs; `None` where it was made from others.
    pub fn timing_of(&self, info: &TrackInfo) -> Option<Timed> {
        let is_with = |fps| self.with_rate(fps) == info.inputs_blake3;
        match info.fps {
            _ if is_with(None) => Some(Timed::ByThemselves),
            Some(fps) if is_with(Some(fps)) => Some(Timed::ByRate),
            _ => None,
        }
    }
}
