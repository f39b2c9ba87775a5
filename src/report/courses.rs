//! Charts of action units and head pose over time: the mean of every class with its interval, and every sequence.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Point2;
use serde::Serialize;

use super::{
    ReportData,
    drawing::{Anchor, Colour, Drawing, Pen},
    view::group_text,
};
use crate::{
    features::{ACTION_UNITS, COURSE_POINTS, Course},
    output::count,
    statistics::{Representative, t_quantile},
    units::SequenceId,
};

/// Most curves in a chart.
const CURVES: usize = 6;
/// Smallest peak intensity for which an action unit is drawn.
const SEEN: f64 = 0.25;
/// Largest number of sequences drawn; the tables of all are in `features/`.
const MOST_SEQUENCES: usize = 240;
/// Quantile at the upper end of the mean's interval of 95 %.
const UPPER: f64 = 0.975;
/// Largest intensity.
const TOP: f64 = 5.0;
/// Size of a class's chart, of its title in a separate file, and of its text, px.
const SIZE: (f64, f64) = (460.0, 210.0);
const TITLE: f64 = 22.0;
const TEXT: f64 = 10.5;

/// Data for the template.
#[derive(Serialize)]
pub(super) struct CoursesView {
    classes: Vec<ClassView>,
    more: Option<String>,
}

#[derive(Serialize)]
struct ClassView {
    label: String,
    emotion: String,
    group: String,
    sequences: String,
    people: String,
    picture: String,
    members: Vec<MemberView>,
}

#[derive(Serialize)]
struct MemberView {
    id: String,
    units: String,
    pose: String,
}

/// Colours of curves. An action unit has the same colour in every chart; with the dashed lines there are enough for all.
const COLOURS: [Colour; 11] = [
    [0x00, 0x72, 0xb2],
    [0xd5, 0x5e, 0x00],
    [0x00, 0x9e, 0x73],
    [0xcc, 0x79, 0xa7],
    [0x7b, 0x4f, 0xa3],
    [0x56, 0xb4, 0xe9],
    [0x8c, 0x56, 0x4b],
    [0x8a, 0x9a, 0x00],
    [0xe6, 0x9f, 0x00],
    [0x80, 0x80, 0x80],
    [0xb2, 0x18, 0x2b],
];

/// One curve: its name, its means, and half the width of its interval at every time (empty for none).
struct Curve {
    name: String,
    /// Index of its style: of an action unit in the list, of an angle in its order.
    style: usize,
    values: Vec<f64>,
    interval: Vec<f64>,
}

impl Curve {
    fn colour(&self) -> Colour {
        COLOURS[self.style % COLOURS.len()]
    }

    fn pen(&self, width: f64) -> Pen {
        let pen = Pen::line("", self.colour(), width);
        if self.style < COLOURS.len() { pen } else { pen.dashed() }
    }
}

/// Curves of the classes; `None` if no sequence has one.
pub(super) fn view(data: &ReportData<'_>) -> Option<CoursesView> {
    let mut left = MOST_SEQUENCES;
    let mut hidden = 0;
    let mut classes = Vec::new();
    for class in data.representatives {
        let of = courses(class, data.courses);
        if of.is_empty() {
            continue;
        }
        let by_person: Vec<(&str, &Course)> = of.iter().map(|(id, course)| (id.subject.as_str(), *course)).collect();
        let people = by_person.iter().map(|(person, _)| *person).collect::<BTreeSet<_>>().len();
        let curves = mean_curves(&by_person);
        let shown = of.len().min(left);
        left -= shown;
        hidden += of.len() - shown;
        let (emotion, group) = (class.label.emotion.clone(), group_text(&class.label));
        let label = if group.is_empty() { emotion.clone() } else { format!("{emotion}, {group}") };
        let picture =
            chart(&curves, (0.0, TOP), SIZE).inline("course", &format!("Mean intensities of action units over time, {label}"));
        let members = of[..shown].iter().map(|(id, course)| member(id, course)).collect();
        let (sequences, people) = (count(of.len(), "sequence", "sequences"), count(people, "person", "people"));
        classes.push(ClassView { label, emotion, group, sequences, people, picture, members });
    }
    let more =
        (hidden > 0).then(|| format!("{hidden} more sequences are not drawn here. features/ has a table for every sequence."));
    (!classes.is_empty()).then_some(CoursesView { classes, more })
}

/// Chart of a class's mean action unit intensities. `of` has its curves with the names of their people; `None` if empty.
pub fn mean_course(of: &[(&str, &Course)], label: &str) -> Option<Drawing> {
    if of.is_empty() {
        return None;
    }
    let chart = chart(&mean_curves(of), (0.0, TOP), SIZE);
    let mut sheet = Drawing::new(SIZE.0, SIZE.1 + TITLE);
    sheet.heading(8.0, 16.0, TEXT + 0.5, Anchor::Start, label);
    sheet.place(&chart, [0.0, TITLE, SIZE.0, SIZE.1]);
    Some(sheet)
}

/// Chart of a class's mean intensities, as a separate file; `None` if no sequence has a curve.
pub fn mean_course_svg(class: &Representative, courses: &BTreeMap<SequenceId, Course>) -> Option<String> {
    let of: Vec<(&str, &Course)> =
        class.sequences.iter().filter_map(|id| Some((id.subject.as_str(), courses.get(id)?))).collect();
    let group = group_text(&class.label);
    let label = if group.is_empty() { class.label.emotion.clone() } else { format!("{}, {group}", class.label.emotion) };
    let drawing = mean_course(&of, &label)?;
    Some(drawing.svg(&format!("Mean intensities of action units over time, {label}")))
}

fn courses<'a>(class: &'a Representative, all: &'a BTreeMap<SequenceId, Course>) -> Vec<(&'a SequenceId, &'a Course)> {
    class.sequences.iter().filter_map(|id| Some((id, all.get(id)?))).collect()
}

/// Mean curves of the strongest action units: means over people, each represented by the mean of their sequences, with 95 % intervals by
/// Student's t.
fn mean_curves(of: &[(&str, &Course)]) -> Vec<Curve> {
    let mut by_person: BTreeMap<&str, Vec<&Course>> = BTreeMap::new();
    of.iter().for_each(|(person, course)| by_person.entry(person).or_default().push(course));
    let n = by_person.len() as f64;
    let errors = t_quantile(UPPER, n - 1.0).filter(|_| by_person.len() > 1);
    let curve = |k: usize| {
        let of_person = |courses: &Vec<&Course>, t: usize| {
            let sum: f64 = courses.iter().filter_map(|course| course.units.get(t)).map(|units| f64::from(units[k])).sum();
            sum / courses.len() as f64
        };
        let at = |t: usize| by_person.values().map(move |courses| of_person(courses, t));
        let values: Vec<f64> = (0..COURSE_POINTS).map(|t| at(t).sum::<f64>() / n).collect();
        let half = |errors: f64, t: usize| {
            let squares: f64 = at(t).map(|v| (v - values[t]).powi(2)).sum();
            errors * (squares / (n - 1.0) / n).sqrt()
        };
        let interval = errors.map(|errors| (0..COURSE_POINTS).map(|t| half(errors, t)).collect()).unwrap_or_default();
        let name = format!("AU{:02} {}", ACTION_UNITS[k].number, ACTION_UNITS[k].name);
        Curve { name, style: k, values, interval }
    };
    let mut curves: Vec<Curve> = (0..ACTION_UNITS.len()).map(curve).collect();
    let height = |c: &Curve| c.values.iter().copied().fold(0.0, f64::max);
    curves.retain(|c| height(c) >= SEEN);
    curves.sort_by(|a, b| height(b).total_cmp(&height(a)).then_with(|| a.name.cmp(&b.name)));
    curves.truncate(CURVES);
    curves
}

fn member(id: &SequenceId, course: &Course) -> MemberView {
    let size = (330.0, 130.0);
    let units = chart(&mean_curves(&[("", course)]), (0.0, TOP), size).inline("course", &format!("Action units over time, {id}"));
    let angle = |k: usize, name: &str| Curve {
        name: name.to_owned(),
        style: k,
        values: course.pose.iter().map(|pose| f64::from(pose[k])).collect(),
        interval: Vec::new(),
    };
    let curves = [angle(0, "yaw"), angle(1, "pitch"), angle(2, "roll")];
    let largest = curves.iter().flat_map(|c| &c.values).fold(0.0_f64, |most, v| most.max(v.abs()));
    let limit = (largest / 10.0).ceil().max(1.0) * 10.0;
    let pose = chart(&curves, (-limit, limit), (240.0, 130.0));
    let pose = pose.inline("course", &format!("Pose of the head over time in degrees, {id}"));
    MemberView { id: id.to_string(), units, pose }
}

/// A line chart over time from 0 (neutral) to 1 (apex).
fn chart(curves: &[Curve], (low, high): (f64, f64), (width, height): (f64, f64)) -> Drawing {
    let names = if curves.iter().any(|c| c.name.len() > 6) { 172.0 } else { 54.0 };
    let (left, right, top, bottom) = (26.0, width - names, 8.0, height - 22.0);
    let x = |t: usize| left + (right - left) * t as f64 / (COURSE_POINTS - 1) as f64;
    let y = |value: f64| bottom - (bottom - top) * ((value - low) / (high - low)).clamp(0.0, 1.0);
    let mut chart = Drawing::new(width, height);
    for value in [low, f64::midpoint(low, high), high] {
        chart.polyline(Pen::line("grid", [0xdd; 3], 0.8), [Point2::new(left, y(value)), Point2::new(right, y(value))]);
        chart.text(left - 4.0, y(value) + 3.5, TEXT, Anchor::End, crate::output::nine_digits(value).replace('-', "\u{2212}"));
    }
    chart.text(left, bottom + 15.0, TEXT, Anchor::Start, "neutral");
    chart.text(right, bottom + 15.0, TEXT, Anchor::End, "apex");
    let point = |(t, value): (usize, f64)| Point2::new(x(t), y(value));
    for curve in curves {
        if !curve.interval.is_empty() {
            let ends = |sign: f64| curve.values.iter().zip(&curve.interval).map(move |(v, half)| v + sign * half).enumerate();
            let around = ends(1.0).chain(ends(-1.0).collect::<Vec<_>>().into_iter().rev()).map(point);
            chart.polygon(Pen::area(curve.colour()).at(0.12), around);
        }
        chart.polyline(curve.pen(1.8), curve.values.iter().copied().enumerate().map(point));
    }
    for (k, curve) in curves.iter().enumerate() {
        let at = top + 10.0 + 15.0 * k as f64;
        let key = [right + 8.0, right + 20.0].map(|x| Point2::new(x, at - 3.5));
        chart.polyline(curve.pen(2.4), key);
        chart.text(right + 24.0, at, TEXT, Anchor::Start, curve.name.as_str());
    }
    chart
}

#[cfg(test)]
mod tests {
    use super::*;

    fn course(smile: f32) -> Course {
        let mut units = vec![[0.0; ACTION_UNITS.len()]; COURSE_POINTS];
        let at = ACTION_UNITS.iter().position(|unit| unit.number == 12).unwrap();
        units.iter_mut().enumerate().for_each(|(t, row)| row[at] = smile * t as f32 / 12.0);
        Course { pose: vec![[0.0; 3]; COURSE_POINTS], units }
    }

    #[test]
    fn means_have_their_interval_and_what_does_not_move_is_not_drawn() {
        let (a, b) = (course(2.0), course(4.0));
        let curves = mean_curves(&[("P1", &a), ("P2", &b)]);
        assert_eq!(curves.len(), 1);
        assert_eq!(curves[0].name, "AU12 lip corner puller");
        // Mean of 2 and 4 is 3; their standard deviation is sqrt(2), so the standard error is 1, and t with 1 degree of freedom 12.7062.
        assert!((curves[0].values[12] - 3.0).abs() < 1e-6 && (curves[0].interval[12] - 12.7062).abs() < 1e-3);
        assert!(mean_curves(&[("P1", &a)])[0].interval.is_empty());
        // A person counts once, whatever the number of sequences.
        let twice = mean_curves(&[("P1", &a), ("P2", &b), ("P2", &b)]);
        assert_eq!((&twice[0].values, &twice[0].interval), (&curves[0].values, &curves[0].interval));
        assert!(mean_curves(&[("P1", &a), ("P1", &b)])[0].interval.is_empty());
    }

    #[test]
    fn every_action_unit_has_a_style_of_its_own() {
        assert!(ACTION_UNITS.len() <= 2 * COLOURS.len());
        // AU 12 looks the same whether it is the strongest unit or not.
        let one = course(3.0);
        let mut two = course(3.0);
        two.units.iter_mut().enumerate().for_each(|(t, row)| row[0] = 4.0 * t as f32 / 12.0);
        let colour =
            |course: &Course| mean_curves(&[("P1", course)]).iter().find(|c| c.name.starts_with("AU12")).unwrap().colour();
        assert_eq!(mean_curves(&[("P1", &two)])[0].name, "AU01 inner brow raiser");
        assert_eq!(colour(&one), colour(&two));
    }

    #[test]
    fn texts_in_pictures_are_escaped() {
        let svg = chart(&mean_curves(&[("P1", &course(3.0))]), (0.0, 5.0), (300.0, 100.0)).inline("course", "a <b> & \"c\"");
        assert!(svg.contains("aria-label=\"a &lt;b&gt; &amp; &quot;c&quot;\"") && !svg.contains("NaN"), "{svg}");
    }
}
