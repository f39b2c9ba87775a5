//! `grimace simulate` and `grimace evaluate` end to end.
#![allow(missing_docs, clippy::pedantic)]

#[path = "../../../../tests/common/mod.rs"]
mod common;

mod cmd_evaluate;
mod cmd_simulate;
mod cmd_simulate_photo;
