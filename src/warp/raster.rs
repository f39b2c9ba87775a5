//! Rasterization of triangles.

use nalgebra::{Point2, Vector2};

use super::sample::WHOLE;
use crate::simd::widest;

/// Calls `visit(x, y, value)` for every pixel whose centre lies in the triangle, clipped to `size`; `value` is the affine
/// interpolation of `values` at the pixel's centre.
///
/// Triangles that share an edge cover each pixel along it exactly once, whatever their order and winding.
pub fn fill(corners: [Point2<f64>; 3], values: [Point2<f64>; 3], size: (u32, u32), mut visit: impl FnMut(u32, u32, Point2<f64>)) {
    fill_rows(corners, values, size, |Span { y, from, to, start, step }| {
        let mut k = 0.0;
        for x in from..to {
            visit(x, y, start + step * k);
            k += 1.0;
        }
    });
}

/// [`fill`] for a quadrangle with corners in order, as the two triangles on either side of the diagonal from its first corner.
pub fn fill_quadrangle(
    corners: [Point2<f64>; 4],
    values: [Point2<f64>; 4],
    size: (u32, u32),
    mut visit: impl FnMut(u32, u32, Point2<f64>),
) {
    for triangle in [[0, 1, 2], [0, 2, 3]] {
        fill(triangle.map(|c: usize| corners[c]), triangle.map(|c| values[c]), size, &mut visit);
    }
}

/// Pixels of a triangle in one row.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    /// The row.
    pub y: u32,
    /// First column, and one past the last.
    pub from: u32,
    pub to: u32,
    /// Value at the centre of the first pixel, and its step per pixel.
    pub start: Point2<f64>,
    pub step: Vector2<f64>,
}

/// [`fill`] row by row.
pub fn fill_rows(corners: [Point2<f64>; 3], values: [Point2<f64>; 3], size: (u32, u32), mut visit: impl FnMut(Span)) {
    let [a, b, c] = corners;
    let area = (b - a).perp(&(c - a));
    if !(area.abs() > 1e-12) || size.0 == 0 || size.1 == 0 {
        return;
    }
    let (ab, ac) = (values[1] - values[0], values[2] - values[0]);
    // Each edge is directed from its upper end, so that both of its triangles compute the same crossing.
    let edges = [(a, b), (b, c), (c, a)].map(|(p, q)| if (p.y, p.x) <= (q.y, q.x) { [p, q] } else { [q, p] });
    let triangle = Triangle { edges, a, b: b - a, c: c - a, area, value: values[0], ab, ac, right: f64::from(size.0 - 1) };
    let step = ab * ((c - a).y / area) - ac * ((b - a).y / area);
    let (top, bottom) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
    let last = (ceil(bottom) - 1.0).min(f64::from(size.1 - 1));
    let mut first = ceil(top).max(0.0);
    while first <= last {
        let rows = widest(
            #[inline(always)]
            || triangle.rows(first),
        );
        for k in 0..ROWS {
            let y = first + k as f64;
            let (from, to) = (rows.from[k], rows.to[k]);
            if y <= last && from <= to {
                let start = Point2::new(rows.x[k], rows.y[k]);
                visit(Span { y: y as u32, from: from as u32, to: to as u32 + 1, start, step });
            }
        }
        first += ROWS as f64;
    }
}

/// Number of rows computed at once.
const ROWS: usize = 8;

/// A triangle to be filled.
struct Triangle {
    /// Its edges, each directed from its upper end.
    edges: [[Point2<f64>; 2]; 3],
    /// Its first corner, and the vectors from it to the others.
    a: Point2<f64>,
    b: Vector2<f64>,
    c: Vector2<f64>,
    area: f64,
    /// Value at the first corner, and the differences at the others.
    value: Point2<f64>,
    ab: Vector2<f64>,
    ac: Vector2<f64>,
    /// Last column of the image.
    right: f64,
}

/// For several rows: first and last column, and value at the first.
struct Rows {
    from: [f64; ROWS],
    to: [f64; ROWS],
    x: [f64; ROWS],
    y: [f64; ROWS],
}

impl Triangle {
    /// Computes [`ROWS`] rows from `first` on.
    #[inline(always)]
    #[allow(clippy::needless_bitwise_bool)] // branches would be taken one at a time
    fn rows(&self, first: f64) -> Rows {
        let (mut left, mut right) = ([f64::INFINITY; ROWS], [f64::NEG_INFINITY; ROWS]);
        for [p, q] in &self.edges {
            for k in 0..ROWS {
                let y = first + k as f64;
                let x = p.x + (y - p.y) * (q.x - p.x) / (q.y - p.y);
                let crosses = (p.y <= y) & (y < q.y);
                left[k] = if crosses & (x < left[k]) { x } else { left[k] };
                right[k] = if crosses & (x > right[k]) { x } else { right[k] };
            }
        }
        let mut rows = Rows { from: left, to: right, x: [0.0; ROWS], y: [0.0; ROWS] };
        for k in 0..ROWS {
            rows.from[k] = ceil(left[k]).max(0.0);
            rows.to[k] = (ceil(right[k]) - 1.0).min(self.right);
            let (x, y) = (rows.from[k] - self.a.x, first + k as f64 - self.a.y);
            let (s, t) = ((x * self.c.y - y * self.c.x) / self.area, (self.b.x * y - self.b.y * x) / self.area);
            rows.x[k] = self.value.x + self.ab.x * s + self.ac.x * t;
            rows.y[k] = self.value.y + self.ab.y * s + self.ac.y * t;
        }
        rows
    }
}

/// Ceiling of a value in the range of pixel coordinates; on older processors `f64::ceil` is a function call.
#[inline(always)]
fn ceil(value: f64) -> f64 {
    let near = (value + WHOLE) - WHOLE;
    if near < value { near + 1.0 } else { near }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f64, y: f64) -> Point2<f64> {
        Point2::new(x, y)
    }

    #[test]
    fn the_smallest_whole_number_not_below() {
        for value in [-1.0, -0.999, -1e-17, -0.0, 0.0, 1e-17, 0.999_999, 1.0, 1.5, 65_535.0, 65_534.000_1] {
            assert_eq!(ceil(value), value.ceil(), "{value}");
        }
        assert!(ceil(f64::INFINITY) > 1e9 && ceil(1e12) > 1e9 && ceil(f64::NEG_INFINITY) < -1e9);
    }

    #[test]
    fn two_triangles_cover_their_square_once() {
        let (a, b, c, d) = (point(0.3, 0.2), point(9.7, 1.1), point(8.2, 9.9), point(1.4, 8.6));
        let mut hits = [0; 144];
        for corners in [[a, b, c], [c, d, a]] {
            fill(corners, corners, (12, 12), |x, y, at| {
                hits[(y * 12 + x) as usize] += 1;
                // The identity: every pixel comes from itself.
                assert!((at - point(f64::from(x), f64::from(y))).norm() < 1e-9);
            });
        }
        assert!(hits.iter().all(|&h| h <= 1));
        // Pixels well inside are all there: columns and rows 2 to 7.
        assert!((2..8).all(|y| (2..8).all(|x| hits[y * 12 + x] == 1)));
    }

    #[test]
    fn nothing_outside_the_image_is_visited() {
        let far = [point(-1e9, -1e9), point(1e9, -1e9), point(0.0, 1e9)];
        let mut count = 0;
        fill(far, far, (5, 4), |x, y, _| {
            assert!(x < 5 && y < 4);
            count += 1;
        });
        assert_eq!(count, 20);
    }
}
