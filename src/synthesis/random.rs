//! Random streams: one for every run, region and frame, so that results depend neither on their order nor on the number of
//! threads.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Returns the generator of one unit of work: frame (32 bits), region (8), run (24).
pub fn generator(seed: u64, frame: usize, region: usize, run: usize) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let part = |value: usize, bits: u32, shift: u32| (value as u64 & ((1 << bits) - 1)) << shift;
    random.set_stream(part(frame, 32, 32) | part(region, 8, 24) | part(run, 24, 0));
    random
}

/// Returns a random number of at least 0 and less than 1, with 53 bits.
pub fn unit(random: &mut impl Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

/// Returns a random integer of at least 0 and less than `bound`, uniform up to 2^-32.
pub fn below(random: &mut impl Rng, bound: usize) -> usize {
    ((u128::from(random.next_u64()) * bound as u128) >> 64) as usize
}

/// Returns `count` different numbers of `0..bound` in uniformly random order; all of them when `count` is larger.
pub fn distinct(random: &mut impl Rng, bound: usize, count: usize) -> Vec<usize> {
    let mut numbers: Vec<usize> = (0..bound).collect();
    let count = count.min(bound);
    for k in 0..count {
        let other = k + below(random, bound - k);
        numbers.swap(k, other);
    }
    numbers.truncate(count);
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_and_repeat() {
        let draw = |f, r, k| generator(7, f, r, k).next_u64();
        assert_eq!(draw(1, 2, 3), draw(1, 2, 3));
        let all = [draw(0, 0, 0), draw(1, 0, 0), draw(0, 1, 0), draw(0, 0, 1)];
        assert!((0..4).all(|a| (0..a).all(|b| all[a] != all[b])));
    }

    #[test]
    fn distinct_numbers_are_a_fair_choice() {
        let mut random = generator(1, 0, 0, 0);
        let mut counts = [0; 10];
        for _ in 0..3000 {
            let three = distinct(&mut random, 10, 3);
            assert!(three[0] != three[1] && three[1] != three[2] && three[0] != three[2]);
            three.iter().for_each(|&k| counts[k] += 1);
        }
        // 900 are expected for each, with a standard deviation of about 25.
        assert!(counts.iter().all(|&c| (800..1000).contains(&c)), "{counts:?}");
        assert_eq!(distinct(&mut random, 2, 3).len(), 2);
    }
}
