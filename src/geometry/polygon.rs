//! Polygons and polylines in the plane.

use nalgebra::Point2;

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
    let [first, rest @ ..] = line else { return f64::INFINITY };
    nearest(first, rest, point, reach).sqrt()
}

/// Smallest squared distance of a point from the segments between consecutive points, skipping those beyond `reach`.
fn nearest(first: &Point2<f64>, rest: &[Point2<f64>], point: &Point2<f64>, reach: f64) -> f64 {
    let mut least = f64::INFINITY;
    let mut previous = first;
    for corner in rest {
        if may_be_within(previous, corner, point, reach) {
            least = least.min(squared_distance(previous, corner, point));
        }
        previous = corner;
    }
    least
}

/// Returns whether a point can be within `reach` of a segment: it lies in the segment's bounding box, enlarged by `reach`.
fn may_be_within(a: &Point2<f64>, b: &Point2<f64>, point: &Point2<f64>, reach: f64) -> bool {
    // Enlarged slightly to allow for rounding.
    let reach = 1.001 * reach;
    a.x.min(b.x) - reach <= point.x
        && point.x <= a.x.max(b.x) + reach
        && a.y.min(b.y) - reach <= point.y
        && point.y <= a.y.max(b.y) + reach
}

/// Distance of a point from a segment.
pub fn distance_to_segment(a: &Point2<f64>, b: &Point2<f64>, point: &Point2<f64>) -> f64 {
    squared_distance(a, b, point).sqrt()
}

/// In coordinates rather than vectors: pictures ask this for every pixel, and unoptimized vectors take ten times as long.
fn squared_distance(a: &Point2<f64>, b: &Point2<f64>, point: &Point2<f64>) -> f64 {
    let (edge_x, edge_y) = (b.x - a.x, b.y - a.y);
    let (x, y) = (point.x - a.x, point.y - a.y);
    let along = ((x * edge_x + y * edge_y) / (edge_x * edge_x + edge_y * edge_y).max(1e-12)).clamp(0.0, 1.0);
    let (x, y) = (x - edge_x * along, y - edge_y * along);
    x * x + y * y
}

/// Distance of a point from a closed polygon's border, positive inside, negative outside.
pub fn inside_depth(polygon: &[Point2<f64>], point: &Point2<f64>) -> f64 {
    inside_depth_within(polygon, point, f64::INFINITY)
}

/// [`inside_depth`] if its magnitude is at most `reach`; otherwise a value of the same sign and at least that magnitude.
pub fn inside_depth_within(polygon: &[Point2<f64>], point: &Point2<f64>, reach: f64) -> f64 {
    let Some(last) = polygon.last() else { return f64::NEG_INFINITY };
    let depth = nearest(last, polygon, point, reach).sqrt();
    if inside(polygon, point) { depth } else { -depth }
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
