//! Linear model of heads in three dimensions and of how expressions move their nodes.

use std::sync::LazyLock;

use nalgebra::{DMatrix, DVector, Point3, SymmetricEigen, Vector3};

use super::{file, learn::LearnedHead};
use crate::{
    units::{FeaturePoint, NodeId},
    wireframe::{Tables, UnitKind, Wireframe},
};

/// Standard deviation of Candide's shape units among people.
const SHAPE_UNIT_DEVIATION: f64 = 0.15;
/// Standard deviation of the weight of Candide's own neutral in a head.
const CANDIDE_DEVIATION: f64 = 0.2;
/// Standard deviation of the strength of an expression shape common to both sides, and of the difference between the sides.
const EXPRESSION_DEVIATION: f64 = 0.4;
const ONE_SIDED_DEVIATION: f64 = 0.15;
/// Standard deviation of Candide's action units.
const ACTION_UNIT_DEVIATION: f64 = 0.3;
/// Share of the variance of expressions that the kept directions may omit.
const LEFT_OUT: f64 = 2e-3;

/// Offsets of all nodes for a named shape, model units.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedOffsets {
    /// Name of the shape.
    pub name: String,
    /// Offset of every node at full strength.
    pub offsets: Vec<Vector3<f64>>,
}

/// A linear model of heads over the N nodes of a wireframe, model units, face space, origin in the middle of the head.
///
/// A neutral head is `mean + sum_j a_j identity_j + r`; an expression adds `sum_k e_k expression_k`. `a` and `e` are independent with mean
/// 0 and standard deviation 1; `r` is the person's own offset.
///
/// ```
/// use grimace::{pose::HeadModel, wireframe::Face};
///
/// let face = Face::candide3();
/// let head = HeadModel::shipped(&face.wireframe, &face.tables);
/// assert_eq!((head.node_count(), head.mean.len()), (113, 113));
/// assert!(head.shapes.iter().any(|shape| shape.name == "jawOpen"));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct HeadModel {
    /// Mean head.
    pub mean: Vec<Vector3<f64>>,
    /// Modes of identity, each at one standard deviation.
    pub identity: Vec<Vec<Vector3<f64>>>,
    /// Directions of expression, each at one standard deviation.
    pub expression: Vec<Vec<Vector3<f64>>>,
    /// Named shapes from which the expression directions were computed.
    #[doc(hidden)]
    pub shapes: Vec<NamedOffsets>,
    /// Middle of the head, the mean of the 68 landmarks, in the wireframe's own face space: the optical axis goes through it.
    pub middle: Point3<f64>,
    /// Nodes of the irises, which landmarks and expressions do not determine.
    pub irises: [Vec<NodeId>; 2],
    pub(super) triangles: Vec<[NodeId; 3]>,
    pub(super) live: Vec<NodeId>,
}

/// The learned head embedded in the program.
static SHIPPED: LazyLock<LearnedHead> = LazyLock::new(file::embedded);

impl HeadModel {
    /// Returns the embedded model (`candide/head_model.json`) over the nodes of a wireframe.
    ///
    /// If the wireframe has more nodes than Candide-3, the additional nodes keep the wireframe's position and do not move.
    pub fn shipped(wireframe: &Wireframe, tables: &Tables) -> Self {
        Self::new(&SHIPPED, wireframe, tables)
    }

    /// Creates the model of a learned head over the nodes of a wireframe. Its modes of identity are the learned ones plus Candide's own
    /// neutral and shape units; its expressions are the learned ones plus Candide's action units.
    pub(crate) fn new(learned: &LearnedHead, wireframe: &Wireframe, tables: &Tables) -> Self {
        let count = wireframe.node_count();
        let all = |offsets: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
            (0..count).map(|k| offsets.get(k).copied().unwrap_or_else(Vector3::zeros)).collect()
        };
        let at = |k: usize| learned.mean.get(k).copied().unwrap_or(wireframe.vertices()[k].coords);
        let parts = tables.landmarks.iter().flat_map(|row| &row.nodes).filter(|(n, _)| n.index() < count);
        let (sum, weight) = parts.fold((Vector3::zeros(), 0.0), |(sum, all), (n, w)| (sum + at(n.index()) * *w, all + w));
        let middle = if weight > 0.0 { sum / weight } else { sum };
        let mean: Vec<Vector3<f64>> = (0..count).map(|k| at(k) - middle).collect();

        let mut identity: Vec<Vec<Vector3<f64>>> = learned.identity.iter().map(|mode| all(mode)).collect();
        let candide = |k: usize| (wireframe.vertices()[k].coords - middle - mean[k]) * CANDIDE_DEVIATION;
        identity.push((0..count).map(candide).collect());
        for unit in wireframe.shape_units() {
            identity.push(unit_offsets(&unit.offsets, count, SHAPE_UNIT_DEVIATION));
        }
        let shapes: Vec<NamedOffsets> =
            learned.expressions.iter().map(|e| NamedOffsets { name: e.name.clone(), offsets: all(&e.offsets) }).collect();
        let mut spread = spread_of(&shapes);
        for unit in wireframe.action_units().iter().filter(|u| matches!(u.kind, UnitKind::Action { .. })) {
            spread.push(unit_offsets(&unit.offsets, count, ACTION_UNIT_DEVIATION));
        }
        let pupil = |point| {
            let nodes = tables.feature_point_nodes(FeaturePoint { group: 3, point }).unwrap_or_default();
            nodes.iter().copied().filter(|n| n.index() < count).collect()
        };
        Self {
            mean,
            identity,
            expression: principal(&spread, wireframe.live_nodes()),
            shapes,
            middle: Point3::from(middle),
            irises: [pupil(5), pupil(6)],
            triangles: wireframe.triangles().to_vec(),
            live: wireframe.live_nodes().to_vec(),
        }
    }

    /// Returns the number of nodes N.
    pub fn node_count(&self) -> usize {
        self.mean.len()
    }
}

fn unit_offsets(offsets: &[(NodeId, Vector3<f64>)], count: usize, factor: f64) -> Vec<Vector3<f64>> {
    let mut all = vec![Vector3::zeros(); count];
    offsets.iter().for_each(|(node, offset)| all[node.index()] += offset * factor);
    all
}

/// Returns independent directions of one standard deviation each: sum and difference of both sides.
fn spread_of(shapes: &[NamedOffsets]) -> Vec<Vec<Vector3<f64>>> {
    let mut spread = Vec::new();
    for shape in shapes {
        if shape.name.ends_with("_R") {
            continue;
        }
        let other = shape.name.strip_suffix("_L").and_then(|stem| shapes.iter().find(|s| s.name == format!("{stem}_R")));
        match other {
            None => spread.push(shape.offsets.iter().map(|v| v * EXPRESSION_DEVIATION).collect()),
            Some(other) => {
                let pair = |sign: f64, factor: f64| {
                    shape.offsets.iter().zip(&other.offsets).map(|(l, r)| (l + r * sign) * factor).collect()
                };
                spread.push(pair(1.0, EXPRESSION_DEVIATION));
                spread.push(pair(-1.0, ONE_SIDED_DEVIATION));
            }
        }
    }
    spread
}

/// Returns the principal directions of `sum_j e_j spread_j`, each at one standard deviation, without the negligible ones.
fn principal(spread: &[Vec<Vector3<f64>>], live: &[NodeId]) -> Vec<Vec<Vector3<f64>>> {
    let dot = |a: &[Vector3<f64>], b: &[Vector3<f64>]| live.iter().map(|n| a[n.index()].dot(&b[n.index()])).sum::<f64>();
    let gram = DMatrix::from_fn(spread.len(), spread.len(), |i, j| dot(&spread[i], &spread[j]));
    let eigen = SymmetricEigen::new(gram);
    let total: f64 = eigen.eigenvalues.iter().map(|v| v.max(0.0)).sum();
    let mut order: Vec<usize> = (0..spread.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]).then(a.cmp(&b)));
    let mut directions = Vec::new();
    let mut left = total;
    for column in order {
        if left <= LEFT_OUT * total {
            break;
        }
        left -= eigen.eigenvalues[column].max(0.0);
        let weights: DVector<f64> = eigen.eigenvectors.column(column).into_owned();
        let node = |k: usize| spread.iter().zip(weights.iter()).map(|(s, w)| s[k] * *w).sum();
        directions.push((0..spread.first().map_or(0, Vec::len)).map(node).collect());
    }
    directions
}
