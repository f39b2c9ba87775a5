//! Polygons and lines of segments in the plane.

use nalgebra::Point2;

/// Whether a point lies inside a closed polygon (even-odd).
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

/// Distance of a point to a line of segments.
pub fn distance_to_line(line: &[Point2<f64>], point: &Point2<f64>) -> f64 {
    line.windows(2).map(|w| distance_to_segment(&w[0], &w[1], point)).fold(f64::INFINITY, f64::min)
}

/// Distance of a point to a segment.
pub fn distance_to_segment(a: &Point2<f64>, b: &Point2<f64>, point: &Point2<f64>) -> f64 {
    squared_distance(a, b, point).sqrt()
}

fn squared_distance(a: &Point2<f64>, b: &Point2<f64>, point: &Point2<f64>) -> f64 {
    let (edge, to) = (b - a, point - a);
    let along = (to.dot(&edge) / edge.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    (to - edge * along).norm_squared()
}

/// Distance of a point from a closed polygon's border, positive inside.
pub fn inside_depth(polygon: &[Point2<f64>], point: &Point2<f64>) -> f64 {
    let ends = polygon.iter().zip(polygon.iter().cycle().skip(1));
    let nearest = ends.map(|(a, b)| squared_distance(a, b, point)).fold(f64::INFINITY, f64::min).sqrt();
    if inside(polygon, point) { nearest } else { -nearest }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_the_distance_to_the_border() {
        let square = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)].map(|(x, y)| Point2::new(x, y));
        assert_eq!(inside_depth(&square, &Point2::new(3.0, 5.0)), 3.0);
        assert_eq!(inside_depth(&square, &Point2::new(13.0, 5.0)), -3.0);
        assert!(inside(&square, &Point2::new(0.5, 0.5)) && !inside(&square, &Point2::new(10.5, 0.5)));
        assert!(!inside(&[], &Point2::new(0.5, 0.5)));
    }
}
