//! Columns in the format of `OpenFace`'s files.

use nalgebra::{Matrix3, Point2, Rotation3};

use super::{FrameFeatures, TRUSTED_TURN, in_time, measured, unit_column};
use crate::{dataset::LANDMARK_COUNT, pose::HeadPose, sequence::Clock};

/// Action units in the files.
pub(super) const UNITS: [u8; 17] = [1, 2, 4, 5, 6, 7, 9, 10, 12, 14, 15, 17, 20, 23, 25, 26, 45];

/// Units of the columns, for the JSON beside the table.
pub(crate) const ABOUT: [(&str, &str); 6] = [
    ("timestamp", "s from the first row; 0 where the frame rate is not known"),
    (
        "confidence, success",
        "0.8 to 1 for rows that can be used, 0.75 to 0.79 where the head is turned by more than 25 degrees, 0 to 0.7 where success is 0; within \
         these ranges the share of the nodes that were seen",
    ),
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

/// A row of such a file.
#[derive(Clone, Debug)]
pub(crate) struct OpenFaceRow {
    /// Frame number.
    pub frame: u32,
    /// Seconds from the first row, if known.
    pub seconds: Option<f64>,
    /// The face; `None` where none was found.
    pub face: Option<OpenFaceFace>,
}

/// What a row says of a face.
#[derive(Clone, Debug)]
pub(crate) struct OpenFaceFace {
    /// Share of the nodes that were seen, 0 to 1.
    pub confidence: f64,
    /// Whether the row may be used.
    pub success: bool,
    /// Yaw, pitch, roll, degrees.
    pub pose: [f64; 3],
    /// The landmarks, px.
    pub landmarks: Vec<Option<Point2<f64>>>,
    /// Number, intensity and presence of the action units.
    pub units: Vec<(u8, f64, bool)>,
}

impl OpenFaceFace {
    /// Confidence as readers of `OpenFace`'s files understand it: they leave out rows below 0.75 or 0.8. The share of the nodes that were seen
    /// is lower than that in many good rows, for example where two pictures show a neutral and a smiling face.
    fn certainty(&self) -> f64 {
        let [yaw, pitch, _] = self.pose;
        let (least, range) = if !self.success {
            (0.0, 0.7)
        } else if yaw.abs().max(pitch.abs()) > TRUSTED_TURN {
            (0.75, 0.04)
        } else {
            (0.8, 0.2)
        };
        least + range * self.confidence
    }
}

/// Returns header and records. `units` are the numbers of the action units; those that the format lacks are left out.
pub(crate) fn openface_csv(rows: impl Iterator<Item = OpenFaceRow>, units: &[u8]) -> (Vec<String>, Vec<Vec<String>>) {
    let mut header: Vec<String> =
        ["frame", "face_id", "timestamp", "confidence", "success", "pose_Rx", "pose_Ry", "pose_Rz"].map(str::to_owned).into();
    header.extend((0..LANDMARK_COUNT).map(|k| format!("x_{k}")));
    header.extend((0..LANDMARK_COUNT).map(|k| format!("y_{k}")));
    let units: Vec<u8> = UNITS.into_iter().filter(|n| units.contains(n)).collect();
    header.extend(units.iter().map(|&n| unit_column(n, "r")));
    header.extend(units.iter().map(|&n| unit_column(n, "c")));
    let rows = rows.map(|OpenFaceRow { frame, seconds, face }| {
        let mut row = vec![frame.to_string(), "0".to_owned(), measured(seconds.unwrap_or(0.0))];
        let Some(face) = face else {
            row.extend(["0", "0"].map(str::to_owned));
            row.resize(header.len(), String::new());
            return row;
        };
        row.push(measured(face.certainty()));
        row.push(u8::from(face.success).to_string());
        row.extend(angles(face.pose).map(measured));
        let at = |k: usize| face.landmarks.get(k).copied().flatten();
        row.extend((0..LANDMARK_COUNT).map(|k| at(k).map(|p| measured(p.x)).unwrap_or_default()));
        row.extend((0..LANDMARK_COUNT).map(|k| at(k).map(|p| measured(p.y)).unwrap_or_default()));
        let unit = |n: u8| face.units.iter().find(|unit| unit.0 == n);
        row.extend(units.iter().map(|&n| unit(n).map(|u| measured(u.1)).unwrap_or_default()));
        row.extend(units.iter().map(|&n| unit(n).map(|u| u8::from(u.2).to_string()).unwrap_or_default()));
        row
    });
    let rows = rows.collect();
    (header, rows)
}

/// Returns header and rows of the frames of a track.
pub(super) fn table(features: &[FrameFeatures], clock: &Clock) -> (Vec<String>, Vec<Vec<String>>) {
    // The selected action units: they are the same in all frames.
    let units = features.first().map_or(UNITS.to_vec(), |f| f.action_units.iter().map(|unit| unit.number).collect());
    let first = features.first().map_or(0, |f| f.frame);
    let row = |f: &FrameFeatures| OpenFaceRow {
        frame: f.frame,
        seconds: clock.seconds(f.frame.saturating_sub(first)),
        face: Some(OpenFaceFace {
            confidence: f.confidence,
            success: f.reason.is_none(),
            pose: f.pose,
            landmarks: f.landmarks.clone(),
            units: f.action_units.iter().map(|unit| (unit.number, unit.value, unit.is_present())).collect(),
        }),
    };
    openface_csv(in_time(features).into_iter().map(row), &units)
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

    #[test]
    fn the_usual_limits_of_confidence_leave_out_what_is_not_to_be_used() {
        let face = |confidence, success, yaw| OpenFaceFace {
            confidence,
            success,
            pose: [yaw, 0.0, 40.0],
            landmarks: Vec::new(),
            units: Vec::new(),
        };
        assert_eq!([0.5, 1.0].map(|seen| face(seen, true, 25.0).certainty()), [0.9, 1.0]);
        assert_eq!([0.5, 1.0].map(|seen| face(seen, true, -26.0).certainty()), [0.77, 0.79]);
        assert_eq!([0.5, 1.0].map(|seen| face(seen, false, 0.0).certainty()), [0.35, 0.7]);
    }
}
