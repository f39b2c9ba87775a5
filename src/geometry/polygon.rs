//! Polygons and polylines in the plane.

use nalgebra::{Point2, Vector2};

/// Returns whether a point lies inside a closed polygon (even-odd rule).
pub fn inside(polygon: &[Point2<f64>], point: &Point2<f64>) -> bool {
    let mut odd = false;
    let Some(&(mut previous)) = polygon.last() else { return false };
    for &corner in polygon {
        if (corner.y > point.y) != (previous.y > point.y) {
            let x = previous.x + (point.y - previous.y) * (corner.x - previous.x) / (corner.y - previous.y);
            if point.x < x {
                odd = !odd;
            }
        }
        previous = corner;
    }
    odd
}

/// Returns the lower and upper corners of the points' bounding box, or `None` if there are no points.
pub fn bounds(points: &[Point2<f64>]) -> Option<(Point2<f64>, Point2<f64>)> {
    let first = *points.first()?;
    Some(points.iter().fold((first, first), |(low, high), p| (low.inf(p), high.sup(p))))
}

/// Distance of a point from a polyline.
pub fn distance_to_line(line: &[Point2<f64>], point: &Point2<f64>) -> f64 {
    distance_within(line, point, f64::INFINITY)
}

/// [`distance_to_line`] if it is at most `reach`; otherwise a value of at least that distance. Segments beyond `reach` are skipped.
pub fn distance_within(line: &[Point2<f64>], point: &Point2<f64>, reach: f64) -> f64 {
    let near = line.windows(2).filter(|w| may_be_within(&w[0], &w[1], point, reach));
    near.map(|w| squared_distance(&w[0], &w[1], point)).fold(f64::INFINITY, f64::min).sqrt()
}

/// Returns whether a point can be within `reach` of a segment: it lies in the segment's bounding box, enlarged by `reach`.
fn may_be_within(a: &Point2<f64>, b: &Point2<f64>, point: &Point2<f64>, reach: f64) -> bool {
    // Enlarged slightly to allow for rounding.
    let reach = Vector2::repeat(1.001 * reach);
    let (low, high) = (a.inf(b) - reach, a.sup(b) + reach);
    low.x <= point.x && point.x <= high.x && low.y <= point.y && point.y <= high.y
}

/// Distance of a point from a segment.
pub fn distance_to_segment(a: &Point2<f64>, b: &Point2<f64>, point: &Point2<f64>) -> f64 {
    squared_distance(a, b, point).sqrt()
}

fn squared_distance(a: &Point2<f64>, b: &Point2<f64>, point: &Point2<f64>) -> f64 {
    let (edge, to) = (b - a, point - a);
    let along = (to.dot(&edge) / edge.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    (to - edge * along).norm_squared()
}

/// Distance of a point from a closed polygon's border, positive inside, negative outside.
pub fn inside_depth(polygon: &[Point2<f64>], point: &Point2<f64>) -> f64 {
    inside_depth_within(polygon, point, f64::INFINITY)
}

/// [`inside_depth`] if its magnitude is at most `reach`; otherwise a value of the same sign and at least that magnitude.
pub fn inside_depth_within(polygon: &[Point2<f64>], point: &Point2<f64>, reach: f64) -> f64 {
    let ends = polygon.iter().zip(polygon.iter().cycle().skip(1)).filter(|(a, b)| may_be_within(a, b, point, reach));
    let nearest = ends.map(|(a, b)| squared_distance(a, b, point)).fold(f64::INFINITY, f64::min).sqrt();
    if inside(polygon, point) { nearest } else { -nearest }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_within_reach_is_as_far_as_it_is() {
        let line = [(0.0, 0.0), (10.0, 2.0), (20.0, -3.0)].map(|(x, y)| Point2::new(x, y));
        for k in 0..900 {
            let point = Point2::new(f64::from(k % 30) - 5.0, f64::from(k / 30) - 15.0);
            let (whole, near) = (distance_to_line(&line, &point), distance_within(&line, &point, 4.0));
            assert!(if whole <= 4.0 { near == whole } else { near >= whole }, "{point} {whole} {near}");
            let (whole, near) = (inside_depth(&line, &point), inside_depth_within(&line, &point, 1.5));
            assert!(if whole.abs() <= 1.5 { near == whole } else { near.abs() >= whole.abs() && near * whole > 0.0 }, "{point}");
        }
    }

    #[test]
    fn depth_is_the_distance_to_the_border() {
        let square = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)].map(|(x, y)| Point2::new(x, y));
        assert_eq!(inside_depth(&square, &Point2::new(3.0, 5.0)), 3.0);
        assert_eq!(inside_depth(&square, &Point2::new(13.0, 5.0)), -3.0);
        assert!(inside(&square, &Point2::new(0.5, 0.5)) && !inside(&square, &Point2::new(10.5, 0.5)));
        assert!(!inside(&[], &Point2::new(0.5, 0.5)));
    }
}
