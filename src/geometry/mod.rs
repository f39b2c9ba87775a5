//! Pure functions on points and grids.

pub mod blur;
pub mod polygon;
mod similarity;
mod warp;

pub use similarity::{Similarity, SimilarityError};
pub use warp::SplineWarp;
