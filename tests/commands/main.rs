//! The commands end to end.
#![allow(missing_docs, clippy::pedantic)]

#[path = "../annotation/mod.rs"]
mod annotation;
#[path = "../common/mod.rs"]
mod common;

mod cmd_analyze;
mod cmd_annotate;
mod cmd_annotate_found;
mod cmd_annotate_server;
mod cmd_annotate_tracks;
mod cmd_apart;
mod cmd_bank;
mod cmd_beside;
mod cmd_check;
mod cmd_clone;
mod cmd_clone_faps;
mod cmd_clone_input;
mod cmd_consent;
mod cmd_fap;
mod cmd_features;
mod cmd_figures;
mod cmd_fit;
mod cmd_lab;
mod cmd_landmarks;
mod cmd_locate;
mod cmd_looked;
mod cmd_opencv;
mod cmd_package;
mod cmd_play;
mod cmd_populations;
mod cmd_prior;
mod cmd_recognize;
mod cmd_run;
mod cmd_run_again;
mod cmd_run_input;
mod cmd_segment;
mod cmd_skin;
mod cmd_synthesize;
mod cmd_synthesize_faps;
mod cmd_track;
mod cmd_video;
mod real_data;
mod workflow;
