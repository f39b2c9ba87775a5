//! Dispersion of models around their generalized median [KP, eq. (8)].
//!
//! After trimming, a model's distance is the mean of `d_f` over the displacement fields that were kept. Models are then averaged over
//! different fields, so this dispersion can rise although the farthest fields were dropped.
//!
//! [`Dispersions`] has two other forms without this effect: \[KP\]'s eq. (8) taken literally (all N'' models over all fields, around the
//! median of the kept fields), and the mean over the fields of each field's median of `d_f` over the models kept in it.

use serde::{Deserialize, Serialize};

use super::distance::{DisplacementFields, vector_distance};

pub use crate::robust::median;

/// Other forms of the dispersion, comparable before and after trimming, face units; `None` for a single model.
///
/// ```
/// # use grimace::{model, normalize, statistics::ClassLabel, statistics::SequenceModel, units, wireframe};
/// let face = grimace::wireframe::Face::candide3();
/// # let neutral = normalize::Canonical::new(&face.wireframe, &face.tables)?.neutral;
/// # let smile = |subject: &str, up: f64| {
/// #     let frame = |m: usize| {
/// #         let mut nodes = neutral.nodes().to_vec();
/// #         [31, 64].map(|corner| nodes[corner].y += up * m as f64);
/// #         model::FrameExpressionModel::new(nodes)
/// #     };
/// #     let id = units::SequenceId { subject: subject.to_owned(), sequence: "1".to_owned() };
/// #     let model = model::DynamicExpressionModel::new((0..5).map(frame).collect()).expect("five frames");
/// #     SequenceModel { id, model }
/// # };
/// # let label = ClassLabel { emotion: "smile".to_owned(), group: Default::default() };
/// use grimace::statistics::representative;
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let alike = [smile("P1", 10.0), smile("P2", 10.0), smile("P3", 10.0)];
/// let found = representative(label, &alike, &face.wireframe, &Default::default())?;
/// assert_eq!((found.dispersions.literal, found.dispersions.field), (Some(0.0), Some(0.0)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Dispersions {
    /// [KP, eq. (8)] taken literally: the median over all models of d, over all fields, to the median of the kept fields.
    pub literal: Option<f64>,
    /// As `literal`, around the median of all models.
    pub literal_untrimmed: Option<f64>,
    /// Mean over the fields of the median of `d_f` over the models kept in the field.
    pub field: Option<f64>,
    /// As `field`, over all models and around the median of all models.
    pub field_untrimmed: Option<f64>,
}

/// Returns the median of values with weights: half of the weight lies on either side.
///
/// Where exactly half of the weight lies at or below a value, it is the mean of this value and the next larger one.
pub fn weighted_median(mut values: Vec<(f64, f64)>) -> Option<f64> {
    /// Relative rounding error of the weights within which they count as exactly half.
    const ROUNDING: f64 = 1e-12;
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = values.iter().map(|v| v.1).sum::<f64>() / 2.0;
    let mut below = 0.0;
    for (place, &(value, weight)) in values.iter().enumerate() {
        below += weight;
        if below >= half * (1.0 - ROUNDING) {
            let next = values.get(place + 1).filter(|_| below <= half * (1.0 + ROUNDING));
            return Some(next.map_or(value, |next| f64::midpoint(value, next.0)));
        }
    }
    None
}

/// Returns the median of the values that are not `None`. Weights are by index in `values`; `None` means equal weights.
pub(super) fn median_of(values: impl IntoIterator<Item = Option<f64>>, weights: Option<&[f64]>) -> Option<f64> {
    let known = values.into_iter().enumerate().filter_map(|(i, value)| Some((i, value?)));
    match weights {
        None => median(&mut known.map(|(_, value)| value).collect::<Vec<_>>()),
        Some(weights) => weighted_median(known.map(|(i, value)| (value, weights[i])).collect()),
    }
}

/// Returns the mean over the fields of the median of `d_f` to `center` over the models kept in the field.
pub(super) fn field_dispersion(
    models: &[DisplacementFields],
    kept: &[Vec<usize>],
    center: &DisplacementFields,
    weights: Option<&[f64]>,
) -> Option<f64> {
    let of_field = |(m, kept): (usize, &Vec<usize>)| {
        let mut distances = vec![None; models.len()];
        kept.iter().for_each(|&i| distances[i] = Some(models[i].frame_distance(center, m)));
        median_of(distances, weights)
    };
    let medians: Option<Vec<f64>> = kept.iter().enumerate().map(of_field).collect();
    medians.filter(|medians| !medians.is_empty()).map(|medians| medians.iter().sum::<f64>() / medians.len() as f64)
}

/// The displacement fields in which each model is kept.
#[derive(Clone, Debug)]
pub struct KeptFields {
    /// Kept fields by model, ascending.
    fields: Vec<Vec<usize>>,
}

impl KeptFields {
    /// Converts the kept models of every field (`Trimming::kept`) to the kept fields of every model.
    pub fn by_model(kept: &[Vec<usize>], model_count: usize) -> Self {
        let mut fields = vec![Vec::new(); model_count];
        for (m, kept) in kept.iter().enumerate() {
            kept.iter().for_each(|&i| fields[i].push(m));
        }
        Self { fields }
    }

    /// Returns the distance of every model to `center`: the mean of `d_f` over its kept fields, or `None` if no field is kept.
    ///
    /// For a model kept in all fields this is d [KP, eq. (5)].
    pub fn distances(&self, models: &[DisplacementFields], center: &DisplacementFields) -> Vec<Option<f64>> {
        let distance = |(model, fields): (&DisplacementFields, &Vec<usize>)| {
            let sum: f64 = fields.iter().map(|&m| model.frame_distance(center, m)).sum();
            (!fields.is_empty()).then(|| sum / fields.len() as f64)
        };
        models.iter().zip(&self.fields).map(distance).collect()
    }

    /// Returns the dispersion of every live node: the median over the models of the mean of `d_v` to `center` over the kept fields.
    ///
    /// `weights` are the models' weights, or `None` if all are equal.
    pub fn node_dispersion(
        &self,
        models: &[DisplacementFields],
        center: &DisplacementFields,
        weights: Option<&[f64]>,
    ) -> Vec<f64> {
        let at_node = |k: usize| {
            let of_model = |(model, fields): (&DisplacementFields, &Vec<usize>)| {
                let sum: f64 = fields.iter().map(|&m| vector_distance(model.vector(m, k), center.vector(m, k))).sum();
                (!fields.is_empty()).then(|| sum / fields.len() as f64)
            };
            median_of(models.iter().zip(&self.fields).map(of_model), weights).unwrap_or(0.0)
        };
        (0..center.node_count()).map(at_node).collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    #[test]
    fn medians_of_odd_even_and_no_values() {
        assert_eq!(median(&mut []), None);
        assert_eq!(median(&mut [4.0]), Some(4.0));
        assert_eq!(median(&mut [9.0, 1.0, 4.0]), Some(4.0));
        assert_eq!(median(&mut [9.0, 1.0, 4.0, 5.0]), Some(4.5));
    }

    #[test]
    fn half_of_the_weight_lies_on_either_side() {
        assert_eq!(weighted_median(vec![]), None);
        assert_eq!(weighted_median(vec![(9.0, 1.0), (1.0, 1.0), (4.0, 1.0), (5.0, 1.0)]), Some(4.5));
        // 0.3 + 0.3 + 0.4 at 1, 2, 3: half the weight is passed at 2. Second case: a weight of three thirds at 7, 1 at 2 and 1 at 1; the
        // middle is 2.
        assert_eq!(weighted_median(vec![(3.0, 0.4), (1.0, 0.3), (2.0, 0.3)]), Some(2.0));
        let third = 1.0 / 3.0;
        assert_eq!(weighted_median(vec![(7.0, third), (7.0, third), (7.0, third), (1.0, 1.0), (2.0, 1.0)]), Some(2.0));
    }

    #[test]
    fn the_form_by_field_takes_each_field_s_own_median() {
        // Distances by model and field: 1 and 3, 5 and 7, 9 and 0. Medians of all: 5 and 3, mean 4; with model 2 dropped from field 0
        // and model 1 from field 1: of 1, 5 and of 3, 0: 3 and 1.5, mean 2.25.
        let model = |a: f64, b: f64| DisplacementFields::from_vectors(1, &[Vector2::new(a, 0.0), Vector2::new(0.0, b)]);
        let models = [model(1.0, 3.0), model(5.0, 7.0), model(9.0, 0.0)];
        let center = model(0.0, 0.0);
        assert_eq!(field_dispersion(&models, &[vec![0, 1, 2], vec![0, 1, 2]], &center, None), Some(4.0));
        assert_eq!(field_dispersion(&models, &[vec![0, 1], vec![0, 2]], &center, None), Some(2.25));
    }

    #[test]
    fn models_count_over_the_fields_they_were_kept_in() {
        // One node, two fields, centre at rest. Distances by field: 1 and 3, 5 and 7, 9 and 0.
        let model = |a: f64, b: f64| DisplacementFields::from_vectors(1, &[Vector2::new(a, 0.0), Vector2::new(0.0, b)]);
        let models = [model(1.0, 3.0), model(5.0, 7.0), model(9.0, 0.0)];
        let center = model(0.0, 0.0);
        let all = KeptFields::by_model(&[vec![0, 1, 2], vec![0, 1, 2]], 3);
        assert_eq!(all.distances(&models, &center), [Some(2.0), Some(6.0), Some(4.5)]);
        assert_eq!(all.node_dispersion(&models, &center, None), [4.5]);
        // Model 1, at 6, has more than half of the weight.
        assert_eq!(all.node_dispersion(&models, &center, Some(&[1.0, 3.0, 1.0])), [6.0]);
        // Model 2 is dropped from field 0, model 1 from both.
        let trimmed = KeptFields::by_model(&[vec![0], vec![0, 2]], 3);
        assert_eq!(trimmed.distances(&models, &center), [Some(2.0), None, Some(0.0)]);
        // Median of 2 and 0.
        assert_eq!(trimmed.node_dispersion(&models, &center, None), [1.0]);
    }
}
