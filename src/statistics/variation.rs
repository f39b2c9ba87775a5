//! Variation between people: principal components of the models of one emotion, their mean, and pointwise bands.
//!
//! The data of a model are the neutral offsets of its live nodes in all frames after the neutral one. The components are the eigenvectors
//! of the covariance of these data over people. Each person has the same weight, however many sequences they have. The sign of a
//! component is chosen so that it points along the mean motion.
//!
//! Mean and components are not robust, which is why the representative is the median: an outlier appears as a component of its own.

use nalgebra::{DMatrix, DVector, SymmetricEigen, Vector2};
use rayon::prelude::*;

use super::{
    SequenceModel, Weighting,
    comparable::{NotComparable, comparable_fields},
    weights::sequence_weights,
};
use crate::{
    model::{DynamicExpressionModel, FrameExpressionModel, ModelError},
    units::{FaceUnit, NodeId, SequenceId},
    wireframe::Wireframe,
};

/// Largest number of components.
pub const MOST_COMPONENTS: usize = 10;

/// Smallest number of people. Two people differ in one direction only.
pub const LEAST_PEOPLE: usize = 3;

/// Largest number of sequences for components. Products of more sequences take too long.
pub const MOST_SEQUENCES: usize = 2048;

/// Share of the total variance below which a component is rounding error.
const LEAST_SHARE: f64 = 1e-9;

/// Quantiles of the bands: shares of the people below the limits.
pub const QUANTILES: [f64; 5] = [0.05, 0.25, 0.5, 0.75, 0.95];

/// Why there are no components.
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
/// use grimace::statistics::{Variation, VariationError};
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let alone = smile("P1", 10.0);
/// let error = Variation::new(&[&alone], &face.wireframe).unwrap_err();
/// assert_eq!(error, VariationError::TooFewPeople { found: 1 });
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum VariationError {
    /// Too few people for principal components.
    #[error("found {found} {}; principal components need at least {LEAST_PEOPLE} people", if *found == 1 { "person" } else { "people" })]
    TooFewPeople {
        /// Number of people.
        found: usize,
    },
    /// Too many sequences for the planned memory.
    #[error("there are {found} sequences; principal components are computed for at most {MOST_SEQUENCES}")]
    TooMany {
        /// Number of sequences.
        found: usize,
    },
    /// All people move in the same way.
    #[error("all sequences are equal; principal components need sequences that differ")]
    Equal,
    /// Positions that are not finite.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Models that cannot be compared: other shapes than the others or the wireframe, or an impossible motion.
    #[error(transparent)]
    Models(#[from] NotComparable),
    /// Models of another wireframe.
    #[error(
        "{id}: it has {found} nodes, but the wireframe has {expected}; give the wireframe that the sequences were normalized with"
    )]
    Nodes {
        /// The sequence.
        id: SequenceId,
        /// Number of its nodes.
        found: usize,
        /// Number of nodes of the wireframe.
        expected: usize,
    },
}

/// One direction in which people differ: a principal component.
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
/// use grimace::statistics::Variation;
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let models = [smile("P1", 10.0), smile("P2", 20.0), smile("P3", 30.0)];
/// let variation = Variation::new(&[&models[0], &models[1], &models[2]], &face.wireframe)?;
/// // They differ in their strength and in nothing else.
/// assert!((variation.components[0].share - 1.0).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Component {
    /// Share of the variance between people, 0 to 1.
    pub share: f64,
    /// Standard deviation along the component, face units: the root of the sum of squares over all nodes and frames.
    pub deviation: f64,
    /// Offsets of the live nodes from the mean at one standard deviation, face units, by frame after the neutral one, then by node.
    pub offsets: Vec<Vec<Vector2<f64>>>,
}

/// How the people of one emotion differ.
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
/// use grimace::statistics::Variation;
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let models = [smile("P1", 10.0), smile("P2", 20.0), smile("P3", 30.0)];
/// let variation = Variation::new(&[&models[0], &models[1], &models[2]], &face.wireframe)?;
/// assert_eq!(variation.people, 3);
/// assert!((variation.mean.neutral_offsets(4)[31].y - 80.0).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Variation {
    /// The mean model.
    pub mean: DynamicExpressionModel<FaceUnit>,
    /// Number of people.
    pub people: usize,
    /// Components, the largest first.
    pub components: Vec<Component>,
    /// Scores of every sequence in the components, in standard deviations, sorted by sequence id.
    pub scores: Vec<(SequenceId, Vec<f64>)>,
}

/// Returns the neutral offsets of the live nodes in all frames after the neutral one, x and y alternating.
pub(super) fn offsets_of(model: &SequenceModel, live: &[NodeId]) -> DVector<f64> {
    let frames = (1..model.model.frame_count()).map(|m| model.model.neutral_offsets(m));
    DVector::from_vec(
        frames
            .flat_map(|offsets| {
                live.iter()
                    .flat_map(move |n| {
                        let o = offsets[n.index()];
                        [o.x, o.y]
                    })
                    .collect::<Vec<_>>()
            })
            .collect(),
    )
}

/// Returns weights of sequences that give every person the same weight and add up to the number of people.
fn person_weights(models: &[&SequenceModel]) -> Vec<f64> {
    let equal = || {
        let people: std::collections::BTreeSet<&str> = models.iter().map(|m| m.id.subject.as_str()).collect();
        vec![people.len() as f64 / models.len() as f64; models.len()]
    };
    sequence_weights(models.iter().map(|m| &m.id), Weighting::Person).unwrap_or_else(equal)
}

impl Variation {
    /// Computes the variation of the models of one emotion, given in any order.
    ///
    /// The models must have one shape and one neutral frame, as [`super::representative`] checks.
    ///
    /// # Errors
    /// [`VariationError`] for fewer than 3 people, more than 2048 sequences, sequences that are all equal, of differing shapes or
    /// of another wireframe, and displacements of 20 eye distances or more.
    pub fn new(models: &[&SequenceModel], wireframe: &Wireframe) -> Result<Self, VariationError> {
        let mut models = models.to_vec();
        models.sort_by(|a, b| a.id.cmp(&b.id));
        if models.len() > MOST_SEQUENCES {
            return Err(VariationError::TooMany { found: models.len() });
        }
        let weights = person_weights(&models);
        let people = weights.iter().sum::<f64>().round() as usize;
        if people < LEAST_PEOPLE {
            return Err(VariationError::TooFewPeople { found: people });
        }
        let live = wireframe.live_nodes();
        if let Some(odd) = models.iter().find(|m| m.model.node_count() != wireframe.node_count()) {
            let (found, expected) = (odd.model.node_count(), wireframe.node_count());
            return Err(VariationError::Nodes { id: odd.id.clone(), found, expected });
        }
        comparable_fields(&models, live, None)?;
        let data: Vec<DVector<f64>> = models.par_iter().map(|m| offsets_of(m, live)).collect();
        let (size, total) = (data[0].len(), weights.iter().sum::<f64>());
        let mut mean = DVector::zeros(size);
        data.iter().zip(&weights).for_each(|(x, w)| mean.axpy(w / total, x, 1.0));
        // Rows whose products are the covariance between people.
        let scaled = |(x, w): (&DVector<f64>, &f64)| (x - &mean) * (w / (people - 1) as f64).sqrt();
        let rows: Vec<DVector<f64>> = data.iter().zip(&weights).map(scaled).collect();
        let variance: f64 = rows.iter().map(DVector::norm_squared).sum();
        let rounding = data.iter().map(DVector::norm_squared).fold(0.0, f64::max) * 1e-20;
        if variance <= rounding {
            return Err(VariationError::Equal);
        }
        let components: Vec<(f64, DVector<f64>)> = directions(&rows, size)
            .into_iter()
            .take_while(|(value, _)| *value > LEAST_SHARE * variance)
            .map(|(value, direction)| {
                // The sign is that of the mean motion. If the mean has no motion along the component, the largest coordinate is positive.
                let along = direction.dot(&mean);
                let largest = direction.iter().copied().fold(0.0, |most: f64, v| if v.abs() > most.abs() { v } else { most });
                let sign = if along.abs() > 1e-9 * mean.norm() { along } else { largest };
                (value, direction * sign.signum())
            })
            .collect();
        let score = |x: &DVector<f64>| {
            components.iter().map(|(value, direction)| (x - &mean).dot(direction) / value.sqrt()).collect::<Vec<f64>>()
        };
        let scores = models.iter().zip(&data).map(|(m, x)| (m.id.clone(), score(x))).collect();
        let frames = size / (2 * live.len());
        let by_frame = |v: &DVector<f64>| {
            let at = |m: usize, k: usize| Vector2::new(v[2 * (m * live.len() + k)], v[2 * (m * live.len() + k) + 1]);
            (0..frames).map(|m| (0..live.len()).map(|k| at(m, k)).collect()).collect::<Vec<Vec<_>>>()
        };
        let mean = moved(models[0].model.neutral(), &by_frame(&mean), wireframe)?;
        let component = |(value, direction): (f64, DVector<f64>)| Component {
            share: value / variance,
            deviation: value.sqrt(),
            offsets: by_frame(&(direction * value.sqrt())),
        };
        Ok(Self { mean, people, components: components.into_iter().map(component).collect(), scores })
    }

    /// Returns the mean moved along a component by the given number of standard deviations.
    ///
    /// # Errors
    /// [`ModelError`] when a position is not finite.
    pub fn at(
        &self,
        component: usize,
        deviations: f64,
        wireframe: &Wireframe,
    ) -> Result<DynamicExpressionModel<FaceUnit>, ModelError> {
        let live = wireframe.live_nodes();
        let offsets: Vec<Vec<Vector2<f64>>> = (1..self.mean.frame_count())
            .map(|m| {
                let mean = self.mean.neutral_offsets(m);
                let along = self.components.get(component).map(|c| &c.offsets[m - 1]);
                let offset =
                    |(k, n): (usize, &NodeId)| mean[n.index()] + along.map_or_else(Vector2::zeros, |a| a[k] * deviations);
                live.iter().enumerate().map(offset).collect()
            })
            .collect();
        moved(self.mean.neutral(), &offsets, wireframe)
    }
}

/// Builds a model from a neutral frame and offsets of the live nodes by frame. Followers move with their leaders.
pub(super) fn moved(
    neutral: &FrameExpressionModel<FaceUnit>,
    offsets: &[Vec<Vector2<f64>>],
    wireframe: &Wireframe,
) -> Result<DynamicExpressionModel<FaceUnit>, ModelError> {
    let frame = |offsets: &Vec<Vector2<f64>>| {
        let mut nodes = neutral.nodes().to_vec();
        wireframe.live_nodes().iter().zip(offsets).for_each(|(n, o)| nodes[n.index()] += o);
        wireframe.place_followers(&mut nodes);
        FrameExpressionModel::new(nodes)
    };
    DynamicExpressionModel::new([neutral.clone()].into_iter().chain(offsets.iter().map(frame)).collect())
}

/// Returns eigenvalues and unit eigenvectors of the sum of the rows' outer products, the largest first, at most [`MOST_COMPONENTS`].
fn directions(rows: &[DVector<f64>], size: usize) -> Vec<(f64, DVector<f64>)> {
    // Uses the smaller of the two matrices of products, which have the same eigenvalues.
    let count = rows.len();
    let matrix = if count <= size {
        let products: Vec<Vec<f64>> =
            (0..count).into_par_iter().map(|i| (0..count).map(|j| rows[i].dot(&rows[j])).collect()).collect();
        DMatrix::from_fn(count, count, |i, j| products[i][j])
    } else {
        let products: Vec<Vec<f64>> = (0..size)
            .into_par_iter()
            .map(|i| (0..size).map(|j| rows.iter().map(|row| row[i] * row[j]).sum()).collect())
            .collect();
        DMatrix::from_fn(size, size, |i, j| products[i][j])
    };
    let eigen = SymmetricEigen::new(matrix);
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]).then(a.cmp(&b)));
    let direction = |k: usize| {
        let own = eigen.eigenvectors.column(k);
        if count > size {
            return own.into_owned();
        }
        let mut direction = DVector::zeros(size);
        rows.iter().zip(own.iter()).for_each(|(row, u)| direction.axpy(*u, row, 1.0));
        let norm: f64 = direction.norm();
        if norm > 0.0 { direction / norm } else { direction }
    };
    order.into_iter().take(MOST_COMPONENTS).map(|k| (eigen.eigenvalues[k].max(0.0), direction(k))).collect()
}

/// Distribution of a value over people in one frame: mean and [`QUANTILES`], each person with the same weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Band {
    /// Mean.
    pub mean: f64,
    /// Values of the [`QUANTILES`].
    pub quantiles: [f64; 5],
}

impl Band {
    /// Computes the band of (value, weight) pairs, or returns `None` if there are none.
    pub fn of(values: &[(f64, f64)]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let total: f64 = sorted.iter().map(|v| v.1).sum();
        let mean = sorted.iter().map(|v| v.0 * v.1).sum::<f64>() / total;
        let mut quantiles = [0.0; 5];
        for (quantile, share) in quantiles.iter_mut().zip(QUANTILES) {
            *quantile = weighted_quantile(&sorted, share * total)?;
        }
        Some(Self { mean, quantiles })
    }
}

/// Returns the first of the sorted values at which the cumulative weight reaches `limit`. If it is exactly `limit`, the result is the
/// mean of this value and the next.
fn weighted_quantile(sorted: &[(f64, f64)], limit: f64) -> Option<f64> {
    const ROUNDING: f64 = 1e-9;
    let mut below = 0.0;
    for (k, &(value, weight)) in sorted.iter().enumerate() {
        below += weight;
        if below >= limit - ROUNDING {
            let next = sorted.get(k + 1).filter(|_| below <= limit + ROUNDING);
            return Some(next.map_or(value, |next| f64::midpoint(value, next.0)));
        }
    }
    sorted.last().map(|v| v.0)
}

/// Returns weights of sequences for [`Band::of`], in the order of the models.
pub fn band_weights(models: &[&SequenceModel]) -> Vec<f64> {
    person_weights(models)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Models of Candide-3 whose live node 0 moves by the given offsets in one frame.
    fn models(offsets: &[(&str, f64, f64)]) -> (Vec<SequenceModel>, Wireframe) {
        let wireframe = Wireframe::candide3();
        let first = wireframe.live_nodes()[0].index();
        let neutral: Vec<_> = wireframe.frontal().iter().map(|p| p * 1000.0).collect();
        let model = |(i, &(subject, x, y)): (usize, &(&str, f64, f64))| {
            let mut moved = neutral.clone();
            moved[first] += Vector2::new(x, y);
            let frames = vec![FrameExpressionModel::new(neutral.clone()), FrameExpressionModel::new(moved)];
            let id = SequenceId { subject: subject.to_owned(), sequence: format!("{i}") };
            SequenceModel { id, model: DynamicExpressionModel::new(frames).unwrap() }
        };
        (offsets.iter().enumerate().map(model).collect(), wireframe)
    }

    fn variation(offsets: &[(&str, f64, f64)]) -> Result<Variation, VariationError> {
        let (models, wireframe) = models(offsets);
        Variation::new(&models.iter().collect::<Vec<_>>(), &wireframe)
    }

    #[test]
    fn two_directions_by_hand() {
        // x: 1, 5, 3, 3, mean 3, squares 4 + 4; y: 0, 0, 1, -1, squares 1 + 1. Over 4 - 1: variances 8/3 and 2/3, shares 0.8 and 0.2.
        let v = variation(&[("a", 1.0, 0.0), ("b", 5.0, 0.0), ("c", 3.0, 1.0), ("d", 3.0, -1.0)]).unwrap();
        assert_eq!((v.components.len(), v.people), (2, 4));
        approx::assert_relative_eq!(v.components[0].share, 0.8, max_relative = 1e-9);
        approx::assert_relative_eq!(v.components[0].deviation, (8.0f64 / 3.0).sqrt(), max_relative = 1e-9);
        // The sign is that of the mean motion along x: b is above the mean, a below.
        let score = 2.0 / (8.0f64 / 3.0).sqrt();
        approx::assert_relative_eq!(v.scores[1].1[0], score, max_relative = 1e-9);
        approx::assert_relative_eq!(v.scores[0].1[0], -score, max_relative = 1e-9);
        let wireframe = Wireframe::candide3();
        let first = wireframe.live_nodes()[0];
        let at = |d: f64| v.at(0, d, &wireframe).unwrap().neutral_offsets(1)[first.index()];
        assert!((at(0.0) - Vector2::new(3.0, 0.0)).norm() < 1e-9);
        assert!((at(2.0) - Vector2::new(3.0 + 2.0 * (8.0f64 / 3.0).sqrt(), 0.0)).norm() < 1e-9);
    }

    #[test]
    fn a_person_counts_once() {
        // a has three sequences at 9: the mean of people 9, 0, 0 is 3, that of sequences 5.4.
        let v = variation(&[("a", 9.0, 0.0), ("a", 9.0, 0.0), ("a", 9.0, 0.0), ("b", 0.0, 0.0), ("c", 0.0, 0.0)]).unwrap();
        let first = Wireframe::candide3().live_nodes()[0];
        approx::assert_relative_eq!(v.mean.neutral_offsets(1)[first.index()].x, 3.0, max_relative = 1e-9);
        // Squares 36 + 9 + 9 over 3 - 1.
        approx::assert_relative_eq!(v.components[0].deviation, 27.0f64.sqrt(), max_relative = 1e-9);
    }

    #[test]
    fn data_without_variation_is_an_error() {
        assert_eq!(variation(&[("a", 1.0, 0.0), ("b", 2.0, 0.0)]).unwrap_err(), VariationError::TooFewPeople { found: 2 });
        assert_eq!(
            variation(&[("a", 1.0, 0.0), ("a", 2.0, 0.0), ("a", 3.0, 0.0)]).unwrap_err().to_string(),
            "found 1 person; principal components need at least 3 people"
        );
        assert_eq!(variation(&[("a", 1.0, 0.5), ("b", 1.0, 0.5), ("c", 1.0, 0.5)]).unwrap_err(), VariationError::Equal);
    }

    #[test]
    fn models_of_other_shapes_and_impossible_ones_are_an_error() {
        let far = variation(&[("a", 1e300, 0.0), ("b", 2.0, 0.0), ("c", 3.0, 0.0)]).unwrap_err();
        assert!(matches!(far, VariationError::Models(NotComparable::Displacement { found: 1e300, .. })), "{far}");
        let (mut models, wireframe) = models(&[("a", 1.0, 0.0), ("b", 2.0, 0.0), ("c", 3.0, 0.0)]);
        let of = |models: &[SequenceModel]| Variation::new(&models.iter().collect::<Vec<_>>(), &wireframe).unwrap_err();
        let whole = models[1].model.clone();
        models[1].model = DynamicExpressionModel::new([whole.frames(), whole.frames()].concat()).unwrap();
        assert!(matches!(of(&models), VariationError::Models(NotComparable::Shape { .. })));
        let cut = |frame: &FrameExpressionModel<FaceUnit>| FrameExpressionModel::new(frame.nodes()[..9].to_vec());
        models[1].model = DynamicExpressionModel::new(whole.frames().iter().map(cut).collect()).unwrap();
        assert_eq!(of(&models), VariationError::Nodes { id: models[1].id.clone(), found: 9, expected: 113 });
    }

    #[test]
    fn bands_are_quantiles_of_people() {
        // 1 to 20 with equal weights: a twentieth is below 1.5, a quarter below 5.5.
        let values: Vec<(f64, f64)> = (1..=20).map(|v| (f64::from(v), 1.0)).collect();
        let band = Band::of(&values).unwrap();
        assert_eq!((band.mean, band.quantiles), (10.5, [1.5, 5.5, 10.5, 15.5, 19.5]));
        // One person with half of the weight at 7.
        let band = Band::of(&[(7.0, 2.0), (1.0, 1.0), (9.0, 1.0)]).unwrap();
        assert_eq!((band.mean, band.quantiles[2]), (6.0, 7.0));
        assert_eq!(Band::of(&[]), None);
    }
}
