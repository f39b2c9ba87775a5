//! Maps of values on the face: dispersion, and differences between groups.

use nalgebra::Point2;

use super::{
    BLUE, Colour, Drawing, HEADING, Lines, Model, ORANGE, Pen, SMALL, Step, apex, chains, fields::legend, place, ticks, view_box,
};
use crate::{
    report::drawing::{Anchor, circle},
    units::NodeId,
};

/// Viridis in eleven steps, interpolated linearly; even in lightness and safe for colour-blind readers. The bar under the maps of the
/// report (`maps.js`) has the same colours.
const VIRIDIS: [Colour; 11] = [
    [0x44, 0x01, 0x54],
    [0x48, 0x24, 0x75],
    [0x41, 0x44, 0x87],
    [0x35, 0x5f, 0x8d],
    [0x2a, 0x78, 0x8e],
    [0x21, 0x91, 0x8c],
    [0x22, 0xa8, 0x84],
    [0x44, 0xbf, 0x70],
    [0x7a, 0xd1, 0x51],
    [0xbd, 0xdf, 0x26],
    [0xfd, 0xe7, 0x25],
];

/// Number of shades in a map, high enough to make their borders invisible.
const SHADES: usize = 60;

/// Colour of a share from 0 to 1.
fn viridis(share: f64) -> Colour {
    let x = share.clamp(0.0, 1.0) * (VIRIDIS.len() - 1) as f64;
    let k = (x.floor() as usize).min(VIRIDIS.len() - 2);
    let part = x - k as f64;
    std::array::from_fn(|c| (f64::from(VIRIDIS[k][c]) * (1.0 - part) + f64::from(VIRIDIS[k + 1][c]) * part).round() as u8)
}

/// Smallest and largest of the values of nodes.
pub fn range(values: &dyn Fn(NodeId) -> f64, lines: &Lines) -> (f64, f64) {
    let all = lines.live.iter().map(|&n| values(n)).filter(|v| v.is_finite());
    let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low <= high { (low, high.max(low + 1e-9)) } else { (0.0, 1.0) }
}

/// Draws values on the face, linear in every triangle, with shades from `low` to `high`.
fn draw_map(
    face: &mut Drawing,
    values: &dyn Fn(NodeId) -> f64,
    (low, high): (f64, f64),
    at: &dyn Fn(NodeId) -> Point2<f64>,
    lines: &Lines,
) {
    let mut shades: Vec<Vec<Step>> = vec![Vec::new(); SHADES];
    for triangle in &lines.triangles {
        let corners = triangle.map(|n| (at(n), ((values(n) - low) / (high - low) * SHADES as f64).clamp(0.0, SHADES as f64)));
        if corners.iter().any(|(_, v)| !v.is_finite()) {
            continue;
        }
        for (k, shade) in shades.iter_mut().enumerate() {
            shade.extend(super::polyline(between(&corners, k as f64, (k + 1) as f64), true));
        }
    }
    for (k, steps) in shades.into_iter().enumerate() {
        let colour = viridis((k as f64 + 0.5) / SHADES as f64);
        // A thin line in the same colour closes the seams between adjacent areas.
        face.path(Pen { stroke: Some((colour, 0.35)), ..Pen::area(colour) }, steps);
    }
    face.path(Pen::line("edges", [0; 3], 0.3).at(0.22), super::pairs(&lines.edges, at));
    face.path(Pen::line("fine", [0; 3], 0.5).at(0.6), chains(&lines.fine, at));
    face.path(Pen::line("contours", [0; 3], 0.8).at(0.6), lines.contours(at));
}

/// The part of a triangle with values between two limits; may be empty.
fn between(corners: &[(Point2<f64>, f64); 3], low: f64, high: f64) -> Vec<Point2<f64>> {
    let clip = |polygon: Vec<(Point2<f64>, f64)>, limit: f64, sign: f64| {
        let mut kept: Vec<(Point2<f64>, f64)> = Vec::new();
        for (k, &(p, v)) in polygon.iter().enumerate() {
            let (q, w) = polygon[(k + 1) % polygon.len()];
            let (inside, next) = ((v - limit) * sign >= 0.0, (w - limit) * sign >= 0.0);
            if inside {
                kept.push((p, v));
            }
            if inside != next {
                kept.push((p + (q - p) * ((limit - v) / (w - v)), limit));
            }
        }
        kept
    };
    let polygon = clip(clip(corners.to_vec(), low, 1.0), high, -1.0);
    if polygon.len() < 3 { Vec::new() } else { polygon.into_iter().map(|(p, _)| p).collect() }
}

/// Colour bar of a map with its values.
fn colour_bar(sheet: &mut Drawing, [left, top, width, height]: [f64; 4], (low, high): (f64, f64), unit: &str) {
    let step = width / SHADES as f64;
    for k in 0..SHADES {
        let x = left + k as f64 * step;
        let colour = viridis((k as f64 + 0.5) / SHADES as f64);
        let corners = [(x, top), (x + step + 0.3, top), (x + step + 0.3, top + height), (x, top + height)];
        sheet.polygon(Pen::area(colour), corners.map(|(x, y)| Point2::new(x, y)));
    }
    let (list, digits) = ticks(low, high, 5.0);
    for value in list {
        let x = left + width * (value - low) / (high - low);
        sheet.polyline(Pen::line("", super::DARK, 0.6), [Point2::new(x, top + height), Point2::new(x, top + height + 3.0)]);
        sheet.text(x, top + height + 13.0, SMALL, Anchor::Middle, format!("{value:.digits$}"));
    }
    sheet.text(left + width / 2.0, top + height + 27.0, SMALL, Anchor::Middle, unit);
}

/// Map of node values on the neutral face, within a part of the plane, from the smallest to the largest shade; some nodes have rings.
pub fn map(
    model: &Model,
    values: &dyn Fn(NodeId) -> f64,
    span: (f64, f64),
    ringed: &[NodeId],
    within: [f64; 4],
    lines: &Lines,
) -> Drawing {
    const RING: f64 = 15.0;
    let mut face = Drawing::within(within);
    let neutral = |n: NodeId| place(model, 0, n);
    draw_map(&mut face, values, span, &neutral, lines);
    for &node in ringed {
        face.path(Pen::line("differs", [255; 3], 1.2), circle(neutral(node), RING));
    }
    face
}

/// Map of the dispersion per node on the neutral face, over its own range.
pub fn dispersion(title: &str, model: &Model, values: &[f64], lines: &Lines) -> Drawing {
    const WIDE: f64 = 280.0;
    let value = |n: NodeId| values.get(n.index()).copied().unwrap_or(0.0);
    let span = range(&value, lines);
    let within = neutral_box(model, lines);
    let high = WIDE * within[3] / within[2];
    let mut sheet = Drawing::new(WIDE + 40.0, high + 84.0);
    sheet.heading(20.0, 18.0, HEADING, Anchor::Start, title);
    sheet.place(&map(model, &value, span, &[], within, lines), [20.0, 28.0, WIDE, high]);
    colour_bar(&mut sheet, [20.0, high + 38.0, WIDE, 9.0], span, "dispersion per node, face units");
    sheet
}

fn neutral_box(model: &Model, lines: &Lines) -> [f64; 4] {
    let neutral = model.frames().first().cloned().and_then(|frame| Model::new(vec![frame.clone(), frame]).ok());
    neutral.map_or([0.0, 0.0, 1.0, 1.0], |still| view_box([&still], lines))
}

/// Figure of two groups: their representatives at the apex, where they differ, and a description in words below.
pub fn difference(
    title: &str,
    names: [&str; 2],
    models: [&Model; 2],
    (energy, differs): (&dyn Fn(NodeId) -> f64, bool),
    differing: &[NodeId],
    words: &[String],
    lines: &Lines,
) -> Drawing {
    const WIDE: f64 = 250.0;
    let within = view_box(models, lines);
    let high = WIDE * within[3] / within[2];
    let mut sheet = Drawing::new(2.0 * WIDE + 60.0, high + 100.0 + 14.0 * words.len() as f64);
    sheet.heading(20.0, 18.0, HEADING, Anchor::Start, title);
    let mut both = Drawing::within(within);
    for (model, colour) in models.into_iter().zip([BLUE, ORANGE]) {
        let at = |n: NodeId| place(model, apex(model), n);
        both.path(Pen::line("contours", colour, 1.2), lines.contours(&at));
        both.path(Pen::line("fine", colour, 0.7), chains(&lines.fine, &at));
    }
    sheet.text(20.0 + WIDE / 2.0, 36.0, SMALL, Anchor::Middle, "representatives at the apex");
    sheet.place(&both, [20.0, 42.0, WIDE, high]);
    let span = (0.0, range(energy, lines).1.max(1e-9));
    let differences = map(models[0], energy, span, differing, within, lines);
    let shown = if differs { "where they differ" } else { "distance of every node; not shown to differ" };
    sheet.text(40.0 + 1.5 * WIDE, 36.0, SMALL, Anchor::Middle, shown);
    sheet.place(&differences, [40.0 + WIDE, 42.0, WIDE, high]);
    colour_bar(&mut sheet, [40.0 + WIDE, high + 50.0, WIDE, 9.0], span, "energy distance per node, face units");
    legend(&mut sheet, 20.0, high + 60.0, &[(names[0], BLUE), (names[1], ORANGE)]);
    if !differing.is_empty() {
        sheet.text(20.0, high + 76.0, SMALL, Anchor::Start, "white rings: nodes that differ");
    }
    for (k, line) in words.iter().enumerate() {
        sheet.text(20.0, high + 104.0 + 14.0 * k as f64, SMALL, Anchor::Start, line.as_str());
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_is_cut_where_its_values_are() {
        let corners = [(Point2::new(0.0, 0.0), 0.0), (Point2::new(10.0, 0.0), 10.0), (Point2::new(0.0, 10.0), 0.0)];
        // Values are x; between 0 and 5 lies the left part, its area 50 less the 12.5 of the triangle beyond 5.
        let area = |points: &[Point2<f64>]| {
            let sum: f64 =
                (0..points.len()).map(|k| (points[k], points[(k + 1) % points.len()])).map(|(p, q)| p.x * q.y - q.x * p.y).sum();
            sum.abs() / 2.0
        };
        assert!((area(&between(&corners, 0.0, 5.0)) - 37.5).abs() < 1e-9);
        assert!((area(&between(&corners, 5.0, 10.0)) - 12.5).abs() < 1e-9);
        assert!(between(&corners, 11.0, 12.0).is_empty());
    }

    #[test]
    fn the_map_gets_lighter_with_every_step() {
        let luminance = |c: Colour| 0.21 * f64::from(c[0]) + 0.72 * f64::from(c[1]) + 0.07 * f64::from(c[2]);
        let steps: Vec<f64> = (0..=20).map(|k| luminance(viridis(f64::from(k) / 20.0))).collect();
        assert!(steps.is_sorted_by(|a, b| a < b), "{steps:?}");
        assert_eq!((viridis(-1.0), viridis(2.0)), (VIRIDIS[0], VIRIDIS[10]));
    }
}
