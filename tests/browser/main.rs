//! The pages of `annotate` and `play`, and the report, in a real browser.
#![allow(missing_docs, clippy::pedantic)]

#[path = "../annotation/mod.rs"]
mod annotation;
#[path = "../common/mod.rs"]
mod common;
#[path = "../report_data/mod.rs"]
mod report_data;

mod annotate_page;
mod annotate_tracks_page;
mod driver;
mod player_page;
mod report_page;
