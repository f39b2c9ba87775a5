//! Checks of models before their distances are computed: one shape, and displacements that are possible for a face.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{SequenceModel, distance::DisplacementFields, representative::MAX_DISPLACEMENT};
use crate::units::{NodeId, SequenceId};

/// Returns every model's displacement fields over the live nodes, which all of them have, after checking their magnitude.
///
/// # Errors
/// [`NotComparable::Displacement`].
pub(super) fn displacement_fields(models: &[&SequenceModel], live: &[NodeId]) -> Result<Vec<DisplacementFields>, NotComparable> {
    let fields: Vec<_> = models.par_iter().map(|m| DisplacementFields::of_model(&m.model, live)).collect();
    for (m, fields) in models.iter().zip(&fields) {
        if let Some((field, k, found)) = fields.first_beyond(MAX_DISPLACEMENT) {
            return Err(NotComparable::Displacement { id: m.id.clone(), node: live[k], field, found, limit: MAX_DISPLACEMENT });
        }
    }
    Ok(fields)
}

/// Why models cannot be compared.
///
/// ```
/// use grimace::{statistics::NotComparable, units::{NodeId, SequenceId}};
///
/// let id = SequenceId { subject: "P1".to_owned(), sequence: "smile".to_owned() };
/// let error = NotComparable::Node { id, node: NodeId(112), nodes: 68 };
/// assert!(error.to_string().starts_with("P1_smile: it has 68 nodes and therefore no node 112"));
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
pub enum NotComparable {
    /// No nodes to compare.
    #[error("there are no live nodes to compare; give those of the wireframe (`Wireframe::live_nodes`)")]
    NoNodes,
    /// A live node that a model does not have.
    #[error("{id}: it has {nodes} nodes and therefore no node {node}; give the live nodes of the models' own wireframe")]
    Node {
        /// The sequence.
        id: SequenceId,
        /// The live node.
        node: NodeId,
        /// Number of nodes of the model.
        nodes: usize,
    },
    /// Models with another number of displacement vectors.
    #[error(
        "{id}: it has {found} displacement vectors, but the others have {expected}; normalize all sequences with the same options"
    )]
    Shape {
        /// The sequence.
        id: SequenceId,
        /// Number of its vectors.
        found: usize,
        /// Number of vectors of the others.
        expected: usize,
    },
    /// A displacement that is impossible for a face.
    #[error(
        "{id}: node {node} moves by {found} face units from frame {field} to {}; no face moves further than {limit:e}, so the model is wrong",
        field + 1
    )]
    Displacement {
        /// The sequence.
        id: SequenceId,
        /// Live node.
        node: NodeId,
        /// Displacement field, from 0.
        field: usize,
        /// Coordinate of the displacement vector that is too large, face units.
        found: f64,
        /// Limit that magnitudes must stay below.
        limit: f64,
    },
}

/// Returns the displacement fields of models over the live nodes. `expected` is the number of vectors of every model; by default
/// that of the first.
///
/// # Errors
/// [`NotComparable`].
pub(super) fn comparable_fields(
    models: &[&SequenceModel],
    live: &[NodeId],
    expected: Option<usize>,
) -> Result<Vec<DisplacementFields>, NotComparable> {
    if live.is_empty() {
        return Err(NotComparable::NoNodes);
    }
    let vectors = |m: &SequenceModel| (m.model.frame_count() - 1) * live.len();
    let expected = expected.or_else(|| models.first().map(|m| vectors(m))).unwrap_or(0);
    for m in models {
        if let Some(&node) = live.iter().find(|n| n.index() >= m.model.node_count()) {
            return Err(NotComparable::Node { id: m.id.clone(), node, nodes: m.model.node_count() });
        }
        if vectors(m) != expected {
            return Err(NotComparable::Shape { id: m.id.clone(), found: vectors(m), expected });
        }
    }
    displacement_fields(models, live)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;

    use super::*;
    use crate::model::{DynamicExpressionModel, FrameExpressionModel};

    #[test]
    fn models_of_differing_shape_and_impossible_ones_are_named() {
        let model = |name: &str, nodes: usize, frames: usize, x: f64| {
            let frame = |m: usize| FrameExpressionModel::new(vec![Point2::new(x * m as f64, 0.0); nodes]);
            let id = SequenceId { subject: name.to_owned(), sequence: "1".to_owned() };
            SequenceModel { id, model: DynamicExpressionModel::new((0..frames).map(frame).collect()).unwrap() }
        };
        let live = [NodeId(0), NodeId(2)];
        let why = |models: &[&SequenceModel], live: &[NodeId]| comparable_fields(models, live, None).unwrap_err();
        let good = model("a", 3, 3, 1.0);
        assert_eq!(comparable_fields(&[&good, &good], &live, Some(4)).unwrap().len(), 2);
        assert_eq!(why(&[&good], &[]), NotComparable::NoNodes);
        let (short, small, far) = (model("b", 3, 2, 1.0), model("c", 2, 3, 1.0), model("d", 3, 3, 1e300));
        // Two live nodes, from two frames to the next: 4 vectors; from one: 2.
        assert_eq!(why(&[&good, &short], &live), NotComparable::Shape { id: short.id.clone(), found: 2, expected: 4 });
        assert_eq!(why(&[&good, &small], &live), NotComparable::Node { id: small.id.clone(), node: NodeId(2), nodes: 2 });
        let of_far =
            NotComparable::Displacement { id: far.id.clone(), node: NodeId(0), field: 0, found: 1e300, limit: MAX_DISPLACEMENT };
        assert_eq!(why(&[&good, &far], &live), of_far);
    }
}
