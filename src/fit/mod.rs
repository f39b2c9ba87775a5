//! fit

mod correspondence;

pub use correspondence::{
    COLLINEAR_RATIO, Correspondence, CorrespondenceError, MINIMUM_MARKS, MarkKind, MarksError, read_correspondences,
    validate_correspondences, write_correspondences,
};
