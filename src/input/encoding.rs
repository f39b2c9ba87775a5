//! Guesses the encoding of a file that is not UTF-8, for error messages only.

/// Whether all bytes of a text that are not UTF-8 can be letters of Windows-1252 (which includes Latin-1), each next to ASCII letters.
/// Words in other alphabets, such as those in Windows-1251, have several such letters in a row. The answer is no for text that is or
/// contains valid UTF-8 beyond ASCII.
pub(super) fn is_windows_1252(text: &[u8]) -> bool {
    let is_mixed = text.utf8_chunks().any(|chunk| !chunk.valid().is_ascii());
    let mut foreign = text.iter().enumerate().filter(|(_, byte)| !byte.is_ascii()).peekable();
    // A zero byte indicates UTF-16.
    !is_mixed
        && !text.contains(&0)
        && foreign.peek().is_some()
        && foreign.all(|(k, &byte)| is_letter(byte) && is_among_letters(text, k))
}

/// Letters of Windows-1252 beyond ASCII: those of Latin-1 without its two arithmetic signs, and the apostrophe in names. Excluded are the
/// seven that Latin-1 lacks, because in Mac Roman they are other, frequent letters, and the last byte, a y with diaeresis, which is rare in
/// names and more likely damage.
fn is_letter(byte: u8) -> bool {
    matches!(byte, 0x92 | 0xC0..=0xD6 | 0xD8..=0xF6 | 0xF8..=0xFE)
}

/// Whether a byte is next to an ASCII letter, and to no other byte beyond ASCII.
fn is_among_letters(text: &[u8], k: usize) -> bool {
    let beside = [k.checked_sub(1).and_then(|k| text.get(k)), text.get(k + 1)];
    beside.iter().flatten().all(|byte| byte.is_ascii()) && beside.iter().flatten().any(|byte| byte.is_ascii_alphabetic())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn western_european_names_are_recognized_and_other_bytes_are_not() {
        for text in [&b"Ren\xE9,1\nZo\xEB,2\n"[..], b"\xC5sa,1", b"O\x92Brien", b"Stra\xDFe", b"\xC9mile"] {
            assert!(is_windows_1252(text), "{text:?}");
        }
        // Pure ASCII, both encodings in one file, a truncated UTF-8 letter, UTF-16, a single byte, signs, Windows-1251, Mac Roman.
        let others: [&[u8]; 10] = [
            b"plain,1",
            "Ren\u{e9},1".as_bytes(),
            b"Ren\xE9,1\nZo\xC3\xAB,2",
            b"S\xE2\x82",
            b"\xFF\xFEs\0u\0b\0",
            b"\xE9,1",
            b"a\xD7b",
            b"a\x80b\xA4",
            b"\xC8\xE2\xE0\xED,1",
            b"Ren\x8E,1",
        ];
        for text in others {
            assert!(!is_windows_1252(text), "{text:?}");
        }
    }
}
