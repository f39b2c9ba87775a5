//! Tests all pairs of groups of an emotion, and makes notes for the user.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::{
    CompareOptions, Comparison, LEAST_PEOPLE, OmnibusComparison, Strata, Tested, adjust, adjust_omnibus, compare, omnibus,
};
use crate::{
    output::{count, listed, nine_digits},
    statistics::{ClassLabel, SequenceModel, UNKNOWN_GROUP, amplitude::AmplitudeOptions},
    units::NodeId,
};

/// Default number of bootstrap replicates.
const BOOTSTRAP_REPLICATES: usize = 1000;

/// Largest number of groups of one emotion that are compared; 50 groups make 1,225 pairs.
pub const MAX_COMPARED_GROUPS: usize = 50;

/// Options of the analysis of groups.
///
/// ```
/// use grimace::{pipeline::PipelineOptions, statistics::{CompareOptions, GroupOptions}};
///
/// let compare = CompareOptions { permutations: 99_999, ..CompareOptions::default() };
/// let groups = GroupOptions { compare, bootstrap: 0, ..GroupOptions::default() };
/// let options = PipelineOptions { by: vec!["age".to_owned()], groups, ..PipelineOptions::default() };
/// assert_eq!(options.groups.compare.permutations, 99_999);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroupOptions {
    /// Options of the tests between groups.
    pub compare: CompareOptions,
    /// Number of draws for the confidence interval of every dispersion; 0 for no intervals. Without groups there are no intervals.
    pub bootstrap: usize,
    /// Options of the comparisons of amplitudes.
    #[serde(default)]
    #[doc(hidden)]
    pub amplitude: AmplitudeOptions,
}

impl Default for GroupOptions {
    fn default() -> Self {
        Self { compare: CompareOptions::default(), bootstrap: BOOTSTRAP_REPLICATES, amplitude: AmplitudeOptions::default() }
    }
}

/// The comparisons, and the emotions that were not compared.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Comparisons {
    /// All pairs of groups, by emotion, then in the order of the groups; corrected for their number.
    pub pairs: Vec<Comparison>,
    /// Emotions with too many groups to compare, with their number of groups.
    pub too_many: Vec<(String, usize)>,
    /// Whether people without a value were left out.
    pub unknown_left_out: bool,
    /// Emotions of which at most one group has people, so that there is nothing to compare.
    #[serde(default)]
    pub one_group: Vec<OneGroup>,
    /// Tests of all groups of each emotion at once; corrected for their number.
    #[serde(default)]
    pub omnibus: Vec<OmnibusComparison>,
}

/// An emotion of which at most one group with a known value has people.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct OneGroup {
    /// Emotion.
    pub emotion: String,
    /// The group; `None` if no person has a value.
    pub group: Option<BTreeMap<String, String>>,
    /// Number of people without a value.
    pub unknown: usize,
}

impl OneGroup {
    /// Returns why nothing is compared.
    pub fn reason(&self) -> String {
        let unknown = if self.unknown == 0 {
            String::new()
        } else {
            format!("; {} no value (`{UNKNOWN_GROUP}`)", count(self.unknown, "person has", "people have"))
        };
        let group = self.group.as_ref().map(group_values);
        group.map_or_else(|| "no group has people".to_owned(), |group| format!("only one group, {group}, has people")) + &unknown
    }
}

/// Returns whether the class is a group whose value is known in every column.
pub(crate) fn is_known(label: &ClassLabel) -> bool {
    !label.group.is_empty() && label.group.values().all(|value| value != UNKNOWN_GROUP)
}

/// Returns the random stream of a class or a pair of classes. It depends only on their names, so that neither other groups nor the order
/// of the emotions change a result.
pub(crate) fn stream_of(labels: &[(&str, &BTreeMap<String, String>)]) -> u32 {
    let hash = blake3::hash(&serde_json::to_vec(labels).unwrap_or_default());
    let bytes = hash.as_bytes();
    // Half of the range; the bootstrap uses the other half.
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) >> 1
}

/// Compares all pairs of groups of one emotion. The p values are not yet corrected.
pub(crate) fn compare_groups(
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
    let people = |models: &[&SequenceModel]| models.iter().map(|m| m.id.subject.as_str()).collect::<BTreeSet<_>>().len();
    if known.len() < 2 && known.len() + unknown.len() > 0 {
        all.one_group.push(OneGroup {
            emotion: emotion.to_owned(),
            group: known.first().map(|(label, _)| label.group.clone()),
            unknown: people(&unknown.iter().flat_map(|(_, models)| models.iter().copied()).collect::<Vec<_>>()),
        });
    }
    if known.len() > MAX_COMPARED_GROUPS {
        all.too_many.push((emotion.to_owned(), known.len()));
        return all;
    }
    if known.len() > 1 {
        // A group of one person has no scatter. If at least two groups have more, they are compared without it.
        let (enough, too_few): (Vec<_>, Vec<_>) = known.iter().partition(|(_, models)| people(models) >= LEAST_PEOPLE);
        let (compared, left_out) = if enough.len() > 1 { (enough, too_few) } else { (known.iter().collect(), Vec::new()) };
        let labels: Vec<(&str, &BTreeMap<String, String>)> = compared.iter().map(|(label, _)| (emotion, &label.group)).collect();
        let members: Vec<Vec<&SequenceModel>> = compared.iter().map(|(_, models)| models.clone()).collect();
        all.omnibus.push(OmnibusComparison {
            emotion: emotion.to_owned(),
            groups: compared.iter().map(|(label, _)| label.group.clone()).collect(),
            left_out: left_out.iter().map(|(label, _)| label.group.clone()).collect(),
            outcome: omnibus(&members, live, &options.compare, strata, stream_of(&labels)),
        });
    }
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
    /// Joins the comparisons of all emotions and corrects for their number.
    pub(crate) fn together(parts: impl IntoIterator<Item = Self>) -> Self {
        let mut all = Self::default();
        for part in parts {
            all.pairs.extend(part.pairs);
            all.omnibus.extend(part.omnibus);
            all.too_many.extend(part.too_many);
            all.one_group.extend(part.one_group);
            all.unknown_left_out |= part.unknown_left_out;
        }
        adjust(&mut all.pairs);
        adjust_omnibus(&mut all.omnibus);
        all
    }

    /// Returns the number of tests.
    pub fn tests(&self) -> usize {
        self.pairs.iter().filter(|pair| pair.outcome.is_ok()).count()
    }

    /// Returns warnings for the user, at most one of each kind.
    pub(crate) fn warnings(&self, significance: f64) -> Vec<String> {
        let mut warnings = Vec::new();
        warnings.extend(self.hopeless(significance));
        let untested: Vec<String> = self
            .pairs
            .iter()
            .filter_map(|pair| pair.outcome.as_ref().err().map(|why| (pair, why)))
            .map(|(pair, why)| {
                format!("{}: {} and {} ({why})", pair.emotion, group_values(&pair.groups[0]), group_values(&pair.groups[1]))
            })
            .collect();
        if !untested.is_empty() {
            warnings.push(format!("not tested: {}", listed(&untested, 5)));
        }
        let left_out: Vec<String> = self
            .omnibus
            .iter()
            .filter(|c| !c.left_out.is_empty())
            .map(|c| format!("{}: {}", c.emotion, c.left_out.iter().map(group_values).collect::<Vec<_>>().join(", ")))
            .collect();
        if !left_out.is_empty() {
            warnings.push(format!("the test of all groups at once leaves out groups of one person: {}", listed(&left_out, 5)));
        }
        if !self.too_many.is_empty() {
            let list: Vec<String> = self.too_many.iter().map(|(emotion, groups)| format!("{emotion} has {groups}")).collect();
            warnings.push(format!(
                "groups were not compared, because there are more than {MAX_COMPARED_GROUPS}: {}",
                list.join(", ")
            ));
        }
        if !self.one_group.is_empty() {
            let list: Vec<String> = self.one_group.iter().map(|one| format!("{} ({})", one.emotion, one.reason())).collect();
            warnings.push(format!("no groups to compare: {}", listed(&list, 5)));
        }
        if self.unknown_left_out && !self.pairs.is_empty() {
            warnings.push(format!(
                "people without a value form the group `{UNKNOWN_GROUP}`, which is not compared with other groups"
            ));
        }
        warnings
    }
}

impl Comparisons {
    /// Returns a warning if tests cannot reject whatever the data, with remedies.
    fn hopeless(&self, significance: f64) -> Option<String> {
        let tested: Vec<&Tested> = self.pairs.iter().filter_map(|pair| pair.outcome.as_ref().ok()).collect();
        let hopeless: Vec<&&Tested> = tested.iter().filter(|t| t.least_either_adjusted() > significance).collect();
        let least = hopeless.iter().map(|t| t.least_either_adjusted()).min_by(f64::total_cmp)?;
        let tests = tested.len();
        let drawn = hopeless.iter().filter(|t| !t.exhaustive).count();
        let mut helps = Vec::new();
        if drawn > 0 {
            // Smallest number of draws for which 2 / (draws + 1) times the number of tests is at most the significance level.
            helps.push(format!("--permutations {} or more", (2.0 * tests as f64 / significance).ceil() as usize));
        }
        if drawn < hopeless.len() {
            helps.push("more people in groups that were tested exhaustively".to_owned());
        }
        helps.push("fewer groups to compare".to_owned());
        Some(format!(
            "{} of {} cannot be significant at {significance} after Holm's correction, whatever the data (smallest possible \
             p_either_holm {}); possible remedies: {}",
            hopeless.len(),
            count(tests, "test", "tests"),
            nine_digits(least),
            helps.join(", ")
        ))
    }
}

/// Returns the values of a group, joined by ` + `.
pub fn group_values(group: &BTreeMap<String, String>) -> String {
    group.values().map(String::as_str).collect::<Vec<_>>().join(" + ")
}
