//! The camera: projection from face space to the image and back.

use nalgebra::{Matrix2x3, Matrix2x6, Matrix3, Point2, Point3, Rotation3, Vector2, Vector3};

/// Prior mean of the camera's distance from the head, in eye distances: about 0.9 m.
pub const CAMERA_DISTANCE: f64 = 14.0;

/// Eye distance ES0 of the model, model units.
pub const HEAD_ES: f64 = 0.613;

/// Smallest distance of a point from the camera, as a share of the head's distance: no part of a head comes nearer.
const NEAREST: f64 = 0.3;

/// Position and rotation of a head.
///
/// ```
/// use grimace::pose::HeadPose;
/// use nalgebra::{Point2, Point3};
///
/// let rotation = HeadPose::rotation_of(20.0, 0.0, 0.0);
/// let pose = HeadPose { rotation, scale: 100.0, position: Point2::new(160.0, 120.0), distance: 8.0 };
/// assert!((pose.degrees()[0] - 20.0).abs() < 1e-9);
/// // The middle of the head is seen where the pose says.
/// assert!((pose.project(&Point3::origin()) - pose.position).norm() < 1e-9);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadPose {
    /// Rotation from face axes to camera axes.
    pub rotation: Rotation3<f64>,
    /// Image scale at the middle of the head, px per model unit.
    pub scale: f64,
    /// Image position of the middle of the head, px.
    pub position: Point2<f64>,
    /// Distance of the camera from the middle of the head, model units.
    pub distance: f64,
}

impl HeadPose {
    /// Returns yaw, pitch and roll, degrees.
    pub fn degrees(&self) -> [f64; 3] {
        // R = Rz Ry Rx: Tait-Bryan angles as in nalgebra (roll about x, pitch about y, yaw about z).
        let (about_x, about_y, about_z) = self.rotation.euler_angles();
        [about_y.to_degrees(), about_x.to_degrees(), about_z.to_degrees()]
    }

    /// Returns the rotation of yaw, pitch and roll in degrees.
    pub fn rotation_of(yaw: f64, pitch: f64, roll: f64) -> Rotation3<f64> {
        Rotation3::from_euler_angles(pitch.to_radians(), yaw.to_radians(), roll.to_radians())
    }

    /// Returns a point in camera axes, model units from the middle of the head.
    pub(super) fn turned(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point
    }

    /// Returns the magnification at a depth.
    fn magnification(&self, depth: f64) -> f64 {
        self.distance / (self.distance - depth).max(NEAREST * self.distance)
    }

    /// Returns the image position of a point in camera axes, px.
    pub(super) fn image_of(&self, turned: &Vector3<f64>) -> Point2<f64> {
        let m = self.scale * self.magnification(turned.z);
        self.position + Vector2::new(turned.x * m, -turned.y * m)
    }

    /// Returns the image position of a point (model units from the middle of the head, face axes), px.
    pub fn project(&self, point: &Point3<f64>) -> Point2<f64> {
        self.image_of(&self.turned(&point.coords))
    }

    /// Returns the point at an image position and a depth in camera axes; face axes, from the middle of the head.
    pub(super) fn back(&self, seen: &Point2<f64>, depth: f64) -> Point3<f64> {
        let m = self.scale * self.magnification(depth);
        let from = (seen - self.position) / m;
        Point3::from(self.rotation.inverse() * Vector3::new(from.x, -from.y, depth))
    }

    /// Returns the derivative of the image position with respect to a point in camera axes.
    pub(super) fn slope(&self, turned: &Vector3<f64>) -> Matrix2x3<f64> {
        let w = self.magnification(turned.z);
        let (s, depth) = (self.scale * w, self.scale * w * w / self.distance);
        Matrix2x3::new(s, 0.0, turned.x * depth, 0.0, -s, -turned.y * depth)
    }

    /// Returns the derivative of the image position with respect to the logarithm of the camera's distance.
    pub(super) fn distance_slope(&self, turned: &Vector3<f64>) -> Vector2<f64> {
        let w = self.magnification(turned.z);
        Vector2::new(turned.x, -turned.y) * (-self.scale * w * w * turned.z / self.distance)
    }

    /// Returns the derivative of the image position with respect to the changes of [`HeadPose::moved`]; `turned`: a point in camera axes.
    pub(super) fn pose_slope(&self, turned: &Vector3<f64>) -> Matrix2x6<f64> {
        let mut slope = Matrix2x6::zeros();
        slope.fixed_columns_mut::<3>(0).copy_from(&(self.slope(turned) * Self::rotation_slope(turned)));
        slope.set_column(3, &(self.image_of(turned) - self.position));
        slope.fixed_columns_mut::<2>(4).fill_with_identity();
        slope
    }

    /// Returns the derivative of a point in camera axes with respect to a small rotation vector in camera axes.
    fn rotation_slope(turned: &Vector3<f64>) -> Matrix3<f64> {
        -turned.cross_matrix()
    }

    /// Returns the pose changed by a small rotation vector (camera axes, radians), a change of the logarithm of the size, and a shift in
    /// px.
    pub(super) fn moved(&self, turn: Vector3<f64>, log_scale: f64, shift: Vector2<f64>) -> Self {
        let mut rotation = Rotation3::new(turn) * self.rotation;
        rotation.renormalize();
        Self { rotation, scale: self.scale * log_scale.exp(), position: self.position + shift, ..*self }
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    fn pose(yaw: f64, pitch: f64, roll: f64) -> HeadPose {
        HeadPose {
            rotation: HeadPose::rotation_of(yaw, pitch, roll),
            scale: 100.0,
            position: Point2::new(320.0, 240.0),
            distance: CAMERA_DISTANCE * HEAD_ES,
        }
    }

    #[test]
    fn positive_angles_turn_left_look_down_and_tilt_right() {
        // The tip of the nose, one unit in front.
        let nose = Point3::new(0.0, 0.0, 1.0);
        assert!(pose(20.0, 0.0, 0.0).project(&nose).x > 320.0);
        assert!(pose(0.0, 20.0, 0.0).project(&nose).y > 240.0);
        // The top of the head goes to the left of the image: towards the subject's right shoulder.
        assert!(pose(0.0, 0.0, 20.0).project(&Point3::new(0.0, 1.0, 0.0)).x < 320.0);
        let [yaw, pitch, roll] = pose(12.0, -7.0, 3.0).degrees();
        assert_relative_eq!(yaw, 12.0, epsilon = 1e-9);
        assert_relative_eq!(pitch, -7.0, epsilon = 1e-9);
        assert_relative_eq!(roll, 3.0, epsilon = 1e-9);
    }

    #[test]
    fn near_points_are_magnified_and_places_go_back_to_their_points() {
        // At depth z the magnification is D / (D - z), D = 14 x 0.613 = 8.582.
        let seen = pose(0.0, 0.0, 0.0).project(&Point3::new(0.5, 0.0, 0.3));
        assert_relative_eq!(seen.x, 320.0 + 50.0 * 8.582 / (8.582 - 0.3), epsilon = 1e-9);
        let (p, x) = (pose(14.0, 9.0, -4.0), Point3::new(0.2, -0.6, 0.1));
        let depth = p.turned(&x.coords).z;
        assert_relative_eq!(p.back(&p.project(&x), depth), x, epsilon = 1e-12);
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let (p, x) = (pose(14.0, 9.0, -4.0), Point3::new(0.2, -0.6, 0.1));
        let turned = p.turned(&x.coords);
        let h = 1e-6;
        for k in 0..6 {
            let mut change = [0.0; 6];
            change[k] = h;
            let [a, b, c, size, right, down] = change;
            let moved = p.moved(Vector3::new(a, b, c), size, Vector2::new(right, down));
            let expected = p.pose_slope(&turned).column(k).into_owned();
            assert_relative_eq!((moved.project(&x) - p.project(&x)) / h, expected, epsilon = 1e-3);
        }
        let farther = HeadPose { distance: p.distance * h.exp(), ..p };
        assert_relative_eq!((farther.project(&x) - p.project(&x)) / h, p.distance_slope(&turned), epsilon = 1e-3);
    }
}
