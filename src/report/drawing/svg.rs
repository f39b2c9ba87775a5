//! Drawings as SVG.

use std::fmt::Write as _;

use nalgebra::Point2;

use super::{Anchor, Drawing, Mark, Pen, Step, Text};

/// Fonts of a separate file; the PDF has the first.
const FONTS: &str = "Helvetica, Arial, sans-serif";

impl Drawing {
    /// Returns a complete SVG file on a white background.
    pub fn svg(&self, title: &str) -> String {
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0}\" height=\"{1}\" viewBox=\"{2} {3} {0} {1}\" font-family=\"{FONTS}\">\n\
             <title>{4}</title>\n<rect x=\"{2}\" y=\"{3}\" width=\"{0}\" height=\"{1}\" fill=\"#fff\"/>\n",
            number(self.width),
            number(self.height),
            number(self.left),
            number(self.top),
            escaped(title)
        );
        for mark in &self.marks {
            match mark {
                Mark::Path(pen, steps) => {
                    let _ = writeln!(svg, "<path d=\"{}\"{}/>", data(steps, TENTHS), attributes(*pen));
                }
                Mark::Text(text) => {
                    let weight = if text.bold { " font-weight=\"bold\"" } else { "" };
                    let _ = writeln!(
                        svg,
                        "<text{}{weight} fill=\"{}\">{}</text>",
                        place(text),
                        hex(text.colour),
                        escaped(&text.content)
                    );
                }
            }
        }
        svg + "</svg>\n"
    }

    /// Returns an SVG element for a page, drawn by its style sheet.
    pub fn inline(&self, class: &str, label: &str) -> String {
        // Drawings in face units are shown at a tenth of their size, so whole numbers match the resolution of the screen.
        let steps_of = if self.width > LARGE { 1.0 } else { TENTHS };
        let mut svg = format!(
            "<svg class=\"{class}\" viewBox=\"{} {} {} {}\" role=\"img\" aria-label=\"{}\">",
            number(self.left),
            number(self.top),
            number(self.width),
            number(self.height),
            escaped(label)
        );
        for mark in &self.marks {
            let _ = match mark {
                Mark::Path(pen, steps) if pen.class.is_empty() => {
                    let d = relative(steps, steps_of);
                    write!(svg, "<path d=\"{d}\"{} vector-effect=\"non-scaling-stroke\"/>", attributes(*pen))
                }
                Mark::Path(pen, steps) => write!(svg, "<path class=\"{}\" d=\"{}\"/>", pen.class, relative(steps, steps_of)),
                Mark::Text(text) => write!(svg, "<text{}>{}</text>", place(text), escaped(&text.content)),
            };
        }
        svg + "</svg>"
    }
}

/// Width from which a drawing is in face units.
const LARGE: f64 = 1000.0;
/// Steps per px to which coordinates are rounded.
const TENTHS: f64 = 10.0;

/// A number rounded to a tenth.
fn number(value: f64) -> String {
    rounded(value, TENTHS)
}

/// A number rounded to the given steps per unit.
fn rounded(value: f64, parts: f64) -> String {
    let rounded = (value * parts).round() / parts;
    // Avoids a minus sign before zero.
    if rounded == 0.0 { "0".to_owned() } else { format!("{rounded}") }
}

fn data(steps: &[Step], parts: f64) -> String {
    let n = |value: f64| rounded(value, parts);
    let mut data = String::new();
    for step in steps {
        let _ = match step {
            Step::Move(p) => write!(data, "M{} {}", n(p.x), n(p.y)),
            Step::Line(p) => write!(data, "L{} {}", n(p.x), n(p.y)),
            Step::Curve([a, b, c]) => write!(data, "C{} {} {} {} {} {}", n(a.x), n(a.y), n(b.x), n(b.y), n(c.x), n(c.y)),
            Step::Close => write!(data, "Z"),
        };
    }
    data
}

/// The same steps in relative coordinates, each from the end of the previous one, in few bytes. A line of length zero is left out unless it
/// is the only one.
fn relative(steps: &[Step], parts: f64) -> String {
    let whole = |p: &Point2<f64>| [(p.x * parts).round() as i64, (p.y * parts).round() as i64];
    let mut data = String::new();
    let (mut at, mut start) = ([0, 0], [0, 0]);
    let (mut command, mut drawn) = (' ', false);
    for step in steps {
        let (letter, points) = match step {
            Step::Move(p) => ('m', vec![whole(p)]),
            Step::Line(p) if drawn && whole(p) == at => continue,
            Step::Line(p) => ('l', vec![whole(p)]),
            Step::Curve(points) => ('c', points.iter().map(whole).collect()),
            Step::Close => ('z', Vec::new()),
        };
        // Lines need no letter after a move, and lines and curves none after their own kind.
        let needs_letter = letter != command && !(letter == 'l' && command == 'm') || matches!(letter, 'm' | 'z');
        if needs_letter {
            data.push(letter);
        }
        for (index, value) in points.iter().flat_map(|p| [p[0] - at[0], p[1] - at[1]]).enumerate() {
            let text = rounded(value as f64 / parts, parts);
            let follows_letter = needs_letter && index == 0;
            if !follows_letter && !text.starts_with('-') {
                data.push(' ');
            }
            data.push_str(&text);
        }
        (command, drawn) = (letter, letter != 'm');
        if letter == 'm' {
            start = points[0];
        }
        at = points.last().copied().unwrap_or(start);
    }
    data
}

fn attributes(pen: Pen) -> String {
    let fill = pen.fill.map_or_else(|| "none".to_owned(), hex);
    let mut text = format!(" fill=\"{fill}\"");
    if let Some((colour, width)) = pen.stroke {
        let _ = write!(
            text,
            " stroke=\"{}\" stroke-width=\"{width}\" stroke-linejoin=\"round\" stroke-linecap=\"round\"",
            hex(colour)
        );
    }
    if pen.dashed {
        text += " stroke-dasharray=\"5 4\"";
    }
    if pen.opacity < 1.0 {
        let _ = write!(text, " opacity=\"{}\"", pen.opacity);
    }
    text
}

fn place(text: &Text) -> String {
    let anchor = match text.anchor {
        Anchor::Start => "",
        Anchor::Middle => " text-anchor=\"middle\"",
        Anchor::End => " text-anchor=\"end\"",
    };
    format!(" x=\"{}\" y=\"{}\" font-size=\"{}\"{anchor}", number(text.at.x), number(text.at.y), number(text.size))
}

fn hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_steps_lead_to_the_same_places() {
        let p = Point2::new;
        let steps = [
            Step::Move(p(10.0, 20.0)),
            Step::Line(p(13.0, 20.0)),
            Step::Line(p(13.2, 20.4)),
            Step::Line(p(13.0, 18.0)),
            Step::Close,
            Step::Move(p(11.0, 21.0)),
            Step::Curve([p(12.0, 21.0), p(12.0, 22.0), p(11.0, 22.0)]),
            Step::Curve([p(10.0, 22.0), p(9.0, 20.0), p(-1.0, 0.0)]),
            Step::Move(p(5.0, 5.0)),
            Step::Line(p(5.0, 5.0)),
        ];
        // The third line has length zero after rounding to whole px.
        assert_eq!(relative(&steps, 1.0), "m10 20 3 0 0-2zm1 1c1 0 1 1 0 1-1 0-2-2-12-22m6 5 0 0");
        assert_eq!(relative(&steps[..3], 10.0), "m10 20 3 0 0.2 0.4");
    }
}
