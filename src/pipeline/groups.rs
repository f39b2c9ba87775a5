//! Writes the files that compare groups: intervals of their dispersions, and tests between them.

use std::path::Path;

use super::{AnalyzedClass, Workbench, write::Wrote};
use crate::{
    output::{OutputError, nine_digits, write_records},
    statistics::{
        bootstrap::{DispersionInterval, no_interval},
        compare::{Comparisons, OmnibusComparison, group_values},
    },
};

/// Columns of `intervals.csv` before those of the groups.
const INTERVAL_COLUMNS: [&str; 9] =
    ["emotion", "subjects", "sequences", "dispersion", "low", "high", "level", "replicates", "method"];

/// Files that [`write_groups`] writes.
pub(super) const GROUP_TABLES: [&str; 4] = ["intervals.csv", "comparisons.csv", "group_tests.csv", "comparison_nodes.csv"];

/// Writes [`GROUP_TABLES`] into `out`. Calls `wrote` after each file.
pub(super) fn write_groups(
    out: &Path,
    classes: &[AnalyzedClass],
    comparisons: &Comparisons,
    bench: &Workbench,
    wrote: &mut Wrote<'_>,
) -> Result<(), OutputError> {
    let (by, replicates) = (&bench.options.by, bench.options.groups.bootstrap);
    let strata = bench.options.strata.join(", ");
    let group_names = || by.iter().map(|name| format!("group_{name}"));
    let optional = |value: Option<f64>| value.map(nine_digits).unwrap_or_default();

    let header: Vec<String> = INTERVAL_COLUMNS
        .map(str::to_owned)
        .into_iter()
        .chain(group_names())
        .chain(["no_interval".to_owned()])
        .chain(by.iter().filter(|name| !INTERVAL_COLUMNS.contains(&name.as_str())).cloned())
        .collect();
    let rows = classes.iter().map(|class| {
        let r = &class.representative;
        let interval = class.interval.as_ref();
        let method = interval.map_or("", |_: &DispersionInterval| "half-sampling");
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
        let value = |column: &String| r.label.group.get(column).cloned().unwrap_or_default();
        row.extend(by.iter().map(value));
        row.push(if interval.is_some() { String::new() } else { no_interval(class.subjects, replicates).unwrap_or_default() });
        row.extend(by.iter().filter(|name| !INTERVAL_COLUMNS.contains(&name.as_str())).map(value));
        row
    });
    wrote("intervals.csv", write_records(&out.join("intervals.csv"), &header, rows)?)?;

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
            "least_p_holm",
            "p_max_node",
            "p_either",
            "p_either_holm",
            "strata",
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
                row.extend([String::new(), nine_digits(t.least_p_adjusted)]);
                row.extend([t.least_node_p(), t.p_either, t.p_either_adjusted].map(nine_digits));
            }
            Err(why) => {
                row.extend(std::iter::repeat_n(String::new(), 10));
                row.push(why.to_string());
                row.extend(std::iter::repeat_n(String::new(), 4));
            }
        }
        row.push(strata.clone());
        row
    });
    wrote("comparisons.csv", write_records(&out.join("comparisons.csv"), &header, rows)?)?;
    wrote("group_tests.csv", write_omnibus(&out.join("group_tests.csv"), &comparisons.omnibus)?)?;

    let header = ["emotion", "group_a", "group_b", "node", "energy", "p"].map(str::to_owned);
    let rows = comparisons.pairs.iter().filter_map(|pair| Some((pair, pair.outcome.as_ref().ok()?))).flat_map(|(pair, t)| {
        let nodes = bench.wireframe.live_nodes().iter().zip(t.node_energy.iter().zip(&t.node_p));
        nodes.map(move |(node, (&energy, &p))| {
            let names =
                vec![pair.emotion.clone(), group_values(&pair.groups[0]), group_values(&pair.groups[1]), node.to_string()];
            [names, vec![nine_digits(energy), nine_digits(p)]].concat()
        })
    });
    wrote("comparison_nodes.csv", write_records(&out.join("comparison_nodes.csv"), &header, rows)?)
}

/// Writes `group_tests.csv`: one test over all groups of an emotion per row; group values are joined by `; `.
fn write_omnibus(path: &Path, comparisons: &[OmnibusComparison]) -> Result<blake3::Hash, OutputError> {
    let header = [
        "emotion",
        "groups",
        "subjects",
        "location_f",
        "location_share",
        "location_p",
        "location_p_holm",
        "scatters",
        "scatter_f",
        "scatter_p",
        "scatter_p_holm",
        "permutations",
        "not_tested",
        "exhaustive",
        "left_out",
    ];
    let joined = |texts: Vec<String>| texts.join("; ");
    let rows = comparisons.iter().map(|c| {
        let mut row = vec![c.emotion.clone(), joined(c.groups.iter().map(group_values).collect())];
        match &c.outcome {
            Ok(t) => {
                row.push(joined(t.people.iter().map(ToString::to_string).collect()));
                row.extend([t.location_f, t.location_share, t.location_p, t.location_p_adjusted].map(nine_digits));
                row.push(joined(t.scatters.iter().copied().map(nine_digits).collect()));
                row.extend([t.scatter_f, t.scatter_p, t.scatter_p_adjusted].map(nine_digits));
                row.extend([t.permutations.to_string(), String::new(), t.exhaustive.to_string()]);
            }
            Err(why) => {
                row.extend(std::iter::repeat_n(String::new(), header.len() - 5));
                row.extend([why.clone(), String::new()]);
            }
        }
        row.push(joined(c.left_out.iter().map(group_values).collect()));
        row
    });
    write_records(path, header, rows)
}
