//! Report section on groups: intervals, tests, differences between groups, and reasons for doubt.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Value, json};

use super::{
    GroupsData, ReportData, figures,
    group_tables::{AmplitudeTable, OmnibusTable},
    numbers::{fixed, fixed_or_dash, length, rounded},
    view::{Fields, group_text},
};
use crate::{
    output::{count, nine_digits},
    statistics::compare::{Comparison, Comparisons, Tested, group_values},
    units::NodeId,
};

/// Number of people below which a group is marked as small.
const SMALL_GROUP: usize = 10;

/// Most figures of pairs that differ; the tables have all pairs.
const MOST_PICTURES: usize = 12;

/// Most regions of nodes named in a row.
const NAMED_NODES: usize = 6;

/// The section's text.
#[derive(Serialize)]
pub(super) struct GroupsView {
    rows: Vec<GroupRow>,
    tests: Vec<TestRow>,
    untested: Vec<String>,
    too_many: Vec<String>,
    amplitudes: AmplitudeTable,
    omnibus: OmnibusTable,
    pictures: Vec<Picture>,
    more_pictures: usize,
    test_count: String,
    tests_made: usize,
    differing: usize,
    permutations: usize,
    /// Columns within whose values people are exchanged, joined; empty if among all.
    within: String,
    replicates: usize,
    significance: String,
    significance_percent: String,
    /// Notes under the tables, in the words of the template.
    notes: Vec<&'static str>,
    small_group: usize,
}

#[derive(Serialize)]
struct GroupRow {
    emotion: String,
    group: String,
    people: usize,
    sequences: usize,
    dispersion: String,
    interval: String,
    small: bool,
}

#[derive(Serialize)]
struct TestRow {
    emotion: String,
    groups: [String; 2],
    people: String,
    small: bool,
    energy: String,
    effect: String,
    chance: String,
    p: String,
    p_holm: String,
    p_either: String,
    verdict: &'static str,
    differs: bool,
    hopeless: bool,
    least_p: String,
    place: String,
    /// Description of how the first group differs from the second at the apex.
    direction: String,
}

#[derive(Serialize)]
struct Picture {
    index: usize,
    label: String,
    a: String,
    b: String,
    nodes: usize,
    live: usize,
    place: String,
    direction: String,
    /// Map of the differences.
    map: String,
    /// What the test shows, with p.
    result: String,
}

impl GroupsView {
    pub(super) fn new(groups: &GroupsData<'_>, data: &ReportData<'_>, fields: &Fields) -> Self {
        let significance = groups.options.compare.significance;
        let comparisons = groups.comparisons;
        let tested: Vec<(usize, &Comparison, &Tested)> =
            comparisons.pairs.iter().enumerate().filter_map(|(k, c)| Some((k, c, c.outcome.as_ref().ok()?))).collect();
        let rows: Vec<GroupRow> = data
            .representatives
            .iter()
            .zip(&groups.classes)
            .map(|(r, &(people, interval))| GroupRow {
                emotion: r.label.emotion.clone(),
                group: group_text(&r.label),
                people,
                sequences: r.sequences.len(),
                dispersion: fixed_or_dash(r.dispersion, 2),
                interval: interval.map_or_else(
                    || if r.dispersion.is_some() { "too few people".to_owned() } else { String::new() },
                    |i| format!("{} to {}", fixed(i.low, 2), fixed(i.high, 2)),
                ),
                small: people < SMALL_GROUP,
            })
            .collect();
        let tests_made = tested.len();
        let differs = |t: &Tested| groups_differ(t, significance);
        let place = |t: &Tested| places((&t.node_p, &t.node_energy), data, significance);
        let direction = |c: &Comparison, t: &Tested| directions_of(c, t, data, significance);
        let tests = tested.iter().map(|(_, c, t)| TestRow {
            emotion: c.emotion.clone(),
            groups: [group_values(&c.groups[0]), group_values(&c.groups[1])],
            people: format!("{} and {}", c.people[0], c.people[1]),
            small: c.people.iter().any(|&n| n < SMALL_GROUP),
            energy: fixed(t.energy, 2),
            effect: percent(t.effect),
            chance: percent(t.effect_by_chance),
            p: p_text(t.p, t.least_p),
            p_holm: p_text(t.p_adjusted, 0.0),
            p_either: p_text(t.p_either_adjusted, 0.0),
            verdict: match (differs(t), t.is_of_whole(significance)) {
                (true, true) => "differ",
                (true, false) => "differ at single nodes",
                _ => "not shown to differ",
            },
            differs: differs(t),
            hopeless: t.least_either_adjusted() > significance,
            least_p: p_text(t.least_either_adjusted(), 0.0),
            place: if differs(t) { place(t) } else { String::new() },
            direction: if differs(t) { direction(c, t) } else { String::new() },
        });
        let tests: Vec<TestRow> = tests.collect();
        let drawn: Vec<_> = tested.iter().filter(|(_, _, t)| differs(t)).collect();
        let pictures = drawn.iter().take(MOST_PICTURES).map(|(k, c, t)| Picture {
            index: *k,
            label: c.emotion.clone(),
            a: group_values(&c.groups[0]),
            b: group_values(&c.groups[1]),
            nodes: t.node_p.iter().filter(|&&p| p <= significance).count(),
            live: t.node_p.len(),
            place: place(t),
            direction: direction(c, t),
            map: map_of(c, t, data, significance, fields),
            result: match (percent(t.effect), p_text(t.p_either_adjusted, 0.0)) {
                (effect, p) if t.is_of_whole(significance) => format!("effect {effect}, corrected p {p}"),
                (_, p) => {
                    let whole = p_text(t.p_adjusted, 0.0);
                    format!("different at single nodes (corrected p {p}); as a whole not shown (corrected p {whole})")
                }
            },
        });
        let notes = [
            ("drawn", tested.iter().any(|(_, c, t)| t.people_used != c.people)),
            ("unknown", comparisons.unknown_left_out),
            ("small", rows.iter().any(|row| row.small)),
        ];
        let notes = notes.into_iter().filter(|(_, holds)| *holds).map(|(note, _)| note).collect();
        Self {
            amplitudes: AmplitudeTable::new(groups, significance),
            omnibus: OmnibusTable::new(comparisons, significance),
            untested: untested(comparisons),
            too_many: comparisons.too_many.iter().map(|(emotion, n)| format!("{emotion} ({n} groups)")).collect(),
            more_pictures: drawn.len().saturating_sub(MOST_PICTURES),
            pictures: pictures.collect(),
            test_count: count(tests_made, "test", "tests"),
            tests_made,
            differing: drawn.len(),
            permutations: groups.options.compare.permutations,
            within: data.strata.join(", "),
            replicates: groups.options.bootstrap,
            significance: format!("{significance}"),
            significance_percent: nine_digits(significance * 100.0),
            small_group: SMALL_GROUP,
            notes,
            rows,
            tests,
        }
    }
}

/// Reasons why pairs and emotions are not tested; pairs with the same reason are joined.
fn untested(comparisons: &Comparisons) -> Vec<String> {
    let mut reasons: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for c in &comparisons.pairs {
        if let Err(why) = &c.outcome {
            let pair = format!("{}: {} and {}", c.emotion, group_values(&c.groups[0]), group_values(&c.groups[1]));
            reasons.entry(why.to_string()).or_default().push(pair);
        }
    }
    let of_pairs = reasons.into_iter().map(|(why, pairs)| {
        let shown = pairs.iter().take(8).cloned().collect::<Vec<_>>().join("; ");
        let more = if pairs.len() > 8 { format!("; and {} more", pairs.len() - 8) } else { String::new() };
        format!("{shown}{more}: {why}")
    });
    of_pairs.chain(comparisons.one_group.iter().map(|one| format!("{}: {}", one.emotion, one.reason()))).collect()
}

/// Whether two groups differ significantly, as a whole or at a node: docs/populations.md, "Verdict".
fn groups_differ(t: &Tested, significance: f64) -> bool {
    t.p_either_adjusted <= significance
}

/// Description of how the apex of the first group differs from the second's, by part of the face; empty if a representative is missing.
fn directions_of(c: &Comparison, t: &Tested, data: &ReportData<'_>, significance: f64) -> String {
    let model = |group: &BTreeMap<String, String>| {
        data.representatives.iter().find(|r| r.label.emotion == c.emotion && r.label.group == *group).map(|r| &r.model)
    };
    let (Some(a), Some(b)) = (model(&c.groups[0]), model(&c.groups[1])) else { return String::new() };
    let live = data.wireframe.live_nodes();
    let differing: Vec<NodeId> = live.iter().zip(&t.node_p).filter(|(_, p)| **p <= significance).map(|(n, _)| *n).collect();
    let described = if differing.is_empty() { live } else { &differing };
    figures::directions(a, b, described, data.tables).join("; ")
}

/// Map of the differences between two groups on the neutral of the first; empty if its representative is missing.
fn map_of(c: &Comparison, t: &Tested, data: &ReportData<'_>, significance: f64, drawn: &Fields) -> String {
    let first = data.representatives.iter().find(|r| r.label.emotion == c.emotion && r.label.group == c.groups[0]);
    let Some(first) = first else { return String::new() };
    let live = data.wireframe.live_nodes();
    let energies: BTreeMap<NodeId, f64> = live.iter().copied().zip(t.node_energy.iter().map(|e| e.max(0.0))).collect();
    let energy = |n: NodeId| energies.get(&n).copied().unwrap_or(0.0);
    let differing: Vec<NodeId> = live.iter().zip(&t.node_p).filter(|(_, p)| **p <= significance).map(|(n, _)| *n).collect();
    let span = (0.0, figures::range(&energy, &drawn.lines).1);
    let map = figures::map(&first.model, &energy, span, &differing, drawn.within, &drawn.lines);
    let names = c.groups.each_ref().map(group_values);
    map.inline("heat", &format!("Energy distance per node between {} and {}", names[0], names[1]))
}

/// An effect in percent. A negative estimate of a non-negative quantity is shown as 0.
pub(super) fn percent(share: f64) -> String {
    format!("{} %", fixed(share.max(0.0) * 100.0, 1))
}

/// A p value with three decimals, below 0.001 with two digits: it is never 0.
pub fn p_value(p: f64) -> String {
    const MOST_DECIMALS: usize = 12;
    if p >= 0.9995 {
        return "1".to_owned();
    }
    let decimals = if p < 0.001 && p > 0.0 { (1.0 - p.log10().floor()) as usize } else { 3 };
    fixed(p, decimals.min(MOST_DECIMALS))
}

/// A p value; the smallest possible one has the prefix `≤`.
fn p_text(p: f64, least: f64) -> String {
    let text = p_value(p);
    if least > 0.0 && p <= least { format!("{text} (least possible)") } else { text }
}

/// Parts of the face with significant nodes, by p and size of the difference, the largest first.
pub(super) fn places((p, much): (&[f64], &[f64]), data: &ReportData<'_>, significance: f64) -> String {
    let live = data.wireframe.live_nodes();
    let mut nodes: Vec<(f64, NodeId)> =
        live.iter().zip(p.iter().zip(much)).filter(|(_, (p, _))| **p <= significance).map(|(n, (_, much))| (*much, *n)).collect();
    nodes.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    if nodes.is_empty() {
        return "no single node stands out".to_owned();
    }
    let mut counts: Vec<(String, usize)> = Vec::new();
    for (_, node) in &nodes {
        let region = data.tables.region(*node).to_string();
        match counts.iter_mut().find(|(name, _)| *name == region) {
            Some((_, count)) => *count += 1,
            None => counts.push((region, 1)),
        }
    }
    let shown: Vec<String> = counts.iter().take(NAMED_NODES).map(|(name, n)| format!("{name} ({n})")).collect();
    shown.join(", ")
}

/// Data of the pairs with figures, for the page's script: representatives, energies and the nodes that differ.
pub(super) fn payload(groups: &GroupsData<'_>, data: &ReportData<'_>) -> Value {
    let significance = groups.options.compare.significance;
    let place = |emotion: &str, group: &BTreeMap<String, String>| {
        data.representatives.iter().position(|r| r.label.emotion == emotion && r.label.group == *group)
    };
    let pairs = groups.comparisons.pairs.iter().enumerate().filter_map(|(k, c)| {
        let t = c.outcome.as_ref().ok().filter(|t| groups_differ(t, significance))?;
        let differing: Vec<usize> = (0..t.node_p.len()).filter(|&k| t.node_p[k] <= significance).collect();
        let pair = json!({
            "a": place(&c.emotion, &c.groups[0])?,
            "b": place(&c.emotion, &c.groups[1])?,
            "names": [group_values(&c.groups[0]), group_values(&c.groups[1])],
            "energy": t.node_energy.iter().map(|&e| length(e.max(0.0))).collect::<Vec<_>>(),
            "p": t.node_p.iter().map(|&p| rounded(p, 8)).collect::<Vec<_>>(),
            "differing": differing,
        });
        Some((k.to_string(), pair))
    });
    Value::Object(pairs.take(MOST_PICTURES).collect())
}
