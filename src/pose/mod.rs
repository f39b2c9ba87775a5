//! The head in three dimensions: its pose in every frame of a track, and the track without it.
//!
//! Candide-3 is a three-dimensional model, and a head that turns by ten degrees while it smiles moves its nodes further than the smile
//! does. A [`HeadModel`] says what neutral heads look like, with depth, and how expressions move their nodes; [`fit_head`] finds the
//! person's neutral head and, in every frame, its pose and expression, all together; [`frontalized`] carries every tracked node back to
//! where it would be seen on the same head looking into the camera.
//!
//! # Camera
//! Perspective, the camera [`CAMERA_DISTANCE`] eye distances away, its optical axis through the middle of the head (the mean of the 68
//! landmarks): angles are those against the line of sight to the head. Sizes are those at that middle.
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
mod learn;
mod mixture;
mod observe;
mod person;
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
pub(crate) use turns::without_turns;
