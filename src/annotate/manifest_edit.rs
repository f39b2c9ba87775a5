//! Sets single fields of a manifest and keeps all other bytes.
//!
//! Line ends, quotes, order, spaces and unknown columns stay. A missing column is added at the end of the header and of every row. The file
//! is replaced as a whole, atomically.

use std::{
    fs, io,
    ops::Range,
    path::{Path, PathBuf},
};

use crate::{
    dataset::{MANIFEST_COLUMNS, SequenceEntry},
    input::{CsvFile, InputError},
    output::{OutputError, write_durable},
    text::composed,
    units::SequenceId,
};

/// Why a manifest cannot be changed.
#[derive(Debug, thiserror::Error)]
pub enum ManifestEditError {
    /// The manifest cannot be parsed.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The manifest cannot be found or read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The manifest.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The manifest no longer lists the sequence.
    #[error("{}: sequence {id} is no longer listed; start grimace annotate again", path.display())]
    NoSuchRow {
        /// The manifest.
        path: PathBuf,
        /// The sequence.
        id: SequenceId,
    },
    /// The manifest cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Sets columns in one sequence's row.
///
/// # Errors
/// [`ManifestEditError`]; the file is then unchanged.
pub fn set_fields(path: &Path, id: &SequenceId, fields: &[(&str, String)]) -> Result<(), ManifestEditError> {
    // A link is kept: its target is replaced.
    let file = fs::canonicalize(path).map_err(|source| ManifestEditError::Io { path: path.to_owned(), source })?;
    let mut bytes = crate::input::read(&file).map_err(|source| ManifestEditError::Io { path: path.to_owned(), source })?;
    let before = bytes.clone();
    for (column, value) in fields {
        bytes = set_field(path, bytes, id, column, value)?;
    }
    if bytes != before {
        write_durable(&file, |writer| writer.write_all(&bytes))?;
    }
    Ok(())
}

fn set_field(path: &Path, bytes: Vec<u8>, id: &SequenceId, column: &str, value: &str) -> Result<Vec<u8>, ManifestEditError> {
    let csv = CsvFile::from_bytes(path, bytes.clone())?.or_semicolons(&MANIFEST_COLUMNS)?;
    let separator = csv.separator();
    let [subject, sequence] = csv.require(["subject", "sequence"])?;
    let is_row =
        |row: &crate::input::CsvRow<'_>| composed(row.get(subject)) == id.subject && composed(row.get(sequence)) == id.sequence;
    let line = csv.rows().flatten().find(is_row).map(|row| row.line());
    let line = line.ok_or_else(|| ManifestEditError::NoSuchRow { path: path.to_owned(), id: id.clone() })?;
    let place = csv.column(column);
    if place.is_none() && value.is_empty() {
        return Ok(bytes);
    }
    let columns = csv.header().len();
    let mut out = Vec::with_capacity(bytes.len() + 64);
    let mut header_seen = false;
    for (number, range) in rows(&bytes, csv.long_rows()) {
        let text = &bytes[range.clone()];
        let mut content = text.to_vec();
        let end = content.iter().rposition(|b| !matches!(b, b'\n' | b'\r')).map_or(0, |k| k + 1);
        let terminator = content.split_off(end);
        let shown = content.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&content);
        let blank = shown.iter().all(|b| b.is_ascii_whitespace() || *b == separator);
        if !blank && place.is_none() {
            let count = fields_of(&content, separator).len();
            if !header_seen {
                content.push(separator);
                content.extend_from_slice(column.as_bytes());
            } else if count <= columns {
                content.push(separator);
            }
        }
        header_seen |= !blank;
        if number == line {
            let place = place.unwrap_or(columns);
            if let Some(field) = fields_of(&content, separator).get(place) {
                content.splice(field.clone(), quoted(value, separator).into_bytes());
            }
        }
        out.extend(content);
        out.extend(terminator);
    }
    Ok(out)
}

/// Text of a manifest equivalent to a Cohn-Kanade layout: every sequence with its label, frames and landmarks.
pub fn manifest_text(root: &Path, entries: &[SequenceEntry]) -> String {
    let mut text = "subject,sequence,emotion,frames,first_frame,last_frame,correspondences,landmarks\n".to_owned();
    for entry in entries {
        let number = |n: Option<u32>| n.map(|n| n.to_string()).unwrap_or_default();
        let file = entry.default_correspondences_path.is_file().then(|| relative(root, &entry.default_correspondences_path));
        let fields = [
            entry.id.subject.clone(),
            entry.id.sequence.clone(),
            entry.emotion.clone(),
            relative(root, &entry.frames_path),
            number(entry.first_frame),
            number(entry.last_frame),
            file.unwrap_or_default(),
            entry.landmarks_paths.iter().find(|p| p.exists()).map(|p| relative(root, p)).unwrap_or_default(),
        ];
        text += &(fields.map(|f| quoted(&f, b',')).join(",") + "\n");
    }
    text
}

/// A path as written in the manifest in `root`, with `/` between folders.
pub fn relative(root: &Path, path: &Path) -> String {
    let joined =
        |parts: &[std::path::Component<'_>]| parts.iter().map(|c| c.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/");
    if let Ok(inside) = path.strip_prefix(root) {
        return joined(&inside.components().collect::<Vec<_>>());
    }
    let resolve = |p: &Path| {
        // The file itself may not exist yet.
        let resolved = fs::canonicalize(p);
        resolved.ok().or_else(|| Some(fs::canonicalize(p.parent()?).ok()?.join(p.file_name()?))).unwrap_or_else(|| p.to_owned())
    };
    let folder = if root.as_os_str().is_empty() { Path::new(".") } else { root };
    let (folder, path) = (resolve(folder), resolve(path));
    let common = folder.components().zip(path.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(common).map(|_| std::path::Component::ParentDir);
    joined(&up.chain(path.components().skip(common)).collect::<Vec<_>>())
}

fn quoted(value: &str, separator: u8) -> String {
    if value.contains(['"', char::from(separator), '\n', '\r']) {
        format!("\"{}\"", value.replace('"', "\"\""))
    } else {
        value.to_owned()
    }
}

/// Lines including their ends: LF, CRLF or CR, as in the reader.
fn lines(bytes: &[u8]) -> Vec<Range<usize>> {
    let mut ranges = Vec::new();
    let mut start = 0;
    while start < bytes.len() {
        let rest = &bytes[start..];
        let length = rest.iter().position(|b| matches!(b, b'\n' | b'\r')).unwrap_or(rest.len());
        let end = if rest[length..].starts_with(b"\r\n") { 2 } else { usize::from(length < rest.len()) };
        ranges.push(start..start + length + end);
        start += length + end;
    }
    ranges
}

/// Rows with the numbers of their first lines; the lines of each `long` row are joined.
fn rows(bytes: &[u8], long: impl Iterator<Item = Range<usize>>) -> Vec<(usize, Range<usize>)> {
    let mut long = long.peekable();
    let mut rows: Vec<(usize, Range<usize>)> = Vec::new();
    for (number, range) in (1..).zip(lines(bytes)) {
        while long.next_if(|row| row.end <= number).is_some() {}
        match rows.last_mut() {
            Some((_, row)) if long.peek().is_some_and(|lines| lines.start < number) => row.end = range.end,
            _ => rows.push((number, range)),
        }
    }
    rows
}

/// Ranges of the fields of a line, quotes included. A quotation mark opens a quoted field only at its start, as in the reader.
fn fields_of(content: &[u8], separator: u8) -> Vec<Range<usize>> {
    let mut fields = Vec::new();
    let (mut start, mut k) = (0, 0);
    let mut inside = content.first() == Some(&b'"');
    if inside {
        k = 1;
    }
    while k < content.len() {
        match content[k] {
            b'"' if inside && content.get(k + 1) == Some(&b'"') => k += 1,
            b'"' if inside => inside = false,
            byte if byte == separator && !inside => {
                fields.push(start..k);
                start = k + 1;
                if content.get(start) == Some(&b'"') {
                    inside = true;
                    k += 1;
                }
            }
            _ => {}
        }
        k += 1;
    }
    fields.push(start..content.len());
    fields
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn set(text: &str, fields: &[(&str, &str)]) -> Result<String, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("manifest.csv");
        fs::write(&path, text).unwrap();
        let fields: Vec<_> = fields.iter().map(|(c, v)| (*c, (*v).to_owned())).collect();
        let id = SequenceId { subject: "S1".into(), sequence: "2".into() };
        set_fields(&path, &id, &fields).map_err(|e| e.to_string())?;
        Ok(String::from_utf8(fs::read(&path).unwrap()).unwrap())
    }

    #[test]
    fn a_field_is_replaced_and_nothing_else() {
        let text =
            "subject , sequence,emotion,first_frame,note\r\nS1,1,joy,3,\"a, \"\"b\"\"\"\r\n\r\nS1, 2 ,joy,4,\"x,y\"\r\n,,,,\r\n";
        assert_eq!(set(text, &[("first_frame", "7")]).unwrap(), text.replace(",4,", ",7,"));
        assert_eq!(set(text, &[("note", "a,\"b")]).unwrap(), text.replace("\"x,y\"", "\"a,\"\"b\""));
        assert_eq!(set(text, &[("first_frame", "4")]).unwrap(), text);
    }

    #[test]
    fn a_column_is_added_to_every_row() {
        // No line end after the last line, a byte order mark, and a row padded by a spreadsheet.
        let text = "\u{feff}subject,sequence,emotion\nS1,1,joy\nS1,2,joy,,\nS1,3,joy";
        let expected = "\u{feff}subject,sequence,emotion,last_frame\nS1,1,joy,\nS1,2,joy,9,\nS1,3,joy,";
        assert_eq!(set(text, &[("last_frame", "9")]).unwrap(), expected);
        assert_eq!(set(text, &[("last_frame", "")]).unwrap(), text);
        let both = set("subject,sequence,emotion\nS1,2,joy\n", &[("first_frame", "1"), ("last_frame", "9")]).unwrap();
        assert_eq!(both, "subject,sequence,emotion,first_frame,last_frame\nS1,2,joy,1,9\n");
    }

    #[test]
    fn rows_over_several_lines_stay_whole() {
        let text = "subject,sequence,emotion,note\nS1,1,joy,\"a,\nb\"\nS1,2,joy,\"c\r\n\r\nd\"\nS1,3,joy,\n";
        let expected = "subject,sequence,emotion,note,fps\nS1,1,joy,\"a,\nb\",\nS1,2,joy,\"c\r\n\r\nd\",25\nS1,3,joy,,\n";
        assert_eq!(set(text, &[("fps", "25")]).unwrap(), expected);
        assert_eq!(set(text, &[("note", "x")]).unwrap(), text.replace("\"c\r\n\r\nd\"", "x"));
    }

    #[test]
    fn names_with_accents_behind_their_letters_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("manifest.csv");
        fs::write(&path, "subject,sequence,emotion\nAndre\u{301},1,joy\n").unwrap();
        let id = SequenceId { subject: "Andr\u{e9}".into(), sequence: "1".into() };
        set_fields(&path, &id, &[("last_frame", "9".to_owned())]).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "subject,sequence,emotion,last_frame\nAndre\u{301},1,joy,9\n");
    }

    #[test]
    fn semicolons_stay_between_the_fields() {
        let text = "\u{feff}subject;sequence;emotion;note\r\nS1;1;joy;a, b\r\nS1;2;joy;\"c; d\"\r\n;;;\r\n";
        let expected = "\u{feff}subject;sequence;emotion;note;fps\r\nS1;1;joy;a, b;\r\nS1;2;joy;\"c; d\";25\r\n;;;\r\n";
        assert_eq!(set(text, &[("fps", "25")]).unwrap(), expected);
        assert_eq!(set(text, &[("note", "e, f;")]).unwrap(), text.replace("\"c; d\"", "\"e, f;\""));
    }

    #[test]
    fn a_missing_row_is_reported() {
        let error = set("subject,sequence,emotion\nS1,1,joy\n", &[("last_frame", "9")]).unwrap_err();
        assert!(error.contains("sequence S1_2 is no longer listed"), "{error}");
    }

    #[test]
    fn paths_are_relative_to_the_manifest() {
        let folder = tempfile::tempdir().unwrap();
        let (images, landmarks) = (folder.path().join("images/S1"), folder.path().join("Landmarks"));
        fs::create_dir_all(&images).unwrap();
        fs::create_dir_all(&landmarks).unwrap();
        assert_eq!(relative(folder.path(), &images.join("marks.csv")), "images/S1/marks.csv");
        assert_eq!(relative(&folder.path().join("images"), &landmarks), "../Landmarks");
        // A folder that is a link keeps the name that the user knows.
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(&landmarks, folder.path().join("link")).unwrap();
            assert_eq!(relative(folder.path(), &folder.path().join("link/marks.csv")), "link/marks.csv");
        }
    }

    proptest! {
        #[test]
        fn set_fields_can_be_read_and_others_are_unchanged(value in "[ -~]{0,12}", other in "[ -~]{0,12}") {
            // Reading trims a field; a single quotation mark inside is text.
            let (value, other) = (value.trim(), other.trim());
            // A leading apostrophe prevents a spreadsheet from reading a text as a formula; reading removes it.
            prop_assume!(!value.starts_with('\'') && !other.starts_with('\''));
            let text = format!("subject,sequence,emotion,a,b\nS1,2,joy,{},{}\n", quoted("old", b','), quoted(other, b','));
            let new = set(&text, &[("a", value)]).unwrap();
            let csv = CsvFile::from_bytes(Path::new("m"), new.into_bytes()).unwrap();
            let row = csv.rows().next().unwrap().unwrap();
            prop_assert_eq!(row.get(3), value);
            prop_assert_eq!(row.get(4), other);
        }
    }
}
