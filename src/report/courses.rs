//! Action units and head pose over time, as pictures: the mean of every class with its interval, and every sequence.

use std::{collections::BTreeMap, fmt::Write as _};

use serde::Serialize;

use super::{ReportData, view::group_text};
use crate::{
    features::{ACTION_UNITS, COURSE_POINTS, Course},
    statistics::Representative,
    units::SequenceId,
};

/// Curves in a picture.
const CURVES: usize = 6;
/// Least intensity at any time for which an action unit is drawn.
const SEEN: f64 = 0.25;
/// Sequences that are drawn; the tables of all stand in `features/`.
const MOST_SEQUENCES: usize = 240;
/// Distance of the interval's ends from the mean, standard errors: 95 %.
const INTERVAL: f64 = 1.96;
/// Largest intensity.
const TOP: f64 = 5.0;

/// What the template shows.
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
    sequences: usize,
    picture: String,
    members: Vec<MemberView>,
}

#[derive(Serialize)]
struct MemberView {
    id: String,
    units: String,
    pose: String,
}

/// One curve: its name, its means, and half the width of its interval at every time (empty for none).
struct Curve {
    name: String,
    values: Vec<f64>,
    interval: Vec<f64>,
}

/// The courses of the classes; `None` where no sequence has one.
pub(super) fn view(data: &ReportData<'_>) -> Option<CoursesView> {
    let mut left = MOST_SEQUENCES;
    let mut hidden = 0;
    let mut classes = Vec::new();
    for class in data.representatives {
        let of = courses(class, data.courses);
        if of.is_empty() {
            continue;
        }
        let curves = mean_curves(&of.iter().map(|(_, course)| *course).collect::<Vec<_>>());
        let shown = of.len().min(left);
        left -= shown;
        hidden += of.len() - shown;
        let (emotion, group) = (class.label.emotion.clone(), group_text(&class.label));
        let label = if group.is_empty() { emotion.clone() } else { format!("{emotion}, {group}") };
        let picture =
            picture(&curves, (0.0, TOP), &format!("Mean intensities of action units over time, {label}"), (460.0, 210.0));
        let members = of[..shown].iter().map(|(id, course)| member(id, course)).collect();
        classes.push(ClassView { label, emotion, group, sequences: of.len(), picture, members });
    }
    let more = (hidden > 0).then(|| format!("{hidden} more sequences are not drawn here; features/ has the table of every one."));
    (!classes.is_empty()).then_some(CoursesView { classes, more })
}

/// The picture of a class's mean intensities, as a file of its own; `None` where no sequence has a course.
pub fn mean_course_svg(class: &Representative, courses: &BTreeMap<SequenceId, Course>) -> Option<String> {
    let of: Vec<&Course> = class.sequences.iter().filter_map(|id| courses.get(id)).collect();
    if of.is_empty() {
        return None;
    }
    let label = format!("Mean intensities of action units over time, {}", class.label.emotion);
    let svg = picture(&mean_curves(&of), (0.0, TOP), &label, (460.0, 210.0));
    let style = "<style>text{font:11px sans-serif;fill:#333}.axis{stroke:#666}.grid{stroke:#ddd}</style>";
    let opened = svg.replacen("<svg ", "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"460\" height=\"210\" ", 1);
    Some(opened.replacen('>', &format!(">{style}"), 1))
}

fn courses<'a>(class: &'a Representative, all: &'a BTreeMap<SequenceId, Course>) -> Vec<(&'a SequenceId, &'a Course)> {
    class.sequences.iter().filter_map(|id| Some((id, all.get(id)?))).collect()
}

/// The strongest action units of some sequences: means and 95 % intervals of the mean.
fn mean_curves(of: &[&Course]) -> Vec<Curve> {
    let n = of.len() as f64;
    let curve = |k: usize| {
        let at = |t: usize| of.iter().filter_map(move |course| course.units.get(t)).map(move |units| f64::from(units[k]));
        let values: Vec<f64> = (0..COURSE_POINTS).map(|t| at(t).sum::<f64>() / n).collect();
        let half = |t: usize| {
            let squares: f64 = at(t).map(|v| (v - values[t]).powi(2)).sum();
            INTERVAL * (squares / (n - 1.0) / n).sqrt()
        };
        let interval = if of.len() > 1 { (0..COURSE_POINTS).map(half).collect() } else { Vec::new() };
        Curve { name: format!("AU{:02} {}", ACTION_UNITS[k].number, ACTION_UNITS[k].name), values, interval }
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
    let units = picture(&mean_curves(&[course]), (0.0, TOP), &format!("Action units over time, {id}"), size);
    let angle = |k: usize, name: &str| Curve {
        name: name.to_owned(),
        values: course.pose.iter().map(|pose| f64::from(pose[k])).collect(),
        interval: Vec::new(),
    };
    let curves = [angle(0, "yaw"), angle(1, "pitch"), angle(2, "roll")];
    let largest = curves.iter().flat_map(|c| &c.values).fold(0.0_f64, |most, v| most.max(v.abs()));
    let limit = (largest / 10.0).ceil().max(1.0) * 10.0;
    let pose = picture(&curves, (-limit, limit), &format!("Pose of the head over time in degrees, {id}"), (240.0, 130.0));
    MemberView { id: id.to_string(), units, pose }
}

/// A line chart over time from 0 (neutral) to 1 (apex); colours are classes of the style sheet, `course-0` to `course-5`.
fn picture(curves: &[Curve], (low, high): (f64, f64), label: &str, (width, height): (f64, f64)) -> String {
    const COLOURS: [&str; CURVES] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
    let names = if curves.iter().any(|c| c.name.len() > 6) { 172.0 } else { 54.0 };
    let (left, right, top, bottom) = (26.0, width - names, 8.0, height - 22.0);
    let x = |t: usize| left + (right - left) * t as f64 / (COURSE_POINTS - 1) as f64;
    let y = |value: f64| bottom - (bottom - top) * ((value - low) / (high - low)).clamp(0.0, 1.0);
    let mut svg =
        format!("<svg class=\"course\" viewBox=\"0 0 {width:.0} {height:.0}\" role=\"img\" aria-label=\"{}\">", escaped(label));
    for value in [low, f64::midpoint(low, high), high] {
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{left:.1}\" x2=\"{right:.1}\" y1=\"{0:.1}\" y2=\"{0:.1}\"/><text x=\"{1:.1}\" y=\"{2:.1}\" \
             text-anchor=\"end\">{3}</text>",
            y(value),
            left - 4.0,
            y(value) + 3.5,
            crate::output::nine_digits(value)
        );
    }
    let _ = write!(
        svg,
        "<text x=\"{left:.1}\" y=\"{0:.1}\">neutral</text><text x=\"{right:.1}\" y=\"{0:.1}\" text-anchor=\"end\">apex</text>",
        bottom + 15.0
    );
    let path = |points: &mut dyn Iterator<Item = (f64, f64)>| {
        points.map(|(x, y)| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
    };
    for (curve, colour) in curves.iter().zip(COLOURS) {
        if !curve.interval.is_empty() {
            let ends = |sign: f64| curve.values.iter().zip(&curve.interval).map(move |(v, half)| v + sign * half).enumerate();
            let mut around = ends(1.0).chain(ends(-1.0).collect::<Vec<_>>().into_iter().rev()).map(|(t, v)| (x(t), y(v)));
            let _ = write!(svg, "<polygon points=\"{}\" fill=\"{colour}\" fill-opacity=\"0.16\"/>", path(&mut around));
        }
        let mut line = curve.values.iter().enumerate().map(|(t, v)| (x(t), y(*v)));
        let _ = write!(svg, "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.8\"/>", path(&mut line));
    }
    for (k, (curve, colour)) in curves.iter().zip(COLOURS).enumerate() {
        let at = top + 10.0 + 15.0 * k as f64;
        let _ = write!(
            svg,
            "<line x1=\"{0:.1}\" x2=\"{1:.1}\" y1=\"{2:.1}\" y2=\"{2:.1}\" stroke=\"{colour}\" stroke-width=\"2.4\"/><text x=\"{3:.1}\" \
             y=\"{4:.1}\">{5}</text>",
            right + 8.0,
            right + 20.0,
            at - 3.5,
            right + 24.0,
            at,
            escaped(&curve.name)
        );
    }
    svg + "</svg>"
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
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
        let curves = mean_curves(&[&a, &b]);
        assert_eq!(curves.len(), 1);
        assert_eq!(curves[0].name, "AU12 lip corner puller");
        // Mean of 2 and 4 is 3; their standard deviation is sqrt(2), so the standard error is 1.
        assert!((curves[0].values[12] - 3.0).abs() < 1e-6 && (curves[0].interval[12] - 1.96).abs() < 1e-6);
        assert!(mean_curves(&[&a])[0].interval.is_empty());
    }

    #[test]
    fn texts_in_pictures_are_escaped() {
        let svg = picture(&mean_curves(&[&course(3.0)]), (0.0, 5.0), "a <b> & \"c\"", (300.0, 100.0));
        assert!(svg.contains("aria-label=\"a &lt;b&gt; &amp; &quot;c&quot;\"") && !svg.contains("NaN"), "{svg}");
    }
}
