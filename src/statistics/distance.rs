//! Distances between displacement vectors, frame models and dynamic models [KP, eq. (2) to (5)].
//!
//! Symbols: N live nodes, N' frames per model. Only live nodes count; followers repeat their leaders and would give them double weight.
//! All machines give identical bits: square roots are IEEE square roots of plain sums of squares, and sums have a fixed order.

use nalgebra::Vector2;

use crate::{
    model::DynamicExpressionModel,
    units::{NodeId, Unit},
};

/// Number of partial sums kept in parallel by [`DisplacementFields::frame_distance`], for vector instructions.
const LANES: usize = 4;

/// Distance `d_v` of two displacement vectors [KP, eq. (3)], in their unit.
///
/// ```
/// use grimace::internal::statistics::distance::vector_distance;
/// use nalgebra::Vector2;
///
/// assert_eq!(vector_distance(Vector2::new(1.0, 1.0), Vector2::new(4.0, 5.0)), 5.0);
/// ```
pub fn vector_distance(a: Vector2<f64>, b: Vector2<f64>) -> f64 {
    length(a.x - b.x, a.y - b.y)
}

/// Length of a vector. It uses only correctly rounded operations; `hypot` differs between platforms.
#[inline]
pub(crate) fn length(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

/// The displacement vectors tau of one dynamic model [KP, eq. (2)]: (N' - 1) fields of N live nodes, stored flat and by coordinate.
#[derive(Clone, Debug, PartialEq)]
pub struct DisplacementFields {
    node_count: usize,
    x: Vec<f64>,
    y: Vec<f64>,
}

impl DisplacementFields {
    /// Computes the displacement fields of a model over its live nodes.
    ///
    /// # Panics
    /// If the model lacks a live node or there is none (a programmer's error: the caller checks shapes).
    pub fn of_model<U: Unit>(model: &DynamicExpressionModel<U>, live: &[NodeId]) -> Self {
        let fields = (0..model.frame_count() - 1).map(|m| model.displacement_field(m));
        let vectors: Vec<_> = fields.flat_map(|field| live.iter().map(move |n| field[n.index()]).collect::<Vec<_>>()).collect();
        Self::from_vectors(live.len(), &vectors)
    }

    /// Makes fields from vectors in slot order: field 0 of all nodes, then field 1, and so on.
    ///
    /// # Panics
    /// If `node_count` is 0 or the vectors do not fill whole fields of as many nodes (a programmer's error).
    pub fn from_vectors(node_count: usize, vectors: &[Vector2<f64>]) -> Self {
        assert!(
            node_count > 0 && vectors.len().is_multiple_of(node_count),
            "{} vectors do not fill fields of {node_count}",
            vectors.len()
        );
        Self { node_count, x: vectors.iter().map(|v| v.x).collect(), y: vectors.iter().map(|v| v.y).collect() }
    }

    /// Returns the number of displacement fields, N' - 1.
    pub fn field_count(&self) -> usize {
        self.x.len() / self.node_count
    }

    /// Returns the number of live nodes N.
    pub fn node_count(&self) -> usize {
        self.node_count
    }

    /// Returns the vector tau of field `m` at the `k`-th live node.
    ///
    /// # Panics
    /// If there is no such slot (a programmer's error).
    #[inline]
    pub fn vector(&self, m: usize, k: usize) -> Vector2<f64> {
        let slot = m * self.node_count + k;
        Vector2::new(self.x[slot], self.y[slot])
    }

    /// Distance `d_f` of two models' m-th displacement fields [KP, eq. (4)], in the models' unit.
    ///
    /// # Panics
    /// If the shapes differ or there is no field `m` (a programmer's error).
    pub fn frame_distance(&self, other: &Self, m: usize) -> f64 {
        assert_eq!(self.node_count, other.node_count, "fields over different nodes");
        let n = self.node_count;
        let range = m * n..(m + 1) * n;
        let sum = sum_of_lengths(&self.x[range.clone()], &self.y[range.clone()], &other.x[range.clone()], &other.y[range]);
        sum / n as f64
    }

    /// Distance `d` of two dynamic models [KP, eq. (5)], in the models' unit.
    ///
    /// # Panics
    /// If the shapes differ (a programmer's error).
    pub fn distance(&self, other: &Self) -> f64 {
        let fields = self.field_count();
        (0..fields).map(|m| self.frame_distance(other, m)).sum::<f64>() / fields as f64
    }

    /// Returns field, live node and value of the first coordinate whose magnitude is not below `limit`.
    pub(crate) fn first_beyond(&self, limit: f64) -> Option<(usize, usize, f64)> {
        let slot = (0..self.x.len()).find(|&s| !(self.x[s].abs() < limit && self.y[s].abs() < limit))?;
        let value = if self.x[slot].abs() < limit { self.y[slot] } else { self.x[slot] };
        Some((slot / self.node_count, slot % self.node_count, value))
    }
}

/// Sum of `|a - b|`, in [`LANES`] interleaved partial sums that are added in a fixed order.
fn sum_of_lengths(ax: &[f64], ay: &[f64], bx: &[f64], by: &[f64]) -> f64 {
    let mut lanes = [0.0; LANES];
    let chunks = (ax.chunks_exact(LANES).zip(ay.chunks_exact(LANES))).zip(bx.chunks_exact(LANES).zip(by.chunks_exact(LANES)));
    for ((ax, ay), (bx, by)) in chunks {
        for lane in 0..LANES {
            lanes[lane] += length(ax[lane] - bx[lane], ay[lane] - by[lane]);
        }
    }
    let rest: f64 = (ax.len() - ax.len() % LANES..ax.len()).map(|k| length(ax[k] - bx[k], ay[k] - by[k])).sum();
    (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]) + rest
}

#[cfg(test)]
pub(crate) mod tests {
    use nalgebra::Point2;
    use proptest::prelude::*;

    use super::*;
    use crate::{model::FrameExpressionModel, units::FaceUnit};

    /// Moderate vectors. Many are exactly zero or repeated, as in still faces, or equal up to rounding.
    pub(crate) fn vectors(count: usize) -> impl Strategy<Value = Vec<Vector2<f64>>> {
        let almost = (-3..4i32, prop_oneof![Just(f64::EPSILON), Just(1e-13), Just(1e-9), Just(1e-5)]);
        let coordinate = prop_oneof![
            2 => Just(0.0),
            1 => Just(3.0),
            2 => almost.prop_map(|(steps, width)| 3.0 + f64::from(steps) * width),
            5 => -50.0..50.0f64,
        ];
        prop::collection::vec((coordinate.clone(), coordinate).prop_map(|(x, y)| Vector2::new(x, y)), count)
    }

    fn fields(count: usize) -> impl Strategy<Value = DisplacementFields> {
        vectors(count * 7).prop_map(|v| DisplacementFields::from_vectors(7, &v))
    }

    #[test]
    fn distances_are_means_over_nodes_and_fields() {
        // Three nodes, three frames; node 1 is not live. Model a is still.
        // b, field 0: node 0 moves by (3, 4), length 5; node 2 rests: d_f = (5 + 0) / 2 = 2.5.
        // b, field 1: node 0 by (0, 1), node 2 by (6, 8): d_f = (1 + 10) / 2 = 5.5.  d = (2.5 + 5.5) / 2 = 4.
        let frame = |p: [(f64, f64); 3]| FrameExpressionModel::<FaceUnit>::new(p.map(|(x, y)| Point2::new(x, y)).to_vec());
        let live = [NodeId(0), NodeId(2)];
        let still = DynamicExpressionModel::new(vec![frame([(1.0, 1.0); 3]); 3]).unwrap();
        let moving = DynamicExpressionModel::new(vec![
            frame([(0.0, 0.0), (0.0, 0.0), (0.0, 0.0)]),
            frame([(3.0, 4.0), (99.0, 0.0), (0.0, 0.0)]),
            frame([(3.0, 5.0), (-99.0, 0.0), (6.0, 8.0)]),
        ]);
        let a = DisplacementFields::of_model(&still, &live);
        let b = DisplacementFields::of_model(&moving.unwrap(), &live);
        assert_eq!((b.field_count(), b.node_count(), b.vector(1, 1)), (2, 2, Vector2::new(6.0, 8.0)));
        assert_eq!(vector_distance(a.vector(1, 1), b.vector(1, 1)), 10.0);
        assert_eq!((a.frame_distance(&b, 0), a.frame_distance(&b, 1), a.distance(&b)), (2.5, 5.5, 4.0));
    }

    #[test]
    fn values_beyond_a_limit_are_located() {
        let fields = DisplacementFields::from_vectors(
            2,
            &[(0.0, 0.0), (1.0, 2.0), (3.0, -9.0), (9.0, 0.0)].map(|(x, y)| Vector2::new(x, y)),
        );
        assert_eq!(fields.first_beyond(9.5), None);
        assert_eq!(fields.first_beyond(9.0), Some((1, 0, -9.0)));
        let nan = DisplacementFields::from_vectors(1, &[Vector2::new(f64::NAN, 0.0)]);
        assert!(matches!(nan.first_beyond(9.0), Some((0, 0, x)) if x.is_nan()));
    }

    proptest! {
        #[test]
        fn distance_is_symmetric_and_zero_to_self(a in fields(4), b in fields(4)) {
            prop_assert_eq!(a.distance(&b), b.distance(&a));
            prop_assert_eq!(a.distance(&a), 0.0);
        }

        #[test]
        fn the_way_round_is_never_shorter(a in fields(3), b in fields(3), c in fields(3)) {
            // 1e-12: rounding of sums of 21 lengths below 150.
            prop_assert!(a.distance(&c) <= a.distance(&b) + b.distance(&c) + 1e-12);
        }

        #[test]
        fn lanes_change_only_rounding(a in vectors(11), b in vectors(11)) {
            let (fa, fb) = (DisplacementFields::from_vectors(11, &a), DisplacementFields::from_vectors(11, &b));
            let plain: f64 = a.iter().zip(&b).map(|(a, b)| vector_distance(*a, *b)).sum::<f64>() / 11.0;
            approx::assert_relative_eq!(fa.frame_distance(&fb, 0), plain, max_relative = 1e-14);
        }
    }
}
