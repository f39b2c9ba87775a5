//! Triangles to pixels.

use nalgebra::{Point2, Vector2};

/// Calls `visit(x, y, value)` for every pixel whose centre lies in the triangle, clipped to `size`; `value` is the affine
/// interpolation of `values` at the pixel's centre.
///
/// Triangles that share an edge share no pixel and leave none out, whatever their order and winding.
pub fn fill(corners: [Point2<f64>; 3], values: [Point2<f64>; 3], size: (u32, u32), mut visit: impl FnMut(u32, u32, Point2<f64>)) {
    let [a, b, c] = corners;
    let area = (b - a).perp(&(c - a));
    if !(area.abs() > 1e-12) || size.0 == 0 || size.1 == 0 {
        return;
    }
    let (ab, ac) = (values[1] - values[0], values[2] - values[0]);
    let (top, bottom) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
    let first = top.ceil().max(0.0);
    let last = (bottom.ceil() - 1.0).min(f64::from(size.1 - 1));
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
        let (from, to) = (left.ceil().max(0.0), (right.ceil() - 1.0).min(f64::from(size.0 - 1)));
        if from <= to {
            let at = |x: f64| {
                let p = Point2::new(x, y) - a;
                let (s, t) = (p.perp(&(c - a)) / area, (b - a).perp(&p) / area);
                values[0] + ab * s + ac * t
            };
            let start = at(from);
            let step: Vector2<f64> = ab * ((c - a).y / area) - ac * ((b - a).y / area);
            let mut k = 0.0;
            for x in from as u32..=to as u32 {
                visit(x, y as u32, start + step * k);
                k += 1.0;
            }
        }
        y += 1.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f64, y: f64) -> Point2<f64> {
        Point2::new(x, y)
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
