//! Checks the lengths stated in a Parquet file against its actual bytes before memory is allocated for them.
//!
//! The reader of the `parquet` crate trusts the counts and sizes of damaged files. Footer and page headers use Thrift's compact protocol.
//! They are parsed here once, and the lengths they state must fit into the file.

/// Message for lengths that do not fit.
pub(super) type Misfit = String;

/// Largest nesting depth of a header's structures.
const MAX_DEPTH: usize = 32;

/// Largest number of bytes that Snappy decompresses from one byte (a copy of 64 bytes in 3), rounded up.
const MOST_FROM_A_BYTE: u64 = 32;

/// Additional bytes allowed for a page, so that nearly empty pages are not refused.
const PAGE_SLACK: u64 = 1024;

/// Value types of the compact protocol.
mod kind {
    pub const STOP: u8 = 0;
    pub const TRUE: u8 = 1;
    pub const FALSE: u8 = 2;
    pub const BYTE: u8 = 3;
    pub const I16: u8 = 4;
    pub const I32: u8 = 5;
    pub const I64: u8 = 6;
    pub const DOUBLE: u8 = 7;
    pub const BINARY: u8 = 8;
    pub const LIST: u8 = 9;
    pub const SET: u8 = 10;
    pub const MAP: u8 = 11;
    pub const STRUCT: u8 = 12;
    pub const UUID: u8 = 13;
}

/// Why a structure cannot be parsed.
#[derive(Debug, PartialEq)]
enum Broken {
    /// The bytes end before the structure does.
    Short,
    /// The structure is invalid, for the given reason.
    Wrong(&'static str),
}

/// Parser of the compact protocol; `rest` are the bytes not yet read.
struct Walk<'a> {
    rest: &'a [u8],
}

impl Walk<'_> {
    fn byte(&mut self) -> Result<u8, Broken> {
        let (&first, rest) = self.rest.split_first().ok_or(Broken::Short)?;
        self.rest = rest;
        Ok(first)
    }

    fn pass(&mut self, count: u64) -> Result<(), Broken> {
        let count = usize::try_from(count).map_err(|_| Broken::Short)?;
        self.rest = self.rest.get(count..).ok_or(Broken::Short)?;
        Ok(())
    }

    /// Reads a varint: seven bits per byte, lowest first.
    fn varint(&mut self) -> Result<u64, Broken> {
        let mut value = 0_u64;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7F) << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(Broken::Wrong("a number of more than 64 bits"))
    }

    /// Reads a zigzag-coded signed number.
    fn signed(&mut self) -> Result<i64, Broken> {
        let value = self.varint()?;
        Ok((value >> 1) as i64 ^ -((value & 1) as i64))
    }

    /// Reads a field's number and type, or `None` at the end of the structure. `last` is the previous field's number.
    fn field(&mut self, last: i64) -> Result<Option<(i64, u8)>, Broken> {
        let head = self.byte()?;
        let (delta, kind) = (head >> 4, head & 0x0F);
        if kind == kind::STOP {
            return Ok(None);
        }
        let number = if delta == 0 { self.signed()? } else { last.saturating_add(i64::from(delta)) };
        Ok(Some((number, kind)))
    }

    /// Reads a list's length and element type. Each element takes at least one byte.
    fn list(&mut self) -> Result<(u64, u8), Broken> {
        let head = self.byte()?;
        let count = if head >> 4 == 15 { self.varint()? } else { u64::from(head >> 4) };
        Ok((self.fitting(count)?, head & 0x0F))
    }

    fn fitting(&self, count: u64) -> Result<u64, Broken> {
        if count > self.rest.len() as u64 { Err(Broken::Wrong("a list of more elements than bytes")) } else { Ok(count) }
    }

    fn value(&mut self, kind: u8, depth: usize) -> Result<(), Broken> {
        if depth > MAX_DEPTH {
            return Err(Broken::Wrong("structures within structures without end"));
        }
        match kind {
            kind::TRUE | kind::FALSE => Ok(()),
            kind::BYTE => self.pass(1),
            kind::I16 | kind::I32 | kind::I64 => self.varint().map(drop),
            kind::DOUBLE => self.pass(8),
            kind::BINARY => {
                let length = self.varint()?;
                self.pass(length)
            }
            kind::LIST | kind::SET => {
                let (count, kind) = self.list()?;
                (0..count).try_for_each(|_| self.element(kind, depth))
            }
            kind::MAP => {
                let count = self.varint()?;
                if self.fitting(count)? == 0 {
                    return Ok(());
                }
                let kinds = self.byte()?;
                (0..count).try_for_each(|_| self.element(kinds >> 4, depth).and_then(|()| self.element(kinds & 0x0F, depth)))
            }
            kind::STRUCT => {
                let mut last = 0;
                while let Some((number, kind)) = self.field(last)? {
                    self.value(kind, depth + 1)?;
                    last = number;
                }
                Ok(())
            }
            kind::UUID => self.pass(16),
            _ => Err(Broken::Wrong("a value of no known kind")),
        }
    }

    /// Skips a list element: as `value`, but booleans take one byte.
    fn element(&mut self, kind: u8, depth: usize) -> Result<(), Broken> {
        if matches!(kind, kind::TRUE | kind::FALSE) { self.pass(1) } else { self.value(kind, depth + 1) }
    }
}

/// Checks that the lengths in the footer (without its own length and the closing mark) fit its bytes.
pub(super) fn check_footer(footer: &[u8]) -> Result<(), Misfit> {
    let mut walk = Walk { rest: footer };
    walk.value(kind::STRUCT, 0).map_err(|e| match e {
        Broken::Short => "the footer ends early".to_owned(),
        Broken::Wrong(what) => format!("the footer has {what}"),
    })
}

/// Lengths from a page header.
#[derive(Debug, Default, PartialEq)]
pub(super) struct PageLengths {
    /// Bytes of the header itself.
    header: u64,
    uncompressed: i64,
    compressed: i64,
    is_dictionary: bool,
    /// Number of values in the page.
    values: i64,
}

impl PageLengths {
    /// Reads the header at the start of `bytes`, or returns `None` if it continues beyond them.
    pub(super) fn read(bytes: &[u8]) -> Result<Option<Self>, Misfit> {
        match Self::walk(bytes) {
            Ok(lengths) => Ok(Some(lengths)),
            Err(Broken::Short) => Ok(None),
            Err(Broken::Wrong(what)) => Err(format!("a page has {what}")),
        }
    }

    fn walk(bytes: &[u8]) -> Result<Self, Broken> {
        /// Field numbers of a page header.
        const UNCOMPRESSED: i64 = 2;
        const COMPRESSED: i64 = 3;
        const DATA: i64 = 5;
        const DICTIONARY: i64 = 7;
        const DATA_2: i64 = 8;
        /// Field number of the value count in all three headers.
        const VALUES: i64 = 1;
        let mut walk = Walk { rest: bytes };
        let mut lengths = Self::default();
        let mut last = 0;
        while let Some((number, kind)) = walk.field(last)? {
            match (number, kind) {
                (UNCOMPRESSED, kind::I32) => lengths.uncompressed = walk.signed()?,
                (COMPRESSED, kind::I32) => lengths.compressed = walk.signed()?,
                (DATA | DICTIONARY | DATA_2, kind::STRUCT) => {
                    lengths.is_dictionary |= number == DICTIONARY;
                    let mut inner = 0;
                    while let Some((number, kind)) = walk.field(inner)? {
                        match (number, kind) {
                            (VALUES, kind::I32) => lengths.values = lengths.values.max(walk.signed()?),
                            _ => walk.value(kind, 2)?,
                        }
                        inner = number;
                    }
                }
                _ => walk.value(kind, 1)?,
            }
            last = number;
        }
        lengths.header = (bytes.len() - walk.rest.len()) as u64;
        Ok(lengths)
    }

    /// Returns the bytes of header and page, after three checks. The page must fit into the `left` bytes of the column, its values into
    /// the group's `rows`, and its uncompressed size into the most that decompression can give.
    pub(super) fn checked(&self, left: u64, rows: u64) -> Result<u64, Misfit> {
        let compressed = u64::try_from(self.compressed).ok().filter(|&c| self.header + c <= left);
        let compressed = compressed.ok_or_else(|| format!("a page of {} bytes where {left} are left", self.compressed))?;
        let most = compressed * MOST_FROM_A_BYTE + PAGE_SLACK;
        let uncompressed = u64::try_from(self.uncompressed).ok().filter(|&u| u <= most);
        let uncompressed =
            uncompressed.ok_or_else(|| format!("a page of {compressed} bytes that says to hold {}", self.uncompressed))?;
        // A dictionary stores all its values in full; values of other pages are rows.
        let most = if self.is_dictionary { uncompressed } else { rows };
        if u64::try_from(self.values).is_ok_and(|values| values <= most) {
            Ok(self.header + compressed)
        } else {
            Err(format!("a page of {} values where {most} can be", self.values))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Type 0, uncompressed 100, compressed 50, data page of 12 values in encoding 0.
    const PAGE: [u8; 14] = [0x15, 0, 0x15, 0xC8, 0x01, 0x15, 100, 0x2C, 0x15, 24, 0x15, 0, 0, 0];

    #[test]
    fn a_page_header_is_read_as_written() {
        let lengths = PageLengths::read(&PAGE).unwrap().unwrap();
        assert_eq!(lengths, PageLengths { header: 14, uncompressed: 100, compressed: 50, is_dictionary: false, values: 12 });
        assert_eq!(lengths.checked(64, 12), Ok(64));
        assert!(lengths.checked(63, 12).unwrap_err().contains("a page of 50 bytes where 63 are left"));
        assert!(lengths.checked(64, 11).unwrap_err().contains("12 values where 11 can be"));
        assert_eq!(PageLengths::read(&PAGE[..9]), Ok(None), "it continues after these bytes");
        let swollen = PageLengths { uncompressed: 2_000_000_000, ..lengths };
        assert!(swollen.checked(64, 12).unwrap_err().contains("says to hold 2000000000"));
        assert!(PageLengths { compressed: -1, ..swollen }.checked(64, 12).is_err());
    }

    #[test]
    fn footers_promise_no_more_than_they_have() {
        // A field 1 that is a list of two bytes, then the end.
        assert_eq!(check_footer(&[0x19, 0x23, 7, 8, 0]), Ok(()));
        assert!(check_footer(&[0x19, 0x23, 7]).unwrap_err().contains("more elements than bytes"));
        // Two thousand million booleans.
        assert!(check_footer(&[0x19, 0xF1, 0xFF, 0xFF, 0xFF, 0xFF, 0x07, 0]).unwrap_err().contains("more elements than bytes"));
        assert!(check_footer(&[0x18, 0xFF, 0xFF, 0x03, 1]).unwrap_err().contains("ends early"));
        assert!(check_footer(&[0x1C; 100]).unwrap_err().contains("without end"));
        assert!(check_footer(&[0x1E]).unwrap_err().contains("no known kind"));
        assert!(check_footer(&[0x16, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x01]).is_err());
    }
}
