//! Triangles to pixels.

use nalgebra::{Point2, Vector2};

/// Calls `visit(x, y, value)` for every pixel whose centre lies in the triangle, clipped to `size`; `value` is the affine
/// interpolation of `values` at the pixel's centre.
///
/// Triangles that share an edge share no pixel and leave none out, whatever their order and winding.
pub fn fill(corners: [Point2<f64>; 3], values: [Point2<f64>; 3], size: (u32, u32), mut visit: impl FnMut(u32, u32, Point2<f64>)) {
    fill_rows(corners, values, size, |Span { y, from, to, start, step }| {
        let mut k = 0.0;
        for x in from..to {
            visit(x, y, start + step * k);
            k += 1.0;
        }
    });
}

/// Pixels of a triangle in one row.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    /// The row.
    pub y: u32,
    /// The first column, and the one behind the last.
    pub from: u32,
    pub to: u32,
    /// Value at the first one's centre, and from one to the next.
    pub start: Point2<f64>,
    pub step: Vector2<f64>,
}

/// As [`fill`], row by row.
pub fn fill_rows(corners: [Point2<f64>; 3], values: [Point2<f64>; 3], size: (u32, u32), mut visit: impl FnMut(Span)) {
    let [a, b, c] = corners;
    let area = (b - a).perp(&(c - a));
    if !(area.abs() > 1e-12) || size.0 == 0 || size.1 == 0 {
        return;
    }
    let (ab, ac) = (values[1] - values[0], values[2] - values[0]);
    let (top, bottom) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
    let first = ceil(top).max(0.0);
    let last = (ceil(bottom) - 1.0).min(f64::from(size.1 - 1));
    let step: Vector2<f64> = ab * ((c - a).y / area) - ac * ((b - a).y / area);
    let mut y = first;
    while y <= last {
        let mut left = f64::INFINITY;
        let mut right = f64::NEG_INFINITY;
        for (p, q) in [(a, b), (b, c), (c, a)] {
            // Each edge from its upper end, so that both of its triangles compute the same crossing.
            let (p, q) = if (p.y, p.x) <= (q.y, q.x) { (p, q) } else { (q, p) };
            if p.y <= y && y < q.y {
                let x = p.x + (y - p.y) * (q.x - p.x) / (q.y - p.y);
                left = left.min(x);
                right = right.max(x);
            }
        }
        let (from, to) = (ceil(left).max(0.0), (ceil(right) - 1.0).min(f64::from(size.0 - 1)));
        if from <= to {
            let at = |x: f64| {
                let p = Point2::new(x, y) - a;
                let (s, t) = (p.perp(&(c - a)) / area, (b - a).perp(&p) / area);
                values[0] + ab * s + ac * t
            };
            visit(Span { y: y as u32, from: from as u32, to: to as u32 + 1, start: at(from), step });
        }
        y += 1.0;
    }
}

/// The smallest whole number not below one that 32 bits hold, and one beyond any picture for others; `f64::ceil` is a call for older processors.
#[inline(always)]
fn ceil(value: f64) -> f64 {
    let whole = f64::from(value as i32);
    if whole < value { whole + 1.0 } else { whole }
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
