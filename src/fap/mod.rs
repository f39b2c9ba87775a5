//! fap
