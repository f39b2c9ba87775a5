//! Synthetic sequences with exact ground truth: textured and lit Candide-3 faces that go from neutral to a full expression.
//!
//! Identity is a sum of Candide-3's shape units, expression a sum of its action units ([`grimace::internal::wireframe::expressions`]); both
//! depend on the seed. A face is a painted plane, drawn by an inverse warp that is exact at every node: the pixel at a node's true position
//! shows the texture of that node. Eyeballs and the inside of the mouth are drawn through the openings between lids and lips; eyeballs do
//! not deform. Hair, ears, neck and clothes continue the same surface, so the face has no visible border.
//!
//! Photographs of neutral faces can be animated with the same expressions or with FAP curves ([`simulate_photographs`]).
//!
//! Pictures depend only on the options, which include the seed, and not on the order of the work or the number of threads.
//!
//! ```
//! use grimace_lab::simulate::{Emotion, SimulateOptions, simulate_sequence};
//!
//! let options = SimulateOptions { width: 160, height: 120, frames: 3, ..SimulateOptions::default() };
//! let frames: Vec<_> = simulate_sequence(&options, 0, Emotion::Surprise)?.collect();
//! assert_eq!(frames.len(), 3);
//! // The chin (node 10) drops: y grows downwards in the image.
//! assert!(frames[2].nodes[10].y > frames[0].nodes[10].y);
//! # Ok::<(), grimace_lab::simulate::SimulateError>(())
//! ```

mod blink;
mod camera;
mod dataset;
mod expression;
mod eye;
mod files;
mod mesh;
mod motion;
mod mouth;
mod neutral;
mod noise;
mod options;
mod photograph;
mod portrait;
mod random;
mod recording;
mod render;
mod sequence;
mod subject;
mod texture;
mod units;

pub use camera::CameraOptions;
pub use dataset::{DatasetSummary, simulate_dataset};
pub use expression::faps_without_unit;
pub(crate) use files::landmark_points;
pub use grimace::internal::wireframe::Emotion;
pub use motion::{Course, HeadPose};
pub use neutral::{UnitScope, neutral_nodes, performed_nodes};
pub use options::{DatasetLayout, FrameFormat, SimulateError, SimulateOptions, TurnCourse};
pub use photograph::{AnimatedPortrait, MAX_FAP_MOTIONS, PortraitMotion, simulate_photographs};
pub use portrait::{Portrait, PortraitError, PortraitMarks, PortraitSource, portrait_fitter};
pub use recording::{SimulatedRecording, TrueExpression, simulate_recordings};
pub use sequence::{SimulatedFrame, SimulatedFrames, SimulatedSequence, render_frame, simulate_sequence};
pub use subject::{Appearance, Cohort, Colour, Sex, Subject};
pub use units::show_units;
