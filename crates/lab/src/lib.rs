//! What it takes to measure `grimace`: faces with exact ground truth ([`simulate`]) and experiments against ground truth
//! ([`evaluate`]). Whoever uses the method needs none of it.
// Tests compare exact values on purpose.
#![cfg_attr(test, allow(clippy::unreadable_literal, clippy::items_after_statements, clippy::format_collect))]

pub mod evaluate;
pub mod simulate;
