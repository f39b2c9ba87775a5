//! Tracks without corrections, by which corrections are judged as in `run`.

use std::{
    collections::BTreeMap,
    sync::{Mutex, PoisonError},
};

use super::RequestError;
use crate::track::TrackedFrame;

/// The needed frames of every requested sequence, from the neutral one on.
#[derive(Default)]
pub struct Untouched(Mutex<BTreeMap<String, Sequence>>);

struct Sequence {
    /// Hash of its track's inputs; a track with the same name and other inputs is tracked anew.
    inputs_blake3: String,
    frames: Vec<TrackedFrame>,
}

impl Untouched {
    /// Frames 0 to `last` of a sequence. `known` are uncorrected frames from the first on, at least the neutral one. `track` computes the
    /// following frames up to `last` from the existing ones.
    ///
    /// # Errors
    /// Those of `track`.
    pub fn frames(
        &self,
        id: &str,
        inputs_blake3: &str,
        known: &[TrackedFrame],
        last: usize,
        track: impl FnOnce(&[TrackedFrame]) -> Result<Vec<TrackedFrame>, RequestError>,
    ) -> Result<Vec<TrackedFrame>, RequestError> {
        // Other sequences do not wait for this one.
        let sequences = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = sequences().remove(id).filter(|kept| kept.inputs_blake3 == inputs_blake3).map(|kept| kept.frames);
        let mut frames = kept.filter(|kept| kept.len() >= known.len()).unwrap_or_else(|| known.to_vec());
        if frames.len() <= last {
            let behind = track(&frames)?;
            frames.extend(behind);
        }
        let asked = frames.iter().take(last + 1).cloned().collect();
        sequences().insert(id.to_owned(), Sequence { inputs_blake3: inputs_blake3.to_owned(), frames });
        Ok(asked)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_frames_that_are_not_known_are_tracked() {
        let numbered =
            |numbers: &[u32]| numbers.iter().map(|&number| TrackedFrame { number, nodes: Vec::new() }).collect::<Vec<_>>();
        let untouched = Untouched::default();
        let asked = |inputs: &str, known: &[u32], last: usize, tracked: &[u32]| {
            let mut seen = None;
            let frames = untouched.frames("S_1", inputs, &numbered(known), last, |frames| {
                seen = Some(frames.len());
                Ok(numbered(tracked))
            });
            (frames.unwrap().len(), seen)
        };
        assert_eq!(asked("a", &[1, 2], 2, &[3]), (3, Some(2)));
        assert_eq!(asked("a", &[1], 2, &[]), (3, None));
        assert_eq!(asked("a", &[1], 4, &[4, 5]), (5, Some(3)));
        assert_eq!(asked("a", &[1], 1, &[]), (2, None));
        // A run with other options has tracked it since.
        assert_eq!(asked("b", &[1], 1, &[2]), (2, Some(1)));
    }
}
