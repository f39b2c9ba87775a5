//! The files of groups beside each other: intervals of their dispersions, and tests between them.

use std::path::Path;

use super::AnalyzedClass;
use crate::{
    output::{OutputError, nine_digits, write_records},
    statistics::{
        bootstrap::DispersionInterval,
        compare::{Comparisons, group_values},
    },
    wireframe::Wireframe,
};

/// Writes `intervals.csv`, `comparisons.csv` and `comparison_nodes.csv` into `out`; returns their names.
pub(super) fn write_groups(
    out: &Path,
    classes: &[AnalyzedClass],
    comparisons: &Comparisons,
    wireframe: &Wireframe,
    by: &[String],
) -> Result<Vec<String>, OutputError> {
    let group_names = || by.iter().map(|name| format!("group_{name}"));
    let optional = |value: Option<f64>| value.map(nine_digits).unwrap_or_default();

    let header: Vec<String> = ["emotion", "subjects", "sequences", "dispersion", "low", "high", "level", "replicates", "method"]
        .map(str::to_owned)
        .into_iter()
        .chain(group_names())
        .collect();
    let rows = classes.iter().map(|class| {
        let r = &class.representative;
        let interval = class.interval.as_ref();
        let method = interval.map_or("", |i: &DispersionInterval| if i.retrimmed { "basic" } else { "basic, median held" });
        let mut row = vec![
            r.label.emotion.clone(),
            class.subjects.to_string(),
            r.sequences.len().to_string(),
            optional(r.dispersion),
            optional(interval.map(|i| i.low)),
            optional(interval.map(|i| i.high)),
            optional(interval.map(|i| i.level)),
            interval.map(|i| i.replicates.to_string()).unwrap_or_default(),
            method.to_owned(),
        ];
        row.extend(by.iter().map(|column| r.label.group.get(column).cloned().unwrap_or_default()));
        row
    });
    write_records(&out.join("intervals.csv"), &header, rows)?;

    let header: Vec<String> = ["emotion", "group_a", "group_b", "subjects_a", "subjects_b", "sequences_a", "sequences_b"]
        .into_iter()
        .chain([
            "energy",
            "effect",
            "effect_by_chance",
            "p",
            "p_holm",
            "least_p",
            "permutations",
            "exhaustive",
            "used_a",
            "used_b",
            "not_tested",
        ])
        .map(str::to_owned)
        .collect();
    let rows = comparisons.pairs.iter().map(|pair| {
        let mut row = vec![pair.emotion.clone(), group_values(&pair.groups[0]), group_values(&pair.groups[1])];
        row.extend(pair.people.iter().chain(&pair.sequences).map(ToString::to_string));
        match &pair.outcome {
            Ok(t) => {
                row.extend([t.energy, t.effect, t.effect_by_chance, t.p, t.p_adjusted, t.least_p].map(nine_digits));
                row.extend([t.permutations.to_string(), t.exhaustive.to_string()]);
                row.extend(t.people_used.map(|n| n.to_string()));
                row.push(String::new());
            }
            Err(why) => {
                row.extend(std::iter::repeat_n(String::new(), 10));
                row.push(why.to_string());
            }
        }
        row
    });
    write_records(&out.join("comparisons.csv"), &header, rows)?;

    let header = ["emotion", "group_a", "group_b", "node", "energy", "p"].map(str::to_owned);
    let rows = comparisons.pairs.iter().filter_map(|pair| Some((pair, pair.outcome.as_ref().ok()?))).flat_map(|(pair, t)| {
        let nodes = wireframe.live_nodes().iter().zip(t.node_energy.iter().zip(&t.node_p));
        nodes.map(move |(node, (&energy, &p))| {
            let names =
                vec![pair.emotion.clone(), group_values(&pair.groups[0]), group_values(&pair.groups[1]), node.to_string()];
            [names, vec![nine_digits(energy), nine_digits(p)]].concat()
        })
    });
    write_records(&out.join("comparison_nodes.csv"), &header, rows)?;
    Ok(["intervals.csv", "comparisons.csv", "comparison_nodes.csv"].map(str::to_owned).to_vec())
}
