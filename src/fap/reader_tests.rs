//! Tests of the tolerant reader: content that known tools write, and content that none of them writes.

use super::{super::finding::Rule, *};

/// A mask line with the given FAPs set.
fn mask(faps: &[usize]) -> String {
    (1..=68).map(|n| if faps.contains(&n) { "1" } else { "0" }).collect::<Vec<_>>().join(" ")
}

/// Two frames of FAPs 3 and 51, in the strict subset.
fn strict() -> String {
    let m = mask(&[3, 51]);
    format!("2.1 joy 25 2\n{m}\n0 0 0\n{m}\n1 12 -7\n")
}

fn findings(text: &str) -> Vec<(usize, Rule, Severity)> {
    parse_fap(text.as_bytes()).findings.into_iter().map(|f| (f.line, f.rule, f.severity)).collect()
}

/// Reads with exactly one warning, and the same values as without the deviation.
fn tolerates(text: &str, line: usize, rule: Rule) -> FapFile {
    assert_eq!(findings(text), [(line, rule, Severity::Warning)], "{text}");
    parse_fap(text.as_bytes()).into_file().unwrap()
}

/// Fails to read; returns the message of the first error.
fn refuses(text: &str, line: usize, rule: Rule) -> String {
    let findings = parse_fap(text.as_bytes()).into_file().unwrap_err();
    let first = findings.iter().find(|f| f.severity == Severity::Error).unwrap();
    assert_eq!((first.line, first.rule), (line, rule), "{first}");
    first.message.clone()
}

fn value(file: &FapFile, frame: usize, fap: u8) -> Option<f64> {
    file.sequence.frames[frame].value(FapNumber::try_from(fap).unwrap())
}

#[test]
fn the_strict_subset_reads_without_a_finding() {
    let file = parse_fap(strict().as_bytes()).into_file().unwrap();
    assert_eq!(file.findings, []);
    let FapSequence { version, name, fps, frames } = &file.sequence;
    assert_eq!((version.as_str(), name.as_str(), *fps, frames.len()), ("2.1", "joy", 25.0, 2));
    assert_eq!([value(&file, 1, 3), value(&file, 1, 51), value(&file, 1, 4)], [Some(12.0), Some(-7.0), None]);
}

#[test]
fn greta_writes_69_flags_and_a_name_with_blanks() {
    let m = mask(&[19]) + " 0";
    let text = format!("2.1 C:\\my faps\\blink 25 1\n{m}\n0 1024\n");
    assert_eq!(findings(&text), [(1, Rule::Name, Severity::Warning), (2, Rule::MaskCount, Severity::Warning)]);
    let file = parse_fap(text.as_bytes()).into_file().unwrap();
    assert_eq!(file.sequence.name, "C:\\my faps\\blink");
    assert_eq!(value(&file, 0, 19), Some(1024.0));
}

#[test]
fn xface_writes_floats_and_one_value_for_faps_1_and_2() {
    let file = tolerates(&strict().replace("1 12 -7", "1 12.5 -7.000000"), 5, Rule::Integer);
    assert_eq!(file.findings[0].times, 2);
    assert_eq!(value(&file, 1, 3), Some(12.5));
    let text = format!("2.1 Xface::FapFile 25 1\n{}\n0 3 1 9\n", mask(&[1, 2, 3]));
    let file = parse_fap(text.as_bytes()).into_file().unwrap();
    assert_eq!(file.sequence.frames[0].fields(FapNumber::EXPRESSION), Some(&[1][..]));
    assert_eq!(value(&file, 0, 3), Some(9.0));
}

#[test]
fn faps_1_and_2_have_4_and_6_values_when_the_line_is_that_long() {
    let text = format!("2.1 x 25 1\n{}\n0 1 2 63 0 1 63 0 0 0 1 9\n", mask(&[1, 2, 3]));
    let file = parse_fap(text.as_bytes()).into_file().unwrap();
    assert_eq!(file.sequence.frames[0].fields(FapNumber::VISEME), Some(&[1, 2, 63, 0][..]));
    assert_eq!(file.sequence.frames[0].fields(FapNumber::EXPRESSION), Some(&[1, 63, 0, 0, 0, 1][..]));
    // One of them in full and the other in short form: no tool writes that.
    let message = refuses(&format!("2.1 x 25 1\n{}\n0 1 2 63 0 1 9\n", mask(&[1, 2, 3])), 3, Rule::ValueCount);
    assert_eq!(message, "6 values after the frame number; the mask asks for 11 (or 3)");
    refuses(&format!("2.1 x 25 1\n{}\n0 1.5 9\n", mask(&[1, 3])), 3, Rule::Integer);
}

#[test]
fn spelling_that_tools_differ_in_is_tolerated() {
    let crlf = tolerates(&strict().replace('\n', "\r\n"), 1, Rule::LineEnding);
    assert_eq!(crlf.findings[0].times, 5);
    tolerates(&strict().replace("1 12 -7", "1\t12 -7"), 5, Rule::Tab);
    tolerates(&strict().replace("1 12 -7", "1 12 -7 "), 5, Rule::TrailingBlank);
    tolerates(&strict().replace("1 12 -7", " 1 12 -7"), 5, Rule::LeadingBlank);
    tolerates(&strict().replace("1 12 -7", "1  12 -7"), 5, Rule::Spacing);
    tolerates(&format!("# made by visage\n{}", strict()), 1, Rule::Comment);
    tolerates(&strict().replace("\n0 0 0\n", "\n0 0 0\n# apex\n"), 4, Rule::Comment);
    tolerates(&format!("{}\n", strict()), 6, Rule::BlankLine);
    tolerates(strict().trim_end(), 5, Rule::FinalNewline);
    tolerates(&strict().replace("2.1 ", "2.0 "), 1, Rule::Version);
    tolerates(&strict().replace("2.1 ", "2.2 "), 1, Rule::Version);
    tolerates(&strict().replace(" 25 ", " 25.0 "), 1, Rule::FpsInteger);
    tolerates(&strict().replace(" 25 2", " 25 10000"), 1, Rule::FrameCount);
}

#[test]
fn a_first_frame_number_of_1_is_tolerated_and_another_is_not() {
    let m = mask(&[3]);
    tolerates(&format!("2.1 x 25 2\n{m}\n1 5\n{m}\n2 6\n"), 3, Rule::FrameOrder);
    let message = refuses(&format!("2.1 x 25 1\n{m}\n7 5\n"), 3, Rule::FrameOrder);
    assert_eq!(message, "frame number 7 is out of order; expected 0");
    refuses(&format!("2.1 x 25 2\n{m}\n0 5\n{m}\n0 6\n"), 5, Rule::FrameOrder);
    refuses(&format!("2.1 x 25 2\n{m}\n0 5\n{m}\n2 6\n"), 5, Rule::FrameOrder);
    refuses(&format!("2.1 x 25 1\n{m}\n-1 5\n"), 3, Rule::FrameOrder);
    refuses(&format!("2.1 x 25 1\n{m}\nfirst 5\n"), 3, Rule::NotNumeric);
    refuses(&format!("2.1 x 25 2\n{m}\n9223372036854775807 5\n{m}\n0 5\n"), 3, Rule::FrameOrder);
}

#[test]
fn masks_may_differ_between_frames() {
    let text = format!("2.1 x 25 2\n{}\n0 5\n{}\n1 6\n", mask(&[3]), mask(&[15]));
    let file = tolerates(&text, 4, Rule::MaskVaries);
    assert_eq!([value(&file, 1, 3), value(&file, 1, 15)], [None, Some(6.0)]);
}

#[test]
fn a_wrong_number_of_flags_or_a_flag_that_is_none_is_refused() {
    let m = mask(&[3]);
    let with_mask = |mask: &str| format!("2.1 x 25 1\n{mask}\n0 5\n");
    assert_eq!(refuses(&with_mask(&m[2..]), 2, Rule::MaskCount), "67 flags; expected 68");
    refuses(&with_mask(&format!("{m} 0 0")), 2, Rule::MaskCount);
    refuses(&with_mask(&format!("{m} 1")), 2, Rule::MaskCount);
    refuses(&with_mask(&m.replacen('0', "2", 1)), 2, Rule::MaskFlag);
    refuses(&with_mask("5 6 7"), 2, Rule::MaskCount);
}

#[test]
fn a_wrong_number_of_values_is_refused() {
    let message = refuses(&strict().replace("1 12 -7", "1 12"), 5, Rule::ValueCount);
    assert_eq!(message, "1 values after the frame number; the mask asks for 2");
    refuses(&strict().replace("1 12 -7", "1 12 -7 3"), 5, Rule::ValueCount);
}

#[test]
fn values_that_are_no_finite_numbers_are_refused() {
    for word in ["x", "1,5", "0x10", "1e", "--1"] {
        refuses(&strict().replace("12", word), 5, Rule::NotNumeric);
    }
    for word in ["NaN", "inf", "-infinity", "1e999", "3000000000"] {
        refuses(&strict().replace("12", word), 5, Rule::NotFinite);
    }
}

#[test]
fn headers_that_no_tool_writes_are_refused() {
    let refuses = |header: &str, rule| refuses(&strict().replace("2.1 joy 25 2", header), 1, rule);
    refuses("2.1", Rule::Header);
    refuses("2.1 25 2", Rule::Header);
    refuses("1.0 joy 25 2", Rule::Version);
    refuses("joy 2.1 25 2", Rule::Version);
    for fps in ["0", "-25", "nan", "inf", "fast"] {
        refuses(&format!("2.1 joy {fps} 2"), Rule::FpsInteger);
    }
    for count in ["-2", "2.0", "many", "99999999999999999999999"] {
        refuses(&format!("2.1 joy 25 {count}"), Rule::FrameCount);
    }
}

#[test]
fn files_that_end_early_or_late_are_refused() {
    let end = |text: &str, line, rule| refuses(text, line, rule);
    assert!(end("", 1, Rule::Header).contains("no header"));
    end("# only a comment\n", 1, Rule::Header);
    assert!(end("2.1 joy 25 0\n", 1, Rule::FrameCount).contains("no frames"));
    let huge = strict().replace("25 2", "25 18446744073709551615");
    assert_eq!(
        end(&huge, 1, Rule::FrameCount),
        "the header announces 18446744073709551615 frames, but 2 follow; the file seems cut"
    );
    end(&strict().replace("25 2", "25 1"), 1, Rule::FrameCount);
    let cut = strict().replace("1 12 -7\n", "");
    assert!(end(&cut, 4, Rule::FrameLines).contains("ends after a mask"));
    let swallowed = strict().replace("\n0 0 0\n", "\n");
    end(&swallowed, 3, Rule::FrameLines);
}

#[test]
fn one_bad_line_fails_only_its_frame() {
    let text = strict().replace("\n0 0 0\n", "\n0 0 zero\n");
    let parsed = parse_fap(text.as_bytes());
    assert_eq!(parsed.frames.len(), 1);
    assert_eq!(parsed.findings.len(), 1);
}

#[test]
fn bytes_that_are_no_text_are_only_named() {
    let mut bytes = strict().into_bytes();
    bytes[4] = 0xE9; // a Latin-1 letter in the name
    let file = parse_fap(&bytes).into_file().unwrap();
    assert_eq!(file.findings[0].rule, Rule::Name);
    let zeros = vec![0; 4000];
    assert!(parse_fap(&zeros).into_file().is_err());
}

#[test]
fn a_file_that_is_not_there_or_not_readable_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("a.fap");
    assert!(read_fap(&missing).unwrap_err().to_string().contains("a.fap"));
    assert!(matches!(read_fap(folder.path()), Err(FapReadError::Io { .. })));
    std::fs::write(&missing, "2.1 joy 25 x\n1 2\n").unwrap();
    let text = read_fap(&missing).unwrap_err().to_string();
    assert!(text.contains("a.fap:1: error frame-count: nframes: `x` is not a number of frames (and 1 more"), "{text}");
}
