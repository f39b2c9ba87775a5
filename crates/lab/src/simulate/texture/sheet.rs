//! A raster over the plane, and the brushes to paint on it.

use nalgebra::Point2;
use tiny_skia::{FillRule, LineCap, PathBuilder, Stroke, Transform};

/// A point of the plane in single precision: model units, y up.
pub type P = Point2<f32>;

/// Position of the raster on the plane: texel (i, j) covers `1 / scale` units, with (0, 0) at the top left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheet {
    /// Texels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Texels per model unit.
    pub scale: f32,
    /// Plane x of the left edge.
    pub left: f32,
    /// Plane y of the top edge.
    pub top: f32,
}

impl Sheet {
    /// Returns the plane position of a texel's centre.
    pub fn at(&self, i: usize, j: usize) -> P {
        P::new(self.left + (i as f32 + 0.5) / self.scale, self.top - (j as f32 + 0.5) / self.scale)
    }

    /// Returns the raster position of a plane point; texel (i, j) covers `i..i + 1`, `j..j + 1`.
    pub fn raster(&self, p: P) -> (f32, f32) {
        ((p.x - self.left) * self.scale, (self.top - p.y) * self.scale)
    }

    /// Returns the texels within `reach` units of a box, as ranges of i and j.
    fn window(&self, low: P, high: P, reach: f32) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let (i0, j0) = self.raster(P::new(low.x - reach, high.y + reach));
        let (i1, j1) = self.raster(P::new(high.x + reach, low.y - reach));
        let clip = |from: f32, to: f32, size: usize| {
            let from = (from.floor().max(0.0) as usize).min(size);
            from..((to.ceil().max(0.0) as usize).min(size)).max(from)
        };
        (clip(i0, i1, self.width), clip(j0, j1, self.height))
    }

    /// Adds a Gaussian bump of height `amount` to a field over the sheet; `sigma` holds the standard deviations along and across the
    /// direction `angle` (radians).
    pub fn bump(&self, field: &mut [f32], centre: P, sigma: (f32, f32), angle: f32, amount: f32) {
        let (sin, cos) = angle.sin_cos();
        let (columns, rows) = self.window(centre, centre, 3.2 * sigma.0.max(sigma.1));
        for j in rows {
            for i in columns.clone() {
                let d = self.at(i, j) - centre;
                let (u, v) = ((d.x * cos + d.y * sin) / sigma.0, (d.y * cos - d.x * sin) / sigma.1);
                field[j * self.width + i] += amount * (-0.5 * (u * u + v * v)).exp();
            }
        }
    }

    /// Returns the coverage of a closed outline, blurred by `blur` units.
    pub fn fill(&self, outline: &[P], blur: f32) -> Mask {
        self.cover(outline, blur, 0.0, true)
    }

    /// Returns the coverage of an open line of the given width (units), blurred by `blur` units.
    pub fn line(&self, points: &[P], width: f32, blur: f32) -> Mask {
        self.cover(points, blur, width, false)
    }

    fn cover(&self, points: &[P], blur: f32, width: f32, closed: bool) -> Mask {
        let bound = |pick: fn(f32, f32) -> f32, start: f32| {
            P::new(points.iter().map(|p| p.x).fold(start, pick), points.iter().map(|p| p.y).fold(start, pick))
        };
        let (low, high) = (bound(f32::min, f32::INFINITY), bound(f32::max, f32::NEG_INFINITY));
        let (columns, rows) = self.window(low, high, width + 3.0 * blur + 2.0 / self.scale);
        let empty = Mask { left: 0, top: 0, width: 0, data: Vec::new() };
        let Some(mut mask) = tiny_skia::Pixmap::new(columns.len() as u32, rows.len() as u32) else { return empty };
        let Some(path) = path(self, points, closed) else { return empty };
        let shift = Transform::from_translate(-(columns.start as f32), -(rows.start as f32));
        let paint = tiny_skia::Paint { anti_alias: true, ..Default::default() };
        if closed {
            mask.fill_path(&path, &paint, FillRule::Winding, shift, None);
        } else {
            let stroke = Stroke { width: width * self.scale, line_cap: LineCap::Round, ..Stroke::default() };
            mask.stroke_path(&path, &paint, &stroke, shift, None);
        }
        let mut data: Vec<f32> = mask.pixels().iter().map(|p| f32::from(p.alpha()) / 255.0).collect();
        if blur > 0.0 {
            blur_box(&mut data, columns.len(), rows.len(), blur * self.scale);
        }
        Mask { left: columns.start, top: rows.start, width: columns.len(), data }
    }
}

/// Returns a line or outline as a path in raster coordinates.
pub fn path(sheet: &Sheet, points: &[P], closed: bool) -> Option<tiny_skia::Path> {
    let mut builder = PathBuilder::new();
    for (k, &p) in points.iter().enumerate() {
        let (x, y) = sheet.raster(p);
        if k == 0 { builder.move_to(x, y) } else { builder.line_to(x, y) }
    }
    if closed {
        builder.close();
    }
    builder.finish()
}

/// Coverage, 0 to 1, over a window of the sheet, and 0 elsewhere.
#[derive(Clone, Debug)]
pub struct Mask {
    left: usize,
    top: usize,
    width: usize,
    data: Vec<f32>,
}

impl Mask {
    /// Returns every covered texel as (index in the sheet, coverage).
    pub fn texels(&self, sheet: &Sheet) -> impl Iterator<Item = (usize, f32)> + '_ {
        let sheet_width = sheet.width;
        self.data.iter().enumerate().filter(|&(_, &c)| c > 0.0).map(move |(k, &c)| {
            let (i, j) = (self.left + k % self.width, self.top + k / self.width);
            (j * sheet_width + i, c)
        })
    }

    /// Returns the mask as a field over the whole sheet.
    pub fn spread(&self, sheet: &Sheet) -> Vec<f32> {
        let mut field = vec![0.0; sheet.width * sheet.height];
        for (index, coverage) in self.texels(sheet) {
            field[index] = coverage;
        }
        field
    }
}

/// Applies three box blurs in each direction, which approximate a Gaussian of the given standard deviation (texels). Values outside are
/// zero.
fn blur_box(data: &mut [f32], width: usize, height: usize, sigma: f32) {
    let radius = (((4.0 * sigma * sigma + 1.0).sqrt() - 1.0) / 2.0).round() as usize;
    if radius == 0 {
        return;
    }
    let mut line = Vec::new();
    for _ in 0..3 {
        for j in 0..height {
            blur_line(data, j * width, 1, width, radius, &mut line);
        }
        for i in 0..width {
            blur_line(data, i, width, height, radius, &mut line);
        }
    }
}

fn blur_line(data: &mut [f32], start: usize, stride: usize, count: usize, radius: usize, line: &mut Vec<f32>) {
    line.clear();
    line.extend((0..count).map(|k| data[start + k * stride]));
    let inverse = 1.0 / (2 * radius + 1) as f32;
    let mut sum: f32 = line.iter().take(radius).sum();
    for k in 0..count {
        if let Some(entering) = line.get(k + radius) {
            sum += entering;
        }
        data[start + k * stride] = (sum * inverse).clamp(0.0, 1.0);
        if k >= radius {
            sum -= line[k - radius];
        }
    }
}

/// Returns a smooth curve (Catmull-Rom) through points, with `steps` pieces between neighbours.
pub fn smooth(points: &[P], closed: bool, steps: usize) -> Vec<P> {
    let n = points.len() as isize;
    let at = |k: isize| -> P { if closed { points[k.rem_euclid(n) as usize] } else { points[k.clamp(0, n - 1) as usize] } };
    let pieces = if closed { n } else { n - 1 };
    let mut curve = Vec::with_capacity(pieces as usize * steps + 1);
    for k in 0..pieces {
        let (a, b, c, d) = (at(k - 1).coords, at(k).coords, at(k + 1).coords, at(k + 2).coords);
        for step in 0..steps {
            let t = step as f32 / steps as f32;
            let (t2, t3) = (t * t, t * t * t);
            let value = b * 2.0 + (c - a) * t + (a * 2.0 - b * 5.0 + c * 4.0 - d) * t2 + (b * 3.0 - a - c * 3.0 + d) * t3;
            curve.push(P::from(value / 2.0));
        }
    }
    if !closed {
        curve.push(at(n - 1));
    }
    curve
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHEET: Sheet = Sheet { width: 100, height: 80, scale: 50.0, left: -1.0, top: 0.8 };

    #[test]
    fn a_filled_square_covers_its_area_and_blur_keeps_it() {
        let square = [P::new(-0.2, -0.2), P::new(0.2, -0.2), P::new(0.2, 0.2), P::new(-0.2, 0.2)];
        // 0.4 x 0.4 units at 50 texels per unit: 400 texels.
        for blur in [0.0, 0.05] {
            let area: f32 = SHEET.fill(&square, blur).texels(&SHEET).map(|(_, c)| c).sum();
            assert!((area - 400.0).abs() < 4.0, "{area}");
        }
    }

    #[test]
    fn smooth_curves_pass_through_their_points() {
        let points = [P::new(0.0, 0.0), P::new(1.0, 2.0), P::new(3.0, 1.0)];
        let curve = smooth(&points, false, 4);
        assert_eq!((curve[0], curve[4], curve[8]), (points[0], points[1], points[2]));
        assert_eq!(curve.len(), 9);
    }
}
