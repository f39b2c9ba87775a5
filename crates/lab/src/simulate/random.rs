//! Independent random streams, one for every unit of work, so that results depend neither on the order of the work nor on the number of
//! threads.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// The purpose of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Shape units of a subject.
    Shape = 1,
    /// Colours and surface of a subject.
    Appearance = 2,
    /// Strength and asymmetry of one expression.
    Expression = 3,
    /// Head motion of one sequence.
    Motion = 4,
    /// Pixel noise of one frame.
    Noise = 5,
    /// Errors of the marks of one sequence.
    Marks = 6,
    /// Light of one sequence.
    Light = 7,
    /// Whether and when a sequence has a blink.
    Blink = 8,
    /// Events of a recording.
    Recording = 9,
}

/// Returns the generator of one unit of work: purpose, subject (less than 2^24), emotion code and frame.
pub fn generator(seed: u64, purpose: Purpose, subject: u32, emotion_code: u8, frame: u32) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let part = |value: u64, bits: u32, shift: u32| (value & ((1 << bits) - 1)) << shift;
    let frame = part(frame.into(), 28, 0);
    random.set_stream(frame | part(emotion_code.into(), 4, 28) | part(subject.into(), 24, 32) | part(purpose as u64, 8, 56));
    random
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;

    #[test]
    fn every_unit_of_work_has_its_own_stream() {
        let base = (3, Purpose::Noise, 2, 5, 9);
        let first = |(seed, purpose, subject, code, frame)| generator(seed, purpose, subject, code, frame).next_u64();
        let others = [
            (4, Purpose::Noise, 2, 5, 9),
            (3, Purpose::Marks, 2, 5, 9),
            (3, Purpose::Noise, 3, 5, 9),
            (3, Purpose::Noise, 2, 6, 9),
            (3, Purpose::Noise, 2, 5, 10),
        ];
        assert_eq!(first(base), first(base));
        assert!(others.iter().all(|&other| first(other) != first(base)));
    }
}
