//! Report section on covariates: numbers of the people, such as age, with which expressions may change.

use serde::Serialize;
use serde_json::{Value, json};

use super::{
    ReportData, figures,
    group_tables::WHOLE_FACE,
    groups::{p_value, percent, places},
    numbers::{MISSING, fixed},
    variation::offsets_of,
};
use crate::{
    model::DynamicExpressionModel,
    output::nine_digits,
    statistics::covariate::{AmplitudeSlope, Covariate, NoCovariate},
    units::{FaceUnit, NodeId},
};

/// One emotion and one number.
#[derive(Clone, Debug)]
pub struct CovariateData<'a> {
    /// Emotion.
    pub emotion: &'a str,
    /// Column of the number.
    pub column: &'a str,
    /// Number of people without a value.
    pub unknown: usize,
    /// The test, or the reason why there is none.
    pub outcome: &'a Result<Covariate, NoCovariate>,
    /// Slopes of the amplitudes over the number, by name of the region, the whole face first.
    pub slopes: Vec<(&'static str, &'a AmplitudeSlope)>,
}

impl CovariateData<'_> {
    /// Slope of the whole face's amplitude.
    fn face(&self) -> Option<&AmplitudeSlope> {
        self.slopes.iter().find(|(region, _)| *region == WHOLE_FACE).map(|(_, slope)| *slope)
    }
}

/// The section's text.
#[derive(Serialize)]
pub(super) struct CovariatesView {
    rows: Vec<Row>,
    untested: Vec<String>,
    permutations: usize,
    significance: String,
    has_unknown: bool,
    drawn: bool,
    /// Columns within whose values people exchange their numbers, joined; empty if among all.
    within: String,
}

#[derive(Serialize)]
struct Row {
    emotion: String,
    column: String,
    people: usize,
    unknown: usize,
    number: String,
    share: String,
    chance: String,
    f: String,
    p: String,
    p_either: String,
    changes: bool,
    /// Whether it changes at single nodes only.
    at_nodes: bool,
    /// Smallest possible p, if it exceeds the significance level.
    hopeless: Option<String>,
    place: String,
    direction: String,
    slope: String,
    slope_p: String,
}

impl CovariatesView {
    /// `None` without a covariate.
    pub(super) fn new(data: &ReportData<'_>) -> Option<Self> {
        let significance = data.compare.significance;
        let row = |c: &CovariateData<'_>, t: &Covariate| {
            let changes = t.p_either_adjusted <= significance;
            let live = data.wireframe.live_nodes();
            let clear: Vec<NodeId> = live.iter().zip(&t.node_p).filter(|(_, p)| **p <= significance).map(|(n, _)| *n).collect();
            let described = if clear.is_empty() { live } else { &clear };
            let [low, high] = &t.models;
            // Change of the amplitude between the two numbers for which the expression is shown.
            let reach = t.shown[1] - t.shown[0];
            Row {
                emotion: c.emotion.to_owned(),
                column: c.column.to_owned(),
                people: t.people,
                unknown: c.unknown,
                number: format!("{} \u{b1} {}", nine_digits(round(t.mean)), nine_digits(round(t.deviation))),
                share: percent(t.share),
                chance: percent(t.share_by_chance),
                f: t.f.map_or_else(|| MISSING.to_owned(), |f| fixed(f, 2)),
                p: p_value(t.p),
                p_either: p_value(t.p_either_adjusted),
                changes,
                at_nodes: changes && !t.is_of_whole(significance),
                hopeless: (t.least_either_adjusted > significance).then(|| p_value(t.least_either_adjusted)),
                place: if changes { places((&t.node_p, &t.node_share), data, significance) } else { String::new() },
                direction: if changes {
                    figures::directions(high, low, described, data.tables).join("; ")
                } else {
                    String::new()
                },
                slope: c.face().map_or_else(String::new, |s| {
                    let [a, b] = s.interval.map(|v| fixed(v * reach, 2));
                    format!("{} ({a} to {b})", fixed(s.slope * reach, 2))
                }),
                slope_p: c.face().map_or_else(String::new, |s| p_value(s.p_adjusted)),
            }
        };
        let all = &data.covariates;
        let rows: Vec<Row> = all.iter().filter_map(|c| Some(row(c, c.outcome.as_ref().ok()?))).collect();
        let why = |c: &CovariateData<'_>| c.outcome.as_ref().err().map(|why| format!("{} with {}: {why}", c.emotion, c.column));
        (!all.is_empty()).then(|| Self {
            drawn: all.iter().any(|c| c.outcome.as_ref().is_ok_and(|t| t.used < t.people)),
            within: data.strata.join(", "),
            has_unknown: rows.iter().any(|row| row.unknown > 0),
            rows,
            untested: all.iter().filter_map(why).collect(),
            permutations: data.compare.permutations,
            significance: nine_digits(significance * 100.0),
        })
    }
}

/// Rounds to four digits.
pub(super) fn round(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let scale = 10f64.powi(3 - value.abs().log10().floor() as i32);
    (value * scale).round() / scale
}

/// The tests of an emotion over all its people, for its figure.
pub(super) fn of_emotion<'a>(data: &'a ReportData<'_>, emotion: &str) -> Vec<(&'a str, &'a Covariate)> {
    let tested = |c: &'a CovariateData<'_>| Some((c.column, c.outcome.as_ref().ok()?));
    data.covariates.iter().filter(|c| c.emotion == emotion).filter_map(tested).collect()
}

/// Label of a covariate in the menu of the figure.
pub(super) fn label(column: &str, test: &Covariate) -> String {
    format!("{column}: explains {} of the squared distances (by chance {})", percent(test.share), percent(test.share_by_chance))
}

/// Data for the page's script: offsets of the expression at a low and at a high number from the middle of both, and the numbers.
pub(super) fn payload(column: &str, test: &Covariate, live: &[NodeId]) -> Value {
    let [low, high] = &test.models;
    let half = |m: usize| -> Vec<Value> {
        let side = |model: &DynamicExpressionModel<FaceUnit>| offsets_of(model, m, live);
        side(low).into_iter().zip(side(high)).map(|(low, high)| (high - low) / 2.0).map(super::numbers::length).collect()
    };
    // Position of each from the mean, in halves of the distance between them.
    let reach = (test.shown[1] - test.shown[0]) / 2.0;
    let place = |value: f64| super::numbers::rounded((value - test.mean) / reach, 4);
    json!({
        "offsets": (1..low.frame_count()).map(half).collect::<Vec<_>>(),
        "ends": test.shown.map(place),
        "titles": test.shown.map(|value| format!("{column} {}", nine_digits(round(value)))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_shown_with_four_digits() {
        assert_eq!(
            [27.123_456, 0.000_123_456, 123_456.0, 0.0, -3.5].map(|v| nine_digits(round(v))),
            ["27.12", "0.0001235", "123500", "0", "-3.5"]
        );
    }
}
