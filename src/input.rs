//! Reads CSV files in the forms that users have: with a byte order mark, CRLF, quotes, trailing commas, or a line that is not UTF-8.
//!
//! One line is one row, and a quoted field may contain commas, doubled quotes and line breaks. Several lines form one row only if they give
//! as many fields as the header, so that an unclosed quote invalidates its own row and not all following rows. Blank lines and rows of
//! empty fields are skipped.
//!
//! Fields are separated by commas. Files that people fill in may have semicolons instead, as spreadsheets write them in languages with
//! decimal commas: see [`CsvFile::or_semicolons`].

mod encoding;
mod error;
mod fields;
mod open;
mod record;

use std::{
    borrow::Cow,
    ops::Range,
    path::{Path, PathBuf},
    sync::OnceLock,
};

use fields::{Ends, Lines, end_of_fields, is_blank, split_fields};

use crate::{formula::without_apostrophe, text::excerpt};

pub use error::{InputError, InputErrorKind};
pub use open::{MAX_BYTES, file_blake3, is_stdin, open_file, open_or_stdin, read, read_or_stdin};
pub use record::{RecordError, read_record, record_at};

/// First bytes of files that users mistake for tables, with a description.
const KINDS: [(&[u8], &str); 11] = [
    (b"\xFF\xD8\xFF", "JPEG picture"),
    (b"\x89PNG", "PNG picture"),
    (b"GIF8", "GIF picture"),
    (b"II*\0", "TIFF picture"),
    (b"MM\0*", "TIFF picture"),
    (b"PK\x03\x04", "ZIP archive or a spreadsheet's own file"),
    (b"%PDF", "PDF document"),
    (b"PAR1", "Parquet file"),
    (b"\x1F\x8B", "compressed file"),
    (b"\xFF\xFE", UTF_16),
    (b"\xFE\xFF", UTF_16),
];

/// What `Unicode Text` of spreadsheets is.
const UTF_16: &str = "text in UTF-16 (in a spreadsheet, save it as CSV in UTF-8)";

/// Most lines in a row.
const MOST_LINES: usize = 100;

/// A CSV file in memory with its header read.
#[derive(Clone, Debug)]
pub struct CsvFile {
    path: PathBuf,
    bytes: Vec<u8>,
    /// Field separator: a comma or a semicolon.
    separator: u8,
    header: Vec<String>,
    /// Line of the header, from 1.
    header_line: usize,
    /// Offset and line number of the first line after the header.
    body: (usize, usize),
    /// Whether bytes that are not UTF-8 look like Windows-1252; computed on demand.
    windows_1252: OnceLock<bool>,
}

/// One row of a [`CsvFile`], with as many fields as the header has columns.
#[derive(Clone, Debug)]
pub struct CsvRow<'a> {
    file: &'a CsvFile,
    line: usize,
    fields: Vec<Cow<'a, str>>,
}

impl CsvFile {
    /// Reads a file, or standard input for the path `-`, and its header.
    ///
    /// # Errors
    /// [`InputError`] when the file cannot be read, is empty, or has a header that is not UTF-8 or names a column twice.
    pub fn open(path: &Path) -> Result<Self, InputError> {
        let bytes = read_or_stdin(path).map_err(|e| InputError { path: path.to_owned(), line: None, kind: e.into() })?;
        Self::from_bytes(path, bytes)
    }

    /// As [`CsvFile::open`] for content in memory; `path` is used in errors only.
    ///
    /// # Errors
    /// As [`CsvFile::open`].
    pub fn from_bytes(path: &Path, bytes: Vec<u8>) -> Result<Self, InputError> {
        let error = |line, kind| InputError { path: path.to_owned(), line, kind };
        if let Some((_, what)) = KINDS.iter().find(|(start, _)| bytes.starts_with(start)) {
            return Err(error(None, InputErrorKind::NotText { what }));
        }
        let mut lines = lines_of(&bytes);
        let (line, text) =
            lines.by_ref().find(|(_, text)| may_be_header(text)).ok_or_else(|| error(None, InputErrorKind::Empty))?;
        let header =
            names(text, b',').map_err(|kind| error(Some(line), with_encoding(kind, || encoding::is_windows_1252(&bytes))))?;
        let body = (lines.offset, lines.line);
        let file = Self {
            path: path.to_owned(),
            bytes,
            separator: b',',
            header,
            header_line: line,
            body,
            windows_1252: OnceLock::new(),
        };
        file.check_names()?;
        Ok(file)
    }

    /// Returns the file with semicolons as separators and optional decimal commas, if its header then has more of these columns.
    ///
    /// # Errors
    /// [`InputError`] for a header that names a column twice.
    pub fn or_semicolons(self, columns: &[&str]) -> Result<Self, InputError> {
        let known =
            |header: &[String]| columns.iter().filter(|name| header.iter().any(|found| found.eq_ignore_ascii_case(name))).count();
        let text = lines_of(&self.bytes).find(|(_, text)| may_be_header(text)).map(|(_, text)| text).unwrap_or_default();
        match names(text, b';') {
            Ok(header) if known(&header) > known(&self.header) => {
                let file = Self { separator: b';', header, ..self };
                file.check_names()?;
                Ok(file)
            }
            _ => Ok(self),
        }
    }

    /// Checks that column names are unique.
    fn check_names(&self) -> Result<(), InputError> {
        let mut named = self.header.iter().enumerate().filter(|(_, name)| !name.is_empty());
        named.find(|(k, name)| self.header[..*k].contains(name)).map_or(Ok(()), |(_, name)| {
            let kind = InputErrorKind::DuplicateColumn { name: excerpt(name) };
            Err(InputError { path: self.path.clone(), line: Some(self.header_line), kind })
        })
    }

    /// The file's path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Field separator in ASCII: a comma or a semicolon.
    #[must_use]
    pub fn separator(&self) -> u8 {
        self.separator
    }

    /// Column names in order, trimmed. Unnamed columns are empty strings.
    #[must_use]
    pub fn header(&self) -> &[String] {
        &self.header
    }

    /// Index of a column, or `None`.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<usize> {
        self.header.iter().position(|n| n == name)
    }

    /// Index of a column regardless of case; an exact match has precedence.
    #[must_use]
    pub fn column_of_any_case(&self, name: &str) -> Option<usize> {
        self.column(name).or_else(|| self.header.iter().position(|n| n.eq_ignore_ascii_case(name)))
    }

    /// Indices of required columns.
    ///
    /// # Errors
    /// [`InputErrorKind::MissingColumns`] with all missing and all existing names.
    pub fn require<const K: usize>(&self, names: [&str; K]) -> Result<[usize; K], InputError> {
        let missing: Vec<String> = names.iter().filter(|n| self.column(n).is_none()).map(|&n| n.to_owned()).collect();
        if missing.is_empty() {
            return Ok(names.map(|n| self.column(n).unwrap_or_default()));
        }
        let found = self.header.iter().filter(|n| !n.is_empty()).cloned().collect();
        Err(InputError {
            path: self.path.clone(),
            line: Some(self.header_line),
            kind: InputErrorKind::MissingColumns { missing, found },
        })
    }

    /// All rows in order. An invalid row is an error item and does not end the iteration.
    pub fn rows(&self) -> impl Iterator<Item = Result<CsvRow<'_>, InputError>> {
        self.records().filter_map(|(lines, text)| self.row(lines.start, text).transpose())
    }

    /// As [`CsvFile::rows`], with the readable fields of an invalid row.
    pub fn rows_or_fields(&self) -> impl Iterator<Item = Result<CsvRow<'_>, (InputError, Vec<String>)>> {
        let fields = |text: &[u8]| -> Vec<String> {
            // Invalid UTF-8 is replaced by marks; the text around it identifies the row.
            let text = String::from_utf8_lossy(text);
            let fields = split_fields(text.as_bytes(), self.separator).unwrap_or_default();
            fields.iter().map(|field| without_apostrophe(field.trim()).to_owned()).collect()
        };
        self.records()
            .filter_map(move |(lines, text)| self.row(lines.start, text).map_err(|error| (error, fields(text))).transpose())
    }

    /// Line ranges of all rows that span several lines, end excluded.
    pub fn long_rows(&self) -> impl Iterator<Item = Range<usize>> {
        self.records().map(|(lines, _)| lines).filter(|lines| lines.len() > 1)
    }

    /// Lines and text of every non-blank row.
    fn records(&self) -> impl Iterator<Item = (Range<usize>, &[u8])> {
        let (offset, line) = self.body;
        let mut lines = Lines { bytes: &self.bytes, offset, line };
        std::iter::from_fn(move || {
            loop {
                let start = lines.offset;
                let (line, text) = lines.next()?;
                if !is_blank(text) {
                    let text = self.joined(&mut lines, (start, line), text);
                    return Some((line..lines.line, text));
                }
            }
        })
    }

    /// A line together with the following lines up to the end of its open field, if they form a valid row.
    fn joined<'a>(&'a self, lines: &mut Lines<'a>, (start, line): (usize, usize), text: &'a [u8]) -> &'a [u8] {
        if !text.contains(&b'"') || end_of_fields(text, self.separator) != Ends::Open {
            return text;
        }
        let mut ahead = lines.clone();
        for _ in 1..MOST_LINES {
            let from = ahead.offset;
            let Some((_, next)) = ahead.next() else { break };
            let all = self.bytes.get(start..from + next.len()).unwrap_or(text);
            match end_of_fields(all, self.separator) {
                Ends::Open => {}
                Ends::Closed if self.row(line, all).is_ok_and(|row| row.is_some()) => {
                    *lines = ahead;
                    return all;
                }
                _ => break,
            }
        }
        text
    }

    /// Parses a row; `None` if all its fields are empty.
    fn row<'a>(&'a self, line: usize, text: &'a [u8]) -> Result<Option<CsvRow<'a>>, InputError> {
        let error = |kind| InputError { path: self.path.clone(), line: Some(line), kind };
        let looks_like = || *self.windows_1252.get_or_init(|| encoding::is_windows_1252(&self.bytes));
        let mut fields = split_fields(text, self.separator).map_err(|kind| error(with_encoding(kind, looks_like)))?;
        if fields.iter().all(|f| f.trim().is_empty()) {
            return Ok(None);
        }
        let expected = self.header.len();
        // Spreadsheets pad rows with empty fields.
        while fields.len() > expected && fields.last().is_some_and(|f| f.trim().is_empty()) {
            fields.pop();
        }
        if fields.len() != expected {
            return Err(error(InputErrorKind::FieldCount { expected, found: fields.len() }));
        }
        Ok(Some(CsvRow { file: self, line, fields }))
    }
}

impl CsvRow<'_> {
    /// Line in the file, from 1.
    #[must_use]
    pub fn line(&self) -> usize {
        self.line
    }

    /// A field without surrounding white space, and without the apostrophe that protects it from being a formula in our own files; empty
    /// for a column that does not exist.
    #[must_use]
    pub fn get(&self, column: usize) -> &str {
        self.fields.get(column).map_or("", |f| without_apostrophe(f.trim()))
    }

    /// A field as a finite number.
    ///
    /// # Errors
    /// [`InputErrorKind::Field`] for a text that is not a number, NaN or infinite.
    pub fn number(&self, column: usize) -> Result<f64, InputError> {
        let text = self.get(column);
        // With semicolons as separators, one comma is a decimal comma; a text with a point as well is not a number.
        let text = if self.file.separator == b';' { Cow::Owned(text.replacen(',', ".", 1)) } else { Cow::Borrowed(text) };
        let number = text.parse::<f64>().ok().filter(|v| v.is_finite());
        number.ok_or_else(|| self.field_error(column, "a finite number"))
    }

    /// A field as a whole number of 0 or more, such as a frame number; `12.0` is 12, as tables with gaps are often written.
    ///
    /// # Errors
    /// [`InputErrorKind::Field`] for anything else.
    pub fn whole_number(&self, column: usize) -> Result<u32, InputError> {
        let text = self.get(column);
        let whole = text.split_once('.').filter(|(_, rest)| !rest.is_empty() && rest.bytes().all(|b| b == b'0'));
        let digits = whole.map_or(text, |(whole, _)| whole);
        digits.parse().map_err(|_| self.field_error(column, "a whole number of 0 or more"))
    }

    /// An error with this row's line, the column, and its content.
    #[must_use]
    pub fn field_error(&self, column: usize, expected: &'static str) -> InputError {
        let name = self.file.header.get(column).map(|name| excerpt(name)).unwrap_or_default();
        let kind = InputErrorKind::Field { column: name, found: excerpt(self.get(column)), expected };
        InputError { path: self.file.path.clone(), line: Some(self.line), kind }
    }
}

/// Whether a line is neither blank nor the line `sep=;` with which spreadsheets begin files for others of their kind.
fn may_be_header(line: &[u8]) -> bool {
    !is_blank(line) && ![&b"sep=;"[..], b"sep=,"].contains(&line.trim_ascii())
}

/// Lines after the byte order mark.
fn lines_of(bytes: &[u8]) -> Lines<'_> {
    let mark: &[u8] = b"\xEF\xBB\xBF";
    Lines { bytes, offset: if bytes.starts_with(mark) { mark.len() } else { 0 }, line: 1 }
}

/// The names in a header line.
fn names(text: &[u8], separator: u8) -> Result<Vec<String>, InputErrorKind> {
    Ok(split_fields(text, separator)?.iter().map(|f| without_apostrophe(f.trim()).to_owned()).collect())
}

/// An error of a line, with information about the encoding of the whole file.
fn with_encoding(kind: InputErrorKind, looks_like_windows_1252: impl FnOnce() -> bool) -> InputErrorKind {
    match kind {
        InputErrorKind::NotUtf8 { byte, .. } => InputErrorKind::NotUtf8 { byte, windows_1252: looks_like_windows_1252() },
        other => other,
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp, clippy::unnecessary_wraps)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn file(bytes: &[u8]) -> Result<CsvFile, InputError> {
        CsvFile::from_bytes(Path::new("a.csv"), bytes.to_vec())
    }

    fn texts(bytes: &[u8]) -> Vec<Result<(usize, Vec<String>), String>> {
        let file = file(bytes).unwrap();
        let row = |r: CsvRow| (r.line(), (0..file.header().len()).map(|k| r.get(k).to_owned()).collect());
        file.rows().map(|r| r.map(row).map_err(|e| e.to_string())).collect()
    }

    fn row(line: usize, fields: &[&str]) -> Result<(usize, Vec<String>), String> {
        Ok((line, fields.iter().map(|&f| f.to_owned()).collect()))
    }

    #[test]
    fn byte_order_mark_line_ends_quotes_and_padding_are_read() {
        let text = b"\xEF\xBB\xBFa, b\r\n1,\"x, \"\"y\"\"\"\r\n\r\n 2 ,z,,\r,\n3,w";
        assert_eq!(file(text).unwrap().header(), ["a", "b"]);
        // Line 3 is blank; line 5 has empty fields only.
        assert_eq!(texts(text), [row(2, &["1", "x, \"y\""]), row(4, &["2", "z"]), row(6, &["3", "w"])]);
    }

    #[test]
    fn a_bad_row_fails_only_itself() {
        let rows = texts(b"a,b\n1\n\"2,3\n\xE9,4\n5,6\n");
        assert_eq!(rows[0], Err("a.csv, line 2: the row has 1 fields, but the header has 2".to_owned()));
        assert!(rows[1].as_ref().unwrap_err().starts_with("a.csv, line 3: a quotation mark is not closed"));
        assert!(rows[2].as_ref().unwrap_err().starts_with("a.csv, line 4: byte 1 of the line is not UTF-8"));
        assert_eq!(rows[3], row(5, &["5", "6"]));
        assert_eq!(texts(b"a,b\n5\",x\n\"y\"z\",\"\"\n"), [row(2, &["5\"", "x"]), row(3, &["yz\"", ""])]);
    }

    #[test]
    fn a_spreadsheet_file_that_is_not_utf_8_is_refused_with_advice() {
        let rows = texts(b"a,b\nRen\xE9,4\n5,6\nM\xFCller,7\n");
        let said = "not UTF-8; the file looks like Windows-1252 (Latin-1): save it as UTF-8 text, or convert it (iconv -f WINDOWS-1252 \
             -t UTF-8 OLD.csv > NEW.csv) and check the names";
        assert_eq!(rows[0], Err(format!("a.csv, line 2: byte 4 of the line is {said}")));
        assert_eq!((&rows[1], rows[2].is_err()), (&row(3, &["5", "6"]), true));
        assert!(file(b"pr\xE9nom,b\n1,2\n").unwrap_err().to_string().contains(said));
        // One byte in the file that is not a letter in Windows-1252.
        assert!(!texts(b"a,b\nRen\xE9,4\n\xA4,7\n")[0].as_ref().unwrap_err().contains("Windows"));
    }

    #[test]
    fn a_row_may_run_over_lines() {
        let text = b"a,b\n1,\"x\ny, \"\"z\"\"\r\n\r\nw\"\n\"2\n\",v\n3,u\n";
        assert_eq!(texts(text), [row(2, &["1", "x\ny, \"z\"\r\n\r\nw"]), row(6, &["2", "v"]), row(8, &["3", "u"])]);
        // An unclosed quote invalidates its own row, whatever quotes follow.
        let rows = texts(b"a,b\n1,\"x\n2,\"y\"\n3,z\n\"4,\"\n5,w\n");
        assert!(rows[0].as_ref().unwrap_err().ends_with("line 2: a quotation mark is not closed"));
        assert_eq!(rows[1..3], [row(3, &["2", "y"]), row(4, &["3", "z"])]);
        assert_eq!(rows[4], row(6, &["5", "w"]));
    }

    #[test]
    fn columns_are_asked_for_by_name() {
        let file = file(b"node;x;y\n").unwrap();
        let error = file.require(["node", "x"]).unwrap_err().to_string();
        assert_eq!(
            error,
            "a.csv, line 1: has no column `node`, `x`; found `node;x;y` (columns are separated by commas; save it as CSV UTF-8, separated by commas)"
        );
        assert!(super::tests::file(b"a,b,a\n").unwrap_err().to_string().contains("column `a` twice"));
        assert!(super::tests::file(b"\n \n").unwrap_err().to_string().contains("is empty"));
        assert!(super::tests::file(b"a,b,,\n").is_ok(), "columns without a name do not collide");
        assert_eq!(
            super::tests::file(b"\xFF\xD8\xFF\xE0").unwrap_err().to_string(),
            "a.csv: is a JPEG picture; a table in CSV was expected"
        );
    }

    const MARKS: [&str; 3] = ["node", "x", "y"];

    #[test]
    fn semicolons_separate_where_the_header_says_so() {
        let text = b"\xEF\xBB\xBFnode;x;\"y\";note\r\n10;1,5;-2,25;\"a; b, \"\"c\"\"\"\r\n;;;\r\n20;3.5;1e3;\"d\n\ne\";;\r\n";
        let semicolons = file(text).unwrap().or_semicolons(&MARKS).unwrap();
        assert_eq!(
            (semicolons.separator(), semicolons.header()),
            (b';', ["node", "x", "y", "note"].map(str::to_owned).as_slice())
        );
        let rows: Vec<CsvRow> = semicolons.rows().map(Result::unwrap).collect();
        assert_eq!(rows.iter().map(CsvRow::line).collect::<Vec<_>>(), [2, 4]);
        assert_eq!((rows[0].number(1).unwrap(), rows[0].number(2).unwrap(), rows[0].get(3)), (1.5, -2.25, "a; b, \"c\""));
        assert_eq!((rows[1].number(1).unwrap(), rows[1].number(2).unwrap(), rows[1].get(3)), (3.5, 1000.0, "d\n\ne"));
        // Spreadsheets name the separator in a line of its own.
        let told = file(b"sep=;\r\nnode;x;y\r\n10;1,5;2\r\n").unwrap().or_semicolons(&MARKS).unwrap();
        let row = told.rows().next().unwrap().unwrap();
        assert_eq!((told.separator(), row.line(), row.number(1).unwrap()), (b';', 3, 1.5));
        let error = file(b"\xFF\xFEn\0o\0d\0e\0").unwrap_err().to_string();
        assert!(error.contains("a.csv: is a text in UTF-16") && error.ends_with("a table in CSV was expected"), "{error}");
        // A file with the columns by commas is separated by commas, whatever else it contains.
        let commas = file(b"node,x,y,a;node;x;y\n1,2,3,4;5\n").unwrap().or_semicolons(&MARKS).unwrap();
        assert_eq!((commas.separator(), commas.rows().next().unwrap().unwrap().get(3)), (b',', "4;5"));
        assert_eq!(file(b"a;b\n1;2\n").unwrap().or_semicolons(&MARKS).unwrap().separator(), b',');
    }

    #[test]
    fn what_is_wrong_between_semicolons_is_named() {
        let open = |text: &[u8]| file(text).unwrap().or_semicolons(&MARKS);
        let row = |text: &str| {
            let file = open(format!("node;x;y\n{text}\n").as_bytes()).unwrap();
            let row = file.rows().next().unwrap();
            row.and_then(|row| row.number(1)).unwrap_err().to_string()
        };
        assert_eq!(row("1;1.234,5;2"), "a.csv, line 2: x is `1.234,5`; a finite number was expected");
        assert_eq!(row("1;1,2,3;2"), "a.csv, line 2: x is `1,2,3`; a finite number was expected");
        assert_eq!(row("1;,;2"), "a.csv, line 2: x is `,`; a finite number was expected");
        assert_eq!(row("1;2"), "a.csv, line 2: the row has 2 fields, but the header has 3");
        assert_eq!(row("1;\"2;3"), "a.csv, line 2: a quotation mark is not closed");
        let lacking = open(b"node;x;Y\n").unwrap().require(MARKS).unwrap_err().to_string();
        assert_eq!(lacking, "a.csv, line 1: has no column `y`; found `node`, `x`, `Y`");
        assert!(open(b"node;x;y;x\n").unwrap_err().to_string().contains("line 1: has the column `x` twice"));
        // With commas as separators, commas are not decimal.
        assert!(file(b"x\n\"1,5\"\n").unwrap().rows().next().unwrap().unwrap().number(0).is_err());
    }

    #[test]
    fn numbers_are_finite() {
        let file = file(b"a\n1.5\nNaN\ninf\n-3\n4\n").unwrap();
        let rows: Vec<_> = file.rows().map(Result::unwrap).collect();
        assert_eq!(rows[0].number(0).unwrap(), 1.5);
        assert_eq!(rows[1].number(0).unwrap_err().to_string(), "a.csv, line 3: a is `NaN`; a finite number was expected");
        assert!(rows[2].number(0).is_err());
        assert!(rows[3].whole_number(0).is_err());
        assert_eq!(rows[4].whole_number(0).unwrap(), 4);
        let file = super::tests::file(b"a\n7.0\n7.50\n7.\n").unwrap();
        let whole: Vec<_> = file.rows().map(|row| row.unwrap().whole_number(0).ok()).collect();
        assert_eq!(whole, [Some(7), None, None]);
        // Terminal commands are escaped, and a field as long as the file is not repeated.
        let hostile = super::tests::file(format!("a\n\u{1b}[2J\n{}\n", "9e".repeat(1_000_000)).as_bytes()).unwrap();
        let errors: Vec<_> = hostile.rows().map(|row| row.unwrap().number(0).unwrap_err().to_string()).collect();
        assert_eq!(errors[0], "a.csv, line 2: a is `\\u{1b}[2J`; a finite number was expected");
        assert!(errors[1].ends_with("9e9e...`; a finite number was expected") && errors[1].len() < 200);
    }

    proptest! {
        #[test]
        fn a_line_splits_as_the_csv_crate_splits_it(line in "[a, \"]{0,12}") {
            let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(line.as_bytes());
            let record = reader.records().next().map_or_else(|| csv::StringRecord::from(vec![""]), Result::unwrap);
            if let Ok(fields) = split_fields(line.as_bytes(), b',') {
                prop_assert_eq!(fields, record.iter().collect::<Vec<_>>());
            }
        }

        #[test]
        fn any_bytes_read_or_fail_without_a_panic(bytes in proptest::collection::vec(
            prop_oneof![Just(b','), Just(b';'), Just(b'a'), Just(b'"'), Just(b'\n'), Just(b'\r'), any::<u8>()], 0..200,
        )) {
            let commas = file(&bytes).ok();
            let semicolons = commas.clone().and_then(|file| file.or_semicolons(&["a"]).ok());
            for file in [commas, semicolons].into_iter().flatten() {
                for row in file.rows().flatten() {
                    prop_assert!(row.line() >= 2);
                    prop_assert_eq!(row.fields.len(), file.header().len());
                }
            }
        }
    }
}
