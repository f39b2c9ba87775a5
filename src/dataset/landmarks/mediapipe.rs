//! Converts `MediaPipe`'s 468 points, or 478 with those of the irises, to the 68 of iBUG, by `candide/mediapipe468.csv`.

use std::sync::LazyLock;

use nalgebra::Point2;

use super::LANDMARK_COUNT;

/// Points of the face mesh without and with the irises.
pub(super) const COUNTS: [usize; 2] = [468, 478];

/// Distance outside the picture that normalized points may have, as a share of its size.
const OUTSIDE: f64 = 0.5;

/// Mesh point of each landmark.
static POINTS: LazyLock<Vec<usize>> = LazyLock::new(|| {
    let mut points = vec![0; LANDMARK_COUNT];
    for line in include_str!("../../../candide/mediapipe468.csv").lines().skip(1) {
        let numbers = line.split_once(',').and_then(|(l, p)| Some((l.parse::<usize>().ok()?, p.parse().ok()?)));
        if let Some((landmark, point)) = numbers
            && let Some(place) = points.get_mut(landmark)
        {
            *place = point;
        }
    }
    points
});

/// Selects the 68 landmarks from the points of the mesh.
pub(super) fn landmarks(points: &[Point2<f64>]) -> Vec<Point2<f64>> {
    POINTS.iter().filter_map(|&k| points.get(k).copied()).collect()
}

/// Whether points are shares of the picture's width and height, as in `MediaPipe`'s output: all near 0 to 1, and not all equal, like the
/// zeros of a face that was not found.
pub(in super::super) fn is_normalized(points: &[Point2<f64>]) -> bool {
    let near = |value: f64| (-OUTSIDE..=1.0 + OUTSIDE).contains(&value);
    points.iter().all(|p| near(p.x) && near(p.y)) && points.iter().any(|p| Some(p) != points.first())
}

/// Converts normalized points to pixels. 0 is the left or upper edge of the first pixel, whose centre has the pixel position (0, 0).
pub(super) fn in_pixels(points: &mut [Point2<f64>], width: f64, height: f64) {
    for p in points {
        *p = Point2::new(p.x * width - 0.5, p.y * height - 0.5);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_every_landmark_once() {
        let mut points = POINTS.clone();
        assert_eq!(points.len(), LANDMARK_COUNT);
        assert!(points.iter().all(|&p| p < COUNTS[0]));
        points.sort_unstable();
        points.dedup();
        assert_eq!(points.len(), LANDMARK_COUNT);
        // Outer corners of the eyes, corners of the mouth, chin: the best-known mesh points.
        assert_eq!([36, 45, 48, 54, 8].map(|k| POINTS[k]), [33, 263, 61, 291, 152]);
    }

    #[test]
    fn normalized_points_are_known_and_brought_to_pixels() {
        let mut points = vec![Point2::new(0.0, 1.0), Point2::new(0.5, 0.5)];
        assert!(is_normalized(&points) && !is_normalized(&[Point2::new(0.5, 20.0)]));
        in_pixels(&mut points, 640.0, 480.0);
        assert_eq!(points, [Point2::new(-0.5, 479.5), Point2::new(319.5, 239.5)]);
    }
}
