//! Progress bars on a terminal, on standard error.

use std::{
    collections::{BTreeMap, btree_map::Entry},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
};

use grimace::{output::listed, pipeline::Event};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Bar over sequences with a count of frames and the time left. Hidden when standard error is no terminal.
#[derive(Debug)]
pub struct SequenceBar {
    bar: ProgressBar,
    frames: AtomicU64,
    repeated: Mutex<Repeated>,
}

/// Failures by what they have in common: names of files and numbers aside. The first of each is printed as it happens; further ones, as they
/// were to be printed, wait for the end.
#[derive(Debug, Default)]
struct Repeated(BTreeMap<String, Kind>);

/// Failures of one kind.
#[derive(Debug)]
struct Kind {
    /// The sequence whose failure was printed.
    first: String,
    /// Other sequences, each with its line.
    others: Vec<(String, String)>,
}

impl Repeated {
    /// Whether a failure is the first of its kind; others are kept.
    fn is_first(&mut self, id: &str, reason: &str, line: &str) -> bool {
        let plain =
            |word: &&str| !word.contains(id) && !word.contains(['/', '\\', '`']) && !word.contains(|c: char| c.is_ascii_digit());
        let kind = reason.split_whitespace().filter(plain).collect::<Vec<_>>().join(" ");
        match self.0.entry(kind) {
            Entry::Vacant(place) => {
                place.insert(Kind { first: id.to_owned(), others: Vec::new() });
                true
            }
            Entry::Occupied(mut kind) => {
                kind.get_mut().others.push((id.to_owned(), line.to_owned()));
                false
            }
        }
    }

    /// What is left to say: one more as it is, several as their number.
    fn rest(&self) -> Vec<String> {
        let said = |Kind { first, others }: &Kind| match others.as_slice() {
            [] => None,
            [(_, line)] => Some(line.clone()),
            _ => {
                let mut ids: Vec<String> = others.iter().map(|(id, _)| id.clone()).collect();
                ids.sort();
                let (count, named) = (ids.len(), listed(&ids, NAMED));
                Some(format!(
                    "{count} more sequences failed in the same way as {first}: {named}; their reasons are in failures.csv"
                ))
            }
        };
        self.0.values().filter_map(said).collect()
    }
}

/// Sequences that are named of those that failed in the same way.
const NAMED: usize = 6;

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
                    let id = id.to_string();
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
        self.repeated.lock().unwrap_or_else(PoisonError::into_inner).rest().iter().for_each(|line| eprintln!("{line}"));
    }
}

/// Bar over the frames of one sequence.
pub fn frame_bar(quiet: bool, frames: Option<u64>) -> ProgressBar {
    counted_bar(quiet, frames, "frames")
}

/// Bar over a number of things.
pub fn counted_bar(quiet: bool, length: Option<u64>, things: &str) -> ProgressBar {
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(length, target);
    if let Ok(style) = ProgressStyle::with_template(&format!("{{bar:32.cyan/blue}} {{pos}}/{{len}} {things}  {{eta}} left")) {
        bar.set_style(style);
    }
    bar
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_fails_in_the_same_way_is_said_once_with_a_count() {
        let mut repeated = Repeated::default();
        let first: Vec<bool> = (1..=4)
            .map(|k| {
                let (id, reason) = (format!("S00{k}_001"), format!("data/S00{k}/001: no face was found in frame {k}"));
                repeated.is_first(&id, &reason, &format!("{id}: {reason}"))
            })
            .collect();
        assert_eq!(first, [true, false, false, false]);
        assert!(repeated.is_first("S005_001", "the file is empty", "S005_001: the file is empty"));
        assert!(!repeated.is_first("S006_001", "the file is empty", "S006_001: the file is empty"));
        let more = "3 more sequences failed in the same way as S001_001: S002_001; S003_001; S004_001; their reasons are in failures.csv";
        assert_eq!(repeated.rest(), [more, "S006_001: the file is empty"]);
    }
}
