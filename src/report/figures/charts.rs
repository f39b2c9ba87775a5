//! Charts: FAPs over the key frames with bands of the people's values, and distances of models to the others.

use nalgebra::Point2;

use super::{BLUE, DARK, Drawing, HEADING, ORANGE, Pen, QUIET, SMALL, ticks};
use crate::report::drawing::{Anchor, Step};

/// The values of a FAP over the key frames.
#[derive(Clone, Debug, PartialEq)]
pub struct BandFigure {
    /// Its number and name.
    pub label: String,
    /// Its unit.
    pub unit: String,
    /// By key frame: representative, mean, and the 5, 25, 50, 75 and 95 % quantiles over the people.
    pub rows: Vec<[f64; 7]>,
}

/// Charts of FAPs, three in a row.
pub fn bands(title: &str, curves: &[BandFigure]) -> Drawing {
    const COLUMNS: usize = 3;
    const WIDE: f64 = 210.0;
    const HIGH: f64 = 150.0;
    let rows = curves.len().div_ceil(COLUMNS).max(1);
    let mut sheet = Drawing::new(COLUMNS as f64 * WIDE + 10.0, 50.0 + rows as f64 * HIGH);
    sheet.heading(10.0, 18.0, HEADING, Anchor::Start, title);
    for (k, curve) in curves.iter().enumerate() {
        band(
            &mut sheet,
            [(k % COLUMNS) as f64 * WIDE + 10.0, 28.0 + (k / COLUMNS) as f64 * HIGH],
            [WIDE - 14.0, HIGH - 16.0],
            curve,
        );
    }
    let y = 42.0 + rows as f64 * HIGH;
    sheet.polyline(Pen::line("", DARK, 1.6), [Point2::new(10.0, y - 3.0), Point2::new(28.0, y - 3.0)]);
    sheet.text(34.0, y, SMALL, Anchor::Start, "representative");
    sheet.polyline(Pen::line("", DARK, 1.0).dashed(), [Point2::new(120.0, y - 3.0), Point2::new(138.0, y - 3.0)]);
    sheet.text(144.0, y, SMALL, Anchor::Start, "mean");
    sheet.text(
        190.0,
        y,
        SMALL,
        Anchor::Start,
        "areas: ranges of half and nine tenths of the people; horizontal axis: key frames",
    );
    sheet
}

fn band(sheet: &mut Drawing, [left, top]: [f64; 2], [width, height]: [f64; 2], curve: &BandFigure) {
    let all = || curve.rows.iter().flatten().copied().filter(|v| v.is_finite());
    let (low, high) = (all().fold(0.0, f64::min), all().fold(0.0, f64::max).max(1e-9));
    let (x0, x1, y0, y1) = (left + 34.0, left + width, top + height - 16.0, top + 18.0);
    let last = curve.rows.len().saturating_sub(1).max(1) as f64;
    let x = |m: usize| x0 + (x1 - x0) * m as f64 / last;
    let y = |v: f64| y0 - (y0 - y1) * (v - low) / (high - low).max(1e-9);
    sheet.text(left, top + 10.0, SMALL, Anchor::Start, format!("{}, {}", curve.label, curve.unit));
    let (list, digits) = ticks(low, high, 4.0);
    for value in list {
        let grid = Pen::line("grid", QUIET, 0.5).at(0.4);
        sheet.polyline(grid, [Point2::new(x0, y(value)), Point2::new(x1, y(value))]);
        sheet.text(x0 - 5.0, y(value) + 3.2, SMALL - 1.0, Anchor::End, format!("{value:.digits$}").replace('-', "\u{2212}"));
    }
    for m in 0..curve.rows.len() {
        sheet.text(x(m), y0 + 12.0, SMALL - 1.0, Anchor::Middle, m.to_string());
    }
    let line = |k: usize| curve.rows.iter().enumerate().map(move |(m, row)| Point2::new(x(m), y(row[k]))).collect::<Vec<_>>();
    for (a, b) in [(2, 6), (3, 5)] {
        sheet.polygon(Pen::area(BLUE).at(0.18), line(a).into_iter().chain(line(b).into_iter().rev()));
    }
    sheet.polyline(Pen::line("", DARK, 1.0).dashed(), line(1));
    sheet.polyline(Pen::line("", DARK, 1.6), line(0));
}

/// Distances of models in one row of a strip chart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StripRow {
    /// Measured quantity.
    pub label: String,
    /// Distance of every model, face units, and whether trimming dropped it.
    pub points: Vec<(f64, bool)>,
    /// Position of the median line.
    pub median: Option<f64>,
}

/// Strip chart of rows of distances, with a dot for every model.
pub fn distances(title: &str, rows: &[StripRow]) -> Drawing {
    const WIDE: f64 = 460.0;
    const HIGH: f64 = 44.0;
    const RADIUS: f64 = 2.4;
    let mut sheet = Drawing::new(WIDE + 20.0, 84.0 + rows.len() as f64 * HIGH);
    sheet.heading(10.0, 18.0, HEADING, Anchor::Start, title);
    let most = rows.iter().flat_map(|r| &r.points).map(|p| p.0).filter(|v| v.is_finite()).fold(1e-9, f64::max) * 1.03;
    let (left, right, top) = (110.0, WIDE, 28.0);
    let bottom = top + rows.len() as f64 * HIGH;
    let x = |v: f64| left + (right - left) * v / most;
    let (list, digits) = ticks(0.0, most, 6.0);
    for value in list {
        let grid = Pen::line("grid", QUIET, 0.5).at(0.4);
        sheet.polyline(grid, [Point2::new(x(value), top), Point2::new(x(value), bottom)]);
        sheet.text(x(value), bottom + 13.0, SMALL, Anchor::Middle, format!("{value:.digits$}"));
    }
    sheet.text(f64::midpoint(left, right), bottom + 28.0, SMALL, Anchor::Middle, "distance, face units");
    for (k, row) in rows.iter().enumerate() {
        let middle = top + (k as f64 + 0.5) * HIGH;
        sheet.text(10.0, middle + 3.0, SMALL, Anchor::Start, row.label.as_str());
        if let Some(median) = row.median {
            let half = HIGH * 0.42;
            sheet.polyline(
                Pen::line("", DARK, 1.3),
                [Point2::new(x(median), middle - half), Point2::new(x(median), middle + half)],
            );
        }
        let mut sorted: Vec<(f64, bool)> = row.points.iter().copied().filter(|p| p.0.is_finite()).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut crosses = Vec::new();
        for (place, (value, dropped)) in sorted.into_iter().enumerate() {
            // Adjacent dots are shifted vertically.
            let up = [0.0, -1.0, 1.0, -2.0, 2.0, -0.5, 0.5][place % 7] * 2.4 * RADIUS;
            let at = Point2::new(x(value), middle + up);
            if dropped {
                for (dx, dy) in [(RADIUS, RADIUS), (RADIUS, -RADIUS)] {
                    crosses
                        .extend([Step::Move(Point2::new(at.x - dx, at.y - dy)), Step::Line(Point2::new(at.x + dx, at.y + dy))]);
                }
            } else {
                sheet.circle(Pen::area(BLUE).at(0.8), at, RADIUS);
            }
        }
        sheet.path(Pen::line("", ORANGE, 1.4), crosses);
    }
    sheet.text(10.0, bottom + 46.0, SMALL, Anchor::Start, "dots: models; orange crosses: dropped by trimming; line: median");
    sheet
}
