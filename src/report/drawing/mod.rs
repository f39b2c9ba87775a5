//! Line drawings of paths and text: one description of a figure, written as SVG and as PDF.
//!
//! Lengths are px (in PDF points), x right, y down. On a page ([`Drawing::inline`]) marks are drawn by the classes of the style sheet; in a
//! separate file every mark has its own colours.

mod pdf;
mod svg;

use nalgebra::Point2;

pub use pdf::text_width;

/// A colour, red, green and blue from 0 to 255.
pub type Colour = [u8; 3];

/// One step of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// Begins a part.
    Move(Point2<f64>),
    /// A straight line.
    Line(Point2<f64>),
    /// A cubic curve: two control points and its end.
    Curve([Point2<f64>; 3]),
    /// Line back to the start of the subpath.
    Close,
}

impl Step {
    fn map(self, to: impl Fn(Point2<f64>) -> Point2<f64>) -> Self {
        match self {
            Self::Move(p) => Self::Move(to(p)),
            Self::Line(p) => Self::Line(to(p)),
            Self::Curve(points) => Self::Curve(points.map(to)),
            Self::Close => Self::Close,
        }
    }
}

/// Style of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pen {
    /// Class in the style sheets of pages; empty if the colours suffice.
    pub class: &'static str,
    /// Colour and width of the line, px.
    pub stroke: Option<(Colour, f64)>,
    /// Fill colour of the area.
    pub fill: Option<Colour>,
    /// Opacity of both, 0 to 1.
    pub opacity: f64,
    /// Whether the line is dashed.
    pub dashed: bool,
}

impl Pen {
    /// Returns a line with a class.
    pub const fn line(class: &'static str, colour: Colour, width: f64) -> Self {
        Self { class, stroke: Some((colour, width)), fill: None, opacity: 1.0, dashed: false }
    }

    /// Returns an area with a colour.
    pub const fn area(colour: Colour) -> Self {
        Self { class: "", stroke: None, fill: Some(colour), opacity: 1.0, dashed: false }
    }

    /// Returns the pen with another opacity.
    pub const fn at(self, opacity: f64) -> Self {
        Self { opacity, ..self }
    }

    /// Returns the pen with a filled area.
    pub const fn filled(self, colour: Colour) -> Self {
        Self { fill: Some(colour), ..self }
    }

    /// Returns the pen with a dashed line.
    pub const fn dashed(self) -> Self {
        Self { dashed: true, ..self }
    }
}

/// The part of a text that lies at its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Its start.
    Start,
    /// Its middle.
    Middle,
    /// Its end.
    End,
}

/// A line of text.
#[derive(Clone, Debug, PartialEq)]
pub struct Text {
    /// Position on the base line.
    pub at: Point2<f64>,
    /// Size, px.
    pub size: f64,
    /// Alignment of the text to its position.
    pub anchor: Anchor,
    /// Colour in separate files.
    pub colour: Colour,
    /// Whether it is bold.
    pub bold: bool,
    /// The text.
    pub content: String,
}

#[derive(Clone, Debug, PartialEq)]
enum Mark {
    Path(Pen, Vec<Step>),
    Text(Text),
}

/// A drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
    marks: Vec<Mark>,
}

impl Drawing {
    /// Returns an empty drawing with its corner at 0, 0.
    pub fn new(width: f64, height: f64) -> Self {
        Self::within([0.0, 0.0, width, height])
    }

    /// Returns an empty drawing with the given left, top, width and height.
    pub fn within([left, top, width, height]: [f64; 4]) -> Self {
        Self { left, top, width, height, marks: Vec::new() }
    }

    /// Width and height.
    pub fn size(&self) -> (f64, f64) {
        (self.width, self.height)
    }

    /// Draws a path; an empty or non-finite one is ignored.
    pub fn path(&mut self, pen: Pen, steps: Vec<Step>) {
        let finite = |step: &Step| match step {
            Step::Move(p) | Step::Line(p) => p.x.is_finite() && p.y.is_finite(),
            Step::Curve(points) => points.iter().all(|p| p.x.is_finite() && p.y.is_finite()),
            Step::Close => true,
        };
        if !steps.is_empty() && steps.iter().all(finite) {
            self.marks.push(Mark::Path(pen, steps));
        }
    }

    /// Draws a line through points.
    pub fn polyline(&mut self, pen: Pen, points: impl IntoIterator<Item = Point2<f64>>) {
        self.path(pen, polyline(points, false));
    }

    /// Draws the area bounded by points.
    pub fn polygon(&mut self, pen: Pen, points: impl IntoIterator<Item = Point2<f64>>) {
        self.path(pen, polyline(points, true));
    }

    /// Draws a circle.
    pub fn circle(&mut self, pen: Pen, centre: Point2<f64>, radius: f64) {
        self.path(pen, circle(centre, radius));
    }

    /// Writes a line of text of the given size.
    pub fn text(&mut self, x: f64, y: f64, size: f64, anchor: Anchor, text: impl Into<String>) {
        let text = Text { at: Point2::new(x, y), size, anchor, colour: INK, bold: false, content: text.into() };
        self.marks.push(Mark::Text(text));
    }

    /// Writes a heading.
    pub fn heading(&mut self, x: f64, y: f64, size: f64, anchor: Anchor, text: impl Into<String>) {
        let text = Text { at: Point2::new(x, y), size, anchor, colour: INK, bold: true, content: text.into() };
        self.marks.push(Mark::Text(text));
    }

    /// Places another drawing centred in a part of this one, as large as it fits. Line widths stay the same. Returns the magnification.
    pub fn place(&mut self, other: &Self, [left, top, width, height]: [f64; 4]) -> f64 {
        let scale = (width / other.width).min(height / other.height);
        let (dx, dy) = (left + (width - other.width * scale) / 2.0, top + (height - other.height * scale) / 2.0);
        let to = |p: Point2<f64>| Point2::new(dx + (p.x - other.left) * scale, dy + (p.y - other.top) * scale);
        self.marks.extend(other.marks.iter().map(|mark| match mark {
            Mark::Path(pen, steps) => Mark::Path(*pen, steps.iter().map(|step| step.map(to)).collect()),
            Mark::Text(text) => Mark::Text(Text { at: to(text.at), size: text.size * scale, ..text.clone() }),
        }));
        scale
    }
}

/// Colour of text and axes in files.
pub const INK: Colour = [0x2b, 0x2f, 0x33];

/// Line through points, or around them if closed.
pub fn polyline(points: impl IntoIterator<Item = Point2<f64>>, closed: bool) -> Vec<Step> {
    let mut steps: Vec<Step> =
        points.into_iter().enumerate().map(|(k, p)| if k == 0 { Step::Move(p) } else { Step::Line(p) }).collect();
    if closed && !steps.is_empty() {
        steps.push(Step::Close);
    }
    steps
}

/// A circle of four cubic curves, within 0.03 % of its radius.
pub fn circle(centre: Point2<f64>, radius: f64) -> Vec<Step> {
    /// Distance from the end of a quarter to its control point, in radii.
    const KAPPA: f64 = 0.552_284_749_8;
    let at = |x: f64, y: f64| Point2::new(centre.x + x * radius, centre.y + y * radius);
    let quarter = |[ax, ay]: [f64; 2], [bx, by]: [f64; 2]| {
        Step::Curve([at(ax + KAPPA * bx, ay + KAPPA * by), at(bx + KAPPA * ax, by + KAPPA * ay), at(bx, by)])
    };
    let corners = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]];
    let mut steps = vec![Step::Move(at(1.0, 0.0))];
    steps.extend(corners.windows(2).map(|pair| quarter(pair[0], pair[1])));
    steps.push(Step::Close);
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> Drawing {
        let mut drawing = Drawing::new(100.0, 50.0);
        drawing.polyline(Pen::line("edges", [255, 0, 0], 2.0), [Point2::new(0.0, 0.0), Point2::new(10.0, 20.0)]);
        drawing.text(50.0, 25.0, 10.0, Anchor::Middle, "a <b> & \u{2212}1 ü");
        drawing
    }

    #[test]
    fn a_file_says_its_colours_and_a_page_its_classes() {
        let (file, page) = (example().svg("A & B"), example().inline("wire", "A \"B\""));
        assert!(file.contains(r##"<path d="M0 0L10 20" fill="none" stroke="#ff0000" stroke-width="2""##), "{file}");
        assert!(page.contains(r#"<path class="edges" d="m0 0 10 20"/>"#) && !page.contains("#ff0000"), "{page}");
        assert!(file.contains("a &lt;b&gt; &amp; \u{2212}1 ü") && file.contains("<title>A &amp; B</title>"));
        assert!(page.contains(r#"class="wire""#) && page.contains("aria-label=\"A &quot;B&quot;\""));
    }

    #[test]
    fn a_placed_drawing_keeps_its_shape_and_its_lines() {
        let mut sheet = Drawing::new(300.0, 300.0);
        // 100 x 50 into 200 x 200: twice as large, 50 px below the top.
        assert_eq!(sheet.place(&example(), [100.0, 0.0, 200.0, 200.0]), 2.0);
        assert!(sheet.svg("").contains(r##"d="M100 50L120 90" fill="none" stroke="#ff0000" stroke-width="2""##));
    }

    #[test]
    fn a_circle_is_round() {
        for step in circle(Point2::new(1.0, 2.0), 3.0) {
            if let Step::Curve([.., end]) = step {
                assert!(((end - Point2::new(1.0, 2.0)).norm() - 3.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn what_is_not_finite_is_not_drawn() {
        let mut drawing = Drawing::new(1.0, 1.0);
        drawing.polyline(Pen::line("", [0; 3], 1.0), [Point2::new(0.0, 0.0), Point2::new(f64::NAN, 0.0)]);
        assert_eq!(drawing, Drawing::new(1.0, 1.0));
    }

    #[test]
    fn a_pdf_is_one_page_with_its_text_in_latin_1() {
        let pdf = example().pdf("A").into_iter().map(char::from).collect::<String>();
        assert!(pdf.starts_with("%PDF-1.7") && pdf.contains("/MediaBox [0 0 100 50]") && pdf.contains("/Helvetica"));
        // y is up in PDF: from the upper left to 10, 20 below it; the minus sign becomes a hyphen, the ü stays.
        assert!(pdf.contains("0 50 m\n10 30 l"), "{pdf}");
        assert!(pdf.to_uppercase().contains("<61203C623E2026202D3120FC>"), "{pdf}");
        assert_eq!(example().pdf("A"), example().pdf("A"));
    }
}
