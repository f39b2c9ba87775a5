//! Accuracy of the method on simulated people, and on real ones when the shared data is next to the repository.
#![allow(missing_docs, clippy::pedantic)]

#[path = "../../../../tests/common/mod.rs"]
mod common;

mod prior_accuracy;
mod real_bank;
mod synthetic;
