//! Enumerates all exchanges of labels between people, if their number is small enough.

/// The different arrangements of labels that are exchanged within blocks of people. Each has a number.
#[derive(Clone, Debug)]
pub(crate) struct Arrangements {
    blocks: Vec<Exchange>,
    people: usize,
    count: usize,
}

/// One block: the indices of its people, the number of people per label, and the number of different arrangements.
#[derive(Clone, Debug)]
struct Exchange {
    places: Vec<usize>,
    labels: Vec<u128>,
    ways: u128,
}

impl Arrangements {
    /// Returns the arrangements of `labels`, or `None` if there are more than `limit`. Each index must be in one of the blocks.
    pub(crate) fn new<'a>(labels: &[usize], blocks: impl IntoIterator<Item = &'a [usize]>, limit: usize) -> Option<Self> {
        let kinds = labels.iter().max().map_or(0, |most| most + 1);
        let mut all = Self { blocks: Vec::new(), people: labels.len(), count: 1 };
        for places in blocks {
            let mut block = Exchange { places: places.to_vec(), labels: vec![0; kinds], ways: 1 };
            places.iter().for_each(|&place| block.labels[labels[place]] += 1);
            let mut placed: u128 = 0;
            for &of_label in &block.labels {
                for k in 1..=of_label {
                    placed += 1;
                    block.ways = block.ways * placed / k;
                    if block.ways > limit as u128 {
                        return None;
                    }
                }
            }
            all.count = usize::try_from(all.count as u128 * block.ways).ok().filter(|count| *count <= limit)?;
            all.blocks.push(block);
        }
        Some(all)
    }

    /// Returns the number of arrangements.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Returns the labels of one arrangement, by person.
    pub(crate) fn nth(&self, number: usize) -> Vec<usize> {
        let mut labels = vec![0; self.people];
        let mut number = number as u128;
        for block in &self.blocks {
            let (mut rank, mut ways) = (number % block.ways, block.ways);
            number /= block.ways;
            let (mut left, mut people) = (block.labels.clone(), block.places.len() as u128);
            for &place in &block.places {
                for (label, of_label) in left.iter_mut().enumerate().filter(|(_, of_label)| **of_label > 0) {
                    // Number of the remaining arrangements that begin with this label.
                    let begin = ways * *of_label / people;
                    if rank < begin {
                        (labels[place], ways) = (label, begin);
                        *of_label -= 1;
                        break;
                    }
                    rank -= begin;
                }
                people -= 1;
            }
        }
        labels
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_arrangement_is_there_once() {
        // Two blocks: 4! / (2! 1! 1!) = 12 ways, and 3! / (2! 1!) = 3.
        let labels = [0, 1, 0, 2, 1, 1, 0];
        let blocks = [vec![0, 2, 3, 4], vec![1, 5, 6]];
        let all = Arrangements::new(&labels, blocks.iter().map(Vec::as_slice), 36).unwrap();
        assert_eq!(all.count(), 36);
        let different: BTreeSet<Vec<usize>> = (0..36).map(|k| all.nth(k)).collect();
        assert!(different.len() == 36 && different.contains(labels.as_slice()));
        for found in &different {
            for block in &blocks {
                let sorted = |of: &[usize]| {
                    let mut labels: Vec<usize> = block.iter().map(|&place| of[place]).collect();
                    labels.sort_unstable();
                    labels
                };
                assert_eq!(sorted(found), sorted(&labels));
            }
        }
        assert!(Arrangements::new(&labels, blocks.iter().map(Vec::as_slice), 35).is_none());
        // 400 people in halves: more ways than any number here holds.
        let many: Vec<usize> = (0..400).map(|i| i % 2).collect();
        assert!(Arrangements::new(&many, [(0..400).collect::<Vec<_>>().as_slice()], usize::MAX).is_none());
    }
}
