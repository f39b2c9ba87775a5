//! Prints failures in a form that fits a terminal: the first of each kind in full, and the number of the others. A table, if there is one,
//! has all with their reasons.

use std::{
    collections::{BTreeMap, BTreeSet, btree_map::Entry},
    path::Path,
};

use grimace::{
    dataset::Dataset,
    output::{count, listed},
    pipeline::AnalyzedModel,
    report::{Failure, failed_name},
    units::SequenceId,
};

/// Number of ids that are listed for each kind of failure.
const NAMED: usize = 6;

/// Prefix of lines about sequences to review.
pub const LOOK_AGAIN: &str = "look again";

/// Prefix of lines about failed sequences.
pub const FAILED: &str = "failed";

/// Most kinds of failures that are distinguished.
const KINDS: usize = 12;

/// Failures by kind: equal except for names of files and numbers. The first of each kind is printed at once; the others are collected until
/// the end.
#[derive(Debug, Default)]
pub struct Repeated {
    kinds: BTreeMap<String, Kind>,
    /// Sequences that failed in yet other ways.
    beyond: Vec<String>,
}

/// Failures of one kind.
#[derive(Debug)]
struct Kind {
    /// The sequence whose failure was printed.
    first: String,
    /// Other sequences, each with its line.
    others: Vec<(String, String)>,
}

impl Repeated {
    /// Returns whether a failure is the first of its kind. Others are stored.
    pub fn is_first(&mut self, id: &str, reason: &str, line: &str) -> bool {
        let is_name =
            |word: &str| word.contains(id) || word.contains(['/', '\\', '`']) || word.trim_end_matches('.').contains('.');
        let plain = |word: &&str| !is_name(word) && !word.contains(|c: char| c.is_ascii_digit());
        let kind = reason.split_whitespace().filter(plain).collect::<Vec<_>>().join(" ");
        let is_full = self.kinds.len() == KINDS;
        match self.kinds.entry(kind) {
            Entry::Vacant(_) if is_full => {
                self.beyond.push(id.to_owned());
                false
            }
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

    /// Lines about the stored failures: a single one in full, several as their number, with the prefix and the table that has all reasons.
    pub fn rest(&self, became: &str, table: Option<&str>) -> Vec<String> {
        let summed = |ids: &mut Vec<String>, how: &str| {
            ids.sort();
            let (count, named) = (ids.len(), listed(ids, NAMED));
            let reasons = table.map(|table| format!("; reasons: {table}")).unwrap_or_default();
            format!("{count} more {} {became}{how}: {named}{reasons}", if count == 1 { "sequence" } else { "sequences" })
        };
        let said = |Kind { first, others }: &Kind| match others.as_slice() {
            [] => None,
            [(_, line)] => Some(line.clone()),
            _ => {
                let mut ids = others.iter().map(|(id, _)| id.clone()).collect();
                Some(summed(&mut ids, &format!(" like {first}")))
            }
        };
        let mut lines: Vec<String> = self.kinds.values().filter_map(said).collect();
        if !self.beyond.is_empty() {
            lines.push(summed(&mut self.beyond.clone(), " in other ways"));
        }
        lines
    }
}

/// Prints the reasons of failed sequences, and the table with all reasons if it was written.
pub fn say_failures<'a>(failures: impl IntoIterator<Item = &'a Failure>, table: Option<&Path>) {
    lines_of(failures, table).iter().for_each(|line| eprintln!("{line}"));
}

/// A line `WHAT: ID: REASON` for every sequence; for equal reasons the first one, and the number of the others.
pub fn lines_by_kind<'a>(
    said: impl IntoIterator<Item = (&'a SequenceId, String, String)>,
    became: &str,
    table: Option<&Path>,
) -> Vec<String> {
    let (mut repeated, mut lines) = (Repeated::default(), Vec::new());
    for (id, what, reason) in said {
        let name = failed_name(&id.subject, &id.sequence, &reason);
        let line = if reason.starts_with(&name) { format!("{what}: {reason}") } else { format!("{what}: {name}: {reason}") };
        if repeated.is_first(&name, &reason, &line) {
            lines.push(line);
        }
    }
    lines.extend(repeated.rest(became, table.map(|path| path.display().to_string()).as_deref()));
    lines
}

/// Prints how many tracks a dataset does not list; their labels come from the files beside them.
pub fn say_unlisted(models: &[AnalyzedModel], dataset: Option<&Dataset>) {
    let Some(dataset) = dataset else { return };
    let known: BTreeSet<&SequenceId> = dataset.sequences.iter().map(|s| &s.id).collect();
    let unlisted: Vec<String> =
        models.iter().map(|m| &m.model.id).filter(|id| !known.contains(id)).map(ToString::to_string).collect();
    if !unlisted.is_empty() {
        eprintln!(
            "note: {} of {} are not in the manifest of --dataset; their emotion and columns come from the .json beside them: {}",
            unlisted.len(),
            count(models.len(), "track", "tracks"),
            listed(&unlisted, NAMED)
        );
    }
}

fn lines_of<'a>(failures: impl IntoIterator<Item = &'a Failure>, table: Option<&Path>) -> Vec<String> {
    let (mut repeated, mut lines) = (Repeated::default(), Vec::new());
    for Failure { subject, sequence, stage, reason } in failures {
        let name = failed_name(subject, sequence, reason);
        let line = if reason.starts_with(&name) {
            format!("failed at {stage}: {reason}")
        } else {
            format!("failed: {name} at {stage}: {reason}")
        };
        if repeated.is_first(&name, reason, &line) {
            lines.push(line);
        }
    }
    lines.extend(repeated.rest(FAILED, table.map(|path| path.display().to_string()).as_deref()));
    lines
}

#[cfg(test)]
mod tests {
    use grimace::report::Stage;

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
        let more = "3 more sequences failed like S001_001: S002_001; S003_001; S004_001; reasons: failures.csv";
        assert_eq!(repeated.rest(FAILED, Some("failures.csv")), [more, "S006_001: the file is empty"]);
    }

    #[test]
    fn a_row_without_a_name_is_named_by_its_line() {
        let row = |line: u32| Failure {
            subject: String::new(),
            sequence: String::new(),
            stage: Stage::Dataset,
            reason: format!("data/manifest.csv, line {line}: a quotation mark is not closed"),
        };
        let said = lines_of(&[row(3), row(5), row(8)], None);
        let more = "2 more sequences failed like data/manifest.csv, line 3: data/manifest.csv, line 5; data/manifest.csv, line 8";
        assert_eq!(said, ["failed at dataset: data/manifest.csv, line 3: a quotation mark is not closed", more]);
    }

    #[test]
    fn any_number_of_failures_of_any_kinds_takes_a_few_lines() {
        let failure = |k: usize, reason: String| {
            let (subject, sequence) = (format!("S{k:03}"), "5".to_owned());
            Failure { subject, sequence, stage: Stage::Dataset, reason }
        };
        // The name of a file in the current folder has no `/`.
        let alike: Vec<Failure> = (0..40).map(|k| failure(k, format!("{}.csv: is empty", ["joy", "fear"][k % 2]))).collect();
        let said = lines_of(&alike, Some(Path::new("out/failures.csv")));
        let named = "S001_5; S002_5; S003_5; S004_5; S005_5; S006_5; and 33 more";
        let more = format!("39 more sequences failed like S000_5: {named}; reasons: out/failures.csv");
        assert_eq!(said, ["failed: S000_5 at dataset: joy.csv: is empty".to_owned(), more]);
        let letters = |k: usize| "x".repeat(k + 1);
        let others: Vec<Failure> = (0..40).map(|k| failure(k, letters(k))).collect();
        let said = lines_of(&others, None);
        assert_eq!(said.len(), KINDS + 1);
        assert!(
            said[KINDS].starts_with("28 more sequences failed in other ways: S012_5; ") && said[KINDS].ends_with("and 22 more")
        );
    }
}
