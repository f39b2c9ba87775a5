//! Weights by which every person counts equally: the sequences of one person together count as one.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::units::SequenceId;

/// What has equal weight in trimming, median and dispersion: people or sequences.
///
/// ```
/// # use grimace::{model, normalize, units, wireframe};
/// let face = grimace::wireframe::Face::candide3();
/// # let neutral = normalize::Canonical::new(&face.wireframe, &face.tables)?.neutral;
/// # let smile = |subject: &str, up: f64| {
/// #     let frame = |m: usize| {
/// #         let mut nodes = neutral.nodes().to_vec();
/// #         [31, 64].map(|corner| nodes[corner].y += up * m as f64);
/// #         model::FrameExpressionModel::new(nodes)
/// #     };
/// #     let id = units::SequenceId { subject: subject.to_owned(), sequence: "smile".to_owned() };
/// #     let model = model::DynamicExpressionModel::new((0..5).map(frame).collect()).expect("five frames");
/// #     grimace::statistics::SequenceModel { id, model }
/// # };
/// # let label = grimace::statistics::ClassLabel { emotion: "smile".to_owned(), group: Default::default() };
/// use grimace::statistics::{StatisticsOptions, Weighting, representative};
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// // P1 smiled twice.
/// let mut models = vec![smile("P1", 10.0), smile("P1", 11.0), smile("P2", 20.0), smile("P3", 30.0)];
/// models[1].id.sequence = "again".to_owned();
/// let by_person = representative(label.clone(), &models, &face.wireframe, &Default::default())?;
/// let options = StatisticsOptions { weighting: Weighting::Sequence, ..StatisticsOptions::default() };
/// let by_sequence = representative(label, &models, &face.wireframe, &options)?;
/// assert!(by_person.weighted && !by_sequence.weighted);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Weighting {
    /// People: each of a person's n sequences in a class has weight 1 / n.
    #[default]
    Person,
    /// Sequences, as in \[KP\].
    Sequence,
}

/// Returns the weights of sequences, or `None` when all are equal.
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
        // Two sequences each: all weights are equal.
        assert_eq!(sequence_weights(&[id("a", "1"), id("a", "2"), id("b", "1"), id("b", "2")], Weighting::Person), None);
        assert_eq!(sequence_weights(&[], Weighting::Person), None);
    }
}
