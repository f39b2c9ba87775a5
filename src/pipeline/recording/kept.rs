//! What a person wrote into an earlier table of segments, for the table that replaces it.

use std::path::Path;

use super::files::{SEGMENT_COLUMNS, SegmentRow};
use crate::{
    input::{CsvFile, InputError},
    output::count,
    text::composed,
};

/// The label of sequences that nobody has labelled.
pub const UNLABELLED: &str = "unlabelled";

/// A table of segments that is going to be replaced.
#[derive(Clone, Debug, Default)]
pub struct EarlierSegments {
    /// Columns that a person added.
    columns: Vec<String>,
    rows: Vec<EarlierRow>,
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
    /// [`InputError`] for a table of segments with a row that does not read.
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
        Ok(Self { columns: added.iter().map(|&k| csv.header()[k].clone()).collect(), rows })
    }

    /// Columns that a person added: those of [`SegmentRow::more`].
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Takes over what stands in the earlier table of the same frames of the same recording: labels where none is given for all now, subjects
    /// likewise, and the fields of columns that were added. What is to be said of it.
    pub fn keep_in(self, rows: &mut [SegmentRow<'_>], is_given: GivenForAll) -> Vec<String> {
        let (mut labels, mut other, mut moved) = (0, Vec::new(), Vec::new());
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
        said
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
