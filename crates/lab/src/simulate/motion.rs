//! Head motion over a sequence, and the projection of face space into the image.

use nalgebra::{Matrix2, Point2, Point3, Rotation3, Vector2};
use rand::RngExt;

use super::{
    Emotion, SimulateOptions, TurnCourse,
    random::{Purpose, generator},
};
use grimace::internal::geometry::Similarity;

/// Size of one model unit as a share of the image height.
const PX_PER_UNIT: f64 = 0.335;
/// Size of one model unit as a share of the image width; it limits the size of the face in narrow pictures.
const PX_PER_UNIT_OF_WIDTH: f64 = 0.45;
/// Point of face space at the middle of the image, about which the head rotates (model units).
const IMAGE_MIDDLE: Point3<f64> = Point3::new(0.0, -0.03, -0.25);

/// An orthographic view of face space: `image = origin + scale * (x, -y)` of the rotated head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadPose {
    turn: Rotation3<f64>,
    scale: f64,
    origin: Point2<f64>,
}

impl HeadPose {
    /// Makes a view from roll, yaw and pitch (radians), shift (pixels) and change of scale, about the `middle` of the picture.
    pub(super) fn new([roll, yaw, pitch, dx, dy, scale]: [f64; 6], middle: Point2<f64>, px_per_unit: f64) -> Self {
        let turn = Rotation3::from_axis_angle(&nalgebra::Vector3::z_axis(), roll)
            * Rotation3::from_axis_angle(&nalgebra::Vector3::y_axis(), yaw)
            * Rotation3::from_axis_angle(&nalgebra::Vector3::x_axis(), pitch);
        Self { turn, scale: px_per_unit * scale, origin: middle + Vector2::new(dx, dy) }
    }

    /// Returns the image position (pixels) of a point of face space (model units).
    pub fn project(&self, point: &Point3<f64>) -> Point2<f64> {
        let turned = self.turn * (point - IMAGE_MIDDLE);
        self.origin + Vector2::new(turned.x, -turned.y) * self.scale
    }

    /// Returns the linear part of the view: the map from the plane to pixels, for points of equal depth.
    pub fn image_from_plane(&self) -> Matrix2<f64> {
        let m = self.turn.matrix();
        Matrix2::new(m[(0, 0)], m[(0, 1)], -m[(1, 0)], -m[(1, 1)]) * self.scale
    }

    /// Returns the view shifted in the picture by a vector in pixels.
    #[cfg(test)]
    pub fn shifted(&self, by: Vector2<f64>) -> Self {
        Self { origin: self.origin + by, ..*self }
    }

    /// Returns the view without rotation, for the body.
    pub fn without_turn(&self) -> Self {
        Self { turn: Rotation3::identity(), ..*self }
    }

    /// Returns the part of the view that moves whole pictures: roll about the line of sight, scale and shift. It maps points with flipped y
    /// from the frontal view; see [`Course::from_rest`].
    pub fn flat(&self) -> Similarity {
        let m = self.turn.matrix();
        // The image's y axis points down, so a rotation of the face to the left is one of the picture to the right.
        let angle = -(m[(1, 0)] - m[(0, 1)]).atan2(m[(0, 0)] + m[(1, 1)]);
        let turn = Similarity { scale: self.scale, angle, translation: Vector2::zeros() };
        let middle = Point2::new(IMAGE_MIDDLE.x, -IMAGE_MIDDLE.y);
        Similarity { translation: self.origin - turn.apply(&middle), ..turn }
    }

    /// Returns the rotation of the head.
    pub fn turn(&self) -> Rotation3<f64> {
        self.turn
    }
}

/// Returns the pixels per model unit, before any change of scale.
pub fn px_per_unit(options: &SimulateOptions) -> f64 {
    (PX_PER_UNIT * f64::from(options.height)).min(PX_PER_UNIT_OF_WIDTH * f64::from(options.width))
}

/// The course of a sequence: head pose and share of the expression in every frame.
#[derive(Clone, Copy, Debug)]
pub struct Course {
    /// Roll, yaw and pitch in radians, shift in pixels, and scale, in the first and the last frame.
    ends: [[f64; 6]; 2],
    /// Exponent of time: below 1 the onset is early, above 1 late.
    onset: f64,
    middle: Point2<f64>,
    px_per_unit: f64,
    frames: usize,
}

impl Course {
    /// Makes the seeded course of a subject's sequence.
    pub fn new(options: &SimulateOptions, subject: u32, emotion: Emotion) -> Self {
        Self::seeded(options, subject, emotion.code())
    }

    fn seeded(options: &SimulateOptions, subject: u32, code: u8) -> Self {
        let mut random = generator(options.seed, Purpose::Motion, subject, code, 0);
        let mut within = |limit: f64| limit * random.random_range(-1.0..=1.0);
        let [roll, yaw, pitch] = [options.roll_degrees, options.yaw_degrees, options.pitch_degrees].map(f64::to_radians);
        let mut end = |scale: f64| {
            [within(roll), within(yaw), within(pitch), within(options.shift_px), within(options.shift_px), 1.0 + within(scale)]
        };
        let mut ends = [end(options.scale_change), end(options.scale_change)];
        if options.turn != TurnCourse::Free {
            // The seeded angles at the end determine the side; their size is the limit.
            let sides = [yaw.copysign(ends[1][1]), pitch.copysign(ends[1][2])];
            let start = if options.turn == TurnCourse::During { [0.0, 0.0] } else { sides };
            ends[0][1..3].copy_from_slice(&start);
            ends[1][1..3].copy_from_slice(&sides);
        }
        let middle = Point2::new(f64::from(options.width - 1) / 2.0, f64::from(options.height - 1) / 2.0);
        let onset = random.random_range(0.85..=1.2);
        Self { ends, onset, middle, px_per_unit: px_per_unit(options), frames: options.frames }
    }

    /// Makes the course of a photograph: from the unchanged photograph to the pose at the end of [`Course::new`].
    ///
    /// Views map face space to its frontal view with flipped y, in model units; `px_per_unit` is the number of the photograph's pixels per
    /// unit.
    pub fn from_rest(options: &SimulateOptions, subject: u32, code: u8, px_per_unit: f64) -> Self {
        let course = Self::seeded(options, subject, code);
        let [roll, yaw, pitch, dx, dy, scale] = course.ends[1];
        let rest = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let ends = [rest, [roll, yaw, pitch, dx / px_per_unit, dy / px_per_unit, scale]];
        Self { ends, middle: Point2::new(IMAGE_MIDDLE.x, -IMAGE_MIDDLE.y), px_per_unit: 1.0, ..course }
    }

    /// Returns the share of the expression at a time in frames, from 0 in the first frame to 1 in the last, with zero speed at both ends.
    pub fn intensity(&self, frame: f64) -> f64 {
        smooth_step(self.time(frame).powf(self.onset))
    }

    /// Returns the pose at a time in frames.
    pub fn pose(&self, frame: f64) -> HeadPose {
        let t = smooth_step(self.time(frame));
        let pose = std::array::from_fn(|k| self.ends[0][k] + (self.ends[1][k] - self.ends[0][k]) * t);
        HeadPose::new(pose, self.middle, self.px_per_unit)
    }

    /// Returns the elapsed share of the sequence, limited to 0 to 1.
    fn time(&self, frame: f64) -> f64 {
        (frame / (self.frames - 1) as f64).clamp(0.0, 1.0)
    }
}

/// Returns the cubic step from (0, 0) to (1, 1) with zero slope at both ends.
pub fn smooth_step(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    #[test]
    fn a_still_frontal_head_projects_x_right_and_y_down() {
        let options = SimulateOptions { roll_degrees: 0.0, shift_px: 0.0, scale_change: 0.0, ..SimulateOptions::default() };
        let pose = Course::new(&options, 0, Emotion::Fear).pose(0.0);
        // 0.335 * 480 = 160.8 px per unit; (0, -0.03) maps to the middle of the picture, (319.5, 239.5).
        let p = pose.project(&Point3::new(1.0, 0.97, 0.7));
        assert_relative_eq!(p, Point2::new(319.5 + 160.8, 239.5 - 160.8), epsilon = 1e-9);
    }

    #[test]
    fn the_expression_grows_from_nothing_to_all_of_it() {
        let options = SimulateOptions::default();
        let course = Course::new(&options, 1, Emotion::Anger);
        let shares: Vec<f64> = (0..options.frames).map(|k| course.intensity(k as f64)).collect();
        assert_relative_eq!(shares[0], 0.0);
        assert_relative_eq!(shares[options.frames - 1], 1.0);
        assert!(shares.windows(2).all(|w| w[1] > w[0]));
    }

    #[test]
    fn motion_stays_within_its_limits() {
        let options = SimulateOptions { roll_degrees: 5.0, shift_px: 3.0, scale_change: 0.05, ..SimulateOptions::default() };
        for subject in 0..50 {
            let course = Course::new(&options, subject, Emotion::Anger);
            for frame in 0..options.frames {
                let pose = course.pose(frame as f64);
                let along = pose.image_from_plane() * Vector2::x();
                assert!(along.y.atan2(along.x).abs() <= 5.0_f64.to_radians() + 1e-12);
                assert!((along.norm() / px_per_unit(&options) - 1.0).abs() <= 0.05 + 1e-12);
                assert!((pose.origin - course.middle).amax() <= 3.0 + 1e-12);
            }
        }
    }
}
