//! Nodes that a person can mark in a picture, the precision of such marks, and the most useful order of marking.

use std::sync::LazyLock;

use serde::{Deserialize, de::DeserializeOwned};

use crate::units::{FeaturePoint, NodeId};

const MARKABLE: &str = include_str!("../../candide/markable_nodes.csv");
const SUGGESTED: &str = include_str!("../../candide/suggested_marks.csv");

/// A node at a feature that a person can mark.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkableNode {
    /// The node.
    pub node: NodeId,
    /// Standard deviation of a careful person's mark, in x and in y, as a fraction of the eye distance.
    pub deviation_es: f64,
    /// Description of the feature; left and right are the subject's own.
    pub description: String,
}

/// One of the suggested marks.
#[derive(Clone, Debug, PartialEq)]
pub struct SuggestedMark {
    /// Rank in the order, from 1.
    pub rank: usize,
    /// The node.
    pub node: NodeId,
    /// Its MPEG-4 feature point, if the node alone represents one.
    pub fp: Option<FeaturePoint>,
    /// Error with the marks up to this one, in percent of the eye distance; `None` for fewer than three marks.
    pub error_after: Option<f64>,
    /// Description of the feature.
    pub description: String,
}

/// Returns the rows of an embedded table.
pub(crate) fn embedded_rows<T: DeserializeOwned>(name: &str, text: &str) -> impl Iterator<Item = T> {
    let rows: Result<Vec<T>, _> = csv::Reader::from_reader(text.as_bytes()).into_deserialize().collect();
    rows.unwrap_or_else(|error| unreachable!("embedded table {name}: {error}")).into_iter()
}

/// Returns the nodes that a person can mark, from `candide/markable_nodes.csv`.
pub fn markable_nodes() -> &'static [MarkableNode] {
    #[derive(Deserialize)]
    struct Row {
        node: u16,
        sd_percent_es: f64,
        description: String,
    }
    static NODES: LazyLock<Vec<MarkableNode>> = LazyLock::new(|| {
        let node =
            |r: Row| MarkableNode { node: NodeId(r.node), deviation_es: r.sd_percent_es / 100.0, description: r.description };
        embedded_rows("markable_nodes.csv", MARKABLE).map(node).collect()
    });
    &NODES
}

/// Standard deviation of a careful person's mark at a node, in x and in y, as a fraction of the eye distance; `None` for a node
/// that cannot be marked.
pub(crate) fn mark_deviation(node: NodeId) -> Option<f64> {
    markable_nodes().iter().find(|m| m.node == node).map(|m| m.deviation_es)
}

/// Returns the suggested marks in order, from `candide/suggested_marks.csv`; the first eleven are the default marks.
pub fn suggested_marks() -> &'static [SuggestedMark] {
    #[derive(Deserialize)]
    struct Row {
        rank: usize,
        node: u16,
        fp: String,
        error_after_percent_es: Option<f64>,
        description: String,
    }
    static MARKS: LazyLock<Vec<SuggestedMark>> = LazyLock::new(|| {
        let mark = |r: Row| SuggestedMark {
            rank: r.rank,
            node: NodeId(r.node),
            fp: r.fp.parse().ok(),
            error_after: r.error_after_percent_es,
            description: r.description,
        };
        embedded_rows("suggested_marks.csv", SUGGESTED).map(mark).collect()
    });
    &MARKS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_suggested_can_be_marked_and_is_named_alike() {
        for (k, mark) in suggested_marks().iter().enumerate() {
            assert_eq!(mark.rank, k + 1);
            let markable = markable_nodes().iter().find(|m| m.node == mark.node);
            assert_eq!(markable.map(|m| &m.description), Some(&mark.description));
        }
    }

    #[test]
    fn nodes_are_listed_once() {
        let mut nodes: Vec<_> = markable_nodes().iter().map(|m| m.node).collect();
        nodes.sort_unstable();
        let count = nodes.len();
        nodes.dedup();
        assert_eq!((nodes.len(), markable_nodes()[0].node), (count, NodeId(20)));
    }
}
