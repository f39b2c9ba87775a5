//! The greedy generalized median [KP, section 4.4].
//!
//! The search starts at the set median. It repeatedly replaces the one displacement vector whose replacement lowers the sum of distances
//! most, until no replacement lowers it noticeably. \[KP\] leave two choices open:
//!
//! - The replacement of a slot is the better of two vectors: that of the member with the smallest sum in the slot, and the Weiszfeld step
//!   from the current vector (also with nearly equal vectors treated as one). The first allows large moves, the second leaves the
//!   members' vectors.
//! - After trimming at frame level each field has its own members. The set median at the start is therefore taken field by field: the
//!   field of the kept model with the smallest sum of distances `d_f` to the other kept ones.

use std::{cmp::Ordering, collections::BinaryHeap};

use nalgebra::Vector2;
use rayon::prelude::*;

use super::{Median, PointSet, SearchEnding, Slots};

/// Stopping conditions of the greedy search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GreedyOptions {
    /// Smallest gain of a replacement, as a share of the sum of distances at the start.
    pub gain_tolerance: f64,
    /// Largest number of replacements per slot, on average.
    pub max_replacements_per_slot: usize,
}

impl Default for GreedyOptions {
    fn default() -> Self {
        Self { gain_tolerance: 1e-10, max_replacements_per_slot: 1000 }
    }
}

/// The search state of one displacement vector.
struct Slot<'a> {
    points: PointSet<'a>,
    current: Vector2<f64>,
    sum: f64,
    best_member: (Vector2<f64>, f64),
}

impl<'a> Slot<'a> {
    fn new(points: PointSet<'a>, current: Vector2<f64>) -> Self {
        let (member, least) = points.best_member();
        Self { points, current, sum: points.evaluate(current).sum, best_member: (points.points()[member], least) }
    }

    /// Returns the vector that lowers the slot's sum most, and that sum.
    fn best_replacement(&self) -> (Vector2<f64>, f64) {
        let here = self.points.evaluate(self.current);
        let mut best = self.best_member;
        for step in std::iter::once(here.weiszfeld_step()).chain(self.points.cluster_steps(self.current, &here)) {
            let sum = self.points.evaluate(self.current + step).sum;
            if sum < best.1 {
                best = (self.current + step, sum);
            }
        }
        best
    }
}

/// A replacement in the queue. Larger gains come first; of equal gains, the lower slot index.
struct Replacement {
    gain: f64,
    slot: usize,
    vector: Vector2<f64>,
    sum: f64,
}

impl Replacement {
    fn of(index: usize, slot: &Slot) -> Self {
        let (vector, sum) = slot.best_replacement();
        Self { gain: slot.sum - sum, slot: index, vector, sum }
    }
}

impl Ord for Replacement {
    fn cmp(&self, other: &Self) -> Ordering {
        self.gain.total_cmp(&other.gain).then(other.slot.cmp(&self.slot))
    }
}

impl PartialOrd for Replacement {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Replacement {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Replacement {}

/// Returns the greedy generalized median, starting from one vector per slot.
///
/// A queue holds the best replacement of every slot. A replacement changes the gain of its own slot only, so each replacement costs one
/// pass over that slot's points.
///
/// # Panics
/// If `start` does not have one vector per slot (a programmer's error).
pub fn greedy_median(slots: &Slots, start: &[Vector2<f64>], options: &GreedyOptions) -> Median {
    assert_eq!(start.len(), slots.len(), "a start vector for every slot");
    let mut search: Vec<Slot> =
        (0..slots.len()).into_par_iter().map(|index| Slot::new(slots.points(index), start[index])).collect();
    let least_gain = least_gain(&search, options);
    let mut queue: BinaryHeap<_> =
        search.par_iter().enumerate().map(|(index, slot)| Replacement::of(index, slot)).collect::<Vec<_>>().into();
    let limit = options.max_replacements_per_slot.saturating_mul(slots.len());
    let mut iterations = 0;
    let mut ending = SearchEnding::Converged;
    while let Some(Replacement { slot: index, vector, sum, .. }) = queue.pop().filter(|best| best.gain > least_gain) {
        if iterations == limit {
            ending = SearchEnding::IterationLimit;
            break;
        }
        let slot = &mut search[index];
        (slot.current, slot.sum) = (vector, sum);
        queue.push(Replacement::of(index, slot));
        iterations += 1;
    }
    Median {
        vectors: search.iter().map(|slot| slot.current).collect(),
        sums: search.iter().map(|slot| slot.points.sum_of_distances(slot.current)).collect(),
        lower_bounds: vec![0.0; slots.len()],
        iterations,
        ending,
    }
}

/// Returns the gain below which the search stops, in the points' unit.
fn least_gain(search: &[Slot], options: &GreedyOptions) -> f64 {
    options.gain_tolerance * search.iter().map(|slot| slot.sum).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::{
        super::{ExactOptions, exact_median},
        *,
    };
    use crate::statistics::distance::{DisplacementFields, tests::vectors};

    fn slots(values: &[Vector2<f64>], nodes: usize, fields: usize) -> Slots {
        let models: Vec<_> = values.chunks(nodes * fields).map(|v| DisplacementFields::from_vectors(nodes, v)).collect();
        Slots::new(&models, &vec![(0..models.len()).collect(); fields], None)
    }

    /// The search as \[KP\] describe it: all slots are searched before every replacement.
    fn naive(slots: &Slots, start: &[Vector2<f64>], options: &GreedyOptions) -> (Vec<Vector2<f64>>, usize) {
        let mut search: Vec<Slot> = start.iter().enumerate().map(|(index, &v)| Slot::new(slots.points(index), v)).collect();
        let least_gain = least_gain(&search, options);
        for iterations in 0.. {
            let replacements = search.iter().enumerate().map(|(index, slot)| Replacement::of(index, slot));
            let best = replacements.max().unwrap();
            if best.gain <= least_gain || iterations == options.max_replacements_per_slot * slots.len() {
                return (search.iter().map(|slot| slot.current).collect(), iterations);
            }
            (search[best.slot].current, search[best.slot].sum) = (best.vector, best.sum);
        }
        unreachable!()
    }

    #[test]
    fn the_middle_of_three_on_a_line_is_one_replacement_away() {
        // Sums on the line: 12 at 0, 11 at 1, 21 at 11. From 11 the best member, 1, gains 10; no further replacement gains.
        let line = [0.0, 1.0, 11.0].map(|x| Vector2::new(x, 0.0));
        let median = greedy_median(&slots(&line, 1, 1), &[line[2]], &GreedyOptions::default());
        assert_eq!((median.vectors, median.sums), (vec![line[1]], vec![11.0]));
        assert_eq!((median.iterations, median.ending), (1, SearchEnding::Converged));
    }

    #[test]
    fn the_answer_is_not_confined_to_members() {
        // Corners of a square: the centre has the sum 4 sqrt 2, any corner 2 + 2 + 2 sqrt 2.
        let square = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)].map(|(x, y)| Vector2::new(x, y));
        let median = greedy_median(&slots(&square, 1, 1), &square[..1], &GreedyOptions::default());
        approx::assert_relative_eq!(median.sums[0], 32f64.sqrt(), max_relative = 1e-8);
    }

    #[test]
    fn a_still_face_needs_no_replacement() {
        let median = greedy_median(&slots(&[Vector2::zeros(); 12], 2, 2), &[Vector2::zeros(); 4], &GreedyOptions::default());
        assert_eq!((median.sums, median.iterations, median.ending), (vec![0.0; 4], 0, SearchEnding::Converged));
    }

    proptest! {
        #[test]
        fn the_queue_replaces_in_the_order_of_the_naive_search(values in vectors(6 * 8), limit in 0..12usize) {
            let slots = slots(&values, 4, 2);
            // The limit stops both at the same replacement: the order is the same, not only the end.
            let options = GreedyOptions { max_replacements_per_slot: limit, ..GreedyOptions::default() };
            let queued = greedy_median(&slots, &values[..8], &options);
            prop_assert_eq!((queued.vectors, queued.iterations), naive(&slots, &values[..8], &options));
        }

        #[test]
        fn greedy_is_close_to_exact_and_never_below_its_bound(values in vectors(15 * 6)) {
            let slots = slots(&values, 3, 2);
            let greedy = greedy_median(&slots, &values[..6], &GreedyOptions::default());
            let exact = exact_median(&slots, &ExactOptions::default());
            prop_assert_eq!(greedy.ending, SearchEnding::Converged);
            prop_assert!(slots.total(&exact.lower_bounds) <= slots.total(&greedy.sums));
            prop_assert!(slots.total(&greedy.sums) <= slots.total(&exact.sums) * 1.001);
        }
    }
}
