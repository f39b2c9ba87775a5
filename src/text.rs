//! Prepares text from other people's files for messages: printable and of limited length.
//!
//! A field of a file may contain escape sequences that a terminal executes, or be as long as the file. Code that quotes a field uses
//! [`excerpt`]. Messages that leave the library (terminal, `failures.csv`, the page of `annotate`) pass through [`message`], which also
//! handles text quoted by other crates.

use std::borrow::Cow;

use unicode_normalization::UnicodeNormalization;

/// Most characters of a quoted field.
const EXCERPT: usize = 60;

/// Characters kept of a message that is too long: at its start and at its end.
const MESSAGE: (usize, usize) = (1500, 500);

/// Characters that a message may have beyond that, so that a shortened message is not shortened again.
const SLACK: usize = 64;

/// Whether a terminal may execute a character: controls, and characters that change the writing direction.
fn is_command(c: char) -> bool {
    (c.is_control() && c != '\n' && c != '\t')
        || matches!(c, '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}' | '\u{200E}' | '\u{200F}')
}

/// Words, in any case, by which R, pandas, SQL and spreadsheets denote a missing value, and the errors of spreadsheets.
const MISSING_WORDS: [&str; 10] = ["na", "n/a", "n.a.", "<na>", "#n/a", "nan", "null", "#div/0!", "#value!", "#ref!"];

/// Signs that fill a field without a value: `.`, `--`, `?`. A plus is a value, such as a positive test.
const FILLING_SIGNS: [char; 10] = ['.', '-', '_', '?', '*', '/', '\u{2010}', '\u{2013}', '\u{2014}', '\u{2026}'];

/// Whether a text denotes a missing value.
pub fn is_missing_word(value: &str) -> bool {
    let value = value.trim();
    let is_filling = !value.is_empty() && value.chars().all(|c| FILLING_SIGNS.contains(&c));
    is_filling || MISSING_WORDS.iter().any(|word| value.eq_ignore_ascii_case(word))
}

/// Returns a text in composed form. Accents that follow their letters, as in macOS file names, are combined with them.
pub fn composed(text: &str) -> String {
    text.nfc().collect()
}

/// Shortens a field or word for a message: its first 60 characters, all printable, and `...` if there are more.
pub fn excerpt(text: &str) -> String {
    let sign = |c: char| match c {
        '\'' | '"' | '\\' => Cow::Owned(c.to_string()),
        _ if is_command(c) || c.is_control() => Cow::Owned(c.escape_default().to_string()),
        _ => Cow::Owned(c.escape_debug().to_string()),
    };
    let mut shown: String = text.chars().take(EXCERPT).map(sign).collect();
    if text.chars().nth(EXCERPT).is_some() {
        shown.push_str("...");
    }
    shown
}

/// Escapes what a terminal would execute (`\u{1b}`); line breaks and tabs stay.
pub fn printable(text: &str) -> Cow<'_, str> {
    if !text.contains(is_command) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_command(c) { shown.extend(c.escape_default()) } else { shown.push(c) }
    }
    Cow::Owned(shown)
}

/// Escapes a name or path for use within a line: line breaks and what a terminal would execute.
pub fn single_line(text: &str) -> Cow<'_, str> {
    if !text.contains(|c: char| is_command(c) || c.is_control()) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_command(c) || c.is_control() { shown.extend(c.escape_default()) } else { shown.push(c) }
    }
    Cow::Owned(shown)
}

/// Returns a complete message: printable, and at most about 2000 characters. A longer one loses its middle, since the file is named at the
/// start and the expected value at the end.
pub fn message(text: &str) -> Cow<'_, str> {
    let (front, back) = MESSAGE;
    let most = front + back + SLACK;
    if text.len() <= most || text.chars().nth(most).is_none() {
        return printable(text);
    }
    let count = text.chars().count();
    let place = |k: usize| text.char_indices().nth(k).map_or(text.len(), |(place, _)| place);
    let (head, tail) = (&text[..place(front)], &text[place(count - back)..]);
    Cow::Owned(format!("{} [... {} characters ...] {}", printable(head), count - front - back, printable(tail)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terminal_control_characters_are_escaped() {
        assert_eq!(excerpt("\u{1b}]0;title\u{7}"), "\\u{1b}]0;title\\u{7}");
        assert_eq!(excerpt("a\tb \"c\" d\\e 'f' \u{202E}"), "a\\tb \"c\" d\\e 'f' \\u{202e}");
        assert_eq!(excerpt("Ärger 😀"), "Ärger 😀");
        assert_eq!(printable("two\nlines\tand \u{1b}[31m\u{9b}31m\r"), "two\nlines\tand \\u{1b}[31m\\u{9b}31m\\r");
        assert!(matches!(printable("plain"), Cow::Borrowed("plain")));
        assert_eq!(single_line("a\nb\t\u{1b} c"), "a\\nb\\t\\u{1b} c");
        assert!(matches!(single_line("plain"), Cow::Borrowed("plain")));
    }

    #[test]
    fn long_texts_are_shortened_and_keep_both_ends() {
        assert_eq!(excerpt(&"x".repeat(60)), "x".repeat(60));
        assert_eq!(excerpt(&"é".repeat(40_000_000)), "é".repeat(60) + "...");
        let long = format!("a.csv, line 3: {} was expected", "y".repeat(5000));
        let shown = message(&long);
        assert!(shown.starts_with("a.csv, line 3: yyy") && shown.ends_with("yyy was expected"), "{shown}");
        assert!(shown.contains(" characters ...] ") && shown.chars().count() < 2040);
        assert_eq!(message(&shown), shown, "a second pass changes nothing");
        assert_eq!(message("short"), "short");
    }
}
