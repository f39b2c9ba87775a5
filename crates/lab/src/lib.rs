//! Tools to measure the accuracy of `grimace`: simulated faces with exact ground truth ([`simulate`]) and experiments that compare results
//! with ground truth ([`evaluate`]). Users of the method do not need this crate.
// The tests compare exact values on purpose.
#![cfg_attr(test, allow(clippy::unreadable_literal, clippy::items_after_statements, clippy::format_collect))]

pub mod evaluate;
pub mod simulate;
