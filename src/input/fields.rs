//! Splits bytes into lines, and lines into fields.

use std::borrow::Cow;

use super::InputErrorKind;

/// State of the last field at the end of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ends {
    /// Outside of quotation marks.
    Closed,
    /// Within them.
    Open,
    /// A closing quotation mark is followed by other text.
    Strange,
}

/// State at the end of fields, as defined in RFC 4180.
pub(super) fn end_of_fields(text: &[u8], separator: u8) -> Ends {
    let (mut inside, mut starts, mut closed) = (false, true, false);
    for &byte in text {
        match byte {
            b'"' if inside => (inside, closed) = (false, true),
            b'"' if starts || closed => (inside, starts, closed) = (true, false, false),
            _ if inside => {}
            _ if byte == separator => (starts, closed) = (true, false),
            _ if closed => return Ends::Strange,
            _ => starts = false,
        }
    }
    if inside { Ends::Open } else { Ends::Closed }
}

/// Lines of a byte text with their numbers. LF, CRLF and CR end a line.
#[derive(Clone)]
pub(super) struct Lines<'a> {
    pub bytes: &'a [u8],
    /// Offset and number of the next line.
    pub offset: usize,
    pub line: usize,
}

impl<'a> Iterator for Lines<'a> {
    type Item = (usize, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let rest = self.bytes.get(self.offset..).filter(|rest| !rest.is_empty())?;
        let length = rest.iter().position(|b| matches!(b, b'\n' | b'\r')).unwrap_or(rest.len());
        let end = if rest[length..].starts_with(b"\r\n") { 2 } else { usize::from(length < rest.len()) };
        self.offset += length + end;
        self.line += 1;
        Some((self.line - 1, &rest[..length]))
    }
}

pub(super) fn is_blank(text: &[u8]) -> bool {
    text.iter().all(u8::is_ascii_whitespace)
}

/// Fields of one line, as defined in RFC 4180 except for the separator, which is any ASCII character. A quotation mark within an unquoted
/// field is text.
pub(super) fn split_fields(text: &[u8], separator: u8) -> Result<Vec<Cow<'_, str>>, InputErrorKind> {
    let text =
        std::str::from_utf8(text).map_err(|e| InputErrorKind::NotUtf8 { byte: e.valid_up_to() + 1, windows_1252: false })?;
    if !text.contains('"') {
        return Ok(text.split(char::from(separator)).map(Cow::Borrowed).collect());
    }
    let mut fields = Vec::new();
    let mut rest = Some(text);
    while let Some(text) = rest {
        let (quoted, after) = match text.strip_prefix('"') {
            Some(inside) => take_quoted(inside)?,
            None => (String::new(), text),
        };
        let (plain, next) = after.split_once(char::from(separator)).map_or((after, None), |(plain, next)| (plain, Some(next)));
        fields.push(if quoted.is_empty() { Cow::Borrowed(plain) } else { Cow::Owned(quoted + plain) });
        rest = next;
    }
    Ok(fields)
}

/// The content of a quoted field with its doubled quotes replaced, and the text after its closing quote.
fn take_quoted(inside: &str) -> Result<(String, &str), InputErrorKind> {
    let mut content = String::new();
    let mut rest = inside;
    loop {
        let (part, after) = rest.split_once('"').ok_or(InputErrorKind::UnclosedQuote)?;
        content.push_str(part);
        match after.strip_prefix('"') {
            Some(next) => {
                content.push('"');
                rest = next;
            }
            None => return Ok((content, after)),
        }
    }
}
