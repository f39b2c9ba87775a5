//! How near the method comes to the truth: simulated people, and real ones where the shared data lies beside the repository.
#![allow(missing_docs, clippy::pedantic)]

#[path = "../../../../tests/common/mod.rs"]
mod common;

mod prior_accuracy;
mod real_bank;
mod synthetic;
