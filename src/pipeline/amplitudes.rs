//! Amplitudes of all sequences, comparisons of groups by them, and their files.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use super::{Workbench, analysis::EmotionGroups, covariates::people_values, write::Wrote};
use crate::{
    output::{OutputError, beside_ours, listed, nine_digits, write_records},
    report::p_value,
    statistics::{
        LabelledModel, SequenceModel,
        amplitude::{
            AmplitudeComparison, AmplitudeOptions, AmplitudeRegion, AmplitudeTest, Permutations, adjust_amplitudes, amplitudes,
            compare_amplitudes, in_one_only,
        },
        compare::{MAX_COMPARED_GROUPS, Strata, group_values, is_known, stream_of},
    },
    units::SequenceId,
};

/// Amplitudes of one sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceAmplitudes {
    /// The sequence.
    pub id: SequenceId,
    /// Its emotion.
    pub emotion: String,
    /// Further columns of the manifest.
    pub metadata: BTreeMap<String, String>,
    /// By region in the order of [`AmplitudeRegion::ALL`]; `None` for a region without an amplitude.
    pub values: [Option<f64>; 4],
}

/// Amplitudes of an analysis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AmplitudeResults {
    /// By sequence.
    pub sequences: Vec<SequenceAmplitudes>,
    /// Why an emotion has no amplitudes in a region.
    pub missing: BTreeMap<(String, AmplitudeRegion), String>,
    /// All pairs of groups, by emotion and region, with p corrected for their number.
    pub comparisons: Vec<AmplitudeComparison>,
}

/// Most groups of an emotion whose amplitudes are compared.
const MOST_GROUPS: usize = MAX_COMPARED_GROUPS;

impl AmplitudeResults {
    /// Computes the amplitudes of all emotions.
    pub(super) fn new(
        emotions: &EmotionGroups<'_>,
        models: &[LabelledModel],
        strata: Option<&Strata>,
        bench: &Workbench,
    ) -> Self {
        let metadata: BTreeMap<&SequenceId, &BTreeMap<String, String>> =
            models.iter().map(|m| (&m.model.id, &m.metadata)).collect();
        let mut all = Self::default();
        for (emotion, groups) in emotions {
            let Some((_, whole)) = groups.iter().find(|(label, _)| label.group.is_empty()) else { continue };
            let found = amplitudes(whole, &bench.wireframe, &bench.tables);
            all.missing.extend(found.missing.into_iter().map(|(region, why)| ((emotion.clone(), region), why)));
            let of_id: BTreeMap<&SequenceId, [Option<f64>; 4]> =
                whole.iter().map(|m| &m.id).zip(found.values.iter().copied()).collect();
            for (id, values) in &of_id {
                let metadata = metadata.get(id).map_or_else(BTreeMap::new, |m| (*m).clone());
                all.sequences.push(SequenceAmplitudes { id: (*id).clone(), emotion: emotion.clone(), metadata, values: *values });
            }
            let known: Vec<_> = groups.iter().filter(|(label, _)| is_known(label)).collect();
            if known.len() > MOST_GROUPS {
                continue;
            }
            for (r, region) in AmplitudeRegion::ALL.into_iter().enumerate() {
                let missing = all.missing.get(&(emotion.clone(), region)).cloned();
                let people = |models: &[&SequenceModel]| people_values(models.iter().map(|m| &m.id), &of_id, r);
                for (i, (a, of_a)) in known.iter().enumerate() {
                    for (b, of_b) in &known[i + 1..] {
                        let stream = stream_of(&[(emotion, &a.group), (region.name(), &b.group)]);
                        let (options, compare) = (&bench.options.groups.amplitude, &bench.options.groups.compare);
                        let (of_a, of_b) = (people(of_a), people(of_b));
                        let permutations = Permutations { count: compare.permutations, seed: compare.seed, stream };
                        let compared = || compare_amplitudes(&of_a, &of_b, strata, options, &permutations);
                        let outcome = missing.clone().map_or_else(compared, Err);
                        let is_paired = outcome.as_ref().is_ok_and(|test| test.paired);
                        all.comparisons.push(AmplitudeComparison {
                            emotion: emotion.clone(),
                            region: region.name(),
                            groups: [a.group.clone(), b.group.clone()],
                            outcome,
                            not_paired: if is_paired { in_one_only(&of_a, &of_b) } else { Vec::new() },
                        });
                    }
                }
            }
        }
        adjust_amplitudes(&mut all.comparisons);
        all
    }

    /// Warnings to the user.
    pub(super) fn warnings(&self) -> Vec<String> {
        let mut whys: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for ((emotion, region), why) in &self.missing {
            let what =
                if *region == AmplitudeRegion::Face { emotion.clone() } else { format!("{emotion} of the {}", region.name()) };
            whys.entry(if why.contains("one person") {
                "there is only one person"
            } else {
                "the median motion there is too small"
            })
            .or_default()
            .push(what);
        }
        let no_amplitudes = whys.into_iter().map(|(why, of)| format!("no amplitudes, because {why}: {}", listed(&of, 8)));
        let without = |c: &AmplitudeComparison| {
            let [a, b] = c.groups.each_ref().map(group_values);
            format!("{}, {a} and {b} (without {})", c.emotion, listed(&c.not_paired, 4))
        };
        // All regions leave out the same people.
        let left_out: BTreeSet<String> = self.comparisons.iter().filter(|c| !c.not_paired.is_empty()).map(without).collect();
        let left_out: Vec<String> = left_out.into_iter().collect();
        let in_pairs = (!left_out.is_empty())
            .then(|| format!("amplitudes in pairs leave out people who are in one group only: {}", listed(&left_out, 5)));
        no_amplitudes.chain(in_pairs).collect()
    }

    /// Texts about the significant differences of amplitudes with means, effect size and p, the clearest first.
    pub fn findings(&self, significance: f64, options: &AmplitudeOptions) -> Vec<String> {
        let tested = self.comparisons.iter().filter_map(|c| Some((c, c.outcome.as_ref().ok()?)));
        let mut found: Vec<_> = tested.filter(|(_, t)| t.p_adjusted <= significance).collect();
        found.sort_by(|(_, a), (_, b)| a.clearer(b));
        let words = |(c, t): (&AmplitudeComparison, &AmplitudeTest)| {
            let (effect, p) = (t.effect.abs(), p_value(t.p_adjusted));
            format!("{} ({} {effect:.2}, p {p} after Holm's correction)", c.words(significance, options), t.effect_name())
        };
        found.into_iter().map(words).collect()
    }
}

/// Largest number of people written as `people_for_power`. A difference that needs more is too small to plan a study for.
const MOST_PEOPLE: usize = 100_000;

/// Columns of `amplitudes.csv` before and after the manifest's.
const BEFORE: [&str; 3] = ["subject", "sequence", "emotion"];
const AFTER: [&str; 4] = ["region", "amplitude", "id", "no_amplitude"];

/// Writes `amplitudes.csv` and, if there are groups, `amplitude_comparisons.csv`. Calls `wrote` after each file.
pub(super) fn write_amplitudes(
    out: &Path,
    results: &AmplitudeResults,
    bench: &Workbench,
    wrote: &mut Wrote<'_>,
) -> Result<(), OutputError> {
    let columns: BTreeSet<&String> = results.sequences.iter().flat_map(|s| s.metadata.keys()).collect();
    let columns: Vec<&String> = columns.into_iter().collect();
    let named = beside_ours(&columns, |name| BEFORE.contains(&name) || AFTER.contains(&name));
    let header = BEFORE.map(str::to_owned).into_iter().chain(named).chain(AFTER.map(str::to_owned));
    let rows = results.sequences.iter().flat_map(|s| {
        let columns = &columns;
        AmplitudeRegion::ALL.into_iter().zip(s.values).map(move |(region, value)| {
            let mut row = vec![s.id.subject.clone(), s.id.sequence.clone(), s.emotion.clone()];
            row.extend(columns.iter().map(|column| s.metadata.get(*column).cloned().unwrap_or_default()));
            let why = results.missing.get(&(s.emotion.clone(), region)).cloned().unwrap_or_default();
            row.extend([region.name().to_owned(), value.map(nine_digits).unwrap_or_default(), s.id.to_string(), why]);
            row
        })
    });
    wrote("amplitudes.csv", write_records(&out.join("amplitudes.csv"), header, rows)?)?;
    if bench.options.by.is_empty() {
        return Ok(());
    }
    let header = [
        "emotion",
        "region",
        "group_a",
        "group_b",
        "subjects_a",
        "subjects_b",
        "paired",
        "mean_a",
        "mean_b",
        "sd_a",
        "sd_b",
        "difference",
        "low",
        "high",
        "effect",
        "p",
        "p_t",
        "p_holm",
        "p_equivalence",
        "people_for_power",
        "words",
        "not_tested",
        "p_equivalence_holm",
        "not_paired",
    ];
    let rows = results.comparisons.iter().map(|c| {
        let mut row = vec![c.emotion.clone(), c.region.to_owned(), group_values(&c.groups[0]), group_values(&c.groups[1])];
        let words = c.words(bench.options.groups.compare.significance, &bench.options.groups.amplitude);
        match &c.outcome {
            Ok(t) => {
                row.extend(t.people.map(|n| n.to_string()));
                row.push(t.paired.to_string());
                row.extend(t.means.iter().chain(&t.deviations).copied().map(nine_digits));
                row.extend(
                    [t.difference, t.interval[0], t.interval[1], t.effect, t.p, t.p_t, t.p_adjusted, t.p_equivalence]
                        .map(nine_digits),
                );
                let people = t.people_for_power.filter(|n| *n <= MOST_PEOPLE);
                row.extend([people.map(|n| n.to_string()).unwrap_or_default(), words, String::new()]);
                row.push(nine_digits(t.p_equivalence_adjusted));
            }
            Err(why) => {
                row.extend(std::iter::repeat_n(String::new(), header.len() - 8));
                row.extend([words, why.clone(), String::new()]);
            }
        }
        row.push(c.not_paired.join("; "));
        row
    });
    wrote("amplitude_comparisons.csv", write_records(&out.join("amplitude_comparisons.csv"), header, rows)?)
}
