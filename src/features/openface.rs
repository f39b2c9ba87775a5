//! Columns in the format of `OpenFace`'s files.

use nalgebra::{Matrix3, Rotation3};

use super::{FrameFeatures, in_time};
use crate::{output::nine_digits, pose::HeadPose, sequence::Clock};

/// Action units in the files.
pub(super) const UNITS: [u8; 17] = [1, 2, 4, 5, 6, 7, 9, 10, 12, 14, 15, 17, 20, 23, 25, 26, 45];

/// Units of the columns, for the JSON beside the table.
pub(super) const ABOUT: [(&str, &str); 6] = [
    ("timestamp", "s from the first row; 0 where the frame rate is not known"),
    ("confidence, success", "share of the nodes that were seen; 1 or 0"),
    (
        "pose_Rx, pose_Ry, pose_Rz",
        "radians about the camera's axes (x right, y down, z away), R = Rx Ry Rz; positive: down, to the right of the subject, \
         towards the left shoulder",
    ),
    ("x_0 ... y_67", "landmarks in px, as the nodes show them; empty where no node stands for one"),
    ("AU.._r", "intensity 0 to 5"),
    ("AU.._c", "presence 0 or 1"),
];

/// Converts yaw, pitch and roll in degrees to pitch, yaw and roll about the axes of `OpenFace`'s camera, radians.
fn angles([yaw, pitch, roll]: [f64; 3]) -> [f64; 3] {
    // From x right, y up, z towards the camera to x right, y down, z away from it.
    let flip = Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, -1.0, -1.0));
    let turn: Rotation3<f64> = HeadPose::rotation_of(yaw, pitch, roll);
    let m = flip * turn.matrix() * flip;
    // R = Rx Ry Rz has sin(y) in its upper right corner, -sin(x) cos(y) and cos(x) cos(y) below, -cos(y) sin(z) and cos(y) cos(z)
    // beside it.
    [(-m[(1, 2)]).atan2(m[(2, 2)]), m[(0, 2)].clamp(-1.0, 1.0).asin(), (-m[(0, 1)]).atan2(m[(0, 0)])]
}

/// Returns header and rows.
pub(super) fn table(features: &[FrameFeatures], clock: &Clock) -> (Vec<String>, Vec<Vec<String>>) {
    let mut header: Vec<String> =
        ["frame", "face_id", "timestamp", "confidence", "success", "pose_Rx", "pose_Ry", "pose_Rz"].map(str::to_owned).into();
    let landmarks = features.first().map_or(0, |f| f.landmarks.len());
    header.extend((0..landmarks).map(|k| format!("x_{k}")));
    header.extend((0..landmarks).map(|k| format!("y_{k}")));
    // The selected action units: they are the same in all frames.
    let is_there = |n: &u8| features.first().is_none_or(|f| f.action_units.iter().any(|unit| unit.number == *n));
    let units: Vec<u8> = UNITS.into_iter().filter(is_there).collect();
    header.extend(units.iter().map(|n| format!("AU{n:02}_r")));
    header.extend(units.iter().map(|n| format!("AU{n:02}_c")));
    let features = in_time(features);
    let first = features.first().map_or(0, |f| f.frame);
    let number = |value: f64| nine_digits((value * 1e4).round() / 1e4);
    let rows = features.iter().map(|f| {
        let seconds = clock.seconds(f.frame.saturating_sub(first)).unwrap_or(0.0);
        let mut row = vec![f.frame.to_string(), "0".to_owned(), number(seconds), number(f.confidence)];
        row.push(u8::from(f.reason.is_none()).to_string());
        row.extend(angles(f.pose).map(number));
        row.extend(f.landmarks.iter().map(|p| p.map(|p| number(p.x)).unwrap_or_default()));
        row.extend(f.landmarks.iter().map(|p| p.map(|p| number(p.y)).unwrap_or_default()));
        let unit = |n: u8| f.action_units.iter().find(|unit| unit.number == n);
        row.extend(units.iter().map(|&n| unit(n).map(|u| number(u.value)).unwrap_or_default()));
        row.extend(units.iter().map(|&n| unit(n).map(|u| u8::from(u.is_present()).to_string()).unwrap_or_default()));
        row
    });
    (header, rows.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_about_one_axis_are_the_same_angle_with_the_other_sign() {
        let ten = 10_f64.to_radians();
        let near = |found: [f64; 3], expected: [f64; 3]| found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12);
        // To the subject's left is to the right in the image: negative in this format.
        assert!(near(angles([10.0, 0.0, 0.0]), [0.0, -ten, 0.0]));
        assert!(near(angles([0.0, 10.0, 0.0]), [ten, 0.0, 0.0]));
        // Counter-clockwise in the image is negative with y down.
        assert!(near(angles([0.0, 0.0, 10.0]), [0.0, 0.0, -ten]));
    }
}
