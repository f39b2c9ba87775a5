//! Figures of displacement fields, and of wireframes side by side.

use nalgebra::{Point2, Vector2};

use super::{BLUE, DARK, Drawing, HEADING, Lines, Model, ORANGE, Pen, QUIET, SMALL, Step, apex, chains, offset, place, view_box};
use crate::{
    report::{
        drawing::{Anchor, circle, text_width},
        numbers::fixed,
    },
    units::NodeId,
};

/// Common scale of all displacement fields of a run, which makes them comparable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldScale {
    /// Drawn length divided by true length.
    pub gain: f64,
    /// Round length of the scale arrow, face units.
    pub measure: f64,
}

impl FieldScale {
    /// Chooses the scale at which the longest arrow of all models has the largest length that does not hide its neighbours.
    pub fn of<'a>(models: impl IntoIterator<Item = &'a Model>, lines: &Lines) -> Self {
        /// Longest arrow, face units of the drawing: a third of the distance between the eyes.
        const LONGEST: f64 = 340.0;
        let lengths = |model: &'a Model| {
            let motions = (0..apex(model)).flat_map(|m| lines.live.iter().map(move |&n| motion(model, m, n).norm()));
            motions.fold(0.0, f64::max)
        };
        let longest = models.into_iter().map(lengths).fold(1e-9, f64::max);
        let gain = [20.0, 15.0, 10.0, 8.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.5, 1.0, 0.5].into_iter().find(|g| g * longest <= LONGEST);
        let measure = [200.0, 100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0].into_iter().find(|v| *v <= longest);
        Self { gain: gain.unwrap_or(0.2), measure: measure.unwrap_or(1.0) }
    }
}

/// Motion of a node from a key frame to the next, y up (eq. 2).
fn motion(model: &Model, frame: usize, node: NodeId) -> Vector2<f64> {
    offset(model, frame + 1, node) - offset(model, frame, node)
}

/// Mean and largest length of a displacement field, face units.
pub fn lengths(model: &Model, frame: usize, lines: &Lines) -> (f64, f64) {
    let all: Vec<f64> = lines.live.iter().map(|&n| motion(model, frame, n).norm()).collect();
    (all.iter().sum::<f64>() / all.len().max(1) as f64, all.iter().copied().fold(0.0, f64::max))
}

/// Draws the displacement field from a key frame to the next on the wireframe of that frame, within a part of the plane.
///
/// Arrows too short for a head are dots, which distinguish small motion from none.
pub fn field(model: &Model, frame: usize, scale: FieldScale, within: [f64; 4], lines: &Lines) -> Drawing {
    /// Shortest arrow with a head, and smallest length for which a dot is drawn; face units of the drawing.
    const HEADED: f64 = 26.0;
    const SEEN: f64 = 6.0;
    const DOT: f64 = 5.0;
    let mut drawing = Drawing::within(within);
    let at = |n: NodeId| place(model, frame, n);
    lines.draw(&mut drawing, &at, true);
    let mut arrows = Vec::new();
    for &node in &lines.live {
        let v = motion(model, frame, node) * scale.gain;
        if v.norm() >= HEADED {
            arrows.extend(arrow(at(node), Vector2::new(v.x, -v.y)));
        } else if v.norm() >= SEEN {
            arrows.extend(circle(at(node), DOT));
        }
    }
    drawing.path(Pen::line("arrows", BLUE, 1.1).filled(BLUE), arrows);
    drawing
}

/// A straight arrow whose length includes its head.
fn arrow(from: Point2<f64>, v: Vector2<f64>) -> Vec<Step> {
    /// Longest head, face units of the drawing.
    const HEAD: f64 = 60.0;
    let length = v.norm();
    let along = v / length;
    let head = (length * 0.5).min(HEAD);
    let side = Vector2::new(-along.y, along.x) * head * 0.36;
    let (tip, neck) = (from + v, from + v - along * head);
    vec![Step::Move(from), Step::Line(neck), Step::Move(tip), Step::Line(neck + side), Step::Line(neck - side), Step::Close]
}

/// Draws the scale arrow into the lower left corner of a field: towards the subject's left, of the length [`FieldScale::measure`].
pub fn draw_measure(drawing: &mut Drawing, scale: FieldScale, [left, top, _, height]: [f64; 4]) {
    let from = Point2::new(left + 30.0, top + height - 60.0);
    drawing.path(Pen::line("measure", BLUE, 1.1).filled(BLUE), arrow(from, Vector2::new(scale.measure * scale.gain, 0.0)));
}

/// All displacement fields of a model side by side, with the scale arrow and the directions.
pub fn fields(model: &Model, title: &str, scale: FieldScale, within: [f64; 4], lines: &Lines) -> Drawing {
    const WIDE: f64 = 190.0;
    let high = WIDE * within[3] / within[2];
    let count = apex(model);
    let mut sheet = Drawing::new(count.max(2) as f64 * (WIDE + 10.0) + 10.0, high + 96.0);
    sheet.heading(10.0, 18.0, HEADING, Anchor::Start, title);
    let mut shrunk = 1.0;
    for m in 0..count {
        let left = 10.0 + m as f64 * (WIDE + 10.0);
        let middle = left + WIDE / 2.0;
        sheet.text(middle, 36.0, SMALL, Anchor::Middle, format!("key frame {m} to {}", m + 1));
        shrunk = sheet.place(&field(model, m, scale, within, lines), [left, 42.0, WIDE, high]);
        let (mean, longest) = lengths(model, m, lines);
        let note = format!("mean {}, longest {} face units", fixed(mean, 1), fixed(longest, 1));
        sheet.text(middle, high + 56.0, SMALL, Anchor::Middle, note);
    }
    // The scale arrow points to the subject's left, beside the other directions.
    let length = scale.measure * scale.gain * shrunk;
    let y = high + 80.0;
    let pen = Pen::line("arrows", BLUE, 1.1).filled(BLUE);
    let mut measure = Drawing::new(length / shrunk, 1.0);
    measure.path(pen, arrow(Point2::new(0.0, 0.5), Vector2::new(length / shrunk, 0.0)));
    sheet.place(&measure, [10.0, y - 3.5, length, shrunk]);
    let gain = scale.gain;
    let text = format!(
        "{} face units; arrows are {gain} times as long as the motion, at one scale in all figures of this run",
        scale.measure
    );
    sheet.text(16.0 + length, y, SMALL, Anchor::Start, text);
    let (width, _) = sheet.size();
    compass(&mut sheet, Point2::new(width - 96.0, y - 3.0));
    sheet
}

/// Arrows of the directions: up, and the subject's left.
fn compass(sheet: &mut Drawing, at: Point2<f64>) {
    let pen = Pen::line("", DARK, 0.9).filled(DARK);
    for v in [Vector2::new(0.0, -14.0), Vector2::new(14.0, 0.0)] {
        let along = v.normalize();
        let side = Vector2::new(-along.y, along.x) * 2.2;
        let (tip, neck) = (at + v, at + v - along * 5.0);
        sheet.path(
            pen,
            vec![
                Step::Move(at),
                Step::Line(neck),
                Step::Move(tip),
                Step::Line(neck + side),
                Step::Line(neck - side),
                Step::Close,
            ],
        );
    }
    sheet.text(at.x - 4.0, at.y - 8.0, SMALL, Anchor::End, "up");
    sheet.text(at.x + 18.0, at.y + 3.0, SMALL, Anchor::Start, "subject\u{2019}s left");
}

/// The apex of several models side by side, six in a row, with the neutral drawn behind each.
pub fn representatives(models: &[(String, &Model)], lines: &Lines) -> Drawing {
    const COLUMNS: usize = 6;
    const WIDE: f64 = 132.0;
    const LINE: f64 = 12.0;
    let within = view_box(models.iter().map(|(_, m)| *m), lines);
    let high = WIDE * within[3] / within[2];
    let columns = models.len().clamp(1, COLUMNS);
    let rows = models.len().div_ceil(COLUMNS).max(1);
    // The group is below the emotion.
    let lines_of = |label: &str| label.split(", ").map(str::to_owned).collect::<Vec<_>>();
    let most_lines = models.iter().map(|(label, _)| lines_of(label).len()).max().unwrap_or(1);
    let step = high + 16.0 + LINE * most_lines as f64;
    let mut sheet = Drawing::new(columns as f64 * (WIDE + 8.0) + 8.0, rows as f64 * step + 8.0);
    for (k, (label, model)) in models.iter().enumerate() {
        let (left, top) = (8.0 + (k % columns) as f64 * (WIDE + 8.0), 8.0 + (k / columns) as f64 * step);
        let mut face = Drawing::within(within);
        let neutral = |n: NodeId| place(model, 0, n);
        face.path(Pen::line("ghosted", QUIET, 0.7), lines.contours(&neutral));
        face.path(Pen::line("ghosted", QUIET, 0.4), chains(&lines.fine, &neutral));
        let moved = |n: NodeId| place(model, apex(model), n);
        lines.draw(&mut face, &moved, false);
        sheet.place(&face, [left, top, WIDE, high]);
        for (row, line) in lines_of(label).iter().enumerate() {
            // No line is wider than its column.
            let size = SMALL * (WIDE / text_width(line, SMALL)).min(1.0);
            sheet.text(left + WIDE / 2.0, top + high + 14.0 + LINE * row as f64, size, Anchor::Middle, line.as_str());
        }
    }
    sheet
}

/// Variation along a component: the apex of the mean, and of the models on either side.
pub fn spread(title: &str, minus: &Model, mean: &Model, plus: &Model, lines: &Lines) -> Drawing {
    const WIDE: f64 = 260.0;
    let within = view_box([minus, mean, plus], lines);
    let high = WIDE * within[3] / within[2];
    // The legend is wider than the face.
    let mut sheet = Drawing::new(WIDE + 50.0, high + 66.0);
    sheet.heading(10.0, 18.0, HEADING, Anchor::Start, title);
    let mut face = Drawing::within(within);
    let mean_at = |n: NodeId| place(mean, apex(mean), n);
    face.path(Pen::line("edges", QUIET, 0.4).at(0.5), super::pairs(&lines.edges, &mean_at));
    for (model, colour) in [(minus, BLUE), (plus, ORANGE)] {
        let at = |n: NodeId| place(model, apex(model), n);
        face.path(Pen::line("contours", colour, 1.1), lines.contours(&at));
        face.path(Pen::line("fine", colour, 0.6), chains(&lines.fine, &at));
    }
    sheet.place(&face, [25.0, 28.0, WIDE, high]);
    legend(&mut sheet, 10.0, high + 46.0, &[("\u{2212}2 standard deviations", BLUE), ("+2 standard deviations", ORANGE)]);
    sheet
}

/// Colour legend in one row.
pub(super) fn legend(sheet: &mut Drawing, left: f64, y: f64, entries: &[(&str, super::Colour)]) {
    let mut x = left;
    for (name, colour) in entries {
        sheet.polyline(Pen::line("", *colour, 2.0), [Point2::new(x, y - 3.0), Point2::new(x + 14.0, y - 3.0)]);
        sheet.text(x + 19.0, y, SMALL, Anchor::Start, *name);
        // Space for letters of average width.
        x += 34.0 + name.chars().count() as f64 * SMALL * 0.52;
    }
}
