//! Line charts as SVG.

use plotters::{prelude::*, style::RGBColor};

use super::EvaluateError;

/// Colours that colour-blind readers can distinguish (Okabe and Ito 2008, without yellow).
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(70, 70, 70),
];
const SIZE: (u32, u32) = (860, 500);
/// Width of the legend to the right of the curves, px.
const LEGEND_PX: u32 = 220;
const FONT: &str = "sans-serif";
/// Upper end of the y axis relative to the highest point.
const HEADROOM: f64 = 1.06;

/// One curve of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Points by ascending x; points that are not finite are omitted.
    pub points: Vec<(f64, f64)>,
}

/// A line chart with integer ticks on the x axis and a y axis that starts at 0.
#[derive(Clone, Debug, PartialEq)]
pub struct LineChart {
    /// Title.
    pub title: String,
    /// Name of the x axis.
    pub x_label: String,
    /// Name of the y axis, with its unit.
    pub y_label: String,
    /// Curves; the first one is drawn on top.
    pub series: Vec<Series>,
}

impl LineChart {
    /// Returns the chart as SVG text.
    ///
    /// # Errors
    /// [`EvaluateError::Figure`] when there is no point to draw, or drawing fails.
    pub fn svg(&self) -> Result<String, EvaluateError> {
        let error = |reason: String| EvaluateError::Figure { title: self.title.clone(), reason };
        let (mut x, mut top) = ((f64::INFINITY, f64::NEG_INFINITY), 0.0_f64);
        for &(px, py) in self.series.iter().flat_map(|s| &s.points).filter(|p| p.0.is_finite() && p.1.is_finite()) {
            x = (x.0.min(px), x.1.max(px));
            top = top.max(py);
        }
        if x.0 > x.1 {
            return Err(error("there are no points".to_owned()));
        }
        if x.0 == x.1 {
            x = (x.0 - 0.5, x.1 + 0.5);
        }
        let top = if top > 0.0 { top * HEADROOM } else { 1.0 };
        let mut svg = String::new();
        self.draw(&mut svg, x.0..x.1, 0.0..top).map_err(|e| error(e.to_string()))?;
        Ok(svg)
    }

    fn draw(
        &self,
        svg: &mut String,
        x: std::ops::Range<f64>,
        y: std::ops::Range<f64>,
    ) -> Result<(), DrawingAreaErrorKind<std::io::Error>> {
        let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
        root.fill(&WHITE)?;
        let (plot, legend) = root.split_horizontally(SIZE.0 - LEGEND_PX);
        let ink = RGBColor(40, 40, 40);
        let mut chart = ChartBuilder::on(&plot)
            .caption(&self.title, (FONT, 17).into_font().color(&ink))
            .margin(12)
            .x_label_area_size(46)
            .y_label_area_size(62)
            .build_cartesian_2d(x.clone(), y)?;
        let whole = (x.end - x.start).ceil() as usize + 1;
        chart
            .configure_mesh()
            .disable_x_mesh()
            .light_line_style(WHITE.mix(0.0))
            .bold_line_style(RGBColor(222, 222, 222))
            .axis_style(RGBColor(120, 120, 120))
            .label_style((FONT, 13).into_font().color(&ink))
            .axis_desc_style((FONT, 14).into_font().color(&ink))
            .x_labels(whole.min(26))
            .x_label_formatter(&|v| format!("{v:.0}"))
            .y_labels(8)
            .y_label_formatter(&|v| trimmed(*v))
            .x_desc(&self.x_label)
            .y_desc(&self.y_label)
            .draw()?;
        // Draws in reverse order, so that the first curve lies on top.
        for (k, series) in self.series.iter().enumerate().rev() {
            let colour = COLOURS[k % COLOURS.len()];
            let points: Vec<_> = series.points.iter().copied().filter(|p| p.0.is_finite() && p.1.is_finite()).collect();
            chart.draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(2)))?;
            chart.draw_series(points.iter().map(|&p| Circle::new(p, if k < COLOURS.len() { 3 } else { 2 }, colour.filled())))?;
        }
        // Orders the legend from top to bottom by the last values of the curves.
        let mut order: Vec<usize> = (0..self.series.len()).collect();
        let end = |k: usize| self.series[k].points.last().map_or(0.0, |p| p.1);
        order.sort_by(|&a, &b| end(b).total_cmp(&end(a)).then(a.cmp(&b)));
        for (row, k) in order.into_iter().enumerate() {
            let colour = COLOURS[k % COLOURS.len()];
            let y = 52 + 24 * row as i32;
            legend.draw(&PathElement::new(vec![(2, y), (26, y)], colour.stroke_width(2)))?;
            legend.draw(&Circle::new((14, y), 3, colour.filled()))?;
            legend.draw(&Text::new(self.series[k].name.clone(), (34, y - 8), (FONT, 14).into_font().color(&ink)))?;
        }
        root.present()
    }
}

/// Formats a tick with as few digits as possible.
fn trimmed(value: f64) -> String {
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(points: Vec<(f64, f64)>) -> LineChart {
        let label = |text: &str| text.to_owned();
        let series = vec![Series { name: label("a <b>"), points }];
        LineChart { title: label("T"), x_label: label("frame"), y_label: label("error (px)"), series }
    }

    #[test]
    fn labels_units_and_escaped_names_are_in_the_picture() {
        let svg = chart(vec![(1.0, 0.5), (2.0, 1.5), (3.0, f64::NAN)]).svg().unwrap();
        for text in ["<svg", "error (px)", "frame", "a &lt;b&gt;"] {
            assert!(svg.contains(text), "{text}");
        }
        // Two circles on the curve (the NaN is left out) and one in the legend.
        assert_eq!(svg.matches("<circle").count(), 3);
    }

    #[test]
    fn flat_and_single_points_are_drawn_and_none_is_an_error() {
        assert!(chart(vec![(5.0, 0.0)]).svg().is_ok());
        assert!(chart(vec![]).svg().unwrap_err().to_string().contains("there are no points"));
    }

    #[test]
    fn ticks_are_short() {
        assert_eq!([trimmed(2.0), trimmed(0.25), trimmed(0.0), trimmed(10.0)], ["2", "0.25", "0", "10"]);
    }
}
