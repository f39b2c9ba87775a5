//! Transfers what a user wrote into a table of segments to the table that replaces it.

use std::path::{Path, PathBuf};

use super::{
    Segment,
    files::{SEGMENT_COLUMNS, SegmentRow},
    segments_folder,
};
use crate::{
    input::{CsvFile, InputError},
    output::{OutputError, count, write_records},
    text::composed,
};

/// The list of proposed sequences, in the folder beside a table of segments. It cannot collide with a recording's files: their names
/// continue with a number or `_frames`.
const PROPOSED: &str = "proposed.csv";
const PROPOSED_COLUMNS: [&str; 4] = ["sequence", "frames", "first_frame", "last_frame"];

/// Label of unlabelled sequences.
pub const UNLABELLED: &str = "unlabelled";

/// A table of segments that is going to be replaced.
#[derive(Clone, Debug, Default)]
pub struct EarlierSegments {
    /// Columns that the user added.
    columns: Vec<String>,
    rows: Vec<EarlierRow>,
    /// Sequences proposed for it, including deleted rows.
    proposed: Vec<Proposal>,
}

/// A proposed sequence.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Proposal {
    sequence: String,
    frames: String,
    /// Neutral and apex frame.
    numbers: [u32; 2],
}

/// Whether two sequences are the same stretch of a recording: the common frames are more than half of the longer one. Adjacent sequences
/// that share frames are not the same, nor is a part of a sequence that was segmented differently.
fn is_same_stretch(a: [u32; 2], b: [u32; 2]) -> bool {
    let ends = |[first, last]: [u32; 2]| (u64::from(first.min(last)), u64::from(first.max(last)));
    let ((a_first, a_last), (b_first, b_last)) = (ends(a), ends(b));
    let common = (a_last.min(b_last) + 1).saturating_sub(a_first.max(b_first));
    2 * common > (a_last - a_first).max(b_last - b_first) + 1
}

/// Pairs `count` items one to one with `others`. The first rule makes as many pairs as possible, the next pairs the remaining items, and so
/// on.
fn paired(count: usize, others: usize, rules: &[&dyn Fn(usize, usize) -> bool]) -> Vec<Option<usize>> {
    let (mut of, mut is_taken) = (vec![None; count], vec![false; others]);
    for rule in rules {
        for (k, own) in of.iter_mut().enumerate().filter(|(_, own)| own.is_none()) {
            *own = (0..others).find(|&other| !is_taken[other] && rule(k, other));
            if let Some(other) = *own {
                is_taken[other] = true;
            }
        }
    }
    of
}

impl Proposal {
    fn of(row: &SegmentRow<'_>) -> Self {
        let numbers = [row.segment.neutral_frame, row.segment.apex_frame];
        Self { sequence: row.segment.name.clone(), frames: place(&row.of.frames), numbers }
    }

    /// Whether it is the same stretch of the same recording.
    fn is_same(&self, other: &Self) -> bool {
        self.frames == other.frames && is_same_stretch(self.numbers, other.numbers)
    }
}

/// The sequences proposed for a table; empty if unknown.
fn read_proposed(table: &Path) -> Result<Vec<Proposal>, InputError> {
    let path = segments_folder(table).join(PROPOSED);
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let csv = CsvFile::open(&path)?;
    let [sequence, frames, first, last] = csv.require(PROPOSED_COLUMNS)?;
    let proposal = |row: crate::input::CsvRow<'_>| {
        let numbers = [row.whole_number(first)?, row.whole_number(last)?];
        Ok(Proposal { sequence: row.get(sequence).to_owned(), frames: place(row.get(frames)), numbers })
    };
    csv.rows().map(|row| row.and_then(proposal)).collect()
}

#[derive(Clone, Debug)]
struct EarlierRow {
    subject: String,
    sequence: String,
    emotion: String,
    frames: String,
    /// Neutral and apex frame.
    numbers: [Option<u32>; 2],
    more: Vec<String>,
}

impl EarlierRow {
    fn is_of(&self, proposal: &Proposal) -> bool {
        self.frames == proposal.frames
    }

    /// Whether it is exactly this sequence, whatever its name.
    fn is_exactly(&self, proposal: &Proposal) -> bool {
        self.is_of(proposal) && self.numbers == proposal.numbers.map(Some)
    }

    /// Whether it is the same stretch of the same recording.
    fn is_same(&self, proposal: &Proposal) -> bool {
        let [Some(neutral), Some(apex)] = self.numbers else { return false };
        self.is_of(proposal) && is_same_stretch([neutral, apex], proposal.numbers)
    }

    /// Text with name, label and frames.
    fn said(&self) -> String {
        let [first, last] = self.numbers.map(|number| number.map_or_else(|| "?".to_owned(), |number| number.to_string()));
        format!("{} ({}, frames {first} to {last})", self.sequence, self.emotion)
    }
}

/// Normalized form of a path in a table.
fn place(frames: &str) -> String {
    composed(frames).trim_start_matches("./").trim_end_matches('/').to_owned()
}

impl EarlierSegments {
    /// Reads an existing table. Returns an empty one if there is none or the file is of another kind.
    ///
    /// # Errors
    /// [`InputError`] for a table of segments, or its list of proposed sequences, with an unreadable row.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let Ok(csv) = CsvFile::open(path).and_then(|csv| csv.or_semicolons(&SEGMENT_COLUMNS)) else { return Ok(Self::default()) };
        let Ok([subject, sequence, emotion, frames, first, last]) =
            csv.require(["subject", "sequence", "emotion", "frames", "first_frame", "last_frame"])
        else {
            return Ok(Self::default());
        };
        let is_added = |name: &str| !name.is_empty() && !SEGMENT_COLUMNS.contains(&name);
        let added: Vec<usize> = (0..csv.header().len()).filter(|&k| is_added(&csv.header()[k])).collect();
        let mut rows = Vec::new();
        for row in csv.rows() {
            let row = row?;
            let text = |column: usize| row.get(column).to_owned();
            rows.push(EarlierRow {
                subject: text(subject),
                sequence: text(sequence),
                emotion: text(emotion),
                frames: place(row.get(frames)),
                numbers: [first, last].map(|column| row.get(column).parse().ok()),
                more: added.iter().map(|&column| text(column)).collect(),
            });
        }
        let columns = added.iter().map(|&k| csv.header()[k].clone()).collect();
        Ok(Self { columns, rows, proposed: read_proposed(path)? })
    }

    /// Returns the recordings in the table that are not named, each once, as in its column `frames`.
    pub fn others_than(&self, is_named: impl Fn(&str) -> bool) -> Vec<String> {
        let mut others: Vec<String> = Vec::new();
        for row in &self.rows {
            let frames = if row.frames.is_empty() { format!("{}/{}", row.subject, row.sequence) } else { row.frames.clone() };
            if !is_named(&frames) && !others.contains(&frames) {
                others.push(frames);
            }
        }
        others
    }

    /// Columns that the user added, as in [`SegmentRow::more`].
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Transfers entries of the earlier table to rows with the same frames of the same recording: labels and subjects unless `is_given` for
    /// all, and the fields of added columns. It removes rows that the user had deleted.
    pub fn keep_in(self, rows: &mut Vec<SegmentRow<'_>>, is_given: GivenForAll) -> KeptRows {
        let (mut labels, mut other, mut moved) = (0, Vec::new(), Vec::new());
        let (earlier, old) = (&self.rows, &self.proposed);
        // Row of each proposed sequence, whatever the user changed in it. A proposal without a row was deleted.
        let row_of = paired(
            old.len(),
            earlier.len(),
            &[
                &|p, row| earlier[row].is_exactly(&old[p]),
                &|p, row| earlier[row].is_of(&old[p]) && earlier[row].sequence == old[p].sequence,
                &|p, row| earlier[row].is_same(&old[p]),
                &|p, row| earlier[row].sequence == old[p].sequence,
            ],
        );
        let found: Vec<Proposal> = rows.iter().map(Proposal::of).collect();
        let was_proposed = |k: usize, row: usize| {
            earlier[row].is_of(&found[k])
                && row_of.iter().zip(old).any(|(of, proposal)| *of == Some(row) && proposal.is_same(&found[k]))
        };
        let kept_from = paired(
            found.len(),
            earlier.len(),
            &[&|k, row| earlier[row].is_exactly(&found[k]), &was_proposed, &|k, row| earlier[row].is_same(&found[k])],
        );
        let deleted: Vec<&Proposal> = old.iter().zip(&row_of).filter(|(_, row)| row.is_none()).map(|(old, _)| old).collect();
        let is_left_out = |k: usize| kept_from[k].is_none() && deleted.iter().any(|old| old.is_same(&found[k]));
        let (left_out, kept): (Vec<_>, Vec<_>) = std::mem::take(rows).into_iter().enumerate().partition(|(k, _)| is_left_out(*k));
        let is_left_out_now = |old: &Proposal| left_out.iter().any(|(k, _)| old.is_same(&found[*k]));
        let mut gone: Vec<Proposal> = left_out.iter().map(|(k, _)| found[*k].clone()).collect();
        gone.extend(deleted.into_iter().filter(|old| !is_left_out_now(old)).cloned());
        let proposed = Proposed { rows: kept.iter().map(|(k, _)| found[*k].clone()).collect(), deleted: gone };
        let width = self.columns.len();
        for (k, mut row) in kept {
            row.more.resize(width, String::new());
            let Some(old) = kept_from[k].map(|row| &earlier[row]) else {
                rows.push(row);
                continue;
            };
            if !old.is_exactly(&found[k]) {
                let (first, last) = (row.segment.neutral_frame, row.segment.apex_frame);
                moved.push(format!("{}, now frames {first} to {last}", old.said()));
            }
            if !is_given.emotion && !old.emotion.is_empty() && old.emotion != row.of.emotion {
                row.of.emotion.clone_from(&old.emotion);
                labels += 1;
            } else if is_given.emotion && ![UNLABELLED, "", &row.of.emotion].contains(&old.emotion.as_str()) {
                other.push(format!("{} ({}, now {})", old.sequence, old.emotion, row.of.emotion));
            }
            if !is_given.subject && !old.subject.is_empty() {
                row.of.subject.clone_from(&old.subject);
            }
            row.more.clone_from(&old.more);
            rows.push(row);
        }
        let is_worth = |old: &EarlierRow| {
            let is_redone = proposed.rows.iter().any(|found| old.is_of(found));
            !is_redone || old.emotion != UNLABELLED || old.more.iter().any(|field| !field.is_empty())
        };
        let is_gone = |(k, old): &(usize, &EarlierRow)| !kept_from.contains(&Some(*k)) && is_worth(old);
        let gone: Vec<String> = earlier.iter().enumerate().filter(is_gone).map(|(_, old)| old.said()).collect();
        let is_lossy = !moved.is_empty() || !gone.is_empty();
        let mut said = Vec::new();
        if !left_out.is_empty() {
            let names: Vec<String> = left_out
                .iter()
                .map(|(_, row)| {
                    let Segment { name, neutral_frame, apex_frame, .. } = row.segment;
                    format!("{name} (frames {neutral_frame} to {apex_frame})")
                })
                .collect();
            said.push(format!(
                "left out, because their rows were deleted from the old table: {}; remove that table to get all of them back",
                names.join("; ")
            ));
        }
        if labels > 0 {
            said.push(format!("labels kept from the old table: {}", count(labels, "sequence", "sequences")));
        }
        if !self.columns.is_empty() {
            said.push(format!("columns kept from the old table: {}", self.columns.join(", ")));
        }
        for (what, list) in [
            ("the old table had other labels", other),
            ("the old table had other frames", moved),
            ("in the old table, but not found now", gone),
        ] {
            if !list.is_empty() {
                said.push(format!("{what}: {}", list.join("; ")));
            }
        }
        KeptRows { notes: said, proposed, is_lossy }
    }
}

/// Result of [`EarlierSegments::keep_in`].
#[derive(Clone, Debug)]
pub struct KeptRows {
    /// Messages.
    pub notes: Vec<String>,
    /// List of proposed sequences for the new table.
    pub proposed: Proposed,
    /// Whether the earlier table has rows or frames that the new one lacks, so that it should be kept.
    pub is_lossy: bool,
}

/// Copies a table that somebody may have edited to a free name beside it, `STEM_edited.csv`. Returns the copy.
///
/// # Errors
/// [`OutputError`] when it cannot be copied.
pub fn keep_edited(table: &Path) -> Result<PathBuf, OutputError> {
    let copy = free_edited(table);
    std::fs::copy(table, &copy).map_err(OutputError::at(&copy))?;
    Ok(copy)
}

/// Returns the first free name for an edited `.csv` file: `STEM_edited.csv`, then `STEM_edited-2.csv` and so on.
pub(super) fn free_edited(file: &Path) -> PathBuf {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let mut number = 1;
    loop {
        let suffix = if number == 1 { String::new() } else { format!("-{number}") };
        let free = file.with_file_name(format!("{stem}_edited{suffix}.csv"));
        if !free.exists() {
            return free;
        }
        number += 1;
    }
}

/// All sequences proposed for a table of segments.
#[derive(Clone, Debug)]
pub struct Proposed {
    /// Proposals with a row in the table.
    rows: Vec<Proposal>,
    /// Proposals that the user deleted.
    deleted: Vec<Proposal>,
}

impl Proposed {
    /// Writes the table with `write_table`, and the proposals into the folder beside it, so that deleted rows can be distinguished from new
    /// ones. Before the table only deleted proposals are written, so that an interruption never makes other sequences count as deleted.
    ///
    /// # Errors
    /// [`OutputError`] when one of them cannot be written.
    pub fn write(&self, table: &Path, write_table: impl FnOnce() -> Result<(), OutputError>) -> Result<(), OutputError> {
        let path = segments_folder(table).join(PROPOSED);
        let row = |p: &Proposal| {
            let [first, last] = p.numbers.map(|number| number.to_string());
            vec![p.sequence.clone(), p.frames.clone(), first, last]
        };
        write_records(&path, PROPOSED_COLUMNS, self.deleted.iter().map(row))?;
        write_table()?;
        // Proposals with rows come first: when two have the same name, the row belongs to the first.
        write_records(&path, PROPOSED_COLUMNS, self.rows.iter().chain(&self.deleted).map(row)).map(|_| ())
    }
}

/// Fields given for all sequences on the command line, which override an earlier table.
#[derive(Clone, Copy, Debug)]
pub struct GivenForAll {
    /// The label.
    pub emotion: bool,
    /// The subject.
    pub subject: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::{ManifestColumns, write_segments};

    fn found() -> Vec<Segment> {
        let segment = |(k, [neutral_frame, apex_frame]): (usize, [u32; 2])| Segment {
            name: format!("talk-{:02}", k + 1),
            neutral_frame,
            onset_frame: neutral_frame,
            apex_frame,
            offset_frame: apex_frame,
            confidence: 1.0,
            marks: Vec::new(),
        };
        [[10, 30], [50, 70], [90, 70], [120, 140]].into_iter().enumerate().map(segment).collect()
    }

    /// Performs the steps of `segment` after segmentation. Returns the names in the new table, and the messages.
    fn again(table: &Path, segments: &[Segment]) -> (Vec<String>, Vec<String>) {
        let of = ManifestColumns { subject: "P1".to_owned(), emotion: UNLABELLED.to_owned(), frames: "talk".to_owned() };
        let row = |segment| SegmentRow { of: of.clone(), more: Vec::new(), fps: Some(25.0), segment };
        let mut rows: Vec<SegmentRow<'_>> = segments.iter().map(row).collect();
        let earlier = EarlierSegments::read(table).unwrap();
        let KeptRows { notes: said, proposed, .. } = earlier.keep_in(&mut rows, GivenForAll { emotion: false, subject: false });
        proposed.write(table, || write_segments(table, "segments", &[], &rows)).unwrap();
        (rows.iter().map(|row| row.segment.name.clone()).collect(), said)
    }

    fn edit(table: &Path, change: impl Fn(&str) -> Option<String>) {
        let text = std::fs::read_to_string(table).unwrap();
        std::fs::write(table, text.lines().filter_map(change).collect::<Vec<_>>().join("\n")).unwrap();
    }

    #[test]
    fn a_row_that_a_person_deleted_stays_deleted() {
        let folder = tempfile::tempdir().unwrap();
        let table = folder.path().join("segments.csv");
        std::fs::create_dir(segments_folder(&table)).unwrap();
        let segments = found();
        assert_eq!(again(&table, &segments).0, ["talk-01", "talk-02", "talk-03", "talk-04"]);
        // The third shares its apex with the second, which stays; the fourth has another name and other frames.
        let change = |line: &str| match line {
            _ if line.contains("talk-03") => None,
            _ => Some(line.replace("talk-04,unlabelled", "smile,joy").replace(",120,", ",118,")),
        };
        edit(&table, change);
        for _ in 0..2 {
            let (names, said) = again(&table, &segments);
            assert_eq!(names, ["talk-01", "talk-02", "talk-04"], "{said:?}");
            assert!(said[0].starts_with("left out, because their rows were deleted"), "{said:?}");
            assert!(said[0].contains(": talk-03 (frames 90 to 70);"), "{said:?}");
        }
        // Other options find no segments, later a slightly shifted one: it counts as the same.
        assert!(again(&table, &[]).0.is_empty());
        let mut moved = segments.clone();
        moved[2].neutral_frame += 2;
        assert_eq!(again(&table, &moved).0, ["talk-01", "talk-02", "talk-04"]);
        // A sequence that was not proposed is new. Without the list all are.
        moved.push(Segment { name: "talk-05".to_owned(), neutral_frame: 200, apex_frame: 220, ..segments[0].clone() });
        assert_eq!(again(&table, &moved).0, ["talk-01", "talk-02", "talk-04", "talk-05"]);
        std::fs::remove_file(&table).unwrap();
        assert_eq!(again(&table, &segments).0.len(), 4);
    }

    /// A table of the found segments, and its folder.
    fn table_of(segments: &[Segment]) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let table = folder.path().join("segments.csv");
        std::fs::create_dir(segments_folder(&table)).unwrap();
        assert_eq!(again(&table, segments).0.len(), segments.len());
        (folder, table)
    }

    #[test]
    fn parts_of_a_proposal_that_was_deleted_are_new() {
        let mut merged = found();
        merged.truncate(1);
        merged[0].apex_frame = 100;
        let (_folder, table) = table_of(&merged);
        edit(&table, |line| (!line.contains("talk-01")).then(|| line.to_owned()));
        let mut split = found();
        split.truncate(2);
        (split[1].neutral_frame, split[1].apex_frame) = (40, 60);
        assert_eq!(again(&table, &split).0, ["talk-01", "talk-02"]);
        // With the first segmentation it is still deleted, although others of its name and stretch were proposed in between.
        let (names, said) = again(&table, &merged);
        assert!(names.is_empty() && said[0].contains("talk-01 (frames 10 to 100)"), "{said:?}");
    }

    #[test]
    fn what_a_neighbour_is_changed_to_brings_no_deleted_row_back() {
        let segments = found();
        let (_folder, table) = table_of(&segments);
        let change = |line: &str| (!line.contains("talk-03")).then(|| line.replace(",50,70,", ",50,75,"));
        edit(&table, change);
        let mut near = segments.clone();
        near[2].apex_frame = 68;
        for segments in [&segments, &near] {
            assert_eq!(again(&table, segments).0, ["talk-01", "talk-02", "talk-04"]);
        }
        // The rows after it may be renumbered.
        let (_folder, table) = table_of(&segments);
        edit(&table, |line| (!line.contains("talk-03")).then(|| line.replace("talk-04", "talk-03")));
        assert_eq!(again(&table, &segments).0, ["talk-01", "talk-02", "talk-04"]);
    }

    #[test]
    fn a_row_that_was_given_other_frames_is_not_deleted_and_keeps_its_label() {
        for frames in [",45,50,", ",30,44,", ",,,"] {
            let (_folder, table) = table_of(&found());
            let joy = |line: &str| line.replace("talk-02,unlabelled", "talk-02,joy").replace(",50,70,", frames);
            edit(&table, |line| Some(joy(line)));
            let (names, said) = again(&table, &found());
            assert_eq!(names, ["talk-01", "talk-02", "talk-03", "talk-04"], "{said:?}");
            let text = std::fs::read_to_string(&table).unwrap();
            assert!(text.contains("talk-02,joy,talk,50,70,"), "{frames}: {text}");
            assert!(said.iter().any(|said| said.contains("other frames: talk-02 (joy, frames ")), "{said:?}");
        }
    }

    #[test]
    fn what_ends_the_program_between_two_files_deletes_nothing() {
        let full = || Err(OutputError::at(Path::new("segments.csv"))(std::io::Error::other("disk full")));
        for is_written in [false, true] {
            let (_folder, table) = table_of(&found());
            edit(&table, |line| (!line.contains("talk-03")).then(|| line.to_owned()));
            // Another segmentation finds fewer, and the program ends before or after writing the table.
            let fewer = found()[..1].to_vec();
            let of = ManifestColumns { subject: "P1".to_owned(), emotion: UNLABELLED.to_owned(), frames: "talk".to_owned() };
            let mut rows = vec![SegmentRow { of, more: Vec::new(), fps: Some(25.0), segment: &fewer[0] }];
            let earlier = EarlierSegments::read(&table).unwrap();
            let KeptRows { proposed, .. } = earlier.keep_in(&mut rows, GivenForAll { emotion: false, subject: false });
            let ended = proposed.write(&table, || {
                if is_written {
                    write_segments(&table, "segments", &[], &rows)?;
                }
                full()
            });
            assert!(ended.is_err());
            assert_eq!(again(&table, &found()).0, ["talk-01", "talk-02", "talk-04"], "{is_written}");
        }
    }

    #[test]
    fn a_list_of_proposals_that_does_not_read_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let table = folder.path().join("segments.csv");
        std::fs::create_dir(segments_folder(&table)).unwrap();
        again(&table, &found());
        std::fs::write(segments_folder(&table).join(PROPOSED), "sequence,frames,first_frame,last_frame\ntalk-01,talk,x,3\n")
            .unwrap();
        let said = EarlierSegments::read(&table).unwrap_err().to_string();
        assert!(said.contains("proposed.csv") && said.contains("line 2"), "{said}");
    }
}
