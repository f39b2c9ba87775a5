//! What a person wrote into an earlier table of segments, for the table that replaces it.

use std::path::Path;

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

/// The table of what was proposed, in the folder beside a table of segments. No file of a recording has this name: they are called after the
/// recording, with a number or `_frames` behind it.
const PROPOSED: &str = "proposed.csv";
const PROPOSED_COLUMNS: [&str; 4] = ["sequence", "frames", "first_frame", "last_frame"];

/// The label of sequences that nobody has labelled.
pub const UNLABELLED: &str = "unlabelled";

/// A table of segments that is going to be replaced.
#[derive(Clone, Debug, Default)]
pub struct EarlierSegments {
    /// Columns that a person added.
    columns: Vec<String>,
    rows: Vec<EarlierRow>,
    /// What was proposed for it, deleted rows, too.
    proposed: Vec<Proposal>,
}

/// A sequence that was proposed.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Proposal {
    sequence: String,
    frames: String,
    /// Neutral and apex frame.
    numbers: [u32; 2],
}

/// Whether two sequences have more in common than the frame where one ends and the other begins.
fn overlap(a: [u32; 2], b: [u32; 2]) -> bool {
    a.iter().min().max(b.iter().min()) < a.iter().max().min(b.iter().max())
}

impl Proposal {
    fn of(row: &SegmentRow<'_>) -> Self {
        let numbers = [row.segment.neutral_frame, row.segment.apex_frame];
        Self { sequence: row.segment.name.clone(), frames: place(&row.of.frames), numbers }
    }

    /// Whether a row of the table is this sequence, whatever a person changed in it.
    fn is_in(&self, row: &EarlierRow) -> bool {
        let is_named = self.sequence == row.sequence;
        let [Some(neutral), Some(apex)] = row.numbers else { return is_named };
        (is_named || self.frames == row.frames) && overlap(self.numbers, [neutral, apex])
    }

    /// Whether it is the same stretch of the same recording.
    fn is_same(&self, other: &Self) -> bool {
        self.frames == other.frames && overlap(self.numbers, other.numbers)
    }
}

/// What was proposed for a table; nothing where that is not known.
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
    fn is_of(&self, row: &SegmentRow<'_>) -> bool {
        self.frames == place(&row.of.frames)
    }

    fn is_same(&self, row: &SegmentRow<'_>) -> bool {
        self.numbers == [Some(row.segment.neutral_frame), Some(row.segment.apex_frame)]
    }

    /// Whether it is of the same name and has frames in common: its frames were changed, or are found otherwise now.
    fn is_near(&self, row: &SegmentRow<'_>) -> bool {
        let [Some(neutral), Some(apex)] = self.numbers else { return false };
        let found = [row.segment.neutral_frame, row.segment.apex_frame];
        let (low, high) = (found[0].min(found[1]), found[0].max(found[1]));
        self.sequence == row.segment.name && neutral.min(apex) <= high && low <= neutral.max(apex)
    }

    /// Name, label and frames.
    fn said(&self) -> String {
        let [first, last] = self.numbers.map(|number| number.map_or_else(|| "?".to_owned(), |number| number.to_string()));
        format!("{} ({}, frames {first} to {last})", self.sequence, self.emotion)
    }
}

/// A path as a table names it, however it is written.
fn place(frames: &str) -> String {
    composed(frames).trim_start_matches("./").trim_end_matches('/').to_owned()
}

impl EarlierSegments {
    /// Reads a table that is there; nothing where there is none, or a file of another kind.
    ///
    /// # Errors
    /// [`InputError`] for a table of segments with a row that does not read, or such a list of what was proposed for it.
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

    /// Columns that a person added: those of [`SegmentRow::more`].
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Takes over what stands in the earlier table of the same frames of the same recording: labels where none is given for all now, subjects
    /// likewise, and the fields of columns that were added. Rows that a person deleted there are taken out. What is to be said of it, and what
    /// the table that replaces it was proposed.
    pub fn keep_in(self, rows: &mut Vec<SegmentRow<'_>>, is_given: GivenForAll) -> (Vec<String>, Proposed) {
        let (mut labels, mut other, mut moved) = (0, Vec::new(), Vec::new());
        let is_deleted = |proposal: &Proposal| !self.rows.iter().any(|row| proposal.is_in(row));
        let deleted: Vec<Proposal> = self.proposed.iter().filter(|proposal| is_deleted(proposal)).cloned().collect();
        let mut proposed: Vec<Proposal> = rows.iter().map(Proposal::of).collect();
        let (left_out, kept): (Vec<_>, Vec<_>) = std::mem::take(rows).into_iter().partition(|row| {
            let found = Proposal::of(row);
            deleted.iter().any(|old| old.is_same(&found)) && is_deleted(&found)
        });
        *rows = kept;
        proposed.extend(deleted.into_iter().filter(|old| !left_out.iter().any(|row| Proposal::of(row).is_same(old))));
        let mut earlier = self.rows;
        let width = self.columns.len();
        for row in rows.iter_mut() {
            row.more.resize(width, String::new());
            let of_same = |is: &dyn Fn(&EarlierRow) -> bool| earlier.iter().position(|old| old.is_of(row) && is(old));
            let found = of_same(&|old| old.is_same(row)).or_else(|| of_same(&|old| old.is_near(row)));
            let Some(old) = found.map(|k| earlier.remove(k)) else { continue };
            if !old.is_same(row) {
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
        }
        let is_worth = |old: &&EarlierRow| {
            let is_redone = rows.iter().any(|row| old.is_of(row));
            !is_redone || old.emotion != UNLABELLED || old.more.iter().any(|field| !field.is_empty())
        };
        let gone: Vec<String> = earlier.iter().filter(is_worth).map(EarlierRow::said).collect();
        let mut said = Vec::new();
        if !left_out.is_empty() {
            let names: Vec<String> = left_out
                .iter()
                .map(|row| {
                    let Segment { name, neutral_frame, apex_frame, .. } = row.segment;
                    format!("{name} (frames {neutral_frame} to {apex_frame})")
                })
                .collect();
            said.push(format!(
                "left out, since the rows were deleted from the table that was there: {}; without that table all come back",
                names.join("; ")
            ));
        }
        if labels > 0 {
            said.push(format!("labels kept from the table that was there: of {}", count(labels, "sequence", "sequences")));
        }
        if !self.columns.is_empty() {
            said.push(format!("columns kept from the table that was there: {}", self.columns.join(", ")));
        }
        for (what, list) in [
            ("the table that was there had other labels", other),
            ("the table that was there had other frames", moved),
            ("in the table that was there, and not found now", gone),
        ] {
            if !list.is_empty() {
                said.push(format!("{what}: {}", list.join("; ")));
            }
        }
        (said, Proposed(proposed))
    }
}

/// All that was proposed for a table of segments, deleted rows, too.
#[derive(Clone, Debug)]
pub struct Proposed(Vec<Proposal>);

impl Proposed {
    /// Writes it into the folder beside the table, so that a deleted row can be told from one that is new.
    ///
    /// # Errors
    /// [`OutputError`] when it cannot be written.
    pub fn write(&self, table: &Path) -> Result<(), OutputError> {
        let row = |p: &Proposal| {
            let [first, last] = p.numbers.map(|number| number.to_string());
            vec![p.sequence.clone(), p.frames.clone(), first, last]
        };
        write_records(&segments_folder(table).join(PROPOSED), PROPOSED_COLUMNS, self.0.iter().map(row)).map(|_| ())
    }
}

/// What is given for all sequences now, and so counts more than what an earlier table says.
#[derive(Clone, Copy, Debug)]
pub struct GivenForAll {
    /// The label.
    pub emotion: bool,
    /// Who is seen.
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

    /// What `segment` does with what it finds: the names that the table has afterwards, and what is said.
    fn again(table: &Path, segments: &[Segment]) -> (Vec<String>, Vec<String>) {
        let of = ManifestColumns { subject: "P1".to_owned(), emotion: UNLABELLED.to_owned(), frames: "talk".to_owned() };
        let row = |segment| SegmentRow { of: of.clone(), more: Vec::new(), fps: Some(25.0), segment };
        let mut rows: Vec<SegmentRow<'_>> = segments.iter().map(row).collect();
        let earlier = EarlierSegments::read(table).unwrap();
        let (said, proposed) = earlier.keep_in(&mut rows, GivenForAll { emotion: false, subject: false });
        write_segments(table, "segments", &[], &rows).unwrap();
        proposed.write(table).unwrap();
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
            assert!(said[0].starts_with("left out, since the rows were deleted"), "{said:?}");
            assert!(said[0].contains(": talk-03 (frames 90 to 70);"), "{said:?}");
        }
        // Cut with other options nothing is found, and a little later something nearby: it is the same.
        assert!(again(&table, &[]).0.is_empty());
        let mut moved = segments.clone();
        moved[2].neutral_frame += 2;
        assert_eq!(again(&table, &moved).0, ["talk-01", "talk-02", "talk-04"]);
        // What was not proposed is new, and without the table everything is.
        moved.push(Segment { name: "talk-05".to_owned(), neutral_frame: 200, apex_frame: 220, ..segments[0].clone() });
        assert_eq!(again(&table, &moved).0, ["talk-01", "talk-02", "talk-04", "talk-05"]);
        std::fs::remove_file(&table).unwrap();
        assert_eq!(again(&table, &segments).0.len(), 4);
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
