//! Groups beside each other: intervals of their dispersions, tests between them, and the files of both.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use serde::{Deserialize, Serialize};

use super::{AnalyzedClass, classes::listed};
use crate::{
    output::{OutputError, count, nine_digits, write_records},
    statistics::{
        ClassLabel, SequenceModel, UNKNOWN_GROUP,
        amplitude::AmplitudeOptions,
        bootstrap::{DispersionInterval, no_interval},
        compare::{CompareOptions, Comparison, OmnibusComparison, Strata, Tested, adjust, adjust_omnibus, compare, omnibus},
    },
    units::NodeId,
    wireframe::Wireframe,
};

/// Replicates of a bootstrap where nothing else is asked for.
const BOOTSTRAP_REPLICATES: usize = 1000;

/// Groups of one emotion above which none are compared: 50 make 1,225 pairs.
pub const MAX_COMPARED_GROUPS: usize = 50;

/// Options of groups.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroupOptions {
    /// Tests between groups.
    pub compare: CompareOptions,
    /// Replicates of the bootstrap of every dispersion; 0 for none. Without groups there is no bootstrap.
    pub bootstrap: usize,
    /// Comparisons of amplitudes.
    #[serde(default)]
    pub amplitude: AmplitudeOptions,
}

impl Default for GroupOptions {
    fn default() -> Self {
        Self { compare: CompareOptions::default(), bootstrap: BOOTSTRAP_REPLICATES, amplitude: AmplitudeOptions::default() }
    }
}

/// What was compared, and what was not.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Comparisons {
    /// All pairs of groups of every emotion, by emotion, then in the order of the groups; corrected for their number.
    pub pairs: Vec<Comparison>,
    /// Emotions with too many groups to compare, with the number of groups.
    pub too_many: Vec<(String, usize)>,
    /// Whether people without a value were left out.
    pub unknown_left_out: bool,
    /// All groups of each emotion at once; corrected for their number.
    #[serde(default)]
    pub omnibus: Vec<OmnibusComparison>,
}

/// Whether a class is of people whose value is known in every column.
pub(super) fn is_known(label: &ClassLabel) -> bool {
    !label.group.is_empty() && label.group.values().all(|value| value != UNKNOWN_GROUP)
}

/// Random stream of a class or a pair of classes: it depends on their names alone, so that neither other groups nor the order in which
/// emotions are worked on change a result.
pub(super) fn stream_of(labels: &[(&str, &BTreeMap<String, String>)]) -> u32 {
    let hash = blake3::hash(&serde_json::to_vec(labels).unwrap_or_default());
    let bytes = hash.as_bytes();
    // Half the range: the bootstrap has the other.
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) >> 1
}

/// Compares every two groups of one emotion; the p values are not corrected yet.
pub(super) fn compare_groups(
    emotion: &str,
    groups: &[(ClassLabel, Vec<&SequenceModel>)],
    live: &[NodeId],
    options: &GroupOptions,
    strata: Option<&Strata>,
) -> Comparisons {
    let mut all = Comparisons::default();
    let grouped = groups.iter().filter(|(label, _)| !label.group.is_empty());
    let (known, unknown): (Vec<_>, Vec<_>) = grouped.partition(|(label, _)| is_known(label));
    all.unknown_left_out = !unknown.is_empty();
    if known.len() > MAX_COMPARED_GROUPS {
        all.too_many.push((emotion.to_owned(), known.len()));
        return all;
    }
    if known.len() > 1 {
        let labels: Vec<(&str, &BTreeMap<String, String>)> = known.iter().map(|(label, _)| (emotion, &label.group)).collect();
        let members: Vec<Vec<&SequenceModel>> = known.iter().map(|(_, models)| models.clone()).collect();
        all.omnibus.push(OmnibusComparison {
            emotion: emotion.to_owned(),
            groups: known.iter().map(|(label, _)| label.group.clone()).collect(),
            outcome: omnibus(&members, live, &options.compare, strata, stream_of(&labels)),
        });
    }
    let people = |models: &[&SequenceModel]| models.iter().map(|m| m.id.subject.as_str()).collect::<BTreeSet<_>>().len();
    for (i, (a, of_a)) in known.iter().enumerate() {
        for (b, of_b) in &known[i + 1..] {
            let stream = stream_of(&[(emotion, &a.group), (emotion, &b.group)]);
            all.pairs.push(Comparison {
                emotion: emotion.to_owned(),
                groups: [a.group.clone(), b.group.clone()],
                people: [people(of_a), people(of_b)],
                sequences: [of_a.len(), of_b.len()],
                outcome: compare(of_a, of_b, live, &options.compare, strata, stream),
            });
        }
    }
    all
}

impl Comparisons {
    /// Those of all emotions, corrected for their number.
    pub(super) fn together(parts: impl IntoIterator<Item = Self>) -> Self {
        let mut all = Self::default();
        for part in parts {
            all.pairs.extend(part.pairs);
            all.omnibus.extend(part.omnibus);
            all.too_many.extend(part.too_many);
            all.unknown_left_out |= part.unknown_left_out;
        }
        adjust(&mut all.pairs);
        adjust_omnibus(&mut all.omnibus);
        all
    }

    /// Tests made.
    pub fn tests(&self) -> usize {
        self.pairs.iter().filter(|pair| pair.outcome.is_ok()).count()
    }

    /// What a person should know, at most one line of each kind.
    pub(super) fn warnings(&self, significance: f64) -> Vec<String> {
        let mut warnings = Vec::new();
        warnings.extend(self.hopeless(significance));
        let untested: Vec<String> = self
            .pairs
            .iter()
            .filter_map(|pair| pair.outcome.as_ref().err().map(|why| (pair, why)))
            .map(|(pair, why)| format!("{}: {} and {} ({why})", pair.emotion, values(&pair.groups[0]), values(&pair.groups[1])))
            .collect();
        if !untested.is_empty() {
            warnings.push(format!("not tested: {}", listed(&untested, 5)));
        }
        if !self.too_many.is_empty() {
            let list: Vec<String> = self.too_many.iter().map(|(emotion, groups)| format!("{emotion} has {groups}")).collect();
            warnings
                .push(format!("more than {MAX_COMPARED_GROUPS} groups are not compared with each other: {}", list.join(", ")));
        }
        if self.unknown_left_out && !self.pairs.is_empty() {
            warnings.push(format!("people without a value are the group `{UNKNOWN_GROUP}`, which is compared with nobody"));
        }
        warnings
    }
}

impl Comparisons {
    /// The warning that tests can not find anything, and what would help.
    fn hopeless(&self, significance: f64) -> Option<String> {
        let tested: Vec<&Tested> = self.pairs.iter().filter_map(|pair| pair.outcome.as_ref().ok()).collect();
        let hopeless: Vec<&&Tested> = tested.iter().filter(|t| t.least_p_adjusted > significance).collect();
        let first = hopeless.first()?;
        let tests = tested.len();
        let drawn = hopeless.iter().filter(|t| !t.exhaustive).count();
        let mut helps = Vec::new();
        if drawn > 0 {
            // One of drawn + 1 times the number of tests is at most the significance.
            helps.push(format!("--permutations {} or more", (tests as f64 / significance).ceil() as usize));
        }
        if drawn < hopeless.len() {
            helps.push("more people in groups whose splits are all tried".to_owned());
        }
        helps.push("fewer groups to compare".to_owned());
        Some(format!(
            "{} of {} can not reject at {significance} after Holm's correction for their number, whatever the data (least p {}, corrected {}); what would help: {}",
            hopeless.len(),
            count(tests, "test", "tests"),
            nine_digits(first.least_p),
            nine_digits(first.least_p_adjusted),
            helps.join(", ")
        ))
    }
}

/// The values of a group, joined.
pub(crate) fn values(group: &BTreeMap<String, String>) -> String {
    group.values().map(String::as_str).collect::<Vec<_>>().join(" + ")
}

/// Columns of `intervals.csv` before those of the groups.
const INTERVAL_COLUMNS: [&str; 9] =
    ["emotion", "subjects", "sequences", "dispersion", "low", "high", "level", "replicates", "method"];

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
        let method = interval.map_or("", |_: &DispersionInterval| "bootstrap");
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
        row.push(if interval.is_some() { String::new() } else { no_interval(class.subjects).unwrap_or_default() });
        row.extend(by.iter().filter(|name| !INTERVAL_COLUMNS.contains(&name.as_str())).map(value));
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
            "least_p_holm",
            "paired",
            "p_max_node",
            "p_either",
            "p_either_holm",
        ])
        .map(str::to_owned)
        .collect();
    let rows = comparisons.pairs.iter().map(|pair| {
        let mut row = vec![pair.emotion.clone(), values(&pair.groups[0]), values(&pair.groups[1])];
        row.extend(pair.people.iter().chain(&pair.sequences).map(ToString::to_string));
        match &pair.outcome {
            Ok(t) => {
                row.extend([t.energy, t.effect, t.effect_by_chance, t.p, t.p_adjusted, t.least_p].map(nine_digits));
                row.extend([t.permutations.to_string(), t.exhaustive.to_string()]);
                row.extend(t.people_used.map(|n| n.to_string()));
                row.extend([String::new(), nine_digits(t.least_p_adjusted), t.paired.to_string()]);
                let max_node = t.node_p.iter().copied().fold(1.0, f64::min);
                row.extend([max_node, t.p_either, t.p_either_adjusted].map(nine_digits));
            }
            Err(why) => {
                row.extend(std::iter::repeat_n(String::new(), 10));
                row.push(why.to_string());
                row.extend(std::iter::repeat_n(String::new(), 5));
            }
        }
        row
    });
    write_records(&out.join("comparisons.csv"), &header, rows)?;

    write_omnibus(&out.join("group_tests.csv"), &comparisons.omnibus)?;

    let header = ["emotion", "group_a", "group_b", "node", "energy", "p"].map(str::to_owned);
    let rows = comparisons.pairs.iter().filter_map(|pair| Some((pair, pair.outcome.as_ref().ok()?))).flat_map(|(pair, t)| {
        let nodes = wireframe.live_nodes().iter().zip(t.node_energy.iter().zip(&t.node_p));
        nodes.map(move |(node, (&energy, &p))| {
            let names = vec![pair.emotion.clone(), values(&pair.groups[0]), values(&pair.groups[1]), node.to_string()];
            [names, vec![nine_digits(energy), nine_digits(p)]].concat()
        })
    });
    write_records(&out.join("comparison_nodes.csv"), &header, rows)?;
    Ok(["intervals.csv", "comparisons.csv", "group_tests.csv", "comparison_nodes.csv"].map(str::to_owned).to_vec())
}

/// Writes `group_tests.csv`: all groups of an emotion at once, a row per emotion; values of groups are joined by `; `.
fn write_omnibus(path: &Path, comparisons: &[OmnibusComparison]) -> Result<(), OutputError> {
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
    ];
    let joined = |texts: Vec<String>| texts.join("; ");
    let rows = comparisons.iter().map(|c| {
        let mut row = vec![c.emotion.clone(), joined(c.groups.iter().map(values).collect())];
        match &c.outcome {
            Ok(t) => {
                row.push(joined(t.people.iter().map(ToString::to_string).collect()));
                row.extend([t.location_f, t.location_share, t.location_p, t.location_p_adjusted].map(nine_digits));
                row.push(joined(t.scatters.iter().copied().map(nine_digits).collect()));
                row.extend([t.scatter_f, t.scatter_p, t.scatter_p_adjusted].map(nine_digits));
                row.extend([t.permutations.to_string(), String::new()]);
            }
            Err(why) => {
                row.extend(std::iter::repeat_n(String::new(), header.len() - 3));
                row.push(why.clone());
            }
        }
        row
    });
    write_records(path, header, rows)
}
