//! Drawings as PDF: one page, with text in Helvetica. Every PDF reader has it, so the bytes do not depend on installed fonts.

use nalgebra::Point2;
use pdf_writer::{
    Content, Finish, Name, Pdf, Rect, Ref, Str, TextStr,
    types::{LineCapStyle, LineJoinStyle},
};

use super::{Anchor, Colour, Drawing, Mark, Pen, Step, Text};

const REGULAR: Name<'static> = Name(b"F1");
const BOLD: Name<'static> = Name(b"F2");

/// Widths of Helvetica's characters from the blank to `~`, thousandths of the size (Adobe's font metrics).
const WIDTHS: [u16; 95] = [
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278, 556, 556, 556, 556, 556, 556, 556, 556, 556,
    556, 278, 278, 584, 584, 584, 556, 1015, 667, 667, 722, 722, 667, 611, 778, 722, 278, 500, 667, 556, 833, 722, 778, 667, 778,
    722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469, 556, 333, 556, 556, 500, 556, 556, 278, 556, 556, 222, 222,
    500, 222, 833, 556, 556, 556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334, 260, 334, 584,
];
/// Width of other characters: that of most letters.
const OTHER_WIDTH: u16 = 556;

impl Drawing {
    /// Returns a PDF page. Characters outside Latin-1 become the nearest in it, or `?`: the standard fonts have no others.
    pub fn pdf(&self, title: &str) -> Vec<u8> {
        let [catalog, pages, page, content, regular, bold, info] = [1, 2, 3, 4, 5, 6, 7].map(Ref::new);
        let opacities = self.opacities();
        let mut pdf = Pdf::new();
        pdf.catalog(catalog).pages(pages);
        pdf.document_info(info).title(TextStr(title));
        pdf.pages(pages).kids([page]).count(1);
        let mut leaf = pdf.page(page);
        leaf.parent(pages).contents(content).media_box(Rect::new(0.0, 0.0, self.width as f32, self.height as f32));
        let mut resources = leaf.resources();
        resources.fonts().pair(REGULAR, regular).pair(BOLD, bold);
        let mut states = resources.ext_g_states();
        let state = |k: usize| Ref::new(8 + k as i32);
        for k in 0..opacities.len() {
            states.pair(Name(state_name(k).as_bytes()), state(k));
        }
        states.finish();
        resources.finish();
        leaf.finish();
        for (id, name) in [(regular, b"Helvetica".as_slice()), (bold, b"Helvetica-Bold".as_slice())] {
            pdf.type1_font(id).base_font(Name(name)).encoding_predefined(Name(b"WinAnsiEncoding"));
        }
        for (k, &opacity) in opacities.iter().enumerate() {
            pdf.ext_graphics(state(k)).stroking_alpha(opacity as f32).non_stroking_alpha(opacity as f32);
        }
        pdf.stream(content, &self.content(&opacities).finish());
        pdf.finish()
    }

    /// The opacities in use, in the order of the marks.
    fn opacities(&self) -> Vec<f64> {
        let mut found: Vec<f64> = Vec::new();
        for mark in &self.marks {
            if let Mark::Path(pen, _) = mark
                && !found.contains(&pen.opacity)
            {
                found.push(pen.opacity);
            }
        }
        found
    }

    fn content(&self, opacities: &[f64]) -> Content {
        let mut content = Content::new();
        content.set_line_cap(LineCapStyle::RoundCap).set_line_join(LineJoinStyle::RoundJoin);
        // y is up in PDF.
        let to = |p: Point2<f64>| [hundredths(p.x - self.left), hundredths(self.top + self.height - p.y)];
        for mark in &self.marks {
            match mark {
                Mark::Path(pen, steps) => {
                    if let Some(k) = opacities.iter().position(|o| o.to_bits() == pen.opacity.to_bits()) {
                        content.set_parameters(Name(state_name(k).as_bytes()));
                    }
                    path(&mut content, *pen, steps, to);
                }
                Mark::Text(text) => write(&mut content, text, to),
            }
        }
        content
    }
}

fn state_name(k: usize) -> String {
    format!("G{k}")
}

fn hundredths(value: f64) -> f32 {
    ((value * 100.0).round() / 100.0) as f32
}

fn rgb(colour: Colour) -> [f32; 3] {
    colour.map(|c| hundredths(f64::from(c) / 255.0))
}

fn path(content: &mut Content, pen: Pen, steps: &[Step], to: impl Fn(Point2<f64>) -> [f32; 2]) {
    if let Some(colour) = pen.fill {
        let [r, g, b] = rgb(colour);
        content.set_fill_rgb(r, g, b);
    }
    if let Some((colour, width)) = pen.stroke {
        let [r, g, b] = rgb(colour);
        content.set_stroke_rgb(r, g, b).set_line_width(width as f32);
        content.set_dash_pattern(if pen.dashed { vec![5.0, 4.0] } else { Vec::new() }, 0.0);
    }
    for step in steps {
        match *step {
            Step::Move(p) => {
                let [x, y] = to(p);
                content.move_to(x, y);
            }
            Step::Line(p) => {
                let [x, y] = to(p);
                content.line_to(x, y);
            }
            Step::Curve(points) => {
                let [[ax, ay], [bx, by], [cx, cy]] = points.map(&to);
                content.cubic_to(ax, ay, bx, by, cx, cy);
            }
            Step::Close => {
                content.close_path();
            }
        }
    }
    match (pen.fill, pen.stroke) {
        (Some(_), Some(_)) => content.fill_nonzero_and_stroke(),
        (Some(_), None) => content.fill_nonzero(),
        (None, Some(_)) => content.stroke(),
        (None, None) => content.end_path(),
    };
}

fn write(content: &mut Content, text: &Text, to: impl Fn(Point2<f64>) -> [f32; 2]) {
    let bytes = latin(&text.content);
    // Bold letters are wider by about a fifteenth.
    let width = text_width(&text.content, text.size) * if text.bold { 1.065 } else { 1.0 };
    let back = match text.anchor {
        Anchor::Start => 0.0,
        Anchor::Middle => width / 2.0,
        Anchor::End => width,
    };
    let [r, g, b] = rgb(text.colour);
    let [x, y] = to(Point2::new(text.at.x - back, text.at.y));
    content.set_fill_rgb(r, g, b).begin_text().set_font(if text.bold { BOLD } else { REGULAR }, text.size as f32);
    content.next_line(x, y).show(Str(&bytes)).end_text();
}

/// Width of a text in the page's font.
pub fn text_width(text: &str, size: f64) -> f64 {
    let width = |b: &u8| f64::from(WIDTHS.get(usize::from(*b).wrapping_sub(32)).copied().unwrap_or(OTHER_WIDTH));
    latin(text).iter().map(width).sum::<f64>() / 1000.0 * size
}

/// Text in the encoding of the page's fonts, which is Latin-1 for the characters used here.
fn latin(text: &str) -> Vec<u8> {
    let byte = |c: char| match c {
        '\u{2212}' | '\u{2013}' => b'-',
        '\u{2019}' => b'\'',
        ' '..='~' | '\u{a0}'..='\u{ff}' => u8::try_from(u32::from(c)).unwrap_or(b'?'),
        _ => b'?',
    };
    text.chars().map(byte).collect()
}
