//! Pure functions on points.

mod similarity;
mod warp;

pub use similarity::{Similarity, SimilarityError};
pub use warp::SplineWarp;
