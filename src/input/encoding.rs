//! What a file that is not UTF-8 may be encoded in. Nothing is decoded by it: it is only said.

/// Whether all that is not UTF-8 in a text could be letters of Windows-1252, of which Latin-1 is a part, each between letters of ASCII or beside
/// one: words of other alphabets, as Windows-1251 has them, are letters in a row. A text that is UTF-8, or has letters of UTF-8 as well, is none.
pub(super) fn is_windows_1252(text: &[u8]) -> bool {
    let is_mixed = text.utf8_chunks().any(|chunk| !chunk.valid().is_ascii());
    let mut foreign = text.iter().enumerate().filter(|(_, byte)| !byte.is_ascii()).peekable();
    // A zero is half a letter of UTF-16.
    !is_mixed
        && !text.contains(&0)
        && foreign.peek().is_some()
        && foreign.all(|(k, &byte)| is_letter(byte) && is_among_letters(text, k))
}

/// The letters of Windows-1252 beyond ASCII: those of Latin-1 without its two signs of arithmetic, and the apostrophe of names. The seven that
/// Latin-1 lacks are other letters in Mac Roman, where they are common. The last byte of all, a y with two dots that hardly any name has, rather
/// fills what is damaged.
fn is_letter(byte: u8) -> bool {
    matches!(byte, 0x92 | 0xC0..=0xD6 | 0xD8..=0xF6 | 0xF8..=0xFE)
}

/// Whether a letter of ASCII stands beside a byte, and no other foreign one.
fn is_among_letters(text: &[u8], k: usize) -> bool {
    let beside = [k.checked_sub(1).and_then(|k| text.get(k)), text.get(k + 1)];
    beside.iter().flatten().all(|byte| byte.is_ascii()) && beside.iter().flatten().any(|byte| byte.is_ascii_alphabetic())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_western_europe_are_told_and_other_bytes_are_not() {
        for text in [&b"Ren\xE9,1\nZo\xEB,2\n"[..], b"\xC5sa,1", b"O\x92Brien", b"Stra\xDFe", b"\xC9mile"] {
            assert!(is_windows_1252(text), "{text:?}");
        }
        // Nothing to tell, both encodings in one file, a letter of UTF-8 that is cut, UTF-16, a byte alone, signs, Windows-1251, Mac Roman.
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
