//! Pure functions on points.

mod similarity;

pub use similarity::{Similarity, SimilarityError};
