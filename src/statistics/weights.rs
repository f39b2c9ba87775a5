//! One person, one weight: sequences of people who have several count as one person together.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::units::SequenceId;

/// What has the same weight in trimming, median and dispersion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Weighting {
    /// Every person: each of a person's n sequences in a class counts 1 / n.
    #[default]
    Person,
    /// Every sequence, as in \[KP\].
    Sequence,
}

/// The weights of sequences; `None` where all are equal.
pub fn sequence_weights<'a>(ids: impl IntoIterator<Item = &'a SequenceId> + Clone, weighting: Weighting) -> Option<Vec<f64>> {
    if weighting == Weighting::Sequence {
        return None;
    }
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    ids.clone().into_iter().for_each(|id| *counts.entry(&id.subject).or_default() += 1);
    let mut sizes = counts.values();
    let first = sizes.next()?;
    if sizes.all(|size| size == first) {
        return None;
    }
    Some(ids.into_iter().map(|id| 1.0 / counts[id.subject.as_str()] as f64).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sequences_of_a_person_share_one_weight() {
        let id = |subject: &str, sequence: &str| SequenceId { subject: subject.to_owned(), sequence: sequence.to_owned() };
        let ids = [id("a", "1"), id("a", "2"), id("b", "1")];
        assert_eq!(sequence_weights(&ids, Weighting::Person), Some(vec![0.5, 0.5, 1.0]));
        assert_eq!(sequence_weights(&ids, Weighting::Sequence), None);
        // Two each: nobody weighs more than another.
        assert_eq!(sequence_weights(&[id("a", "1"), id("a", "2"), id("b", "1"), id("b", "2")], Weighting::Person), None);
        assert_eq!(sequence_weights(&[], Weighting::Person), None);
    }
}
