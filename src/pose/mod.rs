//! Head pose: the head in three dimensions in every frame of a track, and the track without its motion.
//!
//! Candide-3 is a three-dimensional model. A head that turns by ten degrees during a smile moves its nodes further than the smile does. A
//! [`HeadModel`] describes neutral heads, with depth, and how expressions move their nodes. [`fit_head`] finds the person's neutral head
//! together with pose and expression in every frame. [`frontalized`] carries every tracked node back to its position on the same head
//! looking into the camera.
//!
//! # Camera
//! Perspective, with the camera [`CAMERA_DISTANCE`] eye distances away and its optical axis through the middle of the head (the mean of the
//! 68 landmarks). Angles are relative to the line of sight to the head; sizes are those at that middle.
//!
//! # Angles
//! Degrees. `R = Rz(roll) Ry(yaw) Rx(pitch)` takes face space (x to the subject's left, y up, z out of the face) to the axes of the
//! camera (x right in the image, y up, z towards the camera). Positive yaw turns to the subject's left (right in the image),
//! positive pitch looks down, positive roll tilts the head towards the subject's right shoulder (counter-clockwise in the image).

mod camera;
mod file;
mod fit;
mod fitter;
mod frontal;
mod head;
mod joint;
mod learn;
mod observe;
mod solve;
mod turned;
mod turns;

pub use camera::{CAMERA_DISTANCE, HEAD_ES, HeadPose};
pub use file::{HeadOrigin, write_head};
pub use fit::{HeadFit, PoseError, fit_head, follow_head};
pub use fitter::HeadFitter;
pub use frontal::frontalized;
pub use head::{HeadModel, NamedOffsets};
pub use learn::{DenseFaces, IDENTITY_MODES, learn_head};
pub use turned::{fit_turned, turned_share};
pub(crate) use turns::{turns, without_turns};
