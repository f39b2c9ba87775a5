//! Pure functions on points.

pub mod polygon;
mod similarity;
mod warp;

pub use similarity::{Similarity, SimilarityError};
pub use warp::SplineWarp;
