//! Report data on the variation among people: components as moving faces, and bands around curves.

use nalgebra::Vector2;
use serde_json::{Value, json};

use super::{
    covariates,
    numbers::{length, rounded},
};
use crate::{
    model::DynamicExpressionModel,
    statistics::{
        covariate::Covariate,
        variation::{Band, Variation},
    },
    units::{FaceUnit, NodeId},
};

/// Number of components shown.
const SHOWN: usize = 3;

/// A curve over the frames with the band of the people's values.
#[derive(Clone, Debug, PartialEq)]
pub struct BandCurve {
    /// Its quantity, such as `FAP 12 raise_l_cornerlip` or `node 31`.
    pub label: String,
    /// Unit of its values.
    pub unit: String,
    /// By frame: the representative's value, and the band.
    pub values: Vec<(f64, Band)>,
}

/// Variation among the people of one emotion.
#[derive(Clone, Debug, PartialEq)]
pub struct VariationData<'a> {
    /// Mean and components; `None` with too few people.
    pub variation: Option<&'a Variation>,
    /// Curves with bands, in the order of the menu.
    pub bands: Vec<BandCurve>,
}

/// Offsets of the live nodes of a model from neutral in one frame, x and y alternating, face units.
pub(super) fn offsets_of(model: &DynamicExpressionModel<FaceUnit>, frame: usize, live: &[NodeId]) -> Vec<f64> {
    let all = model.neutral_offsets(frame);
    live.iter().flat_map(|n| [all[n.index()].x, all[n.index()].y]).collect()
}

/// Data for the page's script: offsets by frame, x and y alternating, in the format of the representatives. `along` are the tested numbers,
/// which follow the components.
pub(super) fn payload(data: &VariationData<'_>, along: &[(&str, &Covariate)], live: &[NodeId]) -> Value {
    let mean = |model: &DynamicExpressionModel<FaceUnit>| {
        let of_frame = |m: usize| offsets_of(model, m, live).into_iter().map(length).collect::<Vec<_>>();
        (1..model.frame_count()).map(of_frame).collect::<Vec<_>>()
    };
    let offsets = |offsets: &[Vector2<f64>]| offsets.iter().flat_map(|o| [length(o.x), length(o.y)]).collect::<Vec<_>>();
    let components = |v: &Variation| {
        let of = |c: &crate::statistics::variation::Component| json!({ "share": rounded(c.share, 4), "offsets": c.offsets.iter().map(|o| offsets(o)).collect::<Vec<_>>() });
        let along = along.iter().map(|(column, test)| covariates::payload(column, test, live));
        v.components.iter().take(SHOWN).map(of).chain(along).collect::<Vec<_>>()
    };
    let band = |curve: &BandCurve| {
        let of = |(value, band): &(f64, Band)| {
            let numbers = [*value, band.mean].into_iter().chain(band.quantiles);
            numbers.map(|v| rounded(v, 2)).collect::<Vec<_>>()
        };
        json!({ "label": curve.label, "unit": curve.unit, "values": curve.values.iter().map(of).collect::<Vec<_>>() })
    };
    json!({
        "mean": data.variation.map(|v| mean(&v.mean)),
        "components": data.variation.map(components).unwrap_or_default(),
        "bands": data.bands.iter().map(band).collect::<Vec<_>>(),
    })
}
