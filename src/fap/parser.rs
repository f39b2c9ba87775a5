//! Parses ASCII FAP files and recovers as much as possible from invalid ones.
//!
//! A file has a header `version name fps nframes`, then two lines per frame: 68 flags, then the frame number and one value for
//! every flag that is 1. The following deviations are tolerated, each with a warning: a 69th flag (Greta), float values and one
//! value for FAPs 1 and 2 (Xface), a blank in the name, CRLF, tabs, additional blanks, comments and blank lines, a first frame
//! number of 1, versions 2.0 and 2.2, and fewer frames than the 10000 that streaming encoders announce.

use std::borrow::Cow;

use super::{
    catalog::{FapCatalog, FapNumber},
    finding::{Finding, Findings, Rule},
    sequence::{FapFrame, VERSION, is_name_token},
};
use crate::text::excerpt;

/// Frame count in the header of encoders that stream and do not know the real one.
const STREAMING_FRAME_COUNT: u64 = 10_000;
/// Largest absolute value: the limit of a 32-bit reader.
const VALUE_LIMIT: f64 = i32::MAX as f64;
const LEAST_VALUE: f64 = i32::MIN as f64;

/// Header of a FAP file.
#[derive(Clone, Debug, PartialEq)]
pub struct ParsedHeader {
    /// Version, `2.0` to `2.2`.
    pub version: String,
    /// Name, with its words joined by single blanks.
    pub name: String,
    /// Frames per second, positive.
    pub fps: f64,
    /// Number of frames announced.
    pub frame_count: u64,
}

/// The readable content of a FAP file, and all findings.
#[derive(Clone, Debug, PartialEq)]
pub struct ParsedFap {
    /// The header, if readable.
    pub header: Option<ParsedHeader>,
    /// The readable frames, each with the line of its values.
    pub frames: Vec<(usize, FapFrame)>,
    /// Warnings and errors by line.
    pub findings: Vec<Finding>,
}

/// Parses the bytes of a FAP file as far as possible; it rejects nothing and reports every deviation.
pub fn parse_fap(bytes: &[u8]) -> ParsedFap {
    let mut parser = Parser::default();
    let (header, frames) = parser.file(bytes);
    ParsedFap { header, frames, findings: parser.findings.into_sorted() }
}

/// Flags of one mask line.
type Mask = [bool; FapNumber::COUNT];

/// Whether a line is a mask with one blank after its last flag; without it, Greta's C++ readers lose that flag.
pub(super) fn is_mask_for_greta(text: &str) -> bool {
    let mut flags = text.split(' ');
    flags.next_back() == Some("") && flags.clone().count() == FapNumber::COUNT && flags.all(is_flag)
}

#[derive(Default)]
struct Parser {
    findings: Findings,
    first_mask: Option<Mask>,
    /// Whether lines were missing or unexpected, so that a wrong frame count is not worth a finding.
    out_of_step: bool,
    /// Expected number of the next frame; `None` before the first.
    next_number: Option<i64>,
}

/// The expected kind of the next line.
enum Expect {
    Header,
    Mask,
    /// The values of a frame: its mask, if readable, and the line of the mask.
    Values(Option<Mask>, usize),
}

impl Parser {
    fn file(&mut self, bytes: &[u8]) -> (Option<ParsedHeader>, Vec<(usize, FapFrame)>) {
        let (mut header, mut header_line, mut frames) = (None, 1, Vec::new());
        let mut frames_seen = 0;
        let mut expect = Expect::Header;
        let (body, ends) = match bytes {
            [body @ .., b'\n'] => (body, true),
            _ => (bytes, false),
        };
        let mut line = 0;
        // Line ends of old Macs: otherwise the whole file would be one line.
        let (_, before_last) = body.split_last().unwrap_or((&0, &[]));
        let end = if !body.contains(&b'\n') && before_last.contains(&b'\r') { b'\r' } else { b'\n' };
        let (body, ends) = match body {
            [body @ .., b'\r'] if end == b'\r' => (body, true),
            _ => (body, ends),
        };
        if end == b'\r' {
            let message = "the lines end with CR alone; save the file with LF".to_owned();
            self.findings.error(1, "line", Rule::LineEnding, message);
        }
        for raw in body.split(|&b| b == end).filter(|_| !bytes.is_empty()) {
            line += 1;
            if self.findings.given_up() {
                return (header, frames);
            }
            let text = self.line_text(line, raw);
            let words = self.words(line, &text);
            if words.is_empty() {
                continue;
            }
            expect = match expect {
                Expect::Header => {
                    (header, header_line) = (self.header(line, &words), line);
                    Expect::Mask
                }
                Expect::Mask => self.mask_or_stray_values(line, &words),
                Expect::Values(mask, mask_line) if looks_like_mask(&words, mask.as_ref()) => {
                    let message = format!("the mask in line {mask_line} has no values: another mask follows");
                    self.findings.error(line, "frame", Rule::FrameLines, message);
                    self.out_of_step = true;
                    self.mask_or_stray_values(line, &words)
                }
                Expect::Values(mask, _) => {
                    frames_seen += 1;
                    frames.extend(self.values(line, &words, mask.as_ref()).map(|frame| (line, frame)));
                    Expect::Mask
                }
            };
        }
        if !ends && !bytes.is_empty() {
            let message =
                || "the last line has no line end; if the file was truncated, the last value may be incomplete".to_owned();
            self.findings.warning(line, "line", Rule::FinalNewline, message);
        }
        match expect {
            Expect::Header => {
                let message = "the file has no header; expected `2.1 name fps nframes`".to_owned();
                self.findings.error(line.max(1), "header", Rule::Header, message);
            }
            Expect::Values(_, mask_line) => {
                self.out_of_step = true;
                let message =
                    "the file ends after a mask: the line with its values is missing; the file seems truncated".to_owned();
                self.findings.error(mask_line, "frame", Rule::FrameLines, message);
            }
            Expect::Mask => {}
        }
        if let Some(header) = header.as_ref().filter(|_| !self.out_of_step) {
            self.frame_count(header_line, header.frame_count, frames_seen);
        }
        (header, frames)
    }

    /// Text of a line without its line end.
    fn line_text<'a>(&mut self, line: usize, raw: &'a [u8]) -> Cow<'a, str> {
        let mut raw = raw;
        if line == 1
            && let Some(rest) = raw.strip_prefix(b"\xEF\xBB\xBF")
        {
            let message = || "the file starts with a byte order mark; save it as plain ASCII".to_owned();
            self.findings.warning(line, "file", Rule::ByteOrderMark, message);
            raw = rest;
        }
        if let Some(rest) = raw.strip_suffix(b"\r") {
            self.findings.warning(line, "line", Rule::LineEnding, || "the line ends with CRLF; expected LF".to_owned());
            raw = rest;
        }
        String::from_utf8_lossy(raw)
    }

    /// Words of a line; none for comments and blank lines.
    fn words<'a>(&mut self, line: usize, text: &'a str) -> Vec<&'a str> {
        let blank = |c: char| c == ' ' || c == '\t';
        let findings = &mut self.findings;
        let trimmed = text.trim_matches(blank);
        if trimmed.is_empty() {
            findings.warning(line, "line", Rule::BlankLine, || "blank line; one reader stops here".to_owned());
            return Vec::new();
        }
        if trimmed.starts_with('#') {
            findings.warning(line, "line", Rule::Comment, || "comment; some readers do not know comments".to_owned());
            return Vec::new();
        }
        if text.contains('\t') {
            findings.warning(line, "line", Rule::Tab, || "tab; expected single blanks".to_owned());
        }
        if text.starts_with(blank) {
            findings.warning(line, "line", Rule::LeadingBlank, || "blank at the start of the line".to_owned());
        }
        if text.ends_with(blank) && !is_mask_for_greta(text) {
            findings.warning(line, "line", Rule::TrailingBlank, || "blank at the end of the line".to_owned());
        }
        if trimmed.as_bytes().windows(2).any(|pair| pair == b"  ") {
            findings.warning(line, "line", Rule::Spacing, || "several blanks between words; expected one".to_owned());
        }
        trimmed.split(blank).filter(|word| !word.is_empty()).collect()
    }

    fn header(&mut self, line: usize, words: &[&str]) -> Option<ParsedHeader> {
        let [version, name @ .., fps_text, count_text] = words else {
            let message = format!("{} words; expected `2.1 name fps nframes`", words.len());
            self.findings.error(line, "header", Rule::Header, message);
            return None;
        };
        if name.is_empty() {
            let message = "3 words, the name is missing; expected `2.1 name fps nframes`".to_owned();
            self.findings.error(line, "header", Rule::Header, message);
            return None;
        }
        let version_read = match *version {
            VERSION => true,
            "2.0" | "2.2" => {
                let message = || match *version {
                    "2.0" => format!("version 2.0; expected {VERSION} (one reader divides the values of version 2.0 by 20)"),
                    _ => format!(
                        "version {version}, as the visage encoder wants it (--profile visage); other readers expect {VERSION}"
                    ),
                };
                self.findings.warning(line, "version", Rule::Version, message);
                true
            }
            _ => {
                let what = if version.parse::<f64>().is_ok() { "supported" } else { "a version" };
                let message = format!("`{}` is not {what}; expected {VERSION} (or 2.0, 2.2)", excerpt(version));
                self.findings.error(line, "version", Rule::Version, message);
                false
            }
        };
        let name = name.join(" ");
        if !is_name_token(&name) {
            let message = || format!("`{}`; expected one ASCII word of 1 to 100 characters, not starting with #", excerpt(&name));
            self.findings.warning(line, "name", Rule::Name, message);
        }
        let fps = fps_text.parse::<f64>().ok().filter(|fps| *fps > 0.0 && *fps <= VALUE_LIMIT);
        match fps {
            None => {
                let message = format!("`{}` is not a frame rate; expected a positive number, such as 25", excerpt(fps_text));
                self.findings.error(line, "fps", Rule::FpsInteger, message);
            }
            Some(_) if !is_plain_integer(fps_text) => {
                let message = || format!("`{}`; expected an integer: readers cut it or stop", excerpt(fps_text));
                self.findings.warning(line, "fps", Rule::FpsInteger, message);
            }
            Some(_) => {}
        }
        let frame_count = count_text.parse::<u64>().ok();
        if frame_count.is_none() {
            let message = format!("`{}` is not a number of frames", excerpt(count_text));
            self.findings.error(line, "nframes", Rule::FrameCount, message);
        }
        let version = version_read.then(|| (*version).to_owned())?;
        Some(ParsedHeader { version, name, fps: fps?, frame_count: frame_count? })
    }

    /// Compares the number of frames with the header's.
    fn frame_count(&mut self, line: usize, announced: u64, found: u64) {
        if found == 0 {
            self.findings.error(line, "nframes", Rule::FrameCount, "the file has no frames".to_owned());
        } else if announced == STREAMING_FRAME_COUNT && found < announced {
            let message = || format!("the header announces 10000 frames, as for streaming, but {found} follow");
            self.findings.warning(line, "nframes", Rule::FrameCount, message);
        } else if announced != found {
            let cut = if found < announced { "; the file seems cut" } else { "" };
            let message = format!("the header announces {announced} frames, but {found} follow{cut}");
            self.findings.error(line, "nframes", Rule::FrameCount, message);
        }
    }

    /// Reads a mask; if the line is not a mask, its frame is lost.
    fn mask_or_stray_values(&mut self, line: usize, words: &[&str]) -> Expect {
        let flags = words.iter().all(|word| is_flag(word));
        let count_fits = (FapNumber::COUNT..=FapNumber::COUNT + 1).contains(&words.len());
        if !flags && !count_fits {
            let message = format!("expected a mask of 68 flags 0 or 1, found {} words that are something else", words.len());
            self.findings.error(line, "mask", Rule::MaskCount, message);
            self.out_of_step = true;
            return Expect::Mask;
        }
        if !count_fits {
            self.findings.error(line, "mask", Rule::MaskCount, format!("{} flags; expected 68", words.len()));
            return Expect::Values(None, line);
        }
        if let Some(k) = words.iter().position(|word| !is_flag(word)) {
            let message = format!("flag {} is `{}`; expected 0 or 1", k + 1, excerpt(words[k]));
            self.findings.error(line, "mask", Rule::MaskFlag, message);
            return Expect::Values(None, line);
        }
        if let Some(&extra) = words.get(FapNumber::COUNT) {
            if extra == "1" {
                let message = "69 flags, the last of them 1; there are 68 FAPs".to_owned();
                self.findings.error(line, "mask", Rule::MaskCount, message);
                return Expect::Values(None, line);
            }
            let message = || "69 flags; expected 68 (Greta writes one too many; other readers fail)".to_owned();
            self.findings.warning(line, "mask", Rule::MaskCount, message);
        }
        let mask: Mask = std::array::from_fn(|k| words[k] == "1");
        if *self.first_mask.get_or_insert(mask) != mask {
            let message =
                || "the mask differs from that of the first frame; readers interpret unset FAPs differently then".to_owned();
            self.findings.warning(line, "mask", Rule::MaskVaries, message);
        }
        Expect::Values(Some(mask), line)
    }

    /// Reads frame number and values; `None` on an error.
    fn values(&mut self, line: usize, words: &[&str], mask: Option<&Mask>) -> Option<FapFrame> {
        let (number, words) = words.split_first()?;
        let in_order = self.frame_number(line, number);
        let mask = mask?;
        let is_set = |fap: FapNumber| mask[fap.index()];
        let high: Vec<FapNumber> = [FapNumber::VISEME, FapNumber::EXPRESSION].into_iter().filter(|&fap| is_set(fap)).collect();
        let low: Vec<FapNumber> = FapNumber::low_level().filter(|&fap| is_set(fap)).collect();
        let catalog = FapCatalog::mpeg4();
        let [in_full, in_short] = asked_for(mask);
        if words.len() != in_full && words.len() != in_short {
            let or = if in_full == in_short { String::new() } else { format!(" (or {in_short})") };
            let message = format!("{} values after the frame number; the mask asks for {in_full}{or}", words.len());
            self.findings.error(line, "values", Rule::ValueCount, message);
            return None;
        }
        let mut frame = FapFrame::default();
        let mut complete = in_order;
        let mut rest = words;
        for fap in high {
            let count = if words.len() == in_full { catalog.fields(fap).len() } else { 1 };
            let (fields, tail) = rest.split_at(count);
            rest = tail;
            let fields = self.fields(line, fap, fields);
            complete &= fields.is_some();
            frame.set_fields(fap, fields);
        }
        for (fap, word) in low.into_iter().zip(rest) {
            let value = self.value(line, fap, word);
            complete &= value.is_some();
            frame.set_value(fap, value);
        }
        complete.then_some(frame)
    }

    fn frame_number(&mut self, line: usize, word: &str) -> bool {
        let Ok(number) = word.parse::<i64>() else {
            let message = format!("`{}` is not a frame number", excerpt(word));
            self.findings.error(line, "frame", Rule::NotNumeric, message);
            self.next_number = self.next_number.map(|next| next.saturating_add(1));
            return false;
        };
        let fits = match (self.next_number, number) {
            (Some(next), _) => next == number,
            (None, 0) => true,
            (None, 1) => {
                let message = || "the first frame has number 1; expected 0: a reader uses it as an array index".to_owned();
                self.findings.warning(line, "frame", Rule::FrameOrder, message);
                true
            }
            (None, _) => false,
        };
        if !fits {
            let message = format!("frame number {number} is out of order; expected {}", self.next_number.unwrap_or(0));
            self.findings.error(line, "frame", Rule::FrameOrder, message);
        }
        self.next_number = Some(number.saturating_add(1));
        fits
    }

    fn value(&mut self, line: usize, fap: FapNumber, word: &str) -> Option<f64> {
        let Ok(value) = word.parse::<f64>() else {
            let message = format!("`{}` is not a number", excerpt(word));
            self.findings.error(line, format!("FAP {fap}"), Rule::NotNumeric, message);
            return None;
        };
        if !(LEAST_VALUE..=VALUE_LIMIT).contains(&value) {
            let message = format!("`{}` is not a finite number of 32 bits", excerpt(word));
            self.findings.error(line, format!("FAP {fap}"), Rule::NotFinite, message);
            return None;
        }
        if !is_plain_integer(word) {
            let message = || format!("FAP {fap} is `{}`; expected a decimal integer: some readers stop here", excerpt(word));
            self.findings.warning(line, "values", Rule::Integer, message);
        }
        Some(value)
    }

    /// Reads the integers of FAP 1 or 2.
    fn fields(&mut self, line: usize, fap: FapNumber, words: &[&str]) -> Option<Vec<i32>> {
        let field = format!("FAP {fap}");
        if words.len() == 1 {
            let message = || format!("one value for FAP {fap}, as old tools write it; other readers expect several");
            self.findings.warning(line, field.clone(), Rule::HighLevel, message);
        } else {
            let message = || format!("FAP {fap} is set; readers expect different numbers of values for it");
            self.findings.warning(line, field.clone(), Rule::HighLevel, message);
        }
        let mut fields = Vec::with_capacity(words.len());
        for word in words {
            let value = self.value(line, fap, word)?;
            if value.fract() != 0.0 {
                let message = format!("`{}` is not an integer", excerpt(word));
                self.findings.error(line, field, Rule::Integer, message);
                return None;
            }
            fields.push(value as i32);
        }
        Some(fields)
    }
}

/// Number of values that a mask requires: with all fields of FAPs 1 and 2, and with one value for each, as old tools write them.
fn asked_for(mask: &Mask) -> [usize; 2] {
    let set = FapNumber::all().filter(|fap| mask[fap.index()]);
    let fields = |fap: FapNumber| if fap.is_high_level() { FapCatalog::mpeg4().fields(fap).len() } else { 1 };
    [set.clone().map(fields).sum(), set.count()]
}

/// Whether a line at the position of values looks like a mask: 68 or 69 flags, when the last mask requires another number of
/// values.
fn looks_like_mask(words: &[&str], mask: Option<&Mask>) -> bool {
    (FapNumber::COUNT..=FapNumber::COUNT + 1).contains(&words.len())
        && !mask.is_some_and(|mask| asked_for(mask).contains(&(words.len() - 1)))
        && words.iter().all(|word| is_flag(word))
}

pub(super) fn is_flag(word: &str) -> bool {
    matches!(word, "0" | "1")
}

/// Whether a word is a decimal integer of the strict subset: digits, optionally after a minus.
fn is_plain_integer(word: &str) -> bool {
    let digits = word.strip_prefix('-').unwrap_or(word);
    !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit())
}
