//! Text of the report for the template: the summary, the dispersion table, and one card per representative.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::{
    Failure, ReportData,
    conclusions::{self, Conclusions},
    courses::{self, CoursesView},
    covariates::{self, CovariatesView},
    figures::{self, FieldScale, Lines},
    groups::GroupsView,
    numbers::{MISSING, fixed, fixed_or_dash, ratio},
    payload::MOST_DOTS,
};
use crate::{
    output::count,
    statistics::{ClassLabel, Representative, variation::Component},
    track::{Look, TrackQuality},
    units::NodeId,
    wireframe::Fapu,
};

/// Number of people below which a class is marked as small.
const SMALL_CLASS: usize = 5;
/// Bars in the chart of FAPs, as in the script.
const TOP_FAPS: usize = 20;
/// Dispersions published in [KP, Table 1]; laughter stands for happiness.
const PUBLISHED_DISPERSIONS: [(&str, f64); 6] =
    [("anger", 11.13), ("disgust", 9.80), ("fear", 11.39), ("happiness", 10.89), ("sadness", 13.46), ("surprise", 13.57)];

/// Files beside the report that its list names if they exist, with their content. A name with `/` at its end is a folder.
const FILES: [(&str, &str); 21] = [
    ("statistics.csv", "dispersion of every emotion and group"),
    ("intervals.csv", "dispersion of every emotion and group with its 95 % interval"),
    ("comparisons.csv", "groups: whether two of them differ, one row per pair"),
    ("comparison_nodes.csv", "groups: the same test at every node"),
    ("group_tests.csv", "groups: location and scatter of all groups at once"),
    ("amplitude_comparisons.csv", "groups: which one makes the expression more strongly, one row per pair and region"),
    ("covariates.csv", "covariates: whether expressions change with them"),
    ("covariate_nodes.csv", "covariates: the same test at every node"),
    ("covariate_amplitudes.csv", "covariates: how amplitudes change with them, one row per region"),
    ("covariates/", "covariates: every expression at a low and at a high value"),
    ("amplitudes.csv", "how strongly each person makes each expression"),
    (
        "sequences.csv",
        "one row per sequence: its fields of the manifest, and action units, FAPs, pose and amplitudes at its apex",
    ),
    ("trimming.csv", "what was trimmed, and why"),
    ("verdicts.csv", "verdict on every sequence: good or look again"),
    ("failures.csv", "sequences that failed, with the reason"),
    ("variation.csv", "how people differ: shares of the principal components"),
    ("variation_scores.csv", "scores of every sequence on the principal components"),
    ("variation/", "expressions at two standard deviations along the principal components"),
    ("bands.csv", "every node and FAP over the key frames: ranges of half and nine tenths of the people"),
    ("recognition.csv", "which expression each sequence shows, judged by the sequences of other people"),
    ("units.json", "units of all columns"),
];

/// The files of the list that exist.
fn files_of(written: &[String]) -> Vec<[&'static str; 2]> {
    let exists = |name: &str| written.iter().any(|w| w == name || (name.ends_with('/') && w.starts_with(name)));
    FILES.iter().filter(|(name, _)| exists(name)).map(|&(name, what)| [name, what]).collect()
}

/// Text of the report.
#[derive(Serialize)]
pub(super) struct View<'a> {
    title: &'a str,
    version: &'static str,
    summary: String,
    options: &'a [(String, String)],
    failures: &'a [Failure],
    failure_count: String,
    look_again: Vec<LookAgain<'a>>,
    look_again_count: String,
    /// Sequences left out of the statistics.
    left_out: Vec<LookAgain<'a>>,
    left_out_count: String,
    same: &'a [String],
    too_short: Option<&'a str>,
    table: DispersionTable<'a>,
    cards: Vec<Card>,
    /// Magnification of the arrows, and the length of the scale arrow.
    arrows: [String; 2],
    track_count: String,
    fapus: Vec<(String, String)>,
    /// Whether somebody has several sequences of a class, which then have weights.
    weighted: bool,
    small_class: usize,
    has_player: bool,
    files: Vec<[&'static str; 2]>,
    stems_known: bool,
    face: &'a str,
    conclusions: Vec<Conclusions>,
    groups: Option<GroupsView>,
    covariates: Option<CovariatesView>,
    courses: Option<CoursesView>,
}

/// A sequence to review.
#[derive(Serialize)]
struct LookAgain<'a> {
    subject: &'a str,
    sequence: &'a str,
    emotion: &'a str,
    expected: String,
    reasons: String,
}

impl<'a> LookAgain<'a> {
    fn of(track: &'a TrackQuality) -> Self {
        Self {
            subject: &track.id.subject,
            sequence: &track.id.sequence,
            emotion: &track.emotion,
            expected: fixed_or_dash(track.summary.expected_error_px, 2),
            reasons: track.summary.reasons.join("; "),
        }
    }
}

/// Dispersions in the form of [KP, Table 1]: a column per emotion, a block of rows per group.
#[derive(Serialize)]
struct DispersionTable<'a> {
    emotions: Vec<&'a str>,
    grouped: bool,
    blocks: Vec<Block>,
    published: Option<Vec<String>>,
    has_single: bool,
    has_small: bool,
}

/// One group's rows.
#[derive(Default, Serialize)]
struct Block {
    group: String,
    cells: Vec<Cell>,
}

/// One class in the dispersion table.
#[derive(Clone, Serialize)]
struct Cell {
    sequences: String,
    after: String,
    before: String,
    single: bool,
    small: bool,
}

/// One representative.
#[derive(Serialize)]
#[allow(clippy::struct_excessive_bools)]
struct Card {
    anchor: String,
    emotion: String,
    group: String,
    label: String,
    sequence_count: String,
    n: usize,
    /// Number of dots in the strips, if not every sequence has one; in that case the greedy median was not computed either.
    dots: Option<usize>,
    frames: usize,
    apex: usize,
    single: bool,
    small: bool,
    after: String,
    before: String,
    greedy: String,
    exact: String,
    bound: String,
    gap: String,
    certificate: String,
    dropped: usize,
    dropped_per_field: String,
    has_faps: bool,
    fap_rows: usize,
    /// Entries of the variation figure: components, and tested covariates.
    components: Vec<String>,
    has_bands: bool,
    /// Stem of its files, as part of a link.
    stem: Option<String>,
    fields: Vec<FieldView>,
    /// Map of its dispersion; empty for a single sequence.
    map: String,
}

/// A displacement field: its drawing, and the lengths of the node displacements.
#[derive(Serialize)]
struct FieldView {
    picture: String,
    lengths: String,
}

/// Common data of the drawings of all classes.
pub(super) struct Fields {
    pub(super) lines: Lines,
    scale: FieldScale,
    pub(super) within: [f64; 4],
}

impl Fields {
    fn new(data: &ReportData<'_>) -> Self {
        let lines = Lines::new(data.wireframe);
        let models = || data.representatives.iter().map(|r| &r.model);
        Self { scale: FieldScale::of(models(), &lines), within: figures::view_box(models(), &lines), lines }
    }

    /// Map of the dispersion of a class, over its own range.
    fn map(&self, r: &Representative, label: &str) -> String {
        let value = |n: NodeId| r.node_dispersion.get(n.index()).copied().unwrap_or(0.0);
        let span = figures::range(&value, &self.lines);
        let map = figures::map(&r.model, &value, span, &[], self.within, &self.lines);
        map.inline("heat", &format!("Dispersion per node of {label}"))
    }

    /// Displacement fields of a class; the first has the scale arrow.
    fn of(&self, r: &Representative, label: &str) -> Vec<FieldView> {
        let view = |m: usize| {
            let mut drawing = figures::field(&r.model, m, self.scale, self.within, &self.lines);
            if m == 0 {
                figures::draw_measure(&mut drawing, self.scale, self.within);
            }
            let (mean, longest) = figures::lengths(&r.model, m, &self.lines);
            FieldView {
                picture: drawing.inline("field", &format!("Displacement field of {label} from key frame {m} to {}", m + 1)),
                lengths: format!("mean {}, longest {} face units", fixed(mean, 1), fixed(longest, 1)),
            }
        };
        (0..r.model.frame_count() - 1).map(view).collect()
    }
}

impl<'a> View<'a> {
    pub(super) fn new(data: &'a ReportData<'_>) -> Self {
        let emotions: BTreeSet<&str> = data.representatives.iter().map(|r| r.label.emotion.as_str()).collect();
        let failures = count(data.failures.len(), "failure", "failures");
        let doubtful = data.tracks.iter().filter(|t| t.is_to_look_at());
        let look_again: Vec<LookAgain<'_>> = doubtful.map(LookAgain::of).collect();
        let look_again_count = count(look_again.len(), "sequence to look at again", "sequences to look at again");
        let mut summary = vec![
            count(data.tracks.len(), "sequence tracked", "sequences tracked"),
            count(emotions.len(), "emotion", "emotions"),
            count(data.representatives.len(), "representative", "representatives"),
            if data.failures.is_empty() { "no failures".to_owned() } else { failures.clone() },
        ];
        if !look_again.is_empty() {
            summary.push(format!("{} to look at again", look_again.len()));
        }
        let left_out: Vec<LookAgain<'_>> = data.tracks.iter().filter(|t| t.is_left_out()).map(LookAgain::of).collect();
        let right = data.tracks.iter().filter(|t| t.look == Some(Look::Right)).count();
        if right > 0 {
            summary.push(format!("{right} looked at: right"));
        }
        if !left_out.is_empty() {
            summary.push(format!("{} left out", left_out.len()));
        }
        let fields = Fields::new(data);
        let fapus = Fapu::LENGTHS.iter().filter_map(|&u| Some((format!("{u}0"), fixed(data.fapus.length(u)?, 1))));
        Self {
            title: &data.title,
            version: env!("CARGO_PKG_VERSION"),
            summary: summary.join(" \u{b7} "),
            options: &data.options,
            failures: data.failures,
            failure_count: failures,
            look_again,
            look_again_count,
            left_out_count: count(left_out.len(), "sequence left out after a look", "sequences left out after a look"),
            left_out,
            same: data.same,
            too_short: data.too_short.as_deref(),
            table: DispersionTable::new(data.representatives),
            cards: data.representatives.iter().enumerate().map(|(k, r)| Card::new(k, r, data, &fields)).collect(),
            arrows: [fields.scale.gain.to_string(), fields.scale.measure.to_string()],
            track_count: count(data.tracks.len(), "sequence", "sequences"),
            fapus: fapus.collect(),
            weighted: data.representatives.iter().any(|r| r.weighted),
            small_class: SMALL_CLASS,
            has_player: data.player.is_some(),
            stems_known: !data.stems.is_empty(),
            files: files_of(&data.files),
            face: &data.face,
            conclusions: conclusions::of(data),
            groups: data.groups.as_ref().map(|groups| GroupsView::new(groups, data, &fields)),
            covariates: CovariatesView::new(data),
            courses: courses::view(data),
        }
    }
}

impl<'a> DispersionTable<'a> {
    fn new(representatives: &'a [Representative]) -> Self {
        let emotions: BTreeSet<&str> = representatives.iter().map(|r| r.label.emotion.as_str()).collect();
        let emotions: Vec<&str> = emotions.into_iter().collect();
        let missing = MISSING.to_owned();
        let empty = Cell { sequences: missing.clone(), after: missing.clone(), before: missing, single: false, small: false };
        // Groups in order of first appearance: the caller has sorted them.
        let mut groups: Vec<&BTreeMap<String, String>> = Vec::new();
        for r in representatives {
            if !groups.contains(&&r.label.group) {
                groups.push(&r.label.group);
            }
        }
        let mut blocks = Vec::new();
        for group in groups {
            let cell = |emotion: &&str| {
                let r = representatives.iter().find(|r| &r.label.group == group && r.label.emotion == *emotion);
                r.map_or_else(|| empty.clone(), Cell::new)
            };
            blocks.push(Block { group: pairs_text(group), cells: emotions.iter().map(cell).collect() });
        }
        let value = |emotion: &&str| PUBLISHED_DISPERSIONS.iter().find(|(e, _)| e.eq_ignore_ascii_case(emotion)).map(|&(_, v)| v);
        let published = emotions.iter().any(|e| value(e).is_some());
        let cells = || blocks.iter().flat_map(|b| &b.cells);
        Self {
            grouped: blocks.iter().any(|b| !b.group.is_empty()),
            published: published.then(|| emotions.iter().map(|e| fixed_or_dash(value(e), 2)).collect()),
            has_single: cells().any(|c| c.single),
            has_small: cells().any(|c| c.small),
            emotions,
            blocks,
        }
    }
}

impl Cell {
    fn new(r: &Representative) -> Self {
        let people = r.sequences.iter().map(|id| &id.subject).collect::<BTreeSet<_>>().len();
        Self {
            sequences: r.sequences.len().to_string(),
            after: fixed_or_dash(r.dispersion, 2),
            before: fixed_or_dash(r.dispersion_untrimmed, 2),
            single: r.sequences.len() == 1,
            small: r.sequences.len() > 1 && people < SMALL_CLASS,
        }
    }
}

impl Card {
    fn new(index: usize, r: &Representative, data: &ReportData<'_>, drawn: &Fields) -> Self {
        let group = group_text(&r.label);
        let emotion = r.label.emotion.clone();
        let label = if group.is_empty() { emotion.clone() } else { format!("{emotion}, {group}") };
        let Cell { after, before, single, small, .. } = Cell::new(r);
        let variation = data.variations.get(index).and_then(Option::as_ref);
        let fields = r.model.frame_count() - 1;
        let per_field: Vec<String> =
            (0..fields).map(|m| r.trimming.iter().filter(|t| t.dropped && t.field == m).count().to_string()).collect();
        Self {
            fields: drawn.of(r, &label),
            map: if single { String::new() } else { drawn.map(r, &label) },
            anchor: format!("r{index}"),
            emotion,
            group,
            label,
            sequence_count: count(r.sequences.len(), "sequence", "sequences"),
            n: r.sequences.len(),
            dots: (r.sequences.len() > MOST_DOTS).then_some(MOST_DOTS),
            frames: r.model.frame_count(),
            apex: fields,
            single,
            small,
            after,
            before,
            greedy: fixed(r.sums.greedy, 4),
            exact: fixed(r.sums.exact, 4),
            bound: fixed(r.sums.lower_bound, 4),
            gap: ratio(r.sums.greedy_gap * 100.0),
            certificate: ratio(r.sums.certificate_gap),
            dropped: r.trimming.iter().filter(|t| t.dropped).count(),
            dropped_per_field: per_field.join(", "),
            fap_rows: data
                .apex_faps
                .get(index)
                .map_or(0, |f| f.iter().filter(|f| f.value != 0 && !f.is_angle).count().min(TOP_FAPS)),
            components: variation.and_then(|v| v.variation).map_or_else(Vec::new, |v| {
                let component =
                    |(k, c): (usize, &Component)| format!("{}: {} % of the variance", k + 1, fixed(c.share * 100.0, 1));
                let along = covariates::of_emotion(data, &r.label.emotion);
                let along = along.into_iter().map(|(column, test)| covariates::label(column, test));
                v.components.iter().take(3).enumerate().map(component).chain(along).collect()
            }),
            has_bands: variation.is_some_and(|v| !v.bands.is_empty()),
            stem: data.stems.get(index).map(|stem| url_part(stem)),
            has_faps: data.apex_faps.get(index).is_some_and(|f| !f.is_empty()),
        }
    }
}

/// A text encoded as part of a link.
fn url_part(text: &str) -> String {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b"-_.~".contains(&b);
    text.bytes().map(|b| if plain(b) { char::from(b).to_string() } else { format!("%{b:02X}") }).collect()
}

/// A class's group as `column = value, ...`; empty without groups.
pub(super) fn group_text(label: &ClassLabel) -> String {
    pairs_text(&label.group)
}

fn pairs_text(group: &BTreeMap<String, String>) -> String {
    group.iter().map(|(column, value)| format!("{column} = {value}")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_of_files_names_those_that_exist() {
        let written = ["covariates/fear_age_low.csv", "units.json", "group_tests.csv"].map(str::to_owned);
        let names: Vec<&str> = files_of(&written).into_iter().map(|[name, _]| name).collect();
        assert_eq!(names, ["group_tests.csv", "covariates/", "units.json"]);
    }

    #[test]
    fn links_hold_no_marks_of_their_own() {
        assert_eq!(url_part("anger_sex-f.x"), "anger_sex-f.x");
        assert_eq!(url_part("a b#ü"), "a%20b%23%C3%BC");
    }

    #[test]
    fn groups_read_as_pairs() {
        let group = [("sex", "f"), ("age", "30")].map(|(c, v)| (c.to_owned(), v.to_owned()));
        assert_eq!(group_text(&ClassLabel { emotion: "fear".into(), group: group.into() }), "age = 30, sex = f");
        assert_eq!(group_text(&ClassLabel { emotion: "fear".into(), group: BTreeMap::new() }), "");
    }
}
