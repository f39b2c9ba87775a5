//! Pose and action units of a sequence at equal time steps, small enough to keep for every sequence.

use super::{ACTION_UNITS, FrameFeatures};

/// Number of points of a course, including the first and the last frame.
pub const COURSE_POINTS: usize = 13;

/// Pose and action units from the neutral to the apex frame, at 13 times.
#[derive(Clone, Debug, PartialEq)]
pub struct Course {
    /// Yaw, pitch, roll, degrees.
    pub pose: Vec<[f32; 3]>,
    /// Action unit intensities, 0 to 5, in the order of [`ACTION_UNITS`].
    pub units: Vec<[f32; ACTION_UNITS.len()]>,
}

impl Course {
    /// Returns the course of a sequence, interpolated linearly between frames; `None` for less than two frames.
    pub fn of(features: &[FrameFeatures]) -> Option<Self> {
        let (Some(first), Some(last)) = (features.first(), features.last()) else { return None };
        if features.len() < 2 {
            return None;
        }
        let since = |row: &FrameFeatures| f64::from(row.frame.abs_diff(first.frame));
        let length = since(last).max(1.0);
        let (mut pose, mut units) = (Vec::new(), Vec::new());
        for point in 0..COURSE_POINTS {
            let time = length * point as f64 / (COURSE_POINTS - 1) as f64;
            let after = features.iter().position(|f| since(f) >= time).unwrap_or(features.len() - 1);
            let (a, b) = (&features[after.saturating_sub(1)], &features[after]);
            let span = since(b) - since(a);
            let share = if span > 0.0 { ((time - since(a)) / span).clamp(0.0, 1.0) } else { 0.0 };
            let between = |a: f64, b: f64| (a + (b - a) * share) as f32;
            pose.push(std::array::from_fn(|k| between(a.pose[k], b.pose[k])));
            let value = |f: &FrameFeatures, k: usize| f.action_units.get(k).map_or(0.0, |unit| unit.value);
            units.push(std::array::from_fn(|k| between(value(a, k), value(b, k))));
        }
        Some(Self { pose, units })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;

    use super::*;
    use crate::features::Intensity;

    fn row(frame: u32, yaw: f64, smile: f64) -> FrameFeatures {
        let unit = |unit: &crate::features::ActionUnit| Intensity {
            number: unit.number,
            value: if unit.number == 12 { smile } else { 0.0 },
            sides: None,
            expected_error: 0.1,
            evidence: 0.0,
        };
        FrameFeatures {
            frame,
            confidence: 1.0,
            reason: None,
            pose: [yaw, 0.0, 0.0],
            position: Point2::origin(),
            landmarks: Vec::new(),
            eye_distance: 100.0,
            faps: Vec::new(),
            action_units: ACTION_UNITS.iter().map(unit).collect(),
            eye_opening: [1.0; 2],
            mouth_opening: 0.0,
            iris: None,
        }
    }

    #[test]
    fn a_course_is_linear_between_frames() {
        // Frames 1, 4 and 7 are at 0, one half and the end of the time; each half has six points.
        let course = Course::of(&[row(1, 0.0, 0.0), row(4, 6.0, 3.0), row(7, 6.0, 4.0)]).unwrap();
        assert_eq!(course.pose.len(), COURSE_POINTS);
        assert_eq!((course.pose[0][0], course.pose[3][0], course.pose[6][0], course.pose[12][0]), (0.0, 3.0, 6.0, 6.0));
        let smile = ACTION_UNITS.iter().position(|unit| unit.number == 12).unwrap();
        assert_eq!((course.units[6][smile], course.units[9][smile], course.units[12][smile]), (3.0, 3.5, 4.0));
        assert!(Course::of(&[row(1, 0.0, 0.0)]).is_none());
    }
}
