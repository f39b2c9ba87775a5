//! Representative facial expressions from image sequences.
//!
//! Data flow, one owned type per step, the unit part of the model's type:
//!
//! ```text
//! frames + correspondences -> fitted wireframe -> DynamicExpressionModel<Px> (tracked)
//!   -> DynamicExpressionModel<FaceUnit> (normalized) -> models of one expression, trimmed
//!   -> Representative { generalized median, dispersion } -> FAP file, report
//! ```
//!
//! # The method in order
//!
//! ```no_run
//! use std::path::Path;
//!
//! use grimace::{
//!     correspondence::read_correspondences,
//!     dataset::list_frames,
//!     fap::{FapCatalog, FapSequence, write_fap},
//!     fit::{FitOptions, Fitter},
//!     normalize::{NormalizeOptions, Normalizer},
//!     sequence::SequenceReader,
//!     track::{TrackOptions, TrackPlan, track_model, track_sequence},
//!     wireframe::Face,
//! };
//!
//! let folder = Path::new("fixtures/simulated/S001/005");
//! let Face { wireframe, tables } = Face::candide3();
//! // Fit: marked points of the neutral frame pull the wireframe.
//! let marks = read_correspondences(&folder.join("correspondences.csv"), &tables, wireframe.node_count())?;
//! let fitted = Fitter::new(&wireframe, FitOptions::default()).fit(&wireframe, &marks)?;
//! // Track: it follows the face to the apex frame.
//! let frames = SequenceReader::open(&list_frames(folder, None, None)?)?;
//! let plan = TrackPlan::new(&wireframe, &tables);
//! let track = track_sequence(&wireframe, &plan, &fitted, frames, &TrackOptions::default(), |_| true)?;
//! // Normalize: five frames in face units. Models of many people make a `statistics::representative`.
//! let normalizer = Normalizer::new(&wireframe, &tables, NormalizeOptions::default())?;
//! let model = normalizer.normalize(&track_model(&track.frames)?)?;
//! // FAPs.
//! let (faps, _) = FapSequence::from_model(&model, &normalizer.canonical().fapus, FapCatalog::mpeg4(), "smile", 25, 5)?;
//! write_fap(Path::new("smile.fap"), &faps)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Features
//!
//! All are on by default. Without them (`default-features = false`) the library is the method alone, in Rust, for every platform that
//! Rust has: fit, tracking, normalization, statistics, FAP files, synthesis and cloning.
//!
//! - `tool`: the command line, and all that its commands need.
//! - `annotate`: the page on which marks are set.
//! - `columnar`: models in Parquet files.
//! - `opencv`: the program `grimace-opencv`, which reads and writes videos. The library starts it and never links OpenCV.
//!
//! `examples/` goes on from here; `docs/architecture.md` says how the modules lie on each other.
//!
//! Axes and units are those of [`units`]. Left and right are always the subject's own.
//!
//! # References
//! - **\[KP\]** S. Krinidis, I. Pitas: *Facial expression synthesis through facial expressions statistical analysis*, EUSIPCO 2006.
//! - **\[ZL\]** L. Zhu, W.-S. Lee: *Facial expression via genetic algorithms*.
//! - **\[Candide-3\]** J. Ahlberg: *Candide-3 - an updated parameterised face*, report LiTH-ISY-R-2326, 2001.
//! - **\[MPEG-4\]** ISO/IEC 14496-2 (Visual), Annex C: FAPs, FAPUs, feature points.
//! - **\[Bouguet\]** J.-Y. Bouguet: *Pyramidal implementation of the Lucas Kanade feature tracker*, Intel, 1999.
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

// The command line uses the library by its outer name.
extern crate self as grimace;

#[cfg(feature = "annotate")]
pub mod annotate;
#[cfg(feature = "tool")]
#[doc(hidden)]
#[allow(missing_docs, clippy::pedantic)]
pub mod cli;
pub mod clone;
#[cfg(feature = "columnar")]
pub mod columnar;
#[doc(hidden)]
pub mod companion;
pub mod correspondence;
pub mod dataset;
pub mod fap;
pub mod features;
pub mod fit;
mod foreign;
mod formula;
#[cfg(feature = "tool")]
#[doc(hidden)]
pub mod fuzzing;
pub mod geometry;
pub mod input;
pub mod interpolation;
pub mod locate;
pub mod mesh;
pub mod model;
pub mod normalize;
pub mod output;
pub mod overlay;
pub mod pipeline;
pub mod plausible;
pub mod player;
pub mod pose;
pub mod positions;
pub mod render;
pub mod report;
pub mod robust;
pub mod segment;
pub mod sequence;
pub mod statistics;
pub mod synthesis;
pub mod text;
pub mod track;
pub mod units;
pub mod warp;
pub mod wireframe;
