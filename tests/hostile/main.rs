//! Robustness: hostile files given to commands and readers, and runs that are disturbed.
#![allow(missing_docs, clippy::pedantic)]

#[cfg(unix)]
mod faults;
mod files;
mod fuzz;
mod inputs;
