//! Progress bars on a terminal, on standard error.

use std::sync::{
    Mutex, PoisonError,
    atomic::{AtomicU64, Ordering},
};

use grimace::{pipeline::Event, report::failed_name};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::failures::{FAILED, Repeated};

/// Bar over sequences with a count of frames and the remaining time. Hidden if standard error is not a terminal.
#[derive(Debug)]
pub struct SequenceBar {
    bar: ProgressBar,
    frames: AtomicU64,
    repeated: Mutex<Repeated>,
}

impl SequenceBar {
    pub fn new(quiet: bool) -> Self {
        let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(0), target);
        let template = "{bar:32.cyan/blue} {pos}/{len} sequences  {msg}  {elapsed} elapsed, {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        Self { bar, frames: AtomicU64::new(0), repeated: Mutex::default() }
    }

    pub fn show(&self, event: &Event) {
        match event {
            Event::Started { sequences } => self.bar.set_length(*sequences as u64),
            Event::Segmenting { id } => self.bar.set_message(format!("looking for expressions in {id}")),
            Event::Frame => {
                let frames = self.frames.fetch_add(1, Ordering::Relaxed) + 1;
                if frames.is_multiple_of(16) {
                    self.bar.set_message(format!("{frames} frames"));
                }
            }
            Event::Finished { id, failure, .. } => {
                if let Some(reason) = failure {
                    let id = failed_name(&id.subject, &id.sequence, reason);
                    let line = if reason.contains(&id) { reason.clone() } else { format!("{id}: {reason}") };
                    if self.repeated.lock().unwrap_or_else(PoisonError::into_inner).is_first(&id, reason, &line) {
                        self.bar.suspend(|| eprintln!("{line}"));
                    }
                }
                self.bar.inc(1);
            }
            Event::Analyzing => self.bar.set_message("statistics and report"),
        }
    }

    pub fn finish(&self) {
        self.bar.finish_and_clear();
        let repeated = self.repeated.lock().unwrap_or_else(PoisonError::into_inner);
        repeated.rest(FAILED, Some("failures.csv")).iter().for_each(|line| eprintln!("{line}"));
    }
}

/// Bar over the frames of one sequence.
pub fn frame_bar(quiet: bool, frames: Option<u64>) -> ProgressBar {
    counted_bar(quiet, frames, "frames")
}

/// Bar over a number of items.
pub fn counted_bar(quiet: bool, length: Option<u64>, things: &str) -> ProgressBar {
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(length, target);
    if let Ok(style) = ProgressStyle::with_template(&format!("{{bar:32.cyan/blue}} {{pos}}/{{len}} {things}  {{eta}} left")) {
        bar.set_style(style);
    }
    bar
}
