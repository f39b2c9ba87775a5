//! Synthetic sequences with exact ground truth: textured, lit Candide-3 faces that go from neutral to a full expression.
//!
//! Identity is a sum of Candide's shape units, expression a sum of its action units ([`EXPRESSIONS`]), both seeded. A face is
//! drawn as a painted plane under an inverse warp that is exact at every node: the pixel at a node's true position shows the
//! texture of that node. Eyeballs and the inside of the mouth are drawn through the openings between lids and lips; eyeballs do
//! not deform. Hair, ears, neck and clothes continue the same surface, so the face has no border.
//!
//! Everything follows from the seed: the same options give the same pictures, whatever the order or the number of threads.
//!
//! ```
//! use grimace::simulate::{Emotion, SimulateOptions, simulate_sequence};
//!
//! let options = SimulateOptions { width: 160, height: 120, frames: 3, ..SimulateOptions::default() };
//! let frames: Vec<_> = simulate_sequence(&options, 0, Emotion::Surprise)?.collect();
//! assert_eq!(frames.len(), 3);
//! // The chin (node 10) drops: y grows downwards in the image.
//! assert!(frames[2].nodes[10].y > frames[0].nodes[10].y);
//! # Ok::<(), grimace::simulate::SimulateError>(())
//! ```

mod dataset;
mod expression;
mod eye;
mod mesh;
mod motion;
mod mouth;
mod neutral;
mod noise;
mod options;
mod random;
mod render;
mod sequence;
mod subject;
mod texture;

pub use dataset::{DatasetSummary, MARKED_NODES, simulate_dataset};
pub use expression::{EXPRESSIONS, Emotion, ExpressionRow, ExpressionUnit, ParseEmotionError};
pub(crate) use expression::{find_unit, settle_offsets};
pub use motion::{Course, HeadPose};
pub use neutral::neutral_nodes;
pub use options::{FrameFormat, SimulateError, SimulateOptions};
pub use sequence::{SimulatedFrame, SimulatedFrames, SimulatedSequence, render_frame, simulate_sequence};
pub use subject::{Appearance, Cohort, Colour, Sex, Subject};
