//! Tests whether expressions are associated with numbers of the people (`--covariate`), and writes the results.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use super::{
    AmplitudeResults, AnalysisError, AnalyzedClass, Workbench,
    analysis::EmotionGroups,
    classes::{file_stem, unique_name, whole_class},
    model_file::write_model,
    write::Wrote,
};
use crate::{
    output::{OutputError, count, listed, nine_digits, write_records},
    report::{CovariateData, p_value},
    statistics::{
        LabelledModel, Strata,
        amplitude::{AmplitudeRegion, PersonValue},
        compare::stream_of,
        covariate::{
            AmplitudeSlope, Covariate, NoCovariate, Numbers, adjust_covariates, adjust_slopes, amplitude_slope, clearest_node,
            covariate,
        },
        is_missing, number_of,
    },
    units::SequenceId,
};

/// Association of one emotion with one number.
#[derive(Clone, Debug, PartialEq)]
pub struct CovariateResult {
    /// Emotion.
    pub emotion: String,
    /// Stem of the files of the expression at low and at high numbers; unique.
    pub stem: String,
    /// Column of the number.
    pub column: String,
    /// Numbers of the people of the emotion who have one.
    pub known: Vec<f64>,
    /// Number of people of the emotion without a value.
    pub unknown: usize,
    /// The test, or the reason why there is none.
    pub outcome: Result<Covariate, NoCovariate>,
    /// Slopes of the amplitudes by region, or the reason why there is none.
    pub slopes: Vec<(AmplitudeRegion, Result<AmplitudeSlope, String>)>,
}

/// Tests every emotion against every column.
pub(super) fn covariates(
    emotions: &EmotionGroups<'_>,
    models: &[LabelledModel],
    classes: &[AnalyzedClass],
    amplitudes: &AmplitudeResults,
    strata: Option<&Strata>,
    bench: &Workbench,
) -> Vec<CovariateResult> {
    let mut all = Vec::new();
    let options = &bench.options.groups.compare;
    let mut stems = BTreeSet::new();
    // A column named twice is tested once.
    let mut met = BTreeSet::new();
    for column in bench.options.covariates.iter().filter(|&column| met.insert(column)) {
        let value = |m: &LabelledModel| m.metadata.get(column).filter(|v| !is_missing(v)).and_then(|v| number_of(v));
        let rows = || models.iter().map(|m| (&m.model.id, value(m)));
        let of_all = Numbers::new(rows().map(|(id, value)| (id.subject.as_str(), value)));
        for (emotion, groups) in emotions {
            let Some((_, whole)) = groups.iter().find(|(label, _)| label.group.is_empty()) else { continue };
            let of_emotion = amplitudes.sequences.iter().filter(|s| s.emotion == *emotion);
            let values: BTreeMap<&SequenceId, [Option<f64>; 4]> = of_emotion.map(|s| (&s.id, s.values)).collect();
            let Some(class) = whole_class(classes, emotion) else { continue };
            // A number may differ from sequence to sequence, such as a rating. One that is only given with another emotion still holds.
            let ids: BTreeSet<&SequenceId> = whole.iter().map(|m| &m.id).collect();
            let own = rows().filter(|(id, _)| ids.contains(id)).map(|(id, value)| (id.subject.as_str(), value));
            let numbers = Numbers::new(own).or(&of_all);
            let stream = stream_of(&[(emotion, &BTreeMap::from([(column.clone(), String::new())]))]);
            let people: BTreeSet<&str> = whole.iter().map(|m| m.id.subject.as_str()).collect();
            let slope = |region: AmplitudeRegion| {
                if let Some(why) = amplitudes.missing.get(&(emotion.clone(), region)) {
                    return Err(why.clone());
                }
                let place = AmplitudeRegion::ALL.iter().position(|r| *r == region).unwrap_or_default();
                let values = people_values(whole.iter().map(|m| &m.id), &values, place);
                let stream = stream_of(&[(region.name(), &BTreeMap::from([(column.clone(), emotion.clone())]))]);
                amplitude_slope(&values, &numbers, options, strata, stream).map_err(|why| why.to_string())
            };
            all.push(CovariateResult {
                emotion: emotion.clone(),
                stem: unique_name(&format!("{}_{}", class.stem, file_stem(column)), &mut stems),
                column: column.clone(),
                known: people.iter().filter_map(|subject| numbers.get(subject)).collect(),
                unknown: people.iter().filter(|subject| numbers.get(subject).is_none()).count(),
                outcome: covariate(whole, &numbers, &bench.wireframe, options, strata, stream),
                slopes: AmplitudeRegion::ALL.map(|region| (region, slope(region))).into(),
            });
        }
    }
    adjust_covariates(&mut all.iter_mut().filter_map(|c| c.outcome.as_mut().ok()).collect::<Vec<_>>());
    adjust_slopes(&mut all.iter_mut().flat_map(|c| &mut c.slopes).filter_map(|(_, s)| s.as_mut().ok()).collect::<Vec<_>>());
    all
}

/// Returns the mean of each person's values.
pub(super) fn people_values<'a>(
    ids: impl Iterator<Item = &'a SequenceId>,
    values: &BTreeMap<&SequenceId, [Option<f64>; 4]>,
    region: usize,
) -> Vec<PersonValue> {
    let mut sums: BTreeMap<&str, (f64, usize)> = BTreeMap::new();
    for id in ids {
        if let Some(value) = values.get(id).and_then(|values| values[region]) {
            let sum = sums.entry(&id.subject).or_default();
            *sum = (sum.0 + value, sum.1 + 1);
        }
    }
    sums.into_iter().map(|(subject, (sum, n))| PersonValue { subject: subject.to_owned(), value: sum / n as f64 }).collect()
}

impl CovariateResult {
    /// Data for the report.
    pub(super) fn shown(&self) -> CovariateData<'_> {
        CovariateData {
            emotion: &self.emotion,
            column: &self.column,
            unknown: self.unknown,
            outcome: &self.outcome,
            slopes: self.slopes.iter().filter_map(|(region, slope)| Some((region.name(), slope.as_ref().ok()?))).collect(),
        }
    }

    /// Text of the finding; `None` without one.
    pub fn finding(&self, significance: f64, bench: &Workbench) -> Option<String> {
        let test = self.outcome.as_ref().ok().filter(|t| t.p_either_adjusted <= significance)?;
        let node = clearest_node(test, bench.wireframe.live_nodes()).filter(|(_, p)| *p <= significance);
        let most = node.map(|(node, _)| format!(", most at node {node}")).unwrap_or_default();
        let (emotion, column) = (&self.emotion, &self.column);
        Some(if test.is_of_whole(significance) {
            let [share, chance] = [test.share, test.share_by_chance].map(|share| 100.0 * share.max(0.0));
            format!("{emotion} with {column} ({share:.1} % of how people differ, by chance {chance:.1} %{most})")
        } else {
            let (p, whole) = (p_value(test.p_either_adjusted), p_value(test.p_adjusted));
            format!("{emotion} with {column} at single nodes{most} (corrected p {p}; as a whole not shown, corrected p {whole})")
        })
    }
}

/// Warnings to the user.
pub(super) fn covariate_warnings(results: &[CovariateResult], bench: &Workbench) -> Vec<String> {
    let significance = bench.options.groups.compare.significance;
    let mut said = Vec::new();
    let found: Vec<String> = results.iter().filter_map(|c| c.finding(significance, bench)).collect();
    if !found.is_empty() {
        said.push(format!(
            "expressions that change with a numeric column, after correction for all tests: {}",
            listed(&found, 6)
        ));
    }
    let slopes =
        results.iter().flat_map(|c| c.slopes.iter().filter_map(move |(region, slope)| Some((c, region, slope.as_ref().ok()?))));
    let stronger = |(c, region, slope): (&CovariateResult, &AmplitudeRegion, &AmplitudeSlope)| {
        let part = if *region == AmplitudeRegion::Face { String::new() } else { format!(", {}", region.name()) };
        let (direction, column) = (if slope.slope > 0.0 { "stronger" } else { "weaker" }, &c.column);
        format!("{}{part}: {direction} at higher {column} (r = {:.2})", c.emotion, slope.correlation)
    };
    let found: Vec<String> = slopes.filter(|(.., slope)| slope.p_adjusted <= significance).map(stronger).collect();
    if !found.is_empty() {
        said.push(format!("amplitudes that change with a numeric column, after correction: {}", listed(&found, 6)));
    }
    said.extend(hopeless(results, significance));
    let of_draw = |c: &CovariateResult| {
        let test = c.outcome.as_ref().ok().filter(|t| t.used < t.people)?;
        Some(format!("{} ({} of {})", c.emotion, test.used, test.people))
    };
    let drawn: Vec<String> = results.iter().filter_map(of_draw).collect::<BTreeSet<_>>().into_iter().collect();
    if !drawn.is_empty() {
        said.push(format!(
            "tests of numeric columns used a random draw of people (increase it with --test-people): {}",
            listed(&drawn, 6)
        ));
    }
    let mut untested: BTreeMap<(&str, String), Vec<String>> = BTreeMap::new();
    for c in results {
        if let Err(why) = &c.outcome {
            untested.entry((&c.column, why.to_string())).or_default().push(c.emotion.clone());
        }
    }
    said.extend(
        untested.into_iter().map(|((column, why), of)| format!("{column} is not tested, because {why}: {}", listed(&of, 8))),
    );
    let mut unknown: BTreeMap<&str, usize> = BTreeMap::new();
    for c in results.iter().filter(|c| c.outcome.is_ok() && c.unknown > 0) {
        let most = unknown.entry(&c.column).or_default();
        *most = c.unknown.max(*most);
    }
    said.extend(unknown.into_iter().map(|(column, n)| {
        let are = count(n, "person without a number is", "people without a number are");
        format!("{are} excluded from the tests of {column}")
    }));
    said
}

/// Warning that the tests cannot reach significance, with advice.
fn hopeless(results: &[CovariateResult], significance: f64) -> Option<String> {
    let tested: Vec<&Covariate> = results.iter().filter_map(|c| c.outcome.as_ref().ok()).collect();
    let hopeless: Vec<&&Covariate> = tested.iter().filter(|t| t.least_either_adjusted > significance).collect();
    let least = hopeless.iter().map(|t| t.least_either_adjusted).min_by(f64::total_cmp)?;
    let mut helps = Vec::new();
    if hopeless.iter().any(|t| !t.exhaustive) {
        // Significance requires 2 / (drawn + 1) times the number of tests to be at most the significance level.
        helps.push(format!("--permutations {} or more", (2.0 * tested.len() as f64 / significance).ceil() as usize));
    }
    if hopeless.iter().any(|t| t.exhaustive) {
        helps.push("more people".to_owned());
    }
    helps.push("fewer numeric columns or emotions".to_owned());
    Some(format!(
        "{} of {} of numeric columns cannot be significant at {significance} after Holm's correction, whatever the data (smallest \
         possible p_either_holm {}); possible remedies: {}",
        hopeless.len(),
        count(tested.len(), "test", "tests"),
        nine_digits(least),
        helps.join(", ")
    ))
}

/// Files that [`write_covariates`] writes besides the models.
pub(super) const COVARIATE_TABLES: [&str; 3] = ["covariates.csv", "covariate_nodes.csv", "covariate_amplitudes.csv"];

/// Names of the models of one result: for a low and for a high number.
pub(super) fn covariate_models(result: &CovariateResult) -> [String; 2] {
    ["low", "high"].map(|end| format!("covariates/{}_{end}.csv", result.stem))
}

/// Writes [`COVARIATE_TABLES`] and the models of `covariates/`. Calls `wrote` after each file.
pub(super) fn write_covariates(
    out: &Path,
    results: &[CovariateResult],
    bench: &Workbench,
    wrote: &mut Wrote<'_>,
) -> Result<(), AnalysisError> {
    let header = [
        "emotion",
        "covariate",
        "subjects",
        "without",
        "used",
        "mean",
        "sd",
        "share",
        "share_by_chance",
        "f",
        "p",
        "p_holm",
        "p_max_node",
        "p_either",
        "p_either_holm",
        "least_p_either_holm",
        "permutations",
        "exhaustive",
        "low",
        "high",
        "models",
        "not_tested",
    ];
    let rows = results.iter().map(|c| {
        let mut row = vec![c.emotion.clone(), c.column.clone()];
        match &c.outcome {
            Ok(t) => {
                row.extend([t.people, c.unknown, t.used].map(|n| n.to_string()));
                row.extend([t.mean, t.deviation, t.share, t.share_by_chance].map(nine_digits));
                row.push(t.f.map(nine_digits).unwrap_or_default());
                let p = [t.p, t.p_adjusted, t.least_node_p(), t.p_either, t.p_either_adjusted, t.least_either_adjusted];
                row.extend(p.map(nine_digits));
                row.extend([t.permutations.to_string(), t.exhaustive.to_string()]);
                row.extend(t.shown.map(nine_digits));
                row.extend([format!("covariates/{}", c.stem), String::new()]);
            }
            Err(why) => {
                row.extend([c.known.len().to_string(), c.unknown.to_string(), String::new()]);
                row.extend(mean_and_deviation(&c.known).map(|value| value.map(nine_digits).unwrap_or_default()));
                row.extend(std::iter::repeat_n(String::new(), header.len() - 8));
                row.push(why.to_string());
            }
        }
        row
    });
    wrote(COVARIATE_TABLES[0], write_records(&out.join(COVARIATE_TABLES[0]), header, rows)?)?;
    let tested = || results.iter().filter_map(|c| Some((c, c.outcome.as_ref().ok()?)));
    let rows = tested().flat_map(|(c, t)| {
        let nodes = bench.wireframe.live_nodes().iter().zip(t.node_share.iter().zip(&t.node_p));
        nodes.map(|(node, (&share, &p))| {
            vec![c.emotion.clone(), c.column.clone(), node.to_string(), nine_digits(share), nine_digits(p)]
        })
    });
    let header = ["emotion", "covariate", "node", "share", "p"];
    wrote(COVARIATE_TABLES[1], write_records(&out.join(COVARIATE_TABLES[1]), header, rows)?)?;
    wrote(COVARIATE_TABLES[2], write_slopes(&out.join(COVARIATE_TABLES[2]), results)?)?;
    for (result, test) in tested() {
        for (name, model) in covariate_models(result).into_iter().zip(&test.models) {
            wrote(&name, write_model(&out.join(&name), model)?)?;
        }
    }
    Ok(())
}

/// Returns the mean of numbers and their standard deviation, as far as they have these.
fn mean_and_deviation(numbers: &[f64]) -> [Option<f64>; 2] {
    let n = numbers.len() as f64;
    let mean = numbers.iter().sum::<f64>() / n;
    let squares: f64 = numbers.iter().map(|v| (v - mean).powi(2)).sum();
    [(n > 0.0).then_some(mean), (n > 1.0).then(|| (squares / (n - 1.0)).sqrt())]
}

fn write_slopes(path: &Path, results: &[CovariateResult]) -> Result<blake3::Hash, OutputError> {
    let header =
        ["emotion", "covariate", "region", "subjects", "slope", "low", "high", "correlation", "p", "p_t", "p_holm", "not_tested"];
    let rows = results.iter().flat_map(|c| {
        c.slopes.iter().map(|(region, outcome)| {
            let mut row = vec![c.emotion.clone(), c.column.clone(), region.name().to_owned()];
            match outcome {
                Ok(s) => {
                    row.push(s.people.to_string());
                    let [low, high] = s.interval;
                    row.extend([s.slope, low, high, s.correlation, s.p, s.p_t, s.p_adjusted].map(nine_digits));
                    row.push(String::new());
                }
                Err(why) => {
                    row.extend(std::iter::repeat_n(String::new(), header.len() - 4));
                    row.push(why.clone());
                }
            }
            row
        })
    });
    write_records(path, header, rows)
}
