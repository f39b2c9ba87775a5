//! Dispersion of models around their generalized median [KP, eq. (8)].
//!
//! After trimming a model counts over the displacement fields it was kept in: its distance is the mean of `d_f` over these.

use super::distance::{DisplacementFields, vector_distance};

pub use crate::robust::median;

/// Which of the models are kept in which displacement fields.
#[derive(Clone, Debug)]
pub struct KeptFields {
    /// Fields by model, ascending.
    fields: Vec<Vec<usize>>,
}

impl KeptFields {
    /// The same information by model, from the kept models by field (`Trimming::kept`).
    pub fn by_model(kept: &[Vec<usize>], model_count: usize) -> Self {
        let mut fields = vec![Vec::new(); model_count];
        for (m, kept) in kept.iter().enumerate() {
            kept.iter().for_each(|&i| fields[i].push(m));
        }
        Self { fields }
    }

    /// Distance of every model to `center`: the mean of `d_f` over the fields it was kept in; `None` where that is no field.
    ///
    /// For a model kept in all fields this is d [KP, eq. (5)].
    pub fn distances(&self, models: &[DisplacementFields], center: &DisplacementFields) -> Vec<Option<f64>> {
        let distance = |(model, fields): (&DisplacementFields, &Vec<usize>)| {
            let sum: f64 = fields.iter().map(|&m| model.frame_distance(center, m)).sum();
            (!fields.is_empty()).then(|| sum / fields.len() as f64)
        };
        models.iter().zip(&self.fields).map(distance).collect()
    }

    /// Dispersion of every live node: the median over the models of the mean of `d_v` to `center` over the fields kept.
    pub fn node_dispersion(&self, models: &[DisplacementFields], center: &DisplacementFields) -> Vec<f64> {
        let at_node = |k: usize| {
            let of_model = |(model, fields): (&DisplacementFields, &Vec<usize>)| {
                let sum: f64 = fields.iter().map(|&m| vector_distance(model.vector(m, k), center.vector(m, k))).sum();
                (!fields.is_empty()).then(|| sum / fields.len() as f64)
            };
            let mut means: Vec<f64> = models.iter().zip(&self.fields).filter_map(of_model).collect();
            median(&mut means).unwrap_or(0.0)
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
    fn models_count_over_the_fields_they_were_kept_in() {
        // One node, two fields, centre at rest. Distances by field: 1 and 3, 5 and 7, 9 and 0.
        let model = |a: f64, b: f64| DisplacementFields::from_vectors(1, &[Vector2::new(a, 0.0), Vector2::new(0.0, b)]);
        let models = [model(1.0, 3.0), model(5.0, 7.0), model(9.0, 0.0)];
        let center = model(0.0, 0.0);
        let all = KeptFields::by_model(&[vec![0, 1, 2], vec![0, 1, 2]], 3);
        assert_eq!(all.distances(&models, &center), [Some(2.0), Some(6.0), Some(4.5)]);
        assert_eq!(all.node_dispersion(&models, &center), [4.5]);
        // Model 2 is dropped from field 0, model 1 from both.
        let trimmed = KeptFields::by_model(&[vec![0], vec![0, 2]], 3);
        assert_eq!(trimmed.distances(&models, &center), [Some(2.0), None, Some(0.0)]);
        // Median of 2 and 0.
        assert_eq!(trimmed.node_dispersion(&models, &center), [1.0]);
    }
}
