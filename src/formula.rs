//! Protects CSV files against texts that a spreadsheet would run as a formula.
//!
//! A label such as `=HYPERLINK(...)` is text here, but a program in a spreadsheet. All CSV files are written through
//! [`FormulaGuard`], which puts an apostrophe in front of such a field, as spreadsheets do; [`crate::input`] removes it again, so
//! that files read back unchanged. Numbers (`-1.2`) and a lone sign stay as they are.

use std::io::{self, Write};

/// First characters that start a formula; the last four are wide forms that some spreadsheets treat alike.
const TRIGGERS: [char; 11] = ['=', '+', '-', '@', '\t', '\r', '\n', '＝', '＋', '－', '＠'];

/// The sign in front of a text that is not a formula.
const APOSTROPHE: u8 = b'\'';

/// Whether a field (without quotation marks) gets an apostrophe. A formula that already has apostrophes in front gets another one, so that
/// removing one always restores the original.
fn needs_apostrophe(field: &str) -> bool {
    let text = field.trim_start_matches('\'');
    let starts = text.starts_with(TRIGGERS) && text.chars().nth(1).is_some();
    starts && (text.len() < field.len() || text.trim().parse::<f64>().is_err())
}

/// Returns a field as it was before [`FormulaGuard`] wrote it.
pub fn without_apostrophe(field: &str) -> &str {
    match field.strip_prefix('\'') {
        Some(text) if needs_apostrophe(field) => text,
        _ => field,
    }
}

/// A CSV writer that puts an apostrophe in front of every field that a spreadsheet would run as a formula.
#[derive(Debug)]
pub struct FormulaGuard<W: Write> {
    inner: W,
    /// Bytes of a field that may need an apostrophe; its opening quotation mark is already written.
    held: Vec<u8>,
    /// Whether that field is quoted.
    is_quoted: bool,
    out: Vec<u8>,
    place: Place,
}

/// Position of the next byte in the text.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    /// At the start of a field.
    Start,
    /// After the quotation mark at the start of a field.
    QuotedStart,
    /// Within a field: whether it is quoted and whether it is held back.
    Field { quoted: bool, held: bool },
}

impl<W: Write> FormulaGuard<W> {
    /// Creates a guard in front of a writer.
    pub fn new(inner: W) -> Self {
        Self { inner, held: Vec::new(), is_quoted: false, out: Vec::new(), place: Place::Start }
    }

    fn byte(&mut self, byte: u8) {
        let ends_unquoted = matches!(byte, b',' | b'\n');
        let may_trigger = matches!(byte, b'=' | b'+' | b'-' | b'@' | b'\t' | b'\r' | APOSTROPHE | 0xEF);
        match self.place {
            Place::Start if byte == b'"' => {
                self.out.push(byte);
                self.place = Place::QuotedStart;
            }
            Place::Start if ends_unquoted => self.out.push(byte),
            Place::Start | Place::QuotedStart => {
                let quoted = self.place == Place::QuotedStart;
                self.is_quoted = quoted;
                let held = may_trigger || (quoted && byte == b'\n');
                if held {
                    self.held.push(byte);
                } else {
                    self.out.push(byte);
                }
                // A second quotation mark closes the field or is half of a doubled one; both continue as after a closing one.
                self.place = Place::Field { quoted: quoted && byte != b'"', held };
            }
            Place::Field { quoted: false, held } if ends_unquoted => {
                if held {
                    self.release();
                }
                self.out.push(byte);
                self.place = Place::Start;
            }
            Place::Field { quoted, held } => {
                if held {
                    self.held.push(byte);
                } else {
                    self.out.push(byte);
                }
                // Within a quoted field, a doubled mark leaves the quotes and enters them again.
                self.place = Place::Field { quoted: quoted ^ (byte == b'"'), held };
            }
        }
    }

    /// Writes the held field, with an apostrophe if it needs one.
    fn release(&mut self) {
        let mut text = String::from_utf8_lossy(&self.held).into_owned();
        if self.is_quoted {
            text = text.strip_suffix('"').unwrap_or(&text).replace("\"\"", "\"");
        }
        if needs_apostrophe(&text) {
            self.out.push(APOSTROPHE);
        }
        self.out.append(&mut self.held);
    }
}

impl<W: Write> Write for FormulaGuard<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        bytes.iter().for_each(|&byte| self.byte(byte));
        self.inner.write_all(&self.out)?;
        self.out.clear();
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn written(rows: &[&[&str]]) -> String {
        let mut bytes = Vec::new();
        {
            let mut csv = csv::WriterBuilder::new().flexible(true).from_writer(FormulaGuard::new(&mut bytes));
            rows.iter().for_each(|row| csv.write_record(*row).unwrap());
            csv.flush().unwrap();
        }
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn formulas_get_an_apostrophe_and_numbers_do_not() {
        assert_eq!(written(&[&["=1+1", "-1.2", "+5e3", "a=b", "-", "@x"]]), "'=1+1,-1.2,+5e3,a=b,-,'@x\n");
        assert_eq!(
            written(&[&["=A1,\"b\"", "x,=y", "\tz"], &["", "\r=", "-2-3"]]),
            "\"'=A1,\"\"b\"\"\",\"x,=y\",'\tz\n,\"'\r=\",'-2-3\n"
        );
        assert_eq!(written(&[&["＝1", "'=1", "''5", "'tis", "Änderung", "－"]]), "'＝1,''=1,''5,'tis,Änderung,－\n");
    }

    #[test]
    fn an_apostrophe_of_ours_is_taken_off_again() {
        assert_eq!(without_apostrophe("'=1+1"), "=1+1");
        assert_eq!(without_apostrophe("''-1"), "'-1");
        assert_eq!(["'tis", "'", "-1", "=1"].map(without_apostrophe), ["'tis", "'", "-1", "=1"]);
    }

    proptest! {
        #[test]
        fn written_files_read_back(fields in proptest::collection::vec("['=+@a1,\"\r\n\t-]{0,6}", 2..5)) {
            let texts: Vec<&str> = fields.iter().map(String::as_str).collect();
            let text = written(&[&texts, &["end"]]);
            let mut reader = csv::ReaderBuilder::new().has_headers(false).flexible(true).from_reader(text.as_bytes());
            let record = reader.records().next().unwrap().unwrap();
            let back: Vec<&str> = record.iter().map(without_apostrophe).collect();
            prop_assert_eq!(back, texts);
            // No field as seen by a spreadsheet starts a formula.
            prop_assert!(record.iter().all(|f| !f.starts_with(TRIGGERS) || f.chars().count() == 1 || f.trim().parse::<f64>().is_ok()));
        }
    }
}
