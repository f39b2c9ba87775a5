//! The null distribution: the energy distance for other splits of the same people.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::{
    CompareOptions,
    arrangements::Arrangements,
    mean,
    pairs::{Energy, PairDistances},
    strata::Block,
};

/// Number of splits per unit of work. Every unit has its own random stream.
const CHUNK: usize = 64;

/// Relative difference of two energies that counts as rounding error: sums of the same distances in another order.
const ROUNDING: f64 = 1e-10;

/// Between whom labels are exchanged.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Design {
    /// Between all people.
    Free,
    /// Within strata.
    Strata(Vec<Block>),
}

impl Design {
    /// Returns the first group of a random split of `people`, ascending.
    fn split(&self, people: usize, size: usize, random: &mut ChaCha8Rng) -> Vec<usize> {
        let mut chosen = match self {
            Self::Free => return subset(people, size, random),
            Self::Strata(blocks) => {
                let of_block = |(places, first): &Block| {
                    subset(places.len(), *first, random).into_iter().map(|k| places[k]).collect::<Vec<_>>()
                };
                blocks.iter().flat_map(of_block).collect::<Vec<usize>>()
            }
        };
        chosen.sort_unstable();
        chosen
    }

    /// Returns the approximate number of splits.
    fn splits(&self) -> f64 {
        let choose = |n: usize, k: usize| (0..k.min(n - k)).fold(1.0, |c, i| c * (n - i) as f64 / (i + 1) as f64);
        match self {
            Self::Free => f64::INFINITY,
            Self::Strata(blocks) => blocks.iter().map(|(places, first)| choose(places.len(), *first)).product(),
        }
    }

    /// Returns the first groups, ascending, of all splits of `people`, or `None` if there are more than `limit`.
    fn all_splits(&self, people: usize, size: usize, limit: usize) -> Option<Vec<Vec<usize>>> {
        let everybody = [((0..people).collect(), size)];
        let blocks: &[Block] = match self {
            Self::Free => &everybody,
            Self::Strata(blocks) => blocks,
        };
        let mut labels = vec![1; people];
        blocks.iter().flat_map(|(places, first)| &places[..*first]).for_each(|&place| labels[place] = 0);
        let all = Arrangements::new(&labels, blocks.iter().map(|(places, _)| places.as_slice()), limit)?;
        let first = |labels: Vec<usize>| (0..people).filter(|&place| labels[place] == 0).collect();
        Some((0..all.count()).map(|k| first(all.nth(k))).collect())
    }

    /// Returns whether every split occurs twice, as itself and as its complement: both groups have equal size in every block.
    fn has_twins(&self, people: usize, size: usize) -> bool {
        match self {
            Self::Free => 2 * size == people,
            Self::Strata(blocks) => blocks.iter().all(|(places, first)| 2 * first == places.len()),
        }
    }
}

/// Results of the splits.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Permuted {
    /// Number of splits with an energy at least as large as the observed one.
    pub at_least: usize,
    /// H of every split.
    pub effects: Vec<f64>,
    /// Smallest possible p.
    pub least_p: f64,
    /// p value of every node, corrected for the number of nodes.
    pub node_p: Vec<f64>,
    /// Number of splits tried.
    pub permutations: usize,
    /// Whether these are all possible splits.
    pub exhaustive: bool,
}

/// Returns the random numbers of one use: comparison, purpose (0 and 1 draws of people, 2 splits), unit of work.
pub(super) fn generator(seed: u64, stream: u32, purpose: u64, unit: u64) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream((u64::from(stream) << 32) | (purpose << 24) | (unit & 0x00ff_ffff));
    random
}

/// Returns the indices of the people used from a group of `count`, ascending: all, or a random subset of the largest size allowed.
pub(crate) fn draw(count: usize, options: &CompareOptions, stream: u32, group: u64) -> Vec<usize> {
    let wanted = options.people.max(super::LEAST_PEOPLE);
    if count <= wanted {
        return (0..count).collect();
    }
    subset(count, wanted, &mut generator(options.seed, stream, group, 0))
}

/// Returns a random subset of `size` of `count` indices, ascending, each subset with equal probability.
fn subset(count: usize, size: usize, random: &mut ChaCha8Rng) -> Vec<usize> {
    let mut places: Vec<usize> = (0..count).collect();
    for k in 0..size {
        let other = random.random_range(k..count);
        places.swap(k, other);
    }
    places.truncate(size);
    places.sort_unstable();
    places
}

/// Computes the energy for other splits into a group of `first` people and the rest.
pub(super) fn permute(
    distances: &PairDistances,
    first: usize,
    observed: &Energy,
    options: &CompareOptions,
    design: &Design,
    stream: u32,
) -> Permuted {
    let (n, wanted) = (distances.people(), options.permutations.max(1));
    // Sums over the smaller group are cheaper; E is the same for both.
    let size = if *design == Design::Free { first.min(n - first) } else { first };
    let all = design.all_splits(n, size, wanted);
    let exhaustive = all.is_some();
    let energies: Vec<(f64, Energy)> = match all {
        Some(splits) => splits.par_iter().map(|split| distances.energy(split)).map(|e| (e.effect(), e)).collect(),
        None => (0..wanted.div_ceil(CHUNK))
            .into_par_iter()
            .flat_map_iter(|unit| {
                let mut random = generator(options.seed, stream, 2, unit as u64);
                let count = CHUNK.min(wanted - unit * CHUNK);
                (0..count).map(move |_| distances.energy(&design.split(n, size, &mut random))).map(|e| (e.effect(), e))
            })
            .collect(),
    };
    let permutations = energies.len();
    let slack = ROUNDING * observed.between.abs();
    let total = mean(&observed.nodes);
    let at_least = energies.iter().filter(|(_, e)| mean(&e.nodes) >= total - slack).count();
    let node_p = node_p(distances.nodes(), observed, &energies, exhaustive);
    let twins = if design.has_twins(n, size) { 2.0 } else { 1.0 };
    let least_p = if exhaustive {
        (twins / permutations as f64).min(1.0)
    } else {
        (1.0 / (1 + permutations) as f64).max(1.0 / design.splits())
    };
    Permuted {
        at_least,
        effects: energies.into_iter().map(|(effect, _)| effect).collect(),
        least_p,
        node_p,
        permutations,
        exhaustive,
    }
}

/// Returns the p value of every node from the largest standardized `E_k` of each split.
fn node_p(nodes: usize, observed: &Energy, energies: &[(f64, Energy)], exhaustive: bool) -> Vec<f64> {
    // The observed split is one of the possible ones, so it enters mean and deviation as well. Without it, it alone would be standardized
    // by numbers that exclude it, and be too large too often with few permutations.
    let extra = (!exhaustive).then_some(observed);
    let splits = || energies.iter().map(|(_, energy)| energy).chain(extra);
    let count = splits().count() as f64;
    let (mut means, mut deviations) = (vec![0.0; nodes], vec![0.0; nodes]);
    for energy in splits() {
        means.iter_mut().zip(&energy.nodes).for_each(|(sum, e)| *sum += e / count);
    }
    for energy in splits() {
        deviations.iter_mut().zip(&means).zip(&energy.nodes).for_each(|((sum, mean), e)| *sum += (e - mean).powi(2) / count);
    }
    let score = |k: usize, e: f64| if deviations[k] > 0.0 { (e - means[k]) / deviations[k].sqrt() } else { 0.0 };
    let largest: Vec<f64> = energies
        .iter()
        .map(|(_, energy)| energy.nodes.iter().enumerate().map(|(k, &e)| score(k, e)).fold(f64::NEG_INFINITY, f64::max))
        .collect();
    (0..nodes)
        .map(|k| {
            let here = score(k, observed.nodes[k]);
            let at_least = largest.iter().filter(|&&largest| largest >= here - 1e-9).count();
            (at_least + usize::from(!exhaustive)) as f64 / count
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_splits_come_once_in_order() {
        let splits = Design::Free.all_splits(4, 2, 6).unwrap();
        assert_eq!(splits, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]);
        // 90 over 10 is about 5.7e12; 4 over 2 is 6.
        assert!(Design::Free.all_splits(4, 2, 5).is_none() && Design::Free.all_splits(90, 10, 9999).is_none());
        assert!(Design::Free.all_splits(1000, 500, usize::MAX).is_none());
    }

    #[test]
    fn drawn_subsets_are_of_different_places_and_even() {
        let mut random = generator(1, 0, 2, 0);
        let mut counts = [0; 10];
        for _ in 0..10_000 {
            let subset = subset(10, 3, &mut random);
            assert!(subset.windows(2).all(|pair| pair[0] < pair[1]) && subset.len() == 3);
            subset.iter().for_each(|&k| counts[k] += 1);
        }
        // 3000 expected each; the standard deviation is sqrt(10000 * 0.3 * 0.7) = 46.
        assert!(counts.iter().all(|count| (2770..3230).contains(count)), "{counts:?}");
    }
}
