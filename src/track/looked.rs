//! What a person found when looking at tracks, kept apart from computed results: `looked_at.csv` beside the folder `tracks`.
//!
//! One row for every sequence that was looked at: `id,look,content`. `look` is `right` or `leave out`. `content` identifies the pictures and
//! the track that were looked at, so that a look does not count for others. The page of `annotate` writes it; in rows written by hand it may
//! be empty until `run` fills it in. Further columns are kept. The program never removes the file.

use std::{
    collections::BTreeMap,
    fmt, io,
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};

use super::TrackInfo;
use crate::{
    formula::FormulaGuard,
    input::{CsvFile, InputError, InputErrorKind},
    output::{OutputError, write_durable},
    units::SequenceId,
};

/// Name of the file, in the folder of the results.
pub(crate) const LOOKED_AT: &str = "looked_at.csv";

/// Columns of the file.
const COLUMNS: [&str; 3] = ["id", "look", "content"];

/// Words that `look` may have, for errors.
const WORDS: &str = "`right`, `leave out` or nothing";

/// What a person found when looking at a tracked sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Look {
    /// It is tracked well enough to count.
    Right,
    /// It does not count in the statistics.
    LeaveOut,
    /// It was looked at, but its pictures or its track have changed since.
    Outdated,
}

impl Look {
    /// The word for it in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::LeaveOut => "leave out",
            Self::Outdated => "outdated",
        }
    }
}

/// Why `looked_at.csv` cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LooksError {
    /// It cannot be read, or a row is not valid.
    #[error(transparent)]
    Input(#[from] InputError),
    /// Two rows of one sequence.
    #[error("{}, line {line}: {id} stands in line {before} already; keep one of the two rows", path.display())]
    Twice {
        /// The file.
        path: PathBuf,
        /// Line of the second row.
        line: usize,
        /// Line of the first.
        before: usize,
        /// The sequence.
        id: String,
    },
}

/// One look that counts as long as the content is the same.
#[derive(Clone, Debug, PartialEq)]
struct Row {
    /// Index of its fields in the file.
    place: usize,
    look: Look,
    /// Empty if it is not known yet.
    content: String,
}

/// The rows of `looked_at.csv`.
#[derive(Clone, Debug)]
pub(crate) struct Looks {
    path: PathBuf,
    separator: u8,
    header: Vec<String>,
    /// All fields, as they are written back.
    fields: Vec<Vec<String>>,
    /// By id.
    rows: BTreeMap<String, Row>,
}

impl Looks {
    /// Reads the file in a folder of results; without it there are no looks.
    ///
    /// # Errors
    /// [`LooksError`] with the line.
    pub fn read(out: &Path) -> Result<Self, LooksError> {
        let path = out.join(LOOKED_AT);
        let bytes = match crate::input::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                let header = COLUMNS.map(str::to_owned).into();
                return Ok(Self { path, separator: b',', header, fields: Vec::new(), rows: BTreeMap::new() });
            }
            Err(source) => return Err(InputError { path, line: None, kind: InputErrorKind::Io(source) }.into()),
        };
        let csv = CsvFile::from_bytes(&path, bytes)?.or_semicolons(&COLUMNS)?;
        let [id, look] = csv.require(["id", "look"])?;
        let content = csv.column("content");
        let mut header = csv.header().to_vec();
        if content.is_none() {
            header.push("content".to_owned());
        }
        let (mut fields, mut rows, mut lines) = (Vec::new(), BTreeMap::new(), BTreeMap::new());
        for row in csv.rows() {
            let row = row?;
            let name = row.get(id).to_owned();
            if let Some(&before) = lines.get(&name) {
                return Err(LooksError::Twice { path, line: row.line(), before, id: name });
            }
            let said = row.get(look).to_lowercase().replace(['_', '-'], " ");
            let found = match said.as_str() {
                "right" => Some(Look::Right),
                "leave out" => Some(Look::LeaveOut),
                // So that a copy of verdicts.csv is accepted.
                "" | "outdated" => None,
                _ => return Err(row.field_error(look, WORDS).into()),
            };
            if let Some(found) = found {
                let content = content.map_or("", |column| row.get(column)).to_owned();
                rows.insert(name.clone(), Row { place: fields.len(), look: found, content });
            }
            lines.insert(name, row.line());
            let all = (0..csv.header().len()).map(|k| row.get(k).to_owned());
            fields.push(all.chain(content.is_none().then(String::new)).collect());
        }
        Ok(Self { path, separator: csv.separator(), header, fields, rows })
    }

    /// The look at a sequence with this content, if there is one. A row without content is about any.
    pub fn of(&self, id: &SequenceId, content: &str) -> Option<Look> {
        let row = self.rows.get(&id.to_string())?;
        Some(if row.content.is_empty() || row.content == content { row.look } else { Look::Outdated })
    }

    /// Ids of all rows with a look, sorted.
    pub fn ids(&self) -> impl Iterator<Item = &String> {
        self.rows.keys()
    }

    /// BLAKE3 of all looks with their content; `None` without any.
    pub fn blake3(&self) -> Option<String> {
        let mut hasher = blake3::Hasher::new();
        for (id, Row { look, content, .. }) in &self.rows {
            for part in [id, look.name(), content] {
                hasher.update(&(part.len() as u64).to_le_bytes()).update(part.as_bytes());
            }
        }
        (!self.rows.is_empty()).then(|| hasher.finalize().to_hex().to_string())
    }

    /// Fills in the content of rows that have none, by id. Returns whether any was filled in.
    pub fn fill_in(&mut self, content_of: impl Fn(&str) -> Option<String>) -> bool {
        let column = self.column("content");
        let mut filled = false;
        for (id, row) in self.rows.iter_mut().filter(|(_, row)| row.content.is_empty()) {
            let Some(content) = content_of(id) else { continue };
            row.content.clone_from(&content);
            set(&mut self.fields, row.place, column, content);
            filled = true;
        }
        filled
    }

    /// Sets the look at a sequence, or removes it with `None`.
    pub fn set(&mut self, id: &str, look: Option<Look>, content: &str) {
        let [of_id, of_look, of_content] = COLUMNS.map(|name| self.column(name));
        let place = self.fields.iter().position(|fields| fields.get(of_id).is_some_and(|found| found == id));
        let Some(look) = look else {
            self.rows.remove(id);
            // Further columns may have notes.
            place.into_iter().for_each(|place| set(&mut self.fields, place, of_look, String::new()));
            return;
        };
        let place = place.unwrap_or_else(|| {
            self.fields.push(vec![String::new(); self.header.len()]);
            self.fields.len() - 1
        });
        for (column, text) in [(of_id, id), (of_look, look.name()), (of_content, content)] {
            set(&mut self.fields, place, column, text.to_owned());
        }
        self.rows.insert(id.to_owned(), Row { place, look, content: content.to_owned() });
    }

    /// Writes the file; it is on the disk when this returns.
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn write(&self) -> Result<(), OutputError> {
        let written = write_durable(&self.path, |out| {
            let mut csv = csv::WriterBuilder::new();
            let mut csv = csv.delimiter(self.separator).from_writer(FormulaGuard::new(out));
            csv.write_record(&self.header).map_err(io::Error::from)?;
            for fields in &self.fields {
                csv.write_record(fields).map_err(io::Error::from)?;
            }
            csv.flush()
        });
        written.map(|_| ())
    }

    /// Index of one of our columns, which always exist.
    fn column(&self, name: &str) -> usize {
        self.header.iter().position(|found| found == name).unwrap_or_default()
    }
}

fn set(fields: &mut [Vec<String>], place: usize, column: usize, text: String) {
    if let Some(field) = fields.get_mut(place).and_then(|fields| fields.get_mut(column)) {
        *field = text;
    }
}

/// Identifies what a person sees of a track: its pictures and the places of its nodes. `csv_blake3` is the BLAKE3 of the track's `.csv`.
/// It begins with letters, so that no spreadsheet takes it for a number.
pub(crate) fn content_of(info: Option<&TrackInfo>, csv_blake3: &str) -> String {
    let pictures = info.and_then(|info| info.frames_blake3.as_deref()).unwrap_or_default();
    let hash = blake3::hash(format!("{pictures}\n{csv_blake3}").as_bytes());
    format!("b3-{}", &hash.to_hex()[..16])
}

impl fmt::Display for Look {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn id(text: &str) -> SequenceId {
        let (subject, sequence) = text.split_once('_').unwrap();
        SequenceId { subject: subject.to_owned(), sequence: sequence.to_owned() }
    }

    fn read(text: &str) -> (tempfile::TempDir, Result<Looks, String>) {
        let out = tempfile::tempdir().unwrap();
        fs::write(out.path().join(LOOKED_AT), text).unwrap();
        let looks = Looks::read(out.path()).map_err(|e| e.to_string());
        (out, looks)
    }

    #[test]
    fn a_look_counts_for_the_content_that_was_looked_at() {
        let (_out, looks) = read("id,look,content\nA_1,right,b3-1\nB_1,Leave-out,b3-2\nC_1,,b3-3\nD_1,outdated,b3-4\n");
        let looks = looks.unwrap();
        let of = |name: &str, content: &str| looks.of(&id(name), content);
        assert_eq!([of("A_1", "b3-1"), of("A_1", "b3-9")], [Some(Look::Right), Some(Look::Outdated)]);
        assert_eq!(
            [of("B_1", "b3-2"), of("C_1", "b3-3"), of("D_1", "b3-4"), of("E_1", "")],
            [Some(Look::LeaveOut), None, None, None]
        );
        assert!(Looks::read(Path::new("nowhere")).unwrap().blake3().is_none());
    }

    #[test]
    fn content_is_filled_in_once_and_other_columns_stay() {
        let (out, looks) = read("note;id;look\n\"a; b\";A_1;right\n;B_1;leave out\n");
        let mut looks = looks.unwrap();
        let before = looks.blake3();
        assert!(looks.fill_in(|id| (id == "A_1").then(|| "b3-1".to_owned())));
        assert!(!looks.fill_in(|id| (id == "A_1").then(|| "b3-2".to_owned())));
        assert_ne!(looks.blake3(), before);
        looks.write().unwrap();
        let text = fs::read_to_string(out.path().join(LOOKED_AT)).unwrap();
        assert_eq!(text, "note;id;look;content\n\"a; b\";A_1;right;b3-1\n;B_1;leave out;\n");
        assert_eq!(Looks::read(out.path()).unwrap().blake3(), looks.blake3());
    }

    #[test]
    fn a_look_is_set_changed_and_taken_back() {
        let out = tempfile::tempdir().unwrap();
        let mut looks = Looks::read(out.path()).unwrap();
        looks.set("A_1", Some(Look::Right), "b3-1");
        looks.set("B_1", Some(Look::LeaveOut), "b3-2");
        looks.set("A_1", Some(Look::LeaveOut), "b3-3");
        looks.set("B_1", None, "");
        looks.write().unwrap();
        let text = fs::read_to_string(out.path().join(LOOKED_AT)).unwrap();
        assert_eq!(text, "id,look,content\nA_1,leave out,b3-3\nB_1,,b3-2\n");
        assert_eq!(Looks::read(out.path()).unwrap().ids().collect::<Vec<_>>(), ["A_1"]);
    }

    #[test]
    fn wrong_rows_are_named_with_their_line() {
        let said = |text: &str| read(text).1.unwrap_err();
        assert!(
            said("id,look\nA_1,maybe\n")
                .ends_with("looked_at.csv, line 2: look is `maybe`; `right`, `leave out` or nothing was expected")
        );
        assert!(
            said("id,look\nA_1,right\nA_1,right\n")
                .ends_with("looked_at.csv, line 3: A_1 stands in line 2 already; keep one of the two rows")
        );
        assert!(said("id,verdict\nA_1,good\n").contains("has no column `look`"));
    }
}
