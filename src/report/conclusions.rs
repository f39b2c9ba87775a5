//! Conclusions about groups and covariates for the top of the report: in words, with the figures that support them.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::{
    CovariateData, GroupsData, ReportData,
    covariates::round,
    group_tables::{WHOLE_FACE, scatters},
    groups::{p_value, percent},
    numbers::fixed,
};
use crate::{
    output::{count, nine_digits},
    statistics::{
        amplitude::{AmplitudeComparison, AmplitudeTest},
        compare::{Comparison, Tested, group_values},
        covariate::{AmplitudeSlope, Covariate, clearest_node},
    },
    units::NodeId,
};

/// Most conclusions of a list.
const MOST: usize = 5;

/// A list of conclusions.
#[derive(Serialize)]
pub(super) struct Conclusions {
    /// Anchor of the section with the tests.
    section: &'static str,
    title: &'static str,
    /// Columns that the tests are about.
    columns: String,
    significance: String,
    lines: Vec<Line>,
    /// Number of differences without a line.
    more: usize,
}

/// A conclusion.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Line {
    topic: &'static str,
    /// Anchor of the table.
    anchor: &'static str,
    text: String,
    /// Whether it is a difference that was shown.
    shown: bool,
}

/// What the tests of one kind show.
struct Kind {
    topic: &'static str,
    anchor: &'static str,
    /// Differences, the clearest first, each with its decisive p.
    found: Vec<(f64, String)>,
    /// Conclusion if there is no difference; `None` if nothing was tested.
    otherwise: Option<String>,
}

/// The lists for groups and for covariates, if these were requested.
pub(super) fn of(data: &ReportData<'_>) -> Vec<Conclusions> {
    let groups = data.groups.as_ref().map(|groups| {
        let columns: BTreeSet<&str> =
            data.representatives.iter().flat_map(|r| r.label.group.keys()).map(String::as_str).collect();
        let significance = groups.options.compare.significance;
        list(("groups", "Groups"), columns, significance, of_groups(groups, data.wireframe.live_nodes(), significance))
    });
    let numbers = (!data.covariates.is_empty()).then(|| {
        let columns: BTreeSet<&str> = data.covariates.iter().map(|c| c.column).collect();
        let significance = data.compare.significance;
        list(
            ("numbers", "Covariates"),
            columns,
            significance,
            of_numbers(&data.covariates, data.wireframe.live_nodes(), significance),
        )
    });
    groups.into_iter().chain(numbers).collect()
}

fn list(
    (section, title): (&'static str, &'static str),
    columns: BTreeSet<&str>,
    significance: f64,
    kinds: Vec<Kind>,
) -> Conclusions {
    let (lines, more) = chosen(kinds);
    let columns = columns.into_iter().collect::<Vec<_>>().join(", ");
    Conclusions { section, title, columns, significance: nine_digits(significance), lines, more }
}

/// At most [`MOST`] lines: one for every kind that was tested, then the clearest further differences. Also returns the number of
/// differences that are left out.
fn chosen(kinds: Vec<Kind>) -> (Vec<Line>, usize) {
    let (mut ranked, mut lines) = (Vec::new(), Vec::new());
    for (k, kind) in kinds.into_iter().enumerate() {
        let Kind { topic, anchor, found, otherwise } = kind;
        let line = |text, shown| Line { topic, anchor, text, shown };
        if found.is_empty() {
            lines.extend(otherwise.map(|text| ((k, 0), line(text, false))));
        }
        ranked.extend(found.into_iter().enumerate().map(|(rank, (p, text))| (rank > 0, p, (k, rank), line(text, true))));
    }
    ranked.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
    let (room, all) = (MOST.saturating_sub(lines.len()), ranked.len());
    lines.extend(ranked.into_iter().take(room).map(|(_, _, place, line)| (place, line)));
    lines.sort_by_key(|(place, _)| *place);
    (lines.into_iter().map(|(_, line)| line).collect(), all.saturating_sub(room))
}

/// Sentence for tests without a difference. `least` is the smallest p that any data could give.
fn not_shown(what: &str, p: impl Iterator<Item = f64>, least: Option<f64>, significance: f64) -> Option<String> {
    let all: Vec<f64> = p.collect();
    let smallest = all.iter().copied().reduce(f64::min)?;
    let which = if all.len() == 1 { "corrected p" } else { "smallest corrected p" };
    let tests = if all.len() == 1 { String::new() } else { format!(" of {}", count(all.len(), "test", "tests")) };
    let hopeless = least.filter(|least| *least > significance).map_or_else(String::new, |least| {
        format!("; with so few people or permutations no p below {} is possible", p_value(least))
    });
    Some(format!("{what} ({which}{tests} {}{hopeless})", p_value(smallest)))
}

/// A sorted list of findings: those whose p is at most the significance level.
fn found(all: impl Iterator<Item = (f64, String)>, significance: f64) -> Vec<(f64, String)> {
    let mut found: Vec<(f64, String)> = all.filter(|(p, _)| *p <= significance).collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found
}

fn words(name: &str) -> String {
    name.replace('_', " ")
}

/// Sentence about an expression that differs or changes at single nodes only.
fn at_nodes(what: &str, node: Option<NodeId>, p_nodes: f64, p_whole: f64) -> String {
    let most = node.map_or_else(String::new, |node| format!(", most at node {node}"));
    let (p, whole) = (p_value(p_nodes), p_value(p_whole));
    format!("{what} at single nodes{most} (corrected p {p}); as a whole not shown (corrected p {whole})")
}

/// Sentence about a pair of groups that differ: as a whole, with the effect, or at single nodes.
fn differing(c: &Comparison, t: &Tested, live: &[NodeId], significance: f64) -> String {
    let pair = format!("{} differs between {} and {}", words(&c.emotion), group_values(&c.groups[0]), group_values(&c.groups[1]));
    if t.is_of_whole(significance) {
        let (e, h, p) = (fixed(t.energy, 2), percent(t.effect), p_value(t.p_either_adjusted));
        format!("{pair} (energy distance {e} face units, effect {h}, corrected p {p})")
    } else {
        at_nodes(&pair, t.clearest_node(live), t.p_either_adjusted, t.p_adjusted)
    }
}

/// Sentence about an expression that changes with a covariate: as a whole, with the share, or at single nodes.
fn changing(c: &CovariateData<'_>, t: &Covariate, live: &[NodeId], significance: f64) -> String {
    let what = format!("{} changes with {}", words(c.emotion), c.column);
    if t.is_of_whole(significance) {
        let (share, chance, p) = (percent(t.share), percent(t.share_by_chance), p_value(t.p_either_adjusted));
        let explained = format!("explains {share} of the squared distances between people, by chance {chance}");
        format!("{what} ({} {explained}; corrected p {p})", c.column)
    } else {
        at_nodes(&what, clearest_node(t, live).map(|(node, _)| node), t.p_either_adjusted, t.p_adjusted)
    }
}

fn of_groups(groups: &GroupsData<'_>, live: &[NodeId], significance: f64) -> Vec<Kind> {
    let pairs = || groups.comparisons.pairs.iter().filter_map(|c| Some((c, c.outcome.as_ref().ok()?)));
    let least = pairs().map(|(_, t)| t.least_either_adjusted()).reduce(f64::min);
    let expression = Kind {
        topic: "Expression",
        anchor: "tests-c",
        found: found(pairs().map(|(c, t)| (t.p_either_adjusted, differing(c, t, live, significance))), significance),
        otherwise: not_shown("not shown to differ", pairs().map(|(_, t)| t.p_either_adjusted), least, significance),
    };
    let amplitudes = || groups.amplitudes.iter().filter_map(|c| Some((c, c.outcome.as_ref().ok()?)));
    let alike = amplitudes().filter(|(_, t)| t.p_equivalence_adjusted <= significance).count();
    let amplitude = Kind {
        topic: "Amplitude",
        anchor: "amplitudes-c",
        found: stronger(amplitudes().filter(|(_, t)| t.p_adjusted <= significance)),
        otherwise: not_shown("not shown to differ", amplitudes().map(|(_, t)| t.p_adjusted), None, significance).map(|text| {
            let within = nine_digits(groups.options.amplitude.equivalence);
            if alike > 0 { format!("{text}; {alike} shown to be equally strong within {within}") } else { text }
        }),
    };
    let omnibus = || groups.comparisons.omnibus.iter().filter_map(|c| Some((c, c.outcome.as_ref().ok()?)));
    // Of two groups the first line says the same.
    let several = || omnibus().filter(|(c, _)| c.groups.len() > 2);
    let location = Kind {
        topic: "Location (all groups at once)",
        anchor: "omnibus-c",
        found: found(
            several().map(|(c, t)| {
                let (f, share, p) = (fixed(t.location_f, 2), percent(t.location_share), p_value(t.location_p_adjusted));
                let text = format!("{} differs (pseudo-F {f}, share {share}, corrected p {p})", words(&c.emotion));
                (t.location_p_adjusted, text)
            }),
            significance,
        ),
        otherwise: not_shown("not shown to differ", several().map(|(_, t)| t.location_p_adjusted), None, significance),
    };
    let scatter = Kind {
        topic: "Scatter (how much the people of a group vary)",
        anchor: "omnibus-c",
        found: found(
            omnibus().map(|(c, t)| {
                let p = p_value(t.scatter_p_adjusted);
                let text = format!("{} differs ({} face units, corrected p {p})", words(&c.emotion), scatters(c, &t.scatters));
                (t.scatter_p_adjusted, text)
            }),
            significance,
        ),
        otherwise: not_shown("not shown to differ", omnibus().map(|(_, t)| t.scatter_p_adjusted), None, significance),
    };
    vec![expression, amplitude, location, scatter]
}

/// Sentences about differences of amplitudes: one per emotion, pair and direction, the whole face before its regions.
fn stronger<'a>(tests: impl Iterator<Item = Amplitude<'a>>) -> Vec<(f64, String)> {
    let mut of_pair: BTreeMap<_, Vec<Amplitude<'a>>> = BTreeMap::new();
    for (c, t) in tests {
        of_pair.entry((&c.emotion, &c.groups, t.difference > 0.0)).or_default().push((c, t));
    }
    let mut all: Vec<(f64, String)> = of_pair.into_values().filter_map(stronger_in).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all
}

/// Amplitudes of two groups in a region.
type Amplitude<'a> = (&'a AmplitudeComparison, &'a AmplitudeTest);

/// Sentence about regions in which the same one of two groups is stronger, with the smallest p; `None` without a region.
fn stronger_in(mut tests: Vec<Amplitude<'_>>) -> Option<(f64, String)> {
    let is_part = |c: &AmplitudeComparison| c.region != WHOLE_FACE;
    tests.sort_by(|(a, s), (b, t)| is_part(a).cmp(&is_part(b)).then(s.clearer(t)));
    let (first, test) = tests.first()?;
    let (more, less) = if test.difference > 0.0 { (0, 1) } else { (1, 0) };
    let (stronger, weaker) = (group_values(&first.groups[more]), group_values(&first.groups[less]));
    // Motion against the median is not weak.
    let is_opposite = tests.iter().any(|(_, t)| t.means[less] < 0.0);
    let does = if is_opposite { "goes more along the median" } else { "is stronger" };
    let texts = tests.iter().enumerate().map(|(k, (c, t))| {
        let part = if is_part(c) { format!("at the {}", c.region) } else { "in the whole face".to_owned() };
        let lead = match (k, is_part(c)) {
            (0, false) => format!("{} {does} in {stronger} than in {weaker}", words(&c.emotion)),
            (0, true) => format!("{} {does} {part} in {stronger} than in {weaker}", words(&c.emotion)),
            _ => part,
        };
        let (effect, p) = (fixed(t.effect.abs(), 2), p_value(t.p_adjusted));
        let (high, low) = (fixed(t.means[more], 2), fixed(t.means[less], 2));
        format!("{lead}: {high} and {low} times the median ({} {effect}, corrected p {p})", t.effect_name())
    });
    let text = texts.collect::<Vec<_>>().join("; ") + if is_opposite { "; below 0 is the opposite motion" } else { "" };
    Some((tests.iter().map(|(_, t)| t.p_adjusted).fold(1.0, f64::min), text))
}

fn of_numbers(covariates: &[CovariateData<'_>], live: &[NodeId], significance: f64) -> Vec<Kind> {
    let tested = || covariates.iter().filter_map(|c| Some((c, c.outcome.as_ref().ok()?)));
    let least = tested().map(|(_, t)| t.least_either_adjusted).reduce(f64::min);
    let expression = Kind {
        topic: "Expression",
        anchor: "numbers",
        found: found(tested().map(|(c, t)| (t.p_either_adjusted, changing(c, t, live, significance))), significance),
        otherwise: not_shown("not shown to change", tested().map(|(_, t)| t.p_either_adjusted), least, significance),
    };
    let slopes = || covariates.iter().flat_map(|c| c.slopes.iter().map(move |(region, slope)| (c, *region, *slope)));
    let amplitude = Kind {
        topic: "Amplitude",
        anchor: "numbers",
        found: found(slopes().map(|(c, region, slope)| (slope.p_adjusted, sloping(c, region, slope))), significance),
        otherwise: not_shown("not shown to change", slopes().map(|(.., s)| s.p_adjusted), None, significance),
    };
    vec![expression, amplitude]
}

/// Sentence about an amplitude that changes with a covariate.
fn sloping(c: &CovariateData<'_>, region: &str, slope: &AmplitudeSlope) -> String {
    let part = if region == WHOLE_FACE { String::new() } else { format!(" at the {region}") };
    let direction = if slope.slope > 0.0 { "stronger" } else { "weaker" };
    let change = c.outcome.as_ref().ok().map_or_else(String::new, |t| {
        let [from, to] = t.shown.map(|value| nine_digits(round(value)));
        let change = |per_unit: f64| fixed(per_unit * (t.shown[1] - t.shown[0]), 2);
        let [low, high] = slope.interval.map(change);
        format!("change from {from} to {to}: {} times the median, 95 % interval {low} to {high}; ", change(slope.slope))
    });
    let (r, p) = (fixed(slope.correlation, 2), p_value(slope.p_adjusted));
    format!("{} is {direction}{part} at higher {} ({change}r {r}, corrected p {p})", words(c.emotion), c.column)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(topic: &'static str, found: &[f64], otherwise: Option<&str>) -> Kind {
        let found = found.iter().map(|p| (*p, format!("{topic} {p}"))).collect();
        Kind { topic, anchor: "x", found, otherwise: otherwise.map(str::to_owned) }
    }

    #[test]
    fn every_kind_has_a_line_and_the_clearest_differences_fill_the_rest() {
        // b has one line although three of a are clearer; c was tested without a difference, d was not tested.
        let kinds = vec![
            kind("a", &[0.001, 0.002, 0.003, 0.004, 0.005], Some("-")),
            kind("b", &[0.04], Some("-")),
            kind("c", &[], Some("not shown")),
            kind("d", &[], None),
        ];
        let (lines, more) = chosen(kinds);
        let texts: Vec<(&str, bool)> = lines.iter().map(|l| (l.text.as_str(), l.shown)).collect();
        let expected = [("a 0.001", true), ("a 0.002", true), ("a 0.003", true), ("b 0.04", true), ("not shown", false)];
        assert_eq!((texts.as_slice(), more), (expected.as_slice(), 2));
    }

    #[test]
    fn without_a_difference_the_smallest_p_is_given() {
        let said = |p: &[f64], least| not_shown("not shown to differ", p.iter().copied(), least, 0.05);
        assert_eq!(said(&[0.4, 0.077], Some(0.001)).unwrap(), "not shown to differ (smallest corrected p of 2 tests 0.077)");
        let hopeless = "not shown to differ (corrected p 0.5; with so few people or permutations no p below 0.333 is possible)";
        assert_eq!(said(&[0.5], Some(1.0 / 3.0)).unwrap().replace("0.500", "0.5"), hopeless);
        assert_eq!(said(&[], None), None);
    }

    #[test]
    fn a_pair_that_differs_at_single_nodes_is_not_said_to_differ_as_a_whole() {
        let group = |name: &str| BTreeMap::from([("sex".to_owned(), name.to_owned())]);
        let tested = |p: f64, node_p: [f64; 3]| Tested {
            people_used: [9, 9],
            energy: 0.12,
            effect: 0.007,
            effect_by_chance: 0.02,
            p,
            p_adjusted: p,
            least_p: 0.0001,
            least_p_adjusted: 0.0001,
            permutations: 9999,
            exhaustive: false,
            node_energy: vec![0.5, 0.9, 0.7],
            node_p: node_p.into(),
            p_either: 0.0472,
            p_either_adjusted: 0.0472,
        };
        let said = |t: Tested| {
            let pair = Comparison {
                emotion: "surprise".to_owned(),
                groups: [group("f"), group("m")],
                people: [9, 9],
                sequences: [9, 9],
                outcome: Ok(t.clone()),
            };
            differing(&pair, &t, &[NodeId(5), NodeId(7), NodeId(8)], 0.05)
        };
        // Of the two nodes with the smallest p the one with the larger energy distance is named.
        let nodes = "surprise differs between f and m at single nodes, most at node 8 (corrected p 0.047); as a whole not shown \
                     (corrected p 0.274)";
        assert_eq!(said(tested(0.2743, [0.0236, 0.5, 0.0236])), nodes);
        let whole = "surprise differs between f and m (energy distance 0.12 face units, effect 0.7 %, corrected p 0.047)";
        assert_eq!(said(tested(0.0236, [0.2, 0.5, 0.3])), whole);
        // The whole face is significant by itself, although a node is clearer.
        assert_eq!(said(tested(0.04, [0.0236, 0.5, 0.3])), whole);
    }

    #[test]
    fn amplitudes_of_a_pair_are_one_sentence_with_the_face_first() {
        let group = |name: &str| BTreeMap::from([("sex".to_owned(), name.to_owned())]);
        let comparison = |region, means: [f64; 2], effect, p_adjusted| AmplitudeComparison {
            emotion: "big_smile".to_owned(),
            region,
            groups: [group("f"), group("m")],
            outcome: Ok(AmplitudeTest {
                people: [42, 48],
                paired: false,
                means,
                deviations: [0.6, 0.6],
                difference: means[0] - means[1],
                interval: [0.0, 1.0],
                effect,
                p: p_adjusted,
                p_t: p_adjusted,
                p_adjusted,
                p_equivalence: 1.0,
                p_equivalence_adjusted: 1.0,
                people_for_power: None,
            }),
            not_paired: Vec::new(),
        };
        let all = [comparison("mouth", [0.8, 1.32], -0.81, 0.001), comparison("face", [0.82, 1.29], -0.76, 0.002)];
        let sentences = stronger(all.iter().map(|c| (c, c.outcome.as_ref().unwrap())));
        let text = "big smile is stronger in m than in f: 1.29 and 0.82 times the median (Hedges' g 0.76, corrected p 0.002); \
                    at the mouth: 1.32 and 0.80 times the median (Hedges' g 0.81, corrected p 0.001)";
        assert_eq!(sentences, [(0.001, text.to_owned())]);
    }
}
