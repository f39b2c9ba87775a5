//! Hash of a track's inputs, with and without a given frame rate.

use crate::track::TrackInfo;

/// BLAKE3 of everything that the node positions of a track depend on. The frame rate is excluded, because it does not change positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Inputs(blake3::Hash);

/// Source of the times of a track's frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Timed {
    /// The frames' own times, if any.
    ByThemselves,
    /// A given frame rate.
    ByRate,
}

impl Inputs {
    /// From the hash of all inputs.
    pub fn new(hash: blake3::Hash) -> Self {
        Self(hash)
    }

    /// BLAKE3 of everything that a track and its times depend on. It includes the given rate `fps`, frames per second, if any.
    pub fn with_rate(&self, fps: Option<f64>) -> String {
        let Some(fps) = fps else { return self.0.to_hex().to_string() };
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.0.as_bytes()).update(&fps.to_le_bytes());
        hasher.finalize().to_hex().to_string()
    }

    /// The source of the times of a track made from these inputs; `None` if it was made from others.
    pub fn timing_of(&self, info: &TrackInfo) -> Option<Timed> {
        let is_with = |fps| self.with_rate(fps) == info.inputs_blake3;
        match info.fps {
            _ if is_with(None) => Some(Timed::ByThemselves),
            Some(fps) if is_with(Some(fps)) => Some(Timed::ByRate),
            _ => None,
        }
    }
}
