//! Node errors of tracked sequences, with tables and charts over the frames and at the last frame.

use super::{Cell, ErrorSummary, LineChart, Series, Table, percentile};

/// The part of the face that a row covers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Part {
    /// All compared nodes, as in [KP, eq. (1)].
    All,
    /// Landmarks 17 to 67.
    InnerFace,
    /// One region of the face, or one part of the landmarks.
    Named(String),
}

impl Part {
    /// Returns the name of the part in tables.
    pub fn name(&self) -> &str {
        match self {
            Self::All => "all",
            Self::InnerFace => "inner_face",
            Self::Named(name) => name,
        }
    }
}

/// The node states that a row covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StateFilter {
    /// All nodes.
    Any,
    /// Nodes that the tracker followed into the frame.
    Tracked,
    /// Nodes that were lost, and placed by the springs or left in place.
    Recovered,
}

impl StateFilter {
    const ALL: [Self; 3] = [Self::Any, Self::Tracked, Self::Recovered];

    fn name(self) -> &'static str {
        match self {
            Self::Any => "any",
            Self::Tracked => "tracked",
            Self::Recovered => "recovered",
        }
    }

    fn takes(self, tracked: bool) -> bool {
        match self {
            Self::Any => true,
            Self::Tracked => tracked,
            Self::Recovered => !tracked,
        }
    }
}

/// Error of one node in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordedError {
    /// Index into [`Records::variants`].
    pub variant: usize,
    /// Index into [`Records::groups`].
    pub group: usize,
    /// Index into [`Records::sequences`].
    pub sequence: usize,
    /// Position in the sequence, from 1 for the neutral frame.
    pub frame: usize,
    /// Whether the frame is the sequence's last.
    pub last: bool,
    /// Index into [`Records::parts`].
    pub part: usize,
    /// Whether the node belongs to the inner face.
    pub inner: bool,
    /// Whether the tracker followed the node into the frame.
    pub tracked: bool,
    /// Error, px.
    pub px: f64,
    /// Error in percent of the eye distance.
    pub percent: f64,
    /// Expected error of the tracker, px.
    pub expected_px: Option<f64>,
}

/// Summaries of errors in px and in percent of the eye distance.
#[derive(Clone, Copy, Debug, PartialEq)]
struct RecordSummary {
    px: ErrorSummary,
    percent: ErrorSummary,
    /// Number of sequences with at least one of these errors.
    sequences: usize,
}

/// All errors of an experiment, in a fixed order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Records {
    /// Names of the variants.
    pub variants: Vec<String>,
    /// Names of the groups, sorted.
    pub groups: Vec<String>,
    /// Names of the sequences.
    pub sequences: Vec<String>,
    /// Names of the parts, from top to bottom of the face.
    pub parts: Vec<String>,
    /// Whether some, but not all, nodes belong to the inner face.
    pub has_inner: bool,
    /// The errors.
    pub errors: Vec<RecordedError>,
}

impl Records {
    /// Returns the parts that get a row: all, the inner face when it differs, then every part.
    pub fn part_rows(&self) -> Vec<Part> {
        let inner = self.has_inner.then_some(Part::InnerFace);
        [Part::All].into_iter().chain(inner).chain(self.parts.iter().cloned().map(Part::Named)).collect()
    }

    /// Returns the part used in figures and texts: the inner face when it differs, otherwise all.
    pub fn main_part(&self) -> Part {
        if self.has_inner { Part::InnerFace } else { Part::All }
    }

    fn takes_part(&self, part: &Part, error: &RecordedError) -> bool {
        match part {
            Part::All => true,
            Part::InnerFace => error.inner,
            Part::Named(name) => self.parts.get(error.part) == Some(name),
        }
    }

    fn frame_count(&self) -> usize {
        self.errors.iter().map(|e| e.frame).max().unwrap_or(0)
    }

    /// Returns the errors of a variant in a group.
    fn of(&self, variant: usize, group: usize) -> Vec<&RecordedError> {
        self.errors.iter().filter(|e| e.variant == variant && e.group == group).collect()
    }
}

fn summary<'a>(errors: impl Iterator<Item = &'a RecordedError>) -> Option<RecordSummary> {
    let errors: Vec<&RecordedError> = errors.collect();
    let px: Vec<f64> = errors.iter().map(|e| e.px).collect();
    let percent: Vec<f64> = errors.iter().map(|e| e.percent).collect();
    let mut sequences: Vec<usize> = errors.iter().map(|e| e.sequence).collect();
    sequences.sort_unstable();
    sequences.dedup();
    Some(RecordSummary { px: ErrorSummary::of(&px)?, percent: ErrorSummary::of(&percent)?, sequences: sequences.len() })
}

/// Columns of a summary.
const SUMMARY: [&str; 8] =
    ["sequences", "errors", "mean_px", "median_px", "p95_px", "mean_percent_es", "median_percent_es", "p95_percent_es"];

fn summary_cells(s: &RecordSummary) -> [Cell; 8] {
    let number = |v| Cell::Number(v, 2);
    [
        Cell::Count(s.sequences),
        Cell::Count(s.px.count),
        number(s.px.mean),
        number(s.px.median),
        number(s.px.p95),
        number(s.percent.mean),
        number(s.percent.median),
        number(s.percent.p95),
    ]
}

/// Returns errors by variant, group, part, state and frame. Frames count from 1, the neutral frame; empty combinations have no row.
pub fn curve_table(records: &Records) -> Table {
    let mut table = Table::new(["group", "variant", "part", "state", "frame"].into_iter().chain(SUMMARY));
    for (g, group) in records.groups.iter().enumerate() {
        for (v, variant) in records.variants.iter().enumerate() {
            let of = records.of(v, g);
            let mut by_frame: Vec<Vec<&RecordedError>> = vec![Vec::new(); records.frame_count() + 1];
            of.iter().for_each(|e| by_frame[e.frame].push(e));
            for part in records.part_rows() {
                for state in StateFilter::ALL {
                    for (frame, errors) in by_frame.iter().enumerate() {
                        let chosen = errors.iter().filter(|e| records.takes_part(&part, e) && state.takes(e.tracked)).copied();
                        let Some(s) = summary(chosen) else { continue };
                        let key = [group, variant, part.name(), state.name()].map(Cell::text);
                        table.rows.push(key.into_iter().chain([Cell::Count(frame)]).chain(summary_cells(&s)).collect());
                    }
                }
            }
        }
    }
    table
}

/// Returns errors at the last frame of each sequence, by variant, group, part and state.
pub fn last_table(records: &Records) -> Table {
    let mut table = Table::new(["group", "variant", "part", "state"].into_iter().chain(SUMMARY));
    for (g, group) in records.groups.iter().enumerate() {
        for (v, variant) in records.variants.iter().enumerate() {
            let of = records.of(v, g);
            for part in records.part_rows() {
                for state in StateFilter::ALL {
                    let takes = |e: &RecordedError| e.last && records.takes_part(&part, e) && state.takes(e.tracked);
                    let Some(s) = summary(of.iter().copied().filter(|e| takes(e))) else { continue };
                    let key = [group, variant, part.name(), state.name()].map(Cell::text);
                    table.rows.push(key.into_iter().chain(summary_cells(&s)).collect());
                }
            }
        }
    }
    table
}

/// Returns the mean error at the last frame of every sequence, in percent of the eye distance, with a column for each variant.
pub fn sequence_table(records: &Records) -> Table {
    let columns = records.variants.iter().map(|v| format!("{v}: mean_percent_es"));
    let mut table = Table::new(["sequence", "group"].map(str::to_owned).into_iter().chain(columns));
    let part = records.main_part();
    for (k, name) in records.sequences.iter().enumerate() {
        let of: Vec<&RecordedError> =
            records.errors.iter().filter(|e| e.sequence == k && e.last && records.takes_part(&part, e)).collect();
        let Some(group) = of.first().and_then(|e| records.groups.get(e.group)) else { continue };
        let mut row = vec![Cell::text(name), Cell::text(group)];
        for v in 0..records.variants.len() {
            let s = summary(of.iter().copied().filter(|e| e.variant == v));
            row.push(Cell::maybe(s.map(|s| s.percent.mean), 2));
        }
        table.rows.push(row);
    }
    table
}

/// Returns mean errors at the last frame in percent of the eye distance: a row for each group and variant, a column for each part. Further
/// columns hold the mean and 95th percentile of the main part in px, and the percentage of recovered nodes.
pub fn markdown_last(records: &Records) -> Table {
    let parts = records.part_rows();
    let head = ["group", "variant", "sequences"].map(str::to_owned);
    let of_parts = parts.iter().map(|p| format!("{} (% ES)", p.name()));
    let whole = records.main_part();
    let tail = [format!("{} (px)", whole.name()), format!("{} p95 (px)", whole.name()), "recovered (%)".to_owned()];
    let mut table = Table::new(head.into_iter().chain(of_parts).chain(tail));
    for (g, group) in records.groups.iter().enumerate() {
        for (v, variant) in records.variants.iter().enumerate() {
            let last: Vec<&RecordedError> = records.of(v, g).into_iter().filter(|e| e.last).collect();
            let of_part = |part: &Part| summary(last.iter().copied().filter(|e| records.takes_part(part, e)));
            let (Some(all), Some(main)) = (of_part(&Part::All), of_part(&whole)) else { continue };
            let mut row = vec![Cell::text(group), Cell::text(variant), Cell::Count(all.sequences)];
            row.extend(parts.iter().map(|p| Cell::maybe(of_part(p).map(|s| s.percent.mean), 2)));
            let recovered = last.iter().filter(|e| !e.tracked).count() as f64 / last.len() as f64;
            row.extend([Cell::Number(main.px.mean, 2), Cell::Number(main.px.p95, 2), Cell::Number(100.0 * recovered, 1)]);
            table.rows.push(row);
        }
    }
    table
}

/// Counts, for each group, the frames from the fifth on in which the mean error of variant `better` exceeds that of `worse`. It tests the
/// claim of KP.
///
/// Returns `(group, frames compared, frames worse)`; the first frame has number 1.
pub fn frames_worse(records: &Records, better: usize, worse: usize) -> Vec<(String, usize, usize)> {
    let part = records.main_part();
    let count = |(g, group): (usize, &String)| {
        let curves = [better, worse].map(|v| curve(records, v, g, &part));
        let pairs: Vec<_> =
            curves[0].iter().filter(|p| p.0 >= 5).filter_map(|a| Some((a.1, curves[1].iter().find(|b| b.0 == a.0)?.1))).collect();
        (group.clone(), pairs.len(), pairs.iter().filter(|(a, b)| a > b).count())
    };
    records.groups.iter().enumerate().map(count).collect()
}

/// Returns the mean error in percent of the eye distance for each frame from 2 on.
fn curve(records: &Records, variant: usize, group: usize, part: &Part) -> Vec<(usize, f64)> {
    let of = records.of(variant, group);
    let mean = |frame: usize| {
        let s = summary(of.iter().copied().filter(|e| e.frame == frame && records.takes_part(part, e)))?;
        Some((frame, s.percent.mean))
    };
    (1..=records.frame_count()).filter_map(mean).collect()
}

/// Returns a chart of the mean error against the frame number in one group, with a curve for each variant [KP, Fig. 3].
pub fn tracking_chart(records: &Records, group: usize, what: &str) -> LineChart {
    let part = records.main_part();
    let points = |v| curve(records, v, group, &part).into_iter().map(|(f, e)| (f as f64, e)).collect();
    let series = records.variants.iter().enumerate().map(|(v, name)| Series { name: name.clone(), points: points(v) });
    let name = records.groups.get(group).map_or("", String::as_str);
    let mut eyes: Vec<f64> =
        records.errors.iter().filter(|e| e.group == group && e.percent > 0.0).map(|e| 100.0 * e.px / e.percent).collect();
    eyes.sort_by(f64::total_cmp);
    let eye = percentile(&eyes, 0.5).map_or(String::new(), |e| format!("; median eye distance {e:.0} px"));
    LineChart {
        title: format!("{name}: {what}{eye}"),
        x_label: "frame (1 is the neutral frame)".to_owned(),
        y_label: format!(
            "mean error over the {} (% of eye distance)",
            if records.has_inner { "inner face" } else { "live nodes" }
        ),
        series: series.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two frames and two nodes (brow, mouth): variant 0 has errors of 1 and 3 px in the last frame, variant 1 of 2 and 6 px.
    fn records() -> Records {
        let names = |list: &[&str]| list.iter().map(|s| (*s).to_owned()).collect();
        let mut errors = Vec::new();
        for variant in 0..2 {
            for frame in 1..=2 {
                for (part, px) in [(0, 1.0), (1, 3.0)] {
                    let px = if frame == 1 { 0.0 } else { px * (variant + 1) as f64 };
                    let (last, tracked) = (frame == 2, part == 0);
                    let error = RecordedError {
                        variant,
                        group: 0,
                        sequence: 0,
                        frame,
                        last,
                        part,
                        inner: part == 1,
                        tracked,
                        px,
                        percent: 2.0 * px,
                        expected_px: None,
                    };
                    errors.push(error);
                }
            }
        }
        Records {
            variants: names(&["a", "b"]),
            groups: names(&["g"]),
            sequences: names(&["s"]),
            parts: names(&["brow", "mouth"]),
            has_inner: true,
            errors,
        }
    }

    #[test]
    fn the_last_frame_is_summarized_by_part_and_state() {
        let table = last_table(&records());
        // Variant a has 9 rows: all nodes with any, tracked and recovered; inner face with any and recovered; brow with any and tracked;
        // mouth with any and recovered.
        assert_eq!(table.rows.len(), 18);
        let find = |variant: &str, part: &str, state: &str| {
            let key = ["g", variant, part, state].map(Cell::text);
            table.rows.iter().find(|row| row[..4] == key).cloned()
        };
        // (1 + 3) / 2 px; the error in percent is twice that.
        let all = find("a", "all", "any").unwrap();
        assert_eq!((&all[6], &all[9]), (&Cell::Number(2.0, 2), &Cell::Number(4.0, 2)));
        assert_eq!(find("b", "inner_face", "any").unwrap()[6], Cell::Number(6.0, 2));
        assert_eq!(find("a", "brow", "recovered"), None);
    }

    #[test]
    fn curves_have_a_row_for_every_frame() {
        let table = curve_table(&records());
        assert_eq!(table.rows.len(), 36);
        assert_eq!(table.rows[0][..5], [Cell::text("g"), Cell::text("a"), Cell::text("all"), Cell::text("any"), Cell::Count(1)]);
        let chart = tracking_chart(&records(), 0, "test");
        assert_eq!(chart.series[1].points, [(1.0, 0.0), (2.0, 12.0)]);
        // 100 x 1 px / 2 %: the eye distance is 50 px.
        assert!(chart.title.contains("median eye distance 50 px"), "{}", chart.title);
    }

    #[test]
    fn the_printed_table_has_a_column_for_every_part() {
        let table = markdown_last(&records());
        assert_eq!(table.header[3..7], ["all (% ES)", "inner_face (% ES)", "brow (% ES)", "mouth (% ES)"]);
        let row = &table.rows[1];
        assert_eq!(row[3..7], [8.0, 12.0, 4.0, 12.0].map(|v| Cell::Number(v, 2)));
        assert_eq!(row[7..], [Cell::Number(6.0, 2), Cell::Number(6.0, 2), Cell::Number(50.0, 1)]);
    }

    #[test]
    fn worse_frames_count_from_the_fifth() {
        let mut r = records();
        for error in &mut r.errors {
            error.frame += 3; // frames 4 and 5
        }
        assert_eq!(frames_worse(&r, 0, 1), [("g".to_owned(), 1, 0)]);
        assert_eq!(frames_worse(&r, 1, 0), [("g".to_owned(), 1, 1)]);
    }
}
