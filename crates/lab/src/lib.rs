//! What it takes to measure `grimace`: faces with exact ground truth ([`simulate`]) and experiments against ground truth
//! ([`evaluate`]). Whoever uses the method needs none of it.
#![deny(unsafe_code)]
#![warn(missing_docs, clippy::pedantic)]
// Tests compare exact values on purpose.
#![cfg_attr(test, allow(clippy::unreadable_literal, clippy::items_after_statements, clippy::format_collect))]
#![allow(
    clippy::module_name_repetitions,
    clippy::many_single_char_names,
    clippy::float_cmp,
    clippy::needless_for_each,
    clippy::neg_cmp_op_on_partial_ord,
    clippy::similar_names,
    clippy::must_use_candidate,
    clippy::return_self_not_must_use,
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss
)]

pub mod evaluate;
pub mod simulate;
