//! Tables of the report's section on groups: amplitudes, and location and scatter of all groups at once.

use serde::Serialize;

use super::{
    GroupsData,
    groups::{p_value, percent},
    numbers::fixed,
};
use crate::{
    output::{count, nine_digits},
    statistics::{
        amplitude::{AmplitudeComparison, AmplitudeTest},
        compare::{Comparisons, Omnibus, OmnibusComparison, group_values},
    },
};

/// Most comparisons of amplitudes in the table; the file has all.
const MOST_AMPLITUDES: usize = 300;

/// Rows of amplitudes before the rest is folded.
const OPEN_ROWS: usize = 8;

/// Name of the region that is the whole face.
pub(super) const WHOLE_FACE: &str = "face";

/// Tested amplitudes, the clearest difference first.
#[derive(Serialize)]
pub(super) struct AmplitudeTable {
    rows: Vec<AmplitudeRow>,
    /// Number of further comparisons that only the file has.
    more: usize,
    /// Number of all comparisons.
    count: String,
    /// Rows that are not folded.
    open: usize,
    paired: bool,
    equivalence: String,
}

impl AmplitudeTable {
    pub(super) fn new(groups: &GroupsData<'_>, significance: f64) -> Self {
        let tested = groups.amplitudes.iter().filter_map(|c| Some((c, c.outcome.as_ref().ok()?)));
        let mut tested: Vec<(&AmplitudeComparison, &AmplitudeTest)> = tested.collect();
        tested.sort_by(|(_, a), (_, b)| a.clearer(b));
        Self {
            more: tested.len().saturating_sub(MOST_AMPLITUDES),
            count: count(tested.len(), "comparison", "comparisons"),
            open: OPEN_ROWS,
            paired: tested.iter().any(|(_, t)| t.paired),
            equivalence: nine_digits(groups.options.amplitude.equivalence),
            rows: tested.into_iter().take(MOST_AMPLITUDES).map(|(c, t)| AmplitudeRow::new(c, t, significance)).collect(),
        }
    }
}

/// Tests of all groups of each emotion.
#[derive(Serialize)]
pub(super) struct OmnibusTable {
    rows: Vec<OmnibusRow>,
    untested: Vec<String>,
}

impl OmnibusTable {
    pub(super) fn new(comparisons: &Comparisons, significance: f64) -> Self {
        let all = || comparisons.omnibus.iter();
        let left_out = all().filter(|c| !c.left_out.is_empty()).map(|c| {
            let groups = c.left_out.iter().map(group_values).collect::<Vec<_>>().join(", ");
            format!("{}: {groups}: a group of one person", c.emotion)
        });
        let untested = all().filter_map(|c| Some(format!("{}: {}", c.emotion, c.outcome.as_ref().err()?)));
        Self {
            rows: all().filter_map(|c| Some(OmnibusRow::new(c, c.outcome.as_ref().ok()?, significance))).collect(),
            untested: untested.chain(left_out).collect(),
        }
    }
}

/// Amplitudes of two groups in one region.
#[derive(Serialize)]
struct AmplitudeRow {
    emotion: String,
    region: &'static str,
    groups: [String; 2],
    people: String,
    means: [String; 2],
    difference: String,
    effect: String,
    p: String,
    p_holm: String,
    verdict: &'static str,
    differs: bool,
}

impl AmplitudeRow {
    fn new(c: &AmplitudeComparison, t: &AmplitudeTest, significance: f64) -> Self {
        let [low, high] = t.interval.map(|v| fixed(v, 2));
        let differs = t.p_adjusted <= significance;
        Self {
            emotion: c.emotion.clone(),
            region: c.region,
            groups: c.groups.each_ref().map(group_values),
            people: if t.paired { format!("{} in pairs", t.people[0]) } else { format!("{} and {}", t.people[0], t.people[1]) },
            means: t.means.map(|mean| fixed(mean, 2)),
            difference: format!("{} ({low} to {high})", fixed(t.difference, 2)),
            effect: fixed(t.effect, 2),
            p: p_value(t.p),
            p_holm: p_value(t.p_adjusted),
            verdict: if differs {
                "differ"
            } else if t.p_equivalence_adjusted <= significance {
                "equally strong"
            } else {
                "not shown to differ"
            },
            differs,
        }
    }
}

/// Location and scatter of all groups of an emotion.
#[derive(Serialize)]
struct OmnibusRow {
    emotion: String,
    groups: String,
    location_f: String,
    share: String,
    location_p: String,
    location_holm: String,
    location_differs: bool,
    scatters: String,
    scatter_f: String,
    scatter_p: String,
    scatter_holm: String,
    scatter_differs: bool,
}

impl OmnibusRow {
    fn new(c: &OmnibusComparison, t: &Omnibus, significance: f64) -> Self {
        let groups = c.groups.iter().zip(&t.people).map(|(group, n)| format!("{} ({n})", group_values(group)));
        Self {
            emotion: c.emotion.clone(),
            groups: groups.collect::<Vec<_>>().join(", "),
            location_f: fixed(t.location_f, 2),
            share: percent(t.location_share),
            location_p: p_value(t.location_p),
            location_holm: p_value(t.location_p_adjusted),
            location_differs: t.location_p_adjusted <= significance,
            scatters: scatters(c, &t.scatters),
            scatter_f: fixed(t.scatter_f, 2),
            scatter_p: p_value(t.scatter_p),
            scatter_holm: p_value(t.scatter_p_adjusted),
            scatter_differs: t.scatter_p_adjusted <= significance,
        }
    }
}

/// Scatter of every group, `male 4.13, female 4.10`.
pub(super) fn scatters(c: &OmnibusComparison, scatters: &[f64]) -> String {
    let of = c.groups.iter().zip(scatters).map(|(group, s)| format!("{} {}", group_values(group), fixed(*s, 2)));
    of.collect::<Vec<_>>().join(", ")
}
