//! The library from outside: golden files, properties across modules, the tracker without images, and the report as text.
#![allow(missing_docs, clippy::pedantic)]

#[path = "../common/mod.rs"]
mod common;
#[path = "../report_data/mod.rs"]
mod report_data;

mod examples;
mod golden;
mod klt;
mod layers;
mod marks_of_strangers;
mod properties;
mod report_html;
mod scripted_tracker;
mod stills;
mod warp_targets;
